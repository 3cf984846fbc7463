"""Workers: evaluate many pilots at once, and outlive any of them.

Work is handed to a `concurrent.futures.Executor`: processes on this machine, or a dask.distributed cluster. A task that
takes its worker down is tried again alone; one that does so repeatedly comes back as a `WorkerLost`, so that the
study goes
on. Results arrive as they finish; what they are does not depend on how many workers there are.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import multiprocessing
import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any, Protocol

# Set in every worker before numpy is imported there: pilots are small, parallelism is over pilots.
SINGLE_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS")

MAX_ATTEMPTS = (
    3  # a worker can die of an outside cause (out of memory, kill); three deaths on one pilot are no accident
)


def pin_threads() -> None:
    """Ask numerical libraries for one thread; only effective before they are imported."""
    for variable in SINGLE_THREAD_VARIABLES:
        os.environ[variable] = "1"


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
        self._executor: Executor | None = None

    def _start(self, count: int) -> ProcessPoolExecutor:
        context = multiprocessing.get_context("fork")  # cheap; this process has no threads of its own when it forks
        return ProcessPoolExecutor(count, mp_context=context, initializer=self._initializer)

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

    def close(self) -> None:
        """Stop the processes; they are waited for."""
        if self._executor is not None:
            self._executor.shutdown(wait=True, cancel_futures=True)
            self._executor = None
