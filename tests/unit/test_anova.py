"""Analysis of variance: a published example, closed forms, the command.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from study_texts import MAYO

from pilotgen.cli import main
from pilotgen.errors import StudyError
from pilotgen.sensitivity.anova import anova, factorial_points

STUDY = MAYO + (
    "sensitivity:\n  variables: {pilot_frequency_hz: [2.5, 4.0], pilot_damping: [0.2, 0.5], "
    "inceptor.gearing_rad_per_m: [0.9, 1.3]}\n"
)
# Life of a battery [h] over material (3) and temperature (3), four of each: Montgomery, Design and Analysis of
# Experiments, 8th edition, tables 5.1 and 5.5.
BATTERY = np.array(
    [
        [[130, 155, 74, 180], [34, 40, 80, 75], [20, 70, 82, 58]],
        [[150, 188, 159, 126], [136, 122, 106, 115], [25, 70, 58, 45]],
        [[138, 110, 168, 160], [174, 120, 150, 139], [96, 104, 82, 60]],
    ],
    dtype=float,
)


def test_a_published_example() -> None:
    rows = {row["source"]: row for row in anova(BATTERY, ["material", "temperature"])}
    squares = {
        "material": (10683.72, 2, 7.91),
        "temperature": (39118.72, 2, 28.97),
        "material x temperature": (9613.78, 4, 3.56),
    }
    for source, (square, freedom, f) in squares.items():
        assert rows[source]["sum_of_squares"] == pytest.approx(square, abs=0.006)
        assert rows[source]["degrees_of_freedom"] == freedom and rows[source]["f"] == pytest.approx(f, abs=0.006)
    assert rows["error"]["sum_of_squares"] == pytest.approx(18230.75) and rows["error"]["degrees_of_freedom"] == 27
    assert rows["total"]["sum_of_squares"] == pytest.approx(77646.97, abs=0.006)
    assert rows["material"]["p"] == pytest.approx(0.0020, abs=5e-5)
    assert rows["material x temperature"]["p"] == pytest.approx(0.0186, abs=5e-5)


def test_one_factor_of_two_is_scipys_one_way_analysis() -> None:
    """With all else averaged out: F of a main effect against that of `scipy.stats.f_oneway` on the pooled error."""
    rng = np.random.default_rng(1)
    values = rng.normal(size=(3, 1, 8)) + np.array([0.0, 1.0, 0.5])[:, None, None]
    rows = {row["source"]: row for row in anova(np.repeat(values, 2, axis=1), ["a", "b"])}
    one = stats.f_oneway(*values[:, 0, :])
    assert rows["a"]["sum_of_squares"] / rows["error"]["sum_of_squares"] * 21 / 2 == pytest.approx(one.statistic)
    assert rows["b"]["sum_of_squares"] == pytest.approx(0.0, abs=1e-20)


def test_sums_of_a_function_in_closed_form() -> None:
    """y = 3 a + 2 b + a b on levels -1, 0, 1 of three factors: 27 (2/3) 9, 27 (2/3) 4, 27 (2/3)^2."""
    points = factorial_points({"a": (-1.0, 1.0), "b": (-1.0, 1.0), "c": (-1.0, 1.0)}, 3)
    assert points.shape == (27, 3) and points[1].tolist() == [-1.0, -1.0, 0.0]
    a, b, _ = points.T
    rows = {row["source"]: row for row in anova((3 * a + 2 * b + a * b).reshape(3, 3, 3, 1), ["a", "b", "c"])}
    squares = {name: row["sum_of_squares"] for name, row in rows.items()}
    assert squares == pytest.approx(
        {"a": 162, "b": 72, "c": 0, "a x b": 12, "a x c": 0, "b x c": 0, "error": 0, "total": 246}, abs=1e-9
    )
    assert rows["a"]["f"] is None and rows["a"]["p"] is None  # no error: nothing to hold against
    assert sum(row.get("share", 0.0) for row in rows.values()) == pytest.approx(1.0)


def test_two_factors_without_replicates_take_their_interaction_for_error() -> None:
    values = np.array([[1.0, 2.0, 4.0], [2.0, 3.0, 6.0]])[:, :, None]
    rows = {row["source"]: row for row in anova(values, ["a", "b"])}
    assert set(rows) == {"a", "b", "error", "total"} and rows["error"]["degrees_of_freedom"] == 2
    total = sum(rows[name]["sum_of_squares"] for name in ("a", "b", "error"))
    assert total == pytest.approx(rows["total"]["sum_of_squares"])
    f = (rows["a"]["sum_of_squares"] / 1) / (rows["error"]["sum_of_squares"] / 2)
    assert rows["a"]["f"] == pytest.approx(f) and rows["a"]["p"] == pytest.approx(stats.f.sf(f, 1, 2))


@pytest.mark.parametrize(
    ("bounds", "levels", "said"),
    [
        ({"a": (0.0, 1.0), "b": (0.0, 1.0)}, 1, "two at least"),
        ({"a": (0.0, 1.0)}, 3, "two numbers at least"),
        ({f"x{k}": (0.0, 1.0) for k in range(12)}, 3, "531441 pilots, more than 100000"),
    ],
)
def test_what_is_no_factorial(bounds: dict[str, tuple[float, float]], levels: int, said: str) -> None:
    with pytest.raises(StudyError, match=said):
        factorial_points(bounds, levels)


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "s.yaml").write_text(STUDY)
    ask = ["sensitivity", str(tmp_path / "s.yaml"), "--anova", "-n", "3", "--quiet", "-o"]
    assert main([*ask, str(tmp_path / "a"), "--workers", "1"]) == 0
    out = capsys.readouterr().out
    assert "sum of squares" in out and "pilot_frequency_hz x pilot_damping" in out
    assert main([*ask, str(tmp_path / "b"), "--workers", "2", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert (tmp_path / "a" / "sensitivity.json").read_bytes() == (tmp_path / "b" / "sensitivity.json").read_bytes()
    assert content["points"] == 27 and content["method"] == "anova"
    table = {row["source"]: row for row in content["objectives"]["gain_margin_db"]["anova"]}
    # the gain margin is that of gearing 1 less 20 log10 of it: no interaction, and its sum is known
    gearing = -20.0 * np.log10([0.9, 1.1, 1.3])
    assert table["inceptor.gearing_rad_per_m"]["sum_of_squares"] == pytest.approx(9 * 3 * gearing.var(), rel=1e-9)
    assert table["pilot_damping x inceptor.gearing_rad_per_m"]["sum_of_squares"] == pytest.approx(0.0, abs=1e-9)
    assert math.isclose(sum(row["degrees_of_freedom"] for row in table.values() if row["source"] != "total"), 26)
    with pytest.raises(SystemExit):  # two methods
        main([*ask, str(tmp_path / "c"), "--method", "morris"])
    assert "not allowed with argument" in capsys.readouterr().err and not (tmp_path / "c").exists()
