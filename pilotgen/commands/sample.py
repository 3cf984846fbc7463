"""`pilotgen sample`: evaluate many pilots spread over the study's box.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from typing import Any

from pilotgen.commands import common

CHUNK = 1000  # pilots in memory at a time


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
    common.add_output(parser)
    parser.add_argument("-n", "--number", metavar="N", type=common.positive_int, required=True, help="how many pilots")
    parser.add_argument(
        "--method", choices=("sobol", "random"), default="sobol", help="how they are spread (default: sobol)"
    )
    parser.add_argument(
        "--seed",
        metavar="S",
        type=common.non_negative_int,
        default=None,
        help="seed (default: the study's search.seed)",
    )
    common.add_workers(parser)
    common.add_solver(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Sample, write, print."""
    from pilotgen.runs.executor import pin_threads, stop_on_sigterm

    pin_threads()
    stop_on_sigterm()
    import numpy as np

    from pilotgen.commands.search import attributes_of, make_batch, make_workers, open_journal
    from pilotgen.objectives import ranked_objectives
    from pilotgen.progress_line import ProgressLine
    from pilotgen.runs.batch import RESULTS_NAME, locked_directory
    from pilotgen.runs.fingerprint import fingerprint
    from pilotgen.runs.results import ResultsWriter, Row, columns_of
    from pilotgen.search import Problem
    from pilotgen.study.study import read_study

    study = read_study(args.study)
    seed = study.search.seed if args.seed is None else args.seed
    print_hash = fingerprint(study, args.mbdae, args.solver)
    problem = Problem.from_settings(study.search)
    line = ProgressLine(args.number, quiet=args.quiet)
    smallest = dict.fromkeys(problem.objectives, math.inf)
    unstable = 0
    with locked_directory(args.output, args.resume) as directory:
        workers = make_workers(args, min(args.number, CHUNK))
        try:
            with open_journal(directory, study) as journal:
                batch = make_batch(args, study, journal, workers, print_hash)
                batch.warm_up()

                def show(*_: object, milestone: bool = False) -> None:
                    if line.due(milestone):
                        progress = batch.progress
                        left = line.time_left(progress.done)
                        text = f"{progress.done}/{args.number} pilots, {progress.failed} failed"
                        line.update(text + (f" | {left} left" if left else ""), milestone)

                batch.on_result = show
                attributes = attributes_of(study, "sample", print_hash, seed, "sample complete", args)
                with ResultsWriter(
                    directory / RESULTS_NAME, attributes, problem.names, problem.xl, problem.xu, problem.objectives
                ) as writer:
                    number = 0
                    for X in points(args.method, args.number, problem, seed):
                        results = batch.evaluate([problem.values(x) for x in X])
                        rows = [
                            Row(0, number + k, problem.values(x), r)
                            for k, (x, r) in enumerate(zip(X, results, strict=True))
                        ]
                        F = np.full((len(X), problem.n_obj), np.nan)
                        for k, result in enumerate(results):
                            if result["status"] == "ok":
                                unstable += not result["loop"]["stable"]
                                F[k] = ranked_objectives(result, problem.objectives)
                                smallest = {
                                    name: min(smallest[name], v)
                                    for name, v in zip(problem.objectives, F[k], strict=True)
                                }
                        writer.append(columns_of(rows, problem.names, F, None))
                        number += len(X)
                        show(milestone=True)
        finally:
            workers.close()
    line.finish()
    progress = batch.progress
    print(
        f"{progress.done} pilots ({progress.served} from the journal), {progress.failed} failed, "
        f"{unstable} with an unstable closed loop"
    )
    print("smallest: " + ", ".join(f"{name} {value:.4g}" for name, value in smallest.items()))
    print(f"results: {directory / RESULTS_NAME}")
    return 0 if progress.failed < progress.done else 2


def points(method: str, number: int, problem: Any, seed: int) -> Iterator[Any]:
    """Points of the box in chunks, each an array of shape (k, n_var); point i does not depend on `number`."""
    from pilotgen.search import sampling

    spread = sampling.sobol_points if method == "sobol" else sampling.random_points
    for first in range(0, number, CHUNK):
        yield spread(first, min(CHUNK, number - first), problem.xl, problem.xu, seed)
