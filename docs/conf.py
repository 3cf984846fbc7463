"""Sphinx configuration of the documentation site (`make docs`).

Pages are the Markdown files of docs/. Reference pages of commands, Python interface and study keys are made from the
code while the site is built, into docs/reference/generated/.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS.parent))
sys.path.insert(0, str(DOCS))

from reference_pages import write_reference_pages  # noqa: E402

import pilotgen  # noqa: E402

project = "pilotgen"
author = "pilotgen developers"
version = release = pilotgen.__version__
copyright = "pilotgen developers, BSD 3-Clause"

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".rst": "restructuredtext", ".md": "myst-nb", ".ipynb": "myst-nb"}
exclude_patterns = ["_build"]
root_doc = "contents"

# ---- Markdown
myst_enable_extensions = ["attrs_inline"]
myst_heading_anchors = 4
# Decks, YAML and terminal text are shown as they are; attributes of one name in two classes need no link.
suppress_warnings = ["misc.highlighting_failure", "ref.python"]

# ---- notebooks: run while the site is built, an error in a cell is an error of the build
nb_execution_mode = "cache"
nb_execution_cache_path = str(DOCS.parent / "build" / "notebooks")
nb_execution_raise_on_error = True
nb_execution_timeout = 300

# ---- Python
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_numpy_docstring = True

# ---- pages without network: no fonts, scripts or badges from elsewhere
html_theme = "furo"
html_title = f"pilotgen {version}"
html_static_path: list[str] = []
html_copy_source = False
html_show_sphinx = False
nitpicky = False

write_reference_pages(DOCS / "reference" / "generated")


def links_that_leave_docs(app: Any, page: str, source: list[str]) -> None:
    """Let links to pages outside of docs/ lead to their copies on the site; on disk they lead to the files."""
    up = "../" * page.count("/")
    source[0] = source[0].replace(f"]({up}../templates/README.md", f"]({up}reference/generated/templates.md")


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("source-read", links_that_leave_docs)
