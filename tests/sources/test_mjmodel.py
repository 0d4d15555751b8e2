"""MJCF through MuJoCo's compiled model: its own M, bias and accelerations, names, and what its file declares."""

from __future__ import annotations

import pickle
import re
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import against_mujoco
import numpy as np
import pytest

import spatialdyn as sd

mujoco = pytest.importorskip("mujoco")
BOX = '<geom type="box" size=".1 .2 .3" pos=".1 .05 .2" mass="1.5" euler="20 10 30"/>'
CHAIN = f"""<mujoco model="chain"><option gravity="0.5 1 -3"/><worldbody>
  <site name="mark" pos="1 2 3"/>
  <body name="hinged" pos="0 0 1" euler="10 20 30">
    <joint axis="0 1 1" ref="20" pos=".1 .2 0" armature=".3"/>{BOX}
    <body pos="0 0 1"><joint name="ball" type="ball" pos=".1 0 .2" armature=".1"/>{BOX}
      <site name="hinged" pos="0 .1 .2" euler="0 90 0"/><site/>
      <body name="two" pos="0 0 1" euler="5 6 7">
        <joint name="slide" type="slide" axis="1 1 0" ref=".3"/>
        <joint name="turn" axis="0 0 1" pos=".1 .2 0" range="-30 60" damping="2" frictionloss=".5"/>
        <joint name="last" axis="0 1 0"/>{BOX}
      </body>
    </body>
    <body name="welded" pos="1 0 0" euler="0 0 45">{BOX}</body>
  </body>
  <body name="a top" pos="0 2 0"><joint name="geared"/>{BOX}</body>
  <body name="free" pos="1 1 1" euler="0 10 0"><freejoint/>{BOX}</body>
</worldbody>
<actuator>
  <motor name="push" joint="geared" gear="4" ctrlrange="-2 3" armature="0.02"/>
  <position name="servo" joint="turn" kp="30" kv="2" forcerange="-7 7"/>
</actuator>
<keyframe><key name="home"/></keyframe></mujoco>"""
BASE = """<mujoco model="base"><worldbody><body name="base_link">
  <joint name="joint_x" type="slide" axis="1 0 0"/><joint name="joint_y" type="slide" axis="0 1 0"/>
  <joint name="joint_th"/>
  <geom type="box" size=".25 .2 .1" pos=".02 .01 .2" mass="60"/></body></worldbody></mujoco>"""
WALKER = """<mujoco model="walker"><worldbody>{ground}
  <body name="trunk" pos="0 0 .6"><freejoint/><geom type="box" size=".2 .1 .05" mass="5"/>
    <body name="left" pos="0 .1 0"><joint name="lh" axis="0 1 0"/>
      <geom name="foot" type="sphere" size=".03" pos="0 0 -.3" mass=".2" friction=".6"/></body>
    <body name="right" pos="0 -.1 0"><joint name="rh" axis="0 1 0"/>
      <geom type="box" size=".05 .03 .02" pos="0 0 -.3" mass=".2" friction=".6"/>
      <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.2" mass=".1" contype="2" conaffinity="2"/></body>
  </body></worldbody></mujoco>"""
GROUND = '<geom type="plane" size="5 5 .1" pos="0 0 .1" friction=".9"/>'
LINK = """<body name="{name}" pos="{x} 0 0"><joint name="{name}_joint" axis="0 0 1" ref="{ref}"/>
  <inertial pos="{half} 0 0" mass="{length}" diaginertia="1e-3 1e-3 1e-3"/>{inside}</body>"""


def compiled(text: str) -> Any:
    return mujoco.MjModel.from_xml_string(text)


