"""Populations: fits against subjects that they have not seen, moments, files of people, limits.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats
from study_texts import MAYO, MULTIBODY, message_of

from pilotgen.errors import FileError, StudyError
from pilotgen.population.joint import bundled_joint, joint_of_moments
from pilotgen.population.people_file import read_people
from pilotgen.population.population import LeftOut, population_of
from pilotgen.population.shares import Share
from pilotgen.study.study import Study, read_study, study_from_text
from pilotgen.study.yaml_file import bundled, read_yaml

ROOT = Path(__file__).parents[2]
HOLD_OUT = read_yaml(ROOT / "tests" / "data" / "ansur2" / "hold_out.yaml").value
NAMES = ("age_years", "stature_m", "mass_kg")
WIDE = {"age_years": (18.0, 80.0), "stature_m": (1.3, 2.2), "mass_kg": (35.0, 200.0)}


def study_with(population: str) -> Study:
    return study_from_text(f"{MULTIBODY}population: {population}\n", "s.yaml")


def drawn(population: str, number: int, seed: int = 1) -> list[dict[str, Any]]:
    return list(itertools.islice(population_of(study_with(population)).people(seed), number))


@pytest.mark.parametrize("who", ["ansur2-men", "ansur2-women"])
def test_marginals_are_those_of_the_subjects_kept_back(who: str) -> None:
    """Kolmogorov-Smirnov at the points stored: the distance of a fifth of the survey must not be significant at 5 %."""
    joint, kept = bundled_joint(bundled("population").value[who]), HOLD_OUT[who]
    n = kept["people"]
    limit = stats.kstwo.ppf(0.95, n)
    for k, name in enumerate(NAMES):
        share = joint.marginals[k].below(np.array(kept[name]["at"], dtype=float))
        distance = max(
            np.abs(share - np.array(kept[name]["below"]) / n).max(),
            np.abs(share - np.array(kept[name]["up_to"]) / n).max(),
        )
        assert distance < limit, (name, distance, limit)


@pytest.mark.parametrize("who", ["ansur2-men", "ansur2-women"])
def test_correlations_and_tails_are_those_of_the_subjects_kept_back(who: str) -> None:
    joint, kept = bundled_joint(bundled("population").value[who]), HOLD_OUT[who]
    people = joint.people(np.random.default_rng(3).standard_normal((200_000, 3)))
    found = np.corrcoef(np.column_stack([people[:, :2], np.log(people[:, 2])]).T)
    n = kept["people"]
    for (j, k), name in {(0, 1): "age_stature", (0, 2): "age_mass", (1, 2): "stature_mass"}.items():
        apart = abs(math.atanh(found[j, k]) - math.atanh(kept["correlation"][name]))
        assert apart < 1.96 / math.sqrt(n - 3), name  # Fisher's z, 5 %
    for name in ("stature_m", "mass_kg"):
        for share, value in zip((0.01, 0.99), kept["tails"][name], strict=True):
            below = float(np.mean(people[:, NAMES.index(name)] < value))
            count = below * n  # how many of so few subjects the fit expects beyond: within 95 % of the binomial
            low, high = stats.binom.interval(0.95, n, share)
            assert low <= count <= high, (name, share, count)


def test_moments_of_an_own_distribution_are_those_given() -> None:
    mean = [38.0, 1.79, 83.0]
    covariance = [[64.0, 0.0, 12.0], [0.0, 0.004225, 0.325], [12.0, 0.325, 100.0]]
    for logarithmic in ([False, False, True], [True, False, True], [True, True, True]):
        joint = joint_of_moments("male", mean, covariance, logarithmic, WIDE, "here")
        people = joint.people(np.random.default_rng(5).standard_normal((1_000_000, 3)))
        np.testing.assert_allclose(people.mean(axis=0), mean, rtol=1e-3)
        scale = np.sqrt(np.diag(covariance))
        np.testing.assert_allclose(
            np.cov(people.T) / np.outer(scale, scale), covariance / np.outer(scale, scale), atol=0.006
        )


def test_people_are_the_same_however_many_are_asked_for() -> None:
    many = drawn("{people: ansur2-mix, share_of_women: 0.3}", 2500)
    assert drawn("{people: ansur2-mix, share_of_women: 0.3}", 40) == many[:40]
    assert drawn("{people: ansur2-mix, share_of_women: 0.3}", 40, seed=2) != many[:40]
    low, high = Share(sum(one["pilot.sex"] == "female" for one in many), len(many)).interval
    assert low < 0.3 < high
    assert {one["pilot.sex"] for one in drawn("ansur2-women", 50)} == {"female"}
    assert {one["pilot.sex"] for one in drawn("{people: ansur2-mix, share_of_women: 1}", 50)} == {"female"}


def test_who_is_outside_limits_is_counted() -> None:
    population = population_of(study_with("{people: ansur2-men, within: {stature_m: [1.57, 1.93], bmi: [18, 30]}}"))
    left_out = LeftOut()
    people = list(itertools.islice(population.people(1, left_out), 3000))
    assert all(1.57 <= one["stature_m"] <= 1.93 and one["age_years"] >= 18.0 for one in people)
    assert all(18.0 <= one["mass_kg"] / one["stature_m"] ** 2 <= 30.0 for one in people)
    assert left_out.candidates == 3000 + left_out.number and left_out.number > 0
    told = " ".join(left_out.by_limit)
    assert "stature_m outside 1.57 to 1.93 (entry limit)" in told and "bmi outside 18 to 30" in told
    assert (
        "1.491 to 1.993" in population.limits_text()
        and "entry limits stature_m 1.57 to 1.93" in population.limits_text()
    )


def test_nobody_within_limits() -> None:
    population = population_of(study_with("{people: ansur2-men, within: {stature_m: [2.1, 2.2]}}"))
    with pytest.raises(StudyError, match="nobody of the last 100000 candidates is within its limits"):
        next(population.people(1))


@pytest.mark.parametrize(
    ("population", "said"),
    [
        ("ansur2-man", "did you mean 'ansur2-men'"),
        ("{people: ansur2-mix}", "needs the key population.share_of_women"),
        ("{people: ansur2-men, share_of_women: 0.1}", "has no use for population.share_of_women"),
        ("{share_of_women: 0.1}", "lacks the key people"),
        ("{people: ansur2-men, within: {stature_cm: [157, 193]}}", "not a number or word of a study"),
        ("{people: ansur2-men, within: {stature_m: [1.93, 1.57]}}", "did you swap the bounds"),
        ("{people: ansur2-men, within: {stature_m: [157, 193]}}", "heights are in metres"),
        ("{people: ansur2-men, within: {rotorcraft.mass_kg: [5000, 7000]}}", "is nothing that people of a survey have"),
        ("{people: own, own: {mean: {age_years: 40}}}", "lacks mean.stature_m, mean.mass_kg, covariance"),
        ("{people: own, own: {covariance: [[1, 2], [2, 1]]}}", "must be 3 rows of 3 numbers"),
        ("{people: own, own: {covariance: [[1, 2, 0], [3, 9, 0], [0, 0, 1]]}}", "is not symmetric"),
    ],
)  # fmt: skip
def test_mistakes(population: str, said: str) -> None:
    message = message_of(f"{MULTIBODY}population: {population}\n")
    assert said in message and message.startswith("s.yaml:18")


def test_a_covariance_that_is_none_and_a_pilot_without_a_body() -> None:
    mean = "mean: {age_years: 40, stature_m: 1.8, mass_kg: 80}"
    study = study_with(f"{{people: own, own: {{{mean}, covariance: [[64, 0, 0], [0, 0.004, 0.9], [0, 0.9, 100]]}}}}")
    with pytest.raises(StudyError, match=r"s.yaml:18: population.own.covariance is not positive definite"):
        population_of(study)
    assert "means nothing for pilot.model = 'mayo'" in message_of(MAYO + "population: ansur2-men\n")
    with pytest.raises(StudyError, match="has no section population"):
        population_of(study_from_text(MULTIBODY))


def test_a_changed_study_says_who_flies_in_its_own_text() -> None:
    study = study_with("{people: ansur2-mix, share_of_women: 0.25, within: {stature_m: [1.57, 1.93]}}")
    changed, _ = study.with_values({"population.share_of_women": 0.5})
    again = study_from_text(changed.with_own_text().text)
    assert again.population == changed.population and changed.value("population.share_of_women") == 0.5
    assert study_from_text(MULTIBODY).value("population.own.mean.age_years") is None


def test_people_of_a_file(tmp_path: Path) -> None:
    rows = [
        "age_years,stature_m,bmi,sex",
        *(f"{20 + k},1.{70 + k},24,{'female' if k % 2 else 'male'}" for k in range(9)),
    ]
    (tmp_path / "crew.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "s.yaml").write_text(
        f"{MULTIBODY}population: {{people: file, file: crew.csv, within: {{age_years: [20, 25]}}}}\n"
    )
    left_out = LeftOut()
    people = list(population_of(read_study(tmp_path / "s.yaml")).people(1, left_out))
    assert sorted(one["age_years"] for one in people) == [20, 21, 22, 23, 24, 25] and left_out.number == 3
    assert people[0]["mass_kg"] == pytest.approx(24 * people[0]["stature_m"] ** 2)
    assert {one["pilot.sex"] for one in people} == {"male", "female"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "holds no people"),
        ("age_years,stature_m,mass_kg\n", "holds no people"),
        ("age_years,stature_cm,mass_kg\n30,178,80\n", "crew.csv:1: column 'stature_cm' is not known"),
        ("age_years,stature_m,mass_kg\n30,178,80\n", "stature_m = 178 is outside 1.3 to 2.2 m; heights are in metres"),
        ("age_years,stature_m\n30,1.78\n", "exactly one of the columns mass_kg and bmi"),
        ("age_years,mass_kg\n30,80\n", "column 'stature_m' is missing"),
        ("age_years,stature_m,mass_kg\n30,1.78,80\n\n31,1.7,70\n", "crew.csv:3: the row is empty"),
        ("age_years,stature_m,mass_kg\n30,1.78,80\n30,1.78,80\n", "crew.csv:3: is the same person as line 2"),
        ("age_years,stature_m,mass_kg\n30,1,78,80\n", "crew.csv:2: has 4 cells, the header 3"),
        ("age_years,stature_m,mass_kg\n30,tall,80\n", "crew.csv:2: stature_m = tall is not a number"),
        ("age_years,stature_m,mass_kg,sex\n30,1.78,80,man\n", "crew.csv:2: sex = man is not known"),
        ("age_years,age_years,stature_m,mass_kg\n30,30,1.78,80\n", "stands there twice"),
    ],
)  # fmt: skip
def test_mistakes_of_a_file(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "crew.csv").write_text(text)
    with pytest.raises(StudyError) as caught:
        read_people(tmp_path / "crew.csv", "male")
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="cannot be read"):
        read_people(tmp_path / "none.csv", "male")
    (tmp_path / "bytes.csv").write_bytes(b"age_years,\xff\xfe\n")
    with pytest.raises(FileError, match="is no CSV in UTF-8"):
        read_people(tmp_path / "bytes.csv", "male")


def test_wilson_interval() -> None:
    """Against scipy's, and exact ends for none and all."""
    for count, of in ((0, 10), (1, 10), (31, 1000), (7, 7), (500, 1000)):
        expected = stats.binomtest(count, of).proportion_ci(0.95, method="wilson")
        assert Share(count, of).interval == pytest.approx((expected.low, expected.high), abs=1e-14)
    assert Share(0, 10).interval[0] == 0.0 and Share(7, 7).interval[1] == 1.0
    assert Share(0, 0).interval == (0.0, 1.0)
    assert Share(31, 1000).text() == "3.1 % (2.2-4.4 %)"
