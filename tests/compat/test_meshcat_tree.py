"""``MeshcatVisualizer.viewer[path]`` in viser: objects of the package meshcat, where they are and how they look."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import spatialdyn.compat.pinocchio as pin
from spatialdyn.compat.pinocchio.visualize import MeshcatVisualizer, meshcat_visualizer
from spatialdyn.pictures.meshcat_objects import frustum, triangles

pytest.importorskip("viser")
SINGLE = 2e-6  # viser keeps float32
ROBOT = """<robot name="r"><link name="a"><visual><geometry><box size="1 1 1"/></geometry></visual></link>
<link name="b"><visual><geometry><sphere radius="0.5"/></geometry></visual></link>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 2"/><axis xyz="0 1 0"/>
<limit effort="1" velocity="1"/></joint></robot>"""


def like(name: str, turned: Any = None, **numbers: Any) -> Any:
    """An object with the attributes of one of ``meshcat.geometry``."""
    made = type(name, (), numbers)()
    made.intrinsic_transform = lambda: np.eye(4) if turned is None else np.asarray(turned, float)
    return made


def paint(color: int = 0xFFFFFF, **more: Any) -> Any:
    return SimpleNamespace(**{"color": color, "opacity": 1.0, "linewidth": 1.0, "wireframe": False, **more})


def pair(kind: str, geometry: Any, material: Any) -> Any:
    return SimpleNamespace(_type=kind, geometry=geometry, material=material)


@pytest.fixture
def shown(tmp_path: Path) -> Iterator[Any]:
    """A visualizer of two links, whose server ends with the test."""
    path = tmp_path / "r.urdf"
    path.write_text(ROBOT)
    made = MeshcatVisualizer(*pin.buildModelsFromUrdf(path))
    made.initViewer(loadModel=True)
    yield made
    made._stage.stop()


def nodes(shown: Any) -> dict[str, Any]:
    return dict(shown.viewer.server.scene._handle_from_node_name)


# --- objects ---------------------------------------------------------------------------------------------


def test_objects_are_drawn_at_their_paths_and_replaced(shown: Any) -> None:
    viewer = shown.viewer
    viewer["world"]["box"].set_object(like("Box", lengths=[1.0, 2.0, 3.0]), paint(0xFF8000, opacity=0.5))
    box = nodes(shown)["/tree/world/box/object"]
    assert np.ptp(box.vertices, axis=0) == pytest.approx([1.0, 2.0, 3.0])
    assert (tuple(np.asarray(box.color).tolist()), box.opacity) == ((255, 128, 0), 0.5)
    viewer["world/box"].set_object(like("Sphere", radius=0.25))
    ball = nodes(shown)["/tree/world/box/object"]
    assert np.linalg.norm(ball.vertices, axis=1) == pytest.approx(np.full(len(ball.vertices), 0.25), abs=SINGLE)
    assert ball.opacity is None
    stretched = like("Ellipsoid", np.diag([1.0, 2.0, 3.0, 1.0]), radius=1.0, radii=[1.0, 2.0, 3.0])
    viewer["egg"].set_object(stretched)
    assert abs(nodes(shown)["/tree/egg/object"].vertices).max(axis=0) == pytest.approx([1.0, 2.0, 3.0], abs=0.02)
    mesh = like("TriangularMeshGeometry", vertices=np.eye(3), faces=np.array([[0, 1, 2]]))
    viewer["tri"].set_object(pair("Mesh", mesh, paint(wireframe=True)))
    assert nodes(shown)["/tree/tri/object"].vertices == pytest.approx(np.eye(3))
    assert nodes(shown)["/tree/tri/object"].wireframe
    with pytest.raises(NotImplementedError, match="a Torus is not drawn, expected a box, sphere"):
        viewer["odd"].set_object(like("Torus", tube=1.0))


@pytest.mark.parametrize(("top", "bottom"), [(0.5, 0.5), (0.0, 0.5), (0.5, 0.1)])
def test_cylinders_and_cones_stand_along_y_and_face_outwards(top: float, bottom: float) -> None:
    vertices, faces = frustum(top, bottom, 2.0)
    at = vertices[:, 1] > 0.0
    for side, radius in ((at, top), (~at, bottom)):
        assert np.hypot(vertices[side][:, 0], vertices[side][:, 2]).max() == pytest.approx(radius)
    assert (vertices[:, 1].min(), vertices[:, 1].max()) == (-1.0, 1.0)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    assert volume == pytest.approx(2.0 * np.pi / 3.0 * (top**2 + top * bottom + bottom**2), rel=5e-3)


def test_mesh_files_are_read(shown: Any) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n"
    vertices, faces = triangles(like("ObjMeshGeometry", contents=text, mesh_format="obj"))
    assert np.ptp(vertices, axis=0).tolist() == [1.0, 2.0, 0.0]
    assert len(faces) == 1
    with pytest.raises(RuntimeError, match="a mesh of format obj cannot be read"):
        shown.viewer["broken"].set_object(like("ObjMeshGeometry", contents=b"\x00\x01", mesh_format="obj"))


def test_points_and_lines_are_drawn(shown: Any) -> None:
    P = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 1.0]])
    where = like("PointsGeometry", position=P.T, color=None)
    for kind, wanted in (
        ("LineSegments", [[0, 1], [2, 3]]), ("Line", [[0, 1], [1, 2], [2, 3]]),
        ("LineLoop", [[0, 1], [1, 2], [2, 3], [3, 0]]),
    ):  # fmt: skip
        shown.viewer["line"].set_object(pair(kind, where, paint(0x00FF00)))
        assert nodes(shown)["/tree/line/object"].points == pytest.approx(P[np.array(wanted)])
    shown.viewer["cloud"].set_object(pair("Points", like("PointsGeometry", position=P.T, color=P.T), paint(size=0.2)))
    cloud = nodes(shown)["/tree/cloud/object"]
    assert (cloud.points == P).all()
    assert cloud.point_size == 0.2


# --- the tree --------------------------------------------------------------------------------------------


def test_transforms_are_of_all_below_and_scales_of_the_object(shown: Any) -> None:
    viewer, X = shown.viewer, np.eye(4)
    viewer["arm/tip"].set_object(like("Box", lengths=[1.0, 1.0, 1.0]))
    X[:3, :3], X[:3, 3] = [[0.0, -2.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 3.0]], [1.0, 2.0, 3.0]
    viewer["arm"].set_transform(X)
    arm = nodes(shown)["/tree/arm"]
    assert arm.position == pytest.approx([1.0, 2.0, 3.0])
    assert abs(arm.wxyz) == pytest.approx([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    assert "/tree/arm/tip/object" in nodes(shown)
    viewer["arm/tip"].set_transform(X)
    assert nodes(shown)["/tree/arm/tip/object"].scale == pytest.approx((2.0, 2.0, 3.0))
    for bad in (np.eye(3), np.full((4, 4), np.nan)):
        with pytest.raises(RuntimeError, match="expected finite numbers"):
            viewer["arm"].set_transform(bad)


def test_properties_and_delete_are_of_all_below(shown: Any) -> None:
    viewer = shown.viewer
    for name in ("a/x", "a/y", "b"):
        viewer[name].set_object(like("Box", lengths=[1.0, 1.0, 1.0]))
    viewer["a"].set_property("visible", False)
    seen = {name: nodes(shown)[f"/tree/{name}/object"] for name in ("a/x", "a/y", "b")}
    assert [x.visible for x in seen.values()] == [False, False, True]
    viewer["b"].set_property("color", [1.0, 0.0, 0.5, 0.25])
    assert tuple(np.asarray(seen["b"].color).tolist()) == (255, 0, 128)
    assert seen["b"].opacity == 0.25
    viewer["b"].set_property("position", [1.0, 2.0, 3.0])
    viewer["b"].set_property("quaternion", [0.0, 0.0, 1.0, 0.0])
    assert nodes(shown)["/tree/b"].position == pytest.approx([1.0, 2.0, 3.0])
    assert nodes(shown)["/tree/b"].wxyz == pytest.approx([0.0, 0.0, 0.0, 1.0])
    viewer["b"].set_property("scale", 2.0)
    assert seen["b"].scale == pytest.approx((2.0, 2.0, 2.0))
    with pytest.raises(NotImplementedError, match="set_property of 'gloss' is not offered, expected one of visible"):
        viewer["b"].set_property("gloss", 1.0)
    with pytest.raises(NotImplementedError, match="set_animation is not offered"):
        viewer.set_animation(None)
    before = nodes(shown)
    viewer["/Background"].set_property("top_color", [0, 0, 0])
    viewer["/Cameras/default"].set_transform(np.eye(4))
    assert nodes(shown) == before
    assert nodes(shown)["/floor"].visible
    viewer["/Grid"].set_property("visible", False)
    assert not nodes(shown)["/floor"].visible
    viewer["a"].delete()
    assert [name for name in nodes(shown) if name.startswith("/tree/a")] == []
    assert "/tree/b/object" in nodes(shown)
    viewer["a/x"].set_object(like("Box", lengths=[1.0, 1.0, 1.0]))
    assert "/tree/a/x/object" in nodes(shown)


def test_the_robots_shapes_have_their_paths(shown: Any) -> None:
    first = shown.visual_model.geometryObjects[0]
    path = shown.getViewerNodeName(first, pin.VISUAL)
    assert path == "pinocchio/visuals/a_0" == f"{shown.viewerVisualGroupName}/a_0"
    assert shown.viewerCollisionGroupName == "pinocchio/collisions"
    shown.viewer[path].set_property("color", [1.0, 0.0, 0.0, 1.0])
    assert tuple(np.asarray(nodes(shown)["/pinocchio/0_universe/a_0"].color).tolist()) == (255, 0, 0)
    shown.viewer["pinocchio"].set_property("visible", False)
    assert not nodes(shown)["/pinocchio/1_j/b_0"].visible
    with pytest.raises(NotImplementedError, match=r"is of the robot, expected display\(q\) to move it"):
        shown.viewer["pinocchio/visuals"].set_transform(np.eye(4))
    shown.viewer[path].delete()
    assert "/pinocchio/0_universe/a_0" not in nodes(shown)
    shown.clean()
    assert "/pinocchio/1_j/b_0" not in nodes(shown)


def test_objects_are_added_reloaded_and_deleted(shown: Any) -> None:
    placement = pin.SE3(np.eye(3), np.array([0.0, 0.0, 1.0]))
    ball = SimpleNamespace(radius=0.5)
    added = pin.GeometryObject("ball", 1, placement, ball)
    shown.addGeometryObject(added, [0.0, 1.0, 0.0, 1.0])
    assert shown.visual_model.existGeometryName("ball")
    drawn = nodes(shown)["/pinocchio/1_j/ball"]
    assert drawn.vertices.mean(axis=0) == pytest.approx([0.0, 0.0, 1.0], abs=SINGLE)
    assert tuple(np.asarray(drawn.color).tolist()) == (0, 255, 0)
    ball.radius = 2.0
    shown.reload(added)
    assert np.ptp(nodes(shown)["/pinocchio/1_j/ball"].vertices[:, 0]) == pytest.approx(4.0, abs=0.1)
    shown.delete(added, pin.VISUAL)
    assert "/pinocchio/1_j/ball" not in nodes(shown)


# --- the module ------------------------------------------------------------------------------------------


def test_primitives_are_meshcats_objects(shown: Any) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        mg = pytest.importorskip("meshcat.geometry")
    coal = pytest.importorskip("coal")
    tetrahedron = coal.BVHModelOBBRSS()
    tetrahedron.beginModel(4, 4)
    tetrahedron.addVertices(np.vstack([np.zeros(3), np.eye(3)]))
    tetrahedron.addTriangles(np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    tetrahedron.endModel()
    for shape, kind, size in (
        (coal.Box(1.0, 2.0, 3.0), mg.Box, (1.0, 2.0, 3.0)), (coal.Sphere(0.5), mg.Sphere, (1.0, 1.0, 1.0)),
        (coal.Cylinder(0.5, 2.0), mg.Cylinder, (1.0, 1.0, 2.0)), (coal.Cone(0.5, 2.0), mg.Cylinder, (1.0, 1.0, 2.0)),
        (coal.Capsule(0.5, 2.0), mg.TriangularMeshGeometry, (1.0, 1.0, 3.0)),
        (tetrahedron, mg.TriangularMeshGeometry, (1.0, 1.0, 1.0)),
    ):  # fmt: skip
        made = meshcat_visualizer.loadPrimitive(pin.GeometryObject("g", 0, pin.SE3.Identity(), shape))
        assert isinstance(made, kind)
        shown.viewer["g"].set_object(mg.Mesh(made, mg.MeshLambertMaterial(color=0x123456)))
        drawn = nodes(shown)["/tree/g/object"]
        assert np.ptp(drawn.vertices, axis=0) == pytest.approx(size, abs=5e-3)
        assert tuple(np.asarray(drawn.color).tolist()) == (0x12, 0x34, 0x56)
    shown.viewer["axes"].set_object(mg.triad(0.5))
    assert nodes(shown)["/tree/axes/object"].points.max() == 0.5
    with pytest.raises(NotImplementedError, match="a Halfspace is not converted, expected a box"):
        meshcat_visualizer.loadPrimitive(
            pin.GeometryObject("g", 0, pin.SE3.Identity(), coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0))
        )


def test_meshes_are_known_and_without_meshcat_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for path, is_mesh in (("a.STL", True), ("b.dae", True), ("BOX", False), ("", False)):
        given = pin.GeometryObject("g", 0, pin.SE3.Identity(), None, path)
        assert meshcat_visualizer.isMesh(given) == meshcat_visualizer.hasMeshFileInfo(given) == is_mesh
    monkeypatch.setitem(sys.modules, "meshcat", None)
    monkeypatch.setitem(sys.modules, "meshcat.geometry", None)
    with pytest.raises(
        NotImplementedError, match="loadPrimitive takes the package meshcat, which is not installed; pip"
    ):
        meshcat_visualizer.loadPrimitive(pin.GeometryObject("g", 0, pin.SE3.Identity(), SimpleNamespace(radius=1.0)))


def test_a_robot_wrapper_is_drawn_and_played(tmp_path: Path) -> None:
    path = tmp_path / "r.urdf"
    path.write_text(ROBOT)
    robot = pin.RobotWrapper.BuildFromURDF(str(path))
    robot.initViewer(loadModel=True)
    try:
        drawn = dict(robot.viewer.server.scene._handle_from_node_name)
        robot.display(np.array([np.pi / 2.0]))
        assert drawn["/pinocchio/1_j"].wxyz == pytest.approx([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0], abs=SINGLE)
        robot.play(np.zeros((2, 1)), 1e-3)
        assert drawn["/pinocchio/1_j"].wxyz == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=SINGLE)
        robot.viewer["target"].set_object(like("Sphere", radius=0.1))
        assert "/tree/target/object" in robot.viewer.server.scene._handle_from_node_name
    finally:
        robot.viz._stage.stop()


# --- what clients call beside the tree --------------------------------------------------------------------


def test_presets_of_the_camera_move_it(shown: Any) -> None:
    shown.setCameraPreset("cam_ur5")
    camera = shown._stage.server.initial_camera
    assert np.asarray(camera.look_at).tolist() == shown.CAMERA_PRESETS["cam_ur5"][0] == [-1.0, 0.3, 0.0]
    assert np.asarray(camera.position).tolist() == shown.CAMERA_PRESETS["cam_ur5"][1] == [-0.05, 1.5, 1.2]
    with pytest.raises(RuntimeError, match=r"preset_key is 'moon', expected one of preset0, "):
        shown.setCameraPreset("moon")


def test_the_velocity_of_a_frame_is_drawn_as_a_line(shown: Any) -> None:
    model, place = shown.model, pin.SE3(np.eye(3), np.array([0, 0, 1.0]))
    frame = model.addFrame(pin.Frame("tip", 1, 0, place, pin.FrameType.OP_FRAME))
    shown.rebuildData()
    pin.forwardKinematics(model, shown.data, np.zeros(1), np.array([2.0]))
    shown.drawFrameVelocities(frame, 0.5)
    line = nodes(shown)[f"/tree/pinocchio/visuals/lines/ee_vel/{frame}/object"]
    assert np.asarray(line.points) == pytest.approx(np.array([[[0, 0, 3.0], [1.0, 0, 3.0]]]))
    assert np.unique(np.asarray(line.colors).reshape(-1, 3), axis=0).tolist() == [[0, 255, 0]]
    assert shown.FRAME_VEL_COLOR == 0x00FF00


def geometry_of_meshcat() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its own imports
        return pytest.importorskip("meshcat.geometry")


def test_shapes_of_coal_become_objects_of_meshcat(shown: Any) -> None:
    coal, kinds = pytest.importorskip("coal"), geometry_of_meshcat()
    for shape, size in ((coal.Box(1.0, 2.0, 3.0), [1, 2, 3]), (coal.Capsule(0.5, 1.0), [1, 1, 2])):
        made = shown.loadPrimitive(pin.GeometryObject("x", 0, pin.SE3.Identity(), shape))
        assert isinstance(made, kinds.TriangularMeshGeometry)
        shown.viewer["x"].set_object(made)
        assert np.ptp(nodes(shown)["/tree/x/object"].vertices, axis=0) == pytest.approx(size, abs=0.02)
    empty = pin.GeometryObject("flat", 0, pin.SE3.Identity(), coal.Halfspace(np.array([0, 0, 1.0]), 0.0))
    with pytest.warns(UserWarning, match="flat is a Halfspace, expected a shape with triangles"):
        assert shown.loadPrimitive(empty) is None


def test_mesh_files_become_objects_of_meshcat(shown: Any, tmp_path: Path) -> None:
    coal, kinds = pytest.importorskip("coal"), geometry_of_meshcat()
    path = tmp_path / "t.obj"
    path.write_text("v 0 0 0\nv 2 0 0\nv 0 3 0\nf 1 2 3\n")
    named = pin.GeometryObject("x", 0, pin.SE3.Identity(), coal.Sphere(1.0))
    named.meshPath = str(path)
    made = shown.loadMeshFromFile(named)
    assert isinstance(made, kinds.MeshGeometry)
    assert made.mesh_format == "obj"
    shown.viewer["x"].set_object(made)
    assert np.ptp(nodes(shown)["/tree/x/object"].vertices, axis=0) == pytest.approx([2.0, 3.0, 0.0], abs=1e-5)
    for at in ("", "t.ply"):
        named.meshPath = at
        with pytest.warns(UserWarning, match=f"x has the mesh '{at}', expected .dae, .obj or .stl"):
            assert shown.loadMeshFromFile(named) is None


def test_without_meshcat_its_objects_are_refused(shown: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    coal = pytest.importorskip("coal")
    monkeypatch.setitem(sys.modules, "meshcat.geometry", None)
    with pytest.raises(NotImplementedError, match="loadPrimitive takes the package meshcat, which is not installed"):
        shown.loadPrimitive(pin.GeometryObject("x", 0, pin.SE3.Identity(), coal.Sphere(1.0)))


def test_two_robots_of_one_viewer_move_apart_and_one_of_a_name_replaces_the_other(tmp_path: Path) -> None:
    path = tmp_path / "r.urdf"
    path.write_text(ROBOT)
    one, two, three = (MeshcatVisualizer(*pin.buildModelsFromUrdf(str(path))) for _ in range(3))
    one.initViewer(loadModel=True)
    try:
        nodes = one.viewer.server.scene._handle_from_node_name
        two.initViewer(one.viewer)
        one.display(np.array([np.pi / 2.0]))
        two.loadViewerModel(rootNodeName="second")
        two.display(np.array([0.0]))
        one.display()
        assert nodes["/pinocchio/1_j"].wxyz == pytest.approx([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0], abs=SINGLE)
        assert nodes["/second/1_j"].wxyz == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=SINGLE)
        shapes = {name for name in nodes if name.startswith("/second/")}
        two.loadViewerModel(rootNodeName="second")
        assert {name for name in nodes if name.startswith("/second/")} == shapes
        three.initViewer(one.viewer)
        three.loadViewerModel(rootNodeName="second")
        assert {name for name in nodes if name.startswith("/second/")} == shapes
        two.loadViewerModel(rootNodeName="third")  # its old name is the other's
        assert {name for name in nodes if name.startswith("/second/")} == shapes
        assert not any(name.startswith("/robot/") for name in nodes)
    finally:
        one._stage.stop()
