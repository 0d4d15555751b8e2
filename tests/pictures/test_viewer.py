"""``sd.view`` without a browser: what is in viser's scene, where it is, and the pages."""

from __future__ import annotations

import gc
import re
import subprocess
import sys
import threading
import time
import warnings
import weakref
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from inputs import PACKAGE

import spatialdyn as sd
from spatialdyn.pictures import stage as stage_module
from spatialdyn.pictures import view as view_module
from spatialdyn.pictures import viewer as viewer_module
from spatialdyn.pictures.controls import slider_ends
from spatialdyn.pictures.motions import frames, motion_of
from spatialdyn.pictures.view import resting

pytest.importorskip("viser")

BODY = (
    "<link name='{0}'><inertial><mass value='1'/><inertia ixx='.1' iyy='.1' izz='.1' ixy='0' ixz='0' iyz='0'/>"
    "</inertial>{1}</link>"
)
BALL = "<visual><geometry><sphere radius='0.1'/></geometry></visual>"
LOST = "<visual><geometry><mesh filename='package://gone/a.stl'/></geometry></visual>"
JOINT = (
    "<joint name='{0}' type='revolute'><parent link='{1}'/><child link='{2}'/><origin xyz='0 0 1'/><axis xyz='0 1 0'/>"
    "<limit lower='-2' upper='1' effort='1' velocity='1'/></joint>"
)
SINGLE = 1e-6  # poses go to browsers as float32


def text(*visuals: str) -> str:
    """A chain of links, one a visual."""
    links = "".join(BODY.format(f"l{k}", visual) for k, visual in enumerate(visuals))
    joints = "".join(JOINT.format(f"j{k}", f"l{k - 1}", f"l{k}") for k in range(1, len(visuals)))
    return f"<robot name='chain'>{links}{joints}</robot>"


@pytest.fixture
def chain(tmp_path: Path) -> sd.Model:
    path = tmp_path / "chain.urdf"
    path.write_text(text(BALL, BALL, BALL))
    return sd.load_urdf(path)


@pytest.fixture
def view() -> Iterator[Any]:
    """``sd.view`` without a browser; servers end with the test."""
    made = []

    def call(*arguments: Any, **named: Any) -> Any:
        made.append(sd.view(*arguments, **({"open": False} | named)))
        return made[-1]

    yield call
    for scene in made:
        scene.close()


def nodes(scene: Any) -> dict[str, Any]:
    """Handles of viser's scene, by name."""
    return dict(scene.server.scene._handle_from_node_name)


def swing(model: sd.Model, count: int = 40) -> Any:
    return np.linspace(0.0, 0.8, count)[:, None] * np.ones(model.nq)


def trajectory(model: sd.Model, count: int = 51) -> sd.Trajectory:
    """A motion of 0.5 s."""
    q, t = swing(model, count), np.linspace(0.0, 0.5, count)
    return sd.Trajectory(t, q, 0.0 * q, 0.0 * q, 0.0 * q, 0.0 * t, "none", 0.01, model.name, model=model)


# --- what is drawn and where -----------------------------------------------------------------------------


def test_bodies_are_where_kinematics_puts_their_links(chain: sd.Model, view: Any) -> None:
    q = np.array([0.3, -0.7])
    scene = view(chain, q)
    X = sd.frame_placement(chain, q, "l2")
    body = nodes(scene)["/robot/2_l2"]
    assert body.position == pytest.approx(X[:3, 3], abs=SINGLE)
    assert stage_module.quaternions(X[:3, :3]) == pytest.approx(body.wxyz, abs=SINGLE)
    scene.show([0.0, 0.0])
    assert body.position == pytest.approx([0.0, 0.0, 2.0], abs=SINGLE)
    assert "/robot/1_l1/l1" in nodes(scene)


