"""Docstrings as reStructuredText: tables of arguments as they stand, examples as code, the rest as prose."""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Iterator
from typing import Any

LITERAL = re.compile(r"(``.+?``)", re.DOTALL)
ALIGNED = re.compile(r"^ |\S {2,}\S", re.MULTILINE)  # columns, or an indented line: kept as they are


def paragraphs(thing: Any) -> list[str]:
    """The docstring of an object, by its empty lines; examples of a docstring are one paragraph."""
    text = inspect.getdoc(thing) or ""
    return [x for x in re.split(r"\n\s*\n", text) if x.strip()]


def summary(thing: Any) -> str:
    """The first paragraph in one line."""
    found = paragraphs(thing)
    return " ".join(found[0].split()) if found else ""


def escaped(text: str) -> str:
    """Prose whose characters mean nothing to reStructuredText, but for ``literals``."""
    parts = LITERAL.split(text)
    for k, part in enumerate(parts):
        if k % 2 == 0:
            parts[k] = re.sub(r"([\\*_`|])", r"\\\1", part)
        else:
            before, after = parts[k - 1], parts[k + 1]
            space = "\\ "
            parts[k] = (
                (space if re.search(r"[\w)]$", before) else "") + part + (space if re.match(r"\w", after) else "")
            )
    return "".join(parts)


def body(thing: Any) -> Iterator[str]:
    """Lines of reStructuredText for a docstring."""
    for paragraph in paragraphs(thing):
        if paragraph.startswith(">>>"):
            yield from ("", ".. code-block:: pycon", "", *textwrap.indent(paragraph, "   ").splitlines())
        elif ALIGNED.search(paragraph):
            yield from ("", ".. code-block:: text", "", *textwrap.indent(paragraph, "   ").splitlines())
        else:
            yield from ("", *escaped(paragraph).splitlines())
    yield ""


def parameters(thing: Any) -> str:
    """The parameters of a callable in parentheses, without annotations."""
    try:
        given = inspect.signature(thing).parameters.values()
    except (TypeError, ValueError):
        return "(...)"
    shown = []
    for x in given:
        plain = x.default is x.empty or isinstance(x.default, (bool, int, float, str, tuple, type(None)))
        shown.append(x.replace(annotation=x.empty, default=x.default if plain else ...))
    return str(inspect.Signature(shown)).replace("Ellipsis", "...")
