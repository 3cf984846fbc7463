"""A search of one study, from the first population to study.h5.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import importlib.util
from pathlib import Path

import numpy as np

from pilotgen.errors import FileError, StudyError
from pilotgen.objectives import quantiles, ranked_objectives
from pilotgen.population.region import region_of
from pilotgen.runs.batch import RESULTS_NAME, OnProgress, Progress
from pilotgen.runs.journal import Journal
from pilotgen.runs.options import RunOptions
from pilotgen.runs.results import DISTANCE, Row, columns_of, write_results
from pilotgen.runs.session import Run, Say, open_batch, provenance
from pilotgen.study.sections import SearchSettings
from pilotgen.study.study import Study


def search_study(
    study: Study,
    directory: Path,
    options: RunOptions | None = None,
    on_progress: OnProgress | None = None,
    extend: int = 0,
    say: Say | None = None,
) -> Run:
    """Breed the worst pilots of a study; evaluations go to the journal as they finish, study.h5 is written at the end.

    Parameters
    ----------
    study : Study
        What to search.
    directory : Path
        Where journal and study.h5 are; the caller holds it (`pilotgen.output.claimed`).
    options : RunOptions, optional
        Workers, solver, limits.
    on_progress : callable, optional
        (Progress, milestone) after every evaluation and, as a milestone, after every generation.
    extend : int
        Generations beyond those that the directory's search was last to have.
    say : callable, optional
        Takes what the user should know, one sentence at a time; by default it is a warning.

    Raises
    ------
    FileError
        No solver, no workers, no space, or the directory holds another study.
    TooManyFailures
        More pilots failed than `options` allows.
    """
    options = options or RunOptions()
    settings = study.search
    check_algorithm(settings)
    region = region_of(study)
    progress = Progress()
    rows: list[Row] = []
    with open_batch(study, directory, "search", options, settings.population, on_progress, progress, say) as batch:
        settings = dataclasses.replace(settings, generations=_generations(batch.journal, settings, extend))
        progress.generations, progress.total = settings.generations, settings.generations * settings.population
        from pilotgen.search import Problem, run_search  # while the workers warm up

        problem = Problem.from_settings(settings, region)

        def evaluate(X: np.ndarray, generation: int) -> np.ndarray:
            progress.generation = generation
            pilots = problem.pilots(X)
            results = batch.evaluate(pilots)
            F = np.full((len(X), problem.n_obj), np.nan)
            for k, (pilot, result) in enumerate(zip(pilots, results, strict=True)):
                rows.append(Row(generation, k, pilot, result))
                if result["status"] == "ok":
                    F[k] = ranked_objectives(result, settings.objectives)
            batch.report(milestone=True)
            return F

        found = run_search(problem, settings, evaluate)
        columns = columns_of(rows, problem.names, found.F, found.rank, quantiles(study.search.objectives))
        if region is not None:
            columns[DISTANCE] = region.distance(columns["inputs"])
        write_results(
            directory / RESULTS_NAME,
            provenance(study, "search", batch, settings.seed, found.stopped_by, options.mbdae),
            problem.names,
            problem.extent[0],
            problem.extent[1],
            problem.objectives,
            columns,
            found.members,
            found.front,
        )
        batch.journal.set_meta("generations", str(settings.generations))
        if len(found.members) < settings.generations and say is not None:
            say(why_it_stopped(found.stopped_by, len(found.members), settings))
    return Run(directory / RESULTS_NAME, progress, found.stopped_by, tuple(dict(row.result) for row in rows))


def why_it_stopped(stopped_by: str, done: int, settings: SearchSettings) -> str:
    """A sentence on a search that stopped before its limit, and how it goes on."""
    from pilotgen.search.termination import CONVERGED

    if stopped_by == CONVERGED:
        why = f"converged: {settings.stop_unchanged_generations} generations found no pilot that is worse"
        key = "stop_unchanged_generations"
    else:
        why, key = "the population is of rank one", "stop_rank_one_fraction"
    return (
        f"stopped after generation {done} of {settings.generations}, {why}; to go on, write search.{key}: null in the "
        "study and add --resume"
    )


def _generations(journal: Journal, settings: SearchSettings, extend: int) -> int:
    """How many generations the search is to have: never fewer than it has."""
    there = journal.get_meta("generations")
    if extend and there is None:
        raise FileError(
            f"{journal.path.parent} holds no finished search to extend; finish it first, with --resume alone"
        )
    try:
        known = int(there or 0)
    except ValueError:
        raise FileError(
            f"{journal.path}: the number of generations there is {there!r}; the journal is damaged: move it aside"
        ) from None
    return max(settings.generations, known + extend)


def check_algorithm(settings: SearchSettings) -> None:
    """Raise StudyError if what the study's algorithm needs is not installed."""
    if settings.algorithm == "nsga2" and importlib.util.find_spec("pymoo") is None:
        raise StudyError(
            "search.algorithm = 'nsga2' needs the package pymoo; install it with: pip install 'pilotgen[search]'"
        )
