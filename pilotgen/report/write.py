"""Gather, draw and write: study.h5 in, report.html and the decks of the front out.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pilotgen.context import EvaluationContext
from pilotgen.errors import IncompleteOutput
from pilotgen.evaluation import PILOT_DECK, Evaluation, evaluate
from pilotgen.figures.study import Curve
from pilotgen.files import write_text
from pilotgen.objectives import MARGINS, OBJECTIVES
from pilotgen.output import STUDY_NAME
from pilotgen.report import decks, findings, page
from pilotgen.report.choose import shown_whole
from pilotgen.report.others import ReportSection
from pilotgen.report.people import Known
from pilotgen.report.repeated import Repeated
from pilotgen.runs.batch import RESULTS_NAME
from pilotgen.runs.monitor import read_course
from pilotgen.runs.results import StudyResults, read_results
from pilotgen.study.schema import is_whole
from pilotgen.study.study import Study

REPORT_NAME = "report.html"
CURVE_POINTS = 15  # pilots per variable of the one-at-a-time curves


def write_report(
    directory: Path,
    study: Study,
    rows: Sequence[Mapping[str, Any]] | None = None,
    mbdae: str | None = None,
    solver: str = "mbdae",
    mbdyn: str | None = None,
    evaluations: bool = True,
    others: Sequence[ReportSection] = (),
) -> Path:
    """Write report.html, study.yaml (the study's text) and, for multibody pilots, decks of the front to `directory`.

    Parameters
    ----------
    directory : Path
        Where study.h5 is.
    study : Study
        The study it came from.
    rows : sequence of mapping, optional
        Result objects of its evaluations in their order, for what study.h5 does not hold (extrapolations); None if
        they are lost.
    mbdae, solver, mbdyn
        Who evaluates, as of `EvaluationContext`.
    evaluations : bool
        False evaluates nothing: no curves, no Bode and Nyquist figures, no decks, no solver needed.
    others : sequence of ReportSection
        What other commands found, to be told on the page (`read_report_section`).

    Returns
    -------
    Path
        The report. The same study.h5, heartbeat and program give the same bytes.

    Raises
    ------
    FileError
        study.h5 cannot be read, or something cannot be written.
    IncompleteOutput
        Everything is written, but pilots who were evaluated again fail or have other margins than in study.h5.
    """
    results, course = read_results(directory / RESULTS_NAME), read_course(directory)
    order = findings.worst_order(results)
    front = findings.first_front(results)
    repeated, front_decks = None, None
    problems: list[str] = []
    places: dict[int, str] = {}
    if evaluations and len(order):
        with EvaluationContext(study, mbdae=mbdae, solver=solver, mbdyn=mbdyn) as context:
            repeated = _repeat(context, results, int(order[0]))
            if study.pilot.model == "multibody":
                front_decks = decks.choose_front(results, front)
                problems_found, written = decks.write_front_decks(directory, context, results, front_decks)
                problems += problems_found
                places = {index: f"{decks.FRONT_NAME}/{k:02d}/{PILOT_DECK}" for k, index in enumerate(written, start=1)}
            if not repeated.same:
                problems.append("the worst pilot, evaluated again, is not as study.h5 has him")
            known = _shown(context, results, order, front, places)
            found = (rows, repeated, front_decks, problems, solver, known, others, course)
            text = page.render(study, results, order, front, *found)
    else:
        text = page.render(study, results, order, front, rows, None, None, problems, solver, (), others, course)
    write_text(directory / STUDY_NAME, study.text)
    write_text(directory / REPORT_NAME, text)
    if problems:
        more = f" (and {len(problems) - 1} more, all in the report)" if len(problems) > 1 else ""
        raise IncompleteOutput(f"{directory / REPORT_NAME} is written, but {problems[0]}{more}")
    return directory / REPORT_NAME


def _shown(
    context: EvaluationContext, results: StudyResults, order: np.ndarray, front: np.ndarray, places: Mapping[int, str]
) -> Iterator[Known]:
    """Pilots to be shown whole, evaluated one by one as the page asks for them; those with decks on disk first."""
    with_decks = [index for index in places if index >= 0]
    for index in dict.fromkeys([*order[:1].tolist(), *with_decks, *shown_whole(results, order, front)]):
        values = dict(zip(results.names, results.columns["inputs"][index].tolist(), strict=True))
        outcome = evaluate(context, context.study.values(values))
        if isinstance(outcome, Evaluation):
            yield Known(index, outcome, places.get(index, ""))


def _repeat(context: EvaluationContext, results: StudyResults, worst: int) -> Repeated:
    values = dict(zip(results.names, results.columns["inputs"][worst].tolist(), strict=True))
    again = evaluate(context, context.study.values(values))
    same = isinstance(again, Evaluation) and all(
        decks.same_margin(row.of(again.result), float(results.columns[row.key][worst])) for row in MARGINS
    )
    return Repeated(
        evaluate(context, context.study.nominal),
        again,
        tuple(one_at_a_time(context, results, values, j) for j in range(len(results.names))),
        same,
    )


def one_at_a_time(
    context: EvaluationContext,
    results: StudyResults,
    values: Mapping[str, float],
    column: int,
    points: int = CURVE_POINTS,
) -> Curve:
    """Margins of pilots that differ from `values` in one variable, over its range; the pilot itself is one of them."""
    name = results.names[column]
    grid = np.linspace(results.lower[column], results.upper[column], points)
    grid = np.unique(np.append(np.round(grid) if is_whole(name) else grid, values[name]))
    margins = np.full((len(OBJECTIVES), len(grid)), np.nan)
    for k, value in enumerate(grid.tolist()):
        outcome = evaluate(context, context.study.values({**values, name: value}))
        if isinstance(outcome, Evaluation):
            margins[:, k] = [row.of(outcome.result) for row in OBJECTIVES.values()]
    return Curve(name, grid, dict(zip(OBJECTIVES, margins, strict=True)))
