"""Floors: what the machine asks for the bare operations, without any of this program around them.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import sqlite3
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import scipy.linalg

from pilotgen.bench.machine import run

REDUCED_STATES = 20  # about the free states of one arm with reflexes and lever


def _milliseconds(work: Callable[[], object], repeat: int = 20) -> list[float]:
    work()
    times = []
    for _ in range(repeat):
        start = time.process_time()
        work()
        times.append(1e3 * (time.process_time() - start))
    return times


def measure(n: int, mbdae: Path, result_text: str) -> dict[str, list[float]]:
    """CPU times of bare operations [ms], several of each.

    Parameters
    ----------
    n : int
        Number of unknowns of a pilot's model: the size of the matrices.
    mbdae : Path
        The solver.
    result_text : str
        A result object as the journal keeps it.
    """
    rng = np.random.default_rng(0)
    A, B = rng.standard_normal((n, n)), rng.standard_normal((n, n))
    small = rng.standard_normal((REDUCED_STATES, REDUCED_STATES))
    floors = {
        "start of a process (true)": [1e3 * run(["true"]).cpu_s for _ in range(10)],
        "start of mbdae (--version)": [1e3 * run([str(mbdae), "--version"]).cpu_s for _ in range(10)],
        "start of python": [1e3 * run([sys.executable, "-c", "pass"]).cpu_s for _ in range(5)],
        "start of python with numpy and h5py": [
            1e3 * run([sys.executable, "-c", "import numpy, h5py"]).cpu_s for _ in range(3)
        ],
        f"LU of {n} x {n}": _milliseconds(lambda: scipy.linalg.lu_factor(A, check_finite=False)),
        f"generalised eigenvalues of {n} x {n}, vectors too (not used)": _milliseconds(
            lambda: scipy.linalg.eig(A, B, left=True, right=True, check_finite=False), 3
        ),
        f"eigenvalues of {REDUCED_STATES} x {REDUCED_STATES}, vectors too": _milliseconds(
            lambda: scipy.linalg.eig(small, left=True, right=True, check_finite=False)
        ),
        "JSON of a result": _milliseconds(lambda: json.dumps(json.loads(result_text))),
    }
    shared = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=shared if shared.is_dir() else None) as directory:
        path = Path(directory) / "two.h5"

        def write() -> None:
            with h5py.File(path, "w") as file:
                file["J_plus"], file["J_minus"] = A, B

        def read() -> None:
            with h5py.File(path, "r") as file:
                for name in ("J_plus", "J_minus"):
                    file[name][:]

        floors[f"HDF5, write two {n} x {n}"] = _milliseconds(write)
        floors[f"HDF5, read two {n} x {n}"] = _milliseconds(read)
    with tempfile.TemporaryDirectory() as directory:
        db = sqlite3.connect(Path(directory) / "j.sqlite", isolation_level=None)
        db.execute("PRAGMA journal_mode=WAL")
        db.execute("PRAGMA synchronous=NORMAL")
        db.execute("CREATE TABLE t (key TEXT PRIMARY KEY, result TEXT) WITHOUT ROWID")
        keys = iter(range(10_000))
        floors["SQLite, commit a result"] = _milliseconds(
            lambda: db.execute("INSERT INTO t VALUES (?, ?)", (f"{next(keys):064d}", result_text)), 200
        )
        db.close()
    return floors
