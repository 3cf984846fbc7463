"""`pilotgen examples`: list the studies that come with pilotgen, and copy them.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Any

from pilotgen.commands import common
from pilotgen.errors import FileError, StudyError
from pilotgen.files import write_bytes
from pilotgen.study.wording import did_you_mean


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "examples",
        "list the studies that come with pilotgen, and copy them",
        "Without NAME: the studies that come with pilotgen, each with its first line. With NAME: copy that study, and "
        "the files it names, to FILE, or to NAME.yaml here. Nothing that exists is written over.",
        "pilotgen examples quick -o quick.yaml",
    )
    parser.add_argument("name", metavar="NAME", nargs="?", help="one of the list; all: every one, to a directory")
    parser.add_argument(
        "-o", "--output", metavar="FILE", type=common.user_path, default=None, help="file to write; for all a directory"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """List, or copy."""
    known = {path.stem: path for path in sorted(studies_directory().glob("*.yaml"))}
    if args.name is None:
        if args.output is not None:
            raise StudyError("-o is for one example; name it, or all")
        rows = {name: first_line(path) for name, path in known.items()}
        if args.json:
            common.print_json(rows)
        else:
            width = max(map(len, rows))
            print("\n".join(f"{name:{width}}  {line}" for name, line in rows.items()))
        return 0
    if args.name not in (*known, "all"):
        guess = did_you_mean(args.name, list(known))
        raise StudyError(f"example {args.name!r} is not known; {guess}known: {', '.join(known)}, all")
    if args.name == "all":
        directory = args.output or Path("studies").absolute()
        copies = {path: directory / path.name for path in known.values()}
    else:
        target = args.output or Path(f"{args.name}.yaml").absolute()
        copies = {known[args.name]: target}
    for path, target in list(copies.items()):
        copies |= {path.with_name(name): target.with_name(name) for name in named_files(path)}
    there = [target for target in copies.values() if target.exists() or target.is_symlink()]
    if there:
        raise FileError(f"{there[0]} exists; choose another name with -o, or move it aside")
    for path, target in copies.items():
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(f"{target.parent}: cannot be made ({error.strerror}); choose another place") from None
        write_bytes(target, path.read_bytes())
    if args.json:
        common.print_json({"files": list(copies.values())})
    else:
        print("\n".join(map(str, copies.values())))
    return 0


def studies_directory() -> Path:
    """Where the studies are: in the installed package, or in docs/ of a source tree. FileError if nowhere."""
    package = Path(__file__).parents[1]
    for directory in (package / "studies", package.parent / "docs" / "studies"):
        if (directory / "quick.yaml").is_file():
            return directory
    raise FileError("this installation of pilotgen has no example studies; install it anew")


def first_line(path: Path) -> str:
    """What a study's first comment says."""
    lines = path.read_text(encoding="utf-8").split("\n")
    return next((line.lstrip("# ").strip() for line in lines if line.startswith("#")), "")


def named_files(path: Path) -> list[str]:
    """Files beside a study that it names."""
    text = path.read_text(encoding="utf-8")
    words = re.findall(r":\s*([A-Za-z0-9_.-]+\.(?:json|mat|csv))\b", text)
    return [name for name in dict.fromkeys(words) if path.with_name(name).is_file()]
