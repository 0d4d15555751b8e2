"""Functions made from source text, registered with ``linecache`` so that tracebacks show their lines."""

from __future__ import annotations

import itertools
import linecache
from collections.abc import Callable
from typing import Any


def function_from_text(name: str, lines: list[str], scope: dict[str, Any], label: str = "") -> Callable[..., Any]:
    """The function ``name`` that the lines define, with ``scope`` as its globals.

    label  gives the file name ``<spatialdyn LABEL>``, numbered if another text has that name; ``name`` if empty
    """
    text = [f"{line}\n" for line in lines]
    file = _registered(label or name, text)
    exec(compile("".join(text), file, "exec"), scope)
    function: Callable[..., Any] = scope[name]
    return function


def _registered(label: str, text: list[str]) -> str:
    """Register the text with ``linecache``; returns its file name.

    ``linecache`` does not look on disk for an entry without a modification time.
    """
    cache: dict[str, Any] = linecache.cache
    for k in itertools.count(1):
        file = f"<spatialdyn {label}>" if k == 1 else f"<spatialdyn {label} {k}>"
        entry = (sum(map(len, text)), None, text, file)
        if cache.setdefault(file, entry)[2] == text:
            return file
    raise AssertionError
