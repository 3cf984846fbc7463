"""Virtual tests, taken apart: drives, the estimators on systems of known response, files, table, figure, command line.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest

from pilotgen.cli import main
from pilotgen.context import EvaluationContext
from pilotgen.errors import FileError, MatrixError
from pilotgen.study.study import read_study
from pilotgen.virtual.identify import Identification, identify, report, write_identification
from pilotgen.virtual.virtual_test import (
    RAMP_S,
    Motion,
    harmonic_test,
    multisine_drive,
    random_test,
    read_motion,
    sine_drive,
    smooth,
)

STUDY = Path(__file__).parents[2] / "docs" / "studies" / "puma-bmi.yaml"
W0, XI = 2.0 * math.pi * 3.5, 0.3  # of a made-up pilot
NUMBER = r"[-+0-9.e]+"


def displacement(drive: str, time: np.ndarray) -> np.ndarray:
    """The seat's motion as MBDyn would make it from a drive of ours, read back from its text."""
    ramp = re.match(rf"mult, cosine, 0\., pi/({NUMBER}), 0\.5, half, 0\., (.*)$", drive, re.DOTALL)
    assert ramp is not None
    grow = np.where(time < float(ramp[1]), 0.5 * (1.0 - np.cos(np.pi * time / float(ramp[1]))), 1.0)
    total = np.zeros_like(time)
    sines = re.findall(rf"sine, ({NUMBER}), ({NUMBER}), ({NUMBER}), forever, 0\.", ramp[2])
    if ramp[2].startswith("array"):
        assert ramp[2].startswith(f"array, {len(sines)},")
    for start, omega, amplitude in sines:
        assert float(start) <= 0.0
        total += float(amplitude) * np.sin(float(omega) * (time - float(start)))
    return grow * total


