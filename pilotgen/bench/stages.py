"""The stages of one evaluation, measured on the real chain: the functions of `evaluation` under a stopwatch.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import functools
import importlib
import pickle
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from pilotgen import evaluation
from pilotgen.bench.machine import process_cpu_s
from pilotgen.context import EvaluationContext
from pilotgen.evaluation import DECK_NAMES, Evaluation, evaluate
from pilotgen.runs.journal import Journal, Record, evaluation_key
from pilotgen.runs.task import Task
from pilotgen.search import Problem
from pilotgen.solver.matrices import read_matrices
from pilotgen.study.study import Study

# stage -> functions of the chain, by their names in pilotgen.evaluation, or MODULE:FUNCTION
STAGES: dict[str, tuple[str, ...]] = {
    "body and cockpit": ("biometrics_from", "make_body", "make_cockpit", "reflex_gains"),
    "posture: first guess": ("first_guess",),
    "posture: check": ("from_poses",),
    "decks: posture": ("render_posture",),
    "decks: trim": ("render_trim",),
    "decks: pilot": ("render_direct",),
    "matrices: read": ("read_matrices",),
    "activations": ("solve_activations",),
    "torso": ("make_torso", "seat_torso"),
    "torso: its modes": ("pilotgen.posture.seated_spine:torso_modes",),
    "modes and feedthrough": ("make_pilot_model", "mayo_pilot"),
    "certificate": ("certificate",),
    "loop and margins": ("close_loop",),
    "summary": ("bdft_summary",),
}
REST = "rest of the chain"
BOOKKEEPING = "bookkeeping: key, task, journal"


@dataclass(frozen=True)
class Measured:
    """CPU time per pilot [ms] of one run: by stage in this process, by deck in the solver."""

    pilots: int
    failed: int
    python_ms: dict[str, float]
    solver_ms: dict[str, float]

    @property
    def total_ms(self) -> float:
        """CPU time per pilot [ms], solver included."""
        return sum(self.python_ms.values()) + sum(self.solver_ms.values())


class _Stopwatch:
    """CPU time by stage; a stage called inside another is taken out of the outer one."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._inner = [0.0]

    def wrap(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(function)
        def timed(*args: Any, **kwargs: Any) -> Any:
            with self.stage(stage):
                return function(*args, **kwargs)

        return timed

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        self._inner.append(0.0)
        start = time.process_time()
        try:
            yield
        finally:
            spent = time.process_time() - start
            self.seconds[name] += spent - self._inner.pop()
            self._inner[-1] += spent


def random_pilots(study: Study, count: int) -> list[dict[str, float]]:
    """Values of pilots spread over the study's box, the same ones every time."""
    problem = Problem.from_settings(study.search)
    points = np.random.default_rng(1).random((count, problem.n_var))
    return [study.values(problem.values(x)) for x in problem.xl + points * (problem.xu - problem.xl)]


def measure(bench: EvaluationContext, pilots: list[dict[str, float]]) -> Measured:
    """Evaluate the pilots, one after the other, and record what they cost."""
    watch = _Stopwatch()
    solver: dict[str, float] = defaultdict(float)
    ask = EvaluationContext.ask

    def timed_ask(self: EvaluationContext, task: str, text: str, name: str, *args: Any, **kwargs: Any) -> Any:
        pid = self.client.pid
        before = process_cpu_s(pid) if pid is not None else 0.0
        with watch.stage("solver: requests and replies"):
            reply = ask(self, task, text, name, *args, **kwargs)
        assert self.client.pid is not None
        solver[f"solver: {task} {name}"] += process_cpu_s(self.client.pid) - before
        return reply

    failed = 0
    pickled = pickle.dumps(bench.study)
    with tempfile.TemporaryDirectory() as directory, mock.patch.object(EvaluationContext, "ask", timed_ask):
        patches = []
        for stage, names in STAGES.items():
            for name in names:
                module, _, function = name.rpartition(":")
                place = importlib.import_module(module) if module else evaluation
                patches.append(mock.patch.object(place, function, watch.wrap(stage, getattr(place, function))))
        for patch in patches:
            patch.start()
        try:
            with Journal(Path(directory) / "journal.sqlite") as journal:
                for pilot in pilots:
                    with watch.stage(REST):
                        outcome = evaluate(bench, pilot)
                    failed += not isinstance(outcome, Evaluation)
                    with watch.stage(BOOKKEEPING):
                        result = outcome.result
                        task = pickle.loads(pickle.dumps(Task(pickled, pilot)))
                        answer = pickle.loads(pickle.dumps((result, 0.0)))[0]
                        key = evaluation_key("0" * 64, task.values)
                        journal.get(key)
                        journal.add(Record(key, pilot, str(answer["status"]), answer, 0.0))
        finally:
            for patch in patches:
                patch.stop()
    n = len(pilots)
    order = [*STAGES, "solver: requests and replies", REST, BOOKKEEPING]
    return Measured(
        n,
        failed,
        {name: 1e3 * watch.seconds[name] / n for name in order if watch.seconds[name] > 0.0},
        {name: 1e3 * seconds / n for name, seconds in solver.items()},
    )


@dataclass(frozen=True)
class OneShot:
    """`mbdae` on the pilot's deck in a process of its own, and what it said of itself."""

    unknowns: int
    solver_seconds: list[float]  # as the replies of a running mbdae tell: reading, linearising, writing
    result: dict[str, Any]
    deck: Path


def one_pilot(bench: EvaluationContext, pilot: dict[str, float], directory: Path, repeat: int = 20) -> OneShot:
    """Evaluate one pilot, keep its files, and have its deck linearised again and again."""
    outcome = evaluate(bench, pilot, keep=directory)
    deck = directory / DECK_NAMES[2]
    text = deck.read_text(encoding="utf-8")
    seconds = [bench.ask("linearise", text, DECK_NAMES[2], bench.scratch / "again.h5").seconds for _ in range(repeat)]
    return OneShot(read_matrices(directory / "matrices.h5").n, seconds, outcome.result, deck)
