"""Broyden's method and GMRES, as a balance of harmonics needs them: vectors in, vectors out.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import scipy.sparse.linalg
from scipy.sparse.linalg import LinearOperator

from pilotgen.solver.descriptor import Floats

DIRECTIONS, RESIDUE = 25, 0.02  # of GMRES, at most; what may be left of the right side


def broyden(step: Floats, steps: list[Floats], weights: Floats) -> Floats:
    """The next step of Broyden's method by those before (Kelley 1995, 7.3), lengths weighted; all of shape (m,)."""
    w = weights * weights
    for before, after in pairwise(steps):
        step = step + after * (before * w @ step) / (before * w @ before)
    last = steps[-1]
    square = float(last * w @ last)
    return np.asarray(step / (1.0 - float(last * w @ step) / square))


def gmres(product: Callable[[Floats], Floats], right: Floats) -> Floats:
    """x with product(x) = right but for `RESIDUE` of it, or the best of `DIRECTIONS` directions; both shape (m,).

    Saad & Schultz 1986, by SciPy.
    """
    operator = LinearOperator((right.size, right.size), matvec=product, dtype=float)
    x, _ = scipy.sparse.linalg.gmres(operator, right, rtol=RESIDUE, restart=DIRECTIONS, maxiter=1)
    return np.asarray(x)
