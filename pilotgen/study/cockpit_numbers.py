"""The numbers of a cockpit: the bundled ones (`pilotgen/data/cockpit.yaml`), or those with changes.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from pilotgen.study.fields import Mistake, Problems, Value
from pilotgen.study.reader import read_section
from pilotgen.study.yaml_file import YamlDocument, bundled

CockpitNumbers = Mapping[str, Mapping[str, Any]]  # section -> key -> number, or list of numbers


def cockpit_numbers(changes: Mapping[str, Any] | None = None) -> CockpitNumbers:
    """The numbers of the bundled cockpit, with the changes of a mapping of the same shape.

    Raises
    ------
    StudyError
        An unknown key, or a number of the wrong kind or out of its range.
    """
    if not changes:
        return _bundled()
    return cockpit_from(_checked(Value(YamlDocument({"cockpit": changes}, "", "", {}), ("cockpit",))))


def cockpit_from(checked: str | Mapping[str, Any] | None) -> CockpitNumbers:
    """The cockpit of checked data: a bundled one by name (None: the only one), or changes to it."""
    base = _bundled()
    if checked is None or isinstance(checked, str):
        return base
    merged = {section: _merged(numbers, checked.get(section, {})) for section, numbers in base.items()}
    _check_together(merged)
    return merged


def _merged(numbers: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers with changes; a mapping among them is changed key by key, `none` makes it None."""
    found = {**numbers, **changes}
    for key, data in found.items():
        if isinstance(data, Mapping):
            found[key] = {**(numbers[key] or {}), **data}
        elif data == "none":
            found[key] = None
    return found


@cache
def _bundled() -> CockpitNumbers:
    numbers: CockpitNumbers = _checked(Value(bundled("cockpit"), ()))
    _check_together(numbers)
    return numbers


def _checked(value: Value) -> Any:
    problems = Problems()
    checked = read_section(value, "cockpit", "", problems)
    problems.tell()
    return checked


def _check_together(numbers: CockpitNumbers) -> None:
    lowest, highest = (float(numbers["collective"][f"{k}_angle_deg"]) for k in ("lowest", "highest"))
    if lowest >= highest:
        raise Mistake(
            "cockpit.collective.lowest_angle_deg",
            lowest,
            f"must be below highest_angle_deg = {highest:g} deg; swap them",
        )
    lever = numbers["collective"]
    mass, inertia, unbalance = (float(lever[key]) for key in ("mass_kg", "inertia_kg_m2", "unbalance_kg_m"))
    if unbalance**2 >= mass * inertia:
        raise Mistake(
            "cockpit.collective.unbalance_kg_m",
            unbalance,
            f"is more than a lever of {mass:g} kg and {inertia:g} kg m^2 can have (its square must be below "
            f"{mass * inertia:.3g}); give mass_kg and inertia_kg_m2 with the balance weight",
        )
