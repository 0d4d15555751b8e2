"""A step of a robot in contact: velocities, impulses, gaps."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..bodies.kinds import SE2, SE3
from ..calls.arguments import as_array, as_number
from ..calls.dynamics import calls, checked_call
from ..errors import SimulationError, literal
from ..model.model import Model
from ..recursions.contact.contact import CONTACT_GAPS, CONTACT_GAPS_OVER, CONTACT_STEP, CONTACT_STEP_OVER
from ..recursions.coordinates.coordinate_rates import TURN
from ..recursions.spec import Spec
from .calls import answer
from .contact_points import Contacts, check_contacts

Array = NDArray[np.float64]


class ContactStep(NamedTuple):
    """State after a step, and its impulses: q (..., nq), v (..., nv), impulse (..., k, 3), gap (..., k), residual."""

    q: Array
    v: Array
    impulse: Array
    gap: Array
    residual: Any


def contact_step(
    model: Model, contacts: Contacts, q: ArrayLike, v: ArrayLike, tau: ArrayLike, dt: float
) -> ContactStep:
    """The state after a step dt with contacts: M (v⁺ - v) = dt (tau - bias) + Jᵀ impulse.

    Source: Le Lidec et al., Contact models in robotics (arXiv 2304.06372). Signorini's condition and Coulomb's law hold
    at the end of the step; ``recursions.contact.contact`` finds the impulses point by point.

    model     Model
    contacts  Contacts of this model
    q         (..., nq)  joint positions [rad | m]
    v         (..., nv)  joint velocities [rad/s | m/s]
    tau       (..., nv)  joint torques, held over the step [N m | N]
    dt        [s]

    Returns ContactStep
        q, v      (..., nq), (..., nv)  after the step, q⁺ = q ∘ exp(dt v⁺)
        impulse   (..., k, 3)  on each of the k points, in the world's axes [N s]
        gap       (..., k)     distance of each sphere from the ground before the step, negative below its surface [m]
        residual  (...)        largest violation of the law by the impulses [m/s]: at most the contacts' tolerance if
                  the step is solved
    A step depends on its state alone. ``simulate`` and ``rollout`` take the same steps: the linear velocity of floating
    and planar joints is computed in the axes at the beginning, then turned with the body.
    Raises
        SimulationError for a dt that is not a number above 0
        InertiaError naming a joint with zero articulated inertia, such as that of a massless leg
        ConstraintError, ModelError for contacts of another model; ShapeError, ConfigurationError as ``aba``
        NaN in a sample gives NaN in results that depend on it, and in no other sample

    >>> import numpy as np, spatialdyn as sd
    >>> builder = sd.ModelBuilder("ball").add_body("ball", None, "floating", inertia=(2.0, (0, 0, 0), np.eye(3) / 100))
    >>> ball = builder.build()
    >>> step = sd.contact_step(ball, sd.Contacts(ball, {"ball": 0.1}), [0, 0, 0.1, 0, 0, 0, 1], np.zeros(6),
    ...                        np.zeros(6), 1e-3)
    >>> bool(abs(step.impulse[0] - [0, 0, 2.0 * 9.81 * 1e-3]).max() < 1e-15), float(step.v[2])
    (True, 0.0)
    """
    check_contacts(model, contacts)
    h = as_number(dt)
    if not 0.0 < h < math.inf:
        raise SimulationError(f"dt is {literal(dt)}, expected a positive number of seconds")
    given = (q, v, tau, h, contacts.friction, contacts.restitution)
    out = answer(step_spec(contacts), contacts, contacts.tables, given)
    n, k, stops = model.nv, len(contacts), int(contacts.table.sizes["nl"])
    ends = np.cumsum([n, 3 * k, k, stops, k + stops])
    after, impulse, gap, _, residual, _ = np.split(out, ends, axis=-1)
    if {int(x) for x in model.bodies["kind"]}.isdisjoint((*SE2, *SE3)):
        moved = calls["integrate"](model, q, h * after)
    else:
        found = checked_call(TURN, model, (np.zeros(n), after, np.full(1, h)), (), None)
        after, moved = found[..., :n].copy(), calls["integrate"](model, q, found[..., n:])
    worst = abs(residual).max(axis=-1, initial=0.0)
    return ContactStep(
        moved, after, impulse.reshape((*impulse.shape[:-1], k, 3)), gap, worst if worst.shape else float(worst)
    )


def step_spec(contacts: Contacts) -> Spec:
    """The Spec of a step on the ground of the contacts."""
    return CONTACT_STEP if len(contacts.tables) == 1 else CONTACT_STEP_OVER


def contact_gaps(model: Model, contacts: Contacts, q: ArrayLike) -> Array:
    """Distance of each point's sphere from the ground.

    model     Model
    contacts  Contacts of this model
    q         (..., nq)  joint positions [rad | m]

    Returns gap (..., k) [m], negative below the ground's surface: how far a floating base must sink for feet to touch
    Raises  as ``contact_step``

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> sd.contact_gaps(model, sd.Contacts(model, {"tip": 0.02}, terrain=sd.Plane(height=-2.0)), [0.0, 0.0]).shape
    (1,)
    """
    check_contacts(model, contacts)
    spec = CONTACT_GAPS if len(contacts.tables) == 1 else CONTACT_GAPS_OVER
    made: Array = answer(spec, contacts, contacts.tables, (as_array("q", q),))
    return made


contact_step.spec = CONTACT_STEP  # type: ignore[attr-defined]  # for ``exact`` and ``specialize``
contact_gaps.spec = CONTACT_GAPS  # type: ignore[attr-defined]
