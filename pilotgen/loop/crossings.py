"""Where a loop's frequency response crosses the unit circle and the negative real axis, and where it is nearest to -1.

The Bernstein coefficients of the interpolant on each interval of `locus` bound it: intervals without a crossing fall
away, undecided ones are split, brackets are polished by a safeguarded Newton iteration on the exact response.
The method and its reasons: docs/theory/margins.md.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from pilotgen.linear.partial_fractions import PartialFractions
from pilotgen.linear.statespace import ComplexArray, FloatArray, StateSpaceModel
from pilotgen.loop.locus import FIRST_ERROR, GUESS_POINTS, BoolArray, Intervals, Locus, basis

_EPS = float(np.finfo(float).eps)
_MAX_SPLITS = 16  # halvings; a touch that is undecided after so many is closer than _TOUCH
_MAX_OPEN = 4096  # intervals; more are open only if the locus follows the circle or the axis within round-off
_TOUCH = 1e-10  # an extremum of |L| within this of 1, or with |Im L| / |L| below this, is a touch
_FLAT = 1e-8  # a touch at both ends of an interval with slopes (times its length) below this lasts the whole interval
_NOISE = 1e3 * _EPS  # |L| below this fraction of the sum of its terms' moduli is round-off
_SAME = 1e-9  # relative distance in frequency below which two roots are one
FAINT, HUGE = 1e-10, 1e10  # |L| beyond which (200 dB) a crossing is of no interest and often round-off
_MAX_NEWTON = 100


@dataclass(frozen=True)
class Points:
    """Points of the locus: omega [rad/s], 0 and inf included, and L(j omega) there."""

    omega: FloatArray
    L: ComplexArray


@dataclass(frozen=True)
class LocusFeatures:
    """Crossings by rising frequency, and the points nearest to -1 in two senses.

    `nearest` minimises |1 + L|, `disk` minimises 2 |1 + L| / |1 - L|; one point each, with these values.
    """

    real_axis: Points
    unit_circle: Points
    nearest: Points
    disk: Points
    distance: float
    alpha: float
    doubtful: bool = False


def constant_features(D: float) -> LocusFeatures:
    """A loop without dynamics: one point, at every frequency; named by omega = 0."""
    point = Points(np.zeros(1), np.array([D], dtype=complex))
    none = Points(np.zeros(0), np.zeros(0, dtype=complex))
    alpha = 2.0 * abs(1.0 + D) / abs(1.0 - D) if D != 1.0 else math.inf
    return LocusFeatures(
        point if D < 0.0 else none, point if abs(D) == 1.0 else none, point, point, abs(1.0 + D), alpha
    )


def _bernstein_root(f: FloatArray) -> FloatArray:
    """Where in (0, 1) each row of Bernstein coefficients, shape (m, degree + 1), changes sign: a first guess."""
    values = f @ basis(f.shape[1] - 1)
    j = np.argmax((values[:, 1:] >= 0.0) != (values[:, :1] >= 0.0), axis=1)
    rows = np.arange(f.shape[0])
    before, after = values[rows, j], values[rows, j + 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        fraction = before / (before - after)
    guess: FloatArray = (j + np.where((fraction >= 0.0) & (fraction <= 1.0), fraction, 0.5)) / (GUESS_POINTS - 1)
    return guess


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


def locus_features(model: StateSpaceModel, fractions: PartialFractions | None = None) -> LocusFeatures:
    """Crossings and nearest points of the locus L(j omega), 0 <= omega <= infinity, of a proper loop.

    Parameters
    ----------
    model : StateSpaceModel
        The loop L, one input and output, at least one state.
    fractions : PartialFractions, optional
        The same as a sum of partial fractions, if its poles are apart: quicker.
    """
    return _Search(Locus(model, fractions)).run()


class _Search:
    def __init__(self, locus: Locus) -> None:
        self.locus = locus
        self.jobs = _Jobs()
        self.found: dict[int, list[tuple[float, complex]]] = {_REAL_AXIS: [], _UNIT_CIRCLE: []}

    def run(self) -> LocusFeatures:
        intervals = self.locus.intervals()
        grid = _Samples(intervals)
        self._ends()
        self._on_boundary(intervals)
        undecided = self._sort_out(intervals)
        for _ in range(_MAX_SPLITS):
            if undecided.x0.size == 0 or undecided.x0.size > _MAX_OPEN:
                break
            undecided = self._sort_out(self.locus.split(undecided))
        self._give_up(undecided)
        self._queue_minima(grid)
        nearest, disk = self._polish_all(grid)
        distance, ratio = float(_distance(nearest.L)[0]), float(_disk_size(disk.L)[0])
        return LocusFeatures(self._points(_REAL_AXIS), self._points(_UNIT_CIRCLE), nearest, disk, distance, 2.0 * ratio)

    # Deciding

    def _sort_out(self, v: Intervals) -> Intervals:
        """Queue a job for every interval that can be judged; return those to split."""
        P = v.P
        axis, axis_error = P.imag.copy(), v.error.copy()
        biggest = np.abs(P).max(axis=1)
        # Some of it may be in the left half plane, and of a size that counts.
        left = (P.real.min(axis=1) <= v.error) & (biggest > FAINT)
        left &= np.minimum(np.abs(v.L0), np.abs(v.L1)) < HUGE
        for i in np.nonzero(v.from_end)[0]:
            end = self.locus.end_of(bool(v.tail[i]))
            left[i] = True
            if end is None:
                axis[i] = 1.0
                continue
            K, axis[i] = end.axis_coefficients(float(v.x1[i]), complex(v.L1[i]), complex(v.S1[i]))
            axis_error[i] = 4.0 * v.error_K[i] if v.error_K[i] == v.error_K[i] else FIRST_ERROR * np.abs(K).max()
        circle = v.circle()
        circle_error = (2.0 * biggest + v.error) * v.error

        wait_axis = self._judge(_REAL_AXIS, v, v.check_axis & left, axis, axis_error)
        wait_circle = self._judge(_UNIT_CIRCLE, v, v.check_circle, circle, circle_error)
        again = wait_axis | wait_circle
        rest = v.take(again)
        rest.check_axis, rest.check_circle = wait_axis[again], wait_circle[again]
        return rest

    def _judge(self, kind: int, v: Intervals, which: BoolArray, f: FloatArray, error: FloatArray) -> BoolArray:
        """Brackets and extrema from the Bernstein coefficients f, shape (m, degree + 1); returns what stays open."""
        open_: BoolArray = which & (f.min(axis=1) <= error) & (f.max(axis=1) >= -error)
        i = np.nonzero(open_)[0]
        if i.size == 0:
            return open_
        f, margin = f[i], error[i][:, None]
        positive = f[:, 0] >= 0.0
        crossed = positive != (f[:, -1] >= 0.0)
        slope = f[:, 1:] - f[:, :-1]
        bend = slope[:, 1:] - slope[:, :-1]
        monotone = (slope > margin).all(axis=1) | (slope < -margin).all(axis=1)
        convex = (bend > margin).all(axis=1) | (bend < -margin).all(axis=1)
        turning = convex & ~crossed & ~v.from_end[i] & ((slope[:, 0] < 0.0) != (slope[:, -1] < 0.0))
        bracket = crossed & (monotone | convex)
        # Between ends of one sign a convex function has no root if it bends away from zero or does not turn.
        clear = ~crossed & (
            monotone | (convex & ((bend[:, 0] < 0.0) == positive)) | (convex & ~turning & ~v.from_end[i])
        )
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

    def _give_up(self, v: Intervals) -> None:
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
        for omega, end in ((0.0, self.locus.zero), (math.inf, self.locus.infinity)):
            if end is not None and end.order == 0:
                if -HUGE < end.K0 < -FAINT:
                    self.found[_REAL_AXIS].append((omega, complex(end.K0)))
                if abs(abs(end.K0) - 1.0) <= _TOUCH:
                    self.found[_UNIT_CIRCLE].append((omega, complex(end.K0)))

    def _on_boundary(self, v: Intervals) -> None:
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
                (_REAL_AXIS, on_axis, _decades),
                (_UNIT_CIRCLE, on_circle, _turn),
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
        locus = v.P @ basis(3)
        step = (v.x1 - v.x0) / (GUESS_POINTS - 1)
        # squares of `_distance` and `_disk_size`: only the smallest of each interval is worth a root
        height = locus.imag**2
        distance = (1.0 + locus.real) ** 2 + height
        disk_size = distance / np.maximum((1.0 - locus.real) ** 2 + height, _EPS**2)
        for kind, squares in ((_NEAREST, distance), (_DISK, disk_size)):
            lowest = np.sqrt(squares.min(axis=1))
            j = np.nonzero(lowest - np.minimum(v.error, 0.02 * lowest) <= lowest.min())[0]
            at = squares[j].argmin(axis=1)
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
        """Roots of all jobs: x, L and the size of its terms. The response is evaluated for all open jobs at once."""
        count = len(jobs.kind)
        a, b, tail = list(jobs.a), list(jobs.b), np.array(jobs.tail)
        x = [min(max(guess, low), high) for guess, low, high in zip(jobs.guess, a, b, strict=True)]
        L_at, size_at = [0j] * count, [0.0] * count
        open_ = list(range(count))
        for step in range(_MAX_NEWTON):
            values = self.locus.second(np.array([x[i] for i in open_]), tail[open_])
            still = []
            for i, L, S, size, C in zip(open_, *(value.tolist() for value in values), strict=True):
                kind = jobs.kind[i]
                L_at[i], size_at[i] = L, size
                g, dg = _equation(kind, L, S, C)
                if (g >= 0.0) == jobs.positive_at_a[i]:
                    a[i] = x[i]
                else:
                    b[i] = x[i]
                # The place of a minimum needs half the digits only: the function is flat there.
                tolerance = 1e-13 if kind in self.found else 1e-8
                if step > 10:  # round-off keeps the last digits from settling
                    tolerance = max(tolerance, min(1e-13 * 4.0 ** (step - 10), 1e-11))
                move = g / dg if dg != 0.0 else math.inf
                if abs(move) <= tolerance * x[i] or b[i] - a[i] <= 4.0 * _EPS * b[i]:
                    continue
                new = x[i] - move
                x[i] = new if a[i] < new < b[i] else 0.5 * (a[i] + b[i])
                still.append(i)
            open_ = still
            if not open_:
                break
        return x, L_at, size_at

    def _keep(self, kind: int, x: float, tail: bool, L: complex) -> None:
        if kind == _UNIT_CIRCLE or -HUGE < L.real < -FAINT:
            self.found[kind].append((_omega(x, tail), L))

    def _points(self, kind: int) -> Points:
        other = _REAL_AXIS + _UNIT_CIRCLE - kind
        through = [(w, L) for w, L in self.found[other] if abs(L + 1.0) <= _TOUCH]
        kept: list[tuple[float, complex]] = []
        for w, L in sorted(self.found[kind] + through, key=lambda point: point[0]):
            if not kept or (w > kept[-1][0] and not w - kept[-1][0] <= _SAME * kept[-1][0]):
                kept.append((w, L))
        return Points(np.array([w for w, _ in kept], dtype=float), np.array([L for _, L in kept], dtype=complex))


def _equation(kind: int, L: complex, S: complex, C: complex) -> tuple[float, float]:
    """The function whose root a job seeks, and its derivative, from L, dL/dx and d2L/dx2."""
    if kind == _REAL_AXIS:
        return L.imag, S.imag
    if kind == _UNIT_CIRCLE:
        return (math.log(abs(L)), (S / L).real) if L != 0.0 else (-math.inf, 0.0)
    if kind == _AXIS_EXTREMUM:
        return S.imag, C.imag
    # Half the derivative of |F|^2, with F = L, 1 + L or (1 + L)/(1 - L).
    if kind == _NEAREST:
        L = 1.0 + L
    elif kind == _DISK:
        if L == 1.0:
            return math.inf, 0.0
        u = 1.0 / (1.0 - L)
        L, S, C = (1.0 + L) * u, 2.0 * S * u * u, (2.0 * C + 4.0 * S * S * u) * u * u
    F = L.conjugate()
    return (F * S).real, abs(S) ** 2 + (F * C).real


class _Samples:
    """The ends of the first intervals, for the minima of |1 + L| and of 2 |1 + L| / |1 - L|."""

    def __init__(self, intervals: Intervals) -> None:
        self.intervals = intervals

    def best(self, polished: list[tuple[float, complex]], size: Callable[[ComplexArray], FloatArray]) -> Points:
        """The smallest of the polished minima and of the samples."""
        v = self.intervals
        L = np.concatenate(([L for _, L in polished], v.L0, v.L1))
        i = int(size(L).argmin())
        if i < len(polished):
            omega = polished[i][0]
        else:
            k = (i - len(polished)) % v.x0.size
            x = v.x0 if i - len(polished) < v.x0.size else v.x1
            omega = _omega(float(x[k]), bool(v.tail[k]))
        return Points(np.array([omega]), L[i : i + 1])


def _omega(x: float, tail: bool) -> float:
    return (1.0 / x if x > 0.0 else math.inf) if tail else x


def _distance(L: ComplexArray) -> FloatArray:
    return np.abs(1.0 + L)


def _disk_size(L: ComplexArray) -> FloatArray:
    return np.abs(1.0 + L) / np.maximum(np.abs(1.0 - L), _EPS)


def _decades(L: ComplexArray) -> FloatArray:
    return np.abs(np.log(np.abs(L)))


def _turn(L: ComplexArray) -> FloatArray:
    return np.abs(np.angle(-L))
