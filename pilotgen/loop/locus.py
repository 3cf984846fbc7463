"""The frequency response of a loop as a curve: values, derivatives, and the frequency axis cut into intervals.

The spacing is a fixed fraction of the distance to the nearest pole, from omega = 0 to infinity, the last stretch in
t = 1/omega; each interval carries a cubic Hermite interpolant of L and what is known of its error. The method and its
reasons: docs/theory/margins.md. First of three: this module knows the curve and decides nothing, `crossings` decides,
`verified` settles by exact arithmetic what that leaves in doubt.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import numpy.typing as npt

from pilotgen.linear.partial_fractions import PartialFractions
from pilotgen.linear.statespace import ComplexArray, FloatArray, StateSpaceModel

BoolArray = npt.NDArray[np.bool_]
_Values = tuple[ComplexArray, ComplexArray, FloatArray, ComplexArray]  # L, dL/dx, sum of moduli, d2L/dx2

_EPS = float(np.finfo(float).eps)
_SPACING = 0.25  # grid spacing over distance to the nearest pole; interpolation error about spacing^4 / 16 of a residue
FIRST_ERROR = 0.03  # assumed interpolation error on the first grid, relative to the largest coefficient
_AXIS = 1e-10  # a pole this close to the imaginary axis, relative to its modulus, is on it
_MOST_ORDER = 20  # of zeros at omega = 0 or infinity that are divided out
_AWAY = 4.0  # backward error of a Schur form over eps times the norm of its matrix
_SHARE = 1e-4  # of what comes of it, counted as round-off of L: a margin may be wrong by 1e-5 before it is doubtful
_FELT = 1e-7  # relative error of a pole's distance from the axis that margins may show
_VANISHING = 1e-12  # a moment below this fraction of what its terms' moduli could give is zero

_NEAR_END = np.array([1.0 / 64.0, 1.0 / 8.0, 1.0 / 2.0])  # extra points of the first interval and of the tail
GUESS_POINTS = 33  # samples of an interpolant on one interval, for first guesses

# A term r / (j omega - p) has the fourth derivative 24 r / (j omega - p)^5, and a cubic Hermite interpolant on a step h
# the error h^4 / 384 times that; _TAIL is the same for the tail's intervals, where h is at most half of t.
_FOURTH, _FOURTH_DOUBLE, _TAIL = 24.0 / 384.0, 120.0 / 384.0, 1e-3

# |P|^2 of a cubic with Bernstein coefficients p has the degree-6 coefficients sum_ij SQUARE[4 i + j, k] p_i conj(p_j).
_SQUARE = np.zeros((16, 7))
for _i in range(4):
    for _j in range(4):
        _SQUARE[4 * _i + _j, _i + _j] = math.comb(3, _i) * math.comb(3, _j) / math.comb(6, _i + _j)
_RAISE = 2.0 * np.array([[math.comb(3, i) * math.comb(3, k - i) / math.comb(6, k) if 0 <= k - i <= 3 else 0.0
                          for k in range(7)] for i in range(4)])  # fmt: skip


@dataclass
class Intervals:
    """Pieces of the frequency axis with the Hermite data of L at both ends, and what is still to be decided."""

    x0: FloatArray
    x1: FloatArray
    tail: BoolArray
    L0: ComplexArray
    S0: ComplexArray
    L1: ComplexArray
    S1: ComplexArray
    error: FloatArray  # assumed interpolation error of L
    bound: FloatArray  # what it cannot exceed, where poles and residues are known
    from_end: BoolArray  # starts at x = 0, that is at omega = 0 or at infinity
    error_K: FloatArray  # the same for K of End, where from_end
    check_axis: BoolArray
    check_circle: BoolArray

    def take(self, which: BoolArray | npt.NDArray[np.intp]) -> Intervals:
        """The intervals that `which` marks, shape (n,), or numbers, shape (m,)."""
        return Intervals(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    @cached_property
    def P(self) -> ComplexArray:
        """Bernstein coefficients of the cubic Hermite interpolant of L, shape (m, 4)."""
        P = np.empty((self.x0.size, 4), dtype=complex)
        third = (self.x1 - self.x0) / 3.0
        P[:, 0], P[:, 3] = self.L0, self.L1
        P[:, 1] = self.L0 + third * self.S0
        P[:, 2] = self.L1 - third * self.S1
        return P

    @cached_property
    def biggest(self) -> FloatArray:
        """Largest modulus of the Bernstein coefficients, shape (m,): a bound of the interpolant."""
        largest: FloatArray = np.abs(self.P).max(axis=1)
        return largest

    @cached_property
    def square(self) -> FloatArray:
        """Bernstein coefficients of |interpolant|^2, shape (m, 7)."""
        products: FloatArray = (self.P[:, :, None] * self.P.conj()[:, None, :]).real.reshape(-1, 16)
        return products @ _SQUARE

    @cached_property
    def twice_real(self) -> FloatArray:
        """Bernstein coefficients of twice the interpolant's real part, raised to degree 6, shape (m, 7)."""
        raised: FloatArray = self.P.real @ _RAISE
        return raised


