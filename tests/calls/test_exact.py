"""The exact engine agrees with float64 to its rounding, with itself at any precision, and names what it refuses."""

from __future__ import annotations

import subprocess
import sys
from fractions import Fraction
from typing import Any

import mpmath
import numpy as np
import pytest
from slow import slow_but
from trees import random_state, random_tree

import spatialdyn as sd
from spatialdyn.algebra.scalars import exp
from spatialdyn.calls.dynamics import calls
from spatialdyn.engines.numbers.multiprecision import arithmetic
from spatialdyn.engines.numbers.symbolic import Ring
from spatialdyn.model.robot import Mimic
from spatialdyn.recursions import SPECS
from spatialdyn.recursions.spec import Spec

EPS = float(np.finfo(float).eps)
ROUNDING = 2000 * EPS  # of ten random bodies, the calls that solve for something among them; a wrong term is 1e-3
BITS = 240
DIGITS = 1e-70  # what 240 bits leave, times a condition of 100


def tree(seed: int, n: int = 6, **options: Any) -> tuple[sd.Model, dict[str, np.ndarray]]:
    """A random model and a random state by the names of inputs."""
    made = random_tree(seed, n, **options)
    rng = np.random.default_rng(seed)
    state, other = random_state(made.tree, rng), random_state(made.tree, rng)
    model = made.model
    values = dict(q=state.q, v=state.v, a=state.a, tau=state.tau, fext=state.fext, q0=state.q, q1=other.q)
    return model, {**values, "p": other.tau, "t": np.array(0.3), "unit": state.q}


def words(model: sd.Model, spec: Spec) -> dict[str, Any]:
    """The words of a call that takes a frame."""
    static = {x.name for x in spec.present if x.static}
    made: dict[str, Any] = {"frame": model.joints[-1].name} if "row" in static else {}
    if "reference" in static:
        made["reference"] = "local_world_aligned"
    if "classical" in static:
        made["classical"] = True
    return made


def both(model: sd.Model, name: str, values: dict[str, np.ndarray], bits: int | None = BITS) -> tuple[Any, Any]:
    """What the public call and the exact one give, optional inputs present."""
    spec, given = SPECS[name], []
    for x in spec.present:
        if not x.static:
            shape = tuple(getattr(model, s) if isinstance(s, str) else s for s in x.shape)
            given.append((x, values.get(x.name, np.ones(shape))))
    order = [v for x, v in given if not x.optional]
    optional = {x.name: v for x, v in given if x.optional}
    made = words(model, spec)
    return calls[name](model, *order, **made, **optional), sd.exact(model, calls[name], bits, **made)(
        *order, **optional
    )


def off(found: Any, wanted: Any) -> float:
    """Largest difference against the largest entry."""
    found, wanted = np.asarray(found, object), np.asarray(wanted, object)
    if not wanted.size:
        return 0.0
    scale = max(abs(x) for x in wanted.ravel())
    return float(max(abs(x - y) for x, y in zip(found.ravel(), wanted.ravel(), strict=True)) / max(scale, 1e-300))


TREES = [(0, {}), (1, {"floating": True, "continuous": "cos_sin"})]
CASES = [(name, *tree) for tree in TREES for name in SPECS]


@pytest.mark.parametrize(("name", "seed", "options"), slow_but([*CASES[::2], CASES[-1]], CASES))
def test_every_call_rounds_to_what_float64_gives(name: str, seed: int, options: dict[str, Any]) -> None:
    model, values = tree(seed, 4, **options)
    found, truth = both(model, name, values)
    assert np.shape(found) == np.shape(truth)
    assert off(found, truth) <= ROUNDING


def test_a_pendulum_is_its_formula_to_the_last_digit() -> None:
    model = sd.ModelBuilder("rod").add_body("rod", None, "revolute", (0, 1, 0), None, (2.0, (0.5, 0, 0), np.eye(3)))
    truth = sd.exact(model.build(), sd.generalized_gravity, bits=400)
    c = truth.context
    # turning about y by q lowers the tip: z = -0.5 sin q, V = -m g 0.5 sin q with the double 9.81
    wanted = -2 * c.mpf(9.81) * c.mpf(0.5) * c.cos(c.mpf(0.3))
    assert abs(truth([0.3])[0] - wanted) <= c.ldexp(1, -396)


def test_more_bits_change_only_what_fewer_could_not_hold() -> None:
    model, s = tree(3)
    coarse, fine = (sd.exact(model, sd.aba, bits)(s["q"], s["v"], s["tau"]) for bits in (BITS, 500))
    assert 0 < off(coarse, fine) <= DIGITS
    assert off(sd.exact(model, sd.aba, 53)(s["q"], s["v"], s["tau"]).astype(float), fine) <= EPS / 2


