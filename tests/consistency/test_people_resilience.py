"""Populations, rare shares and sensitivities killed in the middle, and on a dask cluster: the same numbers.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from processes import (
    assert_all_gone,
    dask_scheduler,
    descendants,
    kill,
    recorded,
    run,
    start,
    start_dask_worker,
    wait_until,
)

STUDIES = Path(__file__).parents[2] / "docs" / "studies"
RUNS = {
    "population": (("population", STUDIES / "puma-population.yaml", "-n", "24"), ("people.csv", "population.json")),
    "rare": (("population", STUDIES / "puma-population.yaml", "--rare", "unstable", "-n", "100"), ("rare.json",)),
    "uncertain": (
        ("pilot", STUDIES / "puma-robust.yaml", "--uncertain", "-n", "24", "--no-figures"),
        ("uncertain.json", "uncertain.csv"),
    ),
    "surrogate": (
        ("sensitivity", STUDIES / "puma-sensitivity.yaml", "--surrogate", "-n", "24", "--no-figures"),
        ("sensitivity.json",),
    ),
}


Undisturbed = Callable[[str], Path]


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    """Directory of a run by its name, run once, without disturbance."""

    @functools.cache
    def directory(name: str) -> Path:
        place = tmp_path_factory.mktemp(name) / "out"
        done = run(*RUNS[name][0], "-o", place, "--workers", "2", "--quiet")
        assert done.returncode == 0, done.stderr
        return place

    return directory


@pytest.mark.parametrize("name", list(RUNS))
def test_killed_it_goes_on_where_it_was(name: str, undisturbed: Undisturbed, tmp_path: Path) -> None:
    command, files = RUNS[name]
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
        assert (tmp_path / "killed" / file).read_bytes() == (undisturbed(name) / file).read_bytes()
    assert not list((tmp_path / "killed").glob("*.part"))


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of a scheduler with two workers."""
    pytest.importorskip("distributed")
    directory = tmp_path_factory.mktemp("dask")
    with dask_scheduler(directory) as address:
        workers = [start_dask_worker(address, directory) for _ in range(2)]
        try:
            yield address
        finally:
            for worker in workers:
                worker.terminate()
                worker.wait()


@pytest.mark.long
@pytest.mark.parametrize("name", list(RUNS))
def test_on_a_cluster(name: str, cluster: str, undisturbed: Undisturbed, tmp_path: Path) -> None:
    command, files = RUNS[name]
    done = run(*command, "-o", tmp_path / "dask", "--quiet", "--executor", "dask", "--scheduler", cluster)
    assert done.returncode == 0, done.stderr
    for file in files:
        assert (tmp_path / "dask" / file).read_bytes() == (undisturbed(name) / file).read_bytes()
