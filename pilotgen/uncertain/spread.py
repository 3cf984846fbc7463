"""How one pilot's margins spread over the draws: quantiles and shares with their intervals, as numbers and sentences.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.special import bdtr

from pilotgen.objectives import OBJECTIVES, below_limits, place_of_quantile
from pilotgen.population.shares import Share
from pilotgen.population.tally import signed
from pilotgen.progress_line import counted

QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
FEW = 20  # draws, of which the smallest is the 5 % quantile
OUTSIDE = 0.025  # of an interval, on either side


def interval_of_quantile(q: float, count: int) -> tuple[int | None, int | None]:
    """Between which of `count` independent values in rising order the q quantile lies, at 95 %.

    None: no value is far enough.

    Order statistics l and u with P(B < l) and P(B >= u) of at most 2.5 % each, B binomial (Conover, Practical
    Nonparametric Statistics, section 3.2); no distribution is assumed.
    """
    below = bdtr(np.arange(count), count, q)  # P(B <= k)
    low = int(np.searchsorted(below, OUTSIDE, side="right"))  # smallest k with P(B <= k) above
    high = int(np.searchsorted(below, 1.0 - OUTSIDE, side="left"))  # smallest k with P(B <= k) of 97.5 %
    return (low - 1 if low >= 1 else None), (high if high < count else None)


def spread_of(results: Sequence[Mapping[str, Any]], limits: Mapping[str, float | None]) -> dict[str, Any]:
    """Draws evaluated, shares and quantiles of their margins, for uncertain.json (docs/io_formats/uncertain.md).

    Parameters
    ----------
    results : sequence of mapping
        Result objects of all draws.
    limits : mapping
        Objective -> what a robust loop keeps; None for no limit.
    """
    ok = [result for result in results if result["status"] == "ok"]
    stages: dict[str, int] = {}
    for result in results:
        if result["status"] != "ok":
            stages[str(result["stage"])] = stages.get(str(result["stage"]), 0) + 1
    wanted = {key: limit for key, limit in limits.items() if limit is not None}

    def share(count: int) -> dict[str, Any]:
        one = Share(count, len(ok)).as_dict()
        return {**one, "least": count / len(results), "most": (count + len(results) - len(ok)) / len(results)}

    shares = {"unstable": share(sum(not result["loop"]["stable"] for result in ok))}
    for key, limit in wanted.items():
        shares[key] = {**share(sum(OBJECTIVES[key].of(result) < limit for result in ok)), "limit": limit}
    shares["any"] = share(sum(bool(below_limits(result, wanted)) for result in ok))
    return {
        "draws": len(results),
        "evaluated": len(ok),
        "failed": Share(len(results) - len(ok), len(results)).as_dict(),
        "failed_by_stage": dict(sorted(stages.items())),
        "shares": shares,
        "margins": {key: _margin([signed(row, result) for result in ok]) for key, row in OBJECTIVES.items()},
    }


def _margin(values: Sequence[float]) -> dict[str, Any]:
    ordered = np.sort(np.asarray(values, dtype=float))
    finite = ordered[np.isfinite(ordered)]
    whole = len(finite) == len(ordered) and len(ordered) > 1
    found: dict[str, Any] = {
        "without_crossing": len(ordered) - len(finite),
        "mean": float(finite.mean()) if whole else None,
        "deviation": float(finite.std(ddof=1)) if whole else None,
        "quantiles": {},
        "draws": [_or_null(value) for value in values],
    }
    for q in QUANTILES if len(ordered) else ():
        low, high = interval_of_quantile(q, len(ordered))
        found["quantiles"][f"{q:g}"] = {
            "value": _or_null(ordered[place_of_quantile(q, len(ordered))]),
            "low": None if low is None else _or_null(ordered[low]),
            "high": None if high is None else _or_null(ordered[high]),
        }
    return found


def _or_null(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def sentences(content: Mapping[str, Any]) -> list[str]:
    """What uncertain.json says, as an engineer would repeat it; the most telling first."""
    draws, evaluated = content["draws"], content["evaluated"]
    if not evaluated:
        return [f"None of {draws} draws of this pilot could be evaluated."]
    told = []
    for key, row in OBJECTIVES.items():
        found, share = content["margins"][key], content["shares"].get(key)
        few = evaluated < FEW  # draws: these are all that can be told
        ends = [found["quantiles"][q]["value"] for q in (("0.01", "0.99") if few else ("0.05", "0.95"))]
        if ends[0] is None:
            continue
        nominal = content["nominal"][key]
        number = (
            f"{ends[0]:.{row.digits}f} to {row.text(ends[1])}"
            if ends[1] is not None
            else f"at least {row.text(ends[0])}"
        )
        as_said = f"; the study's own numbers give {row.text(nominal)}" if nominal is not None else ""
        who = f"The {counted(evaluated, 'draw')} evaluated" if few else "9 of 10 such pilots"
        text = f"{who} {'has' if evaluated == 1 else 'have'} a {row.label} of {number}{as_said}"
        if share is not None:
            text += f"; {_percent(share)} are below {row.text(share['limit'])}"
        told.append(text + ".")
    shares = content["shares"]
    told.append(f"{_percent(shares['unstable'])} make the loop unstable.")
    failed = content["failed"]
    if failed["count"]:
        stages = ", ".join(f"{count} at {stage}" for stage, count in content["failed_by_stage"].items())
        least, most = (100 * shares["any"][key] for key in ("least", "most"))
        told.append(
            f"{failed['count']} of {draws} draws ({100 * failed['share']:.1f} %) could not be evaluated and are in "
            f"none of these numbers: {stages}; were they as good or as bad as can be, {least:.1f} to {most:.1f} % "
            "would miss a limit."
        )
    return told


def answer(content: Mapping[str, Any]) -> str:
    """A few words for the top of a page: `gain margin 7.39 to 11.19 dB for 9 of 10`; empty with few draws."""
    for key, row in OBJECTIVES.items():
        quantiles = content["margins"][key]["quantiles"]
        ends = [quantiles[q]["value"] for q in ("0.05", "0.95")] if content["evaluated"] >= FEW else [None]
        if None not in ends:
            return f"{row.label} {ends[0]:.{row.digits}f} to {row.text(ends[1])} for 9 of 10"
    return ""


def _percent(share: Mapping[str, Any]) -> str:
    return Share(share["count"], share["of"]).text()
