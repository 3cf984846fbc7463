"""What a study says, in numbers and words: worst pilots, where the box binds, how margins move, why pilots failed.

Nothing here draws or evaluates; everything is read from study.h5.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pilotgen.figures.study import Curve
from pilotgen.figures.style import quantity, typeset
from pilotgen.objectives import MARGINS, OBJECTIVES, Objective, Quantile, objective
from pilotgen.population.region import Region, rarity_text, region_of
from pilotgen.runs.results import DISTANCE, StudyResults
from pilotgen.study.study import Study

SAME_PILOT = 0.10  # share of the box: pilots that differ by no more in any variable count as one in tables
AT_BOUND = 0.01  # share of the box: this near a bound is at the bound
TELLING = 0.1  # dB, deg: a difference between margins worth telling
CLEAR_TREND, WEAK_TREND = 0.5, 0.2  # rank correlations called clear, and not worth a word


def worst_order(results: StudyResults) -> np.ndarray:
    """Indices of the evaluated pilots, worst first: by front, then by gain plus phase margin (capped).

    Of a robust study what was minimised takes the place of the margins. Shape (evaluated,).
    """
    columns = results.columns
    ok = np.flatnonzero(columns["status"] == "ok")
    robust = bool(results.searched_quantiles)
    rows = [objective(key) for key in results.objective_names] if robust else MARGINS
    capped = np.sum([np.clip(columns[row.key][ok], -row.cap, row.cap) for row in rows], axis=0)
    front = columns["rank"][ok] if "rank" in columns else np.zeros(len(ok), dtype=np.int64)
    order: np.ndarray = ok[np.lexsort((capped, front))]
    return order


def robust_verdict(study: Study, results: StudyResults, worst: int) -> str:
    """What was searched for in a robust study: the worst pilot's quantiles; empty for others."""
    rows = results.searched_quantiles
    if not rows:
        return ""
    told = " and ".join(f"{row.label}, {typeset(row.text(float(results.columns[row.key][worst])))}" for row in rows)
    return (
        f"He was searched for by the {told}, over {study.uncertain['draws']} draws of what is not known of him. The "
        "margins above are nominal: of him as the study has him, without draws."
    )


def distinct(results: StudyResults, order: np.ndarray, count: int, share: float = SAME_PILOT) -> np.ndarray:
    """The first `count` of `order` that differ from each other by more than `share` of the box in some variable."""
    width = results.upper - results.lower
    place = results.columns["inputs"] / np.where(width > 0.0, width, 1.0)
    kept: list[int] = []
    for index in order.tolist():
        if len(kept) == count:
            break
        if not kept or np.abs(place[kept] - place[index]).max(axis=1).min() > share:
            kept.append(index)
    return np.array(kept, dtype=np.int64)


def first_front(results: StudyResults) -> np.ndarray:
    """Indices of the final population's first front; of a sample, its non-dominated pilots. Shape (members,)."""
    front: np.ndarray
    if len(results.front):
        front = results.front[results.columns["status"][results.front] == "ok"]
        return front
    from pilotgen.search.ranking import non_dominated_rank

    front = np.flatnonzero(results.columns["status"] == "ok")
    return front[non_dominated_rank(results.columns["objectives"][front]) == 1] if len(front) else front


def pilot_text(results: StudyResults, index: int) -> str:
    """`age 64 years, body mass index 30 kg/m², stature 1.99 m`."""
    values = results.columns["inputs"][index]
    return ", ".join(quantity(name).text(float(value)) for name, value in zip(results.names, values, strict=True))


def typeset_number(value: float, digits: int) -> str:
    """A number with a true minus sign; `none` for an infinite margin, a dash for a missing one."""
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "none" if value > 0.0 else "−∞"
    text = f"{value:.{digits}f}"
    return text.replace("-", "−") if float(text) != 0.0 else f"{0.0:.{digits}f}"


def margin_text(results: StudyResults, name: str, index: int) -> str:
    """`4.50 dB at 2.81 Hz`, or that there is no crossing."""
    columns = results.columns
    return margin_words(name, float(columns[name][index]), float(columns[OBJECTIVES[name].at][index]))


