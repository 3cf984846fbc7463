"""The feedthrough by several methods over each other.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pilotgen.figures import style
from pilotgen.figures.style import BLACK, LINE_COLORS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pilotgen.virtual.identify import Identification, TestRun

MARKERS = ("o", "s", "^", "D", "v", "P")
GRID_POINTS = 400


@style.styled
def identification(found: Identification) -> Figure:
    """Magnitude, phase, difference from the direct result, and coherence or harmonics of every test."""
    from matplotlib.ticker import FuncFormatter

    figure = style.new_figure(6.4)
    (magnitude, difference), (phase, quality) = figure.subplots(2, 2, sharex=True, height_ratios=(1.25, 1.0))
    tested = [frequency for run in found.runs for frequency in run.frequency_hz.tolist()] + list(found.frequencies_hz)
    low, high = 0.85 * min(tested), 1.15 * max(tested)
    grid = np.geomspace(low, high, GRID_POINTS)
    direct = found.direct(grid)
    length_mm = 1e3 * found.model.lever_length_m
    reference_deg = np.degrees(np.unwrap(np.angle(direct)))
    magnitude.plot(grid, length_mm * np.abs(direct), color=BLACK, label="direct", zorder=2)
    phase.plot(grid, reference_deg, color=BLACK, zorder=2)
    amplitudes = sorted({run.amplitude_m_s2 for run in found.runs})
    for run in found.runs:
        look = _look(run, amplitudes.index(run.amplitude_m_s2))
        ratio = found.ratios(run)
        label = run.label.replace("m/s^2", "m/s²")
        magnitude.plot(run.frequency_hz, length_mm * np.abs(run.response), label=label, **look)
        own = np.interp(run.frequency_hz, grid, reference_deg) + np.degrees(np.angle(ratio))
        phase.plot(run.frequency_hz, own, **look)
        # a difference of exactly zero has no place on a logarithmic axis
        difference.plot(run.frequency_hz, np.maximum(100.0 * np.abs(ratio - 1.0), 1e-8), **look)
        if run.coherence is not None:
            quality.plot(run.frequency_hz, np.maximum(1.0 - run.coherence, 1e-16), **look)
        else:
            distortion = [max(max(point.harmonics), 1e-16) for point in run.points]
            quality.plot(run.frequency_hz, distortion, **look)
    magnitude.set_yscale("log")
    magnitude.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    magnitude.yaxis.set_minor_formatter(FuncFormatter(lambda value, _: ""))
    magnitude.set_title("seat acceleration → collective grip, without washout")
    magnitude.set_ylabel("grip motion [mm per m/s²]")
    figure.legend(loc="outside lower left", ncols=3)
    phase.set_ylabel("phase [deg]")
    difference.set_yscale("log")
    difference.set_title("difference from the direct result")
    difference.set_ylabel("|H / H direct − 1| [%]")
    difference.axhline(1.0, color=BLACK, linewidth=0.9, linestyle=(0, (5, 3)), zorder=1)
    quality.set_yscale("log")
    quality.set_title("largest harmonic (sine), 1 − coherence (random)")
    quality.set_ylabel("[-]")
    for axes in (phase, quality):
        style.frequency_axis(axes, low, high)
    return figure


def _look(run: TestRun, amplitude: int) -> dict[str, Any]:
    """A colour for every amplitude; marks for sines, dots for random motion; hollow and dashed where clipped."""
    color = LINE_COLORS[amplitude % len(LINE_COLORS)]
    if run.coherence is not None:
        line = (0, (4, 2)) if run.activation_check else "-"
        return {"color": color, "linestyle": line, "linewidth": 0.7, "marker": ".", "markersize": 2.5, "zorder": 2.5}
    return {
        "color": color,
        "linestyle": "",
        "marker": MARKERS[amplitude % len(MARKERS)],
        "markersize": 5.5,
        "markerfacecolor": "none" if run.activation_check else color,
        "zorder": 3.0,
    }
