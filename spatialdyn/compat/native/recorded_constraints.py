"""Constrained dynamics for one sample that record inputs and result, as builtins; see ``recorded_calls``."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra.scalars import inline
from ...engines.compiled import numba_kernels
from ...engines.compiled.tiers import table_kernel
from ...engines.programs.run.routine import Kind, Routine
from ...recursions import SPECS
from ...recursions.constraints.kkt import bordered_inverse, constrained
from .recorded_calls import SIZES

# words: addresses of the factors that ``recursions.constraints.kkt`` computes, the clock, the stamp of the call that
# gave M and the bias, and scratch
KEPT = ("L", "Y", "C", "force", "clock", "before", "scratch")


def take_scratch(**shapes: str) -> list[str]:
    """Statements that take arrays ``x_in`` of these shapes from the memory at ``scratch``, one after the other.

    Allocating each anew would cost as much as a short call.
    """
    sizes = {x: shape.replace(", ", " * ") for x, shape in shapes.items()}
    return [y for x in shapes for y in (f"{x}_in = at(scratch, ({shapes[x]},))", f"scratch += 8 * {sizes[x]}")]


def scratch_of(nv: int, m: int) -> NDArray[np.float64]:
    """The memory for all scratch of a builtin under m constraints: of less than this many numbers."""
    return np.empty((2 * nv + 2 * m + 20) * (nv + m))


COMPUTE_M = [
    "if not mu >= 0.0: return 0",
    *take_scratch(M="nv, nv", x="nv", L="nv, nv", Y="m, nv", C="m, m", force="m", g="m"),
    f"if mass_matrix(table, q_in, M_in) != {numba_kernels.OK}: return 0",
]
SOLVE = [
    "bodies = table_at(table)",
    "if solve(bodies, M_in, J_in, x_in, g_in, mu, L_in, Y_in, C_in, x_in, force_in) != m: return 0",
]
KEEP = [
    "copy2(L_in, at(L, (nv, nv)))",
    "copy2(Y_in, at(Y, (m, nv)))",
    "copy2(C_in, at(C, (m, m)))",
    "copy(force_in, at(force, (m,)))",
    "places(clock, (1,))[0] += 1",
    "places(before, (1,))[0] = word(clock, 0)",
]


@inline
def _copy(x: Any, out: Any) -> None:
    for i in range(len(x)):
        out[i] = x[i]


@inline
def _copy2(x: Any, out: Any) -> None:
    for i in range(len(x)):
        _copy(x[i], out[i])


def scope_of_constraints() -> dict[str, Any]:
    """Names that the bodies of these builtins use."""

    def kernel(name: str) -> Any:
        return table_kernel(numba_kernels.variant(SPECS[name], frozenset())).twin

    return {
        "mass_matrix": kernel("crba"), "bias_of": kernel("nonlinear_effects"), "solve": constrained,
        "inverse": bordered_inverse, "copy": _copy, "copy2": _copy2, "empty": np.empty,
    }  # fmt: skip


@cache
def dynamics() -> Routine:
    """``(q, v, tau, J, drift, damping) -> a``: forward dynamics under constraints; q, v and a are to be recorded.

    Words: table, sizes, m, bias, factors, clock, stamp, scratch.
    """
    inputs: dict[str, Kind] = {"q_in": ("nq",), "v_in": ("nv",), "tau_in": ("nv",), "J_in": ("m", "nv")}
    body = [
        *COMPUTE_M,
        "copy(drift, g_in)",
        *take_scratch(b="nv"),
        f"if bias_of(table, q_in, v_in, b_in) != {numba_kernels.OK}: return 0",
        "for i in range(nv): x_in[i] = tau_in[i] - b_in[i]",
        *SOLVE,
        "copy(x_in, out)",
        *KEEP,
        "copy(b_in, at(bias, (nv,)))",
        "return 1",
    ]
    words = ["table", *SIZES, "m", "bias", *KEPT]
    return Routine("constrained", words, inputs | {"drift": ("m",), "mu": ()}, body, scope_of_constraints(), ("nv",))


@cache
def impact() -> Routine:
    """``(q, v, J, restitution, damping) -> v after an impact``; q and the result are to be recorded.

    Words: table, sizes, m, M, factors, clock, stamp, scratch.
    """
    inputs: dict[str, Kind] = {"q_in": ("nq",), "v_in": ("nv",), "J_in": ("m", "nv"), "e": (), "mu": ()}
    body = [
        "if not 0.0 <= e <= 1.0: return 0",
        *COMPUTE_M,
        "for k in range(m):",
        "    g_in[k] = 0.0",
        "    for i in range(nv): g_in[k] += (1.0 + e) * J_in[k, i] * v_in[i]",
        "for i in range(nv): x_in[i] = 0.0",
        *SOLVE,
        "for i in range(nv): out[i] = v_in[i] + x_in[i]",
        "copy2(M_in, at(M, (nv, nv)))",
        *KEEP,
        "return 1",
    ]
    return Routine("impact", ["table", *SIZES, "m", "M", *KEPT], inputs, body, scope_of_constraints(), ("nv",))


@cache
def inverse() -> Routine:
    """``(q, J, damping) -> inverse of [M Jᵀ; J -μ 1]``; q is to be recorded.

    Words: table, sizes, m, axes of the result, M, factors, clock, stamp, scratch.
    """
    inputs: dict[str, Kind] = {"q_in": ("nq",), "J_in": ("m", "nv"), "mu": ()}
    body = [
        *COMPUTE_M,
        "for k in range(m): g_in[k] = 0.0",
        "for i in range(nv): x_in[i] = 0.0",
        *SOLVE,
        "copy(force_in, at(force, (m,)))",
        "inverse(bodies, L_in, Y_in, C_in, g_in, x_in, force_in, out)",
        "copy2(M_in, at(M, (nv, nv)))",
        *KEEP,
        "return 1",
    ]
    words = ["table", *SIZES, "m", "rows", "columns", "M", *KEPT]
    return Routine("bordered_inverse", words, inputs, body, scope_of_constraints(), ("rows", "columns"))
