"""Bounds and objectives of a search.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pilotgen.objectives import OBJECTIVES, ranked_objectives
from pilotgen.search.problem import Problem
from pilotgen.study.study import read_study

STUDIES = Path(__file__).parents[2] / "docs" / "studies"
BOTH = ("gain_margin_db", "phase_margin_deg")


def test_problem_of_a_study_keeps_the_order_of_the_file() -> None:
    problem = Problem.from_settings(read_study(STUDIES / "puma-bmi.yaml").search)
    assert problem.names == ("age_years", "bmi", "stature_m")
    np.testing.assert_array_equal(problem.xl, [25, 18, 1.55])
    np.testing.assert_array_equal(problem.xu, [65, 30, 2.0])
    assert (problem.n_var, problem.n_obj) == (3, 2)
    assert problem.values(np.array([40.0, 24.0, 1.8])) == {"age_years": 40.0, "bmi": 24.0, "stature_m": 1.8}


def test_margins_are_capped_for_ranking_only() -> None:
    stable = {"stable": True, "gain_margin_db": 6.4, "phase_margin_deg": None, "modulus_margin": 0.5}
    assert ranked_objectives({"loop": stable}, BOTH) == [6.4, 180.0]
    assert ranked_objectives({"loop": {**stable, "gain_margin_db": 75.0}}, BOTH) == [60.0, 180.0]
    assert ranked_objectives({"loop": {**stable, "gain_margin_db": float("inf")}}, BOTH) == [60.0, 180.0]
    assert ranked_objectives({"loop": stable}, ("modulus_margin", "gain_margin_db")) == [0.5, 6.4]


def test_an_unstable_loop_is_always_worse_than_a_stable_one() -> None:
    unstable = {"stable": False, "gain_margin_db": None, "phase_margin_deg": -12.0, "modulus_margin": 0.5}
    assert ranked_objectives({"loop": unstable}, BOTH) == [-60.0, -12.0]
    assert ranked_objectives({"loop": unstable}, ("modulus_margin",)) == [-0.5]


def test_every_objective_of_the_study_file_can_be_ranked() -> None:
    result: dict[str, dict[str, float]] = {"loop": {"stable": True}}
    for row in OBJECTIVES.values():
        result.setdefault(row.section, {})[row.key] = 1.0
    assert len(ranked_objectives(result, tuple(OBJECTIVES))) == len(OBJECTIVES)