@pytest.mark.parametrize("angle", [0.0, 1e-30, 1e-9, 0.5, 3.0])
def test_exponentials_are_exact_beyond_float64(angle: float) -> None:
    """Their Taylor coefficients are float64's; the exact engine takes the closed forms, next to no rotation too."""
    model = (
        sd.ModelBuilder("puck").add_body("puck", None, "planar", (0, 0, 1), None, (1.0, (0, 0, 0), np.eye(3))).build()
    )
    moved = sd.exact(model, sd.integrate)([0.0, 0.0, 0.0], [1.0, 0.0, angle])
    mp = sd.exact(model, sd.integrate).context
    a = mp.mpf(angle)
    wanted = (mp.sin(a) / a, (1 - mp.cos(a)) / a) if angle else (mp.mpf(1), mp.mpf(0))
    # what θ² + 1e-36 in place of θ² changes (see recursions.lie)
    assert abs(moved[0] - wanted[0]) <= 1e-36
    assert abs(moved[1] - wanted[1]) <= 1e-36


@pytest.mark.parametrize("angle", [0.0, 1e-30, 1e-18, 1e-9])
@pytest.mark.parametrize("name", ["integrate", "difference", "dintegrate", "ddifference"])
def test_what_cancels_next_to_no_rotation_is_cancelled_in_spare_bits(name: str, angle: float) -> None:
    """1 - cos θ over θ² loses 36 digits where θ is 1e-18, its derivative 36 more: asked for few bits, all are right."""
    builder = sd.ModelBuilder("body").add_body("body", None, "floating", inertia=(1.0, (0, 0, 0), np.eye(3)))
    model = builder.build()
    q = np.array([0.1, -0.2, 0.3, 0.0, 0.6, 0.0, 0.8])
    v = np.array([1.0, -2.0, 0.5, 0.6 * angle, 0.0, -0.8 * angle])
    second = np.asarray(sd.integrate(model, q, v)) if name.endswith("difference") else v
    coarse, fine = (sd.exact(model, getattr(sd, name), bits)(q, second) for bits in (BITS, 2000))
    assert off(coarse, fine) <= DIGITS


def test_forward_and_inverse_dynamics_undo_each_other_where_rotations_are_exact() -> None:
    """On a chain whose placements are signed permutations: with others the table is orthonormal to rounding only."""
    builder = sd.ModelBuilder("chain")
    for k in range(6):
        builder.add_body(
            f"b{k}", f"b{k - 1}" if k else None, ("revolute", "prismatic")[k == 3], np.eye(3)[k % 3],
            (0.3, 0, 0.1 * k), (1.0 + k, (0.1, 0.2, 0.3), np.diag([1.0, 2.0, 1.5])),
        )  # fmt: skip
    model = builder.build()
    q, v, tau = np.random.default_rng(5).normal(size=(3, 6))
    a = sd.exact(model, sd.aba)(q, v, tau)
    assert off(sd.exact(model, sd.rnea)(q, v, a), tau) <= DIGITS
    M = sd.exact(model, sd.crba)(q)
    assert off(M @ sd.exact(model, sd.minverse)(q), np.eye(6)) <= DIGITS


def test_batches_are_their_samples() -> None:
    model, s = tree(4)
    q = np.stack([s["q"], s["q1"]])
    whole = sd.exact(model, sd.rnea)(q[:, None], s["v"], np.stack([s["a"], s["v"], s["p"]]))
    assert whole.shape == (2, 3, model.nv)
    assert (whole[1, 2] == sd.exact(model, sd.rnea)(q[1], s["v"], s["p"])).all()
    assert sd.exact(model, sd.rnea)(q[:0], s["v"], s["a"]).shape == (0, model.nv)


def test_fext_goes_last_or_by_name_and_may_be_left_out() -> None:
    model, s = tree(6)
    truth = sd.exact(model, sd.rnea)
    last = truth(s["q"], s["v"], s["a"], s["fext"])
    assert (last == truth(s["q"], s["v"], fext=s["fext"], a=s["a"])).all()
    assert (truth(s["q"], s["v"], s["a"], 0 * s["fext"]) == truth(s["q"], s["v"], s["a"])).all()


@pytest.mark.parametrize("name", ["rnea", "crba", "frame_velocity", "momentum", "aba"])
def test_mimic_joints_follow(name: str) -> None:
    builder = sd.ModelBuilder("fingers")
    body = (1.0, (0.1, 0.0, 0.2), np.diag([0.1, 0.2, 0.25]))
    builder.add_body("a", None, "revolute", (0, 1, 0), None, body, joint_name="lead")
    builder.add_body(
        "b", "a", "revolute", (0, 1, 0), (0.2, 0, 0), body, joint_name="then", mimic=Mimic("lead", 0.5, 0.1)
    )
    model = builder.build(mimic=True)
    values = dict(zip(("q", "v", "a", "tau"), np.random.default_rng(0).normal(size=(4, 1)), strict=True))
    found, truth = both(model, name, values)
    assert off(found, truth) <= ROUNDING
    with pytest.raises(sd.ModelError, match=r"mimic joints.*rationals"):
        sd.exact(model, sd.rnea, bits=None)


