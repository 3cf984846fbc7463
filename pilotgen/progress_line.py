"""One live line on a terminal, plain lines everywhere else.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any, TextIO

from pilotgen.terminal import escaped

REDRAW_INTERVAL_S = 0.1
PLAIN_INTERVAL_S = 10.0


def format_duration(seconds: float) -> str:
    """`83.4` -> `1:23`, `4000` -> `1:06:40`."""
    total = max(0, round(seconds))
    hours, rest = divmod(total, 3600)
    minutes, secs = divmod(rest, 60)
    return f"{hours}:{minutes:02d}:{secs:02d}" if hours else f"{minutes}:{secs:02d}"


def counted(number: int, noun: str) -> str:
    """`1 pilot`, `2 pilots`."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


BAR_WIDTH = 20  # characters, at most
SEPARATOR = " | "


def bar(share: float, width: int = BAR_WIDTH) -> str:
    """`[#####...............]` for a quarter."""
    done = round(width * min(1.0, max(0.0, share)))
    return f"[{'#' * done}{'.' * (width - done)}]"


class ProgressLine:
    """Shows how far a run is.

    On a terminal one line is redrawn in place: a bar, then what fits of the parts, which come in the order of their
    importance. Elsewhere a line with all parts is printed at every `milestone` and at most every ten seconds between
    them. Whoever has a line to compose asks first whether it is `due`.
    """

    def __init__(self, total: int, stream: TextIO | None = None, quiet: bool = False) -> None:
        self._stream: Any = stream if stream is not None else sys.stderr
        self._live = self._stream.isatty() and not quiet
        self._write = getattr(self._stream, "raw_write", self._stream.write)  # unescaped: carriage returns
        self._quiet = quiet
        self._total = total
        self._begin: tuple[float, int] | None = None  # when work was first seen to be done, and how much
        self._last = -float("inf")
        self._width = 0

    def time_left(self, done: int, total: int | None = None) -> str:
        """Estimated time left, as text; empty before the pace is known. Getting started is not counted."""
        all_ = self._total if total is None else total
        now = time.monotonic()
        if self._begin is None and done > 0:
            self._begin = now, done
        if self._begin is None or done <= self._begin[1] or all_ <= 0:
            return ""
        pace_s = (now - self._begin[0]) / (done - self._begin[1])
        return format_duration(pace_s * max(0, all_ - done))

    def due(self, milestone: bool = False) -> bool:
        """Whether `update` would show anything now."""
        if self._quiet:
            return False
        return milestone or time.monotonic() - self._last >= (REDRAW_INTERVAL_S if self._live else PLAIN_INTERVAL_S)

    def update(self, parts: str | Sequence[str], milestone: bool = False, share: float | None = None) -> None:
        """Show how far it is.

        Parameters
        ----------
        parts : str or sequence of str
            What to tell, most important first; empty ones are left out.
        milestone : bool
            Shown also where lines are not redrawn.
        share : float, optional
            Share of the work that is done, for the bar.
        """
        if not self.due(milestone):
            return
        told = [escaped(part) for part in ([parts] if isinstance(parts, str) else parts) if part]
        if self._live:
            text = self._fitted(told, share)
            self._write("\r" + text.ljust(self._width))
            self._width = len(text)
        else:
            self._stream.write(SEPARATOR.join(told) + "\n")
        self._stream.flush()
        self._last = time.monotonic()

    def _fitted(self, parts: list[str], share: float | None) -> str:
        """What fits on the terminal's line: a line that wraps cannot be redrawn in place."""
        try:
            columns = os.get_terminal_size(self._stream.fileno()).columns
        except (OSError, ValueError):  # no file behind the stream
            columns = 0
        columns = columns or 80  # a terminal that does not know its width says 0
        text = parts[0]
        if len(text) >= columns:
            return text[: max(0, columns - 4)] + "..."[: max(0, columns - 1)]
        for part in parts[1:]:
            if len(text) + len(SEPARATOR) + len(part) < columns:
                text += SEPARATOR + part
        left = columns - 1 - len(text)
        if share is not None and left >= 8:
            text = f"{bar(share, min(BAR_WIDTH, left - 3))} {text}"
        return text

    def finish(self) -> None:
        """Leave the line standing."""
        if self._live and self._width:
            self._write("\n")
            self._stream.flush()
            self._width = 0

    def before(self, say: Callable[[str], None]) -> Callable[[str], None]:
        """`say`, on a line of its own."""

        def said(sentence: str) -> None:
            self.finish()
            say(sentence)

        return said
