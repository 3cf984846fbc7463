"""Compare two linearised models, ours or MBDyn's: natural frequencies and damping first, then entry by entry.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pilotgen.errors import FileError, MatrixError
from pilotgen.linear.modal import ModalModel, modes
from pilotgen.solver.descriptor import Floats
from pilotgen.solver.matrices import Matrices, descriptor, read_matrices
from pilotgen.solver.mbdyn_files import read_mbdyn

_OUR_SUFFIXES, _MBDYN_SUFFIXES = (".h5", ".hdf5"), (".nc", ".m")
MOST_SHOWN = 5  # entries of each matrix that a message names


@dataclass(frozen=True)
class EntryDifference:
    """One entry that differs: row and column by name, both values."""

    row: str
    column: str
    a: float
    b: float


@dataclass(frozen=True)
class MatrixDifference:
    """How two matrices differ.

    Attributes
    ----------
    name : str
        `g_ydot` or `g_y`.
    scale : float
        Largest entry of either matrix (absolute).
    largest : float
        Largest difference (absolute).
    relative : float
        largest / scale; 0 if both matrices are zero.
    entries : tuple of EntryDifference
        The largest differences beyond the tolerance, largest first, at most five.
    n_beyond : int
        Number of entries that differ by more than the tolerance.
    """

    name: str
    scale: float
    largest: float
    relative: float
    entries: tuple[EntryDifference, ...]
    n_beyond: int


@dataclass(frozen=True)
class ModeDifference:
    """An eigenvalue of A and its partner in B [rad/s]; None where the other has no such eigenvalue."""

    a: complex | None
    b: complex | None
    relative: float


@dataclass(frozen=True)
class Comparison:
    """The verdict on two models and all it rests on."""

    path_a: str
    path_b: str
    tolerance: float
    modes: tuple[ModeDifference, ...]
    matrices: tuple[MatrixDifference, ...]
    note: str  # why there are no modes to compare, or empty
    left_out: tuple[str, ...] = ()  # eigenvalues that are no modes, in words, for A and B

    @property
    def agree(self) -> bool:
        """Whether every difference is within the tolerance."""
        return all(mode.relative <= self.tolerance for mode in self.modes) and all(
            matrix.relative <= self.tolerance for matrix in self.matrices
        )


def read_any(path: str | os.PathLike[str], layout: Matrices | None = None) -> Matrices:
    """Read a matrices file of either solver, by its suffix: `.h5` ours, else MBDyn's (`layout` as in `read_mbdyn`)."""
    return read_matrices(path) if Path(path).suffix in _OUR_SUFFIXES else read_mbdyn(path, layout)


def compare(a: Matrices, b: Matrices, tolerance: float = 1e-9) -> Comparison:
    """Compare two models of the same deck.

    Parameters
    ----------
    a, b : Matrices
        The models; rows and columns are named after `a`'s unknowns.
    tolerance : float
        Largest difference, relative to the largest entry of the matrix or to the eigenvalue's modulus.

    Raises
    ------
    MatrixError
        They have different unknowns: number, kinds, or names (where both have names of their own).
    """
    _check_same_unknowns(a, b)
    model_a, model_b = descriptor(a), descriptor(b)
    pairs: tuple[ModeDifference, ...] = ()
    left_out: tuple[str, ...] = ()
    try:
        modal_a, modal_b = modes(model_a), modes(model_b)
        pairs, note = _pair_modes(modal_a, modal_b), ""
        left_out = _left_out("A", modal_a), _left_out("B", modal_b)
    except MatrixError as error:
        note = f"modes not compared: {error}"
    return Comparison(
        path_a=a.path,
        path_b=b.path,
        tolerance=tolerance,
        modes=pairs,
        matrices=tuple(
            _difference(name, getattr(model_a, name), getattr(model_b, name), a.dof_names, tolerance)
            for name in ("g_ydot", "g_y")
        ),
        note=note,
        left_out=left_out,
    )


def compare_files(
    path_a: str | os.PathLike[str], path_b: str | os.PathLike[str], tolerance: float = 1e-9
) -> Comparison:
    """Compare two files.

    FileError if a file cannot be read.

    When one file is ours and the other MBDyn's, ours lends the names and tells velocity constraints from holonomic
    ones.
    """
    for path in (path_a, path_b):
        if Path(path).suffix not in (*_OUR_SUFFIXES, *_MBDYN_SUFFIXES):
            raise FileError(f"{os.fspath(path)}: expected a matrices file: .h5 of mbdae, .nc or .m of MBDyn")
    own = [Path(path).suffix in _OUR_SUFFIXES for path in (path_a, path_b)]
    if own[1] and not own[0]:
        b = read_any(path_b)
        a = read_any(path_a, layout=b)
    else:
        a = read_any(path_a)
        b = read_any(path_b, layout=a if own[0] else None)
    return compare(a, b, tolerance)


