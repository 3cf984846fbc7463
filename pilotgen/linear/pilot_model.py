"""The pilot as a linear system: accelerations of the seat in, rotations of the controls out.

One class for every pilot, multibody or Mayo's, so that nothing behind it cares which one it has:

    H(s) = [(D + C (sI - A)^-1 B) s^(-integrators) + tilt] [s / (s + w_h)]^2,   tilt = F(0)/s^2 + F'(0)/s

A, B, C, D are real and hold the pilot's own modes; free integrators, the terms of a tilt of gravity (rotations of the
seat) and the washout are kept apart because they cancel each other: with a washout no pole is left at s = 0.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

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
VERSION = (2, 0)
_UNNOTICED = 1e-9  # of the largest term: what terms of a response may be left out
INPUT_NAME = "seat_heave_acceleration"
GRIP_OUTPUT = "grip_motion"


@dataclass(frozen=True, eq=False)
class PilotModel:
    """A pilot's feedthrough from k accelerations of the seat to p rotations of the controls.

    Attributes
    ----------
    projection : str
        `exact` (modal formula), `literal` (eq. (31) as printed) or `mayo`.
    A, B, C, D : ndarray, shapes (r, r), (r, k), (p, r), (p, k)
        Real state space of the pilot's own modes; outputs in rad, inputs in m/s^2 or rad/s^2.
    outputs : tuple of str
        `collective_rotation` first (positive = lever up), then cyclic axes if the model has them.
    lever_length_m : float
        Hinge to grip of the collective lever [m]: grip motion = lever_length_m * collective rotation.
    integrators : int
        Free integrators behind the modes: 0 exact, 1 Mayo, 2 literal.
    washout_rad_s : float or None
        Corner w_h of the washout (s/(s+w_h))^2 [rad/s]; None for none.
    translation_error : float or None
        Largest relative violation of the invariance to translations (and rotations, gravity turning along); None where
        there is no multibody model.
    inputs : tuple of str
        `seat_heave_acceleration`, ...; names of `SEAT_MOTIONS` in between.
    tilt : ndarray, shape (p, k, 2), or None
        F(0) and F'(0) of each entry: deflection per angle of tilt, and its rate term; zero for translations and yaw.
    imposed : ImposedMotion or None
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
    inputs: tuple[str, ...] = (INPUT_NAME,)
    tilt: Floats | None = None
    imposed: ImposedMotion | None = field(default=None, repr=False)
    _modal: tuple[Complexes, Complexes] | None = field(default=None, repr=False)

    # ---- poles

    @cached_property
    def _poles_and_residues(self) -> tuple[Complexes, Complexes | None]:
        if self._modal is not None:
            return self._modal
        apart = [poles_and_residues(self.A, column, self.C) for column in self.B.T]
        residues = [found for _, found in apart if found is not None]
        return apart[0][0], np.stack(residues, axis=2) if len(residues) == len(apart) else None

    @property
    def poles(self) -> Complexes:
        """Poles of the pilot's own modes, shape (r,) [rad/s]; integrators and washout are not among them."""
        return self._poles_and_residues[0]

    @property
    def residues(self) -> Complexes | None:
        """Residues of D + C (sI - A)^-1 B, shape (p, r, k); None when A is (nearly) defective."""
        return self._poles_and_residues[1]

    def pole_list(self) -> list[dict[str, float]]:
        """One entry per conjugate pair or real pole: `frequency_hz` = |lam| / 2 pi, `damping` (+-1 for a real pole)."""
        return [
            {"frequency_hz": float(abs(lam) / (2.0 * np.pi)), "damping": float(-lam.real / abs(lam))}
            for lam in self.poles
            if lam.imag >= 0.0
        ]

    def terms(self, output: int = 0) -> dict[str, Any] | None:
        """Response of an output to the first input, without filters, as the terms that count; None without a sum.

        H(s) = (direct + sum_k residues[k] / (s - poles[k])) / s^integrators, where a complex pole stands for its pair.
        Terms are left out, the smallest first, while all that are gone cannot change H by more than `_UNNOTICED` of its
        largest term on the imaginary axis. Numbers as JSON has them: [real, imaginary] in rad/s, and rad/s per m/s^2.
        Rotations of the seat have a `tilt` as well, (tilt[0] + tilt[1] s) / s^2, which comes after the washout.
        """
        residues = self.residues
        if residues is None:
            return None
        counted = self.poles.imag >= 0.0
        poles, factors = self.poles[counted], residues[output, counted, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            size = np.where(poles.imag > 0.0, 2.0, 1.0) * np.abs(factors) / np.abs(poles.real)
        order = np.argsort(size)
        dropped = np.cumsum(size[order]) <= _UNNOTICED * size.max(initial=0.0)
        kept = np.sort(order[~dropped])
        return {
            "poles_rad_s": [[float(pole.real), float(pole.imag)] for pole in poles[kept]],
            "residues": [[float(factor.real), float(factor.imag)] for factor in factors[kept]],
            "direct": float(self.D[output, 0]),
            "integrators": self.integrators,
            **({} if self.tilt is None or not self.tilt[output, 0].any() else {"tilt": self.tilt[output, 0].tolist()}),
        }

    def dominant_pole(self, output: int = 0) -> complex:
        """The oscillatory pole of largest residue in an output [rad/s], the collective; a real one if none oscillates.

        EvaluationError if there is no pole.
        """
        if len(self.poles) == 0:
            raise EvaluationError("feedthrough", "the pilot has no mode: nothing moves, or only parts without mass")
        residues = self.residues
        weight = np.ones(len(self.poles)) if residues is None else np.abs(residues[output, :, 0])
        oscillates = self.poles.imag > 0.0
        if oscillates.any():
            weight = np.where(oscillates, weight, -1.0)
        return complex(self.poles[int(np.argmax(weight))])

    def dominant_pair(self, output: int = 0) -> tuple[float, float]:
        """Natural frequency [Hz] and damping ratio of the dominant pole."""
        lam = self.dominant_pole(output)
        return abs(lam) / (2.0 * np.pi), -lam.real / abs(lam)

    # ---- frequency response

    def response(self, omega: ArrayLike, output: int = 0, washout: bool = True, input: int = 0) -> Complexes:
        """Return H(j omega) of one output by one input [rad per m/s^2 or rad/s^2].

        Parameters
        ----------
        omega : array_like
            Angular frequencies [rad/s], any shape.
        output : int
            Which of `outputs`.
        washout : bool
            False leaves out the washout: the pilot's body alone.
        input : int
            Which of `inputs`.
        """
        w = np.asarray(omega, dtype=float)
        s = 1j * w.reshape(-1)
        poles, residues = self._poles_and_residues
        if residues is not None:
            H = (1.0 / (s[:, None] - poles)) @ residues[output, :, input] + self.D[output, input]
        else:
            resolvent = s[:, None, None] * np.eye(len(self.A)) - self.A
            inputs = np.broadcast_to(self.B[:, input : input + 1], (len(s), len(self.B), 1))
            H = np.linalg.solve(resolvent, inputs)[:, :, 0] @ self.C[output] + self.D[output, input]
        corner = self.washout_rad_s if washout else None
        if corner is None:
            H = H / s**self.integrators if self.integrators else H
        else:
            H = H * s ** (2 - self.integrators) / (s + corner) ** 2
        if self.tilt is not None and self.tilt[output, input].any():
            standing, rate = self.tilt[output, input]
            H = H + (standing + rate * s) / (s + (0.0 if corner is None else corner)) ** 2
        response: Complexes = H.reshape(w.shape)
        return response

    def grip_motion(self, omega: ArrayLike, washout: bool = False) -> Complexes:
        """Return the motion of the collective grip [m per m/s^2], by default without washout, as measured on people."""
        return self.lever_length_m * self.response(omega, 0, washout)

    def partial_fractions(self, output: int = 0, input: int = 0) -> PartialFractions | None:
        """One entry with its filters as a sum of partial fractions; None where it has no such form."""
        poles, residues = self._poles_and_residues
        tilts = self.tilt is not None and bool(self.tilt[output, input].any())
        if residues is None or (self.washout_rad_s is None and (self.integrators or tilts)):
            return None
        own = PartialFractions(poles, residues[output, :, input].astype(np.complex128), float(self.D[output, input]))
        if self.washout_rad_s is None:
            return own
        whole = own.times(washout(self.washout_rad_s, self.integrators))
        if whole is None or self.tilt is None or not tilts:
            return whole
        standing, rate = self.tilt[output, input]  # (F(0) + F'(0) s) / (s + w)^2, whose double pole comes first
        residues = whole.residues.copy()
        residues[0] += rate
        return PartialFractions(
            whole.poles, residues, whole.D, whole.second + complex(standing - rate * self.washout_rad_s)
        )

    # ---- state space

    def state_space(
        self, outputs: Sequence[int] | None = None, washout: bool = True
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Return real A (n, n), B (n, k), C (p, n), D (p, k) of the whole model, filters included.

        Parameters
        ----------
        outputs : sequence of int, optional
            Which of `outputs`; by default the collective rotation alone.
        washout : bool
            False leaves out the washout.

        The filters come first, those of each input in turn: two sections in series, or two integrators for a tilt
        without washout; then the pilot's modes.
        """
        chosen = [0] if outputs is None else list(outputs)
        corner = self.washout_rad_s if washout else None
        r, k = self.B.shape
        # sections of an input: corner, and whether it passes s/(s+w) (where no integrator cancels its zero) or 1/(s+w)
        if corner is not None:
            sections = [[(corner, i >= self.integrators) for i in range(2)]] * k
        else:
            sections = [[(0.0, False)] * self.integrators] * k
        tilted = [self.tilt is not None and bool(self.tilt[chosen, j].any()) for j in range(k)]
        extra = [2 if tilted[j] and corner is None else 0 for j in range(k)]
        first = np.concatenate(([0], np.cumsum([len(sections[j]) + extra[j] for j in range(k)])))
        n_f = int(first[-1])
        A, B = np.zeros((n_f + r, n_f + r)), np.zeros((n_f + r, k))
        C, D = np.zeros((len(chosen), n_f + r)), np.zeros((len(chosen), k))
        A[n_f:, n_f:] = self.A
        for j in range(k):
            # what reaches the modes: `row` of the filter states plus `through` times the input
            row, through = np.zeros(n_f + r), 1.0
            for i, (w, high_pass) in enumerate(sections[j], start=int(first[j])):
                # x' = u - w x; the section passes u - w x (= s/(s+w) u) or x (= 1/(s+w) u)
                A[i] = row
                A[i, i] -= w
                B[i, j] = through
                if high_pass:
                    row = row.copy()
                    row[i] -= w
                else:
                    row, through = np.zeros(n_f + r), 0.0
                    row[i] = 1.0
            A[n_f:] += np.outer(self.B[:, j], row)
            B[n_f:, j] = self.B[:, j] * through
            C += np.outer(self.D[chosen, j], row)
            D[:, j] = self.D[chosen, j] * through
            if tilted[j] and self.tilt is not None:
                standing, rate = self.tilt[chosen, j].T
                x = int(first[j])
                if corner is None:  # rate and angle of the tilt: two integrators
                    B[x, j], A[x + 1, x] = 1.0, 1.0
                    C[:, x] += rate
                    C[:, x + 1] += standing
                else:  # the sections hold x_1 = u/(s+w) and x_2 = s u/(s+w)^2
                    C[:, x] += standing / corner
                    C[:, x + 1] += rate - standing / corner
        C[:, n_f:] += self.C[chosen]
        return A, B, C, D

    def all_outputs(self, washout: bool) -> tuple[Floats, Floats, Floats, Floats, list[str], list[str]]:
        """Return the state space with every output and the grip motion, their names and units."""
        from pilotgen.linear.imposed_motion import output_unit

        A, B, C, D = self.state_space(range(len(self.outputs)), washout)
        C, D = np.vstack([C, self.lever_length_m * C[0]]), np.vstack([D, self.lever_length_m * D[0]])
        return A, B, C, D, [*self.outputs, GRIP_OUTPUT], [*map(output_unit, self.outputs), "m"]

    @property
    def input_units(self) -> tuple[str, ...]:
        """Units of the inputs."""
        return tuple("rad/s^2" if name.split("_")[1] in ("roll", "pitch", "yaw") else "m/s^2" for name in self.inputs)

    def to_control(self, washout: bool = True) -> control.StateSpace:
        """Return a `control.StateSpace` with named signals: accelerations in, rotations and grip motion out."""
        import control

        A, B, C, D, names, _ = self.all_outputs(washout)
        return control.ss(A, B, C, D, inputs=list(self.inputs), outputs=names, name=f"pilot_{self.projection}")

    # ---- file

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the model as HDF5 (docs/io_formats/pilot_model.md), replacing the file; FileError if that fails."""
        A, B, C, D, names, units = self.all_outputs(washout=True)
        with NewFile(path, FILETYPE, VERSION) as new:
            file = new.file
            file.attrs["projection"] = np.bytes_(self.projection)
            for name, value in (("A", A), ("B", B), ("C", C), ("D", D)):
                file[name] = value
            file["inputs/name"], file["inputs/unit"] = np.array(self.inputs, "S"), np.array(self.input_units, "S")
            file["outputs/name"], file["outputs/unit"] = np.array(names, "S"), np.array(units, "S")
            file["poles"] = np.column_stack([self.poles.real, self.poles.imag])
            for name, value in (("A", self.A), ("B", self.B), ("C", self.C), ("D", self.D)):
                file[f"modes/{name}"] = value
            file["modes/tilt"] = np.zeros((*self.D.shape, 2)) if self.tilt is None else self.tilt
            file["integrators"] = self.integrators
            file["lever_length_m"] = self.lever_length_m
            file["washout_rad_s"] = np.nan if self.washout_rad_s is None else self.washout_rad_s
            file["translation_error"] = np.nan if self.translation_error is None else self.translation_error


def read_pilot_model(path: str | os.PathLike[str]) -> PilotModel:
    """Read a pilot model file; FileError if it cannot be opened, MatrixError if it is not one or is damaged."""
    with opened(path, FILETYPE, VERSION, MatrixError) as file:
        parts = {name: np.asarray(file[f"modes/{name}"][()], dtype=float) for name in (*"ABCD", "tilt")}
        numbers = {
            name: float(file[name][()])
            for name in ("integrators", "lever_length_m", "washout_rad_s", "translation_error")
        }
        names = tuple(text(name) for name in file["outputs/name"][()])
        inputs = tuple(text(name) for name in file["inputs/name"][()])
        r, outputs = len(np.atleast_1d(parts["B"])), tuple(name for name in names if name != GRIP_OUTPUT)
        p, k = len(outputs), len(inputs)
        shapes = {"A": (r, r), "B": (r, k), "C": (p, r), "D": (p, k), "tilt": (p, k, 2)}
        for name, shape in shapes.items():
            if parts[name].shape != shape or not np.isfinite(parts[name]).all():
                raise MatrixError(
                    f"{os.fspath(path)}: dataset 'modes/{name}' must have shape {shape} and finite numbers"
                )
        return PilotModel(
            projection=text(file.attrs["projection"]) if "projection" in file.attrs else "exact",
            inputs=inputs,
            outputs=outputs,
            tilt=parts["tilt"] if parts["tilt"].any() else None,
            lever_length_m=numbers["lever_length_m"],
            integrators=int(numbers["integrators"]),
            washout_rad_s=None if np.isnan(numbers["washout_rad_s"]) else numbers["washout_rad_s"],
            translation_error=None if np.isnan(numbers["translation_error"]) else numbers["translation_error"],
            A=parts["A"],
            B=parts["B"],
            C=parts["C"],
            D=parts["D"],
        )


def real_blocks(poles: Complexes, left: Complexes, right: Complexes) -> tuple[Floats, Floats, Floats]:
    """Return real A, B, C with C (sI - A)^-1 B = sum_k left[:, k] right[k] / (s - poles[k]).

    Poles come as conjugate pairs side by side (positive imaginary part first) or real, shape (r,); left (p, r) and
    right (r, m) with the conjugate of each pair's first member as its second. A pair becomes the block
    [[a, b], [-b, a]].
    """
    A, B, C = np.diag(poles.real), right.real.copy(), left.real.copy()
    first = np.flatnonzero(poles.imag > 0.0)
    second = first + 1
    A[first, second], A[second, first] = poles.imag[first], -poles.imag[first]
    B[second] = -right[first].imag
    C[:, first], C[:, second] = 2.0 * left[:, first].real, 2.0 * left[:, first].imag
    return A, B, C
