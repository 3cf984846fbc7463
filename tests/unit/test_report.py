"""The report: one self-contained page that says what study.h5 holds.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import base64
import dataclasses
import shlex
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from study_maker import FAILED, mayo_study, write_study

from pilotgen.errors import FileError, IncompleteOutput
from pilotgen.figures.study import Curve
from pilotgen.report import findings, page, write_report
from pilotgen.report.decks import MOST_DECKS, choose_front
from pilotgen.runs.batch import Progress
from pilotgen.runs.monitor import Monitor
from pilotgen.runs.results import StudyResults
from pilotgen.study.settings import apply_settings

PIXEL = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR42mP4DwABAQEAG7buVgAAAABJRU5ErkJggg=="
VOID = {"meta", "img", "br", "hr", "link", "input"}


class Page(HTMLParser):
    """Parses a page; keeps text, tables and addresses; notes tags that do not match."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.mismatches: list[str] = []
        self.addresses: list[str] = []
        self.tags: list[str] = []
        self.words: list[str] = []
        self.cells: dict[str, list[list[str]]] = {}
        self._table = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        values = dict(attrs)
        self.addresses += [values[name] for name in ("src", "href", "action", "data", "srcset") if name in values]
        if tag == "table":
            self._table = values.get("id", "unnamed")
            self.cells[self._table] = []
        if tag == "tr":
            self.cells[self._table].append([])
        if tag in ("td", "th"):
            self.cells[self._table][-1].append("")
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.mismatches.append(tag)

    def handle_data(self, data):
        if self.open and self.open[-1] == "style":
            assert "url(" not in data and "@import" not in data
            return
        if self.open and self.open[-1] == "script":
            return
        self.words.append(data)
        if self.open and {"td", "th"} & set(self.open):
            self.cells[self._table][-1][-1] += data

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


def page_of(directory: Path) -> Page:
    page = Page((directory / "report.html").read_text(encoding="utf-8"))
    assert page.mismatches == [] and page.open == []
    for address in page.addresses:
        assert address.startswith(("data:image/png;base64,", "#")), address
    assert not {"link", "iframe", "object"} & set(page.tags)
    return page


@pytest.fixture(scope="module", autouse=True)
def coarse_pictures() -> Iterator[None]:
    """Nobody looks at these pictures: fewer dots draw faster."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pilotgen.figures.style.DPI", 40)
        yield


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are made but not drawn: these tests read the text."""
    pixel = base64.b64decode(PIXEL)
    monkeypatch.setattr("pilotgen.report.stills.png", lambda figure: pixel)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, StudyResults, Page]:
    """The report of a search over three variables with two failures."""
    directory = tmp_path_factory.mktemp("study")
    study = mayo_study()
    results = write_study(directory, study, failed=(3, 12))
    write_report(directory, study)
    return directory, results, page_of(directory)


def test_page_is_self_contained_and_pictures_are_pictures(made):
    _, _, page = made
    pictures = [address for address in page.addresses if address.startswith("data:")]
    assert len(pictures) == 7
    for picture in pictures:
        assert base64.b64decode(picture.split(",", 1)[1])[:4] == b"\x89PNG"


def test_headline_names_the_worst_pilot_and_margins(made):
    _, results, page = made
    worst = int(findings.worst_order(results)[0])
    # independent of the page's own words: the worst J of the front
    columns = results.columns
    J = np.clip(columns["gain_margin_db"], -60, 60) + np.clip(columns["phase_margin_deg"], -180, 180)
    best_rank = columns["rank"] == 1
    assert J[worst] == J[best_rank].min()
    assert f"The worst pilot has natural frequency {columns['inputs'][worst, 0]:.4g} Hz" in page.text
    assert f"gain margin {columns['gain_margin_db'][worst]:.2f} dB".replace("-", "−") in page.text
    assert "IAR 330 Puma" in page.text
    assert "For comparison, the nominal pilot" in page.text
    assert "gain margin 6.36 dB at 3.9" in page.text  # Mayo's mesomorphic pilot, computed independently
    assert "phase margin none (no crossing of the unit circle)" in page.text


