"""How a run went, as the report tells it: what study.h5 does not hold, for it is the same for any number of workers.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections import Counter

from pilotgen.progress_line import counted, format_duration
from pilotgen.runs.monitor import Course
from pilotgen.runs.results import StudyResults


def course_rows(course: Course | None, results: StudyResults) -> list[tuple[str, str]]:
    """Name and value of every row; no rows if the run left no word of it."""
    if course is None:
        return []
    rows = [
        (
            "runs",
            "1" if course.runs == 1 else f"{course.runs}, each going on from the one before; all of them together:",
        ),
        ("evaluated", f"{counted(course.evaluated, 'pilot')} in {format_duration(course.seconds)} of wall time"),
    ]
    if course.evaluated and course.seconds > 0.0:
        rows += [
            ("rate", f"{course.evaluated / course.seconds:.3g} pilots per second"),
            ("CPU time per pilot", f"{1e3 * course.cpu_s / course.evaluated:.3g} ms, solver included"),
        ]
    size = course.worker_memory_bytes
    rows += [
        ("workers", f"{course.workers or 'those of a scheduler'}{' in the last run' if course.runs > 1 else ''}"),
        ("largest worker", f"{size / 1e6:.0f} MB, solver included" if size else "not measured"),
        ("failed", _by_stage(results)),
    ]
    return rows


def _by_stage(results: StudyResults) -> str:
    failed = results.columns["status"] != "ok"
    stages = Counter(str(stage) for stage in results.columns["stage"][failed])
    return ", ".join(f"{count} at {stage}" for stage, count in sorted(stages.items())) or "none"
