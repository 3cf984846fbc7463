"""MBDyn's files: the three containers, the border scaling, names, and what is refused.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from linear_models import CASES, assemble, raw_case
from numpy.testing import assert_allclose, assert_array_equal

from pilotgen.errors import FileError, MatrixError
from pilotgen.solver.matrices import Matrices, descriptor
from pilotgen.solver.mbdyn_files import RawEigenanalysis, read_m, read_mbdyn, read_netcdf, to_textbook

SPARSE = (
    b"dCoef = 1.; dTime = 0.; Aplus = [1 %s 1.\n]; Aplus = spconvert(Aplus); Aminus = [1 1 1.\n]; "
    b"Aminus = spconvert(Aminus); labels = int32([1;\n]); idx = int32([%s;\n]);"
)
NETCDF_CASES = ["c03a_revhinge_rod_rest", "c08a_muscle_pennestri"]


def write_m(path: Path, raw: RawEigenanalysis, sparse: bool) -> None:
    """Write a `.m` file as MBDyn does (field order and punctuation of its output)."""

    def integers(values: np.ndarray) -> str:
        return "int32([\n" + "".join(f"\t{value};\n" for value in values) + "])"

    def matrix(name: str, A: np.ndarray) -> str:
        if sparse:
            entries = "".join(f"{i + 1} {j + 1} {A[i, j]:.17e}\n;" for i, j in np.argwhere(A != 0.0))
            return f"{name} = [{entries}];\n{name} = spconvert({name});\n"
        return f"{name} = [" + "".join(" ".join(f"{value:.17e}" for value in row) + " ;\n" for row in A) + "];\n"

    path.write_text(
        f"% time: {raw.time}\ndTime = {raw.time:.17e};\n% coefficient\ndCoef = {raw.c:.17e};\n"
        "% timestep index\nlStep = int32(0);\n% F/xPrime + dCoef * F/x\n"
        + matrix("Aplus", raw.Aplus)
        + "% F/xPrime - dCoef * F/x\n"
        + matrix("Aminus", raw.Aminus)
        + f"% structural nodes labels\nlabels = {integers(raw.labels)};\n"
        + f"% structural nodes base index\nidx = {integers(raw.first)};\n"
        + "% alphar, alphai, beta\nalpha = [1. 0. 0.;\n];\n"
    )


@pytest.mark.parametrize("name", NETCDF_CASES)
def test_classic_netcdf_is_transposed(name: str) -> None:
    stored, read = raw_case(name), read_netcdf(str(CASES / f"{name}.nc"))
    assert_array_equal(read.Aplus, stored.Aplus)
    assert_array_equal(read.Aminus, stored.Aminus)
    assert_array_equal(read.labels, stored.labels)
    assert_array_equal(read.first, stored.first)
    assert read.c == stored.c and read.time == 0.0
    assert not np.array_equal(stored.Aplus, stored.Aplus.T)  # else the transposition would not be tested


@pytest.mark.parametrize("sparse", [False, True])
def test_hdf5_based_netcdf(tmp_path: Path, sparse: bool) -> None:
    raw = raw_case("c03a_revhinge_rod_rest")
    path = tmp_path / "out.nc"
    with h5py.File(path, "w") as file:
        file["eig.idx"], file["eig.labels"] = raw.first.astype(np.int32), raw.labels.astype(np.int32)
        file["eig.joint.idx"], file["eig.joint.labels"] = raw.joint_first, raw.joint_labels
        for k in (0, 1):  # two analyses; the first with other numbers
            for name, A in (("Aplus", raw.Aplus), ("Aminus", raw.Aminus)):
                A = A if k else 2.0 * A
                where = np.argwhere(A != 0.0)
                triplets = np.column_stack([where + 1.0, A[A != 0.0]])
                file[f"eig.{k}.{name}"] = triplets if sparse else A.T
            file[f"eig.{k}.dCoef"], file[f"eig.{k}.time"] = [raw.c], [0.5 * k]
    read = read_netcdf(str(path))
    assert_array_equal(read.Aplus, raw.Aplus)
    assert_array_equal(read.Aminus, raw.Aminus)
    assert read.time == 0.5
    assert_array_equal(read_netcdf(str(path), 0).Aplus, 2.0 * raw.Aplus)
    with pytest.raises(MatrixError, match="holds no eigenanalysis 4; it holds 0, 1"):
        read_netcdf(str(path), 4)


@pytest.mark.parametrize("sparse", [False, True])
def test_text(tmp_path: Path, sparse: bool) -> None:
    raw = raw_case("c08a_muscle_pennestri")
    path = tmp_path / "out_00.m"
    write_m(path, raw, sparse)
    read = read_m(str(path))
    assert_array_equal(read.Aplus, raw.Aplus)
    assert_array_equal(read.Aminus, raw.Aminus)
    assert read.c == raw.c
    ours, of_netcdf = read_mbdyn(path), read_mbdyn(CASES / "c08a_muscle_pennestri.nc")
    assert_array_equal(ours.J_plus, of_netcdf.J_plus)
    assert ours.dof_names[:18] == of_netcdf.dof_names[:18]
    assert (ours.dof_names[-1], of_netcdf.dof_names[-1]) == ("joints.reaction[9]", "joint 1.reaction[3]")


def test_names_and_kinds() -> None:
    matrices = to_textbook(raw_case("arm_right"))
    assert matrices.n == 100
    assert matrices.dof_names[:7] == tuple(f"node 1.{u}" for u in ("x", "y", "z", "gx", "gy", "gz")) + ("node 2.x",)
    assert matrices.dof_names[66] == "joint 101.reaction[1]" and matrices.dof_names[-1] == "joint 108.reaction[6]"
    kinds = matrices.dof_kinds
    assert kinds[:6] == ("position",) * 3 + ("rotation",) * 3  # the seat is static
    assert kinds[6:18] == ("position",) * 3 + ("rotation",) * 3 + ("momentum",) * 3 + ("momenta_moment",) * 3
    assert kinds.count("reaction") == 34
    assert (matrices.solver, matrices.analysis) == ("mbdyn", "linearise")


def mbdyn_scaled(matrices: Matrices, holonomic_rows: int) -> RawEigenanalysis:
    """Scale a textbook pair as MBDyn does: D_r^-1 J D_c^-1 with D_r, D_c = c on holonomic rows, on reaction columns."""
    n, r = matrices.n, np.flatnonzero(matrices.kinds == b"reaction")
    scaled = []
    for sign, J in ((1.0, matrices.J_plus), (-1.0, matrices.J_minus)):
        rows, columns = np.ones(n), np.ones(n)
        rows[r[:holonomic_rows]] = sign * matrices.c
        columns[r] = sign * matrices.c
        scaled.append(J / rows[:, None] / columns[None, :])
    return RawEigenanalysis("made", matrices.c, 0.0, scaled[0], scaled[1], np.array([11, 12]), np.array([0, 12]))


@pytest.mark.parametrize("rate_depends_on_c", [True, False])
def test_border_scaling_is_undone(rate_depends_on_c: bool) -> None:
    rng = np.random.default_rng(2)
    Phi, Phi_rate = rng.normal(size=(5, 12)), np.zeros((5, 12))
    Phi_rate[3:] = rng.normal(size=(2, 12))
    if not rate_depends_on_c:
        Phi[3:] = 0.0  # a velocity constraint at rest
    M, D, K = rng.normal(size=(3, 12, 12))
    textbook = assemble([("a", True), ("b", False)], [("j", 5)], M, D, K, Phi, Phi_rate=Phi_rate, c=0.003)
    raw = mbdyn_scaled(textbook, 3)
    layout = None if rate_depends_on_c else textbook  # the matrices alone do not show what is not there
    read = to_textbook(raw, layout)
    assert_allclose(read.J_plus, textbook.J_plus, rtol=1e-14, atol=1e-16)
    assert_allclose(read.J_minus, textbook.J_minus, rtol=1e-14, atol=1e-16)
    assert_array_equal(read.kinds, textbook.kinds)
    model = descriptor(read)
    assert not model.g_ydot[:, model.reactions].any()


def test_layout_lends_its_names() -> None:
    rng = np.random.default_rng(4)
    M, D, K = rng.normal(size=(3, 12, 12))
    ours = assemble([("seat", True), ("lever", False)], [("pin", 3)], M, D, K, rng.normal(size=(3, 12)))
    assert to_textbook(mbdyn_scaled(ours, 3), ours).dof_names == ours.dof_names
    fewer = assemble([("seat", True), ("lever", False)], [("pin", 2)], M, D, K, rng.normal(size=(2, 12)))
    with pytest.raises(MatrixError, match="has 21 unknowns and assembled has 20"):
        to_textbook(mbdyn_scaled(ours, 3), fewer)
    other = assemble([("seat", False), ("lever", True)], [("pin", 3)], M, D, K, rng.normal(size=(3, 12)))
    with pytest.raises(MatrixError, match="unknown 6 is a momentum"):
        to_textbook(mbdyn_scaled(ours, 3), other)


def test_refused_files(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no such file"):
        read_mbdyn(tmp_path / "a.nc")
    for name, content, message in (
        ("b.nc", b"hello world", "not a NetCDF file"),
        ("d.nc", (CASES / f"{NETCDF_CASES[0]}.nc").read_bytes()[:900], "not a whole NetCDF file"),
        ("e.m", b"dCoef = 1.;", "idx is missing"),
        ("f.m", b"idx = int32([0;\n]); labels = int32([1;\n]); Aplus = [1 2 ;\n3 ;\n];", "same number of entries"),
        ("f1.m", SPARSE % (b"1.5", b"0"), "index of a sparse matrix is 1.5, a whole number from 1 to 5000 is wanted"),
        ("f2.m", SPARSE % (b"1e12", b"0"), "index of a sparse matrix is 1e"),
        ("f3.m", SPARSE % (b"nan", b"0"), "index of a sparse matrix is nan"),
        ("f4.m", SPARSE % (b"1", b"0.5"), "an entry of idx is 0.5"),
        ("f5.m", SPARSE % (b"1", b"0;\n4"), "1 labels beside 2 entries of idx"),
        ("g.m", b"idx = int32([0;\n]); labels = int32([1;\n]); Aplus = [1 x ;\n];", "not a number"),
    ):
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(MatrixError, match=message):
            read_mbdyn(path)
    with pytest.raises(FileError, match="by its suffix"):
        (tmp_path / "h.txt").write_text("")
        read_mbdyn(tmp_path / "h.txt")


def test_unusable_matrices() -> None:
    raw = raw_case("c01a_revpin_rest")
    for change, message in (
        ({"Aplus": np.full_like(raw.Aplus, np.nan)}, "Aplus has entries that are not finite"),
        ({"Aminus": raw.Aminus[:, :-1]}, "Aminus has shape"),
        ({"c": 0.0}, "dCoef is 0 s"),
        ({"first": np.array([3])}, "starts at unknown 3"),
    ):
        with pytest.raises(MatrixError, match=message):
            to_textbook(RawEigenanalysis(**{**vars(raw), **change}))
