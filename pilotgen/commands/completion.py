"""`pilotgen completion`: shell completion.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
from typing import Any

from pilotgen.commands import common
from pilotgen.errors import FileError, StudyError

SHELLS = ("bash", "zsh", "tcsh")


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "completion",
        "print a script that completes commands, options and files in a shell",
        "Print the completion script of a shell: commands, options, choices and files. Bash reads it from "
        "~/.local/share/bash-completion/completions/pilotgen.",
        "pilotgen completion bash > ~/.local/share/bash-completion/completions/pilotgen",
    )
    parser.add_argument("shell", choices=SHELLS, help=", ".join(SHELLS))
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    if args.json:
        raise StudyError("--json does nothing for a shell's script; leave it out")
    try:
        import shtab
    except ImportError:
        raise FileError(
            "pilotgen completion needs the package shtab; install it with: pip install 'pilotgen[completion]'"
        ) from None
    _complete_files(args.parser, shtab.FILE)
    print(shtab.complete(args.parser, shell=args.shell))
    return 0


def _complete_files(parser: argparse.ArgumentParser, files: Any) -> None:
    """Have every argument that takes a path complete to files."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                _complete_files(command, files)
        elif getattr(action.type, "__name__", "") in ("Path", "user_path") or action.dest in ("mbdae", "mbdyn"):
            action.complete = files  # type: ignore[attr-defined]
