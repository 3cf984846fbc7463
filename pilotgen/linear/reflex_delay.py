"""A reflex that comes late: the stretch reflex split into an undelayed and a delayed part, after linearisation.

The muscles' activation a = a0 + Kp (x - x0) + Kd v stands for two things: short-range stiffness of muscle fibres, which
acts at once, and the reflex proper, which travels through the spinal cord. With a share mu of the first,

    force = mu r(t) + (1 - mu) r(t - T),     r = dF_reflex

where r is the reflex's part of the linearised forces: the difference of the matrices with the gains and without. The
delay becomes a Pade approximant D(s) of order m with m states for each independent combination of r, seven per arm at
most:

    xi' = Lambda xi + B u + (1 - mu) V_L (Delta g_y + lambda Delta g_ydot) V_R (1 - D) xi

so that nothing of posture, activations or decks changes, and T = 0 or mu = 1 is the pilot without delay. Theory,
and why level and margin cannot tell torso and delay apart: docs/theory/reflex_delay.md.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from pilotgen.errors import EvaluationError, MatrixError
from pilotgen.linear.imposed_motion import split
from pilotgen.linear.modal import modes
from pilotgen.linear.pilot_model import PilotModel, real_blocks
from pilotgen.solver.descriptor import Complexes, Floats
from pilotgen.solver.matrices import Matrices, descriptor

RANK_TOLERANCE = 1e-10  # of the largest singular value: what is smaller is round-off of the two linearisations
CERTIFICATE_BAND_HZ, CERTIFICATE_POINTS = (0.1, 20.0), 40


def pade(delay_s: float, order: int) -> tuple[Floats, Floats, Floats, float]:
    """State space A (m, m), B (m,), C (m,), D of the diagonal Pade approximant of e^(-sT).

    Parameters
    ----------
    delay_s : float
        T [s], greater than zero.
    order : int
        m, the order of numerator and denominator.
    """
    m = order
    # e^(-x) ~ N(x)/N(-x), N(x) = sum_k (2m-k)! m! / ((2m)! k! (m-k)!) (-x)^k; monic in x = s T
    weights = [
        math.factorial(2 * m - k)
        * math.factorial(m)
        / (math.factorial(2 * m) * math.factorial(k) * math.factorial(m - k))
        for k in range(m + 1)
    ]
    denominator = np.array(weights) / weights[m]
    numerator = denominator * (-1.0) ** np.arange(m + 1)
    D = float(numerator[m])
    A = np.zeros((m, m))
    A[:-1, 1:] = np.eye(m - 1)
    A[-1] = -denominator[:m]
    B = np.zeros(m)
    B[-1] = 1.0
    C = numerator[:m] - D * denominator[:m]
    return A / delay_s, B / delay_s, C, D  # companion form in x = s T, then time stretched


def delay_reflex(
    model: PilotModel, matrices: Matrices, without_reflex: Matrices, delay_s: float, undelayed_share: float, order: int
) -> PilotModel:
    """Return the pilot's feedthrough with a reflex of which only a share acts at once.

    Parameters
    ----------
    model : PilotModel
        The exact feedthrough without delay, of `matrices`.
    matrices, without_reflex : Matrices
        Of the pilot's deck, and of the same deck with reflex gains of zero.
    delay_s : float
        T of the delayed part [s].
    undelayed_share : float
        mu, 0 to 1.
    order : int
        Of the Pade approximant.

    Raises
    ------
    EvaluationError
        The modes are too close to a defective case to be taken apart.
    MatrixError
        The two decks have other unknowns.
    """
    if delay_s == 0.0 or undelayed_share == 1.0:
        return model
    if model.imposed is None or model.projection != "exact":
        raise MatrixError("a reflex delay needs the exact feedthrough of a multibody pilot")
    bare = split(descriptor(without_reflex))
    free = model.imposed.free
    if not np.array_equal(free.names, bare.free.names):
        raise MatrixError("the decks with and without reflex have other unknowns")
    modal = modes(free, model.imposed.form)
    if not modal.diagonal:
        raise EvaluationError("feedthrough", "the pilot's modes cannot be taken apart; a reflex delay needs that")
    lam, V_L, V_R = modal.lam, modal.V_L, modal.V_R
    # the reflex's part of the equations, by modes: what it adds to xi' is -N xi
    N = V_L @ ((free.g_y - bare.free.g_y) @ V_R + (free.g_ydot - bare.free.g_ydot) @ (V_R * lam))
    left, singular, right = np.linalg.svd(N)
    rank = int(np.count_nonzero(singular > RANK_TOLERANCE * singular[0])) if singular[0] > 0.0 else 0
    if rank == 0:
        return model  # no reflex: nothing to delay
    late = 1.0 - undelayed_share
    P, Q = left[:, :rank] * singular[:rank], right[:rank]
    A_d, B_d, C_d, D_d = pade(delay_s, order)
    eye = np.eye(rank)
    # signals y = (D(s)) Q xi: states per signal side by side
    A = np.block(
        [
            [np.diag(lam) + late * (1.0 - D_d) * (P @ Q), -late * P @ np.kron(eye, C_d[None, :])],
            [np.kron(eye, B_d[:, None]) @ Q, np.kron(eye, A_d)],
        ]
    )
    lam2 = lam[:, None]
    b = (lam2 * (-V_L @ model.imposed.g_ydot_imposed) + -V_L @ model.imposed.g_y_imposed) / lam2**2
    B = np.vstack([b, np.zeros((rank * order, b.shape[1]))])
    C = np.hstack([model.imposed.output_matrix @ V_R, np.zeros((len(model.outputs), rank * order))])
    A_r, B_r, C_r = _real(A, B, C)
    return dataclasses.replace(model, A=A_r, B=B_r, C=C_r, _modal=None)


def _real(A: Complexes, B: Complexes, C: Complexes) -> tuple[Floats, Floats, Floats]:
    """The same system in real numbers: by its own modes, in blocks of conjugate pairs."""
    poles, right = np.linalg.eig(A)
    left = np.linalg.solve(right, B)
    outputs = C @ right
    keep = np.argsort(np.round(np.abs(poles), 9) + 1e-9 * np.abs(poles.imag), kind="stable")
    poles, left, outputs = poles[keep], left[keep], outputs[:, keep]
    order: list[tuple[int, int | None]] = []
    used = np.zeros(len(poles), dtype=bool)
    for k, pole in enumerate(poles):
        if used[k]:
            continue
        used[k] = True
        if abs(pole.imag) <= 1e-9 * abs(pole):
            order.append((k, None))
            continue
        partners = np.flatnonzero(~used)
        mate = int(partners[np.argmin(np.abs(poles[partners] - pole.conjugate()))])
        used[mate] = True
        order.append((k, mate) if pole.imag > 0.0 else (mate, k))
    chosen: list[complex] = []
    ins, outs = [], []
    for first, partner in order:
        # the largest input scales a mode, so that the pair's halves are conjugates
        scale = left[first, np.abs(left[first]).argmax()]
        scale = scale if scale != 0.0 else 1.0
        row, column = left[first] / scale, outputs[:, first] * scale
        if partner is None:
            chosen.append(complex(poles[first].real))
            ins.append(row.real + 0j)
            outs.append(column.real + 0j)
        else:
            chosen += [complex(poles[first]), complex(poles[first].conjugate())]
            ins += [row, row.conjugate()]
            outs += [column, column.conjugate()]
    return real_blocks(np.array(chosen), np.array(outs).T, np.array(ins))


def delayed_full_order_response(
    matrices: Matrices,
    without_reflex: Matrices,
    omega: ArrayLike,
    delay_s: float,
    undelayed_share: float,
    order: int | None = None,
) -> Complexes:
    """Return the collective's rotation per seat acceleration [rad per m/s^2] by full-order solves, shape (n,).

    Nothing of the modal route is used. `omega` in rad/s, shape (n,); `order` of the Pade approximant, None for the
    delay itself, e^(-jwT).
    """
    whole, bare = split(descriptor(matrices)), split(descriptor(without_reflex))
    s = 1j * np.asarray(omega, dtype=float).reshape(-1)
    if order is None:
        late = np.exp(-s * delay_s)
    else:
        A, B, C, D = pade(delay_s, order)
        late = np.array([C @ np.linalg.solve(x * np.eye(order) - A, B) + D for x in s])
    factor = (undelayed_share + (1.0 - undelayed_share) * late)[:, None, None]
    parts = []
    for motion in (whole, bare):
        columns = [
            np.reshape(x, (len(motion.free.names), -1))[:, 0] for x in (motion.g_ydot_imposed, motion.g_y_imposed)
        ]
        parts.append(
            (
                s[:, None, None] * motion.free.g_ydot + motion.free.g_y,
                (s[:, None] * columns[0] + columns[1])[:, :, None],
            )
        )
    (pencil, right), (pencil_0, right_0) = parts
    pencil = pencil_0 + factor * (pencil - pencil_0)
    right = right_0 + factor * (right - right_0)
    x = np.linalg.solve(pencil, -right)[:, :, 0]
    response: Complexes = (
        x @ whole.output_matrix[0] + np.reshape(whole.output_imposed, (len(whole.outputs), -1))[0, 0]
    ) / (s * s)
    return response


def delayed_certificate(
    model: PilotModel, matrices: Matrices, without_reflex: Matrices, delay_s: float, undelayed_share: float, order: int
) -> tuple[float, float]:
    """Return how far `model` is from the full-order response with the approximant, and that from the delay itself.

    Both are the largest relative difference at `CERTIFICATE_POINTS` frequencies from 0.1 to 20 Hz. Parameters are those
    of `delay_reflex`, which made the model.
    """
    omega = 2.0 * math.pi * np.geomspace(*CERTIFICATE_BAND_HZ, CERTIFICATE_POINTS)
    late = (matrices, without_reflex, omega, delay_s, undelayed_share)
    approximated, exact = delayed_full_order_response(*late, order), delayed_full_order_response(*late)
    difference = np.abs(model.response(omega, washout=False) - approximated) / np.abs(approximated)
    return float(difference.max()), float((np.abs(approximated - exact) / np.abs(exact)).max())
