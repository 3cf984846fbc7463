"""What cures bounce: the catalogue's effects, the cheapest combination, the command.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from study_texts import MAYO, MULTIBODY

import pilotgen as pg
from pilotgen.cli import main
from pilotgen.cures import catalogue
from pilotgen.cures.catalogue import Cure, changes, cures_for, price
from pilotgen.cures.optimum import cheapest, cost_of
from pilotgen.errors import StudyError
from pilotgen.study.study import study_from_text

STUDY, MAYO_STUDY = study_from_text(MULTIBODY), study_from_text(MAYO)


def test_every_entry_has_its_effect_and_every_effect_its_entry() -> None:
    assert set(catalogue.catalogue()) == set(catalogue._EFFECTS)
    for key, cure in catalogue.catalogue().items():
        assert cure.low <= 0.0 <= cure.high and cure.low < cure.high, key
        assert cure.cost > 0.0 or not cure.remedy, key
        for amount in (cure.low, cure.high):
            if amount:
                change = changes(STUDY, {key: amount}, 3.5)
                changed_study, values = STUDY.with_values(change)  # each alone is within what the schema allows
                assert change and (changed_study.canonical() != STUDY.canonical() or values)


def test_amounts_of_nothing_change_nothing() -> None:
    assert changes(STUDY, dict.fromkeys(catalogue.catalogue(), 0.0), 3.5) == {}


def test_effects_stand_on_each_other() -> None:
    found = changes(STUDY, {"lever_length": 0.04, "damper": 10.0, "inertia": 0.1, "balance_weight": 2.0}, 3.5)
    assert found["inceptor.lever_length_m"] == pytest.approx(0.36)
    assert found["cockpit.collective.damping_n_m_s_per_rad"] == pytest.approx(10.0 * 0.36**2)
    assert found["cockpit.collective.inertia_kg_m2"] == pytest.approx(0.05 + 0.1 + 2.0 * 0.15**2)
    assert found["cockpit.collective.unbalance_kg_m"] == pytest.approx(-0.3)
    filters = changes(STUDY, {"notch": 12.0, "low_pass": 40.0}, 3.5)
    assert filters["rotorcraft.delay_s"] == pytest.approx(0.015)  # one computer for both
    ratio = filters["rotorcraft.notch.zero_damping"] / filters["rotorcraft.notch.pole_damping"]
    assert 20.0 * np.log10(ratio) == pytest.approx(-12.0)


def test_a_notch_is_as_deep_as_it_says() -> None:
    pilot = pg.evaluate(STUDY, {})
    f = pilot.margins.gain_margin_hz
    assert f is not None
    filtered = pg.evaluate(STUDY, changes(STUDY, {"notch": 9.0}, f))
    s = 2j * np.pi * f
    assert abs(filtered.open_loop()(s) / pilot.open_loop()(s)) == pytest.approx(10.0 ** (-9.0 / 20.0), rel=1e-6)


def test_prices_are_in_words() -> None:
    known = catalogue.catalogue()
    assert price(STUDY, known["damper"], 20.0) == "4.0 N of control force at 0.2 m/s"
    assert price(STUDY, known["gearing"], 20.0) == "25 % more travel of the lever"


def test_the_cheapest_combination_of_a_linear_problem_is_the_corner_that_theory_names() -> None:
    # each cure buys `per` dB all the way; the cheapest way to 5 dB is by the least cost per dB first
    cures = [Cure(str(k), "", "", 0.0, 1.0, cost, True, "") for k, cost in enumerate((1.0, 1.0, 0.5))]
    bought = np.array([4.0, 2.0, 1.0])

    def violation(amounts: np.ndarray) -> np.ndarray:
        return np.asarray(5.0 - amounts @ bought)

    found = cheapest(cures, violation, 1)
    assert found.reached
    assert float(found.amounts @ bought) == pytest.approx(5.0, abs=0.05)
    assert found.cost == pytest.approx(1.5, abs=0.03)  # all of the first, and 1 dB at 0.5 a dB
    assert cost_of(cures, found.amounts) == pytest.approx(found.cost)
    again = cheapest(cures, violation, 1)
    assert again.amounts.tolist() == found.amounts.tolist()


def test_what_cannot_be_reached_is_not_called_reached() -> None:
    cures = [Cure("one", "", "", 0.0, 1.0, 1.0, True, "")]
    found = cheapest(cures, lambda amounts: np.asarray(2.0 - amounts[:, 0]), 1)
    assert not found.reached and found.violation == pytest.approx(1.0, abs=0.02)


def test_names_are_checked() -> None:
    with pytest.raises(StudyError, match="'dampr' is no cure; did you mean 'damper'"):
        cures_for(STUDY, only=("dampr",))
    with pytest.raises(StudyError, match="'damper' means nothing here: Mayo's pilots have no lever"):
        cures_for(MAYO_STUDY, only=("damper",))
    rigid, _ = STUDY.with_values({"pilot.torso.model": "rigid"})
    assert not {"cushion", "seat_back"} & {cure.key for cure in cures_for(rigid)}
    pan, _ = STUDY.with_values({"cockpit.seat.cushion": "none"})
    with pytest.raises(StudyError, match="the seat has a rigid pan"):
        cures_for(pan, only=("cushion",))


def test_the_command_proposes_what_keeps_the_limits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = tmp_path / "mayo.yaml"
    study.write_text(MAYO.replace("population: 100", "population: 16").replace("generations: 30", "generations: 4"))
    out = tmp_path / "out"
    options = ["cures", str(study), "-o", str(out), "--quiet", "--only", "gearing", "notch", "low_pass", "delay"]
    assert main(options) == 0
    told = capsys.readouterr().out
    found = json.loads((out / "cures.json").read_text())
    assert told.startswith(found["sentence"])
    assert {row["key"] for row in found["cures"]} == {"gearing", "notch", "low_pass", "delay"}
    proposal = found["proposal"]
    assert "delay" not in proposal["amounts"]  # an influence is never proposed
    # what the result says of the cured pilots is what anyone finds who evaluates them
    base = pg.read_study(study)
    for row in proposal["pilots"]:
        again = pg.evaluate(base, {**row["after"]["values"], **proposal["changes"]})
        assert again.margins.gain_margin_db == pytest.approx(row["after"]["gain_margin_db"], rel=1e-12)
        if proposal["reached"]:
            assert row["after"]["keeps_limits"]
    cured = pg.read_study(out / "cured.yaml")
    for path, value in proposal["changes"].items():
        assert cured.value(path) == pytest.approx(value, rel=1e-12)
    assert (out / "cures.png").stat().st_size > 5000 and (out / "cure_map.png").exists()
    one = next(row for row in found["cures"] if row["key"] == "gearing")
    gain = one["margins"]["worst"]["gain_margin_db"]  # of a loop that is linear in its gearing
    assert gain[-1] - gain[0] == pytest.approx(-20.0 * np.log10(0.75), abs=1e-6)
    (out / "cures.json").unlink()
    assert main([*options, "--resume", "--workers", "1"]) == 0
    again = json.loads((out / "cures.json").read_text())
    assert {k: again[k] for k in ("proposal", "cures", "sentence")} == {
        k: found[k] for k in ("proposal", "cures", "sentence")
    }


def test_a_crossing_that_is_too_faint_to_matter_leaves_no_doubt() -> None:
    # filters and their delay together: L crosses the axis at 1e-8, below its round-off in frequency (77 states)
    amounts = {
        "lever_length": -0.023,
        "damper": 13.8,
        "inertia": 0.06,
        "balance_weight": 0.62,
        "trim_spring": 147.0,
        "lever_angle": 0.9,
        "grip_forward": 0.012,
        "grip_up": -0.045,
        "cushion": 254.0,
        "cushion_damping": 2095.0,
        "seat_back": 12.4,
        "notch": 4.4,
        "low_pass": 16.6,
    }
    tall = {"age_years": 25.0, "bmi": 30.0, "stature_m": 2.0}
    pilot = pg.evaluate(STUDY, {**tall, **changes(STUDY, amounts, 3.65)})
    omega = np.geomspace(0.5, 200.0, 6_000)  # rad/s, an independent look
    L = pilot.open_loop()(1j * omega)
    crossed = np.flatnonzero((L.imag[:-1] * L.imag[1:] < 0.0) & (L.real[:-1] < -1e-6))
    largest = -L.real[crossed].min()
    assert pilot.margins.gain_margin_db == pytest.approx(-20.0 * np.log10(largest), abs=2e-2)
    assert pilot.margins.modulus_margin == pytest.approx(float(np.abs(1.0 + L).min()), abs=1e-4)


def test_the_closed_deck_with_fittings_has_the_poles_of_the_margins(tmp_path: Path) -> None:
    study = tmp_path / "study.yaml"
    study.write_text(MULTIBODY)
    change = changes(STUDY, {"damper": 10.0, "balance_weight": 1.0, "notch": 6.0}, 3.5)
    settings = [f"{path}={value!r}" for path, value in change.items()]
    assert main(["loop", str(study), "-o", str(tmp_path / "out"), "--set", *settings]) == 0  # 3 if poles differ
