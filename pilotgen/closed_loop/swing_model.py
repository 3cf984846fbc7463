"""What a balance of harmonics knows of a closed loop whatever the lever's friction: the nonlinear deck, and its slopes.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from pilotgen.closed_loop.deck import STOP_STIFFNESS_N_PER_M, ClosedLoop
from pilotgen.closed_loop.elements import GripStops, MuscleLaw
from pilotgen.closed_loop.muscles import muscle_data, muscle_rows
from pilotgen.closed_loop.poles import eigenvalues
from pilotgen.closed_loop.residuals import DeckResiduals
from pilotgen.context import EvaluationContext
from pilotgen.errors import EvaluationError
from pilotgen.solver.descriptor import Complexes, Floats
from pilotgen.solver.matrices import Matrices, descriptor

LOCK_N_PER_M = 1e3  # estimated: a spring at the grip in the preconditioner alone, which moves its poles out of the way


class SwingModel:
    """A closed loop's deck without friction: residuals along motions, matrices, channels.

    `lock` is a spring at the grip as g_y has it, with its sign turned, shape (n, n).
    Channel 0 is the grip (force [N], travel [m]), the others are muscles (tension [N], relative length).

    Parameters
    ----------
    context, loop
        Whose solver works, as long as this is used; the loop.
    clipped, stops : bool
        Whether activations end at 0 and 1, and whether the lever has stops.
    """

    def __init__(self, context: EvaluationContext, loop: ClosedLoop, clipped: bool = True, stops: bool = True) -> None:
        self.loop = loop
        self.matrices = loop.linearise(context, loop.deck(), Path(context.scratch))
        m = self.matrices
        self.g_ydot = 0.5 * (m.J_plus + m.J_minus)
        self.g_y = (m.J_plus - m.J_minus) / (2.0 * m.c)
        self.B, self.C = channels(loop, m)
        self.lock = np.outer(LOCK_N_PER_M * self.B[:, 0], self.C[0])
        self.lever, self.lever_length_m = m.dof_names.index("lever.gz"), loop.lever_length_m
        self.deck = DeckResiduals(context, loop.deck(stops=stops, activation_check=clipped), m.n)
        self.muscles = MuscleLaw(
            muscle_data(loop.pilot), loop.gains.proportional_gain, loop.gains.derivative_gain, clipped
        )
        self.stops = GripStops(*loop.travel_to_stops_m(), STOP_STIFFNESS_N_PER_M) if stops else None

    @cached_property
    def poles(self) -> Complexes:
        """Of the linear closed deck [rad/s], shape (k,)."""
        return eigenvalues(self.matrices)

    @cached_property
    def kind_of_unknown(self) -> np.ndarray:
        """A number for each kind of unknown, shape (n,)."""
        return np.unique(self.matrices.kinds, return_inverse=True)[1]

    def travel_m(self, g: Floats) -> Floats:
        """The grip's travel along its arc by the lever's rotation parameter, any shape."""
        return np.asarray(2.0 * self.lever_length_m * np.arctan(0.5 * g))

    def least_damped(self) -> tuple[complex, Complexes]:
        """Pole and shape of the least damped oscillation between 1 and 10 Hz that moves the grip; shape (n,), grip 1 m.

        Raises
        ------
        EvaluationError
            There is none.
        """
        lam = self.poles
        lam = lam[(lam.imag > 2.0 * math.pi) & (lam.imag < 20.0 * math.pi)]
        best: tuple[float, complex, Complexes] | None = None
        for pole in lam.tolist():
            off = 1e-5 * abs(pole)  # so near, the motion by a force at the grip is that of the mode
            motion = np.linalg.solve((pole + off) * self.g_ydot + self.g_y, self.B[:, 0].astype(complex))
            travel = self.C[0] @ motion
            seen = abs(travel * off) / max(abs(pole.real), 0.3)
            if best is None or seen > best[0]:
                best = seen, pole, motion / travel
        if best is None:
            raise EvaluationError("harmonic balance", "the closed loop has no oscillation between 1 and 10 Hz")
        return best[1:]


class LinearDeck:
    """Matrices of a linear deck where they are not zero, with a spring at the grip.

    Parameters
    ----------
    g_y, g_ydot : ndarray, shape (n, n)
        They need not be those of the posture.
    model : SwingModel
        Whose channels act.
    """

    def __init__(self, g_y: Floats, g_ydot: Floats, model: SwingModel) -> None:
        stiff = g_y - model.lock
        columns, self._rows = np.nonzero((stiff.T != 0.0) | (g_ydot.T != 0.0))  # column by column
        self._starts = np.searchsorted(columns, np.arange(len(g_y) + 1)).astype(np.intc)
        self._stiff, self._damp = stiff[self._rows, columns], g_ydot[self._rows, columns]
        self.model = model
        self.g_ydot = self._matrix(self._damp)

    def _matrix(self, numbers: np.ndarray) -> scipy.sparse.csc_matrix:
        n = len(self._starts) - 1
        return scipy.sparse.csc_matrix((numbers, self._rows.astype(np.intc), self._starts), shape=(n, n))

    def at(self, s: complex) -> Locked:
        """Factorised at one s [rad/s]; of a real one everything is real."""
        return Locked(self._matrix(self._stiff + (s if s.imag else s.real) * self._damp), self.model)


class Locked:
    """A linear deck at one s with a spring at the grip, factorised.

    Attributes
    ----------
    forced : ndarray, shape (n, channels)
        Motions by forces.
    receptances : ndarray, shape (channels, channels)
        The channels' own.
    """

    def __init__(self, matrix: scipy.sparse.csc_matrix, model: SwingModel) -> None:
        self._type = matrix.dtype
        try:
            self._factors = scipy.sparse.linalg.splu(matrix)
        except RuntimeError:
            raise EvaluationError("harmonic balance", "the linear deck is singular along this swing") from None
        self.forced = self.solve(model.B)
        self.receptances = model.C @ self.forced

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Motions, shape of `right` (n, ...), a vector or columns."""
        if self._type.kind == "f" and np.iscomplexobj(right):
            right = right.real
        return np.asarray(self._factors.solve(right.astype(self._type)))


def channels(loop: ClosedLoop, matrices: Matrices) -> tuple[Floats, Floats]:
    """Columns of forces and rows of motions in a deck's unknowns, shapes (n, channels), (channels, n).

    A positive force of a channel makes its motion smaller: friction against the grip, tension of a muscle.
    """
    own = loop.pilot.matrices
    assert own is not None
    place = {name: i for i, name in enumerate(matrices.dof_names)}
    to_deck = np.array([place.get(name, -1) for name in own.dof_names])
    data, rows = muscle_data(loop.pilot), muscle_rows(loop.pilot)
    model = descriptor(own)
    count = len(rows) + 1
    B, C = np.zeros((matrices.n, count)), np.zeros((count, matrices.n))
    C[0, place["lever.gz"]] = loop.lever_length_m
    B[place["lever.hz"], 0] = loop.lever_length_m
    C[1:, to_deck[model.coordinates]] = rows[:, model.coordinates]
    B[to_deck[model.equilibrium_rows], 1:] = (rows[:, model.coordinates] * data.l0_m[:, None]).T
    return -B, C
