"""This package's Pinocchio names against Pinocchio: microseconds per call of the same expression under both imports.

    python benchmarks/compat.py             all groups
    python benchmarks/compat.py types       some of types, panda, talos_full_v2, first_hour
    python benchmarks/compat.py types --rows exp6               expressions that contain a text alone
    python benchmarks/compat.py types --against ../before       the package of another checkout too

Both modules take turns, round after round; prints medians over the rounds, less the time of an empty function, of
compiled code. With ``--against`` the package of this checkout and that of another do, each in a process of its own that
waits while the other measures. A row that is slower here, by medians and by minima, is measured again in new processes;
one that is slower there too is named at the end, and the exit status is then 1.

The group ``first_hour`` is what twenty usual calls cost in a new process, where nothing is compiled yet: seconds of CPU
of each first call with an empty cache, of all of them, and of all in a second process, which finds the code on disk.
"""

from __future__ import annotations

import argparse
import gc
import importlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from measure import calls_within, interleaved, per_call

ROUNDS, SECONDS = 15, 0.002
NOISE, LEAST = 0.1, 0.01  # a row is slower by more than this part and so many microseconds
WHEEL, OURS = "pinocchio", "spatialdyn.compat.pinocchio"


class Group(NamedTuple):
    """Expressions of one kind, and the function that makes their values with either module."""

    values: Callable[[Any], dict[str, Any]]
    expressions: Sequence[str]


def typed(pin: Any) -> dict[str, Any]:
    """Spatial objects, from the same numbers."""
    rng = np.random.default_rng(0)
    t, s, q = rng.standard_normal(3), rng.standard_normal(6), rng.standard_normal(4)
    R = pin.Quaternion(q / np.linalg.norm(q)).matrix()
    J = np.diag([1.0, 2.0, 2.5])
    return {
        "pin": pin, "t": t, "s": s, "R": R, "J": J, "M": pin.SE3(R, t), "v": pin.Motion(s), "f": pin.Force(t, s[:3]),
        "I": pin.Inertia(1.0, t, J), "K": pin.Inertia(2.0, t + 1.0, J), "q": pin.Quaternion(R),
        "parameters": pin.Inertia(1.0, t, J).toDynamicParameters(),
    }  # fmt: skip


TYPES = """
pin.SE3(R, t)  pin.SE3.Identity()  M*M  M.inverse()  M.act(M)  M.actInv(M)  M*v  M.actInv(v)  M*f  M.actInv(f)  M*I
M.actInv(I)  M.act(t)  M*t  M.actInv(t)  M.translation  M.rotation  M.homogeneous  M.action  M.copy()
pin.Motion(s)  pin.Motion(t, t)  pin.Motion.Zero()  v+v  v-v  -v  2.0*v  v^v  v^f  v.dot(f)  v.linear  v.vector
pin.Force(t, t)  f+f  pin.Inertia(1.0, t, J)  I+K  I*v  I.vtiv(v)  I.lever  I.inertia  I.matrix()
pin.exp3(t)  pin.log3(R)  pin.exp6(v)  pin.log6(M)  pin.Jexp6(v)  pin.Jlog6(M)  pin.Jlog3(R)  pin.skew(t)
pin.SE3ToXYZQUAT(M)  pin.XYZQUATToSE3(np.arange(7.0))  pin.Quaternion(R)  q*q  q.matrix()  pin.rpy.matrixToRpy(R)
pin.utils.rotate("x", 0.1)  pin.rpy.rpyToMatrix(0.1, 0.2, 0.3)  pin.rpy.rpyToMatrix(t)  pin.exp6(s)  pin.SE3(q, t)
pin.SE3.Interpolate(M, M, 0.3)  pin.SE3.Random()  2*v  v.__iadd__(v)  M.isApprox(M)  M == M  pin.Quaternion(q)
pin.Inertia.FromDynamicParameters(parameters)
"""

