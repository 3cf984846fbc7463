"""The command line: every mistake gives one clear message, the right exit code, no traceback, nothing half-written."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from pilotgen.cli import COMMANDS, EXIT_CODES, main
from pilotgen.runs.batch import replay_command
from pilotgen.solver.client import find_mbdae

STUDIES = Path(__file__).parents[2] / "docs" / "studies"
QUICK = STUDIES / "quick.yaml"
MAYO = STUDIES / "puma-mayo.yaml"

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run a command line in this process; returns exit code, standard output, standard error."""
    monkeypatch.delenv("PILOTGEN_DEBUG", raising=False)

    def call(*arguments: object) -> tuple[int, str, str]:
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as leave:
            code = int(leave.code or 0)
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


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


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example(run: Run, command: str) -> None:
    code, out, _ = run(command, "--help")
    assert code == 0
    assert f"pilotgen {command} " in out.split("example:")[1]
    code, out, _ = run(command, "--version")
    assert code == 0
    assert re.fullmatch(r"pilotgen \d+\.\d+\.\d+\n", out)


def test_version_and_wrong_command_lines(run: Run) -> None:
    assert run("--version")[0] == 0
    for arguments in (
        ["bounce"],
        ["pilot"],
        ["search", QUICK, "--workers", "0", "-o", "x"],
        ["sample", QUICK, "-n", "x", "-o", "d"],
    ):
        code, out, err = run(*arguments)
        assert (code, out) == (1, "")
        assert "error:" in err and "--help" in err


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


def test_a_pilot_that_fails_is_a_result(run: Run, tmp_path: Path) -> None:
    out_of_reach = "cockpit: {collective: {grip_m: [0.95, 0.255, -0.25]}}\nnominal:"
    study = changed(tmp_path, "nominal:", out_of_reach)
    code, out, err = run("pilot", study, "-o", tmp_path / "out")
    assert code == 2 and out == ""
    assert re.match(r"pilotgen: failed: posture: .*reach", err)
    assert '"stage": "posture"' in (tmp_path / "out" / "result.json").read_text()
    code, out, err = run("search", study, "-o", tmp_path / "all", "--workers", "1", "--no-report", "--quiet")
    assert code == 2
    assert "36 evaluations (0 from the journal), 36 failed" in out
    assert re.search(r"36 failed at posture, e\.g\. .*\n    again with: pilotgen pilot .* --set age_years=", out)
    refused(
        run("search", study, "-o", tmp_path / "few", "--workers", "1", "--max-failures", "3", "--quiet"),
        "--max-failures 3",
    )


def test_search_end_to_end_resumed_and_served(run: Run, tmp_path: Path) -> None:
    code, out, err = run("search", QUICK, "-o", tmp_path / "a", "--workers", "1000", "--no-report")
    assert code == 0, err
    assert "worst pilots" in out
    assert "generation 3/3" in err
    refused(run("search", QUICK, "-o", tmp_path / "a"), "already holds a study", "--resume")
    before = (tmp_path / "a" / "study.h5").read_bytes()
    code, out, _ = run("search", QUICK, "-o", tmp_path / "a", "--workers", "1", "--resume", "--no-report")
    assert code == 0
    assert "36 evaluations (36 from the journal)" in out
    assert (tmp_path / "a" / "study.h5").read_bytes() == before
    other = changed(tmp_path, "population: 12", "population: 14")
    refused(run("search", other, "-o", tmp_path / "a", "--resume"), "differs from in what determines its evaluations")


def test_sample_end_to_end(run: Run, tmp_path: Path) -> None:
    code, out, err = run("sample", MAYO, "-n", "50", "-o", tmp_path / "a", "--workers", "1")
    assert code == 0, err
    assert out.startswith("50 pilots (0 from the journal), 0 failed")
    code, out, _ = run("sample", MAYO, "-n", "80", "-o", tmp_path / "a", "--workers", "1", "--resume")
    assert out.startswith("80 pilots (50 from the journal), 0 failed")  # a longer sample begins with the shorter one


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


