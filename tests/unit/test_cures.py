"""What cures bounce: the catalogue's effects, the cheapest combination, the command.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from study_texts import MAYO, MULTIBODY

import pilotgen as pg
from pilotgen.cli import main
from pilotgen.commands.cures import _growing
from pilotgen.cures import catalogue, optimum
from pilotgen.cures.catalogue import Cure, changes, cures_for, price, proposable
from pilotgen.cures.optimum import cheapest, cost_of
from pilotgen.errors import StudyError
from pilotgen.runs import cures_in_time, cures_maps, cures_study
from pilotgen.runs.cures_evaluator import CureEvaluator, critical_hz
from pilotgen.runs.cures_in_time import smallest_swings
from pilotgen.runs.cures_maps import map_pairs
from pilotgen.runs.options import RunOptions
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


def test_a_negligible_amount_of_a_cure_is_not_proposed() -> None:
    cures = [Cure(str(k), "", "", 0.0, 1.0, cost, True, "") for k, cost in enumerate((2.0, 1.0))]

    def pruned(*amounts: float) -> list[float]:
        found, missed = optimum._pruned(cures, lambda a: np.asarray(3.0 - a @ np.array([4.0, 1.0])), np.array(amounts))
        assert missed <= 0.0
        return found.tolist()

    first, second = pruned(0.749, 0.006)
    assert second == 0.0 and first == pytest.approx(0.75, abs=5e-3)
    assert pruned(0.7, 0.5)[1] > 0.1  # not negligible


def test_what_cannot_be_reached_is_not_called_reached() -> None:
    cures = [Cure("one", "", "", 0.0, 1.0, 1.0, True, "")]
    found = cheapest(cures, lambda amounts: np.asarray(2.0 - amounts[:, 0]), 1)
    assert not found.reached and found.violation == pytest.approx(1.0, abs=0.02)


def test_names_are_checked() -> None:
    with pytest.raises(StudyError, match="'dampr' is no cure; did you mean 'damper'"):
        cures_for(STUDY, only=("dampr",))
    with pytest.raises(StudyError, match="leave no cure to try"):
        cures_for(STUDY, ("damper",), ("damper",))
    with pytest.raises(StudyError, match="'damper' means nothing here: Mayo's pilots have no lever"):
        cures_for(MAYO_STUDY, only=("damper",))
    rigid, _ = STUDY.with_values({"pilot.torso.model": "rigid"})
    assert not {"cushion", "seat_back"} & {cure.key for cure in cures_for(rigid)}
    pan, _ = STUDY.with_values({"cockpit.seat.cushion": "none"})
    with pytest.raises(StudyError, match="the seat has a rigid pan"):
        cures_for(pan, only=("cushion",))


def test_the_command_proposes_what_keeps_the_limits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cures_maps, "MAP_POINTS", 6)
    monkeypatch.setattr(optimum, "GENERATIONS", 6)  # quick, and not the cheapest
    study = tmp_path / "mayo.yaml"
    study.write_text(MAYO.replace("population: 100", "population: 16").replace("generations: 30", "generations: 4"))
    out = tmp_path / "out"
    options = ["cures", str(study), "-o", str(out), "--quiet", "--only", "gearing", "notch", "low_pass", "delay"]
    options += ["--map", "notch", "gearing", "--map", "gearing", "delay"]
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
    assert (out / "cures.png").stat().st_size > 5000
    assert {path.name for path in out.glob("cure_map*")} == {"cure_map-notch-gearing.png", "cure_map-gearing-delay.png"}
    sides = [(found_map["x"]["key"], found_map["y"]["key"], found_map["pilot"]) for found_map in found["maps"]]
    pairs = (("notch", "gearing"), ("gearing", "delay"))
    assert sides == [(*pair, who) for pair in pairs for who in ("worst", "nominal")]
    first = found["maps"][0]
    assert first["sentence"] in told
    gains = np.array(first["margins"]["gain_margin_db"])  # rows by gearing, columns by notch
    kept = np.array(first["keeps_limits"])
    assert gains.shape == kept.shape == (6, 6)
    less = np.array(first["y"]["amounts"])
    assert gains[:, 3] - gains[0, 3] == pytest.approx(-20.0 * np.log10(1.0 - 0.01 * less), abs=1e-6)
    point = {"notch": first["x"]["amounts"][2], "gearing": less[4]}
    again = pg.evaluate(base, {**found["pilots"]["worst"]["values"], **changes(base, point, found["critical_hz"])})
    assert gains[4, 2] == pytest.approx(again.margins.gain_margin_db, rel=1e-12)
    assert f"{np.count_nonzero(kept)} of 36 points keep" in first["sentence"] or not kept.any()
    one = next(row for row in found["cures"] if row["key"] == "gearing")
    gain = one["margins"]["worst"]["gain_margin_db"]  # of a loop that is linear in its gearing
    assert gain[-1] - gain[0] == pytest.approx(-20.0 * np.log10(0.75), abs=1e-6)
    notch = next(row for row in found["cures"] if row["key"] == "notch")["best"]["worst"]
    assert notch["enough"] is not None and f"; {notch['enough']:.3g} are enough" in notch["sentence"]
    limits, step = found["limits"], 15.0 / 8 / 2**6
    for amount, kept in ((notch["enough"], True), (notch["enough"] - step, False)):
        values = {**found["pilots"]["worst"]["values"], **changes(base, {"notch": amount}, found["critical_hz"])}
        margins = pg.evaluate(base, values).margins
        phase = margins.phase_margin_deg
        assert (margins.gain_margin_db >= limits["gain_margin_db"] and phase >= limits["phase_margin_deg"]) is kept
    delay = next(row for row in found["cures"] if row["key"] == "delay")["best"]["worst"]["sentence"]
    assert "takes up to" in delay and "dB from the worst pilot within 0 to 50 ms more" in delay
    (out / "cures.json").unlink()
    fewer = options[: options.index("--map")]
    assert main([*fewer, "--map", "notch", "low_pass", "--resume", "--workers", "1"]) == 0
    assert [path.name for path in out.glob("cure_map*")] == ["cure_map-notch-low_pass.png"]  # no stale ones
    again = json.loads((out / "cures.json").read_text())
    assert {k: again[k] for k in ("proposal", "cures", "sentence")} == {
        k: found[k] for k in ("proposal", "cures", "sentence")
    }


@pytest.mark.parametrize(
    ("maps", "message"),
    [
        ([("damper", "noch")], "'noch' is no cure; did you mean 'notch'"),
        ([("damper", "damper")], "--map damper damper: a map is of two cures"),
        ([("damper", "notch"), ("notch", "damper")], "--map notch damper: this pair stands there twice"),
    ],
)
def test_pairs_of_maps_are_checked(maps: list[tuple[str, str]], message: str) -> None:
    with pytest.raises(StudyError, match=message):
        map_pairs(STUDY, maps)
    with pytest.raises(StudyError, match="'damper' means nothing here"):
        map_pairs(MAYO_STUDY, [("gearing", "damper")])


def test_friction_is_proposed_only_by_name() -> None:
    cures = cures_for(STUDY)
    keys = {cure.key for cure in proposable(cures, ())}
    assert "damper" in keys and not {"friction", "delay"} & keys and "friction" in {cure.key for cure in cures}
    only = ("damper", "friction", "delay")
    assert {cure.key for cure in proposable(cures_for(STUDY, only), only)} == {"damper", "friction"}


def test_amounts_below_zero_are_told_without_their_sign() -> None:
    known = catalogue.catalogue()
    assert known["lever_length"].told(-0.05) == "length of the lever, 0.05 m shorter"
    assert known["grip_up"].told(-0.0123456) == "grip moved down, 0.0123 m"
    assert known["grip_up"].told(0.02) == "grip moved up, 0.02 m"
    assert known["cushion_damping"].told(4000.0) == "seat cushion with more damping, 4000 N s/m more"
    assert all(cure.below for cure in known.values() if cure.low < 0.0)


class DirectBatch:
    """Evaluates in this process, and counts."""

    def __init__(self) -> None:
        self.asked: list[dict[str, float]] = []

    def evaluate(self, pilots: list[dict[str, float]]) -> list[dict[str, Any]]:
        self.asked += pilots
        return [dict(pg.evaluate(STUDY, pilot).to_dict()) for pilot in pilots]


def test_friction_is_the_damper_at_the_frequency_that_comes_of_it() -> None:
    batch = DirectBatch()
    evaluator = CureEvaluator(STUDY, batch, 0.02)  # type: ignore[arg-type]
    evaluator.critical_hz = 3.0  # far from what comes of it
    plain, rubbed = evaluator.with_cures([{}, {}], [{"damper": 10.0}, {"friction": 30.0}])
    assert plain["loop"]["gain_margin_db"] == pytest.approx(
        pg.evaluate(STUDY, changes(STUDY, {"damper": 10.0}, 3.0)).margins.gain_margin_db
    )
    hz = critical_hz(rubbed)
    like = 4.0 * 30.0 / (np.pi * 2.0 * np.pi * hz * 0.02)
    by_hand = pg.evaluate(STUDY, changes(STUDY, {"damper": like}, 3.0)).margins
    assert rubbed["loop"]["gain_margin_db"] == pytest.approx(by_hand.gain_margin_db, abs=0.02)
    assert by_hand.gain_margin_hz == pytest.approx(hz, rel=2e-3)
    assert sum("cockpit.collective.damping_n_m_s_per_rad" in pilot for pilot in batch.asked) <= 9
    # twice the swing with twice the friction is the same
    evaluator.swing_m = 0.04
    assert evaluator.with_cures([{}], [{"friction": 60.0}])[0]["loop"]["gain_margin_db"] == pytest.approx(
        rubbed["loop"]["gain_margin_db"], abs=1e-3
    )


def test_friction_is_told_for_its_swing_and_never_proposed_unasked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cures_maps, "MAP_POINTS", 3)
    monkeypatch.setattr(cures_study, "CURVE_POINTS", 4)
    monkeypatch.setattr(cures_in_time, "LEVELS_N", (0.0, 5.0, 20.0))  # N
    text = MULTIBODY.replace("population: 100", "population: 4").replace("generations: 30", "generations: 1")
    text = text.replace("gearing_rad_per_m: 1.1", "gearing_rad_per_m: 2.6")
    study = tmp_path / "study.yaml"
    study.write_text(text + "\nlimits: {gain_margin_db: null, phase_margin_deg: null}\n")
    out = tmp_path / "out"
    options = ["cures", str(study), "-o", str(out), "--quiet", "--no-simulation", "--no-figures"]
    assert main([*options, "--only", "damper", "friction", "--swing", "20", "--map", "damper", "gearing"]) == 0
    told = capsys.readouterr().out
    found = json.loads((out / "cures.json").read_text())
    assert [row["key"] for row in found["cures"]] == ["damper", "friction"]  # friction last, whatever it buys
    row = found["cures"][1]
    assert found["swing_mm"] == 20.0 and row["by_name"] and not found["cures"][0]["by_name"]
    assert "in swings of 20 mm (larger ones feel less); costs 71 N of control force" in told
    unstable = [who for who in ("worst", "nominal") if found["pilots"][who]["stable"] is False]
    assert "worst" in unstable and list(row["smallest_swing_that_grows_mm"]) == unstable
    for who, swings in row["smallest_swing_that_grows_mm"].items():
        assert swings["more_n"][0] == swings["swing_mm"][0] == 0.0  # every swing, without friction
        known = [swing for swing in swings["swing_mm"] if swing is not None]
        assert known == sorted(known) and f"{who} pilot, unstable without: smallest swing that grows" in told
    assert found["proposal"]["amounts"] == {}
    for more, wanted in (
        (["--only", "damper", "--swing", "5"], "--swing is for friction, which is not among these cures"),
        (["--swing", "500"], "--swing 500: the lever's stops allow swings of 112 mm at most"),
    ):
        assert main([*options[:3], str(tmp_path / "other"), *more]) == 1
        assert wanted in capsys.readouterr().err and not (tmp_path / "other").exists()


def test_swings_that_cannot_be_told_say_why() -> None:
    study = study_from_text(MAYO)  # no deck
    swings = smallest_swings(study, {}, RunOptions())
    assert list(swings) == ["reason"] and "has no deck; use a multibody pilot" in swings["reason"]
    (line,) = _growing({"smallest_swing_that_grows_mm": {"worst": swings}})
    assert "worst pilot, unstable without: smallest swing that grows not told: " in line


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


@pytest.mark.parametrize("seed", range(4))
def test_filters_and_other_cures_together_have_margins(seed: int) -> None:
    # some 75 states, too many for exact arithmetic; crossings at low frequencies that are faint by the washout
    rng = np.random.default_rng(seed)
    known = catalogue.catalogue()
    amounts = {key: float(rng.uniform(cure.low, cure.high)) for key, cure in known.items() if rng.random() < 0.5}
    amounts["notch"] = float(rng.uniform(3.0, known["notch"].high))
    amounts.pop("friction", None)
    who = {"age_years": rng.uniform(25, 60), "bmi": rng.uniform(19, 29), "stature_m": rng.uniform(1.6, 1.95)}
    pilot = pg.evaluate(STUDY, {**{name: float(value) for name, value in who.items()}, **changes(STUDY, amounts, 3.65)})
    omega = np.geomspace(0.5, 200.0, 6_000)  # rad/s, an independent look
    L = pilot.open_loop()(1j * omega)
    assert pilot.margins.modulus_margin == pytest.approx(float(np.abs(1.0 + L).min()), abs=1e-4)
    crossed = np.flatnonzero((L.imag[:-1] * L.imag[1:] < 0.0) & (L.real[:-1] < -1e-3))
    if crossed.size and pilot.margins.stable:
        assert pilot.margins.gain_margin_db == pytest.approx(-20.0 * np.log10(-L.real[crossed].min()), abs=3e-2)


@pytest.mark.parametrize("damping", [19.592363455644602, 19.7203])
def test_a_lever_that_is_nearly_critically_damped_has_margins(damping: float) -> None:
    # two poles of arm and lever become one: large terms of partial fractions cancel, the state space has none
    tall = {"age_years": 25.0, "bmi": 27.69833654165268, "stature_m": 1.97935865232721}
    pilot = pg.evaluate(STUDY, {**tall, "cockpit.collective.damping_n_m_s_per_rad": damping})
    omega = np.geomspace(0.5, 200.0, 6_000)  # rad/s, an independent look
    L = pilot.open_loop()(1j * omega)
    crossed = np.flatnonzero((L.imag[:-1] * L.imag[1:] < 0.0) & (L.real[:-1] < -1e-6))
    assert pilot.margins.gain_margin_db == pytest.approx(-20.0 * np.log10(-L.real[crossed].min()), abs=2e-2)
    assert pilot.margins.stable


def test_the_closed_deck_with_fittings_has_the_poles_of_the_margins(tmp_path: Path) -> None:
    study = tmp_path / "study.yaml"
    study.write_text(MULTIBODY)
    change = changes(STUDY, {"damper": 10.0, "balance_weight": 1.0, "notch": 6.0}, 3.5)
    settings = [f"{path}={value!r}" for path, value in change.items()]
    assert main(["loop", str(study), "-o", str(tmp_path / "out"), "--set", *settings]) == 0  # 3 if poles differ
