"""Finite, nonzero eigenvalues of a descriptor model with its right and left vectors.

The pencil (lam g_ydot + g_y) V_R = 0 of a constrained multibody model has mostly infinite eigenvalues. They are removed
exactly before any eigenvalue is computed: momenta are replaced by their definitions, coordinates are restricted to the
null space of the constraints, equations to the null space of the reactions. What is left is a small dense problem
(4 x 4 for one arm on a lever). Theory: docs/theory/projection.md.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.linalg import lapack

from pilotgen.errors import MatrixError
from pilotgen.solver.descriptor import Complexes, DescriptorModel, Floats, Indices, Numbers, block

# Entries that the form of the equations of motion demands to be 0 or 1 come from sums and differences of J(+-c): exact
# in our files, good to about eps * max|J| / c in MBDyn's.
_FORM_TOLERANCE = 1e-9
# A constraint counts as dependent on others when its part outside their span is this small against the largest one.
_RANK_TOLERANCE = 1e-10
# An eigenvalue may be zero or infinite when it is this small, or 1 / this large, against the scale of the others.
# Double zeros (rigid motion) come out near sqrt(eps) = 1.5e-8, so does 1/lam of a massless direction (index 2).
_NEGLIGIBLE = 1e-6
# It is zero if its motion meets no stiffness: forces this small against stiffness times motion, in scaled coordinates.
_NO_STIFFNESS = 1e-11
# A direction has no mass if its row of the mass matrix is this small against the largest.
_NO_MASS = 1e-13
# Eigenvectors are used as a basis while their condition number is below this; beyond, a real basis takes their place.
_MAX_CONDITION = 1e5


@dataclass(frozen=True)
class SecondOrderForm:
    """The model without its momenta: M q'' + C q' + K q + B reactions = 0, Phi_1 q' + Phi_0 q = 0.

    Attributes
    ----------
    M, C, K : ndarray, shape (n_q, n_q)
        Mass, damping and stiffness by coordinates.
    B : ndarray, shape (n_q, n_r)
        How reactions enter the equilibrium equations.
    Phi_0, Phi_1 : ndarray, shape (n_r, n_q)
        Constraint equations; Phi_1 is zero for holonomic ones.
    momentum_mass, momentum_gyro : ndarray, shape (n_p, n_q)
        p = momentum_mass q' + momentum_gyro q.
    momentum_force : ndarray, shape (n_q, n_p)
        Partial of the equilibrium equations by momenta (zero at rest).
    dynamic : ndarray of int, shape (n_p,)
        Coordinate that each momentum belongs to.
    """

    M: Floats
    C: Floats
    K: Floats
    B: Floats
    Phi_0: Floats
    Phi_1: Floats
    momentum_mass: Floats
    momentum_gyro: Floats
    momentum_force: Floats
    dynamic: Indices


@dataclass(frozen=True)
class ModalModel:
    """The retained modes: V_L g_ydot V_R = I, V_L g_y V_R = -A.

    Attributes
    ----------
    lam : ndarray of complex, shape (r,)
        Retained eigenvalues [rad/s]: finite and nonzero, conjugate pairs side by side, positive imaginary part first.
    V_R : ndarray, shape (n, r)
        Right vectors of all unknowns, reactions included.
    V_L : ndarray, shape (r, n)
        Left vectors of all equations.
    A : ndarray, shape (r, r)
        diag(lam) if `diagonal`; otherwise real, with eigenvalues lam, and V_R, V_L are real bases.
    diagonal : bool
        False when the eigenvectors are too close to dependent (defective or nearly so) to serve as a basis.
    n_zero, n_infinite : int
        Eigenvalues set aside in the reduced problem: zero (rigid motion) and infinite (directions without mass).
    """

    lam: Complexes
    V_R: Numbers
    V_L: Numbers
    A: Numbers
    diagonal: bool
    n_zero: int
    n_infinite: int

    @property
    def frequency_hz(self) -> Floats:
        """Natural frequencies |lam| / 2 pi [Hz]."""
        return np.asarray(np.abs(self.lam) / (2.0 * np.pi))

    @property
    def damping(self) -> Floats:
        """Damping ratios -Re lam / |lam|; +-1 for real eigenvalues."""
        return -self.lam.real / np.abs(self.lam)


def second_order_form(model: DescriptorModel) -> SecondOrderForm:
    """Eliminate the momenta exactly; MatrixError if the pencil is not of the form of docs/theory/linearisation.md."""
    g_y, g_ydot = model.g_y, model.g_ydot
    q, p, reactions = model.coordinates, model.momenta, model.reactions
    definition, equilibrium = model.definition_rows, model.equilibrium_rows
    n_q, n_p = len(q), len(p)
    dynamic = np.searchsorted(q, definition)
    force_of_rate = np.zeros((n_q, n_p))
    force_of_rate[dynamic, np.arange(n_p)] = 1.0

    # rows: equilibrium, momentum definitions, constraints; columns: coordinates, momenta, reactions
    rows, columns = np.concatenate((equilibrium, definition, reactions)), np.concatenate((q, p, reactions))
    by_y, by_ydot = block(g_y, rows, columns), block(g_ydot, rows, columns)
    wanted_y, wanted_ydot = np.zeros_like(by_y[n_q:, n_q:]), np.zeros_like(by_ydot[:, n_q:])
    wanted_y[np.arange(n_p), np.arange(n_p)] = -1.0
    wanted_ydot[:n_q, :n_p] = force_of_rate
    _check_form(by_y[n_q:, n_q:] - wanted_y, by_ydot[:, n_q:] - wanted_ydot, n_q, n_p)

    momentum_mass, momentum_gyro = by_ydot[n_q : n_q + n_p, :n_q], by_y[n_q : n_q + n_p, :n_q]
    momentum_force = by_y[:n_q, n_q : n_q + n_p]
    return SecondOrderForm(
        M=force_of_rate @ momentum_mass,
        C=by_ydot[:n_q, :n_q] + force_of_rate @ momentum_gyro + momentum_force @ momentum_mass,
        K=by_y[:n_q, :n_q] + momentum_force @ momentum_gyro,
        B=by_y[:n_q, n_q + n_p :],
        Phi_0=by_y[n_q + n_p :, :n_q],
        Phi_1=by_ydot[n_q + n_p :, :n_q],
        momentum_mass=momentum_mass,
        momentum_gyro=momentum_gyro,
        momentum_force=momentum_force,
        dynamic=dynamic,
    )


def _check_form(y: Floats, ydot: Floats, n_q: int, n_p: int) -> None:
    """Check what g_y (without equilibrium rows) and g_ydot have too much by momenta and reactions: nothing."""
    if max(np.abs(y).max(initial=0.0), np.abs(ydot).max(initial=0.0)) <= _FORM_TOLERANCE:
        return
    equilibrium, definition, constraints = slice(n_q), slice(n_q, n_q + n_p), slice(n_q + n_p, None)
    for part, what in (
        (y[:n_p, :n_p], "momenta in their definitions"),
        (ydot[definition, :n_p], "momenta rates in the momentum definitions"),
        (ydot[equilibrium, :n_p], "momenta rates in the equilibrium equations"),
        (y[n_p:, :n_p], "momenta in the constraints"),
        (ydot[constraints, :n_p], "momenta rates in the constraints"),
        (ydot[:, n_p:], "rates of reactions"),
        (y[n_p:, n_p:], "reactions in the constraints"),
        (y[:n_p, n_p:], "reactions in the momentum definitions"),
    ):
        worst = np.abs(part).max(initial=0.0)
        if worst > _FORM_TOLERANCE:
            raise MatrixError(
                f"the matrices are not those of a multibody model: {what} differ from the expected 0 or 1 by "
                f"{worst:.2g}"
            )


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
    velocity = np.abs(form.Phi_1).max(axis=1, initial=0.0) > _FORM_TOLERANCE
    N_R, constraint_solver = _null_space(form.Phi_0[~velocity])
    N_L, reaction_solver = _null_space(form.B.T)

    E, F, X_R = _reduced_pencil(form, N_R, N_L, velocity)
    if E.shape[0] != E.shape[1]:
        raise MatrixError(
            f"the constraints leave {E.shape[1]} first-order unknowns, the reactions {E.shape[0]} equations; "
            "each constraint equation must have a reaction of its own"
        )
    n_z = N_R.shape[1]

    def rigid(u: Numbers) -> NDArray[np.bool_]:
        return _without_stiffness(np.vstack([N_L.T @ form.K @ N_R, form.Phi_0[velocity] @ N_R]), X_R[:n_z] @ u)

    right, left, A, n_zero, n_infinite, solved = _deflate(E, F, rigid, 0 if velocity.any() else n_z)
    lam, right, left, A, diagonal = _diagonalise(right, left, A, solved)

    # of a conjugate pair only the first is worked out
    firsts = np.flatnonzero(lam.imag >= 0.0) if diagonal else np.arange(len(lam))
    left, right, own = left[firsts], right[:, firsts], lam[firsts]

    def advanced(Z: Numbers, of_rows: bool = False) -> Numbers:
        """Z A, or A Z for rows: times lam where A is diagonal."""
        if diagonal:
            scaled: Numbers = Z * (own[:, None] if of_rows else own)
            return scaled
        return A @ Z if of_rows else Z @ A

    # back to all unknowns: V_R
    Q = _product(N_R @ X_R[:n_z], right)
    QA = advanced(Q)
    V_R = np.zeros((len(model.names), len(lam)), dtype=A.dtype)
    V_R[model.coordinates[:, None], firsts] = Q
    V_R[model.momenta[:, None], firsts] = _product(form.momentum_mass, QA) + _product(form.momentum_gyro, Q)
    forces = _product(form.M, advanced(QA)) + _product(form.C, QA) + _product(form.K, Q)
    V_R[model.reactions[:, None], firsts] = -reaction_solver.solve(forces)

    # back to all equations: V_L
    W = _product(N_L, left[:, n_z:].T).T
    AW = advanced(W, of_rows=True)
    V_L = np.zeros((len(lam), len(model.names)), dtype=A.dtype)
    V_L[firsts[:, None], model.equilibrium_rows] = W
    V_L[firsts[:, None], model.definition_rows] = AW[:, form.dynamic] + _product(form.momentum_force.T, W.T).T
    # what the equilibrium and definition rows leave over, for the constraint rows to cancel
    residual = (
        advanced(_product(form.M.T, AW.T).T, of_rows=True) + _product(form.C.T, AW.T).T + _product(form.K.T, W.T).T
    )
    if velocity.any():
        V_L[firsts[:, None], model.reactions] = _velocity_constraint_rows(
            form, np.diag(own) if diagonal else A, residual
        )
    else:
        V_L[firsts[:, None], model.reactions] = -constraint_solver.solve(residual.T).T
    if diagonal:
        seconds = np.flatnonzero(lam.imag < 0.0)  # right after the first of each pair
        V_R[:, seconds], V_L[seconds] = V_R[:, seconds - 1].conj(), V_L[seconds - 1].conj()
    return ModalModel(lam=lam, V_R=V_R, V_L=V_L, A=A, diagonal=diagonal, n_zero=n_zero, n_infinite=n_infinite)


# ---- the reduction


@dataclass(frozen=True)
class _RangeSolver:
    """Solves G^T x = b for b in the range of G^T (basic solution when the rows of G are dependent)."""

    Q: Floats
    R: Floats
    pivots: Indices
    size: int

    def solve(self, b: Numbers) -> Numbers:
        rank = len(self.R)
        x = np.zeros((self.size, *b.shape[1:]), dtype=b.dtype)
        if rank:
            x[self.pivots[:rank]] = _solve_triangular(self.R, self.Q.T @ b)
        return x


def _null_space(G: Floats) -> tuple[Floats, _RangeSolver]:
    """Return an orthonormal basis of {x : G x = 0} and a solver with G^T, by QR with column pivoting."""
    n_rows, n = G.shape
    if n_rows == 0:
        return np.eye(n), _RangeSolver(np.zeros((n, 0)), np.zeros((0, 0)), np.zeros(0, dtype=np.intp), 0)
    factors, pivots, tau, rank = _pivoted_qr(G.T)
    whole = np.zeros((n, n), order="F")
    whole[:, : len(tau)] = factors[:, : len(tau)]
    Q, _, _ = lapack.dorgqr(whole, tau, overwrite_a=1)
    return Q[:, rank:], _RangeSolver(Q[:, :rank], np.triu(factors[:rank, :rank]), pivots, n_rows)


def _pivoted_qr(A: Floats) -> tuple[Floats, Indices, Floats, int]:
    """Return the factors of A P = Q R as LAPACK leaves them, P as columns of A, the reflectors' scales, and the rank.

    Called directly, as below: for matrices of this size the wrappers around LAPACK cost more than the factorisation.
    """
    factors, pivots, tau, _, _ = lapack.dgeqp3(A)
    diagonal = np.abs(np.diagonal(factors))
    return factors, pivots - 1, tau, int(np.count_nonzero(diagonal > _RANK_TOLERANCE * diagonal[0]))


def _solve_triangular(R: Floats, b: Numbers) -> Numbers:
    """Solve R x = b, R upper triangular and regular, b of shape (n, m)."""
    solve = lapack.ztrtrs if np.iscomplexobj(b) else lapack.dtrtrs
    x: Numbers = solve(R, b)[0]
    return x


def _condition(A: Numbers) -> float:
    """Return the condition number of a square matrix in the 2-norm."""
    singular_values = (lapack.zgesdd if np.iscomplexobj(A) else lapack.dgesdd)(A, compute_uv=0)[1]
    smallest = float(singular_values[-1])
    return float(singular_values[0]) / smallest if smallest > 0.0 else np.inf


def independent_constraints(G: Floats) -> Indices:
    """Return the indices of a largest set of independent rows of `G`, ascending.

    `G` has shape (constraints, unknowns); the result shape (rank,).
    """
    if len(G) == 0:
        return np.zeros(0, dtype=np.intp)
    _, pivots, _, rank = _pivoted_qr(G.T)
    return np.sort(pivots[:rank])


def _reduced_pencil(
    form: SecondOrderForm, N_R: Floats, N_L: Floats, velocity: NDArray[np.bool_]
) -> tuple[Floats, Floats, Floats]:
    """Return E, F of lam E + F on [z; zdot] = X_R u, where q = N_R z: rows are z' = zdot and N_L^T (equilibrium)."""
    n_z, n_w = N_R.shape[1], N_L.shape[1]
    E, F = np.zeros((n_z + n_w, 2 * n_z)), np.zeros((n_z + n_w, 2 * n_z))
    E[:n_z, :n_z] = np.eye(n_z)
    E[n_z:, n_z:] = N_L.T @ (form.M @ N_R)
    F[:n_z, n_z:] = -np.eye(n_z)
    F[n_z:, :n_z] = N_L.T @ (form.K @ N_R)
    F[n_z:, n_z:] = N_L.T @ (form.C @ N_R)
    if not velocity.any():
        return E, F, np.eye(2 * n_z)
    X_R, _ = _null_space(np.hstack([form.Phi_0[velocity] @ N_R, form.Phi_1[velocity] @ N_R]))
    return E @ X_R, F @ X_R, X_R