def four_bar(equalities: str, ref: float = 0.0) -> str:
    """A crank with a coupler, and a rocker, in degrees."""

    def body(name: str, x: float, length: float, inside: str = "") -> str:
        return LINK.format(name=name, x=x, half=length / 2, length=length, inside=inside, ref=ref)

    coupler = body("coupler", 0.2, 0.5, '<site name="tip" pos="0.5 0 0" euler="0 0 60"/>')
    bodies = body("crank", 0.0, 0.2, coupler) + body("rocker", 0.5, 0.4, '<site name="end" pos="0.4 0 0"/>')
    return f"<mujoco><worldbody>{bodies}</worldbody><equality>{equalities}</equality></mujoco>"


@pytest.mark.parametrize("text", [CHAIN, BASE, WALKER.format(ground=GROUND), four_bar("", ref=25.0)])
def test_mass_matrix_bias_and_accelerations_are_mujocos(text: str) -> None:
    m = compiled(text)
    model = sd.from_mjmodel(m)
    found = against_mujoco.errors(against_mujoco.without_passive(m), model)
    assert max(found.values()) < against_mujoco.RELATIVE, found


def test_the_bias_of_tidybots_base_is_the_rounding_of_its_weight() -> None:
    """At rest no joint bears any of 590 N: what is not 0 is rounding, which has no relative error."""
    m = compiled(BASE)
    model = sd.from_mjmodel(m)
    for q in np.random.default_rng(1).normal(size=(20, 3)):
        weight = 60 * 9.81
        assert abs(sd.nonlinear_effects(model, q, np.zeros(3))).max() < 1e-15 * weight
    assert (model.total_mass, model.nv) == (60.0, 3)


def test_frames_are_where_mujoco_has_bodies_and_sites() -> None:
    m = compiled(CHAIN)
    model, data = sd.from_mjmodel(m), mujoco.MjData(compiled(CHAIN))
    qpos = m.qpos0.copy()
    mujoco.mj_integratePos(m, qpos, np.random.default_rng(3).normal(size=m.nv), 1.0)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(m, data)
    q, _ = sd.from_mujoco(model, qpos, np.zeros(m.nv))
    assert model.names[1:] == ("hingedJoint_0", "ball", "slide", "turn", "last", "geared", "free_free")
    for name, p, R in (
        *((x, data.body(x).xpos, data.body(x).xmat) for x in ("two", "welded", "a top", "free")),
        ("link:hinged", data.body("hinged").xpos, data.body("hinged").xmat),
        ("link:hinged_", data.site("hinged").xpos, data.site("hinged").xmat),
        ("mark", data.site("mark").xpos, data.site("mark").xmat),
        ("body2", data.xpos[2], data.xmat[2]),
        ("body2Site_1", data.site_xpos[2], data.site_xmat[2]),
    ):
        X = sd.frame_placement(model, q, name)
        assert abs(X[:3, 3] - p).max() < 1e-14, name
        assert abs(X[:3, :3] - R.reshape(3, 3)).max() < 1e-14, name
    assert any('frame "hinged" is called "hinged_"' in note for note in model.notes)


def test_numbers_of_joints_are_those_of_the_file() -> None:
    model = sd.from_mjmodel(compiled(CHAIN))
    assert model.gravity.tolist() == [0.5, 1.0, -3.0]
    turn, geared = model.joint("turn"), model.joint("geared")
    assert np.allclose(np.rad2deg([model.lower[turn.idx_q], model.upper[turn.idx_q]]), [-30, 60])
    assert (model.damping[turn.idx_v], model.friction[turn.idx_v], model.effort_limit[turn.idx_v]) == (2.0, 0.5, 7.0)
    assert model.effort_limit[geared.idx_v] == 12.0  # gear times the larger end of ctrlrange
    assert model.armature[geared.idx_v] == pytest.approx(16 * 0.02)
    assert model.armature[: 1 + 3].tolist() == [0.3, 0.1, 0.1, 0.1]
    gears = sd.read_transmissions(model)
    assert [(x.joints, x.actuators, x.matrix.tolist()) for x in gears] == [
        (("geared",), ("push",), [[0.25]]), (("turn",), ("servo",), [[1.0]])
    ]  # fmt: skip
    floating = sd.from_mjmodel(compiled(BASE), root="floating", gravity=(0, 0, -1))
    assert (floating.nv, floating.gravity[2], floating.total_mass) == (9, -1.0, 60.0)
    with pytest.raises(sd.ModelError, match='root is "floating" and the file has the free joint "free_free"'):
        sd.from_mjmodel(compiled(CHAIN), root="floating")
    still = compiled('<mujoco><option><flag gravity="disable"/></option></mujoco>')
    assert sd.from_mjmodel(still).gravity.tolist() == [0.0, 0.0, 0.0]


