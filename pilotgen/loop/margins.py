"""Stability margins of a loop: every crossing, then gain, phase, modulus, delay and disk margin.

Conventions (docs/theory/margins.md). The loop is closed with negative feedback; the critical point is -1. Stability
comes from the closed-loop eigenvalues and from nowhere else. Gain and phase margin take the sign of stability.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg

from pilotgen.errors import PilotgenError
from pilotgen.linear.exact import Rational, quotient, rational
from pilotgen.linear.partial_fractions import PartialFractions
from pilotgen.linear.statespace import StateSpaceModel
from pilotgen.loop.crossings import LocusFeatures, Points, constant_features, locus_features
from pilotgen.loop.frequency_data import FrequencyAnswer, FrequencyData, from_data
from pilotgen.loop.loop import LoopModel
from pilotgen.loop.verified import affordable, verified

_TWO_PI = 2.0 * math.pi
_EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Crossing:
    """One crossing of the locus L(j omega).

    Parameters
    ----------
    kind : str
        "real axis" (L real and negative) or "unit circle" (|L| = 1).
    frequency_hz : float
        0 and infinity included.
    value : complex
        L there.
    """

    kind: str
    frequency_hz: float
    value: complex

    @property
    def gain_db(self) -> float:
        """-20 log10 |L|: the change of loop gain [dB] that brings this point to |L| = 1."""
        return -20.0 * math.log10(abs(self.value))

    @property
    def phase_deg(self) -> float:
        """Angle of -L [deg], in (-180, 180]: the lag (if positive) that brings this point to the negative axis."""
        return math.degrees(math.atan2(-self.value.imag, -self.value.real))


@dataclass(frozen=True)
class Margins:
    """Margins of one loop; `math.inf` where nothing limits, frequencies None where there is no such point.

    Parameters
    ----------
    stable : bool or None
        All closed-loop eigenvalues lie in the open left half plane; None if that cannot be told (`largest_real_part`
        says why), and then gain, phase, delay and disk margin are NaN.
    gain_margin_db, gain_margin_hz : float, float or None
        Smallest |20 log10 |L|| over the real-axis crossings; negative if not stable.
    phase_margin_deg, phase_margin_hz : float, float or None
        Smallest |angle(-L)| over the unit-circle crossings; negative if not stable.
    modulus_margin, modulus_margin_hz : float, float
        min |1 + L|, a distance: never negative, and meaningful as a margin only if stable.
    delay_margin_s, delay_margin_hz : float, float or None
        Smallest delay in the loop that makes it unstable, and the crossing where; 0 if it is not stable already.
    disk_margin, disk_margin_hz : float, float or None
        Balanced disk margin alpha = min 2 |1 + L| / |1 - L|; 0 if not stable.
    crossings : tuple of Crossing
        All of them, by rising frequency.
    largest_real_part : tuple of float, optional
        Where stability cannot be told: an interval [rad/s] that holds the largest real part of the closed-loop
        eigenvalues, zero included.
    """

    stable: bool | None
    gain_margin_db: float
    gain_margin_hz: float | None
    phase_margin_deg: float
    phase_margin_hz: float | None
    modulus_margin: float
    modulus_margin_hz: float
    delay_margin_s: float
    delay_margin_hz: float | None
    disk_margin: float
    disk_margin_hz: float
    crossings: tuple[Crossing, ...]
    largest_real_part: tuple[float, float] | None = None

    @property
    def disk_gain_margin_db(self) -> float:
        """Gain change, up or down [dB], that the disk margin guarantees together with any phase in the disk."""
        if self.disk_margin >= 2.0:
            return math.inf
        return 20.0 * math.log10((2.0 + self.disk_margin) / (2.0 - self.disk_margin))

    @property
    def disk_phase_margin_deg(self) -> float:
        """Phase change, lead or lag [deg], that the disk margin guarantees."""
        return math.degrees(2.0 * math.atan(0.5 * self.disk_margin))

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready values; None where a margin or frequency is infinite, absent or not told."""
        told = {
            "stable": self.stable,
            "gain_margin_db": _json(self.gain_margin_db),
            "gain_margin_hz": _json(self.gain_margin_hz),
            "phase_margin_deg": _json(self.phase_margin_deg),
            "phase_margin_hz": _json(self.phase_margin_hz),
            "modulus_margin": _json(self.modulus_margin),
            "modulus_margin_hz": _json(self.modulus_margin_hz),
            "delay_margin_s": _json(self.delay_margin_s),
            "disk_margin": _json(self.disk_margin),
            "disk_margin_hz": _json(self.disk_margin_hz),
            "crossings": [
                {
                    "kind": crossing.kind,
                    "frequency_hz": _json(crossing.frequency_hz),
                    "real": crossing.value.real,
                    "imag": crossing.value.imag,
                }
                for crossing in self.crossings
            ],
        }
        return told if self.largest_real_part is None else {**told, "largest_real_part": list(self.largest_real_part)}


