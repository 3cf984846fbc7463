"""Which pilots of a study a page shows whole: the front, the worst, and some spread over the box.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import numpy as np

from pilotgen.report.findings import distinct
from pilotgen.runs.results import StudyResults

MOST_OF_FRONT, WORST, SPREAD = 100, 50, 100
SEED = 16  # of the Latin square; the same study gives the same page


def shown_whole(results: StudyResults, order: np.ndarray, front: np.ndarray) -> list[int]:
    """Indices of the pilots to evaluate again, the most important first.

    The worst; the front, spread along it; the 50 worst that differ; for each point of a Latin square of 100 the
    evaluated pilot nearest to it. `order` and `front` as of `findings.worst_order` and `first_front`, shapes
    (evaluated,) and (members,).
    """
    members = set(front.tolist())
    of_front = [index for index in order.tolist() if index in members]
    if len(of_front) > MOST_OF_FRONT:
        of_front = [of_front[k] for k in np.linspace(0, len(of_front) - 1, MOST_OF_FRONT).round().astype(int)]
    worst = distinct(results, order, WORST, share=0.0).tolist()
    every = [*order[:1].tolist(), *_alternating(of_front, worst, _spread(results, order))]
    return list(dict.fromkeys(every))


def _alternating(*lists: list[int]) -> list[int]:
    """One of each list in turn: what a page has room for is then some of each."""
    longest = max((len(one) for one in lists), default=0)
    return [one[k] for k in range(longest) for one in lists if k < len(one)]


def _spread(results: StudyResults, order: np.ndarray) -> list[int]:
    """The pilots nearest to the points of a Latin square in the box."""
    if not len(order):
        return []
    width = results.upper - results.lower
    place = (results.columns["inputs"][order] - results.lower) / np.where(width > 0.0, width, 1.0)
    rng = np.random.default_rng(SEED)
    variables = place.shape[1]
    cells = np.stack([rng.permutation(SPREAD) for _ in range(variables)], axis=1)
    points = (cells + 0.5) / SPREAD
    nearest = (np.square(points[:, None, :] - place[None]).sum(axis=2)).argmin(axis=1)
    return [int(order[k]) for k in nearest]
