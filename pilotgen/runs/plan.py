"""What a search or a sample would do, how long, with how much memory and disk: told beforehand, nothing written.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import os
import shutil
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pilotgen.context import EvaluationContext
from pilotgen.evaluation import Evaluation, evaluate
from pilotgen.output import STUDY_FILES, examine
from pilotgen.population.region import region_of
from pilotgen.runs.changes import refuse_changes
from pilotgen.runs.fingerprint import fingerprint, solver_version
from pilotgen.runs.journal import JOURNAL_NAME, peek
from pilotgen.runs.memory import free_bytes, peak_bytes, resident_bytes
from pilotgen.runs.options import RunOptions
from pilotgen.runs.results import Row, columns_of
from pilotgen.runs.sample_study import CHUNK
from pilotgen.runs.search_study import check_algorithm
from pilotgen.study.study import Study

TIMED_S, MOST_TIMED = 1.0, 20  # the nominal pilot is evaluated for so long, or so many times
# Measured on two cores of a 2.6 GHz machine: imports, workers and solver until the first pilot is evaluated.
START_S = 2.0
REPORT_S = 6.0  # of a search: figures, decks of the front (same machine)
REPORT_BYTES = 1_500_000  # report.html with figures, and a front of ten pilots' decks
JOURNAL_OVERHEAD = 1.35  # pages and index over the text of rows (measured: 1,800 and 3,000 pilots)


@dataclass(frozen=True)
class Plan:
    """What would be done.

    Attributes
    ----------
    kind : str
        "search" or "sample".
    evaluations : int
        Pilots, at most.
    recorded : int
        Of these, evaluations that the directory's journal holds and that can be served.
    workers : int
        Processes.
    seconds_per_pilot : float
        Wall time of one pilot in one process, measured on the nominal pilot; of a robust search with his draws [s].
    seconds : float
        The whole run [s], estimated.
    memory_bytes, memory_free_bytes : int
        Of all processes, estimated from this one and its solver; what the machine has left.
    disk_bytes, disk_free_bytes : int
        Of the output directory, estimated from the nominal pilot's result; what its file system has left.
    nominal : str
        How the nominal pilot fared, in words.
    solver : str
        Its version.
    """

    kind: str
    evaluations: int
    recorded: int
    workers: int
    seconds_per_pilot: float
    seconds: float
    memory_bytes: int
    memory_free_bytes: int
    disk_bytes: int
    disk_free_bytes: int
    nominal: str
    solver: str


def plan(study: Study, options: RunOptions, directory: Path | None = None, number: int | None = None) -> Plan:
    """Find out what a search (or a sample of `number` pilots) would do, by evaluating the nominal pilot.

    Parameters
    ----------
    study : Study
        The study.
    options : RunOptions
        As the run would have them.
    directory : Path, optional
        Where it would write: looked at as the run would, nothing is written.
    number : int, optional
        Pilots of a sample; None: a search.

    Raises
    ------
    FileError, StudyError
        What would stop the run before its first evaluation.
    """
    kind = "search" if number is None else "sample"
    settings = study.search
    if number is None:
        check_algorithm(settings)
        region_of(study)  # a region that holds nobody is told now
    print_hash = fingerprint(study, options.mbdae, options.solver)
    recorded = 0
    if directory is not None:
        examine(directory, kind, STUDY_FILES, options.resume)
        recorded = _recorded(directory, study, kind, print_hash)
    evaluations = settings.population * settings.generations if number is None else number
    workers = options.worker_count(settings.population if number is None else min(number, CHUNK))
    nominal = study.values({})
    with EvaluationContext(study, options.mbdae, options.solver, options.mbdyn, options.time_limit_s) as context:
        outcome = evaluate(context, nominal)  # imports, and a solver that starts, are not timed
        begin, count = time.perf_counter(), 0
        while count < MOST_TIMED and time.perf_counter() - begin < TIMED_S:
            evaluate(context, nominal)
            count += 1
        per_pilot = (time.perf_counter() - begin) / count * (study.uncertain["draws"] + 1 if study.robust else 1)
        # What this process has now, not what it once had: a Python session may have had much before.
        memory = resident_bytes(os.getpid()) + (peak_bytes(context.client.pid) if context.mbdae is not None else 0)
        solver = solver_version(options.mbdae) if context.mbdae is not None else "none"
    left = max(0, evaluations - recorded)
    row = _bytes_per_pilot(study, outcome.result)
    told = "evaluated" if isinstance(outcome, Evaluation) else f"fails at {outcome.stage}: {outcome.reason}"
    return Plan(
        kind,
        evaluations,
        min(recorded, evaluations),
        workers,
        per_pilot,
        START_S + left * per_pilot / workers + (REPORT_S if number is None else 0.0),
        memory * (workers + 1),
        free_bytes(),
        row * evaluations + (REPORT_BYTES if number is None else 0),
        _free_disk(directory or Path.cwd()),
        told,
        solver,
    )


def _recorded(directory: Path, study: Study, kind: str, print_hash: str) -> int:
    """Evaluations of the directory's journal that could be served. FileError if the study could not go on there."""
    path = directory / JOURNAL_NAME
    if not path.is_file():
        return 0
    meta, count = peek(path)
    if "study_text" in meta:
        refuse_changes(directory, meta["study_text"], study, kind)
    return count if meta.get("fingerprint") == print_hash else 0


def _bytes_per_pilot(study: Study, result: dict[str, object]) -> int:
    """Journal and study.h5 of one pilot."""
    names = tuple(study.search.variables)
    text = len(json.dumps(result)) + 60 * len(study.nominal) + 2 * 64
    text += 20 * study.uncertain["draws"] * len(study.robust)  # margins of the draws
    row = Row(0, 0, dict.fromkeys(names, 1.0), {**result, "status": result["status"]})
    columns = columns_of([row], names, np.zeros((1, len(study.search.objectives))), None)
    return int(JOURNAL_OVERHEAD * text) + sum(column.nbytes + 16 for column in columns.values())


def _free_disk(directory: Path) -> int:
    place = directory.absolute()
    while not place.exists() and place != place.parent:
        place = place.parent
    try:
        return shutil.disk_usage(place).free
    except OSError:
        return 0
