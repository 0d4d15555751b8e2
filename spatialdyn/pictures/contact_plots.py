"""``Trajectory.plot("contacts")``: each point's gap, its force over time, and the force in its friction cone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calls.dynamics import calls
from ..constraints.contact_points import Contacts, Plane
from ..errors import SpatialDynError
from ..model.model import Model
from ..simulation.trajectory import Trajectory
from .figures import FAINT, dash, legend
from .ground import centres, normals
from .panels import Panel, note, padded

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
USUAL, MORE = 90.0, 4.0  # percentile of nonzero forces; impacts beyond four times that force leave the panel
OUTSIDE = "#d95f02"  # as of limits
REST = 1e-9  # of dt: a last step that much shorter is one of its own


class PointForces(NamedTuple):
    """Forces on the k points of a run, of the steps that end at its N times; NaN in ``share`` where none acts.

    normal      (N, k)  along the ground's normal [N]
    tangential  (N, k)  size of the rest [N]
    share       (N, k)  tangential / (μ normal): 1 at the cone's edge, where a point slides
    """

    normal: Array
    tangential: Array
    share: Array


def contact_panels(run: Trajectory) -> list[Panel]:
    """Panels of the gaps, normal forces and shares over time, and of the cones."""
    contacts = _contacts(run)
    forces, names = point_forces(run), list(contacts.names)
    top = _top(forces.normal)
    assert run.contacts is not None
    gaps = run.contacts.gap

    def gap(axes: Axes, ink: Sequence[Any]) -> None:
        axes.set_ylabel("gap [m]")
        axes.axhline(0.0, color=FAINT, linewidth=0.9, gid="limit")
        _lines(axes, run.t, gaps, names, ink)
        axes.set_ylim(*padded(np.append(gaps, 0.0), 0.0))

    def normal(axes: Axes, ink: Sequence[Any]) -> None:
        axes.set_ylabel("normal force [N]")
        _lines(axes, run.t, forces.normal, names, ink)
        axes.set_ylim(-0.04 * top, 1.06 * top)
        _note_beyond(axes, forces.normal, top)

    def share(axes: Axes, ink: Sequence[Any]) -> None:
        axes.set_ylabel("tangential / (μ normal)")
        axes.axhline(1.0, color=FAINT, linewidth=0.9, gid="limit")
        axes.axhspan(1.0, 1.25, color=OUTSIDE, alpha=0.15, linewidth=0)
        _lines(axes, run.t, forces.share, names, ink, ".")  # an impact is a single sample
        axes.set_ylim(-0.05, 1.25)
        note(axes, "at 1 a point slides")

    def cone(axes: Axes, ink: Sequence[Any]) -> None:
        axes.set(xlabel="tangential force [N]", ylabel="normal force [N]")
        dots = [
            axes.plot(x, y, ".", color=colour, markersize=4.0, alpha=0.7)[0]
            for x, y, colour in zip(forces.tangential.T, forces.normal.T, ink, strict=True)
        ]
        legend(axes, dots, names)
        wide = max(1.1 * top * float(contacts.friction.max()), 0.1 * top)
        for mu in np.unique(contacts.friction).tolist():
            axes.plot([0.0, mu * 2.0 * top], [0.0, 2.0 * top], color=FAINT, linewidth=0.9, gid="cone")
        mu = float(contacts.friction.max())
        edge = [x / mu if mu else 2.0 * top for x in (0.0, wide)]
        axes.fill_between([0.0, wide], [0.0, 0.0], edge, color=OUTSIDE, alpha=0.15, linewidth=0)
        axes.set(xlim=(-0.02 * wide, wide), ylim=(-0.04 * top, 1.06 * top))
        _note_beyond(axes, forces.normal, top)

    return [
        Panel("gap [m]", gap, names), Panel("normal force [N]", normal, names),
        Panel("share of the cone", share, names), Panel("cone [N]", cone, names, over_time=False),
    ]  # fmt: skip


def point_forces(run: Trajectory) -> PointForces:
    """The recorded impulses over the steps, along the ground's normal and across it. Raises SpatialDynError."""
    contacts = _contacts(run)
    assert run.contacts is not None
    impulse = np.asarray(run.contacts.impulse, np.float64)
    steps = np.full(len(run), run.dt)
    rest = float(run.t[-1]) - np.floor(float(run.t[-1]) / run.dt + REST) * run.dt
    if rest > REST * run.dt:
        steps[-1] = rest
    before = run.q if isinstance(contacts.terrain, Plane) else _begun(contacts.model, run.q, steps[:, None] * run.v)
    X = np.asarray(calls["forward_kinematics"](contacts.model, before))
    n = normals(contacts, centres(contacts, X))
    force = impulse / steps[:, None, None]
    normal = np.einsum("nki,nki->nk", force, n)
    tangential = np.linalg.norm(force - normal[..., None] * n, axis=-1)
    most = contacts.friction * normal
    share = np.divide(tangential, most, out=np.full_like(most, np.nan), where=most > 0.0)
    return PointForces(normal, tangential, share)


def _begun(model: Model, q: Array, way: Array) -> Array:
    """The configurations before steps that end at q with dt v⁺ = way: each step used the ground's slope there.

    q⁺ = q ∘ exp(dt x) ∘ exp(dt ω⁺), x the linear velocity of floating and planar joints in the axes of the beginning,
    which has turned into v⁺.
    """
    straight = np.zeros_like(way)
    for joint in model.joints[1:]:
        lengths = {"floating": 3, "planar": 2}.get(joint.kind, 0)
        straight[:, joint.idx_v : joint.idx_v + lengths] = way[:, joint.idx_v : joint.idx_v + lengths]
    made: Array = calls["integrate"](model, calls["integrate"](model, q, -straight), straight - way)
    return made


def _contacts(run: Trajectory) -> Contacts:
    """The contacts of a run. Raises SpatialDynError where there is no record of points."""
    if run.contacts is None:
        raise SpatialDynError(
            f'trajectory of {run.robot} has no record of contacts, expected simulate(..., record="contacts")'
        )
    if run.scene is None:
        raise SpatialDynError("the trajectory was loaded without its model, expected one to draw contacts")
    if run.scene.contacts is None or not len(run.scene.contacts):
        raise SpatialDynError(f"the scene of {run.robot} has no contact points, expected some to draw")
    return run.scene.contacts


def _lines(axes: Axes, t: Array, values: Array, names: Sequence[str], ink: Sequence[Any], dot: str = "") -> None:
    marker = "o" if len(t) == 1 else dot
    lines = [
        axes.plot(
            t,
            y,
            color=colour,
            linestyle=dash(k, len(names)),
            linewidth=1.3,
            marker=marker,
            markersize=3.0 if dot else None,
        )[0]
        for k, (y, colour) in enumerate(zip(values.T, ink, strict=True))
    ]
    legend(axes, lines, list(names))


def _top(normal: Array) -> float:
    """The force at the upper end of an axis: the largest, or below impacts that would flatten all others [N]."""
    acting = normal[normal > 0.0]
    if not acting.size:
        return 1.0
    usual = float(np.percentile(acting, USUAL))
    return 1.5 * usual if acting.max() > MORE * usual else float(acting.max())


def _note_beyond(axes: Axes, normal: Array, top: float) -> None:
    beyond = int((normal > 1.06 * top).sum())
    if beyond:
        largest = float(normal.max())
        note(
            axes,
            f"{beyond} beyond, up to {largest:.0f} N"
            if largest >= 100.0
            else f"{beyond} beyond, up to {largest:.3g} N",
        )
