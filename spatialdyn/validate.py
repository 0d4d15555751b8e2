"""Comparison with Pinocchio: every public call, entry by entry, on random states of one robot.

``CALLS`` is the whole of it: a line per call that says what ours takes and what Pinocchio's is called. An error is
max |x - x_pin| / max(1, max |x_pin|) of one result, the largest over all samples, frames and references. Forward
dynamics and the inverse of M are asked more: that their answer, put into Pinocchio's RNEA or times its M, gives back
the torque or 1; their values are compared too, where M is well conditioned. No float64 answer x gets such a residual
below what rounding its entries costs, about eps |M| |x|: a residual above BOUND may be up to four times that, and the
row says so (icub's M has a condition number of 4e10: the exact acceleration, rounded, misses tau by 3e-8).

Where Pinocchio has no answer (a joint that moves no inertia, a robot that moves no mass) or another question (planar
joints, whose axis it ignores), an identity is checked instead, and the row says so.

Pinocchio is imported inside functions only: ``pip install "spatialdyn[validate]"`` brings it.
"""

from __future__ import annotations

import os
import timeit
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import dynamics
from .border import core_shape
from .errors import InertiaError, NonFiniteError, SpatialDynError
from .model import Frame, Joint, Model
from .recursions import SPECS
from .urdf import find_robot, load_urdf

Array = NDArray[np.float64]

BOUND = 1e-11  # on the scaled error of an entry, and on the residuals of aba and minverse
VALUE_BOUND = 1e-9  # on values of aba and minverse: Pinocchio's own are off by 4e-8 on a floating icub
WELL_CONDITIONED = 1e5  # condition number of M, scaled to a diagonal of 1, up to which those values are compared
ANGLES = (0.5, 2.5)  # rad: below, Pinocchio's derivatives of difference lose digits; at pi the shorter way is open
FORWARD = ("aba", "aba_refined", "aba_square_root", "crba_solve")
RAISED = "bound raised to 4 eps |M| |x|"  # how the note begins where the bound on a residual is not BOUND
OMITTED = "left out where M is ill conditioned or Pinocchio's own residual above half the bound"  # note on values
REFERENCES = ("local", "world", "local_world_aligned")
ROUNDS, ROUND_SECONDS = 9, 1e-3


@dataclass(frozen=True)
class Row:
    """What came of one call.

    call      its name, and what is special about the way it was called
    error     scaled error, nan or infinite where a result is not finite or refused; None if nothing was compared
    bound     what the error may be
    ok        whether it is at most that
    note      why an identity stands in for Pinocchio, or what went wrong; empty otherwise
    ours_us, pin_us  time of one call from Python [µs], None if not taken
    """

    call: str
    error: float | None
    bound: float
    ok: bool
    note: str = ""
    ours_us: float | None = None
    pin_us: float | None = None

    @property
    def ratio(self) -> float | None:
        """Our time over Pinocchio's, None if not taken."""
        return self.ours_us / self.pin_us if self.ours_us and self.pin_us else None

    @property
    def badness(self) -> tuple[bool, float]:
        """What orders rows: failed ones last, then by error in units of the bound."""
        return not self.ok, _size(self.error) / self.bound


@dataclass(frozen=True)
class Comparison:
    """One robot with one kind of root against Pinocchio, a row per call."""

    robot: str
    root: str
    nq: int
    nv: int
    samples: int
    rows: tuple[Row, ...] = field(repr=False)

    @property
    def ok(self) -> bool:
        """Whether every row is within its bound."""
        return all(row.ok for row in self.rows)

    @property
    def worst(self) -> Row:
        """The row whose error is largest in units of its bound; a failed one before all others."""
        return max(self.rows, key=lambda row: row.badness)

    def row(self, call: str) -> Row:
        """The row of a call. Raises SpatialDynError if there is none of that name."""
        for row in self.rows:
            if row.call == call:
                return row
        raise SpatialDynError(f'call is "{call}", expected one of {", ".join(row.call for row in self.rows)}')


def compare_with_pinocchio(
    source: Any,
    root: str = "fixed",
    samples: int = 20,
    seed: int = 0,
    timing: bool = False,
    continuous: str = "cos_sin",
) -> Comparison:
    """Compare every public call with Pinocchio's on random states.

    source      path, URDF text or the name of a robot, as ``load_urdf`` takes them
    root        "fixed" or "floating"
    samples     number of random states, at least 1
    seed        of their generator
    timing      also time single calls of both from Python: median of interleaved rounds
    continuous  as ``load_urdf`` has it; "angle" fits Pinocchio on robots without continuous joints only

    Raises SpatialDynError if Pinocchio is not installed, refuses the robot, or has other sizes; UrdfError as
    ``load_urdf`` does.
    """
    pin = pinocchio()
    if samples < 1:
        raise SpatialDynError(f"samples is {samples}, expected at least 1")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = load_urdf(source, root=root, continuous=continuous)
    pin_model = pinocchio_model(source, root)
    if (model.nq, model.nv, model.njoints) != (pin_model.nq, pin_model.nv, pin_model.njoints):
        raise SpatialDynError(
            f'robot "{model.name}" has nq {model.nq}, nv {model.nv}, {model.njoints} joints, and in Pinocchio '
            f"{pin_model.nq}, {pin_model.nv}, {pin_model.njoints}"
        )
    peer = _Peer(pin, pin_model, model)
    states = random_states(model, samples, np.random.default_rng(seed))
    rows = [_joint_order(model, pin_model)]
    other = _other_question(model)
    for call in CALLS:
        why = other if call.peer else "Pinocchio has no such call"
        rows += [_by_identity(call, model, states, why)] if why else _compared(call, model, peer, states, timing)
    return Comparison(model.name, root, model.nq, model.nv, samples, tuple(rows))


