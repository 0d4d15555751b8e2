"""Control laws: Specs that give joint torques from q, v and their own states, with values of their other inputs.

A law is written like any recursion, and recorded into the program of a step. Its numbers are inputs, or are read when
it is recorded. Kernels of a law with its own numbers are cached by the content of the recorded program, never by its
name, so that another law of the same name does not get an old kernel.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array, as_number, broadcast, check_model, core_shape
from ..engines.compiled import numba_kernels
from ..engines.programs.record import recording
from ..engines.programs.record.recording import Recording
from ..engines.programs.run.tiered_program import TieredProgram
from ..errors import NonFiniteError, ShapeError, SimulationError, literal
from ..model.model import Model
from ..recursions.joints.friction import DT
from ..recursions.spec import TAU, Q, Spec, V
from .composed_laws import CLOCK, HELD, LEFT, LIMITS, PERIOD, limited, names_in_sum, sampled, total, unused
from .law_specs import OF_STEP, begun_of, check_parts, check_recordable, in_step, kept, law_on, own_name, with_values

Array = NDArray[Any]
ONE = np.ones(1)
MOST = 1e30  # N m, N: stands for no limit, in float32 too


class Control:
    """A control law for a run: a Spec of joint torques, and values of its inputs.

    spec    Spec whose output is tau (nv), or whose parts are tau and then one for each of its states, in order:
            NAME_rate, which the run's method integrates as it integrates v, or NAME_after, the state at the end of a
            step as a function of the inputs at its beginning. Its inputs are any of q, v, tau (the argument torque,
            without that of the law), dt (the step), its states, and others. A law that depends on time has a clock, a
            state whose rate is 1
    values  {name: array} of the others: of the input's shape, with an axis of steps before it, or in a rollout with
            axes of samples and steps; for an input (nv,) one number stands for each freedom
    held    False: the law is evaluated whenever the method evaluates forces. True: it is evaluated at the beginning of
            a step and held over it, as by a digital controller. A period [s]: it is evaluated once in a period, at the
            nearest step, and held in between, as by a controller slower than the steps

    The torque is added to the argument torque of ``simulate``, or tau of ``rollout``. ``law + other`` is the sum of
    both, each with its own ``held``; ``law.limited_by(limits)`` clips a torque; ``law(model, t, q, v)`` is the torque.
    Raises  SimulationError for a Spec that is not a control law, for missing or unknown values, and for a recursion
            that closes over numbers: they must be inputs.

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

    checks: tuple[Callable[[Model], None], ...] = ()  # of a model given to the law
    # for each torque that is held for a period: the names of the period, of the remaining time, and of the torque
    periods: tuple[tuple[str, ...], ...] = ()
    smooth = False  # whether its torque has derivatives, so that a closed step may be judged by them
    _predicts = False  # whether it learns from the effect of its torque, which must then act unchanged

    def __init__(self, spec: Spec, values: Mapping[str, Any] | None = None, held: bool | float = False) -> None:
        """Check the Spec and keep copies of the values."""
        check_recordable(spec)
        check_parts(spec)
        self.spec, self.values, self.static = with_values(spec, values)
        self._hold(held)

    @classmethod
    def of(
        cls, spec: Spec, values: Mapping[str, Array], static: tuple[Any, ...] = (), held: bool | float = False,
        checks: tuple[Callable[[Model], None], ...] = (),
    ) -> Control:  # fmt: skip
        """A law whose Spec is composed of others, with their checks of a model. Raises SimulationError."""
        if not isinstance(spec, Spec) or not isinstance(values, Mapping):
            raise SimulationError(
                f"a law is of {shown(spec)} and {literal(values)}, expected a Spec and a mapping of arrays"
            )
        made: Control = Control.__new__(Control)
        made.spec, made.values, made.static, made.checks = spec, dict(values), static, checks
        made._hold(held)
        return made

    def _hold(self, held: Any) -> None:
        """Set ``held``; with a period, make a Spec that keeps the torque from step to step."""
        period = as_number(held)
        if not isinstance(held, (bool, np.bool_)) and 0.0 < period < math.inf:
            names = tuple(unused(x.name, self.spec) for x in (PERIOD, LEFT, HELD))
            self.spec, self.values = sampled(self.spec), {**self.values, names[0]: kept(np.array([period]))}
            self.periods, held = (*self.periods, names), False
        elif not isinstance(held, (bool, np.bool_)):
            raise SimulationError(f"held is {literal(held)}, expected True, False or a period above 0 [s]")
        self.held = bool(held)

    def __repr__(self) -> str:
        return f"<Control: {self.spec.name}{', held' if self.held else ''}>"

    def __add__(self, other: Any) -> Control:
        """The law whose torque is the sum of both, each with its own ``held``; they share a clock."""
        if not isinstance(other, Control):
            return NotImplemented
        laws = (self, other)
        for law in laws:
            law._acts("beside another law")
        specs = self.spec, other.spec
        spec, names = total(specs, (self.held, other.held)), names_in_sum(specs)
        values = {named[x]: y for law, named in zip(laws, names, strict=True) for x, y in law.values.items()}
        made = Control.of(spec, values, self.static + other.static, False, self.checks + other.checks)
        made.smooth = self.smooth and other.smooth
        both = zip(laws, names, strict=True)
        made.periods = tuple(tuple(named[x] for x in period) for law, named in both for period in law.periods)
        return made

    def limited_by(self, limits: ArrayLike) -> Control:
        """This law with its torques clipped to -limits to limits, a number or (nv,), above 0 [N m | N]: effort limits,
        such as those of a Model; infinite for no limit.

        Raises SimulationError for limits that are not above 0, and for a composite adaptive law
        """
        most = as_array("limits", limits)
        if most.ndim > 1 or not (most > 0.0).all():
            raise SimulationError(f"limits is {most.tolist()}, expected a number or (nv,) numbers above 0")
        self._acts("within limits")
        values = {**self.values, unused(LIMITS.name, self.spec): kept(np.minimum(most, MOST))}
        made = Control.of(limited(self.spec), values, self.static, self.held, self.checks)
        made.smooth, made.periods = self.smooth, self.periods
        return made

    def _acts(self, where: str) -> None:
        """Raise SimulationError for a law that must act alone."""
        if self._predicts:
            raise SimulationError(
                f'law "{self.spec.name}" is composite and learns from what its torque does, expected it not {where}'
            )

    def __call__(
        self, model: Model, t: ArrayLike, q: ArrayLike, v: ArrayLike, tau: ArrayLike | None = None,
        states: Mapping[str, ArrayLike] | None = None,
    ) -> Array:  # fmt: skip
        """The torque (..., nv) [N m | N] at times t (...), for states q (..., nq) and v (..., nv).

        tau     (..., nv)  argument torque, for laws that read it; zero if left out
        states  {name: (..., size)}  the law's own states, by default as at the beginning of a run; its clock is t

        If values have an axis of samples (B,), the states are of these samples. Raises ShapeError, NonFiniteError;
        SimulationError for a law whose values have an axis of steps.
        """
        shapes, known = _shapes(self.spec, check_model(model), self.static), self._known(model)
        axes = {} if known is not None else self.axes(model)
        if stepped := [name for name, lead in axes.items() if lead[-1] != 1]:
            raise SimulationError(f"values of {', '.join(stepped)} have axes of steps, expected none in a call")
        when, n = as_array("t", t), model.nv
        given = {
            Q.name: as_array("q", q), V.name: as_array("v", v),
            TAU.name: shapes.zero if tau is None else as_array("tau", tau), DT.name: ONE,
        }  # fmt: skip
        for name, start in shapes.starts:
            own = when[..., None] if start is None else start
            given[name] = own if states is None else as_array(name, states.get(name, own))
        leads: dict[str, tuple[int, ...]] = {}
        for name, y in given.items():
            core = shapes.cores[name]
            leads[name] = y.shape[: y.ndim - len(core)]
            if y.shape[len(leads[name]) :] != core:
                raise ShapeError(f"{name} has shape {y.shape}, expected (..., {', '.join(map(str, core))})")
        several = {when.shape, *leads.values(), *(lead[:-1] for lead in axes.values())} - {()}
        batch = next(iter(several), ())
        if len(several) > 1:
            leads |= {name: lead[:-1] for name, lead in axes.items()}
            batch = broadcast(["t", *leads], [when.shape, *leads.values()])
        size, rows = math.prod(batch), {}
        for name, y in given.items():
            lead, core = leads[name], shapes.cores[name]
            one = math.prod(lead) == 1  # one row for all samples, or one for each
            whole = y if one or lead == batch else np.broadcast_to(y, batch + core)
            rows[name] = whole.reshape(1 if one else size, math.prod(core))
        if known is None:
            known = {own_name(name): np.ascontiguousarray(y[:, 0]) for name, y in self.rows(model, size, 1).items()}
        rows |= known
        made, left = _torques_of(self, model, rows, size)
        for name, y in given.items():  # inputs that the law reads were checked, unless samples remain
            if (len(left) or name not in shapes.read) and not np.isfinite(y).all():
                raise NonFiniteError(f"{name} has numbers that are not finite, expected finite ones")
        return made.reshape(*batch, n)

    def _known(self, model: Model) -> dict[str, Array] | None:
        """Rows (1, columns) of the values by name, from the last call if they are the same; None if a value has an axis
        of samples or steps, or is writable.
        """
        arrays, last = tuple(self.values.values()), self.__dict__.get("_kept")
        if last is not None and last[0] is model and all(map(operator.is_, last[1], arrays)):
            return last[2]  # type: ignore[no-any-return]
        if any(x.flags.writeable for x in arrays) or self.axes(model):
            return None
        rows = {own_name(name): np.ascontiguousarray(y[:, 0]) for name, y in self.rows(model, 1, 1).items()}
        self.__dict__["_kept"] = model, arrays, rows
        return rows

    def __getstate__(self) -> dict[str, Any]:
        """The state without cached calls."""
        return {name: x for name, x in self.__dict__.items() if name != "_kept"}

    def axes(self, model: Model) -> dict[str, tuple[int, ...]]:
        """{name: axes before those of the input}, steps or samples and steps, for values that have such axes."""
        found = {}
        for name, (x, core) in zip(self._given, self._cores(check_model(model)), strict=True):
            found[f'{name} of spec "{self.spec.name}"'] = x.shape[: x.ndim - len(core)]
        return {name: lead for name, lead in found.items() if lead}

    @property
    def torque_spec(self) -> Spec:
        """The Spec of its torque alone at the beginning of a step, which ``sd.exact``, ``sd.specialize`` and
        ``SymbolicManipulator`` use for a law. Its inputs are q, v, the other inputs that the law reads, such as its
        clock, and ``values`` by name.
        """
        return _torque(self.spec)

    @property
    def batched(self) -> bool:
        """Whether a value has an axis of samples."""
        return self._deepest > 1

    @property
    def _deepest(self) -> int:
        """The largest number of axes that a value has before those of its input."""
        sizes = {x.name: len(x.shape) for x in self.spec.present}
        return max((x.ndim - sizes[name] for name, x in self.values.items() if x.ndim), default=0)

    @property
    def _given(self) -> list[str]:
        """The names of the values, in the order of the Spec."""
        return [x.name for x in self.spec.present if x.name in self.values]

    def _cores(self, model: Model) -> list[tuple[Array, tuple[int, ...]]]:
        """The values, and the shapes of their inputs."""
        found, cores = [], _shapes(self.spec, model, self.static).cores
        for x in self.spec.present:
            if x.name in self.values:
                value, core = self.values[x.name], cores[x.name]
                found.append((np.broadcast_to(value, core) if value.ndim == 0 and x.shape == ("nv",) else value, core))
        return found

    def rows(self, model: Model, samples: int, steps: int) -> dict[str, Array]:
        """Values (samples or 1, steps or 1, columns) by the names of a step's inputs. Raises ShapeError, and
        NonFiniteError for a value that all samples share.
        """
        for check in self.checks:
            check(model)
        found = {}
        for name, (value, core) in zip(self._given, self._cores(check_model(model)), strict=True):
            lead = value.shape[: value.ndim - len(core)]
            allowed = [(1, x) for x in (samples, steps)[max(0, 2 - len(lead)) :]]
            fits = len(lead) <= 2 and all(a in b for a, b in zip(lead, allowed, strict=True))
            if value.shape[len(lead) :] != core or not fits:
                shapes = f"{core}, {(steps, *core)} or {(samples, steps, *core)}"
                raise ShapeError(f'{name} of spec "{self.spec.name}" has shape {value.shape}, expected {shapes}')
            rows = value.reshape((1,) * (2 - len(lead)) + lead + (-1,))
            if len(rows) == 1 and not np.isfinite(rows).all():
                raise NonFiniteError(
                    f'{name} of spec "{self.spec.name}" has numbers that are not finite, expected finite ones'
                )
            found[in_step(name)] = np.ascontiguousarray(rows)
        return found


