"""How good is the genetic search? Its final hypervolume against pymoo's NSGA-II at the same number of evaluations.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from pilotgen.search.algorithm import SearchResult
from pilotgen.search.problem import Problem
from pilotgen.search.ranking import hypervolume
from pilotgen.search.search import run_search
from pilotgen.study.sections import SearchSettings


@dataclass(frozen=True)
class AgainstNsga2:
    """One seed: both algorithms from the same first population, with the same number of evaluations."""

    seed: int
    evaluations: int
    hypervolume: float  # of the genetic search's final population
    hypervolume_nsga2: float

    @property
    def ratio(self) -> float:
        """Hypervolume over NSGA-II's; above 1 the genetic search is ahead."""
        return self.hypervolume / self.hypervolume_nsga2


def final_hypervolume(result: SearchResult, reference: np.ndarray) -> float:
    """Return the hypervolume of a search's final population (two objectives). `reference` has shape (2,)."""
    return hypervolume(result.F[result.members[-1]], reference)


def compare_with_nsga2(
    settings: SearchSettings,
    evaluate: Callable[[np.ndarray], np.ndarray],
    seeds: Iterable[int],
    reference: np.ndarray | None = None,
) -> list[AgainstNsga2]:
    """Run both algorithms for each seed.

    Parameters
    ----------
    settings : SearchSettings
        Of the genetic search, its stopping rule included; NSGA-II gets as many generations as it used.
    evaluate : callable
        X of shape (n, n_var) -> F of shape (n, 2), NaN rows for failures. Keeping what was evaluated pays.
    seeds : iterable of int
        One comparison each.
    reference : ndarray, shape (2,), optional
        Reference point; by default the largest value of each objective in the first population.
    """
    comparisons = []
    for seed in seeds:
        mine = dataclasses.replace(settings, seed=seed, algorithm="goldberg")
        problem = Problem.from_settings(mine)
        result = run_search(problem, mine, lambda X, _: evaluate(X))
        theirs = dataclasses.replace(
            mine,
            algorithm="nsga2",
            generations=len(result.members),
            stop_rank_one_fraction=None,
            stop_unchanged_generations=None,
        )
        other = run_search(problem, theirs, lambda X, _: evaluate(X))
        if reference is None:
            point = np.nanmax(result.F[result.generation == 0], axis=0)
            # An objective that no pilot moves (a phase margin that none has) must not make every volume zero.
            everything = np.concatenate((result.F, other.F))
            point = point + (np.nanmin(everything, axis=0) == np.nanmax(everything, axis=0))
        else:
            point = np.asarray(reference)
        comparisons.append(
            AgainstNsga2(seed, len(result.F), final_hypervolume(result, point), final_hypervolume(other, point))
        )
    return comparisons
