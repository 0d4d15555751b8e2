"""Programs as functions of CasADi and as C with its external interface: values and Jacobians, and solvers on both."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from gradients import Late
from inputs import random_inputs
from trees import random_tree

import spatialdyn as sd
from spatialdyn.calls import exported
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.recursions import SPECS

casadi = Late("casadi")

compiled = pytest.mark.skipif(numba_kernels.PLAIN, reason="derivatives are of programs")
CLOSE = 1e-12  # of the largest entry
CALLS = ("rnea", "aba", "crba", "minverse", "generalized_gravity", "frame_velocity", "frame_placement")
FRAMED = ("frame_velocity", "frame_placement")


@pytest.fixture(scope="module")
def model() -> sd.Model:
    """A chain of revolute and prismatic joints."""
    return random_tree(3, 4, kinds=("revolute", "prismatic"), branching=0.0).model


def options(model: sd.Model, call: str) -> dict[str, Any]:
    return {"frame": model.frames[-1].name} if call in FRAMED else {}


def states(model: sd.Model, call: str) -> list[np.ndarray]:
    spec = numba_kernels.variant(SPECS[call], frozenset())
    return [np.asarray(x) for x in random_inputs(model, spec, seed=4)][: sum(not x.static for x in spec.present)]


def close(found: Any, wanted: Any) -> None:
    wanted = np.asarray(wanted)
    np.testing.assert_allclose(np.asarray(found), wanted, rtol=0.0, atol=CLOSE * max(1.0, abs(wanted).max()))


def by_differences(k: Any, given: list[np.ndarray], at: int, entry: int) -> np.ndarray:
    """The derivative of a result by one entry, by Richardson's extrapolation of central differences: to some 1e-10."""

    def central(h: float) -> np.ndarray:
        moved = [[x.copy() for x in given] for _ in range(2)]
        for x, sign in zip(moved, (1.0, -1.0), strict=True):
            x[at].ravel()[entry] += sign * h
        return (np.asarray(k(*moved[0])) - np.asarray(k(*moved[1]))) / (2.0 * h)

    coarse, fine, finest = central(8e-3), central(4e-3), central(2e-3)
    first, second = (4.0 * fine - coarse) / 3.0, (4.0 * finest - fine) / 3.0
    return (16.0 * second - first) / 15.0


def blocks(found: Any) -> list[np.ndarray]:
    return [np.asarray(x) for x in (found if isinstance(found, tuple) else (found,))]


@pytest.mark.parametrize("call", CALLS)
def test_values_and_jacobians_equal_the_librarys(model: sd.Model, call: str) -> None:
    k = sd.specialize(model, getattr(sd, call), **options(model, call))
    f, given = k.to_casadi(), states(model, call)
    value = np.atleast_1d(k(*given))
    close(np.asarray(f(*given)).reshape(value.shape), value)
    assert f.name_in() == list(dict.fromkeys(f.name_in()))
    for block, x in zip(blocks(f.jacobian()(*given, 0)), range(len(given)), strict=True):
        for entry in range(given[x].size):
            wanted = by_differences(k, given, x, entry).T.ravel()  # CasADi's vec goes column by column
            np.testing.assert_allclose(block[:, entry], wanted, rtol=0.0, atol=3e-9 * max(1.0, abs(wanted).max()))


@pytest.mark.parametrize("call", ["rnea", "aba"])
def test_jacobians_are_the_analytic_ones_to_rounding(model: sd.Model, call: str) -> None:
    f, given = sd.specialize(model, getattr(sd, call)).to_casadi("f"), states(model, call)
    wanted = getattr(sd, call + "_derivatives")(model, *given)
    for block, part in zip(blocks(f.jacobian()(*given, 0)), wanted, strict=True):
        close(block, part)
    x = [casadi.MX.sym(name, model.nv) for name in f.name_in()]
    graph = casadi.Function("graph", x, [casadi.jacobian(f(*x), y) for y in x])
    for block, part in zip(graph(*given), wanted, strict=True):
        close(np.asarray(block), part)


def test_the_jacobian_of_aba_is_its_own_recursion(model: sd.Model) -> None:
    f = sd.specialize(model, sd.aba).to_casadi()
    x = casadi.SX.sym("x", 3 * model.nv)  # in a graph of scalars CasADi differentiates each of them
    bare = casadi.Function("bare", [x], [f(*casadi.vertsplit(x, model.nv))])
    assert f.jacobian().n_instructions() < 0.7 * bare.jacobian().n_instructions()


