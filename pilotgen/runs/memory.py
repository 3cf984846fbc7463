"""Memory of processes, as Linux tells it in /proc.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import glob
import re
from contextlib import suppress


def resident_bytes(pid: int | None) -> int:
    """Resident memory that a process has now [bytes]; 0 of one that is gone."""
    return _kilobytes(f"/proc/{pid}/status", "VmRSS") * 1024


def peak_bytes(pid: int | None) -> int:
    """Largest resident memory that a process had so far [bytes]; 0 of one that is gone."""
    return _kilobytes(f"/proc/{pid}/status", "VmHWM") * 1024


def peak_with_children_bytes(pid: int | None) -> int:
    """Sum of the largest resident memories that a process and its children had so far [bytes]; 0 if it is gone."""
    children: set[int] = set()
    for path in glob.glob(f"/proc/{pid}/task/*/children"):  # a child belongs to the thread that started it
        with suppress(OSError, ValueError), open(path, encoding="ascii") as file:
            children.update(map(int, file.read().split()))
    return sum(peak_bytes(one) for one in (pid, *children))


def free_bytes() -> int:
    """What the machine has left for new processes [bytes]; 0 if it does not tell."""
    return _kilobytes("/proc/meminfo", "MemAvailable") * 1024


def _kilobytes(path: str, name: str) -> int:
    with suppress(OSError), open(path, encoding="utf-8", errors="replace") as file:
        found = re.search(rf"^{name}:\s*(\d+) kB", file.read(), re.MULTILINE)
        if found:
            return int(found[1])
    return 0
