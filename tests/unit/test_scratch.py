"""Scratch directories go with their process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

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