def pinocchio() -> Any:
    """The module. Raises SpatialDynError saying how to get it if it is not installed."""
    try:
        import pinocchio as pin
    except ImportError:
        raise SpatialDynError('pinocchio is not installed; pip install "spatialdyn[validate]"') from None
    return pin


def pinocchio_model(source: Any, root: str = "fixed") -> Any:
    """Pinocchio's model of a path, URDF text or robot name. Raises SpatialDynError with its reason if it refuses."""
    pin = pinocchio()
    base = (pin.JointModelFreeFlyer(),) if root == "floating" else ()
    try:
        if isinstance(source, (str, bytes)) and source[:1] in ("<", b"<"):
            return pin.buildModelFromXML(source if isinstance(source, str) else source.decode(), *base)
        return pin.buildModelFromUrdf(str(_file_of(source)), *base)
    except (ValueError, RuntimeError) as error:
        if isinstance(error, SpatialDynError):
            raise
        raise SpatialDynError(f"Pinocchio refuses {str(source)[:80]!r}: {str(error).splitlines()[0]}") from None


def _file_of(source: Any) -> Path:
    if isinstance(source, os.PathLike) or os.path.isfile(source):
        return Path(source)
    return find_robot(source)


# --- states ----------------------------------------------------------------------------------------------


class States(NamedTuple):
    """Random states, samples first.

    q (n, nq), v, a, tau (n, nv), fext (n, njoints, 6); d (n, nv) a displacement with angles in ANGLES, q1 where it
    leads from q, t (n,) a part of the way, raw (n, nq) a configuration that is not of unit norm.
    """

    q: Array
    v: Array
    a: Array
    tau: Array
    fext: Array
    d: Array
    q1: Array
    t: Array
    raw: Array


def random_states(model: Model, samples: int, rng: np.random.Generator) -> States:
    """States around the neutral configuration, with standard normal entries."""
    step, v, a, tau, d = (rng.normal(size=(samples, model.nv)) for _ in range(5))
    for joint in model.joints[1:]:
        turning = _angular(joint)
        angle = np.linalg.norm(d[:, turning], axis=1, keepdims=True)
        if turning.stop > turning.start:
            d[:, turning] *= rng.uniform(*ANGLES, size=(samples, 1)) / angle
    q = dynamics.calls["integrate"](model, dynamics.calls["neutral"](model), step)
    q1 = dynamics.calls["integrate"](model, q, d)
    return States(q, v, a, tau, rng.normal(size=(samples, model.njoints, 6)), d, q1, rng.uniform(size=samples), 1.3 * q)


def _angular(joint: Joint) -> slice:
    """Where in v the angular velocity of a joint is."""
    first = {"prismatic": 1, "floating": 3, "planar": 2}.get(joint.kind, 0)
    return slice(joint.idx_v + first, joint.idx_v + joint.nv)


# --- the calls -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Call:
    """A public call beside Pinocchio's.

    label   of its row: the name of the call, and in brackets what is special
    inputs  fields of States that both take, in order
    peer    Pinocchio's function of (model, data, *inputs), or where it has none what makes one of those it has:
             a function of (pin, model, data, *inputs), which is not timed; empty if there is neither
    result  where Pinocchio leaves the answer in its data; None if it returns it
    frame   Pinocchio's function of (model, data, frame, reference) that follows ``peer``, for calls about a frame
    static  what ours takes after the frame and the reference
    data    whether ``peer`` takes data
    """

    label: str
    inputs: str
    peer: str | Callable[..., Any]
    result: Callable[[Any], Any] | None = None
    frame: str = ""
    static: tuple[Any, ...] = ()
    data: bool = True

    @property
    def name(self) -> str:
        """Of the public call."""
        return self.label.partition(" ")[0]

    @property
    def references(self) -> tuple[str, ...]:
        """The references it is asked in; none for a placement and for calls about no frame."""
        return REFERENCES if any(x.name == "reference" for x in SPECS[self.name].given) else ()

    @property
    def rank(self) -> int:
        """Axes of one result."""
        return len(SPECS[self.name].output.shape) if self.name in SPECS else 0


# --- what Pinocchio has no call for, of those that it has


def _coriolis_matrix(pin: Any, model: Any, data: Any, q: Array, v: Array) -> Array:
    """C (nv, nv), a matrix of one entry as well."""
    return np.array(pin.computeCoriolisMatrix(model, data, q, v), float).reshape(model.nv, model.nv)


