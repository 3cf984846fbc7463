"""Growth of swings by their amplitude, Nyquist curves of swings, onset over friction and gearing.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pilotgen.closed_loop.limit_cycles import NYQUIST_HZ
from pilotgen.closed_loop.limit_cycles import nyquist as curve
from pilotgen.figures import style
from pilotgen.figures.style import BLACK, BLUE, GREEN, GREY, LINE_COLORS, VERMILLION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pilotgen.closed_loop.limit_cycles import Balanced, OnsetMap


@style.styled
def growth(found: Balanced, bare: Balanced) -> Figure:
    """Growth and frequency over the amplitude, with and without friction, limit cycles marked."""
    figure = style.new_figure(4.6)
    rate, frequency = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1.0))
    runs = [(bare, GREY, "without friction")]
    if found.friction is not None:
        runs.append((found, BLUE, f"friction of {found.friction.breakout_n:g} N"))
    for run, color, words in runs:
        mm = [1e3 * swing.swing_m for swing in run.swings]
        rate.plot(mm, [swing.growth_rad_s for swing in run.swings], color=color, label=words)
        frequency.plot(mm, [swing.frequency_hz for swing in run.swings], color=color)
    for cycle in found.cycles:
        at = 1e3 * cycle.swing.swing_m
        color, face = (GREEN, GREEN) if cycle.stable else (VERMILLION, "white")
        words = f"{'stable' if cycle.stable else 'unstable'} limit cycle, {at:.3g} mm"
        dot = {"marker": "o", "color": color, "mfc": face, "markersize": 7, "linestyle": ""}
        rate.plot(at, 0.0, label=words, **dot)
        frequency.plot(at, cycle.swing.frequency_hz, **dot)
    rate.axhline(0.0, color=BLACK, linewidth=0.9)
    rate.set_xscale("log")
    rate.set_ylim(max(rate.get_ylim()[0], -12.0), rate.get_ylim()[1])
    rate.set_ylabel("growth [1/s]")
    rate.set_title("swings of the grip: those below the line die, those above grow")
    rate.legend(loc="lower right")
    frequency.set_ylabel("frequency [Hz]")
    frequency.set_xlabel("swing of the grip, half its peak-to-peak travel [mm]")
    return figure


@style.styled
def nyquist(found: Balanced) -> Figure:
    """L(j omega) of the linear loop and of swings of several sizes."""
    figure = style.new_figure(4.8, 6.4)
    axes = figure.subplots()
    f = np.linspace(*NYQUIST_HZ)
    axes.plot(*_parts(curve(found, None, f)), color=BLACK, linestyle=(0, (5, 3)), label="linear, no friction")
    chosen = [found.swings[i] for i in sorted({len(found.swings) // 3, 2 * len(found.swings) // 3})]
    shown = [(swing, f"{1e3 * swing.swing_m:.3g} mm") for swing in chosen]
    shown += [
        (cycle.swing, f"{1e3 * cycle.swing.swing_m:.3g} mm, {'stable' if cycle.stable else 'unstable'} limit cycle")
        for cycle in found.cycles
    ]
    for (swing, words), color in zip(sorted(shown, key=lambda s: s[0].swing_m), LINE_COLORS, strict=False):
        axes.plot(*_parts(curve(found, swing, f)), color=color, label=words)
    axes.plot(-1.0, 0.0, marker="+", color=VERMILLION, markersize=11, markeredgewidth=2.0, linestyle="")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("Re L")
    axes.set_ylabel("Im L")
    axes.set_title("the loop as it is for swings of the grip of different size")
    axes.legend(loc="best")
    return figure


def _parts(L: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return L.real, L.imag


@style.styled
def onset(grid: OnsetMap) -> Figure:
    """The smallest swing that grows, over friction, one line for each gearing."""
    figure = style.new_figure(3.6)
    axes = figure.subplots()
    for i, (gearing, color) in enumerate(zip(grid.gearings_rad_per_m, LINE_COLORS, strict=False)):
        values = np.where(np.isfinite(grid.swing_mm[i]), grid.swing_mm[i], np.nan)
        axes.plot(grid.frictions_n, values, color=color, marker="o", markersize=3.5, label=f"{gearing:g} rad/m")
    axes.set_xlabel("breakout force of the lever at the grip [N]")
    axes.set_ylabel("smallest swing that grows [mm]")
    axes.set_title("onset: where a line ends every swing within the stops dies")
    axes.legend(loc="best")
    return figure
