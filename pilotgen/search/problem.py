"""What a search varies, within which bounds, and what it minimises.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pilotgen.loop.margins import GAIN_MARGIN_CAP_DB, PHASE_MARGIN_CAP_DEG
from pilotgen.study.study import SearchSettings

# An infinite margin (no crossing) must be comparable: |margin| is capped for ranking, and only for ranking.
# min |1 + L| <= 1 for every strictly proper loop, and never infinite.
CAPS: Mapping[str, float] = {
    "gain_margin_db": GAIN_MARGIN_CAP_DB,
    "phase_margin_deg": PHASE_MARGIN_CAP_DEG,
    "modulus_margin": math.inf,
}


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
    """

    names: tuple[str, ...]
    xl: np.ndarray
    xu: np.ndarray
    objectives: tuple[str, ...]

    @classmethod
    def from_settings(cls, settings: SearchSettings) -> Problem:
        """Return the problem of a study's `search` section."""
        bounds = np.array(list(settings.variables.values()), dtype=float)
        return cls(tuple(settings.variables), bounds[:, 0].copy(), bounds[:, 1].copy(), settings.objectives)

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
        return {name: float(value) for name, value in zip(self.names, x, strict=True)}


def ranked_objectives(loop: Mapping[str, float | bool | None], objectives: tuple[str, ...]) -> list[float]:
    """Return the objectives of one pilot as they are ranked.

    Parameters
    ----------
    loop : mapping
        `stable` and the margins by name; None or an infinity means that there is no crossing.
    objectives : tuple of str
        Which of them.

    Returns
    -------
    list of float
        Each margin limited to its cap in `CAPS`, negative if the closed loop is unstable; a missing crossing counts as
        the cap.
    """
    row: list[float] = []
    for name in objectives:
        cap = CAPS[name]
        value = loop[name]
        margin = (math.inf if loop["stable"] else -math.inf) if value is None else float(value)
        if name == "modulus_margin" and not loop["stable"]:
            margin = -margin  # a distance has no sign of its own; the farther inside the unstable region, the worse
        row.append(min(max(margin, -cap), cap))
    return row
