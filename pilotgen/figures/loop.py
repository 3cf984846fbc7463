"""Bode and Nyquist figures of one pilot, or of several in comparison.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pilotgen.figures import style
from pilotgen.figures.style import BLACK, GREY, LIGHT_GREY, LINE_COLORS
from pilotgen.loop.rotorcraft_model import measured_part
from pilotgen.objectives import GAIN_MARGIN, PHASE_MARGIN
from pilotgen.study.loop_section import COLLECTIVE, HEAVE, LoopSignals
from pilotgen.study.loop_section import CONTROLS as CONTROL_WORDS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from pilotgen.evaluation import Evaluation
    from pilotgen.linear.statespace import ComplexArray, FloatArray
    from pilotgen.loop.loop import LoopModel
    from pilotgen.loop.margins import Margins

LOW_HZ, HIGH_HZ = 0.1, 20.0  # the band of the figures, and of the feedthrough's certificate
GRID_POINTS = 400
POINTS_PER_MODE = 41  # extra points around every lightly damped mode
NYQUIST_BAND_HZ = (0.01, 100.0)
NYQUIST_LABELS_HZ = (1.0, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0)


@style.styled
def draw_pilot(evaluation: Evaluation, directory: Path) -> None:
    """Write bode.png and nyquist.png of one pilot to `directory`; FileError if that fails."""
    style.save(bode([("", evaluation)]), directory / "bode.png")
    style.save(nyquist([("", evaluation)]), directory / "nyquist.png")


def frequency_grid(evaluations: Sequence[Evaluation], low_hz: float = LOW_HZ, high_hz: float = HIGH_HZ) -> FloatArray:
    """Frequencies [Hz] that resolve every mode of the loops and contain their crossings. Shape (n,), ascending."""
    parts = [np.geomspace(low_hz, high_hz, GRID_POINTS)]
    spread = np.linspace(-4.0, 4.0, POINTS_PER_MODE)
    for evaluation in evaluations:
        data = measured_part(evaluation.loop.helicopter)
        if data is not None:  # nothing is drawn where nothing is known
            low_hz, high_hz = max(low_hz, data.band_hz[0]), min(high_hz, data.band_hz[1])
        own = evaluation.loop.pilot.poles if data is not None else evaluation.loop.open_loop.poles
        for pole in own:
            # half-power width of a mode is twice its real part
            parts.append((abs(pole.imag) + spread * abs(pole.real)) / (2.0 * math.pi))
        parts.append(np.array([crossing.frequency_hz for crossing in evaluation.margins.crossings]))
    grid = np.concatenate(parts)
    return np.unique(grid[(grid >= low_hz) & (grid <= high_hz)])


# ---- Bode


@style.styled
def bode(pilots: Sequence[tuple[str, Evaluation]]) -> Figure:
    """Feedthrough (grip motion per seat acceleration) and loop, magnitude and phase, 0.1 to 20 Hz.

    Parameters
    ----------
    pilots : sequence of (label, Evaluation)
        Drawn over each other; with one pilot its body alone, without washout, is drawn too.
    """
    from matplotlib.ticker import FuncFormatter

    figure = style.new_figure(5.4)
    (bdft, loop), (bdft_phase, loop_phase) = figure.subplots(2, 2, sharex=True, height_ratios=(1.25, 1.0))
    grid_hz = frequency_grid([evaluation for _, evaluation in pilots])
    omega = 2.0 * math.pi * grid_hz
    for (label, evaluation), color in zip(pilots, LINE_COLORS, strict=False):
        model = evaluation.pilot_model
        length, output = evaluation.loop.lever_length_m, evaluation.loop.output
        H = length * model.response(omega, output)
        L = evaluation.loop.response(omega)
        mode = _dominant_mode(evaluation)
        bdft.plot(
            grid_hz, 1e3 * np.abs(H), color=color, label=f"{label}: {mode}" if label else "with washout, as in the loop"
        )
        bdft_phase.plot(grid_hz, _phase_deg(H), color=color)
        if len(pilots) == 1 and model.washout_rad_s is not None:
            alone = length * model.response(omega, output, washout=False)
            bdft.plot(grid_hz, 1e3 * np.abs(alone), color=color, linestyle=":", linewidth=1.2, label="body alone")
            bdft_phase.plot(grid_hz, _phase_deg(alone), color=color, linestyle=":", linewidth=1.2)
        _mark_poles(bdft, evaluation, color)
        phase = _phase_deg(L, at=int(np.argmax(np.abs(L))))
        loop.plot(grid_hz, 20.0 * np.log10(np.abs(L)), color=color, label=label)
        loop_phase.plot(grid_hz, phase, color=color)
        _mark_crossings(loop, loop_phase, evaluation.margins, grid_hz, phase, color)
    bdft.set_yscale("log")
    bdft.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    one = pilots[0][1].loop if pilots else None
    heave = one is None or (one.motion, one.control) == (HEAVE, COLLECTIVE)
    motion, grip = ("acceleration", COLLECTIVE) if heave or one is None else (one.motion, CONTROL_WORDS[one.control])
    bdft.set_title(f"feedthrough: seat {motion} → {grip} grip (× poles)")
    bdft.set_ylabel("grip motion [mm per m/s²]" if heave else f"grip motion [mm per {_unit(one)}]")
    loop.set_title("loop L (○ |L| = 1,  □ L real and negative)")
    loop.set_ylabel("|L| [dB]")
    loop.axhline(0.0, color=BLACK, linewidth=0.9, zorder=1)
    _decibel_limits(loop)
    for axes in (bdft_phase, loop_phase):
        axes.set_ylabel("phase [deg]")
        axes.yaxis.set_major_locator(_multiples(90.0, axes))
        style.frequency_axis(axes, LOW_HZ, HIGH_HZ)
    for turn in range(-5, 6):
        angle = -180.0 + 360.0 * turn
        low, high = loop_phase.get_ylim()
        if low <= angle <= high:
            loop_phase.axhline(angle, color=BLACK, linewidth=0.9, zorder=1)
    if len(pilots) > 1:
        bdft.legend(loc="lower left")
        loop.legend(loc="lower left")
    elif len(pilots) == 1:
        only = pilots[0][1]
        bdft.plot([], [], "x", color=LINE_COLORS[0], markeredgewidth=1.6, label=_dominant_mode(only))
        bdft.legend(loc="lower left")
        name = "" if heave else f"{only.loop.motion} by the {grip}: "
        figure.suptitle(name + loop_title(only.margins), fontsize=9.0, x=0.01, ha="left")
    return figure


def _unit(loop: LoopModel | None) -> str:
    return "rad/s²" if loop is not None and LoopSignals(input=loop.motion).rotates else "m/s²"


def loop_title(margins: Margins) -> str:
    """`closed loop stable; gain margin 6.36 dB at 3.98 Hz; phase margin none (no crossing ...); ...`."""
    state = "closed loop stable" if margins.stable else "closed loop UNSTABLE"
    gain = style.typeset(GAIN_MARGIN.text(margins.gain_margin_db, margins.gain_margin_hz))
    phase = style.typeset(PHASE_MARGIN.text(margins.phase_margin_deg, margins.phase_margin_hz))
    nearest = "modulus margin" if margins.stable else "distance to −1"
    return f"{state};  gain margin {gain};  phase margin {phase};  {nearest} {margins.modulus_margin:.3f}"


def _phase_deg(response: ComplexArray, at: int | None = None) -> FloatArray:
    """Continuous phase [deg]; in (-360, 0] at index `at`, in (-180, 180] at the largest response by default."""
    phase = np.degrees(np.unwrap(np.angle(response)))
    index = int(np.argmax(np.abs(response))) if at is None else at
    top = 180.0 if at is None else 0.0
    shifted: FloatArray = phase - 360.0 * math.ceil((phase[index] - top) / 360.0)
    return shifted


def _multiples(step: float, axes: Axes) -> object:
    from matplotlib.ticker import MultipleLocator

    low, high = axes.get_ylim()
    return MultipleLocator(step if high - low < 7.0 * step else 2.0 * step)


def _decibel_limits(axes: Axes) -> None:
    """At most 50 dB below the top: what is smaller has nothing to say about stability."""
    low, high = axes.get_ylim()
    high = max(high, 5.0)
    axes.set_ylim(max(low, high - 50.0), high)


def _dominant_mode(evaluation: Evaluation) -> str:
    """`3.75 Hz, 28 % damped`: the pair that dominates the lever's rotation."""
    frequency_hz, damping = evaluation.pilot_model.dominant_pair(evaluation.loop.output)
    return f"{frequency_hz:.2f} Hz, {100.0 * damping:.0f} % damped".replace("-", "−")


