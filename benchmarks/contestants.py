"""Other libraries on the same samples: Pinocchio, which is also the oracle, and those that are installed.

Each function returns, for one call of a case, a ``Contestant``, or None if the library lacks the call or cannot hold
the robot. Functions import optional libraries; one that is not installed is "absent".
"""

from __future__ import annotations

import importlib
import os
import tempfile
import warnings
import xml.etree.ElementTree as ET
from collections import deque
from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import Any

import numpy as np
import pinocchio as pin
from cases import Array, Case, Contestant, looked_at, rows

import spatialdyn as sd

FEW = 512  # samples of a loop in Python
GRAVITY = 9.81
FIXED_ARMS = ("ur5", "panda")  # of the optional libraries
MODULES = {"mujoco": "mujoco", "casadi + adam": "adam", "frax": "frax", "drake": "pydrake"}


def installed() -> dict[str, str]:
    """Version of each optional library, or "absent"."""
    from importlib.metadata import PackageNotFoundError, version

    packages = {"mujoco": ("mujoco",), "casadi + adam": ("casadi", "adam-robotics"), "frax": ("frax", "jax")}
    found = {}
    os.environ.setdefault("JAX_ENABLE_X64", "1")
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")
    for name, module in MODULES.items():
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # frax gives advice about settings
                importlib.import_module(module)
            found[name] = ", ".join(version(package) for package in packages.get(name, (name,)))
        except (ImportError, PackageNotFoundError):
            found[name] = "absent"
    return found


def looped(single: Callable[[int], Any], samples: int, how: str = "loop in Python") -> dict[str, Any]:
    """Fields of a Contestant that takes samples one by one."""
    few = range(min(samples, FEW))
    return {"single": lambda: single(0), "batch": lambda: [single(k) for k in few], "count": len(few), "how": how}


# --- Pinocchio -------------------------------------------------------------------------------------------


def pin_function(case: Case, call: str) -> Callable[..., Any]:
    """Pinocchio's function of (q, v, a)."""
    model, data = case.theirs, case.theirs.createData()
    joint = list(case.ours.names).index(case.tip)
    functions = {
        "rnea": pin.rnea,
        "crba": pin.crba,
        "aba": pin.aba,
        "nonlinear_effects": pin.nonLinearEffects,
        "gravity": pin.computeGeneralizedGravity,
        "minverse": pin.computeMinverse,
    }
    if call in functions:
        return partial(functions[call], model, data)

    def kinematics(q: Array) -> list[Any]:
        pin.computeJointJacobians(model, data, q)
        return [data.oMi[joint].homogeneous, pin.getJointJacobian(model, data, joint, pin.LOCAL)]

    return kinematics


def pinocchio(case: Case, call: str) -> Contestant:
    """Pinocchio from Python, one sample at a time; timed is a bare loop over rows that were split before."""
    function, arguments = pin_function(case, call), case.arguments(call)
    one = case.one(call)
    made = looped(lambda k: function(*(x[k] for x in arguments)), case.samples)
    apart = [list(x[: made["count"]]) for x in arguments]
    return Contestant(
        **{**made, "single": lambda: function(*one)}, read=rows, bare=lambda: deque(map(function, *apart), maxlen=0)
    )


def pool(case: Case, call: str, threads: int) -> Contestant | None:
    """Pinocchio's C++ thread pool, for the calls that have one."""
    run = {"rnea": pin.rneaInParallel, "aba": pin.abaInParallel}.get(call)
    if run is None:
        return None
    models = pin.ModelPool(case.theirs, threads)
    columns = [np.asfortranarray(x.T) for x in case.arguments(call)]
    out = np.zeros((case.ours.nv, case.samples), order="F")
    how = "rneaInParallel" if call == "rnea" else "abaInParallel"

    def batch() -> Array:
        run(threads, models, *columns, out)
        return out.T

    return Contestant(None, batch, case.samples, how)


def expected(case: Case, call: str) -> Array:
    """The oracle's rows for the compared samples."""
    function, arguments = pin_function(case, call), case.arguments(call)
    at = looked_at(case)
    return rows([function(*(x[i] for x in arguments)) for i in at], at)


# --- MuJoCo ----------------------------------------------------------------------------------------------


