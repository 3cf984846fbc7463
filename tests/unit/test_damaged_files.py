"""Files that were damaged, swapped or made to mislead: told in one sentence, never believed, never waited for.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from command_line import MAYO, Run, changed, refused
from study_maker import mayo_study, write_study

from pilotgen.errors import FileError
from pilotgen.files import write_text
from pilotgen.hdf5 import open_to_read
from pilotgen.runs.journal import JOURNAL_NAME, Journal, Record
from pilotgen.runs.results import read_results

RESULT = {"status": "ok", "loop": {"gain_margin_db": 10.68}}


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    """A journal of three evaluations."""
    path = tmp_path / JOURNAL_NAME
    with Journal(path) as made:
        for k in "abc":
            made.add(Record(k, {"x": 1.0}, "ok", RESULT, 0.1))
    return path


def change(path: Path, *statements: str) -> None:
    """Run SQL on a journal behind the program's back."""
    with sqlite3.connect(path) as db:
        for statement in statements:
            db.execute(statement)
    db.close()


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE evaluation SET result = replace(result, '10.68', '10.99') WHERE key = 'b'",
        "UPDATE evaluation SET result = replace(result, '10.68', 'NaN') WHERE key = 'b'",
        "UPDATE evaluation SET result = 5 WHERE key = 'b'",
        "UPDATE evaluation SET result = x'00ff' WHERE key = 'b'",
        "UPDATE evaluation SET result = cast(x'fffe' AS TEXT) WHERE key = 'b'",
        "UPDATE evaluation SET inputs = '[]' WHERE key = 'b'",
        "UPDATE evaluation SET status = 'fine' WHERE key = 'b'",
        "UPDATE evaluation SET cpu_s = 'x' WHERE key = 'b'",
        "UPDATE evaluation SET checksum = '' WHERE key = 'b'",
    ],
)
def test_an_evaluation_that_was_changed_is_not_served(journal: Path, statement: str) -> None:
    change(journal, statement)
    with Journal(journal) as opened:
        assert opened.get("a") is not None
        with pytest.raises(FileError, match=r"journal\.sqlite: (evaluation b is damaged|the journal)"):
            opened.get("b")


def test_results_that_are_no_results_are_refused_even_with_their_checksum(journal: Path) -> None:
    from pilotgen.runs import journal as module

    for result in ('{"status":"ok","loop":{"gain_margin_db":NaN}}', "[1]", '{"status":"failed"}', "[" * 100_000):
        row = ("d", "{}", "ok", result, 0.1)
        with sqlite3.connect(journal) as db:
            db.execute("INSERT OR REPLACE INTO evaluation VALUES (?,?,?,?,?,?)", (*row, module._checksum(*row)))
        db.close()
        with Journal(journal) as opened, pytest.raises(FileError, match="evaluation d is damaged"):
            opened.get("d")


@pytest.mark.parametrize(
    "statements",
    [
        ("DROP TABLE evaluation",),
        ("DROP TABLE evaluation", "CREATE TABLE evaluation (a INT)"),
        ("DROP TABLE meta", "CREATE TABLE meta (a INT)"),
        ("UPDATE meta SET value = x'00'",),
        ("DELETE FROM meta",),
    ],
)
def test_a_journal_with_other_tables_is_refused(journal: Path, statements: tuple[str, ...]) -> None:
    change(journal, *statements)
    with pytest.raises(FileError, match=r"journal\.sqlite: "):
        Journal(journal)


def test_a_journal_of_version_1_is_brought_up_to_date(journal: Path) -> None:
    change(
        journal,
        "CREATE TABLE old (key TEXT PRIMARY KEY, inputs TEXT, status TEXT, result TEXT, cpu_s REAL)",
        "INSERT INTO old SELECT key, inputs, status, result, cpu_s FROM evaluation",
        "DROP TABLE evaluation",
        "ALTER TABLE old RENAME TO evaluation",
        "UPDATE meta SET value = '1' WHERE name = 'journal_version'",
    )
    with Journal(journal) as opened:
        assert opened.get("b") == Record("b", {"x": 1.0}, "ok", RESULT, 0.1)
        assert opened.get_meta("journal_version") == "2"


Damage = Callable[[h5py.File], None]


def _replaced(name: str, value: object) -> Damage:
    def damage(file: h5py.File) -> None:
        del file[name]
        file[name] = value

    return damage


def _huge(file: h5py.File) -> None:
    del file["evaluations/gain_margin_db"]
    file.create_dataset("evaluations/gain_margin_db", shape=(10**11,), dtype="f8", chunks=(1000,))


def _shifted(file: h5py.File) -> None:
    file["evaluations/gain_margin_db"][3] += 0.31


