"""``identify``: the parameters of a model from a recording of its motion and torques."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import as_count, as_number, as_word
from ..errors import IdentificationError, literal
from ..model.model import Model
from ..simulation.scene import Scene, scene_of
from ..waiting import watch
from . import log_cholesky, semidefinite
from .base import ROWS, Base, structural_base
from .base_fit import BaseFit, fit_base
from .delays import fitted_delay, whole_delay
from .equations import FORMS, HOLDS, KEPT, Equations, Settings, refuse_flight
from .identified import Identified
from .least_squares import WHITE, Factors, added, factors_of, quantile, whiteness
from .pseudo_inertia import consistent, positive, pseudo_inertia
from .recording import Recording
from .unknowns import DEFAULT, floats, freedoms_of, names_of, unknowns_of, words_of

Array = NDArray[np.float64]
LEAST = 1e-100  # lower bound of divisors
METHODS = ("ols", "wls", "log_cholesky", "sdp")
TIMES_RANK = 10  # rows that a recording needs at least for each base parameter
PRIOR = 1.0  # equals one observation of each body's inertia with a deviation of its own size
FLOOR = 1e-4  # least eigenvalue of P₀ relative to the largest: smaller ones, as of massless bodies, are raised
MOST_WINDOW = 1 << 20
LOOK = 2048  # rows of each freedom in the search for a delay of whole samples


@watch.call("identify")
def identify(
    recording: Recording | Iterable[Recording],
    model: Model | Scene,
    method: str = "wls",
    parameters: Any = DEFAULT,
    prior: float | None = None,
    *,
    form: str | None = None,
    hold: str | None = None,
    delay: float | bool = 0.0,
    window: int = 1,
    cutoff: float | None = None,
    v_min: float = 0.0,
    payload: str | None = None,
    bodies: Any = None,
    rows: str = "all",
    remove: float | None = None,
) -> Identified:
    """Parameters of a robot from recorded motions: their base parameters, intervals, and a model that has them.

    recording   Recording, several of one robot, or a generator of them: each is reduced to small factors and released
    model       Model, or a Scene, whose Coulomb and viscous friction count as known if they are not unknowns; a Scene
                with contacts, constraints or fext is refused. A mimic joint's friction is its leader's
    method      "ols": least squares of base parameters; "wls": weighted by each freedom's own noise; "log_cholesky": of
                physically consistent inertias, and friction of 0 or more, by Gauss-Newton; "sdp": the same by a
                semidefinite program (needs cvxpy)
    parameters  some of "inertial", "friction" ("viscous" and "coulomb"), "armature", "offset", as words or joined by +
    prior       weight, above 0, of the model's own inertias in the last two methods; 1 by default: as one observation
                of each body's inertia with a deviation of its own size. Intervals come from the data alone
    form        "torque": equations at samples, with accelerations; "momentum": equations over steps, without
                accelerations. By default "torque" if accelerations were measured and torques are not held
    hold        "after": a torque acts from its sample to the next one, like that of a controller; "before": up to its
                sample; None: it is the torque at its time
    delay       the torque of time t acts at t + delay [s]; True fits it. Wrenches are not delayed
    window      number of rows to average, of motion and torque: less noise of velocities, fewer equations
    cutoff      [Hz] of a filter without phase for positions whose derivatives were not measured; None for no filter
    v_min       rows in which a joint is slower do not count if its dry friction acts in them [rad/s | m/s]: above 0 if
                a joint may stick. Rows in which it reverses do not count either, except samples with accelerations
    payload     a frame: the unknowns are the ten parameters of a load there, the robot's own are known
    bodies      names of joints whose bodies are unknown; all by default. With inertial parameters, without payload
    rows        "all", or "base": the six of a floating base, for measured ``wrenches``
    remove      remove base parameters with a deviation above this share of them, the worst first; None for none

    The noise of a freedom counts as at least 1e-6 of its torque: every method fits exact torques, such as computed
    ones, with intervals of that size.

    Returns Identified: ``print`` shows it; ``model()``, ``scene()``, ``validate(recording)``, ``report(path)``.
    Raises  IdentificationError for parameters that the recording does not determine, with a table of them, too few
            samples, a torque that was not recorded, flight; ShapeError, ModelError, SpatialDynError for arguments
    Source  Gautier, Khalil; Wensing, Kim, Slotine (2018); Rucker and Wensing (2022); the files cite them in full.

    >>> import numpy as np, spatialdyn as sd
    >>> model, t = sd.load_urdf("two_link"), np.linspace(0.0, 4.0, 401)
    >>> path = sd.fourier([[1.0, 0.5], [0.4, 1.5]], [[0.2, 1.0], [0.8, 0.1]], 0.25, [0.3, 0.1])
    >>> q, v, a = path(t)
    >>> log = sd.Recording(t, q, sd.rnea(model, q, v, a), v, a)
    >>> found = sd.identify(log, model, parameters="inertial")
    >>> bool(abs(found.beta - found.base.K @ np.ravel(sd.inertial_parameters(model)[1:])).max() < 1e-9)
    True
    """
    scene = scene_of(model)
    as_word("method", method, METHODS)
    if method == "sdp":
        semidefinite.need_cvxpy()
    for name, known in (("contacts", scene.contacts), ("constraints", scene.constraints), ("fext", scene.fext)):
        if known is not None:
            raise IdentificationError(
                f"scene has {name}, expected none: no equation has their forces, which are measured as wrenches"
            )
    robot, weight = scene.model, _prior(method, prior)
    words = words_of(parameters)
    names = None if bodies is None else tuple(names_of("bodies", bodies))
    unknowns = unknowns_of(robot, words, payload, names)
    as_word("rows", rows, ROWS)
    if rows == "base" and not floats(robot):
        raise IdentificationError(f'rows is "base", expected "all": robot "{robot.name}" has no floating base')
    given, once = _recordings(recording)
    first, logs = _peeked(given)
    settings = Settings(
        unknowns, _form(form, hold, first), hold if hold is None else as_word("hold", hold, HOLDS),
        as_count(window, MOST_WINDOW) or _refuse("window", window, "a number of rows of 1 or more"),
        None if cutoff is None else _positive("cutoff", cutoff), _not_negative("v_min", v_min),
        scene.friction if not isinstance(scene.friction, bool) else None, rows == "base",
    )  # fmt: skip
    base = structural_base(robot, words, payload, names, rows)
    share = None if remove is None else _positive("remove", remove)
    weighted = method != "ols"
    fixed = isinstance(delay, (bool, np.bool_)) and bool(delay)
    late = 0.0 if isinstance(delay, (bool, np.bool_)) else as_number(delay)
    if not math.isfinite(late):
        _refuse("delay", delay, "a finite number of seconds, or True")

    reduced = _reduced(logs, robot, settings, base, None if once else KEPT // len(given), None if fixed else late)
    kept, factors, shared, notes = reduced
    extra = 0
    shows = any(bool(one.torques[:, : settings.freedoms].any()) for one in kept)
    if fixed and not shows:
        _refuse("delay", delay, "a number of seconds: the torques of these rows are all 0, wrenches have no delay")
    if fixed:
        late, factors = fitted_delay(kept, base.columns, weighted)
        shared = max(one.shared(late) for one in kept)
        extra = 1
    assert factors is not None
    if factors.n.sum() < TIMES_RANK * base.rank:
        raise IdentificationError(
            f"recording has {int(factors.n.sum())} equations, expected {TIMES_RANK * base.rank} or more, "
            f"{TIMES_RANK} for each of {base.rank} base parameters"
        )
    if not fixed and shows and late == 0.0 and len(kept[0].motion) > 8 * settings.window:
        best = whole_delay(kept[:1], base.columns, 3, LOOK)
        if best:
            notes.append(
                f"torques fit best {best} samples, {best * kept[0].recording.dt:g} s, away from the motion: delay=True"
            )
    fit = fit_base(factors, base, extra, weighted, share, method)
    inflation, white = np.full(len(factors.R), shared[1]), np.full(len(factors.R), np.nan)
    residuals, t = np.zeros((0, len(factors.R))), np.zeros(0)
    if kept:
        t, residuals = _residuals(kept, base, fit.beta, late)
        white, inflation = _white(residuals, factors.floor, shared)
        freedoms = freedoms_of(robot)
        uneven = [freedoms[k] for k in np.flatnonzero(white < WHITE)]
        if uneven:
            notes.append(
                f"residuals are not white, intervals are widened for it: {', '.join(uneven[:8])}"
                f"{' and others' if len(uneven) > 8 else ''}{_unused(settings, fixed or bool(late) or not shows)}"
            )
    fit = fit_base(factors, base, extra, weighted, share, method, inflation, fit)
    bounds: tuple[str, ...] = ()
    if method in ("ols", "wls"):
        pi = _nearest(base, fit.beta, unknowns.present)
        beta, steps, ok = fit.beta, 0, False
    else:
        made = _consistent(method, fit, base, unknowns, weight)
        pi, steps = made.pi, made.steps
        beta = base.K @ pi
        offset = 10 * len(unknowns.bodies)
        exist = positive(pi[:offset].reshape(-1, 10))
        ok = bool(exist.all())
        lost = ", ".join(unknowns.bodies[k].name for k in np.flatnonzero(~exist))
        notes += [*made.notes, *([] if ok else [f"inertias of {lost} are not positive beyond rounding"])]
        bounds = tuple(unknowns.names[offset + k] for k in np.flatnonzero(made.held))
    return Identified(
        robot, method, base, beta, fit.deviation, fit.deviation * quantile(float(factors.n.sum() - base.rank)),
        fit.covariance, pi, ok, fit.solution.sigma, white, residuals, t, factors.n, late, fit.late, fit.values,
        fit.seen, tuple(base.labels[k] for k in fit.removed), bounds, tuple(notes), steps, settings,
    )  # fmt: skip


# --- from the base to bodies ----------------------------------------------------------------------------------


def _reduced(
    logs: Iterable[Recording], robot: Model, settings: Settings, base: Base, size: int | None, late: float | None
) -> tuple[list[Equations], Factors | None, tuple[int, float], list[str]]:
    """Equations of recordings, their factors, rows that share noise, and notes.

    size  numbers that the equations of a recording may keep; None if recordings can be read once: none are returned
    late  delay [s]; None to fit it later, without factors
    """
    kept: list[Equations] = []
    notes: list[str] = []
    factors: Factors | None = None
    shared = 1, 1.0
    for log in logs:
        notes += [x for x in log.check(robot) if x not in notes]
        refuse_flight(log, settings)
        one = Equations(log, settings, size or 0)
        if late is None and size is None:
            _refuse("recording", "a generator", "a list of Recordings: a delay that is fitted takes several passes")
        kept += [one] * (size is not None)
        if late is not None:
            factors = added(factors, factors_of(one.rows(late), base.columns))
            shared = max(shared, one.shared(late))
    return kept, factors, shared, notes


def _residuals(equations: list[Equations], base: Base, beta: Array, delay: float) -> tuple[Array, Array]:
    t, off = [], []
    for one in equations:
        for rows in one.rows(delay):
            t.append(rows.t)
            off.append(np.where(rows.keep, rows.y - rows.W[:, :, base.columns] @ beta, np.nan))
    return np.concatenate(t), np.concatenate(off)


def _white(residuals: Array, floor: Array, shared: tuple[int, float]) -> tuple[Array, Array]:
    """``whiteness`` of each freedom; residuals below the noise floor, as of exact torques, count as white."""
    found = np.array([np.ones(len(floor)), np.full(len(floor), shared[1])])
    for k, x in enumerate(residuals.T):
        x = x[np.isfinite(x)]
        if len(x) and np.sqrt(np.mean(x**2)) > floor[k]:
            found[:, k] = whiteness(x, *shared)
    return found[0], found[1]


def _unused(settings: Settings, late: bool) -> str:
    """The unused settings that could make residuals white, in words."""
    dry = any(kind == "coulomb" for kind, _ in settings.unknowns.joints)
    given = {
        "hold=": settings.hold is not None, "delay=True": late, "cutoff=": settings.cutoff is not None,
        "v_min=": settings.v_min > 0.0 or not dry,
    }  # fmt: skip
    words = [word for word, used in given.items() if not used]
    return f"; not tried: {', '.join(words)}" if words else ""


def _nearest(base: Base, beta: Array, present: Array) -> Array:
    """π with K π = β, nearest to the model's own values, each difference relative to its size."""
    size = np.maximum(abs(present), 1e-3 * max(1e-9, abs(present).max(initial=0.0)))
    size[base.columns] = np.maximum(size[base.columns], 1e-6)
    change, *_ = np.linalg.lstsq(base.K * size, beta - base.K @ present, rcond=1e-13)
    return np.asarray(present + size * change)


