"""Recursions of models with mimic joints, on rows of plain objects: recursions of the whole tree, reduced by G.

v of the whole tree is G v; an entry of its q is ratio q_leader + offset. ``recursions.mimic`` says which recursions run
on the whole tree and which solve with M = Gᵀ M G. Both can be recorded as programs like any other; run on floats they
are the reference.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....bodies.kinds import NQ
from ....recursions import REDUCTION, SPECS
from ....recursions.spec import Argument, Spec, gather, shape_in, sizes_of
from . import tracer
from .tracer import Row

OF_THE_TREE = ("X", "axial", "transverse", "skewed", "inertia")  # fields that a row of a joint alone lacks


class MimicRows(list[Row]):
    """Rows of the joints with coordinates of their own, as of ``bodies.table.independent``; the world's first.

    Recursions on the joints' group run on these rows. The parent of each row is the row before it, so M is factored as
    that of a chain; the zeros of M stay zeros in a program. Only the rows of ``tree`` have poses and inertias.

    tree    rows of the whole tree
    moving  for each row but the world's, (row of the tree, ratio) of the joint itself, then of the joints that follow
    """

    def __init__(self, tree: list[Row]) -> None:
        """The rows of a whole tree in which some joints have leaders."""
        fields: list[dict[str, Any]] = [vars(row) for row in tree]
        own = [k for k, row in enumerate(fields) if not row["leader"]]
        follow = [k for k, row in enumerate(fields) if row["leader"]]
        coordinates = sorted(fields[k]["q_index"] for k in follow)
        super().__init__(Row() for _ in own)
        for at, (row, k) in enumerate(zip(self, own, strict=True)):
            held = {name: x for name, x in fields[k].items() if name not in OF_THE_TREE}
            vars(row).update(held, parent=max(at - 1, 0))
            vars(row)["q_index"] -= sum(x < held["q_index"] for x in coordinates)
        self.tree = tree
        led = {k: [(f, fields[f]["ratio"]) for f in follow if fields[f]["leader"] == k] for k in own[1:]}
        self.moving = [[(k, 1.0), *led[k]] for k in own[1:]]
        self._at = {k: at for at, k in enumerate(own)}

    def q_of_tree(self, q: Any) -> NDArray[Any]:
        """q of the whole tree."""
        rows: list[Any] = self.tree
        made = np.empty(rows[0].q_index, object)
        for k, row in enumerate(rows[1:], start=1):
            if row.leader:
                made[row.q_index] = row.ratio * q[vars(self[self._at[row.leader]])["q_index"]] + row.offset
                continue
            first = vars(self[self._at[k]])["q_index"]
            for c in range(NQ[row.kind]):
                made[row.q_index + c] = q[first + c]
        return made

    def v_of_tree(self, v: Any) -> NDArray[Any]:
        """G v."""
        made = np.empty(len(self.tree) - 1, object)
        for x, moved in zip(v, self.moving, strict=True):
            for k, ratio in moved:
                made[k - 1] = ratio * x
        return made

    def input_of_tree(self, argument: Argument, x: Any) -> Any:
        """An input of the model as an input of the whole tree."""
        if argument.shape == ("nq",):
            return self.q_of_tree(x)
        if argument.shape == ("nv",) and argument.is_force:
            made = np.full(len(self.tree) - 1, 0.0, object)
            for force, ((k, _), *_) in zip(x, self.moving, strict=True):
                made[k - 1] = force
            return made
        return self.v_of_tree(x) if argument.shape == ("nv",) else x

    def output_of_model(self, argument: Argument, x: NDArray[Any], sizes: Mapping[str, int]) -> NDArray[Any]:
        """An output of the whole tree as an output of the model: axes "nv" times G, or the independent entries.

        sizes  of the whole tree, and of static tables
        """
        for axis, size in enumerate(argument.shape):
            names = str(size).split("+")
            blocks = np.split(x, np.cumsum(shape_in(names, sizes))[:-1], axis)
            x = np.concatenate([self._block(argument, *of, axis) for of in zip(names, blocks, strict=True)], axis)
        return x

    def _block(self, argument: Argument, size: str, x: NDArray[Any], axis: int) -> NDArray[Any]:
        """The part of an output that has one of the sizes of an axis."""
        if size == "nq" or (size == "nv" and argument.per_coordinate):
            return np.take(x, self._own_q if size == "nq" else [moved[0][0] - 1 for moved in self.moving], axis)
        if size == "nv":
            return np.moveaxis(self.times_G(np.moveaxis(x, axis, -1)), -1, axis)
        return x

    def times_G(self, J: NDArray[Any]) -> NDArray[Any]:
        """J G (..., nv), of J (..., nv of the whole tree)."""
        return np.stack([self._sum(np.moveaxis(J, -1, 0), moved) for moved in self.moving], axis=-1)

    @staticmethod
    def _sum(x: NDArray[Any], moved: Sequence[tuple[int, float]]) -> NDArray[Any]:
        """The weighted sum over a joint and the joints that follow it, along the first axis."""
        total = np.array(x[moved[0][0] - 1], object)
        for k, ratio in moved[1:]:
            more: Any = x[k - 1]
            for at in np.ndindex(total.shape):
                total[at] = total[at] + ratio * (more[at] if total.shape else more)
        return total

    @cached_property
    def _own_q(self) -> list[int]:
        rows: list[Any] = self.tree
        return [row.q_index + c for row in rows[1:] if not row.leader for c in range(NQ[row.kind])]


def rows_of(tree: list[Row]) -> list[Row]:
    """The rows of a table of bodies for recursions: MimicRows if joints mimic others, else the rows unchanged."""
    return MimicRows(tree) if any(vars(row)["leader"] for row in tree) else tree


def evaluate(
    spec: Spec, rows: Sequence[Any], shape: tuple[int, ...], inputs: Mapping[str, Any], pivots: NDArray[Any] | None,
    start: float = 0.0,
) -> NDArray[Any]:  # fmt: skip
    """As ``tracer.evaluate``, for any model; ``rows`` come from ``rows_of``.

    The pivots of a model with mimic joints are those of M.
    """
    if not isinstance(rows, MimicRows) or spec.composed:
        return tracer.evaluate(spec, rows, shape, inputs, pivots, start)
    if spec.through_M is not None:
        M = MassMatrix(rows, inputs["q"])
        given = gather(spec.inputs, lambda x: None if inputs.get(x.name) is None else _one(inputs[x.name]))
        found = spec.through_M(M, *given)
        parts = [x[0] for x in found] if isinstance(found, tuple) else found[0]
        if pivots is not None:
            pivots[:] = M.pivots
        out = np.empty(shape or (1,), object)
        out[...] = np.reshape(np.asarray(parts, object), out.shape)
        return out
    given_tree = {**inputs}
    for x in spec.present:
        if not x.static and inputs.get(x.name) is not None:
            given_tree[x.name] = rows.input_of_tree(x, inputs[x.name])
    sizes = sizes_of(rows.tree, [(x, inputs[x.name]) for x in spec.present if x.table is not None])
    found = tracer.evaluate(spec, rows.tree, shape_in(spec.output.shape, sizes), given_tree, None, start)
    return rows.output_of_model(spec.output, found, sizes)


def _one(x: Any) -> NDArray[Any]:
    """An input as a batch of one sample."""
    return np.asarray(x, object)[None]


class MassMatrix:
    """A ``recursions.spec.MassMatrix`` of one sample: M(q) of a model with mimic joints, factored.

    pivots  (nv,) D of M = LᵀD L
    """

    def __init__(self, rows: MimicRows, q: Any) -> None:
        """Compute M and factor it."""
        n = len(rows) - 1
        self._rows = rows
        self._L = evaluate(SPECS[REDUCTION.mass_matrix], rows, (n, n), {"q": q}, None)
        REDUCTION.factor(rows, self._L)
        self.pivots = self._L.diagonal().copy()

    def solve(self, x: NDArray[Any]) -> NDArray[Any]:
        """M⁻¹ x (1, nv)."""
        made = np.array(x, object)
        REDUCTION.solve(self._rows, self._L, made[0])
        return made

    @cached_property
    def inverse(self) -> NDArray[Any]:
        """M⁻¹ (1, nv, nv); the upper triangle is a copy of the lower one."""
        n = len(self._rows) - 1
        made = np.empty((1, n, n), object)
        for j in range(n):
            unit = np.full((1, n), 0.0, object)
            unit[0, j] = 1.0
            column = self.solve(unit)[0]
            made[0, j:, j] = made[0, j, j:] = column[j:]
        return made

    def call(self, name: str, *inputs: Any) -> NDArray[Any]:
        """The result (1, ...) of the recursion of this name; optional inputs come last, None for one left out."""
        spec = SPECS[name]
        public = sorted(spec.present, key=lambda x: x.optional)
        given = {x.name: y[0] for x, y in zip(public, inputs, strict=False) if y is not None}
        shape = shape_in(spec.output.shape, sizes_of(self._rows))
        found = evaluate(spec, self._rows, shape, given, None)
        return (found if shape else found[0])[None] if shape else found


# --- recursions that others call ------------------------------------------------------------------------


def _on_tree(name: str) -> None:
    """Register that the recursion of this name, called on MimicRows, runs on the whole tree."""
    spec = SPECS[name]
    recursion: Any = spec.recursion
    inputs = spec.present

    def reduced(rows: MimicRows, work: Any, *arrays: Any) -> None:
        *given, out = arrays
        taken = [None if x is None else rows.input_of_tree(of, x) for of, x in zip(inputs, given, strict=True)]
        sizes = sizes_of(rows.tree)
        whole = np.full(shape_in(spec.output.shape, sizes), 0.0, object)
        recursion(rows.tree, work, *taken, whole)
        made = rows.output_of_model(spec.output, whole, sizes)
        out[tuple([slice(size) for size in made.shape])] = made  # the first entries of a larger array

    recursion.register(MimicRows)(reduced)


for _name in REDUCTION.on_tree:
    _on_tree(_name)


def _part_on_tree(part: Any) -> None:
    """Register that a part of recursions, called on MimicRows, runs on the whole tree; its J is reduced."""
    names = [*inspect.signature(part).parameters][1:]

    def reduced(rows: MimicRows, *arrays: Any) -> Any:
        given = dict(zip(names, arrays, strict=True))
        for name, of_tree in (("q", rows.q_of_tree), ("v", rows.v_of_tree), ("a", rows.v_of_tree)):
            if given.get(name) is not None:
                given[name] = of_tree(given[name])
        J = given.get("J")
        if J is not None:
            given["J"] = np.full((len(J), len(rows.tree) - 1), 0.0, object)
        found = part(rows.tree, *given.values())
        if J is not None:
            J[...] = rows.times_G(given["J"])
        return found

    part.register(MimicRows)(reduced)


for _part in REDUCTION.parts:
    _part_on_tree(_part)


def _through_M(name: str) -> None:
    """Register that the recursion of this name, called on MimicRows, solves with M."""
    spec = SPECS[name]
    recursion: Any = spec.recursion
    names = [x.name for x in spec.present]

    def reduced(rows: MimicRows, work: Any, *arrays: Any) -> None:
        *given, out, pivots = arrays
        inputs = dict(zip(names, given, strict=True))
        out[...] = evaluate(spec, rows, np.shape(out), inputs, pivots)

    recursion.register(MimicRows)(reduced)


for _name in REDUCTION.through_M:
    _through_M(_name)


def _by_factor(
    bodies: MimicRows, work: Any, q: Any, v: Any, tau: Any, fext: Any, D: Any, pivots: Any, a: Any, inverse: Any
) -> None:
    M = MassMatrix(bodies, q)
    found, parts = REDUCTION.of_factor(M, *(None if x is None else _one(x) for x in (q, v, tau, fext)))
    for k, part in enumerate(parts):
        D[k] = part[0]
    a[:], pivots[:], inverse[:] = found[0], M.pivots, M.inverse[0]


REDUCTION.by_factor.register(MimicRows)(_by_factor)


def diagonal_of_M(rows: MimicRows, q: Any) -> NDArray[Any]:
    """The diagonal (nv,) of M, with which pivots are compared."""
    n = len(rows) - 1
    return evaluate(SPECS[REDUCTION.mass_matrix], rows, (n, n), {"q": q}, None).diagonal()