def test_notes_list_what_has_no_counterpart() -> None:
    """Each thing of a file that no Model holds; a file with nothing of the kind has no note."""
    body = '<body{more}><joint name="j" {joint}/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
    cases = {
        'springs of joints "j" are left out': (body.format(more="", joint='stiffness="3"'), ""),
        'gravity compensation of "body1"': (body.format(more=' gravcomp="1"', joint=""), ""),
        'mocap bodies "moved" stand still': ('<body name="moved" mocap="true"/>', ""),
        "left out: 1 sensors": (body.format(more="", joint=""), '<sensor><jointpos joint="j"/></sensor>'),
        "the medium, of density 1000": (body.format(more="", joint=""), '<option density="1000"/>'),
        'tendons "t" have no counterpart': (
            body.format(more="", joint=""), '<tendon><fixed name="t"><joint joint="j" coef="1"/></fixed></tendon>'
        ),
        'keyframes "k" are left out': (body.format(more="", joint=""), '<keyframe><key name="k"/></keyframe>'),
        'equality joint "e" holds joint "j" at a number': (
            body.format(more="", joint=""), '<equality><joint name="e" joint1="j"/></equality>'
        ),
        'actuator "a": position servos, kp 3 and kv 0, left out': (
            body.format(more="", joint=""), '<actuator><position name="a" joint="j" kp="3"/></actuator>'
        ),
        "actuator \"a\": have states of their own": (
            body.format(more="", joint=""),
            '<actuator><general name="a" joint="j" dyntype="integrator" actlimited="true" actrange="-1 1"/></actuator>',
        ),
    }  # fmt: skip
    for wanted, (inside, rest) in cases.items():
        notes = sd.from_mjmodel(compiled(f"<mujoco><worldbody>{inside}</worldbody>{rest}</mujoco>")).notes
        assert [x for x in notes if wanted in x], (wanted, notes)
    plain = f"<mujoco><worldbody>{body.format(more='', joint='')}</worldbody></mujoco>"
    assert sd.from_mjmodel(compiled(plain)).notes == ()


# --- what acts --------------------------------------------------------------------------------------------


def same_rows(J: Any, K: Any) -> bool:
    """Whether two matrices have one row space."""
    K = K[abs(K).max(axis=1) > 1e-12]
    ranks = [np.linalg.matrix_rank(x, tol=1e-9) for x in (J, K, np.vstack([J, K]))]
    return len({*ranks}) == 1 and ranks[0] > 0


