"""`pilotgen report`: write report.html of a finished search or sample again.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pilotgen.commands import common
from pilotgen.errors import FileError, StudyError

if TYPE_CHECKING:
    from pilotgen.runs.results import StudyResults


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "report",
        "write the report of a study again",
        "Write report.html, and for multibody pilots the decks of the Pareto front, of the study.h5 in DIR. A search "
        "does "
        "this at its end; this command does it for a sample, or again after a change of the program.",
        "pilotgen report results/quick",
    )
    parser.add_argument(
        "directory",
        metavar="DIR",
        nargs="?",
        type=common.user_path,
        help="output directory of `pilotgen search` or `pilotgen sample`",
    )
    common.add_solver(parser)
    parser.add_argument(
        "--no-evaluations",
        action="store_true",
        help="evaluate no pilot: no curves, Bode and Nyquist figures or decks; needs no solver",
    )
    parser.add_argument(
        "--compare",
        nargs=2,
        metavar=("DIR1", "DIR2"),
        type=common.user_path,
        help="in place of DIR: write comparison.html to DIR1, two studies side by side, their differences in words",
    )
    parser.add_argument(
        "--with",
        dest="others",
        metavar="DIR2",
        type=common.user_path,
        action="append",
        default=[],
        help="tell on the page what `pilotgen population`, `sensitivity`, `identify` or another command left in DIR2; "
        "may be given several times",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Read study.h5 and the journal beside it, write the report."""
    from pilotgen.output import REPORT_FILES, claimed
    from pilotgen.runs.batch import RESULTS_NAME
    from pilotgen.runs.executor import pin_threads

    pin_threads()
    from pilotgen.report import read_report_section, write_report
    from pilotgen.runs.results import read_results
    from pilotgen.study.study import study_from_text

    if args.compare or args.directory is None:
        return compare(args)
    if args.no_evaluations and (args.solver != "mbdae" or args.mbdae is not None):
        raise StudyError("--solver and --mbdae do nothing with --no-evaluations; leave one out")
    path = args.directory / RESULTS_NAME
    if not path.is_file():
        raise FileError(
            f"{path} does not exist; DIR is the output directory of a finished `pilotgen search` or `pilotgen sample` "
            "(an interrupted one goes on with --resume)"
        )
    others = [read_report_section(directory) for directory in args.others]
    with claimed(args.directory, "report", REPORT_FILES, resume=True) as directory:
        results = read_results(path)
        study = study_from_text(str(results.attributes["study_text"]), f"{path}: study_text")
        common.check_solver(args, study)
        report = write_report(
            directory,
            study,
            journalled(directory, results),
            mbdae=args.mbdae,
            solver=args.solver,
            mbdyn=args.mbdyn,
            evaluations=not args.no_evaluations,
            others=others,
        )
    if args.json:
        common.print_json({"report": report})
    else:
        print(f"report: {report}")
    return 0


def compare(args: argparse.Namespace) -> int:
    """Two studies side by side."""
    from pilotgen.output import REPORT_FILES, claimed
    from pilotgen.report.compare import write_comparison

    if not args.compare:
        raise StudyError("give DIR, the output directory of a study, or --compare DIR1 DIR2")
    if args.directory is not None or args.others or args.no_evaluations or args.mbdae or args.solver != "mbdae":
        raise StudyError(
            "--compare reads two studies and evaluates nothing: DIR, --with, --no-evaluations, --mbdae and --solver do "
            "nothing with it; leave them out"
        )
    first, second = args.compare
    if not first.is_dir():
        raise FileError(
            f"{first} does not exist; --compare wants two output directories of `pilotgen search` or `sample`"
        )
    with claimed(first, "report", REPORT_FILES, resume=True) as directory:
        page = write_comparison(directory, first, second)
    if args.json:
        common.print_json({"comparison": page})
    else:
        print(f"comparison: {page}")
    return 0


def journalled(directory: Path, results: StudyResults) -> list[Mapping[str, Any]] | None:
    """Result objects of the study's evaluations from the journal, in their order; None if any is missing there."""
    from pilotgen.runs.journal import JOURNAL_NAME, Journal, evaluation_key

    if not (directory / JOURNAL_NAME).is_file():
        return None
    fingerprint = str(results.attributes["fingerprint"])
    rows: list[Mapping[str, Any]] = []
    with Journal(directory / JOURNAL_NAME) as journal:
        for inputs in results.columns["inputs"].tolist():
            record = journal.get(evaluation_key(fingerprint, dict(zip(results.names, inputs, strict=True))))
            if record is None:
                return None
            rows.append(record.result)
    return rows
