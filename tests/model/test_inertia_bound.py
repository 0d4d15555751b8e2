"""The bound on a joint's composite inertia, by which its pivot is judged: never too small, and of the same order."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from trees import SCREWS, random_tree

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.compiled.checks import singular_row
from spatialdyn.engines.programs.record import parameters
from spatialdyn.engines.programs.record.parameters import Parameter, changed
from spatialdyn.engines.programs.record.recording import pivot_margins
from spatialdyn.engines.programs.record.tracer import table

Array = NDArray[np.float64]
SLACK = 1e-12  # rounding of sums of a few dozen products
STATES = 3 if numba_kernels.PLAIN else 40
LOADS = ((0.3, 0.0, 0.0), (0.0, -0.7, 0.2), (2.0, 1.0, -1.0))  # where a payload's com is in its frame


def seen(model: sd.Model, q: Array) -> Array:
    """The composite inertia about each freedom, without rotors, (..., rows)."""
    return np.asarray(np.diagonal(sd.crba(model, q), axis1=-2, axis2=-1) - model.bodies["armature"][1:])


def travel(model: sd.Model, q: Array) -> Array:
    """How far all that slides has moved, in all, (...)."""
    places = {"prismatic": 1, "planar": 2, "floating": 3}
    parts = [q[..., j.idx_q : j.idx_q + places[j.kind]] for j in model.joints[1:] if j.kind in places]
    parts += [j.pitch * q[..., j.idx_q : j.idx_q + 1] for j in model.joints[1:]]
    return np.asarray(sum((abs(x).sum(-1) for x in parts), np.zeros(q.shape[:-1])))


def tree(k: int) -> Any:
    """Trees of every kind of joint; the last one slides nowhere, those before it have helical joints."""
    if k > 5:
        return random_tree(9, 6, ["revolute"]).model if k == 8 else random_tree(k, 6, SCREWS, floating=k == 7).model
    return random_tree(k, 6, floating=k % 2 == 1).model


@pytest.mark.parametrize("k", range(9))
def test_a_bound_is_no_less_than_the_composite_inertia_in_any_state(k: int) -> None:
    model = tree(k)
    q = sd.random_configuration(model, np.random.default_rng(k), (STATES,))
    bound, t = model.bodies["inertia_bound"][1:], travel(model, q)[:, None]
    most = bound["x"] + t * (2.0 * bound["y"] + t * bound["z"])
    assert (seen(model, q) <= most * (1.0 + SLACK)).all()
    slides = np.array([not any(row["S"]["w"].tolist()) for row in model.bodies[1:]])
    masses = seen(model, q)[:, slides]
    assert (abs(masses / bound["x"][slides] - 1.0) <= SLACK).all()  # which is all that a shift can see


def test_a_bound_is_of_the_order_of_what_a_stretched_arm_has() -> None:
    """Three point masses in a row, moved off their frames: 14 m of reach, seen whole."""
    builder = sd.ModelBuilder("rods")
    for n, (length, mass) in enumerate(((0.0, 1.0), (4.0, 2.0), (6.0, 3.0))):
        at = (length, 0.0, 0.0)
        body = (mass, (4.0, 0.0, 0.0), np.zeros((3, 3)))
        builder.add_body(f"b{n}", f"b{n - 1}" if n else None, axis=(0, 0, 1), placement=at, inertia=body)
    model = builder.build()
    about = seen(model, np.zeros(3))
    np.testing.assert_allclose(about, [16.0 + 2 * 64.0 + 3 * 196.0, 2 * 16.0 + 3 * 100.0, 3 * 16.0])
    bound = model.bodies["inertia_bound"]["x"][1:]
    assert (about <= bound).all()
    assert (bound <= 1.5 * about).all()  # √2 of it: the norm of a point mass's inertia over its largest entry


@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("k", range(9))
def test_a_bound_grows_with_a_payload_by_no_less_than_that_brings(k: int, load: tuple[float, ...]) -> None:
    """Of a heavy one on the last body, by the margins that programs have: in q², not in |q|."""
    model = tree(k)
    last = model.joints[-1]
    inertia = np.diag([0.1, 0.2, 0.25])
    loaded = model.with_(payload={f"joint:{last.name}": (500.0, load, inertia)})
    here = Parameter("payload", last.row, parameters.place(np.eye(4)))
    value = [500.0, *load, 0.1, 0.0, 0.0, 0.2, 0.0, 0.25]
    rows = table(changed(model.bodies, [here], [value]))
    eps = 1.0 / model.nv  # so that n eps is 1 and a margin is D less its bound
    slides = any(j.kind in ("prismatic", "helical", "planar", "floating") for j in model.joints[1:])
    for q in sd.random_configuration(model, np.random.default_rng(k), (STATES,)):
        D = seen(loaded, q) + model.bodies["armature"][1:]
        margins = pivot_margins(rows, q, D, eps)
        assert all(D_i <= least * (1.0 + SLACK) for D_i, least in margins)
    assert slides == (k < 8)


@pytest.mark.parametrize(("kind", "count"), [("prismatic", 1), ("helical", 1), ("planar", 2), ("floating", 3)])
def test_a_margin_grows_with_each_coordinate_that_slides(kind: str, count: int) -> None:
    """A body 1 km from a joint that rotates its parent, offset along each axis of its own joint."""
    builder = sd.ModelBuilder("slide")
    for n, axis in enumerate(np.eye(3)):
        builder.add_body(f"t{n}", f"t{n - 1}" if n else None, axis=axis, inertia=(1.0, (0, 0, 0), np.eye(3)))
    pitch = -1.0 if kind == "helical" else 0.0
    builder.add_body("far", "t2", kind, (0, 0, 1), inertia=(1.0, (0, 0, 0), np.eye(3)), pitch=pitch)
    model = builder.build()
    rows, neutral = table(model.bodies), sd.neutral(model)
    for k in range(count):
        q = neutral.copy()
        q[3 + k] = 1000.0
        D = seen(model, q)
        assert D.max() > 1e6
        assert all(x <= least for x, least in pivot_margins(rows, q, D, 1.0 / model.nv))
        far = int(np.argmax(D))
        alone = np.where(np.arange(len(D)) == far, D * (1.0 - SLACK), np.inf)
        assert singular_row(model.bodies, q, alone, 1.0 / model.nv) == far + 1


def test_a_payload_that_slides_far_counts_by_the_square_of_its_way() -> None:
    """A point mass on a slide, 1 km from the joint that turns it: its own mass is nearly all."""
    body = (1e-3, (0.0, 0.0, 0.0), 1e-3 * np.eye(3))
    builder = sd.ModelBuilder("slide").add_body("turns", axis=(0, 0, 1), inertia=body)
    model = builder.add_body("slides", "turns", "prismatic", (1, 0, 0), inertia=body).build()
    loaded = model.with_(payload={"slides": (500.0, (0.0, 0.0, 0.0), np.zeros((3, 3)))})
    here = Parameter("payload", 2, parameters.place(np.eye(4)))
    found = changed(model.bodies, [here], [[500.0, *[0.0] * 9]])
    for way in (0.0, 1.0, 1000.0, -1000.0):
        q = np.array([0.3, way])
        bound = found["inertia_bound"][1:]
        most = bound["x"] + abs(way) * (2.0 * bound["y"] + abs(way) * bound["z"])
        assert (seen(loaded, q) <= most * (1.0 + SLACK)).all()
        margins = pivot_margins(table(found), q, seen(loaded, q), 1.0 / model.nv)
        assert all(D <= least * (1.0 + SLACK) for D, least in margins)


def test_a_payload_on_a_screw_counts_by_its_pitch() -> None:
    """A point mass on the axis, which no turn moves: p² m is all that the joint sees of it."""
    body = (1.0, (0.0, 0.0, 0.0), np.diag([0.1, 0.1, 0.2]))
    model = sd.ModelBuilder("screw").add_body("nut", joint="helical", inertia=body, pitch=-2.0).build()
    loaded = model.with_(payload={"nut": (50.0, (0.0, 0.0, 0.3), np.zeros((3, 3)))})
    here = Parameter("payload", 1, parameters.place(np.eye(4)))
    found = changed(model.bodies, [here], [[50.0, 0.0, 0.0, 0.3, *[0.0] * 6]])
    assert (seen(loaded, np.zeros(1)) <= found["inertia_bound"]["x"][1:]).all()
    assert (seen(loaded, np.zeros(1)) <= loaded.bodies["inertia_bound"]["x"][1:]).all()


def test_a_payloads_bound_is_of_the_order_of_a_body_built_in() -> None:
    builder = sd.ModelBuilder("arm")
    for n in range(3):
        body = (1.0, (0.5, 0.0, 0.0), np.diag([0.01, 0.1, 0.1]))
        builder.add_body(f"b{n}", f"b{n - 1}" if n else None, axis=(0, 0, 1), placement=(1.0, 0, 0), inertia=body)
    model = builder.build()
    load = (50.0, (0.5, 0.0, 0.0), np.diag([0.1, 1.0, 1.0]))
    loaded = model.with_(payload={"b2": load})
    here = Parameter("payload", 3, parameters.place(np.eye(4)))
    found = changed(model.bodies, [here], [[50.0, 0.5, 0.0, 0.0, 0.1, 0.0, 0.0, 1.0, 0.0, 1.0]])
    about = seen(loaded, np.zeros(3))
    assert (about <= found["inertia_bound"]["x"][1:]).all()
    assert (found["inertia_bound"]["x"][1:] <= 4.5 * about).all()
