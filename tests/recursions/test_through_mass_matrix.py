"""Models with mimic joints: each recursion with pivots has its ``through_M``, and calls name no recursion."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from inputs import no_programs

import spatialdyn as sd
from spatialdyn.calls import dynamics
from spatialdyn.engines import threads
from spatialdyn.engines.compiled import lane_names, numba_kernels
from spatialdyn.recursions import SPECS

INERTIA = (1.0, (0.1, 0.0, 0.2), np.diag([0.1, 0.2, 0.15]))


@pytest.fixture
def gripper() -> sd.Model:
    """A wrist and two fingers, one of which follows the wrist."""
    builder = sd.ModelBuilder("gripper").add_body("b0", axis=(0, 1, 0), inertia=INERTIA, joint_name="lead")
    builder.add_body("b1", "b0", axis=(1, 0, 0), inertia=INERTIA)
    builder.add_body(
        "b2", "b1", axis=(0, 1, 0), inertia=INERTIA, mimic={"leader": "lead", "multiplier": 2.0, "offset": 0.1}
    )
    return builder.build(mimic=True)


def test_every_recursion_with_pivots_brings_its_way_through_M_and_no_other() -> None:
    assert {name for name, spec in SPECS.items() if spec.through_M} == {n for n, s in SPECS.items() if s.pivots}


def test_calls_name_no_recursion() -> None:
    """``dynamics`` makes them all from their Specs."""
    tree = ast.parse(Path(dynamics.__file__ or "").read_text(encoding="utf-8"))
    words = {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)}
    assert words & set(SPECS) == set()


def test_a_spec_of_ones_own_goes_through_M(gripper: sd.Model) -> None:
    """Twice M⁻¹ p, and p: a Spec that no file of the package has."""
    seen = []

    def through_M(M: Any, q: Any, p: Any) -> Any:
        seen.append(len(p))
        return 2.0 * M.solve(p), M.call("momentum", q, M.solve(p))

    field = SPECS["hamilton_field"]
    spec = replace(SPECS["velocity_from_momentum"], name="my_own", output=field.output, through_M=through_M)
    rng = np.random.default_rng(0)
    q, p = rng.standard_normal((2, 5, 2))
    found = dynamics.checked_call(spec, gripper, (q, p), (), None)
    M = sd.crba(gripper, q)
    np.testing.assert_allclose(found[:, 0], 2.0 * np.linalg.solve(M, p[..., None])[..., 0], rtol=1e-13)
    np.testing.assert_allclose(found[:, 1], p, rtol=1e-12, atol=1e-13)
    assert seen == ([len(q)] if numba_kernels.PLAIN else [1])  # recorded, or all samples at once
    np.testing.assert_array_equal(dynamics.checked_call(spec, gripper, (q[0], p[0]), (), None), found[0])


@pytest.mark.parametrize("name", ["crba", "aba", "minverse", "aba_derivatives", "hamiltonian"])
@pytest.mark.parametrize("n", [7, 602])
def test_slices_change_no_bit(gripper: sd.Model, name: str, n: int, monkeypatch: pytest.MonkeyPatch) -> None:
    no_programs(monkeypatch)
    rng, spec = np.random.default_rng(3), SPECS[name]
    values = [rng.standard_normal((n, 2)) for x in spec.present if not x.optional]
    values[-1] = values[-1][0]  # one sample that serves all, but of q alone
    wanted = getattr(sd, name)(gripper, *values)
    cuts, right = [], threads.slices

    def short(count: int, rows: int, results: int, least: int = 1) -> Any:
        for cut in right(count, 1 << 9, 1 << 9, least):
            cuts.append(cut)
            yield cut

    monkeypatch.setattr(threads, "slices", short)
    monkeypatch.setattr(threads, "SLICE_SECONDS", 0.0)
    np.testing.assert_array_equal(getattr(sd, name)(gripper, *values), wanted)
    assert cuts
    if wanted.shape[:1] == (n,):
        assert len(cuts) >= n // (lane_names.width() if lane_names.fits(spec) else 1)


def test_what_is_wrong_is_said_of_the_whole_batch(gripper: sd.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not of the slice that it is in."""
    no_programs(monkeypatch)
    q = np.zeros((9, 2))
    q[[4, 7]] = 1.7e308
    monkeypatch.setattr(threads, "FIRST_SLICE", 1)
    monkeypatch.setattr(threads, "SLICE_SECONDS", 0.0)
    for call in (lambda: sd.crba(gripper, q), lambda: sd.aba(gripper, q, q[:1], q[:1])):
        with pytest.raises(sd.NonFiniteError, match="in sample 4, the first of 2"):
            call()


def test_a_nan_beside_it_hides_no_singular_mass_matrix() -> None:
    """M of the other samples is checked."""
    builder = sd.ModelBuilder("pair").add_body("b0", axis=(0, 1, 0), inertia=INERTIA, joint_name="lead")
    builder.add_body("b1", "b0", "prismatic", axis=(1, 0, 0))
    builder.add_body("b2", "b1", axis=(0, 1, 0), mimic={"leader": "lead", "multiplier": 2.0, "offset": 0.0})
    model = builder.build(mimic=True)
    q = np.array([[np.nan, 0.0], [0.1, 0.2]])
    with pytest.raises(sd.InertiaError):
        sd.minverse(model, q)