def _consistent(method: str, fit: BaseFit, base: Base, unknowns: Any, weight: float) -> log_cholesky.Consistent:
    """The consistent parameters of the weighted least squares of a fit, from the model's own."""
    p = len(fit.kept)
    R = fit.solution.R[:p, :p]
    z = R @ fit.solution.beta[:p]
    bodies = len(unknowns.bodies)
    start = np.array(unknowns.present)
    own = start[: 10 * bodies].reshape(bodies, 10)
    if unknowns.load:
        own[0] = _nearest(base, fit.beta, start)[:10]
    typical = np.linalg.norm(own[:, :1], axis=0).max(initial=0.0) or 1.0
    bare = np.linalg.eigvalsh(pseudo_inertia(own))[:, -1] <= 0.0
    own[bare] = 1e-3 * typical * np.array([1.0, 0.0, 0.0, 0.0, 4e-3, 0.0, 4e-3, 0.0, 0.0, 4e-3])
    start[: 10 * bodies] = consistent(own, FLOOR).ravel()
    A = R @ base.K[fit.kept]
    solver = log_cholesky.fit if method == "log_cholesky" else semidefinite.fit
    return solver(A, z, start, bodies, unknowns.bounded, weight)


# --- arguments ----------------------------------------------------------------------------------------------


