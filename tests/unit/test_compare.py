"""Comparison of two models: what is equal, what is named, what is refused.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from linear_models import CASES, assemble, case, random_mechanism
from matrices_writer import write_matrices
from test_matrices import complete_matrices

from pilotgen.errors import FileError, MatrixError
from pilotgen.linear.compare import compare, compare_files, report
from pilotgen.solver.matrices import Matrices


def with_change(matrices: Matrices, row: int, column: int, by: float, rate: bool = False) -> Matrices:
    """Add `by` to one entry of g_y (or g_ydot)."""
    plus, minus = matrices.J_plus.copy(), matrices.J_minus.copy()
    plus[row, column] += by if rate else matrices.c * by
    minus[row, column] += by if rate else -matrices.c * by
    return dataclasses.replace(matrices, J_plus=plus, J_minus=minus)


def test_a_model_agrees_with_itself_at_another_c() -> None:
    a, b = (random_mechanism(np.random.default_rng(1), 2, 9) for _ in range(2))
    g_ydot, g_y = (b.J_plus + b.J_minus) / 2, (b.J_plus - b.J_minus) / (2 * b.c)
    b = dataclasses.replace(b, c=0.5, J_plus=g_ydot + 0.5 * g_y, J_minus=g_ydot - 0.5 * g_y)
    comparison = compare(a, b, 1e-9)
    assert comparison.agree and not comparison.note
    assert sum(2 if mode.a.imag else 1 for mode in comparison.modes if mode.a is not None) == 6
    assert all(not matrix.entries for matrix in comparison.matrices)


def test_the_largest_differences_are_named_at_most_five() -> None:
    a = random_mechanism(np.random.default_rng(2), 2, 4)
    b = a
    for k in range(7):
        b = with_change(b, 6 + k, 2, (k + 1) * 1e-3)
    b = with_change(b, 12, 3, -0.25, rate=True)
    comparison = compare(a, b, 1e-9)
    g_ydot, g_y = comparison.matrices
    assert not comparison.agree
    assert g_y.n_beyond == 7 and len(g_y.entries) == 5
    assert (g_y.entries[0].row, g_y.entries[0].column) == ("body_1.x", "body_0.z")  # the definition row of body 1's x
    assert g_y.entries[0].b - g_y.entries[0].a == pytest.approx(7e-3)
    assert g_y.largest == pytest.approx(7e-3)
    assert (g_ydot.n_beyond, g_ydot.entries[0].row, g_ydot.entries[0].column) == (1, "body_1.x", "body_0.gx")
    text = report(comparison)
    assert text.index("natural frequencies") < text.index("g_ydot:") < text.index("g_y:") < text.index("DIFFER")
    assert "g_ydot[body_1.x, body_0.gx]: A " in text


def test_differences_within_the_tolerance_agree() -> None:
    a = random_mechanism(np.random.default_rng(3), 1, 2)
    b = with_change(a, 6, 0, 1e-7)
    assert compare(a, b, 1e-5).agree
    assert not compare(a, b, 1e-9).agree


def test_modes_that_only_one_has() -> None:
    """Without stiffness and damping along x a rigid motion remains; its two zero eigenvalues are set aside."""
    a = random_mechanism(np.random.default_rng(4), 1, 0)
    b = a
    for row in range(6, 12):
        b = with_change(b, row, 0, -((a.J_plus - a.J_minus) / (2 * a.c))[row, 0])
        b = with_change(b, row, 0, -((a.J_plus + a.J_minus) / 2)[row, 0], rate=True)
    comparison = compare(a, b, 1e-9)
    assert [mode.b is None for mode in comparison.modes].count(True) == 1
    assert not comparison.agree
    assert "none" in report(comparison)


def test_files_of_both_solvers(tmp_path: Path) -> None:
    netcdf = CASES / "c03a_revhinge_rod_rest.nc"
    found = compare_files(netcdf, netcdf)
    text = report(found)
    assert found.agree and "1.007456 Hz" in text and "agree" in text
    full, mbdyn = complete_matrices(), case("c03a_revhinge_rod_rest")
    names = np.array([f"n{k}.x" for k in range(mbdyn.n)], dtype=np.bytes_)
    ours = tmp_path / "ours.h5"
    changed = with_change(mbdyn, 12, 7, 1e-3)
    tables = {group: getattr(full, group) for group in ("nodes", "joints", "muscles")}
    vectors = dict.fromkeys(("y", "ydot", "residual", "equilibrium_residual"), np.zeros(mbdyn.n))
    inputs = dataclasses.replace(full.inputs, g_u=np.zeros((mbdyn.n, 1)))
    complete = dataclasses.replace(changed, solver="mbdae 1.0.0", names=names)
    object.__setattr__(complete, "_table", {**tables, "inputs": inputs, **vectors}.__getitem__)
    write_matrices(ours, complete)
    for order in ((ours, netcdf), (netcdf, ours)):
        found = compare_files(*order, 1e-9)
        assert not found.agree
        assert "g_y[n12.x, n7.x]" in report(found)  # our names, whichever file comes first


def test_models_of_other_decks_are_refused() -> None:
    a = random_mechanism(np.random.default_rng(5), 1, 2)
    with pytest.raises(MatrixError, match="has 14 unknowns, .* has 15: they are not models of the same deck"):
        compare(a, random_mechanism(np.random.default_rng(5), 1, 3))
    renamed = a.names.copy()
    renamed[3] = b"arm.gx"
    with pytest.raises(MatrixError, match=r"unknown 3 is body_0.gx .* but arm.gx .*, and 1 unknowns differ by name"):
        compare(a, dataclasses.replace(a, names=renamed))
    kinds = a.kinds.copy()
    kinds[-1] = b"position"
    with pytest.raises(MatrixError, match="differ by kind"):
        compare(a, dataclasses.replace(a, kinds=kinds))
    with pytest.raises(FileError, match=r"\.h5 of mbdae, \.nc or \.m of MBDyn"):
        compare_files("a.txt", "b.h5")


def test_what_is_left_out_is_told() -> None:
    """A body that floats in x, without mass in y."""
    M, K = np.diag([1.0, 0.0, 1.0, 1.0, 1.0, 1.0]), np.diag([0.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    floating = assemble([("body", True)], [], M, 0.0 * M, K, np.zeros((0, 6)))
    comparison = compare(floating, floating)
    assert [text.split("(")[0] for text in comparison.left_out] == [
        "of A 2 zero eigenvalues ",
        "of B 2 zero eigenvalues ",
    ]
    assert "left out: of A 2 zero eigenvalues (rigid motion, no stiffness) and 2 infinite ones" in report(comparison)
