"""``requires`` finds what a motion was made to need, reports what it measured, and gives code that does the same."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from operation_costs import count_operations

import spatialdyn as sd
from spatialdyn.accuracy import motions_around, scene_search
from spatialdyn.accuracy.lesser_scenes import Choice, lesser
from spatialdyn.accuracy.requirement import Requirement
from spatialdyn.accuracy.scene_search import WORSE
from spatialdyn.commands import cli
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.recursions.spec import TAU, Argument, Q, Spec, V

pytestmark = pytest.mark.skipif(numba_kernels.PLAIN, reason="NUMBA_DISABLE_JIT: batches of motions in plain Python")
FEW = 6  # samples
ROUNDED = 1e-12  # [rad] of motions that are the same but for rounding


@pytest.fixture(autouse=True)
def costs_of_operations(monkeypatch: pytest.MonkeyPatch) -> None:
    count_operations(monkeypatch)


def arm(**more: Any) -> sd.ModelBuilder:
    """Two rods, which swing about y."""
    rod = (1.0, (0.0, 0.0, -0.25), np.diag([0.02, 0.02, 1e-3]))
    builder = sd.ModelBuilder("arm").add_body("upper", None, "revolute", (0, 1, 0), inertia=rod, **more)
    return builder.add_body("lower", "upper", "revolute", (0, 1, 0), (0.0, 0.0, -0.5), inertia=rod, **more)


MODEL = arm(limits=(-3.0, 3.0)).build()
START = np.array([0.5, -0.3]), np.zeros(2)


def required(scene: Any, q: Any = START[0], v: Any = START[1], **more: Any) -> Requirement:
    given = {"duration": 0.2, "tolerance": 1e-3, "samples": FEW, "kinds": "effects", **more}
    return sd.requires(scene, q, v, **given)


def verdicts(found: Requirement) -> dict[tuple[str, str], str]:
    return {(x.part, x.form): x.verdict for x in found.rows}


def test_a_recording_is_a_motion() -> None:
    """Its first state and torques: what a log of a damped arm needs is the damping, not a friction of 1e-7."""
    scene = sd.Scene(MODEL, friction=sd.Friction(viscous=0.5))
    run = sd.simulate(scene, *START, 0.2, 0.01, torque=np.array([1.0, 0.5]), method="semi_implicit_euler")
    log = sd.Recording.of(run)
    log = sd.Recording(log.t, log.q, log.tau + 1e-3 * np.sin(log.t)[:, None], log.v)
    found = sd.requires(scene, log, tolerance=1e-3, samples=FEW, kinds="friction")
    assert (found.full, found.duration) == (scene, pytest.approx(0.2))
    assert "friction" in found.needed
    weak = scene.with_(friction=sd.Friction(viscous=1e-7))
    less = sd.requires(weak, log, duration=0.1, samples=FEW, kinds="friction")
    assert less.duration == pytest.approx(0.1)
    assert "friction" not in less.scene.acts
    with pytest.raises(sd.SpatialDynError, match="v0 was given"):
        sd.requires(scene, log, START[1])
    with pytest.raises(sd.SpatialDynError, match="control was given"):
        sd.requires(scene, log, control=sd.PD(1.0, 1.0, [0.0, 0.0]))
    with pytest.raises(sd.SpatialDynError, match="v0 is None"):
        sd.requires(scene, START[0])


def test_friction_that_cannot_matter_and_limits_never_reached_are_left_out() -> None:
    scene = sd.Scene(MODEL, friction=sd.Friction(coulomb=1e-6, viscous=1e-7), limits=True)
    found = required(scene)
    assert verdicts(found) == {
        ("limits", "left out"): "left out",
        ("friction", "left out"): "left out",
        ("gravity", "left out"): "needed",
        ("method", found.rows[-1].form): "taken",
    } | {(x.part, x.form): x.verdict for x in found.rows if x.part == "method"}
    assert found.scene == scene.with_(friction=False, limits=False)
    assert found.needed == ("gravity",)
    (limits,) = (x for x in found.rows if x.part == "limits")
    assert limits.why.startswith("never nearer than 2.5, of ")
    assert 0.0 < found.error < found.bound <= 1e-3
    assert found.speedup > 1.0


def test_friction_that_matters_is_kept_and_its_dry_part_left_out_where_it_is_small() -> None:
    found = required(sd.Scene(MODEL, friction=sd.Friction(coulomb=1e-6, viscous=0.5)))
    assert verdicts(found)["friction", "left out"] == "needed"
    assert verdicts(found)["friction", "viscous alone"] == "left out"
    assert isinstance(found.scene.friction, sd.Friction)
    assert found.scene.friction.coulomb.tolist() == [0.0, 0.0]
    assert found.scene.friction.viscous.tolist() == [0.5, 0.5]


def test_limits_that_are_reached_are_kept() -> None:
    found = required(sd.Scene(arm(limits=(-3.0, 0.51)).build(), limits=True), v=[0.5, 0.0])
    assert verdicts(found)["limits", "left out"] == "needed"
    assert found.scene.limits
    (limits,) = (x for x in found.rows if x.part == "limits")
    assert limits.why.startswith("reached by ")


def test_a_joint_that_moves_is_not_locked_and_one_that_rests_is() -> None:
    """A third joint whose torque holds it: the plane of the others is its mirror, so that it feels nothing."""
    rod = (0.5, (0.0, 0.0, -0.1), np.diag([1e-3, 1e-3, 1e-4]))
    model = arm().add_body("hand", "lower", "revolute", (0, 0, 1), (0.0, 0.0, -0.5), inertia=rod).build()
    found = required(sd.Scene(model), [0.5, -0.3, 0.2], np.zeros(3), kinds="joints", tolerance=1e-3)
    upper, lower, hand = model.names[1:]
    assert {name[0]: x for name, x in verdicts(found).items()} == {
        f'joint "{upper}"': "needed", f'joint "{lower}"': "needed", f'joint "{hand}"': "left out",
    } | {"method": "taken"}  # fmt: skip
    assert found.scene.model == model.reduced({hand: 0.2})
    q, v = found.to_full([[1.0, 2.0]], [[3.0, 4.0]])
    assert q.tolist() == [[1.0, 2.0, 0.2]]
    assert v.tolist() == [[3.0, 4.0, 0.0]]
    back = found.to_reduced(q, v)
    assert [x.tolist() for x in back] == [[[1.0, 2.0]], [[3.0, 4.0]]]


def test_a_joint_that_turns_freely_from_the_start_is_not_locked() -> None:
    model = arm().build(gravity=(0.0, 0.0, 0.0))
    found = required(sd.Scene(model), [0.0, 0.0], [1.0, 0.0], kinds="joints")
    upper = f'joint "{model.names[1]}"'  # the lower one hangs on, straight
    assert [x.verdict for x in found.rows if x.part == upper] == ["needed"]


def test_a_rotor_that_matters_is_kept_exact_or_as_an_armature() -> None:
    lower = MODEL.names[2]
    heavy = MODEL.with_(rotors={lower: sd.Rotor(2e-3, -4.0)})  # it turns against the joint: n J is a quarter of n² J
    found = verdicts(required(sd.Scene(heavy)))
    assert found["rotors", "left out"] == found["rotors", "armatures"] == "needed"
    fast = MODEL.with_(rotors={lower: sd.Rotor(1e-8, 1000.0)})
    found = verdicts(required(sd.Scene(fast)))
    assert found["rotors", "left out"] == "needed"
    assert found["rotors", "armatures"] == "left out"


def test_a_rigid_spring_is_its_joint_with_an_exact_rotor() -> None:
    builder = arm()
    name = builder.build().names[2]
    model = builder.add_series_elastic(name, 1e5, 10.0, 1e-4, 20.0).build()
    rigid = model.rigid()
    assert rigid.nv == 2
    E = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 20.0]])
    q, v = np.array([0.3, 0.4]), np.array([1.0, -2.0])
    np.testing.assert_allclose(E.T @ sd.crba(model, E @ q) @ E, sd.crba(rigid, q), rtol=0, atol=1e-14)
    theirs = E.T @ sd.rnea(model, E @ q, E @ v, E @ q)
    np.testing.assert_allclose(theirs, sd.rnea(rigid, q, v, q), rtol=0, atol=1e-13)
    found = required(sd.Scene(model), E @ START[0], np.zeros(3), kinds="springs", tolerance=1e-2, observe=joints)
    assert verdicts(found)["springs", "rigid"] == "left out"
    assert found.scene.model == rigid
    np.testing.assert_allclose(found.to_full(q, v)[0], E @ q, rtol=0, atol=1e-15)
    with pytest.raises(sd.ModelError, match="spring of joint"):
        model.rigid(["no"])
    with pytest.raises(sd.ModelError, match="joints is 'arm', expected names"):
        model.rigid("arm")


def joints(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    return q[:, :2]


def reproduced(found: Requirement, scene: sd.Scene, q: Any, v: Any, **given: Any) -> sd.Rollout:
    """The run of ``code``, whose scene is that of the result."""
    names = {"sd": sd, "np": np, "scene": scene, "q0": q, "v0": v, **given}
    exec(found.code, names)
    assert names["lesser"] == found.scene or found.scene.friction is False
    run: sd.Rollout = names["run"]
    assert (run.scene.model, run.method) == (found.scene.model, found.method)  # type: ignore[union-attr]
    return run


def test_code_runs_and_keeps_the_motion() -> None:
    scene = sd.Scene(MODEL, friction=sd.Friction(coulomb=1e-6, viscous=0.3), limits=True)
    torque = np.linspace(0.0, 1.0, 20).reshape(10, 2)
    found = required(scene, torque=torque, kinds=("effects", "joints", "precision", "methods"))
    run = reproduced(found, scene, *START, torque=torque)
    steps = 10 * 400
    truth = sd.rollout(scene, *START, np.repeat(torque, 400, 0), dt=0.2 / steps, steps=steps, record=steps // 20)
    every = len(run.t) // 20
    full = found.to_full(run.q[every - 1 :: every], run.v[every - 1 :: every])
    assert abs(full[0] - truth.q).max() <= found.bound


def test_code_of_locked_joints_a_law_and_forces_runs() -> None:
    def hold(bodies: Any, q: Any, v: Any, reach: Any, gains: Any, tau: Any) -> None:
        for i in range(len(tau)):
            tau[i] = gains[i] * (reach[i] - q[i]) - 1.0 * v[i]

    reach, gains = Argument("reach", ("nv",), "rad", ""), Argument("gains", ("nv",), "", "")
    law = Spec("hold", hold, None, (Q, V, reach, gains), TAU, "PD.", "")
    rod = (0.5, (0.0, 0.0, -0.1), np.diag([1e-3, 1e-3, 1e-4]))
    model = arm().add_body("hand", "lower", "revolute", (0, 0, 1), (0.0, 0.0, -0.5), inertia=rod).build()
    push = np.zeros((model.njoints, 6))
    push[1, 0] = 0.5
    scene = sd.Scene(model, friction=sd.Friction(viscous=[0.1, 0.2, 0.3]), fext=push)
    path = np.repeat(np.linspace(0.5, 0.6, 10)[:, None], 3, 1) * [1.0, 1.0, 0.0]
    control = sd.Control(law, {"reach": path, "gains": [30.0, 20.0, 10.0]})
    start = [0.5, 0.5, 0.0]
    found = required(scene, start, np.zeros(3), control=control, kinds=("joints", "fext", "methods"))
    assert found.scene.model.nv == 2
    assert "keep_q, keep_v = [0, 1], [0, 1]" in found.code
    run = reproduced(found, scene, np.array(start), np.zeros(3), control=control)
    steps = 4000
    fine = sd.Control(law, {"reach": np.repeat(path, steps // 10, 0), "gains": [30.0, 20.0, 10.0]})
    truth = sd.rollout(scene, start, np.zeros(3), dt=0.2 / steps, steps=steps, record="last", control=fine)
    assert abs(found.to_full(run.q[-1], run.v[-1])[0] - truth.q).max() <= found.bound


def test_every_figure_that_is_shown_was_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each change is the largest of a run that was made, the error and bound those of fresh samples."""
    seen: list[float] = []
    change = motions_around.Motion.change

    def noted(self: Any, one: Any, other: Any) -> Any:
        made = change(self, one, other)
        seen.append(float(made.max()))
        return made

    monkeypatch.setattr(motions_around.Motion, "change", noted)
    found = required(sd.Scene(MODEL, friction=sd.Friction(viscous=0.01), limits=True))
    for x in (*found.rows, *found.path[1:]):
        assert x.change in seen
    assert found.error in seen
    assert found.certainty in seen
    assert found.bound >= 4.0 * found.error * (1.0 - ROUNDED)  # the margin of a few samples


