"""The pilot as a linear system: seat heave acceleration in, rotation of the controls out.

One class for every pilot, multibody or Mayo's, so that nothing behind it cares which one it has:

    H(s) = (D + C (sI - A)^-1 B) s^(-integrators) [s / (s + w_h)]^2

A, B, C, D are real and hold the pilot's own modes; free integrators and the washout are kept apart because they cancel
each other: with a washout no pole is left at s = 0.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pilotgen.errors import EvaluationError, MatrixError
from pilotgen.hdf5 import NewFile, opened, text
from pilotgen.linear.partial_fractions import PartialFractions, poles_and_residues, washout
from pilotgen.solver.descriptor import Complexes, Floats

if TYPE_CHECKING:
    import control

    from pilotgen.linear.imposed_motion import ImposedMotion

FILETYPE = "pilotgen pilot model"
VERSION = (1, 0)
INPUT_NAME, INPUT_UNIT = "seat_heave_acceleration", "m/s^2"
GRIP_OUTPUT = "grip_motion"


@dataclass(frozen=True, eq=False)
class PilotModel:
    """A pilot's feedthrough from seat heave acceleration to the rotation of the controls.

    Attributes
    ----------
    projection : str
        `exact` (modal formula), `literal` (eq. (31) as printed) or `mayo`.
    A, B, C, D : ndarray, shapes (r, r), (r,), (p, r), (p,)
        Real state space of the pilot's own modes; output k is `outputs[k]` [rad], the input is in m/s^2.
    outputs : tuple of str
        `collective_rotation` first (positive = lever up), then cyclic axes if the model has them.
    lever_length_m : float
        Hinge to grip of the collective lever [m]: grip motion = lever_length_m * collective rotation.
    integrators : int
        Free integrators behind the modes: 0 exact, 1 Mayo, 2 literal.
    washout_rad_s : float or None
        Corner w_h of the washout (s/(s+w_h))^2 [rad/s]; None for none.
    translation_error : float or None
        Largest relative violation of the invariance to vertical translation; None where there is no multibody model.
    plant : ImposedMotion or None
        The descriptor model it came from.
    """

    projection: str
    A: Floats
    B: Floats
    C: Floats
    D: Floats
    outputs: tuple[str, ...]
    lever_length_m: float
    integrators: int = 0
    washout_rad_s: float | None = None
    translation_error: float | None = None
    plant: ImposedMotion | None = field(default=None, repr=False)
    _modal: tuple[Complexes, Complexes] | None = field(default=None, repr=False)

    # ---- poles

    @cached_property
    def _poles_and_residues(self) -> tuple[Complexes, Complexes | None]:
        if self._modal is not None:
            return self._modal
        return poles_and_residues(self.A, self.B, self.C)

    @property
    def poles(self) -> Complexes:
        """Poles of the pilot's own modes, shape (r,) [rad/s]; integrators and washout are not among them."""
        return self._poles_and_residues[0]

    @property
    def residues(self) -> Complexes | None:
        """Residues of D + C (sI - A)^-1 B, shape (p, r); None when A is (nearly) defective."""
        return self._poles_and_residues[1]

    def pole_list(self) -> list[dict[str, float]]:
        """One entry per conjugate pair or real pole: `frequency_hz` = |lam| / 2 pi, `damping` (+-1 for a real pole)."""
        return [
            {"frequency_hz": float(abs(lam) / (2.0 * np.pi)), "damping": float(-lam.real / abs(lam))}
            for lam in self.poles
            if lam.imag >= 0.0
        ]

    def dominant_pole(self) -> complex:
        """The oscillatory pole of largest residue in the collective [rad/s]; a real one if none oscillates.

        EvaluationError if there is no pole.
        """
        if len(self.poles) == 0:
            raise EvaluationError("feedthrough", "the pilot has no mode: nothing moves, or only parts without mass")
        residues = self.residues
        weight = np.ones(len(self.poles)) if residues is None else np.abs(residues[0])
        oscillates = self.poles.imag > 0.0
        if oscillates.any():
            weight = np.where(oscillates, weight, -1.0)
        return complex(self.poles[int(np.argmax(weight))])

    def dominant_pair(self) -> tuple[float, float]:
        """Natural frequency [Hz] and damping ratio of the dominant pole."""
        lam = self.dominant_pole()
        return abs(lam) / (2.0 * np.pi), -lam.real / abs(lam)

    # ---- frequency response

    def response(self, omega: ArrayLike, output: int = 0, washout: bool = True) -> Complexes:
        """Return H(j omega) of one output [rad per m/s^2].

        Parameters
        ----------
        omega : array_like
            Angular frequencies [rad/s], any shape.
        output : int
            Which of `outputs`.
        washout : bool
            False leaves out the washout: the pilot's body alone.
        """
        w = np.asarray(omega, dtype=float)
        s = 1j * w.reshape(-1)
        poles, residues = self._poles_and_residues
        if residues is not None:
            H = (1.0 / (s[:, None] - poles)) @ residues[output] + self.D[output]
        else:
            resolvent = s[:, None, None] * np.eye(len(self.A)) - self.A
            inputs = np.broadcast_to(self.B[:, None], (len(s), len(self.B), 1))
            H = np.linalg.solve(resolvent, inputs)[:, :, 0] @ self.C[output] + self.D[output]
        corner = self.washout_rad_s if washout else None
        if corner is None:
            H = H / s**self.integrators if self.integrators else H
        else:
            H = H * s ** (2 - self.integrators) / (s + corner) ** 2
        response: Complexes = H.reshape(w.shape)
        return response

    def grip_motion(self, omega: ArrayLike, washout: bool = False) -> Complexes:
        """Return the motion of the collective grip [m per m/s^2], by default without washout, as measured on people."""
        return self.lever_length_m * self.response(omega, 0, washout)

    def partial_fractions(self, output: int = 0) -> PartialFractions | None:
        """One output with its filters as a sum of partial fractions; None where it has no such form."""
        poles, residues = self._poles_and_residues
        if residues is None or (self.washout_rad_s is None and self.integrators):
            return None
        own = PartialFractions(poles, residues[output].astype(np.complex128), float(self.D[output]))
        return own if self.washout_rad_s is None else own.times(washout(self.washout_rad_s, self.integrators))

    # ---- state space

    def state_space(
        self, outputs: Sequence[int] | None = None, washout: bool = True
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Return real A (n, n), B (n, 1), C (p, n), D (p, 1) of the whole model, filters included.

        Parameters
        ----------
        outputs : sequence of int, optional
            Which of `outputs`; by default the collective rotation alone.
        washout : bool
            False leaves out the washout.

        The filters come first: two sections in series, then the pilot's modes.
        """
        chosen = [0] if outputs is None else list(outputs)
        corner = self.washout_rad_s if washout else None
        if corner is None:
            sections = [(0.0, False)] * self.integrators
        else:  # high-pass s/(s+w) where no integrator cancels its zero, else 1/(s+w)
            sections = [(corner, k >= self.integrators) for k in range(2)]
        n_f, r = len(sections), len(self.A)
        A, B = np.zeros((n_f + r, n_f + r)), np.zeros(n_f + r)
        # u is what reaches the next block: `row` of the filter states plus `through` times the input
        row, through = np.zeros(n_f + r), 1.0
        for k, (w, high_pass) in enumerate(sections):
            # x' = u - w x; the section passes u - w x (= s/(s+w) u) or x (= 1/(s+w) u)
            A[k] = row
            A[k, k] -= w
            B[k] = through
            if high_pass:
                row = row.copy()
                row[k] -= w
            else:
                row, through = np.zeros(n_f + r), 0.0
                row[k] = 1.0
        A[n_f:, n_f:] = self.A
        A[n_f:] += np.outer(self.B, row)
        B[n_f:] = self.B * through
        C = np.outer(self.D[chosen], row)
        C[:, n_f:] += self.C[chosen]
        D = self.D[chosen] * through
        return A, B[:, None], C, D[:, None]

    def _all_outputs(self, washout: bool) -> tuple[Floats, Floats, Floats, Floats, list[str], list[str]]:
        """Return the state space with every output and the grip motion, their names and units."""
        A, B, C, D = self.state_space(range(len(self.outputs)), washout)
        C, D = np.vstack([C, self.lever_length_m * C[0]]), np.vstack([D, self.lever_length_m * D[0]])
        return A, B, C, D, [*self.outputs, GRIP_OUTPUT], ["rad"] * len(self.outputs) + ["m"]

    def to_control(self, washout: bool = True) -> control.StateSpace:
        """Return a `control.StateSpace` with named signals: heave acceleration in, rotations and grip motion out."""
        import control

        A, B, C, D, names, _ = self._all_outputs(washout)
        return control.ss(A, B, C, D, inputs=[INPUT_NAME], outputs=names, name=f"pilot_{self.projection}")

    # ---- file

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the model as HDF5 (docs/io_formats/pilot_model.md), replacing the file; FileError if that fails."""
        A, B, C, D, names, units = self._all_outputs(washout=True)
        with NewFile(path, FILETYPE, VERSION) as new:
            file = new.file
            file.attrs["projection"] = np.bytes_(self.projection)
            for name, value in (("A", A), ("B", B), ("C", C), ("D", D)):
                file[name] = value
            file["inputs/name"], file["inputs/unit"] = np.array([INPUT_NAME], "S"), np.array([INPUT_UNIT], "S")
            file["outputs/name"], file["outputs/unit"] = np.array(names, "S"), np.array(units, "S")
            file["poles"] = np.column_stack([self.poles.real, self.poles.imag])
            for name, value in (("A", self.A), ("B", self.B), ("C", self.C), ("D", self.D)):
                file[f"modes/{name}"] = value
            file["integrators"] = self.integrators
            file["lever_length_m"] = self.lever_length_m
            file["washout_rad_s"] = np.nan if self.washout_rad_s is None else self.washout_rad_s
            file["translation_error"] = np.nan if self.translation_error is None else self.translation_error


def read_pilot_model(path: str | os.PathLike[str]) -> PilotModel:
    """Read a pilot model file; FileError if it cannot be opened, MatrixError if it is not one or is damaged."""
    with opened(path, FILETYPE, VERSION, MatrixError) as file:
        parts = {name: np.asarray(file[f"modes/{name}"][()], dtype=float) for name in "ABCD"}
        numbers = {
            name: float(file[name][()])
            for name in ("integrators", "lever_length_m", "washout_rad_s", "translation_error")
        }
        names = tuple(text(name) for name in file["outputs/name"][()])
        r, outputs = len(np.atleast_1d(parts["B"])), tuple(name for name in names if name != GRIP_OUTPUT)
        shapes = {"A": (r, r), "B": (r,), "C": (len(outputs), r), "D": (len(outputs),)}
        for name, shape in shapes.items():
            if parts[name].shape != shape or not np.isfinite(parts[name]).all():
                raise MatrixError(
                    f"{os.fspath(path)}: dataset 'modes/{name}' must have shape {shape} and finite numbers"
                )
        return PilotModel(
            projection=text(file.attrs["projection"]) if "projection" in file.attrs else "exact",
            outputs=outputs,
            lever_length_m=numbers["lever_length_m"],
            integrators=int(numbers["integrators"]),
            washout_rad_s=None if np.isnan(numbers["washout_rad_s"]) else numbers["washout_rad_s"],
            translation_error=None if np.isnan(numbers["translation_error"]) else numbers["translation_error"],
            A=parts["A"],
            B=parts["B"],
            C=parts["C"],
            D=parts["D"],
        )


def real_blocks(poles: Complexes, residues: Complexes) -> tuple[Floats, Floats, Floats]:
    """Return real A, B, C with C (sI - A)^-1 B = sum_k residues[:, k] / (s - poles[k]).

    Poles come as conjugate pairs side by side (positive imaginary part first) or real, shape (r,); residues (p, r) with
    the conjugate of each pair's first member as its second. A pair becomes the block [[a, b], [-b, a]].
    """
    r = len(poles)
    A, B, C = np.zeros((r, r)), np.zeros(r), np.zeros((len(residues), r))
    k = 0
    while k < r:
        a, b = poles[k].real, poles[k].imag
        if b == 0.0:
            A[k, k], B[k], C[:, k] = a, 1.0, residues[:, k].real
            k += 1
        else:
            A[k : k + 2, k : k + 2] = [[a, b], [-b, a]]
            B[k] = 1.0
            C[:, k], C[:, k + 1] = 2.0 * residues[:, k].real, 2.0 * residues[:, k].imag
            k += 2
    return A, B, C
