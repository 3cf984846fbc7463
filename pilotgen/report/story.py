"""The story of a page, one screen: who, how bad, how sure, how many, what would cure it.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from pilotgen.evaluation import Evaluation
from pilotgen.figures.style import typeset
from pilotgen.objectives import OBJECTIVES
from pilotgen.report import findings
from pilotgen.report.others import ReportSection
from pilotgen.report.repeated import Repeated
from pilotgen.runs.results import StudyResults
from pilotgen.study.study import Study


@dataclass(frozen=True)
class LoopWords:
    """What moves and what is held, in words."""

    motion: str
    control: str


def loop_words(study: Study) -> LoopWords:
    """The words of the loop that a study closes."""
    ends = study.loop
    motion = "vertical acceleration" if ends.usual else f"{ends.input} acceleration"
    return LoopWords(motion, f"{ends.control} grip")


@dataclass(frozen=True)
class Card:
    """One question of the top of the page, and its answer."""

    question: str
    answer: str
    lines: Sequence[str] = field(default_factory=tuple)
    bad: bool = False


def story(
    study: Study,
    results: StudyResults,
    worst: int,
    repeated: Repeated | None,
    others: Sequence[ReportSection],
) -> list[Card]:
    """Who is the worst pilot, how bad he is, how sure that is, how many are like him, what would cure it."""
    columns = results.columns
    gain = OBJECTIVES["gain_margin_db"]
    limit = study.limits.get(gain.key)
    value = float(columns[gain.key][worst])
    stable = columns["stable"][worst] == 1
    lines = [
        f"{row.label} {findings.margin_words(row.key, float(columns[row.key][worst]))}"
        for row in OBJECTIVES.values()
        if row is not gain and row.key in columns
    ]
    robust = results.searched_quantiles
    answer = f"gain margin {findings.margin_words(gain.key, value)}"
    if robust:
        lines = [f"nominal {line}" for line in (answer, *lines)]
        answer = ", ".join(f"{row.label} {typeset(row.text(float(columns[row.key][worst])))}" for row in robust)
        known = [(float(columns[row.key][worst]), study.limits.get(row.base)) for row in robust]
        below = any(wanted is not None and found < wanted for found, wanted in known)
    else:
        below = limit is not None and value < limit
    if limit is not None:
        lines.insert(0, f"the study wants {findings.margin_words(gain.key, limit)} or more")
    cards = [
        Card("Who", findings.pilot_text(results, worst)),
        Card(
            "How bad",
            f"{'stable' if stable else 'UNSTABLE'}, {answer}",
            lines,
            bad=not stable or below,
        ),
        _how_sure(results, worst, repeated, others),
        _how_many(study, results, worst, others),
    ]
    cures = [section for section in others if section.kind == "cures"]
    cards += [Card("What would cure it", section.answer or "see below", section.sentences[:2]) for section in cures[:1]]
    return cards


def _how_sure(results: StudyResults, worst: int, repeated: Repeated | None, others: Sequence[ReportSection]) -> Card:
    """Numbers that limit trust: what is not known of the pilot, the certificate, whether he repeats."""
    told = [section for section in others if section.kind == "uncertainty"]
    lines = [sentence for section in told for sentence in section.sentences[:2]]
    certificate = float(results.columns["certificate"][worst]) if "certificate" in results.columns else float("nan")
    if certificate == certificate:  # a number
        lines.append(f"his linear model is within {typeset(f'{certificate:.0e}')} of the full-order response")
    if repeated is not None:
        again = repeated.same and isinstance(repeated.worst, Evaluation)
        lines.append("evaluated again, he has the same margins" if again else "evaluated again, he is NOT the same")
    robust = results.searched_quantiles
    if robust:
        lines.append("what is not known of him is in the quantile: he was searched for by it")
    elif not told:
        lines.append("how far what is not known of him moves his margins: “pilotgen pilot --uncertain”, not run here")
    return Card("How sure", told[0].answer if told and told[0].answer else "as far as the model goes", lines)


def _how_many(study: Study, results: StudyResults, worst: int, others: Sequence[ReportSection]) -> Card:
    """People below the limits if a population was run; else pilots of the box, which are no people."""
    told = [section for section in others if section.kind == "population"]
    if told:
        return Card("How many", told[0].answer or "see below", told[0].sentences[:3])
    shares = findings.how_far(results, worst, study.limits)
    more = "shares of people: “pilotgen population”, not run here"
    if rare := findings.rarity(study, results):
        who = rare[0].removeprefix("How rare the worst pilot is: ").split(" is ")[0]
        return Card("How many", who, ["is at least as unusual as the worst pilot, see below", more])
    return Card("How many", "of the box, not of people", [*shares[-1:], more])
