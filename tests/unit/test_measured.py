"""Measured rotorcraft: the Puma through its own frequency response; files of others, handled or refused by line.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pilotgen import api
from pilotgen.cli import main
from pilotgen.context import EvaluationContext
from pilotgen.errors import FileError, PilotgenError, StudyError
from pilotgen.evaluation import Evaluation, FailedEvaluation, evaluate
from pilotgen.linear.feedthrough import mayo_pilot
from pilotgen.linear.statespace import StateSpaceModel
from pilotgen.loop.frequency_file import read_frequency_response
from pilotgen.loop.heave_model import HeaveModel
from pilotgen.loop.loop import LoopModel
from pilotgen.loop.margins import margins
from pilotgen.loop.measured import measured_margins
from pilotgen.loop.rotorcraft_model import MeasuredRotorcraft
from pilotgen.study.rotorcraft import load_rotorcraft
from pilotgen.study.study import read_study

PUMA = HeaveModel(load_rotorcraft("iar330-puma"))
SAID = {
    "input_unit": "rad",
    "output_unit": "m/s^2",
    "output_positive": "up",
    "unstable_poles": "0",
    "poles_at_origin": "0",
}


def write(path: Path, rows: str, header: str = "frequency_hz,real,imag", **said: str | None) -> Path:
    words = SAID | said
    lines = [f"# {key}: {value}" for key, value in words.items() if value is not None]
    path.write_text("\n".join([*lines, header, rows]) + "\n", encoding="utf-8")
    return path


def puma_rows(hz: np.ndarray, separator: str = ",", factor: float = 1.0) -> str:
    H = factor * PUMA.response(2.0 * np.pi * hz)
    return "\n".join(separator.join(f"{value:.17g}" for value in row) for row in zip(hz, H.real, H.imag, strict=True))


HZ = np.geomspace(0.02, 40.0, 300)


@pytest.mark.parametrize("numbers", [(3.750, 0.28, 0.107), (3.380, 0.32, 0.117), (2.5, 0.20, 0.06), (2.5, 0.35, 0.06)])
def test_the_puma_through_its_response(tmp_path: Path, numbers: tuple[float, float, float]) -> None:
    """Margins as of the built-in Puma, within the interpolation error that is told."""
    plant = read_frequency_response(write(tmp_path / "puma.csv", puma_rows(HZ)))
    pilot = mayo_pilot(*numbers, 0.32)
    A, B, C, D = pilot.state_space()
    expected = margins(LoopModel(StateSpaceModel(A, B[:, 0], C[0], float(D[0, 0])), PUMA, 1.1, 0.32))
    found, answer = measured_margins(pilot, MeasuredRotorcraft(plant), 1.1 * 0.32)
    assert found.stable is expected.stable, answer.reason
    assert plant.interpolation_error < 1e-5
    for key in ("gain_margin_db", "phase_margin_deg", "modulus_margin", "disk_margin"):
        assert getattr(found, key) == pytest.approx(getattr(expected, key), rel=1e-4), key
    omega = 2.0 * np.pi * np.linspace(0.03, 30.0, 500)
    error = np.abs(plant.at(omega) - PUMA.response(omega)).max() / np.abs(plant.H).max()
    assert error < 10.0 * plant.interpolation_error
    assert (np.abs(plant.at(omega) - PUMA.response(omega)) <= plant.error_at(omega)).all()
    with pytest.raises(PilotgenError, match=r"puma\.csv: 100 Hz is outside the data, 0.02 to 40 Hz"):
        plant.at([2.0 * np.pi * 100.0])


def test_every_way_of_writing_it(tmp_path: Path) -> None:
    H = PUMA.response(2.0 * np.pi * HZ)
    order = np.random.default_rng(0).permutation(len(HZ))
    columns = {
        "omega_rad_s,real,imag": (2.0 * np.pi * HZ, H.real, H.imag),
        "frequency_hz;magnitude;phase_deg": (HZ, np.abs(H), np.degrees(np.angle(H))),
        "frequency_hz\tmagnitude_db\tphase_rad": (HZ, 20.0 * np.log10(np.abs(H)), np.angle(H)),
        '"Frequency_Hz", "magnitude", "phase_deg", "coherence"': (
            HZ,
            np.abs(H),
            np.degrees(np.angle(H)),
            0.9 + 0.0 * HZ,
        ),
    }
    for header, values in columns.items():
        separator = ";" if ";" in header else "\t" if "\t" in header else ","
        rows = "\n".join(separator.join(f"{value:.17g}" for value in row) for row in np.column_stack(values)[order])
        path = write(tmp_path / "a.csv", rows, header)
        path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
        plant = read_frequency_response(path)
        assert_allclose(plant.omega, 2.0 * np.pi * HZ, rtol=1e-12)
        assert_allclose(plant.H, H, rtol=1e-9)
    path = write(
        tmp_path / "b.csv",
        puma_rows(HZ, factor=-np.pi / 180.0 / 9.80665),
        input_unit="deg",
        output_unit="g",
        output_positive="down",
    )
    assert_allclose(read_frequency_response(path).H, H, rtol=1e-9)


def test_many_rows(tmp_path: Path) -> None:
    hz = np.geomspace(0.02, 40.0, 100_000)
    plant = read_frequency_response(write(tmp_path / "long.csv", "\n".join(f"{f:.9g},{f:.6g},-1" for f in hz.tolist())))
    assert len(plant.omega) == len(hz)
    assert plant.H[-1] == pytest.approx(40.0 - 1.0j)
    thin = plant.thinned(500)  # for a page
    assert len(thin.omega) == 500 and thin.band_hz == pytest.approx(plant.band_hz)
    assert thin.H == pytest.approx(plant.at(thin.omega)) and plant.thinned(10**6) is plant


ROWS, PARTS = puma_rows(HZ[:10]), "frequency_hz,real,imag"


@pytest.mark.parametrize(
    ("rows", "header", "said", "message"),
    [
        (ROWS, PARTS, {"input_unit": None}, "input_unit is missing; write a line '# input_unit: ...'"),
        (ROWS, PARTS, {"output_unit": "m/s"}, "output_unit = 'm/s' is not known"),
        (ROWS, PARTS, {"output_positive": None}, "output_positive is missing"),
        (ROWS, PARTS, {"unstable_poles": None}, "unstable_poles is missing"),
        (ROWS, PARTS, {"unstable_poles": "-1"}, "unstable_poles = '-1' is no whole number"),
        (ROWS, "f,real,imag", {}, r"a\.csv:6: column 'f' is not known"),
        (ROWS, "frequency_hz,real,real", {}, "a column stands twice"),
        (ROWS, "magnitude,real,imag", {}, "exactly one of frequency_hz, omega_rad_s"),
        (ROWS, "frequency_hz,real,phase_deg", {}, "values are real, phase_deg; wanted are real and imag or"),
        (ROWS, "0.1,1.0,2.0", {}, r"a\.csv:6: numbers where column names are wanted"),
        (ROWS.replace("\n", "\nnan,1,2\n", 1), PARTS, {}, r"a\.csv:8: frequency_hz = nan is not finite"),
        (ROWS.replace("\n", "\n0.5,x,2\n", 1), PARTS, {}, r"a\.csv:8: real = 'x' is no number"),
        (ROWS.replace("\n", "\n0.5,1\n", 1), PARTS, {}, r"a\.csv:8: 2 values where 3 columns"),
        (ROWS.replace("\n", "\n0,5,1,5,2,5\n", 1), PARTS, {}, "decimal commas"),
        (ROWS.replace(",", ";").replace("\n", "\n0,5;1;2\n", 1), "frequency_hz;real;imag", {}, "decimal point is a"),
        (ROWS + "\n" + ROWS.splitlines()[3], PARTS, {}, r"a\.csv:17: the frequency of line 10 once more"),
        (ROWS + "\n0,1,1", PARTS, {}, r"a\.csv:17: frequency 0; frequencies start above zero"),
        (ROWS + "\n1,-1,1", "frequency_hz,magnitude,phase_deg", {}, "magnitude holds a negative number"),
        (ROWS.replace("-", "") + "\n1,1,400", "frequency_hz,magnitude,phase_rad", {}, "degrees are called phase_deg"),
        ("1,2,3", PARTS, {}, "1 rows follow; 8 or more"),
    ],
)  # fmt: skip
def test_hostile_files(tmp_path: Path, rows: str, header: str, said: dict[str, str | None], message: str) -> None:
    path = write(tmp_path / "a.csv", rows, header, **said)
    with pytest.raises(FileError, match=message):
        read_frequency_response(path)


def test_files_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00\x01")
    (tmp_path / "empty.csv").write_bytes(b"")
    for name, message in (
        ("binary.csv", "not UTF-8 text"),
        ("empty.csv", "no line with column names"),
        ("no.csv", "cannot be read"),
    ):
        with pytest.raises(FileError, match=message):
            read_frequency_response(tmp_path / name)


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mayo_pilot(3.75, 0.28, 0.107, 0.32).write(tmp_path / "pilot_model.h5")
    file = str(write(tmp_path / "puma.csv", puma_rows(HZ)))
    assert main(["loops", str(tmp_path), "--plant", file, "--gearing", "collective=1.1", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["stable"] is True and data["gain_margin_db"] == pytest.approx(6.36, abs=0.01)
    assert data["plant_interpolation_error"] < 1e-5
    assert main(["loops", str(tmp_path), "--plant", file, "--gearing", "lateral=1.1"]) == 1
    assert "a measured rotorcraft has heave by collective" in capsys.readouterr().err


# ---- as the rotorcraft of a study

STUDY = """study: measured
rotorcraft: {rotorcraft}
inceptor: {{gearing_rad_per_m: 1.1, lever_length_m: 0.32}}
pilot: {{model: mayo}}
nominal: {{pilot_frequency_hz: 3.75, pilot_damping: 0.28, pilot_time_constant_s: 0.107}}
search:
  variables: {{pilot_damping: [0.2, 0.5], inceptor.gearing_rad_per_m: [0.9, 1.3]}}
  population: 8
  generations: 2