def test_distance_to_the_limits(made):
    _, results, page = made
    worst = int(findings.worst_order(results)[0])
    short = 6.0 - results.columns["gain_margin_db"][worst]
    assert f"the worst pilot misses 6.00 dB by {short:.2f} dB" in page.text


def test_worst_pilots_are_in_order_with_commands_that_mean_the_same_pilot(made):
    _, results, page = made
    rows = page.cells["worst"][1:]
    values, commands = rows[0::2], rows[1::2]
    assert 5 <= len(values) == len(commands) <= 10
    study = mayo_study()
    for value, command in zip(values, commands, strict=True):
        words = shlex.split(command[1])
        assert words[:3] == ["pilotgen", "pilot", "study.yaml"]
        settings = dict(word.split("=") for word in words[words.index("--set") + 1 :])
        _, pilot = apply_settings(study, settings)
        match = (results.columns["inputs"] == [pilot[name] for name in results.names]).all(axis=1)
        row = int(np.flatnonzero(match)[0])
        assert value[1] == f"{results.columns['inputs'][row, 0]:.4g}"
        assert f"{results.columns['gain_margin_db'][row]:.2f}".replace("-", "−") in value


def test_failures_are_grouped_and_escaped(made):
    directory, results, page = made
    _, first, command = page.cells["failure-table"]
    assert first == ["2", "8.3 %", FAILED["stage"], FAILED["reason"]]
    assert "&lt;48 deg&gt; &amp; beyond" in (directory / "report.html").read_text(encoding="utf-8")
    assert f"pilot_frequency_hz={float(results.columns['inputs'][3, 0])!r} " in command[1]


def test_study_text_is_escaped_and_kept_beside(made):
    directory, results, page = made
    assert "<script>alert(1)</script>" in page.text  # as text
    assert (directory / "study.yaml").read_text(encoding="utf-8") == results.attributes["study_text"]


def test_same_study_gives_the_same_bytes(made):
    directory, _, _ = made
    before = (directory / "report.html").read_bytes()
    write_report(directory, mayo_study())
    assert (directory / "report.html").read_bytes() == before


def test_how_the_run_went(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, undrawn: None):
    study = mayo_study()
    write_study(tmp_path, study, failed=(3, 12))
    write_report(tmp_path, study)
    assert "How the run went Not recorded" in page_of(tmp_path).text
    now = [0.0]
    for seconds, memory in ((100.0, 90_000_000), (20.0, 85_000_000)):  # the second one goes on
        monitor = Monitor(tmp_path, clock=lambda: now[0])
        now[0] += seconds
        monitor(Progress(24, evaluated=12, cpu_s=0.6, workers=2, worker_memory_bytes=memory), False)
        monitor.end("done")
    write_report(tmp_path, study)
    text = page_of(tmp_path).text
    assert "runs 2, each going on from the one before" in text
    assert "24 pilots in 2:00 of wall time rate 0.2 pilots per second CPU time per pilot 50 ms, solver included" in text
    assert f"workers 2 in the last run largest worker 90 MB, solver included failed 2 at {FAILED['stage']}" in text
    before = (tmp_path / "report.html").read_bytes()
    write_report(tmp_path, study)
    assert (tmp_path / "report.html").read_bytes() == before


def test_nothing_is_left_over(made):
    directory, _, _ = made
    assert sorted(path.name for path in directory.iterdir()) == ["report.html", "study.h5", "study.yaml"]


@pytest.mark.parametrize("variables", [1, 2])
def test_fewer_variables(tmp_path: Path, variables: int):
    study = mayo_study(variables)
    write_study(tmp_path, study)
    write_report(tmp_path, study)
    page = page_of(tmp_path)
    assert "Who is the worst pilot?" in page.text
    assert "Failures None" in page.text


