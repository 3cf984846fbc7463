"""`pilotgen search`: breed the worst pilots of a study.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pilotgen.commands import common

if TYPE_CHECKING:
    import numpy as np

    from pilotgen.runs.batch import Batch
    from pilotgen.runs.executor import Workers
    from pilotgen.runs.journal import Journal
    from pilotgen.study.study import Study


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "search",
        "breed the worst pilots",
        "Search the study's box of biometrics for the pilots with the smallest stability margins. Writes study.h5 "
        "(every "
        "evaluation), report.html and the decks of the final Pareto front to DIR, and prints the worst pilots. "
        "Evaluations are "
        "journalled as they finish: an interrupted search goes on with --resume and loses nothing.",
        "pilotgen search docs/studies/quick.yaml -o results/quick --workers 2",
    )
    common.add_study(parser)
    common.add_output(parser)
    common.add_workers(parser)
    common.add_solver(parser)
    parser.add_argument(
        "--no-report", action="store_true", help="do not write report.html and the decks of the Pareto front"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Search, write, print."""
    from pilotgen.runs.executor import pin_threads, stop_on_sigterm

    pin_threads()
    stop_on_sigterm()
    from pilotgen.runs.batch import RESULTS_NAME, locked_directory
    from pilotgen.runs.fingerprint import fingerprint
    from pilotgen.study.study import read_study

    study = read_study(args.study)
    print_hash = fingerprint(study, args.mbdae, args.solver)  # also finds out early that there is no solver
    with locked_directory(args.output, args.resume) as directory:
        workers = make_workers(args, study.search.population)
        try:
            with open_journal(directory, study) as journal:
                batch = make_batch(args, study, journal, workers, print_hash)
                batch.warm_up()
                rows = search_study(args, study, batch, directory / RESULTS_NAME, print_hash)
        finally:
            workers.close()
        if not args.no_report:
            from pilotgen.report import write_report

            write_report(directory, study, rows, mbdae=args.mbdae, solver=args.solver, mbdyn=args.mbdyn)
        print_worst(args.study, directory, batch, rows, args.solver)
    return 0 if any(row["status"] == "ok" for row in rows) else 2


def make_workers(args: argparse.Namespace, most: int) -> Workers:
    """Who evaluates, as the command line says; no more than `most`, the pilots that are asked for at a time."""
    count = min(args.workers if args.workers is not None else len(os.sched_getaffinity(0)), most)
    if args.executor == "dask":
        from pilotgen.runs.dask import DaskWorkers

        return DaskWorkers(args.scheduler, count)
    from pilotgen.runs.executor import ProcessWorkers

    return ProcessWorkers(count)


def open_journal(directory: Path, study: Study) -> Journal:
    """The directory's journal; FileError when it belongs to another study."""
    from pilotgen.errors import FileError
    from pilotgen.runs.journal import JOURNAL_NAME, Journal

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


def make_batch(args: argparse.Namespace, study: Study, journal: Journal, workers: Workers, print_hash: str) -> Batch:
    """Journal, workers and the task of one pilot, together."""
    import pickle

    from pilotgen.runs.batch import Batch
    from pilotgen.runs.task import Task, run_task

    pickled = pickle.dumps(study)
    to_check = print_hash if args.executor == "dask" else None  # workers may be on other machines

    def make_task(values: Mapping[str, float]) -> Task:
        return Task(pickled, study.values(values), args.mbdae, args.solver, args.mbdyn, args.time_limit, to_check)

    return Batch(journal, workers, run_task, make_task, print_hash, args.max_failures, args.retry_failed)


def attributes_of(
    study: Study, kind: str, print_hash: str, seed: int, stopped_by: str, args: argparse.Namespace
) -> dict[str, Any]:
    """Provenance: the attributes of study.h5."""
    from pilotgen import __version__
    from pilotgen.runs.fingerprint import solver_version

    return {
        "kind": kind,
        "pilotgen_version": __version__,
        "solver_version": solver_version(args.mbdae) if study.pilot.model == "multibody" else "none",
        "fingerprint": print_hash,
        "seed": seed,
        "study_name": study.name,
        "study_text": study.text,
        "stopped_by": stopped_by,
    }


