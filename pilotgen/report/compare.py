"""comparison.html: two studies side by side, with their differences in words.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pilotgen.errors import FileError
from pilotgen.figures.compare import two_clouds
from pilotgen.figures.style import quantity, typeset
from pilotgen.files import write_text
from pilotgen.objectives import GAIN_MARGIN, OBJECTIVES, Objective
from pilotgen.population.shares import Share
from pilotgen.report import findings
from pilotgen.report.assets import comparison_scripts, style_text, template
from pilotgen.report.findings import typeset_number
from pilotgen.report.packing import embedded, pack_wide
from pilotgen.report.stills import still
from pilotgen.runs.batch import RESULTS_NAME
from pilotgen.runs.changes import changes
from pilotgen.runs.results import StudyResults, read_results
from pilotgen.study.study import Study, study_from_text

PAGE_NAME, TEMPLATE = "comparison.html", "comparison.html.j2"
ROWS = 5  # worst pilots of each study
SAME = 1e-9  # of the box: pilots that are the same in both studies


@dataclass(frozen=True)
class Side:
    """One of two studies."""

    name: str
    source: str
    study: Study
    results: StudyResults
    order: np.ndarray

    @property
    def even(self) -> np.ndarray:
        """Indices of the pilots that cover the box evenly and could be evaluated. Shape (k,)."""
        columns, members = self.results.columns, self.results.members
        rows = members[0] if len(members) else np.arange(len(columns["status"]))
        kept: np.ndarray = rows[columns["status"][rows] == "ok"]
        return kept


def read_sides(first: Path, second: Path) -> tuple[Side, Side]:
    """The studies of two output directories.

    Raises
    ------
    FileError
        One holds no finished study, no pilot of it could be evaluated, or they have no variable in common.
    """
    sides = []
    for directory in (first, second):
        path = directory / RESULTS_NAME
        if not path.is_file():
            raise FileError(
                f"{path} does not exist; --compare wants two output directories of `pilotgen search` or `sample`"
            )
        results = read_results(path)
        order = findings.worst_order(results)
        if not len(order):
            raise FileError(f"{path}: no pilot of this study could be evaluated; there is nothing to compare")
        study = study_from_text(str(results.attributes["study_text"]), f"{path}: study_text")
        sides.append((study, directory, results, order))
    names = [str(results.attributes["study_name"]) for _, _, results, _ in sides]
    if names[0] == names[1]:
        names = [directory.name for _, directory, _, _ in sides]
    if names[0] == names[1]:
        names = [f"{name} ({which})" for name, which in zip(names, ("first", "second"), strict=True)]
    one, two = (
        Side(name, str(directory), study, results, order)
        for name, (study, directory, results, order) in zip(names, sides, strict=True)
    )
    if not set(one.results.names) & set(two.results.names):
        raise FileError(
            f"{first} varies {', '.join(one.results.names)} and {second} {', '.join(two.results.names)}: studies with "
            "no variable in common cannot be compared"
        )
    return one, two


def write_comparison(directory: Path, first: Path, second: Path) -> Path:
    """Write comparison.html of the studies in two directories to `directory`; FileError as `read_sides`."""
    text = render_comparison(*read_sides(first, second))
    write_text(directory / PAGE_NAME, text)
    return directory / PAGE_NAME


def render_comparison(a: Side, b: Side) -> str:
    """The text of comparison.html."""
    shared = [name for name in a.results.names if name in b.results.names]
    figure = two_clouds([(a.name, a.results, a.even), (b.name, b.results, b.even)], shared)
    return template(TEMPLATE).render(
        a=a,
        b=b,
        sentences=sentences(a, b),
        changes=_changes(a, b),
        rows=_rows(a, b),
        tables=[(side, _worst(side)) for side in (a, b)],
        picture=still(
            figure,
            "gain margins of both studies over their most telling variable, and their distributions",
            "Every evaluated pilot of both studies, and how many of the evenly spread ones have which gain margin.",
        ),
        style=style_text(),
        page_data=embedded(_data(a, b, shared)),
        scripts=comparison_scripts(),
    )


# ---- words


def sentences(a: Side, b: Side) -> list[str]:
    """What differs, the most telling first."""
    told = []
    for row in OBJECTIVES.values():
        if row.key in a.results.columns and row.key in b.results.columns:
            told.append(_worst_sentence(row, a, b))
    told += [text for row in OBJECTIVES.values() if (text := _share_sentence(row, a, b))]
    told.append(_paired_sentence(a, b))
    return [text for text in told if text]


def _worst_sentence(row: Objective, a: Side, b: Side) -> str:
    x, y = (float(side.results.columns[row.key][side.order[0]]) for side in (a, b))
    if not np.isfinite([x, y]).all():
        if x == y:
            return ""
        return f"The worst pilot's {row.label} is {_margin(row, x)} in {a.name} and {_margin(row, y)} in {b.name}."
    change = y - x
    if abs(change) < 0.5 * 10.0**-row.digits:
        return f"The worst pilots of both have the same {row.label}, {_margin(row, x)}."
    how = "larger" if change > 0.0 else "smaller"
    return (
        f"The worst pilot's {row.label} is {_margin(row, abs(change))} {how} in {b.name}: {_margin(row, y)} where "
        f"{a.name} has {_margin(row, x)}."
    )


def _margin(row: Objective, value: float) -> str:
    return typeset(row.text(value))


def _share_sentence(row: Objective, a: Side, b: Side) -> str:
    """Shares of the even pilots below the limit of the first study."""
    limit = a.study.limits.get(row.key)
    if limit is None or row.key not in a.results.columns or row.key not in b.results.columns:
        return ""
    shares = [Share(int((side.results.columns[row.key][side.even] < limit).sum()), len(side.even)) for side in (a, b)]
    if not any(share.count for share in shares):
        return ""
    low, high = shares[0].interval, shares[1].interval
    apart = low[1] < high[0] or high[1] < low[0]
    return (
        f"Of the pilots that cover the box evenly, {shares[0].text()} have a {row.label} below {_margin(row, limit)} "
        f"in {a.name} and {shares[1].text()} in {b.name}; "
        + ("the intervals are apart." if apart else "the intervals overlap, so this may be chance.")
    )


def _paired_sentence(a: Side, b: Side) -> str:
    """How the same pilots move from one study to the other."""
    pairs = _pairs(a, b)
    if not len(pairs):
        return "No pilot is in both studies with the same numbers, so shifts of single pilots cannot be told."
    row = GAIN_MARGIN
    shift = b.results.columns[row.key][pairs[:, 1]] - a.results.columns[row.key][pairs[:, 0]]
    shift = shift[np.isfinite(shift)]
    if not len(shift):
        return ""
    low, middle, high = (typeset_number(float(value), 2) for value in np.quantile(shift, (0.05, 0.5, 0.95)))
    return (
        f"{len(shift)} pilots are in both studies with the same numbers: from {a.name} to {b.name} their {row.label} "
        f"changes by {middle} {row.unit} in the median, 9 of 10 of them by {low} to {high} {row.unit}."
    )


def _pairs(a: Side, b: Side) -> np.ndarray:
    """Rows of the pilots that are in both, evaluated, with the same numbers. Shape (pairs, 2)."""
    if set(a.results.names) != set(b.results.names):
        return np.empty((0, 2), dtype=np.int64)
    columns = [b.results.names.index(name) for name in a.results.names]
    width = np.where(a.results.upper > a.results.lower, a.results.upper - a.results.lower, 1.0)

    def keys(inputs: np.ndarray) -> list[tuple[int, ...]]:
        return [tuple(row) for row in np.rint(inputs / (SAME * width)).astype(np.int64).tolist()]

    there, here = (side.results.columns["status"] == "ok" for side in (a, b))
    known = {key: k for k, key in enumerate(keys(a.results.columns["inputs"])) if there[k]}
    found = [
        (known[key], k)
        for k, key in enumerate(keys(b.results.columns["inputs"][:, columns]))
        if key in known and here[k]
    ]
    return np.array(found, dtype=np.int64).reshape(-1, 2)


# ---- tables and numbers


def _changes(a: Side, b: Side) -> list[tuple[str, str, str]]:
    """Keys of the studies that differ: path, there, here."""
    found = changes(a.study.text, b.study, str(b.results.attributes["kind"])) or []

    def shown(value: Any) -> str:
        return "–" if value is None else json.dumps(value, ensure_ascii=False)

    return [(one.path, shown(one.before), shown(one.now)) for one in found]


def _rows(a: Side, b: Side) -> list[tuple[str, ...]]:
    """Numbers side by side."""
    lines: list[tuple[str, ...]] = [("rotorcraft", a.study.rotorcraft.name, b.study.rotorcraft.name)]
    lines.append(("evaluated pilots", *(str(len(side.order)) for side in (a, b))))
    lines.append(("failed", *(str(len(side.results.columns["status"]) - len(side.order)) for side in (a, b))))
    lines.append(("worst pilot", *(findings.pilot_text(side.results, int(side.order[0])) for side in (a, b))))
    for row in OBJECTIVES.values():
        if row.key not in a.results.columns or row.key not in b.results.columns:
            continue
        both = [side.results.columns[row.key] for side in (a, b)]
        worst = (_margin(row, float(values[side.order[0]])) for values, side in zip(both, (a, b), strict=True))
        lines.append((f"{row.label} of the worst pilot", *worst))
        if len(a.even) and len(b.even):
            middle = (
                _margin(row, float(np.quantile(values[side.even], 0.5, method="lower")))
                for values, side in zip(both, (a, b), strict=True)
            )
            lines.append((f"median {row.label}, evenly spread", *middle))
    return lines


def _worst(side: Side) -> Mapping[str, Any]:
    """The worst pilots of one study."""
    chosen = findings.distinct(side.results, side.order, ROWS)
    shown = [row for row in OBJECTIVES.values() if row.key in side.results.columns]
    heads = [quantity(name).axis for name in side.results.names] + [row.heading for row in shown] + ["closed loop"]
    columns = side.results.columns
    lines = [
        [f"{value:.4g}" for value in columns["inputs"][k]]
        + [typeset_number(float(columns[row.key][k]), row.digits) for row in shown]
        + ["stable" if columns["stable"][k] == 1 else "UNSTABLE"]
        for k in chosen.tolist()
    ]
    return {"heads": heads, "lines": lines}


def _data(a: Side, b: Side, shared: list[str]) -> dict[str, Any]:
    """Columns that both have, for the views."""
    keys = [row.key for row in OBJECTIVES.values() if all(row.key in side.results.columns for side in (a, b))]
    sides = []
    for side in (a, b):
        columns = {name: side.results.columns["inputs"][:, side.results.names.index(name)] for name in shared}
        columns |= {key: side.results.columns[key] for key in keys}
        sides.append(
            {
                "name": side.name,
                "ok": np.flatnonzero(side.results.columns["status"] == "ok").tolist(),
                "even": side.even.tolist(),
                "worst": int(side.order[0]),
                "columns": {name: pack_wide(values) for name, values in columns.items()},
            }
        )
    told = [{"key": name, "label": quantity(name).name, "unit": quantity(name).unit, "digits": 3} for name in shared]
    told += [
        {"key": key, "label": OBJECTIVES[key].label, "unit": OBJECTIVES[key].unit, "digits": OBJECTIVES[key].digits,
         "limit": a.study.limits.get(key)}
        for key in keys
    ]  # fmt: skip
    return {"sides": sides, "columns": told, "objectives": keys, "pairs": _pairs(a, b).tolist()}