"""


def studied(directory: Path, rotorcraft: str, **values: float) -> Evaluation | FailedEvaluation:
    (directory / "study.yaml").write_text(STUDY.format(rotorcraft=rotorcraft))
    study = read_study(directory / "study.yaml")
    with EvaluationContext(study) as context:
        return evaluate(context, {**study.nominal, **values})


@pytest.mark.parametrize("points", [40, 300])
@pytest.mark.parametrize("chain", ["", "delay_s: 0.02, actuator: {corner_rad_s: 40}"])
def test_a_study_through_a_response_is_the_built_in_puma(tmp_path: Path, points: int, chain: str) -> None:
    """Every margin within the error that the result tells; pilots with and without a phase margin, an unstable one."""
    write(tmp_path / "puma.csv", puma_rows(np.geomspace(0.02, 40.0, points)))
    numbers = {key: value for key, value in load_rotorcraft("iar330-puma").given().items() if key != "source"}
    own = "{" + ", ".join(f"{key}: {value}" for key, value in numbers.items()) + (f", {chain}" if chain else "") + "}"
    for hz, damping, tau in ((3.75, 0.28, 0.107), (2.5, 0.35, 0.06), (2.5, 0.20, 0.06)):
        values = {"pilot_frequency_hz": hz, "pilot_damping": damping, "pilot_time_constant_s": tau}
        expected = studied(tmp_path, own, **values)
        found = studied(tmp_path, "{frequency_response: puma.csv" + (f", {chain}" if chain else "") + "}", **values)
        assert isinstance(found, Evaluation) and isinstance(expected, Evaluation), found.result.get("reason")
        told, errors = found.result["loop"], found.result["loop"]["interpolation_error"]
        assert told["stable"] is expected.result["loop"]["stable"]
        for key in ("gain_margin_db", "phase_margin_deg", "modulus_margin", "disk_margin"):
            value = expected.result["loop"][key]
            assert (told[key] is None) == (value is None)
            if value is not None and (told["stable"] or key != "disk_margin"):
                assert abs(told[key] - value) <= errors[key] + 1e-6 * abs(value), (key, points)
                assert errors[key] < (0.5 if points == 40 else 1e-3)


def test_what_a_measured_rotorcraft_has_not(tmp_path: Path) -> None:
    write(tmp_path / "puma.csv", puma_rows(HZ))
    found = studied(tmp_path, "{frequency_response: puma.csv}")
    assert isinstance(found, Evaluation)
    pilot = api.evaluate(read_study(tmp_path / "study.yaml"))
    assert any("poles of the closed loop cannot be told" in sentence for sentence in pilot.caveats)
    for closed in (pilot.open_loop, pilot.closed_loop, lambda: found.loop.closed_loop_poles):
        with pytest.raises(PilotgenError, match=r"puma\.csv: .*frequency response only; it has no state space"):
            closed()
    with pytest.raises(PilotgenError, match="100 Hz is outside the data"):
        found.loop.response(2.0 * np.pi * 100.0)
    with pytest.raises(StudyError, match=r"rotorcraft\.sling .*means nothing beside a file"):
        studied(tmp_path, "{frequency_response: puma.csv, sling: {load_kg: 100, stiffness_n_per_m: 1e5}}")
    with pytest.raises(StudyError, match="and state_space exclude each other"):
        studied(tmp_path, "{frequency_response: puma.csv, state_space: puma.json}")


@pytest.mark.parametrize(
    ("band", "said", "reason"),
    [
        ((0.02, 3.0), {}, "at the highest frequency, 18.8496 rad/s, L = .* is not yet small; measure higher"),
        ((3.0, 40.0), {}, "at the lowest frequency, 18.8496 rad/s, L = .* is not where a loop with 0 poles"),
        ((0.02, 40.0), {"unstable_poles": "1"}, ""),
    ],
)
def test_bands_and_counts(tmp_path: Path, band: tuple[float, float], said: dict[str, str], reason: str) -> None:
    """A band that does not hold the loop leaves it without a verdict, by name; the count of unstable poles counts."""
    write(tmp_path / "puma.csv", puma_rows(np.geomspace(*band, 200)), **said)
    found = studied(tmp_path, "{frequency_response: puma.csv}")
    if reason:
        assert isinstance(found, FailedEvaluation) and found.stage == "margins"
        assert re.search(reason, found.reason), found.reason
    else:
        assert isinstance(found, Evaluation) and found.margins.stable is False


def test_a_search_and_its_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path / "puma.csv", puma_rows(HZ))
    (tmp_path / "study.yaml").write_text(STUDY.format(rotorcraft="{frequency_response: puma.csv}"))
    before = read_study(tmp_path / "study.yaml").canonical()
    assert main(["search", str(tmp_path / "study.yaml"), "-o", str(tmp_path / "out"), "--workers", "1"]) == 0
    assert "16 evaluations" in capsys.readouterr().out
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "by interpolation gain margin" in page
    write(tmp_path / "puma.csv", puma_rows(HZ, factor=1.01))
    assert read_study(tmp_path / "study.yaml").canonical() != before