def _mass_matrix_dot(pin: Any, model: Any, data: Any, q: Array, v: Array) -> Array:
    """C + Cᵀ."""
    C = _coriolis_matrix(pin, model, data, q, v)
    return C + C.T


def _coriolis_transpose(pin: Any, model: Any, data: Any, q: Array, v: Array) -> Array:
    """Cᵀ v."""
    C = _coriolis_matrix(pin, model, data, q, v)
    return C.T @ v


def _modified_rnea(pin: Any, model: Any, data: Any, q: Array, v: Array, v_r: Array, a_r: Array) -> Array:
    """M a_r + g, and C v_r."""
    at_rest = np.array(pin.rnea(model, data, q, np.zeros(model.nv), a_r), float).reshape(model.nv)
    C = _coriolis_matrix(pin, model, data, q, v)
    return np.asarray(at_rest + C @ v_r)


def _christoffel_symbols(pin: Any, model: Any, data: Any, q: Array) -> Array:
    """C is linear in v, and its columns at unit velocities are the symbols."""
    symbols = np.zeros((model.nv, model.nv, model.nv))
    for k, e in enumerate(np.eye(model.nv)):
        symbols[:, :, k] = _coriolis_matrix(pin, model, data, q, e)
    return symbols


def _mass_matrix_derivatives(pin: Any, model: Any, data: Any, q: Array) -> Array:
    """Γ_ijk + Γ_jik."""
    symbols = _christoffel_symbols(pin, model, data, q)
    return symbols + symbols.transpose(1, 0, 2)


CALLS = (
    _Call("rnea", "q v a", "rnea"),
    _Call("rnea (fext)", "q v a fext", "rnea"),
    _Call("crba", "q", "crba"),
    _Call("aba", "q v tau", "aba"),
    _Call("aba (fext)", "q v tau fext", "aba"),
    _Call("aba_refined", "q v tau", "aba"),
    _Call("aba_square_root", "q v tau", "aba"),
    _Call("crba_solve", "q v tau", "aba"),
    _Call("minverse", "q", "computeMinverse"),
    _Call("nonlinear_effects", "q v", "nonLinearEffects"),
    _Call("generalized_gravity", "q", "computeGeneralizedGravity"),
    _Call("static_torque", "q fext", "computeStaticTorque"),
    _Call("kinetic_energy", "q v", "computeKineticEnergy"),
    _Call("potential_energy", "q", "computePotentialEnergy"),
    _Call("total_mass", "", "computeTotalMass"),
    _Call("center_of_mass", "q", "centerOfMass"),
    _Call("center_of_mass_velocity", "q v", "centerOfMass", lambda data: data.vcom[0]),
    _Call("center_of_mass_acceleration", "q v a", "centerOfMass", lambda data: data.acom[0]),
    _Call("com_jacobian", "q", "jacobianCenterOfMass"),
    _Call("forward_kinematics", "q", "forwardKinematics", lambda data: list(data.oMi)),
    _Call("frame_placement", "q", "forwardKinematics", frame="updateFramePlacement"),
    _Call("frame_jacobian", "q", "computeJointJacobians", frame="getFrameJacobian"),
    _Call("frame_velocity", "q v", "forwardKinematics", frame="getFrameVelocity"),
    _Call("frame_acceleration", "q v a", "forwardKinematics", frame="getFrameAcceleration"),
    _Call(
        "frame_acceleration (classical)", "q v a", "forwardKinematics", None, "getFrameClassicalAcceleration", (True,)
    ),
    _Call("jacobian_dot_times_v", "q v", "computeJointJacobiansTimeVariation", frame="getFrameJacobianTimeVariation"),
    _Call("joint_jacobians", "q", "computeJointJacobians"),
    _Call("joint_jacobians_dot", "q v", "computeJointJacobiansTimeVariation"),
    _Call("centroidal_momentum", "q v", "computeCentroidalMomentum"),
    _Call("centroidal_map", "q", "computeCentroidalMap"),
    _Call("centroidal_map_dot", "q v", "dccrba", lambda data: data.dAg),
    _Call("coriolis_matrix", "q v", "computeCoriolisMatrix"),
    _Call("mass_matrix_dot", "q v", _mass_matrix_dot),
    _Call("coriolis_transpose_times_velocity", "q v", _coriolis_transpose),
    _Call("modified_rnea", "q v d a", _modified_rnea),
    _Call("christoffel_symbols", "q", _christoffel_symbols),
    _Call("mass_matrix_derivatives", "q", _mass_matrix_derivatives),
    _Call("neutral", "", "neutral", data=False),
    _Call("normalize", "raw", "normalize", data=False),
    _Call("integrate", "q d", "integrate", data=False),
    _Call("difference", "q q1", "difference", data=False),
    _Call("interpolate", "q q1 t", "interpolate", data=False),
    _Call("dintegrate", "q d", "dIntegrate", data=False),
    _Call("ddifference", "q q1", "dDifference", data=False),
    _Call("momentum", "q v", ""),
    _Call("velocity_from_momentum", "q tau", ""),
    _Call("hamiltonian", "q tau", ""),
    _Call("momentum_rate", "q v tau", ""),
    _Call("momentum_rate (fext)", "q v tau fext", ""),
    _Call("hamilton_field", "q tau a", ""),
)
_CRASHES_WITHOUT_FREEDOMS = ("getFrameJacobian", "getFrameJacobianTimeVariation")  # seen with Pinocchio 4.1
_BY_LABEL = {call.label: call for call in CALLS}


