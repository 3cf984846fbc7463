"""Rotorcraft given by the symbols of the paper's Table 1: bundled ones, or a mapping in the study file.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import yaml

from pilotgen.errors import StudyError
from pilotgen.study.validate import check_within

# Accepted range and unit of each symbol. Wide: from a 200 kg ultralight to a heavy-lift helicopter with eight blades;
# their job is to catch another unit, not to judge a design.
RANGES: dict[str, tuple[float, float, str, str]] = {
    "mass_kg": (100.0, 100_000.0, "kg", "the total mass of the vehicle"),
    "rotor_radius_m": (1.0, 25.0, "m", "the radius, not the diameter, in metres (1 ft = 0.3048 m)"),
    "rotor_speed_hz": (1.0, 15.0, "Hz", "revolutions per second"),
    "lock_number": (1.0, 20.0, "", "gamma = rho a c R^4 / I_beta, dimensionless"),
    "flap_static_moment_kg_m": (1.0, 10_000.0, "kg m", "first moment of one blade (1 slug ft = 4.448 kg m)"),
    "flap_inertia_kg_m2": (1.0, 100_000.0, "kg m^2", "second moment of one blade (1 slug ft^2 = 1.3558 kg m^2)"),
    "flap_frequency_ratio": (1.0, 1.5, "", "rotating flap frequency over rotor speed"),
}
NUMBERS = ("mass_kg", "blades", *list(RANGES)[1:])
_WORDS = ("name", "source")

# Names under which a rotor speed may come in another unit, and how many of that unit make one Hz.
_ROTOR_SPEED_UNITS = {
    "rotor_speed_rpm": 60.0,
    "rotor_speed_rad_s": 2.0 * math.pi,
    "rotor_speed_rad_per_s": 2.0 * math.pi,
}


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
        for key, (low, high, unit, hint) in RANGES.items():
            value = getattr(self, key)
            if key == "rotor_speed_hz":
                hint = _rotor_speed_hint(value)
            check_within(f"rotorcraft.{key}", value, low, high, unit, hint)
        if not 1 <= self.blades <= 10:
            raise StudyError(f"rotorcraft.blades = {self.blades} is outside 1 to 10")
        coupling = self.blades * self.flap_static_moment_kg_m**2
        if coupling >= self.mass_kg * self.flap_inertia_kg_m2:
            raise StudyError(
                f"rotorcraft: flap_static_moment_kg_m = {self.flap_static_moment_kg_m:g} is too large for mass_kg = "
                f"{self.mass_kg:g} and flap_inertia_kg_m2 = {self.flap_inertia_kg_m2:g}: blades weigh more than the "
                "whole rotorcraft (blades * S^2 must be below mass * I)"
            )


def bundled_rotorcraft() -> list[str]:
    """Names of the bundled rotorcraft."""
    return list(_bundled())


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
    if isinstance(rotorcraft, str):
        known = _bundled()
        if rotorcraft not in known:
            close = difflib.get_close_matches(rotorcraft.strip().lower().replace("_", "-"), known, n=1, cutoff=0.4)
            guess = f" did you mean {close[0]!r}?" if close else ""
            raise StudyError(
                f"rotorcraft = {rotorcraft!r} is not known;{guess} bundled: {', '.join(known)}; or give the numbers "
                f"as a mapping with the keys {', '.join(NUMBERS)}"
            )
        return _from_mapping(known[rotorcraft])
    if not isinstance(rotorcraft, Mapping):
        raise StudyError(
            f"rotorcraft = {rotorcraft!r} is neither a bundled name ({', '.join(_bundled())}) nor a mapping with the "
            f"keys {', '.join(NUMBERS)}"
        )
    return _from_mapping(rotorcraft)


@cache
def _bundled() -> dict[str, dict[str, Any]]:
    text = files("pilotgen").joinpath("data", "rotorcraft.yaml").read_text(encoding="utf-8")
    data: dict[str, dict[str, Any]] = yaml.safe_load(text)
    return data


def _from_mapping(mapping: Mapping[str, Any]) -> Rotorcraft:
    unknown = [str(key) for key in mapping if key not in NUMBERS + _WORDS]
    for key in unknown:
        per_hz = _ROTOR_SPEED_UNITS.get(key)
        if per_hz is not None:
            value = mapping[key]
            number = isinstance(value, int | float) and not isinstance(value, bool)
            instead = f"; write rotor_speed_hz: {value / per_hz:.4g}" if number else ""
            raise StudyError(f"rotorcraft.{key} is not a key: the rotor speed is given in Hz{instead}")
    if unknown:
        guesses = []
        for key in unknown:
            close = difflib.get_close_matches(key, NUMBERS + _WORDS, n=1, cutoff=0.5)
            guesses.append(f"{key} (did you mean {close[0]}?)" if close else key)
        raise StudyError(
            f"rotorcraft: unknown key{'s' if len(unknown) > 1 else ''} {', '.join(guesses)}; the keys are "
            f"{', '.join(NUMBERS + _WORDS)}"
        )
    missing = [key for key in NUMBERS if key not in mapping]
    if missing:
        raise StudyError(f"rotorcraft: missing key{'s' if len(missing) > 1 else ''} {', '.join(missing)}")
    values: dict[str, Any] = {}
    for key in NUMBERS:
        value = mapping[key]
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise StudyError(f"rotorcraft.{key} = {value!r} must be a number")
        if key == "blades":
            if value != int(value) if math.isfinite(value) else True:
                raise StudyError(f"rotorcraft.blades = {value!r} must be a whole number")
            values[key] = int(value)
        else:
            values[key] = float(value)
    for key in _WORDS:
        if key in mapping:
            if not isinstance(mapping[key], str):
                raise StudyError(f"rotorcraft.{key} = {mapping[key]!r} must be text")
            values[key] = mapping[key].strip()
    return Rotorcraft(**values)


def _rotor_speed_hint(value: float) -> str:
    if not math.isfinite(value) or value <= 15.0:
        return "give revolutions per second"
    as_rpm, as_rad = value / 60.0, value / (2.0 * math.pi)
    readings = []
    if 1.0 <= as_rpm <= 15.0:
        readings.append(f"{value:g} rpm = {as_rpm:.3g} Hz")
    if 1.0 <= as_rad <= 15.0:
        readings.append(f"{value:g} rad/s = {as_rad:.3g} Hz")
    if not readings:
        return "give revolutions per second"
    return f"it looks like rpm or rad/s; give Hz: {' or '.join(readings)}"
