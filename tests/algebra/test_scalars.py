"""The functions of one number: the same for floats in Python and in compiled code, and open to other numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
import pytest

from spatialdyn.algebra.scalars import atan2, cos, exp, inline, select, sin, sqrt
from spatialdyn.engines.compiled.jit import hand_over

ODD = [0.0, -0.0, 5e-324, 1e-308, 1.0, -1.0, 1.7976931348623157e308, math.inf, -math.inf, math.nan]
USUAL = [0.1, -0.7, math.pi / 2, math.pi, -math.pi, 3.0, 1e3, -1e5, 1e-9, 4.0]
VALUES = ODD + USUAL
hand_over()


@numba.njit(error_model="numpy")
def compiled_sin(x: float) -> float:
    return sin(x)


@numba.njit(error_model="numpy")
def compiled_cos(x: float) -> float:
    return cos(x)


@numba.njit(error_model="numpy")
def compiled_sqrt(x: float) -> float:
    return sqrt(x)


@numba.njit(error_model="numpy")
def compiled_exp(x: float) -> float:
    return exp(x)


@numba.njit(error_model="numpy")
def compiled_atan2(y: float, x: float) -> float:
    return atan2(y, x)


@numba.njit(error_model="numpy")
def compiled_select(x: float, positive: float, otherwise: float) -> float:
    return select(x, positive, otherwise)


def same(x: Any, y: Any, ulps: int) -> None:
    """Equal to so many units in the last place; NaN is NaN, and zeros have one sign."""
    assert type(x) is float
    assert type(y) is float
    if math.isnan(x) or math.isnan(y) or math.isinf(x) or math.isinf(y) or x == 0.0 or y == 0.0:
        assert repr(x) == repr(y)
    else:
        assert abs(x - y) <= ulps * math.ulp(x)


ONE = [(sin, compiled_sin, math.sin), (cos, compiled_cos, math.cos), (sqrt, compiled_sqrt, math.sqrt)]
ONE += [(exp, compiled_exp, math.exp)]


@pytest.mark.parametrize(("plain", "compiled", "reference"), ONE)
@pytest.mark.parametrize("x", VALUES)
def test_plain_and_compiled_agree(plain: Any, compiled: Any, reference: Callable[[float], float], x: float) -> None:
    same(plain(x), compiled(x), 0 if plain is sqrt else 1)  # √ is correctly rounded everywhere
    same(plain(np.float64(x)), plain(x), 0)
    try:
        same(plain(x), reference(x), 0)
    except ValueError:  # where math raises
        assert math.isnan(plain(x))
    except OverflowError:
        assert plain(x) == math.inf


def test_outside_their_domain_they_are_nan() -> None:
    for x in (math.inf, -math.inf, math.nan):
        assert math.isnan(sin(x))
        assert math.isnan(cos(x))
    for x in (-1.0, -5e-324, -math.inf, math.nan):
        assert math.isnan(sqrt(x))
    assert sqrt(math.inf) == math.inf
    assert math.copysign(1.0, sqrt(-0.0)) == -1.0


@pytest.mark.parametrize("x", VALUES)
def test_plain_and_compiled_atan2_agree_in_every_quadrant(x: float) -> None:
    for y in VALUES:
        same(atan2(y, x), compiled_atan2(y, x), 1)
        same(atan2(y, x), math.atan2(y, x), 0)


@pytest.mark.parametrize("x", VALUES)
def test_select_takes_the_first_of_positive_numbers_only(x: float) -> None:
    expected = 1.0 if x > 0.0 else 2.0  # zero of either sign and NaN are not positive
    assert select(x, 1.0, 2.0) == expected
    assert compiled_select(x, 1.0, 2.0) == expected


def test_select_lets_no_nan_through_from_the_other_side() -> None:
    for chosen in (select, compiled_select):
        assert chosen(1.0, 3.0, math.nan) == 3.0
        assert chosen(-1.0, math.nan, 3.0) == 3.0
        assert math.isnan(chosen(math.nan, 3.0, math.nan))


@dataclass(frozen=True)
class Written:
    """A number of an engine, which records the operations on it."""

    text: str


def test_an_engine_registers_what_they_are_for_its_numbers() -> None:
    x = Written("x")
    for function in (sin, cos, sqrt, exp):
        with pytest.raises(TypeError):
            function(x)
    sin.register(Written)(lambda x: Written(f"sin {x.text}"))
    cos.register(Written)(lambda x: Written(f"cos {x.text}"))
    sqrt.register(Written)(lambda x: Written(f"sqrt {x.text}"))
    exp.register(Written)(lambda x: Written(f"exp {x.text}"))
    atan2.register(Written)(lambda y, x: Written(f"atan2 {y.text} {x.text}"))
    select.register(Written)(lambda x, a, b: Written(f"{x.text} > 0 ? {a} : {b}"))
    assert sin(x) == Written("sin x")
    assert cos(x) == Written("cos x")
    assert sqrt(x) == Written("sqrt x")
    assert exp(x) == Written("exp x")
    assert atan2(x, Written("y")) == Written("atan2 x y")
    assert select(x, 1.0, 2.0) == Written("x > 0 ? 1.0 : 2.0")
    assert sin(0.5) == math.sin(0.5)  # floats as before


def test_an_inlined_function_is_plain_python_and_compiles() -> None:
    @inline
    def twice(x: Any) -> Any:
        return x + x

    hand_over()

    @numba.njit
    def four_times(x: float) -> float:
        return twice(twice(x))

    assert twice("ab") == "abab"
    assert four_times(1.5) == 6.0
