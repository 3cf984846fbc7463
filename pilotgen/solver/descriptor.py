"""The descriptor model g_ydot ydot + g_y y = 0 with the roles of its unknowns and equations.

What the linear models of the program start from. Unknowns are sorted by role (coordinates q, momenta p, reactions) and
each row by what it says (momentum definition, equilibrium, constraint), which is all that later steps need to take the
pencil apart exactly. Theory: docs/theory/linearisation.md.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pilotgen.errors import MatrixError

if TYPE_CHECKING:
    from collections.abc import Sequence

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Numbers = NDArray[Any]  # real or complex
Indices = NDArray[np.intp]

NODE_COORDINATES = 6  # position x y z and rotation gx gy gz of one node
_COORDINATE_KINDS = (b"position", b"rotation", b"modal_displacement")
_VELOCITY_KINDS = (b"velocity", b"angular_velocity", b"modal_velocity")  # of modal nodes and modal joints
_MOMENTUM_KINDS = (b"momentum", b"momenta_moment", *_VELOCITY_KINDS)
_REACTION_KIND = b"reaction"
# Entries that define velocities are 0 or 1 up to round-off of sums and differences of J(+-c).
_DEFINITION_TOLERANCE = 1e-9


@dataclass(frozen=True)
class DescriptorModel:
    """A linear descriptor model with named unknowns.

    Attributes
    ----------
    g_y, g_ydot : ndarray, shape (n, n)
        Partials of the residual g(t, y, ydot) with respect to the state and its rate, SI units.
    names : ndarray of bytes, shape (n,)
        Name of each unknown; row k has the name of unknown k.
    coordinates, momenta, reactions : ndarray of int
        Columns of the coordinates q (of nodes and modal joints), of the momenta p and of the joint reactions. In place
        of velocities of modal nodes and joints stand the momenta that belong to them, under their names.
    definition_rows : ndarray of int
        Row in which each momentum of `momenta` is defined (same order).
    equilibrium_rows : ndarray of int
        Force or moment equilibrium that belongs to each coordinate of `coordinates` (same order).
    """

    g_y: Floats
    g_ydot: Floats
    names: NDArray[np.bytes_]
    coordinates: Indices
    momenta: Indices
    reactions: Indices
    definition_rows: Indices
    equilibrium_rows: Indices

    @property
    def constraint_rows(self) -> Indices:
        """Rows of the joints' constraint equations: numbered like the reactions."""
        return self.reactions

    def name(self, k: int) -> str:
        """Return the name of unknown (and row) `k`."""
        return bytes(self.names[k]).decode()

    def index(self, name: str) -> int:
        """Return the column of the unknown called `name`; MatrixError if there is none or more than one."""
        found = np.flatnonzero(self.names == name.encode())
        if len(found) != 1:
            many = "is not" if len(found) == 0 else "is more than once"
            raise MatrixError(f"unknown '{name}' {many} among the model's unknowns ({_sample(self.names)})")
        return int(found[0])

    def owned_by(self, owner: str) -> Indices:
        """Return the columns of the node or joint called `owner`, empty if it has none."""
        return np.flatnonzero(np.char.startswith(self.names, owner.encode() + b"."))

    def restrict(self, keep: Indices) -> DescriptorModel:
        """Return the model of the unknowns and rows `keep` (ascending): nodes and joints whole or not at all."""
        position = np.full(len(self.names), -1, dtype=np.intp)
        position[keep] = np.arange(len(keep))
        new_momenta = position[self.momenta]
        new_coordinates = position[self.coordinates]
        new_reactions = position[self.reactions]
        kept_momenta, kept_coordinates = new_momenta >= 0, new_coordinates >= 0
        return DescriptorModel(
            g_y=block(self.g_y, keep, keep),
            g_ydot=block(self.g_ydot, keep, keep),
            names=self.names[keep],
            coordinates=new_coordinates[kept_coordinates],
            momenta=new_momenta[kept_momenta],
            reactions=new_reactions[new_reactions >= 0],
            definition_rows=position[self.definition_rows[kept_momenta]],
            equilibrium_rows=position[self.equilibrium_rows[kept_coordinates]],
        )


def block(matrix: Floats, rows: Indices, columns: Indices) -> Floats:
    """Return matrix[rows][:, columns]; three times as fast as indexing with both at once.

    `matrix` has shape (m, n), `rows` shape (r,), `columns` shape (c,), the result shape (r, c).
    """
    return matrix.take(rows, axis=0).take(columns, axis=1)


def make_descriptor(
    J_plus: Floats, J_minus: Floats, c: float, names: NDArray[np.bytes_], kinds: NDArray[np.bytes_]
) -> DescriptorModel:
    """Recover g_ydot and g_y from the matrix pair J(c), J(-c): paper eq. (15).

    Parameters
    ----------
    J_plus, J_minus : ndarray, shape (n, n)
        J(c) = g_ydot + c g_y and J(-c) = g_ydot - c g_y.
    c : float
        Coefficient of the matrix pair [s].
    names, kinds : ndarray of bytes, shape (n,)
        Name and kind (docs/io_formats/matrices.md) of each unknown.

    Raises
    ------
    MatrixError
        If a kind is not known, the momenta do not stand six places after the coordinates of their node, or velocities
        are not defined by the rates of their coordinates.
    """
    g_ydot = J_plus + J_minus
    g_ydot *= 0.5
    g_y = J_plus - J_minus
    g_y /= 2.0 * c
    *roles, velocities = _roles(kinds.tobytes(), kinds.dtype.str, names.tobytes(), names.dtype.str)
    if len(velocities):
        _velocities_to_momenta(g_y, g_ydot, velocities, roles)
    return DescriptorModel(g_y, g_ydot, names, *roles)


