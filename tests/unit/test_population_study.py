"""People evaluated: shares, quantiles, the nearest, and the command.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from scipy import stats

from pilotgen.cli import main
from pilotgen.population.shares import Share
from pilotgen.population.tally import Tally, sentences
from pilotgen.runs import population_study

STUDY = Path(__file__).parents[2] / "docs" / "studies" / "puma-population.yaml"
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*arguments: object) -> tuple[int, str, str]:
        code = main(["population", *(str(argument) for argument in arguments), "--quiet", "--no-figures"])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


def ok(gain_margin_db: float | None, phase_margin_deg: float | None = None, stable: bool = True) -> dict[str, Any]:
    loop = {"stable": stable, "modulus_margin": 0.5, "gain_margin_db": gain_margin_db}
    return {"status": "ok", "loop": {**loop, "phase_margin_deg": phase_margin_deg}}


def test_tally_counts_people_and_finds_the_nearest() -> None:
    tally = Tally({"gain_margin_db": 6.0, "phase_margin_deg": 60.0, "modulus_margin": None})
    person = {"age_years": 30.0, "stature_m": 1.8, "mass_kg": 80.0, "pilot.sex": "male"}
    for k in range(100):  # 0.1, 0.2, ... 10.0 dB: 59 below 6 dB
        tally.add(person, ok((k + 1) / 10))
    tally.add(person, ok(-2.0, -50.0, stable=False))
    tally.add(person, ok(None))
    tally.add(person, ok(None, stable=False))
    tally.add(person, {"status": "failed", "stage": "torso", "reason": "x"})
    content = tally.as_dict()
    shares = content["shares"]
    assert (content["people"], content["evaluated"], content["failed"]["count"]) == (104, 103, 1)
    assert shares["unstable"]["count"] == 2 and shares["gain_margin_db"]["count"] == 59 + 2
    assert shares["phase_margin_deg"]["count"] == 2 and shares["any"]["count"] == 59 + 2
    assert shares["any"]["least"] == 61 / 104 and shares["any"]["most"] == 62 / 104
    margins = sorted([(k + 1) / 10 for k in range(100)] + [-2.0, math.inf, -60.0])
    assert content["quantiles"]["gain_margin_db"]["0.5"] == margins[51]
    assert content["quantiles"]["gain_margin_db"]["0.001"] == -60.0
    assert content["quantiles"]["phase_margin_deg"]["0.99"] is None
    near = [one["number"] for one in content["nearest"]["gain_margin_db"]]
    assert near[0] == 59 and sorted(near) == list(range(54, 64))
    assert [one["number"] for one in content["nearest"]["phase_margin_deg"]] == [100]
    json.dumps(content, allow_nan=False)
    told = sentences({**content, "name": "men", "left_out": {"candidates": 104, "people": 0, "by_limit": {}}})
    assert told[0] == "59.2 % of men (49.6-68.2 %) fly this machine with a gain margin below 6.00 dB."


def test_an_interval_holds_the_true_share_in_about_95_of_100_samples() -> None:
    for share, people in ((0.03, 1000), (0.3, 200), (0.5, 60)):
        held = sum(
            stats.binom.pmf(k, people, share)
            for k in range(people + 1)
            if Share(k, people).interval[0] <= share <= Share(k, people).interval[1]
        )
        assert 0.935 < held < 0.97


def test_people_are_the_same_with_one_and_two_workers_and_after_going_on(run: Run, tmp_path: Path) -> None:
    code, out, err = run(STUDY, "-n", 8, "-o", tmp_path / "a", "--workers", 1)
    assert code == 0, err
    assert "of men (" in out.splitlines()[0] and out.splitlines()[0].endswith("with a gain margin below 6.00 dB.")
    code, out, _ = run(STUDY, "-n", 16, "-o", tmp_path / "a", "--workers", 1, "--resume")
    assert "16 people (8 from the journal)" in out
    code, out, _ = run(STUDY, "-n", 16, "-o", tmp_path / "b", "--workers", 2, "--json")
    content = json.loads(out)
    for name in ("people.csv", "population.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    with (tmp_path / "a" / "people.csv").open(newline="") as file:
        people = list(csv.DictReader(file))
    below = sum(float(one["gain_margin_db"]) < 6.0 for one in people if one["status"] == "ok")
    assert len(people) == 16 and content["shares"]["gain_margin_db"]["count"] == below
    assert not list((tmp_path / "a").glob("*.part"))
    other = tmp_path / "other.yaml"
    other.write_text(STUDY.read_text().replace("people: ansur2-men", "people: ansur2-women"))
    code, _, err = run(other, "-n", 16, "-o", tmp_path / "a", "--resume")
    assert code == 1 and "population.people" in err
    assert main(["status", str(tmp_path / "a")]) == 0


def test_it_ends_when_the_intervals_are_narrow_enough(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(population_study, "CHUNK", 4)
    code, out, _ = run(STUDY, "-n", 40, "-o", tmp_path / "a", "--until-width", "70%", "--json", "--workers", 1)
    content = json.loads(out)
    assert code == 0 and content["stopped_by"] == "width of the intervals" and content["people"] < 40
    assert max(share["high"] - share["low"] for share in content["shares"].values()) <= 0.7
    code, _, err = run(STUDY, "-n", 4, "-o", tmp_path / "b", "--until-width", "0.5%", "--workers", 1)
    assert code == 0 and "intervals are still wider than 0.5 %" in err
    with pytest.raises(SystemExit):
        run(STUDY, "-n", 4, "-o", tmp_path / "c", "--until-width", "200%")


def test_a_mix_of_men_and_women(run: Run, tmp_path: Path) -> None:
    study = tmp_path / "mix.yaml"
    study.write_text(STUDY.read_text().replace("people: ansur2-men", "people: ansur2-mix\n  share_of_women: 0.5"))
    code, out, err = run(study, "-n", 8, "-o", tmp_path / "a", "--workers", 1)
    assert code == 0, err
    assert "of people (50 % women) (" in out
    assert {",male,", ",female,"} == {
        f",{line.split(',')[4]}," for line in (tmp_path / "a" / "people.csv").read_text().splitlines()[1:]
    }


def test_nobody_can_be_evaluated_and_a_short_file(run: Run, tmp_path: Path) -> None:
    (tmp_path / "crew.csv").write_text("age_years,stature_m,mass_kg\n20,1.75,127\n22,1.86,128\n")
    study = tmp_path / "crew.yaml"
    text = STUDY.read_text()
    study.write_text(text[: text.index("population:\n  people")] + "population: {people: file, file: crew.csv}\n")
    code, out, err = run(study, "-n", 2, "-o", tmp_path / "a", "--workers", 1)
    assert code == 2, err
    assert out.startswith("None of 2 people of the file could be evaluated.")
    assert json.loads((tmp_path / "a" / "population.json").read_text())["shares"]["any"]["share"] is None
    code, out, err = run(study, "-n", 3, "-o", tmp_path / "b", "--workers", 1)
    assert code == 1 and "give -n 2" in err and not (tmp_path / "b" / "people.csv.part").exists()


def test_a_study_without_people(run: Run, tmp_path: Path) -> None:
    code, out, err = run(STUDY.with_name("quick.yaml"), "-n", 4, "-o", tmp_path / "a")
    assert code == 1 and out == "" and "has no section population; add one" in err
    assert not (tmp_path / "a").exists()
