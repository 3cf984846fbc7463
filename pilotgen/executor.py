"""Workers: evaluate many pilots at once, and outlive any of them.

Work is handed to a `concurrent.futures.Executor` of processes on this machine (`dask_workers` does the same on a
cluster). A task that takes its worker down is tried again alone; one that does so repeatedly comes back as a
`WorkerLost`, so that the study goes on. Results arrive as they finish; what they are does not depend on how many
workers there are. Workers do not outlive the process that started them, however it ends.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import ctypes
import multiprocessing
import multiprocessing.util
import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any, Protocol

# Set in every worker before numpy is imported there: pilots are small, parallelism is over pilots.
SINGLE_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS")

# A worker can die of an outside cause (out of memory, kill); three deaths on one pilot are no accident.
MAX_ATTEMPTS = 3

_PR_SET_PDEATHSIG = 1  # prctl(2)


def pin_threads() -> None:
    """Ask numerical libraries for one thread; only effective before they are imported."""
    for variable in SINGLE_THREAD_VARIABLES:
        os.environ[variable] = "1"


def stop_on_sigterm() -> None:
    """Have SIGTERM end this process as Ctrl-C does: what was recorded is kept, workers are stopped."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, interrupt)


def _settle(parent: int, initializer: Callable[[], None] | None) -> None:
    """Begin of a worker's life: it leaves Ctrl-C to its parent, and goes when told to or when the parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # solvers started here inherit this
    signal.signal(signal.SIGTERM, _leave)
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it died before the line above
        _leave()
    if initializer is not None:
        initializer()


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
    """Anything that runs `function(task)` for many tasks and yields (index, result) as they finish."""

    def run(self, function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[tuple[int, Any]]: ...

    def close(self) -> None: ...


class SerialWorkers:
    """No workers at all: everything in this process, in order."""

    def run(self, function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[tuple[int, Any]]:
        for index, task in enumerate(tasks):
            yield index, function(task)

    def close(self) -> None:
        """Nothing to close."""


class ProcessWorkers:
    """Processes on this machine.

    Parameters
    ----------
    count : int
        Number of processes.
    initializer : callable, optional
        Run once in every process before its first task.
    """

    def __init__(self, count: int, initializer: Callable[[], None] | None = None) -> None:
        self.count = count
        self._initializer = initializer
        self._executor: ProcessPoolExecutor | None = None

    def _start(self, count: int) -> ProcessPoolExecutor:
        context = multiprocessing.get_context("fork")  # cheap; this process has no threads of its own when it forks
        return ProcessPoolExecutor(
            count, mp_context=context, initializer=_settle, initargs=(os.getpid(), self._initializer)
        )

    def run(self, function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[tuple[int, Any]]:
        waiting = deque(range(len(tasks)))
        attempts = [0] * len(tasks)
        suspects: deque[int] = deque()
        while waiting or suspects:
            # Suspects (tasks in flight when a worker died) run one at a time, so that a death names its task.
            alone = not waiting
            queue = suspects if alone else waiting
            pending: dict[Future[Any], int] = {}
            try:
                while queue or pending:
                    if self._executor is None:
                        self._executor = self._start(self.count)
                    # Two tasks per worker in flight keep every worker busy; more would only widen the circle of
                    # suspects.
                    while queue and len(pending) < (1 if alone else 2 * self.count):
                        index = queue.popleft()
                        pending[self._executor.submit(function, tasks[index])] = index
                    done, _ = wait(pending, return_when=FIRST_COMPLETED)
                    for future in done:
                        index = pending[future]
                        result = future.result()
                        del pending[future]
                        yield index, result
            except BrokenProcessPool:
                self.close()
                for future, index in pending.items():
                    if future.done() and not future.cancelled() and future.exception() is None:
                        yield index, future.result()
                        continue
                    if alone:
                        attempts[index] += 1
                        if attempts[index] >= MAX_ATTEMPTS:
                            yield (
                                index,
                                WorkerLost(f"the worker died {MAX_ATTEMPTS} times while evaluating this pilot alone"),
                            )
                            continue
                    suspects.append(index)
            except BaseException:  # interrupted, or nobody wants the rest: what is in the works is not waited for
                self._stop()
                raise

    def _stop(self) -> None:
        """Stop the processes now, whatever they are doing."""
        if self._executor is not None:
            for process in list((self._executor._processes or {}).values()):
                process.terminate()
            self.close()

    def close(self) -> None:
        """Stop the processes; they are waited for."""
        if self._executor is not None:
            self._executor.shutdown(wait=True, cancel_futures=True)
            self._executor = None
