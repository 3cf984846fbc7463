"""Finite, nonzero eigenvalues of a descriptor model with its right and left vectors.

The pencil (lam g_ydot + g_y) V_R = 0 of a constrained multibody model has mostly infinite eigenvalues. They are removed
exactly before any eigenvalue is computed: momenta are replaced by their definitions, coordinates are restricted to the
null space of the constraints, equations to the null space of the reactions. What is left is a small dense problem
(4 x 4 for one arm on a lever). Theory: docs/theory/projection.md.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.linalg import lapack

from pilotgen.errors import MatrixError
from pilotgen.linear.null_space import RANK_TOLERANCE, RangeSolver, condition, inverse_if_sound, null_space
from pilotgen.linear.second_order import FORM_TOLERANCE, SecondOrderForm, second_order_form
from pilotgen.solver.descriptor import Complexes, DescriptorModel, Floats, Numbers

# An eigenvalue may be zero or infinite when it is this small, or 1 / this large, against the scale of the others.
# Double zeros (rigid motion) come out near sqrt(eps) = 1.5e-8, so does 1/lam of a massless direction (index 2).
_NEGLIGIBLE = 1e-6
# It is zero if its motion meets no stiffness: forces this small against stiffness times motion, in scaled coordinates.
_NO_STIFFNESS = 1e-11
# A direction has no mass if its row of the mass matrix is this small against the largest.
_NO_MASS = 1e-13
# Eigenvectors are used as a basis while their condition number is below this; beyond, a real basis takes their place.
_MAX_CONDITION = 1e5


@dataclass(frozen=True, eq=False)
class ModalModel:
    """The retained modes: V_L g_ydot V_R = I, V_L g_y V_R = -A.

    Attributes
    ----------
    lam : ndarray of complex, shape (r,)
        Retained eigenvalues [rad/s]: finite and nonzero, conjugate pairs side by side, positive imaginary part first.
    A : ndarray, shape (r, r)
        diag(lam) if `diagonal`; otherwise real, with eigenvalues lam, and V_R, V_L are real bases.
    diagonal : bool
        False when the eigenvectors are too close to dependent (defective or nearly so) to serve as a basis.
    n_zero, n_infinite : int
        Eigenvalues set aside in the reduced problem: zero (rigid motion) and infinite (directions without mass).
    V_R : ndarray, shape (n, r)
        Right vectors of all unknowns, reactions included.
    V_L : ndarray, shape (r, n)
        Left vectors of all equations.
    """

    lam: Complexes
    A: Numbers
    diagonal: bool
    n_zero: int
    n_infinite: int
    _reduced: _ReducedVectors = field(repr=False)

    @property
    def frequency_hz(self) -> Floats:
        """Natural frequencies |lam| / 2 pi [Hz]."""
        return np.asarray(np.abs(self.lam) / (2.0 * np.pi))

    @property
    def damping(self) -> Floats:
        """Damping ratios -Re lam / |lam|; +-1 for real eigenvalues."""
        return -self.lam.real / np.abs(self.lam)

    @cached_property
    def V_R(self) -> Numbers:
        """Right vectors, worked out when asked for."""
        return self._pairs(self._reduced.right_vectors().T).T

    @cached_property
    def V_L(self) -> Numbers:
        """Left vectors, worked out when asked for."""
        return self._pairs(self._reduced.left_vectors())

    def driven_by(self, columns: Floats) -> Numbers:
        """V_L times columns, shape (n, k), without working V_L out."""
        return self._pairs(self._reduced.driven_by(columns))

    def watched_by(self, rows: Floats) -> Numbers:
        """Rows, shape (p, n), times V_R; without working V_R out where they watch coordinates alone."""
        found = self._reduced.watched_by(rows)
        return rows @ self.V_R if found is None else self._pairs(found.T).T

    def _pairs(self, of_firsts: Numbers) -> Numbers:
        """Rows of all modes from those of the first of each conjugate pair."""
        if not self.diagonal:
            return of_firsts
        rows = np.empty((len(self.lam), *of_firsts.shape[1:]), dtype=np.complex128)
        rows[self.lam.imag >= 0.0] = of_firsts
        second = np.flatnonzero(self.lam.imag < 0.0)  # right after the first
        rows[second] = rows[second - 1].conj()
        return rows


def modes(model: DescriptorModel, form: SecondOrderForm | None = None) -> ModalModel:
    """Return the modes of finite, nonzero eigenvalue, scaled so that V_L g_ydot V_R = I (paper eq. (16)-(22)).

    Redundant constraints, repeated and defective eigenvalues, velocity-type constraints and directions without mass are
    allowed; docs/theory/projection.md says how each is treated.

    Parameters
    ----------
    model : DescriptorModel
        The model.
    form : SecondOrderForm, optional
        Its second-order form, if it is at hand.

    Raises
    ------
    MatrixError
        If the pencil is not that of a multibody model, or if it is singular (a motion that no equation determines).
    """
    form = second_order_form(model) if form is None else form
    velocity = np.abs(form.Phi_1).max(axis=1, initial=0.0) > FORM_TOLERANCE
    N_R, constraint_solver = null_space(form.Phi_0[~velocity])
    N_L, reaction_solver = null_space(form.B.T)

    E, F, X_R = _reduced_pencil(form, N_R, N_L, velocity)
    if E.shape[0] != E.shape[1]:
        raise MatrixError(
            f"the constraints leave {E.shape[1]} first-order unknowns, the reactions {E.shape[0]} equations; "
            "each constraint equation must have a reaction of its own"
        )
    n_z = N_R.shape[1]

    def rigid(u: Numbers) -> NDArray[np.bool_]:
        z = u[:n_z] if X_R is None else X_R[:n_z] @ u
        return _without_stiffness(np.vstack([N_L.T @ form.K @ N_R, form.Phi_0[velocity] @ N_R]), z)

    basis, cobasis, A, n_zero, n_infinite, solved = _deflate(E, F, rigid, 0 if velocity.any() else n_z)
    lam, right, left = _diagonalise(basis, cobasis[:, n_z:], A, solved)
    diagonal = right is not None
    if right is None or left is None:
        right, left = basis, cobasis[:, n_z:]
    reduced = _ReducedVectors(
        size=len(model.names),
        model=model,
        form=form,
        velocity=velocity,
        Z=right[:n_z] if X_R is None else _product(X_R[:n_z], right),
        W=left,
        N_R=N_R,
        N_L=N_L,
        A=lam[lam.imag >= 0.0] if diagonal else A,
        constraint_solver=constraint_solver,
        reaction_solver=reaction_solver,
    )
    return ModalModel(lam, np.diag(lam) if diagonal else A, diagonal, n_zero, n_infinite, reduced)


@dataclass(frozen=True, eq=False)
class _ReducedVectors:
    """Right and left vectors in the null spaces, and the way back to all unknowns and equations.

    Of a conjugate pair there is the first only. Attributes are N_R Z, coordinates of the right vectors (n_q, m); W of
    W N_L^T, equilibrium equations of the left vectors (m, n_q); A, their eigenvalues (m,), or a matrix (m, m).
    """

    size: int
    model: DescriptorModel
    form: SecondOrderForm
    velocity: NDArray[np.bool_]
    Z: Numbers
    W: Numbers
    N_R: Floats
    N_L: Floats
    A: Numbers
    constraint_solver: RangeSolver
    reaction_solver: RangeSolver

    def _advanced(self, X: Numbers) -> Numbers:
        """X A."""
        product: Numbers = X * self.A if self.A.ndim == 1 else X @ self.A
        return product

    def _advanced_rows(self, X: Numbers) -> Numbers:
        """A X."""
        product: Numbers = self.A[:, None] * X if self.A.ndim == 1 else self.A @ X
        return product

    def right_vectors(self) -> Numbers:
        """All unknowns, shape (n, m)."""
        model, form = self.model, self.form
        Q = _product(self.N_R, self.Z)
        QA = self._advanced(Q)
        V_R = np.zeros((self.size, Q.shape[1]), dtype=Q.dtype)
        V_R[model.coordinates] = Q
        V_R[model.momenta] = _product(form.momentum_mass, QA) + _product(form.momentum_gyro, Q)
        forces = _product(form.M, self._advanced(QA)) + _product(form.C, QA) + _product(form.K, Q)
        V_R[model.reactions] = -self.reaction_solver.solve(forces)
        return V_R

    def left_vectors(self) -> Numbers:
        """All equations, shape (m, n)."""
        model, form = self.model, self.form
        W = _product(self.N_L, self.W.T).T
        AW = self._advanced_rows(W)
        V_L = np.zeros((len(W), self.size), dtype=W.dtype)
        V_L[:, model.equilibrium_rows] = W
        V_L[:, model.definition_rows] = AW[:, form.dynamic] + _product(form.momentum_force.T, W.T).T
        # what the equilibrium and definition rows leave over, for the constraint rows to cancel
        residual = (
            self._advanced_rows(_product(form.M.T, AW.T).T) + _product(form.C.T, AW.T).T + _product(form.K.T, W.T).T
        )
        if self.velocity.any():
            A = np.diag(self.A) if self.A.ndim == 1 else self.A
            V_L[:, model.reactions] = _velocity_constraint_rows(form, A, residual)
        else:
            V_L[:, model.reactions] = -self.constraint_solver.solve(residual.T).T
        return V_L

    def driven_by(self, columns: Floats) -> Numbers:
        """Left vectors times columns, shape (m, k): A^2 W M y + A W (C y - d) + W (K y - e), from the right."""
        if self.velocity.any():
            product: Numbers = self.left_vectors() @ columns
            return product
        model, form = self.model, self.form
        of_definitions = columns[model.definition_rows]
        y = self.constraint_solver.solve_transposed(columns[model.reactions])
        by_W = columns[model.equilibrium_rows] + form.momentum_force @ of_definitions - form.K @ y
        by_AW = -form.C @ y
        by_AW[form.dynamic] += of_definitions
        parts = self.W @ (self.N_L.T @ np.concatenate((by_W, by_AW, -form.M @ y), axis=1))
        k = columns.shape[1]
        twice: Numbers = parts[:, k : 2 * k] + self._advanced_rows(parts[:, 2 * k :])
        return parts[:, :k] + self._advanced_rows(twice)

    def watched_by(self, rows: Floats) -> Numbers | None:
        """Rows times right vectors, shape (p, m); None where they watch something else than coordinates."""
        of_coordinates = rows[:, self.model.coordinates]
        if np.count_nonzero(of_coordinates) < np.count_nonzero(rows):
            return None
        product: Numbers = (of_coordinates @ self.N_R) @ self.Z
        return product


# ---- the reduction


def _reduced_pencil(
    form: SecondOrderForm, N_R: Floats, N_L: Floats, velocity: NDArray[np.bool_]
) -> tuple[Floats, Floats, Floats | None]:
    """Return E, F of lam E + F on [z; zdot] = X_R u, where q = N_R z: rows are z' = zdot and N_L^T (equilibrium).

    X_R is None, for the identity, without velocity-type constraints.
    """
    n_z, n_w = N_R.shape[1], N_L.shape[1]
    E, F = np.zeros((n_z + n_w, 2 * n_z)), np.zeros((n_z + n_w, 2 * n_z))
    E[:n_z, :n_z] = np.eye(n_z)
    E[n_z:, n_z:] = N_L.T @ (form.M @ N_R)
    F[:n_z, n_z:] = -np.eye(n_z)
    F[n_z:, :n_z] = N_L.T @ (form.K @ N_R)
    F[n_z:, n_z:] = N_L.T @ (form.C @ N_R)
    if not velocity.any():
        return E, F, None
    X_R, _ = null_space(np.hstack([form.Phi_0[velocity] @ N_R, form.Phi_1[velocity] @ N_R]))
    return E @ X_R, F @ X_R, X_R


def _row_sizes(E: Floats) -> Floats:
    """What scales the rows of E to a largest entry of 1: a small mass is no missing one. Rows of round-off stay."""
    size = np.abs(E).max(axis=1, keepdims=True)
    return np.where(size > _NO_MASS * size.max(), size, 1.0)


@dataclass(frozen=True, eq=False)
class _Eigen:
    """Eigenvalues of a real matrix and right vectors as LAPACK has them: of a pair real and imaginary part in turn."""

    lam: Complexes
    packed: Floats

    def vectors(self, these: NDArray[np.bool_]) -> Complexes:
        """Some of the vectors, shape (n, ...)."""
        first = self.lam.imag > 0.0
        V = self.packed.astype(np.complex128)
        V[:, first] += 1j * self.packed[:, np.flatnonzero(first) + 1]
        V[:, np.flatnonzero(first) + 1] = V[:, first].conj()
        return V[:, these]


def _eigen(A: Floats) -> _Eigen:
    """Eigenvalues and right vectors by LAPACK directly; LinAlgError where there are none."""
    if A.size == 0:
        return _Eigen(np.zeros(0, dtype=np.complex128), np.zeros((0, 0)))
    if not np.isfinite(A).all():
        raise np.linalg.LinAlgError("a matrix that is not finite has no eigenvalues")
    re, im, _, packed, info = lapack.dgeev(A, compute_vl=0)
    if info:
        raise np.linalg.LinAlgError("the eigenvalues did not converge")
    return _Eigen(re + 1j * im, packed)


_Rigid = Callable[[Numbers], NDArray[np.bool_]]  # tells of each column of unknowns whether it is a rigid motion


def _without_stiffness(K: Floats, z: Numbers) -> NDArray[np.bool_]:
    """Whether each column of z, shape (n, m), meets no stiffness K, shape (k, n); soft beside stiff is some."""
    if K.size == 0:
        return np.ones(z.shape[1], dtype=bool)
    # Rows and columns scaled to a largest entry of about 1, so that stiff parts do not hide soft ones.
    columns = np.ones(K.shape[1])
    for _ in range(4):
        K = K / np.sqrt(_largest(K, axis=1))[:, None]
        scale = np.sqrt(_largest(K, axis=0))
        K, columns = K / scale, columns / scale
    y = z / columns[:, None]
    return np.asarray(np.linalg.norm(K @ y, axis=0) <= _NO_STIFFNESS * np.linalg.norm(y, axis=0))


def _largest(K: Floats, axis: int) -> Floats:
    """Largest moduli of rows or columns; 1 where all is zero."""
    found: Floats = np.abs(K).max(axis=axis)
    return np.where(found > 0.0, found, 1.0)


def _zero_threshold(found: _Eigen, rigid: _Rigid) -> tuple[float, int]:
    """The modulus up to which eigenvalues count as zero, and how many do."""
    size = np.abs(found.lam)
    small = size <= _NEGLIGIBLE * size.max(initial=0.0)
    if not small.any():
        return 0.0, 0
    zero = np.zeros(len(size), dtype=bool)
    zero[small] = rigid(found.vectors(small))
    if not zero.any():
        return 0.0, 0
    # What is slower than the round-off of a rigid motion cannot be told from it.
    largest = float(size[zero].max())
    above = size[size > largest]
    between = float(np.sqrt(largest * above.min())) if above.size else largest
    return max(between, largest), int(np.count_nonzero(size <= largest))


def _deflate(E: Floats, F: Floats, rigid: _Rigid, n_z: int) -> tuple[Floats, Floats, Floats, int, int, _Eigen | None]:
    """Split off zero and infinite eigenvalues of lam E + F; with n_z > 0 the first n_z rows say z' = zdot.

    Returns real bases `right` (s, r), `left` (r, s) and `A` (r, r) with left E right = I and left F right = -A, the
    number of zero and of infinite eigenvalues set aside, and the eigenvectors of A if they are known already.
    """
    size = len(E)
    if size == 0:
        return np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 0)), 0, 0, None
    mass = E[n_z:, n_z:]
    sizes = _row_sizes(mass)
    by_mass = inverse_if_sound(mass / sizes, 1.0 / float(np.sqrt(np.finfo(float).eps)))
    if by_mass is not None:
        H, inverse = -F, np.eye(size)
        inverse[n_z:, n_z:] = by_mass / sizes[:, 0]
        H[n_z:] = inverse[n_z:, n_z:] @ H[n_z:]
        solved = _eigen(H)
        threshold, n_zero = _zero_threshold(solved, rigid)
        if n_zero == 0:
            return np.eye(size), inverse, H, 0, 0, solved
        right, left, A = _invariant_subspace(H, threshold, n_zero)
        return right, left @ inverse, A, n_zero, 0, None

    # Some direction has no mass: S = (sigma E + F)^-1 E has the eigenvalues 1 / (sigma - lam), zero for infinite lam.
    sigma = 1.1 * np.linalg.norm(F) / np.linalg.norm(E)  # [rad/s] of the size of the pencil's own eigenvalues
    shifted = sigma * E + F
    if not condition(shifted) <= 1e13:
        raise MatrixError("the pencil is singular: some motion meets no mass, damping, stiffness or constraint")
    S = np.linalg.solve(shifted, E)
    mu = np.linalg.eigvals(S)
    threshold = _NEGLIGIBLE * np.abs(mu).max()
    n_infinite = int(np.count_nonzero(np.abs(mu) <= threshold))
    right, left, S_finite = _invariant_subspace(S, threshold, n_infinite)
    A = sigma * np.eye(len(S_finite)) - np.linalg.inv(S_finite)
    left = np.linalg.solve(S_finite, np.linalg.solve(shifted.T, left.T).T)
    threshold, n_zero = _zero_threshold(_eigen(A), lambda vectors: rigid(right @ vectors))
    inner_right, inner_left, A = _invariant_subspace(A, threshold, n_zero)
    return right @ inner_right, inner_left @ left, A, n_zero, n_infinite, None


def _invariant_subspace(H: Numbers, threshold: float, n_dropped: int) -> tuple[Numbers, Numbers, Numbers]:
    """Return right, left, A for the eigenvalues of H larger than `threshold`: left right = I, left H right = A."""
    size = len(H)
    if n_dropped == 0:
        return np.eye(size), np.eye(size), H
    T, Z, kept = scipy.linalg.schur(H, output="real", sort=lambda re, im=0.0: np.hypot(np.abs(re), im) > threshold)
    if kept != size - n_dropped:
        raise MatrixError(
            f"eigenvalues near the limit of what counts as zero or infinite ({threshold:.3g}): "
            f"{size - n_dropped} by one count, {kept} by another"
        )
    # [T11 T12; 0 T22]: remove the coupling with X, T11 X - X T22 = -T12, so that the left basis is [I, -X] Z^T
    X = scipy.linalg.solve_sylvester(T[:kept, :kept], -T[kept:, kept:], -T[:kept, kept:])
    left = Z[:, :kept].T - X @ Z[:, kept:].T
    return Z[:, :kept], left, T[:kept, :kept]


def _diagonalise(
    right: Floats, left: Floats, A: Floats, solved: _Eigen | None
) -> tuple[Complexes, Numbers | None, Numbers | None]:
    """Eigenvalues, and eigenvectors from real bases where these are a sound basis; `solved` has those of A if known.

    Vectors are those of the first of each conjugate pair. If `solved` is given, `right` is the identity.
    """
    found = _eigen(A) if solved is None else solved
    # LAPACK has conjugate pairs side by side, positive imaginary part first; sort by modulus without parting them
    heads = np.flatnonzero(found.lam.imag >= 0.0)
    heads = heads[np.argsort(np.abs(found.lam[heads]), kind="stable")]
    paired = found.lam[heads].imag > 0.0
    place = np.cumsum(1 + paired) - (1 + paired)  # of each head among all
    order = np.empty(len(found.lam), dtype=np.intp)
    order[place] = heads
    order[place[paired] + 1] = heads[paired] + 1
    lam = found.lam[order]
    if len(lam) == 0:
        return lam, right.astype(np.complex128), left.astype(np.complex128)
    # By real numbers: T = R U with U unitary, R = [.., sqrt(2) Re v, sqrt(2) Im v, ..] for a pair v, conj(v).
    root = np.sqrt(2.0)
    R = found.packed[:, order] * np.where(lam.imag != 0.0, root, 1.0)
    inverse = inverse_if_sound(R, _MAX_CONDITION)
    if inverse is None:
        return lam, None, None
    real_right = R if solved is not None else right @ R
    real_left = inverse @ left
    T, of_T = real_right[:, place].astype(np.complex128), real_left[place].astype(np.complex128)
    first = place[paired]
    T[:, paired] = (T[:, paired] + 1j * real_right[:, first + 1]) / root
    of_T[paired] = (of_T[paired] - 1j * real_left[first + 1]) / root
    return lam, T, of_T


def _product(real: Floats, Z: Numbers) -> Numbers:
    """A real matrix times a real or complex one, in real arithmetic."""
    if not np.iscomplexobj(Z):
        product: Numbers = real @ Z
        return product
    both = real @ np.concatenate((Z.real, Z.imag), axis=1)
    found: Numbers = both[:, : Z.shape[1]] + 1j * both[:, Z.shape[1] :]
    return found


def _velocity_constraint_rows(form: SecondOrderForm, A: Numbers, residual: Numbers) -> Numbers:
    """Return the left vectors' constraint part W_c: A W_c Phi_1 + W_c Phi_0 = -residual."""
    # row-major vec: vec(A W Phi_1) = (A kron Phi_1^T) vec(W)
    system: Numbers = np.kron(A, form.Phi_1.T) + np.kron(np.eye(len(A)), form.Phi_0.T)
    solution: Numbers = np.linalg.lstsq(system, -residual.reshape(-1), rcond=RANK_TOLERANCE)[0]
    return solution.reshape(len(A), len(form.Phi_0))