@cache
def basis(degree: int) -> FloatArray:
    """Bernstein polynomials on GUESS_POINTS equidistant points of [0, 1], shape (degree + 1, points)."""
    u = np.linspace(0.0, 1.0, GUESS_POINTS)
    return np.array([math.comb(degree, k) * u**k * (1.0 - u) ** (degree - k) for k in range(degree + 1)])


def _integrators(A: FloatArray) -> int:
    """Eigenvalues of A that are zero by its zeros alone: states that drive themselves by no way, not even around."""
    from scipy.sparse.csgraph import connected_components

    _, block = connected_components(A != 0.0, directed=True, connection="strong")
    alone = np.bincount(block)[block] == 1
    return int((alone & (np.diagonal(A) == 0.0)).sum())


@dataclass(frozen=True)
class End:
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
        """Bernstein coefficients on [0, x1] of K, and of a function with the sign of Im L on (0, x1].

        Both of shape (degree + 1,).
        """
        power = (self.e * x1) ** self.order
        K, slope = L1 / power, (S1 - self.order * L1 / x1) / power
        k = np.array([self.K0, self.K0 + x1 * self.e * self.K1 / 3.0, K - x1 * slope / 3.0, K])
        f = (self.e**self.order * k).imag
        if self.order % 2 == 0:  # Im is odd in x: divide by x, then raise the degree to three again
            d0, d1, d2 = 3.0 * f[1], 1.5 * f[2], f[3]
            f = np.array([d0, (d0 + 2.0 * d1) / 3.0, (2.0 * d1 + d2) / 3.0, d2])
        return k, f


