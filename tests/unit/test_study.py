"""Study files: what is read, and what becomes of it.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import pickle
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from study_texts import MAYO, MULTIBODY, changed

from pilotgen.errors import StudyError
from pilotgen.study.cockpit_numbers import cockpit_numbers
from pilotgen.study.fields import Choice, Number, Section, Truth, Vector, Whole, Words
from pilotgen.study.schema import SCHEMA
from pilotgen.study.sections import Inceptor
from pilotgen.study.settings import apply_settings
from pilotgen.study.study import Study, read_study, study_from_text
from pilotgen.study.torso_numbers import torso_from
from pilotgen.study.yaml_file import bundled

ROOT = Path(__file__).parents[2]
STUDIES = ROOT / "docs" / "studies"


def test_multibody_study() -> None:
    study = study_from_text(MULTIBODY, "s.yaml")
    assert study.name == "test"
    assert study.rotorcraft.mass_kg == 7345.0
    assert study.inceptor == Inceptor(0.32, 1.1, 0.5)
    assert study.pilot.limbs == ("left",)
    assert (study.pilot.projection, study.pilot.seat, study.pilot.task) == ("exact", "design_eye", "position")
    assert study.pilot.reflex is None and study.cockpit == cockpit_numbers()
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
    text = changed("nominal:", "cockpit: {seat: {slump_m: 0.03}}\nnominal:", text)
    text = changed("  seed: 1", "  algorithm: nsga2\n  stop_rank_one_fraction: null", text)
    study = study_from_text(text)
    assert study.pilot.limbs == ("left", "right")
    assert study.pilot.reflex is not None and study.pilot.reflex.derivative_gain == 0.099
    assert study.cockpit == cockpit_numbers({"seat": {"slump_m": 0.03}})
    assert study.search.stop_rank_one_fraction is None and study.search.algorithm == "nsga2" and study.search.seed == 1


@pytest.mark.parametrize("file", sorted(STUDIES.glob("*.yaml")), ids=lambda file: file.stem)
def test_bundled_studies(file: Path) -> None:
    study = read_study(file)
    assert study.name == file.stem
    for name, (low, high) in study.search.variables.items():
        if name in study.nominal:  # others are numbers of the study by their paths
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


def test_apply_settings() -> None:
    study = study_from_text(MULTIBODY)
    assert apply_settings(study, {}) == (study, study.nominal)
    same, values = apply_settings(study, {"stature_m": "2.1", "age_years": " 7e1 "})
    assert same is study and values == {"age_years": 70.0, "bmi": 24.0, "stature_m": 2.1}
    assert apply_settings(study, {"mass_kg": "80"})[1] == {"age_years": 40.0, "stature_m": 1.775, "mass_kg": 80.0}
    assert study.nominal["bmi"] == 24.0, "the study itself does not change"
    changed_study, values = apply_settings(
        study, {"pilot.task": "relax", "nominal.stature_m": "1.8", "cockpit.lever.grip_m": "[0.3, 0.25, -0.25]"}
    )
    assert changed_study.pilot.task == "relax" and changed_study.cockpit["collective"]["grip_m"] == [0.3, 0.25, -0.25]
    assert values == {
        **study.nominal, "stature_m": 1.8, "pilot.task": "relax", "cockpit.lever.grip_m": [0.3, 0.25, -0.25]
    }  # fmt: skip


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"stature": "1.8"},
            "--set stature=1.8: 'stature' is not a number or word of a study; did you mean 'stature_m'? every key of a "
            "study file can be given by its path, such as inceptor.gearing_rad_per_m (docs/io_formats/study.md)",
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
            "--set mass_kg=80 and bmi exclude each other: the stature gives one from the other; keep one",
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
        ("nominal:", "cockpit: {seat: {slump_m: 0.03}}\nnominal:"),
        ("sex: male", "sex: male\n  reflex: {proportional_gain: 1, derivative_gain: 0}"),
    ]:
        assert study_from_text(changed(old, new)).canonical() != same, new


def test_a_study_can_be_sent_to_a_worker() -> None:
    study = study_from_text(MULTIBODY, "s.yaml")
    copy: Study = pickle.loads(pickle.dumps(study))
    assert copy == study and copy.canonical() == study.canonical() and copy.where("pilot") == "s.yaml:4"


def test_format_page_tells_every_key_with_its_unit_range_and_default() -> None:
    page = (ROOT / "docs" / "io_formats" / "study.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `([A-Za-z0-9_.]+)` \|(.*)\|$", page, flags=re.MULTILINE))
    torso = {**torso_from(None), "girdle": bundled("torso").value["girdle"]}
    for path, declared in SCHEMA.items():
        key = path.removeprefix("nominal.")
        if isinstance(declared, Section) and key not in rows:
            continue
        assert key in rows, path
        cells = [cell.strip() for cell in rows[key].split("|")]
        told = " | ".join(cells)
        if isinstance(declared, Number | Whole | Vector):
            high = "2^63 - 1" if declared.high == 2**63 - 1 else f"{declared.high:g}"
            assert f"{declared.low:g} to {high}" in told, path
            assert (declared.unit or "-") in told, path
        if isinstance(declared, Choice | Words) and path != "search.objectives":
            assert all(f"`{word}`" in told for word in declared.choices), path
        if isinstance(declared, Number) and isinstance(declared.default, float):
            assert declared.default in [float(cell) for cell in cells if re.fullmatch(r"[0-9.]+", cell)], path
        if path.startswith(("cockpit.", "pilot.torso.")) and not isinstance(declared, Section | Truth | Choice):
            value: Any = {"cockpit": cockpit_numbers(), "pilot": {"torso": torso}}
            for name in path.split("."):
                value = value[name]
            assert (str(value) if isinstance(value, list) else f"{value:g}") in cells, path
        if not isinstance(declared, Section):
            assert declared.meaning in told, path
    examples = re.findall(r"```yaml\n(.*?)```", page, flags=re.DOTALL)
    assert examples
    for example in examples:
        study_from_text(example)


def test_reading_a_study_is_light() -> None:
    code = (
        "import sys, pilotgen.study.study as s; s.read_study(sys.argv[1]);"
        "heavy = {'numpy', 'scipy', 'matplotlib', 'pymoo', 'h5py', 'jsonschema'} & set(sys.modules);"
        "sys.exit(str(heavy) if heavy else 0)"
    )
    subprocess.run([sys.executable, "-c", code, str(STUDIES / "quick.yaml")], check=True, cwd=ROOT)
