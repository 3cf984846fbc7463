"""Where a loop's frequency response crosses the unit circle and the negative real axis, and where it is nearest to -1.

The Bernstein coefficients of the interpolant on each interval of `locus`, with its error bound, enclose the locus:
intervals that hold no crossing, or nothing nearer to -1 than what is known, fall away; undecided ones are split; the
rest is polished by a safeguarded Newton iteration on the exact response. What double precision cannot settle is marked
as doubtful, for `verified`. The method and its reasons: docs/theory/margins.md.

Second of three, after `locus`. Read `locus_features`, `_Search.run`, then what `run` calls, in that order.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from pilotgen.linear.partial_fractions import PartialFractions
from pilotgen.linear.statespace import ComplexArray, FloatArray, StateSpaceModel
from pilotgen.loop.locus import FIRST_ERROR, GUESS_POINTS, BoolArray, Intervals, Locus, basis

_EPS = float(np.finfo(float).eps)
_MAX_SPLITS = 16  # halvings; a touch that is undecided after so many is closer than _TOUCH
_MAX_OPEN = 4096  # intervals; more are open only if the locus follows the circle or the axis within round-off
_TOUCH = 1e-10  # an extremum of |L| within this of 1, or with |Im L| / |L| below this, is a touch
_NEAR_TOUCH = 4e4 * _EPS  # an extremum this close (of that sum) may be a touch
_NOISE = 1e3 * _EPS  # |L| below this fraction of the sum of its terms' moduli is round-off
_SURE = 1e-9  # relative round-off in a crossing's frequency or value, or in |1 + L|, beyond which it is doubtful
_UNSURE, _LEAST = 1e-6, 1.0  # error of L by that of A, relative to L (or to this, if L is less), that leaves doubt
_LARGE, _ROUGH = 1e3, 1e-3  # |L| beyond which a larger one does
_SAME = 1e-9  # relative distance in frequency below which two roots are one
DIM = 1e-6  # a crossing fainter than this (120 dB) may be off by its round-off and leaves no doubt about margins
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

    `nearest` minimises |1 + L|, `disk` minimises 2 |1 + L| / |1 - L|; one point each, with these values. `doubtful`:
    round-off or a touch leaves some of it open.
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


def locus_features(
    model: StateSpaceModel, fractions: PartialFractions | None = None, dim: float = DIM
) -> LocusFeatures:
    """Crossings and nearest points of the locus L(j omega), 0 <= omega <= infinity, of a proper loop.

    Parameters
    ----------
    model : StateSpaceModel
        The loop L, one input and output, at least one state.
    fractions : PartialFractions, optional
        The same as a sum of partial fractions, if its poles are apart: quicker.
    dim : float
        |L| of the faintest crossing of the axis whose round-off leaves doubt.
    """
    with np.errstate(all="ignore"):  # infinite next to a pole, 0/0 at an end: met where it happens
        return _Search(Locus(model, fractions), dim).run()


class _Search:
    def __init__(self, locus: Locus, dim: float) -> None:
        self.locus = locus
        self.dim = dim
        self.jobs = _Jobs()
        self.found: dict[int, list[tuple[float, complex]]] = {_REAL_AXIS: [], _UNIT_CIRCLE: []}
        self.minima: dict[int, list[tuple[float, complex]]] = {_NEAREST: [], _DISK: []}
        self.doubtful = locus.doubtful

    def run(self) -> LocusFeatures:
        intervals = self.locus.intervals()
        self._ends()
        undecided = self._sort_out(intervals)
        for _ in range(_MAX_SPLITS):
            if undecided.x0.size == 0 or undecided.x0.size > _MAX_OPEN:
                break
            undecided = self._sort_out(self.locus.split(undecided))
        self._give_up(undecided)
        self._queue_minima(intervals)
        self._polish_all()
        nearest, distance = self._best(_NEAREST)
        disk, ratio = self._best(_DISK)
        self.doubtful = self.doubtful or self._ill_conditioned(intervals)
        return LocusFeatures(
            self._points(_REAL_AXIS), self._points(_UNIT_CIRCLE), nearest, disk, distance, 2.0 * ratio, self.doubtful
        )

    def _ill_conditioned(self, v: Intervals) -> bool:
        """Whether a matrix some eps away from A has another locus: clusters of light modes, fast poles beside them."""
        off = self.locus.unsure(v.x0, v.tail)
        size = np.abs(v.L0)
        return bool((off > np.where(size < _LARGE, _UNSURE * np.maximum(size, _LEAST), _ROUGH * size)).any())

    # Deciding

    def _sort_out(self, v: Intervals) -> Intervals:
        """Queue a job for every interval that can be judged; return those to split."""
        P = v.P
        axis, axis_error = P.imag.copy(), v.error.copy()
        biggest = v.biggest
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
        # A modulus of 1 or more can occur only where the coefficients reach as far.
        outside = biggest + v.error >= 1.0
        circle_error = (2.0 * biggest + v.error) * v.error

        wait_axis = self._judge(_REAL_AXIS, v, v.check_axis & left, axis, axis_error)
        wait_circle = self._judge(_UNIT_CIRCLE, v, v.check_circle & outside, v.square - 1.0, circle_error)
        again = wait_axis | wait_circle
        rest = v.take(again)
        rest.check_axis, rest.check_circle = wait_axis[again], wait_circle[again]
        return rest

    def _judge(self, kind: int, v: Intervals, which: BoolArray, f: FloatArray, error: FloatArray) -> BoolArray:
        """Brackets and extrema from the Bernstein coefficients f, shape (m, degree + 1); returns what stays open."""
        open_ = np.zeros(which.size, dtype=bool)
        i = np.nonzero(which)[0]
        if i.size:
            f, error = f[i], error[i]
            zero = (f.min(axis=1) <= error) & (f.max(axis=1) >= -error)
            i, f, margin = i[zero], f[zero], error[zero][:, None]
        if i.size == 0:
            return open_
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
        open_[i[~(bracket | turning | clear)]] = True
        return open_

    def _give_up(self, v: Intervals) -> None:
        """Intervals that no halving decides: bracket what changes sign, and say that there is doubt."""
        if v.x0.size == 0:
            return
        self.doubtful |= bool((v.check_circle | (v.biggest + v.error > DIM)).any())
        for kind, check, f0, f1 in (
            (_REAL_AXIS, v.check_axis, v.L0.imag, v.L1.imag),
            (_UNIT_CIRCLE, v.check_circle, np.abs(v.L0) - 1.0, np.abs(v.L1) - 1.0),
        ):
            i = np.nonzero(check & ~v.from_end & ((f0 >= 0.0) != (f1 >= 0.0)))[0]
            self.jobs.add(kind, v.x0[i], v.x1[i], 0.5 * (v.x0[i] + v.x1[i]), f0[i] >= 0.0, v.tail[i])

    def _ends(self) -> None:
        for omega, end in ((0.0, self.locus.zero), (math.inf, self.locus.infinity)):
            if end is not None and end.order == 0:
                if -HUGE < end.K0 < -FAINT:
                    self.found[_REAL_AXIS].append((omega, complex(end.K0)))
                if abs(abs(end.K0) - 1.0) <= _TOUCH:
                    self.doubtful = True
                    self.found[_UNIT_CIRCLE].append((omega, complex(end.K0)))

    # Polishing

    def _queue_minima(self, v: Intervals) -> None:
        """Queue every interval that may hold a point nearer to -1, in either sense, than the ends of all intervals."""
        near, disk = math.inf, math.inf
        wanted: BoolArray | None = None  # for which of the two senses an interval is still open; None: all are
        for _ in range(_MAX_SPLITS):
            near = min(near, self._best_end(v, _NEAREST) ** 2)
            disk = min(disk, self._best_end(v, _DISK) ** 2)
            # q = |1 + L|^2 - near or |1 + L|^2 - disk |1 - L|^2 is negative where L is better, give or take the slack
            q = np.concatenate(
                (v.square + v.twice_real + (1.0 - near), (1.0 - disk) * (v.square + 1.0) + (1.0 + disk) * v.twice_real)
            )
            slack = np.concatenate(
                (
                    v.bound * (2.0 * math.sqrt(near) + v.bound),
                    v.bound * (2.0 * math.sqrt(disk) + v.bound + disk * (2.0 + 2.0 * v.biggest + v.bound)),
                )
            )
            better = q.min(axis=1) < slack
            i = np.nonzero(better if wanted is None else better & wanted)[0]
            if i.size == 0:
                return
            f, margin = q[i], slack[i][:, None]
            slope = f[:, 1:] - f[:, :-1]
            bend = slope[:, 1:] - slope[:, :-1]
            turns = (bend > margin).all(axis=1)
            # A convex q is lowest inside only if its exact slopes at the ends say so; otherwise an end has it, which is
            # not better. Where the ratio of the disk margin does not fall and rise like its q, halves will tell.
            count = v.x0.size
            monotone = (slope > margin).all(axis=1) | (slope < -margin).all(axis=1)
            split: BoolArray = np.logical_not(turns | monotone)
            bottom: dict[int, list[int]] = {_NEAREST: [], _DISK: []}
            for k in np.nonzero(turns)[0].tolist():
                kind, row = (_NEAREST, i[k]) if i[k] < count else (_DISK, i[k] - count)
                ends = complex(v.L0[row]), complex(v.S0[row]), complex(v.L1[row]), complex(v.S1[row])
                if _valley(0.0 if kind == _NEAREST else disk, *ends):
                    if kind == _NEAREST or _valley(None, *ends):
                        bottom[kind].append(k)
                    else:
                        split[k] = True
            for kind, found in bottom.items():
                if found:
                    j = i[found] % count
                    guess = v.x0[j] + (v.x1[j] - v.x0[j]) * _bernstein_root(slope[found])
                    self.jobs.add(kind, v.x0[j], v.x1[j], guess, np.zeros(j.size, dtype=bool), v.tail[j])
            rest = i[split]
            if rest.size == 0:
                return
            if rest.size > _MAX_OPEN:
                break
            open_ = np.zeros((2, count), dtype=bool)
            open_.reshape(-1)[rest] = True
            keep: BoolArray = open_[0] | open_[1]
            v = self.locus.split(v.take(keep))
            wanted = np.tile(open_[:, keep], 2).reshape(-1)
        self.doubtful = True

    def _best_end(self, v: Intervals, kind: int) -> float:
        """The smallest value at the starts of these intervals and the last one's end: all ends, on the first grid."""
        L = np.append(v.L0, v.L1[-1:])
        values = _distance(L) if kind == _NEAREST else _disk_size(L)
        i = int(values.argmin())
        x = float(v.x0[i] if i < v.x0.size else v.x1[-1])
        self.minima[kind].append((_omega(x, bool(v.tail[min(i, v.x0.size - 1)])), complex(L[i])))
        return float(values[i])

    def _best(self, kind: int) -> tuple[Points, float]:
        """The best of the minima; nothing is nearer to -1 than it, no crossing either."""
        best, point = math.inf, (math.inf, 0j)
        for omega, L in self.minima[kind] + self.found[_REAL_AXIS] + self.found[_UNIT_CIRCLE]:
            value = abs(1.0 + L)
            if kind == _DISK:
                value /= max(abs(1.0 - L), _EPS)
            if value < best:
                best, point = value, (omega, L)
        return Points(np.array([point[0]]), np.array([point[1]])), best

    def _polish_all(self) -> None:
        for _ in range(2):
            jobs, self.jobs = self.jobs, _Jobs()
            if not jobs.kind:
                break
            for i, (x, L, S, size) in enumerate(zip(*self._newton(jobs), strict=True)):
                kind, tail = jobs.kind[i], jobs.tail[i]
                round_off = _EPS * size
                if kind in self.minima:
                    self.minima[kind].append((_omega(x, tail), L))
                    self.doubtful |= round_off > _SURE * abs(1.0 + L)
                elif kind in self.found:
                    if abs(L) > _NOISE * size:
                        self._keep(kind, x, tail, L)
                    # how fast the locus goes through the axis or the circle, against the round-off of L
                    speed = abs(S.imag) if kind == _REAL_AXIS else abs((L.conjugate() * S).real) / (abs(L) or 1.0)
                    counts = kind == _UNIT_CIRCLE or -HUGE < L.real < -self.dim
                    self.doubtful |= counts and round_off > _SURE * min(abs(L), x * speed)
                else:
                    self._extremum(jobs, i, x, L, size)

    def _extremum(self, jobs: _Jobs, i: int, x: float, L: complex, size: float) -> None:
        """A touch, two crossings, or none, at the extremum x between ends where f has one sign."""
        kind = jobs.kind[i] - _AXIS_EXTREMUM
        f = L.imag if kind == _REAL_AXIS else abs(L) - 1.0
        self.doubtful |= abs(f) <= _NEAR_TOUCH * size and (kind == _UNIT_CIRCLE or -HUGE < L.real < -DIM)
        if abs(f) <= (_TOUCH * abs(L) if kind == _REAL_AXIS else _TOUCH):
            self.doubtful |= kind == _UNIT_CIRCLE or -HUGE < L.real < -DIM
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

    def _newton(self, jobs: _Jobs) -> tuple[list[float], list[complex], list[complex], list[float]]:
        """Roots of all jobs: x, L, dL/dx, size of L's terms. The response is evaluated for all open jobs at once."""
        count = len(jobs.kind)
        a, b, tail = list(jobs.a), list(jobs.b), np.array(jobs.tail)
        x = [min(max(guess, low), high) for guess, low, high in zip(jobs.guess, a, b, strict=True)]
        # The place of a minimum needs half the digits of its interval only: the function is flat there.
        close = [1e-13 * high if kind in self.found else 1e-8 * (high - low)
                 for kind, low, high in zip(jobs.kind, a, b, strict=True)]  # fmt: skip
        L_at, S_at, size_at = [0j] * count, [0j] * count, [0.0] * count
        open_ = list(range(count))
        for step in range(_MAX_NEWTON):
            values = self.locus.second(np.array([x[i] for i in open_]), tail[open_])
            still = []
            for i, L, S, size, C in zip(open_, *(value.tolist() for value in values), strict=True):
                L_at[i], S_at[i], size_at[i] = L, S, size
                g, dg = _equation(jobs.kind[i], L, S, C)
                if (g >= 0.0) == jobs.positive_at_a[i]:
                    a[i] = x[i]
                else:
                    b[i] = x[i]
                tolerance = close[i]
                if step > 10:  # round-off keeps the last digits from settling
                    tolerance = max(tolerance, min(1e-13 * 4.0 ** (step - 10), 1e-11) * x[i])
                move = g / dg if dg != 0.0 else math.inf
                if abs(move) <= tolerance or b[i] - a[i] <= 4.0 * _EPS * b[i]:
                    continue
                new = x[i] - move
                x[i] = new if a[i] < new < b[i] else 0.5 * (a[i] + b[i])
                still.append(i)
            open_ = still
            if not open_:
                break
        return x, L_at, S_at, size_at

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


def _valley(t: float | None, L0: complex, S0: complex, L1: complex, S1: complex) -> bool:
    """Whether |1 + L|^2 - t |1 - L|^2, or for None their ratio, falls at one end and rises at the other."""
    L0, L1 = L0.conjugate(), L1.conjugate()
    if t is None:
        return ((1.0 - L0 * L0) * S0).real < 0.0 < ((1.0 - L1 * L1) * S1).real
    return (((1.0 - t) * L0 + 1.0 + t) * S0).real < 0.0 < (((1.0 - t) * L1 + 1.0 + t) * S1).real


def _omega(x: float, tail: bool) -> float:
    return (1.0 / x if x > 0.0 else math.inf) if tail else x


def _distance(L: ComplexArray) -> FloatArray:
    return np.abs(1.0 + L)


def _disk_size(L: ComplexArray) -> FloatArray:
    return np.abs(1.0 + L) / np.maximum(np.abs(1.0 - L), _EPS)