def margins(loop: LoopModel | StateSpaceModel) -> Margins:
    """All margins of a loop closed with unity negative feedback.

    A LoopModel, a pilot on a rotorcraft, is judged in double precision with error bounds; whatever these leave open is
    handed to exact arithmetic. A StateSpaceModel may be anything: it goes to exact arithmetic at once. Loops too large
    for that keep the answer of double precision; where it cannot tell stability, `stable` is None.

    Parameters
    ----------
    loop : LoopModel or StateSpaceModel
        L(s), proper; a LoopModel stands for its `open_loop`.

    Raises
    ------
    PilotgenError
        The loop's eigenvalues cannot be computed.
    """
    if isinstance(loop, LoopModel):
        model, fractions, quick = loop.open_loop, loop.partial_fractions, True
    else:
        model, fractions, quick = loop, None, False
    exact = affordable(model)
    if quick or not exact:
        largest = largest_real_part(model)
        features = _features(model, fractions)
        told = largest is None or not largest[0] <= 0.0 <= largest[1]
        if (told and not features.doubtful) or not exact:
            stable = (largest is not None and largest[1] < 0.0) if told else None
            return _margins(model.D, stable, features, None if told else largest)
    return exact_margins(rational(model))


def exact_margins(loop: Rational) -> Margins:
    """All margins of a loop num / den closed with unity negative feedback, by exact arithmetic."""
    answer = verified(loop)
    D = quotient(loop.num[-1], loop.den[-1]) if len(loop.num) == len(loop.den) else 0.0
    return _margins(D, answer.stable, answer.features, None)


def data_margins(data: FrequencyData) -> tuple[Margins, FrequencyAnswer]:
    """All margins of a loop known at frequencies only, and how well they are known.

    `stable` is None, and with it the margins NaN, where the data do not tell; the answer's `reason` says why.
    """
    answer = from_data(data)
    return _margins(0.0, answer.stable, answer.features, None), answer


def _features(model: StateSpaceModel, fractions: PartialFractions | None) -> LocusFeatures:
    if model.n_states == 0 or not model.B.any() or not model.C.any():
        return constant_features(model.D)
    return locus_features(model, fractions)


def _margins(D: float, stable: bool | None, features: LocusFeatures, interval: tuple[float, float] | None) -> Margins:
    sign = math.nan if stable is None else 1.0 if stable else -1.0
    none = math.nan if stable is None else 0.0
    axis, circle = features.real_axis, features.unit_circle
    gain, gain_hz = math.inf, None
    if axis.L.size:
        decibels = np.abs(20.0 * np.log10(np.abs(axis.L)))
        i = int(decibels.argmin())
        gain, gain_hz = float(decibels[i]), float(axis.omega[i]) / _TWO_PI
    phase, phase_hz = math.inf, None
    if circle.L.size:
        degrees = np.degrees(np.abs(np.angle(-circle.L)))
        i = int(degrees.argmin())
        phase, phase_hz = float(degrees[i]), float(circle.omega[i]) / _TWO_PI
    delay, delay_hz = _delay_margin(D, circle) if stable else (none, None)
    return Margins(
        stable=stable,
        gain_margin_db=sign * gain,
        gain_margin_hz=gain_hz,
        phase_margin_deg=sign * phase,
        phase_margin_hz=phase_hz,
        modulus_margin=features.distance,
        modulus_margin_hz=float(features.nearest.omega[0]) / _TWO_PI,
        delay_margin_s=delay,
        delay_margin_hz=delay_hz,
        disk_margin=features.alpha if stable else none,
        disk_margin_hz=float(features.disk.omega[0]) / _TWO_PI,
        crossings=_crossings(axis, circle),
        largest_real_part=interval,
    )


def largest_real_part(model: StateSpaceModel) -> tuple[float, float] | None:
    """An interval [rad/s] that holds the largest real part of the closed loop's eigenvalues.

    PilotgenError if the eigenvalues cannot be computed.

    None if the loop is ill-posed, 1 + L(infinity) = 0. The eigenvalues come with round-off: those computed belong to a
    matrix that differs by n eps times its norm, and move by that times the condition of the eigenvectors at most
    (Bauer and Fike). Defective eigenvalues therefore give a wide interval, and so do fast ones beside slow ones.
    """
    if model.D == -1.0:
        return None
    n = model.n_states
    if n == 0:
        return -math.inf, -math.inf
    try:
        A, _ = scipy.linalg.matrix_balance(model.A - model.B[:, None] * (model.C / (1.0 + model.D)), permute=False)
        poles, vectors = np.linalg.eig(A)
    except np.linalg.LinAlgError as error:
        raise PilotgenError(f"the closed loop's eigenvalues cannot be computed: {error}") from error
    reach = n * _EPS * float(np.linalg.norm(A)) * float(np.linalg.cond(vectors))
    top = float(poles.real.max())
    return top - reach, top + reach


def _delay_margin(D: float, circle: Points) -> tuple[float, float | None]:
    """Smallest delay [s] that turns a unit-circle crossing into -1, omega tau = angle(-L) modulo 2 pi; where [Hz]."""
    if abs(D) >= 1.0:
        return 0.0, math.inf  # the gain does not fall below 1: any delay destabilises at a high enough frequency
    delays = [
        ((math.atan2(-L.imag, -L.real) % _TWO_PI) / omega, omega / _TWO_PI)
        for omega, L in zip(circle.omega.tolist(), circle.L.tolist(), strict=True)
        if omega > 0.0
    ]
    return min(delays, default=(math.inf, None))


def _crossings(axis: Points, circle: Points) -> tuple[Crossing, ...]:
    found = [
        Crossing(kind, omega / _TWO_PI, L)
        for kind, points in (("real axis", axis), ("unit circle", circle))
        for omega, L in zip(points.omega.tolist(), points.L.tolist(), strict=True)
    ]
    return tuple(sorted(found, key=lambda crossing: crossing.frequency_hz))


def _json(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
