"""Broyden's method and GMRES, as a balance of harmonics needs them: vectors in, vectors out.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from pilotgen.solver.descriptor import Floats

DIRECTIONS, RESIDUE = 25, 0.02  # of GMRES, at most; what may be left of the right side


def broyden(step: Floats, steps: list[Floats], weights: Floats) -> Floats:
    """The next step of Broyden's method by those before (Kelley 1995, 7.3), lengths weighted."""
    w = weights * weights
    for before, after in pairwise(steps):
        step = step + after * (before * w @ step) / (before * w @ before)
    last = steps[-1]
    square = float(last * w @ last)
    return np.asarray(step / (1.0 - float(last * w @ step) / square))


def gmres(product: Callable[[Floats], Floats], right: Floats) -> Floats:
    """x with product(x) = right but for `RESIDUE` of it (Saad & Schultz 1986)."""
    size = float(np.linalg.norm(right))
    basis = [right / size]
    H = np.zeros((DIRECTIONS + 1, DIRECTIONS))
    for j in range(DIRECTIONS):
        new = product(basis[j])
        for i, one in enumerate(basis):
            H[i, j] = one @ new
            new = new - H[i, j] * one
        H[j + 1, j] = np.linalg.norm(new)
        basis.append(new / max(H[j + 1, j], 1e-300))
        wanted = np.zeros(j + 2)
        wanted[0] = size
        x = np.linalg.lstsq(H[: j + 2, : j + 1], wanted, rcond=None)[0]
        if np.linalg.norm(H[: j + 2, : j + 1] @ x - wanted) < RESIDUE * size:
            break
    return np.asarray(sum(a * one for a, one in zip(x, basis, strict=False)))
