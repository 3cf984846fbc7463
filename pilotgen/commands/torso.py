"""`pilotgen torso`: what a vibrating seat does to one pilot's torso, beside what is published of people.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

from pilotgen.commands import common, settings
from pilotgen.files import to_json, write_text


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "torso",
        "seat vibration of one pilot beside published people",
        "Apparent mass at seat pan and back, and what of a vertical vibration of the seat reaches pelvis, shoulders "
        "and head of one pilot; published bands and models beside it. Leaves seat_vibration.json, seat_vibration.png "
        "and the decks in DIR and prints a table. Published values are of rigid seats: cockpit.seat.cushion=none.",
        "pilotgen torso docs/studies/puma-bmi.yaml -o results/torso --set cockpit.seat.cushion=none",
        json_help="print seat_vibration.json instead of the table",
    )
    common.add_study(parser)
    common.add_output(parser)
    settings.add_settings(parser)
    common.add_mbdae(parser)
    parser.add_argument("--no-figures", action="store_true", help="do not draw the figure")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Evaluate, write, print."""
    from pilotgen.errors import StudyError
    from pilotgen.runs.executor import pin_threads

    pin_threads()
    from pilotgen.context import EvaluationContext
    from pilotgen.evaluation import solve_pilot
    from pilotgen.output import claimed
    from pilotgen.virtual.seat_vibration import report, seat_vibration

    study, values = settings.read_pilot(args)
    if study.pilot.model != "multibody":
        raise StudyError(f"{args.study}: pilot.model = {study.pilot.model!r} has no torso; use a multibody pilot")
    with (
        EvaluationContext(study, mbdae=args.mbdae) as context,
        claimed(args.output, "torso", ("*",), overwrite=args.overwrite) as directory,
    ):
        found = seat_vibration(solve_pilot(context, values, keep=directory))
        write_text(directory / "seat_vibration.json", to_json(found.as_dict()))
        if args.json:
            sys.stdout.write(to_json(found.as_dict()))
        else:
            print(report(found), flush=True)
        if not args.no_figures:
            from pilotgen.figures import style
            from pilotgen.figures.seat_vibration import draw_seat_vibration

            style.save(draw_seat_vibration(found), directory / "seat_vibration.png")
        if not args.json:
            print(f"seat_vibration.json{'' if args.no_figures else ', figure'} and decks are in {directory}")
    return 0
