"""The kinds of calls: which fields of Data each fills, and how a field follows from its inputs.

A call computes its own result at once and records its inputs; the other fields that Pinocchio would fill are computed
here at their first read. A recipe is a function of a Run, made of the library's calls.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...native import operator_kernels, recorded_calls, tree_kernels
from ..types.arguments import Array

Recipe = Callable[[Any], Any]
DERIVATIVES = "derivatives of frames' motions"  # a getter of no field


@dataclass(frozen=True)
class Kind:
    """A kind of call.

    call            name of the library's call that gives its result; "" if several or none do
    inputs          names of the inputs that are recorded, those of ``call`` first
    fills           field of Data -> recipe
    unused_inputs   how many of the inputs ``call`` does not take
    places_path     its builtin writes those of the held fields that it fills, for the joints that carry a frame
    result_in_data  no array is returned: the result is read from the Run or the data
    derivatives     derivatives of frames' motions are those at its inputs
    """

    call: str
    inputs: str
    fills: Mapping[str, Recipe] = field(default_factory=dict)
    unused_inputs: int = 0
    places_path: bool = False
    result_in_data: bool = False
    derivatives: bool = False

    @cached_property
    def getters(self) -> tuple[str, ...]:
        """Those of the filled fields whose latest Run getters of Jacobians read, and DERIVATIVES."""
        return tuple(x for x in ("J", "dJ") if x in self.fills) + (DERIVATIVES,) * self.derivatives

    @cached_property
    def returns(self) -> int:
        """What its builtin returns, see ``recorded_calls``: a tuple of parts if its fields are such."""
        if self.result_in_data:
            return recorded_calls.RESULT
        parts = any(isinstance(recipe, Part) for recipe in self.fills.values())
        return recorded_calls.PARTS if parts else recorded_calls.ARRAY


@dataclass(frozen=True)
class CallRecipe:
    """A recipe that is one call of the library on inputs of the run: a builtin can recompute it.

    joints  its result has a row for each of the library's joints: it becomes one for each joint of the Model
    forces  the run's external forces, if any, are its last input
    """

    call: str
    inputs: str
    joints: bool = False
    forces: bool = False

    def __call__(self, run: Any) -> Array:
        """The result."""
        inputs = [getattr(run, x) for x in self.inputs.split()]
        return self.at(run, *inputs, *([run.fext] if self.forces and run.fext is not None else []))

    def at(self, run: Any, *inputs: Any) -> Array:
        """The result on other inputs."""
        found: Array = run.library.compute(self.call, *inputs, at=run.state)
        return found[run.library.joints] if self.joints and run.library.joints is not None else found


@dataclass(frozen=True)
class Part:
    """A recipe: one of the arrays of the call's result."""

    k: int

    def __call__(self, run: Any) -> Array:
        """The array."""
        found: Array = run.result[self.k]
        return found


# --- recipes that are one call; rows of joints are in the joints' frames ------------------------------------

joint_placements = CallRecipe("forward_kinematics", "q", True)
v = CallRecipe("joint_velocities", "q v", True)
a = CallRecipe("joint_accelerations", "q v a", True)
f = CallRecipe("joint_forces", "q v a", True, forces=True)
com = CallRecipe("subtree_centers_of_mass", "q", True)
vcom = CallRecipe("subtree_com_velocities", "q v", True)
acom = CallRecipe("subtree_com_accelerations", "q v a", True)
J, dJ = CallRecipe("joint_jacobians", "q"), CallRecipe("joint_jacobians_dot", "q v")
Ag, dAg = CallRecipe("centroidal_map", "q"), CallRecipe("centroidal_map_dot", "q v")
hg, dhg = CallRecipe("centroidal_momentum", "q v"), CallRecipe("centroidal_momentum_rate", "q v a")
tau, ddq = CallRecipe("rnea", "q v a", forces=True), CallRecipe("aba", "q v tau", forces=True)
g, kinetic_energy = CallRecipe("generalized_gravity", "q"), CallRecipe("kinetic_energy", "q v")
potential_energy = CallRecipe("potential_energy", "q")

