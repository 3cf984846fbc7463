"""Null spaces of constraints, solvers for what is in their range, and inverses that can be relied on.

LAPACK is called directly: for matrices of this size the wrappers around it cost more than the factorisation.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from pilotgen.solver.descriptor import Floats, Indices, Numbers

# A constraint counts as dependent on others when its part outside their span is this small against the largest one.
RANK_TOLERANCE = 1e-10


@dataclass(frozen=True)
class RangeSolver:
    """Solves G^T x = b for b in the range of G^T (basic solution when the rows of G are dependent)."""

    Q: Floats
    R: Floats
    pivots: Indices
    size: int

    def solve(self, b: Numbers) -> Numbers:
        """A solution of G^T x = b; `b` has shape (unknowns,) or (unknowns, m), x (constraints,) or (constraints, m)."""
        rank = len(self.R)
        x = np.zeros((self.size, *b.shape[1:]), dtype=b.dtype)
        if rank:
            x[self.pivots[:rank]] = _solve_triangular(self.R, self.Q.T @ b)
        return x

    def solve_transposed(self, b: Floats) -> Floats:
        """The smallest y with G y = b on a largest set of independent rows, which is all of b if it is in the range.

        `b` has shape (constraints, ...), y (unknowns, ...).
        """
        if not len(self.R):
            return np.zeros((len(self.Q), *b.shape[1:]))
        y: Floats = self.Q @ lapack.dtrtrs(self.R, b[self.pivots[: len(self.R)]], trans=1)[0]
        return y


def null_space(G: Floats) -> tuple[Floats, RangeSolver]:
    """Return an orthonormal basis of {x : G x = 0} and a solver with G^T, by QR with column pivoting.

    `G` has shape (constraints, unknowns), the basis (unknowns, unknowns - rank).
    """
    n_rows, n = G.shape
    if n_rows == 0:
        return np.eye(n), RangeSolver(np.zeros((n, 0)), np.zeros((0, 0)), np.zeros(0, dtype=np.intp), 0)
    factors, pivots, tau, rank = _pivoted_qr(G.T)
    whole = np.zeros((n, n), order="F")
    whole[:, : len(tau)] = factors[:, : len(tau)]
    Q, _, _ = lapack.dorgqr(whole, tau, overwrite_a=1)
    return Q[:, rank:], RangeSolver(Q[:, :rank], np.triu(factors[:rank, :rank]), pivots, n_rows)


def _pivoted_qr(A: Floats) -> tuple[Floats, Indices, Floats, int]:
    """Return the factors of A P = Q R as LAPACK leaves them, the pivots, the reflectors' scales, and the rank."""
    factors, pivots, tau, _, _ = lapack.dgeqp3(A)
    diagonal = np.abs(np.diagonal(factors))
    return factors, pivots - 1, tau, int(np.count_nonzero(diagonal > RANK_TOLERANCE * diagonal[0]))


def _solve_triangular(R: Floats, b: Numbers) -> Numbers:
    """Solve R x = b, R upper triangular and regular, b of shape (n, m)."""
    solve = lapack.ztrtrs if np.iscomplexobj(b) else lapack.dtrtrs
    x: Numbers = solve(R, b)[0]
    return x


def condition(A: Floats) -> float:
    """Return the condition number of a square matrix, shape (n, n), in the 2-norm."""
    singular_values = lapack.dgesdd(A, compute_uv=0)[1]
    smallest = float(singular_values[-1])
    return float(singular_values[0]) / smallest if smallest > 0.0 else np.inf


def inverse_if_sound(A: Floats, most_condition: float) -> Floats | None:
    """Return the inverse of a square matrix, or None where its condition number is not below `most_condition`.

    `A` and the inverse have shape (n, n).
    """
    lu, pivots, singular = lapack.dgetrf(A)
    if singular:
        return None
    inverse: Floats = lapack.dgetri(lu, pivots, overwrite_lu=1)[0]
    bound = float(np.linalg.norm(A) * np.linalg.norm(inverse))  # Frobenius: never below that in the 2-norm
    return inverse if bound < most_condition or condition(A) < most_condition else None


def independent_constraints(G: Floats) -> Indices:
    """Return the indices of a largest set of independent rows of `G`, ascending.

    `G` has shape (constraints, unknowns); the result shape (rank,).
    """
    if len(G) == 0:
        return np.zeros(0, dtype=np.intp)
    _, pivots, _, rank = _pivoted_qr(G.T)
    return np.sort(pivots[:rank])