def check_control(control: Any) -> Control | None:
    """The argument ``control``. Raises SimulationError for anything but a Control or None."""
    if control is not None and not isinstance(control, Control):
        raise SimulationError(f"control is {shown(control)}, expected a Control or None")
    return control


def shown(given: Any) -> str:
    """The text of a given value in a message about a Control or a Cost; for a Spec, which is long, its name."""
    return f'the Spec "{given.name}"' if isinstance(given, Spec) else literal(given)


# --- kernels and torques --------------------------------------------------------------------------------


@lru_cache(maxsize=32)
def recorded(specs: tuple[Spec, ...], model: Model, static: tuple[Any, ...], dtype: np.dtype) -> Recording | None:
    """The recording of Specs that contain a control law; None if a joint has zero articulated inertia."""
    try:
        return recording.record(specs, model.bodies, static, dtype=dtype)
    except ZeroDivisionError:
        return None


def law_torques(
    control: Control, model: Model, q: Array, v: Array, tau: Array, states: Mapping[str, Array], steps: Array,
    dt: float, total: int,
) -> Array:  # fmt: skip
    """The law's torques (N, nv) in samples of a run, at the beginning of steps (N,); tau is the argument torque."""
    given: dict[str, Array] = {Q.name: q, V.name: v, TAU.name: tau, DT.name: np.full((len(q), 1), dt), **states}
    for name, rows in control.rows(model, 1, total).items():
        given[own_name(name)] = rows[0] if rows.shape[1] == 1 else rows[0, np.minimum(steps, rows.shape[1] - 1)]
    return _torques_of(control, model, given, len(q))[0]