# --- places and velocities -------------------------------------------------------------------------------


def result(run: Any) -> Array:
    """Result of the call."""
    found: Array = run.result
    return found


def oMi(run: Any) -> Array:
    """Poses of the joints in the world."""
    if run.kind.call == "forward_kinematics" and not run.result_is_held:
        return result(run) if run.library.joints is None else result(run)[run.library.joints]
    return joint_placements(run)


def liMi(run: Any) -> Array:
    """Poses of the joints in their parents."""
    X = oMi(run)
    if run.library.off_norm(run.q):  # not rotations: their transposes are no inverses
        return _undone(X[run.library.parents], X)
    return _rows(operator_kernels.relative_all, X, run.library.parents, X)


def _rows(operator: Callable[..., None], x: Array, places: NDArray[np.intp], y: Array) -> Array:
    """Rows operator(x[places[k]], y[k])."""
    y = np.ascontiguousarray(y)
    out = np.empty_like(y)
    operator(np.ascontiguousarray(x), places, y, out)
    return out


def _undone(A: Array, X: Array) -> Array:
    """A⁻¹ X; the least-squares solution if an A is singular."""
    try:
        out: Array = np.asarray(np.linalg.solve(A, X), np.float64)
    except np.linalg.LinAlgError:
        out = np.asarray(np.linalg.pinv(A) @ X, np.float64)
    out[:, 3] = 0.0, 0.0, 0.0, 1.0
    return out


def a_gf(run: Any) -> Array:
    """Accelerations less that of gravity, in the joints' frames."""
    found = a(run)
    weight = np.zeros_like(found)
    weight[:, :3] = run.numbers.gravity[:3]
    return np.asarray(found - _rows(operator_kernels.motions_to_child, oMi(run), np.arange(len(found)), weight))


def h(run: Any) -> Array:
    """Momenta of the bodies, in the joints' frames."""
    inertias = run.numbers.inertias
    found = _rows(operator_kernels.momenta, inertias, np.arange(len(inertias)), v(run))
    found[0] = 0.0
    return found


def in_world(operator: Callable[..., None], recipe: Recipe) -> Recipe:
    """A recipe whose rows are in the joints' frames, with rows in the world."""

    def recipe_in_world(run: Any) -> Array:
        here: Array = recipe(run)
        return _rows(operator, oMi(run), np.arange(len(here)), here)

    return recipe_in_world


def summed_over_subtrees(
    recipe: Recipe, shift: Callable[..., None], add: Callable[..., None], world: bool = True
) -> Recipe:
    """A recipe that gives a row for each body, summed over each joint's subtree; row 0 only if ``world``."""

    def recipe_for_subtrees(run: Any) -> Array:
        here, X, there = np.array(recipe(run)), liMi(run), None
        for k in range(len(here) - 1, 0, -1):
            there = np.empty(here.shape[1])
            shift(X[k], here[k], there)
            if world or run.library.parents[k]:
                add(here[run.library.parents[k]], there, here[run.library.parents[k]])
        return here

    return recipe_for_subtrees


def bodies(run: Any) -> Array:
    """Inertias of the bodies, the universe's zero."""
    found: Array = run.numbers.inertias.copy()
    found[0] = 0.0
    return found


_to_parent, _subtrees = operator_kernels.body_to_parent, summed_over_subtrees
subtree_momenta = _subtrees(h, operator_kernels.force_to_parent, np.add)
Ycrb = _subtrees(bodies, _to_parent, operator_kernels.add_body, world=False)
bodies_in_world = in_world(operator_kernels.bodies_to_parent, bodies)
ov, oa, oa_gf = (in_world(operator_kernels.motions_to_parent, recipe) for recipe in (v, a, a_gf))
of, oh = in_world(operator_kernels.forces_to_parent, f), in_world(operator_kernels.forces_to_parent, h)


