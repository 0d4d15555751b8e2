"""Work: the states of it that a run carries, one of each kind of what acts; ``ledger`` adds them up."""

from __future__ import annotations

from ...recursions.spec import Argument

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
