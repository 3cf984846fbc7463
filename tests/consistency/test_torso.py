"""The torso on its springs: against an independent account of it, seat-vibration data, its limits and its trends.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from torso_model import TorsoModel

from pilotgen.anthropometry.biometrics import Biometrics
from pilotgen.anthropometry.torso import TorsoSpring, make_torso
from pilotgen.bench.stages import random_pilots
from pilotgen.context import EvaluationContext
from pilotgen.decks.deck import GRAVITY_M_PER_S2, render_direct
from pilotgen.errors import EvaluationError
from pilotgen.evaluation import (
    PILOT_DECK,
    Evaluation,
    FailedEvaluation,
    SolvedPilot,
    evaluate,
    linearise_direct,
    solve_pilot,
)
from pilotgen.linear.feedthrough import certificate, make_pilot_model
from pilotgen.posture.seated_torso import SeatedTorso, seat_torso
from pilotgen.solver.mbdyn_check import check_mbdyn
from pilotgen.study.sections import calibrated_gains
from pilotgen.study.study import Study, read_study
from pilotgen.study.torso_numbers import torso_from

STUDY = Path(__file__).parents[2] / "docs" / "studies" / "puma-bmi.yaml"
NOMINAL = {"age_years": 40.0, "bmi": 24.0, "stature_m": 1.775}
MESOMORPHIC = {"age_years": 35.0, "mass_kg": 86.0, "stature_m": 1.80}
GAINS = calibrated_gains("lumped")["position"]
Solve = Callable[..., SolvedPilot]


def changed(**settings: Any) -> Study:
    """The study with other numbers; `__` stands for the points of a path."""
    return read_study(STUDY).with_values({key.replace("__", "."): value for key, value in settings.items()})[0]


@pytest.fixture(scope="module")
def context(mbdae: Path) -> Iterator[EvaluationContext]:
    with EvaluationContext(read_study(STUDY), mbdae=str(mbdae)) as context:
        yield context


@pytest.fixture(scope="module")
def solve(context: EvaluationContext) -> Solve:
    """One pilot; `paths` are other numbers of the study."""

    def solved(values: dict[str, float] | None = None, **paths: Any) -> SolvedPilot:
        named = {key.replace("__", "."): value for key, value in paths.items()}
        return solve_pilot(context, {**(values or NOMINAL), **named})

    return solved


@pytest.fixture(scope="module")
def nominal(solve: Solve) -> SolvedPilot:
    return solve()


def model_of(pilot: SolvedPilot) -> Any:
    assert pilot.matrices is not None
    return make_pilot_model(pilot.matrices, lever_length_m=0.32)


def independent(pilot: SolvedPilot) -> TorsoModel:
    assert pilot.torso is not None
    return TorsoModel(pilot.body, pilot.cockpit, pilot.posture, pilot.torso)


# ---- against an account without solver, decks and projection ---------------------------------------------------------


@pytest.mark.parametrize(("values", "paths"), [(NOMINAL, {}), (MESOMORPHIC, {"cockpit__seat__cushion": "none"})])
def test_poles_and_feedthrough_of_an_independent_model(solve: Solve, values: dict, paths: dict) -> None:
    pilot = solve(values, **paths)
    theirs, ours = independent(pilot), model_of(pilot)
    activation = pilot.activations.values
    M, C, K, b, lever = theirs.reduced(activation, GAINS.proportional_gain, GAINS.derivative_gain)
    assert np.linalg.eigvalsh(C).min() > 0.0
    poles = theirs.poles(M, C, K)
    assert len(poles) == len(ours.poles)
    assert max(np.min(np.abs(ours.poles - pole)) / abs(pole) for pole in poles) < 1e-6
    for hz in (0.5, 1.0, 3.0, 4.0, 5.0, 8.0):
        s = 2j * np.pi * hz
        expected = 0.32 * complex(lever @ np.linalg.solve(M * s**2 + C * s + K, -b))
        assert complex(ours.grip_motion(2.0 * np.pi * hz)) == pytest.approx(expected, rel=1e-6)


def test_the_posture_is_the_equilibrium(nominal: SolvedPilot) -> None:
    assert nominal.matrices is not None
    assert np.abs(nominal.matrices.equilibrium_residual).max() < 1e-9  # N, N m; 1e-6 is wanted
    model = independent(nominal)
    forces = model.forces(np.zeros(model.size), nominal.activations.values, GAINS.proportional_gain)
    assert np.abs(forces[:-1]).max() < 1e-8


def test_posture_and_activations_are_those_of_the_rigid_torso(solve: Solve, nominal: SolvedPilot) -> None:
    rigid = solve(pilot__torso__model="rigid")
    assert rigid.torso is None
    assert rigid.activations.values == pytest.approx(nominal.activations.values, abs=1e-12)
    assert rigid.posture.angles_deg == nominal.posture.angles_deg


def test_masses_are_those_of_the_body(nominal: SolvedPilot) -> None:
    assert nominal.torso is not None
    torso = nominal.torso.torso
    shares = {row.name: row.mass_kg / nominal.biometrics.mass_kg for row in torso.bodies}
    # de Leva's fractions, added by hand
    assert shares == pytest.approx(
        {"pan": 0.01, "pelvis": 0.2533, "viscera": 0.08165, "thorax": 0.24125, "head": 0.0694}, abs=1e-12
    )
    assert torso.carried_arms == pytest.approx({"right": 0.6 * 0.0494 * nominal.biometrics.mass_kg})


# ---- limits ----------------------------------------------------------------------------------------------------------


def with_springs(context: EvaluationContext, pilot: SolvedPilot, change: Callable[[TorsoSpring], TorsoSpring]) -> Any:
    """The pilot's model with other springs under the same loads."""
    assert pilot.torso is not None and pilot.matrices is not None
    torso = dataclasses.replace(pilot.torso.torso, springs=tuple(map(change, pilot.torso.torso.springs)))
    text = render_direct(
        pilot.body,
        pilot.cockpit,
        pilot.posture,
        activations=pilot.activations,
        muscle_lengths=pilot.matrices.muscle_lengths,
        gains=GAINS,
        c=0.01,
        torso=dataclasses.replace(pilot.torso, torso=torso),
    )
    return make_pilot_model(linearise_direct(context, text, context.scratch), lever_length_m=0.32)


