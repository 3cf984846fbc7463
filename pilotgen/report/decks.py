"""Decks of the final Pareto front: one directory per pilot, for a person or for MBDyn to read.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pilotgen.context import EvaluationContext
from pilotgen.errors import FileError
from pilotgen.evaluation import Evaluation, FailedEvaluation, evaluate, write_result
from pilotgen.objectives import GAIN_MARGIN, MARGINS
from pilotgen.report.findings import distinct, worst_order
from pilotgen.runs.batch import RESULTS_NAME
from pilotgen.runs.results import StudyResults

FRONT_NAME = "front"
SAME_MARGIN = 1e-6  # dB, deg: an evaluation repeated by the same program differs by nothing
MOST_DECKS = 20  # pilots of the front whose decks are written; a front can have a hundred


@dataclass(frozen=True)
class FrontDecks:
    """What was written.

    Attributes
    ----------
    pilots : ndarray of int
        Indices of the pilots in study.h5; the directories are numbered in this order from 01.
    different : int
        How many pilots of the front differ from each other.
    """

    pilots: np.ndarray
    different: int


def choose_front(results: StudyResults, front: np.ndarray, most: int = MOST_DECKS) -> FrontDecks:
    """At most `most` pilots of the front that differ from each other, worst first; spread along it if more exist."""
    members = set(front.tolist())
    order = np.array([index for index in worst_order(results).tolist() if index in members], dtype=np.int64)
    different = distinct(results, order, len(order), share=0.0)
    if len(different) <= most:
        return FrontDecks(different, len(different))
    worst, others = different[:1], different[1:]
    others = others[np.argsort(results.columns[GAIN_MARGIN.key][others], kind="stable")]
    spread = np.unique(np.linspace(0, len(others) - 1, most - 1).round().astype(int))
    return FrontDecks(np.concatenate([worst, others[spread]]), len(different))


def write_front_decks(
    directory: Path, context: EvaluationContext, results: StudyResults, chosen: FrontDecks
) -> tuple[list[str], list[int]]:
    """Write `directory/front/NN/`: decks, matrices.h5 and result.json of every chosen pilot; replaces an older front.

    Returns
    -------
    list of str
        What is not as study.h5 has it: pilots who fail now, or have other margins. Empty when all is well.
    list of int
        Who could be evaluated, by index in study.h5, in the order of their directories; -1 for the others.

    Raises
    ------
    FileError
        Something cannot be written.
    """
    target, part, old = (directory / f"{FRONT_NAME}{suffix}" for suffix in ("", ".part", ".old"))
    try:
        for left_over in (part, old):
            if left_over.exists():
                shutil.rmtree(left_over)
        problems: list[str] = []
        evaluated: list[int] = []
        for number, index in enumerate(chosen.pilots.tolist(), start=1):
            place = part / f"{number:02d}"
            place.mkdir(parents=True)
            inputs = zip(results.names, results.columns["inputs"][index].tolist(), strict=True)
            outcome = evaluate(context, context.study.values(dict(inputs)), keep=place)
            write_result(context, outcome, place)
            evaluated.append(index if isinstance(outcome, Evaluation) else -1)
            problems += _problems(place.name, outcome, results, index)
        if target.exists():
            os.replace(target, old)
        os.replace(part, target)
        shutil.rmtree(old, ignore_errors=True)
        return problems, evaluated
    except OSError as error:
        shutil.rmtree(part, ignore_errors=True)
        raise FileError(
            f"{target}: the front's decks cannot be written ({error.strerror or error}); check space and permissions"
        ) from None


def _problems(name: str, outcome: Evaluation | FailedEvaluation, results: StudyResults, index: int) -> list[str]:
    """What a pilot who is evaluated again does otherwise than before."""
    if not isinstance(outcome, Evaluation):
        return [f"{FRONT_NAME}/{name} failed at {outcome.stage}: {outcome.reason}"]
    return [
        f"{FRONT_NAME}/{name} has a {row.label} of {row.text(found)} where {RESULTS_NAME} has {row.text(before)}"
        for row in MARGINS
        if not same_margin(found := row.of(outcome.result), before := float(results.columns[row.key][index]))
    ]


def same_margin(a: float, b: float) -> bool:
    """Whether a pilot evaluated again has the margin that he had."""
    return a == b or abs(a - b) <= SAME_MARGIN
