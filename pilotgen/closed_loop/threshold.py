"""The smallest kick that goes on, and the swing that neither grows nor dies, by time integration of the closed deck.

Kicks are halved in between until the last that dies and the first that goes on run together for long: what they do
then is the unstable limit cycle, seen without any balance of harmonics.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pilotgen.closed_loop.deck import ClosedLoop
from pilotgen.closed_loop.simulate import LoopMotion, disturbance, free_from, grows, simulate
from pilotgen.context import EvaluationContext
from pilotgen.decks.vehicle import Friction
from pilotgen.solver.descriptor import Floats

TOGETHER = 0.02  # swings of two motions that differ by less run together
SIZES_N = (1.0, 256.0)  # kicks at the lever that are tried


@dataclass(frozen=True)
class Threshold:
    """What the bisection found.

    Attributes
    ----------
    dies_n, goes_on_n : float
        Kicks at the lever on either side [N].
    swing_m, frequency_hz : float
        Of the motion in between, half peak-to-peak [m], [Hz]; NaN if the two never ran together.
    """

    dies_n: float
    goes_on_n: float
    swing_m: float
    frequency_hz: float

    @property
    def size_n(self) -> float:
        """Smallest kick that goes on [N]."""
        return math.sqrt(self.dies_n * self.goes_on_n)


def swings(motion: LoopMotion, from_s: float) -> tuple[Floats, Floats, Floats]:
    """Half peak-to-peak travel between successive extremes: times [s], swings [m], half periods [s]; (k,) each."""
    x, t = motion.travel, motion.time
    slope = np.diff(x)
    turns = np.flatnonzero(slope[1:] * slope[:-1] < 0.0) + 1
    turns = turns[t[turns] > from_s]
    heights, at = x[turns], t[turns]
    return 0.5 * (at[1:] + at[:-1]), 0.5 * np.abs(np.diff(heights)), np.diff(at)


def threshold(
    context: EvaluationContext,
    loop: ClosedLoop,
    friction: Friction | None,
    *,
    duration_s: float = 6.0,
    steps: int = 12,
    between_n: tuple[float, float] = SIZES_N,
    tell: Callable[[int, int], None] | None = None,
) -> Threshold | None:
    """Bisect the size of a pulse at the lever; None if all die or the smallest goes on.

    Parameters
    ----------
    context, loop, friction
        As for `simulate`; stops and clipping included.
    duration_s : float
        Length of each motion [s].
    steps : int
        Bisections, in the logarithm of the size.
    between_n : tuple of float
        Smallest and largest size [N]; sizes double from the smallest until a motion goes on.
    tell : callable, optional
        Told how many motions are done, of how many.
    """

    def motion(size: float, count: int) -> LoopMotion:
        found = simulate(context, loop, disturbance("lever", size), duration_s, friction=friction)
        if tell is not None:
            tell(count, steps + math.ceil(math.log2(between_n[1] / between_n[0])) + 1)
        return found

    low, most = between_n
    dead = motion(low, 1)
    if grows(dead):
        return None
    high, alive, done = low, dead, 1
    while not grows(alive):  # very large kicks may die again, on a stop
        if high == most:
            return None
        low, dead, high = high, alive, min(2.0 * high, most)
        alive, done = motion(high, done + 1), done + 1
    for _ in range(steps):
        size = math.sqrt(low * high)
        middle, done = motion(size, done + 1), done + 1
        if grows(middle):
            high, alive = size, middle
        else:
            low, dead = size, middle
    return Threshold(low, high, *_in_between(dead, alive))


def _in_between(dead: LoopMotion, alive: LoopMotion) -> tuple[float, float]:
    """Swing [m] and frequency [Hz] where two motions part."""
    start = free_from("lever", None)
    (_, a, half), (_, b, _) = swings(dead, start), swings(alive, start)
    n = min(len(a), len(b))
    if n < 4:
        return math.nan, math.nan
    apart = np.flatnonzero(np.abs(a[:n] - b[:n]) > TOGETHER * b[:n])
    last = int(apart[0]) if len(apart) else n
    if last < 4:
        return math.nan, math.nan
    rows = slice(max(0, last - 4), last)  # two periods
    return float(np.mean(0.5 * (a[rows] + b[rows]))), float(1.0 / (2.0 * np.mean(half[rows])))
