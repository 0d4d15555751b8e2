"""Declarations of an MjModel beside bodies and joints: loops, gears, motors, feet; notes on those without counterpart.

The result is JSON: options of a ``Scene`` in the form of ``Scene.from_toml``, and transmissions.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..model.robot_checks import quoted
from .mjmodel_values import FREE, KINDS, active_couplers, couplers, floats_of, name_of, pose_of, turned

Array = NDArray[np.float64]
Tree = Any  # of ``mjmodel``, which imports this module
SOFT = "solref and solimp of equalities and contacts, which make them soft, are left out: here they are rigid"
SHAPES = {2: 0, 3: 1, 6: 2}  # mjtGeom of a sphere, a capsule, a box -> rank, the lowest is preferred
MOST = 6  # the most names that a note lists


def declared(m: Any, tree: Tree) -> str:
    """The text of ``Robot.declared``; notes and frames of the feet are added to the tree."""
    scene: dict[str, Any] = {}
    loops = [*_loops(m, tree), *_other_couplers(m, tree)]
    if loops:
        scene["constraint"] = loops
    feet = _feet(m, tree)
    if feet:
        scene["contacts"] = feet
    made: dict[str, Any] = {}
    gears = [*_gears(m, tree)]
    motor = _motor(m, tree)
    if motor:
        scene["motor"] = motor
    if loops or feet:
        tree.notes.append(SOFT)
    if scene:
        made["scene"] = scene
    if gears:
        made["transmission"] = gears
    tree.notes += _left_out(m, tree)
    return json.dumps(made) if made else ""


# --- equalities ---------------------------------------------------------------------------------------------


def _loops(m: Any, tree: Tree) -> Iterator[dict[str, Any]]:
    """Entries of the active equalities connect and weld; a note for each other equality."""
    import mujoco

    line = {e for e, *_ in couplers(m)}
    for e in range(m.neq):
        kind = mujoco.mjtEq(int(m.eq_type[e])).name.removeprefix("mjEQ_").lower()
        name = name_of(m, mujoco.mjtObj.mjOBJ_EQUALITY, e)
        label = f'equality {kind} "{name}"' if name else f"equality {kind} {e}"
        if not m.eq_active0[e]:
            tree.notes.append(f"{label} is not active, and left out")
        elif kind in ("connect", "weld"):
            entry = _held(m, tree, e, kind)
            yield {**entry, "name": name} if name else entry
        elif kind == "joint" and e not in line:
            joint = tree.joint_of[int(m.eq_obj1id[e])]
            why = f'holds joint "{joint}" at a number: model.reduced locks it'
            if int(m.eq_obj2id[e]) >= 0:
                why = f'couples joint "{joint}" by a curve, which has no counterpart'
            tree.notes.append(f"{label} {why}")
        elif kind != "joint":
            tree.notes.append(f"{label} has no counterpart")


def equality_ends(m: Any, e: int, kind: str) -> tuple[tuple[int, int], list[Any]]:
    """The two bodies of a connect or weld, and the poses (4, 4) in them that coincide."""
    import mujoco

    first, second, data = int(m.eq_obj1id[e]), int(m.eq_obj2id[e]), np.asarray(m.eq_data[e])
    if int(m.eq_objtype[e]) == int(mujoco.mjtObj.mjOBJ_SITE):
        places = [pose_of(m.site_pos[s], m.site_quat[s]) for s in (first, second)]
        first, second = (int(m.site_bodyid[s]) for s in (first, second))
    elif kind == "connect":
        places = [np.eye(4), np.eye(4)]
        places[0][:3, 3], places[1][:3, 3] = data[:3], data[3:6]
    else:
        places = [pose_of(data[3:6], data[6:10]), np.eye(4)]
        places[1][:3, 3] = data[:3]
    return (first, second), places


def _held(m: Any, tree: Tree, e: int, kind: str) -> dict[str, Any]:
    """The entry of a connect or weld."""
    (first, second), places = equality_ends(m, e, kind)
    if first == 0:
        first, second, places = second, first, places[::-1]
    entry: dict[str, Any] = {"kind": "point" if kind == "connect" else "weld"}
    entry["frame_a"] = f"link:{tree.link_of[first]}"
    if second:
        entry["frame_b"] = f"link:{tree.link_of[second]}"
    for end, X in zip(("at_a", "at_b"), places, strict=True):
        if (X != np.eye(4)).any():
            entry[end] = X[:3, 3].tolist() if kind == "connect" else X.tolist()
    return entry


def _other_couplers(m: Any, tree: Tree) -> Iterator[dict[str, Any]]:
    """Entries of couplers that make no mimic joint: a joint that follows two, a cycle, a joint without a name."""
    made = {(j, leader, ratio, offset) for j, leader, ratio, offset in active_couplers(m)}
    for _, j, leader, ratio, offset in couplers(m):
        if (j, leader, ratio, offset) not in made:
            names = {"joint": tree.joint_of[j], "to": tree.joint_of[leader]}
            yield {"kind": "coupler", **names, "ratio": ratio, "offset": offset}


# --- actuators ----------------------------------------------------------------------------------------------


def _actuator(m: Any, a: int) -> str:
    import mujoco

    return name_of(m, mujoco.mjtObj.mjOBJ_ACTUATOR, a) or f"actuator{a}"


def _joint_of(m: Any, a: int) -> int | None:
    """The joint of one freedom that an actuator drives."""
    import mujoco

    on_joint = int(m.actuator_trntype[a]) in (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    j = int(m.actuator_trnid[a][0])
    return j if on_joint and KINDS[int(m.jnt_type[j])] in ("revolute", "prismatic") else None


def _gears(m: Any, tree: Tree) -> Iterator[dict[str, Any]]:
    """Transmissions of actuators on joints, the first of each joint; notes on further actuators and on their laws."""
    import mujoco

    driven: set[int] = set()
    laws: dict[str, list[str]] = {}
    for a in range(m.nu):
        name, j = _actuator(m, a), _joint_of(m, a)
        gear = float(m.actuator_gear[a][0])
        if j is None:
            kind = mujoco.mjtTrn(int(m.actuator_trntype[a])).name.removeprefix("mjTRN_").lower()
            laws.setdefault(f"by a transmission of kind {kind}, which has no counterpart", []).append(name)
            continue
        if gear == 0.0 or j in driven:
            laws.setdefault("of gear 0, or a second one of its joint: without a transmission", []).append(name)
        else:
            driven.add(j)
            yield {"joints": [tree.joint_of[j]], "matrix": [[1.0 / gear]], "actuators": [name]}
        law = _law(m, a)
        if law:
            laws.setdefault(law, []).append(name)
    for law, names in laws.items():
        tree.notes.append(f"actuator{'s' * (len(names) > 1)} {quoted(names, MOST)}: {law}")


def _law(m: Any, a: int) -> str:
    """A note on an actuator's law that has no counterpart; empty for a motor whose torque is its control."""
    import mujoco

    gain, bias, p, b = (
        mujoco.mjtGain(int(m.actuator_gaintype[a])).name.removeprefix("mjGAIN_"),
        mujoco.mjtBias(int(m.actuator_biastype[a])).name.removeprefix("mjBIAS_"),
        np.asarray(m.actuator_gainprm[a]), np.asarray(m.actuator_biasprm[a]),
    )  # fmt: skip
    moves = int(m.actuator_dyntype[a]) != int(mujoco.mjtDyn.mjDYN_NONE)
    if gain == "DCMOTOR":
        return ""
    if moves:
        return "have states of their own (activation), which are left out"
    if gain == "FIXED" and bias == "NONE":
        return "" if p[0] == 1.0 else f"of gain {p[0]:g}, in torque per unit of control"
    if gain == "FIXED" and bias == "AFFINE" and p[0] == -b[1] and p[0]:
        return f"position servos, kp {p[0]:g} and kv {0.0 - b[2]:g}, left out: sd.PD is such a law"
    if gain == "FIXED" and bias == "AFFINE" and p[0] == -b[2] and not b[1]:
        return f"velocity servos, kv {p[0]:g}, left out: sd.PD is such a law"
    return f"of gain {gain.lower()} and bias {bias.lower()}, left out"


