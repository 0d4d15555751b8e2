"""Control laws by name: each is a ``Control`` whose Spec is a recursion, with its numbers as values.

A law follows a ``Path``, by its own clock, which every stage of a method reads, or references given as arrays: one
configuration, or one for each step. Laws can be added, clipped (``limited_by``) and called: ``law(model, t, q, v)``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array, as_word, within_range
from ..calls.dynamics import calls
from ..errors import NonFiniteError, ShapeError, SimulationError, literal
from ..model.model import Model
from ..recursions.control.control_laws import GRAVITY, STATE_FEEDBACK, law_spec
from ..recursions.control.paths import CLOCK
from ..recursions.spec import TAU, Argument, Q, Spec, V, made_once
from .control import Control
from .law_specs import RATE, evaluated, in_step, kept, with_values
from .paths import Path

Array = NDArray[np.float64]
ROUNDING = 1e-9  # relative to a matrix's largest entry: how far from symmetric it may be


class Law(Control):
    """A ``Control`` of this module: its gains, its reference and how it is held.

    line  Spec of its torque as a function of gains and references q_ref, v_ref and a_ref
    """

    line: Spec
    path: Path | None = None
    smooth = True

    def __init__(self, core: Spec, gains: dict[str, Array], reference: Any, held: bool | float) -> None:
        """A law from its Spec, its gains by name, and a Path, or arrays q_ref, v_ref and a_ref by name."""
        if isinstance(reference, Path):
            self.path, self.line = reference, core
            own = {name: kept(x) for name, x in gains.items()}
            spec, values, self.static = following(core, reference.spec), {**own, **reference.rows}, ()
            self.checks = (reference.check_model,)
        else:
            given = {**gains, **{name: x for name, x in reference.items() if x is not None}}
            spec, values, self.static = with_values(core, given)
            self.line = spec
        self.spec, self.values = spec, values
        self._hold(held)


@made_once(64)
def following(core: Spec, path: Spec) -> Spec:
    """The Spec of a law that follows a path by a clock."""
    own = tuple(x for x in core.present if x.name not in (Q.name, V.name, "q_ref", "v_ref", "a_ref"))
    inputs: tuple[Argument, ...] = (Q, V, *own, *path.present)
    wanted = {x.name for x in core.present}

    def recursion(rows: Any, *arrays: Any) -> None:
        given = dict(zip((x.name for x in inputs), arrays, strict=False))
        tau, *learnt, rate = arrays[len(inputs) :]
        nq, nv = len(given[Q.name]), len(given[V.name])
        q, v, a = np.split(evaluated(path, rows, (nq + 2 * nv,), given), [nq, nq + nv])
        known = {**given, "q_ref": q, "v_ref": v, "a_ref": a}
        ends = np.cumsum([nv, *map(len, learnt)])
        found = evaluated(core, rows, (ends[-1],), {name: x for name, x in known.items() if name in wanted})
        for part, values in zip((tau, *learnt), np.split(found, ends[:-1]), strict=True):
            part[:] = values
        rate[0] = 1.0

    parts = (*(core.parts or (TAU,)), Argument(CLOCK.name + RATE, (1,), "", "of the clock"))
    name = f"{core.name}_on_{path.name}"
    return Spec(
        name, recursion, None, inputs, TAU, core.summary, core.source, parts=parts, regroup=core.regroup, composed=True
    )


def gain_of(name: str, value: ArrayLike, size: int | None, least: float | None = 0.0) -> Array:
    """Gains as (nv,), a diagonal, (nv, nv), or with axes of samples and steps (B, T, nv).

    size   nv; None if it is unknown before a robot is given: a number then stays a number
    least  eigenvalues must be above it; for None they must be 0 or above

    Raises SimulationError naming the eigenvalue, ShapeError, NonFiniteError.
    """
    K = as_array(name, value)
    if not np.isfinite(K).all():
        raise NonFiniteError(f"{name} is {K.tolist()}, expected finite numbers")
    if K.ndim == 0 and size is not None:
        K = np.full(size, float(K))
    if K.ndim > 3:
        raise ShapeError(f"{name} has shape {K.shape}, expected (nv,) or (nv, nv)")
    found: Array = K
    if K.ndim == 2 and K.shape[0] == K.shape[1] and K.shape[0] > 1:
        off = abs(K - K.T).max()
        if off > ROUNDING * abs(K).max():
            raise SimulationError(f"{name} is not symmetric, by up to {off:.3g}, expected a symmetric matrix")
        found = np.asarray(np.linalg.eigvalsh(K), np.float64)
    low = float(found.min(initial=np.inf))
    if low < 0.0 or (least is not None and low <= least):
        raise SimulationError(
            f"{name} has the eigenvalue {low:.6g}, expected {'0 or more' if least is None else 'above 0'}"
        )
    return K


def _is_matrix(K: Array) -> bool:
    return K.ndim == 2 and K.shape[0] == K.shape[1] and K.shape[0] > 1


def _reference(path: Any, name: str = "path") -> tuple[Any, int | None]:
    """A Path, or arrays by name; and nv, None if they do not determine it."""
    if isinstance(path, Path):
        return path, path._table.nv
    q = as_array(name, path)
    if not np.isfinite(q).all():
        raise NonFiniteError(f"{name} is {q.tolist()}, expected finite numbers")
    if not q.ndim:
        raise ShapeError(
            f"{name} has shape (), expected a Path, or positions (nq,), (steps, nq) or (samples, steps, nq)"
        )
    return {"q_ref": q}, None


def _two_gains(
    law: str, first: tuple[str, ArrayLike], second: tuple[str, ArrayLike], size: int | None
) -> tuple[Spec, Array, Array]:
    """The Spec of a law with two gains, and the gains."""
    one, two = gain_of(*first, size), gain_of(*second, size)
    return law_spec(law, _is_matrix(one), _is_matrix(two)), one, two


class PD(Law):
    """PD control of the joints: tau = kp (q_ref ⊖ q) + kd (v_ref - v).

    kp, kd  numbers, (nv,), (nv, nv), or (B, 1, nv) per sample  gains [N m/rad | N/m], [N m s/rad | N s/m], 0 or more
    q_ref   (nq,), (T, nq) or (B, T, nq)  positions to reach [rad | m], or a Path
    v_ref   (nv,), (T, nv) or (B, T, nv)  velocities to reach [rad/s | m/s]; zero, or the path's, if left out
    held    True: evaluated at the beginning of a step and held over it, as by a digital controller. False: evaluated
            whenever the method evaluates forces. Or a period [s]

    Raises  SimulationError for gains that are not symmetric or have an eigenvalue below 0, naming it; ShapeError

    >>> import numpy as np, spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> hold = sd.PD([40.0, 40.0], [8.0, 8.0], [0.5, 0.2])
    >>> hold(model, 0.0, [0.0, 0.0], [0.0, 0.0])
    array([20.,  8.])
    """

    def __init__(
        self, kp: ArrayLike, kd: ArrayLike, q_ref: ArrayLike | Path, v_ref: ArrayLike | None = None,
        held: bool | float = True,
    ) -> None:  # fmt: skip
        """See the class."""
        reference, n = _reference(q_ref, "q_ref")
        one, two = gain_of("kp", kp, n, None), gain_of("kd", kd, n, None)
        if v_ref is not None:
            if isinstance(reference, Path):
                raise SimulationError("v_ref is given beside a path, expected one of them")
            reference["v_ref"] = as_array("v_ref", v_ref)
            if not np.isfinite(reference["v_ref"]).all():
                raise NonFiniteError(f"v_ref is {reference['v_ref'].tolist()}, expected finite numbers")
        core = law_spec("pd", _is_matrix(one), _is_matrix(two))
        super().__init__(core, {"kp": one, "kd": two}, reference, held)


class Gravity(Law):
    """Gravity compensation: tau = g(q).

    held  as in ``Control``

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("pendulum")
    >>> bool(sd.Gravity()(model, 0.0, [0.3], [0.0]) == sd.generalized_gravity(model, [0.3]))
    True
    """

    def __init__(self, held: bool | float = False) -> None:
        """See the class."""
        super().__init__(GRAVITY, {}, {}, held)


class PDGravity(Law):
    """PD with gravity at the present q: tau = g(q) + Kp (q_d ⊖ q) - Kd v. The robot comes to rest exactly at q_d for
    any Kp above 0. (PD with the constant g(q_d) needs a Kp above ``gravity_stiffness_bound``.)

    Kp, Kd  numbers, (nv,) or (nv, nv), above 0 [N m/rad | N/m], [N m s/rad | N s/m]
    q_d     (nq,), (T, nq) or (B, T, nq); or a Path, whose positions are used
    held    as in ``Control``

    V = ½ vᵀM v + ½ eᵀKp e falls along motions: V̇ = -vᵀKd v. Raises as ``PD``, for eigenvalues that are not above 0.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> law = sd.PDGravity(30.0, 8.0, [0.5, 0.2])
    >>> run = sd.simulate(model, [0.0, 0.0], [0.0, 0.0], 20.0, 0.01, control=law)
    >>> bool(abs(run.q[-1] - [0.5, 0.2]).max() < 1e-6)
    True
    """

    def __init__(self, Kp: ArrayLike, Kd: ArrayLike, q_d: ArrayLike | Path, held: bool | float = False) -> None:
        """See the class."""
        reference, n = _reference(q_d, "q_d")
        core, one, two = _two_gains("pd_gravity", ("Kp", Kp), ("Kd", Kd), n)
        super().__init__(core, {"kp": one, "kd": two}, reference, held)


class EnergyShaping(Law):
    """Energy shaping: tau = g(q) - ∂V_d/∂q - Kd v, which makes H_d = ½ pᵀM⁻¹p + V_d the energy, with Ḣ_d = -vᵀKd v.

    Kp, Kd     (nv,) or numbers, above 0; with "quadratic" also (nv, nv)
    q_d        (nq,)  the minimum of V_d
    potential  "quadratic": V_d = ½ eᵀKp e, the law of ``PDGravity``. "cosine": V_d = Σ Kp (1 - cos e), with a torque of
               at most Kp and a period of a full turn: for joints whose position is one number
    held       as in ``Control``

    ``energy(model, q, v)`` is H_d, a Lyapunov function. Raises as ``PDGravity``

    >>> import spatialdyn as sd
    >>> law = sd.EnergyShaping(20.0, 5.0, [0.5, 0.2], potential="cosine")
    >>> float(law.energy(sd.load_urdf("two_link"), [0.5, 0.2], [0.0, 0.0]))
    0.0
    """

    def __init__(
        self, Kp: ArrayLike, Kd: ArrayLike, q_d: ArrayLike, potential: str = "quadratic", held: bool | float = False
    ) -> None:
        """See the class."""
        self.potential = as_word("potential", potential, ("quadratic", "cosine"))
        reference, n = _reference(as_array("q_d", q_d), "q_d")
        law = "pd_gravity" if potential == "quadratic" else "cosine_shaping"
        core, one, two = _two_gains(law, ("Kp", Kp), ("Kd", Kd), n)
        if potential == "cosine" and one.ndim > 1:
            raise ShapeError(f"Kp has shape {one.shape}, expected (nv,) for cosines")
        super().__init__(core, {"kp": one, "kd": two}, reference, held)

    def energy(self, model: Model, q: ArrayLike, v: ArrayLike) -> Array:
        """H_d (...) = ½ vᵀM v + V_d(q) [J]. Raises ShapeError for a robot with other joints."""
        given = self.rows(model, 1, 1)
        Kp, q_d = (given[in_step(name)][0, 0] for name in ("kp", "q_ref"))
        Kp = Kp.reshape(self.values["kp"].shape) if _is_matrix(self.values["kp"]) else Kp
        e = np.asarray(calls["difference"](model, q, q_d))
        kinetic = np.asarray(calls["kinetic_energy"](model, q, v))
        if self.potential == "cosine":
            return np.asarray(kinetic + (Kp * (1.0 - np.cos(e))).sum(-1))
        with np.errstate(over="ignore", invalid="ignore"):
            found = np.asarray(kinetic + 0.5 * (e * (Kp * e if Kp.ndim == 1 else e @ Kp)).sum(-1))
        within_range("an energy", found[np.isfinite(kinetic) & np.isfinite(e).all(-1)])
        return found


class PDPlus(Law):
    """PD+: tau = M a_d + C(q, v) v_d + g + Kp e + Kd ė along a path: passive, and exact if there is no error.

    Kp, Kd  numbers, (nv,) or (nv, nv), above 0 [N m/rad | N/m], [N m s/rad | N s/m]
    path    Path, or positions to hold (nq,)
    held    as in ``Control``

    V = ½ ėᵀM ė + ½ eᵀKp e falls along motions: V̇ = -ėᵀKd ė, because Ṁ - 2C is skew. Raises as ``PDGravity``
    Source  Paden and Panja, Globally asymptotically stable PD+ controller for robot manipulators (1988).

    >>> import spatialdyn as sd
    >>> law = sd.PDPlus(60.0, 12.0, sd.quintic([0.0, 0.0], [1.0, 0.5], 2.0))
    >>> sd.rollout(sd.load_urdf("two_link"), [0.1, 0.0], [0.0, 0.0], dt=1e-3, steps=10, control=law).q.shape
    (10, 2)
    """

    def __init__(self, Kp: ArrayLike, Kd: ArrayLike, path: Path | ArrayLike, held: bool | float = False) -> None:
        """See the class."""
        reference, n = _reference(path)
        core, one, two = _two_gains("pd_plus", ("Kp", Kp), ("Kd", Kd), n)
        super().__init__(core, {"kp": one, "kd": two}, reference, held)


class ComputedTorque(Law):
    """Computed torque: tau = M (a_d + Kp e + Kd ė) + C v + g. With an exact model errors follow ë + Kd ė + Kp e = 0.

    Kp, Kd  numbers, (nv,) or (nv, nv), above 0 [1/s²], [1/s]: ``critical_gains``
    path    Path, or positions to hold (nq,)
    held    as in ``Control``

    Raises  as ``PDGravity``
    Source  Spong, Hutchinson and Vidyasagar, Robot Modeling and Control (2006), section 8.3.

    >>> import spatialdyn as sd
    >>> path = sd.quintic([0.0, 0.0], [1.0, 0.5], 2.0)
    >>> law = sd.ComputedTorque(*sd.critical_gains(8.0), path)
    >>> run = sd.simulate(sd.load_urdf("two_link"), [0.0, 0.0], [0.0, 0.0], 2.0, 0.01, control=law)
    >>> bool(abs(run.q - path(run.t).q).max() < 1e-7)
    True
    """

    def __init__(self, Kp: ArrayLike, Kd: ArrayLike, path: Path | ArrayLike, held: bool | float = False) -> None:
        """See the class."""
        reference, n = _reference(path)
        core, one, two = _two_gains("computed_torque", ("Kp", Kp), ("Kd", Kd), n)
        super().__init__(core, {"kp": one, "kd": two}, reference, held)


class Passivity(Law):
    """Passivity-based control: tau = M a_r + C(q, v) v_r + g - K s, v_r = v_d + Λ e, s = v - v_r: Slotine and Li's
    law without adaptation.

    rates  Λ, a number, (nv,) or (nv, nv), above 0 [1/s]
    gain   K, a number, (nv,) or (nv, nv), above 0 [N m s/rad | N s/m]
    path   Path, or positions to hold (nq,)
    held   as in ``Control``

    V = ½ sᵀM s falls along motions: V̇ = -sᵀK s, because Ṁ - 2C is skew. Raises as ``PDGravity``
    Source  Slotine and Li, On the adaptive control of robot manipulators (1987).

    >>> import spatialdyn as sd
    >>> law = sd.Passivity(5.0, 10.0, sd.quintic([0.0, 0.0], [1.0, 0.5], 2.0))
    >>> law(sd.load_urdf("two_link"), 0.0, [0.0, 0.0], [0.0, 0.0]).shape
    (2,)
    """

    def __init__(self, rates: ArrayLike, gain: ArrayLike, path: Path | ArrayLike, held: bool | float = False) -> None:
        """See the class."""
        reference, n = _reference(path)
        core, one, two = _two_gains("passivity_based", ("rates", rates), ("gain", gain), n)
        super().__init__(core, {"rates": one, "gain": two}, reference, held)


class StateFeedback(Law):
    """State feedback: tau = tau₀ - K (q ⊖ q_ref, v - v_ref), for example with K from ``lqr``.

    K       (nv, 2 nv), or (m, 2 nv) with joints
    q, v    (nq,), (T, nq) or (B, T, nq), and v likewise with nv  the state to hold; v is zero if left out
    tau     (nv,), (T, nv) or (B, T, nv)  torque at that state; zero if left out
    joints  the m freedoms that K drives, by index in v
    held    as in ``Control``; True for a K of a discrete system

    Raises  ShapeError, NonFiniteError

    >>> import numpy as np, spatialdyn as sd
    >>> law = sd.StateFeedback(np.array([[3.0, 1.0]]), [0.0])
    >>> law(sd.load_urdf("pendulum"), 0.0, [0.1], [0.2])
    array([-0.5])
    """

    def __init__(
        self, K: ArrayLike, q: ArrayLike, v: ArrayLike | None = None, tau: ArrayLike | None = None,
        joints: ArrayLike | None = None, held: bool | float = False,
    ) -> None:  # fmt: skip
        """See the class."""
        gain = as_array("K", K)
        if gain.ndim != 2 or gain.shape[1] % 2:
            raise ShapeError(f"K has shape {gain.shape}, expected (nv, 2 nv)")
        n = gain.shape[1] // 2
        if joints is not None:
            as_array("joints", joints)
            at = np.asarray(joints)
            if at.shape != (len(gain),) or at.dtype.kind not in "iu" or not ((at >= 0) & (at < n)).all():
                raise ShapeError(f"joints are {literal(joints)}, expected {len(gain)} whole numbers from 0 to {n - 1}")
            if len({*at.tolist()}) < len(at):
                raise SimulationError(f"joints are {literal(joints)}, expected each once: one row of K each")
            whole = np.zeros((n, 2 * n))
            whole[at] = gain
            gain = whole
        if gain.shape[0] != n:
            raise ShapeError(f"K has shape {gain.shape}, expected ({n}, {2 * n}), or joints that it drives")
        given = {"q_ref": q, "v_ref": v, "hold": tau}
        reference = {name: as_array(name, x) for name, x in given.items() if x is not None}
        for name, x in {"K": gain, **reference}.items():
            if not np.isfinite(x).all():
                raise NonFiniteError(f"{name} is {x.tolist()}, expected finite numbers")
        super().__init__(STATE_FEEDBACK, {"gain": gain.copy()}, reference, held)
