"""Programs of calls of one model, with only the inputs that vary and the outputs that are selected.

``specialize`` turns its arguments into a ``SpecializeRequest``; a ``Specialized`` records, compiles and runs it; a
``Promise`` tries several Specialized in turn.
"""

from __future__ import annotations

import typing
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from ..errors import SpatialDynError, literal
from ..model.model import Frame, Model
from .devices import as_device
from .specialize_request import Names, SpecializeRequest, check_derivative, read_request
from .specialized import Specialized, check_program, of_request

if typing.TYPE_CHECKING:
    from ..engines.programs.gpu.device import Device
    from .promise import Promise


@typing.overload
def specialize(
    model: Model,
    calls: Callable[..., Any] | Sequence[Callable[..., Any]],
    dtype: DTypeLike = ...,
    fixed: Mapping[str, Any] | None = ...,
    inputs: Names = ...,
    outputs: str | int | Sequence[str | int] | None = ...,
    frame: str | Frame | None = ...,
    reference: str = ...,
    classical: bool = ...,
    constraints: Any = ...,
    derivative: str | None = ...,
    tolerance: None = ...,
    device: str = ...,
) -> Specialized: ...


@typing.overload
def specialize(
    model: Model,
    calls: Callable[..., Any],
    dtype: DTypeLike = ...,
    fixed: Mapping[str, Any] | None = ...,
    inputs: Names = ...,
    outputs: str | int | Sequence[str | int] | None = ...,
    frame: str | Frame | None = ...,
    reference: str = ...,
    classical: bool = ...,
    constraints: Any = ...,
    derivative: None = ...,
    *,
    tolerance: float | tuple[float, float],
    device: str = ...,
) -> Promise: ...


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
    constraints: Any = None,
    derivative: str | None = None,
    tolerance: float | tuple[float, float] | None = None,
    device: str = "cpu",
) -> Specialized | Promise:
    """One compiled program for one or several calls of a model; inputs that are fixed are folded into it.

    model     Model; for ``sd.step`` also a Scene
    calls     a public call such as ``sd.rnea``, or several, whose common subexpressions are computed once. Or
              ``sd.step``, or ``functools.partial(sd.step, method="rk4")``: all effects of the scene become part of the
              program, their coefficients constants; inputs are q, v, tau, dt and states, and names of results end in
              "_after". A step takes no further arguments but dtype, fixed and derivative
    dtype     float64 or float32, of inputs and results; see ``Specialized`` for the range of float32
    fixed     constant inputs of the calls, folded into the program: name -> a number, an array of the input's shape, or
              {joint name: its value}; the latter leaves the other joints' entries as input, in their order.
              ``fixed={"v": 0, "a": 0}`` makes rnea the gravity torque.
    inputs    further inputs, after the usual ones and in this order: "fext" (in its usual place), "gravity" (3,),
              "armature" (nv,). For the body of a joint, links fixed to it included, in the joint's frame: "mass:JOINT"
              (), "com:JOINT" (3,), "inertia:JOINT" (6,), xx xy xz yy yz zz about the com. "payload:FRAME" (10,) adds
              a body in that frame: mass, com x y z, inertia xx xy xz yy yz zz about its com; "payload" alone adds it
              in the frame of a chain's last joint. Or a mapping: {"payload": "hand"}. Values are not checked: a mass
              may be negative. Exported code names them by kind and position: a payload as fourth input is ``payload_4``
    outputs   joint names or indices that select entries of the axes "nv" and "njoints" of the results
    frame, reference, classical   for the public calls that take them
    constraints  Constraints of this model, for calls that take them, in float64. The result of
              ``sd.constrained_dynamics`` is then a, force, residual and rank side by side (nv+nc+2,), and equations
              that contradict others raise no error: their residual is not 0. ``inputs="rate"`` adds 1/T of the
              stabilization. For ``sd.contact_step`` and ``sd.contact_gaps`` Contacts on a Plane, as in ``exact``;
              the parts of a step lie side by side too
    derivative   "jvp": along a direction. The program also takes a tangent of each input, dq dv ... in their order, and
              also returns the derivatives of the results along them, dtau. "vjp": of Σ weight · result. The program
              also takes the weights, tau_bar, and also returns the derivatives with respect to each input, q_bar v_bar
              ... Both take two to three times the operations, in float64. A sample beyond the program's range is an
              error. Tangents of and derivatives with respect to a configuration are those of a displacement (nv,), as
              in ``rnea_derivatives``
    tolerance  relative to the largest entry of a sample's result, or (relative, absolute), for one call: makes a
              Promise, which computes each sample in the first of float32, float64 and double-double whose bound is
              within the tolerance. With dtype=np.float32 it always starts at float32, else only where that is cheaper
    device    "cuda" for arrays of PyTorch, CuPy or JAX on a GPU, in and out: one thread per sample, results equal to
              those of the CPU's lanes to the bit. ``k.ptx`` is the GPU code as text, on any machine;
              ``k(..., check=False)`` does not wait for the GPU, see ``k.__doc__``

    Returns a Specialized: call it with the remaining inputs in their usual order, of any batch shape, and ``out=``.
    With a tolerance, a Promise, called the same way.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> k = sd.specialize(model, sd.rnea, fixed={"v": 0, "a": 0}, inputs="payload")
    >>> k.signature
    '(q (nq,), payload (10,)) -> tau (nv,)'
    >>> k([0.3, 0.1], [1.5, 0, 0, 0, 0, 0, 0, 0, 0, 0]).shape
    (2,)

    Raises
        SpatialDynError for an unknown call, dtype, input, output or device, listing the known ones
            and for derivatives of a call without a program, or with loops in it, as of steps in contact; on a GPU
            for calls without a program, and with a tolerance
        ModelError for a name that is not in the model
        ShapeError for a constant of the wrong shape, ConfigurationError for one of the wrong norm
    """
    constants = {} if fixed is None else fixed
    where = as_device(device)
    if where is not None and tolerance is not None:
        raise SpatialDynError(f'tolerance is {tolerance!r} with device="cuda", expected None: a Promise is of the CPU')
    if (reader := getattr(calls.func if isinstance(calls, partial) else calls, "request", None)) is not None:
        rest = {"inputs": inputs or None, "outputs": outputs, "frame": frame, "constraints": constraints}
        named = [name for name, x in {**rest, "tolerance": tolerance}.items() if x is not None]
        if named:
            raise SpatialDynError(f"{named[0]} is given, expected none with a step")
        arguments: tuple[Any, ...] = model, calls, dtype, fixed, inputs, outputs, frame, reference, classical
        arguments = *arguments, constraints, derivative, tolerance, device
        stepped = _made(reader(model, calls, dtype, constants, check_derivative(derivative, dtype)), arguments, where)
        return stepped if derivative is None else check_program(stepped, f"derivative={derivative!r}")
    given = (inputs, outputs, frame, reference, classical, constraints)
    request = read_request(model, calls, dtype, constants, *given, derivative=derivative)
    if tolerance is not None:
        if derivative is not None or request.several:
            what = "a derivative" if derivative is not None else "several calls"
            raise SpatialDynError(f"tolerance is {literal(tolerance)} with {what}, expected one call alone")
        words: dict[str, Any] = {
            "tolerance": tolerance,
            "dtype": dtype,
            "fixed": fixed,
            "inputs": inputs,
            "outputs": outputs,
        }
        words |= {"frame": frame, "reference": reference, "classical": classical, "constraints": constraints}

        def bounded(dtype: Any) -> Specialized:
            made = read_request(model, calls, dtype, constants, *given, bounds=True)
            return check_program(of_request(made, specialize, ()), "bounds")

        from .promise import Promise  # imported only here: bounds need further modules

        return Promise(request, tolerance, bounded, partial(specialize, **words), (model, calls))
    made = _made(request, (model, calls, dtype, fixed, *given, derivative, tolerance, device), where)
    return made if derivative is None else check_program(made, f"derivative={derivative!r}")


def _made(request: SpecializeRequest, arguments: tuple[Any, ...], device: Device | None) -> Specialized:
    """The program of a request, on the CPU or on a device."""
    if device is None:
        return of_request(request, specialize, arguments)
    from .on_gpu import SpecializedOnGpu

    return SpecializedOnGpu(request, specialize, arguments, device)
