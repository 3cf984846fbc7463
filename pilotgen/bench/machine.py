"""The machine, its clocks, and programs run under a stopwatch.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any


def describe() -> dict[str, Any]:
    """Processor, cores, memory, kernel and versions, and how busy the machine is."""
    model = "unknown"
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            model = line.partition(":")[2].strip()
            break
    return {
        "processor": model,
        "cores": len(os.sched_getaffinity(0)),
        "memory_gib": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "packages": {name: version(name) for name in ("numpy", "scipy", "h5py", "daqp")},
        "load_average": [round(value, 1) for value in os.getloadavg()],
    }


def process_cpu_s(pid: int) -> float:
    """CPU time of another process so far [s], to the nanosecond (Linux, Documentation/scheduler/sched-stats)."""
    return int(Path(f"/proc/{pid}/schedstat").read_text().split()[0]) * 1e-9


@dataclass(frozen=True)
class Ran:
    """A program that has run: CPU time with all its children and wall time [s], largest resident set [MiB], output."""

    cpu_s: float
    wall_s: float
    memory_mib: float
    output: str


def run(command: Sequence[str]) -> Ran:
    """Run a program to its end; RuntimeError with its last stderr lines when it fails."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    start = time.monotonic()
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment
    ) as process:
        assert process.stdout is not None
        output = process.stdout.read()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    wall_s = time.monotonic() - start
    if process.returncode != 0:
        last = (output.strip().splitlines() or ["it said nothing"])[-1]
        raise RuntimeError(f"{' '.join(command)} ended with exit code {process.returncode}: {last}")
    return Ran(usage.ru_utime + usage.ru_stime, wall_s, usage.ru_maxrss / 1024.0, output)


def pilotgen(*arguments: str) -> Ran:
    """Run the `pilotgen` command in a new process."""
    return run([sys.executable, "-m", "pilotgen", *arguments])
