"""What several commands share: arguments, the output directory, long runs.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pilotgen.errors import FileError, StudyError
from pilotgen.study.fields import MAYO
from pilotgen.study.study import Study

if TYPE_CHECKING:
    from pilotgen.evaluation import FailedEvaluation
    from pilotgen.runs.batch import OnProgress, Progress
    from pilotgen.runs.monitor import Monitor
    from pilotgen.runs.options import RunOptions


def add_command(
    commands: Any,
    name: str,
    summary: str,
    description: str,
    example: str,
    json_help: str = "print one JSON object instead of text",
) -> argparse.ArgumentParser:
    """Add a command with an example in its help, and what all commands have."""
    from pilotgen import __version__

    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=summary,
        description=description,
        epilog=f"example:\n{with_its_study(example)}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("-V", "--version", action="version", version=f"pilotgen {__version__}")
    parser.add_argument("--json", action="store_true", help=json_help)
    parser.add_argument(
        "--quiet",
        action="store_true",
        help="no progress line; other commands than runs over many pilots print no text but errors and notes",
    )
    return parser


def with_its_study(example: str) -> str:
    """An example's lines; one that names a bundled study is told where to get it."""
    found = re.search(r"docs/studies/([a-z0-9-]+)\.yaml", example)
    if not found:
        return f"  {example}"
    name = found[1]
    return f"  pilotgen examples {name}  # copies {name}.yaml here\n  {example.replace(found[0], f'{name}.yaml')}"


def add_study(parser: argparse.ArgumentParser) -> None:
    """Add the study file argument."""
    parser.add_argument("study", metavar="STUDY.yaml", type=Path, help="study file (docs/io_formats/study.md)")


def add_output(parser: argparse.ArgumentParser, required: bool = True, what: str = "the results") -> None:
    """Add -o DIR and --overwrite."""
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=user_path,
        required=required,
        default=None,
        help=f"directory for {what}; made if missing, refused if it holds anything that this command did not write",
    )
    parser.add_argument(
        "--overwrite", action="store_true", help="move an existing DIR aside, to DIR.old-1, .old-2, ..., and start anew"
    )


def add_solver(parser: argparse.ArgumentParser) -> None:
    """Add the choice of solver and its path."""
    parser.add_argument(
        "--solver", choices=("mbdae", "mbdyn"), default="mbdae", help="who linearises the pilot's deck (default: mbdae)"
    )
    add_mbdae(parser)
    parser.add_argument(
        "--mbdyn", metavar="PATH", default=None, help="the mbdyn program for --solver mbdyn; default: found on PATH"
    )


def check_solver(args: argparse.Namespace, study: Study) -> None:
    """Refuse options of `add_solver` that would do nothing, together or for this study."""
    if args.mbdyn is not None and args.solver != "mbdyn":
        raise StudyError("--mbdyn is for --solver mbdyn; add that, or leave --mbdyn out")
    if study.pilot.model == MAYO and (args.solver != "mbdae" or args.mbdae is not None):
        raise StudyError("--solver and --mbdae do nothing for pilot.model = 'mayo', which has no deck; leave them out")


def add_mbdae(parser: argparse.ArgumentParser) -> None:
    """Add the path of mbdae."""
    parser.add_argument(
        "--mbdae",
        metavar="PATH",
        default=None,
        help="the mbdae program; default: PILOTGEN_MBDAE, the one installed, or PATH",
    )


