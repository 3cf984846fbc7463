"""Scratch directories go with their process."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from pilotgen.errors import FileError
from pilotgen.solver.scratch import ScratchDirectory


def test_directory_is_there_until_closed() -> None:
    scratch = ScratchDirectory()
    (scratch.path / "file").write_text("x")
    other = ScratchDirectory()
    assert (scratch.path / "file").exists()  # the other one left it alone
    for directory in (scratch, other, scratch):
        directory.close()
    assert not scratch.path.exists()
    assert not other.path.exists()


def test_directory_of_a_killed_process_is_removed_by_the_next() -> None:
    code = (
        "import sys, time; from pilotgen.solver.scratch import ScratchDirectory\n"
        "scratch = ScratchDirectory(); (scratch.path / 'file').touch(); print(scratch.path, flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        path = Path(child.stdout.readline().strip())
        ScratchDirectory().close()
        assert (path / "file").exists()  # in use
        os.kill(child.pid, signal.SIGKILL)
        child.wait()
    assert path.exists()
    ScratchDirectory().close()
    assert not path.exists()


def test_forked_copy_leaves_it_alone() -> None:
    scratch = ScratchDirectory()
    pid = os.fork()
    if pid == 0:
        scratch.close()
        os._exit(0)
    os.waitpid(pid, 0)
    assert scratch.path.exists()
    scratch.close()


def test_a_directory_that_is_gone_emptied_or_full_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PILOTGEN_SCRATCH", str(tmp_path))
    scratch = ScratchDirectory()
    assert scratch.path.parent == tmp_path
    deck = scratch.path / "deck"
    deck.write_bytes(b"1234")
    scratch.check("deck", 4)
    with pytest.raises(FileError, match="removed or emptied"):
        scratch.check("deck", 5)
    deck.unlink()
    with pytest.raises(FileError, match="removed or emptied while it was in use; .* PILOTGEN_SCRATCH, .* --resume"):
        scratch.check("deck", 4)
    shutil.rmtree(scratch.path)
    with pytest.raises(FileError, match="removed or emptied"):
        scratch.check("deck", 4)
    scratch.path.mkdir()  # by somebody else
    deck.write_bytes(b"1234")
    with pytest.raises(FileError, match="removed or emptied"):
        scratch.check("deck", 4)
    scratch.close()
    monkeypatch.setenv("PILOTGEN_SCRATCH", str(tmp_path / "none"))
    with pytest.raises(FileError, match="PILOTGEN_SCRATCH: .*none is no directory"):
        ScratchDirectory()


def test_memory_that_is_nearly_full_is_left_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Full:
        f_bavail, f_frsize = 100, 4096

    monkeypatch.setattr("os.statvfs", lambda _: Full)
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(tmp_path))
    scratch = ScratchDirectory()
    assert scratch.path.parent == tmp_path
    scratch.close()
