"""Many pilots of one study: each is evaluated once, recorded as it finishes, and served from the journal after that.

A search and a sample differ in which pilots they ask for; what they share is here: journal, workers, failures counted.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
import shlex
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pilotgen.errors import FileError, TooManyFailures
from pilotgen.objectives import ranked_objectives
from pilotgen.runs.executor import WorkerLost, Workers
from pilotgen.runs.journal import Journal, Record, evaluation_key
from pilotgen.study.wording import setting_text

RESULTS_NAME = "study.h5"

WEIGH_EVERY_S = 3.0
MOST_IN_A_ROW = 12  # failures that are no pilot's own; one in three, by chance, would be so in one of 500,000
_NOT_ANSWERED = ("mbdae died", "mbdae ended", "mbdae closed", "mbdae did not answer", "protocol error", "out of memory")


def not_his_own(result: Mapping[str, Any]) -> bool:
    """Whether a pilot failed by something that may be the machine's fault: a solver or worker that died, or lied."""
    stage, reason = result.get("stage"), str(result.get("reason", ""))
    return stage in ("worker", "matrices", "internal") or (stage == "solver" and reason.startswith(_NOT_ANSWERED))


@dataclass
class Progress:
    """What a run has done so far."""

    total: int = 0  # pilots that will be asked for; 0 if nobody knows
    evaluated: int = 0  # by workers, in this run
    served: int = 0  # from the journal
    failed: int = 0  # of both
    unstable: int = 0  # closed loops, of both
    cpu_s: float = 0.0  # of this run's evaluations, solver included
    worker_memory_bytes: int = 0  # largest that one worker and its solver had so far; 0 if nobody looked
    workers: int = 0  # processes of this run; 0 if others have them
    generation: int = 0  # of a search, from 0
    generations: int = 0
    smallest: dict[str, float] = field(default_factory=dict)  # objective -> its smallest value, as ranked
    last: Mapping[str, Any] = field(default_factory=dict, repr=False)  # the result object that came last

    @property
    def done(self) -> int:
        """Evaluations asked for and answered."""
        return self.evaluated + self.served


OnProgress = Callable[[Progress, bool], None]  # what was done so far, and whether a milestone is reached


