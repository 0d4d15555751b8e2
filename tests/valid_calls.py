"""Valid arguments of every public name, small and quick: what ``test_odd_arguments`` puts one odd value in place of.

``targets`` lists what can be called with arguments: the functions of ``spatialdyn.__all__``, its classes, and methods
as CLASS.METHOD. Records that calls return (named tuples, plain dataclasses) keep whatever they are made of, so of those
the methods alone are there. ``arguments`` fails for a target without a row.
"""

from __future__ import annotations

import inspect
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from inputs import options, random_inputs, sorted_inputs

import spatialdyn as sd
from spatialdyn.recursions import SPECS
from spatialdyn.recursions.spec import TAU, Argument, Q, Spec, V

TOML = '[[constraint]]\nkind = "coupler"\njoint = "joint2"\nto = "joint1"'
MJCF = '<equality><joint joint1="joint2" joint2="joint1" polycoef="0.1 -2"/></equality>'
SOLID = (1.0, (0.0, 0.0, 0.1), 0.1 * np.eye(3))


@cache
def model() -> sd.Model:
    """Two hinges."""
    return sd.load_urdf("two_link")


@cache
def other() -> sd.Model:
    """A slide and two hinges: another number of everything."""
    builder = sd.ModelBuilder("other")
    for k, kind in enumerate(("prismatic", "revolute", "revolute")):
        builder.add_body(f"b{k}", f"b{k - 1}" if k else None, kind, np.eye(3)[k], (0.1, 0.0, 0.3), SOLID)
    return builder.build()


@cache
def elastic() -> sd.Model:
    """A hinge behind a spring."""
    return elastic_builder().add_series_elastic("b_joint", 100.0, rotor=0.1).build()


def elastic_builder() -> sd.ModelBuilder:
    """A hinge."""
    return sd.ModelBuilder("elastic").add_body("b", None, "revolute", (0, 1, 0), None, SOLID)


@cache
def held() -> sd.Constraints:
    """The tip in a plane."""
    return sd.Constraints(model(), [sd.PointConstraint("tip", axes="x")])


@cache
def touching() -> sd.Contacts:
    """A sphere at the tip, which may touch the ground."""
    return sd.Contacts(model(), {"tip": 0.1})


@cache
def run() -> sd.Trajectory:
    """Four steps."""
    return sd.simulate(model(), q(), v(), 0.04, 0.01, record="work")


@cache
def samples() -> sd.Rollout:
    """Two motions of three steps."""
    return sd.rollout(model(), np.zeros((2, 2)), np.zeros((2, 2)), dt=0.01, steps=3, record=1)


@cache
def friction() -> sd.Friction:
    """Of two joints."""
    return sd.Friction([0.1, 0.1], [0.2, 0.2])


@cache
def motor() -> sd.Motor:
    """Of two joints."""
    return sd.Motor([0.1, 0.1], [1.0, 1.0], [24.0, 24.0])


def _towards(bodies: Any, q: Any, v: Any, reach: Any, tau: Any) -> None:
    for i in range(len(tau)):
        tau[i] = reach[i] - q[i] - v[i]


def _squares(bodies: Any, q: Any, cost: Any) -> None:
    cost[0] = sum(x * x for x in q)


@cache
def log() -> sd.Recording:
    """A motion of both joints."""
    t = np.linspace(0.0, 2.0, 81)
    path = sd.fourier([[1.0, 0.5], [0.4, 1.5]], [[0.2, 1.0], [0.8, 0.1]], 0.5, [0.3, 0.1])
    q, v, a = path(t)
    tau = sd.rnea(model(), q, v, a) + 0.01 * np.random.default_rng(0).normal(size=v.shape)
    return sd.Recording(t, q, tau, v, a)


@cache
def identified() -> sd.Identified:
    """The two hinges, from it."""
    return sd.identify(log(), model(), "log_cholesky", "inertial")


LAW = Spec("towards", _towards, None, (Q, V, Argument("reach", ("nv",), "rad", "goal")), TAU, "", "")
SQUARES = Spec("squares", _squares, None, (Q,), Argument("cost", (1,), "", ""), "", "")


@cache
def control() -> sd.Control:
    """A spring and a damper."""
    return sd.Control(LAW, {"reach": [0.1, 0.2]})


@cache
def program() -> sd.Specialized:
    """The mass matrix."""
    made = sd.specialize(model(), sd.crba)
    assert isinstance(made, sd.Specialized)
    return made