def _recordings(given: Any) -> tuple[Any, bool]:
    """An iterable of recordings, and whether it can be iterated only once."""
    if isinstance(given, Recording):
        return [given], False
    if not isinstance(given, Iterable) or getattr(given, "ndim", 1) == 0:
        raise IdentificationError(f"recording is a {type(given).__name__}, expected a Recording, or several")
    return given, not isinstance(given, (list, tuple))


def _peeked(logs: Any) -> tuple[Recording, Any]:
    """The first Recording, and an iterator over all of them. Raises IdentificationError."""
    walk = iter(logs)
    first = next(walk, None)
    if first is None:
        raise IdentificationError("recording is empty, expected one Recording or more")
    if not isinstance(first, Recording):
        raise IdentificationError(f"recording has {literal(first)}, expected a Recording")

    def every() -> Any:
        yield first
        for log in walk:
            if not isinstance(log, Recording):
                raise IdentificationError(f"recording has a {type(log).__name__}, expected a Recording")
            yield log

    return first, every()


def _form(form: str | None, hold: str | None, first: Recording) -> str:
    if form is None:
        return "momentum" if hold is not None or first.a is None else "torque"
    as_word("form", form, FORMS)
    if form == "torque" and hold is not None:
        raise IdentificationError(
            f'form is "torque" and hold {literal(hold)}, expected "momentum": a held torque is the mean of a step'
        )
    return form


def _prior(method: str, prior: float | None) -> float:
    if prior is None:
        return PRIOR
    if method in ("ols", "wls"):
        raise IdentificationError(f'prior is {literal(prior)}, expected None for method "{method}", which has none')
    return _positive("prior", prior)


def _positive(name: str, value: Any) -> float:
    x = as_number(value)
    return x if LEAST <= x < math.inf else _refuse(name, value, "a finite number above 0")


def _not_negative(name: str, value: Any) -> float:
    x = as_number(value)
    return x if 0.0 <= x < math.inf else _refuse(name, value, "a finite number of 0 or more")


def _refuse(name: str, value: Any, expected: str) -> Any:
    raise IdentificationError(f"{name} is {literal(value)}, expected {expected}")
