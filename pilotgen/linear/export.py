"""A pilot's feedthrough for other programs: named state space, reduced if wanted, and frequency response tables.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg

from pilotgen.errors import PilotgenError, StudyError
from pilotgen.linear.pilot_model import PilotModel
from pilotgen.solver.descriptor import Complexes, Floats

FILETYPE, VERSION = "pilotgen exported pilot", "1.0"
FRF_HZ = (0.1, 20.0)
FRF_POINTS = 400


@dataclass(frozen=True, eq=False)
class NamedStateSpace:
    """x' = A x + B u, y = C x + D u with names and units of its signals.

    Attributes
    ----------
    A, B, C, D : ndarray, shapes (n, n), (n, k), (p, n), (p, k)
        SI units, time in seconds.
    inputs, input_units, outputs, output_units : tuple of str
        Of the signals.
    error : float
        Of a reduced model: largest singular value of its difference from the whole one, over the largest of the whole
        one, 0.01 to 100 Hz; 0 for the whole model.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    inputs: tuple[str, ...]
    input_units: tuple[str, ...]
    outputs: tuple[str, ...]
    output_units: tuple[str, ...]
    error: float = 0.0

    def response(self, omega: Floats) -> Complexes:
        """H(j omega), shape (m, p, k), omega (m,) in rad/s."""
        s = 1j * np.asarray(omega, dtype=float)[:, None, None]
        inputs = np.broadcast_to(self.B.astype(np.complex128), (len(s), *self.B.shape))
        states: Complexes = np.linalg.solve(s * np.eye(len(self.A)) - self.A, inputs).astype(np.complex128)
        return self.C @ states + self.D


def named(model: PilotModel, washout: bool = True) -> NamedStateSpace:
    """The whole pilot with every output and the grip's motion."""
    A, B, C, D, names, units = model.all_outputs(washout)
    return NamedStateSpace(A, B, C, D, model.inputs, model.input_units, tuple(names), tuple(units))


def reduced(model: NamedStateSpace, order: int | None = None, tolerance: float | None = None) -> NamedStateSpace:
    """Balanced truncation to `order` states, or to the fewest whose measured error is at most `tolerance`.

    Raises
    ------
    StudyError
        Both or none of the two are given, or one is out of range.
    PilotgenError
        The model is not stable (an unstable pilot, or free integrators): it has no Gramians.
    """
    n = len(model.A)
    if (order is None) == (tolerance is None):
        raise StudyError("a reduction takes either an order or a tolerance")
    if order is not None and not 1 <= order <= n:
        raise StudyError(f"order = {order} is outside 1 to {n}, the states of the whole model")
    if tolerance is not None and not 0.0 < tolerance < 1.0:
        raise StudyError(f"tolerance = {tolerance:g} is outside 0 to 1; it is relative to the largest gain")
    largest = float(np.linalg.eigvals(model.A).real.max())
    if not largest < 0.0:
        raise PilotgenError(
            f"a balanced reduction needs a stable model; this one has an eigenvalue with real part {largest:.3g} 1/s "
            "(without washout a tilt and Mayo's pilots have integrators)"
        )
    # square roots of the Gramians; small negative eigenvalues of the rank-deficient ones are round-off
    P = scipy.linalg.solve_continuous_lyapunov(model.A, -model.B @ model.B.T)
    Q = scipy.linalg.solve_continuous_lyapunov(model.A.T, -model.C.T @ model.C)
    R, L = _root(P), _root(Q)
    U, sigma, V = np.linalg.svd(L.T @ R)
    omega = 2.0 * np.pi * np.geomspace(0.01, 100.0, 400)
    whole = model.response(omega)
    top = float(np.linalg.svd(whole, compute_uv=False)[:, 0].max())
    orders = [order] if order is not None else list(range(1, n + 1))
    for r in orders:
        assert r is not None
        if sigma[r - 1] <= sigma[0] * np.finfo(float).eps:
            break
        scale = 1.0 / np.sqrt(sigma[:r])
        into, out = scale[:, None] * (U[:, :r].T @ L.T), (R @ V[:r].T) * scale
        small = NamedStateSpace(
            into @ model.A @ out, into @ model.B, model.C @ out, model.D,
            model.inputs, model.input_units, model.outputs, model.output_units,
        )  # fmt: skip
        error = float(np.linalg.svd(small.response(omega) - whole, compute_uv=False)[:, 0].max()) / top
        if order is not None or (tolerance is not None and error <= tolerance):
            return NamedStateSpace(**{**vars(small), "error": error})
    return model


def _root(gramian: Floats) -> Floats:
    values, vectors = np.linalg.eigh(0.5 * (gramian + gramian.T))
    root: Floats = vectors * np.sqrt(np.maximum(values, 0.0))
    return root


# ---- formats


def state_space_object(model: NamedStateSpace) -> dict[str, Any]:
    """JSON-able: matrices as lists of rows, signals with names and units."""
    return {
        "filetype": FILETYPE,
        "version": VERSION,
        "inputs": [{"name": n, "unit": u} for n, u in zip(model.inputs, model.input_units, strict=True)],
        "outputs": [{"name": n, "unit": u} for n, u in zip(model.outputs, model.output_units, strict=True)],
        **{name: getattr(model, name).tolist() for name in "ABCD"},
        "reduction_error": model.error,
    }


def as_mat(model: NamedStateSpace) -> bytes:
    """A MATLAB 5 file with A, B, C, D and cell arrays of names and units."""
    import scipy.io

    def cell(texts: tuple[str, ...]) -> Any:
        array = np.empty((len(texts), 1), dtype=object)
        array[:, 0] = texts
        return array

    buffer = io.BytesIO()
    scipy.io.savemat(
        buffer,
        {
            **{name: getattr(model, name) for name in "ABCD"},
            "input_names": cell(model.inputs),
            "input_units": cell(model.input_units),
            "output_names": cell(model.outputs),
            "output_units": cell(model.output_units),
            "reduction_error": model.error,
        },
        oned_as="column",
    )
    return buffer.getvalue()


def as_table(model: NamedStateSpace) -> str:
    """Frequency response as CSV: `frequency_hz`, then real and imaginary part of every entry, 17 digits."""
    hz = np.geomspace(*FRF_HZ, FRF_POINTS)
    H = model.response(2.0 * np.pi * hz)
    header, columns = ["frequency_hz"], [hz]
    for i, (output, unit) in enumerate(zip(model.outputs, model.output_units, strict=True)):
        for j, (put_in, per) in enumerate(zip(model.inputs, model.input_units, strict=True)):
            for part, value in (("real", H[:, i, j].real), ("imag", H[:, i, j].imag)):
                header.append(f"{output}/{put_in} {part} [{unit}/({per})]")
                columns.append(value)
    rows = [",".join(f"{value:.17g}" for value in row) for row in np.column_stack(columns)]
    return "\n".join([",".join(header), *rows]) + "\n"