@cache
def promise() -> sd.Promise:
    """The mass matrix within a bound."""
    made = sd.specialize(model(), sd.crba, tolerance=1e-9)
    assert isinstance(made, sd.Promise)
    return made


@cache
def symbols() -> sd.SymbolicManipulator:
    """Of the two hinges."""
    return sd.SymbolicManipulator(model())


@cache
def recommendation() -> sd.Recommendation:
    """Of two integrators."""
    return sd.recommend(model(), batch=8, tolerance=1e-3, states=2)


@cache
def bounded_scene() -> sd.Scene:
    """The two hinges with limits."""
    return sd.Scene(model(), limits=True)


@cache
def requirement() -> sd.Requirement:
    """Of a short motion: whether the limits matter."""
    return sd.requires(bounded_scene(), q(), v(), 0.02, 0.1, samples=2, dt=0.01, kinds="limits")


@cache
def findings() -> sd.Diagnosis:
    """Of the two hinges."""
    return sd.diagnose(model())


@cache
def floating() -> sd.Model:
    """A base that floats, and an arm on it."""
    builder = sd.ModelBuilder("satellite", "world").add_body("bus", None, "floating", inertia=SOLID)
    return builder.add_body("arm", "bus", axis=(0, 0, 1), placement=(0.5, 0, 0), inertia=SOLID).build()


@cache
def path() -> sd.Path:
    """Of two coordinates."""
    return sd.quintic([0.0, 0.0], [1.0, 0.5], 2.0)


@cache
def passive() -> sd.PassivityRecord:
    """Of four steps."""
    return sd.passivity(run())


@cache
def adaptive() -> sd.SlotineLi:
    """Of two hinges, with friction."""
    friction = sd.Friction([0.1, 0.1], smoothing=0.1)
    return sd.SlotineLi(model(), 5.0, 4.0, q(), sd.inertial_parameters(model()), 0.1, friction=friction)


@cache
def natural() -> sd.NaturalAdaptation:
    """Of a slide and two hinges, with friction."""
    friction = sd.Friction([0.1, 0.1, 0.1], smoothing=0.1)
    pi = sd.inertial_parameters(other())
    return sd.NaturalAdaptation(other(), 5.0, 4.0, np.zeros(3), pi, 10.0, friction=friction)


def _naturally() -> sd.Trajectory:
    return sd.simulate(other(), np.zeros(3), np.ones(3), 0.02, 0.01, control=natural())


def observer() -> sd.MomentumObserver:
    """That has seen a state."""
    made = sd.MomentumObserver(model(), 50.0, 1e-3)
    made.update(q(), v(), tau())
    return made


def _reached() -> Any:
    return sd.frame_placement(model(), q(), "tip")


def q() -> Any:
    """Joint positions."""
    return np.array([0.5, -0.3])


def v() -> Any:
    """Joint velocities."""
    return np.array([1.0, 2.0])


def tau() -> Any:
    """Joint torques."""
    return np.array([0.1, 0.2])


def _state(**more: Any) -> dict[str, Any]:
    return {"model": model(), "q": q(), "v": v(), **more}


def _held(*names: str, **more: Any) -> dict[str, Any]:
    values = {"q": q(), "v": v(), "tau": tau()}
    return {"model": model(), "constraints": held(), **{name: values[name] for name in names}, **more}


def _run_of(**more: Any) -> dict[str, Any]:
    return {"scene": model(), "q0": q(), "v0": v(), "dt": 0.01, **more}


def _in_scene(given: dict[str, Any]) -> dict[str, Any]:
    return {("scene" if name == "model" else name): x for name, x in given.items()}


def _jacobian() -> dict[str, Any]:
    return {"J": sd.frame_jacobian(model(), q(), "tip", "local_world_aligned")[[0]]}


def _fext() -> Any:
    return np.zeros((3, 6))


CONSTRAINT = {"frame_a": "tip", "frame_b": "base", "name": "loop"}
PLACES = {"at_a": np.zeros(3), "at_b": np.eye(4)}


# {target: its arguments}; what is not there is left to its default, but for an odd value; a tuple is all of ``*x``
def _outputs() -> dict[str, Any]:
    tau = np.array([[1.0, 2.0], [3.0, 5.0]])
    return {"arrays": {"tau": tau, "most": tau[:, 1]}, "first": 4}


def _draw(scene: Any, rng: Any, n: int) -> dict[str, Any]:
    return {"tau": rng.random((n, 2))}


