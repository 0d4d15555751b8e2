"""The site: all pages in one folder, built by Sphinx. It needs no network, neither to be built nor to be read."""

from __future__ import annotations

import re
import shutil
import tempfile
from importlib.util import find_spec
from pathlib import Path

import spatialdyn as sd

from ..errors import SpatialDynError, pip_install
from ..examples import gallery
from . import algorithms, gallery_pages, public_names
from .blocks import pages, read

HOME = Path(__file__).parent
NEEDED = ("sphinx", "myst_parser", "furo")
SETTINGS = f"""
project = "spatialdyn"
release = version = "{sd.__version__}"
extensions = ["myst_parser"]
myst_heading_anchors = 3
nitpicky = True
html_theme = "furo"
html_title = "spatialdyn {sd.__version__}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_copyright = False
pygments_style = "default"
pygments_dark_style = "github-dark"
python_maximum_signature_line_length = 100
python_display_short_literal_types = True
add_module_names = False
toc_object_entries = False
"""
FENCED = re.compile(r"(^```.*?^```$)", re.MULTILINE | re.DOTALL)
NAMED = re.compile(r"(?<![`\w\[])`sd\.(\w+)(\([^`]*\))?`")


def sources(folder: Path) -> None:
    """Write all that Sphinx reads into a folder: settings, pages, pictures."""
    (folder / "conf.py").write_text(SETTINGS, encoding="utf-8")
    texts = {f"{name}.md": linked(read(name)) for name in pages()}
    texts["notation/algorithms.md"] = linked(algorithms.page())
    texts["api/index.rst"] = public_names.index()
    texts |= {f"api/{name}.rst": public_names.page(name) for name in public_names.GROUPS}
    texts["gallery/index.md"] = gallery_pages.index()
    texts |= {f"gallery/{name}.md": gallery_pages.page(name) for name in gallery.names()}
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    shutil.copytree(HOME / "static", folder / "_static")
    shutil.copytree(HOME / "pictures", folder / "_static", dirs_exist_ok=True)


def linked(text: str) -> str:
    """A page on which ``sd.NAME`` in backticks leads to that name's entry; code blocks stay as they are."""
    where = public_names.page_of()

    def link(found: re.Match[str]) -> str:
        name, call = found[1], found[2] or ""
        return f"{{py:obj}}`sd.{name}{call} <spatialdyn.{name}>`" if name in where else found[0]

    parts = FENCED.split(text)
    return "".join(part if k % 2 else NAMED.sub(link, part) for k, part in enumerate(parts))


def build(output: str | Path) -> Path:
    """Build the site into a folder and return its first page.

    Raises  SpatialDynError where a package is missing, and with Sphinx's lines for any warning
    """
    for package in NEEDED:
        if find_spec(package) is None:
            raise SpatialDynError(f"{package} is not installed; {pip_install('docs')}")
    import io

    from sphinx.application import Sphinx
    from sphinx.util.docutils import docutils_namespace, patch_docutils

    warned = io.StringIO()
    with tempfile.TemporaryDirectory() as made, patch_docutils(), docutils_namespace():
        sources(Path(made))
        app = Sphinx(made, made, str(output), f"{made}/.doctrees", "html", status=None, warning=warned, freshenv=True)
        app.build(force_all=True)
    text = re.sub(r"\x1b\[[\d;]*m", "", warned.getvalue()).replace(made, "pages")
    if text.strip():
        raise SpatialDynError(f"the site has warnings, expected none:\n{text.rstrip()}")
    return Path(output) / "index.html"
