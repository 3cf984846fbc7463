"""Where the datasets lie in matrices files of one structure, so that the next such file is read with one call.

A search reads thousands of files that differ in their numbers only. Finding each small dataset through the HDF5 library
costs a hundred times more than reading it. Two files that the library has read, and that have the same datasets of the
same types at the same places, show which of the remaining bytes depend on the numbers: the hash of the deck and the
checksum of the header that holds it. Names and whole numbers that the two have in common count as structure. Any file
that equals them in all the other bytes has the same structure, and its datasets are taken from the same places.
Everything else goes through the library.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from h5py import h5a, h5d, h5f, h5o
from numpy.typing import NDArray

_CHECKSUM_BYTES = 4  # of an object header (HDF5 file format specification, IV.A.1.b)
_KINDS = {"f": "f8", "i": "i8", "S": "S"}  # what a dataset becomes when it is read


@dataclass(frozen=True)
class Dataset:
    """A contiguous dataset: its first byte in the file, its type there and its shape."""

    offset: int
    dtype: np.dtype[Any]
    shape: tuple[int, ...]

    @cached_property
    def count(self) -> int:
        """Number of values."""
        return math.prod(self.shape)

    @property
    def end(self) -> int:
        """First byte after it."""
        return self.offset + self.dtype.itemsize * self.count

    def read(self, data: bytes) -> NDArray[Any]:
        """The dataset in a file's bytes, as float64, int64 or bytes; not to be written to."""
        values = np.frombuffer(data, self.dtype, self.count, self.offset).reshape(self.shape)
        kind = _KINDS[self.dtype.kind]
        return values if kind == "S" else values.astype(kind, copy=not values.flags.aligned)


@dataclass(frozen=True)
class Layout:
    """The structure of a file: its datasets, and what is between them.

    Attributes
    ----------
    datasets : mapping of str to Dataset
        Where the numbers are.
    constants : mapping of str to ndarray
        Texts and whole numbers that belong to the structure: the same in every such file, not to be written to.
    attributes : mapping of str to str
        Texts attached to the root group, except the deck's hash.
    hash_at, hash_size : int
        Where the deck's hash is.
    """

    datasets: Mapping[str, Dataset]
    constants: Mapping[str, NDArray[Any]]
    attributes: Mapping[str, str]
    hash_at: int
    hash_size: int
    _size: int
    _fixed: tuple[tuple[int, int, bytes], ...]  # stretches (from, to, content) that every such file has

    def fits(self, data: bytes) -> bool:
        """Whether a file with these bytes has this structure."""
        return len(data) == self._size and all(data[start:end] == content for start, end, content in self._fixed)

    def read(self, name: str, data: bytes) -> NDArray[Any]:
        """A dataset of a file with these bytes, as float64, int64 or bytes; not to be written to."""
        constant = self.constants.get(name)
        return self.datasets[name].read(data) if constant is None else constant

    def deck_hash(self, data: bytes) -> str:
        """The deck's hash in a file's bytes."""
        return data[self.hash_at : self.hash_at + self.hash_size].decode(errors="replace")


@dataclass(frozen=True)
class Sample:
    """A file that the library has read: bytes, datasets, texts of the root group, the deck's hash among them."""

    data: bytes
    datasets: dict[str, Dataset]
    attributes: dict[str, str]
    deck_hash: str


def take_sample(data: bytes) -> Sample | None:
    """Look at a file's bytes through the library; None if a dataset is not a contiguous array of numbers or texts."""
    file = h5f.open_file_image(data)
    found: dict[str, Dataset] = {}
    plain = True

    def visit(name: bytes) -> None:
        nonlocal plain
        thing = h5o.open(file, name)
        if not isinstance(thing, h5d.DatasetID):
            return
        offset, dtype = thing.get_offset(), thing.dtype
        if offset is None and 0 in thing.shape:
            offset = 0  # nothing is stored
        if offset is None or dtype.kind not in _KINDS or dtype.itemsize == 0:
            plain = False
            return
        found[name.decode()] = Dataset(int(offset), dtype, tuple(thing.shape))

    try:
        h5o.visit(file, visit)
        texts: dict[str, str] = {}
        for k in range(h5a.get_num_attrs(file)):
            attribute = h5a.open(file, index=k)
            if attribute.dtype.kind == "S" and attribute.shape == ():
                value = np.empty((), attribute.dtype)
                attribute.read(value)
                texts[attribute.name.decode()] = bytes(value.item()).decode(errors="replace")
    finally:
        file.close()
    deck_hash = texts.pop("deck_sha256", "")
    return Sample(data, found, texts, deck_hash) if plain and deck_hash else None


def compare(first: Sample, second: Sample) -> Layout | None:
    """The layout that two files have in common; None if they differ in more than numbers, hash and its checksum."""
    if (len(first.data), first.datasets, first.attributes) != (len(second.data), second.datasets, second.attributes):
        return None
    if first.deck_hash == second.deck_hash or len(first.deck_hash) != len(second.deck_hash):
        return None
    places = [sample.data.find(sample.deck_hash.encode()) for sample in (first, second)]
    size = len(first.deck_hash)
    if places[0] != places[1] or places[0] < 0:
        return None
    constants = {
        name: d.read(first.data)
        for name, d in first.datasets.items()
        if d.dtype.kind in "iS" and first.data[d.offset : d.end] == second.data[d.offset : d.end]
    }
    numbers = [(d.offset, d.end) for name, d in first.datasets.items() if name not in constants]
    outside = np.ones(len(first.data), dtype=bool)
    for start, end in (*numbers, (places[0], places[0] + size)):
        outside[start:end] = False
    a, b = (np.frombuffer(sample.data, np.uint8) for sample in (first, second))
    differing = np.flatnonzero(outside & (a != b))
    if len(differing) != _CHECKSUM_BYTES or differing[-1] - differing[0] >= _CHECKSUM_BYTES:
        return None  # (also when bytes of the two checksums are equal by chance: another pair will tell)
    outside[differing] = False
    edges = np.flatnonzero(np.diff(np.concatenate(([False], outside, [False])).astype(np.int8))).reshape(-1, 2)
    fixed = tuple((int(start), int(end), first.data[start:end]) for start, end in edges)
    return Layout(first.datasets, constants, first.attributes, places[0], size, len(first.data), fixed)