def _ours(call: _Call, model: Model, inputs: tuple[Any, ...]) -> Array:
    """Our answer; for calls about a frame (..., frames, references, *result)."""
    function = getattr(dynamics, call.name)
    if not call.frame:
        return np.asarray(function(model, *inputs))
    answers = [
        [function(model, *inputs, frame, *reference, *call.static) for reference in _words(call)]
        for frame in model.frames
    ]
    lead = np.ndim(answers[0][0]) - call.rank
    return np.moveaxis(np.array(answers), (0, 1), (lead, lead + 1))


def _words(call: _Call) -> list[tuple[str, ...]]:
    """The references as arguments: none is one way of calling."""
    return [(reference,) for reference in call.references] or [()]


class _Peer:
    """Pinocchio's model and data, and our frames' indices in it."""

    def __init__(self, pin: Any, pin_model: Any, model: Model) -> None:
        self.pin, self.ours, self.model, self.data = pin, model, pin_model, pin_model.createData()
        kinds = {pin.FrameType.BODY: "link", pin.FrameType.JOINT: "joint", pin.FrameType.FIXED_JOINT: "joint"}
        places = {(kinds.get(frame.type), frame.name): k for k, frame in enumerate(pin_model.frames)}
        self.frames = [self._place(frame, places) for frame in model.frames]
        self.references = [getattr(pin.ReferenceFrame, reference.upper()) for reference in REFERENCES]

    def _place(self, frame: Frame, places: Mapping[tuple[str | None, str], int]) -> int:
        try:
            return places[frame.kind, frame.name]
        except KeyError:
            raise SpatialDynError(f'{frame.kind} frame "{frame.name}" is not in Pinocchio\'s model') from None

    def inputs(self, call: _Call, states: States, k: int) -> list[Any]:
        """One sample as Pinocchio takes it: external forces are a vector of its own type."""
        values: list[Any] = []
        for name in call.inputs.split():
            value = getattr(states, name)[k]
            if name == "fext":
                forces = self.pin.StdVec_Force()
                forces.extend([self.pin.Force(force) for force in value])
                value = forces
            values.append(float(value) if name == "t" else value)
        return values

    def function(self, call: _Call) -> Callable[..., Any]:
        """What answers for Pinocchio."""
        return getattr(self.pin, call.peer) if isinstance(call.peer, str) else partial(call.peer, self.pin)

    def arguments(self, call: _Call) -> tuple[Any, ...]:
        """What stands before the inputs."""
        return (self.model, self.data) if call.data else (self.model,)

    def __call__(self, call: _Call, states: States, k: int) -> Array:
        """Its answer for one sample, in the shape of ours."""
        answer = self.function(call)(*self.arguments(call), *self.inputs(call, states, k))
        if not call.frame:
            found = _array(answer if call.result is None else call.result(self.data))
            return found.reshape(self._core(call)) if call.name in SPECS else found
        look = getattr(self.pin, call.frame)
        references = [(code,) for code in self.references] if call.references else [()]
        all_found = np.array(
            [[_array(look(self.model, self.data, frame, *code)) for code in references] for frame in self.frames]
        )
        if call.name == "jacobian_dot_times_v":
            moved: Array = all_found.reshape((*all_found.shape[:2], 6, self.model.nv)) @ states.v[k]
            return moved
        return all_found.reshape((*all_found.shape[:2], *self._core(call)))

    def _core(self, call: _Call) -> tuple[int, ...]:
        """Shape of one result: a matrix of one column comes as a vector."""
        return core_shape(self.ours, SPECS[call.name].output)


def _array(value: Any) -> Array:
    """A Pinocchio result as an array: poses (4, 4), motions and forces (6,), several of them stacked."""
    if isinstance(value, (tuple, list)):
        return np.array([_array(part) for part in value])
    for name in ("vector", "homogeneous"):
        if hasattr(value, name):
            return np.array(getattr(value, name))
    return np.array(value, dtype=float)


# --- one call --------------------------------------------------------------------------------------------


def _size(error: float | None) -> float:
    """An error to be ordered by: one that is not finite is infinite."""
    return 0.0 if error is None else error if np.isfinite(error) else float("inf")


def _scaled_error(x: Array, reference: Array, rank: int) -> float:
    """max |x - reference| / max(1, max |reference|) of each result of ``rank`` axes, the largest; nan if any is."""
    if x.shape != reference.shape:
        return float("inf")
    if x.size == 0:
        return 0.0
    axes = tuple(range(x.ndim - rank, x.ndim))
    with np.errstate(invalid="ignore"):
        off, scale = abs(x - reference).max(axis=axes), abs(reference).max(axis=axes)
        return float(np.max(off / np.maximum(1.0, scale)))


