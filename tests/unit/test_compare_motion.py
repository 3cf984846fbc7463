"""Histories of MBDyn against ours: what agrees, what is named, what is refused.

The rows are MBDyn's own (develop, 2025): a lever and a helicopter in a loop of genels, every tenth step.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from pilotgen.cli import main
from pilotgen.errors import FileError, MatrixError
from pilotgen.linear.compare_motion import _by_euler123, compare_motion, report
from pilotgen.solver.client import SolverClient, find_mbdae

DATA = Path(__file__).parents[1] / "data"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory with deck, our history and MBDyn's files."""
    directory = tmp_path_factory.mktemp("motion")
    stored = np.load(DATA / "mbdyn_motion" / "g03_loop_net.npz")
    (directory / "deck.mbd").write_text(str(stored["deck"]))
    integrate(directory / "deck.mbd", directory / "ours")
    for suffix in ("mov", "jnt", "ine"):
        keys = [key for key in stored.files if key.startswith(f"h_{suffix}_")]
        with (directory / f"theirs.{suffix}").open("w") as file:
            for i in range(len(stored[keys[0]])):
                for key in keys:
                    row = " ".join(repr(float(x)) for x in stored[key][i])
                    file.write(f"{key.rpartition('_')[2]} {row}\n")
    return directory


def integrate(deck: Path, prefix: Path) -> None:
    subprocess.run(
        [find_mbdae(), deck, "--integrate", "--integrator", "ms", "-q", "-o", prefix],
        check=True,
        stdout=subprocess.PIPE,
    )


@pytest.mark.parametrize(("suffix", "tolerance"), [("mov", 1e-6), ("ine", 1e-6), ("jnt", 1e-2)])
def test_the_histories_agree(run: Path, suffix: str, tolerance: float) -> None:
    with SolverClient() as client:
        found = compare_motion(run / "deck.mbd", run / "ours.motion.h5", run / f"theirs.{suffix}", client, tolerance)
    assert found.agree and found.rows == 201 and not found.left_out
    kinds = {channel.kind for channel in found.channels}
    assert (
        kinds
        == {
            "mov": {"position", "orientation", "velocity", "angular velocity"},
            "ine": {"momentum", "momenta moment"},
            "jnt": {"reaction force", "reaction moment"},
        }[suffix]
    )
    assert "agree" in report(found)


def test_a_difference_is_named(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = (run / "theirs.mov").read_text().splitlines()
    cells = lines[100].split()
    cells[2] = repr(float(cells[2]) + 1e-3)
    lines[100] = " ".join(cells)
    other = tmp_path / "other.mov"
    other.write_text("\n".join(lines) + "\n")
    code = main(["compare-motion", str(run / "deck.mbd"), str(run / "ours.motion.h5"), str(other)])
    out = capsys.readouterr().out
    assert code == 3 and "DIFFER" in out
    assert ".y at 0.5 s" in out  # row 50 of two nodes, every tenth of 1 ms


def test_a_netcdf_history_agrees(tmp_path: Path) -> None:
    deck = tmp_path / "c08a.mbd"
    shutil.copy(DATA / "mbdyn_cases" / "c08a_muscle_pennestri.mbd", deck)
    integrate(deck, tmp_path / "ours")
    with SolverClient() as client:
        found = compare_motion(
            deck, tmp_path / "ours.motion.h5", DATA / "mbdyn_cases" / "c08a_muscle_pennestri.nc", client, 1e-5
        )
    assert found.rows == 2
    assert {"position", "velocity", "momentum", "reaction force"} <= {channel.kind for channel in found.channels}
    at_start = [channel for channel in found.channels if channel.kind == "position"]
    assert max(channel.relative for channel in at_start) < 1e-5


def test_angles_of_the_default_orientation() -> None:
    R = _by_euler123(np.array([10.0, 20.0, 30.0]))
    a, b, c = np.radians([10.0, 20.0, 30.0])
    expected = (
        np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
        @ np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
        @ np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    )
    assert pytest.approx(expected, abs=1e-15) == R


@pytest.mark.parametrize(
    ("name", "text", "error", "words"),
    [
        ("x.mov", "1 0. 0.\n1 zero 0.\n", MatrixError, "x.mov:2: is not a label with numbers"),
        ("x.mov", "1 0. 0.\n2 0. 0.\n1 0. 0.\n", MatrixError, "same number of rows"),
        ("x.mov", "", MatrixError, "no row in it"),
        ("x.mov", "1 0. 0.\n", MatrixError, "label 1 has 2 columns beside it, 12 or 18 or 24 are wanted"),
        ("x.mov", ("1 " + "0. " * 12 + "\n") * 7, MatrixError, "has 7 instants and our history 2001"),
        ("x.txt", "", FileError, "expected a history of MBDyn, one of .mov"),
        ("x.nc", "CDF", MatrixError, "is not a NetCDF file"),
        ("x.mov", "77 " + "0. " * 12 + "\n" + "77 " + "0. " * 12 + "\n", MatrixError, "node 77: not in our history"),
    ],
)
def test_what_is_no_history_is_refused(
    run: Path, tmp_path: Path, name: str, text: str, error: type[Exception], words: str
) -> None:
    path = tmp_path / name
    path.write_text(text)
    with SolverClient() as client, pytest.raises(error, match=words.replace(".", r"\.")):
        compare_motion(run / "deck.mbd", run / "ours.motion.h5", path, client)


def test_a_node_at_rest_and_a_number_that_is_none(run: Path, tmp_path: Path) -> None:
    rows = (run / "theirs.mov").read_text().splitlines()
    alone = tmp_path / "alone.mov"
    alone.write_text("\n".join(row for row in rows if row.startswith("1 ")))  # it does not turn: 1e-24 beside zero
    with SolverClient() as client:
        assert compare_motion(run / "deck.mbd", run / "ours.motion.h5", alone, client).agree
        rows[40] = " ".join([*rows[40].split()[:3], "nan", *rows[40].split()[4:]])
        alone.write_text("\n".join(rows))
        with pytest.raises(MatrixError, match="has a value that is not a finite number at instant"):
            compare_motion(run / "deck.mbd", run / "ours.motion.h5", alone, client)
