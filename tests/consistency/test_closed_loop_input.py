"""What the commands of a closed loop refuse, each in one sentence: rotorcraft without equations or stability, kicks.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pilotgen.cli import main
from pilotgen.closed_loop.deck import ClosedLoop, close_in_deck
from pilotgen.closed_loop.reach import check_kick, check_reach
from pilotgen.closed_loop.simulate import disturbance, simulate
from pilotgen.context import EvaluationContext
from pilotgen.errors import PilotgenError
from pilotgen.loop.rotorcraft_model import rotorcraft_model
from pilotgen.study.rotorcraft import load_rotorcraft
from pilotgen.study.study import read_study

QUICK = Path(__file__).parents[2] / "docs" / "studies" / "quick.yaml"
STUDY = """study: mine
rotorcraft: {%s}
inceptor: {lever_length_m: 0.32, gearing_rad_per_m: 1.1}
pilot: {model: multibody, sex: male, task: position, limbs: [left], washout_rad_s: 3.10}
nominal: {age_years: 40, bmi: 24, stature_m: 1.775}
search: {variables: {stature_m: [1.6, 1.9]}, population: 4, generations: 1}
limits: {gain_margin_db: null, phase_margin_deg: null}
"""


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two study files in tmp_path, one of a measured rotorcraft and one of an unstable one; the tests run below."""
    f = np.geomspace(0.05, 40.0, 300)
    H = rotorcraft_model(load_rotorcraft("iar330-puma")).response(2.0 * np.pi * f)
    said = ["input_unit: rad", "output_unit: m/s^2", "output_positive: up", "unstable_poles: 0", "poles_at_origin: 0"]
    rows = [f"{hz:.9g},{h.real:.12g},{h.imag:.12g}" for hz, h in zip(f, H, strict=True)]
    (tmp_path / "measured.csv").write_text("\n".join([*(f"# {s}" for s in said), "frequency_hz,real,imag", *rows]))
    plant = {"num": [-100.0, 0.0, 0.0], "den": [1.0, -0.3, 1.0]}
    units = {"input_unit": "rad", "output_unit": "m/s^2", "output_positive": "up"}
    (tmp_path / "unstable.json").write_text(json.dumps({**plant, **units}))
    (tmp_path / "measured.yaml").write_text(STUDY % "frequency_response: measured.csv")
    (tmp_path / "unstable.yaml").write_text(STUDY % "transfer_function: unstable.json")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    return tmp_path


@pytest.mark.parametrize("command", ["loop", "simulate", "limit-cycles"])
def test_a_measured_rotorcraft_has_no_deck(elsewhere: Path, capsys: pytest.CaptureFixture[str], command: str) -> None:
    assert main([command, "../measured.yaml", "-o", "out"]) == 1
    told = capsys.readouterr().err
    assert told.startswith("pilotgen: error: ../measured.yaml: rotorcraft.frequency_response = ")
    assert "a response has no equations for a deck; give rotorcraft.state_space" in told and told.count("\n") == 1
    assert not Path("out").exists()  # refused before anything is touched


def test_cures_of_a_measured_rotorcraft_are_not_kicked(elsewhere: Path) -> None:
    assert main(["cures", "../measured.yaml", "-o", "out", "--only", "gearing", "--no-figures", "--quiet"]) == 0
    found = json.loads(Path("out/cures.json").read_text())
    assert "a response has no equations for a deck" in found["simulation"]["reason"]
    gain = found["cures"][0]["margins"]["nominal"]["gain_margin_db"]
    assert gain[-1] - gain[0] == pytest.approx(-20.0 * np.log10(0.75), abs=1e-3)


