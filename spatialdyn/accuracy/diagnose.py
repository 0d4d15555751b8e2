"""``diagnose``: oddities of a model, found before use: inertias, mass ratios, digits, time steps."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..actuation.friction import Friction, check_friction
from ..calls.arguments import as_array, check_model
from ..calls.dynamics import calls
from ..calls.failures import joint_of_velocity
from ..calls.forward_dynamics import EXTENDED
from ..calls.progress import Progress, Steps, check_progress, reporting
from ..calls.random_configurations import random_configuration
from ..engines.compiled import numba_kernels
from ..engines.programs.transform import float32_range
from ..errors import NonFiniteError, ShapeError
from ..model.model import Joint, Model
from ..model.physical_inertia import inertia_defect
from ..recursions import SPECS
from .findings import SEVERITIES, Diagnosis, Finding, Stiffest
from .predicted_digits import EPS as ROUNDING
from .predicted_digits import INPUTS, digits_of, method_errors, program_errors

Array = NDArray[np.float64]

SAMPLES = 8  # random states in which M is examined
LARGE = 256  # freedoms above which M is examined in one random state only: a state costs O(n³)
STATES = 8 if numba_kernels.PLAIN else 512  # in which digits are measured
WORK = 2e9  # limit on states times freedoms cubed: crba_solve takes n³/3 operations
EPS = ROUNDING["float64"]
HEAVY = 1e3  # a body this many times heavier than all bodies that carry it costs a digit or more
POOR = 10.0  # digits of ABA in float64: fewer are a warning
LOST = 6.0  # fewer are an error
FEW = 3.0  # digits of ABA in float32: fewer are a note
ILL = 1e8  # scaled condition of M that costs half of the digits of float64
WORSE = 10.0  # times the error of the table kernel: a program with more has lost a digit
LEVELS = (0.5, 0.9, 1.0)  # quantiles of states: in the worst state of an ill-conditioned robot both lose digits
SLACK = 16.0  # allowed in addition [eps]: another order of rounding, not fewer digits
# Of the 68 robots of example-robot-data, the widest radius of gyration is 3.2 m on a body of 0.1 m (1 kg m² at 0.1 kg,
# invented values) and the farthest reach 1 m; millimetres taken for metres are a factor of 1000.
WIDE, APART = 3.0, 30.0  # metres: a radius of gyration, and a reach, beyond which units are in doubt
BESIDE = 100.0  # if also this many times the other of the two
HUGE = 300.0  # metres: a reach in doubt for any radius of gyration


def diagnose(
    model: Model, q: ArrayLike | None = None, progress: Progress = False, friction: Friction | bool | None = None
) -> Diagnosis:
    """Oddities of a model, their cost in digits and their remedies.

    * links with an inertia that is not physical, and moving links without mass
    * inertias and lengths in other units: a radius of gyration far above or below the reach of the link and its
      neighbours
    * bodies 1000 times heavier than all bodies that carry them: ABA subtracts nearly equal inertias there
    * the condition number of M scaled to a unit diagonal, which does not depend on units
    * joints with zero articulated inertia, and bodies whose inertia does not enter M
    * digits of ``forward_dynamics`` by method, in float64 and float32, measured against double-double arithmetic
    * calls whose program is a digit less accurate than the table kernel
    * links too light or too heavy for float32's range, whose programs fall back to float64
    * the largest time step of explicit integrators, with joint damping as a torque
    * with friction: joints whose bristles may generate energy, because b < σ1 (F_s - F_c)/F_c

    model   Model
    q       (nq,)   the only state to examine [rad | m]; by default neutral and random ones, the same in every call
    progress        True for a bar (needs rich), or a function of the number of steps done and their total
    friction        a Friction of the joints, or True for that of the URDF

    Returns a Diagnosis: ``findings``, ``condition``, ``digits``, ``programs``, ``stiffest`` and the number of
    ``states``; ``print`` shows it, ``to_json()`` writes it. Robots of many freedoms are examined in fewer states:
    neutral and 512 others up to 157 freedoms, 250 at 200, 2 at 1000. Programs for batches are compiled once per model,
    which takes seconds: five calls up to 32 freedoms, rnea and aba up to 128. There are no digits for a model with
    mimic joints or a joint with zero articulated inertia.
    Raises  ShapeError, NonFiniteError for q; ConfigurationError for its norms; ModelError, ShapeError for friction.

    >>> import spatialdyn as sd
    >>> found = sd.diagnose(sd.load_urdf("two_link"))
    >>> found.severity
    'ok'
    >>> found.digits["aba"]["float64"] > 14
    True
    """
    check_model(model)
    check_progress(progress)
    rubs = None if friction is None or friction is False else check_friction(model, friction)
    with reporting(progress, "diagnose") as report:
        steps = Steps(report, 2 + len(INPUTS))
        found = _diagnose(model, q, steps, rubs)
        steps.next(steps.total)
        return found


def _diagnose(model: Model, q: ArrayLike | None, steps: Steps, friction: Friction | None) -> Diagnosis:
    positions, arrays = _states(model, q)
    findings = [*_links(model), *_units(model), *_mass_ratios(model)]
    findings += [] if friction is None else _active_bristles(model, friction)
    condition: dict[str, float] = {}
    digits: dict[str, dict[str, float]] = {}
    programs: dict[str, dict[str, float]] = {}
    stiffest: Stiffest | None = None
    states = 0
    if model.nv:
        M = np.asarray(calls["crba"](model, positions))
        singular = list(_singular(model, M))
        findings += [*singular, *_unfelt(model, positions), *_out_of_range(model, M)]
        condition, found = _conditions(model, M, "neutral" if q is None else "given")
        findings += found
        if not singular:
            stiffest = _stiffest(model, M)
            findings += _time_step(model, stiffest)
        if model.mimic_matrix is None and not singular:
            steps.next()
            states = len(arrays[0])
            errors = method_errors(model, arrays)
            digits = {
                method: {dtype: digits_of(found, ROUNDING[dtype]) for dtype, found in of.items()}
                for method, of in errors.items()
            }
            findings += _digits(model, digits, errors["aba"]["float64"], arrays[0], "" if q is not None else "neutral")
            judged = program_errors(model, arrays, steps.next) if len(arrays[0]) >= STATES else {}
            programs = {
                call: {"single": digits_of(alone), "batch": digits_of(batch)} for call, (alone, batch) in judged.items()
            }
            findings += _programs(model, judged)
    findings.sort(key=lambda f: -SEVERITIES.index(f.severity))
    return Diagnosis(model.name, tuple(findings), condition, digits, stiffest, programs, states, model)


def _states(model: Model, q: ArrayLike | None) -> tuple[Array, list[Array]]:
    """The positions at which M is examined, and the q, v, tau at which digits are measured; v and tau are normal.

    Positions are only q if given, else neutral followed by random ones.
    Raises ShapeError, NonFiniteError for an invalid q.
    """
    rng = np.random.default_rng(0)
    count = int(max(1, min(STATES, WORK // max(model.nv, 1) ** 3)))
    if q is None:
        rest = np.asarray(calls["neutral"](model))[None]
        drawn = random_configuration(model, rng, max(count, SAMPLES))
        looked = drawn[: SAMPLES if model.nv <= LARGE else 1]
        positions, measured = np.concatenate([rest, looked]), np.concatenate([rest, drawn[:count]])
    else:
        given = as_array("q", q)
        if given.shape != (model.nq,):
            raise ShapeError(f"q has shape {given.shape}, expected ({model.nq},)")
        if not np.isfinite(given).all():
            raise NonFiniteError(f"q is {given.tolist()}, expected finite numbers")
        positions, measured = given[None], np.tile(given, (count, 1))
    v, tau = rng.normal(size=(2, len(measured), model.nv))
    return positions, [np.ascontiguousarray(measured), v, tau]


# --- bodies ----------------------------------------------------------------------------------------------


def _link(model: Model, joint: Joint) -> str:
    """The link that hangs on a joint."""
    return next((j.child for j in model.robot.joints if j.name == joint.name), model.robot.root)


def _links(model: Model) -> Iterator[Finding]:
    """Inertias that are not physical, and links fixed in the world."""
    for link in model.robot.links:
        I = np.reshape(link.inertia, (3, 3))
        defect = inertia_defect(I)
        if defect:
            severity = "error" if _gives_energy(model, link.name) else "warning"
            yield Finding(severity, "inertia", link.name, defect, 'load with inertia="repair", or measure it again')
        elif link.mass == 0.0 and I.any():
            what = "has a rotational inertia but no mass, which no distribution of mass has"
            yield Finding("warning", "inertia", link.name, what, "give it a mass, or make it the joint's armature")
        if link.mass > 0.0 and model.frame(f"link:{link.name}").joint == 0:
            what = f"of {link.mass:.6g} kg is fixed in the world, so no motion can feel it"
            yield Finding("note", "unfelt", link.name, what, 'nothing to do, or root="floating"')


def _units(model: Model) -> Iterator[Finding]:
    """Links whose radius of gyration and reach differ widely: inertias or lengths in units other than kg and m."""
    links = {link.name: link for link in model.robot.links}
    radius, reach = {}, dict.fromkeys(links, 0.0)
    for name, link in links.items():
        if link.mass > 0.0:
            moment = float(abs(np.linalg.eigvalsh(np.reshape(link.inertia, (3, 3)))).max())
            radius[name], reach[name] = math.sqrt(moment / link.mass), math.hypot(*link.com)
    for j in model.robot.joints:
        reach[j.parent] = max(reach[j.parent], math.hypot(*np.reshape(j.placement, (4, 4))[:3, 3].tolist()))
    farthest = dict(reach)
    for j in model.robot.joints:
        farthest[j.parent] = max(farthest[j.parent], reach[j.child])
        farthest[j.child] = max(farthest[j.child], reach[j.parent])
    wide = {n: k for n, k in radius.items() if k > WIDE and k > BESIDE * farthest[n] > 0.0}
    far = {n: r for n, r in reach.items() if r > HUGE or (r > APART and n in radius and r > BESIDE * radius[n])}
    if wide:
        worst = max(wide, key=lambda n: wide[n] / farthest[n])
        others = f", as have {len(wide) - 1} others of {len(radius)}" if len(wide) > 1 else ""
        yield Finding(
            "warning", "units", worst,
            f"has a radius of gyration of {wide[worst]:.3g} m, and with its neighbours reaches {farthest[worst]:.3g} m"
            f"{others}: units?",
            "give rotational inertias in kg m², which are 1e-6 of those in kg mm²",
        )  # fmt: skip
    if far:
        worst = max(far, key=lambda n: far[n])
        others = f", as do {len(far) - 1} others of {len(reach)}" if len(far) > 1 else ""
        width = f"has a radius of gyration of {radius[worst]:.3g} m and " if worst in radius else ""
        yield Finding(
            "warning", "units", worst,
            f"{width}reaches {far[worst]:.3g} m, to its center of mass or its farthest joint{others}: units?",
            "give lengths in m, which are 1e-3 of those in mm",
        )  # fmt: skip


def _gives_energy(model: Model, link: str) -> bool:
    """Whether some motion of the rigid body of a link has negative kinetic energy."""
    I = _spatial_inertia(model, model.joints[model.frame(f"link:{link}").joint].row)
    values = np.linalg.eigvalsh(I)
    return bool(values[0] < -64 * EPS * values[-1])


def _ratios(model: Model) -> Iterator[tuple[Joint, float, float, int]]:
    """For each joint carried by others: the joint, the mass of its body [kg], the mass of the heaviest body that
    carries it [kg], and the number of such bodies.
    """
    mass = model.bodies["inertia"]["m"]
    heaviest, carriers = [0.0], [0]
    for joint in model.joints[1:]:
        up = joint.parent
        heaviest.append(max(heaviest[up], float(mass[model.joints[up].row])) if up else 0.0)
        carriers.append(carriers[up] + 1 if up else 0)
        if carriers[-1]:
            yield joint, float(mass[joint.row]), heaviest[-1], carriers[-1]


def _mass_ratios(model: Model) -> Iterator[Finding]:
    """Bodies much heavier than every body that carries them; light bodies on heavy ones cost no digits."""
    for joint, own, heaviest, carriers in _ratios(model):
        if own > HEAVY * heaviest:
            what = f"is {own / heaviest:.2g} times heavier than every body" if heaviest > 0.0 else "hangs on bodies"
            rest = "that carries it" if heaviest > 0.0 else "without mass only"
            severity = "warning" if carriers >= 3 else "note"  # with fewer joints almost nothing cancels
            yield Finding(
                severity, "mass ratio", _link(model, joint), f"{what} {rest}, at {own:.4g} kg",
                'add armature to the joints before it, merge the light links, or take method="refined"',
            )  # fmt: skip


def _singular(model: Model, M: Array) -> Iterator[Finding]:
    """Joints whose entry on the diagonal of M is 0 in every state."""
    diagonal = np.einsum("kii->ki", M).max(axis=0)
    for joint in model.joints[1:]:
        if joint.mimic is None and not (diagonal[joint.idx_v : joint.idx_v + joint.nv] > 0.0).all():
            yield Finding(
                "error", "singular", _link(model, joint),
                f'hangs on joint "{joint.name}", which has zero articulated inertia',
                "give the joint an armature, or lock it",
            )  # fmt: skip


def _unfelt(model: Model, positions: Array) -> Iterator[Finding]:
    """Bodies whose inertia adds nothing to M: Jᵀ I J is 0 to rounding in every state."""
    for joint in model.joints[1:]:
        I = _spatial_inertia(model, joint.row)
        if not I.any():
            continue
        if joint.mimic is None and np.linalg.eigvalsh(I)[0] > 64 * EPS * np.linalg.norm(abs(I)):
            continue  # the joint's own columns of J are not 0, so what they add is more than rounding
        J = np.asarray(calls["frame_jacobian"](model, positions, f"joint:{joint.name}"))
        added = np.einsum("kia,ij,kja->ka", J, I, J)
        size = np.einsum("kia,ij,kja->ka", abs(J), abs(I), abs(J))
        if (abs(added) <= 64 * EPS * size).all():
            yield Finding(
                "note", "unfelt", _link(model, joint), "has an inertia that no motion can feel",
                "leave it out: no joint turns or moves it in a direction that has inertia",
            )  # fmt: skip


def _spatial_inertia(model: Model, row: int) -> Array:
    """I (6, 6) of a body about its joint's frame, linear first."""
    m, (x, y, z), (xx, xy, xz, yy, yz, zz) = model.bodies["inertia"][row].tolist()
    h = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.block([[m * np.eye(3), h.T], [h, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])]])


