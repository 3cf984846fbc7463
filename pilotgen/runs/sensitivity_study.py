"""Which numbers of a study decide its margins: points evaluated, indices to sensitivity.json.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pilotgen.files import to_json, write_text
from pilotgen.objectives import OBJECTIVES
from pilotgen.population.tally import signed
from pilotgen.runs.batch import Batch, OnProgress, Progress
from pilotgen.runs.options import RunOptions
from pilotgen.runs.session import Say, open_batch, provenance
from pilotgen.sensitivity import indices
from pilotgen.study.schema import field_of, is_whole, study_unit
from pilotgen.study.study import Study

CHUNK = 1000  # pilots in memory at a time
KIND = "sensitivity"
RESULT_NAME = "sensitivity.json"
FILETYPE, VERSION = "pilotgen sensitivity", 1
METHODS = ("sobol", "morris")
STEP = 0.01  # of a slope, of the number's range in the study


@dataclass(frozen=True)
class SensitivityRun:
    """A study of sensitivity at its end: what sensitivity.json holds, and what was done."""

    content: dict[str, Any]
    progress: Progress


def sensitivity_study(
    study: Study,
    directory: Path,
    number: int,
    method: str = "sobol",
    seed: int | None = None,
    options: RunOptions | None = None,
    on_progress: OnProgress | None = None,
    say: Say | None = None,
) -> SensitivityRun:
    """Indices of the study's objectives over its numbers, and slopes at the nominal pilot; leaves sensitivity.json.

    Parameters
    ----------
    study, directory, options, on_progress, say
        As of `search_study`.
    number : int
        Base points of Saltelli's sample (a power of two), or Morris' trajectories.
    method : str
        "sobol" or "morris".
    seed : int, optional
        Of the points; the study's `search.seed` by default.

    Raises
    ------
    StudyError
        Too few points, or not a power of two.
    FileError, TooManyFailures
        As `search_study`.
    """
    options = options or RunOptions()
    seed = study.search.seed if seed is None else seed
    bounds = study.sensitivity["variables"] or study.search.variables
    keys = study.sensitivity["objectives"]
    make = indices.sobol_points if method == "sobol" else indices.morris_points
    spread = make(bounds, number, seed)
    near = _slope_points(study, bounds)
    progress = Progress(len(near) + len(spread))
    with open_batch(study, directory, KIND, options, min(len(spread), CHUNK), on_progress, progress, say) as batch:
        at_nominal = _evaluate(batch, bounds, near)
        values = _evaluate(batch, bounds, spread)
        attributes = provenance(study, KIND, batch, seed, "all points", options.mbdae)
    failed = np.isnan(next(iter(values.values())))
    content: dict[str, Any] = {
        "filetype": FILETYPE,
        "version": VERSION,
        "method": method,
        "number": number,
        "points": len(spread),
        "failed": int(failed.sum()),
        "numbers": {
            name: {"lower": low, "upper": high, "nominal": float(x), "unit": study_unit(name)}
            for (name, (low, high)), x in zip(bounds.items(), near[0], strict=True)
        },
        "objectives": {},
        **attributes,
    }
    for key in keys:
        content["objectives"][key] = _of_objective(bounds, method, spread, values[key], near, at_nominal[key], seed)
    write_text(directory / RESULT_NAME, to_json(content))
    return SensitivityRun(content, progress)


def _of_objective(
    bounds: Mapping[str, tuple[float, float]],
    method: str,
    spread: np.ndarray,
    values: np.ndarray,
    near: np.ndarray,
    at_nominal: np.ndarray,
    seed: int,
) -> dict[str, Any]:
    infinite = int(np.isinf(values).sum())
    found: dict[str, Any] = {"infinite": infinite}
    first = float(at_nominal[0])
    found["nominal"] = first if math.isfinite(first) else None
    found["slopes"] = dict(zip(bounds, indices.slopes(near, at_nominal), strict=True))
    if infinite:  # a margin that is not always there has no variance to share out
        return {**found, "indices": None}
    if method == "morris":
        return {**found, "indices": indices.morris_effects(bounds, spread, values, seed)}
    told = indices.sobol_indices(bounds, values, seed)
    return {**found, "indices": told, "convergence": indices.convergence(bounds, values, seed)}


def _slope_points(study: Study, bounds: Mapping[str, tuple[float, float]]) -> np.ndarray:
    nominal, ranges, steps = [], [], []
    for name, (low, high) in bounds.items():
        row: Any = field_of(name)
        nominal.append(float(study.value(name)))
        ranges.append((row.low, row.high))
        steps.append(1.0 if is_whole(name) else STEP * (high - low))
    return indices.slope_points(nominal, ranges, steps)


def _evaluate(batch: Batch, bounds: Mapping[str, tuple[float, float]], points: np.ndarray) -> dict[str, np.ndarray]:
    """Every objective at every point: NaN of a failed pilot, infinite without a crossing."""
    found = {key: np.full(len(points), np.nan) for key in OBJECTIVES}
    for first in range(0, len(points), CHUNK):
        chunk = points[first : first + CHUNK]
        pilots = [
            {name: float(round(x)) if is_whole(name) else float(x) for name, x in zip(bounds, row, strict=True)}
            for row in chunk
        ]
        for k, result in enumerate(batch.evaluate(pilots), start=first):
            if result["status"] == "ok":
                for key, objective in OBJECTIVES.items():
                    found[key][k] = objective.of(result) if objective.signed else signed(objective, result)
        batch.report(milestone=True)
    return found
