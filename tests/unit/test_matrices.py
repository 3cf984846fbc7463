"""Matrices files: round trip, strangers refused by name, eq. (15).

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from linear_models import random_mechanism
from matrices_writer import write_matrices
from numpy.testing import assert_allclose, assert_array_equal

from pilotgen.errors import FileError, MatrixError
from pilotgen.solver.datasets import checksum
from pilotgen.solver.matrices import (
    InputTable,
    JointTable,
    Matrices,
    MuscleTable,
    NodeTable,
    descriptor,
    given_tables,
    read_matrices,
)

DATASETS = [
    "deck_sha256", "structure", "checksum", "scalars", "J_plus", "J_minus", "g_u", "vectors", "nodes", "muscles",
]  # fmt: skip


VECTORS = ("y", "ydot", "residual", "equilibrium_residual")


def complete_matrices() -> Matrices:
    """A model with every table filled by distinct numbers."""
    rng = np.random.default_rng(0)
    plain = random_mechanism(rng, 2, 5)
    n = plain.n
    tables = {
        "y": rng.normal(size=n),
        "ydot": rng.normal(size=n),
        "residual": rng.normal(size=n),
        "equilibrium_residual": rng.normal(size=n),
        "nodes": NodeTable(
            name=np.array([b"body_0", b"body_1"]),
            label=np.array([7, 8]),
            first=np.array([0, 12]),
            dofs=np.array([12, 12]),
            position=rng.normal(size=(2, 3)),
            orientation=rng.normal(size=(2, 3, 3)),
            velocity=rng.normal(size=(2, 3)),
            angular_velocity=rng.normal(size=(2, 3)),
        ),
        "joints": JointTable(
            np.array([b"joint"]), np.array([101]), np.array([b"total joint"]), np.array([24]), np.array([5])
        ),
        "inputs": InputTable(np.array([b"activation[biceps]"]), np.array([b"-"]), rng.normal(size=(n, 1))),
        "muscles": MuscleTable(np.array([b"biceps"]), np.array([301]), *rng.normal(size=(5, 1))),
    }
    return dataclasses.replace(plain, _table=given_tables("test", tables))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A good matrices file."""
    file = tmp_path / "matrices.h5"
    write_matrices(file, complete_matrices())
    return file


def places_of(path: Path) -> dict[str, list[int]]:
    """Where the datasets lie in a file, as HDF5 tells."""
    places = {}
    with h5py.File(path) as file:
        for name, dataset in file.items():
            text = name in ("deck_sha256", "structure")
            places[name] = [dataset.id.get_offset() or 0, *([dataset.dtype.itemsize] if text else dataset.shape)]
    return places


@pytest.mark.parametrize("by_places", [False, True])
def test_round_trip(path: Path, by_places: bool) -> None:
    written, read = complete_matrices(), read_matrices(path, places_of(path) if by_places else None)
    assert read.c == written.c and read.time == written.time and read.analysis == "linearise"
    for name in ("J_plus", "J_minus", "names", "kinds"):
        assert_array_equal(getattr(read, name), getattr(written, name))
    for name in VECTORS:
        assert_array_equal(getattr(read, name), getattr(written, name))
    for group in ("nodes", "joints", "inputs", "muscles"):
        for field in dataclasses.fields(getattr(written, group)):
            got = getattr(getattr(read, group), field.name)
            assert_array_equal(got, getattr(getattr(written, group), field.name))
    assert read.dof_names[:2] == ("body_0.x", "body_0.y") and read.dof_kinds[-1] == "reaction"
    assert_array_equal(read.muscle_lengths, written.muscles.length)
    assert_array_equal(read.equilibrium_residual, written.equilibrium_residual)


def test_equation_15() -> None:
    matrices = complete_matrices()
    model = descriptor(matrices)
    assert_allclose(model.g_ydot + matrices.c * model.g_y, matrices.J_plus, atol=1e-15)
    assert_allclose(model.g_ydot - matrices.c * model.g_y, matrices.J_minus, atol=1e-15)
    assert_array_equal(model.definition_rows, model.momenta - 6)
    assert_array_equal(model.equilibrium_rows, model.coordinates + 6)
    assert model.name(model.index("body_1.bx")) == "body_1.bx"