# --- the mass matrix -------------------------------------------------------------------------------------


def _conditions(model: Model, M: Array, first: str) -> tuple[dict[str, float], list[Finding]]:
    """Condition numbers of M scaled to a unit diagonal, in the first state and in the worst other state; findings."""
    with np.errstate(all="ignore"):  # an inertia that is not physical may make an entry of the diagonal negative
        scale = np.sqrt(np.einsum("kii->ki", M))
        unit = M / (scale[:, :, None] * scale[:, None, :])
    if not np.isfinite(unit).all():
        return {first: math.inf, **({"sampled": math.inf} if len(M) > 1 else {})}, []
    values, vectors = np.linalg.eigh(unit)
    found = [float(v[-1] / v[0]) if v[0] > 0.0 else math.inf for v in values]
    conditions = {first: found[0]}
    if len(found) > 1:
        conditions["sampled"] = max(found[1:])
    worst = int(np.argmax(found))
    if found[worst] <= ILL:
        return conditions, []
    joint = joint_of_velocity(model, int(np.argmax(abs(vectors[worst, :, 0]))))
    message = f'hangs on joint "{joint.name}", along which M scaled to a unit diagonal has condition {found[worst]:.2g}'
    remedy = 'add armature to the joint, lock it, or take method="refined"'
    return conditions, [Finding("warning", "condition", _link(model, joint), message, remedy)]


