"""Geometry of URDFs: primitives, mesh files, colours, names that mean a file, and what is missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.errors import InertiaError
from spatialdyn.model.robot import Link
from spatialdyn.model.robot_checks import make_link
from spatialdyn.pictures.inertia_shapes import BOX, WRONG, box_of, inertia_boxes, joint_axes, reach, turned_to
from spatialdyn.pictures.mesh_files import NotDrawnError, find_mesh
from spatialdyn.pictures.robot_shapes import robot_shapes
from spatialdyn.pictures.shapes import coal_shape, mesh_shapes, urdf_shapes

trimesh = pytest.importorskip("trimesh")

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n"  # its normal is z
MESH = '<visual><origin xyz="0 0 5"/><geometry><mesh filename="{name}"{more}/></geometry></visual>'


def urdf(*visuals: str, materials: str = "") -> str:
    """A robot of one link with visuals."""
    return f'<robot name="r">{materials}<link name="a">{"".join(visuals)}</link></robot>'


def primitive(geometry: str, rest: str = "") -> str:
    return f"<visual>{rest}<geometry>{geometry}</geometry></visual>"


def extent(shape: object) -> list[float]:
    return np.ptp(shape.vertices, axis=0).tolist()  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("geometry", "sides"),
    [
        ('<box size="1 2 3"/>', [1.0, 2.0, 3.0]),
        ('<cylinder radius="1" length="3"/>', [2.0, 2.0, 3.0]),
        ('<sphere radius="2"/>', [4.0, 4.0, 4.0]),
    ],
)
def test_primitives_have_their_sizes(geometry: str, sides: list[float]) -> None:
    (shape,), missing, _ = urdf_shapes(urdf(primitive(geometry)))
    assert missing == []
    assert extent(shape) == pytest.approx(sides, rel=0.02)


def test_an_origin_places_and_turns_what_it_is_of() -> None:
    (shape,), *_ = urdf_shapes(
        urdf(primitive('<box size="1 2 3"/>', '<origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/>'))
    )
    assert extent(shape) == pytest.approx([2.0, 1.0, 3.0])
    assert shape.vertices.mean(0) == pytest.approx([1.0, 0.0, 0.0])


def test_colours_are_the_materials_own_or_by_name_and_one_colour_is_one_shape() -> None:
    red, blue = '<color rgba="1 0 0 1"/>', '<color rgba="0 0 1 0.5"/>'
    box = '<geometry><box size="1 1 1"/></geometry>'
    shapes, *_ = urdf_shapes(
        urdf(
            f'<visual>{box}<material name="mine">{red}</material></visual>',
            f'<visual>{box}<material name="known"/></visual>',
            f"<visual>{box}</visual>",
            f'<visual><origin xyz="3 0 0"/>{box}<material name="known"/></visual>',
            materials=f'<material name="known">{blue}</material>',
        )
    )
    assert {shape.color: extent(shape)[0] for shape in shapes} == pytest.approx(
        {(1.0, 0.0, 0.0, 1.0): 1.0, (0.0, 0.0, 1.0, 0.5): 4.0, (0.7, 0.7, 0.72, 1.0): 1.0}
    )


def test_collision_geometry_is_apart() -> None:
    text = urdf("<collision><geometry><sphere radius='1'/></geometry></collision>")
    assert urdf_shapes(text).shapes == []
    assert len(urdf_shapes(text, "collision").shapes) == 1
    with pytest.raises(sd.SpatialDynError, match="kind is 'both', expected one of visual, collision"):
        urdf_shapes(text, "both")


def test_a_mesh_is_read_scaled_and_placed(tmp_path: Path) -> None:
    (tmp_path / "t.obj").write_text(TRIANGLE)
    path = tmp_path / "r.urdf"
    path.write_text(urdf(MESH.format(name="t.obj", more=' scale="1 -2 1"')))
    (shape,), missing, _ = urdf_shapes(path)
    assert missing == []
    assert sorted(shape.vertices.tolist()) == [[0.0, -4.0, 5.0], [0.0, 0.0, 5.0], [1.0, 0.0, 5.0]]
    a, b, c = shape.vertices[shape.faces[0]]
    assert np.cross(b - a, c - a)[2] > 0.0  # a mirrored mesh is not turned inside out


@pytest.mark.parametrize("slashes", ["//", "///"])
def test_packages_are_found_above_the_file_and_where_they_are_listed(
    slashes: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH"):
        monkeypatch.delenv(name, raising=False)
    mesh = tmp_path / "ws" / "arm" / "meshes" / "t.obj"
    mesh.parent.mkdir(parents=True)
    (tmp_path / "ws" / "arm" / "urdf").mkdir()
    mesh.write_text(TRIANGLE)
    name = f"package:{slashes}arm/meshes/t.obj"
    inside, outside = tmp_path / "ws" / "arm" / "urdf" / "r.urdf", tmp_path / "r.urdf"
    assert find_mesh(name, inside) == mesh
    assert find_mesh(name, outside) is None
    assert find_mesh(name, outside, [tmp_path / "ws"]) == mesh
    assert find_mesh(name, None, [tmp_path / "ws" / "arm"]) == mesh
    assert find_mesh(name.replace("arm", "leg"), inside, [tmp_path / "ws"]) is None
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"/nowhere:{tmp_path / 'ws'}")
    assert find_mesh(name, outside) == mesh
    assert find_mesh(f"file://{mesh}", None) == mesh
    assert find_mesh("../meshes/t.obj", inside) == inside.parent / "../meshes/t.obj"
    assert find_mesh("http://example.org/t.obj", inside) is None


@pytest.mark.parametrize("scheme", ["package", "model"])
@pytest.mark.parametrize(
    "inside",
    ["../t.obj", "meshes/../../t.obj", "meshes/../t.obj", "%2e%2e/t.obj", "%2E%2E%2Ft.obj", "..%2ft.obj", "..\\t.obj",
     "meshes\\..\\..\\t.obj"],
)  # fmt: skip
def test_a_name_that_leaves_its_package_is_refused(scheme: str, inside: str, tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "arm", tmp_path / "arm" / "meshes", tmp_path / "arm" / "%2e%2e"):
        folder.mkdir(exist_ok=True)
        (folder / "t.obj").write_text(TRIANGLE)
    path = tmp_path / "r.urdf"
    for name in (f"{scheme}://arm/{inside}", f"{scheme}://{inside}"):
        with pytest.raises(NotDrawnError, match=r"holds \.\., expected a path below its package"):
            find_mesh(name, path, [tmp_path])
        path.write_text(urdf(MESH.format(name=name, more="")))
        shapes, missing, _ = urdf_shapes(path, package_dirs=[tmp_path])
        assert (shapes, missing) == ([], [f"{name} holds .., expected a path below its package"])


@pytest.mark.parametrize("inside", ["/t.obj", "//t.obj", "/./t.obj"])
def test_an_absolute_name_in_a_package_is_one_below_it(inside: str, tmp_path: Path) -> None:
    (tmp_path / "arm").mkdir()
    name = f"package://arm/{tmp_path}/{inside}"
    (tmp_path / "t.obj").write_text(TRIANGLE)
    assert find_mesh(name, None, [tmp_path]) is None
    (tmp_path / "arm" / "t.obj").write_text(TRIANGLE)
    assert find_mesh(f"package://arm{inside}", None, [tmp_path]) == tmp_path / "arm" / "t.obj"


def test_meshes_that_are_missing_or_broken_are_named(tmp_path: Path) -> None:
    (tmp_path / "bad.stl").write_text("no triangles")
    path = tmp_path / "r.urdf"
    lost = [MESH.format(name=name, more="") for name in ("package://x/y.stl", "package://x/y.stl", "bad.stl")]
    path.write_text(urdf(*lost, primitive('<sphere radius="1"/>')))
    shapes, missing, _ = urdf_shapes(path)
    assert len(shapes) == 1
    assert missing[0] == "package://x/y.stl is not found"
    assert missing[1].startswith("bad.stl ")
    assert len(missing) == 2


def test_a_file_that_changes_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "t.obj"
    path.write_text(TRIANGLE)
    before, *_ = mesh_shapes("a", str(path), 1.0)
    path.write_text(TRIANGLE.replace("1 0 0", "7 0 0"))
    after, *_ = mesh_shapes("a", str(path), 1.0)
    assert [extent(x[0])[0] for x in (before, after)] == [1.0, 7.0]
    assert mesh_shapes("a", "nowhere.obj", 1.0) == ([], ["nowhere.obj is not found"], [])


COLLADA = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><up_axis>Z_UP</up_axis></asset>
<library_images>{image}</library_images>
<library_effects>
  <effect id="plain"><profile_COMMON><technique sid="c"><phong><diffuse><color>1 0 0 1</color></diffuse></phong>
    </technique></profile_COMMON></effect>
  <effect id="covered"><profile_COMMON>
    <newparam sid="surface"><surface type="2D"><init_from>{init}</init_from></surface></newparam>
    <newparam sid="sampler"><sampler2D><source>{source}</source></sampler2D></newparam>
    <technique sid="c"><phong><diffuse><texture texture="sampler" texcoord="UV"/></diffuse></phong></technique>
  </profile_COMMON></effect>
</library_effects>
<library_materials><material id="one"><instance_effect url="#plain"/></material>
  <material id="two"><instance_effect url="{effect}"/></material></library_materials>
<library_geometries>{geometries}</library_geometries>
<library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
GEOMETRY = """<geometry id="g{0}"><mesh><source id="p{0}"><float_array id="a{0}" count="9">0 0 {0} 1 0 {0} 0 2 {0}
  </float_array><technique_common><accessor source="#a{0}" count="3" stride="3"><param name="X" type="float"/>
  <param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
  <vertices id="v{0}"><input semantic="POSITION" source="#p{0}"/></vertices>
  <triangles count="1" material="m"><input semantic="VERTEX" source="#v{0}" offset="0"/><p>0 1 2</p></triangles>
  </mesh></geometry>"""
NODE = """<node><instance_geometry url="#g{}"><bind_material><technique_common>
  <instance_material symbol="m" target="{}"/></technique_common></bind_material></instance_geometry></node>"""
WHOLE = {
    "image": '<image id="i"><init_from>no.png</init_from></image>', "init": "i", "source": "surface",
    "effect": "#covered", "target": "#two",
}  # fmt: skip
BROKEN = [  # what of the file is not as it should be, and a word of what is said
    ("image", "", "image"),
    ("init", "j", "image"),
    ("source", "elsewhere", "surface elsewhere"),
    ("effect", "#none", "Effect not found"),
    ("target", "#none", "Material #none"),
]


def collada(**broken: str) -> str:
    """A file of two triangles, at heights 1 and 2 and of materials one and two."""
    given = WHOLE | broken
    nodes = NODE.format(1, "#one") + NODE.format(2, given.pop("target"))
    return COLLADA.format(geometries=GEOMETRY.format(1) + GEOMETRY.format(2), nodes=nodes, **given)


@pytest.mark.parametrize(("part", "value", "said"), BROKEN)
def test_a_broken_material_leaves_the_triangles(part: str, value: str, said: str, tmp_path: Path) -> None:
    pytest.importorskip("collada")
    (tmp_path / "t.dae").write_text(collada(**{part: value}))
    path = tmp_path / "r.urdf"
    path.write_text(urdf(MESH.format(name="t.dae", more="")))
    shapes, missing, faulty = urdf_shapes(path)
    assert missing == []
    heights = {round(float(z), 9) for shape in shapes for z in shape.vertices[:, 2]}
    assert heights == {6.0, 7.0}
    assert next(x.color for x in shapes if x.vertices[0, 2] == pytest.approx(6.0)) == (1.0, 0.0, 0.0, 1.0)
    assert len(faulty) == 1
    assert faulty[0].startswith("t.dae: ")
    with pytest.warns(UserWarning, match='robot "r": 1 mesh file is broken in part, what is sound is drawn: "t.dae: '):
        drawn = robot_shapes(sd.load_urdf(path), "visual")
    assert (len(drawn.shapes), drawn.missing, drawn.faulty) == (len(shapes), [], faulty)
    assert said in faulty[0]


def test_a_sound_file_has_no_fault(tmp_path: Path) -> None:
    pytest.importorskip("collada")
    (tmp_path / "t.dae").write_text(collada())
    shapes, missing, faulty = mesh_shapes("a", str(tmp_path / "t.dae"), 1.0)
    assert ({float(shape.vertices[0, 2]) for shape in shapes}, missing, faulty) == ({1.0, 2.0}, [], [])


def test_a_file_without_triangles_says_what_is_broken(tmp_path: Path) -> None:
    pytest.importorskip("collada")
    (tmp_path / "t.dae").write_text(collada().replace("0 1 2</p>", "0 1 x</p>"))
    shapes, missing, faulty = mesh_shapes("a", str(tmp_path / "t.dae"), 1.0)
    assert (shapes, faulty) == ([], [])
    assert missing[0].startswith(f"{tmp_path / 't.dae'} holds no triangles (")


def test_units_of_collada_are_metres(tmp_path: Path) -> None:
    pytest.importorskip("collada")
    path = tmp_path / "t.dae"
    trimesh.creation.box((1.0, 1.0, 1.0)).export(path)
    whole, *_ = mesh_shapes("a", str(path), 1.0)
    text = path.read_text()
    assert "<unit" not in text
    path.write_text(text.replace("</asset>", '<unit name="millimeter" meter="0.001"/></asset>'))
    small, *_ = mesh_shapes("a", str(path), 1.0)
    assert extent(small[0]) == pytest.approx(np.multiply(extent(whole[0]), 1e-3))


def test_a_cone_has_its_tip_above() -> None:
    cone = coal_shape("a", pytest.importorskip("coal").Cone(0.5, 2.0), (1.0, 1.0, 1.0, 1.0))
    assert cone is not None
    radius, z = np.hypot(*cone.vertices[:, :2].T), cone.vertices[:, 2]
    np.testing.assert_allclose(radius[z > 0.0], 0.0, atol=1e-12)
    np.testing.assert_allclose(z[radius > 0.0], -1.0, rtol=1e-12)
    np.testing.assert_allclose(np.ptp(cone.vertices, axis=0), [1.0, 1.0, 2.0], rtol=1e-12)


def test_sharp_edges_have_a_vertex_for_each_side_and_smooth_ones_share() -> None:
    can = coal_shape("a", type("Cylinder", (), {"radius": 1.0, "halfLength": 1.0}), (1.0, 1.0, 1.0, 1.0))
    ball = coal_shape("a", type("Sphere", (), {"radius": 1.0}), (1.0, 1.0, 1.0, 1.0))
    assert can is not None
    assert ball is not None
    rim = np.isclose(np.linalg.norm(can.vertices[:, :2], axis=1), 1.0)
    assert rim.sum() == 2 * len(np.unique(can.vertices[rim].round(9), axis=0))
    assert len(ball.vertices) == len(np.unique(ball.vertices.round(9), axis=0))
    capsule = type("Capsule", (), {"radius": 0.5, "halfLength": 1.0})()
    egg = type("Ellipsoid", (), {"radii": np.array([1.0, 2.0, 3.0])})()
    for given, extent in ((capsule, (1.0, 1.0, 3.0)), (egg, (2.0, 4.0, 6.0))):
        drawn = coal_shape("a", given, (1.0, 1.0, 1.0, 1.0))
        assert drawn is not None
        assert np.ptp(drawn.vertices, axis=0) == pytest.approx(extent, rel=1e-2)
        assert drawn.vertices.max(axis=0) == pytest.approx(-drawn.vertices.min(axis=0), abs=1e-12)
    assert coal_shape("a", object(), (1.0, 1.0, 1.0, 1.0)) is None


# --- inertias --------------------------------------------------------------------------------------------


def solid(mass: float, sides: tuple[float, float, float], com: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Link:
    """A box of even density."""
    a, b, c = np.square(sides) * mass / 12.0
    return make_link("a", (mass, com, np.diag([b + c, a + c, a + b])))


def test_the_box_of_an_even_box_is_itself() -> None:
    X, sides = box_of(solid(3.0, (1.0, 2.0, 4.0), (0.1, 0.2, 0.3)))
    assert sorted(sides) == pytest.approx([1.0, 2.0, 4.0])
    assert X[:3, 3] == pytest.approx([0.1, 0.2, 0.3])
    assert np.linalg.det(X[:3, :3]) == pytest.approx(1.0)


def test_an_inertia_that_no_body_has_is_red() -> None:
    wrong = make_link("b", (1.0, (0.0, 0.0, 0.0), np.diag([1.0, 1.0, 5.0])))
    shapes = inertia_boxes([solid(1.0, (1.0, 1.0, 1.0)), wrong], 1.0)
    assert next(shape.color for shape in shapes if shape.link == "a") == BOX
    assert next(shape.color for shape in shapes if shape.link == "b") == WRONG
    assert inertia_boxes([Link("c")], 1.0) == []
    with pytest.raises(InertiaError):
        make_link("d", (-1.0, (0.0, 0.0, 0.0), np.eye(3)))


def test_axes_lie_along_joints() -> None:
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    assert turned_to(axis) @ [0.0, 0.0, 1.0] == pytest.approx(axis)
    b = sd.ModelBuilder("r").add_body("x", joint="prismatic", axis=axis).add_body("y", "x", joint="spherical")
    b.add_body("z", "y", joint="fixed", placement=(3.0, 4.0, 0.0))
    robot = b.robot()
    rod, ball = joint_axes(robot, 1.0)
    assert abs(rod.vertices @ axis).max() == pytest.approx(0.08, rel=0.05)
    assert (rod.link, ball.link) == ("x", "y")
    assert reach(robot) == pytest.approx(5.0)
    assert reach(sd.ModelBuilder("r").robot()) == 1.0
