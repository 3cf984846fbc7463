"""How far a search is, and why it stops.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import numpy as np

from pilotgen.search.ranking import non_dominated_rank

# What study.h5 says in `stopped_by`.
RANK_ONE_SHARE = "rank one share"
GENERATION_LIMIT = "generation limit"
CONVERGED = "converged"

NOTHING = 1e-3  # of the first generation's range of an objective: a step that is none


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


def converged(F: np.ndarray, generation: np.ndarray, unchanged: int) -> bool:
    """Whether the last `unchanged` generations found nothing that those before had not found, or nearly so.

    Something is found if no earlier individual is as small in every objective, give or take `NOTHING`.

    Parameters
    ----------
    F : ndarray, shape (n, n_obj)
        Objectives of all individuals, NaN rows for failures.
    generation : ndarray of int, shape (n,)
        Generation of each, from 0.
    unchanged : int
        How many generations must have found nothing.
    """
    if not len(generation) or generation[-1] < unchanged:
        return False
    evaluated = ~np.isnan(F).any(axis=1)
    first = F[evaluated & (generation == 0)]
    late = generation > generation[-1] - unchanged
    old, new = F[evaluated & ~late], F[evaluated & late]
    if not len(first) or not len(old):
        return False
    step = NOTHING * np.ptp(first, axis=0)
    old = np.unique(old, axis=0)
    old = old[non_dominated_rank(old) == 1]
    return all(bool((old <= one + step).all(axis=1).any()) for one in np.unique(new, axis=0))