def _stiffest(model: Model, M: Array) -> Stiffest | None:
    """The joint of the largest eigenvalue of M⁻¹ diag(damping) in all states; without damping that of least inertia."""
    root = np.sqrt(np.maximum(model.damping, 0.0))
    try:
        inverse = np.linalg.inv(M)
    except np.linalg.LinAlgError:
        return None
    free = np.einsum("kii->ki", inverse)
    if not (np.isfinite(inverse).all() and (free > 0.0).all()):
        return None
    rate = 0.0
    if root.any():
        rates, vectors = np.linalg.eigh(root[:, None] * inverse * root)
        at = int(np.argmax(rates[:, -1]))
        rate = float(rates[at, -1])
    if rate > 0.0:
        k = int(np.argmax(abs(vectors[at, :, -1])))
    else:
        at, k = (int(x) for x in np.unravel_index(np.argmax(free), free.shape))
    dt = 2.0 / rate if rate > 0.0 else math.inf
    return Stiffest(joint_of_velocity(model, k).name, 1.0 / float(free[at, k]), max(rate, 0.0), dt)


def _time_step(model: Model, stiffest: Stiffest | None) -> Iterator[Finding]:
    """A finding if the largest stable step is below 1 ms, the step of most simulations."""
    if stiffest is None or stiffest.dt >= 1e-3:
        return
    yield Finding(
        "warning", "time step", _link(model, model.joint(stiffest.joint)),
        f'hangs on joint "{stiffest.joint}", whose damping decays at {stiffest.rate:.3g} 1/s: explicit Euler is stable '
        f"to dt {stiffest.dt:.2g} s only",
        f"add armature to the joint (it moves {stiffest.inertia:.2g}), damp it less, or lock it",
    )  # fmt: skip