def test_stiff_springs_are_the_rigid_torso(context: EvaluationContext, solve: Solve, nominal: SolvedPilot) -> None:
    Kp, Kd = GAINS.proportional_gain, GAINS.derivative_gain
    rigid = model_of(
        solve(
            pilot__torso__model="rigid",
            pilot__reflex__proportional_gain=Kp,
            pilot__reflex__derivative_gain=Kd,
        )
    )
    stiff = with_springs(context, nominal, lambda spring: dataclasses.replace(spring, stiffness=(1e9,) * 6))
    omega = 2.0 * np.pi * np.array([0.5, 1.0, 3.0, 5.0, 8.0])
    assert stiff.grip_motion(omega) == pytest.approx(rigid.grip_motion(omega), rel=1e-4)


def test_without_reflex_every_mode_of_the_torso_alone_is_damped(nominal: SolvedPilot) -> None:
    """C of the torso is positive definite; so are its springs with the weights they carry."""
    model = independent(nominal)
    M, C, K, _, _ = model.reduced(nominal.activations.values, GAINS.proportional_gain, GAINS.derivative_gain)
    assert np.linalg.eigvalsh(C).min() > 0.0
    assert model.poles(M, C, K).real.max() < 0.0


# ---- people ----------------------------------------------------------------------------------------------------------


def apparent_mass(pilot: SolvedPilot) -> Callable[[np.ndarray], np.ndarray]:
    """Vertical force on the seat over its vertical acceleration [kg], by frequency [Hz], by the independent model."""
    model = independent(pilot)
    M, C, K, b, _ = model.reduced(pilot.activations.values, GAINS.proportional_gain, GAINS.derivative_gain)
    arms = sum(pilot.torso.torso.carried_arms.values()) if pilot.torso else 0.0
    total = sum(row.mass_kg for row in model.bodies) + arms + float(model.arm.masses().sum())

    def at(hz: np.ndarray) -> np.ndarray:
        s = 2j * np.pi * hz
        return np.array([total + z**2 * (b @ np.linalg.solve(M * z**2 + C * z + K, -b)) for z in s])

    return at