def oYcrb(run: Any) -> Array:
    """Inertias of the subtrees, in the world; row 0 the robot's."""
    inertias = run.numbers.inertias
    out: Array = np.empty_like(inertias)
    tree_kernels.composite_bodies(np.ascontiguousarray(oMi(run)), inertias, run.library.parents, out)
    return out


def moving_oYcrb(run: Any) -> Array:
    """``oYcrb`` with row 0 zero."""
    found = oYcrb(run)
    found[0] = 0.0
    return found


# --- the robot as a whole --------------------------------------------------------------------------------


def diagonal(L: Array) -> Array:
    """D of an L with D on its diagonal."""
    return np.array(L.diagonal())


def unit_upper(L: Array) -> Array:
    """U = Lᵀ of an L with D on its diagonal."""
    found = np.eye(len(L))
    np.copyto(found, L.T, where=_above_diagonal(len(L)))
    return found


@cache
def _above_diagonal(n: int) -> NDArray[np.bool_]:
    return ~np.tri(n, dtype=bool)


def columns(run: Any, _: Any = None) -> Array:
    """A regressor's columns for the joints after the universe, side by side; a new array."""
    Y, joints = run.result, run.library.joints
    found = Y[..., 1:, :] if joints is None else Y[..., joints[1:], :]
    return np.array(found.reshape((*Y.shape[:-2], found.shape[-2] * found.shape[-1])), order="C")


def world_com(run: Any) -> Array:
    """Centres of mass of each joint's subtree, in the world."""
    c, X = com(run), oMi(run)
    return np.asarray(np.einsum("kij,kj->ki", X[:, :3, :3], c) + X[:, :3, 3])


def mass(run: Any) -> Array:
    """Mass of each joint's subtree."""
    found: Array = run.library.subtree_masses(run.state)
    return found


def Ig(run: Any) -> Array:
    """Inertia of the robot about its centre of mass, in the axes of the world."""
    found: Array = oYcrb(run)[0]
    found[1:4] = 0.0
    return found


def mechanical_energy(run: Any, _: Any = None) -> float:
    """Kinetic and potential energy."""
    fills, library = run.kind.fills, run.library
    potential = library.potential_energy(run.q) if run.state is library.state else None
    if potential is None:
        potential = np.asarray(fills["potential_energy"](run))
    return float(np.asarray(fills["kinetic_energy"](run)).item() + potential.item())


def momentum_rate_and_weight(run: Any) -> Array:
    """dhg of Pinocchio's computeAllTerms: the rate of momentum at a = 0, less the weight."""
    found = dhg(run)
    found[:3] -= mass(run)[0] * run.numbers.gravity[:3]
    return found


def net_forces(run: Any) -> Array:
    """Joint forces without gravity; row 0 is their sum at the universe."""
    found = f(run)
    X, c, m = oMi(run), world_com(run), mass(run)
    weight = np.zeros_like(found)
    weight[:, :3] = m[:, None] * run.numbers.gravity[:3]
    weight[:, 3:] = np.cross(c, weight[:, :3])
    for k, own in enumerate(found):
        here = np.empty(6)
        operator_kernels.force_to_child(X[k], weight[k], here)
        own += here
    return summed_at_world(run, found)


def summed_at_world(run: Any, forces: Array) -> Array:
    """Joint forces with row 0 set to the sum of those on the universe, in the world."""
    X, part = oMi(run), np.empty(6)
    forces[0] = 0.0
    for k in np.flatnonzero(run.library.parents[1:] == 0) + 1:
        operator_kernels.force_to_parent(X[k], forces[k], part)
        forces[0] += part
    return forces


