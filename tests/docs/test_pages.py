"""Every command and every piece of Python that the pages show runs as printed.

Fenced blocks of the languages `sh`, `python` and, where it is installed, `octave` are read from README.md and docs/ and
run one after the other, page by page, in a fresh directory that holds what a source tree holds (docs/, templates/,
tests/data/, .venv/bin/). A block that cannot run has a comment `<!-- not run: reason -->` on the line before it.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from pilotgen.solver.client import find_mbdae

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    path
    for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), ROOT / "templates" / "README.md"]
    if path.parent.name != "generated"  # made from the code for the site
)
RUN = ("sh", "python", "octave")
TIME_LIMIT_S = 240
PROGRAMS = r"(?:\.venv/bin/)?(?:pilotgen|mbdae|make|dask|pip|octave)"


@dataclass(frozen=True)
class Block:
    """One fenced block of a page: its language, text, first line, and why it is not run ("" = it is)."""

    language: str
    text: str
    line: int
    not_run: str


def blocks(page: Path) -> list[Block]:
    """Fenced blocks of a page, in order."""
    found, lines, k = [], page.read_text(encoding="utf-8").split("\n"), 0
    while k < len(lines):
        fence = re.fullmatch(r"```(\w*)", lines[k])
        if fence:
            end = lines.index("```", k + 1)
            reason = re.fullmatch(r"<!-- not run: (.+) -->", lines[k - 1] if k else "")
            found.append(Block(fence[1], "\n".join(lines[k + 1 : end]), k + 2, reason[1] if reason else ""))
            k = end
        k += 1
    return found


def to_run(page: Path) -> list[Block]:
    """What of a page is run."""
    return [block for block in blocks(page) if block.language in RUN and not block.not_run]


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A directory as a source tree is after `make study`, without results."""
    for name in ("docs", "templates", "tests/data"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("*.png"))
    programs = tmp_path / ".venv" / "bin"
    programs.mkdir(parents=True)
    (programs / "pilotgen").write_text(f'#!/bin/sh\nexec "{sys.executable}" -m pilotgen "$@"\n')
    (programs / "pilotgen").chmod(0o755)
    (programs / "mbdae").symlink_to(find_mbdae().resolve())
    (programs / "python").symlink_to(sys.executable)
    return tmp_path


@pytest.mark.long
@pytest.mark.parametrize("page", [p for p in PAGES if to_run(p)], ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_page_shows_runs_as_printed(page: Path, tree: Path) -> None:
    environment = {**os.environ, "PATH": f"{tree / '.venv' / 'bin'}:{os.environ['PATH']}", "MPLBACKEND": "Agg"}
    # The package of this tree, also where it is not installed; nothing else may come from where the tests were started.
    environment["PYTHONPATH"] = str(ROOT)
    octave, left_out = shutil.which("octave-cli"), 0
    for block in to_run(page):
        if block.language == "octave" and octave is None:
            left_out += 1
            continue
        command = ["bash", "-euo", "pipefail", "-c", block.text]
        if block.language == "python":
            command = [sys.executable, "-W", "error", "-c", block.text]
        elif block.language == "octave":
            command = [str(octave), "--quiet", "--eval", block.text]
        done = subprocess.run(
            command, cwd=tree, env=environment, capture_output=True, text=True, timeout=TIME_LIMIT_S, check=False
        )
        where = f"{page.relative_to(ROOT)}:{block.line}"
        assert done.returncode == 0, f"{where} ended with {done.returncode}:\n{done.stdout}\n{done.stderr}"
    if left_out:
        pytest.skip(f"{left_out} blocks need GNU Octave with its package control, which is not installed")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_stand_in_fenced_blocks_with_a_language(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert not re.findall(rf"^ {{4,}}\$? ?{PROGRAMS} .*$", text, flags=re.MULTILINE), "indented commands are not run"
    for block in blocks(page):
        assert block.language, f"{page.relative_to(ROOT)}:{block.line}: a fenced block without a language"
        if block.language not in RUN:
            assert not re.search(rf"^\$? ?{PROGRAMS} ", block.text, flags=re.MULTILINE), f"commands in {block.language}"


def test_pages_with_commands_are_found() -> None:
    assert {page.name for page in PAGES if to_run(page)} >= {"README.md", "workflow.md", "cluster.md"}
