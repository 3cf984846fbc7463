"""Photograph the interactive pages for README.md and docs/report.md; needs Chromium and playwright, as the tests do.

`python docs/figures/screenshots.py results/puma-bmi/report.html results/quick/comparison.html`, from a finished search
and from `pilotgen report --compare`.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import io
import os
import shutil
import sys
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

HERE = Path(__file__).parent
WIDTH, COLOURS = 1280, 256


def photograph(page: Page, name: str, first: str, last: str) -> None:
    """From the top of one element to the bottom of another, as a PNG with a palette."""
    page.wait_for_timeout(500)
    page.evaluate("scrollTo({ top: 0, behavior: 'instant' })")
    page.wait_for_timeout(200)
    boxes = [page.locator(selector).first.bounding_box() for selector in (first, last)]
    assert boxes[0] is not None and boxes[1] is not None
    top, bottom = boxes[0]["y"] - 12.0, boxes[1]["y"] + boxes[1]["height"] + 12.0
    data = page.screenshot(full_page=True, clip={"x": 0.0, "y": top, "width": float(WIDTH), "height": bottom - top})
    with Image.open(io.BytesIO(data)) as picture:
        picture.convert("RGB").quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(
            HERE / f"{name}.png", optimize=True
        )


def main(report: Path, comparison: Path) -> None:
    """Three pictures: the linked views, the pilot, two studies."""
    program = shutil.which("chromium") or sys.exit("chromium is not installed")
    arguments = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    arguments += ["--no-sandbox"] if os.geteuid() == 0 else []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=arguments)
        page = browser.new_page(viewport={"width": WIDTH, "height": 900})
        page.goto(report.absolute().as_uri())
        page.wait_for_function("document.documentElement.dataset.ready")
        page.evaluate("pilotgen.state.setHz(pilotgen.model.value('pilot_frequency_hz', pilotgen.state.pilot))")
        photograph(page, "report-views", ".views", "#nyquist")
        page.evaluate("pilotgen.wake()")
        page.select_option("#motion", "mode")
        page.click("#play")  # stop
        page.evaluate("pilotgen.figure.at(0.8)")
        photograph(page, "report-pilot", ".pilot", ".figure")
        page.goto(comparison.absolute().as_uri())
        page.wait_for_function("document.documentElement.dataset.ready")
        photograph(page, "comparison", "h1", "#clouds")
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
