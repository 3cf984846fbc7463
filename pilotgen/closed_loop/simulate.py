"""The closed deck moved in time: a kick or turbulence, what follows, and whether it grows.

Kicks are pulses (1 - cos)/2: a force at the grip, rising air, or a pull by the pilot, who shifts the lengths that his
reflexes hold. Small ones follow the linear poles (`fit` finds them again); large ones show activations at their ends,
muscle curves, friction, the lever's stops.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pilotgen.closed_loop.deck import START_S, ClosedLoop, Disturbance, friction_of, pulse
from pilotgen.closed_loop.poles import eigenvalues
from pilotgen.context import EvaluationContext
from pilotgen.decks.text import number
from pilotgen.decks.vehicle import Friction
from pilotgen.errors import EvaluationError, MatrixError, SolverError
from pilotgen.files import write_text
from pilotgen.hdf5 import opened, text
from pilotgen.population.shares import Share
from pilotgen.solver.descriptor import Complexes, Floats
from pilotgen.virtual.virtual_test import MOTION_FILETYPE, MOTION_VERSION, smooth

KICKS: dict[str, tuple[str, float, float]] = {  # name -> (unit, usual size, usual duration of the pulse [s])
    "lever": ("N", 20.0, 0.2),
    "gust": ("m/s", 3.0, 0.5),
    "pull": ("m", 0.03, 0.3),
    "turbulence": ("m/s rms", 1.0, 0.0),
}
TIME_LIMIT_S = 600.0
STEP_S = 1e-3
TURBULENCE_HZ, TURBULENCE_LINES, TURBULENCE_CORNER_HZ = (0.1, 10.0), 100, 0.3  # corner estimated: hover near the ground
SETTLING_S = 0.3  # after a pulse, before the fit
FIT_HZ = 100.0  # sampling of a motion for the fit
SHORTEST_FIT_S = 1.0  # of a motion, three periods of bounce; less tells no growth
FIT_RANK = 1e-7  # singular values below this share of the largest are noise
QUIET_M = 1e-4  # grip motion below this is rest


@dataclass(frozen=True)
class LoopMotion:
    """One motion of a closed loop.

    Attributes
    ----------
    time : ndarray, shape (n,)
        [s], equally spaced.
    travel : ndarray, shape (n,)
        Of the grip along its arc, from rest, up positive [m].
    height, acceleration : ndarray, shape (n,)
        Of the seat, up positive [m], [m/s^2].
    pitch : ndarray, shape (n,)
        Blade pitch, from rest [rad].
    activation, force : ndarray, shape (n, muscles)
        Of the muscles [-], [N].
    muscles : tuple of str
        Their names.
    stops_m : tuple of float
        Travel to the lower and to the upper stop [m].
    """

    time: Floats
    travel: Floats
    height: Floats
    acceleration: Floats
    pitch: Floats
    activation: Floats
    force: Floats
    muscles: tuple[str, ...]
    stops_m: tuple[float, float]

    @property
    def hits_stop(self) -> bool:
        """Whether the lever met one of its stops."""
        low, high = self.stops_m
        return bool(self.travel.min() < low or self.travel.max() > high)

    @property
    def clipped(self) -> float:
        """Share of muscles and instants at which an activation is at 0 or 1."""
        return float(np.mean((self.activation <= 0.0) | (self.activation >= 1.0)))


@dataclass(frozen=True)
class Fit:
    """A decaying or growing oscillation of a motion.

    Attributes
    ----------
    growth_rad_s, omega_rad_s : float
        Real and imaginary part of the pole [rad/s].
    amplitude_m : float
        Of the grip at the start of the fit [m].
    """

    growth_rad_s: float
    omega_rad_s: float
    amplitude_m: float

    @property
    def frequency_hz(self) -> float:
        """Damped frequency [Hz]."""
        return self.omega_rad_s / (2.0 * math.pi)


def disturbance(kind: str, size: float, duration_s: float | None = None, seed: int = 1) -> Disturbance:
    """What `KICKS` names, as drives.

    Parameters
    ----------
    kind : str
        `lever` [N at the grip], `gust` [m/s], `pull` [m of wanted travel], `turbulence` [m/s rms].
    size : float
        Peak of the pulse, or root mean square.
    duration_s : float, optional
        Of the pulse; the usual one if not given.
    seed : int
        Of the phases of turbulence.
    """
    if kind == "turbulence":
        return Disturbance(gust=turbulence(size, seed))
    length = duration_s if duration_s is not None else KICKS[kind][2]
    return Disturbance(**{kind: pulse(size, length)})


def turbulence(rms_m_s: float, seed: int) -> str:
    """Drive of band-limited rising air: lines 0.1 Hz apart from 0.1 to 10 Hz, power falling as 1/(1 + (f/f0)^2)."""
    f = np.linspace(*TURBULENCE_HZ, TURBULENCE_LINES)
    power = 1.0 / (1.0 + (f / TURBULENCE_CORNER_HZ) ** 2)
    amplitude = rms_m_s * np.sqrt(2.0 * power / power.sum())
    early = np.random.default_rng(seed).uniform(0.0, 1.0, f.size) / f  # a sine that began before has any phase
    lines = [
        f"sine, {number(-t)}, {number(2.0 * math.pi * frequency)}, {number(a)}, forever, 0."
        for t, frequency, a in zip(early.tolist(), f.tolist(), amplitude.tolist(), strict=True)
    ]
    return smooth(f"array, {len(lines)},\n\t" + ",\n\t".join(lines))


def simulate(
    context: EvaluationContext,
    loop: ClosedLoop,
    acts: Disturbance,
    duration_s: float,
    *,
    linear: bool = False,
    friction: Friction | None = None,
    integrator: str = "ms",
    step_s: float = STEP_S,
    keep: Path | None = None,
    name: str = "loop",
) -> LoopMotion:
    """Integrate the closed deck.

    Parameters
    ----------
    context : EvaluationContext
        Whose solver integrates.
    loop : ClosedLoop
        The loop.
    acts : Disturbance
        What acts on it.
    duration_s : float
        Length of the motion [s].
    linear : bool
        Without stops and without clipping of activations; muscle curves and geometry stay as they are.
    friction : Friction, optional
        Of the lever.
    integrator : str
        `ms`, MBDyn's own method at a fixed step, or `ida`.
    step_s : float
        Time step, and distance of the rows [s]. Where the solver asks for a shorter one (bristles that turn in a fast
        motion), the motion is made again with a half and a quarter of it, in rows as before.
    keep : Path, optional
        `NAME.mbd` and `NAME.motion.h5`, with all channels, stay there.
    name : str
        What they are called.

    Raises
    ------
    EvaluationError
        The solver could not go on, which is told with the time.
    """
    where = keep if keep is not None else Path(context.scratch)
    context.put_modes(loop.pilot.torso)
    output = where / f"{name}.motion.h5"
    muscles = loop.pilot.activations.muscle_names
    wanted = ["grip_travel.x", "height.x", "climb_rate.x", "blade_pitch.x"]
    wanted += [f"muscle[{muscle}].{what}" for what in ("activation", "force") for muscle in muscles]
    limit, context.time_limit_s = context.time_limit_s, TIME_LIMIT_S
    options: dict[str, Any] = {} if keep is not None else {"channels": wanted}
    if integrator == "ida":
        options |= {"rtol": 1e-7, "atol": 1e-10}
    try:
        for parts in (1, 2, 4):
            deck = loop.deck(
                acts,
                friction=friction,
                stops=not linear,
                activation_check=not linear,
                final_time_s=duration_s,
                time_step_s=step_s / parts,
            )
            if keep is not None:
                write_text(keep / f"{name}.mbd", deck)
            try:
                context.ask("integrate", deck, f"{name}.mbd", output, integrator=integrator, every=parts, **options)
                break
            except SolverError as error:
                if parts == 4 or "use a shorter time step" not in error.reason:
                    raise
    finally:
        context.time_limit_s = limit
    with opened(output, MOTION_FILETYPE, (MOTION_VERSION, 0), MatrixError) as file:
        time, data = np.asarray(file["time"][()]), file["data"][()]
        names = [text(channel).rstrip("\0") for channel in file["channels/name"][()]]
    place = {channel: i for i, channel in enumerate(names)}
    found = data[:, [place[channel] for channel in wanted]]
    if not np.isfinite(found).all():
        raise EvaluationError("simulate", "the motion has values that are not finite")
    n = len(muscles)
    return LoopMotion(
        time=time,
        travel=found[:, 0],
        height=found[:, 1],
        acceleration=np.gradient(found[:, 2], time),
        pitch=found[:, 3],
        activation=found[:, 4 : 4 + n],
        force=found[:, 4 + n :],
        muscles=muscles,
        stops_m=loop.travel_to_stops_m(),
    )


# ---- what a motion does ----------------------------------------------------------------------------------------------


def exponentials(signal: Floats, step_s: float, most: int = 20) -> tuple[Complexes, Complexes]:
    """A signal as a sum of exponentials, by the matrix pencil: poles [rad/s] and amplitudes at its start.

    Hua and Sarkar (1990), IEEE Trans. ASSP 38. Shapes: signal (n,), results (k,), k at most `most`.
    """
    n = len(signal)
    L = n // 3
    Y = np.lib.stride_tricks.sliding_window_view(signal, L + 1)
    _, sizes, Vh = np.linalg.svd(Y, full_matrices=False)
    rank = min(most, int((sizes > FIT_RANK * sizes[0]).sum()))
    V = Vh[:rank].T
    z = np.linalg.eigvals(np.linalg.pinv(V[:-1]) @ V[1:]).astype(complex)
    poles = np.log(z[np.abs(z) > 1e-12]) / step_s
    powers = np.exp(np.outer(np.arange(n) * step_s, poles))
    amplitudes = np.linalg.lstsq(powers, signal.astype(complex), rcond=None)[0]
    return poles, amplitudes


def fit(motion: LoopMotion, from_s: float, to_s: float, band_hz: tuple[float, float] = (1.0, 10.0)) -> Fit | None:
    """The oscillation of the grip that has most left at the end of a stretch of the motion; None if there is none.

    Parameters
    ----------
    motion : LoopMotion
        Free after `from_s`.
    from_s, to_s : float
        The stretch [s].
    band_hz : tuple of float
        Frequencies that count.
    """
    step = float(motion.time[1] - motion.time[0])
    every = max(1, round(1.0 / (FIT_HZ * step)))
    rows = (motion.time >= from_s) & (motion.time <= to_s)
    signal = motion.travel[rows][::every]
    if every * step * len(signal) < SHORTEST_FIT_S or float(np.ptp(signal)) == 0.0:
        return None
    poles, amplitudes = exponentials(signal, every * step)
    length = every * step * (len(signal) - 1)
    inside = (poles.imag > 2.0 * math.pi * band_hz[0]) & (poles.imag < 2.0 * math.pi * band_hz[1])
    if not inside.any():
        return None
    left = np.where(inside, np.abs(amplitudes) * np.exp(poles.real * 0.5 * length), 0.0)
    k = int(np.argmax(left))
    return Fit(float(poles[k].real), float(poles[k].imag), 2.0 * float(abs(amplitudes[k])))


def swing(motion: LoopMotion, from_s: float, to_s: float) -> float:
    """Half the grip's peak-to-peak travel in a stretch, slow drift taken off [m]."""
    rows = (motion.time >= from_s) & (motion.time <= to_s)
    t, x = motion.time[rows], motion.travel[rows]
    return 0.5 * float(np.ptp(x - np.polyval(np.polyfit(t - t[0], x, 1), t - t[0])))


