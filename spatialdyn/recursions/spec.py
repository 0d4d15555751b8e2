"""Spec: inputs, output and properties of a recursion, from which engines and public calls are made.

A recursion is called as ``recursion(bodies, work, *inputs, *outputs)`` on the arrays of one sample (without
``work`` if its Spec has none). Its Spec names those arrays in that order. An input that a call leaves
out is None there, and the recursion skips its terms: ``nonlinear_effects`` is the RNEA without a.

A shape names its sizes: "nq", "nv", "njoints", those that a static table adds ("nc"), and sums such as "nv+nc+2".
Several outputs lie side by side in one array, the Spec's output; the recursion takes its ``parts`` one by one.

A record, a NamedTuple, gathers related arrays: inputs (the coefficients of friction), outputs, arrays of scratch. For
a record of Arguments or shapes in the Spec the recursion takes a record of arrays. A class of scratch lists its fields
as a WORK does, their shapes as defaults::

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
from itertools import accumulate, pairwise
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
    shape           shape of one sample: numbers, and the names of sizes
    unit            unit of the entries
    meaning         in words, with its frame
    optional        may be left out (an input that is then None)
    static          one value for all samples, not an array of them: an int (shape ()), an array, or a table
    table           dtype of a static table; the value is then a StaticTable
    sizes           the columns of a static table's header that are sizes of arrays
    unit_norm       the quaternions and (cos, sin) pairs of a configuration must be of unit norm
    turned          the recursion reads a configuration by ``bodies.coordinates`` alone, so kernels may pass it with
                    the cosines and sines of its angles
    moved_by        name of the call that moves a configuration by a displacement, an element of its tangent space
    per_coordinate  an output indexed by coordinates, not summed over them: with mimic joints, its independent entries
                    are selected; other outputs are contracted with G
    is_force        an input that pairs with velocities, as a torque does: with mimic joints, the followers' entries
                    are 0; the followers' velocities follow by G
    start           of a state of the Spec's own, which a run carries from step to step: the default of its entries at
                    the beginning of a run. The output has a part NAME_rate, the rate, which the run integrates, or a
                    part NAME_after, the state at the end of a step; both flat
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
    """The argument of a ``through_M``: M(q) of samples of a model with mimic joints, and calls of other recursions."""

    @property
    def inverse(self) -> Array:
        """M⁻¹ (samples, nv, nv)."""

    def solve(self, x: Array) -> Array:
        """M⁻¹ x (samples, nv)."""

    def call(self, name: str, *inputs: Array) -> Array:
        """The result of the named call for these inputs, optional ones last; None for an input left out."""


@dataclass(frozen=True, eq=False)
class Spec:
    """A public call: its name, its recursion, the dtype of its scratch, its inputs (None: left out) and output.

    pivots      after its output the recursion writes the articulated inertia D (nv) of each row, which the call does
                not return: the engine reduces it to one flag, whether any row is singular
    term_shape  shape of the terms that a program sums, if they outnumber its results
    scratch     the last arguments of the recursion, written in place: shapes of arrays, or records of shapes
    parts       the outputs, if there are several: vectors, or numbers as arrays of one, side by side in ``output``; for
                a record of parts, the recursion takes a record
    traceable   the recursion branches on no value, so that it can become a program
    through_M   ``through_M(M, *inputs)``: the output (samples, ...) for a model with mimic joints, by its MassMatrix,
                because no recursion over the tree gives M⁻¹ there; a tuple has the parts along the output's first axis.
                Every Spec with pivots has one.
    composed    the recursion calls others and walks no tree itself: with mimic joints it takes the model's own
                coordinates, and the recursions that it calls are reduced by G
    stamped     the recursion uses only code of the package itself: see ``engines.compiled.stamp``
    regroup     the output is unchanged when inertias are regrouped towards the root: it describes no single body
    lacks       columns of the table whose terms the recursion does not have: a model with nonzero entries is refused
    residual    for a call that solves, two names. First the call that recovers the input from the output, as rnea
                recovers aba's tau, or whose product with the output is 1, as crba's with minverse's; then that of M⁻¹
    large       its table kernel takes half a minute to compile: steps run it as its program, as calls do, and calls
                that have no program are computed in NumPy
    mirrored    the output is a symmetric matrix; the recursion writes both triangles and does not read them
    source      the publication of the recursion
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
    mirrored: bool = False
    stamped: bool = True

    def __reduce__(self) -> tuple[Any, ...]:
        known: tuple[Any, ...] | None = self.__dict__.get("made_by")
        return known or (_unpickled, tuple(getattr(self, x.name) for x in fields(self)))

    @cached_property  # read a dozen times by each call of a rollout
    def present(self) -> tuple[Argument, ...]:
        """The inputs that the call takes, records replaced by their entries."""
        return tuple(flat(self.inputs))

    @property
    def on_lanes(self) -> bool:
        """Whether table kernels run it on SIMD lanes, which have no truth value to branch on.

        Exceptions: recursions that branch on values, which are not traceable; and those that are composed or take a
        table, of constraints or contacts, since steps of a run and contacts have regions, which compile to branches.
        """
        return self.traceable and not self.composed and all(x.table is None for x in self.present)

    @cached_property
    def states(self) -> tuple[Argument, ...]:
        """The inputs that are states of the Spec's own."""
        return tuple(x for x in self.present if x.start is not None)

    def run(
        self, bodies: Bodies, work: Work, values: Mapping[str, Any], out: Array,
        empty: Callable[[tuple[int, ...]], Array] = np.empty,
    ) -> list[Any]:  # fmt: skip
        """Run the recursion on one sample; returns the arguments after its outputs: pivots and scratch.

        values  the inputs by name; optional ones may be missing
        out     the Spec's output, written in place; a number as an array of one
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
        return [out[..., at] for at in self.places(sizes)] if self.parts else [out]

    def places(self, sizes: Mapping[str, int]) -> list[slice]:
        """The places of the parts along the last axis of the output."""
        ends = accumulate((math.prod(shape_in(x.shape, sizes)) for x in self.parts), initial=0)
        return [slice(*both) for both in pairwise(ends)]


@lru_cache(maxsize=256)
def _unpickled(*values: Any) -> Spec:
    """The one Spec of these values in this process, so that repeated unpickling records it only once."""
    return Spec(*values)


def made_once(most: int | None = None) -> Callable[[Callable[P, Spec]], Callable[P, Spec]]:
    """A decorator that caches a function that makes Specs, keeping the ``most`` last used.

    Such a Spec pickles as the call that made it, so that unpickling makes no second equal Spec in a process.
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
    """The entries that are not None, records replaced by their entries."""
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
    """The arguments of a recursion for the entries of a Spec: ``of(entry)``, and for a record a record of these.

    None for an entry that is left out, and for a record of nothing but None.
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
