"""How one pilot's feedthrough, loop and margins spread over what is not known of him; drawn from uncertain.json.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pilotgen.figures import style
from pilotgen.figures.style import BLACK, BLUE, GREEN, GREY, LIGHT_GREY, VERMILLION
from pilotgen.objectives import OBJECTIVES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

OUTER, INNER = "#cfe3f2", "#9cc6e4"  # of 90 and of 50 % of the draws
NOMINAL: Any = {"color": BLACK, "linestyle": (0, (4, 2)), "linewidth": 1.2, "label": "as the study has him"}
ARC = 24  # points of an ellipse
LABELS_HZ = (2.0, 3.0, 4.0, 5.0, 7.0)


def draw_uncertain(content: Mapping[str, Any], directory: Path) -> None:
    """Write band-margins.png, and with bands band-bdft.png and band-nyquist.png.

    FileError if that fails.
    """
    if content["evaluated"]:
        style.save(margin_spread(content), directory / "band-margins.png")
    if content["bands"] is not None:
        style.save(bdft_band(content), directory / "band-bdft.png")
        style.save(nyquist_band(content), directory / "band-nyquist.png")


@style.styled
def bdft_band(content: Mapping[str, Any]) -> Figure:
    """Grip motion per seat acceleration: the pilot as the study has him, median and bands of the draws."""
    from matplotlib.ticker import FuncFormatter

    bands = content["bands"]
    f_hz, quantiles = np.array(bands["frequency_hz"]), bands["feedthrough"]
    figure = style.new_figure(3.9, 6.6)
    axes = figure.subplots()
    for low, high, color, text in (("0.05", "0.95", OUTER, "90 %"), ("0.25", "0.75", INNER, "half")):
        axes.fill_between(
            f_hz, quantiles[low], quantiles[high], color=color, linewidth=0, label=f"{text} of {_draws(content)}"
        )
    axes.plot(f_hz, quantiles["0.5"], color=BLUE, linewidth=1.2, label="median")
    axes.plot(f_hz, bands["feedthrough_nominal"], **NOMINAL)
    axes.set_yscale("log")
    top = max(quantiles["0.95"])
    axes.set_ylim(top / 300.0, 1.4 * top)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    style.frequency_axis(axes, f_hz[0], f_hz[-1])
    axes.set_ylabel(f"grip motion [{bands['feedthrough_unit'].replace('^2', '²')}]")
    axes.set_title(f"feedthrough with washout, {content['loop']}, frequency by frequency")
    axes.legend(loc="lower center")
    return figure


@style.styled
def nyquist_band(content: Mapping[str, Any]) -> Figure:
    """The loop around the critical point: where it is for half and for 90 % of the draws at each frequency."""
    bands = content["bands"]
    f_hz = np.array(bands["frequency_hz"])
    nominal = np.array(bands["loop_nominal"]["real"]) + 1j * np.array(bands["loop_nominal"]["imag"])
    figure = style.new_figure(5.4, 5.8)
    axes = figure.subplots()
    outline = {key: [_ellipse(one, key) for one in bands["loop_ellipses"]] for key in ("0.9", "0.5")}
    reach = float(np.clip(1.08 * max(np.abs(np.concatenate(outline["0.9"])).max(), 1.15), 1.25, 3.0))
    for key, color, text in (("0.9", OUTER, "90 %"), ("0.5", INNER, "half")):
        _sweep(axes, outline[key], color)
        axes.fill([], [], color=color, label=f"{text} of {_draws(content)}")
    turn = np.exp(1j * np.linspace(0.0, 2.0 * math.pi, 181))
    axes.plot(turn.real, turn.imag, color=GREY, linewidth=0.9, linestyle="--", label="unit circle")
    axes.axhline(0.0, color=LIGHT_GREY, linewidth=0.8, zorder=0)
    axes.axvline(0.0, color=LIGHT_GREY, linewidth=0.8, zorder=0)
    limit = content["shares"].get("gain_margin_db", {}).get("limit")
    if limit is not None:
        ends = [-1.0, -(10.0 ** (-limit / 20.0))]
        text = f"gain margin below {limit:g} dB"
        axes.plot(ends, [0.0, 0.0], color=VERMILLION, linewidth=2.4, solid_capstyle="butt", label=text)
    axes.plot(nominal.real, nominal.imag, **NOMINAL)
    for at_hz in LABELS_HZ:
        point = complex(np.interp(at_hz, f_hz, nominal.real), np.interp(at_hz, f_hz, nominal.imag))
        if abs(point) > 0.08:
            axes.plot(point.real, point.imag, ".", color=BLACK, markersize=5)
            axes.annotate(f"{at_hz:g} Hz", (point.real, point.imag), xytext=(5, 5), textcoords="offset points",
                          fontsize=7.5)  # fmt: skip
    axes.plot(-1.0, 0.0, "+", color=BLACK, markersize=11, markeredgewidth=1.8, zorder=5)
    axes.set_aspect("equal")
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    axes.set_xlabel("Re L")
    axes.set_ylabel("Im L")
    axes.set_title(f"L(jω), {content['loop']}, {f_hz[0]:g} to {f_hz[-1]:g} Hz")
    axes.legend(loc="upper right", fontsize=7.5)
    return figure


@style.styled
def margin_spread(content: Mapping[str, Any]) -> Figure:
    """Share of draws below each margin, with the intervals of its quantiles and the study's limit."""
    rows = [row for key, row in OBJECTIVES.items() if any(x is not None for x in content["margins"][key]["draws"])]
    figure = style.new_figure(3.4, 3.2 * max(len(rows), 1) + 0.4)
    panels = np.atleast_1d(figure.subplots(1, max(len(rows), 1), sharey=True))
    for axes, row in zip(panels, rows, strict=False):
        found = content["margins"][row.key]
        values = np.sort([math.inf if x is None else x for x in found["draws"]])
        shares = 100.0 * np.arange(1, len(values) + 1) / len(values)
        finite = np.isfinite(values)
        axes.step(values[finite], shares[finite], where="post", color=BLUE, label=_draws(content))
        for q, one in found["quantiles"].items():
            if one["low"] is not None and one["high"] is not None:
                axes.plot([one["low"], one["high"]], [100 * float(q)] * 2, color=GREY, linewidth=2.2, alpha=0.8)
        axes.plot([], [], color=GREY, linewidth=2.2, label="95 % intervals of quantiles")
        if content["nominal"][row.key] is not None:
            axes.axvline(content["nominal"][row.key], **NOMINAL)
        limit = content["shares"].get(row.key, {}).get("limit")
        low, high = axes.get_xlim()
        if limit is not None and low - 0.5 * (high - low) < limit < high:
            axes.axvline(limit, color=GREEN, linewidth=1.1, label="the study's limit")
        axes.set_xlabel(row.heading)
        axes.set_ylim(0.0, 100.0)
    panels[0].set_ylabel("share of draws below [%]")
    handles = {text: line for axes in panels for line, text in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=len(handles), fontsize=7.5)
    return figure


