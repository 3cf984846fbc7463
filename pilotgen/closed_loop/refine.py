"""Limit cycles with all harmonics, from the swings of a sweep with few.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from pilotgen.closed_loop.harmonic import DECAYED_RAD_S, HarmonicBalance
from pilotgen.closed_loop.swing import LimitCycle, Swing
from pilotgen.errors import EvaluationError

SAME, LARGER = 0.01, 1.01  # relative difference of cycles that are one; of swings that tell what a cycle does
BESIDE = 1.15  # how far beyond the two swings around it in a sweep a cycle may be
JUMP = 0.05  # relative change of frequency from one of these to the next that is no step but another branch
STEP, MOST_STEPS = 1.02, 24  # from one swing to the next where all harmonics are followed


def limit_cycles(balance: HarmonicBalance, swings: Sequence[Swing], most_m: float) -> list[LimitCycle]:
    """Cycles between swings of a sweep, by rising amplitude.

    Those that do not converge from the sweep are sought by following swings with all harmonics from those that do; what
    is not found so either is told.

    Parameters
    ----------
    balance : HarmonicBalance
        With all harmonics.
    swings : sequence of Swing
        By rising amplitude.
    most_m : float
        Amplitude beyond which no swing is followed [m].
    """
    pairs = [
        (one, other)
        for one, other in itertools.pairwise(swings)
        if one.growth_rad_s * other.growth_rad_s < 0.0 or other.growth_rad_s == 0.0
    ]
    found: list[LimitCycle] = []
    for low, high in pairs:
        found.append(_limit_cycle(balance, low, high, found))
    out: list[LimitCycle] = []
    for troubled, group in itertools.groupby(range(len(found)), key=lambda i: bool(found[i].trouble)):
        places = list(group)
        if troubled:
            before = found[places[0] - 1] if places[0] else None
            after = found[places[-1] + 1] if places[-1] + 1 < len(found) else None
            least_m = pairs[places[0]][0].amplitude_m
            kinds = [found[i].stable for i in places]
            try:
                out += _followed(balance, before, after, (least_m, most_m), kinds)
                continue
            except EvaluationError:
                for i in places:
                    found[i] = _limit_cycle(balance, *pairs[i], found[:i], found[i])
        out += [found[i] for i in places]
    return out


def _limit_cycle(
    balance: HarmonicBalance,
    low: Swing,
    high: Swing,
    others: Sequence[LimitCycle],
    tried: LimitCycle | None = None,
) -> LimitCycle:
    """The cycle between two swings of a sweep, of which one grows and one dies; none of the others.

    Where it was `tried` before and did not converge, other ways are gone; what is reached when none goes is told.
    """
    stable = low.growth_rad_s > high.growth_rad_s
    share = low.growth_rad_s / (low.growth_rad_s - high.growth_rad_s)
    start = low if share < 0.5 else high
    if low.harmonics == high.harmonics:
        start = _between(balance, low, high)
    within = low.swing_m / BESIDE, high.swing_m * BESIDE

    def of(harmonics: int, start: Swing) -> Swing:
        found = (balance if harmonics == balance.K else balance.with_harmonics(harmonics)).solve(start, None)
        if not within[0] < found.swing_m < within[1]:
            size = 1e3 * found.swing_m
            raise EvaluationError("harmonic balance", f"another cycle was found, of {size:.3g} mm")
        if any(abs(found.swing_m / other.swing.swing_m - 1.0) < SAME for other in others):
            raise EvaluationError("harmonic balance", "the cycle before this one was found again")
        checked = not stable or not balance.touches_stop(found)  # many stable ones hang on the stops, as they should
        if harmonics == balance.K and checked and _attracts(balance, found) is not stable:
            size = 1e3 * found.swing_m
            raise EvaluationError("harmonic balance", f"a cycle of the other kind was found, of {size:.3g} mm")
        return found

    best, trouble, told = start, "", "not refined, this is the nearest swing of the sweep"
    K = balance.K
    ways: list[tuple[int, ...]] = [(1, K), (K,)] if balance.touches_stop(start) else [(K,), (1, K)]
    if tried is not None:
        best, told, ways = tried.swing, tried.trouble.partition(": ")[0], [(3, K), (5, K), (K + 4,)]
    for way in ways:
        swing = start if way == (K,) else best
        try:
            for harmonics in way:
                swing = of(harmonics, swing)
                if best is start and harmonics == 1:
                    best, told = swing, "refined with one harmonic only"
            return LimitCycle(swing, stable)
        except EvaluationError as error:
            trouble = error.reason
    return LimitCycle(best, stable, f"{told}: {trouble}")


def _attracts(balance: HarmonicBalance, cycle: Swing) -> bool:
    """Whether a swing a little larger than a cycle dies. EvaluationError if it is not found, or is of another kind."""
    larger = balance.solve(cycle, LARGER * balance.grip_m(cycle))
    if abs(math.log(larger.omega_rad_s / cycle.omega_rad_s)) > JUMP:
        raise EvaluationError("harmonic balance", "a little larger swings are of another kind")
    return larger.growth_rad_s < 0.0


def _between(balance: HarmonicBalance, low: Swing, high: Swing) -> Swing:
    """Where growth would be zero on the line between two swings of as many harmonics."""
    share = low.growth_rad_s / (low.growth_rad_s - high.growth_rad_s)
    Y = np.asarray((1.0 - share) * low.unknowns + share * high.unknowns)
    pole = (1.0 - share) * low.pole + share * high.pole
    return balance.with_harmonics(low.harmonics).swing(Y, pole, 0)


def _followed(
    balance: HarmonicBalance,
    before: LimitCycle | None,
    after: LimitCycle | None,
    within_m: tuple[float, float],
    kinds: list[bool],
) -> list[LimitCycle]:
    """Cycles between two others, by swings with all harmonics from one to the other, or to an end of some amplitudes.

    Where swings cannot be followed so far, those on the way are told if they are of the `kinds` (stable or not) that
    the sweep says. EvaluationError where they are not, or neither cycle is there to start from.
    """
    origin = before or after
    if origin is None:
        raise EvaluationError("harmonic balance", "there is no cycle to start from")
    up = before is not None
    start = balance.grip_m(origin.swing)
    end = within_m[0] if not up else within_m[1] if after is None else balance.grip_m(after.swing) / LARGER
    if up is not (end > start):
        raise EvaluationError("harmonic balance", "the cycles do not follow each other by their amplitudes")
    steps = max(1, math.ceil(abs(math.log(end / start)) / math.log(STEP)))
    if steps > MOST_STEPS:
        raise EvaluationError("harmonic balance", "the next cycle is too far away")
    grid = np.geomspace(start * (LARGER if up else 1.0 / LARGER), end, steps + 1)
    passed, arrived = [origin.swing], True
    for amplitude in grid.tolist():
        try:
            balance.follow(passed, amplitude)
        except EvaluationError:
            arrived = False
            break
        if passed[-1].growth_rad_s < DECAYED_RAD_S:
            break
    if any(abs(math.log(other.omega_rad_s / one.omega_rad_s)) > JUMP for one, other in itertools.pairwise(passed)):
        raise EvaluationError("harmonic balance", "swings of another kind were found on the way")
    if len(passed) == 1:
        raise EvaluationError("harmonic balance", "no swing beside the cycle was found")
    rising = passed[1:] if up else passed[:0:-1]
    grows_above_before = before is None or (rising[0].growth_rad_s > 0.0) is not before.stable
    grows_below_after = after is None or not arrived or (rising[-1].growth_rad_s > 0.0) is after.stable
    if not (grows_above_before and grows_below_after):
        raise EvaluationError("harmonic balance", "swings on the way do not belong to these cycles")
    out = []
    for low, high in itertools.pairwise(rising):
        if low.growth_rad_s * high.growth_rad_s < 0.0:
            cycle = balance.solve(_between(balance, low, high), None)
            if not balance.grip_m(low) < balance.grip_m(cycle) < balance.grip_m(high):
                raise EvaluationError("harmonic balance", "a cycle on the way was not found")
            out.append(LimitCycle(cycle, low.growth_rad_s > high.growth_rad_s))
    if not arrived and [cycle.stable for cycle in out] != kinds:
        raise EvaluationError("harmonic balance", "swings were not followed to the end")
    return out
