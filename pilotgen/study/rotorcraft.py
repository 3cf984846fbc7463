"""Rotorcraft given by the symbols of the paper's Table 1: bundled ones, or a mapping in the study file.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pilotgen.study.fields import Mistake, Problems, Value, shown
from pilotgen.study.reader import read_section
from pilotgen.study.schema import SCHEMA, defaults, members
from pilotgen.study.yaml_file import YamlDocument, bundled

NUMBERS = tuple(key for key, path in members("rotorcraft").items() if SCHEMA[path].numeric)


@dataclass(frozen=True)
class Rotorcraft:
    """What the heave and coning model needs to know of a rotorcraft (paper, Table 1)."""

    mass_kg: float
    blades: int
    rotor_radius_m: float
    rotor_speed_hz: float
    lock_number: float
    flap_static_moment_kg_m: float
    flap_inertia_kg_m2: float
    flap_frequency_ratio: float
    name: str = "rotorcraft of the study"
    source: str = "study file"

    def __post_init__(self) -> None:
        for key in NUMBERS:
            value = getattr(self, key)
            SCHEMA[f"rotorcraft.{key}"].check(f"rotorcraft.{key} = {shown(value)}", value)
        coupling = self.blades * self.flap_static_moment_kg_m**2
        if coupling >= self.mass_kg * self.flap_inertia_kg_m2:
            raise Mistake(
                "rotorcraft.flap_static_moment_kg_m",
                self.flap_static_moment_kg_m,
                f"is too large for mass_kg = {self.mass_kg:g} and flap_inertia_kg_m2 = {self.flap_inertia_kg_m2:g}: "
                "blades weigh more than the whole rotorcraft (blades * S^2 must be below mass * I)",
            )


def bundled_rotorcraft() -> list[str]:
    """Names of the bundled rotorcraft."""
    return list(bundled("rotorcraft").value)


def load_rotorcraft(rotorcraft: str | Mapping[str, Any]) -> Rotorcraft:
    """A bundled rotorcraft by name, or one given by its numbers.

    Parameters
    ----------
    rotorcraft : str or mapping
        A name of `bundled_rotorcraft()`, or the fields of `Rotorcraft` (`name` and `source` optional).

    Raises
    ------
    StudyError
        The name is not known, a key is missing or unknown, a value has the wrong type or is out of range.
    """
    data = dict(rotorcraft) if isinstance(rotorcraft, Mapping) else rotorcraft
    return rotorcraft_from(_checked(Value(YamlDocument({"rotorcraft": data}, "", "", {}), ("rotorcraft",))))


def rotorcraft_from(checked: str | Mapping[str, Any]) -> Rotorcraft:
    """The rotorcraft of checked data: a bundled name, or numbers."""
    given: Mapping[str, Any] = (
        _checked(Value(bundled("rotorcraft"), (checked,))) if isinstance(checked, str) else checked
    )
    return Rotorcraft(**{**defaults("rotorcraft"), **given})


def _checked(value: Value) -> Any:
    problems = Problems()
    checked = read_section(value, "rotorcraft", "", problems)
    problems.tell()
    return checked
