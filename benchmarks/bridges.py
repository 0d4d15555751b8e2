"""Times of a program through JAX, PyTorch and CasADi beside the same native call, correct first.

    python benchmarks/bridges.py
    python benchmarks/bridges.py --robot ur5 --call rnea --batch 4096 --rounds 30

For one sample and a batch: the call, and a call with the gradient of a weighted sum of its results. Before a time is
taken, values must be the native call's to the last bit, gradients the analytic ones to 1e-10 of the largest entry, and
CasADi's Jacobian those of ``sd.NAME_derivatives``. Contestants are interleaved; each figure is a median of rounds on
one thread, in µs, with the ratio to the native call. Of CasADi it counts the instructions of the Jacobian that
``factory`` makes and of a Hessian by all inputs, with its own derivatives beside them, and times the Hessians.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from measure import interleaved

import spatialdyn as sd

CLOSE = 1e-10


def contestants(model: sd.Model, call: Any, n: int, rng: np.random.Generator) -> dict[str, Any]:
    """The call of n samples, or of one for 0, by each way, checked."""
    import jax
    import torch

    k, lead = sd.specialize(model, call), (n,) if n else ()
    q, v, x = sd.random_configuration(model, rng, lead), *rng.standard_normal((2, *lead, model.nv))
    weights = rng.standard_normal((*lead, model.nv))
    native, by = k(q, v, x), getattr(sd, call.__name__ + "_derivatives")(model, q, v, x)
    by = np.moveaxis(np.asarray(by), 0 if isinstance(by, tuple) else -3, 0)
    slopes = np.einsum("...i,p...ij->p...j", weights, by)
    f, arrays = k.to_jax(), [jax.numpy.asarray(a) for a in (q, v, x)]
    slope = jax.jit(jax.value_and_grad(lambda *a: (weights * f(*a)).sum(), argnums=(0, 1, 2)))
    g, tensors = k.to_torch(), [torch.tensor(a) for a in (q, v, x)]
    moved, seeds = [a.clone().requires_grad_() for a in tensors], torch.tensor(weights)
    vjp = sd.specialize(model, call, derivative="vjp")

    def backward() -> Any:
        return torch.autograd.grad(g(*moved), moved, seeds)

    for name, found in {"JAX": f(*arrays), "torch": g(*tensors)}.items():
        assert np.array_equal(np.asarray(found), native), name
    for name, found in {"JAX": slope(*arrays)[1], "torch": backward(), "vjp": vjp(q, v, x, weights)[1:]}.items():
        assert abs(np.asarray(np.stack(list(map(np.asarray, found)))) - slopes).max() <= CLOSE * abs(slopes).max(), name
    return {
        "native": lambda: k(q, v, x),
        "JAX": lambda: f(*arrays).block_until_ready(),
        "torch": lambda: g(*tensors),
        "native, vjp": lambda: vjp(q, v, x, weights),
        "JAX, with gradient": lambda: jax.block_until_ready(slope(*arrays)),
        "torch, with gradient": backward,
    }


def instructions(f: Any) -> int:
    """The instructions of a function of CasADi and of all that it calls."""
    import casadi

    total = f.n_instructions()
    for k in range(total) if f.class_name() == "MXFunction" else ():
        if f.instruction_id(k) == casadi.OP_CALL:
            total += instructions(f.instruction_MX(k).which_function())
    return int(total)


def of_casadi(model: sd.Model, call: Any, rng: np.random.Generator, rounds: int) -> None:
    """Print instructions of the Jacobian and Hessian, by our programs and by CasADi's own, and times of the Hessian."""
    import casadi

    k = sd.specialize(model, call)
    state = sd.random_configuration(model, rng), *rng.standard_normal((2, model.nv))
    weights, made = rng.standard_normal(model.nv), {}
    sizes = [x.size for x in state]
    at, ends = np.concatenate(state), np.cumsum([0, *sizes]).tolist()
    for name, own in {"our derivatives": True, "CasADi's": False}.items():
        f = k.to_casadi(jacobian=own)
        (result,), given = f.name_out(), f.name_in()
        jacobian = f.factory("jacobian", given, [f"jac:{result}:{x}" for x in given])
        x = casadi.MX.sym("x", at.size)
        y = casadi.hessian(casadi.dot(weights, f(*casadi.vertsplit(x, ends))), x)[0]
        made[name] = jacobian, casadi.Function("hessian", [x], [y])
    times = interleaved({name: lambda f=f: f(at) for name, (_, f) in made.items()}, rounds, 0.01)
    for name, (jacobian, hessian) in made.items():
        print(f"CasADi with {name:16} Jacobian {instructions(jacobian):8} instructions, Hessian "
              f"{instructions(hessian):8} in {1e6 * times[name]:8.1f} µs")  # fmt: skip
    wanted = getattr(sd, call.__name__ + "_derivatives")(model, *state)
    for jacobian, _ in made.values():
        for one, other in zip(jacobian(*state), wanted, strict=True):
            assert abs(np.asarray(one) - other).max() <= CLOSE * abs(other).max()
    second, same = (np.asarray(hessian(at)) for _, hessian in made.values())
    assert abs(second - same).max() <= CLOSE * abs(same).max()


def main() -> None:
    """Read the arguments and print the times."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", default="panda", help="path of a URDF, or the name of a robot (panda)")
    parser.add_argument("--call", default="aba", choices=("aba", "rnea"), help="the call (aba)")
    parser.add_argument("--batch", type=int, default=4096, help="samples of the batch (4096)")
    parser.add_argument("--rounds", type=int, default=15, help="rounds of each measurement (15)")
    given = parser.parse_args()
    import jax

    jax.config.update("jax_enable_x64", True)
    sd.set_num_threads(1)
    model, rng, call = sd.load_urdf(given.robot), np.random.default_rng(0), getattr(sd, given.call)
    for n in (0, given.batch):
        times = interleaved(contestants(model, call, n, rng), given.rounds, 0.02)
        print(f'{given.call} of "{model.name}", {n or 1} sample{"s" if n else ""}, one thread:')
        for name, seconds in times.items():
            print(f"  {name:22} {1e6 * seconds:9.2f} µs   {seconds / times['native']:6.2f} x native")
    of_casadi(model, call, rng, given.rounds)


if __name__ == "__main__":
    main()
