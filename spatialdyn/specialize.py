"""Programs made to measure: some calls of one model, with only the inputs that vary and the results that are wanted.

``specialize`` reads what is asked for (``specs_of``, ``_inputs``, ``_fixed``, ``_wanted``) into a ``batches.Choice``,
which knows rows and columns in place of names, and has it recorded and compiled; ``Specialized`` is what is called.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from .border import (
    REFERENCES,
    as_array,
    broadcast,
    check_model,
    core_shape,
    frame_of,
    full_shape,
    reference_of,
    rows_of,
)
from .diagnosis import diagnose, unit_part
from .dynamics import calls as public
from .engines import batches, jit, parameters, quick
from .engines.parameters import Parameter
from .engines.source import PRINTERS
from .engines.trace import Program
from .errors import ConfigurationError, InertiaError, ModelError, NonFiniteError, ShapeError, SpatialDynError
from .model import Frame, Model
from .recursions import SPECS
from .recursions.checks import UNIT_TOLERANCE
from .recursions.spec import Argument, Spec

Names = str | Sequence[str] | Mapping[str, str | Sequence[str] | None]
KINDS = "fext, gravity, armature, payload, payload:FRAME, mass:JOINT, com:JOINT or inertia:JOINT"


def specialize(
    model: Model,
    calls: Callable[..., Any] | Sequence[Callable[..., Any]],
    dtype: DTypeLike = np.float64,
    fixed: Mapping[str, Any] | None = None,
    inputs: Names = (),
    outputs: str | int | Sequence[str | int] | None = None,
    frame: str | Frame | None = None,
    reference: str = "local",
    classical: bool = False,
) -> Specialized:
    """Some calls of one model as one compiled program, without what is fixed and what is not wanted.

    model     Model without mimic joints
    calls     a public call such as ``sd.rnea``, or several, which then share what they have in common
    dtype     float64, or float32: inputs are converted to it and results have it
    fixed     inputs of the calls that are constants, which vanish from the program: name -> a number, an array of the
              input's shape, or {joint name: its value}; in the last case the input keeps the other joints' entries,
              in their order. ``fixed={"v": 0, "a": 0}`` makes rnea the gravity torque.
    inputs    what else is an input, after the usual ones in this order: "fext" (in its usual place), "gravity" (3,),
              "armature" (nv,), and of what moves with a joint, all that is fixed to it included and in the joint's
              frame, "mass:JOINT" (), "com:JOINT" (3,), "inertia:JOINT" (6,), xx xy xz yy yz zz about the com;
              "payload:FRAME" (10,) adds a body in that frame: mass, com x y z, and its xx xy xz yy yz zz about the
              com; "payload" alone is in the frame of the last joint of a chain. Or a mapping: {"payload": "hand"}.
              They are used as given: a mass is not checked for its sign.
    outputs   names of joints, or indices, to which the axes "nv" and "njoints" of the results are restricted
    frame, reference, classical   of calls that take them

    Returns a callable: the remaining inputs in their usual order, each of any leading batch shape, and ``out=``.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> k = sd.specialize(model, sd.rnea, fixed={"v": 0, "a": 0}, inputs="payload")
    >>> k.signature
    '(q (nq,), payload (10,)) -> tau (nv,)'
    >>> k([0.3, 0.1], [1.5, 0, 0, 0, 0, 0, 0, 0, 0, 0]).shape
    (2,)

    Raises
        SpatialDynError for a call, dtype, input or output that is not known, with what is
        ModelError for a name that is not in the model, or a model with mimic joints
        ShapeError for a constant of the wrong shape, ConfigurationError for one of the wrong norm
    """
    if check_model(model).mimic_matrix is not None:
        raise ModelError(f'model "{model.name}" has mimic joints, expected one without (mimic=False) for a program')
    specs = specs_of(calls)
    optional, names, chosen = _inputs(model, inputs, specs)
    constants = _fixed(model, fixed or {}, specs)
    present = optional | {name for name in constants if constants[name].any()}
    specs = tuple(jit.variant(spec, frozenset(present & {x.name for x in spec.given})) for spec in specs)
    given = {x.name: x for spec in specs for x in spec.given}
    task = _Task(
        model=model,
        specs=specs,
        several=not callable(calls),
        dtype=_dtype(dtype),
        arguments=tuple(x for x in given.values() if not x.static),
        static=static_of(model, [x.name for x in given.values() if x.static], frame, reference, classical),
        constants={name: x for name, x in constants.items() if name in given},
        names=names,
        parameters=chosen,
        wanted=_wanted(model, outputs, specs),
    )
    arguments = (model, calls, dtype, fixed, inputs, outputs, frame, reference, classical)
    own_class = type(Specialized.__name__, (Specialized,), {"__module__": __name__})  # see Specialized._make_quick
    made: Specialized = own_class(task, arguments)
    return made


# --- reading what is asked for ---------------------------------------------------------------------------


class _Input(NamedTuple):
    """An input of the callable: its name, shape of a sample, and that shape in words."""

    name: str
    shape: tuple[int, ...]
    words: str


class _Task(NamedTuple):
    """What is to be computed. Constants are flat, NaN where the entry is an input; wanted (axes, places) per call."""

    model: Model
    specs: tuple[Spec, ...]
    several: bool
    dtype: np.dtype
    arguments: tuple[Argument, ...]
    static: dict[str, Any]
    constants: dict[str, NDArray[np.float64]]
    names: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    wanted: tuple[NDArray[np.intp], ...] | None

    @property
    def choice(self) -> batches.Choice:
        """The same for engines."""
        fixed = tuple((name, tuple(x.tolist())) for name, x in self.constants.items())
        places = () if self.wanted is None else tuple(tuple(x.ravel().tolist()) for x in self.wanted)
        return batches.Choice(fixed, self.parameters, places)

    def inputs(self) -> list[_Input]:
        """What is left to be given, in order."""
        left = []
        for x in self.arguments:
            core = core_shape(self.model, x)
            if x.name not in self.constants:
                left.append(_Input(x.name, core, _shown(x.shape)))
                continue
            count = int(np.isnan(self.constants[x.name]).sum())
            if count:
                core = (count // math.prod(core[1:]), *core[1:])
                left.append(_Input(x.name, core, _shown(core)))
        for name, p in zip(self.names, self.parameters, strict=True):
            left.append(_Input(name, parameters.shape(p, self.model.nv), _shown(parameters.SHAPES[p.kind])))
        return left

    def shapes(self) -> list[tuple[int, ...]]:
        """Shape of one sample of each result."""
        if self.wanted is None:
            return [core_shape(self.model, spec.output) for spec in self.specs]
        return [x.shape for x in self.wanted]


def _shown(shape: Sequence[str | int]) -> str:
    return f"({shape[0]},)" if len(shape) == 1 else f"({', '.join(map(str, shape))})"


def _dtype(dtype: DTypeLike) -> np.dtype:
    try:
        found = np.dtype(dtype)
    except TypeError:
        found = None
    if found not in (np.dtype(np.float64), np.dtype(np.float32)):
        raise SpatialDynError(f"dtype is {dtype!r}, expected float64 or float32")
    return np.dtype(found)


def specs_of(calls: Any) -> tuple[Spec, ...]:
    """The specs of a public call or several. Raises SpatialDynError for anything else."""
    by_function = {function: SPECS[name] for name, function in public.items()}
    listed = [calls] if callable(calls) else calls
    if not isinstance(listed, (list, tuple)) or not listed:
        raise SpatialDynError(f"calls is {calls!r}, expected a public call such as spatialdyn.rnea or a list of such")
    specs = []
    for function in listed:
        if not callable(function) or function not in by_function:
            name = getattr(function, "__name__", repr(function))
            raise SpatialDynError(f"calls has {name}, expected public calls such as spatialdyn.rnea")
        if by_function[function] in specs:
            raise SpatialDynError(f"calls has {by_function[function].name} twice, expected it once")
        specs.append(by_function[function])
    return tuple(specs)


def _inputs(
    model: Model, inputs: Names, specs: tuple[Spec, ...]
) -> tuple[set[str], tuple[str, ...], tuple[Parameter, ...]]:
    """Optional inputs that are to be given, then names of the parameters that are inputs, and the parameters."""
    optional: set[str] = set()
    chosen: dict[str, Parameter] = {}
    for name in _labels(inputs):
        kind, _, where = name.partition(":")
        if name in optional or name in chosen:
            raise SpatialDynError(f'inputs has "{name}" twice, expected it once')
        if any(x.name == name and x.optional for spec in specs for x in spec.given):
            optional.add(name)
        elif kind == "payload" and kind in parameters.SHAPES:
            chosen[name] = _payload(model, where)
        elif kind in parameters.OF_BODY and where:
            joint = model.joint(where)
            if not joint.row:
                raise ModelError(f'joint "{where}" does not move, expected one that carries a body for "{name}"')
            chosen[name] = Parameter(kind, joint.row)
        elif name in ("gravity", "armature"):
            chosen[name] = Parameter(name)
        else:
            raise SpatialDynError(f"inputs has {name!r}, expected {KINDS}")
    return optional, tuple(chosen), tuple(chosen.values())


def _labels(inputs: Any) -> list[str]:
    """Whatever form they come in as "kind" and "kind:where"."""
    if isinstance(inputs, str):
        return [inputs]
    if not isinstance(inputs, Mapping):
        return [str(name) for name in inputs]
    labels = []
    for kind, where in inputs.items():
        listed = [where] if where is None or isinstance(where, str) else where
        labels += [str(kind) if w is None else f"{kind}:{w}" for w in listed]
    return labels


def _payload(model: Model, where: str) -> Parameter:
    if where:
        row, placement = frame_of(model, where)
        if not row:
            raise ModelError(f'frame "{where}" is fixed in the world, expected one that moves for a payload')
        return Parameter("payload", row, parameters.place(placement))
    carriers = {j.parent for j in model.joints[1:]}
    tips = [j for k, j in enumerate(model.joints) if k and k not in carriers]
    if len(tips) != 1:
        raise ModelError(
            f'inputs has "payload" without a frame, and model "{model.name}" ends in {len(tips)} joints; '
            'expected "payload:FRAME"'
        )
    return Parameter("payload", tips[0].row, parameters.place(np.eye(4)))


def _fixed(model: Model, fixed: Mapping[str, Any], specs: tuple[Spec, ...]) -> dict[str, NDArray[np.float64]]:
    """Flat constants of each fixed input, NaN where it stays an input."""
    known = {x.name: x for spec in specs for x in spec.given if not x.static}
    found = {}
    for name, value in fixed.items():
        if name not in known:
            raise SpatialDynError(f'fixed has "{name}", expected one of {", ".join(known)}')
        core = core_shape(model, known[name])
        entries = np.full(core, math.nan)
        if isinstance(value, Mapping):
            for joint, part in value.items():
                at = _places(model, known[name], joint)
                entries[at] = _constant(f'{name} of joint "{joint}"', part, entries[at].shape)
        else:
            entries[...] = _constant(name, value, core)
        if known[name].unit_norm:
            _refuse_norms(model, name, entries)
        if not (known[name].optional and not entries.any()):
            found[name] = entries.ravel()
    return found


def _places(model: Model, argument: Argument, name: str) -> slice:
    """Where in the first axis of an input or output a joint has its entries."""
    joint = model.joint(name)
    first = argument.shape[0] if argument.shape else None
    if first == "nq" and joint.nq:
        return slice(joint.idx_q, joint.idx_q + joint.nq)
    if first == "nv" and joint.nv:
        return slice(joint.idx_v, joint.idx_v + joint.nv)
    if first == "njoints":
        index = model.names.index(name)
        return slice(index, index + 1)
    raise SpatialDynError(
        f'{argument.name} has no entries of joint "{name}", expected an input and joint that go together'
    )


def _constant(name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    x = as_array(name, value)
    if x.ndim and x.shape != shape and (1, *x.shape) != shape:
        raise ShapeError(f"fixed {name} has shape {x.shape}, expected {shape} or a number")
    if not np.isfinite(x).all():
        raise NonFiniteError(f"fixed {name} is {x.tolist()}, expected finite numbers")
    return x


def _refuse_norms(model: Model, name: str, q: NDArray[np.float64]) -> None:
    for joint in model.joints[1:]:
        first = model.bodies[joint.row - joint.nv + 1]
        part = unit_part(int(first["kind"]), int(first["at"]))
        if part is not None and abs(float(q[part] @ q[part]) - 1.0) > UNIT_TOLERANCE:
            raise ConfigurationError(
                f'fixed {name} is {q[part].tolist()} for joint "{joint.name}", expected a norm within 1e-6 of 1'
            )


def _wanted(model: Model, outputs: Any, specs: tuple[Spec, ...]) -> tuple[NDArray[np.intp], ...] | None:
    """For each call the places of its output, flat, that are wanted, in the shape of the result."""
    if outputs is None:
        return None
    listed = [outputs] if isinstance(outputs, (str, int)) else list(outputs)
    if not listed:
        raise SpatialDynError("outputs is empty, expected names of joints or indices, or None for all")
    if not any(isinstance(s, str) for spec in specs for s in spec.output.shape):
        raise SpatialDynError(f"outputs is {outputs!r}, expected None: no result has an entry per joint")
    wanted = []
    for spec in specs:
        core = core_shape(model, spec.output)
        axes = []
        for symbol, size in zip(spec.output.shape, core, strict=True):
            places: list[int] = []
            for what in listed if isinstance(symbol, str) else ():
                if isinstance(what, str):
                    places += range(size)[_places(model, Argument(spec.output.name, (symbol,), "", ""), what)]
                elif isinstance(what, (int, np.integer)) and not isinstance(what, bool) and 0 <= what < size:
                    places.append(int(what))
                else:
                    raise SpatialDynError(f"outputs has {what!r}, expected joint names or indices below {size}")
            if len(set(places)) < len(places):
                raise SpatialDynError(f"outputs is {outputs!r}, expected each entry of {spec.output.name} once")
            axes.append(places if isinstance(symbol, str) else list(range(size)))
        flat = np.arange(math.prod(core), dtype=np.intp).reshape(core)
        wanted.append(flat[np.ix_(*axes)])
    return tuple(wanted)


def static_of(
    model: Model, names: Iterable[str], frame: str | Frame | None, reference: str, classical: bool
) -> dict[str, Any]:
    """Values of the inputs that are no arrays of samples."""
    values: dict[str, Any] = {}
    names = set(names)
    if "row" in names:
        if frame is None:
            raise ModelError("frame is None, expected the name of one: a call takes it")
        values["row"], values["placement"] = frame_of(model, frame)
    elif frame is not None:
        raise SpatialDynError(f"frame is {frame!r}, expected None: no call takes one")
    code = reference_of(reference)
    if "reference" in names:
        values["reference"] = code
    elif code != REFERENCES["local"]:
        raise SpatialDynError(f"reference is {reference!r}, expected the default: no call takes one")
    if "classical" in names:
        values["classical"] = int(classical)
    elif classical:
        raise SpatialDynError("classical is True, expected the default: no call takes it")
    return values


# --- what is called --------------------------------------------------------------------------------------


class Specialized:
    """A program that is called like a function: ``k(q, v, a)`` of one sample or of batches, ``out=`` optional.

    Samples that the program does not answer for (angles beyond 1e5, NaN, joints without inertia) are computed by the
    kernel for any model, which says what is wrong with them; a float32 program's in float64.

    signature        inputs left to be given and results, with their shapes
    engine           "lanes", or "untraced" where no program is: a long one (above ``batches.MOST_ROWS`` freedoms), one
                     with an operation that has no vector form, a joint that never moves inertia, or NUMBA_DISABLE_JIT
    compile_seconds  spent so far on getting it compiled or from disk; what single samples need is made at the first
    program          the Program, whose ``listing()`` prints it
    operations       counts of mul, add, div, sqrt and sincos of a sample, and depth

    ``c_code`` and ``python_code`` give the program as text, for any robot and any calls.

    Raises
        TypeError for another number of inputs than ``signature`` has
        ShapeError for sizes that do not fit, or an out that overlaps an input
        and the errors of the public calls for values
    """

    def __init__(self, task: _Task, arguments: tuple[Any, ...]) -> None:
        """Record and compile; ``specialize`` reads the arguments into a task."""
        self._task, self._arguments = task, arguments
        self._inputs, self._shapes = task.inputs(), task.shapes()
        self._shape = self._shapes[0]
        self.compile_seconds = 0.0
        self._kernel: batches.Kernel | None = None
        if not jit.PLAIN and batches.fits(task.specs, task.model.bodies, sum(map(math.prod, task.shapes()))):
            self._kernel = self._compiled(one=False)
        self._quick = self._kernel is not None and task.dtype == np.float64
        self._single: batches.Kernel | None = None  # keeps the code of single samples in memory, and its plan
        self._plan: NDArray[np.int64] | None = None

    @property
    def model(self) -> Model:
        """The Model it was made for."""
        return self._task.model

    @property
    def dtype(self) -> np.dtype:
        """Of the results."""
        return self._task.dtype

    @property
    def engine(self) -> str:
        """How batches run."""
        return "untraced" if self._kernel is None else "lanes"

    @property
    def signature(self) -> str:
        """Inputs and results with the shapes of one sample."""
        task = self._task
        given = ", ".join(f"{x.name} {x.words}" for x in self._inputs)
        made = []
        for spec, shape in zip(task.specs, self._shapes, strict=True):
            made.append(f"{spec.output.name} {_shown(spec.output.shape if task.wanted is None else shape)}")
        return f"({given}) -> " + (f"({', '.join(made)})" if task.several else made[0])

    @cached_property
    def _recorded(self) -> batches.Recorded:
        """The program and its layout, recorded anew when asked for. Raises InertiaError where there is none."""
        task = self._task
        static = tuple(task.static.values())
        try:
            return batches.record(task.specs, task.model.bodies, static, task.choice, task.dtype)
        except ZeroDivisionError:
            what = "a joint that moves no inertia in any state"
            raise InertiaError(f'model "{task.model.name}" has {what}, expected none for a program') from None

    @property
    def program(self) -> Program:
        """The straight line of operations. Raises InertiaError where there is none."""
        return self._recorded.program

    def c_code(self, name: str | None = None) -> str:
        """The program as a C99 function ``void name(const double *q, ..., double *tau)`` that needs <math.h> only.

        It computes one sample, in arrays in C order, and checks nothing: where a joint moves no inertia it divides
        by zero. Masses and such that are inputs are named by kind and place, the third input ``mass_3``.

        name  of the function, by default that of the call, several joined by "_"

        Raises SpatialDynError if the name is none; InertiaError where there is no program
        """
        return self._code("c", name)

    def python_code(self, name: str | None = None) -> str:
        """The program as a Python function of arrays of any leading batch shape that needs NumPy only, as ``c_code``.

        >>> import spatialdyn as sd
        >>> k = sd.specialize(sd.load_urdf("two_link"), sd.generalized_gravity)
        >>> scope = {}
        >>> exec(k.python_code("gravity"), scope)
        >>> scope["gravity"]([0.0, 0.0]).round(9).tolist()
        [29.43, 9.81]
        """
        return self._code("python", name)

    def _code(self, language: str, name: str | None) -> str:
        specs, places = self._task.specs, self._recorded.layout.outputs
        name = "_".join(spec.name for spec in specs) if name is None else name
        if not (isinstance(name, str) and name.isascii() and name.isidentifier()):
            raise SpatialDynError(f"name is {name!r}, expected letters, digits and _")
        label = [x.name.partition(":") for x in self._inputs]
        known = {x.name for x in self._task.arguments}
        inputs = {
            kind if kind in known else f"{kind}_{k}": x.shape
            for k, ((kind, _, _), x) in enumerate(zip(label, self._inputs, strict=True), start=1)
        }
        outputs = {spec.output.name: shape for spec, shape in zip(specs, self._shapes, strict=True)}
        if len(outputs) < len(specs) or {name, *inputs} & set(outputs):
            outputs = {f"out_{k}": shape for k, shape in enumerate(self._shapes, start=1)}
        program = self.program.only(at for part in places for at in part)
        return PRINTERS[language](name, program, inputs, outputs)

    @property
    def operations(self) -> dict[str, int]:
        """What the program has to do for one sample."""
        return self.program.operations

    def __repr__(self) -> str:
        names = ", ".join(spec.name for spec in self._task.specs)
        return f'<Specialized {names} of "{self.model.name}": {self.signature}, {self.dtype}, {self.engine}>'

    def __reduce__(self) -> tuple[Any, ...]:
        return specialize, self._arguments

    def __call__(self, *arrays: ArrayLike, out: Any = None) -> Any:
        """Until a sample comes alone; from then on as ``_quick_call`` has it."""
        if self._quick and len(arrays) == len(self._inputs):
            ranks = [len(x.shape) for x in self._inputs]
            if all(np.ndim(x) == rank for x, rank in zip(arrays, ranks, strict=True)):
                self._make_quick()
                return type(self).__call__(self, *arrays, out=out)
        return self._general(arrays, out)

    # -- one sample

    def _make_quick(self) -> None:
        """Compile the program for single samples and put the shortest way to it in this object's own class."""
        self._quick = False
        kernel = self._compiled(one=True)
        if kernel is None:
            return
        made = [shape or (1,) for shape in self._shapes]
        given = [x.shape for x in self._inputs]
        plan = quick.plan(kernel.address, kernel.workspace, given + made)
        caller = quick.caller(tuple(map(len, given)), tuple(map(len, made)))
        self._single, self._plan = kernel, plan
        kinds = tuple((x.name.partition(":")[0], bool(x.shape)) for x in self._inputs)
        call = _quick_call(kinds, tuple(map(bool, self._shapes)), self._task.several)
        type(self).__call__ = call(caller, int(plan.ctypes.data), *made)  # type: ignore[method-assign]

    def _compiled(self, one: bool) -> batches.Kernel | None:
        start, task = time.perf_counter(), self._task
        made = batches.kernel(
            task.specs,
            task.model.bodies,
            task.model.key,
            tuple(task.static.values()),
            task.dtype,
            choice=task.choice,
            one=one,
        )
        self.compile_seconds += time.perf_counter() - start
        return made

    # -- any number of them

    def _general(self, given: tuple[Any, ...], out: Any) -> Any:
        """Whatever the quick way turned away: batches, lists, other dtypes, bad input."""
        task = self._task
        if len(given) != len(self._inputs):
            names = ", ".join(x.name for x in self._inputs)
            raise TypeError(f"{len(given)} inputs were given, expected {len(self._inputs)}: ({names})")
        arrays = [self._read(x.name, value) for x, value in zip(self._inputs, given, strict=True)]
        leads = [_lead(x, array) for x, array in zip(self._inputs, arrays, strict=True)]
        batch = broadcast([x.name for x in self._inputs], leads)
        whole = [batch + shape for shape in self._shapes]
        if out is None:
            results = tuple(np.empty(shape, task.dtype) for shape in whole)
        else:
            results = self._outs(out, whole, arrays)
        n = math.prod(batch)
        if n:
            stepped = [rows_of(a, batch, x.shape) for x, a in zip(self._inputs, arrays, strict=True)]
            flat = [x.reshape((n, -1)) for x in results]
            samples = None
            if self._kernel is not None:
                samples = self._kernel([x.reshape((len(x), -1)) for x, _ in stepped], flat)
            if samples is None:
                samples = np.arange(n)
            if len(samples):
                self._untraced(stepped, flat, batch, samples)
        if out is None and not batch:
            number = float if task.dtype == np.float64 else np.float32
            shown: tuple[Any, ...] = tuple(x if x.ndim else number(x) for x in results)
            return shown if task.several else shown[0]
        return results if task.several else results[0]

    def _read(self, name: str, value: Any) -> NDArray[Any]:
        dtype = self._task.dtype
        if type(value) is np.ndarray and value.dtype == dtype:
            return value
        x = as_array(name, value)
        with np.errstate(over="ignore"):
            made = x.astype(dtype, copy=False)
        if dtype == np.float32 and not np.isfinite(made[np.isfinite(x)]).all():
            raise NonFiniteError(f"{name} holds {abs(x[np.isfinite(x)]).max()}, expected the range of float32")
        return made

    def _outs(self, out: Any, shapes: list[tuple[int, ...]], inputs: list[NDArray[Any]]) -> tuple[NDArray[Any], ...]:
        """``out`` as a tuple, if results can be written to it."""
        dtype = self._task.dtype
        outs = out if self._task.several else (out,)
        if not isinstance(outs, (tuple, list)) or len(outs) != len(shapes):
            raise ShapeError(f"out is {type(out).__name__}, expected a tuple of {len(shapes)} arrays")
        for x, shape in zip(outs, shapes, strict=True):
            if not isinstance(x, np.ndarray) or x.dtype != dtype or x.shape != shape:
                what = f"shape {x.shape}, {x.dtype}" if isinstance(x, np.ndarray) else type(x).__name__
                raise ShapeError(f"out is {what}, expected an array of shape {shape}, {dtype}")
            if not (x.flags.c_contiguous and x.flags.writeable):
                raise ShapeError("out is not a writable array in C order")
        for k, x in enumerate(outs):
            others = [("another out", y) for y in outs[:k]]
            others += [(i.name, y) for i, y in zip(self._inputs, inputs, strict=True)]
            for name, y in others:
                if np.may_share_memory(x, y):
                    raise ShapeError(f"out overlaps {name} in memory, expected an array of its own")
        return tuple(outs)

    # -- what the program does not answer for

    def _untraced(
        self,
        stepped: list[tuple[NDArray[Any], int]],
        results: list[NDArray[Any]],
        batch: tuple[int, ...],
        samples: NDArray[np.intp],
    ) -> None:
        """These samples by the kernel for any model, in float64. Raises what went wrong."""
        taken = [(np.asarray(x[samples] if step else x, np.float64), step) for x, step in stepped]
        given = dict(zip((x.name for x in self._inputs), taken, strict=True))
        task, full = self._task, {}
        for x in task.arguments:
            core = full_shape(task.model, x) or (1,)
            if x.name not in task.constants:
                full[x.name] = given[x.name]
                continue
            constant = task.constants[x.name]
            rest, step = given.get(x.name, (np.empty((1, 0)), 0))
            entries = np.tile(constant, (len(rest), 1))
            entries[:, np.isnan(constant)] = rest.reshape(len(rest), -1)
            full[x.name] = entries.reshape((len(rest), *core)), step
        varied = [given[name] for name in task.names]
        everyone = np.arange(len(samples))
        groups = [everyone] if not any(step for _, step in varied) else list(everyone[:, None])
        for group in groups:
            model = task.model
            if varied:
                values = [x[group[0] * step].ravel().tolist() for x, step in varied]
                model = _with_bodies(model, parameters.changed(model.bodies, task.parameters, values))
            part = full if group is everyone else {k: (x[group] if s else x, s) for k, (x, s) in full.items()}
            self._by_kernel(model, part, results, batch, samples[group])

    def _by_kernel(
        self,
        model: Model,
        full: dict[str, tuple[NDArray[np.float64], int]],
        results: list[NDArray[Any]],
        batch: tuple[int, ...],
        samples: NDArray[np.intp],
    ) -> None:
        """Samples of one model, whole inputs, by the kernel of each call."""
        task, n = self._task, len(samples)
        for k, (spec, result) in enumerate(zip(task.specs, results, strict=True)):
            inputs = [full[x.name] for x in spec.given if not x.static]
            static = tuple(task.static[x.name] for x in spec.given if x.static)
            out = np.empty((n, *(full_shape(model, spec.output) or (1,))))
            status = np.empty(n, np.int8)
            passed = [part for pair in inputs for part in pair]
            bad = jit.batch(spec)(getattr(model, jit.TABLE), n, *passed, *static, out, status)
            flat = out.reshape((n, -1))
            if task.wanted is not None:
                flat = flat[:, task.wanted[k].ravel()]
            with np.errstate(over="ignore"):
                result[samples] = flat
            if bad:
                diagnose(spec, model, inputs, batch, static, out, status, samples)
            if task.dtype == np.float32 and not np.isfinite(result[samples][np.isfinite(flat)]).all():
                raise NonFiniteError(
                    f"{spec.name} leaves the range of float32, expected dtype=np.float64 for such input"
                )