def margin_words(name: str, value: float, at_hz: float | None = None) -> str:
    """A margin in words, as print has it: its value and frequency, or that there is no crossing."""
    return typeset(OBJECTIVES[name].text(value, at_hz))


# ---- sentences


def verdict(results: StudyResults, worst: int, rotorcraft: str, control: str = "collective") -> str:
    """Who the worst pilot is, and what the loop over a control does with them."""
    stable = results.columns["stable"][worst] == 1
    gain, phase = (margin_text(results, row.key, worst) for row in MARGINS)
    return (
        f"The worst pilot has {pilot_text(results, worst)}. With this pilot at the {control} of the {rotorcraft} "
        f"the closed loop is {'stable' if stable else 'UNSTABLE'}: gain margin {gain}, phase margin {phase}."
    )


def how_far(results: StudyResults, worst: int, limits: Mapping[str, float | None]) -> list[str]:
    """How far the worst pilot is from the study's limits, and how many pilots miss them."""
    sentences = []
    robust = results.searched_quantiles
    for row in (*robust, *OBJECTIVES.values()):
        wanted = limits.get(_limited(row))
        if wanted is None:
            continue
        value = float(results.columns[row.key][worst])
        told = typeset(row.text(wanted))
        if math.isinf(value) and value > 0.0:
            text = "the worst pilot's loop has no crossing, so the margin is infinite."
        elif math.isinf(value):
            text = "the worst pilot's closed loop is unstable, and its loop has no crossing to measure from."
        elif value < wanted:
            text = f"the worst pilot misses {told} by {typeset(row.text(wanted - value))}."
        else:
            text = f"the model's worst pilot is {typeset(row.text(value - wanted))} above {told}."
        label = f"nominal {row.label}" if robust and row not in robust else row.label
        sentences.append(f"{label[0].upper()}{label[1:]}: {text}")
    return sentences + _shares(results, limits)


def _shares(results: StudyResults, limits: Mapping[str, float | None]) -> list[str]:
    """How many pilots of the first population, which covers the box evenly, miss the limits."""
    columns = results.columns
    rows = results.members[0] if len(results.members) else np.arange(len(columns["status"]))
    rows = rows[columns["status"][rows] == "ok"]
    if not len(rows):
        return []
    robust = results.searched_quantiles
    counts = [
        f"{int((columns[row.key][rows] < limit).sum())} have {f'a {row.label} of ' if row in robust else ''}"
        f"{'nominally ' if robust and row not in robust else ''}less than {typeset(row.text(limit))}"
        for row in (*robust, *(OBJECTIVES[key] for key in limits))
        if (limit := limits.get(_limited(row))) is not None
    ]
    counts.append(f"{int((columns['stable'][rows] == 0).sum())} make the closed loop unstable")
    where = "region, not as people are" if DISTANCE in columns else "box"
    who = f"first population, spread evenly over the {where}" if len(results.members) else "sample"
    return [f"Of the {len(rows)} evaluated pilots of the {who}, {', '.join(counts)}."]


def _limited(row: Objective) -> str:
    """The margin whose limit an objective is held against."""
    return row.base if isinstance(row, Quantile) else row.key


def pilots_below_limits(results: StudyResults, limits: Mapping[str, float | None]) -> list[str]:
    """What pilots lack, and how many of them, in sentences for a terminal; empty if nothing."""
    columns = results.columns
    unstable = int((columns["stable"] == 0).sum())
    found = [f"{unstable} of {len(columns['stable'])} pilots make the closed loop unstable"] if unstable else []
    robust = results.searched_quantiles
    for row in (*robust, *(OBJECTIVES[key] for key in limits)):
        limit = limits.get(_limited(row))
        if limit is None:
            continue
        below = int((columns[row.key] < limit).sum())
        if below:
            label = f"nominal {row.label}" if robust and row not in robust else row.label
            smallest = row.text(float(np.nanmin(columns[row.key])))
            found.append(f"{below} pilots have a {label} below {row.text(limit)}; the smallest is {smallest}")
    return found


