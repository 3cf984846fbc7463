"""File systems without locks, and files that another process holds: told as what they are, and nothing loops.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import errno
import fcntl
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import pytest
from matrices_writer import write_matrices
from test_matrices import complete_matrices

from pilotgen.errors import FileError
from pilotgen.linear.compare import compare_files
from pilotgen.output import _locked
from pilotgen.runs.journal import Journal
from pilotgen.solver.scratch import ScratchDirectory


def fail(*_: Any) -> None:
    raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))


def test_output_directories(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with _locked(tmp_path), pytest.raises(FileError, match="in use by another run"), _locked(tmp_path):
        pass
    monkeypatch.setattr(fcntl, "flock", fail)
    with pytest.raises(FileError, match="does not lock files.*choose an output directory"), _locked(tmp_path):
        pass


def test_scratch_directories_do_without(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fcntl, "flock", fail)
    with_neighbour = ScratchDirectory(), ScratchDirectory()
    for scratch in with_neighbour:
        assert scratch.path.is_dir()
        scratch.close()
        assert not scratch.path.exists()


def test_journals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "journal.sqlite"
    holder = "import sqlite3, sys; d = sqlite3.connect(sys.argv[1], isolation_level=None);"
    holder += "d.execute('create table t (a)'); d.execute('begin exclusive');"
    holder += "print('held', flush=True); sys.stdin.read()"
    command = [sys.executable, "-c", holder, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "held\n"
        monkeypatch.setattr("sqlite3.connect", impatient())
        with pytest.raises(FileError, match="in use by another run"):
            Journal(path)
        monkeypatch.setattr(fcntl, "lockf", fail)
        with pytest.raises(FileError, match="does not lock files"):
            Journal(path)
        process.communicate("")


def impatient() -> Any:
    import sqlite3

    connect = sqlite3.connect

    def at_once(*arguments: Any, **options: Any) -> Any:
        return connect(*arguments, **{**options, "timeout": 0.0})

    return at_once


def test_matrices_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "held.h5"
    holder = "import h5py, sys; f = h5py.File(sys.argv[1], 'w'); f['a'] = 1; f.flush();"
    holder += "print('held', flush=True); sys.stdin.read()"
    command = [sys.executable, "-c", holder, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "held\n"
        with pytest.raises(FileError, match="another process has it open for writing"):
            compare_files(path, path)
        process.communicate("")

    opened = h5py.File

    def without_locks(name: str, mode: str = "r", **options: Any) -> h5py.File:
        if mode == "r" and options.get("locking") is not False:
            raise OSError("Unable to synchronously open file (unable to lock file, errno = 37, error message = '')")
        return opened(name, mode, **options)

    good = tmp_path / "good.h5"
    write_matrices(good, complete_matrices())
    monkeypatch.setattr(h5py, "File", without_locks)
    assert compare_files(good, good).agree
