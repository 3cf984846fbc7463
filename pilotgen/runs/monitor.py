"""A running search or sample, told to others: a heartbeat file in its directory, and a log of JSON lines on demand.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import sqlite3
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pilotgen.errors import FileError
from pilotgen.files import refuse_special, write_text
from pilotgen.output import HEARTBEAT_NAME, LOCK_NAME, read_mark
from pilotgen.runs.batch import OnProgress, Progress
from pilotgen.runs.journal import JOURNAL_NAME

HEARTBEAT_S = 5.0  # between two beats, at least
LOG_INTERVAL_S = 10.0  # between two `progress` events that are no milestones


def _refuse_foreign(log: Path) -> None:
    """Raise FileError for a file that is no log of a run: it would be spoilt by what is appended."""
    if not log.is_file():  # a pipe, a terminal: nothing to spoil
        return
    try:
        with log.open("rb") as file:
            first = file.readline(MOST_OF_A_LINE)
    except OSError as error:
        raise FileError(f"{log}: the log cannot be written ({error.strerror})") from None
    if not first:
        return
    try:
        ours = "event" in json.loads(first)
    except (ValueError, TypeError, RecursionError):
        ours = False
    if not ours:
        raise FileError(f"{log} is not the log of a run, and would be spoilt by one; choose another file for --log")


def _without_waiting(path: Path) -> int:
    flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC
    return os.open(path, flags | os.O_NONBLOCK, 0o666)  # a pipe that nobody reads is an error, not a wait


MOST_OF_A_LINE = 1_000_000  # bytes of a log's first line


class Monitor:
    """Writes the heartbeat and the log of one run; give it the run's progress, and `end` it.

    Parameters
    ----------
    directory : Path
        The run's output directory.
    log : Path, optional
        File to which events are appended, one JSON object a line.
    tell : callable, optional
        Takes every sentence that `say` takes, besides the log.
    clock : callable
        Seconds, for both intervals.
    """

    def __init__(
        self,
        directory: Path,
        log: Path | None = None,
        tell: Callable[[str], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._directory, self._tell, self._clock = directory, tell, clock
        self._progress: Progress | None = None
        self._begin = clock()
        self._earlier = _sums(read_beat(directory))
        self._last_beat = self._last_event = -float("inf")
        self._failed = 0
        self._path = log
        if log is not None:
            _refuse_foreign(log)
        try:
            self._log = None if log is None else os.fdopen(_without_waiting(log), "a", encoding="utf-8")
        except OSError as error:
            raise FileError(f"{log}: the log cannot be written ({error.strerror})") from None

    def event(self, kind: str, **fields: Any) -> None:
        """Append one event to the log. Raises FileError if that fails."""
        if self._log is None:
            return
        line = {"time": datetime.now(UTC).isoformat(timespec="milliseconds"), "event": kind, **fields}
        try:
            self._log.write(json.dumps(line, allow_nan=False) + "\n")
            self._log.flush()
        except OSError as error:
            raise FileError(f"{self._path}: the log cannot be written ({error.strerror})") from None

    def __call__(self, progress: Progress, milestone: bool) -> None:
        """Take note of how far the run is."""
        now = self._clock()
        self._progress = progress
        if progress.failed > self._failed:
            self._failed = progress.failed
            last = progress.last
            self.event("failure", stage=last.get("stage"), reason=last.get("reason"), values=last.get("values"))
        if milestone or now - self._last_event >= LOG_INTERVAL_S:
            self._last_event = now
            self.event("progress", **_numbers(progress))
        if now - self._last_beat >= HEARTBEAT_S:
            self._last_beat = now
            self._beat(progress, now)

    def say(self, sentence: str) -> None:
        """A sentence that the user should know."""
        self.event("note", text=sentence)
        if self._tell is not None:
            self._tell(sentence)

    def end(self, how: str) -> None:
        """The run is over; `how` says it in a word or a sentence."""
        progress = self._progress
        if progress is not None:
            self._beat(progress, self._clock())
        self.event("end", how=how, **({} if progress is None else _numbers(progress)))
        if self._log is not None:
            self._log.close()

    def _beat(self, progress: Progress, now: float) -> None:
        beat = {
            "time": time.time(), "pid": os.getpid(), "seconds": now - self._begin, **_numbers(progress),
            "earlier": self._earlier,
        }  # fmt: skip
        with suppress(FileError):  # of no use to the run itself; a full disk is told by who needs the space
            write_text(self._directory / HEARTBEAT_NAME, json.dumps(beat, allow_nan=False) + "\n")


@contextmanager
def heard(directory: Path, on_progress: OnProgress | None) -> Iterator[OnProgress]:
    """Who is told of a run's progress, so that its heartbeat is written, and `on_progress` called, if there is one."""
    monitor = Monitor(directory)

    def told(progress: Progress, milestone: bool) -> None:
        monitor(progress, milestone)
        if on_progress is not None:
            on_progress(progress, milestone)

    try:
        yield told
    finally:
        monitor.end("done")


def _numbers(progress: Progress) -> dict[str, Any]:
    numbers = asdict(progress)
    del numbers["last"]
    return {**numbers, "done": progress.done}


_SUMMED = ("runs", "seconds", "evaluated", "cpu_s", "worker_memory_bytes")  # over runs that went on; the last: largest


def _sums(beat: Mapping[str, Any] | None) -> dict[str, float]:
    """Of the run that told this and those before it."""
    if beat is None:
        return dict.fromkeys(_SUMMED, 0)
    earlier, own = beat.get("earlier", {}), {**beat, "runs": 1}
    sums = {name: earlier.get(name, 0) + own.get(name, 0) for name in _SUMMED}
    return sums | {_SUMMED[-1]: max(earlier.get(_SUMMED[-1], 0), own.get(_SUMMED[-1], 0))}


