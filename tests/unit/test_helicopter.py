"""Heave and coning: the paper's poles, and the equations (32) put to the test by substitution.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pilotgen.context import EvaluationContext
from pilotgen.evaluation import evaluate
from pilotgen.figures import rotorcraft_bode
from pilotgen.loop.heave_model import HeaveModel, rotorcraft_report
from pilotgen.study.rotorcraft import load_rotorcraft
from pilotgen.study.study import study_from_text

OMEGA = 2.0 * math.pi * np.geomspace(0.01, 30.0, 23)


@pytest.fixture(scope="module")
def puma() -> HeaveModel:
    return HeaveModel(load_rotorcraft("iar330-puma"))


def test_poles_of_the_puma(puma: HeaveModel) -> None:
    # Known answers printed with four and three decimals.
    heave, *coning = puma.poles
    assert heave.real == pytest.approx(-0.8199, abs=5e-5) and heave.imag == 0.0
    for pole in coning:
        assert pole.real == pytest.approx(-15.019, abs=5e-4)
        assert abs(pole.imag) == pytest.approx(25.059, abs=5e-4)


def test_response_satisfies_equation_32(puma: HeaveModel) -> None:
    """Solve (32a) and (32b), each term written as printed, for z and beta with theta = 1."""
    r = puma.rotorcraft
    m, n_b, R = r.mass_kg, r.blades, r.rotor_radius_m
    Om, gamma = 2.0 * math.pi * r.rotor_speed_hz, r.lock_number
    S, inertia, nu = r.flap_static_moment_kg_m, r.flap_inertia_kg_m2, r.flap_frequency_ratio
    expected = []
    for s in 1j * OMEGA:
        lhs = np.array(
            [
                [
                    m * s**2 + n_b * gamma / 4 * Om * inertia / R**2 * s,
                    n_b * S * s**2 + n_b * gamma / 6 * Om * inertia / R * s,
                ],
                [
                    n_b * S * s**2 + n_b * gamma / 6 * Om * inertia / R * s,
                    n_b * inertia * s**2 + n_b * gamma / 8 * Om * inertia * s + n_b * inertia * nu**2 * Om**2,
                ],
            ]
        )
        rhs = np.array([n_b * gamma / 6 * Om**2 * inertia / R, n_b * gamma / 8 * Om**2 * inertia])
        expected.append(s**2 * np.linalg.solve(lhs, rhs)[0])
    np.testing.assert_allclose(puma.response(OMEGA), expected, rtol=1e-11)


def test_transfer_function_coefficients_give_the_same_response(puma: HeaveModel) -> None:
    numerator, denominator = puma.transfer_function
    assert denominator[0] == 1.0
    s = 1j * OMEGA
    np.testing.assert_allclose(np.polyval(numerator, s) / np.polyval(denominator, s), puma.response(OMEGA), rtol=1e-11)
    np.testing.assert_allclose(np.sort_complex(np.roots(denominator)), np.sort_complex(puma.poles), rtol=1e-10)


def test_states_are_zdot_beta_betadot(puma: HeaveModel) -> None:
    model = puma.state_space
    np.testing.assert_array_equal(model.A[1], [0.0, 0.0, 1.0])  # d beta / dt = betadot
    np.testing.assert_array_equal(model.C, model.A[0])  # the output is the rate of the first state
    assert model.B[0] == model.D


def test_steady_climb_needs_no_acceleration(puma: HeaveModel) -> None:
    assert abs(puma.response(0.0)) < 1e-10


def test_report_prints_poles_and_coefficients() -> None:
    text = rotorcraft_report("iar330-puma")
    assert "-0.8199" in text and "-15.0194 +- 25.0588i" in text
    assert "98799.5" in text  # numerator, coefficient of s
    assert text == rotorcraft_report(load_rotorcraft("iar330-puma"))


def test_figure_marks_the_coning_mode(puma: HeaveModel) -> None:
    gain, phase = rotorcraft_bode(puma).axes
    pole = max(puma.poles, key=lambda p: p.imag)
    line = next(line for line in gain.lines if str(line.get_label()).startswith("coning"))
    assert line.get_xdata()[0] == pytest.approx(abs(pole) / (2.0 * np.pi))
    curve = phase.lines[0]
    assert curve.get_ydata()[0] == pytest.approx(np.degrees(np.angle(puma.response(2.0 * np.pi * 0.01))))


@pytest.mark.parametrize(("pilot", "gain_margin_db"), [("mesomorphic", 4.20), ("ectomorphic", 4.27)])
def test_mayo_s_pilots_on_the_uh60a(pilot: str, gain_margin_db: float) -> None:
    # computed elsewhere from the same parameters of rotorcraft and pilots
    text = (Path(__file__).parents[2] / "docs" / "studies" / "uh60a-mayo.yaml").read_text(encoding="utf-8")
    study = study_from_text(text.replace("nominal: mesomorphic", f"nominal: {pilot}"))
    with EvaluationContext(study) as context:
        found = evaluate(context, study.values({})).result["loop"]
    assert found["gain_margin_db"] == pytest.approx(gain_margin_db, abs=0.005)
