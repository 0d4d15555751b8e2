"""Where the energy of a motion goes: the work of each kind, carried as states of the run, and the ledger they make.

    E⁺ - E = W_torque + W_friction + W_external + W_springs + W_constraints + W_projection + W_contacts + ε

Each work is integrated by the method of the run, from the same values as the motion, so that ε is the method's own
error and falls with its order. What acts as an impulse λ in a step (solved friction, contact) does the work
½ λᵀ(u⁻ + u⁺) of the velocities u before and after it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..constraints.contact_points import Contacts
from ..constraints.table import Constraints
from ..errors import SimulationError
from ..model.model import Model
from ..recursions.spec import Argument
from .trajectory import Trajectory

Array = NDArray[np.float64]
TORQUE = Argument("work_torque", ("nv",), "J", "of the torques of motors, those of a control law among them", start=0.0)
FRICTION = Argument("work_friction", ("nv",), "J", "of friction and damping", start=0.0)
EXTERNAL = Argument("work_external", ("nv",), "J", "of external forces, by the freedoms that they move", start=0.0)
SPRINGS = Argument("work_springs", ("nv",), "J", "of springs between rotors and joints, and their damping", start=0.0)
CONSTRAINTS = Argument("work_constraints", ("nc",), "J", "of the force of each equation", start=0.0)
CONTACTS = Argument("work_contacts", ("np+nl",), "J", "of each point on the ground, then of each limit", start=0.0)
PROJECTION = Argument("work_projection", (1,), "J", "what projections onto the constraints add", start=0.0)
KINDS = {
    TORQUE.name: "torque", FRICTION.name: "friction", EXTERNAL.name: "external", SPRINGS.name: "springs",
    CONSTRAINTS.name: "constraints", PROJECTION.name: "projection", CONTACTS.name: "contacts",
}  # fmt: skip
BY_FREEDOM = ("torque", "friction", "external", "springs")


def work_states(
    rubs: bool, pushed: bool, constrained: bool, projects: bool, springs: bool = False, touches: bool = False
) -> tuple[Argument, ...]:
    """The works of a run: of torques, and of friction, external forces, springs, constraints, projections, contacts if
    there are any.
    """
    acts = (
        (TORQUE, True), (FRICTION, rubs), (EXTERNAL, pushed), (SPRINGS, springs), (CONSTRAINTS, constrained),
        (PROJECTION, projects), (CONTACTS, touches),
    )  # fmt: skip
    return tuple(x for x, there in acts if there)


@dataclass(frozen=True, eq=False, repr=False)
class EnergyLedger:
    """Energy and work of a motion, counted from its first sample; N samples.

    t           (N,)      time [s]
    change      (N,)      E - E(0) of kinetic and potential energy, without that of springs, which do work [J]
    work        {kind: (N, k)}  work done on the robot since the first sample [J]: "torque", "friction", "external"
                and "springs" by freedom, "constraints" by equation, "projection" of all constraints, "contacts" by
                point and limited joint; kinds that the run had
    labels      {kind: k names}
    error       (N,)      ε = change - all work: what the integrator's steps add [J]
    robot, method   as of the trajectory
    """

    t: Array
    change: Array
    work: dict[str, Array]
    labels: dict[str, tuple[str, ...]]
    error: Array
    robot: str
    method: str

    def __repr__(self) -> str:
        if not len(self.t):
            return f"<EnergyLedger of {self.robot}: empty>"
        parts = ", ".join(f"{kind} {x[-1].sum():.6g}" for kind, x in self.work.items())
        return (
            f"<EnergyLedger of {self.robot} over {self.t[-1] - self.t[0]:g} s: E changes by {self.change[-1]:.6g} J; "
            f"work of {parts} J; error {self.error[-1]:.3g} J, at most {abs(self.error).max():.3g} J>"
        )

    def plot(self, *, kind: str | None = None, ax: Any = None, path: Any = None) -> Any:
        """A Matplotlib Figure: the change of E and the work of each kind over time, and ε on a logarithmic axis.

        kind  one of ``work``: its columns by name instead of the kinds
        ax    two Matplotlib axes to draw into
        path  a file to write

        Raises  SpatialDynError for another kind, another number of axes, a file that cannot be written, or where
                matplotlib is not installed.
        """
        from ..pictures.ledger_plots import plot_ledger

        return plot_ledger(self, kind, ax, path)


def energy_ledger(trajectory: Trajectory, constraints: Any = None, contacts: Any = None) -> EnergyLedger:
    """The energy ledger of a motion: what torques, friction, forces, constraints and contacts do to its energy, and ε.

    Source: the power balance d/dt E = vᵀτ, with the work of impulses after Moreau, ½ λᵀ(u⁻ + u⁺).

    trajectory   of ``simulate(..., record="work")``
    constraints  the Constraints of the run: their names become labels
    contacts     the Contacts of the run, likewise; joint limits of ``limits=True`` are added to them

    The forces of ideal constraints that do not depend on time do no work: W_constraints is 0 to the order of the
    method; with ``stabilization`` their corrections are in it, and otherwise the projections after each step are apart.
    Friction takes energy: W_friction of a joint falls, but for what bristles hold and give back, and for a step in
    which other forces turn the motion round. Contact takes energy too, but where a point comes out of the ground.

    Returns EnergyLedger.
    Raises  SimulationError for a trajectory that recorded no work, or constraints of another number of equations.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> run = sd.simulate(model, [0.5, -0.3], [0, 0], 1.0, 0.01, torque=[1.0, 0.5], record="work")
    >>> ledger = sd.energy_ledger(run)
    >>> bool(abs(ledger.error).max() < 1e-5 < abs(ledger.change).max())
    True
    """
    if not isinstance(trajectory, Trajectory):
        raise SimulationError(f"trajectory is a {type(trajectory).__name__}, expected a Trajectory of simulate")
    found = {kind: trajectory.states[name] for name, kind in KINDS.items() if name in trajectory.states}
    if not found:
        raise SimulationError('trajectory has no work, expected one of simulate(..., record="work")')
    for name, given, kind in (("constraints", constraints, Constraints), ("contacts", contacts, Contacts)):
        if given is not None and not isinstance(given, kind):
            raise SimulationError(f"{name} is {given!r}, expected the {kind.__name__} of the run, or None")
    equations = found.get("constraints")
    if constraints is not None and (equations is None or equations.shape[1] != constraints.nc):
        held = 0 if equations is None else equations.shape[1]
        raise SimulationError(f"constraints have {constraints.nc} equations, expected the {held} of the trajectory")
    touched = found.get("contacts")
    if contacts is not None and touched is not None and touched.shape[1] == len(contacts.with_limits().labels):
        contacts = contacts.with_limits()
    if contacts is not None and (touched is None or touched.shape[1] != len(contacts.labels)):
        held = 0 if touched is None else touched.shape[1]
        count = len(contacts.labels)
        raise SimulationError(f"contacts have {count} points and limits, expected the {held} of the trajectory")
    work = {kind: x - x[:1] for kind, x in found.items()}
    energy = trajectory.energy if trajectory.spring_energy is None else trajectory.energy - trajectory.spring_energy
    change = energy - energy[:1]
    error = change - sum(x.sum(axis=1) for x in work.values())
    labels = {kind: _labels(kind, x.shape[1], trajectory.model, constraints) for kind, x in work.items()}
    if contacts is not None:
        labels["contacts"] = contacts.labels
    return EnergyLedger(trajectory.t, change, work, labels, error, trajectory.robot, trajectory.method)


def _labels(kind: str, count: int, model: Model | None, constraints: Any) -> tuple[str, ...]:
    """Names of the columns of a kind."""
    if kind in BY_FREEDOM and model is not None:
        return tuple(_freedoms(model))
    if kind == "constraints" and constraints is not None:
        return tuple(str(x.label) for x in constraints.equations)
    return (kind,) if count == 1 else tuple(f"{kind} {k}" for k in range(count))


def _freedoms(model: Model) -> Sequence[str]:
    """The joint of each freedom, numbered where it has several."""
    return [
        joint.name if joint.nv == 1 else f"{joint.name} {k}"
        for joint in model.joints[1:] if joint.mimic is None for k in range(joint.nv)
    ]  # fmt: skip
