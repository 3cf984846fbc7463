"""A motion of the closed loop over time.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pilotgen.figures import style
from pilotgen.figures.style import BLACK, BLUE, GREY, LINE_COLORS, VERMILLION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pilotgen.closed_loop.simulate import LoopMotion, Onset

MUSCLES_SHOWN = 5


@style.styled
def history(motion: LoopMotion, title: str) -> Figure:
    """Grip, seat and the busiest muscles over time."""
    figure = style.new_figure(6.2)
    grip, seat, muscles = figure.subplots(3, 1, sharex=True)
    t = motion.time
    grip.plot(t, 1e3 * motion.travel, color=BLUE)
    grip.set_ylabel("grip travel [mm]")
    grip.set_title(title)
    for stop in motion.stops_m:
        if 0.6 * abs(stop) < float(np.abs(motion.travel).max()):
            grip.axhline(1e3 * stop, color=BLACK, linewidth=0.9, linestyle=(0, (5, 3)))
    seat.plot(t, motion.acceleration / 9.81, color=VERMILLION)
    seat.set_ylabel("seat acceleration [g]")
    busy = np.argsort(-np.ptp(motion.activation, axis=0))[:MUSCLES_SHOWN]
    for color, i in zip(LINE_COLORS, sorted(busy.tolist()), strict=False):
        muscles.plot(t, motion.activation[:, i], color=color, linewidth=1.0, label=motion.muscles[i])
    muscles.set_ylabel("activation [-]")
    muscles.set_xlabel("time [s]")
    muscles.legend(loc="upper right", ncols=MUSCLES_SHOWN)
    muscles.set_xlim(float(t[0]), float(t[-1]))
    return figure


@style.styled
def onset(found: Onset, unit: str) -> Figure:
    """Which kicks grew, by their size."""
    figure = style.new_figure(2.2)
    axes = figure.subplots()
    for grew, color, words in ((False, GREY, "died away"), (True, VERMILLION, "goes on")):
        sizes = found.sizes[found.grew == grew]
        axes.plot(sizes, np.full(len(sizes), float(grew)), linestyle="", marker="o", color=color, label=words)
    axes.set_yticks([0.0, 1.0], ["died away", "goes on"])
    axes.set_ylim(-0.5, 1.5)
    axes.set_xlabel(f"size of the kick [{unit}]")
    return figure
