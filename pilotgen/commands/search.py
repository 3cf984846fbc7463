"""`pilotgen search`: breed the worst pilots of a study.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pilotgen.commands import common, settings
from pilotgen.errors import IncompleteOutput

if TYPE_CHECKING:
    from pilotgen.runs.batch import Progress
    from pilotgen.runs.session import Run
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
    settings.add_settings(parser, settings.MANY_PILOTS)
    common.add_output(parser)
    common.add_workers(parser)
    common.add_solver(parser)
    parser.add_argument(
        "--extend",
        metavar="N",
        type=common.positive_int,
        default=0,
        help="go on with a finished search for N more generations (includes --resume)",
    )
    common.add_fail_below(parser)
    parser.add_argument(
        "--no-report", action="store_true", help="do not write report.html and the decks of the Pareto front"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Search, write, print."""
    from pilotgen.runs.executor import pin_threads

    pin_threads()
    from pilotgen.output import STUDY_FILES, claimed
    from pilotgen.progress_line import ProgressLine
    from pilotgen.runs.search_study import search_study

    study = settings.read_changed(args, "search")
    if args.extend:
        args.resume = True
    options = common.run_options(args, study)
    if not args.no_report:
        check_page()
    line = ProgressLine(study.search.population * study.search.generations, quiet=args.quiet)

    def show(progress: Progress, milestone: bool) -> None:
        monitor(progress, milestone)
        if line.due(milestone):
            share = progress.done / max(1, progress.total)
            line.update(progress_parts(progress, line.time_left(progress.done, progress.total)), milestone, share)

    with claimed(args.output, "search", STUDY_FILES, args.resume, args.overwrite) as directory:
        with common.monitored(args, directory, "search", study.name) as monitor:
            try:
                done = search_study(study, directory, options, show, args.extend, line.before(monitor.say))
            finally:
                line.finish()
        incomplete: IncompleteOutput | None = None
        if not args.no_report:
            from pilotgen.report import write_report

            try:
                write_report(
                    directory, study, done.results, mbdae=options.mbdae, solver=options.solver, mbdyn=options.mbdyn
                )
            except IncompleteOutput as problem:
                incomplete = problem
        if args.json:
            common.print_json(run_summary(args, done))
        else:
            print_worst(args, study, done)
    if incomplete is not None:
        raise incomplete
    if not done.any_ok:
        return 2
    return common.told_below(below_in_study(done.path, study.limits)) if args.fail_below else 0


def check_page() -> None:
    """Raise FileError before the search if what the report is made of is not there after it."""
    from pilotgen.errors import FileError
    from pilotgen.files import check_templates
    from pilotgen.report import assets

    check_templates(assets.DATA, "report.html.j2")
    try:
        assets.style_text()
        assets.script_texts(solid=True)
    except OSError as error:
        raise FileError(
            f"{error.filename}: cannot be read ({error.strerror}); this installation is incomplete, install it again"
        ) from None


def below_in_study(path: Path, limits: Mapping[str, float | None]) -> list[str]:
    """What pilots of study.h5 lack, and how many of them."""
    from pilotgen.report.findings import pilots_below_limits
    from pilotgen.runs.results import read_results

    return pilots_below_limits(read_results(path), limits)


def run_summary(args: argparse.Namespace, done: Run, worst: int = 10) -> dict[str, Any]:
    """What a search or a sample prints with --json: counts, files, its worst pilots, failures by reason."""
    from pilotgen.objectives import OBJECTIVES
    from pilotgen.population.region import beyond, that_way
    from pilotgen.report import findings
    from pilotgen.runs.batch import failures_by_reason
    from pilotgen.runs.results import DISTANCE, read_results

    results, progress = read_results(done.path), done.progress
    columns = results.columns
    pilots = [
        {
            "values": dict(zip(results.names, columns["inputs"][k].tolist(), strict=True)),
            "stable": bool(columns["stable"][k] == 1),
            **{key: float(columns[key][k]) for key in OBJECTIVES},
        }
        for k in findings.distinct(results, findings.worst_order(results), worst)
    ]
    if DISTANCE in columns:
        for pilot, k in zip(pilots, findings.distinct(results, findings.worst_order(results), worst), strict=True):
            away = float(columns[DISTANCE][k])
            pilot["how_rare"] = {DISTANCE: away, "share_beyond": beyond(away), "share_that_way": that_way(away)}
    report = done.path.with_name("report.html")
    return {
        "results": done.path,
        "report": report if getattr(args, "no_report", True) is False else None,
        "stopped_by": done.stopped_by,
        "done": progress.done,
        "evaluated": progress.evaluated,
        "served": progress.served,
        "failed": progress.failed,
        "unstable": progress.unstable,
        "cpu_s": progress.cpu_s,
        "worker_memory_bytes": progress.worker_memory_bytes,
        "worst": pilots,
        "failures": [
            {"stage": stage, "reason": reason, "count": count,
             "again": settings.again(args, example["values"], args.solver, stage == "uncertain")}
            for stage, reason, count, example in failures_by_reason(done.results)
        ],
    }  # fmt: skip


