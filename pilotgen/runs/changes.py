"""What a study in an output directory has other than the one that is to go on there, and whether it may.

What determines evaluations stays as it is, and so does the shape of study.h5; names, comments, limits, when the search
stops and the seed may change.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pilotgen.errors import FileError, PilotgenError
from pilotgen.study.study import Study, study_from_text
from pilotgen.study.wording import shown

UNCERTAIN = "uncertain"  # the kind of a run of draws of one pilot
ROBUST_KINDS = ("search", "sample")  # of runs that evaluate draws of every pilot where an objective is robust
SHAPES = ("variables", "objectives")  # of study.h5, whatever the kind of run
COURSE = ("algorithm", "population", "mutation_probability", "within")  # of a search
FREE = ("seed", "generations", "stop_rank_one_fraction", "stop_unchanged_generations")


@dataclass(frozen=True)
class Change:
    """One key that differs."""

    path: str
    before: Any
    now: Any
    refused: bool

    @property
    def text(self) -> str:
        """`search.seed 1 -> 2`."""
        return f"{self.path} {_shown(self.before)} -> {_shown(self.now)}"


def changes(known_text: str, study: Study, kind: str) -> list[Change] | None:
    """What differs between the study that a directory holds and `study`; None if the former cannot be read any more.

    Parameters
    ----------
    known_text : str
        Text of the study that the directory was started with.
    study : Study
        The one that is to go on.
    kind : str
        "search", "sample", "population", "sensitivity" or "uncertain".
    """
    if known_text == study.text:
        return []
    try:
        known = study_from_text(known_text, "study of the directory")
    except PilotgenError:  # of another version of the program
        return None
    searched = set(known.search.variables) & set(study.search.variables)
    before, now = (_determining(one, kind, searched) for one in (known, study))
    found = [Change(path, before.get(path), now.get(path), True) for path in _differing(before, now)]
    before, now = (_free(one, kind) for one in (known, study))
    return found + [Change(path, before.get(path), now.get(path), False) for path in _differing(before, now)]


def refuse_changes(directory: Path, known_text: str, study: Study, kind: str) -> list[Change]:
    """What differs and may. Parameters as of `changes`.

    Raises
    ------
    FileError
        Something differs that determines the evaluations of `directory`.
    """
    found = changes(known_text, study, kind)
    if found is None:
        raise FileError(
            f"{directory} holds a study of another version of pilotgen, which cannot be compared with {study.path};"
            " choose another output directory"
        )
    refused = [change for change in found if change.refused]
    if refused:
        raise FileError(
            f"{directory} holds a study that {study.path} differs from in what determines its evaluations:\n"
            f"{table_of_changes(refused)}\n  choose another output directory, or undo these changes"
        )
    return found


def table_of_changes(found: list[Change]) -> str:
    """Lines of a table: key, what it was, what it is now."""
    rows = [("key", "there", "now"), *((one.path, _shown(one.before), _shown(one.now)) for one in found)]
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    return "\n".join(
        "  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    )


def _determining(study: Study, kind: str, searched: set[str]) -> dict[str, Any]:
    """By path, what determines evaluations and the shape of study.h5."""
    flat = _flat(json.loads(study.canonical()))
    if kind == UNCERTAIN:  # a draw has all values of its own
        return flat
    if kind == "population":  # its people have all values of their own
        return flat | _flat({"population": study.population})
    if kind == "sensitivity":
        return flat | _flat({"sensitivity": study.sensitivity, "nominal": study.nominal})
    flat |= {f"nominal.{name}": value for name, value in study.nominal.items() if name not in searched}
    kept = (*SHAPES, *COURSE) if kind == "search" else SHAPES
    for name in kept:
        value = getattr(study.search, name)
        flat |= _flat({"search": {name: dict(value) if isinstance(value, Mapping) else value}})
    return flat


def _free(study: Study, kind: str) -> dict[str, Any]:
    flat: dict[str, Any] = {"study": study.name, **{f"limits.{key}": value for key, value in study.limits.items()}}
    if kind == UNCERTAIN:  # nor does the search matter
        return flat
    names = FREE if kind == "search" else ("seed",)
    return flat | {f"search.{name}": getattr(study.search, name) for name in names}


def _flat(tree: Any, path: str = "") -> dict[str, Any]:
    if not isinstance(tree, Mapping):
        return {path: list(tree) if isinstance(tree, tuple) else tree}
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        flat |= _flat(value, f"{path}.{key}" if path else str(key))
    return flat


def _differing(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    return [path for path in {**before, **now} if before.get(path, _flat) != now.get(path, _flat)]


def _shown(value: Any) -> str:
    return "-" if value is None else shown(value)
