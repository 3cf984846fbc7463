"""What the commands of one pilot's closed deck share: `loop`, `simulate`, `limit-cycles`.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pilotgen.commands import common, settings

if TYPE_CHECKING:
    from pilotgen.closed_loop.deck import ClosedLoop
    from pilotgen.context import EvaluationContext
    from pilotgen.study.study import Study

WRITES = ("*.mbd", "*.fem", "*.h5", "*.log", "*.out")  # besides what a command leaves of its own


@dataclass(frozen=True)
class Opened:
    """A study's pilot closed with his rotorcraft, in the directory of a command.

    Attributes
    ----------
    study, values
        The study, and the pilot's own values.
    context : EvaluationContext
        Whose solver works.
    directory : Path
        Claimed for the command; holds the pilot's decks.
    loop : ClosedLoop
        The loop.
    """

    study: Study
    values: dict[str, Any]
    context: EvaluationContext
    directory: Path
    loop: ClosedLoop


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Study, -o, --set and --mbdae."""
    common.add_study(parser)
    common.add_output(parser)
    settings.add_settings(parser)
    common.add_mbdae(parser)


@contextmanager
def opened(
    args: argparse.Namespace, kind: str, writes: Sequence[str], two_way: bool = False, unstable: str | None = None
) -> Iterator[Opened]:
    """Read the study of `add_arguments`, claim the directory, solve the pilot and close his loop.

    Parameters
    ----------
    args : Namespace
        Of `add_arguments`.
    kind : str
        The command.
    writes : sequence of str
        What it leaves besides `WRITES`.
    two_way : bool
        Whether the pilot's reaction acts on the rotorcraft.
    unstable : str, optional
        What a loop that is unstable even when it is cut makes impossible; such a loop is refused.

    Raises
    ------
    StudyError
        A study that no deck of a closed loop holds, or an unstable rotorcraft: told before the directory is touched.
        A pilot who is unstable by himself.
    """
    from pilotgen.runs.executor import pin_threads

    pin_threads()
    from pilotgen.closed_loop.deck import check_study, close_in_deck
    from pilotgen.closed_loop.poles import check_open_loop, refuse_unstable_rotorcraft
    from pilotgen.context import EvaluationContext
    from pilotgen.output import claimed

    study, values = settings.read_pilot(args)
    check_study(study)
    if unstable is not None:
        refuse_unstable_rotorcraft(study, unstable)
    with (
        EvaluationContext(study, mbdae=args.mbdae) as context,
        claimed(args.output, kind, (*WRITES, *writes), overwrite=args.overwrite) as directory,
    ):
        loop = close_in_deck(context, values, directory, two_way=two_way)
        if unstable is not None:
            check_open_loop(loop, unstable)
        yield Opened(study, values, context, directory, loop)
