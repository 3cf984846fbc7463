"""`pilotgen check-mbdyn`: whether the real MBDyn gets through a deck's initial assembly and derivatives phase.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pilotgen.commands import common

EXIT_WOULD_FAIL = 3


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "check-mbdyn",
        "tell whether MBDyn gets a deck started",
        "Tell, without MBDyn, whether its initial assembly and its derivatives phase converge on each deck. Exit code "
        "0: they do on all, 3: MBDyn would end in one of them.",
        "pilotgen check-mbdyn results/pilot/posture.mbd results/pilot/pilot.mbd",
    )
    parser.add_argument("decks", metavar="DECK", type=Path, nargs="+")
    common.add_mbdae(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Predict, print."""
    from pilotgen.solver.client import SolverClient
    from pilotgen.solver.mbdyn_check import check_mbdyn

    code, found = 0, []
    with SolverClient(args.mbdae) as client:
        for deck in args.decks:
            prediction = check_mbdyn(deck, client)
            found.append({"deck": deck, "runs": prediction.runs, **common.plain(prediction)})
            code = code if prediction.runs else EXIT_WOULD_FAIL
            if args.json:
                continue
            print(f"{deck}: {'runs' if prediction.runs else 'FAILS'} on MBDyn")
            print(f"  initial assembly: {prediction.assembly}")
            print(f"  derivatives: {prediction.derivatives}")
    if args.json:
        common.print_json({"decks": found})
    return code
