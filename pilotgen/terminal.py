"""What stands between the program and who started it: standard streams, colours, signals.

Everything that is printed goes through `SafeStream`. It shows control characters, wherever they come from (names in
files, a solver's words), as escapes; it colours a few words on a terminal; and an output that cannot be written does
not end what is being computed.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import io
import os
import re
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO

_HIDDEN = frozenset(("Cc", "Cf", "Cs", "Zl", "Zp"))  # Unicode categories that move a cursor or turn a line around
_RED, _YELLOW, _GREEN, _END = "\x1b[31m", "\x1b[33m", "\x1b[32m", "\x1b[0m"
_COLOURS = (
    (re.compile(r"^(pilotgen[a-z -]*: (?:internal )?(?:error|failed|incomplete|below limits):)", re.MULTILINE), _RED),
    (re.compile(r"^(pilotgen: note:)", re.MULTILINE), _YELLOW),
    (re.compile(r"\b(UNSTABLE|FAILS|NO)\b"), _RED),
    (re.compile(r"(?<=loop       )(stable)\b"), _GREEN),
)


def escaped(text: str) -> str:
    """Text with every character that would act on a terminal written as an escape; newlines and tabs stay."""
    if text.isascii() and text.isprintable():
        return text
    return "".join(_shown(character) for character in text)


def _shown(character: str) -> str:
    if character.isprintable() or character in "\n\t":
        return character
    import unicodedata

    return ascii(character)[1:-1] if unicodedata.category(character) in _HIDDEN else character


def wants_colour(stream: Any) -> bool:
    """Whether a stream is a terminal that takes colours, and nobody asked for none (NO_COLOR, TERM=dumb)."""
    return bool(not os.environ.get("NO_COLOR") and os.environ.get("TERM", "dumb") != "dumb" and stream.isatty())


class SafeStream(io.TextIOBase):
    """A standard stream: escapes what is written, colours it on a terminal, and keeps the first error for later.

    Parameters
    ----------
    stream : text stream
        Where text goes.

    Attributes
    ----------
    error : OSError or None
        Why something could not be written; everything after it is dropped.
    silent : bool
        Drop everything.
    """

    def __init__(self, stream: TextIO) -> None:
        self.error: OSError | None = None
        self.silent = False
        self._stream = stream
        self._colour = wants_colour(stream)

    def write(self, text: str) -> int:
        """Write text that may come from anywhere."""
        shown = escaped(text)
        if self._colour:
            for pattern, colour in _COLOURS:
                shown = pattern.sub(rf"{colour}\1{_END}", shown)
        self.raw_write(shown)
        return len(text)

    def raw_write(self, text: str) -> None:
        """Write text of ours, control characters and all."""
        if self.error is None and not self.silent:
            try:
                self._stream.write(text)
            except OSError as error:
                self._give_up(error)

    def flush(self) -> None:
        """Hand over what is buffered."""
        if self.error is None:
            try:
                self._stream.flush()
            except OSError as error:
                self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        self.error = error
        with suppress(OSError, ValueError):  # what is left in the buffer would fail again when Python ends
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, self._stream.fileno())
            os.close(null)

    def isatty(self) -> bool:
        """Whether a person reads it."""
        return self._stream.isatty()

    def fileno(self) -> int:
        """File descriptor of the stream."""
        return self._stream.fileno()

    def writable(self) -> bool:
        """Yes."""
        return True

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Of the stream."""
        return getattr(self._stream, "encoding", None) or "utf-8"


@contextmanager
def standard_streams() -> Iterator[tuple[SafeStream, SafeStream]]:
    """Standard output and standard error as safe streams, while the block runs.

    A stream that was closed before the program started is nothing: what goes there is dropped, and no file that is
    opened later takes its number.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this one
    before = sys.stdout, sys.stderr
    streams = []
    for number, stream in zip((1, 2), before, strict=True):
        stream = stream if stream is not None else os.fdopen(number, "w", encoding="utf-8", closefd=False)
        if isinstance(stream, io.TextIOWrapper):  # a degree sign must not end a run on an ASCII terminal
            stream.reconfigure(errors="backslashreplace")
        streams.append(SafeStream(stream))
    sys.stdout, sys.stderr = streams
    try:
        yield streams[0], streams[1]
    finally:
        for stream in streams:
            stream.flush()
        sys.stdout, sys.stderr = before


class Interrupted(KeyboardInterrupt):
    """A run was ended from outside.

    Attributes
    ----------
    signal : int
        The signal.
    kept : str
        What is kept of the run, in words; empty for nothing.
    """

    def __init__(self, number: int = signal.SIGINT, kept: str = "") -> None:
        super().__init__()
        self.signal, self.kept = number, kept


def stop_on_signals() -> None:
    """Have SIGTERM and SIGHUP end this process as Ctrl-C does: what was recorded is kept, workers are stopped.

    The signals raise Interrupted where the program is. A SIGHUP that is ignored (nohup) stays ignored.
    """

    def interrupt(number: int, _: object) -> None:
        raise Interrupted(number)

    if threading.current_thread() is not threading.main_thread():
        return
    signal.signal(signal.SIGTERM, interrupt)
    if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        signal.signal(signal.SIGHUP, interrupt)
