"""HTML of tables and lists. All text is escaped here."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from itertools import islice

PAGE_FILES = (".html", ".htm")  # endings of names
BORDER = "border-bottom:1px solid #8884;padding:1px 10px 1px 0;vertical-align:top;"


def table(headings: Sequence[str], rows: Iterable[Sequence[str]], numbers: Iterable[int] = (), most: int = 200) -> str:
    """A table; the columns ``numbers`` are aligned right, rows beyond ``most`` are only counted."""
    right = set(numbers)
    styles = [
        BORDER + ("text-align:right;white-space:pre" if k in right else "text-align:left;white-space:pre-wrap")
        for k in range(len(headings))
    ]
    every = iter(rows)
    shown = list(islice(every, most))
    left = sum(1 for _ in every)
    lines = [_row("th", headings, styles), *(_row("td", row, styles) for row in shown)]
    if left:
        lines.append(f'<tr><td colspan="{len(headings)}">… and {left} more</td></tr>')
    return _table(lines)


def _table(lines: Iterable[str]) -> str:
    return f'<table style="border-collapse:collapse;font-size:13px;margin:4px 0 10px">{"".join(lines)}</table>'


def _row(tag: str, cells: Sequence[str], styles: Sequence[str]) -> str:
    return (
        "<tr>"
        + "".join(f'<{tag} style="{s}">{escape(c)}</{tag}>' for c, s in zip(cells, styles, strict=True))
        + "</tr>"
    )


def facts(pairs: Mapping[str, str]) -> str:
    """A table of two columns, names and values; empty values are left out."""
    lines = [
        _row("td", pair, [BORDER + "text-align:left;color:#777", BORDER + "text-align:left"])
        for pair in pairs.items()
        if pair[1]
    ]
    return _table(lines)


def bullets(lines: Iterable[str], most: int = 100) -> str:
    """A list; lines beyond ``most`` are only counted."""
    every = list(lines)
    shown = [*every[:most], *[f"… and {len(every) - most} more"] * (len(every) > most)]
    return "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in shown) + "</ul>" if shown else ""


def folded(summary: str, inner: str, unfolded: bool = False) -> str:
    """HTML that a click on a summary shows or hides."""
    return f"<details{' open' * unfolded}><summary>{escape(summary)}</summary>{inner}</details>"


def block(*parts: str) -> str:
    """Parts one below the other."""
    return f"<div>{''.join(parts)}</div>"


def line(text: str) -> str:
    """A line of words."""
    return f"<div>{escape(text)}</div>"


def heading(text: str) -> str:
    """A line of words in bold."""
    return f"<div><b>{escape(text)}</b></div>"


def code(text: str) -> str:
    """Lines of code."""
    return f'<pre style="white-space:pre-wrap">{escape(text)}</pre>'
