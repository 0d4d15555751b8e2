"""Closed forms: the textbook's 2R and 3R arms, and agreement of every quantity with the numerical calls."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy
from slow import slow_but
from sympy import Rational, cos, sin
from trees import random_inertia

import spatialdyn as sd
from spatialdyn.lagrangian import exact_model
from spatialdyn.lagrangian.symbolic_manipulator import QUANTITIES

EPS = np.finfo(float).eps
ROUNDING = 100 * EPS  # of the largest entry: a closed form of some dozen terms, evaluated in floats
TWO_LINK = {"c_1x": "l_1", "l_2x": "l_1", "c_2x": "l_2", "m_1": "m_1", "m_2": "m_2", "g": "g"}
GENERAL = {"c_1x": "lc_1", "l_2x": "l_1", "c_2x": "lc_2", "m_1": "m_1", "m_2": "m_2", "I_1yy": "I_1", "I_2yy": "I_2"}


def two_link(parameters: Any = TWO_LINK) -> sd.SymbolicManipulator:
    return sd.SymbolicManipulator(sd.load_urdf("two_link"), parameters)


def of(s: sd.SymbolicManipulator, *names: str) -> list[Any]:
    """The parameters of those names."""
    by_name = {str(x): x for x in s.parameters}
    return [by_name[name] for name in names]


def is_zero(x: Any) -> bool:
    """Whether an expression, matrix or array simplifies to 0 in SymPy's own hands."""
    return all(sympy.simplify(e) == 0 for e in (x if hasattr(x, "shape") else [x]))


def small_robot(kind: str, seed: int, continuous: str = "angle") -> sd.Model:
    """Two bodies of short decimals: a joint of a kind behind a turned placement, a revolute one on it."""
    rng = np.random.default_rng(seed)
    builder = sd.ModelBuilder()
    parent = None
    for name, joint, axis, rpy in (
        ("a", kind, (0, 3, 4), (np.pi / 3, 0.0, 0.25)),
        ("b", "revolute", (1, 1, 0), (0.0, 1.5707963267949, np.pi / 5)),
    ):
        mass, com, inertia = random_inertia(rng)
        builder.add_body(
            name,
            parent,
            joint=joint,
            axis=axis,
            placement=(rng.normal(size=3).round(2), rpy),
            inertia=(round(mass, 2), com.round(2), inertia.round(4)),
            armature=0.125,
        )
        parent = name
    return builder.build(continuous=continuous)


# --- the 2R arm ------------------------------------------------------------------------------------------


def test_two_link_arm_is_the_textbooks() -> None:
    """Section 8.1: M, C, g and all eight Christoffel symbols, as expressions."""
    s = two_link()
    l1, l2, m1, m2, g = of(s, "l_1", "l_2", "m_1", "m_2", "g")
    (q1, q2), (v1, v2) = s.q, s.v
    m12 = m2 * l2**2 + m2 * l1 * l2 * cos(q2)
    M = sympy.Matrix([[(m1 + m2) * l1**2 + m2 * l2**2 + 2 * m2 * l1 * l2 * cos(q2), m12], [m12, m2 * l2**2]])
    h = -m2 * l1 * l2 * sin(q2)
    C = sympy.Matrix([[h * v2, h * (v1 + v2)], [-h * v1, 0]])
    far = m2 * g * l2 * cos(q1 + q2)
    assert is_zero(s.M() - M)
    assert is_zero(s.C() - C)
    assert is_zero(s.g() - sympy.Matrix([(m1 + m2) * g * l1 * cos(q1) + far, far]))
    assert s.christoffel() == sympy.ImmutableDenseNDimArray([0, h, h, h, -h, 0, 0, 0], (2, 2, 2))
    assert is_zero(s.V() - m1 * g * l1 * sin(q1) - m2 * g * (l1 * sin(q1) + l2 * sin(q1 + q2)))


def test_general_two_link_arm_of_the_last_exercise() -> None:
    s = two_link(GENERAL)
    l1, lc1, lc2, m1, m2, I1, I2 = of(s, "l_1", "lc_1", "lc_2", "m_1", "m_2", "I_1", "I_2")
    q2, (v1, v2) = s.q[1], s.v
    M12 = m2 * (lc2**2 + l1 * lc2 * cos(q2)) + I2
    M11 = m1 * lc1**2 + m2 * (l1**2 + lc2**2 + 2 * l1 * lc2 * cos(q2)) + I1 + I2
    assert is_zero(s.M() - sympy.Matrix([[M11, M12], [M12, m2 * lc2**2 + I2]]))
    h = -m2 * l1 * lc2 * sin(q2)
    assert is_zero(s.C() - sympy.Matrix([[h * v2, h * (v1 + v2)], [-h * v1, 0]]))


