"""pilot.html: one pilot, with the nominal one of his study beside him.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pilotgen.context import EvaluationContext
from pilotgen.errors import FileError, IncompleteOutput
from pilotgen.evaluation import PILOT_DECK, RESULT_NAME, Evaluation, FailedEvaluation, evaluate
from pilotgen.figures import loop as loop_figures
from pilotgen.figures.style import quantity, typeset
from pilotgen.files import write_text
from pilotgen.objectives import MARGINS, OBJECTIVES, margins_text
from pilotgen.report.assets import script_texts, style_text, template
from pilotgen.report.decks import same_margin
from pilotgen.report.others import ReportSection, read_report_section
from pilotgen.report.packing import embedded
from pilotgen.report.people import Known, page_data
from pilotgen.report.stills import still
from pilotgen.report.story import Card, loop_words
from pilotgen.runs.results import Row, StudyResults, columns_of
from pilotgen.study.study import Study
from pilotgen.study.wording import setting_text

PAGE_NAME, TEMPLATE, STUDY_NAME = "pilot.html", "pilot.html.j2", "study.yaml"


def write_pilot_page(
    directory: Path,
    context: EvaluationContext,
    outcome: Evaluation,
    content: Mapping[str, Any],
    solver: str = "mbdae",
    study_text: bool = True,
) -> Path:
    """Write pilot.html and, for `pilotgen view` to make it again, the text of the study.

    Parameters
    ----------
    directory : Path
        Where result.json is; what `pilot --uncertain` left there is told too.
    context : EvaluationContext
        Of the study.
    outcome : Evaluation
        The pilot.
    content : mapping
        What result.json says.
    solver : str
        For the command line.
    study_text : bool
        Whether to write study.yaml.
    """
    study = context.study
    same = all(study.nominal.get(name) == value for name, value in outcome.values.items())
    nominal = outcome if same else evaluate(context, study.nominal)
    text = render_pilot(study, outcome, content, None if same else nominal, _uncertain(directory), solver)
    if study_text:
        write_text(directory / STUDY_NAME, study.text)
    write_text(directory / PAGE_NAME, text)
    return directory / PAGE_NAME


def repeat_pilot(
    directory: Path, context: EvaluationContext, values: Mapping[str, Any], content: Mapping[str, Any]
) -> Path:
    """Evaluate the pilot of a result.json again and write his page beside it.

    Raises
    ------
    FileError
        He cannot be evaluated any more.
    IncompleteOutput
        The page is written, but he has other margins than result.json says.
    """
    outcome = evaluate(context, values)
    if isinstance(outcome, FailedEvaluation):
        raise FileError(
            f"{directory / RESULT_NAME}: this pilot fails now at {outcome.stage}: {outcome.reason}; another version of "
            "pilotgen wrote it, evaluate him again with pilotgen pilot"
        )
    page = write_pilot_page(directory, context, outcome, content, study_text=False)
    for row in MARGINS:
        found, before = row.of(outcome.result), row.of(content)
        if not same_margin(found, before):
            raise IncompleteOutput(
                f"{page} is written, but his {row.label} is {row.text(found)} now where {RESULT_NAME} has "
                f"{row.text(before)}: another version of pilotgen wrote it"
            )
    return page


def _uncertain(directory: Path) -> list[ReportSection]:
    return [read_report_section(directory)] if (directory / "uncertain.json").is_file() else []


def render_pilot(
    study: Study,
    outcome: Evaluation,
    content: Mapping[str, Any],
    nominal: Evaluation | FailedEvaluation | None,
    others: list[ReportSection],
    solver: str = "mbdae",
) -> str:
    """The text of pilot.html; parameters as of `write_pilot_page`."""
    beside = nominal if isinstance(nominal, Evaluation) else None
    results = _one(study, outcome)
    known = [Known(0, outcome, PILOT_DECK)]
    data = page_data(study, results, np.array([0]), np.array([0]), [outcome.result], beside, known, STUDY_NAME, solver)
    words = [f"{name}={setting_text(value)}" for name, value in outcome.values.items() if not _is_number(value)]
    data["command"]["more"] = words
    solid = data["skeletons"] is not None
    pilots = [("nominal pilot", beside), ("this pilot", outcome)] if beside is not None else [("", outcome)]
    drawn = [(name, one) for name, one in pilots if one is not None]
    return template(TEMPLATE).render(
        study=study,
        heading=_who(outcome, results),
        verdict=_verdict(outcome, study),
        story=_story(outcome, study, others),
        notes=[f"Mind: {sentence}." for sentence in content.get("caveats", ())],
        others=others,
        pictures=[
            still(loop_figures.nyquist(drawn), "Nyquist curve of the pilot's loop", "Nyquist curve around −1 (+)."),
            still(loop_figures.bode(drawn), "Bode diagrams of the pilot", "Feedthrough and loop."),
        ],
        lines=_lines(outcome.result),
        settings=[(name, str(value)) for name, value in content.get("provenance", {}).items() if value],
        style=style_text(),
        page_data=embedded(data),
        scripts=script_texts(solid),
        solid=solid,
        many=False,
        references=bool(data["references"]),
        loop_words=loop_words(study),
    )


def _one(study: Study, outcome: Evaluation) -> StudyResults:
    """A study of one pilot: every number that he was given is a variable."""
    values = {name: float(value) for name, value in outcome.values.items() if _is_number(value)}
    names = tuple(values)
    own = np.array([list(values.values())])
    objectives = np.array([[row.ranked(outcome.result) for row in MARGINS]])
    columns = columns_of([Row(0, 0, values, outcome.result)], names, objectives, None)
    keys = tuple(row.key for row in MARGINS)
    none = np.empty(0, dtype=np.int64)
    return StudyResults({"kind": "pilot"}, names, own[0], own[0], keys, columns, np.empty((0, 0), dtype=np.int64), none)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _who(outcome: Evaluation, results: StudyResults) -> str:
    told = [quantity(name).text(float(value)) for name, value in zip(results.names, results.lower, strict=True)]
    told += [f"{name} {setting_text(value)}" for name, value in outcome.values.items() if name not in results.names]
    return ", ".join(told).capitalize()


def _verdict(outcome: Evaluation, study: Study) -> str:
    state = "stable" if outcome.result["loop"]["stable"] else "UNSTABLE"
    words = typeset(margins_text(outcome.result, OBJECTIVES.values()))
    return f"With this pilot the closed loop of the {study.rotorcraft.name} is {state}: {words}."


def _story(outcome: Evaluation, study: Study, others: list[ReportSection]) -> list[Card]:
    row = MARGINS[0]
    value, limit = row.of(outcome.result), study.limits.get(row.key)
    bad = not outcome.result["loop"]["stable"] or (limit is not None and value < limit)
    lines = [] if limit is None else [f"the study wants {typeset(row.text(limit))} or more"]
    cards = [Card("How bad", f"{row.label} {typeset(row.text(value))}", lines, bad)]
    certificate = outcome.result["bdft"].get("certificate")
    sure = [sentence for section in others for sentence in section.sentences[:2]]
    if certificate is not None:
        sure.append(f"his linear model is within {typeset(f'{certificate:.0e}')} of the full-order response")
    if sure:
        answer = others[0].answer if others and others[0].answer else "as far as the model goes"
        cards.append(Card("How sure", answer, sure))
    return cards


def _lines(result: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The numbers of a result, for print and for browsers without scripts."""
    lines = []
    for section in ("biometrics", "seat", "posture", "activation", "bdft", "loop"):
        for name, value in result.get(section, {}).items():
            if isinstance(value, bool):
                lines.append((f"{section} {name}", "yes" if value else "no"))
            elif isinstance(value, str):
                lines.append((f"{section} {name}", value))
            elif isinstance(value, int | float) and math.isfinite(value):
                lines.append((f"{section} {name}", typeset(f"{value:.6g}")))
            elif value is None and name in OBJECTIVES:
                lines.append((f"{section} {name}", "none (no crossing)"))
    return lines
