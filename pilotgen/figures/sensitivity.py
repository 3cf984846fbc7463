"""Which numbers decide: bars of the indices, tornado of the slopes, convergence; drawn from sensitivity.json.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pilotgen.figures import style
from pilotgen.figures.style import BLACK, BLUE, GREY, LIGHT_GREY, LINE_COLORS, SKY, VERMILLION, quantity
from pilotgen.objectives import objective

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ROW_IN, HEAD_IN = 0.28, 1.1  # height of a number, and of what is around them [inch]
MOST_LINES = 6  # of a convergence figure
MOST_EFFECTS = 8  # of an analysis of variance


def draw_sensitivity(content: Mapping[str, Any], directory: Path) -> None:
    """Write sensitivity-slopes.png and, where there are such, sensitivity-indices.png and sensitivity-convergence.png.

    FileError if that fails.
    """
    style.save(slopes(content), directory / "sensitivity-slopes.png")
    if any(one.get("anova") for one in content["objectives"].values()):
        style.save(effects(content), directory / "sensitivity-indices.png")
    if any(_numbers(one) for one in content["objectives"].values()):
        style.save(indices(content), directory / "sensitivity-indices.png")
    if any(_steps(one) for one in content["objectives"].values()):
        style.save(convergence(content), directory / "sensitivity-convergence.png")


@style.styled
def indices(content: Mapping[str, Any]) -> Figure:
    """First-order and total indices (or mean magnitudes of Morris' effects) with 95 % intervals, largest on top."""
    shown = {key: one for key, one in content["objectives"].items() if _numbers(one)}
    figure, panels = _panels(len(shown), len(content["numbers"]))
    sobol = content["method"] != "morris"
    blocks = {"sobol": "base points", "morris": "trajectories", "surrogate": "pilots"}[content["method"]]
    for axes, (key, one) in zip(panels, shown.items(), strict=True):
        row, numbers = objective(key), _numbers(one)
        size = "total" if sobol else "mean_magnitude"
        order = sorted(numbers, key=lambda name: numbers[name][size])
        places = np.arange(len(order))
        bars = (("total", BLUE, 0.19), ("first", SKY, -0.19)) if sobol else (("mean_magnitude", BLUE, 0.0),)
        for bar, color, shift in bars:
            values = np.array([numbers[name][bar] for name in order])
            halves = np.array([numbers[name][f"{bar}_half_width"] for name in order])
            label = {"total": "total", "first": "first order"}.get(bar, "mean magnitude over its range")
            axes.barh(places + shift, values, height=0.36 if sobol else 0.6, color=color, label=label)
            axes.errorbar(values, places + shift, xerr=halves, fmt="none", ecolor=BLACK, elinewidth=0.9, capsize=2)
        axes.axvline(0.0, color=BLACK, linewidth=0.8)
        _names(axes, order)
        axes.set_title(row.label)
        axes.set_xlabel("share of the variance" if sobol else row.heading)
        if sobol:
            axes.set_xlim(min(0.0, axes.get_xlim()[0]), max(1.0, axes.get_xlim()[1]))
        left_out = one["indices"]["blocks_left_out"]
        text = f"{one['indices']['blocks']} {blocks}"
        axes.text(
            0.98, 0.22, text + (f"\n{left_out} left out for failures" if left_out else ""), transform=axes.transAxes,
            ha="right", fontsize=7.5, color=GREY,
        )  # fmt: skip
        axes.legend(loc="lower right", fontsize=7.5)
    return figure


@style.styled
def effects(content: Mapping[str, Any]) -> Figure:
    """Shares of the sum of squares of an analysis of variance, interactions included, largest on top."""
    shown = {key: one for key, one in content["objectives"].items() if one.get("anova")}
    figure, panels = _panels(len(shown), MOST_EFFECTS)
    for axes, (key, one) in zip(panels, shown.items(), strict=True):
        lines = [line for line in one["anova"] if line.get("share") is not None]
        order = sorted(lines, key=lambda line: float(line["share"]))[-MOST_EFFECTS:]
        axes.barh(range(len(order)), [line["share"] for line in order], height=0.6, color=BLUE)
        names = (" × ".join(quantity(name).name for name in line["source"].split(" x ")) for line in order)
        axes.set_yticks(range(len(order)), list(names))
        axes.set_ylim(-0.7, len(order) - 0.3)
        axes.grid(visible=False, axis="y")
        axes.set_title(objective(key).label)
        axes.set_xlabel("share of the sum of squares")
        axes.set_xlim(0.0, 1.0)
    return figure


@style.styled
def slopes(content: Mapping[str, Any]) -> Figure:
    """A tornado: what each number's range does to an objective along its slope at the nominal pilot, largest on top."""
    shown = content["objectives"]
    figure, panels = _panels(len(shown), len(content["numbers"]))
    for axes, (key, one) in zip(panels, shown.items(), strict=True):
        row = objective(key)
        moves = {}
        for name, number in content["numbers"].items():
            slope = one["slopes"][name]
            if slope is not None:
                moves[name] = [slope * (number[end] - number["nominal"]) for end in ("lower", "upper")]
        order = sorted(moves, key=lambda name: abs(moves[name][1] - moves[name][0]))
        for place, name in enumerate(order):
            for end, color in zip(moves[name], (SKY, VERMILLION), strict=True):
                axes.barh(place, end, height=0.6, color=color)
        axes.barh(0, 0, color=SKY, label="down to its lower bound")
        axes.barh(0, 0, color=VERMILLION, label="up to its upper bound")
        axes.axvline(0.0, color=BLACK, linewidth=0.9)
        _names(axes, order)
        nominal = one["nominal"]
        axes.set_title(f"{row.label}, nominal {style.typeset(row.text(nominal))}" if nominal is not None else row.label)
        axes.set_xlabel(f"change of the {row.heading}, along the slope")
        axes.legend(loc="lower right", fontsize=7.5)
    return figure


@style.styled
def convergence(content: Mapping[str, Any]) -> Figure:
    """Total indices of a quarter, half and all of the base points, with the intervals of the last."""
    shown = {key: one for key, one in content["objectives"].items() if _steps(one)}
    figure = style.new_figure(3.6, min(style.PAGE_WIDTH_IN, 4.9 * len(shown)))
    panels = figure.subplots(1, len(shown), squeeze=False, sharey=True)[0]
    first = _numbers(next(iter(shown.values())))
    order = sorted(first, key=lambda name: -first[name]["total"])  # the same colours in every panel
    for axes, (key, one) in zip(panels, shown.items(), strict=True):
        steps, numbers = _steps(one), _numbers(one)
        base = [step["base"] for step in steps]
        for k, name in reversed(list(enumerate(order))):
            told = k < MOST_LINES
            values = [step["total"][name] for step in steps]
            color = LINE_COLORS[k] if told else LIGHT_GREY
            label = quantity(name).name if told else None
            axes.plot(base, values, marker="o", markersize=3.5, color=color, linewidth=1.2, label=label)
            if told:
                half, place = numbers[name]["total_half_width"], base[-1] * (1.03 + 0.03 * k)
                axes.errorbar([place], [values[-1]], yerr=[half], color=color, capsize=2.0, linewidth=1.0)
        axes.set_xscale("log", base=2)
        axes.set_xticks(base, [str(count) for count in base])
        axes.set_xlim(base[0] / 1.2, base[-1] * 1.3)
        axes.set_xlabel("pilots" if content["method"] == "surrogate" else "base points")
        axes.set_title(objective(key).label)
    handles, texts = panels[0].get_legend_handles_labels()
    figure.legend(handles[::-1], texts[::-1], loc="outside lower center", ncols=3, fontsize=7.5)
    panels[0].set_ylabel("total index")
    return figure


def _panels(count: int, numbers: int) -> tuple[Figure, Any]:
    """A figure with one column of bars under the other."""
    height = HEAD_IN + ROW_IN * 1.25 * numbers
    figure = style.new_figure(height * max(count, 1), 7.2)
    return figure, figure.subplots(max(count, 1), 1, squeeze=False)[:, 0]


def _names(axes: Axes, order: list[str]) -> None:
    axes.set_yticks(range(len(order)), [quantity(name).name for name in order])
    axes.set_ylim(-0.7, len(order) - 0.3)
    axes.grid(visible=False, axis="y")


def _numbers(one: Mapping[str, Any]) -> dict[str, Any]:
    """The indices of an objective; empty if it has none."""
    numbers = (one.get("indices") or {}).get("numbers", {})
    return {} if any(value is None for told in numbers.values() for value in told.values()) else dict(numbers)


def _steps(one: Mapping[str, Any]) -> list[Any]:
    """The steps of convergence of an objective, without those that have no index; empty if there are fewer than two."""
    steps = [step for step in one.get("convergence", []) if None not in step["total"].values()]
    return steps if len(steps) > 1 and _numbers(one) else []
