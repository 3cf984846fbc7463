"""Robust searches: quantiles over draws as objectives, the same for the same pilot whoever asks.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import math
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from study_texts import MAYO, changed, message_of

from pilotgen.cli import main
from pilotgen.context import EvaluationContext
from pilotgen.evaluation import Evaluation, FailedEvaluation, evaluate
from pilotgen.objectives import OBJECTIVES, objective, quantile, ranked_objectives
from pilotgen.report.findings import worst_order
from pilotgen.runs.fingerprint import fingerprint
from pilotgen.runs.results import read_results
from pilotgen.study.study import study_from_text
from pilotgen.uncertain.draws import Draws
from pilotgen.uncertain.robust import with_draws

NAME = "quantile 10 % of gain_margin_db"
GEARING = "inceptor.gearing_rad_per_m: {distribution: lognormal, median: 1, factor: 1.2, as: factor}"
UNCERTAIN = f"uncertain:\n  variables: {{{GEARING}}}\n  draws: 10\n"
STUDY = changed("population: 10", f"objectives: [{NAME}, modulus_margin]\n  population: 8", MAYO) + UNCERTAIN


def drawn(margins: list[float | None], stable: bool = True) -> dict[str, Any]:
    return {"status": "ok", "loop": {"stable": stable}, "robust": {"margins": {"gain_margin_db": margins}}}


def test_a_quantile_is_one_of_the_draws_and_capped_as_its_objective() -> None:
    row = quantile("quantile 25% of gain_margin_db")
    assert row.key == "quantile 25 % of gain_margin_db" and objective(row.key) is quantile(row.key)
    assert (row.heading, row.brief(1.0)) == ("25 % quantile of the gain margin [dB]", "GM 25 % 1 dB")
    margins = [5.0, 3.0, None, 9.0, 60.0]  # the quarter of four is the smallest
    assert row.of(drawn(margins)) == 3.0 and row.ranked(drawn(margins, stable=False)) == 3.0
    assert quantile("quantile 50 % of gain_margin_db").of(drawn(margins)) == 5.0
    assert quantile("quantile 99 % of gain_margin_db").of(drawn(margins)) == math.inf  # no crossing
    assert ranked_objectives(drawn(margins), ["quantile 99 % of gain_margin_db"]) == [60.0]
    assert math.isnan(row.of({"status": "ok", "loop": {"stable": True}}))
    assert OBJECTIVES["gain_margin_db"].finite({"loop": {"stable": False, "gain_margin_db": None}}) == -60.0


def test_a_quantile_over_the_gearing_is_known() -> None:
    """Whoever flies, a gearing larger by the factor f costs 20 log10 f of gain margin: the same for every pilot."""
    study = study_from_text(STUDY)
    draws = Draws(study, 10)
    factors = [draws.changes(k, study.nominal)["inceptor.gearing_rad_per_m"] / 1.1 for k in range(10)]
    with EvaluationContext(study) as context:
        for frequency_hz in (2.6, 3.3, 4.0):
            pilot = evaluate(context, study.values({"pilot_frequency_hz": frequency_hz}))
            assert isinstance(pilot, Evaluation)
            outcome = with_draws(context, draws, pilot)
            wanted = pilot.result["loop"]["gain_margin_db"] - 20 * math.log10(max(factors))
            assert objective(NAME).of(outcome.result) == pytest.approx(wanted, abs=1e-6)
            assert outcome.result["robust"]["failed"] == 0 and "robust" not in pilot.result


def test_a_pilot_fails_with_more_than_a_tenth_of_his_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    study = study_from_text(STUDY)
    draws = Draws(study, 10)
    real, lost = Draws.evaluate, {3}

    def some(self: Draws, context: EvaluationContext, number: int, values: Any) -> Evaluation | FailedEvaluation:
        return FailedEvaluation({}, "posture", "wrist") if number in lost else real(self, context, number, values)

    monkeypatch.setattr(Draws, "evaluate", some)
    with EvaluationContext(study) as context:
        pilot = evaluate(context, study.nominal)
        assert isinstance(pilot, Evaluation)
        found = with_draws(context, draws, pilot).result["robust"]
        assert found["margins"]["gain_margin_db"][3] is None and found["failed_by_stage"] == {"posture": 1}
        lost.add(7)
        outcome = with_draws(context, draws, pilot)
    assert isinstance(outcome, FailedEvaluation) and outcome.stage == "uncertain"
    assert outcome.reason == "2 of 10 draws failed, more than a tenth: 2 at posture; wrist"


def test_the_fingerprint_knows_the_draws_of_a_robust_search_only() -> None:
    def of(text: str) -> str:
        return fingerprint(study_from_text(text))

    same = of(STUDY)
    for old, new in (("draws: 10", "draws: 11"), ("factor: 1.2", "factor: 1.3"), ("draws: 10", "draws: 10\n  seed: 2")):
        assert of(changed(old, new, STUDY)) != same, new
    assert of(changed("quantile 10 %", "quantile 20 %", STUDY)) == same  # of the same draws
    plain = changed(f"{NAME}, ", "", STUDY)
    assert of(plain) == of(changed("draws: 10", "draws: 11", plain)) == of(plain.replace(UNCERTAIN, ""))


def objectives_in(directory: Path) -> np.ndarray:
    results = read_results(directory / "study.h5")
    assert results.objective_names == (NAME, "modulus_margin")
    assert np.array_equal(results.columns[NAME], results.columns["objectives"][:, 0])
    assert not results.columns["failed_draws"].any()
    return results.columns["objectives"]


def search(study: Path, directory: Path, *more: str) -> int:
    return main(["search", str(study), "-o", str(directory), "--quiet", "--no-report", *more])


def test_a_pilot_has_one_value_with_any_workers_after_an_interruption_and_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = tmp_path / "s.yaml"
    study.write_text(STUDY)
    assert search(study, tmp_path / "one", "--workers", "1") == 0
    captured = capsys.readouterr()
    assert "every pilot is evaluated 11 times, at most 264 evaluations in all" in captured.err
    assert "10 % quantile of the gain margin [dB]" in captured.out
    assert search(study, tmp_path / "two", "--workers", "2") == 0
    wanted = objectives_in(tmp_path / "one")
    assert np.array_equal(objectives_in(tmp_path / "two"), wanted)
    with sqlite3.connect(tmp_path / "two" / "journal.sqlite") as journal:  # as if killed
        rows = journal.execute("SELECT count(*) FROM evaluation").fetchone()[0]
        journal.execute("DELETE FROM evaluation WHERE rowid > 9")
    (tmp_path / "two" / "study.h5").unlink()
    assert rows > 9 and search(study, tmp_path / "two", "--workers", "1", "--resume") == 0
    assert np.array_equal(objectives_in(tmp_path / "two"), wanted)

    results = read_results(tmp_path / "one" / "study.h5")
    value = f"pilot_frequency_hz={float(results.columns['inputs'][3, 0])!r}"
    command = ["pilot", str(study), "--uncertain", "-n", "10", "-o", str(tmp_path / "p"), "--no-figures"]
    assert main([*command, "--set", value]) == 0
    alone = json.loads((tmp_path / "p" / "uncertain.json").read_text())["margins"]["gain_margin_db"]
    assert min(alone["draws"]) == wanted[3, 0]

    study.write_text(changed("factor: 1.2", "factor: 1.3", STUDY))
    capsys.readouterr()
    assert search(study, tmp_path / "one", "--resume") == 1
    assert "factor  1.2    1.3" in capsys.readouterr().err


def test_the_report_tells_what_was_searched_for_and_nominal_margins_beside_it(
    tmp_path: Path, run: Callable[..., tuple[int, str, str]]
) -> None:
    study = tmp_path / "s.yaml"
    study.write_text(STUDY)
    out = tmp_path / "o"
    code, _, err = run("search", study, "-o", out, "--quiet", "--workers", "1", "--fail-below")
    results = read_results(out / "study.h5")
    order = worst_order(results)
    first = results.columns["rank"][order] == 1
    searched = results.columns[NAME] + results.columns["modulus_margin"]
    assert first[0] and (np.diff(searched[order[first]]) >= 0.0).all()
    worst = float(results.columns[NAME][order[0]])
    nominal = float(results.columns["gain_margin_db"][order[0]])
    assert worst < nominal
    page = (out / "report.html").read_text()
    told = f"{worst:.2f} dB".replace("-", "−")
    assert f"He was searched for by the 10 % quantile of the gain margin, {told}, over 10 draws" in page
    assert f"10 % quantile of the gain margin {told}" in page and "nominal gain margin" in page
    assert "<th>10 % quantile of the gain margin [dB]</th><th>nominal gain margin [dB]</th>" in page
    assert '"plane": ["gain_margin_db_10", "modulus_margin"]' in page.replace('":[', '": [').replace('","', '", "')
    assert (
        code == 5 and "10 % quantile of the gain margin below 6.00 dB" in err and "a nominal gain margin below" in err
    )


def test_other_algorithms_and_samples(tmp_path: Path) -> None:
    study = tmp_path / "s.yaml"
    study.write_text(changed("generations: 3", "generations: 2\n  algorithm: nsga2", STUDY))
    assert search(study, tmp_path / "n", "--workers", "1") == 0
    assert np.isfinite(objectives_in(tmp_path / "n")).all()
    assert main(["sample", str(study), "-n", "5", "-o", str(tmp_path / "s"), "--quiet", "--workers", "1"]) == 0
    assert np.isfinite(objectives_in(tmp_path / "s")).all()
    run = ["sensitivity", str(study), "-n", "16", "-o", str(tmp_path / "x"), "--quiet", "--workers", "1"]
    assert main(run) == 0  # has objectives of its own, and no draws
    with sqlite3.connect(tmp_path / "x" / "journal.sqlite") as journal:
        assert "robust" not in journal.execute("SELECT result FROM evaluation").fetchone()[0]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("quantile 5 of gain_margin_db", "write e.g. quantile 5 % of gain_margin_db"),
        ("quantile 0.5.1 % of gain_margin_db", "is no quantile of an objective"),
        ("quantile 100 % of gain_margin_db", "more than 0 % and less than 100 % is wanted"),
        ("quantile 5 % of gain_margin", "names no objective"),
        ("quantile 5 % of gain_margin_db", "is beyond 10 draws; give uncertain.draws: 20 or more"),
        ("quantile 95 % of gain_margin_db", "is beyond 10 draws; give uncertain.draws: 20 or more"),
        ("quantile 20 % of gain_margin_db, quantile 20% of gain_margin_db", "names something twice"),
        ("gain", "is not known"),
    ],
)
def test_mistakes(name: str, said: str) -> None:
    message = message_of(changed(NAME, name, STUDY))
    assert said in message and message.startswith("s.yaml:8: search.objectives") and "\n" not in message


def test_a_quantile_needs_something_uncertain() -> None:
    message = message_of(STUDY.replace(UNCERTAIN, ""))
    assert message.startswith("s.yaml:8: search.objectives") and "needs a section uncertain" in message
