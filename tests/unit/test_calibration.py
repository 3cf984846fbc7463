"""The calibration: shipped gains against Mayo, the order of the tasks, the grip's receptance against closed forms.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
import yaml

from pilotgen.context import EvaluationContext
from pilotgen.errors import EvaluationError
from pilotgen.linear.feedthrough import mayo_pilot
from pilotgen.study.schema import MAYO_PRESETS
from pilotgen.study.sections import Reflex, calibrated_gains
from pilotgen.study.study import Study, read_study
from pilotgen.virtual.calibration import (
    FITTED,
    PREDICTED,
    CalibrationPilot,
    MeasuredPilot,
    calibrate,
    fit_gains,
    grip_mass,
    grip_receptance,
    grip_stiffness,
    reference_study,
    references,
    reflex_yaml,
    seen_by_mayo,
)


def rigid_study() -> Study:
    return read_study(STUDY).with_values({"pilot.torso.model": "rigid"})[0]


STUDY = Path(__file__).parents[2] / "docs" / "studies" / "puma-bmi.yaml"
HZ = np.array([0.5, 1.0, 2.0, 3.0])


@pytest.fixture(scope="module")
def context(mbdae: Path) -> Iterator[EvaluationContext]:
    with EvaluationContext(reference_study(rigid_study()), mbdae=str(mbdae)) as context:
        yield context


@pytest.fixture(scope="module")
def lumped(mbdae: Path) -> Iterator[EvaluationContext]:
    with EvaluationContext(reference_study(read_study(STUDY)), mbdae=str(mbdae)) as context:
        yield context


@pytest.fixture(scope="module")
def seated(lumped: EvaluationContext) -> CalibrationPilot:
    return CalibrationPilot(lumped, references().pilots[FITTED].values)


@pytest.fixture(scope="module")
def person(context: EvaluationContext) -> CalibrationPilot:
    return CalibrationPilot(context, references().pilots[FITTED].values)


def test_shipped_gains_give_the_mesomorphic_pilot_the_measured_pair(person: CalibrationPilot) -> None:
    frequency, damping = person.model(calibrated_gains("rigid")["position"]).dominant_pair()
    assert frequency == pytest.approx(3.750, rel=1e-3)
    assert damping == pytest.approx(0.28, rel=1e-3)


def test_the_fit_finds_the_shipped_gains_from_elsewhere(person: CalibrationPilot) -> None:
    found = fit_gains(person, references().pilots[FITTED].measured, Reflex(1.2, 0.05))
    shipped = calibrated_gains("rigid")["position"]
    assert found.proportional_gain == pytest.approx(shipped.proportional_gain, abs=1e-6)
    assert found.derivative_gain == pytest.approx(shipped.derivative_gain, abs=1e-6)


def test_a_made_up_target_is_hit_too(person: CalibrationPilot) -> None:
    gains = fit_gains(person, MeasuredPilot(3.1, 0.35, 0.1))
    assert person.model(gains).dominant_pair() == pytest.approx((3.1, 0.35), rel=1e-7)


def test_a_target_that_no_reflex_reaches_is_told(person: CalibrationPilot) -> None:
    with pytest.raises(
        EvaluationError, match=r"no reflex gains between 0 and 50 give the reference pilot 60 Hz and 0.01"
    ) as caught:
        fit_gains(person, MeasuredPilot(60.0, 0.01, 0.1))
    assert caught.value.stage == "calibration"


def test_tasks_differ_as_people_do(person: CalibrationPilot) -> None:
    """Holding a position is stiffest, giving way to a force most compliant; a compliant pilot feels the seat more."""
    models = {task: person.model(gains) for task, gains in calibrated_gains("rigid").items()}
    stiffness = {task: grip_stiffness(model) for task, model in models.items()}
    assert stiffness["relax"] == pytest.approx(stiffness["position"] / 3.0, rel=1e-4)
    assert stiffness["force"] == pytest.approx(stiffness["position"] / 4.0, rel=1e-4)
    motion = {task: np.abs(model.grip_motion(2.0 * np.pi * HZ)) for task, model in models.items()}
    assert np.all(motion["relax"] > 1.5 * motion["position"])
    assert np.all(motion["force"][:3] > motion["relax"][:3])  # up to 2 Hz; both are beyond their resonance at 3 Hz
    for model in models.values():
        assert model.poles.real.max() < 0.0
        assert model.dominant_pair()[1] > 0.15


def test_receptance_is_what_a_force_at_the_grip_does(person: CalibrationPilot) -> None:
    """Against a dense solve of the whole descriptor model, momenta and all."""
    model = person.model(calibrated_gains("rigid")["position"])
    imposed = model.imposed
    assert imposed is not None
    free = imposed.free
    lever = free.index("lever.gz")
    row = free.equilibrium_rows[list(free.coordinates).index(lever)]
    moment = np.zeros(len(free.names), dtype=complex)
    moment[row] = 0.32  # N m of 1 N at the grip; g = equilibrium - moment
    for frequency in (0.0, 1.0, 3.75, 12.0):
        s = 2j * math.pi * frequency
        answer = np.linalg.solve(s * free.g_ydot + free.g_y, moment)[lever] * 0.32
        ours = grip_receptance(imposed, 0.32, [2.0 * math.pi * frequency])[0]
        assert ours == pytest.approx(complex(answer) * _sign(imposed), rel=1e-8)


def _sign(imposed: object) -> float:
    """Sign of the equilibrium rows: + if the residual holds inertia with plus, as the mass matrix of the form."""
    form, free = imposed.form, imposed.free  # type: ignore[attr-defined]
    lever = list(free.coordinates).index(free.index("lever.gz"))
    return float(np.sign(form.M[lever, lever]))


def test_the_grip_resists_like_an_arm(person: CalibrationPilot) -> None:
    model = person.model(calibrated_gains("rigid")["position"])
    arm = sum(segment.mass_kg for segment in person.pilot.body.limbs["left"].segments.values())
    lever = 0.05 / 0.32**2  # kg at the grip, data/cockpit.yaml
    assert lever < grip_mass(model) < lever + arm
    assert 300.0 < grip_stiffness(model) < 3000.0


def test_stiffer_reflexes_make_a_stiffer_grip(person: CalibrationPilot) -> None:
    stiffness = [grip_stiffness(person.model(Reflex(Kp, 0.1))) for Kp in (0.5, 1.0, 2.0, 4.0)]
    assert np.all(np.diff(stiffness) > 0.0)


def test_mayo_s_function_finds_itself() -> None:
    people = mayo_pilot(3.75, 0.28, 0.107, 0.32, washout_rad_s=None)
    assert seen_by_mayo(people) == pytest.approx((3.75, 0.28, 0.107), rel=1e-9)


def test_shipped_gains_show_mayo_what_he_saw(seated: CalibrationPilot) -> None:
    model = seated.model(calibrated_gains("lumped")["position"])
    frequency, damping, tau = seen_by_mayo(model)
    assert (frequency, damping) == pytest.approx((3.750, 0.28), rel=1e-5)
    assert 0.08 < tau < 0.15  # people 0.107; no gain was chosen for it
    grip = complex(model.grip_motion(2.0 * np.pi * 3.0))
    assert 1e3 * abs(grip) == pytest.approx(3.5, rel=0.15)  # mm per m/s^2
    assert np.degrees(np.angle(grip)) == pytest.approx(107.0, abs=5.0)
    assert seated.gain_margin_db(model) == pytest.approx(7.7, rel=0.15)


def test_tasks_with_a_torso_differ_as_people_do(seated: CalibrationPilot) -> None:
    models = {task: seated.model(gains) for task, gains in calibrated_gains("lumped").items()}
    stiffness = {task: grip_stiffness(model) for task, model in models.items()}
    assert stiffness["relax"] == pytest.approx(stiffness["position"] / 3.0, rel=1e-4)
    assert stiffness["force"] == pytest.approx(stiffness["position"] / 4.0, rel=1e-4)
    assert all(model.poles.real.max() < 0.0 for model in models.values())


def test_both_readings_of_the_ectomorph(lumped: EvaluationContext) -> None:
    """The damping goes where people's goes; a long lean man comes near their frequency, a small one does not."""
    gains = calibrated_gains("lumped")["position"]
    found = {}
    for name in (PREDICTED, "ectomorphic-long"):
        person = CalibrationPilot(lumped, references().pilots[name].values)
        found[name] = person.seen(person.model(gains))
    assert found[PREDICTED].frequency_hz == pytest.approx(3.88, abs=0.05)
    assert found["ectomorphic-long"].frequency_hz == pytest.approx(3.52, abs=0.05)
    assert all(seen.damping > 0.30 for seen in found.values())


