"""pymoo's NSGA-II behind the same ask and tell, with the same first population.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from typing import Any

import numpy as np

from pilotgen.search import sampling
from pilotgen.search.algorithm import Search
from pilotgen.search.problem import Problem
from pilotgen.study.sections import SearchSettings


class Nsga2Search(Search):
    """NSGA-II with pymoo's default operators, mutation included (the study's `mutation_probability` is not used).

    References
    ----------
    Blank and Deb, pymoo: Multi-objective Optimization in Python, IEEE Access 8, 2020.
    """

    def __init__(self, problem: Problem, settings: SearchSettings) -> None:
        super().__init__(problem, settings)
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.core.problem import Problem as PymooProblem

        first = sampling.sobol(
            settings.population, problem.xl, problem.xu, sampling.stream(settings.seed, 0, "sampling")
        )
        self._nsga2: Any = NSGA2(pop_size=settings.population, sampling=first)
        # A failure is an infeasible individual: ranked behind all others, without an invented objective.
        self._nsga2.setup(
            PymooProblem(n_var=problem.n_var, n_obj=problem.n_obj, n_ieq_constr=1, xl=problem.xl, xu=problem.xu),
            termination=("n_gen", settings.generations),
            seed=settings.seed,
        )
        self._offspring: Any = None

    def _next(self) -> np.ndarray:
        self._offspring = self._nsga2.ask()
        return np.array(self._offspring.get("X"), dtype=float)

    def _survivors(self, pool: np.ndarray, new: np.ndarray) -> np.ndarray:
        from pymoo.core.evaluator import Evaluator
        from pymoo.problems.static import StaticProblem

        F = self._F[new]
        failed = np.isnan(F).any(axis=1)
        told = StaticProblem(
            self._nsga2.problem, F=np.where(failed[:, None], 0.0, F), G=np.where(failed, 1.0, -1.0)[:, None]
        )
        Evaluator().eval(told, self._offspring)
        for individual, index in zip(self._offspring, new, strict=True):
            individual.set("history_index", int(index))
        self._nsga2.tell(infills=self._offspring)
        return np.array([individual.get("history_index") for individual in self._nsga2.pop], dtype=np.int64)
