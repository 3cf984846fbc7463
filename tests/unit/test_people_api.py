"""Populations, rare shares and sensitivities from Python: the numbers of the commands, as tables.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import pilotgen as pg
from pilotgen.cli import main
from pilotgen.report.others import read_report_section

STUDIES = Path(__file__).parents[2] / "docs" / "studies"


def test_people_are_those_of_the_command(tmp_path: Path) -> None:
    study = pg.read_study(STUDIES / "puma-population.yaml")
    seen: list[int] = []
    found = pg.sample_population(
        study, tmp_path / "a", 6, options=pg.RunOptions(workers=1), on_progress=lambda one, _: seen.append(one.done)
    )
    assert seen[-1] == 6 and found.progress.done == 6
    assert json.loads((tmp_path / "a" / ".heartbeat.json").read_text())["done"] == 6  # for `pilotgen status`
    ask = ["population", str(STUDIES / "puma-population.yaml"), "-n", "6", "-o", str(tmp_path / "b"), "--workers", "2"]
    assert main([*ask, "--quiet", "--no-figures"]) == 0
    for name in ("people.csv", "population.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    table = found.table()
    ok = table["status"] == "ok"
    below = int((table["gain_margin_db"][ok] < 6.0).sum())
    assert len(table) == 6 and found.to_dict()["shares"]["gain_margin_db"]["count"] == below
    with pytest.raises(pg.PilotgenError):
        pg.sample_population(study, tmp_path / "a", 6)  # there is something, and nobody said to go on
    again = pg.sample_population(study, tmp_path / "a", 6, options=pg.RunOptions(resume=True))
    assert again.content == found.content and again.progress.served == 6


def test_a_changed_study_is_written_down(tmp_path: Path) -> None:
    study, _ = pg.read_study(STUDIES / "puma-mayo.yaml").with_values({"inceptor.gearing_rad_per_m": 1.0})
    found = pg.sensitivity_of(study, tmp_path / "a", 30, "surrogate", options=pg.RunOptions(workers=1))
    assert "gearing_rad_per_m: 1.0" in found.content["study_text"]
    assert json.loads(found.path.read_text()) == found.to_dict()
    table = found.table("modulus_margin")
    rows = found.content["objectives"]["modulus_margin"]
    assert table["number"].tolist() == list(rows["slopes"])
    assert table["total"].tolist() == [row["total"] for row in rows["indices"]["numbers"].values()]
    assert np.isfinite(table["slope"]).all()
    section = read_report_section(found.path.parent)
    assert section.kind == "sensitivity" and section.table is not None
    assert section.table["heads"][2] == "total index" and "What moves the modulus margin most" in section.sentences[0]
    squares = pg.sensitivity_of(study, tmp_path / "b", 3, "anova", options=pg.RunOptions(workers=1)).table()
    section = read_report_section(tmp_path / "b")
    assert section.table is not None and section.table["heads"][2] == "share of the sum of squares"
    assert squares["source"][-1] == "total" and np.isnan(squares["p"][-1])
    assert squares["sum_of_squares"][:-1].sum() == pytest.approx(squares["sum_of_squares"][-1])


def test_a_rare_share(tmp_path: Path) -> None:
    study = pg.read_study(STUDIES / "puma-population.yaml")
    found = pg.rare_share(study, tmp_path / "a", 100, "gain_margin_db", options=pg.RunOptions(workers=2))
    assert found.path.name == "rare.json" and 0.0 < found.content["low"] < found.content["share"]
    section = read_report_section(tmp_path / "a")
    assert section.kind == "population" and "of men" in section.answer and "1 in " in section.sentences[0]
    nearest = found.table()
    assert (nearest["gain_margin_db"] < 6.0).all() and (nearest["mahalanobis_distance"] > 0.0).all()
    assert {"age_years", "stature_m", "mass_kg", "pilot.sex"} <= set(nearest.dtype.names or ())


def test_what_is_not_known_of_one_pilot(tmp_path: Path) -> None:
    text = (STUDIES / "puma-mayo.yaml").read_text() + "uncertain:\n  variables:\n    pilot_damping: "
    (tmp_path / "s.yaml").write_text(
        text + "{distribution: normal, mean: 0, deviation: 0.02, as: offset, within: [-0.05, 0.05]}\n"
    )
    study = pg.read_study(tmp_path / "s.yaml")
    values = {"pilot_frequency_hz": 3.0}
    found = pg.uncertain_pilot(study, tmp_path / "a", 12, values, options=pg.RunOptions(workers=1))
    ask = [
        "pilot",
        str(tmp_path / "s.yaml"),
        "--uncertain",
        "-n",
        "12",
        "-o",
        str(tmp_path / "b"),
        "--no-figures",
        "--quiet",
    ]
    assert main([*ask, "--set", "pilot_frequency_hz=3.0"]) == 0
    for name in ("uncertain.json", "uncertain.csv"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    table = found.table()
    assert len(table) == 12 and np.isfinite(table["pilot_damping"]).all() and found.progress.done == 12
    margins = found.content["margins"]["modulus_margin"]
    assert table["modulus_margin"].tolist() == margins["draws"]
    resumed = pg.RunOptions(workers=1, resume=True)
    more = pg.uncertain_pilot(study, tmp_path / "a", 14, values, options=resumed)
    assert (more.progress.evaluated, more.progress.served) == (2, 12)
    other = study.with_values({"inceptor.gearing_rad_per_m": 0.7})[0]
    with pytest.raises(pg.PilotgenError, match="differs from in what determines its evaluations"):
        pg.uncertain_pilot(other, tmp_path / "a", 14, values, options=resumed)
    assert (tmp_path / "a" / "uncertain.json").is_file()  # refused before anything was replaced
    with pytest.raises(pg.PilotgenError, match="has no section uncertain"):
        pg.uncertain_pilot(pg.read_study(STUDIES / "puma-mayo.yaml"), tmp_path / "c", 3)
    assert not (tmp_path / "c").exists()