def called(f: Any) -> dict[str, int]:
    """The instructions of each function of scalars that a function of CasADi calls."""
    found: dict[str, int] = {}
    for k in range(f.n_instructions()) if f.class_name() == "MXFunction" else ():
        if f.instruction_id(k) == casadi.OP_CALL:
            inner = f.instruction_MX(k).which_function()
            found |= called(inner) if inner.class_name() == "MXFunction" else {inner.name(): inner.n_instructions()}
    return found


def test_factory_and_nested_graphs_keep_the_jacobian(model: sd.Model) -> None:
    f, given, n = sd.specialize(model, sd.aba).to_casadi(), states(model, "aba"), model.nv
    own = f.jacobian().n_instructions()
    made = f.factory("made", f.name_in(), ["jac:a:q", "jac:a:tau"])
    x = casadi.MX.sym("x", 3 * n)
    inner = casadi.Function("inner", [x], [2.0 * f(*casadi.vertsplit(x, n))])
    nested = casadi.Function("outer", [x], [inner(3.0 * x)]).factory("nested", ["i0"], ["jac:o0:i0"])
    for graph in (made, nested):
        assert called(graph)["jac_aba"] == own
        assert set(called(graph)) == {"aba", "jac_aba"}
    by_q, by_v, by_tau = sd.aba_derivatives(model, *given)
    close(made(*given)[0], by_q)
    close(nested(np.concatenate(given) / 3.0), 6.0 * np.hstack([by_q, by_v, by_tau]))


@compiled
@pytest.mark.parametrize("call", ["aba", "rnea"])
def test_one_direction_of_either_mode_is_a_program(model: sd.Model, call: str) -> None:
    f, given, n = sd.specialize(model, getattr(sd, call)).to_casadi(), states(model, call), model.nv
    name = f.name_out()[0]
    rng = np.random.default_rng(3)
    weights, along = rng.standard_normal(n), rng.standard_normal((3, n))
    by = getattr(sd, call + "_derivatives")(model, *given)
    back = f.factory("back", [*f.name_in(), f"lam:{name}"], [f"grad:s:{x}" for x in f.name_in()], {"s": [name]})
    assert set(called(back)) == {call, f"adj1_{call}"}
    for found, part in zip(back(*given, weights), by, strict=True):
        close(np.asarray(found)[:, 0], weights @ part)
    ahead = f.forward(1)(*given, f(*given), *along)
    close(np.asarray(ahead)[:, 0], sum(part @ one for part, one in zip(by, along, strict=True)))


@compiled
@pytest.mark.parametrize("call", ["rnea", "aba", "crba"])
def test_hessians_are_a_program_and_equal_casadis(model: sd.Model, call: str) -> None:
    """Of a sum with given weights, and of a square, whose weights depend on the inputs too; by all inputs together."""
    k, given = sd.specialize(model, getattr(sd, call)), np.concatenate(states(model, call))
    x, found = casadi.MX.sym("x", given.size), []
    for f in (k.to_casadi(), k.to_casadi(jacobian=False)):
        y = casadi.vec(f(*casadi.vertsplit(x, model.nv)))
        scalars = casadi.dot(np.sin(np.arange(y.numel()) + 1.0), y), casadi.sumsqr(y)
        found.append([casadi.Function("h", [x], [casadi.hessian(s, x)[0]]) for s in scalars])
    for k, (own, theirs) in enumerate(zip(*found, strict=True)):
        wanted = np.asarray(theirs(given))
        np.testing.assert_allclose(own(given), wanted, rtol=0.0, atol=1e-11 * abs(wanted).max())
        assert set(called(own)) == {call, f"hess_adj1_{call}", *([f"jac_{call}"] if k else [])}
        assert sum(called(own).values()) < 0.7 * instructions(theirs)


def instructions(f: Any) -> int:
    """The instructions of a function of CasADi and of all that it calls."""
    return int(f.n_instructions()) + sum(called(f).values())


