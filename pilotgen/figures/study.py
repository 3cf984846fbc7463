"""What a study found: populations, objective plane, convergence, margins along each variable.

Colour shows the gain margin everywhere; the darker, the more prone to bounce.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pilotgen.figures import style
from pilotgen.figures.style import BLACK, BLUE, GREY, LIGHT_GREY, VERMILLION, MarginScale, quantity
from pilotgen.objectives import GAIN_MARGIN, MODULUS_MARGIN, OBJECTIVES, PHASE_MARGIN, quantiles

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from pilotgen.runs.results import StudyResults

Limits = Mapping[str, float | None]  # objective -> margin wanted, as a study's `limits`
RULE_OF_THUMB: Limits = {row.key: row.limit for row in OBJECTIVES.values()}  # a study's limits if it says nothing
INSTEAD = MODULUS_MARGIN  # drawn where no pilot has a phase margin
ONE_PLACE = 0.02  # share of the box that a marker covers
MARKER_AREA = 16.0  # points^2
PALE_PERCENTILE = 98.0  # of the gain margins of the first population: the pale end of the colours
CROWD = 400  # more markers than this have no white edge, which would bleach the crowd


@dataclass(frozen=True)
class Curve:
    """Margins of pilots that differ from one pilot in one variable.

    Attributes
    ----------
    name : str
        The variable.
    values : ndarray, shape (k,)
        Its values, in the unit of its name.
    margins : mapping of str to ndarray, shape (k,)
        `gain_margin_db`, `phase_margin_deg` and `modulus_margin`; infinite without crossing, NaN where the pilot could
        not be evaluated.
    """

    name: str
    values: np.ndarray
    margins: Mapping[str, np.ndarray]


def shown_margins(results: StudyResults) -> tuple[str, str]:
    """The two margins to draw: gain and phase, or gain and modulus if no loop of the study reaches |L| = 1."""
    phase = results.columns[PHASE_MARGIN.key]
    return GAIN_MARGIN.key, PHASE_MARGIN.key if np.isfinite(phase).any() else INSTEAD.key


def plane_of(results: StudyResults) -> tuple[str, str]:
    """The two columns that the objective plane is drawn over: as `shown_margins`, or the quantiles of a robust search.

    Beside a single quantile stands what else was minimised, or its margin as the study has the pilot.
    """
    robust = results.searched_quantiles
    if not robust:
        return shown_margins(results)
    others = [*(row.key for row in robust[1:]), *(key for key in results.objective_names if key in OBJECTIVES)]
    return robust[0].key, (others or [robust[0].base])[0]


def _limit(limits: Limits, name: str) -> float | None:
    """The limit of a margin or of a quantile of it."""
    return limits.get(name) if name in OBJECTIVES else limits.get(quantiles((name,))[0].base)


class _Colors:
    """Gain margin (of a robust search the first quantile) -> colour, the same in every panel of a figure."""

    def __init__(self, results: StudyResults, limits: Limits) -> None:
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize

        self.key = next((row.key for row in results.searched_quantiles), GAIN_MARGIN.key)
        self.values = results.columns[self.key]
        self.limit = _limit(limits, self.key)
        finite = self.values[np.isfinite(self.values)]
        # a search evaluates bad pilots more often: the first population is the fair one
        fair = self.values[results.members[0]] if len(results.members) else finite
        fair = fair[np.isfinite(fair)] if np.isfinite(fair).any() else finite
        low, high = (float(finite.min()), float(np.percentile(fair, PALE_PERCENTILE))) if finite.size else (0.0, 1.0)
        self.mappable = ScalarMappable(Normalize(low, high if high > low else low + 1.0), style.danger_colors())

    def scatter(self, axes: Axes, x: np.ndarray, y: np.ndarray, rows: np.ndarray) -> None:
        """Scatter these rows; the darkest come last, on top."""
        margin = np.clip(self.values[rows], *self.mappable.get_clim())
        order = np.argsort(-margin, kind="stable")
        axes.scatter(
            x[order],
            y[order],
            c=self.mappable.to_rgba(margin[order]),
            s=MARKER_AREA,
            edgecolors="white" if len(rows) < CROWD else "none",
            linewidths=0.3,
            clip_on=False,
            zorder=3,
        )

    def bar(self, figure: Figure, panels: Any) -> None:
        """The colour bar; lines at 0 dB (limit of stability) and at the study's limit."""
        bar = figure.colorbar(self.mappable, ax=panels, label=quantity(self.key).axis, shrink=0.9, pad=0.02, aspect=28)
        low, high = self.mappable.get_clim()
        for level, color in ((0.0, BLACK), (self.limit, VERMILLION)):
            if level is not None and low < level < high:
                bar.ax.axhline(level, color=color, linewidth=1.2)


