"""A swing as harmonics: of all unknowns of a deck, and of the grip's travel.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from pilotgen.solver.descriptor import Complexes, Floats


@dataclass(frozen=True)
class Swing:
    """A balanced swing.

    Attributes
    ----------
    growth_rad_s, omega_rad_s : float
        Of its first harmonic [rad/s].
    unknowns : ndarray of complex, shape (n, K + 1)
        Of all unknowns of the deck: mean, then y = Re sum c_k e^(j k omega t).
    travel_m : ndarray, shape (samples,)
        Of the grip along its arc, over one period.
    evaluations : int
        Of the deck's residuals along a period.
    """

    growth_rad_s: float
    omega_rad_s: float
    unknowns: Complexes = field(repr=False)
    travel_m: Floats = field(repr=False)
    evaluations: int = 0

    @property
    def pole(self) -> complex:
        """[rad/s]."""
        return complex(self.growth_rad_s, self.omega_rad_s)

    @property
    def amplitude_m(self) -> float:
        """First harmonic of the grip's travel [m]."""
        n = len(self.travel_m)
        return float(2.0 / n * abs(self.travel_m @ np.exp(-2j * math.pi * np.arange(n) / n)))

    @property
    def frequency_hz(self) -> float:
        """[Hz]."""
        return self.omega_rad_s / (2.0 * math.pi)

    @property
    def mean_m(self) -> float:
        """Mean travel of the grip [m]."""
        return float(self.travel_m.mean())

    @property
    def swing_m(self) -> float:
        """Half the grip's peak-to-peak travel, all harmonics together [m]."""
        return 0.5 * float(np.ptp(self.travel_m))

    @property
    def harmonics(self) -> int:
        """K."""
        return int(self.unknowns.shape[1]) - 1


@dataclass(frozen=True)
class LimitCycle:
    """A swing that neither grows nor decays; whether its neighbours come to it (stable) or leave it."""

    swing: Swing
    stable: bool
    trouble: str = ""  # why it could not be refined


class Basis:
    """Harmonics to samples of a period and back."""

    def __init__(self, harmonics: int, samples: int) -> None:
        self.samples = samples
        phases = np.outer(np.arange(harmonics + 1), np.arange(samples) / samples * 2.0 * math.pi)
        self._cos, self._sin = np.cos(phases), np.sin(phases)
        self._back = np.exp(-1j * phases).T * (2.0 / samples)
        self._back[:, 0] *= 0.5

    def in_time(self, Y: Complexes) -> Floats:
        """Samples of harmonics: shape (..., K + 1) -> (..., samples)."""
        return np.asarray(Y.real @ self._cos - Y.imag @ self._sin)

    def harmonics(self, y: Floats) -> Complexes:
        """Harmonics of samples: shape (..., samples) -> (..., K + 1)."""
        return np.asarray(y @ self._back)


def reals(Z: Complexes) -> Floats:
    """Mean, then real and imaginary parts: shape (rows, K + 1) -> (rows, 2 K + 1)."""
    out = np.empty((len(Z), 2 * Z.shape[1] - 1))
    out[:, 0], out[:, 1::2], out[:, 2::2] = Z[:, 0].real, Z[:, 1:].real, Z[:, 1:].imag
    return out


def complexes(X: Floats) -> Complexes:
    """The inverse of `reals`: shape (rows, 2 K + 1) -> (rows, K + 1)."""
    return np.concatenate((X[:, :1] + 0j, X[:, 1::2] + 1j * X[:, 2::2]), axis=1)
