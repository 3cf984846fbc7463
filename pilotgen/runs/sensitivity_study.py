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
from pilotgen.objectives import FOR_SENSITIVITY, OBJECTIVES
from pilotgen.output import STUDY_NAME
from pilotgen.population.tally import signed
from pilotgen.runs.batch import Batch, OnProgress, Progress
from pilotgen.runs.options import RunOptions
from pilotgen.runs.session import Say, open_batch, provenance
from pilotgen.sensitivity import indices
from pilotgen.sensitivity.anova import anova, factorial_points
from pilotgen.sensitivity.surrogate import surrogate_indices, surrogate_points
from pilotgen.sensitivity.words import sentences
from pilotgen.study.schema import field_of, is_whole, study_unit
from pilotgen.study.study import Study

CHUNK = 1000  # pilots in memory at a time
KIND = "sensitivity"
RESULT_NAME = "sensitivity.json"
FILES = (RESULT_NAME, "sensitivity-*.png", "journal.sqlite*", STUDY_NAME)  # in its directory
FILETYPE, VERSION = "pilotgen sensitivity", 1
METHODS = ("sobol", "morris", "surrogate", "anova")
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
        Base points of Saltelli's sample (a power of two), Morris' trajectories, pilots of a surrogate, or levels
        of each number in an analysis of variance.
    method : str
        One of `METHODS`.
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
    spread = _points(method, bounds, number, seed)
    near = _slope_points(study, bounds)
    progress = Progress(len(near) + len(spread))
    with open_batch(study, directory, KIND, options, min(len(spread), CHUNK), on_progress, progress, say) as batch:
        at_nominal = _evaluate(batch, bounds, near)
        values = _evaluate(batch, bounds, spread)
        attributes = provenance(study, KIND, batch, seed, "all points", options.mbdae)
    failed = np.isnan(next(iter(values.values())))
    content: dict[str, Any] = {
        "sentence": "",
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
        one = _of_objective(bounds, method, number, spread, values[key], seed)
        first = float(at_nominal[key][0])
        content["objectives"][key] = {
            "nominal": first if math.isfinite(first) else None,
            "slopes": dict(zip(bounds, indices.slopes(near, at_nominal[key]), strict=True)),
            **one,
        }
    content["sentence"] = sentences(content)[0]
    write_text(directory / RESULT_NAME, to_json(content))
    return SensitivityRun(content, progress)


def _points(method: str, bounds: Mapping[str, tuple[float, float]], number: int, seed: int) -> np.ndarray:
    if method == "anova":
        return factorial_points(bounds, number)
    make = {"sobol": indices.sobol_points, "morris": indices.morris_points, "surrogate": surrogate_points}[method]
    return make(bounds, number, seed)


def _of_objective(
    bounds: Mapping[str, tuple[float, float]],
    method: str,
    number: int,
    points: np.ndarray,
    values: np.ndarray,
    seed: int,
) -> dict[str, Any]:
    """What a method says of an objective; nothing of one that is infinite for somebody: it has no variance."""
    infinite = int(np.isinf(values).sum())
    found: dict[str, Any] = {"infinite": infinite}
    if method == "anova":  # every combination of levels has to be there
        whole = bool(np.isfinite(values).all())
        cells = values.reshape((number,) * len(bounds) + (1,))
        return {**found, "anova": anova(cells, list(bounds)) if whole else None}
    if infinite:
        return {**found, "indices": None}
    if method == "morris":
        return {**found, "indices": indices.morris_effects(bounds, points, values, seed)}
    if method == "surrogate":
        steps = []
        for part in (len(points) // 4, len(points) // 2, len(points)):
            told = surrogate_indices(bounds, points[:part], values[:part], seed)
            steps.append({"base": part, "total": {name: row["total"] for name, row in told["numbers"].items()}})
        return {**found, "indices": told, "convergence": steps}
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
    rows = {**OBJECTIVES, **FOR_SENSITIVITY}
    found = {key: np.full(len(points), np.nan) for key in rows}
    for first in range(0, len(points), CHUNK):
        chunk = points[first : first + CHUNK]
        pilots = [
            {name: float(round(x)) if is_whole(name) else float(x) for name, x in zip(bounds, row, strict=True)}
            for row in chunk
        ]
        for k, result in enumerate(batch.evaluate(pilots), start=first):
            if result["status"] == "ok":
                for key, objective in rows.items():
                    found[key][k] = objective.of(result) if objective.signed else signed(objective, result)
        batch.report(milestone=True)
    return found
