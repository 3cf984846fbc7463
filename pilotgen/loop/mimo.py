"""Loops of several controls: one pilot matrix closed with one plant matrix (docs/theory/mimo.md).

Cut at the controls: u = K y, y = P u with P the plant (blade pitch to seat motions) and K the pilot, gearing included.
The loop's own feedback is positive; L = -K P is closed with negative feedback, and the critical point of each loop is
-1, as for heave alone, which is the case of one control.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from pilotgen.errors import PilotgenError, StudyError
from pilotgen.linear.pilot_model import PilotModel
from pilotgen.linear.statespace import ComplexArray, FloatArray, StateSpaceModel
from pilotgen.loop.enclosure import enclosed_real_part
from pilotgen.loop.margins import Margins, margins
from pilotgen.loop.plants import MatrixPlant
from pilotgen.loop.units import CONTROLS

BAND_HZ = (0.05, 30.0)


@dataclass(frozen=True, eq=False)
class MatrixLoop:
    """L(s) = -K P, m x m, cut at the controls; PilotgenError if it is ill-posed.

    Attributes
    ----------
    A, B, C, D : ndarray, shapes (n, n), (n, m), (m, n), (m, m)
        Of L; states [plant, pilot].
    controls : tuple of str
        Names of the loops.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    controls: tuple[str, ...]

    def __post_init__(self) -> None:
        if abs(np.linalg.det(np.eye(len(self.D)) + self.D)) < 1e-12:
            raise PilotgenError("the loops are ill-posed: their direct terms make I + L(infinity) singular")

    @cached_property
    def closed_loop_poles(self) -> ComplexArray:
        """Eigenvalues with all loops closed [rad/s], by rising modulus."""
        inner = np.linalg.solve(np.eye(len(self.D)) + self.D, self.C)
        lam = np.linalg.eigvals(self.A - self.B @ inner).astype(complex)
        return lam[np.argsort(np.abs(lam), kind="stable")]

    @cached_property
    def stable(self) -> bool | None:
        """Whether all loops together are stable; None if the eigenvalues' enclosure does not tell."""
        eye = np.eye(len(self.D))
        inner = np.linalg.solve(eye + self.D, self.C).astype(np.longdouble)
        inner = inner + np.linalg.solve(eye + self.D, (self.C - (eye + self.D) @ inner).astype(float))  # one refinement
        found = enclosed_real_part(self.A.astype(np.longdouble) - self.B.astype(np.longdouble) @ inner)
        if found is None or found[0] <= 0.0 <= found[1]:
            return None
        return found[1] < 0.0

    def response(self, omega: npt.ArrayLike) -> ComplexArray:
        """L(j omega), shape (f, m, m), omega (f,) in rad/s."""
        s = 1j * np.asarray(omega, dtype=float).reshape(-1)[:, None, None]
        inputs = np.broadcast_to(self.B.astype(np.complex128), (len(s), *self.B.shape))
        states: ComplexArray = np.linalg.solve(s * np.eye(len(self.A)) - self.A, inputs).astype(np.complex128)
        value: ComplexArray = self.C @ states + self.D
        return value

    def one_open(self, control: str) -> StateSpaceModel:
        """The loop of one control, cut there, the others closed."""
        i = self.controls.index(control)
        rest = [k for k in range(len(self.controls)) if k != i]
        if not rest:
            return StateSpaceModel(self.A, self.B[:, i], self.C[i], float(self.D[i, i]))
        # u_rest = -(C_rest x + D_rest,i u_i + D_rest,rest u_rest)
        closed = np.linalg.solve(
            np.eye(len(rest)) + self.D[np.ix_(rest, rest)], np.column_stack((self.C[rest], self.D[rest, i]))
        )
        by_state, by_input = -closed[:, :-1], -closed[:, -1]
        return StateSpaceModel(
            self.A + self.B[:, rest] @ by_state,
            self.B[:, i] + self.B[:, rest] @ by_input,
            self.C[i] + self.D[i, rest] @ by_state,
            float(self.D[i, i] + self.D[i, rest] @ by_input),
        )

    def loop_at_a_time(self) -> dict[str, Margins]:
        """All margins of each loop with the others closed."""
        return {control: margins(self.one_open(control)) for control in self.controls}

    def disk_margin(self) -> tuple[float, float]:
        """Multi-loop disk margin alpha, a guaranteed lower bound, and its frequency [Hz].

        0 if the loop is unstable, NaN if its stability cannot be told.

        Every loop may have gain and phase changed at once by any factor of the disk (1 + alpha/2 d)/(1 - alpha/2 d),
        |d| < 1: alpha = 2 / sup mu((I - L)(I + L)^-1), mu bounded from above by diagonal scaling (Osborne's), and the
        supremum taken over 0.05 to 30 Hz. For one loop it is the balanced disk margin.
        """
        if not self.stable:
            return (0.0 if self.stable is False else math.nan), math.nan
        low, high = (2.0 * math.pi * hz for hz in BAND_HZ)
        omega = np.unique(np.concatenate((np.geomspace(low, high, 1500), self._near_modes(low, high))))
        bound = self._mu_bound(omega)
        for _ in range(4):  # closer around the peak
            i = int(bound.argmax())
            omega = np.linspace(omega[max(i - 1, 0)], omega[min(i + 1, len(omega) - 1)], 41)
            bound = self._mu_bound(omega)
        i = int(bound.argmax())
        return 2.0 / float(bound[i]), float(omega[i]) / (2.0 * math.pi)

    def _near_modes(self, low: float, high: float) -> FloatArray:
        poles = self.closed_loop_poles
        own = np.abs(poles.imag)
        width = np.maximum(np.abs(poles.real), 1e-3)
        grid = (own[:, None] + width[:, None] * np.linspace(-3.0, 3.0, 25)).ravel()
        return grid[(grid > low) & (grid < high)]

    def _mu_bound(self, omega: FloatArray) -> FloatArray:
        """inf over diagonal D of the largest singular value of D M D^-1, approximately, at each frequency."""
        L = self.response(omega)
        eye = np.eye(L.shape[1])
        M = np.linalg.solve((eye + L).transpose(0, 2, 1), (eye - L).transpose(0, 2, 1)).transpose(0, 2, 1)
        if L.shape[1] > 1:
            for _ in range(30):
                for i in range(L.shape[1]):
                    row = np.sqrt((np.abs(M[:, i]) ** 2).sum(axis=1) - np.abs(M[:, i, i]) ** 2)
                    column = np.sqrt((np.abs(M[:, :, i]) ** 2).sum(axis=1) - np.abs(M[:, i, i]) ** 2)
                    scale = np.sqrt(np.maximum(column, 1e-300) / np.maximum(row, 1e-300))
                    scale = np.clip(scale, 1e-6, 1e6)
                    M[:, i] *= scale[:, None]
                    M[:, :, i] /= scale[:, None]
        found: FloatArray = np.asarray(np.linalg.svd(M, compute_uv=False)[:, 0], dtype=float)
        return found


