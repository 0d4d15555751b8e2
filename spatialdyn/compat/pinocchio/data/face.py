"""Face: a row of the table of names, and the function made from it.

The function is a copy of one of the forms below under the names of the row: it calls the builtin of a Run, or of a
frame, and where none applies the row's ``answer``, which checks the arguments. The rows are in ``algorithms/table.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import FunctionType
from typing import Any, NamedTuple

from ..types.frame import LOCAL, Convention
from ..types.se3 import SE3
from .dispatch import compute, last_call, placed_name
from .field_recipes import CALL_KINDS

REFUSED = AttributeError, IndexError, KeyError, TypeError, ValueError  # the fast path does not apply
REQUIRED: Any = object()  # the default of an argument that has to be given
LOCALLY, WORLD = Convention.LOCAL, Convention.WORLD
ERRORS = "Raises ArgumentError, a TypeError, for a wrong type, ShapeError, a ValueError, for a wrong size."


class Input(NamedTuple):
    """An argument: its name, role, type and meaning; what it is if it is left out; whether the builtin takes any value.

    Roles: x, a vector that is recorded; f, external forces; o, an option; i, an index; r, a reference frame; p, a pose.
    """

    name: str
    role: str
    type: str
    about: str
    default: Any = REQUIRED
    any_value: bool = False

    def otherwise(self, default: Any) -> Input:
        """The argument, with this default."""
        return self._replace(default=default)


@dataclass(frozen=True)
class Face:
    """A row: a function ``name(model, data, *inputs)``.

    call       the CALL_KINDS that answer, one for each number of inputs; of a call about a frame the library's call
    doc        what it returns; inputs, fields and errors are added
    returns    type of that
    last       field whose last call has the inputs that are left out, and those of a call about a frame
    read       kind, inputs and external forces of the arguments, if these are not as the kind takes them
    made       what is returned, from the Run and the new array
    answer     what answers where no builtin does
    bound      whether one is bound to frames
    overloads  lists of arguments, for type checkers, if ``inputs`` stands for several
    """

    name: str
    inputs: tuple[Input, ...]
    call: tuple[str, ...]
    doc: str
    returns: str = "Array"
    last: str = ""
    read: Callable[..., tuple[str, tuple[Any, ...], Any]] | None = None
    made: Callable[[Any, Any], Any] | None = None
    answer: Callable[..., Any] | None = None
    bound: bool = True
    overloads: tuple[tuple[Input, ...], ...] = ()

    @property
    def fields(self) -> tuple[str, ...]:
        """The fields of Data that it fills."""
        return tuple(CALL_KINDS[self.call[-1]].fills) if self.call[-1] in CALL_KINDS else ()

    @property
    def of_joints(self) -> bool:
        """Whether an index is a joint's."""
        return "Frame" not in self.name

    @property
    def docstring(self) -> str:
        """``doc``, with a line for each input, the fields and the errors."""
        inputs = "\n".join(f"{x.name}  {x.about}" for x in self.inputs if x.about)
        fields = f"It fills data.{', '.join(self.fields)}; each is computed at its first read." if self.fields else ""
        return "\n\n".join(filter(None, [self.doc, inputs, fields, ERRORS]))


def by_run(face: Face, model: Any, data: Any, *given: Any) -> Any:
    """Check the arguments, compute the call and record it."""
    kind, inputs, fext = (face.read or _as_given)(face, model, data, *given)
    run, result = compute(model, data, kind, inputs, fext)
    return None if face.returns == "None" else result if face.made is None else face.made(run, result)


def _as_given(face: Face, model: Any, data: Any, *given: Any) -> tuple[str, tuple[Any, ...], Any]:
    """Kind, inputs and forces: the inputs that are not None choose one of several kinds."""
    names = [x.name for x in face.inputs if x.role == "x"]
    inputs, (fext,) = given[: len(names)], given[len(names) :] or (None,)
    if face.last and inputs[0] is None:
        run = last_call(model, data, face.last)
        inputs = tuple(getattr(run, name).copy() for name in names)
    least = len(names) + 1 - len(face.call)
    while len(inputs) > least and inputs[-1] is None:
        inputs = inputs[:-1]
    return face.call[len(inputs) - least], inputs, fext


