"""From an ``MjModel``, MuJoCo's compiled MJCF, to a Model: ``from_mjmodel``.

MuJoCo reads and compiles the file, so it resolves defaults, includes, meshes and inertias; the compiled bodies and
joints become a ``Robot``. Source: MuJoCo's documentation, Computation, kinematics of ``mj_kinematics``, and the
fields of mjModel; the tests compare every number with MuJoCo.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import ModelError, SpatialDynError, pip_install
from ..model.joint_rows import joint_transform
from ..model.model import Model, assemble
from ..model.robot import Link, Mimic, Robot, RobotJoint
from ..model.robot_checks import check_inertias, check_tree, clear_rounding, make_joint, make_link
from ..waiting import watch
from .mjmodel_scene import declared
from .mjmodel_values import FREE, KINDS, XML_NAMES, active_couplers, floats_of, name_of, names_of, pose_of, turned

Array = NDArray[np.float64]
WORLD = "world"


def from_mjmodel(
    mjmodel: Any,
    root: str = "fixed",
    gravity: ArrayLike | None = None,
    continuous: str = "angle",
    mimic: bool = False,
    inertia: str = "warn",
) -> Model:
    """The Model of a compiled ``mujoco.MjModel``: its bodies, joints and sites, q and v in the order of qpos and qvel.

    Source: MuJoCo's documentation, Computation, and the fields of mjModel.

    mjmodel     ``mujoco.MjModel``, or ``mujoco.MjSpec``, which is compiled
    root        "fixed": the world is the root link; "floating": the whole model floats
    gravity     (3,) [m/s²]; the file's own if left out
    continuous  as in ``load_urdf``; hinges without a range are revolute, of one coordinate
    mimic       True: joints that an equality couples to others have no coordinates
    inertia     policy on inertias that are not physical, as in ``load_urdf``

    Hinges and slides have the numbers of qpos, including their ``ref``; a quaternion is x y z w here, and a free
    joint's velocity is in its own frame: ``to_mujoco`` and ``from_mujoco`` convert states. Links, on frames of the same
    name, are bodies and sites; unnamed ones are named as in Pinocchio (``BODY_free``, ``BODYJoint_0``, ``BODY_fixed``).
    Armatures are those of joints plus gear² times those of actuators.

    Joints keep their damping, frictionloss and ranges; in ``Scene.of(model)`` these act, and so do the file's
    equalities, contacts of feet with a ground and DC motors. ``read_transmissions(model)`` returns the gears of
    actuators on joints. ``model.notes`` lists the parts of the file without a counterpart.

    Raises  SpatialDynError for another value, or without the package mujoco; ModelError, InertiaError

    >>> import mujoco
    >>> text = "<mujoco><worldbody><body name='rod'><joint name='pin'/><geom size='.1'/></body></worldbody></mujoco>"
    >>> from_mjmodel(mujoco.MjModel.from_xml_string(text)).names
    ('universe', 'pin')
    """
    with watch.call("from_mjmodel"):
        robot = robot_of(compiled(mjmodel))
    if (
        isinstance(root, str)
        and root == "floating"
        and (free := [j.name for j in robot.joints if j.kind == "floating"])
    ):
        raise ModelError(f'root is "floating" and the file has the free joint "{free[0]}", expected "fixed"')
    own = mjmodel_gravity(compiled(mjmodel)) if gravity is None else gravity
    return assemble(check_inertias(robot, inertia), root, own, continuous, mimic)


def need_mujoco() -> Any:
    """The package mujoco. Raises SpatialDynError with the command that installs it."""
    try:
        import mujoco
    except ImportError as error:
        raise SpatialDynError(f"MJCF needs MuJoCo: {pip_install('mujoco')}") from error
    return mujoco


def compiled(given: Any) -> Any:
    """An MjModel as it is, an MjSpec compiled. Raises SpatialDynError."""
    mujoco = need_mujoco()
    if isinstance(given, mujoco.MjSpec):
        try:
            return given.compile()
        except ValueError as error:
            raise SpatialDynError(f"MjSpec does not compile: {error}") from None
    if not isinstance(given, mujoco.MjModel):
        raise SpatialDynError(f"mjmodel is a {type(given).__name__}, expected a mujoco.MjModel or MjSpec")
    return given


def mjmodel_gravity(m: Any) -> tuple[float, ...]:
    """Gravity of an MjModel (3,), 0 where a flag disables it [m/s²]."""
    mujoco = need_mujoco()
    off = m.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    return (0.0, 0.0, 0.0) if off else floats_of(m.opt.gravity)


@dataclass
class Tree:
    """Links and joints of an MjModel under construction, and the names in use.

    link_of   name of the link on the frame of each body
    joint_of, site_of  names of the joints, and of the links on the sites, by their numbers
    """

    links: list[Link] = field(default_factory=list)
    joints: list[RobotJoint] = field(default_factory=list)
    link_names: set[str] = field(default_factory=set)
    joint_names: set[str] = field(default_factory=set)
    link_of: dict[int, str] = field(default_factory=dict)
    joint_of: dict[int, str] = field(default_factory=dict)
    site_of: dict[int, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def fresh(self, name: str, taken: set[str]) -> str:
        """The name, with underscores appended until it is unused; it counts as used from now on."""
        made = name.translate(XML_NAMES)
        while made in taken:
            made += "_"
        taken.add(made)
        return made

    def fix(self, name: str, parent: str, X: Array, inertia: Any = None, joint: str | None = None) -> str:
        """Add a link on a fixed joint; returns its name."""
        link = self.fresh(name, self.link_names)
        if link != name:
            self.notes.append(f'frame "{name}" is called "{link}", for its name is taken, or cannot be written in XML')
        self.add(link, RobotJoint(self.fresh(joint or f"{name}_fixed", self.joint_names), "fixed", parent, link,
                                  flat(X)), inertia)  # fmt: skip
        return link

    def add(self, link: str, joint: RobotJoint, inertia: Any = None) -> None:
        """Add a link and its joint."""
        self.links.append(Link(link) if inertia is None else make_link(link, inertia))
        self.joints.append(make_joint(joint))


def flat(X: Array) -> tuple[float, ...]:
    """A placement in row-major order; rotation entries below 1e-15 are zero."""
    made = np.array(X)
    clear_rounding(made[:3, :3])
    return tuple((made + 0.0).ravel().tolist())


def tree_of(m: Any) -> Tree:
    """Links and joints of the bodies and sites of an MjModel; a body's sites come before its child bodies."""
    mujoco = need_mujoco()
    tree = Tree()
    tree.links.append(Link(WORLD))
    tree.link_names |= {WORLD, *names_of(m, mujoco.mjtObj.mjOBJ_BODY, m.nbody)} - {""}
    tree.joint_names |= {*names_of(m, mujoco.mjtObj.mjOBJ_JOINT, m.njnt)} - {""}
    tree.link_of[0] = WORLD
    followers = {k: (leader, ratio, offset) for k, leader, ratio, offset in active_couplers(m)}
    sites = np.asarray(m.site_bodyid)
    for body in range(m.nbody):
        if body:
            _add_body(m, tree, body, followers)
        for count, site in enumerate(np.flatnonzero(sites == body).tolist()):
            name = name_of(m, mujoco.mjtObj.mjOBJ_SITE, site) or f"{tree.link_of[body]}Site_{count}"
            X = pose_of(m.site_pos[site], m.site_quat[site])
            tree.site_of[site] = tree.fix(name, tree.link_of[body], X)
    return tree


