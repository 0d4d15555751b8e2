"""Origins moved along axes: shorter programs, the same results."""

from __future__ import annotations

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.algebra.euclidean import Vec
from spatialdyn.algebra.records import vec_of
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.record import recording
from spatialdyn.engines.programs.record.move_origins import move_origins
from spatialdyn.engines.programs.record.tracer import Row, table
from spatialdyn.recursions import SPECS

ROUNDING = 64 * np.finfo(float).eps  # of the largest entry: another order of operations
BODY = (2.0, (0.1, 0.2, 0.3), np.diag([0.3, 0.4, 0.5]))


def leg() -> sd.Model:
    """Two joints about x and y whose origins lie off the axes' common point, the first by 0.2 along its own axis."""
    turned = np.eye(4)
    turned[:3, 3] = 0.2, 0.0, -0.3
    lower = np.eye(4)
    lower[:3, 3] = 0.05, 0.1, 0.0
    made = sd.ModelBuilder("leg").add_body("hip", None, "revolute", axis=(1, 0, 0), placement=turned, inertia=BODY)
    return made.add_body("knee", "hip", "revolute", axis=(0, 1, 0), placement=lower, inertia=BODY).build()


def right_angled(seed: int) -> sd.Model:
    """A tree of joints along coordinate axes, half of the offsets zero; odd seeds have a floating base."""
    rng = np.random.default_rng(seed)
    made = sd.ModelBuilder("m", root="base").add_body(
        "trunk", "base", "floating" if seed % 2 else "fixed", inertia=BODY
    )
    names = ["trunk"]
    for k in range(7):
        X = np.eye(4)
        X[:3, :3] = X[:3, :3][rng.permutation(3)]
        X[0, :3] *= np.linalg.det(X[:3, :3])
        X[:3, 3] = rng.standard_normal(3) * rng.integers(0, 2, 3)
        kind, axis = str(rng.choice(["revolute", "continuous", "prismatic"])), np.roll([1, 0, 0], rng.integers(3))
        made = made.add_body(f"b{k}", names[-rng.integers(1, 3) :][0], kind, axis=axis, placement=X, inertia=BODY)
        names.append(f"b{k}")
    return made.build()


def rows_of(model: sd.Model) -> list[Row]:
    return table(model.bodies)


def test_an_origin_moves_along_its_axis_where_zeros_come_of_it() -> None:
    rows = rows_of(leg())
    move_origins(rows)
    assert vec_of(rows[1].X.p) == Vec(0.0, 0.0, -0.3)
    # the knee lies 0.2 further along x from there, and 0.1 along its own y, which goes
    assert vec_of(rows[2].X.p) == pytest.approx((0.25, 0.0, 0.0), abs=1e-16)
    m, h, I = 2.0, np.array([0.2, 0.4, 0.6]), rows[1].inertia
    assert (I.m, *vec_of(I.h)) == pytest.approx((m, h[0] + 2.0 * 0.2, h[1], h[2]))  # the com is 0.2 further away


@pytest.mark.parametrize("k", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_origin_moves_along_an_axis_of_either_sign(k: int, sign: float) -> None:
    builder = sd.ModelBuilder("m").add_body("a", axis=sign * np.eye(3)[k], placement=(0.2, 0.3, 0.4), inertia=BODY)
    rows = rows_of(builder.build())
    move_origins(rows)
    assert vec_of(rows[1].X.p) == tuple(0.0 if i == k else x for i, x in enumerate((0.2, 0.3, 0.4)))


def test_an_origin_stays_where_zeros_would_go() -> None:
    """The child joint has no entry along the axis, and its own axis cannot undo one."""
    carried = np.eye(4)
    carried[:3, 3] = 0.0, 0.1, 0.2
    for count in (1, 2):
        turned = np.eye(4)
        turned[:3, 3] = 0.2, 0.0, 0.0
        made = sd.ModelBuilder("m").add_body("a", None, "revolute", axis=(1, 0, 0), placement=turned, inertia=BODY)
        for k in range(count):
            made = made.add_body(f"b{k}", "a", "prismatic", axis=(0, 1, 0), placement=carried, inertia=BODY)
        rows = rows_of(made.build())
        move_origins(rows)
        assert vec_of(rows[1].X.p).x == 0.2


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", ["rnea", "crba", "aba", "nonlinear_effects", "coriolis_matrix", "momentum"])
def test_answers_are_the_same(seed: int, name: str) -> None:
    model = right_angled(seed)
    rng = np.random.default_rng(seed)
    spec = numba_kernels.variant(SPECS[name], frozenset())
    q = sd.random_configuration(model, rng)
    values = [q if x.name == "q" else rng.standard_normal(model.nv) for x in spec.present]
    wanted = getattr(sd, name)(model, *values)
    program = recording.record((spec,), model.bodies).program
    found = np.array(program.run(np.concatenate(values)))[: wanted.size].reshape(wanted.shape)
    assert abs(found - wanted).max() <= ROUNDING * max(1.0, abs(wanted).max())


def test_programs_get_shorter(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = numba_kernels.variant(SPECS["aba"], frozenset())

    def count() -> int:
        operations = recording.record((spec,), leg().bodies).program.operations
        return operations["mul"] + operations["add"]

    shorter = count()
    monkeypatch.setattr(recording, "move_origins", lambda rows: None)
    assert shorter < count()


@pytest.mark.parametrize("kept", ["fext", "payload", "float32", "frames"])
def test_origins_stay_where_inputs_are_in_a_bodys_frame(monkeypatch: pytest.MonkeyPatch, kept: str) -> None:
    seen = []
    monkeypatch.setattr(recording, "move_origins", seen.append)
    model = leg()
    if kept == "fext":
        recording.record((SPECS["rnea"],), model.bodies)
    elif kept == "payload":
        sd.specialize(model, sd.rnea, inputs="payload").program
    elif kept == "float32":
        sd.specialize(model, sd.rnea, dtype=np.float32).program
    else:
        recording.record((SPECS["forward_kinematics"],), model.bodies)
    assert seen == []
    recording.record((numba_kernels.variant(SPECS["rnea"], frozenset()),), model.bodies)
    assert len(seen) == 1
