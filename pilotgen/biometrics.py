"""Age, stature, mass and sex of one pilot.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from dataclasses import dataclass


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