@dataclass
class Batch:
    """Evaluates pilots through journal and workers.

    Parameters
    ----------
    journal : Journal
        Where finished evaluations go and are looked up.
    workers : Workers
        Who evaluates.
    function : callable
        Module-level function of one task, returns (result object, CPU seconds).
    make_task : callable
        Values of one pilot -> task (something picklable).
    fingerprint : str
        Hash of everything that determines a result except the values.
    max_failures : int, optional
        Stop with TooManyFailures when more pilots than this have failed.
    retry_failed : bool
        Evaluate again what the journal holds as failed.
    objectives : sequence of str
        Keys of the objectives whose smallest values `progress` tells.
    on_progress : callable, optional
        Called with `progress` and False after every answered evaluation.
    """

    journal: Journal
    workers: Workers
    function: Callable[[Any], tuple[dict[str, Any], float]]
    make_task: Callable[[Mapping[str, float]], Any]
    fingerprint: str
    max_failures: int | None = None
    retry_failed: bool = False
    objectives: Sequence[str] = ()
    on_progress: OnProgress | None = None
    progress: Progress = field(default_factory=Progress)
    _suspects: list[str] = field(default_factory=list)
    _weighed: float = -math.inf

    def warm_up(self) -> None:
        """Have the workers start and warm up with the study's nominal pilot while there is nothing to ask for yet.

        Only with an empty journal: another one may have all the answers.
        """
        if not len(self.journal):
            self.workers.warm_up(self.function, self.make_task({}))

    def evaluate(self, pilots: Sequence[Mapping[str, float]]) -> list[dict[str, Any]]:
        """Result objects of these pilots, in their order; equal pilots are evaluated once."""
        keys = [evaluation_key(self.fingerprint, pilot) for pilot in pilots]
        answers: dict[str, dict[str, Any]] = {}
        missing: dict[str, Mapping[str, float]] = {}
        for key, pilot in zip(keys, pilots, strict=True):
            if key in answers or key in missing:
                continue
            record = self.journal.get(key)
            if record is None or (self.retry_failed and record.status != "ok"):
                missing[key] = pilot
            else:
                answers[key] = record.result
                self.progress.served += 1
                self._count(record.result)
        order = list(missing)
        tasks = [self.make_task(missing[key]) for key in order]
        for index, outcome in self.workers.run(self.function, tasks):
            key = order[index]
            result, cpu_s = as_result(outcome, missing[key])
            self.journal.add(Record(key, dict(missing[key]), str(result["status"]), result, cpu_s))
            self._watch_the_machine(key, result)
            answers[key] = result
            self.progress.evaluated += 1
            self.progress.cpu_s += cpu_s
            self._weigh()
            self._count(result)
        return [answers[key] for key in keys]

    def _watch_the_machine(self, key: str, result: Mapping[str, Any]) -> None:
        """Stop when one pilot after the other fails by what may be the machine's fault, and forget these."""
        if not not_his_own(result):
            self._suspects.clear()
            return
        self._suspects.append(key)
        if len(self._suspects) >= MOST_IN_A_ROW:
            self.journal.forget(self._suspects)
            raise FileError(
                f"{len(self._suspects)} pilots in a row failed by what is no pilot's own, the last at "
                f"{result['stage']}: {result['reason']}; these are not recorded: look for a solver that is broken, or "
                "a limit of memory or time, and go on with --resume"
            )

    def _weigh(self) -> None:
        """Look at the workers' memory, every few seconds."""
        now = time.monotonic()
        if now - self._weighed >= WEIGH_EVERY_S:
            self._weighed = now
            progress = self.progress
            progress.worker_memory_bytes = max(progress.worker_memory_bytes, self.workers.memory_bytes())

    def _count(self, result: Mapping[str, Any]) -> None:
        progress = self.progress
        progress.last = result
        if result["status"] != "ok":
            progress.failed += 1
        else:
            progress.unstable += result["loop"].get("stable") is False
            for name, value in zip(self.objectives, ranked_objectives(result, self.objectives), strict=True):
                progress.smallest[name] = min(progress.smallest.get(name, math.inf), value)
        self.report()
        if self.max_failures is not None and self.progress.failed > self.max_failures:
            raise TooManyFailures(
                f"{self.progress.failed} pilots failed, more than --max-failures {self.max_failures}; the last: "
                f"{result.get('stage', '')}: {result.get('reason', '')}"
            )

    def report(self, milestone: bool = False) -> None:
        """Tell the caller of the run how far it is."""
        if self.on_progress is not None:
            self.on_progress(self.progress, milestone)


def as_result(outcome: Any, values: Mapping[str, float]) -> tuple[dict[str, Any], float]:
    """What a worker answered as a result object and CPU seconds; a lost worker is a failed pilot."""
    if isinstance(outcome, WorkerLost):
        return {"status": "failed", "stage": "worker", "reason": outcome.reason, "values": dict(values)}, 0.0
    result, cpu_s = outcome
    return result, float(cpu_s)


def failures_by_reason(results: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, int, Mapping[str, Any]]]:
    """Failed results grouped by stage and reason with numbers taken out: (stage, example reason, count, example)."""
    import re

    groups: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for result in results:
        if result["status"] != "ok":
            stage, reason = str(result["stage"]), str(result["reason"])
            groups.setdefault((stage, re.sub(r"-?\d+(\.\d+)?([eE][-+]?\d+)?", "#", reason)), []).append(result)
    ordered = sorted(groups.items(), key=lambda item: (-len(item[1]), item[0]))
    return [(stage, str(members[0]["reason"]), len(members), members[0]) for (stage, _), members in ordered]


def replay_command(study: str, values: Mapping[str, Any], solver: str = "mbdae", directory: str = "replay") -> str:
    """The command line that evaluates one pilot of a study again, with the solver that evaluated it."""
    settings = shlex.join(f"{name}={setting_text(value)}" for name, value in values.items())
    other = "" if solver == "mbdae" else f" --solver {solver}"
    return f"pilotgen pilot {shlex.quote(study)} -o {directory}{other} --set {settings}"
