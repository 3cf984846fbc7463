"""What cures bounce: every cure alone, the cheapest combination, worst pilots bred anew for it.

Leaves cures.json (docs/io_formats/cures.md) and cured.yaml, the study with the proposed cockpit.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pilotgen.closed_loop.poles import refuse_unstable_rotorcraft
from pilotgen.cures.catalogue import Cure, changes, cures_for, price, proposable
from pilotgen.cures.friction import SWING_MM
from pilotgen.cures.optimum import Optimum, cheapest
from pilotgen.errors import StudyError
from pilotgen.files import to_json, write_text
from pilotgen.objectives import OBJECTIVES
from pilotgen.population.shares import Share
from pilotgen.runs.batch import OnProgress, Progress
from pilotgen.runs.cures_evaluator import (
    BREED_POPULATION,
    FRICTION,
    Amounts,
    CureEvaluator,
    NamedPilot,
    critical_hz,
    gain_db,
    margins_of,
)
from pilotgen.runs.cures_in_time import simulated, smallest_swings
from pilotgen.runs.cures_maps import cure_maps, map_pairs, pair_that_buys_most
from pilotgen.runs.options import RunOptions
from pilotgen.runs.session import Say, open_batch, provenance
from pilotgen.study.schema import SCHEMA
from pilotgen.study.study import Study
from pilotgen.summary import caveats

KIND = "cures"
RESULT_NAME, STUDY_NAME = "cures.json", "cured.yaml"
FILETYPE, VERSION = "pilotgen cures", 1
CURVE_POINTS = 9  # amounts of a cure alone
HALVINGS = 6  # between two of them, of what is enough: one part in 500 of what is practicable
ROUNDS = 6  # of proposal and worst pilots bred for it
TASKS = ("position", "force", "relax")
TELLING_DB = 0.05  # a cure that buys less is told as buying nothing
NO_CURE = (
    "no pilot of it has a margin and no cure gives him one: what weakens his hold on the lever cures bounce and "
    "nothing of that. Give the rotorcraft with what stabilises it, or a model of its heave alone"
)


@dataclass(frozen=True)
class CuresRun:
    """Cures at their end: what cures.json holds, and what was done."""

    content: dict[str, Any]
    progress: Progress


def cures_study(
    study: Study,
    directory: Path,
    only: tuple[str, ...] = (),
    without: tuple[str, ...] = (),
    people: int = 0,
    simulate: bool = True,
    options: RunOptions | None = None,
    on_progress: OnProgress | None = None,
    say: Say | None = None,
    maps: Sequence[Sequence[str]] = (),
    swing_mm: float | None = None,
) -> CuresRun:
    """Look for what brings the worst pilots of a study to its limits; leaves cures.json and cured.yaml.

    Parameters
    ----------
    study, directory, options, on_progress, say
        As of `search_study`.
    only, without : tuple of str
        Keys of cures: these alone, or all but these.
    people : int
        Of the study's population, before and after; 0 for none.
    simulate : bool
        Kick the last worst pilot in time, with and without the cure.
    maps : sequence of pairs of str
        Keys of cures over which maps are made; without any, the two that buy most.
    swing_mm : float, optional
        Amplitude of the grip for which friction is told [mm]; 10 if not given.

    Raises
    ------
    StudyError
        A cure that is none or means nothing here, a study without population, or a rotorcraft that is unstable by
        itself.
    PilotgenError
        The nominal pilot cannot be evaluated, or nobody of the search box can.
    FileError, TooManyFailures
        As `search_study`.
    """
    options = options or RunOptions()
    cures = cures_for(study, only, without)
    pairs = map_pairs(study, maps)
    swing_mm = _swing_mm(study, swing_mm, any(cure.key == FRICTION for cure in itertools.chain(cures, *pairs)))
    refuse_unstable_rotorcraft(study, NO_CURE)
    drawn_people = _people(study, people)
    progress = Progress()
    with open_batch(study, directory, KIND, options, BREED_POPULATION, on_progress, progress, say) as batch:
        evaluator = CureEvaluator(study, batch, 1e-3 * swing_mm)
        nominal = evaluator.pilot("nominal", {})
        worst = evaluator.worst_of({}, "worst")
        evaluator.critical_hz = critical_hz(worst.before)
        batch.report(milestone=True)
        alone = [_alone(evaluator, cure, (worst, nominal)) for cure in cures]
        alone.sort(key=lambda found: (found["by_name"], -found["best"]["worst"]["bought"]))
        batch.report(milestone=True)
        drawn = cure_maps(evaluator, pairs or pair_that_buys_most(cures, alone), (worst, nominal))
        proposal, optimum = _proposal(evaluator, proposable(cures, only), worst, nominal)
        content: dict[str, Any] = {
            "filetype": FILETYPE,
            "version": VERSION,
            "sentence": "",
            "limits": evaluator.limits,
            "critical_hz": evaluator.critical_hz,
            "swing_mm": swing_mm,
            "pilots": {p.name: evaluator.told(p.values, p.before) for p in (worst, nominal)},
            "cures": alone,
            "tasks": _tasks(evaluator, (worst, nominal)),
            "maps": drawn,
            "proposal": proposal,
            "population": _before_and_after(evaluator, drawn_people, proposal["amounts"]),
            "caveats": caveats(study, worst.before),
            **provenance(study, KIND, batch, study.search.seed, "all points", options.mbdae),
        }
    for row in alone:
        if row["by_name"]:
            row["smallest_swing_that_grows_mm"] = {
                p.name: smallest_swings(study, p.values, options)
                for p in (worst, nominal)
                if p.before["loop"]["stable"] is False
            }
    rubbed = FRICTION in proposal["amounts"]
    content["simulation"] = simulated(study, proposal, rubbed, options) if simulate else None
    content["sentence"] = sentence(content, optimum)
    write_text(directory / RESULT_NAME, to_json(content))
    write_text(directory / STUDY_NAME, _cured(study, proposal["changes"]).text)
    return CuresRun(content, progress)


def _swing_mm(study: Study, given: float | None, friction: bool) -> float:
    """Amplitude for which friction is told; StudyError for one that nothing is told of, or that no lever has."""
    if given is None:
        return SWING_MM
    if not friction:
        raise StudyError("--swing is for friction, which is not among these cures; leave it out")
    ends = [float(study.cockpit["collective"][f"{end}_angle_deg"]) for end in ("lowest", "highest")]
    most = 1e3 * 0.5 * math.radians(ends[1] - ends[0]) * study.inceptor.lever_length_m
    if given > most:
        raise StudyError(f"--swing {given:g}: the lever's stops allow swings of {most:.0f} mm at most; give less")
    return given


# ---- each cure alone


def _alone(evaluator: CureEvaluator, cure: Cure, pilots: Sequence[NamedPilot]) -> dict[str, Any]:
    """Margins of the pilots over the amounts of one cure, and what going all the way buys."""
    amounts = np.linspace(cure.low, cure.high, CURVE_POINTS)
    if cure.low < 0.0 < cure.high:
        amounts = np.unique(np.append(amounts, 0.0))
    amounts_each = [{cure.key: float(x)} for x in amounts]
    found: dict[str, Any] = {
        "key": cure.key,
        "label": cure.label,
        "unit": cure.unit,
        "practicable": [cure.low, cure.high],
        "cost": cure.cost,
        "remedy": cure.remedy,
        "by_name": cure.by_name,
        "source": cure.source,
        "amounts": amounts.tolist(),
        "margins": {},
        "best": {},
    }
    for pilot in pilots:
        results = evaluator.with_cures([pilot.values] * len(amounts_each), amounts_each)
        found["margins"][pilot.name] = margins_of(results)
        score = np.array([-evaluator.violation(r) if evaluator.limits else gain_db(r) for r in results])
        k = int(np.argmax(score))
        gains = np.array([gain_db(result) for result in results]) - gain_db(pilot.before)
        enough = _enough(evaluator, cure, pilot, amounts, score) if evaluator.limits else None
        found["best"][pilot.name] = {
            "amount": float(amounts[k]),
            "bought": float(gains[k]) if math.isfinite(gains[k]) else 0.0,
            "enough": enough,
            "sentence": _what_it_buys(evaluator, cure, float(amounts[k]), gains, k, enough, pilot.name),
        }
    return found


def _enough(
    evaluator: CureEvaluator, cure: Cure, pilot: NamedPilot, amounts: np.ndarray, score: np.ndarray
) -> float | None:
    """The amount nearest to 0 with which a pilot keeps the limits (score 0 or more), by bisection; None for none."""
    start = int(np.argmin(np.abs(amounts)))
    if score[start] >= 0.0:
        return 0.0
    ways = (range(start + 1, len(amounts)), range(start - 1, -1, -1))
    first = [next((k for k in way if score[k] >= 0.0), None) for way in ways]
    known = [(k, step) for k, step in zip(first, (1, -1), strict=True) if k is not None]
    if not known:
        return None
    k, step = min(known, key=lambda row: abs(amounts[row[0]]))
    too_little, enough = float(amounts[k - step]), float(amounts[k])
    for _ in range(HALVINGS):
        middle = 0.5 * (too_little + enough)
        (result,) = evaluator.with_cures([pilot.values], [{cure.key: middle}])
        too_little, enough = (too_little, middle) if evaluator.violation(result) <= 0.0 else (middle, enough)
    return enough


def _what_it_buys(
    evaluator: CureEvaluator, cure: Cure, amount: float, gains: np.ndarray, best: int, enough: float | None, who: str
) -> str:
    """`viscous damper on the lever, 20 N s/m at the grip: buys 4.3 dB for the worst pilot; 10 are enough; ...`."""
    swings = f" in swings of {1e3 * evaluator.swing_m:g} mm (larger ones feel less)" if cure.by_name else ""
    bought = float(gains[best])
    if amount == 0.0 or bought < TELLING_DB:
        lost = -float(np.min(gains[np.isfinite(gains)], initial=0.0))
        does = f"takes up to {lost:.1f} dB from" if lost >= TELLING_DB else "buys nothing for"
        return f"{cure.label}: {does} the {who} pilot within {cure.low:g} to {cure.high:g} {cure.unit}{swings}"
    told = f"{cure.told(amount)}: buys {bought:.1f} dB for the {who} pilot{swings}"
    if enough is not None and 0.0 < abs(enough) < 0.97 * abs(amount):
        told += f"; {abs(enough):.3g} {'is' if abs(enough) < 1.0 else 'are'} enough"
    costs = price(evaluator.study, cure, amount) if cure.remedy else ""
    return told + (f"; costs {costs}" if costs else "")


def _tasks(evaluator: CureEvaluator, pilots: Sequence[NamedPilot]) -> dict[str, Any]:
    """What the pilot's task makes of the margins: no cure, but advice to pilots."""
    if evaluator.study.pilot.model != "multibody":
        return {}
    return {
        pilot.name: {
            task: margins_of(evaluator.batch.evaluate([dict[str, Any](pilot.values, **{"pilot.task": task})]))
            for task in TASKS
        }
        for pilot in pilots
    }


