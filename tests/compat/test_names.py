"""Names that clients import: what works without a collision library, a viewer or a constraint solver."""

from __future__ import annotations

import copy
import pickle
import warnings
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
import spatialdyn.compat.pinocchio as ours
from spatialdyn.compat.pinocchio import visualize
from spatialdyn.compat.pinocchio.visualize import base_visualizer, viser_visualizer, window

theirs = pytest.importorskip("pinocchio")

VISUALIZERS = "Base Meshcat Gepetto Viser RViz Panda3d"
DRAWING = "Meshcat Viser"


def arm(pin: Any) -> Any:
    model = pin.Model()
    for k in range(3):
        model.addJoint(k, pin.JointModelRX(), pin.SE3.Identity(), f"j{k}")
        model.addFrame(pin.Frame(f"f{k}", k + 1, 0, pin.SE3.Identity(), pin.OP_FRAME))
    return model


def shapes(pin: Any, model: Any) -> Any:
    box = None if pin is ours else pin.coal.Box(1.0, 1.0, 1.0)
    geometry = pin.GeometryModel()
    for k, joint in enumerate((1, 2, 3, 3)):
        place = pin.SE3(np.eye(3), np.array([float(k), 0.0, 0.0]))
        assert geometry.addGeometryObject(pin.GeometryObject(f"g{k}", joint, joint, place, box)) == k
    return geometry


def public(x: Any) -> set[str]:
    return {name for name in dir(x) if not name.startswith("_")}


def test_bookkeeping_of_shapes_is_that_of_the_wheel() -> None:
    said = []
    for pin in (ours, theirs):
        geometry = shapes(pin, arm(pin))
        seen: list[Any] = [geometry.ngeoms, geometry.getGeometryId("g2"), geometry.getGeometryId("none")]
        seen += [geometry.existGeometryName("g1"), geometry.existGeometryName("g9")]
        geometry.addCollisionPair(pin.CollisionPair(0, 2))
        geometry.addCollisionPair(pin.CollisionPair(0, 2))
        seen += [len(geometry.collisionPairs), geometry.existCollisionPair(pin.CollisionPair(0, 2))]
        geometry.addAllCollisionPairs()
        seen += [sorted((p.first, p.second) for p in geometry.collisionPairs)]
        geometry.removeCollisionPair(pin.CollisionPair(0, 1))
        seen += [len(geometry.collisionPairs), geometry.findCollisionPair(pin.CollisionPair(0, 1))]
        data = geometry.createData()
        data.deactivateCollisionPair(1)
        seen += [list(data.activeCollisionPairs), len(data.oMg), len(pin.GeometryData(geometry).oMg)]
        data.deactivateAllCollisionPairs()
        data.activateCollisionPair(0)
        seen += [list(data.activeCollisionPairs)]
        other = geometry.copy()
        other.removeAllCollisionPairs()
        seen += [
            len(other.collisionPairs),
            len(geometry.collisionPairs),
            len(pin.GeometryModel(geometry).collisionPairs),
        ]
        geometry.removeGeometryObject("g1")
        seen += [
            [x.name for x in geometry.geometryObjects],
            sorted((p.first, p.second) for p in geometry.collisionPairs),
        ]
        one = geometry.geometryObjects[1]
        seen += [one.name, one.parentJoint, one.parentFrame, list(one.placement.translation), one.meshPath]
        seen += [list(one.meshScale), one.overrideMaterial, one.disableCollision, one.meshTexturePath]
        seen += [pin.CollisionPair(1, 2) == pin.CollisionPair(2, 1), pin.CollisionPair(1, 2) == pin.CollisionPair(1, 3)]
        seen += [(pin.CollisionPair(1, 2).copy().first, pin.CollisionPair(1, 2).second)]
        said.append(seen)
    assert said[0] == said[1]


