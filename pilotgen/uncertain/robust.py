"""The draws of one pilot in a robust search: margins of each, of which the objectives are quantiles.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses

from pilotgen.context import EvaluationContext
from pilotgen.evaluation import Evaluation, FailedEvaluation
from pilotgen.objectives import OBJECTIVES, ROBUST
from pilotgen.uncertain.draws import Draws

MOST_FAILED = 0.1  # share of the draws: a pilot of whom more fail has failed


def with_draws(context: EvaluationContext, draws: Draws, pilot: Evaluation) -> Evaluation | FailedEvaluation:
    """Evaluate all draws of a pilot; his result gets the key `robust` (docs/io_formats/result.md).

    A draw that fails has no margin. A pilot fails with it, at stage `uncertain`, if more than a tenth of the draws do:
    a quantile of the others would be of other people.
    """
    keys = draws.study.robust
    margins: dict[str, list[float | None]] = {key: [] for key in keys}
    stages: dict[str, int] = {}
    example = ""
    for k in range(draws.count):
        outcome = draws.evaluate(context, k, pilot.values)
        ok = isinstance(outcome, Evaluation)
        for key in keys:
            margins[key].append(OBJECTIVES[key].finite(outcome.result) if ok else None)
        if isinstance(outcome, FailedEvaluation):
            stages[outcome.stage] = stages.get(outcome.stage, 0) + 1
            example = example or outcome.reason
    failed = sum(stages.values())
    if failed > MOST_FAILED * draws.count:
        told = ", ".join(f"{count} at {stage}" for stage, count in sorted(stages.items()))
        return FailedEvaluation(
            pilot.values, "uncertain", f"{failed} of {draws.count} draws failed, more than a tenth: {told}; {example}"
        )
    found = {
        "draws": draws.count, "failed": failed, "failed_by_stage": dict(sorted(stages.items())), "margins": margins,
    }  # fmt: skip
    return dataclasses.replace(pilot, result={**pilot.result, ROBUST: found})
