"""Reference pages made from the code: every command, every study key, every objective, every public name of Python.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from pathlib import Path

import pilotgen
from pilotgen.cli import build_parser
from pilotgen.objectives import OBJECTIVES
from pilotgen.study.fields import REQUIRED, Field, Number, Section
from pilotgen.study.schema import SCHEMA

ROOT = Path(__file__).resolve().parents[1]


def write_reference_pages(directory: Path) -> None:
    """Write the pages to `directory`; leave alone what would not change, so that Sphinx need not read it again."""
    directory.mkdir(parents=True, exist_ok=True)
    pages = {"commands.md": commands(), "study_keys.md": study_keys(), "objectives.md": objectives(), "api.md": api()}
    pages["templates.md"] = (ROOT / "templates" / "README.md").read_text(encoding="utf-8")
    for name, text in pages.items():
        path = directory / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def commands() -> str:
    """Every command with its help, as the terminal shows it."""
    os.environ["COLUMNS"] = "100"  # argparse wraps at the width of the terminal
    parser = build_parser()
    lines = ["# Commands", "", "What `pilotgen --help` and `pilotgen COMMAND --help` print.", ""]
    for name, command in ((parser.prog, parser), *subcommands(parser)):
        lines += [f"## {name}", "", "```text", command.format_help().rstrip(), "```", ""]
    return "\n".join(lines)


def subcommands(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """The commands of a parser, each with its full name, in the order of the help."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield command.prog, command


def study_keys() -> str:
    """Every key of a study: type, unit, range, default, meaning."""
    lines = [
        "# Study keys",
        "",
        "From the schema that reads them; in sentences: [study files](../../io_formats/study.md).",
        "",
    ]
    lines += ["| key | kind | unit | range | default | meaning |", "|---|---|---|---|---|---|"]
    for path, field in SCHEMA.items():
        cells = [
            f"`{path}`",
            type(field).__name__.lower(),
            _unit(field),
            _range(field),
            _default(field),
            field.meaning.replace("](../", "](../../"),
        ]
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join([*lines, ""])


def _unit(field: Field) -> str:
    return field.unit if isinstance(field, Number) else ""


def _range(field: Field) -> str:
    return f"{field.low:g} to {field.high:g}" if isinstance(field, Number) else ""


def _default(field: Field) -> str:
    if field.default is REQUIRED:
        return "required"
    if field.default is None or isinstance(field, Section):
        return ""
    return f"`{field.default}`"


def objectives() -> str:
    """What a search can minimise and a result is told by."""
    lines = [
        "# Objectives",
        "",
        "What `search.objectives`, results and figures know; from the table that all of them read.",
        "",
    ]
    lines += ["| key | unit | label |", "|---|---|---|"]
    lines += [f"| `{key}` | {row.unit} | {row.label} |" for key, row in OBJECTIVES.items()]
    return "\n".join([*lines, ""])


def api() -> str:
    """The public names of the package with their docstrings."""
    lines = [
        "# Python",
        "",
        "The names that `import pilotgen` offers; examples: [pilotgen from Python](../../python.md).",
        "",
    ]
    for name in pilotgen.__all__:
        thing = getattr(pilotgen, name)
        kind = "autoclass" if isinstance(thing, type) else "autofunction" if callable(thing) else "autodata"
        where = thing.__module__ if isinstance(thing, type) or callable(thing) else "pilotgen.api"
        lines += [
            "```{eval-rst}",
            f".. {kind}:: {where}.{name}" if kind != "autodata" else f".. py:data:: pilotgen.{name}",
        ]
        lines += ["   :members:"] if kind == "autoclass" else []
        lines += ["```", ""]
    return "\n".join(lines)
