"""Rotorcraft given by the symbols of the paper's Table 1: bundled ones, or a mapping in the study file.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import hashlib
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pilotgen.errors import FileError
from pilotgen.files import refuse_special
from pilotgen.study.fields import REQUIRED, Mistake, Problems, Section, Value
from pilotgen.study.loop_section import LoopSignals
from pilotgen.study.reader import read_section
from pilotgen.study.schema import SCHEMA, defaults, members
from pilotgen.study.wording import shown
from pilotgen.study.yaml_file import YamlDocument, bundled

HEAVE_NUMBERS = tuple(
    key for key, path in members("rotorcraft").items() if SCHEMA[path].numeric and SCHEMA[path].default is REQUIRED
)
_FILES = ("state_space", "transfer_function", "frequency_response")


@dataclass(frozen=True)
class Rotorcraft:
    """What the dynamics of a rotorcraft are made of: symbols of the paper's Table 1, a file, or roll with flapping.

    And what stands around. The symbols are NaN where something else gives the dynamics.
    """

    mass_kg: float = math.nan
    blades: int = 0
    rotor_radius_m: float = math.nan
    rotor_speed_hz: float = math.nan
    lock_number: float = math.nan
    flap_static_moment_kg_m: float = math.nan
    flap_inertia_kg_m2: float = math.nan
    flap_frequency_ratio: float = math.nan
    name: str = "rotorcraft of the study"
    source: str = "study file"
    state_space: str | None = None
    transfer_function: str | None = None
    frequency_response: str | None = None
    roll: Mapping[str, Any] | None = None
    inflow_lead_rad_s: float | None = None
    delay_s: float = 0.0
    actuator: Mapping[str, Any] | None = None
    notch: Mapping[str, Any] | None = None
    low_pass: Mapping[str, Any] | None = None
    sling: Mapping[str, Any] | None = None

    @property
    def plant_file(self) -> str | None:
        """The file with the dynamics, if there is one."""
        return self.state_space or self.transfer_function or self.frequency_response

    def given(self) -> dict[str, Any]:
        """What a study file has to say of it: no symbol that is not there, no part that is left out."""
        plain = dataclasses.asdict(self)
        unset = {key: field.default for key, field in self.__dataclass_fields__.items()}
        return {key: value for key, value in plain.items() if value == value and value != unset[key]}

    def determining(self) -> dict[str, Any]:
        """What determines its dynamics; of a file its content, not its name. FileError if that cannot be read."""
        plain = {key: value for key, value in self.given().items() if key not in ("name", "source", *_FILES)}
        if self.plant_file is not None:
            refuse_special(self.plant_file)
            try:
                plain["file_sha256"] = hashlib.sha256(Path(self.plant_file).read_bytes()).hexdigest()
            except OSError as error:
                raise FileError(f"{self.plant_file}: cannot be read ({error.strerror})") from None
        return plain

    def __post_init__(self) -> None:
        if self.plant_file is not None or self.roll is not None:
            self._check_plant()
            return
        for key in HEAVE_NUMBERS:
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

    def _check_plant(self) -> None:
        given = [key for key in HEAVE_NUMBERS if getattr(self, key) == getattr(self, key) and getattr(self, key)]
        given += ["sling"] if self.sling is not None else []
        if given:
            raise Mistake(
                f"rotorcraft.{given[0]}",
                getattr(self, given[0]),
                "means nothing beside a file with the whole dynamics; remove it"
                if self.plant_file is not None
                else "means nothing beside rotorcraft.roll; remove it",
            )
        if self.roll is not None and self.inflow_lead_rad_s is not None:
            raise Mistake(
                "rotorcraft.inflow_lead_rad_s", self.inflow_lead_rad_s, "is of thrust, not of roll; remove it"
            )
        first, *others = [key for key in (*_FILES, "roll") if getattr(self, key) is not None]
        if others:
            raise Mistake(f"rotorcraft.{others[0]}", getattr(self, others[0]), f"and {first} exclude each other")


def beside(document: YamlDocument, checked: Any) -> tuple[Any, str]:
    """Checked data of a study's rotorcraft, and the study's text, with the whole path of its plant file.

    Files lie beside the study that names them; results keep the study's text and are read elsewhere.
    """
    text = document.text
    if not isinstance(checked, dict):
        return checked, text
    whole = dict(checked)
    for key in _FILES:
        given = checked.get(key)
        if given:
            whole[key] = os.path.abspath(Path(document.name).parent / given)
            if text.count(given) == 1:
                text = text.replace(given, whole[key])
    return whole, text


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
    """The rotorcraft of checked data: a bundled name, or numbers. Mistake (a StudyError) if a part lacks a number."""
    given: Mapping[str, Any] = (
        _checked(Value(bundled("rotorcraft"), (checked,))) if isinstance(checked, str) else checked
    )
    for part in ("actuator", "notch", "low_pass", "sling", "roll"):
        if given.get(part) is not None:
            given = {**given, part: _whole(f"rotorcraft.{part}", given[part])}
    files = {key: os.path.abspath(given[key]) for key in _FILES if given.get(key)}
    return Rotorcraft(**{**defaults("rotorcraft"), **given, **files})


def check_rotorcraft(rotorcraft: Rotorcraft, loop: LoopSignals) -> None:
    """Raise Mistake if a rotorcraft is not one of a study's loop."""
    name, words = rotorcraft.name, loop.words
    if rotorcraft.roll is not None and (loop.input, loop.output) != ("roll", "lateral"):
        wanted = "give loop: {input: roll, output: lateral}"
        raise Mistake("rotorcraft", name, f"rolls, and the loop is {words}; {wanted}")
    if loop.usual:
        return
    if rotorcraft.roll is None and rotorcraft.plant_file is None:
        other = ", a bundled roll-... or rotorcraft.roll" if loop.input == "roll" else ""
        raise Mistake("rotorcraft", name, f"heaves by its collective; {words} needs a file of its dynamics{other}")
    lead = rotorcraft.inflow_lead_rad_s
    if lead is not None:
        raise Mistake("rotorcraft.inflow_lead_rad_s", lead, f"is of thrust, not of {loop.input}; remove it")


def _whole(path: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """A part with its defaults; Mistake if a number is missing."""
    whole = {**defaults(path), **given}
    for key, own in members(path).items():
        if SCHEMA[own].default is REQUIRED and whole.get(key) is None:
            raise Mistake(path, dict(given), f"lacks {key}; give it as well")
        if isinstance(SCHEMA[own], Section) and whole.get(key) is not None:
            whole[key] = _whole(own, whole[key])
    return whole


def _checked(value: Value) -> Any:
    problems = Problems()
    checked = read_section(value, "rotorcraft", "", problems)
    problems.tell()
    return checked