def robot_of(m: Any) -> Robot:
    """The robot of an MjModel, with the declarations of its file and notes on parts without a counterpart."""
    tree = tree_of(m)
    text = declared(m, tree)
    name = model_name(m) or "robot"
    checked = check_tree(name, tree.links, tree.joints, tree.notes)
    return replace(checked, ordered=True, declared=text)


def model_name(m: Any) -> str:
    """The name of an MjModel; empty if it has none."""
    return bytes(m.names).partition(b"\0")[0].decode(errors="replace").translate(XML_NAMES)


def _add_body(m: Any, tree: Tree, body: int, followers: dict[int, tuple[int, float, float]]) -> None:
    """Add a body: a link for each of its joints; the last one, or a link fixed to it, has the body's frame."""
    mujoco = need_mujoco()
    given = name_of(m, mujoco.mjtObj.mjOBJ_BODY, body)
    link = given.translate(XML_NAMES) if given and given != WORLD else tree.fresh(f"body{body}", tree.link_names)
    parent = tree.link_of[int(m.body_parentid[body])]
    tree.link_of[body] = link
    back = pose_of(m.body_pos[body], m.body_quat[body])  # the body's frame at qpos0, in the link before
    inertia = inertia_of(m, body)
    joints = range(m.body_jntadr[body], m.body_jntadr[body] + m.body_jntnum[body]) if m.body_jntnum[body] else ()
    if not joints:
        joint = RobotJoint(tree.fresh(f"{link}_fixed", tree.joint_names), "fixed", parent, link, flat(back))
        tree.add(link, joint, inertia)
        return
    for count, j in enumerate(joints):
        kind = KINDS[int(m.jnt_type[j])]
        name = _joint_name(m, tree, j, link, count)
        anchor = np.eye(4)
        anchor[:3, 3] = 0.0 if kind == "floating" else m.jnt_pos[j]
        X = np.eye(4) if kind == "floating" else back @ anchor
        values = _values(m, tree, j, kind, name, followers)
        if (ref := float(m.qpos0[m.jnt_qposadr[j]])) and kind in ("revolute", "prismatic"):
            X = X @ joint_transform(kind, np.array(values["axis"]), np.array([-ref]), "angle", 0.0)
        last = count == len(joints) - 1
        centred = bool((anchor == np.eye(4)).all())
        moved = link if last and centred else tree.fresh(f"{name}_link", tree.link_names)
        tree.add(moved, RobotJoint(name, kind, parent, moved, flat(X), **values), inertia if moved == link else None)
        back, parent = np.asarray(np.linalg.inv(anchor), np.float64), moved
        if last and moved != link:
            fixed = RobotJoint(tree.fresh(f"{link}_fixed", tree.joint_names), "fixed", parent, link, flat(back))
            tree.add(link, fixed, inertia)


