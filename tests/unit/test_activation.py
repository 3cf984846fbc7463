"""The quadratic programme of the activations on problems whose answers are known otherwise.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, minimize

from pilotgen.activation.activation import TORQUES, _least_effort
from pilotgen.errors import EvaluationError


def moment_arms(seed: int, muscles: int = 25) -> np.ndarray:
    """A (7, muscles) like an arm's: moment arms of some centimetres, forces of some hundred newtons."""
    rng = np.random.default_rng(seed)
    return np.asarray(rng.normal(size=(7, muscles)) * 0.02 * rng.uniform(150.0, 1300.0, muscles))


def test_without_active_bounds_it_is_the_least_norm_solution() -> None:
    # pairs of opposed muscles: half of each pair pulls
    A = np.hstack([30.0 * np.eye(7), -20.0 * np.eye(7)])
    b = np.array([3.0, -2.0, 1.0, 6.0, -4.0, 0.5, -1.0])
    a = _least_effort(A, b, 0.0, "left")
    expected = np.concatenate([np.where(b > 0, b / 30.0, 0.0), np.where(b < 0, -b / 20.0, 0.0)])
    assert a == pytest.approx(expected, abs=1e-14)


@given(st.integers(0, 10_000), st.sampled_from([0.0, 0.01, 0.05]))
@settings(max_examples=40, deadline=None)
def test_balance_bounds_and_optimality(seed: int, floor: float) -> None:
    A = moment_arms(seed)
    b = A @ np.random.default_rng(seed + 1).uniform(floor, 0.4, 25)  # can be balanced
    a = _least_effort(A, b, floor, "left")
    assert np.abs(A @ a - b).max() < 1e-9
    assert a.min() >= floor and a.max() <= 1.0
    # Karush-Kuhn-Tucker: a = A^T mu inside the bounds, below at the floor, above at one
    inside = (a > floor) & (a < 1.0)
    mu = np.linalg.lstsq(A[:, inside].T, a[inside], rcond=None)[0]
    price = A.T @ mu
    assert price[inside] == pytest.approx(a[inside], abs=1e-9)
    assert np.all(price[a <= floor] <= floor + 1e-9)
    assert np.all(price[a >= 1.0] >= 1.0 - 1e-9)


def test_agrees_with_another_optimiser() -> None:
    A = moment_arms(3)
    b = A @ np.random.default_rng(4).uniform(0.0, 0.6, 25)
    a = _least_effort(A, b, 0.0, "left")
    other = minimize(
        lambda x: x @ x,
        np.full(25, 0.3),
        jac=lambda x: 2 * x,
        bounds=[(0.0, 1.0)] * 25,
        constraints={"type": "eq", "fun": lambda x: A @ x - b, "jac": lambda x: A},
        method="SLSQP",
        options={"maxiter": 500, "ftol": 1e-11},
    )
    assert other.success
    assert a @ a == pytest.approx(other.fun, rel=1e-6)
    assert a == pytest.approx(other.x, abs=1e-4)


@pytest.mark.parametrize("joint", range(7))
def test_an_overload_names_the_joint_and_the_missing_moment(joint: int) -> None:
    A = np.hstack([30.0 * np.eye(7), -20.0 * np.eye(7)])
    b = np.full(7, 1.0)
    b[joint] = 34.5  # the muscle gives 30 N m
    with pytest.raises(EvaluationError) as caught:
        _least_effort(A, b, 0.0, "left")
    assert caught.value.stage == "activation"
    assert TORQUES[joint].replace("_", " ") in caught.value.reason
    assert "4.50 N m are missing (of 34.50 N m needed)" in caught.value.reason


@given(st.integers(0, 10_000))
@settings(max_examples=20, deadline=None)
def test_it_fails_only_when_no_activations_exist(seed: int) -> None:
    A = moment_arms(seed)
    b = np.random.default_rng(seed + 2).normal(size=7) * 60.0
    exists = linprog(np.zeros(25), A_eq=A, b_eq=b, bounds=[(0.0, 1.0)] * 25).status == 0
    try:
        a = _least_effort(A, b, 0.0, "right")
    except EvaluationError as error:
        assert not exists
        assert "right arm" in error.reason
    else:
        assert exists
        assert np.abs(A @ a - b).max() < 1e-8


@pytest.mark.parametrize("moments", [1.0, 0.0])
def test_programmes_with_one_point_only(moments: float) -> None:
    """Identity, every muscle at a bound: nothing is free, the answer is the bound."""
    a = _least_effort(np.eye(2), np.full(2, moments), 0.0, "left")
    np.testing.assert_allclose(a, np.full(2, moments), atol=1e-8)


@pytest.mark.parametrize("part", range(4))
def test_degenerate_programmes(part: int) -> None:
    """Random moment arms, muscles at their bounds, corners of what is reachable included: solved with least effort."""
    for seed in range(50):
        rng = np.random.default_rng([part, seed])
        A = rng.normal(size=(7, 25)) * 10.0 ** rng.uniform(-1.0, 1.5)
        if part == 3:
            A[rng.integers(7)] = A[rng.integers(7)]  # two moments by the same arms
        if part >= 1:
            a = (rng.normal(size=7) @ A > 0.0).astype(float)  # a corner: the only point with its moments
        else:
            a = rng.uniform(0.0, 1.0, 25)
            at_bound = rng.permutation(25)[: rng.integers(12, 23)]
            a[at_bound] = rng.integers(0, 2, at_bound.size)
        found = _least_effort(A, A @ a, 0.0, "left")
        assert np.abs(A @ (found - a)).max() <= 1e-8
        assert found.min() >= 0.0 and found.max() <= 1.0
        assert found @ found <= a @ a + 1e-6


def test_programmes_without_an_answer_are_refused() -> None:
    with pytest.raises(EvaluationError, match="1.00 N m are missing"):
        _least_effort(np.eye(7), np.array([2.0, *[0.5] * 6]), 0.0, "left")