def _mark_poles(axes: Axes, evaluation: Evaluation, color: str) -> None:
    """A cross on the curve at every oscillatory pole; a heavier one at the pair that dominates the lever's rotation."""
    model, loop = evaluation.pilot_model, evaluation.loop
    dominant = model.dominant_pole(loop.output)
    for pole in model.poles[model.poles.imag > 0.0]:
        at_hz = abs(pole) / (2.0 * math.pi)
        if LOW_HZ <= at_hz <= HIGH_HZ:
            height = 1e3 * abs(loop.lever_length_m * complex(model.response(abs(pole), loop.output)))
            size, weight = (8, 2.2) if pole == dominant else (5, 1.2)
            axes.plot(at_hz, height, "x", color=color, markersize=size, markeredgewidth=weight)


def _mark_crossings(
    gain: Axes, phase: Axes, margins: Margins, grid_hz: FloatArray, phase_deg: FloatArray, color: str
) -> None:
    for crossing in margins.crossings:
        if not LOW_HZ <= crossing.frequency_hz <= HIGH_HZ:
            continue
        if crossing.kind == "unit circle":
            gain.plot(crossing.frequency_hz, 0.0, "o", color=color, markerfacecolor="white", markersize=6, zorder=4)
        else:
            angle = float(np.interp(crossing.frequency_hz, grid_hz, phase_deg))
            exact = -180.0 + 360.0 * round((angle + 180.0) / 360.0)
            phase.plot(crossing.frequency_hz, exact, "s", color=color, markerfacecolor="white", markersize=6, zorder=4)
            gain.plot(
                crossing.frequency_hz,
                -crossing.gain_db,
                "s",
                color=color,
                markerfacecolor="white",
                markersize=6,
                zorder=4,
            )