def _active_bristles(model: Model, friction: Friction) -> Iterator[Finding]:
    """Joints whose LuGre friction is not passive from v to its torque: some motions gain energy from it.

    b >= σ1 (F_s - F_c)/F_c makes it passive (Barabanov and Ortega, Necessary and sufficient conditions for passivity of
    the LuGre friction model, 2000).
    """
    if friction.bristle_damping is None:
        return
    for k, (fc, fs, b, d) in enumerate(
        zip(friction.coulomb, friction.static, friction.viscous, friction.bristle_damping, strict=True)
    ):
        rise = d * (fs - fc)  # F_c times the least b
        if b * fc < rise:
            joint = joint_of_velocity(model, k)
            least = rise / fc if fc > 0.0 else math.inf
            yield Finding(
                "warning", "friction", _link(model, joint),
                f'hangs on joint "{joint.name}", whose bristles may give energy: its damping of {b:.4g} is below '
                f"{least:.4g}, its bristle damping times (static - Coulomb) / Coulomb friction",
                f"damp it by {least:.4g}, lower bristle_damping or the static friction, or take "
                'friction_method="implicit"',
            )  # fmt: skip


# --- digits ----------------------------------------------------------------------------------------------


def _digits(
    model: Model, digits: dict[str, dict[str, float]], errors: Array, positions: Array, first: str
) -> Iterator[Finding]:
    """The digits that ABA loses, their cause (the link heaviest relative to its carriers, or the joint that keeps the
    least part of its inertia), and the best method.

    errors  (n,) of ABA in float64, in n positions
    first   name of the first position, if the others are random
    """
    aba = digits["aba"]
    better = {m: d["float64"] for m, d in digits.items() if m != EXTENDED}
    best = max(better, key=lambda m: (better[m] > better["refined"] + 1.0, m == "refined"))
    if aba["float64"] < POOR:
        only = f" in {first}, and {digits_of(errors[1:]):.0f} elsewhere" if first and not int(np.argmax(errors)) else ""
        link, what = _loser(model, positions[int(np.argmax(errors))])
        remedy = f'take method="{best}", which keeps {better[best]:.0f}'
        every = f'"{EXTENDED}", which keeps {digits[EXTENDED]["float64"]:.0f}'
        if better[best] <= aba["float64"] + 1.0:
            remedy = f"take method={every}, or give the joint an armature: no method in float64 keeps more"
        elif better[best] < POOR:
            remedy += f", or {every}"
        yield Finding(
            "error" if aba["float64"] < LOST else "warning", "digits", link,
            f"{what}leaves ABA about {aba['float64']:.0f} digits in float64{only}", remedy,
        )  # fmt: skip
    if aba["float32"] < FEW:
        lost = ", whose programs turn to float64 where a pivot is lost" if aba["float32"] < 1.0 else ""
        what = f"leaves ABA about {aba['float32']:.0f} digits in float32{lost}"
        yield Finding("note", "digits", _heaviest(model), what, "stay with float64")


