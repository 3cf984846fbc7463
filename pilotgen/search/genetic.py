"""The genetic algorithm of the reference paper: ranking, roulette wheel, crossover, mutation, elitist survival.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import numpy as np

from pilotgen.search import operators, ranking, sampling
from pilotgen.search.algorithm import Search


class GeneticSearch(Search):
    """The algorithm of the reference paper's section 4."""

    def _stream(self, purpose: str) -> np.random.Generator:
        return sampling.stream(self.settings.seed, self.generation, purpose)

    def _next(self) -> np.ndarray:
        problem, n = self.problem, self.settings.population
        if self.generation == 0:
            return sampling.sobol(n, problem.xl, problem.xu, self._stream("sampling"))
        rank = ranking.non_dominated_rank(self._F[self.population])
        pairs = operators.roulette_pairs(operators.fitness(rank), (n + 1) // 2, self._stream("selection"))
        parents = self._X[self.population[pairs]]
        children = operators.simulated_binary_crossover(parents, problem.xl, problem.xu, self._stream("crossover"))[:n]
        children = operators.mutate_some(
            children, problem.xl, problem.xu, self.settings.mutation_probability, self._stream("mutation")
        )
        return operators.replace_copies(children, self._known, problem.xl, problem.xu, self._stream("replacement"))

    def _survivors(self, pool: np.ndarray, new: np.ndarray) -> np.ndarray:
        return np.asarray(pool[ranking.fittest(self._F[pool], self.settings.population)])
