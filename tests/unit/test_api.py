"""The Python interface: small typed objects that agree with the files and with each other.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import control
import numpy as np
import pytest

import pilotgen as pg
from pilotgen import api
from pilotgen.runs.monitor import read_course

STUDIES = Path(__file__).parents[2] / "docs" / "studies"


@pytest.fixture(scope="module")
def study() -> pg.Study:
    return pg.read_study(STUDIES / "puma-mayo.yaml")


@pytest.fixture(scope="module")
def pilot(study: pg.Study) -> pg.Pilot:
    return pg.evaluate(study, {"pilot_frequency_hz": 3.25, "pilot_damping": 0.2, "pilot_time_constant_s": 0.12})


def test_public_names_are_the_same_everywhere() -> None:
    assert sorted(pg.__all__) == sorted(api.__all__)
    assert all(getattr(pg, name) is getattr(api, name) for name in pg.__all__)
    assert set(pg.__all__) <= set(dir(pg))
    with pytest.raises(AttributeError, match="no attribute 'serach'"):
        _ = pg.serach  # type: ignore[attr-defined]
    assert (Path(pg.__file__).parent / "py.typed").is_file()


def test_the_import_is_light() -> None:
    code = "import sys, pilotgen as pg; pg.read_study(sys.argv[1]); sys.exit('numpy' in sys.modules)"
    subprocess.run([sys.executable, "-c", code, str(STUDIES / "quick.yaml")], check=True)
    code = "import sys, pilotgen as pg; pg.evaluate; sys.exit(str({'control', 'matplotlib'} & set(sys.modules) or ''))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""


def test_closed_loop_of_a_pilot(pilot: pg.Pilot) -> None:
    """Against the interconnection that python-control makes of the parts, and the margins that are known."""
    assert pilot.margins.gain_margin_db == pytest.approx(1.815, abs=2e-3)
    loop = pilot._evaluation.loop
    parts = [control.ss(m.A, m.B[:, None], m.C[None, :], [[m.D]]) for m in (loop.helicopter.state_space, loop.pilot)]
    expected = control.feedback(parts[0], parts[1] * loop.gearing, sign=+1)
    closed = pilot.closed_loop()
    assert closed.input_labels == ["blade_pitch_rad"]
    assert closed.output_labels == ["seat_zddot_m_s2", "collective_rad", "pilot_blade_pitch_rad"]
    for omega in (0.3, 5.0, 20.4, 60.0):
        H = closed(1j * omega)[:, 0]
        assert H[0] == pytest.approx(expected(1j * omega), rel=1e-9)
        assert H[1] == pytest.approx(H[0] * pilot.feedthrough()(1j * omega)[0, 0], rel=1e-9)
        assert H[2] == pytest.approx(loop.gearing * H[1], rel=1e-12)
        assert pilot.open_loop()(1j * omega) == pytest.approx(complex(loop.response(omega)), rel=1e-9)
    np.testing.assert_allclose(np.sort_complex(closed.poles()), np.sort_complex(loop.closed_loop_poles), rtol=1e-9)


def test_a_pilot_who_cannot_be_evaluated(tmp_path: Path) -> None:
    study = pg.read_study(STUDIES / "quick.yaml")
    with pytest.raises(pg.EvaluationError) as caught:
        pg.evaluate(study, {"stature_m": 1.30, "bmi": 50.0}, keep=tmp_path / "kept")
    assert caught.value.stage == "posture" and "beyond the reach" in caught.value.reason


def test_many_pilots_are_rows(study: pg.Study, pilot: pg.Pilot) -> None:
    told: list[int] = []
    pilots = pg.evaluate_many(
        study, [pilot.values, {**pilot.values, "pilot_damping": 0.4}], pg.RunOptions(workers=1),
        lambda progress, _: told.append(progress.done),
    )  # fmt: skip
    table = pilots.table()
    assert len(pilots) == len(table) == 2 and told == [1, 2]
    assert {**pilots[0], "caveats": list(pilot.caveats)} == pilot.to_dict()
    assert table["gain_margin_db"][0] == pilot.margins.gain_margin_db
    assert table["pilot_damping"].tolist() == [0.2, 0.4]
    json.dumps(pilots.to_dict(), allow_nan=False)
    with pytest.raises(pg.PilotgenError, match="same names"):
        pg.evaluate_many(pg.read_study(STUDIES / "quick.yaml"), [{"bmi": 22.0}, {"mass_kg": 70.0}])


def test_search_and_sample(study: pg.Study, tmp_path: Path) -> None:
    import dataclasses

    small = dataclasses.replace(study, search=dataclasses.replace(study.search, population=8, generations=2))
    found = pg.search_pilots(small, tmp_path / "search", pg.RunOptions(workers=1), report=False)
    assert len(found) == 16 and set(found.to_dict()["evaluations"]) >= {"inputs", "status", "gain_margin_db"}
    worst = found.worst(1)[0]
    assert worst["gain_margin_db"] == np.min(found.table()["gain_margin_db"])
    json.dumps(found.to_dict(), allow_nan=False)
    assert found.to_dict() == pg.open_results(tmp_path / "search").to_dict()
    course = read_course(tmp_path / "search")  # for a report, or `pilotgen status`
    assert course is not None and (course.runs, course.workers, course.evaluated) == (1, 1, 16)
    with pytest.raises(pg.PilotgenError, match="already holds a study"):
        pg.search_pilots(small, tmp_path / "search", report=False)
    sample = pg.sample_pilots(small, tmp_path / "sample", 8, options=pg.RunOptions(workers=1))
    # both start with the same points of the box
    np.testing.assert_array_equal(
        np.sort(sample.table()["gain_margin_db"]), np.sort(found.table()["gain_margin_db"][:8])
    )


def test_tables_for_other_libraries(study: pg.Study, pilot: pg.Pilot) -> None:
    pilots = pg.evaluate_many(study, [pilot.values], pg.RunOptions(workers=1))
    pytest.importorskip("pandas")
    assert pilots.to_pandas()["gain_margin_db"][0] == pilot.margins.gain_margin_db
    pytest.importorskip("xarray")
    assert pilots.to_xarray()["gain_margin_db"].attrs["units"] == "dB"
