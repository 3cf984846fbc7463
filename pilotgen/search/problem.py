"""What a search varies, within which bounds or in which region of a population, and what it minimises.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pilotgen.population.region import Region
from pilotgen.study.schema import is_whole
from pilotgen.study.sections import SearchSettings


@dataclass(frozen=True, eq=False)
class Problem:
    """Bounds and names; knows nothing of physics.

    Attributes
    ----------
    names : tuple of str
        The variables, in the order of the columns of X.
    xl, xu : ndarray, shape (n_var,)
        Lower and upper bounds of X, in the units of the names; with a region -1 and 1 of its cube.
    objectives : tuple of str
        What is minimised, in the order of the columns of F.
    whole : frozenset of str
        Variables that are counted, not measured: `values` rounds them.
    region : Region or None
        Of a population, that X fills by its cube (`Region.people`); None: the box of the bounds.
    """

    names: tuple[str, ...]
    xl: np.ndarray
    xu: np.ndarray
    objectives: tuple[str, ...]
    whole: frozenset[str] = frozenset()
    region: Region | None = None

    @classmethod
    def from_settings(cls, settings: SearchSettings, region: Region | None = None) -> Problem:
        """Return the problem of a study's `search` section, over its box or in a population's region."""
        if region is not None:
            ones = np.ones(len(region.names))
            return cls(region.names, -ones, ones, settings.objectives, frozenset(), region)
        bounds = np.array(list(settings.variables.values()), dtype=float)
        whole = frozenset(name for name in settings.variables if is_whole(name))
        return cls(tuple(settings.variables), bounds[:, 0].copy(), bounds[:, 1].copy(), settings.objectives, whole)

    @property
    def n_var(self) -> int:
        """Number of variables."""
        return len(self.names)

    @property
    def n_obj(self) -> int:
        """Number of objectives."""
        return len(self.objectives)

    @property
    def extent(self) -> np.ndarray:
        """Lower and upper end of every variable, in the units of the names; shape (2, n_var)."""
        return np.stack([self.xl, self.xu]) if self.region is None else self.region.extent

    def pilots(self, X: np.ndarray) -> list[dict[str, float]]:
        """Return the variables of every row of X by name."""
        if self.region is not None:
            X = self.region.people(X)
        found = [{name: float(value) for name, value in zip(self.names, x, strict=True)} for x in X]
        return [{**named, **{name: float(round(named[name])) for name in self.whole}} for named in found]

    def values(self, x: np.ndarray) -> dict[str, float]:
        """Return the variables of one row of X by name."""
        return self.pilots(x[None, :])[0]