def _draws(content: Mapping[str, Any]) -> str:
    failed = content["draws"] - content["evaluated"]
    return f"{content['evaluated']} draws" + (f" ({failed} failed)" if failed else "")


def _ellipse(one: Mapping[str, Any], key: str) -> np.ndarray:
    """Points of an ellipse in the complex plane. Shape (ARC,)."""
    turn = np.linspace(0.0, 2.0 * math.pi, ARC, endpoint=False)
    major, minor = one["half_axes"][key]
    tilt = complex(math.cos(math.radians(one["angle_deg"])), math.sin(math.radians(one["angle_deg"])))
    return np.asarray(complex(*one["centre"]) + tilt * (major * np.cos(turn) + 1j * minor * np.sin(turn)))


def _sweep(axes: Axes, outlines: list[np.ndarray], color: str) -> None:
    """Fill what ellipses at neighbouring frequencies cover together: the hull of each pair."""
    from matplotlib.collections import PolyCollection
    from scipy.spatial import ConvexHull

    polygons = []
    for pair in pairwise(outlines):
        points = np.concatenate(pair)
        flat = np.column_stack([points.real, points.imag])
        polygons.append(flat[ConvexHull(flat, qhull_options="QJ").vertices])
    axes.add_collection(PolyCollection(polygons, facecolor=color, edgecolor=color, linewidth=0.3, zorder=1))
