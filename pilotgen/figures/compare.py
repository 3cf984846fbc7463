"""Two studies in one figure: their clouds, and how many pilots have which gain margin.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pilotgen.figures import style
from pilotgen.figures.style import BLUE, VERMILLION, MarginScale, quantity
from pilotgen.objectives import GAIN_MARGIN

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pilotgen.runs.results import StudyResults

BINS = 16
COLORS, MARKERS = (BLUE, VERMILLION), ("o", "^")


@style.styled
def two_clouds(sides: Sequence[tuple[str, StudyResults, np.ndarray]], variables: Sequence[str]) -> Figure:
    """Gain margin over the variable that moves it most, and histograms of the evenly spread pilots.

    Parameters
    ----------
    sides : sequence of (name, StudyResults, ndarray)
        The two studies; indices of the pilots that cover the box evenly.
    variables : sequence of str
        What both vary.
    """
    figure = style.new_figure(3.6)
    cloud, bars = figure.subplots(1, 2, width_ratios=(1.3, 1.0))
    name = max(variables, key=lambda one: _strength(sides[0][1], one))
    margins = [results.columns[GAIN_MARGIN.key] for _, results, _ in sides]
    scale = MarginScale.of(*margins)
    for (label, results, _), color, marker in zip(sides, COLORS, MARKERS, strict=True):
        ok = results.columns["status"] == "ok"
        values = results.columns["inputs"][ok, results.names.index(name)]
        cloud.scatter(
            values, scale.place(results.columns[GAIN_MARGIN.key][ok]), s=12, color=color, marker=marker, alpha=0.6,
            linewidths=0, label=label,
        )  # fmt: skip
    scale.apply(cloud)
    cloud.set_xlabel(quantity(name).axis)
    cloud.set_ylabel(quantity(GAIN_MARGIN.key).axis)
    cloud.legend()
    finite = [margin[even][np.isfinite(margin[even])] for margin, (_, _, even) in zip(margins, sides, strict=True)]
    everything = np.concatenate(finite)
    if everything.size:
        edges = np.histogram_bin_edges(everything, BINS)
        for values, (label, _, _), color in zip(finite, sides, COLORS, strict=True):
            if values.size:
                weights = np.full(values.size, 100.0 / values.size)
                bars.hist(values, edges, weights=weights, histtype="stepfilled", alpha=0.35, color=color, label=label)
                bars.hist(values, edges, weights=weights, histtype="step", linewidth=1.5, color=color)
    bars.set_xlabel(quantity(GAIN_MARGIN.key).axis)
    bars.set_ylabel("evenly spread pilots [%]")
    return figure


def _strength(results: StudyResults, name: str) -> float:
    """How much of the gain margin goes with a variable: the magnitude of their correlation."""
    values = results.columns["inputs"][:, results.names.index(name)]
    margin = results.columns[GAIN_MARGIN.key]
    finite = np.isfinite(margin)
    if finite.sum() < 3 or not np.ptp(values[finite]) or not np.ptp(margin[finite]):
        return 0.0
    return abs(float(np.corrcoef(values[finite], margin[finite])[0, 1]))
