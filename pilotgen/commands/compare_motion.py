"""`pilotgen compare-motion`: a time history of MBDyn and one of ours, channel by channel.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pilotgen.commands import common

EXIT_DIFFERENT = 3


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "compare-motion",
        "compare time histories",
        "Compare a time history that MBDyn wrote (.mov, .jnt, .ine or NetCDF) with one of mbdae, row by row: integrate "
        "with `mbdae DECK --integrate --integrator ms`, MBDyn's own method. The deck tells which label is which. Exit "
        "code 0: equal within the tolerance, 3: different.",
        "pilotgen compare-motion pilot.mbd pilot.motion.h5 mbdyn_out.mov --tolerance 1e-6",
    )
    parser.add_argument("deck", metavar="DECK", type=Path)
    parser.add_argument("ours", metavar="OURS.motion.h5", type=Path)
    parser.add_argument("theirs", metavar="MBDYN", type=Path, nargs="+", help=".mov, .jnt, .ine or .nc")
    parser.add_argument(
        "--tolerance",
        metavar="T",
        type=common.positive_float,
        default=1e-6,
        help="largest difference relative to the largest value of its kind (default: 1e-6)",
    )
    common.add_mbdae(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Compare, print."""
    from pilotgen.linear.compare_motion import compare_motion, report
    from pilotgen.solver.client import SolverClient

    code, found = 0, []
    with SolverClient(args.mbdae) as client:
        for theirs in args.theirs:
            comparison = compare_motion(args.deck, args.ours, theirs, client, args.tolerance)
            found.append({"agree": comparison.agree, **common.plain(comparison)})
            if not args.json:
                print(report(comparison))
            code = code if comparison.agree else EXIT_DIFFERENT
    if args.json:
        common.print_json({"comparisons": found})
    return code
