"""Stability, crossings and nearest points of a loop by exact arithmetic: the verified mode of `margins`.

The loop's matrices are taken as exact numbers, L(j omega) as a ratio of polynomials with integer coefficients in
x = omega^2. Stability is Routh's scheme; crossings are the positive roots of Im(N conj(D)) and abs(N)^2 - abs(D)^2, the
nearest points the best of all roots of a derivative. Descartes' rule counts them: none is missed, none invented.
The method and its reasons: docs/theory/margins.md. Third of three, after `locus` and `crossings`; it shares the form of
the answer with them, and no arithmetic.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pilotgen.linear.exact import (
    Dyadic,
    Polynomial,
    Rational,
    add,
    derivative,
    divide,
    even_odd,
    gcd,
    is_hurwitz,
    multiply,
    positive_roots,
    quotient,
    value,
)
from pilotgen.linear.statespace import StateSpaceModel
from pilotgen.loop.crossings import FAINT, HUGE, LocusFeatures, Points, constant_features

_TOUCH = 32.0 * float(np.finfo(float).eps)  # an extremum this close to the circle or the axis (relative) touches it
_ONE_PLACE = 1e-6  # two crossings with values this close, and a touch between them, are one touch
_MAX_STATES = 40  # more states cost seconds
_MAX_BITS = 400_000  # entries of A that spread too far make integers too long


@dataclass(frozen=True)
class Verified:
    """What exact arithmetic says of a loop."""

    stable: bool
    features: LocusFeatures


@dataclass(frozen=True)
class _Point:
    """A point of the locus; `omega` is in rad/s."""

    omega: float
    L: complex


def affordable(model: StateSpaceModel) -> bool:
    """Whether the exact way takes well below a second or so."""
    if not 0 < model.n_states <= _MAX_STATES:
        return False
    entries = np.abs(model.A[model.A != 0.0])
    if entries.size == 0:
        return True
    spread = 53.0 + math.log2(float(entries.max())) - math.log2(float(entries.min()))
    return spread * model.n_states**2 < _MAX_BITS and spread < 1000.0


def verified(loop: Rational) -> Verified:
    """Stability and features of the loop num / den closed with unity negative feedback."""
    closed = add(loop.num, loop.den)
    stable = len(closed) == len(loop.den) and is_hurwitz(closed)
    return Verified(stable, _Features(loop.num, loop.den, loop.exponent).find())


class _Features:
    """Features of num / den in the variable s = j omega, omega = sqrt(x) 2^exponent."""

    def __init__(self, num: Polynomial, den: Polynomial, exponent: int) -> None:
        common = gcd(num, den)
        factor = math.gcd(*num, *den)
        if len(common) > 1:
            num, den = _cancel(num, den, common)
        elif factor > 1:
            num, den = [c // factor for c in num], [c // factor for c in den]
        self.num, self.den, self.exponent = num, den, exponent
        Ne, No = even_odd(num)
        De, Do = even_odd(den)
        self.G = add(multiply(Ne, De), _by_x(multiply(No, Do)))  # Re(N conj D)
        self.H = add(multiply(No, De), multiply(Ne, Do), -1)  # Im(N conj D) / omega
        self.N2 = add(multiply(Ne, Ne), _by_x(multiply(No, No)))
        self.D2 = add(multiply(De, De), _by_x(multiply(Do, Do)))
        self.real_factors = gcd(Ne, No), gcd(De, Do)  # of num and den: zeros and poles on the axis, pairs +-a

    def find(self) -> LocusFeatures:
        """All features."""
        if len(self.den) == 1:
            return constant_features(quotient(self.num[0] if self.num else 0, self.den[0]))
        plus, minus = _squares(add(self.num, self.den)), _squares(add(self.den, self.num, -1))
        nearest, distance = self._lowest(plus, self.D2)
        disk, ratio = self._lowest(plus, minus)
        circle = self._circle(nearest)
        axis = [p for p in self._axis(circle) if -HUGE < p.L.real < -FAINT]
        return LocusFeatures(_points(axis), _points(circle), _points([nearest]), _points([disk]), distance, 2.0 * ratio)

    # Points

    def _at(self, x: Dyadic) -> _Point:
        """The point at x > 0, where L has no pole."""
        size = len(self.D2) - 1
        more = max(128 - x.c.bit_length(), 0)
        more += (x.k + more) % 2
        root, half = math.isqrt(x.c << more), (x.k + more) // 2  # sqrt(x) = root 2^-half
        g, h, d = (value(p, x) << x.k * (size + 1 - len(p)) if p else 0 for p in (self.G, self.H, self.D2))
        L = complex(quotient(g, d), quotient(h * root, d << half if half >= 0 else d >> -half))
        return _Point(quotient(root << max(self.exponent, 0), 1 << (half + max(-self.exponent, 0))), L)

    def _ends(self) -> list[_Point]:
        """L at omega = 0, if it is finite there, and at infinity."""
        ends = []
        if self.den[0]:
            ends.append(_Point(0.0, complex(quotient(self.num[0] if self.num else 0, self.den[0]))))
        top = self.num[-1] if len(self.num) == len(self.den) else 0
        return [*ends, _Point(math.inf, complex(quotient(top, self.den[-1])))]

    # What is smallest

    def _lowest(self, U: Polynomial, V: Polynomial) -> tuple[_Point, float]:
        """The point where U / V is smallest, and the square root of that: every root of the derivative is tried."""
        best, smallest = _Point(math.inf, self._ends()[-1].L), math.inf
        if len(U) <= len(V):
            smallest = quotient(U[-1], V[-1]) if len(U) == len(V) else 0.0
        if V[0]:
            at_zero = quotient(U[0] if U else 0, V[0])
            if at_zero < smallest:
                best, smallest = _Point(0.0, self._ends()[0].L if self.den[0] else complex(math.inf)), at_zero
        for x in positive_roots(_numerator_of_slope(U, V)):
            v = value(V, x) << x.k * max(len(U) - len(V), 0)
            u = value(U, x) << x.k * max(len(V) - len(U), 0)
            if v and (ratio := quotient(u, v)) < smallest:
                best, smallest = self._at(x), ratio
        return best, math.sqrt(smallest)

    # Crossings

    def _circle(self, nearest: _Point) -> list[_Point]:
        f = add(self.N2, self.D2, -1)
        if not f:  # all-pass: one point stands for all
            return [nearest]
        points = [self._at(x) for x in positive_roots(f)]
        points += [end for end in self._ends() if abs(end.L) == 1.0 and self._on_circle(end.omega, f)]
        return self._with_touches(points, f, lambda x, L: _relative(f, self.D2, x))

    def _on_circle(self, omega: float, f: Polynomial) -> bool:
        return f[0] == 0 if omega == 0.0 else len(f) < len(self.D2)

    def _axis(self, circle: list[_Point]) -> list[_Point]:
        if not self.H:
            return self._real_locus(circle)
        f = self.H
        for factor in self.real_factors:
            f = divide(f, factor)
        while len(common := gcd(f, self.real_factors[1])) > 1:  # poles of L on the axis
            f = divide(f, common)
        points = [_Point(p.omega, complex(p.L.real)) for p in map(self._at, positive_roots(f))]
        points += self._ends()

        def angle(x: Dyadic, L: complex) -> float:
            return abs(L.imag) / abs(L) if L.real < 0.0 else math.inf

        return self._with_touches([p for p in points if p.L.real < 0.0], f, angle)

    def _real_locus(self, circle: list[_Point]) -> list[_Point]:
        """A locus that stays on the real axis counts once, where it is nearest to -1 in decibels."""
        points = circle + self._ends()
        points += [self._at(x) for x in positive_roots(_numerator_of_slope(self.N2, self.D2)) if value(self.D2, x)]
        negative = [p for p in points if -HUGE < p.L.real < -FAINT]
        return sorted(negative, key=lambda p: abs(math.log(-p.L.real)))[:1]

    def _with_touches(
        self, points: list[_Point], f: Polynomial, miss: Callable[[Dyadic, complex], float]
    ) -> list[_Point]:
        """The crossings, and the extrema of f that no double can tell from a touch."""
        slope = derivative(f)
        bend = derivative(slope)
        for x in positive_roots(slope):
            if not value(self.D2, x):
                continue
            touch = self._at(x)
            if not (abs(touch.L) and miss(x, touch.L) <= _TOUCH):
                continue
            same = [p for p in points if abs(p.L - touch.L) <= _ONE_PLACE * abs(touch.L)]
            if len(same) > 1:
                points = [p for p in points if p not in same] + [touch]
            elif not same and (value(f, x) > 0) == (value(bend, x) > 0):
                points.append(touch)
        return points


def _cancel(num: Polynomial, den: Polynomial, common: Polynomial) -> tuple[Polynomial, Polynomial]:
    """num / den without a common factor; the sign and size of the ratio stay."""
    n, d = divide(num, common), divide(den, common)
    # `divide` works on primitive parts: put the contents back
    up, down = math.gcd(*num), math.gcd(*den)
    shared = math.gcd(up, down)
    return [c * (up // shared) for c in n], [c * (down // shared) for c in d]


def _squares(p: Polynomial) -> Polynomial:
    """abs(p(j omega))^2 as a polynomial in x = omega^2."""
    even, odd = even_odd(p)
    return add(multiply(even, even), _by_x(multiply(odd, odd)))


def _by_x(p: Polynomial) -> Polynomial:
    return [0, *p] if p else []


def _numerator_of_slope(U: Polynomial, V: Polynomial) -> Polynomial:
    return add(multiply(derivative(U), V), multiply(U, derivative(V)), -1)


def _relative(f: Polynomial, size: Polynomial, x: Dyadic) -> float:
    """abs(f) / size at x, size of the same degree or higher."""
    return abs(quotient(value(f, x) << x.k * (len(size) - len(f)), value(size, x)))


def _points(points: list[_Point]) -> Points:
    points = sorted(points, key=lambda p: p.omega)
    return Points(np.array([p.omega for p in points], dtype=float), np.array([p.L for p in points], dtype=complex))