def test_exercise_1_is_exact() -> None:
    """q = (30°, 45°), q̇ = (1, -1/2), q̈ = (1/10, -1/5) give M, C q̇, g and τ in radicals."""
    s = two_link("numbers")
    at = dict(
        zip(
            s.q + s.v + s.a,
            (sympy.pi / 6, sympy.pi / 4, 1, -Rational(1, 2), Rational(1, 10), -Rational(1, 5)),
            strict=True,
        )
    )
    root2, cos75 = sympy.sqrt(2), (sympy.sqrt(6) - sympy.sqrt(2)) / 4
    M = sympy.Matrix([[3 + root2, 1 + root2 / 2], [1 + root2 / 2, 1]])
    Cv = sympy.Matrix([3 * root2 / 8, root2 / 2])
    g = Rational(981, 100) * sympy.Matrix([sympy.sqrt(3) + cos75, cos75])
    v, a = sympy.Matrix(s.v).subs(at), sympy.Matrix(s.a).subs(at)
    assert is_zero(s.M().subs(at) - M)
    assert is_zero(s.C().subs(at) * v - Cv)
    assert is_zero(s.g().subs(at) - g)
    assert is_zero(s.inverse_dynamics().subs(at) - M * a - Cv - g)
    eigenvalues = (1 - root2 / 2, 3 + 3 * root2 / 2)
    assert is_zero(sympy.Matrix([(s.M().subs(at) - x * sympy.eye(2)).det() for x in eigenvalues]))


def test_equations_of_motion_are_m_a_equals_tau_less_bias() -> None:
    s, q, v, tau = two_link("numbers"), [0.5, -0.3], [1.0, 2.0], [0.1, 0.2]
    numbers = dict(zip([*s.q, *s.v, *s.tau], [*q, *v, *tau], strict=True))
    M, rest = sympy.linear_eq_to_matrix([equation.subs(numbers) for equation in s.equations_of_motion()], s.a)
    for found, expected in ((M, sd.crba(s.model, q)), (rest, tau - sd.nonlinear_effects(s.model, q, v))):
        assert abs(np.array(found, float).reshape(expected.shape) - expected).max() <= ROUNDING * abs(expected).max()


def test_mdot_minus_2c_is_skew_and_for_another_c_only_weakly() -> None:
    """Question 2: C' moves C by a D with D v = 0, which is a bias as good as C's, but loses xᵀ(Ṁ - 2C')x = 0."""
    s = two_link()
    v, M, C = sympy.Matrix(s.v), s.M(), s.C()
    Mdot = sum((M.diff(x) * dx for x, dx in zip(s.q, s.v, strict=True)), sympy.zeros(2, 2))
    N = (Mdot - 2 * C).applyfunc(s.simplify)
    assert N + N.T == sympy.zeros(2, 2)
    D = sympy.Matrix([[s.v[1], -s.v[0]], [0, 0]])
    other = Mdot - 2 * (C + D)
    assert is_zero(D * v)
    assert is_zero(v.T * other * v)
    x = sympy.Matrix([1, 0])
    assert not is_zero(x.T * other * x)


@pytest.mark.parametrize("name", ["two_link", "three_link"])
def test_routes_to_c_agree_as_expressions(name: str) -> None:
    """Question 8: Christoffel symbols of derivatives of M, the recursion, and the Newton-Euler recursion's bias."""
    s = sd.SymbolicManipulator(sd.load_urdf(name), "symbols")
    assert s.christoffel() == s.christoffel("derivatives")
    assert s.C() == s.C("derivatives")
    bias = s.inverse_dynamics().subs(dict.fromkeys(s.a, 0)) - s.g()
    assert s.simplify(s.C() * sympy.Matrix(s.v) - bias) == sympy.zeros(s.model.nv, 1)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("axis", "xyz")