def _studied() -> dict[str, Any]:
    folder = Path(tempfile.mkdtemp(), "study")
    return {
        "fn": _draw,
        "scene": model(),
        "samples": 5,
        "chunk": 3,
        "seed": 1,
        "folder": folder,
        "keep": ("tau",),
        "reduce": {"tau": sd.Moments("tau")},
    }


ROWS: dict[str, Callable[[], dict[str, Any]]] = {
    "Base.text": lambda: {"k": 0},
    "ChristoffelC": lambda: {"model": model()},
    **{
        f"ChristoffelC.{name}": lambda: {"q": q(), "v": v()}
        for name in ("__call__", "by_rnea_columns", "from_derivatives", "not_christoffel", "recursive")
    },
    "ChristoffelC.by_finite_differences": lambda: {"q": q(), "v": v()},
    "ComputedTorque": lambda: {"Kp": 9.0, "Kd": [6.0, 6.0], "path": path()},
    "ComTask": lambda: {"target": np.zeros(3), "Kp": 9.0},
    "ComTask.check": lambda: {"model": model()},
    "ComTask.rows": lambda: {"model": model(), "q": q(), "v": v()},
    "ComTask.with_": lambda: {"weight": 2.0},
    "Constraints": lambda: {"model": model(), "items": [sd.PointConstraint("tip")]},
    "Constraints.of_entries": lambda: {"model": model(), "entries": [{"kind": "point", "frame_a": "tip"}]},
    "Constraints.of_mjcf": lambda: {"model": model(), "text": MJCF, "q": q()},
    "Constraints.of_toml": lambda: {"model": model(), "text": TOML},
    "Contacts": lambda: {"model": model(), "points": {"tip": 0.1}},
    "Contacts.with_dry": lambda: {"dry": np.array([True, False])},
    "Control": lambda: {"spec": LAW, "values": {"reach": [0.1, 0.2]}},
    "Control.__call__": lambda: {"model": model(), "t": 0.1, "q": q(), "v": v(), "tau": tau(), "states": {}},
    "Control.axes": lambda: {"model": model()},
    "Control.limited_by": lambda: {"limits": np.array([1.0, 2.0])},
    "Control.of": lambda: {"spec": LAW, "values": {"reach": np.array([0.1, 0.2])}},
    "Control.rows": lambda: {"model": model(), "samples": 1, "steps": 2},
    "Cost": lambda: {"spec": SQUARES},
    "CouplerConstraint": lambda: {"joint": "joint2", "to": "joint1", "name": "gear"},
    "Diagnosis.of": lambda: {"kind": "mass"},
    "Diagnosis.report": lambda: {"path": "report.html"},
    "DistanceConstraint": lambda: {**CONSTRAINT, **PLACES, "length": 1.0},
    "EnergyLedger.plot": dict,
    "EnergyShaping": lambda: {"Kp": np.array([20.0, 20.0]), "Kd": np.array([5.0, 5.0]), "q_d": q()},
    "EnergyShaping.energy": lambda: {"model": model(), "q": q(), "v": v()},
    "Exact": lambda: {"model": model(), **_of_exact()},
    "Exact.__call__": lambda: {"values": q()},
    "FrameTask": lambda: {"frame": "tip", "target": np.zeros(3), "axes": "xz", "Kp": 9.0},
    "FrameTask.check": lambda: {"model": model()},
    "FrameTask.rows": lambda: {"model": model(), "q": q(), "v": v()},
    "FrameTask.with_": lambda: {"weight": 2.0},
    "Friction": lambda: {"coulomb": [0.1, 0.1], "viscous": [0.2, 0.2]},
    "Friction.check": lambda: {"model": model()},
    "Friction.of": lambda: {"model": model(), "coulomb": [0.1, 0.1]},
    "Gravity": dict,
    "Heightfield": lambda: {"z": np.zeros((3, 4)), "spacing": 0.5},
    "Impedance": lambda: {"model": model(), "frame": "tip", "target": _reached(), "K": 50.0, "D": np.full(6, 5.0),
                          "velocity": np.zeros(6), "acceleration": np.zeros(6)},
    "HingeConstraint": lambda: {**CONSTRAINT, **PLACES},
    "Identified.report": lambda: {"path": "report.html", "validation": log()},
    "Identified.validate": lambda: {"recording": log()},
    "LQR.feedback": lambda: {"q": np.zeros(1), "v": np.zeros(1), "tau": np.zeros(1)},
    "LyapunovRecord.plot": dict,
    "Model": lambda: {"robot": model().robot, "options": model().options},
    "Model.frame": lambda: {"name": "tip"},
    "Model.joint": lambda: {"name": "joint1"},
    "Model.reduced": lambda: {"lock": ["joint2"]},
    "Model.rigid": lambda: {"joints": ()},
    "Model.subtree": lambda: {"link": "link1"},
    "Model.with_": lambda: {"armature": {"joint1": 0.1}},
    "ModelBuilder": dict,
    "ModelBuilder.add_body": lambda: {"name": "next", "parent": "b", "inertia": SOLID},
    "ModelBuilder.add_series_elastic": lambda: {"joint": "b_joint", "stiffness": 100.0, "rotor": 0.1, "ratio": 2.0},
    "ModelBuilder.build": lambda: {"gravity": (0.0, 0.0, -9.81), "root": "fixed"},
    "ModelBuilder.robot": dict,
    "NaturalAdaptation": lambda: {"model": other(), "rates": 5.0, "gain": np.ones(3), "path": np.zeros(3),
                                  "parameters": sd.inertial_parameters(other()), "gamma": 10.0},
    **{f"SlotineLi.{name}": lambda: {"run": sd.simulate(model(), q(), v(), 0.02, 0.01, control=adaptive())}
       for name in ("estimates", "frictions")},
    **{f"NaturalAdaptation.{name}": lambda: {"run": _naturally()}
       for name in ("estimates", "frictions", "pseudo_inertias")},
    "NaturalAdaptation.excitation": lambda: {"q": np.zeros((2, 3)), "v": np.ones((2, 3)), "a": np.ones((2, 3))},
    "SlotineLi": lambda: {"model": model(), "rates": 5.0, "gain": np.array([4.0, 4.0]), "path": q(),
                          "parameters": sd.inertial_parameters(model()), "Gamma": 0.1,
                          "friction": sd.Friction([0.1, 0.1], smoothing=0.1)},
    "SlotineLi.excitation": lambda: {"q": np.zeros((2, 2)), "v": np.ones((2, 2)), "a": np.ones((2, 2))},
    "ModelBuilder.set_inertia": lambda: {"link": "b", "inertia": SOLID},
    "MomentumObserver": lambda: {"model": model(), "gain": np.array([50.0, 50.0]), "dt": 1e-3},
    "MomentumObserver.update": lambda: {"q": q(), "v": v(), "tau": tau()},
    "Motor": lambda: {"torque_constant": [0.1, 0.1], "resistance": [1.0, 1.0], "voltage": [24.0, 24.0]},
    "Motor.check": lambda: {"model": model()},
    "PD": lambda: {"kp": np.array([9.0, 9.0]), "kd": np.array([6.0, 6.0]), "q_ref": q(), "v_ref": v()},
    "PDGravity": lambda: {"Kp": 9.0, "Kd": np.array([6.0, 6.0]), "q_d": q()},
    "PDPlus": lambda: {"Kp": np.eye(2), "Kd": np.array([6.0, 6.0]), "path": path()},
    "Passivity": lambda: {"rates": 9.0, "gain": np.array([6.0, 6.0]), "path": path()},
    "PassivityRecord.order": lambda: {"other": passive()},
    "PassivityRecord.plot": dict,
    "Path": lambda: {"model": None, "spec": path().spec, "values": dict(path().values), "duration": 2.0},
    "Moments": lambda: {"output": "tau"},
    "Moments.of": _outputs,
    "Moments.merge": lambda: dict.fromkeys("ab", sd.Moments("tau").of(**_outputs())),
    "Moments.finish": lambda: {"state": sd.Moments("tau").of(**_outputs())},
    "Quantiles": lambda: {"output": "tau", "at": (0.1, 0.9), "bits": 8},
    "Quantiles.of": _outputs,
    "Quantiles.merge": lambda: dict.fromkeys("ab", sd.Quantiles("tau").of(**_outputs())),
    "Quantiles.finish": lambda: {"state": sd.Quantiles("tau").of(**_outputs())},
    "Study": _studied,
    "Study.result": lambda: {"partial": True},
    "Study.run": lambda: {"executor": None, "progress": False, "threads": None},
    "Study.warm": lambda: {"executor": None, "threads": None},
    "TallQR": lambda: {"output": "tau"},
    "TallQR.of": _outputs,
    "TallQR.merge": lambda: dict.fromkeys("ab", sd.TallQR("tau").of(**_outputs())),
    "TallQR.finish": lambda: {"state": sd.TallQR("tau").of(**_outputs())},
    "Worst": lambda: {"output": "most", "count": 3, "beside": ("tau",), "least": True},
    "Worst.of": _outputs,
    "Worst.merge": lambda: dict.fromkeys("ab", sd.Worst("most").of(**_outputs())),
    "Worst.finish": lambda: {"state": sd.Worst("most").of(**_outputs())},
    "Path.__call__": lambda: {"t": np.array([0.0, 1.0])},
    "Path.check_limits": lambda: {"model": model()},
    "Path.check_model": lambda: {"model": model()},
    "Path.plot": dict,
    "Plane": dict,
    "PointConstraint": lambda: {**CONSTRAINT, **PLACES},
    "PostureTask": lambda: {"target": q(), "Kp": 9.0, "joints": ["joint1", "joint2"]},
    "PostureTask.at": lambda: {"model": model()},
    "PostureTask.check": lambda: {"model": model()},
    "PostureTask.rows": lambda: {"model": model(), "q": q(), "v": v()},
    "PostureTask.with_": lambda: {"weight": 2.0},
    "Promise": lambda: {"request": program()._request, "tolerance": 1e-9, "maker": sd.specialize, "arguments": (),
                        "bounded": lambda dtype: sd.bounded(model(), sd.crba, dtype)},
    "Promise.__call__": lambda: {"arrays": q()},
    "Recommendation.__call__": lambda: {"arguments": (q(), v(), tau())},
    "Recording": lambda: {"t": log().t, "q": log().q, "tau": log().tau, "v": log().v, "a": log().a},
    "Recording.check": lambda: {"model": model()},
    "Recording.from_columns": lambda: {"columns": {"t": log().t, "q0": log().t, "tau0": log().t}, "model": model()},
    "Recording.load": lambda: {"path": "log.csv"},
    "Recording.of": lambda: {"run": run()},
    "Recording.save": lambda: {"path": "saved.csv"},
    "Recording.torques": lambda: {"model": model()},
    "Requirement.plot": dict,
    "Requirement.to_full": lambda: {"q": q(), "v": v()},
    "Requirement.to_reduced": lambda: {"q": q(), "v": v()},
    "RollingConstraint": lambda: {"frame": "tip", "axis": (0.0, 1.0, 0.0), "radius": 0.1, "name": "wheel"},
    "Rollout.plot": dict,
    "Scene": lambda: {"model": model(), "friction": friction(), "contacts": touching(), "limits": True},
    "Scene.from_toml": lambda: {"model": model(), "text": "limits = true"},
    "Scene.of": lambda: {"model": model()},
    "Scene.unfit": lambda: {"method": "rk4"},
    "Scene.with_": lambda: {"friction": None},
    "Specialized": lambda: {"request": program()._request, "maker": sd.specialize, "arguments": ()},
    "Specialized.__call__": lambda: {"arrays": q()},
    "Specialized.c_code": dict,
    "Specialized.python_code": dict,
    "Specialized.to_casadi": dict,
    "StateFeedback": lambda: {"K": np.ones((1, 4)), "q": q(), "v": v(), "tau": tau(), "joints": [0]},
    "SymbolicManipulator": lambda: {"model": model()},
    "SymbolicManipulator.C": dict,
    "SymbolicManipulator.christoffel": dict,
    "SymbolicManipulator.evaluate": lambda: {"name": "frame_placement", "frame": "tip"},
    "SymbolicManipulator.poisson_bracket": lambda: {"F": symbols().q[0], "G": symbols().p[0]},
    "SymbolicManipulator.simplify": lambda: {"expression": symbols().q[0]},
    **{
        f"SymbolicManipulator.{name}": lambda: {"what": "M"}
        for name in ("c_code", "lambdify", "latex", "python_code", "quantity", "text")
    },
    "Tradeoff.cheapest": lambda: {"tolerance": 1e-6},
    "Tradeoff.plot": dict,
    "Tradeoff.report": lambda: {"path": "report.html"},
    "Trajectory.load": lambda: {"path": "run.npz"},
    "Trajectory.plot": lambda: {"what": "q"},
    "Trajectory.report": lambda: {"path": "report.html"},
    "Trajectory.save": lambda: {"path": "run.npz"},
    "Transmission": lambda: {"joints": ("joint1", "joint2"), "matrix": [[0.5, 0.5], [0.5, -0.5]]},
    "VelocityConstraint": lambda: {"A": [1.0, 2.0]},
    "WholeBody": lambda: {"scene": sd.Scene(model(), contacts=touching()), "tasks": sd.PostureTask(q())},
    "WholeBody.__call__": lambda: {"t": 0.0, "q": q(), "v": v()},
    "WholeBody.program": lambda: {"q": q(), "v": v()},
    "WholeBody.solve": lambda: {"q": q(), "v": v(), "tasks": [sd.PostureTask(q())]},
    "WeldConstraint": lambda: {**CONSTRAINT, **PLACES},
    "assemble": lambda: {"robot": model().robot},
    "base_parameters": lambda: {"model": model(), "parameters": "inertial", "samples": 60},
    "base_velocity": lambda: {"model": floating(), "q": sd.neutral(floating()), "v_joints": np.ones(1),
                              "momentum": np.zeros(6)},
    "bounded": lambda: {"model": model(), "call": sd.crba},
    "cartesian_damping": lambda: {"Lambda": np.eye(2), "K": np.array([1.0, 2.0]), "zeta": 0.7},
    "check_conservation": lambda: {"trajectory": run()},
    "close_loops": lambda: _held("q"),
    "closed_step": lambda: {"scene": model(), "law": sd.PD(9.0, 6.0, q()), "q": q(), "v": v(), "dt": 0.01,
                            "method": "rk4"},
    "compare_with_pinocchio": lambda: {"source": "two_link", "root": "fixed", "samples": 2, "calls": ["rnea"]},
    "compile": lambda: {"model": model(), "calls": "rnea"},
    "conserved_quantities": lambda: {"model": model()},
    "constrained_dynamics": lambda: _held("q", "v", "tau", stabilization=0.1, minimum_norm=False, fext=_fext()),
    "constrained_dynamics of J": lambda: {**_state(tau=tau()), **_jacobian(), "drift": np.zeros(1), "damping": 0.1},
    "constrained_dynamics_derivatives": lambda: _held("q", "v", "tau"),
    "constraint_drift": lambda: _held("q", "v"),
    "constraint_error": lambda: _held("q"),
    "constraint_jacobian": lambda: _held("q"),
    "contact_gaps": lambda: {"model": model(), "contacts": touching(), "q": q()},
    "contact_step": lambda: {**_state(tau=tau(), dt=0.01), "contacts": touching()},
    "contact_wrench": lambda: {"model": model(), "q": q(), "residual": tau(), "frame": "tip", "least": True,
                               "length": 0.3},
    "critical_gains": lambda: {"omega": np.array([1.0, 2.0]), "zeta": np.array([0.7, 1.0])},
    "delassus": lambda: _held("q"),
    "detection_thresholds": lambda: {"residuals": np.ones((3, 2)), "sigmas": 6.0},
    "diagnose": lambda: {"model": model(), "q": q()},
    "energy_ledger": lambda: {"trajectory": run()},
    "exact": lambda: {"model": model(), "call": sd.crba},
    "excitation": lambda: {"model": model(), "duration": 4.0, "harmonics": 2, "parameters": "inertial", "starts": 2,
                           "steps": 1},
    "export": lambda: {"scene": model(), "functions": {"torque": sd.generalized_gravity}, "folder": tempfile.mkdtemp()},
    "forward_dynamics": lambda: _state(tau=tau()),
    "fourier": lambda: {"cosines": np.ones((3, 2)), "sines": np.ones((3, 2)), "frequency": 1.0, "centre": q()},
    "friction_regressor": lambda: {"model": model(), "v": v()},
    "friction_torque": lambda: {"model": model(), "v": v(), "friction": friction()},
    "from_drake": lambda: _state(joints=["joint1", "joint2"]),
    "from_mjmodel": lambda: {"mjmodel": mjmodel(), "root": "fixed", "inertia": "warn"},
    "from_mujoco": lambda: {"model": model(), "qpos": q(), "qvel": v(), "joints": ["joint1", "joint2"]},
    "from_pinocchio": lambda: {"pin_model": _pinocchio()},
    "gravity_stiffness_bound": lambda: {"model": model(), "samples": 10, "seed": 1},
    "hamilton_equations": lambda: {"model": model(), "q": q(), "p": v()},
    "hamilton_simulation": lambda: {"scene": model(), "q0": q(), "p": v(), "duration": 0.02, "dt": 0.01},
    "identify": lambda: {"recording": log(), "model": model(), "method": "log_cholesky", "parameters": "inertial"},
    "impact": lambda: _held("q", "v", restitution=0.5),
    "impact of J": lambda: {**_state(), **_jacobian(), "restitution": 0.5, "damping": 0.1},
    "independent_joints": lambda: _held("q"),
    "largest_step": lambda: {"omega": np.array([1.0, 2.0]), "zeta": np.array([0.7, 1.0])},
    "linearize": lambda: _in_scene(_state(tau=tau(), dt=0.01, method="rk4")),
    "load": lambda: {"source": "two_link"},
    "load_urdf": lambda: {"source": "two_link"},
    "lqr": lambda: {"A": np.array([[0.0, 1.0], [0.0, 0.0]]), "B": np.array([[0.0], [1.0]]), "Q": np.eye(2),
                    "R": np.eye(1)},
    "lyapunov": lambda: {"run": run(), "V": lambda t, q, v: t, "rounding": 1e-9},
    "mobility": lambda: _held("q"),
    "momentum_observer_step": lambda: {"model": model(), "q": q(), "v": v(), "tau": tau(), "gain": np.ones(2),
                                       "dt": 1e-3, "memory": np.zeros(6)},
    "operational_space": lambda: _state(frame="tip", axes="xz"),
    "operational_space_coupling": lambda: {"model": model(), "q": q(), "frame": "tip", "other": "link1"},
    "passivity": lambda: {"run": run(), "storage": lambda t, q, v: t},
    "plot": lambda: {"runs": [run(), run()], "what": "q"},
    "poisson_bracket": lambda: {"model": model(), "F": lambda q, p: q[0], "G": lambda q, p: p[0], "q": q(), "p": v()},
    "project_configuration": lambda: _held("q"),
    "project_velocity": lambda: _held("q", "v"),
    "quintic": lambda: {"q0": q(), "q1": v(), "T": 2.0},
    "random_configuration": lambda: {"model": model(), "rng": 3, "shape": (2,)},
    "read_transmissions": lambda: {"source": "two_link"},
    "recommend": lambda: {"model": model(), "batch": 8, "tolerance": 1e-3, "states": 2},
    "requires": lambda: {"scene": bounded_scene(), "q0": q(), "v0": v(), "duration": 0.02, "tolerance": 0.1,
                         "samples": 2, "kinds": "limits", "dt": 0.01},
    "rollout": lambda: _run_of(tau=np.zeros((2, 2)), steps=2),
    "set_num_threads": lambda: {"n": 1},
    "simplify": lambda: {"model": model(), "lock": ["joint2"]},
    "simulate": lambda: _run_of(duration=0.02),
    "solve_ik": lambda: {"model": model(), "targets": {"tip": _reached()}, "q0": q(), "restarts": 2},
    "specialize": lambda: {"model": model(), "calls": sd.crba},
    "spline": lambda: {"times": np.array([0.0, 1.0, 3.0]), "points": np.zeros((3, 2)), "ends": "rest"},
    "spring_energy": lambda: {"model": elastic(), "q": np.zeros(elastic().nq)},
    "spring_torque": lambda: {"model": elastic(), "q": np.zeros(elastic().nq), "v": np.zeros(elastic().nv)},
    "step": lambda: _in_scene(_state(tau=tau(), dt=0.01)),
    "step_derivatives": lambda: _in_scene(_state(tau=tau(), dt=0.01)),
    "task_torque": lambda: _state(tasks=[sd.FrameTask("tip", axes="z")], posture=tau()),
    "study": _studied,
    "to_actuators": lambda: _state(tau=tau(), transmissions=sd.Transmission(("joint1",), 2.0)),
    "to_drake": lambda: _state(joints=["joint1", "joint2"]),
    "to_joints": lambda: _state(tau=tau(), transmissions=[sd.Transmission(("joint1",), 2.0)]),
    "to_mjcf": lambda: {"model": model()},
    "to_mujoco": lambda: _state(joints=["joint1", "joint2"]),
    "to_urdf": lambda: {"model": model()},
    "torque_limits": lambda: {"model": model(), "v": v(), "motor": motor()},
    "total_mass": lambda: {"model": model()},
    "trade": lambda: {"model": model(), "batch": 8, "states": 2},
    "trapezoid": lambda: {"q0": q(), "q1": v(), "v_max": np.ones(2), "a_max": np.ones(2)},
    "verify_skew_symmetry": lambda: _state(),
    "view": lambda: {"robot": model(), "open": False, "port": 0},
    "wrench_at": lambda: {"model": model(), "q": q(), "frame": "tip", "force": np.zeros(6)},
}  # fmt: skip
INSTANCES: dict[str, Callable[[], Any]] = {
    "Base": lambda: identified().base,
    "Identified": identified,
    "Recording": log,
    "ChristoffelC": lambda: sd.ChristoffelC(model()),
    "Constraints": held,
    "Contacts": touching,
    "ComTask": lambda: sd.ComTask(np.zeros(3)),
    "Control": control,
    "Scene": lambda: sd.Scene(model(), friction=friction(), limits=True),
    "Diagnosis": findings,
    "EnergyLedger": lambda: sd.energy_ledger(run()),
    "EnergyShaping": lambda: sd.EnergyShaping([20.0, 20.0], [5.0, 5.0], q()),
    "Exact": lambda: sd.exact(model(), sd.crba),
    "FrameTask": lambda: sd.FrameTask("tip", axes="xz"),
    "Friction": friction,
    "LQR": lambda: sd.LQR(np.ones((1, 2)), np.eye(2), np.zeros(2)),
    "LyapunovRecord": lambda: sd.lyapunov(run(), run().energy),
    "Model": model,
    "ModelBuilder": elastic_builder,
    "NaturalAdaptation": natural,
    "MomentumObserver": observer,
    "Motor": motor,
    "Moments": lambda: sd.Moments("tau"),
    "PassivityRecord": passive,
    "Path": path,
    "PostureTask": lambda: sd.PostureTask(q()),
    "Promise": promise,
    "Quantiles": lambda: sd.Quantiles("tau"),
    "Recommendation": recommendation,
    "Requirement": requirement,
    "Rollout": samples,
    "SlotineLi": adaptive,
    "Specialized": program,
    "Study": lambda: sd.study(**_studied()).run(),
    "SymbolicManipulator": symbols,
    "TallQR": lambda: sd.TallQR("tau"),
    "Tradeoff": lambda: recommendation().tradeoff,
    "Trajectory": run,
    "Transmission": lambda: sd.Transmission(("joint1",), 2.0),
    "WholeBody": lambda: sd.WholeBody(model(), sd.PostureTask(q()), limits=()),
    "Worst": lambda: sd.Worst("most"),
}