@pytest.mark.parametrize(
    "equality",
    [
        '<connect name="pin" body1="coupler" body2="rocker" anchor="0.5 0 0"/>',
        '<connect body1="coupler" anchor="0.5 0 0"/>',
        '<connect body1="world" body2="coupler" anchor="0.5 0.1 0"/>',
        '<connect site1="tip" site2="end"/>',
        '<weld body1="coupler" body2="rocker"/>',
        '<weld body1="rocker" body2="coupler" relpose="0.3 0.2 0 0.6 0 0 0.8"/>',
        '<weld body1="world" body2="rocker" relpose="0.5 0 0 0.6 0 0 0.8"/>',
        '<weld site1="tip" site2="end"/>',
        '<joint joint1="rocker_joint" joint2="crank_joint" polycoef="0.3 -2 0 0 0"/>',
    ],
)
@pytest.mark.parametrize("ref", [0.0, 25.0])
def test_equalities_act_in_the_scene_as_in_mujoco(equality: str, ref: float) -> None:
    """Where the scene's constraints close, MuJoCo's are closed, and both matrices span the same."""
    m = compiled(four_bar(equality, ref))
    model, data = sd.from_mjmodel(m), mujoco.MjData(m)
    held = sd.Scene.of(model).constraints
    for start in ([0.3, 0.4, 0.5], [0.0, 0.0, 0.0], *np.random.default_rng(0).uniform(-2.0, 2.0, (20, 3))):
        q = m.qpos0 + start
        try:
            q = sd.close_loops(model, held, q)
        except sd.ConstraintError:
            continue  # what does not close from here
        data.qpos[:] = q
        mujoco.mj_forward(m, data)
        assert abs(data.efc_pos).max() < 1e-9
        assert same_rows(sd.constraint_jacobian(model, held, q), np.reshape(data.efc_J, (-1, m.nv)))
        return
    pytest.fail("no configuration closes it")


def test_couplers_are_mimic_joints() -> None:
    text = four_bar('<joint joint1="rocker_joint" joint2="crank_joint" polycoef="0.3 -2"/>')
    model = sd.from_mjmodel(compiled(text), mimic=True)
    assert (model.nv, model.joint("rocker_joint").mimic) == (2, (1, -2.0, 0.3))
    twice = text.replace("</equality>", '<joint joint1="rocker_joint" joint2="coupler_joint"/></equality>')
    scene = sd.Scene.of(sd.from_mjmodel(compiled(twice)))
    assert [x.to for x in scene.constraints] == ["crank_joint", "coupler_joint"]


def test_feet_touch_the_ground_of_the_file() -> None:
    model = sd.from_mjmodel(compiled(WALKER.format(ground=GROUND)))
    contacts = sd.Scene.of(model).contacts
    assert contacts.terrain == sd.Plane(height=0.1)
    assert (len(contacts), contacts.radii, {*contacts.friction.tolist()}) == (5, (0.03, 0, 0, 0, 0), {0.9})
    lowest = sd.frame_placement(model, sd.neutral(model), "right_geom3_contact0")[2, 3]
    assert lowest == pytest.approx(-0.32)
    resting = sd.simulate(sd.Scene.of(sd.from_mjmodel(compiled(BALL))), [0, 0, 0.5, 0, 0, 0, 1], np.zeros(6), 1.0, 0.01)
    assert resting.q[-1, 2] == pytest.approx(0.2, abs=1e-6)


BALL = f"""<mujoco><worldbody>{GROUND}<body><freejoint/><geom type="sphere" size=".1"/></body></worldbody></mujoco>"""


def test_a_ball_foot_stands_for_its_leg() -> None:
    """A shank or a box beside a sphere would be points that seldom touch, at the cost of those that do."""
    shank = '<geom name="shank" type="capsule" size=".02" fromto="0 0 0 0 0 -.2" mass=".1"/><geom name="foot"'
    model = sd.from_mjmodel(compiled(WALKER.format(ground=GROUND).replace('<geom name="foot"', shank)))
    assert sd.Scene.of(model).contacts.names[0] == "link:foot_contact"
    assert len(sd.Scene.of(model).contacts) == 5
    assert 'shapes "shank" of last bodies touch nothing: others stand for those bodies' in model.notes


def test_feet_without_a_ground_are_a_note() -> None:
    model = sd.from_mjmodel(compiled(WALKER.format(ground="")))
    assert sd.Scene.of(model).contacts is None
    (note,) = [x for x in model.notes if "has no ground" in x]
    points = re.search(r"sd\.Contacts\(model, (\{.*?)(, \.\.\.)?\}\)", note)[1] + "}"
    assert len(sd.Contacts(model, eval(points))) == 3  # the note is a line to write; where nothing is, all may touch


