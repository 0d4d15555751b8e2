"""Geometry of URDFs, its placements, collisions and distances: those of the wheel, robot by robot."""

from __future__ import annotations

import copy
import importlib
import os
import pickle
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from robots import ROBOTS

import spatialdyn as sd
import spatialdyn.compat.pinocchio as ours
from spatialdyn.compat.pinocchio.coverage import coal_package, versions
from spatialdyn.compat.pinocchio.model.coal_shapes import Box, Capsule, Cylinder, MissingMeshError, Sphere
from spatialdyn.pictures.shapes import coal_triangles

theirs = pytest.importorskip("pinocchio", minversion="4.1")
coal = pytest.importorskip("coal")
SMALL = ["ur5_robot", "panda", "anymal_b_simple_description/anymal", "solo12", "hyq_no_sensors", "z1"]
LARGE = ["talos_full_v2", "tiago", "icub", "kinova", "baxter", "pr2", "double_pendulum", "allegro_right_hand"]
PLACED = 1e-12  # of placements, as asked: sums of rotations in another order
SEARCHED = 5e-6  # [m] of distances: GJK ends within 1e-6 of each shape, from another start
DRAWN = """<robot name="r"><material name="red"><color rgba="0.7 0 0 1"/></material>
<link name="a"><visual><geometry><box size="1 2 3"/></geometry><material name="red"/></visual>
<visual><origin xyz="0 0 1" rpy="0.1 0.2 0.3"/><geometry><cylinder radius="0.5" length="2"/></geometry>
<material name="own"><color rgba="0 1 0 0.5"/></material></visual>
<collision><geometry><sphere radius="1"/></geometry></collision></link>
<link name="b"><visual><origin xyz="0 0 1"/><geometry><mesh filename="package://tool/t.obj" scale="1 2 1"/></geometry>
<material name="own"><color rgba="0 0 1 1"/></material></visual>
<collision><geometry><sphere radius="0.25"/></geometry></collision></link><link name="c"><collision><geometry>
<box size="1 1 1"/></geometry></collision></link>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 2"/><axis xyz="0 1 0"/>
<limit effort="1" velocity="1" lower="-3" upper="3"/></joint>
<joint name="k" type="fixed"><parent link="b"/><child link="c"/><origin xyz="0 0 1.5"/></joint></robot>"""
MESH = "v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n"


@pytest.fixture
def drawn(tmp_path: Path) -> Path:
    """A URDF of boxes, a cylinder, spheres and a mesh in a package beside it."""
    (tmp_path / "tool").mkdir()
    (tmp_path / "tool" / "t.obj").write_text(MESH)
    path = tmp_path / "urdf" / "r.urdf"
    path.parent.mkdir()
    path.write_text(DRAWN)
    return path


def folder_of(path: Path) -> str:
    """What holds the packages of a robot of example-robot-data."""
    return str(next(x for x in path.parents if x.name == "example-robot-data").parent)


def assert_same_geometry(mine: Any, wheels: Any) -> None:
    assert mine.ngeoms == wheels.ngeoms
    for a, b in zip(mine.geometryObjects, wheels.geometryObjects, strict=True):
        for name in ("name", "parentJoint", "parentFrame", "overrideMaterial", "disableCollision"):
            assert getattr(a, name) == getattr(b, name), (b.name, name)
        for name in ("meshPath", "meshTexturePath"):
            assert os.path.normpath(getattr(a, name)) == os.path.normpath(getattr(b, name)), b.name
        for name in ("meshScale", "meshColor"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name), b.name)
        np.testing.assert_allclose(a.placement.homogeneous, b.placement.homogeneous, atol=PLACED, rtol=0.0)


def states(model: Any, count: int) -> list[Any]:
    rng, found = np.random.default_rng(3), [theirs.neutral(model)]
    low, high = (np.clip(x, -2.0, 2.0) for x in (model.lowerPositionLimit, model.upperPositionLimit))
    theirs.seed(3)
    while len(found) < count:
        found.append(theirs.randomConfiguration(model, low, np.maximum(high, low + 1e-3 * rng.uniform())))
    return found


