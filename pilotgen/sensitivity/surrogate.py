"""Sobol indices by a polynomial that stands for the model: a hundred pilots in place of thousands where it fits.

Legendre polynomials of a total degree, coefficients by least squares; the indices are sums of squared coefficients. How
well it tells pilots that it has not seen (leave one out, in closed form) chooses the degree and stands beside them.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial.legendre import legvander

from pilotgen.errors import StudyError

HIGHEST = 12  # total degree
SPARE = 1.5  # points per coefficient, at least
DRAWS = 200  # of coefficients, for the intervals
ENOUGH = 0.9  # share of the variance that a surrogate has to explain for its indices to be worth telling


@dataclass(frozen=True)
class Surrogate:
    """A polynomial fitted.

    Attributes
    ----------
    degrees : ndarray of int, shape (m, k)
        Degree of each term in each number.
    coefficients : ndarray, shape (m,)
        Of the terms, orthonormal over the box.
    scatter : ndarray, shape (m, m)
        Covariance of the coefficients, from what the polynomial does not explain.
    explained : float
        Share of the variance of left out points that it explains; 1 is all, below 0 worse than the mean.
    """

    degrees: np.ndarray
    coefficients: np.ndarray
    scatter: np.ndarray
    explained: float

    @property
    def degree(self) -> int:
        """Total degree."""
        return int(self.degrees.sum(axis=1).max())


def surrogate_points(bounds: Mapping[str, tuple[float, float]], number: int, seed: int) -> np.ndarray:
    """Points of a scrambled Sobol sequence, shape (number, k); those of a smaller number come first.

    Raises
    ------
    StudyError
        Too few of them for a straight plane.
    """
    from scipy.stats import qmc

    fewest = math.ceil(SPARE * (len(bounds) + 1))
    if number < fewest:
        raise StudyError(
            f"-n {number} is too few pilots for a surrogate of {len(bounds)} numbers; {fewest} are wanted at least, "
            f"and {math.ceil(SPARE * math.comb(len(bounds) + 2, 2))} for one that is curved"
        )
    low, high = np.array(list(bounds.values()), dtype=float).T
    unit = qmc.Sobol(len(bounds), scramble=True, rng=np.random.default_rng(seed)).random_base2(
        max(number - 1, 1).bit_length()
    )
    return np.asarray(low + unit[:number] * (high - low))


def fit(bounds: Mapping[str, tuple[float, float]], points: np.ndarray, values: np.ndarray) -> Surrogate | None:
    """The polynomial that tells left out points best; None of values that do not vary.

    `points` has shape (n, k), `values` shape (n,), finite.
    """
    if len(values) < 3 or not np.ptp(values) > 0.0:
        return None
    low, high = np.array(list(bounds.values()), dtype=float).T
    unit = 2.0 * (points - low) / (high - low) - 1.0
    best: Surrogate | None = None
    for degree in range(1, HIGHEST + 1):
        if SPARE * math.comb(len(bounds) + degree, degree) > len(values):
            break
        found = _fit_degree(unit, values, degree)
        if found is not None and (best is None or found.explained > best.explained):
            best = found
    return best


def _fit_degree(unit: np.ndarray, values: np.ndarray, degree: int) -> Surrogate | None:
    degrees = _terms(unit.shape[1], degree)
    basis = _basis(unit, degrees)
    q, r = np.linalg.qr(basis)
    if np.abs(np.diag(r)).min() < 1e-9 * np.abs(np.diag(r)).max():
        return None
    coefficients = np.linalg.solve(r, q.T @ values)
    left_out = (values - basis @ coefficients) / np.maximum(1.0 - (q**2).sum(axis=1), 1e-9)
    squared = float((left_out**2).mean())
    inverse = np.linalg.inv(r)
    return Surrogate(degrees, coefficients, squared * inverse @ inverse.T, 1.0 - squared / float(values.var()))


def _terms(numbers: int, degree: int) -> np.ndarray:
    """Degrees of every term up to a total degree, the constant first; shape (m, numbers)."""
    rows = [np.zeros(numbers, dtype=int)]
    for total in range(1, degree + 1):
        for chosen in itertools.combinations_with_replacement(range(numbers), total):
            rows.append(np.bincount(chosen, minlength=numbers))
    return np.array(rows)


def _basis(unit: np.ndarray, degrees: np.ndarray) -> np.ndarray:
    """Orthonormal Legendre polynomials at points of [-1, 1]^k; shape (n, m)."""
    highest = int(degrees.max())
    basis = np.ones((len(unit), len(degrees)))
    for k, column in enumerate(unit.T):
        basis *= (legvander(column, highest) * np.sqrt(2.0 * np.arange(highest + 1) + 1.0))[:, degrees[:, k]]
    return basis


def surrogate_indices(
    bounds: Mapping[str, tuple[float, float]], points: np.ndarray, values: np.ndarray, seed: int
) -> dict[str, Any]:
    """First-order and total indices of the polynomial through the values at `surrogate_points`.

    Parameters
    ----------
    bounds : mapping
        Number -> (lower, upper).
    points, values : ndarray, shapes (n, k), (n,)
        NaN where there is no value.
    seed : int
        Of the intervals.

    Returns
    -------
    dict
        `blocks` and `blocks_left_out` (points with and without a value), `degree`, `terms`, `explained`, and for every
        number `first`, `first_half_width`, `total`, `total_half_width`; None where the values do not vary.
    """
    whole = np.isfinite(values)
    found: dict[str, Any] = {"blocks": int(whole.sum()), "blocks_left_out": int((~whole).sum())}
    one = fit(bounds, points[whole], values[whole])
    keys = ("first", "first_half_width", "total", "total_half_width")
    if one is None:
        nothing = {name: dict.fromkeys(keys) for name in bounds}
        return {**found, "degree": None, "terms": None, "explained": None, "numbers": nothing}
    first, total = _shares(one.degrees, one.coefficients[None, :])
    drawn = np.random.default_rng(seed).multivariate_normal(one.coefficients, one.scatter, size=DRAWS, method="eigh")
    half = [1.96 * part.std(axis=0, ddof=1) for part in _shares(one.degrees, drawn)]
    rows = zip(bounds, first[0], half[0], total[0], half[1], strict=True)
    return {
        **found,
        "degree": one.degree,
        "terms": len(one.coefficients),
        "explained": one.explained,
        "numbers": {name: dict(zip(keys, map(float, row), strict=True)) for name, *row in rows},
    }


def _shares(degrees: np.ndarray, coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First-order and total indices, shape (draws, k) each, of coefficients of shape (draws, m)."""
    squared = coefficients[:, 1:] ** 2
    there = degrees[1:] > 0
    alone = there & (there.sum(axis=1) == 1)[:, None]
    variance = squared.sum(axis=1, keepdims=True)
    return squared @ alone / variance, squared @ there / variance
