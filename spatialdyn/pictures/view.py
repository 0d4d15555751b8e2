"""``sd.view``: a robot in a browser, a notebook or a page to keep, at rest or in motion."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.arguments import as_array, as_flag, as_items, as_number, as_word
from ..calls.dynamics import calls
from ..constraints.contact_dynamics import contact_gaps
from ..constraints.contact_points import Plane
from ..constraints.loops import close_loops
from ..errors import ConstraintError, ModelError, SpatialDynError, literal
from ..model.model import Model
from ..simulation import Rollout, Trajectory
from ..simulation.scene import Scene, scene_of
from ..waiting import watch
from .acting import impulses_of, scene_of_run
from .mesh_files import Folder
from .motions import motion_of
from .progress_bar import in_notebook
from .robot_shapes import SHAPES
from .stage import HOST, PORT, has_screen
from .viewer import View

Array = NDArray[np.float64]
APPROACHES = 8  # steps towards a slope; on a plane the first step arrives


def view(
    robot: Any,
    q: Any = None,
    dt: float | None = None,
    *,
    shapes: str = "visual",
    urdf: Any = None,
    package_dirs: Sequence[Folder] | Folder = (),
    sample: int | None = None,
    floor: float | None = 0.0,
    open: bool | None = None,
    host: str = HOST,
    port: int = PORT,
) -> View:
    """Show a robot, or a motion of one, in a browser or a notebook: ``view(model)``, ``view(trajectory)``.

    robot         a Model or a Scene; a Trajectory or a Rollout, which contain theirs
    q             (nq,) the pose of a Model, by default neutral within its limits, with loops closed and on the ground
                  if a Scene has these [rad | m]; or its motion: (N, nq), (S, N, nq) of S samples, a Trajectory or a
                  Rollout
    dt            seconds from one configuration of a motion to the next, if the motion has no times
    shapes        "visual" or "collision" geometry of the URDF, or "inertia": a box of even density for each inertia,
                  red if no body can have it, centres of mass and joint axes. "inertia" also replaces missing geometry:
                  of robots made by calls or from text, and of links whose meshes are not found
    urdf          source of the geometry, as in ``load_urdf``; by default the file from which the model was read
    package_dirs  folders that hold the packages of ``package://`` names; searched before ROS_PACKAGE_PATH and the
                  folders above the URDF
    sample        index of the sample to show; None shows the first solid and the next 15 pale
    floor         height of the floor in the world [m], if no ground of contacts is drawn; None draws none
    open          whether to open a tab of the browser; None opens one for a Model, but not in a notebook, where the
                  scene displays itself, and not without a screen
    host, port    address at which viser listens for the browser; if the port is in use, the next free one

    Effects of a Scene are drawn too: the ground of contacts; their points as yellow spheres; impulses as violet arrows
    if the run has ``record="contacts"``, each the mean since the previous picture, red if it is cut; in green the
    places that constraints hold together, with a line between them; constant forces.
    Returns a View. Its page, at ``scene.url`` with or without a tab, has a slider for each joint, or for the time of a
    motion, which ``play`` and ``save`` show too.
    ``scene.missing`` and a warning name meshes that are not found or cannot be read; ``scene.faulty`` and a warning
    name meshes that are drawn without broken elements of their files, such as materials.
    Raises  SpatialDynError without viser, naming what to install, or naming a bad argument; UrdfError for a urdf that
            cannot be read; ShapeError, NonFiniteError for q.

    >>> scene = view(model)                                                 # doctest: +SKIP
    >>> scene.show(q)                                                       # doctest: +SKIP
    >>> view(simulate(model, q, v, 5.0)).save("swing.html")                 # doctest: +SKIP
    """
    if isinstance(robot, (Trajectory, Rollout)):
        model, given = getattr(robot, "model", None), robot
        if model is None:
            what = type(robot).__name__
            raise ModelError(f"the {what} does not know its model, expected view(model, {what.lower()})")
        if q is not None:
            raise SpatialDynError(f"q is given beside a {type(robot).__name__}, expected one of them")
        scene = scene_of_run(robot) or scene_of(model)
    else:
        scene, given = scene_of(robot), q
        own = scene_of_run(q)
        if own is not None and not isinstance(robot, Scene) and own.model == robot:
            scene = own
    model = scene.model
    as_word("shapes", shapes, SHAPES)
    folders = as_items("package_dirs", package_dirs, (str, os.PathLike), "folders")
    if open is not None:
        as_flag("open", open)
    moves = isinstance(given, (Trajectory, Rollout)) or (given is not None and as_array("q", given).ndim > 1)
    motion = motion_of(model, given, dt, sample) if moves else None
    if floor is not None and not np.isfinite(as_number(floor)):
        raise SpatialDynError(f"floor is {literal(floor)}, expected its height in metres, or None")
    impulses = None
    if motion is not None and own_impulses(scene, given):
        impulses = impulses_of(given, sample or 0)
    start: Any = motion.q[0, 0] if motion is not None else standing(scene) if given is None else given
    with watch.call("view"):
        made = View(scene, start, motion, impulses, shapes, urdf, folders, floor, host, port)
    if open or (open is None and not moves and not in_notebook() and has_screen()):
        made.open_tab()
    return made


def own_impulses(scene: Scene, run: Any) -> bool:
    """Whether a run's impulses belong to the contact points of the drawn scene."""
    acted = scene_of_run(run)
    return acted is not None and acted.contacts == scene.contacts


def standing(scene: Scene) -> Array:
    """``resting``, loops closed if they can be, a floating base raised or lowered until a point touches the ground."""
    model, q = scene.model, resting(scene.model)
    if scene.constraints is not None:
        try:
            q = close_loops(model, scene.constraints, q)
        except ConstraintError:  # no closed pose near the neutral one: lines show the open loops
            return q
    contacts = scene.contacts
    if contacts is not None and len(contacts) and len(model.joints) > 1 and model.joints[1].kind == "floating":
        up = np.array(contacts.terrain.normal if isinstance(contacts.terrain, Plane) else (0.0, 0.0, 1.0))
        for _ in range(APPROACHES):
            q[:3] -= float(contact_gaps(model, contacts, q).min()) * up
    return q


def resting(model: Model) -> Array:
    """The neutral configuration, coordinates of one number within their limits [rad | m]."""
    q = np.array(calls["neutral"](model))
    for joint in model.joints[1:]:
        if joint.nq == 1 and joint.mimic is None:
            q[joint.idx_q] = np.clip(q[joint.idx_q], model.lower[joint.idx_q], model.upper[joint.idx_q])
    return q
