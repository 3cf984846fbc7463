"""From a YAML document to checked plain data, by the schema; mistakes are told together.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pilotgen.errors import StudyError
from pilotgen.study.fields import REQUIRED, ByName, Choice, Problems, Section, Value
from pilotgen.study.schema import (
    MAYO_PRESETS,
    PILOT_VALUES,
    SCHEMA,
    SECTIONS_OF_A_RUN,
    applies,
    field_of,
    locate,
    members,
)
from pilotgen.study.wording import did_you_mean, nearest
from pilotgen.study.yaml_file import YamlDocument

_WHOLE_STUDY = Section()


def read_tree(document: YamlDocument, problems: Problems) -> Any:
    """Return a study's checked values as nested mappings; keys that are not there stay away.

    `problems` gets the mistakes; the data is complete only if there are none.
    """
    data = document.value
    model = ""
    if isinstance(data, dict) and isinstance(data.get("pilot"), dict):
        named = data["pilot"].get("model")
        model = named if isinstance(named, str) and named in PILOT_VALUES else ""
    return read_section(Value(document, ()), "", model, problems)


def read_section(value: Value, path: str, model: str, problems: Problems) -> Any:
    """Return the checked data of one section: a mapping, a word that stands for one, or None."""
    declared = SCHEMA.get(path, _WHOLE_STUDY)
    assert isinstance(declared, Section)
    data = value.data
    if data is None and declared.null:
        return None
    known = members(path)
    if isinstance(data, str) and declared.words is not None:
        with problems.collect():
            return _word(value, path, model, declared.words())
        return None
    required = [key for key, own in known.items() if SCHEMA[own].default is REQUIRED and applies(own, model)]
    if isinstance(data, dict) and any(key in data for key in declared.instead):
        required = []
    if not isinstance(data, dict):
        wanted = f"a mapping with the keys {', '.join(required or known)} is wanted"
        if declared.words is not None:
            wanted = f"one of {', '.join(declared.words())} or {wanted}"
        problems.add(value.error(f"is empty; {wanted}" if data is None else f"is not a mapping; {wanted}"))
        return None
    given: dict[str, Any] = {}
    meant: set[str | None] = set()  # by keys that are misspelt: not missed as well
    for key in data:
        entry = value.child(key)
        if key not in known:
            problems.add(_unknown(entry, key, known, declared))
            meant.add(nearest(key, list(known)))
        elif model and not applies(known[key], model):
            problems.add(entry.error(f"means nothing for pilot.model = {model!r}; remove it"))
        else:
            given[key] = _entry(entry, known[key], model, problems)
    for key in required:
        if key not in data and key not in meant and (model or not SCHEMA[known[key]].model):
            problems.add(value.missing(key))
    _check_either(value, path, declared, model, problems)
    return given


def _check_either(value: Value, path: str, declared: Section, model: str, problems: Problems) -> None:
    wanted = [key for key in declared.either if model and applies(f"{path}.{key}", model)]
    there = [key for key in wanted if key in value.data]
    if len(there) > 1:
        others = " and ".join(there[1:])
        problems.add(value.child(there[0]).error(f"and {others} exclude each other: {declared.why}; keep one of them"))
    if wanted and not there:
        problems.add(value.missing(*wanted))


def _entry(entry: Value, path: str, model: str, problems: Problems) -> Any:
    declared = SCHEMA[path]
    if isinstance(declared, Section):
        return read_section(entry, path, model, problems)
    if isinstance(declared, ByName):
        return read_by_name(entry, declared, model, problems)
    with problems.collect():
        return declared.read(entry)
    return None


def _word(value: Value, path: str, model: str, words: Sequence[str]) -> str:
    word: str = value.data
    if path == "nominal":
        if model != "mayo":
            raise value.error(
                "is no multibody pilot; give {age_years, stature_m, and mass_kg or bmi}"
                + (", or pilot.model: mayo, which knows pilots by that name" if word in MAYO_PRESETS else "")
            )
        if word not in words:
            raise value.error(f"is no pilot that Mayo measured; choose one of: {', '.join(words)}")
    elif word not in words:
        keys = ", ".join(key for key, own in members(path).items() if SCHEMA[own].default is REQUIRED)
        guess = did_you_mean(word.strip().lower().replace("_", "-"), words)
        raise value.error(
            f"is not known; {guess}choose one of: {', '.join(words)}; or give numbers as a mapping with the keys "
            f"{keys or ', '.join(members(path))}"
        )
    return word


def _unknown(entry: Value, key: str, known: Mapping[str, Any], declared: Section) -> StudyError:
    text = f"{entry.place}{entry.key}: key {key!r} is not known here; "
    if key.isdigit() and entry.data is None:
        return StudyError(f"{text}is the comma before it meant as a decimal point? write 1.775, not 1,775")
    special = declared.unknown(key, entry.data) if declared.unknown is not None else ""
    if special:
        return StudyError(text + special)
    return StudyError(f"{text}{did_you_mean(key, list(known))}known keys: {', '.join(known)}")


def read_by_name(value: Value, declared: ByName, model: str, problems: Problems) -> dict[str, Any]:
    """Return the checked entries of a mapping from names of numbers (short names or paths), in its order."""
    own = ", ".join(PILOT_VALUES.get(model, ()))
    if not isinstance(value.data, dict) or not value.data:
        problem = "is empty" if value.data is None or value.data == {} else "is not a mapping"
        problems.add(value.error(f"{problem}; name at least one of: {own}, or any other number by its path"))
        return {}
    kept: dict[str, Any] = {}
    seen: dict[tuple[str, int | None], str] = {}
    for name in value.data:
        entry = value.child(name)
        with problems.collect():
            try:
                place, number = locate(name), field_of(name)
            except StudyError as error:
                raise StudyError(f"{entry.place}{entry.key}: {name!r} {error}") from None
            if model and not applies(place[0], model):
                raise entry.error(f"means nothing for pilot.model = {model!r}; remove it")
            varies = number.numeric or (declared.words and isinstance(number, Choice))
            if not varies or place[0].partition(".")[0] in SECTIONS_OF_A_RUN:
                raise entry.error("is nothing that can vary; numbers of pilot, cockpit and rotorcraft can")
            if place in seen:
                raise entry.error(f"is the same number as {seen[place]}; keep one of them")
            seen[place] = name
            kept[name.removeprefix("nominal.")] = declared.entry(entry, number)
    return kept
