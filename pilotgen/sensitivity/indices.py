"""Sobol indices and Morris screening of any function of numbers in a box.

Points come in blocks that belong together: of one base point (Sobol) or one trajectory (Morris). A block in which
a value is missing is left out as a whole. The estimators are SALib's.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pilotgen.errors import PilotgenError, StudyError

RESAMPLES = 200  # of the bootstrap
FEWEST = 16  # base points
LEVELS = 4  # of Morris' grid


def _salib(module: str) -> Any:
    import importlib

    try:
        return importlib.import_module(f"SALib.{module}")
    except ImportError:
        raise PilotgenError("sensitivity needs SALib; install it: pip install 'pilotgen[sensitivity]'") from None


def _box(bounds: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
    return {"num_vars": len(bounds), "names": list(bounds), "bounds": [list(pair) for pair in bounds.values()]}


def check_base(base: int) -> None:
    """Raise StudyError if so many base points make no Saltelli sample."""
    if base < FEWEST or base & (base - 1):
        low = max(FEWEST, 1 << (max(base, 1).bit_length() - 1))
        raise StudyError(
            f"-n {base} is no base sample: a power of two from {FEWEST} up is wanted, for Sobol points to be balanced; "
            f"give -n {low} or {2 * low}"
        )


def sobol_points(bounds: Mapping[str, tuple[float, float]], base: int, seed: int) -> np.ndarray:
    """Saltelli's points, shape (base * (k + 2), k) for k numbers; those of half the base come first.

    Raises
    ------
    StudyError
        `base` is no power of two or too small.
    PilotgenError
        SALib is not installed.
    """
    check_base(base)
    points = _salib("sample.sobol").sample(_box(bounds), base, calc_second_order=False, seed=_short(seed))
    return np.asarray(points, dtype=float)


def sobol_indices(bounds: Mapping[str, tuple[float, float]], values: np.ndarray, seed: int) -> dict[str, Any]:
    """First-order and total indices of the values at `sobol_points`.

    Parameters
    ----------
    bounds : mapping
        Number -> (lower, upper).
    values : ndarray, shape (base * (k + 2),)
        NaN where there is none.
    seed : int
        Of the bootstrap.

    Returns
    -------
    dict
        `blocks` and `blocks_left_out`, and for every number `first`, `first_half_width`, `total`,
        `total_half_width` (of bootstrap intervals of 95 %); None where the values do not vary or no block is whole.
    """
    blocks = values.reshape(-1, len(bounds) + 2)
    whole = blocks[np.isfinite(blocks).all(axis=1)]
    found: dict[str, Any] = {"blocks": len(whole), "blocks_left_out": len(blocks) - len(whole)}
    keys = ("first", "first_half_width", "total", "total_half_width")
    if len(whole) < 2 or not np.ptp(whole) > 0.0:
        return {**found, "numbers": {name: dict.fromkeys(keys) for name in bounds}}
    one = _salib("analyze.sobol").analyze(
        _box(bounds), whole.ravel(), calc_second_order=False, num_resamples=RESAMPLES, seed=_short(seed)
    )
    columns = [np.asarray(one[key], dtype=float) for key in ("S1", "S1_conf", "ST", "ST_conf")]
    rows = zip(bounds, *columns, strict=True)
    return {**found, "numbers": {name: dict(zip(keys, map(float, row), strict=True)) for name, *row in rows}}


def morris_points(bounds: Mapping[str, tuple[float, float]], trajectories: int, seed: int) -> np.ndarray:
    """Morris' trajectories, shape (trajectories * (k + 1), k); each changes one number after the other."""
    sample = _salib("sample.morris").sample(_box(bounds), trajectories, num_levels=LEVELS, seed=_short(seed))
    return np.asarray(sample, dtype=float)


def morris_effects(
    bounds: Mapping[str, tuple[float, float]], points: np.ndarray, values: np.ndarray, seed: int
) -> dict[str, Any]:
    """Elementary effects over the whole range of each number: mean, mean of magnitudes with half width, deviation.

    Parameters as of `sobol_indices`; `points` are those of `morris_points`.
    """
    length = len(bounds) + 1
    whole = np.isfinite(values.reshape(-1, length)).all(axis=1)
    found: dict[str, Any] = {"blocks": int(whole.sum()), "blocks_left_out": int((~whole).sum())}
    keys = ("mean", "mean_magnitude", "mean_magnitude_half_width", "deviation")
    if whole.sum() < 2:
        return {**found, "numbers": {name: dict.fromkeys(keys) for name in bounds}}
    kept = np.repeat(whole, length)
    one = _salib("analyze.morris").analyze(
        _box(bounds), points[kept], values[kept], num_levels=LEVELS, num_resamples=RESAMPLES, seed=_short(seed)
    )
    columns = [np.asarray(one[key], dtype=float) for key in ("mu", "mu_star", "mu_star_conf", "sigma")]
    rows = zip(bounds, *columns, strict=True)
    return {**found, "numbers": {name: dict(zip(keys, map(float, row), strict=True)) for name, *row in rows}}


def convergence(bounds: Mapping[str, tuple[float, float]], values: np.ndarray, seed: int) -> list[dict[str, Any]]:
    """Total indices of a quarter, half and all of the base points: whether more of them would change anything.

    `values` has shape (base * (k + 2),), as `sobol_indices` takes them.
    """
    width = len(bounds) + 2
    base = len(values) // width
    steps = []
    for part in (base // 4, base // 2, base):
        numbers = sobol_indices(bounds, values[: part * width], seed)["numbers"]
        steps.append({"base": part, "total": {name: row["total"] for name, row in numbers.items()}})
    return steps


def slope_points(nominal: Sequence[float], ranges: Sequence[tuple[float, float]], steps: Sequence[float]) -> np.ndarray:
    """The nominal point, then each number a step down and a step up, within its range; shape (2 k + 1, k)."""
    points = [list(nominal)]
    for k, ((low, high), step) in enumerate(zip(ranges, steps, strict=True)):
        for side in (-step, step):
            point = list(nominal)
            point[k] = min(max(point[k] + side, low), high)
            points.append(point)
    return np.array(points, dtype=float)


def slopes(points: np.ndarray, values: np.ndarray) -> list[float | None]:
    """Central differences at `slope_points` (one-sided where the range ends), per unit of each number."""
    found: list[float | None] = []
    for k in range(points.shape[1]):
        down, up = 1 + 2 * k, 2 + 2 * k
        run = points[up, k] - points[down, k]
        there = bool(np.isfinite(values[[down, up]]).all()) and run > 0.0
        found.append(float((values[up] - values[down]) / run) if there else None)
    return found


def _short(seed: int) -> int:
    return seed % 2**32  # what NumPy's older generators take
