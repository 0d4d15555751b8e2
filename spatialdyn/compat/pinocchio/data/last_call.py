"""What calls were given, and how the fields of Data that somebody holds are filled."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....calls.arguments import core_shape
from ....engines.compiled.cpython import refused, retarget
from ....recursions import SPECS
from ...native import recorded_calls
from ..model.library_model import Made
from ..types.array_rows import Rows
from ..types.motion import Force
from .field_recipes import KINDS, Called, oMi, placed
from .field_recipes import result as RESULT

Array = NDArray[np.float64]
clock = count(1).__next__  # which of two calls was the later


class Run:
    """The last call of one kind.

    stamp   when it was, by ``clock``; 0 for never
    made    what the model was to the library then
    memory  the inputs, one after the other; they are attributes q, v, a, tau
    result  what the library returned; the array of a field that somebody holds, if it is just that: then ``shared``
    call    the library's call as a builtin that notes inputs and result; returns None if it is to be done otherwise
    again   functions that fill the other fields that somebody holds from what ``call`` noted
    fext    forces on the library's joints (njoints, 6), or None
    bodies  inertias (njoints, 10) of the model then; parents of its joints
    bound   builtins about the inputs, by who made them
    contact how a system with constraints was solved, of a kind that does
    frames  where the frames were on their joints then, of a kind that places them
    cache   fields that were asked for, with the stamp of then
    """

    __slots__ = (
        "_a",
        "_own",
        "_v",
        "again",
        "bodies",
        "bound",
        "cache",
        "call",
        "contact",
        "fext",
        "frames",
        "kind",
        "made",
        "memory",
        "parents",
        "push",
        "q",
        "result",
        "shared",
        "stamp",
        "tau",
    )  # fmt: skip

    def __init__(self, name: str, compiled: Made, parents: NDArray[np.intp], shape: tuple[int, ...] | None) -> None:
        self.kind = KINDS[name]
        self.stamp, self.made, self.parents = 0, compiled, parents
        self.fext: Array | None = None
        self.frames: Any = None
        self.contact: Any = None
        self.cache: dict[str, tuple[int, Array]] = {}
        self.bodies: Array = np.empty((0, 10))
        model = compiled.model
        if shape is None:
            shape = core_shape(model, SPECS[self.kind.call].output) or (1,) if self.kind.call else (0,)
        sizes = [(x, model.nq if x == "q" else model.nv) for x in self.kind.inputs.split()]
        self.memory: Array = np.empty(sum(size for _, size in sizes))
        self.result: Array = np.empty(shape)
        self._own, self.shared = self.result, False
        self.q: Any = None
        self._v: Array | None = None
        self._a: Array | None = None
        at = 0
        for x, size in sizes:
            setattr(self, {"v": "_v", "a": "_a"}.get(x, x), self.memory[at : at + size])
            at += size
        if self.kind.call == "aba":
            self._a = self.result
        self.call: Callable[..., Any] = self._first
        self.push: Callable[..., Any] | None = None  # the same with forces
        self.again: list[Callable[[], Any]] = []
        self.bound: dict[Any, Any] = {}

    @property
    def v(self) -> Array:
        """The velocities it was given, or zeros."""
        return np.zeros(self.made.model.nv) if self._v is None else self._v

    @property
    def a(self) -> Array:
        """The accelerations it was given or found, or zeros."""
        return np.zeros(self.made.model.nv) if self._a is None else self._a

    def pushed(self, fext: Any, *inputs: Any) -> Any:
        """``call`` with a list of a Force for each joint; None if it has to be done otherwise."""
        made = self.made
        fits = isinstance(fext, (list, Rows)) and len(fext) == made.model.njoints and made.joints is None
        if not fits or {*map(type, fext)} != {Force}:
            return None
        given = np.concatenate([force._x for force in fext])
        if self.push is None:
            self.push = self._bind(True)
        result = self.push(*inputs, given)
        if result is not None:
            self.fext = given.reshape(-1, 6)
        return result

    def edited(self, compiled: Made) -> None:
        """Be the run of an edited model: of the same tree, with other numbers."""
        self.made = compiled
        self.cache.clear()
        for function in (self.call, self.push, *self.again, *(call for _, call in self.bound.values())):
            retarget(function, compiled.model)

    def keep(self, *inputs: Array) -> None:
        """Copy the inputs to memory, in order."""
        at = 0
        for x in inputs:
            self.memory[at : at + x.size] = x
            at += x.size

    def _first(self, *inputs: Any) -> Any:
        """Make the builtin, and call it."""
        self.call = self._bind(False)
        return self.call(*inputs)

    def _bind(self, forces: bool) -> Callable[..., Any]:
        made, kind = self.made, self.kind
        if not (made.whole and kind.call):
            return refused
        names = kind.inputs.split()
        function = recorded_calls.kept(kind.call, tuple(names[len(names) - kind.more :]), not kind.stays, forces)
        places = {"memory": self.memory.ctypes.data, "result": self.result.ctypes.data}
        axes = {f"axis{k}": n for k, n in enumerate(self.result.shape)}
        return function.bind(made.model, self.memory, self.result, **made.words, **places, **axes)

    def show(self, shown: Mapping[str, Array], refresh: Callable[[Run, str], Any]) -> None:
        """Fill these fields from now on: the result's own in place, those that a call gives by that, others anew."""
        self.again, result = [], self._own
        for name, x in shown.items():
            recipe = self.kind.fills.get(name)
            if recipe is None:
                continue
            places = recipe is oMi and self.made.joints is None
            if (recipe is RESULT or (places and self.kind.call == "forward_kinematics")) and self._may_share(x):
                result = x
            else:
                recipe = placed if places else recipe
                self.again.append(self._redo(recipe, x) or partial(refresh, self, name))
        self.shared = result is not self._own
        if result is not self.result:
            if not self.shared:
                result[...] = self.result
            self.result, self.call, self.push = result, self._first, None

    def _may_share(self, x: Array) -> bool:
        return x.shape == self.result.shape and self.kind.call != "aba"  # there the result is an input of recipes

    def _redo(self, recipe: Any, x: Array) -> Callable[[], Any] | None:
        """A builtin that writes what a call of the library gives; None if it takes more than that."""
        made = self.made
        if not isinstance(recipe, Called) or not made.whole or (recipe.joints and made.joints is not None):
            return None
        inputs = {name: getattr(self, name) for name in recipe.inputs}
        spec = SPECS[recipe.call]
        if x.shape != core_shape(made.model, spec.output) or any(x.optional for x in spec.given):
            return None
        words = {f"{name}_there": array.ctypes.data for name, array in inputs.items()}
        words[f"{spec.output.name}_there"] = x.ctypes.data
        return recorded_calls.again(recipe.call).bind(made.model, x, *inputs.values(), **made.words, **words)
