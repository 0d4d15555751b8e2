"""The recursions that engines need by name to run any recursion for models with mimic joints.

The velocity of the whole tree is G v with constant G. A recursion that walks the tree runs on the whole tree, and its
torques are reduced: Gᵀ τ, Gᵀ M G. The model's own coordinates form no tree, so a recursion that solves with M factors
Gᵀ M G instead: its Spec has a ``through_M``. Recursions that are ``composed`` of others call those below.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from .constraints.constraint_rows import (
    carry_axes,
    place_bias,
    place_rows,
    write_drift,
    write_error,
    write_jacobian,
)
from .contact.contact_rows import write_gaps, write_point_rows
from .derivatives.derivatives import aba_derivatives_by_factor, aba_derivatives_through_M
from .signatures import Array, Bodies, Matrix, Vector
from .spec import MassMatrix, Spec
from .tree.aba import acceleration_through_M
from .tree.kinematics import frame_motion
from .tree.ltdl import FACTORED, INVERTED, SOLVED, factor_tree, solve_tree


class Reduction(NamedTuple):
    """The recursions that an engine replaces for rows of a model with mimic joints.

    mass_matrix  name of the call of M
    on_tree      names of calls that run on the whole tree
    parts        parts of recursions that run on the whole tree, on the scratch that these calls leave: of their
                 arguments q, v and J are those of the model
    through_M    names of calls that solve with M
    factor, solve  ``factor(bodies, M)`` and ``solve(bodies, L, x)`` in place, by the parents of the rows
    factored, solved, inverted  the Specs of the factors of M, of M⁻¹ x and M⁻¹ by given factors
    by_factor    ``(bodies, work, q, v, tau, fext, D, pivots, a, inverse)``, a recursion that factors M itself
    of_factor    the same from a given M: ``(M, q, v, tau, fext) -> a, parts of D``, each (samples, ...)
    """

    mass_matrix: str
    on_tree: tuple[str, ...]
    parts: tuple[Any, ...]
    through_M: tuple[str, ...]
    factor: Callable[[Bodies, Matrix], None]
    solve: Callable[[Bodies, Matrix, Vector], None]
    factored: Spec
    solved: Spec
    inverted: Spec
    by_factor: Any
    of_factor: Callable[..., tuple[Array, tuple[Array, ...]]]


def accelerations_and_derivatives(
    M: MassMatrix, q: Array, v: Array, tau: Array, fext: Array
) -> tuple[Array, tuple[Array, ...]]:
    """a, and its derivatives by q, v and τ."""
    return acceleration_through_M(M, q, v, tau, fext), aba_derivatives_through_M(M, q, v, tau, fext)


REDUCTION = Reduction(
    "crba",
    (
        "crba", "rnea", "modified_rnea", "momentum_rate", "frame_placement", "frame_jacobian", "frame_jacobian_dot",
        "center_of_mass", "com_jacobian", "center_of_mass_acceleration",
    ),
    (
        carry_axes, frame_motion, place_bias, place_rows, write_drift, write_error, write_gaps, write_jacobian,
        write_point_rows,
    ),
    ("aba", "hamilton_field"), factor_tree, solve_tree, FACTORED, SOLVED, INVERTED,
    aba_derivatives_by_factor, accelerations_and_derivatives,
)  # fmt: skip
