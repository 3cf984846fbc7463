"""People of a study's population, evaluated one after the other: how many are at risk.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import csv
import itertools
import os
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from pilotgen.errors import FileError, StudyError
from pilotgen.files import to_json, write_text
from pilotgen.objectives import OBJECTIVES
from pilotgen.output import STUDY_NAME
from pilotgen.population.population import LeftOut, Person, population_of
from pilotgen.population.tally import Tally, sentences, signed
from pilotgen.runs.batch import OnProgress, Progress
from pilotgen.runs.options import RunOptions
from pilotgen.runs.plane import margin_planes
from pilotgen.runs.session import Say, open_batch, provenance, seeded
from pilotgen.study.study import Study

CHUNK = 500  # people in memory at a time, and between two looks at the intervals
KIND = "population"
RESULT_NAME, PEOPLE_NAME = "population.json", "people.csv"
FILES = (  # in its directory
    RESULT_NAME, "rare.json", PEOPLE_NAME, f"{PEOPLE_NAME}.part", "population-*.png", "journal.sqlite*", STUDY_NAME,
)  # fmt: skip
FILETYPE, VERSION = "pilotgen population", 1


@dataclass(frozen=True)
class PopulationRun:
    """A population's end: what population.json holds, and what was done."""

    content: dict[str, Any]
    progress: Progress


def population_study(
    study: Study,
    directory: Path,
    number: int,
    until_width: float | None = None,
    seed: int | None = None,
    options: RunOptions | None = None,
    on_progress: OnProgress | None = None,
    say: Say | None = None,
    plane: bool = False,
) -> PopulationRun:
    """Evaluate people of the study's population; leaves population.json and people.csv.

    Parameters
    ----------
    study, directory, options, on_progress, say
        As of `search_study`.
    number : int
        How many people; at most, with `until_width`.
    until_width : float, optional
        Stop when every share's 95 % interval is no wider than this fraction, looked at after every 500 people.
    seed : int, optional
        Of the drawing; the study's `search.seed` by default. Person i depends on it alone.
    plane : bool
        Evaluate a grid over stature and mass as well, for a figure.

    Raises
    ------
    StudyError
        There is no population, or a file of people is not as wanted or too short.
    FileError, TooManyFailures
        As `search_study`.
    """
    options = options or RunOptions()
    study = seeded(study, seed)
    population, left_out = population_of(study), LeftOut()
    people = population.people(study.search.seed, left_out)
    first = next(people)  # who is not there is missed before the workers start
    people = itertools.chain([first], people)
    progress, tally = Progress(number), Tally(study.limits)
    with open_batch(study, directory, KIND, options, min(number, CHUNK), on_progress, progress, say) as batch:
        part = directory / f"{PEOPLE_NAME}.part"
        stopped_by = "number of people"
        try:
            with part.open("w", encoding="utf-8", newline="") as file:
                _header(file)
                while tally.people < number:
                    chunk = list(itertools.islice(people, min(CHUNK, number - tally.people)))
                    if not chunk:
                        raise StudyError(
                            f"{study.population['file']}: holds {tally.people} people within the limits, -n {number} "
                            f"wants more; give -n {tally.people}"
                        )
                    results = batch.evaluate(chunk)
                    for person, result in zip(chunk, results, strict=True):
                        tally.add(person, result)
                    _rows(file, tally.people - len(chunk), chunk, results)
                    batch.report(milestone=True)
                    if until_width is not None and tally.evaluated and tally.widest <= until_width:
                        stopped_by = "width of the intervals"
                        break
            os.replace(part, directory / PEOPLE_NAME)
        except OSError as error:
            raise FileError(f"{part}: cannot be written ({error.strerror}); check space and permissions") from None
        finally:
            part.unlink(missing_ok=True)
        content: dict[str, Any] = {
            "sentence": "",
            "filetype": FILETYPE,
            "version": VERSION,
            "name": population.name,
            "who": population.limits_text(),
            **tally.as_dict(),
            "left_out": {"candidates": left_out.candidates, "people": left_out.number, "by_limit": left_out.by_limit},
            "plane": margin_planes(batch, population) if plane else [],
            **provenance(study, KIND, batch, study.search.seed, stopped_by, options.mbdae),
        }
        content["sentence"] = sentences(content)[0]
    write_text(directory / RESULT_NAME, to_json(content))
    return PopulationRun(content, progress)


def _header(file: IO[str]) -> None:
    csv.writer(file, lineterminator="\n").writerow(
        ["number", "age_years", "stature_m", "mass_kg", "sex", "status", "stable", *OBJECTIVES]
    )


def _rows(file: IO[str], first: int, people: list[Person], results: list[dict[str, Any]]) -> None:
    """A row for each person; a margin without a crossing is `inf`, of who could not be evaluated an empty cell."""
    writer = csv.writer(file, lineterminator="\n")
    for number, (person, result) in enumerate(zip(people, results, strict=True), start=first):
        ok = result["status"] == "ok"
        margins = [repr(signed(row, result)) if ok else "" for row in OBJECTIVES.values()]
        stable = str(bool(result["loop"]["stable"])).lower() if ok else ""
        values = [repr(person[name]) for name in ("age_years", "stature_m", "mass_kg")]
        writer.writerow([number, *values, person["pilot.sex"], result["status"], stable, *margins])
