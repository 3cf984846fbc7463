"""`pilotgen identify`: virtual tests of one pilot beside the direct result.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
from typing import Any

from pilotgen.commands import common, settings
from pilotgen.files import to_json, write_text


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "identify",
        "confirm the feedthrough by moving the seat in time",
        "Move the seat of one pilot in a time integration of his deck, by sines and by band-limited random motion, "
        "and compare the feedthrough found with the direct result. Leaves decks, motion files, results.json, "
        "results.h5 and identification.png in DIR and prints a table with the time that each method took.",
        "pilotgen identify docs/studies/puma-bmi.yaml -o results/identified --amplitude 0.05 1 3 --activation-check",
    )
    common.add_study(parser)
    common.add_output(parser)
    settings.add_settings(parser)
    parser.add_argument(
        "--method",
        dest="methods",
        action="append",
        choices=("direct", "harmonic", "random", "all"),
        default=None,
        help="may be repeated (default: all); the direct result is always made",
    )
    parser.add_argument(
        "--amplitude",
        dest="amplitudes",
        metavar="A",
        nargs="+",
        type=common.positive_float,
        default=None,
        help="amplitude of the seat's acceleration [m/s^2], one or several (default: 0.05); random motion has the same "
        "power as a sine of that amplitude",
    )
    parser.add_argument(
        "--frequencies",
        metavar="F",
        nargs="+",
        type=_frequencies,
        default=None,
        help="frequencies of the sines [Hz], 0.05 to 50, separated by commas or spaces (default: 1,2,3,4,5,6,7,8)",
    )
    parser.add_argument(
        "--duration",
        metavar="T",
        type=common.positive_float,
        default=None,
        help="longest sine test (default: 64) and evaluated time of the random test (default: 32) [s]",
    )
    parser.add_argument(
        "--activation-check",
        action="store_true",
        help="do every test once more with activations clipped to [0, 1], which has no linearisation",
    )
    parser.add_argument("--seed", metavar="N", type=common.seed, default=1, help="of the random phases (default: 1)")
    parser.add_argument(
        "--integrator",
        choices=("ida", "ms"),
        default="ida",
        help="ida: variable step; ms: MBDyn's method at the deck's fixed step (default: ida)",
    )
    common.add_mbdae(parser)
    parser.add_argument("--no-figures", action="store_true", help="do not draw the figure")
    parser.set_defaults(run=run)


def _frequencies(text: str) -> list[float]:
    values = [common.positive_float(part) for part in text.split(",") if part.strip()]
    for value in values:
        if not 0.05 <= value <= 50.0:
            raise argparse.ArgumentTypeError(f"{value:g} Hz is outside 0.05 to 50 Hz")
    return values


def run(args: argparse.Namespace) -> int:
    """Simulate, compare, write."""
    from pilotgen.errors import StudyError
    from pilotgen.runs.executor import pin_threads

    pin_threads()
    from pilotgen.context import EvaluationContext
    from pilotgen.output import claimed
    from pilotgen.progress_line import ProgressLine
    from pilotgen.virtual.identify import (
        DEFAULT_FREQUENCIES_HZ,
        METHODS,
        SMALL_AMPLITUDE_M_S2,
        identify,
        report,
        write_identification,
    )

    study, values = settings.read_pilot(args)
    if study.pilot.model != "multibody":
        raise StudyError(
            f"{args.study}: pilot.model = {study.pilot.model!r} has no body to simulate; use a multibody pilot"
        )
    if not study.loop.usual:
        raise StudyError(
            f"{args.study}: loop = {study.loop.words}: identification is of heave by the collective, the loop that "
            "people were measured in; leave loop out"
        )
    chosen = set(args.methods or ("all",))
    methods = METHODS if "all" in chosen else tuple(name for name in METHODS if name in chosen)
    listed = sorted({f for part in args.frequencies or [] for f in part})
    frequencies = tuple(listed) or DEFAULT_FREQUENCIES_HZ
    amplitudes = tuple(dict.fromkeys(args.amplitudes or (SMALL_AMPLITUDE_M_S2,)))
    line = ProgressLine(total=0, quiet=args.quiet)

    def progress(text: str, done: int, total: int) -> None:
        left = line.time_left(done, total)
        line.update((f"{done}/{total}  {text}", f"{left} left" if left else ""), share=done / max(1, total))

    with (
        EvaluationContext(study, mbdae=args.mbdae) as context,
        claimed(args.output, "identify", ("*",), overwrite=args.overwrite) as directory,
    ):
        try:
            found = identify(
                context,
                values,
                methods,
                amplitudes,
                frequencies,
                duration_s=args.duration,
                activation_check=args.activation_check,
                seed=args.seed,
                integrator=args.integrator,
                keep=directory,
                progress=progress,
            )
        finally:
            line.finish()
        write_text(directory / "results.json", to_json(found.as_dict()))
        write_identification(found, directory / "results.h5")
        if args.json:
            common.print_json(found.as_dict())
        else:
            print(report(found), flush=True)
        if not args.no_figures:
            from pilotgen.figures import style
            from pilotgen.figures.identification import identification

            style.save(identification(found), directory / "identification.png")
        if not args.json:
            print(f"decks, motions, results.json, results.h5 and figures are in {directory}")
    return 0
