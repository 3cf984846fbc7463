"""Sensitivity: indices against closed forms, slopes, failures, and the command.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from study_texts import MAYO, MULTIBODY, message_of

import pilotgen as pg
from pilotgen.cli import main
from pilotgen.errors import StudyError
from pilotgen.sensitivity import indices
from pilotgen.sensitivity.surrogate import ENOUGH, surrogate_indices, surrogate_points
from pilotgen.study.study import read_study

Run = Callable[..., tuple[int, str, str]]
STUDY = MAYO + (
    "sensitivity:\n  variables: {pilot_frequency_hz: [2.5, 4.0], pilot_damping: [0.2, 0.5], "
    "inceptor.gearing_rad_per_m: [0.9, 1.3]}\n"
)


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*arguments: object) -> tuple[int, str, str]:
        code = main(["sensitivity", "--quiet", "--workers", "1", *(str(argument) for argument in arguments)])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


def test_ishigami() -> None:
    """f = sin x1 + 7 sin^2 x2 + 0.1 x3^4 sin x1; variances in closed form."""
    a, b, pi = 7.0, 0.1, math.pi
    box = {f"x{k}": (-pi, pi) for k in (1, 2, 3)}
    x = indices.sobol_points(box, 4096, 1)
    found = indices.sobol_indices(box, np.sin(x[:, 0]) * (1 + b * x[:, 2] ** 4) + a * np.sin(x[:, 1]) ** 2, 1)[
        "numbers"
    ]
    v1, v2, v13 = 0.5 * (1 + b * pi**4 / 5) ** 2, a**2 / 8, b**2 * pi**8 * (1 / 18 - 1 / 50)
    v = v1 + v2 + v13
    assert [found[name]["first"] for name in box] == pytest.approx([v1 / v, v2 / v, 0.0], abs=0.02)
    assert [found[name]["total"] for name in box] == pytest.approx([(v1 + v13) / v, v2 / v, v13 / v], abs=0.02)
    assert all(found[name]["total_half_width"] < 0.06 for name in box)


def test_sobol_g_function() -> None:
    """prod (|4 x - 2| + a) / (1 + a); V_k = 1 / 3 (1 + a_k)^2."""
    a = np.array([0.0, 1.0, 4.5, 9.0, 99.0])
    box = {f"x{k}": (0.0, 1.0) for k in range(5)}
    x = indices.sobol_points(box, 4096, 3)
    found = indices.sobol_indices(box, np.prod((np.abs(4 * x - 2) + a) / (1 + a), axis=1), 3)["numbers"]
    parts = 1 / (3 * (1 + a) ** 2)
    v = np.prod(1 + parts) - 1
    total = [parts[k] * np.prod(1 + np.delete(parts, k)) / v for k in range(5)]
    assert [row["first"] for row in found.values()] == pytest.approx(list(parts / v), abs=0.02)
    assert [row["total"] for row in found.values()] == pytest.approx(total, abs=0.02)


def test_a_linear_function_has_known_indices_effects_and_slopes() -> None:
    box, slope = {"a": (0.0, 1.0), "b": (10.0, 14.0), "c": (-1.0, 1.0)}, np.array([3.0, -0.5, 0.0])
    x = indices.sobol_points(box, 1024, 2)
    found = indices.sobol_indices(box, x @ slope, 2)["numbers"]
    parts = (slope * [1, 4, 2]) ** 2
    assert [row["total"] for row in found.values()] == pytest.approx(list(parts / parts.sum()), abs=0.01)
    points = indices.morris_points(box, 8, 2)
    effects = indices.morris_effects(box, points, points @ slope, 2)["numbers"]
    assert [row["mean"] for row in effects.values()] == pytest.approx([3.0, -2.0, 0.0], abs=1e-9)
    assert [row["deviation"] for row in effects.values()] == pytest.approx([0.0] * 3, abs=1e-9)
    near = indices.slope_points([0.0, 12.0, 0.5], list(box.values()), [0.1, 0.1, 0.1])  # a at its end: one-sided
    assert indices.slopes(near, near @ slope) == pytest.approx(list(slope), abs=1e-12)


def test_a_surrogate_has_the_indices_of_polynomials_and_of_ishigamis_function() -> None:
    box, slope = {"a": (0.0, 1.0), "b": (10.0, 14.0), "c": (-1.0, 1.0)}, np.array([3.0, -0.5, 0.0])
    x = surrogate_points(box, 20, 2)
    assert np.array_equal(surrogate_points(box, 12, 2), x[:12])
    found = surrogate_indices(box, x, x @ slope, 2)
    parts = (slope * [1, 4, 2]) ** 2 / ((slope * [1, 4, 2]) ** 2).sum()
    assert found["explained"] == pytest.approx(1.0, abs=1e-12)
    assert [row["total"] for row in found["numbers"].values()] == pytest.approx(list(parts), abs=1e-9)
    # a b with a in [0, 1], b in [10, 14]: variances 12^2 / 12, 4^2 / 12 / 4, 4^2 / 144
    one = surrogate_indices({"a": (0.0, 1.0), "b": (10.0, 14.0)}, x[:, :2], x[:, 0] * x[:, 1], 1)["numbers"]
    v = np.array([12.0, 16 / 48, 16 / 144])
    assert one["a"]["first"] == pytest.approx(v[0] / v.sum(), abs=1e-9)
    assert one["b"]["total"] == pytest.approx((v[1] + v[2]) / v.sum(), abs=1e-9)
    a, b, pi = 7.0, 0.1, math.pi
    box = {f"x{k}": (-pi, pi) for k in (1, 2, 3)}
    x = surrogate_points(box, 512, 1)
    told = surrogate_indices(box, x, np.sin(x[:, 0]) * (1 + b * x[:, 2] ** 4) + a * np.sin(x[:, 1]) ** 2, 1)
    v1, v2, v13 = 0.5 * (1 + b * pi**4 / 5) ** 2, a**2 / 8, b**2 * pi**8 * (1 / 18 - 1 / 50)
    v = v1 + v2 + v13
    assert told["explained"] > 0.98
    assert [row["first"] for row in told["numbers"].values()] == pytest.approx([v1 / v, v2 / v, 0.0], abs=0.01)
    assert [row["total"] for row in told["numbers"].values()] == pytest.approx(
        [(v1 + v13) / v, v2 / v, v13 / v], abs=0.01
    )


def test_a_surrogate_says_where_it_does_not_fit_and_its_intervals_hold() -> None:
    """A polynomial does not follow the kinks of the g-function with a = 0; noise widens the intervals."""
    a = np.array([0.0, 0.0, 0.0])
    box = {f"x{k}": (0.0, 1.0) for k in range(3)}
    x = surrogate_points(box, 64, 3)
    assert surrogate_indices(box, x, np.prod((np.abs(4 * x - 2) + a) / (1 + a), axis=1), 3)["explained"] < ENOUGH
    held, slope = 0, np.array([1.0, 0.5, 0.1])
    truth = slope**2 / (slope**2).sum()
    for seed in range(40):
        x = surrogate_points(box, 64, seed)
        y = x @ slope + 0.1 * np.random.default_rng(seed).standard_normal(64)
        rows = surrogate_indices(box, x, y, seed)["numbers"].values()
        held += sum(abs(row["first"] - t) <= row["first_half_width"] for row, t in zip(rows, truth, strict=True))
    assert held >= 0.85 * 120
    nothing = surrogate_indices(box, x, np.full(64, 2.0), 1)
    assert nothing["degree"] is None and nothing["numbers"]["x0"]["total"] is None
    with pytest.raises(StudyError, match="6 are wanted at least, and 15 for one that is curved"):
        surrogate_points(box, 5, 1)


def test_points_of_a_longer_sample_begin_with_those_of_a_shorter_one() -> None:
    box = {"a": (0.0, 1.0), "b": (0.0, 1.0)}
    assert np.array_equal(indices.sobol_points(box, 64, 5)[: 32 * 4], indices.sobol_points(box, 32, 5))


def test_a_block_with_a_failure_is_left_out_as_a_whole() -> None:
    box = {"a": (0.0, 1.0), "b": (0.0, 1.0)}
    x = indices.sobol_points(box, 64, 1)
    values = 2 * x[:, 0] + x[:, 1]
    values[[5, 6, 21]] = np.nan
    found = indices.sobol_indices(box, values, 1)
    assert (found["blocks"], found["blocks_left_out"]) == (62, 2)
    kept = np.delete(values.reshape(-1, 4), [1, 5], axis=0).ravel()
    assert found["numbers"] == indices.sobol_indices(box, kept, 1)["numbers"]
    nothing = indices.sobol_indices(box, np.full(len(x), 3.0), 1)["numbers"]["a"]
    assert nothing["first"] is None and nothing["total"] is None


@pytest.mark.parametrize("base", [1, 8, 100])
def test_too_few_base_points(base: int) -> None:
    with pytest.raises(StudyError, match="a power of two from 16 up is wanted"):
        indices.check_base(base)


def test_the_command(run: Run, tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(STUDY)
    code, out, err = run(tmp_path / "s.yaml", "-n", 32, "-o", tmp_path / "a", "--json")
    assert code == 0, err
    content = json.loads(out)
    assert content == json.loads((tmp_path / "a" / "sensitivity.json").read_text())
    assert content["points"] == 32 * 5 and content["failed"] == 0
    modulus = content["objectives"]["modulus_margin"]
    numbers = modulus["indices"]["numbers"]
    assert set(numbers) == {"pilot_frequency_hz", "pilot_damping", "inceptor.gearing_rad_per_m"}
    assert modulus["slopes"]["inceptor.gearing_rad_per_m"] < 0 < modulus["slopes"]["pilot_damping"]
    # the gain margin of a gearing G is that of 1 less 20 log10 G, whatever else: its slope is known
    slope = content["objectives"]["gain_margin_db"]["slopes"]["inceptor.gearing_rad_per_m"]
    assert slope == pytest.approx(-20 / math.log(10) / 1.1, rel=1e-4)
    assert [step["base"] for step in modulus["convergence"]] == [8, 16, 32]
    code, out, _ = run(tmp_path / "s.yaml", "-n", 32, "-o", tmp_path / "a", "--resume")
    assert code == 0 and "\n0 of 160 pilots failed (0.0 %)" in out
    assert out.count("total indices moved by at most") == 2
    run(tmp_path / "s.yaml", "-n", 32, "-o", tmp_path / "two", "--workers", 2)
    assert (tmp_path / "two" / "sensitivity.json").read_bytes() == (tmp_path / "a" / "sensitivity.json").read_bytes()
    code, out, _ = run(tmp_path / "s.yaml", "-n", 4, "-o", tmp_path / "m", "--method", "morris", "--json")
    assert code == 0 and json.loads(out)["objectives"]["modulus_margin"]["indices"]["blocks"] == 4
    code, out, _ = run(tmp_path / "s.yaml", "--surrogate", "-n", 60, "-o", tmp_path / "p")
    assert code == 0 and "% of the variance of pilots left out" in out
    told = json.loads((tmp_path / "p" / "sensitivity.json").read_text())["objectives"]["modulus_margin"]["indices"]
    assert told["explained"] > 0.98 and told["blocks"] == 60
    for name, row in told["numbers"].items():  # as the estimator of many more pilots has them, within its interval
        assert abs(row["total"] - numbers[name]["total"]) < numbers[name]["total_half_width"] + 0.02
    code, out, err = run(tmp_path / "s.yaml", "-n", 20, "-o", tmp_path / "c")
    assert code == 1 and "give -n 16 or 32" in err and not (tmp_path / "c").exists()


def variance_of_log(low: float, high: float) -> float:
    """Of ln x, x evenly spread."""
    mean = (high * math.log(high) - low * math.log(low)) / (high - low) - 1.0
    squared = [x * (math.log(x) ** 2 - 2 * math.log(x) + 2) for x in (low, high)]
    return (squared[1] - squared[0]) / (high - low) - mean**2


def test_pilots_with_indices_in_closed_form(run: Run, tmp_path: Path) -> None:
    """The gain margin of gearing G is that of 1 less 20 log10 G dB: a sum of a part of the pilot's and one of G's."""
    gearing, damping = (0.8, 1.6), (0.2, 0.5)
    text = f"inceptor.gearing_rad_per_m: {list(gearing)}, pilot_damping: {list(damping)}"
    (tmp_path / "s.yaml").write_text(f"{MAYO}sensitivity:\n  variables: {{{text}}}\n  objectives: [gain_margin_db]\n")
    study = read_study(tmp_path / "s.yaml")
    nodes, weights = np.polynomial.legendre.leggauss(12)
    margin = np.array(
        [pg.evaluate(study, {"pilot_damping": 0.35 + 0.15 * x}).margins.gain_margin_db for x in nodes.tolist()]
    )
    of_pilot = weights @ margin**2 / 2 - (weights @ margin / 2) ** 2
    of_gearing = (20 / math.log(10)) ** 2 * variance_of_log(*gearing)
    share = of_gearing / (of_gearing + of_pilot)
    assert 0.2 < share < 0.8
    for method, number, error in (("sobol", 256, 0.015), ("surrogate", 60, 1e-3)):
        _, out, err = run(tmp_path / "s.yaml", "--method", method, "-n", number, "-o", tmp_path / method, "--json")
        rows = json.loads(out)["objectives"]["gain_margin_db"]["indices"]["numbers"]
        for name, expected in (("inceptor.gearing_rad_per_m", share), ("pilot_damping", 1.0 - share)):
            assert rows[name]["first"] == pytest.approx(expected, abs=error), (method, name, err)
            assert rows[name]["total"] == pytest.approx(expected, abs=error)


def test_an_infinite_margin_has_no_indices(run: Run, tmp_path: Path) -> None:
    (tmp_path / "s.yaml").write_text(STUDY + "  objectives: [phase_margin_deg]\n")
    code, out, err = run(tmp_path / "s.yaml", "-n", 16, "-o", tmp_path / "a")
    assert code == 0, err
    assert "phase margin: infinite for" in out and "so that it has no indices" in out
    (tmp_path / "s.yaml").write_text(STUDY + "  objectives: [gain_at_180, gain_margin_db]\n")
    code, out, err = run(tmp_path / "s.yaml", "-n", 16, "-o", tmp_path / "b", "--json")
    found = json.loads(out)["objectives"]
    slope = found["gain_at_180"]["slopes"]["inceptor.gearing_rad_per_m"]  # proportional to the gearing
    assert slope == pytest.approx(10 ** (-found["gain_margin_db"]["nominal"] / 20) / 1.1, rel=1e-6)
    assert found["gain_at_180"]["indices"]["numbers"]["pilot_damping"]["total"] > 0.0


def test_one_method_at_a_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for options in (("--anova", "--surrogate"), ("--method", "morris", "--anova")):
        with pytest.raises(SystemExit):
            main(["sensitivity", "s.yaml", "-n", "16", *options, "-o", str(tmp_path / "a")])
        assert "not allowed with argument" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ("{variables: {pilot.strength: [1, 2]}}", "is not a number or word of a study"),
        ("{variables: {pilot.strength_factor: [0.8, 20]}}", "is outside 0.1 to 10"),
        ("{variables: {mass_kg: [60, 90]}}", "does not go with nominal.bmi"),
        ("{variables: {}}", "is empty"),
        ("{objectives: [gain]}", "is not known"),
    ],
)
def test_mistakes(section: str, said: str) -> None:
    message = message_of(f"{MULTIBODY}sensitivity: {section}\n")
    assert said in message and message.startswith("s.yaml:18")
