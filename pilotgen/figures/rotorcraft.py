"""Bode figure of a rotorcraft: heave and coning, or any other.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pilotgen.figures import style
from pilotgen.figures.style import BLUE, ORANGE, VERMILLION
from pilotgen.loop.heave_model import HeaveModel
from pilotgen.loop.rotorcraft_model import measured_part
from pilotgen.study.loop_section import LoopSignals

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pilotgen.loop.rotorcraft_model import RotorcraftModel

LOW_HZ, HIGH_HZ = 0.01, 20.0
OSCILLATIONS_HZ = (2.0, 8.0)  # where pilots take part without wanting to


@style.styled
def rotorcraft_bode(model: RotorcraftModel, name: str = "", ends: LoopSignals | None = None) -> Figure:
    """Magnitude and phase from blade pitch to the acceleration of the seat, 0.01 to 20 Hz, or where it is known.

    Parameters
    ----------
    model : RotorcraftModel
        A `HeaveModel` brings its own name.
    name : str
        Of the rotorcraft.
    ends : LoopSignals, optional
        Of its loop; heave by the collective if left out.
    """
    from matplotlib.ticker import MultipleLocator

    ends = ends or LoopSignals()
    data = measured_part(model)
    low, high = (LOW_HZ, HIGH_HZ) if data is None else data.band_hz
    frequency_hz = np.geomspace(max(low, LOW_HZ), min(high, HIGH_HZ), 600)
    response = model.response(2.0 * np.pi * frequency_hz)
    figure = style.new_figure(5.5, 7.0)
    gain, phase = figure.subplots(2, 1, sharex=True)
    gain.loglog(frequency_hz, np.abs(response), color=BLUE)
    gain.set_ylabel(f"gain [{'rad' if ends.rotates else 'm'}/s² per rad]")
    name = model.rotorcraft.name if isinstance(model, HeaveModel) else name
    what = "blade pitch to vertical acceleration"
    what = what if ends.usual else f"{ends.output} blade pitch to {ends.input} acceleration"
    gain.set_title(f"{name}: {what} in hover")
    phase.semilogx(frequency_hz, np.degrees(np.unwrap(np.angle(response))), color=BLUE)
    phase.set_ylabel("phase [deg]")
    phase.yaxis.set_major_locator(MultipleLocator(45.0))
    coning = max(model.poles, key=lambda pole: pole.imag) if isinstance(model, HeaveModel) else 0j
    for axes in (gain, phase):
        axes.axvspan(*OSCILLATIONS_HZ, color=ORANGE, alpha=0.15, linewidth=0.0, label="pilot-assisted oscillations")
        if coning.imag > 0.0:
            coning_hz = abs(coning) / (2.0 * np.pi)
            axes.axvline(coning_hz, color=VERMILLION, linestyle="--", label=f"coning, {coning_hz:.2f} Hz")
    style.frequency_axis(phase, LOW_HZ, HIGH_HZ)
    gain.legend(loc="upper left")
    return figure