# ---- Nyquist


@style.styled
def nyquist(pilots: Sequence[tuple[str, Evaluation]]) -> Figure:
    """L(j omega) around the critical point, with margins, unit circle and modulus circle; one panel per pilot.

    Parameters
    ----------
    pilots : sequence of (label, Evaluation)
        One panel each, same scale.
    """
    figure = style.new_figure(4.9 if len(pilots) > 1 else 5.2, 4.6 * max(len(pilots), 1) if len(pilots) > 1 else 5.6)
    panels = np.atleast_1d(figure.subplots(1, len(pilots), sharex=True, sharey=True))
    grid_hz = frequency_grid([evaluation for _, evaluation in pilots], *NYQUIST_BAND_HZ)
    loci = [evaluation.loop.response(2.0 * math.pi * grid_hz) for _, evaluation in pilots]
    reach = float(np.clip(1.1 * max(np.abs(L).max() for L in loci), 1.3, 3.0))
    for axes, (label, evaluation), L, color in zip(panels, pilots, loci, LINE_COLORS, strict=False):
        _nyquist_panel(axes, evaluation.margins, grid_hz, L, reach, color)
        heading = ("stable" if evaluation.margins.stable else "UNSTABLE") + " closed loop"
        ends = LoopSignals(evaluation.loop.motion, evaluation.loop.control)
        heading += "" if ends.usual else f", {ends.words}"
        axes.set_title(f"{label}: {heading}" if label else heading)
    panels[0].set_ylabel("Im L")
    return figure


