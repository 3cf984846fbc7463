"""Motions of head and hands, moments on the controls: against full-order solves, the lever's inertia, the seat tests.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pilotgen.cli import main
from pilotgen.context import EvaluationContext
from pilotgen.errors import StudyError
from pilotgen.evaluation import SolvedPilot, solve_pilot
from pilotgen.linear.feedthrough import certificates, make_pilot_model
from pilotgen.linear.imposed_motion import HANDS, HEAD, MOMENTS, SEAT_MOTIONS, Channels, rotations
from pilotgen.linear.pilot_model import PilotModel, read_pilot_model
from pilotgen.study.study import read_study
from pilotgen.virtual.seat_vibration import seat_vibration

STUDY = Path(__file__).parents[2] / "docs" / "studies" / "puma-bmi.yaml"
OMEGA = 2.0 * np.pi * np.geomspace(0.3, 12.0, 25)
INERTIA = {"collective": 0.05, "cyclic_aft": 0.1, "cyclic_right": 0.1}  # kg m^2, about hinge and pivot; balanced


@pytest.fixture(scope="module")
def solved(mbdae: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[SolvedPilot, Path]:
    directory = tmp_path_factory.mktemp("pilot")
    study, _ = read_study(STUDY).with_values({"pilot.limbs": ["left", "right"]})
    with EvaluationContext(study, mbdae=str(mbdae)) as context:
        return solve_pilot(context, study.nominal, directory), directory


@pytest.fixture(scope="module")
def model(solved: tuple[SolvedPilot, Path]) -> PilotModel:
    channels = Channels(
        inputs=tuple(SEAT_MOTIONS), point_m=(0.1, -0.4, 0.0), outputs={**rotations(), **HEAD, **HANDS},
        moments=tuple(MOMENTS),
    )  # fmt: skip
    matrices = solved[0].matrices
    assert matrices is not None
    return make_pilot_model(matrices, 0.32, None, channels=channels)


def test_every_entry_is_that_of_the_full_order_model(model: PilotModel) -> None:
    assert model.outputs == (*rotations(), *HEAD, *HANDS, *MOMENTS)
    assert certificates(model).max() < 1e-6
    names, units = model.all_outputs(washout=False)[4:]
    told = dict(zip(names, units, strict=True))
    assert (told["head_up"], told["head_pitch"], told["left_hand_up"], told["hand_moment_collective"]) == (
        "m", "rad", "m", "N m",
    )  # fmt: skip


@pytest.mark.parametrize("control", list(INERTIA))
@pytest.mark.parametrize("motion", list(SEAT_MOTIONS))
def test_the_hand_moves_the_control(model: PilotModel, control: str, motion: str) -> None:
    """Moment = inertia times angular acceleration, that of the seat included: the controls are balanced and free."""
    rotation = model.outputs.index(f"{control}_rotation" if control == "collective" else control)
    moment = model.outputs.index(f"hand_moment_{control}")
    k = list(SEAT_MOTIONS).index(motion)
    turn = {"collective": "pitch", "cyclic_aft": "pitch", "cyclic_right": "roll"}[control]
    carried = 1.0 if motion == turn else 0.0
    turned = model.response(OMEGA, rotation, washout=False, input=k)
    expected = INERTIA[control] * (carried - OMEGA**2 * turned)
    found = model.response(OMEGA, moment, washout=False, input=k)
    assert np.abs(found - expected).max() < 1e-7 * np.abs(found).max()


def test_head_and_hands(model: PilotModel, solved: tuple[SolvedPilot, Path]) -> None:
    """The head as the seat tests have it; the left hand turns with the lever."""
    found = seat_vibration(solved[0], OMEGA / (2.0 * np.pi))
    for name, quantity, own in (("head_up", "head", 1.0), ("head_forward", "head_fore_aft", 0.0)):
        moved = own - OMEGA**2 * model.response(OMEGA, model.outputs.index(name), washout=False)
        assert_allclose(moved, found.responses[quantity], rtol=1e-6)
    up, forward = (model.response(OMEGA, model.outputs.index(f"left_hand_{name}"), washout=False)
                   for name in ("up", "forward"))  # fmt: skip
    travel = np.hypot(np.abs(up), np.abs(forward)) / np.abs(model.response(OMEGA, 0, washout=False))
    assert np.ptp(travel) < 1e-6 and 0.25 < travel[0] < 0.45  # m: hinge to the hand's centre of mass


def test_export(solved: tuple[SolvedPilot, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pilot, directory = solved
    assert pilot.matrices is not None
    make_pilot_model(pilot.matrices, 0.32, 3.1).write(directory / "pilot_model.h5")
    more = ["export", str(directory), "--also", "head,hands,moments"]
    assert main([*more, "--format", "json", "-o", str(tmp_path / "a.json")]) == 0
    outputs = {one["name"]: one["unit"] for one in json.loads((tmp_path / "a.json").read_text())["outputs"]}
    assert list(outputs) == [*rotations(), *HEAD, *HANDS, *MOMENTS, "grip_motion"]
    assert main([*more, "-o", str(tmp_path / "a.h5")]) == 0  # the format is that of the name
    again = read_pilot_model(tmp_path / "a.h5")
    assert again.outputs == tuple(outputs)[:-1]
    assert main(["export", str(directory), "--also", "feet", "-o", str(tmp_path / "b.json")]) == 1
    assert "'feet' is not known; known: head, hands, moments" in capsys.readouterr().err
    assert main(["export", str(directory), "--axes", "heav", "-o", str(tmp_path / "b.json")]) == 1
    assert "seat motion 'heav' is not known; did you mean 'heave'?" in capsys.readouterr().err
    assert main(["export", str(tmp_path), "-o", str(tmp_path / "b.json")]) == 1
    assert "PILOTDIR is the output directory of `pilotgen pilot`" in capsys.readouterr().err
    with pytest.raises(StudyError, match="moment 'x' is not known"):
        Channels(moments=("x",))
    with pytest.raises(StudyError, match="knows no moments of the hands"):
        make_pilot_model(pilot.matrices, 0.32, 3.1, "literal", Channels(moments=("hand_moment_collective",)))
