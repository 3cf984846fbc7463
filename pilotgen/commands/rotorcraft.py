"""`pilotgen rotorcraft`: poles, transfer function and Bode figure of a rotorcraft.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
from typing import Any

from pilotgen.commands import common

FIGURE_NAME = "rotorcraft-bode.png"


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "rotorcraft",
        "show a rotorcraft's heave and coning dynamics",
        "Print poles and transfer function of a bundled rotorcraft, or of the one in a study file; with -o also draw "
        "its Bode figure.",
        "pilotgen rotorcraft iar330-puma -o results/puma",
    )
    parser.add_argument("name", metavar="NAME", help="bundled rotorcraft or a study file (.yaml)")
    common.add_output(parser, required=False, what="the Bode figure")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the report; with -o, draw the figure."""
    from pilotgen.loop.heave_model import HeaveModel, rotorcraft_report
    from pilotgen.study.rotorcraft import HEAVE_NUMBERS, load_rotorcraft
    from pilotgen.study.study import read_study

    rotorcraft = (
        read_study(args.name).rotorcraft if args.name.endswith((".yaml", ".yml")) else load_rotorcraft(args.name)
    )
    figure = None
    if not args.json:
        print(rotorcraft_report(rotorcraft))
    if args.output is not None:
        from pilotgen.figures import rotorcraft_bode, style
        from pilotgen.output import claimed

        with claimed(args.output, "rotorcraft", (FIGURE_NAME,), overwrite=args.overwrite) as directory:
            figure = directory / FIGURE_NAME
            style.save(rotorcraft_bode(HeaveModel(rotorcraft)), figure)
    if args.json:
        model = HeaveModel(rotorcraft)
        numerator, denominator = model.transfer_function
        numbers = {key: getattr(rotorcraft, key) for key in HEAVE_NUMBERS}
        common.print_json(
            {
                "name": rotorcraft.name,
                "source": rotorcraft.source,
                **numbers,
                "poles_rad_s": model.poles,
                "numerator": numerator,
                "denominator": denominator,
                "figure": figure,
            }
        )
    elif figure is not None:
        print(f"Bode figure: {figure}")
    return 0
