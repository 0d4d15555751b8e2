"""``buildModelFromMJCF``: joints and frames named and ordered as the wheel's where it loads; MuJoCo's numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
import spatialdyn.compat.pinocchio as ours

mujoco = pytest.importorskip("mujoco")
GEOM = '<geom type="box" size=".1 .2 .3" mass="1.5" pos=".1 .05 .2"/>'
CENTRED = f"""<mujoco model="centred"><compiler angle="radian"/><worldbody><body name="base">{GEOM}
  <body name="b" pos="0 0 1" euler=".1 .2 .3"><joint axis="0 1 0" range="-1 2" damping="2" armature=".1"/>{GEOM}
    <site name="mark" pos="0 0 .1"/><site/>
    <body name="c" pos="0 0 1"><joint name="ball" type="ball"/>{GEOM}
      <body name="d" pos="1 0 0"><joint name="s1" type="slide" axis="1 0 0"/><joint name="s2" axis="1 1 0"/>{GEOM}
        <body name="e" pos=".1 0 0">{GEOM}</body></body></body></body>
  <body name="a" pos="0 1 0"><joint name="last" type="slide" axis="0 0 1" frictionloss=".3" ref=".2"/>{GEOM}</body>
</body></worldbody><keyframe><key name="home" qpos="1 .5 .5 .5 .5 .1 .2 .3"/></keyframe></mujoco>"""
FREE = f"""<mujoco model="free"><worldbody><body name="base" pos="0 0 1"><freejoint/>{GEOM}
  <body name="leg" pos="0 0 -.3"><joint name="hip" axis="0 -1 0"/>{GEOM}</body></body></worldbody></mujoco>"""
PLACED = (
    CENTRED.replace('name="ball" type="ball"', 'name="ball" type="ball" pos=".1 .2 .3"')
    .replace('axis="1 1 0"', 'axis="1 1 0" pos="0 .2 0"')
    .replace('type="slide" axis="1 0 0"', 'type="slide" axis="1 0 0" pos=".3 0 .1"')
    .replace('<body name="base">', '<body name="base" pos="0 0 1" euler="0 .3 0">')
)


@pytest.fixture
def file(tmp_path: Path) -> Any:
    def write(text: str) -> str:
        (tmp_path / "robot.xml").write_text(text, encoding="utf-8")
        return str(tmp_path / "robot.xml")

    return write


@pytest.mark.parametrize("text", [CENTRED, FREE])
def test_joints_and_frames_are_named_and_ordered_as_the_wheels(file: Any, text: str) -> None:
    theirs = pytest.importorskip("pinocchio")
    mine, other = ours.buildModelFromMJCF(file(text)), theirs.buildModelFromMJCF(file(text))
    assert (mine.name, mine.nq, mine.nv) == (other.name, other.nq, other.nv)
    assert list(mine.names) == list(other.names)
    assert list(mine.parents) == list(other.parents)
    assert [x.shortname() for x in mine.joints][1:] == [x.shortname() for x in other.joints][1:]
    described = [[(x.name, x.type.name, x.parentJoint, x.parentFrame) for x in m.frames] for m in (mine, other)]
    assert described[0] == described[1]
    for name in ("damping", "armature", "upperDryFrictionLimit"):
        assert getattr(mine, name) == pytest.approx(getattr(other, name)), name
    for one, two in zip(mine.frames, other.frames, strict=True):
        assert one.placement.homogeneous == pytest.approx(two.placement.homogeneous, abs=1e-12), one.name
    for one, two in zip(mine.inertias, other.inertias, strict=True):
        assert one.mass == pytest.approx(two.mass)
    for entry in other.referenceConfigurations:
        assert mine.referenceConfigurations[entry.key()] == pytest.approx(entry.data()), entry.key()


def test_damping_and_friction_of_a_ball_are_mujocos_where_the_wheel_leaves_them_out(file: Any) -> None:
    theirs = pytest.importorskip("pinocchio")
    text = CENTRED.replace('type="ball"', 'type="ball" damping=".5" frictionloss=".1"')
    mine, other = ours.buildModelFromMJCF(file(text)), theirs.buildModelFromMJCF(file(text))
    compiled = mujoco.MjModel.from_xml_string(text)
    ball = mine.joints[mine.getJointId("ball")]
    at = slice(ball.idx_v, ball.idx_v + 3)
    assert (compiled.joint("ball").damping == 0.5).all()
    assert (mine.damping[at] == 0.5).all()
    assert (mine.upperDryFrictionLimit[at] == 0.1).all()
    assert not other.damping[at].any()
    assert not other.upperDryFrictionLimit[at].any()
    assert any("frictionloss of a ball" in x.what for x in ours.differences())


@pytest.mark.parametrize("text", [CENTRED, FREE, PLACED])
def test_numbers_are_mujocos(file: Any, text: str) -> None:
    """Of joints that stand apart from their body's frame too, whose places the wheel leaves out."""
    mine, lib = ours.buildModelFromMJCF(file(text)), sd.load(text)
    data = mine.createData()
    for q in (sd.random_configuration(lib, k) for k in range(3)):
        v = np.arange(1.0, lib.nv + 1)
        M = ours.crba(mine, data, q)
        assert np.triu(M) == pytest.approx(np.triu(sd.crba(lib, q)), abs=1e-12 * abs(M).max())
        bias = sd.nonlinear_effects(lib, q, v)
        assert ours.nonLinearEffects(mine, data, q, v) == pytest.approx(bias, abs=1e-12 * abs(bias).max())
    ours.framesForwardKinematics(mine, data, q)
    for name in ("base", "leg") if text == FREE else ("mark", "c", "d", "e"):
        X = data.oMf[mine.getFrameId(name)].homogeneous
        assert pytest.approx(sd.frame_placement(lib, q, name), abs=1e-12) == X


