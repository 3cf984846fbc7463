"""`pilotgen loops`: what is printed, what is refused.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from pilotgen.cli import main
from pilotgen.context import EvaluationContext
from pilotgen.evaluation import evaluate
from pilotgen.linear.feedthrough import make_pilot_model
from pilotgen.linear.imposed_motion import Channels
from pilotgen.loop.mimo import close
from pilotgen.loop.plants import roll_plant
from pilotgen.solver.matrices import read_matrices
from pilotgen.study.study import read_study

STUDY = Path(__file__).parents[2] / "docs" / "studies" / "puma-bmi.yaml"


@pytest.fixture(scope="module")
def pilot(tmp_path_factory: pytest.TempPathFactory, mbdae: Path) -> Path:
    directory = tmp_path_factory.mktemp("pilot")
    study = read_study(STUDY)
    study = dataclasses.replace(study, pilot=dataclasses.replace(study.pilot, limbs=("left", "right")))
    with EvaluationContext(study, mbdae=str(mbdae)) as context:
        found = evaluate(context, study.nominal, keep=directory)
    found.pilot_model.write(directory / "pilot_model.h5")  # type: ignore[union-attr]
    return directory


def test_roll(pilot: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["loops", str(pilot), "--plant", "roll:uh60a", "--gearing", "lateral=1.099", "--seat", "0,0.5,0"]
    assert main([*arguments, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    model = make_pilot_model(
        read_matrices(pilot / "matrices.h5"), 0.32, 3.1, channels=Channels(inputs=("roll", "sway"))
    )
    loop = close(model, roll_plant(0.0723, 46.3, 0.05, 0.5), {"lateral": 1.099 * 0.6})
    poles = np.array([complex(*pair) for pair in data["closed_loop_poles"]])
    assert np.abs(np.sort_complex(poles) - np.sort_complex(loop.closed_loop_poles)).max() < 1e-3
    assert data["stable"] is bool(loop.closed_loop_poles.real.max() < 0.0)
    assert set(data["loops"]) == {"lateral"}
    assert main(arguments) == 0
    text = capsys.readouterr().out
    assert "roll with flapping, uh60a (derived from the roll damping" in text and "all loops        disk margin" in text


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--plant", "lynks", "--gearing", "lateral=1"], "plant 'lynks' is not known"),
        (["--plant", "roll:puma", "--gearing", "lateral=1"], "rotorcraft 'puma' is not known; known: oh58d"),
        (["--plant", "roll:uh60", "--gearing", "lateral=1"], "did you mean 'uh60a'?"),
        (["--plant", "lynx-hover", "--gearing", "latral=1"], "control 'latral' is not known; did you mean 'lateral'?"),
        (["--plant", "lynx-hover", "--gearing", "pedals=1"], "pedals are not modelled"),
        (["--plant", "lynx-hover", "--gearing", "lateral=x"], "one number for each control"),
        (["--plant", "lynx-hover", "--gearing", "lateral=1", "--seat", "1,2"], "--seat 1,2: three numbers"),
        (
            ["--plant", "roll:bo105", "--gearing", "collective=1"],
            "'collective' is not one of the plant; it has lateral",
        ),
    ],
)
def test_refusals(pilot: Path, capsys: pytest.CaptureFixture[str], more: list[str], message: str) -> None:
    assert main(["loops", str(pilot), *more]) == 1
    assert message in capsys.readouterr().err