def test_g_is_the_strength_of_gravity_whichever_way_it_points(axis: str, sign: int) -> None:
    """A mass at the end of a joint that slides along it: its torque is -m g upward, m g downward, with one g > 0."""
    gravity = [sign * 9.81 * (x == axis) for x in "xyz"]
    builder = sd.ModelBuilder().add_body(
        "mass", None, "prismatic", [float(x == axis) for x in "xyz"], inertia=(2.0, (0, 0, 0), np.zeros((3, 3)))
    )
    model = builder.build(gravity=gravity)
    s = sd.SymbolicManipulator(model, {"m_1": "m_1", "g": "g"})
    m, g = of(s, "m_1", "g")
    assert s.parameters[g] == Rational(981, 100)
    assert is_zero(s.g() - sympy.Matrix([-sign * m * g]))
    assert is_zero(s.V() + sign * m * g * s.q[0])
    free = sd.SymbolicManipulator(model, {f"g_{axis}": "g_a"})
    assert of(free, "g_a")[0] in free.g().free_symbols
    assert list(free.parameters.values()) == [sign * Rational(981, 100)]


# --- against the numerical calls -------------------------------------------------------------------------


def numerical(model: sd.Model, what: str, x: dict[str, Any]) -> Any:
    q, v, a = x["q"], x["v"], x["a"]
    return {
        "M": lambda: sd.crba(model, q),
        "C": lambda: sd.coriolis_matrix(model, q, v),
        "g": lambda: sd.generalized_gravity(model, q),
        "christoffel": lambda: sd.christoffel_symbols(model, q),
        "T": lambda: sd.kinetic_energy(model, q, v),
        "V": lambda: sd.potential_energy(model, q),
        "L": lambda: sd.kinetic_energy(model, q, v) - sd.potential_energy(model, q),
        "tau": lambda: sd.rnea(model, q, v, a),
    }[what]()


def check_against_numbers(s: sd.SymbolicManipulator, whats: list[str], bound: float) -> None:
    model, rng = s.model, np.random.default_rng(0)
    x = {
        "q": sd.random_configuration(model, rng, 20),
        "v": rng.normal(size=(20, model.nv)),
        "a": rng.normal(size=(20, model.nv)),
    }
    for what in whats:
        expected = numerical(model, what, x)
        found = s.lambdify(what)(*(x[name] for name in QUANTITIES[what][1]))
        assert abs(found - expected).max() <= bound * max(1.0, abs(expected).max()), what


@pytest.mark.parametrize("parameters", ["numbers", "symbols"])
@pytest.mark.parametrize("name", ["pendulum", "two_link", "three_link"])
def test_arms_equal_the_numerical_calls(name: str, parameters: str) -> None:
    s = sd.SymbolicManipulator(sd.load_urdf(name), parameters)
    check_against_numbers(s, ["M", "C", "g", "christoffel", "T", "V", "L", "tau"], 1e-13)


TURNED = [(kind, way) for kind in ("revolute", "continuous", "prismatic", "spherical") for way in ("angle", "cos_sin")]


@pytest.mark.parametrize(("kind", "continuous"), slow_but([TURNED[3], TURNED[4]], TURNED))
def test_turned_joints_of_every_kind_equal_the_numerical_calls(kind: str, continuous: str) -> None:
    """Radicals, 1/4 rad and π/5 in the placements: all exact, so only the evaluation rounds."""
    s = sd.SymbolicManipulator(small_robot(kind, 1, continuous))
    check_against_numbers(s, ["M", "g", "V"], ROUNDING)


def test_floating_body_equals_the_numerical_calls() -> None:
    s = sd.SymbolicManipulator(sd.load_urdf("floating_body", root="floating"), "symbols")
    check_against_numbers(s, ["M", "C", "g", "T", "V", "tau"], ROUNDING)


def test_armatures_that_differ_within_a_joint_are_refused() -> None:
    model = small_robot("spherical", 1, "angle")
    joints = tuple(replace(j, armature=(0.1, 0.2, 0.3) if j.kind == "spherical" else 0.0) for j in model.robot.joints)
    with pytest.raises(sd.ModelError, match=r"has armatures \(0.1, 0.2, 0.3\), expected one for all its freedoms"):
        sd.SymbolicManipulator(sd.Model(replace(model.robot, joints=joints), model.options))