def test_keyframes_are_reference_configurations(file: Any) -> None:
    model = ours.buildModelFromMJCF(file(CENTRED))
    assert model.referenceConfigurations["home"].tolist() == [1, 0.5, 0.5, 0.5, 0.5, 0.1, 0.2, 0.3]
    assert model.referenceConfigurations["qpos0"].tolist() == [0, 0, 0, 0, 1, 0, 0, 0.2]
    assert ours.buildModelFromMJCF(file(FREE)).referenceConfigurations["qpos0"].tolist() == [0, 0, 1, 0, 0, 0, 1, 0]


def test_a_root_joint_carries_the_world(file: Any) -> None:
    model = ours.buildModelFromMJCF(file(CENTRED), ours.JointModelFreeFlyer())
    assert list(model.names)[:3] == ["universe", "root_joint", "bJoint_0"]
    assert ours.computeTotalMass(model) == pytest.approx(6 * 1.5)
    with pytest.raises(sd.SpatialDynError, match='root_joint is given and the file has the free joint "base_free"'):
        ours.buildModelFromMJCF(file(FREE), ours.JointModelFreeFlyer())
    with pytest.raises(TypeError, match="mjcf_filename is"):
        ours.buildModelFromMJCF(5)
    with pytest.raises(sd.SpatialDynError, match="MuJoCo refuses it"):
        ours.buildModelFromMJCF(file("<mujoco><nothing/></mujoco>"))


SHAPES = """<mujoco model="shapes"><compiler angle="radian"/><asset><material name="red" rgba="1 0 0 1"/>
  <mesh name="tetrahedron" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset><worldbody>
  <geom type="plane" size="1 1 .1"/><body name="base"><geom name="one" type="box" size=".1 .2 .3" pos=".1 0 .2"/>
  <body name="b" pos="0 0 1" euler=".1 .2 .3"><joint name="j" axis="0 1 0"/>
    <geom type="sphere" size=".1" contype="0" conaffinity="0" material="red" pos="0 .1 0"/>
    <geom type="capsule" size=".1 .2" group="3" rgba="0 1 0 .5" euler="0 .3 0"/>
    <geom type="cylinder" size=".1 .4"/><geom type="ellipsoid" size=".1 .2 .3"/>
    <body name="c" pos="0 0 1"><joint name="k" axis="1 0 0"/><geom type="box" size=".1 .1 .1"/></body></body>
  </body></worldbody>
  <equality><connect name="loop" body1="c" body2="b" anchor="0 .2 .1"/><weld body1="c" relpose="1 2 3 1 0 0 0"/>
    <connect body1="c" anchor="0 0 0" active="false"/></equality></mujoco>"""


