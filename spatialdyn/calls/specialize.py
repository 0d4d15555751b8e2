"""Programs made to measure: some calls of one model, with only the inputs that vary and the results that are wanted.

``specialize`` has what is asked for read into a ``Task``, recorded and compiled; ``Specialized`` is what is called.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ..engines.compiled import numba_kernels, quick_calls
from ..engines.programs import batch_kernels, float32_range
from ..engines.programs.source_code import PRINTERS, RESERVED
from ..engines.programs.tracer import Program
from ..errors import InertiaError, NonFiniteError, ShapeError, SpatialDynError
from ..model.model import Frame, Model
from ..model.robot import masked
from . import specialize_fallback
from .arguments import as_array, broadcast, rows_of
from .specialize_request import Input, Names, Task, shown, task_of


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
    dtype     float64, or float32: inputs are converted to it and results have it; see ``Specialized`` for its range
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
    task = task_of(model, calls, dtype, {} if fixed is None else fixed, inputs, outputs, frame, reference, classical)
    arguments = (model, calls, dtype, fixed, inputs, outputs, frame, reference, classical)
    own_class = type(Specialized.__name__, (Specialized,), {"__module__": __name__})  # see Specialized._make_quick
    made: Specialized = own_class(task, arguments)
    return made


class Specialized:
    """A program that is called like a function: ``k(q, v, a)`` of one sample or of batches, ``out=`` optional.

    Samples that the program does not answer for (angles beyond 1e5, NaN, joints without inertia) are computed by the
    kernel for any model, which says what is wrong with them; a float32 program's in float64.

    float32 holds 1e-38 to 3e38. Samples of which it may lose more than its rounding (inputs above 1e9, results above
    1e19, results below 1e-18 that inputs other than positions have part in) and models with a body beyond 1e-18 to
    1e18 (kg, kg m, kg m²) are computed in float64 from the inputs as they were given, some fifty times slower. Their
    results are then rounded to float32, below 1e-38 to a multiple of 1e-45, or 0; above 3e38 they are refused.

    signature        inputs left to be given and results, with their shapes
    engine           "lanes", or "untraced" where no program is: a long one (above ``batches.MOST_ROWS`` freedoms), a
                     joint that never moves inertia, a body out of float32's range, or NUMBA_DISABLE_JIT
    compile_seconds  spent so far on getting it compiled or from disk; what single samples need is made at the first
    program          the Program, whose ``listing()`` prints it
    operations       counts of mul, add, div, sqrt, sincos and atan2 of a sample, and depth

    ``c_code`` and ``python_code`` give the program as text, for any robot and any calls.

    Raises
        TypeError for another number of inputs than ``signature`` has
        ShapeError for sizes that do not fit, or an out that overlaps an input
        and the errors of the public calls for values
    """

    def __init__(self, task: Task, arguments: tuple[Any, ...]) -> None:
        """Record and compile; ``specialize`` reads the arguments into a task."""
        self._task, self._arguments = task, arguments
        self._inputs, self._shapes = task.inputs(), task.shapes()
        self._shape = self._shapes[0]
        narrow_only = task.dtype == np.float32
        self._driving = {x.name for x in task.arguments if narrow_only and x.unit != batch_kernels.POSITION}
        self.compile_seconds = 0.0
        self._kernel: batch_kernels.Kernel | None = None
        bodies = task.model.bodies
        held = task.dtype == np.float64 or not float32_range.beyond(bodies)
        if (
            held
            and not numba_kernels.PLAIN
            and batch_kernels.fits(task.specs, bodies, sum(map(math.prod, task.shapes())))
        ):
            self._kernel = self._compiled(one=False)
        self._quick = self._kernel is not None and task.dtype == np.float64
        self._single: batch_kernels.Kernel | None = None  # keeps the code of single samples in memory, and its plan
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
            made.append(f"{spec.output.name} {shown(spec.output.shape if task.wanted is None else shape)}")
        return f"({given}) -> " + (f"({', '.join(made)})" if task.several else made[0])

    @cached_property
    def _recorded(self) -> batch_kernels.Recorded:
        """The program and its layout, recorded anew when asked for. Raises InertiaError where there is none."""
        task = self._task
        static = tuple(task.static.values())
        try:
            return batch_kernels.record(task.specs, task.model.bodies, static, task.choice, task.dtype)
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

        Raises SpatialDynError if the name is none, an input's, or a word of C or of <math.h>; InertiaError where there
            is no program
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
        if name in RESERVED[language]:
            raise SpatialDynError(f"name is {name!r}, expected a name that has no meaning in {language.title()} yet")
        label = [x.name.partition(":") for x in self._inputs]
        known = {x.name for x in self._task.arguments}
        inputs = {
            kind if kind in known else f"{kind}_{k}": x.shape
            for k, ((kind, _, _), x) in enumerate(zip(label, self._inputs, strict=True), start=1)
        }
        if name in inputs:
            raise SpatialDynError(
                f"name is {name!r}, expected another than those of its arguments, {', '.join(inputs)}"
            )
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
        plan = quick_calls.plan(kernel.address, kernel.workspace, given + made)
        caller = quick_calls.caller(tuple(map(len, given)), tuple(map(len, made)))
        self._single, self._plan = kernel, plan
        kinds = tuple((x.name.partition(":")[0], bool(x.shape)) for x in self._inputs)
        call = _quick_call(kinds, tuple(map(bool, self._shapes)), self._task.several)
        type(self).__call__ = call(caller, int(plan.ctypes.data), *made)  # type: ignore[method-assign]

    def _compiled(self, one: bool) -> batch_kernels.Kernel | None:
        start, task = time.perf_counter(), self._task
        made = batch_kernels.kernel(
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
                if task.dtype == np.float32:  # what was lost on the way in may count here
                    arrays = [as_array(x.name, value) for x, value in zip(self._inputs, given, strict=True)]
                    stepped = [rows_of(a, batch, x.shape) for x, a in zip(self._inputs, arrays, strict=True)]
                specialize_fallback.compute(task, self._inputs, stepped, flat, batch, samples)
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
        if name in self._driving and not made.all():
            lost = (made == 0.0) & (x != 0.0)  # exact zeros, and no others, may make results of nothing
            made = np.where(lost, np.copysign(float32_range.SMALLEST, made), made)
        return made

    def _outs(self, out: Any, shapes: list[tuple[int, ...]], inputs: list[NDArray[Any]]) -> tuple[NDArray[Any], ...]:
        """``out`` as a tuple, if results can be written to it."""
        dtype = self._task.dtype
        outs = out if self._task.several else (out,)
        if not isinstance(outs, (tuple, list)) or len(outs) != len(shapes):
            raise ShapeError(f"out is {type(out).__name__}, expected a tuple of {len(shapes)} arrays")
        for x, shape in zip(outs, shapes, strict=True):
            if not isinstance(x, np.ndarray) or masked(x) or x.dtype != dtype or x.shape != shape:
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


def _quick_call(inputs: tuple[tuple[str, bool], ...], outputs: tuple[bool, ...], several: bool) -> Callable[..., Any]:
    """``__call__`` for float64 arrays of one sample, as a function of the caller, its plan and shapes of the results.

    Written out, because a loop over the arrays takes as long as the RNEA of an arm. Whatever does not fit goes the
    general way. ``inputs`` are names and whether they are arrays, ``outputs`` whether they are.
    """
    given = [f"{name}_{k}" for k, (name, _) in enumerate(inputs)]
    arrays = [name for name, (_, array) in zip(given, inputs, strict=True) if array]
    made, shapes = [f"y{k}" for k in range(len(outputs))], [f"shape{k}" for k in range(len(outputs))]
    # Numba looks neither at the byte order nor at a mask; equal dtypes may be two objects
    plain = "type({0}) is ndarray and ({0}.dtype is F8 or {0}.dtype == F8)"
    ready = " and ".join(plain.format(name) for name in arrays + made)
    ready += "".join(f" and isinstance({name}, (float, int))" for name in given if name not in arrays)
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
    scope: dict[str, Any] = {"empty": np.empty, "F8": np.dtype(np.float64), "ndarray": np.ndarray}
    exec(compile("\n".join(text), __file__, "exec"), scope)
    function: Callable[..., Any] = scope["make"]
    return function


def _lead(wanted: Input, x: NDArray[Any]) -> tuple[int, ...]:
    """What stands before one sample's shape. Raises ShapeError if the last axes are not that shape."""
    rank = len(wanted.shape)
    if x.ndim < rank or x.shape[x.ndim - rank :] != wanted.shape:
        raise ShapeError(f"{wanted.name} has shape {x.shape}, expected ({', '.join(['...', *map(str, wanted.shape)])})")
    return x.shape[: x.ndim - rank]
