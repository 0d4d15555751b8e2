"""Face: a row of the table of names, and the function made from it.

It is a builtin that finds the plan of the last such call in a Run, or of calls about a frame in a Bound, of a Data;
where that does not apply the row's ``answer`` checks the arguments. The rows are in ``algorithms/table.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from sys import intern
from types import FunctionType
from typing import Any, NamedTuple

from ....engines.programs.llvm.call_words import ARRAY, NUMBER
from ....engines.programs.run.single_call import READY, Following, Parameter, builtin, unavailable
from ..model.model import Model
from ..types.arguments import OMITTED, ArgumentError
from ..types.frame import LOCAL, Convention
from ..types.se3 import SE3
from .data import Data
from .dispatch import by_default, compute, last_call, with_pose
from .field_recipes import CALL_KINDS
from .run import Bound, Run

REFUSED = AttributeError, IndexError, KeyError, TypeError, ValueError  # the fast path does not apply
REQUIRED: Any = object()  # the default of an argument that has to be given
LOCALLY, WORLD = Convention.LOCAL, Convention.WORLD
ERRORS = "Raises ArgumentError, a TypeError, for a wrong type, ShapeError, a ValueError, for a wrong size."


class Input(NamedTuple):
    """An argument: its name, role, type and meaning, and what it is if it is left out.

    Roles: x, a vector that is recorded; f, external forces; o, an option; i, an index; r, a reference frame; p, a pose;
    n, another that the plan of a Model takes.
    """

    name: str
    role: str
    type: str
    about: str
    default: Any = REQUIRED

    @property
    def text(self) -> str:
        """Its name and default, in a signature."""
        if self.default is REQUIRED:
            return self.name
        x = self.default
        return f"{self.name}={f'{type(x).__name__}.{x.name}' if isinstance(x, Enum) else repr(x)}"

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
    bound      whether there is one
    overloads  lists of arguments, for type checkers, if ``inputs`` stands for several
    of_data    whether it takes a Data: ``name(model, *inputs)`` without; the plan is then one of the Model
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
    of_data: bool = True

    @property
    def fields(self) -> tuple[str, ...]:
        """The fields of Data that it fills."""
        return tuple(CALL_KINDS[self.call[-1]].fills) if self.of_data and self.call[-1] in CALL_KINDS else ()

    @cached_property
    def vectors(self) -> tuple[str, ...]:
        """Names of the inputs that are recorded."""
        return tuple(x.name for x in self.inputs if x.role == "x")

    @cached_property
    def least(self) -> int:
        """How many of them the first kind takes."""
        return len(self.vectors) + 1 - len(self.call)

    @property
    def of_joints(self) -> bool:
        """Whether an index is a joint's."""
        return "Frame" not in self.name

    @property
    def about_frame(self) -> bool:
        """Whether it is a call about a joint's frame or a frame."""
        return self.inputs[:1] != () and self.inputs[0].role == "i"

    @property
    def first(self) -> list[str]:
        """The parameters before the inputs."""
        return ["model", "data"] if self.of_data else ["model"]

    @property
    def signature(self) -> str:
        """Parameters and defaults, as a builtin's docstring has them."""
        return f"({', '.join([*self.first, *(x.text for x in self.inputs)])})"

    @property
    def docstring(self) -> str:
        """``doc``, with a line for each input, the fields and the errors."""
        inputs = "\n".join(f"{x.name}  {x.about}" for x in self.inputs if x.about)
        fields = f"It fills data.{', '.join(self.fields)}; each is computed at its first read." if self.fields else ""
        return "\n\n".join(filter(None, [self.doc, inputs, fields, ERRORS]))


def by_run(face: Face, model: Any, data: Any, *given: Any) -> Any:
    """Call the builtin of a Run, else check the arguments, compute the call and record it."""
    kind, inputs, fext = (face.read or _as_given)(face, model, data, *given)
    run, result = data._runs.get(kind) if type(data) is Data else None, None
    if run is not None and run.library is getattr(model, "_library", None):
        result = run.call(*inputs) if fext is None else run.call_with_forces(fext, *inputs)
        if result is not None:
            data.note_builtin_call(run)
    if result is None:
        run, result = compute(model, data, kind, inputs, fext)
    return None if face.returns == "None" else result if face.made is None else face.made(run, result)


def forces_given(fext: Any) -> Any:
    """External forces, None if they are left out. Raises ArgumentError for None."""
    if fext is None:
        raise ArgumentError("fext is None, expected a list of Force")
    return None if fext is OMITTED else fext


def _as_given(face: Face, model: Any, data: Any, *given: Any) -> tuple[str, tuple[Any, ...], Any]:
    """Kind, inputs and forces: the inputs that are given choose one of several kinds."""
    names, least = face.vectors, face.least
    inputs, fext = given[: len(names)], forces_given(given[len(names)]) if len(given) > len(names) else None
    if face.last and inputs[0] is OMITTED:
        run = last_call(model, data, face.last)
        inputs = tuple(getattr(run, name).copy() for name in names)
    while len(inputs) > least and inputs[-1] is OMITTED:
        inputs = inputs[:-1]
    return face.call[len(inputs) - least], inputs, fext


# --- the functions --------------------------------------------------------------------------------------------