# ---- the cheapest combination


def _proposal(
    evaluator: CureEvaluator, remedies: Sequence[Cure], worst: NamedPilot, nominal: NamedPilot
) -> tuple[dict[str, Any], Optimum]:
    """The cheapest combination for the worst pilots; those bred for the cured cockpit join them until none misses."""
    pilots = [worst, nominal]
    rounds: list[dict[str, Any]] = []
    while True:

        def violation(amounts: np.ndarray) -> np.ndarray:
            amounts_each = [_named(remedies, row) for row in amounts for _ in pilots]
            flat = evaluator.with_cures([pilot.values for _ in amounts for pilot in pilots], amounts_each)
            evaluator.batch.report(milestone=False)
            missed = np.array([evaluator.violation(result) for result in flat]).reshape(len(amounts), len(pilots))
            return np.asarray(missed.max(axis=1), dtype=float)

        if evaluator.limits and max(evaluator.violation(p.before) for p in pilots) > 0.0:
            optimum = cheapest(remedies, violation, evaluator.study.search.seed)
        else:
            optimum = Optimum(np.zeros(len(remedies)), 0.0, max(evaluator.violation(p.before) for p in pilots))
        amounts = _named(remedies, optimum.amounts)
        bred = evaluator.worst_of(amounts, f"worst of round {len(rounds) + 1}")
        missed = evaluator.violation(bred.before)
        rounds.append(
            {
                "amounts": amounts,
                "cost": optimum.cost,
                "worst": evaluator.told(bred.values, bred.before),
                "missed_by": missed if math.isfinite(missed) else None,
            }
        )
        evaluator.batch.report(milestone=True)
        if missed <= 0.0 or not optimum.reached or len(rounds) == ROUNDS:
            break
        (uncured,) = evaluator.batch.evaluate([bred.values])
        pilots.append(NamedPilot(bred.name, bred.values, uncured))
    after = evaluator.with_cures([pilot.values for pilot in pilots], [amounts] * len(pilots))
    proposal = {
        "reached": optimum.reached and missed <= 0.0,
        "amounts": amounts,
        "cost": optimum.cost,
        "changes": changes(evaluator.study, amounts, evaluator.critical_hz),
        "cures": [
            {
                "key": cure.key,
                "text": cure.told(amounts[cure.key]),
                "price": price(evaluator.study, cure, amounts[cure.key]),
            }
            for cure in remedies
            if amounts.get(cure.key)
        ],
        "pilots": [
            {"name": p.name, "before": evaluator.told(p.values, p.before), "after": evaluator.told(p.values, now)}
            for p, now in zip(pilots, after, strict=True)
        ],
        "rounds": rounds,
    }
    return proposal, optimum


