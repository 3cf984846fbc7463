"""Study files with mistakes: the message for each, and one message whatever the damage.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import random
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from study_texts import MAYO, MULTIBODY, changed, message_of

from pilotgen.errors import FileError, StudyError
from pilotgen.study.study import read_study, study_from_text

MISTAKES = [
    ("study: test\n", "", "s.yaml:1: key 'study' is missing at the top level; add it"),
    (
        "study: test",
        "study: 12",
        "s.yaml:1: study = 12 is not a name; at most 64 letters, digits, '-', '_' and '.' are wanted, such as "
        "puma-bmi; put it in quotes if that is what you mean: '12'",
    ),
    (
        "sex: male",
        "sexe: male",
        "s.yaml:6: pilot.sexe: key 'sexe' is not known here; did you mean 'sex'? known keys: model, washout_rad_s, "
        "sex, task, projection, seat, activation_floor, strength_factor, reflex_delay_s, "
        "reflex_undelayed_share, reflex_pade_order, matrix_coefficient_s, limbs, reflex, torso",
    ),
    ("sex: male", "sex: man", "s.yaml:6: pilot.sex = 'man' is not known; choose one of: male, female"),
    ("  sex: male\n", "", "s.yaml:4: key 'sex' is missing in 'pilot'; add it"),
    ("model: multibody", "model: yes", "s.yaml:5: pilot.model = 'yes' is not known; choose one of: multibody, mayo"),
    (
        "1.775",
        "1775",
        "s.yaml:10: nominal.stature_m = 1775 is outside 1.3 to 2.2 m; heights are in metres: 1775 mm is 1.775",
    ),
    (
        "[1.55, 2.00]",
        "[1550, 2000]",
        "s.yaml:12: search.variables.stature_m[0] = 1550 is outside 1.3 to 2.2 m; "
        "heights are in metres: 1550 mm is 1.55",
    ),
    (
        "[18, 30]",
        "[30, 18]",
        "s.yaml:12: search.variables.bmi = [30, 18] has its lower bound above its upper bound; did you "
        "swap the bounds?",
    ),
    (
        "[18, 30]",
        "[24, 24]",
        "s.yaml:12: search.variables.bmi = [24, 24] has equal bounds; to hold a value fixed leave bmi out here and "
        "set it in nominal",
    ),
    ("[18, 30]", "18", "s.yaml:12: search.variables.bmi = 18 must be a list of two bounds, [lower, upper]"),
    ("[18, 30]", "[18]", "s.yaml:12: search.variables.bmi = [18] must be a list of two bounds, [lower, upper]"),
    (
        "[18, 30]",
        "[18, thirty]",
        "s.yaml:12: search.variables.bmi[1] = 'thirty' is not a number; a number from 14 to 50 kg/m^2 is wanted; "
        "body mass index is mass in kg over the square of stature in m",
    ),
    (
        "lever_length_m: 0.32",
        "lever_length_m: 320",
        "s.yaml:3: inceptor.lever_length_m = 320 is outside 0.1 to 1 m; lengths are in metres: 320 mm is 0.32",
    ),
    (
        "washout_rad_s: 3.10",
        "washout_rad_s: none",
        "s.yaml:9: pilot.washout_rad_s = 'none' is not a number; a number from 0.01 to 100 rad/s is wanted; "
        "write null for no washout",
    ),
    ("limbs: [left]", "limbs: left", "s.yaml:8: pilot.limbs = 'left' must be a list of one or more of: left, right"),
    ("limbs: [left]", "limbs: []", "s.yaml:8: pilot.limbs = [] must be a list of one or more of: left, right"),
    (
        "limbs: [left]",
        "limbs: [right]",
        "s.yaml:8: pilot.limbs = ['right'] must contain left: the left hand holds the collective lever",
    ),
    (
        "limbs: [left]",
        "limbs: [left, left]",
        "s.yaml:8: pilot.limbs = ['left', 'left'] names something twice; keep one",
    ),
    ("bmi: 24, ", "", "s.yaml:10: key 'mass_kg' or 'bmi' is missing in 'nominal'; add it"),
    (
        "bmi: 24",
        "bmi: 24, mass_kg: 76",
        "s.yaml:10: nominal.mass_kg = 76 and bmi exclude each other: the stature gives one from the "
        "other; keep one of them",
    ),
    (
        "bmi: 24",
        "mass_kg: 76",
        "s.yaml:12: search.variables.bmi = [18, 30] does not go with nominal.mass_kg; use mass_kg in "
        "both or bmi in both",
    ),
    (
        "population: 100",
        "population: 1e2.",
        "s.yaml:14: search.population = '1e2.' is not a whole number; one from 4 to 100000 is wanted",
    ),
    (
        "population: 100",
        "population: 3",
        "s.yaml:14: search.population = 3 is outside 4 to 100000; choose a number in that range",
    ),
    (
        "population: 100",
        "population: 101\n  algorithm: nsga2",
        "s.yaml:14: search.population = 101 must be even for search.algorithm = 'nsga2', which mates in pairs",
    ),
    (
        "generations: 30",
        "generations: true",
        "s.yaml:15: search.generations = true is not a whole number; one from 1 to 100000 is wanted",
    ),
    (
        "mutation_probability: 0.10",
        "mutation_probability: 10",
        "s.yaml:16: search.mutation_probability = 10 is outside 0 to 1; a probability is a fraction: 10 % is 0.10",
    ),
    (
        "[gain_margin_db,",
        "[gain_margin,",
        "s.yaml:13: search.objectives[0] = 'gain_margin' is not known; did you mean 'gain_margin_db'? choose one of: "
        "gain_margin_db, phase_margin_deg, modulus_margin",
    ),
    (
        "  seed: 1",
        "  stop_rank_one_fraction: 0",
        "s.yaml:17: search.stop_rank_one_fraction = 0 would stop at once; write null for no such stop",
    ),
    (
        "{age_years: [25, 65], bmi: [18, 30], stature_m: [1.55, 2.00]}",
        "{}",
        "s.yaml:12: search.variables = {} is empty; name at least one of: age_years, mass_kg, bmi, stature_m, or any "
        "other number by its path",
    ),
    (
        "sex: male",
        "reflex: {proportional_gain: -1.5, derivative_gain: 0}\n  sex: male",
        "s.yaml:6: pilot.reflex.proportional_gain = -1.5 is outside 0 to 50; positive gains oppose stretch",
    ),
    (
        "nominal: {",
        "nominal: mesomorphic\nn: {",
        "s.yaml:10: nominal = 'mesomorphic' is no multibody pilot; give {age_years, stature_m, and mass_kg or bmi}, "
        "or pilot.model: mayo, which knows pilots by that name\n"
        "s.yaml:11: n: key 'n' is not known here; known keys: study, rotorcraft, loop, inceptor, pilot, "
        "cockpit, nominal, search, population, sensitivity, uncertain, limits",
    ),
    (
        "{age_years: 40, bmi: 24, stature_m: 1.775}",
        "mesomorphic",
        "s.yaml:10: nominal = 'mesomorphic' is no multibody pilot; give {age_years, stature_m, and mass_kg or bmi}, "
        "or pilot.model: mayo, which knows pilots by that name",
    ),
    (
        "{lever_length_m: 0.32, gearing_rad_per_m: 1.1, position: 0.5}",
        "",
        "s.yaml:3: inceptor = null is empty; a mapping with the keys lever_length_m, gearing_rad_per_m is wanted",
    ),
    (
        "nominal:",
        "cockpit: {a: {b: [1, .nan]}}\nnominal:",
        "s.yaml:10: cockpit.a: key 'a' is not known here; known keys: seat, shoulder, collective, cyclic",
    ),
    (
        "nominal:",
        "cockpit: {cyclic: {grip_m: [1, .nan, 0]}}\nnominal:",
        "s.yaml:10: cockpit.cyclic.grip_m[1] = nan is outside -1 to 1.5 m; position from the neutral seat reference "
        "point: x forward, y up, z right",
    ),
    (
        "nominal:",
        "cockpit: 3\nnominal:",
        "s.yaml:10: cockpit = 3 is not a mapping; one of helicopter or a mapping with the keys seat, shoulder, "
        "collective, cyclic is wanted",
    ),
]


@pytest.mark.parametrize(("old", "new", "message"), MISTAKES, ids=[f"{new or old}"[:40] for old, new, _ in MISTAKES])
def test_mistakes(old: str, new: str, message: str) -> None:
    assert message_of(changed(old, new)) == message


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "mesomorphic",
            "endomorphic",
            "s.yaml:5: nominal = 'endomorphic' is no pilot that Mayo measured; choose one of: ectomorphic, mesomorphic",
        ),
        (
            "{model: mayo}",
            "{model: mayo, sex: male}",
            "s.yaml:4: pilot.sex = 'male' means nothing for pilot.model = 'mayo'; remove it",
        ),
        (
            "nominal:",
            "cockpit: x\nnominal:",
            "s.yaml:5: cockpit = 'x' means nothing for pilot.model = 'mayo'; remove it",
        ),
        (
            "nominal: mesomorphic",
            "nominal: {pilot_frequency_hz: 3.7, pilot_damping: 28, pilot_time_constant_s: 0.1}",
            "s.yaml:5: nominal.pilot_damping = 28 is outside 0.01 to 1.5; the damping ratio is a fraction: "
            "32 % is 0.32",
        ),
        (
            "pilot_frequency_hz: [2.5, 4.0]",
            "stature_m: [1.5, 2]",
            "s.yaml:7: search.variables.stature_m = [1.5, 2] means nothing for pilot.model = 'mayo'; remove it",
        ),
    ],
)
def test_mistakes_of_mayo_studies(old: str, new: str, message: str) -> None:
    assert message_of(changed(old, new, MAYO)) == message


def test_rotorcraft_mistakes_name_the_line() -> None:
    assert message_of(changed("iar330-puma", "puma")).startswith(
        "s.yaml:2: rotorcraft = 'puma' is not known; did you mean 'iar330"
    )
    table_1 = (
        "\n  mass_kg: 7345\n  blades: 4\n  rotor_radius_m: 7.49\n  rotor_speed_hz: 28.27\n  lock_number: 8.7\n"
        "  flap_static_moment_kg_m: 276.48\n  flap_inertia_kg_m2: 1339.19\n  flap_frequency_ratio: 1.03"
    )
    message = message_of(changed(" iar330-puma", table_1))
    assert message.startswith("s.yaml:6: rotorcraft.rotor_speed_hz = 28.27") and "rad/s" in message
    study = study_from_text(changed(" iar330-puma", table_1.replace("28.27", "4.5")))
    assert study.rotorcraft.rotor_speed_hz == 4.5


def test_mistakes_are_told_together() -> None:
    text = changed("sex: male", "sex: man")
    text = changed(
        "0.32", "320", changed("stature_m: 1.775", "stature_m: 1,775", changed("seed: 1", "seed: 1.5", text))
    )
    assert message_of(text).split("\n") == [
        "s.yaml:3: inceptor.lever_length_m = 320 is outside 0.1 to 1 m; lengths are in metres: 320 mm is 0.32",
        "s.yaml:6: pilot.sex = 'man' is not known; choose one of: male, female",
        "s.yaml:10: nominal.stature_m = 1 is outside 1.3 to 2.2 m; heights are in metres: 1775 mm is 1.775",
        "s.yaml:10: nominal.775: key '775' is not known here; is the comma before it meant as a decimal point? write "
        "1.775, not 1,775",
        "s.yaml:17: search.seed = 1.5 is not a whole number; one from 0 to 9223372036854775807 is wanted",
    ]
    many = message_of("study: test\n" + "".join(f"key{k}: 1\n" for k in range(20))).split("\n")
    assert len(many) == 11 and many[9].startswith("s.yaml:11: key9") and many[10] == "s.yaml:12: and 15 more mistakes"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("study: test", "study: 2024", "puma-bmi; put it in quotes if that is what you mean: '2024'"),
        ("lever_length_m: 0.32", "lever_length_m: '0,32'", "; the decimal point is a point: write 0.32"),
        ("[1.55, 2.00]", "[1,55, 2,00]", "; is the comma meant as a decimal point? write 1.775, not 1,775"),
        ("washout_rad_s: 3.10", "washout_rad_s: 3,10", "; the decimal point is a point: write 3.10"),
    ],
)
def test_hints(old: str, new: str, message: str) -> None:
    assert message in message_of(changed(old, new))


@pytest.mark.parametrize("text", ["", "3", "[]", "null", "just words"])
def test_no_mapping_at_all(text: str) -> None:
    assert message_of(text).startswith("s.yaml:1: the file is ")


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no such file"):
        read_study(tmp_path / "none.yaml")


# Random damage: whatever happens to a valid study, the answer is a study or one message with file and line.
WORDS = [
    "[",
    "]",
    "{",
    "}",
    ":",
    "\n",
    " ",
    "'",
    "&a",
    "*a",
    "no",
    "-1",
    "1e400",
    ".nan",
    "null",
    "left",
    "!!x",
    "é",
    "\t",
    "🚁",
]


@settings(max_examples=300, deadline=None)
@given(st.sampled_from([MULTIBODY, MAYO]), st.integers(0, 2**32), st.integers(1, 4))
def test_damaged_studies(text: str, seed: int, wounds: int) -> None:
    rng = random.Random(seed)
    for _ in range(wounds):
        start = rng.randrange(len(text))
        text = text[:start] + rng.choice(WORDS) + text[start + rng.choice([0, 0, 1, 3, 10]) :]
    try:
        study = study_from_text(text, "s.yaml")
    except StudyError as error:
        for line in str(error).split("\n"):
            assert re.match(r"s\.yaml:\d+: ", line), str(error)
    else:
        assert json.loads(study.canonical())


@settings(max_examples=200, deadline=None)
@given(st.sampled_from(sorted({line.split(":")[0].strip() for line in MULTIBODY.splitlines()})), st.data())
def test_any_value_at_any_key(key: str, data: st.DataObject) -> None:
    scalars = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
    value = data.draw(
        st.recursive(
            scalars,
            lambda s: st.lists(s, max_size=3) | st.dictionaries(st.text(min_size=1), s, max_size=3),
            max_leaves=5,
        )
    )
    text = re.sub(rf"(?m)^(\s*){key}:.*$", lambda match: f"{match[1]}{key}: {json.dumps(value)}", MULTIBODY)
    try:
        study_from_text(text, "s.yaml")
    except StudyError as error:
        assert re.match(r"s\.yaml:\d+: ", str(error)), str(error)


RIGID = "means nothing for pilot.torso.model = 'rigid'"


@pytest.mark.parametrize(
    ("pilot", "cockpit", "words"),
    [
        ("torso: {buttocks: {vertical_n_per_m: 0}}", "", "pilot.torso.buttocks.vertical_n_per_m = 0 is outside 100 to"),
        ("torso: {lumbar: {axial_n_per_m: -2e5}}", "", "pilot.torso.lumbar.axial_n_per_m = -200000 is outside"),
        ("torso: {neck: {pitch_n_m_s_per_rad: -1}}", "", "pilot.torso.neck.pitch_n_m_s_per_rad = -1 is outside 0 to"),
        ("torso: {age_trend: 1}", "", "pilot.torso.age_trend = 1 is neither true nor false"),
        ("torso: {modle: rigid}", "", "did you mean 'model'?"),
        (
            "torso: {model: rigid}",
            "seat: {cushion: {stiffness_n_per_m: 2e5}}",
            "means nothing for pilot.torso.model = 'rigid'",
        ),
        (
            "torso: {model: rigid}",
            "seat: {back: {normal_n_per_m: 2e4}}",
            "means nothing for pilot.torso.model = 'rigid'",
        ),
        ("torso: {model: rigid, bmi_trend: false}", "", RIGID),
        ("torso: {model: lumped, modes_up_to_hz: 30}", "", "'lumped', which has no modes"),
        ("torso: {modes_up_to_hz: 30}", "", "modes_up_to_hz = 30 means nothing for pilot.torso.model = 'lumped'"),
        (
            "sex: male",
            "seat: {cushion: {stiffness_n_per_m: -1}}",
            "cushion.stiffness_n_per_m = -1 is outside",
        ),
        ("torso: {girdle: off}", "", "pilot.torso.girdle = 'off'"),
    ],
)
def test_mistakes_about_the_torso(pilot: str, cockpit: str, words: str) -> None:
    text = changed("  sex: male", f"  sex: male\n  {pilot}" if pilot != "sex: male" else "  sex: male")
    text += f"cockpit:\n  {cockpit}\n" if cockpit else ""
    with pytest.raises(StudyError, match=re.escape(words)):
        study_from_text(text, "s.yaml")


def test_springs_of_a_rigid_torso_by_their_paths() -> None:
    study = study_from_text(changed("  sex: male", "  sex: male\n  torso: {model: rigid}"), "s.yaml")
    with pytest.raises(StudyError, match="means nothing for pilot.torso.model = 'rigid'"):
        study.with_values({"cockpit.seat.cushion.stiffness_n_per_m": 2e5})
    moved, _ = study.with_values({"pilot.torso.model": "lumped", "cockpit.seat.cushion": "none"})
    assert moved.cockpit["seat"]["cushion"] is None and moved.pilot.torso["model"] == "lumped"
