"""The documentation site builds, strictly and without network, and its notebooks run.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built from the pages of this tree; a warning is an error."""
    out: Path = tmp_path_factory.mktemp("site")
    cache = f"nb_execution_cache_path={tmp_path_factory.mktemp('notebooks')}"  # notebooks are run, whatever was before
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "-D", cache, "docs", str(out)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    environment.pop("MPLBACKEND", None)  # notebooks draw into their page
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=500, check=False)
    assert done.returncode == 0, done.stderr
    return out


@pytest.mark.long
def test_every_page_is_on_the_site(site: Path) -> None:
    for page in (ROOT / "docs").rglob("*.md"):
        assert (site / page.relative_to(ROOT / "docs").with_suffix(".html")).is_file(), page


@pytest.mark.long
def test_pages_load_nothing_from_elsewhere(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r'<(?:script|img|iframe)[^>]+src="(?:https?:)?//[^"]+', text)
        loaded += re.findall(r'<link[^>]+rel="stylesheet"[^>]+href="(?:https?:)?//[^"]+', text)
        assert not loaded, (page, loaded)


@pytest.mark.long
def test_reference_pages_are_made_from_the_code(site: Path) -> None:
    commands = (site / "reference/generated/commands.html").read_text(encoding="utf-8")
    assert "pilotgen search" in commands and "--resume" in commands
    assert "inceptor.gearing_rad_per_m" in (site / "reference/generated/study_keys.html").read_text(encoding="utf-8")
    assert "search_pilots" in (site / "reference/generated/api.html").read_text(encoding="utf-8")


@pytest.mark.long
@pytest.mark.parametrize("name", ["one_pilot", "people_at_risk"])
def test_notebooks_were_run(site: Path, name: str) -> None:
    page = (site / "notebooks" / f"{name}.html").read_text(encoding="utf-8")
    assert page.count("cell_output") >= 3 and "<img" in page, "no outputs: the notebook was not run"
