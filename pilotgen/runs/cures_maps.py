"""Maps: margins of pilots over the amounts of two cures, point by point, and where the limits are kept.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pilotgen.cures.catalogue import Cure, catalogue, cures_for
from pilotgen.cures.optimum import cost_of
from pilotgen.errors import StudyError
from pilotgen.objectives import OBJECTIVES
from pilotgen.runs.cures_evaluator import CureEvaluator, NamedPilot, margins_of
from pilotgen.study.study import Study

MAP_POINTS = 20  # along each side

Pair = tuple[Cure, Cure]


def map_pairs(study: Study, names: Sequence[Sequence[str]]) -> list[Pair]:
    """Pairs of cures by their names, the first of each along the horizontal axis.

    Raises
    ------
    StudyError
        A name that is no cure or means nothing for this study, a pair of one cure, or a pair that stands there twice.
    """
    known = catalogue()
    pairs: list[Pair] = []
    for one, two in names:
        cures_for(study, only=(one, two))
        if one == two:
            raise StudyError(f"--map {one} {two}: a map is of two cures; name another one beside {one}")
        if any({one, two} == {cure.key for cure in pair} for pair in pairs):
            raise StudyError(f"--map {one} {two}: this pair stands there twice; keep one")
        pairs.append((known[one], known[two]))
    return pairs


def pair_that_buys_most(cures: Sequence[Cure], alone: Sequence[Mapping[str, Any]]) -> list[Pair]:
    """The two remedies that buy the worst pilot most, friction apart; none if there are not two."""
    known = {cure.key: cure for cure in cures if cure.remedy and not cure.by_name}
    ranked = [known[row["key"]] for row in alone if row["key"] in known]
    return [(ranked[0], ranked[1])] if len(ranked) > 1 else []


def cure_maps(evaluator: CureEvaluator, pairs: Sequence[Pair], pilots: Sequence[NamedPilot]) -> list[dict[str, Any]]:
    """One map for each pair and pilot, as cures.json has it."""
    found = []
    for one, two in pairs:
        x, y = (np.linspace(cure.low, cure.high, MAP_POINTS) for cure in (one, two))
        amounts_each = [{one.key: float(a), two.key: float(b)} for b, a in itertools.product(y, x)]
        for pilot in pilots:
            results = evaluator.with_cures([pilot.values] * len(amounts_each), amounts_each)
            evaluator.batch.report(milestone=True)
            missed = np.array([evaluator.violation(result) for result in results])
            cost = cost_of((one, two), np.array([list(amounts.values()) for amounts in amounts_each]))
            kept = int(np.count_nonzero(missed <= 0.0))
            k = int(np.argmin(np.where(missed <= 0.0, cost, np.inf) if kept else missed))
            found.append(
                {
                    "pilot": pilot.name,
                    **{
                        side: {"key": cure.key, "label": cure.label, "unit": cure.unit, "amounts": amounts.tolist()}
                        for side, cure, amounts in (("x", one, x), ("y", two, y))
                    },
                    "margins": {key: _rows(values) for key, values in margins_of(results).items()},
                    "keeps_limits": _rows((missed <= 0.0).tolist()),
                    "sentence": _sentence(evaluator, pilot, (one, two), amounts_each[k], kept, len(amounts_each)),
                }
            )
    return found


def _rows(values: Sequence[Any]) -> list[list[Any]]:
    return [list(values[k : k + MAP_POINTS]) for k in range(0, len(values), MAP_POINTS)]


def _sentence(
    evaluator: CureEvaluator, pilot: NamedPilot, pair: Pair, amounts: Mapping[str, float], kept: int, points: int
) -> str:
    limits = " and ".join(OBJECTIVES[key].text(limit) for key, limit in evaluator.limits.items())
    used = " and ".join(cure.told(amounts[cure.key]) for cure in pair if amounts[cure.key]) or "neither of the two"
    where = f"{pair[0].label} and {pair[1].label}, {pilot.name} pilot"
    if any(cure.by_name for cure in pair):
        where += f", swings of {1e3 * evaluator.swing_m:g} mm"
    if not limits:
        return f"{where}: the study has no limits to draw"
    if not kept:
        return f"{where}: no point of {points} keeps {limits}; nearest comes {used}"
    return f"{where}: {kept} of {points} points keep {limits}, the cheapest of them by {used}"