def close(pilot: PilotModel, plant: MatrixPlant, grip_gearing: Mapping[str, float]) -> MatrixLoop:
    """The loop of a pilot and a plant over the controls that both have and `grip_gearing` names.

    Parameters
    ----------
    pilot : PilotModel
        With at least one of the plant's motions among its inputs.
    plant : MatrixPlant
        Seen at the pilot's seat.
    grip_gearing : mapping of str to float
        Blade pitch per rotation of the control, by names of `CONTROLS`: G0 l [rad/rad], or percent of travel per rad.

    Raises
    ------
    StudyError
        A motion of the plant is missing among the pilot's inputs, or a control is not to be had.
    """
    known = [name.removeprefix("seat_").removesuffix("_acceleration") for name in pilot.inputs]
    motions = [motion for motion in plant.motions if motion in known]
    missing = [motion for motion in plant.motions if motion not in known]
    if missing:
        raise StudyError(f"the plant moves the seat in {', '.join(missing)}, which the pilot's model does not have")
    controls = list(grip_gearing)
    for control in controls:
        if control not in plant.controls:
            raise StudyError(f"control {control!r} is not one of the plant; it has {', '.join(plant.controls)}")
        if CONTROLS[control][0] not in pilot.outputs:
            held = ", ".join(name for name, (output, *_) in CONTROLS.items() if output in pilot.outputs)
            raise StudyError(f"control {control!r} is held by no arm of this pilot, who holds {held}; see pilot.limbs")
    A_k, B_k, C_k, D_k = pilot.state_space([pilot.outputs.index(CONTROLS[control][0]) for control in controls])
    columns = [known.index(motion) for motion in motions]
    gears = np.array([grip_gearing[control] for control in controls])[:, None]
    B_k, C_k, D_k = B_k[:, columns], gears * C_k, gears * D_k[:, columns]
    rows = [plant.motions.index(motion) for motion in motions]
    into = [plant.controls.index(control) for control in controls]
    A_p, B_p, C_p, D_p = plant.A, plant.B[:, into], plant.C[rows], plant.D[np.ix_(rows, into)]
    n, k = len(A_p), len(A_k)
    A = np.zeros((n + k, n + k))
    A[:n, :n], A[n:, n:], A[n:, :n] = A_p, A_k, B_k @ C_p
    B = np.vstack((B_p, B_k @ D_p))
    C = -np.hstack((D_k @ C_p, C_k))
    return MatrixLoop(A, B, C, -D_k @ D_p, tuple(controls))
