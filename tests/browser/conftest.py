"""A real browser, Debian's Chromium without a window, and pages to open in it."""

from __future__ import annotations

import dataclasses
import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from study_maker import write_study

from pilotgen.report import write_report
from pilotgen.report.others import ReportSection
from pilotgen.runs.results import StudyResults
from pilotgen.study.study import Study, study_from_text

PICTURES = Path(__file__).parents[2] / "build" / "report"  # screenshots for people to look at
TEXT = """\
# <script>alert("study")</script>
study: quick
rotorcraft: iar330-puma
inceptor: {lever_length_m: 0.32, gearing_rad_per_m: 1.1}
pilot: {model: multibody, sex: male, limbs: [left], washout_rad_s: 3.10}
nominal: {age_years: 40, bmi: 24, stature_m: 1.775}
search:
  variables: {age_years: [25, 65], bmi: [18, 30], stature_m: [1.55, 2.00]}
  population: 8
  generations: 3
  seed: 5
"""


@pytest.fixture(scope="module", autouse=True)  # not the session: other tests look at their figures
def coarse_figures() -> Iterator[None]:
    """Still figures of few dots, which draw faster."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pilotgen.figures.style.DPI", 60)
        yield


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium; graphics by its own software renderer."""
    playwright = pytest.importorskip("playwright.sync_api")
    program = next((found for name in ("chromium", "chromium-browser") if (found := shutil.which(name))), None)
    if program is None:
        pytest.skip("Chromium is not installed; .ci/system-packages test does it")
    arguments = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    arguments += ["--no-sandbox"] if os.geteuid() == 0 else []
    with playwright.sync_playwright() as running:
        opened = running.chromium.launch(executable_path=program, args=arguments)
        yield opened
        opened.close()


@dataclass(frozen=True)
class Made:
    """A study, what it found, and where its report is."""

    study: Study
    results: StudyResults
    directory: Path

    @property
    def address(self) -> str:
        """Of the report."""
        return (self.directory / "report.html").as_uri()


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A small search of multibody pilots with two failures, and its report."""
    directory = tmp_path_factory.mktemp("study")
    study = study_from_text(TEXT)
    rotorcraft = dataclasses.replace(study.rotorcraft, name="<i>Puma</i><script>alert(2)</script>")
    study = dataclasses.replace(study, name="<b>quick</b> & small", rotorcraft=rotorcraft)
    results = write_study(directory, study, failed=(3, 12))
    table = {"heads": ["<b>head</b>"], "rows": [["<i>cell</i>"]]}
    told = ReportSection(
        "population", "<i>people</i>", "<b>people</b>.csv", ("<script>alert(3)</script> fly.",), "<i>1 %</i>", table
    )
    write_report(directory, study, others=[told])
    return Made(study, results, directory)


@pytest.fixture
def opened(browser: Any) -> Iterator[Callable[..., Any]]:
    """Opens a page in a window of its own; the test fails if the page complains in the console."""
    contexts, complaints = [], []

    def show(address: str, width: int = 1400, height: int = 900, **options: Any) -> Any:
        context = browser.new_context(viewport={"width": width, "height": height}, **options)
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: message.type in ("error", "warning") and complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: request.url == address or complaints.append(f"asks for {request.url[:80]}"))
        page.goto(address)
        if options.get("java_script_enabled", True):
            page.wait_for_function("document.documentElement.dataset.ready", timeout=60_000)
        return page

    yield show
    for context in contexts:
        context.close()
    # Chromium's remark on its software renderer is no complaint of the page's
    assert [
        text for text in complaints if "GL Driver Message" not in text and not text.startswith("asks for blob:")
    ] == []
