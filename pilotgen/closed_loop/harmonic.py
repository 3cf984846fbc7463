"""Harmonic balance of a closed deck: how fast a swing of given amplitude grows, and where it stays as it is.

The linear model of the closed deck, its nonlinear elements (`elements`) around it; the geometry of the arm stays
linear. A swing of the grip of amplitude A is a sum of harmonics; the first may grow, e^(sigma t), the others are those
of a steady swing. For each A the balance gives sigma(A) and omega(A). Where sigma is zero there is a limit cycle:
unstable if sigma rises with A (smaller swings die, larger ones grow), stable if it falls. docs/theory/limit_cycles.md.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import scipy.linalg

from pilotgen.closed_loop.deck import STOP_STIFFNESS_N_PER_M, ClosedLoop
from pilotgen.closed_loop.elements import GripStops, MuscleLaw, friction_force
from pilotgen.closed_loop.muscles import muscle_data, muscle_rows
from pilotgen.decks.vehicle import Friction
from pilotgen.errors import EvaluationError
from pilotgen.solver.descriptor import Complexes, Floats, Numbers
from pilotgen.solver.matrices import Matrices, descriptor

SAMPLES = 64  # of one period; more with more harmonics
SLOW = 1e-3  # rad/s, at which the mean motion is balanced: the height has no place of its own
TOLERANCE, MOST_STEPS = 1e-9, 40
FIRST_AMPLITUDE_M = 0.02
NEAR_RAD_S = (3.0, 90.0)  # modes of such frequencies keep amplitudes of their own
DECAYED = -25.0  # rad/s; a swing that dies faster is not followed further


@dataclass(frozen=True, eq=False)
class LinearPart:
    """Receptances of the closed deck: channel 0 is the grip (force [N], travel [m]), the others muscles.

    Of a muscle, the force is its tension [N] and the motion its relative length.

    Attributes
    ----------
    poles : ndarray of complex, shape (r,)
        [rad/s].
    left, right : ndarray of complex, shapes (r, channels), (channels, r)
        G(s) = right diag(1/(s - poles)) left + direct.
    direct : ndarray, shape (channels, channels)
        Of what has no mass.
    """

    poles: Complexes
    left: Numbers
    right: Numbers
    direct: Floats

    def at(self, s: complex) -> Complexes:
        """Motions by forces, shape (channels, channels)."""
        return np.asarray((self.right / (s - self.poles)) @ self.left + self.direct)


def linear_part(loop: ClosedLoop, matrices: Matrices) -> LinearPart:
    """Receptances from the matrices of a loop's deck (without friction).

    Raises
    ------
    EvaluationError
        The deck's eigenvectors are too close to each other for a sum over them.
    """
    g_ydot = 0.5 * (matrices.J_plus + matrices.J_minus)
    g_y = (matrices.J_plus - matrices.J_minus) / (2.0 * matrices.c)
    B, C = channels(loop, matrices)
    inverse = np.linalg.solve(matrices.J_plus, matrices.J_minus)
    Lambda, V_L, V_R = scipy.linalg.eig(inverse, left=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        lam = (Lambda - 1.0) / (Lambda + 1.0) / matrices.c
    kept = np.isfinite(lam) & (np.abs(lam) < 1e6)
    lam, V_R, V_L = lam[kept], V_R[:, kept], V_L[:, kept].conj().T
    W = np.linalg.solve(matrices.J_plus.T, V_L.T).T  # left vectors of the pencil itself
    W /= np.einsum("ki,ij,jk->k", W, g_ydot, V_R)[:, None]
    left, right = W @ B, C @ V_R

    def exact(s: complex) -> Complexes:
        return np.asarray(C @ np.linalg.solve(s * g_ydot + g_y, B.astype(complex)))

    bare = LinearPart(lam, left, right, np.zeros((len(C), B.shape[1])))
    one, two = 3.0 + 40.0j, 1.0 + 20.0j
    part = LinearPart(lam, left, right, (exact(one) - bare.at(one)).real)
    error = np.abs(part.at(two) - exact(two)).max(axis=1) / np.abs(exact(two)).max(axis=1)
    if not error.max() < 1e-6:
        raise EvaluationError("harmonic balance", f"receptances of the closed deck are good to {error.max():.1g} only")
    return part


def channels(loop: ClosedLoop, matrices: Matrices) -> tuple[Floats, Floats]:
    """Columns of forces and rows of motions in a deck's unknowns, shapes (n, channels), (channels, n).

    A positive force of a channel makes its motion smaller: friction against the grip, tension of a muscle.
    """
    own = loop.pilot.matrices
    assert own is not None
    place = {name: i for i, name in enumerate(matrices.dof_names)}
    to_deck = np.array([place.get(name, -1) for name in own.dof_names])
    data, rows = muscle_data(loop.pilot), muscle_rows(loop.pilot)
    model = descriptor(own)
    count = len(rows) + 1
    B, C = np.zeros((matrices.n, count)), np.zeros((count, matrices.n))
    C[0, place["lever.gz"]] = loop.lever_length_m
    B[place["lever.hz"], 0] = loop.lever_length_m
    C[1:, to_deck[model.coordinates]] = rows[:, model.coordinates]
    B[to_deck[model.equilibrium_rows], 1:] = (rows[:, model.coordinates] * data.l0_m[:, None]).T
    return -B, C


# ---- the balance -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Swing:
    """A balanced swing.

    Attributes
    ----------
    amplitude_m : float
        First harmonic of the grip's travel [m].
    growth_rad_s, omega_rad_s : float
        Of its first harmonic [rad/s].
    harmonics : ndarray of complex, shape (channels, K + 1)
        Of every channel's motion: mean, then y = Re sum c_k e^(j k omega t).
    modes : ndarray of complex, shape (near modes,)
        Amplitudes of the modes whose frequencies are near.
    iterations : int
        Steps of Newton's method.
    """

    amplitude_m: float
    growth_rad_s: float
    omega_rad_s: float
    harmonics: Complexes = field(repr=False)
    modes: Complexes = field(repr=False)
    iterations: int = 0

    @property
    def frequency_hz(self) -> float:
        """[Hz]."""
        return self.omega_rad_s / (2.0 * math.pi)

    @property
    def mean_m(self) -> float:
        """Mean travel of the grip [m]."""
        return float(self.harmonics[0, 0].real)

    def swing_m(self, samples: int = 256) -> float:
        """Half the grip's peak-to-peak travel, all harmonics together [m]."""
        t = np.arange(samples) / samples * 2.0 * math.pi
        k = np.arange(self.harmonics.shape[1])
        return 0.5 * float(np.ptp((self.harmonics[0][:, None] * np.exp(1j * np.outer(k, t))).real.sum(axis=0)))


