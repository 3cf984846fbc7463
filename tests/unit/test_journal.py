"""The journal keeps what it was given, whatever happens next."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from pilotgen.errors import FileError
from pilotgen.runs.journal import Journal, Record, evaluation_key


def _record(number: int) -> Record:
    return Record(f"{number:064d}", {"stature_m": 1.7 + number / 3.0}, "ok", {"gain": 0.1 * number}, 0.01)


def test_round_trip_is_exact(tmp_path: Path) -> None:
    records = [_record(i) for i in range(5)]
    with Journal(tmp_path / "j.sqlite") as journal:
        for record in records:
            journal.add(record)
        journal.set_meta("seed", "7")
    with Journal(tmp_path / "j.sqlite") as journal:
        assert list(journal) == records
        assert len(journal) == 5
        assert journal.get(records[3].key) == records[3]
        assert journal.get("nothing") is None
        assert journal.get_meta("seed") == "7"
        assert journal.get_meta("absent") is None


def test_key_depends_on_every_input_bit_and_not_on_order() -> None:
    a = evaluation_key("f", {"x": 0.1, "y": 0.2})
    assert a == evaluation_key("f", {"y": 0.2, "x": 0.1})
    assert a != evaluation_key("f", {"x": 0.1 + 1e-17 + 2e-17, "y": 0.2})
    assert a != evaluation_key("g", {"x": 0.1, "y": 0.2})
    assert a != evaluation_key("f", {"x": 0.2, "y": 0.1})


def test_rows_survive_sigkill(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    code = (
        "import sys; from pathlib import Path; from pilotgen.runs.journal import Journal, Record\n"
        "journal = Journal(Path(sys.argv[1]))\n"
        "i = 0\n"
        "while True:\n"
        "    journal.add(Record(f'{i:064d}', {'x': float(i)}, 'ok', {'r': i}, 0.0)); print(i, flush=True); i += 1\n"
    )
    child = subprocess.Popen([sys.executable, "-c", code, str(path)], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    acknowledged = -1
    while acknowledged < 200:
        acknowledged = int(child.stdout.readline())
    os.kill(child.pid, signal.SIGKILL)
    rest = child.stdout.read().split("\n")
    acknowledged = max([acknowledged] + [int(line) for line in rest[:-1] if line])
    child.wait()
    with Journal(path) as journal:
        assert [record.result["r"] for record in journal][: acknowledged + 1] == list(range(acknowledged + 1))


@pytest.mark.parametrize(
    "content", [b"this is not a database at all, not even close to one" * 40, b"SQLite format 3\x00" + b"\xff" * 4000]
)
def test_damaged_journal_is_explained(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "j.sqlite"
    path.write_bytes(content)
    with pytest.raises(FileError, match=r"j\.sqlite: .*(damaged|not a pilotgen journal)"):
        Journal(path)


def test_truncated_journal_is_explained(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    with Journal(path) as journal:
        for i in range(2000):
            journal.add(_record(i))
    size = path.stat().st_size
    with path.open("r+b") as file:
        file.truncate(size // 2 + 100)
    with pytest.raises(FileError, match="damaged"):
        list(Journal(path))


def test_strange_database_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    sqlite3.connect(path).execute("CREATE TABLE other (x)").connection.commit()
    with pytest.raises(FileError, match="not a pilotgen journal"):
        Journal(path)


def test_other_version_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    Journal(path).close()
    db = sqlite3.connect(path)
    db.execute("UPDATE meta SET value='99' WHERE name='journal_version'")
    db.commit()
    db.close()
    with pytest.raises(FileError, match="journal version 99"):
        Journal(path)


def test_missing_directory_is_explained(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="directory exists and is writable"):
        Journal(tmp_path / "none" / "j.sqlite")


def test_full_disk_is_explained_and_loses_nothing(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    journal = Journal(path)
    for i in range(10):
        journal.add(_record(i))
    pages = int(journal._db.execute("PRAGMA page_count").fetchone()[0])
    journal._db.execute(f"PRAGMA max_page_count={pages + 1}")
    with pytest.raises(FileError, match="the disk is full"):
        for i in range(10, 2000):
            journal.add(_record(i))
            kept = i
    journal.close()
    with Journal(path) as again:
        assert len(again) == kept + 1


def test_a_quota_is_told_as_one(tmp_path: Path) -> None:
    """SQLite says of a quota, and of a limit on the size of files, that the disk failed."""
    with Journal(tmp_path / "j.sqlite") as journal:
        told = str(journal._explain(sqlite3.OperationalError("disk I/O error")))
    assert "a quota or a limit on files is used up" in told and "--resume" in told