def test_empty_tables(tmp_path: Path) -> None:
    full = complete_matrices()
    none = np.zeros(0)
    empty = MuscleTable(np.zeros(0, "S1"), np.zeros(0, np.int64), none, none, none, none, none)
    tables = {group: getattr(full, group) for group in (*VECTORS, "nodes", "joints", "inputs")} | {"muscles": empty}
    file = tmp_path / "matrices.h5"
    write_matrices(file, dataclasses.replace(full, _table=given_tables("test", tables)))
    assert read_matrices(file).muscle_lengths.shape == (0,)


@pytest.mark.parametrize("name", DATASETS)
def test_missing_dataset_is_named(path: Path, name: str) -> None:
    with h5py.File(path, "a") as file:
        del file[name]
    with pytest.raises(MatrixError, match=rf"matrices\.h5: dataset '{name}' is missing"):
        read_matrices(path)


@pytest.mark.parametrize("name", ["scalars", "J_plus", "J_minus", "g_u", "vectors", "nodes", "muscles", "checksum"])
def test_wrong_shape_is_named(path: Path, name: str) -> None:
    with h5py.File(path, "a") as file:
        value = file[name][()]
        del file[name]
        file[name] = np.concatenate([value, value[:1]])
    with pytest.raises(MatrixError, match=rf"matrices\.h5: dataset '{name}' has shape"):
        read_matrices(path)


@pytest.mark.parametrize("name", ["scalars", "J_plus", "J_minus", "g_u", "vectors", "nodes", "muscles"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_none_are_named(path: Path, name: str, value: float) -> None:
    with h5py.File(path, "a") as file:
        damaged = np.array(file[name][()])
        damaged[0, 0] = value
        file[name][...] = damaged
    with pytest.raises(MatrixError, match=rf"dataset '{name}' has {value}"):
        read_matrices(path)


def test_wrong_kind_of_dataset_is_named(path: Path) -> None:
    with h5py.File(path, "a") as file:
        del file["J_minus"]
        file["J_minus"] = np.array([[b"text"]])
    with pytest.raises(MatrixError, match=r"dataset 'J_minus' holds .*; expected a matrix of real numbers"):
        read_matrices(path)
    with h5py.File(path, "a") as file:
        del file["structure"]
        file["structure"] = 3.0
    with pytest.raises(MatrixError, match=r"dataset 'structure' holds .*; expected one fixed-length text"):
        read_matrices(path)


def change_structure(path: Path, change: Callable[[dict[str, Any]], None] | bytes) -> None:
    """Give a file another structure, checksum included."""
    with h5py.File(path, "a") as file:
        if isinstance(change, bytes):
            text = change
        else:
            structure = json.loads(file["structure"][0])
            change(structure)
            text = json.dumps(structure).encode()
        text += b" " * (-len(text) % 8)
        sums = file["checksum"][()]
        sums[0] = checksum(text)
        del file["structure"]
        file["structure"] = np.array([text])
        file["checksum"][...] = sums


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (b"{", "is no JSON"),
        (b"[]", "is no JSON object"),
        (lambda s: s.pop("solver"), "has no text 'solver'"),
        (lambda s: s.pop("nodes"), "has no table 'nodes'"),
        (lambda s: s["nodes"].pop("label"), "has no column 'nodes/label' of whole numbers"),
        (lambda s: s["dofs"]["kind"].pop(), "has 28 entries in column 'dofs/kind'; expected 29"),
        (lambda s: s["joints"].update(name=[3]), "has no column 'joints/name' of texts"),
    ],
)
def test_wrong_structure_is_named(path: Path, change: Any, message: str) -> None:
    change_structure(path, change)
    with pytest.raises(MatrixError, match=rf"matrices\.h5: dataset 'structure' {message}"):
        read_matrices(path)


def test_names_that_do_not_fit_the_numbers(path: Path) -> None:
    change_structure(path, lambda s: [column.pop() for column in s["muscles"].values()])  # type: ignore[arg-type, return-value]
    with pytest.raises(MatrixError, match=r"dataset 'muscles' has shape \(1, 5\); expected \(0, 5\)"):
        read_matrices(path)


