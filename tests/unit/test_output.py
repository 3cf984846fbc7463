"""Who may write where: new, empty or marked directories only; nothing is lost.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pilotgen.errors import FileError
from pilotgen.output import LOCK_NAME, MARK_NAME, STUDY_FILES, claimed, read_mark

DECKS = ("*.mbd",)


def write_deck(directory: Path, text: str = "deck", **options: bool) -> None:
    with claimed(directory, "decks", DECKS, **options) as place:
        (place / "pilot.mbd").write_text(text)


def test_a_directory_of_ours_is_written_again(tmp_path: Path) -> None:
    write_deck(tmp_path / "out")
    mark = read_mark(tmp_path / "out")
    assert mark is not None and mark.complete and set(mark.files) == {"pilot.mbd"}
    write_deck(tmp_path / "out", "other")
    assert (tmp_path / "out" / "pilot.mbd").read_text() == "other"
    (tmp_path / "empty").mkdir()
    write_deck(tmp_path / "empty")


def test_strangers_are_refused_and_moved_aside_on_demand(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.tex").write_text("years of work")
    with pytest.raises(FileError, match=r"holds thesis.tex, which pilotgen did not write; .* --overwrite"):
        write_deck(out)
    assert os.listdir(out) == ["thesis.tex"]  # not even a lock
    for number in (1, 2):
        write_deck(out, overwrite=True)
        assert (tmp_path / f"out.old-{number}").is_dir()
    assert (tmp_path / "out.old-1" / "thesis.tex").read_text() == "years of work"


def test_edited_files_are_refused(tmp_path: Path) -> None:
    write_deck(tmp_path)
    (tmp_path / "pilot.mbd").write_text("edited by hand")
    with pytest.raises(FileError, match="pilot.mbd changed since pilotgen wrote it"):
        write_deck(tmp_path)
    assert (tmp_path / "pilot.mbd").read_text() == "edited by hand"


def test_files_added_later_stay_and_are_never_replaced(tmp_path: Path) -> None:
    write_deck(tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    write_deck(tmp_path)
    mark = read_mark(tmp_path)
    assert mark is not None and "notes.txt" not in mark.files
    (tmp_path / "trim.mbd").write_text("mine")
    with pytest.raises(FileError, match="holds trim.mbd, which pilotgen did not write and would replace"):
        write_deck(tmp_path)


def test_another_command_is_refused(tmp_path: Path) -> None:
    write_deck(tmp_path)
    with pytest.raises(FileError, match="holds what `pilotgen decks` wrote"), claimed(tmp_path, "pilot", DECKS):
        pass


def test_an_interrupted_command_owns_what_it_left(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    out = tmp_path / "out"
    write_deck(out)
    (out / "notes.txt").write_text("mine")
    with pytest.raises(KeyboardInterrupt), claimed(out, "decks", DECKS) as place:
        (place / "pilot.mbd").write_text("half")
        (place / "trim.mbd").write_text("half")
        raise KeyboardInterrupt
    write_deck(out)
    mark = read_mark(out)
    assert mark is not None and set(mark.files) == {"pilot.mbd", "trim.mbd"} and mark.others == ("notes.txt",)


def test_nothing_is_left_of_a_command_that_wrote_nothing(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), claimed(tmp_path / "out", "decks", DECKS):
        raise RuntimeError
    assert not (tmp_path / "out").exists()


def test_a_study_needs_resume(tmp_path: Path) -> None:
    (tmp_path / "study.h5").touch()  # of an earlier version, without a mark
    (tmp_path / "notes.txt").touch()
    with (
        pytest.raises(FileError, match="already holds a study; add --resume"),
        claimed(tmp_path, "search", STUDY_FILES),
    ):
        pass
    with claimed(tmp_path, "search", STUDY_FILES, resume=True) as directory:
        assert directory == tmp_path
    mark = read_mark(tmp_path)
    assert mark is not None and set(mark.files) == {"study.h5"}
    for resume in (False, True):  # no advice that would be refused as well
        with (
            pytest.raises(FileError, match="already holds a study, that of `pilotgen search`; choose"),
            claimed(tmp_path, "sample", STUDY_FILES, resume),
        ):
            raise AssertionError
    with pytest.raises(FileError, match="already holds a study; choose"), claimed(tmp_path, "pilot", DECKS):
        pass


def test_a_front_with_something_of_the_users_is_not_removed(tmp_path: Path) -> None:
    with claimed(tmp_path, "search", STUDY_FILES) as directory:
        (directory / "front" / "01").mkdir(parents=True)
        (directory / "front" / "01" / "pilot.mbd").touch()
    (tmp_path / "front" / "01" / "remarks.txt").touch()
    with (
        pytest.raises(FileError, match="holds front/01/remarks.txt"),
        claimed(tmp_path, "search", STUDY_FILES, resume=True),
    ):
        pass


def test_second_run_on_one_directory_is_refused(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from pilotgen.output import claimed\n"
        "from pilotgen.errors import FileError\n"
        "try:\n"
        "    with claimed(Path(sys.argv[1]), 'decks', ()): print('in')\n"
        "except FileError as error: print(error)\n"
    )

    def second() -> str:
        command = [sys.executable, "-c", code, str(tmp_path)]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    with claimed(tmp_path, "decks", ()):
        assert "in use by another run" in second()
    assert second() == "in\n"


def test_unusable_output_directories_are_explained(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(FileError, match="is a file"):
        write_deck(tmp_path / "file")
    with pytest.raises(FileError, match="cannot be made"):
        write_deck(tmp_path / "file" / "below")
    write_deck(tmp_path / "damaged")
    for text in ("{", "[]", '{"filetype": "other", "version": 1}'):
        (tmp_path / "damaged" / MARK_NAME).write_text(text)
        with pytest.raises(FileError, match=MARK_NAME):
            write_deck(tmp_path / "damaged")
    (tmp_path / "linked").mkdir()
    (tmp_path / "linked" / LOCK_NAME).symlink_to(tmp_path / "file")
    with pytest.raises(FileError, match="cannot be used for output"):
        write_deck(tmp_path / "linked")


def test_nothing_of_an_earlier_run_stands_beside_the_results(tmp_path: Path) -> None:
    with claimed(tmp_path, "decks", DECKS) as place:
        (place / "trim.mbd").touch()
        (place / "pilot.mbd").touch()
    (tmp_path / "notes.txt").touch()
    write_deck(tmp_path)
    assert sorted(path.name for path in tmp_path.glob("[!.]*")) == ["notes.txt", "pilot.mbd"]


def test_draws_that_were_interrupted_are_not_lost(tmp_path: Path) -> None:
    files = ("*.mbd", "journal.sqlite*")

    def draw(interrupted: bool = False, **options: bool) -> str:
        with claimed(tmp_path, "pilot", files, **options) as place:
            journal = place / "journal.sqlite"
            before = journal.read_text() if journal.exists() else ""
            journal.write_text(f"{before}draws ")
            if interrupted:
                raise KeyboardInterrupt
        return before

    with pytest.raises(KeyboardInterrupt):
        draw(interrupted=True)
    with pytest.raises(FileError, match="holds draws of a pilot that were interrupted; add --resume"):
        draw()
    assert draw(resume=True) == "draws "
    assert draw(resume=True) == "draws draws "  # with more draws, for example
    assert draw() == ""  # a pilot that is complete is replaced, as ever
