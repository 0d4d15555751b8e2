"""Rollouts on a device: the bits of lanes with all that acts in a scene, or refused by name; odd samples; arrays.

The device is a grid of threads on the host, or a driver that runs one.
"""

from __future__ import annotations

import re
import warnings
from typing import Any

import fake_gpu
import numpy as np
import pytest
import scenes
from combinations import LAW, PARTS, case, sets, start
from numpy.typing import NDArray

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.programs.gpu.device import HostGrid
from spatialdyn.engines.programs.llvm import host_cpu
from spatialdyn.recursions.spec import TAU, Argument, Q, Spec
from spatialdyn.simulation.methods.methods import EXPLICIT_METHODS
from spatialdyn.simulation.plan import Plan

Array = NDArray[Any]
GRID: Any = HostGrid()
DT, B, T = 1e-3, 133, 6
REFUSED = (  # what runs on the CPU alone
    r'record has "contacts" with device="cuda"',
    r'method is "\w+" with device="cuda", expected one of ',
    r"holds .*, expected the range of float32, or dtype float64, with device",
)
pytestmark = [
    pytest.mark.skipif(not host_cpu.host()[3], reason="lanes without fused multiply-add round otherwise"),
    pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: there are no programs"),
]


def same(found: sd.Rollout, wanted: sd.Rollout) -> None:
    """Equal to the bit."""
    assert [*found.states] == [*wanted.states]
    pairs = [(found.q, wanted.q), (found.v, wanted.v), (found.t, wanted.t)]
    for x, y in [*pairs, *((found.states[name], wanted.states[name]) for name in wanted.states)]:
        x = np.asarray(x.x if isinstance(x, fake_gpu.Array) else x)
        assert (x.shape, x.dtype) == (y.shape, y.dtype)
        np.testing.assert_array_equal(x, y)


def attempt(*args: Any, **given: Any) -> Any:
    """A rollout, or the text of the error."""
    try:
        return sd.rollout(*args, **given)
    except sd.SpatialDynError as error:
        return str(error)


def both(*args: Any, **given: Any) -> str:
    """The same rollout, or the same error, on lanes and on a device; the text of what refuses it there alone, or ""."""
    wanted, found = attempt(*args, **given), attempt(*args, **given, device=GRID)
    if isinstance(found, str):
        return "" if found == wanted else found
    same(found, wanted)
    return ""


def check(name: str, chosen: list[tuple[str, ...]], dtypes: tuple[Any, ...] = (np.float64, np.float32)) -> None:
    """Each set of effects on one robot, by one of the dtypes in turn."""
    wrong = []
    for k, effects in enumerate(chosen):
        try:
            model, given = case(name, effects)
            scene, rest = scenes.split(model, given)
        except (sd.ModelError, sd.SimulationError):  # for a reason of physics
            continue
        rest.pop("record", None)  # of work, which simulate records
        q, v = start(model)
        dtype = dtypes[k % len(dtypes)]
        states = np.stack([q, q, q]).astype(dtype), np.stack([v, 1.1 * v, 0.9 * v]).astype(dtype)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            reason = both(scene, *states, dt=DT, steps=3, dtype=dtype, **rest)
        if reason and not any(re.search(x, reason) for x in REFUSED):
            wrong.append((effects, dtype.__name__, reason))
    assert wrong == []


QUICK = [
    (),
    ("friction",),
    ("lugre",),
    ("current",),
    ("fext",),
    ("springs",),
    ("control",),
    ("couplers",),
    ("contacts",),
]


def test_each_effect_has_the_bits_of_lanes() -> None:
    check("arm", QUICK, (np.float64,))


@pytest.mark.slow(quick="test_each_effect_has_the_bits_of_lanes")
@pytest.mark.parametrize("name", PARTS)
def test_pairs_of_effects_have_the_bits_of_lanes_or_are_refused(name: str) -> None:
    """Each pair on one of the robots."""
    check(name, list(sets(2))[PARTS.index(name) :: len(PARTS)])


