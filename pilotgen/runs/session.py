"""A run in its output directory: workers, journal and the batch of pilots they share, opened and closed together.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import pickle
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pilotgen import __version__
from pilotgen.errors import FileError
from pilotgen.progress_line import counted
from pilotgen.runs.batch import Batch, OnProgress, Progress, as_result
from pilotgen.runs.executor import Interrupted, ProcessWorkers, Workers
from pilotgen.runs.fingerprint import fingerprint, solver_version
from pilotgen.runs.journal import JOURNAL_NAME, Journal
from pilotgen.runs.options import RunOptions
from pilotgen.runs.task import Task, run_task
from pilotgen.study.study import Study


@dataclass(frozen=True)
class Run:
    """A search or a sample that came to its end.

    Attributes
    ----------
    path : Path
        study.h5, with every evaluation.
    progress : Progress
        What was done.
    stopped_by : str
        As in study.h5: `rank one share`, `generation limit`, `sample complete`.
    results : tuple of dict
        Result objects of the evaluations in the order of study.h5; empty for a sample, whose number has no limit.
    """

    path: Path
    progress: Progress
    stopped_by: str
    results: tuple[dict[str, Any], ...] = ()

    @property
    def any_ok(self) -> bool:
        """Whether at least one pilot could be evaluated."""
        return self.progress.failed < self.progress.done


@contextmanager
def open_batch(
    study: Study, directory: Path, options: RunOptions, most: int, on_progress: OnProgress | None, progress: Progress
) -> Iterator[Batch]:
    """Workers (no more than `most`), the directory's journal and the task of one pilot, together.

    Raises
    ------
    FileError
        There is no solver, the journal belongs to another study, or workers cannot be had.
    """
    print_hash = fingerprint(study, options.mbdae, options.solver)  # also finds out early that there is no solver
    workers = _make_workers(options, most)
    try:
        with _open_journal(directory, study) as journal:
            make_task = _task_maker(study, options, print_hash)
            batch = Batch(
                journal,
                workers,
                run_task,
                make_task,
                print_hash,
                options.max_failures,
                options.retry_failed,
                study.search.objectives,
                on_progress,
                progress,
            )
            batch.warm_up()
            try:
                yield batch
            except KeyboardInterrupt as interruption:
                recorded = len(journal)
                kept = f"{counted(recorded, 'evaluation')} recorded, go on with --resume" if recorded else ""
                raise Interrupted(getattr(interruption, "signal", signal.SIGINT), kept) from None
    finally:
        workers.close()


def evaluate_pilots(
    study: Study,
    pilots: Sequence[Mapping[str, float]],
    options: RunOptions,
    on_progress: OnProgress | None = None,
) -> list[dict[str, Any]]:
    """Result objects of these pilots (complete values), in their order; nothing is recorded.

    Raises
    ------
    FileError
        There is no solver, or workers cannot be had.
    """
    print_hash = fingerprint(study, options.mbdae, options.solver)
    make_task = _task_maker(study, options, print_hash)
    progress = Progress(len(pilots))
    found: dict[int, dict[str, Any]] = {}
    workers = _make_workers(options, max(1, len(pilots)))
    try:
        for index, outcome in workers.run(run_task, [make_task(values) for values in pilots]):
            found[index], cpu_s = as_result(outcome, pilots[index])
            progress.evaluated += 1
            progress.cpu_s += cpu_s
            progress.failed += found[index]["status"] != "ok"
            if on_progress is not None:
                on_progress(progress, False)
    finally:
        workers.close()
    return [found[index] for index in range(len(pilots))]


def _task_maker(study: Study, options: RunOptions, print_hash: str) -> Callable[[Mapping[str, float]], Task]:
    pickled = pickle.dumps(study)
    to_check = print_hash if options.executor == "dask" else None  # workers may be on other machines

    def make_task(values: Mapping[str, float]) -> Task:
        return Task(
            pickled,
            study.values(values),
            options.mbdae,
            options.solver,
            options.mbdyn,
            options.time_limit_s,
            to_check,
        )

    return make_task


def _make_workers(options: RunOptions, most: int) -> Workers:
    count = options.worker_count(most)
    if options.executor == "dask":
        from pilotgen.runs.dask import DaskWorkers

        return DaskWorkers(options.scheduler, count)
    return ProcessWorkers(count)


def _open_journal(directory: Path, study: Study) -> Journal:
    journal = Journal(directory / JOURNAL_NAME)
    known = journal.get_meta("study_text")
    if known is None:
        journal.set_meta("study_text", study.text)
        journal.set_meta("study_name", study.name)
    elif known != study.text:
        name = journal.get_meta("study_name")
        journal.close()
        raise FileError(
            f"{directory} holds the study {name!r} with another text than {study.path}; "
            "choose another output directory, or give the study file it was started with"
        )
    return journal


def provenance(study: Study, kind: str, batch: Batch, seed: int, stopped_by: str, mbdae: str | None) -> dict[str, Any]:
    """The attributes of study.h5."""
    return {
        "kind": kind,
        "pilotgen_version": __version__,
        "solver_version": solver_version(mbdae) if study.pilot.model == "multibody" else "none",
        "fingerprint": batch.fingerprint,
        "seed": seed,
        "study_name": study.name,
        "study_text": study.text,
        "stopped_by": stopped_by,
    }
