"""Study files: what is read, and the message for every mistake.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import pickle
import random
import re
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pilotgen import study as study_module
from pilotgen.errors import FileError, StudyError
from pilotgen.fields import Choice, Number, Whole
from pilotgen.study import Inceptor, Study, apply_settings, read_study, study_from_text

ROOT = Path(__file__).parents[2]
STUDIES = ROOT / "docs" / "studies"

MULTIBODY = """\
study: test
rotorcraft: iar330-puma
inceptor: {lever_length_m: 0.32, gearing_rad_per_m: 1.1, position: 0.5}
pilot:
  model: multibody
  sex: male
  task: position
  limbs: [left]
  washout_rad_s: 3.10
nominal: {age_years: 40, bmi: 24, stature_m: 1.775}
search:
  variables: {age_years: [25, 65], bmi: [18, 30], stature_m: [1.55, 2.00]}
  objectives: [gain_margin_db, phase_margin_deg]
  population: 100
  generations: 30
  mutation_probability: 0.10
  seed: 1
"""
MAYO = """\
study: test
rotorcraft: iar330-puma
inceptor: {lever_length_m: 0.32, gearing_rad_per_m: 1.1}
pilot: {model: mayo}
nominal: mesomorphic
search:
  variables: {pilot_frequency_hz: [2.5, 4.0]}
  population: 10
  generations: 3
