"""Tasks: position, relax and force make different pilots of one body, and different loops.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from pilotgen.context import EvaluationContext
from pilotgen.evaluation import Evaluation, evaluate
from pilotgen.study.study import read_study
from pilotgen.virtual.calibration import grip_stiffness

STUDY = Path(__file__).parents[2] / "docs" / "studies" / "puma-bmi.yaml"
TASKS = ("position", "relax", "force")
HZ = np.array([0.5, 1.0, 2.0])


def evaluations(mbdae: Path, values: dict[str, float], sex: str = "male") -> dict[str, Evaluation]:
    """One pilot in every task."""
    study = read_study(STUDY)
    found = {}
    for task in TASKS:
        own = dataclasses.replace(study, pilot=dataclasses.replace(study.pilot, task=task, sex=sex))
        with EvaluationContext(own, mbdae=str(mbdae)) as context:
            outcome = evaluate(context, values)
        assert isinstance(outcome, Evaluation), outcome
        found[task] = outcome
    return found


@pytest.mark.parametrize(
    ("values", "sex"),
    [
        ({"age_years": 40.0, "bmi": 24.0, "stature_m": 1.775}, "male"),
        ({"age_years": 25.0, "bmi": 18.0, "stature_m": 1.55}, "female"),
        ({"age_years": 65.0, "bmi": 30.0, "stature_m": 2.00}, "male"),
        ({"age_years": 65.0, "bmi": 18.0, "stature_m": 2.00}, "female"),
    ],
)
def test_the_more_a_pilot_gives_way_the_more_the_seat_moves_the_grip(
    mbdae: Path, values: dict[str, float], sex: str
) -> None:
    found = evaluations(mbdae, values, sex)
    models = {task: outcome.pilot_model for task, outcome in found.items()}
    motion = {task: np.abs(model.grip_motion(2.0 * np.pi * HZ)) for task, model in models.items()}
    assert np.all(motion["relax"][:2] > 1.5 * motion["position"][:2])
    # up to 1 Hz: at 2 Hz a large pilot who gives way is beyond his resonance, where mass alone counts
    assert np.all(motion["force"][:2] > 1.1 * motion["relax"][:2])
    stiffness = {task: grip_stiffness(model) for task, model in models.items()}
    # a third and a quarter for the reference pilot; every body has about that
    assert 0.2 < stiffness["relax"] / stiffness["position"] < 0.45
    assert 0.15 < stiffness["force"] / stiffness["position"] < 0.36
    assert stiffness["force"] < stiffness["relax"]
    frequency = [models[task].dominant_pair()[0] for task in TASKS]
    assert frequency == sorted(frequency, reverse=True)
    for model in models.values():
        assert model.poles.real.max() < 0.0
    # posture and effort are the body's, not the task's
    activations = [outcome.result["activation"]["sum_of_squares"] for outcome in found.values()]
    assert activations == pytest.approx([activations[0]] * 3, rel=1e-12)


def test_the_loop_depends_on_the_task(mbdae: Path) -> None:
    found = evaluations(mbdae, {"age_years": 40.0, "bmi": 24.0, "stature_m": 1.775})
    margins = {task: outcome.margins.modulus_margin for task, outcome in found.items()}
    assert margins["relax"] < margins["position"]
