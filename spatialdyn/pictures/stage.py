"""The content of viser: bodies with shapes, placed by poses; arrows, lines, frames; camera and floor; a page as text.

A Stage has poses of bodies and no model. Poses are world poses (4, 4) of bodies, index 0 the world. viser's server
listens on this machine only, unless another host is given.
"""

from __future__ import annotations

import atexit
import html
import os
import re
import socket
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SpatialDynError, literal, pip_install
from ..model.robot_checks import quoted
from .mesh_files import Color
from .shapes import Shape

Array = NDArray[np.float64]
HOST, PORT = "127.0.0.1", 8080
HEIGHT = 480  # pixels in a notebook
FLOOR = (0.55, 0.55, 0.6)
VIEW = np.array([1.0, -1.25, 0.65])  # the camera's direction from the middle
FIELD = 0.8  # rad, the camera's vertical field of view
GHOST: Color = (0.35, 0.5, 0.9, 0.3)  # pale copies, if there are few
VEIL = 1.5  # total opacity of many copies, so that the solid body is visible through them


class Stage:
    """Bodies in viser's scene.

    server   viser's server, which runs
    shown    (bodies, 4, 4) the poses shown
    """

    def __init__(self, bodies: Sequence[str], host: str = HOST, port: int = PORT, server: Any = None) -> None:
        """``bodies``: their names, the world's first; ``server``: a running server to use in place of a new one."""
        self.server = started(host, port) if server is None else server
        self.own = server is None
        self._at_exit = partial(stop_silently, self.server)
        if self.own:
            atexit.register(self._at_exit)  # before viser's own, which prints
        self.holds: Any = None  # an object to keep alive as long as the server
        self.shown = np.tile(np.eye(4), (len(bodies), 1, 1))
        self._handles: list[Any] = []
        self._nodes: list[str]
        self._vertices: dict[int, list[Array]]
        self._ghosts: list[tuple[int, Any]] = []
        self._bodies = [f"{k}_{plain(name)}" for k, name in enumerate(bodies)]
        root, k = "robot", 1
        while self.server.scene.get_handle_by_name(f"/{root}/{self._bodies[0]}") is not None:  # another stage's
            k += 1
            root = f"robot_{k}"
        self.root_at(root)

    def root_at(self, root: str) -> None:
        """Begin anew, without shapes, under that name of viser's scene tree, in place of what is there."""
        find = self.server.scene.get_handle_by_name
        self._nodes = [f"/{plain(root)}/{body}" for body in self._bodies]
        for handle in [*self._handles, *filter(None, map(find, self._nodes))]:
            if find(handle.name) is handle:  # not yet removed, and no other stage took its name
                handle.remove()
        self._handles = [self.server.scene.add_frame(node, show_axes=False) for node in self._nodes]
        self._vertices = {}

    # --- what is on bodies ---------------------------------------------------------------------------------

    def add_shape(self, body: int, X: Array, shape: Shape) -> Any:
        """Draw a shape on a body, X (4, 4) the pose of its link there; returns viser's handle."""
        name = self.fresh_name(body, shape.link)
        vertices = shape.vertices @ X[:3, :3].T + X[:3, 3]
        self._vertices.setdefault(body, []).append(vertices)
        if shape.textured:
            return self.server.scene.add_glb(name, shape.textured, wxyz=quaternions(X[:3, :3]), position=X[:3, 3])
        rgb, opacity = shape.color[:3], shape.color[3]
        return self.server.scene.add_mesh_simple(
            name, vertices, shape.faces, color=rgb, opacity=None if opacity >= 1.0 else opacity, side="double"
        )

    def add_axes(self, body: int, X: Array, name: str, length: float) -> Any:
        """Draw a frame, X (4, 4) its pose on a body, as three axes; returns viser's handle."""
        return self.server.scene.add_frame(
            self.fresh_name(body, name), wxyz=quaternions(X[:3, :3]), position=X[:3, 3], axes_length=length,
            axes_radius=0.04 * length, origin_radius=0.06 * length,
        )  # fmt: skip

    def add_arrow(self, body: int, start: Array, end: Array, name: str, color: Color, radius: float) -> Any:
        """Draw an arrow from one point on a body to another; returns viser's handle."""
        head = min(6.0 * radius, 0.5 * float(np.linalg.norm(end - start)))
        return self.server.scene.add_arrows(
            self.fresh_name(body, name), np.stack([start, end])[None], np.array(color[:3]), shaft_radius=radius,
            head_radius=2.5 * radius, head_length=head,
        )  # fmt: skip

    def add_line(self, points: Array, name: str, color: Color, thickness: float) -> Any:
        """Draw a line through points (n, 3) of the world; returns viser's handle."""
        ends = np.stack([points[:-1], points[1:]], axis=1)
        return self.server.scene.add_line_segments(f"/{plain(name)}", ends, np.array(color[:3]), thickness=thickness)

    def add_mark(self, at: Array, name: str, color: Color, radius: float) -> Any:
        """Draw a ball at a point (3,), with a cross that sticks out of shapes around it; returns viser's handle."""
        arms = 5.0 * radius * np.eye(3)
        self.server.scene.add_line_segments(
            f"/{plain(name)}/cross", np.stack([-arms, arms], axis=1), np.array(color[:3]), thickness=0.15 * radius
        )
        return self.server.scene.add_icosphere(f"/{plain(name)}", radius, color=color[:3], position=at)

    def add_ghosts(self, body: int, shapes: Sequence[tuple[Array, Shape]], count: int) -> None:
        """Draw pale copies of shapes, (pose (4, 4) on the body, shape) each, on ``count`` more bodies like one."""
        if not shapes or not count:
            return
        starts = np.cumsum([0, *(len(shape.vertices) for _, shape in shapes)])
        vertices = np.concatenate([shape.vertices @ X[:3, :3].T + X[:3, 3] for X, shape in shapes])
        faces = np.concatenate([shape.faces + start for (_, shape), start in zip(shapes, starts, strict=False)])
        made = self.server.scene.add_batched_meshes_simple(
            f"/ghosts/{body}", vertices, faces, np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)), np.zeros((count, 3)),
            batched_colors=np.array(GHOST[:3]), opacity=min(GHOST[3], VEIL / count), lod="off", side="double",
            cast_shadow=False,
        )  # fmt: skip
        self._ghosts.append((body, made))

    def fresh_name(self, body: int, name: str) -> str:
        """An unused name of viser's scene tree on a body."""
        base = f"{self._nodes[body]}/{plain(name)}"
        scene, k, found = self.server.scene, 1, base
        while scene.get_handle_by_name(found) is not None:
            k += 1
            found = f"{base}_{k}"
        return found

    # --- poses ---------------------------------------------------------------------------------------------

    def pose(self, X: Array, ghosts: Sequence[Array] | Array = ()) -> None:
        """Place the bodies, X (bodies, 4, 4), and their pale copies (copies, bodies, 4, 4)."""
        turns = quaternions(X[:, :3, :3])
        for handle, turn, at in zip(self._handles, turns, X[:, :3, 3], strict=True):
            handle.wxyz, handle.position = turn, at
        for body, handle in self._ghosts if len(ghosts) else ():
            there = np.asarray(ghosts)[:, body]
            handle.batched_wxyzs = quaternions(there[:, :3, :3]).astype(np.float32)
            handle.batched_positions = there[:, :3, 3].astype(np.float32)
        self.shown = X

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """A context whose changes reach browsers at once."""
        with self.server.atomic():
            yield

    def bounds(self, X: Array) -> Array:
        """The corners (2, 3), lowest and highest, of a box around all shapes with bodies at X (bodies, 4, 4) [m].

        Bodies without shapes count with their origins.
        """
        points = [X[1:, :3, 3]]
        for body, parts in self._vertices.items():
            points += [vertices @ X[body, :3, :3].T + X[body, :3, 3] for vertices in parts]
        corners = [(part.min(0), part.max(0)) for part in points if len(part)]
        if not corners:
            return np.zeros((2, 3))
        return np.stack([np.min([low for low, _ in corners], 0), np.max([high for _, high in corners], 0)])

    # --- camera and floor ----------------------------------------------------------------------------------

    def look_at(self, box: Array, floor: float | None, up: Array | None = None) -> None:
        """Point the camera at a box (2, 3), all of it in view, and lay the floor at a height [m], if any.

        up  (3,) the unit normal of a ground, which the camera looks at from above
        """
        middle, radius = box.mean(0), max(0.5 * float(np.linalg.norm(box[1] - box[0])), 1e-6)
        away = 1.1 * radius / np.sin(0.5 * FIELD)
        camera = self.server.initial_camera
        camera.fov, camera.near, camera.far = FIELD, 0.01 * away, 200.0 * away
        camera.look_at = middle
        way = VIEW / np.linalg.norm(VIEW)
        if up is not None:
            way = way - 2.0 * min(0.0, float(up @ way)) * up
        camera.position = middle + away * way
        for client in self.server.get_clients().values():
            client.camera.look_at, client.camera.position = camera.look_at, camera.position
        if floor is not None:
            self.add_grid("/floor", np.array([middle[0], middle[1], floor]), np.eye(3), radius)

    def add_grid(self, name: str, at: Array, R: Array, radius: float, color: Color | None = None) -> Any:
        """Lay an infinite grid at a point (3,), normal to the third column of R (3, 3); returns viser's handle.

        radius  size of the objects on it [m]
        color   of the ground between the lines; None draws only lines
        """
        cell = 10.0 ** np.round(np.log10(radius) - 0.6)
        filled = {} if color is None else {"plane_color": color[:3], "plane_opacity": color[3]}
        return self.server.scene.add_grid(
            name, plane="xy", infinite_grid=True, cell_size=cell, section_size=5.0 * cell, wxyz=quaternions(R),
            position=at, fade_distance=16.0 * 1.1 * radius / np.sin(0.5 * FIELD), cell_thickness=0.6,
            cell_color=(215, 215, 220), section_color=(185, 185, 192), shadow_opacity=0.2, **filled,
        )  # fmt: skip

    # --- pages ---------------------------------------------------------------------------------------------

    @property
    def url(self) -> str:
        """The address of the page in a browser of this machine."""
        host = self.server.get_host()
        return f"http://{'localhost' if host in ('0.0.0.0', HOST) else host}:{self.server.get_port()}"

    def open_tab(self) -> None:
        """Open a tab of the browser."""
        import webbrowser

        webbrowser.open(self.url)

    def html(self, times: Sequence[float] | Array = (), poses: Iterator[Any] | None = None) -> str:
        """One page without links: the current picture, or the motion that ``poses`` steps through.

        times  seconds at which the poses are shown, the first at 0
        poses  an iterator that moves the scene to the pose of each time when it is advanced
        """
        if poses is None:
            return str(self.server.scene.as_html())
        next(poses, None)
        record = self.server.get_scene_serializer()
        with self.at_once():
            for gap in np.diff(times).tolist():
                record.insert_sleep(gap)
                next(poses, None)
        return str(record.as_html())

    def stop(self) -> None:
        """Stop the server without a message; a server given by the caller keeps running."""
        if self.own:
            atexit.unregister(self._at_exit)
            self._at_exit()


