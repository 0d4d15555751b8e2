"""The energy ledger of a motion: a run carries the work of each kind as a state, and the ledger adds them up.

    E⁺ - E = W_torque + W_friction + W_external + W_springs + W_constraints + W_projection + W_contacts + ε

The method of the run integrates each work from the same values as the motion, so ε is the method's own error and falls
with its order. An impulse λ in a step (dry friction, contact) does the work ½ λᵀ(u⁻ + u⁺), with the velocities u before
and after the step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import SimulationError
from ..model.model import Model
from ..simulation.effects import work as works
from ..simulation.trajectory import Trajectory
from ..waiting import watch

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class EnergyLedger:
    """Energy and work of a motion since its first sample; N samples.

    t           (N,)      time [s]
    change      (N,)      E - E(0), kinetic and potential energy, without that of springs, which do work [J]
    work        {kind: (N, k)}  work done on the robot since the first sample [J]: "torque", "friction", "external"
                and "springs" by freedom, "constraints" by equation, "projection" of all constraints, "contacts" by
                point and limited joint, and the work of further effects; only kinds that acted in the run
    labels      {kind: k names}
    error       (N,)      ε = change - all work: the energy that the integrator's steps add [J]
    robot, method   those of the trajectory
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

    @watch.call("EnergyLedger.plot")
    def plot(self, *, kind: str | None = None, ax: Any = None, path: Any = None) -> Any:
        """A Matplotlib Figure: the change of E and the work of each kind over time, and ε on a logarithmic axis.

        kind  one of ``work``: its columns by name instead of the kinds
        ax    two Matplotlib axes to draw into
        path  a file to write

        Raises  SpatialDynError for another kind, another number of axes, a file that cannot be written, or if
                matplotlib is not installed.
        """
        from ..pictures.ledger_plots import plot_ledger

        return plot_ledger(self, kind, ax, path)


@watch.call("energy_ledger")
def energy_ledger(trajectory: Trajectory) -> EnergyLedger:
    """The energy ledger of a motion: work of torques, friction, forces, constraints and contacts, and the error ε.

    Source: the power balance d/dt E = vᵀτ, with the work of impulses after Moreau, ½ λᵀ(u⁻ + u⁺).

    trajectory  result of ``simulate(..., record="work")``; names of its scene's joints, constraints and points become
                labels

    Ideal constraints that do not depend on time do no work: W_constraints is 0 to the order of the method. With
    ``stabilization`` it includes the corrections; otherwise the projections after each step are listed separately.
    Friction takes energy: W_friction of a joint falls, except while bristles give energy back and in a step in which
    the motion reverses. Contact takes energy too, except when a point comes out of the ground.

    Returns EnergyLedger.
    Raises  SimulationError for a trajectory that recorded no work.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> run = sd.simulate(model, [0.5, -0.3], [0, 0], 1.0, 0.01, torque=[1.0, 0.5], record="work")
    >>> ledger = sd.energy_ledger(run)
    >>> bool(abs(ledger.error).max() < 1e-5 < abs(ledger.change).max())
    True
    """
    if not isinstance(trajectory, Trajectory):
        raise SimulationError(f"trajectory is a {type(trajectory).__name__}, expected a Trajectory of simulate")
    own = () if trajectory.scene is None else (x.work for x in trajectory.scene.effects if x.work is not None)
    shapes = {x.name: x.shape for x in (*works.KNOWN, *own)}
    states = {name: trajectory.states[name] for name in shapes if name in trajectory.states}
    if not states:
        raise SimulationError('trajectory has no work, expected one of simulate(..., record="work")')
    kinds = {name: name.removeprefix(works.PREFIX) for name in states}
    work = {kinds[name]: x - x[:1] for name, x in states.items()}
    energy = trajectory.energy if trajectory.spring_energy is None else trajectory.energy - trajectory.spring_energy
    change = energy - energy[:1]
    error = change - sum(x.sum(axis=1) for x in work.values())
    labels = {kinds[name]: _labels(kinds[name], shapes[name], x.shape[1], trajectory) for name, x in states.items()}
    return EnergyLedger(trajectory.t, change, work, labels, error, trajectory.robot, trajectory.method)


def _labels(kind: str, shape: tuple[str | int, ...], count: int, run: Trajectory) -> tuple[str, ...]:
    """Names of the columns of a kind whose state has this shape, from the scene of the run; numbers without one."""
    names: Sequence[str] = ()
    if shape == works.TORQUE.shape and run.model is not None:
        names = _freedoms(run.model)
    elif shape == works.CONSTRAINTS.shape and run.scene is not None and run.scene.constraints is not None:
        names = [str(x.label) for x in run.scene.constraints.equations]
    elif shape == works.CONTACTS.shape and run.scene is not None:
        names = run.scene.unilateral.labels
    if len(names) == count:
        return tuple(names)
    return (kind,) if count == 1 else tuple(f"{kind} {k}" for k in range(count))


def _freedoms(model: Model) -> Sequence[str]:
    """The joint of each freedom, numbered where it has several."""
    return [
        joint.name if joint.nv == 1 else f"{joint.name} {k}"
        for joint in model.joints[1:] if joint.mimic is None for k in range(joint.nv)
    ]  # fmt: skip
