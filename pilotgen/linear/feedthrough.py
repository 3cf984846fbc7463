"""Biodynamic feedthrough (BDFT): what motions of the seat do to the controls through the pilot's body.

    H_BDFT(s) = phi / zddot = sum_k  C_k (lam_k B1_k + B2_k) / (lam_k^2 (s - lam_k))  [ + F(0)/s^2 + F'(0)/s ]

is exact: the paper's projection drops the direct term of the imposed motion, this form does not
(docs/theory/projection.md). The terms in brackets belong to rotations of the seat, which tilt gravity. Every model
carries the descriptor model it came from, so that `certificate` can measure it against the full-order response. Signs:
positive collective rotation is lever up, more collective; positive heave is up.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from pilotgen.errors import EvaluationError, MatrixError, StudyError
from pilotgen.linear.full_order import full_order_response
from pilotgen.linear.imposed_motion import (
    COLLECTIVE,
    ROTATIONS,
    SEAT_MOTIONS,
    Channels,
    ImposedMotion,
    rotation_error,
    split,
    static_motion,
    static_terms,
    translation_error,
)
from pilotgen.linear.modal import ModalModel, modes
from pilotgen.linear.pilot_model import PilotModel, real_blocks
from pilotgen.solver.descriptor import Complexes, DescriptorModel, Floats, Numbers
from pilotgen.solver.matrices import Matrices, descriptor
from pilotgen.study.fields import Choice
from pilotgen.study.wording import check_positive

_STAGE = "feedthrough"
PROJECTIONS = ("exact", "literal")
# Largest relative violation of the invariance to vertical translation that is still round-off. Matrices of both solvers
# are below 1e-12; a spring to the ground of 1e-6 of the stiffest muscle is far above.
TRANSLATION_LIMIT = 1e-9
# The same of rotations; two large numbers, weight and its reaction, cancel in it.
ROTATION_LIMIT = 1e-9
CERTIFICATE_BAND_HZ = (0.1, 20.0)
_FEWEST_CERTIFICATE_POINTS = 4  # however few poles the pilot has
# However many: a torso on springs has 64. At 16 points, half of them at its own frequencies, an error of the projection
# shows; a full-order solution costs as much as everything else of a pilot's linear algebra.
_MOST_CERTIFICATE_POINTS = 16


def make_pilot_model(
    matrices: Matrices | DescriptorModel,
    lever_length_m: float,
    washout_rad_s: float | None = None,
    projection: str = "exact",
    channels: Channels | None = None,
) -> PilotModel:
    """Return the pilot's feedthrough from the matrices of a multibody pilot at the controls.

    StudyError if the literal projection is asked for more than one translation.

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
    if names.moments and projection == "literal":
        raise StudyError("projection = 'literal' is eq. (31) of the paper, which knows no moments of the hands")
    rotates = any(name in ROTATIONS for name in names.inputs)
    if (projection == "literal" and len(names.inputs) > 1) or (rotates and projection == "literal"):
        raise StudyError("projection = 'literal' is eq. (31) of the paper, which knows one translation of the seat")
    model, positions = matrices, None
    if isinstance(matrices, Matrices):
        model = descriptor(matrices)
        if rotates:
            nodes = matrices.nodes
            positions = {bytes(name).decode(): x for name, x in zip(nodes.name, nodes.position, strict=True)}
    assert isinstance(model, DescriptorModel)
    imposed = split(model, names, positions)
    violation = _invariance(imposed, model, names, positions)
    try:
        modal = modes(imposed.free, imposed.form)
    except MatrixError as error:
        raise EvaluationError(_STAGE, str(error)) from error
    if modal.n_zero:
        raise EvaluationError(
            _STAGE,
            f"the pilot has {modal.n_zero} eigenvalues at zero: some part moves freely and has no feedthrough; "
            "every joint needs muscles, a spring or a hand that holds it",
        )
    A, B, C, D, parts = _literal(imposed, modal) if projection == "literal" else _exact(imposed, modal)
    return PilotModel(
        projection=projection,
        A=A,
        B=B,
        C=C,
        D=D,
        inputs=tuple(f"seat_{name}_acceleration" for name in imposed.inputs),
        outputs=imposed.outputs,
        lever_length_m=lever_length_m,
        integrators=2 if projection == "literal" else 0,
        washout_rad_s=washout_rad_s,
        translation_error=violation,
        tilt=_tilt(imposed) if rotates else None,
        imposed=imposed,
        _modal=parts,
    )