def test_what_fresh_samples_do_not_confirm_is_not_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene_search, "error_bound", lambda errors: math.inf)
    scene = sd.Scene(MODEL, limits=True)
    found = required(scene)
    assert found.scene == scene.with_(friction=False)
    assert "left out" not in {x.verdict for x in found.rows}
    assert found.dt == found.fine[1]


def test_what_does_not_run_is_said_so() -> None:
    held = sd.Constraints(MODEL, [sd.CouplerConstraint(MODEL.names[2], MODEL.names[1], ratio=-1.0)])
    found = required(sd.Scene(MODEL, constraints=held), [0.3, -0.3], kinds=("joints", "constraints"), spread=0.0)
    by = {x.part: x for x in found.rows}
    assert by["constraints"].verdict == "needed"
    assert {x.verdict for name, x in by.items() if name.startswith("joint")} <= {"needed", "cannot"}


# --- contacts, chaos, bases ------------------------------------------------------------------------------


def box(height: float) -> tuple[sd.Scene, np.ndarray]:
    """A floating body of one point over the ground."""
    body = (1.0, (0.0, 0.0, 0.0), 0.01 * np.eye(3))
    builder = sd.ModelBuilder("ball").add_body("ball", None, "floating", inertia=body)
    model = builder.build()
    q = sd.neutral(model)
    q[2] = height
    return sd.Scene(model, contacts=sd.Contacts(model, {"ball": 0.1}, restitution=1.0)), q


