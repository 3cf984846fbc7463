"""Margins of a loop known at frequencies only: interpolation, its error, and Nyquist's count.

Between the points L is the cubic in ln(omega) through the four nearest ones; the parabolas through three of them on
either side tell how far off it may be. Stability is counted from the turns of 1 + L around the origin, with the number
of unstable open-loop poles given; where the data do not decide, nothing is decided. docs/theory/margins.md.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pilotgen.errors import PilotgenError
from pilotgen.linear.statespace import ComplexArray, FloatArray
from pilotgen.loop.crossings import FAINT, HUGE, LocusFeatures, Points

LEAST_POINTS = 8
_SAMPLES = 32  # of the interpolant between two points
_Lowest = tuple[FloatArray, ComplexArray, FloatArray]  # omega, L, possible error; one of each
_CLOSING = math.radians(30.0)  # the locus may be this far from the real axis at the ends of the data


@dataclass(frozen=True, eq=False)
class FrequencyData:
    """L(j omega) at rising frequencies.

    Parameters
    ----------
    omega : ndarray, shape (m,)
        [rad/s], positive, rising.
    L : ndarray of complex, shape (m,)
        The loop there.
    unstable_poles : int, optional
        Poles of L in the open right half plane; None if not known.
    poles_at_origin : int
        Integrators in L.
    error : ndarray, shape (m,), optional
        How far off each value may be, as data; none if left out.

    Raises
    ------
    PilotgenError
        Too few points, lengths that differ, or frequencies that do not rise.
    """

    omega: FloatArray
    L: ComplexArray
    unstable_poles: int | None = None
    poles_at_origin: int = 0
    error: FloatArray | None = None

    def __post_init__(self) -> None:
        if self.omega.size != self.L.size:
            raise PilotgenError(f"{self.omega.size} frequencies beside {self.L.size} values")
        if self.omega.size < LEAST_POINTS:
            raise PilotgenError(f"{self.omega.size} frequencies; margins by interpolation need {LEAST_POINTS} or more")
        if not (np.isfinite(self.omega).all() and np.isfinite(self.L).all()):
            raise PilotgenError("a frequency or value is not finite")
        if self.omega[0] <= 0.0:
            raise PilotgenError(
                f"the first frequency is {self.omega[0]:g} rad/s; they start above zero (leave a point at zero out)"
            )
        falls = np.nonzero(np.diff(self.omega) <= 0.0)[0]
        if falls.size:
            i = int(falls[0])
            raise PilotgenError(
                f"frequencies must rise: number {i + 2} ({self.omega[i + 1]:g} rad/s) follows {self.omega[i]:g} rad/s; "
                "sort them, with their values"
            )


@dataclass(frozen=True)
class FrequencyAnswer:
    """What the data tell: features with the possible error of L at each point, and stability or why it is not told."""

    features: LocusFeatures
    stable: bool | None
    reason: str
    axis_error: FloatArray
    circle_error: FloatArray
    nearest_error: float
    disk_error: float


def from_data(data: FrequencyData) -> FrequencyAnswer:
    """Crossings, nearest points and stability of the interpolated locus."""
    curve = _Curve(data)
    u = np.tile(np.arange(_SAMPLES) / _SAMPLES, curve.intervals)
    i = np.repeat(np.arange(curve.intervals), _SAMPLES)
    i, u = np.append(i, curve.intervals - 1), np.append(u, 1.0)
    L = curve.at(i, u)[0]
    axis = curve.roots(i, u, L, lambda v: v.imag)
    kept = (-HUGE < axis[1].real) & (axis[1].real < -FAINT)
    axis = tuple(part[kept] for part in axis)  # type: ignore[assignment]
    circle = curve.roots(i, u, L, lambda v: np.abs(v) - 1.0)
    rest = _at_rest(data)
    if rest is not None and -HUGE < rest[0] < -max(FAINT, rest[1]):
        axis = tuple(np.concatenate(([first], part)) for first, part in zip((0.0, *rest), axis, strict=True))  # type: ignore[assignment]
    nearest = _with_ends(curve.lowest(i, u, L, _distance), _distance, rest)
    disk = _with_ends(curve.lowest(i, u, L, _disk_size), _disk_size, rest)
    features = LocusFeatures(
        Points(axis[0], axis[1].real.astype(complex)),
        Points(circle[0], circle[1]),
        Points(nearest[0], nearest[1]),
        Points(disk[0], disk[1]),
        float(np.abs(1.0 + nearest[1][0])),
        float(2.0 * np.abs(1.0 + disk[1][0]) / max(abs(1.0 - disk[1][0]), 1e-300)),
    )
    stable, reason = _count(data, curve, i, u, L)
    at_disk = complex(disk[1][0])
    slope = 2.0 / abs(1.0 - at_disk) * (1.0 + abs(1.0 + at_disk) / abs(1.0 - at_disk)) if at_disk != 1.0 else math.inf
    # Beyond the data |L| may be anything up to its last value.
    beyond = np.array([-min(abs(data.L[-1]), 1.0)], dtype=complex)
    return FrequencyAnswer(
        features,
        stable,
        reason,
        axis[2],
        circle[2],
        max(float(nearest[2][0]), features.distance - float(_distance(beyond)[0])),
        max(slope * float(disk[2][0]), features.alpha - float(_disk_size(beyond)[0])),
    )


def _distance(L: ComplexArray) -> FloatArray:
    return np.asarray(np.abs(1.0 + L))


def _disk_size(L: ComplexArray) -> FloatArray:
    return np.asarray(2.0 * np.abs(1.0 + L) / np.maximum(np.abs(1.0 - L), 1e-300))


def _at_rest(data: FrequencyData) -> tuple[float, float] | None:
    """L(0), which is real, and how far off it may be; None if it is infinite or the data do not come near the axis.

    The real part of L is even in omega: a parabola in omega^2 through the first point and those an octave and two above
    it. How far off: its distance from the straight line through the first two.
    """
    if data.poles_at_origin or abs(data.L[0].imag) > math.tan(_CLOSING) * abs(data.L[0].real):
        return None
    last = data.omega.size - 1
    second = min(int(np.searchsorted(data.omega, 2.0 * data.omega[0])), last - 1)
    third = min(max(int(np.searchsorted(data.omega, 4.0 * data.omega[0])), second + 1), last)
    at = [0, second, third]
    x, L = data.omega[at] ** 2, data.L[at].real
    line = (x[1:] * L[:2] - x[:2] * L[1:]) / (x[1:] - x[:2])
    curve = line[0] - (line[1] - line[0]) * x[0] / (x[2] - x[0])
    error = abs(curve - line[0]) + (float(data.error[0]) if data.error is not None else 0.0)
    return float(curve), float(error)


def _with_ends(found: _Lowest, f: Callable[[ComplexArray], FloatArray], rest: tuple[float, float] | None) -> _Lowest:
    """What is lowest, with omega = 0 counted in."""
    omega, L, error = found
    if rest is not None and f(np.array([rest[0]], dtype=complex))[0] < f(L)[0]:
        return np.zeros(1), np.array([rest[0]], dtype=complex), np.array([rest[1]])
    return omega, L, error


class _Curve:
    """The interpolant on each interval, u in [0, 1] along ln(omega), and the distance of the parabolas beside it."""

    def __init__(self, data: FrequencyData) -> None:
        self.x, self.L, self.error = np.log(data.omega), data.L, data.error
        self.intervals = data.omega.size - 1

    def at(self, i: np.ndarray, u: FloatArray) -> tuple[ComplexArray, FloatArray]:
        """L and how far off it may be, on intervals i at u."""
        x = self.x[i] + u * (self.x[i + 1] - self.x[i])
        first = np.clip(i - 1, 0, self.intervals - 3)
        left, right = self._parabola(first, x), self._parabola(first + 1, x)
        # the cubic through four points is a mean of the parabolas through the first and the last three
        share = (x - self.x[first]) / (self.x[first + 3] - self.x[first])
        error: FloatArray = np.abs(left - right)
        if self.error is not None:
            error = error + np.maximum(self.error[i], self.error[i + 1])
        return left + share * (right - left), error

    def _parabola(self, first: np.ndarray, x: FloatArray) -> ComplexArray:
        a, b, c = self.x[first], self.x[first + 1], self.x[first + 2]
        value: ComplexArray = (
            self.L[first] * ((x - b) * (x - c) / ((a - b) * (a - c)))
            + self.L[first + 1] * ((x - a) * (x - c) / ((b - a) * (b - c)))
            + self.L[first + 2] * ((x - a) * (x - b) / ((c - a) * (c - b)))
        )
        return value

    def omega(self, i: np.ndarray, u: FloatArray) -> FloatArray:
        """[rad/s]"""
        return np.asarray(np.exp(self.x[i] + u * (self.x[i + 1] - self.x[i])))

    def roots(
        self, i: np.ndarray, u: FloatArray, L: ComplexArray, f: Callable[[ComplexArray], FloatArray]
    ) -> tuple[FloatArray, ComplexArray, FloatArray]:
        """omega, L and its possible error where f changes sign."""
        positive = f(L) >= 0.0
        at = np.nonzero(positive[:-1] != positive[1:])[0]
        i, a, start = i[at], u[at], positive[at]
        b = a + 1.0 / _SAMPLES
        for _ in range(50):
            middle = 0.5 * (a + b)
            same = (f(self.at(i, middle)[0]) >= 0.0) == start
            a, b = np.where(same, middle, a), np.where(same, b, middle)
        return self.omega(i, a), *self.at(i, a)

    def lowest(
        self, i: np.ndarray, u: FloatArray, L: ComplexArray, f: Callable[[ComplexArray], FloatArray]
    ) -> tuple[FloatArray, ComplexArray, FloatArray]:
        """omega, L and its possible error where f is smallest."""
        best = int(f(L).argmin())
        place, width = i[best] + u[best], 1.0 / _SAMPLES
        for _ in range(5):
            fine = np.clip(place + width * np.linspace(-1.0, 1.0, 65), 0.0, float(self.intervals))
            j = np.minimum(fine.astype(int), self.intervals - 1)
            k = int(f(self.at(j, fine - j)[0]).argmin())
            place, width = fine[k], width / 16.0
        one = np.array([min(int(place), self.intervals - 1)])
        return self.omega(one, place - one), *self.at(one, place - one)


def _count(
    data: FrequencyData, curve: _Curve, i: np.ndarray, u: FloatArray, L: ComplexArray
) -> tuple[bool | None, str]:
    """Whether the closed loop is stable by Nyquist's count, or None and the reason."""
    if data.unstable_poles is None:
        return None, "the number of unstable open-loop poles is not given (open_loop_unstable_poles)"
    error = curve.at(i, u)[1]
    near = np.abs(1.0 + L) <= 2.0 * error
    if near.any():
        k = int(near.argmax())
        omega = curve.omega(i[k : k + 1], u[k : k + 1])[0]
        return None, (
            f"at {omega:.6g} rad/s the interpolated locus is {abs(1.0 + L[k]):.3g} "
            f"from -1 and may be off by {error[k]:.3g}; measure more points there"
        )
    turns = np.angle((1.0 + L[1:]) / (1.0 + L[:-1]))
    if np.abs(turns).max() > 0.5 * math.pi:
        k = int(np.abs(turns).argmax())
        return None, f"the locus turns too fast around -1 near {curve.omega(i[k : k + 1], u[k : k + 1])[0]:.6g} rad/s"
    k = data.poles_at_origin
    first = L[0] if k else 1.0 + L[0]
    start = float(np.angle(first)) + 0.5 * math.pi * k
    start -= math.pi * round(start / math.pi)
    with np.errstate(divide="ignore", invalid="ignore"):
        fall = -float(np.diff(np.log(np.abs(data.L[:2])))[0] / np.diff(curve.x[:2])[0])  # power of 1 / omega
    arrived = abs(start) <= _CLOSING and fall < k + 0.5 and (k == 0 or (fall > k - 0.5 and abs(L[0]) > 1.0))
    if not arrived:
        return None, (
            f"at the lowest frequency, {data.omega[0]:.6g} rad/s, L = {L[0]:.4g} is not where a loop with {k} poles at "
            "the origin ends; measure lower, or state open_loop_poles_at_origin"
        )
    end = float(np.angle(1.0 + L[-1]))
    end -= math.pi * round(end / math.pi)
    if abs(end) > _CLOSING or abs(L[-1]) >= 1.0:
        return None, (
            f"at the highest frequency, {data.omega[-1]:.6g} rad/s, L = {L[-1]:.4g} is not yet small; measure higher"
        )
    total = start - 0.5 * math.pi * k + float(turns.sum()) - end
    unstable = data.unstable_poles - round(total / math.pi)
    if unstable < 0:
        return None, (
            f"the locus turns {round(total / math.pi)} times around -1, which {data.unstable_poles} unstable open-loop "
            "poles do not allow; check open_loop_unstable_poles and the sign of L"
        )
    return unstable == 0, ""
