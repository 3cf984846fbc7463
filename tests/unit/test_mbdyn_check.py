"""What `check-mbdyn` predicts, on decks that the real MBDyn ran or refused.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest

from pilotgen.bench.stages import random_pilots
from pilotgen.cli import main
from pilotgen.context import EvaluationContext
from pilotgen.errors import FileError
from pilotgen.evaluation import DECK_NAMES, solve_pilot
from pilotgen.solver.client import SolverClient
from pilotgen.solver.mbdyn_check import check_mbdyn
from pilotgen.solver.mbdyn_files import read_m
from pilotgen.study.study import study_from_text

DATA = Path(__file__).parents[1] / "data" / "mbdyn_start"
STUDIES = Path(__file__).parents[2] / "docs" / "studies"


def test_an_open_chain_is_not_assembled() -> None:
    with SolverClient() as client:
        prediction = check_mbdyn(DATA / "posture_initial_assembly.mbd", client)
    assert prediction.assembly_fails and not prediction.runs
    assert "joint grip_l is open by 0.00424 m" in prediction.assembly


def test_the_derivatives_phase_stalls_where_mbdyn_does() -> None:
    with SolverClient() as client:
        prediction = check_mbdyn(DATA / "pilot_derivatives.mbd", client)
    assert prediction.derivatives_fail and not prediction.assembly_fails
    assert prediction.residuals[-1] == pytest.approx(3e-8, rel=0.1)  # MBDyn: stalls at 3e-8


def test_a_looser_tolerance_lets_the_same_deck_start(tmp_path: Path) -> None:
    text = (DATA / "pilot_derivatives.mbd").read_text()
    deck = tmp_path / "pilot.mbd"
    deck.write_text(text.replace("derivatives tolerance: 1.e-9", "derivatives tolerance: 1.e-7"))
    with SolverClient() as client:
        assert check_mbdyn(deck, client).runs  # as on MBDyn


@pytest.mark.parametrize(
    ("sex", "limbs", "count"), [("male", "left", 60), ("female", "left", 60), ("male", "left, right", 40)]
)
def test_no_deck_of_random_pilots_fails(tmp_path: Path, sex: str, limbs: str, count: int) -> None:
    text = (STUDIES / "puma-bmi.yaml").read_text()
    study = study_from_text(text.replace("sex: male", f"sex: {sex}").replace("limbs: [left]", f"limbs: [{limbs}]"))
    with EvaluationContext(study) as context, SolverClient() as client:
        for values in random_pilots(study, count):
            solve_pilot(context, values, tmp_path, linearise=False)
            for name in DECK_NAMES:
                prediction = check_mbdyn(tmp_path / name, client)
                assert prediction.runs, prediction


def test_what_needs_no_iteration_needs_no_card(tmp_path: Path) -> None:
    text = (DATA / "pilot_derivatives.mbd").read_text().replace("initial value;", "multistep;")
    deck = tmp_path / "pilot.mbd"
    deck.write_text(
        text.replace("problem: multistep", "integrator: multistep")
        .replace("derivatives max iterations: 50;", "")
        .replace("derivatives tolerance: 1.e-9;", "derivatives tolerance: 1.e9;")
    )
    with SolverClient() as client:
        prediction = check_mbdyn(deck, client)
    assert prediction.runs
    assert "pass after 0 iterations" in prediction.derivatives


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("derivatives max iterations: 50;", "", "no card 'derivatives max iterations'"),
        ("time step: 0.001;", "time step: H;", "'time step: H' is not a plain number"),
        ("derivatives coefficient: 1.;", "derivatives coefficient: 1., auto;", "is not a plain number"),
        ("begin: control data;", "begin: control;", "no block 'control data'"),
    ],
)
def test_what_cannot_be_told_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = (DATA / "pilot_derivatives.mbd").read_text()
    assert old in text
    deck = tmp_path / "pilot.mbd"
    deck.write_text(text.replace(old, new))
    with SolverClient() as client, pytest.raises(FileError, match=words):
        check_mbdyn(deck, client)


def test_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check-mbdyn", str(DATA / "pilot_derivatives.mbd")]) == 3
    assert "FAILS on MBDyn" in capsys.readouterr().out
    assert main(["check-mbdyn", "missing.mbd"]) == 1
    assert "missing.mbd" in capsys.readouterr().err


def test_a_sparse_text_file_is_read(tmp_path: Path) -> None:
    text = gzip.decompress((DATA / "sparse_text_00.m.gz").read_bytes())
    path = tmp_path / "sparse_00.m"
    path.write_bytes(text)
    raw = read_m(str(path))
    assert raw.Aplus.shape == raw.Aminus.shape == (100, 100) and raw.c == 0.01
    assert raw.Aplus[0, 0] == 1.00487001949271928e03
    with SolverClient() as client:
        client.request("linearise", name=DATA / "sparse_text.mbd", output=tmp_path / "own.h5")
    assert main(["compare", str(tmp_path / "own.h5"), str(path)]) == 0