def resonance(pilot: SolvedPilot) -> tuple[float, float, float]:
    """Peak of the apparent mass [Hz], its ratio to the static mass, and the mass at 1 Hz over that of the body."""
    at = apparent_mass(pilot)
    hz = np.arange(3.0, 7.5, 0.05)
    modulus = np.abs(at(hz))
    static, at_1_hz = np.abs(at(np.array([0.2, 1.0])))
    return float(hz[modulus.argmax()]), float(modulus.max() / static), float(at_1_hz) / pilot.biometrics.mass_kg


BARE = {  # a rigid seat without back, as in laboratories
    "cockpit__seat__cushion": "none",
    "cockpit__seat__back__normal_n_per_m": 100.0,
    "cockpit__seat__back__tangential_n_per_m": 0.0,
    "cockpit__seat__back__normal_n_s_per_m": 0.0,
    "cockpit__seat__back__tangential_n_s_per_m": 0.0,
}


def test_apparent_mass_of_the_nominal_man(solve: Solve) -> None:
    """Fairley and Griffin 1989: 5 Hz, 1.5; bands of the accepted range."""
    hz, ratio, at_1_hz = resonance(solve(**BARE))
    assert hz == pytest.approx(5.0, abs=0.3)
    assert 1.4 < ratio < 1.7
    assert 0.70 * 1.04 < at_1_hz < 0.75 * 1.06


def test_resonance_follows_age_and_bmi(solve: Solve) -> None:
    def at(**values: float) -> float:
        return resonance(solve({**NOMINAL, **values}, **BARE))[0]

    assert (at(age_years=60.0) - at(age_years=20.0)) / 40.0 == pytest.approx(1.7 / 47.0, rel=0.2)
    assert (at(bmi=30.0) - at(bmi=19.0)) / 11.0 == pytest.approx(-1.7 / 16.0, rel=0.2)
    off = {"pilot__torso__age_trend": False}
    old, young = (resonance(solve({**NOMINAL, "age_years": age}, **BARE, **off))[0] for age in (60.0, 20.0))
    assert abs(old - young) < 0.11  # two steps of the grid


# ---- margins ---------------------------------------------------------------------------------------------------------


def gain_margin(context: EvaluationContext, **values: Any) -> float:
    found = evaluate(context, {key.replace("__", "."): value for key, value in values.items()})
    assert isinstance(found, Evaluation), found
    assert found.result["bdft"]["certificate"] < 1e-8
    return found.margins.gain_margin_db


def test_heavy_and_long_pilots_are_worse(context: EvaluationContext) -> None:
    body = {"age_years": 40.0, "stature_m": 1.775}
    light, heavy = (gain_margin(context, **body, mass_kg=mass) for mass in (60.0, 110.0))
    assert 2.0 < light - heavy < 6.0
    worst = gain_margin(context, age_years=25.0, bmi=30.0, stature_m=2.00)
    assert worst == pytest.approx(3.5, rel=0.15)
    rigid = [gain_margin(context, **body, mass_kg=mass, pilot__torso__model="rigid") for mass in (60.0, 110.0)]
    assert rigid[1] > rigid[0]  # without a torso mass acts the other way


def test_both_arms_couple_through_the_thorax(context: EvaluationContext, nominal: SolvedPilot, mbdae: Path) -> None:
    one = model_of(nominal)
    with EvaluationContext(changed(pilot__limbs=["left", "right"]), mbdae=str(mbdae)) as both:
        pilot = solve_pilot(both, NOMINAL)
    two = model_of(pilot)
    assert certificate(one) < 1e-8 and certificate(two) < 1e-8
    omega = 2.0 * np.pi * np.array([1.0, 3.0, 5.0])
    ratio = np.abs(two.grip_motion(omega) / one.grip_motion(omega) - 1.0)
    assert np.all(ratio < 0.05) and ratio.max() > 1e-4