def _row(label: str, error: float, bound: float, note: str = "", times: tuple[float, float] | None = None) -> Row:
    ours, theirs = times or (None, None)
    return Row(label, error, bound, bool(error <= bound), note, ours, theirs)


def _joint_order(model: Model, pin_model: Any) -> Row:
    differ = [(ours, theirs) for ours, theirs in zip(model.names, pin_model.names, strict=True) if ours != theirs]
    note = f'joint "{differ[0][0]}" stands where Pinocchio has "{differ[0][1]}"' if differ else ""
    return _row("joint order", float(len(differ)), 0.5, note)


def _compared(call: _Call, model: Model, peer: _Peer, states: States, timing: bool) -> Iterator[Row]:
    """The rows of a call: one, and one for its values where its residual is what is bounded."""
    inputs = tuple(getattr(states, name) for name in call.inputs.split())
    first = tuple(x[0] for x in inputs)
    batched = bool(inputs)
    if model.nv == 0 and call.frame in _CRASHES_WITHOUT_FREEDOMS:
        left = float(abs(_ours(call, model, inputs)).sum())
        yield _row(call.label, left, BOUND, "Pinocchio crashes where nv is 0; sum of entries = 0 instead")
        return
    theirs = np.array([peer(call, states, k) for k in range(len(states.q) if batched else 1)])
    try:
        single = _ours(call, model, first)
        ours = _ours(call, model, inputs) if batched else single[None]
    except (InertiaError, NonFiniteError) as error:
        yield _refused(call, model, peer, states, theirs, error)
        return
    times = _times(call, model, peer, states) if timing and isinstance(call.peer, str) else None
    same = np.array_equal(single, ours[0], equal_nan=True)
    note = "" if same else "a single call and a batch of it differ"
    if call.name in (*FORWARD, "minverse"):
        residual, bound = _residual(call, peer, states, ours)
        if bound > BOUND and not note:
            note = f"{RAISED}, for M is ill conditioned and rounding the exact answer costs a quarter of that"
        yield _row(call.label, residual if same else float("inf"), bound, note, times)
        yield _values(call, peer, states, ours, theirs)
        return
    if not np.isfinite(theirs).all():
        yield _by_identity(call, model, states, "Pinocchio gives nan", times)
        return
    yield _row(call.label, _scaled_error(ours, theirs, call.rank) if same else float("inf"), BOUND, note, times)


def _missed(call: _Call, peer: _Peer, states: States, k: int, x: Array) -> tuple[float, float]:
    """How far an answer x of forward dynamics is from giving tau in Pinocchio's RNEA, in sample k; of minverse, from
    M x = 1.

    And what rounding the entries of x makes of that: eps |M| |x|, scaled alike.
    """
    M = np.array(peer.pin.crba(peer.model, peer.data, states.q[k]))
    if call.name in FORWARD:
        force = _Call(call.label, call.inputs.replace("tau", "a"), "rnea")
        accelerations = np.zeros_like(states.a)
        accelerations[k] = x
        left, right = peer(force, states._replace(a=accelerations), k), states.tau[k]
    else:
        left, right = M @ x, np.eye(len(M))
    scale = abs(right).max(initial=1.0)
    rounding = np.finfo(float).eps * (abs(M) @ abs(x)).max(initial=0.0) / scale
    return _scaled_error(left, right, right.ndim), float(rounding)


def _residual(call: _Call, peer: _Peer, states: States, ours: Array) -> tuple[float, float]:
    """Residual of our answers, and its bound.

    A sample's bound is raised only for an error that needs it. Both are of the sample that is worst in units of its
    bound, among the failed ones if there are any, else among those whose bound is raised.
    """
    found: list[tuple[float, float]] = []
    for k, x in enumerate(ours):
        error, rounding = _missed(call, peer, states, k, x)
        found.append((error, BOUND if error <= BOUND else max(BOUND, 4.0 * rounding)))
    return max(found, key=lambda pair: (not pair[0] <= pair[1], pair[1] > BOUND, _size(pair[0]) / pair[1]))


def _values(call: _Call, peer: _Peer, states: States, ours: Array, theirs: Array) -> Row:
    """The values themselves, in those states in which M is well conditioned and Pinocchio's own residual is small."""
    label = f"{call.name} (fext, values)" if "fext" in call.inputs else f"{call.name} (values)"
    M = np.array([peer.pin.crba(peer.model, peer.data, q) for q in states.q])
    sound = np.array([m.size == 0 or float(np.linalg.cond(m)) <= WELL_CONDITIONED for m in _unit_diagonal(M)])
    sound &= [_missed(call, peer, states, k, x)[0] <= 0.5 * VALUE_BOUND for k, x in enumerate(theirs)]
    note = "" if sound.all() else OMITTED
    if not sound.any():
        return Row(label, None, VALUE_BOUND, True, f"{note}: in all")
    return _row(label, _scaled_error(ours[sound], theirs[sound], call.rank), VALUE_BOUND, note)


