"""The region of a population that holds 95 or 99 % of it: where a search looks for a worst pilot who may exist.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import chdtri, gammaincc, ndtr

from pilotgen.errors import StudyError
from pilotgen.population.joint import Joint, inside
from pilotgen.population.population import population_of
from pilotgen.study.population_section import FILE, MIX, QUANTITIES
from pilotgen.study.study import Study

CORNERS = 4096  # people on the surface by whom the extent of a region is told
HALVINGS = 50  # of a ray, to find where limits cut it


@dataclass(frozen=True)
class Region:
    """People no farther from the middle of a population than some share of it is, and within its limits.

    The independent normal scores behind age, stature and mass are a point; the region is the ball about 0 that holds
    `probability` of such points, cut by `limits`. It is filled from a cube: a point of the cube lies as far along its
    ray to the region's surface as along its ray to the cube's.

    Attributes
    ----------
    who : str
        `men`, `women`.
    joint : Joint
        Their distribution.
    probability : float
        Share of the distribution that the ball holds, 0 to 1.
    limits : mapping
        Quantity (`bmi` too) -> (lowest, highest): range of the distribution, entry limits, bounds of the search.
    names : tuple of str
        The search's variables: age_years, stature_m and one of mass_kg and bmi, in its order.
    """

    who: str
    joint: Joint
    probability: float
    limits: Mapping[str, tuple[float, float]]
    names: tuple[str, ...]

    @cached_property
    def radius(self) -> float:
        """Of the ball: the Mahalanobis distance that `probability` of the distribution does not exceed."""
        return float(np.sqrt(chdtri(3.0, 1.0 - self.probability)))

    @cached_property
    def _centre(self) -> np.ndarray:
        """The middle of the distribution, or of its people within the limits if these leave it out."""
        if self._inside(np.zeros((1, 3)))[0]:
            return np.zeros(3)
        scores = np.random.default_rng(0).standard_normal((200_000, 3))
        kept = scores[(np.linalg.norm(scores, axis=1) < self.radius) & self._inside(scores)]
        if not len(kept):
            limits = ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in self.limits.items())
            raise StudyError(
                f"search.within: nobody of the {self.text} is within its limits ({limits}); widen the bounds of the "
                "search or the entry limits"
            )
        return np.asarray(kept.mean(axis=0))

    @property
    def text(self) -> str:
        """`99 % of men`."""
        return f"{100.0 * self.probability:g} % of {self.who}"

    def _inside(self, scores: np.ndarray) -> np.ndarray:
        return inside(self.joint.table(scores), self.limits)

    def scores(self, cube: np.ndarray) -> np.ndarray:
        """Independent normal scores of points of the cube [-1, 1]^3; both of shape (n, 3)."""
        cube = np.asarray(cube, dtype=float)
        share = np.abs(cube).max(axis=1)
        length = np.linalg.norm(cube, axis=1)
        ray = cube / np.where(length > 0.0, length, 1.0)[:, None]
        along = ray @ self._centre  # |centre + t ray| = radius
        reach = np.sqrt(along**2 + self.radius**2 - self._centre @ self._centre) - along
        low, high = np.zeros(len(cube)), reach.copy()
        cut = ~self._inside(self._centre + reach[:, None] * ray)
        if cut.any():
            for _ in range(HALVINGS):
                middle = 0.5 * (low + high)
                there = self._inside(self._centre + middle[:, None] * ray)
                low, high = np.where(there, middle, low), np.where(there, high, middle)
            reach = np.where(cut, low, reach)
        return np.asarray(self._centre + (share * reach)[:, None] * ray)

    def people(self, cube: np.ndarray) -> np.ndarray:
        """Values of the search's variables of points of the cube, shape (n, 3) both."""
        table = self.joint.table(self.scores(cube))
        return np.column_stack([table[name] for name in self.names])

    def distance(self, values: np.ndarray) -> np.ndarray:
        """Mahalanobis distance from the middle of people given by the search's variables, shapes (n, 3) and (n,)."""
        table = dict(zip(self.names, np.asarray(values, dtype=float).T, strict=True))
        if "mass_kg" not in table:
            table["mass_kg"] = table["bmi"] * table["stature_m"] ** 2
        people = np.column_stack([table[name] for name in QUANTITIES])
        return np.asarray(np.linalg.norm(self.joint.independent(people), axis=1))

    def holds(self, values: np.ndarray) -> np.ndarray:
        """Whether people given by the search's variables are of the region; shapes (n, 3) and (n,)."""
        table = dict(zip(self.names, np.asarray(values, dtype=float).T, strict=True))
        table.setdefault("bmi", table.get("mass_kg", np.nan) / table["stature_m"] ** 2)
        table.setdefault("mass_kg", table["bmi"] * table["stature_m"] ** 2)
        found = self.distance(values) <= self.radius * (1.0 + 1e-9)
        for name, (low, high) in self.limits.items():
            found &= (low * (1.0 - 1e-9) <= table[name]) & (table[name] <= high * (1.0 + 1e-9))
        return np.asarray(found)

    @cached_property
    def extent(self) -> np.ndarray:
        """Smallest and largest value of each of the search's variables in the region, shape (2, 3)."""
        from scipy.stats import qmc

        cube = 2.0 * qmc.Sobol(3, scramble=False).random(CORNERS) - 1.0
        axes = np.concatenate([np.eye(3), -np.eye(3)])
        cube = np.concatenate([cube, axes])
        cube /= np.maximum(np.abs(cube).max(axis=1), 1e-9)[:, None]
        people = self.people(cube)
        return np.stack([people.min(axis=0), people.max(axis=0)])


