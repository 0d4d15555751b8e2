"""Control laws: Specs that give joint torques of q, v and states of their own, with values of their other inputs.

A law is written as any recursion is, and recorded into the program of a step. Its numbers are inputs, or are read where
it is recorded: kernels of a law that carries numbers of its own are kept by the content of the recorded program, never
by its name, so that another law of the same name does not meet an old kernel.
"""

from __future__ import annotations

import dis
import hashlib
import math
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...bodies.static_table import StaticTable
from ...calls.arguments import as_array, as_flag, check_model, core_shape
from ...engines.compiled.numba_kernels import variant
from ...engines.programs import batch_kernels, recording, structure
from ...engines.programs.mimic_rows import MimicRows
from ...engines.programs.recording import Recording
from ...engines.programs.tracer import evaluate, table
from ...errors import ModelError, ShapeError, SimulationError, SpatialDynError
from ...model.model import Model
from ...recursions.friction import DT
from ...recursions.spec import TAU, Argument, Q, Spec, V, shape_in, sizes_of
from ..arithmetic import Arithmetic
from ..methods import EXPLICIT_METHODS, SCIPY_METHODS
from .effect import Effect

Array = NDArray[Any]
Law = Callable[[Any, Any, Any, Mapping[str, Any]], tuple[Any, dict[str, Any]]]
RATE, AFTER = "_rate", "_after"  # endings of a state's part
OWN_INPUT = "control."  # before the names of a law's inputs among those of a step
OF_STEP = (Q.name, V.name, TAU.name, DT.name)  # inputs that the step gives
NUMBERS = (int, float, complex, list, dict, np.ndarray, np.generic)  # what a law may not read but as an input
OWN_MODULES = __name__.partition(".")[0] + "."
CODE = (types.FunctionType, types.BuiltinFunctionType, types.ModuleType, type)  # what a law may close over