def test_a_girdle_lets_the_shoulder_give_way(context: EvaluationContext) -> None:
    stiff = gain_margin(context, **NOMINAL)
    soft = gain_margin(context, **NOMINAL, pilot__torso__girdle__stiffness_n_per_m=20000.0)
    assert 1.0 < stiff - soft < 3.5


def test_every_spring_has_a_path(context: EvaluationContext) -> None:
    base = gain_margin(context, **NOMINAL)
    for path, value in (
        ("pilot.torso.buttocks.vertical_n_per_m", 80000.0),
        ("pilot.torso.lumbar.pitch_n_m_s_per_rad", 60.0),
        ("pilot.torso.viscera.vertical_hz", 6.0),
        ("pilot.torso.neck.vertical_n_per_m", 40000.0),
        ("cockpit.seat.cushion.stiffness_n_per_m", 80000.0),
        ("cockpit.seat.back.tangential_n_per_m", 0.0),
    ):
        found = evaluate(context, {**NOMINAL, path: value})
        assert isinstance(found, Evaluation)
        assert abs(found.margins.gain_margin_db - base) > 1e-3, path


# ---- decks on MBDyn, bad input ---------------------------------------------------------------------------------------


def test_no_deck_with_a_torso_fails_to_start_on_mbdyn(context: EvaluationContext, tmp_path: Path) -> None:
    for values in random_pilots(context.study, 40):
        solve_pilot(context, values, tmp_path, linearise=False)
        prediction = check_mbdyn(tmp_path / PILOT_DECK, context.client)
        assert prediction.runs, prediction


def test_people_beyond_the_trends_are_refused(context: EvaluationContext) -> None:
    found = evaluate(context, {"age_years": 25.0, "mass_kg": 110.0, "stature_m": 1.60})
    assert isinstance(found, FailedEvaluation) and found.stage == "torso"
    assert "2.44 Hz by the trends, outside 3.2 to 7 Hz; switch pilot.torso.age_trend or bmi_trend off" in found.reason


def test_a_torso_by_hand(nominal: SolvedPilot) -> None:
    """Without a cushion there is no pan, and the pelvis stands on the seat."""
    numbers, seat = torso_from(None), {"cushion": None, "back": dict(nominal.study.cockpit["seat"]["back"])}
    torso = make_torso(Biometrics(40.0, 1.775, 75.6, "female"), ("left", "right"), numbers, seat)
    assert [row.name for row in torso.bodies] == ["pelvis", "viscera", "thorax", "head"]
    assert torso.springs[0].first == "seat" and torso.carried_arms == {}
    with pytest.raises(EvaluationError, match="trends"):
        make_torso(Biometrics(18.0, 1.50, 100.0, "male"), ("left",), numbers, seat)


def test_a_hand_that_holds_a_lever_loads_the_springs(nominal: SolvedPilot) -> None:
    """A force at the hand arrives at every spring below the shoulder, with its moment."""
    before = nominal.torso
    assert before is not None
    at = (0.3, 0.3, -0.25)
    loads = {"left": ((5.0, -10.0, 1.0), (0.1, 0.2, 0.3), at)}
    after: SeatedTorso = seat_torso(
        before.torso, nominal.body, nominal.cockpit, nominal.posture.nodes, loads, GRAVITY_M_PER_S2
    )
    point = np.array(before.points["buttocks"])
    more = np.array(after.prestress["buttocks"]) - np.array(before.prestress["buttocks"])
    assert more[:3] == pytest.approx([5.0, -10.0, 1.0])
    assert more[3:] == pytest.approx(np.cross(np.array(at) - point, [5.0, -10.0, 1.0]) + [0.1, 0.2, 0.3])
    assert after.prestress["neck"] == before.prestress["neck"] and after.prestress["back"] == (0.0,) * 6
