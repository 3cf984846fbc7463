"""Still figures of a page: pictures for print, and for browsers without scripts.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pilotgen.figures.style import png

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PIXELS_PER_INCH = 106  # CSS pixels: a figure of the page's width fills the page
COLOURS = 128  # of a figure: lines, letters and their soft edges need no more, and a page is to be small


@dataclass(frozen=True)
class Still:
    """A figure of the page."""

    data: str  # base64 of a PNG
    width_px: int  # on a screen; figures keep their letters at one size
    alt: str
    caption: str


def still(figure: Figure, alt: str, caption: str) -> Still:
    """Draw a figure; the same figure gives the same bytes."""
    width_px = round(PIXELS_PER_INCH * float(figure.get_size_inches()[0]))
    return Still(base64.b64encode(_smaller(png(figure))).decode("ascii"), width_px, alt, caption)


def _smaller(data: bytes) -> bytes:
    """The same picture with a palette."""
    from PIL import Image  # comes with matplotlib

    found = io.BytesIO()
    with Image.open(io.BytesIO(data)) as picture:
        picture.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(found, "PNG", optimize=True)
    return min(found.getvalue(), data, key=len)
