"""What the arm's geometry does to a large swing, measured on the deck itself.

The balance of harmonics has a linear geometry: moment arms of muscles, directions of bones stay as in the posture. Of
an unstable loop the deck tells what that leaves out. Kicked a little and left alone, without friction, it passes
through all amplitudes, and each has its growth and frequency. The force at the grip that the balance needs to have
the same is the describing function of what it lacks, fitted by c m A: muscles that
are clipped move the mean m of the travel, and with it the arm. The mean is in proportion to A.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math

import numpy as np

from pilotgen.closed_loop.deck import ClosedLoop
from pilotgen.closed_loop.harmonic import HarmonicBalance
from pilotgen.closed_loop.simulate import disturbance, free_from, simulate
from pilotgen.closed_loop.threshold import swings
from pilotgen.evaluation import EvaluationContext
from pilotgen.solver.descriptor import Complexes, Floats

LONGEST_S = 20.0
KICKS_N = (0.3, -0.3, 0.2, -0.2, 0.13, -0.13)  # swings begin in other phases: what is not smooth in one is averaged
LEAST_M, SHARE_OF_STOPS = 4e-3, 0.5  # swings between these are looked at
FEWEST = 6  # half periods of one motion


def ring_up(context: EvaluationContext, loop: ClosedLoop, growth_rad_s: float) -> tuple[Floats, Complexes] | None:
    """Amplitudes [m] of a growing swing and their poles [rad/s], shape (k,) each; None where it grows too slowly.

    Parameters
    ----------
    context, loop
        As for `simulate`.
    growth_rad_s : float
        Of small swings, about.
    """
    most = SHARE_OF_STOPS * min(abs(end) for end in loop.travel_to_stops_m())
    if growth_rad_s <= 0.0:
        return None
    duration = 0.6 + math.log(most / 2e-4) / growth_rad_s
    if duration > LONGEST_S:
        return None
    amplitudes, poles = [], []
    for kick in KICKS_N:
        motion = simulate(context, loop, disturbance("lever", kick), duration)
        at, size, half = swings(motion, free_from("lever", None) + 0.3)
        over = np.flatnonzero(size > most)
        n = int(over[0]) if len(over) else len(size)
        kept = np.arange(len(size)) < n
        kept &= size > 0.5 * LEAST_M
        if kept.sum() < FEWEST:
            continue
        at, size, half = at[kept], size[kept], half[kept]
        x = at - at.mean()  # swings up and down differ by the mean's motion: what is smooth in time counts
        log_size, turning = np.polyfit(x, np.log(size), 3), np.polyfit(x, math.pi / half, 2)
        amplitude = np.exp(np.polyval(log_size, x))
        inner = amplitude > LEAST_M
        amplitudes.append(amplitude[inner])
        poles.append((np.polyval(np.polyder(log_size), x) + 1j * np.polyval(turning, x))[inner])
    if not amplitudes:
        return None
    order = np.argsort(np.concatenate(amplitudes))
    return np.concatenate(amplitudes)[order], np.concatenate(poles)[order]


def measured(balance: HarmonicBalance, amplitudes_m: Floats, poles: Complexes) -> complex:
    """Coefficient c of what geometry adds to the force at the grip [N/m^2].

    Parameters
    ----------
    balance : HarmonicBalance
        Of the same loop, without friction and geometry.
    amplitudes_m, poles : ndarray, shape (k,)
        From `ring_up`.

    Raises
    ------
    EvaluationError
        A swing cannot be balanced.
    """
    swing = balance.first(float(amplitudes_m[0]))
    forces, means = [], []
    for amplitude, pole in zip(amplitudes_m.tolist(), poles.tolist(), strict=True):
        force, swing = balance.missing_force(amplitude, complex(pole), swing)
        forces.append(force / amplitude)
        means.append(swing.mean_m)
    m, f = np.array(means), np.array(forces)
    return complex((m * f).sum() / (m * m).sum())
