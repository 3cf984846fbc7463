"""A page of 3,000 pilots: below 6 MB, and there in less than two seconds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser.conftest import Made

from pilotgen.context import EvaluationContext
from pilotgen.evaluation import Evaluation, evaluate
from pilotgen.figures.study import Curve
from pilotgen.objectives import OBJECTIVES
from pilotgen.report.findings import first_front, worst_order
from pilotgen.report.page import render
from pilotgen.report.people import Known
from pilotgen.report.repeated import Repeated
from pilotgen.runs.results import StudyResults

PILOTS, MOST_BYTES, MOST_SECONDS = 3000, 5_600_000, 2.0  # figures of all their dots have 0.4 MB more


@pytest.fixture(scope="module")
def large(made: Made, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of the small study, its pilots repeated to 3,000 with slightly other numbers."""
    small, rng = made.results, np.random.default_rng(3)
    rows = np.resize(np.flatnonzero(small.columns["status"] == "ok"), PILOTS)
    columns = {}
    for name, column in small.columns.items():
        columns[name] = column[rows].copy()
        if column.dtype.kind == "f":
            columns[name] *= 1.0 + 1e-3 * rng.standard_normal(columns[name].shape)
    members = np.arange(PILOTS).reshape(30, -1)
    results = StudyResults(
        small.attributes, small.names, small.lower, small.upper, small.objective_names, columns, members, members[-1]
    )
    with EvaluationContext(made.study) as context:
        nominal = evaluate(context, made.study.nominal)
        assert isinstance(nominal, Evaluation)
        terms = nominal.result
        nothing = {key: np.full(2, np.nan) for key in OBJECTIVES}
        curves = tuple(Curve(name, np.array([0.0, 1.0]), nothing) for name in results.names)
        known = [Known(k, nominal) for k in range(0, PILOTS, 12)]  # 250
        text = render(
            made.study, results, worst_order(results), first_front(results), [terms] * PILOTS,
            Repeated(nominal, nominal, curves, True), None, known=known,
        )  # fmt: skip
    path = tmp_path_factory.mktemp("large") / "report.html"
    path.write_text(text)
    return path


def test_a_page_of_3000_pilots(large: Path, browser: Any) -> None:
    assert large.stat().st_size < MOST_BYTES
    context = browser.new_context(viewport={"width": 1400, "height": 900})
    page = context.new_page()
    devtools = context.new_cdp_session(page)
    devtools.send("Performance.enable", {"timeDomain": "threadTicks"})  # work done, whatever else the machine does
    page.goto(large.as_uri())
    page.wait_for_function("document.documentElement.dataset.ready", timeout=60_000)
    assert page.evaluate("pilotgen.model.data.count") == PILOTS
    page.evaluate("pilotgen.wake()")  # the 3-D view, too
    metrics = {one["name"]: one["value"] for one in devtools.send("Performance.getMetrics")["metrics"]}
    assert metrics["TaskDuration"] < MOST_SECONDS
    assert (
        page.evaluate("pilotgen.model.data.skeletons.each ? Object.keys(pilotgen.model.data.skeletons.each).length : 0")
        > 100
    )
    context.close()
