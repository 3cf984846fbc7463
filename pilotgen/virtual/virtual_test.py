"""Virtual tests: simulate the seat, integrate the pilot's deck in time, and estimate the feedthrough from what moved.

The slow way that linearisation replaces, kept as its witness (docs/theory/virtual_test.md). Two tests: a sine until the
motion is periodic, and a band-limited random motion with an H1 estimate. Nothing here knows the matrices.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pilotgen.context import EvaluationContext
from pilotgen.decks.deck import render_direct
from pilotgen.decks.text import number
from pilotgen.errors import EvaluationError, MatrixError
from pilotgen.evaluation import SolvedPilot
from pilotgen.files import write_text
from pilotgen.hdf5 import opened, text
from pilotgen.linear.imposed_motion import SEAT_MOTIONS
from pilotgen.solver.descriptor import Complexes, Floats
from pilotgen.study.sections import Reflex

MOTION_FILETYPE, MOTION_VERSION = "pilotgen motion", 1
OUTPUT_CHANNEL = "lever.gz"
SEAT_CHANNELS = ("seat.x", "seat.y", "seat.z", "seat.gx", "seat.gy", "seat.gz")
RELATIVE_TOLERANCE, ABSOLUTE_TOLERANCE = 1e-7, 1e-10  # of IDA; 1e-7 leaves about 1e-5 in the response
TIME_LIMIT_S = 600.0  # of one integration

# harmonic test
SAMPLES_PER_PERIOD = 128
FIRST_PERIODS_S, FIRST_PERIODS = 2.0, 4  # first attempt: at least so long and so many periods
COMPARED_PERIODS = 3  # the fundamentals of so many last periods must agree
SETTLED = 1e-4  # largest relative difference between them
HARMONICS = 5

# random test: period, band, settling of the pilot's own motions (both pairs decay faster than 5 1/s)
PERIOD_S = 8.0
BAND_HZ = (1.0, 10.0)
SETTLING_S = 2.0
SAMPLING_HZ = 200.0

RAMP_S = 1.0  # seat motion grows by a half cosine, so that the pilot starts at rest


@dataclass(frozen=True)
class Motion:
    """One time history.

    Attributes
    ----------
    time : ndarray, shape (n,)
        [s].
    seat : ndarray, shape (n,)
        Vertical motion of the seat [m], zero at the start.
    lever : ndarray, shape (n,)
        Rotation of the collective from its start [rad], positive = up.
    """

    time: Floats
    seat: Floats
    lever: Floats


@dataclass(frozen=True)
class HarmonicPoint:
    """What one sine test found.

    Attributes
    ----------
    frequency_hz, amplitude_m_s2 : float
        Of the seat's acceleration.
    response : complex
        Fundamental of the collective rotation over that of the acceleration [rad per m/s^2], without washout.
    harmonics : tuple of float
        Second to fifth harmonic of the rotation over the fundamental.
    drift : float
        Mean rotation in the steady state over the fundamental's amplitude.
    settled : bool
        Whether the last periods agreed; if not, `scatter` tells by how much they differ.
    scatter : float
        Largest relative difference of the fundamentals of the last periods.
    simulated_s, seconds : float
        Length of the simulated motion, and wall clock spent on all attempts [s].
    """

    frequency_hz: float
    amplitude_m_s2: float
    response: complex
    harmonics: tuple[float, ...]
    drift: float
    settled: bool
    scatter: float
    simulated_s: float
    seconds: float


@dataclass(frozen=True)
class RandomEstimate:
    """What the random tests found.

    Attributes
    ----------
    frequency_hz : ndarray, shape (m,)
        The excited frequencies [Hz].
    response : ndarray, shape (m,)
        H1 estimate, rotation over acceleration [rad per m/s^2], without washout.
    coherence : ndarray, shape (m,)
        1 for a linear pilot without noise.
    rms_m_s2 : float
        Of the seat's acceleration.
    realisations : int
        Independent random motions.
    simulated_s, seconds : float
        Length of all simulated motions, and wall clock spent [s].
    """

    frequency_hz: Floats
    response: Complexes
    coherence: Floats
    rms_m_s2: float
    realisations: int
    simulated_s: float
    seconds: float

    def at(self, frequency_hz: float) -> complex:
        """The estimate at the nearest excited frequency."""
        return complex(self.response[int(np.argmin(np.abs(self.frequency_hz - frequency_hz)))])


# ---- drives ----------------------------------------------------------------------------------------------------------


def smooth(drive: str, ramp_s: float = RAMP_S) -> str:
    """A drive that grows from zero value and rate by a half cosine within `ramp_s`, as MBDyn reads it."""
    return f"mult, cosine, 0., pi/{number(ramp_s)}, 0.5, half, 0., {drive}"


def sine_drive(frequency_hz: float, amplitude_m_s2: float, phase_rad: float = 0.0) -> str:
    """Seat displacement [m] whose acceleration is -amplitude sin(2 pi f t + phase)."""
    omega = 2.0 * math.pi * frequency_hz
    # a sine that began before t = 0 has any phase at t = 0
    start = -math.remainder(phase_rad, 2.0 * math.pi) / omega
    if start > 0.0:
        start -= 1.0 / frequency_hz
    return f"sine, {number(start)}, {number(omega)}, {number(amplitude_m_s2 / omega**2)}, forever, 0."


def multisine_drive(frequencies_hz: Floats, amplitudes_m_s2: Floats, phases_rad: Floats) -> str:
    """The sum of sines, one to a line. All arrays have shape (n,)."""
    sines = [
        sine_drive(f, a, p)
        for f, a, p in zip(frequencies_hz.tolist(), amplitudes_m_s2.tolist(), phases_rad.tolist(), strict=True)
    ]
    return f"array, {len(sines)},\n\t\t\t" + ",\n\t\t\t".join(sines)


# ---- the virtual test ------------------------------------------------------------------------------------------------


class VirtualTest:
    """One pilot whose seat is moved in time.

    Parameters
    ----------
    context : EvaluationContext
        Whose solver integrates.
    pilot : SolvedPilot
        In equilibrium at the controls, with matrices (for the muscles' lengths).
    gains : Reflex
        Reflex gains.
    keep : Path, optional
        Directory in which decks and motion files stay.
    integrator : str
        `ida`, or `ms` for MBDyn's own method at the deck's step.
    motion : str
        How the seat is moved, a name of `SEAT_MOTIONS`; rotations about the seat's node.
    output : str
        Rotation that is watched, relative to the seat.
    """

    def __init__(
        self,
        context: EvaluationContext,
        pilot: SolvedPilot,
        gains: Reflex,
        keep: Path | None = None,
        integrator: str = "ida",
        motion: str = "heave",
        output: str = OUTPUT_CHANNEL,
    ) -> None:
        assert pilot.matrices is not None
        self._bench, self._pilot, self._gains, self._integrator = context, pilot, gains, integrator
        self._lengths = pilot.matrices.muscle_lengths
        self._keep = keep
        self.motion, self.output = motion, output

    def deck(
        self, drive: str | Mapping[str, str], final_time_s: float, time_step_s: float, activation_check: bool
    ) -> str:
        """The pilot's deck with this motion of the seat."""
        pilot = self._pilot
        return render_direct(
            pilot.body,
            pilot.cockpit,
            pilot.posture,
            activations=pilot.activations,
            muscle_lengths=self._lengths,
            gains=self._gains,
            c=pilot.study.pilot.matrix_coefficient_s,
            torso=pilot.torso,
            activation_check=activation_check,
            seat_drive=drive if not isinstance(drive, str) or self.motion == "heave" else {self.motion: drive},
            final_time_s=final_time_s,
            time_step_s=time_step_s,
        )

    def simulate(
        self,
        drive: str,
        final_time_s: float,
        time_step_s: float,
        activation_check: bool = False,
        name: str = "simulate",
    ) -> Motion:
        """Integrate the deck under one motion of the seat; rows every `time_step_s`."""
        time, seat, lever = self.record(
            drive, [self.motion], [self.output], final_time_s, time_step_s, activation_check, name
        )
        return Motion(time, seat[:, 0], lever[:, 0])

    def record(
        self,
        drive: str | Mapping[str, str],
        motions: Sequence[str],
        outputs: Sequence[str],
        final_time_s: float,
        time_step_s: float,
        activation_check: bool,
        name: str,
    ) -> tuple[Floats, Floats, Floats]:
        """Integrate the deck; times (n,), motions of the seat (n, k) and rotations relative to the seat (n, p)."""
        text = self.deck(drive, final_time_s, time_step_s, activation_check)
        where = self._keep if self._keep is not None else self._bench.scratch
        if self._keep is not None:
            write_text(where / f"{name}.mbd", text)
        self._bench.put_modes(self._pilot.torso)
        output = where / f"{name}.motion.h5"
        limit = self._bench.time_limit_s
        self._bench.time_limit_s = TIME_LIMIT_S
        try:
            self._bench.ask(
                "integrate",
                text,
                f"{name}.mbd",
                output,
                integrator=self._integrator,
                rtol=RELATIVE_TOLERANCE,
                atol=ABSOLUTE_TOLERANCE,
                channels=list(dict.fromkeys([*SEAT_CHANNELS, *outputs])),
            )
        finally:
            self._bench.time_limit_s = limit
        time, found = read_motion(output, [*SEAT_CHANNELS, *outputs])
        seat = np.column_stack([_along(found, motion) for motion in motions])
        turned = [found[channel] - found[f"seat.{channel.rpartition('.')[2]}"] for channel in outputs]
        return time, seat, np.column_stack(turned)


def _along(found: Mapping[str, Floats], motion: str) -> Floats:
    """The seat's motion of a name of `SEAT_MOTIONS`."""
    wanted = SEAT_MOTIONS[motion]
    channels = SEAT_CHANNELS[3:] if wanted.rotation else SEAT_CHANNELS[:3]
    i = next(i for i, part in enumerate(wanted.axis) if part)
    return wanted.axis[i] * found[channels[i]]


def read_motion(path: str | os.PathLike[str], channels: Sequence[str]) -> tuple[Floats, dict[str, Floats]]:
    """Read times and channels, each from its value at the start, of a motion file (docs/io_formats/motion.md).

    Raises
    ------
    FileError
        The file cannot be opened.
    MatrixError
        It is no motion file, or has not these channels.
    """
    with opened(path, MOTION_FILETYPE, (MOTION_VERSION, 0), MatrixError) as file:
        time, data = np.asarray(file["time"][()]), np.asarray(file["data"][()])
        names = [text(channel).rstrip("\0") for channel in file["channels/name"][()]]
        columns = {channel: data[:, names.index(channel)] for channel in channels}
    return time, {channel: column - column[0] for channel, column in columns.items()}


# ---- sine test -------------------------------------------------------------------------------------------------------


def harmonic_test(
    test: VirtualTest,
    frequency_hz: float,
    amplitude_m_s2: float,
    activation_check: bool = False,
    longest_s: float = 64.0,
    name: str = "harmonic",
) -> HarmonicPoint:
    """Move the seat at one frequency until successive periods agree, and fit the fundamental.

    The first attempt takes a few periods; while the fundamentals of the last periods differ by more than `SETTLED`,
    the test is repeated twice as long, up to `longest_s` [s] of simulated motion.
    """
    import time as clock

    started = clock.perf_counter()
    drive = smooth(sine_drive(frequency_hz, amplitude_m_s2))
    ramp_periods = math.ceil(RAMP_S * frequency_hz)
    periods = max(FIRST_PERIODS, math.ceil(FIRST_PERIODS_S * frequency_hz))
    step = 1.0 / (SAMPLES_PER_PERIOD * frequency_hz)
    limit = max(periods, math.floor((longest_s * frequency_hz) - ramp_periods))
    while True:
        total = ramp_periods + periods
        motion = test.simulate(drive, total / frequency_hz, step, activation_check, name)
        lever, seat = (_periods(signal, total, name) for signal in (motion.lever, motion.seat))
        acceleration = -((2.0 * math.pi * frequency_hz) ** 2) * seat[:, 1]
        fundamentals = lever[-COMPARED_PERIODS:, 1] / acceleration[-COMPARED_PERIODS:]
        response = complex(fundamentals[-1])
        scatter = float(np.max(np.abs(fundamentals - response)) / abs(response))
        if scatter <= SETTLED or periods >= limit:
            break
        periods = min(2 * periods, limit)
    last = lever[-1]
    return HarmonicPoint(
        frequency_hz=frequency_hz,
        amplitude_m_s2=float(abs(acceleration[-1])),
        response=response,
        harmonics=tuple(float(abs(last[k] / last[1])) for k in range(2, HARMONICS + 1)),
        drift=float(last[0].real / abs(last[1])),
        settled=scatter <= SETTLED,
        scatter=scatter,
        simulated_s=total / frequency_hz,
        seconds=clock.perf_counter() - started,
    )


def _periods(signal: Floats, count: int, name: str) -> Complexes:
    """Fourier coefficients (count, harmonics) of every whole period: x = Re sum_k c_k exp(j k w t)."""
    wanted = count * SAMPLES_PER_PERIOD
    if len(signal) < wanted:
        raise EvaluationError(
            "virtual test", f"{name}: the motion has {len(signal)} rows where {wanted} were asked for"
        )
    blocks = signal[:wanted].reshape(count, SAMPLES_PER_PERIOD)
    coefficients: Complexes = np.fft.rfft(blocks, axis=1)[:, : HARMONICS + 1] / SAMPLES_PER_PERIOD
    coefficients[:, 1:] *= 2.0
    return coefficients


# ---- random test -----------------------------------------------------------------------------------------------------


def random_test(
    test: VirtualTest,
    amplitude_m_s2: float,
    duration_s: float = 32.0,
    activation_check: bool = False,
    seed: int = 1,
    name: str = "random",
    progress: Callable[[int, int], None] | None = None,
) -> RandomEstimate:
    """Move the seat by random motions of 1 to 10 Hz and estimate the response by H1.

    EvaluationError if the motion is too short to estimate from.

    Each realisation is a sum of sines, 1/8 Hz apart, of equal acceleration and random phase; it repeats after 8 s, and
    one whole period is evaluated once the start has died away, so that nothing leaks. Averaging over realisations, each
    with its own phases, leaves the best linear approximation; what is not linear shows as a coherence below one.

    Parameters
    ----------
    amplitude_m_s2 : float
        sqrt(2) times the root mean square of the acceleration: the power of a sine of that amplitude.
    duration_s : float
        Evaluated time; rounded up to whole periods, two at least.
    seed : int
        Of the phases.
    progress : callable, optional
        Told how many realisations are done, of how many.
    """
    import time as clock

    from scipy import signal

    started = clock.perf_counter()
    realisations = max(2, math.ceil(duration_s / PERIOD_S - 1e-9))
    lines = np.arange(round(BAND_HZ[0] * PERIOD_S), round(BAND_HZ[1] * PERIOD_S) + 1)
    frequencies = lines / PERIOD_S
    amplitudes = np.full(len(lines), amplitude_m_s2 / math.sqrt(len(lines)))
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi, (realisations, len(lines)))
    step = 1.0 / SAMPLING_HZ
    per_period, skip = round(PERIOD_S * SAMPLING_HZ), round((RAMP_S + SETTLING_S) * SAMPLING_HZ)
    inputs, outputs = np.empty((realisations, per_period)), np.empty((realisations, per_period))
    total = RAMP_S + SETTLING_S + PERIOD_S
    for k in range(realisations):
        drive = smooth(multisine_drive(frequencies, amplitudes, phases[k]))
        motion = test.simulate(drive, total, step, activation_check, f"{name}_{k + 1}")
        if len(motion.time) < skip + per_period:
            raise EvaluationError(
                "virtual test",
                f"{name}: the motion has {len(motion.time)} rows where {skip + per_period} were asked for",
            )
        window = slice(skip, skip + per_period)
        arguments = 2.0 * math.pi * np.outer(motion.time[window], frequencies) + phases[k]
        inputs[k] = -np.sin(arguments) @ amplitudes
        outputs[k] = motion.lever[window]
        if progress is not None:
            progress(k + 1, realisations)
    spectral = {"fs": SAMPLING_HZ, "window": "boxcar", "nperseg": per_period, "noverlap": 0, "detrend": "constant"}
    x, y = inputs.ravel(), outputs.ravel()
    _, P_xx = signal.welch(x, **spectral)
    _, P_xy = signal.csd(x, y, **spectral)
    _, coherence = signal.coherence(x, y, **spectral)
    return RandomEstimate(
        frequency_hz=frequencies,
        response=np.asarray(P_xy[lines] / P_xx[lines], dtype=np.complex128),
        coherence=np.asarray(coherence[lines]),
        rms_m_s2=float(np.sqrt(np.mean(x**2))),
        realisations=realisations,
        simulated_s=realisations * total,
        seconds=clock.perf_counter() - started,
    )