def _motor(m: Any, tree: Tree) -> dict[str, Any]:
    """Values of a Motor if DC motors drive every joint of one freedom; a note if they drive only some."""
    import mujoco

    kind = getattr(mujoco.mjtGain, "mjGAIN_DCMOTOR", None)
    found = {j: a for a in range(m.nu) if kind is not None and int(m.actuator_gaintype[a]) == int(kind)
             and (j := _joint_of(m, a)) is not None}  # fmt: skip
    if not found:
        return {}
    ones = [j for j in range(m.njnt) if KINDS[int(m.jnt_type[j])] in ("revolute", "prismatic")]
    names = [_actuator(m, a) for a in found.values()]
    volts = {j: float(m.actuator_dynprm[a][1]) or float(abs(m.actuator_ctrlrange[a]).max()) for j, a in found.items()}
    plain = all(not np.asarray(m.actuator_gainprm[a])[2:].any() for a in found.values())
    if {*found} != {*ones} or not all(volts.values()) or not plain:
        why = "not at every joint, without a largest voltage, or with more than resistance and constant"
        tree.notes.append(f"DC motors {quoted(names, MOST)} are left out: {why}; sd.Motor is such a motor")
        return {}
    made: dict[str, list[float]] = {x: [] for x in ("torque_constant", "resistance", "voltage", "ratio")}
    for j in range(m.njnt):
        a = found.get(j)
        for _ in range({"floating": 6, "spherical": 3}.get(KINDS[int(m.jnt_type[j])], 1)):
            R, K = (1.0, 0.0) if a is None else floats_of(m.actuator_gainprm[a][:2])
            row = (K, R, 1.0, 1.0) if a is None else (K, R, volts[j], float(m.actuator_gear[a][0]))
            for values, x in zip(made.values(), row, strict=True):
                values.append(x)
    return made


