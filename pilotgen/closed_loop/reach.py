"""Kicks that cannot be meant: a pull beyond the lever's stops, and a kick that throws the lever on one of them.

A loop that swings between the stops is worth a look, and a kick so large that nothing but the stop answers it is a
mistake of units, or of somebody who wants to know. What tells them apart is whether the lever meets the stop while the
kick still acts.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math

from pilotgen.closed_loop.deck import START_S, ClosedLoop, friction_of
from pilotgen.closed_loop.simulate import KICKS, disturbance, simulate
from pilotgen.context import EvaluationContext
from pilotgen.errors import PilotgenError

KICK_S = 0.5  # of a pulse that are looked at: in a longer one the rotorcraft answers, and that is no kick's fault
BISECTIONS = 10  # of the largest size, in the logarithm: to 1 %
SMALLEST = 1e-3  # share of a size below which none is sought
TOUCH_M = 1e-3  # beyond a stop, below which the lever is not thrown: one that rests there touches it all the time


def check_kick(loop: ClosedLoop, kind: str, size: float) -> None:
    """Refuse a pull that wants the lever beyond one of its stops; PilotgenError."""
    low, high = loop.travel_to_stops_m()
    if kind == "pull" and not low <= size <= high:
        raise PilotgenError(
            f"a pull of {size:g} m wants the lever beyond its stops, which are {1e3 * low:.0f} and {1e3 * high:.0f} mm "
            f"from its place; {low if size < low else high:.3f} m is the most (--size), or take another "
            "inceptor.position"
        )


def check_reach(context: EvaluationContext, loop: ClosedLoop, kind: str, size: float, pulse_s: float | None) -> None:
    """Refuse a kick that throws the lever on a stop while it still acts.

    Turbulence acts all the time and is not asked, nor is a pull, which has its own end. The motion is that of the deck
    with stops and the study's friction.

    Raises
    ------
    PilotgenError
        With the largest size that does not.
    EvaluationError
        The solver could not go on.
    """
    if kind in ("turbulence", "pull"):
        return
    pulse = pulse_s if pulse_s is not None else KICKS[kind][2]
    end = START_S + min(pulse, KICK_S)

    def thrown(size: float) -> bool:
        motion = simulate(context, loop, disturbance(kind, size, pulse), end, friction=friction_of(loop.study))
        low, high = motion.stops_m
        return bool(motion.travel.min() < low - TOUCH_M or motion.travel.max() > high + TOUCH_M)

    if not thrown(size):
        return
    low, high = SMALLEST * abs(size), abs(size)
    sign = math.copysign(1.0, size)
    unit = KICKS[kind][0]
    words = f"a kick of {size:g} {unit} ({kind}) throws the lever on a stop while it still acts"
    if thrown(sign * low):
        raise PilotgenError(
            f"{words}, and so does one of {sign * low:g} {unit}: this lever is at a stop or its loop grows at once; "
            "take another inceptor.position or a shorter --pulse, or --through-stops if that is meant"
        )
    for _ in range(BISECTIONS):
        middle = math.sqrt(low * high)
        low, high = (low, middle) if thrown(sign * middle) else (middle, high)
    digit = 10.0 ** (math.floor(math.log10(low)) - 1)
    most = sign * math.floor(low / digit) * digit  # two digits, and not more than was tried
    raise PilotgenError(f"{words}; up to {most:.2g} {unit} do not (--size), or give --through-stops if that is meant")
