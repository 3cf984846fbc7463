"""A rare share of a study's population: people drawn where the event is, to rare.json.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pilotgen.errors import StudyError
from pilotgen.files import to_json, write_text
from pilotgen.objectives import MODULUS_MARGIN, OBJECTIVES, Objective
from pilotgen.population.population import Population, population_of
from pilotgen.population.rare import FEWEST, RareShare, Stratum, rare_share
from pilotgen.population.region import one_in
from pilotgen.population.tally import percent, signed
from pilotgen.runs.batch import OnProgress, Progress
from pilotgen.runs.options import RunOptions
from pilotgen.runs.population_study import CHUNK, KIND, PopulationRun
from pilotgen.runs.session import Say, open_batch, provenance, seeded
from pilotgen.study.study import Study

RESULT_NAME = "rare.json"
FILETYPE, VERSION = "pilotgen rare share", 1
UNSTABLE = "unstable"


def rare_study(
    study: Study,
    directory: Path,
    number: int,
    event: str,
    seed: int | None = None,
    options: RunOptions | None = None,
    on_progress: OnProgress | None = None,
    say: Say | None = None,
) -> PopulationRun:
    """Estimate which share of the study's population makes the loop unstable or misses one limit; leaves rare.json.

    Parameters
    ----------
    study, directory, options, on_progress, say
        As of `search_study`.
    number : int
        How many people are evaluated, at most.
    event : str
        `unstable`, or the margin that is below its limit.
    seed : int, optional
        Of the drawing; the study's `search.seed` by default.

    Raises
    ------
    StudyError
        There is no population that people could be drawn from, no limit, or too few people are asked for.
    FileError, TooManyFailures
        As `search_study`.
    """
    options = options or RunOptions()
    study = seeded(study, seed)
    population = population_of(study)
    strata = _strata(population, study)
    limit = 0.0 if event == UNSTABLE else study.limits[event]
    if limit is None:
        raise StudyError(f"{study.path}: limits.{event} is null: give the study a limit that margins are held against")
    if number < FEWEST * len(strata):
        raise StudyError(f"-n {number} is too few for --rare; {FEWEST * len(strata)} people are wanted at least")
    next(population.people(study.search.seed))  # who is not there is missed before the workers start
    progress = Progress(number)
    with open_batch(study, directory, KIND, options, min(number, CHUNK), on_progress, progress, say) as batch:

        def evaluate(people: list[dict[str, Any]]) -> np.ndarray:
            away: list[float] = []
            for first in range(0, len(people), CHUNK):
                away += [_away(result, event, limit) for result in batch.evaluate(people[first : first + CHUNK])]
                batch.report(milestone=True)
            return np.array(away, dtype=float)

        found = rare_share(strata, evaluate, number, study.search.seed)
        content = {
            "filetype": FILETYPE,
            "version": VERSION,
            "name": population.name,
            "who": population.limits_text(),
            "event": event,
            "limit": None if event == UNSTABLE else limit,
            "asked": number,
            **_as_dict(found, event, limit),
            **provenance(study, KIND, batch, study.search.seed, "number of people", options.mbdae),
        }
    write_text(directory / RESULT_NAME, to_json(content))
    return PopulationRun(content, progress)


def _strata(population: Population, study: Study) -> list[Stratum]:
    if population.listed:
        raise StudyError(
            f"{study.path}: people of a file are counted, not drawn; leave --rare out, or give mean and covariance"
        )
    return [Stratum(share, joint, (joint.range, population.within)) for share, joint in population.joints]


def _margin_of(event: str) -> Objective:
    """The margin that tells how far a person is from an event: of instability the signed modulus margin."""
    return MODULUS_MARGIN if event == UNSTABLE else OBJECTIVES[event]


def _away(result: Mapping[str, Any], event: str, limit: float) -> float:
    """How far a person is from the event: below zero he has it, NaN if he could not be evaluated."""
    if result["status"] != "ok":
        return np.nan
    row = _margin_of(event)
    return min(row.capped(signed(row, result)), 1e6) - limit


def _as_dict(found: RareShare, event: str, limit: float) -> dict[str, Any]:
    low, high = found.interval
    key = _margin_of(event).key
    return {
        "evaluated": found.evaluated,
        "share": found.share,
        "low": low,
        "high": high,
        "people_with_it": found.hits,
        "smallest": found.closest + limit if np.isfinite(found.closest) else None,
        "equal_people": found.equal_people,
        "failed": found.failed,
        "failed_standard_error": found.failed_error,
        "levels": [{**level, "margin": level.pop("distance") + limit} for level in map(dict, found.levels)],
        "nearest": [
            {
                "values": one["values"],
                "mahalanobis_distance": one["mahalanobis_distance"],
                key: one["distance"] + limit,
            }
            for one in found.nearest
        ],
    }


def sentences(content: Mapping[str, Any]) -> list[str]:
    """What rare.json says, as an engineer would repeat it."""
    who, event = content["name"], content["event"]
    what = (
        "make it unstable"
        if event == UNSTABLE
        else f"fly this machine with a {OBJECTIVES[event].label} below {OBJECTIVES[event].text(content['limit'])}"
    )
    low, high = percent(content["low"]), percent(content["high"])
    if not content["people_with_it"]:
        row = _margin_of(event)
        told = [
            f"Nobody was found among {who} who would {what}: less than {high} % of them, with 95 % certainty.",
            f"The smallest {row.label} of {content['evaluated']} people, drawn where it is small, is "
            f"{row.text(content['smallest'])}.",
        ]
    else:
        told = [f"{percent(content['share'])} % of {who} ({low}-{high} %), {one_in(content['share'])}, {what}."]
        told.append(
            f"{content['people_with_it']} of {content['evaluated']} people evaluated, drawn where they are; counted "
            f"one by one it would have taken {content['equal_people']:,.0f} to know it as well."
        )
    if content["failed"] > 0.0:
        told.append(
            f"{percent(content['failed'])} % of {who} could not be evaluated and are left out of the share; were all "
            f"of them so, it would be {percent(content['share'] * (1.0 - content['failed']) + content['failed'])} %."
        )
    return told
