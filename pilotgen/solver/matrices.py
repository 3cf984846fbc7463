"""Read and write matrices files: one linearised model, names included.

The format is docs/io_formats/matrices.md. A search reads thousands of these files. With `complete=False` only what
every reader needs is read at once (the matrix pair and the names of the unknowns); the state and the columns of the
tables of nodes, joints, inputs and muscles follow when they are first asked for.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from pilotgen.errors import MatrixError
from pilotgen.solver.datasets import FILETYPE, VERSION, Source, open_source
from pilotgen.solver.descriptor import DescriptorModel, Floats, make_descriptor

Names = NDArray[np.bytes_]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class NodeTable:
    """The k nodes in deck order: first unknown (from 0), number of unknowns, pose and velocity in global axes."""

    name: Names
    label: Integers
    first: Integers
    dofs: Integers
    position: Floats  # (k, 3) m
    orientation: Floats  # (k, 3, 3), columns are the node's axes
    velocity: Floats  # (k, 3) m/s
    angular_velocity: Floats  # (k, 3) rad/s


@dataclass(frozen=True)
class JointTable:
    """The joints that have unknowns of their own, in deck order."""

    name: Names
    label: Integers
    type: Names
    first: Integers
    dofs: Integers


@dataclass(frozen=True)
class InputTable:
    """The m inputs, `activation[...]` and `drive[...]`, and g_u, shape (n, m): derivative of the residual by each."""

    name: Names
    unit: Names
    g_u: Floats


@dataclass(frozen=True)
class MuscleTable:
    """The q muscles: length [m], x and v (relative to reference length and velocity), activation, force [N]."""

    name: Names
    label: Integers
    length: Floats
    x: Floats
    v: Floats
    activation: Floats
    force: Floats


_VECTORS = ("y", "ydot", "residual", "equilibrium_residual")
# dataset -> shape; None stands for the number of unknowns n, "k" for the length of the table's first column
_TABLES: dict[str, tuple[type, dict[str, tuple[object, ...]]]] = {
    "nodes": (
        NodeTable,
        {"name": ("k",), "label": ("k",), "first": ("k",), "dofs": ("k",), "position": ("k", 3),
         "orientation": ("k", 3, 3), "velocity": ("k", 3), "angular_velocity": ("k", 3)},
    ),
    "joints": (JointTable, {"name": ("k",), "label": ("k",), "type": ("k",), "first": ("k",), "dofs": ("k",)}),
    "inputs": (InputTable, {"name": ("k",), "unit": ("k",), "g_u": (None, "k")}),
    "muscles": (
        MuscleTable,
        {"name": ("k",), "label": ("k",), "length": ("k",), "x": ("k",), "v": ("k",), "activation": ("k",),
         "force": ("k",)},
    ),
}  # fmt: skip
_DATASETS = (
    *("J_plus", "J_minus", "c", "time", "dofs/name", "dofs/kind", *_VECTORS),
    *(f"{group}/{name}" for group, (_, shapes) in _TABLES.items() for name in shapes),
)


@dataclass(frozen=True)
class Matrices:
    """One linearised model as a solver wrote it.

    Attributes
    ----------
    path : str
        Where it came from, for messages.
    solver, deck_sha256, analysis : str
        Program that wrote it, hash of the deck, `linearise` or `static`.
    c : float
        Coefficient of the matrix pair [s].
    time : float
        Time of the analysis [s].
    J_plus, J_minus : ndarray, shape (n, n)
        J(c) = g_ydot + c g_y, J(-c) = g_ydot - c g_y (textbook pair, constraints and reactions unscaled).
    names, kinds : ndarray of bytes, shape (n,)
        Name and kind of each unknown; row k has the name of unknown k.
    """

    path: str
    solver: str
    deck_sha256: str
    analysis: str
    c: float
    time: float
    J_plus: Floats
    J_minus: Floats
    names: Names
    kinds: Names
    _table: Callable[[str], Any] = field(repr=False, compare=False)

    @property
    def n(self) -> int:
        """Number of unknowns."""
        return len(self.names)

    @cached_property
    def dof_names(self) -> tuple[str, ...]:
        """Names of the unknowns as text."""
        return tuple(bytes(name).decode() for name in self.names)

    @cached_property
    def dof_kinds(self) -> tuple[str, ...]:
        """Kinds of the unknowns as text."""
        return tuple(bytes(kind).decode() for kind in self.kinds)

    @cached_property
    def nodes(self) -> NodeTable:
        """Nodes in deck order."""
        return self._get("nodes")  # type: ignore[no-any-return]

    @cached_property
    def joints(self) -> JointTable:
        """Joints that have unknowns, in deck order."""
        return self._get("joints")  # type: ignore[no-any-return]

    @cached_property
    def inputs(self) -> InputTable:
        """Inputs and g_u."""
        return self._get("inputs")  # type: ignore[no-any-return]

    @cached_property
    def muscles(self) -> MuscleTable:
        """Muscles in deck order."""
        return self._get("muscles")  # type: ignore[no-any-return]

    @cached_property
    def y(self) -> Floats:
        """State, shape (n,)."""
        return self._get("y")  # type: ignore[no-any-return]

    @cached_property
    def ydot(self) -> Floats:
        """Rate of the state, shape (n,)."""
        return self._get("ydot")  # type: ignore[no-any-return]

    @cached_property
    def residual(self) -> Floats:
        """Residual without accelerations, momenta rates and reactions, shape (n,) [N, N m, m, rad]."""
        return self._get("residual")  # type: ignore[no-any-return]

    @cached_property
    def equilibrium_residual(self) -> Floats:
        """Residual with the reactions of the state, shape (n,): zero at a static equilibrium [N, N m, m, rad]."""
        return self._get("equilibrium_residual")  # type: ignore[no-any-return]

    @property
    def muscle_lengths(self) -> Floats:
        """Lengths of the muscles in deck order, shape (q,) [m]."""
        return self.muscles.length

    def _get(self, group: str) -> Any:
        return self._table(group)


def descriptor(matrices: Matrices) -> DescriptorModel:
    """Return g_y, g_ydot and the roles of the unknowns (paper eq. (15)); MatrixError names the file."""
    try:
        return make_descriptor(matrices.J_plus, matrices.J_minus, matrices.c, matrices.names, matrices.kinds)
    except MatrixError as error:
        raise MatrixError(f"{matrices.path}: {error}") from error


# ---- reading


def read_matrices(path: str | os.PathLike[str], complete: bool = True) -> Matrices:
    """Read a matrices file and check it.

    Parameters
    ----------
    path : path
        The file.
    complete : bool
        Read and check every table now. With False columns are read when first used, from the file as it is now, and
        arrays are not to be written to.

    Raises
    ------
    FileError
        The file does not exist or cannot be opened.
    MatrixError
        It is not a matrices file, is of another version, or a dataset is missing, misshapen or not finite.
    """
    source = open_source(os.fspath(path), () if complete else _DATASETS)
    try:
        matrices = _core(source)
        if complete:
            for group in (*_VECTORS, *_TABLES):
                matrices.__dict__[group] = _read_table(source, group, matrices.n)
    except BaseException:
        source.close()
        raise
    if complete:
        source.close()
    return matrices


def _core(source: Source) -> Matrices:
    J_plus = source.read("J_plus")
    if J_plus.ndim != 2 or J_plus.shape[0] != J_plus.shape[1] or J_plus.shape[0] == 0:
        raise MatrixError(f"{source.path}: dataset 'J_plus' has shape {J_plus.shape}; expected a square matrix")
    n = J_plus.shape[0]
    matrices = Matrices(
        path=source.path,
        solver=source.attribute("solver"),
        deck_sha256=source.attribute("deck_sha256"),
        analysis=source.attribute("analysis"),
        c=float(_shaped(source, "c", ())),
        time=float(_shaped(source, "time", ())),
        J_plus=J_plus,
        J_minus=_shaped(source, "J_minus", (n, n)),
        names=_shaped(source, "dofs/name", (n,)),
        kinds=_shaped(source, "dofs/kind", (n,)),
        _table=_SourceTables(source, n),
    )
    if not matrices.c > 0.0:
        raise MatrixError(f"{source.path}: dataset 'c' is {matrices.c:g} s; expected a positive coefficient")
    return matrices


@dataclass(frozen=True)
class _SourceTables:
    """Reads a vector or table when it is asked for."""

    source: Source
    n: int

    def __call__(self, group: str) -> Any:
        if group in _VECTORS:
            return _read_table(self.source, group, self.n)
        return _LazyTable(self.source, group, self.n)


class _LazyTable:
    """Stands for a table (`NodeTable`, ...): a column is read and checked when it is first used."""

    def __init__(self, source: Source, group: str, n: int) -> None:
        self._source, self._group, self._n = source, group, n
        self._length: int | None = None

    def __getattr__(self, name: str) -> Any:
        shapes = _TABLES[self._group][1]
        if name not in shapes:
            raise AttributeError(f"table '{self._group}' has no column '{name}'")
        value, self._length = _read_column(self._source, self._group, name, self._n, self._length)
        self.__dict__[name] = value
        return value


def _shaped(source: Source, name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    value = source.read(name)
    if value.shape != shape:
        raise MatrixError(f"{source.path}: dataset '{name}' has shape {value.shape}; expected {shape}")
    return value


def _read_table(source: Source, group: str, n: int) -> Any:
    if group in _VECTORS:
        return _shaped(source, group, (n,))
    table, shapes = _TABLES[group]
    length: int | None = None
    columns: dict[str, NDArray[Any]] = {}
    for name in shapes:
        columns[name], length = _read_column(source, group, name, n, length)
    return table(**columns)


def _read_column(source: Source, group: str, name: str, n: int, length: int | None) -> tuple[NDArray[Any], int]:
    """Return a column and the table's length, which the first column that is read (`length` None) decides."""
    value = source.read(f"{group}/{name}")
    symbolic = _TABLES[group][1][name]
    if length is None:
        place = symbolic.index("k")
        length = value.shape[place] if value.ndim > place else 0
    shape = tuple(n if size is None else length if size == "k" else size for size in symbolic)
    if value.shape != shape:
        raise MatrixError(f"{source.path}: dataset '{group}/{name}' has shape {value.shape}; expected {shape}")
    return value, length


