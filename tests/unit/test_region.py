"""Searches in the region of a population: what the region is, that a search stays in it, how rare a pilot is.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from study_texts import MAYO, MULTIBODY, message_of

from pilotgen.api import open_results
from pilotgen.cli import main
from pilotgen.errors import StudyError
from pilotgen.population.population import population_of
from pilotgen.population.region import Region, beyond, one_in, region_of, that_way
from pilotgen.search import Problem, run_search
from pilotgen.study.study import Study, study_from_text

STUDIES = Path(__file__).parents[2] / "docs" / "studies"
WIDE = "{age_years: [18, 80], bmi: [14, 50], stature_m: [1.3, 2.2]}"


def study_with(within: str, variables: str = WIDE, more: str = "") -> Study:
    text = MULTIBODY.replace("{age_years: [25, 65], bmi: [18, 30], stature_m: [1.55, 2.00]}", variables)
    return study_from_text(f"{text}  within: {within}\n{more}", "s.yaml")


def region(within: str, variables: str = WIDE, more: str = "") -> Region:
    found = region_of(study_with(within, variables, more))
    assert found is not None
    return found


WITH_MASS = MULTIBODY.replace("bmi: 24", "mass_kg: 76").replace(
    "{age_years: [25, 65], bmi: [18, 30], stature_m: [1.55, 2.00]}",
    "{stature_m: [1.3, 2.2], mass_kg: [35, 200], age_years: [18, 80]}\n  within: {population: ansur2-men}",
)
OWN = """population:
  people: own
  own:
    mean: {age_years: 45, stature_m: 1.75, mass_kg: 80}
    covariance: [[16, 0, 6], [0, 0.0025, 0.2], [6, 0.2, 60]]
