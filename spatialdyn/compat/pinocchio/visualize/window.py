"""``MeshcatVisualizer.viewer``: a window of viser under MeshCat's names."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from ....pictures.stage import Stage, page_frame
from .meshcat_tree import Branch, DrawnRobot, Tree


class MeshcatWindow(Branch):
    """viser's ``server``, which shows a stage, and the root of its tree: ``viewer[path]`` is a Branch."""

    def __init__(self, server: Any, stage: Stage, robot: DrawnRobot) -> None:
        super().__init__(Tree(stage, robot))
        self.server, self._stage = server, stage

    @property
    def window(self) -> MeshcatWindow:
        """The window itself."""
        return self

    def url(self) -> str:
        """The address of the page."""
        return self._stage.url

    def open(self) -> MeshcatWindow:
        """Open a tab of the browser; returns the window."""
        self._stage.open_tab()
        return self

    def wait(self) -> None:
        """Return at once: what is drawn reaches browsers when they come."""

    def jupyter_cell(self, height: Any = 480) -> Any:
        """The page inside a notebook."""
        return import_module("IPython.display").HTML(page_frame(self.url(), height))

    render_static = jupyter_cell

    def static_html(self) -> str:
        """What is shown as one page without links."""
        return self._stage.html()

    def _repr_html_(self) -> str:
        return page_frame(self.url())