def test_frames_in_closed_form() -> None:
    s = two_link()
    (q1, q2), (l1,) = s.q, of(s, "l_1")
    X = s.evaluate("frame_placement", frame="tip")
    assert is_zero(X[:3, 3] - sympy.Matrix([l1 * cos(q1) + cos(q1 + q2), 0, l1 * sin(q1) + sin(q1 + q2)]))
    J = s.evaluate("frame_jacobian", frame="tip", reference="local_world_aligned")
    assert is_zero(J[:3, :] - X[:3, 3].jacobian(s.q))


def test_control_laws_are_their_lines_in_the_textbook() -> None:
    """On a path, whose q, v and a are symbols, with a matrix and a diagonal of gains; and numbers by substitution."""
    s, path = two_link(), sd.quintic([0.0, 0.0], [1.0, 0.5], 2.0)
    made = [sympy.symbols(f"{name}_1:3", real=True) for name in ("kd", "q_ref", "v_ref", "a_ref")]
    Kd, (q_d, v_d, a_d) = sympy.diag(*made[0]), (sympy.Matrix(x) for x in made[1:])
    Kp = sympy.Matrix(2, 2, lambda i, j: sympy.Symbol(f"kp_{i + 1}{j + 1}", real=True))
    q, v = sympy.Matrix(s.q), sympy.Matrix(s.v)
    springs = Kp * (q_d - q) + Kd * (v_d - v)
    gains = np.eye(2), 1.0
    for law, line in (
        (sd.PDPlus(*gains, path), s.M() * a_d + s.C() * v_d + s.g() + springs),
        (sd.ComputedTorque(*gains, path), s.M() * (a_d + springs) + s.C() * v + s.g()),
    ):
        assert is_zero(s.evaluate(law) - line)
    law, numbers = sd.EnergyShaping(3.0, 2.0, [0.1, 0.2], "cosine") + sd.Gravity(), two_link("numbers")
    values = dict.fromkeys(("kp_1", "kp_2"), 3) | dict.fromkeys(("kd_1", "kd_2"), 2)
    values |= {"q_ref_1": 0.1, "q_ref_2": 0.2, "q_1": 0.5, "q_2": 0.7, "v_1": 0.3, "v_2": -0.4}
    found = numbers.evaluate(law).subs({sympy.Symbol(name, real=True): x for name, x in values.items()})
    want = 2.0 * sd.generalized_gravity(numbers.model, [0.5, 0.7]) - 3.0 * np.sin([0.4, 0.5]) - [0.6, -0.8]
    assert abs(np.array(found, float)[:, 0] - want).max() < ROUNDING * abs(want).max()
    with pytest.raises(sd.SpatialDynError, match=r"select of the symbolic .* has no closed form"):
        numbers.evaluate(law.limited_by([1.0, 1.0]))
    with pytest.raises(sd.SpatialDynError, match=r'"impedance" has row, expected gains'):
        numbers.evaluate(sd.Impedance(numbers.model, "tip", np.eye(4), 10.0, 1.0))


# --- Hamilton --------------------------------------------------------------------------------------------


def test_hamilton_equations_are_gradients_of_h() -> None:
    s = two_link()
    H = s.H()
    qdot, pdot = s.hamilton_equations()
    for k in range(2):
        assert s.simplify(qdot[k] - H.diff(s.p[k])) == 0
        assert s.simplify(pdot[k] + H.diff(s.q[k]) - s.tau[k]) == 0
    momentum = s.M() * sympy.Matrix(s.v)
    assert s.simplify(H.subs(dict(zip(s.p, momentum, strict=True))) - s.T() - s.V()) == 0


def test_poisson_brackets() -> None:
    """{q, p} = 1, antisymmetry, Jacobi's identity, {H, H} = 0 and dp/dt = {p, H}."""
    s = two_link("numbers")
    (q1, q2), (p1, p2) = s.q, s.p
    H, bracket = s.H(), s.poisson_bracket
    assert [bracket(a, b) for a in s.q for b in s.p] == [1, 0, 0, 1]
    assert bracket(H, H) == 0
    assert s.simplify(bracket(p2, H) + H.diff(q2)) == 0
    F, G, K = p1 * cos(q2) + q1**2, p2**2 * sin(q1 + q2), q2 * p1 * p2
    assert s.simplify(bracket(F, G) + bracket(G, F)) == 0
    cyclic = bracket(F, bracket(G, K)) + bracket(G, bracket(K, F)) + bracket(K, bracket(F, G))
    assert s.simplify(cyclic) == 0
    assert bracket(sympy.exp(q1), p1) == sympy.exp(q1)


