"""The gallery as pages: each example with what one learns, its picture, its time and its source."""

from __future__ import annotations

import ast
import inspect
import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from ..examples import gallery

HOME = Path(__file__).parent
PICTURES = HOME / "pictures" / "gallery"


@cache
def times() -> dict[str, Any]:
    """What ``benchmarks/gallery.py`` found: the machine, and the processor time of each example."""
    found: dict[str, Any] = json.loads((HOME / "gallery.json").read_text(encoding="utf-8"))
    return found


def picture(name: str) -> str | None:
    """The file name of an example's picture; None if it has none."""
    return f"{name}.png" if (PICTURES / f"{name}.png").exists() else None


def seconds(name: str) -> str:
    """Its time in words."""
    found = times()["examples"].get(name)
    return "" if found is None else f"{found['seconds']:.1f} s" + (", quick" if found["quick"] else "")


def index() -> str:
    """The page of all examples, with small pictures."""
    machine = times()["machine"]
    lines = [
        "# Gallery", "",
        "`spatialdyn example NAME` runs one of these programs, `--source` prints it, `--save FILE` writes its picture. "
        "Times are processor seconds of the whole process, with compiled code on disk already, on a machine that did "
        f"other work too ({machine['processor']}, {machine['cores']} cores, {machine['system']}, Python "
        f"{machine['python']}, Numba {machine['numba']}); \"quick\" is `--quick`, where an example has that. "
        f"\"The chapter\" is {gallery.CHAPTER}.", "",
        '<div class="cards">',
    ]  # fmt: skip
    for name in gallery.names():
        shown = picture(name)
        image = (
            f'<img src="../_static/gallery/{shown}" alt="" loading="lazy">'
            if shown
            else f'<span class="none"><code>{name}</code></span>'
        )
        title = _html(gallery.title(name).rstrip("."))
        lines.append(f'<a class="card" href="{name}.html">{image}<b>{title}</b><small>{seconds(name)}</small></a>')
    lines += ["</div>", "", "```{toctree}", ":hidden:", "", *gallery.names(), "```", ""]
    return "\n".join(lines)


def page(name: str) -> str:
    """The page of an example."""
    module = gallery.module(name)
    title, _, rest = (inspect.getdoc(module) or "").partition("\n")
    head, _, more = title.rstrip(".").partition(": ")
    lines = [f"# {_plain(head)}", "", *([_plain(more[:1].upper() + more[1:]) + ".", ""] if more else [])]
    lines += _said(rest)
    if picture(name):
        lines += [f"![what the program draws](../_static/gallery/{name}.png)", ""]
    took = f" It takes {seconds(name)} of processor time with compiled code on disk." if seconds(name) else ""
    lines += [
        f"`spatialdyn example {name}` runs it.{took}",
        "",
        "```python",
        _code(module),
        "```",
        "",
    ]
    return "\n".join(lines)


def _code(module: ModuleType) -> str:
    """The source of an example behind its docstring, which the page has above."""
    source = inspect.getsource(module)
    at = ast.parse(source).body[0].end_lineno or 0
    return "\n".join(source.splitlines()[at:]).strip("\n")


def _said(text: str) -> Iterator[str]:
    """The rest of a docstring: "Learn", "Look at" and "Needs" as a list of their own."""
    for paragraph in re.split(r"\n\s*\n", text.strip("\n")):
        marked = re.split(r"^(Learn|Look at|Needs) {2,}", paragraph, flags=re.MULTILINE)
        if len(marked) > 1:
            for word, said in zip(marked[1::2], marked[2::2], strict=True):
                yield from (f"* **{word}:** {_plain(' '.join(said.split()))}",)
            yield ""
        else:
            yield from (_plain(" ".join(paragraph.split())), "")


def _plain(text: str) -> str:
    """Prose whose characters mean nothing to Markdown, but for ``literals``."""
    parts = re.split(r"(``.+?``)", text)
    return "".join(
        x.replace("``", "`") if k % 2 else re.sub(r"([\\*_`<>\[\]|])", r"\\\1", x) for k, x in enumerate(parts)
    )


def _html(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace("``", "")
