"""The cheapest amounts of cures with which every one of some pilots keeps the limits.

Differential evolution of SciPy over the amounts, each generation evaluated at once; then what is not needed is taken
out, and what is left is made as small as it can be. The cost is a weighted sum of amounts, each as a share of what is
practicable: a sum of magnitudes, which prefers few cures to a little of everything.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pilotgen.cures.catalogue import Cure

Floats = npt.NDArray[np.float64]
Violation = Callable[
    [Floats], Floats
]  # amounts (n, cures) -> (n,) largest share by which a limit is missed; <= 0: kept

GENERATIONS = 25
PER_CURE = 4  # members of the evolution's population for each cure
_PENALTY = 1e3  # for missing a limit, beside costs of a few
NEGLIGIBLE = 0.01  # share of an amount's range
_HALVINGS = 7  # of an amount's range: one part in 128


@dataclass(frozen=True)
class Optimum:
    """The cheapest amounts found.

    Attributes
    ----------
    amounts : ndarray
        (cures,) each in its unit.
    cost : float
        Sum of costs.
    violation : float
        Largest share by which a limit is missed; 0 or less: all are kept.
    """

    amounts: Floats
    cost: float
    violation: float

    @property
    def reached(self) -> bool:
        """Whether all limits are kept."""
        return self.violation <= 0.0


def cost_of(cures: Sequence[Cure], amounts: Floats) -> Floats:
    """Cost of amounts (..., cures): each as a share of what is practicable on its side, times the cure's cost."""
    low, high = (np.array([getattr(cure, end) for cure in cures]) for end in ("low", "high"))
    weights = np.array([cure.cost for cure in cures])
    reach = np.where(amounts < 0.0, np.where(low < 0.0, -low, 1.0), np.where(high > 0.0, high, 1.0))
    total: Floats = np.sum(weights * np.abs(amounts) / reach, axis=-1)
    return total


def cheapest(cures: Sequence[Cure], violation: Violation, seed: int) -> Optimum:
    """The cheapest amounts within what is practicable, `violation` at most 0; or those that miss the limits least.

    The same for the same seed.
    """
    from scipy.optimize import differential_evolution

    low, high = (np.array([getattr(cure, end) for cure in cures]) for end in ("low", "high"))

    def objective(columns: Floats) -> Floats:
        amounts = columns.T if columns.ndim == 2 else columns[None, :]
        missed = np.maximum(violation(amounts), 0.0)
        found = cost_of(cures, amounts) + _PENALTY * missed
        return found if columns.ndim == 2 else found[:1]

    at_present, at_limits = np.zeros(len(cures)), np.where(high > 0.0, high, low)
    size = max(8, PER_CURE * len(cures))
    spread = np.random.default_rng(seed).uniform(size=(size - 2, len(cures)))
    first = np.vstack([at_present, at_limits, low + spread * (high - low)])
    found = differential_evolution(
        objective,
        list(zip(low, high, strict=True)),
        init=first,
        maxiter=GENERATIONS,
        seed=seed,
        polish=False,
        vectorized=True,
        updating="deferred",
        tol=1e-3,
    )
    amounts = np.asarray(found.x, dtype=float)
    missed = float(violation(amounts[None, :])[0])
    if missed <= 0.0:
        amounts, missed = _pruned(cures, violation, amounts)
    return Optimum(amounts, float(cost_of(cures, amounts)), missed)


def _pruned(cures: Sequence[Cure], violation: Violation, amounts: Floats) -> tuple[Floats, float]:
    """Take out what is not needed, the dearest that can go first; then make each that is left as small as it can be.

    A negligible amount, which nobody would fit, goes if the others need to be no more than that larger.
    """
    amounts = _smallest(cures, violation, _without_needless(cures, violation, amounts))
    low, high = (np.array([getattr(cure, end) for cure in cures]) for end in ("low", "high"))
    reach = np.where(amounts < 0.0, -low, high)
    negligible = (amounts != 0.0) & (np.abs(amounts) < NEGLIGIBLE * reach)
    more = np.clip((1.0 + NEGLIGIBLE) * amounts, low, high)
    for k in np.flatnonzero(negligible).tolist():
        trial = np.where(np.arange(len(amounts)) == k, 0.0, more)
        if violation(trial[None, :])[0] <= 0.0:
            more = amounts = trial
    if negligible.any():
        amounts = _smallest(cures, violation, amounts)
    return amounts, float(violation(amounts[None, :])[0])


def _without_needless(cures: Sequence[Cure], violation: Violation, amounts: Floats) -> Floats:
    amounts = amounts.copy()
    while True:
        used = np.flatnonzero(amounts)
        if len(used) == 0:
            break
        trials = np.repeat(amounts[None, :], len(used), axis=0)
        trials[np.arange(len(used)), used] = 0.0
        free = used[violation(trials) <= 0.0]
        if len(free) == 0:
            break
        saved = [float(cost_of(cures, np.where(np.arange(len(amounts)) == k, amounts, 0.0))) for k in free]
        amounts[free[int(np.argmax(saved))]] = 0.0
    return amounts


def _smallest(cures: Sequence[Cure], violation: Violation, amounts: Floats) -> Floats:
    """Each as small as it can be, the dearest first."""
    amounts = amounts.copy()
    dear = sorted(np.flatnonzero(amounts).tolist(), key=lambda k: -cures[k].cost)
    for k in dear:
        enough, too_little = amounts[k], 0.0
        for _ in range(_HALVINGS):
            trial = amounts.copy()
            trial[k] = 0.5 * (enough + too_little)
            if violation(trial[None, :])[0] <= 0.0:
                enough = trial[k]
            else:
                too_little = trial[k]
        amounts[k] = enough
    return amounts
