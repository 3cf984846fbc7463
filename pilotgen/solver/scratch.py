"""Scratch directories that do not outlive their process, even one that is killed.

A directory is locked by the process that uses it. The kernel lets go of the lock when that process dies, however it
dies, and the next process that wants a directory removes those that nobody holds.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
import tempfile
from contextlib import suppress
from pathlib import Path

_PREFIX = "pilotgen-scratch-"


class ScratchDirectory:
    """A directory of this process, in memory where the system offers it.

    Attributes
    ----------
    path : Path
        The directory.
    """

    def __init__(self) -> None:
        shared_memory = Path("/dev/shm")
        usable = shared_memory.is_dir() and os.access(shared_memory, os.W_OK | os.X_OK)
        root = shared_memory if usable else Path(tempfile.gettempdir())
        _remove_abandoned(root)
        while True:
            self.path = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=root))
            handle = _lock(self.path, own=True)
            if handle is not None and self.path.is_dir():
                break
            if handle is not None:  # another process took it for abandoned before it was locked
                os.close(handle)
        self._handle = handle
        self._owner = os.getpid()

    def close(self) -> None:
        """Remove the directory."""
        if self._handle < 0 or os.getpid() != self._owner:
            return  # closed already, or a forked copy of somebody else's
        shutil.rmtree(self.path, ignore_errors=True)
        os.close(self._handle)
        self._handle = -1


def _lock(path: Path, own: bool = False) -> int | None:
    """Handle of the directory, locked; None if another process holds it, or it is gone.

    Where the file system knows no locks the handle is enough for the owner, and nobody takes anything for abandoned.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC | os.O_NOFOLLOW)
    except OSError:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if own and error.errno not in (errno.EAGAIN, errno.EACCES):
            return handle
        os.close(handle)
        return None
    return handle


def _remove_abandoned(root: Path) -> None:
    with suppress(OSError), os.scandir(root) as entries:
        for entry in entries:
            if not entry.name.startswith(_PREFIX) or entry.stat(follow_symlinks=False).st_uid != os.getuid():
                continue
            handle = _lock(Path(entry.path))
            if handle is not None:
                shutil.rmtree(entry.path, ignore_errors=True)
                os.close(handle)
