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
COLOURS = 256  # of a figure, chosen so that none is off by more than 14 of 255: a third of the size


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
    return Still(base64.b64encode(smaller(png(figure))).decode("ascii"), width_px, alt, caption)


def smaller(data: bytes) -> bytes:
    """The same PNG with a palette; as it is if that is no smaller."""
    from PIL import Image  # comes with matplotlib

    found = io.BytesIO()
    with Image.open(io.BytesIO(data)) as picture:
        picture.convert("RGB").quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(
            found, "PNG", optimize=True
        )
    return min(found.getvalue(), data, key=len)
