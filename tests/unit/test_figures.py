"""Figures: what is drawn is where the numbers say, and every number has a place.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
import struct
from pathlib import Path

import numpy as np
import pytest
from study_maker import mayo_study, write_study

from pilotgen import figures
from pilotgen.context import EvaluationContext
from pilotgen.evaluation import Evaluation, evaluate
from pilotgen.figures import style
from pilotgen.figures.study import Curve
from pilotgen.runs.results import StudyResults

WORST_CORNER = {"pilot_frequency_hz": 2.5, "pilot_damping": 0.2, "pilot_time_constant_s": 0.06}


@pytest.fixture(scope="module")
def pilots() -> dict[str, Evaluation]:
    """Mayo's mesomorphic pilot (no unit-circle crossing) and an unstable one with two."""
    study = mayo_study()
    found = {}
    with EvaluationContext(study) as context:
        for name, values in (("nominal", study.nominal), ("worst", WORST_CORNER)):
            outcome = evaluate(context, values)
            assert isinstance(outcome, Evaluation)
            found[name] = outcome
    return found


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> StudyResults:
    """A search over three variables with two failures."""
    return write_study(tmp_path_factory.mktemp("study"), mayo_study(), failed=(3, 12))


def visible_text(figure) -> str:
    """Every text of a figure."""
    from matplotlib.text import Text

    return "\n".join(text.get_text() for text in figure.findobj(Text))