def compare(name: str, count: int) -> None:
    """All of a robot: objects, placements, collisions and distances of all pairs."""
    path = ROBOTS[name]
    model, collision, visual = ours.buildModelsFromUrdf(str(path), folder_of(path))
    peer, wheels, seen = theirs.buildModelsFromUrdf(str(path), folder_of(path))
    assert_same_geometry(collision, wheels)
    assert_same_geometry(visual, seen)
    for geometry in (collision, wheels):
        geometry.addAllCollisionPairs()
    assert [(p.first, p.second) for p in collision.collisionPairs] == [
        (p.first, p.second) for p in wheels.collisionPairs
    ]
    data, its, geometry_data, others = (
        model.createData(),
        peer.createData(),
        collision.createData(),
        wheels.createData(),
    )
    for q in states(peer, count):
        mine = ours.computeCollisions(model, data, collision, geometry_data, q, False)
        assert mine == theirs.computeCollisions(peer, its, wheels, others, q, False)
        for a, b in zip(geometry_data.oMg, others.oMg, strict=True):
            np.testing.assert_allclose(a.homogeneous, b.homogeneous, atol=PLACED, rtol=0.0)
        assert [x.isCollision() for x in geometry_data.collisionResults] == [
            x.isCollision() for x in others.collisionResults
        ]
        nearest = ours.computeDistances(model, data, collision, geometry_data, q)
        theirs.computeDistances(peer, its, wheels, others, q)
        found, wanted = (np.array([x.min_distance for x in z.distanceResults]) for z in (geometry_data, others))
        np.testing.assert_allclose(found, wanted, atol=SEARCHED, rtol=0.0)
        assert wanted[nearest] <= wanted.min() + SEARCHED
        ours.updateGeometryPlacements(model, data, visual, seen_data := visual.createData())
        theirs.updateGeometryPlacements(peer, its, seen, there := seen.createData())
        for a, b in zip(seen_data.oMg, there.oMg, strict=True):
            np.testing.assert_allclose(a.homogeneous, b.homogeneous, atol=PLACED, rtol=0.0)


@pytest.mark.filterwarnings("ignore:robot .* has principal moments")
@pytest.mark.parametrize("name", SMALL)
def test_geometry_of_a_robot_is_the_wheels(name: str) -> None:
    compare(name, 2)


@pytest.mark.slow(quick="test_geometry_of_a_robot_is_the_wheels")
@pytest.mark.filterwarnings("ignore:robot ")
@pytest.mark.parametrize("name", LARGE)
def test_geometry_of_a_large_robot_is_the_wheels(name: str) -> None:
    compare(name, 2)


# --- what a URDF says ------------------------------------------------------------------------------------


def test_shapes_colours_and_names_are_read_as_the_wheel_reads_them(drawn: Path) -> None:
    folders = str(drawn.parents[1])
    built = [pin.buildModelsFromUrdf(str(drawn), folders, pin.JointModelFreeFlyer()) for pin in (ours, theirs)]
    for mine, wheels in zip(built[0][1:], built[1][1:], strict=True):
        assert_same_geometry(mine, wheels)
        for a, b in zip(mine.geometryObjects, wheels.geometryObjects, strict=True):
            assert type(a.geometry) is type(b.geometry)
            for name in ("halfSide", "radius", "halfLength", "num_vertices"):
                if hasattr(b.geometry, name):
                    np.testing.assert_array_equal(getattr(a.geometry, name), getattr(b.geometry, name))
    model = built[0][0]
    alone = ours.buildGeomFromUrdf(model, drawn, ours.GeometryType.VISUAL, folders)
    assert_same_geometry(alone, built[1][2])
    added = ours.buildGeomFromUrdf(model, str(drawn), ours.COLLISION, alone, package_dirs=[folders])
    assert added is alone
    assert [x.name for x in alone.geometryObjects] == ["a_0", "a_1", "b_0", "a_0", "b_0", "c_0"]
    text = ours.buildGeomFromUrdfString(model, DRAWN, ours.COLLISION)
    assert_same_geometry(text, built[1][1])


def test_a_mesh_that_is_not_found_is_an_error_when_it_is_needed(drawn: Path) -> None:
    (drawn.parents[1] / "tool" / "t.obj").unlink()
    model, _, visual = ours.buildModelsFromUrdf(drawn)
    lost = visual.geometryObjects[2]
    assert lost.meshPath == "package://tool/t.obj"
    with pytest.raises(MissingMeshError, match=r'the mesh package://tool/t\.obj of geometry object "b_0" is not found'):
        lost.geometry
    visual.addAllCollisionPairs()
    with pytest.raises(sd.ModelError, match="is not found"):
        ours.computeCollisions(model, model.createData(), visual, visual.createData(), np.zeros(1))