def viser_module() -> Any:
    """viser. Raises SpatialDynError if it is not installed."""
    try:
        import viser
        import viser.transforms
    except ImportError as error:
        raise SpatialDynError(f"{error.name} is not installed; {pip_install('view')}") from error
    return viser


def started(host: str, port: int) -> Any:
    """A new viser server at a port, or at the next free one, which prints nothing."""
    viser = viser_module()
    _check_address(host, port)
    with silence():
        server = viser.ViserServer(host=host, port=port, label="spatialdyn", verbose=False)
    server.gui.configure_theme(show_logo=False)
    return server


def _check_address(host: Any, port: Any) -> None:
    """Raise SpatialDynError unless a server can listen there; viser would wait forever."""
    if isinstance(port, bool) or not isinstance(port, int) or not 0 <= port < 1 << 16:
        raise SpatialDynError(f"port is {literal(port)}, expected a whole number of 0 to 65535")
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as trial:
            trial.bind(address)
    except (OSError, TypeError, UnicodeError) as error:
        raise SpatialDynError(f"host is {literal(host)}, expected an address of this machine: {error}") from None


def stop_silently(server: Any) -> None:
    """Stop a server; further calls do nothing."""
    with silence():
        server.stop()


@contextmanager
def silence() -> Iterator[None]:
    """Prevent viser's messages on rich's console at start and stop."""
    import rich

    console = rich.get_console()
    loud, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = loud


