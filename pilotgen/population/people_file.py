"""A CSV of people: one a row, units in the header.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from pilotgen.errors import FileError, StudyError
from pilotgen.files import refuse_special
from pilotgen.study.schema import SCHEMA
from pilotgen.study.yaml_file import plain_scalar

COLUMNS = ("age_years", "stature_m", "mass_kg", "bmi", "sex")
_WHOLE = 1_000_000  # rows: what fits in memory


def read_people(path: Path, sex: str) -> list[dict[str, Any]]:
    """Read a CSV with the columns age_years, stature_m, mass_kg or bmi, and sex if they are not all of one.

    Parameters
    ----------
    path : Path
        The file, UTF-8, comma between cells.
    sex : str
        Of everybody where there is no such column.

    Returns
    -------
    list of dict
        age_years, stature_m, mass_kg and `pilot.sex` of each.

    Raises
    ------
    FileError
        The file cannot be read.
    StudyError
        A column or a value that is not as wanted, an empty file, an empty row, the same person twice.
    """
    refuse_special(path)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file, strict=True))
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror})") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileError(f"{path}: is no CSV in UTF-8 ({error})") from None
    if len(rows) < 2:
        raise StudyError(f"{path}: holds no people; a header {','.join(COLUMNS[:3])} and a row for each are wanted")
    header = [cell.strip() for cell in rows[0]]
    _check_header(header, path)
    people: list[dict[str, Any]] = []
    seen: dict[tuple[Any, ...], int] = {}
    for line, row in enumerate(rows[1:], start=2):
        person = _person(header, row, f"{path}:{line}", sex)
        first = seen.setdefault(tuple(person.values()), line)
        if first != line:
            raise StudyError(f"{path}:{line}: is the same person as line {first}; remove one of them")
        people.append(person)
    if len(people) > _WHOLE:
        raise StudyError(f"{path}: holds {len(people)} people; at most {_WHOLE} are read")
    return people


def _check_header(header: list[str], path: Path) -> None:
    for name in header:
        if name not in COLUMNS:
            raise StudyError(
                f"{path}:1: column {name!r} is not known; columns are age_years, stature_m (metres, not centimetres), "
                "mass_kg or bmi, and sex"
            )
        if header.count(name) > 1:
            raise StudyError(f"{path}:1: column {name!r} stands there twice; keep one")
    for name in ("age_years", "stature_m"):
        if name not in header:
            raise StudyError(f"{path}:1: column {name!r} is missing; add it")
    if ("mass_kg" in header) == ("bmi" in header):
        raise StudyError(f"{path}:1: exactly one of the columns mass_kg and bmi is wanted")


def _person(header: list[str], row: list[str], where: str, sex: str) -> dict[str, Any]:
    if not any(cell.strip() for cell in row):
        raise StudyError(f"{where}: the row is empty; remove it")
    if len(row) != len(header):
        raise StudyError(f"{where}: has {len(row)} cells, the header {len(header)}; is a comma meant as a point?")
    found: dict[str, Any] = {"sex": sex}
    for name, cell in zip(header, row, strict=True):
        path = "pilot.sex" if name == "sex" else f"nominal.{name}"
        data = plain_scalar(cell.strip())
        found[name] = SCHEMA[path].check(f"{where}: {name} = {cell.strip()}", data)
    if "bmi" in found:
        found["mass_kg"] = SCHEMA["nominal.mass_kg"].check(
            f"{where}: mass_kg (of bmi = {found['bmi']:g})", found["bmi"] * found["stature_m"] ** 2
        )
    return {**{name: found[name] for name in ("age_years", "stature_m", "mass_kg")}, "pilot.sex": found["sex"]}