def mujoco_model(theirs: Any, more: Callable[[ET.Element, list[ET.Element]], None] | None = None) -> Any:
    """A MuJoCo model of a Pinocchio model: same joints in the same order, no contact, no damping.

    more  takes the text's root, and the element of each joint's body, the world's first, and adds to them
    """
    import mujoco

    world = ET.Element("mujoco", model="peer")
    ET.SubElement(world, "option", gravity=f"0 0 {-GRAVITY}")
    ET.SubElement(world, "compiler", angle="radian")
    elements = [ET.SubElement(world, "worldbody")]
    for i in range(1, theirs.njoints):
        X = theirs.jointPlacements[i]
        quaternion = pin.Quaternion(X.rotation).coeffs()[[3, 0, 1, 2]]
        body = ET.SubElement(elements[theirs.parents[i]], "body", pos=_text(X.translation), quat=_text(quaternion))
        ET.SubElement(body, "inertial", pos="0 0 0", mass="1", diaginertia="1 1 1")  # the true one is set below
        _mujoco_joint(body, theirs.joints[i])
        elements.append(body)
    if more is not None:
        more(world, elements)
    model = mujoco.MjModel.from_xml_string(ET.tostring(world, encoding="unicode"))
    for i in range(1, theirs.njoints):  # as they are: MuJoCo's compiler rejects inertias that are not physical
        I = theirs.inertias[i]
        moments, axes = np.linalg.eigh(I.inertia)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        model.body_mass[i], model.body_ipos[i], model.body_inertia[i] = I.mass, I.lever, moments
        model.body_iquat[i] = pin.Quaternion(axes).coeffs()[[3, 0, 1, 2]]
    bits = mujoco.mjtDisableBit
    model.opt.disableflags = int(bits.mjDSBL_CONSTRAINT) | int(bits.mjDSBL_CONTACT) | int(bits.mjDSBL_SENSOR)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def _mujoco_joint(body: ET.Element, joint: Any) -> None:
    if joint.shortname() == "JointModelFreeFlyer":
        ET.SubElement(body, "freejoint")
        return
    data = joint.createData()
    joint.calc(data, np.zeros(joint.idx_q + joint.nq))  # S is the same at any angle
    S = np.ravel(data.S)
    kind, axis = ("slide", S[:3]) if np.any(S[:3]) else ("hinge", S[3:])
    ET.SubElement(body, "joint", type=kind, axis=_text(axis))


def _text(numbers: Sequence[float]) -> str:
    return " ".join(repr(float(x)) for x in numbers)


def mujoco(case: Case, call: str) -> Contestant | None:
    """MuJoCo's functions for a call, one sample at a time from Python.

    MuJoCo's floating base has its linear velocity in the world's axes; inputs are rotated before timing, results when
    they are read.
    """
    import mujoco as mj

    model = mujoco_model(case.theirs)
    data, n = mj.MjData(model), model.nv
    qpos, qvel = sd.to_mujoco(case.ours, case.state["q"], case.state["v"])
    base = Base(case)
    acceleration, torque = base.acceleration(case.state["a"]), base.turned(case.state["t"])
    fall = (
        base.acceleration(np.zeros_like(case.state["a"])) if case.root == "floating" else None
    )  # the Model's frame is at rest
    zero, eye = np.zeros(n), np.eye(n)
    body = list(case.ours.names).index(case.tip)

    def place(k: int, v: Array) -> None:
        data.qpos[:], data.qvel[:] = qpos[k], v
        mj.mj_kinematics(model, data)
        mj.mj_comPos(model, data)

    def newton_euler(k: int, v: Array, a: Array | None) -> Array:
        place(k, v)
        mj.mj_comVel(model, data)
        out = np.empty(n)
        if a is not None:
            data.qacc[:] = a
        mj.mj_rne(model, data, int(a is not None), out)
        return out

    def mass(k: int) -> Array:
        place(k, zero)
        _mass_matrix(mj)(model, data)
        out = np.empty((n, n))
        _full(mj, model, data, out)
        return out

    def inverse(k: int) -> Array:
        place(k, zero)
        _mass_matrix(mj)(model, data)
        mj.mj_factorM(model, data)
        out = np.empty((n, n))
        mj.mj_solveM(model, data, out, eye)
        return out

    def forward(k: int) -> Array:
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = qpos[k], qvel[k], torque[k]
        mj.mj_forward(model, data)
        return data.qacc.copy()

    def kinematics(k: int) -> list[Array]:
        place(k, zero)
        linear, angular = np.empty((3, n)), np.empty((3, n))
        mj.mj_jacBody(model, data, linear, angular, body)
        return [data.xmat[body].reshape(3, 3).copy(), data.xpos[body].copy(), linear, angular]

    single = {
        "rnea": lambda k: newton_euler(k, qvel[k], acceleration[k]),
        "nonlinear_effects": lambda k: newton_euler(k, qvel[k], None if fall is None else fall[k]),
        "gravity": lambda k: newton_euler(k, zero, None),
        "crba": mass,
        "minverse": inverse,
        "aba": forward,
        "kinematics": kinematics,
    }[call]
    read = {"kinematics": base.frames, "crba": base.matrices, "minverse": base.matrices, "aba": base.accelerations}
    return Contestant(**looped(single, case.samples), read=read.get(call, base.forces))


