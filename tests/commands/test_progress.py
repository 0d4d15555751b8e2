"""Progress of commands on stderr: at once in a terminal, else nothing."""

from __future__ import annotations

import io
import sys
from typing import Any

import pytest

from spatialdyn.commands import cli, entry, printing

RICH = ("rich", "rich.console", "rich.progress")


class Terminal(io.StringIO):
    """A stderr that is a terminal."""

    def isatty(self) -> bool:
        return True


def as_terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """Have stderr be a terminal, to the end of the test; not in a fixture, after which pytest sets stderr again."""
    made = Terminal()
    monkeypatch.setattr(sys, "stderr", made)
    return made


def test_a_line_without_rich_begins_at_once_and_is_erased(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = as_terminal(monkeypatch)
    for name in RICH:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr(printing, "LINE_SECONDS", 0.0)
    with printing.shown("compiling", "calls") as report:
        assert terminal.getvalue() == "\rcompiling"
        report(11, 70)
        report(70, 70)
    lines = terminal.getvalue().split("\r")
    assert lines[1:4] == ["compiling", "compiling 12 of 70 calls", "compiling 70 of 70 calls"]
    assert lines[4].strip() == "" == lines[5]
    assert len(lines[4]) == len(lines[3])


def test_the_bar_of_rich_names_what_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = as_terminal(monkeypatch)
    pytest.importorskip("rich")
    with printing.shown("compiling", "calls") as report:
        report(11, 70)
    assert "compiling 12 of 70 calls" in terminal.getvalue()


@pytest.mark.parametrize("quiet", [True, False])
def test_quiet_and_no_terminal_show_nothing(quiet: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = as_terminal(monkeypatch)
    if not quiet:
        monkeypatch.setattr(terminal, "isatty", lambda: False)
    with printing.shown("compiling", "calls", quiet) as report:
        report(1, 2)
    with printing.progress(3, quiet) as begin:
        begin("panda")
    assert terminal.getvalue() == ""


def test_several_robots_have_a_line_without_rich(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = as_terminal(monkeypatch)
    for name in RICH:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr(printing, "LINE_SECONDS", 0.0)
    with printing.progress(2) as begin:
        begin("panda")
        begin("ur5")
    assert "comparing 2 of 2 robots" in terminal.getvalue()


@pytest.mark.parametrize(
    "command",
    [
        ("check", "two_link"),
        ("derive", "two_link", "--quantity", "g"),
        ("derive", "two_link", "--program", "--format", "c", "--quantity", "g"),
        ("simulate", "pendulum", "--duration", "0.01"),
        ("compile", "two_link", "--calls", "potential_energy"),
        ("trade", "two_link", "--task", "mass_matrix", "--states", "4", "--batch", "2"),
        ("compare", "two_link", "--calls", "rnea,crba", "--samples", "1", "--no-timing"),
    ],
    ids=lambda command: " ".join(command[:1]),
)
def test_commands_that_take_long_show_it_and_quiet_ones_do_not(
    command: tuple[str, ...], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = as_terminal(monkeypatch)
    needs = {"derive": "sympy", "trade": "mpmath", "compare": "pinocchio"}
    if command[0] in needs:
        pytest.importorskip(needs[command[0]])
    for name in RICH:
        monkeypatch.setitem(sys.modules, name, None)
    assert cli.main([*command, "--quiet"]) == 0
    assert terminal.getvalue() == ""
    quiet = capsys.readouterr().out
    assert cli.main([*command]) == 0
    assert terminal.getvalue().startswith("\r")
    assert terminal.getvalue().endswith("\r")
    shown = capsys.readouterr().out
    assert len(shown.splitlines()) == len(quiet.splitlines())
    assert "\r" not in shown


def test_compile_says_how_many_calls_it_compiled(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["compile", "two_link", "--calls", "crba,potential_energy"]) == 0
    assert capsys.readouterr().out.startswith("two_link: 2 calls are compiled, in ")
    assert cli.main(["compile", "two_link", "--calls", "crab"]) == 2
    assert "calls has 'crab', expected some of" in capsys.readouterr().err


def test_ctrl_c_leaves_the_process_at_once_in_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also while the commands are imported; other statuses return."""
    left: list[int] = []
    monkeypatch.setattr(entry, "leave", left.append)

    def stop(*words: Any, **named: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr("spatialdyn.commands.compile.compile_calls", stop)
    monkeypatch.setattr(sys, "argv", ["spatialdyn", "compile", "two_link"])
    entry.main()
    assert left == [130]
    assert capsys.readouterr() == ("", "spatialdyn: interrupted\n")
    monkeypatch.setattr(cli, "main", stop)
    entry.main()
    assert left == [130, 130]
    assert capsys.readouterr() == ("", "spatialdyn: interrupted\n")
    monkeypatch.setattr(cli, "main", lambda: 2)
    assert entry.main() == 2
    assert left == [130, 130]
