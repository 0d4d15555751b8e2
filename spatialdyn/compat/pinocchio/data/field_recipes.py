"""Which fields of a Data each call fills, and how they follow from what the call was given.

A call computes its own result at once and keeps its inputs; the other fields that Pinocchio would fill are computed
here when somebody reads them. Every recipe is a function of a Run, and no more than the library's calls put together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....calls import dynamics
from ...native import operator_kernels, recorded_calls

Array = NDArray[np.float64]
Recipe = Callable[[Any], Any]
Fills = dict[str, Recipe]


@dataclass(frozen=True)
class Kind:
    """A kind of call.

    call    the library's call that gives its result; "" if it has none of its own
    inputs  names of what is kept of its arguments, the call's own first
    fills   field of Data -> recipe
    more    how many of the inputs the library's call does not take
    stays   the face's function does not return the result: it is in the data, or nobody asks for it
    """

    call: str
    inputs: str
    fills: Mapping[str, Recipe] = field(default_factory=dict)
    more: int = 0
    stays: bool = False


@dataclass(frozen=True)
class Called:
    """A recipe that is no more than a call of the library on inputs of the run.

    joints  the result has a row for each joint
    """

    call: str
    inputs: tuple[str, ...]
    joints: bool = False

    def __call__(self, run: Any) -> Array:
        """The result, with rows for the joints of the face's model."""
        inputs = [getattr(run, x) for x in self.inputs]
        return (of_joints if self.joints else called)(self.call, run, *inputs)


def called(name: str, run: Any, *inputs: Any) -> Array:
    """A call of the library on the model of a run, with rows for the joints of the face's model."""
    found: Array = dynamics.calls[name](run.made.model, *inputs)
    return found


def of_joints(name: str, run: Any, *inputs: Any) -> Array:
    """The same for a call whose result has a row for each joint."""
    found = called(name, run, *inputs)
    return found if run.made.joints is None else found[run.made.joints]


# --- places and velocities -------------------------------------------------------------------------------


def result(run: Any) -> Array:
    """What the call returned."""
    found: Array = run.result
    return found


def oMi(run: Any) -> Array:
    """Poses of the joints in the world."""
    if run.kind.call == "forward_kinematics" and not run.shared:
        return result(run) if run.made.joints is None else result(run)[run.made.joints]
    return placed(run)


def oMf(run: Any) -> Array:
    """Poses of the frames in the world."""
    out: Array = np.empty_like(run.frames.placements)
    recorded_calls.compose_all(np.ascontiguousarray(oMi(run)), run.frames.joints, run.frames.placements, out)
    return out


def liMi(run: Any) -> Array:
    """Poses of the joints in their parents."""
    X = np.ascontiguousarray(oMi(run))
    if run.made.off_norm(run.q):  # no rotations: their transposes undo nothing
        return _undone(X[run.parents], X)
    out = np.empty_like(X)
    recorded_calls.relative_all(X, run.parents, X, out)
    return out


def _undone(A: Array, X: Array) -> Array:
    """A⁻¹ X, what is least where some A have no inverse."""
    try:
        out: Array = np.asarray(np.linalg.solve(A, X), np.float64)
    except np.linalg.LinAlgError:
        out = np.asarray(np.linalg.pinv(A) @ X, np.float64)
    out[:, 3] = 0.0, 0.0, 0.0, 1.0
    return out


placed = Called("forward_kinematics", ("q",), True)
v = Called("joint_velocities", ("q", "v"), True)  # in the joints' frames
a = Called("joint_accelerations", ("q", "v", "a"), True)  # in the joints' frames


def a_gf(run: Any) -> Array:
    """The same, seen by someone who falls."""
    found = a(run)
    weight = np.zeros((1, 6))
    weight[0, :3] = run.made.model.gravity
    out = np.empty_like(found)
    recorded_calls.motions_down(
        np.ascontiguousarray(oMi(run)), np.arange(len(out)), np.repeat(weight, len(out), 0), out
    )
    found -= out
    return found


