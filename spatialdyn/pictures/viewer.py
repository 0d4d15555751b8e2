"""``View``, the result of ``sd.view``: a robot and the effects on it in viser, at rest or in motion."""

from __future__ import annotations

import time
import weakref
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array
from ..calls.dynamics import calls
from ..calls.files import check_ending
from ..constraints.contact_points import Plane
from ..engines import locks
from ..errors import NonFiniteError, ShapeError, SpatialDynError, literal
from ..model.model import Frame
from ..simulation.scene import Scene
from .acting import FORCE, MOMENT, Acting
from .controls import Player, Sliders, add_layers, weakly
from .inertia_shapes import reach
from .markup import PAGE_FILES
from .mesh_files import Color, Folder
from .motions import Motion, frames, motion_of
from .progress_bar import in_notebook, notebook_cell
from .robot_shapes import SHAPES, robot_shapes
from .shapes import Shape
from .stage import Stage, has_screen, page_frame

Array = NDArray[np.float64]
ACTS = "what acts"
LAYERS = (*SHAPES, "frames", "centre of mass", ACTS)
COM: Color = (0.95, 0.55, 0.05, 1.0)
TRACES: tuple[Color, ...] = ((0.15, 0.2, 0.35, 1.0), (0.6, 0.4, 0.2, 1.0), (0.5, 0.55, 0.15, 1.0))
ARROW = 0.25  # of the robot's size: length of the first force, and of the first moment
WAIT = 20.0  # seconds that ``play`` waits for a browser


