"""Forces of the nonlinear elements of a closed deck along a periodic motion: friction and stops of the lever, muscles.

The same laws as the solver's elements (docs/theory/elements.md), evaluated at the samples of one period. What the
linear model has of them already is taken off.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pilotgen.closed_loop.muscles import F2_AT_REST, MuscleData, f1, f2, f3
from pilotgen.decks.vehicle import KAPPA, Friction
from pilotgen.solver.descriptor import Floats

PERIODS = 2  # through which bristles are followed where they do not slide freely; the last one counts
SLID = 4.0  # of the elastic travel; beyond it they slide
BRISTLE_STEPS = 1024  # of the bristles in a period, at least


def friction_force(friction: Friction, velocity: Floats, period_s: float) -> Floats:
    """Friction at the grip along a periodic motion, positive against positive velocity.

    Parameters
    ----------
    friction : Friction
        Of the lever.
    velocity : ndarray, shape (n,)
        Of the grip at n instants, equally spaced over one period [m/s].
    period_s : float
        The period [s].

    Returns
    -------
    ndarray, shape (n,)
        [N].
    """
    n = len(velocity)
    if friction.model == "coulomb":  # its sign is averaged over a sample, or turns would jump from one to the next
        change = 0.25 * np.abs(np.roll(velocity, -1) - np.roll(velocity, 1))
        sign = np.clip(velocity / np.maximum(change, 1e-300), -1.0, 1.0)
        return np.asarray(sign * _level(friction, velocity) + friction.viscous_n_s_per_m * velocity)
    within = -(-BRISTLE_STEPS // n)  # steps in a sample
    at = np.arange(n * within) / within
    v = np.interp(at, np.arange(n + 1), np.append(velocity, velocity[0]))
    h = period_s / len(v)
    k, c = friction.bristle_n_per_m, friction.bristle_n_s_per_m
    forces = np.zeros(len(v))
    midway = 0.5 * (v + np.roll(v, -1))
    ends = _level(friction, midway) / k
    first = int(np.argmax(np.abs(midway)))
    moves, limits = np.roll(midway * h, -first), np.roll(ends, -first)
    slid = 0.25 * np.abs(moves).sum() > SLID * limits.max()  # before that instant: where its bristles are is known
    z = math.copysign(limits[0], moves[0]) if slid else 0.0
    steps = list(zip(moves.tolist(), limits.tolist(), strict=True))
    for _ in range(1 if slid else PERIODS):
        for i, (move, zs) in enumerate(steps):
            forces[i] = z
            alpha = _alpha(z, move, zs)
            if alpha == 0.0 or move == 0.0:
                z += move
            else:  # dz/du = 1 - alpha |..| z/zs, exact for constant alpha
                target = math.copysign(zs / alpha, move)
                z = target + (z - target) * math.exp(-alpha * abs(move) / zs)
    forces = np.roll(forces, first)
    rate = np.gradient(np.append(forces, forces[0]), h)[:-1]
    return np.asarray((k * forces + c * rate + friction.viscous_n_s_per_m * v)[::within])


def _level(friction: Friction, v: Floats) -> Floats:
    drop = friction.breakout_n - friction.sliding_n
    return np.asarray(friction.sliding_n + drop * np.exp(-np.abs(v) / friction.velocity_m_s))


def _alpha(z: float, move: float, zs: float) -> float:
    """Share of sliding (Dupont et al. 2002), as MBDyn's modlugre has it."""
    if z * move <= 0.0 or abs(z) <= KAPPA * zs:
        return 0.0
    if abs(z) >= zs:
        return 1.0
    return 0.5 + 0.5 * math.sin(math.pi * (abs(z) - 0.5 * (1.0 + KAPPA) * zs) / ((1.0 - KAPPA) * zs))


