"""Workers: evaluate many pilots at once, and outlive any of them.

Work is handed to processes on this machine (`dask_workers` does the same on a cluster), each with a pipe of its own.
There are no threads, and no lock that a killed process could take with it: whatever dies, the rest goes on. A task that
takes its worker down is tried again; one that does so repeatedly comes back as a `WorkerLost`. Results arrive as they
finish; what they are does not depend on how many workers there are. Workers do not outlive the process that started
them, however it ends.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import ctypes
import multiprocessing
import multiprocessing.util
import os
import pickle
import select
import signal
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, Protocol

from pilotgen.runs.memory import peak_with_children_bytes

# Set in every worker before numpy is imported there: pilots are small, parallelism is over pilots.
SINGLE_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS")

# A worker can die of an outside cause (out of memory, kill); three deaths on one pilot are no accident.
MAX_ATTEMPTS = 3

# A worker has one task at work and one waiting in its pipe. The waiting one must fit into the pipe, or both sides could
# wait for each other to read.
_IN_FLIGHT = 2
_FITS_A_PIPE_BYTES = 16384

_WARMED_UP = b""  # what a worker sends when its warm-up is over; answers are never empty

# A pilot is at most four calls of the solver, each within its time limit; what comes on top is Python.
_CALLS, _OWN_TIME_S = 4, 30.0
_LOOK_EVERY_S = 1.0  # at workers that do not answer

_PATIENCE_S = 5.0  # of those who end workers, before they kill
_PR_SET_PDEATHSIG = 1  # prctl(2)


def pin_threads() -> None:
    """Ask numerical libraries for one thread; only effective before they are imported."""
    for variable in SINGLE_THREAD_VARIABLES:
        os.environ[variable] = "1"


@contextmanager
def _signals_wait() -> Iterator[None]:
    """Signals that interrupt come after the block, not in it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _work(pipe: Connection, not_ours: list[Connection], parent: int, warm_up: WarmUp | None) -> None:
    """A worker's life: it leaves Ctrl-C to its parent, and goes when told to or when the parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # solvers started here inherit this
    signal.signal(signal.SIGTERM, _leave)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_SETMASK, set())
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it died before the line above
        _leave()
    for other in not_ours:  # inherited; a pipe ends when its last holder is gone
        other.close()
    try:
        if warm_up is not None:
            _warm_up(*warm_up)
            pipe.send_bytes(_WARMED_UP)
        _serve(pipe)
    except (EOFError, OSError):  # the parent wants no more
        return


def _serve(pipe: Connection) -> None:
    while True:
        message = pipe.recv_bytes()
        index, function, task = pickle.loads(message)
        try:
            answer = pickle.dumps((index, True, function(task)))
        except Exception as error:  # the caller's business
            answer = _as_message(index, error)
        pipe.send_bytes(answer)


def _warm_up(function: Callable[[Any], Any], task: Any) -> None:
    # What is wrong with this task is nobody's business; what is wrong with all tasks, the first one will tell.
    with suppress(Exception):
        function(task)


def _as_message(index: int, error: Exception) -> bytes:
    try:
        message = pickle.dumps((index, False, error))
        pickle.loads(message)
    except Exception:  # not every exception survives the way
        return pickle.dumps((index, False, RuntimeError(f"{type(error).__name__}: {error}")))
    return message


def _leave(*_: object) -> None:
    """Clean up (stop the solver, remove the scratch directory) and end."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        multiprocessing.util._run_finalizers(0)  # type: ignore[attr-defined]  # what an orderly end of a worker runs
    finally:
        os._exit(0)


@dataclass(frozen=True)
class WorkerLost:
    """A task whose worker died on every attempt."""

    reason: str


