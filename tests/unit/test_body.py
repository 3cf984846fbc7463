"""The body of one pilot: numbers worked out by hand, joints that close, a mirror image, and trends.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pilotgen.study.yaml_file
from pilotgen.anthropometry.biometrics import Biometrics, biometrics_from
from pilotgen.anthropometry.body import SEGMENTS, Body, Limb, make_body
from pilotgen.errors import StudyError

MEAN_MAN = Biometrics(30.0, 1.756, 85.5, "male")  # the centres of the regressions
MEAN_WOMAN = Biometrics(29.0, 1.628, 67.8, "female")
MIRROR = np.diag([1.0, 1.0, -1.0])

TABLE_3 = st.builds(
    Biometrics,
    age_years=st.floats(25.0, 65.0),
    stature_m=st.floats(1.55, 2.00),
    mass_kg=st.floats(60.0, 110.0),
    sex=st.sampled_from(["male", "female"]),
)
TABLE_4 = st.builds(
    lambda age, stature, bmi, sex: biometrics_from({"age_years": age, "stature_m": stature, "bmi": bmi}, sex),
    st.floats(25.0, 65.0),
    st.floats(1.55, 2.00),
    st.floats(18.0, 30.0),
    st.sampled_from(["male", "female"]),
)


def arm_mass_kg(body: Body) -> float:
    return sum(segment.mass_kg for segment in body.limbs["left"].segments.values())


# ---- known numbers


def test_mean_man() -> None:
    body = make_body(MEAN_MAN, ("right",))
    limb = body.limbs["right"]
    segments = limb.segments
    # 0.86 * 335.19 mm, 1.03 * 267.85 mm
    assert segments["humerus"].length_m == pytest.approx(0.2882634, abs=1e-9)
    assert segments["radius"].length_m == pytest.approx(0.2758855, abs=1e-9)
    # 0.25 + 0.03012 * 85.5 - 0.0027 * 175.6 and so on
    assert segments["humerus"].mass_kg == pytest.approx(2.35114, abs=1e-9)
    assert segments["radius"].mass_kg + segments["ulna"].mass_kg == pytest.approx(1.353791, abs=1e-9)
    assert segments["hand"].mass_kg == pytest.approx(0.4986, abs=1e-9)
    # 0.5772 * 288.2634 mm; 0.3624 * 193.24 mm
    assert segments["humerus"].com_m == pytest.approx([0.0, -0.16638563, 0.0], abs=1e-8)
    assert segments["hand"].com_m == pytest.approx([0.0, -0.07003018, 0.0], abs=1e-8)
    # 2.35114 * (0.285 * 0.2882634)^2 about x, 0.158 about y, 0.269 about z
    assert np.diag(segments["humerus"].inertia_kg_m2) == pytest.approx([0.0158689, 0.0048772, 0.0141372], abs=1e-7)
    assert limb.grip_in_hand == pytest.approx([0.028 * 193.24 / 193.3, -0.055 * 193.24 / 193.3, 0.0], abs=1e-12)
    assert body.sitting_height_m == pytest.approx(0.91824)
    assert body.eye_height_sitting_m == pytest.approx(0.80444)
    assert body.acromial_height_sitting_m == pytest.approx(0.60570)
    assert body.biacromial_breadth_m == pytest.approx(0.41566)
    assert body.hip_breadth_sitting_m == pytest.approx(0.37928)
    assert body.carrying_angle_deg == 8.0
    assert body.extrapolated == ()


def test_mean_woman() -> None:
    body = make_body(MEAN_WOMAN, ("right",))
    segments = body.limbs["right"].segments
    assert segments["humerus"].length_m == pytest.approx(0.86 * 0.31112, abs=1e-12)
    assert segments["radius"].length_m == pytest.approx(1.03 * 0.24126, abs=1e-12)
    assert segments["humerus"].mass_kg == pytest.approx(0.0255 * 67.8, abs=1e-12)
    assert segments["hand"].mass_kg == pytest.approx(0.0056 * 67.8, abs=1e-12)
    assert body.acromial_height_sitting_m == pytest.approx(0.56488)
    assert body.carrying_angle_deg == 10.0


def test_off_centre_regression() -> None:
    # 335.19 + 197.26 * 0.1 + 0.0586 * 10 + 0.0863 * 20 = 357.228 mm
    body = make_body(Biometrics(50.0, 1.856, 95.5, "male"))
    assert body.limbs["left"].segments["humerus"].length_m == pytest.approx(0.86 * 0.357228, abs=1e-9)


@pytest.mark.parametrize(
    ("sex", "stature_m", "mass_kg", "age_years", "factor"),
    [  # worked out from the equations apart from this program, to three decimals
        ("male", 1.77, 77.0, 27.0, 1.000),
        ("male", 1.60, 60.0, 25.0, 0.938),
        ("male", 1.756, 85.5, 30.0, 1.057),
        ("male", 1.756, 85.5, 45.0, 0.992),
        ("male", 1.756, 85.5, 65.0, 0.866),
        ("male", 1.90, 80.0, 35.0, 0.954),
        ("male", 1.95, 105.0, 35.0, 1.101),
        ("female", 1.55, 60.0, 35.0, 0.649),
        ("female", 1.63, 62.0, 27.0, 0.675),
        ("female", 1.75, 75.0, 65.0, 0.579),
    ],
)
def test_strength_factor(sex: str, stature_m: float, mass_kg: float, age_years: float, factor: float) -> None:
    body = make_body(Biometrics(age_years, stature_m, mass_kg, sex))
    assert body.strength_factor == pytest.approx(factor, abs=6e-4)
    deltoid = body.limbs["left"].muscles[0]
    assert deltoid.name == "DELT1"
    assert deltoid.F0_N == pytest.approx(1218.9 * body.strength_factor, rel=1e-12)


def test_muscles_are_the_25_of_the_data() -> None:
    limb = make_body(MEAN_MAN, ("right",)).limbs["right"]
    assert len(limb.muscles) == 25
    assert len({m.name for m in limb.muscles}) == 25
    brachialis = next(m for m in limb.muscles if m.name == "BRA")
    assert (brachialis.origin_body, brachialis.insertion_body) == ("humerus", "ulna")
    assert brachialis.origin_m == pytest.approx(np.array([0.0033, -0.1741, 0.0039]) * 0.2882634 / 0.2907, abs=1e-9)
    assert brachialis.insertion_m == pytest.approx(np.array([-0.0014, -0.0230, -0.0039]) * 0.2758855 / 0.2649, abs=1e-9)
    assert all(m.V0_m_per_s == pytest.approx(4.0 * m.l0_m, rel=1e-15) for m in limb.muscles)


@pytest.mark.parametrize(
    ("pilot", "row"), [(MEAN_MAN, (0.4574, 0.276, 0.121, 0.265)), (MEAN_WOMAN, (0.4559, 0.261, 0.094, 0.257))]
)
def test_forearm_halves_make_the_whole_forearm(pilot: Biometrics, row: tuple[float, ...]) -> None:
    segments = make_body(pilot).limbs["left"].segments
    radius, ulna = segments["radius"], segments["ulna"]
    length = radius.length_m
    mass = radius.mass_kg + ulna.mass_kg
    com = (radius.mass_kg * radius.com_m + ulna.mass_kg * ulna.com_m) / mass
    assert com == pytest.approx([0.0, -row[0] * length, 0.0], abs=1e-12)
    for axis, gyration in ((0, row[1]), (1, row[2]), (2, row[3])):
        inertia = sum(
            half.inertia_kg_m2[axis, axis] + (0.0 if axis == 1 else half.mass_kg * (half.com_m[1] - com[1]) ** 2)
            for half in (radius, ulna)
        )
        assert inertia == pytest.approx(mass * (gyration * length) ** 2, rel=1e-12)


# ---- joints


def assert_chain_closed(limb: Limb, carrying_angle_deg: float) -> None:
    origin, axes = limb.anatomical_origin_m, limb.anatomical_axes
    tolerance = 1e-14  # m, and on unit vectors
    for name in SEGMENTS:
        assert np.abs(axes[name].T @ axes[name] - np.eye(3)).max() < tolerance
        assert np.linalg.det(axes[name]) > 0.0
    assert not origin["humerus"].any()
    assert np.abs(axes["humerus"] @ limb.HU_in_humerus - origin["ulna"]).max() < tolerance
    assert np.abs(axes["humerus"] @ limb.HR_in_humerus - origin["radius"]).max() < tolerance
    assert (
        np.abs(axes["humerus"] @ limb.elbow_axis_in_humerus - axes["ulna"] @ limb.elbow_axis_in_ulna).max() < tolerance
    )
    assert np.abs(origin["radius"] + axes["radius"] @ limb.W_in_radius - origin["hand"]).max() < tolerance
    # the ulnar head: on the ulna's y axis, at the ulna's end
    ulnar_head = axes["ulna"].T @ (origin["radius"] + axes["radius"] @ limb.UH_in_radius - origin["ulna"])
    assert np.abs(ulnar_head - [0.0, -limb.segments["ulna"].length_m, 0.0]).max() < tolerance
    # the wrist's two axes are orthogonal
    flexion = axes["radius"] @ limb.wrist_flexion_axis_in_radius
    deviation = axes["hand"] @ limb.wrist_deviation_axis_in_hand
    assert abs(flexion @ deviation) < tolerance
    for axis in (limb.elbow_axis_in_humerus, limb.elbow_axis_in_ulna, flexion, deviation):
        assert axis @ axis == pytest.approx(1.0, abs=tolerance)
    # the radial head is on the flexion axis, so bending the elbow leaves the forearm as it is
    assert np.abs(np.cross(limb.HR_in_humerus - limb.HU_in_humerus, limb.elbow_axis_in_humerus)).max() < tolerance
    # carrying angle: both long axes in the humerus' frontal plane, the forearm away from the trunk
    forearm = axes["humerus"].T @ -axes["ulna"][:, 1]
    outward = forearm[2] if limb.side == "right" else -forearm[2]
    assert abs(forearm[0]) < tolerance
    assert math.degrees(math.atan2(outward, -forearm[1])) == pytest.approx(carrying_angle_deg, abs=1e-12)
    # in-line rule: turned back until the radius' z axis is the ulna's, both bones are parallel
    radial_head_off_axis = axes["ulna"].T @ (origin["radius"] - origin["ulna"])
    assert radial_head_off_axis[0] == pytest.approx(0.0, abs=tolerance)
    assert limb.UH_in_radius[2] == pytest.approx(-radial_head_off_axis[2], abs=tolerance)
    # palm forward and arm hanging
    assert axes["hand"][0, 0] > 0.95
    assert axes["humerus"][1, 1] > 0.99


def assert_valid(body: Body) -> None:
    for limb in body.limbs.values():
        assert_chain_closed(limb, body.carrying_angle_deg)
        for segment in limb.segments.values():
            assert segment.mass_kg > 0.05
            assert segment.length_m > 0.05
            inertia = segment.inertia_kg_m2
            assert np.abs(inertia - inertia.T).max() == 0.0
            a, b, c = np.linalg.eigvalsh(inertia)
            assert a > 0.0
            assert a + b > c  # as of any mass distribution
        for muscle in limb.muscles:
            assert muscle.F0_N > 50.0
            assert 0.02 < muscle.l0_m < 0.5
            assert np.isfinite(muscle.origin_m).all()
            assert np.isfinite(muscle.insertion_m).all()
    assert 0.3 < body.strength_factor < 1.4
    assert body.eye_height_sitting_m < body.sitting_height_m < 0.6 * body.biometrics.stature_m
    assert body.acromial_height_sitting_m < body.eye_height_sitting_m
    assert 0.25 < body.biacromial_breadth_m < 0.5
    assert 0.25 < body.hip_breadth_sitting_m < 0.55


@settings(max_examples=100, deadline=None)
@given(st.one_of(TABLE_3, TABLE_4))
def test_every_pilot_of_the_search_boxes_is_sound(pilot: Biometrics) -> None:
    assert_valid(make_body(pilot, ("left", "right")))


@pytest.mark.parametrize("sex", ["male", "female"])
def test_every_pilot_of_the_sanity_ranges_is_sound(sex: str) -> None:
    for age, stature, mass in itertools.product((18.0, 54.0, 90.0), (1.40, 1.80, 2.20), (35.0, 117.5, 200.0)):
        if 14.0 <= mass / stature**2 <= 50.0:
            body = make_body(Biometrics(age, stature, mass, sex), ("right",))
            assert_chain_closed(body.limbs["right"], body.carrying_angle_deg)
            assert body.strength_factor > 0.2
            assert all(segment.mass_kg > 0.05 for segment in body.limbs["right"].segments.values())


# ---- the two sides


def test_left_is_the_mirror_image_of_right() -> None:
    body = make_body(Biometrics(52.0, 1.68, 71.0, "female"), ("left", "right"))
    left, right = body.limbs["left"], body.limbs["right"]
    assert (left.side, right.side) == ("left", "right")
    for field in dataclasses.fields(Limb):
        if field.name.startswith(("HU", "HR", "UH", "W_", "grip")):
            assert np.array_equal(getattr(left, field.name), MIRROR @ getattr(right, field.name))
        if "axis" in field.name:  # axial vectors
            assert np.array_equal(getattr(left, field.name), -MIRROR @ getattr(right, field.name))
    for name in SEGMENTS:
        assert np.array_equal(left.anatomical_origin_m[name], MIRROR @ right.anatomical_origin_m[name])
        assert np.array_equal(left.anatomical_axes[name], MIRROR @ right.anatomical_axes[name] @ MIRROR)
        assert np.array_equal(left.segments[name].com_m, MIRROR @ right.segments[name].com_m)
        inertia = MIRROR @ right.segments[name].inertia_kg_m2 @ MIRROR
        assert np.array_equal(left.segments[name].inertia_kg_m2, inertia)
        assert left.segments[name].mass_kg == right.segments[name].mass_kg
        assert left.segments[name].length_m == right.segments[name].length_m
    for on_left, on_right in zip(left.muscles, right.muscles, strict=True):
        assert np.array_equal(on_left.origin_m, MIRROR @ on_right.origin_m)
        assert np.array_equal(on_left.insertion_m, MIRROR @ on_right.insertion_m)
        assert (on_left.name, on_left.F0_N, on_left.l0_m) == (on_right.name, on_right.F0_N, on_right.l0_m)


def test_one_side_does_not_depend_on_the_other() -> None:
    alone = make_body(MEAN_MAN, ("left",)).limbs["left"]
    both = make_body(MEAN_MAN, ("right", "left")).limbs["left"]
    assert np.array_equal(alone.anatomical_axes["hand"], both.anatomical_axes["hand"])
    assert [m.l0_m for m in alone.muscles] == [m.l0_m for m in both.muscles]


@pytest.mark.parametrize("limbs", [(), ("leg",), ("left", "Right")])
def test_limbs_that_do_not_exist(limbs: tuple[str, ...]) -> None:
    with pytest.raises(StudyError, match="'left', 'right' or both"):
        make_body(MEAN_MAN, limbs)


# ---- trends


@settings(max_examples=50, deadline=None)
@given(TABLE_3)
def test_trends(pilot: Biometrics) -> None:
    body = make_body(pilot)
    taller = make_body(dataclasses.replace(pilot, stature_m=pilot.stature_m + 0.05))
    heavier = make_body(dataclasses.replace(pilot, mass_kg=pilot.mass_kg + 5.0))
    older = make_body(dataclasses.replace(pilot, age_years=pilot.age_years + 5.0))
    for name in SEGMENTS:
        assert taller.limbs["left"].segments[name].length_m > body.limbs["left"].segments[name].length_m
        assert heavier.limbs["left"].segments[name].mass_kg > body.limbs["left"].segments[name].mass_kg
    assert taller.eye_height_sitting_m > body.eye_height_sitting_m
    assert heavier.strength_factor > body.strength_factor
    assert older.strength_factor < body.strength_factor
    if pilot.sex == "male":
        woman = make_body(dataclasses.replace(pilot, sex="female"))
        assert woman.strength_factor < body.strength_factor
        assert arm_mass_kg(woman) < arm_mass_kg(body)


# ---- what is beyond the data


@pytest.mark.parametrize(
    ("pilot", "words"),
    [
        (Biometrics(59.0, 1.75, 80.0, "male"), ["age 59 years"]),
        (Biometrics(40.0, 1.995, 95.0, "male"), ["stature 1.995 m"]),
        (Biometrics(40.0, 1.84, 70.0, "female"), ["stature 1.84 m"]),
        (Biometrics(40.0, 1.75, 92.0, "male"), ["BMI 30.04 kg/m^2 is not below 30"]),
        (Biometrics(40.0, 1.99, 60.0, "male"), ["BMI 15.15 kg/m^2 is outside"]),
        (Biometrics(65.0, 1.55, 110.0, "female"), ["age 65", "BMI 45.79 kg/m^2 is outside", "BMI 45.79 kg/m^2 is not"]),
        (Biometrics(58.0, 1.828, 99.0, "female"), []),
    ],
)
def test_extrapolation_is_said(pilot: Biometrics, words: list[str]) -> None:
    said = make_body(pilot).extrapolated
    assert len(said) == len(words)
    assert all(word in sentence for word, sentence in zip(words, said, strict=True))


def test_data_files_are_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    make_body(MEAN_MAN)

    def read_again(path: object) -> None:
        raise AssertionError(f"{path} read again")

    monkeypatch.setattr(pilotgen.study.yaml_file, "read_yaml", read_again)
    make_body(MEAN_WOMAN, ("left", "right"))
