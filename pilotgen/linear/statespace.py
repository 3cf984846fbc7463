"""Small real single-input single-output state-space models, and their frequency response.

The response goes through the Schur form of A, which exists and is computed stably for every matrix. An eigenvector
(modal) form is not used: the washout filter's double pole has no full set of eigenvectors.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy.linalg
from scipy.linalg import lapack

from pilotgen.errors import PilotgenError

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

_EPS = float(np.finfo(float).eps)


def _unsorted(_: complex) -> None:
    """What LAPACK wants to be given where eigenvalues may stand in any order."""


@dataclass(frozen=True)
class SchurForm:
    """x' = T x + b u, y = c x + D u with T upper triangular (complex), and the sizes that bound its round-off."""

    T: ComplexArray
    b: ComplexArray
    c: ComplexArray


@dataclass(frozen=True, eq=False)
class StateSpaceModel:
    """x' = A x + B u, y = C x + D u with one input and one output.

    Parameters
    ----------
    A : array, shape (n, n)
        In 1/s when the states are scaled alike; n may be 0 (a constant).
    B, C : array, n elements
        Any shape with n elements is accepted; kept as shape (n,).
    D : float or array with one element
        Direct term.

    Raises
    ------
    PilotgenError
        Shapes that do not fit together, or a value that is not finite.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: float

    def __post_init__(self) -> None:
        A = np.ascontiguousarray(self.A, dtype=float)
        if A.size == 0:
            A = A.reshape(0, 0)
        B = np.ascontiguousarray(self.B, dtype=float).reshape(-1)
        C = np.ascontiguousarray(self.C, dtype=float).reshape(-1)
        D = np.asarray(self.D, dtype=float).reshape(-1)
        if A.ndim != 2 or A.shape[0] != A.shape[1] or B.size != A.shape[0] or C.size != A.shape[0] or D.size != 1:
            raise PilotgenError(
                f"a single-input single-output state space needs A (n, n), B (n), C (n) and one D; got A {A.shape}, "
                f"B {np.shape(self.B)}, C {np.shape(self.C)}, D {np.shape(self.D)}"
            )
        # One sum tells whether anything is NaN or infinite; finite entries cannot overflow it in practice.
        if not math.isfinite(float(A.sum() + B.sum() + C.sum() + D[0])):
            raise PilotgenError("a state space matrix holds a value that is not finite (NaN, infinite or overflowing)")
        object.__setattr__(self, "A", A)
        object.__setattr__(self, "B", B)
        object.__setattr__(self, "C", C)
        object.__setattr__(self, "D", float(D[0]))

    @property
    def n_states(self) -> int:
        """Number of states."""
        return int(self.A.shape[0])

    @cached_property
    def schur(self) -> SchurForm:
        """Complex Schur form of the balanced model (same response)."""
        n = self.n_states
        if n == 0:
            empty = np.zeros(0, dtype=complex)
            return SchurForm(np.zeros((0, 0), dtype=complex), empty, empty)
        # The permutation brings out integrators and other isolated poles exactly; powers of two scale the rest.
        A, S = scipy.linalg.matrix_balance(self.A)
        T, _, _, U, _, failed = lapack.zgees(_unsorted, A)  # directly: the wrapper costs as much again
        if failed:
            raise PilotgenError("the Schur form of a state space does not converge")
        return SchurForm(T, U.conj().T @ ((self.B @ S) / (S * S).sum(axis=0)), (self.C @ S) @ U)

    @cached_property
    def poles(self) -> ComplexArray:
        """Eigenvalues of A, shape (n,) [rad/s], by rising modulus."""
        lam = np.linalg.eigvals(self.A).astype(complex)
        return lam[np.argsort(np.abs(lam), kind="stable")]

    def response(self, omega: npt.ArrayLike) -> ComplexArray:
        """H(j omega) = D + C (j omega I - A)^-1 B.

        Parameters
        ----------
        omega : array_like
            Angular frequencies [rad/s], any shape.

        Returns
        -------
        ndarray
            Complex response, the shape of `omega`; not finite exactly at a pole.
        """
        w = np.asarray(omega, dtype=float)
        return (self.D + self._solve(1j * w.reshape(-1))).reshape(w.shape)

    def at(self, s: npt.ArrayLike) -> ComplexArray:
        """H(s) at complex frequencies s [rad/s], any shape."""
        z = np.asarray(s, dtype=complex)
        return (self.D + self._solve(z.reshape(-1))).reshape(z.shape)

    def _solve(self, s: ComplexArray) -> ComplexArray:
        form = self.schur
        x = np.empty((self.n_states, s.size), dtype=complex)
        with np.errstate(divide="ignore", invalid="ignore"):
            for k in range(self.n_states - 1, -1, -1):
                x[k] = (form.b[k] + form.T[k, k + 1 :] @ x[k + 1 :]) / (s - form.T[k, k])
            return np.asarray(form.c @ x)

    def scaled(self, gain: float) -> StateSpaceModel:
        """The model with its output multiplied by `gain`."""
        return StateSpaceModel(self.A, self.B, self.C * gain, self.D * gain)

    def feedback(self) -> StateSpaceModel:
        """Unity negative feedback, H / (1 + H).

        Raises
        ------
        PilotgenError
            1 + D = 0: the loop is ill-posed.
        """
        gain = 1.0 + self.D
        if gain == 0.0:
            raise PilotgenError("the feedback loop is ill-posed: its direct term is exactly -1")
        return StateSpaceModel(self.A - np.outer(self.B, self.C) / gain, self.B / gain, self.C / gain, self.D / gain)


def series(first: StateSpaceModel, second: StateSpaceModel) -> StateSpaceModel:
    """`second` fed by the output of `first`; states [first, second]."""
    n, m = first.n_states, second.n_states
    A = np.zeros((n + m, n + m))
    A[:n, :n] = first.A
    A[n:, n:] = second.A
    A[n:, :n] = second.B[:, None] * first.C
    B = np.concatenate((first.B, second.B * first.D))
    C = np.concatenate((second.D * first.C, second.C))
    return StateSpaceModel(A, B, C, second.D * first.D)


def transfer_function(numerator: Sequence[float], denominator: Sequence[float]) -> StateSpaceModel:
    """State space (controllable canonical form) of a proper transfer function.

    Parameters
    ----------
    numerator, denominator : sequence of float
        Coefficients of falling powers of s.

    Raises
    ------
    PilotgenError
        The denominator is zero or of lower degree than the numerator.
    """
    num = np.trim_zeros(np.asarray(numerator, dtype=float), "f")
    den = np.trim_zeros(np.asarray(denominator, dtype=float), "f")
    if den.size == 0 or num.size > den.size:
        raise PilotgenError(
            f"a proper transfer function needs a denominator of at least the numerator's degree; got degrees "
            f"{num.size - 1} over {den.size - 1}"
        )
    n = den.size - 1
    num = np.concatenate((np.zeros(n + 1 - num.size), num)) / den[0]
    den = den / den[0]
    A = np.zeros((n, n))
    A[1:, :-1] = np.eye(max(n - 1, 0))
    A[:1] = -den[1:]
    B = np.zeros(n)
    B[:1] = 1.0
    return StateSpaceModel(A, B, num[1:] - num[0] * den[1:], float(num[0]))


def zeros_poles_gain(zeros: Sequence[complex], poles: Sequence[complex], gain: float) -> StateSpaceModel:
    """State space of gain prod(s - zeros) / prod(s - poles), built pair by pair (well scaled at any order).

    Complex zeros and poles come as conjugate pairs [rad/s], both members given.

    Raises
    ------
    PilotgenError
        More zeros than poles, or complex values without their conjugates.
    """
    if len(zeros) > len(poles):
        raise PilotgenError(f"a proper model has no more zeros than poles; got {len(zeros)} over {len(poles)}")
    pole_blocks, zero_blocks = _real_factors(poles), _real_factors(zeros)
    # Second-order numerators need second-order denominators; two real poles or zeros make such a block too.
    model = StateSpaceModel(np.zeros((0, 0)), np.zeros(0), np.zeros(0), gain)
    numerators = [np.atleast_1d(z) for z in zero_blocks]
    for den in pole_blocks:
        fitting = [i for i, num in enumerate(numerators) if num.size <= den.size]
        num = numerators.pop(fitting[0]) if fitting else np.ones(1)
        model = series(model, transfer_function(num.tolist(), den.tolist()))
    if numerators:
        raise PilotgenError("these zeros and poles do not pair into proper second-order sections")
    return model


def _real_factors(roots: Sequence[complex]) -> list[FloatArray]:
    """Real quadratics of conjugate pairs and of real roots two by two; one linear factor if a real root is left."""
    upper = [r for r in roots if r.imag > 0.0]
    lower = [r for r in roots if r.imag < 0.0]
    real = [float(r.real) for r in roots if r.imag == 0.0]
    if sorted((r.real, r.imag) for r in upper) != sorted((r.real, -r.imag) for r in lower):
        raise PilotgenError("complex zeros and poles must come in conjugate pairs")
    factors = [np.array([1.0, -2.0 * r.real, abs(r) ** 2]) for r in upper]
    factors += [np.array([1.0, -a - b, a * b]) for a, b in zip(real[0::2], real[1::2], strict=False)]
    if len(real) % 2:
        factors.append(np.array([1.0, -real[-1]]))
    return factors
