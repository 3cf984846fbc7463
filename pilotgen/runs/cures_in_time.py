"""Cures tried in the nonlinear deck: the worst pilot kicked before and after, friction by swings and kicks of any size.

The deck moves here (stops, clipped activations, friction), which shares with the margins the deck's elements and
nothing of linearisation, modes or Nyquist curve. Growth and frequency are fitted to the motion and held against the
poles of the closed deck.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from pilotgen.cures.friction import LEVELS_N, as_built, more_friction
from pilotgen.errors import PilotgenError
from pilotgen.objectives import GAIN_MARGIN
from pilotgen.runs.options import RunOptions
from pilotgen.study.study import Study

KICK_N, KICK_DURATION_S = 10.0, 4.0  # on the grip, in the verification
SHOWN = ("largest_grip_travel_mm", "swing_at_the_end_mm", "hits_stop", "fit")
BISECTIONS = 6  # of the smallest kick that goes on: to 1 %


def simulated(study: Study, proposal: Mapping[str, Any], friction: bool, options: RunOptions) -> dict[str, Any]:
    """The worst pilot of a proposal kicked in time, in the cockpit as it is and in the cured one; or why he is not.

    With friction in the proposal the kicks that die and those that go on as well, for what friction does depends on
    how large they are.
    """
    from pilotgen.closed_loop.deck import check_study, close_in_deck, friction_of
    from pilotgen.closed_loop.reach import check_kick
    from pilotgen.closed_loop.simulate import kicked
    from pilotgen.closed_loop.threshold import SIZES_N, threshold
    from pilotgen.context import EvaluationContext

    worst = min(proposal["pilots"], key=lambda row: _gain(row["before"]))
    found: dict[str, Any] = {"pilot": worst["name"], "kick_n": KICK_N, "duration_s": KICK_DURATION_S}
    try:
        check_study(study)
        changes: dict[str, Mapping[str, Any]] = {"before": {}, "after": proposal["changes"]}
        for when, change in changes.items():
            values = study.values({**worst["before"]["values"], **change})  # with what the search left as it is
            with EvaluationContext(study, mbdae=options.mbdae) as context:
                loop = close_in_deck(context, values)
                check_kick(loop, "lever", KICK_N)
                _, content = kicked(context, loop, "lever", KICK_N, KICK_DURATION_S)
                if friction and when == "after":
                    between = threshold(context, loop, friction_of(loop.study), steps=BISECTIONS)
                    found["kicks_with_friction"] = {
                        "tried_n": list(SIZES_N),
                        "all_die": between is None and not content["goes_on"],
                        "largest_that_dies_n": None if between is None else between.dies_n,
                        "smallest_that_goes_on_n": None if between is None else between.goes_on_n,
                    }
            found[when] = {key: content[key] for key in SHOWN}
    except PilotgenError as error:
        return {**found, "reason": str(error)}
    return found


def kicks_told(found: Mapping[str, Any]) -> str | None:
    """Which kicks die with the friction of a proposal, as a sentence; None where there is none in it.

    `found` is what `simulated` returned.
    """
    between = found.get("kicks_with_friction")
    if between is None:
        return None
    dies, goes = between["largest_that_dies_n"], between["smallest_that_goes_on_n"]
    if dies is not None:
        return f"with the friction kicks at the lever die up to {dies:.3g} N and go on from {goes:.3g} N"
    low, high = between["tried_n"]
    end = "dies" if between["all_die"] else "goes on"
    return f"with the friction every kick at the lever that was tried, {low:g} to {high:g} N, {end}"


def smallest_swings(study: Study, values: Mapping[str, Any], options: RunOptions) -> dict[str, Any]:
    """Smallest swing of the grip that grows [mm] by so much more friction [N], of a pilot whose loop is unstable.

    By the harmonic balance over the nonlinear deck. 0: every small swing grows; None for a swing: every one within the
    stops dies. Only a `reason` where no deck holds this loop, or no swing was balanced.
    """
    from pilotgen.closed_loop.deck import check_study, close_in_deck, friction_of
    from pilotgen.closed_loop.limit_cycles import onset_map
    from pilotgen.context import EvaluationContext

    try:
        check_study(study)
        with EvaluationContext(study, mbdae=options.mbdae) as context:
            loop = close_in_deck(context, study.values(values))
            totals = [float(as_built(study, x)["inceptor.friction.breakout_n"]) for x in LEVELS_N]
            kind = friction_of(study) or more_friction(study, max(totals) or 1.0)
            gearing = loop.study.inceptor.gearing_rad_per_m
            (row,) = onset_map(context, loop, kind, totals, [gearing]).swing_mm.tolist()
    except PilotgenError as error:
        return {"reason": str(error)}
    return {"more_n": list(LEVELS_N), "swing_mm": [value if math.isfinite(value) else None for value in row]}


def _gain(told: Mapping[str, Any]) -> float:
    gain = told.get("gain_margin_db")
    return GAIN_MARGIN.cap if gain is None else float(gain)