def add_workers(parser: argparse.ArgumentParser, title: str = "") -> None:
    """Add workers, resume, failures and executor options of long runs, under a title of their own if one is given."""
    parser.set_defaults(long_run=True)
    group = parser.add_argument_group(title) if title else parser
    group.add_argument(
        "--workers", metavar="N", type=positive_int, default=None, help="processes (default: one per core)"
    )
    group.add_argument(
        "--resume",
        action="store_true",
        help="go on in a directory that already holds this study; finished evaluations are kept",
    )
    group.add_argument(
        "--retry-failed", action="store_true", help="with --resume, evaluate again the pilots that failed"
    )
    group.add_argument(
        "--max-failures",
        metavar="N",
        type=non_negative_int,
        default=None,
        help="stop when more than N pilots have failed",
    )
    group.add_argument(
        "--time-limit",
        metavar="S",
        type=positive_float,
        default=30.0,
        help="wall time limit of one solver call in s (default: 30)",
    )
    group.add_argument(
        "--executor",
        choices=("processes", "dask"),
        default="processes",
        help="where workers run (default: processes of this machine)",
    )
    group.add_argument(
        "--scheduler", metavar="ADDRESS", default=None, help="address of a running dask scheduler, e.g. tcp://host:8786"
    )
    group.add_argument(
        "--log",
        metavar="FILE",
        type=user_path,
        default=None,
        help="append what happens to FILE, one JSON object a line (docs/long_runs.md)",
    )


def user_path(text: str) -> Path:
    """Type of an argument: a path, made absolute here and nowhere else, for solvers work in other directories."""
    return Path(text).absolute()


def format_of(path: Path | None, formats: Sequence[str]) -> str | None:
    """The format that a file's name ends in; None if it does not say, or there is none."""
    ending = path.suffix.removeprefix(".").lower() if path is not None else ""
    return ending if ending in formats else None


def file_of_pilot(directory: Path) -> Path:
    """pilot_model.h5 of an output directory of `pilotgen pilot`. Raises FileError if it is none."""
    path = directory / "pilot_model.h5"
    if not path.is_file():
        raise FileError(f"{path} does not exist; PILOTDIR is the output directory of `pilotgen pilot`")
    return path


def positive_int(text: str) -> int:
    """Type of an argument: a whole number greater than zero."""
    value = non_negative_int(text)
    if value == 0:
        raise argparse.ArgumentTypeError("0 is too few; a whole number greater than zero is wanted")
    return value


def non_negative_int(text: str) -> int:
    """Type of an argument: a whole number, zero or more."""
    try:
        value = int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number") from None
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} is negative; zero or more is wanted")
    return value


def seed(text: str) -> int:
    """Type of an argument: a seed, 0 to 2^63 - 1."""
    value = non_negative_int(text)
    if value > 2**63 - 1:
        raise argparse.ArgumentTypeError(f"{text} is too large for a seed; at most 2^63 - 1 is wanted")
    return value