def search_study(
    args: argparse.Namespace, study: Study, batch: Batch, path: Path, print_hash: str
) -> list[dict[str, Any]]:
    """Run the genetic search and write study.h5; returns the result objects in the order of its evaluations."""
    import numpy as np

    from pilotgen.objectives import ranked_objectives
    from pilotgen.progress_line import ProgressLine
    from pilotgen.runs.results import Row, columns_of, write_results
    from pilotgen.search import Problem, run_search

    settings = study.search
    problem = Problem.from_settings(settings)
    total = settings.population * settings.generations
    line = ProgressLine(total, quiet=args.quiet)
    rows: list[Row] = []
    best = [math.inf] * problem.n_obj
    generation = 0

    def show(milestone: bool = False) -> None:
        if line.due(milestone):
            left = line.time_left(batch.progress.done)
            line.update(progress_text(study, batch, generation, best, left), milestone)

    def on_result(result: Mapping[str, Any]) -> None:
        if result["status"] == "ok":
            for k, value in enumerate(ranked_objectives(result, settings.objectives)):
                best[k] = min(best[k], value)
        show()

    def evaluate(X: np.ndarray, number: int) -> np.ndarray:
        nonlocal generation
        generation = number
        results = batch.evaluate([problem.values(x) for x in X])
        F = np.full((len(X), problem.n_obj), np.nan)
        for k, (x, result) in enumerate(zip(X, results, strict=True)):
            rows.append(Row(number, k, problem.values(x), result))
            if result["status"] == "ok":
                F[k] = ranked_objectives(result, settings.objectives)
        show(milestone=True)
        return F

    batch.on_result = on_result
    found = run_search(problem, settings, evaluate)
    line.finish()
    write_results(
        path,
        attributes_of(study, "search", print_hash, settings.seed, found.stopped_by, args),
        problem.names,
        problem.xl,
        problem.xu,
        problem.objectives,
        columns_of(rows, problem.names, found.F, found.rank),
        found.members,
        found.front,
    )
    return [dict(row.result) for row in rows]


def progress_text(study: Study, batch: Batch, generation: int, best: Sequence[float], left: str) -> str:
    """`generation 3/30 | 412 evaluations, 2 failed | smallest GM 1.82 dB, PM 34.1 deg | 0:12 left`."""
    from pilotgen.objectives import OBJECTIVES
    from pilotgen.progress_line import counted

    progress = batch.progress
    margins = ", ".join(
        OBJECTIVES[name].brief(value)
        for name, value in zip(study.search.objectives, best, strict=True)
        if math.isfinite(value)
    )
    served = f" ({progress.served} from the journal)" if progress.served else ""
    parts = [
        f"generation {generation + 1}/{study.search.generations}",
        f"{counted(progress.done, 'evaluation')}{served}, {progress.failed} failed",
        f"smallest {margins}" if margins else "",
        f"at most {left} left" if left else "",
    ]
    return " | ".join(part for part in parts if part)


def print_worst(
    study_path: Path, directory: Path, batch: Batch, rows: Sequence[Mapping[str, Any]], solver: str = "mbdae"
) -> None:
    """Print the worst pilots of study.h5, the failures by reason, and where everything is."""
    from pilotgen.runs.batch import RESULTS_NAME, failures_by_reason
    from pilotgen.runs.results import read_results

    results = read_results(directory / RESULTS_NAME)
    for text in worst_table(results):
        print(text)
    progress = batch.progress
    print(
        f"\n{progress.done} evaluations ({progress.served} from the journal), {progress.failed} failed, "
        f"{progress.cpu_s:.1f} s of CPU time in workers"
    )
    for stage, reason, count, example in failures_by_reason(rows)[:5]:
        print(
            f"  {count} failed at {stage}, e.g. {reason}\n    again with: "
            f"{common.replay_command(study_path, example['values'], solver=solver)}"
        )
    print(f"results: {directory / RESULTS_NAME}")
    if (directory / "report.html").exists():
        print(f"report:  {directory / 'report.html'}")
    sys.stdout.flush()


def worst_table(results: Any, count: int = 10) -> list[str]:
    """The worst pilots of a study as lines of a table, in the order of the report; nearly equal pilots count as one."""
    from pilotgen.objectives import OBJECTIVES
    from pilotgen.report import findings

    columns = results.columns
    order = findings.worst_order(results)
    if not len(order):
        return ["no pilot could be evaluated"]
    heads = [*results.names, *(row.heading for row in OBJECTIVES.values()), "stable"]
    table = [heads]
    for k in findings.distinct(results, order, count):
        table.append(
            [f"{value:.4g}" for value in columns["inputs"][k]]
            + [f"{columns[row.key][k]:.{row.digits}f}" for row in OBJECTIVES.values()]
            + ["yes" if columns["stable"][k] == 1 else "NO"]
        )
    widths = [max(len(row[j]) for row in table) for j in range(len(heads))]
    return ["worst pilots"] + [
        "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in table
    ]
