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

from pilotgen.errors import FileError

_PREFIX = "pilotgen-scratch-"
PLACE = "PILOTGEN_SCRATCH"  # environment variable: where scratch directories go instead
_PROBE_BYTES = 1 << 18
ROOM_BYTES = 16 << 20  # a pilot's files take about 1 MB; memory with less than this left is left alone


def _root() -> Path:
    """Where scratch directories go: where the user says, else in memory if there is room, else where TMPDIR says."""
    named = os.environ.get(PLACE)
    if named:
        if not Path(named).is_dir() or not os.access(named, os.W_OK | os.X_OK):
            raise FileError(f"{PLACE}: {named} is no directory that can be written to; name another one, or unset it")
        return Path(named).absolute()
    shared_memory = Path("/dev/shm")
    with suppress(OSError):
        left = os.statvfs(shared_memory)
        if os.access(shared_memory, os.W_OK | os.X_OK) and left.f_bavail * left.f_frsize >= ROOM_BYTES:
            return shared_memory
    return Path(tempfile.gettempdir())


class ScratchDirectory:
    """A directory of this process, in memory where the system offers it.

    Attributes
    ----------
    path : Path
        The directory.
    """

    def __init__(self) -> None:
        root = _root()
        _remove_abandoned(root)
        while True:
            try:
                self.path = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=root))
            except OSError as error:
                raise FileError(
                    f"{root}: no scratch directory can be made there ({error.strerror}); check space, or name another "
                    f"place by the environment variable {PLACE}"
                ) from None
            handle = _lock(self.path, own=True)
            if handle is not None and self.path.is_dir():
                break
            if handle is not None:  # another process took it for abandoned before it was locked
                os.close(handle)
        self._handle = handle
        self._owner = os.getpid()

    def check(self, name: str, size: int) -> None:
        """Make sure that the directory is there, with the file that was put into it, and has room.

        Parameters
        ----------
        name : str
            File that was put there last.
        size : int
            Its size [bytes].

        Raises
        ------
        FileError
            It is not: whatever failed here would have failed for anybody.
        """
        advice = (
            f"nothing that was at work is recorded; find out why, or name another place by the environment variable "
            f"{PLACE}, and go on with --resume"
        )
        try:
            here, ours = os.stat(self.path), os.fstat(self._handle)
            file = os.stat(self.path / name)
            if (here.st_dev, here.st_ino) != (ours.st_dev, ours.st_ino) or file.st_size != size:
                raise FileNotFoundError
        except FileNotFoundError:
            raise FileError(f"{self.path}: was removed or emptied while it was in use; {advice}") from None
        except OSError as error:
            raise FileError(f"{self.path}: cannot be looked at ({error.strerror}); {advice}") from None
        probe = self.path / ".room"
        try:
            probe.write_bytes(bytes(_PROBE_BYTES))
            probe.unlink()
        except OSError as error:
            with suppress(OSError):
                probe.unlink(missing_ok=True)
            raise FileError(f"{self.path}: cannot be written to ({error.strerror}); {advice}") from None

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
