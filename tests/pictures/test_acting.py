"""What acts, as it is drawn, held against the numbers: ground, points, impulses, places of constraints, forces."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_viewer import recording

import spatialdyn as sd
from spatialdyn.commands import cli
from spatialdyn.pictures import acting as acting_module
from spatialdyn.pictures.acting import ARROW, CUT, IMPULSE, LONGEST, as_bytes
from spatialdyn.pictures.ground import surface

pytest.importorskip("viser")
SINGLE = 2e-6  # what viser keeps is float32, of lengths of a few metres
SIDES = np.array([0.3, 0.2, 0.1])
SLOPE = sd.Plane((0.3, -0.1, 1.0), 0.05)
HILLS = sd.Heightfield(0.05 * np.sin(np.arange(42.0)).reshape(6, 7), 0.25, (-0.6, -0.7))
MU = 0.5


@pytest.fixture
def view() -> Iterator[Any]:
    """``sd.view`` without a browser; servers end with the test."""
    made = []

    def call(*arguments: Any, **named: Any) -> Any:
        made.append(sd.view(*arguments, **({"open": False} | named)))
        return made[-1]

    yield call
    for one in made:
        one.close()


def nodes(shown: Any) -> dict[str, Any]:
    """Handles of viser's scene, by name."""
    return dict(shown.server.scene._handle_from_node_name)


def ending(shown: Any, name: str) -> Any:
    """The one handle whose name ends so."""
    (found,) = (handle for node, handle in nodes(shown).items() if node.endswith(f"/{name}"))
    return found


def box() -> sd.Model:
    """A free box with a frame in each corner."""
    inertia = (2.0, (0.0, 0.0, 0.0), 2.0 / 12.0 * np.diag((SIDES**2).sum() - SIDES**2))
    builder = sd.ModelBuilder("box").add_body("box", None, "floating", inertia=inertia)
    for k, signs in enumerate(np.array(np.meshgrid(*3 * [[-1, 1]], indexing="ij")).reshape(3, -1).T):
        builder.add_body(f"c{k}", "box", "fixed", placement=0.5 * signs * SIDES)
    return builder.build()


def contacts_of(model: sd.Model, terrain: Any = None, radius: float = 0.01) -> sd.Contacts:
    return sd.Contacts(model, {f"c{k}": radius for k in range(8)}, friction=MU, terrain=terrain)


def dropped(terrain: Any = None) -> sd.Trajectory:
    """A box that falls on its corners, turning."""
    model = box()
    contacts = contacts_of(model, terrain)
    q = np.array([0.05, 0.02, 0.0, 0.2, 0.3, 0.1, 0.9])
    q[3:] /= np.linalg.norm(q[3:])
    q[2] += 0.03 - sd.contact_gaps(model, contacts, q).min()
    return sd.simulate(
        sd.Scene(model, contacts=contacts), q, [0.3, 0.0, -1.0, 0.0, 1.0, 2.0], 0.3, 1e-3, record="contacts"
    )


def four_bar() -> sd.Scene:
    """A crank, a coupler and a rocker, closed by a pin."""

    def rod(length: float) -> Any:
        return length, (0.0, 0.0, 0.5 * length), length * np.diag([length**2 / 12.0, length**2 / 12.0, 1e-4])

    builder = sd.ModelBuilder("four_bar").add_body("crank", None, "revolute", (0, 1, 0), None, rod(0.3))
    builder.add_body("coupler", "crank", "revolute", (0, 1, 0), (0.0, 0.0, 0.3), rod(0.7))
    builder.add_body("rocker", None, "revolute", (0, 1, 0), (0.6, 0.0, 0.0), rod(0.5))
    builder.add_body("end", "coupler", "fixed", placement=(0.0, 0.0, 0.7))
    builder.add_body("pin", "rocker", "fixed", placement=(0.0, 0.0, 0.5))
    model = builder.build()
    return sd.Scene(model, constraints=sd.Constraints(model, [sd.HingeConstraint("end", "pin", axis=(0, 1, 0))]))


# --- ground and points -----------------------------------------------------------------------------------


