"""The feedthrough of one pilot by several methods, side by side: the matrices' own, sines, and random motion.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pilotgen.activation.reflex import reflex_gains
from pilotgen.context import EvaluationContext
from pilotgen.errors import EvaluationError
from pilotgen.evaluation import linearise_direct, solve_pilot
from pilotgen.hdf5 import NewFile
from pilotgen.linear.feedthrough import make_pilot_model
from pilotgen.linear.pilot_model import PilotModel
from pilotgen.solver.descriptor import Complexes, Floats
from pilotgen.virtual.virtual_test import PERIOD_S, HarmonicPoint, VirtualTest, harmonic_test, random_test

METHODS = ("direct", "harmonic", "random")
DEFAULT_FREQUENCIES_HZ = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0)
SMALL_AMPLITUDE_M_S2 = 0.05
FILETYPE, VERSION = "pilotgen identification", (1, 0)

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class TestRun:
    """One virtual test at one amplitude.

    Attributes
    ----------
    method : str
        `harmonic` or `random`.
    amplitude_m_s2 : float
        Of the seat's acceleration (random: sqrt(2) times its root mean square).
    activation_check : bool
        Whether muscles were clipped at zero activation.
    frequency_hz, response : ndarray, shape (m,)
        Rotation of the collective over acceleration [rad per m/s^2], without washout.
    coherence : ndarray or None
        Of a random test.
    points : tuple of HarmonicPoint
        Of a harmonic test, in the order of the frequencies.
    simulated_s, seconds : float
        Length of the simulated motion, and wall clock [s].
    """

    method: str
    amplitude_m_s2: float
    activation_check: bool
    frequency_hz: Floats
    response: Complexes
    coherence: Floats | None
    points: tuple[HarmonicPoint, ...]
    simulated_s: float
    seconds: float

    @property
    def label(self) -> str:
        """`harmonic 0.05 m/s^2, clipped`."""
        return f"{self.method} {self.amplitude_m_s2:g} m/s^2" + (", clipped" if self.activation_check else "")

    def at(self, frequency_hz: float) -> complex | None:
        """The response at a frequency that was tested, else None."""
        nearest = int(np.argmin(np.abs(self.frequency_hz - frequency_hz)))
        if abs(self.frequency_hz[nearest] - frequency_hz) > 1e-9 * frequency_hz:
            return None
        return complex(self.response[nearest])


@dataclass(frozen=True)
class Identification:
    """One pilot's feedthrough by all methods that were asked for.

    Attributes
    ----------
    values : dict
        The pilot.
    model : PilotModel
        The direct result.
    frequencies_hz : tuple of float
        The frequencies of the table [Hz].
    runs : tuple of TestRun
        The virtual tests.
    preparation_s, direct_s : float
        Wall clock of posture and activations, and of linearisation, eigenanalysis and response [s].
    """

    study: str
    values: dict[str, Any]
    model: PilotModel
    frequencies_hz: tuple[float, ...]
    runs: tuple[TestRun, ...]
    preparation_s: float
    direct_s: float

    def direct(self, frequency_hz: Floats | Sequence[float]) -> Complexes:
        """The direct result [rad per m/s^2], without washout."""
        return self.model.response(2.0 * np.pi * np.asarray(frequency_hz, dtype=float), washout=False)

    def ratios(self, run: TestRun) -> Complexes:
        """A test's response over the direct result, at the test's frequencies. Shape (frequencies,)."""
        return np.asarray(run.response / self.direct(run.frequency_hz), dtype=np.complex128)

    def as_dict(self) -> dict[str, Any]:
        """JSON-able."""
        direct = self.direct(self.frequencies_hz)
        return {
            "study": self.study,
            "values": self.values,
            "lever_length_m": self.model.lever_length_m,
            "seconds": {"preparation": self.preparation_s, "direct": self.direct_s},
            "direct": _response(np.asarray(self.frequencies_hz), direct),
            "tests": [
                {
                    "method": run.method,
                    "amplitude_m_s2": run.amplitude_m_s2,
                    "activation_check": run.activation_check,
                    "seconds": run.seconds,
                    "simulated_s": run.simulated_s,
                    **_response(run.frequency_hz, run.response),
                    "ratio_to_direct": np.abs(self.ratios(run)).tolist(),
                    "phase_to_direct_deg": np.degrees(np.angle(self.ratios(run))).tolist(),
                    "coherence": None if run.coherence is None else run.coherence.tolist(),
                    "harmonics": [list(point.harmonics) for point in run.points] or None,
                    "drift": [point.drift for point in run.points] or None,
                    "settled": [point.settled for point in run.points] or None,
                }
                for run in self.runs
            ],
        }


def _response(frequency_hz: Floats, response: Complexes) -> dict[str, Any]:
    return {
        "frequency_hz": frequency_hz.tolist(),
        "magnitude_rad_per_m_s2": np.abs(response).tolist(),
        "phase_deg": np.degrees(np.angle(response)).tolist(),
    }


def identify(
    context: EvaluationContext,
    values: Mapping[str, Any],
    methods: Sequence[str] = METHODS,
    amplitudes_m_s2: Sequence[float] = (SMALL_AMPLITUDE_M_S2,),
    frequencies_hz: Sequence[float] = DEFAULT_FREQUENCIES_HZ,
    duration_s: float | None = None,
    activation_check: bool = False,
    seed: int = 1,
    integrator: str = "ida",
    keep: Path | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Identify one pilot's feedthrough by every method.

    Parameters
    ----------
    context : EvaluationContext
        Of the study.
    values : mapping
        The pilot.
    methods : sequence of str
        Of `METHODS`; the direct result is always made, everything is compared with it.
    amplitudes_m_s2 : sequence of float
        Of the seat's acceleration, one run of every test for each.
    frequencies_hz : sequence of float
        Of the sine tests.
    duration_s : float, optional
        Longest sine test, and evaluated time of the random test [s].
    activation_check : bool
        Run every test once more with activations clipped to [0, 1].
    seed, integrator : int, str
        As in `random_test` and `VirtualTest`.
    keep : Path, optional
        Directory in which decks and motion files stay.
    progress : callable, optional
        Told what is going on, how many integrations are done, of how many.

    Raises
    ------
    EvaluationError
        This pilot cannot be evaluated.
    """
    started = time.perf_counter()
    pilot = solve_pilot(context, values, keep)
    study = pilot.study
    if study.pilot.reflex_delay_s > 0.0:
        raise EvaluationError(
            "identify",
            "the reflex is delayed after linearisation, and the deck that is moved in time has no delay; "
            "give pilot.reflex_delay_s = 0",
        )
    gains = reflex_gains(study.pilot.task, study.pilot.torso["model"], study.pilot.reflex)
    middle = time.perf_counter()
    matrices = linearise_direct(context, pilot.deck, context.scratch, pilot.torso)
    model = make_pilot_model(matrices, lever_length_m=study.inceptor.lever_length_m)
    model.response(2.0 * np.pi * np.asarray(frequencies_hz, dtype=float))
    direct_s = time.perf_counter() - middle

    test = VirtualTest(context, pilot, gains, keep, integrator)
    conditions = [
        (a, clipped) for clipped in ((False, True) if activation_check else (False,)) for a in amplitudes_m_s2
    ]
    realisations = _realisations(duration_s)
    per_condition = len(frequencies_hz) * ("harmonic" in methods) + realisations * ("random" in methods)
    total, done = per_condition * len(conditions), 0
    runs = []
    for amplitude, clipped in conditions:
        what = f"{amplitude:g}" + ("_clipped" if clipped else "")
        if "harmonic" in methods:
            points = []
            for frequency in frequencies_hz:
                if progress is not None:
                    progress(f"harmonic {amplitude:g} m/s^2 at {frequency:g} Hz", done, total)
                name = f"harmonic_{frequency:g}Hz_{what}"
                longest = {} if duration_s is None else {"longest_s": duration_s}
                points.append(harmonic_test(test, frequency, amplitude, clipped, name=name, **longest))
                done += 1
            runs.append(_harmonic_run(points, amplitude, clipped))
        if "random" in methods:
            before = done

            def report(k: int, of: int, before: int = before, amplitude: float = amplitude) -> None:
                if progress is not None:
                    progress(f"random {amplitude:g} m/s^2, motion {min(k + 1, of)} of {of}", before + k, total)

            report(0, realisations)
            estimate = random_test(test, amplitude, realisations * PERIOD_S, clipped, seed, f"random_{what}", report)
            done += realisations
            runs.append(
                TestRun(
                    "random",
                    amplitude,
                    clipped,
                    estimate.frequency_hz,
                    estimate.response,
                    estimate.coherence,
                    (),
                    estimate.simulated_s,
                    estimate.seconds,
                )
            )
    return Identification(
        study.name,
        dict(values),
        model,
        tuple(float(f) for f in frequencies_hz),
        tuple(runs),
        middle - started,
        direct_s,
    )