@compiled
def test_a_hessian_of_many_inputs_is_left_to_casadi(model: sd.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    k, given = sd.specialize(model, sd.aba), np.concatenate(states(model, "aba"))
    x, found = casadi.MX.sym("x", given.size), []
    for most in (12, 11):
        monkeypatch.setattr(exported, "MOST_TWICE", most)
        f = k.to_casadi()
        y = casadi.hessian(casadi.sum1(f(*casadi.vertsplit(x, model.nv))), x)[0]
        found.append(casadi.Function("h", [x], [y]))
    assert ["hess_adj1_aba" in called(f) for f in found] == [True, False]
    own, theirs = (np.asarray(f(given)) for f in found)
    np.testing.assert_allclose(own, theirs, rtol=0.0, atol=1e-11 * abs(theirs).max())


def test_parameters_forces_and_several_results_are_named(model: sd.Model) -> None:
    joint = model.names[2]
    k = sd.specialize(model, [sd.rnea, sd.crba], inputs=["fext", f"mass:{joint}"])
    f = k.to_casadi("both")
    assert (f.name(), f.name_in()) == ("both", ["q", "v", "a", "fext", "mass_5"])
    assert f.name_out() == ["tau", "M"]
    rng = np.random.default_rng(1)
    given = [*states(model, "rnea"), rng.standard_normal((model.njoints, 6)), np.array(1.3)]
    tau, M = k(*given)
    found = f(*given)
    close(np.asarray(found[0])[:, 0], tau)
    close(np.asarray(found[1]), M)
    parts = blocks(f.jacobian()(*given, 0, 0))
    assert [x.shape for x in parts[:5]] == [(4, 4), (4, 4), (4, 4), (4, 6 * model.njoints), (4, 1)]
    for entry in range(6 * model.njoints):  # of a matrix the columns of a Jacobian are its entries column by column
        column, row = divmod(entry, model.njoints)
        wanted = by_differences(lambda *x: k(*x)[0], given, 3, 6 * row + column)
        np.testing.assert_allclose(parts[3][:, entry], wanted, rtol=0.0, atol=1e-9)


def test_configurations_stay_in_coordinates() -> None:
    """A floating base: derivatives by the entries of q, along unit norm those of displacements."""
    model = random_tree(5, 2, floating=True).model
    f = sd.specialize(model, sd.rnea).to_casadi()
    q, v, a = states(model, "rnea")
    by_q = blocks(f.jacobian()(q, v, a, 0))[0]
    moved = sd.specialize(model, sd.integrate).to_casadi("move")
    assert moved.name_in()[0] == "q"
    tangent = blocks(moved.jacobian()(q, np.zeros(model.nv), 0))[1]
    close(by_q @ tangent, sd.rnea_derivatives(model, q, v, a)[0])


@pytest.fixture(scope="module")
def compile_c(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A function that compiles C text to a shared library and returns its path."""
    compiler = shutil.which("cc")
    if compiler is None or sys.platform == "win32":
        pytest.skip("no C compiler called cc")

    def made(text: str, name: str) -> str:
        folder = tmp_path_factory.mktemp(name)
        (folder / f"{name}.c").write_text(text)
        flags = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-O1", "-shared", "-fPIC"]
        library = folder / f"{name}.so"
        subprocess.run([compiler, *flags, "-o", str(library), str(folder / f"{name}.c"), "-lm"], check=True)
        return str(library)

    return made


@pytest.mark.parametrize("call", ["aba", "crba"])
def test_compiled_c_is_called_through_casadi_external(model: sd.Model, call: str, compile_c: Any) -> None:
    k, given = sd.specialize(model, getattr(sd, call)), states(model, call)
    text = k.c_code("robot", derivatives=True)
    assert "jac_jac" not in text
    f = casadi.external("robot", compile_c(text, "robot"))
    same = k.to_casadi("robot")
    assert (f.name_in(), f.name_out()) == (same.name_in(), same.name_out())
    assert f.size_out(0) == same.size_out(0)
    close(np.asarray(f(*given)), np.asarray(same(*given)))
    derivatives, wanted = f.jacobian(), same.jacobian()
    assert (derivatives.name_in(), derivatives.name_out()) == (wanted.name_in(), wanted.name_out())
    assert derivatives.class_name() == "External"
    for one, other in zip(blocks(derivatives(*given, 0)), blocks(wanted(*given, 0)), strict=True):
        close(one, other)


def test_compiled_c_takes_missing_arrays_and_places_matrices_in_columns(model: sd.Model, compile_c: Any) -> None:
    """An absent input is 0, as CasADi has it; fext is a matrix, and so is the result."""
    k = sd.specialize(model, [sd.rnea, sd.crba], inputs="fext")
    f = casadi.external("both", compile_c(k.c_code("both", derivatives=True), "both"))
    q, v, a = states(model, "rnea")
    fext = np.random.default_rng(2).standard_normal((model.njoints, 6))
    tau, M = k(q, v, a, fext)
    close(np.asarray(f(q, v, a, fext)[0])[:, 0], tau)
    close(np.asarray(f(q, v, a, fext)[1]), M)
    close(np.asarray(f(q=q)["tau"])[:, 0], sd.rnea(model, q, 0 * v, 0 * a))


def test_ipopt_swings_a_pendulum_up_with_either(compile_c: Any) -> None:
    """Semi-implicit Euler on both: the torque of least effort from hanging to upright, the same from C and from SX."""
    model = one_link()
    k = sd.specialize(model, sd.aba)
    library = compile_c(k.c_code("ahead", derivatives=True), "ahead")
    efforts = []
    for f in (k.to_casadi("ahead"), casadi.external("ahead", library)):
        opti, n, dt = casadi.Opti(), 20, 0.05
        q, v, u = opti.variable(n + 1), opti.variable(n + 1), opti.variable(n)
        for i in range(n):
            opti.subject_to(v[i + 1] == v[i] + dt * f(q[i], v[i], u[i]))
            opti.subject_to(q[i + 1] == q[i] + dt * v[i + 1])
        opti.subject_to([q[0] == -np.pi / 2, v[0] == 0, q[n] == np.pi / 2, v[n] == 0])
        opti.minimize(casadi.sumsqr(u))
        opti.set_initial(q, np.linspace(-np.pi / 2, np.pi / 2, n + 1))
        opti.solver(
            "ipopt", {"print_time": 0}, {"print_level": 0, "sb": "yes", "hessian_approximation": "limited-memory"}
        )
        solved = opti.solve()
        torque = np.asarray(solved.value(u))
        at, speed = np.array([-np.pi / 2]), np.zeros(1)
        for one in torque:
            speed = speed + dt * sd.aba(model, at, speed, [one])
            at = at + dt * speed
        np.testing.assert_allclose([at[0], speed[0]], [np.pi / 2, 0.0], rtol=0.0, atol=1e-6)
        efforts.append(float(torque @ torque))
    assert efforts[0] == pytest.approx(efforts[1], rel=1e-6)


def one_link() -> sd.Model:
    """A rod of 1 kg and 1 m that turns about y, horizontal at q = 0 and up at π/2."""
    builder = sd.ModelBuilder()
    builder.add_body("rod", None, "revolute", (0, -1, 0), None, (1.0, (0.5, 0.0, 0.0), np.diag([1e-4, 1 / 12, 1 / 12])))
    return builder.build()


def test_names_that_casadi_or_c_refuses_are_refused(model: sd.Model) -> None:
    k = sd.specialize(model, sd.rnea)
    with pytest.raises(sd.SpatialDynError, match="name is 'jac', expected a name that CasADi takes"):
        k.to_casadi("jac")
    for function in (k.to_casadi, lambda name: k.c_code(name, derivatives=True)):
        with pytest.raises(sd.SpatialDynError, match="name is 'double', expected a name that C does not reserve"):
            function("double")


@compiled
def test_results_named_after_a_parameter_are_numbered(model: sd.Model) -> None:
    k = sd.specialize(model, sd.rnea, inputs=f"mass:{model.names[1]}", derivative="vjp")
    assert re.search(r"\(const double \*q, .*double \*out_5\)", k.c_code())


@compiled
def test_weights_and_tangents_are_named_as_in_the_signature() -> None:
    model = sd.load_urdf("two_link")
    k = sd.specialize(model, sd.aba, derivative="vjp")
    assert k.to_casadi().name_in() == ["q", "v", "tau", "a_bar"]
    assert k.to_casadi().name_out() == ["a", "q_bar", "v_bar", "tau_bar"]
    k = sd.specialize(model, [sd.rnea, sd.generalized_gravity], derivative="jvp", inputs="gravity", fixed={"v": 0})
    assert "def f(q, a, gravity_3, dq, da, dgravity_6):" in k.python_code("f")
    k = sd.specialize(model, [sd.rnea, sd.nonlinear_effects], derivative="vjp")
    assert "def f(q, v, a, tau_bar, tau_bar_5):" in k.python_code("f")


def test_derivatives_of_a_robot_too_long_for_them_are_refused() -> None:
    """Of 210 joints they would be 132 300 numbers, of a dozen lines each: minutes in CasADi."""
    builder = sd.ModelBuilder("chain")
    for i in range(210):
        inertia = (1.0, (0.1, 0.0, 0.0), np.eye(3))
        builder.add_body(f"l{i}", f"l{i - 1}" if i else None, "revolute", (0, 0, 1), (0.2, 0, 0), inertia)
    k = sd.specialize(builder.build(), sd.rnea)
    with pytest.raises(
        sd.SpatialDynError,
        match=r'derivatives of rnea of "chain" are 132300 numbers, expected at most \d+; .*jaco',
    ):
        k.to_casadi()


def test_without_casadi_the_error_says_how_to_install_it(model: sd.Model, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(sd.SpatialDynError, match=re.escape("casadi is not installed; pip install casadi")):
        sd.specialize(model, sd.rnea).to_casadi()
    assert "jac_rnea" in sd.specialize(model, sd.rnea).c_code(derivatives=True)
