"""Classical analysis of variance over a full factorial of levels: sums of squares, degrees of freedom, F and p.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.special import fdtrc

from pilotgen.errors import StudyError

MOST = 100_000  # pilots


def factorial_points(bounds: Mapping[str, tuple[float, float]], levels: int) -> np.ndarray:
    """Every combination of `levels` values of each number, evenly spaced from bound to bound; the last moves fastest.

    Shape (levels ** k, k) for k numbers.

    Raises
    ------
    StudyError
        Fewer than two numbers, fewer than two levels, or too many pilots.
    """
    k = len(bounds)
    if levels < 2:
        raise StudyError(f"-n {levels} is no factorial: -n is how many levels each number has, two at least")
    if k < 2:
        raise StudyError("an analysis of variance wants two numbers at least; add one to sensitivity.variables")
    if levels**k > MOST:
        raise StudyError(
            f"-n {levels}: {levels} levels of {k} numbers are {levels**k} pilots, more than {MOST}; give fewer levels, "
            "or fewer numbers in sensitivity.variables"
        )
    axes = [np.linspace(low, high, levels) for low, high in bounds.values()]
    return np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)


def anova(values: np.ndarray, names: Sequence[str]) -> list[dict[str, Any]]:
    """The table of a balanced factorial: main effects, interactions of two, the rest as error, the total.

    Two factors without replicates have no interaction of their own: it is the error then.

    Parameters
    ----------
    values : ndarray, shape (levels of the first, ..., levels of the last, replicates)
        Finite; replicates are 1 for a model that gives the same value each time.
    names : sequence of str
        Of the factors.

    Returns
    -------
    list of dict
        `source` (a name, `a x b`, `error`, `total`), `sum_of_squares`, `degrees_of_freedom`, and of the effects
        `mean_square`, `f`, `p`, `share` of the total sum; F and p are None where there is no error to hold against.
    """
    k, size = len(names), values.size
    grand = float(values.mean())
    total = float(((values - grand) ** 2).sum())
    # the deviations of the means over every subset of the factors; an effect is what its parts do not have
    effects: dict[tuple[int, ...], np.ndarray] = {}
    rows: list[dict[str, Any]] = []
    highest = 1 if k == 2 and values.shape[-1] == 1 else 2
    for order in range(1, highest + 1):
        for factors in itertools.combinations(range(k), order):
            others = tuple(axis for axis in range(values.ndim) if axis not in factors)
            mean = values.mean(axis=others, keepdims=True) - grand
            for part in itertools.chain.from_iterable(itertools.combinations(factors, m) for m in range(1, order)):
                mean = mean - effects[part]
            effects[factors] = mean
            freedom = math.prod(values.shape[axis] - 1 for axis in factors)
            square = float((mean**2).sum()) * size / mean.size
            rows.append(
                {
                    "source": " x ".join(names[axis] for axis in factors),
                    "sum_of_squares": square,
                    "degrees_of_freedom": freedom,
                }
            )
    fitted = sum(effects.values(), start=np.full((1,) * values.ndim, grand))
    error = float(((values - fitted) ** 2).sum())
    freedom = size - 1 - sum(row["degrees_of_freedom"] for row in rows)
    noise = error / freedom if freedom > 0 and error > 1e-24 * max(total, 1e-300) else 0.0
    for row in rows:
        square = row["sum_of_squares"] / row["degrees_of_freedom"]
        ratio = square / noise if noise > 0.0 else None
        p = None if ratio is None else float(fdtrc(row["degrees_of_freedom"], freedom, ratio))
        row |= {"mean_square": square, "f": ratio, "p": p, "share": row["sum_of_squares"] / total if total else None}
    rows.append({"source": "error", "sum_of_squares": error, "degrees_of_freedom": freedom})
    rows.append({"source": "total", "sum_of_squares": total, "degrees_of_freedom": size - 1})
    return rows