def test_contacts_that_are_never_met_are_left_out_and_those_that_are_met_kept() -> None:
    scene, q = box(1.0)
    found = required(scene, q, np.zeros(6))
    assert verdicts(found)["contacts", "left out"] == "left out"
    assert found.scene.contacts is None
    (contacts,) = (x for x in found.rows if x.part == "contacts")
    assert contacts.why.startswith("never nearer than 0.6")
    scene, q = box(0.1)
    still = required(scene.with_(contacts=sd.Contacts(scene.model, {"ball": 0.1})), q, np.zeros(6))
    assert verdicts(still)["contacts", "left out"] == "needed"


def test_impacts_shorten_the_time_that_is_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    """A box that tumbles on its corners: after some impacts a step of another size is another motion."""
    monkeypatch.setattr(scene_search, "FINEST", 2000)
    builder = sd.ModelBuilder("box").add_body("box", None, "floating", inertia=(1.0, np.zeros(3), 0.01 * np.eye(3)))
    corners = {f"c{k}": 0.0 for k in range(4)}
    for k, name in enumerate(corners):
        builder.add_body(name, "box", "fixed", placement=(0.1 - 0.2 * (k % 2), 0.1 - 0.2 * (k // 2), -0.1))
    model = builder.build()
    q = sd.integrate(model, sd.neutral(model), [0.0, 0.0, 0.3, 0.4, 0.3, 0.0])
    v = np.array([1.0, 0.0, 0.0, 3.0, 2.0, 1.0])
    scene = sd.Scene(model, contacts=sd.Contacts(model, corners, restitution=0.8))
    found = required(scene, q, v, duration=1.0, kinds="gravity", tolerance=2e-2)
    assert 0.05 <= found.horizon < 1.0
    assert f"judged to {found.horizon:g} s of 1 s" in str(found)
    assert found.certainty <= 0.25 * 2e-2
    steps = round(found.horizon / found.dt)
    assert f"steps={steps}" in found.code


def test_a_scene_that_is_uncertain_at_once_is_refused() -> None:
    scene, q = box(0.1005)
    with pytest.raises(sd.SimulationError, match="a shorter duration or a larger tolerance can be judged"):
        required(scene, q, np.r_[0.0, 0.0, -5.0, 0.0, 0.0, 0.0], observe="v", tolerance=1e-9, dt=1e-3)


def test_single_points_that_never_touch_are_left_out() -> None:
    body = (1.0, (0.0, 0.0, 0.0), 0.01 * np.eye(3))
    builder = sd.ModelBuilder("dumbbell").add_body("low", None, "floating", inertia=body)
    model = builder.add_body("high", "low", "fixed", placement=(0.0, 0.0, 1.0)).build()
    q = sd.neutral(model)
    q[2] = 0.1
    found = required(sd.Scene(model, contacts=sd.Contacts(model, {"low": 0.1, "high": 0.1})), q, np.zeros(6))
    assert verdicts(found)["contacts", 'without "high"'] == "left out"
    assert ("contacts", 'without "low"') not in verdicts(found)
    assert found.scene.contacts is not None
    assert found.scene.contacts.names == ("low",)


def test_mimic_joints_are_locked_with_those_they_follow() -> None:
    rod = (0.2, (0.0, 0.0, -0.1), np.diag([1e-3, 1e-3, 1e-4]))
    builder = arm().add_body("finger", "lower", "revolute", (0, 1, 0), (0.0, 0.0, -0.5), inertia=rod)
    first = builder.build().names[-1]
    builder.add_body(
        "other",
        "lower",
        "revolute",
        (0, 1, 0),
        (0.0, 0.0, -0.5),
        inertia=rod,
        mimic={"leader": first, "multiplier": -1.0, "offset": 0.1},
    )
    model = builder.build(mimic=True)
    assert model.nv == 3
    q = np.array([0.5, -0.3, 0.2])
    found = required(sd.Scene(model), q, np.zeros(3), kinds=("joints", "gravity"), observe=joints, tolerance=0.1)
    locked = lesser(found.full, Choice(locked={first: 0.2, model.names[-1]: -0.1}), q)
    assert locked.scene.model.nv == 2
    assert {(x.part, x.form) for x in found.rows} >= {(f'joint "{first}"', "locked")}
    assert all(x.verdict != "cannot" for x in found.rows)


def test_states_of_ones_own_judge_by_every_other_one() -> None:
    rng = np.random.default_rng(0)
    q = START[0] + 0.1 * rng.normal(size=(9, 2))
    found = required(sd.Scene(MODEL, limits=True), q, np.zeros((9, 2)), kinds="limits")
    assert found.samples == 4
    assert verdicts(found)["limits", "left out"] == "left out"


def test_v_and_a_function_are_observed() -> None:
    scene = sd.Scene(MODEL, friction=sd.Friction(viscous=0.02))
    q, v = (required(scene, kinds="friction", observe=x, tolerance=1.0).rows[0].change for x in ("q", "v"))
    assert v > 5.0 * q > 0.0
    assert required(scene, kinds="friction", observe=lambda q, v: 0.0 * q, tolerance=1.0).rows[0].change == 0.0


# --- wrong input, text -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"tolerance": 0.0}, "tolerance is 0.0, expected a number above 0"),
        ({"tolerance": math.inf}, "tolerance is inf, expected a finite number above 0"),
        ({"duration": -1.0}, "duration is -1.0, expected a finite number of seconds above 0"),
        ({"samples": 0}, "samples is 0, expected a number of 1 to"),
        ({"dt": 0.0}, "dt is 0.0, expected None or a positive number"),
        ({"methods": "gauss7"}, "methods has 'gauss7', expected some of"),
        ({"methods": "dop853", "limits": True}, 'methods has "dop853", expected some of semi_implicit_euler'),
        ({"kinds": "all"}, "kinds has 'all', expected some of effects, "),
        ({"spread": -1.0}, "spread is -1.0, expected finite numbers of 0 or more"),
        ({"spread_v": [1.0, 2.0, 3.0]}, r"spread_v has shape \(3,\), expected a number or \(2,\)"),
        ({"torque": lambda t, q, v: q}, "torque is a function, expected an array"),
        ({"torque": [1.0]}, r"torque has shape \(1,\), expected \(2,\) or \(steps, 2\)"),
        ({"torque": [math.nan, 0.0]}, "torque has numbers that are not finite"),
        ({"control": 3}, "control is 3, expected a Control or None"),
        ({"observe": "tip"}, 'observe is \'tip\', expected "q", "v" or a function'),
        ({"observe": lambda q, v: q[0]}, "observe gives .* expected real numbers of shape"),
        ({"observe": lambda q, v: q * math.nan}, "observe gives numbers that are not finite"),
        ({"q": [0.0]}, r"q0 has shape \(1,\), expected \(2,\) or \(n, 2\)"),
        ({"q": np.zeros((3, 2)), "v": np.zeros((2, 2))}, "q0 and v0 have 3 and 2 states"),
        ({"q": np.zeros((1, 2))}, "q0 and v0 have one state with an axis"),
    ],
)
def test_wrong_input_is_refused_by_name(given: dict[str, Any], message: str) -> None:
    given = dict(given)
    scene = sd.Scene(MODEL, limits=given.pop("limits", False))
    with pytest.raises(sd.SpatialDynError, match=message):
        required(scene, **given)


def test_a_robot_without_freedoms_is_refused() -> None:
    with pytest.raises(sd.ModelError, match="no joint that moves"):
        sd.requires(MODEL.reduced(MODEL.names[1:]), [], [], 1.0, 1e-3)


def test_it_is_text_json_html_and_a_plot(tmp_path: Any) -> None:
    pytest.importorskip("matplotlib")
    found = required(sd.Scene(MODEL, friction=sd.Friction(viscous=1e-7)), kinds=("friction", "gravity", "methods"))
    text = str(found)
    assert text.startswith("arm: q [rad | m] for ")
    assert "verdict" in text
    assert "never" not in text
    assert f"{found.speedup:.3g} times as fast" in text
    assert json.loads(found.to_json())["rows"][0]["part"] == "friction"
    assert "friction" in found._repr_html_()
    figure = found.plot(tmp_path / "r.png")
    (axes,) = figure.axes[:1]
    assert (tmp_path / "r.png").stat().st_size > 1000
    drawn = [tuple(x) for line in axes.lines for x in np.array(line.get_data(), float).T]
    for x in found.rows:
        assert any(y == pytest.approx(max(x.change, 1e-8), rel=1e-9) for _, y in drawn)


def test_a_part_within_the_tolerance_by_less_than_the_margin_says_so() -> None:
    scene, given = sd.Scene(MODEL, friction=sd.Friction(viscous=3e-3)), {"kinds": ("friction", "methods")}
    (change,) = (x.change for x in required(scene, **given).rows if x.part == "friction")
    found = required(scene, **given, tolerance=1.5 * change)
    (row,) = (x for x in found.rows if x.part == "friction")
    assert (row.verdict, row.why.partition(";")[0]) == ("needed", "within the tolerance, 4 times that is not")


def test_the_step_of_the_whole_scene_is_tried_so_that_less_of_it_never_costs_more() -> None:
    dt = 0.2 / 140  # others that are tried have 40, 80, 160 steps
    scene = sd.Scene(MODEL, friction=sd.Friction(coulomb=0.05), fext=np.full((MODEL.njoints, 6), 1e-12))
    given = {"kinds": ("fext", "methods"), "dt": dt}
    certainty = required(scene, **given, tolerance=1.0).certainty
    found = required(scene, **given, tolerance=8.0 * certainty)
    assert found.scene.acts == ("friction",)
    assert found.dt == pytest.approx(dt)
    assert found.speedup > 1.0 / WORSE


def test_the_command_line_says_it(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["requires", "two_link", "--duration", "0.1", "--samples", "4", "--kinds", "gravity", "--quiet"]
    assert cli.main(words) == 0
    said = capsys.readouterr().out
    assert "gravity" in said
    assert "run = sd.rollout(lesser" in said
    assert cli.main([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["model"]
