"""Age, stature, mass and sex of one pilot.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pilotgen.errors import StudyError
from pilotgen.study.fields import MULTIBODY
from pilotgen.study.schema import PILOT_VALUES, SCHEMA
from pilotgen.study.wording import shown

_KEYS = PILOT_VALUES[MULTIBODY]


@dataclass(frozen=True)
class Biometrics:
    """What a study varies about a pilot."""

    age_years: float
    stature_m: float
    mass_kg: float
    sex: str  # "male" | "female"

    @property
    def bmi(self) -> float:
        """Body mass index [kg/m^2]."""
        return self.mass_kg / self.stature_m**2


def biometrics_from(values: Mapping[str, float], sex: str) -> Biometrics:
    """Make the biometrics of one pilot from the values of a study.

    Parameters
    ----------
    values : Mapping[str, float]
        `age_years`, `stature_m` and exactly one of `mass_kg` and `bmi` [kg/m^2]; nothing else.
    sex : str
        `male` or `female`.

    Raises
    ------
    StudyError
        A value is missing, given twice (mass and BMI), unknown, not a finite number, or no adult has it.
    """
    SCHEMA["pilot.sex"].check(f"sex = {sex!r}", sex)
    for key in values:
        if key not in _KEYS:
            raise StudyError(f"unknown biometric {key!r}; age_years, stature_m and one of mass_kg and bmi are wanted")
    for key in ("age_years", "stature_m"):
        if key not in values:
            raise StudyError(f"{key} is missing; age_years, stature_m and one of mass_kg and bmi are wanted")
    if ("mass_kg" in values) == ("bmi" in values):
        what = "both mass_kg and bmi are given" if "bmi" in values else "neither mass_kg nor bmi is given"
        raise StudyError(f"{what}; exactly one of them is wanted (bmi = mass_kg / stature_m^2)")

    age_years = _checked("age_years", values["age_years"])
    stature_m = _checked("stature_m", values["stature_m"])
    if "mass_kg" in values:
        mass_kg = _checked("mass_kg", values["mass_kg"])
        _checked("bmi", mass_kg / stature_m**2, " (from mass_kg and stature_m)")
    else:
        bmi = _checked("bmi", values["bmi"])
        mass_kg = _checked("mass_kg", bmi * stature_m**2, " (from bmi and stature_m)")
    return Biometrics(age_years, stature_m, mass_kg, sex)


def _checked(name: str, value: object, told: str = "") -> float:
    # Sanity of an adult who can hold a stick, not the range of the source data (`Body.extrapolated` says that).
    return float(SCHEMA[f"nominal.{name}"].check(f"{name} = {shown(value)}{told}", value))
