"""Settings of Numba, read before and after it is imported."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numba
import numpy as np
import pytest
from inputs import run_python

from spatialdyn.engines.compiled import numba_settings
from spatialdyn.engines.compiled.numba_settings import is_jitted, setting


@numba.njit
def jitted(x: float) -> float:
    """Made by Numba."""
    return x


def test_settings_are_numbas_once_it_is_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "elsewhere")
    monkeypatch.setattr(numba.config, "CACHE_DIR", "here")
    assert setting("CACHE_DIR", "") == "here"


@pytest.mark.parametrize(
    ("value", "expected"), [(None, 0), ("1", 1), (" 0 ", 0), ("2", 2), ("", 0), ("yes", 0), ("1.5", 0)]
)
def test_settings_are_the_environments_before(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, value: str | None, expected: int
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "numba")
    monkeypatch.delenv("NUMBA_DISABLE_JIT", raising=False)
    if value is not None:
        monkeypatch.setenv("NUMBA_DISABLE_JIT", value)
    assert setting("DISABLE_JIT", 0) == expected


def test_a_file_of_settings_is_left_to_numba(tmp_path: Path) -> None:
    code = """
import os, sys, warnings
warnings.simplefilter("ignore")  # Numba warns if it cannot read the file
os.chdir(sys.argv[1])
import spatialdyn
print("numba" in sys.modules)
"""
    assert run_python(code, str(tmp_path)).strip() == "False"
    (tmp_path / numba_settings.CONFIG_FILE).write_text("")
    assert run_python(code, str(tmp_path)).strip() == "True"


@pytest.mark.parametrize(("name", "function"), [("rnea", np.sin), ("lambda", lambda: 0), ("builtin", len)])
def test_other_functions_are_not_jitted(name: str, function: Callable[..., object]) -> None:
    assert not is_jitted(function)


@pytest.mark.skipif(numba_settings.PLAIN, reason="NUMBA_DISABLE_JIT: Numba makes no functions")
def test_functions_of_numba_are_jitted() -> None:
    assert is_jitted(jitted)


def test_no_function_is_jitted_before_numba_is_imported() -> None:
    code = """
import sys
from spatialdyn.engines.compiled.numba_settings import is_jitted
print(is_jitted(len), "numba" in sys.modules)
"""
    assert run_python(code).split() == ["False", "False"]