@pytest.mark.parametrize(
    ("damage", "told"),
    [
        (_replaced("evaluations/rank", h5py.ExternalLink("/etc/passwd", "/x")), "is a link to elsewhere"),
        (_replaced("evaluations/rank", h5py.SoftLink("/evaluations/stable")), "is a link to elsewhere"),
        (_huge, "is said to have 800000000000 bytes"),
        (_shifted, "does not have its checksum"),
        (lambda file: file["evaluations"].__delitem__("rank"), "does not have its checksum"),
        (lambda file: file["evaluations"].__setitem__("more", np.zeros(24)), "does not have its checksum"),
        (lambda file: file["evaluations/reason"].__setitem__(3, "else"), "does not have its checksum"),
        (lambda file: file["variables/lower"].__setitem__(0, 2.6), "does not have its checksum"),
        (lambda file: file["population/members"].__setitem__((0, 0), 1), "does not have its checksum"),
        (lambda file: file.attrs.__setitem__("seed", 6), "does not have its checksum"),
        (lambda file: file.attrs.__delitem__("checksum"), "a part is missing"),
        (_replaced("evaluations/status", 5), "of the wrong kind or damaged"),
        (_replaced("evaluations", np.zeros(3)), "of the wrong kind or damaged"),
    ],
)
def test_a_study_that_was_damaged_is_told(tmp_path: Path, damage: Damage, told: str) -> None:
    write_study(tmp_path, mayo_study())
    with h5py.File(tmp_path / "study.h5", "a") as file:
        damage(file)
    with pytest.raises(FileError, match=told):
        read_results(tmp_path / "study.h5")


def test_a_flipped_bit_of_a_number_is_found(tmp_path: Path) -> None:
    results = write_study(tmp_path, mayo_study())
    path = tmp_path / "study.h5"
    data = bytearray(path.read_bytes())
    place = bytes(data).index(results.columns["gain_margin_db"].tobytes())
    data[place + 6] ^= 1
    path.write_bytes(data)
    with pytest.raises(FileError, match="damaged"):
        read_results(path)


def test_pipes_and_devices_are_not_waited_for(run: Run, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.h5"
    os.mkfifo(pipe)
    with pytest.raises(FileError, match=r"pipe\.h5 is a pipe; a regular file is wanted"):
        open_to_read(str(pipe))
    refused(run("compare", pipe, pipe), "is a pipe")
    refused(run("table", pipe), "is a pipe")
    for name in ("loop.json", "loop.mat", "deck.mbd", "m.m", "n.nc"):
        os.mkfifo(tmp_path / name)
    refused(run("margins", tmp_path / "loop.json"), "is a pipe")
    refused(run("margins", tmp_path / "loop.mat"), "is a pipe")
    refused(run("compare", tmp_path / "m.m", tmp_path / "m.m"), "is a pipe")
    refused(run("compare", tmp_path / "n.nc", tmp_path / "n.nc"), "is a pipe")
    refused(run("check-mbdyn", tmp_path / "deck.mbd"), "is a pipe")
    os.mkfifo(tmp_path / "text.part")
    with pytest.raises(FileError, match="in the way and no regular file"):
        write_text(tmp_path / "text", "x")
    (tmp_path / "study").mkdir()
    os.mkfifo(tmp_path / "study" / JOURNAL_NAME)
    refused(run("status", tmp_path / "study"), "is a pipe")
    people = changed(tmp_path, "study: puma-mayo", f"study: x  # {MAYO}", MAYO)
    refused(run("search", people, "-o", tmp_path / "o", "--log", tmp_path / "text.part"), "log cannot be written")
    shutil.rmtree(tmp_path / "study")


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"time": "x"}', '{"time": 1e999, "done": 1, "total": 2}', "[" * 100_000, "\x00"]
)
def test_a_heartbeat_or_mark_that_is_none_is_no_fault_of_ours(run: Run, tmp_path: Path, text: str) -> None:
    out = tmp_path / "out"
    assert run("sample", MAYO, "-n", "2", "-o", out, "--workers", "1", "--quiet")[0] == 0
    (out / ".heartbeat.json").write_text(text)
    code, told, err = run("status", out)
    assert (code, err) == (0, "") and "2 evaluations recorded" in told
    assert run("status", out, "--json")[0] == 0
    (out / ".pilotgen.json").write_text(text)
    refused(run("status", out), r"\.pilotgen\.json: (cannot be read|is damaged|not the mark)")


def test_a_pilot_model_whose_numbers_were_changed_is_refused(run: Run, tmp_path: Path) -> None:
    assert run("pilot", MAYO, "-o", tmp_path / "pilot", "--no-figures")[0] == 0
    path = tmp_path / "pilot" / "pilot_model.h5"
    sound = path.read_bytes()
    with h5py.File(path) as file:
        poles = file["poles"][()].tobytes()
    place = sound.index(poles[:8])
    path.write_bytes(sound[: place + 6] + bytes([sound[place + 6] ^ 1]) + sound[place + 7 :])
    export = ("export", tmp_path / "pilot", "-o", tmp_path / "out.json")
    refused(run(*export), "is damaged: it does not have the checksum")
    path.write_bytes(sound)
    with h5py.File(path, "a") as file:
        file.attrs["lever_length_m"] = 5.0
    refused(run(*export), "is damaged: it does not have the checksum")
    path.write_bytes(sound)
    assert run(*export)[0] == 0
