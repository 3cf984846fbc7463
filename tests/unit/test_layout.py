"""A file whose layout is known reads the same as through the HDF5 library, and no other file passes for one."""

from __future__ import annotations

import dataclasses
import subprocess
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from pilotgen.errors import FileError, MatrixError
from pilotgen.solver import datasets as room
from pilotgen.solver.client import SolverClient
from pilotgen.solver.layout import compare, take_sample
from pilotgen.solver.matrices import _TABLES, _VECTORS, read_matrices


@pytest.fixture(autouse=True)
def nothing_known() -> None:
    """Every test learns for itself."""
    for memory in (room._layouts, room._samples, room._looked_at):
        memory.clear()  # type: ignore[attr-defined]


@pytest.fixture
def decks(data_directory: Path) -> list[str]:
    """One deck of the same arm with other numbers again and again."""
    text = (data_directory / "mbdyn_cases" / "arm_inline.mbd").read_text()
    assert text.count("const, GRAVITY;") == 1
    return [text.replace("const, GRAVITY;", f"const, {9.81 - 0.01 * k:.2f};") for k in range(12)]


def write(solver: SolverClient, deck: str, path: Path) -> bytes:
    solver.request("linearise", deck_text=deck, output=path)
    return path.read_bytes()


def content(path: Path, complete: bool) -> dict[str, Any]:
    matrices = read_matrices(path, complete)
    found = {f.name: getattr(matrices, f.name) for f in dataclasses.fields(matrices) if f.name != "_table"}
    for name in _VECTORS:
        found[name] = getattr(matrices, name)
    for group, (_, columns) in _TABLES.items():
        found.update({f"{group}.{column}": getattr(getattr(matrices, group), column) for column in columns})
    return found


def test_known_layout_reads_the_same(tmp_path: Path, solver: SolverClient, decks: list[str]) -> None:
    paths = [tmp_path / f"{k}.h5" for k in range(len(decks))]
    for path, deck in zip(paths, decks, strict=True):
        write(solver, deck, path)
        whole, lazy = content(path, True), content(path, False)
        assert whole.keys() == lazy.keys()
        for name, value in whole.items():
            if isinstance(value, np.ndarray):
                assert value.dtype == lazy[name].dtype, name
                assert lazy[name].flags.aligned, name
                np.testing.assert_array_equal(value, lazy[name], err_msg=name)
            else:
                assert value == lazy[name], name
    layout = room._layouts[paths[0].stat().st_size]  # learnt on the way
    assert {"dofs/name", "dofs/kind", "nodes/first", "muscles/name"} <= layout.constants.keys()
    with pytest.raises(ValueError, match="read-only"):  # what all files share cannot be changed for one
        lazy["names"][0] = b"other"


def test_other_structures_do_not_pass(tmp_path: Path, solver: SolverClient, decks: list[str]) -> None:
    path = tmp_path / "a.h5"
    files = [write(solver, deck, path) for deck in decks]
    samples = [take_sample(data) for data in files]
    layouts = [compare(samples[0], sample) for sample in samples[1:]]  # type: ignore[arg-type]
    layout = next(found for found in layouts if found is not None)
    assert all(layout.fits(data) for data in files)
    assert not layout.fits(files[0][:-1])
    numbers = np.zeros(len(files[0]), dtype=bool)
    for dataset in (d for name, d in layout.datasets.items() if name not in layout.constants):
        numbers[dataset.offset : dataset.end] = True
    numbers[layout.hash_at : layout.hash_at + layout.hash_size] = True
    free = 0
    rng = np.random.default_rng(1)
    for place in rng.choice(np.flatnonzero(~numbers), 2000, replace=False):
        changed = bytearray(files[0])
        changed[place] ^= 0x41
        free += layout.fits(bytes(changed))
    assert free <= 4  # nothing but the checksum of the header that holds the hash
    assert compare(samples[0], samples[0]) is None  # type: ignore[arg-type]


def test_renamed_dataset_goes_through_the_library(tmp_path: Path, solver: SolverClient, decks: list[str]) -> None:
    path = tmp_path / "a.h5"
    for deck in decks:
        write(solver, deck, path)
        read_matrices(path, complete=False)
    size = path.stat().st_size
    assert size in room._layouts
    with h5py.File(path, "a") as file:
        file.move("equilibrium_residual", "equilibrium_residuum")
    path.write_bytes(path.read_bytes().ljust(size, b"\0"))  # the library gave back unused space
    with pytest.raises(MatrixError, match="dataset 'equilibrium_residual' is missing"):
        _ = read_matrices(path, complete=False).equilibrium_residual


def test_numbers_that_are_not_finite_are_refused(tmp_path: Path, solver: SolverClient, decks: list[str]) -> None:
    path = tmp_path / "a.h5"
    for deck in decks:
        data = bytearray(write(solver, deck, path))
        read_matrices(path, complete=False)
    layout = room._layouts[len(data)]
    for name in ("J_minus", "inputs/g_u"):
        start = layout.datasets[name].offset
        changed = bytes(data[: start + 16]) + np.array([np.nan]).tobytes() + bytes(data[start + 24 :])
        path.write_bytes(changed)
        with pytest.raises(MatrixError, match=rf"dataset '{name}' has nan at \[0, 2\]"):
            _ = read_matrices(path, complete=False).inputs.g_u


def test_file_of_a_serving_solver_is_that_of_a_fresh_one(
    tmp_path: Path, mbdae: Path, solver: SolverClient, decks: list[str], data_directory: Path
) -> None:
    """The serving solver fills one file again and again; a fresh process makes each anew."""
    other = (data_directory / "mbdyn_cases" / "c07_total.mbd").read_text()
    for k, text in enumerate([decks[0], decks[1], decks[1], other, decks[2], decks[0]]):
        served = write(solver, text, tmp_path / "served.h5")
        deck = tmp_path / f"{k}.mbd"
        deck.write_text(text)
        subprocess.run([mbdae, deck, "-o", tmp_path / str(k)], check=True, capture_output=True)
        assert served == (tmp_path / f"{k}.h5").read_bytes()


def test_damage_is_told_and_never_more(tmp_path: Path, solver: SolverClient, decks: list[str]) -> None:
    """A file cut short, or with a stretch of it wiped out, is read or refused; nothing else may happen."""
    whole = write(solver, decks[0], tmp_path / "whole.h5")
    random = np.random.default_rng(3)
    path = tmp_path / "damaged.h5"
    refused = 0
    for k in range(300):
        data = bytearray(whole)
        at = int(random.integers(len(data)))
        if k % 3 == 0:
            del data[at:]
        else:
            length = int(random.integers(1, 4000))
            data[at : at + length] = bytes(length) if k % 3 == 1 else random.bytes(length)
            del data[len(whole) :]
        path.write_bytes(data)
        try:
            content(path, complete=k % 2 == 0)
        except (MatrixError, FileError) as error:
            refused += 1
            assert str(path) in str(error)
    assert refused > 100