# --- the forms, by the roles of their inputs ----------------------------------------------------------------


def _vectors(face: Face, answer: Any) -> dict[str, Any]:
    """Calls that a Run records."""
    kind, made, silent = face.call[0], face.made or (lambda run, result: result), face.returns == "None"
    plain = face.made is None and not silent

    def one(model: Any, data: Any, x: Any) -> Any:
        try:
            run = data._runs[kind]
            if run.library is model._library and (result := run.call(x)) is not None:
                if run.getters and data._latest["J"] is not run:
                    data.note_latest(run)
                if run.recompute is not None and run.recompute() is None:
                    data.recompute_held(run)
                return result if plain else None if silent else made(run, result)
        except REFUSED:
            pass
        return answer(face, model, data, x)

    def two(model: Any, data: Any, x: Any, y: Any) -> Any:
        try:
            run = data._runs[kind]
            if run.library is model._library and (result := run.call(x, y)) is not None:
                if run.getters and data._latest["J"] is not run:
                    data.note_latest(run)
                if run.recompute is not None and run.recompute() is None:
                    data.recompute_held(run)
                return result if plain else None if silent else made(run, result)
        except REFUSED:
            pass
        return answer(face, model, data, x, y)

    def three(model: Any, data: Any, x: Any, y: Any, z: Any) -> Any:
        try:
            run = data._runs[kind]
            if run.library is model._library and (result := run.call(x, y, z)) is not None:
                if run.getters and data._latest["J"] is not run:
                    data.note_latest(run)
                if run.recompute is not None and run.recompute() is None:
                    data.recompute_held(run)
                return result if plain else made(run, result)
        except REFUSED:
            pass
        return answer(face, model, data, x, y, z)

    return {"x": one, "xx": two, "xxx": three}


def _with_options(face: Face, answer: Any) -> dict[str, Any]:
    """Calls that a Run records, with external forces and options."""
    kind, any_value = face.call[0], face.inputs[-1].any_value
    world = f"{kind}_world"

    def one_option(model: Any, data: Any, x: Any, option: Any) -> Any:
        try:
            run = data._runs[kind if any_value or option is LOCALLY else world if option is WORLD else ""]
            if run.library is model._library and (result := run.call(x)) is not None:
                if run.getters and data._latest["J"] is not run:
                    data.note_latest(run)
                if run.recompute is not None and run.recompute() is None:
                    data.recompute_held(run)
                return result
        except REFUSED:
            pass
        return answer(face, model, data, x, option)

    def forced(model: Any, data: Any, x: Any, y: Any, z: Any, fext: Any) -> Any:
        try:
            run = data._runs[kind]
            if run.library is model._library:
                result = run.call(x, y, z) if fext is None else run.call_with_forces(fext, x, y, z)
                if result is not None:
                    if run.getters and data._latest["J"] is not run:
                        data.note_latest(run)
                    if run.recompute is not None and run.recompute() is None:
                        data.recompute_held(run)
                    return result
        except REFUSED:
            pass
        return answer(face, model, data, x, y, z, fext)

    def forced_option(model: Any, data: Any, x: Any, y: Any, z: Any, fext: Any, option: Any) -> Any:
        try:
            run = data._runs[kind if option is LOCALLY else world if option is WORLD else ""]
            if run.library is model._library:
                result = run.call(x, y, z) if fext is None else run.call_with_forces(fext, x, y, z)
                if result is not None:
                    if run.getters and data._latest["J"] is not run:
                        data.note_latest(run)
                    if run.recompute is not None and run.recompute() is None:
                        data.recompute_held(run)
                    return result
        except REFUSED:
            pass
        return answer(face, model, data, x, y, z, fext, option)

    def one_forced(model: Any, data: Any, x: Any, fext: Any) -> Any:
        try:
            run = data._runs[kind]
            if run.library is model._library and (result := run.call_with_forces(fext, x)) is not None:
                if run.getters and data._latest["J"] is not run:
                    data.note_latest(run)
                if run.recompute is not None and run.recompute() is None:
                    data.recompute_held(run)
                return result
        except REFUSED:
            pass
        return answer(face, model, data, x, fext)

    return {"xo": one_option, "xf": one_forced, "xxxf": forced, "xxxfo": forced_option}


