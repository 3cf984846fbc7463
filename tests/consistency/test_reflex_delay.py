"""A delayed reflex: against full-order solves with the delay itself, and an independent model's numbers.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pilotgen.context import EvaluationContext
from pilotgen.errors import EvaluationError, StudyError
from pilotgen.evaluation import Evaluation, evaluate, feedthrough_of, solve_pilot
from pilotgen.linear.reflex_delay import delayed_full_order_response, pade
from pilotgen.study.study import read_study, study_from_text
from pilotgen.virtual.identify import identify

STUDY = Path(__file__).parents[2] / "docs" / "studies" / "puma-bmi.yaml"
MESOMORPHIC = {"age_years": 35.0, "stature_m": 1.80, "mass_kg": 86.0}
RIGID = {"pilot.torso.model": "rigid"}
OMEGA = 2.0 * np.pi * np.geomspace(0.1, 20.0, 41)


@pytest.fixture(scope="module")
def context(mbdae: Path) -> EvaluationContext:
    with EvaluationContext(read_study(STUDY), mbdae=str(mbdae)) as context:
        yield context


@pytest.mark.parametrize("order", range(1, 7))
def test_pade_has_the_gain_of_a_delay_and_its_phase_at_low_frequency(order: int) -> None:
    A, B, C, D = pade(0.02, order)
    for w in (1e-3, 1.0, 10.0, 300.0):
        value = C @ np.linalg.solve(1j * w * np.eye(order) - A, B) + D
        assert abs(value) == pytest.approx(1.0, abs=1e-9)  # an all-pass, as the delay
        if w <= 10.0:
            # the error of the diagonal approximant is of order (w T)^(2 m + 1)
            assert abs(value - np.exp(-0.02j * w)) < (0.02 * w) ** (2 * order + 1) + 1e-12
    assert np.linalg.eigvals(A).real.max() < 0.0


@pytest.mark.parametrize("torso", ["lumped", "rigid"])
def test_the_feedthrough_is_that_of_the_full_order_model_with_the_delay(context: EvaluationContext, torso: str) -> None:
    late = {"pilot.torso.model": torso, "pilot.reflex_delay_s": 0.025, "pilot.reflex_undelayed_share": 0.3}
    pilot = solve_pilot(context, {**context.study.values({}), **late, "pilot.reflex_pade_order": 5})
    model, checks = feedthrough_of(pilot)
    assert checks["certificate"] < 1e-9
    assert checks["pade_error"] < 1e-4
    assert pilot.matrices is not None and pilot.without_reflex is not None
    exact = delayed_full_order_response(pilot.matrices, pilot.without_reflex, OMEGA, 0.025, 0.3)
    np.testing.assert_allclose(model.response(OMEGA, washout=False), exact, rtol=1e-4)
    without, _ = feedthrough_of(solve_pilot(context, {**context.study.values({}), "pilot.torso.model": torso}))
    assert np.abs(without.response(OMEGA, washout=False) / exact - 1.0).max() > 0.1  # the delay matters


def test_no_delay_or_no_delayed_share_is_the_pilot_as_he_is(context: EvaluationContext) -> None:
    usual = evaluate(context, context.study.values({})).result
    early = {"pilot.reflex_delay_s": 0.03, "pilot.reflex_undelayed_share": 1.0}
    same = evaluate(context, {**context.study.values({}), **early}).result
    assert same["loop"] == usual["loop"]
    assert "pade_error" not in usual["bdft"] and same["bdft"]["pade_error"] < 1e-9


@pytest.mark.parametrize(
    ("delay_s", "kp", "kd", "grip_mm", "phase_deg", "gain_margin_db"),
    [(0.015, 1.64, 0.238, 2.25, 127, 10.9), (0.025, 1.29, 0.264, 2.76, 121, 8.8), (0.035, 0.92, 0.272, 3.40, 109, 6.7)],
)
def test_an_independent_model_finds_the_same_with_a_rigid_torso(
    context: EvaluationContext,
    delay_s: float,
    kp: float,
    kd: float,
    grip_mm: float,
    phase_deg: float,
    gain_margin_db: float,
) -> None:
    # a numpy model of the mesomorphic pilot with the whole reflex delayed, written without this program; its gains are
    # those with which the dominant poles are Mayo's
    values = {
        **MESOMORPHIC,
        **RIGID,
        "pilot.reflex.proportional_gain": kp,
        "pilot.reflex.derivative_gain": kd,
        "pilot.reflex_delay_s": delay_s,
        "pilot.reflex_undelayed_share": 0.0,
    }
    found = evaluate(context, values)
    assert isinstance(found, Evaluation)
    grip = complex(found.pilot_model.grip_motion(6.0 * np.pi))
    assert 1e3 * abs(grip) == pytest.approx(grip_mm, rel=0.02)
    assert np.degrees(np.angle(grip)) == pytest.approx(phase_deg, abs=1.5)
    assert found.margins.gain_margin_db == pytest.approx(gain_margin_db, abs=0.15)


def test_what_knows_no_delay_refuses_it(context: EvaluationContext) -> None:
    text = STUDY.read_text(encoding="utf-8").replace("limbs: [left] ", "projection: literal\n  reflex_delay_s: 0.02 #")
    with pytest.raises(StudyError, match=r"reflex_delay_s = 0.02 needs pilot.projection = 'exact'"):
        study_from_text(text)
    with pytest.raises(EvaluationError, match="has no delay"):
        identify(context, {**context.study.values({}), "pilot.reflex_delay_s": 0.02}, ("direct",))
