"""Stability margins of a loop: every crossing, then gain, phase, modulus, delay and disk margin.

Conventions (docs/theory/margins.md). The loop is closed with negative feedback; the critical point is -1. Stability
comes from the closed-loop eigenvalues and from nowhere else. Gain and phase margin take the sign of stability.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import lapack

from pilotgen.errors import PilotgenError
from pilotgen.linear.exact import Rational, quotient, rational
from pilotgen.linear.partial_fractions import PartialFractions, poles_and_residues
from pilotgen.linear.statespace import StateSpaceModel
from pilotgen.loop.crossings import LocusFeatures, constant_features, locus_features
from pilotgen.loop.enclosure import Extended, enclosed_real_part
from pilotgen.loop.frequency_data import FrequencyAnswer, FrequencyData, from_data
from pilotgen.loop.loop import LoopModel
from pilotgen.loop.verified import affordable, verified

REAL_AXIS, UNIT_CIRCLE = "real axis", "unit circle"

_CONDITION = 1e5  # of eigenvectors, up to which a pilot is taken apart into poles and residues (linear/modal.py)
_TWO_PI = 2.0 * math.pi
# Crossings of the axis fainter than this (20 dB) leave no doubt in loops that are too large for exact arithmetic: of a
# margin that no loop lacks a thousandth of a dB may be wrong.
_DIM_OF_LARGE = 0.1
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
        All closed-loop eigenvalues lie in the open left half plane; None if that cannot be told.
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
    not_told : str
        Empty, or why gain, phase, delay and disk margin cannot be told; they are NaN then.
    largest_real_part : tuple of float, optional
        Where stability cannot be told: an interval [rad/s] that holds the largest real part of the closed-loop
        eigenvalues, zero included.
    interpolation_error : mapping of str to float, optional
        Of a loop known at frequencies only: how far off each margin may be.
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
    not_told: str = ""
    largest_real_part: tuple[float, float] | None = None
    interpolation_error: Mapping[str, float | None] | None = None

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready values; None where a margin or frequency is infinite, absent or not told."""
        told: dict[str, Any] = {
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
        if self.not_told:
            told["not_told"] = self.not_told
        if self.largest_real_part is not None:
            told["largest_real_part"] = list(self.largest_real_part)
        if self.interpolation_error is not None:
            told["interpolation_error"] = {key: _json(value) for key, value in self.interpolation_error.items()}
        return told


def margins(loop: LoopModel | StateSpaceModel) -> Margins:
    """All margins of a loop closed with unity negative feedback.

    A LoopModel, a pilot on a rotorcraft, is judged in double precision with error bounds; whatever these leave open is
    handed to exact arithmetic. A StateSpaceModel may be anything: it goes to exact arithmetic at once. Loops too large
    for that keep the answer of double precision, their stability that of eigenvalues enclosed in disks (`enclosure`);
    what these cannot tell is not told (`Margins.not_told`).

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
        model, fractions = loop.open_loop, loop.partial_fractions
    else:
        model, fractions = loop, None
    exact = affordable(model)
    if exact and fractions is None:
        return exact_margins(rational(model))
    features = _features(model, fractions)
    if features.doubtful and not exact and model.n_states:
        # Large terms of two poles close to each other cancel in partial fractions, and not in the state space.
        features = locus_features(model, dim=_DIM_OF_LARGE)
    if _small_gain(model, fractions, features):
        return _margins(model.D, True, features)
    largest = largest_real_part(model)
    why, stable, interval = "", False, None
    if largest is not None:
        if largest[0] <= 0.0 <= largest[1] and not exact:
            largest = enclosed_real_part(closed_matrix(model)) or largest
        stable = largest[1] < 0.0
        if largest[0] <= 0.0 <= largest[1]:
            interval = largest
            why = f"the largest real part of the closed loop lies between {largest[0]:.3g} and {largest[1]:.3g} rad/s"
    if features.doubtful and not why:
        why = "the locus touches the unit circle or the real axis, or passes -1, within round-off"
    if not why:
        return _margins(model.D, stable, features)
    if exact:
        return exact_margins(rational(model))
    why += f", and {model.n_states} states with such entries are too many for exact arithmetic"
    return _margins(model.D, None if interval else stable, features, why, interval)


def closed_matrix(model: StateSpaceModel) -> Extended:
    """A - B C / (1 + D) of the closed loop in extended precision, shape (n, n)."""
    A, B, C = (np.asarray(matrix, dtype=np.longdouble) for matrix in (model.A, model.B, model.C))
    closed: Extended = A - B[:, None] * (C / (np.longdouble(1.0) + np.longdouble(model.D)))
    return closed


def _small_gain(model: StateSpaceModel, fractions: PartialFractions | None, features: LocusFeatures) -> bool:
    """Whether the loop is stable because L is stable by itself and |L| < 1 everywhere: no eigenvalues are needed.

    |L| is below 1 at infinity and nowhere crosses the unit circle, told for certain. The poles of L come with
    round-off, of eps times the fastest times their eigenvectors' condition (`_CONDITION` at most, else there are no
    fractions).
    """
    if fractions is None or features.doubtful or features.unit_circle.L.size or not abs(model.D) < 1.0:
        return False
    poles = fractions.all_poles
    reach = model.n_states * _EPS * _CONDITION * float(np.abs(poles).max(initial=0.0))
    return bool(poles.real.max(initial=-math.inf) < -reach)


def _features(model: StateSpaceModel, fractions: PartialFractions | None) -> LocusFeatures:
    if model.n_states == 0 or not model.B.any() or not model.C.any():
        return constant_features(model.D)
    if fractions is None:
        poles, residues = poles_and_residues(model.A, model.B, model.C)
        if residues is not None:
            sum_of_terms = PartialFractions(poles, residues, model.D)
            fractions = sum_of_terms if sum_of_terms.apart else None
    return locus_features(model, fractions)


def exact_margins(loop: Rational) -> Margins:
    """All margins of a loop num / den closed with unity negative feedback, by exact arithmetic."""
    answer = verified(loop)
    D = quotient(loop.num[-1], loop.den[-1]) if len(loop.num) == len(loop.den) else 0.0
    return _margins(D, answer.stable, answer.features)


def data_margins(data: FrequencyData) -> tuple[Margins, FrequencyAnswer]:
    """All margins of a loop known at frequencies only, and how well they are known.

    `stable` is None, and with it the margins NaN, where the data do not tell; the answer's `reason` says why.
    """
    answer = from_data(data)
    found = _margins(0.0, answer.stable, answer.features, answer.reason)
    return dataclasses.replace(found, interpolation_error=interpolation_errors(found, answer)), answer


def interpolation_errors(m: Margins, answer: FrequencyAnswer) -> dict[str, float | None]:
    """How far off each margin may be by interpolation, to first order; None where there is no crossing."""
    axis = [c for c in m.crossings if c.kind == REAL_AXIS]
    circle = [c for c in m.crossings if c.kind == UNIT_CIRCLE]
    gain = phase = delay = None
    if axis:
        i = min(range(len(axis)), key=lambda k: abs(axis[k].gain_db))
        gain = 20.0 / math.log(10.0) * float(answer.axis_error[i]) / abs(axis[i].value)
    if circle:
        i = min(range(len(circle)), key=lambda k: abs(circle[k].phase_deg))
        phase = math.degrees(float(answer.circle_error[i]))
        delay = max(float(e) / (_TWO_PI * c.frequency_hz) for c, e in zip(circle, answer.circle_error, strict=True))
    return {
        "gain_margin_db": gain,
        "phase_margin_deg": phase,
        "modulus_margin": answer.nearest_error,
        "disk_margin": answer.disk_error,
        "delay_margin_s": delay,
    }


def _margins(
    D: float,
    stable: bool | None,
    features: LocusFeatures,
    not_told: str = "",
    interval: tuple[float, float] | None = None,
) -> Margins:
    sign = math.nan if not_told else 1.0 if stable else -1.0
    none = math.nan if not_told else 0.0
    crossings = _crossings(features)
    axis = [c for c in crossings if c.kind == REAL_AXIS]
    circle = [c for c in crossings if c.kind == UNIT_CIRCLE]
    gain, gain_hz = min(((abs(c.gain_db), c.frequency_hz) for c in axis), default=(math.inf, None))
    phase, phase_hz = min(((abs(c.phase_deg), c.frequency_hz) for c in circle), default=(math.inf, None))
    told = stable and not not_told
    delay, delay_hz = _delay_margin(D, circle) if told else (none, None)
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
        disk_margin=features.alpha if told else none,
        disk_margin_hz=float(features.disk.omega[0]) / _TWO_PI,
        crossings=crossings,
        not_told=not_told,
        largest_real_part=interval,
    )


def largest_real_part(model: StateSpaceModel) -> tuple[float, float] | None:
    """An interval [rad/s] that holds the largest real part of the closed loop's eigenvalues.

    PilotgenError if the eigenvalues cannot be computed.

    None if the loop is ill-posed, 1 + L(infinity) = 0. The eigenvalues come with round-off: those computed belong to a
    matrix that differs by n eps times its norm, and move by that times the condition of the eigenvectors at most
    (Bauer and Fike), or, where the eigenvectors are nearly dependent, by Elsner's bound. Defective eigenvalues give a
    wide interval, and so do fast ones beside slow ones.
    """
    if model.D == -1.0:
        return None
    n = model.n_states
    if n == 0:
        return -math.inf, -math.inf
    # LAPACK directly: numpy's wrappers cost as much again
    A, _, _, _, _ = lapack.dgebal(model.A - model.B[:, None] * (model.C / (1.0 + model.D)), scale=1, permute=0)
    real, _, _, V, failed = lapack.dgeev(A, compute_vl=0)
    if failed:
        raise PilotgenError("the closed loop's eigenvalues cannot be computed: LAPACK's iteration does not converge")
    # In the basis of the vectors' real and imaginary parts A is normal (blocks [a b; -b a]), as the theorem wants.
    norm = math.sqrt(float((A * A).sum()))
    try:
        with np.errstate(over="ignore"):
            condition = math.sqrt(float((V * V).sum() * (np.linalg.inv(V) ** 2).sum()))
    except np.linalg.LinAlgError:
        condition = math.inf
    top, reach = float(real.max()), norm * min(n * _EPS * condition, 2.0 * (n * _EPS) ** (1.0 / n))
    return top - reach, top + reach


def _delay_margin(D: float, circle: list[Crossing]) -> tuple[float, float | None]:
    """Smallest delay [s] that turns a unit-circle crossing into -1, omega tau = angle(-L) modulo 2 pi; where [Hz]."""
    if abs(D) >= 1.0:
        return 0.0, math.inf  # the gain does not fall below 1: any delay destabilises at a high enough frequency
    delays = [
        ((math.radians(c.phase_deg) % _TWO_PI) / (_TWO_PI * c.frequency_hz), c.frequency_hz)
        for c in circle
        if c.frequency_hz > 0.0
    ]
    return min(delays, default=(math.inf, None))


def _crossings(features: LocusFeatures) -> tuple[Crossing, ...]:
    found = [
        Crossing(kind, omega / _TWO_PI, L)
        for kind, points in ((REAL_AXIS, features.real_axis), (UNIT_CIRCLE, features.unit_circle))
        for omega, L in zip(points.omega.tolist(), points.L.tolist(), strict=True)
    ]
    return tuple(sorted(found, key=lambda crossing: crossing.frequency_hz))


def _json(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