def quaternions(R: Array) -> Array:
    """Unit quaternions w x y z (..., 4) of rotation matrices (..., 3, 3)."""
    return np.asarray(viser_module().transforms.SO3.from_matrix(R).wxyz)


def plain(name: str) -> str:
    """A name for viser's scene tree, whose separator is a slash."""
    return re.sub(r"[^\w.:+-]", "_", name)


def page_frame(page: str, height: int = HEIGHT) -> str:
    """A page inside another one: its address, or its text, which begins with <."""
    attribute = "srcdoc" if page.lstrip().startswith("<") else "src"
    return f'<iframe {attribute}="{html.escape(page)}" width="100%" height="{height}" style="border: 0"></iframe>'


def warn_of(robot: str, missing: Sequence[str], faulty: Sequence[str] = ()) -> None:
    """Warn of meshes that are not drawn, and of meshes drawn in part, with their number and names."""
    if missing:
        many = f"{len(missing)} meshes are" if len(missing) > 1 else "1 mesh is"
        warnings.warn(
            f'robot "{robot}": {many} missing, boxes of inertia stand for them: {quoted(missing, 20)}; '
            "package_dirs=[...] says where packages lie",
            stacklevel=5,
        )
    if faulty:
        many = f"{len(faulty)} mesh files are" if len(faulty) > 1 else "1 mesh file is"
        warnings.warn(
            f'robot "{robot}": {many} broken in part, what is sound is drawn: {quoted(faulty, 20)}', stacklevel=5
        )


def has_screen() -> bool:
    """Whether a browser can open a window here."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or os.environ.get("BROWSER"))
