"""People at risk: margins over stature and mass with the people in them, and how their margins spread.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pilotgen.figures import style
from pilotgen.figures.style import BLACK, BLUE, GREEN, GREY, VERMILLION, quantity
from pilotgen.objectives import GAIN_MARGIN, OBJECTIVES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

People = Sequence[Mapping[str, str]]  # rows of people.csv
MOST_DOTS = 1500
LINES = {"0.95": "-", "0.99": (0, (4, 2))}  # of the regions


def draw_population(content: Mapping[str, Any], directory: Path) -> None:
    """Write population-margins.png and, where there is a plane, population-plane.png; people.csv is there.

    FileError if that fails.
    """
    with (directory / "people.csv").open(encoding="utf-8", newline="") as file:
        people = list(csv.DictReader(file))
    if content["evaluated"]:
        style.save(margins(content, people), directory / "population-margins.png")
    if content.get("plane"):
        style.save(plane(content, people), directory / "population-plane.png")


@style.styled
def plane(content: Mapping[str, Any], people: People) -> Figure:
    """Gain margin over stature and body mass at the median age, what misses the limits, and the people with regions."""
    from matplotlib.colors import Normalize

    planes = content["plane"]
    figure = style.new_figure(5.2, 6.8 if len(planes) == 1 else style.PAGE_WIDTH_IN)
    panels = figure.subplots(1, len(planes), squeeze=False, sharey=True)[0]
    fields = [np.array(one["margins"][GAIN_MARGIN.key], dtype=float) for one in planes]
    finite = np.concatenate([field[np.isfinite(field)] for field in fields])
    low, high = (float(finite.min()), float(np.percentile(finite, 90.0))) if finite.size else (0.0, 1.0)
    norm = Normalize(low, max(high, low + 0.1))
    limits = {key: one["limit"] for key, one in content["shares"].items() if one.get("limit")}
    for axes, one, field in zip(panels, planes, fields, strict=True):
        _field(axes, one, field, norm)
        _failing(axes, one, limits)
        _dots(axes, [person for person in people if person["sex"] == one["sex"]], limits)
        for key, outline in one["regions"].items():
            axes.plot(*np.array(outline).T, color=BLACK, linestyle=LINES[key], linewidth=1.3,
                      label=f"{100 * float(key):g} % of people")  # fmt: skip
        axes.set_xlim(one["stature_m"][0], one["stature_m"][-1])
        axes.set_ylim(one["mass_kg"][0], one["mass_kg"][-1])
        axes.set_xlabel(quantity("stature_m").axis)
        who = "men" if one["sex"] == "male" else "women"
        axes.set_title(f"{who}, background at {one['age_years']:.0f} years")
    panels[0].set_ylabel(quantity("mass_kg").axis)
    handles = {text: line for axes in panels for line, text in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=3, fontsize=7.5)
    from matplotlib.cm import ScalarMappable

    mappable = ScalarMappable(norm, style.danger_colors())
    bar = figure.colorbar(mappable, ax=panels, label=GAIN_MARGIN.heading, extend="max", aspect=28, pad=0.02)
    limit = limits.get(GAIN_MARGIN.key)
    if limit is not None and norm.vmin is not None and norm.vmax is not None and norm.vmin < limit < norm.vmax:
        bar.ax.axhline(limit, color=VERMILLION, linewidth=1.4)
    return figure


def _field(axes: Axes, one: Mapping[str, Any], field: np.ndarray, norm: Any) -> None:
    stature, mass = np.array(one["stature_m"]), np.array(one["mass_kg"])
    if np.isfinite(field).sum() >= 4:
        levels = np.linspace(norm.vmin, norm.vmax, 25)
        axes.contourf(stature, mass, np.ma.masked_invalid(field), levels=levels, cmap=style.danger_colors(), norm=norm,
                      extend="both", zorder=0)  # fmt: skip
    lost = np.argwhere(~np.isfinite(field))
    if len(lost):
        axes.plot(stature[lost[:, 1]], mass[lost[:, 0]], "x", color=GREY, markersize=5, linestyle="none", zorder=2,
                  clip_on=False, label="cannot be evaluated")  # fmt: skip


def _failing(axes: Axes, one: Mapping[str, Any], limits: Mapping[str, float]) -> None:
    """Outline and hatch where at least one margin is below its limit."""
    from matplotlib.patches import Rectangle

    lacks = [np.array(one["margins"][key], dtype=float) / limit - 1.0 for key, limit in limits.items()]
    if not lacks:
        return
    worst = np.ma.masked_invalid(np.min(np.array(lacks), axis=0))
    if not (worst < 0.0).any():
        return
    stature, mass = one["stature_m"], one["mass_kg"]
    lowest = float(worst.min()) - 1.0
    hatched = axes.contourf(stature, mass, worst, levels=[lowest, 0.0], colors="none", hatches=["///"], zorder=1)
    hatched.set_edgecolor(VERMILLION)
    hatched.set_linewidth(0.0)
    axes.contour(stature, mass, worst, levels=[0.0], colors=VERMILLION, linewidths=1.8, zorder=3)
    label = "below a limit" if len(lacks) > 1 else f"below {limits[next(iter(limits))]:g}"
    axes.add_patch(
        Rectangle((stature[0], mass[0]), 0.0, 0.0, facecolor="none", edgecolor=VERMILLION, hatch="///", label=label)
    )


def _dots(axes: Axes, people: People, limits: Mapping[str, float]) -> None:
    """People as dots, those who miss a limit in red: red ones at their own age, not at the background's."""
    ok = [person for person in people if person["status"] == "ok"][:MOST_DOTS]
    bad = [
        person["stable"] == "false" or any(float(person[key]) < limit for key, limit in limits.items()) for person in ok
    ]
    for which, color, text in ((False, "white", "people"), (True, VERMILLION, "people below a limit, of any age")):
        rows = [person for person, is_bad in zip(ok, bad, strict=True) if is_bad == which]
        if rows:
            axes.scatter(
                [float(person["stature_m"]) for person in rows], [float(person["mass_kg"]) for person in rows],
                s=9.0, facecolor=color, edgecolor=BLACK, linewidths=0.4, alpha=0.85, zorder=4, label=text,
            )  # fmt: skip


