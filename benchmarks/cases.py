"""The measured robots, their samples and calls, and the library's contestants.

A ``Case`` is a robot with its samples. A ``Contestant`` runs one call of a case once or over the batch; its results,
one flat row per sample in the library's conventions, are compared with Pinocchio's before it is timed.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numba
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import spatialdyn as sd
from spatialdyn.urdf.load import find_robot

Array = NDArray[np.float64]

ROBOTS = {  # name: (argument of load_urdf, root)
    "2R": ("two_link", "fixed"),
    "ur5": ("ur5", "fixed"),
    "panda": ("panda", "fixed"),
    "anymal": ("anymal", "floating"),
    "talos_full": ("talos_full", "fixed"),
    "tiago_dual": ("tiago_dual", "fixed"),
}
INSIDE = 1000  # calls of a jitted loop
SCALED = 1e-10  # of the largest entry: both sides are float64, and M may be ill-conditioned
LOOKED_AT = 100  # compared samples of a batch


class Call(NamedTuple):
    """A call: the letters of its inputs (q, v, a, and t for τ), and the public calls that compute it."""

    letters: str
    ours: tuple[str, ...]


CALLS = {
    "rnea": Call("qva", ("rnea",)),
    "crba": Call("q", ("crba",)),
    "aba": Call("qvt", ("aba",)),
    "nonlinear_effects": Call("qv", ("nonlinear_effects",)),
    "gravity": Call("q", ("generalized_gravity",)),
    "minverse": Call("q", ("minverse",)),
    "kinematics": Call("q", ("frame_placement", "frame_jacobian")),  # of the joint with the longest chain to the root
}


@dataclass(frozen=True)
class Case:
    """A robot in both libraries, with the same q, and its samples by letter."""

    name: str
    path: str
    root: str
    ours: sd.Model
    theirs: Any
    tip: str
    state: dict[str, Array]

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(self.state["q"])

    def arguments(self, call: str) -> list[Array]:
        """The inputs of a call, all samples."""
        return [self.state[letter] for letter in CALLS[call].letters]

    def one(self, call: str) -> list[Array]:
        """The inputs of a call, the first sample."""
        return [np.array(x[0]) for x in self.arguments(call)]

    def frame(self, call: str) -> dict[str, str]:
        """The further arguments of a call."""
        return {"frame": f"joint:{self.tip}"} if call == "kinematics" else {}


def load(path: str, **options: Any) -> sd.Model:
    """A Model, without the warnings about inertias, of which the corpus has many."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return sd.load_urdf(path, continuous="cos_sin", **options)


def deepest(model: sd.Model) -> str:
    """The first joint with the longest chain of joints to the root."""
    depth = [0]
    for joint in model.joints[1:]:
        depth.append(depth[joint.parent] + 1)
    return model.joints[int(np.argmax(depth))].name


def case(name: str, samples: int) -> Case:
    """A robot of ``ROBOTS`` with seeded random samples."""
    found, root = ROBOTS[name]
    path = str(find_robot(found))
    ours = load(path, root=root)
    theirs = pin.buildModelFromUrdf(path, *([pin.JointModelFreeFlyer()] if root == "floating" else []))
    assert list(theirs.names)[2:] == list(ours.names)[2:]  # a floating joint has another name
    assert (theirs.nq, theirs.nv) == (ours.nq, ours.nv)
    return Case(name, path, root, ours, theirs, deepest(ours), random_state(ours, samples))


def random_state(model: sd.Model, samples: int) -> dict[str, Array]:
    """q uniform on its manifold, the rest normal; C order."""
    rng = np.random.default_rng(0)
    return {
        "q": sd.random_configuration(model, rng, samples),
        **{letter: rng.normal(size=(samples, model.nv)) for letter in "vat"},
    }


class Contestant(NamedTuple):
    """One implementation of a call.

    single  evaluates the first sample from Python, with an allocated result; None if not applicable
    batch   evaluates the first ``count`` samples; None if not applicable
    how     of the batch: a pool of threads, a loop in Python, ...
    bare    the timed batch, if that keeps no results
    read    function of a result, samples as first axis, and sample numbers -> one flat row per sample
    """

    single: Callable[[], Any] | None
    batch: Callable[[], Any] | None
    count: int = 1
    how: str = ""
    read: Callable[[Any, Sequence[int]], Array] = lambda raw, samples: np.reshape(raw, (len(samples), -1))
    bare: Callable[[], Any] | None = None


def check(case: Case, call: str, name: str, contestant: Contestant, wanted: Array, bound: float = SCALED) -> float:
    """The largest scaled error against ``wanted``, rows of evenly spaced samples. AssertionError above the bound."""
    worst = 0.0
    at = looked_at(case)
    if contestant.single is not None:
        worst = _error(contestant.read([contestant.single()], [0]), wanted[:1])
    if contestant.batch is not None:
        raw = contestant.batch()
        inside = [k for k, i in enumerate(at) if i < contestant.count]
        few = [at[k] for k in inside]
        worst = max(worst, _error(contestant.read([raw[i] for i in few], few), wanted[inside]))
    assert worst <= bound, f"{case.name} {call}: scaled error {worst:.1e} of {name} against Pinocchio"
    return worst