# ---- writing


def write_matrices(
    path: str | os.PathLike[str], matrices: Matrices, owners: Integers | None = None, units: Names | None = None
) -> None:
    """Write a complete matrices file (the solver's own writer is in C++; this one serves conversions and tests).

    Parameters
    ----------
    path : path
        File to write, replaced if it exists.
    matrices : Matrices
        What to write, with all its tables.
    owners, units : ndarray, shape (n,), optional
        Label of the owner and unit of each unknown; without them 0 and the unit that the kind implies
        (`N` for reactions).
    """
    by_kind = {b"position": b"m", b"rotation": b"rad", b"momentum": b"kg m/s", b"momenta_moment": b"kg m^2/s"}
    with h5py.File(path, "w") as file:
        file.attrs["filetype"] = np.bytes_(FILETYPE)
        file.attrs["version"] = np.array(VERSION, dtype=np.int32)
        for name in ("solver", "deck_sha256", "analysis"):
            file.attrs[name] = np.bytes_(getattr(matrices, name))
        for name in ("c", "time", "J_plus", "J_minus"):
            file[name] = getattr(matrices, name)
        file["dofs/name"] = matrices.names
        file["dofs/kind"] = matrices.kinds
        file["dofs/owner"] = np.zeros(matrices.n, dtype=np.int64) if owners is None else owners
        implied = np.array([by_kind.get(bytes(kind), b"N") for kind in matrices.kinds])
        file["dofs/unit"] = implied if units is None else units
        for name in _VECTORS:
            file[name] = getattr(matrices, name)
        for group, (_, shapes) in _TABLES.items():
            table = getattr(matrices, group)
            for name in shapes:
                file[f"{group}/{name}"] = getattr(table, name)


def given_tables(path: str, tables: dict[str, Any]) -> Callable[[str], Any]:
    """Return a source of vectors and tables for a `Matrices` made in memory; one that is missing is a MatrixError."""
    return _GivenTables(path, tables)


@dataclass(frozen=True)
class _GivenTables:
    path: str
    tables: dict[str, Any]

    def __call__(self, group: str) -> Any:
        if group not in self.tables:
            raise MatrixError(f"{self.path}: holds no '{group}'; read a matrices file written by mbdae instead")
        return self.tables[group]