class Control:
    """A control law of a run: a Spec of joint torques, and values of its inputs.

    spec    Spec whose output is tau (nv), or whose parts are tau and then one for each of its states, in their order:
            NAME_rate, integrated by the method of the run as v is, or NAME_after, the state at the end of a step, of
            inputs at its beginning. Its inputs are any of q, v, tau (the torque of the arguments alone), dt (the
            step), its states, and others. A law of time has a clock, a state whose rate is 1
    values  {name: array} of the others: of the input's shape, with an axis of steps before it, or in a rollout with
            axes of samples and steps
    held    False: the law acts wherever the method evaluates forces. True: its torque is that of the beginning
            of a step, held over it as by a digital controller

    The torque is added to the argument torque of ``simulate``, or tau of ``rollout``.
    Raises  SimulationError for a Spec that is no control law, for values that are missing or unknown, and for a
            recursion that closes over numbers, which are to be inputs.

    >>> import numpy as np, spatialdyn as sd
    >>> from spatialdyn.recursions.spec import TAU, Argument, Q, Spec, V
    >>> def integral(bodies, q, v, reach, past, tau, past_rate):
    ...     for i in range(len(tau)):
    ...         tau[i] = 60.0 * (reach[i] - q[i]) - 8.0 * v[i] + 40.0 * past[i]
    ...         past_rate[i] = reach[i] - q[i]
    >>> REACH, PAST = Argument("reach", ("nv",), "rad", "goal"), Argument("past", ("nv",), "rad s", "", start=0.0)
    >>> PARTS = TAU, Argument("past_rate", ("nv",), "rad", "error")
    >>> law = Spec("integral", integral, None, (Q, V, REACH, PAST), TAU, "PID.", "", parts=PARTS)
    >>> model = sd.load_urdf("two_link")
    >>> run = sd.simulate(model, [0, 0], [0, 0], 8.0, 5e-3, control=sd.Control(law, {"reach": [0.5, 0.2]}))
    >>> bool(abs(run.q[-1] - [0.5, 0.2]).max() < 2e-2), run.states["past"].shape
    (True, (1601, 2))
    """

    def __init__(self, spec: Spec, values: Mapping[str, Any] | None = None, held: bool = False) -> None:
        """Check the Spec, and keep copies of the values."""
        check_recordable(spec)
        _check_parts(spec)
        self.held = as_flag("held", held)
        self.spec, self.values, self.static = with_values(spec, values)

    def __repr__(self) -> str:
        return f"<Control: {self.spec.name}{', held' if self.held else ''}>"

    def axes(self, model: Model) -> dict[str, tuple[int, ...]]:
        """Axes before those of the input, of each value that has any, named: of steps, or of samples and steps."""
        found = {}
        for name, (x, core) in zip(self._given, self._cores(check_model(model)), strict=True):
            found[f'{name} of spec "{self.spec.name}"'] = x.shape[: x.ndim - len(core)]
        return {name: lead for name, lead in found.items() if lead}

    @property
    def batched(self) -> bool:
        """Whether a value has an axis of samples."""
        inputs = {x.name: x for x in self.spec.present}
        return any(x.ndim - len(inputs[name].shape) > 1 for name, x in self.values.items())

    @property
    def _given(self) -> list[str]:
        """The names of the values, in the order of the Spec."""
        return [x.name for x in self.spec.present if x.name in self.values]

    def _cores(self, model: Model) -> list[tuple[Array, tuple[int, ...]]]:
        """The values, and the shapes of their inputs."""
        spec = self.spec
        return [(self.values[x.name], core_shape(model, x, self.static)) for x in spec.present if x.name in self.values]

    def rows(self, model: Model, samples: int, steps: int) -> dict[str, Array]:
        """Values (samples or 1, steps or 1, columns) by the names of a step's inputs. Raises ShapeError."""
        found = {}
        for name, (value, core) in zip(self._given, self._cores(check_model(model)), strict=True):
            lead = value.shape[: value.ndim - len(core)]
            allowed = [(1, x) for x in (samples, steps)[max(0, 2 - len(lead)) :]]
            fits = len(lead) <= 2 and all(a in b for a, b in zip(lead, allowed, strict=True))
            if value.shape[len(lead) :] != core or not fits:
                shapes = f"{core}, {(steps, *core)} or {(samples, steps, *core)}"
                raise ShapeError(f'{name} of spec "{self.spec.name}" has shape {value.shape}, expected {shapes}')
            rows = value.reshape((1,) * (2 - len(lead)) + lead + (-1,))
            found[OWN_INPUT + name] = np.ascontiguousarray(rows)
        return found


def check_control(control: Any) -> Control | None:
    """The argument ``control``. Raises SimulationError for something else than a Control or None."""
    if control is not None and not isinstance(control, Control):
        raise SimulationError(f"control is {shown(control)}, expected a Control or None")
    return control


def check_law(control: Control | None, method: str) -> None:
    """Raise SimulationError where SciPy's methods cannot take a control law."""
    if control is None or method not in SCIPY_METHODS:
        return
    ends = len(control.spec.states) - len(moved_states(control.spec))
    if control.held or ends:
        which = "is held over a step" if control.held else "has states that change at the end of a step"
        raise SimulationError(
            f'control "{control.spec.name}" {which}, expected a fixed step for it: {", ".join(EXPLICIT_METHODS)}'
        )


def shown(given: Any) -> str:
    """What stands in place of a Control or a Cost: of a Spec, which is long, its name."""
    return f'the Spec "{given.name}"' if isinstance(given, Spec) else repr(given)


