"""Margins over stature and mass at the median age: the background against which a population is seen.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from pilotgen.objectives import OBJECTIVES
from pilotgen.population.joint import Joint
from pilotgen.population.population import Population
from pilotgen.runs.batch import Batch, Progress

POINTS = 9  # either way
PROBABILITIES = (0.95, 0.99)  # of the regions drawn
ARC = 73  # points of their outlines


def margin_planes(batch: Batch, population: Population) -> list[dict[str, Any]]:
    """Evaluate a grid of pilots for each sex of a population that has a distribution.

    Parameters
    ----------
    batch : Batch
        Of the run; its journal gets these pilots, its progress does not count them.
    population : Population
        The people; of a file there is no plane.

    Returns
    -------
    list of dict
        `sex`, `age_years`, `stature_m` (k,), `mass_kg` (m,), `margins` (objective -> m rows of k, capped, null of who
        failed), `regions` (probability -> outline as [stature, mass] pairs).
    """
    found = []
    for _, joint in population.joints:
        age, grid = _grid(joint, population)
        pilots: list[dict[str, Any]] = [
            {"age_years": age, "stature_m": stature, "mass_kg": mass, "pilot.sex": joint.sex}
            for mass in grid["mass_kg"]
            for stature in grid["stature_m"]
        ]
        quiet = dataclasses.replace(batch, progress=Progress(len(pilots)), on_progress=None, max_failures=None)
        results = quiet.evaluate(pilots)
        margins = {}
        for key, row in OBJECTIVES.items():
            values = [row.finite(result) if result["status"] == "ok" else None for result in results]
            margins[key] = [values[k : k + POINTS] for k in range(0, len(values), POINTS)]
        found.append(
            {
                "sex": joint.sex,
                "age_years": age,
                **grid,
                "margins": margins,
                "regions": {f"{p:g}": _region(joint, p) for p in PROBABILITIES},
            }
        )
    return found


def _grid(joint: Joint, population: Population) -> tuple[float, dict[str, list[float]]]:
    """Median age, and statures and masses of the grid, within the range of the people."""
    age = float(joint.marginals[0].of_scores(np.zeros(1))[0])
    low, high = population.within.get("age_years", joint.range["age_years"])
    grid = {}
    for name in ("stature_m", "mass_kg"):
        ends = [joint.range[name]] + ([population.within[name]] if name in population.within else [])
        first, last = max(end[0] for end in ends), min(end[1] for end in ends)
        grid[name] = np.linspace(first, last, POINTS).tolist()
    return min(max(age, low), high), grid


def _region(joint: Joint, probability: float) -> list[list[float]]:
    """Outline of the region of stature and mass that holds this share of the people, limits aside."""
    correlation = (joint.root @ joint.root.T)[1:, 1:]
    root = np.linalg.cholesky(correlation)
    turn = np.linspace(0.0, 2.0 * math.pi, ARC)
    scores = math.sqrt(-2.0 * math.log(1.0 - probability)) * root @ np.array([np.cos(turn), np.sin(turn)])
    outline = np.column_stack([joint.marginals[1 + k].of_scores(scores[k]) for k in (0, 1)])
    return [[float(stature), float(mass)] for stature, mass in outline]
