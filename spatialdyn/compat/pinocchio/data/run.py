"""Run: inputs and result of the last call of a kind, and the builtins that compute them and the held fields."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping
from functools import cache, partial, reduce
from operator import attrgetter
from typing import Any
from weakref import ref

import numpy as np

from ....calls.arguments import core_shape
from ....engines.object_layout import Words
from ....engines.programs.run.single_call import plan_of, unavailable
from ....model.model import Model as SdModel
from ....recursions import SPECS
from ....recursions.tree import kinematics
from ...native import recorded_calls, recorded_kinematics, tree_kernels
from ...native.recorded_calls import address, clock
from ..model.library_model import LibraryModel
from ..model.numbers import Numbers
from ..types.arguments import Array
from ..types.motion import Force
from ..types.tracked_list import Rows
from .field_recipes import CALL_KINDS, CallRecipe, Ig, Kind, Part, joint_placements, oMi
from .field_recipes import result as RESULT

FORCES, LISTS, _NUMBERS = {Force}, (list, Rows), attrgetter("_x")


class Bound:
    """A builtin that a row of the table of names finds in a Data: what a Run is to other rows.

    owner      what the attribute of the Model is that the builtin holds for: its FramePlacements or its LibraryModel
    call       the builtin
    plan       that of ``call``
    after, recompute  None
    """

    __slots__ = ("after", "call", "owner", "plan", "recompute")

    def __init__(self, owner: Any, call: Callable[..., Any]) -> None:
        self.owner, self.call, self.plan = owner, call, plan_of(call)
        self.after = self.recompute = None


class Run:
    """The last call of one kind.

    stamp           its time by ``recorded_calls.clock``, which builtins write; 0 if there was no call
    library         the LibraryModel of that call
    memory          the inputs, one after the other; q, v, a, tau are views of it
    result          what the library returned; the held array of a field if that is the same (``result_is_held``)
    call            the library's call as a builtin that records inputs and result; returns None if not applicable
    forces_builtin  ``call`` with external forces; None until it is bound
    plan            that of ``call``, where the functions of ``algorithms.table`` find it; None until it is bound
    after           what such a function calls with the Data and the Run: of a kind that getters of Jacobians read; None
    recompute       recomputes the other held fields from the recorded inputs; None if there are none
    fext            forces on the library's joints (njoints, 6); None without
    bound           builtins about the inputs by key, by the getter for which this Run has to be the latest
    contact         factors of the constrained system, of a kind that solves one
    cache           field -> (stamp, array), of fields that were read
    placed_rows     of a call of ``joint_jacobians``, its scratch, from which Jacobians of frames follow
    oMi             the held field that such a call writes, if any
    """

    __slots__ = (
        "__weakref__", "_a", "_kept", "_own_result", "_pushed", "_stamp", "_v", "after", "bound", "cache", "call",
        "contact", "forces", "forces_builtin", "kind", "library", "memory", "oMi", "placed_rows", "plan", "q",
        "recompute", "result", "result_is_held", "tau",
    )  # fmt: skip

    def __init__(
        self, name: str, library: LibraryModel, shape: tuple[int, ...] | None, note: Callable[..., None]
    ) -> None:
        self.kind = CALL_KINDS[name]
        self.after = note if self.kind.getters else None
        # of the call, and of the call that left ``placed_rows``
        self._stamp, self.library = array("q", [0, 0]), library
        self.forces: tuple[int, Array | None] = 0, None  # and the time of their call
        self.contact: Any = None
        self.oMi: Array | None = None
        self.placed_rows: Any = None
        self.cache: dict[str, tuple[int, Array]] = {}
        self._pushed = len(library.rows) if library.joints is None else -1  # forces that a builtin takes
        self._kept: tuple[int, bytes] = 0, library.state
        model = library._model
        if shape is None:
            shape = core_shape(model, SPECS[self.kind.call].output) or (1,) if self.kind.call else (0,)
        sizes = [(x, model.nq if x == "q" else model.nv) for x in self.kind.inputs.split()]
        self.memory: Array = np.empty(sum(size for _, size in sizes))
        self.result: Array = np.empty(shape)
        self._own_result, self.result_is_held = self.result, False
        self.q: Any = None
        self._v: Array | None = None
        self._a: Array | None = None
        at = 0
        for x, size in sizes:
            setattr(self, {"v": "_v", "a": "_a"}.get(x, x), self.memory[at : at + size])
            at += size
        if self.kind.call == "aba":
            self._a = self.result
        if self.kind.call == "joint_jacobians" and library.has_builtins:
            self.placed_rows = np.empty(model.nv + 1, kinematics.WORK)
        library.runs.add(self)
        self.call: Callable[..., Any] = self._bind_and_call
        self.plan: Words | None = None
        self.forces_builtin: Callable[..., Any] | None = None
        self.recompute: Callable[[], Any] | None = None
        self.bound: dict[str, Any] = {}

    @property
    def stamp(self) -> int:
        """Time of the call."""
        return self._stamp[0]

    @stamp.setter
    def stamp(self, value: int) -> None:
        self._stamp[0] = value

    @property
    def stamp_words(self) -> dict[str, int]:
        """Words of a builtin that writes the stamp."""
        return {"clock": address(clock.now), "time": address(self._stamp)}

    @property
    def words_before(self) -> dict[str, int]:
        """Words of a builtin that stamps this call and then its own, which is made of it."""
        return {"clock": address(clock.now), "before": address(self._stamp)}

    @property
    def fext(self) -> Array | None:
        """Forces of the call on the library's joints (njoints, 6), or None."""
        then, forces = self.forces
        return None if forces is None or then != self.stamp else forces.reshape(-1, 6)

    @property
    def model(self) -> SdModel:
        """The library's Model at the call."""
        return self.library.model_at(self.state)

    @property
    def state(self) -> bytes:
        """That of the library at the call."""
        (kept, state), now = self._kept, self._stamp[0]
        return state if kept == now else self.library.state_at(now)

    @property
    def numbers(self) -> Numbers:
        """Those of the model at the call."""
        return self.library.numbers_of(self.state)

    @property
    def kernel_table(self) -> Any:
        """The table of bodies at the call, as kernels take it."""
        return self.library.table_at(self.state)

    def keep_state(self) -> None:
        """Keep it."""
        self._kept = self.stamp, self.state

    @property
    def v(self) -> Array:
        """Velocities of the call; zeros if it took none."""
        return np.zeros(self.library.words["nv"]) if self._v is None else self._v

    @property
    def a(self) -> Array:
        """Accelerations that the call took or computed; zeros if neither."""
        return np.zeros(self.library.words["nv"]) if self._a is None else self._a

    def call_with_forces(self, fext: Any, *inputs: Any) -> Any:
        """``call`` with a list of one Force for each joint; returns None if not applicable."""
        if not isinstance(fext, LISTS) or len(fext) != self._pushed or {*map(type, fext)} != FORCES:
            return None
        given = np.frombuffer(b"".join(map(_NUMBERS, fext)))  # twice as fast as np.concatenate
        if self.forces_builtin is None:
            self.forces_builtin = self._bind(True)
        result = self.forces_builtin(*inputs, given)
        if result is not None:
            self.forces = self._stamp[0], given
        return result

    def store_inputs(self, *inputs: Array) -> None:
        """Copy the inputs to ``memory``, in order."""
        at = 0
        for x in inputs:
            self.memory[at : at + x.size] = x
            at += x.size

    def _bind_and_call(self, *inputs: Any) -> Any:
        """Bind the builtin and call it."""
        self._take(self._bind(False))
        return self.call(*inputs)

    def _take(self, call: Callable[..., Any]) -> None:
        """Have another builtin."""
        self.call, self.plan = call, plan_of(call)

    def _bind(self, forces: bool) -> Callable[..., Any]:
        library, kind, otherwise = self.library, self.kind, self._following(forces)
        if not (library.has_builtins and kind.call):
            return unavailable
        if self.placed_rows is not None:
            words = {"placed_rows": self.placed_rows, "oMi": self.oMi, **self.stamp_words, **library.words}
            record = self.recording(1, self.result)
            return recorded_kinematics.jacobians.bind(words, library, record=record, otherwise=otherwise)
        code, record = library.code(kind.call, forces), self.recording(len(kind.inputs.split()), self.result)
        plan = kind.unused_inputs, kind.returns, self.result
        return recorded_calls.recorded_call(code, library.words, record, *plan, otherwise)

    def _following(self, forces: bool) -> Callable[..., Any]:
        """What a builtin calls that does not apply: if numbers were edited, it again, else it returns None."""
        here = ref(self)  # the builtin would be a cycle

        def follow(*inputs: Any) -> Any:
            run = here()
            if run is None or not run.follow():
                return None
            return run.forces_builtin(*inputs) if forces else run.call(*inputs)  # type: ignore[misc]

        return follow

    def follow(self) -> bool:
        """Whether numbers of the Model were edited, and are now those of the library."""
        before = self.library.state
        return self.library.follow() and self.library.state is not before

    def recording(self, count: int, result: Array | None = None) -> Words:
        """Words of a builtin that records its first inputs, this many, its result, if given, and the stamp."""
        return recorded_calls.record(count, self.memory, result, self._stamp, self.library.table)

    def hold(self, held: Mapping[str, Array], recompute_field: Callable[[Run, str], Any]) -> None:
        """Have calls write these held fields: the result itself in place, the others by builtin or recipe."""
        recomputes: list[Callable[[], Any]] = []
        result = self._own_result
        one_to_one = self.library.has_builtins and self.library.joints is None
        moving = self._moving(held) if one_to_one else {}
        by_call = {*held} if self.kind.places_path and one_to_one else {*moving}
        by_call |= {"D", "U"} if self.library.has_builtins else set()
        if self.placed_rows is not None and one_to_one:
            by_call.add("oMi")
            self.oMi = held.get("oMi")
        for name, x in held.items():
            recipe = self.kind.fills.get(name)
            if recipe is None or name in by_call:
                continue
            places = recipe is oMi and self.library.joints is None
            if (recipe is RESULT or (places and self.kind.call == "forward_kinematics")) and self._may_share(x):
                result = x
            else:
                recipe = joint_placements if places else recipe
                builtin = self._copy_builtin(recipe, x) or self._recompute_builtin(recipe, x)
                recomputes.append(builtin or partial(recompute_field, self, name))
        if moving and self.kind.call == "forward_kinematics":
            result = moving["oMi"]
        self.result_is_held = result is not self._own_result
        if result is not self.result and not self.result_is_held:
            result[...] = self.result
        if result is not self.result or moving or self.placed_rows is not None:
            self.result, self.forces_builtin = result, None
            self.call, self.plan = self._bind_and_call, None
        if moving:
            recomputes += self._bind_motions(moving)
        self.recompute = reduce(_both, recomputes) if recomputes else None

    def _moving(self, held: Mapping[str, Array]) -> dict[str, Array]:
        """Those of the held oMi, v and a that one builtin computes: none if not both oMi and v are held."""
        inputs = self.kind.inputs.split()
        found = {
            x: held[x] for x in ("oMi", "v", "a") if x in held and x in self.kind.fills and (x != "a" or x in inputs)
        }
        if not {"oMi", "v"} <= found.keys() or (self.kind.call == "forward_kinematics" and len(found) != len(inputs)):
            return {}
        return found

    def _bind_motions(self, moving: Mapping[str, Array]) -> list[Callable[[], Any]]:
        """A builtin that computes these fields; none if it is the call too, where that places the joints."""
        words = {"oMi": moving["oMi"], "v_out": moving["v"], "a_out": moving.get("a"), **self.library.words}
        routine = recorded_kinematics.accelerations if "a" in moving else recorded_kinematics.velocities
        if self.kind.call == "forward_kinematics":
            record, otherwise = self.recording(len(routine.inputs)), self._following(False)
            self._take(routine.bind(words, self.library, record=record, otherwise=otherwise))
            return []
        return [routine.bind({**words, **{x: getattr(self, x) for x in routine.inputs}}, self.library)]

    def _may_share(self, x: Array) -> bool:
        return x.shape == self.result.shape and self.kind.call != "aba"  # recipes of aba read its result as an input

    def _copy_builtin(self, recipe: Any, x: Array) -> Callable[[], Any] | None:
        """A builtin that copies the result, or a part of it, to x; None if the recipe is another."""
        found = self._own_result if recipe is RESULT else recipe(self) if isinstance(recipe, Part) else None
        if found is None or not self.library.has_builtins or found.shape != x.shape:
            return None
        return recorded_calls.copier(found, x)

    def _recompute_builtin(self, recipe: Any, x: Array) -> Callable[[], Any] | None:
        """A builtin that recomputes a field into x in place; None unless its recipe is a call of the library or Ig."""
        library = self.library
        if recipe is Ig and library.has_builtins and library.joints is None:
            inertias, n = library.numbers.inertias, library.words["njoints"]
            words = {"q": self.q, "bodies": inertias, "parents": library.parents, "Ig": x, **library.words}
            words |= {"poses": np.empty((n, 4, 4)), "sums": np.empty((n, 10))}
            return tree_kernels.place_robot_inertia.bind(words, library)
        if (
            not isinstance(recipe, CallRecipe)
            or not library.has_builtins
            or (recipe.joints and library.joints is not None)
        ):
            return None
        inputs = {name: getattr(self, name) for name in recipe.inputs.split()}
        spec = SPECS[recipe.call]
        if x.shape != core_shape(library._model, spec.output) or any(x.optional for x in spec.present):
            return None
        given = [inputs[x.name] for x in spec.present]
        return recorded_calls.rerun(library.code(recipe.call), given, x)


def _both(first: Callable[[], Any], second: Callable[[], Any]) -> Callable[[], Any]:
    """Both calls as one; None if one of them was not applicable."""
    return lambda: None if first() is None else second()


@cache
def _assigned_kind(name: str) -> Kind:
    return Kind("", "", {name: RESULT})


class Assigned(Run):
    """A field that was assigned whole, as a source of it."""

    __slots__ = ("stamp",)  # a slot: no builtin writes it

    def __init__(self, name: str, x: Array) -> None:
        """Of a field, with its array."""
        self.kind, self.q, self.recompute, self.cache = _assigned_kind(name), None, None, {}
        self.assign(name, x)

    def assign(self, name: str, x: Array) -> None:
        """The array is the field from now on."""
        self.result, self.stamp = x, clock()
        self.cache[name] = self.stamp, x

    def hold(self, held: Mapping[str, Array], recompute_field: Callable[[Run, str], Any]) -> None:
        """Do nothing: no call writes it again."""
