"""`pilotgen compare`: two matrices files, ours or MBDyn's, difference by difference.

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
        "compare",
        "compare two matrices files",
        "Compare two linearised models: natural frequencies and damping first, then g_ydot and g_y entry by entry "
        "with the "
        "names of rows and columns. A and B are matrices files of mbdae (.h5) or eigenanalysis output of MBDyn (.nc, "
        ".m). "
        "Exit code 0: equal within the tolerance, 3: different.",
        "pilotgen compare results/pilot/matrices.h5 mbdyn_out.nc --tolerance 1e-9",
    )
    parser.add_argument("a", metavar="A", type=Path)
    parser.add_argument("b", metavar="B", type=Path)
    parser.add_argument(
        "--tolerance",
        metavar="T",
        type=common.positive_float,
        default=1e-9,
        help="largest difference relative to the largest entry (default: 1e-9)",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Compare, print."""
    from pilotgen.linear.compare import compare_files, report

    found = compare_files(args.a, args.b, args.tolerance)
    if args.json:
        common.print_json({"agree": found.agree, **common.plain(found)})
    else:
        print(report(found))
    return 0 if found.agree else EXIT_DIFFERENT