@dataclass(frozen=True)
class Course:
    """How the runs went that made the study of a directory, the first and those that went on with it.

    Attributes
    ----------
    runs : int
        How many; those that evaluated no pilot left no word.
    workers : int
        Processes of the last one; 0 if it had those of a scheduler, or did not tell.
    evaluated : int
        Pilots, over all runs.
    seconds : float
        Of wall time, from the start of each run to its last word.
    cpu_s : float
        Of the evaluations, solver included.
    worker_memory_bytes : int
        Of the largest worker with its solver; 0 if nobody looked.
    """

    runs: int
    workers: int
    evaluated: int
    seconds: float
    cpu_s: float
    worker_memory_bytes: int


def read_course(directory: Path) -> Course | None:
    """How the runs in a directory went, by their heartbeat; None if there is none, or none of ours."""
    beat = read_beat(directory)
    if beat is None:
        return None
    sums = _sums(beat)
    return Course(
        int(sums["runs"]),
        int(beat.get("workers", 0)),
        int(sums["evaluated"]),
        float(sums["seconds"]),
        float(sums["cpu_s"]),
        int(sums["worker_memory_bytes"]),
    )


def read_beat(directory: Path) -> Mapping[str, Any] | None:
    """The heartbeat of a directory; None if there is none, or somebody else has written to the file."""
    beat: Any = None
    with suppress(OSError, ValueError, RecursionError, FileError):
        refuse_special(directory / HEARTBEAT_NAME)
        text = (directory / HEARTBEAT_NAME).read_text(encoding="utf-8")
        beat = json.loads(text, parse_constant=lambda _: None)
    return beat if _is_sound(beat) else None


@dataclass(frozen=True)
class Status:
    """How far the study of a directory is.

    Attributes
    ----------
    kind : str
        "search" or "sample".
    state : str
        "running", "finished", or "interrupted" (it goes on with --resume).
    evaluations, failed : int
        Recorded in the journal.
    failed_by_stage : mapping
        Stage -> how many.
    beat : mapping or None
        What the run told last (see `docs/long_runs.md`), None before the first.
    """

    kind: str
    state: str
    evaluations: int
    failed: int
    failed_by_stage: Mapping[str, int] = field(default_factory=dict)
    beat: Mapping[str, Any] | None = None

    @property
    def rate_per_s(self) -> float | None:
        """Evaluations per second of the run that told last; None if it has evaluated nothing."""
        if not self.beat or not self.beat["evaluated"] or self.beat["seconds"] <= 0.0:
            return None
        return float(self.beat["evaluated"] / self.beat["seconds"])

    @property
    def left_s(self) -> float | None:
        """Seconds that the rest will take at this rate, at most; None if unknown."""
        if self.state != "running" or self.beat is None or self.rate_per_s is None:
            return None
        return max(0.0, float(self.beat["total"] - self.beat["done"]) / self.rate_per_s)

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        return {**asdict(self), "rate_per_s": self.rate_per_s, "left_s": self.left_s}


def read_status(directory: Path) -> Status:
    """Read how far the study of a directory is; a run that is going on is not disturbed.

    Raises
    ------
    FileError
        There is no study.
    """
    journal = directory / JOURNAL_NAME
    mark = read_mark(directory) if directory.is_dir() else None
    refuse_special(journal)
    if not journal.is_file():
        raise FileError(f"{directory} holds no study: it has no {JOURNAL_NAME}")
    stages = _failed_by_stage(journal)
    kind, complete = ("study", False) if mark is None else (mark.kind, mark.complete)
    state = "running" if _is_locked(directory) else "finished" if complete else "interrupted"
    ok = stages.pop("", 0)
    failed = sum(stages.values())
    return Status(kind, state, ok + failed, failed, stages, read_beat(directory))


_IN_A_BEAT = ("time", "pid", "seconds", "done", "total", "evaluated", "generation", "generations")
_NOT_IN_OLDER = ("worker_memory_bytes", "workers", "cpu_s")


def _is_sound(beat: Any) -> bool:
    """Whether a heartbeat is one: somebody may have written to the file."""

    def numbers(of: Any, names: Sequence[str], default: int | None) -> bool:
        return isinstance(of, dict) and all(
            isinstance(of.get(name, default), int | float) and 0 <= of.get(name, 0) < 1e15 for name in names
        )

    return (
        numbers(beat, _IN_A_BEAT, None)
        and numbers(beat, _NOT_IN_OLDER, 0)
        and numbers(beat.get("earlier", {}), _SUMMED, 0)
    )


def _failed_by_stage(journal: Path) -> dict[str, int]:
    """Stage -> evaluations that failed there; an empty stage for those that did not."""
    counts: dict[str, int] = {}
    try:
        db = sqlite3.connect(f"{journal.absolute().as_uri()}?mode=ro", uri=True, timeout=10.0)
        try:
            counts[""] = int(db.execute("SELECT count(*) FROM evaluation WHERE status = 'ok'").fetchone()[0])
            for (text,) in db.execute("SELECT result FROM evaluation WHERE status <> 'ok'"):
                stage = str(json.loads(text).get("stage", "unknown"))
                counts[stage] = counts.get(stage, 0) + 1
        finally:
            db.close()
    except (sqlite3.Error, ValueError, TypeError, AttributeError, RecursionError) as error:
        raise FileError(f"{journal}: cannot be read ({error})") from None
    return counts


def _is_locked(directory: Path) -> bool:
    try:
        handle = os.open(directory / LOCK_NAME, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno in (errno.EAGAIN, errno.EACCES)  # others: a file system without locks
    finally:
        os.close(handle)
    return False
