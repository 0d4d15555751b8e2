"""Seconds to write 5 s of a panda's motion, 60 frames a second, into one page: ``sd.view(trajectory).save(...)``.

``python benchmarks/pictures.py`` prints wall and CPU seconds of the first page of the process, once all is imported,
and of a second one. It asserts that the motion has all frames and that the page links to nothing.
"""

from __future__ import annotations

import argparse
import re
import tempfile
import time
from pathlib import Path

import numpy as np

import spatialdyn as sd

SECONDS, FRAMES = 5, 60
LINK = r'<(?:script|link|img|iframe)[^>]*(?:src|href)="?(?:https?:)?//'


def main() -> None:
    """Check, measure, print."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    model = sd.load_urdf("panda")
    rest, start = np.zeros(model.nv), sd.random_configuration(model, 0)
    run = sd.simulate(sd.Scene(model, friction=False), start, rest, SECONDS, 1.0 / (4 * FRAMES), record=4)
    assert len(run.t) == SECONDS * FRAMES + 1
    import viser  # noqa: F401  what is timed is the page

    with tempfile.TemporaryDirectory() as folder:
        for page in ("first", "second"):
            wall, cpu = time.perf_counter(), time.process_time()
            path = sd.view(run).save(Path(folder) / f"{page}.html", fps=FRAMES)
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            text = path.read_text(encoding="utf-8")
            assert "__VISER_EMBED_DATA__" in text
            assert not re.search(LINK, text)
            print(f"{page} page: {wall:.2f} s wall, {cpu:.2f} s of CPU, {len(text) / 1e6:.1f} MB, {len(run.t)} frames")


if __name__ == "__main__":
    main()