def test_links_that_the_model_does_not_have_are_named(drawn: Path) -> None:
    other = ours.buildSampleModelManipulator()
    with pytest.raises(sd.ModelError, match='has no link "a", expected one built of this URDF'):
        ours.buildGeomFromUrdf(other, drawn, ours.VISUAL)
    with pytest.raises(sd.UrdfError, match=r"document type .*expected none"):
        ours.buildGeomFromUrdfString(other, "<!DOCTYPE robot [<!ENTITY x 'y'>]>" + DRAWN, ours.VISUAL)
    with pytest.raises(TypeError, match="geom_type is a int"):
        ours.buildGeomFromUrdf(other, drawn, 3)


def test_copies_and_pickles_keep_shapes_and_are_independent(drawn: Path) -> None:
    _, collision, _ = ours.buildModelsFromUrdf(drawn)
    first = collision.geometryObjects[0]
    assert first.geometry.radius == 1.0
    for made in (collision.copy(), copy.deepcopy(collision), pickle.loads(pickle.dumps(collision))):
        one = made.geometryObjects[0]
        assert (one.name, one.geometry.radius) == ("a_0", 1.0)
        one.meshColor[:] = 0.0
        one.placement.translation[:] = 5.0
    assert first.meshColor.tolist() == [0.9, 0.9, 0.9, 1.0]
    assert first.placement.translation.tolist() == [0.0, 0.0, 0.0]
    first.geometry = coal.Sphere(2.0)
    assert first.copy().geometry.radius == 2.0


# --- pairs -----------------------------------------------------------------------------------------------


def test_lists_take_their_own_type_and_copies_are_equal(drawn: Path) -> None:
    model, _, visual = ours.buildModelsFromUrdf(drawn, str(drawn.parents[1]))
    for given, what in ((visual.geometryObjects, "GeometryObject"), (visual.collisionPairs, "CollisionPair")):
        for put in (given.append, lambda x, at=given: at.__setitem__(slice(0, 0), [x])):
            with pytest.raises(TypeError, match=f"a int was given, expected {what}"):
                put(3)
    with pytest.raises(TypeError, match="a int was given, expected SE3"):
        visual.createData().oMg[0] = 3
    box = ours.GeometryObject("box", 0, ours.SE3.Identity(), coal.Box(1.0, 2.0, 3.0))
    at = visual.addGeometryObject(box)
    assert visual.geometryObjects[at] == box
    box.placement.translation[0] = 1.0  # of the one given, not of the model's copy, as in Pinocchio
    assert visual.geometryObjects[at] != box
    visual.geometryObjects[at].placement.translation[1] = 2.0
    assert visual.geometryObjects[at].placement.translation.tolist() == [0.0, 2.0, 0.0]
    again = visual.copy()
    assert again == visual
    again.geometryObjects[0].meshColor[0] = 0.25
    assert again != visual
    path = str(drawn.parents[1])
    printed, wanted = (str(pin.buildModelsFromUrdf(str(drawn), path)[2]) for pin in (ours, theirs))
    assert printed.split() == wanted.split()
    visual.geometryObjects[0].parentJoint = 9
    with pytest.raises(sd.ModelError, match='geometry object "a_0" is on joint 9, expected one of the model, from 0'):
        ours.updateGeometryPlacements(model, model.createData(), visual, visual.createData(), np.zeros(1))


def test_an_se3_is_made_of_coals_own_transform() -> None:
    X = ours.SE3.Random()
    assert ours.SE3(coal.Transform3s(X.rotation, X.translation)).isApprox(X)


def test_a_height_field_is_drawn_upwards_and_a_cloud_of_points_is_not() -> None:
    heights = np.array([[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]])
    found = coal_triangles(coal.HeightFieldOBBRSS(2.0, 1.0, heights, 0.0))
    assert found is not None
    points, faces = found
    assert points[:, 2].tolist() == heights.ravel().tolist()
    a, b, c = (points[faces[:, k]] for k in range(3))
    upwards = np.cross(b - a, c - a)[:, 2]
    assert (upwards > 0.0).all()
    assert 0.5 * upwards.sum() == pytest.approx(2.0)  # the area of the grid
    cloud = coal.BVHModelOBBRSS()
    cloud.beginModel(0, 4)
    cloud.addVertices(np.eye(4)[:, :3])
    cloud.endModel()
    assert coal_triangles(cloud) is None


