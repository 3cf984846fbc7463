"""Harmonic balance of a closed deck: how fast a swing of given amplitude grows, and where it stays as it is.

All unknowns of the deck are sums of harmonics; the solver tells what is left of the deck's own equations along them
(`residuals`): clipped activations, muscle curves, stops, the arm's geometry. The lever's friction, which has a memory,
is added here (`elements`). The first harmonic may grow, e^(sigma t), the others are those of a steady swing. For each
amplitude of the grip the balance gives sigma and omega; where sigma is zero there is a limit cycle: unstable if sigma
rises with the amplitude (smaller swings die, larger ones grow), stable if it falls. Newton's method knows the linear
deck and the slopes of muscles, friction and stops; Broyden's updates find out the rest. docs/theory/limit_cycles.md.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import scipy.linalg

from pilotgen.closed_loop.elements import friction_force
from pilotgen.closed_loop.krylov import broyden, gmres
from pilotgen.closed_loop.swing import Basis, Swing, complexes, reals
from pilotgen.closed_loop.swing_model import LOCK_N_PER_M, LinearDeck, SwingModel
from pilotgen.decks.vehicle import Friction
from pilotgen.errors import EvaluationError
from pilotgen.solver.descriptor import Complexes, Floats

SAMPLES, FINE = 64, 512  # of one period, at least: of the deck, of friction
PER_HARMONIC = 16  # samples of the deck
TANGENTS_EVERY = 4  # samples; the averages of slopes are those of fewer
SLOW = 1e-3  # rad/s, at which the mean motion is balanced: the height has no place of its own
MUSCLE_HARMONICS = 3  # that Newton's method knows of muscles
ROUGH, FINAL = 1e-3, 1e-5  # relative change of the last step
MOST_STEPS, RENEWALS = 10, 8
SMALL = 0.05  # relative; shorter steps may be longer than the one before, and need no new matrix
NEWTON_STEPS = 12
DIFFERENCE = 1e-6  # relative; for slopes
LARGEST_CHANGE, SHORTEST = 0.3, 0.02  # of a step, relative; shares of a step
LEAST_WEIGHT, AT_REST = 1e-6, 1e-8  # what moves less is round-off
SLOWEST_RAD_S, FASTEST_RAD_S = 1.0, 200.0  # of a swing
FAR_BEYOND = 10.0  # of presliding; swings whose slopes are those of Coulomb's law
FIRST_AMPLITUDE_M, FIRST_M_PER_N = 0.02, 0.002  # of the swing that is found first, at least; by breakout force
HALVINGS = 2  # of a step of a sweep
DECAYED_RAD_S = -6.0  # a swing that dies faster is not followed further


class HarmonicBalance:
    """A closed loop whose swings are balanced.

    Parameters
    ----------
    model : SwingModel
        The closed deck without friction.
    friction : Friction, optional
        Of the lever.
    harmonics : int
        K; 1 is the describing function.
    """

    def __init__(self, model: SwingModel, friction: Friction | None = None, harmonics: int = 1) -> None:
        self.model, self.friction, self.K = model, friction, harmonics
        self._deck = Basis(harmonics, max(SAMPLES, PER_HARMONIC * harmonics))
        self._fine = Basis(harmonics, FINE)
        self._share = 1.0  # of everything nonlinear, in homotopy
        self.evaluations = 0

    def with_harmonics(self, harmonics: int) -> HarmonicBalance:
        """The same with another number of harmonics."""
        return HarmonicBalance(self.model, self.friction, harmonics)

    def exponents(self, s: complex) -> Complexes:
        """Rates of the harmonics over themselves [rad/s], shape (K + 1,)."""
        out = 1j * s.imag * np.arange(self.K + 1)
        out[0], out[1] = max(SLOW, s.real), s
        return np.asarray(out)

    def residual(self, Y: Complexes, s: complex) -> Complexes:
        """Harmonics of what is left of the equations, (n, K + 1); `Y` of the same shape.

        EvaluationError if they have no finite value.
        """
        self.evaluations += 1
        rates = Y * self.exponents(s)
        return self._with_friction(Y, rates, s, self.model.deck.harmonics(Y, rates, self._deck.samples))

    def _with_friction(self, Y: Complexes, rates: Complexes, s: complex, R: Complexes) -> Complexes:
        """Harmonics of the deck's residuals, the lever's friction and what homotopies change added."""
        model, share = self.model, self._share
        if share != 1.0:
            R = share * R + (1.0 - share) * (model.g_y @ Y + model.g_ydot @ rates)
        if self.friction is not None:
            R -= share * np.outer(model.B[:, 0], self._friction(Y[model.lever], rates[model.lever], s, self.friction))
        R[:, 0] = R[:, 0].real
        return np.asarray(R)

    def _friction(self, g: Complexes, rate: Complexes, s: complex, friction: Friction) -> Complexes:
        """Harmonics of the friction at the grip [N] by those of the lever's rotation parameter; (K + 1,) each."""
        at, by = self._fine.in_time(g), self._fine.in_time(rate)
        velocity = self.model.lever_length_m * by / (1.0 + 0.25 * at * at)
        return self._fine.harmonics(friction_force(friction, velocity, 2.0 * math.pi / s.imag))

    def element_forces(self, Y: Complexes, s: complex) -> Complexes:
        """Harmonics of what friction and muscles have beyond the linear deck [N], shape (channels, K + 1)."""
        exponents = self.exponents(s)
        motions = self.model.C @ Y
        stretch, rate = self._deck.in_time(motions[1:]), self._deck.in_time(motions[1:] * exponents)
        out = np.zeros_like(motions)
        out[1:] = self._deck.harmonics(self.model.muscles.excess(stretch, rate))
        if self.friction is not None:
            out[0] = self._friction(Y[self.model.lever], Y[self.model.lever] * exponents, s, self.friction)
        return out

    def _slopes(self, Y: Complexes, s: complex) -> Complexes:
        """Harmonics of every channel's force by the parts of its own motion, (channels, K + 1, 2 K + 1).

        Parts are the mean, then real and imaginary parts of the harmonics; of muscles only the lower ones count. The
        averages over a period of the slopes of muscles and stops are left out: the deck's mean tangents have them.
        """
        model, basis, exponents = self.model, self._deck, self.exponents(s)
        motions = model.C @ Y
        x, v = basis.in_time(motions[1:]), basis.in_time(motions[1:] * exponents)
        m, low = 2 * self.K + 1, min(self.K, MUSCLE_HARMONICS)
        units = np.zeros((m, self.K + 1), dtype=complex)
        for p in range(m):
            units[p, (p + 1) // 2] = 1.0 if p % 2 or p == 0 else 1j
        moves, rates = basis.in_time(units), basis.in_time(units * exponents)
        out = np.zeros((len(motions), self.K + 1, m), dtype=complex)
        stiff, damp = (a - a[:, ::TANGENTS_EVERY].mean(axis=1, keepdims=True) for a in model.muscles.slopes_along(x, v))
        parts = 2 * low + 1
        response = stiff[:, None, :] * moves[:parts] + damp[:, None, :] * rates[:parts]
        out[1:, :, :parts] = np.moveaxis(basis.harmonics(response), 1, 2)
        if model.stops is not None:
            turned = basis.in_time(Y[model.lever])
            stiffness = model.stops.stiffness(model.travel_m(turned)) / (1.0 + 0.25 * turned * turned)
            out[0] += basis.harmonics((stiffness - stiffness[::TANGENTS_EVERY].mean()) * moves).T
        if self.friction is not None:
            g, rate = Y[model.lever], (Y * exponents)[model.lever]
            friction, step = self.friction, 1e-5 * abs(g[1])
            if abs(g[1]) * model.lever_length_m > FAR_BEYOND * friction.presliding_m:
                friction = dataclasses.replace(friction, model="coulomb")  # bristles hardly matter, and take time
            at = self._friction(g, rate, s, friction)
            for p in range(m):
                other = self._friction(g + step * units[p], rate + step * units[p] * exponents, s, friction)
                out[0, :, p] += (other - at) / (step * model.lever_length_m)
        return np.asarray(self._share * out)

    # ---- Newton and Broyden

    def solve(self, start: Swing, amplitude_m: float | None, tolerance: float = FINAL, near: bool = True) -> Swing:
        """The swing near another of some amplitude (of the rotation parameter), or of no growth for None.

        If it is not `near`, nothing is spent on the slopes of the residuals themselves.

        Raises
        ------
        EvaluationError
            It is not found.
        """
        model = self.model
        Y = np.zeros((len(start.unknowns), self.K + 1), dtype=complex)
        shared = min(self.K, start.harmonics) + 1
        Y[:, :shared] = start.unknowns[:, :shared]
        s = start.pole
        grip = model.C[0] @ Y[:, 1]
        Y *= np.exp(-1j * np.angle(grip) * np.arange(self.K + 1))  # phases count from the grip's
        if amplitude_m is None:
            s = complex(0.0, s.imag)
        else:
            Y *= np.where(np.arange(self.K + 1) == 0, 1.0, amplitude_m / abs(grip))
            Y[model.lever, 1] = amplitude_m / model.lever_length_m
        before, steady = self.evaluations, amplitude_m is None
        exact_first = steady and self.K > 1 and self.touches_stop(start)  # stops want the exact slopes
        try:
            Y, s = (self._by_gmres if exact_first else self._by_broyden)(Y, s, steady, tolerance)
        except EvaluationError as error:
            if not near:
                raise
            try:
                Y, s = (self._by_broyden if exact_first else self._by_gmres)(Y, s, steady, tolerance)
            except EvaluationError as other:
                raise (error if exact_first else other) from None
        return self.swing(Y, s, self.evaluations - before)

    def touches_stop(self, swing: Swing) -> bool:
        """Whether the lever meets a stop."""
        stops = self.model.stops
        return stops is not None and bool(np.any(stops.force(swing.travel_m) != 0.0))

    def _by_broyden(self, Y: Complexes, s: complex, steady: bool, tolerance: float) -> tuple[Complexes, complex]:
        """Few residuals where Newton's method knows the deck well; EvaluationError if it does not."""
        for _ in range(RENEWALS):
            newton, R = self._newton(Y, s, steady)
            weights = self._weights(Y, s)
            step = newton(R)
            size = float(np.abs(step * weights).max())
            steps: list[Floats] = []
            for _ in range(MOST_STEPS):
                share = min(1.0, LARGEST_CHANGE / max(size, 1e-300))
                Y, s = self._moved(Y, s, share * step)
                if size < tolerance:
                    return Y, s
                if share < 1.0:
                    break
                steps.append(step)
                step = broyden(newton(self.residual(Y, s)), steps, weights)
                now = float(np.abs(step * weights).max())
                if now > 2.0 * size and now > SMALL:
                    break
                size = now
        raise EvaluationError("harmonic balance", "Broyden's method goes astray")

    def _by_gmres(self, Y: Complexes, s: complex, steady: bool, tolerance: float) -> tuple[Complexes, complex]:
        """Newton's method with the slopes of the residuals themselves; steps are shortened until the next is less."""
        newton, R = self._newton(Y, s, steady)
        rough = newton(R)
        for _ in range(NEWTON_STEPS):
            weights = self._weights(Y, s)
            step = gmres(self._products(Y, s, newton, rough, weights), rough * weights) / weights
            size = float(np.abs(step * weights).max())
            share = min(1.0, LARGEST_CHANGE / max(size, 1e-300))
            before = float(np.linalg.norm(rough * weights))
            while share > SHORTEST:
                there = self._moved(Y, s, share * step)
                if size < tolerance:
                    return there
                rough = newton(self.residual(*there))
                if float(np.linalg.norm(rough * weights)) < (1.0 - 0.2 * share) * before:
                    break
                share *= 0.5
            else:
                break
            Y, s = there
            if size > SMALL:  # otherwise the matrix of before is good enough
                newton, R = self._newton(Y, s, steady)
                rough = newton(R)
        what = "steady swing" if steady else f"swing of {1e3 * abs(self.model.C[0] @ Y[:, 1]):.3g} mm"
        hertz = s.imag / (2.0 * math.pi)
        raise EvaluationError("harmonic balance", f"no {what} was found near {hertz:.2f} Hz with {self.K} harmonics")

    def _products(
        self, Y: Complexes, s: complex, newton: Callable[[Complexes], Floats], rough: Floats, weights: Floats
    ) -> Callable[[Floats], Floats]:
        """The slope of `newton` steps along a direction, all weighted; `rough` is the step from here."""

        def product(direction: Floats) -> Floats:
            off = DIFFERENCE / float(np.abs(direction).max())
            there = self.residual(*self._moved(Y, s, off * direction / weights))
            return np.asarray((rough - newton(there)) * weights / off)

        return product

    def swing(self, Y: Complexes, s: complex, evaluations: int) -> Swing:
        """Of harmonics, shape (n, K + 1), and their pole, found by some evaluations."""
        travel = self.model.travel_m(self._fine.in_time(Y[self.model.lever]))
        return Swing(s.real, s.imag, Y, travel, evaluations)

    def _weights(self, Y: Complexes, s: complex) -> Floats:
        """By which steps are measured: over the largest first harmonic of unknowns of the same kind; s over omega."""
        kinds = self.model.kind_of_unknown
        largest = np.zeros(kinds.max() + 1)
        np.maximum.at(largest, kinds, np.abs(Y[:, 1]))
        each = np.where(largest > AT_REST, 1.0 / np.maximum(largest, AT_REST), LEAST_WEIGHT)[kinds]
        block = np.repeat(each[:, None], 2 * self.K + 1, axis=1)
        block[:, 0] = LEAST_WEIGHT  # means are in no proportion to the swing, that of the height to nothing
        block[self.model.lever, 0] = each[self.model.lever]
        return np.concatenate((block.ravel(), np.full(2, 1.0 / s.imag)))

    def _moved(self, Y: Complexes, s: complex, step: Floats) -> tuple[Complexes, complex]:
        there = s + complex(step[-2], step[-1])
        if not SLOWEST_RAD_S < there.imag < FASTEST_RAD_S:  # a NaN is not between them either
            raise EvaluationError("harmonic balance", f"no swing was found near {s.imag / (2.0 * math.pi):.2f} Hz")
        return np.asarray(Y + complexes(step[:-2].reshape(len(Y), -1))), there

    def _newton(self, Y: Complexes, s: complex, steady: bool) -> tuple[Callable[[Complexes], Floats], Complexes]:
        """Steps against residuals, and the residual here.

        A step: unknowns as reals, (n, 2 K + 1) one after the other, then sigma and omega. What is fixed has a step of
        zero: sigma and the grip's phase in a steady swing, else the grip's first harmonic.
        """
        model, K = self.model, self.K
        m, exponents = 2 * K + 1, self.exponents(s)
        rates = Y * exponents
        self.evaluations += 1
        R, g_y, g_ydot = model.deck.harmonics_with_tangents(Y, rates, self._deck.samples, TANGENTS_EVERY)
        R = self._with_friction(Y, rates, s, R)
        if self._share != 1.0:
            g_y = self._share * g_y + (1.0 - self._share) * model.g_y
            g_ydot = self._share * g_ydot + (1.0 - self._share) * model.g_ydot
        linear = LinearDeck(g_y, g_ydot, model)
        decks = [linear.at(complex(each)) for each in exponents]
        slopes = self._slopes(Y, s)
        count = len(slopes)
        slopes[0, range(K + 1), [0, *range(1, m, 2)]] -= LOCK_N_PER_M  # the spring that the locked deck has too many
        slopes[0, range(1, K + 1), range(2, m, 2)] -= 1j * LOCK_N_PER_M
        blocks = np.zeros((count, m, count, m))
        for k, deck in enumerate(decks):
            block = -deck.receptances[:, :, None] * slopes[:, k][None]
            if k == 0:
                blocks[:, 0] = block.real
            else:
                blocks[:, 2 * k - 1], blocks[:, 2 * k] = block.real, block.imag
        J = blocks.reshape(count * m, count * m)
        J[range(count * m), range(count * m)] += 1.0
        parts = 2 * min(K, MUSCLE_HARMONICS) + 1
        known = (np.arange(m) < parts)[None, :] | (np.arange(count) == 0)[:, None]
        kept = np.flatnonzero(known.ravel())
        J = J[np.ix_(kept, kept)]

        def solved(right: np.ndarray) -> Complexes:
            return np.stack([deck.solve(right[:, k]) for k, deck in enumerate(decks)], axis=1)

        # s in the place of what is fixed at the grip
        growing = np.zeros(K + 1)
        growing[1] = 1.0
        turns = [(2, 1j * np.arange(K + 1))] if steady else [(1, growing), (2, 1j * np.arange(K + 1))]
        by_s = {column: solved(linear.g_ydot @ (Y * turn)) for column, turn in turns}
        for column, motion in by_s.items():
            J[:, column] = reals(model.C @ motion).ravel()[kept]
        factors = scipy.linalg.lu_factor(J, check_finite=False)

        def step(R: Complexes) -> Floats:
            Z = solved(R)
            found = scipy.linalg.lu_solve(factors, -reals(model.C @ Z).ravel()[kept], check_finite=False)
            moved = np.zeros(2)
            change = -Z
            for column, motion in by_s.items():
                moved[column - 1], found[column] = found[column], 0.0
                change -= motion * moved[column - 1]
            c = np.zeros(count * m)
            c[kept] = found
            W = np.einsum("ikp,ip->ik", slopes, c.reshape(count, m))
            for k, deck in enumerate(decks):
                change[:, k] += deck.forced @ W[:, k]
            return np.concatenate((reals(change).ravel(), moved))

        return step, R

    def first(self, amplitude_m: float = FIRST_AMPLITUDE_M) -> Swing:
        """A swing of the loop's least damped oscillation between 1 and 10 Hz that moves the grip.

        EvaluationError if it is not found.
        """
        pole, shape = self.model.least_damped()
        Y = np.zeros((len(shape), self.K + 1), dtype=complex)
        Y[:, 1] = shape * amplitude_m
        swing = self.swing(Y, pole, 0)
        if self.friction is None:  # close enough, most of the time
            try:
                return self.solve(swing, amplitude_m, ROUGH, near=False)
            except EvaluationError:
                pass
        try:
            for self._share in (0.1, 0.3, 0.6, 1.0):
                swing = self.solve(swing, amplitude_m, ROUGH)
        finally:
            self._share = 1.0
        return swing

    def sweep(self, amplitudes_m: Floats) -> tuple[list[Swing], str]:
        """Swings of many amplitudes, from `first` up and down, and what could not be followed (empty: nothing).

        Those that die at once end it; a cycle may lie beyond others that die. `amplitudes_m` has shape (n,), rising.
        EvaluationError if there is no first one.
        """
        stops = self.model.stops
        between_stops = math.inf if stops is None else 0.5 * (stops.high_m - stops.low_m)
        near, start = self._somewhere(amplitudes_m, 0.7 * between_stops)
        found, lost = {float(amplitudes_m[near]): start}, ""
        for way, beyond in ((amplitudes_m[near + 1 :], "above"), (amplitudes_m[:near][::-1], "below")):
            passed, balance = [start], self
            for amplitude in way.tolist():
                if amplitude > between_stops and balance.K > 1:
                    balance = self.with_harmonics(1)  # both stops are hard to follow
                try:
                    try:
                        balance.follow(passed, amplitude)
                    except EvaluationError:
                        if balance.K == 1:
                            raise
                        balance = self.with_harmonics(1)
                        balance.follow(passed, amplitude)
                except EvaluationError as error:
                    lost = f"swings {beyond} {1e3 * passed[-1].amplitude_m:.3g} mm were not followed: {error.reason}"
                    break
                found[amplitude] = passed[-1]
                if passed[-1].growth_rad_s < DECAYED_RAD_S:
                    break
        return [found[a] for a in sorted(found)], lost

    def _somewhere(self, amplitudes_m: Floats, most_m: float) -> tuple[int, Swing]:
        """A first swing at one of some amplitudes and its place; a larger one where friction hides it."""
        force = 0.0 if self.friction is None else self.friction.breakout_n
        wanted = max(FIRST_AMPLITUDE_M, min(FIRST_M_PER_N * force, most_m))
        near = int(np.argmin(np.abs(np.log(amplitudes_m / wanted))))
        for place in range(near, len(amplitudes_m)):
            for balance in {self.K: self, 1: self.with_harmonics(1)}.values():
                try:
                    return place, balance.first(float(amplitudes_m[place]))
                except EvaluationError as error:
                    trouble = error
        raise trouble

    def follow(self, passed: list[Swing], amplitude_m: float) -> None:
        """Add the swing of an amplitude to those passed on the way to it, with others in between where it needs them.

        EvaluationError if it cannot be reached.
        """
        step = math.log(amplitude_m / self.grip_m(passed[-1]))
        least = 0.5**HALVINGS * abs(step)
        while True:
            left = math.log(amplitude_m / self.grip_m(passed[-1]))
            if abs(left) < 1e-9:
                return
            step = math.copysign(min(abs(step), abs(left)), left)
            goal = amplitude_m * math.exp(step - left)
            near = abs(step) < 1.5 * least
            try:
                passed.append(self.solve(self._predicted(passed, goal), goal, ROUGH, near))
                step *= 2.0
            except EvaluationError:
                if near:
                    raise
                step *= 0.5

    def grip_m(self, swing: Swing) -> float:
        """Amplitude of the rotation parameter at the grip [m]."""
        return self.model.lever_length_m * float(abs(swing.unknowns[self.model.lever, 1]))

    def _predicted(self, passed: list[Swing], amplitude_m: float) -> Swing:
        """A swing of an amplitude by the line through the last two."""
        last = passed[-1]
        if len(passed) < 2 or passed[-2].harmonics != last.harmonics:
            return last
        before = passed[-2]
        a, b = self.grip_m(before), self.grip_m(last)
        share = math.log(amplitude_m / b) / math.log(b / a)
        if abs(share) > 2.0:
            return last
        Y = last.unknowns / b + share * (last.unknowns / b - before.unknowns / a)
        s = last.pole + share * (last.pole - before.pole)
        return dataclasses.replace(last, growth_rad_s=s.real, omega_rad_s=s.imag, unknowns=Y * amplitude_m)
