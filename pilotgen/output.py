"""Who may write where: an output directory is new, empty, or carries the mark of the command that made it.

A command claims its directory for as long as it writes. The mark, `.pilotgen.json`, names the command and every file
it left, with its hash: what was edited since, and what never was ours, is refused by name and never lost. `--overwrite`
moves the whole directory aside.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import errno
import fcntl
import fnmatch
import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pilotgen.errors import FileError
from pilotgen.files import make_directory, refuse_special, write_text

MARK_NAME = ".pilotgen.json"
LOCK_NAME = ".lock"
HEARTBEAT_NAME = ".heartbeat.json"  # of a run, while it goes on
# Names that only pilotgen gives; SQLite makes the last two beside a journal, whoever reads it.
OWN_NAMES = (MARK_NAME, LOCK_NAME, HEARTBEAT_NAME, "journal.sqlite-wal", "journal.sqlite-shm")
FILETYPE, VERSION = "pilotgen output", 1
NOT_HASHED = ("journal.sqlite*",)  # it grows by itself, and tells by itself whether it is whole
SHOWN = 3  # names that a message lists

STUDY_NAME = "study.yaml"  # the study as it was run, with what --set changed
REPORT_FILES = ("report.html", "comparison.html", STUDY_NAME, "front", "front/*")
STUDY_FILES = ("study.h5", "study.h5.old-*", "journal.sqlite*", *REPORT_FILES)
STUDY_KINDS = ("search", "sample", "population", "sensitivity", "cures")
PAGES = ("report", "view")  # commands that add pages to what another command left


@dataclass(frozen=True)
class Mark:
    """What `.pilotgen.json` says."""

    kind: str  # the command
    complete: bool  # it came to its end; else it was interrupted and whatever it may write is its own
    files: Mapping[str, str] = field(default_factory=dict)  # path below the directory -> SHA-256
    others: tuple[str, ...] = ()  # files that are not the command's


def read_mark(directory: Path) -> Mark | None:
    """The mark of an output directory; None if it has none. Raises FileError if it cannot be read."""
    path = directory / MARK_NAME
    refuse_special(path)
    try:
        data: Any = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, RecursionError) as error:
        raise FileError(f"{path}: cannot be read ({error}); {_WAY_OUT}") from None
    try:
        if data["filetype"] != FILETYPE or data["version"] != VERSION:
            raise FileError(f"{path}: not the mark of this program's version; {_WAY_OUT}")
        return Mark(
            str(data["kind"]),
            bool(data["complete"]),
            {str(k): str(v) for k, v in data["files"].items()},
            tuple(map(str, data["others"])),
        )
    except (KeyError, TypeError, AttributeError):
        raise FileError(f"{path}: is damaged; {_WAY_OUT}") from None


_WAY_OUT = "choose another output directory, or add --overwrite, which moves this one aside"


@contextmanager
def claimed(
    directory: Path, kind: str, writes: Sequence[str], resume: bool = False, overwrite: bool = False
) -> Iterator[Path]:
    """Hold an output directory while a command writes to it.

    Parameters
    ----------
    directory : Path
        Made if missing.
    kind : str
        The command; a directory belongs to the one that made it.
    writes : sequence of str
        Patterns of the paths below `directory` that this command may write.
    resume : bool
        A study that is already there goes on, and so do draws of a pilot; False refuses it, or begins them anew.
    overwrite : bool
        Move an existing directory aside first (to `NAME.old-1`, `.old-2`, ...).

    Raises
    ------
    FileError
        It cannot be made or written, another command is writing to it, or it holds what is not ours to replace: other
        files, another command's output, files edited since they were written.
    """
    directory = directory.absolute()
    if overwrite:
        _move_aside(directory)
    made = not directory.exists()
    make_directory(directory)
    before = _Contents(directory, made)
    if before.mark is None:
        before.refuse_strangers(kind, resume)
    with _locked(directory):
        before = _Contents(directory, made)  # nobody else writes from here on
        others = before.check(kind, writes, resume)
        try:
            name = kind if before.mark is None else before.mark.kind
            _write_mark(directory, Mark(name, False, before.hashes, tuple(sorted(others))))
            if kind not in (*STUDY_KINDS, *PAGES):
                _remove_own(directory, [p for p in before.hashes if not (resume and _matches(p, NOT_HASHED))])
            yield directory
        except BaseException:
            if made:
                _remove_if_empty(directory)
            raise
        ours = {path: _sha256(directory / path) for path in _paths(directory) if path not in others}
        _write_mark(directory, Mark(name, True, ours, tuple(sorted(others))))


def examine(directory: Path, kind: str, writes: Sequence[str], resume: bool = False) -> None:
    """Refuse a directory as `claimed` would, and write nothing.

    Raises
    ------
    FileError
        As `claimed`, except for what only writing finds out.
    """
    directory = directory.absolute()
    if directory.exists() or directory.is_symlink():
        if not directory.is_dir():
            raise FileError(f"{directory} is a file; the output needs a directory")
        _Contents(directory, False).check(kind, writes, resume)
        return
    above = next(place for place in directory.parents if os.path.lexists(place))
    if not above.is_dir() or not os.access(above, os.W_OK | os.X_OK):
        why = "Permission denied" if above.is_dir() else "Not a directory"
        raise FileError(f"{directory}: cannot be made ({why}); choose a directory you can write to")


def is_study(directory: Path) -> bool:
    """Whether a search, a sample or the like wrote, or is writing, to a directory. FileError for a damaged mark."""
    mark = read_mark(directory)
    return _is_older_study(directory) if mark is None else mark.kind in STUDY_KINDS


def mark_as_interrupted(directory: Path, copy: Path) -> None:
    """Give the copy of a study the study's mark, as of a run that was interrupted."""
    mark = read_mark(directory)
    kind, others = ("search", ()) if mark is None else (mark.kind, mark.others)
    _write_mark(copy, Mark(kind, False, {}, others))