def test_pairs_of_links_that_an_srdf_names_are_removed(drawn: Path, tmp_path: Path) -> None:
    srdf = tmp_path / "r.srdf"
    srdf.write_text(
        '<robot name="r"><disable_collisions link1="b" link2="a"/><disable_collisions link1="a" link2="gone"/>'
        '<disable_collisions link1="c" link2="c"/></robot>'
    )
    left = []
    for pin in (ours, theirs):
        model, collision, _ = pin.buildModelsFromUrdf(str(drawn), str(drawn.parents[1]))
        collision.addAllCollisionPairs()
        pin.removeCollisionPairs(model, collision, str(srdf))
        left.append([(x.first, x.second) for x in collision.collisionPairs])
    assert left[0] == left[1] == [(0, 2)]
    collision = ours.buildGeomFromUrdf(model := ours.buildModelFromUrdf(drawn), drawn, ours.COLLISION)
    collision.addAllCollisionPairs()
    ours.removeCollisionPairsFromXML(model, collision, srdf.read_text())
    assert len(collision.collisionPairs) == 1


def test_maps_of_pairs_margins_and_flags_are_the_wheels(drawn: Path) -> None:
    said = []
    for pin in (ours, theirs):
        model, collision, _ = pin.buildModelsFromUrdf(str(drawn), str(drawn.parents[1]))
        wanted = np.zeros((3, 3), bool)
        wanted[0, 1] = wanted[0, 2] = True
        collision.setCollisionPairs(wanted)
        seen: list[Any] = [collision.collisionPairMapping.tolist()]
        data = collision.createData()
        margins = np.zeros((3, 3))
        margins[0, 1], margins[0, 2] = 0.9, 0.1
        data.setSecurityMargins(collision, margins)
        seen += [[x.security_margin for x in data.collisionRequests]]
        data.collisionRequests.enable_contact = True  # of the list, which scripts do and Pinocchio accepts
        q = np.array([0.3])
        pin.computeCollisions(model, model.createData(), collision, data, q, False)
        seen += [[x.isCollision() for x in data.collisionResults]]
        data.setActiveCollisionPairs(collision, np.array(margins > 0.5))
        seen += [list(data.activeCollisionPairs)]
        data.setGeometryCollisionStatus(collision, 2, True)
        seen += [list(data.activeCollisionPairs)]
        seen += [pin.computeCollision(collision, data, 0), pin.computeDistance(collision, data, 1).min_distance]
        collision.geometryObjects[1].disableCollision = True
        data.setSecurityMargins(collision, 0.0 * margins + 5.0)
        seen += [pin.computeCollisions(collision, data, True)]
        said.append(seen)
    assert said[0] == said[1]


def test_reduced_models_keep_their_geometry() -> None:
    path = ROBOTS["panda"]
    built = []
    for pin in (ours, theirs):
        model, collision, visual = pin.buildModelsFromUrdf(str(path), folder_of(path))
        collision.addAllCollisionPairs()
        q = pin.neutral(model) + 0.1
        built.append(pin.buildReducedModel(model, [collision, visual], [2, 4, 8, 9], q))
        _, alone = pin.buildReducedModel(model, visual, [2, 4, 8, 9], q)
        assert alone.ngeoms == visual.ngeoms
    for mine, wheels in zip(built[0][1], built[1][1], strict=True):
        assert_same_geometry(mine, wheels)
        assert len(mine.collisionPairs) == len(wheels.collisionPairs)
    robots = [pin.RobotWrapper.BuildFromURDF(str(path), folder_of(path)) for pin in (ours, theirs)]
    made = [x.buildReducedRobot(["panda_joint2", "panda_finger_joint1"]) for x in robots]
    assert_same_geometry(made[0].collision_model, made[1].collision_model)
    assert_same_geometry(made[0].visual_model, made[1].visual_model)
    for x in made:
        x.updateGeometryPlacements(x.q0)
        x.updateGeometryPlacements(x.q0, visual=True)
    for a, b in zip(made[0].visual_data.oMg, made[1].visual_data.oMg, strict=True):
        np.testing.assert_allclose(a.homogeneous, b.homogeneous, atol=PLACED)
    with pytest.raises(RuntimeError, match="the robot has no collision_model"):
        ours.RobotWrapper(ours.Model()).updateGeometryPlacements()


