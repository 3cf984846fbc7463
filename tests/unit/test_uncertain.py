"""What is not known of one pilot: distributions, draws, spread of his margins, the command, mistakes.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats
from study_texts import MAYO, MULTIBODY, message_of

from pilotgen.cli import main
from pilotgen.errors import StudyError
from pilotgen.objectives import place_of_quantile
from pilotgen.study.study import study_from_text
from pilotgen.study.uncertain_section import SETS, bundled_set
from pilotgen.study.yaml_file import bundled
from pilotgen.uncertain.distributions import of_scores, word_of
from pilotgen.uncertain.draws import Draws
from pilotgen.uncertain.spread import interval_of_quantile, sentences, spread_of

Run = Callable[..., tuple[int, str, str]]
ALL = (-math.inf, math.inf)
GEARING = "inceptor.gearing_rad_per_m: {distribution: lognormal, median: 1, factor: 1.2, as: factor}"
STUDY = f"{MAYO}uncertain:\n  variables:\n    {GEARING}\n"


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*arguments: object) -> tuple[int, str, str]:
        code = main(["pilot", *(str(argument) for argument in arguments)])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


@pytest.mark.parametrize(
    ("one", "reference"),
    [
        ({"distribution": "normal", "mean": 2.0, "deviation": 0.5}, stats.norm(2.0, 0.5)),
        ({"distribution": "normal", "mean": 2.0, "deviation": 0.5, "within": [1.8, 4.0]},
         stats.truncnorm(-0.4, 4.0, 2.0, 0.5)),
        ({"distribution": "lognormal", "median": 3.0, "factor": 1.4}, stats.lognorm(math.log(1.4), scale=3.0)),
        ({"distribution": "uniform", "lower": -1.0, "upper": 3.0}, stats.uniform(-1.0, 4.0)),
        ({"distribution": "triangular", "lower": 0.0, "mode": 1.0, "upper": 5.0}, stats.triang(0.2, 0.0, 5.0)),
    ],
)  # fmt: skip
def test_values_are_those_of_the_distribution(one: dict[str, Any], reference: Any) -> None:
    u = np.linspace(0.001, 0.999, 333)
    assert of_scores(one, stats.norm.ppf(u), ALL) == pytest.approx(reference.ppf(u), rel=1e-9, abs=1e-9)


def test_a_truncated_lognormal_is_the_lognormal_between_its_ends() -> None:
    one = {"distribution": "lognormal", "median": 1.0, "factor": 1.5, "within": [0.8, 2.0]}
    values, free = of_scores(one, stats.norm.ppf(np.linspace(0.0, 1.0, 101)), ALL), stats.lognorm(math.log(1.5))
    shares = (free.cdf(values) - free.cdf(0.8)) / (free.cdf(2.0) - free.cdf(0.8))
    assert shares == pytest.approx(np.linspace(0.0, 1.0, 101), abs=1e-9)


def test_words_come_as_often_as_their_shares_say() -> None:
    one = {"distribution": "words", "weights": {"position": 0.5, "force": 0.2, "relax": 0.3}}
    words = word_of(one, stats.norm.ppf((np.arange(1000) + 0.5) / 1000))
    assert [words.count(word) for word in one["weights"]] == [500, 200, 300]


def test_every_bundled_set_goes_with_a_study_and_has_a_source() -> None:
    assert sorted(bundled("uncertain").value) == list(SETS)
    names = [name for one in SETS for name in bundled_set(one)["variables"]]
    assert len(set(names)) == len(names)
    assert all(bundled_set(one)["source"] for one in SETS)
    study = study_from_text(f"{MULTIBODY}uncertain: {{sets: [{', '.join(SETS)}]}}\n")
    assert set(Draws(study, 1).changes(0, study.nominal)) == set(names)
    again = study_from_text(study.with_own_text().text)
    assert again.uncertain == study.uncertain


def test_draws_depend_on_their_number_and_the_seed_alone() -> None:
    both = study_from_text(f"{MULTIBODY}uncertain: {{sets: [strength, reflex]}}\n")
    one = study_from_text(f"{MULTIBODY}uncertain: {{sets: [strength]}}\n")
    few, many = Draws(one, 5), Draws(both, 50)
    tall = both.values({"stature_m": 1.95})
    for k in range(5):
        strength = few.changes(k, one.nominal)["pilot.strength_factor"]
        assert many.changes(k, tall)["pilot.strength_factor"] == strength
    other = study_from_text(f"{MULTIBODY}uncertain: {{sets: [strength], seed: 2}}\n")
    assert Draws(other, 1).changes(0, other.nominal) != few.changes(0, one.nominal)


def test_groups_have_the_correlation_asked_for() -> None:
    study = study_from_text(f"{MULTIBODY}uncertain: {{sets: [reflex, torso]}}\n")
    draws = Draws(study, 20_000)
    scores = np.array([draws.scores[name] for name in draws.variables])
    wanted = np.eye(5)
    wanted[:2, :2] += 0.8 * (1 - np.eye(2))
    wanted[2:, 2:] += 0.5 * (1 - np.eye(3))
    assert np.corrcoef(scores) == pytest.approx(wanted, abs=0.025)
    assert scores.std(axis=1) == pytest.approx(1.0, abs=0.02)


def test_factors_are_of_what_the_drawn_task_has() -> None:
    study = study_from_text(f"{MULTIBODY}uncertain: {{sets: [reflex, task]}}\n")
    draws = Draws(study, 30)
    kp = "pilot.reflex.proportional_gain"
    plain = {task: study.with_values({"pilot.task": task})[0].value(kp) for task in ("position", "force", "relax")}
    factors = []
    for k in range(30):
        drawn = draws.changes(k, study.nominal)
        factors.append(drawn[kp] / plain[drawn["pilot.task"]])
    assert len({draws.changes(k, study.nominal)["pilot.task"] for k in range(30)}) == 3
    assert 0.6 <= min(factors) < 0.95 and 1.05 < max(factors) <= 1.4 and abs(np.mean(factors) - 1.0) < 0.06


def test_an_interval_of_a_quantile_holds_it_in_95_of_100_samples() -> None:
    for q, count in ((0.05, 200), (0.5, 40), (0.95, 100)):
        low, high = interval_of_quantile(q, count)
        assert low is not None and high is not None
        # x[low] < quantile < x[high] exactly if more than low and at most high of the values are below it
        held = stats.binom.cdf(high, count, q) - stats.binom.cdf(low, count, q)
        assert 0.95 <= held < 0.985
    assert interval_of_quantile(0.05, 20)[0] is None and interval_of_quantile(0.99, 100)[1] is None
    assert [place_of_quantile(0.05, count) for count in (1, 20, 21, 40, 100)] == [0, 0, 1, 1, 4]


def ok(gain_margin_db: float | None, stable: bool = True) -> dict[str, Any]:
    loop = {"stable": stable, "modulus_margin": 0.5, "gain_margin_db": gain_margin_db, "phase_margin_deg": None}
    return {"status": "ok", "loop": loop}


def test_failed_draws_are_told() -> None:
    failed = {"status": "failed", "stage": "posture", "reason": "wrist"}
    results = [ok((k + 1) / 10) for k in range(97)] + [ok(None), failed, failed]
    found = spread_of(results, {"gain_margin_db": 6.0, "phase_margin_deg": None, "modulus_margin": None})
    assert (found["draws"], found["evaluated"], found["failed"]["count"]) == (100, 98, 2)
    assert found["shares"]["gain_margin_db"]["count"] == 59 and found["shares"]["any"]["most"] == 0.61
    margin = found["margins"]["gain_margin_db"]
    assert margin["quantiles"]["0.5"]["value"] == 4.9 and margin["without_crossing"] == 1 and margin["mean"] is None
    told = sentences({**found, "nominal": {"gain_margin_db": 5.0, "phase_margin_deg": None, "modulus_margin": 0.5}})
    assert told[0].startswith(
        "9 of 10 such pilots have a gain margin of 0.50 to 9.40 dB; the study's own numbers give 5.00"
    )
    assert "2 of 100 draws (2.0 %) could not be evaluated" in told[-1] and "2 at posture" in told[-1]
    none = spread_of([failed], {})
    assert sentences({**none, "nominal": {}}) == ["None of 1 draws of this pilot could be evaluated."]


def test_margins_over_an_uncertain_gearing_are_known(run: Run, tmp_path: Path) -> None:
    """The gain margin falls by 20 log10 of the gearing's factor, whoever flies: it is normal, of known deviation."""
    (tmp_path / "s.yaml").write_text(STUDY)
    code, out, err = run(tmp_path / "s.yaml", "--uncertain", "-n", 400, "-o", tmp_path / "a", "--workers", 1)
    assert code == 0, err
    content = json.loads((tmp_path / "a" / "uncertain.json").read_text())
    nominal = content["nominal"]["gain_margin_db"]
    with (tmp_path / "a" / "uncertain.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        factor = float(row["inceptor.gearing_rad_per_m"]) / 1.1
        assert float(row["gain_margin_db"]) == pytest.approx(nominal - 20 * math.log10(factor), abs=1e-6)
    deviation = 20 * math.log10(1.2)
    margin = content["margins"]["gain_margin_db"]
    assert margin["deviation"] == pytest.approx(deviation, rel=0.1)
    for q in ("0.05", "0.25", "0.5", "0.75", "0.95"):
        one = margin["quantiles"][q]
        assert one["low"] <= stats.norm(nominal, deviation).ppf(float(q)) <= one["high"]
    below = content["shares"]["gain_margin_db"]
    assert below["low"] <= stats.norm(nominal, deviation).cdf(6.0) <= below["high"]
    bands = content["bands"]
    assert np.array(bands["feedthrough"]["0.05"]) == pytest.approx(bands["feedthrough"]["0.95"])  # of no gearing
    assert content["sentence"] in out and content["sentence"].startswith("9 of 10 such pilots have a gain margin of")
    result = json.loads((tmp_path / "a" / "result.json").read_text())
    assert result["uncertain"]["sentence"] == content["sentence"] and "bands" not in result["uncertain"]
    assert content["answer"].startswith("gain margin ") and content["answer"].endswith(" dB for 9 of 10")
    pngs = {path.name for path in (tmp_path / "a").glob("band-*.png")}
    assert pngs == {"band-bdft.png", "band-margins.png", "band-nyquist.png"}


def test_two_workers_draw_the_same(run: Run, tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(f"{MULTIBODY}uncertain: {{sets: [reflex, posture, task]}}\n")
    for workers in (1, 2):
        directory = tmp_path / str(workers)
        code, _, err = run(
            tmp_path / "s.yaml", "--uncertain", "-n", 6, "-o", directory, "--workers", workers, "--no-figures"
        )
        assert code == 0, err
        assert not list(directory.glob("*.png"))
    for number, more in ((3, ()), (6, ("--resume", "--log", tmp_path / "log.jsonl"))):
        options = ("-o", tmp_path / "grown", "--workers", 1, "--no-figures")
        code, _, err = run(tmp_path / "s.yaml", "--uncertain", "-n", number, *options, *more)
        assert code == 0, err
    end = json.loads((tmp_path / "log.jsonl").read_text().splitlines()[-1])
    assert (end["event"], end["evaluated"], end["served"]) == ("end", 3, 3)
    for name in ("uncertain.json", "uncertain.csv"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes()
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "grown" / name).read_bytes()


def test_draws_of_another_study_are_refused_before_anything_is_replaced(run: Run, tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(STUDY)
    draw = ("--uncertain", "-n", 4, "-o", tmp_path / "a", "--workers", 1, "--no-figures", "--quiet")
    assert run(tmp_path / "s.yaml", *draw)[0] == 0

    def files() -> dict[Path, bytes]:  # but for what SQLite keeps beside a journal that is read
        found = (tmp_path / "a").iterdir()
        return {path: path.read_bytes() for path in found if not path.name.startswith("journal.sqlite-")}

    before = files()
    (tmp_path / "s.yaml").write_text(STUDY.replace("gearing_rad_per_m: 1.1", "gearing_rad_per_m: 1.2"))
    code, _, err = run(tmp_path / "s.yaml", *draw, "--resume")
    assert code == 1 and "inceptor.gearing_rad_per_m  1.1    1.2" in err
    assert files() == before
    (tmp_path / "s.yaml").write_text(STUDY)
    settings = ("--resume", "--set", "inceptor.gearing_rad_per_m=1.2")
    code, _, err = run(tmp_path / "s.yaml", *draw, *settings)
    assert code == 0 and "or of other settings, cannot be used" in err
    (tmp_path / "a" / "journal.sqlite").write_bytes(b"no journal")
    code, _, err = run(tmp_path / "s.yaml", *draw, *settings)
    assert code == 1 and "journal.sqlite: cannot be read (file is not a database); a run would stop here" in err


@pytest.mark.parametrize(
    "option",
    [("-n", 10), ("--workers", 2), ("--resume",), ("--max-failures", 0), ("--executor", "dask"), ("--log", "a.jsonl")],
)
def test_options_of_draws_are_for_draws(run: Run, tmp_path: Path, option: tuple[object, ...]) -> None:
    (tmp_path / "s.yaml").write_text(STUDY)
    code, _, err = run(tmp_path / "s.yaml", *option, "-o", tmp_path / "a")
    assert code == 1 and f"{option[0]} is for --uncertain; add that" in err and not (tmp_path / "a").exists()


def test_what_cannot_be_drawn_leaves_nothing(run: Run, tmp_path: Path) -> None:
    (tmp_path / "none.yaml").write_text(MAYO)
    code, _, err = run(tmp_path / "none.yaml", "--uncertain", "-o", tmp_path / "a")
    assert code == 1 and "has no section uncertain; add one" in err and not (tmp_path / "a").exists()
    (tmp_path / "s.yaml").write_text(STUDY)
    (tmp_path / "cushion.yaml").write_text(f"{MULTIBODY}uncertain: cushion\n")
    settings = ("--set", "pilot.torso.model=rigid")
    code, _, err = run(tmp_path / "cushion.yaml", "--uncertain", "-o", tmp_path / "a", *settings)
    assert code == 1 and "means nothing for pilot.torso.model = 'rigid'" in err and not (tmp_path / "a").exists()
    with pytest.raises(StudyError, match="has no section uncertain"):
        Draws(study_from_text(MAYO), 3)


STRENGTH = "pilot.strength_factor"


@pytest.mark.parametrize(
    ("distribution", "said"),
    [
        ("1.2", "is no distribution; a mapping such as"),
        ("{mean: 1}", "key 'distribution' is missing"),
        ("{distribution: gaussian, mean: 1, deviation: 1}", "is not known"),
        ("{distribution: normal, mean: 1, sigma: 1}", "a normal distribution has mean"),
        ("{distribution: normal, mean: 1}", "key 'deviation' is missing"),
        ("{distribution: normal, mean: 1, deviation: 0}", "has no spread"),
        ("{distribution: normal, mean: 1, deviation: '0,1'}", "write 0.1"),
        ("{distribution: normal, mean: 1, deviation: 0.5}", "outside 0.1 to 10 with a probability of 3.59 %"),
        ("{distribution: normal, mean: 1, deviation: 0.01, within: [2, 3]}", "nothing of it lies within [2, 3]"),
        ("{distribution: normal, mean: 1, deviation: 0.1, within: [1.2, 0.8]}", "lower end not below its upper end"),
        ("{distribution: uniform, lower: 1, upper: 2, within: [1, 2]}", "a uniform distribution has ends"),
        ("{distribution: uniform, lower: 1, upper: 1}", "lower must be below upper"),
        ("{distribution: uniform, lower: 1, upper: 20}", "outside 0.1 to 10; narrow it"),
        ("{distribution: uniform, lower: 0.05, upper: 1, as: factor}", "reaches from 0.05 to 1 of 1, outside 0.1 to"),
        ("{distribution: triangular, lower: 1, mode: 0.9, upper: 2}", "must rise"),
        ("{distribution: lognormal, median: 1, factor: 0.8}", "factor greater than 1"),
        ("{distribution: words, weights: {a: 1}}", "is for a number"),
    ],
)
def test_what_is_no_distribution(distribution: str, said: str) -> None:
    message = message_of(f"{MULTIBODY}uncertain: {{variables: {{{STRENGTH}: {distribution}}}}}\n")
    assert said in message and message.startswith("s.yaml:18: ") and "\n" not in message


TASK, TWO = "pilot.task: {distribution: words, weights: ", "cockpit.seat.cushion.stiffness_n_per_m"


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ("{variables: {pilot.strength: {distribution: normal, mean: 1, deviation: 0.1}}}", "did you mean"),
        (f"{{variables: {{{TASK}{{position: 0.5, relax: 0.4}}}}}}}}", "adds up to 0.9"),
        (f"{{variables: {{{TASK}{{position: 0.5, rest: 0.5}}}}}}}}", "is not known"),
        ("{variables: {mass_kg: {distribution: normal, mean: 0, deviation: 1, as: offset}}}", "with nominal.bmi"),
        ("{variables: {stature_m: {distribution: normal, mean: 1.7, deviation: 0.01}}}", "takes the place of"),
        (
            "{variables: {rotorcraft.delay_s: {distribution: normal, mean: 0, deviation: 1, as: offset}}}",
            "lies outside",
        ),
        (
            "{variables: {rotorcraft.actuator.damping: {distribution: uniform, lower: 1, upper: 2, as: factor}}}",
            "has nothing to be a factor of",
        ),
        ("{variables: {search.seed: {distribution: uniform, lower: 1, upper: 9}}}", "is nothing that can vary"),
        ("speed", "choose one of: cushion"),
        ("{seed: 3}", "says of nothing that it is uncertain"),
        ("{sets: [strength], correlated: {a: 1}}", "must be a list of {numbers:"),
        (f"{{sets: [strength], correlated: [{{numbers: [{STRENGTH}], correlation: 0.5}}]}}", "two numbers or more"),
        (f"{{sets: [strength], correlated: [{{numbers: [{STRENGTH}, bmi], correlation: 0.5}}]}}", "is no number that"),
        (f"{{sets: [strength], correlated: [{{numbers: [{STRENGTH}, bmi], correlation: 2}}]}}", "from -1 to 1"),
        (
            f"{{sets: [strength, cushion], correlated: [{{numbers: [{STRENGTH}, {TWO}, "
            "cockpit.seat.cushion.damping_n_s_per_m], correlation: -0.7}]}",
            "is not positive definite",
        ),
    ],
)
def test_mistakes_of_the_section(section: str, said: str) -> None:
    message = message_of(f"{MULTIBODY}uncertain: {section}\n")
    assert said in message and message.startswith("s.yaml:18: uncertain") and "\n" not in message


def test_a_mistake_has_the_line_of_its_number() -> None:
    text = f"{MULTIBODY}uncertain:\n  variables:\n    bmi: {{distribution: uniform, lower: -1, upper: 1, as: offset}}\n"
    assert study_from_text(text).uncertain["variables"]["bmi"]["as"] == "offset"
    line = "    pilot.strength_factor: {distribution: uniform, lower: 1, upper: 99, as: factor}\n"
    assert message_of(text + line).startswith("s.yaml:21: uncertain.variables.pilot.strength_factor = ")


def test_a_set_means_nothing_for_a_transfer_function() -> None:
    message = message_of(f"{MAYO}uncertain: reflex\n")
    assert "means nothing for pilot.model = 'mayo'" in message
