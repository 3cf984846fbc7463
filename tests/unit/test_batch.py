"""A batch evaluates each pilot once, records it, and serves it again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from serial_workers import SerialWorkers

from pilotgen.errors import FileError
from pilotgen.runs.batch import MOST_IN_A_ROW, Batch, TooManyFailures, failures_by_reason
from pilotgen.runs.executor import ProcessWorkers
from pilotgen.runs.journal import Journal


def evaluate(task: dict[str, float]) -> tuple[dict[str, Any], float]:
    """Fail above 2 m."""
    x = task["stature_m"]
    if x > 2.0:
        return {
            "status": "failed",
            "stage": "posture",
            "reason": f"elbow at {100 * x:.1f} deg, limit 150 deg",
            "values": task,
        }, 0.01
    return {"status": "ok", "loop": {"gain_margin_db": 2.0 * x}}, 0.01


def _batch(journal: Journal, **options: Any) -> Batch:
    return Batch(journal, SerialWorkers(), evaluate, dict, "fingerprint", **options)


def test_each_pilot_once_and_in_order(tmp_path: Path) -> None:
    pilots = [{"stature_m": x} for x in (1.6, 1.7, 1.6, 2.1)]
    with Journal(tmp_path / "j.sqlite") as journal:
        batch = _batch(journal)
        results = batch.evaluate(pilots)
        assert [r["status"] for r in results] == ["ok", "ok", "ok", "failed"]
        assert results[0]["loop"]["gain_margin_db"] == 3.2
        assert (batch.progress.evaluated, batch.progress.served, batch.progress.failed) == (3, 0, 1)
        again = _batch(journal)
        assert again.evaluate(pilots) == results
        assert (again.progress.evaluated, again.progress.served, again.progress.failed) == (0, 3, 1)
        other = Batch(journal, SerialWorkers(), evaluate, dict, "another fingerprint")
        other.evaluate(pilots[:1])
        assert other.progress.evaluated == 1
        retry = _batch(journal, retry_failed=True)
        retry.evaluate(pilots)
        assert (retry.progress.evaluated, retry.progress.served) == (1, 2)


def test_workers_in_other_processes_give_the_same(tmp_path: Path) -> None:
    pilots = [{"stature_m": 1.5 + 0.01 * i} for i in range(30)]
    answers = []
    for count in (1, 2):
        workers = ProcessWorkers(count)
        with Journal(tmp_path / f"j{count}.sqlite") as journal:
            answers.append(Batch(journal, workers, evaluate, dict, "f").evaluate(pilots))
        workers.close()
    assert answers[0] == answers[1]


def test_too_many_failures_stop_a_hopeless_study(tmp_path: Path) -> None:
    pilots = [{"stature_m": 2.1 + 0.01 * i} for i in range(10)]
    with Journal(tmp_path / "j.sqlite") as journal:
        with pytest.raises(
            TooManyFailures, match="3 pilots failed, more than --max-failures 2; the last: posture: elbow"
        ):
            _batch(journal, max_failures=2).evaluate(pilots)
        assert len(journal) == 3  # what was done is kept


def test_failures_are_grouped_by_reason() -> None:
    results = [evaluate({"stature_m": x})[0] for x in (1.7, 2.1, 2.2)]
    results.append({"status": "failed", "stage": "solver", "reason": "mbdae died", "values": {}})
    groups = failures_by_reason(results)
    assert [(stage, count) for stage, _, count, _ in groups] == [("posture", 2), ("solver", 1)]


def test_workers_warm_up_when_the_journal_is_empty_only(tmp_path: Path) -> None:
    warmed_up: list[Any] = []

    class Players(SerialWorkers):
        def warm_up(self, function: Callable[[Any], Any], task: Any) -> None:
            warmed_up.append((function, task))

    with Journal(tmp_path / "j.sqlite") as journal:
        batch = Batch(journal, Players(), evaluate, lambda values: {"stature_m": 1.8, **values}, "fingerprint")
        batch.warm_up()
        assert warmed_up == [(evaluate, {"stature_m": 1.8})]
        assert batch.progress.done == len(journal) == 0
        batch.evaluate([{"stature_m": 1.7}])
        batch.warm_up()
    assert len(warmed_up) == 1


def test_failures_in_a_row_that_are_no_pilots_own_stop_the_run_and_are_forgotten(tmp_path: Path) -> None:
    """A solver that dies with everybody is the machine's fault; one that dies with some is theirs."""
    dead = {"status": "failed", "stage": "solver", "reason": "mbdae died with signal SIGKILL on pilot.mbd"}

    def dies(task: dict[str, float]) -> tuple[dict[str, Any], float]:
        x = task["x"]
        return (dead if x < 20 and x % 3 else evaluate({"stature_m": 1.8})[0] if x < 20 else dead), 0.0

    with Journal(tmp_path / "j.sqlite") as journal:
        batch = Batch(journal, SerialWorkers(), dies, dict, "fingerprint")
        with pytest.raises(FileError, match=f"{MOST_IN_A_ROW} pilots in a row failed by .*SIGKILL"):
            batch.evaluate([{"x": float(x)} for x in range(100)])
        assert len(journal) == 19, "0 to 18 are recorded; 19 is the first of the row"


def test_a_full_machine_is_no_pilots_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    """What Python says of memory, disk and processes stops a run; a fault of ours is one pilot's failure."""
    import pickle

    from study_maker import mayo_study

    from pilotgen.runs import task

    study = mayo_study()
    one = task.Task(pickle.dumps(study), dict(study.nominal))
    for error, told in (
        (MemoryError(), "out of memory"),
        (ImportError("libfoo.so: failed to map segment from shared object"), "out of memory"),
        (OSError(24, "Too many open files", "/dev/null"), "/dev/null: Too many open files"),
    ):
        monkeypatch.setattr(task, "evaluate", lambda *_, error=error: (_ for _ in ()).throw(error))
        with pytest.raises(FileError, match=f"{told}.*nothing that was at work is recorded"):
            task.run_task(one)
    monkeypatch.setattr(task, "evaluate", lambda *_: {}["x"])
    assert task.run_task(one)[0]["stage"] == "internal"