def _refused(call: _Call, model: Model, peer: _Peer, states: States, theirs: Array, error: SpatialDynError) -> Row:
    """The row of a call that ours refuses: right where there is no answer, as Pinocchio's M or mass has to bear out."""
    gives = "no finite numbers" if not np.isfinite(theirs).all() else "numbers"
    if isinstance(error, InertiaError):
        M = np.array([peer.pin.crba(peer.model, peer.data, q) for q in states.q])
        if _singular(M):
            row = _by_identity(_BY_LABEL["rnea"], model, states, "")
            note = f"InertiaError, as M is singular (Pinocchio gives {gives}); rnea = M a + bias instead"
            return Row(call.label, row.error, row.bound, row.ok, note)
    elif peer.pin.computeTotalMass(peer.model) == 0.0 and gives != "numbers":
        return Row(call.label, None, BOUND, True, "refused, as no mass moves (Pinocchio gives no finite numbers)")
    return Row(call.label, float("inf"), BOUND, False, f"refused, where Pinocchio gives {gives}: {error}")


def _unit_diagonal(M: Array) -> Array:
    """Matrices (n, nv, nv) with rows and columns scaled to a diagonal of 1: units drop out."""
    scale = 1.0 / np.sqrt(np.einsum("...ii->...i", M))
    scaled: Array = M * scale[..., :, None] * scale[..., None, :]
    return scaled


def _singular(M: Array) -> bool:
    """Whether an M of a batch is singular to rounding, whatever the units."""
    if (np.einsum("...ii->...i", M) <= 0.0).any():
        return True
    smallest = np.linalg.eigvalsh(_unit_diagonal(M))[..., 0]
    return bool((smallest <= 10.0 * M.shape[-1] * np.finfo(float).eps).any())


# --- identities, where Pinocchio is no oracle ------------------------------------------------------------


def _other_question(model: Model) -> str:
    """Why Pinocchio's answers are those of another robot, or nothing."""
    for joint in model.joints[1:]:
        if joint.kind == "planar" and joint.axis.tolist() != [0.0, 0.0, 1.0]:
            return f'Pinocchio ignores the axis of planar joint "{joint.name}"'
    return ""


def _times_vector(A: Array, x: Array) -> Array:
    """A x, sample by sample; A may have further axes after the samples."""
    product: Array = np.einsum("s...ij,sj->s...i", A, x)
    return product


def _call(label: str, model: Model, *inputs: Any) -> Array:
    return _ours(_BY_LABEL[label], model, inputs)


def _frame_accelerations(m: Model, s: States) -> Array:
    """J a + J̇ v, (samples, frames, references, 6)."""
    return _times_vector(_call("frame_jacobian", m, s.q), s.a) + _call("jacobian_dot_times_v", m, s.q, s.v)


def _coriolis_forces(m: Model, s: States) -> Array:
    """Bias less gravity."""
    return _call("nonlinear_effects", m, s.q, s.v) - _call("generalized_gravity", m, s.q)


def _given_back(name: str) -> Callable[[Model, States], tuple[Array, Array]]:
    """Both sides of rnea(name) = tau."""
    return lambda m, s: (_call("rnea", m, s.q, s.v, _call(name, m, s.q, s.v, s.tau)), s.tau)