@pytest.fixture(scope="module")
def model() -> sd.Model:
    """A plane arm."""
    return sd.load_urdf("two_link")


def motion(seed: int = 0, dtype: Any = np.float64) -> list[Array]:
    """q0, v0 and tau of some samples."""
    rng = np.random.default_rng(seed)
    return [x.astype(dtype) for x in (*rng.normal(size=(2, B, 2)), rng.normal(size=(B, T, 2)))]


@pytest.mark.parametrize("method", EXPLICIT_METHODS)
def test_every_explicit_method_has_the_bits_of_lanes(model: sd.Model, method: str) -> None:
    assert both(model, *motion(), dt=DT, method=method) == ""


def test_other_methods_are_refused(model: sd.Model) -> None:
    for method in sorted({*sd.integrators} - {*EXPLICIT_METHODS}):
        with pytest.raises(sd.SimulationError, match=REFUSED[1]):
            sd.rollout(model, *motion(), dt=DT, method=method, device=GRID)


def _effort(bodies: Any, q: Any, tau: Any, goal: Any, cost: Any) -> None:
    cost[0] = sum((x - y) * (x - y) + 1e-3 * t * t for x, y, t in zip(q, goal, tau, strict=True))


COST = Argument("cost", (1,), "", "of a step")
GOAL = Argument("goal", ("nq",), "rad", "where to go")
EFFORT = sd.Cost(Spec("effort", _effort, None, (Q, TAU, GOAL), COST, "", ""), {"goal": [0.5, 0.2]})
PAST = sd.Control(LAW, {"reach": np.zeros(2)})
HOLD = sd.PD(kp=[40.0, 40.0], kd=[8.0, 8.0], q_ref=[0.5, 0.0])


@pytest.mark.parametrize(
    "given",
    [
        {"record": 4}, {"record": "last"}, {"record": 9}, {"dtype": np.float32}, {"control": HOLD},
        {"control": HOLD, "dtype": np.float32, "record": 2},
        {"control": sd.PD(kp=[40.0, 40.0], kd=[8.0, 8.0], q_ref=np.random.default_rng(1).normal(size=(B, 1, 2)))},
        {"control": sd.PD(kp=[40.0, 40.0], kd=[8.0, 8.0], q_ref=np.random.default_rng(2).normal(size=(T, 2)))},
        {"cost": EFFORT}, {"cost": EFFORT, "control": HOLD, "record": 2},
        {"states": {"past": [0.1, -0.2]}, "control": PAST},
    ],
)  # fmt: skip
def test_records_laws_and_costs_have_the_bits_of_lanes(model: sd.Model, given: dict[str, Any]) -> None:
    assert both(model, *motion(dtype=given.get("dtype", np.float64)), dt=DT, **given) == ""


def test_inputs_may_be_shared_by_samples_and_steps(model: sd.Model) -> None:
    q0, v0, tau = motion()
    for shared in (tau[0], tau[0, 0], tau[:1], tau[:, :1], None):
        assert both(model, q0, v0, shared, dt=DT, steps=T) == ""
    assert both(model, q0[0], v0, dt=DT, steps=T) == ""
    assert both(model, q0[0], v0[0], tau[0], dt=DT) == ""  # a single start
    assert both(model, q0[:0], v0[:0], dt=DT, steps=T) == ""
    assert both(model, q0, v0, dt=DT, steps=0) == ""
    assert both(model, q0, v0, dt=DT, steps=0, record="last") == ""
    wide = np.random.default_rng(3).normal(size=(2 * B, 2 * T, 5))
    given = wide[::2, 0, 1:3], wide[1::2, 1, 2:4], wide[::2, ::2, 3:5]
    same(sd.rollout(model, *given, dt=DT, device=GRID), sd.rollout(model, *given, dt=DT))


def test_forces_that_vary_are_added_to_those_of_the_scene(model: sd.Model) -> None:
    q0, v0, _ = motion()
    rng = np.random.default_rng(4)
    own, varied = rng.normal(size=(model.njoints, 6)), rng.normal(size=(B, T, model.njoints, 6))
    for scene in (model, sd.Scene(model, fext=own)):
        for fext in (varied, varied[0], varied[:, :1]):
            assert both(scene, q0, v0, dt=DT, steps=T, fext=fext) == ""


