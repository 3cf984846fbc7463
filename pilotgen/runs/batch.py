"""Many pilots of one study into one output directory: lock, journal, workers, failures counted.

A search and a sample differ in which pilots they ask for; this room is where they are evaluated, each once,
recorded as it
finishes, and served from the journal when it was evaluated before.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pilotgen.errors import FileError, PilotgenError
from pilotgen.files import make_directory
from pilotgen.runs.executor import WorkerLost, Workers
from pilotgen.runs.journal import JOURNAL_NAME, Journal, Record, evaluation_key

RESULTS_NAME = "study.h5"
LOCK_NAME = ".lock"


class TooManyFailures(PilotgenError):
    """The study was stopped because more pilots failed than the user allows."""


@contextmanager
def locked_directory(directory: Path, resume: bool) -> Iterator[Path]:
    """Make `directory` ours for the time of the block.

    Raises
    ------
    FileError
        It cannot be created or written, it already holds a study and `resume` is false, or another run is using it.
    """
    make_directory(directory)
    try:
        handle = os.open(directory / LOCK_NAME, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise FileError(
            f"{directory}: cannot be used for output ({error.strerror}); choose a directory you can write to"
        ) from None
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise FileError(
                f"{directory} is in use by another run; wait for it, or choose another output directory"
            ) from None
        if not resume and ((directory / RESULTS_NAME).exists() or (directory / JOURNAL_NAME).exists()):
            raise FileError(
                f"{directory} already holds a study; add --resume to go on with it (finished evaluations are kept), "
                "or choose another output directory"
            )
        yield directory
    finally:
        os.close(handle)


@dataclass
class Progress:
    """What a batch has done so far."""

    evaluated: int = 0  # by workers, in this run
    served: int = 0  # from the journal
    failed: int = 0  # of both
    cpu_s: float = 0.0  # of this run's evaluations, solver included

    @property
    def done(self) -> int:
        """Evaluations asked for and answered."""
        return self.evaluated + self.served


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
    on_result : callable, optional
        Called after every answered evaluation.
    """

    journal: Journal
    workers: Workers
    function: Callable[[Any], tuple[dict[str, Any], float]]
    make_task: Callable[[Mapping[str, float]], Any]
    fingerprint: str
    max_failures: int | None = None
    retry_failed: bool = False
    on_result: Callable[[Mapping[str, Any]], None] | None = None
    progress: Progress = field(default_factory=Progress)

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
            result, cpu_s = _as_result(outcome, missing[key])
            self.journal.add(Record(key, dict(missing[key]), str(result["status"]), result, cpu_s))
            answers[key] = result
            self.progress.evaluated += 1
            self.progress.cpu_s += cpu_s
            self._count(result)
        return [answers[key] for key in keys]

    def _count(self, result: Mapping[str, Any]) -> None:
        if result["status"] != "ok":
            self.progress.failed += 1
        if self.on_result is not None:
            self.on_result(result)
        if self.max_failures is not None and self.progress.failed > self.max_failures:
            raise TooManyFailures(
                f"{self.progress.failed} pilots failed, more than --max-failures {self.max_failures}; the last: "
                f"{result.get('stage', '')}: {result.get('reason', '')}"
            )


def _as_result(outcome: Any, values: Mapping[str, float]) -> tuple[dict[str, Any], float]:
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