@dataclass(frozen=True)
class Bound:
    """A variable of the worst pilot at an end of its range."""

    name: str
    side: str  # "lower" | "upper"
    value: float
    share: float  # of the first front that lies at this bound
    searched: bool  # by a search; false for a sample

    @property
    def sentence(self) -> str:
        """`The search stopped at body mass index 30 kg/m², the upper bound: ...`."""
        return (
            f"The {'search stopped' if self.searched else 'sample ends'} at {quantity(self.name).text(self.value)}, "
            f"the {self.side} bound of the study "
            f"({100.0 * self.share:.0f} % of the front lies there): the worst pilot may lie beyond."
        )


def bounds_met(results: StudyResults, worst: int, front: np.ndarray) -> list[Bound]:
    """Which variables of the worst pilot are at an end of the box. `front` holds indices, shape (members,)."""
    width = results.upper - results.lower
    place = (results.columns["inputs"] - results.lower) / np.where(width > 0.0, width, 1.0)
    found = []
    for j, name in enumerate(results.names):
        for side, distance, value in (
            ("lower", place[:, j], results.lower[j]),
            ("upper", 1.0 - place[:, j], results.upper[j]),
        ):
            if distance[worst] <= AT_BOUND:
                share = float(np.mean(distance[front] <= AT_BOUND))
                found.append(Bound(name, side, float(value), share, bool(len(results.members))))
    return found


def rarity(study: Study, results: StudyResults) -> list[str]:
    """How rare the worst pilot of a search in the region of a population is, and whether its edge stopped the search.

    Empty for other studies.
    """
    order = worst_order(results)
    if DISTANCE not in results.columns or not len(order):
        return []
    region = region_of(study)
    if region is None:
        return []
    distance = float(results.columns[DISTANCE][order[0]])
    told = [f"How rare the worst pilot is: {rarity_text(region.who, distance)}."]
    values = dict(zip(results.names, results.columns["inputs"][order[0]].tolist(), strict=True))
    met = [
        f"{quantity(name).text(limit)}"
        for name, ends in region.limits.items()
        for limit in ends
        if name in values and abs(values[name] - limit) <= 1e-6 * abs(limit)
    ]
    if distance >= region.radius * (1.0 - AT_BOUND):
        met.append(f"the surface of the region that holds {region.text}")
    return told + ([f"The search stopped at {' and '.join(met)}: the worst pilot may lie beyond."] if met else [])


def worse_on_curves(results: StudyResults, worst: int, curves: Sequence[Curve], region: Region | None = None) -> str:
    """A sentence if the curves through the worst pilot find a worse one: the search has not come to its end.

    Worse: neither margin is larger, and one is smaller by at least `TELLING`. Nothing is said if the study minimises
    something else than these margins.
    """
    if not {row.key for row in MARGINS} <= set(results.objective_names):
        return ""
    own = np.array([[row.capped(float(results.columns[row.key][worst]))] for row in MARGINS])
    found = []
    for curve in curves:
        capped = np.stack([np.clip(curve.margins[row.key], -row.cap, row.cap) for row in MARGINS])
        loss = np.nan_to_num(own - capped, nan=-1.0)  # (2, k); positive where the pilot on the curve is worse
        largest = np.where((loss >= 0.0).all(axis=0), loss.max(axis=0), 0.0)
        if region is not None:  # who is outside was not to be found
            people = np.tile(results.columns["inputs"][worst], (len(curve.values), 1))
            people[:, results.names.index(curve.name)] = curve.values
            largest = np.where(region.holds(people), largest, 0.0)
        k = int(np.argmax(largest))
        if largest[k] >= TELLING:
            told = [
                f"{row.label} {margin_words(row.key, float(curve.margins[row.key][k]))}"
                for row in MARGINS
                if math.isfinite(curve.margins[row.key][k])
            ]
            found.append(f"{quantity(curve.name).text(float(curve.values[k]))} ({', '.join(told)})")
    if not found:
        return ""
    return (
        f"The search has not come to its end: the worst pilot is made worse by {', or by '.join(found)} alone. "
        "More generations or a larger population would find such pilots."
    )