def _torques_of(
    control: Control, model: Model, given: Mapping[str, Array], samples: int
) -> tuple[Array, NDArray[np.intp]]:
    """The law's torques (samples, nv) from rows of its inputs, one or one per sample; the same bits for any number.

    NumPy computes the samples that the program rejects: with numbers that are not finite, or angles out of range.
    """
    spec, names = _torque(control.spec), _names(control.spec)
    rows = [given[name] for name in names]
    flat = (x if x.ndim == 2 else x.reshape(len(x), math.prod(x.shape[1:])) for x in rows)
    inputs = [np.ascontiguousarray(x) for x in flat]
    common = tuple(k for k, x in enumerate(inputs) if len(x) == 1 and names[k] in control.values)
    made, left = _program(spec, model, control.static, common), np.arange(samples)
    out = np.empty((samples, model.nv))
    if samples and not numba_kernels.PLAIN:  # rows for all samples are finite: ``Control.rows``
        rejected = made.batch(samples)(inputs, (out,))
        left = left if rejected is None else rejected
    if len(left):
        with np.errstate(all="ignore"):
            found = made.recording.program.run([y for x in inputs for y in (x[left] if len(x) > 1 else x).T])
        out[left] = np.stack([np.broadcast_to(np.asarray(x, float), len(left)) for x in found[: model.nv]], 1)
    return out, left