def beyond(distance: float) -> float:
    """Share of a population that is farther from its middle than this Mahalanobis distance (three quantities)."""
    return float(gammaincc(1.5, 0.5 * distance**2))


def that_way(distance: float) -> float:
    """Share that is farther out than a plane at this distance, square to its ray."""
    return float(ndtr(-distance))


def one_in(share: float) -> str:
    """`1 in 2,660`: three figures."""
    number = 1.0 / share if share > 0.0 else np.inf
    if not np.isfinite(number):
        return "nobody"
    digits = max(0, int(np.floor(np.log10(number))) - 2)
    return f"1 in {round(number / 10**digits) * 10**digits:,}" if number >= 10.0 else f"1 in {number:.1f}"


def rarity_text(who: str, distance: float) -> str:
    """How rare a person is, as a sentence."""
    if not np.isfinite(distance):
        return f"nobody of the {who} is so old or so young"
    return (
        f"{one_in(beyond(distance))} {who} is at least as unusual in age, stature and mass together (Mahalanobis "
        f"distance {distance:.2f}), {one_in(that_way(distance))} lies farther out in the same direction"
    )


def rarity(region: Region, values: Mapping[str, float]) -> dict[str, Any]:
    """How rare a person is, of age_years, stature_m, mass_kg and bmi: for JSON; null for whoever is of no distance."""
    with np.errstate(invalid="ignore"):
        distance = float(region.distance(np.array([[values[name] for name in region.names]]))[0])
    away = distance if np.isfinite(distance) else None
    return {
        "population": region.who,
        "mahalanobis_distance": away,
        "share_beyond": 0.0 if away is None else beyond(away),
        "share_that_way": 0.0 if away is None else that_way(away),
    }


def region_of(study: Study) -> Region | None:
    """The region that a study's search stays in; None if it searches a box.

    Raises
    ------
    StudyError
        The population has no region, or nobody of it is within the limits.
    """
    section = study.search.within
    if section is None:
        return None
    where = study.where("search", "within")
    named = section["population"]
    if named is not None:
        study = dataclasses.replace(study, population={**dict.fromkeys(study.population), "people": named})
    if study.population["people"] == MIX:
        raise StudyError(f"{where}: search.within: a mix has two regions; search men and women one after the other")
    if study.population["people"] == FILE:
        raise StudyError(
            f"{where}: search.within: a file of people has no region; give their mean and covariance "
            "(population.people: own)"
        )
    population = population_of(study)
    ((_, joint),) = population.joints
    limits: dict[str, tuple[float, float]] = {}
    for given in (joint.range, population.within, study.search.variables):
        for name, (low, high) in given.items():
            before = limits.get(name, (-np.inf, np.inf))
            limits[name] = (max(before[0], low), min(before[1], high))
    region = Region(population.name, joint, section["probability"], limits, tuple(study.search.variables))
    region.scores(np.zeros((1, 3)))  # who is not there is missed before anything starts
    return region