def png_size(data: bytes) -> tuple[int, int]:
    """Width and height from the PNG's header."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", data[16:24])
    return width, height


# ---- Bode


def test_bode_draws_the_loop_it_is_given(pilots):
    figure = figures.bode([("", pilots["nominal"])])
    gain = figure.axes[1]
    curve = max(gain.lines, key=lambda line: len(line.get_xdata()))
    at = 3.0
    drawn = np.interp(at, curve.get_xdata(), curve.get_ydata())
    expected = 20.0 * math.log10(abs(complex(pilots["nominal"].loop.response(2.0 * math.pi * at))))
    assert drawn == pytest.approx(expected, abs=0.02)  # dB, by interpolation on the grid
    assert gain.get_ylabel() == "|L| [dB]"
    assert figure.axes[0].get_ylabel() == "grip motion [mm per m/s²]"
    assert figure.axes[2].get_xlabel() == figure.axes[3].get_xlabel() == "frequency [Hz]"
    assert figure.axes[3].get_xlim() == pytest.approx((0.1, 20.0))
    for axes in figure.axes:
        for line in axes.lines:
            assert np.isfinite(np.asarray(line.get_ydata(), dtype=float)).all()


def test_bode_marks_every_crossing_and_pole(pilots):
    worst = pilots["worst"]
    figure = figures.bode([("", worst)])
    circles = [line.get_xdata()[0] for line in figure.axes[1].lines if line.get_marker() == "o"]
    expected = [
        c.frequency_hz for c in worst.margins.crossings if c.kind == "unit circle" and 0.1 <= c.frequency_hz <= 20
    ]
    assert sorted(circles) == pytest.approx(sorted(expected))
    squares = [line for line in figure.axes[3].lines if line.get_marker() == "s"]
    assert squares
    assert all((line.get_ydata()[0] + 180.0) % 360.0 == 0.0 for line in squares)
    poles = [line.get_xdata()[0] for line in figure.axes[0].lines if line.get_marker() == "x" and len(line.get_xdata())]
    assert poles == pytest.approx([2.5])


def test_bode_says_when_there_is_no_crossing_and_when_the_loop_is_unstable(pilots):
    text = visible_text(figures.bode([("", pilots["nominal"])]))
    assert "phase margin none (no crossing of the unit circle)" in text
    assert "closed loop stable" in text
    text = visible_text(figures.bode([("", pilots["worst"])]))
    assert "closed loop UNSTABLE" in text
    assert "modulus margin" not in text  # a distance is no margin of an unstable loop


# ---- Nyquist


def test_nyquist_draws_margins_at_their_crossings(pilots):
    worst = pilots["worst"]
    figure = figures.nyquist([("", worst)])
    (axes,) = figure.axes
    labels = {line.get_label(): line for line in axes.lines}
    gain = next(line for label, line in labels.items() if label.startswith("gain margin"))
    # the drawn segment ends at the crossing, whose size is the gain margin
    assert 20.0 * math.log10(abs(gain.get_xdata()[0])) == pytest.approx(abs(worst.margins.gain_margin_db))
    assert gain.get_xdata()[1] == -1.0
    phase = next(line for label, line in labels.items() if label.startswith("phase margin"))
    arc = np.asarray(phase.get_xdata()) + 1j * np.asarray(phase.get_ydata())
    assert np.abs(arc) == pytest.approx(np.ones(len(arc)))
    assert arc[0] == pytest.approx(-1.0)
    assert abs(np.degrees(np.angle(-arc[-1]))) == pytest.approx(abs(worst.margins.phase_margin_deg))
    assert axes.get_aspect() == 1.0
    assert "−" in gain.get_label()  # negative: unstable


def test_nyquist_modulus_circle_touches_the_locus(pilots):
    nominal = pilots["nominal"]
    (axes,) = figures.nyquist([("", nominal)]).axes
    circle = next(line for line in axes.lines if str(line.get_label()).startswith("modulus margin"))
    locus = next(line for line in axes.lines if line.get_label() == "L(jω), ω > 0")
    radius = abs(circle.get_xdata()[0] + 1j * circle.get_ydata()[0] + 1.0)
    points = np.asarray(locus.get_xdata()) + 1j * np.asarray(locus.get_ydata())
    assert np.abs(points + 1.0).min() == pytest.approx(radius, rel=1e-3)
    assert "no crossing" in visible_text(axes.figure)


def test_comparison_has_one_panel_per_pilot_on_one_scale(pilots):
    figure = figures.nyquist([("nominal", pilots["nominal"]), ("worst", pilots["worst"])])
    assert [axes.get_title(loc="left") for axes in figure.axes] == [
        "nominal: stable closed loop",
        "worst: UNSTABLE closed loop",
    ]
    assert figure.axes[0].get_xlim() == figure.axes[1].get_xlim()


def test_draw_pilot_writes_two_pictures_and_no_scraps(pilots, tmp_path: Path):
    figures.draw_pilot(pilots["nominal"], tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bode.png", "nyquist.png"]
    for path in tmp_path.iterdir():
        width, height = png_size(path.read_bytes())
        assert width > 600 and height > 600


def test_pictures_are_the_same_bytes_every_time(pilots):
    first, second = (style.png(figures.nyquist([("", pilots["worst"])])) for _ in range(2))
    assert first == second


def test_unwritable_directory_is_told(pilots, tmp_path: Path):
    from pilotgen.errors import FileError

    with pytest.raises(FileError, match=r"bode\.png"):
        figures.draw_pilot(pilots["nominal"], tmp_path / "missing")


def test_drawing_leaves_matplotlib_as_it_was(pilots):
    import matplotlib

    before = dict(matplotlib.rcParams)
    style.png(figures.bode([("", pilots["nominal"])]))
    assert dict(matplotlib.rcParams) == before


# ---- studies


def offsets(axes) -> np.ndarray:
    """All scattered points of a panel."""
    return np.concatenate([np.asarray(collection.get_offsets()) for collection in axes.collections])


def test_populations_show_first_and_last_generation(results):
    figure = figures.populations(results, worst=int(results.front[0]))
    panels = [axes for axes in figure.axes if axes.get_xlabel()]
    assert len(panels) == 6  # three pairs, start and end
    ok = results.members[0][results.columns["status"][results.members[0]] == "ok"]
    drawn = offsets(panels[0])
    assert sorted(map(tuple, drawn)) == sorted(map(tuple, results.columns["inputs"][ok][:, :2]))
    assert panels[0].get_title(loc="left") == "start: 8 pilots, 1 failed"
    assert panels[0].get_xlabel() == "natural frequency [Hz]"
    low, high = panels[0].get_xlim()
    assert low < 2.5 and high > 4.0


def test_darker_is_worse(results):
    (panel, *_) = figures.all_individuals(results).axes
    scatter = panel.collections[-1]
    brightness = scatter.get_facecolors()[:, :3].sum(axis=1)
    inputs = results.columns["inputs"]
    margins = []
    for point in np.asarray(scatter.get_offsets()):
        row = int(np.argmin(np.abs(inputs[:, :2] - point).sum(axis=1)))
        margins.append(results.columns["gain_margin_db"][row])
    assert brightness[int(np.argmin(margins))] == brightness.min()
    assert list(margins) == sorted(margins, reverse=True)  # the darkest are drawn last, on top


def test_failed_pilots_are_crosses(results):
    (panel, *_) = figures.all_individuals(results).axes
    crosses = np.asarray(panel.collections[0].get_offsets())
    assert sorted(map(tuple, crosses)) == sorted(map(tuple, results.columns["inputs"][[3, 12]][:, :2]))
    assert "2 failed" in panel.get_title(loc="left")


@pytest.mark.parametrize("variables", [1, 2])
def test_fewer_variables_have_fewer_panels(tmp_path: Path, variables: int):
    few = write_study(tmp_path, mayo_study(variables))
    panels = [axes for axes in figures.populations(few, worst=0).axes if axes.get_xlabel()]
    assert len(panels) == 2  # start and end over the one pair, or over the one variable
    if variables == 1:
        assert panels[0].get_ylabel() == "gain margin [dB]"
    for figure in (figures.all_individuals(few), figures.margin_curves(few, [])):
        assert png_size(style.png(figure))


def test_infinite_margins_have_a_place_of_their_own(results):
    figure = figures.objective_plane(results, results.front)
    axes = figure.axes[0]
    phase = results.columns["phase_margin_deg"]
    infinite = int(np.isinf(phase).sum())
    assert infinite > 0  # else this tests nothing
    labels = [tick.get_text() for tick in axes.get_yticklabels()]
    assert labels[-1] == "none"
    place = axes.get_yticks()[-1]
    assert place > phase[np.isfinite(phase)].max()
    assert (offsets(axes)[:, 1] == place).sum() == infinite
    assert np.isfinite(offsets(axes)).all()


def test_a_scale_without_infinities_has_no_strip():
    scale = style.MarginScale.of([1.0, 5.0, np.nan])
    assert scale.above is None and scale.below is None
    assert scale.limits[0] < 1.0 and scale.limits[1] > 5.0
    assert np.isnan(scale.place([np.nan])).all()


def test_a_scale_of_nothing_but_infinities_is_still_a_scale():
    scale = style.MarginScale.of([np.inf, -np.inf])
    low, high = scale.limits
    assert low < scale.below < scale.above < high
    assert list(scale.place([np.inf, -np.inf])) == [scale.above, scale.below]
    axes = style.new_figure(2.0).subplots()
    scale.apply(axes)
    assert [tick.get_text() for tick in axes.get_yticklabels()] == ["none", "−∞"]  # no numbers where there are none


def test_a_wanted_margin_is_marked_only_among_finite_ones():
    scale = style.MarginScale.of([0.0, 55.0, np.inf])
    axes = style.new_figure(2.0).subplots()
    scale.apply(axes)
    assert scale.high < 60.0 < scale.limits[1]  # 60 deg would lie on the strip of "none"
    assert not scale.mark(axes, 60.0)
    assert scale.mark(axes, 40.0)
    assert [line.get_ydata()[0] for line in axes.lines] == [0.0, 0.0, 40.0]


def test_the_study_s_own_limits_are_marked(results):
    wanted = {"gain_margin_db": 4.5, "phase_margin_deg": None}

    def dashed(axes):
        return [line.get_ydata()[0] for line in axes.lines if line.get_color() == style.GREEN and len(line.get_ydata())]

    for limits, level in ((wanted, [4.5]), ({}, [])):
        assert dashed(figures.convergence(results, limits).axes[0]) == level
        panels = figures.margin_curves(results, [], None, limits).axes
        assert all(dashed(axes) == level for axes in panels[: len(results.names)])
        assert not any(dashed(axes) for axes in panels[len(results.names) :])
    levels = [
        figures.all_individuals(results, None, limits).axes[-1].lines for limits in (wanted, {"gain_margin_db": 99.0})
    ]
    assert len(levels[0]) == len(levels[1]) + 1


def test_a_line_breaks_where_a_margin_becomes_infinite():
    scale = style.MarginScale.of([0.0, 1.0, np.inf])
    x, y = scale.broken([1.0, 2.0, 3.0], [0.0, 1.0, np.inf])
    assert np.isnan(x[2]) and np.isnan(y[2])
    assert y[3] == scale.above


def test_convergence_shows_the_smallest_of_every_generation(results):
    figure = figures.convergence(results)
    smallest = figure.axes[0].lines[1]
    expected = [np.nanmin(results.columns["gain_margin_db"][rows]) for rows in results.members]
    assert np.asarray(smallest.get_ydata()) == pytest.approx(expected)
    assert figure.axes[0].get_xlabel() == "generation"


def test_curves_are_drawn_through_the_worst_pilot(results):
    margin = {"gain_margin_db": np.array([-1.0, 2.0, np.nan]), "phase_margin_deg": np.array([-5.0, np.inf, np.nan])}
    curve = Curve("pilot_damping", np.array([0.2, 0.3, 0.4]), margin)
    figure = figures.margin_curves(results, [curve], worst=0)
    panel = figure.axes[1]  # gain margin against the second variable
    line = next(line for line in panel.lines if line.get_label().startswith("worst pilot, this alone"))
    assert np.asarray(line.get_xdata())[:2] == pytest.approx([0.2, 0.3])
    assert np.asarray(line.get_ydata())[:2] == pytest.approx([-1.0, 2.0])
    assert not any(line.get_label().startswith("worst pilot, this alone") for line in figure.axes[0].lines)
    assert png_size(style.png(figure))


def test_where_nobody_has_a_phase_margin_the_modulus_margin_is_drawn(results):
    columns = {**results.columns, "phase_margin_deg": np.full(len(results.columns["phase_margin_deg"]), np.inf)}
    none = StudyResults(**{**vars(results), "columns": columns})
    axes = figures.objective_plane(none, none.front).axes[0]
    assert axes.get_ylabel() == "modulus margin"
    ok = none.columns["status"] == "ok"
    assert sorted(offsets(axes)[:, 1]) == pytest.approx(sorted(none.columns["modulus_margin"][ok]))
    assert figures.margin_curves(none, []).axes[3].get_ylabel() == "modulus margin"
    assert [axes.get_ylabel() for axes in figures.convergence(none).axes] == ["gain margin [dB]"]
