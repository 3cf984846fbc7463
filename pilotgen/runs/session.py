"""A run in its output directory: workers, journal and the batch of pilots they share, opened and closed together.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import pickle
import signal
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pilotgen import __version__
from pilotgen.errors import FileError
from pilotgen.files import write_text
from pilotgen.objectives import OBJECTIVES
from pilotgen.output import STUDY_NAME
from pilotgen.progress_line import counted
from pilotgen.runs.batch import RESULTS_NAME, Batch, OnProgress, Progress, as_result
from pilotgen.runs.changes import ROBUST_KINDS, UNCERTAIN, refuse_changes
from pilotgen.runs.executor import ProcessWorkers, Workers
from pilotgen.runs.fingerprint import fingerprint, solver_version
from pilotgen.runs.journal import JOURNAL_NAME, Journal
from pilotgen.runs.options import RunOptions
from pilotgen.runs.results import read_results
from pilotgen.runs.task import Task, run_task
from pilotgen.study.study import Study
from pilotgen.terminal import Interrupted

Say = Callable[[str], None]  # of one sentence


def _warn(sentence: str) -> None:
    warnings.warn(sentence, stacklevel=2)


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
        As in study.h5: `rank one share`, `converged`, `generation limit`, `sample complete`.
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


def seeded(study: Study, seed: int | None) -> Study:
    """The study with another `search.seed`; None: its own."""
    if seed is None:
        return study
    return dataclasses.replace(study, search=dataclasses.replace(study.search, seed=seed))


@contextmanager
def open_batch(
    study: Study,
    directory: Path,
    kind: str,
    options: RunOptions,
    most: int,
    on_progress: OnProgress | None,
    progress: Progress,
    say: Say | None = None,
    function: Callable[[Task], tuple[dict[str, Any], float]] = run_task,
) -> Iterator[Batch]:
    """Workers (no more than `most`), the directory's journal and the task of one pilot, together.

    `function`, of a module, is what workers do with a task.

    Raises Interrupted when a signal ends the run.

    What a user should know before work starts is said by `say`, one sentence at a time; by a warning without one.

    Raises
    ------
    FileError
        There is no solver, the journal belongs to another study, or workers cannot be had.
    """
    print_hash = fingerprint(study, options.mbdae, options.solver)  # also finds out early that there is no solver
    workers = _make_workers(options, most)
    progress.workers = 0 if options.scheduler is not None else options.worker_count(most)
    if options.scheduler is not None and is_open(options.scheduler):
        (say or _warn)(
            f"anybody who reaches {options.scheduler} can run programs there as its user and as you; certificates "
            "(tls://) keep others out: docs/cluster.md"
        )
    try:
        with _open_journal(directory, study, kind, print_hash, say or _warn) as journal:
            robust = kind in ROBUST_KINDS and bool(study.robust)
            if robust:
                times = study.uncertain["draws"] + 1
                total = times * (progress.total or study.search.population * study.search.generations)
                (say or _warn)(
                    f"a quantile over draws is minimised: every pilot is evaluated {times} times, at most {total} "
                    "evaluations in all"
                )
            make_task = _task_maker(study, options, print_hash, robust)
            told = [key for key in study.search.objectives if robust or key in OBJECTIVES]
            batch = Batch(
                journal,
                workers,
                function,
                make_task,
                print_hash,
                options.max_failures,
                options.retry_failed,
                told,
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


def is_open(scheduler: str) -> bool:
    """Whether a scheduler's address is one that others may reach and that asks for no certificate."""
    protocol, _, rest = scheduler.rpartition("://")
    host = rest.rpartition(":")[0].strip("[]") or rest
    return protocol not in ("tls", "wss") and not (host == "localhost" or host.startswith("127.") or host == "::1")


def _task_maker(
    study: Study, options: RunOptions, print_hash: str, robust: bool = False
) -> Callable[[Mapping[str, float]], Task]:
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
            robust and bool(values),  # no draws to warm up with
        )

    return make_task


def _make_workers(options: RunOptions, most: int) -> Workers:
    count = options.worker_count(most)
    if options.executor == "dask":
        from pilotgen.runs.dask import DaskWorkers

        return DaskWorkers(options.scheduler, count, options.time_limit_s)
    return ProcessWorkers(count, options.time_limit_s)


def _open_journal(directory: Path, study: Study, kind: str, print_hash: str, say: Say) -> Journal:
    """The directory's journal, if the study may go on there; what is special about it is said.

    Raises
    ------
    FileError
        The directory holds a study with other evaluations.
    """
    journal = Journal(directory / JOURNAL_NAME)
    try:
        _go_on(directory, study, kind, print_hash, journal, say)
    except BaseException:
        journal.close()
        raise
    return journal


def _go_on(directory: Path, study: Study, kind: str, print_hash: str, journal: Journal, say: Say) -> None:
    known = journal.get_meta("study_text")
    results = directory / RESULTS_NAME
    if known is None and results.exists():  # the journal is new or was lost
        attributes = read_results(results).attributes
        known = str(attributes["study_text"])
        if attributes["kind"] != kind:
            raise FileError(f"{results} is of a {attributes['kind']}; choose another output directory")
        say(f"{journal.path} holds no evaluations: all pilots are evaluated again")
    if known is not None:
        found = refuse_changes(directory, known, study, kind)
        for change in found:
            say(f"{change.text} since this study was begun")
        if any(change.path == "search.seed" for change in found) and results.exists():
            say(f"another seed is another {kind}: study.h5 of the one before is kept as {_keep_aside(results).name}")
    before = journal.get_meta("fingerprint")
    if before is not None and before != print_hash and (count := len(journal)):
        what = f"{counted(count, 'recorded evaluation')} of another version of code, data or solver cannot be used: "
        if kind == UNCERTAIN:  # other values of the pilot's may be the reason, and may have been used before
            what = "recorded draws of another version of code, data or solver, or of other settings, cannot be used: "
        say(f"{what}these pilots are evaluated again")
    for name, value in (("study_text", study.text), ("study_name", study.name), ("fingerprint", print_hash)):
        if journal.get_meta(name) != value:
            journal.set_meta(name, value)
    write_text(directory / STUDY_NAME, study.text)


def _keep_aside(path: Path) -> Path:
    number = 1
    while (aside := path.with_name(f"{path.name}.old-{number}")).exists():
        number += 1
    try:
        path.rename(aside)
    except OSError as error:
        raise FileError(f"{path}: cannot be kept as {aside.name} ({error.strerror})") from None
    return aside


def provenance(study: Study, kind: str, batch: Batch, seed: int, stopped_by: str, mbdae: str | None) -> dict[str, Any]:
    """The attributes of study.h5."""
    return {
        "kind": kind,
        "pilotgen_version": __version__,
        "solver_version": solver_version(mbdae) if study.pilot.model == "multibody" else "none",
        "fingerprint": batch.fingerprint,
        "seed": seed,
        "study_name": study.name,
        "loop": study.loop.words,
        "study_text": study.text,
        "stopped_by": stopped_by,
    }