def _rows_of_one_size(E: Floats) -> Floats:
    """E with its rows scaled to a largest entry of 1: a small mass is no missing one. Rows of round-off stay."""
    size = np.abs(E).max(axis=1, keepdims=True)
    return E / np.where(size > _NO_MASS * size.max(), size, 1.0)


_Eigen = tuple[Numbers, Numbers]  # eigenvalues and right eigenvectors of a matrix


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


def _zero_threshold(lam: Complexes, V: Numbers, rigid: _Rigid) -> tuple[float, int]:
    """The modulus up to which eigenvalues lam with vectors V, in the pencil's unknowns, count as zero; how many do."""
    size = np.abs(lam)
    small = size <= _NEGLIGIBLE * size.max(initial=0.0)
    if not small.any():
        return 0.0, 0
    zero = np.zeros(len(lam), dtype=bool)
    zero[small] = rigid(V[:, small])
    if not zero.any():
        return 0.0, 0
    # What is slower than the round-off of a rigid motion cannot be told from it.
    largest = float(size[zero].max())
    above = size[size > largest]
    between = float(np.sqrt(largest * above.min())) if above.size else largest
    return max(between, largest), int(np.count_nonzero(size <= largest))


def _deflate(
    E: Floats, F: Floats, rigid: _Rigid, n_z: int
) -> tuple[Numbers, Numbers, Numbers, int, int, _Eigen | None]:
    """Split off zero and infinite eigenvalues of lam E + F; with n_z > 0 the first n_z rows say z' = zdot.

    Returns real bases `right` (s, r), `left` (r, s) and `A` (r, r) with left E right = I and left F right = -A, the
    number of zero and of infinite eigenvalues set aside, and the eigenvectors of A if they are known already.
    """
    size = len(E)
    if size == 0:
        return np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 0)), 0, 0, None
    if _condition(_rows_of_one_size(E[n_z:, n_z:])) < 1.0 / np.sqrt(np.finfo(float).eps):
        H, inverse = -F, np.eye(size)
        inverse[n_z:, n_z:] = np.linalg.inv(E[n_z:, n_z:])
        H[n_z:] = inverse[n_z:, n_z:] @ H[n_z:]
        lam, T = np.linalg.eig(H)
        threshold, n_zero = _zero_threshold(lam, T, rigid)
        if n_zero == 0:
            return np.eye(size), inverse, H, 0, 0, (lam, T)
        right, left, A = _invariant_subspace(H, threshold, n_zero)
        return right, left @ inverse, A, n_zero, 0, None

    # Some direction has no mass: S = (sigma E + F)^-1 E has the eigenvalues 1 / (sigma - lam), zero for infinite lam.
    sigma = 1.1 * np.linalg.norm(F) / np.linalg.norm(E)  # [rad/s] of the size of the pencil's own eigenvalues
    shifted = sigma * E + F
    if not _condition(shifted) <= 1e13:
        raise MatrixError("the pencil is singular: some motion meets no mass, damping, stiffness or constraint")
    S = np.linalg.solve(shifted, E)
    mu = np.linalg.eigvals(S)
    threshold = _NEGLIGIBLE * np.abs(mu).max()
    n_infinite = int(np.count_nonzero(np.abs(mu) <= threshold))
    right, left, S_finite = _invariant_subspace(S, threshold, n_infinite)
    A = sigma * np.eye(len(S_finite)) - np.linalg.inv(S_finite)
    left = np.linalg.solve(S_finite, np.linalg.solve(shifted.T, left.T).T)
    lam, T = np.linalg.eig(A)
    threshold, n_zero = _zero_threshold(lam, right @ T, rigid)
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
    right: Numbers, left: Numbers, A: Numbers, solved: _Eigen | None
) -> tuple[Complexes, Numbers, Numbers, Numbers, bool]:
    """Turn real bases into eigenvectors where these are a sound basis; `solved` has those of A if they are known."""
    lam, T = np.linalg.eig(A) if solved is None else solved
    # numpy returns conjugate pairs side by side, positive imaginary part first; sort by modulus without parting them
    heads = np.flatnonzero(lam.imag >= 0.0)
    heads = heads[np.argsort(np.abs(lam[heads]), kind="stable")]
    order = np.array([j for k in heads for j in ((k, k + 1) if lam[k].imag > 0.0 else (k,))], dtype=np.intp)
    lam, T = lam[order].astype(np.complex128), T[:, order].astype(np.complex128)
    if len(lam) == 0:
        return lam, right @ T, left.astype(np.complex128), np.diag(lam), True
    # The same by real numbers: T = R U with U unitary, R = [.., sqrt(2) Re v, sqrt(2) Im v, ..] for a pair v, conj(v).
    first = np.flatnonzero(lam.imag > 0.0)
    R = T.real.copy()
    R[:, first], R[:, first + 1] = np.sqrt(2.0) * T[:, first].real, np.sqrt(2.0) * T[:, first].imag
    if not _condition(R) < _MAX_CONDITION:
        return lam, right, left, A, False
    solved_left = np.linalg.solve(R, left)
    of_T = solved_left.astype(np.complex128)
    of_T[first] = (solved_left[first] - 1j * solved_left[first + 1]) / np.sqrt(2.0)
    of_T[first + 1] = of_T[first].conj()
    return lam, _product(right, T) if solved is None else T, of_T, np.diag(lam), True


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
    solution: Numbers = np.linalg.lstsq(system, -residual.reshape(-1), rcond=_RANK_TOLERANCE)[0]
    return solution.reshape(len(A), len(form.Phi_0))
