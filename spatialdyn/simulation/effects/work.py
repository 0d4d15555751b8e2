"""Work: a run carries one state of work for each kind of effect; ``ledger`` adds them up."""

from __future__ import annotations

from ...recursions.spec import Argument

PREFIX = "work_"


def work_of(kind: str, shape: tuple[str | int, ...], meaning: str) -> Argument:
    """The state of a kind of work. The ledger shows it under this name, a word with underscores."""
    return Argument(f"{PREFIX}{kind}", shape, "J", meaning, start=0.0)


TORQUE = work_of("torque", ("nv",), "of the torques of motors, those of a control law among them")
FRICTION = work_of("friction", ("nv",), "of friction and damping")
EXTERNAL = work_of("external", ("nv",), "of external forces, by the freedoms that they move")
SPRINGS = work_of("springs", ("nv",), "of springs between rotors and joints, and their damping")
CONSTRAINTS = work_of("constraints", ("nc",), "of the force of each equation")
CONTACTS = work_of("contacts", ("np+nl",), "of each point on the ground, then of each limit")
PROJECTION = work_of("projection", (1,), "what projections onto the constraints add")
KNOWN = (TORQUE, FRICTION, EXTERNAL, SPRINGS, CONSTRAINTS, PROJECTION, CONTACTS)
