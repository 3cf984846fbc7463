"""Reflex gains of a task, from the bundled calibration or from the study.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from pilotgen.study.schema import SCHEMA
from pilotgen.study.sections import Reflex, calibrated_gains

__all__ = ["calibrated_gains", "reflex_gains"]


def reflex_gains(task: str, torso: str, override: Reflex | None = None) -> Reflex:
    """The study's own gains if it gives any, else those calibrated for the task with this torso model."""
    if override is not None:
        return override
    return calibrated_gains(torso)[SCHEMA["pilot.task"].check(f"task = {task!r}", task)]
