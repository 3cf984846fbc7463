"""Biodynamic feedthrough (BDFT): what the seat's heave does to the controls through the pilot's body.

    H_BDFT(s) = phi / zddot = sum_k  C_k (lam_k B1_k + B2_k) / (lam_k^2 (s - lam_k))

is exact: the paper's projection drops the direct term of the imposed motion, this form does not
(docs/theory/projection.md). Every model carries the descriptor model it came from, so that `certificate` can measure it
against the full-order response. Signs: positive collective rotation is lever up, more collective; positive heave is up.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from pilotgen.errors import EvaluationError, MatrixError
from pilotgen.linear.imposed_motion import (
    COLLECTIVE,
    Channels,
    ImposedMotion,
    full_order_response,
    split,
    translation_error,
)
from pilotgen.linear.modal import ModalModel, modes
from pilotgen.linear.pilot_model import PilotModel, real_blocks
from pilotgen.solver.descriptor import Complexes, DescriptorModel, Floats, Numbers
from pilotgen.solver.matrices import Matrices, descriptor
from pilotgen.study.fields import Choice, check_positive

_STAGE = "feedthrough"
PROJECTIONS = ("exact", "literal")
# Largest relative violation of the invariance to vertical translation that is still round-off. Matrices of both solvers
# are below 1e-12; a spring to the ground of 1e-6 of the stiffest muscle is far above.
TRANSLATION_LIMIT = 1e-9
CERTIFICATE_BAND_HZ = (0.1, 20.0)
_FEWEST_CERTIFICATE_POINTS = 4  # however few poles the pilot has


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
        The model is not that of a pilot in a cockpit: an unknown is missing, nothing holds the seat, or the matrices
        are not of a multibody model.
    EvaluationError
        This pilot has no feedthrough: a motion is free or determined by nothing, or the model is not invariant to
        vertical translation.
    """
    Choice(PROJECTIONS).check(f"projection = {projection!r}", projection)
    check_positive("lever_length_m", lever_length_m, "m")
    names = channels or Channels()
    model = descriptor(matrices) if isinstance(matrices, Matrices) else matrices
    plant = split(model, names)
    violation = translation_error(plant, names.imposed.rpartition(".")[2])
    if not violation < TRANSLATION_LIMIT:
        raise EvaluationError(
            _STAGE,
            f"the model changes when cockpit and pilot translate together (relative violation {violation:.2g}, limit "
            f"{TRANSLATION_LIMIT:.0e}): something besides the seat is held by the ground",
        )
    try:
        modal = modes(plant.free, plant.form)
    except MatrixError as error:
        raise EvaluationError(_STAGE, str(error)) from error
    if modal.n_zero:
        raise EvaluationError(
            _STAGE,
            f"the pilot has {modal.n_zero} eigenvalues at zero: some part moves freely and has no feedthrough; "
            "every joint needs muscles, a spring or a hand that holds it",
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


def _exact(plant: ImposedMotion, modal: ModalModel) -> _Realisation:
    """sum_k C_k (lam_k B1_k + B2_k) / (lam_k^2 (s - lam_k)), in the modes or in a real basis of them."""
    B1, B2 = -modal.V_L @ plant.g_ydot_imposed, -modal.V_L @ plant.g_y_imposed
    C = plant.output_matrix @ modal.V_R
    if not modal.diagonal:
        A = modal.A.real
        B: Numbers = np.linalg.solve(A, B1.real + np.linalg.solve(A, B2.real))
        return A, B, C.real, np.zeros(len(C)), None
    residues = C * ((modal.lam * B1 + B2) / modal.lam**2)
    return (*real_blocks(modal.lam, residues), np.zeros(len(C)), (modal.lam, residues))


def _literal(plant: ImposedMotion, modal: ModalModel) -> _Realisation:
    """Eq. (31) without its 1/s^2: C (sI - A)^-1 (s B1 + B2) = C B1 + C (sI - A)^-1 (A B1 + B2)."""
    B1, B2 = -modal.V_L @ plant.g_ydot_imposed, -modal.V_L @ plant.g_y_imposed
    C = plant.output_matrix @ modal.V_R
    D = (C @ B1).real
    if not modal.diagonal:
        return modal.A.real, (modal.A @ B1 + B2).real, C.real, D, None
    residues = C * (modal.lam * B1 + B2)
    return (*real_blocks(modal.lam, residues), D, (modal.lam, residues))


# ---- the certificate


def certificate(model: PilotModel, frequencies_hz: ArrayLike | None = None, output: int = 0) -> float:
    """Return the largest relative difference between the model and the full-order response.

    Parameters
    ----------
    model : PilotModel
        A model made from matrices (it carries them).
    frequencies_hz : array_like, optional
        Where to compare [Hz]; by default as many points from 0.1 to 20 Hz as the pilot has poles, its own frequencies
        among them. With their conjugates these are enough that no other strictly proper model of so many poles agrees
        at all of them.
    output : int
        Which of the model's outputs; by default the collective rotation.

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
        own = own[(own > low) & (own < high)]
        points = max(len(model.poles), _FEWEST_CERTIFICATE_POINTS)
        grid = np.concatenate([_across_the_band(points - len(own)), own])
    else:
        grid = np.asarray(frequencies_hz, dtype=float).reshape(-1)
    omega = 2.0 * np.pi * grid
    full = full_order_response(model.plant, omega, output)
    difference = np.abs(model.response(omega, output, washout=False) - full)
    return float(np.max(difference / np.abs(full))) if np.any(full) else float(np.max(difference))


@cache
def _across_the_band(points: int) -> Floats:
    return np.geomspace(*CERTIFICATE_BAND_HZ, points)


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
