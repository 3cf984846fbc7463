"""Reflex gains of a task, from the bundled calibration or from the study.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import yaml

from pilotgen.study.study import Reflex
from pilotgen.study.validate import check_choice


@lru_cache(maxsize=1)
def calibrated_gains() -> dict[str, Reflex]:
    """Gains of every task as `pilotgen calibrate` found them (pilotgen/data/reflex.yaml, docs/theory/pilot.md)."""
    with (Path(__file__).parents[1] / "data" / "reflex.yaml").open(encoding="utf-8") as file:
        data = yaml.safe_load(file)
    return {
        task: Reflex(float(gains["proportional_gain"]), float(gains["derivative_gain"]))
        for task, gains in data["tasks"].items()
    }


def reflex_gains(task: str, override: Reflex | None = None) -> Reflex:
    """The study's own gains if it gives any, else the calibrated ones of the task."""
    return (
        override if override is not None else calibrated_gains()[check_choice("pilot.task", task, calibrated_gains())]
    )
