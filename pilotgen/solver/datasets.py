"""An open matrices file: its datasets and attributes, each checked for kind and finiteness.

Files are read with the HDF5 library until two of one size have shown a common layout (`layout`); further files of that
layout are read from their bytes.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from typing import Any, Protocol

import numpy as np
from h5py import h5a, h5d, h5f, h5s, h5t
from numpy.typing import NDArray

from pilotgen.errors import FileError, MatrixError
from pilotgen.solver.layout import Layout, Sample, compare, take_sample

FILETYPE = "pilotgen matrices"
VERSION = (1, 0)
_STRING_DATASETS = {"name", "type", "unit", "kind"}
_INTEGER_DATASETS = {"label", "first", "dofs", "owner"}


class Source(Protocol):
    """An open file."""

    path: str

    def read(self, name: str) -> NDArray[Any]:
        """Return the dataset as float64, int64 or bytes, whichever its name says, and finite."""

    def attribute(self, name: str) -> str:
        """Return the text attached to the root group."""

    def close(self) -> None:
        """Let go of the file; so does the last reference."""


class _Hdf5Source:
    """A file opened with the HDF5 library."""

    def __init__(self, file: h5f.FileID, path: str) -> None:
        self._file, self.path = file, path

    def read(self, name: str) -> NDArray[Any]:
        with _damage_is_told(self.path):
            return _read(self._file, self.path, name)

    def attribute(self, name: str) -> str:
        with _damage_is_told(self.path):
            return _attribute(self._file, self.path, name)

    def close(self) -> None:
        self._file.close()


class _MappedSource:
    """The bytes of a file whose layout is known."""

    def __init__(self, data: bytes, layout: Layout, path: str) -> None:
        self._data, self._layout, self.path = data, layout, path

    def read(self, name: str) -> NDArray[Any]:
        return _finite(self._layout.read(name, self._data), self.path, name)

    def attribute(self, name: str) -> str:
        return self._layout.deck_hash(self._data) if name == "deck_sha256" else self._layout.attributes[name]

    def close(self) -> None:
        pass


_PAIRS_TO_COMPARE = 5  # files of one size that are looked at in search of a common layout, before it is given up
_layouts: dict[int, Layout] = {}  # by size of the file
_samples: dict[int, Sample] = {}
_looked_at: dict[int, int] = {}


def open_source(path: str, datasets: Collection[str] = ()) -> Source:
    """Open a matrices file.

    Parameters
    ----------
    path : str
        The file.
    datasets : collection of str
        Those that will be read, if reading from bytes is wanted: a layout must have all of them. Empty: the library
        only.

    Raises
    ------
    FileError
        The file does not exist or cannot be opened.
    MatrixError
        It is no matrices file, or of another version.
    """
    data = b""
    if datasets:
        with suppress(OSError):  # the library's way below says what is wrong
            data = _content(path)
        layout = _layouts.get(len(data))
        if layout is not None and layout.fits(data):
            return _MappedSource(data, layout, path)
    file = _open(path)
    try:
        with _damage_is_told(path):
            _check_stranger(file, path)
            if data:
                _learn(data, datasets)
    except BaseException:
        file.close()
        raise
    return _Hdf5Source(file, path)


def _content(path: str) -> bytes:
    file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        return os.read(file, os.fstat(file).st_size)
    finally:
        os.close(file)


@contextmanager
def _damage_is_told(path: str) -> Iterator[None]:
    """What the HDF5 library finds wrong inside a file that it could open."""
    try:
        yield
    except (OSError, RuntimeError) as error:  # what h5py raises for it
        raise MatrixError(
            f"{path} is a damaged {FILETYPE} file, or it was not written to its end ({error}); make it again"
        ) from error


def _learn(data: bytes, datasets: Collection[str]) -> None:
    """Compare a file with an earlier one of its size; the first file of a size costs nothing."""
    size = len(data)
    _looked_at[size] = _looked_at.get(size, 0) + 1
    if not 1 < _looked_at[size] <= 1 + _PAIRS_TO_COMPARE:
        return
    sample, earlier = take_sample(data), _samples.get(size)
    layout = compare(earlier, sample) if earlier is not None and sample is not None else None
    if sample is not None:
        _samples[size] = sample
    # A layout is used for what the reading below would accept: all datasets there, of the right kinds.
    if layout is not None and all(_kind_is_right(name, layout) for name in datasets):
        _layouts[size] = layout
        del _samples[size]


def _kind_is_right(name: str, layout: Layout) -> bool:
    dataset, leaf = layout.datasets.get(name), name.rpartition("/")[2]
    wanted = "S" if leaf in _STRING_DATASETS else "i" if leaf in _INTEGER_DATASETS else "f"
    return dataset is not None and dataset.dtype.kind == wanted


def _open(path: str) -> h5f.FileID:
    try:
        return h5f.open(os.fsencode(path), h5f.ACC_RDONLY)
    except FileNotFoundError as error:
        raise FileError(f"{path}: no such file; expected a matrices file written by mbdae") from error
    except OSError as error:
        if os.path.isdir(path) or not os.access(path, os.R_OK):
            raise FileError(f"{path}: cannot be read; expected a matrices file written by mbdae") from error
        message = f"{path} is not a {FILETYPE} file: it is not HDF5, or it was not written to its end"
        raise MatrixError(message) from error


def _check_stranger(file: h5f.FileID, path: str) -> None:
    if not h5a.exists(file, b"filetype"):
        raise MatrixError(f"{path} is not a {FILETYPE} file: it has no attribute 'filetype'")
    filetype = _attribute(file, path, "filetype")
    if filetype != FILETYPE:
        raise MatrixError(f"{path} is not a {FILETYPE} file: its filetype is '{filetype}'")
    version = np.atleast_1d(_attribute_value(file, path, "version"))
    if version.shape != (2,) or version.dtype.kind not in "iu":
        raise MatrixError(f"{path}: attribute 'version' must be two integers (major, minor)")
    if version[0] != VERSION[0]:
        raise MatrixError(
            f"{path}: version {version[0]}.{version[1]} of the format; this program reads {VERSION[0]}.x; "
            "write the file again with the mbdae of this pilotgen"
        )


def _attribute_value(file: h5f.FileID, path: str, name: str) -> NDArray[Any]:
    try:
        attribute = h5a.open(file, name.encode())
    except KeyError as error:
        raise MatrixError(f"{path}: attribute '{name}' is missing") from error
    stored = attribute.get_type()
    if stored.get_class() == h5t.STRING and not stored.is_variable_str():
        value = np.empty(attribute.shape, f"S{stored.get_size()}")
        attribute.read(value, stored)
    else:
        value = np.empty(attribute.shape, attribute.dtype)
        attribute.read(value)
    return value


def _attribute(file: h5f.FileID, path: str, name: str) -> str:
    value = _attribute_value(file, path, name).item()
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    if isinstance(value, str):
        return value
    raise MatrixError(f"{path}: attribute '{name}' is {value!r}; expected text")


def _read(file: h5f.FileID, path: str, name: str) -> NDArray[Any]:
    """Return the dataset as float64, int64 or bytes, whichever its name says, and finite."""
    try:
        dataset = h5d.open(file, name.encode())
    except KeyError as error:
        raise MatrixError(f"{path}: dataset '{name}' is missing") from error
    # h5py's own search for dtypes and memory types costs more than the reading: ask HDF5 for the class, name the type
    stored = dataset.get_type()
    stored_class = stored.get_class()
    leaf = name.rpartition("/")[2]
    if leaf in _STRING_DATASETS:
        wanted, is_right = "fixed-length text", stored_class == h5t.STRING and not stored.is_variable_str()
        memory_type, dtype = stored, f"S{stored.get_size()}"
    elif leaf in _INTEGER_DATASETS:
        wanted, is_right = "integers", stored_class == h5t.INTEGER
        memory_type, dtype = h5t.NATIVE_INT64, "i8"
    else:
        wanted, is_right = "real numbers", stored_class in (h5t.FLOAT, h5t.INTEGER)
        memory_type, dtype = h5t.NATIVE_DOUBLE, "f8"
    if not is_right:
        raise MatrixError(f"{path}: dataset '{name}' holds {dataset.dtype}; expected {wanted}")
    value = np.empty(dataset.get_space().get_simple_extent_dims(), dtype)
    if value.size:
        dataset.read(h5s.ALL, h5s.ALL, value, memory_type)
    return _finite(value, path, name)


def _finite(value: NDArray[Any], path: str, name: str) -> NDArray[Any]:
    if value.dtype.kind == "f" and not np.isfinite(value).all():
        where = np.argwhere(~np.isfinite(value))[0]
        raise MatrixError(f"{path}: dataset '{name}' has {value[tuple(where)]} at {list(map(int, where))}")
    return value
