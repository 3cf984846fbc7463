"""`--set` of runs over many pilots: what is recorded, what resumes, what is refused because it would do nothing.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import json
import re
import shlex
from pathlib import Path

import pytest
from command_line import MAYO, QUICK, STUDIES, Run, refused

from pilotgen.commands.settings import again
from pilotgen.runs.results import read_results
from pilotgen.study.settings import changed_study
from pilotgen.study.study import read_study

GEARING = "inceptor.gearing_rad_per_m=0.9"


def test_every_command_that_reads_a_study_takes_settings(run: Run) -> None:
    _, out, _ = run("--help")
    for command in re.findall(r"^    ([a-z-]+) ", out, re.MULTILINE):
        told = run(command, "--help")[1]
        if "STUDY.yaml" in told.partition("options:")[0]:
            assert "--set NAME=VALUE" in told, command
    assert "--set NAME=VALUE" in run("rotorcraft", "--help")[1]


def test_the_changed_study_is_what_is_recorded_and_what_goes_on(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = [MAYO, "-o", out, "--workers", "1", "--no-report", "--quiet"]
    code, _, err = run("search", *words, "--set", GEARING, "search.generations=2", "pilot_frequency_hz=3.1")
    assert code == 0, err
    assert "pilot_frequency_hz = 3.1 Hz is of the nominal pilot alone: the search varies it" in err
    kept = read_study(out / "study.yaml")
    assert (kept.inceptor.gearing_rad_per_m, kept.search.generations) == (0.9, 2)
    assert kept.nominal["pilot_frequency_hz"] == 3.1
    text = str(read_results(out / "study.h5").attributes["study_text"])
    assert text == (out / "study.yaml").read_text()
    code, _, err = run("search", *words, "--resume")
    assert code == 1 and re.search(r"inceptor.gearing_rad_per_m +0\.9 +1\.1", err), err
    code, told, _ = run("search", *words, "--resume", "--json", "--set", GEARING, "search.generations=3")
    assert code == 0 and json.loads(told)["served"] > 0 and json.loads(told)["report"] is None
    kept = read_study(out / "study.yaml")
    assert run("search", out / "study.yaml", *words[1:], "--resume")[0] == 0


@pytest.mark.parametrize("kind", [("sample", "-n", "3"), ("sensitivity", "-n", "16", "--no-figures")])
def test_runs_leave_the_study_they_ran(run: Run, tmp_path: Path, kind: tuple[str, ...]) -> None:
    assert run(kind[0], MAYO, "-o", tmp_path / "o", *kind[1:], "--workers", "1", "--quiet", "--set", GEARING)[0] == 0
    assert read_study(tmp_path / "o" / "study.yaml").inceptor.gearing_rad_per_m == 0.9


def test_a_file_of_people_is_found_from_where_the_changed_study_is_kept(tmp_path: Path) -> None:
    text = QUICK.read_text() + "population: {people: file, file: crew.csv}\n"
    (tmp_path / "s.yaml").write_text(text)
    changed = changed_study(read_study(tmp_path / "s.yaml"), {"inceptor.gearing_rad_per_m": "0.9"})
    assert str(tmp_path / "crew.csv") in changed.text and changed.population["file"] == str(tmp_path / "crew.csv")


def test_a_pilot_is_evaluated_again_with_what_was_set() -> None:
    words = ["rotorcraft.mass_kg=7000", "search.seed=3", "bmi=20", "pilot.limbs=[left, right]"]
    args = argparse.Namespace(study=Path("s.yaml"), settings=words)
    line = shlex.split(again(args, {"age_years": 30.0, "bmi": 25.0}, "mbdae"))
    settings = line[line.index("--set") + 1 :]
    assert settings == ["rotorcraft.mass_kg=7000", "pilot.limbs=[left, right]", "age_years=30.0", "bmi=25.0"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("search --set searh.seed=2", "did you mean 'search.seed'"),
        ("search --set search.variables.bmi=[18,20]", "is not one number or word; change it in the study file"),
        ("search --set sensitivity.objectives=[gain_margin_db]", "would do nothing: `pilotgen search` makes no use"),
        ("search --set uncertain.draws=30", r"uncertain = \{.*draws: 30.*\} says of nothing that it is uncertain"),
        ("search --set mass_kg=80", r"--set mass_kg=80: search.variables.bmi = .* does not go with nominal.mass_kg"),
        ("sample -n 3 --set search.generations=2", "would do nothing: `pilotgen sample`"),
        ("sample -n 3 --seed 3 --set search.seed=2", "--seed and --set search.seed are the same"),
        ("sensitivity -n 4 --set limits.gain_margin_db=3", "would do nothing"),
        ("cures --set population.people=ansur2-men", "would do nothing"),
        ("calibrate --set stature_m=1.7", "would do nothing"),
        ("check -n 5 --set search.generations=2", "would do nothing"),
        ("decks --set rotorcraft.mass_kg=8000", "would do nothing"),
        ("rotorcraft --set pilot.sex=male", "would do nothing"),
    ],
)
def test_settings_that_are_wrong_or_do_nothing(run: Run, tmp_path: Path, words: str, said: str) -> None:
    command, *others = words.split()
    output = [] if command == "check" else ["-o", tmp_path / "o"]
    refused(run(command, QUICK, *output, *others), said)
    assert not (tmp_path / "o").exists()


def test_people_have_values_of_their_own(run: Run, tmp_path: Path) -> None:
    study = STUDIES / "puma-population.yaml"
    for setting in ("stature_m=1.9", "pilot.sex=female"):
        refused(run("population", study, "-n", "3", "-o", tmp_path / "o", "--set", setting), "would do nothing")
    refused(
        run("rotorcraft", "iar330-puma", "--set", "rotorcraft.mass_kg=7000"), "iar330-puma is none; give STUDY.yaml"
    )