def looked_at(case: Case) -> list[int]:
    """Numbers of the samples compared."""
    return list(range(0, case.samples, max(1, case.samples // LOOKED_AT)))


def _error(x: Array, wanted: Array) -> float:
    assert x.shape == wanted.shape, f"shape {x.shape}, expected {wanted.shape}"
    return float((abs(x - wanted).max(axis=1) / np.maximum(abs(wanted).max(axis=1), 1.0)).max())


# --- the library's contestants ----------------------------------------------------------------------------


def aligned(shape: tuple[int, ...], dtype: Any = np.float64) -> NDArray[Any]:
    """An array on a 64-byte boundary, as streaming stores need it, its pages mapped."""
    size = np.dtype(dtype).itemsize * int(np.prod(shape))
    raw = np.zeros(size + 64, np.uint8)
    start = -raw.ctypes.data % 64
    raw[:] = 1
    return raw[start : start + size].view(dtype).reshape(shape)


def rows(parts: Any, samples: Sequence[int]) -> Array:
    """Samples of one result, or of several side by side, as flat rows."""
    return np.array([np.concatenate([np.ravel(x) for x in _listed(part)]) for part in parts])


def _listed(part: Any) -> Sequence[Any]:
    return part if isinstance(part, (tuple, list)) else [part]


def shapes(case: Case, call: str) -> list[tuple[int, ...]]:
    """One flat row of the results of one sample."""
    n = case.ours.nv
    return {"crba": [(n, n)], "minverse": [(n, n)], "kinematics": [(4, 4), (6, n)]}.get(call, [(n,)])


def public(case: Case, call: str, threads: int = 1, fresh: bool = False) -> Contestant:
    """``sd.rnea(model, q, v, a)``: single, and batched into given arrays."""
    functions = [getattr(sd, name) for name in CALLS[call].ours]
    model, frame, one, arguments = case.ours, case.frame(call), case.one(call), case.arguments(call)
    sd.compile(model, functions, **frame)  # else what is timed may be interpreted
    outs: list[Any] = [None if fresh else aligned((case.samples, *s)) for s in shapes(case, call)]

    def single() -> Any:
        return [f(model, *one, **frame) for f in functions]

    def batch() -> Any:
        sd.set_num_threads(threads)
        return Together([f(model, *arguments, **frame, out=out) for f, out in zip(functions, outs, strict=True)])

    if len(functions) == 1 and not frame:
        function = functions[0]
        quick = {1: lambda: function(model, one[0]), 2: lambda: function(model, one[0], one[1])}
        single = quick.get(len(one), lambda: function(model, *one))
    return Contestant(single, batch, case.samples, "program on SIMD lanes", rows)


class Together:
    """Results side by side, indexed by sample."""

    def __init__(self, parts: list[Any]) -> None:
        self.parts = parts

    def __getitem__(self, i: int) -> list[Any]:
        return [x[i] for x in self.parts]


def program(case: Case, call: str, dtype: Any = np.float64) -> sd.Specialized:
    """The call as a program of its own; gravity is an rnea at rest."""
    if call == "gravity":
        return sd.specialize(case.ours, sd.rnea, dtype, fixed={"v": 0, "a": 0})
    functions = [getattr(sd, name) for name in CALLS[call].ours]
    return sd.specialize(case.ours, functions if len(functions) > 1 else functions[0], dtype, **case.frame(call))


def specialized(case: Case, call: str, dtype: Any = np.float64) -> tuple[Contestant, sd.Specialized]:
    """``k = sd.specialize(model, sd.rnea); k(q, v, a)``: single, and batched into given arrays; and k."""
    k = program(case, call, dtype)
    one = [x.astype(dtype) for x in case.one(call)]
    arguments = [x.astype(dtype) for x in case.arguments(call)]
    outs = [aligned((case.samples, *s), dtype) for s in shapes(case, call)]
    out = tuple(outs) if len(outs) > 1 else outs[0]

    def batch() -> Any:
        sd.set_num_threads(1)
        k(*arguments, out=out)
        return Together(outs)

    return Contestant(lambda: k(*one), batch, case.samples, k.engine, rows), k


def jitted(case: Case, call: str) -> Callable[[], list[Array]]:
    """A user's own jitted loop over the public kernels: ``INSIDE`` calls; returns the results."""
    outs = [np.empty(shape) for shape in shapes(case, call)]
    everything = []
    for name, out in zip(CALLS[call].ours, outs, strict=True):
        given: list[Any] = [case.ours.bodies, *case.one(call)]
        if call == "kinematics":
            frame = case.ours.frame(f"joint:{case.tip}")
            given += [case.ours.joints[frame.joint].row, frame.placement]
            given += [0] if name == "frame_jacobian" else []  # local
        everything.append((_loop(name), (*given, out)))

    def run() -> list[Array]:
        for loop, arguments in everything:
            loop(arguments, INSIDE)
        return outs

    return run


@cache
def _loop(name: str) -> Callable[..., None]:
    kernel = getattr(sd.kernels, name)

    @numba.njit(nogil=True)
    def loop(arguments, n):  # type: ignore[no-untyped-def]
        for _ in range(n):
            kernel(*arguments)

    return loop
