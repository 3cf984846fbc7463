"""Command lines run in this process: what commands' tests share (the fixture `run` is in conftest.py).

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

STUDIES = Path(__file__).parents[1] / "docs" / "studies"
QUICK = STUDIES / "quick.yaml"
MAYO = STUDIES / "puma-mayo.yaml"

Run = Callable[..., tuple[int, str, str]]


def changed(tmp_path: Path, old: str, new: str, source: Path = QUICK) -> Path:
    """A copy of a study with a mistake in it."""
    text = source.read_text()
    assert old in text
    path = tmp_path / "study.yaml"
    path.write_text(text.replace(old, new, 1))
    return path


def refused(result: tuple[int, str, str], *patterns: str) -> None:
    """The command refused with exit code 1 and one message that holds every pattern."""
    code, out, err = result
    assert code == 1, (out, err)
    assert out == ""
    assert err.startswith("pilotgen") and err.count("error:") == 1, err
    assert "Traceback" not in err and "internal" not in err
    for pattern in patterns:
        assert re.search(pattern, err), f"{pattern!r} not in {err!r}"