@pytest.mark.usefixtures("undrawn")
def test_single_evaluation(tmp_path: Path):
    study = mayo_study()
    write_study(tmp_path, study, generations=1, population=1)
    write_report(tmp_path, study)
    page = page_of(tmp_path)
    assert "Nothing can be said about the damping ratio" in page.text
    assert len(page.cells["worst"]) == 3


@pytest.mark.usefixtures("undrawn")
def test_all_failed(tmp_path: Path):
    study = mayo_study()
    write_study(tmp_path, study, failed=range(24))
    write_report(tmp_path, study)
    page = page_of(tmp_path)
    assert "No pilot could be evaluated" in page.text
    assert page.cells["failure-table"][1][0] == "24"
    assert "worst" not in page.cells


@pytest.mark.usefixtures("undrawn")
def test_without_evaluations_nothing_is_evaluated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    study = mayo_study()
    write_study(tmp_path, study)

    def never(*_: object, **__: object) -> None:
        raise AssertionError("evaluated")

    monkeypatch.setattr("pilotgen.report.write.evaluate", never)
    write_report(tmp_path, study, evaluations=False)
    assert "Not drawn" in page_of(tmp_path).text


@pytest.mark.usefixtures("undrawn")
def test_a_sample_has_no_generations(tmp_path: Path):
    study = mayo_study()
    results = write_study(tmp_path, study, generations=1, population=16, kind="sample")
    assert len(results.members) == 0
    write_report(tmp_path, study)
    page = page_of(tmp_path)
    assert "What does the sample say?" in page.text
    assert "first population" not in page.text and "last population" not in page.text


@pytest.mark.usefixtures("undrawn")
def test_another_program_is_noticed(tmp_path: Path):
    import h5py

    study = mayo_study()
    write_study(tmp_path, study)
    with h5py.File(tmp_path / "study.h5", "r+") as file:
        file["evaluations/gain_margin_db"][...] += 0.5
        file.attrs["version"] = (1, 1)  # files of that version have no checksum
    with pytest.raises(IncompleteOutput, match=r"report.html is written, but the worst pilot, evaluated again"):
        write_report(tmp_path, study)
    assert "other margins than in study.h5" in page_of(tmp_path).text


def test_no_report_without_a_study(tmp_path: Path):
    with pytest.raises(FileError, match=r"study\.h5"):
        write_report(tmp_path, mayo_study())
    assert list(tmp_path.iterdir()) == []


# ---- the command


def command(directory: Path, *options: str) -> int:
    from pilotgen.commands import report

    parser = argparse.ArgumentParser()
    report.add_parser(parser.add_subparsers())
    args = parser.parse_args(["report", str(directory), *options])
    return int(args.run(args))


def test_command_writes_the_same_report_again(made, capsys):
    directory, _, _ = made
    before = (directory / "report.html").read_bytes()
    (directory / "report.html").unlink()
    assert command(directory) == 0
    assert capsys.readouterr().out == f"report: {directory / 'report.html'}\n"
    assert (directory / "report.html").read_bytes() == before
    (directory / ".lock").unlink()


def test_command_tells_what_is_missing(tmp_path: Path):
    with pytest.raises(FileError, match="finished"):
        command(tmp_path / "nowhere")
    assert not (tmp_path / "nowhere").exists()


# ---- findings


def replaced(results: StudyResults, **columns: np.ndarray) -> StudyResults:
    return StudyResults(**{**vars(results), "columns": {**results.columns, **columns}})


def test_bounds_are_pointed_out_only_where_met(made):
    _, results, _ = made
    inputs = results.columns["inputs"].copy()
    middle = 0.5 * (results.lower + results.upper)
    inputs[0] = middle
    assert findings.bounds_met(replaced(results, inputs=inputs), 0, np.array([0, 1])) == []
    inputs[0, 1] = results.upper[1]
    inputs[1] = middle
    (bound,) = findings.bounds_met(replaced(results, inputs=inputs), 0, np.array([0, 1]))
    assert (bound.name, bound.side, bound.value, bound.share) == ("pilot_damping", "upper", 0.5, 0.5)
    assert bound.sentence == (
        "The search stopped at damping ratio 0.5, the upper bound of the study (50 % of the front lies there): "
        "the worst pilot may lie beyond."
    )


