"""The compiled program of calls of one model, which ``specialize`` and ``bounded`` make from a SpecializeRequest."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..engines import object_layout
from ..engines.compiled import numba_kernels
from ..engines.programs.llvm.call_words import ARRAY, MOST, MOST_OUTPUTS, NUMBER, OUT
from ..engines.programs.record import recording
from ..engines.programs.record.program import Program
from ..engines.programs.run import batch_kernels, single_call
from ..engines.programs.run.single_call import Parameter
from ..engines.programs.transform import derived, float32_range
from ..engines.programs.transform.source_code import PRINTERS
from ..errors import InertiaError, NonFiniteError, ShapeError, SpatialDynError, literal
from ..model.model import Model
from ..model.robot_checks import masked
from ..recursions import SPECS
from . import specialize_fallback
from .arguments import as_array, as_flag, broadcast, empty, flatten_batch
from .differentiable import Differentiable
from .exported import MOST_DERIVATIVES, derivatives_of, exported, jacobian_of
from .specialize_request import Array, SpecializeRequest


def check_program(made: Specialized, what: str) -> Specialized:
    """Raise SpatialDynError if there is no program, naming ``what`` needs one, the cause, and what to do instead."""
    if made.engine == "untraced":
        names, request = ", ".join(made.calls), made._request
        cause, otherwise = f"has no program in {made.dtype}", ""
        rows, most = len(request.model.bodies) - 1, min(map(recording.most_rows, request.specs))
        if numba_kernels.PLAIN:
            cause = f"has no program under NUMBA_DISABLE_JIT in {made.dtype}"
        elif rows > most:
            cause += f" with {rows} rows of the table of bodies, at most {most}"
            otherwise = "".join(f"; {instead}, for any robot" for instead in _instead(made.calls, what))
        elif request.numbers > recording.MOST_RESULTS:
            cause += f" with {request.numbers} results, at most {recording.MOST_RESULTS}"
            otherwise = "; outputs= leaves some of them"
        raise SpatialDynError(f'{names} of "{made.model.name}" {cause}, expected one for {what}{otherwise}')
    return made


def _instead(calls: Sequence[str], what: str) -> list[str]:
    """What a user can call in place of programs that are too long."""
    if what == "bounds":
        return ["sd.exact computes any number of digits"]
    found = [f"{name}_derivatives" for name in calls if f"{name}_derivatives" in SPECS]
    return [f"sd.{name} computes them" for name in found] if what.startswith("deriv") else []


def recorded(request: SpecializeRequest, options: recording.ProgramOptions) -> recording.Recording:
    """The program of a request and its layout, not compiled.

    Raises InertiaError if there is none, SpatialDynError for more than MOST_DERIVATIVES results, as of the mass matrix
    of 363 joints.
    """
    static = tuple(request.static.values())
    if request.numbers > MOST_DERIVATIVES:
        names = ", ".join(spec.name for spec in request.specs)
        found = f'{names} of "{request.model.name}" has {request.numbers} results'
        expected = f"expected at most {MOST_DERIVATIVES} in a program; outputs= leaves some of them"
        raise SpatialDynError(f"{found}, {expected}")
    try:
        return derived.record(request.specs, request.model.bodies, static, options, request.dtype)
    except ZeroDivisionError:
        what = "a joint with zero articulated inertia in every state"
        raise InertiaError(f'model "{request.model.name}" has {what}, expected none for a program') from None


def of_request(
    request: SpecializeRequest, maker: Callable[..., Specialized], arguments: tuple[Any, ...]
) -> Specialized:
    """The Specialized of a request; it pickles as the public function and arguments that made it."""
    own_class = type(Specialized.__name__, (Specialized,), {"__module__": __name__})  # see Specialized._compile_single
    made: Specialized = own_class(request, maker, arguments)
    return made


def derivative_of(k: Specialized, directions: int, weighted: bool) -> Specialized:
    """The program of a derivative of k with respect to the entries of its inputs, in float64: along ``directions``
    directions, and if ``weighted`` of Σ weight · result by each input. Raises SpatialDynError without a program.
    """
    arguments = (k, directions, weighted)
    return check_program(of_request(derivative_request(*arguments), derivative_of, arguments), "derivatives")


def derivative_request(k: Specialized, directions: int, weighted: bool) -> SpecializeRequest:
    """The request of ``derivative_of``, or without directions and weights that of the program itself.

    Raises SpatialDynError if k has bounds or derivatives of its own.
    """
    request = k._request
    if request.bounds or request.derivative:
        raise SpatialDynError(f"{literal(k)} has further results, expected results alone to differentiate")
    if not (directions or weighted):
        return request
    derivative = f"along {directions}" + (" weighted" if weighted else "")
    return request._replace(dtype=np.dtype(np.float64), derivative=derivative, several=True)


def results_of_rows(k: Specialized, rows: Sequence[NDArray[Any]]) -> list[NDArray[Any]] | None:
    """Results (n, ...) of inputs (n, columns) of a program's dtype in C order, without argument checks.

    Returns None if not applicable: without a program, without rows, or if the program rejects one of them.
    """
    n = len(rows[0])
    if k._kernel is None or not n:
        return None
    made = [np.empty((n, *shape), k.dtype) for shape in k._shapes]
    left = k._kernel(rows, [x.reshape((n, -1)) for x in made], False)
    return made if left is not None and not len(left) else None


class Specialized:
    """A compiled program, called like a function: ``k(q, v, a)`` for one sample or batches, ``out=`` optional.

    Samples beyond the program's range (angles above 1e5, NaN, joints without inertia) are recomputed in float64 by the
    recursion in NumPy; errors are those of the public calls.

    float32 has a range of 1e-38 to 3e38. Samples that may lose more than rounding in float32 (inputs above 1e9, results
    above 1e19, results below 1e-18 that depend on inputs other than positions) and models with a body outside 1e-18
    to 1e18 (kg, kg m, kg m²) are computed in float64 from the inputs as given, far slower. Their results are then
    rounded to float32, below 1e-38 to a multiple of 1e-45 or 0; above 3e38 NonFiniteError is raised.

    signature        remaining inputs and results, with their shapes
    engine           "lanes", or "untraced" without a program: too many degrees of freedom to record, a joint with zero
                     articulated inertia in every state, a body outside float32's range, or NUMBA_DISABLE_JIT
    compile_seconds  time spent so far on compiling or loading from disk; the first single sample adds its compilation
    program          the Program; ``listing()`` prints it
    operations       counts of mul, add, div, sqrt, sincos and atan2 for a sample, and depth

    ``c_code`` and ``python_code`` give the program as text, ``to_casadi``, ``to_jax`` and ``to_torch`` as a function
    with derivatives in another framework, for any robot and any calls.

    Raises
        TypeError if the number of inputs is not that of ``signature``
        ShapeError for shapes that do not match, or an out that overlaps an input
        the errors of the public calls for values
    """

    _kernel: batch_kernels.Kernel | None

    def __init__(
        self, request: SpecializeRequest, maker: Callable[..., Specialized], arguments: tuple[Any, ...]
    ) -> None:
        """Record and compile the program of a request. ``maker(*arguments)`` makes an equal Specialized."""
        if not isinstance(request, SpecializeRequest):
            raise SpatialDynError(f"request is a {type(request).__name__}, expected specialize(model, calls)")
        self._read_request(request, (maker, arguments))
        if self._fits:
            self._kernel = self._compile(one=False)
        self._single_due = self._kernel is not None and request.dtype == np.float64

    def _read_request(self, request: SpecializeRequest, made_by: tuple[Any, ...]) -> None:
        """Set the attributes that need no kernel."""
        self._request, self._made_by = request, made_by
        self._inputs, self._results = request.inputs(), request.results()
        self._shapes = [x.shape for x in self._results]
        narrow_only = request.dtype == np.float32
        self._driving = {x.name for x in request.arguments if narrow_only and x.unit != recording.POSITION}
        self.compile_seconds = 0.0
        self._kernel = None
        self._single_due = False
        self._watches_bounds = request.bounds and narrow_only

    @property
    def _fits(self) -> bool:
        """Whether there is a program, if no joint has zero articulated inertia."""
        request = self._request
        bodies, numbers = request.model.bodies, request.numbers
        in_range = request.dtype == np.float64 or not float32_range.beyond(bodies)
        return in_range and not numba_kernels.PLAIN and recording.fits(request.specs, bodies, numbers, request.tables)

    @property
    def model(self) -> Model:
        """The Model."""
        return self._request.model

    @property
    def dtype(self) -> np.dtype:
        """dtype of the results."""
        return self._request.dtype

    @property
    def calls(self) -> tuple[str, ...]:
        """Names of the calls."""
        return tuple(spec.name for spec in self._request.specs)

    @property
    def engine(self) -> str:
        """The engine of batches: "lanes" or "untraced"."""
        return "untraced" if self._kernel is None else "lanes"

    @property
    def signature(self) -> str:
        """Inputs and results with the shapes of one sample."""
        request = self._request
        given = ", ".join(f"{x.name} {x.shape_text}" for x in self._inputs)
        results = [f"{x.name} {x.shape_text}" for x in self._results]
        return f"({given}) -> " + (f"({', '.join(results)})" if request.several else results[0])

    @cached_property
    def _recorded(self) -> recording.Recording:
        """The program and its layout, recorded again at first use. Raises InertiaError if there is none."""
        return self._record(self._request.options)

    @cached_property
    def _straight(self) -> recording.Recording:
        """The same in a straight line, if its loops are short."""
        if not self._recorded.program.regions:
            return self._recorded
        return self._record(self._request.options._replace(straight=True))

    def _record(self, options: recording.ProgramOptions) -> recording.Recording:
        return recorded(self._request, options)

    @property
    def program(self) -> Program:
        """The program, in a straight line but for loops. Raises InertiaError if there is none."""
        return self._recorded.program

    @cached_property
    def _threads(self) -> Any:
        """The program for GPU threads, loaded on a GPU at its first use there."""
        from ..engines.programs.gpu.gpu_kernel import GpuKernel

        return GpuKernel(*self._recorded, self.dtype)

    @property
    def ptx(self) -> str:
        """The program for one thread of a GPU as PTX, the assembly text that the driver compiles; on any machine.

        Raises InertiaError if there is no program, SpatialDynError if it is too long for a thread
        """
        made: str = self._threads.ptx
        return made

    def c_code(self, name: str | None = None, derivatives: bool = False) -> str:
        """The program as a C99 function ``void name(const double *q, ..., double *tau)`` that needs <math.h> only.

        It computes one sample, in arrays in C order, without argument checks: if a joint has zero articulated inertia
        it divides by zero. Parameters are named by kind and position, since joint names need not be identifiers: a
        mass as third input is ``mass_3``, a payload as fourth ``payload_4``.

        name         of the function, by default the names of the calls, joined by "_"
        derivatives  True: with the external interface of CasADi: ``name`` and ``jac_name``, the derivatives of each
                     result by each input, for ``casadi.external`` and acados, with matrices stored by columns.
                     Derivatives with respect to a configuration are by its entries: with quaternions or (cos, sin)
                     pairs only directions that keep unit norms have a meaning. There is no ``jac_jac_name``, so no
                     second derivative

        Raises SpatialDynError if the name is no identifier, an input's, or reserved in C: keywords, names that begin
            with "_", declarations of <math.h>, functions of the standard library; or for more than 131072 results or
            derivatives; InertiaError if there is no program
        """
        if not as_flag("derivatives", derivatives):
            return self._code("c", name)
        given = exported(self._request, self._straight, "c", name)
        from ..engines.programs.transform.casadi_code import casadi_code

        return casadi_code(given.name, given.program, jacobian_of(self._request, given), given.inputs, given.outputs)

    def to_casadi(self, name: str | None = None, jacobian: bool = True) -> Any:
        """The program as a ``casadi.Function`` of one sample, with named inputs and results.

        It takes numbers, SX and MX. In MX graphs, nested ones and those of ``factory`` too, it is one node, whose
        Jacobian is that of ``c_code``: for rnea and aba by their own recursions, in about half the operations of
        CasADi's. A derivative along one direction, forward or reverse, is a program of its own with the operations of
        two to three calls. A Hessian of functions of the results is a program too, with a quarter (rnea) to a sixth
        (aba) of CasADi's instructions, if the inputs have at most 36 entries (12 joints); for more it is CasADi's
        derivative of the reverse one. Inputs are named as in ``c_code``: a payload as fourth input is ``payload_4``.
        There are no argument checks and no range: a joint with zero articulated inertia divides by zero. The same holds
        for ``bounded``: where its program has an infinite bound (angles above 1e5, joints of hardly any articulated
        inertia, numbers beyond the range), the exported function returns a finite number that bounds nothing.
        Derivatives with respect to a configuration are by its entries, as always in CasADi: with quaternions or (cos,
        sin) pairs export the next configuration too, by ``sd.integrate``, so that everything stays in coordinates.

        name      as in ``c_code``
        jacobian  False leaves the derivatives to CasADi, also in an MX graph; the export takes a fraction of the time

        Raises SpatialDynError as ``c_code`` with derivatives, and if CasADi is not installed (extra "casadi")
        """
        from ..interop.casadi import to_casadi

        own = as_flag("jacobian", jacobian)
        given = exported(self._request, self._straight, "c", name)
        return to_casadi(given, derivatives_of(self._request, given) if own else None)

    def to_jax(self) -> Callable[..., Any]:
        """The program as a function of JAX arrays, for jit, vmap, scan, pmap, and first and second derivatives.

        On the CPU XLA calls the compiled program itself, in some microseconds. On other devices, and if XLA refuses the
        program (a warning says so), it calls Python on the host, in 0.3 ms. Samples may have leading axes that
        broadcast. Inputs that are all float32 give float32, others JAX's default float. Derivatives are computed in
        float64, with respect to the entries of a configuration, by programs that are compiled at their first use; one
        of second order is some six times as long. A third derivative raises. Samples beyond the program's range are
        recomputed as in a call; errors of values, such as a joint without inertia, reach the caller as a
        JaxRuntimeError whose last line is this library's message, and so does a result beyond the range of float32 for
        inputs of float32. ``jax.export`` takes it, symbolic sizes too, once its check of the custom call that its error
        names is disabled; a process that runs the export must first have run the function. Programs passed to XLA stay
        in memory until the process ends: XLA frees none.

        >>> import spatialdyn as sd
        >>> import jax  # doctest: +SKIP
        >>> rnea = sd.specialize(sd.load_urdf("two_link"), sd.rnea).to_jax()  # doctest: +SKIP
        >>> jax.grad(lambda q: rnea(q, [0.0, 0.0], [0.0, 0.0]) @ rnea(q, [0.0, 0.0], [0.0, 0.0]))  # doctest: +SKIP

        Raises SpatialDynError without a program, for a program with bounds or derivatives, and if JAX is not installed
            (extra "jax")
        """
        from ..interop.jax import to_jax

        return to_jax(self._differentiable)

    def to_torch(self) -> Callable[..., Any]:
        """The program as a function of PyTorch tensors on the CPU, for autograd in both modes, torch.func and vmap.

        ``torch.compile`` and ``torch.export`` hold it as one operator. Samples may have leading axes that broadcast.
        Inputs that are all float32 give float32; all others are promoted to float64, float32 beside float64 as in
        torch's own operations. Derivatives are computed in float64, with respect to the entries of a configuration, and
        have the dtype of their input, by programs that are compiled at their first use; one of second order is some
        six times as long. A third derivative raises, and so does a second one within ``torch.compile``, and a result
        beyond the range of float32 for float32 inputs.

        Raises SpatialDynError without a program, for a program with bounds or derivatives, for tensors that are not on
            the CPU, and if PyTorch is not installed (extra "torch")
        """
        from ..interop.torch import to_torch

        return to_torch(self._differentiable)

    @cached_property
    def _differentiable(self) -> Differentiable:
        if self._kernel is None:
            derivative_of(self, 0, True)  # raises, unless only float32 has no program
        return Differentiable(self, self.signature, partial(derivative_request, self), partial(derivative_of, self))

    def python_code(self, name: str | None = None) -> str:
        """The program as a Python function of arrays of any batch shape that needs NumPy only; else as ``c_code``.

        >>> import spatialdyn as sd
        >>> k = sd.specialize(sd.load_urdf("two_link"), sd.generalized_gravity)
        >>> scope = {}
        >>> exec(k.python_code("gravity"), scope)
        >>> scope["gravity"]([0.0, 0.0]).round(9).tolist()
        [29.43, 9.81]
        """
        return self._code("python", name)

    def _code(self, language: str, name: str | None) -> str:
        given = exported(self._request, self._recorded, language, name)
        return PRINTERS[language](given.name, given.program, given.inputs, given.outputs)

    @property
    def operations(self) -> dict[str, int]:
        """Counts of the program's operations for one sample."""
        return self.program.operations

    def __repr__(self) -> str:
        names = ", ".join(spec.name for spec in self._request.specs)
        return f'<Specialized {names} of "{self.model.name}": {self.signature}, {self.dtype}, {self.engine}>'

    def __reduce__(self) -> tuple[Any, ...]:
        return self._made_by

    def __call__(self, *arrays: ArrayLike, out: Any = None) -> Any:
        """Replaced in this object's own class by a builtin at the first single sample."""
        if self._single_due and len(arrays) == len(self._inputs):
            ranks = [len(x.shape) for x in self._inputs]
            if all(np.ndim(x) == rank for x, rank in zip(arrays, ranks, strict=True)):
                self._compile_single()
        return self._checked_call(arrays, out)

    # -- one sample

    def _compile_single(self) -> None:
        """Compile the program for single samples; this object's own class gets the builtin that runs it."""
        self._single_due = False
        kernel = self._compile(one=True) if object_layout.READY else None
        parameters = [Parameter(x.name.partition(":")[0], ARRAY if x.shape else NUMBER) for x in self._inputs]
        if kernel is None or len(parameters) >= MOST or len(self._shapes) > MOST_OUTPUTS:
            return

        def checked(*given: Any, out: Any = None) -> Any:
            return self._checked_call(given, out)

        program = kernel.code.entry, kernel.numbers.ctypes.data, single_call.NO_LIMIT.ctypes.data
        given = [x.shape for x in self._inputs]
        plan = single_call.plan(program, self._shapes, given, self._request.several, kernel)
        call = single_call.bound(checked, [*parameters, Parameter("out", OUT, optional=True)], plan)
        type(self).__call__ = call  # type: ignore[method-assign]

    def _compile(self, one: bool) -> batch_kernels.Kernel | None:
        start, request = time.perf_counter(), self._request
        made = batch_kernels.kernel(
            request.specs,
            request.model.bodies,
            request.model.key,
            tuple(request.static.values()),
            request.dtype,
            options=request.options,
            one=one,
        )
        self.compile_seconds += time.perf_counter() - start
        return made

    # -- the checked call

    def _checked_call(self, given: tuple[Any, ...], out: Any) -> Any:
        """The call with all argument checks: for batches, lists, other dtypes and bad input."""
        request = self._request
        if len(given) != len(self._inputs):
            names = ", ".join(x.name for x in self._inputs)
            raise TypeError(f"{len(given)} inputs were given, expected {len(self._inputs)}: ({names})")
        arrays = [self._read(x.name, value) for x, value in zip(self._inputs, given, strict=True)]
        leads = [lead_of(x, array.shape) for x, array in zip(self._inputs, arrays, strict=True)]
        batch = broadcast([x.name for x in self._inputs], leads)
        whole = [batch + shape for shape in self._shapes]
        if out is None:
            results = tuple(empty(shape, request.dtype) for shape in whole)
        else:
            results = self._outs(out, whole, arrays)
        n = math.prod(batch)
        if n:
            rows = [flatten_batch(a, batch, x.shape) for x, a in zip(self._inputs, arrays, strict=True)]
            flat = [x.reshape((n, -1)) for x in results]
            samples = None
            if self._kernel is not None:
                samples = self._kernel([x.reshape((len(x), -1)) for x in rows], flat, out is not None)
            if samples is None:
                samples = np.arange(n)
            if len(samples):
                if request.dtype == np.float32:  # the inputs before their conversion to float32
                    arrays = [as_array(x.name, value) for x, value in zip(self._inputs, given, strict=True)]
                    rows = [flatten_batch(a, batch, x.shape) for x, a in zip(self._inputs, arrays, strict=True)]
                seen, has_program = out is not None, self._kernel is not None
                specialize_fallback.compute(request, self._inputs, rows, flat, batch, samples, seen, has_program)
            if self._watches_bounds:
                self._say_infinite(*flat)
        if out is None and not batch:
            number = float if request.dtype == np.float64 else np.float32
            shown: tuple[Any, ...] = tuple(x if x.ndim else number(x) for x in results)
            return shown if request.several else shown[0]
        return results if request.several else results[0]

    def _say_infinite(self, values: NDArray[Any], bounds: NDArray[Any]) -> None:
        """Warn once where most samples have infinite bounds in float32."""
        infinite = int((np.isfinite(values).all(axis=1) & np.isinf(bounds).any(axis=1)).sum())
        if 2 * infinite > len(values):
            self._watches_bounds = False
            warnings.warn(
                f'{self.calls[0]} of "{self.model.name}" has infinite bounds in float32 in {infinite} of {len(values)} '
                "samples, expected dtype=float64 for a model and states as these",
                stacklevel=4,
            )

    def _read(self, name: str, value: Any) -> NDArray[Any]:
        dtype = self._request.dtype
        if type(value) is np.ndarray and value.dtype == dtype:
            return value
        x = as_array(name, value)
        with np.errstate(over="ignore"):
            made = x.astype(dtype, copy=False)
        if dtype == np.float32 and not np.isfinite(made[np.isfinite(x)]).all():
            raise NonFiniteError(f"{name} holds {abs(x[np.isfinite(x)]).max()}, expected the range of float32")
        if self._request.exact_inputs and not np.array_equal(made, x, equal_nan=True):
            given = x[(made != x) & ~np.isnan(x)].flat[0]
            raise SpatialDynError(
                f"{name} holds {literal(given)}, expected numbers of float32, as exact_inputs=True says"
            )
        if name in self._driving and not made.all():
            lost = (made == 0.0) & (x != 0.0)  # only exact zeros may give exact zeros
            made = np.where(lost, np.copysign(float32_range.SMALLEST, made), made)
        return made

    def _outs(self, out: Any, shapes: list[tuple[int, ...]], inputs: list[NDArray[Any]]) -> tuple[NDArray[Any], ...]:
        """``out`` as a tuple, checked. Raises ShapeError."""
        dtype = self._request.dtype
        outs = out if self._request.several else (out,)
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


def lead_of(wanted: Array, shape: tuple[int, ...]) -> tuple[int, ...]:
    """Leading axes of an input. Raises ShapeError if the last axes are not the shape of one sample."""
    rank = len(wanted.shape)
    if len(shape) < rank or shape[len(shape) - rank :] != wanted.shape:
        raise ShapeError(f"{wanted.name} has shape {shape}, expected ({', '.join(['...', *map(str, wanted.shape)])})")
    return shape[: len(shape) - rank]
