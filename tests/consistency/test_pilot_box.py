"""Sensible pilots: certificates over both search boxes and sexes, and trends that physics demands.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from whole_pilots import WholePilot, body_of, cockpit_of, heavier, solve, stronger

from pilotgen.activation.reflex import calibrated_gains
from pilotgen.context import EvaluationContext
from pilotgen.evaluation import Evaluation, FailedEvaluation, evaluate, solve_pilot
from pilotgen.linear.feedthrough import certificate
from pilotgen.posture.cockpit import make_cockpit
from pilotgen.solver.client import SolverClient
from pilotgen.study.sections import Reflex
from pilotgen.study.study import Study, read_study
from pilotgen.virtual.calibration import grip_mass, grip_stiffness

STUDIES = Path(__file__).parents[2] / "docs" / "studies"
PILOTS = 12  # of each box and sex; 1600 were run once, docs/validation.md


def study_of(name: str, torso: str = "rigid") -> Study:
    return read_study(STUDIES / f"{name}.yaml").with_values({"pilot.torso.model": torso})[0]


@pytest.mark.parametrize("torso", ["rigid", "lumped"])
@pytest.mark.parametrize("sex", ["male", "female"])
@pytest.mark.parametrize("name", ["puma-bmi", "puma-mass"])
def test_random_pilots_are_certified_and_stable(mbdae: Path, name: str, sex: str, torso: str) -> None:
    study = study_of(name, torso)
    study = dataclasses.replace(study, pilot=dataclasses.replace(study.pilot, sex=sex))
    low, high = np.array(list(study.search.variables.values())).T
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    points = np.vstack([corners, np.random.default_rng(23).uniform(low, high, (PILOTS, 3))])
    with EvaluationContext(study, mbdae=str(mbdae)) as context:
        for point in points:
            outcome = evaluate(context, dict(zip(study.search.variables, point.tolist(), strict=True)))
            if isinstance(outcome, FailedEvaluation) and name == "puma-mass" and torso == "lumped":
                assert outcome.stage == "torso" and "outside 3.2 to 7 Hz" in outcome.reason  # 1.55 m and 110 kg
                continue
            assert isinstance(outcome, Evaluation), outcome
            assert outcome.result["bdft"]["certificate"] < 1e-8
            assert outcome.pilot_model.poles.real.max() < -1.0  # 1/s: settles within seconds
            frequency, damping = outcome.pilot_model.dominant_pair()
            assert (2.3 < frequency < 5.5 and 0.15 < damping < 0.45) or torso == "lumped"
            assert 0.1 < outcome.result["bdft"]["grip_motion_3hz_mm_per_m_s2"] < 6.0


@pytest.mark.parametrize("limbs", [("left",), ("left", "right")])
def test_the_posture_does_not_depend_on_how_far_the_guess_goes(
    mbdae: Path, limbs: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    study = study_of("puma-mass")
    study = dataclasses.replace(study, pilot=dataclasses.replace(study.pilot, limbs=limbs))
    low, high = np.array(list(study.search.variables.values())).T
    points = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    pilots = [dict(zip(study.search.variables, point.tolist(), strict=True)) for point in points]
    with EvaluationContext(study, mbdae=str(mbdae)) as context:
        short = [solve_pilot(context, pilot, linearise=False).posture for pilot in pilots]
        monkeypatch.setattr("pilotgen.posture.posture._GUESS_SETTLED_RAD", 1e-3)
        monkeypatch.setattr("pilotgen.posture.posture._GUESS_CLOSED_M", 1e-5)
        long = [solve_pilot(context, pilot, linearise=False).posture for pilot in pilots]
    for one, other in zip(short, long, strict=True):
        assert one.angles_deg == pytest.approx(other.angles_deg, abs=1e-8)


def test_the_nominal_pilot_is_like_mayo_s(mbdae: Path) -> None:
    study = read_study(STUDIES / "puma-bmi.yaml")
    with EvaluationContext(study, mbdae=str(mbdae)) as context:
        outcome = evaluate(context, study.nominal)
    assert isinstance(outcome, Evaluation)
    bdft = outcome.result["bdft"]
    assert 3.0 < bdft["dominant_frequency_hz"] < 4.5
    assert 0.2 < bdft["dominant_damping"] < 0.45
    assert 0.5 < bdft["grip_motion_3hz_mm_per_m_s2"] < 5.0


# ---- trends


@pytest.fixture(scope="module")
def nominal(solver: SolverClient, tmp_path_factory: pytest.TempPathFactory) -> WholePilot:
    return solve(solver, tmp_path_factory.mktemp("nominal"), body_of())


def frequency(pilot: WholePilot) -> float:
    return pilot.model.dominant_pair()[0]


def motion_mm(pilot: WholePilot, hz: float) -> float:
    return 1e3 * abs(complex(pilot.model.grip_motion(2.0 * math.pi * hz)))


def test_a_heavier_arm_swings_slower_and_more(solver: SolverClient, tmp_path: Path, nominal: WholePilot) -> None:
    """Fixed strength and gains; the stiffness changes little (weight takes more activation), the mass as told."""
    pilots = [solve(solver, tmp_path, heavier(nominal.body, factor)) for factor in (0.8, 1.0, 1.25, 1.5)]
    assert np.all(np.diff([frequency(pilot) for pilot in pilots]) < -0.1)
    assert np.all(np.diff([motion_mm(pilot, 2.0) for pilot in pilots]) > 0.0)
    mass = [grip_mass(pilot.model) for pilot in pilots]
    lever = mass[1] - (mass[2] - mass[1]) / 0.25  # what is left without an arm
    assert lever == pytest.approx(0.05 / 0.32**2, rel=1e-3)
    assert pilots[1].model.poles == pytest.approx(nominal.model.poles, rel=1e-9)


def test_stronger_muscles_are_stiffer(solver: SolverClient, tmp_path: Path, nominal: WholePilot) -> None:
    pilots = [solve(solver, tmp_path, stronger(nominal.body, factor)) for factor in (0.7, 1.0, 1.4)]
    assert np.all(np.diff([frequency(pilot) for pilot in pilots]) > 0.2)
    assert np.all(np.diff([grip_stiffness(pilot.model) for pilot in pilots]) > 0.0)
    assert np.all(np.diff([motion_mm(pilot, 1.0) for pilot in pilots]) < 0.0)
    # the same load on stronger muscles
    assert np.all(np.diff([pilot.activations.largest for pilot in pilots]) < 0.0)


def test_reflexes_stiffen_and_damp(solver: SolverClient, tmp_path: Path, nominal: WholePilot) -> None:
    Kp, Kd = dataclasses.astuple(calibrated_gains("rigid")["position"])
    by_Kp = [solve(solver, tmp_path, nominal.body, gains=Reflex(factor * Kp, Kd)) for factor in (0.5, 1.0, 1.5)]
    assert np.all(np.diff([frequency(pilot) for pilot in by_Kp]) > 0.3)
    by_Kd = [solve(solver, tmp_path, nominal.body, gains=Reflex(Kp, factor * Kd)) for factor in (0.5, 1.0, 1.5)]
    assert np.all(np.diff([pilot.model.dominant_pair()[1] for pilot in by_Kd]) > 0.05)
    assert [frequency(pilot) for pilot in by_Kd] == pytest.approx([frequency(nominal)] * 3, rel=0.01)


def test_without_reflexes_the_arm_falls(solver: SolverClient, tmp_path: Path, nominal: WholePilot) -> None:
    bare = solve(solver, tmp_path, nominal.body, gains=Reflex(0.0, 0.0))
    assert bare.model.poles.real.max() > 0.5


def test_a_heavier_lever_swings_slower(solver: SolverClient, tmp_path: Path, nominal: WholePilot) -> None:
    pilots = [
        solve(solver, tmp_path, nominal.body, cockpit_of(nominal.body, {"collective": {"inertia_kg_m2": J}}))
        for J in (0.02, 0.05, 0.10)
    ]
    assert np.all(np.diff([frequency(pilot) for pilot in pilots]) < -0.1)


def test_tall_pilots_swing_slower_and_more(solver: SolverClient, tmp_path: Path) -> None:
    """Same build: mass grows faster than strength, and the grip moves away from the shoulder's lever arms."""
    pilots = [
        solve(solver, tmp_path, body_of({"age_years": 40.0, "bmi": 24.0, "stature_m": stature}))
        for stature in (1.60, 1.70, 1.80, 1.90, 2.00)
    ]
    assert np.all(np.diff([frequency(pilot) for pilot in pilots]) < -0.1)
    assert np.all(np.diff([motion_mm(pilot, 2.0) for pilot in pilots]) > 0.0)


def test_old_age_and_female_muscle_make_a_slower_arm(solver: SolverClient, tmp_path: Path, nominal: WholePilot) -> None:
    values = {"age_years": 40.0, "bmi": 24.0, "stature_m": 1.70}
    man = solve(solver, tmp_path, body_of(values))
    woman = solve(solver, tmp_path, body_of(values, sex="female"))
    old_man = solve(solver, tmp_path, body_of({**values, "age_years": 65.0}))
    assert woman.body.strength_factor < man.body.strength_factor
    assert frequency(woman) < frequency(man) - 0.1
    assert frequency(old_man) < frequency(man) - 0.05


def test_a_longer_lever_turns_less(solver: SolverClient, tmp_path: Path, nominal: WholePilot) -> None:
    """The grip is where it was, the hinge farther away: nearly the same grip motion, a smaller rotation."""
    rotation = []
    for length in (0.27, 0.35):
        cockpit = make_cockpit(nominal.body, lever_length_m=length, position=0.5)
        pilot = solve(solver, tmp_path, nominal.body, cockpit)
        rotation.append(abs(complex(pilot.model.response(2.0 * math.pi * 3.0))))
    assert rotation[1] < rotation[0]
    assert certificate(nominal.model) < 1e-8