def _pilots(count: int) -> str:
    return "1 pilot" if count == 1 else f"{count} pilots"


def _evaluated(results: StudyResults) -> np.ndarray:
    return np.flatnonzero(results.columns["status"] == "ok")


def _shown_variables(results: StudyResults, most: int = 3) -> list[int]:
    """Columns of the variables to draw: all of them, or the ones that move the gain margin most."""
    count = len(results.names)
    if count <= most:
        return list(range(count))
    rows = _evaluated(results)
    margin = results.columns[GAIN_MARGIN.key][rows]
    finite = np.isfinite(margin)
    inputs = results.columns["inputs"][rows][finite]
    if finite.sum() < 3:
        return list(range(most))
    weight = [
        abs(float(np.corrcoef(inputs[:, j], margin[finite])[0, 1])) if np.ptp(inputs[:, j]) else 0.0
        for j in range(count)
    ]
    return sorted(np.argsort(weight)[::-1][:most].tolist())


def _plane(
    axes: Axes, results: StudyResults, pair: tuple[int, int], rows: np.ndarray, colors: _Colors, worst: int | None
) -> None:
    """Pilots over two variables, or over one variable and their gain margin."""
    inputs = results.columns["inputs"]
    i, j = pair
    x = inputs[rows, i]
    if i == j:
        scale = MarginScale.of(colors.values[_evaluated(results)])
        colors.scatter(axes, x, scale.place(colors.values[rows]), rows)
        scale.apply(axes)
        axes.set_ylabel(quantity(colors.key).axis)
        height = scale.place(colors.values)
    else:
        colors.scatter(axes, x, inputs[rows, j], rows)
        style.variable_limits(axes, "y", results.lower[j], results.upper[j])
        axes.set_ylabel(quantity(results.names[j]).axis)
        height = inputs[:, j]
    style.variable_limits(axes, "x", results.lower[i], results.upper[i])
    axes.set_xlabel(quantity(results.names[i]).axis)
    if worst is not None:
        axes.plot(
            inputs[worst, i], height[worst], "o", markersize=11, markerfacecolor="none", markeredgecolor=VERMILLION,
            markeredgewidth=1.6, clip_on=False, zorder=5,
        )  # fmt: skip


def _pairs(results: StudyResults) -> list[tuple[int, int]]:
    shown = _shown_variables(results)
    return [(shown[i], shown[j]) for i, j in style.pairs(len(shown))] or [(shown[0], shown[0])]


def _ok_only(results: StudyResults, rows: np.ndarray) -> np.ndarray:
    kept: np.ndarray = rows[results.columns["status"][rows] == "ok"]
    return kept


@style.styled
def populations(results: StudyResults, worst: int | None = None, limits: Limits = RULE_OF_THUMB) -> Figure:
    """The population at the start (top) and at the end (bottom) of a search, over every pair of variables.

    Parameters
    ----------
    results : StudyResults
        A search: it has members.
    worst : int, optional
        Index of the worst pilot, ringed.
    limits : mapping
        Margins that the study wants, drawn as lines.
    """
    columns = _pairs(results)
    figure = style.new_figure(5.6 if len(columns) > 1 else 6.2, style.PAGE_WIDTH_IN if len(columns) > 1 else 6.0)
    panels = figure.subplots(2, len(columns), squeeze=False)
    colors = _Colors(results, limits)
    ends = ((0, "start"), (len(results.members) - 1, f"after {len(results.members)} generations"))
    for line, (generation, name) in zip(panels, ends, strict=True):
        rows = results.members[generation]
        ok = _ok_only(results, rows)
        for axes, pair in zip(line, columns, strict=True):
            _plane(axes, results, pair, ok, colors, worst if generation else None)
        failed = len(rows) - len(ok)
        title = f"{name}: {len(rows)} pilots" + (f", {failed} failed" if failed else "")
        line[0].set_title(title + (", all in one place" if _in_one_place(results, ok) else ""))
    colors.bar(figure, panels)
    return figure