def _realisations(duration_s: float | None) -> int:
    return 4 if duration_s is None else max(2, math.ceil(duration_s / PERIOD_S - 1e-9))


def _harmonic_run(points: Sequence[HarmonicPoint], amplitude: float, clipped: bool) -> TestRun:
    return TestRun(
        "harmonic",
        amplitude,
        clipped,
        np.array([point.frequency_hz for point in points]),
        np.array([point.response for point in points]),
        None,
        tuple(points),
        sum(point.simulated_s for point in points),
        sum(point.seconds for point in points),
    )


# ---- for a person and for a file -------------------------------------------------------------------------------------


def report(found: Identification) -> str:
    """Tables: the response by every method, what differs, and what each method took."""
    lines = ["grip motion per seat acceleration, without washout; tests: ratio to the direct result, and phase lead"]
    width = max([len(run.label) for run in found.runs], default=len("method"))
    conditions = list(dict.fromkeys((run.amplitude_m_s2, run.activation_check) for run in found.runs))
    for condition in conditions:
        runs = [run for run in found.runs if (run.amplitude_m_s2, run.activation_check) == condition]
        lines += ["", *_table(found, runs, width)]
    if not conditions:
        lines += ["", *_table(found, [], width)]
    lines.append("")
    lines.append(f"{'method':{width}}  {'largest difference from direct':40}  {'took':>9}  {'simulated':>9}  notes")
    lines.append(f"{'direct':{width}}  {'':40}  {found.direct_s:7.3f} s")
    for run in found.runs:
        ratios = found.ratios(run)
        size, angle = np.abs(ratios) - 1.0, np.degrees(np.angle(ratios))
        worst_size, worst_angle = int(np.argmax(np.abs(size))), int(np.argmax(np.abs(angle)))
        difference = (
            f"{100 * size[worst_size]:+8.3f} % at {run.frequency_hz[worst_size]:.3g} Hz, "
            f"{angle[worst_angle]:+.3f}° at {run.frequency_hz[worst_angle]:.3g} Hz"
        )
        lines.append(
            f"{run.label:{width}}  {difference:40}  {run.seconds:7.3f} s  {run.simulated_s:7.1f} s  {_note(run)}"
        )
    lines.append(f"posture and activations, which all need, took {found.preparation_s:.3f} s")
    hidden = _hidden(found)
    return "\n".join([*lines, *([""] if hidden else []), *hidden]) + "\n"


