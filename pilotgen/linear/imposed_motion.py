"""The free part of a linearised pilot, driven by the seat's imposed motion (paper eq. (23)-(25)).

Unknowns are split by name into free and imposed ones. Signs: positive collective rotation is lever up, more collective;
positive heave is up.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pilotgen.errors import EvaluationError, MatrixError
from pilotgen.linear.modal import SecondOrderForm, independent_constraints, second_order_form
from pilotgen.solver.descriptor import Complexes, DescriptorModel, Floats, Indices, block

COLLECTIVE = "collective_rotation"
_DEFAULT_OUTPUTS: dict[str, dict[str, float]] = {
    COLLECTIVE: {"lever.gz": 1.0},  # hinge axis z (right): x (forward, along the lever) turns to y (up)
    "cyclic_aft": {"stick.gz": 1.0},  # the stick (up, y) turns to -x: aft
    "cyclic_right": {"stick.gx": 1.0},  # the stick (up, y) turns to z: right
}


@dataclass(frozen=True)
class Channels:
    """Which unknown is imposed and which are watched.

    Attributes
    ----------
    imposed : str
        Unknown that follows the test input: a translation of the seat's node, positive up.
    outputs : mapping of str to mapping of str to float
        Each output as a sum of weighted unknowns [rad]; the collective rotation must come first. Outputs whose unknowns
        are not in the model are left out, except the collective.
    """

    imposed: str = "seat.y"
    outputs: Mapping[str, Mapping[str, float]] = field(default_factory=lambda: _DEFAULT_OUTPUTS)


@dataclass(frozen=True, eq=False)
class ImposedMotion:
    """The free part of a descriptor model, driven by the imposed seat motion z (paper eq. (23)-(25)).

    Attributes
    ----------
    free : DescriptorModel
        g_y^FF and g_ydot^FF.
    g_y_imposed, g_ydot_imposed : ndarray, shape (n_F,)
        Columns g_y^FI and g_ydot^FI of the imposed translation.
    output_matrix : ndarray, shape (p, n_F)
        C~: the outputs by the free unknowns.
    outputs : tuple of str
        Their names.
    form : SecondOrderForm
        The free part without momenta.
    M_imposed, C_imposed, K_imposed : ndarray, shape (n_q,)
        How zddot, zdot and z enter the equilibrium equations once momenta are eliminated.
    """

    free: DescriptorModel
    g_y_imposed: Floats
    g_ydot_imposed: Floats
    output_matrix: Floats
    outputs: tuple[str, ...]
    form: SecondOrderForm
    M_imposed: Floats
    C_imposed: Floats
    K_imposed: Floats


def split(model: DescriptorModel, channels: Channels | None = None) -> ImposedMotion:
    """Split the unknowns into free and imposed ones.

    The seat's node goes out whole with its equations, and so do the reactions and equations of the joint that holds it:
    those that touch the seat alone. What stays of the seat is the column of the imposed translation.

    Raises
    ------
    MatrixError
        An unknown is not in the model, or no joint holds the seat alone.
    """
    names = channels or Channels()
    imposed = model.index(names.imposed)
    seat_name = names.imposed.rpartition(".")[0]
    seat = model.owned_by(seat_name)
    occupied = (model.g_y != 0.0) | (model.g_ydot != 0.0)
    occupied[seat] = False
    occupied[:, seat] = False
    acts_elsewhere = occupied[model.reactions].any(axis=1) | occupied[:, model.reactions].any(axis=0)
    holds_seat = model.reactions[~acts_elsewhere]
    if len(holds_seat) == 0:
        raise MatrixError(
            f"no joint holds '{seat_name}' and nothing else; only a joint between the seat and the ground can be "
            "replaced by an imposed motion"
        )
    is_free = np.ones(len(model.names), dtype=bool)
    is_free[seat] = False
    is_free[holds_seat] = False
    keep = np.flatnonzero(is_free)
    free = model.restrict(keep)
    g_y_I, g_ydot_I = model.g_y[keep, imposed], model.g_ydot[keep, imposed]

    outputs: dict[str, Floats] = {}
    for name, weights in names.outputs.items():
        if outputs and not all((free.names == unknown.encode()).any() for unknown in weights):
            continue
        row = np.zeros(len(keep))
        for unknown, weight in weights.items():
            row[free.index(unknown)] += weight
        outputs[name] = row

    form = second_order_form(free)
    m_I, d_I = g_ydot_I[free.definition_rows], g_y_I[free.definition_rows]
    M_I, C_I = np.zeros(len(form.M)), g_ydot_I[free.equilibrium_rows] + form.momentum_force @ m_I
    M_I[form.dynamic] = m_I
    C_I[form.dynamic] += d_I
    return ImposedMotion(
        free=free,
        g_y_imposed=g_y_I,
        g_ydot_imposed=g_ydot_I,
        output_matrix=np.array(list(outputs.values())),
        outputs=tuple(outputs),
        form=form,
        M_imposed=M_I,
        C_imposed=C_I,
        K_imposed=g_y_I[free.equilibrium_rows] + form.momentum_force @ d_I,
    )


def translation_error(plant: ImposedMotion, direction: str) -> float:
    """Return the largest relative violation of the invariance to translation along the imposed direction.

    A pilot who touches nothing but the cockpit feels no force when cockpit and pilot translate together, at rest or at
    a constant rate: then phi/z has a double zero at s = 0, which the exact formula rests on.

    Parameters
    ----------
    plant : ImposedMotion
        The split model.
    direction : str
        Ending of the imposed unknown's name: `y` for the heave.
    """
    free, form = plant.free, plant.form
    shift = np.char.endswith(free.names[free.coordinates], b"." + direction.encode()).astype(float)
    worst = 0.0
    for matrix, imposed in (
        (form.K, plant.K_imposed),
        (form.C, plant.C_imposed),
        (form.Phi_0, plant.g_y_imposed[free.constraint_rows]),
        (form.Phi_1, plant.g_ydot_imposed[free.constraint_rows]),
    ):
        scale = np.abs(matrix).max(initial=0.0)
        if scale > 0.0 or np.any(imposed):
            worst = max(worst, float(np.abs(matrix @ shift + imposed).max()) / max(scale, float(np.abs(imposed).max())))
    return worst


def full_order_response(plant: ImposedMotion, omega: ArrayLike, output: int = 0) -> Complexes:
    """Return -C~ (jw g_ydot^FF + g_y^FF)^-1 (jw g_ydot^FI + g_y^FI) / (jw)^2 of one output [rad per m/s^2].

    EvaluationError if the matrix is singular at a frequency.

    One dense solve per frequency, all unknowns but the momenta, whose definitions are put in exactly, and those that
    nothing connects to the output (the other arm, while the seat's motion is imposed). Nothing of the modal route is
    used. `omega` in rad/s, shape (m,); `output` counts as in `plant.outputs`.
    """
    form, free = plant.form, plant.free
    s = 1j * np.asarray(omega, dtype=float).reshape(-1)
    M, C, K, B, Phi_0, Phi_1 = form.M, form.C, form.K, form.B, form.Phi_0, form.Phi_1
    weights = plant.output_matrix[output, free.coordinates]
    m_I, c_I, k_I = plant.M_imposed, plant.C_imposed, plant.K_imposed
    phi_0, phi_1 = plant.g_y_imposed[free.constraint_rows], plant.g_ydot_imposed[free.constraint_rows]
    if len(plant.outputs) > 1:
        q, r = _connected(form, weights != 0.0)
        M, C, K, B = block(M, q, q), block(C, q, q), block(K, q, q), block(B, q, r)
        Phi_0, Phi_1 = block(Phi_0, r, q), block(Phi_1, r, q)
        weights, m_I, c_I, k_I, phi_0, phi_1 = weights[q], m_I[q], c_I[q], k_I[q], phi_0[r], phi_1[r]
    rows = independent_constraints(Phi_0 + Phi_1)
    if len(rows) < len(Phi_0):  # redundant constraints: an independent set of them says the same
        Phi_0, Phi_1, phi_0, phi_1 = Phi_0[rows], Phi_1[rows], phi_0[rows], phi_1[rows]
        B = B[:, independent_constraints(B.T)]
    n_q = len(M)
    n = n_q + len(Phi_0)
    pencil = np.zeros((len(s), n, n), dtype=np.complex128)
    right = np.zeros((len(s), n, 1), dtype=np.complex128)
    s2 = (s * s)[:, None, None]
    s1 = s[:, None, None]
    pencil[:, :n_q, :n_q] = s2 * M + s1 * C + K
    pencil[:, :n_q, n_q:] = B
    pencil[:, n_q:, :n_q] = s1 * Phi_1 + Phi_0
    right[:, :n_q, 0] = -(s2[:, 0] * m_I + s1[:, 0] * c_I + k_I)
    right[:, n_q:, 0] = -(s1[:, 0] * phi_1 + phi_0)
    try:
        solution = np.linalg.solve(pencil, right)
    except np.linalg.LinAlgError as error:
        raise EvaluationError("feedthrough", "the full-order model is singular at one of the frequencies") from error
    response: Complexes = (solution[:, :n_q, 0] @ weights) / (s * s)
    return response


def _connected(form: SecondOrderForm, start: NDArray[np.bool_]) -> tuple[Indices, Indices]:
    """Coordinates and reactions that a chain of non-zero entries connects to the coordinates `start`."""
    n = len(form.M)
    linked = np.zeros((n + len(form.Phi_0), n + len(form.Phi_0)), dtype=bool)
    linked[:n, :n] = (form.M != 0.0) | (form.C != 0.0) | (form.K != 0.0)
    linked[:n, n:] = (form.B != 0.0) | ((form.Phi_0 != 0.0) | (form.Phi_1 != 0.0)).T
    linked |= linked.T
    reached = np.zeros(len(linked), dtype=bool)
    reached[:n] = start
    newly = reached
    while newly.any():
        newly = linked[newly].any(axis=0) & ~reached
        reached = reached | newly
    return np.flatnonzero(reached[:n]), np.flatnonzero(reached[n:])
