"""The genetic (de-)optimisation: breed the pilots with the smallest margins (docs/theory/search.md).

    problem      what is varied, within which bounds, and what is minimised
    sampling     the first population: a scrambled Sobol set
    ranking      successive non-dominated fronts, crowding, hypervolume
    operators    fitness, roulette wheel, crossover, mutation: pure functions with their own random streams
    termination  how far the search is, and why it stops
    algorithm    ask, tell, run
    nsga2        pymoo's NSGA-II behind the same ask and tell

SPDX-License-Identifier: BSD-3-Clause
"""

from pilotgen.search.algorithm import SearchResult
from pilotgen.search.genetic import GeneticSearch
from pilotgen.search.problem import Problem
from pilotgen.search.search import make_search, run_search

__all__ = ["GeneticSearch", "Problem", "SearchResult", "make_search", "run_search"]
