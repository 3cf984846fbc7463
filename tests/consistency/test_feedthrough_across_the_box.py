"""Pilots from corner to corner of both search boxes: certificate, eigenvalues by QZ, invariance; and both arms.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from linear_models import dense_eigenvalues, sort
from numpy.testing import assert_allclose

from pilotgen.context import EvaluationContext
from pilotgen.evaluation import Evaluation, evaluate
from pilotgen.linear.feedthrough import certificate, make_pilot_model
from pilotgen.linear.pilot_model import PilotModel, read_pilot_model
from pilotgen.solver.matrices import read_matrices
from pilotgen.study.study import Study, read_study

STUDIES = Path(__file__).parents[2] / "docs" / "studies"
# paper Table 3 (mass) and Table 4 (BMI): age [years], stature [m], mass [kg] or body mass index [kg/m^2]
BOXES = {
    "puma-mass": {"age_years": (25.0, 65.0), "stature_m": (1.55, 2.00), "mass_kg": (60.0, 110.0)},
    "puma-bmi": {"age_years": (25.0, 65.0), "stature_m": (1.55, 2.00), "bmi": (18.0, 30.0)},
}
OMEGA = 2.0 * np.pi * np.geomspace(0.1, 20.0, 60)


def rigid(name: str) -> Study:
    """A study with a rigid torso, where the arms do not feel each other."""
    return read_study(STUDIES / f"{name}.yaml").with_values({"pilot.torso.model": "rigid"})[0]


def pilot(study: Study, mbdae: Path, values: dict[str, float], keep: Path | None = None) -> PilotModel:
    """Evaluate one pilot of a study."""
    with EvaluationContext(study, mbdae=str(mbdae)) as context:
        outcome = evaluate(context, values, keep)
    assert isinstance(outcome, Evaluation), outcome
    model = outcome.pilot_model
    assert isinstance(model, PilotModel)
    return model


@pytest.mark.parametrize("name", list(BOXES))
def test_pilots_across_the_box(mbdae: Path, name: str) -> None:
    study = rigid(name)
    low, high = np.array(list(BOXES[name].values())).T
    points = np.vstack([np.random.default_rng(11).uniform(low, high, (10, 3)), low, high, [low[0], high[1], low[2]]])
    evaluated = 0
    for point in points:
        model = pilot(study, mbdae, dict(zip(BOXES[name], point.tolist(), strict=True)))
        assert certificate(model, np.geomspace(0.1, 20.0, 100)) < 1e-8
        assert model.translation_error is not None and model.translation_error < 1e-12
        assert model.imposed is not None
        assert_allclose(sort(model.poles), dense_eigenvalues(model.imposed.free), rtol=1e-8)
        evaluated += 1
    assert evaluated == 13


def test_the_other_arm_does_not_matter_for_the_collective(mbdae: Path, tmp_path: Path) -> None:
    study = rigid("puma-bmi")
    values = {"age_years": 40.0, "stature_m": 1.78, "bmi": 24.0}
    left, both = (
        pilot(dataclasses.replace(study, pilot=dataclasses.replace(study.pilot, limbs=limbs)), mbdae, values, tmp_path)
        for limbs in (("left",), ("left", "right"))
    )
    assert both.outputs == ("collective_rotation", "cyclic_aft", "cyclic_right")
    assert_allclose(both.response(OMEGA), left.response(OMEGA), rtol=1e-9)
    assert_allclose(both.dominant_pair(), left.dominant_pair(), rtol=1e-9)
    for output in range(3):  # heave reaches the cyclic too
        assert certificate(both, output=output) < 1e-8
        assert np.abs(both.response(OMEGA, output)).max() > 1e-4
    # the kept files say the same: matrices read again, model written and read
    again = make_pilot_model(read_matrices(tmp_path / "matrices.h5"), both.lever_length_m, both.washout_rad_s)
    assert_allclose(again.response(OMEGA), both.response(OMEGA), rtol=1e-12)
    both.write(tmp_path / "pilot_model.h5")
    assert_allclose(
        read_pilot_model(tmp_path / "pilot_model.h5").response(OMEGA, 2), both.response(OMEGA, 2), rtol=1e-9
    )
