"""Biodynamic feedthrough (BDFT): what the seat's heave does to the controls through the pilot's body.

    H_BDFT(s) = phi / zddot = sum_k  C_k (lam_k B1_k + B2_k) / (lam_k^2 (s - lam_k))

is exact: the paper's projection drops the direct term of the imposed motion, this form does not
(docs/theory/projection.md). Every model carries the descriptor model it came from, so that `certificate` can measure it
against the full-order response. Signs: positive collective rotation is lever up, more collective; positive heave is up.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from pilotgen.check import check_choice, check_positive
from pilotgen.descriptor import Complexes, DescriptorModel, Floats, Numbers
from pilotgen.errors import MatrixError
from pilotgen.matrices import Matrices, descriptor
from pilotgen.modal import ModalModel, SecondOrderForm, independent_constraints, modes, second_order_form
from pilotgen.pilot_model import PilotModel, real_blocks

PROJECTIONS = ("exact", "literal")
COLLECTIVE = "collective_rotation"
# Largest relative violation of the invariance to vertical translation that is still round-off. Matrices of both solvers
# are below 1e-12; a spring to the ground of 1e-6 of the stiffest muscle is far above.
TRANSLATION_LIMIT = 1e-9
CERTIFICATE_BAND_HZ = (0.1, 20.0)
_CERTIFICATE_POINTS = 12  # 24 real equations; two different models of up to 11 poles cannot agree at all of them

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
    seat_joint : str
        Joint that holds the seat; its reactions and equations go with the seat.
    outputs : mapping of str to mapping of str to float
        Each output as a sum of weighted unknowns [rad]; the collective rotation must come first. Outputs whose unknowns
        are not in the model are left out, except the collective.
    """

    imposed: str = "seat.y"
    seat_joint: str = "seat_pin"
    outputs: Mapping[str, Mapping[str, float]] = field(default_factory=lambda: _DEFAULT_OUTPUTS)


@dataclass(frozen=True, eq=False)
class Plant:
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


