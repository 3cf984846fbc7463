"""Fronts, crowding, survival and hypervolume against brute force.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pilotgen.search.ranking import crowding_distance, fittest, hypervolume, non_dominated_rank

small = st.integers(1, 3).flatmap(
    lambda m: st.lists(st.lists(st.integers(0, 4).map(float), min_size=m, max_size=m), min_size=1, max_size=25)
)


def brute_force_rank(F: np.ndarray) -> np.ndarray:
    """Remove the points that nothing left dominates, again and again."""
    rank = np.zeros(len(F), dtype=int)
    left, current = set(range(len(F))), 1
    while left:
        front = [i for i in left if not any((F[j] <= F[i]).all() and (F[j] < F[i]).any() for j in left if j != i)]
        rank[front] = current
        left -= set(front)
        current += 1
    return rank


@given(small)
def test_ranks_against_brute_force(rows: list[list[float]]) -> None:
    F = np.array(rows)
    np.testing.assert_array_equal(non_dominated_rank(F), brute_force_rank(F))


@pytest.mark.parametrize("m", [1, 2, 3])
def test_ranks_of_many_random_points(m: int) -> None:
    F = np.random.default_rng(m).normal(size=(120, m))
    np.testing.assert_array_equal(non_dominated_rank(F), brute_force_rank(F))


def test_a_known_case() -> None:
    F = np.array([[1, 5], [2, 3], [4, 1], [2, 5], [5, 5], [2, 3]], dtype=float)
    np.testing.assert_array_equal(non_dominated_rank(F), [1, 1, 1, 2, 3, 1])


def test_failures_rank_behind_all() -> None:
    F = np.array([[1.0, 2.0], [np.nan, 0.0], [3.0, 3.0], [np.nan, np.nan]])
    np.testing.assert_array_equal(non_dominated_rank(F), [1, 3, 2, 3])
    np.testing.assert_array_equal(non_dominated_rank(F[[1, 3]]), [1, 1])
    np.testing.assert_array_equal(fittest(F, 3), [0, 2, 1])


def test_crowding_by_hand() -> None:
    F = np.array([[0.0, 10.0], [1.0, 6.0], [4.0, 4.0], [10.0, 0.0]])
    # second point: (4 - 0) / 10 + (10 - 4) / 10; third: (10 - 1) / 10 + (6 - 0) / 10
    np.testing.assert_allclose(crowding_distance(F), [np.inf, 1.0, 1.5, np.inf])


def test_crowding_of_one_two_and_equal_points() -> None:
    assert np.isinf(crowding_distance(np.array([[1.0, 2.0]]))).all()
    assert np.isinf(crowding_distance(np.array([[1.0, 2.0], [2.0, 1.0]]))).all()
    assert np.isfinite(crowding_distance(np.ones((5, 2)))).sum() == 3
    assert crowding_distance(np.empty((0, 2))).shape == (0,)


@given(small, st.data())
def test_survivors_never_leave_a_better_rank_behind(rows: list[list[float]], data: st.DataObject) -> None:
    F = np.array(rows)
    n = data.draw(st.integers(1, len(F)))
    chosen = fittest(F, n)
    assert len(set(chosen.tolist())) == n
    rank = brute_force_rank(F)
    left = np.setdiff1d(np.arange(len(F)), chosen)
    assert not len(left) or rank[chosen].max() <= rank[left].min()


def test_the_cut_rank_keeps_its_ends_and_its_loneliest() -> None:
    F = np.array([[0.0, 1.0], [0.30, 0.70], [0.31, 0.69], [0.32, 0.68], [0.65, 0.35], [1.0, 0.0]])
    assert sorted(fittest(F, 3).tolist()) == [0, 4, 5]


def test_hypervolume_by_hand() -> None:
    reference = np.array([4.0, 4.0])
    assert hypervolume(np.array([[1.0, 1.0]]), reference) == 9.0
    assert hypervolume(np.array([[1.0, 3.0], [3.0, 1.0], [2.0, 2.0]]), reference) == 1 * 3 + 1 * 2 + 1 * 1
    assert hypervolume(np.array([[5.0, 0.0], [4.0, 0.0], [np.nan, 1.0]]), reference) == 0.0
    assert hypervolume(np.empty((0, 2)), reference) == 0.0
    with pytest.raises(ValueError, match="two objectives"):
        hypervolume(np.ones((2, 3)), np.ones(3))


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), max_size=12))
def test_hypervolume_counts_cells(points: list[tuple[int, int]]) -> None:
    cells = sum(any(a <= x and b <= y for a, b in points) for x in range(8) for y in range(8))
    F = np.array(points, dtype=float).reshape(-1, 2)
    assert hypervolume(F, np.array([8.0, 8.0])) == cells


def test_hypervolume_against_pymoo() -> None:
    from pymoo.indicators.hv import HV

    F = np.random.default_rng(5).random((50, 2))
    reference = np.array([0.9, 1.1])
    assert hypervolume(F, reference) == pytest.approx(HV(ref_point=reference)(F), rel=1e-12)