@dataclass(frozen=True)
class GripStops:
    """Ends of the grip's travel [m] and their stiffness at the grip [N/m]."""

    low_m: float
    high_m: float
    stiffness_n_per_m: float

    def stiffness(self, travel: Floats) -> Floats:
        """By which the force rises [N/m]; any shape."""
        return np.where((travel > self.high_m) | (travel < self.low_m), self.stiffness_n_per_m, 0.0)

    def force(self, travel: Floats) -> Floats:
        """Force against positive travel [N]; any shape."""
        beyond = np.maximum(travel - self.high_m, 0.0) - np.maximum(self.low_m - travel, 0.0)
        return np.asarray(self.stiffness_n_per_m * beyond)


@dataclass(frozen=True, eq=False)
class MuscleLaw:
    """All muscles of a pilot with their reflexes, about his posture.

    Attributes
    ----------
    data : MuscleData
        Muscles in the posture.
    proportional_gain, derivative_gain : float
        Of the reflexes.
    clipped : bool
        Whether activations end at 0 and 1.
    """

    data: MuscleData
    proportional_gain: float
    derivative_gain: float
    clipped: bool = True

    def force(self, stretch: Floats, rate: Floats) -> Floats:
        """Tensions [N] at relative stretches from the posture and their rates [1/s], all (muscles, n)."""
        d = self.data
        x, v = d.x[:, None] + stretch, rate / d.velocity_factor
        a = d.activation[:, None] + self.proportional_gain * stretch + self.derivative_gain * v
        if self.clipped:
            a = np.clip(a, 0.0, 1.0)
        return np.asarray(d.F0_n[:, None] * (f1(x) * f2(v) * a + f3(x)))

    def slopes(self) -> tuple[Floats, Floats]:
        """Derivatives by stretch and by its rate [N, N s] in the posture without clipping, shape (muscles,) each."""
        d, step = self.data, 1e-20j
        by_f1 = np.imag(_f1(d.x + step)) / step.imag
        by_f3 = np.imag(1.3 * np.arctan(0.1 * (d.x + step - 0.22) ** 10)) / step.imag
        by_f2 = float(np.imag(1.6 - 1.6 * np.exp(0.1 / (step - 1.0) ** 2 - 1.1 / (step - 1.0) ** 4)) / step.imag)
        stiff = by_f1 * F2_AT_REST * d.activation + f1(d.x) * F2_AT_REST * self.proportional_gain + by_f3
        damp = f1(d.x) * (by_f2 * d.activation + F2_AT_REST * self.derivative_gain)
        return np.asarray(d.F0_n * stiff), np.asarray(d.F0_n * damp / d.velocity_factor)

    def excess(self, stretch: Floats, rate: Floats) -> Floats:
        """Force beyond what the linear model has [N], (muscles, n)."""
        rest, stiff, damp = self._linear
        return np.asarray(self.force(stretch, rate) - rest - stiff * stretch - damp * rate)

    def slopes_along(self, stretch: Floats, rate: Floats) -> tuple[Floats, Floats]:
        """Derivatives by stretch and by its rate along a motion [N, N s], (muscles, n) each."""
        h, k = 1e-6, 1e-6 * self.data.velocity_factor
        by_stretch = (self.force(stretch + h, rate) - self.force(stretch - h, rate)) / (2.0 * h)
        by_rate = (self.force(stretch, rate + k) - self.force(stretch, rate - k)) / (2.0 * k)
        return by_stretch, by_rate

    @cached_property
    def _linear(self) -> tuple[Floats, Floats, Floats]:
        """Force at rest and slopes, (muscles, 1) each."""
        zero = np.zeros((len(self.data.x), 1))
        rest = MuscleLaw(self.data, self.proportional_gain, self.derivative_gain, False).force(zero, zero)
        stiff, damp = self.slopes()
        return rest, stiff[:, None], damp[:, None]


def _f1(x: np.ndarray) -> np.ndarray:
    u = x - 0.95
    return np.asarray(np.exp(u**2 - 40.0 * u**4))
