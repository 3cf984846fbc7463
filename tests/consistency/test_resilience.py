"""A study survives what can happen to it: killed, interrupted, starved of disk, lied to. Nothing recorded is lost."""

from __future__ import annotations

import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from processes import (
    PATIENCE_S,
    assert_all_gone,
    children,
    command_of,
    descendants,
    kill,
    recorded,
    run,
    start,
    wait_until,
)

from pilotgen.context import EvaluationContext
from pilotgen.evaluation import Evaluation, evaluate
from pilotgen.runs.batch import failures_by_reason
from pilotgen.runs.journal import JOURNAL_NAME, Journal
from pilotgen.runs.results import read_results
from pilotgen.study.study import read_study

STUDIES = Path(__file__).parents[2] / "docs" / "studies"
FAULTY = Path(__file__).parents[1] / "faulty_mbdae.py"


def small_study(directory: Path, source: str, population: int, generations: int) -> Path:
    """A bundled study with another budget."""
    text = yaml.safe_load((STUDIES / source).read_text())
    text["search"].update(population=population, generations=generations)
    path = directory / source
    path.write_text(yaml.safe_dump(text))
    return path


def search(study: Path, directory: Path, *more: str) -> list[str | Path]:
    """Arguments of a search without report."""
    return ["search", study, "-o", directory, "--workers", "2", "--no-report", "--quiet", *more]


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Long enough, a second, to be met in the middle."""
    return small_study(tmp_path_factory.mktemp("study"), "quick.yaml", 24, 8)


@pytest.fixture(scope="module")
def undisturbed(study: Path, tmp_path_factory: pytest.TempPathFactory, mbdae: Path) -> Path:
    """Directory of the study, run without disturbance."""
    directory = tmp_path_factory.mktemp("undisturbed") / "out"
    done = run(*search(study, directory), PILOTGEN_MBDAE=str(mbdae))
    assert done.returncode == 0, done.stderr
    return directory


@pytest.fixture(scope="module")
def mayo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study of 480 transfer functions, a second as well, whose journal is 1 MB."""
    return small_study(tmp_path_factory.mktemp("mayo"), "puma-mayo.yaml", 60, 8)


