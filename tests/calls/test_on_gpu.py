"""Programs on a device: every option of ``specialize``, arrays of each library, odd samples, what is refused.

The device is a grid of threads on the host; ``engines/programs/gpu/test_cuda.py`` runs the same through a driver.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from trees import random_tree

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.polynomials import MAX_ANGLE
from spatialdyn.engines.programs.gpu.device import HostGrid
from spatialdyn.engines.programs.llvm import host_cpu
from spatialdyn.errors import InertiaError, ShapeError, SpatialDynError

Array = NDArray[Any]
GRID: Any = HostGrid()
B = 150
pytestmark = [
    pytest.mark.skipif(not host_cpu.host()[3], reason="lanes without fused multiply-add round otherwise"),
    pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: there are no programs"),
]


@pytest.fixture(scope="module")
def model() -> sd.Model:
    """A plane arm."""
    return sd.load_urdf("two_link")


def states(count: int, shape: tuple[int, ...] = (B, 2), dtype: Any = np.float64) -> list[Array]:
    """Random arrays."""
    return [x.astype(dtype) for x in np.random.default_rng(3).normal(size=(count, *shape))]


LIBRARIES = ["numpy", "torch", "jax"]


def maker(name: str) -> Callable[[Array], Any]:
    """What makes arrays of a library, skipped where it is not installed."""
    module = pytest.importorskip(name)
    makers: dict[str, Callable[[Array], Any]] = {
        "numpy": np.array,
        "torch": lambda x: module.from_numpy(np.array(x)),
        "jax": lambda x: module.numpy.array(x),
    }
    return makers[name]


def same(model: sd.Model, calls: Any, given: list[Array], **options: Any) -> None:
    """A program on a device against one on lanes, to the bit."""
    wanted = sd.specialize(model, calls, **options)(*given)
    found = sd.specialize(model, calls, device=GRID, **options)(*given)
    pairs = zip(found, wanted, strict=True) if isinstance(wanted, tuple) else [(found, wanted)]
    for x, y in pairs:
        assert (x.shape, x.dtype) == (y.shape, y.dtype)
        np.testing.assert_array_equal(x, y)


OPTIONS: list[tuple[Any, dict[str, Any], Any]] = [
    (sd.rnea, {"dtype": np.float32}, 3),
    ([sd.rnea, sd.crba], {}, 3),
    (sd.rnea, {"fixed": {"v": 0, "a": 0}}, 1),
    (sd.rnea, {"fixed": {"q": {"joint1": 0.3}}}, lambda: [*states(1, (B, 1)), *states(2)]),
    (sd.rnea, {"inputs": "payload"}, lambda: [*states(3), np.tile([1.0, 0, 0, 0, 1, 0, 0, 1, 0, 1.0], (B, 1))]),
    (sd.rnea, {"inputs": "gravity"}, lambda: [*states(3), np.array([0.0, 0.0, -9.0])]),
    (sd.aba, {"outputs": "joint2"}, 3),
    (sd.frame_jacobian, {"frame": "tip", "reference": "world"}, 1),
    (sd.frame_acceleration, {"frame": "tip", "classical": True}, 3),
    (sd.rnea, {"derivative": "jvp"}, 6),
    (sd.rnea, {"derivative": "vjp"}, 4),
    (sd.step, {}, lambda: [*states(3), np.full((), 1e-3)]),
    (partial(sd.step, method="rk4"), {}, lambda: [*states(3), np.full((), 1e-3)]),
]


@pytest.mark.parametrize(("calls", "options", "inputs"), OPTIONS)
def test_every_option_has_the_bits_of_lanes(model: sd.Model, calls: Any, options: Any, inputs: Any) -> None:
    given = states(inputs, dtype=options.get("dtype", np.float64)) if isinstance(inputs, int) else inputs()
    same(model, calls, given, **options)


def test_constraints_have_the_bits_of_lanes(model: sd.Model) -> None:
    held = sd.Constraints(model, [sd.PointConstraint("tip", axes="x")])
    same(model, sd.constrained_dynamics, states(3), constraints=held)


@pytest.mark.parametrize("name", LIBRARIES)
def test_results_are_of_the_library_of_the_inputs(model: sd.Model, name: str) -> None:
    make, inputs = maker(name), states(3, (3, B, 2), np.float32)
    inputs[0][1, 5, 0], inputs[1][2, 7, 1] = 2e5, np.nan
    wanted = sd.specialize(model, sd.rnea, np.float32)(*inputs)
    k = sd.specialize(model, sd.rnea, np.float32, device=GRID)
    given = [make(x) for x in inputs]
    found = k(*given)
    assert type(found) is type(given[0])
    np.testing.assert_array_equal(np.asarray(found), wanted)
    unchecked = np.asarray(k(*given, check=False))  # type: ignore[call-arg]
    odd = np.isnan(unchecked).all(axis=-1)
    assert np.argwhere(odd).tolist() == [[1, 5], [2, 7]]
    np.testing.assert_array_equal(unchecked[~odd], wanted[~odd])


def test_samples_near_the_range_of_angles_have_the_bits_of_lanes(model: sd.Model) -> None:
    q, v, a = states(3)
    q[:, 0] = MAX_ANGLE * (1.0 + np.linspace(-1e-8, 1e-8, B))
    same(model, sd.rnea, [q, v, a])


def test_quaternions_and_pairs_have_the_bits_of_lanes() -> None:
    tree = random_tree(seed=3, n_joints=2, kinds=["spherical", "continuous"], floating=True, continuous="cos_sin").model
    rng = np.random.default_rng(0)
    q, v, a = sd.random_configuration(tree, rng, (B,)), *rng.normal(size=(2, B, tree.nv))
    q[4] *= 1.0 + 1e-5
    k = sd.specialize(tree, sd.rnea, device=GRID)
    with pytest.raises(sd.ConfigurationError, match="sample 4"):
        k(q, v, a)
    same(tree, sd.rnea, [np.delete(q, 4, 0), np.delete(v, 4, 0), np.delete(a, 4, 0)])


def test_errors_of_values_name_the_sample_of_the_batch(model: sd.Model) -> None:
    lanes, k = (
        sd.specialize(model, sd.aba, inputs=["mass:joint2", "inertia:joint2"], device=where) for where in ("cpu", GRID)
    )
    inputs = [*states(3), np.ones(B), np.tile([1.0, 0.0, 0.0, 1.0, 0.0, 1.0], (B, 1))]
    np.testing.assert_array_equal(k(*inputs), lanes(*inputs))
    inputs[3][77], inputs[4][77] = 0.0, 0.0
    with pytest.raises(InertiaError) as wanted:
        lanes(*inputs)
    with pytest.raises(InertiaError, match="sample 77") as found:
        k(*inputs)
    assert str(found.value) == str(wanted.value)
    assert np.argwhere(np.isnan(k(*inputs, check=False)).all(axis=1)).tolist() == [[77]]  # type: ignore[call-arg]


def test_a_robot_whose_joint_never_has_inertia_has_no_program() -> None:
    light = sd.ModelBuilder("light").add_body("a", None, "revolute", (0, 0, 1)).build()
    with pytest.raises(InertiaError, match="expected none for a program"):
        sd.specialize(light, sd.aba, device=GRID)


@pytest.mark.parametrize("shape", [(), (1,), (0,), (4, 5)])
def test_every_batch_shape_is_served(model: sd.Model, shape: tuple[int, ...]) -> None:
    q, v, a = states(3, (*shape, 2))
    k = sd.specialize(model, sd.crba, device=GRID)
    found = k(q)
    assert found.shape == (*shape, 2, 2)
    np.testing.assert_array_equal(found, sd.specialize(model, sd.crba)(q))
    k = sd.specialize(model, sd.rnea, device=GRID)
    np.testing.assert_array_equal(k(q, v[(0,) * len(shape)] if 0 not in shape else np.ones(2), a).shape, q.shape)


def test_rows_may_lie_apart_and_be_shared(model: sd.Model) -> None:
    q, v, a = states(3, (2 * B, 5))
    k, lanes = sd.specialize(model, sd.rnea, device=GRID), sd.specialize(model, sd.rnea)
    given = q[::2, 1:3], v[::-1][:B, 2:4], a[7, :2]
    np.testing.assert_array_equal(k(*given), lanes(*given))
    for x, words in (
        (q[:B, ::2][:, :2], "numbers of a sample side by side"),
        (q.reshape(4, 75, 5)[:, ::2, :2], "rows that lie one stride apart"),
    ):
        with pytest.raises(ShapeError, match=f"q has strides .*, expected {words}|q has strides .*{words}"):
            k(x, np.ones(2), np.ones(2))
    with pytest.raises(ShapeError, match=r"v has shape \(1, 5, 2\), expected all of the batch shape \(4, 5\), or none"):
        k(np.ones((4, 5, 2)), np.ones((1, 5, 2)), np.ones(2))


def test_results_are_written_where_they_are_asked_for(model: sd.Model) -> None:
    torch = pytest.importorskip("torch")
    inputs = [torch.from_numpy(x) for x in states(3)]
    inputs[0][3, 0] = 2e5
    k = sd.specialize(model, [sd.rnea, sd.crba], device=GRID)
    out = torch.empty(B, 2, dtype=torch.float64), torch.empty(B, 2, 2, dtype=torch.float64)
    found = k(*inputs, out=out)
    assert all(x is y for x, y in zip(found, out, strict=True))
    wanted = sd.specialize(model, [sd.rnea, sd.crba])(*(x.numpy() for x in inputs))
    for x, y in zip(out, wanted, strict=True):
        np.testing.assert_array_equal(x, y)
    for wrong, words in (
        ((out[0],), "expected a tuple of 2 arrays"),
        ((out[0].float(), out[1]), "expected an array of shape"),
        ((inputs[0], out[1]), "out overlaps q in memory"),
        ((out[0], out[1].transpose(1, 2)), "out is not an array in C order"),
        ((out[1].view(-1)[: 2 * B].view(B, 2), out[1]), "out overlaps another out in memory"),
    ):
        with pytest.raises(ShapeError, match=words):
            k(*inputs, out=wrong)


def test_what_runs_on_the_cpu_alone_is_refused_by_name(model: sd.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    inputs = states(3)
    with pytest.raises(SpatialDynError, match='device is \'gpu\', expected "cpu" or "cuda"'):
        sd.specialize(model, sd.rnea, device="gpu")
    with pytest.raises(SpatialDynError, match=r'tolerance is 1e-06 with device="cuda", expected None'):
        sd.specialize(model, sd.rnea, tolerance=1e-6, device="cuda")
    k = sd.specialize(model, sd.rnea, device="cuda")
    with pytest.raises(ShapeError, match=r"q is a ndarray in the memory of the CPU, expected one on a GPU"):
        k(*inputs)
    k = sd.specialize(model, sd.rnea, device=GRID)
    with pytest.raises(ShapeError, match="v has dtype float32, expected float64, that of the program"):
        k(inputs[0], inputs[1].astype(np.float32), inputs[2])
    with pytest.raises(ShapeError, match=r"q has shape \(150, 3\), expected \(\.\.\., 2\)"):
        k(np.ones((B, 3)), *inputs[1:])
    with pytest.raises(TypeError, match="2 inputs were given, expected 3"):
        k(*inputs[:2])
    with pytest.raises(SpatialDynError, match="check is 1, expected True or False"):
        k(*inputs, check=1)  # type: ignore[call-arg]
    monkeypatch.setattr(numba_kernels, "PLAIN", True)
    with pytest.raises(SpatialDynError, match=r'rnea of "two_link" has no program in float64, expected one for device'):
        sd.specialize(model, sd.rnea, device="cuda")


def test_ptx_is_made_without_a_gpu_and_the_rest_is_as_on_the_cpu(model: sd.Model) -> None:
    k = sd.specialize(model, sd.rnea, device="cuda")
    assert ".entry kernel" in k.ptx
    cpu = sd.specialize(model, sd.rnea)
    assert cpu.ptx == k.ptx
    assert (k.engine, k.signature, k.operations) == ("cuda", cpu.signature, cpu.operations)
    assert k.c_code() == cpu.c_code()
    again = pickle.loads(pickle.dumps(k))
    assert again.engine == "cuda"
    assert repr(k).endswith("float64, cuda>")


def test_a_program_on_a_device_has_derivatives_in_other_frameworks(model: sd.Model) -> None:
    jax = pytest.importorskip("jax")
    q = np.float32([0.3, 0.1])
    made = [sd.specialize(model, sd.generalized_gravity, device=where).to_jax() for where in ("cpu", "cuda")]
    first, second = (np.asarray(jax.jacrev(f)(q)) for f in made)
    np.testing.assert_array_equal(first, second)
