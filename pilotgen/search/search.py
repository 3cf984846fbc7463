"""A search from outside: choose an algorithm by the study's settings and run it to its end.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Callable

from pilotgen.search.algorithm import Evaluate, Search, SearchResult
from pilotgen.search.genetic import GeneticSearch
from pilotgen.search.problem import Problem
from pilotgen.study.sections import SearchSettings


def make_search(problem: Problem, settings: SearchSettings) -> Search:
    """Return the search that `settings.algorithm` names."""
    if settings.algorithm == "nsga2":
        from pilotgen.search.nsga2 import Nsga2Search  # imports pymoo

        return Nsga2Search(problem, settings)
    return GeneticSearch(problem, settings)


def run_search(
    problem: Problem,
    settings: SearchSettings,
    evaluate: Evaluate,
    callback: Callable[[Search], None] | None = None,
) -> SearchResult:
    """Search until a termination criterion is met.

    Parameters
    ----------
    problem, settings :
        What to search and how.
    evaluate : callable
        (X of shape (n, n_var), generation) -> F of shape (n, n_obj), NaN rows for failures.
    callback : callable, optional
        Called with the search after every generation.
    """
    search = make_search(problem, settings)
    while not search.finished:
        search.tell(evaluate(search.ask(), search.generation))
        if callback is not None:
            callback(search)
    return search.result()
