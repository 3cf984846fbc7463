"""Joint distribution of age, stature and body mass of one sex: a Gaussian copula with a marginal each.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtr, ndtri

from pilotgen.errors import StudyError


@dataclass(frozen=True)
class Normal:
    """Normal, or with `logarithmic` log-normal: then mean and deviation are those of the natural logarithm."""

    mean: float
    deviation: float
    logarithmic: bool = False

    def of_scores(self, scores: np.ndarray) -> np.ndarray:
        """Values of normal scores; any shape."""
        values = self.mean + self.deviation * scores
        return np.exp(values) if self.logarithmic else values

    def below(self, values: np.ndarray) -> np.ndarray:
        """Share of people below each value; any shape."""
        values = np.log(values) if self.logarithmic else np.asarray(values)
        return np.asarray(ndtr((values - self.mean) / self.deviation))


@dataclass(frozen=True)
class Table:
    """Quantiles at given probabilities from 0 to 1, linear between them."""

    probability: tuple[float, ...]
    quantile: tuple[float, ...]

    def of_scores(self, scores: np.ndarray) -> np.ndarray:
        """Values of normal scores; any shape."""
        return np.asarray(np.interp(ndtr(scores), self.probability, self.quantile))

    def below(self, values: np.ndarray) -> np.ndarray:
        """Share of people below each value; any shape."""
        return np.asarray(np.interp(values, self.quantile, self.probability))


@dataclass(frozen=True)
class Joint:
    """Age [years], stature [m] and body mass [kg] of people of one sex.

    Attributes
    ----------
    sex : str
        "male" or "female".
    marginals : tuple of three
        Normal or Table, of age, stature, mass.
    root : ndarray, shape (3, 3)
        Lower Cholesky factor of the correlation of the normal scores.
    range : mapping
        Quantity -> (lowest, highest) of whom is drawn: where there were people when it was fitted.
    """

    sex: str
    marginals: tuple[Normal | Table, ...]
    root: np.ndarray
    range: Mapping[str, tuple[float, float]]

    def people(self, independent: np.ndarray) -> np.ndarray:
        """Age, stature and mass of independent standard normal scores; both of shape (n, 3)."""
        scores = independent @ self.root.T
        return np.column_stack([one.of_scores(scores[:, k]) for k, one in enumerate(self.marginals)])

    def table(self, independent: np.ndarray) -> dict[str, np.ndarray]:
        """The same by name, body mass index too, each of shape (n,)."""
        age, stature, mass = self.people(independent).T
        return {"age_years": age, "stature_m": stature, "mass_kg": mass, "bmi": mass / stature**2}

    def independent(self, people: np.ndarray) -> np.ndarray:
        """Independent standard normal scores of age, stature and mass, both of shape (n, 3); undoes `people`."""
        scores = np.column_stack([ndtri(one.below(people[:, k])) for k, one in enumerate(self.marginals)])
        return np.asarray(np.linalg.solve(self.root, scores.T).T)


def inside(table: Mapping[str, np.ndarray], *limits: Mapping[str, tuple[float, float]]) -> np.ndarray:
    """Who of a table is within all limits (quantity -> lowest, highest); shape (n,)."""
    within = np.ones(len(next(iter(table.values()))), dtype=bool)
    for one in limits:
        for name, (low, high) in one.items():
            within &= (low <= table[name]) & (table[name] <= high)
    return within


def bundled_joint(numbers: Mapping[str, Any]) -> Joint:
    """A distribution of pilotgen/data/population.yaml."""
    age, stature, mass, between = (numbers[key] for key in ("age_years", "stature_m", "mass_kg", "correlation"))
    correlation = np.eye(3)
    for (j, k), key in {(0, 1): "age_stature", (0, 2): "age_mass", (1, 2): "stature_mass"}.items():
        correlation[j, k] = correlation[k, j] = between[key]
    marginals = (
        Table(tuple(age["probability"]), tuple(age["quantile"])),
        Normal(stature["log_mean"], stature["log_deviation"], logarithmic=True),
        Normal(mass["log_mean"], mass["log_deviation"], logarithmic=True),
    )
    limits = {key: (float(low), float(high)) for key, (low, high) in numbers["range"].items()}
    return Joint(numbers["sex"], marginals, np.linalg.cholesky(correlation), limits)


def joint_of_moments(
    sex: str,
    mean: Sequence[float],
    covariance: Sequence[Sequence[float]],
    logarithmic: Sequence[bool],
    limits: Mapping[str, tuple[float, float]],
    where: str,
) -> Joint:
    """The distribution with these means and covariances; exact for normal and log-normal marginals.

    With X log-normal of log-deviation s, E[X] = m: s^2 = ln(1 + var X / m^2); cov(X, Y) is m s d rho for Y normal of
    deviation d, and m n (exp(rho s t) - 1) for Y log-normal of mean n and log-deviation t.

    Parameters
    ----------
    sex : str
        "male" or "female".
    mean : sequence of 3 float
        Of age [years], stature [m], mass [kg].
    covariance : 3 rows of 3 float
        Of the same.
    logarithmic : sequence of 3 bool
        Which of them are log-normal.
    limits : mapping
        As `Joint.range`.
    where : str
        `file:line: key`, with which a message starts.

    Raises
    ------
    StudyError
        The covariance is not positive definite, or no such distribution has it.
    """
    m, covariances = np.asarray(mean, dtype=float), np.asarray(covariance, dtype=float)
    lowest = np.linalg.eigvalsh(covariances)[0]
    if (np.diag(covariances) <= 0.0).any() or lowest <= 0.0:
        raise StudyError(
            f"{where} is not positive definite (smallest eigenvalue {lowest:.3g}): no people are spread like that; "
            "check units (years, m, kg) and signs"
        )
    log = np.asarray(logarithmic)
    relative = np.log1p(np.diag(covariances) / m**2)
    deviation = np.where(log, np.sqrt(relative), np.sqrt(np.diag(covariances)))
    centre = np.where(log, np.log(m) - 0.5 * relative, m)
    correlation = np.eye(3)
    for j in range(3):
        for k in range(j):
            covered = covariances[j, k]
            if log[j] and log[k]:
                ratio = 1.0 + covered / (m[j] * m[k])
                covered = np.log(ratio) if ratio > 0.0 else -np.inf
            elif log[j] or log[k]:
                covered /= m[j] if log[j] else m[k]
            correlation[j, k] = correlation[k, j] = covered / (deviation[j] * deviation[k])
    if not np.isfinite(correlation).all() or np.linalg.eigvalsh(correlation)[0] <= 0.0:
        raise StudyError(f"{where} does not go with these marginals: log-normal numbers cannot be spread like that")
    marginals = tuple(Normal(centre[k], deviation[k], bool(log[k])) for k in range(3))
    return Joint(sex, marginals, np.linalg.cholesky(correlation), limits)
