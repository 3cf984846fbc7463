"""Whole pilots through the solver, against an account of the arm that does without it, and over the box of a study.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from seven_coordinates import SevenCoordinates

from pilotgen.activation.activation import TORQUES, Activations, solve_activations
from pilotgen.anthropometry.arm import Limb
from pilotgen.anthropometry.biometrics import Biometrics
from pilotgen.anthropometry.body import Body, make_body
from pilotgen.decks.deck import render_direct, render_posture, render_trim
from pilotgen.errors import EvaluationError
from pilotgen.linear.feedthrough import make_pilot_model
from pilotgen.posture.cockpit import Cockpit, make_cockpit
from pilotgen.posture.posture import Posture, PostureGuess, first_guess, from_poses
from pilotgen.solver.client import SolverClient
from pilotgen.solver.matrices import Matrices, read_matrices
from pilotgen.study.cockpit_numbers import cockpit_numbers

KP, KD = 1.5, 0.1


@dataclass(frozen=True)
class Gains:
    proportional_gain: float = KP
    derivative_gain: float = KD


@dataclass(frozen=True)
class Pilot:
    body: Body
    cockpit: Cockpit
    guess: PostureGuess
    posture: Posture
    activations: Activations
    matrices: Matrices
    iterations: int


def weakened(limb: Limb, factor: float) -> Limb:
    return replace(limb, muscles=tuple(m._replace(F0_N=factor * m.F0_N) for m in limb.muscles))


def solve(
    solver: SolverClient,
    directory: Path,
    biometrics: Biometrics,
    limbs: tuple[str, ...] = ("left",),
    overrides: dict | None = None,
    floor: float = 0.0,
    strength: float = 1.0,
    change: tuple[str, str] = ("", ""),
) -> Pilot:
    """One pilot; `strength` scales the muscles, `change` replaces a text of the trim and the pilot deck."""
    body = make_body(biometrics, limbs)
    if strength != 1.0:
        body = replace(body, limbs={side: weakened(limb, strength) for side, limb in body.limbs.items()})
    cockpit = make_cockpit(body, lever_length_m=0.32, position=0.5, numbers=cockpit_numbers(overrides))
    guess = first_guess(body, cockpit)
    reply = solver.request("static", deck_text=render_posture(body, cockpit, guess), name="posture.mbd")
    posture = from_poses(body, cockpit, reply.nodes)
    trim_file, pilot_file = directory / "trim.h5", directory / "pilot.h5"
    trim_deck = render_trim(body, cockpit, posture, gains=Gains(), c=0.01)
    assert change[0] in trim_deck
    trim_deck = trim_deck.replace(*change)
    solver.request("linearise", deck_text=trim_deck, name="trim.mbd", output=trim_file)
    trim = read_matrices(trim_file)
    assert trim.muscles.length == pytest.approx(posture.muscle_lengths_m, abs=1e-15)
    activations = solve_activations(trim, body, cockpit, floor=floor)
    pilot_deck = render_direct(
        body, cockpit, posture, activations=activations, muscle_lengths=trim.muscles.length, gains=Gains(), c=0.01
    )
    pilot_deck = pilot_deck.replace(*change)
    solver.request("linearise", deck_text=pilot_deck, name="pilot.mbd", output=pilot_file)
    return Pilot(body, cockpit, guess, posture, activations, read_matrices(pilot_file), reply.iterations)


def man(stature_m: float = 1.775, bmi: float = 24.0, age: float = 40.0, sex: str = "male") -> Biometrics:
    return Biometrics(age, stature_m, bmi * stature_m**2, sex)


@pytest.fixture(scope="module")
def nominal(solver: SolverClient, tmp_path_factory: pytest.TempPathFactory) -> Pilot:
    return solve(solver, tmp_path_factory.mktemp("nominal"), man())


@pytest.fixture(scope="module")
def both(solver: SolverClient, tmp_path_factory: pytest.TempPathFactory) -> Pilot:
    return solve(solver, tmp_path_factory.mktemp("both"), man(), ("left", "right"))


# ---- one pilot -------------------------------------------------------------------------------------------------------


def test_the_nominal_pilot_is_in_equilibrium(nominal: Pilot) -> None:
    assert np.abs(nominal.matrices.equilibrium_residual).max() < 1e-9  # N, N m; 1e-6 is wanted
    a = nominal.activations
    assert a.values.min() >= 0.0 and a.values.max() <= 1.0
    assert a.largest == a.values.max() and a.sum_of_squares == pytest.approx(np.sum(a.values**2))
    assert a.muscle_names[int(np.argmax(a.values))] == a.largest_muscle
    assert 8 <= len(a.at_floor) <= 18  # minimum effort rests about half of them
    names = list(nominal.matrices.dof_names)
    grip = [nominal.matrices.y[i] for i, name in enumerate(names) if name.startswith("grip_l.reaction")]
    assert len(grip) == 6
    assert np.abs(grip).max() < 1e-9  # the hand carries nothing: the lever is balanced


def test_the_solver_takes_few_steps_from_the_guess(nominal: Pilot) -> None:
    assert nominal.iterations <= 5  # where it starts decides no more than this: consistency/test_pilot_box.py


def test_a_nominal_pilot_sits_like_a_pilot(nominal: Pilot) -> None:
    angles = nominal.posture.angles_deg
    assert 65.0 < angles["elbow_flexion_deg"] < 100.0  # RULA's best class is 60 to 100 deg
    assert abs(angles["shoulder_flexion_deg"]) < 20.0
    assert 0.0 < angles["shoulder_abduction_deg"] < 25.0
    assert abs(angles["wrist_flexion_deg"]) < 15.0
    assert 0.0 < angles["wrist_ulnar_deviation_deg"] < 20.0
    assert abs(angles["forearm_pronation_deg"]) < 30.0


@pytest.mark.parametrize("side", ["left", "right"])
def test_moments_balance_without_the_solver(both: Pilot, side: str) -> None:
    arm = SevenCoordinates(both.body, both.cockpit, both.posture, side)
    values = both.activations.values[:25] if side == "left" else both.activations.values[25:]
    assert np.abs(arm.unbalanced(values)).max() < 1e-8  # N m
    # the reported joint torques carry the weight; elbow to wrist are coordinates of their own
    torques = both.activations.joint_torques_N_m
    prefix = "" if side == "left" else "right_"
    reported = np.array([torques[prefix + name] for name in TORQUES])
    assert reported[3:] == pytest.approx(-arm.weight_torque(arm.q)[3:], abs=1e-8)
    # about the torso's axes: moment of the weights about the shoulder
    weights = np.zeros(3)
    for centre, mass in zip(arm.centres(arm.q), arm.masses(), strict=True):
        weights += np.cross(centre - arm.torso[0], [0.0, -9.81 * mass, 0.0])
    about = arm.torso[1].T @ weights
    assert reported[:3] == pytest.approx([about[0], -about[1], -about[2]], abs=1e-8)


def test_poles_and_feedthrough_without_the_solver(nominal: Pilot) -> None:
    arm = SevenCoordinates(nominal.body, nominal.cockpit, nominal.posture)
    values = nominal.activations.values
    model = make_pilot_model(nominal.matrices, lever_length_m=0.32, washout_rad_s=None, projection="exact")
    poles = arm.poles(values, KP, KD)
    assert len(poles) == len(model.pole_list()) == 2
    for pole, found in zip(poles, model.pole_list(), strict=True):
        assert found["frequency_hz"] == pytest.approx(abs(pole) / (2.0 * math.pi), rel=1e-7)
        assert found["damping"] == pytest.approx(-pole.real / abs(pole), rel=1e-6)
    for frequency in (0.5, 1.0, 2.0, 3.0, 5.0, 8.0):
        own = 0.32 * arm.feedthrough(values, KP, KD, frequency)
        assert complex(model.grip_motion(2.0 * math.pi * frequency)) == pytest.approx(own, rel=1e-6)


def test_the_dominant_pair_is_in_the_band_of_collective_bounce(nominal: Pilot) -> None:
    model = make_pilot_model(nominal.matrices, lever_length_m=0.32, washout_rad_s=None, projection="exact")
    frequency_hz, damping = model.dominant_pair()
    assert 3.0 < frequency_hz < 4.5
    assert 0.2 < damping < 0.45
    assert 0.5e-3 < abs(model.grip_motion(2.0 * math.pi * 3.0)) < 5e-3  # m per m/s^2


def test_a_tonic_floor_raises_every_activation_and_keeps_the_balance(solver: SolverClient, tmp_path: Path) -> None:
    pilot = solve(solver, tmp_path, man(), floor=0.01)
    assert pilot.activations.values.min() == 0.01
    assert np.abs(pilot.matrices.equilibrium_residual).max() < 1e-9


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_heavy_control_is_carried_by_the_smallest_grip_force(solver: SolverClient, tmp_path: Path, side: str) -> None:
    """Centre of mass 0.1 m off the hinge (lever, forward) or off the pivot (stick, to the side and forward)."""
    control = {"left": "LEVER", "right": "STICK"}[side]
    arm = {"left": "0.1, 0., 0.", "right": "0.1, 0., 0.05"}[side]
    heavy = (
        f"body: {control}, {control}, {control}_MASS, null,",
        f"body: {control}, {control}, {control}_MASS, {arm},",
    )
    pilot = solve(solver, tmp_path, man(), (side,), change=heavy)
    assert np.abs(pilot.matrices.equilibrium_residual).max() < 1e-9
    inceptor = pilot.cockpit.inceptors[side]
    weight = np.array([0.0, -9.81 * inceptor.mass_kg, 0.0])
    centre = inceptor.pose[1] @ np.array([float(x) for x in arm.split(",")])
    moment = np.cross(centre, weight)
    reach = inceptor.grip_world_m - inceptor.pose[0]
    if side == "left":  # about the hinge only: perpendicular to the lever, in its plane
        moment = np.array([0.0, 0.0, moment[2]])
    expected = -np.cross(moment, reach) / (reach @ reach)
    if side == "right":  # a moment along the stick is the pivot's business
        assert abs(moment @ reach) < 0.05 * np.linalg.norm(moment) * np.linalg.norm(reach)
    # the grip's reactions are components in the control's axes; they act on the control, here the first node
    names = list(pilot.matrices.dof_names)
    joint = f"grip_{side[0]}.reaction"
    reaction = np.array([pilot.matrices.y[names.index(f"{joint}[{k}]")] for k in range(1, 7)])
    assert inceptor.pose[1] @ reaction[:3] == pytest.approx(expected, abs=1e-9)
    assert reaction[3:] == pytest.approx(0.0, abs=1e-9)


# ---- two arms --------------------------------------------------------------------------------------------------------


def test_the_right_arm_does_not_change_the_collective(nominal: Pilot, both: Pilot) -> None:
    assert np.abs(both.matrices.equilibrium_residual).max() < 1e-9
    assert both.activations.values[:25] == pytest.approx(nominal.activations.values, abs=1e-12)
    one, two = (
        make_pilot_model(p.matrices, lever_length_m=0.32, washout_rad_s=None, projection="exact")
        for p in (nominal, both)
    )
    for frequency in (0.5, 1.0, 2.0, 3.0, 5.0, 8.0):
        w = 2.0 * math.pi * frequency
        assert complex(two.grip_motion(w)) == pytest.approx(complex(one.grip_motion(w)), rel=1e-9)


def test_the_right_hand_reaches_the_stick(both: Pilot) -> None:
    stick = both.cockpit.inceptors["right"]
    x, R = both.posture.nodes["hand_r"]
    assert x + R @ both.body.limbs["right"].grip_in_hand == pytest.approx(stick.grip_world_m, abs=1e-10)
    names = both.matrices.dof_names
    assert "stick.gz" in names and "stick.gx" in names and "stick_pivot.reaction[4]" in names


# ---- what cannot be --------------------------------------------------------------------------------------------------


def test_a_weak_pilot_is_told_which_joint_gives_way(solver: SolverClient, tmp_path: Path) -> None:
    with pytest.raises(EvaluationError, match=r"left arm: the muscles cannot balance .* N m are missing") as caught:
        solve(solver, tmp_path, man(), strength=0.02)
    assert caught.value.stage == "activation"
    assert any(name.replace("_", " ") in caught.value.reason for name in TORQUES)


def test_a_lever_behind_the_seat_is_no_posture(solver: SolverClient, tmp_path: Path) -> None:
    with pytest.raises(EvaluationError) as caught:
        solve(solver, tmp_path, man(), overrides={"collective": {"grip_m": [-0.45, 0.45, -0.25]}})
    assert caught.value.stage in {"posture", "solver"}
    assert "deg" in caught.value.reason or "reach" in caught.value.reason or "posture.mbd" in caught.value.reason


# ---- the box ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sex", ["male", "female"])
def test_nearly_all_pilots_of_the_box_evaluate(solver: SolverClient, tmp_path: Path, sex: str) -> None:
    """Age 25-65, BMI 18-30, stature 1.55-2.00 m; 95 % are wanted."""
    rng = np.random.default_rng(20240601)
    corners = [(age, bmi, stature) for age in (25.0, 65.0) for bmi in (18.0, 30.0) for stature in (1.55, 2.0)]
    inside = rng.uniform([25.0, 18.0, 1.55], [65.0, 30.0, 2.0], (32, 3)).tolist()
    failures: Counter[str] = Counter()
    for age, bmi, stature in [*corners, *inside]:
        try:
            pilot = solve(solver, tmp_path, man(stature, bmi, age, sex))
        except EvaluationError as error:
            failures[str(error)] += 1
            continue
        assert np.abs(pilot.matrices.equilibrium_residual).max() < 1e-6
        assert pilot.activations.values.max() < 0.5  # holding a balanced lever is light work
    assert sum(failures.values()) <= 0.05 * 40, failures
