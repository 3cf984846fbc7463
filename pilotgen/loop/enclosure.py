"""Where the eigenvalues of a matrix are for certain: disks around computed ones, by a residual in extended precision.

With computed eigenvalues lam and vectors V, and W near the inverse of V, the eigenvalues of A are those of

    V^-1 A V = diag(lam) + S,    S = V^-1 (A V - V diag(lam)),

and Gershgorin's disks of that hold them all; disks that hang together hold as many eigenvalues as they are. S is small:
A V - V diag(lam) is computed with 64 bits of mantissa where double has 53 (on machines whose `long double` is no longer
than that the disks are wider, not wrong), and its round-off is added entry by entry. Two steps of correction make V and
lam better than double precision can. What a norm and the vectors' condition would say (`margins.largest_real_part`) is
a bound for the fastest mode; these disks are as small as each mode allows.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Extended = NDArray[Any]  # of np.longdouble or np.clongdouble

_NEAR = 1e-6  # eigenvalues nearer to each other, relative to their modulus, are not corrected against each other
_ROUNDS = (0, 2)  # of correction, the second where the first leaves it open


def eigenvalue_disks(A: Extended, rounds: int = 2) -> tuple[NDArray[np.complex128], NDArray[np.float64]] | None:
    """Centres and radii of disks, shapes (n,), that hold the eigenvalues of a real matrix, shape (n, n), any precision.

    `rounds` of correction make them smaller. None where no such disks are found: the matrix of eigenvectors is as good
    as singular.
    """
    n = len(A)
    exact = np.asarray(A, dtype=np.longdouble)
    # powers of two: the same eigenvalues, entries of like size
    scale = _balance(np.asarray(A, dtype=float)).astype(np.longdouble)
    exact = exact * scale / scale[:, None]
    try:
        lam, vectors = np.linalg.eig(exact.astype(float))
        V = vectors.astype(np.clongdouble)
        W = np.linalg.inv(vectors).astype(np.clongdouble)
    except np.linalg.LinAlgError:
        return None
    if not (np.isfinite(W).all() and np.isfinite(lam).all()):
        return None
    values = lam.astype(np.clongdouble)
    unit = np.eye(n, dtype=np.clongdouble)
    found = None
    for _ in range(rounds + 1):
        for _ in range(2):
            W = W @ (2.0 * unit - V @ W)  # Newton's step toward the inverse
        bounds = _bounds(exact, values, V, W)
        if bounds is None:
            return found
        S, radii = bounds
        if found is None or float(radii.max()) < float(found[1].max()):
            found = (values + np.diag(S)).astype(np.complex128), radii
        gaps = values[None, :] - values[:, None]
        far = np.abs(gaps) > _NEAR * np.maximum(np.abs(values)[None, :], np.abs(values)[:, None])
        V = V + V @ np.where(far, S / np.where(far, gaps, 1.0), 0.0)
        values = values + np.diag(S)
    return found


def _bounds(A: Extended, values: Extended, V: Extended, W: Extended) -> tuple[Extended, NDArray[np.float64]] | None:
    """S and Gershgorin's radii around values + diag(S); None if V is as good as singular."""
    n = len(A)
    unit = 4.0 * (n + 4) * float(np.finfo(np.longdouble).eps)  # round-off of a sum of n complex products, generously
    size_V, size_W = np.abs(V), np.abs(W)
    G = W @ V - np.eye(n)
    g = float((np.abs(G) + unit * (size_W @ size_V)).sum(axis=1).max())
    if not g < 0.5:
        return None
    S = W @ (A @ V - V * values)
    error = unit * (size_W @ (np.abs(A) @ size_V + size_V * np.abs(values)) + np.abs(S))
    # V^-1 = (I + G)^-1 W, and (I + G)^-1 differs from I by no more than g / (1 - g) in its rows' sums
    whole = np.abs(S) + error
    error = error + g / (1.0 - g) * whole.max(axis=0)[None, :]
    whole = np.abs(S) + error
    off = whole - np.diag(np.diag(whole))
    # rows and columns scaled against each other make the radii of weakly coupled modes small
    d = np.ones(n, dtype=np.longdouble)
    for _ in range(20):
        row = (off * d[None, :]).sum(axis=1) / d
        column = (off / d[:, None]).sum(axis=0) * d
        d = d * np.sqrt(np.maximum(row, 1e-300) / np.maximum(column, 1e-300))
        d = np.clip(d / np.exp(np.log(d).mean()), 1e-30, 1e30)
    radii = (off * d[None, :]).sum(axis=1) / d
    spread = np.diag(error) + np.abs(values) * 1e-15  # of the centres, and of their rounding to double
    return S, np.asarray((radii + spread) * (1.0 + 1e-12), dtype=float)


def _balance(A: NDArray[np.float64]) -> NDArray[np.float64]:
    from scipy.linalg import matrix_balance

    _, (scale, _) = matrix_balance(A, permute=False, separate=True)
    return np.asarray(scale, dtype=float)


def enclosed_real_part(A: Extended) -> tuple[float, float] | None:
    """An interval [rad/s] that holds the largest real part of the eigenvalues of A, shape (n, n); None: not found."""
    found = None
    for rounds in _ROUNDS:
        disks = eigenvalue_disks(A, rounds)
        if disks is not None:
            found = _interval(*disks)
            if not found[0] <= 0.0 <= found[1]:
                return found
    return found


def _interval(centres: NDArray[np.complex128], radii: NDArray[np.float64]) -> tuple[float, float]:
    """Disks that hang together hold as many eigenvalues as they are: one at least is right of the leftmost edge."""
    group = np.arange(len(centres))
    touching = np.abs(centres[:, None] - centres[None, :]) <= radii[:, None] + radii[None, :]
    for i, j in np.argwhere(np.triu(touching, 1)):
        group[group == group[j]] = group[i]
    low = max(float((centres.real - radii)[group == g].min()) for g in np.unique(group))
    return low, float((centres.real + radii).max())