class Locus:
    """L and its derivatives on the frequency axis 0 <= omega <= infinity, and the axis cut into intervals.

    A point is (x, tail): omega = x, or omega = 1/x on the tail.

    Parameters
    ----------
    model : StateSpaceModel
        The loop, one input and output, at least one state.
    fractions : PartialFractions, optional
        The same loop in that form; without it, values come from the Schur form.
    """

    def __init__(self, model: StateSpaceModel, fractions: PartialFractions | None = None) -> None:
        self.model = model
        self.fractions = fractions
        self.poles = fractions.all_poles if fractions is not None else np.diagonal(model.schur.T)
        modulus = np.abs(self.poles)
        self.top_pole = float(modulus.max())
        self.at_origin = modulus <= _AXIS * self.top_pole
        # Poles come with round-off of about n eps times the largest: light or slow ones must feel little of it.
        exact = modulus == 0.0
        if self.at_origin.any() and int(self.at_origin.sum()) == _integrators(model.A):
            exact = self.at_origin
        sigma = np.where(exact, np.inf, np.abs(self.poles.real))
        self.doubtful = bool(self.poles.size * _EPS * self.top_pole > _FELT * sigma.min())
        self.infinity = self._end_at_infinity()
        self.zero: End | None = None
        if not self.at_origin.any():
            try:
                self.zero = self._end_at_zero(np.asarray(np.linalg.inv(model.A), dtype=float))
            except np.linalg.LinAlgError:  # singular: the eigenvalue at the origin came with round-off
                self.at_origin[modulus.argmin()] = True
        self.doubtful |= self.infinity is None or (self.zero is None and not self.at_origin.any())

    def first(self, x: FloatArray, tail: BoolArray) -> tuple[ComplexArray, ComplexArray, FloatArray]:
        """L, dL/dx, and the sum of the moduli of the terms of L (for its round-off), each shape (m,)."""
        evaluate = self._schur if self.fractions is None else self._sum
        L, slope, size, _ = evaluate(x, tail, False)
        return L, slope, size

    def second(self, x: FloatArray, tail: BoolArray) -> _Values:
        """L, dL/dx, the sum of moduli and d2L/dx2, each shape (m,)."""
        evaluate = self._schur if self.fractions is None else self._sum
        return evaluate(x, tail, True)

    def _sum(self, x: FloatArray, tail: BoolArray, twice: bool) -> _Values:
        """From partial fractions, with R = 1 / (jp - q pole), omega = p/q."""
        f = self.fractions
        assert f is not None
        some_tail = bool(tail.any())
        p, q = (np.where(tail, 1.0, x), np.where(tail, x, 1.0)) if some_tail else (x, np.ones_like(x))
        jp = (1j * p)[:, None]
        R = 1.0 / (jp - (q[:, None] * f.poles if some_tail else f.poles))
        terms = R * (q[:, None] * f.residues if some_tail else f.residues)
        L, size = f.D + terms.sum(axis=1), abs(f.D) + np.abs(terms).sum(axis=1)
        R_squared = R * R
        slope = -1j * (R_squared @ f.residues)
        curvature = slope
        if twice:
            R_cubed = R_squared * R
            curvature = -2.0 * (R_cubed @ f.residues)
            if some_tail:
                curvature = np.where(tail, 2j * (R_cubed @ (f.poles * f.residues)), curvature)
        if f.second != 0.0:
            r = R[:, 0]
            once = f.second * r * r
            term = q * q * once
            L, size = L + term, size + np.abs(term)
            slope = slope - 2j * q * once * r
            if twice:
                change = -6.0 * once * r * r
                if some_tail:
                    change = np.where(tail, 2j * once * r * (1.0 + 3.0 * x * f.poles[0] * r), change)
                curvature = curvature + change
        return L, np.where(tail, -slope, slope) if some_tail else slope, size, curvature

    def _schur(self, x: FloatArray, tail: BoolArray, twice: bool) -> _Values:
        """From the Schur form: X = (jp - qT)^-1 b, Y = c (jp - qT)^-1, Z = (jp - qT)^-1 X, omega = p/q."""
        form, D = self.model.schur, self.model.D
        p, q = np.where(tail, 1.0, x), np.where(tail, x, 1.0)
        X, Y, Z = self._substitute(p, q, twice)
        terms = form.c * X * q[:, None]
        slope = np.where(tail, 1j, -1j) * (X * Y).sum(axis=1)
        curvature = slope
        if twice:
            # d2L/domega2 = -2 c R^3 b; d2L/dt2 = 2j c R^3 T b
            curvature = -2.0 * (Y * Z).sum(axis=1)
            if tail.any():
                curvature = np.where(tail, 2j * (Y * (Z @ form.T.T)).sum(axis=1), curvature)
        size = abs(D) + np.abs(terms).sum(axis=1) + _SHARE / _EPS * self._away(X, Y, q)
        return D + terms.sum(axis=1), slope, size, curvature

    def unsure(self, x: FloatArray, tail: BoolArray) -> FloatArray:
        """How far off L may be because the Schur form is that of a matrix nearby, to first order; shape (m,).

        Zero for partial fractions. `_AWAY` eps norm(A) is some ten times what is seen of loops of 4 to 50 states.
        """
        if self.fractions is not None:
            return np.zeros(x.size)
        p, q = np.where(tail, 1.0, x), np.where(tail, x, 1.0)
        X, Y, _ = self._substitute(p, q, False)
        return self._away(X, Y, q)

    def _away(self, X: ComplexArray, Y: ComplexArray, q: FloatArray) -> FloatArray:
        away = _AWAY * _EPS * float(np.linalg.norm(self.model.schur.T))
        off: FloatArray = away * np.linalg.norm(X, axis=1) * np.linalg.norm(Y, axis=1) * q * q
        return off

    def _substitute(self, p: FloatArray, q: FloatArray, twice: bool) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """X, Y and Z by substitution in T, all points at once: work n^2 a point."""
        form, n = self.model.schur, self.model.n_states
        T, c = form.T, form.c
        pivot = 1.0 / (1j * p - q * np.diagonal(T)[:, None])

        def back(right: ComplexArray) -> ComplexArray:
            out = np.empty((n, p.size), dtype=complex)
            for k in range(n - 1, -1, -1):
                out[k] = (right[k] + q * (T[k, k + 1 :] @ out[k + 1 :])) * pivot[k]
            return out

        X = back(form.b[:, None])
        Y = np.empty((n, p.size), dtype=complex)
        for k in range(n):
            Y[k] = (c[k] + q * (T[:k, k] @ Y[:k])) * pivot[k]
        return X.T, Y.T, back(X).T if twice else X.T

    def _end_at_zero(self, inverse: FloatArray) -> End | None:
        """L = sum M_i s^i: M_0 = D - C A^-1 B, M_i = -C A^-(i+1) B."""
        model = self.model
        v, bound, size = model.B, np.abs(model.B), np.abs(inverse)
        found: float | None = None
        for i in range(min(model.n_states, _MOST_ORDER) + 2):
            v, bound = inverse @ v, size @ bound
            direct = model.D if i == 0 else 0.0
            moment = direct - float(model.C @ v)
            if found is not None:
                return End(1j, i - 1, found, moment)
            if abs(moment) > _VANISHING * (abs(direct) + float(np.abs(model.C) @ bound)):
                found = moment
        return None

    def _end_at_infinity(self) -> End | None:
        """L = sum N_i s^-i: N_0 = D, N_i = C A^(i-1) B."""
        model = self.model
        v, bound, size = model.B, np.abs(model.B), np.abs(model.A)
        if model.D != 0.0:
            return End(-1j, 0, model.D, float(model.C @ v))
        for i in range(1, min(model.n_states, _MOST_ORDER) + 1):
            moment, small = float(model.C @ v), _VANISHING * float(np.abs(model.C) @ bound)
            v, bound = model.A @ v, size @ bound
            if abs(moment) > small:
                return End(-1j, i, moment, float(model.C @ v))
        return None

    def _origin_bounds(self) -> tuple[float, float]:
        """Lowest and highest frequency of interest of a loop with poles at the origin, L ~ K / s^k there."""
        k = int(self.at_origin.sum())
        others = np.abs(self.poles[~self.at_origin])
        low = 1e-6 * float(others.min()) if others.size else 1.0
        gain = float(abs(self.model.response(low)))
        crossover = low * gain ** (1.0 / k) if gain > 0.0 and math.isfinite(gain) else low
        return min(low, 1e-3 * crossover), max(self.top_pole / _SPACING, 0.0 if others.size else 1e3 * crossover)

    def _grid(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Frequencies [rad/s], their distance to the nearest pole, and the moduli of the poles on the axis."""
        start, top = 0.0, self.top_pole / _SPACING
        poles = self.poles[~self.at_origin & (self.poles.imag >= 0.0)]  # a conjugate has the same grid
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
        squared = w[:, None] - w0  # distances to all poles, squared: np.hypot would take most of this function's time
        squared *= squared
        squared += sigma * sigma
        nearest = squared.min(axis=1)
        keep = squared[np.arange(w.size), owner] <= 1.5**2 * nearest
        w, nearest = w[keep], np.sqrt(nearest[keep])
        order = np.argsort(w)
        w, nearest = w[order], nearest[order]
        # Grids of neighbouring poles interleave: keep one point for each half of the wanted spacing.
        step = w.copy()
        step[1:] -= w[:-1]
        step[:1] -= start
        halves = np.floor(2.0 * np.cumsum(step / (_SPACING * nearest)))
        kept = np.concatenate((halves[:1] > 0.0, halves[1:] > halves[:-1])) & (w < 0.9 * top)
        d_start = start if start > 0.0 else float(np.abs(self.poles).min())
        return (
            np.concatenate(([start], w[kept], [top])),
            np.concatenate(([d_start], nearest[kept], [top - self.top_pole])),
            on_axis,
        )

    def intervals(self) -> Intervals:
        """The whole axis, 0 to infinity, without the pieces that hold a pole on the axis."""
        w, d, on_axis = self._grid()
        if on_axis.size:
            off = np.abs(w[:, None] - on_axis).min(axis=1) > 0.0
            w, d = w[off], d[off]
        if self.zero is not None:
            near = _NEAR_END * w[1]
            w, d = np.concatenate(([0.0], near, w[1:])), np.concatenate((d[:1], d[0] - near, d[1:]))
        t = np.concatenate(([0.0], _NEAR_END, [1.0])) / w[-1]
        x = np.concatenate((w, t))
        tail = np.arange(x.size) >= w.size
        with np.errstate(all="ignore"):
            L, S, terms = self.first(x, tail)
        if self.zero is not None:
            L[0], S[0] = self.zero.start()
        L[w.size], S[w.size] = self.infinity.start() if self.infinity is not None else (0j, 0j)
        start = np.arange(x.size - 2)
        start[w.size - 1 :] += 1  # no interval from the last omega to the first t
        stop = start + 1
        x0, x1, tail = x[start], x[stop], tail[start]
        L0, S0, L1, S1 = L[start], S[start], L[stop], S[stop]
        from_end = x0 == 0.0
        size = np.maximum(np.abs(L0), np.abs(L1)) + (x1 - x0) * np.maximum(np.abs(S0), np.abs(S1)) / 3.0
        error = bound = FIRST_ERROR * size
        if self.fractions is not None:
            bound = self._bound(x, d, start, terms)
            error = np.minimum(error, bound)
        yes = np.ones(x0.size, dtype=bool)
        intervals = Intervals(
            x0, x1, tail, L0, S0, L1, S1, error, bound, from_end, np.full(x0.size, np.nan), yes, yes.copy()
        )
        keep = np.isfinite(L0) & np.isfinite(L1) & np.isfinite(S0) & np.isfinite(S1)
        for pole in on_axis:
            keep &= tail | (x1 < pole) | (x0 > pole)
        return intervals if keep.all() else intervals.take(keep)

    def _bound(self, x: FloatArray, d: FloatArray, start: npt.NDArray[np.intp], terms: FloatArray) -> FloatArray:
        """Bound of the interpolation error from x[start] to x[start + 1].

        d are the distances to the nearest pole, one for each point before the tail; `terms` the sums of moduli.
        """
        f = self.fractions
        assert f is not None
        error = _TAIL * terms[start + 1]
        m = d.size - 1  # intervals before the tail
        # from the end that is farther from the poles
        i = np.arange(m) + (d[:-1] <= d[1:])
        share = np.minimum((x[1 : m + 1] - x[:m]) / np.maximum(d[i], 1e-300), 0.999)
        rest = 1.0 - share
        power = share**4 / rest**5
        error[:m] = _FOURTH * power * terms[i]
        if f.second != 0.0:
            error[:m] += _FOURTH_DOUBLE * abs(f.second) * power / (rest * np.abs(1j * x[i] - f.poles[0]) ** 2)
        return error

    def end_of(self, tail: bool) -> End | None:
        """What is known of L at the end x = 0 of the axis or of the tail."""
        return self.infinity if tail else self.zero

    def split(self, v: Intervals) -> Intervals:
        """Both halves of every interval, with the interpolation error measured at the middle."""
        x = 0.5 * (v.x0 + v.x1)
        L, S, size = self.first(x, v.tail)
        # An error measured at the middle falls 16 times with each halving, and gets a factor of 4 to be safe.
        P, round_off = v.P, 8.0 * _EPS * size
        error = 0.25 * np.abs(L - (P[:, 0] + 3.0 * (P[:, 1] + P[:, 2]) + P[:, 3]) / 8.0) + round_off
        bound = v.bound / 16.0 + round_off if self.fractions is not None else error
        error_K = np.full(x.size, np.nan)
        for i in np.nonzero(v.from_end)[0]:
            end = self.end_of(bool(v.tail[i]))
            if end is None:
                continue
            K, _ = end.axis_coefficients(float(v.x1[i]), complex(v.L1[i]), complex(v.S1[i]))
            power = (end.e * x[i]) ** end.order
            mismatch = abs(L[i] / power - (K[0] + 3.0 * K[1] + 3.0 * K[2] + K[3]) / 8.0)
            error_K[i] = 0.25 * mismatch + _EPS * size[i] / abs(power)

        def two(first: npt.NDArray, second: npt.NDArray) -> npt.NDArray:  # type: ignore[type-arg]
            return np.concatenate((first, second))

        no = np.zeros(x.size, dtype=bool)
        return Intervals(
            two(v.x0, x),
            two(x, v.x1),
            two(v.tail, v.tail),
            two(v.L0, L),
            two(v.S0, S),
            two(L, v.L1),
            two(S, v.S1),
            two(error, error),
            two(bound, bound),
            two(v.from_end, no),
            two(error_K, error_K),
            two(v.check_axis, v.check_axis),
            two(v.check_circle, v.check_circle),
        )