class Workers(Protocol):
    """Anything that runs `function(task)` for many tasks and yields (index, result) as they finish.

    A warm-up is a task without an answer, which those who have processes of their own may give them to warm up.
    """

    def warm_up(self, function: Callable[[Any], Any], task: Any) -> None:
        """Have every worker start and do this task once; its result goes nowhere."""

    def run(self, function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[tuple[int, Any]]:
        """Yield (index of the task, result or WorkerLost) as they finish."""

    def memory_bytes(self) -> int:
        """Largest memory that one worker and its solver had so far; 0 if unknown."""

    def close(self) -> None:
        """End all workers."""


WarmUp = tuple[Callable[[Any], Any], Any]  # a function and a task


@dataclass
class _Worker:
    """One process, our end of its pipe, and the tasks it was given and has not answered, in order."""

    process: BaseProcess
    pipe: Connection
    given: deque[int]
    warming_up: bool  # not yet at the first of these
    busy_s: float = 0.0  # since it was given what it is at
    stopped_s: float = 0.0  # of these, without running at all: stopped by a signal or a debugger
    ended_by_us: bool = False


class ProcessWorkers:
    """Processes on this machine.

    Parameters
    ----------
    count : int
        Number of processes.
    time_limit_s : float, optional
        Of one call of the solver. A worker that is stopped for so long, or that is at one task for longer than a
        pilot's calls may take, is killed, and its task is tried again. Without a limit nobody is.
    """

    def __init__(self, count: int, time_limit_s: float | None = None) -> None:
        self.count = count
        self._limit_s = time_limit_s
        self._looked = time.monotonic()
        self._workers: list[_Worker] = []
        self._poll = select.poll()  # of their pipes

    def warm_up(self, function: Callable[[Any], Any], task: Any) -> None:
        """Start the processes, each with `function(task)`, and do not wait: they are at it while we get ready."""
        while len(self._workers) < self.count:
            self._start((function, task))

    def run(self, function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[tuple[int, Any]]:
        """Yield (index, result) as they finish; an exception of a task is raised here."""
        waiting = deque(range(len(tasks)))
        deaths = [0] * len(tasks)
        try:
            while waiting or any(worker.given for worker in self._workers):
                while len(self._workers) < min(self.count, len(tasks)):
                    self._start()
                self._hand_out(function, tasks, waiting)
                for worker in self._ready():
                    try:
                        message = worker.pipe.recv_bytes()
                    except (EOFError, OSError):  # what it had sent was read before
                        lost = self._handle_death(worker, waiting, deaths)
                        if lost is not None:
                            yield lost
                        continue
                    if message == _WARMED_UP:
                        worker.warming_up = False
                        continue
                    worker.busy_s = worker.stopped_s = 0.0
                    index, succeeded, result = pickle.loads(message)
                    worker.given.remove(index)
                    if not succeeded:
                        raise result
                    yield index, result
        except BaseException:  # interrupted, or nobody wants the rest: what is in the works is not waited for
            self._stop()
            raise

    def memory_bytes(self) -> int:
        """Largest memory that one worker and its solver had so far."""
        return max((peak_with_children_bytes(worker.process.pid) for worker in self._workers), default=0)

    def close(self) -> None:
        """Have the processes end when they have done what they have; they are waited for."""
        for worker in self._workers:
            worker.pipe.close()
        self._wait_for_ends()

    def _stop(self) -> None:
        """Stop the processes now, whatever they are doing."""
        with _signals_wait():
            for worker in self._workers:
                worker.process.terminate()
                worker.pipe.close()
            self._wait_for_ends()

    def _start(self, warm_up: WarmUp | None = None) -> None:
        context = multiprocessing.get_context("fork")  # cheap; this process has no threads of its own
        ours, theirs = context.Pipe()
        not_ours = [ours, *(worker.pipe for worker in self._workers)]
        process = context.Process(
            target=_work, args=(theirs, not_ours, os.getpid(), warm_up), daemon=True, name="pilotgen worker"
        )
        with _signals_wait():
            process.start()
            self._workers.append(_Worker(process, ours, deque(), warm_up is not None))
            self._poll.register(ours, select.POLLIN)
        theirs.close()

    def _hand_out(self, function: Callable[[Any], Any], tasks: Sequence[Any], waiting: deque[int]) -> None:
        for depth in range(_IN_FLIGHT):
            for worker in self._workers:
                if not waiting or len(worker.given) > depth:
                    continue
                message = pickle.dumps((waiting[0], function, tasks[waiting[0]]))
                if (worker.given or worker.warming_up) and len(message) > _FITS_A_PIPE_BYTES:
                    continue
                with suppress(OSError):  # it died: `_ready` finds out
                    worker.given.append(waiting.popleft())
                    worker.pipe.send_bytes(message)

    def _ready(self) -> list[_Worker]:
        """Workers that have answered or died, at least one."""
        every_s = _LOOK_EVERY_S if self._limit_s is None else min(_LOOK_EVERY_S, 0.5 * self._limit_s)
        while True:
            events = dict(self._poll.poll(None if self._limit_s is None else 1000.0 * every_s))
            if self._limit_s is not None:
                self._look(every_s)
            if events:
                return [worker for worker in self._workers if worker.pipe.fileno() in events]

    def _look(self, every_s: float) -> None:
        """Kill workers that are beyond their time. Time in which we were stopped ourselves does not count."""
        assert self._limit_s is not None
        now = time.monotonic()
        passed = now - self._looked
        if passed < every_s:
            return
        self._looked = now
        for worker in self._workers:
            if not (worker.given or worker.warming_up):
                continue
            worker.busy_s += min(passed, 2.0 * every_s)
            worker.stopped_s = worker.stopped_s + min(passed, 2.0 * every_s) if is_stopped(worker.process.pid) else 0.0
            if worker.stopped_s > self._limit_s or worker.busy_s > _CALLS * self._limit_s + _OWN_TIME_S:
                worker.ended_by_us = True
                worker.process.kill()  # its end of the pipe tells

    def _handle_death(self, worker: _Worker, waiting: deque[int], deaths: list[int]) -> tuple[int, WorkerLost] | None:
        """Forget a dead worker. The task it was at comes last, or back as lost; the one behind it is not suspected."""
        self._workers.remove(worker)
        self._poll.unregister(worker.pipe)
        worker.pipe.close()
        _end(worker.process)
        if worker.warming_up:  # none of its tasks was begun
            waiting.extendleft(reversed(worker.given))
            return None
        if not worker.given:
            return None
        at_work, *behind = worker.given
        waiting.extendleft(reversed(behind))
        deaths[at_work] += 1
        if deaths[at_work] < MAX_ATTEMPTS:
            waiting.append(at_work)
            return None
        if worker.ended_by_us:
            return at_work, WorkerLost(
                f"the worker was stopped or stuck {MAX_ATTEMPTS} times while evaluating this pilot, beyond a time "
                f"limit of {self._limit_s:g} s for a solver call, and was ended"
            )
        return at_work, WorkerLost(f"the worker died {MAX_ATTEMPTS} times while evaluating this pilot")

    def _wait_for_ends(self) -> None:
        for worker in self._workers:
            _end(worker.process)
        self._workers.clear()
        self._poll = select.poll()


def is_stopped(pid: int | None) -> bool:
    """Whether a process is stopped (SIGSTOP, SIGTSTP, a debugger)."""
    try:
        with open(f"/proc/{pid}/stat", encoding="utf-8", errors="replace") as file:
            return file.read().rpartition(")")[2].split()[0] in ("T", "t")
    except (OSError, IndexError):
        return False


def _end(process: BaseProcess) -> None:
    """Wait for a process that has been told to end, not for ever."""
    process.join(_PATIENCE_S)
    if process.is_alive():
        process.kill()
        process.join()
    process.close()