def _form(face: Face, answer: Any) -> Any:
    """A function of the number of inputs of a row, which tries the builtin of a Run if there are external forces, and
    that of a frame at a pose if its reference is left out.
    """
    kind, roles = face.call[0], "".join(x.role for x in face.inputs)

    def pushed(model: Any, data: Any, f: Any, *x: Any) -> Any:
        if f is OMITTED:
            return None
        try:
            run = data._runs[kind]
            if run.library is model._library and (found := run.call_with_forces(f, *x)) is not None:
                if run.after is not None or run.recompute is not None:
                    data.note_builtin_call(run)
                return found
        except REFUSED:
            pass
        return None

    def with_option(model: Any, data: Any, a: Any, b: Any, c: Any, f: Any, option: Any) -> Any:
        found = pushed(model, data, f, a, b, c) if option is LOCALLY else None
        return answer(face, model, data, a, b, c, f, option) if found is None else found

    def three(model: Any, data: Any, a: Any, b: Any, c: Any, f: Any) -> Any:
        found = pushed(model, data, f, a, b, c)
        return answer(face, model, data, a, b, c, f) if found is None else found

    def one(model: Any, data: Any, a: Any, f: Any) -> Any:
        found = pushed(model, data, f, a)
        return answer(face, model, data, a, f) if found is None else found

    def at_pose(model: Any, data: Any, x: Any, reference: Any, after: Any, other: Any, pose: Any) -> Any:
        if type(reference) is SE3 and after is None:
            try:
                bound = data._bound[with_pose(face.name)]
                if bound.owner is model._frame_placements and (found := bound.call(x, reference, LOCAL)) is not None:
                    return found
            except REFUSED:
                pass
        return answer(face, model, data, x, reference, after, other, pose)

    if roles == "irrip" and any(x.default is LOCAL for x in face.inputs):
        return at_pose
    if "f" in roles:
        return {"xf": one, "xxxf": three, "xxxfo": with_option}[roles]
    forms: tuple[Any, ...] = (
        lambda model: answer(face, model),
        lambda model, data: answer(face, model, data),
        lambda model, data, a: answer(face, model, data, a),
        lambda model, data, a, b: answer(face, model, data, a, b),
        lambda model, data, a, b, c: answer(face, model, data, a, b, c),
        lambda model, data, a, b, c, d, e: answer(face, model, data, a, b, c, d, e),
    )
    return forms[min(len(face.first) + len(roles), 6) - 1]


def _key(face: Face, chosen: Sequence[Input]) -> str:
    """The kind of a call with these of the optional inputs; "" if no builtin takes them: forces, or gaps."""
    given = [x.name for x in face.inputs if x.role == "x" and (x.default is REQUIRED or x in chosen)]
    at = len(given) - face.least
    if at < 0 or given != [*face.vectors[: len(given)]] or any(x.role == "f" for x in chosen):
        return ""
    return face.call[at] + "_world" * any(x.role == "o" for x in chosen)


def _frame_key(face: Face, chosen: Sequence[Input]) -> str:
    """The key of a call about a frame with these of the optional inputs; "" if no builtin takes them."""
    given = [k for k, x in enumerate(face.inputs) if x.default is REQUIRED or x in chosen]
    keys = by_default(face.name) if face.inputs[1].default is LOCAL else "", face.name, with_pose(face.name)
    return keys[len(given) - 1] if given in ([0], [0, 1], [0, 1, 2]) else ""


def key_of_model(face: Face, *chosen: str) -> str:
    """The key of a row without a Data, with all or none of the optional inputs; "" for others, and with a Data."""
    optional = [x.name for x in face.inputs if x.default is not REQUIRED]
    return " ".join([face.name, *chosen]) if [*chosen] in ([], optional) and "data" not in chosen else ""


def _builtin(face: Face, python: Callable[..., Any], k: int, count: int) -> Callable[..., Any]:
    """The builtin of a row, which calls a Python function where it does not apply."""
    switches = [isinstance(x.default, Convention) for x in face.inputs]
    parameters = [
        Parameter(intern(x.name), NUMBER if x.role == "o" and not switch else ARRAY, x.default is not REQUIRED)
        for x, switch in zip(face.inputs, switches, strict=True)
    ]
    optional = [x for x, (_, kind, left) in zip(face.inputs, parameters, strict=True) if left and kind == ARRAY]
    choices = ([x for n, x in enumerate(optional) if bits >> n & 1] for bits in range(1 << len(optional)))
    made = None if face.returns == "None" else face.made or unavailable
    switch = switches.index(True) if any(switches) else -1
    if not face.of_data:
        listed = [intern(key_of_model(face, *(x.name for x in chosen))) for chosen in choices]
        return builtin(k, count, python, parameters, listed, Model, None, face.signature, nones=True)
    framed = face.about_frame
    key_of, runs, owner = (_frame_key, "_bound", "owner") if framed else (_key, "_runs", "library")
    attribute, run = "_frame_placements" if framed and not face.of_joints else "_library", Bound if framed else Run
    slots = owner, "plan", "after", "recompute"
    functions = Data.recompute_held, Run.follow, made
    following = Following(Data, runs, "_noted", attribute, run, *slots, *functions, switch, LOCALLY, WORLD)
    keys = [intern(key_of(face, x)) for x in choices]
    return builtin(k, count, python, parameters, keys, None, following, face.signature, nones=True)


def function(face: Face, module: str, k: int, count: int) -> Callable[..., Any]:
    """The function of row ``k`` of ``count``: a builtin, or a copy of a form with names and defaults of its inputs."""
    form = _form(face, face.answer or by_run)
    code, names = form.__code__, (*face.first, *(x.name for x in face.inputs))
    code = code.replace(co_name=face.name, co_varnames=(*names, *code.co_varnames[len(names) :]))
    defaults = tuple(x.default for x in face.inputs if x.default is not REQUIRED)
    made = FunctionType(code, form.__globals__, face.name, defaults, form.__closure__)
    made.__doc__, made.__module__, made.__qualname__ = face.docstring, module, face.name
    made.__annotations__ = {x.name: x.type for x in face.inputs} | {"return": face.returns}
    if not (READY and face.bound) or any(x.role == "f" and x.default is REQUIRED for x in face.inputs):
        return made
    return _builtin(face, made, k, count)
