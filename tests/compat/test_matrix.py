"""Compat and Pinocchio run the same text: every call of the table on every robot, fixed and floating."""

from __future__ import annotations

import re
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from plain import mimics_in_plain_python
from robots import ROBOTS as ALL_ROBOTS
from slow import slow_but

import spatialdyn.compat.pinocchio as ours
from spatialdyn.compat.pinocchio.data.data import FIELDS, SCRATCH
from spatialdyn.errors import InertiaError, SpatialDynError
from spatialdyn.validate.measures import VALUE_BOUND, WELL_CONDITIONED, unit_diagonal

from .calls import CALLS, Row

theirs = pytest.importorskip("pinocchio")

ROBOTS = {name: path for name, path in ALL_ROBOTS.items() if name != "ur3"}
LARGE = {"icub_reduced", "romeo_laas_small"}  # in plain Python so slow that kernels of all calls are compiled for them
LONG = {"tiago_dual", "romeo"}  # ten times as long as the others; "tiago" and "romeo_laas_small" are their like
ROOTS = ("fixed", "floating")
MASSLESS_ENDS = {"romeo", "romeo_laas_small"}  # Pinocchio gives nan and inf where M is singular
OF_MASSLESS = re.compile(r"pin\.(aba|computeMinverse|centerOfMass)\(model, data, q")  # what such ends tell in
SOME = 12  # joints and frames of a robot for which calls about one are made
NAMES = re.compile(r"\b(q|v|a|tau|d|q1|raw)\b(?! in|[^;]* for \1 )")


def array(x: Any) -> np.ndarray:
    """A result or a field as one array of numbers."""
    if x is None:
        return np.zeros(0)
    if hasattr(x, "translation"):
        return np.array(x.homogeneous)
    if hasattr(x, "lever"):
        return np.array(x.matrix())
    if hasattr(x, "linear"):
        return np.array(x.vector)
    if isinstance(x, np.ndarray) or np.isscalar(x):
        return np.array(x, float)
    return np.array([array(y) for y in x])


def scaled(found: Any, expected: Any, ignore_nan: bool = False) -> float:
    """Error of the largest entry, over the largest entry or 1; infinite for another shape."""
    x, y = array(found), array(expected)
    if x.shape != y.shape:
        return float("inf")
    if ignore_nan:
        there = np.isfinite(y)
        x, y = x[there], y[there]
    error = float(np.max(abs(x - y), initial=0.0) / np.max(abs(y), initial=1.0))
    return error if np.isfinite(error) else float("inf")


class Side:
    """One of the modules with a model, a data for each call, and the inputs."""

    def __init__(self, pin: Any, model: Any, seed: int = 0) -> None:
        self.pin, self.model = pin, model
        rng = np.random.default_rng(seed)
        step, v, a, tau, d = rng.normal(size=(5, model.nv))
        q = theirs.normalize(model, theirs.neutral(model)) if pin is theirs else ours.neutral(model)
        q = pin.integrate(model, q, step)
        d = _moderate(model, d)
        some = lambda n: sorted({*np.linspace(0, n - 1, min(n, SOME)).astype(int).tolist()})  # noqa: E731
        placement = pin.SE3(pin.exp3(np.array([0.3, -0.4, 0.5])), np.array([0.1, 0.2, -0.3]))
        masses = [model.inertias[k].mass for k in range(model.njoints)]
        self.values = {
            "pin": pin, "model": model, "q": q, "v": v, "a": a, "tau": tau, "d": d,
            "q1": pin.normalize(model, pin.integrate(model, q, d)), "raw": 1.3 * q, "t": 0.3,
            "fext": [pin.Force(x) for x in rng.normal(size=(model.njoints, 6))],
            "columns": rng.normal(size=(model.nv, 3)),
            "frames": some(model.nframes), "joints": some(model.njoints)[1:], "placement": placement,
            "carried": [k for k in some(model.nframes) if model.frames[k].parentJoint],
            "heavy": [k for k in some(model.njoints) if sum(masses[i] for i in [*model.subtrees[k]] if i) > 0.0],
            "both": (pin.LOCAL, pin.WORLD, pin.LOCAL_WORLD_ALIGNED),
            "J": rng.normal(size=(min(3, model.nv), model.nv)), "gamma": rng.normal(size=min(3, model.nv)),
        }  # fmt: skip

    def run(self, row: Row, data: Any, **values: Any) -> Any:
        """Result of the call."""
        scope = {**self.values, "data": data, **values}
        *before, text = row.text.split(";")
        for line in before:
            exec(line.strip(), scope)
        return eval(text.strip(), scope)