def _loser(model: Model, q: Array) -> tuple[str, str]:
    """The link that costs ABA digits in a state, and the reason: its mass, or the inertia that its joint keeps."""
    if any(own > HEAVY * heaviest for _, own, heaviest, _ in _ratios(model)):
        return _heaviest(model), ""
    n, spec = model.nv, SPECS["minverse"]
    pivots = np.empty(n)
    with np.errstate(all="ignore"):
        spec.recursion(model.bodies, np.zeros(n + 1, spec.work), q, np.empty((n, n)), pivots)
        left = pivots / np.diag(np.asarray(calls["crba"](model, q)))
    k = int(np.argmin(np.where(np.isfinite(left), left, 0.0)))
    joint = joint_of_velocity(model, k)
    part = max(float(left[k]), 0.0)
    return _link(model, joint), (
        f'hangs on joint "{joint.name}", which moves {part:.1g} of its inertia when what it carries is free, and '
    )


def _programs(model: Model, judged: dict[str, tuple[Array, Array]]) -> Iterator[Finding]:
    """Calls whose program has a digit fewer than the table kernel."""
    lost = {}
    for call, errors in judged.items():
        for level in LEVELS:
            alone, batch = (float(np.quantile(x, level, method="higher")) for x in errors)
            if batch > WORSE * alone + SLACK * EPS:
                lost[call] = digits_of(np.array(alone)), digits_of(np.array(batch))
    if lost:
        which = ", ".join(f"{call} {batch:.1f} of {alone:.1f}" for call, (alone, batch) in lost.items())
        yield Finding(
            "warning", "programs", _heaviest(model),
            f"is part of a robot whose programs keep fewer digits than the table kernel: {which}",
            "call spatialdyn.kernels, which are table kernels, in a jitted loop of your own",
        )  # fmt: skip