def _levels(face: Face, answer: Any) -> dict[str, Any]:
    """Calls that a Run records, by another kind for each number of inputs."""
    first, second, third = face.call[0], face.call[-2], face.call[-1]

    def levels(model: Any, data: Any, x: Any, y: Any, z: Any) -> Any:
        try:
            run = data._runs[first if y is None else second if z is None else third]
            if run.library is model._library:
                result = run.call(x) if y is None else run.call(x, y) if z is None else run.call(x, y, z)
                if result is not None:
                    if run.getters and data._latest["J"] is not run:
                        data.note_latest(run)
                    if run.recompute is not None and run.recompute() is None:
                        data.recompute_held(run)
                    return None
        except REFUSED:
            pass
        return answer(face, model, data, x, y, z)

    def levels_options(model: Any, data: Any, x: Any, y: Any, z: Any, option: Any, other: Any) -> Any:
        try:
            run = data._runs[first if y is None else second if z is None else third]
            if run.library is model._library:
                result = run.call(x) if y is None else run.call(x, y) if z is None else run.call(x, y, z)
                if result is not None:
                    if run.recompute is not None and run.recompute() is None:
                        data.recompute_held(run)
                    return result
        except REFUSED:
            pass
        return answer(face, model, data, x, y, z, option, other)

    return {"xxx": levels, "xxxoo": levels_options}


def _frames(face: Face, answer: Any) -> dict[str, Any]:
    """Calls about a joint's frame or a frame: by a builtin of the Data, or of the last Run that filled a Jacobian."""
    name, placed, last, bound = face.name, placed_name(face.name), face.last, face.bound

    def joint(model: Any, data: Any, x: Any, reference: Any) -> Any:
        if not bound:
            return answer(face, model, data, x, reference)
        try:
            frames, call = (data._latest[last].bound if last else data._bound)[name]
            if frames is model._library.frames and (found := call(x, reference)) is not None:
                return found
        except REFUSED:
            pass
        return answer(face, model, data, x, reference)

    def frame(model: Any, data: Any, x: Any, reference: Any, after: Any, other: Any, pose: Any) -> Any:
        if not bound:
            return answer(face, model, data, x, reference, after, other, pose)
        try:
            frames, call = (data._latest[last].bound if last else data._bound)[name]
            if frames is model._frame_placements and (found := call(x, reference)) is not None:
                return found
        except REFUSED:
            pass
        if type(reference) is SE3:
            try:
                frames, call = (data._latest[last].bound if last else data._bound)[placed]
                if frames.joints is model._library.frames.joints:
                    frames.places[x][...] = reference._x
                    if (found := call(x, LOCAL if after is None else after)) is not None:
                        return found
            except REFUSED:
                pass
        return answer(face, model, data, x, reference, after, other, pose)

    return {"ir": joint, "iroip": frame}


def function(face: Face, module: str) -> Callable[..., Any]:
    """The function of a row: a copy of the form of its inputs' roles, with their names and defaults."""
    roles = "".join(x.role for x in face.inputs)
    plain = _vectors if {*roles} == {"x"} else _with_options
    forms = _frames if roles[0] == "i" else _levels if face.call[1:] else plain
    form = forms(face, face.answer or by_run)[roles]
    code, names = form.__code__, ("model", "data", *(x.name for x in face.inputs))
    code = code.replace(co_name=face.name, co_varnames=(*names, *code.co_varnames[len(names) :]))
    defaults = tuple(x.default for x in face.inputs if x.default is not REQUIRED)
    made = FunctionType(code, form.__globals__, face.name, defaults, form.__closure__)
    made.__doc__, made.__module__, made.__qualname__ = face.docstring, module, face.name
    made.__annotations__ = {x.name: x.type for x in face.inputs} | {"return": face.returns}
    return made
