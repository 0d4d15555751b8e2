"""``spatialdyn run SCRIPT.py``: what ``python SCRIPT.py`` does, but that ``pinocchio`` is this library."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import spatialdyn
from spatialdyn.commands import cli

ROOT = str(Path(spatialdyn.__file__).parents[1])
STARTS = {"python": [], "run": ["-m", "spatialdyn", "run"]}


def start(how: str, *words: str, folder: Path) -> subprocess.Popen[str]:
    """A process that runs a script by Python alone, or by the command."""
    paths = [ROOT, *filter(None, [os.environ.get("PYTHONPATH")])]
    return subprocess.Popen(
        [sys.executable, *STARTS[how], *words], cwd=folder, text=True, stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
    )  # fmt: skip


def outcome(how: str, *words: str, folder: Path) -> tuple[int, str, str]:
    """Exit status, stdout and stderr of such a process."""
    process = start(how, *words, folder=folder)
    out, err = process.communicate()
    return process.returncode, out, err


SHOWS = '''
"""Its docstring."""
import sys, os, pickle, inspect
import beside
class Thing: pass
print(sys.argv, sys.path[0], __name__, __file__, __doc__, __package__, __spec__, __builtins__.__name__)
print(sys.modules["__main__"].__dict__ is globals(), pickle.loads(pickle.dumps(Thing())).__class__ is Thing)
print(inspect.getsource(Thing), beside.there, sorted(name for name in globals() if name[0] == "_"))
def annotated(x: Thing): pass
print(annotated.__annotations__["x"] is Thing)
'''


def test_a_script_sees_what_it_sees_under_python(tmp_path: Path) -> None:
    folder = tmp_path / "scripts"
    folder.mkdir()
    (folder / "shows.py").write_text(SHOWS)
    (folder / "beside.py").write_text("there = 1\n")
    words = ["scripts/shows.py", "--q0", "-1,2", "--", "view", "--help"]
    found, wanted = (outcome(how, *words, folder=tmp_path) for how in ("run", "python"))
    assert found == wanted
    assert found[0] == 0
    assert "['scripts/shows.py', '--q0', '-1,2', '--', 'view', '--help']" in found[1]


def test_pinocchio_is_this_library(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("import pinocchio as pin\nfrom pinocchio.utils import zero\nprint(pin.__name__)\n")
    assert outcome("run", "a.py", folder=tmp_path) == (0, "spatialdyn.compat.pinocchio\n", "")


ENDS = {
    "an error": "def f():\n    return 1 / 0\nf()\n",
    "an error of this library": "import spatialdyn\nspatialdyn.load_urdf('nowhere.urdf')\n",
    "a chain of errors": "try:\n    1 / 0\nexcept ZeroDivisionError as e:\n    raise KeyError('x') from e\n",
    "a syntax error": "x = 1\nif:\n",
    "an exit": "import atexit, sys\natexit.register(print, 'bye')\nsys.exit(3)\n",
    "an exit with words": "raise SystemExit('stopped')\n",
    "a hook": "import sys\nsys.excepthook = lambda kind, value, trace: print(kind, value)\nraise ValueError(3)\n",
    "latin": "# -*- coding: latin-1 -*-\nprint(len('\u00e9'))\n",
    "a thread": "import threading, time\nthreading.Thread(target=lambda: (time.sleep(0.2), print('late'))).start()\n",
}


@pytest.mark.parametrize("name", ENDS)
def test_a_script_ends_as_under_python(name: str, tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text(ENDS[name], encoding="latin-1")
    found, wanted = (outcome(how, "a.py", folder=tmp_path) for how in ("run", "python"))
    assert found == wanted


@pytest.mark.skipif(os.name == "nt", reason="no signals")
def test_ctrl_c_ends_a_script_with_its_traceback(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text(
        "import atexit, time\natexit.register(print, 'bye')\nprint('up', flush=True)\ntime.sleep(60)\n"
    )
    process = start("run", "a.py", folder=tmp_path)
    assert process.stdout is not None
    assert process.stdout.readline() == "up\n"
    time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate()
    assert (process.returncode, out) == (130, "bye\n")
    assert [line for line in err.splitlines() if "File" in line] == [
        f'  File "{tmp_path / "a.py"}", line 4, in <module>'
    ]
    assert err.rstrip().endswith("KeyboardInterrupt")


@pytest.mark.parametrize(("name", "reason"), [("none.py", "No such file or directory"), ("", "Is a directory")])
def test_what_is_no_script_is_named(name: str, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = str(tmp_path / name)
    assert cli.main(["run", given]) == 2
    shown = capsys.readouterr().err
    assert shown == f'spatialdyn: script "{given}": {reason}, expected a Python file\n'


def test_the_command_says_how_it_is_used(capsys: pytest.CaptureFixture[str]) -> None:
    for words, status in ((["run", "--help"], 0), (["run"], 2)):
        with pytest.raises(SystemExit) as ended:
            cli.main(words)
        assert ended.value.code == status
    out, err = capsys.readouterr()
    assert "SCRIPT" in out
    assert "SCRIPT" in err
