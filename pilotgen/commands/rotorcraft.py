"""`pilotgen rotorcraft`: numbers, poles and Bode figure of a rotorcraft.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
from typing import Any

from pilotgen.commands import common, settings

FIGURE_NAME = "rotorcraft-bode.png"


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "rotorcraft",
        "show a rotorcraft's dynamics",
        "Print numbers and poles of a bundled rotorcraft, or of the one in a study file; with -o also draw "
        "its Bode figure.",
        "pilotgen rotorcraft iar330-puma -o results/puma",
    )
    parser.add_argument("name", metavar="NAME", help="bundled rotorcraft or a study file (.yaml)")
    settings.add_settings(
        parser,
        "what the rotorcraft of a study file has other than it says, by path, e.g. --set rotorcraft.delay_s=0.05",
    )
    common.add_output(parser, required=False, what="the Bode figure")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the report; with -o, draw the figure."""
    from pilotgen.errors import StudyError
    from pilotgen.loop.rotorcraft_report import as_data, describe, usual_loop
    from pilotgen.study.rotorcraft import load_rotorcraft

    if args.name.endswith((".yaml", ".yml")):
        args.study = args.name
        study = settings.read_changed(args, "rotorcraft")
        rotorcraft, ends = study.rotorcraft, study.loop
    elif args.settings:
        raise StudyError(f"--set changes the rotorcraft of a study file, and {args.name} is none; give STUDY.yaml")
    else:
        rotorcraft = load_rotorcraft(args.name)
        ends = usual_loop(rotorcraft)
    figure = None
    if not args.json:
        print(describe(rotorcraft, ends))
    if args.output is not None:
        from pilotgen.figures import rotorcraft_bode, style
        from pilotgen.loop.rotorcraft_model import rotorcraft_model
        from pilotgen.output import claimed

        model = rotorcraft_model(rotorcraft, ends.input, ends.output)
        with claimed(args.output, "rotorcraft", (FIGURE_NAME,), overwrite=args.overwrite) as directory:
            figure = directory / FIGURE_NAME
            style.save(rotorcraft_bode(model, rotorcraft.name, ends), figure)
    if args.json:
        common.print_json({**as_data(rotorcraft, ends), "figure": figure})
    elif figure is not None:
        print(f"Bode figure: {figure}")
    return 0
