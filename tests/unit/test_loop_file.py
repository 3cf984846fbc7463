"""`pilotgen margins`: the forms of a loop, what it prints, and mistakes told in one sentence.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

from pilotgen.cli import main

TRIPLE_LAG = {"num": [4.0], "den": [1.0, 3.0, 3.0, 1.0]}
LAG = {"A": [[-1.0]], "B": [1.0], "C": [3.0], "D": 0.5}
OMEGA = np.geomspace(0.05, 50.0, 80)
DATA = {
    "omega_rad_s": OMEGA.tolist(),
    "real": (4.0 / (1j * OMEGA + 1.0) ** 3).real.tolist(),
    "imag": (4.0 / (1j * OMEGA + 1.0) ** 3).imag.tolist(),
    "open_loop_unstable_poles": 0,
}


def write(directory: Path, content: Any) -> Path:
    path = directory / "loop.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def told(capsys: pytest.CaptureFixture[str], path: Path) -> dict[str, Any]:
    assert main(["margins", str(path), "--json"]) == 0
    out = capsys.readouterr().out
    return dict(json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} is no JSON")))


W = math.sqrt(3.0)
SAME = [
    TRIPLE_LAG,
    {"A": [[-3.0, -3.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], "B": [[1], [0], [0]], "C": [[0, 0, 4]], "D": [[0]]},
    {"zeros": [], "poles": [-1.0, [-1.0, 0.0], -1], "gain": 4},
    {"num": [0, 0, 8.0], "den": [2.0, 6.0, 6.0, 2.0], "note": "the same twice"},
    DATA,
    {**DATA, "frequency_hz": (OMEGA / (2.0 * math.pi)).tolist(), "omega_rad_s": None},
    {"response": [[x, y] for x, y in zip(DATA["real"], DATA["imag"], strict=True)],
     **{k: DATA[k] for k in ("omega_rad_s", "open_loop_unstable_poles")}},
    {"magnitude_db": (20.0 * np.log10(4.0 * np.abs(1j * OMEGA + 1.0) ** -3)).tolist(),
     "phase_deg": np.degrees(-3.0 * np.arctan(OMEGA)).tolist(),
     **{k: DATA[k] for k in ("omega_rad_s", "open_loop_unstable_poles")}},
]  # fmt: skip


@pytest.mark.parametrize("content", SAME)
def test_forms_of_one_loop(content: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = {key: value for key, value in content.items() if value is not None}
    answer = told(capsys, write(tmp_path, content))
    loose = 1e-2 if "phase_deg" in content or "open_loop_unstable_poles" in content else 1e-12
    assert answer["stable"] is True
    assert answer["gain_margin_db"] == pytest.approx(20.0 * math.log10(2.0), rel=loose)
    assert answer["gain_margin_rad_s"] == pytest.approx(W, rel=loose)
    assert answer["gain_margin_hz"] == pytest.approx(W / (2.0 * math.pi), rel=loose)
    assert answer["modulus_margin"] == pytest.approx(1.0 / 3.0, rel=loose)
    w = math.sqrt(4.0 ** (2.0 / 3.0) - 1.0)
    phase = math.pi - 3.0 * math.atan(w)
    assert answer["phase_margin_deg"] == pytest.approx(math.degrees(phase), rel=loose)
    assert answer["delay_margin_s"] == pytest.approx(phase / w, rel=loose)
    assert answer["delay_margin_rad_s"] == pytest.approx(w, rel=loose)
    [axis], [circle] = answer["real_axis_crossings"], answer["unit_circle_crossings"]
    assert axis["real"] == pytest.approx(-0.5, rel=loose) and axis["imag"] == 0.0
    assert math.hypot(circle["real"], circle["imag"]) == pytest.approx(1.0, rel=loose)
    assert ("interpolation_error" in answer) == ("open_loop_unstable_poles" in content)


def test_infinite_is_a_word_and_null_is_not_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answer = told(capsys, write(tmp_path, {"num": [-0.25, 0.5], "den": [1.0, 1.0]}))
    assert answer["phase_margin_deg"] == "inf" and answer["phase_margin_rad_s"] is None
    assert answer["gain_margin_rad_s"] == "inf" and answer["real_axis_crossings"][0]["omega_rad_s"] == "inf"
    answer = told(capsys, write(tmp_path, {"num": [-2.0], "den": [1.0, 1.0]}))
    assert answer["stable"] is False and answer["delay_margin_s"] == 0.0 and answer["gain_margin_db"] < 0.0
    unknown = {key: value for key, value in DATA.items() if key != "open_loop_unstable_poles"}
    answer = told(capsys, write(tmp_path, unknown))
    assert answer["stable"] is None and answer["gain_margin_db"] is None and answer["delay_margin_s"] is None
    assert "open_loop_unstable_poles" in answer["why_not_told"]
    assert len(answer["real_axis_crossings"]) == 1


def test_text_for_a_person(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["margins", str(write(tmp_path, TRIPLE_LAG))]) == 0
    out = capsys.readouterr().out
    assert "stable" in out and "gain margin      6.0206 dB at 1.73205 rad/s (0.275664 Hz)" in out
    assert main(["margins", str(write(tmp_path, DATA))]) == 0
    assert "by interpolation +-" in capsys.readouterr().out
    assert main(["margins", str(write(tmp_path, {**DATA, "open_loop_unstable_poles": 3}))]) == 0
    assert "UNSTABLE" in capsys.readouterr().out
    assert main(["margins", str(write(tmp_path, {**LAG, "colour": "red"}))]) == 0
    assert "not used: colour" in capsys.readouterr().err


def test_mat_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    import scipy.sparse

    path = tmp_path / "loop.mat"
    A = np.array([[-3.0, -3.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    for content in (
        {"A": A, "B": np.eye(3)[:, :1], "C": np.array([[0.0, 0.0, 4.0]]), "D": 0.0},
        {"A": scipy.sparse.csc_matrix(A), "B": np.eye(3)[:, :1], "C": np.array([[0, 0, 4]], dtype=np.int16), "D": 0},
        {"num": [4.0], "den": [1.0, 3.0, 3.0, 1.0]},
        {"zeros": [], "poles": [-1.0 + 0j, -1.0, -1.0], "gain": 4.0},
        {"omega_rad_s": OMEGA, "response": 4.0 / (1j * OMEGA + 1.0) ** 3, "open_loop_unstable_poles": 0},
    ):
        scipy.io.savemat(path, content)
        assert told(capsys, path)["gain_margin_db"] == pytest.approx(6.0206, abs=1e-3)


NAN = '{"A": [[NaN]], "B": [1], "C": [1], "D": 0}'
MISTAKES: list[tuple[Any, str]] = [
    ("", ":1:1: not JSON"),
    ("{", "not JSON"),
    ("[1, 2]", "wanted an object"),
    ("[" * 100_000, "lists within lists"),
    ('{"num": [1], "num": [2], "den": [1, 1]}', "'num' stands twice"),
    ("{}", "no loop in it"),
    ({"Num": [1], "Den": [1, 1]}, "did you mean 'num'"),
    (NAN, "A(1, 1) is nan"),
    ('{"A": [[1e999]], "B": [1], "C": [1], "D": 0}', "A(1, 1) is inf"),
    ('{"A": [[-1]], "B": [1], "C": [1], "D": 1' + "0" * 400 + "}", "beyond the range"),
    ('{"A": [[-1]], "B": [1], "C": [1], "D": 1' + "0" * 5000 + "}", "more digits"),
    ({**LAG, "A": [[-1.0, 2.0]]}, "A has the shape (1, 2); a square matrix"),
    ({**LAG, "A": [[-1.0, 2.0], [0.0]]}, "rows of different lengths"),
    ({**LAG, "A": [[[[-1.0, 1.0]]]]}, "a square matrix"),
    ({**LAG, "A": {"x": 1}}, "A holds an object"),
    ({**LAG, "A": "eye"}, 'A holds "eye" where a number'),
    ({**LAG, "A": [[True]]}, "A holds true"),
    ({**LAG, "A": None}, "A holds null"),
    ({**LAG, "B": [1.0, 2.0]}, "B has the shape (2,)"),
    ({**LAG, "B": [[1.0, 2.0]]}, "B has the shape (1, 2)"),
    ({**LAG, "C": [[1.0], [2.0]]}, "C has the shape (2, 1)"),
    ({**LAG, "D": [1.0, 2.0]}, "one number is wanted"),
    ({k: v for k, v in LAG.items() if k != "D"}, "D is missing"),
    ({**LAG, "num": [1]}, "give the loop in one form"),
    ({**LAG, "open_loop_unstable_poles": 0}, "goes with frequency response data only"),
    ({"num": [1, 0, 0], "den": [1, 1]}, "improper"),
    ({"num": [1], "den": [0, 0]}, "the denominator is zero"),
    ({"num": [1], "den": []}, "the denominator is zero"),
    ({"num": [1], "den": [[1, 2], [3, 4]]}, "den has the shape (2, 2)"),
    ({"num": [1], "den": [1.0] * 99}, "degree 98"),
    ({"num": [1]}, "den is missing"),
    ({"zeros": [[1.0, 2.0]], "poles": [-1, -2], "gain": 1}, "conjugate pairs"),
    ({"zeros": [1, 2, 3], "poles": [-1, -2], "gain": 1}, "3 zeros over 2 poles"),
    ({"zeros": [], "poles": [[1, 2, 3]], "gain": 1}, "poles, entry 1"),
    ({"zeros": [], "poles": ["1+2j"], "gain": 1}, "where a number is wanted"),
    ({"zeros": [], "poles": 3, "gain": 1}, "a list is wanted"),
    ('{"zeros": [], "poles": [[NaN, 1]], "gain": 1}', "poles(1) is not finite"),
    ({**DATA, "frequency_hz": DATA["omega_rad_s"]}, "one of the two"),
    ({k: v for k, v in DATA.items() if k != "omega_rad_s"}, "neither is there"),
    ({**DATA, "omega_rad_s": DATA["omega_rad_s"][::-1]}, "frequencies must rise: number 2"),
    ({**DATA, "omega_rad_s": [1.0] * 80}, "frequencies must rise"),
    ({**DATA, "omega_rad_s": [0.0, *DATA["omega_rad_s"][1:]]}, "start above zero"),
    ({**DATA, "omega_rad_s": DATA["omega_rad_s"][1:]}, "79 frequencies beside 80 values"),
    ({**DATA, "real": DATA["real"][1:]}, "79 values of real beside 80 of imag"),
    ({**DATA, "magnitude": DATA["real"]}, "found real, imag, magnitude"),
    ({k: v for k, v in DATA.items() if k != "imag"}, "values come as"),
    ({**{k: v[:3] for k, v in DATA.items() if k != "open_loop_unstable_poles"}}, "need 8 or more"),
    ({**DATA, "open_loop_unstable_poles": 0.5}, "a whole number"),
    ({**DATA, "open_loop_unstable_poles": -1}, "a whole number"),
    ({"omega_rad_s": OMEGA.tolist(), "magnitude": (-OMEGA).tolist(), "phase_deg": OMEGA.tolist()}, "negative"),
]  # fmt: skip


@pytest.mark.parametrize(("content", "words"), MISTAKES, ids=[words for _, words in MISTAKES])
def test_mistakes(content: Any, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path, content)
    assert main(["margins", str(path)]) == 1
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    assert err.startswith(f"pilotgen: error: {path}") and words in err


def test_files_that_are_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "text.mat").write_text("A = 1")
    (tmp_path / "empty.mat").write_bytes(b"")
    (tmp_path / "hdf.mat").write_bytes(b"MATLAB 7.3 MAT-file" + bytes(600))
    scipy.io.savemat(tmp_path / "words.mat", {"A": "eye", "B": 1, "C": 1, "D": 0})
    scipy.io.savemat(tmp_path / "system.mat", {"A": {"x": 1}, "B": 1, "C": 1, "D": 0})
    scipy.io.savemat(tmp_path / "nan.mat", {"A": np.nan, "B": 1, "C": 1, "D": 0})
    scipy.io.savemat(tmp_path / "complex.mat", {"A": 1j, "B": 1, "C": 1, "D": 0})
    for name, words in (
        ("missing.json", "No such file"), (".", "directory"), ("binary.json", "not UTF-8"),
        ("text.mat", "not a .mat file"),
        ("empty.mat", "not a .mat file"), ("hdf.mat", "save it with -v7"), ("words.mat", "no array of numbers"),
        ("system.mat", "no array of numbers"), ("nan.mat", "A(1, 1) is nan"), ("complex.mat", "A is complex"),
    ):  # fmt: skip
        assert main(["margins", str(tmp_path / name)]) == 1
        err = capsys.readouterr().err
        assert err.count("\n") == 1 and words in err, err


@pytest.mark.parametrize("scale", [1e-300, 1e-150, 1.0, 1e150, 1e300])
def test_numbers_of_any_size(scale: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answer = told(capsys, write(tmp_path, {"num": [0.5 * scale], "den": [1.0, scale]}))
    assert answer["stable"] is True and answer["modulus_margin"] == 1.0
    answer = told(capsys, write(tmp_path, {"A": [[-scale]], "B": [1.0], "C": [-0.5 * scale], "D": 0.0}))
    assert answer["stable"] is True and answer["gain_margin_db"] == pytest.approx(20.0 * math.log10(2.0))
    answer = told(capsys, write(tmp_path, {"zeros": [], "poles": [-scale], "gain": -2.0 * scale}))
    assert answer["stable"] is False