def _velocities_to_momenta(g_y: Floats, g_ydot: Floats, u: Indices, roles: Sequence[Indices]) -> None:
    """Replace velocities u by momenta p = N u, in place; N is the part of the equilibrium equations by du/dt.

    u is defined by q' + G q - u = 0 with its own coordinates q. Everywhere else u is what this says; its definition
    becomes N (q' + G q) - p = 0, and N u' in the equilibrium equations p'. N may be singular: nothing else needs u.
    """
    coordinates, momenta, _, definitions, equilibria = roles
    own = definitions[np.searchsorted(momenta, u)]  # columns of the coordinates, and rows that define u
    rows = equilibria[np.searchsorted(coordinates, own)]
    rates = np.zeros_like(g_ydot[own])
    rates[np.arange(len(u)), own] = 1.0
    wanted = np.zeros((len(u), len(u)))
    np.fill_diagonal(wanted, -1.0)
    elsewhere = np.delete(g_ydot[:, u], rows, axis=0)
    defined = (
        np.abs(g_ydot[own] - rates).max(),
        np.abs(block(g_y, own, u) - wanted).max(),
        np.abs(elsewhere).max(initial=0.0),
    )
    if max(defined) > _DEFINITION_TOLERANCE:
        raise MatrixError(
            "velocities of modal nodes or joints are not the rates of their coordinates in these matrices"
        )
    N = block(g_ydot, rows, u)
    turning = g_y[own]  # G
    turning[:, u] = 0.0
    by_u = g_y[:, u]
    by_u[own] = 0.0
    g_y[:, u] = 0.0
    g_y += by_u @ turning
    g_ydot[:, own] += by_u
    g_y[own] = N @ turning
    g_ydot[np.ix_(own, own)] = N
    g_y[own, u] = -1.0
    g_ydot[np.ix_(rows, u)] = np.eye(len(u))


@lru_cache(maxsize=8)  # the pilots of a study differ in their numbers only
def _roles(kind_bytes: bytes, kind_type: str, name_bytes: bytes, name_type: str) -> tuple[Indices, ...]:
    """Return coordinates, momenta, reactions, definition rows, equilibrium rows, velocities among the momenta."""
    kinds, names = np.frombuffer(kind_bytes, kind_type), np.frombuffer(name_bytes, name_type)
    is_coordinate, is_momentum = np.isin(kinds, _COORDINATE_KINDS), np.isin(kinds, _MOMENTUM_KINDS)
    is_reaction = kinds == _REACTION_KIND
    strange = np.flatnonzero(~(is_coordinate | is_momentum | is_reaction))
    if len(strange):
        k = int(strange[0])
        raise MatrixError(
            f"unknown '{bytes(names[k]).decode()}' is of kind '{bytes(kinds[k]).decode()}'; "
            f"expected {', '.join(kind.decode() for kind in (*_COORDINATE_KINDS, *_MOMENTUM_KINDS, _REACTION_KIND))}"
        )

    coordinates = np.flatnonzero(is_coordinate)
    momenta = np.flatnonzero(is_momentum)
    definition_rows = momenta - NODE_COORDINATES
    modal = kinds[momenta] == b"modal_velocity"
    displacements = np.flatnonzero(kinds == b"modal_displacement")
    if modal.sum() != len(displacements):
        raise MatrixError(
            f"{len(displacements)} modal displacements and {modal.sum()} modal velocities are among the unknowns; "
            "as many of each are expected"
        )
    definition_rows[modal] = displacements
    if len(momenta) and (definition_rows[0] < 0 or not is_coordinate[definition_rows].all()):
        raise MatrixError(
            "the momenta of a node must follow its six coordinates (x y z gx gy gz bx by bz hx hy hz); "
            f"they do not among {_sample(names)}"
        )
    balance = np.arange(len(names))  # of each coordinate: its own row, or that of its momentum
    balance[definition_rows] = momenta
    equilibrium_rows = balance[coordinates]
    velocities = momenta[np.isin(kinds[momenta], _VELOCITY_KINDS)]
    roles = (coordinates, momenta, np.flatnonzero(is_reaction), definition_rows, equilibrium_rows, velocities)
    for indices in roles:
        indices.flags.writeable = False  # many models share them
    return roles


def _sample(names: Sequence[bytes] | NDArray[np.bytes_]) -> str:
    """Return the first and last few names, for messages."""
    text = [bytes(name).decode() for name in names]
    return ", ".join(text) if len(text) <= 8 else f"{', '.join(text[:4])}, ..., {', '.join(text[-3:])}"