def test_references_are_mayos() -> None:
    for name, pilot in references().pilots.items():
        measured = pilot.measured
        mayo = MAYO_PRESETS[name.partition("-")[0]]
        assert (measured.frequency_hz, measured.damping, measured.time_constant_s) == tuple(mayo.values())


def test_report_and_yaml(context: EvaluationContext) -> None:
    from pilotgen.commands.calibrate import report

    found = calibrate(context, sensitivities=False)
    text = report(found)
    assert "mesomorphic" in text and "ectomorphic" in text and "Mayo" in text
    tasks = yaml.safe_load(reflex_yaml(found))["torso"]["rigid"]
    assert list(tasks) == ["position", "relax", "force"]
    for task, gains in calibrated_gains("rigid").items():
        assert tasks[task] == {
            "proportional_gain": gains.proportional_gain,
            "derivative_gain": gains.derivative_gain,
        }
    ectomorphic = found.pilots[1]
    # docs/theory/calibration.md: the damping goes where people's goes, the frequency does not
    assert ectomorphic.seen.damping > 0.28
    assert ectomorphic.seen.frequency_hz == pytest.approx(4.15, abs=0.01)


def test_too_much_tonic_activity_is_told(mbdae: Path) -> None:
    """With every muscle active the arm is damped beyond the people: no positive Kd is left."""
    study = reference_study(rigid_study())
    tonic = dataclasses.replace(study, pilot=dataclasses.replace(study.pilot, activation_floor=0.15))
    with (
        EvaluationContext(tonic, mbdae=str(mbdae)) as context,
        pytest.raises(EvaluationError, match=r"activation_floor"),
    ):
        fit_gains(CalibrationPilot(context, references().pilots[FITTED].values), references().pilots[FITTED].measured)


def test_the_command(mbdae: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from pilotgen.cli import main

    out = tmp_path / "calibration"
    assert main(["calibrate", str(STUDY), "-o", str(out), "--no-sensitivities", "--mbdae", str(mbdae)]) == 0
    assert "ectomorphic" in capsys.readouterr().out
    assert yaml.safe_load((out / "reflex.yaml").read_text())["torso"]["lumped"]["position"]["proportional_gain"] > 1.0
    assert len(json.loads((out / "calibration.json").read_text())["pilots"]) == 3
    # what is shipped is what the command makes
    shipped = Path(str(resources.files("pilotgen") / "data" / "reflex.yaml"))
    assert (out / "reflex.yaml").read_text() == shipped.read_text()


def test_mayo_s_pilots_have_no_reflexes(capsys: pytest.CaptureFixture[str]) -> None:
    from pilotgen.cli import main

    assert main(["calibrate", str(STUDY.with_name("puma-mayo.yaml"))]) == 1
    assert "has no reflexes" in capsys.readouterr().err