def _nyquist_panel(
    axes: Axes, margins: Margins, grid_hz: FloatArray, L: ComplexArray, reach: float, color: str
) -> None:
    turn = np.exp(1j * np.linspace(0.0, 2.0 * math.pi, 181))
    axes.axhline(0.0, color=LIGHT_GREY, linewidth=0.8, zorder=0)
    axes.axvline(0.0, color=LIGHT_GREY, linewidth=0.8, zorder=0)
    axes.plot(turn.real, turn.imag, color=GREY, linewidth=0.9, linestyle="--", label="unit circle")
    circle = -1.0 + margins.modulus_margin * turn
    axes.plot(
        circle.real,
        circle.imag,
        color=style.PURPLE,
        linewidth=1.1,
        label=f"{'modulus margin' if margins.stable else 'distance to −1'} {margins.modulus_margin:.3f}",
    )
    axes.plot(L.real, -L.imag, color=color, linewidth=0.8, alpha=0.35)
    axes.plot(L.real, L.imag, color=color, label="L(jω), ω > 0")
    _arrows(axes, L, reach, color)
    for f_hz in NYQUIST_LABELS_HZ:
        point = complex(np.interp(f_hz, grid_hz, L.real), np.interp(f_hz, grid_hz, L.imag))
        if 0.12 < abs(point) < reach:
            axes.plot(point.real, point.imag, ".", color=color, markersize=6)
            away = point / abs(point)
            # near the negative real axis the margin is drawn: keep off it
            near_axis = point.real < 0.0 and abs(point.imag) < 0.08 * reach
            up = math.copysign(9.0, point.imag) if near_axis else 9.0 * away.imag
            axes.annotate(
                f"{f_hz:g} Hz",
                (point.real, point.imag),
                xytext=(9.0 * away.real, up),
                textcoords="offset points",
                fontsize=7.5,
                ha="left" if away.real > 0.0 else "right",
                va="center",
                color=color,
            )
    _draw_margins(axes, margins)
    axes.plot(-1.0, 0.0, "+", color=BLACK, markersize=10, markeredgewidth=1.8, zorder=5)
    axes.set_aspect("equal")
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    axes.set_xlabel("Re L")
    axes.legend(loc="lower right", fontsize=7.5)


def _draw_margins(axes: Axes, margins: Margins) -> None:
    """The crossings that set gain and phase margin, and the margins themselves."""
    for crossing in margins.crossings:
        marker = "s" if crossing.kind == "real axis" else "o"
        axes.plot(
            crossing.value.real,
            crossing.value.imag,
            marker,
            color=GREY,
            markerfacecolor="white",
            markersize=4,
            zorder=4,
        )
    gain = _nearest(margins, "real axis", margins.gain_margin_hz)
    if gain is not None:
        axes.plot([gain.real, -1.0], [0.0, 0.0], color=style.VERMILLION, linewidth=2.2, zorder=4,
                  label=style.typeset(f"gain margin {GAIN_MARGIN.text(margins.gain_margin_db)}"))  # fmt: skip
        axes.plot(gain.real, 0.0, "s", color=style.VERMILLION, markerfacecolor="white", markersize=6, zorder=5)
    else:
        axes.plot([], [], " ", label="gain margin: no crossing")
    phase = _nearest(margins, "unit circle", margins.phase_margin_hz)
    if phase is not None:
        start, end = math.pi, math.pi + math.atan2((-phase).imag, (-phase).real)
        arc = np.exp(1j * np.linspace(start, end, 60))
        axes.plot(arc.real, arc.imag, color=style.GREEN, linewidth=2.2, zorder=4,
                  label=style.typeset(f"phase margin {PHASE_MARGIN.text(margins.phase_margin_deg)}"))  # fmt: skip
        axes.plot(phase.real, phase.imag, "o", color=style.GREEN, markerfacecolor="white", markersize=6, zorder=5)
    else:
        axes.plot([], [], " ", label="phase margin: no crossing")


def _nearest(margins: Margins, kind: str, frequency_hz: float | None) -> complex | None:
    """L at the crossing of this kind that sets the margin."""
    points = [crossing for crossing in margins.crossings if crossing.kind == kind]
    if frequency_hz is None or not points:
        return None
    return min(points, key=lambda crossing: abs(crossing.frequency_hz - frequency_hz)).value


def _arrows(axes: Axes, L: ComplexArray, reach: float, color: str) -> None:
    """Arrow heads in the direction of rising frequency, spread over the visible length of the locus."""
    visible = np.flatnonzero(np.abs(L) < reach)
    if len(visible) < 3:
        return
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(L[visible])))])
    for share in (0.3, 0.6, 0.85):
        k = visible[min(int(np.searchsorted(path, share * path[-1])), len(visible) - 2)]
        step = L[k + 1] - L[k]
        if abs(step) > 0.0:
            head = L[k] + step / abs(step) * 0.02 * reach
            axes.annotate(
                "",
                (head.real, head.imag),
                xytext=(L[k].real, L[k].imag),
                arrowprops={"arrowstyle": "-|>", "color": color, "mutation_scale": 12, "shrinkA": 0, "shrinkB": 0},
            )
