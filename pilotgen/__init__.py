"""Which pilot makes this helicopter bounce? From biometrics to biodynamic feedthrough to stability margins.

    import pilotgen as pg

    study = pg.read_study("study.yaml")
    pilot = pg.evaluate(study, {"stature_m": 1.95})
    found = pg.search_pilots(study, "results/study")

The public names are those of `pilotgen.api` (docs/python.md); each is imported when it is first asked for.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pilotgen.api import (
        OBJECTIVES,
        EvaluationError,
        Found,
        Pilot,
        PilotgenError,
        Pilots,
        Progress,
        RunOptions,
        Study,
        StudyResult,
        evaluate,
        evaluate_many,
        open_results,
        rare_share,
        read_study,
        sample_pilots,
        sample_population,
        search_pilots,
        sensitivity_of,
        uncertain_pilot,
    )

__version__ = "1.0.0"

# name -> module that defines it; reading a study loads neither numpy nor the rest of the package
_PUBLIC = {
    "OBJECTIVES": "objectives",
    "EvaluationError": "errors",
    "Found": "people_api",
    "Pilot": "api",
    "PilotgenError": "errors",
    "Pilots": "api",
    "Progress": "runs.batch",
    "RunOptions": "runs.options",
    "Study": "study.study",
    "StudyResult": "api",
    "evaluate": "api",
    "evaluate_many": "api",
    "open_results": "api",
    "rare_share": "people_api",
    "read_study": "study.study",
    "sample_pilots": "api",
    "sample_population": "people_api",
    "search_pilots": "api",
    "sensitivity_of": "people_api",
    "uncertain_pilot": "people_api",
}

__all__ = [
    "OBJECTIVES",
    "EvaluationError",
    "Found",
    "Pilot",
    "PilotgenError",
    "Pilots",
    "Progress",
    "RunOptions",
    "Study",
    "StudyResult",
    "evaluate",
    "evaluate_many",
    "open_results",
    "rare_share",
    "read_study",
    "sample_pilots",
    "sample_population",
    "search_pilots",
    "sensitivity_of",
    "uncertain_pilot",
]


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'pilotgen' has no attribute {name!r}")
    import importlib

    value = getattr(importlib.import_module(f"pilotgen.{_PUBLIC[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_PUBLIC})
