"""`pilot.torso.model: modes`: the spine of 17 levels in component modes, from the study to the margins.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pilotgen.context import EvaluationContext
from pilotgen.evaluation import Evaluation, SolvedPilot, evaluate, solve_pilot
from pilotgen.linear.feedthrough import certificate, make_pilot_model
from pilotgen.study.sections import calibrated_gains
from pilotgen.study.study import read_study
from pilotgen.virtual.calibration import FITTED, CalibrationPilot, reference_study, references, seen_by_mayo

STUDY = Path(__file__).parents[2] / "docs" / "studies" / "puma-bmi.yaml"
NOMINAL = {"age_years": 40.0, "bmi": 24.0, "stature_m": 1.775}
GAINS = calibrated_gains("modes")["position"]
OMEGA = 2.0 * np.pi * np.array([1.0, 2.0, 3.0, 3.5, 4.0, 5.0, 6.0])


@pytest.fixture(scope="module")
def context(mbdae: Path) -> Iterator[EvaluationContext]:
    study, _ = read_study(STUDY).with_values({"pilot.torso.model": "modes"})
    with EvaluationContext(study, mbdae=str(mbdae)) as context:
        yield context


@pytest.fixture(scope="module")
def pilot(context: EvaluationContext, tmp_path_factory: pytest.TempPathFactory) -> SolvedPilot:
    return solve_pilot(context, NOMINAL, tmp_path_factory.mktemp("modes"))


def grip(pilot: SolvedPilot) -> np.ndarray:
    assert pilot.matrices is not None
    return np.asarray(make_pilot_model(pilot.matrices, lever_length_m=0.32).grip_motion(OMEGA))


def test_the_posture_is_the_equilibrium(context: EvaluationContext, pilot: SolvedPilot) -> None:
    assert pilot.matrices is not None
    assert np.abs(pilot.matrices.equilibrium_residual).max() < 1e-8
    lumped = solve_pilot(context, {**NOMINAL, "pilot.torso.model": "lumped"})
    assert pilot.activations.values == pytest.approx(lumped.activations.values, abs=1e-12)
    assert pilot.posture.angles_deg == lumped.posture.angles_deg
    assert certificate(make_pilot_model(pilot.matrices, lever_length_m=0.32)) < 1e-8


def test_modes_below_25_hz_are_enough_for_the_grip(context: EvaluationContext, pilot: SolvedPilot) -> None:
    exact = grip(solve_pilot(context, {**NOMINAL, "pilot.torso.modes_up_to_hz": 1000.0}))
    error = np.abs(grip(pilot) - exact).max() / np.abs(exact).max()
    assert error < 8e-3
    few = grip(solve_pilot(context, {**NOMINAL, "pilot.torso.modes_up_to_hz": 8.0}))
    assert np.abs(few - exact).max() / np.abs(exact).max() > 2.0 * error


def test_modes_and_lumped_torso_are_the_same_person(context: EvaluationContext, pilot: SolvedPilot) -> None:
    gains = {
        "pilot.reflex.proportional_gain": GAINS.proportional_gain,
        "pilot.reflex.derivative_gain": GAINS.derivative_gain,
    }
    ratio = grip(pilot) / grip(solve_pilot(context, {**NOMINAL, "pilot.torso.model": "lumped", **gains}))
    assert np.all(np.abs(np.abs(ratio) - 1.0) < 0.12)
    assert np.all(np.abs(np.degrees(np.angle(ratio))) < 10.0)


def test_springs_and_girdles_reach_the_spine(context: EvaluationContext) -> None:
    def margin(**changes: Any) -> float:
        found = evaluate(context, {**NOMINAL, **{key.replace("__", "."): value for key, value in changes.items()}})
        assert isinstance(found, Evaluation), found
        assert found.result["bdft"]["certificate"] < 1e-8
        return found.margins.gain_margin_db

    base = margin()
    assert 8.0 < base < 10.0  # lumped 9.1
    assert abs(margin(pilot__torso__lumbar__pitch_n_m_per_rad=400.0) - base) > 1e-3
    assert abs(margin(cockpit__seat__cushion__stiffness_n_per_m=80000.0) - base) > 0.1
    assert 1.0 < base - margin(pilot__torso__girdle__stiffness_n_per_m=20000.0) < 3.5


def test_both_arms_hang_on_the_spine(context: EvaluationContext) -> None:
    found = evaluate(context, {**NOMINAL, "pilot.limbs": ["left", "right"]})
    assert isinstance(found, Evaluation)
    assert found.result["bdft"]["certificate"] < 1e-8


def test_kept_files_are_complete(context: EvaluationContext, tmp_path: Path) -> None:
    kept = solve_pilot(context, NOMINAL, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} >= {"pilot.mbd", "torso.fem", "matrices.h5"}
    context.client.request("linearise", name=tmp_path / "pilot.mbd", output=tmp_path / "again.h5")
    assert (tmp_path / "pilot.mbd").read_text() == kept.deck
    assert (tmp_path / "again.h5").stat().st_size > 0


def test_shipped_gains_show_mayo_what_he_saw(mbdae: Path) -> None:
    study, _ = read_study(STUDY).with_values({"pilot.torso.model": "modes"})
    with EvaluationContext(reference_study(study), mbdae=str(mbdae)) as reference:
        person = CalibrationPilot(reference, references().pilots[FITTED].values)
        model = person.model(GAINS)
        frequency, damping, tau = seen_by_mayo(model)
        assert (frequency, damping) == pytest.approx((3.750, 0.28), rel=1e-5)
        assert 0.08 < tau < 0.15
        assert 1e3 * abs(complex(model.grip_motion(6.0 * np.pi))) == pytest.approx(3.5, rel=0.15)