class _Contents:
    """What is in a directory before a command writes to it."""

    def __init__(self, directory: Path, made: bool) -> None:
        self.directory = directory
        self.mark = None if made else read_mark(directory)
        self.paths = [] if made else _paths(directory)
        if self.mark is None and not made and _is_older_study(directory):
            self.mark = Mark("search", False, {}, tuple(path for path in self.paths if not _matches(path, STUDY_FILES)))
        self.hashes: Mapping[str, str] = self.mark.files if self.mark is not None else {}

    def refuse_strangers(self, kind: str, resume: bool) -> None:
        if self.paths:
            raise FileError(f"{self.directory} holds {_listed(self.paths)}, which pilotgen did not write; {_WAY_OUT}")

    def check(self, kind: str, writes: Sequence[str], resume: bool) -> set[str]:
        """Refuse what may not be written over; returns the paths that are none of this command's business."""
        if self.mark is None:
            self.refuse_strangers(kind, resume)
            return set()
        is_study, was_study = kind in (*STUDY_KINDS, *PAGES), self.mark.kind in STUDY_KINDS
        if was_study and is_study and not resume and kind in (self.mark.kind, *PAGES):
            raise FileError(
                f"{self.directory} already holds a study; add --resume to go on with it (finished evaluations are "
                f"kept), or choose another output directory, or add --overwrite, which moves this one aside"
            )
        of_pilot = kind == "view" and self.mark.kind == "pilot"
        if self.mark.kind != kind and not (kind in PAGES and was_study) and not of_pilot:
            what = f"holds what `pilotgen {self.mark.kind}` wrote"
            if was_study:
                what = "already holds a study" + (f", that of `pilotgen {self.mark.kind}`" if is_study else "")
            raise FileError(f"{self.directory} {what}; {_WAY_OUT}")
        if self.mark.complete:
            others = {path for path in self.paths if path not in self.hashes}
        else:
            others = {path for path in self.paths if path in self.mark.others}
        if kind == "pilot" and not (self.mark.complete or resume) and "journal.sqlite" in set(self.paths) - others:
            raise FileError(
                f"{self.directory} holds draws of a pilot that were interrupted; add --resume to go on with them "
                "(with --uncertain), or choose another output directory, or add --overwrite, which moves this one aside"
            )
        in_the_way = sorted(path for path in others if _matches(path, writes))
        if in_the_way:
            raise FileError(
                f"{self.directory} holds {_listed(in_the_way)}, which pilotgen did not write and would replace; "
                f"{_WAY_OUT}"
            )
        if self.mark.complete:
            edited = sorted(
                path
                for path in self.paths
                if path in self.hashes
                and self.hashes[path]
                and _matches(path, writes)
                and _sha256(self.directory / path) != self.hashes[path]
            )
            if edited:
                raise FileError(
                    f"{self.directory}: {_listed(edited)} changed since pilotgen wrote it, and would be replaced; "
                    f"{_WAY_OUT}"
                )
        return others


