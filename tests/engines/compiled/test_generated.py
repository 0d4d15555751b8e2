"""Functions made from text: a traceback shows their lines."""

from __future__ import annotations

import linecache
import pickle
import traceback
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.engines.compiled import numba_kernels
from spatialdyn.engines.compiled.generated import function_from_text


def frame_of(call: Callable[[], Any], file: str) -> traceback.FrameSummary:
    """The innermost frame in that file of the error that a call raises."""
    with pytest.raises(sd.SpatialDynError) as caught:
        call()
    *_, found = [frame for frame in traceback.extract_tb(caught.value.__traceback__) if frame.filename == file]
    return found


@pytest.fixture(scope="module")
def arm() -> sd.Model:
    return sd.load_urdf("two_link")


def test_a_traceback_shows_the_line_of_a_public_call(arm: sd.Model) -> None:
    frame = frame_of(lambda: sd.rnea(arm, [0.0], [0.0], [0.0]), "<spatialdyn rnea>")
    assert frame.name == "rnea"
    assert frame.line == "return checked_call(spec, model, (q, v, a, fext, ), (), out, ())"


def test_a_traceback_shows_the_line_of_a_kernel_that_runs_as_python() -> None:
    divide = numba_kernels.kernel_from_text("divided", ["x"], ["stamp", "return 1 // x"], {})
    with pytest.raises(ZeroDivisionError) as caught:
        divide(0)
    assert traceback.extract_tb(caught.value.__traceback__)[-1].line == "return 1 // x"


def test_a_text_has_one_name_and_a_name_one_text() -> None:
    one, again, other = (
        function_from_text("f", ["def f():", f"    raise {error}"], {}, "test names").__code__.co_filename
        for error in ("KeyError", "KeyError", "ValueError")
    )
    assert one == again == "<spatialdyn test names>"
    assert other == "<spatialdyn test names 2>"
    assert linecache.getline(one, 2) == "    raise KeyError\n"
    assert linecache.getline(other, 2) == "    raise ValueError\n"
    linecache.checkcache()
    assert linecache.getline(other, 2) == "    raise ValueError\n"


def test_nothing_of_a_urdf_is_in_the_name_of_a_file() -> None:
    builder = sd.ModelBuilder("secret").add_body(
        "secret_link", inertia=(1.0, (0.1, 0, 0), np.eye(3)), joint_name="secret_joint"
    )
    call = sd.specialize(builder.build(), sd.rnea, inputs=["mass:secret_joint", "payload:secret_link"])
    call(*(np.zeros(1) for _ in range(3)), 1.0, np.zeros(10))
    names = [name for name in linecache.cache if name.startswith("<spatialdyn")]
    assert names
    assert not [name for name in names if "secret" in name]


def test_generated_calls_are_pickled_by_name() -> None:
    assert pickle.loads(pickle.dumps(sd.rnea)) is sd.rnea
