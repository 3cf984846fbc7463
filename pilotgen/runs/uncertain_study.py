"""One pilot of whom not everything is known: draws evaluated, the spread of his margins to uncertain.json.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import base64
import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pilotgen.context import EvaluationContext
from pilotgen.errors import StudyError
from pilotgen.evaluation import Evaluation, FailedEvaluation
from pilotgen.files import to_json, write_text
from pilotgen.linear.statespace import ComplexArray
from pilotgen.objectives import OBJECTIVES
from pilotgen.output import STUDY_NAME
from pilotgen.population.tally import signed
from pilotgen.runs.batch import OnProgress, Progress
from pilotgen.runs.changes import UNCERTAIN, refuse_changes
from pilotgen.runs.fingerprint import solver_version
from pilotgen.runs.journal import JOURNAL_NAME, evaluation_key, peek
from pilotgen.runs.options import RunOptions
from pilotgen.runs.session import Say, open_batch
from pilotgen.runs.task import Task, evaluated
from pilotgen.study.schema import study_unit
from pilotgen.study.study import Study
from pilotgen.study.uncertain_section import merged
from pilotgen.study.wording import setting_text
from pilotgen.uncertain.bands import bands, responses
from pilotgen.uncertain.draws import Draws
from pilotgen.uncertain.spread import answer, sentences, spread_of

RESULT_NAME, DRAWS_NAME = "uncertain.json", "uncertain.csv"
FILES = (RESULT_NAME, DRAWS_NAME, "journal.sqlite*", STUDY_NAME)  # in its directory
CHUNK = 500  # draws between two milestones
RESPONSES = "responses"  # key of a draw's grip motion and loop beside his result object
FILETYPE, VERSION = "pilotgen uncertain", 1
FEWEST_FOR_BANDS = 3


@dataclass(frozen=True)
class UncertainRun:
    """What uncertain.json holds, and what was done."""

    content: dict[str, Any]
    progress: Progress


def check_going_on(directory: Path, study: Study) -> None:
    """Refuse a directory whose draws are of another study, before anything of it is replaced. Raises FileError."""
    path = directory / JOURNAL_NAME
    if path.exists():
        meta, _ = peek(path)
        if "study_text" in meta:
            refuse_changes(directory, meta["study_text"], study, UNCERTAIN)


def run_draw(task: Task) -> tuple[dict[str, Any], float]:
    """Evaluate one draw in a worker: (result object with `RESPONSES` unless it failed, CPU seconds)."""
    outcome, cpu_s = evaluated(task)
    if not isinstance(outcome, Evaluation):
        return outcome.result, cpu_s
    packed = [base64.b64encode(np.asarray(one, "<c16").tobytes()).decode("ascii") for one in responses(outcome)]
    return {**outcome.result, RESPONSES: packed}, cpu_s


def _responses(result: Mapping[str, Any]) -> list[ComplexArray]:
    """Grip motion and loop of a draw that `run_draw` evaluated; nothing of one that failed."""
    return [np.frombuffer(base64.b64decode(text), "<c16") for text in result.get(RESPONSES, ())]


def uncertain_study(
    context: EvaluationContext,
    nominal: Evaluation,
    directory: Path,
    number: int,
    options: RunOptions,
    on_progress: OnProgress | None = None,
    say: Say | None = None,
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
    options, on_progress, say
        As of `search_study`; a draw that the journal has is not evaluated again.

    Raises
    ------
    StudyError
        Nothing is uncertain.
    FileError, TooManyFailures
        As `search_study`.
    """
    study = context.study
    draws = Draws(study, number)
    values: list[dict[str, Any]] = []
    impossible: dict[int, dict[str, Any]] = {}
    for k in range(number):
        try:
            values.append(draws.values(k, nominal.values))
        except StudyError as error:  # numbers and words that do not go together
            values.append(dict(nominal.values))
            impossible[k] = FailedEvaluation(values[k], "study", str(error)).result
    possible = [k for k in range(number) if k not in impossible]
    different = len({evaluation_key("", values[k]) for k in possible})  # equal ones, as of words, are evaluated once
    left_out = len(impossible)
    progress = Progress(different + left_out, evaluated=left_out, failed=left_out)
    found = dict(impossible)
    most = max(1, min(different, CHUNK))
    with open_batch(study, directory, UNCERTAIN, options, most, on_progress, progress, say, run_draw) as batch:
        for first in range(0, len(possible), CHUNK):
            chunk = possible[first : first + CHUNK]
            found |= dict(zip(chunk, batch.evaluate([values[k] for k in chunk]), strict=True))
            batch.report(milestone=True)
    results = [found[k] for k in range(number)]
    pairs = [pair for pair in map(_responses, results) if pair]
    motion, loop = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
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
