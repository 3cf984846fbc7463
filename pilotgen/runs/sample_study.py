"""A sample of a study's box: many pilots, in constant memory, to study.h5.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pilotgen.objectives import quantiles, ranked_objectives
from pilotgen.runs.batch import RESULTS_NAME, OnProgress, Progress
from pilotgen.runs.options import RunOptions
from pilotgen.runs.results import ResultsWriter, Row, columns_of
from pilotgen.runs.session import Run, Say, open_batch, provenance, seeded
from pilotgen.study.study import Study

if TYPE_CHECKING:
    from pilotgen.search import Problem

CHUNK = 1000  # pilots in memory at a time
METHODS = ("sobol", "random")
COMPLETE = "sample complete"  # what study.h5 says in `stopped_by`


def sample_study(
    study: Study,
    directory: Path,
    number: int,
    method: str = "sobol",
    seed: int | None = None,
    options: RunOptions | None = None,
    on_progress: OnProgress | None = None,
    say: Say | None = None,
) -> Run:
    """Evaluate pilots spread over the study's box; memory does not grow with their number.

    Parameters
    ----------
    study, directory, options, on_progress, say
        As of `search_study`.
    number : int
        How many pilots.
    method : str
        "sobol" or "random": how they are spread. Pilot i does not depend on `number`.
    seed : int, optional
        Of their spreading; the study's `search.seed` by default.

    Raises
    ------
    FileError, TooManyFailures
        As `search_study`.
    """
    options = options or RunOptions()
    study = seeded(study, seed)
    seed = study.search.seed
    progress = Progress(number)
    with open_batch(study, directory, "sample", options, min(number, CHUNK), on_progress, progress, say) as batch:
        from pilotgen.search import Problem  # while the workers warm up

        problem = Problem.from_settings(study.search)
        attributes = provenance(study, "sample", batch, seed, COMPLETE, options.mbdae)
        path = directory / RESULTS_NAME
        with ResultsWriter(path, attributes, problem.names, problem.xl, problem.xu, problem.objectives) as writer:
            first = 0
            for X in points(method, number, problem, seed):
                results = batch.evaluate([problem.values(x) for x in X])
                pairs = list(zip(X, results, strict=True))
                rows = [Row(0, first + k, problem.values(x), result) for k, (x, result) in enumerate(pairs)]
                F = np.full((len(X), problem.n_obj), np.nan)
                for k, result in enumerate(results):
                    if result["status"] == "ok":
                        F[k] = ranked_objectives(result, problem.objectives)
                writer.append(columns_of(rows, problem.names, F, None, quantiles(study.search.objectives)))
                first += len(X)
                batch.report(milestone=True)
    return Run(path, progress, COMPLETE)


def points(method: str, number: int, problem: Problem, seed: int) -> Iterator[np.ndarray]:
    """Points of the box in chunks, each of shape (k, n_var); point i does not depend on `number`."""
    from pilotgen.search import sampling

    spread = sampling.sobol_points if method == "sobol" else sampling.random_points
    for first in range(0, number, CHUNK):
        yield spread(first, min(CHUNK, number - first), problem.xl, problem.xu, seed)