# --- what is missing -------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["Manipulator", "Humanoid"])
def test_shapes_of_the_sample_models_are_the_wheels(kind: str) -> None:
    made = [
        getattr(pin, f"buildSampleGeometryModel{kind}")(getattr(pin, f"buildSampleModel{kind}")())
        for pin in (ours, theirs)
    ]
    for wrong in (x for x in made[1].geometryObjects if x.name == "chest2_object"):
        wrong.meshPath = "CAPSULE"  # of a capsule, which the wheel calls a sphere
    assert_same_geometry(*made)
    assert all(x.geometry == y.geometry for x, y in zip(*(m.geometryObjects for m in made), strict=True))
    with pytest.raises(sd.ModelError, match="expected a sample model"):
        getattr(ours, f"buildSampleGeometryModel{kind}")(ours.Model())


def test_nothing_is_said_of_no_geometry(drawn: Path) -> None:
    empty = ours.GeometryModel()
    for call in (ours.computeCollisions, ours.computeDistances):
        with pytest.raises(sd.ModelError, match="without objects, expected some to compute"):
            call(empty, empty.createData())
    model, collision, _ = ours.buildModelsFromUrdf(drawn)
    with pytest.warns(UserWarning, match="without collisionPairs says nothing: addAllCollisionPairs"):
        assert not ours.computeCollisions(model, model.createData(), collision, collision.createData(), np.zeros(1))
    early = collision.createData()
    collision.addAllCollisionPairs()
    with pytest.raises(sd.ModelError, match="geometry_data is of 0 pairs and the model has 2"):
        ours.computeCollisions(collision, early)
    with pytest.raises(sd.ModelError, match="pair_index is 7, expected 0 to 1"):
        ours.computeCollision(collision, collision.createData(), 7)
    with pytest.raises(TypeError, match="computeCollisions got"):
        ours.computeCollisions(model, model.createData(), collision, collision.createData())
    collision.geometryObjects[0].geometry = None
    with pytest.raises(NotImplementedError, match='geometry object "a_0" has no shape, expected one of coal'):
        ours.computeCollisions(collision, collision.createData())


def test_without_coal_shapes_are_data_and_collisions_name_it(drawn: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "coal", None)
    assert not coal_package.has_coal()
    model, collision, visual = ours.buildModelsFromUrdf(drawn)
    box, cylinder, mesh = (x for x in visual.geometryObjects)
    assert isinstance(box.geometry, Box)
    assert box.geometry.halfSide.tolist() == [0.5, 1.0, 1.5]
    assert cylinder.geometry == Cylinder(0.5, 1.0)
    assert collision.geometryObjects[0].geometry == Sphere(1.0)
    arm = ours.buildSampleGeometryModelManipulator(ours.buildSampleModelManipulator())
    assert arm.geometryObjects[3].geometry == Capsule(0.05, 0.4)
    with pytest.raises(NotImplementedError, match='the mesh of geometry object "b_0" takes the package coal'):
        mesh.geometry
    collision.addAllCollisionPairs()
    data = collision.createData()
    ours.updateGeometryPlacements(model, model.createData(), collision, data, np.zeros(1))
    assert data.oMg[1].translation.tolist() == [0.0, 0.0, 2.0]
    for call in (
        lambda: ours.computeCollisions(collision, data),
        lambda: ours.computeDistances(collision, data),
        lambda: ours.computeCollision(collision, data, 0),
        lambda: data.collisionResults,
        lambda: ours.coal.Box,
        lambda: ours.GeometryObject.CreateCapsule(1.0, 1.0),
    ):
        with pytest.raises(NotImplementedError, match=r"takes the package coal, .*; pip install coal"):
            call()
    try:
        assert not importlib.reload(versions).WITH_COLLISION
    finally:
        monkeypatch.undo()
        assert importlib.reload(versions).WITH_COLLISION


def test_coal_is_there_under_both_names() -> None:
    assert ours.coal.Box is ours.hppfcl.Box is coal.Box
    assert not hasattr(ours.coal, "frobnicate")
    assert ours.WITH_COLLISION
    assert ours.GeometryObject.CreateCapsule(0.5, 1.0).geometry.radius == 0.5


