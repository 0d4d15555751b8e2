"""What a recursion takes and gives: the small table from which engines and public calls are made.

A recursion is called as ``recursion(bodies, work, *inputs, *outputs)`` on the arrays of one sample (without
``work`` if its Spec has none). Its Spec names those arrays in that order. An input that a call does not have is
None there, and the recursion skips the terms it would bring: ``nonlinear_effects`` is the RNEA without a.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Argument:
    """One array of a recursion.

    name      as in the public signature
    shape     of one sample: numbers, and "nq", "nv", "njoints"
    unit      of its entries
    meaning   in words, with its frame
    optional  may be left out (an input that is then None)
    static    not an array of samples but one value for all: an int (shape ()) or an array
    unit_norm the quaternions and (cos, sin) pairs of a configuration have to be of unit norm
    free      an output indexed by coordinates rather than summed over them: with mimic joints, the independent
              entries are taken where another output is contracted with G
    dual      an input that pairs with velocities, as a torque does: with mimic joints, the followers' entries are 0
              where those of a velocity follow by G
    """

    name: str
    shape: tuple[str | int, ...]
    unit: str
    meaning: str
    optional: bool = False
    static: bool = False
    unit_norm: bool = False
    free: bool = False
    dual: bool = False


@dataclass(frozen=True, eq=False)
class Spec:
    """A public call: its name, the recursion behind it, the dtype of its scratch, its inputs (None: not there), output.

    pivots  after its output the recursion writes the articulated inertia D (nv) of each row, which is not returned:
            the caller makes of it the answer to whether any row is singular
    terms   shape, in "nv", of the terms that a program sums, where they outnumber its results
    spare   shapes, in "nv", of further arrays that the recursion takes last of all, to work in
    traces  the recursion branches on no value, so that it can become a program
    regroup  the output is unchanged when inertias are regrouped towards the root: it says nothing of a single body
    source  where the recursion comes from
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
    terms: tuple[str, ...] = ()
    spare: tuple[tuple[str, ...], ...] = ()
    traces: bool = True

    @property
    def given(self) -> tuple[Argument, ...]:
        """The inputs that the call has."""
        return tuple(x for x in self.inputs if x is not None)

    def beside(self, nv: int) -> list[tuple[int, ...]]:
        """Shapes of the arrays that the recursion takes after its output and nobody sees."""
        return [(nv,)] * self.pivots + [(nv,) * len(shape) for shape in self.spare]


Q = Argument("q", ("nq",), "rad | m", "joint positions", unit_norm=True)
V = Argument("v", ("nv",), "rad/s | m/s", "joint velocities")
A = Argument("a", ("nv",), "rad/s² | m/s²", "joint accelerations")
TAU = Argument("tau", ("nv",), "N m | N", "joint torques", dual=True)
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