def _in_one_place(results: StudyResults, rows: np.ndarray) -> bool:
    """Whether these pilots' markers cover each other."""
    if len(rows) < 2:
        return False
    spread = np.ptp(results.columns["inputs"][rows], axis=0)
    return bool(np.all(spread < ONE_PLACE * (results.upper - results.lower)))


@style.styled
def all_individuals(results: StudyResults, worst: int | None = None, limits: Limits = RULE_OF_THUMB) -> Figure:
    """Every evaluated pilot over every pair of variables; failed ones as grey crosses."""
    columns = _pairs(results)
    figure = style.new_figure(3.1 if len(columns) > 1 else 3.6, style.PAGE_WIDTH_IN if len(columns) > 1 else 6.0)
    panels = figure.subplots(1, len(columns), squeeze=False)[0]
    colors = _Colors(results, limits)
    inputs = results.columns["inputs"]
    failed = np.flatnonzero(results.columns["status"] != "ok")
    for axes, (i, j) in zip(panels, columns, strict=True):
        if i != j:
            axes.scatter(inputs[failed, i], inputs[failed, j], marker="x", s=18, linewidths=1.0, color=GREY, zorder=2)
        _plane(axes, results, (i, j), _evaluated(results), colors, worst)
    text = f"all {len(inputs)} evaluations"
    panels[0].set_title(text + (f" ({len(failed)} failed: ×)" if len(failed) else ""))
    colors.bar(figure, panels)
    return figure


@style.styled
def objective_plane(
    results: StudyResults, front: np.ndarray, worst: int | None = None, limits: Limits = RULE_OF_THUMB
) -> Figure:
    """Gain margin against phase margin (or others, see `plane_of`) of every pilot, with the first front.

    Parameters
    ----------
    results : StudyResults
        The study.
    front : ndarray of int
        Indices of the first front.
    worst : int, optional
        Index of the worst pilot, ringed.
    limits : mapping
        Margins that the study wants, drawn as lines.
    """
    figure = style.new_figure(4.4, 6.6)
    axes = figure.subplots()
    rows = _evaluated(results)
    names = plane_of(results)
    gain, phase = (results.columns[name] for name in names)
    x_scale, y_scale = MarginScale.of(gain[rows]), MarginScale.of(phase[rows])
    colors = _Colors(results, limits)
    colors.scatter(axes, x_scale.place(gain[rows]), y_scale.place(phase[rows]), rows)
    order = front[np.lexsort((phase[front], gain[front]))]
    axes.plot(
        x_scale.place(gain[order]), y_scale.place(phase[order]), "-D", color=VERMILLION, markersize=5,
        markerfacecolor="none", linewidth=1.0, clip_on=False, zorder=4, label=f"Pareto front ({_pilots(len(front))})",
    )  # fmt: skip
    if worst is not None:
        axes.plot(
            x_scale.place(gain[[worst]]), y_scale.place(phase[[worst]]), "o", markersize=12, markerfacecolor="none",
            markeredgecolor=BLACK, markeredgewidth=1.4, clip_on=False, zorder=5, label="worst pilot",
        )  # fmt: skip
    x_scale.apply(axes, "x")
    y_scale.apply(axes, "y")
    marked = [
        scale.mark(axes, _limit(limits, name), which)
        for scale, which, name in zip((x_scale, y_scale), "xy", names, strict=True)
    ]
    if any(marked):
        axes.plot([], [], color=style.GREEN, linestyle=(0, (5, 3)), linewidth=1.0, label="limits of the study")
    axes.set_xlabel(quantity(names[0]).axis)
    axes.set_ylabel(quantity(names[1]).axis)
    axes.legend(loc="lower right")
    colors.bar(figure, axes)
    return figure


