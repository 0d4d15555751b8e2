"""``buildModelFromMJCF``: joints and frames named and ordered as the wheel's where it loads; MuJoCo's numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
import spatialdyn.compat.pinocchio as ours

mujoco = pytest.importorskip("mujoco")
GEOM = '<geom type="box" size=".1 .2 .3" mass="1.5" pos=".1 .05 .2"/>'
CENTRED = f"""<mujoco model="centred"><compiler angle="radian"/><worldbody><body name="base">{GEOM}
  <body name="b" pos="0 0 1" euler=".1 .2 .3"><joint axis="0 1 0" range="-1 2" damping="2" armature=".1"/>{GEOM}
    <site name="mark" pos="0 0 .1"/><site/>
    <body name="c" pos="0 0 1"><joint name="ball" type="ball"/>{GEOM}
      <body name="d" pos="1 0 0"><joint name="s1" type="slide" axis="1 0 0"/><joint name="s2" axis="1 1 0"/>{GEOM}
        <body name="e" pos=".1 0 0">{GEOM}</body></body></body></body>
  <body name="a" pos="0 1 0"><joint name="last" type="slide" axis="0 0 1" frictionloss=".3" ref=".2"/>{GEOM}</body>
</body></worldbody><keyframe><key name="home" qpos="1 .5 .5 .5 .5 .1 .2 .3"/></keyframe></mujoco>"""
FREE = f"""<mujoco model="free"><worldbody><body name="base" pos="0 0 1"><freejoint/>{GEOM}
  <body name="leg" pos="0 0 -.3"><joint name="hip" axis="0 -1 0"/>{GEOM}</body></body></worldbody></mujoco>"""
PLACED = (
    CENTRED.replace('name="ball" type="ball"', 'name="ball" type="ball" pos=".1 .2 .3"')
    .replace('axis="1 1 0"', 'axis="1 1 0" pos="0 .2 0"')
    .replace('type="slide" axis="1 0 0"', 'type="slide" axis="1 0 0" pos=".3 0 .1"')
    .replace('<body name="base">', '<body name="base" pos="0 0 1" euler="0 .3 0">')
)


@pytest.fixture
def file(tmp_path: Path) -> Any:
    def write(text: str) -> str:
        (tmp_path / "robot.xml").write_text(text, encoding="utf-8")
        return str(tmp_path / "robot.xml")

    return write


@pytest.mark.parametrize("text", [CENTRED, FREE])
def test_joints_and_frames_are_named_and_ordered_as_the_wheels(file: Any, text: str) -> None:
    theirs = pytest.importorskip("pinocchio")
    mine, other = ours.buildModelFromMJCF(file(text)), theirs.buildModelFromMJCF(file(text))
    assert (mine.name, mine.nq, mine.nv) == (other.name, other.nq, other.nv)
    assert list(mine.names) == list(other.names)
    assert list(mine.parents) == list(other.parents)
    assert [x.shortname() for x in mine.joints][1:] == [x.shortname() for x in other.joints][1:]
    described = [[(x.name, x.type.name, x.parentJoint, x.parentFrame) for x in m.frames] for m in (mine, other)]
    assert described[0] == described[1]
    for name in ("damping", "armature", "upperDryFrictionLimit"):
        assert getattr(mine, name) == pytest.approx(getattr(other, name)), name
    for one, two in zip(mine.frames, other.frames, strict=True):
        assert one.placement.homogeneous == pytest.approx(two.placement.homogeneous, abs=1e-12), one.name
    for one, two in zip(mine.inertias, other.inertias, strict=True):
        assert one.mass == pytest.approx(two.mass)
    for entry in other.referenceConfigurations:
        assert mine.referenceConfigurations[entry.key()] == pytest.approx(entry.data()), entry.key()


@pytest.mark.parametrize("text", [CENTRED, FREE, PLACED])
def test_numbers_are_mujocos(file: Any, text: str) -> None:
    """Of joints that stand apart from their body's frame too, whose places the wheel leaves out."""
    mine, lib = ours.buildModelFromMJCF(file(text)), sd.load(text)
    data = mine.createData()
    for q in (sd.random_configuration(lib, k) for k in range(3)):
        v = np.arange(1.0, lib.nv + 1)
        M = ours.crba(mine, data, q)
        assert np.triu(M) == pytest.approx(np.triu(sd.crba(lib, q)), abs=1e-12 * abs(M).max())
        bias = sd.nonlinear_effects(lib, q, v)
        assert ours.nonLinearEffects(mine, data, q, v) == pytest.approx(bias, abs=1e-12 * abs(bias).max())
    ours.framesForwardKinematics(mine, data, q)
    for name in ("base", "leg") if text == FREE else ("mark", "c", "d", "e"):
        X = data.oMf[mine.getFrameId(name)].homogeneous
        assert pytest.approx(sd.frame_placement(lib, q, name), abs=1e-12) == X


def test_keyframes_are_reference_configurations(file: Any) -> None:
    model = ours.buildModelFromMJCF(file(CENTRED))
    assert model.referenceConfigurations["home"].tolist() == [1, 0.5, 0.5, 0.5, 0.5, 0.1, 0.2, 0.3]
    assert model.referenceConfigurations["qpos0"].tolist() == [0, 0, 0, 0, 1, 0, 0, 0.2]
    assert ours.buildModelFromMJCF(file(FREE)).referenceConfigurations["qpos0"].tolist() == [0, 0, 1, 0, 0, 0, 1, 0]


def test_a_root_joint_carries_the_world(file: Any) -> None:
    model = ours.buildModelFromMJCF(file(CENTRED), ours.JointModelFreeFlyer())
    assert list(model.names)[:3] == ["universe", "root_joint", "bJoint_0"]
    assert ours.computeTotalMass(model) == pytest.approx(6 * 1.5)
    with pytest.raises(sd.SpatialDynError, match='root_joint is given and the file has the free joint "base_free"'):
        ours.buildModelFromMJCF(file(FREE), ours.JointModelFreeFlyer())
    with pytest.raises(TypeError, match="mjcf_filename is"):
        ours.buildModelFromMJCF(5)
    with pytest.raises(sd.SpatialDynError, match="MuJoCo refuses it"):
        ours.buildModelFromMJCF(file("<mujoco><nothing/></mujoco>"))