# --- rationals ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["rnea", "aba", "crba", "minverse", "kinetic_energy", "coriolis_matrix", "momentum_rate"]
)
@pytest.mark.parametrize("kinds", [("revolute", "prismatic"), ("spherical", "planar", "floating")])
def test_rationals_are_the_digits_without_an_end(name: str, kinds: tuple[str, ...]) -> None:
    model, s = tree(8, 3, kinds=kinds)
    s["q"] = np.round(64 * s["q"]) / 64  # short, and quaternions made exactly unit below
    t, q = [], []
    ctx = sd.exact(model, sd.crba).context
    for joint in model.joints[1:]:
        at = slice(joint.idx_q, joint.idx_q + joint.nq)
        part = [Fraction(x) for x in s["q"][at].tolist()]
        if joint.kind in ("spherical", "floating"):
            part[-4:] = [Fraction(1, 3), Fraction(-2, 3), Fraction(0), Fraction(2, 3)]
        t += part
        if joint.kind in ("revolute", "planar"):
            part[-1] = 2 * ctx.atan(ctx.mpf(part[-1].numerator) / part[-1].denominator)
        q += part
    spec = SPECS[name]
    arrays = [s[x.name] for x in spec.present if x.name != "q" and not x.optional]
    exact = sd.exact(model, calls[name], bits=None)(t, *arrays)
    digits = sd.exact(model, calls[name])(q, *arrays)
    for x, y in zip(np.ravel(exact), np.ravel(digits), strict=True):
        assert isinstance(x, Fraction)
        assert abs(ctx.mpf(x.numerator) / x.denominator - y) <= DIGITS * max(abs(z) for z in np.ravel(digits))


def test_rational_forward_dynamics_inverts_inverse_dynamics_without_any_error() -> None:
    model = sd.load_urdf("two_link")
    q, v, tau = [Fraction(1, 3), Fraction(-2, 7)], [1.5, -2], [Fraction(1, 10), 0]
    a = sd.exact(model, sd.aba, bits=None)(q, v, tau)
    assert sd.exact(model, sd.rnea, bits=None)(q, v, a).tolist() == tau


def test_what_has_no_rational_value_is_said() -> None:
    model = sd.load_urdf("two_link")
    with pytest.raises(sd.SpatialDynError, match="tan"):
        sd.exact(model, sd.integrate, bits=None)([Fraction(1), Fraction(1)], [1, 1])
    free, s = tree(1, 2, floating=True)
    with pytest.raises(sd.SpatialDynError, match="sqrt of a rational"):
        sd.exact(free, sd.normalize, bits=None)(s["q"])
    with pytest.raises(sd.SpatialDynError, match="q: nan is no rational"):
        sd.exact(model, sd.crba, bits=None)([np.nan, 0.0])


def test_exp_has_all_digits_and_rationals_and_symbols_refuse_it_by_name() -> None:
    digits = arithmetic(BITS)
    with mpmath.workprec(BITS):
        assert abs(exp(digits.number("-0.7")) - mpmath.exp(mpmath.mpf("-0.7"))) < DIGITS
    with pytest.raises(sd.SpatialDynError, match="exp of a rational"):
        exp(arithmetic(None).number(1))
    sympy = pytest.importorskip("sympy")
    x = sympy.Symbol("x")
    with pytest.raises(sd.SpatialDynError, match="exp of the symbolic"):
        exp(Ring(plain=[x]).of(x))


# --- what is refused ------------------------------------------------------------------------------------------


