"""A copy of a study's directory that is whole, also while the study runs.

A running journal has what was written last in files beside it (write-ahead log): copying `journal.sqlite` alone saves
nothing of that. SQLite's own backup takes both.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
import shutil
import sqlite3
from pathlib import Path

from pilotgen.errors import FileError
from pilotgen.files import make_directory
from pilotgen.output import OWN_NAMES, is_study, mark_as_interrupted
from pilotgen.runs.journal import JOURNAL_NAME


def back_up(directory: Path, target: Path) -> int:
    """Copy a study's directory to a new one, where it goes on with --resume; returns the evaluations recorded there.

    The study is not disturbed.

    Raises
    ------
    FileError
        There is no study, the target holds something, or cannot be written.
    """
    journal = directory / JOURNAL_NAME
    if not directory.is_dir() or not is_study(directory):
        raise FileError(f"{directory} holds no study; DIR is the output directory of a search or a sample")
    if target.absolute().is_relative_to(directory.absolute()):
        raise FileError(f"{target} is in the study's own directory; choose a place outside")
    if target.is_symlink() or (target.exists() and (not target.is_dir() or any(target.iterdir()))):
        raise FileError(f"{target} exists and is no empty directory; choose another place for the copy")
    make_directory(target)
    count = 0
    try:
        for place, _, names in os.walk(directory):
            for name in sorted(names):
                path = Path(place) / name
                below = path.relative_to(directory)
                skip = below.as_posix().startswith(JOURNAL_NAME) or name in OWN_NAMES or name.endswith(".part")
                if skip or path.is_symlink() or not path.is_file():
                    continue
                (target / below.parent).mkdir(parents=True, exist_ok=True)
                shutil.copy2(path, target / below)
        if journal.is_file():
            count = _copy_journal(journal, target / JOURNAL_NAME)
    except OSError as error:
        raise FileError(f"{target}: the copy cannot be made ({error.strerror or error}); check space") from None
    mark_as_interrupted(directory, target)
    return count


def _copy_journal(journal: Path, target: Path) -> int:
    try:
        source = sqlite3.connect(f"{journal.absolute().as_uri()}?mode=ro", uri=True, timeout=30.0)
        copy = sqlite3.connect(target)
        try:
            source.backup(copy)
            return int(copy.execute("SELECT count(*) FROM evaluation").fetchone()[0])
        finally:
            copy.close()
            source.close()
    except sqlite3.Error as error:
        raise FileError(f"{journal}: cannot be copied to {target} ({error})") from None
