"""What notebooks show: names escaped, tables whole, figures without a magic command, a bar that moves and goes."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.accuracy.findings import Finding
from spatialdyn.accuracy.results import Option, Tradeoff
from spatialdyn.pictures import markup
from spatialdyn.pictures.progress_bar import in_notebook
from spatialdyn.validate.rows import Comparison, Row

EVIL = "<script>alert('&\"')</script>"
VOID = {"img", "meta", "br", "progress"}


class Page(HTMLParser):
    """HTML whose elements are counted and must close in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: list[str] = []
        self.words: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append(tag)
        self.attributes += attrs
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        """All words."""
        return " ".join(self.words)


@pytest.fixture(scope="module")
def evil() -> sd.Model:
    """A robot whose names are HTML."""
    builder = sd.ModelBuilder(EVIL)
    rod = (1.0, (0.0, 0.0, 0.5), np.diag([0.1, 0.1, 0.01]))
    builder.add_body(
        EVIL, None, "revolute", (0, 1, 0), None, rod, joint_name=f"j{EVIL}", limits=sd.JointLimits(0.5, 1.0, effort=2.0)
    )
    return builder.build()


def trajectory(model: sd.Model) -> sd.Trajectory:
    """Made-up numbers of a motion."""
    t = np.linspace(0.0, 1.0, 11)
    q = t[:, None] * np.ones(model.nv)
    return sd.Trajectory(t, q, 0.0 * q, 0.0 * q, 0.0 * q, 1.0 + 0.0 * t, "rk4", 0.1, model.name, model=model)


def shown(x: Any) -> Page:
    """An object's HTML, read."""
    return Page(x._repr_html_())


# --- models -------------------------------------------------------------------------------------------------


def test_a_model_is_a_tree_with_masses_and_limits(evil: sd.Model) -> None:
    page = shown(evil)
    assert "script" not in page.seen
    for word in (EVIL, f"j{EVIL}", "0.5 .. 1 rad", "2 N m"):
        assert word in page.words
    assert f"neutral is outside the limits: j{EVIL}: 0 is outside 0.5 .. 1 rad" in page.words


def test_a_long_robot_is_cut_and_counted() -> None:
    builder = sd.ModelBuilder("long")
    for k in range(100):
        builder.add_body(f"b{k:02d}", f"b{k - 1:02d}" if k else None, "fixed")
    page = shown(builder.build())
    assert page.seen.count("tr") == 1 + 60 + 1
    assert "… and 41 more" in page.words


# --- results ------------------------------------------------------------------------------------------------


def test_a_trajectory_shows_its_numbers_and_what_is_beyond(evil: sd.Model) -> None:
    page = shown(trajectory(evil))
    assert f"q j{EVIL}" in page.words
    assert "beyond 0.5 .. 1" in page.words
    assert "no torque acts" in page.words
    assert "script" not in page.seen
    empty = sd.Trajectory(*(np.zeros((0, *x)) for x in ((), (1,), (1,), (1,), (1,), ())), "rk4", 0.1, EVIL)
    assert EVIL in shown(empty).text


@pytest.mark.parametrize("record", [1, "last"])
def test_a_rollout_shows_quantiles_of_its_last_state(evil: sd.Model, record: Any) -> None:
    q = np.arange(101.0)[:, None, None] * np.ones((1, 5, 1))
    q[0] = np.nan
    found = sd.Rollout(q, q, np.arange(5.0), evil)
    if record == "last":
        found = sd.Rollout(q[:, -1], q[:, -1], np.array(4.0), evil)
    page = shown(found)
    assert "50.5" in page.words
    assert "at 4 s" in page.words
    assert "script" not in page.seen


def test_a_trade_and_a_recommendation_show_all_options() -> None:
    options = tuple(Option(f"{EVIL}{k}", f"sd.rnea({k})", 1e-9, 0.0, 1e-8, 5.0 + k, best=k == 0) for k in range(3))
    found = Tradeoff(EVIL, "inverse_dynamics", options, 4, 8, 0.0, 0.0, "truth")
    chosen = sd.Recommendation(options[0], "cheap; good", 1e-6, found)
    for x in (found, chosen):
        page = shown(x)
        assert "script" not in page.seen
        assert {f"sd.rnea({k})" for k in range(3)} <= set(page.words)
    assert "good" in shown(chosen).words


def test_simulations_cost_milliseconds_as_in_their_plot() -> None:
    options = (Option("rk4, dt 0.01", "sd.simulate()", 1e-9, 0.0, 1e-8, 2.5e6, best=True),)
    page = shown(Tradeoff("arm", "simulate", options, 4, 0, 1.0, 0.0, "truth"))
    assert {"ms of computing for a second of motion", "2.5"} <= set(page.words)


def test_a_diagnosis_shows_its_findings() -> None:
    found = sd.Diagnosis(
        EVIL, (Finding("warning", "mass ratio", EVIL, f"is {EVIL}", "remedy"),), {"neutral": 2.0},
        {"aba": {"float64": 14.0}}, None, {"rnea": {"single": 15.0, "batch": 15.5}}, 4,
    )  # fmt: skip
    page = shown(found)
    assert "script" not in page.seen
    for word in (f"{EVIL}: warning", f"is {EVIL}", "14.0", "15.5"):
        assert word in page.words
    assert "no findings" in shown(found._replace(findings=())).words


