"""Shares of people too rare to be counted: importance sampling in the normal scores behind age, stature and mass.

People are drawn where the event is, more of them than there are, and each counts by how much rarer he is than drawn.
Where the event is, a few levels find out: each draws around those of the level before who were nearest to it.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.special import stdtrit

from pilotgen.population.joint import Joint, inside
from pilotgen.study.population_section import QUANTITIES

FIRST_SHARE = 0.25  # of all people, for the first level, which looks everywhere
LEVEL_SHARE = 0.1  # of all people, for each level after it
LEVELS = 6  # at most
KEPT = 0.4  # share of all people that is kept for the estimate
ELITE = 0.2  # share of a level that the next one is drawn around
ENOUGH = 25  # people with the event, after whom there are no more levels
WIDE, WIDE_SHARE = (2.0, 3.0), 0.3  # deviations of scores drawn everywhere, half each, and share of them: no weight is
# above 8 / 0.15
CENTRES, CLOUD = 50, 0.8  # clouds that the others are drawn from, and the deviation of scores in each
FAIR = 0.5  # exponent of weights by which centres are chosen: at 1 small groups of people would get none, by chance
# Students' t of an interval has a degree of freedom for so many equally weighty hits: intervals of 95 % then hold the
# share in 93 to 98 % of 300 runs each with one, two and four groups of people (200, 600 and 1500 people).
HITS_PER_DEGREE, FEWEST_DEGREES = 4.0, 2.0
INSIDE_DRAWS = 1_000_000  # scores by which the share of people within limits is told, 0.1 % of it or better
FEWEST = 100  # people
NEAREST = 10  # people told one by one

Evaluate = Callable[[list[dict[str, Any]]], np.ndarray]
"""People -> how far each is from the event, negative if he has it, NaN if he cannot be evaluated."""


@dataclass(frozen=True)
class Proposal:
    """Scores drawn: round clouds about some people near the event, and wide ones that reach everywhere.

    Attributes
    ----------
    centres : ndarray, shape (k, 3)
        Of the clouds.
    wide_share : float
        Share of scores drawn everywhere.
    """

    centres: np.ndarray
    wide_share: float = WIDE_SHARE

    def draw(self, number: int, rng: np.random.Generator) -> np.ndarray:
        """Scores, shape (number, 3)."""
        which = rng.random(number) / self.wide_share * len(WIDE)
        centre = self.centres[rng.integers(len(self.centres), size=number)]
        scores = rng.standard_normal((number, 3))
        drawn = centre + CLOUD * scores
        for k, wide in enumerate(WIDE):
            drawn = np.where(((k <= which) & (which < k + 1))[:, None], wide * scores, drawn)
        return drawn

    def weight(self, scores: np.ndarray) -> np.ndarray:
        """Density of people over density drawn; shapes (n, 3), (n,)."""
        squared = (scores**2).sum(axis=1)
        away = ((scores[:, None, :] - self.centres[None, :, :]) ** 2).sum(axis=2)
        clouds = np.exp(0.5 * (squared[:, None] - away / CLOUD**2)).mean(axis=1) / CLOUD**3
        everywhere = np.mean([np.exp(0.5 * squared * (1.0 - wide**-2.0)) / wide**3 for wide in WIDE], axis=0)
        return np.asarray(1.0 / ((1.0 - self.wide_share) * clouds + self.wide_share * everywhere))


@dataclass(frozen=True)
class Stratum:
    """People of one sex: their share of all, distribution and limits (range, entry limits)."""

    share: float
    joint: Joint
    limits: Sequence[Mapping[str, tuple[float, float]]]


@dataclass
class RareShare:
    """The share of people who have an event, and of those who cannot be evaluated, as importance sampling has them.

    Attributes
    ----------
    having, failed : float
        Share of all people, 0 to 1.
    error, failed_error : float
        Standard errors of the same.
    drawn, evaluated : int
        Scores drawn for the estimate, levels aside; people evaluated, levels included.
    hits : int
        People of the estimate who have the event.
    effective : float
        The same, but for how unequally they count: of so many equally weighty ones the share would be as sure.
    missed : float
        The largest share that could have gone unseen, with 95 %, if nobody with the event was found.
    closest : float
        How far the one nearest to the event is from it, of all who were evaluated; infinite for nobody.
    levels : list of dict
        `sex`, `people` and `distance` (from the event, of the fifth nearest to it) of each level.
    nearest : list of dict
        Those with the event who are least unusual: `values`, `mahalanobis_distance`, `distance` from the event.
    """

    having: float = 0.0
    failed: float = 0.0
    error: float = 0.0
    failed_error: float = 0.0
    drawn: int = 0
    evaluated: int = 0
    hits: int = 0
    effective: float = 0.0
    missed: float = 0.0
    closest: float = math.inf
    levels: list[dict[str, Any]] = field(default_factory=list)
    nearest: list[dict[str, Any]] = field(default_factory=list)

    @property
    def share(self) -> float:
        """Of those who can be evaluated, as `population` tells shares."""
        return self.having / (1.0 - self.failed)

    @property
    def interval(self) -> tuple[float, float]:
        """95 %: log-normal, for shares are positive and their errors relative; of no hit, up to what may be missed.

        The error is itself an estimate, of few hits a poor one, and too small where a group of people was nearly
        missed: Student's t takes the place of the normal distribution.
        """
        if not self.hits:
            return 0.0, min(1.0, self.missed)
        degrees = max(self.effective / HITS_PER_DEGREE - 1.0, FEWEST_DEGREES)
        reach = math.exp(float(stdtrit(degrees, 0.975)) * self.error / self.having)
        return self.share / reach, min(1.0, self.share * reach)

    @property
    def equal_people(self) -> float:
        """How many people, counted one by one, would tell the share as well."""
        return self.having * (1.0 - self.having) / self.error**2 if self.error > 0.0 else float(self.evaluated)


def rare_share(strata: Sequence[Stratum], evaluate: Evaluate, number: int, seed: int) -> RareShare:
    """Estimate a share that is too small to be counted.

    Parameters
    ----------
    strata : sequence of Stratum
        The population.
    evaluate : callable
        Asked for people of one sex at a time; what it is asked depends on seed, number and its answers alone.
    number : int
        People to evaluate, at most.
    seed : int
        Of the drawing.
    """
    found = RareShare()
    squared = failed_squared = 0.0
    terms: list[np.ndarray] = []
    for k, stratum in enumerate(strata):
        part, weights = _of_stratum(stratum, evaluate, number // len(strata), [seed, 5, k], found)
        terms.append(stratum.share * weights)
        found.having += stratum.share * part[0]
        squared += (stratum.share * part[1]) ** 2
        found.failed += stratum.share * part[2]
        failed_squared += (stratum.share * part[3]) ** 2
    found.error, found.failed_error = math.sqrt(squared), math.sqrt(failed_squared)
    every = np.concatenate(terms) if terms else np.empty(0)
    found.effective = float(every.sum() ** 2 / (every**2).sum()) if len(every) else 0.0
    found.nearest.sort(key=lambda one: one["mahalanobis_distance"])
    del found.nearest[NEAREST:]
    return found


def _of_stratum(
    stratum: Stratum, evaluate: Evaluate, number: int, seed: list[int], found: RareShare
) -> tuple[tuple[float, float, float, float], np.ndarray]:
    """Share of this sex with the event, its error, share that cannot be evaluated, its error; what each hit adds."""
    proposal = Proposal(np.zeros((1, 3)), wide_share=1.0)
    drawn: list[tuple[int, Proposal]] = []
    seen, seen_away = np.empty((0, 3)), np.empty(0)  # of all levels
    left = number
    for level in range(LEVELS):
        size = max(FEWEST // 5, int((LEVEL_SHARE if level else FIRST_SHARE) * number))
        if left - size < KEPT * number:
            break
        scores, people = _people(stratum, proposal, size, [*seed, level])
        away = evaluate(people)
        drawn.append((size, proposal))
        found.closest = min([found.closest, *away[np.isfinite(away)].tolist()])
        left -= len(people)
        found.evaluated += len(people)
        ok = np.isfinite(away)
        if ok.sum() < 4:
            break
        reach = float(np.quantile(away[ok], ELITE))
        found.levels.append({"sex": stratum.joint.sex, "people": len(people), "distance": reach})
        seen, seen_away = np.concatenate([seen, scores[ok]]), np.concatenate([seen_away, away[ok]])
        near = seen[seen_away <= max(reach, 0.0)]
        density = sum(count / one.weight(near) for count, one in drawn)  # drawn, over that of people
        proposal = _around(near, density**-FAIR, np.random.default_rng([*seed, level, 1]))
        if reach <= 0.0 and len(near) >= ENOUGH:
            break
    scores = proposal.draw(left, np.random.default_rng([*seed, LEVELS]))
    held = inside(stratum.joint.table(scores), *stratum.limits)
    people = _persons(stratum, scores[held])
    away = np.full(len(scores), np.inf)
    away[held] = evaluate(people)
    found.evaluated += len(people)
    found.drawn += len(scores)
    found.closest = min([found.closest, *away[np.isfinite(away)].tolist()])
    found.missed += stratum.share * _unseen([*drawn, (left, proposal)], seed)
    weight = proposal.weight(scores) / _share_inside(stratum, seed)
    having, failed = away < 0.0, np.isnan(away)
    found.hits += int(having.sum())
    length = np.linalg.norm(scores, axis=1)
    order = np.flatnonzero(having)[np.argsort(length[having], kind="stable")][:NEAREST]
    place = np.cumsum(held) - 1
    found.nearest += [
        {"values": people[place[j]], "mahalanobis_distance": float(length[j]), "distance": float(away[j])}
        for j in order.tolist()
    ]
    return (*_mean(weight * having), *_mean(weight * failed)), weight[having] / max(len(scores), 1)


def _people(
    stratum: Stratum, proposal: Proposal, number: int, seed: list[int]
) -> tuple[np.ndarray, list[dict[str, Any]]]:
    """Scores within the limits and the people they stand for: of `number` that are drawn."""
    scores = proposal.draw(number, np.random.default_rng(seed))
    scores = scores[inside(stratum.joint.table(scores), *stratum.limits)]
    return scores, _persons(stratum, scores)


def _persons(stratum: Stratum, scores: np.ndarray) -> list[dict[str, Any]]:
    rows = stratum.joint.people(scores).tolist()
    return [{**dict(zip(QUANTITIES, row, strict=True)), "pilot.sex": stratum.joint.sex} for row in rows]


def _around(scores: np.ndarray, weight: np.ndarray, rng: np.random.Generator) -> Proposal:
    """Clouds about people drawn from these, each as often as he counts."""
    ends = np.cumsum(weight / weight.sum())
    places = (np.arange(CENTRES) + rng.random()) / CENTRES
    return Proposal(scores[np.minimum(np.searchsorted(ends, places), len(scores) - 1)])


def _share_inside(stratum: Stratum, seed: list[int]) -> float:
    rng, count, chunk = np.random.default_rng([*seed, LEVELS + 1]), 0, 100_000
    for _ in range(INSIDE_DRAWS // chunk):
        count += int(inside(stratum.joint.table(rng.standard_normal((chunk, 3))), *stratum.limits).sum())
    return count / INSIDE_DRAWS


def _unseen(drawn: Sequence[tuple[int, Proposal]], seed: list[int]) -> float:
    """The largest share of people none of whom is among those drawn, with 95 %.

    An event of share p is hit by draw l with a probability of p times the least density drawn over that of people, so
    that none of all is hit with exp(-p least(sum of these)) at most; e^-3 is 5 %.
    """
    scores = 1.5 * np.random.default_rng([*seed, LEVELS + 2]).standard_normal((5000, 3))
    draws = np.zeros(len(scores))
    for number, proposal in drawn:
        draws += number / proposal.weight(scores)
    return 3.0 / max(float(draws.min()), 3.0)


def _mean(terms: np.ndarray) -> tuple[float, float]:
    """Mean and its standard error."""
    if len(terms) < 2:
        return 0.0, 0.0
    return float(terms.mean()), float(terms.std(ddof=1) / math.sqrt(len(terms)))
