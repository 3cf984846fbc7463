"""Read the matrices that MBDyn writes (NetCDF `.nc`, text `.m`) and bring them to the program's own convention.

MBDyn's Aplus and Aminus differ from the textbook pair J(c), J(-c) by a known scaling of the borders: holonomic
constraint rows are divided by +-c, and reaction columns are not multiplied by +-c. This is the only place that knows;
everything behind it sees the textbook pair. docs/theory/linearisation.md has the derivation.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pilotgen.errors import FileError, MatrixError
from pilotgen.files import refuse_special
from pilotgen.hdf5 import open_to_read
from pilotgen.solver.descriptor import Floats
from pilotgen.solver.matrices import Matrices, given_tables

_MOST_UNKNOWNS = 5000  # as many as mbdae has
_DYNAMIC, _STATIC = 12, 6  # unknowns of a dynamic and of a static structural node
_NODE_UNKNOWNS = ("x", "y", "z", "gx", "gy", "gz", "bx", "by", "bz", "hx", "hy", "hz")
_NODE_KINDS = ("position",) * 3 + ("rotation",) * 3 + ("momentum",) * 3 + ("momenta_moment",) * 3
# What MBDyn's files do not tell apart: what modal nodes and joints have, abstract nodes, states, algebraic values.
_TOLD_AS = {
    b"state": b"reaction",
    b"algebraic": b"reaction",
    b"velocity": b"momentum",
    b"angular_velocity": b"momenta_moment",
    b"modal_displacement": b"reaction",
    b"modal_velocity": b"reaction",
}


@dataclass(frozen=True)
class RawEigenanalysis:
    """What one MBDyn eigenanalysis holds, before the borders are rescaled.

    Attributes
    ----------
    path : str
        File it came from.
    c : float
        MBDyn's dCoef [s], half of the card's `parameter`.
    time : float
        Time of the analysis [s].
    Aplus, Aminus : ndarray, shape (n, n)
        As MBDyn means them: row = equation, column = unknown.
    labels, first : ndarray of int
        Label of each structural node and its first unknown, counted from 0.
    joint_labels, joint_first : ndarray of int
        The same for joints with unknowns, where the file has them (NetCDF does, text does not).
    """

    path: str
    c: float
    time: float
    Aplus: Floats
    Aminus: Floats
    labels: NDArray[np.int64]
    first: NDArray[np.int64]
    joint_labels: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    joint_first: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


def read_mbdyn(path: str | os.PathLike[str], layout: Matrices | None = None, analysis: int | None = None) -> Matrices:
    """Read one eigenanalysis of MBDyn as `Matrices` in the textbook convention.

    Parameters
    ----------
    path : path
        `.nc` (NetCDF, classic or HDF5-based) or `.m` (text, full or sparse matrices).
    layout : Matrices, optional
        Our own file of the same deck: supplies names, kinds, and which constraints are of velocity type. Without it the
        unknowns are called `node 3.x` and `joint 101.reaction[1]` (by label), and a constraint row counts as velocity
        type when Aplus and Aminus differ in it; one that does not depend on c (a system at rest) cannot be told from a
        holonomic one by the matrices alone.
    analysis : int, optional
        Which eigenanalysis of a NetCDF file, from 0; default the last (after MBDyn's derivatives phase).

    Raises
    ------
    FileError, MatrixError
        The file cannot be read; or it holds no usable matrices, or not those of `layout`.
    """
    text_path = os.fspath(path)
    suffix = Path(text_path).suffix
    refuse_special(path)
    if not os.path.isfile(text_path):
        raise FileError(f"{text_path}: no such file; expected MBDyn's .nc or .m output")
    if suffix == ".m":
        raw = read_m(text_path)
    elif suffix == ".nc":
        raw = read_netcdf(text_path, analysis)
    else:
        raise FileError(f"{text_path}: expected MBDyn's .nc or .m output, by its suffix")
    return to_textbook(raw, layout)


# ---- the convention


def to_textbook(raw: RawEigenanalysis, layout: Matrices | None = None) -> Matrices:
    """Undo MBDyn's border scaling and name the unknowns; see `read_mbdyn` for `layout` and errors.

    MatrixError if the matrices do not fit the layout.
    """
    n = len(raw.Aplus)
    for name, A in (("Aplus", raw.Aplus), ("Aminus", raw.Aminus)):
        if A.shape != (n, n) or n == 0:
            raise MatrixError(f"{raw.path}: {name} has shape {A.shape}; expected a square matrix like Aplus")
        if not np.isfinite(A).all():
            raise MatrixError(f"{raw.path}: {name} has entries that are not finite numbers")
    if len(raw.labels) != len(raw.first):
        raise MatrixError(f"{raw.path}: {len(raw.labels)} labels beside {len(raw.first)} entries of idx")
    if len(raw.joint_labels) != len(raw.joint_first):
        raise MatrixError(
            f"{raw.path}: {len(raw.joint_labels)} labels of joints beside {len(raw.joint_first)} entries of their idx"
        )
    if not (raw.c > 0.0 and np.isfinite(raw.c)):
        raise MatrixError(f"{raw.path}: dCoef is {raw.c:g} s; expected a positive coefficient")
    names, kinds = _name_unknowns(raw) if layout is None else _names_of_layout(raw, layout)

    reaction = kinds == b"reaction"
    algebraic = reaction | (kinds == b"algebraic")
    coordinate_columns = np.flatnonzero(~algebraic)
    if layout is None:
        joints = np.flatnonzero(reaction)
        if raw.Aplus[np.ix_(joints, joints)].any():
            raise MatrixError(
                f"{raw.path}: a joint has unknowns of its own beside reactions (a modal joint?); reading it needs "
                "our own file of the same deck as the layout"
            )
        depends_on_c = (raw.Aplus[:, coordinate_columns] != raw.Aminus[:, coordinate_columns]).any(axis=1)
        holonomic = reaction & ~depends_on_c
    else:
        rates = (layout.J_plus + layout.J_minus)[:, coordinate_columns]
        holonomic = reaction & ~(rates != 0.0).any(axis=1)

    J_plus, J_minus = raw.Aplus.copy(), raw.Aminus.copy()
    J_plus[holonomic] *= raw.c
    J_minus[holonomic] *= -raw.c
    J_plus[:, algebraic] *= raw.c
    J_minus[:, algebraic] *= -raw.c
    return Matrices(
        path=raw.path,
        solver="mbdyn",
        deck_sha256="",
        analysis="linearise",
        c=raw.c,
        time=raw.time,
        J_plus=J_plus,
        J_minus=J_minus,
        names=names,
        kinds=kinds,
        _table=given_tables(raw.path, {}),
    )


def _name_unknowns(raw: RawEigenanalysis) -> tuple[NDArray[np.bytes_], NDArray[np.bytes_]]:
    """Return names by label and kinds, with 12 or 6 unknowns per node as the matrices themselves show."""
    n = len(raw.Aplus)
    names: list[str] = []
    kinds: list[str] = []
    for label, first in sorted(zip(raw.labels.tolist(), raw.first.tolist(), strict=True), key=lambda node: node[1]):
        if first != len(names):
            raise MatrixError(
                f"{raw.path}: node {label} starts at unknown {first}, but the nodes before it end at {len(names)}; "
                "only structural nodes with 12 (dynamic) or 6 (static) unknowns are supported"
            )
        dofs = _DYNAMIC if _is_dynamic(raw, first) else _STATIC
        if first + dofs > n:
            raise MatrixError(f"{raw.path}: node {label} needs unknowns up to {first + dofs}, the matrices have {n}")
        names += [f"node {label}.{unknown}" for unknown in _NODE_UNKNOWNS[:dofs]]
        kinds += _NODE_KINDS[:dofs]
    starts = dict(zip(raw.joint_first.tolist(), raw.joint_labels.tolist(), strict=True))
    owner, count = "joints", 0
    for k in range(len(names), n):
        if k in starts:
            owner, count = f"joint {starts[k]}", 0
        count += 1
        names.append(f"{owner}.reaction[{count}]")
        kinds.append("reaction")
    return np.array(names, dtype=np.bytes_), np.array(kinds, dtype=np.bytes_)


def _is_dynamic(raw: RawEigenanalysis, first: int) -> bool:
    """Tell whether the node's momenta follow its coordinates: d(momentum definition)/d(momentum) = -c I in J(c)."""
    block = slice(first + _STATIC, first + _DYNAMIC), slice(first, first + _STATIC)
    plus, minus = raw.Aplus[block[1], block[0]], raw.Aminus[block[1], block[0]]
    if plus.shape != (_STATIC, _STATIC):
        return False
    momenta = raw.c * np.eye(_STATIC)
    return np.allclose(plus, -momenta, rtol=1e-12, atol=0.0) and np.allclose(minus, momenta, rtol=1e-12, atol=0.0)


def _names_of_layout(raw: RawEigenanalysis, layout: Matrices) -> tuple[NDArray[np.bytes_], NDArray[np.bytes_]]:
    n = len(raw.Aplus)
    if layout.n != n:
        raise MatrixError(
            f"{raw.path} has {n} unknowns and {layout.path} has {layout.n}: they are not of the same deck"
        )
    names, kinds = _name_unknowns(raw)
    ours = layout.kinds.copy()  # as the matrices alone would have them told
    for kind, as_kind in _TOLD_AS.items():
        ours[ours == kind] = as_kind
    differing = np.flatnonzero(kinds != ours)
    if len(differing):
        k = int(differing[0])
        raise MatrixError(
            f"{raw.path}: unknown {k} is a {kinds[k].decode()} ({names[k].decode()}), "
            f"in {layout.path} it is a {layout.dof_kinds[k]} ({layout.dof_names[k]}): they are not of the same deck"
        )
    return layout.names, layout.kinds


# ---- NetCDF


def read_netcdf(path: str, analysis: int | None = None) -> RawEigenanalysis:
    """Read one eigenanalysis of an MBDyn NetCDF file, transposed to row = equation.

    MatrixError if it holds no such eigenanalysis.
    """
    variables = _netcdf_variables(path)
    found = sorted({int(match[1]) for name in variables if (match := re.fullmatch(r"eig\.(\d+)\.dCoef", name))})
    if not found:
        raise MatrixError(
            f"{path}: holds no eigenanalysis; ask for one with an `eigenanalysis` card that says "
            "`output full matrices, output geometry`"
        )
    k = found[-1] if analysis is None else analysis
    if k not in found:
        raise MatrixError(f"{path}: holds no eigenanalysis {k}; it holds {', '.join(map(str, found))}")

    def need(name: str) -> NDArray[np.float64]:
        if name not in variables:
            raise MatrixError(
                f"{path}: variable '{name}' is missing; the `eigenanalysis` card must say "
                "`output full matrices, output geometry`"
            )
        return variables[name]

    first = need("eig.idx").astype(np.int64)
    labels = need("eig.labels").astype(np.int64)
    size = 0
    matrices = []
    for name in (f"eig.{k}.Aplus", f"eig.{k}.Aminus"):
        value = need(name)
        if value.ndim != 2:
            raise MatrixError(f"{path}: variable '{name}' has shape {value.shape}; expected a matrix")
        if value.shape[0] != value.shape[1] and value.shape[1] == 3:
            size = max(size, int(value[:, :2].max(initial=0)))
        matrices.append(value)
    # Dense matrices are stored column after column in a variable declared row-major: a C reader gets the transpose.
    # Sparse ones are lists of (row, column, value), counted from 1.
    plus, minus = (_from_triplets(path, A, size) if size else A.T for A in matrices)
    return RawEigenanalysis(
        path=path,
        c=float(need(f"eig.{k}.dCoef").reshape(-1)[0]),
        time=float(need(f"eig.{k}.time").reshape(-1)[0]),
        Aplus=np.ascontiguousarray(plus),
        Aminus=np.ascontiguousarray(minus),
        labels=labels,
        first=first,
        joint_labels=variables.get("eig.joint.labels", np.zeros(0)).astype(np.int64),
        joint_first=variables.get("eig.joint.idx", np.zeros(0)).astype(np.int64),
    )


def _netcdf_variables(path: str) -> dict[str, NDArray[np.float64]]:
    """Return every variable whose name starts with `eig.`, whichever of the two NetCDF containers it is in."""
    refuse_special(path)
    with open(path, "rb") as file:
        magic = file.read(8)
    if magic[:4] in (b"CDF\x01", b"CDF\x02"):
        from scipy.io import netcdf_file

        try:
            with netcdf_file(path, "r", mmap=False) as classic:
                return {
                    name: np.array(variable.data, dtype=np.float64)
                    for name, variable in classic.variables.items()
                    if name.startswith("eig.")
                }
        except (ValueError, TypeError, IndexError, KeyError, EOFError) as error:
            raise MatrixError(f"{path}: is not a whole NetCDF file ({error})") from error
    if magic == b"\x89HDF\r\n\x1a\n":
        import h5py

        try:
            with open_to_read(path) as file4:
                return {
                    name: np.array(dataset[()], dtype=np.float64)
                    for name, dataset in file4.items()
                    if name.startswith("eig.") and isinstance(dataset, h5py.Dataset)
                }
        except OSError as error:
            raise MatrixError(f"{path}: is not a whole NetCDF file ({error})") from error
    raise MatrixError(f"{path}: is not a NetCDF file (neither classic nor HDF5-based)")


# ---- text


def read_m(path: str) -> RawEigenanalysis:
    """Read an MBDyn `.m` file: full matrices, or sparse ones followed by `spconvert`.

    FileError if it cannot be read, MatrixError if it is no such file.
    """
    refuse_special(path)
    try:
        text = Path(path).read_text(encoding="ascii")
    except (UnicodeDecodeError, OSError) as error:
        raise FileError(f"{path}: cannot be read as text ({error})") from error
    text = re.sub(r"%[^\n]*", "", text)  # comments
    first = _whole(path, "an entry of idx", _m_numbers(path, text, "idx").reshape(-1), 0, _MOST_UNKNOWNS)
    labels = _whole(path, "a label", _m_numbers(path, text, "labels").reshape(-1), 0, 2**31 - 1)
    plus, minus = _m_numbers(path, text, "Aplus"), _m_numbers(path, text, "Aminus")
    sparse = [re.search(rf"\b{name}\s*=\s*spconvert", text) is not None for name in ("Aplus", "Aminus")]
    if any(sparse):
        if not all(sparse) or plus.shape[1] != 3 or minus.shape[1] != 3:
            raise MatrixError(f"{path}: Aplus and Aminus must both be lists of (row, column, value) for spconvert")
        indices = np.concatenate((plus[:, :2].reshape(-1), minus[:, :2].reshape(-1)))
        size = int(_whole(path, "an index of a sparse matrix", indices, 1, _MOST_UNKNOWNS).max(initial=0))
        plus, minus = _from_triplets(path, plus, size), _from_triplets(path, minus, size)
    return RawEigenanalysis(
        path=path,
        c=_m_scalar(path, text, "dCoef"),
        time=_m_scalar(path, text, "dTime"),
        Aplus=plus,
        Aminus=minus,
        labels=labels,
        first=first,
    )


def _whole(path: str, what: str, values: Floats, least: int, most: int) -> NDArray[np.int64]:
    """The values as whole numbers within these limits; MatrixError if they are not."""
    wrong = ~((values >= least) & (values <= most) & (values == np.floor(values)))
    if wrong.any():
        raise MatrixError(f"{path}: {what} is {values[wrong][0]:g}, a whole number from {least} to {most} is wanted")
    return values.astype(np.int64)


def _m_scalar(path: str, text: str, name: str) -> float:
    match = re.search(rf"\b{name}\s*=\s*([^;\s]+)\s*;", text)
    try:
        return float(match[1]) if match else _missing(path, name)
    except ValueError as error:
        raise MatrixError(f"{path}: {name} = {match[1] if match else ''} is not a number") from error


def _m_numbers(path: str, text: str, name: str) -> Floats:
    """Return the bracketed matrix assigned to `name`: a row ends with a semicolon, in sparse lists with the line."""
    match = re.search(rf"\b{name}\s*=\s*(?:int32\()?\[([^\]]*)\]", text)
    body = match[1] if match else str(_missing(path, name))
    rows = [row.split() for row in body.split(";" if ";" in body else "\n") if row.strip()]
    if len({len(row) for row in rows}) > 1:
        raise MatrixError(f"{path}: the rows of {name} do not all have the same number of entries")
    try:
        return np.array(rows, dtype=np.float64)
    except ValueError as error:
        raise MatrixError(f"{path}: {name} holds something that is not a number ({error})") from error


def _missing(path: str, name: str) -> float:
    raise MatrixError(
        f"{path}: {name} is missing; the `eigenanalysis` card must say `output full matrices, output geometry`"
    )


def _from_triplets(path: str, triplets: Floats, size: int) -> Floats:
    """Return the dense matrix of (row, column, value) triplets counted from 1."""
    if triplets.ndim != 2 or triplets.shape[1] != 3:
        raise MatrixError(f"{path}: a sparse matrix must be a list of (row, column, value)")
    rows, columns = (_whole(path, "an index of a sparse matrix", triplets[:, k], 0, _MOST_UNKNOWNS) - 1 for k in (0, 1))
    if len(rows) and (min(rows.min(), columns.min()) < 0 or max(rows.max(), columns.max()) >= size):
        raise MatrixError(f"{path}: a sparse matrix has an index outside 1 to {size}")
    dense = np.zeros((size, size))
    np.add.at(dense, (rows, columns), triplets[:, 2])
    return dense