DYNAMICS = """
pin.rnea(model, data, q, v, a)
pin.rnea(model, data, q, v, a, fext)
pin.crba(model, data, q)
pin.aba(model, data, q, v, a)
pin.nonLinearEffects(model, data, q, v)
pin.computeGeneralizedGravity(model, data, q)
pin.computeCoriolisMatrix(model, data, q, v)
pin.computeMinverse(model, data, q)
pin.forwardKinematics(model, data, q)
pin.forwardKinematics(model, data, q, v, a)
(pin.forwardKinematics(model, data, q), pin.updateFramePlacements(model, data))
pin.framesForwardKinematics(model, data, q)
(pin.framesForwardKinematics(model, data, q), data.oMf[tip].translation)
pin.computeJointJacobians(model, data, q)
(pin.computeJointJacobians(model, data, q), pin.getFrameJacobian(model, data, tip, pin.LOCAL_WORLD_ALIGNED))
(pin.computeJointJacobians(model, data, q), pin.getFrameJacobian(model, data, tip, pin.WORLD))
pin.getFrameJacobian(model, data, tip, pin.LOCAL_WORLD_ALIGNED)
pin.computeFrameJacobian(model, data, q, tip)
pin.computeFrameJacobian(model, data, q, tip, pin.WORLD)
pin.computeFrameJacobian(model, data, q, tip, pin.LOCAL_WORLD_ALIGNED)
pin.computeJointJacobian(model, data, q, 3)
pin.getJointJacobian(model, data, 3, pin.LOCAL_WORLD_ALIGNED)
pin.getFrameVelocity(model, data, tip)
pin.getFrameVelocity(model, data, tip, pin.LOCAL_WORLD_ALIGNED)
pin.getFrameClassicalAcceleration(model, data, tip, pin.LOCAL_WORLD_ALIGNED)
pin.centerOfMass(model, data, q)
pin.centerOfMass(model, data, q, v)
pin.jacobianCenterOfMass(model, data, q)
pin.computeCentroidalMomentum(model, data, q, v)
pin.ccrba(model, data, q, v)
pin.computeAllTerms(model, data, q, v)
(pin.computeAllTerms(model, data, q, v), data.M, data.nle)
pin.computeRNEADerivatives(model, data, q, v, a)
pin.computeABADerivatives(model, data, q, v, a)
pin.computeGeneralizedGravityDerivatives(model, data, q)
pin.computeJointTorqueRegressor(model, data, q, v, a)
pin.forwardDynamics(model, data, q, v, a, J, drift)
pin.impulseDynamics(model, data, q, v, J, 0.5)
pin.computeTotalMass(model)
pin.computeMechanicalEnergy(model, data, q, v)
pin.jacobianSubtreeCenterOfMass(model, data, q, 3)
(pin.ccrba(model, data, q, v), data.Ig)
(pin.crba(model, data, q), pin.cholesky.decompose(model, data))
pin.cholesky.solve(model, data, v)
pin.getFrameVelocity(model, data, 3, place, pin.LOCAL_WORLD_ALIGNED)
pin.getFrameJacobian(model, data, 3, place, pin.LOCAL_WORLD_ALIGNED)
pin.computeForwardKinematicsDerivatives(model, data, q, v, a)
pin.getFrameVelocityDerivatives(model, data, tip, pin.LOCAL)
pin.computeFrameKinematicRegressor(model, data, tip, pin.LOCAL)
pin.jointBodyRegressor(model, data, 3)
pin.isNormalized(model, q)
pin.integrate(model, q, v)
pin.difference(model, q, q)
pin.neutral(model)
pin.randomConfiguration(model)
(model.gravity.__setattr__("linear", next(weights)), pin.rnea(model, data, q, v, a))
(model.inertias[2].__setattr__("mass", next(masses)), pin.rnea(model, data, q, v, a))
(model.inertias.__setitem__(2, next(bodies)), pin.rnea(model, data, q, v, a))
(model.inertias[2].__setattr__("mass", next(masses)), pin.centerOfMass(model, data, q))
(model.armature.__setitem__(0, next(masses)), pin.rnea(model, data, q, v, a))
(model.jointPlacements[1].translation.__setitem__(0, next(masses)), pin.forwardKinematics(model, data, q))
model.copy()
pin.constraintDynamics(model, data2, q, v, a, contacts, contact_datas, settings)
pin.constraintDynamics(model, data2, q, v, a, contacts, contact_datas)
pin.impulseDynamics(model, data2, q, v, contacts, contact_datas, 0.5, settings)
"""


