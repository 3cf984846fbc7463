"""Two studies side by side, and the page of one pilot."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from study_maker import mayo_study, write_study

from pilotgen.cli import main
from pilotgen.errors import FileError
from pilotgen.objectives import GAIN_MARGIN
from pilotgen.report.compare import PAGE_NAME, read_sides, render_comparison, sentences, write_comparison
from pilotgen.study.study import study_from_text

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The same pilots on a lighter and on a heavier gearing."""
    first, second = (tmp_path_factory.mktemp(name) for name in ("first", "second"))
    study = mayo_study(name="light")
    write_study(first, study)
    heavy = study_from_text(
        study.text.replace("gearing_rad_per_m: 1.1", "gearing_rad_per_m: 1.3").replace("light", "heavy")
    )
    write_study(second, heavy, failed=(2,))
    return first, second


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody looks at these pictures."""
    monkeypatch.setattr("pilotgen.figures.style.DPI", 40)


def test_differences_in_words_are_those_of_the_numbers(two) -> None:
    a, b = read_sides(*two)
    told = sentences(a, b)
    gains = [side.results.columns[GAIN_MARGIN.key] for side in (a, b)]
    x, y = (float(gain[side.order[0]]) for gain, side in zip(gains, (a, b), strict=True))
    assert told[0] == (
        f"The worst pilot's gain margin is {x - y:.2f} dB smaller in heavy: {y:.2f} dB where light has {x:.2f} dB."
    ).replace("-", "−")
    # a gain of 1.3 for 1.1 takes the same from every pilot's gain margin
    shift = 20.0 * np.log10(1.3 / 1.1)
    number = f"{-shift:.2f}".replace("-", "−")
    assert told[-1] == (
        "23 pilots are in both studies with the same numbers: from light to heavy their gain margin "
        f"changes by {number} dB in the median, 9 of 10 of them by {number} to {number} dB."
    )
    share = re.search(r"(\d+\.\d) % \([\d.]+-[\d.]+ %\) have a gain margin below 6.00 dB in light", "".join(told))
    assert share is not None
    assert float(share[1]) == pytest.approx(100.0 * np.mean(gains[0][a.even] < 6.0), abs=0.05)


def test_page_tells_what_differs(two, tmp_path: Path) -> None:
    text = write_comparison(tmp_path, *two).read_text()
    assert "inceptor.gearing_rad_per_m" in text and '<td class="text">1.3</td>' in text
    data = json.loads(re.search(r'id="pilotgen-data">(.*?)</script>', text, re.DOTALL)[1])
    assert [side["name"] for side in data["sides"]] == ["light", "heavy"] and len(data["pairs"]) == 23
    again = write_comparison(tmp_path, *two).read_text()
    assert text == again  # the same bytes


def test_names_stay_text(two) -> None:
    a, b = (dataclasses.replace(side, name=f"<script>{k}</script>") for k, side in enumerate(read_sides(*two)))
    text = render_comparison(a, b)
    assert "<script>0" not in text and "&lt;script&gt;0&lt;/script&gt;" in text


def test_what_cannot_be_compared_is_told(two, tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"study\.h5 does not exist; --compare wants two output directories"):
        read_sides(two[0], tmp_path)
    write_study(tmp_path, mayo_study(1), failed=range(24))
    with pytest.raises(FileError, match="no pilot of this study could be evaluated"):
        read_sides(two[0], tmp_path)


def test_compare_command(two, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", "--compare", str(two[0]), str(two[1])]) == 0
    assert (two[0] / PAGE_NAME).is_file() and "comparison: " in capsys.readouterr().out
    assert main(["report", "--compare", str(two[0]), str(two[1]), "--no-evaluations"]) == 1
    assert "leave them out" in capsys.readouterr().err
    assert main(["report"]) == 1
    assert "give DIR" in capsys.readouterr().err


# ---- one pilot


def text_and_data(page: Path) -> tuple[str, Any]:
    """A page and the numbers in it."""
    text = page.read_text()
    return text, json.loads(re.search(r'id="pilotgen-data">(.*?)</script>', text, re.DOTALL)[1])


def test_a_pilot_has_his_page_and_view_makes_it_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = ROOT / "docs" / "studies" / "quick.yaml"
    place = tmp_path / "tall"
    assert main(["pilot", str(study), "-o", str(place), "--set", "stature_m=1.9", "pilot.task=relax"]) == 0
    page = place / "pilot.html"
    text, data = text_and_data(page)
    assert data["command"]["more"] == ["pilot.task=relax"] and data["nominal"] == 1 and data["count"] == 1
    assert set(data["skeletons"]["each"]) == {"0", "1"}
    result = json.loads((place / "result.json").read_text())
    assert f"gain margin {result['loop']['gain_margin_db']:.2f} dB" in text
    assert main(["view", str(place)]) == 0
    assert text_and_data(page)[1] == data
    changed = {**result, "loop": {**result["loop"], "gain_margin_db": 1.0}}
    (place / "result.json").write_text(json.dumps(changed))
    assert main(["view", str(place)]) != 0
    assert "another version of pilotgen wrote it" in capsys.readouterr().err


def test_without_figures_there_is_no_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = ROOT / "docs" / "studies" / "puma-mayo.yaml"
    assert main(["pilot", str(study), "-o", str(tmp_path / "out"), "--no-figures"]) == 0
    assert not (tmp_path / "out" / "pilot.html").exists()
    assert main(["view", str(tmp_path / "out")]) == 0  # it can be had later
    assert (tmp_path / "out" / "pilot.html").exists()
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    for damage in ({"provenance": []}, {"caveats": 1}, {"loop": None}, {"loop": {}}, {"loop": {"gain_margin_db": "x"}}):
        (tmp_path / "out" / "result.json").write_text(json.dumps({**result, **damage}))
        assert main(["view", str(tmp_path / "out")]) == 1
        assert "result.json: is damaged; evaluate the pilot again" in capsys.readouterr().err, damage
    (tmp_path / "out" / "result.json").write_text("[" * 100_000)
    assert main(["view", str(tmp_path / "out")]) == 1
    assert "nested without end" in capsys.readouterr().err
    assert main(["view", str(tmp_path)]) == 1
    assert "result.json does not exist" in capsys.readouterr().err
    (tmp_path / "out" / "result.json").write_text('{"status": "failed", "values": {}}')
    assert main(["view", str(tmp_path / "out")]) == 1
    assert "holds no pilot who could be evaluated" in capsys.readouterr().err