def test_dc_motors_of_every_joint_act_in_the_scene() -> None:
    if not hasattr(mujoco.mjtGain, "mjGAIN_DCMOTOR"):
        pytest.skip("MuJoCo has DC motors since 3.7")
    motor = '<dcmotor joint="{}" gear="50" motorconst="0.05" resistance="1.2" saturation="1 2 24"/>'
    joints = ("crank_joint", "coupler_joint", "rocker_joint")
    text = four_bar("").replace("</mujoco>", f"<actuator>{''.join(map(motor.format, joints))}</actuator></mujoco>")
    made = sd.Scene.of(sd.from_mjmodel(compiled(text))).motor
    assert made == sd.Motor([0.05] * 3, 1.2, 24.0, ratio=50.0)
    some = four_bar("").replace("</mujoco>", f"<actuator>{motor.format(joints[0])}</actuator></mujoco>")
    model = sd.from_mjmodel(compiled(some))
    assert sd.Scene.of(model).motor is None
    assert any(x.startswith("DC motors") for x in model.notes)


def test_what_is_declared_goes_with_the_model() -> None:
    text = four_bar('<connect body1="coupler" body2="rocker" anchor="0.5 0 0"/>')
    model = sd.from_mjmodel(compiled(text))
    for other in (pickle.loads(pickle.dumps(model)), model.with_(gravity=(0, 0, 0)), model.reduced(["coupler_joint"])):
        assert sd.Scene.of(other).constraints.nc == 3
    still = model.reduced(["coupler_joint", "crank_joint", "rocker_joint"])
    assert sd.Scene.of(still).constraints is None
    assert sd.Scene.of(model.subtree("coupler")).acts == ()


def test_other_values_are_refused() -> None:
    with pytest.raises(sd.SpatialDynError, match=r"mjmodel is a str, expected a mujoco\.MjModel or MjSpec"):
        sd.from_mjmodel("<mujoco/>")
    spec = mujoco.MjSpec()
    spec.worldbody.add_body().add_joint()
    with pytest.raises(sd.SpatialDynError, match="MjSpec does not compile"):
        sd.from_mjmodel(spec)
    good = mujoco.MjSpec.from_string(BASE)
    assert sd.from_mjmodel(good) == sd.from_mjmodel(compiled(BASE))


# --- whole collections ------------------------------------------------------------------------------------


def collection() -> Iterator[tuple[str, Any]]:
    """(name, MjModel) of every robot of the MuJoCo Menagerie, or of dm-control where it cannot be downloaded."""
    menagerie = pytest.importorskip("mujoco_menagerie")
    try:
        for robot in map(menagerie.get, menagerie.names()):
            for entry in robot.entry_names:
                yield f"{robot.name}/{entry}", robot.model(entry)
    except menagerie.DownloadError:
        spec = find_spec("dm_control")
        if spec is None or spec.origin is None:
            pytest.skip("neither the network for mujoco_menagerie nor dm-control is here")
        for path in sorted(Path(spec.origin).parent.rglob("*.xml")):
            try:
                yield path.name, mujoco.MjModel.from_xml_path(str(path))
            except ValueError:  # parts of models
                continue


@pytest.mark.slow(quick="test_mass_matrix_bias_and_accelerations_are_mujocos")
@pytest.mark.filterwarnings("ignore:robot ")
def test_every_model_of_the_menagerie_moves_as_in_mujoco() -> None:
    wrong, count = {}, 0
    for name, m in collection():
        if m.nv:
            found = against_mujoco.errors(against_mujoco.without_passive(m), sd.from_mjmodel(m), states=2)
            count += 1
            if max(found.values()) > against_mujoco.RELATIVE:
                wrong[name] = found
    assert wrong == {}
    assert count > 20