def rnea_derivatives_at_ddq(run: Any) -> Array:
    """Derivatives of inverse dynamics at the accelerations of a call of forward dynamics."""
    return CallRecipe("rnea_derivatives", "").at(run, run.q, run.v, ddq(run), *([] if run.fext is None else [run.fext]))


def tau_without_weight(run: Any) -> Array:
    """Torques without those of gravity and of rotor inertia."""
    found: Array = tau(run) - g(run) - run.numbers.armature * run.a
    return found


# --- the kinds -------------------------------------------------------------------------------------------


def _kind(
    call: str, inputs: str, fills: str = "", unused: int = 0, in_data: bool = False, derivatives: bool = False,
    **own: Recipe,
) -> Kind:  # fmt: skip
    """A Kind that fills the fields named in ``fills`` by the recipes of their names, and others by their own."""
    found = {name: globals()[name] for name in fills.split()}
    return Kind(call, inputs, {**found, **own}, unused, result_in_data=in_data, derivatives=derivatives)


def _path(**own: Recipe) -> Kind:
    return Kind("", "q", {"liMi": liMi, **own}, places_path=True)


FACTORS: dict[str, Any] = {"D": lambda run: diagonal(run.contact.L), "U": lambda run: unit_upper(run.contact.L)}
PLACES = "liMi oMi"
MASSES = f"{PLACES} com mass"
MAP, MAP_DOT = f"{PLACES} J com oYcrb", f"{PLACES} J com oYcrb dJ ov"
MOVING = f"{PLACES} J dJ v ov"
ACCELERATED = f"{MOVING} a oa"
ENERGIES = "kinetic_energy potential_energy mechanical_energy"


def constraint_forces(run: Any) -> Array:
    """Forces or impulses of the constraints."""
    return np.array(run.contact.force)


