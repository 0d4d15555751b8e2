"""How the functions of this package read a configuration: q (nq), or in kernels q, cos q and sin q (3, nq).

A kernel computes the cosines and sines of all coordinates at once, in SIMD code (``engines.compiled.sines``), which
is faster than one after the other. A recursion whose Spec takes ``TURNED_Q`` reads q by these alone.
"""

from __future__ import annotations

from typing import Any

from ..algebra.scalars import Scalar, compiled_as, cos, sin


def coordinate(q: Any, k: int) -> Scalar:
    """q_k."""
    return q[k]


def cosine(q: Any, k: int) -> Scalar:
    """cos q_k."""
    return cos(q[k])


def sine(q: Any, k: int) -> Scalar:
    """sin q_k."""
    return sin(q[k])


@compiled_as(coordinate)
def _coordinate(q, k):  # type: ignore[no-untyped-def]  # Numba compares the argument lists
    return (lambda q, k: q[0, k]) if q.ndim == 2 else (lambda q, k: q[k])


@compiled_as(cosine)
def _cosine(q, k):  # type: ignore[no-untyped-def]
    return (lambda q, k: q[1, k]) if q.ndim == 2 else (lambda q, k: cos(q[k]))


@compiled_as(sine)
def _sine(q, k):  # type: ignore[no-untyped-def]
    return (lambda q, k: q[2, k]) if q.ndim == 2 else (lambda q, k: sin(q[k]))
