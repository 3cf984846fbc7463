"""Style sheet, scripts and libraries, as text for the page.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING

from pilotgen.errors import PilotgenError

if TYPE_CHECKING:
    import jinja2

DATA = Path(__file__).parent.parent / "data"
VENDOR, OWN = DATA / "vendor", DATA / "report"
SCRIPTS = (
    "decode.js", "model.js", "state.js", "look.js", "tip.js", "chart.js", "clouds.js", "responses.js", "figure.js",
    "tables.js", "decks.js", "main.js",
)  # fmt: skip
_LICENSES = {"uPlot": "LICENSE-uPlot", "three": "LICENSE-three"}


@functools.cache
def template(name: str) -> jinja2.Template:
    """A page's template, by its file below `pilotgen/data`."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(DATA), autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    return environment.get_template(name)


@functools.cache
def style_text() -> str:
    """The page's style sheet, uPlot's before it."""
    return _plain(VENDOR / "uPlot.min.css") + "\n" + _plain(OWN / "page.css")


@functools.cache
def script_texts(solid: bool) -> tuple[str, ...]:
    """Scripts in their order, libraries with their licences first; without three.js where nothing is drawn in 3-D."""
    libraries = [("uPlot", "uPlot.iife.min.js"), *([("three", "three.min.js")] if solid else [])]
    texts = [f"/*!\n{_plain(VENDOR / _LICENSES[name])}*/\n{_plain(VENDOR / file)}" for name, file in libraries]
    own = [name for name in SCRIPTS if solid or name != "figure.js"]
    return (*texts, "\n".join(_plain(OWN / name) for name in own))


@functools.cache
def comparison_scripts() -> tuple[str, ...]:
    """Scripts of the page that compares two studies."""
    library = f"/*!\n{_plain(VENDOR / _LICENSES['uPlot'])}*/\n{_plain(VENDOR / 'uPlot.iife.min.js')}"
    own = ("decode.js", "state.js", "look.js", "tip.js", "chart.js", "comparison.js")
    return (library, "\n".join(_plain(OWN / name) for name in own))


def _plain(path: Path) -> str:
    """A text that may stand in an element of a page."""
    text = path.read_text(encoding="utf-8")
    if "</script" in text.lower() or "</style" in text.lower():
        raise PilotgenError(
            f"{path}: would end the element that it stands in; the package is damaged, install it again"
        )
    return text
