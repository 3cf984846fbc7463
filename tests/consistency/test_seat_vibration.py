"""Seat vibration of the torso: an independent account of the same springs, published models, bands, and the command.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pilotgen.cli import main
from pilotgen.context import EvaluationContext
from pilotgen.evaluation import solve_pilot
from pilotgen.study.study import read_study
from pilotgen.virtual.seat_vibration import QUANTITIES, SeatVibration, lumped_model, published, seat_vibration

STUDY = Path(__file__).parents[2] / "docs" / "studies" / "puma-bmi.yaml"
HZ = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
NO_BACK = {
    "cockpit.seat.cushion": "none",
    "cockpit.seat.back.normal_n_per_m": 100.0,
    "cockpit.seat.back.tangential_n_per_m": 0.0,
    "cockpit.seat.back.normal_n_s_per_m": 0.0,
    "cockpit.seat.back.tangential_n_s_per_m": 0.0,
}


def vibrated(mbdae: Path, changes: dict) -> SeatVibration:
    with EvaluationContext(read_study(STUDY), mbdae=str(mbdae)) as context:
        return seat_vibration(solve_pilot(context, context.study.values(changes)))


@pytest.fixture(scope="module")
def cushion(mbdae: Path) -> SeatVibration:
    return vibrated(mbdae, {})


@pytest.fixture(scope="module")
def no_back(mbdae: Path) -> SeatVibration:
    return vibrated(mbdae, NO_BACK)


def test_an_independent_planar_model_of_the_same_torso_moves_alike(cushion: SeatVibration) -> None:
    # A numpy model in the plane, written without this program, with an arm of gains 1.6 and 0.19 (the deck is in space
    # and has its own gains): magnitudes and phases [deg] of shoulder joint and head over the seat, cushion of 200 kN/m
    shoulder = [1.03, 1.14, 1.37, 1.67, 1.84, 1.72, 1.14, 0.73], [-1, -2, -7, -21, -42, -64, -96, -110]
    head = [1.04, 1.16, 1.40, 1.77, 1.98, 1.88, 1.29, 0.89], [0, -2, -7, -22, -44, -68, -101, -117]
    for name, (magnitude, phase_deg) in (("shoulder", shoulder), ("head", head)):
        values = np.array([cushion.at(name, hz) for hz in HZ])
        assert np.abs(values) == pytest.approx(magnitude, abs=0.025)
        assert np.degrees(np.angle(values)) == pytest.approx(phase_deg, abs=2.0)
    assert cushion.peak("head").frequency_hz == pytest.approx(5.18, abs=0.1)


def test_without_a_back_the_peaks_of_people_are_met(no_back: SeatVibration) -> None:
    # the same independent model, rigid seat without back: apparent mass 5.03 Hz, T1 5.75 Hz, 1.64, head 5.95 Hz, 1.76
    assert no_back.peak("apparent_mass_pan").frequency_hz == pytest.approx(5.03, abs=0.3)
    for name, hz, ratio in (("shoulder_t1", 5.75, 1.64), ("head", 5.95, 1.76)):
        assert no_back.peak(name).frequency_hz == pytest.approx(hz, abs=0.15)
        assert no_back.peak(name).ratio == pytest.approx(ratio, abs=0.03)
    low, high = published()["seated_mass_share"]
    assert low <= no_back.supported_mass_kg / no_back.body_mass_kg <= high
    assert all(no_back.inside(band) for band in published()["bands"])
    # at rest the pan feels the weight it carries
    assert abs(no_back.at("apparent_mass_pan", 0.5)) == pytest.approx(no_back.supported_mass_kg, rel=0.04)


@pytest.mark.parametrize(
    ("changes", "expected_hz"),
    # the law f = 5.0 + 1.7/47 (age - 40) - 1.7/16 (BMI - 24), held to 20 % of its change
    [({"age_years": 60.0}, 20 * 1.7 / 47), ({"bmi": 30.0}, -6 * 1.7 / 16)],
)
def test_the_resonance_follows_age_and_bmi(
    mbdae: Path, no_back: SeatVibration, changes: dict, expected_hz: float
) -> None:
    moved = vibrated(mbdae, {**NO_BACK, **changes}).peak("apparent_mass_pan").frequency_hz
    assert moved - no_back.peak("apparent_mass_pan").frequency_hz == pytest.approx(
        expected_hz, abs=0.2 * abs(expected_hz) + 0.05
    )


def test_published_models_have_the_peaks_that_their_numbers_give() -> None:
    f = np.linspace(0.5, 12.0, 2301)
    peaks = {  # apparent mass over the static one, trunk, head; computed elsewhere from the same parameters
        "boileau_rakheja_1998": ((4.55, 1.64), (4.65, 1.75), (4.70, 1.78)),
        "wan_schimmels_1995": ((3.70, 1.31), (3.85, 1.35), None),
        "wei_griffin_1998": ((4.60, 1.52), (4.70, 1.80), None),
    }
    for name, rows in peaks.items():
        model = lumped_model(name, f)
        static = sum(published()["models"][name]["masses"].values())
        for quantity, row in zip(("apparent_mass_pan", "shoulder", "head"), rows, strict=True):
            if row is None:
                continue
            magnitude = np.abs(model[quantity]) / (static if quantity.startswith("apparent") else 1.0)
            k = int(np.argmax(magnitude))
            assert f[k] == pytest.approx(row[0], abs=0.06)
            assert magnitude[k] == pytest.approx(row[1], abs=0.01)


def test_the_command(mbdae: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "torso"
    assert main(["torso", str(STUDY), "-o", str(out), "--mbdae", str(mbdae)]) == 0
    assert "rest on the seat's springs" in capsys.readouterr().out
    told = json.loads((out / "seat_vibration.json").read_text())
    assert set(told["responses"]) == set(QUANTITIES)
    assert (out / "seat_vibration.png").stat().st_size > 20_000
    assert main(["torso", str(STUDY), "-o", str(tmp_path / "r"), "--set", "pilot.torso.model=rigid"]) == 2
    assert "a rigid torso moves as the seat does" in capsys.readouterr().err
    mayo = STUDY.with_name("puma-mayo.yaml")
    assert main(["torso", str(mayo), "-o", str(tmp_path / "m")]) == 1
    assert "has no torso" in capsys.readouterr().err
