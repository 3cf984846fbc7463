"""Matrices files: round trip, strangers refused by name, eq. (15).

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import h5py
import numpy as np
import pytest
from linear_models import random_mechanism
from numpy.testing import assert_allclose, assert_array_equal

from pilotgen.errors import FileError, MatrixError
from pilotgen.solver.matrices import (
    InputTable,
    JointTable,
    Matrices,
    MuscleTable,
    NodeTable,
    descriptor,
    given_tables,
    read_matrices,
    write_matrices,
)

DATASETS = [
    "c", "time", "J_plus", "J_minus", "y", "ydot", "residual", "equilibrium_residual", "dofs/name", "dofs/kind",
    "inputs/name", "inputs/unit", "inputs/g_u", "nodes/name", "nodes/first", "nodes/orientation", "joints/type",
    "muscles/length", "muscles/activation",
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


@pytest.mark.parametrize("complete", [True, False])
def test_round_trip(path: Path, complete: bool) -> None:
    written, read = complete_matrices(), read_matrices(path, complete)
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


@pytest.mark.parametrize("name", [name for name in DATASETS if name not in ("c", "time")])
def test_wrong_shape_is_named(path: Path, name: str) -> None:
    with h5py.File(path, "a") as file:
        value = file[name][()]
        del file[name]
        file[name] = np.concatenate([value, value[:1]])
    with pytest.raises(MatrixError, match=r"matrices\.h5: dataset '.*' has shape"):
        read_matrices(path)


@pytest.mark.parametrize(
    "name", ["c", "J_plus", "J_minus", "residual", "inputs/g_u", "nodes/position", "muscles/force"]
)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_none_are_named(path: Path, name: str, value: float) -> None:
    with h5py.File(path, "a") as file:
        damaged = np.array(file[name][()])
        damaged[(0,) * damaged.ndim] = value
        file[name][...] = damaged
    with pytest.raises(MatrixError, match=rf"dataset '{name}' has {value}"):
        read_matrices(path)


def test_wrong_kind_of_dataset_is_named(path: Path) -> None:
    with h5py.File(path, "a") as file:
        del file["J_minus"]
        file["J_minus"] = np.array([b"text"])
    with pytest.raises(MatrixError, match=r"dataset 'J_minus' holds .*; expected real numbers"):
        read_matrices(path)


def test_strangers_are_refused_first(path: Path, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"nowhere\.h5: no such file"):
        read_matrices(tmp_path / "nowhere.h5")
    with pytest.raises(FileError, match="cannot be read"):
        read_matrices(tmp_path)
    text = tmp_path / "text.h5"
    text.write_text("begin: data;")
    with pytest.raises(MatrixError, match="not HDF5"):
        read_matrices(text)
    cut = tmp_path / "cut.h5"
    cut.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(MatrixError, match="not written to its end"):
        read_matrices(cut)
    with h5py.File(path, "a") as file:
        file.attrs["filetype"] = np.bytes_("pilotgen motion")
    with pytest.raises(MatrixError, match="its filetype is 'pilotgen motion'"):
        read_matrices(path)
    with h5py.File(path, "a") as file:
        del file.attrs["filetype"]
    with pytest.raises(MatrixError, match="no attribute 'filetype'"):
        read_matrices(path)


def test_other_versions(path: Path) -> None:
    with h5py.File(path, "a") as file:
        file.attrs["version"] = np.array([1, 7])
    assert read_matrices(path).n == 29  # a newer minor version only adds
    with h5py.File(path, "a") as file:
        file.attrs["version"] = np.array([2, 0])
    with pytest.raises(MatrixError, match=r"version 2\.0 of the format; this program reads 1\.x"):
        read_matrices(path)


def test_coefficient_must_be_positive(path: Path) -> None:
    with h5py.File(path, "a") as file:
        file["c"][...] = 0.0
    with pytest.raises(MatrixError, match="'c' is 0 s"):
        read_matrices(path)


def test_lazy_columns_come_from_the_file_as_it_was(path: Path) -> None:
    matrices, whole = read_matrices(path, complete=False), read_matrices(path)
    path.unlink()
    path.write_text("something else")
    for table, columns in (("nodes", ("position", "name")), ("inputs", ("g_u", "unit")), ("muscles", ("force",))):
        for column in columns:
            np.testing.assert_array_equal(
                getattr(getattr(matrices, table), column), getattr(getattr(whole, table), column)
            )
    with pytest.raises(AttributeError, match="no column 'colour'"):
        _ = matrices.nodes.colour  # type: ignore[attr-defined]


def test_lazy_columns_are_checked(path: Path) -> None:
    with h5py.File(path, "a") as file:
        del file["nodes/dofs"]
        file["nodes/dofs"] = np.zeros(1, dtype=np.int64)
    matrices = read_matrices(path, complete=False)
    assert len(matrices.nodes.first) > 1
    with pytest.raises(MatrixError, match=r"matrices\.h5: dataset 'nodes/dofs' has shape \(1,\)"):
        _ = matrices.nodes.dofs


def test_unknown_kind_is_named(path: Path) -> None:
    with h5py.File(path, "a") as file:
        kinds = file["dofs/kind"][()]
        kinds[3] = b"warp"
        file["dofs/kind"][...] = kinds
    with pytest.raises(MatrixError, match=r"matrices\.h5: unknown 'body_0.gx' is of kind 'warp'"):
        descriptor(read_matrices(path))


def test_momenta_out_of_place(path: Path) -> None:
    with h5py.File(path, "a") as file:
        kinds = file["dofs/kind"][()]
        kinds[:6], kinds[6:12] = b"momentum", b"position"
        file["dofs/kind"][...] = kinds
    with pytest.raises(MatrixError, match="momenta of a node must follow"):
        descriptor(read_matrices(path))