@pytest.mark.parametrize("name", ["GeometryModel", "GeometryData", "GeometryObject", "CollisionPair"])
def test_every_attribute_of_the_wheels_class_is_there_or_says_what_it_takes(name: str) -> None:
    geometry = shapes(ours, arm(ours))
    made = {
        "GeometryModel": geometry, "GeometryData": geometry.createData(), "GeometryObject": geometry.geometryObjects[0],
        "CollisionPair": ours.CollisionPair(0, 1),
    }[name]  # fmt: skip
    assert isinstance(made, getattr(ours, name))
    for attribute in public(getattr(theirs, name)):
        if not hasattr(made, attribute):
            with pytest.raises(NotImplementedError, match="is not offered"):
                getattr(made, attribute)
    with pytest.raises(AttributeError) as raised:
        made.frobnicate
    assert not isinstance(raised.value, NotImplementedError)
    assert isinstance(copy.deepcopy(made), type(made))
    assert isinstance(pickle.loads(pickle.dumps(made)), type(made))


def test_wrong_shapes_and_pairs_are_refused() -> None:
    geometry = shapes(ours, arm(ours))
    with pytest.raises(sd.ModelError, match="collision pair has geometry 9, expected 0 to 3"):
        geometry.addCollisionPair(ours.CollisionPair(0, 9))
    with pytest.raises(sd.ModelError, match='there is no geometry "none"'):
        geometry.removeGeometryObject("none")
    with pytest.raises(sd.ModelError, match="geometry 2 twice"):
        ours.CollisionPair(2, 2)
    with pytest.raises(TypeError, match="GeometryObject got 2 arguments"):
        ours.GeometryObject("a", 1)
    with pytest.raises(TypeError, match="placement is a int, expected SE3"):
        ours.GeometryObject("a", 1, 2, 3)
    assert (geometry.ngeoms, geometry.collisionPairs) == (4, [])
    capsule = ours.GeometryObject("c", 1, ours.SE3.Identity(), None)
    model = arm(ours)
    capsule.parentFrame = 3
    geometry.addGeometryObject(capsule, model)
    assert geometry.geometryObjects[-1].parentJoint == model.frames[3].parentJoint == 3
    assert capsule.parentJoint == 1  # the model has a copy, as in Pinocchio
    assert ours.GeometryObject(capsule).name == "c"
    assert isinstance(capsule.meshMaterial, ours.GeometryNoMaterial)
    assert ours.GeometryPhongMaterial().meshShininess == 0.0


@pytest.mark.parametrize("given", [(), (1,), (2, 3), (1, "r"), (2, 3, "r")])
def test_contacts_hold_what_the_wheels_hold(given: tuple[Any, ...]) -> None:
    made = []
    for pin in (ours, theirs):
        place = pin.SE3(np.eye(3), np.array([1.0, 2.0, 3.0]))
        rest: list[Any] = [place] if given and given[0] == 1 else [place, 1, place] if given else []
        rest += [pin.LOCAL_WORLD_ALIGNED] if "r" in given else []
        made.append(pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, arm(pin), 2, *rest))
    mine, other = made
    for name in ("joint1_id", "joint2_id", "name"):
        assert getattr(mine, name) == getattr(other, name), name
    for name in ("joint1_placement", "joint2_placement", "desired_contact_placement"):
        assert (getattr(mine, name).homogeneous == getattr(other, name).homogeneous).all()
    assert (str(mine.type), str(mine.reference_frame)) == (str(other.type), str(other.reference_frame))
    assert mine.residualSize() == other.residualSize() == 3
    data = mine.createData()
    assert isinstance(data, ours.RigidConstraintData)
    assert (data.contact_force.vector == other.createData().contact_force.vector).all()
    assert mine.copy().joint1_id == ours.RigidConstraintModel(mine).joint1_id == 2
    assert ours.ContactType.names.keys() == theirs.ContactType.names.keys()
    for name in ("setCompliance", "retrieveCompliance"):
        assert not hasattr(mine, name)
        with pytest.raises(NotImplementedError, match=f"{name}: getConstraintJacobian gives J"):
            getattr(mine, name)


def public_names(x: Any) -> set[str]:
    """Public names of an object, those that raise apart."""
    return {name for name in dir(x) if not name.startswith("_") and hasattr(x, name)}


