"""One voice for validation messages.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from pilotgen.errors import StudyError


def check_within(what: str, value: float, low: float, high: float, unit: str = "", hint: str = "") -> float:
    """Return `value` if low <= value <= high, else raise StudyError naming what came and what was wanted."""
    if not (math.isfinite(value) and low <= value <= high):
        unit_text = f" {unit}" if unit else ""
        hint_text = f"; {hint}" if hint else ""
        raise StudyError(f"{what} = {value:g}{unit_text} is outside {low:g} to {high:g}{unit_text}{hint_text}")
    return value


def check_positive(what: str, value: float, unit: str = "", hint: str = "") -> float:
    """Return `value` if it is finite and greater than zero, else raise StudyError."""
    if not (math.isfinite(value) and value > 0.0):
        unit_text = f" {unit}" if unit else ""
        hint_text = f"; {hint}" if hint else ""
        raise StudyError(f"{what} = {value:g}{unit_text} must be greater than zero{hint_text}")
    return value


def check_choice(what: str, value: object, choices: Iterable[str]) -> str:
    """Return `value` if it is one of `choices`, else raise StudyError listing them."""
    allowed = list(choices)
    if value not in allowed:
        raise StudyError(f"{what} = {value!r} is not known; choose one of: {', '.join(allowed)}")
    return str(value)