def _mass_matrix(mj: Any) -> Any:
    return getattr(mj, "mj_makeM", mj.mj_crb)


def _full(mj: Any, model: Any, data: Any, out: Array) -> None:
    """M as a full matrix; the arguments changed with MuJoCo 3.4."""
    try:
        mj.mj_fullM(model, data, out)
    except TypeError:
        mj.mj_fullM(model, out, data.qM)


class Base:
    """Between MuJoCo's linear velocity of a floating base, in the world's axes, and the Model's, its own; w = T v."""

    def __init__(self, case: Case) -> None:
        """T of every sample, and ω × v, the further difference of linear accelerations; none for a fixed base."""
        n, samples, self.floating = case.ours.nv, case.samples, case.root == "floating"
        self.T, self.shift = np.tile(np.eye(n), (samples, 1, 1)), np.zeros((samples, n))
        if self.floating:
            v = case.state["v"]
            for k, q in enumerate(case.state["q"]):
                self.T[k, :3, :3] = pin.Quaternion(q[3:7]).toRotationMatrix()
            self.shift[:, :3] = np.cross(v[:, 3:6], v[:, :3])

    def turned(self, x: Array) -> Array:
        """T x: forces, and velocities, as MuJoCo has them."""
        return np.einsum("kij,kj->ki", self.T, x)

    def acceleration(self, a: Array) -> Array:
        """As MuJoCo has it."""
        return self.turned(a + self.shift)

    def forces(self, parts: Any, samples: Sequence[int]) -> Array:
        """As we have them."""
        return np.array([self.T[k].T @ x for x, k in zip(parts, samples, strict=True)])

    def accelerations(self, parts: Any, samples: Sequence[int]) -> Array:
        """As we have them."""
        return self.forces(parts, samples) - self.shift[list(samples)]

    def matrices(self, parts: Any, samples: Sequence[int]) -> Array:
        """M or its inverse, as we have it; T is orthogonal."""
        return rows([self.T[k].T @ M @ self.T[k] for M, k in zip(parts, samples, strict=True)], samples)

    def frames(self, parts: Any, samples: Sequence[int]) -> Array:
        """Placement and local Jacobian from rotation, position and the Jacobian in the world's axes."""
        found = []
        for (R, p, linear, angular), k in zip(parts, samples, strict=True):
            X = np.eye(4)
            X[:3, :3], X[:3, 3] = R, p
            found.append([X, np.vstack([R.T @ linear, R.T @ angular]) @ self.T[k]])
        return rows(found, samples)


# --- those that are optional ------------------------------------------------------------------------------


@cache
def bare_urdf(path: str) -> str:
    """A URDF without meshes, damping, transmissions and other elements that dynamics does not use."""
    robot = ET.parse(path).getroot()
    for element in list(robot):
        if element.tag not in ("link", "joint"):
            robot.remove(element)
        for tag in ("visual", "collision", "dynamics", "mimic", "safety_controller", "calibration"):
            for inner in element.findall(tag):
                element.remove(inner)
    return ET.tostring(robot, encoding="unicode")


def root_link(path: str) -> str:
    """The root link of a URDF."""
    robot = ET.parse(path).getroot()
    children = {str(element.get("link")) for element in robot.iter("child")}
    (root,) = {str(link.get("name")) for link in robot.findall("link")} - children
    return root


def adam(case: Case, call: str) -> Contestant | None:
    """adam's recursions as CasADi functions, interpreted; of its floating base the joints' part."""
    import adam.casadi

    if call not in ("crba", "nonlinear_effects", "gravity"):
        return None
    names = list(case.ours.names)[1:]
    with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
        file.write(bare_urdf(case.path))
        file.flush()
        made = adam.casadi.KinDynComputations(file.name, names, gravity=np.array([0, 0, -GRAVITY, 0, 0, 0]))
        function = {
            "crba": made.mass_matrix_fun,
            "nonlinear_effects": made.bias_force_fun,
            "gravity": made.gravity_term_fun,
        }[call]()
    q, v, still, here = case.state["q"], case.state["v"], np.zeros(6), np.eye(4)
    B = case.samples
    one = [here, q[0], still, v[0]] if call == "nonlinear_effects" else [here, q[0]]
    many = function.map(B)
    every: list[Any] = [np.tile(here, B), np.asfortranarray(q.T)]
    every += [np.zeros((6, B)), np.asfortranarray(v.T)] if call == "nonlinear_effects" else []
    n = case.ours.nv + 6

    def joints(raw: Any, samples: Sequence[int]) -> Array:
        parts = [np.asarray(x).reshape(n, -1) for x in raw]
        return rows([x[6:, 6:] if x.shape[1] == n else x[6:] for x in parts], samples)

    def batch() -> Any:
        whole = np.asarray(many(*every))
        return whole.reshape(n, B, -1).swapaxes(0, 1)

    return Contestant(lambda: np.asarray(function(*one)), batch, B, "CasADi map", joints)