def test_errors_name_what_is_wrong() -> None:
    model, s = tree(2, 3, floating=True)
    for bits in (52, True, 60.0, "many", 10**400):
        with pytest.raises(sd.SpatialDynError, match=r"bits is .*at least 53"):
            sd.exact(model, sd.aba, bits)  # type: ignore[arg-type]
    with pytest.raises(sd.SpatialDynError, match="call is load_urdf, expected a public call such as"):
        sd.exact(model, sd.load_urdf)
    for call in (3, "aba", [sd.aba, sd.rnea], [sd.aba]):
        with pytest.raises(sd.SpatialDynError, match=r"call is .*, expected a public call such as spatialdyn.aba"):
            sd.exact(model, call)  # type: ignore[arg-type]
    with pytest.raises(sd.ModelError, match="frame is None"):
        sd.exact(model, sd.frame_velocity)
    with pytest.raises(sd.SpatialDynError, match="expected the default"):
        sd.exact(model, sd.aba, classical=True)
    with pytest.raises(sd.ModelError, match="expected a spatialdyn Model"):
        sd.exact("panda", sd.aba)  # type: ignore[arg-type]
    truth = sd.exact(model, sd.aba)
    with pytest.raises(sd.ShapeError, match=r"aba lacks tau"):
        truth(s["q"], s["v"])
    with pytest.raises(sd.ShapeError, match=r"given v twice"):
        truth(s["q"], s["v"], s["tau"], v=s["v"])
    with pytest.raises(sd.ShapeError, match=r"given x as an input"):
        truth(s["q"], s["v"], s["tau"], x=1)
    with pytest.raises(sd.ShapeError, match=r"takes 4 inputs, 5"):
        truth(1, 2, 3, 4, 5)
    with pytest.raises(sd.ShapeError, match=r"v has shape"):
        truth(s["q"], s["v"][1:], s["tau"])
    with pytest.raises(sd.SpatialDynError, match=r"v: 1j is no real number"):
        truth(s["q"], 1j * s["v"] / s["v"], s["tau"])
    with pytest.raises(sd.ConfigurationError, match=r"q in sample 1"):
        truth(np.stack([s["q"], 2 * s["q"]]), s["v"], s["tau"])


@pytest.mark.parametrize("bits", [BITS, None])
def test_a_joint_without_inertia_is_named(bits: int | None) -> None:
    builder = sd.ModelBuilder("empty")
    builder.add_body("a", None, "revolute", (0, 1, 0), None, (1.0, (0, 0, 0.1), np.eye(3)), joint_name="heavy")
    builder.add_body("b", "a", "revolute", (0, 0, 1), None, joint_name="hollow")
    model = builder.build()
    with pytest.raises(sd.InertiaError, match='joint "hollow" has zero articulated inertia in sample 0'):
        sd.exact(model, sd.aba, bits)([[0, 0]], [0, 0], [1, 1])


def test_a_joint_that_repeats_another_is_singular_at_every_precision() -> None:
    """Two hinges on one axis, nothing between them: D is what rounding leaves of 0."""
    builder = sd.ModelBuilder("twice")
    builder.add_body("a", None, "revolute", (0, 0, 1), (0.1, 0, 0), joint_name="first")
    builder.add_body("b", "a", "revolute", (0, 0, 1), None, (1.0, (0.3, 0.7, 0.1), np.eye(3)), joint_name="second")
    with pytest.raises(sd.InertiaError, match='joint "first" has zero articulated inertia'):
        sd.exact(builder.build(), sd.aba)([0.1, 0.2], [0, 0], [1, 1])


def test_nan_stays_where_it_is() -> None:
    model = sd.load_urdf("two_link")
    out = sd.exact(model, sd.aba)([[0.1, 0.2], [np.nan, 0.0], [0.0, np.nan]], [0, 0], [0, 0])
    assert np.isfinite(out[0].astype(float)).all()
    assert np.isnan(out[1:].astype(float)).all()  # also where it is in the articulated inertias, which are not singular


def test_the_global_precision_of_mpmath_stays() -> None:
    model, s = tree(2)
    before = mpmath.mp.prec
    with mpmath.workprec(20):
        coarse = sd.exact(model, sd.aba)(s["q"], s["v"], s["tau"])
    assert mpmath.mp.prec == before
    assert (coarse == sd.exact(model, sd.aba)(s["q"], s["v"], s["tau"])).all()


def test_numbers_come_in_many_forms() -> None:
    truth = sd.exact(tree(0, 2, kinds=("revolute",))[0], sd.generalized_gravity)
    wanted = truth([0.5, -0.25])
    for q in (
        ["0.5", "-0.25"],
        [Fraction(1, 2), Fraction(-1, 4)],
        [mpmath.mpf("0.5"), -0.25],
        np.float32([0.5, -0.25]),
    ):
        assert (truth(q) == wanted).all()
    assert truth(["0.1", "0"])[0] != truth([0.1, 0])[0]
    assert isinstance(sd.exact(truth.model, sd.kinetic_energy)([0, 0], [1, 1]), truth.context.mpf)


def test_without_mpmath_the_extra_is_named() -> None:
    code = """
import sys
sys.modules["mpmath"] = None
import spatialdyn as sd
model = sd.load_urdf("two_link")
print(sd.exact(model, sd.crba, bits=None)([0, 0])[1, 1])
try:
    sd.exact(model, sd.aba)
except sd.SpatialDynError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "pip install mpmath" in done.stdout


def test_repr_is_one_useful_line() -> None:
    model = sd.load_urdf("two_link")
    assert repr(sd.exact(model, sd.crba, bits=None)) == "<Exact crba of two_link in (q): rationals>"
    assert repr(sd.exact(model, sd.aba, bits=200)).endswith("(q, v, tau, fext): 200 bits>")