def robot(name: str, feet: Sequence[str], floating: bool = False) -> Callable[[Any], dict[str, Any]]:
    """A robot in a state, the same for both; its feet are in contact."""

    def values(pin: Any) -> dict[str, Any]:
        from spatialdyn.urdf.load import find_robot

        rng = np.random.default_rng(0)
        model = pin.buildModelFromUrdf(str(find_robot(name)), *([pin.JointModelFreeFlyer()] if floating else []))
        v, a = rng.standard_normal((2, model.nv))
        q = pin.integrate(model, pin.neutral(model), rng.standard_normal(model.nv))
        data = model.createData()
        J = rng.standard_normal((3, model.nv))
        fext = [pin.Force(x) for x in rng.standard_normal((model.njoints, 6))]
        contacts = [
            pin.RigidConstraintModel(
                pin.ContactType.CONTACT_3D, model, model.frames[k].parentJoint, model.frames[k].placement,
                pin.LOCAL_WORLD_ALIGNED,
            )
            for k in (model.getFrameId(foot) for foot in feet)
        ]  # fmt: skip
        contact_datas = [x.createData() for x in contacts]
        data2 = model.createData()  # Pinocchio resizes its factors for the contacts
        pin.initConstraintDynamics(model, data2, contacts, contact_datas)
        weights = cycle(np.array([[0.0, 0.0, -9.81], [0.0, 0.0, -9.8]]))  # each an edit
        return {
            "pin": pin, "model": model, "data": data, "q": q, "v": v, "a": a, "tip": model.nframes - 1, "J": J,
            "drift": J[:, 0].copy(), "weights": weights, "masses": cycle([1.0, 1.1]),
            "bodies": cycle([model.inertias[2].copy(), model.inertias[2] + model.inertias[2]]),
            "data2": data2, "contacts": contacts, "contact_datas": contact_datas,
            "settings": pin.ProximalSettings(1e-12, 1e-9, 10), "place": model.frames[-1].placement.copy(),
            "fext": fext,
        }  # fmt: skip

    return values


CALLS = DYNAMICS.strip().split("\n")
GROUPS: dict[str, Group] = {
    "types": Group(typed, [x for line in TYPES.split("\n") for x in line.split("  ") if x]),
    "panda": Group(robot("panda", ["panda_link8"]), CALLS),
    "talos_full_v2": Group(robot("talos_full_v2", ["left_sole_link"]), CALLS),
    "anymal": Group(
        robot("anymal_b_simple_description/anymal", ("LF_FOOT", "RF_FOOT", "LH_FOOT", "RH_FOOT"), True), CALLS
    ),
}

FIRST_HOUR = "first_hour"
NAMES = [*GROUPS, FIRST_HOUR]


# --- the first hour: calls of a new process ------------------------------------------------------------------

FIRST_CALLS = """
build: model = pin.buildModelFromUrdf(path); data = model.createData(); q = pin.neutral(model); v = np.ones(model.nv)
rnea: pin.rnea(model, data, q, v, v)
crba: pin.crba(model, data, q)
aba: pin.aba(model, data, q, v, v)
nle: pin.nle(model, data, q, v)
g: pin.computeGeneralizedGravity(model, data, q)
kinematics: pin.forwardKinematics(model, data, q, v, v)
frames: pin.framesForwardKinematics(model, data, q)
joint Jacobians: pin.computeJointJacobians(model, data, q)
frame Jacobian: pin.getFrameJacobian(model, data, model.nframes - 1, pin.LOCAL_WORLD_ALIGNED)
frame velocity: pin.getFrameVelocity(model, data, model.nframes - 1)
integrate: pin.integrate(model, q, v)
difference: pin.difference(model, q, q)
com: pin.centerOfMass(model, data, q)
Minverse: pin.computeMinverse(model, data, q)
C: pin.computeCoriolisMatrix(model, data, q, v)
ccrba: pin.ccrba(model, data, q, v)
RNEA derivatives: pin.computeRNEADerivatives(model, data, q, v, v)
log6 of a product: pin.log6(data.oMf[1] * data.oMf[2])
kinetic energy: pin.computeKineticEnergy(model, data, q, v)
"""


def first_seconds(module: str, cache: str, robot: str = "panda") -> dict[str, float]:
    """Seconds of CPU, of all threads, of the import and of each first call in a new process with such a cache."""
    from spatialdyn.urdf.load import find_robot

    command = [sys.executable, __file__, "--first-calls", module, str(find_robot(robot))]
    done = subprocess.run(
        command, env={**os.environ, "SPATIALDYN_CACHE_DIR": cache}, stdout=subprocess.PIPE, text=True, check=True
    )
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def first_calls(module: str, path: str) -> dict[str, float]:
    """``first_seconds``, in this process."""
    start = time.process_time()
    scope = {"np": np, "path": path, "pin": __import__(module, fromlist=["rnea"])}
    found = {"import": time.process_time() - start}
    for line in FIRST_CALLS.strip().split("\n"):
        name, _, statement = line.partition(": ")
        start = time.process_time()
        exec(statement, scope)
        found[name] = time.process_time() - start
    return found