CALL_KINDS: dict[str, Kind] = {
    "rnea": _kind("rnea", "q v a", "liMi v a_gf f h", tau=result),
    "aba": _kind("aba", "q v tau", "liMi v a_gf f h", ddq=result),
    "aba_world": _kind(
        "aba", "q v tau", f"{PLACES} J oa oa_gf of oh ov", ddq=result, oYcrb=bodies_in_world
    ),
    "crba": _kind("crba", "q", "liMi Ycrb", M=result),
    "crba_world": _kind("crba", "q", f"{MAP} Ag mass", M=result),
    "nle": _kind("nonlinear_effects", "q v", "liMi v a_gf f", nle=result),
    "gravity": _kind("generalized_gravity", "q", "liMi a_gf f", g=result),
    "static": _kind("static_torque", "q", "liMi a_gf f", tau=result),
    "coriolis": _kind("coriolis_matrix", "q v", f"{MOVING} oh", C=result, oYcrb=moving_oYcrb),
    "minverse": _kind("minverse", "q", f"{PLACES} J", Minv=result, oYcrb=bodies_in_world),
    "all": _kind(
        "nonlinear_effects", "q v", f"{MASSES} {MAP_DOT} Ag dAg Ig a a_gf v hg vcom g {ENERGIES}",
        in_data=True, nle=result, M=CallRecipe("crba", "q"), Jcom=CallRecipe("com_jacobian", "q"),
        f=lambda run: summed_at_world(run, f(run)), h=subtree_momenta, dhg=momentum_rate_and_weight,
    ),
    "kinematics0": _kind("forward_kinematics", "q", PLACES, in_data=True),
    "kinematics1": _kind("forward_kinematics", "q v", f"{PLACES} v", 1, True),
    "kinematics2": _kind("forward_kinematics", "q v a", f"{PLACES} v a", 2, True),
    "frames": _kind("", "", oMf=result),
    "global_placements": _kind("", "q", oMi=result),
    "frame_jacobian_local": _path(),
    "frame_jacobian_world": _path(oMi=oMi),
    "jacobians": _kind("joint_jacobians", "q", PLACES, J=result),
    "jacobians_dot": _kind("joint_jacobians_dot", "q v", f"{PLACES} J v ov", dJ=result),
    "com0": _kind("center_of_mass", "q", MASSES),
    "com1": _kind("center_of_mass", "q v", f"{MASSES} v vcom", 1),
    "com2": _kind("center_of_mass", "q v a", f"{MASSES} v vcom a acom", 2),
    "com_jacobian": _kind("com_jacobian", "q", f"{MASSES} J", Jcom=result, com=world_com),
    "subtree_com_jacobian": _kind(
        "", "q", f"{MASSES} J", Jcom=CallRecipe("com_jacobian", "q"), com=world_com
    ),
    "ccrba": _kind("centroidal_map", "q v", f"{MAP} Ig hg", 1, Ag=result),
    "dccrba": _kind("centroidal_map_dot", "q v", f"{MAP_DOT} Ag Ig hg v vcom", dAg=result),
    "map": _kind("centroidal_map", "q", MAP, Ag=result),
    "map_dot": _kind("centroidal_map_dot", "q v", f"{MAP_DOT} Ag v", dAg=result),
    "momentum": _kind("centroidal_momentum", "q v", f"{MASSES} v vcom", hg=result, h=subtree_momenta),
    "momentum_dot": _kind(
        "centroidal_momentum_rate", "q v a", f"{MASSES} hg v vcom a", dhg=result, h=subtree_momenta, f=net_forces
    ),
    "rnea_derivatives": _kind(
        "rnea_derivatives", "q v a", f"{ACCELERATED} tau oa_gf of", dtau_dq=Part(0), dtau_dv=Part(1), M=Part(2),
        oYcrb=moving_oYcrb, derivatives=True,
    ),
    "aba_derivatives": _kind(
        "aba_derivatives", "q v tau", f"{PLACES} ddq J dJ ov", ddq_dq=Part(0), ddq_dv=Part(1), Minv=Part(2),
        dtau_dq=lambda run: rnea_derivatives_at_ddq(run)[0], dtau_dv=lambda run: rnea_derivatives_at_ddq(run)[1],
    ),
    "gravity_derivatives": _kind("generalized_gravity_derivatives", "q", f"{PLACES} J g"),
    "static_derivatives": _kind("static_torque_derivatives", "q", f"{PLACES} tau J"),
    "kinematics_derivatives1": _kind("forward_kinematics", "q v", MOVING, 1, True, True),
    "kinematics_derivatives2": _kind("forward_kinematics", "q v a", ACCELERATED, 2, True, True),
    "centroidal_derivatives": _kind(
        "centroidal_dynamics_derivatives", "q v a", f"{ACCELERATED} hg dhg Ig com mass", Ag=Part(3),
        tau=tau_without_weight, derivatives=True,
    ),
    "constrained": _kind("", "", **FACTORS, ddq=result, lambda_c=constraint_forces),
    "contacts": _kind("", "", ddq=result, lambda_c=constraint_forces),
    "impact": _kind("", "", **FACTORS, dq_after=result, impulse_c=constraint_forces),
    "bordered": _kind("", "", **FACTORS),
    "kinetic": _kind("kinetic_energy", "q v", f"{PLACES} v", in_data=True, kinetic_energy=result),
    "potential": _kind("potential_energy", "q", PLACES, in_data=True, potential_energy=result),
    "mechanical": _kind("kinetic_energy", "q v", f"{PLACES} v {ENERGIES}", in_data=True, kinetic_energy=result),
    "torque_regressor": _kind("joint_torque_regressor", "q v a", "liMi v a_gf", jointTorqueRegressor=columns),
    "static_regressor": _kind("static_regressor", "q", PLACES, staticRegressor=columns),
    "kinetic_regressor": _kind("kinetic_energy_regressor", "q v", f"{PLACES} v", kineticEnergyRegressor=columns),
    "potential_regressor": _kind("potential_energy_regressor", "q", PLACES, potentialEnergyRegressor=columns),
}  # fmt: skip
