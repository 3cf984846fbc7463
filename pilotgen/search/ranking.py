"""Who is worse than whom: successive non-dominated fronts, crowding within a front, hypervolume.

All objectives are minimised. A row of F with a NaN is a pilot that could not be evaluated: it ranks behind all others.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from bisect import bisect_right

import numpy as np


def non_dominated_rank(F: np.ndarray) -> np.ndarray:
    """Return each point's rank: 1 for the non-dominated set, 2 for that of the rest, and so on.

    A point dominates another if it is nowhere worse and somewhere better; equal points share their rank.

    Parameters
    ----------
    F : ndarray, shape (n, m)
        Objectives; rows with NaN are failures.

    Returns
    -------
    ndarray of int, shape (n,)
        Ranks from 1; failures have the last rank plus one.

    References
    ----------
    Goldberg, Genetic Algorithms in Search, Optimization, and Machine Learning, 1989, ch. 5.
    """
    F = np.asarray(F, dtype=float)
    failed = np.isnan(F).any(axis=1)
    rank = np.zeros(len(F), dtype=np.int64)
    if not failed.all():
        points, inverse = np.unique(F[~failed], axis=0, return_inverse=True)
        peel = _peel_two if F.shape[1] == 2 else _peel_many
        rank[~failed] = peel(points)[inverse.reshape(-1)]
    rank[failed] = rank.max(initial=0) + 1
    return rank


def _peel_two(points: np.ndarray) -> np.ndarray:
    # Distinct points come sorted by the first objective, then the second. A point is dominated by a member of a front
    # exactly if the front's smallest second objective so far is not above its own; these minima rise from front to
    # front.
    lowest: list[float] = []
    rank = np.empty(len(points), dtype=np.int64)
    for k, second in enumerate(points[:, 1].tolist()):
        front = bisect_right(lowest, second)
        rank[k] = front + 1
        if front == len(lowest):
            lowest.append(second)
        else:
            lowest[front] = second
    return rank


def _peel_many(points: np.ndarray) -> np.ndarray:
    dominates = np.asarray(
        (points[:, None, :] <= points[None, :, :]).all(axis=2)
    )  # distinct points: <= everywhere is enough
    np.fill_diagonal(dominates, False)
    dominators = dominates.sum(axis=0)
    rank = np.zeros(len(points), dtype=np.int64)
    current = 0
    while (rank == 0).any():
        current += 1
        front = (dominators == 0) & (rank == 0)
        rank[front] = current
        dominators = dominators - dominates[front].sum(axis=0)
    return rank


def crowding_distance(F: np.ndarray) -> np.ndarray:
    """Return how lonely each point of one front is: the sum over the objectives of the gap between its neighbours.

    Gaps are relative to the front's extent; the ends of the front are infinitely lonely. NaN rows get 0.

    References
    ----------
    Deb et al., A fast and elitist multiobjective genetic algorithm: NSGA-II, IEEE Trans. Evol. Comput. 6(2), 2002.
    """
    F = np.asarray(F, dtype=float)
    n = len(F)
    distance = np.zeros(n)
    if n == 0 or np.isnan(F).any():
        return distance
    for f in F.T:
        order = np.argsort(f, kind="stable")
        extent = f[order[-1]] - f[order[0]]
        distance[order[[0, -1]]] = np.inf
        if n > 2 and extent > 0.0:
            distance[order[1:-1]] += (f[order[2:]] - f[order[:-2]]) / extent
    return distance


def fittest(F: np.ndarray, n: int) -> np.ndarray:
    """Return the indices of the n fittest: by rank, within the rank that is cut by crowding, then by age.

    Parameters
    ----------
    F : ndarray, shape (k, m)
        Objectives, older individuals first; NaN rows are failures.
    n : int
        How many to keep.
    """
    rank = non_dominated_rank(F)
    chosen: list[int] = []
    for current in range(1, int(rank.max()) + 1):
        front = np.flatnonzero(rank == current)
        room = n - len(chosen)
        if len(front) > room:
            front = front[np.argsort(-crowding_distance(F[front]), kind="stable")[:room]]
        chosen.extend(front.tolist())
        if len(chosen) == n:
            break
    return np.array(chosen, dtype=np.int64)


def hypervolume(F: np.ndarray, reference: np.ndarray) -> float:
    """Return the area that a set of points dominates below a reference point (two objectives, exact).

    `F` has shape (n, 2), `reference` shape (2,). ValueError for another number of objectives.

    Points beyond the reference in any objective, and NaN rows, add nothing.
    """
    F = np.asarray(F, dtype=float)
    if F.ndim != 2 or F.shape[1] != 2:
        raise ValueError(f"hypervolume is for two objectives; F has shape {F.shape}")
    inside = F[(F < reference).all(axis=1)]
    area, ceiling = 0.0, float(reference[1])
    for first, second in inside[np.lexsort((inside[:, 1], inside[:, 0]))]:
        if second < ceiling:
            area += (float(reference[0]) - first) * (ceiling - second)
            ceiling = second
    return float(area)
