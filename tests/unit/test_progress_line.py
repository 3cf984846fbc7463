"""The progress line: redrawn within one line of a terminal, plain lines elsewhere.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import fcntl
import io
import os
import pty
import struct
import termios

import pytest

from pilotgen.progress_line import ProgressLine, counted, format_duration

PARTS = ("smallest GM 1.82 dB, PM 34.1 deg", "at most 0:12 left", "generation 1/30", "412 evaluations, 2 failed")
LONG = " | ".join(PARTS)


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.0, "0:00"), (-3.0, "0:00"), (83.4, "1:23"), (3599.6, "1:00:00"), (4000.0, "1:06:40")]
)
def test_durations(seconds: float, text: str) -> None:
    assert format_duration(seconds) == text


def test_plain_lines_at_milestones_only() -> None:
    stream = io.StringIO()
    line = ProgressLine(10, stream)
    line.update("first")  # the first of the ten seconds' lines
    line.update("second")
    line.update("third", milestone=True)
    line.finish()
    assert stream.getvalue() == "first\nthird\n"


def test_quiet() -> None:
    stream = io.StringIO()
    line = ProgressLine(10, stream, quiet=True)
    line.update("first", milestone=True)
    line.finish()
    assert stream.getvalue() == ""


def test_time_left_is_proportional_from_the_first_result_on() -> None:
    line = ProgressLine(5, io.StringIO())
    assert line.time_left(0) == ""
    assert line.time_left(1) == "", "no pace yet; what came before was getting started"
    assert line._begin is not None
    line._begin = line._begin[0] - 30.0, 1
    assert line.time_left(2) == "1:30"
    assert line.time_left(5) == "0:00"


def test_due_says_what_update_does() -> None:
    stream = io.StringIO()
    line = ProgressLine(10, stream)
    assert line.due() and line.due(milestone=True)
    line.update("first")
    assert not line.due() and line.due(milestone=True)
    line.update("second")
    assert stream.getvalue() == "first\n"
    assert not ProgressLine(10, stream, quiet=True).due(milestone=True)


def test_counts() -> None:
    assert [counted(n, "pilot") for n in (0, 1, 2)] == ["0 pilots", "1 pilot", "2 pilots"]


def on_terminal(columns: int, *texts: str) -> str:
    """What a terminal of so many columns receives."""
    ours, theirs = pty.openpty()
    try:
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
        with open(theirs, "w", closefd=False) as stream:
            line = ProgressLine(10, stream)
            for text in texts:
                line.update(text, milestone=True)
            line.finish()
        received = b""
        while not received.endswith(b"\n"):  # the kernel may hand it over in pieces; `finish` ends with a newline
            received += os.read(ours, 65536)
        return received.decode()
    finally:
        os.close(ours)
        os.close(theirs)


def test_a_line_never_wraps() -> None:
    for columns in (5, 20, 80, len(LONG), len(LONG) + 1):
        drawn = on_terminal(columns, LONG, "short").strip("\r\n").split("\r")
        assert all(len(text) < columns for text in drawn)
        assert drawn[0].startswith(LONG[: columns // 2 - 2])
        assert drawn[-1].rstrip()[:5] == "short"[: max(1, columns - 4)] or columns == 5
        assert len(drawn[-1]) >= len(drawn[0]), "the rest of a longer line is wiped out"
    assert on_terminal(200, LONG) == f"\r{LONG}\r\n"


@pytest.mark.parametrize(
    ("columns", "wanted"),
    [
        (38, "smallest GM 1.82 dB, PM 34.1 deg"),
        (60, f"{PARTS[0]} | {PARTS[1]}"),
        (65, f"[####.....] {PARTS[0]} | {PARTS[1]}"),
        (80, f"[###...] {PARTS[0]} | {PARTS[1]} | {PARTS[2]}"),
        (130, f"[##########..........] {LONG}"),
    ],
)
def test_margins_and_time_left_come_first_and_a_bar_takes_what_is_left(columns: int, wanted: str) -> None:
    ours, theirs = pty.openpty()
    try:
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
        with open(theirs, "w", closefd=False) as stream:
            ProgressLine(10, stream).update(PARTS, share=0.5)
        drawn = os.read(ours, 65536).decode()
        assert drawn[1:] == wanted, drawn
        assert len(drawn) <= columns
    finally:
        os.close(ours)
        os.close(theirs)


def test_sentences_stand_on_lines_of_their_own() -> None:
    ours, theirs = pty.openpty()
    try:
        with open(theirs, "w", closefd=False) as stream:
            line = ProgressLine(10, stream)
            line.update("half")
            line.before(lambda sentence: print(sentence, file=stream, flush=True))("a note")
        received = b""
        while not received.endswith(b"note\r\n"):
            received += os.read(ours, 65536)
        assert received == b"\rhalf\r\na note\r\n"
    finally:
        os.close(ours)
        os.close(theirs)
