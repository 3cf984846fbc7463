"""study.h5: round trip, identical bytes, strangers refused."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from pilotgen.errors import FileError
from pilotgen.runs.results import (
    ResultsWriter,
    Row,
    columns_of,
    flat_columns,
    read_results,
    structured_array,
    unit_of,
    write_results,
)

NAMES = ("bmi", "stature_m")


def _rows() -> list[Row]:
    ok = {
        "status": "ok",
        "loop": {
            "stable": True,
            "gain_margin_db": 6.5,
            "gain_margin_hz": 3.7,
            "phase_margin_deg": None,
            "phase_margin_hz": None,
            "modulus_margin": 0.5,
            "modulus_margin_hz": 3.6,
            "delay_margin_s": None,
        },
        "bdft": {"certificate": 1e-12, "dominant_frequency_hz": 3.7, "dominant_damping": 0.3},
        "activation": {"largest": 0.25},
        "biometrics": {"age_years": 40.0, "stature_m": 1.8, "mass_kg": 80.0, "bmi": 24.7},
    }
    failed = {"status": "failed", "stage": "posture", "reason": "elbow at 160 deg, limit 150 deg"}
    return [Row(0, 0, {"bmi": 24.7, "stature_m": 1.8}, ok), Row(0, 1, {"bmi": 30.0, "stature_m": 2.0}, failed)]


def _write(path: Path) -> dict[str, np.ndarray]:
    columns = columns_of(_rows(), NAMES, np.array([[6.5, 180.0], [np.nan, np.nan]]), np.array([1, 0]))
    write_results(
        path,
        {"kind": "search", "seed": 1, "study_text": "study: ä\n"},
        NAMES,
        np.array([18.0, 1.55]),
        np.array([30.0, 2.0]),
        ("gain_margin_db", "phase_margin_deg"),
        columns,
        np.array([[0, 1]]),
        np.array([0]),
    )
    return columns


def test_round_trip(tmp_path: Path) -> None:
    columns = _write(tmp_path / "study.h5")
    results = read_results(tmp_path / "study.h5")
    assert results.names == NAMES
    assert results.attributes["study_text"] == "study: ä\n"
    assert results.objective_names == ("gain_margin_db", "phase_margin_deg")
    assert set(results.columns) == set(columns)
    for key, value in columns.items():
        np.testing.assert_array_equal(results.columns[key], value)
    assert results.columns["phase_margin_deg"][0] == np.inf  # null margin = no crossing
    assert np.isnan(results.columns["phase_margin_deg"][1])  # failed
    assert results.columns["reason"][1].startswith("elbow")
    np.testing.assert_array_equal(results.members, [[0, 1]])


def test_every_number_says_its_unit(tmp_path: Path) -> None:
    _write(tmp_path / "study.h5")
    with h5py.File(tmp_path / "study.h5") as file:
        group = file["evaluations"]
        assert group["gain_margin_db"].attrs["units"] == "dB" and group["delay_margin_s"].attrs["units"] == "s"
        assert group["objectives"].attrs["units"].tolist() == ["dB", "deg"]
        assert group["inputs"].attrs["units"].tolist() == file["variables/lower"].attrs["units"].tolist()
        plain = {"generation", "individual", "status", "stage", "reason", "rank", "stable", "sex"}
        assert {name for name, dataset in group.items() if "units" not in dataset.attrs} == plain


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("stature_m", "m"), ("bmi", "kg/m^2"), ("inceptor.gearing_rad_per_m", "rad/m"), ("washout_rad_s", "rad/s"),
        ("pilot.torso.buttocks.vertical_n_per_m", "N/m"), ("pilot_damping", "1"), ("modulus_margin", "1"),
        ("grip_motion_3hz_mm_per_m_s2", "mm s^2/m"), ("cockpit.lever.inertia_kg_m2", "kg m^2"),
    ],
)  # fmt: skip
def test_a_name_ends_with_its_unit(name: str, unit: str) -> None:
    assert unit_of(name) == unit


def test_same_results_same_bytes(tmp_path: Path) -> None:
    _write(tmp_path / "a.h5")
    _write(tmp_path / "b.h5")
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_strangers_are_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file.attrs["filetype"] = "other"
    with pytest.raises(FileError, match="not a pilotgen study file"):
        read_results(tmp_path / "other.h5")
    (tmp_path / "text.h5").write_text("hello")
    with pytest.raises(FileError, match="cannot be read"):
        read_results(tmp_path / "text.h5")


def test_unwritable_directory(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="cannot be written"):
        _write(tmp_path / "none" / "study.h5")


def test_a_flipped_bit_is_noticed(tmp_path: Path) -> None:
    _write(tmp_path / "study.h5")
    data = bytearray((tmp_path / "study.h5").read_bytes())
    at = data.index(np.float64(6.5).tobytes())
    data[at + 6] ^= 1
    (tmp_path / "study.h5").write_bytes(data)
    with pytest.raises(FileError, match="damaged"):
        read_results(tmp_path / "study.h5")


@pytest.mark.parametrize("name", ["evaluations/status", "evaluations/inputs", "variables/lower", "population/front"])
def test_parts_that_do_not_go_together_are_told(tmp_path: Path, name: str) -> None:
    _write(tmp_path / "study.h5")
    with h5py.File(tmp_path / "study.h5", "r+") as file:
        del file[name]
        file[name] = np.array([7])
    with pytest.raises(FileError, match="damaged"):
        read_results(tmp_path / "study.h5")


def test_pieces_with_more_poles_widen_the_table(tmp_path: Path) -> None:
    ok = {
        "status": "ok",
        "loop": {"stable": True, "gain_margin_db": 1.0, "phase_margin_deg": 2.0, "modulus_margin": 0.1},
    }

    def columns(*counts: int) -> dict[str, np.ndarray]:
        poles = [[{"frequency_hz": float(k), "damping": 0.5} for k in range(count)] for count in counts]
        rows = [Row(0, k, {"bmi": 20.0}, {**ok, "pilot_poles": one}) for k, one in enumerate(poles)]
        return columns_of(rows, ["bmi"], np.zeros((len(rows), 2)), None)

    path = tmp_path / "study.h5"
    objectives = ("gain_margin_db", "phase_margin_deg")
    with ResultsWriter(path, {}, ["bmi"], np.array([18.0]), np.array([30.0]), objectives) as writer:
        for counts in ((0, 0), (1, 3), (2,)):
            writer.append(columns(*counts))
    table = structured_array(read_results(path).columns, ("bmi",))
    assert [int(np.isfinite(row).sum()) for row in table["pole_frequency_hz"]] == [0, 0, 1, 3, 2]
    flat = flat_columns(table)
    np.testing.assert_array_equal(flat["pole_frequency_hz_3"], [np.nan, np.nan, np.nan, 2.0, np.nan])
    assert "pole_frequency_hz" not in flat
