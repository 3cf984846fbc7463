"""Figures of people and sensitivities: which are written, what they show, and what they are drawn from.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from study_texts import MAYO

from pilotgen.cli import main
from pilotgen.figures import draw_population, draw_sensitivity
from pilotgen.figures import population as people_figures
from pilotgen.figures import sensitivity as sensitivity_figures
from pilotgen.population.joint import bundled_joint
from pilotgen.runs import plane
from pilotgen.sensitivity.words import sentences
from pilotgen.study.yaml_file import bundled

STUDIES = Path(__file__).parents[2] / "docs" / "studies"
STUDY = MAYO + (
    "sensitivity:\n  variables: {pilot_frequency_hz: [2.5, 4.0], pilot_damping: [0.2, 0.5]}\n"
    "  objectives: [modulus_margin, gain_margin_db, phase_margin_deg]\n"
)


def names(directory: Path) -> list[str]:
    return sorted(path.name for path in directory.glob("*.png"))


@pytest.mark.parametrize(
    ("method", "number", "wanted"),
    [
        ("sobol", 16, ["convergence", "indices", "slopes"]),
        ("morris", 4, ["indices", "slopes"]),
        ("surrogate", 40, ["convergence", "indices", "slopes"]),
        ("anova", 3, ["indices", "slopes"]),
    ],
)
def test_a_run_draws_what_decides(method: str, number: int, wanted: list[str], tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(STUDY)
    more = ["--method", method, "-n", str(number), "--quiet", "--workers", "1"]
    assert main(["sensitivity", str(tmp_path / "s.yaml"), "-o", str(tmp_path / "a"), *more]) == 0
    assert names(tmp_path / "a") == [f"sensitivity-{name}.png" for name in wanted]
    content = json.loads((tmp_path / "a" / "sensitivity.json").read_text())
    told = sentences(content)
    assert content["sentence"] == told[0] and len(told) == 3
    assert told[0].startswith("The modulus margin depends most on pilot_")
    assert ("a larger one" in told[0]) == (method != "anova")
    assert told[2].startswith("The phase margin has no indices: ") and "pilots have none" in told[2]
    assert main(["sensitivity", str(tmp_path / "s.yaml"), "-o", str(tmp_path / "b"), *more, "--no-figures"]) == 0
    assert names(tmp_path / "b") == []


def sensitivity_content(totals: dict[str, float]) -> dict[str, Any]:
    numbers = {
        name: {"first": total, "first_half_width": 0.1, "total": total, "total_half_width": 0.1}
        for name, total in totals.items()
    }
    one = {
        "nominal": 9.0, "infinite": 0, "slopes": {"a": -2.0, "b": None},
        "indices": {"blocks": 30, "blocks_left_out": 2, "numbers": numbers},
        "convergence": [{"base": base, "total": totals} for base in (8, 16, 32)],
    }  # fmt: skip
    number = {"lower": 1.0, "upper": 4.0, "nominal": 2.0, "unit": "kg"}
    return {
        "method": "sobol",
        "points": 128,
        "numbers": {"a": number, "b": number},
        "objectives": {"gain_margin_db": one},
    }


def test_bars_are_the_numbers() -> None:
    content = sensitivity_content({"a": 0.7, "b": 0.4})
    (axes,) = sensitivity_figures.indices(content).axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["b", "a"]  # the largest on top
    assert [bar.get_width() for bar in axes.patches] == [0.4, 0.7, 0.4, 0.7]
    (axes,) = sensitivity_figures.slopes(content).axes  # b has no slope
    assert [label.get_text() for label in axes.get_yticklabels()] == ["a"]
    assert [bar.get_width() for bar in axes.patches][:2] == [2.0, -4.0]  # -2 per kg, down by 1 and up by 2
    (axes,) = sensitivity_figures.convergence(content).axes
    assert {tuple(line.get_ydata()) for line in axes.lines if len(line.get_xdata()) == 3} == {(0.7,) * 3, (0.4,) * 3}


def test_without_indices_there_are_slopes_only(tmp_path: Path) -> None:
    content = sensitivity_content({"a": 0.7, "b": 0.4})
    content["objectives"]["gain_margin_db"] |= {"indices": None, "infinite": 3}
    del content["objectives"]["gain_margin_db"]["convergence"]
    draw_sensitivity(content, tmp_path)
    assert names(tmp_path) == ["sensitivity-slopes.png"]


def test_a_region_holds_its_share_of_the_people() -> None:
    for who in ("ansur2-men", "ansur2-women"):
        joint = bundled_joint(bundled("population").value[who])
        people = joint.people(np.random.default_rng(3).standard_normal((20_000, 3)))[:, 1:]
        for probability in plane.PROBABILITIES:
            outline = np.array(plane._region(joint, probability))
            left, right = outline, np.roll(outline, -1, axis=0)  # even-odd rule, edge by edge
            inside = np.zeros(len(people), dtype=bool)
            for (x, y), (u, v) in zip(left, right, strict=True):
                between = (y > people[:, 1]) != (v > people[:, 1])
                inside ^= between & (people[:, 0] < (u - x) * (people[:, 1] - y) / (v - y or math.inf) + x)
            assert inside.mean() == pytest.approx(probability, abs=0.005)


def test_people_over_stature_and_mass(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plane, "POINTS", 3)
    more = ["-n", "6", "--quiet", "--workers", "1"]
    assert main(["population", str(STUDIES / "puma-population.yaml"), "-o", str(tmp_path), *more]) == 0
    assert names(tmp_path) == ["population-margins.png", "population-plane.png"]
    content = json.loads((tmp_path / "population.json").read_text())
    assert content["people"] == 6 and content["sentence"].endswith("with a gain margin below 6.00 dB.")
    (one,) = content["plane"]
    assert one["stature_m"][0] == 1.57 and one["stature_m"][-1] == 1.93  # the entry limits
    margins = one["margins"]["gain_margin_db"]
    assert len(margins) == len(one["mass_kg"]) == 3 and margins[1][1] > margins[1][2]  # the tall have less
    assert margins[2][0] is None  # 1.57 m and 144 kg: nobody was measured
    with (tmp_path / "people.csv").open(newline="") as file:
        people = list(csv.DictReader(file))
    axes = people_figures.plane(content, people).axes[0]
    dots = sum(len(scatter.get_offsets()) for scatter in axes.collections if scatter.get_label().startswith("people"))
    assert dots == sum(person["status"] == "ok" for person in people)


def test_a_file_of_people_has_no_plane(tmp_path: Path) -> None:
    rows = ["number,sex,status,stable,gain_margin_db,phase_margin_deg,modulus_margin"]
    rows += ["0,male,ok,true,7.0,inf,0.5", "1,male,ok,true,5.0,inf,0.4", "2,male,failed,,,,"]
    (tmp_path / "people.csv").write_text("\n".join(rows) + "\n")
    shares = {"gain_margin_db": {"share": 0.5, "limit": 6.0}}
    draw_population({"evaluated": 2, "name": "people of the file", "shares": shares, "plane": []}, tmp_path)
    assert names(tmp_path) == ["population-margins.png"]
