"""Populations, rare shares, sensitivities, uncertain pilots from Python; `pilotgen.api` offers them (docs/python.md).

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import copy
import csv
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pilotgen.context import EvaluationContext
from pilotgen.errors import EvaluationError
from pilotgen.evaluation import Evaluation, evaluate
from pilotgen.output import claimed
from pilotgen.runs import population_study, rare_study, sensitivity_study, uncertain_study
from pilotgen.runs.batch import OnProgress, Progress
from pilotgen.runs.monitor import heard
from pilotgen.runs.options import RunOptions
from pilotgen.study.study import Study
from pilotgen.uncertain.draws import Draws


@dataclass(frozen=True)
class Found:
    """What a population, a rare share, a sensitivity or the draws of one pilot came to.

    Attributes
    ----------
    path : Path
        The JSON file it left.
    content : mapping
        What stands in it (docs/io_formats/population.md, docs/io_formats/sensitivity.md, docs/io_formats/uncertain.md).
    progress : Progress
        What was done for it.
    """

    path: Path
    content: Mapping[str, Any]
    progress: Progress = field(repr=False)

    def to_dict(self) -> dict[str, Any]:
        """A copy of the content: plain numbers, texts, lists, dictionaries."""
        return copy.deepcopy(dict(self.content))

    def table(self, objective: str | None = None) -> np.ndarray:
        """A NumPy structured array: people of a population, draws, or the numbers of a sensitivity for one objective.

        Parameters
        ----------
        objective : str, optional
            Of a sensitivity; the first one by default.

        Returns
        -------
        ndarray, shape (people,), (draws,) or (numbers,)
            Columns of people.csv or uncertain.csv (what a failed one lacks is NaN or empty); or `number`, `slope` and
            the indices (rows of the table of an analysis of variance), NaN where there is none.
        """
        if "objectives" in self.content:
            return _indices(self.content, objective)
        if self.content.get("filetype") == uncertain_study.FILETYPE:
            return _drawn(self.path.with_name(uncertain_study.DRAWS_NAME))
        people = self.path.with_name(population_study.PEOPLE_NAME)
        if "shares" not in self.content or not people.is_file():
            return _array([{**one["values"], **one} for one in self.content.get("nearest", [])])
        table: np.ndarray = np.genfromtxt(people, delimiter=",", names=True, dtype=None, encoding="utf-8")
        return np.atleast_1d(table)


@dataclass(frozen=True)
class Begun:
    """A run that has its directory: the study as it is written down there, options, and who is told of progress."""

    study: Study
    directory: Path
    options: RunOptions
    told: OnProgress


@contextmanager
def begun(
    study: Study,
    directory: str | os.PathLike[str],
    kind: str,
    files: tuple[str, ...],
    options: RunOptions | None,
    on_progress: OnProgress | None,
    overwrite: bool,
) -> Iterator[Begun]:
    """Claim a directory for a run of this kind, which leaves `files`; its heartbeat is written. Raises as `claimed`."""
    options = options or RunOptions()
    with (
        claimed(Path(directory), kind, files, options.resume, overwrite) as place,
        heard(place, on_progress) as told,
    ):
        yield Begun(study.with_own_text(), place, options, told)  # what was changed after reading is written down too


def sample_population(
    study: Study,
    directory: str | os.PathLike[str],
    number: int,
    until_width: float | None = None,
    seed: int | None = None,
    options: RunOptions | None = None,
    on_progress: OnProgress | None = None,
    overwrite: bool = False,
) -> Found:
    """Evaluate people of the study's population; leaves what `pilotgen population` leaves in `directory`.

    Parameters
    ----------
    study, directory, options, on_progress, overwrite
        As of `search_pilots`.
    number : int
        How many people; at most, with `until_width`. Person i does not depend on it.
    until_width : float, optional
        Stop when every share's 95 % interval is no wider than this fraction.
    seed : int, optional
        The study's own by default.
    """
    with begun(study, directory, "population", population_study.FILES, options, on_progress, overwrite) as run:
        done = population_study.population_study(
            run.study, run.directory, number, until_width, seed, run.options, run.told
        )
    return Found(run.directory / population_study.RESULT_NAME, done.content, done.progress)


def rare_share(
    study: Study,
    directory: str | os.PathLike[str],
    number: int,
    event: str,
    seed: int | None = None,
    options: RunOptions | None = None,
    on_progress: OnProgress | None = None,
    overwrite: bool = False,
) -> Found:
    """Estimate a share of the study's population that is too rare to be counted, as `pilotgen population --rare`.

    Parameters
    ----------
    study, directory, seed, options, on_progress, overwrite
        As of `sample_population`.
    number : int
        People to evaluate, at most.
    event : str
        `unstable`, or a margin of which the study has a limit.
    """
    with begun(study, directory, "population", population_study.FILES, options, on_progress, overwrite) as run:
        done = rare_study.rare_study(run.study, run.directory, number, event, seed, run.options, run.told)
    return Found(run.directory / rare_study.RESULT_NAME, done.content, done.progress)


def sensitivity_of(
    study: Study,
    directory: str | os.PathLike[str],
    number: int,
    method: str = "sobol",
    seed: int | None = None,
    options: RunOptions | None = None,
    on_progress: OnProgress | None = None,
    overwrite: bool = False,
) -> Found:
    """Tell which numbers of the study decide its objectives; leaves what `pilotgen sensitivity` leaves in `directory`.

    Parameters
    ----------
    study, directory, seed, options, on_progress, overwrite
        As of `sample_population`.
    number : int
        Base points, trajectories, pilots or levels, as `-n` of the command.
    method : str
        "sobol", "morris", "surrogate" or "anova".
    """
    with begun(study, directory, "sensitivity", sensitivity_study.FILES, options, on_progress, overwrite) as run:
        done = sensitivity_study.sensitivity_study(
            run.study, run.directory, number, method, seed, run.options, run.told
        )
    return Found(run.directory / sensitivity_study.RESULT_NAME, done.content, done.progress)


def uncertain_pilot(
    study: Study,
    directory: str | os.PathLike[str],
    number: int = 200,
    values: Mapping[str, Any] | None = None,
    options: RunOptions | None = None,
    on_progress: OnProgress | None = None,
    overwrite: bool = False,
) -> Found:
    """Evaluate draws of one pilot who is `uncertain`, as `pilotgen pilot --uncertain`; leaves uncertain.json and .csv.

    Parameters
    ----------
    study, directory, options, on_progress, overwrite
        As of `sample_population`.
    number : int
        How many draws. Draw i does not depend on it, nor on the pilot.
    values : mapping, optional
        What this pilot has other than the study's nominal one, as of `evaluate`.

    Raises
    ------
    EvaluationError
        The pilot as the study has him cannot be evaluated.
    StudyError
        Nothing is uncertain, or a name or value that the study cannot have.
    """
    Draws(study, 1).changes(0, study.values(values or {}))  # a slip of the caller, before anything is written
    if options is not None and options.resume:
        uncertain_study.check_going_on(Path(directory), study.with_own_text())
    with begun(study, directory, "uncertain", uncertain_study.FILES, options, on_progress, overwrite) as run:
        chosen = run.options
        with EvaluationContext(run.study, chosen.mbdae, chosen.solver, chosen.mbdyn, chosen.time_limit_s) as context:
            nominal = evaluate(context, run.study.values(values or {}))
            if not isinstance(nominal, Evaluation):
                raise EvaluationError(nominal.stage, nominal.reason)
            done = uncertain_study.uncertain_study(context, nominal, run.directory, number, chosen, run.told)
    return Found(run.directory / uncertain_study.RESULT_NAME, done.content, done.progress)


def _indices(content: Mapping[str, Any], objective: str | None) -> np.ndarray:
    one = content["objectives"][objective or next(iter(content["objectives"]))]
    if "anova" in one:
        return _array(one["anova"] or [])
    numbers = (one["indices"] or {}).get("numbers", {})
    return _array([{"number": name, "slope": slope, **numbers.get(name, {})} for name, slope in one["slopes"].items()])


def _drawn(path: Path) -> np.ndarray:
    """Rows of uncertain.csv; words stay words, an empty cell of a margin is NaN."""
    words = ("status", "stage", "stable")
    with path.open(encoding="utf-8", newline="") as file:
        rows = [
            {name: cell if name in words else _number(cell) for name, cell in row.items()}
            for row in csv.DictReader(file)
        ]
    return _array(rows)


def _number(cell: str) -> float | str | None:
    try:
        return float(cell) if cell else None
    except ValueError:  # a word of the study, such as a task
        return cell


def _array(rows: list[dict[str, Any]]) -> np.ndarray:
    """Rows of the same keys as a structured array; what is null or has parts is NaN or left out."""
    names = list(dict.fromkeys(name for row in rows for name, value in row.items() if not isinstance(value, Mapping)))
    columns = []
    for name in names:
        column = [row.get(name) for row in rows]
        text = any(isinstance(value, str) for value in column)
        columns.append(np.array([str(v) for v in column] if text else [np.nan if v is None else v for v in column]))
    table: np.ndarray = np.empty(
        len(rows), dtype=[(name, column.dtype) for name, column in zip(names, columns, strict=True)]
    )
    for k, name in enumerate(names):
        table[name] = columns[k]
    return table
