"""`pilotgen loop`: the pilot closed with his rotorcraft in one deck.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

from pilotgen.commands import closed_loop, common
from pilotgen.files import to_json, write_text

WRITES = ("*.nc", "loop.json")


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "loop",
        "close the loop in one deck and compare its poles with the margins'",
        "Write loop.mbd, the deck of one pilot with his rotorcraft around him, which mbdae and MBDyn read as it is; "
        "linearise it and hold its eigenvalues against the closed-loop poles of the margins. Leaves the decks, loop.h5 "
        "and loop.json in DIR and prints the poles nearest to instability. A difference beyond 1e-8 ends with exit "
        "code 3.",
        "pilotgen loop docs/studies/puma-bmi.yaml -o results/loop --set stature_m=1.95",
        json_help="print the content of loop.json instead of the table",
    )
    closed_loop.add_arguments(parser)
    parser.add_argument(
        "--two-way",
        action="store_true",
        help="the pilot's reaction acts on the rotorcraft; the margins know only one way",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write, linearise, compare."""
    from pilotgen.closed_loop.poles import compare_poles, open_loop_note, summary, table_text

    with closed_loop.opened(args, "loop", WRITES, args.two_way) as opened:
        loop, directory = opened.loop, opened.directory
        table = compare_poles(opened.context, loop, directory)
        content = {"study": opened.study.name, "values": opened.values, "two_way": args.two_way, **summary(table)}
        write_text(directory / "loop.json", to_json(content))
        if args.json:
            sys.stdout.write(to_json(content))
            return 0 if table.certified else 3
        print(table_text(table, args.two_way))
        worst = table.difference.max(initial=0.0)
        state = "stable" if table.stable else "UNSTABLE"
        print(f"closed loop {state} by the deck's own eigenvalues; largest difference of a pole {worst:.1e}")
        note = open_loop_note(loop)
        if note:
            common.say(note)
        if not table.certified:
            print("NOT certified: the deck and the margins do not agree; loop.json tells where", file=sys.stderr)
        print(f"loop.mbd, the pilot's decks, loop.h5 and loop.json are in {directory}")
    return 0 if table.certified else 3