@dataclass(frozen=True)
class Trend:
    """How the margins of the first population go with one variable: rank correlations, NaN if they cannot be told."""

    name: str
    correlation: Mapping[str, float]

    @property
    def sentence(self) -> str:
        """`The gain margin falls clearly with rising body mass index.`"""
        value = self.correlation[MARGINS[0].key]
        label = quantity(self.name).name
        if math.isnan(value):
            return f"Nothing can be said about the {label}."
        if abs(value) < WEAK_TREND:
            return f"Over the whole box the gain margin hardly follows the {label}."
        how = "clearly" if abs(value) >= CLEAR_TREND else "somewhat"
        return f"Over the whole box the gain margin {'rises' if value > 0.0 else 'falls'} {how} with rising {label}."

    @property
    def numbers(self) -> str:
        """`Rank correlation with the gain margin 0.58, with the phase margin 0.56.`, as far as there is one."""
        told = [
            f"with the {quantity(name).name} {typeset_number(value, 2)}"
            for name, value in self.correlation.items()
            if not math.isnan(value)
        ]
        return f"Rank correlation {', '.join(told)}." if told else ""


def trends(results: StudyResults) -> list[Trend]:
    """Spearman's rank correlation of the capped margins with every variable, in the first population or the sample."""
    columns = results.columns
    rows = results.members[0] if len(results.members) else np.arange(len(columns["status"]))
    rows = rows[columns["status"][rows] == "ok"]
    capped = {row.key: np.clip(columns[row.key][rows], -row.cap, row.cap) for row in MARGINS}
    return [
        Trend(variable, {name: _spearman(columns["inputs"][rows, j], margin) for name, margin in capped.items()})
        for j, variable in enumerate(results.names)
    ]


def _spearman(x: np.ndarray, y: np.ndarray) -> float:
    if len(x) < 3 or np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return math.nan
    return float(np.corrcoef(_ranks(x), _ranks(y))[0, 1])


def _ranks(values: np.ndarray) -> np.ndarray:
    """Ranks from 0; equal values share the mean of theirs."""
    _, inverse, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    ranks: np.ndarray = (last - 0.5 * (counts + 1))[inverse]
    return ranks


def curve_sentence(curve: Curve) -> str:
    """`For the worst pilot, it alone moves the gain margin between −4.50 and 2.79 dB.`"""
    margin = curve.margins[MARGINS[0].key]
    if np.isnan(margin).all():
        return ""
    low, high = float(np.nanmin(margin)), float(np.nanmax(margin))
    if math.isinf(low) or math.isinf(high):
        return "For the worst pilot, it alone makes the gain margin infinite somewhere in its range."
    ends = f"{typeset_number(low, 2)} and {typeset_number(high, 2)} dB"
    return f"For the worst pilot, it alone moves the gain margin between {ends}."


# ---- failures and replay


def replay(results: StudyResults, index: int, study: str, solver: str = "mbdae") -> str:
    """The command line that evaluates a pilot of study.h5 again."""
    from pilotgen.runs.batch import replay_command

    return replay_command(study, dict(zip(results.names, results.columns["inputs"][index], strict=True)), solver)


@dataclass(frozen=True)
class Failure:
    """Failed pilots with the same stage and, numbers aside, the same reason."""

    stage: str
    reason: str  # of the first of them
    count: int
    example: int  # its index


def failures(results: StudyResults) -> list[Failure]:
    """Failed pilots by reason, the most frequent first."""
    from pilotgen.runs.batch import failures_by_reason

    columns = results.columns
    rows: list[Mapping[str, Any]] = [
        {"status": "failed", "stage": str(columns["stage"][k]), "reason": str(columns["reason"][k]), "index": int(k)}
        for k in np.flatnonzero(columns["status"] != "ok")
    ]
    return [
        Failure(stage, reason, count, example["index"]) for stage, reason, count, example in failures_by_reason(rows)
    ]


@dataclass(frozen=True)
class Extrapolation:
    """Evaluations that leave the range of the data behind the body model in the same way."""

    sentence: str  # of the first of them
    count: int


def extrapolations(rows: Sequence[Mapping[str, Any]]) -> list[Extrapolation]:
    """What the evaluations say about leaving the range of their data, grouped by the first word (the biometric)."""
    groups: dict[str, list[str]] = {}
    for row in rows:
        for sentence in row.get("extrapolated", []):
            groups.setdefault(str(sentence).split(" ", 1)[0], []).append(str(sentence))
    return [Extrapolation(sentences[0], len(sentences)) for _, sentences in sorted(groups.items())]