class HarmonicBalance:
    """A closed loop whose swings are balanced.

    Parameters
    ----------
    linear : LinearPart
        The closed deck without its nonlinear elements.
    muscles : MuscleLaw
        Of the pilot.
    friction : Friction, optional
        Of the lever.
    stops : GripStops, optional
        Of the lever.
    harmonics : int
        K; 1 is the describing function.
    geometry : complex, optional
        What the arm's geometry adds to the first harmonic of the force at the grip, c m A for a travel of amplitude A
        and mean m [N/m^2]; from `geometry.measured`.
    """

    def __init__(
        self,
        linear: LinearPart,
        muscles: MuscleLaw,
        friction: Friction | None = None,
        stops: GripStops | None = None,
        harmonics: int = 1,
        geometry: complex | None = None,
    ) -> None:
        self.linear, self.muscles, self.friction, self.stops, self.K = linear, muscles, friction, stops, harmonics
        self.geometry = geometry
        n = SAMPLES if harmonics < 4 else SAMPLES * (harmonics // 2)
        phases = np.outer(np.arange(harmonics + 1), np.arange(n) / n * 2.0 * math.pi)
        self._to_time = np.exp(1j * phases)
        self._to_harmonics = np.exp(-1j * phases) * (2.0 / n)
        self._to_harmonics[0] *= 0.5
        self._share = 1.0  # of the nonlinear elements, in homotopy
        lam = linear.poles
        close = (lam.imag > NEAR_RAD_S[0]) & (lam.imag < NEAR_RAD_S[1])
        nothing = np.zeros_like(linear.direct)
        self._near = LinearPart(lam[close], linear.left[close], linear.right[:, close], nothing)
        self._rest = LinearPart(lam[~close], linear.left[~close], linear.right[:, ~close], linear.direct)

    def with_harmonics(self, harmonics: int) -> HarmonicBalance:
        """The same with another number of harmonics."""
        return HarmonicBalance(self.linear, self.muscles, self.friction, self.stops, harmonics, self.geometry)

    # forces by motions: complex harmonics (channels, K + 1)

    def forces(self, Y: Complexes, omega: float) -> Complexes:
        """Harmonics of the elements' forces, (channels, K + 1); `Y` those of the motions, same shape."""
        W = np.zeros_like(Y)
        rates = Y * (1j * omega * np.arange(self.K + 1))
        W[1:] = self.muscles.excess((Y[1:] @ self._to_time).real, (rates[1:] @ self._to_time).real) @ (
            self._to_harmonics.T
        )
        W[0] = self._at_the_grip(Y[0], rates[0], omega) @ self._to_harmonics.T
        W[:, 0] = W[:, 0].real
        if self.geometry is not None:
            W[0, 1] += self.geometry * Y[0, 0].real * Y[0, 1]
        return self._share * W

    def _at_the_grip(self, travel: Complexes, rate: Complexes, omega: float) -> Floats:
        total = np.zeros(self._to_time.shape[1])
        if self.friction is not None:
            total += friction_force(self.friction, (rate @ self._to_time).real, 2.0 * math.pi / omega)
        if self.stops is not None:
            total += self.stops.force((travel @ self._to_time).real)
        return total

    def balance(self, amplitude_m: float, start: Swing) -> Swing:
        """The swing of one amplitude, by Newton's method from a neighbour.

        Raises
        ------
        EvaluationError
            It is not found.
        """
        scale = np.where(np.arange(self.K + 1) == 0, 1.0, amplitude_m / start.amplitude_m)
        Y, s = start.harmonics * scale, complex(start.growth_rad_s, start.omega_rad_s)
        q = start.modes * scale[1]
        count, modes = len(Y), len(q)
        cut = count * (2 * self.K + 1)
        sizes = np.maximum(np.abs(Y[:, 1]), 1e-6 * np.abs(Y[:, 1]).max())
        for step in range(MOST_STEPS):
            F, jacobian = self._equations(Y, q, s)
            error = float(np.abs(F[:cut].reshape(count, -1) / sizes[:, None]).max())
            error = max(error, float(np.abs(F[cut:]).max(initial=0.0) / (np.abs(q).max(initial=0.0) * abs(s) + 1e-300)))
            if error < TOLERANCE:
                return Swing(amplitude_m, s.real, s.imag, Y, q, step)
            change = -np.linalg.solve(jacobian, F)
            ds = complex(change[1], change[2])
            change[1:3] = 0.0
            share = min(1.0, 0.2 * s.imag / max(abs(ds), 1e-12))
            Y = np.asarray(Y + share * _complex(np.asarray(change[:cut].reshape(count, -1), dtype=float)))
            q = q + share * (change[cut : cut + modes] + 1j * change[cut + modes :])
            s += share * ds
            if not (np.isfinite(s) and s.imag > 1.0):
                break
        raise EvaluationError(
            "harmonic balance", f"no swing of {1e3 * amplitude_m:.3g} mm was found near {start.frequency_hz:.2f} Hz"
        )

    def missing_force(self, amplitude_m: float, s: complex, start: Swing) -> tuple[complex, Swing]:
        """First harmonic of a force at the grip [N] with which a swing of one amplitude has the pole `s` [rad/s].

        Raises
        ------
        EvaluationError
            It is not found.
        """
        scale = np.where(np.arange(self.K + 1) == 0, 1.0, amplitude_m / start.amplitude_m)
        Y, q, force = start.harmonics * scale, start.modes * scale[1], 0.0 + 0.0j
        count, near = len(Y), self._near
        cut = count * (2 * self.K + 1)
        for step in range(MOST_STEPS):
            F, jacobian = self._equations(Y, q, s)
            G = self._rest.at(s)[:, 0]
            modal = -near.left[:, 0]
            for column, turn in ((1, 1.0 + 0j), (2, 1j)):
                block = np.zeros((count, 2 * self.K + 1))
                block[:, 1], block[:, 2] = (-G * turn).real, (-G * turn).imag
                jacobian[:, column] = np.concatenate((block.ravel(), (modal * turn).real, (modal * turn).imag))
            F = F + jacobian[:, 1] * force.real + jacobian[:, 2] * force.imag
            change = -np.linalg.solve(jacobian, F)
            moved = complex(change[1], change[2])
            change[1:3] = 0.0
            Y = np.asarray(Y + _complex(np.asarray(change[:cut].reshape(count, -1), dtype=float)))
            q = q + change[cut : cut + len(q)] + 1j * change[cut + len(q) :]
            force += moved
            if abs(moved) < 1e-7 * abs(force) + 1e-9:
                return force, Swing(amplitude_m, s.real, s.imag, Y, q, step)
        raise EvaluationError("harmonic balance", f"no swing of {1e3 * amplitude_m:.3g} mm at {s:.3g} rad/s was found")

    def _receptances(self, s: complex) -> list[Complexes]:
        omega = s.imag
        higher = [self.linear.at(1j * k * omega) for k in range(2, self.K + 1)]
        return [self.linear.at(max(SLOW, s.real)).real.astype(complex), self._rest.at(s), *higher]

    def _equations(self, Y: Complexes, q: Complexes, s: complex) -> tuple[Floats, Floats]:
        """Y - G W = 0 and (s - lambda) q - left W = 0 as reals, and their Jacobian.

        Near modes keep an amplitude q of their own, so that s may be one of their poles. The grip's first harmonic is
        given; s is unknown in its place.
        """
        count, m, modes = len(Y), 2 * self.K + 1, len(q)
        near = self._near
        W, G = self.forces(Y, s.imag), self._receptances(s)

        def first_block(s: complex, W: Complexes, G: list[Complexes]) -> Floats:
            moved = np.stack([G[k] @ W[:, k] for k in range(self.K + 1)], axis=1)
            moved[:, 1] += near.right @ q
            modal = (s - near.poles) * q - near.left @ W[:, 1]
            return np.concatenate((_reals(Y - moved).ravel(), modal.real, modal.imag))

        F = first_block(s, W, G)
        cut = count * m
        size = cut + 2 * modes
        jacobian = np.zeros((size, size))
        J = np.zeros((count, m, count, m))
        by_modes = np.zeros((2 * modes, count, m))
        steps = 1e-6 * (np.abs(Y[:, 1]) + 1e-3 * np.abs(Y[:, 1]).max())
        for p in range(m):  # every channel's force depends on its own motion only
            E = np.zeros((count, m))
            E[:, p] = steps
            dW = (self.forces(Y + _complex(E), s.imag) - W) / steps[:, None]
            for k in range(self.K + 1):
                block = -(G[k] * dW[:, k][None, :])
                if k == 0:
                    J[:, 0, :, p] = block.real
                else:
                    J[:, 2 * k - 1, :, p], J[:, 2 * k, :, p] = block.real, block.imag
            modal = -near.left * dW[:, 1][None, :]
            by_modes[:modes, :, p], by_modes[modes:, :, p] = modal.real, modal.imag
        jacobian[:cut, :cut] = J.reshape(cut, cut)
        jacobian[cut:, :cut] = by_modes.reshape(2 * modes, cut)
        jacobian[range(cut), range(cut)] += 1.0
        rows = np.arange(count) * m + 1
        right, own = near.right, s - near.poles
        jacobian[rows, cut : cut + modes], jacobian[rows, cut + modes :] = -right.real, right.imag
        jacobian[rows + 1, cut : cut + modes], jacobian[rows + 1, cut + modes :] = -right.imag, -right.real
        i = np.arange(modes)
        jacobian[cut + i, cut + i] = jacobian[cut + modes + i, cut + modes + i] = own.real
        jacobian[cut + i, cut + modes + i], jacobian[cut + modes + i, cut + i] = -own.imag, own.imag
        for column, ds in ((1, 1e-6 + 0j), (2, 1e-6j)):  # real and imaginary part of s
            other = self.forces(Y, (s + ds).imag) if ds.imag else W
            jacobian[:, column] = (first_block(s + ds, other, self._receptances(s + ds)) - F) / 1e-6
        return F, jacobian

    # ---- a first swing, and all of them

    def first(self, amplitude_m: float = FIRST_AMPLITUDE_M) -> Swing:
        """A swing of the loop's least damped oscillation between 1 and 10 Hz that moves the grip, elements turned on.

        EvaluationError if it is not found.
        """
        lam, shape = self.linear.poles, self.linear.right
        moves = (lam.imag > 2.0 * math.pi) & (lam.imag < 20.0 * math.pi)
        seen = np.abs(shape[0] * self.linear.left[:, 0]) / np.maximum(np.abs(lam.real), 0.3)
        if not moves.any():
            raise EvaluationError("harmonic balance", "the closed loop has no oscillation between 1 and 10 Hz")
        k = int(np.argmax(np.where(moves, seen, -1.0)))
        Y = np.zeros((len(shape), self.K + 1), dtype=complex)
        Y[:, 1] = shape[:, k] / shape[0, k] * amplitude_m
        q = np.where(self._near.poles == lam[k], amplitude_m / shape[0, k], 0.0)
        swing = Swing(amplitude_m, float(lam[k].real), float(lam[k].imag), Y, q)
        for share in (0.1, 0.3, 0.6, 1.0):
            self._share = share
            swing = self.balance(amplitude_m, swing)
        return swing

    def sweep(self, amplitudes_m: Floats) -> list[Swing]:
        """Swings of many amplitudes, from `first` up and down; those that cannot be followed are left out.

        `amplitudes_m` has shape (n,), rising.
        """
        found: dict[float, Swing] = {}
        near = int(np.argmin(np.abs(np.log(amplitudes_m / FIRST_AMPLITUDE_M))))
        start = self.first(float(amplitudes_m[near]))
        for way in (amplitudes_m[near:], amplitudes_m[:near][::-1]):
            last = start
            for amplitude in way.tolist():
                try:
                    last = self.balance(amplitude, last)
                except EvaluationError:
                    break
                found[amplitude] = last
                if last.growth_rad_s < DECAYED:
                    break
        return [found[a] for a in sorted(found)]

    def limit_cycles(self, swings: list[Swing]) -> list[LimitCycle]:
        """Where the growth of a sweep changes its sign, found to 1e-6 of the amplitude."""
        cycles = []
        for low, high in pairwise(swings):
            if low.growth_rad_s == 0.0 or low.growth_rad_s * high.growth_rad_s > 0.0:
                continue
            stable = low.growth_rad_s > 0.0
            a, b = low, high
            for _ in range(30):
                weight = a.growth_rad_s / (a.growth_rad_s - b.growth_rad_s)
                weight = min(max(weight, 0.05), 0.95)
                amplitude = math.exp((1.0 - weight) * math.log(a.amplitude_m) + weight * math.log(b.amplitude_m))
                middle = self.balance(amplitude, a if weight < 0.5 else b)
                if (middle.growth_rad_s > 0.0) == (a.growth_rad_s > 0.0):
                    a = middle
                else:
                    b = middle
                if abs(middle.growth_rad_s) < 1e-7 or b.amplitude_m / a.amplitude_m - 1.0 < 1e-6:
                    break
            cycles.append(LimitCycle(middle, stable))
        return cycles


@dataclass(frozen=True)
class LimitCycle:
    """A swing that neither grows nor decays; whether its neighbours come to it (stable) or leave it."""

    swing: Swing
    stable: bool


def _reals(Z: Complexes) -> Floats:
    """(channels, K + 1) complex -> (channels, 2 K + 1): mean, then real and imaginary parts."""
    out = np.empty((len(Z), 2 * Z.shape[1] - 1))
    out[:, 0], out[:, 1::2], out[:, 2::2] = Z[:, 0].real, Z[:, 1:].real, Z[:, 1:].imag
    return out


def _complex(X: Floats) -> Complexes:
    return np.concatenate((X[:, :1] + 0j, X[:, 1::2] + 1j * X[:, 2::2]), axis=1)


def grip_stops(loop: ClosedLoop) -> GripStops:
    """Stops of a loop's lever, at the grip."""
    return GripStops(*loop.travel_to_stops_m(), STOP_STIFFNESS_N_PER_M)


def make_balance(
    loop: ClosedLoop,
    matrices: Matrices,
    friction: Friction | None,
    harmonics: int = 1,
    clipped: bool = True,
    stops: bool = True,
    geometry: complex | None = None,
) -> HarmonicBalance:
    """The harmonic balance of a loop whose deck (without friction) has these matrices."""
    law = MuscleLaw(muscle_data(loop.pilot), loop.gains.proportional_gain, loop.gains.derivative_gain, clipped)
    ends = grip_stops(loop) if stops else None
    return HarmonicBalance(linear_part(loop, matrices), law, friction, ends, harmonics, geometry)