@pytest.mark.parametrize("terrain", [None, SLOPE])
def test_a_plane_is_drawn_where_it_is(terrain: Any, view: Any) -> None:
    model = box()
    shown = view(sd.Scene(model, contacts=contacts_of(model, terrain)))
    drawn, plane = nodes(shown)["/ground"], terrain or sd.Plane()
    assert "/floor" not in nodes(shown)
    assert np.array(plane.normal) @ drawn.position == pytest.approx(plane.height, abs=SINGLE)
    x, y, z = drawn.wxyz[1:]
    up = np.array([2 * (x * z + drawn.wxyz[0] * y), 2 * (y * z - drawn.wxyz[0] * x), 1 - 2 * (x * x + y * y)])
    assert up == pytest.approx(np.array(plane.normal), abs=SINGLE)


@pytest.mark.parametrize("normal", [(0, 1, 0), (-1, 0, 0), (0, 0, -1), (0.3, -0.1, 1.0)])
def test_the_camera_is_above_a_plane_whichever_way_it_faces(normal: Any, view: Any) -> None:
    """Below it the ground hides the robot."""
    model = box()
    shown = view(sd.Scene(model, contacts=sd.Contacts(model, {"c0": 0.01}, terrain=sd.Plane(normal, -0.5))))
    camera = shown.server.initial_camera
    assert (camera.position - camera.look_at) @ np.array(normal) > 0.0


