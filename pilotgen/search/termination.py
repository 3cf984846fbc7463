"""How far a search is, and why it stops.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import numpy as np

# What study.h5 says in `stopped_by`.
RANK_ONE_SHARE = "rank one share"
GENERATION_LIMIT = "generation limit"


def rank_one_share(rank: np.ndarray, failed: np.ndarray) -> float:
    """Return the share of a population that is rank one; failures never are. Both of shape (n,)."""
    return float(np.mean((rank == 1) & ~failed))


def stopped_by(share: float, wanted_share: float | None, generations_done: int, generations: int) -> str | None:
    """Return why the search ends now, or None if it goes on.

    Parameters
    ----------
    share : float
        Share of rank one in the population.
    wanted_share : float, optional
        Stop at this share (0.9 in the reference paper); None: never for this reason.
    generations_done, generations : int
        Generations evaluated, the initial population included, and how many are allowed.
    """
    # An integer share such as 90 of 100 must count whatever its rounding.
    if wanted_share is not None and share >= wanted_share - 1e-12:
        return RANK_ONE_SHARE
    return GENERATION_LIMIT if generations_done >= generations else None