def _moderate(model: Any, d: np.ndarray) -> np.ndarray:
    """Displacements with angles between 0.5 and 2.5: beyond, the shorter way round is open; below, digits are lost."""
    for joint in model.joints[1:] if hasattr(model.joints, "append") else []:
        first = 3 if joint.nv == 6 else 0
        part = d[joint.idx_v + first : joint.idx_v + joint.nv]
        part *= 1.2 / np.linalg.norm(part)
    return d


def sides(name: str, root: str) -> tuple[Side, Side]:
    made = []
    for pin in (ours, theirs):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of inertias that no body can have
            base = (pin.JointModelFreeFlyer(),) if root == "floating" else ()
            made.append(Side(pin, pin.buildModelFromUrdf(str(ROBOTS[name]), *base)))
    made[1].values |= {name: made[0].values[name] for name in ("q", "d", "q1", "raw")}
    return made[0], made[1]


def faults(row: Row, left: Side, right: Side, name: str, condition: float) -> list[str]:
    """Differences, in words."""
    data, peer = left.model.createData(), right.model.createData()
    if row.solves and name in MASSLESS_ENDS:
        try:
            left.run(row, data)
        except InertiaError:
            return []
        return ["no InertiaError"]
    massless = row.mass and ours.computeTotalMass(left.model) == 0.0
    expected = right.run(row, peer)
    try:
        found = left.run(row, data)
    except SpatialDynError as error:
        return [] if massless else [str(error)]
    if massless:
        return []
    if row.solves and condition > WELL_CONDITIONED:
        return []  # Pinocchio's own result is off by more
    bound = max(row.bound, VALUE_BOUND) if row.solves else row.bound
    pairs = [("", found, expected)]
    pairs += [(f"data.{field}", getattr(data, field), getattr(peer, field)) for field in row.fields.split()]
    if name in MASSLESS_ENDS:  # centres of zero mass
        carried = np.array(data.mass) > 0.0
        pairs = [
            (what, x, y)
            if what not in ("data.com", "data.vcom", "data.acom")
            else (what, array(x)[carried], array(y)[carried])
            for what, x, y in pairs
        ]
    errors = [(what, scaled(x, y, name in MASSLESS_ENDS)) for what, x, y in pairs]
    return [f"{what} is off by {error:.1e}" for what, error in errors if not error <= bound]


# each robot at once under one root, the other one in turn
AT_ONCE = {(name, ROOTS[k % 2]) for k, name in enumerate(ROBOTS) if name not in LONG | LARGE and k % 10 == 0}
FUNCTIONS = list(dict.fromkeys(re.findall(r"pin\.\w+", row.text)[-1] for row in CALLS))
PLACES = {row.text: FUNCTIONS.index(re.findall(r"pin\.\w+", row.text)[-1]) for row in CALLS}


