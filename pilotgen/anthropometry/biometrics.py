"""Age, stature, mass and sex of one pilot.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from numbers import Real

from pilotgen.errors import StudyError

SEXES = ("male", "female")

# Sanity of an adult who can hold a stick, not the range of the source data (`Body.extrapolated` says that).
# estimated: wide enough for every adult in ANSUR II and for the search boxes, narrow enough to catch wrong units.
AGE_RANGE_YEARS = (18.0, 90.0)
STATURE_RANGE_M = (1.30, 2.20)
MASS_RANGE_KG = (35.0, 200.0)
BMI_RANGE_KG_PER_M2 = (14.0, 50.0)

_KEYS = ("age_years", "stature_m", "mass_kg", "bmi")


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
    if sex not in SEXES:
        raise StudyError(f"sex is {sex!r}; 'male' or 'female' is wanted (the body regressions are fitted for each)")
    for key in values:
        if key not in _KEYS:
            raise StudyError(f"unknown biometric {key!r}; age_years, stature_m and one of mass_kg and bmi are wanted")
    for key in ("age_years", "stature_m"):
        if key not in values:
            raise StudyError(f"{key} is missing; age_years, stature_m and one of mass_kg and bmi are wanted")
    if ("mass_kg" in values) == ("bmi" in values):
        what = "both mass_kg and bmi are given" if "bmi" in values else "neither mass_kg nor bmi is given"
        raise StudyError(f"{what}; exactly one of them is wanted (bmi = mass_kg / stature_m^2)")

    age_years = _checked("age_years", values["age_years"], AGE_RANGE_YEARS, "years")
    stature_m = _checked("stature_m", values["stature_m"], STATURE_RANGE_M, "m")
    if "mass_kg" in values:
        mass_kg = _checked("mass_kg", values["mass_kg"], MASS_RANGE_KG, "kg")
        _checked("bmi (from mass_kg and stature_m)", mass_kg / stature_m**2, BMI_RANGE_KG_PER_M2, "kg/m^2")
    else:
        bmi = _checked("bmi", values["bmi"], BMI_RANGE_KG_PER_M2, "kg/m^2")
        mass_kg = _checked("mass_kg (from bmi and stature_m)", bmi * stature_m**2, MASS_RANGE_KG, "kg")
    return Biometrics(age_years, stature_m, mass_kg, sex)


def _checked(name: str, value: object, allowed: tuple[float, float], unit: str) -> float:
    if isinstance(value, bool) or not isinstance(value, Real):
        raise StudyError(f"{name} is {value!r}; a number in {unit} is wanted")
    number = float(value)
    low, high = allowed
    if math.isfinite(number) and low <= number <= high:
        return number
    hint = ""
    if name == "stature_m" and 1000.0 * low <= number <= 1000.0 * high:
        hint = f"; heights are in metres: did you mean {number / 1000.0:g}?"
    elif name == "stature_m" and 100.0 * low <= number <= 100.0 * high:
        hint = f"; heights are in metres, not centimetres: did you mean {number / 100.0:g}?"
    raise StudyError(f"{name} is {number:g} {unit}; {low:g} to {high:g} {unit} is wanted{hint}")
