"""A page in a real browser: that it opens without a network and shows the robot in its middle.

Chromium is taken from the system. Where there is none the test is skipped: it is the only one here that needs one.
"""

from __future__ import annotations

import io
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import spatialdyn as sd

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytest.importorskip("viser")
image = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
SOFTWARE = [
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--no-sandbox",
    "--disable-dev-shm-usage",
]
PATIENCE = 240.0  # seconds for a machine that draws slowly
SIZE = 320  # pixels: software draws each of them
NOTE = 180  # rows of them that viser's note of drawing by software takes, with an orange edge of its own


def picture(page: Any, drawn: Callable[[NDArray[np.int64]], Any]) -> NDArray[np.int64]:
    """The first screenshot in which a hundredth is ``drawn``, or the last that patience has; (SIZE, SIZE, 3).

    The page's own note has some orange pixels before the robot is there.
    """
    until, pixels = time.monotonic() + PATIENCE, None
    while time.monotonic() < until:
        try:
            shot = page.screenshot(timeout=1e3 * PATIENCE)
        except sync_api.Error:
            break
        pixels = np.asarray(image.open(io.BytesIO(shot)).convert("RGB")).astype(int)
        if np.mean(drawn(pixels)) > 0.01:
            break
        time.sleep(0.5)
    if pixels is None:
        pytest.skip(f"Chromium makes no picture within {PATIENCE:g} s here")
    return pixels


@pytest.mark.slow(quick="pictures/test_viewer.py::test_camera_sees_all")
@pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")
def test_a_page_shows_the_robot_in_its_middle_without_a_network(tmp_path: Path) -> None:
    visual = (
        "<visual><geometry><box size='0.6 0.6 1'/></geometry>"
        "<material name='orange'><color rgba='1 0.4 0 1'/></material></visual>"
    )
    text = f"<robot name='r'><link name='a'>{visual}</link></robot>"
    path = sd.view(sd.load_urdf(text), urdf=text, open=False).save(tmp_path / "page.html")
    with sync_api.sync_playwright() as play:
        try:
            browser = play.chromium.launch(executable_path=BROWSER, args=SOFTWARE, timeout=1e3 * PATIENCE)
        except sync_api.Error as error:
            pytest.skip(f"Chromium does not start here: {str(error)[:200]}")
        page = browser.new_page(viewport={"width": SIZE, "height": SIZE}, offline=True)
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.goto(path.as_uri(), wait_until="commit", timeout=1e3 * PATIENCE)
        seen = picture(page, lambda x: (x[..., 0] > x[..., 2] + 90) & (np.arange(SIZE)[:, None] > NOTE))
        browser.close()
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []
    orange = seen[..., 0] > seen[..., 2] + 60
    lower = orange[NOTE:]
    assert 0.05 < lower.mean() < 0.6
    rows, columns = np.nonzero(lower)
    assert abs(columns.mean() / SIZE - 0.5) < 0.08
    assert rows.min() == 0
    assert not lower[:, : SIZE // 8].any()
    assert not lower[-SIZE // 50 :].any()
    corner = seen[-SIZE // 10 :, : SIZE // 10]
    assert corner.mean() > 200.0  # the floor