def _remove_own(directory: Path, paths: Iterable[str]) -> None:
    """Take away what the same command left here before, so that nothing of another pilot stands beside its results."""
    for path in paths:
        try:
            (directory / path).unlink(missing_ok=True)
        except OSError as error:
            raise FileError(f"{directory / path}: cannot be replaced ({error.strerror}); {_WAY_OUT}") from None


def _is_older_study(directory: Path) -> bool:
    """A study of a version that left no mark, or one made by hand from its study.h5."""
    return any((directory / name).is_file() for name in ("journal.sqlite", "study.h5"))


def _paths(directory: Path) -> list[str]:
    """Every file below a directory, and every link, sorted; our own mark and lock aside."""
    found = []
    for place, folders, files in os.walk(directory):
        below = Path(place).relative_to(directory)
        links = [name for name in folders if (Path(place) / name).is_symlink()]
        found += [(below / name).as_posix() for name in [*files, *links]]
    return sorted(path for path in found if path.removesuffix(".part") not in OWN_NAMES)


def _matches(path: str, patterns: Sequence[str]) -> bool:
    return any(fnmatch.fnmatchcase(path, pattern) for pattern in patterns)


def _sha256(path: Path) -> str:
    """Hash of a file; empty for what is not hashed."""
    if path.is_symlink() or not path.is_file() or _matches(path.name, NOT_HASHED):
        return ""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _listed(paths: Sequence[str]) -> str:
    more = len(paths) - SHOWN
    return ", ".join(paths[:SHOWN]) + (f" and {more} more" if more > 0 else "")


def _write_mark(directory: Path, mark: Mark) -> None:
    data = {
        "filetype": FILETYPE,
        "version": VERSION,
        "kind": mark.kind,
        "complete": mark.complete,
        "files": dict(mark.files),
        "others": list(mark.others),
    }
    write_text(directory / MARK_NAME, json.dumps(data, indent=1) + "\n")


@contextmanager
def _locked(directory: Path) -> Iterator[None]:
    try:
        handle = os.open(
            directory / LOCK_NAME, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK, 0o644
        )
    except OSError as error:
        raise FileError(
            f"{directory}: cannot be used for output ({error.strerror}); choose a directory you can write to"
        ) from None
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EACCES):
                raise FileError(
                    f"{directory}: its file system does not lock files ({error.strerror}); choose an output "
                    "directory on another one"
                ) from None
            raise FileError(
                f"{directory} is in use by another run; wait for it, or choose another output directory"
            ) from None
        yield
    finally:
        os.close(handle)


def _move_aside(directory: Path) -> None:
    """Rename a directory that holds anything to the first free `NAME.old-N`."""
    if directory.is_symlink() or not directory.is_dir() or not any(directory.iterdir()):
        return
    with _locked(directory):
        number = 1
        while (aside := directory.with_name(f"{directory.name}.old-{number}")).exists():
            number += 1
        try:
            os.rename(directory, aside)
        except OSError as error:
            raise FileError(
                f"{directory}: cannot be moved aside to {aside} ({error.strerror}); move it yourself"
            ) from None


def _remove_if_empty(directory: Path) -> None:
    """Leave no trace of a directory that was made for nothing."""
    if _paths(directory):
        return
    with suppress(OSError):
        for name in (MARK_NAME, LOCK_NAME, HEARTBEAT_NAME):
            (directory / name).unlink(missing_ok=True)
        directory.rmdir()