def frax(case: Case, call: str) -> Contestant | None:
    """frax under jax.jit and jax.vmap in float64 on the CPU, over the threads that XLA takes."""
    import jax
    from frax.core.robot import Robot

    jax.config.update("jax_enable_x64", True)
    with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
        file.write(bare_urdf(case.path))
        file.flush()
        robot = Robot(file.name, joint_ordering=list(case.ours.names)[1:])
    up = np.array([0, 0, GRAVITY, 0, 0, 0])
    function = {
        "rnea": lambda q, v, a: robot.rnea(q, v, a, up, None),
        "crba": robot.crba,
        "aba": lambda q, v, t: robot.forward_dynamics(q, v, t, None),
        "nonlinear_effects": robot.nonlinear_bias,
        "gravity": robot.gravity_vector,
    }.get(call)
    if function is None:
        return None
    single, batch = jax.jit(function), jax.jit(jax.vmap(function))
    one, every = [jax.numpy.asarray(x) for x in case.one(call)], [jax.numpy.asarray(x) for x in case.arguments(call)]
    return Contestant(
        lambda: single(*one).block_until_ready(),
        lambda: np.asarray(batch(*every).block_until_ready()),
        case.samples,
        "jax.vmap",
    )


def drake(case: Case, call: str) -> Contestant | None:
    """A continuous MultibodyPlant from Python."""
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import MultibodyForces

    if call in ("minverse", "kinematics"):
        return None
    plant = MultibodyPlant(0.0)
    (instance,) = Parser(plant).AddModelsFromString(bare_urdf(case.path), "urdf")
    plant.mutable_gravity_field().set_gravity_vector([0, 0, -GRAVITY])
    root = root_link(case.path)
    if root != "world":  # the parser welds it
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(root, instance))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    names = [plant.get_joint(i).name() for i in plant.GetJointIndices(instance)]
    moving = [name for name in names if plant.GetJointByName(name).num_velocities()]
    moving.sort(key=lambda name: plant.GetJointByName(name).velocity_start())
    order = [case.ours.joint(name).idx_v for name in moving]
    q, v, a, t = (np.ascontiguousarray(case.state[letter][:, order]) for letter in "qvat")
    still, weight = np.zeros(plant.num_velocities()), MultibodyForces(plant)
    port = plant.get_applied_generalized_force_input_port()
    answer = plant.get_generalized_acceleration_output_port()

    def inverse(k: int, velocity: Array, acceleration: Array) -> Array:
        plant.SetPositionsAndVelocities(context, np.concatenate([q[k], velocity]))
        plant.CalcForceElementsContribution(context, weight)
        return plant.CalcInverseDynamics(context, acceleration, weight)

    def mass(k: int) -> Array:
        plant.SetPositions(context, q[k])
        return plant.CalcMassMatrix(context)

    def forward(k: int) -> Array:
        plant.SetPositionsAndVelocities(context, np.concatenate([q[k], v[k]]))
        port.FixValue(context, t[k])
        return answer.Eval(context)

    def gravity(k: int) -> Array:
        plant.SetPositions(context, q[k])
        return -plant.CalcGravityGeneralizedForces(context)

    single = {
        "rnea": lambda k: inverse(k, v[k], a[k]),
        "nonlinear_effects": lambda k: inverse(k, v[k], still),
        "gravity": gravity,
        "crba": mass,
        "aba": forward,
    }[call]
    back = np.argsort(order)

    def in_our_order(raw: Any, samples: Sequence[int]) -> Array:
        return rows([x[np.ix_(*[back] * np.ndim(x))] for x in map(np.asarray, raw)], samples)

    return Contestant(**looped(single, case.samples), read=in_our_order)


MAKE = {"mujoco": mujoco, "casadi + adam": adam, "frax": frax, "drake": drake}
