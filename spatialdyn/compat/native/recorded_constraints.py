"""Constrained dynamics for one sample that record inputs and result, as builtins; see ``recorded_calls``."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...algebra.scalars import inline
from ...engines.compiled import numba_kernels
from ...engines.compiled.memory import at, table_at
from ...engines.compiled.numba_kernels import OK
from ...engines.compiled.tiers import table_kernel
from ...engines.programs.run.routine import routine
from ...recursions import SPECS
from ...recursions.constraints.kkt import bordered_inverse, constrained
from .recorded_calls import write_stamp

compute_M, compute_bias = (
    table_kernel(numba_kernels.variant(SPECS[name], frozenset())) for name in ("crba", "nonlinear_effects")
)


class Kept(NamedTuple):
    """Words: addresses of what the field of Data holds: the factors that ``recursions.constraints.kkt`` computes and
    the forces; of D and U = Lᵀ with unit diagonal, 0 if they are not held; of the clock, and of the stamp of the call
    that gave M and the bias.
    """

    L: int
    Y: int
    C: int
    force: int
    D: int
    U: int
    clock: int
    before: int


class System(NamedTuple):
    """Scratch of a solution: M, the right side, then the solution x, factors L, Y, C, forces, and γ."""

    M: Any
    x: Any
    L: Any
    Y: Any
    C: Any
    force: Any
    g: Any


@inline
def system_at(address: int, nv: int, m: int) -> System:
    """The arrays in memory at an address, one after the other: allocating them would cost as much as a short call."""
    L = address + 8 * (nv * nv + nv)
    C = L + 8 * (nv * nv + m * nv)
    force = C + 8 * m * m
    return System(
        at(address, (nv, nv)), at(address + 8 * nv * nv, (nv,)), at(L, (nv, nv)), at(L + 8 * nv * nv, (m, nv)),
        at(C, (m, m)), at(force, (m,)), at(force + 8 * m, (m,)),
    )  # fmt: skip


@inline
def behind_system(address: int, nv: int, m: int) -> int:
    """The address behind these arrays."""
    return address + 8 * (2 * nv * nv + nv + m * nv + m * m + 2 * m)


def words_of_factors(f: Any) -> dict[str, Any]:
    """Words of a builtin that writes the factors and forces of a solution; its scratch, and no held D and U."""
    m, nv = f.Y.shape
    scratch = np.empty((2 * nv + 2 * m + 20) * (nv + m))  # more than a builtin needs
    return {"L": f.L, "Y": f.Y, "C": f.C, "force": f.force, "D": None, "U": None, "scratch": scratch, "m": m}


@inline
def copy_vector(x: Any, out: Any) -> None:
    """Copy numbers."""
    for i in range(len(x)):
        out[i] = x[i]


@inline
def copy_matrix(x: Any, out: Any) -> None:
    """Copy numbers, row by row."""
    for i in range(len(x)):
        copy_vector(x[i], out[i])


@inline
def write_upper(L: Any, U: Any) -> None:
    """U = Lᵀ with unit diagonal, of an L with D on its diagonal."""
    for i in range(len(L)):
        for j in range(len(L)):
            U[i, j] = L[j, i] if j > i else 1.0 if j == i else 0.0


@inline
def keep(s: System, kept: Kept) -> None:
    """Copy the factors and the forces, and write a new stamp."""
    nv, m = len(s.x), len(s.g)
    if kept.D != 0:
        D = at(kept.D, (nv,))
        for i in range(nv):
            D[i] = s.L[i, i]
    if kept.U != 0:
        write_upper(s.L, at(kept.U, (nv, nv)))
    copy_matrix(s.L, at(kept.L, (nv, nv)))
    copy_matrix(s.Y, at(kept.Y, (m, nv)))
    copy_matrix(s.C, at(kept.C, (m, m)))
    copy_vector(s.force, at(kept.force, (m,)))
    write_stamp(kept.clock, kept.before)


@inline
def solved(table: int, s: System, J: Any, mu: float) -> bool:
    """Solve M x = x + Jᵀ λ, J x + γ = -μ λ; returns whether the constraints are independent."""
    m = constrained(table_at(table), s.M, J, s.x, s.g, mu, s.L, s.Y, s.C, s.x, s.force)
    return bool(m == len(s.g))


@routine(("nv",), q=("nq",), v=("nv",), tau=("nv",), J=("m", "nv"), drift=("m",), mu=())
def dynamics(
    q: Any, v: Any, tau: Any, J: Any, drift: Any, mu: float,
    table: int, nv: int, m: int, bias: int, kept: Kept, scratch: int, out: Any,
) -> bool:  # fmt: skip
    """Accelerations under constraints, with a damping μ; q, v and the result are to be recorded."""
    s = system_at(scratch, nv, m)
    b = at(behind_system(scratch, nv, m), (nv,))
    if not mu >= 0.0 or compute_M(table, q, s.M) != OK or compute_bias(table, q, v, b) != OK:
        return False
    copy_vector(drift, s.g)
    for i in range(nv):
        s.x[i] = tau[i] - b[i]
    if not solved(table, s, J, mu):
        return False
    copy_vector(s.x, out)
    keep(s, kept)
    copy_vector(b, at(bias, (nv,)))
    return True


@routine(("nv",), q=("nq",), v=("nv",), J=("m", "nv"), e=(), mu=())
def impact(
    q: Any, v: Any, J: Any, e: float, mu: float, table: int, nv: int, m: int, M: int, kept: Kept, scratch: int, out: Any
) -> bool:
    """Velocities after an impact of restitution e; q and the result are to be recorded."""
    s = system_at(scratch, nv, m)
    if not 0.0 <= e <= 1.0 or not mu >= 0.0 or compute_M(table, q, s.M) != OK:
        return False
    for k in range(m):
        s.g[k] = 0.0
        for i in range(nv):
            s.g[k] += (1.0 + e) * J[k, i] * v[i]
    for i in range(nv):
        s.x[i] = 0.0
    if not solved(table, s, J, mu):
        return False
    for i in range(nv):
        out[i] = v[i] + s.x[i]
    copy_matrix(s.M, at(M, (nv, nv)))
    keep(s, kept)
    return True


@routine(("rows", "rows"), q=("nq",), J=("m", "nv"), mu=())
def inverse(q: Any, J: Any, mu: float, table: int, nv: int, m: int, M: int, kept: Kept, scratch: int, out: Any) -> bool:
    """The inverse of [M Jᵀ; J -μ 1], which has ``rows`` rows; q is to be recorded."""
    s = system_at(scratch, nv, m)
    if not mu >= 0.0 or compute_M(table, q, s.M) != OK:
        return False
    for k in range(m):
        s.g[k] = 0.0
    for i in range(nv):
        s.x[i] = 0.0
    if not solved(table, s, J, mu):
        return False
    copy_matrix(s.M, at(M, (nv, nv)))
    keep(s, kept)
    bordered_inverse(table_at(table), s.L, s.Y, s.C, s.g, s.x, s.force, out)
    return True
