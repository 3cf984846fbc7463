"""Whole runs of the program in processes of their own: search, sample, one cold pilot.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import yaml

from pilotgen.bench.machine import Ran, pilotgen, run
from pilotgen.context import EvaluationContext
from pilotgen.evaluation import evaluate
from pilotgen.runs.journal import JOURNAL_NAME, Journal
from pilotgen.study.study import Study, read_study
from pilotgen.study.yaml_file import read_yaml


def variant(study: Path, directory: Path, name: str, **search: Any) -> Path:
    """Write the study with other keys in its search and return the new file's path.

    `limbs` goes to the pilot, and so does `torso`, a torso model.
    """
    text = read_yaml(study).value
    limbs = search.pop("limbs", None)
    if limbs is not None:
        text["pilot"]["limbs"] = limbs
    torso = search.pop("torso", None)
    if torso is not None:
        text["pilot"]["torso"] = {"model": torso}
    text["search"].update(search)
    path = directory / f"{name}.yaml"
    path.write_text(yaml.safe_dump(text), encoding="utf-8")
    return path


@dataclass(frozen=True)
class SearchRun:
    """One `pilotgen search` from cold start to the last file, without the report."""

    evaluations: int  # distinct pilots evaluated
    cpu_s: float  # with workers and solvers
    wall_s: float


def search(study: Path, workers: int) -> SearchRun:
    """Run a search in a directory of its own."""
    with tempfile.TemporaryDirectory(prefix="pilotgen-bench-") as directory:
        output = Path(directory) / "study"
        ran = pilotgen("search", str(study), "-o", str(output), "--workers", str(workers), "--no-report", "--quiet")
        with Journal(output / JOURNAL_NAME) as journal:
            count = len(journal)
    return SearchRun(count, ran.cpu_s, ran.wall_s)


def sample(study: Path, number: int, workers: int) -> Ran:
    """Run `pilotgen sample`; the memory reported is that of its largest process."""
    return _in_a_directory("sample", study, number, workers)


def people(study: Path, number: int, workers: int) -> Ran:
    """Run `pilotgen population`; the memory reported is that of its largest process."""
    return _in_a_directory("population", study, number, workers)


def decides(study: Path, number: int, workers: int, *more: str) -> Ran:
    """Run `pilotgen sensitivity`."""
    return _in_a_directory("sensitivity", study, number, workers, *more)


def _in_a_directory(command: str, study: Path, number: int, workers: int, *more: str) -> Ran:
    with tempfile.TemporaryDirectory(prefix="pilotgen-bench-") as directory:
        where = f"{directory}/{command}"
        return pilotgen(
            command, str(study), "-n", str(number), "-o", where, "--workers", str(workers), "--quiet", *more
        )


def cold_pilot(study: Path) -> Ran:
    """One pilot from a cold start to result.json and the printed summary."""
    with tempfile.TemporaryDirectory(prefix="pilotgen-bench-") as directory:
        return pilotgen("pilot", str(study), "-o", f"{directory}/pilot", "--no-figures")


def one_shot(mbdae: Path, deck: Path, repeat: int) -> list[float]:
    """CPU times [ms] of `mbdae DECK` in a process of its own."""
    with tempfile.TemporaryDirectory(prefix="pilotgen-bench-") as directory:
        return [1e3 * run([str(mbdae), str(deck), "-o", f"{directory}/pilot"]).cpu_s for _ in range(repeat)]


def quality(study_path: Path, seeds: Iterable[int]) -> dict[str, Any]:
    """Hypervolume of the genetic search over that of NSGA-II with as many evaluations, seed by seed."""
    from pilotgen.objectives import ranked_objectives
    from pilotgen.search import Problem
    from pilotgen.search.quality import compare_with_nsga2

    study: Study = read_study(study_path)
    problem = Problem.from_settings(study.search)
    known: dict[tuple[float, ...], tuple[float, ...]] = {}
    start = time.process_time()
    with EvaluationContext(study) as bench:

        def objectives(X: np.ndarray) -> np.ndarray:
            F = np.full((len(X), problem.n_obj), np.nan)
            for k, x in enumerate(X):
                key = tuple(float(value) for value in x)
                if key not in known:
                    result = evaluate(bench, study.values(problem.values(x))).result
                    ok = result["status"] == "ok"
                    known[key] = (
                        tuple(ranked_objectives(result, problem.objectives)) if ok else (np.nan,) * problem.n_obj
                    )
                F[k] = known[key]
            return F

        rows = []
        for seed in seeds:
            rows.extend(compare_with_nsga2(study.search, objectives, [seed]))
            print(f"  seed {seed}: {rows[-1].evaluations} evaluations, ratio {rows[-1].ratio:.4f}", file=sys.stderr)
    ratios = [row.ratio for row in rows]
    return {
        "study": study.name,
        "seeds": [row.seed for row in rows],
        "evaluations": [row.evaluations for row in rows],
        "hypervolume": [row.hypervolume for row in rows],
        "hypervolume_nsga2": [row.hypervolume_nsga2 for row in rows],
        "ratio_median": median(ratios),
        "ratio_min": min(ratios),
        "distinct_pilots": len(known),
        "cpu_s": time.process_time() - start,
    }