def test_an_unstable_rotorcraft(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pole = "unstable.yaml: the rotorcraft is unstable by itself: a pole at +0.15 1/s, 0.157 Hz; "
    for arguments, wanted in (
        (["limit-cycles"], "a lever that friction holds cuts the loop, so that no swing of it dies"),
        (["simulate", "--kicks", "3"], "every kick of such a loop goes on"),
    ):
        assert main([arguments[0], "../unstable.yaml", "-o", arguments[0], *arguments[1:]]) == 1
        told = capsys.readouterr().err
        assert pole + wanted in told and told.count("\n") == 1
        assert not Path(arguments[0]).exists()  # refused before any pilot is solved
    assert main(["cures", "../unstable.yaml", "-o", "cures"]) == 1
    assert "unstable by itself: a pole at +0.15 1/s, 0.157 Hz; no pilot of it has a margin" in capsys.readouterr().err
    assert not Path("cures").exists()
    text = (elsewhere / "measured.csv").read_text()
    (elsewhere / "measured.csv").write_text(text.replace("unstable_poles: 0", "unstable_poles: 2"))
    assert main(["cures", "../measured.yaml", "-o", "cures"]) == 1
    assert "measured.csv says unstable_poles: 2" in capsys.readouterr().err


def test_what_an_unstable_rotorcraft_does_is_told_as_its_own(
    elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["../unstable.yaml", "-o", "moved", "--duration", "1.5", "--size", "2", "--no-figures"]
    assert main(["simulate", *arguments]) == 0
    out, err = capsys.readouterr()
    assert "is the rotorcraft's own, unstable by itself" in out and "note: the open loop is unstable" in err
    found = json.loads(Path("moved/simulation.json").read_text())
    assert found["goes_on"] is None and found["open_loop"].startswith("the open loop is unstable: the rotorcraft")
    assert main(["loop", "../unstable.yaml", "-o", "loop"]) == 0  # poles are poles
    assert json.loads(Path("loop/loop.json").read_text())["unstable_open_loop_poles"] == 2


@pytest.mark.parametrize(
    ("settings", "wanted"),
    [
        (["rotorcraft.notch.frequency_hz=-3"], "rotorcraft.notch.frequency_hz=-3 is outside 0.1 to 50 Hz"),
        (["rotorcraft.low_pass.frequency_hz=0"], "rotorcraft.low_pass.frequency_hz=0 is outside 0.1 to 50 Hz"),
        (["rotorcraft.actuator.corner_rad_s=-5"], "rotorcraft.actuator.corner_rad_s=-5 is outside 1 to 1000 rad/s"),
        (["rotorcraft.delay_s=-0.1"], "rotorcraft.delay_s=-0.1 is outside 0 to 0.2 s"),
        (["inceptor.friction.breakout_n=-4"], "inceptor.friction.breakout_n=-4 is outside 0 to 500 N"),
        (["inceptor.friction.stribeck_n=4"], "needs inceptor.friction.breakout_n as well"),
        (["inceptor.friction.breakout_n=4", "inceptor.friction.stribeck_n=4"], "leaves nothing of breakout_n = 4 N"),
        (["pilot.washout_rad_s=-1"], "pilot.washout_rad_s=-1 is outside 0.01 to 100 rad/s"),
    ],
)
@pytest.mark.parametrize("command", ["loop", "simulate", "limit-cycles"])
def test_numbers_that_no_filter_or_friction_has(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str, settings: list[str], wanted: str
) -> None:
    assert main([command, str(QUICK), "-o", str(tmp_path / "out"), "--set", *settings]) == 1
    told = capsys.readouterr().err
    assert wanted in told and told.count("\n") == 1 and not (tmp_path / "out").exists()


# ---- kicks beyond the stops


@pytest.fixture(scope="module")
def context() -> Iterator[EvaluationContext]:
    with EvaluationContext(read_study(QUICK)) as context:
        yield context


@pytest.fixture(scope="module")
def loop(context: EvaluationContext) -> ClosedLoop:
    return close_in_deck(context, context.study.nominal)


@pytest.mark.parametrize(("size", "most"), [(0.3, "0.112 m is the most"), (-0.2, "-0.112 m is the most")])
def test_a_pull_beyond_a_stop_is_always_refused(loop: ClosedLoop, size: float, most: str) -> None:
    with pytest.raises(PilotgenError, match=f"wants the lever beyond its stops, .*; {most}"):
        check_kick(loop, "pull", size)
    check_kick(loop, "pull", 0.5 * 0.112 * np.sign(size))


@pytest.mark.parametrize(("kind", "size"), [("lever", 200.0), ("lever", -300.0), ("gust", 200.0), ("gust", -200.0)])
def test_a_kick_onto_a_stop_is_refused_with_the_largest_that_is_none(
    context: EvaluationContext, loop: ClosedLoop, kind: str, size: float
) -> None:
    with pytest.raises(PilotgenError, match=r"throws the lever on a stop while it still acts; up to") as raised:
        check_reach(context, loop, kind, size, None)
    most = float(str(raised.value).split("up to ")[1].split()[0])
    assert 0.0 < most / size < 1.0
    check_reach(context, loop, kind, most, None)  # as it says
    motion = simulate(context, loop, disturbance(kind, 1.1 * most), 0.7)
    assert motion.hits_stop  # and not much less than what is too much


def test_turbulence_pulls_and_levers_that_rest_on_a_stop_are_not_asked(context: EvaluationContext) -> None:
    low = close_in_deck(context, {**context.study.nominal, "inceptor.position": 0.0})
    check_reach(context, low, "turbulence", 50.0, None)
    check_reach(context, low, "pull", 0.2, None)
    check_reach(context, low, "lever", 10.0, None)


def test_through_stops(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    kicked = ["simulate", str(QUICK), "--kick", "lever", "--size", "300", "--duration", "1", "--no-figures"]
    assert main([*kicked, "-o", str(tmp_path / "one")]) == 1
    assert "--through-stops if that is meant" in capsys.readouterr().err
    assert main([*kicked, "-o", str(tmp_path / "two"), "--through-stops"]) == 0
    assert "meets a stop" in capsys.readouterr().out
    assert main([*kicked, "-o", str(tmp_path / "three"), "--linear"]) == 0
    assert "of which --linear has none" in capsys.readouterr().out
    for more, wanted in (
        (["--through-stops", "--linear"], "--through-stops would do nothing: --linear has no stops"),
        (["--through-stops", "--kick", "pull", "--size", "0.01"], "the kind pull is never refused for that"),
        (["--seed", "3"], "--seed would do nothing: a single kick has nothing random"),
        (["--duration", "1e9"], "--duration 1e+09: at most 1000 s"),
        (["--duration", "1e-9"], "--duration 1e-09: at least 0.2 s are wanted"),
        (["--size", "0"], "--size 0: a kick above or below zero is wanted"),
        (["--size", "-20", "--kicks", "2"], "a root mean square above zero is wanted"),
        (["--kick", "turbulence", "--size", "-1"], "a root mean square above zero is wanted"),
    ):
        assert main([*kicked, "-o", str(tmp_path / "four"), *more]) == 1
        assert wanted in capsys.readouterr().err