def test_contacts_have_the_fields_of_the_wheels() -> None:
    """At rest, where a solver is not needed; what one keeps for itself is out of scope by name."""
    made = [pin.RigidConstraintModel(pin.ContactType.CONTACT_6D, arm(pin), 2) for pin in (ours, theirs)]
    mine, other = (x.createData() for x in made)
    solver = {"extended_motion_propagators_joint1", "extended_motion_propagators_joint2", "lambdas_joint1"}
    assert public_names(mine) == public_names(other) - solver
    for name in public_names(mine):
        left, right = getattr(mine, name), getattr(other, name)
        assert type(left).__name__ == type(right).__name__, name
        array = "homogeneous" if name in ("oMc1", "oMc2", "c1Mc2") else "vector"
        assert (getattr(left, array) == getattr(right, array)).all(), name
    mine.contact1_velocity = ours.Motion.Random()
    assert not mine.contact2_velocity.vector.any()
    for name in solver:
        with pytest.raises(NotImplementedError, match=f"{name}: scratch"):
            getattr(mine, name)
    assert not hasattr(mine, "no_such_field")
    parts = {"retrieveCompliance", "setCompliance"}
    assert public_names(made[0]) - {"copy"} == public_names(made[1]) - parts
    assert made[0].cast() is not made[0]
    assert made[0].cast().joint1_id == 2
    for x in (mine, made[0]):
        assert vars(copy.deepcopy(x)).keys() == vars(pickle.loads(pickle.dumps(x))).keys() == vars(x).keys()


def test_wrong_contacts_are_refused() -> None:
    with pytest.raises(sd.ModelError, match="joint index is 9, expected one from 0 to 3"):
        ours.RigidConstraintModel(ours.ContactType.CONTACT_6D, arm(ours), 9)
    with pytest.raises(TypeError, match="contact_type is a int"):
        ours.RigidConstraintModel(1, arm(ours), 1)
    with pytest.raises(TypeError, match="CONTACT_UNDEFINED, expected CONTACT_3D"):
        ours.RigidConstraintModel(ours.ContactType.CONTACT_UNDEFINED, arm(ours), 1)
    with pytest.raises(TypeError, match="expected contact_type, model, joint1_id"):
        ours.RigidConstraintModel(ours.ContactType.CONTACT_6D, arm(ours), 1, nonsense=1)


