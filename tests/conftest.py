"""What tests share: the solver's path and reference data.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

# One thread for numerical libraries, as in the program's workers; must be said before they are imported.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
# Figures go to files.
os.environ.setdefault("MPLBACKEND", "Agg")

import pytest  # noqa: E402
from command_line import Run  # noqa: E402

from pilotgen.cli import main  # noqa: E402
from pilotgen.solver.client import SolverClient, find_mbdae  # noqa: E402


@pytest.fixture(scope="session")
def mbdae() -> Path:
    """Path of the solver. Tests that need it fail without it: they do not skip."""
    return find_mbdae()


@pytest.fixture(scope="session")
def solver(mbdae: Path) -> Iterator[SolverClient]:
    """A running solver, one for the session."""
    with SolverClient(mbdae) as client:
        yield client


@pytest.fixture(scope="session")
def data_directory() -> Path:
    """tests/data: reference results with their sources."""
    return Path(__file__).parent / "data"


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run a command line in this process; returns exit code, standard output, standard error."""
    monkeypatch.delenv("PILOTGEN_DEBUG", raising=False)

    def call(*arguments: object) -> tuple[int, str, str]:
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as leave:
            code = int(leave.code or 0)
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call
