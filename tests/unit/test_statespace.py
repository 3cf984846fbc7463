"""State-space models: response against the transfer function written out, interconnections against algebra.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import numpy as np
import pytest

from pilotgen.errors import PilotgenError
from pilotgen.linear.statespace import StateSpaceModel, series, transfer_function, zeros_poles_gain

OMEGA = np.geomspace(1e-3, 1e3, 41)


def polynomial_response(num: list[float], den: list[float], omega: np.ndarray) -> np.ndarray:
    return np.polyval(num, 1j * omega) / np.polyval(den, 1j * omega)


@pytest.mark.parametrize(
    ("num", "den"),
    [
        ([3.0], [1.0]),
        ([2.0], [1.0, 1.0]),
        ([1.0, 0.0], [1.0, 6.2, 9.61]),  # a double pole: no full set of eigenvectors
        ([2.0, 1.0, 5.0], [4.0, 0.2, 7.0]),
        ([1.0], [1.0, 4.0, 6.0, 4.0, 1.0]),
        ([1.0, 2.0], [1.0, 3.0, 0.0]),
    ],
)
def test_response_is_that_of_the_transfer_function(num: list[float], den: list[float]) -> None:
    model = transfer_function(num, den)
    assert model.n_states == len(den) - 1
    # Far above its poles a response of relative degree 4 is a small difference of large terms: absolute error counts.
    np.testing.assert_allclose(model.response(OMEGA), polynomial_response(num, den, OMEGA), rtol=1e-11, atol=1e-15)
    s = 0.3 + 1j * OMEGA
    np.testing.assert_allclose(model.at(s), np.polyval(num, s) / np.polyval(den, s), rtol=1e-11, atol=1e-15)


def test_response_keeps_the_shape_of_omega() -> None:
    model = transfer_function([1.0], [1.0, 1.0])
    assert model.response(2.0).shape == ()
    assert model.response(np.ones((2, 3))).shape == (2, 3)
    assert model.response([]).shape == (0,)


def test_response_is_not_finite_at_a_pole() -> None:
    assert not np.isfinite(transfer_function([1.0], [1.0, 0.0]).response(0.0))


def test_poles_by_rising_modulus() -> None:
    model = zeros_poles_gain([], [-3.0 + 4.0j, -3.0 - 4.0j, -1.0, -20.0], 1.0)
    np.testing.assert_allclose(np.abs(model.poles), [1.0, 5.0, 5.0, 20.0], rtol=1e-12)


def test_zeros_poles_gain_against_the_product() -> None:
    zeros = [0.0, -2.0, -0.01 + 3.0j, -0.01 - 3.0j]
    poles = [-1.0, -1.0, -0.001 + 2.0j, -0.001 - 2.0j, -5.0]
    model = zeros_poles_gain(zeros, poles, -4.0)
    s = 1j * OMEGA
    expected = -4.0 * np.prod([s - z for z in zeros], axis=0) / np.prod([s - p for p in poles], axis=0)
    np.testing.assert_allclose(model.response(OMEGA), expected, rtol=1e-9)
    assert model.n_states == 5


def test_interconnections() -> None:
    first, second = transfer_function([1.0, 5.0], [1.0, 2.0]), transfer_function([3.0], [1.0, 0.4, 9.0])
    a, b = first.response(OMEGA), second.response(OMEGA)
    np.testing.assert_allclose(series(first, second).response(OMEGA), a * b, rtol=1e-12)
    np.testing.assert_allclose(series(second, first).response(OMEGA), a * b, rtol=1e-12)
    np.testing.assert_allclose(first.feedback().response(OMEGA), a / (1.0 + a), rtol=1e-12)
    np.testing.assert_allclose(first.scaled(-2.0).response(OMEGA), -2.0 * a, rtol=1e-12)


def test_badly_scaled_model_keeps_its_digits() -> None:
    model = transfer_function([1.0, 5.0], [1.0, 0.7, 9.0, 3.0])
    scale = np.array([1e-9, 1.0, 1e9])
    scaled = StateSpaceModel(model.A / scale[:, None] * scale, model.B / scale, model.C * scale, model.D)
    np.testing.assert_allclose(scaled.response(OMEGA), model.response(OMEGA), rtol=1e-11)


@pytest.mark.parametrize(
    "arguments",
    [
        (np.eye(2), np.ones(3), np.ones(2), 0.0),
        (np.ones((2, 3)), np.ones(2), np.ones(2), 0.0),
        (np.eye(2), np.ones((2, 2)), np.ones(2), 0.0),
        (np.eye(2), np.ones(2), np.ones(2), [0.0, 1.0]),
        (np.array([[np.nan]]), np.ones(1), np.ones(1), 0.0),
        (np.eye(1), np.ones(1), np.ones(1), np.inf),
    ],
)
def test_matrices_that_do_not_fit_are_refused(arguments: tuple[object, ...]) -> None:
    with pytest.raises(PilotgenError):
        StateSpaceModel(*arguments)  # type: ignore[arg-type]


def test_improper_and_unpaired_are_refused() -> None:
    with pytest.raises(PilotgenError, match="proper"):
        transfer_function([1.0, 0.0], [2.0])
    with pytest.raises(PilotgenError, match="proper"):
        zeros_poles_gain([1.0], [], 1.0)
    with pytest.raises(PilotgenError, match="conjugate"):
        zeros_poles_gain([], [-1.0 + 1.0j], 1.0)
    with pytest.raises(PilotgenError, match="ill-posed"):
        transfer_function([-1.0, 3.0], [1.0, 1.0]).feedback()
