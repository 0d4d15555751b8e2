"""Motion of mechanisms with more equations than independent ones, with every method; and through branch points."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dense import Array
from slow import slow_but

import spatialdyn as sd
from spatialdyn.simulation.arithmetic import Computed
from spatialdyn.simulation.effects.constraints import Constrained
from spatialdyn.simulation.methods.constrained_symplectic import raise_if_branching
from spatialdyn.simulation.system import System

sys.path.append(str(Path(__file__).parents[1] / "constraints"))
from mechanisms import REDUNDANT, bennett, slider_crank, three_cranks

ORDERS = {"explicit_euler": 1, "semi_implicit_euler": 1, "velocity_verlet": 2, "rk4": 4}
SYMPLECTIC = ("stormer_verlet", "variational")
Made = tuple[sd.Model, sd.Constraints, Array, Array]
METHODS = (*ORDERS, *SYMPLECTIC)
RANKS = {"bennett": 2, "bricard": 4, "three_cranks": 3, "parallelogram": 3}
PAIRS = [(name, method) for name in REDUNDANT for method in METHODS]
ENERGY = {
    "explicit_euler": 2.0,
    "semi_implicit_euler": 1.0,
    "velocity_verlet": 2e-3,
    "rk4": 1e-7,
}  # [J], in steps of 1 ms
SYMPLECTIC_ENERGY = 5e-3  # [J] in steps of 4 ms: bounded, of order dt²


def run_of(made: Made, time: float, dt: float, method: str, **more: Any) -> Any:
    model, held, q, v = made
    return sd.simulate(sd.Scene(model, constraints=held, **more), q, v, time, dt, method)


def check_closed(held: sd.Constraints, run: Any, rank: int, phi: float) -> None:
    """φ and J v stay of rounding, or of a step's error squared; equations that depend on others are met as well."""
    assert abs(sd.constraint_error(held.model, held, run.q)).max() <= phi
    J = sd.constraint_jacobian(held.model, held, run.q)
    assert abs((J @ run.v[..., None])[..., 0]).max() <= 1e-6 * abs(run.v).max()
    motion = sd.constrained_dynamics(held.model, held, run.q[0], run.v[0], np.zeros(held.model.nv))
    assert motion.rank == rank
    assert (motion.force == 0.0).sum() >= held.nc - rank


@pytest.mark.parametrize(("name", "method"), [("bennett", "rk4"), ("three_cranks", "semi_implicit_euler")])
def test_a_loop_with_too_many_equations_runs(name: str, method: str) -> None:
    """Where rows are dropped in their given order, all but the parallelogram stop within half a second."""
    made = REDUNDANT[name]()
    run = run_of(made, 0.5, 2e-3 if method in SYMPLECTIC else 1e-3, method)
    check_closed(made[1], run, RANKS[name], 1e-14 if method in SYMPLECTIC else 1e-8)
    assert np.ptp(run.q[:, 0]) >= 0.3
    assert np.ptp(run.energy) <= ENERGY.get(method, SYMPLECTIC_ENERGY)


@pytest.mark.slow(quick="test_a_loop_with_too_many_equations_runs")
@pytest.mark.parametrize(("name", "method"), PAIRS)
def test_a_loop_with_too_many_equations_runs_for_ten_seconds(name: str, method: str) -> None:
    """Of the symplectic methods, whose steps are solved one by one, one pair does, and the others run for 1 s:
    ``benchmarks/converge.py --only loops`` runs all of them for 10 s.
    """
    runs_on(name, method, 10.0 if method in ORDERS or (name, method) == ("bennett", "stormer_verlet") else 1.0)


