"""Roll by the lateral cyclic: the plants, the loop of a study, what it is called, what is refused.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pilotgen import api
from pilotgen.cli import main
from pilotgen.commands.pilot import summary
from pilotgen.context import EvaluationContext
from pilotgen.errors import FileError, PilotgenError, StudyError
from pilotgen.evaluation import Evaluation, evaluate
from pilotgen.figures.loop import bode, nyquist
from pilotgen.linear.full_order import full_order_response
from pilotgen.linear.imposed_motion import Channels, split
from pilotgen.loop.frequency_file import read_frequency_response
from pilotgen.loop.loop import heave_loop
from pilotgen.loop.plants import roll_rotorcraft
from pilotgen.loop.rotorcraft_model import roll_model, rotorcraft_model
from pilotgen.solver.matrices import descriptor, read_matrices
from pilotgen.study.loop_section import LoopSignals
from pilotgen.study.study import Study, read_study, study_from_text
from pilotgen.summary import caveats

STUDIES = Path(__file__).parents[2] / "docs" / "studies"
OMEGA = 2.0 * np.pi * np.geomspace(0.2, 8.0, 60)


@pytest.fixture(scope="module")
def study() -> Study:
    return read_study(STUDIES / "roll.yaml")


@pytest.fixture(scope="module")
def pilot(study: Study, tmp_path_factory: pytest.TempPathFactory, mbdae: Path) -> tuple[Evaluation, Path]:
    directory = tmp_path_factory.mktemp("roll")
    with EvaluationContext(study, mbdae=str(mbdae)) as context:
        found = evaluate(context, study.nominal, keep=directory)
    assert isinstance(found, Evaluation), found.result
    return found, directory


@pytest.mark.parametrize(
    ("name", "poles"),
    [
        ("oh58d", [7.4 * (-0.435 + 0.9j)]),  # 7.2-7.4 rad/s, damping 0.41-0.43
        ("uh60a", [-5.7, -8.1]),
        ("bo105", [11.3 * (-0.61 + 0.79j)]),
        ("lynx", [12.6 * (-0.54 + 0.84j)]),
    ],
)
def test_modes_of_the_bundled_plants(name: str, poles: list[complex]) -> None:
    """As computed elsewhere from the same numbers, and for the OH-58D as identified."""
    found = roll_rotorcraft()[name]
    assert found.roll is not None and ("derived" in found.source or "identified" in found.source)
    own = roll_model(found.roll).poles
    for pole in poles:
        assert np.abs(own - pole).min() < 0.02 * abs(pole)


def test_the_response_with_lag_and_delay() -> None:
    tau, flap = 0.0718, 128.8
    lag = {"pole_hz": 2.33, "pole_damping": 0.06, "zero_hz": 2.2, "zero_damping": 0.05}
    found = dataclasses.replace(
        roll_rotorcraft()["bo105"], roll={"time_constant_s": tau, "flap_1_s2": flap, "lag": lag}, delay_s=0.05
    )
    s = 1j * OMEGA
    top, bottom = (
        (s / (2.0 * np.pi * lag[f"{part}_hz"])) ** 2
        + 2.0 * lag[f"{part}_damping"] * s / (2.0 * np.pi * lag[f"{part}_hz"])
        + 1.0
        for part in ("zero", "pole")
    )
    expected = s * flap / tau * np.exp(-0.05 * s) / (s**2 + s / tau + flap) * top / bottom
    model = rotorcraft_model(found, "roll", "lateral")
    assert_allclose(model.response(OMEGA), expected, rtol=1e-10)
    assert_allclose(model.state_space.response(OMEGA), expected, rtol=1e-5)


def test_the_loop_is_that_of_the_full_order_model(pilot: tuple[Evaluation, Path], study: Study) -> None:
    """L = -G l (K_roll + h K_sway) P with K by full-order solves about the seat itself and the axis h below it."""
    found, directory = pilot
    model = descriptor(read_matrices(directory / "matrices.h5"))
    nodes = read_matrices(directory / "matrices.h5").nodes
    places = {bytes(name).decode(): x for name, x in zip(nodes.name, nodes.position, strict=True)}
    imposed = split(model, Channels(inputs=("roll", "sway")), places)
    output = imposed.outputs.index("cyclic_right")
    roll, sway = (full_order_response(imposed, OMEGA, output, k) for k in range(2))
    s = 1j * OMEGA
    washout = (s / (s + 3.1)) ** 2
    P = s * (46.3 / 0.0723) * np.exp(-0.05 * s) / (s**2 + s / 0.0723 + 46.3)
    expected = -1.099 * 0.55 * (roll + 0.6 * sway) * washout * P
    assert_allclose(found.loop.response(OMEGA), expected, rtol=1e-6)
    assert found.result["bdft"]["certificate"] < 1e-8
    at_3_hz = abs(0.55 * (roll + 0.6 * sway)[np.abs(OMEGA - 6.0 * np.pi).argmin()])
    assert found.result["bdft"]["grip_motion_3hz_mm_per_rad_s2"] == pytest.approx(1e3 * at_3_hz, rel=0.1)
    # the verdict, by the winding of 1 + L
    omega = 2.0 * np.pi * np.geomspace(0.01, 40.0, 20_000)
    turns = np.angle((1.0 + found.loop.response(omega))[1:] / (1.0 + found.loop.response(omega))[:-1]).sum()
    assert found.margins.stable is (round(turns / np.pi) == 0)


def test_everything_names_the_loop(pilot: tuple[Evaluation, Path], study: Study) -> None:
    found, _ = pilot
    result = found.result
    assert (result["loop"]["input"], result["loop"]["output"]) == ("roll", "lateral")
    text = summary({**result, "caveats": caveats(study, result)})
    assert "loop       roll by the lateral cyclic: " in text
    assert "mm of grip motion of the lateral cyclic per rad/s^2 at 3 Hz" in text
    assert "nobody has published a measured feedthrough of roll by the lateral cyclic" in text
    assert "heave" not in text and "collective" not in text and "Mayo" not in text
    figure = bode([("", found)])
    titles = [axes.get_title("left") for axes in figure.axes] + [figure.get_suptitle()]
    assert "feedthrough: seat roll → lateral cyclic grip (× poles)" in titles
    assert figure.get_suptitle().startswith("roll by the lateral cyclic: ")
    assert "rad/s²" in figure.axes[0].get_ylabel()
    assert "roll by the lateral cyclic" in nyquist([("", found)]).axes[0].get_title("left")


def test_signals_in_python(study: Study, mbdae: Path) -> None:
    pilot = api.evaluate(study, mbdae=str(mbdae))
    closed, opened = pilot.closed_loop(), pilot.open_loop()
    assert closed.input_labels == ["lateral_pitch_rad"]
    assert closed.output_labels == ["seat_roll_rad_s2", "cyclic_right_rad", "pilot_lateral_pitch_rad"]
    assert opened.input_labels == ["seat_roll_rad_s2"]
    L = complex(opened(2j * np.pi * 2.0))
    P = complex(pilot._evaluation.loop.helicopter.state_space.response(4.0 * np.pi))
    assert complex(closed(2j * np.pi * 2.0)[0, 0]) == pytest.approx(P / (1.0 + L), rel=1e-9)


def test_a_search_and_its_report(study: Study, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (STUDIES / "roll.yaml").read_text().replace("population: 36", "population: 4")
    (tmp_path / "roll.yaml").write_text(text.replace("generations: 8", "generations: 1"))
    assert main(["search", str(tmp_path / "roll.yaml"), "-o", str(tmp_path / "out"), "--workers", "1"]) == 0
    assert "worst pilots of roll by the lateral cyclic" in capsys.readouterr().out
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "at the lateral cyclic of the UH-60A in roll the closed loop" in page
    assert "motion of the grip of the lateral cyclic per acceleration of the seat in roll" in page
    assert "prone to bounce" not in page


def test_rolls_of_files(tmp_path: Path) -> None:
    """The same plant as transfer function and as frequency response, which say which loop they are of."""
    said = {"input_control": "lateral", "input_positive": "left", "input_unit": "deg", "output_motion": "roll",
            "output_positive": "right", "output_unit": "deg/s^2"}  # fmt: skip
    tau, flap = 0.0723, 46.3
    (tmp_path / "roll.json").write_text(json.dumps({"num": [-flap / tau, 0.0], "den": [1.0, 1.0 / tau, flap], **said}))
    base = (STUDIES / "roll.yaml").read_text()
    (tmp_path / "file.yaml").write_text(
        base.replace("rotorcraft: roll-uh60a", "rotorcraft: {transfer_function: roll.json}")
    )
    rotorcraft = read_study(tmp_path / "file.yaml").rotorcraft
    expected = roll_model({"time_constant_s": tau, "flap_1_s2": flap}).response(OMEGA)
    assert_allclose(rotorcraft_model(rotorcraft, "roll", "lateral").response(OMEGA), expected, rtol=1e-9)
    for motion, control, message in (
        ("heave", "collective", r"output_unit = 'deg/s\^2' is not known"),
        ("pitch", "lateral", "output_positive = 'right' is not known"),
        ("yaw", "lateral", "output_motion = 'roll'; the loop of the study is yaw by lateral"),
    ):
        with pytest.raises(FileError, match=message):
            rotorcraft_model(rotorcraft, motion, control)
    rows = [f"{w},{-H.real},{-H.imag}" for w, H in zip(OMEGA, expected, strict=True)]
    head = [f"# {key}: {value}" for key, value in {**said, "unstable_poles": 0, "poles_at_origin": 0}.items()]
    (tmp_path / "roll.csv").write_text("\n".join([*head, "omega_rad_s,real,imag", *rows]))
    assert_allclose(read_frequency_response(tmp_path / "roll.csv", "roll", "lateral").H, expected, rtol=1e-9)
    with pytest.raises(FileError, match="output_unit"):
        read_frequency_response(tmp_path / "roll.csv")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("rotorcraft: roll-uh60a", "rotorcraft: iar330-puma", "IAR 330 Puma' heaves by its collective"),
        ("  output: lateral", "", "loop .*has two ends; give input and output"),
        ("output: lateral ", "output: pedals ", "output = 'pedals' is not known"),
        ("output: lateral ", "output: collective ", "rolls, and the loop is roll by the collective"),
        ("limbs: [left, right]", "limbs: [left]", "lacks the right arm, which holds the cyclic"),
        ("washout_rad_s: 3.10", "projection: literal", "'literal' knows heave alone"),
        ("washout_rad_s: 3.10", "reflex_delay_s: 0.02", "is for heave by the collective"),
        ("rotorcraft: roll-uh60a", "rotorcraft: {roll: {time_constant_s: 0.07}}", "flap_1_s2"),
        ("rotorcraft: roll-uh60a", "rotorcraft: {roll: {time_constant_s: 0.07, flap_1_s2: 50}, mass_kg: 7000}",
         "mass_kg = 7000 means nothing beside rotorcraft.roll"),
        ("rotorcraft: roll-uh60a", "rotorcraft: {roll: {time_constant_s: 0.07, flap_1_s2: 50}, state_space: a.json}",
         "exclude each other"),
        ("rotorcraft: roll-uh60a",
         "rotorcraft: {roll: {time_constant_s: 0.07, flap_1_s2: 50}, inflow_lead_rad_s: 9}",
         "is of thrust, not of roll"),
        ("  input: roll  ", "  input: sway  ", "loop.point_m = .* means nothing for loop.input = 'sway'"),
    ],
)  # fmt: skip
def test_refusals(old: str, new: str, message: str) -> None:
    text = (STUDIES / "roll.yaml").read_text()
    assert old in text
    with pytest.raises(StudyError, match=message):
        study_from_text(text.replace(old, new))


def test_more_refusals(pilot: tuple[Evaluation, Path], study: Study, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(StudyError, match="Mayo's people moved in heave alone"):
        study_from_text((STUDIES / "puma-mayo.yaml").read_text().replace("rotorcraft: iar330-puma",
                        "rotorcraft: roll-uh60a\nloop: {input: roll, output: lateral}"))  # fmt: skip
    with pytest.raises(StudyError, match=r"loop.point_m = .*means nothing for loop.input = 'heave'"):
        study_from_text(
            (STUDIES / "quick.yaml").read_text() + "\nloop: {input: heave, output: collective, point_m: [0, 1, 0]}\n"
        )
    with pytest.raises(PilotgenError, match="this pilot has the inputs seat_roll_acceleration"):
        heave_loop(pilot[0].pilot_model, pilot[0].loop.helicopter, 1.1, 0.32)
    assert main(["identify", str(STUDIES / "roll.yaml"), "-o", "nowhere"]) == 1
    assert "identification is of heave by the collective" in capsys.readouterr().err


def test_numbers_of_the_loop_have_paths(study: Study) -> None:
    changed, _ = study.with_values({"loop.point_m[1]": -0.9, "rotorcraft.roll.flap_1_s2": 60.0})
    assert changed.loop == LoopSignals("roll", "lateral", [0.0, -0.9, 0.0]) and changed.canonical() != study.canonical()
    again = study_from_text(changed.with_own_text().text)
    assert again.loop == changed.loop and again.rotorcraft.roll == changed.rotorcraft.roll
    heave = read_study(STUDIES / "quick.yaml")
    assert heave.loop.usual and '"loop"' not in heave.canonical()
    lag = {f"rotorcraft.roll.lag.{key}": value for key, value in
           (("pole_hz", 3.15), ("pole_damping", 0.03), ("zero_hz", 3.0), ("zero_damping", 0.03))}  # fmt: skip
    with_lag, _ = study.with_values(lag)
    assert with_lag.rotorcraft.roll is not None and with_lag.rotorcraft.roll["lag"]["zero_hz"] == 3.0
    with pytest.raises(StudyError, match=r"rotorcraft\.roll\.lag"):
        study.with_values({"rotorcraft.roll.lag.pole_hz": 3.0})