# --- a law in a step ------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Feedback(Effect):
    """A control law of a run.

    spec    of the law
    held    whether its torque is that of the beginning of a step
    static  values of its static inputs
    rows    (samples or 1, steps or 1, columns) of the others
    """

    spec: Spec
    held: bool
    static: tuple[Any, ...] = ()
    rows: Mapping[str, Array] = field(default_factory=dict)
    name = "control"

    @classmethod
    def of(cls, control: Control, model: Model, samples: int, steps: int) -> Feedback:
        """The law of a run of so many samples and steps. Raises ShapeError."""
        return cls(control.spec, control.held, control.static, control.rows(model, samples, steps))

    def structure(self) -> Feedback:
        """See ``Effect``."""
        return Feedback(self.spec, self.held)

    @property
    def form(self) -> Any:
        """See ``Effect``."""
        return self.spec, self.held

    @property
    def inputs(self) -> Any:
        """See ``Effect``."""
        return inputs_of(self.spec)

    @property
    def states(self) -> Any:
        """See ``Effect``."""
        return states_of(self.spec)

    @property
    def tables(self) -> tuple[Any, ...]:
        """See ``Effect``."""
        return self.static

    @property
    def values(self) -> dict[str, Array]:
        """See ``Effect``."""
        return dict(self.rows)

    @property
    def integrated(self) -> tuple[str, ...]:
        """Names of the states that have rates."""
        return moved_states(self.spec)

    def law(self, at: Arithmetic) -> Law:
        """``(q, v, tau, states) -> tau, made``: the torque, and rates or ends of its states."""
        spec = self.spec
        if at.recorded:
            return law_on(spec, at.rows, at.given)
        tables = {OWN_INPUT + x.name: _static_rows(at.given[OWN_INPUT + x.name]) for x in spec.present if x.static}
        recorded = law_on(spec, at.rows, {**at.given, **tables})

        def law(q: Any, v: Any, tau: Any, states: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
            wanted, made = recorded(q, v, tau, states)
            return np.asarray(wanted, float), {name: np.asarray(x, float) for name, x in made.items()}

        return law


def _static_rows(value: Any) -> Any:
    return table(value.rows) if hasattr(value, "rows") else value


def _of_step(x: Argument) -> Argument:
    """An input of a law as one of a step."""
    return replace(x, name=OWN_INPUT + x.name, optional=False, unit_norm=False)


def states_of(spec: Spec) -> tuple[Argument, ...]:
    """The states of a law, as a step names them."""
    return tuple(_of_step(x) for x in spec.states)


def moved_states(spec: Spec) -> tuple[str, ...]:
    """Names in a step of the states that have rates."""
    ends = (part.name for part in spec.parts[1:])
    return tuple(OWN_INPUT + x.name for x, end in zip(spec.states, ends, strict=True) if end == x.name + RATE)


def inputs_of(spec: Spec) -> tuple[Argument, ...]:
    """The inputs of a law beside q, v, dt and its states, as a step names them, static ones last."""
    found = [x for x in spec.present if x.start is None and x.name not in OF_STEP]
    return tuple(_of_step(x) for x in sorted(found, key=lambda x: x.static))


def law_on(spec: Spec, rows: Sequence[Any], inputs: Mapping[str, Any]) -> Law:
    """``(q, v, tau, states) -> tau, rates or ends of states`` on a table of Rows; ``inputs`` are those of a step."""
    parts = spec.parts or (spec.output,)

    def law(q: Any, v: Any, tau: Any, states: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
        given = {Q.name: q, V.name: v, TAU.name: tau}
        for x in spec.present:
            if x.name not in given:
                name = x.name if x.name in OF_STEP else OWN_INPUT + x.name
                given[x.name] = states[name] if name in states else inputs[name]
        sizes = sizes_of(rows, [(x, given[x.name]) for x in spec.present if x.table is not None])
        widths = [math.prod(shape_in(x.shape, sizes)) for x in parts]
        out = evaluated(spec, rows, (sum(widths),), given)
        wanted, *made = np.split(out, np.cumsum(widths)[:-1])
        return wanted, {OWN_INPUT + x.name: y for x, y in zip(spec.states, made, strict=True)}

    return law


def evaluated(
    spec: Spec, rows: Sequence[Any], shape: tuple[int, ...], inputs: Mapping[str, Any], start: float = 0.0
) -> Any:
    """``tracer.evaluate`` of a caller's Spec, whose name is in its errors. ``start`` is what is not written."""
    try:
        return evaluate(spec, rows, shape, inputs, np.zeros(len(rows) - 1, object), start)
    except SpatialDynError:
        raise
    except AttributeError as error:
        if not isinstance(rows, MimicRows):
            raise
        raise ModelError(
            f'spec "{spec.name}" walks the tree of a robot with mimic joints ({error}), expected one of their own '
            "coordinates: rnea, crba and aba may be called"
        ) from None
    except (TypeError, ValueError, IndexError, ZeroDivisionError) as error:
        named = f'spec "{spec.name}": '
        kind = ZeroDivisionError if isinstance(error, ZeroDivisionError) else TypeError
        raise kind(named + str(error).removeprefix(named)) from error


# --- checks ---------------------------------------------------------------------------------------------


def check_recordable(spec: Any) -> None:
    """Raise SimulationError for what is no Spec, or one that no program can be made of for all values."""
    if not isinstance(spec, Spec):
        raise SimulationError(f"spec is {spec!r}, expected a Spec")
    if not spec.traceable:
        raise SimulationError(f'spec "{spec.name}" branches on values, expected one that can be recorded')
    _refuse_constants(spec)


def with_values(spec: Spec, given: Mapping[str, Any] | None) -> tuple[Spec, dict[str, Any], tuple[Any, ...]]:
    """A law without the optional inputs that have no value, copies of the values of the others, of static ones last.

    Raises SimulationError for values that are missing or unknown, or no mapping.
    """
    if given is not None and not isinstance(given, Mapping):
        raise SimulationError(f'values of spec "{spec.name}" are {given!r}, expected a mapping of names to arrays')
    given = dict(given or {})
    others = {x.name: x for x in spec.present if x.start is None and x.name not in OF_STEP}
    for name in given:
        if name not in others:
            listed = f"some of {', '.join(others)}" if others else "none"
            raise SimulationError(f'values of spec "{spec.name}" have {name}, expected {listed}')
    missing = [name for name, x in others.items() if name not in given and not x.optional]
    if missing:
        raise SimulationError(f'values of spec "{spec.name}" lack {", ".join(missing)}')
    spec = variant(spec, given) if any(x.optional for x in spec.present) else spec
    known = [x for x in spec.present if x.name in given]
    static = tuple(_static(x.name, given[x.name]) for x in known if x.static)
    return spec, {x.name: as_array(x.name, given[x.name]) for x in known if not x.static}, static


def _static(name: str, value: Any) -> Any:
    """The value of a static input: an int, or the table of Constraints and their like. Raises SimulationError."""
    found = getattr(value, "table", value)
    if isinstance(found, (bool, np.bool_)) or not isinstance(found, (int, np.integer, StaticTable)):
        raise SimulationError(f"{name} is {value!r}, expected an int, or an object with a table, as static inputs are")
    return found if isinstance(found, StaticTable) else int(found)


def _refuse_constants(spec: Spec) -> None:
    """Raise SimulationError for a recursion that reads numbers which are no inputs: what was compiled keeps them.

    Also for a function that it calls, other than the library's own.
    """
    seen: set[int] = set()
    waiting: list[Any] = [spec.recursion]
    while waiting:
        function = waiting.pop()
        if isinstance(function, types.MethodType):
            raise SimulationError(
                f'recursion of spec "{spec.name}" is or calls a method, {function.__qualname__}, expected functions: '
                "what an object holds is no input"
            )
        if id(function) in seen or not isinstance(function, types.FunctionType):
            continue
        seen.add(id(function))
        for name, held in _read(function):
            if isinstance(held, NUMBERS) or (name in function.__code__.co_freevars and not isinstance(held, CODE)):
                raise SimulationError(
                    f'recursion of spec "{spec.name}" reads {name} = {held!r} in {function.__name__}, expected '
                    f'functions only: make {name} an input, Argument("{name}", ...), and give it in values'
                )
            if isinstance(held, (types.FunctionType, types.MethodType)) and not held.__module__.startswith(OWN_MODULES):
                waiting.append(held)


def _read(function: types.FunctionType) -> list[tuple[str, Any]]:
    """What a function reads from around it: its closure, and the globals that its code names."""
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    found = [(name, cell.cell_contents) for name, cell in cells]
    codes = [function.__code__]
    while codes:
        code = codes.pop()
        codes += [x for x in code.co_consts if isinstance(x, types.CodeType)]
        found += [(name, function.__globals__[name]) for name in _globals(code) if name in function.__globals__]
    return found


@lru_cache(maxsize=256)
def _globals(code: types.CodeType) -> tuple[str, ...]:
    """The globals that a code names; disassembling it takes 0.1 ms, in the loop of a controller that plans."""
    return tuple(sorted({x.argval for x in dis.get_instructions(code) if x.opname == "LOAD_GLOBAL"}))


def _check_parts(spec: Spec) -> None:
    """Raise SimulationError unless the output is tau, and a rate or an end of each state."""
    names = [x.name for x in spec.parts] or [spec.output.name]
    states = spec.states
    good = len(names) == 1 + len(states) and names[0] == TAU.name
    good = good and all(name in (x.name + RATE, x.name + AFTER) for name, x in zip(names[1:], states, strict=True))
    if not good:
        wanted = ", ".join([TAU.name, *(f"{x.name}{RATE} or {x.name}{AFTER}" for x in states)])
        raise SimulationError(f'spec "{spec.name}" has the outputs {", ".join(names)}, expected {wanted}')


# --- kernels and torques --------------------------------------------------------------------------------


@lru_cache(maxsize=32)
def recorded(
    specs: tuple[Spec, ...], model: Model, static: tuple[Any, ...], dtype: np.dtype
) -> tuple[Recording | None, str]:
    """The recording of Specs that have a control law in them, and the digest of its content: their key in caches.

    None if a joint has zero articulated inertia.
    """
    try:
        made = recording.record(specs, model.bodies, static, dtype=dtype)
    except ZeroDivisionError:
        return None, model.key
    found = hashlib.sha256(structure.digest(*made).encode())
    found.update(structure.Numbers(*made).values(np.float64).tobytes())
    return made, found.hexdigest()


def step_kernel(
    specs: tuple[Spec, ...], model: Model, static: tuple[Any, ...], dtype: Any = np.float64, one: bool = False,
    by_content: bool = False,
) -> Any:  # fmt: skip
    """The kernel of a step's Specs, None if a joint has zero articulated inertia; by content if a law is in them."""
    if not by_content:
        return batch_kernels.kernel(specs, model.bodies, model.key, static, dtype=dtype, one=one)
    made, key = recorded(specs, model, static, np.dtype(dtype))
    if made is None:
        return None
    return batch_kernels.kernel(specs, model.bodies, key, static, dtype=dtype, one=one, recorded=made)


def law_torques(
    control: Control, model: Model, q: Array, v: Array, tau: Array, states: Mapping[str, Array], steps: Array,
    dt: float, total: int,
) -> Array:  # fmt: skip
    """The law's torques (N, nv) in samples of a run, at the beginning of these steps (N,); tau is that of arguments."""
    given: dict[str, Array] = {Q.name: q, V.name: v, TAU.name: tau, DT.name: np.full((len(q), 1), dt), **states}
    for name, rows in control.rows(model, 1, total).items():
        given[name.removeprefix(OWN_INPUT)] = rows[0, np.minimum(steps, rows.shape[1] - 1)]
    inputs = [x for x in control.spec.present if not x.static]
    columns = [y for x in inputs for y in given[x.name].reshape((len(q), -1)).T]
    made = recording.record((_torque(control.spec),), model.bodies, control.static).program
    with np.errstate(all="ignore"):
        found = made.run(columns)
    return np.stack([np.broadcast_to(np.asarray(x, float), len(q)) for x in found[: model.nv]], 1)


def _torque(spec: Spec) -> Spec:
    """The law as a call whose output is the torque alone."""
    inputs = tuple(replace(x, unit_norm=False, optional=False) for x in spec.present)

    def recursion(rows: Any, *arrays: Any) -> None:
        given = {(x.name if x.name in OF_STEP else OWN_INPUT + x.name): y for x, y in zip(inputs, arrays, strict=False)}
        arrays[-1][:] = law_on(spec, rows, given)(given.get(Q.name), given.get(V.name), given.get(TAU.name), {})[0]

    made = Spec(f"{spec.name}_torque", recursion, None, inputs, TAU, spec.summary, spec.source, regroup=spec.regroup)
    return replace(made, composed=True)
