"""The datasets of a matrices file, each checked for kind, shape, finiteness and checksum.

A file is read with h5py, or from its bytes where the solver that has just written it told where the datasets lie:
finding them through the HDF5 library takes 2 ms of a pilot's 10.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import orjson
from numpy.typing import NDArray

from pilotgen.errors import FileError, MatrixError
from pilotgen.hdf5 import opened

if TYPE_CHECKING:
    import h5py

FILETYPE = "pilotgen matrices"
VERSION = (2, 0)
STRUCTURE, DECK_HASH, CHECKSUM = "structure", "deck_sha256", "checksum"
NUMBERS = ("scalars", "J_plus", "J_minus", "g_u", "vectors", "nodes", "muscles")
"""The datasets of numbers, in the order of the rows of `checksum` that follow that of `structure`."""

Structure = Mapping[str, Any]
"""`solver` and `analysis`, and the tables `dofs`, `inputs`, `nodes`, `joints`, `muscles` of arrays by column."""

Places = Mapping[str, Sequence[int]]
"""First byte and shape of each dataset in a file, as the solver tells them; of a text its first byte and length."""

# What a column of the structure holds: texts, or whole numbers
TABLES: Mapping[str, Mapping[str, type]] = {
    "dofs": {"name": str, "kind": str, "owner": int, "unit": str},
    "inputs": {"name": str, "unit": str},
    "nodes": {"name": str, "label": int, "first": int, "dofs": int},
    "joints": {"name": str, "label": int, "type": str, "first": int, "dofs": int},
    "muscles": {"name": str, "label": int},
}


def checksum(data: bytes | NDArray[Any]) -> tuple[int, int]:
    """Return the sum of the 64-bit words of `data` and of the words times their place from 1, both modulo 2^64.

    Of an array of any shape, as its bytes lie in memory.
    """
    words = np.frombuffer(data, np.uint64) if isinstance(data, bytes) else data.reshape(-1).view(np.uint64)
    return int(words.sum()), int(words @ _places_of_words(len(words)))


@lru_cache(maxsize=16)
def _places_of_words(count: int) -> NDArray[np.uint64]:
    return np.arange(1, count + 1, dtype=np.uint64)


@dataclass(frozen=True)
class Contents:
    """What a matrices file holds, not yet checked.

    Attributes
    ----------
    path : str
        For messages.
    texts : mapping of str to bytes
        `structure` and `deck_sha256`.
    arrays : mapping of str to ndarray
        The datasets of numbers and `checksum`; not to be written to.
    """

    path: str
    texts: Mapping[str, bytes]
    arrays: Mapping[str, NDArray[Any]]

    @cached_property
    def structure(self) -> Structure:
        """Names and labels, checked; shared by the files of one structure, not to be written to.

        MatrixError if they do not fit together.
        """
        text = self.texts[STRUCTURE]
        self._check_sum(STRUCTURE, 0, text)
        try:
            return _parse(text)
        except ValueError as error:
            raise MatrixError(f"{self.path}: dataset '{STRUCTURE}' {error}") from None

    def numbers(self, name: str, shape: tuple[int, int]) -> NDArray[np.float64]:
        """Return a dataset of numbers (a name of `NUMBERS`), shape, finiteness and checksum checked.

        MatrixError if one of these fails.
        """
        value = self.arrays[name]
        if value.shape != shape:
            raise MatrixError(f"{self.path}: dataset '{name}' has shape {value.shape}; expected {shape}")
        if not np.isfinite(value).all():
            where = np.argwhere(~np.isfinite(value))[0]
            raise MatrixError(f"{self.path}: dataset '{name}' has {value[tuple(where)]} at {list(map(int, where))}")
        self._check_sum(name, 1 + NUMBERS.index(name), value)
        return value

    def _check_sum(self, name: str, row: int, data: bytes | NDArray[Any]) -> None:
        sums = self.arrays[CHECKSUM]
        if sums.shape != (1 + len(NUMBERS), 2):
            raise MatrixError(
                f"{self.path}: dataset '{CHECKSUM}' has shape {sums.shape}; expected ({1 + len(NUMBERS)}, 2)"
            )
        if (len(data) % 8 if isinstance(data, bytes) else 0) or checksum(data) != tuple(sums[row].tolist()):
            raise _damaged(self.path, f"dataset '{name}' does not have its checksum")


def read_at(path: str, places: Places) -> Contents:
    """Read a file that the solver has just written, from the places that it told.

    FileError if it cannot be read, MatrixError if it is not what the solver told.
    """
    try:
        file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
        try:
            data = os.read(file, os.fstat(file).st_size)
        finally:
            os.close(file)
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror})") from error
    texts: dict[str, bytes] = {}
    arrays: dict[str, NDArray[Any]] = {}
    try:
        for name, (first, *shape) in places.items():
            if name in (STRUCTURE, DECK_HASH):
                texts[name] = data[first : first + shape[0]]
            else:
                rows, columns = shape
                dtype = np.uint64 if name == CHECKSUM else np.float64
                arrays[name] = np.frombuffer(data, dtype, rows * columns, first).reshape(rows, columns)
    except ValueError as error:
        raise _damaged(path, error) from error
    missing = {STRUCTURE, DECK_HASH, CHECKSUM, *NUMBERS} - texts.keys() - arrays.keys()
    if missing:
        raise MatrixError(f"{path}: the solver did not tell where dataset '{min(missing)}' is")
    return Contents(path, texts, arrays)


def read_file(path: str) -> Contents:
    """Read a matrices file.

    Raises
    ------
    FileError
        The file does not exist or cannot be opened.
    MatrixError
        It is no matrices file, of another version, damaged, or lacks a dataset.
    """
    with opened(path, FILETYPE, VERSION, MatrixError, "; write the file again with the mbdae of this pilotgen") as file:
        texts = {name: _text(file, path, name) for name in (STRUCTURE, DECK_HASH)}
        arrays = {name: _array(file, path, name) for name in (CHECKSUM, *NUMBERS)}
    return Contents(path, texts, arrays)


# Declared sizes are believed only up to what a file of this kind can have.
_LARGEST_BYTES = 4 << 30


def _dataset(file: h5py.File, path: str, name: str) -> h5py.Dataset:
    import h5py

    link = file.get(name, getlink=True)  # links to other files are not followed
    found = file.get(name) if isinstance(link, h5py.HardLink) else None
    if not isinstance(found, h5py.Dataset):
        raise MatrixError(f"{path}: dataset '{name}' is missing")
    if found.nbytes > _LARGEST_BYTES:
        raise MatrixError(f"{path}: dataset '{name}' is said to have {found.nbytes} bytes; no matrices are that large")
    return found


def _text(file: h5py.File, path: str, name: str) -> bytes:
    dataset = _dataset(file, path, name)
    if dataset.dtype.kind != "S" or dataset.shape != (1,):
        raise MatrixError(f"{path}: dataset '{name}' holds {dataset.dtype}; expected one fixed-length text")
    return np.asarray(dataset[()]).tobytes()


def _array(file: h5py.File, path: str, name: str) -> NDArray[Any]:
    dataset = _dataset(file, path, name)
    kinds, dtype, wanted = ("u", np.uint64, "64-bit words") if name == CHECKSUM else ("f", np.float64, "real numbers")
    if dataset.dtype.kind not in kinds or dataset.ndim != 2:
        raise MatrixError(
            f"{path}: dataset '{name}' holds {dataset.dtype} in shape {dataset.shape}; expected a matrix of {wanted}"
        )
    return np.ascontiguousarray(dataset[()], dtype=dtype)


def _damaged(path: str, reason: object) -> MatrixError:
    return MatrixError(
        f"{path} is a damaged {FILETYPE} file, or it was not written to its end ({reason}); make it again"
    )


@lru_cache(maxsize=8)  # the pilots of a study have the same structure
def _parse(text: bytes) -> Structure:
    """Texts and whole numbers of the structure as arrays; ValueError says what is wrong."""
    try:
        found = orjson.loads(text)
    except ValueError as error:
        raise ValueError(f"is no JSON: {error}") from None
    if not isinstance(found, dict):
        raise ValueError("is no JSON object")
    for name in ("solver", "analysis"):
        if not isinstance(found.get(name), str):
            raise ValueError(f"has no text '{name}'")
    for table, columns in TABLES.items():
        found[table] = _columns(found.get(table), table, columns)
    return found


def _columns(given: Any, table: str, columns: Mapping[str, type]) -> dict[str, NDArray[Any]]:
    if not isinstance(given, dict):
        raise ValueError(f"has no table '{table}'")
    arrays: dict[str, NDArray[Any]] = {}
    length: int | None = None
    for name, kind in columns.items():
        values = given.get(name)
        if not isinstance(values, list) or not all(type(value) is kind for value in values):
            what = "texts" if kind is str else "whole numbers"
            raise ValueError(f"has no column '{table}/{name}' of {what}")
        if length is not None and len(values) != length:
            raise ValueError(f"has {len(values)} entries in column '{table}/{name}'; expected {length}")
        length = len(values)
        arrays[name] = _texts(values) if kind is str else np.array(values, dtype=np.int64)
        arrays[name].flags.writeable = False
    return arrays


def _texts(values: Sequence[str]) -> NDArray[np.bytes_]:
    encoded = [value.encode() for value in values]
    return np.array(encoded, dtype=f"S{max(map(len, encoded), default=1) or 1}")
