"""`pilotgen decks`: write the decks of one pilot.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

from pilotgen.commands import common, settings


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "decks",
        "write the decks of one pilot",
        "Write the decks of one pilot of a study: posture.mbd (static, ergonomic springs), trim.mbd (muscles at "
        "rest) and "
        "pilot.mbd (in equilibrium, with activations and reflexes). They run unmodified on MBDyn with its muscle "
        "module.",
        "pilotgen decks docs/studies/puma-bmi.yaml -o decks --set stature_m=1.62",
    )
    common.add_study(parser)
    common.add_output(parser)
    settings.add_settings(parser)
    common.add_mbdae(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Solve for posture and activations, keep the decks."""
    from pilotgen.errors import StudyError
    from pilotgen.runs.executor import pin_threads

    pin_threads()
    from pilotgen.context import EvaluationContext
    from pilotgen.evaluation import DECK_NAMES, write_decks
    from pilotgen.output import claimed

    study, values = settings.read_pilot(args)
    if study.pilot.model != "multibody":
        raise StudyError(f"{args.study}: pilot.model = {study.pilot.model!r} has no decks; only multibody pilots have")
    with (
        EvaluationContext(study, mbdae=args.mbdae) as context,
        claimed(args.output, "decks", DECK_NAMES, overwrite=args.overwrite) as directory,
    ):
        failure = write_decks(context, values, directory)
        if failure is not None:
            print(common.failure_text(failure, directory), file=sys.stderr)
            return 2
        decks = [directory / name for name in DECK_NAMES]
        if args.json:
            common.print_json({"decks": decks})
        else:
            print("\n".join(map(str, decks)))
    return 0
