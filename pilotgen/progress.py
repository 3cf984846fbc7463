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


class ProgressLine:
    """Shows how far a run is.

    On a terminal one line is redrawn in place; elsewhere a line is printed at every `milestone` and at most every ten
    seconds between them.
    """

    def __init__(self, total: int, stream: TextIO | None = None, quiet: bool = False) -> None:
        self._stream = stream if stream is not None else sys.stderr
        self._live = self._stream.isatty() and not quiet
        self._quiet = quiet
        self._total = total
        self._start = time.monotonic()
        self._last = -float("inf")
        self._width = 0

    def time_left(self, done: int, total: int | None = None) -> str:
        """Estimated time left, as text; empty before anything is done."""
        all_ = self._total if total is None else total
        elapsed = time.monotonic() - self._start
        if done <= 0 or all_ <= 0:
            return ""
        return format_duration(elapsed * max(0, all_ - done) / done)

    def update(self, text: str, milestone: bool = False) -> None:
        """Show `text`; often enough on a terminal, at milestones elsewhere."""
        if self._quiet:
            return
        now = time.monotonic()
        if self._live:
            if not milestone and now - self._last < REDRAW_INTERVAL_S:
                return
            text = self._fitted(text)
            self._stream.write("\r" + text.ljust(self._width))
            self._width = len(text)
            self._stream.flush()
            self._last = now
        elif milestone or now - self._last >= PLAIN_INTERVAL_S:
            self._stream.write(text + "\n")
            self._stream.flush()
            self._last = now

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
