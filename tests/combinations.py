"""Three robots and everything that may act on them, for tests of all combinations: an arm, one that floats, a gripper.

Options have the names of ``Scene``'s or of a run's, so that a dict of them is a case; see ``scenes``.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
from dense import Array

import spatialdyn as sd
from spatialdyn.recursions.spec import TAU, Argument, Q, Spec, V

ROD = (0.5, (0.02, 0.01, -0.1), np.diag([4e-3, 5e-3, 2e-3]))
PARTS = ("arm", "floating", "gripper")
EFFECTS = (
    "couplers", "stabilized", "contacts", "friction", "lugre", "smooth", "limits", "current", "voltage", "fext",
    "springs", "control", "held law", "work",
)  # fmt: skip
ALIKE = (("couplers", "stabilized"), ("friction", "lugre", "smooth"), ("current", "voltage"), ("control", "held law"))


def robot(name: str, springs: bool = False) -> sd.Model:
    """One of PARTS, with a spring in its second joint."""
    made = sd.ModelBuilder(name, root="trunk")
    if name == "floating":
        made.set_inertia("trunk", (2.0, (0.01, 0, 0.02), np.diag([0.02, 0.03, 0.025])))
    limits: Any = {"damping": 0.0}
    made.add_body("upper", "trunk", axis=(0, 1, 0), inertia=ROD, joint_name="a", limits=(-0.45, 1.2), **limits)
    made.add_body("lower", "upper", axis=(0.6, 0.8, 0), placement=(0, 0, -0.3), inertia=ROD, joint_name="b", **limits)
    follow = {"leader": "b", "multiplier": -0.7, "offset": 0.1} if name == "gripper" else None
    kind = "prismatic" if name == "gripper" else "revolute"
    made.add_body("hand", "lower", kind, (1, 0, 0), (0, 0.02, -0.3), ROD, joint_name="c", mimic=follow, **limits)
    made.add_body("tip", "hand", "fixed", placement=(0, 0, -0.1))
    if springs:
        made.add_series_elastic("a", 40.0, 0.2, 2e-4, 20.0)
    return made.build(root="floating" if name == "floating" else "fixed", mimic=name == "gripper")


def start(model: sd.Model, a: float = -0.44) -> tuple[Array, Array]:
    """A state that meets ``couplers`` and moves towards a limit, the tip 1 mm above the ground of ``contacts``.

    a  [rad] where the joint is whose limit is -0.45
    """
    q, v = sd.neutral(model), np.zeros(model.nv)
    values = {"a": (a, -0.9), "b": (0.3, 0.4), "c": (0.3 * -0.5 + 0.1, 0.4 * -0.5)}
    if model.mimic_matrix is not None:
        values["b"] = 0.3 - (a + 0.44) / 2.25, 0.4
    for joint in model.joints[1:]:
        if joint.name in values and joint.mimic is None:
            q[joint.idx_q], v[joint.idx_v] = values[joint.name]
        elif joint.nq == 1 and joint.mimic is None:  # a rotor, 20 times its joint
            q[joint.idx_q], v[joint.idx_v] = 20.0 * values["a"][0], 20.0 * values["a"][1]
        elif joint.nv == 6:
            v[joint.idx_v : joint.idx_v + 6] = 0.1, 0.05, -0.2, 0.3, -0.1, 0.2
    return q, v


def options(model: sd.Model, name: str) -> dict[str, Any]:
    """The arguments that make one of EFFECTS act, but for springs, which are of the model. Raises what they raise."""
    n = model.nv
    if name in ("couplers", "stabilized"):
        one = sd.CouplerConstraint("c", "b", -0.5, 0.1)
        if model.mimic_matrix is not None:  # c follows b
            one = sd.CouplerConstraint("c", "a", 0.7 / 2.25, -0.11 + 0.44 * 0.7 / 2.25)
        held = sd.Constraints(model, [one])
        return {"constraints": held, **({"stabilization": 0.02} if name == "stabilized" else {})}
    if name == "contacts":
        (gap,) = sd.contact_gaps(model, sd.Contacts(model, {"tip": 0.02}), start(model)[0])
        below = sd.Plane((0.0, 0.0, 1.0), gap - 1e-3)
        return {"contacts": sd.Contacts(model, {"tip": 0.02}, friction=0.6, terrain=below)}
    if name in ("friction", "lugre", "smooth"):
        more = {"lugre": {"bristle_stiffness": 50.0, "bristle_damping": 0.3}, "smooth": {"smoothing": 0.2}}
        law = sd.Friction(0.05, 0.02, **more.get(name, {}))
        return {"friction": law, **({} if name == "friction" else {"friction_method": name})}
    if name in ("current", "voltage"):
        motor = sd.Motor(np.full(n, 0.1), np.full(n, 2.0), np.full(n, 24.0), ratio=20.0, efficiency=0.9)
        return {"motor": motor, **({"drive": "voltage"} if name == "voltage" else {})}
    if name == "fext":
        force = np.zeros((model.njoints, 6))
        force[-1] = 0.5, -0.2, 0.3, 0.02, 0.01, -0.03
        return {"fext": force}
    if name in ("control", "held law"):
        law = sd.Control(LAW, {"reach": np.zeros(model.nq)}, held=name == "held law")
        return {"control": law}
    return {"limits": True} if name == "limits" else {"record": "work"} if name == "work" else {}


def _integral(bodies: Any, q: Any, v: Any, reach: Any, past: Any, tau: Any, past_rate: Any) -> None:
    for i in range(len(tau)):
        tau[i] = -0.2 * v[i] + 0.5 * past[i]
        past_rate[i] = -v[i] + reach[0]


PAST = Argument("past", ("nv",), "rad s", "", start=0.0)
LAW = Spec(
    "integral", _integral, None, (Q, V, Argument("reach", ("nq",), "rad", "goal"), PAST), TAU, "", "",
    parts=(TAU, Argument("past_rate", ("nv",), "rad", "error")), regroup=True,
)  # fmt: skip


def sets(most: int = 2) -> Iterator[tuple[str, ...]]:
    """Each effect, and each pair of those that are not two forms of one."""
    for count in range(most + 1):
        for chosen in itertools.combinations(EFFECTS, count):
            if all(sum(x in chosen for x in alike) <= 1 for alike in ALIKE):
                yield chosen


def case(name: str, chosen: tuple[str, ...]) -> tuple[sd.Model, dict[str, Any]]:
    """The robot and the options of a set of effects. Raises what the library raises."""
    model = robot(name, "springs" in chosen)
    given: dict[str, Any] = {}
    for effect in chosen:
        given |= options(model, effect)
    return model, given
