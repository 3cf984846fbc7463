"""A run told to others: heartbeat, log, status.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest

from pilotgen.commands.status import told
from pilotgen.errors import FileError
from pilotgen.output import HEARTBEAT_NAME, STUDY_FILES, claimed
from pilotgen.runs.batch import Progress
from pilotgen.runs.journal import JOURNAL_NAME, Journal, Record
from pilotgen.runs.monitor import Course, Monitor, read_course, read_status

FAILED = {"status": "failed", "stage": "posture", "reason": "wrist", "values": {"bmi": 20.0}}


def lines_of(path: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_log_has_what_happens_one_object_a_line(tmp_path: Path) -> None:
    now = [0.0]
    said: list[str] = []
    monitor = Monitor(tmp_path, tmp_path / "log.jsonl", said.append, clock=lambda: now[0])
    progress = Progress(total=40, evaluated=1, smallest={"gain_margin_db": 6.4})
    monitor(progress, False)
    monitor(progress, False)  # too soon to be told again
    progress.failed, progress.last = 1, FAILED
    monitor(progress, True)
    monitor.say("a note")
    now[0] = 11.0
    monitor(progress, False)
    monitor.end("done")
    events = lines_of(tmp_path / "log.jsonl")
    assert [event["event"] for event in events] == ["progress", "failure", "progress", "note", "progress", "end"]
    assert events[1]["stage"] == "posture" and events[1]["values"] == {"bmi": 20.0}
    assert events[-1]["how"] == "done" and events[-1]["done"] == 1 and events[-1]["smallest"] == {"gain_margin_db": 6.4}
    assert said == ["a note"]
    beat = json.loads((tmp_path / HEARTBEAT_NAME).read_text())
    assert beat["seconds"] == 11.0 and beat["total"] == 40 and abs(beat["time"] - time.time()) < 60.0


def test_status_of_a_study(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="holds no study"):
        read_status(tmp_path)
    with claimed(tmp_path, "search", STUDY_FILES) as directory:
        with Journal(directory / JOURNAL_NAME) as journal:
            for k, result in enumerate([{"status": "ok"}, FAILED, {"status": "ok"}]):
                journal.add(Record(str(k), {}, result["status"], result, 0.1))
            now = [0.0]
            monitor = Monitor(directory, clock=lambda: now[0])
            now[0] = 10.0
            monitor(Progress(total=30, evaluated=20, generation=1, generations=3), True)
            status = read_status(directory)  # while the journal is open
        assert (status.kind, status.state, status.evaluations, status.failed) == ("search", "running", 3, 1)
        assert status.failed_by_stage == {"posture": 1}
        assert status.rate_per_s == 2.0 and status.left_s == 5.0
        text = told(status)
        assert "search running" in text and "1 at posture" in text
        assert "generation 2 of 3" in text and "2.0 evaluations per second, at most 0:05 left" in text
        json.dumps(status.to_dict(), allow_nan=False)
    assert read_status(tmp_path).state == "finished"
    with pytest.raises(RuntimeError), claimed(tmp_path, "search", STUDY_FILES, resume=True):
        raise RuntimeError
    assert "search interrupted; go on with --resume" in told(read_status(tmp_path))


def test_a_file_that_is_no_log_is_not_spoilt(tmp_path: Path) -> None:
    for text in ("study: quick\n", "[1, 2]\n", "3\n", '{"a": 1}\n', "\0\xff"):
        (tmp_path / "file").write_text(text)
        with pytest.raises(FileError, match="is not the log of a run"):
            Monitor(tmp_path, tmp_path / "file")
        assert (tmp_path / "file").read_text() == text
    (tmp_path / "file").write_text('{"time": "2026-01-01", "event": "start"}\n')
    Monitor(tmp_path, tmp_path / "file").end("done")
    (tmp_path / "empty").touch()
    Monitor(tmp_path, tmp_path / "empty").end("done")


def test_a_log_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="the log cannot be written"):
        Monitor(tmp_path, tmp_path / "none" / "log.jsonl")
    monitor = Monitor(tmp_path, Path("/dev/full"))
    with pytest.raises(FileError, match="/dev/full: the log cannot be written"):
        monitor.event("start")


def test_course_of_runs_that_went_on(tmp_path: Path) -> None:
    assert read_course(tmp_path) is None
    now = [0.0]
    for k, (workers, memory) in enumerate(((2, 90), (0, 0), (1, 40)), start=1):
        monitor = Monitor(tmp_path, clock=lambda: now[0])
        now[0] += 10.0
        monitor(Progress(30, evaluated=5, cpu_s=1.0, workers=workers, worker_memory_bytes=memory), False)
        assert read_course(tmp_path) == Course(k, workers, 5 * k, 10.0 * k, float(k), 90)


@pytest.mark.parametrize(
    "damage",
    [{"earlier": 3}, {"earlier": {"runs": "two"}}, {"earlier": {"seconds": -1}}, {"cpu_s": None}, {"workers": [2]},
     {"seconds": 1e300}, {"worker_memory_bytes": "much"}],
)  # fmt: skip
def test_a_heartbeat_that_somebody_wrote_to_is_none(tmp_path: Path, damage: dict[str, object]) -> None:
    monitor = Monitor(tmp_path)
    monitor(Progress(30, evaluated=5), False)
    path = tmp_path / HEARTBEAT_NAME
    good = json.loads(path.read_text())
    path.write_text(json.dumps({**good, **damage}))
    assert read_course(tmp_path) is None
    path.write_text(json.dumps({key: value for key, value in good.items() if key not in ("earlier", "workers")}))
    assert read_course(tmp_path) == Course(1, 0, 5, pytest.approx(good["seconds"]), 0.0, 0)  # of an older version