def _invariance(
    imposed: ImposedMotion, model: DescriptorModel, channels: Channels, positions: Mapping[str, Floats] | None
) -> float:
    """The largest violation of what the exact formula rests on; EvaluationError where it is more than round-off."""
    worst = 0.0
    fall: ImposedMotion | None = None
    for j, name in enumerate(imposed.inputs):
        if SEAT_MOTIONS[name].rotation:
            if fall is None:
                fall = split(model, dataclasses.replace(channels, inputs=("surge", "sway")), positions)
            violation, _ = rotation_error(imposed, j, fall)
            limit, motion = ROTATION_LIMIT, f"turn together ({name})"
        else:
            violation = translation_error(imposed, j)
            limit, motion = TRANSLATION_LIMIT, "translate together"
        if not violation < limit:
            raise EvaluationError(
                _STAGE,
                f"the model changes when cockpit and pilot {motion} (relative violation {violation:.2g}, limit "
                f"{limit:.0e}): something besides the seat is held by the ground",
            )
        worst = max(worst, violation)
    return worst


def _tilt(imposed: ImposedMotion) -> Floats:
    """F(0) and F'(0) of rotations; those of translations are round-off of zero."""
    terms = static_terms(imposed)
    for j, name in enumerate(imposed.inputs):
        if not SEAT_MOTIONS[name].rotation:
            terms[:, j] = 0.0
    return terms


_Realisation = tuple[Floats, Floats, Floats, Floats, tuple[Complexes, Complexes] | None]


def _exact(imposed: ImposedMotion, modal: ModalModel) -> _Realisation:
    """sum_k C_k (lam_k B1_k + B2_k) / (lam_k^2 (s - lam_k)), in the modes or in a real basis of them."""
    B1, B2, C = _by_modes(imposed, modal)
    D = np.zeros((len(C), len(imposed.inputs)))
    if not modal.diagonal:
        A = modal.A.real
        B: Numbers = np.linalg.solve(A, B1.real + np.linalg.solve(A, B2.real))
        C, D = _with_moments(imposed, modal, C, D, A, B)
        return A, B, C.real, D, None
    lam = modal.lam[:, None]
    b = (lam * B1 + B2) / lam**2
    if len(imposed.moment_rows):
        C, D = _with_moments(imposed, modal, C, D, np.diag(modal.lam), b)
    return _from_modes(modal.lam, C, b, D)


def _with_moments(
    imposed: ImposedMotion, modal: ModalModel, C: Numbers, D: Floats, A: Numbers, B: Numbers
) -> tuple[Numbers, Floats]:
    """C and D with a row for each moment: a (M q'' + C q' + K q + what the seat adds), q = U x, x' = A x + B z''.

    q follows the seat's acceleration by two integrations, so that of U (sI - A)^-1 B only U A B, its acceleration, is
    left in D; a tilt, whose q has u0/s^2 + u1/s besides, adds M u0 + C u1.
    """
    a, form = imposed.moment_rows, imposed.form
    if not len(a):
        return C, D

    def watched(rows: Floats) -> Numbers:
        of_unknowns = np.zeros((len(rows), len(imposed.free.names)))
        of_unknowns[:, imposed.free.coordinates] = rows
        return modal.watched_by(of_unknowns)

    by_M, by_C, by_K = (watched(a @ matrix) for matrix in (form.M, form.C, form.K))
    rows = (by_M @ A + by_C) @ A + by_K
    direct = ((by_M @ A + by_C) @ B).real + a @ (form.M @ imposed.rigid + imposed.M_imposed)
    for j, name in enumerate(imposed.inputs):
        if SEAT_MOTIONS[name].rotation:
            at_rest, per_rate = static_motion(imposed)
            direct[:, j] += a @ (form.M @ at_rest + form.C @ per_rate)[:, j]
    return np.vstack((C, rows)), np.vstack((D, direct))