def runs_on(name: str, method: str, time: float) -> float:
    """The largest error of the energy [J] of a run that stays closed."""
    made = REDUNDANT[name]()
    run = run_of(made, time, 4e-3 if method in SYMPLECTIC else 1e-3, method)
    check_closed(made[1], run, RANKS[name], 1e-13 if method in SYMPLECTIC else 1e-8)
    off = abs(run.energy - run.energy[0])
    assert off.max() <= ENERGY.get(method, SYMPLECTIC_ENERGY)
    assert np.ptp(run.q[:, 0]) >= 0.3
    if method in SYMPLECTIC and time >= 10.0:
        assert off.max() <= 1.1 * off[: len(off) // 2].max()
    return float(off.max())


def accelerated(held: sd.Constraints, q: Array, v: Array) -> Array:
    """The acceleration by a pseudo-inverse of Delassus' matrix: the oracle."""
    model = held.model
    J, free, inverse = sd.constraint_jacobian(model, held, q), sd.aba(model, q, v, 0.0 * v), sd.minverse(model, q)
    missed = J @ free + sd.constraint_drift(model, held, q, v)
    made: Array = free - inverse @ J.T @ (np.linalg.pinv(J @ inverse @ J.T, rcond=1e-9) @ missed)
    return made


def by_pseudo_inverse(made: Made, time: float, dt: float) -> tuple[Array, Array]:
    """q and the energies of rk4 with that acceleration, projected in the same metric after each step."""
    model, held, q, v = made

    def rates(q: Array, v: Array) -> Array:
        return np.stack([v, accelerated(held, q, v)])

    energies = []
    for _ in range(round(time / dt)):
        a = rates(q, v)
        b = rates(*([q, v] + 0.5 * dt * a))
        c = rates(*([q, v] + 0.5 * dt * b))
        d = rates(*([q, v] + dt * c))
        q, v = [q, v] + dt / 6.0 * (a + 2.0 * (b + c) + d)
        for _ in range(2):
            J, inverse = sd.constraint_jacobian(model, held, q), sd.minverse(model, q)
            back = inverse @ J.T @ np.linalg.pinv(J @ inverse @ J.T, rcond=1e-9)
            q = q - back @ sd.constraint_error(model, held, q)
        J, inverse = sd.constraint_jacobian(model, held, q), sd.minverse(model, q)
        v = v - inverse @ J.T @ (np.linalg.pinv(J @ inverse @ J.T, rcond=1e-9) @ (J @ v))
        energies.append(sd.kinetic_energy(model, q, v) + sd.potential_energy(model, q))
    return q, np.array(energies)


@pytest.mark.parametrize(
    ("name", "time"), slow_but([("three_cranks", 0.3)], [("three_cranks", 0.3), *((x, 0.8) for x in REDUNDANT)])
)
def test_a_run_moves_as_one_by_a_pseudo_inverse(name: str, time: float) -> None:
    """The two take the same steps, and lose the same energy; ``benchmarks/converge.py --only loops`` has 4 s."""
    moves_as_one(name, time)


def moves_as_one(name: str, time: float) -> float:
    """What the run's energy varies by [J]."""
    made = REDUNDANT[name]()
    wanted, energies = by_pseudo_inverse(made, time, 1e-3)
    run = run_of(made, time, 1e-3, "rk4")
    assert abs(run.q[-1] - wanted).max() <= 1e-8
    assert np.ptp(run.energy) <= 1.1 * np.ptp(energies) + 1e-11
    return float(np.ptp(run.energy))


@pytest.mark.parametrize(
    ("name", "method"),
    slow_but([("three_cranks", "velocity_verlet"), ("bennett", "rk4")], [x for x in PAIRS if x[1] in ORDERS]),
)
def test_methods_keep_their_order(name: str, method: str) -> None:
    made, order = REDUNDANT[name](), ORDERS[method]
    exact = run_of(made, 0.4, 5e-4, "rk4").q[-1]
    h = 8e-3 if order == 4 else 1e-3
    errors = [abs(run_of(made, 0.4, x, method).q[-1] - exact).max() for x in (h, 0.5 * h)]
    assert errors[0] / errors[1] == pytest.approx(2.0**order, rel=0.25)


@pytest.mark.parametrize("name", slow_but(["three_cranks"], REDUNDANT))
def test_a_rollout_is_so_many_simulations(name: str) -> None:
    """Lanes run as one sample alone, bit by bit, whatever runs beside it; a program and its calls agree."""
    model, held, q, v = REDUNDANT[name]()
    scene = sd.Scene(model, constraints=held)
    run = sd.simulate(scene, q, v, 0.2, 1e-3, "rk4")
    starts = run.q[:: len(run.q) // 5], run.v[:: len(run.q) // 5]
    for method in ("rk4", "semi_implicit_euler"):
        all_of = sd.rollout(scene, *starts, dt=1e-3, steps=50, method=method)
        for k in range(len(starts[0])):
            alone = sd.rollout(scene, starts[0][k : k + 1], starts[1][k : k + 1], dt=1e-3, steps=50, method=method)
            np.testing.assert_array_equal(all_of.q[k], alone.q[0])
        wanted = sd.simulate(scene, q, v, 0.05, 1e-3, method, torque=lambda t, q, v: 0.0 * v)
        assert abs(all_of.q[0] - wanted.q[1:]).max() <= 1e-11


@pytest.mark.parametrize("time", [0.05, 0.2])
def test_stabilized_loops_run_too(time: float) -> None:
    for made in (bennett(), three_cranks()):
        run = run_of(made, 0.5, 1e-3, "rk4", stabilization=time)
        wanted = run_of(made, 0.5, 1e-3, "rk4")
        assert abs(run.q[-1] - wanted.q[-1]).max() <= 1e-6
        assert abs(sd.constraint_error(made[0], made[1], run.q)).max() <= 1e-7


# --- branch points --------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", slow_but(["rk4", "semi_implicit_euler", "variational"], METHODS))
def test_a_slider_crank_of_equal_lengths_goes_through_its_branch_point(method: str) -> None:
    """It goes on smoothly, the slider through the crank's pivot at x = 2 r cos θ."""
    made = slider_crank()
    run = run_of(made, 0.6, 5e-3, method)
    names = [joint.name for joint in made[0].joints[1:]]
    theta, x = run.q[:, names.index("crank_joint")], run.q[:, names.index("slider_joint")]
    assert theta[0] < np.pi / 2 < theta[-1] - 0.1
    assert abs(x - 0.6 * np.cos(theta)).max() <= (1e-7 if method in ("rk4", *SYMPLECTIC) else 1e-6)


def test_a_step_that_fails_near_a_branch_point_says_so() -> None:
    """Delassus' matrix has eigenvalues far apart there, and not a quarter of a turn before."""
    model, held, q, _ = slider_crank()
    effect = Constrained(held, None, np.array([2]))
    near = slider_crank(np.pi / 2 - 0.01)[2]
    raise_if_branching(effect, model, q, np.ones(2))
    with pytest.raises(sd.ConstraintError, match=r"pin nearly lose rank, 2 at the beginning: .* near a branch point"):
        raise_if_branching(effect, model, near, np.ones(2))


def test_equations_that_stay_open_after_a_projection_are_named() -> None:
    """A projection leaves the square of what it closes: what it leaves otherwise, no position closes."""
    model, held, *_ = three_cranks()
    effect = Constrained(held, None, np.array([3]))
    at, before = Computed(model, {"chosen": np.array([1.0, 1.0, 1.0, 0.0])}), np.full(4, 1e-3)
    at.begin(System(*(None,) * 9, np.zeros(3)), 0.0)
    effect.judge_closed(at, before, np.array([1e-6, 1e-6, 1e-6, 9e-5]))
    with pytest.raises(sd.ConstraintError, match=r"^pin2 y contradicts the other .*: 3 of 4 .* stay open by 0\.0002 m"):
        effect.judge_closed(at, before, np.array([1e-6, 1e-6, 1e-6, 2e-4]))
    assert model.nv == 4


def test_bennetts_loop_runs_on_dry_joints() -> None:
    """Its rows are chosen beside impulses too: in their order, a small early pivot stops it at 0.3 s."""
    model, held, q, v = bennett()
    scene = sd.Scene(model, constraints=held, friction=sd.Friction(0.02, 0.01))
    run = sd.rollout(scene, q, v, dt=1e-3, steps=10_000, record=100)
    energy = sd.kinetic_energy(model, run.q, run.v) + sd.potential_energy(model, run.q)
    assert abs(sd.constraint_error(model, held, run.q)).max() <= 1e-9
    assert (np.diff(energy) <= 1e-6).all()
    assert abs(run.v[-1]).max() == 0.0  # it comes to rest
