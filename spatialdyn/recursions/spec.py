"""Spec: inputs, output and properties of a recursion, from which engines and public calls are made.

A recursion is called as ``recursion(bodies, work, *inputs, *outputs)`` on the arrays of one sample (without
``work`` if its Spec has none). Its Spec names those arrays in that order. An input that a call leaves
out is None there, and the recursion skips its terms: ``nonlinear_effects`` is the RNEA without a.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from .signatures import Array


@dataclass(frozen=True)
class Argument:
    """One array of a recursion.

    name            as in the public signature
    shape           of one sample: numbers, and "nq", "nv", "njoints"
    unit            of its entries
    meaning         in words, with its frame
    optional        may be left out (an input that is then None)
    static          one value for all samples, not an array of them: an int (shape ()) or an array
    unit_norm       the quaternions and (cos, sin) pairs of a configuration have to be of unit norm
    per_coordinate  an output indexed by coordinates rather than summed over them: with mimic joints, the independent
                    entries are taken where another output is contracted with G
    is_force        an input that pairs with velocities, as a torque does: with mimic joints, the followers' entries
                    are 0 where those of a velocity follow by G
    """

    name: str
    shape: tuple[str | int, ...]
    unit: str
    meaning: str
    optional: bool = False
    static: bool = False
    unit_norm: bool = False
    per_coordinate: bool = False
    is_force: bool = False


class MassMatrix(Protocol):
    """M(q) of some samples of a model with mimic joints, and public calls: what a ``through_M`` needs."""

    @property
    def inverse(self) -> Array:
        """M⁻¹ (samples, nv, nv)."""

    def solve(self, x: Array) -> Array:
        """M⁻¹ x (samples, nv)."""

    def call(self, name: str, *inputs: Array) -> Array:
        """The public call of that name at these inputs, optional ones last; None for an input left out."""


@dataclass(frozen=True, eq=False)
class Spec:
    """A public call: its name, its recursion, the dtype of its scratch, its inputs (None: left out) and output.

    pivots      after its output the recursion writes the articulated inertia D (nv) of each row, which the call does
                not return: the engine reduces it to one flag, whether any row is singular
    term_shape  shape, in "nv", of the terms that a program sums, where they outnumber its results
    scratch     shapes, in "nv", of arrays of scratch that the recursion takes last and writes in place
    traceable   the recursion branches on no value, so that it can become a program
    through_M   ``through_M(M, *inputs)``: the output of samples (samples, ...) of a model with mimic joints, by its
                MassMatrix, because M⁻¹ there is no recursion over the tree; a tuple has the parts along the output's
                first axis. Every Spec with pivots has one.
    regroup     the output is unchanged when inertias are regrouped towards the root: it describes no single body
    source      where the recursion comes from
    """

    name: str
    recursion: Callable[..., None]
    work: np.dtype | None
    inputs: tuple[Argument | None, ...]
    output: Argument
    summary: str
    source: str
    pivots: bool = False
    regroup: bool = False
    term_shape: tuple[str, ...] = ()
    scratch: tuple[tuple[str, ...], ...] = ()
    traceable: bool = True
    through_M: Callable[..., Any] | None = None

    @property
    def present(self) -> tuple[Argument, ...]:
        """The inputs that the call has."""
        return tuple(x for x in self.inputs if x is not None)

    def extra_outputs(self, nv: int) -> list[tuple[int, ...]]:
        """Shapes of the arrays that the recursion takes after its output, which the call does not return."""
        return [(nv,)] * self.pivots + [(nv,) * len(shape) for shape in self.scratch]


Q = Argument("q", ("nq",), "rad | m", "joint positions", unit_norm=True)
V = Argument("v", ("nv",), "rad/s | m/s", "joint velocities")
A = Argument("a", ("nv",), "rad/s² | m/s²", "joint accelerations")
TAU = Argument("tau", ("nv",), "N m | N", "joint torques", is_force=True)
FEXT = Argument(
    "fext",
    ("njoints", 6),
    "N | N m",
    "force on each joint's body, in the joint's frame, linear first; row 0 is the world's and ignored",
)
FEXT_OPTIONAL = Argument(FEXT.name, FEXT.shape, FEXT.unit, FEXT.meaning, optional=True)
ROW = Argument("row", (), "", "row of the body that carries the frame", static=True)
PLACEMENT = Argument("placement", (4, 4), "m", "pose of the frame in that body", static=True)
REFERENCE = Argument("reference", (), "", "LOCAL, WORLD or LOCAL_WORLD_ALIGNED", static=True)
CLASSICAL = Argument("classical", (), "", "1 for the classical acceleration", static=True)

LOCAL, WORLD, LOCAL_WORLD_ALIGNED = 0, 1, 2