# label -> the identity in words, and its two sides
_IDENTITIES: dict[str, tuple[str, Callable[[Model, States], tuple[Array, Array]]]] = {
    "rnea": (
        "rnea = M a + bias",
        lambda m, s: (
            _call("rnea", m, s.q, s.v, s.a),
            _times_vector(_call("crba", m, s.q), s.a) + _call("nonlinear_effects", m, s.q, s.v),
        ),
    ),
    "rnea (fext)": (
        "rnea - rnea without fext = static torque - gravity",
        lambda m, s: (
            _call("rnea", m, s.q, s.v, s.a, s.fext) - _call("rnea", m, s.q, s.v, s.a),
            _call("static_torque", m, s.q, s.fext) - _call("generalized_gravity", m, s.q),
        ),
    ),
    "crba": (
        "½ vᵀ M v = T",
        lambda m, s: (
            0.5 * np.einsum("si,si->s", s.v, _times_vector(_call("crba", m, s.q), s.v)),
            _call("kinetic_energy", m, s.q, s.v),
        ),
    ),
    "aba": (
        "rnea(aba) = tau",
        lambda m, s: (_call("rnea", m, s.q, s.v, _call("aba", m, s.q, s.v, s.tau)), s.tau),
    ),
    "aba (fext)": (
        "rnea(aba) = tau",
        lambda m, s: (_call("rnea", m, s.q, s.v, _call("aba", m, s.q, s.v, s.tau, s.fext), s.fext), s.tau),
    ),
    **{name: (f"rnea({name}) = tau", _given_back(name)) for name in FORWARD[1:]},
    "minverse": (
        "M Minv = 1",
        lambda m, s: (
            _call("crba", m, s.q) @ _call("minverse", m, s.q),
            np.broadcast_to(np.eye(m.nv), (len(s.q), m.nv, m.nv)),
        ),
    ),
    "nonlinear_effects": (
        "bias = rnea at a = 0",
        lambda m, s: (_call("nonlinear_effects", m, s.q, s.v), _call("rnea", m, s.q, s.v, 0.0 * s.a)),
    ),
    "generalized_gravity": (
        "g = rnea at v = a = 0",
        lambda m, s: (_call("generalized_gravity", m, s.q), _call("rnea", m, s.q, 0.0 * s.v, 0.0 * s.a)),
    ),
    "static_torque": (
        "static torque = rnea at v = a = 0",
        lambda m, s: (_call("static_torque", m, s.q, s.fext), _call("rnea", m, s.q, 0.0 * s.v, 0.0 * s.a, s.fext)),
    ),
    "coriolis_matrix": (
        "C v = bias - g",
        lambda m, s: (_times_vector(_call("coriolis_matrix", m, s.q, s.v), s.v), _coriolis_forces(m, s)),
    ),
    "mass_matrix_dot": (
        "dM/dt = C + Cᵀ",
        lambda m, s: (
            _call("mass_matrix_dot", m, s.q, s.v),
            _call("coriolis_matrix", m, s.q, s.v) + _call("coriolis_matrix", m, s.q, s.v).transpose(0, 2, 1),
        ),
    ),
    "coriolis_transpose_times_velocity": (
        "Cᵀ v = dM/dt v - C v",
        lambda m, s: (
            _call("coriolis_transpose_times_velocity", m, s.q, s.v),
            _times_vector(_call("mass_matrix_dot", m, s.q, s.v), s.v) - _coriolis_forces(m, s),
        ),
    ),
    "modified_rnea": (
        "modified rnea = M a_r + C v_r + g",
        lambda m, s: (
            _call("modified_rnea", m, s.q, s.v, s.d, s.a),
            _times_vector(_call("crba", m, s.q), s.a)
            + _times_vector(_call("coriolis_matrix", m, s.q, s.v), s.d)
            + _call("generalized_gravity", m, s.q),
        ),
    ),
    "christoffel_symbols": (
        "Γ v = C",
        lambda m, s: (
            _times_vector(_call("christoffel_symbols", m, s.q), s.v),
            _call("coriolis_matrix", m, s.q, s.v),
        ),
    ),
    "mass_matrix_derivatives": (
        "dM/dq v = dM/dt",
        lambda m, s: (
            _times_vector(_call("mass_matrix_derivatives", m, s.q), s.v),
            _call("mass_matrix_dot", m, s.q, s.v),
        ),
    ),
    "kinetic_energy": ("T = ½ vᵀ M v", lambda m, s: _IDENTITIES["crba"][1](m, s)[::-1]),
    "center_of_mass_velocity": (
        "velocity = J v",
        lambda m, s: (
            _call("center_of_mass_velocity", m, s.q, s.v),
            _times_vector(_call("com_jacobian", m, s.q), s.v),
        ),
    ),
    "center_of_mass_acceleration": (
        "m acceleration = d/dt of the momentum",
        lambda m, s: (
            m.total_mass * _call("center_of_mass_acceleration", m, s.q, s.v, s.a),
            (
                _times_vector(_call("centroidal_map", m, s.q), s.a)
                + _times_vector(_call("centroidal_map_dot", m, s.q, s.v), s.v)
            )[..., :3],
        ),
    ),
    "com_jacobian": (
        "m J = linear part of the centroidal map",
        lambda m, s: (m.total_mass * _call("com_jacobian", m, s.q), _call("centroidal_map", m, s.q)[..., :3, :]),
    ),
    "frame_velocity": (
        "velocity = J v",
        lambda m, s: (_call("frame_velocity", m, s.q, s.v), _times_vector(_call("frame_jacobian", m, s.q), s.v)),
    ),
    "frame_acceleration": (
        "acceleration = J a + J̇ v, in local and world",
        lambda m, s: (
            _call("frame_acceleration", m, s.q, s.v, s.a)[:, :, :2],
            _frame_accelerations(m, s)[:, :, :2],
        ),
    ),
    "frame_acceleration (classical)": (
        "acceleration = J a + J̇ v, in local_world_aligned",
        lambda m, s: (
            _call("frame_acceleration (classical)", m, s.q, s.v, s.a)[:, :, 2],
            _frame_accelerations(m, s)[:, :, 2],
        ),
    ),
    "centroidal_momentum": (
        "momentum = Ag v",
        lambda m, s: (
            _call("centroidal_momentum", m, s.q, s.v),
            _times_vector(_call("centroidal_map", m, s.q), s.v),
        ),
    ),
    "integrate": (
        "difference(q, integrate(q, d)) = d",
        lambda m, s: (_call("difference", m, s.q, _call("integrate", m, s.q, s.d)), s.d),
    ),
    "difference": ("difference(q, integrate(q, d)) = d", lambda m, s: _IDENTITIES["integrate"][1](m, s)),
    "interpolate": (
        "interpolate = integrate(q, t d)",
        lambda m, s: (
            _call("interpolate", m, s.q, s.q1, s.t),
            _call("integrate", m, s.q, s.t[:, None] * s.d),
        ),
    ),
    "momentum": (
        "p = M v",
        lambda m, s: (_call("momentum", m, s.q, s.v), _times_vector(_call("crba", m, s.q), s.v)),
    ),
    "velocity_from_momentum": (
        "momentum(velocity) = p",
        lambda m, s: (_call("momentum", m, s.q, _call("velocity_from_momentum", m, s.q, s.tau)), s.tau),
    ),
    "hamiltonian": (
        "H = T + V",
        lambda m, s: (
            _call("hamiltonian", m, s.q, _call("momentum", m, s.q, s.v)),
            _call("kinetic_energy", m, s.q, s.v) + _call("potential_energy", m, s.q),
        ),
    ),
    "momentum_rate": (
        "rate = Cᵀ v + tau - gravity",
        lambda m, s: (
            _call("momentum_rate", m, s.q, s.v, s.tau),
            _times_vector(np.swapaxes(_call("coriolis_matrix", m, s.q, s.v), -1, -2), s.v)
            + s.tau
            - _call("generalized_gravity", m, s.q),
        ),
    ),
    "momentum_rate (fext)": (
        "what fext adds = gravity - static torque",
        lambda m, s: (
            _call("momentum_rate", m, s.q, s.v, s.tau, s.fext) - _call("momentum_rate", m, s.q, s.v, s.tau),
            _call("generalized_gravity", m, s.q) - _call("static_torque", m, s.q, s.fext),
        ),
    ),
    "hamilton_field": (
        "v = M⁻¹ p and its momentum rate",
        lambda m, s: (
            _call("hamilton_field", m, s.q, s.tau, s.a),
            np.stack([v := _call("velocity_from_momentum", m, s.q, s.tau), _call("momentum_rate", m, s.q, v, s.a)], 1),
        ),
    ),
}


