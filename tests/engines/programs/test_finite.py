"""Checks that others make needless: the same samples are rejected without them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from test_simd import Runner, Shape, program_of

import spatialdyn as sd
from spatialdyn.algebra import scalars
from spatialdyn.engines.compiled.numba_kernels import variant
from spatialdyn.engines.programs.record import finite, recording
from spatialdyn.recursions import SPECS

SHAPES = (Shape(4, False), Shape(1, False))
CASES: dict[str, tuple[Callable[..., Sequence[Any]], frozenset[int], bool]] = {  # of x, y, z: implied inputs, bounded
    "a result in another": (lambda x, y, z: [x * y, 2.0 - x * y * z, z], frozenset({0, 1, 2}), False),
    "a result in another by a quotient": (lambda x, y, z: [x * y, z / (x * y)], frozenset({0, 1}), False),
    "a result that is an angle": (lambda x, y, z: [x + y, scalars.sin(x + y) * z], frozenset({0, 1, 2}), False),
    "sums and products": (lambda x, y, z: [x * y - z], frozenset({0, 1, 2}), False),
    "fused, negated": (lambda x, y, z: [z - (x * y - 2.0) * z, -x], frozenset({0, 1, 2}), False),
    "a divisor": (lambda x, y, z: [x / y, z], frozenset({2}), False),
    "a selection": (lambda x, y, z: [scalars.select(x, y, z)], frozenset(), False),
    "below an exp": (lambda x, y, z: [scalars.exp(x + y) + z], frozenset({2}), False),
    "angles": (lambda x, y, z: [scalars.sin(x) * scalars.cos(y)], frozenset({0, 1}), True),
    "an angle that is a sum": (lambda x, y, z: [scalars.sin(x + 2.0 * y)], frozenset({0, 1}), False),
    "nothing reads it": (lambda x, y, z: [x + 1.0], frozenset({0}), False),
    "large constants": (lambda x, y, z: [1e200 * (1e200 * scalars.sin(x)), 0.0 * y], frozenset({0}), False),
    "a constant": (lambda x, y, z: [scalars.cos(z), 2.0], frozenset({2}), True),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_every_input_that_is_not_finite_is_found(name: str) -> None:
    """In each place, whether its own check is left out or not; and results that overflow."""
    function, implied, bounded = CASES[name]
    program, layout = program_of(function, 3)
    assert finite.implied(program, layout)[0] == implied
    assert finite.bounded(program) == bounded
    x = np.full((16, 3), 0.75)
    for k, bad in enumerate((np.nan, np.inf, -np.inf)):
        x[3 * k + np.arange(3), np.arange(3)] = bad
    for shape in SHAPES:
        _, valid = Runner(program, layout, shape)(x)
        np.testing.assert_array_equal(valid, (np.arange(16) >= 9) & (name != "large constants"))


@pytest.mark.parametrize(
    "also", [lambda p: [], lambda p: [2.0 - p], lambda p: [1.0 / p]], ids=["alone", "in a sum", "in a quotient"]
)
def test_a_result_that_overflows_is_found(also: Callable[[Any], list[Any]]) -> None:
    """Whether its own check is left out, since a sum that reads it is checked, or not; a quotient by infinity is 0."""
    program, layout = program_of(lambda x, y: [x * y, *also(x * y)], 2)
    (_,), valid = Runner(program, layout, Shape(4, False))([[1e200, 1e200], [1.0, 1.0], [1e200, 1.0], [1e200, -1e200]])
    np.testing.assert_array_equal(valid, [False, True, True, False])


def test_a_ur5_needs_few_checks() -> None:
    """The first angle's: its axis is vertical, and neither M nor a torque depends on it; and two torques."""
    ur5 = sd.load_urdf("ur5")
    rnea, crba = (recording.record((variant(SPECS[name], ()),), ur5.bodies) for name in ("rnea", "crba"))
    (inputs, results), torques = finite.implied(*rnea), {line for line, _ in rnea.program.outputs}
    assert inputs == frozenset(range(1, 18))
    assert len(results) == 4
    assert results < torques
    assert finite.implied(*crba) == (frozenset(range(1, 6)), frozenset())
    assert finite.bounded(crba.program)
    assert not finite.bounded(rnea.program)
    assert not finite.bounded(recording.record((SPECS["crba"],), sd.load_urdf("panda").bodies).program)  # its fingers