@style.styled
def convergence(results: StudyResults, limits: Limits = RULE_OF_THUMB) -> Figure:
    """Smallest, median and middle half of the population's margins, generation by generation."""
    names = [name for name in results.objective_names if np.isfinite(results.columns[name]).any()]
    names = names or [shown_margins(results)[1]]
    figure = style.new_figure(2.9, style.PAGE_WIDTH_IN if len(names) > 1 else 5.6)
    panels = figure.subplots(1, len(names), squeeze=False)[0]
    generations = np.arange(1, len(results.members) + 1)
    for axes, name in zip(panels, names, strict=True):
        margin = results.columns[name]
        history = np.stack([_quartiles(margin[_ok_only(results, rows)]) for rows in results.members])
        scale = MarginScale.of(history)
        placed = scale.place(history)
        axes.fill_between(generations, placed[:, 1], placed[:, 3], color=LIGHT_GREY, linewidth=0, label="middle half")
        axes.plot(*scale.broken(generations, history[:, 2]), color=BLUE, marker=".", markersize=4, label="median")
        axes.plot(
            *scale.broken(generations, history[:, 0]), color=VERMILLION, marker=".", markersize=4, label="smallest"
        )
        scale.apply(axes)
        scale.mark(axes, _limit(limits, name))
        axes.set_xlim(0.5, len(generations) + 0.5)
        axes.xaxis.get_major_locator().set_params(integer=True)
        axes.set_xlabel("generation")
        axes.set_ylabel(quantity(name).axis)
    panels[0].legend(loc="upper right")
    return figure


def _quartiles(values: np.ndarray) -> np.ndarray:
    """Smallest, lower quartile, median, upper quartile; order statistics, so that infinities stay what they are."""
    if not values.size:
        return np.full(4, np.nan)
    ordered = np.sort(values)
    last = len(ordered) - 1
    return ordered[[0, round(0.25 * last), round(0.5 * last), round(0.75 * last)]]


@style.styled
def margin_curves(
    results: StudyResults, curves: Sequence[Curve], worst: int | None = None, limits: Limits = RULE_OF_THUMB
) -> Figure:
    """Margins against each variable: every pilot as a dot, and curves through the worst pilot.

    Parameters
    ----------
    results : StudyResults
        The study.
    curves : sequence of Curve
        One per variable, or none.
    worst : int, optional
        Index of the worst pilot.
    limits : mapping
        Margins that the study wants, drawn as lines.
    """
    count = len(results.names)
    figure = style.new_figure(4.8, style.PAGE_WIDTH_IN if count > 1 else 5.0)
    panels = figure.subplots(2, count, squeeze=False, sharex="col", sharey="row")
    rows = _evaluated(results)
    start = _ok_only(results, results.members[0]) if len(results.members) else np.empty(0, dtype=int)
    later = np.setdiff1d(rows, start)
    inputs = results.columns["inputs"]
    by_name = {curve.name: curve for curve in curves}
    for line, margin_name in zip(panels, shown_margins(results), strict=True):
        margin = results.columns[margin_name]
        scale = MarginScale.of(margin[rows], *(curve.margins[margin_name] for curve in curves))
        for j, (axes, name) in enumerate(zip(line, results.names, strict=True)):
            axes.scatter(
                inputs[later, j], scale.place(margin[later]), s=7, color=LIGHT_GREY, linewidths=0,
                label="later pilots" if len(start) else "pilots of the sample",
            )  # fmt: skip
            if len(start):
                axes.scatter(
                    inputs[start, j], scale.place(margin[start]), s=12, color=BLUE, alpha=0.75, linewidths=0,
                    label="first population",
                )  # fmt: skip
            if name in by_name:
                curve = by_name[name]
                axes.plot(
                    *scale.broken(curve.values, curve.margins[margin_name]), color=VERMILLION, marker=".", markersize=5,
                    label="worst pilot, this alone varied", zorder=4,
                )  # fmt: skip
            if worst is not None:
                axes.plot(
                    inputs[worst, j], scale.place(margin[[worst]]), "o", markersize=9, markerfacecolor="none",
                    markeredgecolor=BLACK, markeredgewidth=1.4, clip_on=False, zorder=5, label="worst pilot",
                )  # fmt: skip
            style.variable_limits(axes, "x", results.lower[j], results.upper[j])
        for axes in line:
            scale.apply(axes)
            scale.mark(axes, limits.get(margin_name))
        line[0].set_ylabel(quantity(margin_name).axis)
    for axes, name in zip(panels[-1], results.names, strict=True):
        axes.set_xlabel(quantity(name).axis)
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), markerscale=1.3)
    return figure
