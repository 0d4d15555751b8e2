"""Controls of a viser page: a slider for each freedom, or for the time of a motion; boxes for the layers shown."""

from __future__ import annotations

import threading
import time
import weakref
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calls.dynamics import calls
from ..model.model import Joint, Model
from .coordinates import UNITS, coordinates

Array = NDArray[np.float64]
SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "5")
FPS = 60.0  # pictures a second while a motion plays
SMOOTH = 1000  # steps of a slider


def weakly(method: Callable[..., Any]) -> Callable[..., None]:
    """A bound method that does not keep its object alive: the server holds the controls, and ends with the scene.

    A call after the object is gone does nothing.
    """
    found = weakref.WeakMethod(method)

    def call(*arguments: Any) -> None:
        alive = found()
        if alive is not None:
            alive(*arguments)

    return call


class Sliders:
    """A slider for each freedom: the coordinate itself, or the motion from neutral for joints of several.

    handles  (freedom, viser's handle) of each
    """

    def __init__(self, gui: Any, model: Model, q: Array, show: Callable[[Array], Any]) -> None:
        """``q`` (nq,) is shown at first; ``show`` is called with the new configuration when a user moves a slider."""
        self.model, self._show = model, show
        self.handles: list[tuple[int, Any]] = []
        labels = {x.column: x for x in coordinates(model, "v", model.nv)}
        angular, linear = UNITS["v"]
        has = {x.unit for x in labels.values()}
        title = ", ".join(["angles [rad]"] * (angular in has) + ["lengths [m]"] * (linear in has))
        u = self._displacement(q)
        with gui.add_folder(title or "no joint moves"):
            for joint in model.joints[1:]:
                if joint.mimic is not None:
                    continue
                for k in range(joint.nv):
                    at = joint.idx_v + k
                    low, high = slider_ends(model, joint, k)
                    value, label = float(np.clip(u[at], low, high)), labels[at].label.replace(" ω", " turn ").rstrip()
                    handle = gui.add_slider(label, low, high, (high - low) / SMOOTH, value)
                    handle.on_update(self.slid)
                    self.handles.append((at, handle))

    def slid(self, event: Any) -> None:
        """Show the configuration of the sliders, if a user moved one."""
        if event.client_id is None:  # set by ``follow``
            return
        u = np.zeros(self.model.nv)
        for at, handle in self.handles:
            u[at] = handle.value
        self._show(np.asarray(calls["integrate"](self.model, calls["neutral"](self.model), u)))

    def follow(self, q: Array) -> None:
        """Set the sliders to a configuration (nq,)."""
        u = self._displacement(q)
        for at, handle in self.handles:
            handle.value = float(np.clip(u[at], handle.min, handle.max))

    def _displacement(self, q: Array) -> Array:
        """The motion (nv,) that takes the neutral configuration to another."""
        return np.asarray(calls["difference"](self.model, calls["neutral"](self.model), q))


def slider_ends(model: Model, joint: Joint, k: int) -> tuple[float, float]:
    """The ends of the slider of a joint's freedom: its limits, else π or 1 m to both sides."""
    slides = joint.kind == "prismatic" or (joint.kind in ("floating",) and k < 3) or (joint.kind == "planar" and k < 2)
    reach = 1.0 if slides else np.pi
    low, high = -reach, reach
    if joint.nq == 1:
        lower, upper = float(model.lower[joint.idx_q]), float(model.upper[joint.idx_q])
        low = lower if np.isfinite(lower) else min(low, upper - reach)
        high = upper if np.isfinite(upper) else max(high, lower + reach)
    return (low, high) if high > low else (low - 1e-6, low + 1e-6)


class Player:
    """A slider of the time, a button that plays, and a speed."""

    def __init__(self, gui: Any, t: Array, show: Callable[[int], Any]) -> None:
        """``t`` (N,) are the times of the motion [s], the first 0; ``show`` is called with the index of one of them."""
        self.t, self._show, self._playing = t, show, threading.Event()
        end = max(float(t[-1]), 1e-9)
        self._now = gui.add_slider("time [s]", 0.0, end, end / SMOOTH, 0.0)
        self._speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
        self._now.on_update(self._slid)
        gui.add_button("play / pause").on_click(self._pressed)

    def stop(self) -> None:
        """Stop playing."""
        self._playing.clear()

    def _show_now(self) -> None:
        self._show(int(np.argmin(abs(self.t - self._now.value))))

    def _slid(self, event: Any) -> None:
        if event.client_id is not None:  # by a user
            self._show_now()

    def _pressed(self, event: Any) -> None:
        if self._playing.is_set():
            self._playing.clear()
        else:
            self._playing.set()
            threading.Thread(target=self._play, daemon=True).start()

    def _play(self) -> None:
        end = float(self.t[-1])
        now = 0.0 if self._now.value >= end else float(self._now.value)
        while self._playing.is_set() and now < end:
            begun = time.monotonic()
            time.sleep(1.0 / FPS)
            now = min(now + float(self._speed.value) * (time.monotonic() - begun), end)
            self._now.value = now
            self._show_now()
        self._playing.clear()


def add_layers(gui: Any, layers: Sequence[str], shown: Sequence[str], switch: Callable[[str, bool], None]) -> None:
    """A box for each layer, ticked for those shown; ``switch`` is called with its name and whether it is ticked."""
    with gui.add_folder("show", expand_by_default=False):
        for layer in layers:
            box = gui.add_checkbox(layer, initial_value=layer in shown)
            box.on_update(lambda event, layer=layer: switch(layer, event.target.value))