def _table(found: Identification, runs: Sequence[TestRun], width: int) -> list[str]:
    """The responses of a few tests, a line for every frequency."""
    length_mm = 1e3 * found.model.lever_length_m
    width = max(width, 19)
    lines = [f"{'Hz':>6}  {'direct':>20}" + "".join(f"  {run.label:>{width}}" for run in runs)]
    for frequency, value in zip(found.frequencies_hz, found.direct(found.frequencies_hz).tolist(), strict=True):
        cells = [f"{frequency:6.4g}  {length_mm * abs(value):7.4f} mm {math.degrees(np.angle(value)):+8.2f}°"]
        for run in runs:
            response = run.at(frequency)
            text = "-"
            if response is not None:
                ratio = response / value
                text = f"{abs(ratio):.4f} {math.degrees(np.angle(ratio)):+8.3f}°"
            cells.append(f"{text:>{width}}")
        lines.append("  ".join(cells))
    return lines


def _note(run: TestRun) -> str:
    if run.coherence is not None:
        return f"coherence at least {np.min(run.coherence):.4f}"
    largest = max(run.points, key=lambda point: max(point.harmonics))
    text = f"harmonics up to {100 * max(largest.harmonics):.3g} % (at {largest.frequency_hz:g} Hz)"
    restless = [point for point in run.points if not point.settled]
    if restless:
        worst = max(restless, key=lambda point: point.scatter)
        text += (
            f"; NOT periodic at {len(restless)} frequencies (scatter {worst.scatter:.1g} at {worst.frequency_hz:g} Hz)"
        )
    return text


def _hidden(found: Identification) -> list[str]:
    """What linearisation hides, in words: large motions and clipped muscles."""
    lines = []
    for run in found.runs:
        if not run.activation_check and run.amplitude_m_s2 <= SMALL_AMPLITUDE_M_S2:
            continue
        ratios = found.ratios(run)
        at = int(np.argmax(np.abs(ratios - 1.0)))
        cause = "muscles that rest at zero cannot pull less" if run.activation_check else "geometry and muscle curves"
        lines.append(
            f"linearisation hides ({cause}): {run.label} gives {abs(ratios[at]):.3f} times the direct result and "
            f"{math.degrees(np.angle(ratios[at])):+.1f}° at {run.frequency_hz[at]:.3g} Hz"
        )
    return lines


def write_identification(found: Identification, path: str | os.PathLike[str]) -> None:
    """Write the responses as HDF5 (docs/io_formats/identification.md); FileError if that fails."""
    with NewFile(path, FILETYPE, VERSION) as new:
        file = new.file
        file.attrs["study"] = np.bytes_(found.study.encode())
        file.attrs["lever_length_m"] = found.model.lever_length_m
        for name, value in found.values.items():
            file.attrs[name] = value
        file["direct/frequency_hz"] = np.asarray(found.frequencies_hz)
        file["direct/response"] = found.direct(found.frequencies_hz)
        file["direct"].attrs["seconds"] = found.direct_s
        for k, run in enumerate(found.runs):
            group = file.create_group(f"tests/{k}")
            group.attrs["method"] = np.bytes_(run.method)
            group.attrs["amplitude_m_s2"] = run.amplitude_m_s2
            group.attrs["activation_check"] = int(run.activation_check)
            group.attrs["seconds"], group.attrs["simulated_s"] = run.seconds, run.simulated_s
            group["frequency_hz"], group["response"] = run.frequency_hz, run.response
            if run.coherence is not None:
                group["coherence"] = run.coherence
            if run.points:
                group["harmonics"] = np.array([point.harmonics for point in run.points])
                group["drift"] = np.array([point.drift for point in run.points])
                group["scatter"] = np.array([point.scatter for point in run.points])
