"""examples, completion, check, backup: what they tell, leave, and refuse.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import processes
import pytest
from command_line import MAYO, QUICK, STUDIES, Run, changed, refused

from pilotgen.output import OWN_NAMES
from pilotgen.runs.journal import JOURNAL_NAME
from pilotgen.study.study import read_study


def test_examples_are_listed_and_copied_with_the_files_they_name(run: Run, tmp_path: Path) -> None:
    code, out, _ = run("examples")
    assert code == 0
    assert [line.split()[0] for line in out.splitlines()] == sorted(path.stem for path in STUDIES.glob("*.yaml"))
    assert run("examples", "puma-bending", "-o", tmp_path / "new" / "mine.yaml")[0] == 0
    assert read_study(tmp_path / "new" / "mine.yaml").name == "puma-bending"
    refused(run("examples", "puma-bending", "-o", tmp_path / "new" / "other.yaml"), "puma-bending-plant.json exists")
    assert not (tmp_path / "new" / "other.yaml").exists()
    refused(run("examples", "quikc"), "did you mean 'quick'")
    refused(run("examples", "-o", tmp_path / "x.yaml"), "name it, or all")
    assert run("examples", "all", "-o", tmp_path / "all")[0] == 0
    assert {path.name for path in (tmp_path / "all").glob("*.yaml")} == {path.name for path in STUDIES.glob("*.yaml")}


def test_completion_knows_commands_and_files(run: Run) -> None:
    code, out, _ = run("completion", "bash")
    assert code == 0 and "check-mbdyn" in out and "--retry-failed" in out and "_shtab_compgen_files" in out
    assert subprocess.run(["bash", "-n"], input=out, text=True, check=False).returncode == 0


def test_check_tells_what_would_be_done_and_writes_nothing(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "out"
    code, told, err = run("check", QUICK, "-o", out, "--workers", "1")
    assert (code, err) == (0, "") and not out.exists()
    assert "3 generations of 12, at most, 36 evaluations" in told and "solver    mbdae" in told
    # In a process of its own, as people run it: what other tests left in this one is not the command's.
    found = json.loads(processes.run("check", QUICK, "-n", "5000", "--workers", "1", "--json").stdout)
    assert found["kind"] == "sample" and found["evaluations"] == 5000 and found["nominal"] == "evaluated"
    assert 1e-3 < found["seconds_per_pilot"] < found["seconds"] < 5000
    assert 5e7 < found["memory_bytes"] < 5e8 and 1e7 < found["disk_bytes"] < 1e8


def test_check_finds_a_place_that_cannot_be_made(run: Run, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    refused(run("check", MAYO, "-o", tmp_path / "file" / "x"), r"cannot be made \(Not a directory\)")


def test_links_that_lead_nowhere_are_not_replaced(run: Run, tmp_path: Path) -> None:
    link = tmp_path / "link"
    link.symlink_to("link")
    (tmp_path / "study.h5").touch()
    refused(run("table", tmp_path, "-o", link), "exists; choose another file")
    refused(run("export", tmp_path, "-o", link), "exists; choose another file")
    assert link.is_symlink()


def test_the_memory_foreseen_leaves_out_what_a_session_had_before(run: Run) -> None:
    def foreseen() -> int:
        return int(json.loads(run("check", QUICK, "--workers", "1", "--json")[1])["memory_bytes"])

    before = foreseen()
    had = np.ones(50_000_000)  # 400 MB
    with_it = foreseen()
    del had
    assert with_it > before + 7e8  # two processes, each with what the session holds
    assert abs(foreseen() - before) < 2e8


def test_check_is_stopped_by_what_would_stop_the_run(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    assert run("sample", MAYO, "-n", "4", "-o", out, "--workers", "1", "--quiet")[0] == 0
    before = {path: path.stat().st_mtime_ns for path in out.iterdir() if path.name not in OWN_NAMES}
    refused(run("check", MAYO, "-n", "8", "-o", out), "already holds a study; add --resume")
    assert "4 of them recorded already" in run("check", MAYO, "-n", "8", "-o", out, "--resume")[1]
    other = changed(tmp_path, "gearing_rad_per_m: 1.1", "gearing_rad_per_m: 1.2", MAYO)
    refused(run("check", other, "-n", "8", "-o", out, "--resume"), "inceptor.gearing_rad_per_m +1.1 +1.2")
    refused(run("check", MAYO, "-o", tmp_path / "study.yaml"), "is a file")
    refused(run("check", MAYO, "--resume"), "--resume is for -o DIR")
    assert {path: path.stat().st_mtime_ns for path in out.iterdir() if path.name not in OWN_NAMES} == before
    out_of_reach = changed(
        tmp_path, "nominal:", "cockpit: {collective: {grip_m: [0.95, 0.255, -0.25]}}\nnominal:", QUICK
    )
    code, _, err = run("check", out_of_reach)
    assert code == 0 and "note: the nominal pilot fails at posture" in err
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    refused(run("check", changed(tmp_path, "seed: 1", "seed: 1\n  algorithm: nsga2")), "needs the package pymoo")


def test_a_running_study_is_backed_up_whole(run: Run, tmp_path: Path) -> None:
    """What is recorded when the copy is made is in it, although journal.sqlite alone would not have it."""
    out, copy = tmp_path / "out", tmp_path / "copy"
    process = processes.start("sample", MAYO, "-n", "20000", "-o", out, "--workers", "1", "--quiet")
    try:
        processes.wait_until(lambda: processes.recorded(out) >= 50, "fifty pilots")
        at_least = processes.recorded(out)
        code, told, err = run("backup", out, "-o", copy)
        assert (code, err) == (0, ""), err
        assert int(told.rsplit(":")[1].split()[0]) >= at_least
        assert process.poll() is None, "the study goes on"
    finally:
        process.terminate()
        process.communicate(timeout=60)
    shutil.rmtree(out)
    code, told, _ = run("sample", MAYO, "-n", str(at_least), "-o", copy, "--workers", "1", "--quiet", "--resume")
    assert code == 0 and f"{at_least} pilots ({at_least} from the journal)" in told
    refused(run("backup", copy, "-o", copy), "in the study's own directory")
    refused(run("backup", tmp_path, "-o", tmp_path / "c"), "holds no study")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine").touch()
    refused(run("backup", copy, "-o", tmp_path / "full"), "no empty directory")
    assert not (tmp_path / "c").exists() and (copy / JOURNAL_NAME).exists()
