"""Small studies of Mayo's pilots with study.h5, for tests of what is made of them.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pilotgen.context import EvaluationContext
from pilotgen.evaluation import evaluate
from pilotgen.objectives import ranked_objectives
from pilotgen.runs.results import Row, StudyResults, columns_of, read_results, write_results
from pilotgen.search.problem import Problem
from pilotgen.search.ranking import non_dominated_rank
from pilotgen.study.study import Study, study_from_text

BOX = {
    "pilot_frequency_hz": "[2.5, 4.0]",
    "pilot_damping": "[0.20, 0.50]",
    "pilot_time_constant_s": "[0.060, 0.120]",
}
FAILED = {"status": "failed", "stage": "posture", "reason": "wrist <48 deg> & beyond its range of 30 deg"}


def mayo_study(variables: int = 3, name: str = "small") -> Study:
    """A study of Mayo's mesomorphic pilot that varies the first `variables` of his three values."""
    box = ", ".join(f"{key}: {BOX[key]}" for key in list(BOX)[:variables])
    return study_from_text(
        f"# <script>alert(1)</script>\nstudy: {name}\nrotorcraft: iar330-puma\n"
        "inceptor: {lever_length_m: 0.32, gearing_rad_per_m: 1.1}\n"
        "pilot: {model: mayo}\nnominal: mesomorphic\n"
        f"search: {{variables: {{{box}}}, population: 8, generations: 3, seed: 5}}\n"
    )


def write_study(
    directory: Path,
    study: Study,
    generations: int = 3,
    population: int = 8,
    failed: Sequence[int] = (),
    kind: str = "search",
) -> StudyResults:
    """Evaluate pilots that close in on the lower corner of the box and write study.h5; `failed` rows failed."""
    problem = Problem.from_settings(study.search)
    rng = np.random.default_rng(7)
    rows: list[Row] = []
    with EvaluationContext(study) as context:
        for generation in range(generations):
            reach = 0.5**generation
            for individual in range(population):
                x = problem.xl + reach * rng.random(problem.n_var) * (problem.xu - problem.xl)
                values = problem.values(x)
                result: Mapping[str, Any] = evaluate(context, study.values(values)).result
                if len(rows) in failed:
                    result = FAILED
                rows.append(Row(generation, individual, values, result))
    F = np.full((len(rows), problem.n_obj), np.nan)
    for k, row in enumerate(rows):
        if row.result["status"] == "ok":
            F[k] = ranked_objectives(row.result, problem.objectives)
    rank = np.where(np.isnan(F[:, 0]), 0, non_dominated_rank(F))
    members = np.arange(len(rows)).reshape(generations, population)
    last = members[-1]
    front = last[(non_dominated_rank(F[last]) == 1) & ~np.isnan(F[last, 0])]
    attributes = {
        "kind": kind,
        "pilotgen_version": "0",
        "solver_version": "none",
        "fingerprint": "0" * 64,
        "seed": 5,
        "study_name": study.name,
        "study_text": study.text,
        "stopped_by": "generation limit",
    }
    path = directory / "study.h5"
    search = kind == "search"
    write_results(
        path, attributes, problem.names, problem.xl, problem.xu, problem.objectives,
        columns_of(rows, problem.names, F, rank if search else None),
        members if search else None, front if search else None,
    )  # fmt: skip
    return read_results(path)
