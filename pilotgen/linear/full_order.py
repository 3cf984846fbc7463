"""The response of the whole model at one frequency after the other: what the modes are certified against.

Nothing of the modal route is used. Constraints and reactions are eliminated by LU with pivoting, the motion of some
coordinates told by that of the others; the modes rest on orthonormal null spaces by QR. What is left is solved anew at
every frequency; the modes are eigenvectors. In common are the matrices, the split into free and imposed unknowns and
the elimination of the momenta by their definitions.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import lapack

from pilotgen.errors import EvaluationError
from pilotgen.linear.imposed_motion import ImposedMotion
from pilotgen.linear.null_space import independent_constraints
from pilotgen.solver.descriptor import Complexes, Floats

# Pivots of constraints this small against the largest come from constraints that depend on others.
_DEPENDENT = 1e-10


def full_order_response(imposed: ImposedMotion, omega: ArrayLike, output: int = 0, input: int = 0) -> Complexes:
    """Return -C~ (jw g_ydot^FF + g_y^FF)^-1 (jw g_ydot^FI + g_y^FI) / (jw)^2 of one output by one acceleration.

    EvaluationError if the matrix is singular at a frequency.

    Parameters
    ----------
    imposed : ImposedMotion
        The free part, driven by motions of the seat.
    omega : array_like, shape (m,)
        Angular frequencies [rad/s].
    output, input : int
        They count as in `imposed.outputs` and `imposed.inputs`.
    """
    form, free = imposed.form, imposed.free
    M, C, K = form.M, form.C, form.K
    rigid = imposed.rigid[:, input]
    # motion relative to the cockpit: its forces are small, those of the whole motion a difference of large ones
    forces = np.stack(
        (
            imposed.M_imposed[:, input] + M @ rigid,
            imposed.C_imposed[:, input] + C @ rigid,
            imposed.K_imposed[:, input] + K @ rigid,
        ),
        axis=1,
    )
    phi_0 = imposed.g_y_imposed[free.constraint_rows, input] + form.Phi_0 @ rigid
    phi_1 = imposed.g_ydot_imposed[free.constraint_rows, input] + form.Phi_1 @ rigid
    watched = len(imposed.output_matrix)
    moment = imposed.moment_rows[output - watched] if output >= watched else None
    weights = imposed.output_matrix[output, free.coordinates] if moment is None else np.zeros(len(M))
    along = 0.0 if moment is not None else float(weights @ rigid) + float(imposed.output_imposed[output, input])

    # q = T z + fixed closes the constraints between coordinates; those of rates stay equations
    by_rate = (form.Phi_1 != 0.0).any(axis=1) | (phi_1 != 0.0)
    T, fixed = _motion_left(form.Phi_0[~by_rate], -phi_0[~by_rate])
    # W^T B = 0: equations without reactions
    W, _ = _motion_left(form.B.T, np.zeros(form.B.shape[1]))
    rates = np.flatnonzero(by_rate)
    rates = rates[independent_constraints((form.Phi_0[rates] + form.Phi_1[rates]) @ T)]

    def equations(of_equilibrium: Floats, of_rates: Floats) -> Floats:
        found: Floats = W.T @ of_equilibrium
        return np.concatenate((found, of_rates[rates])) if len(rates) else found

    s = 1j * np.asarray(omega, dtype=float).reshape(-1)
    s1, s2 = s[:, None], (s * s)[:, None]
    pencil = (
        s2[:, :, None] * equations(M @ T, 0.0 * form.Phi_1 @ T)
        + s1[:, :, None] * equations(C @ T, form.Phi_1 @ T)
        + equations(K @ T, form.Phi_0 @ T)
    )
    driven = (
        s2 * equations(forces[:, 0] + M @ fixed, 0.0 * phi_0)
        + s1 * equations(forces[:, 1] + C @ fixed, phi_1 + form.Phi_1 @ fixed)
        + equations(forces[:, 2] + K @ fixed, phi_0 + form.Phi_0 @ fixed)
    )
    try:
        z = np.linalg.solve(pencil, -driven[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError as error:
        raise EvaluationError("feedthrough", "the full-order model is singular at one of the frequencies") from error
    if moment is not None:  # of the hand: what the equation of the control's rotation lacks to be in equilibrium
        q = z @ T.T + fixed
        parts = [q @ (moment @ matrix) + moment @ forces[:, k] for k, matrix in enumerate((M, C, K))]
        return np.asarray((s * s * parts[0] + s * parts[1] + parts[2]) / (s * s))
    response: Complexes = (z @ (weights @ T) + (float(weights @ fixed) + along)) / (s * s)
    return response


def _motion_left(G: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Return T, shape (n, n - rank), and q, shape (n,), such that G (T z + q) = b for every z.

    P^T L U = G^T with rows pivoted: the coordinates that come first follow the others, -L1^-T L2^T z, and no entry of L
    is above 1. `G` has shape (r, n); of dependent rows an independent set is taken, which says the same.
    """
    r, n = G.shape
    if r == 0:
        return np.eye(n), np.zeros(n)
    lu, swaps, _ = lapack.dgetrf(G.T)
    pivots = np.abs(lu.diagonal())
    if r > n or pivots.min() <= _DEPENDENT * pivots.max():
        rows = independent_constraints(G)
        if len(rows) == r:
            raise EvaluationError("feedthrough", "the constraints of the full-order model cannot be eliminated")
        return _motion_left(G[rows], b[rows])
    order = np.arange(n)
    for i, j in enumerate(swaps):
        order[i], order[j] = order[j], order[i]
    first, rest = order[:r], order[r:]
    T, q = np.zeros((n, n - r)), np.zeros(n)
    if r < n:
        # unit lower triangle: the solver looks at nothing above the diagonal
        T[first] = -lapack.dtrtrs(lu[:r], lu[r:].T, lower=1, trans=1, unitdiag=1)[0]
        T[rest, np.arange(n - r)] = 1.0
    if b.any():
        q[first] = lapack.dtrtrs(lu[:r], lapack.dtrtrs(lu[:r], b, trans=1)[0], lower=1, trans=1, unitdiag=1)[0]
    return T, q
