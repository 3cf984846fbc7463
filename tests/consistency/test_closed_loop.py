"""The loop closed in the deck against the margins' loop, and two-way loops against the open deck."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pilotgen.closed_loop.deck import ClosedLoop, close_in_deck
from pilotgen.closed_loop.muscles import muscle_data, muscle_rows
from pilotgen.closed_loop.poles import compare_poles
from pilotgen.context import EvaluationContext
from pilotgen.evaluation import Evaluation, evaluate
from pilotgen.posture.seated_torso import FEM_NAME
from pilotgen.solver.mbdyn_check import check_mbdyn
from pilotgen.study.study import Study, read_study

STUDIES = Path(__file__).parents[2] / "docs" / "studies"
CHAIN = """
study: chain
rotorcraft: {mass_kg: 5345, blades: 4, rotor_radius_m: 7.49, rotor_speed_hz: 4.5, lock_number: 8.7,
  flap_static_moment_kg_m: 276.48, flap_inertia_kg_m2: 1339.19, flap_frequency_ratio: 1.03,
  delay_s: 0.04, inflow_lead_rad_s: 9.25, actuator: {corner_rad_s: 40},
  notch: {frequency_hz: 3.5, zero_damping: 0.1, pole_damping: 0.7},
  sling: {load_kg: 2000, stiffness_n_per_m: 1.0e+6, damping_n_s_per_m: 500}}
inceptor: {lever_length_m: 0.32, gearing_rad_per_m: 2.0}
pilot: {model: multibody, sex: male}
nominal: {age_years: 40, bmi: 24, stature_m: 1.775}
search: {variables: {stature_m: [1.55, 2.00]}, population: 20, generations: 10}
"""  # heave, sling, chain and delay, unstable


@pytest.fixture(scope="module")
def study() -> Study:
    return read_study(STUDIES / "puma-bmi.yaml")


@pytest.fixture(scope="module")
def context(study: Study) -> Iterator[EvaluationContext]:
    with EvaluationContext(study) as context:
        yield context


def closed(context: EvaluationContext, changes: dict, two_way: bool = False) -> ClosedLoop:
    return close_in_deck(context, {**context.study.nominal, **changes}, two_way=two_way)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"pilot.torso.model": "rigid", "stature_m": 1.6},
        {"pilot.torso.model": "modes", "pilot.limbs": ["left", "right"]},
        {"inceptor.gearing_rad_per_m": 6.0, "stature_m": 1.95},
        {"pilot.washout_rad_s": None, "pilot.torso.model": "rigid"},
    ],
    ids=["lumped", "rigid", "modes, both arms", "unstable", "no washout"],
)
@pytest.mark.parametrize("two_way", [False, True])
def test_poles(context: EvaluationContext, changes: dict, two_way: bool, tmp_path: Path) -> None:
    check_poles(context, changes, two_way, tmp_path)
    if not two_way:
        verdict = evaluate(context, {**context.study.nominal, **changes})
        assert isinstance(verdict, Evaluation)
        assert verdict.margins.stable == ("inceptor.gearing_rad_per_m" not in changes)


@pytest.mark.parametrize("two_way", [False, True])
def test_poles_of_a_chain(two_way: bool, tmp_path: Path) -> None:
    (tmp_path / "study.yaml").write_text(CHAIN)
    with EvaluationContext(read_study(tmp_path / "study.yaml")) as context:
        check_poles(context, {}, two_way, tmp_path)


def check_poles(context: EvaluationContext, changes: dict, two_way: bool, tmp_path: Path) -> None:
    loop = closed(context, changes, two_way)
    table = compare_poles(context, loop, tmp_path)
    assert table.certified, table.difference.max()
    assert table.difference.max() < 1e-9
    if loop.pilot.torso is not None and loop.pilot.torso.modes is not None:
        (tmp_path / FEM_NAME).write_text(loop.pilot.torso.modes.fem)
    assert check_mbdyn(tmp_path / "loop.mbd", context.client).runs


def test_weight(context: EvaluationContext) -> None:
    loop = closed(context, {})
    body = sum(s.mass_kg for limb in loop.pilot.body.limbs.values() for s in limb.segments.values())
    torso = loop.pilot.torso
    assert torso is not None
    above = sum(row.mass_kg for row in torso.torso.bodies) + sum(m for m, _ in torso.carried_arms.values())
    lever = loop.pilot.cockpit.inceptors["left"].mass_kg
    assert loop.weight_n == pytest.approx(9.81 * (body + above + lever), rel=1e-12)


def test_muscle_lengths(context: EvaluationContext, tmp_path: Path) -> None:
    """What the reflex adds to the matrices is activation per length times length per unknown."""
    loop = closed(context, {})
    with_reflex = loop.pilot.matrices
    no_reflex = closed(
        context, {"pilot.reflex.proportional_gain": 0.0, "pilot.reflex.derivative_gain": 0.0}
    ).pilot.matrices
    assert with_reflex is not None and no_reflex is not None
    muscles = [i for i, name in enumerate(with_reflex.inputs.name) if name.startswith(b"activation[")]
    by_activation, rows = with_reflex.inputs.g_u[:, muscles], muscle_rows(loop.pilot)
    for sign, factor in ((-1.0, loop.gains.proportional_gain), (1.0, None)):
        factor = factor or loop.gains.derivative_gain / muscle_data(loop.pilot).velocity_factor
        found = (with_reflex.J_plus + sign * with_reflex.J_minus) - (no_reflex.J_plus + sign * no_reflex.J_minus)
        found /= 2.0 * with_reflex.c if sign < 0.0 else 2.0
        expected = factor * by_activation @ rows
        assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from pilotgen.cli import main

    output = tmp_path / "loop"
    assert main(["loop", str(STUDIES / "quick.yaml"), "-o", str(output)]) == 0
    assert "stable by the deck's own eigenvalues" in capsys.readouterr().out
    content = json.loads((output / "loop.json").read_text())
    assert content["certified"] and content["stable"] and content["margins_stable"]
    for arguments, wanted in (
        ([str(STUDIES / "puma-mayo.yaml")], "has no deck"),
        ([str(STUDIES / "quick.yaml"), "--set", "pilot.reflex_delay_s=0.03"], "cannot be in a deck"),
        ([str(STUDIES / "quick.yaml"), "--set", "pilot.projection=literal"], "no deck obeys"),
    ):
        assert main(["loop", *arguments, "-o", str(tmp_path / "other")]) == 1
        assert wanted in capsys.readouterr().err
