"""study.h5: everything a study evaluated (format page: docs/io_formats/study_results.md).

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pilotgen.errors import FileError

FILETYPE = "pilotgen study"
VERSION = (1, 0)
CHUNK_ROWS = 1024  # rows per HDF5 chunk

# dataset name -> path in the result object; missing or null becomes NaN
SCALARS: dict[str, tuple[str, ...]] = {
    "modulus_margin": ("loop", "modulus_margin"),
    "modulus_margin_hz": ("loop", "modulus_margin_hz"),
    "pilot_frequency_hz": ("bdft", "dominant_frequency_hz"),
    "pilot_damping": ("bdft", "dominant_damping"),
    "certificate": ("bdft", "certificate"),
    "largest_activation": ("activation", "largest"),
    "age_years": ("biometrics", "age_years"),
    "stature_m": ("biometrics", "stature_m"),
    "mass_kg": ("biometrics", "mass_kg"),
    "bmi": ("biometrics", "bmi"),
}
# margins: null in the result object means infinite
MARGINS: dict[str, tuple[str, ...]] = {
    "gain_margin_db": ("loop", "gain_margin_db"),
    "gain_margin_hz": ("loop", "gain_margin_hz"),
    "phase_margin_deg": ("loop", "phase_margin_deg"),
    "phase_margin_hz": ("loop", "phase_margin_hz"),
    "delay_margin_s": ("loop", "delay_margin_s"),
}


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


def _dig(result: Mapping[str, Any], path: Sequence[str], missing: float) -> float:
    value: Any = result
    try:
        for key in path:
            value = value[key]
    except (KeyError, TypeError):  # not there, or nothing that has parts
        return math.nan
    return missing if value is None else float(value)


def columns_of(
    rows: Sequence[Row], names: Sequence[str], objectives: np.ndarray, rank: np.ndarray | None
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
    for name, path in SCALARS.items():
        columns[name] = np.array([_dig(row.result, path, math.nan) for row in rows], dtype=float)
    for name, path in MARGINS.items():
        columns[name] = np.array([_dig(row.result, path, math.inf) for row in rows], dtype=float)
    return columns


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

        self.path = path
        self.names = tuple(names)
        self._objective_names = tuple(objective_names)
        self._part = path.with_name(path.name + ".part")
        self._text = h5py.string_dtype("utf-8")
        try:
            self._file = h5py.File(self._part, "w", track_order=True)
        except OSError as error:
            raise self._explain(error) from None
        self._file.attrs["filetype"] = FILETYPE
        self._file.attrs["version"] = np.array(VERSION, dtype=np.int64)
        for key, value in attributes.items():
            self._file.attrs[key] = value
        variables = self._file.create_group("variables")
        variables.create_dataset("name", data=np.array(list(names), dtype=object), dtype=self._text)
        variables.create_dataset("lower", data=np.asarray(lower, dtype=float))
        variables.create_dataset("upper", data=np.asarray(upper, dtype=float))
        self._evaluations = self._file.create_group("evaluations", track_order=True)

    def _explain(self, error: OSError) -> FileError:
        return FileError(
            f"{self.path}: cannot write the results ({error.strerror or error}); check space and permissions"
        )

    def append(self, columns: Mapping[str, np.ndarray]) -> None:
        """Add evaluations: the datasets of `columns_of`, the same ones every time."""
        group = self._evaluations
        try:
            for key, data in columns.items():
                if key not in group:
                    kind = self._text if data.dtype == object else data.dtype
                    group.create_dataset(
                        key,
                        data=data,
                        dtype=kind,
                        maxshape=(None, *data.shape[1:]),
                        chunks=(max(1, CHUNK_ROWS), *data.shape[1:]),
                    )
                    if key == "objectives":
                        group[key].attrs["names"] = np.array(list(self._objective_names), dtype=object)
                else:
                    old = len(group[key])
                    group[key].resize(old + len(data), axis=0)
                    group[key][old:] = data
        except OSError as error:
            raise self._explain(error) from None

    def population(self, members: np.ndarray, front: np.ndarray) -> None:
        """Write the populations a search went through."""
        group = self._file.create_group("population")
        group.create_dataset("members", data=np.asarray(members, dtype=np.int64))
        group.create_dataset("front", data=np.asarray(front, dtype=np.int64))

    def __enter__(self) -> ResultsWriter:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        try:
            self._file.close()
            if kind is None:
                os.replace(self._part, self.path)
        except OSError as error:
            raise self._explain(error) from None
        finally:
            self._part.unlink(missing_ok=True)


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
    """Write study.h5 in one go; parameters as `ResultsWriter`, `columns_of` and the format page."""
    with ResultsWriter(path, attributes, names, lower, upper, objective_names) as writer:
        writer.append(columns)
        if members is not None and front is not None:
            writer.population(members, front)


def read_results(path: Path) -> StudyResults:
    """Read study.h5; FileError if it is something else or of another version."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("filetype") != FILETYPE:
                raise FileError(f"{path} is not a {FILETYPE} file")
            version = tuple(int(v) for v in file.attrs["version"])
            if version[0] != VERSION[0]:
                raise FileError(f"{path}: format version {version[0]}.{version[1]}, this program reads {VERSION[0]}.x")
            attributes = {key: value for key, value in file.attrs.items() if key not in ("filetype", "version")}
            columns = {}
            for key, dataset in file["evaluations"].items():
                columns[key] = dataset.asstr()[:] if h5py.check_string_dtype(dataset.dtype) else dataset[:]
            objective_names = tuple(str(name) for name in file["evaluations/objectives"].attrs["names"])
            population = file.get("population")
            return StudyResults(
                attributes,
                tuple(file["variables/name"].asstr()[:]),
                file["variables/lower"][:],
                file["variables/upper"][:],
                objective_names,
                columns,
                population["members"][:] if population is not None else np.empty((0, 0), dtype=np.int64),
                population["front"][:] if population is not None else np.empty(0, dtype=np.int64),
            )
    except (OSError, KeyError) as error:
        raise FileError(f"{path}: cannot be read as study results ({error})") from None
