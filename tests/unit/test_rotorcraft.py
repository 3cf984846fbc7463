"""Rotorcraft by name and by numbers; every wrong entry is refused with a message that helps.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from typing import Any

import pytest

from pilotgen.errors import StudyError
from pilotgen.study.rotorcraft import Rotorcraft, bundled_rotorcraft, load_rotorcraft

PUMA: dict[str, Any] = {
    "mass_kg": 7345.0,
    "blades": 4,
    "rotor_radius_m": 7.49,
    "rotor_speed_hz": 4.5,
    "lock_number": 8.7,
    "flap_static_moment_kg_m": 276.48,
    "flap_inertia_kg_m2": 1339.19,
    "flap_frequency_ratio": 1.03,
}


def test_puma_is_table_1() -> None:
    puma = load_rotorcraft("iar330-puma")
    assert {key: getattr(puma, key) for key in PUMA} == PUMA
    assert puma.name == "IAR 330 Puma"
    assert "Table 1" in puma.source


@pytest.mark.parametrize("name", bundled_rotorcraft())
def test_every_bundled_rotorcraft_loads_and_names_its_source(name: str) -> None:
    assert load_rotorcraft(name).source != Rotorcraft(**PUMA).source


def test_mapping_equals_bundled_numbers() -> None:
    own = load_rotorcraft({**PUMA, "name": "mine"})
    assert own.name == "mine"
    assert own.rotor_speed_hz == load_rotorcraft("iar330-puma").rotor_speed_hz


@pytest.mark.parametrize(
    ("rotorcraft", "words"),
    [
        ("iar330puma", ["did you mean 'iar330-puma'"]),
        ("zeppelin", ["'zeppelin' is not known", "iar330-puma", "mass_kg"]),
        (4.5, ["not a mapping", "iar330-puma"]),
        ({**PUMA, "rotor_speed_hz": 265}, ["= 265 is outside 1 to 15 Hz", "rpm", "4.42 Hz"]),
        ({**PUMA, "rotor_speed_hz": 28.27}, ["rad/s", "4.5 Hz"]),
        ({**PUMA, "rotor_speed_hz": float("nan")}, ["rotor_speed_hz"]),
        ({**PUMA, "rotor_speed_rpm": 265}, ["rotor_speed_rpm", "rotor_speed_hz: 4.417"]),
        ({**PUMA, "rotor_speed_rad_s": 28.27}, ["rotor_speed_hz: 4.499"]),
        ({**PUMA, "rotor_speed_rpm": "fast"}, ["given in Hz"]),
        ({**PUMA, "mass": 7345}, ["key 'mass' is not known", "did you mean 'mass_kg'"]),
        ({key: value for key, value in PUMA.items() if key != "blades"}, ["key 'blades' is missing"]),
        ({**PUMA, "blades": 4.5}, ["whole number"]),
        ({**PUMA, "blades": float("inf")}, ["whole number"]),
        ({**PUMA, "blades": 0}, ["blades", "1 to 10"]),
        ({**PUMA, "lock_number": "8.7"}, ["lock_number", "is not a number"]),
        ({**PUMA, "mass_kg": True}, ["mass_kg", "is not a number"]),
        ({**PUMA, "mass_kg": 7.345}, ["mass_kg", "kg"]),
        ({**PUMA, "rotor_radius_m": 7490}, ["rotor_radius_m", "metres"]),
        ({**PUMA, "flap_frequency_ratio": 0.9}, ["flap_frequency_ratio"]),
        ({**PUMA, "flap_static_moment_kg_m": 2000}, ["flap_static_moment_kg_m", "too large"]),
        ({**PUMA, "name": 3}, ["name", "text"]),
    ],
)
def test_wrong_entries_are_refused(rotorcraft: Any, words: list[str]) -> None:
    with pytest.raises(StudyError) as caught:
        load_rotorcraft(rotorcraft)
    for word in words:
        assert word in str(caught.value)
