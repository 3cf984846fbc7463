"""What other commands found, to be told on a page: people, sensitivities, uncertainty, cures, identification.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pilotgen.errors import FileError, StudyError
from pilotgen.figures.style import quantity
from pilotgen.files import read_strict_json
from pilotgen.objectives import GAIN_MARGIN, objective
from pilotgen.population.shares import Share
from pilotgen.population.tally import percent
from pilotgen.population.tally import sentences as people_told
from pilotgen.report.stills import smaller
from pilotgen.runs.cures_in_time import kicks_told
from pilotgen.runs.rare_study import sentences as rare_told
from pilotgen.uncertain.spread import sentences as draws_told

MOST_PICTURES = 4  # of a directory
PICTURE_BYTES = 400_000  # of one; a larger one stays where it is
ROWS = 12
_PIXELS = 106 / 150  # CSS pixels of a page per pixel of a figure


@dataclass(frozen=True)
class Picture:
    """A figure that another command drew."""

    data: str  # base64 of a PNG
    width_px: int
    alt: str
    caption: str


@dataclass(frozen=True)
class ReportSection:
    """What another command found."""

    kind: str  # population, sensitivity, uncertainty, cures, identification
    title: str
    source: str
    sentences: tuple[str, ...]
    answer: str = ""  # a few words for the top of the page
    table: Mapping[str, Any] | None = None
    pictures: tuple[Picture, ...] = ()


def read_report_section(directory: Path) -> ReportSection:
    """What a command left in a directory.

    Raises
    ------
    FileError
        Nothing there is known, or it cannot be read.
    """
    for name, make in _READERS.items():
        path = directory / name
        if path.is_file():
            try:
                return make(directory, path.as_posix(), read_strict_json(path))
            except (OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, StudyError) as error:
                raise FileError(f"{path}: cannot be read as what its command writes ({error}); run it again") from None
    raise FileError(
        f"{directory}: holds none of {', '.join(_READERS)}; --with wants the output directory of "
        "`pilotgen population`, `sensitivity`, `identify` or another command that leaves one of these"
    )


def _population(directory: Path, source: str, content: Mapping[str, Any]) -> ReportSection:
    share = content["shares"].get(GAIN_MARGIN.key) or content["shares"]["any"]
    answer = f"{Share(share['count'], share['of']).text()} of {content['name']}"
    return ReportSection(
        "population", "How many people", source, tuple(people_told(content)), answer, None, _pictures(directory)
    )


def _rare(directory: Path, source: str, content: Mapping[str, Any]) -> ReportSection:
    del directory  # it holds no pictures of this
    answer = f"{percent(content['share'])} % of {content['name']}"
    return ReportSection("population", "How many people", source, tuple(rare_told(content)), answer)


def _sensitivity(directory: Path, source: str, content: Mapping[str, Any]) -> ReportSection:
    rows, told = [], []
    sobol = content["method"] != "morris"
    for key, found in content["objectives"].items():
        row = objective(key)
        if found.get("anova"):
            shares = {line["source"]: _number(line["share"]) for line in found["anova"] if "share" in line}
            order = sorted(shares, key=lambda name: -shares[name] if shares[name] == shares[name] else math.inf)
            told.append(f"What moves the {row.label} most: {', '.join(order[:3])}.")
            rows += [[row.label, name, f"{shares[name]:.3g}"] for name in order[:ROWS]]
        if not found.get("indices"):
            continue
        numbers = found["indices"]["numbers"]
        weights = {name: _number(of["total" if sobol else "mean_magnitude"]) for name, of in numbers.items()}
        order = sorted(weights, key=lambda name: -weights[name] if weights[name] == weights[name] else math.inf)
        told.append(f"What moves the {row.label} most: {', '.join(order[:3])}.")
        unit = "" if sobol else f" {row.unit}"
        rows += [[row.label, name, f"{weights[name]:.3g}{unit}"] for name in order[:ROWS]]
    size = "share of the sum of squares" if content["method"] == "anova" else "total index"
    heads = ["objective", "number", size if sobol else "mean effect over its range"]
    table = {"heads": heads, "rows": rows} if rows else None
    nothing = "No objective has a variance that could be shared out."
    return ReportSection(
        "sensitivity", "Which numbers decide", source, tuple(told or [nothing]), "", table, _pictures(directory)
    )


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)


def _cures(directory: Path, source: str, content: Mapping[str, Any]) -> ReportSection:
    told = [str(content["sentence"])]
    proposal = content.get("proposal")
    answer = ""
    if isinstance(proposal, Mapping):
        words = "; ".join(str(one["text"]) for one in proposal.get("cures") or ())
        answer = words if words and proposal.get("reached") else "nothing that was tried is enough"
        if proposal.get("reached") and not words:
            answer = "nothing needs to be cured"
    kicks = kicks_told(content.get("simulation") or {})
    told += [f"{kicks[0].upper()}{kicks[1:]}."] if kicks else []
    told += [f"{one['sentence']}." for one in content.get("maps") or () if "sentence" in one]
    told += [str(one) for one in content.get("caveats") or ()]
    rows = [
        [
            str(row["label"]),
            f"{row['best']['worst']['amount']:.3g} {row['unit']}",
            f"{row['best']['worst']['bought']:.1f}",
        ]
        for row in content.get("cures") or ()
        if row["remedy"] and not row.get("by_name")
    ]
    heads = ["each alone, as far as is practicable", "best amount", "buys the worst pilot [dB]"]
    table = {"heads": heads, "rows": rows} if rows else None
    pictures = (*_pictures(directory, "cures"), *_pictures(directory, "cure_map*"))[:MOST_PICTURES]
    return ReportSection("cures", "What would cure it", source, tuple(told), answer, table, pictures)


def _uncertain(directory: Path, source: str, content: Mapping[str, Any]) -> ReportSection:
    values = content.get("values") or {}
    who = ", ".join(quantity(name).text(float(value)) for name, value in values.items() if isinstance(value, float))
    asked = [f"Asked of the pilot with {who}."] if who else []
    told, row = (*asked, *draws_told(content)), GAIN_MARGIN
    ends = [content["margins"][row.key]["quantiles"][q]["value"] for q in ("0.05", "0.95")]
    known = ends[0] is not None and ends[1] is not None
    answer = f"{row.label} {ends[0]:.{row.digits}f} to {row.text(ends[1])} (9 of 10)" if known else ""
    return ReportSection(
        "uncertainty", "What is not known of him", source, told, answer, None, _pictures(directory, "band*")
    )


def _identification(directory: Path, source: str, content: Mapping[str, Any]) -> ReportSection:
    told = str(content.get("sentence") or "One pilot's feedthrough by every method, side by side: see the figure.")
    return ReportSection("identification", "Identification", source, (told,), "", None, _pictures(directory))


def _pictures(directory: Path, names: str = "*") -> tuple[Picture, ...]:
    """PNG figures of a directory, the first few that are not too large."""
    found = []
    for path in sorted(directory.glob(f"{names}.png"))[:MOST_PICTURES]:
        data = path.read_bytes()
        if data[:4] == b"\x89PNG" and len(data) <= PICTURE_BYTES:
            words = path.stem.replace("_", " ").replace("-", " ")
            width = round(int.from_bytes(data[16:20], "big") * _PIXELS)
            found.append(Picture(base64.b64encode(smaller(data)).decode("ascii"), width, words, words))
    return tuple(found)


_READERS: Mapping[str, Callable[[Path, str, Mapping[str, Any]], ReportSection]] = {
    "population.json": _population,
    "rare.json": _rare,
    "sensitivity.json": _sensitivity,
    "cures.json": _cures,
    "uncertain.json": _uncertain,
    "results.json": _identification,
}
