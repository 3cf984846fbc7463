"""The model without its momenta: M q'' + C q' + K q + B reactions = 0 under its constraints.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pilotgen.errors import MatrixError
from pilotgen.solver.descriptor import DescriptorModel, Floats, Indices, block

# Entries that the form of the equations of motion demands to be 0 or 1 come from sums and differences of J(+-c): exact
# in our files, good to about eps * max|J| / c in MBDyn's.
FORM_TOLERANCE = 1e-9


@dataclass(frozen=True)
class SecondOrderForm:
    """The model without its momenta: M q'' + C q' + K q + B reactions = 0, Phi_1 q' + Phi_0 q = 0.

    Attributes
    ----------
    M, C, K : ndarray, shape (n_q, n_q)
        Mass, damping and stiffness by coordinates.
    B : ndarray, shape (n_q, n_r)
        How reactions enter the equilibrium equations.
    Phi_0, Phi_1 : ndarray, shape (n_r, n_q)
        Constraint equations; Phi_1 is zero for holonomic ones.
    momentum_mass, momentum_gyro : ndarray, shape (n_p, n_q)
        p = momentum_mass q' + momentum_gyro q.
    momentum_force : ndarray, shape (n_q, n_p)
        Partial of the equilibrium equations by momenta (zero at rest).
    dynamic : ndarray of int, shape (n_p,)
        Coordinate that each momentum belongs to.
    """

    M: Floats
    C: Floats
    K: Floats
    B: Floats
    Phi_0: Floats
    Phi_1: Floats
    momentum_mass: Floats
    momentum_gyro: Floats
    momentum_force: Floats
    dynamic: Indices


def second_order_form(model: DescriptorModel) -> SecondOrderForm:
    """Eliminate the momenta exactly; MatrixError if the pencil is not of the form of docs/theory/linearisation.md."""
    g_y, g_ydot = model.g_y, model.g_ydot
    q, p, reactions = model.coordinates, model.momenta, model.reactions
    definition, equilibrium = model.definition_rows, model.equilibrium_rows
    n_q, n_p = len(q), len(p)
    dynamic = np.searchsorted(q, definition)

    # rows: equilibrium, momentum definitions, constraints; columns: coordinates, momenta, reactions
    rows, columns = np.concatenate((equilibrium, definition, reactions)), np.concatenate((q, p, reactions))
    by_y, by_ydot = block(g_y, rows, columns), block(g_ydot, rows, columns)
    wanted_y, wanted_ydot = np.zeros_like(by_y[n_q:, n_q:]), np.zeros_like(by_ydot[:, n_q:])
    wanted_y[np.arange(n_p), np.arange(n_p)] = -1.0
    wanted_ydot[dynamic, np.arange(n_p)] = 1.0  # a force is the rate of a momentum
    _check_form(by_y[n_q:, n_q:] - wanted_y, by_ydot[:, n_q:] - wanted_ydot, n_q, n_p)

    momentum_mass, momentum_gyro = by_ydot[n_q : n_q + n_p, :n_q], by_y[n_q : n_q + n_p, :n_q]
    momentum_force = by_y[:n_q, n_q : n_q + n_p]
    M, C, K = np.zeros((n_q, n_q)), by_ydot[:n_q, :n_q].copy(), by_y[:n_q, :n_q]
    M[dynamic] = momentum_mass
    C[dynamic] += momentum_gyro
    if momentum_force.any():
        C += momentum_force @ momentum_mass
        K = K + momentum_force @ momentum_gyro
    return SecondOrderForm(
        M=M,
        C=C,
        K=K,
        B=by_y[:n_q, n_q + n_p :],
        Phi_0=by_y[n_q + n_p :, :n_q],
        Phi_1=by_ydot[n_q + n_p :, :n_q],
        momentum_mass=momentum_mass,
        momentum_gyro=momentum_gyro,
        momentum_force=momentum_force,
        dynamic=dynamic,
    )


def _check_form(y: Floats, ydot: Floats, n_q: int, n_p: int) -> None:
    """Check what g_y (without equilibrium rows) and g_ydot have too much by momenta and reactions: nothing."""
    if max(np.abs(y).max(initial=0.0), np.abs(ydot).max(initial=0.0)) <= FORM_TOLERANCE:
        return
    equilibrium, definition, constraints = slice(n_q), slice(n_q, n_q + n_p), slice(n_q + n_p, None)
    for part, what in (
        (y[:n_p, :n_p], "momenta in their definitions"),
        (ydot[definition, :n_p], "momenta rates in the momentum definitions"),
        (ydot[equilibrium, :n_p], "momenta rates in the equilibrium equations"),
        (y[n_p:, :n_p], "momenta in the constraints"),
        (ydot[constraints, :n_p], "momenta rates in the constraints"),
        (ydot[:, n_p:], "rates of reactions"),
        (y[n_p:, n_p:], "reactions in the constraints"),
        (y[:n_p, n_p:], "reactions in the momentum definitions"),
    ):
        worst = np.abs(part).max(initial=0.0)
        if worst > FORM_TOLERANCE:
            raise MatrixError(
                f"the matrices are not those of a multibody model: {what} differ from the expected 0 or 1 by "
                f"{worst:.2g}"
            )
