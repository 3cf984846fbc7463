"""Workers of a batch that are none.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any


class SerialWorkers:
    """No workers at all: everything in this process, in order."""

    def warm_up(self, function: Callable[[Any], Any], task: Any) -> None:
        """Nobody to warm up."""

    def run(self, function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[tuple[int, Any]]:
        """Yield (index of the task, result), one after the other."""
        for index, task in enumerate(tasks):
            yield index, function(task)

    def memory_bytes(self) -> int:
        """No processes, no memory of theirs."""
        return 0

    def close(self) -> None:
        """Nothing to close."""