def _joint_name(m: Any, tree: Tree, j: int, link: str, count: int) -> str:
    given = name_of(m, need_mujoco().mjtObj.mjOBJ_JOINT, j)
    free = int(m.jnt_type[j]) == FREE
    if given and given not in ("universe",):
        name = given.translate(XML_NAMES)
    else:
        name = tree.fresh(f"{link}_free" if free else f"{link}Joint_{count}", tree.joint_names)
    tree.joint_of[j] = name
    return name


def inertia_of(m: Any, body: int) -> tuple[float, Array, Array] | None:
    """(mass, com, inertia (3, 3) about the com) in the body's frame; None for a body without mass and inertia."""
    if not m.body_mass[body] and not m.body_inertia[body].any():
        return None
    R = turned(m.body_iquat[body])
    I = R @ np.diag(m.body_inertia[body]) @ R.T
    return float(m.body_mass[body]), np.array(m.body_ipos[body]), 0.5 * (I + I.T)


def _values(
    m: Any, tree: Tree, j: int, kind: str, name: str, followers: dict[int, tuple[int, float, float]]
) -> dict[str, Any]:
    """The fields of a joint beside its place."""
    dof, freedoms = int(m.jnt_dofadr[j]), {"floating": 6, "spherical": 3}.get(kind, 1)
    armature = np.array(m.dof_armature[dof : dof + freedoms]) + reflected(m)[dof : dof + freedoms]
    made: dict[str, Any] = {
        "damping": float(m.dof_damping[dof]), "friction": float(m.dof_frictionloss[dof]),
        "armature": float(armature[0]) if len({*armature.tolist()}) == 1 else floats_of(armature),
        "effort": _effort(m, tree, j, name),
    }  # fmt: skip
    if kind in ("revolute", "prismatic"):
        made["axis"] = floats_of(m.jnt_axis[j])
        if m.jnt_limited[j]:
            made["lower"], made["upper"] = floats_of(m.jnt_range[j])
        if j in followers:
            leader, ratio, offset = followers[j]
            made["mimic"] = Mimic(_leader(m, leader), ratio, offset)
    elif m.jnt_limited[j]:
        tree.notes.append(f'ball joint "{name}" has a range of {m.jnt_range[j][1]:g} rad, which is left out')
    if kind == "floating" and armature.any():
        text = f'free joint "{name}" has armature {armature.tolist()}'
        tree.notes.append(f"{text}: it acts along the body's axes here, in MuJoCo along the world's")
    return made


