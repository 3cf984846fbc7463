"""Where a loop's frequency response crosses the unit circle and the negative real axis, and where it is nearest to -1.

Method (docs/theory/margins.md): sample L(j omega) and its derivative on a grid whose spacing is a fixed fraction of the
distance to the nearest pole, from omega = 0 to infinity (the last stretch in t = 1/omega); on each interval look at the
Bernstein coefficients of the cubic Hermite interpolant, which bound it; split intervals that stay undecided; polish
what is bracketed with a safeguarded Newton iteration on the exact response.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, cached_property

import numpy as np
import numpy.typing as npt

from pilotgen.statespace import ComplexArray, FloatArray, StateSpaceModel

BoolArray = npt.NDArray[np.bool_]

_EPS = float(np.finfo(float).eps)
_SPACING = 0.25  # grid spacing over distance to the nearest pole; interpolation error about spacing^4 / 16 of a residue
_FIRST_ERROR = 0.03  # assumed interpolation error on the first grid, relative to the largest coefficient
_MAX_SPLITS = 16  # halvings; a touch that is undecided after so many is closer than _TOUCH
_MAX_OPEN = 4096  # intervals; more are open only if the locus follows the circle or the axis within round-off
_TOUCH = 1e-10  # an extremum of |L| within this of 1, or with |Im L| / |L| below this, is a touch
_FLAT = 1e-8  # a touch at both ends of an interval with slopes (times its length) below this lasts the whole interval
_AXIS = 1e-10  # a pole this close to the imaginary axis, relative to its modulus, is on it
_NOISE = 1e3 * _EPS  # |L| below this fraction of the sum of its terms' moduli is round-off
_VANISHING = 1e-12  # a moment below this fraction of what its terms' moduli could give is zero
_SAME = 1e-9  # relative distance in frequency below which two roots are one
_FAINT, _HUGE = 1e-10, 1e10  # |L| beyond which (200 dB) a crossing is of no interest and often round-off
_MAX_NEWTON = 100
_SMALL = 16  # states up to which inverting the n x n matrices in a batch beats substitution

_NEAR_END = np.array([1.0 / 64.0, 1.0 / 8.0, 1.0 / 2.0])  # extra points of the first interval and of the tail
_GUESS_POINTS = 33

# |P|^2 of a cubic with Bernstein coefficients p has the degree-6 coefficients sum_ij SQUARE[i, j, k] p_i conj(p_j).
_SQUARE = np.zeros((4, 4, 7))
for _i in range(4):
    for _j in range(4):
        _SQUARE[_i, _j, _i + _j] = math.comb(3, _i) * math.comb(3, _j) / math.comb(6, _i + _j)
_SQUARE = _SQUARE.reshape(16, 7)


@dataclass(frozen=True)
class Points:
    """Points of the locus: omega [rad/s], 0 and inf included, and L(j omega) there."""

    omega: FloatArray
    L: ComplexArray


@dataclass(frozen=True)
class LocusFeatures:
    """Crossings by rising frequency, and the points nearest to -1 in two senses.

    `nearest` minimises |1 + L|, `disk` minimises 2 |1 + L| / |1 - L|; one point each.
    """

    real_axis: Points
    unit_circle: Points
    nearest: Points
    disk: Points


class _Locus:
    """L and its derivatives at points (p, q) with omega = p/q: (omega, 1), or (1, t) on the tail t = 1/omega."""

    def __init__(self, model: StateSpaceModel) -> None:
        form = model.schur
        self.T, self.b, self.c, self.D = form.T, form.b, form.c, model.D
        self.n = model.n_states

    def first(self, x: FloatArray, tail: BoolArray) -> tuple[ComplexArray, ComplexArray, FloatArray]:
        """L, dL/dx, and the sum of the moduli of the terms of L (for its round-off), each shape (m,)."""
        L, slope, size, _ = self._evaluate(x, tail, False)
        return L, slope, size

    def second(
        self, x: FloatArray, tail: BoolArray
    ) -> tuple[ComplexArray, ComplexArray, FloatArray, ComplexArray]:
        """L, dL/dx, the sum of moduli and d2L/dx2, each shape (m,)."""
        return self._evaluate(x, tail, True)

    def _evaluate(
        self, x: FloatArray, tail: BoolArray, twice: bool
    ) -> tuple[ComplexArray, ComplexArray, FloatArray, ComplexArray]:
        p, q = np.where(tail, 1.0, x), np.where(tail, x, 1.0)
        n = self.n
        if n <= _SMALL:
            # X = (jp - qT)^-1 b, Y = c (jp - qT)^-1, Z = (jp - qT)^-1 X
            R = np.linalg.inv((1j * p)[:, None, None] * np.eye(n) - q[:, None, None] * self.T)
            X, Y = R @ self.b, self.c @ R
            Z = (R @ X[:, :, None])[:, :, 0] if twice else X
        else:
            X, Y, Z = self._substitute(p, q, twice)
        terms = self.c * X * q[:, None]
        slope = np.where(tail, 1j, -1j) * (X * Y).sum(axis=1)
        curvature = slope
        if twice:
            # d2L/domega2 = -2 c R^3 b; d2L/dt2 = 2j c R^3 T b
            curvature = -2.0 * (Y * Z).sum(axis=1)
            if tail.any():
                curvature = np.where(tail, 2j * (Y * (Z @ self.T.T)).sum(axis=1), curvature)
        return self.D + terms.sum(axis=1), slope, abs(self.D) + np.abs(terms).sum(axis=1), curvature

    def _substitute(self, p: FloatArray, q: FloatArray, twice: bool) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """The same three by substitution in T, all points at once: work n^2 a point."""
        T, n = self.T, self.n
        pivot = 1.0 / (1j * p - q * np.diagonal(T)[:, None])

        def back(right: ComplexArray) -> ComplexArray:
            out = np.empty((n, p.size), dtype=complex)
            for k in range(n - 1, -1, -1):
                out[k] = (right[k] + q * (T[k, k + 1 :] @ out[k + 1 :])) * pivot[k]
            return out

        X = back(self.b[:, None])
        Y = np.empty((n, p.size), dtype=complex)
        for k in range(n):
            Y[k] = (self.c[k] + q * (T[:k, k] @ Y[:k])) * pivot[k]
        return X.T, Y.T, back(X).T if twice else X.T


@dataclass
class _Intervals:
    """Pieces of the frequency axis with the Hermite data of L at both ends, and what is still to be decided."""

    x0: FloatArray
    x1: FloatArray
    tail: BoolArray
    L0: ComplexArray
    S0: ComplexArray
    L1: ComplexArray
    S1: ComplexArray
    error: FloatArray  # assumed interpolation error of L
    from_end: BoolArray  # starts at x = 0, that is at omega = 0 or at infinity
    error_K: FloatArray  # the same for K of _End, where from_end
    check_axis: BoolArray
    check_circle: BoolArray

    def take(self, which: BoolArray) -> _Intervals:
        return _Intervals(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    @cached_property
    def P(self) -> ComplexArray:
        """Bernstein coefficients of the cubic Hermite interpolant of L, shape (m, 4)."""
        P = np.empty((self.x0.size, 4), dtype=complex)
        third = (self.x1 - self.x0) / 3.0
        P[:, 0], P[:, 3] = self.L0, self.L1
        P[:, 1] = self.L0 + third * self.S0
        P[:, 2] = self.L1 - third * self.S1
        return P

    def circle(self) -> FloatArray:
        """Bernstein coefficients of |interpolant|^2 - 1, shape (m, 7)."""
        products: FloatArray = (self.P[:, :, None] * self.P.conj()[:, None, :]).real.reshape(-1, 16)
        return products @ _SQUARE - 1.0



@cache
def _basis(degree: int) -> FloatArray:
    """Bernstein polynomials on _GUESS_POINTS equidistant points of [0, 1], shape (degree + 1, points)."""
    u = np.linspace(0.0, 1.0, _GUESS_POINTS)
    return np.array([math.comb(degree, k) * u**k * (1.0 - u) ** (degree - k) for k in range(degree + 1)])


def _bernstein_root(f: FloatArray) -> FloatArray:
    """Where in (0, 1) each row of Bernstein coefficients, shape (m, degree + 1), changes sign: a first guess."""
    values = f @ _basis(f.shape[1] - 1)
    j = np.argmax((values[:, 1:] >= 0.0) != (values[:, :1] >= 0.0), axis=1)
    rows = np.arange(f.shape[0])
    before, after = values[rows, j], values[rows, j + 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        fraction = before / (before - after)
    guess: FloatArray = (j + np.where((fraction >= 0.0) & (fraction <= 1.0), fraction, 0.5)) / (_GUESS_POINTS - 1)
    return guess


@dataclass(frozen=True)
class _End:
    """L = (e x)^order K(x) near x = 0, where x = omega and e = j, or x = 1/omega and e = -j.

    K(0) is real and not zero, so K, unlike L, tells on which side of the real axis the locus arrives.
    """

    e: complex
    order: int
    K0: float
    K1: float  # K(x) = K0 + e K1 x + ...

    def start(self) -> tuple[complex, complex]:
        """L and dL/dx at x = 0."""
        if self.order == 0:
            return complex(self.K0), self.e * self.K1
        return 0j, self.e * self.K0 if self.order == 1 else 0j

    def axis_coefficients(self, x1: float, L1: complex, S1: complex) -> tuple[ComplexArray, FloatArray]:
        """Bernstein coefficients on [0, x1] of K, and of a function with the sign of Im L on (0, x1]."""
        power = (self.e * x1) ** self.order
        K, slope = L1 / power, (S1 - self.order * L1 / x1) / power
        k = np.array([self.K0, self.K0 + x1 * self.e * self.K1 / 3.0, K - x1 * slope / 3.0, K])
        f = (self.e**self.order * k).imag
        if self.order % 2 == 0:  # Im is odd in x: divide by x, then raise the degree to three again
            d0, d1, d2 = 3.0 * f[1], 1.5 * f[2], f[3]
            f = np.array([d0, (d0 + 2.0 * d1) / 3.0, (2.0 * d1 + d2) / 3.0, d2])
        return k, f


@dataclass
class _Jobs:
    """Brackets to polish: roots of Im L, of log|L|, or of the derivative of Im L or |L|^2 (touches)."""

    kind: list[int] = field(default_factory=list)
    a: list[float] = field(default_factory=list)
    b: list[float] = field(default_factory=list)
    guess: list[float] = field(default_factory=list)
    positive_at_a: list[bool] = field(default_factory=list)
    tail: list[bool] = field(default_factory=list)

    def add(
        self, kind: int, a: FloatArray, b: FloatArray, guess: FloatArray, positive_at_a: BoolArray, tail: BoolArray
    ) -> None:
        self.kind += [kind] * a.size
        self.guess += guess.tolist()
        self.a += a.tolist()
        self.b += b.tolist()
        self.positive_at_a += positive_at_a.tolist()
        self.tail += tail.tolist()


_REAL_AXIS, _UNIT_CIRCLE, _AXIS_EXTREMUM, _CIRCLE_EXTREMUM, _NEAREST, _DISK = range(6)


def locus_features(model: StateSpaceModel) -> LocusFeatures:
    """Crossings and nearest points of the locus L(j omega), 0 <= omega <= infinity, of a proper loop.

    Parameters
    ----------
    model : StateSpaceModel
        The loop L, one input and output, at least one state.
    """
    return _Search(model).run()


class _Search:
    def __init__(self, model: StateSpaceModel) -> None:
        self.model = model
        self.locus = _Locus(model)
        self.jobs = _Jobs()
        self.found: dict[int, list[tuple[float, complex]]] = {_REAL_AXIS: [], _UNIT_CIRCLE: []}
        self.poles = np.diagonal(self.locus.T)
        modulus = np.abs(self.poles)
        self.top_pole = float(modulus.max())
        self.at_origin = modulus <= _AXIS * self.top_pole
        self.infinity = self._end_at_infinity()
        self.zero: _End | None = None
        if not self.at_origin.any():
            try:
                self.zero = self._end_at_zero(np.linalg.inv(model.A))
            except np.linalg.LinAlgError:  # singular: the eigenvalue at the origin came with round-off
                self.at_origin[modulus.argmin()] = True

    def run(self) -> LocusFeatures:
        intervals = self._first_intervals()
        grid = _Samples(intervals)
        self._ends()
        self._on_boundary(intervals)
        undecided = self._sort_out(intervals)
        for _ in range(_MAX_SPLITS):
            if undecided.x0.size == 0 or undecided.x0.size > _MAX_OPEN:
                break
            undecided = self._sort_out(self._split(undecided))
        self._give_up(undecided)
        self._queue_minima(grid)
        nearest, disk = self._polish_all(grid)
        return LocusFeatures(self._points(_REAL_AXIS), self._points(_UNIT_CIRCLE), nearest, disk)

    # The frequency axis

    def _end_at_zero(self, inverse: FloatArray) -> _End | None:
        """L = sum M_i s^i: M_0 = D - C A^-1 B, M_i = -C A^-(i+1) B."""
        model = self.model
        v, bound, size = model.B, np.abs(model.B), np.abs(inverse)
        found: float | None = None
        for i in range(model.n_states + 2):
            v, bound = inverse @ v, size @ bound
            direct = model.D if i == 0 else 0.0
            moment = direct - float(model.C @ v)
            if found is not None:
                return _End(1j, i - 1, found, moment)
            if abs(moment) > _VANISHING * (abs(direct) + float(np.abs(model.C) @ bound)):
                found = moment
        return None

    def _end_at_infinity(self) -> _End | None:
        """L = sum N_i s^-i: N_0 = D, N_i = C A^(i-1) B."""
        model = self.model
        v, bound, size = model.B, np.abs(model.B), np.abs(model.A)
        if model.D != 0.0:
            return _End(-1j, 0, model.D, float(model.C @ v))
        for i in range(1, model.n_states + 1):
            moment, small = float(model.C @ v), _VANISHING * float(np.abs(model.C) @ bound)
            v, bound = model.A @ v, size @ bound
            if abs(moment) > small:
                return _End(-1j, i, moment, float(model.C @ v))
        return None

    def _origin_bounds(self) -> tuple[float, float]:
        """Lowest and highest frequency of interest of a loop with poles at the origin, L ~ K / s^k there."""
        k = int(self.at_origin.sum())
        others = np.abs(self.poles[~self.at_origin])
        low = 1e-6 * float(others.min()) if others.size else 1.0
        gain = float(abs(self.model.response(low)))
        crossover = low * gain ** (1.0 / k) if gain > 0.0 and math.isfinite(gain) else low
        return min(low, 1e-3 * crossover), max(self.top_pole / _SPACING, 0.0 if others.size else 1e3 * crossover)

    def _grid(self) -> tuple[FloatArray, FloatArray]:
        """Frequencies [rad/s], and the modulus of each pole on the imaginary axis (where L is infinite)."""
        start, top = 0.0, self.top_pole / _SPACING
        poles = self.poles[~self.at_origin]
        w0, modulus = np.abs(poles.imag), np.abs(poles)
        sigma = np.maximum(np.abs(poles.real), _AXIS * modulus)
        on_axis = w0[np.abs(poles.real) <= _AXIS * modulus]
        if self.at_origin.any():
            start, top = self._origin_bounds()
            w0, sigma = np.append(w0, 0.0), np.append(sigma, start)
        # Each pole's own grid, w0 + sigma sinh(k spacing), has a spacing proportional to the distance to that pole.
        reach = math.asinh(top / float(sigma.min())) / _SPACING
        k = np.arange(-math.ceil(reach), math.ceil(reach) + 1) * _SPACING
        w = w0[:, None] + sigma[:, None] * np.sinh(k)
        inside = (w > start) & (w < top)
        owner = np.nonzero(inside)[0]
        w = w[inside]
        distance = np.hypot(w[:, None] - w0, sigma)
        nearest = distance.min(axis=1)
        keep = distance[np.arange(w.size), owner] <= 1.5 * nearest
        w, nearest = w[keep], nearest[keep]
        order = np.argsort(w)
        w, nearest = w[order], nearest[order]
        # Grids of neighbouring poles interleave: keep one point for each half of the wanted spacing.
        step = np.cumsum(np.diff(w, prepend=start) / (_SPACING * nearest))
        w = w[np.diff(np.floor(2.0 * step), prepend=0.0) > 0.0]
        return np.concatenate(([start], w[w < 0.9 * top], [top])), on_axis

    def _first_intervals(self) -> _Intervals:
        w, on_axis = self._grid()
        if on_axis.size:
            w = w[np.abs(w[:, None] - on_axis).min(axis=1) > 0.0]
        if self.zero is not None:
            w = np.concatenate(([0.0], _NEAR_END * w[1], w[1:]))
        t = np.concatenate(([0.0], _NEAR_END, [1.0])) / w[-1]
        x = np.concatenate((w, t))
        tail = np.arange(x.size) >= w.size
        with np.errstate(all="ignore"):
            L, S, _ = self.locus.first(x, tail)
        if self.zero is not None:
            L[0], S[0] = self.zero.start()
        L[w.size], S[w.size] = self.infinity.start() if self.infinity is not None else (0j, 0j)
        start = np.delete(np.arange(x.size - 1), w.size - 1)  # no interval from the last omega to the first t
        stop = start + 1
        x0, x1, tail = x[start], x[stop], tail[start]
        L0, S0, L1, S1 = L[start], S[start], L[stop], S[stop]
        from_end = x0 == 0.0
        size = np.maximum(np.abs(L0), np.abs(L1)) + (x1 - x0) * np.maximum(np.abs(S0), np.abs(S1)) / 3.0
        yes = np.ones(x0.size, dtype=bool)
        intervals = _Intervals(
            x0, x1, tail, L0, S0, L1, S1, _FIRST_ERROR * size, from_end, np.full(x0.size, np.nan), yes, yes.copy()
        )
        keep = np.isfinite(L0) & np.isfinite(L1) & np.isfinite(S0) & np.isfinite(S1)
        for pole in on_axis:
            keep &= tail | (x1 < pole) | (x0 > pole)
        return intervals if keep.all() else intervals.take(keep)

    # Deciding

    def _end_of(self, tail: bool) -> _End | None:
        return self.infinity if tail else self.zero

    def _sort_out(self, v: _Intervals) -> _Intervals:
        """Queue a job for every interval that can be judged; return those to split."""
        P = v.P
        axis, axis_error = P.imag.copy(), v.error.copy()
        biggest = np.abs(P).max(axis=1)
        # Some of it may be in the left half plane, and of a size that counts.
        left = (P.real.min(axis=1) <= v.error) & (biggest > _FAINT)
        left &= np.minimum(np.abs(v.L0), np.abs(v.L1)) < _HUGE
        for i in np.nonzero(v.from_end)[0]:
            end = self._end_of(bool(v.tail[i]))
            left[i] = True
            if end is None:
                axis[i] = 1.0
                continue
            K, axis[i] = end.axis_coefficients(float(v.x1[i]), complex(v.L1[i]), complex(v.S1[i]))
            axis_error[i] = 4.0 * v.error_K[i] if v.error_K[i] == v.error_K[i] else _FIRST_ERROR * np.abs(K).max()
        circle = v.circle()
        circle_error = (2.0 * biggest + v.error) * v.error

        wait_axis = self._judge(_REAL_AXIS, v, v.check_axis & left, axis, axis_error)
        wait_circle = self._judge(_UNIT_CIRCLE, v, v.check_circle, circle, circle_error)
        again = wait_axis | wait_circle
        rest = v.take(again)
        rest.check_axis, rest.check_circle = wait_axis[again], wait_circle[again]
        return rest

    def _judge(self, kind: int, v: _Intervals, which: BoolArray, f: FloatArray, error: FloatArray) -> BoolArray:
        """Brackets and extrema from the Bernstein coefficients f, shape (m, degree + 1); returns what stays open."""
        open_ = which & (f.min(axis=1) <= error) & (f.max(axis=1) >= -error)
        i = np.nonzero(open_)[0]
        if i.size == 0:
            return open_
        f, margin = f[i], error[i][:, None]
        positive = f[:, 0] >= 0.0
        crossed = positive != (f[:, -1] >= 0.0)
        slope = np.diff(f, axis=1)
        bend = np.diff(slope, axis=1)
        monotone = (slope > margin).all(axis=1) | (slope < -margin).all(axis=1)
        convex = (bend > margin).all(axis=1) | (bend < -margin).all(axis=1)
        turning = convex & ~crossed & ~v.from_end[i] & (slope[:, 0] * slope[:, -1] < 0.0)
        bracket = crossed & (monotone | convex)
        # Between ends of one sign a convex function has no root if it bends away from zero or does not turn.
        clear = ~crossed & (monotone | (convex & ((bend[:, 0] < 0.0) == positive)) | (convex & ~turning & ~v.from_end[i]))
        turning &= ~clear
        for what, jobs_kind, sign in (
            (bracket, kind, positive),
            (turning, kind + _AXIS_EXTREMUM, slope[:, 0] > 0.0),
        ):
            j = i[what]
            if j.size:
                roots_of = f[what] if jobs_kind == kind else slope[what]
                guess = v.x0[j] + (v.x1[j] - v.x0[j]) * _bernstein_root(roots_of)
                self.jobs.add(jobs_kind, v.x0[j], v.x1[j], guess, sign[what], v.tail[j])
        open_[i[bracket | turning | clear]] = False
        return open_

    def _split(self, v: _Intervals) -> _Intervals:
        x = 0.5 * (v.x0 + v.x1)
        L, S, size = self.locus.first(x, v.tail)
        P = v.P
        error = np.abs(L - (P[:, 0] + 3.0 * P[:, 1] + 3.0 * P[:, 2] + P[:, 3]) / 8.0)
        child_error = 0.25 * error + _EPS * size
        error_K = np.full(x.size, np.nan)
        for i in np.nonzero(v.from_end)[0]:
            end = self._end_of(bool(v.tail[i]))
            if end is None:
                continue
            K, _ = end.axis_coefficients(float(v.x1[i]), complex(v.L1[i]), complex(v.S1[i]))
            power = (end.e * x[i]) ** end.order
            mismatch = abs(L[i] / power - (K[0] + 3.0 * K[1] + 3.0 * K[2] + K[3]) / 8.0)
            error_K[i] = 0.25 * mismatch + _EPS * size[i] / abs(power)

        def two(first: npt.NDArray, second: npt.NDArray) -> npt.NDArray:  # type: ignore[type-arg]
            return np.concatenate((first, second))

        no = np.zeros(x.size, dtype=bool)
        return _Intervals(
            two(v.x0, x),
            two(x, v.x1),
            two(v.tail, v.tail),
            two(v.L0, L),
            two(v.S0, S),
            two(L, v.L1),
            two(S, v.S1),
            two(child_error, child_error),
            two(v.from_end, no),
            two(error_K, error_K),
            two(v.check_axis, v.check_axis),
            two(v.check_circle, v.check_circle),
        )

    def _give_up(self, v: _Intervals) -> None:
        """Intervals that no halving decides: bracket a sign change, else keep the nearer end if it touches."""
        for i in range(v.x0.size):
            x0, x1, tail = v.x0[i : i + 1], v.x1[i : i + 1], v.tail[i : i + 1]
            for kind, check, f0, f1 in (
                (_REAL_AXIS, v.check_axis[i], v.L0[i].imag / abs(v.L0[i] or 1), v.L1[i].imag / abs(v.L1[i] or 1)),
                (_UNIT_CIRCLE, v.check_circle[i], abs(v.L0[i]) - 1.0, abs(v.L1[i]) - 1.0),
            ):
                if not check or v.from_end[i]:
                    continue
                if (f0 >= 0.0) != (f1 >= 0.0):
                    self.jobs.add(kind, x0, x1, 0.5 * (x0 + x1), np.array([f0 >= 0.0]), tail)
                elif min(abs(f0), abs(f1)) <= _TOUCH:
                    x, L = (x0[0], v.L0[i]) if abs(f0) <= abs(f1) else (x1[0], v.L1[i])
                    self._keep(kind, float(x), bool(tail[0]), complex(L))

    # Rules for the ends and for loci that lie on a boundary over a whole band

    def _ends(self) -> None:
        for omega, end in ((0.0, self.zero), (math.inf, self.infinity)):
            if end is not None and end.order == 0:
                if -_HUGE < end.K0 < -_FAINT:
                    self.found[_REAL_AXIS].append((omega, complex(end.K0)))
                if abs(abs(end.K0) - 1.0) <= _TOUCH:
                    self.found[_UNIT_CIRCLE].append((omega, complex(end.K0)))

    def _on_boundary(self, v: _Intervals) -> None:
        """A locus that lies on the circle or the negative axis over a band counts once, where it is nearest to -1."""
        h = v.x1 - v.x0
        on_axis, on_circle = np.ones(h.size, dtype=bool), np.ones(h.size, dtype=bool)
        for L, S in ((v.L0, v.S0), (v.L1, v.S1)):
            size = np.abs(L)
            on_axis &= (np.abs(L.imag) <= _TOUCH * size) & (h * np.abs(S.imag) <= _FLAT * size) & (L.real <= 0.0)
            on_circle &= (np.abs(size - 1.0) <= _TOUCH) & (h * np.abs((L.conj() * S).real) <= _FLAT)
        if not (on_axis.any() or on_circle.any()):
            return
        with np.errstate(divide="ignore"):
            for kind, band, cost in (
                (_REAL_AXIS, on_axis, lambda L: np.abs(np.log(np.abs(L)))),
                (_UNIT_CIRCLE, on_circle, lambda L: np.abs(np.angle(-L))),
            ):
                i = np.nonzero(band)[0]
                if i.size:
                    L = np.concatenate((v.L0[i], v.L1[i]))
                    x = np.concatenate((v.x0[i], v.x1[i]))
                    best = int(np.argmin(cost(L)))
                    self._keep(kind, float(x[best]), bool(v.tail[i[best % i.size]]), complex(L[best]))
        v.check_axis &= ~on_axis
        v.check_circle &= ~on_circle

    # Polishing

    def _queue_minima(self, grid: _Samples) -> None:
        v = grid.intervals
        locus = v.P @ _basis(3)
        step = (v.x1 - v.x0) / (_GUESS_POINTS - 1)
        for kind, size in ((_NEAREST, _distance(locus)), (_DISK, _disk_size(locus))):
            lowest = size.min(axis=1)
            j = np.nonzero(lowest - np.minimum(v.error, 0.02 * lowest) <= lowest.min())[0]
            at = size[j].argmin(axis=1)
            a = v.x0[j] + step[j] * np.maximum(at - 3, 0)
            b = np.minimum(v.x0[j] + step[j] * (at + 3), v.x1[j])
            if kind == _NEAREST:  # the exact slopes at the ends tell more than the interpolant
                inside = ((1.0 + v.L0[j].conj()) * v.S0[j]).real < 0.0
                inside &= ((1.0 + v.L1[j].conj()) * v.S1[j]).real > 0.0
                a, b = np.where(inside, v.x0[j], a), np.where(inside, v.x1[j], b)
            self.jobs.add(kind, a, b, v.x0[j] + step[j] * at, np.zeros(j.size, dtype=bool), v.tail[j])

    def _polish_all(self, grid: _Samples) -> tuple[Points, Points]:
        minima: dict[int, list[tuple[float, complex]]] = {_NEAREST: [], _DISK: []}
        for _ in range(2):
            jobs, self.jobs = self.jobs, _Jobs()
            if not jobs.kind:
                break
            for i, (x, L, size) in enumerate(zip(*self._newton(jobs), strict=True)):
                kind, tail = jobs.kind[i], jobs.tail[i]
                if kind in minima:
                    minima[kind].append((_omega(x, tail), L))
                elif kind in self.found:
                    if abs(L) > _NOISE * size:
                        self._keep(kind, x, tail, L)
                else:
                    self._extremum(jobs, i, x, L, size)
        return grid.best(minima[_NEAREST], _distance), grid.best(minima[_DISK], _disk_size)

    def _extremum(self, jobs: _Jobs, i: int, x: float, L: complex, size: float) -> None:
        """A touch, two crossings, or none, at the extremum x between ends where f has one sign."""
        kind = jobs.kind[i] - _AXIS_EXTREMUM
        f = L.imag if kind == _REAL_AXIS else abs(L) - 1.0
        if abs(f) <= (_TOUCH * abs(L) if kind == _REAL_AXIS else _TOUCH):
            if abs(L) > _NOISE * size:
                self._keep(kind, x, jobs.tail[i], L)
            return
        # The extremum is a maximum if f rises at the start; it crosses if it gets to the other side from the ends.
        if (f > 0.0) == jobs.positive_at_a[i]:
            ends_positive = not jobs.positive_at_a[i]
            for a, b, positive in ((jobs.a[i], x, ends_positive), (x, jobs.b[i], not ends_positive)):
                middle = np.array([0.5 * (a + b)])
                self.jobs.add(
                    kind, np.array([a]), np.array([b]), middle, np.array([positive]), np.array([jobs.tail[i]])
                )

    def _newton(self, jobs: _Jobs) -> tuple[list[float], list[complex], list[float]]:
        """Roots of all jobs at once: x, L and the size of its terms."""
        kind, a, b = np.array(jobs.kind), np.array(jobs.a), np.array(jobs.b)
        positive, tail = np.array(jobs.positive_at_a), np.array(jobs.tail)
        axis, circle, axis_extremum = kind == _REAL_AXIS, kind == _UNIT_CIRCLE, kind == _AXIS_EXTREMUM
        nearest, disk = kind == _NEAREST, kind == _DISK
        # The place of a minimum needs half the digits only: the function is flat there.
        tolerance = np.where(axis | circle, 1e-13, 1e-8)
        x = np.clip(np.array(jobs.guess), a, b)
        settled = np.zeros(x.size, dtype=bool)
        any_disk = bool(disk.any())
        with np.errstate(all="ignore"):
            for step in range(_MAX_NEWTON):
                L, S, size, C = self.locus.second(x, tail)
                F, F1, F2 = L + nearest, S, C
                if any_disk:
                    u = 1.0 / (1.0 - L)
                    F = np.where(disk, (1.0 + L) * u, F)
                    F1 = np.where(disk, 2.0 * S * u * u, S)
                    F2 = np.where(disk, (2.0 * C + 4.0 * S * S * u) * u * u, C)
                # Roots of d|F|^2/dx / 2 for the minima and the extrema of |L|, of Im L, of log|L|, of d Im L/dx.
                g = (F.conj() * F1).real
                dg = np.abs(F1) ** 2 + (F.conj() * F2).real
                g = np.where(circle, np.log(np.abs(L)), np.where(axis, L.imag, np.where(axis_extremum, S.imag, g)))
                dg = np.where(circle, (S / L).real, np.where(axis, S.imag, np.where(axis_extremum, C.imag, dg)))
                before = (g >= 0.0) == positive
                a, b = np.where(before, x, a), np.where(before, b, x)
                move = g / dg
                new = x - move
                new = np.where((new > a) & (new < b), new, 0.5 * (a + b))
                settled |= (np.abs(move) <= tolerance * x) | (b - a <= 4.0 * _EPS * b)
                if settled.all():
                    break
                x = np.where(settled, x, new)
                if step > 10:  # round-off keeps the last digits from settling
                    tolerance = np.minimum(4.0 * tolerance, np.maximum(tolerance, 1e-11))
        return x.tolist(), L.tolist(), size.tolist()

    def _keep(self, kind: int, x: float, tail: bool, L: complex) -> None:
        if kind == _UNIT_CIRCLE or -_HUGE < L.real < -_FAINT:
            self.found[kind].append((_omega(x, tail), L))

    def _points(self, kind: int) -> Points:
        other = _REAL_AXIS + _UNIT_CIRCLE - kind
        through = [(w, L) for w, L in self.found[other] if abs(L + 1.0) <= _TOUCH]
        kept: list[tuple[float, complex]] = []
        for w, L in sorted(self.found[kind] + through, key=lambda point: point[0]):
            if not kept or (w > kept[-1][0] and not w - kept[-1][0] <= _SAME * kept[-1][0]):
                kept.append((w, L))
        return Points(np.array([w for w, _ in kept], dtype=float), np.array([L for _, L in kept], dtype=complex))


class _Samples:
    """The ends of the first intervals, for the minima of |1 + L| and of 2 |1 + L| / |1 - L|."""

    def __init__(self, intervals: _Intervals) -> None:
        self.intervals = intervals

    def best(self, polished: list[tuple[float, complex]], size: Callable[[ComplexArray], FloatArray]) -> Points:
        v = self.intervals
        with np.errstate(all="ignore"):
            omega0 = np.where(v.tail, 1.0 / v.x0, v.x0)
            omega1 = np.where(v.tail, 1.0 / v.x1, v.x1)
            omega = np.concatenate(([w for w, _ in polished], omega0, omega1))
            L = np.concatenate(([L for _, L in polished], v.L0, v.L1))
            i = int(np.nanargmin(size(L)))
        return Points(omega[i : i + 1], L[i : i + 1])


def _omega(x: float, tail: bool) -> float:
    return (1.0 / x if x > 0.0 else math.inf) if tail else x


def _distance(L: ComplexArray) -> FloatArray:
    return np.abs(1.0 + L)


def _disk_size(L: ComplexArray) -> FloatArray:
    return np.abs(1.0 + L) / np.maximum(np.abs(1.0 - L), _EPS)