NEGATIVE = -1  # as an index; of another kind of error
FAULTY: dict[str, tuple[Any, ...]] = {  # that both refuse; each kind of error is the wheel's
    "meshColor": (np.ones(3), np.ones((1, 4)), np.ones(5), [1.0, 1.0, 1.0, 1.0], "red", None, np.array(list("abcd"))),
    "meshScale": (np.ones(2), np.ones(4), [1.0, 1.0, 1.0], 2.0),
    "name": (3, None),
    "meshPath": (3,),
    "meshTexturePath": (3,),
    "parentJoint": (1.5, "a", NEGATIVE),
    "parentFrame": (2.0, NEGATIVE),
    "placement": (np.eye(4), None),
    "overrideMaterial": ("a", 2.5),
    "disableCollision": ("a",),
    "meshMaterial": (3,),
}


@pytest.mark.parametrize("name", FAULTY)
def test_an_attribute_refuses_what_the_wheel_refuses(name: str) -> None:
    for pin in (ours, theirs):
        made = pin.GeometryObject("g", 0, 0, pin.SE3.Identity(), coal.Sphere(1.0))
        before = str(getattr(made, name))
        for value in FAULTY[name]:
            with pytest.raises(OverflowError if value is NEGATIVE else TypeError) as error:
                setattr(made, name, value)
            if pin is ours:
                assert isinstance(error.value, sd.SpatialDynError)
                assert str(error.value).startswith(f"{name} is ")
        if name != "meshMaterial":  # whose wheel's text is an address
            assert str(getattr(made, name)) == before


def test_an_attribute_takes_what_the_wheel_takes_as_a_copy() -> None:
    for pin in (ours, theirs):
        made, color = pin.GeometryObject("g", 0, 0, pin.SE3.Identity(), coal.Sphere(1.0)), np.arange(4, dtype=np.int32)
        for value in (color, color.astype(np.float32), color.reshape(4, 1)):
            made.meshColor = value
            assert made.meshColor.tolist() == [0.0, 1.0, 2.0, 3.0]
            assert made.meshColor.dtype == np.float64
        color[0] = 7
        made.meshColor[3] = 0.5  # in place
        assert made.meshColor.tolist() == [0.0, 1.0, 2.0, 0.5]
        place = pin.SE3.Identity()
        made.placement, made.overrideMaterial, made.meshMaterial = place, 1, pin.GeometryPhongMaterial()
        place.translation = np.ones(3)
        assert made.placement.isIdentity()
        assert made.overrideMaterial is True
        made.meshMaterial.meshEmissionColor = np.ones(4)


def test_the_error_of_a_color_names_its_value_and_shape() -> None:
    made = ours.GeometryObject("g", 0, 0, ours.SE3.Identity(), None)
    with pytest.raises(
        TypeError, match=r"meshColor is array\(\[1., 1., 1.\]\), an array of shape \(3,\).*shape \(4,\)"
    ):
        made.meshColor = np.ones(3)
    with pytest.raises(TypeError, match=r"meshColor is array\(\[0., 0.\]\), an array of shape \(2,\)"):
        ours.GeometryObject("g", 0, 0, ours.SE3.Identity(), None, "", np.ones(3), True, np.zeros(2))
    with pytest.raises(TypeError, match=r"meshEmissionColor is array\(\[1., 1., 1.\]\)"):
        ours.GeometryPhongMaterial(np.ones(3))


def test_a_placement_for_coal_is_its_own_transform() -> None:
    """coal converts the wheel's SE3 by a converter of C++; ours is refused by coal, not taken for another pose."""
    ball, request = coal.Sphere(1.0), coal.CollisionRequest()
    for pin in (ours, theirs):
        M = pin.SE3(np.eye(3), np.array([1.5, 0.0, 0.0]))
        own, origin = coal.Transform3s(M.rotation, M.translation), coal.Transform3s()
        assert coal.collide(ball, own, ball, origin, request, coal.CollisionResult()) == 1
        if pin is ours:
            with pytest.raises(TypeError):
                coal.collide(ball, M, ball, origin, request, coal.CollisionResult())
    assert any("coal.Transform3s(M.rotation, M.translation)" in x.here for x in ours.differences())


def test_geometry_data_prints_its_pairs() -> None:
    texts = []
    for pin in (ours, theirs):
        geometry = pin.buildSampleGeometryModelManipulator(pin.buildSampleModelManipulator())
        geometry.addAllCollisionPairs()
        data = geometry.createData()
        data.deactivateCollisionPair(1)
        texts.append((str(data), repr(data)))
    assert texts[0] == texts[1]
    assert "Pairs 1 inactive\n" in texts[0][0]