def split(model: DescriptorModel, channels: Channels | None = None) -> Plant:
    """Split the unknowns into free and imposed ones.

    The seat's node goes out whole with its equations, and so does the joint that holds it; what stays of the seat is
    the column of the imposed translation.

    Raises
    ------
    MatrixError
        An unknown or joint is not in the model, or the joint that holds the seat also holds something else.
    """
    names = channels or Channels()
    imposed = model.index(names.imposed)
    seat = model.owned_by(names.imposed.rpartition(".")[0])
    joint = model.owned_by(names.seat_joint)
    if len(joint) == 0:
        raise MatrixError(f"joint '{names.seat_joint}' that holds the seat has no reactions among the model's unknowns")
    keep_mask = np.ones(len(model.names), dtype=bool)
    keep_mask[seat] = False
    keep_mask[joint] = False
    keep = np.flatnonzero(keep_mask)
    for matrix in (model.g_y, model.g_ydot):
        if matrix[np.ix_(joint, keep)].any() or matrix[np.ix_(keep, joint)].any():
            raise MatrixError(
                f"joint '{names.seat_joint}' acts on more than the seat; only a joint between the seat and the ground "
                "can be replaced by an imposed motion"
            )
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
    return Plant(
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


def translation_error(plant: Plant, direction: str) -> float:
    """Return the largest relative violation of the invariance to translation along the imposed direction.

    A pilot who touches nothing but the cockpit feels no force when cockpit and pilot translate together, at rest or at
    a constant rate: then phi/z has a double zero at s = 0, which the exact formula rests on.

    Parameters
    ----------
    plant : Plant
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


def make_pilot_model(
    matrices: Matrices | DescriptorModel,
    lever_length_m: float,
    washout_rad_s: float | None = None,
    projection: str = "exact",
    channels: Channels | None = None,
) -> PilotModel:
    """Return the pilot's feedthrough from the matrices of a multibody pilot at the controls.

    Parameters
    ----------
    matrices : Matrices or DescriptorModel
        The linearised model of seat, pilot and controls.
    lever_length_m : float
        Hinge to grip of the collective lever [m].
    washout_rad_s : float or None
        Corner of the washout [rad/s].
    projection : str
        `exact`, or `literal` for eq. (31) of the paper as printed.
    channels : Channels, optional
        Names of the imposed and watched unknowns.

    Raises
    ------
    MatrixError
        The model is not that of a pilot in a cockpit: names are missing, a motion is free, or the model is not
        invariant to vertical translation.
    """
    check_choice("projection", projection, PROJECTIONS)
    check_positive("lever_length_m", lever_length_m, "m")
    names = channels or Channels()
    model = descriptor(matrices) if isinstance(matrices, Matrices) else matrices
    plant = split(model, names)
    violation = translation_error(plant, names.imposed.rpartition(".")[2])
    if not violation < TRANSLATION_LIMIT:
        raise MatrixError(
            f"the model changes when cockpit and pilot translate together (relative violation {violation:.2g}, limit "
            f"{TRANSLATION_LIMIT:.0e}): something besides the seat is held by the ground"
        )
    modal = modes(plant.free, plant.form)
    if modal.n_zero:
        raise MatrixError(
            f"the pilot has {modal.n_zero} eigenvalues at zero: some part moves freely and has no feedthrough; "
            "every joint needs muscles, a spring or a hand that holds it"
        )
    A, B, C, D, parts = _literal(plant, modal) if projection == "literal" else _exact(plant, modal)
    return PilotModel(
        projection=projection,
        A=A,
        B=B,
        C=C,
        D=D,
        outputs=plant.outputs,
        lever_length_m=lever_length_m,
        integrators=2 if projection == "literal" else 0,
        washout_rad_s=washout_rad_s,
        translation_error=violation,
        plant=plant,
        _modal=parts,
    )


_Realisation = tuple[Floats, Floats, Floats, Floats, tuple[Complexes, Complexes] | None]


def _exact(plant: Plant, modal: ModalModel) -> _Realisation:
    """sum_k C_k (lam_k B1_k + B2_k) / (lam_k^2 (s - lam_k)), in the modes or in a real basis of them."""
    B1, B2 = -modal.V_L @ plant.g_ydot_imposed, -modal.V_L @ plant.g_y_imposed
    C = plant.output_matrix @ modal.V_R
    if not modal.diagonal:
        A = modal.A.real
        B: Numbers = np.linalg.solve(A, B1.real + np.linalg.solve(A, B2.real))
        return A, B, C.real, np.zeros(len(C)), None
    residues = C * ((modal.lam * B1 + B2) / modal.lam**2)
    return (*real_blocks(modal.lam, residues), np.zeros(len(C)), (modal.lam, residues))


def _literal(plant: Plant, modal: ModalModel) -> _Realisation:
    """Eq. (31) without its 1/s^2: C (sI - A)^-1 (s B1 + B2) = C B1 + C (sI - A)^-1 (A B1 + B2)."""
    B1, B2 = -modal.V_L @ plant.g_ydot_imposed, -modal.V_L @ plant.g_y_imposed
    C = plant.output_matrix @ modal.V_R
    D = (C @ B1).real
    if not modal.diagonal:
        return modal.A.real, (modal.A @ B1 + B2).real, C.real, D, None
    residues = C * (modal.lam * B1 + B2)
    return (*real_blocks(modal.lam, residues), D, (modal.lam, residues))


# ---- the certificate


def full_order_response(plant: Plant, omega: ArrayLike) -> Complexes:
    """Return -C~ (jw g_ydot^FF + g_y^FF)^-1 (jw g_ydot^FI + g_y^FI) / (jw)^2, shape (len(omega), p) [rad per m/s^2].

    One dense solve per frequency, all unknowns but the momenta, whose definitions are put in exactly. Nothing of the
    modal route is used. `omega` in rad/s, shape (m,).
    """
    form, free = plant.form, plant.free
    s = 1j * np.asarray(omega, dtype=float).reshape(-1)
    n_q, Phi_0, Phi_1, B = len(form.M), form.Phi_0, form.Phi_1, form.B
    phi_0, phi_1 = plant.g_y_imposed[free.constraint_rows], plant.g_ydot_imposed[free.constraint_rows]
    rows = independent_constraints(Phi_0 + Phi_1)
    if len(rows) < len(Phi_0):  # redundant constraints: an independent set of them says the same
        Phi_0, Phi_1, phi_0, phi_1 = Phi_0[rows], Phi_1[rows], phi_0[rows], phi_1[rows]
        B = B[:, independent_constraints(B.T)]
    n = n_q + len(Phi_0)
    pencil = np.zeros((len(s), n, n), dtype=np.complex128)
    right = np.zeros((len(s), n, 1), dtype=np.complex128)
    s2 = (s * s)[:, None, None]
    s1 = s[:, None, None]
    pencil[:, :n_q, :n_q] = s2 * form.M + s1 * form.C + form.K
    pencil[:, :n_q, n_q:] = B
    pencil[:, n_q:, :n_q] = s1 * Phi_1 + Phi_0
    right[:, :n_q, 0] = -(s2[:, 0] * plant.M_imposed + s1[:, 0] * plant.C_imposed + plant.K_imposed)
    right[:, n_q:, 0] = -(s1[:, 0] * phi_1 + phi_0)
    try:
        solution = np.linalg.solve(pencil, right)
    except np.linalg.LinAlgError as error:
        raise MatrixError("the full-order model is singular at one of the frequencies") from error
    outputs = plant.output_matrix[:, free.coordinates]
    return (solution[:, :n_q, 0] @ outputs.T) / (s * s)[:, None]


def certificate(model: PilotModel, frequencies_hz: ArrayLike | None = None) -> float:
    """Return the largest relative difference between the model and the full-order response of the collective rotation.

    Parameters
    ----------
    model : PilotModel
        A model made from matrices (it carries them).
    frequencies_hz : array_like, optional
        Where to compare [Hz]; by default 12 points from 0.1 to 20 Hz and the pilot's own frequencies in between.

    Raises
    ------
    MatrixError
        If the model carries no descriptor model (Mayo's pilots, models read from a file).
    """
    if model.plant is None:
        raise MatrixError(f"a pilot model of projection '{model.projection}' carries no matrices to certify it against")
    if frequencies_hz is None:
        low, high = CERTIFICATE_BAND_HZ
        own = np.abs(model.poles[model.poles.imag > 0.0]) / (2.0 * np.pi)
        grid = np.concatenate([np.geomspace(low, high, _CERTIFICATE_POINTS), own[(own > low) & (own < high)]])
    else:
        grid = np.asarray(frequencies_hz, dtype=float).reshape(-1)
    omega = 2.0 * np.pi * grid
    full = full_order_response(model.plant, omega)[:, 0]
    difference = np.abs(model.response(omega, washout=False) - full)
    return float(np.max(difference / np.abs(full))) if np.any(full) else float(np.max(difference))


# ---- Mayo's pilots


def mayo_pilot(
    frequency_hz: float,
    damping: float,
    time_constant_s: float,
    lever_length_m: float,
    washout_rad_s: float | None = 3.10,
) -> PilotModel:
    """Return a pilot of Mayo's form (paper eq. (39)-(40)).

        H = -(1/l) (s + 1/tau) / (s (s^2 + 2 xi w s + w^2)) [s/(s + w_h)]^2     rad per m/s^2

    Parameters
    ----------
    frequency_hz : float
        w / 2 pi [Hz].
    damping : float
        xi.
    time_constant_s : float
        tau [s].
    lever_length_m : float
        l [m].
    washout_rad_s : float or None
        w_h [rad/s]; 3.10 in the paper.
    """
    w = 2.0 * np.pi * check_positive("pilot frequency", frequency_hz, "Hz")
    xi = check_positive("pilot damping", damping)
    tau = check_positive("pilot time constant", time_constant_s, "s")
    length = check_positive("lever_length_m", lever_length_m, "m")
    # controllable form of (s + 1/tau) / (s^2 + 2 xi w s + w^2), time scaled by w so that the states are alike
    return PilotModel(
        projection="mayo",
        A=np.array([[0.0, w], [-w, -2.0 * xi * w]]),
        B=np.array([0.0, 1.0]),
        C=-np.array([[1.0 / (tau * w), 1.0]]) / length,
        D=np.zeros(1),
        outputs=(COLLECTIVE,),
        lever_length_m=length,
        integrators=1,
        washout_rad_s=washout_rad_s,
    )
