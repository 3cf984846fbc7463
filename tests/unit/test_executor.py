"""Workers give every result once, in any number, and outlive the death of any of them."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest

from pilotgen.executor import ProcessWorkers, SerialWorkers, WorkerLost


def square(x: int) -> int:
    return x * x


def square_or_die(task: tuple[int, str]) -> int:
    """Die when the number is 3: once if a marker file can be made, for ever when the marker is empty."""
    number, marker = task
    if number == 3:
        if not marker:
            os.kill(os.getpid(), signal.SIGKILL)
        path = Path(marker)
        if not path.exists():
            path.touch()
            os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.002)
    return number * number


@pytest.mark.parametrize("workers", [SerialWorkers(), ProcessWorkers(1), ProcessWorkers(3)])
def test_every_result_once(workers: SerialWorkers | ProcessWorkers) -> None:
    for _ in range(2):
        results = dict(workers.run(square, list(range(20))))
        assert results == {i: i * i for i in range(20)}
    assert list(workers.run(square, [])) == []
    workers.close()


def test_a_murdered_worker_costs_nothing(tmp_path: Path) -> None:
    workers = ProcessWorkers(2)
    marker = str(tmp_path / "died")
    results = list(workers.run(square_or_die, [(i, marker) for i in range(12)]))
    workers.close()
    assert Path(marker).exists()
    assert sorted(results) == [(i, i * i) for i in range(12)]


def test_a_deadly_task_is_named_and_the_rest_finish() -> None:
    workers = ProcessWorkers(2)
    results = dict(workers.run(square_or_die, [(i, "") for i in range(12)]))
    workers.close()
    assert isinstance(results[3], WorkerLost)
    assert {i: r for i, r in results.items() if i != 3} == {i: i * i for i in range(12) if i != 3}


def raise_value_error(task: int) -> int:
    raise ValueError(f"task {task}")


def test_an_exception_of_the_task_is_the_callers() -> None:
    workers = ProcessWorkers(1)
    with pytest.raises(ValueError, match="task 0"):
        list(workers.run(raise_value_error, [0]))
    workers.close()