def print_first_hour() -> None:
    """A line for each call, with seconds of CPU of the wheel, and of this package with an empty and a filled cache."""
    with TemporaryDirectory() as cache:
        columns = [first_seconds(WHEEL, cache)]
        columns += [first_seconds(OURS, cache) for _ in range(2)]
    print(f"{'first_hour: s of CPU, panda':40s}{'wheel':>9s}{'empty':>9s}{'kept':>9s}")
    for name in columns[0]:
        print(f"{name:40s}" + "".join(f"{column[name]:9.3f}" for column in columns))
    print(f"{'in all':40s}" + "".join(f"{sum(column.values()):9.3f}" for column in columns))


def compile_all() -> None:
    """Compile all functions and programs that were called so far, which are interpreted until compiling pays."""
    try:
        from spatialdyn.engines.compiled.tiers import Tier
        from spatialdyn.engines.programs.run.tiered_program import TieredProgram
    except ImportError:  # an older checkout, which compiles at the first call
        return
    for x in gc.get_objects():
        if isinstance(x, Tier) and x.called:
            x.compile_now()
        elif isinstance(x, TieredProgram):
            x.compiled(one=True)


def warm(runs: Sequence[Callable[[], Any]]) -> None:
    """Leave out compilation, and loading at the second and third call."""
    for _ in range(3):
        for run in runs:
            for _ in range(5):
                run()
        compile_all()


class Calls:
    """The expressions of a group as functions of its values with a module, for some need what others left."""

    def __init__(self, group: Group, module: Any) -> None:
        values = {"np": np, **group.values(module)}
        self.made = {x: eval(f"lambda: {x}", values) for x in group.expressions}
        self.waiting = [*group.expressions]

    def prepared(self, expression: str) -> Callable[[], Any]:
        """The function of an expression; those before it were called."""
        while expression in self.waiting:
            self.made[self.waiting.pop(0)]()
        return self.made[expression]


def timed(
    group: Group, expressions: Sequence[str], modules: Mapping[str, Any]
) -> Iterator[tuple[str, dict[str, float]]]:
    """Microseconds per call of each expression under each module."""
    calls = {name: Calls(group, module) for name, module in modules.items()}
    empty = interleaved({"empty": lambda: None}, ROUNDS, SECONDS)["empty"]
    for expression in expressions:
        contestants = {name: calls[name].prepared(expression) for name in modules}
        warm([*contestants.values()])
        seconds = interleaved(contestants, ROUNDS, SECONDS)
        yield expression, {name: 1e6 * (x - empty) for name, x in seconds.items()}


# --- against another checkout --------------------------------------------------------------------------------


def serve(modules: Sequence[str]) -> None:
    """Measure a round, of a row of a group that a line of the input names, and print microseconds of each module."""
    imported = [__import__(module, fromlist=["rnea"]) for module in modules]
    empty = min(per_call(lambda: None, 10000) for _ in range(ROUNDS))
    name, row = "", ""
    of_group: list[Calls] = []
    runs: list[Callable[[], Any]] = []
    counts: list[int] = []
    for line in sys.stdin:
        group, expression = json.loads(line)
        if group != name:
            name, row, of_group = group, "", [Calls(GROUPS[group], module) for module in imported]
        if expression != row:
            row, runs = expression, [calls.prepared(expression) for calls in of_group]
            warm(runs)
            counts = [calls_within(run, SECONDS) for run in runs]
        taken = [1e6 * (per_call(run, n) - empty) for run, n in zip(runs, counts, strict=True)]
        print(json.dumps(taken), flush=True)