def f(run: Any) -> Array:
    """Forces that the joints transmit, in their frames."""
    return of_joints("joint_forces", run, run.q, run.v, run.a, *(() if run.fext is None else (run.fext,)))


def h(run: Any) -> Array:
    """Momenta of the bodies, in their joints' frames."""
    velocities = v(run)
    out = np.empty_like(velocities)
    recorded_calls.momenta(run.bodies, np.arange(len(out)), velocities, out)
    out[0] = 0.0
    return out


def up(operator: Callable[..., None], recipe: Recipe) -> Recipe:
    """What a recipe gives in the joints' frames, in the world."""

    def recipe_in_world(run: Any) -> Array:
        here: Array = recipe(run)
        out = np.empty_like(here)
        operator(np.ascontiguousarray(oMi(run)), np.arange(len(here)), here, out)
        return out

    return recipe_in_world


def subtrees(recipe: Recipe, shift: Callable[..., None], add: Callable[..., None], world: bool = True) -> Recipe:
    """What a recipe gives for bodies, for all that each joint carries; for the world itself if asked for."""

    def recipe_for_subtrees(run: Any) -> Array:
        here, X, there = np.array(recipe(run)), liMi(run), None
        for k in range(len(here) - 1, 0, -1):
            there = np.empty(here.shape[1])
            shift(X[k], here[k], there)
            if world or run.parents[k]:
                add(here[run.parents[k]], there, here[run.parents[k]])
        return here

    return recipe_for_subtrees


def bodies(run: Any) -> Array:
    """Inertias of the bodies; that of the world counts as none."""
    found: Array = run.bodies.copy()
    found[0] = 0.0
    return found


def zeroed(recipe: Recipe) -> Recipe:
    """A recipe without the world's row."""

    def recipe_but_world(run: Any) -> Array:
        found: Array = recipe(run)
        found[0] = 0.0
        return found

    return recipe_but_world


# --- under constraints -----------------------------------------------------------------------------------


def forces_of_constraints(run: Any) -> Array:
    """Forces or impulses of the constraints."""
    return np.array(run.contact.force)


def D(run: Any) -> Array:
    """Diagonal of M = U D Uᵀ."""
    return diagonal(run.contact.L)


def U(run: Any) -> Array:
    """Unit upper triangle of M = U D Uᵀ."""
    return unit_upper(run.contact.L)


def diagonal(L: Array) -> Array:
    """D of an L with D on its diagonal."""
    return np.array(L.diagonal())


def unit_upper(L: Array) -> Array:
    """U = Lᵀ of an L with D on its diagonal."""
    found = np.array(np.tril(L).T, order="C")
    np.fill_diagonal(found, 1.0)
    return found


# --- regressors ------------------------------------------------------------------------------------------


def columns(run: Any) -> Array:
    """Those of the joints below the universe, side by side; a new array."""
    Y, joints = run.result, run.made.joints
    found = Y[..., 1:, :] if joints is None else Y[..., joints[1:], :]
    return np.array(found.reshape((*Y.shape[:-2], found.shape[-2] * found.shape[-1])), order="C")


# --- the robot as a whole --------------------------------------------------------------------------------


com = Called("subtree_centers_of_mass", ("q",), True)  # of all that each joint carries, in its frame
vcom = Called("subtree_com_velocities", ("q", "v"), True)
acom = Called("subtree_com_accelerations", ("q", "v", "a"), True)


def com_in_world(run: Any) -> Array:
    """The same in the world."""
    c, X = com(run), oMi(run)
    return np.asarray(np.einsum("kij,kj->ki", X[:, :3, :3], c) + X[:, :3, 3])


def mass(run: Any) -> Array:
    """Masses of all that each joint carries."""
    return subtree_masses(run.bodies, run.parents)


def subtree_masses(inertias: Array, parents: NDArray[np.intp]) -> Array:
    """The same, of inertias and parents."""
    m: Array = inertias[:, 0].copy()
    m[0] = 0.0
    for k in range(len(m) - 1, 0, -1):
        m[parents[k]] += m[k]
    return m