def _by_modes(imposed: ImposedMotion, modal: ModalModel) -> tuple[Numbers, Numbers, Numbers]:
    """B1 = -V_L g_ydot^FI, B2 = -V_L g_y^FI and C = C~ V_R."""
    driven = -modal.driven_by(np.concatenate((imposed.g_ydot_imposed, imposed.g_y_imposed), axis=1))
    k = len(imposed.inputs)
    return driven[:, :k], driven[:, k:], modal.watched_by(imposed.output_matrix)


def _literal(imposed: ImposedMotion, modal: ModalModel) -> _Realisation:
    """Eq. (31) without its 1/s^2: C (sI - A)^-1 (s B1 + B2) = C B1 + C (sI - A)^-1 (A B1 + B2)."""
    B1, B2, C = _by_modes(imposed, modal)
    D = (C @ B1).real
    if not modal.diagonal:
        return modal.A.real, (modal.A @ B1 + B2).real, C.real, D, None
    return _from_modes(modal.lam, C, modal.lam[:, None] * B1 + B2, D)


def _from_modes(lam: Complexes, C: Numbers, B: Numbers, D: Floats) -> _Realisation:
    """Real blocks and residues C_k B_k; each mode is scaled by the input that drives it most."""
    modes = np.arange(len(lam))
    largest = np.abs(B).argmax(axis=1)
    scale = B[modes, largest]
    driven = scale != 0.0
    right: Complexes = (B / np.where(driven, scale, 1.0)[:, None]).astype(np.complex128)
    right[modes, largest] = np.where(driven, 1.0, 0.0)
    left: Complexes = C * np.where(driven, scale, 1.0)
    return (*real_blocks(lam, left, right), D, (lam, left[:, :, None] * right))


# ---- the certificate


def certificate(model: PilotModel, frequencies_hz: ArrayLike | None = None, output: int = 0, input: int = 0) -> float:
    """Return the largest relative difference between the model and the full-order response.

    Parameters
    ----------
    model : PilotModel
        A model made from matrices (it carries them).
    frequencies_hz : array_like, shape (n,), optional
        Where to compare [Hz]; by default as many points from 0.1 to 20 Hz as the pilot has poles, its own frequencies
        among them, but 16 at most. With their conjugates as many as poles are enough that no other strictly proper
        model of so many poles agrees at all of them.
    output : int
        Which of the model's outputs; by default the collective rotation.
    input : int
        Which of its inputs.

    Raises
    ------
    MatrixError
        If the model carries no descriptor model (Mayo's pilots, models read from a file).
    """
    if model.imposed is None:
        raise MatrixError(f"a pilot model of projection '{model.projection}' carries no matrices to certify it against")
    if frequencies_hz is None:
        low, high = CERTIFICATE_BAND_HZ
        own = np.abs(model.poles[model.poles.imag > 0.0]) / (2.0 * np.pi)
        own = own[(own > low) & (own < high)]
        points = max(min(len(model.poles), _MOST_CERTIFICATE_POINTS), _FEWEST_CERTIFICATE_POINTS)
        if len(own) > points // 2:  # every so many of a torso's many
            own = own[np.linspace(0.0, len(own) - 1.0, points // 2).round().astype(np.intp)]
        grid = np.concatenate([_across_the_band(points - len(own)), own])
    else:
        grid = np.asarray(frequencies_hz, dtype=float).reshape(-1)
    omega = 2.0 * np.pi * grid
    full = full_order_response(model.imposed, omega, output, input)
    difference = np.abs(model.response(omega, output, washout=False, input=input) - full)
    return float(np.max(difference / np.abs(full))) if np.any(full) else float(np.max(difference))


def certificates(model: PilotModel, frequencies_hz: ArrayLike | None = None) -> Floats:
    """Return the certificate of every entry, shape (p, k); as `certificate`."""
    return np.array(
        [
            [certificate(model, frequencies_hz, output, input) for input in range(len(model.inputs))]
            for output in range(len(model.outputs))
        ]
    )


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
        B=np.array([[0.0], [1.0]]),
        C=-np.array([[1.0 / (tau * w), 1.0]]) / length,
        D=np.zeros((1, 1)),
        outputs=(COLLECTIVE,),
        lever_length_m=length,
        integrators=1,
        washout_rad_s=washout_rad_s,
    )
