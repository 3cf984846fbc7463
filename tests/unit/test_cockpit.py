"""Cockpit: seat adjustment, shoulders, controls; hand calculations and the rules of the cockpit file.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from pilotgen.anthropometry.biometrics import Biometrics
from pilotgen.anthropometry.body import Body, make_body
from pilotgen.errors import StudyError
from pilotgen.posture.cockpit import make_cockpit
from pilotgen.study.cockpit_numbers import cockpit_numbers


def body_of(stature_m: float, sex: str = "male") -> Body:
    return make_body(Biometrics(40.0, stature_m, 24.0 * stature_m**2, sex), ("left", "right"))


@pytest.fixture(scope="module")
def mean_man() -> Body:
    return body_of(1.756)  # mean man of ANSUR II


def test_the_mean_man_sits_in_the_middle_and_his_shoulder_is_where_the_survey_puts_it(mean_man: Body) -> None:
    cockpit = make_cockpit(mean_man, lever_length_m=0.32, position=0.5)
    assert np.abs(cockpit.seat_shift_m).max() < 0.010
    # acromion 0.606 m, less 0.020 slump and 0.035 to GH, on a back leaning 13 deg, GH 0.10 m in front of it
    height, t = 0.606 - 0.055, math.radians(13.0)
    x, y = 0.10 * math.cos(t) - height * math.sin(t), height * math.cos(t) + 0.10 * math.sin(t)
    assert cockpit.torso["right"][0] == pytest.approx([x, y, 0.41 * 0.416], abs=0.010)


@pytest.mark.parametrize("stature_m", [1.60, 1.70, 1.85])
def test_the_seat_brings_the_eye_to_the_design_eye_point(stature_m: float) -> None:
    cockpit = make_cockpit(body_of(stature_m), lever_length_m=0.32, position=0.5)
    assert np.abs(cockpit.eye_mismatch_m).max() < 1e-15
    assert np.abs(cockpit.seat_shift_m).max() <= 0.065


def test_beyond_the_travel_the_rest_remains_and_is_reported() -> None:
    cockpit = make_cockpit(body_of(2.00), lever_length_m=0.32, position=0.5)
    assert cockpit.seat_shift_m[1] == -0.065
    assert cockpit.eye_mismatch_m[1] > 0.005
    report = cockpit.seat_report()
    assert report["up_m"] == -0.065
    assert report["eye_above_design_eye_point_m"] == cockpit.eye_mismatch_m[1]
    fixed = make_cockpit(body_of(2.00), lever_length_m=0.32, position=0.5, seat="fixed")
    assert not fixed.seat_shift_m.any()
    assert fixed.eye_mismatch_m[1] == pytest.approx(cockpit.eye_mismatch_m[1] + 0.065)


def test_small_pilots_are_lifted_and_moved_until_the_travel_ends() -> None:
    cockpit = make_cockpit(body_of(1.45), lever_length_m=0.32, position=0.5)
    assert cockpit.seat_shift_m[1] == 0.065  # upward, all of it
    assert cockpit.eye_mismatch_m[1] < -0.005
    fixed = make_cockpit(body_of(1.45), lever_length_m=0.32, position=0.5, seat="fixed")
    assert cockpit.torso["left"][0][:2] - fixed.torso["left"][0][:2] == pytest.approx(cockpit.seat_shift_m)


def test_the_two_shoulders_are_mirror_images(mean_man: Body) -> None:
    torso = make_cockpit(mean_man, lever_length_m=0.32, position=0.5).torso
    assert np.array_equal(torso["left"][0] * [1, 1, -1], torso["right"][0])
    assert np.array_equal(torso["left"][1], torso["right"][1])
    # the torso leans back: its y axis points up and rearward
    assert torso["left"][1][:, 1] == pytest.approx([-math.sin(math.radians(13)), math.cos(math.radians(13)), 0.0])


def test_the_lever_turns_about_its_hinge(mean_man: Body) -> None:
    data = cockpit_numbers()["collective"]
    middle = make_cockpit(mean_man, lever_length_m=0.32, position=0.5).inceptors["left"]
    assert middle.grip_world_m == pytest.approx(data["grip_m"], abs=1e-15)
    longer = make_cockpit(mean_man, lever_length_m=0.45, position=0.5).inceptors["left"]
    assert longer.grip_world_m == pytest.approx(data["grip_m"], abs=1e-15)
    for position, angle in ((0.0, 0.0), (0.25, 10.0), (1.0, 40.0)):
        lever = make_cockpit(mean_man, lever_length_m=0.32, position=position).inceptors["left"]
        assert lever.angle_deg == angle
        assert lever.pose[0] == pytest.approx(middle.pose[0], abs=1e-15)
        along = lever.grip_world_m - lever.pose[0]
        a = math.radians(angle)
        assert along == pytest.approx([0.32 * math.cos(a), 0.32 * math.sin(a), 0.0])


def test_handles_are_held_by_the_palms(mean_man: Body) -> None:
    inceptors = make_cockpit(mean_man, lever_length_m=0.32, position=0.5).inceptors
    lever, stick = inceptors["left"], inceptors["right"]
    for control in (lever, stick):
        assert control.handle @ control.handle.T == pytest.approx(np.eye(3))
        assert np.linalg.det(control.handle) == pytest.approx(1.0)
    world = lever.pose[1] @ lever.handle
    assert world[:, 0] == pytest.approx([math.cos(math.radians(20)), math.sin(math.radians(20)), 0.0])  # thumb forward
    assert world[:, 1] == pytest.approx([0.0, 0.0, 1.0])  # left palm to the right
    world = stick.pose[1] @ stick.handle
    assert world[:, 0] == pytest.approx([0.0, 1.0, 0.0])
    assert world[:, 1] == pytest.approx([0.0, 0.0, -1.0])


def test_changes_to_the_cockpit(mean_man: Body) -> None:
    changes = {"collective": {"grip_m": [0.4, 0.3, -0.3], "inertia_kg_m2": 0.1}}
    moved = make_cockpit(mean_man, lever_length_m=0.32, position=0.5, numbers=cockpit_numbers(changes))
    assert moved.inceptors["left"].grip_world_m == pytest.approx([0.4, 0.3, -0.3])
    assert moved.inceptors["left"].inertia_kg_m2 == (0.005, 0.1, 0.1)
    assert cockpit_numbers()["collective"]["inertia_kg_m2"] == 0.05  # the bundled numbers are untouched


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"seats": {}}, "seat"),
        ({"seat": 3}, "not a mapping"),
        ({"seat": {"back_angle": 13.0}}, "back_angle_deg"),
        ({"seat": {"back_angle_deg": "steep"}}, "not a number"),
        ({"collective": {"grip_m": [350.0, 240.0, -250.0]}}, "outside -1 to 1.5 m"),
        ({"collective": {"grip_m": [0.35, 0.24]}}, "list of three numbers"),
        ({"collective": {"lowest_angle_deg": 40.0, "highest_angle_deg": 0.0}}, "swap"),
        ({"cyclic": {"mass_kg": True}}, "not a number"),
    ],
)
def test_bad_changes_are_told(overrides: dict[str, object], words: str) -> None:
    with pytest.raises(StudyError, match=words):
        cockpit_numbers(overrides)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"lever_length_m": 0.0, "position": 0.5}, "lever_length_m"),
        ({"lever_length_m": 0.32, "position": 1.5}, "position"),
        ({"lever_length_m": 0.32, "position": 0.5, "seat": "sofa"}, "design_eye, fixed"),
    ],
)
def test_bad_settings_are_told(mean_man: Body, settings: dict[str, object], words: str) -> None:
    with pytest.raises(StudyError, match=words):
        make_cockpit(mean_man, **settings)  # type: ignore[arg-type]
