"""`pilotgen limit-cycles`: how swings of any size grow or die, with the lever's friction.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

from pilotgen.commands import closed_loop, common
from pilotgen.files import to_json, write_text

WRITES = ("limit_cycles.json", "growth.png", "nyquist.png", "onset.png")
MOST_HARMONICS = 21
NO_CYCLE = (
    "a lever that friction holds cuts the loop, so that no swing of it dies; give the rotorcraft with what stabilises "
    "it, or look at one motion with pilotgen simulate"
)


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "limit-cycles",
        "which swings of the lever grow and which die",
        "Balance the harmonics of one pilot's closed loop with clipped activations, the lever's stops and the study's "
        "friction: growth and frequency by amplitude, stable and unstable limit cycles. Leaves the pilot's decks, "
        "limit_cycles.json, growth.png and nyquist.png in DIR.",
        "pilotgen limit-cycles docs/studies/puma-friction.yaml -o results/cycles",
        json_help="print the content of limit_cycles.json instead of the summary",
    )
    closed_loop.add_arguments(parser)
    parser.add_argument(
        "--harmonics",
        metavar="K",
        type=_harmonics,
        default=9,
        help=f"of limit cycles (1 to {MOST_HARMONICS}, default: 9)",
    )
    parser.add_argument(
        "--verify",
        action="store_true",
        help="find the smallest kick that goes on by integrating the deck (some 20 motions)",
    )
    parser.add_argument(
        "--map",
        action="store_true",
        help="the smallest swing that grows over friction and gearing, with --verify the smallest kick too (some "
        "minutes); onset.png",
    )
    parser.add_argument(
        "--frictions",
        metavar="N",
        nargs="+",
        type=common.non_negative_float,
        default=None,
        help="breakout forces of the map [N] (default: 0 2 5 10 20 36 66)",
    )
    parser.add_argument(
        "--gearings",
        metavar="G",
        nargs="+",
        type=common.positive_float,
        default=None,
        help="gearings of the map [rad/m] (default: 0.8 to 1.6 times the study's)",
    )
    parser.add_argument("--no-figures", action="store_true", help="do not draw figures")
    parser.set_defaults(run=run)


def _harmonics(text: str) -> int:
    count = common.positive_int(text)
    if count > MOST_HARMONICS:
        raise argparse.ArgumentTypeError(f"{text} is too many; 1 to {MOST_HARMONICS} harmonics are wanted")
    return count


def run(args: argparse.Namespace) -> int:
    """Balance, verify, write, print."""
    from pilotgen.closed_loop.deck import friction_of
    from pilotgen.closed_loop.limit_cycles import as_dict, balanced, onset_map, report_text
    from pilotgen.closed_loop.swing_model import SwingModel
    from pilotgen.closed_loop.threshold import threshold
    from pilotgen.cures.friction import LEVELS_N
    from pilotgen.decks.vehicle import Friction
    from pilotgen.errors import StudyError
    from pilotgen.progress_line import ProgressLine

    if not args.map and (args.frictions or args.gearings):
        raise StudyError("--frictions and --gearings are of the map; add --map, or leave them out")
    with closed_loop.opened(args, "limit-cycles", WRITES, unstable=NO_CYCLE) as opened:
        study, context, directory, loop = opened.study, opened.context, opened.directory, opened.loop
        line = ProgressLine(total=0, quiet=args.quiet or args.json)
        try:
            friction = friction_of(loop.study)
            line.update("growth by amplitude")
            model = SwingModel(context, loop)
            found = balanced(model, friction, args.harmonics)
            kicked = grid = None
            if args.verify:
                kicked = threshold(
                    context, loop, friction, tell=lambda done, total: line.update(f"{done}/{total} motions")
                )
            if args.map:
                gearing = loop.study.inceptor.gearing_rad_per_m
                grid = onset_map(
                    context,
                    loop,
                    friction or Friction(10.0, 10.0, 0.02, 0.0, 2e-4),
                    sorted(args.frictions or LEVELS_N),
                    sorted(args.gearings or [round(gearing * k, 4) for k in (0.8, 1.0, 1.2, 1.4, 1.6)]),
                    args.verify,
                    tell=lambda done, total: line.update(f"{done}/{total} cells of the map"),
                )
        finally:
            line.finish()
        content = {"study": study.name, "values": opened.values, **as_dict(found, kicked, grid)}
        write_text(directory / "limit_cycles.json", to_json(content))
        if not args.no_figures:
            from pilotgen.figures import limit_cycles as figures
            from pilotgen.figures import style

            bare = found if friction is None else balanced(model, None, 1)
            style.save(figures.growth(found, bare), directory / "growth.png")
            style.save(figures.nyquist(found), directory / "nyquist.png")
            if grid is not None:
                style.save(figures.onset(grid), directory / "onset.png")
        if args.json:
            sys.stdout.write(to_json(content))
            return 0
        print(report_text(content))
        if args.verify and kicked is None:
            print("deck       every kick of 1 to 256 N that was tried dies, or every one goes on")
        print(f"the pilot's decks, limit_cycles.json and figures are in {directory}")
    return 0
