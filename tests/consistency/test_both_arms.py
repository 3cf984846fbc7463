"""Two arms: on a rigid torso the collective does not feel the right one, and left and right are mirror images.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from whole_pilots import body_of, cockpit_of, solve

from pilotgen.context import EvaluationContext
from pilotgen.evaluation import Evaluation, evaluate
from pilotgen.posture.cockpit import Cockpit
from pilotgen.posture.kinematics import mirror_pose
from pilotgen.solver.client import SolverClient
from pilotgen.study.study import Study, read_study

STUDY = Path(__file__).parents[2] / "docs" / "studies" / "puma-bmi.yaml"
OMEGA = 2.0 * np.pi * np.geomspace(0.1, 20.0, 40)


def with_limbs(*limbs: str) -> Study:
    study, _ = read_study(STUDY).with_values({"pilot.torso.model": "rigid"})
    return dataclasses.replace(study, pilot=dataclasses.replace(study.pilot, limbs=limbs))


@pytest.mark.parametrize(
    "values",
    [{"age_years": 40.0, "bmi": 24.0, "stature_m": 1.775}, {"age_years": 28.0, "bmi": 19.0, "stature_m": 1.62}],
)
def test_the_loop_is_that_of_the_left_arm(mbdae: Path, values: dict[str, float]) -> None:
    results = {}
    for limbs in (("left",), ("left", "right")):
        with EvaluationContext(with_limbs(*limbs), mbdae=str(mbdae)) as context:
            outcome = evaluate(context, values)
            assert isinstance(outcome, Evaluation), outcome
            results[limbs] = outcome
    one, two = results.values()
    assert one.margins.gain_margin_db == pytest.approx(two.margins.gain_margin_db, rel=1e-9)
    assert one.margins.phase_margin_deg == pytest.approx(two.margins.phase_margin_deg, rel=1e-9)
    assert one.margins.modulus_margin == pytest.approx(two.margins.modulus_margin, rel=1e-9)
    assert two.pilot_model.response(OMEGA) == pytest.approx(one.pilot_model.response(OMEGA), rel=1e-9)
    assert one.result["bdft"]["cyclic"] is None
    cyclic = json.loads(json.dumps(two.result))["bdft"]["cyclic"]
    model = two.pilot_model
    for output, name in ((1, "cyclic_aft"), (2, "cyclic_right")):
        assert model.outputs[output] == name
        wanted = 1e3 * abs(complex(model.response(6.0 * np.pi, output, washout=False)))
        assert cyclic[f"{name}_3hz_mrad_per_m_s2"] == pytest.approx(wanted)
        assert wanted > 0.01  # heave does reach the cyclic


# ---- the mirror


def mirrored(cockpit: Cockpit) -> Cockpit:
    """The cockpit seen in the mirror z -> -z: the collective stands at the right, and the right hand holds it."""
    collective = cockpit.inceptors["left"]
    S = np.diag([1.0, 1.0, -1.0])
    right = dataclasses.replace(
        collective,
        side="right",
        pose=mirror_pose(collective.pose),
        handle=S @ collective.handle @ S,
        grip_m=S @ collective.grip_m,
    )
    return dataclasses.replace(cockpit, inceptors={"right": right}, torso={"right": mirror_pose(cockpit.torso["left"])})


def test_a_right_arm_on_a_mirrored_collective_gives_the_same(solver: SolverClient, tmp_path: Path) -> None:
    left_body, right_body = body_of(limbs=("left",)), body_of(limbs=("right",))
    cockpit = cockpit_of(left_body)
    left, right = solve(solver, tmp_path, left_body, cockpit), solve(solver, tmp_path, right_body, mirrored(cockpit))
    assert right.activations.values == pytest.approx(left.activations.values, abs=1e-9)
    assert right.model.response(OMEGA) == pytest.approx(left.model.response(OMEGA), rel=1e-9)
    assert np.sort_complex(right.model.poles) == pytest.approx(np.sort_complex(left.model.poles), rel=1e-9)