def test_a_heightfield_is_drawn_as_high_as_contacts_feel_it(view: Any) -> None:
    """Gaps of a point of radius 0 straight above the ground are heights over it, times the slope's cosine."""
    box_around = np.array([[-2.0, -0.2, -1.0], [0.5, 3.0, 1.0]])
    vertices, faces, edges = surface(HILLS, box_around)
    assert vertices.min(axis=0)[:2] == pytest.approx([-2.0, -0.7])
    assert vertices.max(axis=0)[:2] == pytest.approx([0.65, 3.0])
    model = sd.ModelBuilder("p").add_body("p", None, "floating", inertia=(1.0, (0, 0, 0), np.eye(3))).build()
    contacts = sd.Contacts(model, {"p": 0.0}, terrain=HILLS)
    q = np.tile(sd.neutral(model), (len(vertices), 1))
    q[:, :3] = vertices
    assert abs(sd.contact_gaps(model, contacts, q)).max() < 1e-14
    assert len(edges) == 6 * (6 * 4 + 1) + 7 * (5 * 4 + 1)  # cells in four parts, and beyond the rim
    q = np.tile(sd.neutral(model), (len(edges), 1))
    q[:, :3] = edges.mean(axis=1)
    assert abs(sd.contact_gaps(model, contacts, q)).max() < 1e-14
    for triangle in vertices[faces][:: len(faces) // 50]:
        a, b, c = triangle
        assert np.cross(b - a, c - a)[2] > 0.0
    shown = view(sd.Scene(model, contacts=contacts))
    assert nodes(shown)["/ground"].vertices[:, 2].min() == pytest.approx(HILLS.z.min(), abs=SINGLE)


@pytest.mark.parametrize("radius", [0.02, 0.0])
def test_spheres_are_at_their_points_and_as_large(radius: float, view: Any) -> None:
    model = box()
    shown = view(sd.Scene(model, contacts=contacts_of(model, None, radius)))
    for k in range(8):
        ball = ending(shown, f"contact_c{k}")
        assert ball.position == pytest.approx(model.frame(f"c{k}").placement[:3, 3], abs=SINGLE)
        assert ball.radius == (radius or pytest.approx(acting_module.TINY * shown.acting.size))


@pytest.mark.parametrize("terrain", [None, SLOPE, HILLS])
def test_a_scene_of_a_free_robot_is_shown_on_its_ground(terrain: Any, view: Any) -> None:
    model = box()
    contacts = contacts_of(model, terrain)
    shown = view(sd.Scene(model, contacts=contacts))
    assert sd.contact_gaps(model, contacts, shown.q).min() == pytest.approx(0.0, abs=1e-6)


# --- impulses --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("terrain", [None, SLOPE, HILLS])
def test_arrows_are_mean_impulses_at_the_lowest_points(terrain: Any, view: Any) -> None:
    run = dropped(terrain)
    shown = view(run)
    assert run.contacts is not None
    impulses, size = run.contacts.impulse, shown.acting.size
    sizes = np.linalg.norm(impulses, axis=-1)
    assert shown.acting.scale * np.median(sizes[sizes > 0.0]) == pytest.approx(ARROW * size)
    frames = np.arange(0, len(run), 20)
    seen = cut = 0
    for k, _ in zip(range(len(frames)), shown._steps(frames), strict=True):
        last = int(frames[k])
        mean = impulses[last - 19 : last + 1].mean(axis=0) if k else impulses[0]
        gaps = sd.contact_gaps(run.model, run.scene.contacts, run.q[last])
        for p in range(8):
            arrow, wanted = nodes(shown)[f"/impulses/c{p}"], shown.acting.scale * mean[p]
            length = np.linalg.norm(wanted)
            assert arrow.visible == (length > 1e-3 * size)
            if not arrow.visible:
                continue
            seen += 1
            start, end = arrow.points[0]
            centre = np.asarray(sd.frame_placement(run.model, run.q[last], f"c{p}"))[:3, 3]
            assert np.linalg.norm(start - centre) == pytest.approx(0.01, abs=SINGLE)  # its radius
            lower = run.q[last].copy()
            lower[:3] += start - centre
            touched = sd.contact_gaps(run.model, run.scene.contacts, lower)[p]
            assert touched <= gaps[p] - 0.0095  # as near to the ground as a radius takes it
            longest = LONGEST * size
            cut += length > longest
            assert end - start == pytest.approx(wanted * min(1.0, longest / length), abs=SINGLE)
            assert np.array_equal(arrow.colors, as_bytes(CUT if length > longest else IMPULSE))
    assert seen > 10
    assert cut > 0


def test_arrows_of_a_rollout_are_those_of_the_sample_shown(view: Any) -> None:
    model = box()
    scene = sd.Scene(model, contacts=contacts_of(model))
    q = np.tile(sd.neutral(model), (3, 1))
    q[:, 2] = 0.06, 0.08, 0.07
    run = sd.rollout(scene, q, np.zeros((3, model.nv)), dt=1e-3, steps=150, record="contacts")
    assert run.contacts is not None
    for sample in (0, 2):
        shown = view(run, sample=sample)
        assert np.array_equal(shown.acting.impulses, run.contacts.impulse[sample])


def test_without_a_record_no_arrow_is_drawn_but_the_ground_is(view: Any) -> None:
    model = box()
    scene = sd.Scene(model, contacts=contacts_of(model))
    run = sd.simulate(scene, [0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0], np.zeros(6), 0.01, 1e-3)
    drawn = nodes(view(run))
    assert "/ground" in drawn
    assert not [name for name in drawn if name.startswith("/impulses")]
    assert "/ground" not in nodes(view(model))
    assert "/ground" in nodes(view(model, run))


def test_what_acts_is_a_layer(view: Any) -> None:
    run = dropped()
    shown = view(run)
    handles = [nodes(shown)["/ground"], ending(shown, "contact_c0")]
    assert all(x.visible for x in handles)
    shown._switch("what acts", False)
    shown._show_at(len(run) - 1)
    assert not any(x.visible for x in (*handles, *(nodes(shown)[f"/impulses/c{p}"] for p in range(8))))
    shown._switch("what acts", True)
    assert all(x.visible for x in handles)
    shown._show_at(len(run) - 1)
    assert any(nodes(shown)[f"/impulses/c{p}"].visible for p in range(8))


# --- constraints and forces ------------------------------------------------------------------------------


def test_a_loop_is_shown_closed_and_a_line_shows_how_far_it_is_open(view: Any) -> None:
    scene = four_bar()
    model = scene.model
    shown = view(scene)
    assert abs(sd.constraint_error(model, scene.constraints, shown.q)).max() < 1e-10
    q = np.array([0.3, 1.0, 0.1])
    shown.show(q)
    (name,) = (name for name in nodes(shown) if name.split("/")[-1].startswith("between_"))
    ends = [np.asarray(sd.frame_placement(model, q, x))[:3, 3] for x in ("end", "pin")]
    assert nodes(shown)[name].points[0] == pytest.approx(np.array(ends), abs=SINGLE)
    (axis,) = (x for name, x in nodes(shown).items() if name.split("/")[-1].startswith("axis_"))
    along = axis.points[0, 1] - axis.points[0, 0]
    assert along / np.linalg.norm(along) == pytest.approx([0.0, 1.0, 0.0], abs=SINGLE)
    assert axis.points[0].mean(axis=0) == pytest.approx(model.frame("end").placement[:3, 3], abs=SINGLE)


def test_held_points_welds_rods_and_wheels_are_marked(view: Any) -> None:
    model = sd.load_urdf("two_link")
    at, pose = (0.4, 0.0, -0.5), np.eye(4)
    pose[:3, 3] = 0.1, 0.2, 0.3
    for held, node, body in (
        (sd.PointConstraint("tip", axes="xz", at_b=at, name="p"), "held_p", "tip"),
        (sd.WeldConstraint("tip", at_a=pose, at_b=at, name="w"), "held_w", "tip"),
        (sd.DistanceConstraint("tip", length=0.7, at_b=at, name="d"), "held_d", "tip"),
    ):
        shown = view(sd.Scene(model, constraints=sd.Constraints(model, [held])), [0.1, 0.2])
        place = model.frame(body).placement @ (np.eye(4) if held.at_a is None else np.array(held.at_a))
        assert ending(shown, node).position == pytest.approx(place[:3, 3], abs=SINGLE)
        a = (
            np.asarray(sd.frame_placement(model, shown.q, "tip")) @ np.linalg.inv(model.frame("tip").placement)
        ) @ place
        line = ending(shown, f"between_{held.name}")
        assert line.points[0] == pytest.approx(np.array([a[:3, 3], at]), abs=SINGLE)
        mark = ending(shown, f"held_to_{held.name}")
        if isinstance(held, sd.DistanceConstraint):
            assert mark.position == pytest.approx(np.array(at), abs=SINGLE)
        else:
            assert len(mark.points) == (2 if isinstance(held, sd.PointConstraint) else 3)
            assert mark.points.mean(axis=1) == pytest.approx(np.tile(at, (len(mark.points), 1)), abs=SINGLE)
    ball = box()
    rolling = sd.RollingConstraint("box", (0.0, 1.0, 0.0), 0.3, name="r")
    shown = view(sd.Scene(ball, constraints=sd.Constraints(ball, [rolling])), sd.neutral(ball))
    rim = ending(shown, "rolls_r").points
    assert np.linalg.norm(rim, axis=-1) == pytest.approx(np.full(rim.shape[:2], 0.3), abs=SINGLE)
    assert abs(rim[..., 1]).max() < SINGLE


def test_constant_forces_are_drawn_to_one_scale(view: Any) -> None:
    model = sd.load_urdf("two_link")
    fext = np.zeros((model.njoints, 6))
    fext[1, :3], fext[2] = (0.0, 0.0, 2.0), (1.0, 0.0, 0.0, 0.0, 3.0, 0.0)
    shown = view(sd.Scene(model, fext=fext))
    drawn = {name: x for name, x in nodes(shown).items() if "/constant_" in name}
    vectors = {name.rsplit("/")[-2][0] + name.rsplit("_")[-1]: x.points[0, 1] for name, x in drawn.items()}
    size = shown.acting.size
    assert vectors["1force"] == pytest.approx([0.0, 0.0, ARROW * size], abs=SINGLE)
    assert vectors["2force"] == pytest.approx([0.5 * ARROW * size, 0.0, 0.0], abs=SINGLE)
    assert vectors["2moment"] == pytest.approx([0.0, ARROW * size, 0.0], abs=SINGLE)
    assert len(vectors) == 3


# --- files -----------------------------------------------------------------------------------------------


def test_pages_and_the_command_line_have_what_acts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, model = tmp_path / "scene.toml", sd.load_urdf("two_link")
    low = float(np.asarray(sd.frame_placement(model, [0.3, 0.1], "tip"))[2, 3]) - 0.02
    file.write_text(
        f'limits = true\n[contacts]\npoints = {{tip = 0.02}}\n[contacts.terrain]\nkind = "plane"\nheight = {low!r}'
    )
    assert cli.main(["view", "two_link", "--scene", str(file), "--save", str(tmp_path / "a.html")]) == 0
    simulated = ["simulate", "two_link", "--scene", str(file), "--duration", "0.05", "--quiet", "--q0", "0.3,0.1"]
    assert cli.main([*simulated, "--save", str(tmp_path / "b.html"), "--report", str(tmp_path / "c.html")]) == 0
    capsys.readouterr()
    for name in ("a", "b"):
        text = str(recording((tmp_path / f"{name}.html").read_text(encoding="utf-8")))
        assert "/ground" in text
        assert "contact_tip" in text
        assert ("/impulses/tip" in text) == (name == "b")
    assert cli.main(["view", "two_link", "--scene", str(tmp_path / "none.toml")]) != 0