@pytest.mark.parametrize("name", VISUALIZERS.split())
def test_visualizers_are_made_and_show_nothing(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    base_visualizer._warn.cache_clear()
    monkeypatch.setattr(viser_visualizer, "installed", lambda package: False)
    model, kind = arm(ours), getattr(visualize, f"{name}Visualizer")
    with pytest.warns(UserWarning, match="shows nothing: .*pip install viser pycollada"):
        shown = kind(model, ours.GeometryModel(), ours.GeometryModel())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert isinstance(kind(model), visualize.BaseVisualizer)
        assert kind(model, copy_models=True).model is not model
        viewer = object()
        shown.initViewer(viewer, open=True)
        assert shown.viewer is viewer
        shown.loadViewerModel("world", color=[1.0, 1.0, 1.0, 1.0])
        assert shown.display(ours.neutral(model)) is None
        assert shown.display() is None
        seen: list[int] = []
        shown.play([ours.neutral(model)] * 2, 10.0, callback=lambda k, q, viz: seen.append(k))
        assert seen == [0, 1]
        assert (shown.model, shown.data.model) == (model, model)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what the package meshcat imports, where it is installed
        peer = getattr(theirs, "visualize", None) or __import__("pinocchio.visualize", fromlist=["x"])
    for method in public(getattr(peer, f"{name}Visualizer")) - {"loadMeshFromFile", "loadPrimitive"}:
        if not method.isupper() and callable(getattr(getattr(peer, f"{name}Visualizer"), method)):
            assert callable(getattr(shown, method, None)) or name != "Base", method
    with pytest.raises(NotImplementedError, match="shows nothing"):
        shown.captureImage()
    with pytest.raises(NotImplementedError, match="no videos"), shown.create_video_ctx("film"):
        pass
    with pytest.raises(AttributeError, match="has no frobnicate"):
        shown.frobnicate()


def test_visualizers_are_found_by_name_and_in_the_modules_of_pinocchio(monkeypatch: pytest.MonkeyPatch) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what the package meshcat imports, where it is installed
        peer = __import__("pinocchio.visualize", fromlist=["x"])
    assert {*visualize.Visualizer.__members__} == {*peer.Visualizer.__members__}
    for kind in ("base", "meshcat", "viser"):
        name = f"{kind.title()}Visualizer"
        for package in (peer, visualize):
            module = import_module(f"{package.__name__}.{kind}_visualizer")
            assert getattr(module, name) is getattr(package, name) is package.Visualizer[kind.upper()].value
    for package in (peer, visualize):
        monkeypatch.setenv("PINOCCHIO_VIEWER", "Viser")
        assert package.Visualizer.default() is package.ViserVisualizer
        monkeypatch.setenv("PINOCCHIO_VIEWER", "abacus")
        with pytest.raises(ImportError, match="abacus" if package is visualize else "ABACUS"):
            package.Visualizer.default()
    monkeypatch.delenv("PINOCCHIO_VIEWER")
    assert visualize.Visualizer.default() is visualize.MeshcatVisualizer
    monkeypatch.setenv("PINOCCHIO_VIEWER", "base")
    robot = ours.RobotWrapper(arm(ours))
    base_visualizer._warn.cache_clear()
    with pytest.warns(UserWarning, match="shows nothing"):
        robot.initViewer()
    assert type(robot.viz) is visualize.BaseVisualizer


def test_a_robot_is_shown_by_nothing_too(monkeypatch: pytest.MonkeyPatch) -> None:
    base_visualizer._warn.cache_clear()
    monkeypatch.setattr(viser_visualizer, "installed", lambda package: False)
    robot = ours.RobotWrapper(arm(ours))
    assert robot.viewer is None
    with pytest.raises(RuntimeError, match="expected initViewer or setVisualizer before"):
        robot.display(robot.q0)
    with pytest.warns(UserWarning, match="shows nothing"):
        robot.initViewer(viewer="window", loadModel=True)
    assert robot.viz.data is robot.data
    assert robot.viewer == "window"
    robot.loadViewerModel("world")
    robot.display(robot.q0)
    robot.displayCollisions(True)
    robot.displayVisuals(False)
    robot.play([robot.q0], 0.1)
    other = visualize.MeshcatVisualizer()
    robot.setVisualizer(other)
    assert robot.viz is other
    assert other.model is robot.model
    assert (
        robot.getViewerNodeName(ours.GeometryObject("g", 1, ours.SE3.Identity(), None), ours.VISUAL)
        == "pinocchio/visuals/g"
    )


DRAWN = """<robot name="r"><link name="a"><visual><geometry><box size="1 1 1"/></geometry></visual>
<collision><geometry><sphere radius="1"/></geometry></collision></link><link name="b"><visual><origin xyz="0 0 1"/>
<geometry><mesh filename="package://tool/t.obj"/></geometry></visual></link><joint name="j" type="revolute">
<parent link="a"/><child link="b"/><origin xyz="0 0 2"/><axis xyz="0 1 0"/><limit effort="1" velocity="1"/></joint>
</robot>"""


@pytest.mark.parametrize("name", DRAWING.split())
def test_visualizers_draw_where_viser_is(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    viser = pytest.importorskip("viser")
    monkeypatch.setattr("webbrowser.open", lambda url: pytest.fail("a tab was opened"))
    (tmp_path / "tool").mkdir()
    (tmp_path / "tool" / "t.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n")
    path = tmp_path / "urdf" / "r.urdf"
    path.parent.mkdir()
    path.write_text(DRAWN)
    models = ours.buildModelsFromUrdf(path, str(tmp_path), geometry_types=[ours.COLLISION, ours.VISUAL])
    shown = getattr(visualize, f"{name}Visualizer")(*models)
    with pytest.raises(RuntimeError, match="no viewer, expected initViewer before"):
        shown.loadViewerModel()
    with pytest.raises(RuntimeError, match=r"viewer is a str, expected None or a viser\.ViserServer"):
        shown.initViewer("window")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        shown.initViewer(loadModel=True)
    server = shown.viewer if name == "Viser" else shown.viewer.server
    try:
        assert isinstance(server, viser.ViserServer)
        nodes = server.scene._handle_from_node_name
        assert "/pinocchio/0_universe/a_0" in nodes
        q = np.array([0.3])
        shown.display(q)
        assert nodes["/pinocchio/1_j"].position == pytest.approx([0.0, 0.0, 2.0])
        assert nodes["/pinocchio/1_j"].wxyz == pytest.approx([np.cos(0.15), 0.0, np.sin(0.15), 0.0])
        ours.forwardKinematics(shown.model, shown.data, np.zeros(1))
        shown.display()
        assert nodes["/pinocchio/1_j"].wxyz == pytest.approx([1.0, 0.0, 0.0, 0.0])
        shown.displayVisuals(False)
        assert not nodes["/pinocchio/1_j/b_0"].visible
        shown.displayCollisions(True)
        shown.displayFrames(True)
        assert nodes["/pinocchio/0_universe/a_0_2"].visible
        shown.setCameraTarget([1.0, 2.0, 3.0])
        shown.setCameraPosition([4.0, 2.0, 3.0])
        assert server.initial_camera.look_at == pytest.approx([1.0, 2.0, 3.0])
        with pytest.raises(RuntimeError, match="no browser shows http://localhost"):
            shown.captureImage()
        again = getattr(visualize, f"{name}Visualizer")(
            ours.buildSampleModelManipulator()
        )  # no geometry: boxes of inertia
        again.initViewer(shown.viewer, loadModel=True)
        assert len(again._shown["visuals"]) > 1
        again.clean()
        assert again._shown == {}
        if name == "Meshcat":
            assert shown.viewer.url().startswith("http://localhost")
            assert shown.viewer._repr_html_().startswith("<iframe src=")
            assert "__VISER_EMBED_DATA__" in shown.viewer.static_html()
    finally:
        shown._stage.stop()


def test_objects_added_to_a_geometry_model_are_drawn(tmp_path: Path) -> None:
    pytest.importorskip("viser")
    model, visual = arm(ours), ours.GeometryModel()
    box = type("Box", (), {"halfSide": np.array([1.0, 2.0, 3.0])})()
    placement = ours.SE3(np.eye(3), np.array([0.0, 0.0, 1.0]))
    visual.addGeometryObject(ours.GeometryObject("box", 1, placement, box))
    visual.addGeometryObject(ours.GeometryObject("lost", 1, placement, None, "nowhere.stl"))
    visual.addGeometryObject(ours.GeometryObject("odd", 1, placement, object()))
    robot = ours.RobotWrapper(model, None, visual)
    robot.initViewer()
    try:
        with pytest.warns(UserWarning, match=r"2 meshes are missing.*nowhere\.stl is not found.*odd is a object"):
            robot.loadViewerModel()
        robot.display(robot.q0)
        (drawn,) = robot.viz._shown["visuals"]
        assert np.ptp(drawn.vertices, axis=0) == pytest.approx([2.0, 4.0, 6.0])
        assert drawn.vertices.mean(0) == pytest.approx([0.0, 0.0, 1.0])
        assert isinstance(robot.viewer, window.MeshcatWindow)
    finally:
        robot.viz._stage.stop()


def test_functions_that_leave_warn() -> None:
    @ours.deprecated("use rnea")
    def old(x: int) -> int:
        """One more."""
        return x + 1

    with pytest.warns(ours.deprecation.DeprecatedWarning, match="old is deprecated: use rnea"):
        assert old(1) == 2
    assert old.__doc__ == "One more.\n\nDeprecated: use rnea"
    assert ours.deprecation.deprecated is ours.deprecated
    assert ours.__raw_version__ == theirs.__raw_version__ == ours.__version__
