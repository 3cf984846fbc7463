"""One-pilot commands: every mistake gives one clear message, the right exit code, no traceback, nothing half-written.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import hashlib
import json
import shlex
from pathlib import Path

import pytest
from command_line import MAYO, QUICK, Run, changed, refused

from pilotgen.runs.batch import replay_command
from pilotgen.solver.client import find_mbdae


@pytest.mark.parametrize(
    ("old", "new", "patterns"),
    [
        (
            "rotorcraft: iar330-puma",
            "rotorkraft: iar330-puma",
            [r"study\.yaml:\d+", "rotorkraft", "did you mean 'rotorcraft'"],
        ),
        ("inceptor:", "inceptors:", [r"study\.yaml:\d+", "did you mean 'inceptor'"]),
        ("lever_length_m: 0.32, ", "", [r"study\.yaml:\d+", "lever_length_m", "missing"]),
        ("rotorcraft: iar330-puma", "rotorcraft: iar330-pum", [r"study\.yaml:\d+", "iar330-puma"]),
        ("stature_m: 1.775", "stature_m: 1775", [r"study\.yaml:\d+", "1775", "metres"]),
        ("bmi: [18, 30]", "bmi: [30, 18]", [r"study\.yaml:\d+", "swap"]),
        ("bmi: [18, 30]", "bmi: [18, thirty]", [r"study\.yaml:\d+", "thirty", "number"]),
        ("population: 12", "population: twelve", [r"study\.yaml:\d+", "twelve", "whole number"]),
        ("population: 12", "population: -12", [r"study\.yaml:\d+", "-12"]),
        ("sex: male", "sex: mail", [r"study\.yaml:\d+", "male, female"]),
        ("search:", "search: [", [r"study\.yaml:\d+"]),
    ],
)
def test_mistakes_in_the_study_file(run: Run, tmp_path: Path, old: str, new: str, patterns: list[str]) -> None:
    study = changed(tmp_path, old, new)
    output = tmp_path / "out"
    for command in ("pilot", "search", "decks"):
        refused(run(command, study, "-o", output), *patterns)
        assert not output.exists()


def test_missing_and_strange_study_files(run: Run, tmp_path: Path) -> None:
    refused(run("pilot", tmp_path / "none.yaml", "-o", tmp_path / "out"), r"none\.yaml")
    refused(run("pilot", tmp_path, "-o", tmp_path / "out"), "directory")
    (tmp_path / "binary.yaml").write_bytes(b"\x00\xff\xfe\x00")
    refused(run("pilot", tmp_path / "binary.yaml", "-o", tmp_path / "out"), r"binary\.yaml")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("settings", "patterns"),
    [
        (["stature_m=1775"], ["1775", "metres"]),
        (["stature=1.8"], ["stature_m"]),
        (["stature_m"], ["NAME=VALUE"]),
        (["stature_m=tall"], ["tall", "number"]),
        (["mass_kg=80", "bmi=25"], ["exclude each other"]),
        (["bmi=25", "bmi=26"], ["twice"]),
    ],
)
def test_wrong_settings(run: Run, tmp_path: Path, settings: list[str], patterns: list[str]) -> None:
    refused(run("pilot", QUICK, "-o", tmp_path / "out", "--set", *settings), *patterns)
    assert not (tmp_path / "out").exists()


def test_output_directories_that_cannot_be_used(run: Run, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for command in ("pilot", "search", "decks"):
        refused(run(command, QUICK, "-o", tmp_path / "file"), "is a file|cannot be")
        refused(run(command, QUICK, "-o", tmp_path / "file" / "below"), "cannot be")
    refused(run("pilot", QUICK, "-o", "/proc/pilotgen"), "/proc/pilotgen", "choose a directory")
    (tmp_path / "study").mkdir()
    (tmp_path / "study" / "study.h5").write_bytes(b"precious")
    for command in ("pilot", "search", "decks"):
        refused(run(command, QUICK, "-o", tmp_path / "study"), "already holds a study")
    assert (tmp_path / "study" / "study.h5").read_bytes() == b"precious"


def test_missing_solver(run: Run, tmp_path: Path) -> None:
    missing = tmp_path / "mbdae"
    for command in ("pilot", "search", "decks"):
        refused(run(command, QUICK, "-o", tmp_path / command, "--mbdae", missing), "mbdae", "does not exist")
        assert not (tmp_path / command).exists()
    missing.write_text("not a program")
    refused(run("pilot", QUICK, "-o", tmp_path / "out", "--mbdae", missing), "not an executable")


def test_solver_that_dies_is_named_and_the_search_says_so(run: Run, tmp_path: Path) -> None:
    solver = tmp_path / "mbdae"
    solver.write_text("#!/bin/sh\nread line\nkill -SEGV $$\n")
    solver.chmod(0o755)
    code, out, err = run("pilot", QUICK, "-o", tmp_path / "out", "--mbdae", solver)
    assert code == 2 and out == ""
    assert "SIGSEGV" in err and "Traceback" not in err
    assert '"status": "failed"' in (tmp_path / "out" / "result.json").read_text()


def test_solver_that_is_no_solver(run: Run, tmp_path: Path) -> None:
    solver = tmp_path / "mbdae"
    solver.write_text("#!/bin/sh\nwhile read line; do echo hello; done\n")
    solver.chmod(0o755)
    code, _, err = run("pilot", QUICK, "-o", tmp_path / "out", "--mbdae", solver)
    assert code == 2
    assert "protocol error" in err


def test_mbdyn_that_is_not_there(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PILOTGEN_MBDAE", str(find_mbdae()))
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("PILOTGEN_MBDYN", raising=False)
    refused(run("pilot", QUICK, "-o", tmp_path / "out", "--solver", "mbdyn"), "MBDyn is not installed")


def test_decks_of_a_transfer_function_pilot(run: Run, tmp_path: Path) -> None:
    refused(run("decks", MAYO, "-o", tmp_path / "out"), "has no decks")


def test_one_pilot_end_to_end(run: Run, tmp_path: Path) -> None:
    import json

    code, out, err = run("pilot", QUICK, "-o", tmp_path / "out", "--no-figures")
    assert (code, err) == (0, "")
    assert "gain margin" in out and "BDFT" in out
    files = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"posture.mbd", "trim.mbd", "pilot.mbd", "matrices.h5", "result.json", "pilot_model.h5"} <= files
    assert not [name for name in files if name.endswith(".part")]
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["status"] == "ok"
    assert result["bdft"]["certificate"] < 1e-8
    assert 0.0 <= result["activation"]["largest"] <= 1.0
    assert all(pole["damping"] > 0.0 for pole in result["pilot_poles"])
    code, out, _ = run("pilot", QUICK, "-o", tmp_path / "out", "--no-figures", "--json")
    assert code == 0
    assert json.loads(out) == result


def test_decks_end_to_end(run: Run, tmp_path: Path) -> None:
    code, out, _ = run("decks", QUICK, "-o", tmp_path / "out", "--set", "stature_m=1.62")
    assert code == 0
    assert [Path(line).name for line in out.splitlines()] == ["posture.mbd", "trim.mbd", "pilot.mbd"]
    assert all(Path(line).is_file() for line in out.splitlines())


def test_compare_of_strangers(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.h5").write_text("hello")
    refused(run("compare", tmp_path / "a.h5", tmp_path / "b.h5"), "a.h5|b.h5")


def test_output_directories_with_strange_names(run: Run, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for command in ("pilot", "search"):
        refused(run(command, QUICK, "-o", tmp_path / "link"), "is a link to .*nowhere")
        refused(run(command, QUICK, "-o", tmp_path / "caf\udce9"), r"caf\\xe9.*not UTF-8")
    code, _, err = run("decks", QUICK, "-o", tmp_path / "a 'b' é")
    assert (code, err) == (0, "")
    assert {path.name for path in (tmp_path / "a 'b' é").glob("[!.]*")} == {"posture.mbd", "trim.mbd", "pilot.mbd"}


def test_a_solver_named_without_a_directory_is_the_one_here(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "own").write_text(f"#!/bin/sh\nexec {find_mbdae()} $@\n")
    (tmp_path / "own").chmod(0o755)
    monkeypatch.chdir(tmp_path)
    assert run("decks", QUICK, "-o", tmp_path / "out", "--mbdae", "own")[0] == 0


def test_commands_that_are_given_again_can_be_pasted() -> None:
    text = replay_command("my study's.yaml", {"bmi": 20.5})
    assert shlex.split(text) == ["pilotgen", "pilot", "my study's.yaml", "-o", "replay", "--set", "bmi=20.5"]


def test_result_of_a_body_says_what_to_mind(run: Run, tmp_path: Path) -> None:
    code, out, _ = run("pilot", QUICK, "-o", tmp_path / "out", "--no-figures", "--json", "--set", "age_years=65")
    assert code == 0
    result = json.loads(out)
    assert result == json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["caveats"][0].startswith("extrapolated: age 65 years is outside")
    assert any("gain margins are 1.4 dB larger" in sentence for sentence in result["caveats"])
    assert run("pilot", QUICK, "-o", tmp_path / "rigid", "--no-figures", "--set", "pilot.torso.model=rigid")[0] == 0
    result = json.loads((tmp_path / "rigid" / "result.json").read_text())
    assert [sentence for sentence in result["caveats"] if "some 7 dB larger" in sentence]
    deck = (tmp_path / "rigid" / "pilot.mbd").read_bytes()
    assert result["provenance"]["deck_sha256"] == hashlib.sha256(deck).hexdigest()
    assert result["provenance"]["solver_version"].startswith("mbdae ")
