"""Seat vibration of a pilot beside published bands and models.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pilotgen.figures import style
from pilotgen.figures.style import BLACK, GREY, LIGHT_GREY, LINE_COLORS
from pilotgen.virtual.seat_vibration import REFERENCE_HZ, lumped_model, published

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from pilotgen.virtual.seat_vibration import SeatVibration


@style.styled
def draw_seat_vibration(found: SeatVibration) -> Figure:
    """Apparent mass, seat to shoulder, seat to head, and fore-aft and pitch motion; bands shaded, models thin."""
    figure = style.new_figure(7.0)
    ((mass, shoulder), (head, across)) = figure.subplots(2, 2)
    f = found.frequency_hz
    bands = {band["quantity"]: band for band in published()["bands"]}
    _panel(mass, found, "apparent_mass_pan", "apparent mass at the pan over its value at 1 Hz", bands, normalised=True)
    _panel(shoulder, found, "shoulder", "seat to shoulder, vertical", bands, band="shoulder_t1")
    (t1,) = shoulder.plot(f, np.abs(found.responses["shoulder_t1"]), color=BLACK, linestyle=":")
    shoulder.legend([shoulder.lines[-2], t1], ["left shoulder joint", "T1"], loc="upper right", fontsize="small")
    _panel(head, found, "head", "seat to head, vertical", bands)
    pairs = (
        ("shoulder_fore_aft", "shoulder, fore-aft", "-"),
        ("head_fore_aft", "head, fore-aft", "--"),
        ("trunk_pitch", "thorax, pitch [rad/m]", "-."),
    )
    for (name, label, line), color in zip(pairs, LINE_COLORS, strict=False):
        across.plot(f, np.abs(found.responses[name]), color=color, linestyle=line, label=label)
    across.set_title("out of the seat's direction")
    across.legend(loc="upper right", fontsize="small")
    for axes in (mass, shoulder, head, across):
        axes.set_xlim(0.5, 12.0)
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel("frequency [Hz]")
    handles, labels = mass.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def _panel(
    axes: Axes,
    found: SeatVibration,
    name: str,
    title: str,
    bands: dict,  # type: ignore[type-arg]
    normalised: bool = False,
    band: str | None = None,
) -> None:
    f = found.frequency_hz

    def scaled(values: np.ndarray) -> np.ndarray:
        magnitude: np.ndarray = np.abs(values)
        return magnitude / np.interp(REFERENCE_HZ, f, magnitude) if normalised else magnitude

    for (key, row), line in zip(published()["models"].items(), ("--", "-.", ":"), strict=True):
        model = lumped_model(key, f)
        if name in model:
            axes.plot(f, scaled(model[name]), color=GREY, linewidth=0.9, linestyle=line, label=row["label"])
    limits = bands.get(band or name)
    if limits is not None:
        (f0, f1), (r0, r1) = limits["peak_hz"], limits["peak_ratio"]
        axes.fill_between([f0, f1], r0, r1, color=LIGHT_GREY, zorder=0, label="published peaks")
    axes.plot(f, scaled(found.responses[name]), color=BLACK, linewidth=1.6, label="this pilot")
    axes.set_title(title)
