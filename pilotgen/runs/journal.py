"""Every evaluation on disk as it finishes: crash-safe, and the cache of what was computed before.

One SQLite file (write-ahead log) per output directory. The key of an evaluation is the hash of everything that
determines its result, so a row can be served to any later run that asks the same question. Rows stand in the order in
which they came, with an index of the keys: keys are random, and rows sorted by them would be moved about for ever.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import sqlite3
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pilotgen.errors import FileError
from pilotgen.files import refuse_special, strict_json

JOURNAL_VERSION = 2  # 2: every row has a checksum
JOURNAL_NAME = "journal.sqlite"

_SCHEMA = """
CREATE TABLE meta (name TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE evaluation (
    key TEXT PRIMARY KEY,
    inputs TEXT NOT NULL,       -- JSON: name -> value in study units
    status TEXT NOT NULL,       -- ok | failed
    result TEXT NOT NULL,       -- JSON: the result object
    cpu_s REAL NOT NULL,        -- CPU time of the evaluation, children included
    checksum TEXT NOT NULL      -- of the five before it
);
"""


_to_json = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode  # of a result object


def evaluation_key(fingerprint: str, inputs: Mapping[str, float | str]) -> str:
    """Hash of everything that determines a result: the fingerprint of study, data, code and solver, and the inputs."""
    exact = {name: value if isinstance(value, str) else float(value).hex() for name, value in inputs.items()}
    text = json.dumps([fingerprint, sorted(exact.items())])
    return hashlib.sha256(text.encode()).hexdigest()


def _checksum(key: str, inputs: str, status: str, result: str, cpu_s: float) -> str:
    text = "\0".join((key, inputs, status, result, float(cpu_s).hex()))
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:32]


_COLUMNS = "key, inputs, status, result, cpu_s, checksum"


def _why_locked(path: Path) -> str:
    """SQLite says "locked" of a file system without locks as well; another file beside the journal tells."""
    with suppress(OSError), tempfile.TemporaryFile(dir=path.parent) as probe:
        try:
            fcntl.lockf(probe, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            return f"its file system does not lock files ({error.strerror}); choose an output directory on another one"
    return "the journal is in use by another run"


@dataclass(frozen=True)
class Record:
    """One evaluation as it stands in the journal."""

    key: str
    inputs: dict[str, float]
    status: str  # "ok" | "failed"
    result: dict[str, Any]
    cpu_s: float


def peek(path: Path) -> tuple[dict[str, str], int]:
    """What a journal says of its run, and how many evaluations it holds; it is not written to.

    Raises
    ------
    FileError
        It cannot be read.
    """
    refuse_special(path)
    try:
        db = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, timeout=10.0)
        try:
            meta = {str(name): str(value) for name, value in db.execute("SELECT name, value FROM meta")}
            return meta, int(db.execute("SELECT count(*) FROM evaluation").fetchone()[0])
        finally:
            db.close()
    except (sqlite3.Error, ValueError, TypeError) as error:
        raise FileError(f"{path}: cannot be read ({error}); a run would stop here") from None


class Journal:
    """The evaluations of one output directory.

    Opening creates the file. Every `add` is one transaction: what it returned from is safe against the death of this
    process. Raises FileError, in words, for a full disk, a read-only directory or a damaged file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        refuse_special(path)
        try:
            self._db = sqlite3.connect(path, isolation_level=None, timeout=30.0)
        except sqlite3.Error as error:
            raise self._explain(error) from None
        try:
            self._db.execute("PRAGMA journal_mode=WAL")
            self._db.execute("PRAGMA synchronous=NORMAL")
            self._open_schema()
        except (sqlite3.Error, TypeError, AttributeError) as error:  # a table of strange values
            self._db.close()
            raise self._explain(error) from None
        except FileError:
            self._db.close()
            raise

    def _open_schema(self) -> None:
        tables = {row[0] for row in self._db.execute("SELECT name FROM sqlite_master WHERE type='table'")}
        if not tables:
            with self._transaction():
                for statement in _SCHEMA.split(";"):
                    if statement.strip():
                        self._db.execute(statement)
                self._db.execute("INSERT INTO meta VALUES ('journal_version', ?)", (str(JOURNAL_VERSION),))
            return
        if not {"meta", "evaluation"} <= tables:
            raise FileError(
                f"{self.path}: is an SQLite file but not a pilotgen journal; choose another output directory"
            )
        columns = {table: {row[1] for row in self._db.execute(f"PRAGMA table_info({table})")} for table in tables}
        if not {"name", "value"} <= columns["meta"] or not set(_COLUMNS.split(", ")[:-1]) <= columns["evaluation"]:
            raise FileError(f"{self.path}: its tables lack columns; it is damaged, or no journal: move it aside")
        row = self._db.execute("SELECT value FROM meta WHERE name='journal_version'").fetchone()
        if row is not None and row[0] == "1" and "checksum" not in columns["evaluation"]:
            self._add_checksums()
            row = (str(JOURNAL_VERSION),)
        if row is None or row[0] != str(JOURNAL_VERSION):
            raise FileError(
                f"{self.path}: journal version {row[0] if row else 'unknown'}, this program writes version "
                f"{JOURNAL_VERSION}; "
                "choose another output directory"
            )
        check = self._db.execute("PRAGMA quick_check(1)").fetchone()
        if check is None or check[0] != "ok":
            raise sqlite3.DatabaseError(check[0] if check else "quick_check gave no answer")

    def _add_checksums(self) -> None:
        """Bring a journal of version 1 up to date."""
        with self._transaction():
            self._db.execute("ALTER TABLE evaluation ADD COLUMN checksum TEXT NOT NULL DEFAULT ''")
            rows = self._db.execute("SELECT key, inputs, status, result, cpu_s FROM evaluation").fetchall()
            self._db.executemany(
                "UPDATE evaluation SET checksum=? WHERE key=?", [(_checksum(*row), row[0]) for row in rows]
            )
            self._db.execute("UPDATE meta SET value=? WHERE name='journal_version'", (str(JOURNAL_VERSION),))

    def _transaction(self) -> _Transaction:
        return _Transaction(self._db)

    def _explain(self, error: Exception) -> FileError:
        text = str(error).lower()
        if "full" in text:
            what = "the disk is full; free some space and run again with --resume (nothing recorded so far is lost)"
        elif "i/o error" in text:
            what = (
                "the disk failed, or a quota or a limit on files is used up (disk I/O error); make room and run again "
                "with --resume (nothing recorded so far is lost)"
            )
        elif "readonly" in text or "read-only" in text:
            what = "the journal cannot be written (read-only); change its permissions or choose another directory"
        elif "unable to open" in text:
            what = "the journal cannot be opened; check that the directory exists and is writable"
        elif "malformed" in text or "not a database" in text or "corrupt" in text or "disk image" in text:
            what = (
                f"the journal is damaged ({error}); move it aside and run again without --resume, "
                f"or recover its rows with: sqlite3 {self.path} .recover"
            )
        elif "locked" in text or "busy" in text:
            what = _why_locked(self.path)
        else:
            what = f"the journal failed: {error}"
        return FileError(f"{self.path}: {what}")

    def get_meta(self, name: str) -> str | None:
        """A named text stored beside the evaluations, or None."""
        try:
            row = self._db.execute("SELECT value FROM meta WHERE name=?", (name,)).fetchone()
        except sqlite3.Error as error:
            raise self._explain(error) from None
        return None if row is None else str(row[0])

    def set_meta(self, name: str, value: str) -> None:
        """Store a named text beside the evaluations."""
        try:
            self._db.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (name, value))
        except sqlite3.Error as error:
            raise self._explain(error) from None

    def get(self, key: str) -> Record | None:
        """The evaluation with this key, or None."""
        try:
            row = self._db.execute(f"SELECT {_COLUMNS} FROM evaluation WHERE key=?", (key,)).fetchone()
        except sqlite3.Error as error:
            raise self._explain(error) from None
        return None if row is None else self._record(row)

    def add(self, record: Record) -> None:
        """Record one evaluation; safe on disk (against the death of this process) when this returns."""
        try:
            inputs, result = json.dumps(record.inputs), _to_json(record.result)
            row = (record.key, inputs, record.status, result, record.cpu_s)
            self._db.execute("INSERT OR REPLACE INTO evaluation VALUES (?, ?, ?, ?, ?, ?)", (*row, _checksum(*row)))
        except sqlite3.Error as error:
            raise self._explain(error) from None

    def forget(self, keys: Sequence[str]) -> None:
        """Take evaluations out, all or none."""
        try:
            with self._transaction():
                self._db.executemany("DELETE FROM evaluation WHERE key=?", [(key,) for key in keys])
        except sqlite3.Error as error:
            raise self._explain(error) from None

    def __iter__(self) -> Iterator[Record]:
        try:
            for row in self._db.execute(f"SELECT {_COLUMNS} FROM evaluation ORDER BY key"):
                yield self._record(row)
        except sqlite3.Error as error:
            raise self._explain(error) from None

    def __len__(self) -> int:
        try:
            return int(self._db.execute("SELECT count(*) FROM evaluation").fetchone()[0])
        except sqlite3.Error as error:
            raise self._explain(error) from None

    def _record(self, row: tuple[Any, ...]) -> Record:
        try:
            *found, checksum = row
            if [type(value) for value in found] != [str, str, str, str, float] or _checksum(*found) != checksum:
                raise ValueError("it does not have its checksum")
            key, inputs, status, result, cpu_s = found
            record = Record(key, strict_json(inputs), status, strict_json(result), cpu_s)
            if record.status not in ("ok", "failed") or record.result.get("status", status) != status:
                raise ValueError("its status is neither ok nor failed")
            return record
        except ValueError as error:
            raise FileError(
                f"{self.path}: evaluation {str(row[0])[:12]} is damaged ({error}); move the journal aside and run "
                "again with --resume: all pilots are evaluated again"
            ) from None

    def close(self) -> None:
        """Close the file; the write-ahead log is merged into it."""
        self._db.close()

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _Transaction:
    """BEGIN ... COMMIT, rolled back when the block raises."""

    def __init__(self, db: sqlite3.Connection) -> None:
        self._db = db

    def __enter__(self) -> None:
        self._db.execute("BEGIN")

    def __exit__(self, kind: object, *_: object) -> None:
        self._db.execute("COMMIT" if kind is None else "ROLLBACK")