def _named(cures: Sequence[Cure], amounts: np.ndarray) -> dict[str, float]:
    return {cure.key: float(x) for cure, x in zip(cures, amounts, strict=True) if x != 0.0}


# ---- people


def _people(study: Study, number: int) -> list[dict[str, Any]]:
    if number == 0:
        return []
    from pilotgen.population.population import population_of

    return list(itertools.islice(population_of(study).people(study.search.seed), number))


def _before_and_after(evaluator: CureEvaluator, people: Sequence[Mapping[str, Any]], amounts: Amounts) -> Any:
    """Shares of people who miss a limit, in the cockpit as it is and in the proposed one."""
    if not people:
        return None
    found: dict[str, Any] = {"people": len(people)}
    given: Mapping[str, Amounts] = {"before": {}, "after": amounts}
    for when, one in given.items():
        results = [r for r in evaluator.with_cures(people, [one] * len(people)) if r["status"] == "ok"]
        missed = Share(sum(evaluator.violation(result) > 0.0 for result in results), len(results))
        found[when] = {"evaluated": len(results), "missing_a_limit": missed.as_dict()}
    return found


# ---- what is said


def sentence(content: Mapping[str, Any], optimum: Optimum) -> str:
    """The plain first sentence."""
    proposal = content["proposal"]
    limits = " and ".join(f"{OBJECTIVES[key].text(limit)}" for key, limit in content["limits"].items())
    if not content["limits"]:
        return "The study has no limits, so there is nothing to bring pilots to."
    if not proposal["amounts"] and proposal["reached"]:
        return f"Nothing needs to be cured: the worst pilot keeps {limits}."
    told = "; ".join(f"{row['text']} ({row['price']})" if row["price"] else row["text"] for row in proposal["cures"])
    if FRICTION in proposal["amounts"]:
        told += f". With friction that holds for swings of {content['swing_mm']:g} mm; larger ones feel less"
    if proposal["reached"]:
        return f"The cheapest cure with which nobody worse than {limits} is found in the search box: {told}."
    if optimum.reached:
        return f"Within {ROUNDS} rounds worse pilots were found for every cure; the last, short of {limits}: {told}."
    return f"No combination within what is practicable brings the worst pilot to {limits}; what comes nearest: {told}."


def _cured(study: Study, change: Mapping[str, Any]) -> Study:
    """The study with the proposed cockpit, as a file of its own."""
    named = {path: value for path, value in change.items() if path in SCHEMA or "[" in path}
    return study.with_values(named)[0].with_own_text() if named else study.with_own_text()
