"""Workers give every result once, in any number, and outlive the death of any of them."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time
from pathlib import Path

import pytest
from serial_workers import SerialWorkers

from pilotgen.runs.executor import MAX_ATTEMPTS, ProcessWorkers, WorkerLost
from pilotgen.runs.memory import peak_bytes, peak_with_children_bytes, resident_bytes


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


def nap(task: int) -> tuple[int, int]:
    time.sleep(0.003)
    return task, os.getpid()


def test_workers_killed_at_any_moment_lose_nothing() -> None:
    workers = ProcessWorkers(3)
    answers: dict[int, int] = {}
    killed: set[int] = set()
    for index, (task, pid) in workers.run(nap, list(range(150))):
        assert index == task and index not in answers
        answers[index] = pid
        # Tasks that lost their worker come last; no more kills by then, or one could lose three and be given up.
        if index % 7 == 3 and pid not in killed and len(answers) < 100:
            killed.add(pid)
            os.kill(pid, signal.SIGKILL)  # at work on the next one by now, or waiting for it
    workers.close()
    assert sorted(answers) == list(range(150))
    assert len(killed) > 5


def test_workers_are_gone_when_nobody_wants_the_rest() -> None:
    workers = ProcessWorkers(2)
    run = workers.run(nap, list(range(100)))
    pids = {pid for _, (_, pid) in (next(run) for _ in range(10))}
    run.close()  # type: ignore[attr-defined]
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
    assert dict(workers.run(square, [1, 2, 3])) == {0: 1, 1: 4, 2: 9}
    workers.close()


def return_much(size: int) -> bytes:
    return b"x" * size


def test_large_tasks_and_results_pass() -> None:
    workers = ProcessWorkers(2)
    sizes = [5_000_000, 10, 3_000_000, 200_000] * 3
    assert {i: len(r) for i, r in workers.run(return_much, sizes)} == dict(enumerate(sizes))
    texts = ["y" * size for size in sizes]
    assert dict(workers.run(len, texts)) == dict(enumerate(sizes))
    workers.close()


class Odd(Exception):
    """Does not survive pickling."""

    def __init__(self, a: int, b: int) -> None:
        super().__init__(f"{a} and {b}")


def raise_odd(task: int) -> int:
    raise Odd(task, 2)


def test_an_exception_that_cannot_travel_is_told() -> None:
    workers = ProcessWorkers(1)
    with pytest.raises(RuntimeError, match="Odd: 1 and 2"):
        list(workers.run(raise_odd, [1]))
    workers.close()


def die_or_fail(task: str) -> None:
    if task == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    raise ValueError(task)


def wait_for(marker: str) -> int:
    """Until somebody makes the file; afterwards there is nothing to wait for."""
    deadline = time.monotonic() + 60.0
    while not Path(marker).exists():
        if time.monotonic() > deadline:
            os._exit(1)
        time.sleep(0.005)
    with open(f"{marker}.{os.getpid()}", "a", encoding="utf-8") as file:
        file.write("x")
    return os.getpid()


def test_warm_ups_are_not_waited_for_and_have_no_result(tmp_path: Path) -> None:
    workers, marker = ProcessWorkers(2), tmp_path / "go"
    workers.warm_up(wait_for, str(marker))
    marker.touch()  # had it been waited for, nobody would make this
    answers = dict(workers.run(wait_for, [str(marker), str(marker)]))
    workers.close()
    assert sorted(answers) == [0, 1]
    for pid in answers.values():  # each worker had finished its warm-up before it answered
        assert len((tmp_path / f"go.{pid}").read_text()) == 1 + list(answers.values()).count(pid)


@pytest.mark.parametrize("what", ["die", "fail"])
def test_what_happens_in_a_warm_up_does_not_count(what: str) -> None:
    workers = ProcessWorkers(2)
    workers.warm_up(die_or_fail, what)
    assert dict(workers.run(square, list(range(20)))) == {i: i * i for i in range(20)}
    workers.close()


def note_and_die(task: tuple[float, str]) -> None:
    delay, path = task
    time.sleep(delay)
    with open(path, "a", encoding="utf-8") as file:
        file.write("x")
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_death_in_the_warm_up_is_no_death_of_a_task(tmp_path: Path) -> None:
    workers = ProcessWorkers(1)
    workers.warm_up(note_and_die, (0.1, str(tmp_path / "warmed_up")))
    (lost,) = workers.run(note_and_die, [(0.0, str(tmp_path / "done"))])
    workers.close()
    assert isinstance(lost[1], WorkerLost)
    assert (tmp_path / "warmed_up").read_text() == "x"
    assert (tmp_path / "done").read_text() == MAX_ATTEMPTS * "x"


def test_workers_at_their_warm_up_take_large_tasks_and_can_be_stopped() -> None:
    workers = ProcessWorkers(2)
    workers.warm_up(time.sleep, 0.2)
    texts = ["y" * size for size in (5_000_000, 10, 3_000_000)]
    assert dict(workers.run(len, texts)) == {0: 5_000_000, 1: 10, 2: 3_000_000}
    workers.close()
    workers.warm_up(time.sleep, 60.0)
    pids = [worker.process.pid for worker in workers._workers]
    workers._stop()  # what an interrupted run does
    for pid in pids:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)  # type: ignore[arg-type]


def _slowly(task: tuple[str, float]) -> str:
    time.sleep(task[1])
    return task[0]


def test_a_stopped_worker_meets_the_time_limit() -> None:
    """Stopped by a signal it cannot answer, and is no reason to wait for ever: its task goes to another."""
    workers = ProcessWorkers(1, time_limit_s=0.4)
    try:
        answers = workers.run(_slowly, [("a", 0.0), ("b", 0.0), ("c", 0.3)])
        found = [next(answers), next(answers)]
        os.kill(workers._workers[0].process.pid, signal.SIGSTOP)
        begin = time.monotonic()
        found += list(answers)
        assert sorted(result for _, result in found) == ["a", "b", "c"]
        assert time.monotonic() - begin < 60.0
    finally:
        workers.close()


def _stop_myself(_: object) -> None:
    os.kill(os.getpid(), signal.SIGSTOP)


def test_a_task_that_stops_every_worker_is_lost_in_words() -> None:
    workers = ProcessWorkers(1, time_limit_s=0.2)
    try:
        ((index, lost),) = workers.run(_stop_myself, [None])
        assert index == 0 and isinstance(lost, WorkerLost)
        assert "stopped or stuck 3 times" in lost.reason and "time limit of 0.2 s" in lost.reason
    finally:
        workers.close()


def test_children_of_all_threads_are_weighed() -> None:
    def start() -> None:
        started.append(subprocess.Popen(["sleep", "30"]))

    started: list[subprocess.Popen[bytes]] = []
    before = peak_with_children_bytes(os.getpid())
    thread = threading.Thread(target=lambda: (start(), done.wait()))
    done = threading.Event()
    thread.start()
    try:
        while not started:
            time.sleep(0.01)
        assert peak_with_children_bytes(os.getpid()) - before >= peak_bytes(started[0].pid) > 0
    finally:
        done.set()
        thread.join()
        for process in started:
            process.kill()
            process.wait()


def test_the_largest_workers_memory_is_told() -> None:
    workers = ProcessWorkers(2)
    try:
        list(workers.run(square, [1, 2, 3, 4]))
        # A worker begins as a copy of this process.
        assert 5e6 < workers.memory_bytes() < resident_bytes(os.getpid()) + 1e8
    finally:
        workers.close()
    assert workers.memory_bytes() == 0
