"""Any number of a study by its path: what changes, what does not, and what is refused.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import json
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from study_texts import MAYO, MULTIBODY, changed, message_of

import pilotgen as pg
from pilotgen.anthropometry.biometrics import Biometrics
from pilotgen.anthropometry.body import make_body
from pilotgen.cli import main
from pilotgen.context import EvaluationContext
from pilotgen.errors import PilotgenError, StudyError
from pilotgen.evaluation import Evaluation, FailedEvaluation, evaluate
from pilotgen.runs.batch import replay_command
from pilotgen.runs.results import read_results
from pilotgen.search.problem import Problem
from pilotgen.study.fields import Vector
from pilotgen.study.schema import SCHEMA, applies, field_of, is_whole, locate, names, study_unit
from pilotgen.study.sections import calibrated_gains
from pilotgen.study.study import Study, study_from_text

STUDY = study_from_text(MULTIBODY, "s.yaml")
MAYO_STUDY = study_from_text(MAYO, "m.yaml")
NUMBERS = (  # those of the bundled rotorcraft but for its mass
    "{mass_kg: 6500, blades: 4, rotor_radius_m: 7.49, rotor_speed_hz: 4.5, lock_number: 8.7, "
    "flap_static_moment_kg_m: 276.48, flap_inertia_kg_m2: 1339.19, flap_frequency_ratio: 1.03}"
)


EQUIPMENT = {  # parts that a rotorcraft or lever may have, whole
    "rotorcraft.actuator.corner_rad_s": 30.0,
    "rotorcraft.low_pass.frequency_hz": 5.0,
    "rotorcraft.notch.frequency_hz": 3.0,
    "rotorcraft.notch.zero_damping": 0.1,
    "rotorcraft.notch.pole_damping": 0.6,
    "rotorcraft.sling.load_kg": 500.0,
    "rotorcraft.sling.stiffness_n_per_m": 1e5,
    "inceptor.friction.breakout_n": 60.0,
}
ROLLS = {
    "rotorcraft": "roll-uh60a",
    "loop.input": "roll",
    "loop.output": "lateral",
    "pilot.limbs": ["left", "right"],
    "rotorcraft.roll.lag.pole_hz": 3.2,
    "rotorcraft.roll.lag.pole_damping": 0.03,
    "rotorcraft.roll.lag.zero_hz": 3.0,
    "rotorcraft.roll.lag.zero_damping": 0.03,
}
OF_ROLL = ("rotorcraft.roll.", "loop.")  # which only a pilot with a body can do


def with_part_of(study: Study, name: str) -> Study:
    """The study, with the equipment that a number belongs to."""
    part = name.rpartition(".")[0]
    study = study.with_values(ROLLS)[0] if name.startswith(OF_ROLL) else study
    return study.with_values({own: number for own, number in EQUIPMENT.items() if own.startswith(f"{part}.")})[0]


def nearby(study: Study, name: str) -> float:
    """Another value within the limits: a tenth of the way from where it is to the farther limit."""
    declared: Any = field_of(name)
    value = study.value(name)
    value = declared.low if value is None else value
    limit = declared.high if declared.high - value > value - declared.low else declared.low
    if is_whole(name):
        return float(value + (1 if limit > value else -1))
    return float(value + 0.1 * (limit - value))


@pytest.mark.parametrize(
    ("study", "name"),
    [(s, name) for s in (STUDY, MAYO_STUDY) for name in names(s.pilot.model, numeric=True)
     if name != "mass_kg" and not (s is MAYO_STUDY and name.startswith(OF_ROLL))],
    ids=lambda value: value if isinstance(value, str) else value.pilot.model,
)  # fmt: skip
def test_every_number_can_be_changed_and_nothing_else_changes(study: Study, name: str) -> None:
    study = with_part_of(study, name)
    if name == "pilot.torso.modes_up_to_hz":
        study, _ = study.with_values({"pilot.torso.model": "modes"})
    new = nearby(study, name) if name != "rotorcraft.flap_static_moment_kg_m" else 300.0
    other, values = study.with_values({name: new})
    if name in study.nominal:
        assert other is study and values == {**study.nominal, name: new}
        return
    assert values == study.nominal and other.value(name) == new
    assert other.canonical() != study.canonical() or (locate(name)[0].startswith("cockpit") and study is MAYO_STUDY)
    for kept in names(study.pilot.model):
        path, _ = locate(kept)
        if path.partition("[")[0] != locate(name)[0] and path not in ("rotorcraft.source", "nominal.mass_kg"):
            assert other.value(kept) == study.value(kept), kept
    again, _ = other.with_values({name: new})
    assert again == other


def test_names_are_short_for_the_pilots_own_values_and_paths_for_the_rest() -> None:
    assert locate("stature_m") == locate("nominal.stature_m") == ("nominal.stature_m", None)
    assert locate("cockpit.lever.grip_m[1]") == ("cockpit.collective.grip_m", 1)
    assert study_unit("cockpit.lever.inertia_kg_m2") == "kg m^2" and study_unit("no such") == ""
    assert "rotorcraft.mass_kg" in names("mayo", numeric=True) and "mass_kg" not in names("mayo")
    assert "pilot.task" not in names("multibody", numeric=True) and "search.population" not in names(numeric=True)
    for path, row in SCHEMA.items():
        assert not isinstance(row, Vector) or row.entry.low == row.low
        assert applies(path, row.model or "multibody") or row.model == "mayo"


def test_a_gain_counts_on_top_of_the_calibrated_ones() -> None:
    calibrated = calibrated_gains("lumped")
    assert STUDY.value("pilot.reflex.derivative_gain") == calibrated["position"].derivative_gain
    study, _ = STUDY.with_values({"pilot.reflex.proportional_gain": 1.5, "pilot.task": "relax"})
    assert study.pilot.reflex == dataclasses.replace(calibrated["relax"], proportional_gain=1.5)
    assert study.with_values({"pilot.reflex": None})[0].pilot.reflex is None
    text = changed("  task: position", "  task: relax\n  reflex: {proportional_gain: 1.5}")
    assert study_from_text(text).pilot.reflex == study.pilot.reflex


def test_a_bundled_rotorcraft_with_another_number_says_so() -> None:
    study, _ = STUDY.with_values({"rotorcraft.mass_kg": 6000, "rotorcraft.blades": 5.0})
    assert study.rotorcraft.source == STUDY.rotorcraft.source + "; changed: mass_kg, blades"
    assert study.inceptor is STUDY.inceptor and study.rotorcraft.lock_number == STUDY.rotorcraft.lock_number


def test_a_named_set_comes_first_and_numbers_on_top_of_it() -> None:
    own = study_from_text(changed("rotorcraft: iar330-puma", f"rotorcraft: {NUMBERS}"))
    assert own.rotorcraft.mass_kg == 6500.0
    study, _ = own.with_values({"rotorcraft.blades": 5, "rotorcraft": "iar330-puma", "cockpit": "helicopter"})
    assert study.rotorcraft == dataclasses.replace(
        STUDY.rotorcraft, blades=5, source=f"{STUDY.rotorcraft.source}; changed: blades"
    )
    assert study.cockpit == STUDY.cockpit


def test_mass_and_body_mass_index_follow_from_each_other() -> None:
    assert STUDY.value("mass_kg") == 24.0 * 1.775**2
    heavy = study_from_text(changed("bmi: 24", "mass_kg: 80", changed("bmi: [18, 30], ", "")))
    assert heavy.value("bmi") == 80.0 / 1.775**2 and heavy.value("nominal.mass_kg") == 80.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gearing": 1.0}, "gearing = 1: 'gearing' is not a number or word of a study; did you mean 'inceptor."),
        ({"pilot.tsk": "relax"}, "pilot.tsk = 'relax': 'pilot.tsk' is not a number or word of a study; did you mean "),
        ({"pilot.task": "relaxed"}, "pilot.task = 'relaxed' is not known; did you mean 'relax'? choose one of: "),
        ({"pilot.reflex": 3}, "pilot.reflex = 3 is not null; "),
        ({"cockpit.seat": 3}, "cockpit.seat = 3: 'cockpit.seat' is a section; give one of: cockpit.seat.back_"),
        ({"cockpit.lever.grip_m[3]": 1}, "cockpit.lever.grip_m[3] = 1: 'cockpit.lever.grip_m[3]' has the entries [0"),
        ({"stature_m[0]": 1}, "stature_m[0] = 1: 'stature_m[0]' is not a list"),
        ({"search.variables": 1}, "search.variables = 1: 'search.variables' is not one number or word"),
        ({"pilot_damping": 0.3}, "pilot_damping = 0.3 means nothing for pilot.model = 'multibody'"),
        ({"mass_kg": 80.0, "bmi": 24.0}, "mass_kg = 80 and bmi exclude each other"),
        (
            {"cockpit.lever.mass_kg": 1, "cockpit.collective.mass_kg": 2},
            "cockpit.collective.mass_kg = 2 is the same as cockpit.lever.mass_kg; keep one of them",
        ),
        (
            {"cockpit.lever.lowest_angle_deg": 50.0},
            "cockpit.lever.lowest_angle_deg = 50 must be below highest_angle_deg = 40 deg; swap them",
        ),
        ({"rotorcraft.flap_static_moment_kg_m": 2000.0}, "rotorcraft.flap_static_moment_kg_m = 2000 is too large for "),
        ({"rotorcraft.mass_kg": 100.0}, "rotorcraft.mass_kg = 100: rotorcraft.flap_static_moment_kg_m = 276.48 is "),
        ({"pilot.model": "mayo"}, "pilot.model = 'mayo': another pilot model needs another nominal pilot"),
        ({"nominal": "ectomorphic"}, "nominal = 'ectomorphic' is no pilot of pilot.model = 'multibody'"),
        ({"inceptor.position": "1,5"}, "inceptor.position = '1,5' is not a number; a number from 0 to 1 is wanted; "),
    ],
)  # fmt: skip
def test_wrong_changes_are_told_by_the_name_they_were_given(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(StudyError) as caught:
        STUDY.with_values(changes)
    assert str(caught.value).startswith(message)


VARIABLES = "{age_years: [25, 65], bmi: [18, 30], stature_m: [1.55, 2.00]}"


def test_a_search_varies_any_number() -> None:
    box = "{stature_m: [1.55, 2], inceptor.gearing_rad_per_m: [0.8, 1.4], rotorcraft.blades: [3, 5]}"
    study = study_from_text(changed(VARIABLES, box))
    assert study.search.variables["inceptor.gearing_rad_per_m"] == (0.8, 1.4)
    problem = Problem.from_settings(study.search)
    values = problem.values(0.5 * (problem.xl + problem.xu) + 0.1)
    assert values["rotorcraft.blades"] == 4.0 and values["inceptor.gearing_rad_per_m"] == pytest.approx(1.2)


@pytest.mark.parametrize(
    ("box", "message"),
    [
        ("{pilot.task: [1, 2]}", "s.yaml:12: search.variables.pilot.task = [1, 2] is nothing that can vary"),
        ("{search.seed: [1, 2]}", "s.yaml:12: search.variables.search.seed = [1, 2] is nothing that can vary"),
        ("{gearing: [1, 2]}", "s.yaml:12: search.variables.gearing: 'gearing' is not a number or word of a study; "),
        ("{rotorcraft.mass_kg: [1, 2]}", "s.yaml:12: search.variables.rotorcraft.mass_kg[0] = 1 is outside 100 to "),
        ("{stature_m: [1,55, 2,00]}", "s.yaml:12: search.variables.stature_m = [1, 55, 2, 0] must be a list of two "
         "bounds, [lower, upper]; is the comma meant as a decimal point?"),
        ("{cockpit.lever.mass_kg: [1, 2], cockpit.collective.mass_kg: [1, 2]}",
         "s.yaml:12: search.variables.cockpit.collective.mass_kg = [1, 2] is the same number as cockpit.lever.mass_kg"),
        ("{pilot.washout_rad_s: [null, 2]}", "s.yaml:12: search.variables.pilot.washout_rad_s[0] = null is no bound"),
    ],
)  # fmt: skip
def test_boxes_that_no_search_can_use(box: str, message: str) -> None:
    assert message_of(changed(VARIABLES, box)).startswith(message)


CHANGES: dict[str, Any] = {
    "stature_m": 1.7,
    "rotorcraft.mass_kg": 6500.0,
    "inceptor.gearing_rad_per_m": 1.3,
    "pilot.strength_factor": 0.9,
    "pilot.task": "relax",
    "pilot.washout_rad_s": 2.0,
    "cockpit.lever.inertia_kg_m2": 0.1,
    "cockpit.lever.grip_m[1]": 0.26,
    "cockpit.seat.slump_m": 0.03,
}


def test_a_pilot_with_paths_is_the_pilot_of_a_study_with_those_numbers() -> None:
    with EvaluationContext(STUDY) as context:
        before = evaluate(context, STUDY.nominal)
        outcome = evaluate(context, STUDY.values(CHANGES))
        assert evaluate(context, STUDY.nominal).result == before.result, "nothing of it stays behind"
    cockpit = "cockpit: {seat: {slump_m: 0.03}, collective: {inertia_kg_m2: 0.1, grip_m: [0.33, 0.26, -0.25]}}"
    text = changed("rotorcraft: iar330-puma", f"rotorcraft: {NUMBERS}\n{cockpit}")
    for old, new in (
        ("gearing_rad_per_m: 1.1", "gearing_rad_per_m: 1.3"), ("task: position", "task: relax\n  strength_factor: 0.9"),
        ("3.10", "2.0"), ("stature_m: 1.775", "stature_m: 1.7"),
    ):  # fmt: skip
        text = changed(old, new, text)
    written = study_from_text(text)
    with EvaluationContext(written) as context:
        same = evaluate(context, written.nominal)
    assert isinstance(outcome, Evaluation) and isinstance(same, Evaluation)
    assert outcome.result["values"] == STUDY.values(CHANGES)
    assert {**outcome.result, "values": None} == {**same.result, "values": None}
    assert outcome.result["loop"] != before.result["loop"]


def test_strength_scales_every_muscle() -> None:
    whole, weak = (make_body(Biometrics(40.0, 1.775, 75.6, "male"), ("left", "right"), k) for k in (1.0, 0.8))
    assert weak.strength_factor == pytest.approx(0.8 * whole.strength_factor, rel=1e-15)
    for side, limb in whole.limbs.items():
        for muscle, weaker in zip(limb.muscles, weak.limbs[side].muscles, strict=True):
            assert pytest.approx(0.8 * muscle.F0_N, rel=1e-15) == weaker.F0_N
    with EvaluationContext(STUDY) as context:
        effort = [
            evaluate(context, STUDY.values({"pilot.strength_factor": k})).result["activation"]["sum_of_squares"]
            for k in (0.8, 1.0)
        ]
    # without passive forces a -> a / k and the sum of squares -> 1 / k^2; they hold a part of the torque
    assert 1.0 < effort[0] / effort[1] < 1.0 / 0.8**2


def test_a_corner_of_the_box_that_holds_no_rotorcraft_is_a_failed_pilot() -> None:
    with EvaluationContext(MAYO_STUDY) as context:
        outcome = evaluate(context, MAYO_STUDY.values({"rotorcraft.mass_kg": 100.0}))
    assert isinstance(outcome, FailedEvaluation) and outcome.stage == "study"
    assert "blades weigh more than the whole rotorcraft" in outcome.reason


@pytest.mark.parametrize("study", [STUDY, MAYO_STUDY], ids=["multibody", "mayo"])
def test_a_changed_study_can_be_written_down(study: Study) -> None:
    assert study.with_own_text() is study
    changes = {"rotorcraft.mass_kg": 6543.21, "pilot.washout_rad_s": None, "search.population": 20, "study": "1e3"}
    if study is STUDY:
        changes |= {"pilot.limbs": ["left", "right"], "cockpit.lever.grip_m[1]": 0.1 + 0.2}
        changes |= {"pilot.reflex.derivative_gain": 1e-7}
    changed_study, _ = study.with_values(changes)
    written = changed_study.with_own_text()
    again = study_from_text(written.text, written.path)
    assert again == written and dataclasses.replace(again, text=study.text) == changed_study
    assert written.with_own_text() is written and again.canonical() == changed_study.canonical()


@pytest.mark.parametrize("path", [path for path, row in SCHEMA.items() if row.numeric and applies(path, "multibody")])
def test_a_study_with_another_number_can_be_written_down(path: str) -> None:
    if path in ("nominal.mass_kg", "rotorcraft.flap_static_moment_kg_m") or path.startswith("nominal."):
        return  # of mass and body mass index one; the pilot's own values do not change the study
    for base in (STUDY, *(STUDY.with_values({"pilot.torso.model": model})[0] for model in ("modes", "rigid"))):
        base = with_part_of(base, path)
        try:
            other, _ = base.with_values({path: nearby(base, path)})
        except StudyError as error:
            text = str(error)
            needs = ("means nothing for pilot.torso.model = '", "lacks the key people", "names no population")
            needs += ("says of nothing that it is uncertain",)
            assert any(said in text for said in needs)
            continue
        written = other.with_own_text()
        assert dataclasses.replace(study_from_text(written.text), text=other.text, path=other.path) == other, (
            written.text
        )


def test_a_part_that_a_study_lacks_is_given_whole_or_not_at_all() -> None:
    notch = {name: EQUIPMENT[name] for name in ("rotorcraft.notch.frequency_hz", "rotorcraft.notch.zero_damping")}
    with pytest.raises(
        StudyError, match="needs rotorcraft.notch.pole_damping as well: this study has no rotorcraft.notch"
    ):
        STUDY.with_values(notch)
    whole, _ = STUDY.with_values({**notch, "rotorcraft.notch.pole_damping": 0.6})
    assert [whole.value(name) for name in notch] == [3.0, 0.1] and STUDY.value("rotorcraft.notch.zero_damping") is None
    # an actuator's damping is optional, its corner is not
    assert STUDY.with_values({"rotorcraft.actuator.corner_rad_s": 30.0})[0].value("rotorcraft.actuator.damping") is None
    with pytest.raises(
        StudyError, match=r"rotorcraft\.actuator\.damping = 0\.7 needs rotorcraft\.actuator\.corner_rad_s"
    ):
        STUDY.with_values({"rotorcraft.actuator.damping": 0.7})
    with pytest.raises(
        StudyError, match="mean.mass_kg = 70: population = {own: {mean: {mass_kg: 70}}} lacks the key people"
    ):
        STUDY.with_values({"population.own.mean.mass_kg": 70.0})


def test_the_python_door_takes_any_number(tmp_path: Path) -> None:
    pilot = pg.evaluate(MAYO_STUDY, {"inceptor.gearing_rad_per_m": 0.55})
    whole = pg.evaluate(MAYO_STUDY)
    # half the gearing is half the loop gain: 20 log10 2 more gain margin
    assert pilot.margins.gain_margin_db - whole.margins.gain_margin_db == pytest.approx(6.0206, abs=1e-4)
    with pytest.raises(StudyError, match="did you mean 'inceptor.gearing_rad_per_m'"):
        pg.evaluate(MAYO_STUDY, {"gearing": 0.55})
    with pytest.raises(PilotgenError, match=r"rotorcraft is not a number; change it in the study"):
        pg.evaluate_many(MAYO_STUDY, [{"rotorcraft": "iar330-puma"}])


def test_search_over_paths_from_study_to_replay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    box = "{pilot_frequency_hz: [2.5, 4], inceptor.gearing_rad_per_m: [0.8, 1.4], rotorcraft.blades: [3, 5]}"
    file = tmp_path / "s.yaml"
    file.write_text(changed("{pilot_frequency_hz: [2.5, 4.0]}", box, MAYO))
    out = tmp_path / "out"
    assert main(["search", str(file), "-o", str(out), "--workers", "1", "--quiet"]) == 0
    assert "inceptor.gearing_rad_per_m" in capsys.readouterr().out
    results = read_results(out / "study.h5")
    assert results.names == ("pilot_frequency_hz", "inceptor.gearing_rad_per_m", "rotorcraft.blades")
    assert set(results.columns["inputs"][:, 2]) <= {3.0, 4.0, 5.0} and (results.columns["status"] == "ok").all()
    report = (out / "report.html").read_text()
    command = re.search(r"pilotgen pilot study.yaml -o replay --set ([^<]*)", report)
    assert command is not None and "inceptor.gearing_rad_per_m=" in command[1]
    worst = int(np.argmin(results.columns["gain_margin_db"]))
    values = dict(zip(results.names, results.columns["inputs"][worst].tolist(), strict=True))
    line = replay_command(str(file), values, directory=str(tmp_path / "again"))
    assert main(shlex.split(line)[1:] + ["--no-figures"]) == 0
    result = json.loads((tmp_path / "again" / "result.json").read_text())
    assert result["loop"]["gain_margin_db"] == results.columns["gain_margin_db"][worst]
    assert main(["search", str(file), "-o", str(out), "--workers", "1", "--resume", "--quiet"]) == 0
    assert "0 failed, 0.0 s of CPU" in capsys.readouterr().out, "everything is in the journal"


def test_set_beyond_the_box_is_noted_and_search_settings_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "s.yaml"
    file.write_text(MAYO)
    options = ["pilot", str(file), "--no-figures", "-o"]
    assert main([*options, str(tmp_path / "a"), "--set", "nominal.pilot_frequency_hz=4.5"]) == 0
    assert "note: pilot_frequency_hz = 4.5 Hz is outside the study's search box, 2.5 to 4 Hz" in capsys.readouterr().err
    assert main([*options, str(tmp_path / "b"), "--set", "pilot_frequency_hz=3.5"]) == 0
    assert "note" not in capsys.readouterr().err
    words = ["rotorcraft.mass_kg=7000", "rotorcraft=iar330-puma", "pilot.washout_rad_s=null"]
    assert main([*options, str(tmp_path / "d"), "--set", *words]) == 0
    told = capsys.readouterr().out
    assert "with       rotorcraft.mass_kg 7000, rotorcraft iar330-puma, pilot.washout_rad_s null\n" in told
    assert main([*options, str(tmp_path / "c"), "--set", "cockpit.lever.grip_m=[0.3"]) == 1
    assert "--set cockpit.lever.grip_m=[0.3: a list is written [a, b, c]" in capsys.readouterr().err
    assert main([*options, str(tmp_path / "c"), "--set", "search.population=8"]) == 1
    assert "--set search.population=8 would do nothing: `pilotgen pilot` makes no use of it" in capsys.readouterr().err
    assert not (tmp_path / "c").exists()


JUNK = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=4) | st.lists(st.floats(), max_size=4)


@settings(max_examples=300, deadline=None)
@given(st.sampled_from([*SCHEMA, *names(numeric=True), "cockpit.lever.mass_kg", "x", "", "a[1]", "[0]"]), JUNK)
def test_any_value_at_any_path_is_taken_or_refused(name: str, data: object) -> None:
    for study in (STUDY, MAYO_STUDY):
        try:
            changed_study, values = study.with_values({name: data})
        except StudyError as error:
            assert str(error).startswith(name), str(error)
        else:
            assert json.loads(changed_study.canonical()) and set(values) == set(study.values(values))
