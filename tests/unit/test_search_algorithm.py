"""The search as a whole: elitism, termination, failures, reproducibility, both algorithms behind one function.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import numpy as np
import pytest

from pilotgen.search import GeneticSearch, Problem, SearchResult, make_search, run_search
from pilotgen.search.algorithm import Search
from pilotgen.search.ranking import non_dominated_rank
from pilotgen.search.sampling import sobol
from pilotgen.search.termination import (
    CONVERGED,
    GENERATION_LIMIT,
    RANK_ONE_SHARE,
    converged,
    rank_one_share,
    stopped_by,
)
from pilotgen.study.sections import SearchSettings

ALGORITHMS = ["goldberg", "nsga2"]


def settings(**changes: object) -> SearchSettings:
    values: dict[str, object] = {
        "variables": {"a": (-2.0, 3.0), "b": (0.0, 1.0), "c": (10.0, 20.0)},
        "objectives": ("gain_margin_db", "phase_margin_deg"),
        "population": 20,
        "generations": 8,
        "mutation_probability": 0.1,
        "seed": 1,
        "algorithm": "goldberg",
        "stop_rank_one_fraction": None,
    }
    return SearchSettings(**{**values, **changes})  # type: ignore[arg-type]


def two_parabolas(X: np.ndarray) -> np.ndarray:
    rest = 10.0 * X[:, 1] + (X[:, 2] - 12.0) ** 2
    return np.stack((X[:, 0] ** 2 + rest, (X[:, 0] - 1.0) ** 2 + rest), axis=1)


def run(chosen: SearchSettings, function=two_parabolas) -> SearchResult:  # type: ignore[no-untyped-def]
    return run_search(Problem.from_settings(chosen), chosen, lambda X, _: function(X))


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_history_is_complete_and_consistent(algorithm: str) -> None:
    result = run(settings(algorithm=algorithm))
    assert result.X.shape == (160, 3) and result.F.shape == (160, 2)
    np.testing.assert_array_equal(result.generation, np.repeat(np.arange(8), 20))
    np.testing.assert_array_equal(result.individual, np.tile(np.arange(20), 8))
    np.testing.assert_array_equal(result.F, two_parabolas(result.X))
    assert result.members.shape == (8, 20)
    np.testing.assert_array_equal(np.sort(result.members[0]), np.arange(20))
    for generation, members in enumerate(result.members):
        assert len(set(members.tolist())) == 20
        assert (result.generation[members] <= generation).all()
    np.testing.assert_array_equal(result.rank, non_dominated_rank(result.F))
    assert set(result.front) <= set(result.members[-1])
    assert (non_dominated_rank(result.F[result.members[-1]])[np.isin(result.members[-1], result.front)] == 1).all()
    assert result.stopped_by == GENERATION_LIMIT
    assert (result.X >= result.problem.xl).all() and (result.X <= result.problem.xu).all()


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_same_seed_same_result_another_seed_another(algorithm: str) -> None:
    first, again, other = (run(settings(algorithm=algorithm, seed=seed)) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.X, again.X)
    np.testing.assert_array_equal(first.members, again.members)
    assert (first.X[:20] != other.X[:20]).all()


def test_the_global_random_state_neither_matters_nor_changes() -> None:
    np.random.seed(0)  # noqa: NPY002
    first = run(settings())
    state = np.random.get_state()[1].copy()  # type: ignore[union-attr, index]  # noqa: NPY002
    np.random.seed(99)  # noqa: NPY002
    np.testing.assert_array_equal(run(settings()).X, first.X)
    np.random.seed(0)  # noqa: NPY002
    np.testing.assert_array_equal(np.random.get_state()[1], state)  # type: ignore[index]  # noqa: NPY002


def test_both_algorithms_start_from_the_same_population() -> None:
    a, b = (run(settings(algorithm=algorithm, generations=2)) for algorithm in ALGORITHMS)
    np.testing.assert_array_equal(a.X[:20], b.X[:20])


def test_a_longer_search_begins_like_a_shorter_one() -> None:
    short, long = run(settings(generations=3)), run(settings(generations=8))
    np.testing.assert_array_equal(long.X[:60], short.X)


def test_elitism_keeps_the_best_of_parents_and_offspring() -> None:
    result = run(settings(generations=12))
    for g in range(1, len(result.members)):
        before, after = result.members[g - 1], result.members[g]
        offspring = np.flatnonzero(result.generation == g)
        pool = np.concatenate((before, offspring))
        rank = non_dominated_rank(result.F[pool])
        lost = ~np.isin(pool, after)
        assert rank[~lost].max() <= rank[lost].min()
        np.testing.assert_array_equal(result.rank_at_birth[offspring], rank[20:])
    best = [result.F[m].min(axis=0) for m in result.members]
    assert (np.diff(best, axis=0) <= 0.0).all(), "the ends of the front are never lost"


def test_no_individual_is_evaluated_twice() -> None:
    result = run(settings(generations=40, variables={"a": (-2.0, 3.0), "b": (0.0, 1.0), "c": (10.0, 20.0)}))
    assert len(np.unique(result.X, axis=0)) == len(result.X)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_failures_are_kept_as_nan_and_never_survive(algorithm: str) -> None:
    def sometimes(X: np.ndarray) -> np.ndarray:
        F = two_parabolas(X)
        F[X[:, 0] < 0.0] = np.nan  # forty per cent of the box, with one half of the front's surroundings
        return F

    result = run(settings(algorithm=algorithm), sometimes)
    assert 0 < result.failed.sum() < len(result.F)
    np.testing.assert_array_equal(result.failed, result.X[:, 0] < 0.0)
    assert (result.rank[result.failed] == 0).all() and (result.rank[~result.failed] > 0).all()
    assert (result.rank_at_birth[result.failed] == 0).all()
    assert not result.failed[result.members[-1]].any()
    assert not result.failed[result.front].any()


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_search_in_which_all_fail_ends_without_a_front(algorithm: str) -> None:
    result = run(settings(algorithm=algorithm, stop_rank_one_fraction=0.9), lambda X: np.full((len(X), 2), np.nan))
    assert result.stopped_by == GENERATION_LIMIT
    assert len(result.front) == 0 and (result.rank == 0).all()


def test_failures_can_be_told_by_a_mask() -> None:
    search = GeneticSearch(Problem.from_settings(settings()), settings())
    mask = np.arange(20) == 3
    search.tell(two_parabolas(search.ask()), mask)
    np.testing.assert_array_equal(search.result().failed, mask)


def test_the_search_stops_at_ninety_per_cent_rank_one() -> None:
    def line(X: np.ndarray) -> np.ndarray:  # every point is on the front
        return np.stack((X[:, 0], -X[:, 0]), axis=1)

    result = run(settings(stop_rank_one_fraction=0.9), line)
    assert result.stopped_by == RANK_ONE_SHARE and len(result.members) == 1
    result = run(settings(stop_rank_one_fraction=0.9, generations=50))
    assert result.stopped_by == RANK_ONE_SHARE
    share = [np.mean(non_dominated_rank(result.F[m]) == 1) for m in result.members]
    assert share[-1] >= 0.9 and max(share[:-1]) < 0.9


def test_termination_rules() -> None:
    rank = np.array([1] * 9 + [2])
    assert rank_one_share(rank, np.zeros(10, dtype=bool)) == pytest.approx(0.9)
    assert rank_one_share(rank, np.arange(10) == 0) == pytest.approx(0.8)
    assert stopped_by(0.9, 0.9, 1, 30) == RANK_ONE_SHARE
    assert stopped_by(0.1 + 0.2 + 0.6, 0.9, 1, 30) == RANK_ONE_SHARE, "0.1 + 0.2 + 0.6 is a rounding below 0.9"
    assert stopped_by(0.89, 0.9, 1, 30) is None
    assert stopped_by(1.0, None, 1, 30) is None
    assert stopped_by(0.0, 0.9, 30, 30) == GENERATION_LIMIT


def test_a_search_that_finds_nothing_more_stops_and_says_so() -> None:
    F = np.array([[4.0, 1.0], [1.0, 4.0], [np.nan, np.nan], [2.0, 2.0], [1.9, 2.5], [2.0005, 2.0], [4.0, 0.9985]])
    generation = np.array([0, 0, 0, 1, 2, 3, 4])
    assert not converged(F[:4], generation[:4], 1), "the front has a new corner"
    assert not converged(F[:5], generation[:5], 1), "the front grew, though no objective has a new minimum"
    assert converged(F[:6], generation[:6], 1), "a step of less than 0.1 % of the first generation's range is none"
    assert not converged(F[:6], generation[:6], 2)
    assert converged(F, generation, 2)
    assert not converged(np.full((3, 2), np.nan), np.array([0, 1, 2]), 2), "of pilots who all fail nothing is known"


def test_convergence_ends_a_search_before_its_limit() -> None:
    def corner(X: np.ndarray) -> np.ndarray:
        return np.stack((X[:, 0] + X[:, 1] + X[:, 2],) * 2, axis=1)

    result = run(settings(generations=80, stop_unchanged_generations=5), corner)
    assert result.stopped_by == CONVERGED and 6 <= len(result.members) < 80
    np.testing.assert_allclose(result.F.min(axis=0), [8.0, 8.0], atol=0.1)
    limited = run(settings(generations=8), lambda X: np.ones((len(X), 2)))
    assert limited.stopped_by == GENERATION_LIMIT


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_ask_and_tell(algorithm: str) -> None:
    chosen = settings(algorithm=algorithm, generations=2)
    search = make_search(Problem.from_settings(chosen), chosen)
    with pytest.raises(RuntimeError, match="tell comes after ask"):
        search.tell(np.zeros((20, 2)))
    X = search.ask()
    np.testing.assert_array_equal(search.ask(), X)
    X[:] = 0.0  # a copy
    assert (search.ask()[:, 2] >= 10.0).all()
    with pytest.raises(ValueError, match=r"shape \(20, 2\) are wanted"):
        search.tell(np.zeros((20, 3)))
    with pytest.raises(ValueError, match="capped"):
        search.tell(np.full((20, 2), np.inf))
    assert search.progress == 0.0
    search.tell(two_parabolas(search.ask()))
    assert search.progress == 0.5 and not search.finished
    search.tell(two_parabolas(search.ask()))
    assert search.progress == 1.0 and search.finished
    with pytest.raises(RuntimeError, match="the search is over: generation limit"):
        search.ask()


def test_the_callback_sees_every_generation() -> None:
    seen: list[tuple[int, int]] = []
    chosen = settings(generations=4)

    def callback(search: Search) -> None:
        seen.append((search.generation, len(search.result().F)))

    run_search(Problem.from_settings(chosen), chosen, lambda X, _: two_parabolas(X), callback)
    assert seen == [(1, 20), (2, 40), (3, 60), (4, 80)]


@pytest.mark.parametrize("population", [4, 5, 7])
def test_small_and_odd_populations(population: int) -> None:
    result = run(settings(population=population, generations=5))
    assert result.members.shape == (5, population)


@pytest.mark.parametrize("objectives", [("gain_margin_db",), ("a", "b", "c")])
def test_one_and_three_objectives(objectives: tuple[str, ...]) -> None:
    target = np.linspace(0.0, 1.0, len(objectives))

    def function(X: np.ndarray) -> np.ndarray:
        return np.asarray((X[:, :1] - target) ** 2 + X[:, 1:2] + (X[:, 2:] - 10.0) ** 2)

    result = run(settings(objectives=objectives, generations=20), function)
    assert result.F.shape == (400, len(objectives))
    problem = result.problem
    as_many = function(sobol(400, problem.xl, problem.xu, np.random.default_rng(1)))
    assert result.F.sum(axis=1).min() < as_many.sum(axis=1).min(), "better than as many points without a search"


def test_an_objective_that_nothing_moves_leaves_the_hypervolume_of_the_other() -> None:
    from pilotgen.search.quality import compare_with_nsga2
    from pilotgen.study.sections import SearchSettings

    settings = SearchSettings(
        variables={"bmi": (18.0, 30.0), "stature_m": (1.55, 2.0)},
        objectives=("gain_margin_db", "phase_margin_deg"),
        population=12,
        generations=6,
        mutation_probability=0.1,
        seed=1,
        algorithm="goldberg",
        stop_rank_one_fraction=None,
    )

    def one_objective(X: np.ndarray) -> np.ndarray:
        return np.column_stack([(X[:, 0] - 25.0) ** 2 + 100.0 * (X[:, 1] - 1.9) ** 2, np.full(len(X), 180.0)])

    (found,) = compare_with_nsga2(settings, one_objective, [1])
    assert found.hypervolume > 0.0 and found.hypervolume_nsga2 > 0.0
    assert 0.8 < found.ratio < 1.25
