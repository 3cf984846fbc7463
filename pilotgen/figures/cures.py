"""Figures of cures.json: each cure alone, and the map of the two that buy most.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from pilotgen.figures import style
from pilotgen.objectives import OBJECTIVES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLUMNS = 4


@style.styled
def each_alone(content: Mapping[str, Any]) -> Figure:
    """Gain margin over the amount of every cure, worst and nominal pilot; the limit dotted."""
    import matplotlib.pyplot as plt

    rows = content["cures"]
    high = math.ceil(len(rows) / _COLUMNS)
    figure, grid = plt.subplots(
        high, _COLUMNS, figsize=(style.PAGE_WIDTH_IN, 1.9 * high), sharey=True, squeeze=False, layout="constrained"
    )
    limit = content["limits"].get("gain_margin_db")
    for axes, row in zip(grid.ravel(), rows, strict=False):
        for name, color in (("worst", style.VERMILLION), ("nominal", style.BLUE)):
            gain = np.array(row["margins"][name]["gain_margin_db"], dtype=float)
            axes.plot(row["amounts"], gain, ".-", color=color, label=f"{name} pilot")
        if limit is not None:
            axes.axhline(limit, color=style.BLACK, linestyle=":", linewidth=1.0)
        axes.set_title(row["label"] + ("" if row["remedy"] else " *"), fontsize=8.0)
        axes.set_xlabel(row["unit"].split(",")[0], fontsize=7.0)
    for axes in grid.ravel()[len(rows) :]:
        axes.set_visible(False)
    for axes in grid[:, 0]:
        axes.set_ylabel("gain margin [dB]")
    grid[0, 0].legend(loc="best", fontsize=7.0)
    return figure


@style.styled
def cure_map(content: Mapping[str, Any]) -> Figure:
    """Gain and phase margin of the worst pilot over two cures, with the lines of the limits.

    Where no loop reaches |L| = 1 there is no phase margin, and the modulus margin takes its place.
    """
    import matplotlib.pyplot as plt

    found = content["maps"][0]
    x, y = (np.array(found[side]["amounts"]) for side in ("x", "y"))
    phases = np.array(found["margins"]["phase_margin_deg"], dtype=float)
    shown = ("gain_margin_db", "phase_margin_deg" if np.isfinite(phases).any() else "modulus_margin")
    figure, grid = plt.subplots(1, 2, figsize=(style.PAGE_WIDTH_IN, 3.8), sharey=True, layout="constrained")
    for axes, key in zip(grid, shown, strict=True):
        values = np.array(found["margins"][key], dtype=float)
        limit = content["limits"].get(key)
        filled = axes.contourf(x, y, values, levels=12, cmap="cividis")
        figure.colorbar(filled, ax=axes, label=OBJECTIVES[key].heading)
        if limit is not None and np.nanmin(values) < limit < np.nanmax(values):
            lines = axes.contour(x, y, values, levels=[limit], colors=style.VERMILLION, linewidths=2.0)
            axes.clabel(lines, fmt=lambda v: f"{v:g}")
        axes.set_title(OBJECTIVES[key].label)
        axes.set_xlabel(f"{found['x']['label']} [{found['x']['unit']}]")
    grid[0].set_ylabel(f"{found['y']['label']} [{found['y']['unit']}]")
    return figure
