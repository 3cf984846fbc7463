"""One pilot of whom not everything is known: draws evaluated, the spread of his margins to uncertain.json.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import csv
import io
import pickle
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pilotgen.errors import StudyError
from pilotgen.evaluation import Evaluation, EvaluationContext, FailedEvaluation
from pilotgen.files import to_json, write_text
from pilotgen.linear.statespace import ComplexArray
from pilotgen.objectives import OBJECTIVES
from pilotgen.population.tally import signed
from pilotgen.runs.batch import OnProgress, Progress, as_result
from pilotgen.runs.executor import ProcessWorkers, WorkerLost
from pilotgen.runs.fingerprint import solver_version
from pilotgen.runs.options import RunOptions
from pilotgen.runs.task import Task, evaluated
from pilotgen.study.fields import setting_text
from pilotgen.study.schema import study_unit
from pilotgen.study.study import Study
from pilotgen.study.uncertain_section import merged
from pilotgen.uncertain.bands import bands, responses
from pilotgen.uncertain.draws import Draws
from pilotgen.uncertain.spread import answer, sentences, spread_of

RESULT_NAME, DRAWS_NAME = "uncertain.json", "uncertain.csv"
FILES = (RESULT_NAME, DRAWS_NAME)  # in its directory
FILETYPE, VERSION = "pilotgen uncertain", 1
FEWEST_FOR_BANDS = 3


@dataclass(frozen=True)
class UncertainRun:
    """What uncertain.json holds, and what was done."""

    content: dict[str, Any]
    progress: Progress


Answer = tuple[dict[str, Any], ComplexArray | None, ComplexArray | None]  # result object, grip motion, loop


@dataclass(frozen=True)
class DrawTask:
    """One draw of a pilot for a worker."""

    task: Task  # `values` are those of the draw


def run_draw(task: DrawTask) -> tuple[Answer, float]:
    """Evaluate one draw in a worker: ((result object, grip motion, loop), CPU seconds); no responses if it failed."""
    outcome, cpu_s = evaluated(task.task)
    if not isinstance(outcome, Evaluation):
        return (outcome.result, None, None), cpu_s
    return (outcome.result, *responses(outcome)), cpu_s


def uncertain_study(
    context: EvaluationContext,
    nominal: Evaluation,
    directory: Path,
    number: int,
    options: RunOptions,
    on_progress: OnProgress | None = None,
) -> UncertainRun:
    """Evaluate draws of a pilot; leaves uncertain.json and uncertain.csv, and returns what it says.

    Parameters
    ----------
    context : EvaluationContext
        Of the study that has the section `uncertain`.
    nominal : Evaluation
        The pilot as the study has him.
    directory : Path
        Where the files go.
    number : int
        How many draws; draw i does not depend on it.
    options : RunOptions
        Workers, solver, time limit.
    on_progress : callable, optional
        (Progress, milestone) after every draw.

    Raises
    ------
    StudyError
        Nothing is uncertain.
    FileError
        No space, no workers.
    """
    study = context.study
    draws = Draws(study, number)
    pickled = pickle.dumps(study)
    answers: dict[int, Answer] = {}
    values: list[dict[str, Any]] = []
    tasks: dict[int, DrawTask] = {}
    for k in range(number):
        try:
            values.append(draws.values(k, nominal.values))
        except StudyError as error:  # numbers and words that do not go together
            values.append(dict(nominal.values))
            answers[k] = (FailedEvaluation(values[k], "study", str(error)).result, None, None)
            continue
        own = (options.mbdae, options.solver, options.mbdyn, options.time_limit_s)
        tasks[k] = DrawTask(Task(pickled, values[k], *own))
    progress = Progress(number, evaluated=len(answers), failed=len(answers))
    workers, order = ProcessWorkers(options.worker_count(max(1, len(tasks)))), list(tasks)
    try:
        for index, outcome in workers.run(run_draw, list(tasks.values())):
            k = order[index]
            if isinstance(outcome, WorkerLost):
                answers[k] = (as_result(outcome, values[k])[0], None, None)
            else:
                answers[k], cpu_s = outcome
                progress.cpu_s += cpu_s
            progress.evaluated += 1
            progress.failed += answers[k][0]["status"] != "ok"
            if on_progress is not None:
                on_progress(progress, False)
    finally:
        workers.close()
    results = [answers[k][0] for k in range(number)]
    there = [answers[k] for k in range(number)]
    motion = [one for _, one, _ in there if one is not None]
    loop = [one for _, _, one in there if one is not None]
    content: dict[str, Any] = {
        "sentence": "",
        "sentences": [],
        "answer": "",
        "filetype": FILETYPE,
        "version": VERSION,
        "study_name": study.name,
        "loop": study.loop.words,
        "seed": study.uncertain["seed"],
        "values": nominal.values,
        "what": _what(study, draws, nominal.values),
        "nominal": {key: _finite(signed(row, nominal.result)) for key, row in OBJECTIVES.items()},
        **spread_of(results, study.limits),
        "bands": bands(motion, loop, nominal) if len(loop) >= FEWEST_FOR_BANDS else None,
        "solver_version": solver_version(options.mbdae) if study.pilot.model == "multibody" else "none",
        "study_text": study.text,
    }
    content["sentences"], content["answer"] = sentences(content), answer(content)
    content["sentence"] = content["sentences"][0]
    write_text(directory / DRAWS_NAME, _table(draws, values, results))
    write_text(directory / RESULT_NAME, to_json(content))
    return UncertainRun(content, progress)


def summary(content: Mapping[str, Any]) -> dict[str, Any]:
    """What of uncertain.json goes into result.json, as its key `uncertain`."""
    left_out = ("filetype", "version", "study_name", "values", "bands", "solver_version", "study_text")
    margins = {
        name: {key: value for key, value in one.items() if key != "draws"} for name, one in content["margins"].items()
    }
    return {key: value for key, value in content.items() if key not in left_out} | {"margins": margins}


def _what(study: Study, draws: Draws, values: Mapping[str, Any]) -> dict[str, Any]:
    """What is uncertain: each number's distribution, its set, unit and what the study says of it."""
    origin = merged(study.uncertain)[2]
    changed, own = study.with_values(values)
    return {
        name: {
            **one,
            "set": origin.get(name),
            "unit": study_unit(name),
            "study": own[name] if name in own else changed.value(name),
        }
        for name, one in draws.variables.items()
    }


def _finite(value: float) -> float | None:
    return value if abs(value) < float("inf") else None


def _table(draws: Draws, values: list[dict[str, Any]], results: list[dict[str, Any]]) -> str:
    """A row for each draw; a margin without a crossing is `inf`, of a failed draw an empty cell."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["number", *draws.variables, "status", "stage", "stable", *OBJECTIVES])
    for number, (one, result) in enumerate(zip(values, results, strict=True)):
        ok = result["status"] == "ok"
        margins = [repr(signed(row, result)) if ok else "" for row in OBJECTIVES.values()]
        stable = str(bool(result["loop"]["stable"])).lower() if ok else ""
        drawn = [setting_text(one[name]) for name in draws.variables]
        writer.writerow([number, *drawn, result["status"], result.get("stage", ""), stable, *margins])
    return text.getvalue()
