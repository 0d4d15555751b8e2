"""Base parameters: the combinations of inertial parameters that torques depend on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import as_word
from ..calls.dynamics import calls
from ..calls.random_configurations import random_configuration
from ..errors import IdentificationError
from ..model.model import Model
from ..waiting import watch
from .unknowns import Unknowns, floats, unknowns_of, whole_number

Array = NDArray[np.float64]
ROWS = ("all", "base")
DEPENDENT = 1e-9  # relative to the first pivot, columns of norm 1: pivots of dependent columns, with rounded angles
ROUNDED = 1e-9  # relative to the largest column: a zero column with a rounded angle of π/2 is smaller
GAP = 1e3  # least ratio of the last pivot that counts to the first that does not
STATES = 20  # rows per column
CHUNK = 1024  # states at a time


@dataclass(frozen=True, eq=False, repr=False)
class Base:
    """Base parameters β = K π, the fewest numbers with torque = W[:, columns] β for every motion.

    names    names of all parameters π, the columns of a regressor
    columns  (rank,)  indices of the parameters that the base is built on, in the order of π
    K        (rank, len(names))  for each base parameter its own column and those regrouped into it
    rank     number of base parameters
    gap      ratio of the last pivot that counts to the first that does not; infinite if all count
    """

    names: tuple[str, ...]
    columns: NDArray[np.intp]
    K: Array
    rank: int
    gap: float

    def __repr__(self) -> str:
        return f"<Base: {self.rank} of {len(self.names)} parameters, gap {self.gap:.3g}>"

    def __str__(self) -> str:
        return "\n".join(f"{self.text(k)}" for k in range(self.rank))

    def text(self, k: int) -> str:
        """Base parameter k as a sum of parameters. Raises IdentificationError for an unknown k."""
        k = whole_number("k", k, 0, self.rank - 1)
        parts = []
        first = int(self.columns[k])
        order = [first, *(int(j) for j in np.flatnonzero(self.K[k]) if j != first)]
        for j in order:
            x = float(self.K[k, j])
            size = "" if abs(abs(x) - 1.0) < 1e-12 else f"{abs(x):.6g} "
            parts.append(("- " if x < 0.0 else "+ ") + size + self.names[j])
        return " ".join(parts).removeprefix("+ ")

    @property
    def labels(self) -> tuple[str, ...]:
        """A short name for each: the parameter that it is built on, and how many are regrouped into it."""
        more = (self.K != 0.0).sum(1) - 1
        return tuple(f"{self.names[j]}{f' + {n}' if n else ''}" for j, n in zip(self.columns, more, strict=True))


@watch.call("base_parameters")
def base_parameters(
    model: Model, parameters: Any = "inertial", rows: str = "all", *, payload: str | None = None, samples: int = 0,
    seed: int = 0,
) -> Base:  # fmt: skip
    """Base parameters of a robot: the combinations of its parameters that its torques depend on.

    model       Model
    parameters  some of "inertial", "armature", "friction" ("viscous" and "coulomb"), "offset", as words or joined by +
    rows        "all" torques; or "base": the six of a floating base, which depend on the same parameters of bodies
    payload     a frame: the ten parameters are those of a load there, in the frame's axes
    samples     number of random states; 0 for 20 rows per column
    seed        seed of the states

    The method is QR with column pivoting of a regressor of random motions, with columns scaled to norm 1. Columns below
    1e-9 of the largest count as zero: a rounded π/2 in a URDF makes zero columns this large, which would add a rank.

    Returns Base: ``print`` shows it. Raises IdentificationError if the pivots have no gap of 1e3 that determines the
    rank: load the robot with ``snap=1e-9``; ModelError, SpatialDynError for arguments.
    Source  Gautier, Numerical calculation of the base inertial parameters of robots (1991).

    >>> import spatialdyn as sd
    >>> base = sd.base_parameters(sd.load_urdf("two_link"))
    >>> base.rank, len(base.names)
    (6, 20)
    """
    unknowns = unknowns_of(model, parameters, payload)
    as_word("rows", rows, ROWS)
    if rows == "base" and not floats(model):
        raise IdentificationError(f'rows is "base", expected "all": robot "{model.name}" has no floating base')
    n, start = whole_number("samples", samples, 0), whole_number("seed", seed, 0)
    least = -(-len(unknowns.names) // (6 if rows == "base" else model.nv))
    if 0 < n < least:
        raise IdentificationError(f"samples is {n}, expected 0, or {least} or more: a row of each column")
    return base_of_columns(factor_of_random_motions(unknowns, rows, n, start), unknowns.names)


@lru_cache(maxsize=16)
def structural_base(model: Model, parameters: tuple[str, ...], payload: str | None, bodies: Any, rows: str) -> Base:
    """``base_parameters`` for an identification, cached: they depend on the model alone."""
    unknowns = unknowns_of(model, parameters, payload, bodies)
    return base_of_columns(factor_of_random_motions(unknowns, rows, 0, 0), unknowns.names)


def factor_of_random_motions(unknowns: Unknowns, rows: str, samples: int, seed: int) -> Array:
    """R (count, count) of a regressor of random states, by QR of chunks."""
    model, count = unknowns.model, len(unknowns.names)
    height = 6 if rows == "base" else model.nv
    wanted = samples or -(-STATES * count // height)
    R: Array = np.zeros((0, count))
    rng = np.random.default_rng(seed)
    for first in range(0, wanted, CHUNK):
        n = min(CHUNK, wanted - first)
        q = np.asarray(random_configuration(model, rng, (n,)))
        v, a = rng.normal(size=(2, n, model.nv))
        Y = np.asarray(calls["joint_torque_regressor"](model, q, v, a))
        W = unknowns.stacked(Y, a, v, np.sign(v))[:, :height].reshape(-1, count)
        R = np.asarray(np.linalg.qr(np.concatenate([R, W]), mode="r"))
    return R


def base_of_columns(R: Array, names: tuple[str, ...]) -> Base:
    """The Base of a triangular factor. Raises IdentificationError if the pivots have no gap."""
    size = np.sqrt((R * R).sum(0))
    kept = np.flatnonzero(size > ROUNDED * size.max(initial=0.0))
    if not len(kept):
        return Base(names, np.zeros(0, np.intp), np.zeros((0, len(names))), 0, np.inf)
    order, T = pivoted(R[:, kept] / size[kept])
    pivots = abs(np.diag(T))
    rank = int((pivots > DEPENDENT * pivots[0]).sum())
    gap = float(pivots[rank - 1] / pivots[rank]) if rank < len(pivots) and pivots[rank] > 0.0 else np.inf
    if gap < GAP:
        raise IdentificationError(
            f"base parameters have pivots {pivots[rank - 1]:.3g} and {pivots[rank]:.3g} beside each other, expected a "
            f"gap of {GAP:g} to tell the rank by: load the robot with snap=1e-9, or take exact right angles"
        )
    regrouped = np.linalg.solve(T[:rank, :rank], T[:rank, rank:])
    regrouped[abs(regrouped) < ROUNDED] = 0.0
    columns, rest = kept[order[:rank]], kept[order[rank:]]
    K = np.zeros((rank, len(names)))
    K[np.arange(rank), columns] = 1.0
    K[:, rest] = regrouped * size[rest] / size[columns][:, None]
    sort = np.argsort(columns)
    return Base(names, columns[sort], K[sort], rank, gap)


def pivoted(R: Array) -> tuple[NDArray[np.intp], Array]:
    """Order of columns and triangular factor of a QR that takes the longest remaining column each time (Businger)."""
    A, n = np.array(R), R.shape[1]
    order = np.arange(n)
    for k in range(min(A.shape)):
        rest = (A[k:, k:] * A[k:, k:]).sum(0)
        j = k + int(rest.argmax())
        if j != k:
            A[:, [k, j]], order[[k, j]] = A[:, [j, k]], order[[j, k]]
        x = A[k:, k].copy()
        length = np.sqrt(x @ x)
        if length == 0.0:
            break
        x[0] += np.copysign(length, x[0])
        x /= np.sqrt(x @ x)
        A[k:, k:] -= np.outer(2.0 * x, x @ A[k:, k:])
        A[k + 1 :, k] = 0.0
    return order, A[: min(A.shape)]