"""


def message_of(text: str) -> str:
    with pytest.raises(StudyError) as caught:
        study_from_text(text, "s.yaml")
    return str(caught.value)


def changed(old: str, new: str, text: str = MULTIBODY) -> str:
    assert text.count(old) >= 1, old
    return text.replace(old, new, 1)


def test_multibody_study() -> None:
    study = study_from_text(MULTIBODY, "s.yaml")
    assert study.name == "test"
    assert study.rotorcraft.mass_kg == 7345.0
    assert study.inceptor == Inceptor(0.32, 1.1, 0.5)
    assert study.pilot.limbs == ("left",)
    assert (study.pilot.projection, study.pilot.seat, study.pilot.task) == ("exact", "design_eye", "position")
    assert study.pilot.reflex is None and study.cockpit is None
    assert study.nominal == {"age_years": 40.0, "bmi": 24.0, "stature_m": 1.775}
    assert list(study.search.variables.items()) == [
        ("age_years", (25.0, 65.0)),
        ("bmi", (18.0, 30.0)),
        ("stature_m", (1.55, 2.0)),
    ]
    assert study.search.objectives == ("gain_margin_db", "phase_margin_deg")
    assert (study.search.population, study.search.generations, study.search.seed) == (100, 30, 1)
    assert (study.search.algorithm, study.search.stop_rank_one_fraction) == ("goldberg", 0.9)
    assert study.text == MULTIBODY and study.path == "s.yaml"
    assert study.where("search", "variables", "bmi") == "s.yaml:12"


def test_mayo_study_and_presets() -> None:
    study = study_from_text(MAYO)
    assert study.nominal == {"pilot_frequency_hz": 3.75, "pilot_damping": 0.28, "pilot_time_constant_s": 0.107}
    ectomorphic = study_from_text(changed("mesomorphic", "ectomorphic", MAYO))
    assert ectomorphic.nominal == {"pilot_frequency_hz": 3.38, "pilot_damping": 0.32, "pilot_time_constant_s": 0.117}
    assert study.pilot.washout_rad_s == 3.10
    assert (
        study_from_text(changed("{model: mayo}", "{model: mayo, washout_rad_s: null}", MAYO)).pilot.washout_rad_s
        is None
    )


def test_optional_keys() -> None:
    text = changed(
        "  limbs: [left]", "  limbs: [left, right]\n  reflex: {proportional_gain: 1.51, derivative_gain: 0.099}"
    )
    text = changed("nominal:", "cockpit: {hinge_height_m: 0.2}\nnominal:", text)
    text = changed("  seed: 1", "  algorithm: nsga2\n  stop_rank_one_fraction: null", text)
    study = study_from_text(text)
    assert study.pilot.limbs == ("left", "right")
    assert study.pilot.reflex is not None and study.pilot.reflex.derivative_gain == 0.099
    assert study.cockpit == {"hinge_height_m": 0.2}
    assert study.search.stop_rank_one_fraction is None and study.search.algorithm == "nsga2" and study.search.seed == 1


@pytest.mark.parametrize("file", sorted(STUDIES.glob("*.yaml")), ids=lambda file: file.stem)
def test_bundled_studies(file: Path) -> None:
    study = read_study(file)
    assert study.name == file.stem
    for name, (low, high) in study.search.variables.items():
        assert low <= study.nominal[name] <= high


def test_bundled_bounds_are_those_of_the_paper() -> None:
    table_4 = read_study(STUDIES / "puma-bmi.yaml").search
    assert table_4.variables == {"age_years": (25, 65), "bmi": (18, 30), "stature_m": (1.55, 2.0)}
    assert (table_4.population, table_4.generations, table_4.mutation_probability) == (100, 30, 0.1)
    assert read_study(STUDIES / "puma-mass.yaml").search.variables["mass_kg"] == (60, 110)
    section_5_1 = read_study(STUDIES / "puma-mayo.yaml").search.variables
    assert section_5_1 == {
        "pilot_frequency_hz": (2.5, 4.0),
        "pilot_damping": (0.2, 0.5),
        "pilot_time_constant_s": (0.06, 0.12),
    }
    assert read_study(STUDIES / "quick.yaml").search.population == 12


# old text, new text, the whole message
MISTAKES = [
    ("study: test\n", "", "s.yaml:1: key 'study' is missing at the top level; add it"),
    (
        "study: test",
        "study: 12",
        "s.yaml:1: study = 12 is not a name; at most 64 letters, digits, '-', '_' and '.' are wanted, such as puma-bmi",
    ),
    (
        "sex: male",
        "sexe: male",
        "s.yaml:6: pilot.sexe: key 'sexe' is not known here; did you mean 'sex'? known keys: model, washout_rad_s, "
        "sex, task, projection, seat, activation_floor, matrix_coefficient_s, limbs, reflex",
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
        "heights are in metres: 1775 mm is 1.775",
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
        "s.yaml:17: search.stop_rank_one_fraction = 0 would stop at once; write null to run all generations",
    ),
    (
        "{age_years: [25, 65], bmi: [18, 30], stature_m: [1.55, 2.00]}",
        "{}",
        "s.yaml:12: search.variables = {} is empty; name at least one of: age_years, mass_kg, bmi, stature_m",
    ),
    (
        "sex: male",
        "reflex: {proportional_gain: -1.5, derivative_gain: 0}\n  sex: male",
        "s.yaml:6: pilot.reflex.proportional_gain = -1.5 is outside 0 to 50; positive gains oppose stretch",
    ),
    (
        "nominal: {",
        "nominal: mesomorphic\nn: {",
        "s.yaml:11: n: key 'n' is not known here; known keys: study, rotorcraft, inceptor, pilot, "
        "cockpit, nominal, search",
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
        "s.yaml:10: cockpit.a.b[1] = nan is not finite; a number is wanted",
    ),
    (
        "nominal:",
        "cockpit: 3\nnominal:",
        "s.yaml:10: cockpit = 3 must be the name of a bundled cockpit or a mapping of cockpit values",
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
            "s.yaml:7: search.variables.stature_m: key 'stature_m' is not known here; known keys: "
            "pilot_frequency_hz, pilot_damping, pilot_time_constant_s",
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


@pytest.mark.parametrize("text", ["", "3", "[]", "null", "just words"])
def test_no_mapping_at_all(text: str) -> None:
    assert message_of(text).startswith("s.yaml:1: the file is ")


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="no such file"):
        read_study(tmp_path / "none.yaml")


def test_apply_settings() -> None:
    study = study_from_text(MULTIBODY)
    assert apply_settings(study, {}) == study.nominal
    assert apply_settings(study, {"stature_m": "2.1", "age_years": " 7e1 "}) == {
        "age_years": 70.0,
        "bmi": 24.0,
        "stature_m": 2.1,
    }
    assert apply_settings(study, {"mass_kg": "80"}) == {"age_years": 40.0, "stature_m": 1.775, "mass_kg": 80.0}
    assert study.nominal["bmi"] == 24.0, "the study itself does not change"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"stature": "1.8"},
            "--set stature=1.8: 'stature' is not a variable of this pilot model; did you mean 'stature_m'? "
            "choose one of: age_years, mass_kg, bmi, stature_m",
        ),
        (
            {"stature_m": "1775"},
            "--set stature_m=1775 is outside 1.3 to 2.2 m; heights are in metres: 1775 mm is 1.775",
        ),
        (
            {"age_years": "old"},
            "--set age_years=old is not a number; a number from 18 to 80 years is wanted; "
            "adults only: the regressions are of adults",
        ),
        (
            {"mass_kg": "80", "bmi": "24"},
            "--set mass_kg and --set bmi exclude each other: the stature gives one from the other; keep one",
        ),
    ],
)
def test_apply_settings_mistakes(options: dict[str, str], message: str) -> None:
    with pytest.raises(StudyError) as caught:
        apply_settings(study_from_text(MULTIBODY), options)
    assert str(caught.value) == message


def test_canonical_holds_what_determines_an_evaluation_and_nothing_else() -> None:
    same = study_from_text(MULTIBODY).canonical()
    assert json.loads(same)["pilot"]["washout_rad_s"] == 3.1
    for old, new in [
        ("study: test", "study: other # comment"),
        ("population: 100", "population: 50"),
        ("seed: 1", "seed: 2"),
        ("bmi: 24", "bmi: 25"),
        ("[18, 30]", "[19, 30]"),
        ("0.32", "3.2e-1"),
        ("  task: position\n", ""),
    ]:
        assert study_from_text(changed(old, new)).canonical() == same, new
    for old, new in [
        ("0.32", "0.33"),
        ("sex: male", "sex: female"),
        ("limbs: [left]", "limbs: [left, right]"),
        ("task: position", "task: force"),
        ("washout_rad_s: 3.10", "washout_rad_s: null"),
        ("nominal:", "cockpit: {a: 1}\nnominal:"),
        ("sex: male", "sex: male\n  reflex: {proportional_gain: 1, derivative_gain: 0}"),
    ]:
        assert study_from_text(changed(old, new)).canonical() != same, new


def test_a_study_can_be_sent_to_a_worker() -> None:
    study = study_from_text(MULTIBODY, "s.yaml")
    copy: Study = pickle.loads(pickle.dumps(study))
    assert copy == study and copy.canonical() == study.canonical() and copy.where("pilot") == "s.yaml:4"


def test_format_page_tells_every_key_with_its_range_and_default() -> None:
    page = (ROOT / "docs" / "io_formats" / "study.md").read_text(encoding="utf-8")
    tables = [
        study_module.INCEPTOR_FIELDS,
        study_module.COMMON_PILOT_FIELDS,
        study_module.MULTIBODY_PILOT_FIELDS,
        study_module.REFLEX_FIELDS,
        study_module.SEARCH_FIELDS,
        study_module.VARIABLES,
    ]
    for table in tables:
        for key, declared in table.items():
            rows = [line for line in page.splitlines() if line.startswith(f"| `{key}` |")]
            assert len(rows) == 1, key
            if isinstance(declared, Number):
                assert f"{declared.low:g} to {declared.high:g}" in rows[0], key
            if isinstance(declared, Whole):
                high = "2^63 - 1" if declared.high == 2**63 - 1 else str(declared.high)
                assert f"{declared.low} to {high}" in rows[0], key
            if isinstance(declared, Choice):
                assert all(f"`{word}`" in rows[0] for word in declared.choices), key
    for name in study_module.OBJECTIVES:
        assert f"`{name}`" in page
    examples = re.findall(r"```yaml\n(.*?)```", page, flags=re.DOTALL)
    assert examples
    for example in examples:
        study_from_text(example)


def test_reading_a_study_is_light() -> None:
    code = (
        "import sys, pilotgen.study as s; s.read_study(sys.argv[1]);"
        "heavy = {'numpy', 'scipy', 'matplotlib', 'pymoo', 'h5py', 'jsonschema'} & set(sys.modules);"
        "sys.exit(str(heavy) if heavy else 0)"
    )
    subprocess.run([sys.executable, "-c", code, str(STUDIES / "quick.yaml")], check=True, cwd=ROOT)


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
        assert re.match(r"s\.yaml:\d+: ", str(error)), str(error)
        assert "\n" not in str(error)
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
