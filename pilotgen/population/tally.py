"""What a study tells about its people: shares with intervals, quantiles of the margins, who is nearest to the limits.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping
from typing import Any

import numpy as np

from pilotgen.objectives import OBJECTIVES, Objective, below_limits
from pilotgen.population.shares import Share

QUANTILES = (0.001, 0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
NEAREST = 10  # people told one by one, for each limit


class Tally:
    """Takes people with their results one by one; holds a number per person and objective, nothing else that grows.

    Parameters
    ----------
    limits : mapping
        Objective -> what a robust loop keeps; None for no limit.
    """

    def __init__(self, limits: Mapping[str, float | None]) -> None:
        self.limits = {key: limit for key, limit in limits.items() if limit is not None}
        self.people = self.evaluated = self.unstable = self.below_any = 0
        self.below = dict.fromkeys(self.limits, 0)
        self.failed_by_stage: dict[str, int] = {}
        self.margins = {key: array("d") for key in OBJECTIVES}
        self._near: dict[str, list[tuple[float, int, dict[str, Any]]]] = {key: [] for key in self.limits}

    def add(self, person: Mapping[str, Any], result: Mapping[str, Any]) -> None:
        """Count one person."""
        self.people += 1
        if result["status"] != "ok":
            stage = str(result["stage"])
            self.failed_by_stage[stage] = self.failed_by_stage.get(stage, 0) + 1
            return
        self.evaluated += 1
        self.unstable += not result["loop"]["stable"]
        self.below_any += bool(below_limits(result, self.limits))
        for key, row in OBJECTIVES.items():
            self.margins[key].append(signed(row, result))
        for key, limit in self.limits.items():
            value = OBJECTIVES[key].of(result)
            self.below[key] += value < limit
            if math.isfinite(value):
                self._keep(key, abs(value - limit), person, result)

    def _keep(self, key: str, distance: float, person: Mapping[str, Any], result: Mapping[str, Any]) -> None:
        near = self._near[key]
        if len(near) == NEAREST and distance >= near[-1][0]:
            return
        margins = {name: _or_null(signed(row, result)) for name, row in OBJECTIVES.items()}
        told = {"number": self.people - 1, "values": dict(person), "stable": bool(result["loop"]["stable"]), **margins}
        near.append((distance, self.people - 1, told))
        near.sort(key=lambda one: one[:2])
        del near[NEAREST:]

    @property
    def shares(self) -> dict[str, Share]:
        """`unstable`, every limited objective, `any` of them: shares of those who could be evaluated."""
        return {
            "unstable": Share(self.unstable, self.evaluated),
            **{key: Share(count, self.evaluated) for key, count in self.below.items()},
            "any": Share(self.below_any, self.evaluated),
        }

    @property
    def widest(self) -> float:
        """Width of the widest interval of the shares."""
        return max(share.width for share in self.shares.values())

    def as_dict(self) -> dict[str, Any]:
        """For population.json (docs/io_formats/population.md)."""
        shares: dict[str, dict[str, Any]] = {key: share.as_dict() for key, share in self.shares.items()}
        for one in shares.values():  # whatever those are who could not be evaluated
            one["least"] = one["count"] / self.people if self.people else None
            one["most"] = (one["count"] + self.people - self.evaluated) / self.people if self.people else None
        for key, limit in self.limits.items():
            shares[key]["limit"] = limit
        quantiles = {}
        for key, margins in self.margins.items():
            values = np.sort(np.frombuffer(margins)) if len(margins) else np.empty(0)
            places = [max(0, math.ceil(q * len(values)) - 1) for q in QUANTILES]  # of a person, not between two
            quantiles[key] = {
                f"{q:g}": _or_null(values[k]) if len(values) else None for q, k in zip(QUANTILES, places, strict=True)
            }
        return {
            "people": self.people,
            "evaluated": self.evaluated,
            "failed": Share(self.people - self.evaluated, self.people).as_dict(),
            "failed_by_stage": dict(sorted(self.failed_by_stage.items())),
            "shares": shares,
            "quantiles": quantiles,
            "nearest": {key: [told for _, _, told in near] for key, near in self._near.items()},
        }


def signed(row: Objective, result: Mapping[str, Any]) -> float:
    """An objective, negative if the closed loop is unstable; plus infinity, or minus its cap, without a crossing."""
    value = row.of(result)
    if not row.signed and not result["loop"]["stable"]:
        value = -value
    return -row.cap if value == -math.inf else value


def _or_null(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def percent(share: float) -> str:
    """A share in per cent with two figures: `0.042`, `3.1`."""
    return f"{100.0 * share:.2g}" if share < 0.1 else f"{100.0 * share:.0f}"


def sentences(content: Mapping[str, Any]) -> list[str]:
    """What population.json says, as an engineer would repeat it; the most telling first."""
    who, shares = content["name"], content["shares"]
    if not content["evaluated"]:
        return [f"None of {content['people']} {who} could be evaluated."]
    told = [
        f"{_percent(shares[key], who)} fly this machine with a {row.label} below {row.text(shares[key]['limit'])}."
        for key, row in OBJECTIVES.items()
        if key in shares
    ]
    told.append(f"{_percent(shares['unstable'], who)} make it unstable.")
    if len(shares) > 3:
        told.append(f"{_percent(shares['any'], who)} miss at least one of these.")
    failed = content["failed"]
    if failed["count"]:
        stages = ", ".join(f"{count} at {stage}" for stage, count in content["failed_by_stage"].items())
        told.append(f"{_percent(failed, who)} could not be evaluated and are in none of these shares: {stages}.")
        least, most = (100 * shares["any"][key] for key in ("least", "most"))
        told.append(f"Were they as good or as bad as can be, {least:.1f} to {most:.1f} % of all would miss something.")
    left_out = content["left_out"]
    if left_out["people"]:
        reasons = "; ".join(f"{count} with {why}" for why, count in left_out["by_limit"].items())
        told.append(f"{left_out['people']} of {left_out['candidates']} candidates are left out: {reasons}.")
    return told


def _percent(share: Mapping[str, Any], who: str) -> str:
    one = Share(share["count"], share["of"])
    number, interval = one.text().split(" % ", 1)
    return f"{number} % of {who} {interval}"