def test_odd_samples_are_run_on_the_cpu(model: sd.Model) -> None:
    q0, v0, tau = motion()
    q0[5, 0], q0[9, 1], tau[11, 3, 0], v0[100, 0] = 3e5, np.nan, np.nan, 1e200
    found = sd.rollout(model, q0, v0, tau, dt=DT, check=False, device=GRID)
    same(found, sd.rollout(model, q0, v0, tau, dt=DT, check=False))
    assert np.flatnonzero(np.isnan(found.q).any(axis=(1, 2))).tolist() == [9, 11, 100]
    assert both(model, q0, v0, tau, dt=DT) == ""  # the same error
    with pytest.raises(sd.SimulationError, match=r"^sample 9: q0 is .* \(3 samples in all\); check=False lets it"):
        sd.rollout(model, q0, v0, tau, dt=DT, device=GRID)
    fext = np.zeros((B, T, model.njoints, 6))
    q0, v0, _ = motion()
    q0[7, 0], fext[:, :, -1, 2] = 2e5, 1.0
    assert both(model, q0, v0, dt=DT, steps=T, fext=fext) == ""
    fext[7, 2, 1, 1] = np.nan
    assert both(model, q0, v0, dt=DT, steps=T, fext=fext) == ""


def test_friction_that_is_not_solved_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    model, given = case("arm", ("friction",))
    scene, rest = scenes.split(model, given)
    q, v = start(model)
    monkeypatch.setattr(Plan, "failure", lambda *given: "not solved")
    assert both(scene, np.stack([q, q]), v, dt=DT, steps=3, **rest) == ""
    with pytest.raises(sd.SimulationError, match="sample 0: not solved"):
        sd.rollout(scene, np.stack([q, q]), np.stack([v, v]), dt=DT, steps=3, device=GRID, **rest)


def test_what_runs_on_the_cpu_alone_is_refused_by_name(model: sd.Model) -> None:
    q0, v0, tau = motion()
    with pytest.raises(sd.SpatialDynError, match="device is 'gpu', expected"):
        sd.rollout(model, q0, v0, tau, dt=DT, device="gpu")
    with pytest.raises(sd.ShapeError, match=r'q0 is a ndarray in the memory of the CPU, .* as device="cuda" says'):
        sd.rollout(model, q0, v0, tau, dt=DT, device="cuda")
    with pytest.raises(sd.ShapeError, match="tau has dtype float64, expected float32, that of the rollout"):
        sd.rollout(model, *motion(dtype=np.float32)[:2], tau, dt=DT, dtype=np.float32, device=GRID)
    with pytest.raises(sd.ShapeError, match=r"v0 has strides .*, expected the numbers of a sample side by side"):
        sd.rollout(model, q0, np.ones((B, 4))[:, ::2], tau, dt=DT, device=GRID)
    with pytest.raises(sd.ShapeError, match=r"tau has shape \(133, 6, 1\), expected"):
        sd.rollout(model, q0, v0, tau[..., :1], dt=DT, device=GRID)
    scene = sd.Scene(model, contacts=sd.Contacts(model, {"tip": 0.02}, terrain=sd.Plane(height=-9.0)))
    with pytest.raises(sd.SimulationError, match=REFUSED[0]):
        sd.rollout(scene, np.zeros((3, 2)), np.zeros((3, 2)), dt=DT, steps=2, record="contacts", device=GRID)


def test_a_rollout_through_the_driver_has_the_bits_of_lanes(model: sd.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    driver, given = fake_gpu.install(monkeypatch), motion()
    given[0][3, 0] = 2e5
    found = sd.rollout(model, *map(fake_gpu.Array, given), dt=DT, control=HOLD, device="cuda")
    same(found, sd.rollout(model, *given, dt=DT, control=HOLD))
    assert isinstance(found.q, fake_gpu.Array)
    assert len(driver.launches) == 1
