"""What acts by impulses in simulations: contacts, joint limits, dry joints beside them or beside constraints.

v⁺ and all impulses are found together, by ``recursions.contact`` or ``recursions.impulse_step``, so the step is that of
``semi_implicit_euler`` (``solved_steps``). A run carries the largest residual so far, with its point and step, and on
request the impulses of the last step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..bodies.static_table import StaticTable
from ..calls.dynamics import calls
from ..calls.failures import joint_of_velocity
from ..constraints.contact_dynamics import contact_gaps
from ..constraints.contact_points import Contacts
from ..engines.programs.recording import MOST_TABLE
from ..errors import ModelError, SimulationError
from ..model.model import Model
from ..recursions.contact_rows import CONTACTS_ARGUMENT, HEIGHTS_ARGUMENT, MU, RESTITUTION
from ..recursions.spec import Argument, shape_in
from .constrained import Held
from .contact_record import ContactRecord
from .friction_steps import IMPLICIT, LUGRE

Array = NDArray[Any]
MOST_POINTS = 12  # in a rollout: beyond, J M⁻¹ Jᵀ costs more than the robot, and its program is long
MOST_ROWS = 36  # in a rollout, of dry joints, limits and three of each point: a sweep's tableaus cost rows cubed
START = 1e-3  # [m | rad] deepest that a run may start in the ground, or beyond a limit
UNSOLVED = 1e-2  # [m/s | rad/s] residual that is an error
UNSOLVED_DRY = 1e-1  # the same beside dry joints: the worst of a trot's steps may be left at 1e-2 and more
WORST = 5  # numbers: residual of the last step, the largest so far, its point or joint, its step, steps so far

SOLVED = Argument(
    "contact_residual", (WORST,), "", "residual now, largest so far, its point, its step, step", start=0.0
)
RECORDED = Argument("contact_record", (f"{WORST}+np+np+np+nl",), "", "the same, and impulses", start=0.0)


@dataclass(frozen=True)
class Touching:
    """What acts by impulses in a run.

    contacts  Contacts, perhaps of joint limits alone, or of nothing beside constraints
    records   whether impulses are recorded
    table     of the contacts and of freedoms that rub dry
    way       of friction that is solved for together with them, None for none
    held      whether constraints are
    """

    contacts: Contacts
    records: bool
    table: StaticTable
    way: str | None = None
    held: bool = False

    @property
    def own(self) -> Argument:
        """The state that they carry."""
        return RECORDED if self.records else SOLVED

    @property
    def width(self) -> int:
        """The numbers of that state."""
        return int(shape_in(self.own.shape, self.table.sizes)[0])

    @property
    def tables(self) -> tuple[StaticTable, ...]:
        """Of contacts, and of heights if there are some."""
        return (self.table, *self.contacts.tables[1:])

    @property
    def arguments(self) -> tuple[Argument, ...]:
        """That state, and the inputs that a step takes last, the tables first."""
        return (self.own, *(CONTACTS_ARGUMENT, HEIGHTS_ARGUMENT)[: len(self.tables)], *self.inputs)

    @property
    def inputs(self) -> tuple[Argument, ...]:
        """The inputs that are no tables."""
        return (MU, RESTITUTION) if len(self.contacts) else ()

    @property
    def values(self) -> tuple[Array, ...]:
        """(np,) of each."""
        return (self.contacts.friction, self.contacts.restitution)[: len(self.inputs)]

    @property
    def touches(self) -> bool:
        """Whether there are points or limits."""
        return self.table.sizes["np"] + self.table.sizes["nl"] > 0

    @property
    def is_long(self) -> bool:
        """Whether programs of its steps are too long: those that hold rows in turn."""
        points, rows = len(self.contacts), len(self.table.rows) - 1
        return (self.way is not None or self.held) and rows + 2 * points > MOST_ROWS

    @property
    def least(self) -> float:
        """The residual that is an error [m/s | rad/s]."""
        return UNSOLVED_DRY if self.way == IMPLICIT else UNSOLVED

    def label(self, k: int) -> str:
        """What messages call a point or joint, in the order of residuals."""
        known = self.contacts.labels
        if k < len(known):
            return known[k]
        return f'friction of joint "{joint_of_velocity(self.contacts.model, self.table.rows[1 + k]["row"] - 1).name}"'

    def record(self, q: Array, own: Array) -> ContactRecord:
        """What was recorded: positions (..., nq), and the state of its own (..., width)."""
        contacts, model = self.contacts, self.contacts.model
        k, limits, lead = len(contacts), self.table.sizes["nl"], own.shape[:-1]
        stop = np.zeros((*lead, model.nv), own.dtype)
        stop[..., self.table.rows["row"][1 + k : 1 + k + limits] - 1] = own[..., WORST + 3 * k :]
        impulse = own[..., WORST : WORST + 3 * k].reshape((*lead, k, 3))
        known = np.isfinite(q).all(axis=-1, keepdims=True)
        gap = np.where(known, contact_gaps(model, contacts, np.where(known, q, calls["neutral"](model))), np.nan)
        return ContactRecord(impulse.copy(), gap.astype(own.dtype), abs(own[..., 0]), stop)


def touching(scene: Any, kept: bool, q: Array, held: Held | None) -> Touching | None:
    """What acts by impulses in a run of a scene from positions (..., nq); None for none.

    kept  whether impulses are recorded

    Raises  SimulationError for a start in the ground or beyond a limit, with its depth
    """
    model, contacts, stops, found = scene.model, scene.contacts, scene.limits, scene.rubs
    if contacts is None and not stops and kept:
        raise SimulationError('record has "contacts", expected contacts or limits=True in the scene')
    solved = found.way if found is not None and found.way in (IMPLICIT, LUGRE) else None
    if contacts is None and not stops and (held is None or solved != IMPLICIT):
        return None
    given = scene.touching
    _check_start(model, given, q)
    dry = found.dry if found is not None and solved == IMPLICIT else np.zeros(model.nv, bool)
    made = Touching(given, kept, given.with_dry(dry), solved, held is not None)
    return made if len(made.table.rows) > 1 or held is not None else None


def _check_start(model: Model, contacts: Contacts, q: Array) -> None:
    """Raise SimulationError if a point starts in the ground, or a joint beyond its limits."""
    rows = contacts.table.rows[1 + len(contacts) :]
    x = q[..., rows["q_index"]]
    beyond = np.maximum(rows["lower"] - x, x - rows["upper"])
    depth = np.concatenate([-contact_gaps(model, contacts, q), beyond], axis=-1)
    bad = np.argwhere(depth > START)
    if len(bad):
        index, k = tuple(int(i) for i in bad[0, :-1]), int(bad[0, -1])
        where = "" if not index else f" in sample {index[0]}"
        size = depth[(*index, k)]
        if k < len(contacts):
            raise SimulationError(
                f'point "{contacts.names[k]}" starts {1e3 * size:.3g} mm in the ground{where}, expected at most '
                f"{1e3 * START:g} mm; contact_gaps says how far to lift the robot"
            )
        name = contacts.stops[k - len(contacts)]
        raise SimulationError(f'joint "{name}" starts {size:.3g} rad or m beyond its limits{where}, expected within')


def check_few(found: Touching | None) -> None:
    """Raise ModelError if there are more points, rows or heights than a rollout takes."""
    if found is None:
        return
    heights, points = sum(len(x.rows) - 1 for x in found.tables[1:]), len(found.contacts)
    more = "simulate and contact_step take more"
    if heights > MOST_TABLE:
        raise ModelError(f"terrain has {heights} heights, expected at most {MOST_TABLE} in a rollout; {more}")
    if points > MOST_POINTS:
        raise ModelError(f"contacts have {points} points, expected at most {MOST_POINTS} in a rollout; {more}")
    joints = len(found.table.rows) - 1 - points
    if found.is_long:
        raise ModelError(
            f"{points} points and {joints} joints that rub or stop have {3 * points + joints} impulses, expected at "
            f"most {MOST_ROWS} in a rollout; simulate takes more"
        )


def samples_unsolved(found: Touching, own: Array) -> NDArray[np.intp]:
    """The samples with a step that is not solved, of the state of its own (samples, width)."""
    return np.flatnonzero(own[:, 1] > found.least)


def unsolved(found: Touching, own: Array, dt: float) -> str:
    """What is wrong with the step of the largest residual of one sample; "" if it is solved."""
    worst, which, step = own[1], int(own[2]), int(own[3])
    if not worst > found.least:
        return ""
    return (
        f"{found.label(which)} misses its law by {worst:.2g} m/s in the step from t = {step * dt:.9g} s, "
        f"expected at most {found.least:g} of a solved step; more sweeps may help"
    )
