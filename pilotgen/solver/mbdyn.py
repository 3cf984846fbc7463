"""Run an installed MBDyn on a deck.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

from pilotgen.errors import FileError, SolverError
from pilotgen.solver.client import named_executable, signal_name


def find_mbdyn(option: str | os.PathLike[str] | None = None) -> Path:
    """Return the path of MBDyn's executable: `option`, the environment variable PILOTGEN_MBDYN, or PATH.

    FileError if there is none.
    """
    named = named_executable(option, "--mbdyn", "PILOTGEN_MBDYN")
    if named is not None:
        return named
    on_path = shutil.which("mbdyn")
    if on_path is not None:
        return Path(on_path)
    raise FileError(
        "MBDyn is not installed: no 'mbdyn' on PATH and PILOTGEN_MBDYN is not set. "
        "Install MBDyn with module-muscles, or use the solver that comes with pilotgen (--solver mbdae)"
    )


def run_mbdyn(
    deck_path: str | os.PathLike[str],
    workdir: str | os.PathLike[str],
    executable: str | os.PathLike[str] | None = None,
    timeout_s: float = 120.0,
) -> Path:
    """Run MBDyn on a deck and return its result file: NetCDF `PREFIX.nc`, else the eigenanalysis text `PREFIX_00.m`.

    Parameters
    ----------
    deck_path : the deck
    workdir : directory for MBDyn's output, made if it is missing; the prefix is the deck's name without extension
    executable : path of `mbdyn`; None = `find_mbdyn`
    timeout_s : time limit [s]

    Raises
    ------
    FileError
        no MBDyn, no deck, or an unusable directory
    SolverError
        stage "solver": MBDyn refused the deck, died, took too long or left no result.
    """
    mbdyn = find_mbdyn(executable)
    deck = Path(deck_path).resolve()
    if not deck.is_file():
        raise FileError(f"cannot read the deck '{deck_path}': no such file")
    directory = Path(workdir)
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"cannot use '{workdir}' for MBDyn's output: {error.strerror}") from error
    prefix = directory.resolve() / deck.stem
    candidates = (prefix.with_name(f"{deck.stem}.nc"), prefix.with_name(f"{deck.stem}_00.m"))
    for stale in candidates:
        stale.unlink(missing_ok=True)  # of an earlier run: must not pass for the result of this one
    try:
        done = subprocess.run(
            [str(mbdyn), "-f", str(deck), "-o", str(prefix)],
            cwd=directory,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise SolverError(
            "solver", f"mbdyn did not finish {deck.name} within {timeout_s:g} s and was stopped"
        ) from None
    except OSError as error:
        raise FileError(f"cannot start '{mbdyn}': {error.strerror}") from error
    text = done.stdout.decode(errors="replace")
    (directory / f"{deck.stem}.log.txt").write_text(text)
    if done.returncode < 0:
        raise SolverError("solver", f"mbdyn died with signal {signal_name(-done.returncode)} on {deck.name}")
    if done.returncode != 0:
        words = _mbdyn_words(text)
        raise SolverError("solver", f"mbdyn ended with exit code {done.returncode} on {deck.name}: {words}")
    for result in candidates:
        if result.is_file():
            return result
    raise SolverError(
        "solver",
        f"mbdyn finished {deck.name} but left neither {candidates[0].name} nor {candidates[1].name}; "
        "the deck needs an eigenanalysis card with 'output matrices' (and 'output results: netcdf' for .nc)",
    )


_LAST_WORDS = "an error occurred during the execution of mbdyn"  # MBDyn's last line, whatever the reason was


def _mbdyn_words(text: str) -> str:
    """The line of MBDyn's output that tells why it ended.

    MBDyn ends with a sentence that gives no reason; the reason stands some lines above it, after the names of the
    routines that it passed through.
    """
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    while lines and lines[-1].lower().startswith(_LAST_WORDS):
        lines.pop()
    reasons = [line for line in lines if any(word in line.lower() for word in _REASON_WORDS)]
    return (reasons or lines or ["no message"])[-1][:300]


_REASON_WORDS = ("error", "does not converge", "reached maximum", "unable", "not supported", "unknown", "aborting")