PARTS = 12  # of the functions, of which a robot has one
# one root of each robot, in turn: of the robots of a part of the functions half are fixed, half floating
IN_TURN = {(name, ROOTS[k // PARTS % 2]) for k, name in enumerate(ROBOTS)} | AT_ONCE


@pytest.mark.parametrize(
    ("name", "root"),
    slow_but(
        AT_ONCE | {("romeo_laas_small", "floating")},
        [(x, root) for x in ROBOTS for root in ROOTS if (x, root) in IN_TURN],
    ),
)
def test_every_call_equals_the_wheel(name: str, root: str) -> None:
    """Those at once have every function; the others a part of them each, in turn."""
    left, right = sides(name, root)
    M = np.asarray(ours.crba(left.model, left.model.createData(), left.values["q"]))
    with np.errstate(all="ignore"):
        condition = np.linalg.cond(unit_diagonal(M)) if left.model.nv and (np.diag(M) > 0.0).all() else 1.0
    rows = [row for row in CALLS if left.model.nv or not row.jacobian]
    if (name, root) not in AT_ONCE:
        turn = list(ROBOTS).index(name) % PARTS
        massless = name in MASSLESS_ENDS
        rows = [x for x in rows if turn == PLACES[x.text] % PARTS or (massless and OF_MASSLESS.search(x.text))]
    wrong = {row.text: found for row in rows if (found := faults(row, left, right, name, condition))}
    assert wrong == {}


def zoo(pin: Any) -> Any:
    """A tree with a joint of every kind, rotors and bodies on all of them."""
    rng = np.random.default_rng(11)
    composite = pin.JointModelComposite(pin.JointModelRX())
    composite.addJoint(pin.JointModelPY(), _placement(pin, rng))
    composite.addJoint(pin.JointModelSpherical(), _placement(pin, rng))
    u = np.array([1.0, 2.0, -2.0]) / 3.0
    kinds = [
        pin.JointModelFreeFlyer(), pin.JointModelRX(), pin.JointModelRY(), pin.JointModelRZ(), pin.JointModelPX(),
        pin.JointModelPY(), pin.JointModelPZ(), pin.JointModelRUBX(), pin.JointModelRUBY(), pin.JointModelRUBZ(),
        pin.JointModelRevoluteUnaligned(u), pin.JointModelPrismaticUnaligned(u),
        pin.JointModelSpherical(), pin.JointModelSphericalZYX(),
        pin.JointModelTranslation(), pin.JointModelPlanar(), composite,
        pin.JointModelUniversal(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.6, 0.8])),
    ]  # fmt: skip
    model = pin.Model()
    for k, kind in enumerate(kinds):
        at = model.addJoint(max(0, k - k % 3), kind, _placement(pin, rng), f"joint{k:02}")
        model.addJointFrame(at, 0 if k == 0 else -1)
        moments = np.diag([0.1, 0.2, 0.25])
        model.appendBodyToJoint(at, pin.Inertia(1.0 + rng.random(), rng.normal(size=3), moments), _placement(pin, rng))
        model.addBodyFrame(f"body{k}", at, _placement(pin, rng), -1)
    model.armature = rng.random(model.nv)
    model.armature[model.idx_vs[11]] = 0.0  # Pinocchio leaves it out of the kinetic energy, see test_data
    return model


def _placement(pin: Any, rng: np.random.Generator) -> Any:
    return pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))


def screws(pin: Any) -> Any:
    """A tree with every helical joint, of pitches of either sign and 0, and some of the others."""
    rng = np.random.default_rng(12)
    u = np.array([2.0, -1.0, 2.0]) / 3.0
    kinds = [
        pin.JointModelFreeFlyer(), pin.JointModelHX(0.3), pin.JointModelHelicalUnaligned(u, -0.7), pin.JointModelRY(),
        pin.JointModelHY(-1.2), pin.JointModelPZ(), pin.JointModelHZ(0.0), pin.JointModelPX(),
        pin.JointModelHelicalUnaligned(*u, 2.0), pin.JointModelRUBZ(), pin.JointModelHZ(0.1),
    ]  # fmt: skip
    model = pin.Model()
    for k, kind in enumerate(kinds):
        at = model.addJoint(max(0, k - k % 3), kind, _placement(pin, rng), f"joint{k:02}")
        model.addJointFrame(at, 0 if k == 0 else -1)
        body = pin.Inertia(1.0 + rng.random(), rng.normal(size=3), np.diag([0.1, 0.2, 0.25]))
        model.appendBodyToJoint(at, body, _placement(pin, rng))
        model.addBodyFrame(f"body{k}", at, _placement(pin, rng), -1)
    model.armature = rng.random(model.nv)
    model.armature[[model.idx_vs[3], model.idx_vs[9]]] = 0.0  # as in the zoo
    return model