class Checkout:
    """A process that measures rows with the package of a checkout."""

    def __init__(self, path: Path, modules: Sequence[str]) -> None:
        self.path = path
        self.process = subprocess.Popen(
            [sys.executable, __file__, "--serve", *modules], env={**os.environ, "PYTHONPATH": str(path)},
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    def round(self, group: str, expression: str) -> list[float]:
        """Microseconds of an expression of a group under each module, in one round."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        print(json.dumps([group, expression]), file=self.process.stdin, flush=True)
        line = self.process.stdout.readline()
        if not line:
            sys.exit(f"{group}: {expression}: the process of {self.path} ended")
        taken: list[float] = json.loads(line)
        return taken

    def close(self) -> None:
        """End the process."""
        self.process.communicate()


class Row(NamedTuple):
    """Microseconds of an expression in each round: of the wheel, of the other checkout, and of this one."""

    wheel: Sequence[float]
    old: Sequence[float]
    new: Sequence[float]

    @property
    def slower(self) -> bool:
        """Whether this checkout is slower than the other, by medians and by minima."""
        return all(of(self.new) > (1.0 + NOISE) * of(self.old) + LEAST for of in (median, min))


def turns(path: Path, rows: Sequence[tuple[str, str]]) -> Iterator[Row]:
    """The rounds of rows, each a group and an expression, of which the checkouts take turns."""
    old, new = Checkout(path, [OURS]), Checkout(Path(__file__).parents[1], [WHEEL, OURS])
    try:
        for row in rows:
            rounds = [(*new.round(*row), *old.round(*row)) for _ in range(ROUNDS + 1)][1:]  # the first prepares
            wheel, ours, before = zip(*rounds, strict=True)
            yield Row(wheel, before, ours)
    finally:
        old.close()
        new.close()


def compare(path: Path, rows: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """Print a line for each row; returns those that are slower here, in each of two pairs of processes."""
    slower, before = [], ""
    for (group, expression), row in zip(rows, turns(path, rows), strict=True):
        if group != before:
            print(f"{group:74s}{'wheel':>9s}{'before':>9s}{'now':>9s}{'/wheel':>8s}{'/before':>8s}")
            before = group
        wheel, old, new = map(median, row)
        mark = " slower" if row.slower else ""
        print(f"{expression:74s}{wheel:9.3f}{old:9.3f}{new:9.3f}{new / wheel:8.2f}{new / old:8.2f}{mark}", flush=True)
        if row.slower:
            slower.append((group, expression))
    return [name for name, row in zip(slower, turns(path, slower), strict=True) if row.slower] if slower else []


def main(arguments: Sequence[str]) -> int:
    """Print a line for each expression; returns 1 if one is slower than with the other checkout."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("groups", nargs="*", metavar="GROUP", help=f"some of {', '.join(NAMES)}; by default all")
    parser.add_argument("--rows", default="", metavar="TEXT", help="expressions that contain this text alone")
    parser.add_argument("--against", type=Path, metavar="CHECKOUT", help="folder of another checkout to compare with")
    parser.add_argument("--first-calls", nargs=2, metavar=("MODULE", "URDF"), help=argparse.SUPPRESS)
    parser.add_argument("--serve", nargs="+", metavar="MODULE", help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    if given.first_calls:
        print(json.dumps(first_calls(*given.first_calls)))
        return 0
    if given.serve:
        serve(given.serve)
        return 0
    chosen = given.groups or NAMES
    unknown = [name for name in chosen if name not in NAMES]
    if unknown:
        parser.error(f"group is {unknown[0]!r}, expected some of {', '.join(NAMES)}")
    rows = [(name, x) for name in chosen if name != FIRST_HOUR for x in GROUPS[name].expressions if given.rows in x]
    if given.against is not None:
        if not (given.against / "spatialdyn").is_dir():
            parser.error(f"--against is {str(given.against)!r}, expected a folder with spatialdyn in it")
        slower = compare(given.against.resolve(), rows)
        for group, expression in slower:
            print(f"slower than before: {group}: {expression}")
        return int(bool(slower))
    if FIRST_HOUR in chosen and not given.rows:
        print_first_hour()
    modules = {"wheel": importlib.import_module(WHEEL), "ours": importlib.import_module(OURS)}
    for name in (name for name in chosen if name != FIRST_HOUR):
        print(f"{name:74s}{'wheel':>9s}{'ours':>9s}{'ratio':>8s}")
        for expression, taken in timed(GROUPS[name], [x for group, x in rows if group == name], modules):
            ratio = taken["ours"] / taken["wheel"]
            print(f"{expression:74s}{taken['wheel']:9.3f}{taken['ours']:9.3f}{ratio:8.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
