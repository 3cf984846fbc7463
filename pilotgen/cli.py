"""The command line: parse, call one command, turn errors into one sentence and an exit code.

Exit codes: `EXIT_CODES` below, and docs/exit_codes.md.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import atexit
import errno
import gc
import importlib
import mmap
import os
import signal
import sys
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

from pilotgen import __version__
from pilotgen.errors import NO_MEMORY, EvaluationError, IncompleteOutput, PilotgenError, without_memory
from pilotgen.study.wording import did_you_mean
from pilotgen.terminal import SafeStream, standard_streams, stop_on_signals

COMMANDS = (
    "pilot",
    "decks",
    "search",
    "sample",
    "population",
    "sensitivity",
    "cures",
    "compare",
    "compare-motion",
    "check-mbdyn",
    "export",
    "margins",
    "loop",
    "simulate",
    "limit-cycles",
    "loops",
    "rotorcraft",
    "torso",
    "calibrate",
    "identify",
    "report",
    "view",
    "table",
    "status",
    "check",
    "backup",
    "examples",
    "completion",
)

# Bytes wanted besides what a bare Python has: with 300 MB of address space in all some commands hang, with 400 none.
ADDRESS_SPACE = 340_000_000
_MAP_NORESERVE = getattr(mmap, "MAP_NORESERVE", 0x4000)
# New objects between two looks for garbage; Python's own 700 means hundreds of looks while modules are imported.
COLLECTOR_THRESHOLD = 10_000

EXIT_ERROR = 1
EXIT_FAILED = 2
EXIT_INCOMPLETE = 4
EXIT_INTERNAL = 70

EXIT_CODES: Mapping[int, str] = {  # the same table stands in docs/exit_codes.md
    0: "done as asked",
    1: "wrong command line or input, an unusable file or directory, more failures than --max-failures",
    2: "the pilot, or every pilot of the study, could not be evaluated",
    3: "`compare`, `compare-motion` or `loop` found a difference, `check-mbdyn` a deck that MBDyn would not start",
    4: "done, but something that was promised could not be left (the message says what)",
    5: "`--fail-below`: a closed loop is unstable or has a margin below the study's limits",
    70: "an error inside pilotgen",
    129: "ended by SIGHUP (the terminal went away)",
    130: "interrupted (Ctrl-C)",
    143: "ended by SIGTERM",
}


class _Parser(argparse.ArgumentParser):
    """argparse, with exit code 1 for a wrong command line and a pointer to the help."""

    def error(self, message: str) -> NoReturn:
        self._refuse(self.prog, message)

    def _refuse(self, prog: str, message: str) -> NoReturn:
        print(f"{prog}: error: {message}\nTry '{prog} --help'.", file=sys.stderr)
        raise SystemExit(EXIT_ERROR)

    def _print_message(self, message: str, file: Any = None) -> None:
        """Help, with whatever colours argparse gives it."""
        stream = file if file is not None else sys.stderr
        if isinstance(stream, SafeStream):
            stream.raw_write(message)
        else:
            stream.write(message)

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As argparse, but a flag that is not known points to the help of the command it was given to."""
        found, unknown = self.parse_known_args(args, namespace)
        if unknown:
            prog = f"{self.prog} {found.command}" if getattr(found, "command", None) else self.prog
            self._refuse(prog, f"unknown arguments: {' '.join(unknown)}")
        return found

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            known = [str(choice) for choice in action.choices]
            guess = did_you_mean(str(value), known)
            raise argparse.ArgumentError(action, f"{value!r} is not known; {guess}choose one of: {', '.join(known)}")


def build_parser() -> argparse.ArgumentParser:
    """The parser of all commands; each command's module adds its own arguments and examples."""
    parser = _Parser(
        prog="pilotgen",
        description="Which pilot makes this helicopter bounce? Musculoskeletal pilots from biometrics, linearised, "
        "closed with the helicopter's heave and coning dynamics, and searched for the smallest stability margins.",
        epilog="example:\n  pilotgen examples quick  # copies quick.yaml here\n"
        "  pilotgen search quick.yaml -o results/quick",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("-V", "--version", action="version", version=f"pilotgen {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name in COMMANDS:
        importlib.import_module(f"pilotgen.commands.{name.replace('-', '_')}").add_parser(commands)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    _hold_the_collector_back()
    with standard_streams() as (out, err):
        code = _run(arguments, out)
        out.flush()  # a full disk behind standard output is found out here, not after the exit code
        if out.error is not None and out.error.errno != errno.EPIPE:  # else its reader went away, as `head` does
            print(f"pilotgen: error: standard output: {out.error.strerror or out.error}", file=err)
            code = code or EXIT_ERROR
    return code


def _hold_the_collector_back() -> None:
    """Have Python look for garbage less often, and not at its end, when hundreds of modules are taken apart."""
    gc.set_threshold(COLLECTOR_THRESHOLD, *gc.get_threshold()[1:])
    atexit.unregister(gc.freeze)  # once, however often this is called
    atexit.register(gc.freeze)


def _run(arguments: Sequence[str] | None, out: SafeStream) -> int:
    try:
        stop_on_signals()
        parser = build_parser()
        if not (sys.argv[1:] if arguments is None else arguments):
            parser.print_help()
            return 0
        args = parser.parse_args(arguments)
        args.parser = parser
        out.silent = args.quiet and not args.json and not getattr(args, "long_run", False)
        _look_for_memory()
        return int(args.run(args))
    except EvaluationError as error:
        print(f"pilotgen: failed: {error}", file=sys.stderr)
        return EXIT_FAILED
    except IncompleteOutput as error:
        print(f"pilotgen: incomplete: {error}", file=sys.stderr)
        return EXIT_INCOMPLETE
    except PilotgenError as error:
        print(f"pilotgen: error: {error}", file=sys.stderr)
        return EXIT_ERROR
    except KeyboardInterrupt as interruption:
        return _tell_interruption(interruption)
    except OSError as error:
        where = f"{error.filename or 'a file'}: "
        print(f"pilotgen: error: {where}{error.strerror or error}", file=sys.stderr)
        return EXIT_ERROR
    except Exception as error:  # the edge of the program: an error of ours, told without a wall of text
        if without_memory(error):
            print(f"pilotgen: error: {NO_MEMORY}", file=sys.stderr)
            return EXIT_ERROR
        if os.environ.get("PILOTGEN_DEBUG"):
            raise
        print(
            f"pilotgen: internal error: {type(error).__name__}: {error}\n"
            "This is a fault of pilotgen, not of the input. Run again with PILOTGEN_DEBUG=1 for the details and "
            "report it.",
            file=sys.stderr,
        )
        return EXIT_INTERNAL


def _look_for_memory() -> None:
    """Raise MemoryError before numpy is imported if there is no room for it: OpenBLAS tries for ever to get its own."""
    try:
        mmap.mmap(-1, ADDRESS_SPACE, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | _MAP_NORESERVE).close()
    except OSError:
        raise MemoryError from None


def _tell_interruption(interruption: KeyboardInterrupt) -> int:
    """Say what ended the run and what is kept of it; returns 128 + the signal's number."""
    number, kept = getattr(interruption, "signal", signal.SIGINT), getattr(interruption, "kept", "")
    how = "interrupted" if number == signal.SIGINT else f"ended by {signal.Signals(number).name}"
    print(f"\npilotgen: {how}" + (f"; {kept}" if kept else ""), file=sys.stderr, flush=True)
    return 128 + int(number)


if __name__ == "__main__":
    sys.exit(main())