class Oscillator:
    """phi'' + 2 xi w phi' + w^2 phi = gain zddot (+ quadratic zddot^2), integrated without the solver."""

    def __init__(self, quadratic: float = 0.0, delay_of_rest_s: float = 0.0) -> None:
        self.quadratic = quadratic
        self.calls: list[float] = []

    def simulate(self, drive, final_time_s, time_step_s, activation_check=False, name=""):  # type: ignore[no-untyped-def]
        from scipy.signal import StateSpace, lsim

        self.calls.append(final_time_s)
        rows = round(final_time_s / time_step_s) + 1
        fine = 8
        time = np.arange((rows - 1) * fine + 1) * time_step_s / fine
        z = displacement(drive, time)
        h = time[1]
        zdd = np.gradient(np.gradient(z, h, edge_order=2), h, edge_order=2)
        force = -2.0 * (zdd + self.quadratic * zdd**2)
        system = StateSpace([[0.0, 1.0], [-(W0**2), -2.0 * XI * W0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
        _, y, _ = lsim(system, force, time)
        return Motion(time[::fine], z[::fine], np.asarray(y)[::fine])


def response(frequency_hz: float | np.ndarray) -> complex | np.ndarray:
    s = 2j * np.pi * np.asarray(frequency_hz)
    return -2.0 / (s**2 + 2.0 * XI * W0 * s + W0**2)


# ---- drives


@pytest.mark.parametrize("phase", [0.0, 0.4, 3.0, 3.3, 6.0, 7.0])
def test_a_sine_has_the_phase_that_was_asked_for(phase: float) -> None:
    time = np.linspace(RAMP_S, RAMP_S + 2.0, 4001)
    z = displacement(smooth(sine_drive(2.5, 0.7, phase)), time)
    w = 2.0 * math.pi * 2.5
    assert z == pytest.approx(0.7 / w**2 * np.sin(w * time + phase), abs=1e-12)


def test_the_seat_starts_at_rest() -> None:
    drive = smooth(multisine_drive(np.array([1.0, 4.0]), np.array([1.0, 2.0]), np.array([1.0, 2.0])))
    time = np.array([0.0, 1e-5, 2e-5])
    z = displacement(drive, time)
    assert z[0] == 0.0 and abs(z[1] / 1e-5) < 1e-5
    assert drive.count("sine,") == 2 + 1  # two sines, and the cosine of the ramp


# ---- estimators


def test_the_sine_test_finds_a_known_response() -> None:
    for frequency in (1.0, 3.5, 7.3):
        point = harmonic_test(Oscillator(), frequency, 0.4)  # type: ignore[arg-type]
        assert point.settled and point.scatter <= 1e-4
        assert point.response == pytest.approx(response(frequency), rel=2e-3)
        assert point.amplitude_m_s2 == pytest.approx(0.4, rel=1e-9)
        assert max(point.harmonics) < 1e-3


def test_a_slow_pilot_is_shaken_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(f"{__name__}.XI", 0.02)  # 1 / (xi w) = 2.3 s
    slow = Oscillator()
    point = harmonic_test(slow, 3.0, 0.1)  # type: ignore[arg-type]
    assert point.settled and len(slow.calls) > 1 and slow.calls[-1] > slow.calls[0]
    cut_short = harmonic_test(Oscillator(), 3.0, 0.1, longest_s=4.0)  # type: ignore[arg-type]
    assert not cut_short.settled and cut_short.scatter > 1e-4 and cut_short.simulated_s <= 4.0


def test_harmonics_of_a_square_law() -> None:
    """zddot + q zddot^2: the second harmonic is q A / 2 times the ratio of the responses at 2 w and w."""
    q, A, f = 0.3, 0.5, 2.0
    point = harmonic_test(Oscillator(quadratic=q), f, A)  # type: ignore[arg-type]
    wanted = 0.5 * q * A * abs(response(2.0 * f) / response(f))
    assert point.harmonics[0] == pytest.approx(wanted, rel=5e-3)
    assert abs(point.drift) == pytest.approx(0.5 * q * A * abs(response(0.0) / response(f)), rel=5e-3)


def test_the_random_test_finds_a_known_response() -> None:
    estimate = random_test(Oscillator(), 0.3, duration_s=16.0)  # type: ignore[arg-type]
    assert estimate.realisations == 2
    assert estimate.frequency_hz[0] == 1.0 and estimate.frequency_hz[-1] == 10.0
    assert np.abs(estimate.response / response(estimate.frequency_hz) - 1.0).max() < 5e-3
    assert estimate.coherence.min() > 1.0 - 1e-6
    assert estimate.rms_m_s2 == pytest.approx(0.3 / math.sqrt(2.0), rel=1e-6)


def test_coherence_tells_what_is_not_linear() -> None:
    mild = random_test(Oscillator(quadratic=0.5), 0.3, duration_s=32.0)  # type: ignore[arg-type]
    strong = random_test(Oscillator(quadratic=0.5), 1.2, duration_s=32.0)  # type: ignore[arg-type]
    assert strong.coherence.mean() < mild.coherence.mean() < 1.0 - 1e-6


def test_the_same_seed_gives_the_same_motion() -> None:
    one, two, other = (random_test(Oscillator(0.1), 0.3, 16.0, seed=seed) for seed in (3, 3, 4))  # type: ignore[arg-type]
    assert np.array_equal(one.response, two.response)
    assert not np.array_equal(one.response, other.response)


# ---- files


def test_motion_files_are_checked(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"no\.h5"):
        read_motion(tmp_path / "no.h5", ["seat.y"])
    path = tmp_path / "motion.h5"
    with h5py.File(path, "w") as file:
        file.attrs["filetype"] = np.bytes_("something else")
    with pytest.raises(MatrixError, match="something else"):
        read_motion(path, ["seat.y", "lever.gz"])
    with h5py.File(path, "w") as file:
        file.attrs["filetype"] = np.bytes_("pilotgen motion")
        file.attrs["version"] = np.array([1, 0])
        file["time"], file["data"] = np.zeros(2), np.zeros((2, 1))
        file["channels/name"] = np.array(["seat.y"], "S")
    with pytest.raises(MatrixError, match=r"lever\.gz"):
        read_motion(path, ["seat.y", "lever.gz"])


# ---- one pilot, small


@pytest.fixture(scope="module")
def found(mbdae: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Identification]:
    study = read_study(STUDY)
    seen: list[tuple[int, int]] = []
    with EvaluationContext(study, mbdae=str(mbdae)) as context:
        yield identify(
            context,
            study.nominal,
            methods=("direct", "harmonic"),
            amplitudes_m_s2=(0.05, 3.0),
            frequencies_hz=(3.0, 6.0),
            progress=lambda _, done, total: seen.append((done, total)),
            keep=tmp_path_factory.mktemp("kept"),
        )
    assert seen == [(0, 4), (1, 4), (2, 4), (3, 4)]


def test_tables_tell_methods_times_and_differences(found: Identification) -> None:
    text = report(found)
    assert "harmonic 0.05 m/s^2" in text and "harmonic 3 m/s^2" in text
    assert re.search(r"^direct +[0-9.]+ s$", text, re.MULTILINE)
    assert re.search(r"linearisation hides \(geometry and muscle curves\): harmonic 3 m/s\^2 gives", text)
    assert "harmonics up to" in text


def test_results_as_json_and_hdf5(found: Identification, tmp_path: Path) -> None:
    data = json.loads(json.dumps(found.as_dict(), allow_nan=False))
    assert [test["amplitude_m_s2"] for test in data["tests"]] == [0.05, 3.0]
    assert data["tests"][0]["ratio_to_direct"] == pytest.approx([1.0, 1.0], abs=1e-3)
    write_identification(found, tmp_path / "results.h5")
    with h5py.File(tmp_path / "results.h5") as file:
        assert bytes(file.attrs["filetype"]) == b"pilotgen identification"
        assert file["tests/1/response"][()] == pytest.approx(found.runs[1].response)
        assert file["direct/response"][()] == pytest.approx(found.direct([3.0, 6.0]))
    with pytest.raises(FileError):
        write_identification(found, tmp_path / "missing" / "results.h5")


def test_the_figure_shows_every_test(found: Identification) -> None:
    from pilotgen.figures.identification import identification
    from pilotgen.figures.style import png

    figure = identification(found)
    magnitude = figure.axes[0]
    labels = [line.get_label() for line in magnitude.get_lines()]
    assert labels == ["direct", "harmonic 0.05 m/s²", "harmonic 3 m/s²"]
    drawn = np.asarray(magnitude.get_lines()[1].get_ydata())
    assert drawn == pytest.approx(320.0 * np.abs(found.runs[0].response))
    assert png(figure).startswith(b"\x89PNG")


# ---- command line


def test_the_command(mbdae: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "shaken"
    code = main(
        ["identify", str(STUDY), "-o", str(out), "--method", "harmonic", "--frequencies", "3,5", "--mbdae", str(mbdae)]
    )
    assert code == 0
    printed = capsys.readouterr()
    assert "took" in printed.out and "direct" in printed.out
    assert "harmonic 0.05 m/s^2 at 3 Hz" in printed.err  # progress
    names = {path.name for path in out.iterdir()}
    assert {"results.json", "results.h5", "identification.png", "harmonic_3Hz_0.05.mbd"} <= names
    assert "harmonic_5Hz_0.05.motion.h5" in names
    assert json.loads((out / "results.json").read_text())["tests"][0]["frequency_hz"] == [3.0, 5.0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--amplitude", "-1"], "greater than zero"),
        (["--frequencies", "0.001"], "outside 0.05 to 50 Hz"),
        (["--frequencies", "three"], "is not a number"),
        (["--method", "guess"], "is not known; choose one of: direct"),
        (["--seed", "-3"], "is negative; zero or more is wanted"),
    ],
)
def test_wrong_arguments(arguments: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code = main(["identify", str(STUDY), "-o", str(tmp_path / "out"), *arguments])
    except SystemExit as exit_:
        code = int(exit_.code or 0)
    assert code == 1
    assert words in capsys.readouterr().err


def test_mayo_s_pilots_cannot_be_shaken(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mayo = STUDY.with_name("puma-mayo.yaml")
    assert main(["identify", str(mayo), "-o", str(tmp_path / "out")]) == 1
    assert "no body to simulate" in capsys.readouterr().err
