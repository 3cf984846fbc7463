"""Numbers and text inside a page: compact, and nothing in them that a browser could take for markup.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import base64
import gzip
import json
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

SHORT_ERROR = 2.0**-29  # largest relative error of a number packed in five bytes


def pack_short(values: ArrayLike) -> str:
    """Doubles cut to five bytes, rounded (relative error 2e-9), big-endian, base64; any shape, row by row.

    Infinities and NaN stay what they are.
    """
    bits = np.ascontiguousarray(values, dtype=">f8").reshape(-1).view(">u8").astype(np.uint64)
    finite = np.isfinite(np.asarray(values, dtype=float).reshape(-1))
    bits = np.where(finite, bits + np.uint64(1 << 23), bits)
    data = bits.astype(">u8").view(np.uint8).reshape(-1, 8)[:, :5]
    return base64.b64encode(np.ascontiguousarray(data).tobytes()).decode("ascii")


def pack_wide(values: ArrayLike) -> str:
    """Doubles as they are, little-endian, base64; any shape, row by row."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode("ascii")


def pack_floats(values: ArrayLike) -> str:
    """Single precision, little-endian, base64, any shape: for what is drawn, not read."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")


def pack_levels(values: ArrayLike) -> tuple[str, float]:
    """Sixteen-bit integers, base64, and what one of them stands for; any shape, row by row."""
    array = np.asarray(values, dtype=float)
    largest = float(np.abs(array).max(initial=0.0))
    step = largest / 32767.0 if largest > 0.0 else 1.0
    return base64.b64encode(np.ascontiguousarray(np.rint(array / step), dtype="<i2").tobytes()).decode("ascii"), step


def pack_text(text: str) -> str:
    """A long text, compressed, base64; the same text gives the same bytes."""
    return base64.b64encode(gzip.compress(text.encode("utf-8"), 9, mtime=0)).decode("ascii")


def embedded(data: Any) -> str:
    """JSON for a script element: strict, and without characters that could end the element."""
    text = json.dumps(data, allow_nan=False, separators=(",", ":"), ensure_ascii=True)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")