@pytest.fixture(scope="module")
def mayo_undisturbed(mayo: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory of that study, run without disturbance."""
    directory = tmp_path_factory.mktemp("mayo_undisturbed") / "out"
    assert run(*search(mayo, directory)).returncode == 0
    return directory


def assert_same(directory: Path, undisturbed: Path) -> None:
    """Byte for byte the file of the undisturbed run."""
    assert (directory / "study.h5").read_bytes() == (undisturbed / "study.h5").read_bytes()


# ---- killed


def test_killed_driver_goes_on_where_it_was(study: Path, undisturbed: Path, tmp_path: Path) -> None:
    directory, before = tmp_path / "out", 0
    total = recorded(undisturbed)
    for goal in (1, total // 4, total // 2, 3 * total // 4):
        process = start(*search(study, directory, "--resume"))
        wait_until(lambda goal=goal: recorded(directory) >= goal, f"{goal} evaluations")  # type: ignore[misc]
        family = descendants(process.pid)
        assert len(family) >= 2
        kill(process.pid)
        process.communicate()
        assert_all_gone(family)  # neither workers nor solvers stay behind
        assert recorded(directory) >= max(goal, before)
        before = recorded(directory)
        assert not (directory / "study.h5").exists()
    done = run(*search(study, directory, "--resume"))
    assert done.returncode == 0, done.stderr
    assert int(re.search(r"\((\d+) from the journal\)", done.stdout)[1]) >= before  # type: ignore[index]
    assert_same(directory, undisturbed)


@pytest.mark.long
def test_driver_killed_at_random_moments(mayo: Path, mayo_undisturbed: Path, tmp_path: Path) -> None:
    chance = random.Random(5)
    directory = tmp_path / "out"
    for _ in range(5):
        process = start(*search(mayo, directory, "--resume"))
        time.sleep(chance.uniform(0.1, 2.5))
        family = descendants(process.pid)
        kill(process.pid)
        process.communicate()
        assert_all_gone(family)
    assert run(*search(mayo, directory, "--resume")).returncode == 0
    assert_same(directory, mayo_undisturbed)
    again = run(*search(mayo, directory, "--resume"))  # a second run of a finished study is served from the journal
    assert f"({recorded(directory)} from the journal)" in again.stdout
    assert_same(directory, mayo_undisturbed)


def test_murdered_workers_and_solvers_change_nothing(study: Path, undisturbed: Path, tmp_path: Path) -> None:
    directory = tmp_path / "out"
    process = start(*search(study, directory))
    total = recorded(undisturbed)
    killed = {"worker": 0, "solver": 0}
    for k, goal in enumerate(range(2, 3 * total // 4, total // 8)):
        wait_until(lambda goal=goal: recorded(directory) >= goal or process.poll() is not None, "progress")  # type: ignore[misc]
        workers = children(process.pid)
        if k % 2 == 0:
            solvers = [pid for worker in workers for pid in children(worker) if "--serve" in command_of(pid)]
            for pid in solvers[:1]:
                kill(pid)
                killed["solver"] += 1
        else:
            for pid in workers[:1]:
                kill(pid)
                killed["worker"] += 1
    out, err = process.communicate(timeout=2 * PATIENCE_S)
    assert process.returncode == 0, err
    assert "Traceback" not in err
    assert killed["worker"] > 0
    assert killed["solver"] > 0
    assert " 0 failed" in out
    assert_same(directory, undisturbed)


# ---- interrupted


@pytest.mark.parametrize("how", ["Ctrl-C", "SIGTERM"])
def test_interrupted_search_leaves_a_resumable_state(how: str, study: Path, undisturbed: Path, tmp_path: Path) -> None:
    directory = tmp_path / "out"
    process = start(*search(study, directory))
    wait_until(lambda: recorded(directory) >= 5, "some evaluations")
    family = descendants(process.pid)
    if how == "Ctrl-C":
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: everybody in the foreground gets it
    else:
        os.kill(process.pid, signal.SIGTERM)
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == (130 if how == "Ctrl-C" else 143)
    said = err.strip().splitlines()[-1]
    assert said.startswith("pilotgen: interrupted; " if how == "Ctrl-C" else "pilotgen: ended by SIGTERM; ")
    assert re.search(r"; [0-9]+ evaluations recorded, go on with --resume$", said)
    assert "Traceback" not in err
    assert_all_gone(family)
    kept = recorded(directory)
    assert kept >= 5
    done = run(*search(study, directory, "--resume"))
    assert done.returncode == 0, done.stderr
    assert int(re.search(r"\((\d+) from the journal\)", done.stdout)[1]) >= kept  # type: ignore[index]
    assert_same(directory, undisturbed)


def test_second_run_on_the_same_directory_is_refused(tmp_path: Path) -> None:
    study = small_study(tmp_path, "puma-bmi.yaml", 100, 30)  # goes on for longer than the second run needs
    directory = tmp_path / "out"
    first = start(*search(study, directory))
    wait_until(lambda: recorded(directory) >= 1, "the first evaluation")
    second = run(*search(study, directory, "--resume"))
    assert second.returncode == 1
    assert "in use by another run" in second.stderr
    assert first.poll() is None
    os.kill(first.pid, signal.SIGTERM)
    first.communicate(timeout=PATIENCE_S)
    assert first.returncode == 143


# ---- lied to

REASONS = {  # misdeed of tests/faulty_mbdae.py -> stage and reason of the failed pilot
    "crash": ("solver", "mbdae died with signal SIGSEGV on pilot.mbd"),
    "exit": ("solver", "mbdae ended with exit code 3 on pilot.mbd; its last stderr lines: faulty_mbdae: out of ideas"),
    "hang": ("solver", "mbdae did not answer on pilot.mbd within 2 s and was stopped"),
    "other id": ("solver", "reply to request 10000000 where"),
    "garbage": ("solver", "not JSON"),
    "list": ("solver", "not an object"),
    "missing key": ("solver", "missing or wrong value"),
    "no file": ("matrices", "No such file"),
    "short file": ("matrices", "not written to its end"),
    "other deck": ("matrices", "of another deck"),
    "nan": ("matrices", "has nan at [3, 4]"),
    "sizes": ("matrices", "has shape"),
}


@pytest.fixture
def faulty(tmp_path: Path) -> Path:
    """An executable `mbdae` that misbehaves."""
    path = tmp_path / "mbdae"
    path.write_text(f'#!/bin/sh\nexec {sys.executable} {FAULTY} "$@"\n')
    path.chmod(0o755)
    return path


def test_misbehaving_solver_costs_its_victims_only(study: Path, tmp_path: Path, mbdae: Path, faulty: Path) -> None:
    directory = tmp_path / "out"
    environment = {"PILOTGEN_MBDAE": str(faulty), "REAL_MBDAE": str(mbdae), "MISDEEDS": ",".join(REASONS)}
    done = run("sample", study, "-n", "96", "-o", directory, "--workers", "2", "--time-limit", "2", **environment)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    with Journal(directory / JOURNAL_NAME) as journal:
        records = list(journal)
    assert len(records) == 96
    failed = [record for record in records if record.status != "ok"]
    assert 15 < len(failed) < 50
    seen = set()
    for record in failed:
        fits = [
            deed
            for deed, (stage, reason) in REASONS.items()
            if stage == record.result["stage"] and reason in record.result["reason"]
        ]
        assert fits, record.result
        seen.update(fits)
    assert len(seen) >= 9  # of twelve, by about thirty victims
    loaded = read_study(study)
    with EvaluationContext(loaded, mbdae=str(mbdae)) as context:
        good = [record for record in records if record.status == "ok"]
        for record in good[::6]:
            assert evaluate(context, loaded.values(record.inputs)).result == record.result
        for record in failed[::6]:  # with an honest solver they are pilots like any other
            assert isinstance(evaluate(context, loaded.values(record.inputs)), Evaluation)
    groups = failures_by_reason([record.result for record in records])
    assert sum(count for _, _, count, _ in groups) == len(failed)


def test_hopeless_study_is_stopped(study: Path, tmp_path: Path, mbdae: Path, faulty: Path) -> None:
    directory = tmp_path / "out"
    environment = {"PILOTGEN_MBDAE": str(faulty), "REAL_MBDAE": str(mbdae), "MISDEEDS": "exit", "ONE_IN": "1"}
    done = run(*search(study, directory, "--max-failures", "3"), **environment)
    assert done.returncode == 1
    assert "4 pilots failed, more than --max-failures 3" in done.stderr
    assert "ended with exit code 3" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert recorded(directory) == 4


# ---- disk


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 600 kB; skipped where mounting is not allowed."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=600k", "tmpfs", str(place)], capture_output=True, check=False
    )
    if mounted.returncode != 0:
        pytest.skip("mounting a small file system is not allowed here")
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


def test_full_disk_is_told_and_loses_nothing(mayo: Path, mayo_undisturbed: Path, small_disk: Path) -> None:
    directory = small_disk / "out"
    done = run(*search(mayo, directory))
    assert done.returncode == 1
    assert "the disk is full; free some space and run again with --resume" in done.stderr
    assert "Traceback" not in done.stderr
    kept = recorded(directory)
    assert kept > 20
    subprocess.run(["mount", "-o", "remount,size=50m", str(small_disk)], check=True)
    done = run(*search(mayo, directory, "--resume"))
    assert done.returncode == 0, done.stderr
    assert int(re.search(r"\((\d+) from the journal\)", done.stdout)[1]) >= kept  # type: ignore[index]
    assert_same(directory, mayo_undisturbed)


def test_read_only_directory_is_told(tmp_path: Path, small_disk: Path) -> None:
    study = small_study(tmp_path, "puma-mayo.yaml", 8, 2)
    directory = small_disk / "out"
    assert run(*search(study, directory)).returncode == 0
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    for arguments in (search(study, directory, "--resume"), search(study, small_disk / "other")):
        done = run(*arguments)
        assert done.returncode == 1
        assert "choose a directory you can write to" in done.stderr or "read-only" in done.stderr.lower()
        assert len(done.stderr.strip().splitlines()) == 1


def test_damaged_journal_is_told(tmp_path: Path) -> None:
    study = small_study(tmp_path, "puma-mayo.yaml", 30, 6)
    directory = tmp_path / "out"
    assert run(*search(study, directory)).returncode == 0
    path = directory / JOURNAL_NAME
    data = path.read_bytes()
    for damage in (data[: len(data) // 2], b"\0" * 100 + data[100:], data[:4096] + b"\xa5" * (len(data) - 4096)):
        path.write_bytes(damage)
        done = run(*search(study, directory, "--resume"))
        assert done.returncode == 1
        assert "the journal is damaged" in done.stderr
        assert "move it aside" in done.stderr
        assert len(done.stderr.strip().splitlines()) == 1
    shutil.move(path, directory / "journal.damaged")
    assert run(*search(study, directory, "--resume")).returncode == 0


# ---- for a long time


MEMORY = """
import os
import sys
from pilotgen.context import EvaluationContext
from pilotgen.evaluation import evaluate
from pilotgen.runs.memory import resident_bytes
from pilotgen.study.study import read_study

study = read_study(sys.argv[1])
values = study.values({"age_years": 40.0, "bmi": 24.0, "stature_m": 1.7})
with EvaluationContext(study) as context:
    for k in range(360):
        if k == 60:
            before = resident_bytes(os.getpid())
        evaluate(context, {**values, "stature_m": 1.7 + 1e-4 * k})
    print(resident_bytes(os.getpid()) - before)
"""


def test_memory_of_a_worker_stays_flat(study: Path) -> None:
    """In a process of its own: what other tests left in this one comes and goes."""
    done = subprocess.run([sys.executable, "-c", MEMORY, study], capture_output=True, text=True, check=True)
    assert int(done.stdout) < 3e6  # a leak of one matrix pair in ten pilots would be 5 MB


def test_finished_study_can_be_read(undisturbed: Path) -> None:
    results = read_results(undisturbed / "study.h5")
    assert (results.columns["status"] == "ok").all()
