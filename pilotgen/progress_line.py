"""One live line on a terminal, plain lines everywhere else.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
import sys
import time
from typing import TextIO

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


class ProgressLine:
    """Shows how far a run is.

    On a terminal one line is redrawn in place; elsewhere a line is printed at every `milestone` and at most every ten
    seconds between them. Whoever has a line to compose asks first whether it is `due`.
    """

    def __init__(self, total: int, stream: TextIO | None = None, quiet: bool = False) -> None:
        self._stream = stream if stream is not None else sys.stderr
        self._live = self._stream.isatty() and not quiet
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

    def update(self, text: str, milestone: bool = False) -> None:
        """Show `text`; often enough on a terminal, at milestones elsewhere."""
        if not self.due(milestone):
            return
        if self._live:
            text = self._fitted(text)
            self._stream.write("\r" + text.ljust(self._width))
            self._width = len(text)
        else:
            self._stream.write(text + "\n")
        self._stream.flush()
        self._last = time.monotonic()

    def _fitted(self, text: str) -> str:
        """What fits on the terminal's line: a line that wraps cannot be redrawn in place."""
        try:
            columns = os.get_terminal_size(self._stream.fileno()).columns
        except (OSError, ValueError):  # no file behind the stream
            return text
        return text if len(text) < columns else text[: max(0, columns - 4)] + "..."

    def finish(self) -> None:
        """Leave the line standing."""
        if self._live and self._width:
            self._stream.write("\n")
            self._stream.flush()