def grows(motion: LoopMotion) -> bool:
    """Whether the grip still swings at the end, not less than in the quarter before (between stops: nine tenths)."""
    T = float(motion.time[-1])
    before, after = swing(motion, 0.5 * T, 0.75 * T), swing(motion, 0.75 * T, T)
    low, high = motion.stops_m
    between_stops = after > 0.9 * 0.5 * (high - low)
    return after > QUIET_M and after > (0.9 if between_stops else 0.98) * before


# ---- chance of onset -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Onset:
    """Many kicks of one kind.

    Attributes
    ----------
    sizes : ndarray, shape (n,)
        Of the kicks, in their kind's unit.
    grew : ndarray of bool, shape (n,)
        Whether the motion goes on.
    """

    sizes: Floats
    grew: np.ndarray

    @property
    def smallest_that_grew(self) -> float | None:
        """None if none did."""
        return float(self.sizes[self.grew].min()) if self.grew.any() else None

    def as_dict(self, unit: str) -> dict[str, Any]:
        """For JSON: the chance with its interval, and every kick."""
        share = Share(int(self.grew.sum()), len(self.grew))
        return {
            "kicks": len(self.sizes),
            "chance": share.as_dict(),
            "chance_text": share.text(),
            "unit": unit,
            "smallest_that_goes_on": self.smallest_that_grew,
            "largest_that_dies": self.largest_that_died,
            "sizes": self.sizes.tolist(),
            "goes_on": [bool(value) for value in self.grew],
        }

    @property
    def largest_that_died(self) -> float | None:
        """None if none did."""
        return float(self.sizes[~self.grew].max()) if not self.grew.all() else None