def Ig(run: Any) -> Array:
    """Inertia of the robot about its centre of mass, in the axes of the world."""
    found = np.array(oYcrb(run)[0])
    found[1:4] = 0.0
    return found


def mechanical_energy(run: Any) -> float:
    """Kinetic and potential energy."""
    return float(called("kinetic_energy", run, run.q, run.v) + called("potential_energy", run, run.q))


def force_and_weight(run: Any) -> Array:
    """What Pinocchio's computeAllTerms leaves in dhg: the rate of momentum at a = 0, and what bears the weight."""
    dh = called("centroidal_momentum_rate", run, run.q, run.v, run.a)
    dh[:3] -= run.made.model.total_mass * run.made.model.gravity
    return dh


def net_forces(run: Any) -> Array:
    """Forces that the joints would transmit without gravity, the world's row their sum."""
    found = f(run)
    X, c, m = oMi(run), com_in_world(run), mass(run)
    weight = np.zeros_like(found)
    weight[:, :3] = m[:, None] * run.made.model.gravity
    weight[:, 3:] = np.cross(c, weight[:, :3])
    weight = np.array([_force_in(T, w) for T, w in zip(X, weight, strict=True)])
    return summed_at_world(run, found + weight)


def _force_in(X: Array, force: Array) -> Array:
    out = np.empty(6)
    operator_kernels.force_to_child(X, force, out)
    return out


def forces_and_sum(run: Any) -> Array:
    """Forces that the joints transmit, the world's row their sum."""
    return summed_at_world(run, f(run))


def summed_at_world(run: Any, forces: Array) -> Array:
    """The forces, the world's row what the joints on it transmit."""
    X, part = oMi(run), np.empty(6)
    forces[0] = 0.0
    for k in np.flatnonzero(run.parents[1:] == 0) + 1:
        operator_kernels.force_to_parent(X[k], forces[k], part)
        forces[0] += part
    return forces


def by(name: str, *inputs: str) -> Recipe:
    """A call of the library on inputs of the run."""
    return Called(name, inputs)


def part(k: int) -> Recipe:
    """One of the arrays that the call returned."""
    return lambda run: result(run)[k]


def forces_of(run: Any) -> tuple[Array, ...]:
    """External forces as a last argument, if the call was given some."""
    return () if run.fext is None else (run.fext,)


def ddq(run: Any) -> Array:
    """Accelerations that the torques cause."""
    return called("aba", run, run.q, run.v, run.tau, *forces_of(run))


def at_ddq(k: int) -> Recipe:
    """A derivative of the torques at those."""
    return lambda run: called("rnea_derivatives", run, run.q, run.v, ddq(run), *forces_of(run))[k]


def tau(run: Any) -> Array:
    """Torques."""
    return called("rnea", run, run.q, run.v, run.a, *forces_of(run))


def tau_without_weight(run: Any) -> Array:
    """Torques that move the bodies alone: without gravity and rotors."""
    weight = called("generalized_gravity", run, run.q)
    found: Array = tau(run) - weight - run.made.model.armature * run.a
    return found


h_of_subtrees = subtrees(h, operator_kernels.force_to_parent, np.add)
Ycrb = subtrees(bodies, operator_kernels.body_to_parent, operator_kernels.add_body, world=False)
_with_world = subtrees(bodies, operator_kernels.body_to_parent, operator_kernels.add_body)
oYcrb = up(recorded_calls.bodies_up, _with_world)
ov, oa, oa_gf = up(recorded_calls.motions_up, v), up(recorded_calls.motions_up, a), up(recorded_calls.motions_up, a_gf)
of, oh = up(recorded_calls.forces_up, f), up(recorded_calls.forces_up, h)
J, dJ = by("joint_jacobians", "q"), by("joint_jacobians_dot", "q", "v")
hg = by("centroidal_momentum", "q", "v")