@style.styled
def margins(content: Mapping[str, Any], people: People) -> Figure:
    """Share of the people below each margin, with the study's limits."""
    ok = [person for person in people if person["status"] == "ok"]
    shown = {
        key: values for key in OBJECTIVES if np.isfinite(values := np.sort([float(person[key]) for person in ok])).any()
    }
    figure = style.new_figure(3.1, 3.2 * len(shown) + 0.4)
    panels = figure.subplots(1, len(shown), squeeze=False, sharey=True)[0]
    for axes, (key, values) in zip(panels, shown.items(), strict=True):
        row, limit = OBJECTIVES[key], content["shares"].get(key, {}).get("limit")
        finite = np.isfinite(values)
        axes.step(values[finite], 100.0 * np.flatnonzero(finite) / len(values) + 100.0 / len(values), where="post",
                  color=BLUE)  # fmt: skip
        if limit is not None:
            axes.axvline(limit, color=GREEN, linewidth=1.2)
            share = content["shares"][key]
            text = f" {100 * share['share']:.1f} % below {style.typeset(row.text(limit))}"
            axes.text(limit, 92.0, text, fontsize=8.0, bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0})
        axes.set_xlabel(row.heading)
        axes.set_ylim(0.0, 100.0)
        low, last = float(values[finite][0]), float(values[finite][math.ceil(0.99 * finite.sum()) - 1])
        axes.set_xlim(min(low, limit if limit is not None else low) - 0.05 * (last - low), last)
    panels[0].set_ylabel(f"share of {content['name']} below [%]")
    return figure