# --- contacts -----------------------------------------------------------------------------------------------


def _feet(m: Any, tree: Tree) -> dict[str, Any]:
    """Contacts of a floating robot's last bodies with a plane of the world; a note if the file has no plane.

    A sphere is one contact, a capsule has one at each end, a box one at each of its four lowest corners at qpos0. For a
    body with several kinds only the first of these is used: a ball foot, not the shank above it.
    """
    import mujoco

    fixed = [g for g in range(m.ngeom) if m.geom_bodyid[g] == 0]
    planes = [g for g in fixed if int(m.geom_type[g]) == int(mujoco.mjtGeom.mjGEOM_PLANE)]
    ground = planes[0] if planes else None
    up = np.array([0.0, 0.0, 1.0]) if ground is None else turned(m.geom_quat[ground])[:, 2]
    data = mujoco.MjData(m)
    mujoco.mj_kinematics(m, data)
    last = _last_bodies(m)
    radii: dict[str, float] = {}
    friction: dict[str, float] = {}
    other: list[str] = []
    geoms = [g for g in range(m.ngeom) if int(m.geom_bodyid[g]) in last and _meets(m, g, ground)]
    kinds = [SHAPES.get(int(m.geom_type[g]), len(SHAPES)) for g in geoms]
    first: dict[int, int] = {}
    for g, kind in zip(geoms, kinds, strict=True):
        body = int(m.geom_bodyid[g])
        first[body] = min(kind, first.get(body, kind))
    for g, kind in zip(geoms, kinds, strict=True):
        body = int(m.geom_bodyid[g])
        name = name_of(m, mujoco.mjtObj.mjOBJ_GEOM, g) or f"{tree.link_of[body]}_geom{g}"
        points = [*_spheres(m, g, data.xmat[body].reshape(3, 3).T @ up)] if kind == first[body] else []
        if not points:
            other.append(name)
        for k, (p, radius) in enumerate(points):
            X = np.eye(4)
            X[:3, 3] = p
            frame = tree.fix(f"{name}_contact{k}" if len(points) > 1 else f"{name}_contact", tree.link_of[body], X)
            radii[f"link:{frame}"] = radius
            slide = float(m.geom_friction[g][0])
            friction[f"link:{frame}"] = slide if ground is None else max(slide, float(m.geom_friction[ground][0]))
    if other:
        listed = quoted(other, MOST)
        tree.notes.append(f"shapes {listed} of last bodies touch nothing: others stand for those bodies")
    if len(planes) > 1:
        tree.notes.append(f"the world has {len(planes)} planes, of which the first is the ground")
    if not radii:
        return {}
    if ground is None:
        listed = ", ".join(f'"{x}": {r:g}' for x, r in [*radii.items()][:4]) + (", ..." if len(radii) > 4 else "")
        slides = sorted({*friction.values()})
        tree.notes.append(
            f"the file has no ground; feet to put on one are {len(radii)} spheres, of friction "
            f"{', '.join(f'{x:g}' for x in slides)}: sd.Contacts(model, {{{listed}}})"
        )
        return {}
    terrain = {"kind": "plane", "normal": up.tolist(), "height": float(up @ np.asarray(m.geom_pos[ground]))}
    return {"points": radii, "friction": friction, "terrain": terrain}


