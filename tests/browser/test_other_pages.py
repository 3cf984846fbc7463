"""The pages of one pilot and of two studies in a browser."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser.conftest import PICTURES, TEXT, Made
from study_maker import mayo_study, write_study

from pilotgen.context import EvaluationContext
from pilotgen.evaluation import Evaluation, evaluate, write_result
from pilotgen.report import write_report
from pilotgen.report.compare import write_comparison
from pilotgen.report.view import write_pilot_page
from pilotgen.study.study import Study, read_study, study_from_text

ROOT = Path(__file__).parents[2]


def page_of(study: Study, values: dict[str, Any], directory: Path) -> tuple[str, Evaluation]:
    """Address of one pilot's page, and the pilot."""
    study, own = study.with_values(values)
    with EvaluationContext(study) as context:
        outcome = evaluate(context, {**own, **{name: value for name, value in values.items() if "." in name}})
        assert isinstance(outcome, Evaluation)
        page = write_pilot_page(directory, context, outcome, write_result(context, outcome, directory))
    return page.as_uri(), outcome


@pytest.mark.parametrize("torso", ["rigid", "modes"])
def test_page_of_one_pilot_with_other_torsos(torso: str, tmp_path: Path, opened: Any) -> None:
    address, outcome = page_of(study_from_text(TEXT), {"pilot.torso.model": torso, "stature_m": 1.9}, tmp_path)
    page = opened(address, height=700)
    assert page.inner_text("#who") == "this pilot" and page.locator("#table").count() == 0
    result = outcome.result
    assert f"{result['loop']['gain_margin_db']:.2f} dB" in page.inner_text("#margins")
    for crossing in result["loop"]["crossings"]:
        re, im = page.evaluate("hz => pilotgen.model.loop(0, hz)", crossing["frequency_hz"])
        assert abs(complex(re, im) - complex(crossing["real"], crossing["imag"])) < 1e-6
    page.keyboard.press("ArrowRight")
    assert page.inner_text("#who") == "nominal pilot"
    page.evaluate("pilotgen.wake()")
    page.locator(".pilot").screenshot(path=PICTURES / f"pilot-{torso}.png")


def test_roll_has_tilts_and_both_arms(tmp_path: Path, opened: Any) -> None:
    address, outcome = page_of(read_study(ROOT / "docs" / "studies" / "roll.yaml"), {"stature_m": 1.9}, tmp_path)
    page = opened(address)
    hz = np.geomspace(0.1, 20.0, 30)
    found = np.array(page.evaluate("hz => hz.map(f => pilotgen.model.loop(0, f))", hz.tolist()))
    np.testing.assert_allclose(found @ [1.0, 1j], outcome.loop.response(2.0 * np.pi * hz), rtol=1e-6)
    text = page.inner_text("body")
    assert "roll acceleration → lateral cyclic grip" in text and "Mayo" not in page.inner_text(".legend >> nth=0")
    assert page.evaluate("pilotgen.model.data.skeletons.structure.muscles.length") == 50
    page.evaluate("pilotgen.wake()")
    assert page.locator("#motion option").count() == 2  # standing still, dominant mode


def test_page_of_transfer_function_pilots_needs_no_skeleton(tmp_path: Path, opened: Any) -> None:
    write_study(tmp_path, mayo_study())
    write_report(tmp_path, mayo_study())
    page = opened((tmp_path / "report.html").as_uri())
    assert page.locator("#figure").count() == 0 and page.locator("#pilots tbody tr").count() == 15
    page.keyboard.press("ArrowRight")
    assert "THREE" not in page.evaluate("Object.keys(window).join()")


def test_report_that_evaluated_nothing(made: Made, tmp_path: Path, opened: Any) -> None:
    (tmp_path / "study.h5").write_bytes((made.directory / "study.h5").read_bytes())
    write_report(tmp_path, made.study, evaluations=False)
    page = opened((tmp_path / "report.html").as_uri())
    assert "No curve is stored for this pilot" in page.inner_text("#readout")
    assert page.locator("#pilots tbody tr").count() == 15


def test_two_studies(tmp_path: Path, opened: Any) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    for place, gearing in ((first, 1.1), (second, 1.3)):
        place.mkdir()
        study = study_from_text(mayo_study(name=place.name).text.replace("1.1}", f"{gearing}}}"))
        write_study(place, study)
    page = opened(write_comparison(first, first, second).as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") <= 1400
    worst = page.evaluate("pilotgen.compared.sides[1].worst")
    page.locator("#clouds").scroll_into_view_if_needed()
    x, y = page.evaluate("k => pilotgen.compared.screen(1, k)", worst)
    page.locator("#clouds .u-over").click(position={"x": x, "y": y})
    assert page.evaluate("pilotgen.compared.chosen") == [1, worst]
    page.locator("#clouds .u-over").hover(position={"x": x, "y": y})
    assert page.inner_text(".tip").startswith("second")
    shares = page.evaluate("pilotgen.compared.shares")
    assert all(sum(one) == pytest.approx(100.0) for one in shares)
    page.screenshot(path=PICTURES / "comparison.png", full_page=True)