def test_geoms_are_the_wheels_objects(file: Any) -> None:
    theirs = pytest.importorskip("pinocchio")
    pytest.importorskip("coal")
    path = file(SHAPES)
    mine, other = (pin.RobotWrapper.BuildFromMJCF(path) for pin in (ours, theirs))
    for kind, count in (("collision_model", 6), ("visual_model", 6)):
        found, wanted = (getattr(x, kind).geometryObjects for x in (mine, other))
        assert len(found) == len(wanted) == count
        for one, two in zip(found, wanted, strict=True):
            for name in ("name", "parentJoint", "parentFrame", "meshPath", "overrideMaterial", "geometry"):
                assert getattr(one, name) == getattr(two, name), (two.name, name)
            assert one.placement.homogeneous == pytest.approx(two.placement.homogeneous, abs=1e-12), two.name
    assert [x.meshColor.tolist() for x in mine.visual_model.geometryObjects][2] == [1.0, 0.0, 0.0, 1.0]


def test_connects_and_welds_are_contacts(file: Any) -> None:
    """Placed as MuJoCo places them: where bodies stand still at the configuration of the file, both ends meet."""
    model, contacts, *rest = ours.buildModelsFromMJCF(file(SHAPES))
    assert len(rest) == 2
    assert [(x.name, x.type.name, x.joint1_id, x.joint2_id) for x in contacts] == [
        ("loop", "CONTACT_3D", 2, 1), ("", "CONTACT_6D", 2, 0),
    ]  # fmt: skip
    data, loop = model.createData(), contacts[0]
    ours.forwardKinematics(model, data, ours.neutral(model))
    ends = [data.oMi[loop.joint1_id] * loop.joint1_placement, data.oMi[loop.joint2_id] * loop.joint2_placement]
    assert ends[0].translation == pytest.approx(ends[1].translation, abs=1e-12)
    assert contacts[1].joint1_placement.translation.tolist() == [1.0, 2.0, 3.0]
    assert len(ours.buildModelsFromMJCF(file(SHAPES), contacts=False)) == 3
    named = ours.buildModelFromMJCF(file(SHAPES), ours.JointModelFreeFlyer(), "base")
    assert (named[0].names[1], len(named[1])) == ("base", 2)


def test_a_mesh_is_the_triangles_that_mujoco_compiled(file: Any) -> None:
    pytest.importorskip("coal")
    text = SHAPES.replace('<geom type="cylinder" size=".1 .4"/>', '<geom type="mesh" mesh="tetrahedron" name="m"/>')
    model, _, shapes, _ = ours.buildModelsFromMJCF(file(text))
    at = shapes.geometryObjects[shapes.getGeometryId("m")]
    corners = at.geometry.vertices() @ at.placement.rotation.T + at.placement.translation
    assert abs(corners).max() == pytest.approx(1.0, abs=1e-6)  # MuJoCo keeps float32
    assert sorted(map(tuple, corners.round(6) + 0.0)) == [(0, 0, 0), (0, 0, 1), (0, 1, 0), (1, 0, 0)]
    assert at.meshPath == ""
    with pytest.raises(sd.ModelError, match='has no body "base", expected one built of this MJCF'):
        ours.buildGeomFromMJCF(ours.buildSampleModelManipulator(), file(text), ours.VISUAL)
    assert ours.buildGeomFromMJCF(model, file(text), ours.VISUAL).ngeoms == 6