def test_a_floating_base_moves(chain: sd.Model, view: Any) -> None:
    model = sd.load_urdf(chain.robot.source, root="floating")
    q = np.array([1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
    scene = view(model, q)
    assert nodes(scene)["/robot/1_l0"].position == pytest.approx([1.0, 2.0, 3.0])


def test_mimic_joints_move(view: Any) -> None:
    b = sd.ModelBuilder("gripper").add_body("a", joint="prismatic", axis=(1, 0, 0))
    b.add_body("b", joint="prismatic", axis=(1, 0, 0), mimic={"leader": "a_joint", "multiplier": -1.0})
    scene = view(b.build(mimic=True), [0.25])
    assert nodes(scene)["/robot/2_b"].position == pytest.approx([-0.25, 0.0, 0.0])


def test_camera_sees_all(chain: sd.Model, view: Any) -> None:
    scene = view(chain, [0.0, 0.0])
    low, high = scene.stage.bounds(scene.stage.shown)
    assert (low[2], high[2]) == pytest.approx((-0.1, 2.1), abs=1e-3)
    camera = scene.server.initial_camera
    assert camera.look_at == pytest.approx([0.0, 0.0, 1.0], abs=1e-3)
    away = np.linalg.norm(camera.position - camera.look_at)
    assert away * np.sin(0.5 * camera.fov) > 1.1
    scene.look([5.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    assert camera.position == pytest.approx([5.0, 0.0, 0.0])


def test_a_long_fall_does_not_take_the_camera_along(chain: sd.Model, view: Any) -> None:
    model = sd.load_urdf(chain.robot.source, root="floating")
    Q = np.tile(sd.neutral(model), (50, 1))
    Q[:, 2] = -(np.linspace(0.0, 30.0, 50) ** 2)
    scene = view(model, Q, 0.1)
    assert -20.0 < scene.server.initial_camera.look_at[2] < 1.0


def test_the_floor_is_at_height_0_by_default(chain: sd.Model, view: Any) -> None:
    model = sd.load_urdf(chain.robot.source, root="floating")
    falls = np.tile(sd.neutral(model), (20, 1))
    falls[:, 2] = np.linspace(1.0, 0.2, 20)  # above the floor from first to last
    for scene in (view(model), view(model, falls, 0.1), view(chain, [2.0, 0.0])):
        assert nodes(scene)["/floor"].position[2] == 0.0
        scene.show(scene.q)
        assert nodes(scene)["/floor"].position[2] == 0.0
    assert nodes(view(model, falls, 0.1, floor=-0.25))["/floor"].position[2] == -0.25
    assert "/floor" not in nodes(view(model, floor=None))
    for floor in ("low", np.nan, True, [0.0]):
        with pytest.raises(sd.SpatialDynError, match=r"floor is .*, expected its height in metres, or None"):
            view(model, floor=floor)


def test_frames_forces_traces_and_the_centre_of_mass_are_drawn(chain: sd.Model, view: Any) -> None:
    scene = view(chain, [0.0, 0.0])
    scene.frame("l2").force("l2", [0.0, 0.0, 4.0]).force("l2", [0.0, 0.0, 2.0, 1.0, 0.0, 0.0])
    scene.trace("l2", swing(chain)).com()
    drawn = nodes(scene)
    first, second = (drawn[f"/robot/2_l2/force_l2{k}"].points[0] for k in ("", "_2"))
    assert np.linalg.norm(first[1] - first[0]) == pytest.approx(0.25 * scene.size)
    assert np.linalg.norm(second[1] - second[0]) == pytest.approx(0.125 * scene.size)
    moment = drawn["/robot/2_l2/moment_l2"].points[0]
    assert np.linalg.norm(moment[1] - moment[0]) == pytest.approx(0.25 * scene.size)
    assert "/robot/2_l2/link_l2" in drawn or "/robot/2_l2/link:l2" in drawn
    path = drawn["/trace_1_l2"].points
    assert path[:, 0] == pytest.approx(sd.frame_placement(chain, swing(chain)[:-1], "l2")[:, :3, 3], abs=SINGLE)
    assert drawn["/com"].position == pytest.approx(sd.center_of_mass(chain, [0.0, 0.0]))
    assert np.ptp(nodes(scene)["/com/cross"].points, axis=(0, 1)) == pytest.approx(3 * [0.35 * scene.size])
    scene.show([0.5, 0.5])
    assert drawn["/com"].position == pytest.approx(sd.center_of_mass(chain, [0.5, 0.5]))
    scene.com([0.1, 0.1])
    assert nodes(scene)["/com_of_q"].position == pytest.approx(sd.center_of_mass(chain, [0.1, 0.1]))


def test_without_geometry_inertias_are_drawn(view: Any) -> None:
    b = sd.ModelBuilder("p").add_body("rod/1", joint="revolute", inertia=(1.0, (0, 0, -0.5), 0.1 * np.eye(3)))
    scene = view(b.build())
    assert [name for name in nodes(scene) if "rod_1/" in name] != []
    by_text = view(sd.load_urdf(text(BALL, BALL)))
    assert "/robot/1_l1/l1_3" in nodes(by_text)  # a box, a ball and an axis
    assert "/robot/1_l1/l1_2" not in nodes(view(sd.load_urdf(text(BALL, BALL)), urdf=text(BALL, BALL)))


def test_missing_meshes_are_named_and_their_links_are_boxes(tmp_path: Path, view: Any) -> None:
    path = tmp_path / "lost.urdf"
    path.write_text(text(BALL, LOST))
    model = sd.load_urdf(path)
    with pytest.warns(
        UserWarning, match=r'robot "chain": 1 mesh is missing.*package://gone/a.stl is not found'
    ) as seen:
        scene = view(model)
    assert seen[0].filename == __file__
    assert scene.missing == ["package://gone/a.stl is not found"]
    assert "/robot/1_l1/l1" in nodes(scene)
    path.unlink()
    with pytest.warns(UserWarning, match=r"lost.urdf is not there any more"):
        assert view(model).missing


def test_a_model_knows_its_file_and_is_the_same_without(chain: sd.Model) -> None:
    other = sd.load_urdf(Path(chain.robot.source).read_text())
    assert chain.robot.source.endswith("chain.urdf")
    assert (other.robot.source, sd.ModelBuilder("r").robot().source) == ("", "")
    assert other == chain
    assert (hash(other), other.key) == (hash(chain), chain.key)
    for made in (chain.reduced(["j2"]), chain.subtree("l1"), chain.with_(gravity=(0, 0, 0))):
        assert made.robot.source == chain.robot.source


# --- motions ---------------------------------------------------------------------------------------------


def test_frames_are_the_nearest_configurations_in_time() -> None:
    t = np.arange(1001) * 1e-3
    shown, times = frames(t, 50.0, 1.0)
    assert shown.tolist() == list(range(0, 1001, 20))
    assert times == pytest.approx(t[::20])
    assert len(frames(t, 50.0, 0.5)[0]) == 101
    assert frames(t, 50.0, 0.5)[1][-1] == pytest.approx(2.0)
    assert frames(np.array([0.0, 1.0, 1.1]), 60.0, 1.0)[0].tolist() == [0, 1, 2]  # nothing is shown twice
    assert frames(np.zeros(1), 60.0, 1.0)[0].tolist() == [0]
    for bad in ({"fps": 0.0, "speed": 1.0}, {"fps": 60.0, "speed": float("nan")}):
        with pytest.raises(sd.SpatialDynError, match="expected a positive number"):
            frames(t, **bad)


def test_motions_are_trajectories_rollouts_and_arrays(chain: sd.Model) -> None:
    run = trajectory(chain)
    assert motion_of(chain, run).t == pytest.approx(run.t)
    many = np.zeros((20, 5, 2)) + np.arange(20)[:, None, None]
    batch = motion_of(chain, sd.Rollout(many, many, 0.5 * np.arange(1.0, 6.0), chain))
    assert batch.q.shape == (16, 5, 2)
    assert batch.t.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]
    with pytest.raises(sd.SpatialDynError, match="rollout holds the last states only"):
        motion_of(chain, sd.Rollout(many[:, -1], many[:, -1], np.array(2.5), chain))
    assert motion_of(chain, many, 0.5, 18).q[0, 0].tolist() == [18.0, 18.0]
    assert motion_of(chain, many[0], 0.5).t.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]
    for arguments, match in (
        ((many[..., :1], 0.5), r"q has shape \(20, 5, 1\), expected"),
        ((many, None), "dt is None"),
        ((many, -1.0), "dt is -1.0, expected a positive"),
        ((many, 0.5, 20), "sample is 20, expected an index from 0 to 19"),
        ((many * np.nan, 0.5), "q is not finite at index 0 of 5"),
    ):
        with pytest.raises(sd.SpatialDynError, match=match):
            motion_of(chain, *arguments)


def test_a_trajectory_is_saved_as_one_page_without_links(chain: sd.Model, view: Any, tmp_path: Path) -> None:
    run = trajectory(chain)
    path = view(run).save(tmp_path / "swing.html", fps=20.0)
    page = path.read_text(encoding="utf-8")
    assert page.lstrip().lower().startswith("<!doctype html")
    assert "__VISER_EMBED_DATA__" in page
    assert re.findall(r'<(?:script|link|img|iframe)[^>]*(?:src|href)="?(?:https?:)?//', page) == []
    assert 0.5e6 < len(page) < 3e6
    still = view(chain).save(tmp_path / "still.html").read_text(encoding="utf-8")
    assert len(still) < len(page)


def test_what_is_recorded_are_the_poses_in_order_and_time(chain: sd.Model, view: Any) -> None:
    recorded = recording(view(chain, swing(chain, 11), 0.1).html(fps=10.0))
    assert recorded["durationSeconds"] == pytest.approx(1.0)
    moved = [m for _, m in recorded["messages"] if m["type"] == "SetPositionMessage" and m["name"] == "/robot/2_l2"]
    assert moved[-1]["position"] == pytest.approx(sd.frame_placement(chain, swing(chain, 11)[-1], "l2")[:3, 3])
    times = [t for t, m in recorded["messages"] if m["type"] == "SetOrientationMessage" and m["name"] == "/robot/1_l1"]
    assert np.unique(np.round(times, 9)).tolist() == pytest.approx(
        (np.arange(1, 11) / 10.0).tolist()
    )  # at 0 it is there


def recording(page: str) -> dict[str, Any]:
    """The messages in a page of viser."""
    import base64

    import msgspec
    import zstandard

    found = re.search(r'__VISER_EMBED_DATA__="([^"]*)"', page)
    assert found
    whole = zstandard.ZstdDecompressor().decompressobj().decompress(base64.b64decode(found[1])[8:])
    size = int.from_bytes(whole[:8], "little")
    return dict(msgspec.msgpack.decode(whole[8 : 8 + size]))


def test_the_first_sample_is_solid_and_others_are_pale(chain: sd.Model, view: Any) -> None:
    Q = np.stack([swing(chain), -swing(chain), 0.5 * swing(chain)])
    scene = view(chain, Q, 0.01)
    next(scene._steps(np.array([39])))
    pale = nodes(scene)["/ghosts/2"]
    assert pale.batched_positions == pytest.approx(sd.frame_placement(chain, Q[1:, 39], "l2")[:, :3, 3], abs=SINGLE)
    assert nodes(scene)["/robot/2_l2"].position == pytest.approx(
        sd.frame_placement(chain, Q[0, 39], "l2")[:3, 3], abs=SINGLE
    )
    assert "/ghosts/2" not in nodes(view(chain, Q, 0.01, sample=1))


def test_play_ends_at_the_last_pose_in_time(chain: sd.Model, view: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda url: opened.append(url))
    monkeypatch.setattr(viewer_module, "has_screen", lambda: False)
    scene = view(chain, swing(chain, 21), 0.01)
    start = time.monotonic()
    assert scene.play(speed=2.0) is scene
    assert time.monotonic() - start >= 0.1
    assert scene.q == pytest.approx(swing(chain)[-1])
    assert opened == [scene.url]
    with pytest.raises(sd.SpatialDynError, match=r"the view has no motion, expected view\(trajectory\)"):
        view(chain).play()
    with pytest.raises(sd.SpatialDynError, match="speed is 0, expected a positive"):
        scene.play(0)


# --- controls --------------------------------------------------------------------------------------------


def test_the_page_has_its_controls_whether_a_tab_opens_or_not(
    chain: sd.Model, view: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(view_module, "has_screen", lambda: False)
    floating = sd.load_urdf(chain.robot.source, root="floating")
    for opens in (False, None):
        for scene, wanted in (
            (view(chain, open=opens), {"j1", "j2"}),
            (view(floating, open=opens), {f"root_joint {part}" for part in "xyz"} | {"j1"}),
            (view(chain, swing(chain), 0.1, open=opens), {"time [s]", "play / pause", "speed"}),
        ):
            labels = {handle.label for handle in scene.server.gui._gui_input_handle_from_uuid.values()}
            assert labels >= wanted | {"inertia", "frames", "centre of mass"}


def test_a_scene_whose_tab_is_open_lives_until_it_is_closed(chain: sd.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("webbrowser.open", lambda url: None)
    alive = weakref.ref(sd.view(chain, open=True))
    gc.collect()
    assert alive() is not None
    alive().close()
    gc.collect()
    assert alive() is None


class Event:
    """A hand on a control of the page."""

    def __init__(self, target: Any = None, client_id: int | None = 1) -> None:
        self.target, self.client_id = target, client_id


def test_sliders_end_at_the_limits_and_move_the_robot(chain: sd.Model, view: Any) -> None:
    scene = view(chain)
    (_, first), (_, second) = scene._controls.handles
    assert (first.min, first.max, first.label) == (-2.0, 1.0, "j1")
    second.value = 0.5
    scene._controls.slid(Event(second))
    assert scene.q == pytest.approx([0.0, 0.5])
    scene.show([0.25, 0.0])
    assert (first.value, second.value) == (0.25, 0.0)
    scene._controls.slid(Event(second, client_id=None))  # set by show: no circle
    assert scene.q == pytest.approx([0.25, 0.0])


def test_sliders_of_a_floating_base_are_displacements(chain: sd.Model, view: Any) -> None:
    model = sd.load_urdf(chain.robot.source, root="floating")
    scene = view(model)
    shown = scene._controls.handles
    assert [handle.label for _, handle in shown[2:4]] == ["root_joint z", "root_joint turn x"]
    assert len(shown) == 8
    scene._controls.handles[5][1].value = np.pi / 2
    scene._controls.slid(Event())
    assert scene.q[3:7] == pytest.approx([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
    assert slider_ends(model, model.joints[1], 0) == (-1.0, 1.0)
    assert slider_ends(model, model.joints[1], 5) == (-np.pi, np.pi)


def test_layers_are_drawn_when_they_are_first_shown(chain: sd.Model, view: Any) -> None:
    scene = view(chain)
    before = len(nodes(scene))
    scene._switch("inertia", True)
    scene._switch("frames", True)
    scene._switch("centre of mass", True)
    assert len(nodes(scene)) > before + 4
    scene._switch("visual", False)
    assert not nodes(scene)["/robot/1_l1/l1"].visible
    scene._switch("visual", True)
    assert nodes(scene)["/robot/1_l1/l1"].visible


def test_the_player_of_a_page_plays_and_pauses(chain: sd.Model, view: Any) -> None:
    scene = view(chain, swing(chain, 101), 0.01)
    handles = {h.label: h for h in scene.server.gui._gui_input_handle_from_uuid.values()}
    slider = handles["time [s]"]
    slider.value = 0.5
    for call in slider._impl.update_cb:
        call(Event(slider))
    assert scene.q == pytest.approx(swing(chain, 101)[50])
    press = handles["play / pause"]._impl.update_cb[0]
    press(Event())
    until = time.monotonic() + 60.0
    while slider.value < 1.0 and time.monotonic() < until:
        time.sleep(0.01)
    assert slider.value == 1.0
    assert scene.q == pytest.approx(swing(chain, 101)[-1])


# --- notebooks, servers, errors --------------------------------------------------------------------------


def test_a_notebook_shows_the_page_of_a_pose_and_the_player_of_a_motion(chain: sd.Model, view: Any) -> None:
    still = view(chain)
    assert re.match(rf'<iframe src="{still.url}" width="100%" height="480"', still._repr_html_())
    assert view(chain, swing(chain), 0.01)._repr_html_().startswith('<iframe srcdoc="&lt;!')


def test_play_shows_a_player_once_in_a_cell_of_a_notebook_at_its_speed(
    chain: sd.Model, view: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[dict[str, str]] = []
    cell = 1
    monkeypatch.setattr(viewer_module, "in_notebook", lambda: True)
    monkeypatch.setattr(viewer_module, "notebook_cell", lambda: cell)
    display = SimpleNamespace(display=lambda player, raw: shown.append(player))
    monkeypatch.setattr(viewer_module, "import_module", lambda name: display)
    scene = view(chain, swing(chain, 11), 0.1)
    speeds: list[float] = []
    monkeypatch.setattr(scene, "html", lambda speed=1.0: f"<p>{speeds.append(speed)}")
    assert scene.play(speed=0.5) is scene
    assert [set(player) for player in shown] == [{"text/html", "text/plain"}]
    assert speeds == [0.5]
    assert scene._repr_html_() is None  # the value of the cell is not shown beside it
    cell = 2
    assert scene._repr_html_().startswith("<iframe")


def test_a_tab_opens_for_a_model_only_where_there_is_a_screen(
    chain: sd.Model, view: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda url: opened.append(url))
    for screen, more, count in ((False, (), 0), (True, (), 1), (True, (swing(chain), 0.1), 1)):
        monkeypatch.setattr(view_module, "has_screen", lambda screen=screen: screen)
        view(chain, *more, open=None)
        assert len(opened) == count
    monkeypatch.setattr(view_module, "in_notebook", lambda: True)
    view(chain, open=None)
    assert len(opened) == 1


def test_a_scene_that_is_dropped_ends_its_server(chain: sd.Model) -> None:
    before = threading.active_count()
    for motion in ((), (swing(chain), 0.1)) * 2:
        assert len(sd.view(chain, *motion, open=False).html()) > 1000
    gc.collect()
    until = time.monotonic() + 10.0
    while threading.active_count() > before and time.monotonic() < until:
        time.sleep(0.02)
    assert threading.active_count() <= before


def test_nothing_is_printed_and_the_server_is_of_this_machine_alone() -> None:
    code = "import spatialdyn as sd; s = sd.view(sd.load_urdf('two_link'), open=False); assert s.url, s.html()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=PACKAGE.parent, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert stage_module.HOST == "127.0.0.1"


def test_import_loads_none_of_it() -> None:
    code = (
        "import sys, spatialdyn; print(*{'viser', 'trimesh', 'yourdfpy', 'websockets', 'http.server'} & {*sys.modules})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=PACKAGE.parent, check=True)
    assert done.stdout.split() == []


def test_without_viser_the_error_says_what_to_install(chain: sd.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("viser", "trimesh"):
        with monkeypatch.context() as hidden:
            hidden.setitem(sys.modules, name, None)
            with pytest.raises(sd.SpatialDynError, match="pip install viser pycollada"):
                sd.view(chain, open=False)


def test_bad_arguments_are_named(chain: sd.Model, view: Any, tmp_path: Path) -> None:
    scene = view(chain)
    run = trajectory(chain)
    for call, match in (
        (lambda: sd.view("panda"), "model is a str"),
        (
            lambda: sd.view(chain, open=False, shapes="all"),
            "shapes is 'all', expected one of visual, collision, inertia",
        ),
        (lambda: sd.view(run, run.q), "q is given beside a Trajectory"),
        (lambda: sd.view(sd.Trajectory(**{**vars(run), "model": None})), "the Trajectory does not know its model"),
        (lambda: scene.show([0.0]), "q has shape"),
        (lambda: scene.show([[0.0, 0.0]]), r"q has shape \(1, 2\), expected \(2,\)"),
        (lambda: scene.show([np.nan, 0.0]), "poses are not finite"),
        (lambda: scene.frame("l9"), 'frame "l9" is not in robot'),
        (lambda: scene.force("l1", [1.0]), r"force has shape \(1,\), expected \(3,\) or \(6,\)"),
        (lambda: scene.force("l1", [np.inf, 0.0, 0.0]), "expected finite numbers"),
        (lambda: scene.save(tmp_path / "x.png"), "expected a name that ends in .html"),
        (lambda: scene.save(tmp_path / "no" / "x.html"), "expected a file to write"),
    ):
        with pytest.raises(sd.SpatialDynError, match=match):
            call()


def test_resting_is_neutral_within_the_limits() -> None:
    b = sd.ModelBuilder("r").add_body("a", limits=(0.5, 1.0)).add_body("b", joint="spherical")
    assert resting(b.build()).tolist() == [0.5, 0.0, 0.0, 0.0, 1.0]


def test_warnings_of_numpy_do_not_hide(chain: sd.Model, view: Any) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        view(sd.load_urdf("tree"))
        view(sd.load_urdf("floating_body", root="floating"), shapes="inertia")