def _leader(m: Any, j: int) -> str:
    """The name of a joint that others follow, its own or the one that it will get, as it may not exist yet."""
    given = name_of(m, need_mujoco().mjtObj.mjOBJ_JOINT, j)
    return given.translate(XML_NAMES)


def _effort(m: Any, tree: Tree, j: int, name: str) -> float:
    """The largest torque that actuators may give to a joint; infinite if none is set."""
    most = math.inf
    if m.jnt_actfrclimited[j]:
        low, high = floats_of(m.jnt_actfrcrange[j])
        most = max(abs(low), abs(high))
        if low != -high:
            tree.notes.append(
                f'joint "{name}" has actuatorfrcrange {low:g} to {high:g}; effort is the larger, {most:g}'
            )
    given = [x for a in on_joint(m, j) if (x := _most_of(m, a)) is not None]
    return min(most, sum(given)) if given and len(given) == len([*on_joint(m, j)]) else most


def on_joint(m: Any, j: int) -> Iterator[int]:
    """The actuators that drive a joint."""
    mujoco = need_mujoco()
    kinds = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    return (a for a in range(m.nu) if int(m.actuator_trntype[a]) in kinds and int(m.actuator_trnid[a][0]) == j)


def _most_of(m: Any, a: int) -> float | None:
    """The largest torque of an actuator at its joint; None without a limit."""
    mujoco = need_mujoco()
    gear = abs(float(m.actuator_gear[a][0]))
    found = []
    if m.actuator_forcelimited[a]:
        found.append(gear * float(abs(m.actuator_forcerange[a]).max()))
    plain = (
        int(m.actuator_gaintype[a]) == int(mujoco.mjtGain.mjGAIN_FIXED)
        and int(m.actuator_biastype[a]) == int(mujoco.mjtBias.mjBIAS_NONE)
        and int(m.actuator_dyntype[a]) == int(mujoco.mjtDyn.mjDYN_NONE)
    )
    if plain and m.actuator_ctrllimited[a]:
        found.append(gear * abs(float(m.actuator_gainprm[a][0])) * float(abs(m.actuator_ctrlrange[a]).max()))
    return min(found, default=None)


def reflected(m: Any) -> Array:
    """Terms of actuators on joints of one freedom in the diagonal of M (nv,): gear² times their armature."""
    made = np.zeros(m.nv)
    own = getattr(m, "actuator_armature", None)  # since MuJoCo 3.6
    if own is not None:
        for j in range(m.njnt):
            if KINDS[int(m.jnt_type[j])] in ("revolute", "prismatic"):
                made[m.jnt_dofadr[j]] = sum(float(m.actuator_gear[a][0]) ** 2 * float(own[a]) for a in on_joint(m, j))
    return made
