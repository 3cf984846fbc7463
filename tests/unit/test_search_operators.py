"""The operators: their statistics, their bounds, their reproducibility.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pilotgen.search import operators

XL, XU = np.array([25.0, 18.0, 1.55]), np.array([65.0, 30.0, 2.0])


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def population(n: int, seed: int = 0) -> np.ndarray:
    return XL + rng(seed).random((n, 3)) * (XU - XL)


def test_fitness_is_inversely_proportional_to_the_rank() -> None:
    np.testing.assert_allclose(operators.fitness(np.array([1, 2, 4])), [1.0, 0.5, 0.25])


def test_roulette_wheel_picks_in_proportion_to_the_weight() -> None:
    weights = np.array([1.0, 0.5, 0.25, 0.25])
    n = 200_000
    pairs = operators.roulette_pairs(weights, n, rng())
    share = np.bincount(pairs[:, 0], minlength=4) / n
    # standard error of a share of n draws is sqrt(p (1 - p) / n) < 1.2e-3; five of them
    np.testing.assert_allclose(share, weights / 2.0, atol=6e-3)
    for first in range(4):  # given the first, the second is drawn from the others in proportion to their weights
        second = pairs[pairs[:, 0] == first, 1]
        others = np.where(np.arange(4) == first, 0.0, weights)
        share = np.bincount(second, minlength=4) / len(second)
        np.testing.assert_allclose(share, others / others.sum(), atol=5 * 0.5 / np.sqrt(len(second)))


@given(st.lists(st.floats(1e-3, 1.0), min_size=2, max_size=20), st.integers(0, 2**32))
def test_parents_are_two_different_individuals(weights: list[float], seed: int) -> None:
    pairs = operators.roulette_pairs(np.array(weights), 50, rng(seed))
    assert pairs.min() >= 0 and pairs.max() < len(weights)
    assert (pairs[:, 0] != pairs[:, 1]).all()


def test_roulette_at_the_edges_of_the_wheel() -> None:
    class Fixed:
        def __init__(self, spins: list[list[float]]) -> None:
            self.spins = np.array(spins)

        def random(self, shape: tuple[int, int]) -> np.ndarray:
            assert shape == self.spins.shape
            return self.spins

    last = np.nextafter(1.0, 0.0)
    spins = [[0.0, 0.0], [last, last], [0.0, last], [last, 0.0], [0.5, 0.5]]
    pairs = operators.roulette_pairs(np.array([1.0, 1.0]), 5, Fixed(spins))  # type: ignore[arg-type]
    np.testing.assert_array_equal(pairs, [[0, 1], [1, 0], [0, 1], [1, 0], [1, 0]])


def test_crossover_keeps_the_parents_mean_and_the_bounds() -> None:
    # Parents far from the bounds: no child is cut off, and each pair of children has its parents' mean.
    parents = 0.5 * (XL + XU) + (rng().random((500, 2, 3)) - 0.5) * 0.02 * (XU - XL)
    children = operators.simulated_binary_crossover(parents, XL, XU, rng(1), eta=15.0)
    np.testing.assert_allclose(0.5 * (children[:500] + children[500:]), parents.mean(axis=1), rtol=1e-12)
    wide = operators.simulated_binary_crossover(np.stack((population(500), population(500, 1)), axis=1), XL, XU, rng(2))
    assert (wide >= XL).all() and (wide <= XU).all()
    assert (wide == XU).any() and (wide == XL).any(), "children beyond a bound are put on it"


@pytest.mark.parametrize("eta", [2.0, 3.0, 15.0])
def test_crossover_spread_follows_its_distribution(eta: float) -> None:
    # Spread factor beta = |children's distance / parents' distance|: P(beta <= b) = b^(eta+1) / 2 for b <= 1.
    xl, xu = np.array([-1e9]), np.array([1e9])
    parents = np.tile(np.array([[[0.0], [1.0]]]), (200_000, 1, 1))
    children = operators.simulated_binary_crossover(parents, xl, xu, rng(3), eta)
    beta = np.abs(children[:200_000] - children[200_000:])[:, 0]
    blended = beta[np.abs(beta - 1.0) > 1e-12]
    assert len(blended) == pytest.approx(100_000, abs=5 * 224)  # one variable in two; sigma = sqrt(n / 4)
    for b in (0.5, 0.8, 0.9, 1.0):
        assert np.mean(blended <= b) == pytest.approx(0.5 * b ** (eta + 1.0), abs=5 * 0.5 / np.sqrt(len(blended)))
    for b in (1.2, 2.0):  # P(beta > b) = b^-(eta+1) / 2
        assert np.mean(blended > b) == pytest.approx(0.5 * b ** -(eta + 1.0), abs=5 * 0.5 / np.sqrt(len(blended)))


def test_crossover_inherits_unblended_variables_exactly_or_blends_them() -> None:
    same = np.repeat(population(50)[:, None, :], 2, axis=1)
    children = operators.simulated_binary_crossover(same, XL, XU, rng())
    np.testing.assert_allclose(children, np.concatenate((same[:, 0], same[:, 0])), rtol=1e-15)


def test_polynomial_mutation_stays_inside_and_is_mostly_small() -> None:
    X = np.concatenate((population(20_000), np.tile(XL, (100, 1)), np.tile(XU, (100, 1))))
    moved = operators.polynomial_mutation(X, XL, XU, rng(4))
    assert (moved >= XL).all() and (moved <= XU).all()
    step = np.abs(moved - X) / (XU - XL)
    assert (step > 0).mean() > 0.98
    assert np.median(step) < 0.06
    middle = np.tile(0.5 * (XL + XU), (100_000, 1))
    step = (operators.polynomial_mutation(middle, XL, XU, rng(5)) - middle) / (XU - XL)
    # far from the bounds P(|step| <= d) = 1 - (1 - d)^(eta + 1), up to 2^-(eta+1) = 5e-7; symmetric
    for d in (0.01, 0.05, 0.2):
        expected = 1.0 - (1.0 - d) ** (operators.MUTATION_ETA + 1.0)
        assert np.mean(np.abs(step) <= d) == pytest.approx(expected, abs=5 * 0.5 / np.sqrt(step.size))
    assert abs(step.mean()) < 5 * step.std() / np.sqrt(step.size)


class Drawn:
    """A random generator that draws what it is told."""

    def __init__(self, u: float) -> None:
        self.u = u

    def random(self, shape: tuple[int, ...]) -> np.ndarray:
        return np.full(shape, self.u)


@pytest.mark.parametrize("place", [0.02, 0.3, 0.97])
@pytest.mark.parametrize("u", [0.0, 0.1, 0.4, 0.5, 0.6, 0.9, 1.0])
def test_mutation_near_a_bound_follows_the_truncated_density(place: float, u: float) -> None:
    # density (1 - |d|)^eta of the step d in widths, each side cut at its bound and given half of the probability
    x = XL + place * (XU - XL)
    step = ((operators.polynomial_mutation(x[None], XL, XU, Drawn(u))[0] - x) / (XU - XL))[0]  # type: ignore[arg-type]
    room = place if u < 0.5 else 1.0 - place
    d = np.linspace(0.0, room, 200_001)
    density = (1.0 - d) ** operators.MUTATION_ETA
    share = np.concatenate(([0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))))
    nearer = np.interp(abs(step), d, share / share[-1])  # of the side's probability lies nearer than the step
    if place in (0.02, 0.97) or u not in (0.0, 1.0):  # far from the bounds the tail is too thin to invert
        assert nearer == pytest.approx(abs(1.0 - 2.0 * u), abs=1e-6)
    if u in (0.0, 1.0):
        assert abs(step) == pytest.approx(room, rel=1e-6)


def test_mutation_touches_one_variable_of_ten_per_cent() -> None:
    X = population(50_000)
    changed = operators.mutate_some(X, XL, XU, 0.10, rng(6)) != X
    count = changed.sum(axis=1)
    assert count.max() == 1
    assert count.mean() == pytest.approx(0.10, abs=5 * np.sqrt(0.1 * 0.9 / 50_000))
    share = changed.sum(axis=0) / changed.sum()
    np.testing.assert_allclose(share, 1.0 / 3.0, atol=5 * np.sqrt(2 / 9 / changed.sum()))
    np.testing.assert_array_equal(operators.mutate_some(X, XL, XU, 0.0, rng()), X)
    assert (operators.mutate_some(X, XL, XU, 1.0, rng()) != X).any(axis=1).all()


def test_copies_are_replaced_and_originals_left_alone() -> None:
    X = population(10)
    known = {X[0].tobytes(), X[1].tobytes()}
    X = np.concatenate((X, X[[5, 5]]))
    new = operators.replace_copies(X, known, XL, XU, rng(7))
    assert len(np.unique(new, axis=0)) == len(new)
    assert not {x.tobytes() for x in new} & known
    np.testing.assert_array_equal(new[2:10], X[2:10])
    assert (new >= XL).all() and (new <= XU).all()


def test_operators_leave_their_inputs_alone_and_repeat_themselves() -> None:
    X, parents = population(40), np.stack((population(20, 1), population(20, 2)), axis=1)
    calls = [
        lambda: operators.roulette_pairs(np.linspace(0.1, 1, 40), 20, rng(8)),
        lambda: operators.simulated_binary_crossover(parents, XL, XU, rng(8)),
        lambda: operators.polynomial_mutation(X, XL, XU, rng(8)),
        lambda: operators.mutate_some(X, XL, XU, 0.5, rng(8)),
        lambda: operators.replace_copies(X, {X[0].tobytes()}, XL, XU, rng(8)),
    ]
    before = X.tobytes() + parents.tobytes()
    for call in calls:
        np.testing.assert_array_equal(call(), call())
    assert X.tobytes() + parents.tobytes() == before
