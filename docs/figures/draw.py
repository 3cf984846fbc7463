"""Draw the figures of the documentation again.

`python docs/figures/draw.py` draws those of docs/validation.md (about two minutes),
`python docs/figures/draw.py results/puma-bmi/study.h5` those of README.md from a finished search, and
`python docs/figures/draw.py results/population results/sensitivity results/uncertain` those of docs/studies/README.md
from what `pilotgen population`, `sensitivity` and `pilot --uncertain` left there.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import csv
import dataclasses
import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from pilotgen.context import EvaluationContext
from pilotgen.evaluation import Evaluation, evaluate
from pilotgen.figures import all_individuals, nyquist, style
from pilotgen.figures.identification import identification
from pilotgen.figures.population import plane
from pilotgen.figures.sensitivity import indices
from pilotgen.figures.uncertain import nyquist_band
from pilotgen.linear.full_order import full_order_response
from pilotgen.report.findings import worst_order
from pilotgen.runs.results import read_results
from pilotgen.study.study import read_study, study_from_text
from pilotgen.virtual.identify import identify

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HERE = Path(__file__).parent
STUDY = HERE.parent / "studies" / "puma-bmi.yaml"
LOW_HZ, HIGH_HZ = 0.1, 20.0


@style.styled
def projection() -> None:
    """projection.png: the exact feedthrough, eq. (31) as printed, the full-order response; and the loops."""
    study = read_study(STUDY)
    found: dict[str, Evaluation] = {}
    for name in ("exact", "literal"):
        own = dataclasses.replace(study, pilot=dataclasses.replace(study.pilot, projection=name))
        with EvaluationContext(own) as context:
            outcome = evaluate(context, study.nominal)
        assert isinstance(outcome, Evaluation), outcome
        found[name] = outcome
    looks = {
        "exact": ("exact", style.BLUE, "-"),
        "literal": ("eq. (31) as printed", style.VERMILLION, (0, (4, 2))),
    }
    grid = np.geomspace(LOW_HZ, HIGH_HZ, 400)
    points = np.geomspace(LOW_HZ, HIGH_HZ, 19)
    imposed = found["exact"].pilot_model.imposed
    assert imposed is not None
    full = 1e3 * study.inceptor.lever_length_m * full_order_response(imposed, 2.0 * np.pi * points)
    figure = style.new_figure(5.4)
    (magnitude, loop), (phase, angle) = figure.subplots(2, 2, sharex=True, height_ratios=(1.25, 1.0))
    for name, (label, color, line) in looks.items():
        outcome = found[name]
        H = 1e3 * outcome.pilot_model.grip_motion(2.0 * np.pi * grid)
        L = outcome.loop.response(2.0 * np.pi * grid)
        magnitude.plot(grid, np.abs(H), color=color, linestyle=line, label=label)
        phase.plot(grid, np.degrees(np.unwrap(np.angle(H))), color=color, linestyle=line)
        verdict = outcome.margins
        state = "stable" if verdict.stable else "UNSTABLE"
        text = f"{label}: {state}, gain margin {verdict.gain_margin_db:.1f} dB".replace("-", "−")
        loop.plot(grid, 20.0 * np.log10(np.abs(L)), color=color, linestyle=line, label=text)
        angle.plot(grid, np.degrees(np.unwrap(np.angle(L))), color=color, linestyle=line)
    magnitude.plot(points, np.abs(full), "o", color=style.BLACK, markersize=3.5, label="full order, every unknown")
    phase.plot(points, np.degrees(np.unwrap(np.angle(full))), "o", color=style.BLACK, markersize=3.5)
    magnitude.set_yscale("log")
    magnitude.set_title("seat acceleration → collective grip, without washout")
    magnitude.set_ylabel("grip motion [mm per m/s²]")
    magnitude.legend(loc="lower left")
    loop.set_title("loop with the Puma, washout included")
    loop.set_ylabel("|L| [dB]")
    loop.axhline(0.0, color=style.BLACK, linewidth=0.9, zorder=1)
    loop.set_ylim(-60.0, 30.0)
    loop.legend(loc="lower left")
    for axes in (phase, angle):
        axes.set_ylabel("phase [deg]")
        style.frequency_axis(axes, LOW_HZ, HIGH_HZ)
    style.save(figure, HERE / "projection.png")


def simulated() -> None:
    """identification.png: the virtual tests at three amplitudes, muscles clipped and not."""
    study = read_study(STUDY)
    with EvaluationContext(study) as context:
        found = identify(context, study.nominal, amplitudes_m_s2=(0.05, 1.0, 3.0), activation_check=True)
    style.save(identification(found), HERE / "identification.png")


def searched(path: Path) -> None:
    """search.png: every pilot that a search evaluated; nyquist.png: the loops of the nominal and of the worst one."""
    results = read_results(path)
    worst = int(worst_order(results)[0])
    style.save(all_individuals(results, worst), HERE / "search.png")
    study = study_from_text(str(results.attributes["study_text"]), str(path))
    inputs = dict(zip(results.names, results.columns["inputs"][worst].tolist(), strict=True))
    pilots = []
    with EvaluationContext(study) as context:
        for name, values in (("nominal pilot", study.nominal), ("worst pilot", study.values(inputs))):
            outcome = evaluate(context, values)
            assert isinstance(outcome, Evaluation), outcome
            pilots.append((name, outcome))
    style.save(nyquist(pilots), HERE / "nyquist.png")


def people(directory: Path) -> None:
    """people.png, decides.png or known.png: what population.json, sensitivity.json or uncertain.json says."""
    for name, draw, target in (
        ("population", population_plane, "people.png"),
        ("sensitivity", lambda content, _: indices(content), "decides.png"),
        ("uncertain", lambda content, _: nyquist_band(content), "known.png"),
    ):
        path = directory / f"{name}.json"
        if path.is_file():
            style.save(draw(json.loads(path.read_text(encoding="utf-8")), directory), HERE / target)


def population_plane(content: Mapping[str, Any], directory: Path) -> Figure:
    """Margins over stature and mass, with the people of people.csv."""
    with (directory / "people.csv").open(encoding="utf-8", newline="") as file:
        return plane(content, list(csv.DictReader(file)))


if __name__ == "__main__":
    if len(sys.argv) > 1:
        for argument in map(Path, sys.argv[1:]):
            (people if argument.is_dir() else searched)(argument)
    else:
        projection()
        simulated()