def test_a_search_that_missed_a_worse_neighbour_is_told(made):
    _, results, _ = made
    worst = int(findings.worst_order(results)[0])
    gain, phase = (float(results.columns[name][worst]) for name in ("gain_margin_db", "phase_margin_deg"))

    def curve(gains: list[float], phases: list[float]) -> Curve:
        margins = {"gain_margin_db": np.array(gains), "phase_margin_deg": np.array(phases)}
        return Curve("pilot_damping", np.linspace(0.2, 0.4, len(gains)), margins)

    traded = curve([gain - 1.0, gain, np.nan], [phase + 1.0, phase, np.nan])  # not worse: the other margin grows
    assert findings.worse_on_curves(results, worst, [traded]) == ""
    hidden = curve([gain, gain - 0.5], [phase, phase])
    sentence = findings.worse_on_curves(results, worst, [traded, hidden])
    assert f"made worse by damping ratio 0.4 (gain margin {gain - 0.5:.2f} dB".replace("-", "−") in sentence


def test_rank_correlation_is_spearmans():
    from scipy.stats import spearmanr

    rng = np.random.default_rng(3)
    x = rng.integers(0, 6, 40).astype(float)  # with ties
    y = x**3 + rng.normal(0.0, 20.0, 40)
    assert findings._spearman(x, y) == pytest.approx(spearmanr(x, y).statistic, abs=1e-12)
    assert np.isnan(findings._spearman(x, np.ones(40)))


def test_nearly_equal_pilots_count_as_one(made):
    _, results, _ = made
    inputs = np.tile(0.5 * (results.lower + results.upper), (len(results.columns["inputs"]), 1))
    width = results.upper - results.lower
    inputs[1] += 0.099 * width  # nearly the same as 0
    inputs[2, 0] += 0.11 * width[0]  # another one
    kept = findings.distinct(replaced(results, inputs=inputs), np.array([0, 1, 2, 3]), 10)
    assert kept.tolist() == [0, 2]


def test_no_crossing_is_said_not_numbered():
    assert findings.margin_words("gain_margin_db", np.inf, np.nan) == "none (no crossing of the negative real axis)"
    assert findings.margin_words("phase_margin_deg", np.inf, np.nan) == "none (no crossing of the unit circle)"
    assert findings.margin_words("phase_margin_deg", -3.25, 1.5) == "−3.2° at 1.50 Hz"
    assert [findings.typeset_number(value, 1) for value in (np.inf, -np.inf, np.nan, -0.01)] == [
        "none",
        "−∞",
        "–",
        "0.0",
    ]


def test_infinite_margins_of_the_worst_pilot(made):
    _, results, _ = made
    gain = results.columns["gain_margin_db"].copy()
    gain[:] = np.inf
    sentences = findings.how_far(replaced(results, gain_margin_db=gain), 0, {"gain_margin_db": 6.0})
    assert sentences[0] == "Gain margin: the worst pilot's loop has no crossing, so the margin is infinite."


def test_extrapolations_are_grouped_by_biometric():
    rows = [
        {"extrapolated": ["stature 2 m is outside"]},
        {"extrapolated": ["stature 1.99 m is outside", "mass 40 kg is"]},
        {},
    ]
    found = findings.extrapolations(rows)
    assert [(entry.sentence, entry.count) for entry in found] == [("mass 40 kg is", 1), ("stature 2 m is outside", 2)]