CHAIN: Fills = {"liMi": liMi}
PLACES: Fills = {"liMi": liMi, "oMi": oMi}
MASSES: Fills = {**PLACES, "com": com, "mass": mass}
MAP: Fills = {**PLACES, "Ag": by("centroidal_map", "q"), "J": J, "com": com, "oYcrb": oYcrb}
MAP_DOT: Fills = {**MAP, "dAg": by("centroidal_map_dot", "q", "v"), "dJ": dJ, "ov": ov}
ENERGIES: Fills = {
    "kinetic_energy": by("kinetic_energy", "q", "v"),
    "potential_energy": by("potential_energy", "q"),
    "mechanical_energy": mechanical_energy,
}
MOVING: Fills = {**PLACES, "J": J, "dJ": dJ, "v": v, "ov": ov}
ACCELERATED: Fills = {**MOVING, "a": a, "oa": oa}
KINDS: dict[str, Kind] = {
    "rnea": Kind("rnea", "q v a", {**CHAIN, "tau": result, "v": v, "a_gf": a_gf, "f": f, "h": h}),
    "aba": Kind("aba", "q v tau", {**CHAIN, "ddq": result, "v": v, "a_gf": a_gf, "f": f, "h": h}),
    "aba_world": Kind(
        "aba",
        "q v tau",
        {
            **PLACES, "ddq": result, "J": J, "oYcrb": up(recorded_calls.bodies_up, bodies), "oa": oa, "oa_gf": oa_gf,
            "of": of, "oh": oh, "ov": ov,
        },
    ),
    "crba": Kind("crba", "q", {**CHAIN, "M": result, "Ycrb": Ycrb}),
    "crba_world": Kind("crba", "q", {**MAP, "M": result, "mass": mass}),
    "nle": Kind("nonlinear_effects", "q v", {**CHAIN, "nle": result, "v": v, "a_gf": a_gf, "f": f}),
    "gravity": Kind("generalized_gravity", "q", {**CHAIN, "g": result, "a_gf": a_gf, "f": f}),
    "static": Kind("static_torque", "q", {**CHAIN, "tau": result, "a_gf": a_gf, "f": f}),
    "coriolis": Kind(
        "coriolis_matrix",
        "q v",
        {**PLACES, "C": result, "J": J, "dJ": dJ, "v": v, "ov": ov, "oh": oh, "oYcrb": zeroed(oYcrb)},
    ),
    "minverse": Kind(
        "minverse", "q", {**PLACES, "Minv": result, "J": J, "oYcrb": up(recorded_calls.bodies_up, bodies)}
    ),
    "all": Kind(
        "nonlinear_effects",
        "q v",
        {
            **MASSES, **MAP_DOT, **ENERGIES, "nle": result, "M": by("crba", "q"), "g": by("generalized_gravity", "q"),
            "Jcom": by("com_jacobian", "q"), "Ig": Ig, "a": a, "a_gf": a_gf, "f": forces_and_sum, "v": v,
            "h": h_of_subtrees, "hg": hg, "dhg": force_and_weight, "vcom": vcom,
        },
        stays=True,
    ),
    "kinematics0": Kind("forward_kinematics", "q", PLACES, stays=True),
    "kinematics1": Kind("forward_kinematics", "q v", {**PLACES, "v": v}, 1, stays=True),
    "kinematics2": Kind("forward_kinematics", "q v a", {**PLACES, "v": v, "a": a}, 2, stays=True),
    "frames": Kind("", "", {"oMf": result}),
    "global_placements": Kind("", "q", {"oMi": result}),
    "frame_jacobian_local": Kind("", "q", CHAIN),
    "frame_jacobian_world": Kind("", "q", PLACES),
    "frame_jacobian_aligned": Kind("", "q", {**PLACES, "oMf": oMf}),
    "jacobians": Kind("joint_jacobians", "q", {**PLACES, "J": result}),
    "jacobians_dot": Kind("joint_jacobians_dot", "q v", {**PLACES, "J": J, "dJ": result, "v": v, "ov": ov}),
    "com0": Kind("center_of_mass", "q", MASSES),
    "com1": Kind("center_of_mass", "q v", {**MASSES, "v": v, "vcom": vcom}, 1),
    "com2": Kind("center_of_mass", "q v a", {**MASSES, "v": v, "vcom": vcom, "a": a, "acom": acom}, 2),
    "com_jacobian": Kind("com_jacobian", "q", {**MASSES, "Jcom": result, "J": J, "com": com_in_world}),
    "ccrba": Kind("centroidal_map", "q v", {**MAP, "Ag": result, "Ig": Ig, "hg": hg}, 1),
    "dccrba": Kind("centroidal_map_dot", "q v", {**MAP_DOT, "dAg": result, "Ig": Ig, "hg": hg, "v": v, "vcom": vcom}),
    "map": Kind("centroidal_map", "q", {**MAP, "Ag": result}),
    "map_dot": Kind("centroidal_map_dot", "q v", {**MAP_DOT, "dAg": result, "v": v}),
    "momentum": Kind("centroidal_momentum", "q v", {**MASSES, "hg": result, "h": h_of_subtrees, "v": v, "vcom": vcom}),
    "momentum_dot": Kind(
        "centroidal_momentum_rate",
        "q v a",
        {**MASSES, "dhg": result, "hg": hg, "h": h_of_subtrees, "v": v, "vcom": vcom, "a": a, "f": net_forces},
    ),
    "rnea_derivatives": Kind(
        "rnea_derivatives",
        "q v a",
        {
            **ACCELERATED, "dtau_dq": part(0), "dtau_dv": part(1), "M": part(2), "tau": tau, "oa_gf": oa_gf,
            "of": of, "oYcrb": zeroed(oYcrb),
        },
    ),
    "aba_derivatives": Kind(
        "aba_derivatives",
        "q v tau",
        {
            **PLACES, "ddq_dq": part(0), "ddq_dv": part(1), "Minv": part(2), "ddq": ddq, "dtau_dq": at_ddq(0),
            "dtau_dv": at_ddq(1), "J": J, "dJ": dJ, "ov": ov,
        },
    ),
    "gravity_derivatives": Kind(
        "generalized_gravity_derivatives", "q", {**PLACES, "g": by("generalized_gravity", "q"), "J": J}
    ),
    "static_derivatives": Kind("static_torque_derivatives", "q", {**PLACES, "tau": tau, "J": J}),
    "kinematics_derivatives1": Kind("forward_kinematics", "q v", MOVING, 1, stays=True),
    "kinematics_derivatives2": Kind("forward_kinematics", "q v a", ACCELERATED, 2, stays=True),
    "centroidal_derivatives": Kind(
        "centroidal_dynamics_derivatives",
        "q v a",
        {
            **ACCELERATED, "Ag": part(3), "hg": hg, "dhg": by("centroidal_momentum_rate", "q", "v", "a"), "Ig": Ig,
            "com": com, "mass": mass, "tau": tau_without_weight,
        },
    ),
    "constrained": Kind("", "", {"ddq": result, "lambda_c": forces_of_constraints, "D": D, "U": U}),
    "impact": Kind("", "", {"dq_after": result, "impulse_c": forces_of_constraints, "D": D, "U": U}),
    "bordered": Kind("", "", {"D": D, "U": U}),
    "kinetic_energy": Kind("kinetic_energy", "q v", {**PLACES, "kinetic_energy": result, "v": v}, stays=True),
    "potential_energy": Kind("potential_energy", "q", {**PLACES, "potential_energy": result}, stays=True),
    "mechanical_energy": Kind("kinetic_energy", "q v", {**PLACES, **ENERGIES, "v": v}, stays=True),
    "total_mass": Kind("", "", {"mass": mass}),
    "torque_regressor": Kind(
        "joint_torque_regressor", "q v a", {**CHAIN, "jointTorqueRegressor": columns, "v": v, "a_gf": a_gf}
    ),
    "static_regressor": Kind("static_regressor", "q", {**PLACES, "staticRegressor": columns}),
    "kinetic_regressor": Kind(
        "kinetic_energy_regressor", "q v", {**PLACES, "kineticEnergyRegressor": columns, "v": v}
    ),
    "potential_regressor": Kind("potential_energy_regressor", "q", {**PLACES, "potentialEnergyRegressor": columns}),
}  # fmt: skip
