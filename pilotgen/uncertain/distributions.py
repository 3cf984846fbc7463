"""From independent normal scores to values of the distributions that a study knows.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import ndtr, ndtri

from pilotgen.study.uncertain_section import Distribution, drawable, scale, score


def of_scores(one: Distribution, scores: np.ndarray, ends: tuple[float, float]) -> np.ndarray:
    """Values of a distribution of numbers, rising with the score; shape as that of the scores.

    Parameters
    ----------
    one : mapping
        The distribution, checked.
    scores : ndarray
        Standard normal numbers.
    ends : tuple of float
        A normal or log-normal distribution is cut there, if its own `within` is not narrower.
    """
    u = ndtr(scores)
    if one["distribution"] == "uniform":
        return np.asarray(one["lower"] + u * (one["upper"] - one["lower"]))
    if one["distribution"] == "triangular":
        low, mode, high = one["lower"], one["mode"], one["upper"]
        share = (mode - low) / (high - low)  # below the mode
        rising = low + np.sqrt(u * (high - low) * (mode - low))
        falling = high - np.sqrt((1.0 - u) * (high - low) * (high - mode))
        return np.asarray(np.where(u < share, rising, falling))
    low, high = (float(ndtr(score(one, end))) for end in _narrower(one, ends))
    mean, deviation = scale(one)
    values = mean + deviation * ndtri(low + u * (high - low))
    values = np.exp(values) if one["distribution"] == "lognormal" else values
    return np.asarray(np.clip(values, *_narrower(one, ends)))  # round-off in the tails


def _narrower(one: Distribution, ends: tuple[float, float]) -> tuple[float, float]:
    low, high = one.get("within", ends)
    return max(low, ends[0]), min(high, ends[1])


def word_of(one: Distribution, scores: np.ndarray) -> list[str]:
    """Words of a distribution of words, for scores of shape (n,)."""
    words = list(one["weights"])
    ends = np.cumsum(list(one["weights"].values()))
    places = np.minimum(np.searchsorted(ends, ndtr(scores), side="right"), len(words) - 1)
    return [words[k] for k in places]


def value_of(one: Distribution, number: Any, base: float, score_of: float) -> float:
    """The number of a study that one score stands for; factors and offsets are of `base`."""
    drawn = float(of_scores(one, np.array(score_of), drawable(one, number, base)))
    if one["as"] == "factor":
        return base * drawn
    return base + drawn if one["as"] == "offset" else drawn