def test_extrapolations_are_told_for_multibody_pilots(made, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("pilotgen.report.stills.png", lambda figure: base64.b64decode(PIXEL))  # nobody looks
    _, results, _ = made
    study = mayo_study()
    body = dataclasses.replace(study, pilot=dataclasses.replace(study.pilot, model="multibody"))
    order = findings.worst_order(results)
    front = findings.first_front(results)
    rows = [{"extrapolated": ["stature 2 m is outside"]} if k == order[0] else {} for k in range(24)]
    text = Page(page.render(body, results, order, front, rows, None, None)).text
    assert "1 evaluation, for example: stature 2 m is outside" in text
    assert "The worst pilot is one of them: stature 2 m is outside." in text
    assert "Not known" in Page(page.render(body, results, order, front, None, None, None)).text
    assert "Beyond the data None" in Page(page.render(body, results, order, front, [{}] * 24, None, None)).text


def test_long_fronts_are_thinned_along_their_length(tmp_path: Path):
    results = write_study(tmp_path, mayo_study(), population=20)
    chosen = choose_front(results, np.arange(60))
    assert chosen.different > MOST_DECKS
    assert len(chosen.pilots) == MOST_DECKS == len(set(chosen.pilots.tolist()))
    assert chosen.pilots[0] == findings.worst_order(results)[0]
    gains = results.columns["gain_margin_db"]
    different = findings.distinct(results, findings.worst_order(results), 60, share=0.0)
    assert gains[chosen.pilots].max() == gains[different].max()  # both ends of it


def test_the_order_of_a_front_adds_the_capped_margins(tmp_path: Path) -> None:
    results = write_study(tmp_path, mayo_study(1), generations=1, population=8)
    columns = dict(results.columns)
    columns["rank"] = np.ones(8, dtype=np.int64)
    # the first three: sums 43, 41, 42, differences -37, 1, -18; the others are capped at 60 dB and 180 deg
    columns["gain_margin_db"] = np.array([3.0, 21.0, 12.0, np.inf, 7.0, 60.0, 8.0, -np.inf])
    columns["phase_margin_deg"] = np.array([40.0, 20.0, 30.0, 100.0, np.inf, 99.0, 179.0, -50.0])
    order = findings.worst_order(dataclasses.replace(results, columns=columns))
    assert order.tolist() == [7, 1, 2, 0, 5, 3, 4, 6]


@pytest.mark.parametrize(
    ("correlation", "words"),
    [
        (0.19, "hardly follows"), (-0.19, "hardly follows"), (0.21, "rises somewhat"), (-0.49, "falls somewhat"),
        (0.51, "rises clearly"), (-0.51, "falls clearly"), (float("nan"), "Nothing can be said"),
    ],
)  # fmt: skip
def test_trends_are_called_by_their_strength(correlation: float, words: str) -> None:
    trend = findings.Trend("stature_m", {"gain_margin_db": correlation, "phase_margin_deg": 0.0})
    assert words in trend.sentence


def test_who_is_below_the_limits(made):
    _, results, _ = made
    columns = {
        **results.columns,
        "gain_margin_db": np.linspace(1.0, 24.0, 24),
        "phase_margin_deg": np.full(24, np.inf),
        "stable": np.array([0] + [1] * 23),
    }
    changed = replaced(results, **columns)
    limits = {"gain_margin_db": 4.5, "phase_margin_deg": 60.0, "modulus_margin": None}
    assert findings.pilots_below_limits(changed, limits) == [
        "1 of 24 pilots make the closed loop unstable",
        "4 pilots have a gain margin below 4.50 dB; the smallest is 1.00 dB",
    ]
    assert findings.how_far(changed, 23, limits)[0] == "Gain margin: the model's worst pilot is 19.50 dB above 4.50 dB."
    assert findings.how_far(changed, 0, limits)[0] == "Gain margin: the worst pilot misses 4.50 dB by 3.50 dB."
    assert findings.how_far(changed, 0, limits)[-1].endswith(
        "3 have less than 4.50 dB, 0 have less than 60.0°, 1 make the closed loop unstable."
    )
