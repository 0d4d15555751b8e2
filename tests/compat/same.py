"""Whether a compat Model equals the wheel's: names, numbers, tree, frames, limits."""

from __future__ import annotations

from typing import Any

import numpy as np

EPS = np.finfo(float).eps
PLACED = 64 * EPS  # a product of some placements; moments of inertia are relative to the largest
LEVER = 1e-11  # a centre of mass is a first moment over a mass that may be small
COUNTS = "nq nv nvExtended njoints nbodies nframes name"
LISTS = "parents idx_qs nqs idx_vs nvs idx_vExtendeds nvExtendeds mimicking_joints mimicked_joints"
TREES = "supports subtrees children mimic_joint_supports"
LIMITS = (
    "lowerPositionLimit upperPositionLimit positionLimitMargin lowerEffortLimit upperEffortLimit effortLimit "
    "upperVelocityLimit velocityLimit lowerDryFrictionLimit upperDryFrictionLimit friction damping armature "
    "rotorInertia rotorGearRatio"
)


def assert_close(ours: Any, theirs: Any, what: str, bound: float = PLACED) -> None:
    """Both within ``bound`` of the largest entry, infinities the same."""
    a, b = np.asarray(ours, float), np.asarray(theirs, float)
    assert a.shape == b.shape, what
    where = a != b
    assert np.abs(a[where] - b[where]).max(initial=0.0) <= bound * max(
        1.0, np.abs(b[np.isfinite(b)]).max(initial=0.0)
    ), what


def assert_same_model(ours: Any, theirs: Any, but: str = "") -> None:
    """All attributes of both models, but for those named in ``but``."""
    left = but.split()
    for name in COUNTS.split():
        if name not in left:
            assert getattr(ours, name) == getattr(theirs, name), name
    assert list(ours.names) == theirs.names.tolist()
    for name in LISTS.split():
        assert list(getattr(ours, name)) == list(getattr(theirs, name)), name
    for name in TREES.split():
        assert [list(x) for x in getattr(ours, name)] == [list(x) for x in getattr(theirs, name)], name
    assert [joint.shortname() for joint in ours.joints] == [joint.shortname() for joint in theirs.joints]
    for name in LIMITS.split():
        if name not in left:
            assert (getattr(ours, name) == getattr(theirs, name)).all(), name
    for k, name in enumerate(ours.names):
        assert_close(ours.jointPlacements[k].homogeneous, theirs.jointPlacements[k].homogeneous, f"placement of {name}")
        assert_same_inertia(ours.inertias[k], theirs.inertias[k], name)
    for k, (f, g) in enumerate(zip(ours.frames, theirs.frames, strict=True)):
        assert (f.name, int(f.type), f.parentJoint) == (g.name, int(g.type), g.parentJoint), k
        if "parentFrame" not in left:
            assert f.parentFrame == g.parentFrame, f.name
        assert_close(f.placement.homogeneous, g.placement.homogeneous, f.name)
        assert_same_inertia(f.inertia, g.inertia, f.name)
    assert_close(ours.gravity.vector, theirs.gravity.vector, "gravity", 0.0)
    configurations = {entry.key(): entry.data() for entry in theirs.referenceConfigurations}
    assert {entry.key() for entry in ours.referenceConfigurations} == set(configurations)
    for name, q in configurations.items():
        assert_close(ours.referenceConfigurations[name], q, name)


def assert_same_inertia(ours: Any, theirs: Any, what: str) -> None:
    assert_close(ours.matrix(), theirs.matrix(), f"inertia of {what}")
    if theirs.mass:
        assert_close(ours.lever, theirs.lever, f"centre of mass of {what}", LEVER)
