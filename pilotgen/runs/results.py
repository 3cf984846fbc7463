"""study.h5: everything a study evaluated (format page: docs/io_formats/study_results.md).

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pilotgen.hdf5 import NewFile, opened, text
from pilotgen.objectives import OBJECTIVES, ROBUST, Objective, Quantile, quantiles
from pilotgen.posture.posture import ANGLE_NAMES
from pilotgen.study.schema import study_unit

if TYPE_CHECKING:
    import h5py

FILETYPE = "pilotgen study"
VERSION = (1, 2)  # 1.2: the attribute `checksum`
CHECKSUM = "checksum"
CHUNK_ROWS = 1024  # rows per HDF5 chunk, at most: small studies are small files


@dataclass(frozen=True)
class Column:
    """A number of the result object that is a dataset of /evaluations; NaN where it is absent."""

    path: tuple[str, ...]
    infinite: bool = False  # null means that nothing limits


# Beside these every objective, and its frequency, has a column (pilotgen/objectives.py).
COLUMNS: dict[str, Column] = {
    "pilot_frequency_hz": Column(("bdft", "dominant_frequency_hz")),
    "pilot_damping": Column(("bdft", "dominant_damping")),
    "grip_motion_3hz_mm_per_m_s2": Column(("bdft", "grip_motion_3hz_mm_per_m_s2")),
    "certificate": Column(("bdft", "certificate")),
    "largest_activation": Column(("activation", "largest")),
    "age_years": Column(("biometrics", "age_years")),
    "stature_m": Column(("biometrics", "stature_m")),
    "mass_kg": Column(("biometrics", "mass_kg")),
    "bmi": Column(("biometrics", "bmi")),
    "delay_margin_s": Column(("loop", "delay_margin_s"), infinite=True),
}

DISTANCE = "mahalanobis_distance"  # of searches in the region of a population, a column of its own

FAILED_DRAWS = "failed_draws"  # of robust searches, a column of its own

# How names end -> unit; the longest that fits counts. A number without a unit in its name has none.
_UNITS = {
    "years": "years", "bmi": "kg/m^2", "m": "m", "mm": "mm", "kg": "kg", "s": "s", "hz": "Hz", "deg": "deg", "db": "dB",
    "rad": "rad", "n": "N", "n_m": "N m", "rad_s": "rad/s", "m_s": "m/s", "m_s2": "m/s^2", "rad_per_m": "rad/m",
    "n_per_m": "N/m", "n_s_per_m": "N s/m", "n_m_per_rad": "N m/rad", "n_m_s_per_rad": "N m s/rad",
    "kg_m": "kg m", "kg_m2": "kg m^2", "m2": "m^2", "mm_per_m_s2": "mm s^2/m",
}  # fmt: skip


_WITHOUT_UNIT = ("generation", "individual", "status", "stage", "reason", "rank", "stable", "sex")  # counts and words


def unit_of(name: str) -> str:
    """Unit of a number of a study, else what the end of a name tells, `1` for none: `gearing_rad_per_m` -> `rad/m`."""
    if known := study_unit(name):
        return known
    words = name.rsplit(".", 1)[-1].lower().split("_")
    for first in range(len(words)):
        unit = _UNITS.get("_".join(words[first:]))
        if unit is not None:
            return unit
    return "1"


@dataclass(frozen=True)
class Row:
    """One evaluation as the search saw it."""

    generation: int
    individual: int
    inputs: Mapping[str, float]
    result: Mapping[str, Any]  # the result object: status, loop, bdft, ... or status, stage, reason


@dataclass(frozen=True)
class StudyResults:
    """What study.h5 holds; arrays as documented on the format page."""

    attributes: dict[str, Any]
    names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    objective_names: tuple[str, ...]
    columns: dict[str, np.ndarray]
    members: np.ndarray  # (g, N); empty for samples
    front: np.ndarray

    @property
    def searched_quantiles(self) -> tuple[Quantile, ...]:
        """Quantiles over draws that were searched for; none of a study that takes each pilot as it has him."""
        return tuple(row for row in quantiles(self.objective_names) if row.key in self.columns)


def _number(result: Mapping[str, Any], column: Column) -> float:
    value: Any = result
    try:
        for key in column.path:
            value = value[key]
    except (KeyError, TypeError):  # not there, or nothing that has parts
        return math.nan
    return (math.inf if column.infinite else math.nan) if value is None else float(value)


def _objective(result: Mapping[str, Any], row: Objective) -> tuple[float, float]:
    """Value and frequency; an infinite margin is found at an infinite frequency."""
    if result["status"] != "ok":
        return math.nan, math.nan
    at_hz = result[row.section].get(row.at)
    return row.of(result), math.inf if at_hz is None else float(at_hz)


def columns_of(
    rows: Sequence[Row],
    names: Sequence[str],
    objectives: np.ndarray,
    rank: np.ndarray | None,
    robust: Sequence[Objective] = (),
) -> dict[str, np.ndarray]:
    """The datasets of /evaluations.

    Parameters
    ----------
    rows : sequence of Row
        The evaluations.
    names : sequence of str
        Variable names, in the order of the columns of `inputs`.
    objectives : ndarray, shape (n, m)
        Objectives as ranked, NaN for failures.
    rank : ndarray of int, shape (n,), optional
        Front among all evaluations, 0 for failures.
    robust : sequence of Objective
        Quantiles over draws that the search minimises; each becomes a column.
    """
    failed = np.array([row.result["status"] != "ok" for row in rows], dtype=bool)
    columns: dict[str, np.ndarray] = {
        "generation": np.array([row.generation for row in rows], dtype=np.int64),
        "individual": np.array([row.individual for row in rows], dtype=np.int64),
        "inputs": np.array([[row.inputs[name] for name in names] for row in rows], dtype=float).reshape(
            len(rows), len(names)
        ),
        "status": np.array([str(row.result["status"]) for row in rows], dtype=object),
        "stage": np.array([str(row.result.get("stage", "")) for row in rows], dtype=object),
        "reason": np.array([str(row.result.get("reason", "")) for row in rows], dtype=object),
        "objectives": np.asarray(objectives, dtype=float),
        **({} if rank is None else {"rank": np.asarray(rank, dtype=np.int64)}),
        "stable": np.array(
            [-1 if bad else int(bool(row.result["loop"]["stable"])) for row, bad in zip(rows, failed, strict=True)],
            dtype=np.int64,
        ),
    }
    for row in OBJECTIVES.values():
        found = np.array([_objective(one.result, row) for one in rows], dtype=float).reshape(len(rows), 2)
        columns[row.key] = found[:, 0]
        if row.at:
            columns[row.at] = found[:, 1]
    for name, column in COLUMNS.items():
        columns[name] = np.array([_number(one.result, column) for one in rows], dtype=float)
    for name in ANGLE_NAMES:
        columns[name] = np.array([_number(one.result, Column(("posture", name))) for one in rows], dtype=float)
    columns["sex"] = np.array([str(one.result.get("biometrics", {}).get("sex", "")) for one in rows], dtype=object)
    for row in robust:
        columns[row.key] = np.array([_objective(one.result, row)[0] for one in rows], dtype=float)
    if robust:
        drawn = [one.result.get(ROBUST) for one in rows]
        columns[FAILED_DRAWS] = np.array([math.nan if one is None else one["failed"] for one in drawn], dtype=float)
    for name in ("frequency_hz", "damping"):
        poles = [[pole[name] for pole in one.result.get("pilot_poles", ())] for one in rows]
        columns[f"pole_{name}"] = _padded(poles)
    return columns


def _padded(lists: Sequence[Sequence[float]]) -> np.ndarray:
    """Rows of different lengths as one matrix, NaN where they end."""
    matrix = np.full((len(lists), max((len(one) for one in lists), default=0)), np.nan)
    for row, one in zip(matrix, lists, strict=True):
        row[: len(one)] = one
    return matrix


def flat_columns(table: np.ndarray) -> dict[str, np.ndarray]:
    """The fields of a structured array by name; a field of several columns is numbered, `pole_damping_1`, from 1.

    Every array has shape (rows,).
    """
    columns: dict[str, np.ndarray] = {}
    for name in table.dtype.names or ():
        column = table[name]
        if column.ndim == 1:
            columns[name] = column
        else:
            columns |= {f"{name}_{k + 1}": column[:, k] for k in range(column.shape[1])}
    return columns


def structured_array(columns: Mapping[str, np.ndarray], names: Sequence[str]) -> np.ndarray:
    """The datasets of /evaluations as one structured array, shape (n,); `inputs` becomes a field per name.

    A value that is searched and computed (`stature_m`) is one field. Objectives as ranked are left out: the columns of
    their names hold what they are.
    """
    fields = {name: columns["inputs"][:, j] for j, name in enumerate(names)}
    for name, column in columns.items():
        if name not in ("inputs", "objectives"):
            fields.setdefault(name, column.astype(str) if column.dtype == object else column)
    kinds = [(name, column.dtype, column.shape[1:]) for name, column in fields.items()]
    table = np.empty(len(columns["status"]), dtype=kinds)
    for name, column in fields.items():
        table[name] = column
    return table


class ResultsWriter:
    """Writes study.h5 piece by piece, whole or not at all: it takes its name when the block ends without error.

    Memory does not grow with the number of evaluations; identical pieces give identical bytes.

    Parameters
    ----------
    path : Path
        The file to write.
    attributes : mapping
        Provenance, as on the format page.
    names, lower, upper : sequences
        The variables and their bounds.
    objective_names : sequence of str
        Columns of `objectives`.
    """

    def __init__(
        self,
        path: Path,
        attributes: Mapping[str, Any],
        names: Sequence[str],
        lower: np.ndarray,
        upper: np.ndarray,
        objective_names: Sequence[str],
    ) -> None:
        import h5py

        self.names = tuple(names)
        self._objective_names = tuple(objective_names)
        self._text = h5py.string_dtype("utf-8")
        self._new = NewFile(path, FILETYPE, VERSION, seal=False)
        self._file = self._new.file
        for key, value in attributes.items():
            self._file.attrs[key] = value
        variables = self._file.create_group("variables")
        variables.create_dataset("name", data=np.array(list(names), dtype=object), dtype=self._text)
        units = np.array([unit_of(name) for name in names], dtype=object)
        for side, bound in (("lower", lower), ("upper", upper)):
            variables.create_dataset(side, data=np.asarray(bound, dtype=float)).attrs["units"] = units
        self._evaluations = self._file.create_group("evaluations", track_order=True)
        self._hashes: dict[str, _ColumnHash] = {}

    def append(self, columns: Mapping[str, np.ndarray]) -> None:
        """Add evaluations: the datasets of `columns_of`, the same ones every time."""
        group = self._evaluations
        for key, data in columns.items():
            self._hashes.setdefault(key, _ColumnHash()).update(data)
            if key not in group:
                kind = self._text if data.dtype == object else data.dtype
                group.create_dataset(
                    key,
                    data=data,
                    dtype=kind,
                    maxshape=(None,) * data.ndim,
                    chunks=tuple(max(1, width) for width in (min(CHUNK_ROWS, len(data)), *data.shape[1:])),
                    fletcher32=kind is not self._text,
                    fillvalue=np.nan if data.dtype.kind == "f" else None,
                )
                if key == "objectives":
                    group[key].attrs["names"] = np.array(list(self._objective_names), dtype=object)
                if key in _WITHOUT_UNIT:
                    continue
                several = {"inputs": self.names, "objectives": self._objective_names}.get(key)
                group[key].attrs["units"] = (
                    unit_of(key) if several is None else np.array([unit_of(name) for name in several], dtype=object)
                )
            else:
                dataset, old = group[key], len(group[key])
                widths = [max(pair) for pair in zip(dataset.shape[1:], data.shape[1:], strict=True)]  # of poles
                dataset.resize((old + len(data), *widths))
                dataset[(slice(old, None), *(slice(width) for width in data.shape[1:]))] = data
        self._new.check()

    def population(self, members: np.ndarray, front: np.ndarray) -> None:
        """Write the populations a search went through."""
        group = self._file.create_group("population")
        group.create_dataset("members", data=np.asarray(members, dtype=np.int64))
        group.create_dataset("front", data=np.asarray(front, dtype=np.int64))

    def __enter__(self) -> ResultsWriter:
        return self

    def __exit__(self, kind: object, *rest: object) -> None:
        if kind is None:
            self._file.attrs[CHECKSUM] = _checksum(self._file, self._hashes)
        self._new.__exit__(kind, *rest)


def write_results(
    path: Path,
    attributes: Mapping[str, Any],
    names: Sequence[str],
    lower: np.ndarray,
    upper: np.ndarray,
    objective_names: Sequence[str],
    columns: Mapping[str, np.ndarray],
    members: np.ndarray | None = None,
    front: np.ndarray | None = None,
) -> None:
    """Write study.h5 in one go; parameters as `ResultsWriter`, `columns_of` and the format page.

    `lower` and `upper` have shape (variables,), columns shape (evaluations, ...).
    """
    with ResultsWriter(path, attributes, names, lower, upper, objective_names) as writer:
        writer.append(columns)
        if members is not None and front is not None:
            writer.population(members, front)


class _ColumnHash:
    """Hash of a column, the same in however many pieces it comes, and however wide its rows are padded with NaN."""

    def __init__(self) -> None:
        self._values, self._counts = hashlib.sha256(), hashlib.sha256()

    def update(self, data: np.ndarray) -> None:
        """Take rows of the column, shape (rows, ...)."""
        if data.dtype == object:
            _hash_texts(self._values, data)
            return
        if data.dtype.kind == "f":
            there = ~np.isnan(data)
            self._counts.update(there.reshape(len(data), -1).sum(axis=1, dtype=np.int64).tobytes())
            data = data[there]
        self._values.update(np.ascontiguousarray(data).tobytes())

    def hexdigest(self) -> str:
        """The hash so far."""
        return self._values.hexdigest() + self._counts.hexdigest()


def _hash_texts(found: Any, texts: np.ndarray) -> None:
    for one in texts:
        found.update(str(one).encode("utf-8", "replace") + b"\0")


def _checksum(file: h5py.File, columns: Mapping[str, _ColumnHash]) -> str:
    """Hash of all that the file says: attributes, variables, populations, evaluations (by column)."""
    found = hashlib.sha256()
    attributes = {key: value for key, value in file.attrs.items() if key not in ("filetype", "version", CHECKSUM)}
    for key, value in sorted(attributes.items()):
        _hash_texts(found, np.array([key, text(value)], dtype=object))
    for group in ("variables", "population"):
        for name in sorted(file.get(group, ())):
            dataset = file[group][name]
            _hash_texts(found, np.array([group, name], dtype=object))
            if dataset.dtype.kind == "O":
                _hash_texts(found, dataset.asstr()[:])
            else:
                found.update(np.ascontiguousarray(dataset[()]).tobytes())
    for key, one in sorted(file["evaluations"].items()):
        for name, value in sorted(one.attrs.items()):
            _hash_texts(found, np.array([key, name, *map(text, np.atleast_1d(value))], dtype=object))
    for key in sorted(columns):
        _hash_texts(found, np.array([key, columns[key].hexdigest()], dtype=object))
    return found.hexdigest()


def read_results(path: Path) -> StudyResults:
    """Read study.h5; FileError if it is something else, of another version, or damaged."""
    import h5py

    with opened(path, FILETYPE, VERSION) as file:
        attributes = {key: value for key, value in file.attrs.items() if key not in ("filetype", "version", CHECKSUM)}
        columns, hashes = {}, {}
        for key, dataset in file["evaluations"].items():
            columns[key] = dataset.asstr()[:] if h5py.check_string_dtype(dataset.dtype) else dataset[:]
            hashes[key] = _ColumnHash()
            hashes[key].update(np.atleast_1d(columns[key]))
        _check_sum(file, hashes)
        population = file.get("population")
        results = StudyResults(
            attributes,
            tuple(file["variables/name"].asstr()[:]),
            file["variables/lower"][:],
            file["variables/upper"][:],
            tuple(text(name) for name in file["evaluations/objectives"].attrs["names"]),
            columns,
            population["members"][:] if population is not None else np.empty((0, 0), dtype=np.int64),
            population["front"][:] if population is not None else np.empty(0, dtype=np.int64),
        )
        _check_whole(results)
        return results


def _check_sum(file: h5py.File, hashes: Mapping[str, _ColumnHash]) -> None:
    """Raise ValueError, of which `opened` makes a FileError, if a file that has a checksum does not have its own."""
    if int(file.attrs["version"][1]) >= 2 and text(file.attrs[CHECKSUM]) != _checksum(file, hashes):
        raise ValueError("it does not have its checksum")


def _check_whole(results: StudyResults) -> None:
    """Raise ValueError if the parts do not go together."""
    columns, v = results.columns, len(results.names)
    n = len(columns["status"])
    wrong = [name for name, column in columns.items() if len(column) != n]
    if wrong or columns["inputs"].shape != (n, v) or results.lower.shape != (v,) or results.upper.shape != (v,):
        raise ValueError(f"{wrong[0] if wrong else 'inputs or bounds'} and status differ in length")
    if not set(columns["status"]) <= {"ok", "failed"}:
        raise ValueError("status is neither ok nor failed")
    for name, rows in (("members", results.members), ("front", results.front)):
        if rows.size and not (0 <= rows.min() and rows.max() < n):
            raise ValueError(f"population/{name} names evaluations that are not there")
    ok = columns["status"] == "ok"
    for row in OBJECTIVES.values():
        if row.key in columns and np.isnan(columns[row.key][ok]).any():
            raise ValueError(f"{row.key} of an evaluated pilot is no number")