def test_a_comparison_shows_every_row_and_what_failed() -> None:
    rows = (Row("rnea", 1e-16, 1e-13, True, "", 1.0, 2.0), Row("aba", None, 1e-13, False, EVIL))
    page = shown(Comparison(EVIL, "fixed", 1, 1, 5, rows))
    assert "script" not in page.seen
    for word in ("1.0e-16", "0.50", EVIL, "beyond its bound: aba"):
        assert word in page.words
    untimed = Page(Comparison("arm", "fixed", 1, 1, 5, rows[1:])._repr_html_())
    assert "ratio" not in untimed.words


def test_symbols_show_their_meaning_and_M() -> None:
    pytest.importorskip("sympy")
    s = sd.SymbolicManipulator("two_link", ["mass"])
    page = shown(s)
    assert "m_1" in page.words
    assert page.text.count("$$") == 2
    assert r"\cos" in page.text


def test_columns_and_rows_must_agree() -> None:
    with pytest.raises(ValueError, match="zip"):
        markup.table(("a", "b"), [["1"]])


# --- in a notebook ------------------------------------------------------------------------------------------


@pytest.fixture
def shell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A shell as a kernel has one: ``shell.display_pub.outputs`` is what a notebook would show."""
    pytest.importorskip("IPython")
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # deprecations inside IPython
        from IPython.core.displaypub import CapturingDisplayPublisher
        from IPython.core.history import HistoryManager
        from IPython.core.interactiveshell import InteractiveShell

        monkeypatch.setattr(HistoryManager, "enabled", False)
        made = InteractiveShell.instance(display_pub_class=CapturingDisplayPublisher)
        made.kernel = None  # type: ignore[attr-defined]
        hook = sys.excepthook
        yield made
        sys.excepthook = hook
        InteractiveShell.clear_instance()


def test_no_shell_is_no_notebook(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not in_notebook()
    monkeypatch.delitem(sys.modules, "IPython", raising=False)
    assert not in_notebook()
    assert "IPython" not in sys.modules


def test_a_notebook_shows_models_figures_and_progress(shell: Any) -> None:
    """The cells of a notebook, run as a kernel runs them."""
    pytest.importorskip("matplotlib")
    formatted = shell.display_formatter.format
    cell = shell.run_cell("import spatialdyn as sd\nmodel = sd.load_urdf('two_link')\nmodel", silent=False)
    assert cell.success
    assert "text/html" in formatted(cell.result)[0]
    figure = trajectory(cell.result).plot("q")
    data, about = formatted(figure)
    assert data["image/png"].startswith(b"\x89PNG")
    assert about["image/png"]["width"] > 100
    assert in_notebook()
    code = "from spatialdyn.pictures import progress_bar\nprogress_bar.PAUSE = -1.0\n"
    code += "with progress_bar.progress_bar('sim') as report:\n    report(1, 4)\n    report(3, 4)\n"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        done = shell.run_cell(code)
    sys.modules["spatialdyn.pictures.progress_bar"].PAUSE = 0.1  # type: ignore[attr-defined]
    assert done.success
    bars = [output["data"]["text/html"] for output in shell.display_pub.outputs]
    assert "25%, 1 of 4 steps" in bars[-3]
    assert 'value="3" max="4"' in bars[-2]
    assert bars[-1] == ""


CELLS = (
    "import spatialdyn as sd\nsd.load_urdf('two_link')",
    "import numpy as np\nrun = sd.simulate(sd.load_urdf('pendulum'), [0.5], [0.0], 0.5, 0.05, progress=True)\nrun",
    "run.plot('energy')",
    "sd.view(run)",
    "sd.view(run).play(speed=2.0)",
    "import sys\nprint('matplotlib.pyplot' in sys.modules)",
)


def test_a_notebook_is_executed_by_a_kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No magic command, no pyplot: HTML of results, a bar that goes, figures, players, each once."""
    client = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    for package in ("ipykernel", "matplotlib", "viser"):
        pytest.importorskip(package)
    for variable in ("IPYTHONDIR", "JUPYTER_RUNTIME_DIR", "JUPYTER_CONFIG_DIR"):
        monkeypatch.setenv(variable, str(tmp_path))
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(code) for code in CELLS])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # deprecations inside Jupyter
        client.NotebookClient(book, timeout=300, kernel_name="python3").execute()
    model, run, figure, view, play, last = (cell.outputs for cell in book.cells)
    assert [set(x.data) for x in model] == [{"text/plain", "text/html"}]
    bar, found = run
    assert bar.data["text/html"] == ""
    assert "trajectory of pendulum" in found.data["text/html"]
    assert set(figure[0].data) == {"text/plain", "image/png"}
    assert figure[0].metadata["image/png"]["width"] > 100
    assert [x.data["text/html"][:15] for x in view] == ["<iframe srcdoc="]
    assert [x.data.get("text/html", "")[:15] for x in play] == ["<iframe srcdoc=", ""]
    assert [x.text for x in last] == ["False\n"]