"""


@pytest.mark.parametrize("probability", [0.5, 0.95, 0.99])
def test_the_region_holds_its_share_of_the_people(probability: float) -> None:
    one = region(f"{{probability: {probability}}}", more=OWN)  # limits so far away that they cut nobody
    people = one.joint.people(np.random.default_rng(2).standard_normal((200_000, 3)))
    people[:, 2] /= people[:, 1] ** 2
    held = one.holds(people[:, [0, 2, 1]])
    assert float(held.mean()) == pytest.approx(probability, abs=3.0 * np.sqrt(probability * (1 - probability) / 2e5))
    assert one.radius == pytest.approx(np.sqrt(stats.chi2.ppf(probability, 3)), rel=1e-12)
    assert beyond(one.radius) == pytest.approx(1 - probability, rel=1e-9)
    distance = one.distance(people[:, [0, 2, 1]])
    assert float((distance > 2.0).mean()) == pytest.approx(beyond(2.0), abs=0.004)
    scores = one.joint.independent(one.joint.people(np.eye(3)))
    np.testing.assert_allclose(scores, np.eye(3), atol=1e-9)


def test_the_cube_fills_the_region_and_nothing_else() -> None:
    cube = 2.0 * stats.qmc.Sobol(3, seed=4).random(2048) - 1.0
    for one in (
        region("{population: ansur2-men}"),
        region("{population: ansur2-men}", "{age_years: [25, 65], bmi: [18, 24], stature_m: [1.8, 2]}"),
        region("{}", more="population: {people: ansur2-men, within: {stature_m: [1.57, 1.93], bmi: [18, 30]}}"),
    ):
        people = one.people(cube)
        assert one.holds(people).all()
        assert not one.holds(one.people(1.05 * cube / np.abs(cube).max(axis=1)[:, None])).any()  # beyond the surface
        ray = one.scores(np.outer([0.25, 0.5, 1.0], cube[0] / np.abs(cube[0]).max()))
        np.testing.assert_allclose((ray[1] - ray[0]) * 2.0, ray[2] - ray[1], atol=1e-9)  # straight, evenly
        low, high = one.extent
        width = high - low
        assert (people >= low - 0.02 * width).all() and (people <= high + 0.02 * width).all()


def test_mass_and_body_mass_index_are_coordinates_of_one_region() -> None:
    cube = 2.0 * stats.qmc.Sobol(3, seed=2).random(64) - 1.0
    mass = region_of(study_from_text(WITH_MASS, "s.yaml"))
    assert mass is not None
    bmi = region("{population: ansur2-men}").people(cube)  # age, bmi, stature
    kilograms = mass.people(cube)  # stature, mass, age
    np.testing.assert_allclose(kilograms[:, 1], bmi[:, 1] * bmi[:, 2] ** 2, rtol=1e-14)
    np.testing.assert_array_equal(kilograms[:, [2, 0]], bmi[:, [0, 2]])


def test_everybody_of_the_region_is_reached() -> None:
    """Points of the ball that limits do not cut come from points of the cube: the map undone by hand."""
    one = region("{}", more=OWN)
    scores = np.random.default_rng(1).standard_normal((500, 3))
    scores = scores[np.linalg.norm(scores, axis=1) < one.radius]
    length = np.linalg.norm(scores, axis=1)
    cube = scores * (length / np.abs(scores).max(axis=1))[:, None] / one.radius
    np.testing.assert_allclose(one.scores(cube), scores, atol=1e-12)


def test_a_search_finds_the_worst_of_a_region_that_is_known() -> None:
    """A margin that falls evenly along a direction of the scores is least where the ray meets the sphere."""
    study = study_with("{probability: 0.95}", more=OWN)
    one = region_of(study)
    assert one is not None
    problem = Problem.from_settings(study.search, one)
    down = np.array([0.6, 0.0, 0.8])

    def evaluate(X: np.ndarray, _: int) -> np.ndarray:
        margin = 9.0 - one.scores(X) @ down
        return np.column_stack([margin, np.full(len(X), 180.0)])

    found = run_search(problem, study.search, evaluate)
    assert found.F[:, 0].min() == pytest.approx(9.0 - one.radius, abs=0.02)
    worst = problem.pilots(found.X[[int(np.argmin(found.F[:, 0]))]])[0]
    distance = float(one.distance(np.array([list(worst.values())]))[0])
    assert distance == pytest.approx(one.radius, abs=0.02)


def test_how_rare() -> None:
    assert that_way(3.0) == pytest.approx(stats.norm.sf(3.0), rel=1e-12)
    assert one_in(0.01) == "1 in 100" and one_in(1 / 2661) == "1 in 2,660" and one_in(0.4) == "1 in 2.5"
    assert one_in(beyond(0.0)) == "1 in 1.0" and one_in(0.0) == "nobody"


def test_the_command_is_the_same_with_two_workers_and_says_how_rare(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (STUDIES / "puma-within.yaml").read_text()
    study = tmp_path / "s.yaml"
    study.write_text(text.replace("population: 100", "population: 6").replace("generations: 30", "generations: 2"))
    for workers, more in (("1", []), ("2", ["--no-report"])):
        code = main(["search", str(study), "-o", str(tmp_path / workers), "--quiet", "--workers", workers, *more])
        assert code == 0
    out = capsys.readouterr().out
    code = main(["search", str(study), "-o", str(tmp_path / "1"), "--quiet", "--resume", "--json", "--no-report"])
    rare = json.loads(capsys.readouterr().out)["worst"][0]["how_rare"]
    assert rare["share_beyond"] == pytest.approx(stats.chi2.sf(rare["mahalanobis_distance"] ** 2, 3))
    assert "How rare the worst pilot is: 1 in" in out and "how rare" in out
    assert (tmp_path / "1" / "study.h5").read_bytes() == (tmp_path / "2" / "study.h5").read_bytes()
    table = open_results(tmp_path / "1").table()
    assert (table["mahalanobis_distance"] <= 3.3683).all()
    found = open_results(tmp_path / "1").worst(1)[0]
    his = [f"{name}={float(found[name])!r}" for name in ("age_years", "mass_kg", "stature_m")]
    one = ["pilot", str(study), "-o", str(tmp_path / "one"), "--no-figures", "--overwrite", "--set"]
    assert main([*one, *his]) == 0
    assert "how rare   1 in " in capsys.readouterr().out
    told = json.loads((tmp_path / "one" / "result.json").read_text())["how_rare"]
    assert told["mahalanobis_distance"] == pytest.approx(found["mahalanobis_distance"], rel=1e-9)
    assert main([*one, "age_years=65"]) == 0 and "nobody of the men" in capsys.readouterr().out
    page = (tmp_path / "1" / "report.html").read_text()
    assert "How rare the worst pilot is" in page and "region that holds 99 % of men" in page
    text = text.replace("probability: 0.99", "probability: 0.95")
    study.write_text(text.replace("population: 100", "population: 6").replace("generations: 30", "generations: 2"))
    code = main(["search", str(study), "-o", str(tmp_path / "1"), "--quiet", "--resume"])
    assert code == 1 and "search.within.probability" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("within", "variables", "said"),
    [
        ("{population: ansur2-men, probability: 1}", WIDE, "is outside 0.01 to 0.9999; a fraction: 99 % is 0.99"),
        ("{population: ansur2-men, probability: 0}", WIDE, "is outside 0.01 to 0.9999"),
        ("{population: ansur2-man}", WIDE, "did you mean 'ansur2-men'"),
        ("{population: ansur2-women}", WIDE, "does not go with pilot.sex = 'male'; write sex: female"),
        ("{probability: 0.95}", WIDE, "names no population"),
        ("{population: ansur2-men}", "{stature_m: [1.55, 2.0]}", "lacks age_years and mass_kg or bmi"),
        (
            "{population: ansur2-men}",
            "{age_years: [25, 65], bmi: [18, 30], stature_m: [1.55, 2.0], inceptor.gearing_rad_per_m: [0.9, 1.3]}",
            "is nothing that a population has",
        ),
        ("{population: ansur2-men, radius: 3}", WIDE, "radius"),
    ],
)
def test_mistakes(within: str, variables: str, said: str) -> None:
    with pytest.raises(StudyError) as caught:
        study_with(within, variables)
    assert said in str(caught.value) and str(caught.value).startswith("s.yaml:") and "\n" not in str(caught.value)


def test_populations_without_a_region(tmp_path: Path) -> None:
    for people, said in (
        ("{people: ansur2-mix, share_of_women: 0.1}", "a mix has two regions"),
        ("{people: file, file: crew.csv}", "a file of people has no region"),
        ("{people: ansur2-men, within: {stature_m: [2.1, 2.2]}}", "nobody of the 99 % of men is within its limits"),
    ):
        study = study_with("{}", more=f"population: {people}\n")
        with pytest.raises(StudyError, match=said):
            region_of(study)
    assert "means nothing for pilot.model = 'mayo'" in message_of(MAYO + "  within: {population: ansur2-men}\n")
    assert population_of(study_with("{}", more=OWN)).name == "men"


def test_a_changed_study_says_where_it_searches_in_its_own_text() -> None:
    study = study_with("{population: ansur2-men, probability: 0.95}")
    changed, _ = study.with_values({"rotorcraft.mass_kg": 7000.0})
    assert study_from_text(changed.with_own_text().text).search.within == study.search.within
