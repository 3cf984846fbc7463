"""Populations, rare shares and sensitivities killed in the middle, and on a dask cluster: the same numbers.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from pathlib import Path

import pytest
from processes import assert_all_gone, descendants, kill, recorded, run, start, wait_until

STUDIES = Path(__file__).parents[2] / "docs" / "studies"
RUNS = {
    "population": (("population", STUDIES / "puma-population.yaml", "-n", "24"), ("people.csv", "population.json")),
    "rare": (("population", STUDIES / "puma-population.yaml", "--rare", "unstable", "-n", "100"), ("rare.json",)),
    "uncertain": (
        ("pilot", STUDIES / "puma-robust.yaml", "--uncertain", "-n", "24", "--no-figures"),
        ("uncertain.json", "uncertain.csv"),
    ),
    "surrogate": (("sensitivity", STUDIES / "puma-sensitivity.yaml", "--surrogate", "-n", "24"), ("sensitivity.json",)),
}


@pytest.mark.parametrize("name", list(RUNS))
def test_killed_it_goes_on_where_it_was(name: str, tmp_path: Path) -> None:
    command, files = RUNS[name]
    done = run(*command, "-o", tmp_path / "whole", "--workers", "2", "--quiet")
    assert done.returncode == 0, done.stderr
    process = start(*command, "-o", tmp_path / "killed", "--workers", "2", "--quiet")
    wait_until(lambda: recorded(tmp_path / "killed") >= 8 or process.poll() is not None, "some evaluations")
    family = descendants(process.pid)
    kill(process.pid)
    process.communicate()
    assert_all_gone(family)
    assert not (tmp_path / "killed" / files[0]).exists()
    done = run(*command, "-o", tmp_path / "killed", "--workers", "1", "--quiet", "--resume")
    assert done.returncode == 0, done.stderr
    for file in files:
        assert (tmp_path / "killed" / file).read_bytes() == (tmp_path / "whole" / file).read_bytes()
    assert not list((tmp_path / "killed").glob("*.part"))


@pytest.mark.long
@pytest.mark.parametrize("name", list(RUNS))
def test_on_a_cluster(name: str, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    command, files = RUNS[name]
    for place, more in (("here", ()), ("dask", ("--executor", "dask"))):
        done = run(*command, "-o", tmp_path / place, "--workers", "2", "--quiet", *more)
        assert done.returncode == 0, done.stderr
    for file in files:
        assert (tmp_path / "here" / file).read_bytes() == (tmp_path / "dask" / file).read_bytes()
