"""Kinematics, first guess and joint angles, against finite differences, rotations by scipy, and another optimiser.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from pilotgen.anthropometry.biometrics import Biometrics
from pilotgen.anthropometry.body import SEGMENTS, Body, make_body
from pilotgen.errors import EvaluationError
from pilotgen.posture.cockpit import make_cockpit
from pilotgen.posture.kinematics import (
    MIRROR,
    arm_geometry,
    forward,
    frame,
    joint_coordinates,
    mirror_pose,
    muscle_lengths,
    rotation,
    rotation_vector,
    rotation_vector_rate,
)
from pilotgen.posture.posture import ergonomics, first_guess, from_poses
from pilotgen.study.cockpit_numbers import cockpit_numbers

BODY = make_body(Biometrics(40.0, 1.775, 24.0 * 1.775**2, "male"), ("left", "right"))
COCKPIT = make_cockpit(BODY, lever_length_m=0.32, position=0.5)
RIGHT = arm_geometry(BODY.limbs["right"])
TORSO = (np.array([-0.03, 0.56, 0.17]), Rotation.from_euler("z", 13.0, degrees=True).as_matrix())

coordinates = st.tuples(
    *(st.floats(low, high) for low, high in ((-1, 1), (-1, 1), (-1, 1), (0.1, 2.4), (-1.3, 1.3), (-1, 1), (-0.5, 0.5)))
).map(np.array)
vectors = st.tuples(*[st.floats(-1.7, 1.7)] * 3).map(np.array)


# ---- rotations -------------------------------------------------------------------------------------------------------


@given(vectors)
@settings(deadline=None)
def test_rotations_are_scipys(v: np.ndarray) -> None:
    R = rotation(v)
    assert pytest.approx(Rotation.from_rotvec(v).as_matrix(), abs=1e-14) == R
    assert rotation_vector(R) == pytest.approx(v, abs=1e-8)


def test_half_a_turn_has_a_rotation_vector() -> None:
    v = np.array([0.6, 0.0, -0.8]) * math.pi
    found = rotation_vector(Rotation.from_rotvec(v).as_matrix())
    assert rotation(found) == pytest.approx(rotation(v), abs=1e-12)
    assert np.linalg.norm(found) == pytest.approx(math.pi)


@given(vectors, vectors)
@settings(deadline=None)
def test_rate_of_the_rotation_vector(v: np.ndarray, w: np.ndarray) -> None:
    h = 1e-6
    ahead, behind = (rotation_vector(rotation(sign * h * w) @ rotation(v)) for sign in (1.0, -1.0))
    difference = (ahead - behind) / (2 * h)
    assert rotation_vector_rate(v) @ w == pytest.approx(difference, abs=1e-6)


def test_frames_are_completed_as_the_decks_mean_them() -> None:
    for index, guess_index in ((3, 1), (3, 2), (1, 2), (2, 3), (1, 3), (2, 1)):
        axis, guess = np.array([0.1, -0.3, 0.9]), np.array([0.8, 0.5, 0.1])
        R = frame(axis, index, guess, guess_index)
        assert pytest.approx(np.eye(3), abs=1e-15) == R @ R.T
        assert np.linalg.det(R) == pytest.approx(1.0)
        assert R[:, index - 1] == pytest.approx(axis / np.linalg.norm(axis))
        assert R[:, guess_index - 1] @ guess > 0.5  # in the plane of both, on the guess's side
        third = 6 - index - guess_index
        assert abs(R[:, third - 1] @ guess) < 1e-15


# ---- the arm ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("side", ["left", "right"])
def test_zero_coordinates_are_the_anatomical_position(side: str) -> None:
    limb = BODY.limbs[side]
    pose = forward(arm_geometry(limb), np.array([0, 0, 0, 0, -math.pi / 2, 0, 0]), (np.zeros(3), np.eye(3)))
    for name in SEGMENTS:
        x, R = pose.poses[name] if side == "right" else mirror_pose(pose.poses[name])
        assert x == pytest.approx(limb.anatomical_origin_m[name], abs=1e-12)
        assert pytest.approx(limb.anatomical_axes[name], abs=1e-12) == R


def test_a_left_arm_is_a_right_arm_in_the_mirror() -> None:
    left = arm_geometry(BODY.limbs["left"])
    for field in dataclasses.fields(RIGHT):
        if field.name != "side":
            assert np.allclose(getattr(left, field.name), getattr(RIGHT, field.name), rtol=0, atol=1e-15), field.name


@given(coordinates)
@settings(max_examples=50, deadline=None)
def test_coordinates_come_back_and_the_loop_closes(q: np.ndarray) -> None:
    pose = forward(RIGHT, q, TORSO)
    assert joint_coordinates(RIGHT, pose.poses, TORSO) == pytest.approx(q, abs=1e-9)
    x_u, R_u = pose.poses["ulna"]
    x_r, R_r = pose.poses["radius"]
    ulnar_head = R_u.T @ (x_r + R_r @ RIGHT.UH - x_u)
    assert ulnar_head[[0, 2]] == pytest.approx(0.0, abs=1e-12)
    assert ulnar_head[1] == pytest.approx(-BODY.limbs["right"].segments["ulna"].length_m, abs=0.004)


@given(coordinates)
@settings(max_examples=25, deadline=None)
def test_axes_and_arms_are_derivatives(q: np.ndarray) -> None:
    pose = forward(RIGHT, q, TORSO)
    h = 1e-6
    for i in range(3, 7):
        step = np.zeros(7)
        step[i] = h
        plus, minus = forward(RIGHT, q + step, TORSO), forward(RIGHT, q - step, TORSO)
        turn = rotation_vector(plus.poses["hand"][1] @ minus.poses["hand"][1].T) / (2 * h)
        # the wobble of the radius is left out: a few parts in a thousand for the elbow, nothing elsewhere
        allowed = 0.02 if i == 3 else 1e-8
        assert turn == pytest.approx(pose.axes[:, i], abs=allowed)
        assert (plus.grip - minus.grip) / (2 * h) == pytest.approx(pose.arms[:, i], abs=0.3 * allowed)


def test_muscle_lengths_are_distances() -> None:
    limb = BODY.limbs["right"]
    poses = forward(RIGHT, ergonomics().neutral_rad, TORSO).poses
    lengths = muscle_lengths(limb, poses, TORSO)
    frames = {**poses, "torso": TORSO}
    for muscle, length in zip(limb.muscles, lengths, strict=True):
        (x1, R1), (x2, R2) = frames[muscle.origin_body], frames[muscle.insertion_body]
        span = x2 + R2 @ muscle.insertion_m - x1 - R1 @ muscle.origin_m
        assert length == pytest.approx(np.linalg.norm(span), rel=1e-14)


# ---- first guess -----------------------------------------------------------------------------------------------------


def spring_energy(q: np.ndarray, torso: tuple, handle: tuple) -> float:
    """Energy [J] of the ergonomic joint springs, by scipy's rotations from the definition of the posture deck."""
    e = ergonomics()
    shoulder = (Rotation.from_rotvec(e.neutral_rad[:3]).inv() * Rotation.from_rotvec(q[:3])).as_rotvec()
    stretch = np.concatenate((shoulder, q[3:] - e.neutral_rad[3:]))
    hand = forward(RIGHT, q, torso).poses["hand"][1]
    grip = Rotation.from_matrix(handle[1].T @ hand @ e.hand_handle).as_rotvec()
    springs = 0.5 * e.K1_Nm_per_rad * stretch**2 + 0.25 * e.K3_Nm_per_rad3 * stretch**4
    return float(springs.sum() + 0.5 * (e.grip_Nm_per_rad * grip**2).sum())


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_guess_heads_for_the_least_effort_posture(side: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # as far as its iteration gets; the program stops it earlier, where the solver goes on faster
    monkeypatch.setattr("pilotgen.posture.posture._GUESS_SETTLED_RAD", 0.05)
    monkeypatch.setattr("pilotgen.posture.posture._GUESS_CLOSED_M", 5e-3)
    torso, inceptor = COCKPIT.torso[side], COCKPIT.inceptors[side]
    handle = (inceptor.grip_world_m, inceptor.pose[1] @ inceptor.handle)
    if side == "left":
        torso, handle = mirror_pose(torso), mirror_pose(handle)
    guess = first_guess(BODY, COCKPIT).coordinates[side]
    best = minimize(
        spring_energy,
        ergonomics().neutral_rad,
        args=(torso, handle),
        constraints={"type": "eq", "fun": lambda q: forward(RIGHT, q, torso).grip - handle[0]},
        method="SLSQP",
        options={"maxiter": 300, "ftol": 1e-12},
    )
    assert best.success
    assert spring_energy(guess, torso, handle) == pytest.approx(best.fun, rel=1e-4)
    assert np.degrees(guess) == pytest.approx(np.degrees(best.x), abs=1.0)
    assert forward(RIGHT, guess, torso).grip == pytest.approx(handle[0], abs=1e-4)


def test_the_guess_of_a_left_arm_at_a_mirrored_cockpit_is_that_of_a_right_arm() -> None:
    # the collective moved to the right side of the seat, held by the right hand
    left = COCKPIT.inceptors["left"]
    handle = mirror_pose((left.pose[0], left.pose[1] @ left.handle))[1]
    pose = mirror_pose(left.pose)
    grip = left.grip_m * MIRROR
    mirrored = dataclasses.replace(left, side="right", pose=pose, grip_m=grip, handle=pose[1].T @ handle)
    cockpit = dataclasses.replace(COCKPIT, inceptors={"left": left, "right": mirrored})
    guess = first_guess(BODY, cockpit)
    assert np.allclose(guess.coordinates["left"], guess.coordinates["right"], rtol=0, atol=1e-12)
    for name in SEGMENTS:
        assert np.allclose(mirror_pose(guess.nodes[f"{name}_l"])[1], guess.nodes[f"{name}_r"][1], rtol=0, atol=1e-12)
    angles = from_poses(BODY, cockpit, guess.nodes).angles_by_side
    assert angles["left"] == pytest.approx(angles["right"], abs=1e-9)


def test_out_of_reach_is_told_in_metres() -> None:
    away = {"collective": {"grip_m": [0.9, 0.24, -0.25]}}
    far = make_cockpit(BODY, lever_length_m=0.32, position=0.5, numbers=cockpit_numbers(away))
    with pytest.raises(EvaluationError, match=r"collective grip is 0\.\d+ m .* beyond the reach") as caught:
        first_guess(BODY, far)
    assert caught.value.stage == "posture"


def test_too_near_is_told_in_metres() -> None:
    near = {"collective": {"grip_m": [0.1, 0.6, -0.25]}}
    cockpit = make_cockpit(BODY, lever_length_m=0.32, position=0.5, numbers=cockpit_numbers(near))
    with pytest.raises(EvaluationError, match=r"nearer than the 0\.\d+ m of an arm with 150 deg of elbow flexion"):
        first_guess(BODY, cockpit)


# ---- joint angles ----------------------------------------------------------------------------------------------------


def angles_of(q: np.ndarray, body: Body = BODY) -> dict[str, float]:
    torso = COCKPIT.torso["left"]
    poses = forward(arm_geometry(body.limbs["left"]), q, mirror_pose(torso)).poses
    right = first_guess(BODY, COCKPIT).nodes
    nodes = {**right, **{f"{name}_l": mirror_pose(pose) for name, pose in poses.items()}}
    return from_poses(body, COCKPIT, nodes).angles_by_side["left"]


def test_joint_angles_have_the_signs_of_their_names() -> None:
    mid = np.radians([0.0, 0.0, 0.0, 90.0, 0.0, 0.0, 0.0])
    base = angles_of(mid)
    # bones hang down in the anatomical position, less the few degrees that the upper arm leans by
    assert base["shoulder_flexion_deg"] == pytest.approx(0.0, abs=3.0)
    assert base["shoulder_abduction_deg"] == pytest.approx(0.0, abs=3.0)
    assert base["shoulder_rotation_deg"] == pytest.approx(0.0, abs=1e-9)
    assert base["elbow_flexion_deg"] == pytest.approx(90.0)
    for i, name, sign in (
        (0, "shoulder_abduction_deg", -1.0),
        (1, "shoulder_rotation_deg", 1.0),
        (2, "shoulder_flexion_deg", 1.0),
        (3, "elbow_flexion_deg", 1.0),
        (4, "forearm_pronation_deg", 1.0),
        (5, "wrist_flexion_deg", 1.0),
        (6, "wrist_ulnar_deviation_deg", 1.0),
    ):
        q = mid.copy()
        q[i] += math.radians(10.0)
        assert angles_of(q)[name] - base[name] == pytest.approx(sign * 10.0, abs=0.2), name


def test_flexion_lifts_the_elbow_forward_and_the_palm_flexes_toward_itself() -> None:
    straight = forward(RIGHT, np.array([0, 0, 0, 0, -math.pi / 2, 0, 0]), (np.zeros(3), np.eye(3)))
    for i, moved, axis in ((2, "hand", 0), (3, "hand", 0)):
        q = np.array([0, 0, 0, 0, -math.pi / 2, 0, 0.0])
        q[i] = 0.5
        assert forward(RIGHT, q, (np.zeros(3), np.eye(3))).poses[moved][0][axis] > straight.poses[moved][0][axis] + 0.1
    knuckle = np.array([0.0, -0.08, 0.0])  # palm forward: flexion brings the knuckles forward, ulnar deviation inward
    for i, axis, sign in ((5, 0, 1.0), (6, 2, -1.0)):
        q = np.array([0, 0, 0, 0, -math.pi / 2, 0, 0.0])
        q[i] = 0.3
        x, R = forward(RIGHT, q, (np.zeros(3), np.eye(3))).poses["hand"]
        x0, R0 = straight.poses["hand"]
        assert sign * ((x + R @ knuckle) - (x0 + R0 @ knuckle))[axis] > 0.015
    thumb = np.array([0.02, -0.03, 0.04])  # pronation of a flexed forearm turns the thumb inward
    start = forward(RIGHT, np.array([0, 0, 0, math.pi / 2, 0, 0, 0]), (np.zeros(3), np.eye(3))).poses["hand"]
    turned = forward(RIGHT, np.array([0, 0, 0, math.pi / 2, 0.5, 0, 0]), (np.zeros(3), np.eye(3))).poses["hand"]
    assert (turned[1] @ thumb - start[1] @ thumb)[2] < -0.01


@pytest.mark.parametrize(
    ("coordinate", "value_deg", "words"),
    [
        (6, 48.0, "ulnar deviation of the wrist would be 48.0 deg; its range of motion ends at 30 deg"),
        (6, -25.0, "ulnar deviation of the wrist would be -25.0 deg; its range of motion ends at -20 deg"),
        (3, 155.0, "elbow flexion would be 155.0 deg"),
        (4, 85.0, "forearm pronation would be 85.0 deg"),
    ],
)
def test_a_joint_beyond_its_range_is_named(coordinate: int, value_deg: float, words: str) -> None:
    q = np.radians([0.0, 0.0, 0.0, 90.0, 0.0, 0.0, 0.0])
    q[coordinate] = math.radians(value_deg)
    with pytest.raises(EvaluationError, match="left arm: " + words) as caught:
        angles_of(q)
    assert caught.value.stage == "posture"
