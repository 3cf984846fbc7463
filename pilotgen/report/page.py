"""The page: findings, figures and tables put into the template.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pilotgen.evaluation import Evaluation, FailedEvaluation
from pilotgen.figures import loop as loop_figures
from pilotgen.figures import study as study_figures
from pilotgen.figures.style import quantity, typeset
from pilotgen.objectives import MARGINS, OBJECTIVES, PHASE_MARGIN, margins_text
from pilotgen.population.region import Region, beyond, one_in, region_of
from pilotgen.report import findings
from pilotgen.report.assets import script_texts, style_text, template
from pilotgen.report.course import course_rows
from pilotgen.report.findings import replay, typeset_number
from pilotgen.report.others import ReportSection
from pilotgen.report.people import Known, page_data, script_text
from pilotgen.report.stills import Still, still
from pilotgen.report.story import loop_words, story
from pilotgen.runs.results import DISTANCE, StudyResults
from pilotgen.study.loop_section import LoopSignals
from pilotgen.study.study import Study
from pilotgen.summary import caveats

if TYPE_CHECKING:
    from pilotgen.report.decks import FrontDecks
    from pilotgen.report.repeated import Repeated
    from pilotgen.runs.monitor import Course

TEMPLATE = "report.html.j2"
STUDY_FILE = "study.yaml"  # beside the report, so that its commands hold wherever the directory goes
TABLE_ROWS = 10
# columns of study.h5 shown beside the searched variables, where they were computed: heading, digits
DERIVED = {
    "mass_kg": ("mass [kg]", 1),
    "bmi": ("BMI [kg/m²]", 1),
    "pilot_frequency_hz": ("pilot mode [Hz]", 2),
    "pilot_damping": ("its damping", 2),
}


def render(
    study: Study,
    results: StudyResults,
    order: np.ndarray,
    front: np.ndarray,
    rows: Sequence[Mapping[str, Any]] | None,
    repeated: Repeated | None,
    front_decks: FrontDecks | None,
    problems: Sequence[str] = (),
    solver: str = "mbdae",
    known: Iterable[Known] = (),
    others: Sequence[ReportSection] = (),
    course: Course | None = None,
) -> str:
    """The text of report.html; parameters as gathered by `write_report`.

    `order` and `front` hold indices of evaluations, shapes (evaluated,) and (members,). `known` are pilots who were
    evaluated again for the views, `others` what other commands found, `course` is how the run went.
    """
    columns = results.columns
    worst = int(order[0]) if len(order) else None
    region = region_of(study) if DISTANCE in columns else None
    count, failed = len(columns["status"]), int((columns["status"] != "ok").sum())
    content: dict[str, Any] = {
        "study": study,
        "attributes": results.attributes,
        "is_search": bool(len(results.members)),
        "count": count,
        "failed": failed,
        "generations": len(results.members),
        "settings": _settings(study, results, region),
        "failures": _failure_table(results, solver),
        "extrapolations": None if rows is None else findings.extrapolations(rows),
        "worst": worst,
        "problems": problems,
        "caveats": _caveats(study, rows, worst, repeated),
        "objectives": ", ".join(quantity(name).name for name in results.objective_names),
        "style": style_text(),
        "others": others,
        "course": course_rows(course, results),
        "page_data": "",
    }
    if worst is not None:
        content |= {
            "verdict": findings.verdict(results, worst, study.rotorcraft.name, study.loop.control),
            "robust": findings.robust_verdict(study, results, worst),
            "nominal": _nominal_sentence(study, repeated),
            "rule": findings.how_far(results, worst, study.limits),
            "bounds": findings.rarity(study, results)
            or [bound.sentence for bound in findings.bounds_met(results, worst, front)],
            "unfinished": findings.worse_on_curves(results, worst, repeated.curves, region) if repeated else "",
            "no_phase": PHASE_MARGIN.key not in study_figures.shown_margins(results),
            "trends": [
                (trend, findings.curve_sentence(curve) if curve else "")
                for trend, curve in zip(
                    findings.trends(results), repeated.curves if repeated else [None] * len(results.names), strict=True
                )
            ],
            "who": _front_ranges(results, front),
            "front_count": len(front),
            "table": _worst_table(results, order, solver),
            "pictures": _pictures(results, study.limits, front, worst, repeated, study.loop),
            "repeated": repeated,
            "worst_again": repeated.worst if repeated else None,
            "worst_failed": isinstance(repeated.worst, FailedEvaluation) if repeated else False,
            "decks": front_decks,
            "worst_extrapolated": [] if rows is None else list(rows[worst].get("extrapolated", [])),
            "same_pilot": findings.SAME_PILOT,
            "story": story(study, results, worst, repeated, others),
            **_live(study, results, order, front, rows, repeated, known, solver),
        }
    return template(TEMPLATE).render(content, quantity=quantity)


def _live(
    study: Study,
    results: StudyResults,
    order: np.ndarray,
    front: np.ndarray,
    rows: Sequence[Mapping[str, Any]] | None,
    repeated: Repeated | None,
    known: Iterable[Known],
    solver: str,
) -> dict[str, Any]:
    """What the views need."""
    nominal = repeated.nominal if repeated and isinstance(repeated.nominal, Evaluation) else None
    data = page_data(study, results, order, front, rows, nominal, known, STUDY_FILE, solver)
    solid = data["skeletons"] is not None
    return {
        "page_data": script_text(data),
        "scripts": script_texts(solid),
        "solid": solid,
        "many": len(order) > 2,
        "references": bool(data["references"]),
        "loop_words": loop_words(study),
    }


# ---- figures


def _pictures(
    results: StudyResults,
    limits: study_figures.Limits,
    front: np.ndarray,
    worst: int,
    repeated: Repeated | None,
    ends: LoopSignals,
) -> dict[str, Still]:
    prone = "bounce" if ends.usual else "oscillation"
    dark = f"Darker markers are more prone to {prone}; the ring is the worst pilot."
    pictures = {
        "individuals": still(
            study_figures.all_individuals(results, worst, limits),
            "every evaluated pilot over the searched variables",
            f"Every evaluated pilot. {dark}",
        ),
        "plane": still(
            study_figures.objective_plane(results, front, worst, limits),
            "gain margin against phase margin of every pilot, with the Pareto front",
            _plane_caption(results),
        ),
        "curves": still(
            study_figures.margin_curves(results, repeated.curves if repeated else (), worst, limits),
            "gain and phase margin of every pilot against each searched variable",
            _curves_caption(results, repeated is not None),
        ),
    }
    if len(results.members):
        pictures["populations"] = still(
            study_figures.populations(results, worst, limits),
            "the first and the last population over the searched variables",
            f"The population at the start and at the end. {dark}",
        )
        pictures["convergence"] = still(
            study_figures.convergence(results, limits),
            "smallest and median margins of the population against the generation",
            "The population's margins from generation to generation.",
        )
    if repeated is not None:
        pilots = [
            (name, outcome)
            for name, outcome in (("nominal pilot", repeated.nominal), ("worst pilot", repeated.worst))
            if isinstance(outcome, Evaluation)
        ]
        if pilots:
            names = " and ".join(name for name, _ in pilots)
            pictures["nyquist"] = still(
                loop_figures.nyquist(pilots),
                f"Nyquist curves of the {names}",
                "Nyquist curves around the critical point −1 (+). Grey markers: crossings that do not set a margin; "
                "pale curve: ω < 0.",
            )
            pictures["bode"] = still(
                loop_figures.bode(pilots),
                f"Bode diagrams of the {names}",
                f"Biodynamic feedthrough (motion of the grip of the {ends.control} per acceleration of the seat in "
                f"{ends.input}, with washout) and loop.",
            )
    return pictures


def _plane_caption(results: StudyResults) -> str:
    robust = results.searched_quantiles
    if robust:
        across, up = (quantity(name).name for name in study_figures.plane_of(results))
        return f"Across: the {across}, over draws of what is not known of a pilot; up: the {up}."
    if PHASE_MARGIN.key not in study_figures.shown_margins(results):
        return (
            "Gain against modulus margin (the smallest distance of L from −1). The phase margin is infinite for every "
            "pilot of this study: |L| never reaches 1."
        )
    return (
        "Gain against phase margin. “none”: the loop has no such crossing and the margin is infinite. "
        "Negative margins: the closed loop is unstable."
    )


def _curves_caption(results: StudyResults, with_curves: bool) -> str:
    robust = results.searched_quantiles
    dots = (
        "Blue: the first population, which covers the box evenly; grey: later pilots, which the search drew from where "
        "margins are small"
        if len(results.members)
        else "Grey: the pilots of the sample"
    )
    return f"{'Nominal margins' if robust else 'Margins'} against each variable. {dots}" + (
        "; orange: the worst pilot with this one variable changed, all others held." if with_curves else "."
    )


# ---- tables and sentences


def _settings(study: Study, results: StudyResults, region: Region | None) -> list[tuple[str, str]]:
    box = "; ".join(
        f"{quantity(name).name} {low:g} to {high:g} {quantity(name).unit}".rstrip()
        for name, low, high in zip(results.names, results.lower, results.upper, strict=True)
    )
    attributes = results.attributes
    said = [
        ("study", str(attributes["study_name"])),
        ("rotorcraft", study.rotorcraft.name),
        ("loop", study.loop.words),
        (
            "pilot model",
            "multibody, generated decks" if study.pilot.model == "multibody" else "Mayo's transfer function",
        ),
        ("search box", box)
        if region is None
        else ("search in", f"the region that holds {region.text}, distance up to {region.radius:.3f}: {box}"),
        (
            "evaluations",
            f"{len(results.columns['status'])}, of which {int((results.columns['status'] != 'ok').sum())} failed",
        ),
        ("stopped by", str(attributes["stopped_by"])),
        ("seed", str(attributes["seed"])),
        ("pilotgen", str(attributes["pilotgen_version"])),
        ("solver", str(attributes["solver_version"])),
        ("fingerprint", str(attributes["fingerprint"])),
    ]
    if len(results.members):
        said.insert(5, ("generations", f"{len(results.members)} of {results.members.shape[1]} pilots"))
    return said


def _nominal_sentence(study: Study, repeated: Repeated | None) -> str | None:
    if repeated is None:
        return None
    values = ", ".join(quantity(name).text(value) for name, value in study.nominal.items())
    if isinstance(repeated.nominal, FailedEvaluation):
        return (
            f"The nominal pilot ({values}) could not be evaluated: {repeated.nominal.stage}: {repeated.nominal.reason}"
        )
    loop = repeated.nominal.result["loop"]
    state = "stable" if loop["stable"] else "UNSTABLE"
    told = typeset(margins_text(repeated.nominal.result))
    return f"For comparison, the nominal pilot ({values}): {state}, {told}."


def _caveats(
    study: Study, rows: Sequence[Mapping[str, Any]] | None, worst: int | None, repeated: Repeated | None
) -> list[str]:
    """What limits the worst pilot's result."""
    if worst is None:
        return []
    if rows is not None:
        return caveats(study, rows[worst])
    return caveats(study, repeated.worst.result) if repeated else []


