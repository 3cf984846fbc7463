"""The edge of the program: help, slips, exit codes, standard streams, signals.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import io
import json
import os
import re
import resource
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from command_line import MAYO, QUICK, Run, changed

from pilotgen.cli import COMMANDS, EXIT_CODES
from pilotgen.terminal import SafeStream


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


def test_an_ascii_terminal_is_no_reason_to_fail() -> None:
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    command = [sys.executable, "-m", "pilotgen", "pilot", "caf\u00e9.yaml", "-o", "x"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith(r"pilotgen: error: caf\xe9.yaml: no such file")


def test_a_limit_of_address_space_is_told_at_once(tmp_path: Path) -> None:
    """From 150 to 300 MB OpenBLAS sometimes never came back: it asks for ever for what it does not get."""
    for megabytes in (150, 160, 250, 300):
        limit = (megabytes << 20, megabytes << 20)
        done = subprocess.run(
            [sys.executable, "-m", "pilotgen", "pilot", str(tmp_path / "none.yaml"), "-o", str(tmp_path / "o")],
            capture_output=True, text=True, timeout=60, check=False,
            preexec_fn=lambda limit=limit: resource.setrlimit(resource.RLIMIT_AS, limit),
        )  # fmt: skip
        assert done.returncode == 1 and "error: out of memory" in done.stderr, (megabytes, done.stderr)


@pytest.mark.parametrize("buffered", [True, False])
def test_a_full_disk_behind_standard_output(tmp_path: Path, buffered: bool) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    if not buffered:
        environment["PYTHONUNBUFFERED"] = "1"
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "pilotgen", "pilot", str(MAYO), "-o", str(tmp_path / "out"), "--no-figures"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False, env=environment)
    assert done.returncode == 1
    assert done.stderr == "pilotgen: error: standard output: No space left on device\n"


def test_exit_codes_are_those_of_the_page() -> None:
    page = (Path(__file__).parents[2] / "docs" / "exit_codes.md").read_text()
    rows = re.findall(r"^\| (\d+) \| (.*) \|$", page, flags=re.MULTILINE)
    assert {int(code): meaning for code, meaning in rows} == EXIT_CODES


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


def finished(*arguments: object, shell: str = "", **environment: str) -> subprocess.CompletedProcess[bytes]:
    """A command line run by a shell, with redirections."""
    command = shlex.join([sys.executable, "-m", "pilotgen", *map(str, arguments)])
    return subprocess.run(
        ["bash", "-c", f"{command} {shell}"], capture_output=True, check=False, env={**os.environ, **environment}
    )


def test_closed_streams_end_nothing(tmp_path: Path) -> None:
    """What is printed goes nowhere; files, exit codes and the other stream are as ever."""
    done = finished("pilot", MAYO, "-o", tmp_path / "a", "--no-figures", shell=">&-")
    assert (done.returncode, done.stderr) == (0, b"") and (tmp_path / "a" / "result.json").is_file()
    done = finished("pilot", tmp_path / "none.yaml", "-o", tmp_path / "b", shell="2>&-")
    assert (done.returncode, done.stdout) == (1, b"")
    done = finished("sample", MAYO, "-n", "4", "-o", tmp_path / "c", "--workers", "1", shell="<&- >&- 2>&-")
    assert done.returncode == 0 and (tmp_path / "c" / "study.h5").is_file()
    done = finished("sample", MAYO, "-n", "4", "-o", tmp_path / "d", "--workers", "1", shell="2>/dev/full")
    assert done.returncode == 0 and done.stdout.startswith(b"4 pilots")
    done = finished("pilot", MAYO, "-o", tmp_path / "e", "--no-figures", shell="| true; exit ${PIPESTATUS[0]}")
    assert (done.returncode, done.stderr) == (0, b"") and (tmp_path / "e" / "pilot_model.h5").is_file()
    done = finished("--help", shell="| head -n 1")
    assert (done.returncode, done.stderr) == (0, b"") and done.stdout.startswith(b"usage")


def test_control_characters_do_not_reach_the_terminal(run: Run, tmp_path: Path) -> None:
    study = changed(tmp_path, "inceptor:", '"\\e]0;owned\\a\\e[2J": 1\n"\\u202eabc": 2\ninceptor:')
    code, out, err = run("pilot", study, "-o", tmp_path / "out")
    assert (code, out) == (1, "") and r"\x1b]0;owned\x07\x1b[2J" in err and r"\u202eabc" in err
    assert not re.search(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202e]", err)
    solver = tmp_path / "mbdae"
    solver.write_text("#!/bin/sh\nread line\nprintf '\\033[31mred\\b\\b' >&2\nexit 3\n")
    solver.chmod(0o755)
    code, _, err = run("pilot", QUICK, "-o", tmp_path / "bad", "--mbdae", solver)
    assert code == 2 and r"\x1b[31mred\x08\x08" in err and "\x1b" not in err


def test_what_is_printed_is_made_safe() -> None:
    stream = io.StringIO()
    safe = SafeStream(stream)
    print("a\tcaf\u00e9 50\u00a0% \u0394 \x07\x9b\u200b\u2028", file=safe)
    assert stream.getvalue() == "a\tcaf\u00e9 50\u00a0% \u0394 \\x07\\x9b\\u200b\\u2028\n"


@pytest.mark.parametrize(
    ("environment", "coloured"),
    [({"TERM": "xterm"}, True), ({"TERM": "dumb"}, False), ({"TERM": "xterm", "NO_COLOR": "1"}, False)],
)
def test_colour_on_a_terminal_that_takes_it(
    monkeypatch: pytest.MonkeyPatch, environment: dict[str, str], coloured: bool
) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    stream = io.StringIO()
    stream.isatty = lambda: True  # type: ignore[method-assign]
    print("pilotgen: error: the loop is UNSTABLE", file=SafeStream(stream))
    plain = "pilotgen: error: the loop is UNSTABLE\n"
    red = "\x1b[31mpilotgen: error:\x1b[0m the loop is \x1b[31mUNSTABLE\x1b[0m\n"
    assert stream.getvalue() == (red if coloured else plain)
    quiet = io.StringIO()
    print("UNSTABLE", file=SafeStream(quiet))
    assert quiet.getvalue() == "UNSTABLE\n", "not a terminal"


def test_every_command_has_json_and_quiet(run: Run) -> None:
    for command in COMMANDS:
        out = run(command, "--help")[1]
        assert "--json" in out and "--quiet" in out


def test_json_of_commands_that_print_text_otherwise(run: Run, tmp_path: Path) -> None:
    def answer(*arguments: object) -> dict[str, Any]:
        code, out, err = run(*arguments, "--json")
        assert code == 0, err
        found: dict[str, Any] = json.loads(out)
        return found

    options = ("--workers", "1", "--quiet")
    study = changed(tmp_path, "generations: 3", "generations: 1")
    found = answer("search", study, "-o", tmp_path / "search", "--no-report", *options)
    assert found["done"] == 12 and found["worst"][0]["gain_margin_db"] > 0 and found["report"] is None
    assert found["worst"][0]["phase_margin_deg"] is None, "infinite"
    assert answer("sample", MAYO, "-n", "4", "-o", tmp_path / "sample", *options)["evaluated"] == 4
    assert answer("report", tmp_path / "sample", "--no-evaluations")["report"].endswith("report.html")
    assert answer("table", tmp_path / "sample")["attributes"]["kind"] == "sample"
    decks = answer("decks", QUICK, "-o", tmp_path / "decks")["decks"]
    assert [Path(deck).name for deck in decks] == ["posture.mbd", "trim.mbd", "pilot.mbd"]
    assert answer("check-mbdyn", decks[2])["decks"][0]["runs"] is True
    assert run("pilot", QUICK, "-o", tmp_path / "pilot", "--no-figures", "--quiet") == (0, "", "")
    matrices = tmp_path / "pilot" / "matrices.h5"
    assert answer("compare", matrices, matrices)["agree"] is True
    assert run("compare", matrices, matrices, "--quiet") == (0, "", "")
    assert answer("export", tmp_path / "pilot", "-o", tmp_path / "pilot.json")["states"] > 10
    assert len(answer("rotorcraft", "iar330-puma")["poles_rad_s"]) == 3
    assert answer("check", QUICK, "-n", "8", "--workers", "1")["evaluations"] == 8
    assert answer("backup", tmp_path / "sample", "-o", tmp_path / "copy")["evaluations"] == 4
    assert set(answer("examples")) >= {"quick", "puma-bmi"}