def test_a_solver_that_cannot_run_is_found_out_before_a_search(run: Run, tmp_path: Path) -> None:
    for command in (["search"], ["sample", "-n", "8"]):
        code, out, err = run(*command, QUICK, "-o", tmp_path / "out", "--mbdae", "/bin/true")
        assert (code, out) == (2, "")
        assert "ended with exit code 0" in err
        assert not (tmp_path / "out").exists()


def test_commands_that_are_given_again_can_be_pasted() -> None:
    text = replay_command("my study's.yaml", {"bmi": 20.5})
    assert shlex.split(text) == ["pilotgen", "pilot", "my study's.yaml", "-o", "replay", "--set", "bmi=20.5"]


def test_report_again(run: Run, tmp_path: Path) -> None:
    study = changed(tmp_path, "population: 100", "population: 8", MAYO)
    done = tmp_path / "done"
    assert run("search", study, "-o", done, "--workers", "1", "--quiet", "--no-report")[0] == 0
    assert not (done / "report.html").exists()
    assert run("report", done, "--no-evaluations") == (0, f"report: {done / 'report.html'}\n", "")
    assert (done / "report.html").is_file()


def test_report_of_what_is_no_study(run: Run, tmp_path: Path) -> None:
    refused(run("report", tmp_path), r"study\.h5 does not exist")
    refused(run("report", tmp_path / "none"), r"study\.h5 does not exist")
    (tmp_path / "study.h5").write_text("nonsense")
    refused(run("report", tmp_path), r"study\.h5")


def test_an_ascii_terminal_is_no_reason_to_fail() -> None:
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    command = [sys.executable, "-m", "pilotgen", "pilot", "caf\u00e9.yaml", "-o", "x"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith(r"pilotgen: error: caf\xe9.yaml: no such file")


@pytest.mark.parametrize("buffered", [True, False])
def test_a_full_disk_behind_standard_output(tmp_path: Path, buffered: bool) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    if not buffered:
        environment["PYTHONUNBUFFERED"] = "1"
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "pilotgen", "pilot", str(MAYO), "-o", str(tmp_path / "out"), "--no-figures"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False, env=environment)
    assert done.returncode == 1
    assert done.stderr == "pilotgen: error: standard output or a file: No space left on device\n"


def test_exit_codes_are_those_of_the_page() -> None:
    page = (Path(__file__).parents[2] / "docs" / "exit_codes.md").read_text()
    rows = re.findall(r"^\| (\d+) \| (.*) \|$", page, flags=re.MULTILINE)
    assert {int(code): meaning for code, meaning in rows} == EXIT_CODES