def _by_identity(call: _Call, model: Model, states: States, why: str, times: tuple[float, float] | None = None) -> Row:
    """The row of a call for which Pinocchio is no oracle: the error of an identity, if there is one."""
    if call.label not in _IDENTITIES:
        return Row(call.label, None, BOUND, True, f"{why}; not compared")
    words, sides = _IDENTITIES[call.label]
    try:
        left, right = sides(model, states)
    except (InertiaError, NonFiniteError) as refusal:
        if isinstance(refusal, InertiaError) and not call.peer and _singular(_call("crba", model, states.q)):
            return Row(call.label, None, BOUND, True, f"{why}; InertiaError, as M is singular")
        return Row(call.label, float("inf"), BOUND, False, f"{why}; {words} instead: {refusal}")
    error = _scaled_error(left, right, min(call.rank, left.ndim - 1))
    if call.name == "velocity_from_momentum" and error > BOUND:  # as of aba, see _residual
        M, v = _call("crba", model, states.q), _call(call.label, model, states.q, states.tau)
        rounding = np.finfo(float).eps * _times_vector(abs(M), abs(v)).max(-1) / abs(right).max(-1, initial=1.0)
        return _row(call.label, error, max(BOUND, 4.0 * float(rounding.max())), f"{why}; {words} instead; {RAISED}")
    return _row(call.label, error, BOUND, f"{why}; {words} instead", times)


# --- time ------------------------------------------------------------------------------------------------


def _times(call: _Call, model: Model, peer: _Peer, states: States) -> tuple[float, float]:
    """Time of one call, ours and Pinocchio's [µs]: medians of interleaved rounds, single samples, from Python.

    A call about a frame is asked about the last one, in the first reference; Pinocchio's counts the pass over the
    joints that has to precede it.
    """
    names = call.inputs.split()
    scope: dict[str, Any] = {"f": getattr(dynamics, call.name), "model": model}
    scope |= {name: getattr(states, name)[0] for name in names}
    given = ["model", *names]
    if call.frame:
        scope |= {"frame": model.frames[-1], "reference": REFERENCES[0], "extra": True}
        given += ["frame", *["reference"] * bool(call.references), *["extra"] * bool(call.static)]
    ours = timeit.Timer(f"f({', '.join(given)})", globals=scope)

    there: dict[str, Any] = {"f": peer.function(call), "model": peer.model, "data": peer.data}
    there |= dict(zip(names, peer.inputs(call, states, 0), strict=True))
    text = f"f({', '.join(['model', *['data'] * call.data, *names])})"
    if call.frame:
        there |= {"g": getattr(peer.pin, call.frame), "frame": peer.frames[-1], "reference": peer.references[0]}
        text += f"; g(model, data, frame{', reference' * bool(call.references)})"
        if call.name == "jacobian_dot_times_v":
            text += " @ v" if model.nv > 1 else " * v"  # a matrix of one column comes as a vector
    theirs = timeit.Timer(text, globals=there)

    counts = [max(1, round(ROUND_SECONDS / max(1e-7, timer.timeit(10) / 10))) for timer in (ours, theirs)]
    rounds = [[timer.timeit(n) / n for timer, n in zip((ours, theirs), counts, strict=True)] for _ in range(ROUNDS)]
    first, second = (median(column) * 1e6 for column in zip(*rounds, strict=True))
    return first, second