@lru_cache(maxsize=64)
def _program(spec: Spec, model: Model, static: tuple[Any, ...], common: tuple[int, ...]) -> TieredProgram:
    """The program of a law's torque, whose inputs ``common`` have one row for all samples."""
    made = recorded((spec,), model, static, np.dtype(np.float64))
    if made is None:
        raise SimulationError(f'law "{spec.name}" divides by an inertia that is 0')
    made = Recording(made.program, replace(made.layout, common=common))
    return TieredProgram((spec,), model.bodies, model.key, static, recorded=made)


class _Shapes(NamedTuple):
    """Shapes and names for a call of a law on a model.

    cores   shapes of one sample of all inputs but static ones, by name
    starts  names of its states and their initial values, None for the clock
    read    names of the inputs
    zero    (nv,) zeros
    """

    cores: dict[str, tuple[int, ...]]
    starts: tuple[tuple[str, Array | None], ...]
    read: frozenset[str]
    zero: Array


@lru_cache(maxsize=64)
def _shapes(spec: Spec, model: Model, static: tuple[Any, ...]) -> _Shapes:
    n = model.nv
    cores = {x.name: core_shape(model, x, static) for x in spec.present if not x.static}
    starts = tuple(
        (x.name, None if x.name == CLOCK.name else np.full(cores[x.name], float(x.start or 0))) for x in spec.states
    )
    cores |= {Q.name: (model.nq,), V.name: (n,), TAU.name: (n,), DT.name: (1,)}
    return _Shapes(cores, starts, frozenset(x.name for x in spec.present), np.zeros(n))


@lru_cache(maxsize=64)
def _names(spec: Spec) -> tuple[str, ...]:
    """Names of the inputs of a law's torque."""
    return tuple(x.name for x in _torque(spec).present if not x.static)


@lru_cache(maxsize=64)
def _torque(spec: Spec) -> Spec:
    """The law as a call whose output is the torque alone, at the beginning of a step."""
    early = begun_of(spec)
    inputs = tuple(replace(x, unit_norm=False, optional=False) for x in spec.present if x.name not in early)
    known = {x.name for x in inputs}
    inputs += tuple(
        replace(x, unit_norm=False) for x in (Q, V, TAU) if x.name in early.values() and x.name not in known
    )

    def recursion(rows: Any, *arrays: Any) -> None:
        given = {(x.name if x.name in OF_STEP else in_step(x.name)): y for x, y in zip(inputs, arrays, strict=False)}
        arrays[-1][:] = law_on(spec, rows, given)(given.get(Q.name), given.get(V.name), given.get(TAU.name), {})[0]

    made = Spec(f"{spec.name}_torque", recursion, None, inputs, TAU, spec.summary, spec.source, regroup=spec.regroup)
    return replace(made, composed=True)