def any_float(text: str) -> float:
    """Type of an argument: a finite number of either sign."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text} is not finite; a finite number is wanted")
    return value


def non_negative_float(text: str) -> float:
    """Type of an argument: a finite number, zero or more."""
    value = any_float(text)
    if value < 0.0:
        raise argparse.ArgumentTypeError(f"{text} is negative; zero or more is wanted")
    return value


def positive_float(text: str) -> float:
    """Type of an argument: a finite number greater than zero."""
    value = any_float(text)
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f"{text} is too small; a number greater than zero is wanted")
    return value


def run_options(args: argparse.Namespace, study: Study) -> RunOptions:
    """The options of a long run, as `add_workers` and `add_solver` declare them."""
    from pilotgen.runs.options import RunOptions

    check_solver(args, study)
    return RunOptions(
        args.workers,
        args.resume,
        args.retry_failed,
        args.max_failures,
        args.time_limit,
        args.executor,
        args.scheduler,
        args.solver,
        args.mbdae,
        args.mbdyn,
    )


@contextmanager
def monitored(args: argparse.Namespace, directory: Path, kind: str, study: str) -> Iterator[Monitor]:
    """Heartbeat and --log of a long run, begun and ended whatever happens."""
    from pilotgen import __version__
    from pilotgen.runs.monitor import Monitor

    monitor = Monitor(directory, args.log, say)
    monitor.event("start", command=kind, study=study, directory=str(directory), pilotgen_version=__version__)
    try:
        yield monitor
    except BaseException as error:
        with suppress(FileError):  # what ended the run is what is told
            monitor.end(f"{type(error).__name__}: {error}")
        raise
    monitor.end("done")


@contextmanager
def long_run(
    args: argparse.Namespace, kind: str, files: Sequence[str], study: Study, told: Callable[[Progress], str]
) -> Iterator[tuple[Path, OnProgress, Callable[[str], None]]]:
    """Output directory, progress line, heartbeat and log of a run.

    Parameters
    ----------
    args : Namespace
        Of `add_output` and `add_workers`.
    kind : str
        The command.
    files : sequence of str
        What it may find in its directory.
    study : Study
        Named in the log.
    told : callable
        How far a run is, in words.

    Yields
    ------
    tuple
        The directory, claimed; who is told of progress; who is told sentences.
    """
    from pilotgen.output import claimed

    with (
        claimed(args.output, kind, files, args.resume, args.overwrite) as directory,
        followed(args, directory, kind, study, told) as (show, say),
    ):
        yield directory, show, say


@contextmanager
def followed(
    args: argparse.Namespace, directory: Path, kind: str, study: Study, told: Callable[[Progress], str]
) -> Iterator[tuple[OnProgress, Callable[[str], None]]]:
    """As `long_run`, in a directory that is claimed already: who is told of progress; who is told sentences."""
    from pilotgen.progress_line import ProgressLine

    line = ProgressLine(0, quiet=args.quiet)
    with monitored(args, directory, kind, study.name) as monitor:

        def show(progress: Progress, milestone: bool) -> None:
            monitor(progress, milestone)
            if line.due(milestone):
                if not progress.total:  # nobody knows yet how many there will be
                    line.update((told(progress),), milestone)
                    return
                left = line.time_left(progress.done, progress.total)
                share = progress.done / progress.total
                line.update((told(progress), f"{left} left" if left else ""), milestone, share)

        try:
            yield show, line.before(monitor.say)
        finally:
            line.finish()


EXIT_BELOW = 5


def add_fail_below(parser: argparse.ArgumentParser) -> None:
    """Add --fail-below."""
    parser.add_argument(
        "--fail-below",
        action="store_true",
        help=f"end with exit code {EXIT_BELOW} if a closed loop is unstable or has a margin below the study's limits",
    )


def told_below(lacks: Sequence[str]) -> int:
    """Say what is below the study's limits on standard error; returns the exit code."""
    for sentence in lacks:
        print(f"pilotgen: below limits: {sentence}", file=sys.stderr)
    return EXIT_BELOW if lacks else 0


def memory_text(progress: Progress) -> str:
    """`, 93 MB for the largest`, or nothing."""
    size = progress.worker_memory_bytes
    return f", {size / 1e6:.0f} MB for the largest" if size else ""


def print_json(data: Any) -> None:
    """Print one JSON object; what is infinite or no number becomes null."""
    print(json.dumps(plain(data), indent=2, allow_nan=False))


def plain(data: Any) -> Any:
    """As JSON takes it: dataclasses, arrays, paths and complex numbers ([real, imaginary]) included."""
    if is_dataclass(data) and not isinstance(data, type):
        return {field.name: plain(getattr(data, field.name)) for field in fields(data)}
    if isinstance(data, Mapping):
        return {str(key): plain(value) for key, value in data.items()}
    if hasattr(data, "tolist"):
        return plain(data.tolist())
    if isinstance(data, list | tuple | set | frozenset):
        return [plain(value) for value in data]
    if isinstance(data, complex):
        return [plain(data.real), plain(data.imag)]
    if isinstance(data, float) and not math.isfinite(data):
        return None
    return str(data) if isinstance(data, Path) else data


def say(sentence: str) -> None:
    """Tell on standard error what a user should know, though it is no mistake."""
    print(f"pilotgen: note: {sentence}", file=sys.stderr, flush=True)


def failure_text(failure: FailedEvaluation, directory: Path) -> str:
    """What a one-pilot command says when its pilot cannot be evaluated."""
    text = f"pilotgen: failed: {failure.stage}: {failure.reason}"
    return text + f"\n  decks so far are in {directory}" if any(directory.glob("*.mbd")) else text
