"""The table of algorithms: each recursion, what it computes, its source and its file, out of the Specs."""

from __future__ import annotations

from collections.abc import Iterator

from ..recursions import SPECS
from ..recursions.spec import Spec


def page() -> str:
    """The page, a section for each folder of recursions."""
    folders: dict[str, list[Spec]] = {}
    for spec in SPECS.values():
        folders.setdefault(_home(spec).rpartition("/")[0], []).append(spec)
    lines = [
        "# The table of algorithms", "",
        f"{len(SPECS)} algorithms are calls over the table of bodies. Each is one function, in the file that is named; "
        "its source is the text that it follows line by line. \"After\" says that it is a derivation of our own that "
        "starts there. Those over constraints, contacts, friction and control laws are named in the docstrings of "
        "their calls.", "",
    ]  # fmt: skip
    for folder, specs in sorted(folders.items()):
        lines += [f"## {folder.rpartition('/')[2].capitalize()}", "", "| call | what it computes | source | file |"]
        lines += ["|---|---|---|---|", *(_row(x) for x in sorted(specs, key=lambda x: x.name)), ""]
    return "\n".join(lines)


def _row(spec: Spec) -> str:
    what = spec.summary.partition("\n")[0].replace("``", "`").replace("|", "\\|")
    return f"| `sd.{spec.name}` | {what} | {spec.source.rstrip('.')} | `{_home(spec)}` |"


def _home(spec: Spec) -> str:
    """The file of a Spec, below ``spatialdyn``."""
    return "/".join(str(spec.recursion.__module__).split(".")[1:]) + ".py"


def sources() -> Iterator[str]:
    """Sources that are cited, once each."""
    yield from sorted({x.source for x in SPECS.values()})