def _front_ranges(results: StudyResults, front: np.ndarray) -> str | None:
    """The range of every variable over the first front."""
    if len(front) < 2:
        return None
    inputs = results.columns["inputs"][front]
    parts = []
    for j, name in enumerate(results.names):
        low, high = (f"{value:.3g}" for value in (inputs[:, j].min(), inputs[:, j].max()))
        span = low if low == high else f"{low} to {high}"
        parts.append(f"{quantity(name).name} {span} {quantity(name).unit}".rstrip())
    return "; ".join(parts)


def _worst_table(results: StudyResults, order: np.ndarray, solver: str) -> dict[str, Any]:
    columns = results.columns
    chosen = findings.distinct(results, order, TABLE_ROWS)
    derived = [name for name in DERIVED if name not in results.names and np.isfinite(columns[name][chosen]).any()]
    heads = [quantity(name).axis for name in results.names] + [DERIVED[name][0] for name in derived]
    robust = results.searched_quantiles
    heads += [row.heading for row in robust]
    for row in OBJECTIVES.values():
        heads += [f"nominal {row.heading}" if robust else row.heading] + (["at [Hz]"] if row in MARGINS else [])
    heads += ["closed loop", *(["how rare"] if DISTANCE in columns else [])]
    lines = []
    for k in chosen.tolist():
        cells = [f"{value:.4g}" for value in columns["inputs"][k]]
        cells += [typeset_number(float(columns[name][k]), DERIVED[name][1]) for name in derived]
        cells += [typeset_number(float(columns[row.key][k]), row.digits) for row in robust]
        for row in OBJECTIVES.values():
            cells.append(typeset_number(float(columns[row.key][k]), row.digits))
            if row in MARGINS:
                hz = float(columns[row.at][k])
                cells.append(typeset_number(hz, 2) if np.isfinite(hz) else "–")
        cells.append("stable" if columns["stable"][k] == 1 else "UNSTABLE")
        if DISTANCE in columns:
            cells.append(one_in(beyond(float(columns[DISTANCE][k]))))
        lines.append({"cells": cells, "replay": replay(results, k, STUDY_FILE, solver)})
    return {"heads": heads, "lines": lines}


def _percent(share: float) -> str:
    return f"{share:.0f} %" if share >= 10.0 else f"{share:.2g} %"


def _failure_table(results: StudyResults, solver: str) -> list[dict[str, Any]]:
    total = len(results.columns["status"])
    return [
        {
            "stage": failure.stage,
            "reason": failure.reason,
            "count": failure.count,
            "share": _percent(100.0 * failure.count / total),
            "replay": replay(results, failure.example, STUDY_FILE, solver),
        }
        for failure in findings.failures(results)
    ]