@pytest.mark.parametrize("by_places", [False, True])
def test_every_flipped_bit_is_noticed(path: Path, by_places: bool) -> None:
    """One bit of many a byte: another number never passes for the one that was written."""
    places = places_of(path) if by_places else None
    good, data = read_matrices(path, places), path.read_bytes()
    covered = sum(8 * rows * columns for _, rows, columns in (p for p in places_of(path).values() if len(p) == 3))
    noticed, step = 0, 43 if by_places else 203
    for k in range(0, len(data), step):
        path.write_bytes(data[:k] + bytes([data[k] ^ (1 << k % 8)]) + data[k + 1 :])
        try:
            read = read_matrices(path, places)
            tables = [getattr(read, group) for group in ("nodes", "joints", "inputs", "muscles")]
        except (MatrixError, FileError):
            noticed += 1
            continue
        for name in ("J_plus", "J_minus", "names", "kinds", *VECTORS):
            assert_array_equal(getattr(read, name), getattr(good, name))
        for table, group in zip(tables, ("nodes", "joints", "inputs", "muscles"), strict=True):
            for field in dataclasses.fields(table):
                assert_array_equal(getattr(table, field.name), getattr(getattr(good, group), field.name))
        assert (read.c, read.time, read.solver) == (good.c, good.time, good.solver)
    assert noticed >= covered // step - len(DATASETS)


def test_strangers_are_refused_first(path: Path, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"nowhere\.h5: cannot be read as HDF5 .*No such file"):
        read_matrices(tmp_path / "nowhere.h5")
    with pytest.raises(FileError, match="cannot be read"):
        read_matrices(tmp_path)
    text = tmp_path / "text.h5"
    text.write_text("begin: data;")
    with pytest.raises(FileError, match="cannot be read as HDF5"):
        read_matrices(text)
    cut = tmp_path / "cut.h5"
    cut.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(FileError, match=r"cut\.h5: cannot be read as HDF5 .*truncated"):
        read_matrices(cut)
    with h5py.File(path, "a") as file:
        file.attrs["filetype"] = np.bytes_("pilotgen motion")
    with pytest.raises(MatrixError, match="its filetype is 'pilotgen motion'"):
        read_matrices(path)
    with h5py.File(path, "a") as file:
        del file.attrs["filetype"]
    with pytest.raises(MatrixError, match="is not a pilotgen matrices file: its filetype is ''"):
        read_matrices(path)


def test_other_versions(path: Path) -> None:
    with h5py.File(path, "a") as file:
        file.attrs["version"] = np.array([2, 7])
    assert read_matrices(path).n == 29  # a newer minor version only adds
    with h5py.File(path, "a") as file:
        file.attrs["version"] = np.array([1, 0])
    with pytest.raises(MatrixError, match=r"version 1\.0 of the format; this program reads 2\.x"):
        read_matrices(path)


def test_coefficient_must_be_positive(path: Path) -> None:
    with h5py.File(path, "a") as file:
        scalars = np.array([[0.0, 0.0]])
        sums = file["checksum"][()]
        sums[1] = checksum(scalars)
        file["scalars"][...], file["checksum"][...] = scalars, sums
    with pytest.raises(MatrixError, match="c is 0 s"):
        read_matrices(path)


def test_places_that_are_wrong_are_noticed(path: Path) -> None:
    places = places_of(path)
    with pytest.raises(MatrixError, match="the solver did not tell where dataset 'J_plus' is"):
        read_matrices(path, {name: place for name, place in places.items() if name != "J_plus"})
    for wrong in ([places["J_plus"][0] + 8, 29, 29], [10**9, 29, 29]):
        with pytest.raises(MatrixError, match="damaged"):
            read_matrices(path, places | {"J_plus": wrong})
    with pytest.raises(FileError, match=r"elsewhere\.h5: cannot be read"):
        read_matrices(path.with_name("elsewhere.h5"), places)
    with pytest.raises(ValueError, match="read-only"):  # what many files share cannot be changed for one
        read_matrices(path, places).names[0] = b"other"


def test_unknown_kind_is_named(path: Path) -> None:
    change_structure(path, lambda s: s["dofs"]["kind"].__setitem__(3, "warp"))
    with pytest.raises(MatrixError, match=r"matrices\.h5: unknown 'body_0.gx' is of kind 'warp'"):
        descriptor(read_matrices(path))


def test_momenta_out_of_place(path: Path) -> None:
    kinds = ["momentum"] * 6 + ["position"] * 6
    change_structure(path, lambda s: s["dofs"]["kind"].__setitem__(slice(12), kinds))
    with pytest.raises(MatrixError, match="momenta of a node must follow"):
        descriptor(read_matrices(path))