def _of_exact() -> dict[str, Any]:
    made = sd.exact(model(), sd.crba)
    return {"spec": SPECS["crba"], "arithmetic": made._arithmetic, "static": {}, "bits": 240}


def mjmodel() -> Any:
    import mujoco

    return mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><joint/><geom size='1'/></body></worldbody></mujoco>"
    )


def _pinocchio() -> Any:
    import pinocchio

    return pinocchio.buildModelFromXML('<robot name="r"><link name="a"/></robot>')


def targets() -> Iterator[str]:
    """The names of what has arguments."""
    for name in sorted(sd.__all__):
        thing = getattr(sd, name)
        if inspect.isclass(thing):
            if not issubclass(thing, BaseException):
                yield from _of_class(name, thing)
        elif callable(thing):
            yield name
    yield from (name for name in ROWS if " of " in name)  # another way of calling one


def _of_class(name: str, kind: type) -> Iterator[str]:
    generated = kind.__init__.__code__.co_filename == "<string>" if hasattr(kind.__init__, "__code__") else True
    if not generated or hasattr(kind, "__post_init__"):
        yield name
    for method, thing in sorted(vars(kind).items()):
        public = not method.startswith("_") or method == "__call__"
        if public and (inspect.isfunction(thing) or isinstance(thing, (classmethod, staticmethod))):
            bound = inspect.signature(getattr(kind, method)).parameters
            if set(bound) - {"self"}:
                yield f"{name}.{method}"


def function(target: str) -> Callable[..., Any]:
    """What a target calls; a method of an instance that is made anew where it is changed."""
    name, _, method = target.partition(" of ")[0].partition(".")
    thing: Any = getattr(sd, name)
    if not method:
        return thing  # type: ignore[no-any-return]
    made = thing if inspect.ismethod(getattr(thing, method)) else INSTANCES[name]()
    return getattr(made, method)  # type: ignore[no-any-return]


def places(target: str) -> list[inspect.Parameter]:
    """The parameters of a target."""
    name, _, method = target.partition(" of ")[0].partition(".")
    kind: Any = getattr(sd, name)
    found = [*inspect.signature(getattr(kind, method) if method else kind).parameters.values()]
    return found[1:] if method and not inspect.ismethod(getattr(kind, method)) else found


def arguments(target: str) -> dict[str, Any]:
    """Valid arguments of a target, by name."""
    if target in SPECS:
        spec = SPECS[target]
        named = dict(zip([x.name for x in sorted_inputs(spec)], random_inputs(model(), spec), strict=True))
        return {"model": model(), **named, **options(model(), spec)}
    return ROWS[target]()
