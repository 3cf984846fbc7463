"""Biometrics: what a study may say about a pilot, and what it is told when it says something else.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math

import pytest

from pilotgen.anthropometry.biometrics import Biometrics, biometrics_from
from pilotgen.errors import StudyError

GOOD = {"age_years": 35.0, "stature_m": 1.75, "mass_kg": 80.0}


def test_mass_gives_bmi() -> None:
    pilot = biometrics_from(GOOD, "male")
    assert pilot == Biometrics(35.0, 1.75, 80.0, "male")
    assert pilot.bmi == pytest.approx(26.12244897959184, rel=1e-14)  # 80 / 3.0625


def test_bmi_gives_mass() -> None:
    pilot = biometrics_from({"age_years": 40, "stature_m": 1.6, "bmi": 25}, "female")
    assert pilot.mass_kg == pytest.approx(64.0, rel=1e-14)
    assert isinstance(pilot.age_years, float)


@pytest.mark.parametrize(
    ("change", "sex", "words"),
    [
        ({}, "man", ("'man'", "male", "female")),
        ({"bmi": 25.0}, "male", ("both mass_kg and bmi", "exactly one")),
        ({"mass_kg": None}, "male", ("mass_kg = null", "35 to 200 kg is wanted")),
        ({"mass_kg": "80 kg"}, "male", ("'80 kg'", "35 to 200 kg is wanted")),
        ({"age_years": True}, "male", ("age_years = true", "number")),
        ({"stature_m": 1750.0}, "male", ("heights are in metres", "1750 mm is 1.75")),
        ({"stature_m": 175.0}, "male", ("heights are in metres", "175 cm is 1.75")),
        ({"stature_m": 2.21}, "male", ("2.21", "1.3 to 2.2 m")),
        ({"age_years": 17.9}, "male", ("17.9", "18 to 80 years")),
        ({"age_years": math.nan}, "male", ("nan", "18 to 80")),
        ({"mass_kg": 34.0}, "male", ("34", "35 to 200 kg")),
        ({"mass_kg": math.inf}, "male", ("inf", "35 to 200")),
        ({"mass_kg": 40.0}, "male", ("bmi = 13.06", "(from mass_kg and stature_m)", "14 to 50")),
        ({"weight_kg": 80.0}, "male", ("unknown biometric 'weight_kg'", "mass_kg")),
    ],
)
def test_bad_values_are_explained(change: dict[str, float], sex: str, words: tuple[str, ...]) -> None:
    with pytest.raises(StudyError) as caught:
        biometrics_from({**GOOD, **change}, sex)
    for word in words:
        assert word in str(caught.value)


def test_height_that_is_no_height_gets_no_hint() -> None:
    with pytest.raises(StudyError) as caught:
        biometrics_from({**GOOD, "stature_m": 500.0}, "male")
    assert "500" not in str(caught.value).partition(";")[2] and "500" in str(caught.value)


def test_missing_values_are_named() -> None:
    with pytest.raises(StudyError, match="age_years is missing"):
        biometrics_from({"stature_m": 1.75, "mass_kg": 80.0}, "male")
    with pytest.raises(StudyError, match="neither mass_kg nor bmi"):
        biometrics_from({"age_years": 35.0, "stature_m": 1.75}, "male")


def test_mass_from_bmi_is_checked_too() -> None:
    with pytest.raises(StudyError, match=r"mass_kg = 29.4 \(from bmi and stature_m\) is outside"):
        biometrics_from({"age_years": 35.0, "stature_m": 1.4, "bmi": 15.0}, "female")


def test_range_ends_are_allowed() -> None:
    assert biometrics_from({"age_years": 18, "stature_m": 1.4, "bmi": 50}, "female").bmi == pytest.approx(50.0)
    assert biometrics_from({"age_years": 80, "stature_m": 2.0, "mass_kg": 200}, "male").mass_kg == 200.0