def progress_parts(progress: Progress, left: str) -> list[str]:
    """`smallest GM 1.82 dB, PM 34.1 deg`, `at most 0:12 left`, `generation 3/30`, `412 evaluations, 2 failed`."""
    from pilotgen.objectives import objective
    from pilotgen.progress_line import counted

    margins = ", ".join(objective(name).brief(value) for name, value in progress.smallest.items())
    served = f" ({progress.served} from the journal)" if progress.served else ""
    return [
        f"smallest {margins}" if margins else "",
        f"at most {left} left" if left else "",
        f"generation {progress.generation + 1}/{progress.generations}",
        f"{counted(progress.done, 'evaluation')}{served}, {progress.failed} failed",
    ]


def print_worst(args: argparse.Namespace, study: Study, done: Run) -> None:
    """Print the worst pilots of study.h5, how rare the worst is, the failures by reason, and where everything is."""
    from pilotgen.report import findings
    from pilotgen.runs.batch import failures_by_reason
    from pilotgen.runs.results import read_results

    results = read_results(done.path)
    for text in worst_table(results):
        print(text)
    for text in findings.rarity(study, results):
        print(text)
    progress = done.progress
    print(
        f"\n{progress.done} evaluations ({progress.served} from the journal), {progress.failed} failed, "
        f"{progress.cpu_s:.1f} s of CPU time in workers{common.memory_text(progress)}"
    )
    for stage, reason, count, example in failures_by_reason(done.results)[:5]:
        print(f"  {count} failed at {stage}, e.g. {reason}")
        draws = f" --uncertain -n {study.uncertain['draws']}" if stage == "uncertain" else ""
        print(f"    again with: {settings.again(args, example['values'], args.solver, bool(draws))}{draws}")
    print(f"results: {done.path}")
    report = done.path.with_name("report.html")
    if not args.no_report:
        print(f"report:  {report}")
    sys.stdout.flush()


def worst_table(results: Any, count: int = 10) -> list[str]:
    """The worst pilots of a study as lines of a table, in the order of the report; nearly equal pilots count as one."""
    from pilotgen.objectives import OBJECTIVES, objective
    from pilotgen.population.region import beyond, one_in
    from pilotgen.report import findings
    from pilotgen.runs.results import DISTANCE

    columns = results.columns
    order = findings.worst_order(results)
    if not len(order):
        return ["no pilot could be evaluated"]
    heads = [*results.names, *(row.heading for row in OBJECTIVES.values()), "stable"]
    robust = [objective(key) for key in results.objective_names if key not in OBJECTIVES]
    heads += [row.heading for row in robust]
    heads += ["how rare"] if DISTANCE in columns else []
    table = [heads]
    for k in findings.distinct(results, order, count):
        table.append(
            [f"{value:.4g}" for value in columns["inputs"][k]]
            + [f"{columns[row.key][k]:.{row.digits}f}" for row in OBJECTIVES.values()]
            + ["yes" if columns["stable"][k] == 1 else "NO"]
            + [f"{columns[row.key][k]:.{row.digits}f}" for row in robust]
            + ([one_in(beyond(columns[DISTANCE][k]))] if DISTANCE in columns else [])
        )
    widths = [max(len(row[j]) for row in table) for j in range(len(heads))]
    loop = results.attributes.get("loop", "")
    return [f"worst pilots{f' of {loop}' if loop else ''}"] + [
        "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in table
    ]
