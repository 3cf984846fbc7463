"""Directories and files for results: made or refused with one sentence, written whole or not at all.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import errno
import json
import os
import stat
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from pilotgen.errors import FileError, PilotgenError


def make_directory(directory: Path) -> None:
    """Make a directory for output, parents included.

    Raises
    ------
    FileError
        It cannot be made or written to, or its name is not text (the solver and HDF5 take UTF-8 names only).
    """
    try:
        os.fsencode(directory).decode("utf-8")
        str(directory).encode("utf-8")
    except UnicodeError:
        raise FileError(
            f"{os.fsencode(directory)!r}: the name of the output directory is not UTF-8 text; choose another one"
        ) from None
    advice = "choose a directory you can write to"
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        if directory.is_symlink():
            raise FileError(f"{directory} is a link to {os.readlink(directory)}, which is no directory") from None
        raise FileError(f"{directory} is a file; the output needs a directory") from None
    except OSError as error:
        raise FileError(f"{directory}: cannot be made ({error.strerror}); {advice}") from None
    if not os.access(directory, os.W_OK | os.X_OK):
        raise FileError(f"{directory}: cannot be written to; {advice}")


def refuse_special(path: str | os.PathLike[str], error: type[PilotgenError] = FileError) -> None:
    """Raise `error` if a path leads to a pipe, a device or a socket: reading it might never end.

    What is missing, and what is a directory, is for the caller to tell.
    """
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return
    for test, what in (
        (stat.S_ISFIFO, "a pipe"),
        (stat.S_ISCHR, "a device"),
        (stat.S_ISBLK, "a device"),
        (stat.S_ISSOCK, "a socket"),
    ):
        if test(mode):
            raise error(f"{os.fspath(path)} is {what}; a regular file is wanted")


def check_templates(directory: Path, *names: str) -> None:
    """Make sure, before hours of work, that templates are there with all that they include.

    Raises
    ------
    FileError
        One is missing or cannot be read.
    """
    import jinja2.meta

    grammar = jinja2.Environment(autoescape=True)  # reads only
    waiting, seen = list(names), set(names)
    while waiting:
        path = directory / waiting.pop()
        try:
            tree = grammar.parse(path.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, jinja2.TemplateSyntaxError) as error:
            why = getattr(error, "strerror", None) or error
            raise FileError(
                f"{path}: cannot be read ({why}); this installation is incomplete, install it again"
            ) from None
        found = {name for name in jinja2.meta.find_referenced_templates(tree) if name is not None} - seen
        waiting += sorted(found)
        seen |= found


def write_text(path: Path, text: str) -> None:
    """Write a text file whole or not at all; FileError if that fails."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file whole or not at all; FileError if that fails."""
    part = path.with_name(path.name + ".part")
    try:
        if part.is_symlink() or (part.exists() and not part.is_file()):  # opening a pipe might never end
            raise OSError(errno.EEXIST, f"{part.name} is in the way and no regular file")
        part.write_bytes(data)
        os.replace(part, path)
    except OSError as error:
        with suppress(OSError):
            if part.is_file() and not part.is_symlink():
                part.unlink()
        raise FileError(f"{path}: cannot be written ({error.strerror}); check space and permissions") from None


def to_json(result: Mapping[str, Any]) -> str:
    """A result object as readable JSON, strict: infinite margins must have become None."""
    return json.dumps(result, indent=2, allow_nan=False) + "\n"


def strict_json(text: str) -> dict[str, Any]:
    """A JSON object of finite numbers. Raises ValueError for anything else."""

    def refuse(name: str) -> float:
        raise ValueError(f"{name} is no number of a result")

    try:
        data = json.loads(text, parse_constant=refuse)
    except RecursionError:
        raise ValueError("nested without end") from None
    if not isinstance(data, dict):
        raise ValueError("no JSON object")
    return data


def read_strict_json(path: Path) -> dict[str, Any]:
    """The same of a file of ours. Raises OSError, ValueError, and FileError for what is no regular file."""
    refuse_special(path)
    return strict_json(path.read_text(encoding="utf-8"))
