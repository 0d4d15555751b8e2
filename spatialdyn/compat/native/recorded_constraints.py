"""Constrained dynamics for one sample that record inputs and result, as builtins; see ``recorded_calls``."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra.scalars import inline
from ...engines.compiled import numba_kernels
from ...engines.compiled.cpython import Builtin
from ...engines.compiled.tiers import NATIVE, table_kernel
from ...engines.object_layout import DATA, SHAPE
from ...recursions import SPECS
from ...recursions.constraints.kkt import bordered_inverse, constrained
from .recorded_calls import EDITED, IF_EDITED, SIZES, copy, make_answer, put_stamp, record

# words of a plan: addresses of the factors that ``recursions.constraints.kkt`` computes, and stamps of two calls: the
# one at which M and the bias are, and this one
RECORDED = ("L", "Y", "C", "force", "clock", "before", "time", "scratch")


def take_scratch(**shapes: str) -> list[str]:
    """Statements that take arrays ``x_in`` of these shapes from the memory at ``scratch``, one after the other.

    Allocating each anew would cost as much as a short call.
    """
    sizes = {x: shape.replace(", ", " * ") for x, shape in shapes.items()}
    return [y for x in shapes for y in (f"{x}_in = at(scratch, ({shapes[x]},))", f"scratch += 8 * {sizes[x]}")]


def scratch_of(nv: int, m: int) -> NDArray[np.float64]:
    """The memory for all scratch of a builtin under m constraints: of less than this many numbers."""
    return np.empty((2 * nv + 2 * m + 20) * (nv + m))


CHECK_AND_COMPUTE_M = [
    IF_EDITED,
    f"if not is_matrix(plan, J, nv) or word(word(J, {SHAPE}), 0) != m: return return_none(plan)",
    "if damping != 0 and not is_real(plan, damping): return return_none(plan)",
    "J_in, mu = matrix(J), real(damping) if damping != 0 else 0.0",
    "if not mu >= 0.0: return return_none(plan)",
    *take_scratch(M="nv, nv", x="nv", L="nv, nv", Y="m, nv", C="m, m", force="m", g="m"),
    f"if mass_matrix(table, q_in, M_in) != {numba_kernels.OK}: return return_none(plan)",
]
SOLVE = [
    "bodies = table_at(table)",
    "if solve(bodies, M_in, J_in, x_in, g_in, mu, L_in, Y_in, C_in, x_in, force_in) != m: return return_none(plan)",
]
RECORD = [
    "copy2(L_in, at(L, (nv, nv)))",
    "copy2(Y_in, at(Y, (m, nv)))",
    "copy2(C_in, at(C, (m, m)))",
    "copy(force_in, at(force, (m,)))",
    *put_stamp("before"),
    *put_stamp(),
]


@inline
def _copy2(x: Any, out: Any) -> None:
    for i in range(len(x)):
        copy(x[i], out[i])


def scope_of_constraints() -> dict[str, Any]:
    """Names that the bodies of these builtins use."""

    def kernel(name: str) -> Any:
        return table_kernel(numba_kernels.variant(SPECS[name], frozenset())).twin

    return {
        **EDITED, "mass_matrix": kernel("crba"), "bias_of": kernel("nonlinear_effects"), "table_at": NATIVE["table_at"],
        "solve": constrained, "inverse": bordered_inverse, "copy": copy, "copy2": _copy2, "empty": np.empty,
    }  # fmt: skip


@cache
def dynamics() -> Builtin:
    """``(q, v, tau, J, drift[, damping]) -> a``: forward dynamics under constraints; returns None if not applicable.

    Words: table, sizes, m, memory for q and v, bias, result, factors, stamps, scratch.
    """
    words = ["table", *SIZES, "m", "memory", "bias", "result", *RECORDED]
    body = [
        "if not is_vector(plan, q, nq): return return_none(plan)",
        "if not (is_vector(plan, v, nv) and is_vector(plan, tau, nv)): return return_none(plan)",
        "if not is_vector(plan, drift, m): return return_none(plan)",
        "q_in, v_in, tau_in = vector(q, nq), vector(v, nv), vector(tau, nv)",
        *CHECK_AND_COMPUTE_M,
        "copy(vector(drift, m), g_in)",
        *take_scratch(b="nv"),
        f"if bias_of(table, q_in, v_in, b_in) != {numba_kernels.OK}: return return_none(plan)",
        "for i in range(nv): x_in[i] = tau_in[i] - b_in[i]",
        *SOLVE,
        *make_answer(words, "nv", 1),
        f"copy(x_in, at(word(answer, {DATA}), (nv,)))",
        *RECORD,
        *record(q="nq", v="nv"),
        "copy(b_in, at(bias, (nv,)))",
        "copy(x_in, at(result, (nv,)))",  # after the inputs, which may share its memory
        "return answer",
    ]
    arguments = ["q", "v", "tau", "J", "drift", "damping"]
    return Builtin("constrained", arguments, words, body, scope_of_constraints(), optional=1)


@cache
def impact() -> Builtin:
    """``(q, v, J[, restitution[, damping]]) -> v after an impact``; returns None if not applicable.

    Words: table, sizes, m, memory for q, M, result, factors, stamps, scratch.
    """
    words = ["table", *SIZES, "m", "memory", "M", "result", *RECORDED]
    body = [
        "if not (is_vector(plan, q, nq) and is_vector(plan, v, nv)): return return_none(plan)",
        "if restitution != 0 and not is_real(plan, restitution): return return_none(plan)",
        "q_in, v_in, e = vector(q, nq), vector(v, nv), real(restitution) if restitution != 0 else 0.0",
        "if not 0.0 <= e <= 1.0: return return_none(plan)",
        *CHECK_AND_COMPUTE_M,
        "for k in range(m):",
        "    g_in[k] = 0.0",
        "    for i in range(nv): g_in[k] += (1.0 + e) * J_in[k, i] * v_in[i]",
        "for i in range(nv): x_in[i] = 0.0",
        *SOLVE,
        *make_answer(words, "nv", 1),
        f"after = at(word(answer, {DATA}), (nv,))",
        "for i in range(nv): after[i] = v_in[i] + x_in[i]",
        "copy2(M_in, at(M, (nv, nv)))",
        "copy(q_in, at(memory, (nq,)))",
        *RECORD,
        "copy(after, at(result, (nv,)))",
        "return answer",
    ]
    return Builtin("impact", ["q", "v", "J", "restitution", "damping"], words, body, scope_of_constraints(), optional=2)


@cache
def inverse() -> Builtin:
    """``(q, J[, damping]) -> inverse of [M Jᵀ; J -μ 1]``; returns None if not applicable.

    Words: table, sizes, m, axes of the result, memory for q, M, factors, stamps, scratch.
    """
    words = ["table", *SIZES, "m", "rows", "columns", "memory", "M", *RECORDED]
    body = [
        "if not is_vector(plan, q, nq): return return_none(plan)",
        "q_in = vector(q, nq)",
        *CHECK_AND_COMPUTE_M,
        "for k in range(m): g_in[k] = 0.0",
        "for i in range(nv): x_in[i] = 0.0",
        *SOLVE,
        *make_answer(words, "rows", 2),
        "copy(force_in, at(force, (m,)))",
        f"inverse(bodies, L_in, Y_in, C_in, g_in, x_in, force_in, at(word(answer, {DATA}), (rows, columns)))",
        "copy2(M_in, at(M, (nv, nv)))",
        "copy(q_in, at(memory, (nq,)))",
        *RECORD,
        "return answer",
    ]
    return Builtin("bordered_inverse", ["q", "J", "damping"], words, body, scope_of_constraints(), optional=1)
