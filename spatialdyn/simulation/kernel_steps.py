"""Steps that run in Python, by calls: steps with effects that no program takes, and of methods that solve equations.

Explicit methods take ``steps.advance``. Methods in momenta evaluate torques where they evaluate forces. The states of a
control law move for half a step before and half a step after the motion (Strang), each by the midpoint rule, so both
together have order 2; only its clock is that of each stage. Work is summed by the method's own stages, or by the
trapezoidal rule.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.dynamics import calls
from ..control.law_specs import own_name
from ..errors import SimulationError
from ..recursions.control.paths import CLOCK
from ..recursions.joints.friction import DT
from ..recursions.spec import FEXT
from .arithmetic import Computed
from .effects.effect import Effect, torques_of
from .effects.external import external_torque
from .methods.call_kernels import kernels_of
from .methods.constrained_symplectic import UNDER
from .methods.explicit import ExplicitKernels
from .methods.methods import DISCRETE, EXPLICIT, Family
from .methods.symplectic import GAUSS2, GAUSS4, GAUSS6
from .plan import Plan
from .recorder import Recorder
from .steps import advance, driven, free_of
from .system import OK, State, System
from .torques import forces_at

Array = NDArray[np.float64]
Step = Callable[[System, float, float, State], None]
WEIGHTS = {"implicit_midpoint": GAUSS2.b, "gauss4": GAUSS4.b, "gauss6": GAUSS6.b}  # of the stages' last torques


class KernelSteps:
    """The kernels of a run of one sample, here calls, and its step.

    forces  (njoints, 6) external forces, written before each step; (0, 6) without any
    """

    def __init__(self, plan: Plan, recorder: Recorder, forces: Array, sample: int) -> None:
        self.plan, self.recorder, self.forces, self.sample = plan, recorder, forces, sample
        model, family = plan.model, recorder.method.family
        assert family is not None
        self.family: Family = family
        self.at = Computed(model, {})
        self.held = [x for x in plan.effects if type(x).held_torque is not Effect.held_torque]
        self.names = [x.name for x in recorder.states.arguments]
        self.kernels: Any = kernels_of(self.at, family, forces if len(forces) else None)
        if family is EXPLICIT:
            self.step: Step = self._explicit
            return
        self._advance = recorder.method.advance
        if plan.constrained is not None:
            self._advance = UNDER[recorder.method.name](plan.constrained.of_sample(sample), model)
        self.step = self._in_momenta
        if family is not DISCRETE:
            self.kernels = self.kernels._replace(field=self._field(self.kernels.field))

    def _begin(self, system: System, t: float, h: float) -> dict[str, Any]:
        """The states carried at the beginning of a step, by name; sets the inputs of the step."""
        given = self.plan.given(self.sample, int(self.recorder.at[0]))
        if len(self.forces):
            if self.plan.force is None:
                self.forces[:] = given[FEXT.name]
            given[FEXT.name] = self.forces  # of a function: 0 in methods in momenta, where it acts by its torque
        self.at.begin(system, t)
        self.at.given.update(given, **{DT.name: h})
        views = self.recorder.states.views(self.recorder.own)
        return dict(zip(self.names, [x.copy() for x in views], strict=True))

    def _hold(self, system: System, q: Any, v: Any) -> None:
        """Add to tau the torques that are held over the step."""
        for effect in self.held:
            system.tau[:] = effect.held_torque(self.at, q, v, system.tau)

    def _put(self, system: System, t: float, after: Any) -> None:
        """Write the states after a step. Raises SimulationError for a state that is not finite while q and v are."""
        for name, x in zip(self.names, self.recorder.states.views(self.recorder.own), strict=True):
            x[...] = after[name]
            if system.status[0] == OK and not np.isfinite(x).all():
                label, feedback = own_name(name), self.plan.feedback
                of = f' of spec "{feedback.spec.name}"' if feedback is not None and label != name else ""
                raise SimulationError(f'state "{label}"{of} is not finite in the step from t = {t:.9g} s')

    def _explicit(self, system: System, t: float, h: float, state: State) -> None:
        own, plan = self._begin(system, t, h), self.plan
        self._hold(system, state.q, state.w)
        method: Any = self.recorder.method.advance
        self._put(system, t, advance(plan.effects, plan.work, self.at, method, system, t, h, state, own))

    # --- methods in momenta -----------------------------------------------------------------------------

    def _field(self, field: Callable[..., int]) -> Callable[..., int]:
        """The field of v and ṗ, with the torques of effects added."""
        if all(type(x).torque is Effect.torque for x in self.plan.effects):
            return field
        kernels = self.kernels

        def with_torques(system: System, q: Any, p: Any, rates: Any) -> int:
            code = field(system._replace(kernels=kernels), q, p, rates)
            for _, torque in reversed(torques_of(self.plan.effects, self.at, q, rates[0])):
                rates[1] += torque
            return code

        return with_torques

    def _in_momenta(self, system: System, t: float, h: float, state: State) -> None:
        plan, at, feedback, works = self.plan, self.at, self.plan.feedback, self.plan.work
        observed = feedback is not None or bool(works) or bool(self.held)
        own = self._begin(system, t, h)
        if observed:
            self.family.observe(system, t, state)
            self._hold(system, state.q, state.v)
        base, ask, discrete = system.tau.copy(), system.torque, self.family is DISCRETE
        law = None if feedback is None else feedback.law(at)
        held, now, after = None, dict(own), dict(own)
        stages: list[dict[str, Any]] = []
        clocks: list[str] = []

        def given(system: System, when: float, q: Any, v: Any) -> Array:
            """The torque from the arguments of the run."""
            system.tau[:] = base
            ask(system, when, q, v)
            tau: Array = system.tau.copy()
            return tau

        def asked(system: System, when: float, q: Any, v: Any) -> None:
            tau = given(system, when, q, v)
            if law is not None:
                states = {**now, **{x: own[x] + (when - t) for x in clocks}}
                tau = tau + (held if held is not None else law(q, v, tau, states)[0])
            if plan.force is not None:
                at.given[FEXT.name] = forces_at(plan.force, when, q, v, self.forces.shape)
            if works:
                stages.append(driven(plan.effects, works, at, q, v, tau)[1])
            system.tau[:] = tau
            if plan.force is not None:
                system.tau[:] += external_torque(at, q)
            if discrete:
                for _, torque in torques_of(plan.effects, at, q, v):
                    system.tau[:] += torque

        def power(when: float) -> dict[str, Any]:
            asked(system, when, state.q.copy(), state.v.copy())
            return stages.pop()

        if law is not None and feedback is not None:
            tau = given(system, t, state.q, state.v)
            wanted, made = law(state.q.copy(), state.v.copy(), tau, own)
            held = wanted if feedback.held else None
            clocks += [x for x in feedback.integrated if own_name(x) == CLOCK.name and made[x].item() == 1.0]
            after |= {name: x.reshape(own[name].shape) for name, x in made.items() if name not in feedback.integrated}
            now = self._after_half(law, h, state, tau, now)
        first = power(t) if works else {}
        self._advance(system._replace(torque=asked), t, h, state)  # type: ignore[misc]
        if not observed or system.status[0] != OK:
            return
        self.family.observe(system, t + h, state)
        if works:
            ends = [first, power(t + h)]
            weights = WEIGHTS.get(plan.method, (0.5, 0.5))
            used = ends if plan.method not in WEIGHTS else stages[-len(weights) :]
            for x in works:
                after[x.name] = own[x.name] + h * sum(c * y[x.name] for c, y in zip(weights, used, strict=True))
        if law is not None and feedback is not None:
            now = self._after_half(law, h, state, given(system, t + h, state.q, state.v), now)
            after |= {name: now[name] for name in feedback.integrated}
        self._put(system, t, after)

    def _after_half(self, law: Any, h: float, state: State, tau: Array, own: dict[str, Any]) -> dict[str, Any]:
        """The states of a law after half a step in which only they move, by the midpoint rule."""
        assert self.plan.feedback is not None
        q, v, moved = state.q.copy(), state.v.copy(), self.plan.feedback.integrated

        def after(part: float, slope: dict[str, Any]) -> dict[str, Any]:
            return {**own, **{x: own[x] + part * slope[x].reshape(own[x].shape) for x in moved}}

        return after(0.5 * h, law(q, v, tau, after(0.25 * h, law(q, v, tau, own)[1]))[1])


def rates_of(
    plan: Plan, recorder: Recorder, sample: int = 0
) -> Callable[[int, float, Array, Array, Array, Array], tuple[Array, Array]]:
    """``(step, t, q, v, states, tau) -> a, rates of the states``, flat, for SciPy's methods. It may raise."""
    model, feedback = plan.model, plan.feedback
    at, names = Computed(model, {}), [x.name for x in recorder.states.arguments]
    system = System(*(None,) * 9, np.zeros(3))

    def accelerate(system: System, q: Array, v: Array, a: Array) -> int:
        a[:] = calls["aba"](model, q, v, system.tau, at.given.get(FEXT.name))
        return OK

    kernels = ExplicitKernels(accelerate, *(None,) * 4)

    def rates(step: int, t: float, q: Array, v: Array, x: Array, tau: Array) -> tuple[Array, Array]:
        at.begin(system, t)
        at.given.update(plan.given(sample, step), **{DT.name: recorder.steps.dt})
        if plan.force is not None:
            at.given[FEXT.name] = forces_at(plan.force, t, q, v, (model.njoints, 6))
        found: dict[str, Any] = {}
        if feedback is not None:
            states = dict(zip(names, recorder.states.views(x), strict=True))
            wanted, found = feedback.law(at)(q, v, tau, states)
            tau = tau + wanted
        a = np.empty(model.nv)
        _, powers = free_of(plan.effects, plan.work, at, kernels, system._replace(tau=tau), q, v, a)
        found = {**found, **powers}
        return a, np.concatenate([np.empty(0), *(found[name].ravel() for name in names)])

    return rates