BUILT = {
    "zoo": zoo,
    "screws": screws,
    "manipulator": lambda pin: pin.buildSampleModelManipulator(),
    "humanoid": lambda pin: pin.buildSampleModelHumanoid(),
}
# Pinocchio 4.1 assumes that each joint's S is constant in its body's frame; that of composites, universal joints and
# ZYX angles is not, and results with its rate are wrong there: test_data compares with differences
OF_RATES = re.compile("TimeVariation|Coriolis|dccrba|Derivatives")


@pytest.mark.parametrize("name", BUILT)
def test_every_call_equals_the_wheel_for_every_kind_of_joint(name: str) -> None:
    left, right = (Side(pin, BUILT[name](pin)) for pin in (ours, theirs))
    right.values |= {name: left.values[name] for name in ("q", "d", "q1", "raw")}
    rows = CALLS
    if name == "zoo":
        rows = tuple(
            replace(row, fields=" ".join(x for x in row.fields.split() if x not in ("dJ", "dAg")))
            for row in CALLS
            if not OF_RATES.search(row.text)
        )
    wrong = {row.text: found for row in rows if (found := faults(row, left, right, name, 1.0))}
    assert wrong == {}


@pytest.mark.parametrize("name", slow_but(["panda"], ["panda", "pr2", "baxter", "tiago_pro"]))
def test_calls_that_take_mimic_joints_equal_the_wheel(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pinocchio refuses most calls, gives J a column for each mimic joint too, and wrong rates.

    The slow ones run compiled kernels, the quick one their recursions in plain Python.
    """
    if name == "panda":
        mimics_in_plain_python(monkeypatch)
    models = []
    for pin in (ours, theirs):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            models.append(Side(pin, pin.buildModelFromUrdf(str(ROBOTS[name]), mimic=True)))
    left, right = models
    right.values |= {key: left.values[key] for key in ("q", "d", "q1", "raw")}
    compared = 0
    for row in CALLS:
        refused = False
        try:
            right.run(row, right.model.createData())
        except RuntimeError:
            refused = True
        if refused:
            left.run(row, left.model.createData())
        elif "JointJacobians(" not in row.text and not OF_RATES.search(row.text):
            fields = " ".join(x for x in row.fields.split() if x not in ("J", "dJ"))
            assert faults(replace(row, fields=fields), left, right, name, 1.0) == [], row.text
            compared += 1
    assert compared > 40


@pytest.fixture(scope="module")
def humanoid() -> tuple[Side, Side]:
    return sides("solo12", "floating")


@pytest.mark.parametrize("row", [row for row in CALLS if ";" not in row.text], ids=lambda row: row.text)
def test_every_field_that_the_wheel_fills_is_compared_or_excused(humanoid: tuple[Side, Side], row: Row) -> None:
    _, right = humanoid
    fresh, data = right.model.createData(), right.model.createData()
    right.run(row, data)
    others = {*SCRATCH.split(), "constraint_chol", "contact_chol"}  # no arrays
    names = [name for name in dir(fresh) if not name.startswith("_") and name not in others]
    fields = [name for name in names if not callable(getattr(fresh, name))]
    changed = {name for name in fields if scaled(getattr(data, name), getattr(fresh, name)) > 0.0}
    assert changed <= {*row.fields.split(), *row.but.split()}
    assert {*row.fields.split(), *row.but.split()} <= set(FIELDS)


@pytest.mark.parametrize("longer", [False, True])
@pytest.mark.parametrize("row", CALLS, ids=lambda row: row.text)
def test_wrong_sizes_raise_the_same_kind_of_error(humanoid: tuple[Side, Side], row: Row, longer: bool) -> None:
    left, right = humanoid
    for name in {*NAMES.findall(row.text)}:
        if name in row.text.partition(";")[0] or ";" not in row.text:
            x = left.values[name]
            wrong = {name: np.append(x, 0.0) if longer else x[:-1]}
            kinds = (ValueError, TypeError, RuntimeError)
            with pytest.raises(kinds) as expected:
                right.run(row, right.model.createData(), **wrong)
            kind = next(kind for kind in kinds if issubclass(expected.type, kind))
            with pytest.raises(kind):
                left.run(row, left.model.createData(), **wrong)
