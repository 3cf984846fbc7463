"""HDF5 files of ours: written whole or not at all, recognised by type and version; damage is told in a sentence.

The HDF5 library must never see a failing disk: it cannot close a file that it cannot write, and crashes when the
process ends. It therefore writes through `_Spool`, which takes everything and keeps the first error for us.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import errno
import hashlib
import io
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pilotgen.errors import FileError, PilotgenError
from pilotgen.files import refuse_special

if TYPE_CHECKING:
    import h5py

# What h5py raises when a file is not what it says.
_DAMAGE = (OSError, KeyError, ValueError, TypeError, RuntimeError, MemoryError, OverflowError, AttributeError)


class _Spool(io.RawIOBase):
    """A file for the HDF5 library to write to; after the first error it goes on in memory."""

    def __init__(self, path: Path) -> None:
        self._file: Any = path.open("w+b", buffering=0)
        self.error: OSError | None = None

    def _give_up(self, error: OSError) -> None:
        self.error = self.error or error
        place = self._file.tell()
        self._file.seek(0)
        memory = io.BytesIO(self._file.read())
        self._file.close()
        memory.seek(place)
        self._file = memory

    def readinto(self, buffer: Any) -> int:
        return int(self._file.readinto(buffer))

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        done = 0
        while done < len(view):
            try:
                done += self._file.write(view[done:])
            except OSError as error:
                self._give_up(error)
        return done

    def truncate(self, size: int | None = None) -> int:
        try:
            return int(self._file.truncate(size))
        except OSError as error:
            self._give_up(error)
            return int(self._file.truncate(size))

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        return int(self._file.seek(offset, whence))

    def tell(self) -> int:
        return int(self._file.tell())

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def close(self) -> None:
        if not self.closed:
            try:
                self._file.close()
            except OSError as error:
                self.error = self.error or error
            super().close()


class NewFile:
    """An HDF5 file that takes its name when the block ends without error.

    Parameters
    ----------
    path : path
        The file; one that is there is replaced.
    filetype : str
        What its attribute `filetype` says.
    version : tuple of int
        Major and minor version of the format.
    seal : bool
        Leave the hash of all it says in the attribute `content_sha256`, which `opened` looks at. A file too large to be
        read again has a checksum of its own instead.
    """

    def __init__(
        self, path: str | os.PathLike[str], filetype: str, version: tuple[int, int], seal: bool = True
    ) -> None:
        import h5py

        self._seal = seal
        self.path = Path(path)
        self._part = self.path.with_name(self.path.name + ".part")
        refuse_special(self._part)
        try:
            self._spool = _Spool(self._part)
        except OSError as error:
            raise self._failure(error) from None
        self.file: h5py.File = h5py.File(self._spool, "w", track_order=True)
        self.file.attrs["filetype"] = np.bytes_(filetype.encode())
        self.file.attrs["version"] = np.array(version, dtype=np.int64)

    def _failure(self, error: OSError) -> FileError:
        return FileError(f"{self.path}: cannot be written ({error.strerror or error}); check space and permissions")

    def check(self) -> None:
        """Raise FileError if anything could not be written so far."""
        self.file.flush()
        if self._spool.error is not None:
            raise self._failure(self._spool.error)

    def __enter__(self) -> NewFile:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        try:
            if kind is None and self._seal and self._spool.error is None:
                self.file.attrs[SEAL] = content_sha256(self.file)
            self.file.close()
            self._spool.close()
            if kind is None:
                if self._spool.error is not None:
                    raise self._failure(self._spool.error)
                try:
                    os.replace(self._part, self.path)
                except OSError as error:
                    raise self._failure(error) from None
        finally:
            self._part.unlink(missing_ok=True)


SEAL = "content_sha256"


def content_sha256(file: h5py.File) -> str:
    """Hash of every attribute and dataset: name, kind, shape and values."""
    import h5py

    found = hashlib.sha256()

    def add(name: str, value: Any) -> None:
        array = np.asarray(value)
        found.update(f"{name}\0{array.shape}\0".encode())
        if array.dtype.kind in "OSU":
            for one in array.ravel():
                found.update(text(one).encode("utf-8", "replace") + b"\0")
        else:
            found.update(array.dtype.str.encode() + np.ascontiguousarray(array).tobytes())

    def attributes(name: str, one: Any) -> None:
        for key in sorted(one.attrs):
            if key != SEAL:
                add(f"{name}@{key}", one.attrs[key])

    def visit(name: str, one: Any) -> None:
        if isinstance(one, h5py.Dataset):
            add(name, one[()])
        else:
            found.update(name.encode() + b"/")
        attributes(name, one)

    attributes("", file)
    file.visititems(visit)
    return found.hexdigest()


@contextmanager
def opened(
    path: str | os.PathLike[str],
    filetype: str,
    version: tuple[int, int],
    error: type[PilotgenError] = FileError,
    advice: str = "",
) -> Iterator[h5py.File]:
    """Open an HDF5 file of ours to read; only reading belongs into the block.

    `advice` follows the message about another version, such as "; make it again".

    Raises
    ------
    FileError
        It cannot be opened.
    error
        It is of another type or version, or what the block reads is missing, of the wrong kind or damaged.
    """
    name = os.fspath(path)
    try:
        file = open_to_read(name)
    except OSError as problem:
        if problem.errno == errno.ENOENT or not os.path.exists(name):
            raise FileError(f"{name}: cannot be read as HDF5 (No such file or directory)") from None
        raise FileError(f"{name}: cannot be read as HDF5 ({problem})") from None
    with file:
        try:
            found = text(file.attrs.get("filetype", ""))
            if found != filetype:
                raise error(f"{name} is not a {filetype} file: its filetype is {found[:40]!r}")
            major, minor = (int(part) for part in np.atleast_1d(file.attrs.get("version", (0, 0)))[:2])
            if major != version[0]:
                raise error(f"{name}: version {major}.{minor} of the format; this program reads {version[0]}.x{advice}")
            if SEAL in file.attrs and text(file.attrs[SEAL]) != content_sha256(file):
                raise error(
                    f"{name}: is damaged: it does not have the checksum that it was written with; make it again"
                )
            yield file
        except PilotgenError:
            raise
        except _DAMAGE as problem:
            told = str(problem.args[0]) if problem.args else type(problem).__name__
            raise error(f"{name}: a part is missing, of the wrong kind or damaged ({told})") from None


def open_to_read(name: str) -> h5py.File:
    """An HDF5 file to read, without a lock where the file system knows none.

    Raises
    ------
    FileError
        Another process is writing it.
    OSError
        It cannot be opened, or is no HDF5 file.
    """
    import h5py

    refuse_special(name)
    try:
        return guarded(h5py.File(name, "r"), name)
    except OSError as problem:
        number = re.search(r"unable to lock file, errno = (\d+)", str(problem))
        if not number:
            raise
        if int(number[1]) in (errno.EAGAIN, errno.EACCES):
            raise FileError(f"{name}: another process has it open for writing; wait until it is done") from None
    return guarded(h5py.File(name, "r", locking=False), name)


MOST_BYTES = 4 << 30  # of all that a file says it holds
MOST_EXPANSION = 1100  # deflate shrinks by 1030 at most
MOST_OBJECTS = 100_000


def guarded(file: h5py.File, name: str) -> h5py.File:
    """The file, if it keeps to itself and to its size; closed otherwise.

    Raises
    ------
    FileError
        Something in it is a link to elsewhere, is stored in another file, or is said to be larger than it can be.
    """
    import h5py

    problem = ""
    try:
        size, said, groups, count = os.path.getsize(name), 0, [file["/"]], 0
        seen: set[Any] = set()
        while groups and not problem:
            group = groups.pop()
            for key in group:
                count += 1
                place = f"{group.name.rstrip('/')}/{key}"
                if not isinstance(group.get(key, getlink=True), h5py.HardLink):
                    problem = f"{place} is a link to elsewhere, which is not followed"
                    break
                one = group[key]
                if isinstance(one, h5py.Group):
                    address = h5py.h5o.get_info(one.id).addr
                    if address not in seen:
                        seen.add(address)
                        groups.append(one)
                elif isinstance(one, h5py.Dataset):
                    if one.is_virtual or one.external:
                        problem = f"{place} is stored in another file, which is not read"
                        break
                    said += one.nbytes
                    if said > MOST_BYTES or said > MOST_EXPANSION * size:
                        problem = f"{place} is said to have {one.nbytes} bytes, in a file of {size} bytes"
                        break
                if count > MOST_OBJECTS:
                    problem = f"it holds more than {MOST_OBJECTS} objects"
                    break
    except _DAMAGE as damage:
        told = str(damage.args[0]) if damage.args else type(damage).__name__
        problem = f"it is damaged ({told})"
    if problem:
        file.close()
        raise FileError(f"{name}: cannot be read: {problem}")
    return file


def text(value: Any) -> str:
    """A text attribute or dataset entry, however it is stored."""
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)
