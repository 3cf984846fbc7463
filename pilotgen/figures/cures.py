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
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = 4


@style.styled
def each_alone(content: Mapping[str, Any]) -> Figure:
    """Gain margin over the amount of every cure, worst and nominal pilot; the limit dotted.

    Friction has an axis of its own: its margins are of swings of one size.
    """
    import matplotlib.pyplot as plt

    rows = content["cures"]
    high = math.ceil(len(rows) / _COLUMNS)
    figure, grid = plt.subplots(
        high, _COLUMNS, figsize=(style.PAGE_WIDTH_IN, 1.9 * high), squeeze=False, layout="constrained"
    )
    limit = content["limits"].get("gain_margin_db")
    linear = []
    for place, (axes, row) in enumerate(zip(grid.ravel(), rows, strict=False)):
        for name, color in (("worst", style.VERMILLION), ("nominal", style.BLUE)):
            gain = np.array(row["margins"][name]["gain_margin_db"], dtype=float)
            axes.plot(row["amounts"], gain, ".-", color=color, label=f"{name} pilot")
        if limit is not None:
            axes.axhline(limit, color=style.BLACK, linestyle=":", linewidth=1.0)
        axes.set_title(row["label"] + ("" if row["remedy"] else " *"), fontsize=8.0)
        swings = f", in swings of {content['swing_mm']:g} mm" if row["by_name"] else ""
        axes.set_xlabel(row["unit"].split(",")[0] + swings, fontsize=7.0)
        if not row["by_name"]:
            linear.append(axes)
            axes.tick_params(labelleft=place % _COLUMNS == 0)
        if row["by_name"] or place % _COLUMNS == 0:
            axes.set_ylabel("gain margin [dB]")
    for axes in grid.ravel()[len(rows) :]:
        axes.set_visible(False)
    ends = [axes.get_ylim() for axes in linear]
    for axes in linear:
        axes.set_ylim(min(low for low, _ in ends), max(high for _, high in ends))
    grid[0, 0].legend(loc="best", fontsize=7.0)
    return figure


@style.styled
def cure_map(content: Mapping[str, Any], pair: tuple[str, str]) -> Figure:
    """Gain and phase margin over two cures, a row for each pilot, with the lines of the limits.

    Where no loop reaches |L| = 1 there is no phase margin, and the modulus margin takes its place. Crosses: pilots
    that could not be evaluated.
    """
    import matplotlib.pyplot as plt

    maps = [found for found in content["maps"] if (found["x"]["key"], found["y"]["key"]) == pair]
    figure, grid = plt.subplots(
        len(maps),
        2,
        figsize=(style.PAGE_WIDTH_IN, 0.4 + 2.9 * len(maps)),
        sharex=True,
        sharey=True,
        squeeze=False,
        layout="constrained",
    )
    for row, found in zip(grid, maps, strict=True):
        x, y = (np.array(found[side]["amounts"]) for side in ("x", "y"))
        stable = np.array([[np.nan if one is None else one for one in line] for line in found["margins"]["stable"]])
        phases = np.array(found["margins"]["phase_margin_deg"], dtype=float)
        shown = ("gain_margin_db", "phase_margin_deg" if np.isfinite(phases).any() else "modulus_margin")
        for axes, key in zip(row, shown, strict=True):
            values = np.array(found["margins"][key], dtype=float)
            _filled(axes, x, y, values, OBJECTIVES[key].heading)
            limit = content["limits"].get(key)
            if limit is not None:
                # a loop without a crossing keeps the limit if it is stable, by as much as anybody wants
                signed = np.where(np.isnan(values), np.where(stable == 0.0, -np.inf, np.inf), values)
                near = np.clip(signed - limit, -limit, limit)
                near[np.isnan(stable)] = np.nan
                if np.nanmin(near) < 0.0 < np.nanmax(near):
                    masked = np.ma.masked_invalid(near)
                    lines = axes.contour(x, y, masked, levels=[0.0], colors=style.VERMILLION, linewidths=2.0)
                    axes.clabel(lines, fmt=lambda v, limit=limit: f"{v + limit:g}")
            j, i = np.nonzero(np.isnan(stable))
            axes.plot(x[i], y[j], "x", color=style.BLACK, markersize=4.0)
            white = " (white: |L| < 1)" if key == "phase_margin_deg" and np.isnan(values).any() else ""
            white = " (no phase margin: |L| < 1)" if key == "modulus_margin" else white
            axes.set_title(f"{found['pilot']} pilot: {OBJECTIVES[key].label}{white}", fontsize=9.0)
        row[0].set_ylabel(_axis(content, found["y"]), fontsize=8.0)
    for axes in grid[-1]:
        axes.set_xlabel(_axis(content, maps[-1]["x"]), fontsize=8.0)
    return figure


def _filled(axes: Axes, x: np.ndarray, y: np.ndarray, values: np.ndarray, heading: str) -> None:
    """Filled contours of values (len(y), len(x)) with their colour bar; nothing where there are no numbers."""
    if np.isfinite(values).any():
        filled = axes.contourf(x, y, np.ma.masked_invalid(values), levels=12, cmap="cividis")
        axes.figure.colorbar(filled, ax=axes, label=heading)


def _axis(content: Mapping[str, Any], side: Mapping[str, Any]) -> str:
    swings = f" in swings of {content['swing_mm']:g} mm" if side["key"] == "friction" else ""
    return f"{side['label']}{swings}\n[{side['unit']}]"