def report(comparison: Comparison) -> str:
    """Return the comparison as text for a person."""
    lines = [f"A  {comparison.path_a}", f"B  {comparison.path_b}", ""]
    if comparison.note:
        lines.append(comparison.note)
    else:
        lines.append(f"{len(comparison.modes)} natural frequencies and damping ratios (finite, nonzero eigenvalues)")
        lines.append("     A                        B                        relative difference")
        lines += [f"     {_mode(m.a):<24} {_mode(m.b):<24} {m.relative:.2e}" for m in comparison.modes]
        lines += [f"     left out: {text}" for text in comparison.left_out]
    for matrix in comparison.matrices:
        lines.append("")
        lines.append(
            f"{matrix.name}: largest difference {matrix.largest:.3e}, {matrix.relative:.2e} of the largest entry"
        )
        if matrix.n_beyond:
            lines.append(f"     {matrix.n_beyond} entries beyond the tolerance; the largest:")
        lines += [
            f"     {matrix.name}[{entry.row}, {entry.column}]: A {entry.a:.17g}, B {entry.b:.17g}"
            for entry in matrix.entries
        ]
    verdict = "agree" if comparison.agree else "DIFFER"
    lines += ["", f"A and B {verdict} at a relative tolerance of {comparison.tolerance:g}"]
    return "\n".join(lines)


def _check_same_unknowns(a: Matrices, b: Matrices) -> None:
    if a.n != b.n:
        raise MatrixError(f"{a.path} has {a.n} unknowns, {b.path} has {b.n}: they are not models of the same deck")
    for what, of_a, of_b in (("kind", a.kinds, b.kinds), ("name", a.names, b.names)):
        if what == "name" and "mbdyn" in (a.solver, b.solver) and a.solver != b.solver:
            continue  # MBDyn's files have labels, not names
        differing = np.flatnonzero(of_a != of_b)
        if len(differing):
            k = int(differing[0])
            raise MatrixError(
                f"unknown {k} is {a.dof_names[k]} ({a.dof_kinds[k]}) in {a.path} but {b.dof_names[k]} "
                f"({b.dof_kinds[k]}) in {b.path}, and {len(differing)} unknowns differ by {what}: "
                "they are not models of the same deck"
            )


def _difference(name: str, a: Floats, b: Floats, names: tuple[str, ...], tolerance: float) -> MatrixDifference:
    difference = np.abs(a - b)
    scale = float(max(np.abs(a).max(), np.abs(b).max()))
    beyond = difference > tolerance * scale
    order = np.argsort(difference, axis=None, kind="stable")[::-1][: min(MOST_SHOWN, int(beyond.sum()))]
    entries = []
    for flat in order:
        row, column = np.unravel_index(flat, a.shape)
        entries.append(EntryDifference(names[row], names[column], float(a[row, column]), float(b[row, column])))
    largest = float(difference.max())
    return MatrixDifference(name, scale, largest, largest / scale if scale else 0.0, tuple(entries), int(beyond.sum()))


def _pair_modes(a: ModalModel, b: ModalModel) -> tuple[ModeDifference, ...]:
    """Pair each eigenvalue (positive imaginary part or real) of A with the nearest one left in B."""
    left = list(b.lam[b.lam.imag >= 0.0])
    pairs = []
    for lam in a.lam[a.lam.imag >= 0.0]:
        if left:
            k = int(np.argmin(np.abs(np.array(left) - lam)))
            partner = left.pop(k)
            pairs.append(ModeDifference(complex(lam), complex(partner), float(abs(lam - partner) / abs(lam))))
        else:
            pairs.append(ModeDifference(complex(lam), None, float("inf")))
    pairs += [ModeDifference(None, complex(lam), float("inf")) for lam in left]
    return tuple(pairs)


def _left_out(name: str, modal: ModalModel) -> str:
    return (
        f"of {name} {modal.n_zero} zero eigenvalues (rigid motion, no stiffness) and {modal.n_infinite} infinite ones "
        "of directions without mass; those of constraints are not counted"
    )


def _mode(lam: complex | None) -> str:
    if lam is None:
        return "none"
    return f"{abs(lam) / (2.0 * np.pi):.6f} Hz / {-100.0 * lam.real / abs(lam):.4f} %"
