"""The arguments of ``specialize``, checked: names of calls, joints, frames and inputs become indices.

The engines read only the ``recording.ProgramOptions`` of a request: rows and columns, no names.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ..engines.compiled import numba_kernels
from ..engines.programs.record import parameters, recording
from ..engines.programs.record.parameters import Parameter
from ..engines.programs.transform import derived
from ..errors import ConfigurationError, ModelError, NonFiniteError, ShapeError, SpatialDynError, literal
from ..model.model import Frame, Model
from ..recursions.spec import Argument, Spec
from .arguments import as_array, as_flag, check_model, core_shape, frame_row_and_placement
from .failures import off_unit_norm
from .specs import specs_of, static_of

Names = str | Sequence[str] | Mapping[str, str | Sequence[str] | None]
EXTRA_INPUTS = "fext, rate, gravity, armature, payload, payload:FRAME, mass:JOINT, com:JOINT or inertia:JOINT"


class Array(NamedTuple):
    """An input or a result of a Specialized: its name, the shape of one sample, and that shape in symbols."""

    name: str
    shape: tuple[int, ...]
    shape_text: str


class SpecializeRequest(NamedTuple):
    """The arguments of ``specialize``, checked.

    constants      name -> flat values, NaN where the entry stays an input
    output_places  for each call the flat indices of the selected entries, in the shape of the result; None: all
    bounds         whether each result is followed by a bound on its error; for one call only
    derivative     "jvp", "vjp", "along ..." as of ``ProgramOptions``, or "" for none
    exact_inputs   whether float32 bounds take inputs as exact, not as rounded from other numbers
    """

    model: Model
    specs: tuple[Spec, ...]
    several: bool
    dtype: np.dtype
    arguments: tuple[Argument, ...]
    static: dict[str, Any]
    constants: dict[str, NDArray[np.float64]]
    parameter_names: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    output_places: tuple[NDArray[np.intp], ...] | None
    bounds: bool = False
    derivative: str = ""
    exact_inputs: bool = False

    @property
    def options(self) -> recording.ProgramOptions:
        """The part of the request that the engines read."""
        fixed = tuple((name, tuple(x.tolist())) for name, x in self.constants.items())
        places = () if self.output_places is None else tuple(tuple(x.ravel().tolist()) for x in self.output_places)
        return recording.ProgramOptions(
            fixed, self.parameters, places, self.dtype == np.float32, False, self.bounds, self.derivative,
            self.exact_inputs,
        )  # fmt: skip

    @property
    def tables(self) -> tuple[Any, ...]:
        """The values of static inputs, among them tables, which have sizes."""
        return tuple(self.static.values())

    @property
    def takes_results(self) -> bool:
        """Whether this is a derivative alone, which takes the known results as its last inputs."""
        directions, weighted = recording.along(self.derivative) or (0, False)
        return directions + weighted == 1 and derived.inverse_of(self.specs, self.model.bodies, self.options)

    def inputs(self) -> list[Array]:
        """The inputs, in order: the remaining ones, then their tangents, or the weights of the results."""
        own, alone = self._left(), recording.along(self.derivative)
        if alone:
            directions, weighted = alone
            moved = [x._replace(name="d" * k + x.name) for k in range(1, directions + 1) for x in own]
            weights = [x._replace(name=x.name + "_bar") for x in self._values() if weighted]
            return own + moved + weights + (self._values() if self.takes_results else [])
        if self.derivative == "jvp":
            return own + [x._replace(name="d" + x.name) for x in self._tangents()]
        return own + [x._replace(name=x.name + "_bar") for x in self._values() if self.derivative]

    def results(self) -> list[Array]:
        """The results, in order: values, then their bounds or derivatives, or derivatives alone."""
        values, alone = self._values(), recording.along(self.derivative)
        if alone:
            directions, weighted = alone
            if weighted:
                return [x._replace(name="d" * directions + x.name + "_bar") for x in self._left()]
            return [x._replace(name="d" * directions + x.name) for x in values]
        if self.bounds:
            return values + [x._replace(name="bound") for x in values]
        if self.derivative == "jvp":
            return values + [x._replace(name="d" + x.name) for x in values]
        return values + [x._replace(name=x.name + "_bar") for x in self._tangents() if self.derivative]

    @property
    def numbers(self) -> int:
        """How many numbers the results of one sample are, or what a derivative weights, if that is more."""
        return max(sum(math.prod(x.shape) for x in found) for found in (self.results(), self._values()))

    def _tangents(self) -> list[Array]:
        """The remaining inputs, each configuration as a displacement."""
        moved = {x.name for x in self.arguments if x.moved_by and self.model.nq != self.model.nv}
        width = self.model.nv
        return [x._replace(shape=(width,), shape_text="(nv,)") if x.name in moved else x for x in self._left()]

    def _left(self) -> list[Array]:
        left = []
        for x in self.arguments:
            core = core_shape(self.model, x, self.tables)
            if x.name not in self.constants:
                left.append(Array(x.name, core, shape_text(x.shape)))
                continue
            count = int(np.isnan(self.constants[x.name]).sum())
            if count:
                core = (count // math.prod(core[1:]), *core[1:])
                left.append(Array(x.name, core, shape_text(core)))
        for name, p in zip(self.parameter_names, self.parameters, strict=True):
            left.append(Array(name, parameters.shape(p, self.model.nv), shape_text(parameters.SHAPES[p.kind])))
        return left

    def _values(self) -> list[Array]:
        found = []
        for k, spec in enumerate(self.specs):
            if self.output_places is None:
                shape, text = core_shape(self.model, spec.output, self.tables), shape_text(spec.output.shape)
            else:
                shape = self.output_places[k].shape
                text = shape_text(shape)
            found.append(Array(spec.output.name, shape, text))
        return found


def shape_text(shape: Sequence[str | int]) -> str:
    """A shape as the text of a tuple, axes by size or symbol."""
    return f"({shape[0]},)" if len(shape) == 1 else f"({', '.join(map(str, shape))})"


def read_request(
    model: Model,
    calls: Callable[..., Any] | Sequence[Callable[..., Any]],
    dtype: DTypeLike,
    fixed: Mapping[str, Any],
    inputs: Names,
    outputs: str | int | Sequence[str | int] | None,
    frame: str | Frame | None,
    reference: str,
    classical: bool,
    constraints: Any,
    bounds: bool = False,
    derivative: str | None = None,
    exact_inputs: bool = False,
) -> SpecializeRequest:
    """The request of ``specialize``'s arguments, or of ``bounded``'s. Raises as they do."""
    check_model(model)
    check_derivative(derivative, dtype)
    specs = specs_of(calls)
    optional, names, chosen = _inputs(model, inputs, specs)
    constants = constants_of(model, fixed, [x for spec in specs for x in spec.present if not x.static])
    present = optional | {name for name in constants if constants[name].any()}
    specs = tuple(numba_kernels.variant(spec, frozenset(present & {x.name for x in spec.present})) for spec in specs)
    given = {x.name: x for spec in specs for x in spec.present}
    static = [x.name for x in given.values() if x.static]
    values = static_of(model, static, frame, reference, classical, constraints)
    if constraints is not None and dtype_of(dtype) != np.float64:
        raise SpatialDynError(
            "dtype is float32, expected float64 with constraints: rounding leaves 1e-7 of a dependent equation's "
            "pivot, as 3e-4 rad from a branch point do of an independent one's"
        )
    return SpecializeRequest(
        model=model,
        specs=specs,
        several=bounds or derivative is not None or not callable(calls),
        dtype=dtype_of(dtype),
        arguments=tuple(x for x in given.values() if not x.static),
        static=values,
        constants={name: x for name, x in constants.items() if name in given},
        parameter_names=names,
        parameters=chosen,
        output_places=_output_places(model, outputs, specs, tuple(values.values())),
        bounds=bounds,
        derivative=derivative or "",
        exact_inputs=as_flag("exact_inputs", exact_inputs) and dtype_of(dtype) == np.float32,
    )


def check_derivative(derivative: Any, dtype: DTypeLike) -> str | None:
    """The argument ``derivative``. Raises SpatialDynError."""
    if derivative is None:
        return None
    if not isinstance(derivative, str) or derivative not in ("jvp", "vjp"):
        raise SpatialDynError(f'derivative is {literal(derivative)}, expected "jvp", "vjp" or None')
    if dtype_of(dtype) != np.float64:
        raise SpatialDynError("dtype is float32, expected float64 with a derivative: a tangent may be beyond its range")
    return derivative


def dtype_of(dtype: DTypeLike) -> np.dtype:
    """float64 or float32. Raises SpatialDynError for another."""
    found = None
    if dtype is None or isinstance(dtype, (str, type, np.dtype)):  # np.dtype takes any object with a dtype
        with suppress(TypeError, ValueError, SyntaxError):
            found = np.dtype(dtype)
    if found is None or found not in (np.dtype(np.float64), np.dtype(np.float32)):
        raise SpatialDynError(f"dtype is {literal(dtype)}, expected float64 or float32")
    return np.dtype(found)


def _inputs(
    model: Model, inputs: Names, specs: tuple[Spec, ...]
) -> tuple[set[str], tuple[str, ...], tuple[Parameter, ...]]:
    """Names of the optional inputs, names of the parameters that are inputs, and those parameters."""
    optional: set[str] = set()
    chosen: dict[str, Parameter] = {}
    for name in _labels(inputs):
        kind, _, where = name.partition(":")
        if name in optional or name in chosen:
            raise SpatialDynError(f'inputs has "{name}" twice, expected it once')
        if any(x.name == name and x.optional for spec in specs for x in spec.present):
            optional.add(name)
        elif kind == "payload" and kind in parameters.SHAPES:
            chosen[name] = _payload(model, where)
        elif kind in parameters.OF_BODY and where:
            joint = model.joint(where)
            if not joint.row:
                raise ModelError(f'joint "{where}" does not move, expected one that carries a body for "{name}"')
            chosen[name] = Parameter(kind, joint.row)
        elif name in ("gravity", "armature"):
            if name == "armature" and (model.bodies["geared"].any() or model.bodies["coupled"].any()):
                raise ModelError(f'model "{model.name}" has rotors, expected none for armatures as inputs')
            chosen[name] = Parameter(name)
        else:
            raise SpatialDynError(f"inputs has {literal(name)}, expected {EXTRA_INPUTS}")
    return optional, tuple(chosen), tuple(chosen.values())


def _labels(inputs: Any) -> list[str]:
    """A string, sequence or mapping as a list of "kind" and "kind:where"."""
    if isinstance(inputs, str):
        return [inputs]
    if not isinstance(inputs, Mapping):
        return [name if isinstance(name, str) else literal(name) for name in _as_list("inputs", inputs)]
    labels = []
    for kind, where in inputs.items():
        listed = [where] if where is None or isinstance(where, str) else _as_list(f'inputs["{kind}"]', where)
        labels += [str(kind) if w is None else f"{kind}:{w}" for w in listed]
    return labels


def _as_list(name: str, value: Any) -> list[Any]:
    try:
        return list(value)
    except TypeError:
        raise SpatialDynError(f"{name} is {literal(value)}, expected names") from None


def _payload(model: Model, where: str) -> Parameter:
    if where:
        row, placement = frame_row_and_placement(model, where)
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


def constants_of(model: Model, fixed: Any, arguments: Sequence[Argument]) -> dict[str, NDArray[np.float64]]:
    """Flat constants of each fixed input among ``arguments``, NaN where the entry stays an input.

    Raises SpatialDynError, ModelError, ShapeError, ConfigurationError, as ``specialize``.
    """
    known = {x.name: x for x in arguments}
    if not isinstance(fixed, Mapping):
        raise SpatialDynError(f"fixed is a {type(fixed).__name__}, expected a mapping of names to values")
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
        for joint, part, _ in off_unit_norm(model, entries) if known[name].unit_norm else ():
            raise ConfigurationError(
                f'fixed {name} is {part.tolist()} for joint "{joint.name}", expected a norm within 1e-6 of 1'
            )
        if not (known[name].optional and not entries.any()):
            found[name] = entries.ravel()
    return found


def _places(model: Model, argument: Argument, name: str) -> slice:
    """The slice of a joint's entries in the first axis of an input or output."""
    joint = model.joint(name)
    first = argument.shape[0] if argument.shape else None
    if first == "nq" and joint.nq:
        return slice(joint.idx_q, joint.idx_q + joint.nq)
    if first == "nv" and joint.nv:
        return slice(joint.idx_v, joint.idx_v + joint.nv)
    if first == "njoints":
        index = model.names.index(name)
        return slice(index, index + 1)
    raise SpatialDynError(f'{argument.name} has no entries of joint "{name}", expected a joint that has entries in it')


