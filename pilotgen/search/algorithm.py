"""The genetic search: ask for a generation of pilots, be told their margins, breed the next.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pilotgen.search import ranking, termination
from pilotgen.search.problem import Problem
from pilotgen.study.sections import SearchSettings

Evaluate = Callable[[np.ndarray, int], np.ndarray]


@dataclass(frozen=True, eq=False)
class SearchResult:
    """Every evaluation of a search, in the order asked for, and the populations it went through.

    Attributes
    ----------
    problem : Problem
    X : ndarray, shape (n, n_var)
    F : ndarray, shape (n, n_obj)
        Objectives as ranked; NaN rows are failures.
    generation, individual : ndarray of int, shape (n,)
        Generation (0 is the initial population) and number within it.
    rank_at_birth : ndarray of int, shape (n,)
        Rank among parents and offspring when the individual was judged; 0 when failed.
    rank : ndarray of int, shape (n,)
        Front among all evaluations, 1 = the worst pilots; 0 when failed.
    members : ndarray of int, shape (n_gen, N)
        Indices of the population after each generation.
    front : ndarray of int
        Indices of the final population's members that are rank one.
    stopped_by : str
        `rank one share`, `converged` or `generation limit`; empty while the search is going on.
    """

    problem: Problem
    X: np.ndarray
    F: np.ndarray
    generation: np.ndarray
    individual: np.ndarray
    rank_at_birth: np.ndarray
    rank: np.ndarray
    members: np.ndarray
    front: np.ndarray
    stopped_by: str

    @property
    def failed(self) -> np.ndarray:
        """True for pilots that could not be evaluated, shape (n,)."""
        return np.asarray(np.isnan(self.F).any(axis=1))


class Search(ABC):
    """Book-keeping common to the algorithms: history, population, termination. Letters as in pymoo: X, F, xl, xu."""

    def __init__(self, problem: Problem, settings: SearchSettings) -> None:
        self.problem = problem
        self.settings = settings
        self.generation = 0  # the one that is asked for next
        self.stopped_by = ""
        self._X = np.empty((0, problem.n_var))
        self._F = np.empty((0, problem.n_obj))
        self._known: set[bytes] = set()  # rows of _X
        self._generation_of: list[int] = []
        self._individual_of: list[int] = []
        self._rank_at_birth: list[int] = []
        self._members: list[np.ndarray] = []
        self._asked: np.ndarray | None = None

    @property
    def finished(self) -> bool:
        """Whether a termination criterion is met."""
        return bool(self.stopped_by)

    @property
    def progress(self) -> float:
        """Share of the allowed generations that is done; 1 when finished."""
        return 1.0 if self.finished else self.generation / self.settings.generations

    @property
    def population(self) -> np.ndarray:
        """Indices of the present population in the history. Shape (individuals,)."""
        return self._members[-1]

    def ask(self) -> np.ndarray:
        """Return the next individuals to evaluate, shape (n, n_var); the same ones until `tell`.

        RuntimeError after the end of the search.
        """
        if self.finished:
            raise RuntimeError(f"the search is over: {self.stopped_by}")
        if self._asked is None:
            self._asked = self._next()
        return self._asked.copy()

    def tell(self, F: np.ndarray, failed: np.ndarray | None = None) -> None:
        """Take the objectives of the individuals asked for.

        ValueError if F has another shape, RuntimeError if nothing was asked.

        Parameters
        ----------
        F : ndarray, shape (n, n_obj)
            Objectives as ranked; a row with a NaN is a failure.
        failed : ndarray of bool, shape (n,), optional
            Further failures.
        """
        if self._asked is None:
            raise RuntimeError("tell comes after ask")
        X, F = self._asked, np.array(F, dtype=float)
        if F.shape != (len(X), self.problem.n_obj):
            raise ValueError(f"objectives of shape {(len(X), self.problem.n_obj)} are wanted, got {F.shape}")
        if failed is not None:
            F[np.asarray(failed, dtype=bool)] = np.nan
        F[np.isnan(F).any(axis=1)] = np.nan
        if np.isinf(F).any():
            raise ValueError("objectives must be finite: infinite margins are capped before they are ranked")
        first = len(self._X)
        new = np.arange(first, first + len(X))
        self._known.update(x.tobytes() for x in X)
        self._X, self._F = np.concatenate((self._X, X)), np.concatenate((self._F, F))
        self._generation_of += [self.generation] * len(X)
        self._individual_of += range(len(X))
        pool = np.concatenate((self._members[-1], new)) if self._members else new
        rank = ranking.non_dominated_rank(self._F[pool])
        rank[np.isnan(self._F[pool]).any(axis=1)] = 0
        self._rank_at_birth += rank[len(pool) - len(new) :].tolist()
        self._members.append(self._survivors(pool, new))
        self._asked = None
        self.generation += 1
        kept = self._F[self.population]
        share = termination.rank_one_share(ranking.non_dominated_rank(kept), np.isnan(kept).any(axis=1))
        settings = self.settings
        self.stopped_by = (
            termination.stopped_by(share, settings.stop_rank_one_fraction, self.generation, settings.generations) or ""
        )
        if self.stopped_by != termination.RANK_ONE_SHARE and settings.stop_unchanged_generations is not None:
            generation = np.array(self._generation_of)
            if termination.converged(self._F, generation, settings.stop_unchanged_generations):
                self.stopped_by = termination.CONVERGED

    def result(self) -> SearchResult:
        """Return all that happened so far."""
        failed = np.asarray(np.isnan(self._F).any(axis=1))
        rank = ranking.non_dominated_rank(self._F)
        rank[failed] = 0
        if self._members:
            of_final = ranking.non_dominated_rank(self._F[self.population])
            front = np.sort(self.population[(of_final == 1) & ~failed[self.population]])
        else:
            front = np.empty(0, dtype=np.int64)
        return SearchResult(
            self.problem,
            self._X.copy(),
            self._F.copy(),
            np.array(self._generation_of, dtype=np.int64),
            np.array(self._individual_of, dtype=np.int64),
            np.array(self._rank_at_birth, dtype=np.int64),
            rank,
            np.array(self._members, dtype=np.int64),
            front,
            self.stopped_by,
        )

    @abstractmethod
    def _next(self) -> np.ndarray:
        """Return the individuals of this generation."""

    @abstractmethod
    def _survivors(self, pool: np.ndarray, new: np.ndarray) -> np.ndarray:
        """Return which of the history's individuals `pool` (parents and the new ones) form the next population."""