class View:
    """A picture of a robot and of the effects on it, made by ``sd.view``.

    scene    the Scene
    model    its Model
    q        (nq,) the configuration shown [rad | m]
    size     of the robot [m], the scale of arrows and frames
    missing  the meshes that are not drawn, a line each: the name in the URDF and the reason
    faulty   the meshes that are drawn without broken elements of their files, likewise
    server   viser's server: ``server.scene`` and ``server.gui`` accept further drawings
    stage    the bodies in the picture
    acting   the effects on the bodies
    """

    def __init__(
        self,
        scene: Scene,
        q: ArrayLike,
        motion: Motion | None,
        impulses: Array | None,
        shapes: str,
        urdf: Any,
        package_dirs: Sequence[Folder],
        floor: float | None,
        host: str,
        port: int,
    ) -> None:
        """The arguments are described in ``view``."""
        model = scene.model
        self.scene, self.model, self.motion, self.size = scene, model, motion, reach(model.robot)
        self._kind, self._urdf, self._package_dirs = shapes, urdf, package_dirs
        X = self._poses(q)
        drawn, self.missing, self.faulty = robot_shapes(model, shapes, urdf, package_dirs)
        child = {joint.name: joint.child for joint in model.robot.joints}
        names = [
            child.get(joint.name, model.robot.root if joint.kind != "world" else "world") for joint in model.joints
        ]
        self.stage = Stage(names, host, port)
        self.server = self.stage.server
        self._stop = weakref.finalize(self, self.stage.stop)
        self._layers: dict[str, list[Any]] = {shapes: [self._add(shape) for shape in drawn]}
        if motion is not None:
            by_body: dict[int, list[tuple[Array, Shape]]] = {}
            for shape in drawn:
                frame = model.frame(f"link:{shape.link}")
                by_body.setdefault(frame.joint, []).append((frame.placement, shape))
            for body, pairs in by_body.items():
                self.stage.add_ghosts(body, pairs if body else [], len(motion.q) - 1)
        self._scales: dict[str, float] = {}  # metres of arrow for a newton, and for a newton metre
        self._com: Any = None
        self._traces = 0
        self._lock = locks.new()
        self._shown_in: int | None = None  # cell of a notebook
        self.q = np.array(as_array("q", q))
        box = self._box(X)
        t = np.zeros(1) if motion is None else motion.t
        size = max(self.size, 0.25 * float(np.linalg.norm(box[1] - box[0])))
        self.acting = Acting(self.stage, scene, size, box, impulses, t)
        self._controls = self._add_controls()
        if motion is None:
            self.show(q)
        else:
            self._show_at(0)
        terrain = None if scene.contacts is None else scene.contacts.terrain
        up = np.array(terrain.normal) if isinstance(terrain, Plane) else None
        self.stage.look_at(box, None if floor is None or terrain is not None else float(floor), up)

    # --- what is shown -------------------------------------------------------------------------------------

    def show(self, q: ArrayLike) -> View:
        """Show a configuration q (nq,) [rad | m]; returns the view.

        Raises  ShapeError; NonFiniteError if a pose is not finite; ConfigurationError for a quaternion off its norm.
        """
        X = self._poses(q)
        with self._lock, self.stage.at_once():
            self.q = np.array(as_array("q", q))
            self.stage.pose(X)
            self.acting.place(X)
            self._place_com()
            if isinstance(self._controls, Sliders):
                self._controls.follow(self.q)
        return self

    def frame(self, name: str | Frame, length: float | None = None) -> View:
        """Draw the axes of a frame, x red, y green, z blue, which move with it; returns the view.

        name    as ``model.frame`` takes it
        length  of the axes [m]; by default an eighth of the robot's size

        Raises  ModelError for an unknown frame.
        """
        frame = self.model.frame(name)
        length = 0.125 * self.size if length is None else length
        self.stage.add_axes(frame.joint, frame.placement, f"{frame.kind}:{frame.name}", length)
        return self

    def force(self, name: str | Frame, force: ArrayLike, scale: float | None = None) -> View:
        """Draw a force at a frame, magenta, and its moment, teal, which move with the frame; returns the view.

        name   as ``model.frame`` takes it
        force  (3,) force, or (6,) force and moment about the frame's origin, in the frame [N | N m]
        scale  length of an arrow [m/N], [m/(N m)]; by default the arrows of the view's first force and first moment are
               a quarter of the robot's size, and later ones have the same scales

        Raises  ModelError for an unknown frame; ShapeError, NonFiniteError for the force.
        """
        frame, f = self.model.frame(name), as_array("force", force)
        if f.shape not in ((3,), (6,)):
            raise ShapeError(f"force has shape {f.shape}, expected (3,) or (6,)")
        if not np.isfinite(f).all():
            raise NonFiniteError(f"force is {f.tolist()}, expected finite numbers")
        X = frame.placement
        for part, color, word in ((f[:3], FORCE, "force"), (f[3:], MOMENT, "moment")):
            if part.any():
                length = scale
                if length is None:
                    length = self._scales.setdefault(word, ARROW * self.size / float(np.linalg.norm(part)))
                end = X[:3, 3] + length * (X[:3, :3] @ part)
                label = f"{word}_{frame.name}"
                self.stage.add_arrow(frame.joint, X[:3, 3], end, label, color, 0.008 * self.size)
        return self

    def trace(self, name: str | Frame, motion: Any) -> View:
        """Draw the path of a frame's origin; returns the view.

        name    as ``model.frame`` takes it
        motion  Trajectory, Rollout or q (N, nq), (S, N, nq) [rad | m]: a line for each of its first 16 samples

        Raises  ModelError for an unknown frame; ShapeError, NonFiniteError for the motion.
        """
        frame = self.model.frame(name)
        for q in motion_of(self.model, motion, 1.0).q:
            points = np.asarray(calls["frame_placement"](self.model, q, frame))[:, :3, 3]
            color = TRACES[self._traces % len(TRACES)]
            self._traces += 1
            if len(points) > 1:
                self.stage.add_line(points, f"trace_{self._traces}_{frame.name}", color, 0.004 * self.size)
        return self

    def com(self, q: ArrayLike | None = None) -> View:
        """Mark the centre of mass with an orange ball and a cross; returns the view.

        q  (nq,) the configuration [rad | m]; None: the configuration shown, and the mark moves with it
        """
        if q is None:
            if self._com is None:
                self._com = self.stage.add_mark(np.zeros(3), "com", COM, 0.035 * self.size)
            self._place_com()
        else:
            at = np.asarray(calls["center_of_mass"](self.model, as_array("q", q)))
            if at.shape != (3,):
                raise ShapeError(f"q has shape {np.shape(q)}, expected ({self.model.nq},)")
            self.stage.add_mark(at, "com_of_q", COM, 0.035 * self.size)
        return self

    def look(self, position: ArrayLike, at: ArrayLike) -> View:
        """Put the camera at a position (3,) and point it at another (3,) [m]; returns the view."""
        camera = self.server.initial_camera
        camera.position, camera.look_at = as_array("position", position), as_array("at", at)
        for client in self.server.get_clients().values():
            client.camera.position, client.camera.look_at = camera.position, camera.look_at
        return self

    # --- where the view is shown ---------------------------------------------------------------------------

    @property
    def url(self) -> str:
        """The address of the page, for a browser of this machine."""
        return self.stage.url

    def open_tab(self) -> View:
        """Open a tab of the browser; returns the view, which then stays alive until ``close``."""
        self.stage.holds = self
        self.stage.open_tab()
        return self

    def wait(self) -> None:
        """Keep the page alive until Ctrl-C, which raises KeyboardInterrupt as usual."""
        while True:
            time.sleep(0.2)

    def play(self, speed: float = 1.0) -> View:
        """Play the motion once from its start, and return the view at its end.

        speed  1 for real time, 0.5 for half as fast

        Opens a tab of the browser and waits up to 20 s for it. A notebook shows its own player instead.
        Raises  SpatialDynError for a view without motion, or a speed that is not positive.
        """
        motion = self._moving()
        shown, times = frames(motion.t, 60.0, speed)
        if in_notebook():
            player = {"text/html": page_frame(self.html(speed=speed)), "text/plain": repr(self)}
            import_module("IPython.display").display(player, raw=True)
            self._shown_in = notebook_cell()
            return self
        if not self.server.get_clients():
            self.open_tab()
            until = time.monotonic() + WAIT
            while not self.server.get_clients() and time.monotonic() < until and has_screen():
                time.sleep(0.05)
        start = time.monotonic()
        for moment, _ in zip(times, self._steps(shown), strict=True):
            time.sleep(max(0.0, start + float(moment) - time.monotonic()))
        return self

    def html(self, fps: float = 60.0, speed: float = 1.0) -> str:
        """The page that ``save`` writes, as text."""
        if self.motion is None:
            return self.stage.html()
        shown, times = frames(self.motion.t, fps, speed)
        before = self.q
        text = self.stage.html(times, self._steps(shown))
        self.show(before)
        return text

    def save(self, path: Folder, fps: float = 60.0, speed: float = 1.0) -> Path:
        """Write a page that needs no network, with a play bar for a motion; returns its path.

        path   a name that ends in .html
        fps    frames per second; a motion recorded more often is thinned, no motion is interpolated
        speed  1 for real time, 0.5 for half as fast

        Raises  SpatialDynError for another ending, fps or speed, or if the file cannot be written.
        """
        path = Path(check_ending("path", path, PAGE_FILES))
        text = self.html(fps, speed)
        try:
            path.write_text(text, encoding="utf-8")
        except OSError as error:
            raise SpatialDynError(
                f"path is {literal(str(path))}: {error.strerror}, expected a file to write"
            ) from error
        return path

    def close(self) -> None:
        """End viser's server; the page stops answering."""
        if isinstance(self._controls, Player):
            self._controls.stop()
        self.stage.holds = None
        self._stop()

    def __repr__(self) -> str:
        what = "" if self.motion is None else f", {self.motion.t[-1]:g} s of motion"
        lost = f", {len(self.missing)} meshes missing" if self.missing else ""
        return f"<View of {self.model.name} at {self.url}{what}{lost}>"

    def _repr_html_(self) -> str | None:
        """HTML for a notebook: for a motion a player, which the notebook keeps; for a pose the page with its sliders.

        None in the cell in which ``play`` has already shown the player.
        """
        if self._shown_in is not None and self._shown_in == notebook_cell():
            return None
        if self.motion is not None:
            return page_frame(self.html())
        self.stage.holds = self
        return page_frame(self.url)

    # --- inside --------------------------------------------------------------------------------------------

    def _moving(self) -> Motion:
        if self.motion is None:
            raise SpatialDynError("the view has no motion, expected view(trajectory) or view(model, q, dt)")
        return self.motion

    def _poses(self, q: ArrayLike) -> Array:
        """Poses (..., njoints, 4, 4) of the joints' bodies. Raises ShapeError, NonFiniteError."""
        x = as_array("q", q)
        if x.ndim != 1:
            raise ShapeError(f"q has shape {x.shape}, expected ({self.model.nq},)")
        X = np.asarray(calls["forward_kinematics"](self.model, x))
        if not np.isfinite(X).all():
            raise NonFiniteError(f"q is {x.tolist()}, at which poses are not finite")
        return X

    def _add(self, shape: Shape) -> Any:
        frame = self.model.frame(f"link:{shape.link}")
        return self.stage.add_shape(frame.joint, frame.placement, shape)

    def _place_com(self) -> None:
        if self._com is not None:
            self._com.position = np.asarray(calls["center_of_mass"](self.model, self.q))

    def _box(self, X: Array) -> Array:
        """The corners (2, 3) around the pose, and around the motion where that stays within a few sizes of it [m]."""
        first = self.stage.bounds(X)
        box, reachable = first.copy(), 4.0 * float(np.linalg.norm(first[1] - first[0]))
        if self.motion is not None:
            some = np.unique(np.linspace(0, len(self.motion.t) - 1, 12).astype(int))
            for pose in np.asarray(calls["forward_kinematics"](self.model, self.motion.q[:, some])).reshape(
                -1, *X.shape
            ):
                here = self.stage.bounds(pose)
                whole = np.stack([np.minimum(box[0], here[0]), np.maximum(box[1], here[1])])
                if np.linalg.norm(whole[1] - whole[0]) <= reachable:
                    box = whole
        return box

    def _steps(self, shown: NDArray[np.intp]) -> Iterator[None]:
        """Shows one configuration of the motion after another, each with the mean impulse since the one before."""
        motion = self._moving()
        X = np.asarray(calls["forward_kinematics"](self.model, motion.q[:, shown]))
        for k, index in enumerate(shown.tolist()):
            first = int(shown[k - 1]) + 1 if k else self.acting.first_of(index)
            with self._lock, self.stage.at_once():
                self.q = motion.q[0, index]
                self.stage.pose(X[0, k], X[1:, k])
                self.acting.place(X[0, k], first, index)
                self._place_com()
            yield

    def _show_at(self, k: int) -> None:
        """Show a configuration of the motion."""
        next(self._steps(np.array([k])))

    # --- controls of the page ------------------------------------------------------------------------------

    def _add_controls(self) -> Sliders | Player:
        """Sliders, of the time for a motion, else one for each freedom; and boxes for the layers."""
        gui = self.server.gui
        controls = (
            Sliders(gui, self.model, self.q, weakly(self.show))
            if self.motion is None
            else Player(gui, self.motion.t, weakly(self._show_at))
        )
        add_layers(gui, LAYERS, (self._kind, ACTS), weakly(self._switch))
        return controls

    def _switch(self, layer: str, on: bool) -> None:
        """Show or hide a layer; it is drawn the first time it is shown."""
        with self._lock, self.stage.at_once():
            if layer == "centre of mass":
                self.com()
                self._com.visible = on
                return
            if layer == ACTS:
                self.acting.show(on)
                return
            if layer not in self._layers and on:
                if layer == "frames":
                    links = [frame for frame in self.model.frames if frame.kind == "link"]
                    self._layers[layer] = [
                        self.stage.add_axes(f.joint, f.placement, f"frame_{f.name}", 0.08 * self.size) for f in links
                    ]
                else:
                    found = robot_shapes(self.model, layer, self._urdf, self._package_dirs)
                    self._layers[layer] = [self._add(shape) for shape in found.shapes]
            for handle in self._layers.get(layer, []):
                handle.visible = on
