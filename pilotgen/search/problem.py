"""What a search varies, within which bounds, and what it minimises.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pilotgen.study.schema import is_whole
from pilotgen.study.study import SearchSettings


@dataclass(frozen=True, eq=False)
class Problem:
    """Bounds and names; knows nothing of physics.

    Attributes
    ----------
    names : tuple of str
        The variables, in the order of the columns of X.
    xl, xu : ndarray, shape (n_var,)
        Lower and upper bounds, in the units of the names.
    objectives : tuple of str
        What is minimised, in the order of the columns of F.
    whole : frozenset of str
        Variables that are counted, not measured: `values` rounds them.
    """

    names: tuple[str, ...]
    xl: np.ndarray
    xu: np.ndarray
    objectives: tuple[str, ...]
    whole: frozenset[str] = frozenset()

    @classmethod
    def from_settings(cls, settings: SearchSettings) -> Problem:
        """Return the problem of a study's `search` section."""
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

    def values(self, x: np.ndarray) -> dict[str, float]:
        """Return one row of X by name."""
        named = {name: float(value) for name, value in zip(self.names, x, strict=True)}
        return {**named, **{name: float(round(named[name])) for name in self.whole}}
