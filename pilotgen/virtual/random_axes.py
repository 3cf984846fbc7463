"""Random test of several seat motions at once: the feedthrough matrix by a multiple-input H1 estimate.

All motions are imposed together, each by its own sum of sines of the same frequencies and independent random phases.
With more realisations than motions the spectral matrix of the inputs can be inverted at every line.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pilotgen.errors import EvaluationError, StudyError
from pilotgen.linear.imposed_motion import SEAT_MOTIONS
from pilotgen.solver.descriptor import Complexes, Floats
from pilotgen.virtual.virtual_test import RAMP_S, SAMPLING_HZ, VirtualTest, multisine_drive, smooth


@dataclass(frozen=True)
class MatrixEstimate:
    """What random tests of k motions found of p rotations.

    Attributes
    ----------
    frequency_hz : ndarray, shape (m,)
        The excited frequencies [Hz].
    response : ndarray, shape (m, p, k)
        H1 estimate [rad per m/s^2 or rad/s^2], without washout.
    coherence : ndarray, shape (m, p)
        Multiple coherence: the share of each output's power that all inputs together explain.
    realisations : int
        Independent random motions.
    """

    frequency_hz: Floats
    response: Complexes
    coherence: Floats
    realisations: int


def random_matrix_test(
    test: VirtualTest,
    motions: Sequence[str],
    outputs: Sequence[str],
    amplitude_m_s2: float,
    lever_arm_m: float = 0.5,
    realisations: int | None = None,
    period_s: float = 4.0,
    band_hz: tuple[float, float] = (1.0, 8.0),
    settling_s: float = 6.0,
    seed: int = 1,
    name: str = "random_axes",
) -> MatrixEstimate:
    """Move the seat in several directions at once and estimate the matrix of responses.

    Parameters
    ----------
    test : VirtualTest
        The pilot whose seat is moved.
    motions : sequence of str
        Names of `SEAT_MOTIONS`; rotations about the seat's node.
    outputs : sequence of str
        Unknowns that are watched, rotations relative to the seat, such as `lever.gz`.
    amplitude_m_s2 : float
        sqrt(2) times the root mean square of each translational acceleration.
    lever_arm_m : float
        Rotations have this much less: amplitude_m_s2 / lever_arm_m [rad/s^2].
    realisations : int, optional
        Twice the number of motions by default; at least that number plus one.
    period_s, band_hz : float, tuple of float
        Of the multisines.
    settling_s : float
        Time for the start to die away: the slowest motion of two arms decays as exp(-1.2 t).
    seed : int
        Of the phases.

    Raises
    ------
    StudyError
        Fewer realisations than inputs plus one.
    EvaluationError
        The solver gave up.
    """
    k = len(motions)
    count = 2 * k if realisations is None else realisations
    if count < k + 1:
        raise StudyError(f"{k} motions need at least {k + 1} realisations; got {count}")
    lines = np.arange(round(band_hz[0] * period_s), round(band_hz[1] * period_s) + 1)
    frequencies = lines / period_s
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi, (count, k, len(lines)))
    per_period, skip = round(period_s * SAMPLING_HZ), round((RAMP_S + settling_s) * SAMPLING_HZ)
    X = np.empty((count, k, len(lines)), dtype=np.complex128)
    Y = np.empty((count, len(outputs), len(lines)), dtype=np.complex128)
    total = RAMP_S + settling_s + period_s
    for r in range(count):
        drives = {}
        for j, motion in enumerate(motions):
            amplitude = amplitude_m_s2 / (lever_arm_m if SEAT_MOTIONS[motion].rotation else 1.0)
            amplitudes = np.full(len(lines), amplitude / math.sqrt(len(lines)))
            drives[motion] = smooth(multisine_drive(frequencies, amplitudes, phases[r, j]))
        time, seat, turned = test.record(drives, motions, outputs, total, 1.0 / SAMPLING_HZ, False, f"{name}_{r + 1}")
        if len(time) < skip + per_period:
            raise EvaluationError(
                "virtual test", f"{name}: the motion has {len(time)} rows; {skip + per_period} wanted"
            )
        window = slice(skip, skip + per_period)
        X[r] = -((2.0 * math.pi * frequencies) ** 2) * np.fft.rfft(seat[window], axis=0)[lines].T
        Y[r] = np.fft.rfft(turned[window], axis=0)[lines].T
    S_xx = np.einsum("rim,rjm->mij", X, X.conj())
    S_yx = np.einsum("rim,rjm->mij", Y, X.conj())
    S_yy = np.einsum("rim,rim->mi", Y, Y.conj()).real
    H = np.linalg.solve(S_xx.transpose(0, 2, 1), S_yx.transpose(0, 2, 1)).transpose(0, 2, 1)
    explained = np.einsum("mij,mij->mi", H, S_yx.conj()).real
    return MatrixEstimate(frequencies, H, explained / S_yy, count)
