"""Read matrices files: one linearised model, names included.

The format is docs/io_formats/matrices.md.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pilotgen.errors import MatrixError
from pilotgen.solver.datasets import (
    DECK_HASH,
    Contents,
    Places,
    read_at,
    read_file,
)
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
_GROUPS = ("nodes", "joints", "inputs", "muscles")
_NODE_NUMBERS, _MUSCLE_NUMBERS = 18, ("length", "x", "v", "activation", "force")


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


def read_matrices(path: str | os.PathLike[str], places: Places | None = None) -> Matrices:
    """Read a matrices file and check it.

    Parameters
    ----------
    path : path
        The file.
    places : Places, optional
        Where its datasets lie, as told by the solver that has just written it. Then the file is read from its bytes,
        tables of nodes, inputs and muscles are checked when they are first used, and arrays are not to be written to.

    Raises
    ------
    FileError
        The file does not exist or cannot be opened.
    MatrixError
        It is not a matrices file, is of another version, or a dataset is missing, misshapen, damaged or not finite.
    """
    name = os.fspath(path)
    contents = read_file(name) if places is None else read_at(name, places)
    matrices = _core(contents)
    if places is None:
        for group in _GROUPS:
            getattr(matrices, group)
    return matrices


def _core(file: Contents) -> Matrices:
    dofs = file.structure["dofs"]
    n = len(dofs["name"])
    if n == 0:
        raise MatrixError(f"{file.path}: table 'dofs' is empty; expected the names of the unknowns")
    c, time = file.numbers("scalars", (1, 2))[0].tolist()
    if not c > 0.0:
        raise MatrixError(f"{file.path}: the coefficient c is {c:g} s; expected a positive one")
    matrices = Matrices(
        path=file.path,
        solver=file.structure["solver"],
        deck_sha256=file.texts[DECK_HASH].decode(errors="replace"),
        analysis=file.structure["analysis"],
        c=c,
        time=time,
        J_plus=file.numbers("J_plus", (n, n)),
        J_minus=file.numbers("J_minus", (n, n)),
        names=dofs["name"],
        kinds=dofs["kind"],
        _table=_Tables(file, n),
    )
    columns = np.ascontiguousarray(file.numbers("vectors", (n, len(_VECTORS))).T)
    matrices.__dict__.update(zip(_VECTORS, columns, strict=True))
    return matrices


@dataclass(frozen=True)
class _Tables:
    """Makes a table when it is asked for."""

    file: Contents
    n: int

    def __call__(self, group: str) -> Any:
        texts = self.file.structure[group]
        k = len(texts["name"])
        if group == "nodes":
            x, R, v, w = np.split(self.file.numbers(group, (k, _NODE_NUMBERS)), (3, 12, 15), axis=1)
            return NodeTable(**texts, position=x, orientation=R.reshape(k, 3, 3), velocity=v, angular_velocity=w)
        if group == "joints":
            return JointTable(**texts)
        if group == "inputs":
            return InputTable(**texts, g_u=self.file.numbers("g_u", (self.n, k)))
        states = np.ascontiguousarray(self.file.numbers(group, (k, len(_MUSCLE_NUMBERS))).T)
        return MuscleTable(**texts, **dict(zip(_MUSCLE_NUMBERS, states, strict=True)))


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
