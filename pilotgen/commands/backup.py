"""`pilotgen backup`: a copy of a study that is whole, also while the study runs.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
from typing import Any

from pilotgen.commands import common


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "backup",
        "copy a study, also while it runs",
        "Copy the study in DIR to a new directory, journal and all, also while a search or sample writes to it (a copy "
        "by `cp` of a running journal lacks what was recorded last). The study is not disturbed; the copy goes on "
        "with --resume.",
        "pilotgen backup results/quick -o saved/quick",
    )
    parser.add_argument(
        "directory", metavar="DIR", type=common.user_path, help="output directory of a search, sample, ..."
    )
    parser.add_argument(
        "-o", "--output", metavar="COPY", type=common.user_path, required=True, help="new or empty directory"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Copy, print."""
    from pilotgen.progress_line import counted
    from pilotgen.runs.backup import back_up

    count = back_up(args.directory, args.output)
    if args.json:
        common.print_json({"copy": args.output, "evaluations": count})
    else:
        print(f"{args.output}: {counted(count, 'recorded evaluation')}")
    return 0