def _last_bodies(m: Any) -> set[int]:
    """The bodies behind a free joint that carry no further joint, neither directly nor by bodies fixed to them."""
    carriers = {int(m.body_weldid[m.body_parentid[b]]) for b in range(1, m.nbody) if m.body_jntnum[b]}
    roots = {b for b in range(1, m.nbody) if m.body_jntnum[b] and int(m.jnt_type[m.body_jntadr[b]]) == FREE}
    return {b for b in range(1, m.nbody) if int(m.body_rootid[b]) in roots and int(m.body_weldid[b]) not in carriers}


def _meets(m: Any, g: int, ground: int | None) -> bool:
    """Whether the bits of a geom let it collide with the ground, or, without a ground, with any geom."""
    kind, with_ = int(m.geom_contype[g]), int(m.geom_conaffinity[g])
    if ground is None:
        return bool(kind or with_)
    return bool(kind & int(m.geom_conaffinity[ground]) or int(m.geom_contype[ground]) & with_)


def _spheres(m: Any, g: int, up: Array) -> Iterator[tuple[Array, float]]:
    """(centre in the body's frame, radius) of the spheres that replace a geom; ``up`` is in the body's frame."""
    import mujoco

    kind, size = mujoco.mjtGeom(int(m.geom_type[g])), floats_of(m.geom_size[g])
    X = pose_of(m.geom_pos[g], m.geom_quat[g])
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        yield X[:3, 3], size[0]
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        for end in (-1.0, 1.0):
            yield X[:3, 3] + end * size[1] * X[:3, 2], size[0]
    elif kind == mujoco.mjtGeom.mjGEOM_BOX:
        signs = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)], float)
        corners = X[:3, 3] + (signs * size) @ X[:3, :3].T
        for k in np.argsort(corners @ up, kind="stable")[:4]:
            yield corners[k], 0.0


# --- what has no counterpart ----------------------------------------------------------------------------------


def _left_out(m: Any, tree: Tree) -> Iterator[str]:
    """Notes on all other parts of the file."""
    import mujoco

    def joints(values: Any) -> str:
        return quoted((tree.joint_of[j] for j in range(m.njnt) if np.any(values[j])), MOST)

    if np.any(m.jnt_stiffness):
        yield f"springs of joints {joints(m.jnt_stiffness)} are left out: a torque of the caller's has them"
    for field, what in (("jnt_stiffnesspoly", "springs"), ("dof_dampingpoly", "damping")):
        values = getattr(m, field, None)
        if values is not None and np.any(values):
            yield f"{what} that {'are' if what == 'springs' else 'is'} no straight line ({field}) is left out"
    if np.any(m.body_gravcomp):
        held = [tree.link_of[b] for b in range(m.nbody) if m.body_gravcomp[b]]
        yield f"gravity compensation of {quoted(held, MOST)} is left out: generalized_gravity is its torque"
    if m.ntendon:
        inert = " (which is a part of MuJoCo's M)" if np.any(getattr(m, "tendon_armature", 0.0)) else ""
        springs = "armature" + inert if inert else "springs, limits and damping"
        names = [name_of(m, mujoco.mjtObj.mjOBJ_TENDON, k) or f"tendon{k}" for k in range(m.ntendon)]
        yield f"tendons {quoted(names, MOST)} have no counterpart, with their {springs}"
    if m.opt.density or m.opt.viscosity:
        yield f"the medium, of density {m.opt.density:g} and viscosity {m.opt.viscosity:g}, has no counterpart"
    mocap = [tree.link_of[b] for b in range(m.nbody) if m.body_mocapid[b] >= 0]
    if mocap:
        yield f"mocap bodies {quoted(mocap, MOST)} stand still"
    if m.nkey:
        keys = [name_of(m, mujoco.mjtObj.mjOBJ_KEY, k) or f"key{k}" for k in range(m.nkey)]
        yield f"keyframes {quoted(keys, MOST)} are left out: from_mujoco(model, mjmodel.key_qpos[k], ...) converts one"
    counts = {"sensors": m.nsensor, "cameras": m.ncam, "lights": m.nlight, "plugins": m.nplugin,
              "flexible bodies": getattr(m, "nflex", 0), "skins": m.nskin, "height fields": m.nhfield,
              "pairs and exclusions of contacts": m.npair + m.nexclude}  # fmt: skip
    listed = [f"{count} {what}" for what, count in counts.items() if count]
    if listed:
        yield f"left out: {', '.join(listed)}"
    if m.ngeom:
        yield f"shapes of {m.ngeom} geoms are not kept: bodies have no shapes here"
