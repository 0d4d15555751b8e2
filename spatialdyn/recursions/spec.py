"""Spec: inputs, output and properties of a recursion, from which engines and public calls are made.

A recursion is called as ``recursion(bodies, work, *inputs, *outputs)`` on the arrays of one sample (without
``work`` if its Spec has none). Its Spec names those arrays in that order. An input that a call leaves
out is None there, and the recursion skips its terms: ``nonlinear_effects`` is the RNEA without a.

A shape names its sizes: "nq", "nv", "njoints", those that a static table adds ("nc"), and sums such as "nv+nc+2".
Several outputs lie side by side in one array, the Spec's output; the recursion takes its ``parts`` one by one.

A record, a NamedTuple, gathers what belongs together: inputs (the coefficients of friction), outputs, arrays of
scratch. Where a Spec has one of Arguments or of shapes, the recursion takes one of arrays. A class of scratch lists
its fields as a WORK does, their shapes as defaults::

    class StepScratch(NamedTuple):
        L: Matrix = ("nv", "nv")  # M, then its factors
        b: Vector = ("nv",)  # velocities

    Spec(..., scratch=(StepScratch(),))
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache, wraps
from typing import Any, ParamSpec, Protocol

import numpy as np

from .signatures import Array, Bodies, Work

P = ParamSpec("P")
Shape = tuple[str | int, ...]
Record = tuple[Any, ...]  # a NamedTuple of Arguments, or of shapes


@dataclass(frozen=True)
class Argument:
    """One array of a recursion.

    name            as in the public signature
    shape           of one sample: numbers, and the names of sizes
    unit            of its entries
    meaning         in words, with its frame
    optional        may be left out (an input that is then None)
    static          one value for all samples, not an array of them: an int (shape ()), an array, or a table
    table           of a static table, its dtype; the value is a StaticTable
    sizes           of a static table, the columns of its header that are sizes of arrays
    unit_norm       the quaternions and (cos, sin) pairs of a configuration have to be of unit norm
    turned          of a configuration, that the recursion reads it by ``bodies.coordinates`` alone, so that kernels can
                    hand it beside its cosines and sines
    moved_by        of a configuration, the name of the call that moves it by a displacement, an element of its tangent
    per_coordinate  an output indexed by coordinates rather than summed over them: with mimic joints, the independent
                    entries are taken where another output is contracted with G
    is_force        an input that pairs with velocities, as a torque does: with mimic joints, the followers' entries
                    are 0 where those of a velocity follow by G
    start           of a state of the Spec's own, which a run carries from step to step: its entries at the beginning
                    of a run that is given no others. The part NAME_rate of the output is its rate, which the run
                    integrates, or the part NAME_after the state at the end of a step; both flat
    """

    name: str
    shape: Shape
    unit: str
    meaning: str
    optional: bool = False
    static: bool = False
    unit_norm: bool = False
    turned: bool = False
    moved_by: str = ""
    per_coordinate: bool = False
    is_force: bool = False
    table: np.dtype | None = None
    sizes: tuple[str, ...] = ()
    start: float | None = None


class MassMatrix(Protocol):
    """M(q) of some samples of a model with mimic joints, and other recursions: what a ``through_M`` needs."""

    @property
    def inverse(self) -> Array:
        """M⁻¹ (samples, nv, nv)."""

    def solve(self, x: Array) -> Array:
        """M⁻¹ x (samples, nv)."""

    def call(self, name: str, *inputs: Array) -> Array:
        """The result of the call of that name at these inputs, optional ones last; None for an input left out."""


@dataclass(frozen=True, eq=False)
class Spec:
    """A public call: its name, its recursion, the dtype of its scratch, its inputs (None: left out) and output.

    pivots      after its output the recursion writes the articulated inertia D (nv) of each row, which the call does
                not return: the engine reduces it to one flag, whether any row is singular
    term_shape  shape of the terms that a program sums, where they outnumber its results
    scratch     what the recursion takes last and writes in place: shapes of arrays, or records of shapes
    parts       of several outputs, each of them: vectors, or numbers as arrays of one, side by side in ``output``; if
                they are a record, the recursion takes one
    traceable   the recursion branches on no value, so that it can become a program
    through_M   ``through_M(M, *inputs)``: the output of samples (samples, ...) of a model with mimic joints, by its
                MassMatrix, because M⁻¹ there is no recursion over the tree; a tuple has the parts along the output's
                first axis. Every Spec with pivots has one.
    composed    the recursion is made of others and walks no tree itself: with mimic joints it takes the model's own
                coordinates, and those others are reduced by G
    stamped     the recursion closes over nothing but what the package itself has: see ``engines.compiled.stamp``
    regroup     the output is unchanged when inertias are regrouped towards the root: it describes no single body
    lacks       columns of the table whose terms the recursion has not: a model with some is refused
    residual    of a call that solves, two names: of the call that gives its input back from its output, as rnea gives
                back aba's tau, or whose product with its output is 1, as crba's with minverse's; and of that with M⁻¹
    large       its table kernel takes half a minute to compile: steps run it as its program, as calls do, and calls
                that have no program are computed in NumPy
    on_lanes    table kernels run it on SIMD lanes: it chooses by ``select`` and ``anywhere``, never by a comparison
    mirrored    the output is a symmetric matrix, which the recursion writes in both triangles and does not read
    source      where the recursion comes from
    """

    name: str
    recursion: Callable[..., None]
    work: np.dtype | None
    inputs: tuple[Argument | Record | None, ...]
    output: Argument
    summary: str
    source: str
    pivots: bool = False
    regroup: bool = False
    term_shape: Shape = ()
    scratch: tuple[Shape | Record | None, ...] = ()
    traceable: bool = True
    through_M: Callable[..., Any] | None = None
    parts: tuple[Argument, ...] = ()
    lacks: tuple[str, ...] = ()
    residual: tuple[str, ...] = ()
    composed: bool = False
    large: bool = False
    on_lanes: bool = False
    mirrored: bool = False
    stamped: bool = True

    def __reduce__(self) -> tuple[Any, ...]:
        known: tuple[Any, ...] | None = self.__dict__.get("made_by")
        return known or (_unpickled, tuple(getattr(self, x.name) for x in fields(self)))

    @cached_property  # read a dozen times by each call of a rollout
    def present(self) -> tuple[Argument, ...]:
        """The inputs that the call has, those of records one by one."""
        return tuple(flat(self.inputs))

    @cached_property
    def states(self) -> tuple[Argument, ...]:
        """The inputs that are states of its own."""
        return tuple(x for x in self.present if x.start is not None)

    def run(
        self, bodies: Bodies, work: Work, values: Mapping[str, Any], out: Array,
        empty: Callable[[tuple[int, ...]], Array] = np.empty,
    ) -> list[Any]:  # fmt: skip
        """Run the recursion on one sample, and return what it takes after its outputs: pivots and scratch.

        values  the inputs by name; optional ones may be missing
        out     as of the Spec's output, written; a number as an array of one
        empty   makes arrays of pivots and scratch from their shapes
        """
        sizes = sizes_of(bodies, [(x, values[x.name]) for x in self.present if x.table is not None])
        given = gather(self.inputs, lambda x: values.get(x.name) if x.optional else values[x.name])
        parts = self.split(out, sizes)
        outputs = [type(self.parts)(*parts)] if is_record(self.parts) else parts
        shapes = [("nv",)] * self.pivots + [*self.scratch]
        beside = gather(shapes, lambda shape: empty(shape_in(shape, sizes)))
        self.recursion(bodies, *([] if self.work is None else [work]), *given, *outputs, *beside)
        return beside

    def split(self, out: Array, sizes: Mapping[str, int]) -> list[Array]:
        """The outputs as the recursion takes them: ``out``, or its parts along the last axis."""
        if not self.parts:
            return [out]
        found, at = [], 0
        for part in self.parts:
            width = math.prod(shape_in(part.shape, sizes))
            found.append(out[..., at : at + width])
            at += width
        return found


@lru_cache(maxsize=256)
def _unpickled(*values: Any) -> Spec:
    """One Spec of the same values, so that a process that is sent it again and again records it once."""
    return Spec(*values)


def made_once(most: int | None = None) -> Callable[[Callable[P, Spec]], Callable[P, Spec]]:
    """A decorator of a function that makes Specs: the same one for the same arguments, of the ``most`` last used.

    Such a Spec pickles as the call that made it, so that a process has one of each, whatever it was sent.
    """

    def wrap(factory: Callable[P, Spec]) -> Callable[P, Spec]:
        @wraps(factory)
        @lru_cache(maxsize=most)
        def made(*arguments: Any) -> Spec:
            spec = factory(*arguments)  # type: ignore[call-arg]
            object.__setattr__(spec, "made_by", (made, arguments))
            return spec

        return made  # type: ignore[return-value]

    return wrap


def is_record(x: object) -> bool:
    """Whether it is a NamedTuple."""
    return hasattr(x, "_fields")


def flat(entries: Iterable[Any]) -> Iterator[Any]:
    """The entries that are there, those of records one by one."""
    for x in entries:
        if is_record(x):
            yield from flat(x)
        elif x is not None:
            yield x


def _made(kind: type, values: list[Any]) -> Any:
    return kind(*values)


def gather(
    entries: Iterable[Any], of: Callable[[Any], Any], record: Callable[[type, list[Any]], Any] = _made
) -> list[Any]:
    """For each entry of a Spec what a recursion takes: ``of`` an argument or a shape, a record of those of a record.

    None of an entry that is left out, and of a record of nothing but None.
    """
    found = []
    for x in entries:
        if is_record(x):
            values = gather(x, of, record)
            found.append(None if all(y is None for y in values) else record(type(x), values))
        else:
            found.append(None if x is None else of(x))
    return found


def shape_in(shape: Iterable[str | int], sizes: Mapping[str, int]) -> tuple[int, ...]:
    """A shape in numbers: each entry is a number, the name of a size, or a sum of both."""
    return tuple(
        s if isinstance(s, int) else sum(sizes[x] if x in sizes else int(x) for x in s.split("+")) for s in shape
    )


def sizes_of(bodies: Bodies, tables: Iterable[tuple[Argument, Any]] = ()) -> dict[str, int]:
    """Values of the names of sizes, from the table of bodies and from static tables: (argument, rows) of each."""
    world = bodies[0]
    found = {"nq": int(world.q_index), "nv": len(bodies) - 1, "njoints": int(world.dofs)}
    for argument, rows in tables:
        found |= {name: int(getattr(rows[0], name)) for name in argument.sizes}
    return found


Q = Argument("q", ("nq",), "rad | m", "joint positions", unit_norm=True, moved_by="integrate")
TURNED_Q = replace(Q, turned=True)
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
