"""`pilotgen sample`: evaluate many pilots spread over the study's box.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from pilotgen.commands import common, settings

if TYPE_CHECKING:
    from pilotgen.runs.batch import Progress
    from pilotgen.runs.session import Run


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "sample",
        "evaluate many pilots of the study's box",
        "Evaluate N pilots spread over the study's search box (Sobol points or random ones) and write margins and "
        "failures to "
        "study.h5. Same journal, workers and --resume as a search; memory does not grow with N.",
        "pilotgen sample docs/studies/puma-bmi.yaml -n 4096 -o results/sample",
    )
    common.add_study(parser)
    settings.add_settings(parser, settings.MANY_PILOTS)
    common.add_output(parser)
    parser.add_argument("-n", "--number", metavar="N", type=common.positive_int, required=True, help="how many pilots")
    parser.add_argument(
        "--method", choices=("sobol", "random"), default="sobol", help="how they are spread (default: sobol)"
    )
    parser.add_argument(
        "--seed",
        metavar="S",
        type=common.seed,
        default=None,
        help="seed (default: the study's search.seed)",
    )
    common.add_workers(parser)
    common.add_fail_below(parser)
    common.add_solver(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Sample, write, print."""
    from pilotgen.runs.executor import pin_threads

    pin_threads()
    from pilotgen.commands.search import below_in_study, run_summary
    from pilotgen.output import STUDY_FILES
    from pilotgen.runs.sample_study import sample_study

    study = settings.read_changed(args, "sample")
    options = common.run_options(args, study)

    def told(progress: Progress) -> str:
        return f"{progress.done}/{progress.total} pilots, {progress.failed} failed"

    with common.long_run(args, "sample", STUDY_FILES, study, told) as (directory, show, say):
        done = sample_study(study, directory, args.number, args.method, args.seed, options, show, say)
    if args.json:
        common.print_json(run_summary(args, done))
    else:
        print_sample(done)
    if not done.any_ok:
        return 2
    if args.fail_below:
        return common.told_below(below_in_study(done.path, study.limits))
    return 0


def print_sample(done: Run) -> None:
    """Counts, the smallest objectives, and where everything is."""
    from pilotgen.objectives import objective
    from pilotgen.runs.results import read_results

    progress = done.progress
    print(
        f"{progress.done} pilots ({progress.served} from the journal), {progress.failed} failed, "
        f"{progress.unstable} with an unstable closed loop"
    )
    smallest = ", ".join(objective(name).brief(value) for name, value in progress.smallest.items())
    loop = read_results(done.path).attributes.get("loop", "")
    print(f"smallest: {smallest or 'none'}" + (f" ({loop})" if loop else ""))
    print(f"results: {done.path}")
