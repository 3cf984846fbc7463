"""What sensitivity.json says, in sentences.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pilotgen.objectives import Objective, objective

MOST = 5  # numbers that a sentence tells


def sentences(content: Mapping[str, Any]) -> list[str]:
    """One sentence for every objective: which numbers decide it, and which way; the objectives in their order."""
    return [_sentence(key, one, content) for key, one in content["objectives"].items()]


def _sentence(key: str, one: Mapping[str, Any], content: Mapping[str, Any]) -> str:
    row = objective(key)
    if one.get("anova"):
        effects = sorted((line for line in one["anova"] if "f" in line), key=lambda line: -line["sum_of_squares"])
        parts = [f"{line['source']} [{100 * (line['share'] or 0.0):.0f} %]" for line in effects[:MOST]]
        return _joined(row, parts, "shares of the sum of squares")
    size = "mean_magnitude" if content["method"] == "morris" else "total"
    numbers = (one.get("indices") or {}).get("numbers", {})
    known = {name: told for name, told in numbers.items() if told.get(size) is not None}
    if not known:
        return f"The {row.label} has no indices: {_why_not(one, content)}."
    order = sorted(known, key=lambda name: -known[name][size])[:MOST]
    parts = [_part(row, name, known[name], one["slopes"].get(name), size) for name in order]
    return _joined(row, parts, "shares of its variance, total Sobol index" if size == "total" else "over its range")


def _joined(row: Objective, parts: list[str], how: str) -> str:
    then = f", then on {', '.join(parts[1:])}" if parts[1:] else ""
    return f"The {row.label} depends most on {parts[0]}{then} ({how})."


def _part(row: Objective, name: str, told: Mapping[str, float], slope: float | None, size: str) -> str:
    way = "" if not slope else ", a larger one raises it" if slope > 0.0 else ", a larger one lowers it"
    value, half = told[size], told[f"{size}_half_width"]
    if size == "total":
        return f"{name} [{100 * value:.0f} +- {100 * half:.0f} %{way}]"
    return f"{name} [{value:.{row.digits}f} +- {half:.{row.digits}f} {row.unit}".rstrip() + f"{way}]"


def _why_not(one: Mapping[str, Any], content: Mapping[str, Any]) -> str:
    if one["infinite"]:
        return f"{one['infinite']} of {content['points']} pilots have none"
    return "it does not vary, or too few pilots could be evaluated"
