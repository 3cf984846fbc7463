"""Processes under test: commands started in a session of their own, their descendants, and their ends.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from pilotgen.runs.journal import JOURNAL_NAME

PATIENCE_S = 60.0  # the machine may be busy with other things


def start(*arguments: str | Path, **environment: str) -> subprocess.Popen[str]:
    """Start `pilotgen` with these arguments, leader of its own process group; Ctrl-C is for it as in a terminal.

    (A shell's background jobs, tests among them, ignore Ctrl-C, and so would what they start.)
    """
    return subprocess.Popen(
        [sys.executable, "-m", "pilotgen", *map(str, arguments)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        env={**os.environ, **environment},
    )


def run(*arguments: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run `pilotgen` to its end."""
    process = start(*arguments, **environment)
    out, err = process.communicate(timeout=4 * PATIENCE_S)
    return subprocess.CompletedProcess(process.args, process.returncode, out, err)


def wait_until(condition: Callable[[], bool], what: str) -> None:
    """Look again and again; AssertionError when it takes too long."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, f"waited in vain: {what}"
        time.sleep(0.005)


def recorded(directory: Path) -> int:
    """Evaluations in the journal of a run in progress."""
    path = directory / JOURNAL_NAME
    if not path.exists():
        return 0
    try:
        db = sqlite3.connect(f"file:{path}?mode=ro", uri=True)
        try:
            return int(db.execute("SELECT count(*) FROM evaluation").fetchone()[0])
        finally:
            db.close()
    except sqlite3.Error:
        return 0


def children(pid: int) -> list[int]:
    """Process ids of the living children."""
    words: list[str] = []
    for path in Path(f"/proc/{pid}/task").glob("*/children"):  # of every thread
        with contextlib.suppress(OSError):
            words += path.read_text().split()
    return [int(word) for word in words if alive(int(word))]


def descendants(pid: int) -> list[int]:
    """Process ids of all living descendants."""
    found = []
    for child in children(pid):
        found += [child, *descendants(child)]
    return found


def command_of(pid: int) -> str:
    """Command line of a process, empty if it is gone."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return ""


def alive(pid: int) -> bool:
    """Whether the process runs: exists, and is not one that only waits to be reaped."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def kill(pid: int) -> None:
    """SIGKILL, if it is still there."""
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


def assert_all_gone(pids: list[int]) -> None:
    """None of these processes is left."""
    wait_until(lambda: not any(map(alive, pids)), f"end of {[command_of(pid) for pid in pids if alive(pid)]}")


# ---- dask: a scheduler and workers in processes of their own


def start_dask(role: str, *arguments: str) -> subprocess.Popen[bytes]:
    """Start a `scheduler` or a `worker`."""
    command = [sys.executable, "-m", f"distributed.cli.dask_{role}", *arguments]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@contextlib.contextmanager
def dask_scheduler(directory: Path, host: str = "127.0.0.1", more: Sequence[str] = ()) -> Iterator[str]:
    """A scheduler, known by its address; it leaves a file in the directory."""
    path = directory / "scheduler.json"
    process = start_dask(
        "scheduler", "--host", host, "--port", "0", "--no-dashboard", "--scheduler-file", str(path), *more
    )
    try:
        wait_until(lambda: path.exists() and path.stat().st_size > 0, "the scheduler")
        yield str(json.loads(path.read_text())["address"])
    finally:
        process.terminate()
        process.wait()


def start_dask_worker(address: str, directory: Path, more: Sequence[str] = ()) -> subprocess.Popen[bytes]:
    """A worker without a nanny: killed, it stays dead."""
    return start_dask(
        "worker", address, "--nworkers", "1", "--nthreads", "1", "--no-nanny", "--no-dashboard",
        "--local-directory", str(directory), *more,
    )  # fmt: skip