def _out_of_range(model: Model, M: Array) -> Iterator[Finding]:
    """Links whose inertia, or whose joint's inertia in every state, is outside the range of float32."""
    beyond = set(float32_range.beyond(model.bodies))
    diagonal = np.einsum("kii->ki", M).max(axis=0)
    for joint in model.joints[1:]:
        moved = diagonal[joint.idx_v : joint.idx_v + joint.nv] if joint.mimic is None else np.ones(1)
        mass, small = float(model.bodies["inertia"]["m"][joint.row]), moved[moved > 0.0].min(initial=1.0)
        if joint.row in beyond or small < float32_range.LEAST or moved.max() > float32_range.MOST:
            worst = small if small < float32_range.LEAST else moved.max()
            what = "" if joint.row in beyond else f", whose joint moves an inertia of {worst:.3g},"
            yield Finding(
                "note", "range", _link(model, joint),
                f"of {mass:.4g} kg{what} is out of float32's range, 1e-18 to 1e18: programs of float32 turn to float64",
                "choose units in which masses and lengths are near 1, or stay with float64",
            )  # fmt: skip


def _heaviest(model: Model) -> str:
    """The link that is heaviest relative to its carriers."""
    ratios = {joint.name: own / heavy if heavy > 0.0 else math.inf for joint, own, heavy, _ in _ratios(model)}
    name = max(ratios, key=lambda name: ratios[name]) if ratios else model.joints[-1].name
    return _link(model, model.joint(name))