def test_a_front_that_cannot_be_left_is_no_success(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A pilot of the front who fails when his decks are written: told on screen, in the report, by the code."""
    from pilotgen.evaluation import FailedEvaluation
    from pilotgen.report import decks

    evaluate = decks.evaluate

    def fails_once(context, values, keep=None):  # type: ignore[no-untyped-def]
        if keep is not None and keep.name == "01":
            return FailedEvaluation(dict(values), "solver", "mbdae is gone")
        return evaluate(context, values, keep=keep)

    monkeypatch.setattr(decks, "evaluate", fails_once)
    study = changed(tmp_path, "generations: 3", "generations: 1")
    code, out, err = run("search", study, "-o", tmp_path / "out", "--workers", "1", "--quiet")
    assert code == 4
    assert "worst pilots" in out
    report = tmp_path / "out" / "report.html"
    assert err == f"pilotgen: incomplete: {report} is written, but front/01 failed at solver: mbdae is gone\n"
    assert "front/01 failed at solver" in (tmp_path / "out" / "report.html").read_text()


def test_fail_below_the_limits_of_the_study(run: Run, tmp_path: Path) -> None:
    study = changed(tmp_path, "population: 100", "population: 8", MAYO)
    options = ("--workers", "1", "--quiet", "--no-report", "--fail-below")
    code, out, err = run("search", study, "-o", tmp_path / "search", *options)
    assert code == 5 and "worst pilots" in out
    assert re.search(r"pilotgen: below limits: [0-9]+ pilots have a gain margin below 6.00 dB; the smallest is ", err)
    study.write_text(study.read_text() + "\nlimits: {gain_margin_db: 0.5, phase_margin_deg: null}\n")
    pilot = ("pilot", study, "--no-figures", "--fail-below", "-o")
    assert run(*pilot, tmp_path / "stable")[::2] == (0, "")
    shaky = ("pilot_frequency_hz=2.5", "pilot_damping=0.2", "pilot_time_constant_s=0.06")
    code, _, err = run(*pilot, tmp_path / "unstable", "--set", *shaky)
    assert code == 5
    assert err.splitlines() == [
        "pilotgen: below limits: the closed loop is unstable",
        "pilotgen: below limits: gain margin -4.50 dB is below 0.50 dB",
    ]
    result = json.loads((tmp_path / "unstable" / "result.json").read_text())
    assert result["provenance"]["solver_version"] == "none" and result["provenance"]["deck_sha256"] is None
    assert result["provenance"]["study_sha256"] == hashlib.sha256(study.read_bytes()).hexdigest()
    assert any("Mayo measured two groups" in sentence for sentence in result["caveats"])


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


@pytest.mark.parametrize(
    ("options", "pattern"),
    [
        (["--scheduler", "tcp://host:8786"], "--scheduler is for --executor dask"),
        (["--executor", "dask", "--scheduler", "tcp://host:8786", "--workers", "2"], "--workers does nothing"),
        (["--retry-failed"], "--retry-failed is for --resume"),
        (["--mbdyn", "/usr/bin/mbdyn"], "--mbdyn is for --solver mbdyn"),
    ],
)
def test_options_that_would_do_nothing_are_refused(run: Run, tmp_path: Path, options: list[str], pattern: str) -> None:
    for command in (["search"], ["sample", "-n", "8"]):
        refused(run(*command, MAYO, "-o", tmp_path / "out", *options), pattern)
    assert not (tmp_path / "out").exists()


def test_a_study_goes_on_with_what_may_change(run: Run, tmp_path: Path) -> None:
    """Comments, names, limits, more generations: what is recorded is served; another seed keeps the old study.h5."""
    study = changed(tmp_path, "population: 100", "population: 8", MAYO)
    study.write_text(study.read_text().replace("generations: 30", "generations: 2"))
    out = tmp_path / "out"
    search = ("search", study, "-o", out, "--workers", "1", "--quiet", "--no-report")
    assert run(*search)[0] == 0
    text = "# a comment\n" + study.read_text().replace("study: puma-mayo", "study: renamed")
    study.write_text(text.replace("generations: 2", "generations: 3") + "\nlimits: {gain_margin_db: 3}\n")
    code, told, err = run(*search, "--resume")
    assert code == 0 and "24 evaluations (16 from the journal)" in told
    assert err.splitlines() == [
        f"pilotgen: note: {change} since this study was begun"
        for change in ("study 'puma-mayo' -> 'renamed'", "limits.gain_margin_db 6 -> 3", "search.generations 2 -> 3")
    ]
    code, told, err = run(*search, "--extend", "2")
    assert (code, err) == (0, "") and "40 evaluations (24 from the journal)" in told
    assert "40 evaluations (40 from the journal)" in run(*search, "--resume")[1]  # and they stay
    other = tmp_path / "other.yaml"
    other.write_text(study.read_text().replace("seed: 1", "seed: 2"))
    before = (out / "study.h5").read_bytes()
    code, _, err = run("search", other, *search[2:], "--resume")
    assert code == 0 and "search.seed 1 -> 2" in err and "kept as study.h5.old-1" in err
    assert (out / "study.h5.old-1").read_bytes() == before


def test_what_may_not_change_is_told_in_a_table(run: Run, tmp_path: Path) -> None:
    study = changed(tmp_path, "population: 100", "population: 8", MAYO)
    out = tmp_path / "out"
    search = ("-o", out, "--workers", "1", "--quiet")
    assert run("sample", study, "-n", "4", *search)[0] == 0
    other = tmp_path / "other.yaml"
    other.write_text(
        study.read_text().replace("gearing_rad_per_m: 1.1", "gearing_rad_per_m: 1.2").replace("2.5, 4.0", "2.5, 4.5")
    )
    result = run("sample", other, "-n", "8", *search, "--resume")
    refused(result, "differs from in what determines")
    rows = [line.split() for line in result[2].splitlines()[1:4]]
    assert rows == [
        ["key", "there", "now"],
        ["inceptor.gearing_rad_per_m", "1.1", "1.2"],
        ["search.variables.pilot_frequency_hz", "[2.5,", "4]", "[2.5,", "4.5]"],
    ]
    # the journal may be lost: study.h5 still tells
    for path in out.glob("journal.sqlite*"):
        path.unlink()
    refused(run("sample", other, "-n", "8", *search, "--resume"), "differs from in what determines")
    code, told, err = run("sample", study, "-n", "8", *search, "--resume")
    assert code == 0 and "8 pilots (0 from the journal)" in told and "holds no evaluations" in err
    refused(run("search", study, *search, "--extend", "3"), "already holds a study")


def test_evaluations_that_cannot_be_used_are_announced(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = changed(tmp_path, "population: 100", "population: 8", MAYO)
    sample = ("sample", study, "-n", "4", "-o", tmp_path / "out", "--workers", "1", "--quiet")
    assert run(*sample)[0] == 0
    monkeypatch.setattr("pilotgen.runs.session.fingerprint", lambda *_: "another program")
    code, out, err = run(*sample, "--resume")
    assert code == 0 and "4 pilots (0 from the journal)" in out
    assert "note: 4 recorded evaluations of another version of code, data or solver cannot be used" in err


def test_table_for_other_programs(run: Run, tmp_path: Path) -> None:
    import csv

    from pilotgen.runs.results import read_results

    assert run("sample", QUICK, "-n", "3", "-o", tmp_path / "out", "--workers", "1", "--quiet")[0] == 0
    columns = read_results(tmp_path / "out" / "study.h5").columns
    code, out, _ = run("table", tmp_path / "out")
    rows = list(csv.DictReader(out.splitlines()))
    assert code == 0 and len(rows) == 3
    for name in ("gain_margin_db", "elbow_flexion_deg", "grip_motion_3hz_mm_per_m_s2"):
        assert [float(row[name]) for row in rows] == columns[name].tolist()
    assert {row["sex"] for row in rows} == {"male"} and {row["phase_margin_deg"] for row in rows} == {"inf"}
    assert float(rows[0]["pole_frequency_hz_1"]) == columns["pole_frequency_hz"][0, 0]
    file = tmp_path / "table.json"
    assert run("table", tmp_path / "out" / "study.h5", "--format", "json", "-o", file) == (0, "", "")
    found = json.loads(file.read_text())
    assert found["evaluations"]["gain_margin_db"] == columns["gain_margin_db"].tolist()
    assert found["evaluations"]["phase_margin_deg"] == [None] * 3
    refused(run("table", tmp_path / "out", "-o", file), "exists; choose another file")
    refused(run("table", tmp_path / "out", "--format", "parquet"), "name a file with -o")
    refused(run("table", tmp_path / "nothing"), "cannot be read as HDF5")


def test_log_and_status_of_a_search(run: Run, tmp_path: Path) -> None:
    study = changed(tmp_path, "population: 100", "population: 8", MAYO)
    log = tmp_path / "log.jsonl"
    options = ("--workers", "1", "--quiet", "--no-report", "--log", log)
    assert run("search", study, "-o", tmp_path / "out", *options)[0] == 0
    events = [json.loads(line) for line in log.read_text().splitlines()]
    assert events[0]["event"] == "start" and events[0]["study"] == "puma-mayo"
    assert events[-1]["event"] == "end" and events[-1]["how"] == "done"
    code, out, _ = run("status", tmp_path / "out")
    assert code == 0 and out.startswith("search finished\n") and "0 failed" in out
    status = json.loads(run("status", tmp_path / "out", "--json")[1])
    assert status["state"] == "finished" and status["evaluations"] == events[-1]["done"]
    refused(run("status", tmp_path), "holds no study")


def test_a_scratch_directory_that_is_gone_is_no_failure_of_a_pilot(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What any pilot would meet stops the run: nothing is recorded as failed."""
    from pilotgen.evaluation import EvaluationContext
    from pilotgen.runs.journal import JOURNAL_NAME, Journal

    begin = EvaluationContext.__init__

    def without_scratch(self, *args, **kwargs):  # type: ignore[no-untyped-def]
        begin(self, *args, **kwargs)
        os.rmdir(self.scratch)

    monkeypatch.setattr(EvaluationContext, "__init__", without_scratch)
    refused(
        run("sample", QUICK, "-n", "8", "-o", tmp_path / "out", "--workers", "1", "--quiet"),
        "cannot be handed to the solver .No such file or directory.; check space in the directory for temporary files",
    )
    with Journal(tmp_path / "out" / JOURNAL_NAME) as journal:
        assert len(journal) == 0


def test_an_output_directory_that_is_full_is_no_failure_of_the_pilot(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pilotgen.errors import SolverError
    from pilotgen.solver.client import SolverClient

    request = SolverClient.request

    def full(self, task, **options):  # type: ignore[no-untyped-def]
        if str(options.get("output", "")).endswith("matrices.h5"):
            raise SolverError("solver", f"cannot write '{options['output']}': No space left on device")
        return request(self, task, **options)

    monkeypatch.setattr(SolverClient, "request", full)
    refused(
        run("pilot", QUICK, "-o", tmp_path / "out"),
        "error: cannot write '.*matrices.h5': No space left on device; check",
    )
    assert not (tmp_path / "out" / "result.json").exists()


def test_pilotgen_alone_prints_help(run: Run) -> None:
    code, out, err = run()
    assert (code, err) == (0, "") and out.startswith("usage: pilotgen")
    assert run("-V") == run("--version")


@pytest.mark.parametrize(
    ("arguments", "patterns"),
    [
        (["serach", "x.yaml"], ["'serach' is not known; did you mean 'search'?", "Try 'pilotgen --help'"]),
        (
            ["search", QUICK, "-o", "x", "--worker-count", "2"],
            ["unknown arguments: --worker-count 2", "Try 'pilotgen search --help'"],
        ),
        (["pilot", QUICK, "-o", "x", "--solver", "mbdae2"], ["did you mean 'mbdae'?", "Try 'pilotgen pilot --help'"]),
        (["sample", QUICK, "-n", "4", "-o", "x", "--seed", "9" * 23], ["too large for a seed"]),
        (["identify", QUICK, "-o", "x", "--seed", "-1"], ["-1 is negative"]),
    ],
)
def test_slips_on_the_command_line_get_a_hint(run: Run, arguments: list[object], patterns: list[str]) -> None:
    code, out, err = run(*arguments)
    assert (code, out) == (1, "")
    assert all(pattern in err for pattern in patterns), err


def test_an_algorithm_that_is_not_installed_is_found_out_first(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    study = changed(tmp_path, "seed: 1", "seed: 1\n  algorithm: nsga2")
    refused(run("search", study, "-o", tmp_path / "out"), r"needs the package pymoo; .*pilotgen\[search\]")
    assert not (tmp_path / "out").exists()


def test_a_solver_for_pilots_without_a_deck_is_refused(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "out"
    for command in (["pilot"], ["search"], ["sample", "-n", "4"]):
        refused(run(*command, MAYO, "-o", out, "--mbdae", find_mbdae()), "do nothing for pilot.model = 'mayo'")
    assert not out.exists()
    assert run("sample", MAYO, "-n", "4", "-o", out, "--workers", "1", "--quiet")[0] == 0
    refused(run("report", out, "--solver", "mbdyn"), "do nothing for pilot.model = 'mayo'")
    refused(run("report", out, "--no-evaluations", "--solver", "mbdyn"), "do nothing with --no-evaluations")
