"""A search of one study, from the first population to study.h5.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pilotgen.objectives import ranked_objectives
from pilotgen.runs.batch import RESULTS_NAME, OnProgress, Progress
from pilotgen.runs.options import RunOptions
from pilotgen.runs.results import Row, columns_of, write_results
from pilotgen.runs.session import Run, open_batch, provenance
from pilotgen.study.study import Study


def search_study(
    study: Study, directory: Path, options: RunOptions | None = None, on_progress: OnProgress | None = None
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

    Raises
    ------
    FileError
        No solver, no workers, no space, or the directory holds another study.
    TooManyFailures
        More pilots failed than `options` allows.
    """
    options = options or RunOptions()
    settings = study.search
    progress = Progress(settings.population * settings.generations, generations=settings.generations)
    rows: list[Row] = []
    with open_batch(study, directory, options, settings.population, on_progress, progress) as batch:
        from pilotgen.search import Problem, run_search  # while the workers warm up

        problem = Problem.from_settings(settings)

        def evaluate(X: np.ndarray, generation: int) -> np.ndarray:
            progress.generation = generation
            results = batch.evaluate([problem.values(x) for x in X])
            F = np.full((len(X), problem.n_obj), np.nan)
            for k, (x, result) in enumerate(zip(X, results, strict=True)):
                rows.append(Row(generation, k, problem.values(x), result))
                if result["status"] == "ok":
                    F[k] = ranked_objectives(result, settings.objectives)
            batch.report(milestone=True)
            return F

        found = run_search(problem, settings, evaluate)
        write_results(
            directory / RESULTS_NAME,
            provenance(study, "search", batch, settings.seed, found.stopped_by, options.mbdae),
            problem.names,
            problem.xl,
            problem.xu,
            problem.objectives,
            columns_of(rows, problem.names, found.F, found.rank),
            found.members,
            found.front,
        )
    return Run(directory / RESULTS_NAME, progress, found.stopped_by, tuple(dict(row.result) for row in rows))