def _quick_call(inputs: tuple[tuple[str, bool], ...], outputs: tuple[bool, ...], several: bool) -> Callable[..., Any]:
    """``__call__`` for float64 arrays of one sample, as a function of the caller, its plan and shapes of the results.

    Written out, because a loop over the arrays takes as long as the RNEA of an arm. Whatever does not fit goes the
    general way. ``inputs`` are names and whether they are arrays, ``outputs`` whether they are.
    """
    given = [f"{name}_{k}" for k, (name, _) in enumerate(inputs)]
    arrays = [name for name, (_, array) in zip(given, inputs, strict=True) if array]
    made, shapes = [f"y{k}" for k in range(len(outputs))], [f"shape{k}" for k in range(len(outputs))]
    ready = " and ".join(f"{name}.dtype is F8" for name in arrays + made)  # Numba does not look at the byte order
    results = [y if array else f"float({y}[0])" for y, array in zip(made, outputs, strict=True)]
    text = [
        f"def make(caller, plan, {', '.join(shapes)}):",
        f"    def call(self, {', '.join([*given, 'out=None'])}):",
        "        try:",
        "            if out is None:",
        *(f"                {y} = empty({shape})" for y, shape in zip(made, shapes, strict=True)),
        "            else:",
        f"                {', '.join(made) + ',' * several} = {'out' if all(outputs) else 'None'}",
        f"            if {ready} and not caller(plan, {', '.join(given + made)}):",
        f"                return {f'({chr(44).join(results)},)' if several else results[0]}",
        "        except (AttributeError, TypeError, ValueError):",
        "            pass",
        f"        return self._general(({''.join(f'{name}, ' for name in given)}), out)",
        "    call.__name__ = '__call__'",
        "    return call",
    ]
    scope: dict[str, Any] = {"empty": np.empty, "F8": np.dtype(np.float64)}
    exec(compile("\n".join(text), __file__, "exec"), scope)
    function: Callable[..., Any] = scope["make"]
    return function


def _lead(wanted: _Input, x: NDArray[Any]) -> tuple[int, ...]:
    """What stands before one sample's shape. Raises ShapeError if the last axes are not that shape."""
    rank = len(wanted.shape)
    if x.ndim < rank or x.shape[x.ndim - rank :] != wanted.shape:
        raise ShapeError(f"{wanted.name} has shape {x.shape}, expected ({', '.join(['...', *map(str, wanted.shape)])})")
    return x.shape[: x.ndim - rank]


def _with_bodies(model: Model, bodies: NDArray[Any]) -> Model:
    """The model with another table, to compute and to name joints with."""
    made: Model = object.__new__(Model)
    for slot in Model.__slots__:
        if slot != "__weakref__":
            object.__setattr__(made, slot, getattr(model, slot))
    object.__setattr__(made, "bodies", bodies)
    object.__setattr__(made, "address", bodies.ctypes.data)
    return made
