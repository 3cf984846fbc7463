"""`pilotgen rotorcraft`: poles, transfer function and Bode figure of a rotorcraft.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pilotgen.commands import common


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "rotorcraft",
        "show a rotorcraft's heave and coning dynamics",
        "Print poles and transfer function of a bundled rotorcraft, or of the one in a study file, and draw its Bode "
        "figure.",
        "pilotgen rotorcraft iar330-puma -o results/puma",
    )
    parser.add_argument("name", metavar="NAME", help="bundled rotorcraft or a study file (.yaml)")
    parser.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        type=common.user_path,
        default=Path("."),
        help="directory for the figure (default: here)",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the report, write the figure."""
    from pilotgen.loop.heave_model import rotorcraft_report
    from pilotgen.study.rotorcraft import load_rotorcraft
    from pilotgen.study.study import read_study

    rotorcraft = (
        read_study(args.name).rotorcraft if args.name.endswith((".yaml", ".yml")) else load_rotorcraft(args.name)
    )
    print(rotorcraft_report(rotorcraft, common.prepare_directory(args.output)))
    return 0
