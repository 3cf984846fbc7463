"""Commands that evaluate many pilots: resumed, extended, gated, told, and what stops them.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
from pathlib import Path

import pytest
from command_line import MAYO, QUICK, Run, changed, refused

from pilotgen.solver.client import find_mbdae


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


def test_a_solver_that_cannot_run_is_found_out_before_a_search(run: Run, tmp_path: Path) -> None:
    for command in (["search"], ["sample", "-n", "8"]):
        code, out, err = run(*command, QUICK, "-o", tmp_path / "out", "--mbdae", "/bin/true")
        assert (code, out) == (2, "")
        assert "ended with exit code 0" in err
        assert not (tmp_path / "out").exists()


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
    refused(run("table", tmp_path / "nothing"), "nothing does not exist; a search or a sample leaves it")
    assert run("table", tmp_path / "out", "-o", tmp_path / "by-name.json")[0] == 0
    assert json.loads((tmp_path / "by-name.json").read_text())


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
    from pilotgen.context import EvaluationContext
    from pilotgen.runs.journal import JOURNAL_NAME, Journal

    begin = EvaluationContext.__init__

    def without_scratch(self, *args, **kwargs):  # type: ignore[no-untyped-def]
        begin(self, *args, **kwargs)
        os.rmdir(self.scratch)

    monkeypatch.setattr(EvaluationContext, "__init__", without_scratch)
    refused(
        run("sample", QUICK, "-n", "8", "-o", tmp_path / "out", "--workers", "1", "--quiet"),
        "pilotgen-scratch-.* was removed or emptied while it was in use; nothing that was at work is recorded",
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


@pytest.mark.parametrize(
    ("address", "expected"),
    [
        ("tcp://head:8786", True), ("head:8786", True), ("tcp://10.0.0.3:8786", True), ("tcp://[fe80::1]:8786", True),
        ("tls://head:8786", False), ("tcp://127.0.0.1:8786", False),
        ("localhost:8786", False), ("tcp://[::1]:8786", False),
    ],
)  # fmt: skip
def test_schedulers_that_anybody_may_use_are_told(address: str, expected: bool) -> None:
    from pilotgen.runs.session import is_open

    assert is_open(address) is expected


def test_a_template_that_is_missing_is_found_before_the_search(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pilotgen.decks.text import template_directory
    from pilotgen.report import assets

    data = shutil.copytree(assets.DATA, tmp_path / "data")
    (data / "report" / "base.html.j2").unlink()
    monkeypatch.setattr(assets, "DATA", data)
    search = ("search", MAYO, "-o", tmp_path / "out", "--workers", "1", "--quiet")
    refused(
        run(*search), r"base\.html\.j2: cannot be read \(No such file or directory\); this installation is incomplete"
    )
    decks = shutil.copytree(template_directory(), tmp_path / "decks")
    (decks / "arm.mbd.j2").unlink()
    monkeypatch.setattr("pilotgen.runs.fingerprint.template_directory", lambda: decks)
    refused(run("sample", QUICK, "-n", "4", "-o", tmp_path / "out"), r"arm\.mbd\.j2: cannot be read .*install it again")
    assert not (tmp_path / "out").exists()