def onset(
    context: EvaluationContext,
    loop: ClosedLoop,
    kind: str,
    rms: float,
    count: int,
    duration_s: float,
    *,
    pulse_s: float | None = None,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Onset:
    """Kick the loop `count` times with random sizes, half-normal of the root mean square `rms`.

    With the study's friction, stops and clipped activations. Kicks that a pull cannot have are cut at the stop.
    """
    sizes = np.abs(np.random.default_rng(seed).normal(0.0, rms, count))
    if kind == "pull":
        sizes = np.minimum(sizes, loop.travel_to_stops_m()[1])
    grew = np.zeros(count, dtype=bool)
    for i, size in enumerate(sizes.tolist()):
        acts = disturbance(kind, size, pulse_s, seed + i)
        motion = simulate(context, loop, acts, duration_s, friction=friction_of(loop.study))
        grew[i] = grows(motion)
        if progress is not None:
            progress(i + 1, count)
    return Onset(sizes, grew)


def free_from(kind: str, pulse_s: float | None) -> float:
    """Time from which a kicked loop is free [s]."""
    return START_S + (pulse_s if pulse_s is not None else KICKS[kind][2])


# ---- one kick, told ------------------------------------------------------------------------------------------------


def kicked(
    context: EvaluationContext,
    loop: ClosedLoop,
    kind: str,
    size: float,
    duration_s: float,
    *,
    pulse_s: float | None = None,
    linear: bool = False,
    integrator: str = "ms",
    seed: int = 1,
    keep: Path | None = None,
) -> tuple[LoopMotion, dict[str, Any]]:
    """Kick a loop once; the motion, and what is to be said of it (docs/io_formats/closed_loop.md).

    Parameters
    ----------
    context, loop, kind, size, duration_s, linear, integrator, keep
        As for `simulate` and `disturbance`; with the friction of the study unless `linear`.
    pulse_s : float, optional
        Length of the pulse [s].
    seed : int
        Of turbulence.

    Raises
    ------
    EvaluationError
        The solver could not go on.
    """
    friction = None if linear else friction_of(loop.study)
    acts = disturbance(kind, size, pulse_s, seed)
    motion = simulate(
        context, loop, acts, duration_s, linear=linear, friction=friction, integrator=integrator, keep=keep
    )
    lam = eigenvalues(loop.linearise(context, loop.deck(), Path(context.scratch)))
    swings = lam[(lam.imag > 2.0 * math.pi) & (lam.imag < 20.0 * math.pi)]
    last = swing(motion, 0.75 * duration_s, duration_s)
    stuck = friction is not None and last < QUIET_M  # no oscillation is left, whatever exponentials say
    fitted = kind != "turbulence" and not stuck
    found = fit(motion, free_from(kind, pulse_s) + SETTLING_S, duration_s) if fitted else None
    content: dict[str, Any] = {
        "kick": {"kind": kind, "size": size, "unit": KICKS[kind][0], "pulse_s": pulse_s or KICKS[kind][2]},
        "duration_s": duration_s,
        "linear": linear,
        "integrator": integrator,
        "friction_n": None if friction is None else friction.breakout_n,
        "largest_grip_travel_mm": 1e3 * float(np.abs(motion.travel).max()),
        "largest_seat_acceleration_m_s2": float(np.abs(motion.acceleration).max()),
        "share_of_activations_at_their_ends": motion.clipped,
        "hits_stop": motion.hits_stop,
        "swing_at_the_end_mm": 1e3 * last,
        "goes_on": None if kind == "turbulence" else grows(motion),
        "fit": None,
    }
    if found is not None and len(swings):
        own = complex(found.growth_rad_s, found.omega_rad_s)
        nearest = complex(swings[int(np.argmin(np.abs(swings - own)))])
        content["fit"] = {
            "growth_rad_s": found.growth_rad_s,
            "frequency_hz": found.frequency_hz,
            "nearest_pole": [nearest.real, nearest.imag],
            "relative_difference": abs(own - nearest) / abs(nearest),
        }
    return motion, content


def report_text(content: dict[str, Any]) -> str:
    """A few lines for a person."""
    kick = content["kick"]
    lasts = (
        "is the rotorcraft's own, unstable by itself" if "open_loop" in content else "lasts as long as the air moves"
    )
    end = {True: "goes on", False: "dies away", None: lasts}[content["goes_on"]]
    lines = [
        f"kick       {kick['kind']}, {kick['size']:g} {kick['unit']}"
        + (f", pulse of {kick['pulse_s']:g} s" if kick["kind"] != "turbulence" else ""),
        f"motion     {end}; grip up to {content['largest_grip_travel_mm']:.3g} mm, seat up to "
        f"{content['largest_seat_acceleration_m_s2'] / 9.81:.2g} g",
    ]
    if content["hits_stop"] and content["linear"]:
        lines.append("lever      goes beyond a stop, of which --linear has none: no lever does that")
    elif content["hits_stop"]:
        lines.append("lever      meets a stop: what follows is no linear motion, and no flight either")
    if not content["linear"]:
        share = 100.0 * content["share_of_activations_at_their_ends"]
        lines.append(f"muscles    {share:.0f} % of activations at 0 or 1")
    if content["friction_n"]:
        lines.append(f"friction   {content['friction_n']:g} N at the grip")
    if content["fit"]:
        found = content["fit"]
        lines.append(
            f"fit        {found['growth_rad_s']:+.3f} 1/s at {found['frequency_hz']:.3f} Hz; nearest pole "
            f"{found['nearest_pole'][0]:+.3f} 1/s at {found['nearest_pole'][1] / (2.0 * math.pi):.3f} Hz "
            f"({100.0 * found['relative_difference']:.3g} % away)"
        )
    if "onset" in content:
        onset_found = content["onset"]
        small, large = onset_found["smallest_that_goes_on"], onset_found["largest_that_dies"]
        lines.append(f"onset      {onset_found['chance_text']} of {onset_found['kicks']} kicks go on")
        unit = onset_found["unit"]
        if small is not None:
            lines.append(f"           smallest that goes on {small:.3g} {unit}")
        if large is not None:
            lines.append(f"           largest that dies {large:.3g} {unit}")
    return "\n".join(lines)