def test_hamiltonian_refuses_joints_without_coordinate_velocities() -> None:
    s = sd.SymbolicManipulator(sd.load_urdf("floating_body", root="floating"))
    for call in (s.hamilton_equations, lambda: s.poisson_bracket(1, 2), lambda: s.C("derivatives")):
        with pytest.raises(sd.SpatialDynError, match='joint "root_joint" is floating, whose velocities are not'):
            call()
    with pytest.raises(sd.SpatialDynError, match="has 6 freedoms, expected at most 4"):
        s.H()


# --- exact numbers ---------------------------------------------------------------------------------------


def test_decimals_and_angles_are_read_exactly_and_said() -> None:
    builder = sd.ModelBuilder()
    builder.add_body(
        "arm", placement=((0.0892, 0, 0), (1.5707963267949, 0, 0)), inertia=(3.7, (0, 0.0892, 0), 0.1 * np.eye(3))
    )
    s = sd.SymbolicManipulator(builder.build(), ["m_1", "c_1y"])
    assert list(s.parameters.values()) == [Rational(37, 10), Rational(223, 2500)]
    assert s.assumptions == ('joint "arm_joint": angle 1.570796326795 rad is taken for pi/2',)
    assert s.M()[0, 0].subs(s.parameters) == Rational(37, 10) * Rational(223, 2500) ** 2 + Rational(1, 10)


def test_a_long_decimal_is_kept_and_what_rotations_left_is_not() -> None:
    read = exact_model.Reader()
    assert read.decimal(0.08333333333333333) == Rational("0.08333333333333333")
    assert read.entries([0.08333333333333333, 0.0], "x") == [Rational("0.08333333333333333"), 0]
    assert read.entries([0.012300000000000002, 3e-18], "link") == [Rational(123, 10000), 0]
    assert read.notes == ["link: entries are taken rounded: 0.012300000000000002 for 0.0123, 3e-18 for 0.0"]
    assert read.angle(1.5708, "x") == Rational("1.5708")


def test_symbols_name_what_is_not_zero() -> None:
    s = sd.SymbolicManipulator(sd.load_urdf("three_link"), "symbols")
    expected = [
        f"{x}_{k}{y}" for k in (1, 2, 3) for x, y in zip("mcIIIl", ("", "z", "xx", "yy", "zz", "z"), strict=True)
    ]
    assert [str(x) for x in s.parameters] == [x for x in expected if x != "l_1z"] + ["g"]
    assert all(s.meaning[x] for x in s.parameters)


def test_closed_forms_beyond_the_limit_are_refused_by_name() -> None:
    model = sd.load_urdf("three_link")
    s = sd.SymbolicManipulator(model, limit=300)
    assert s.g() == sd.SymbolicManipulator(model, limit=None).g()
    for _ in range(2):  # neither a refused nor an earlier quantity counts against the limit of the next
        with pytest.raises(sd.SpatialDynError, match=r'model "three_link" takes more than 300 products .*c_code\(\)'):
            s.hamilton_equations()
        assert s.M().shape == (3, 3)
    for limit in (0, -1, "long"):
        with pytest.raises(sd.SpatialDynError, match=r"limit is .*, expected a positive number"):
            sd.SymbolicManipulator(model, limit=limit)


def test_an_expression_may_name_another_parameter() -> None:
    """A uniform rod: m_1 is the mass, and stands in the inertia too; its value is the mass's, in either order."""
    sympy = pytest.importorskip("sympy")
    m, l = sympy.Symbol("m_1", positive=True), sympy.Symbol("l", positive=True)
    rod = {"m_1": m, "c_1z": -l / 2, "I_1xx": m * l**2 / 12, "I_1yy": m * l**2 / 12, "I_1zz": 0}
    for names in (list(rod), list(rod)[::-1]):
        s = sd.SymbolicManipulator(sd.load_urdf("pendulum"), {name: rod[name] for name in names})
        assert s.M()[0] == m * l**2 / 3
        assert s.parameters == {m: 1, l: None}


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ("letters", 'parameters has "letters", expected'),
        ({"m_9": "m"}, 'parameters has "m_9", expected'),
        ({"c_1x": "l", "g": "l"}, "parameter l stands for"),
        (3, "parameters is 3, expected"),
        ({"m_1": ""}, "parameters has '' for m_1, expected the name of a symbol"),
        ({"m_1": "a b"}, "parameters has 'a b' for m_1"),
        ({"m_1": "q_1"}, "parameter q_1 has the name of a coordinate"),
    ],
)
def test_bad_parameters_are_named(parameters: Any, message: str) -> None:
    with pytest.raises(sd.SpatialDynError, match=message):
        two_link(parameters)