def _constant(name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    x = as_array(name, value)
    if x.ndim and x.shape != shape and (1, *x.shape) != shape:
        raise ShapeError(f"fixed {name} has shape {x.shape}, expected {shape} or a number")
    if not np.isfinite(x).all():
        raise NonFiniteError(f"fixed {name} is {x.tolist()}, expected finite numbers")
    return x


def _output_places(
    model: Model, outputs: Any, specs: tuple[Spec, ...], static: tuple[Any, ...]
) -> tuple[NDArray[np.intp], ...] | None:
    """For each call the flat indices of the selected entries of its output, in the shape of the result."""
    if outputs is None:
        return None
    listed = [outputs] if isinstance(outputs, (str, int)) else _as_list("outputs", outputs)
    if not listed:
        raise SpatialDynError("outputs is empty, expected names of joints or indices, or None for all")
    if not any(isinstance(s, str) for spec in specs for s in spec.output.shape):
        raise SpatialDynError(f"outputs is {literal(outputs)}, expected None: no result has an entry per joint")
    wanted = []
    for spec in specs:
        core = core_shape(model, spec.output, static)
        axes = []
        for symbol, size in zip(spec.output.shape, core, strict=True):
            places: list[int] = []
            for what in listed if isinstance(symbol, str) else ():
                if isinstance(what, str):
                    places += range(size)[_places(model, Argument(spec.output.name, (symbol,), "", ""), what)]
                elif isinstance(what, (int, np.integer)) and not isinstance(what, bool) and 0 <= what < size:
                    places.append(int(what))
                else:
                    raise SpatialDynError(f"outputs has {literal(what)}, expected joint names or indices below {size}")
            if len(set(places)) < len(places):
                raise SpatialDynError(f"outputs is {literal(outputs)}, expected each entry of {spec.output.name} once")
            axes.append(places if isinstance(symbol, str) else list(range(size)))
        flat = np.arange(math.prod(core), dtype=np.intp).reshape(core)
        wanted.append(flat[np.ix_(*axes)])
    return tuple(wanted)