def test_bad_requests_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    s = two_link()
    for call, message in (
        (lambda: s.evaluate("cba"), "call is 'cba'"),
        (lambda: s.evaluate("difference"), "has the input q0"),
        (lambda: s.evaluate("frame_placement"), "needs a frame"),
        (lambda: s.C("guess"), "route is 'guess'"),
        (lambda: s.latex("X"), 'quantity is "X"'),
        (lambda: s.c_code(sympy.Symbol("x")), "expression has x"),
        (lambda: s.simplify(sympy.exp(s.q[0])), r"exp\(q_1\) is not rational"),
        (lambda: s.lambdify("M")([1.0]), r"q has shape \(1,\)"),
        (lambda: s.lambdify("C")([1.0, 2.0]), "has 1 arguments, expected q, v, parameters"),
    ):
        with pytest.raises(sd.SpatialDynError, match=message):
            call()
    with pytest.raises(sd.ModelError, match="has mimic joints"):
        sd.SymbolicManipulator(sd.load_urdf("tree", mimic=True))
    monkeypatch.setitem(sys.modules, "sympy", None)
    with pytest.raises(sd.SpatialDynError, match="pip install sympy"):
        two_link()


# --- exports ---------------------------------------------------------------------------------------------


def test_lambdified_functions_broadcast_and_take_parameters() -> None:
    s = two_link()
    f = s.lambdify("C")
    rng = np.random.default_rng(0)
    q, v = rng.normal(size=(4, 1, 2)), rng.normal(size=(3, 2))
    assert f(q, v).shape == (4, 3, 2, 2)
    assert s.lambdify("T")(q, v).shape == (4, 3)
    heavy = s.lambdify("g")(q, [1.0, 1.0, 5.0, 5.0, 9.81])
    np.testing.assert_allclose(heavy, 5.0 * s.lambdify("g")(q), rtol=ROUNDING)


def test_latex_writes_velocities_with_dots() -> None:
    assert two_link().latex("C").count(r"\dot{q}_{1}") == 2
    assert r"\ddot{q}_{2}" in two_link().latex("tau")


def test_python_code_equals_the_closed_form() -> None:
    s = sd.SymbolicManipulator(small_robot("revolute", 1))
    q, v = np.array([0.3, -0.7]), np.array([1.1, 0.4])
    for what, arguments in (("M", (q,)), ("C", (q, v)), ("V", (q,))):
        scope: dict[str, Any] = {}
        exec(s.python_code(what), scope)
        np.testing.assert_allclose(scope[what](*arguments), s.lambdify(what)(*arguments), rtol=ROUNDING, atol=ROUNDING)


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_c_code_compiles_and_equals_the_closed_form(tmp_path: Path) -> None:
    s = two_link()
    (tmp_path / "arm.c").write_text(s.c_code("C"))
    command = ["cc", "-std=c99", "-Wall", "-Werror", "-pedantic", "-shared", "-fPIC", "arm.c", "-o", "arm.so", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    q, v, parameters = np.array([0.3, -0.7]), np.array([1.1, 0.4]), np.array([1.0, 0.8, 2.0, 1.5, 9.81])
    out = np.empty((2, 2))
    ctypes.CDLL(str(tmp_path / "arm.so")).C(*(ctypes.c_void_p(x.ctypes.data) for x in (q, v, parameters, out)))
    np.testing.assert_allclose(out, s.lambdify("C")(q, v, parameters), rtol=ROUNDING, atol=ROUNDING)


def test_a_robot_may_be_given_by_name() -> None:
    assert sd.SymbolicManipulator("pendulum").M() == sd.SymbolicManipulator(sd.load_urdf("pendulum")).M()
    with pytest.raises(sd.UrdfError, match="pendulun"):
        sd.SymbolicManipulator("pendulun")
