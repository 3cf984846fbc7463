"""Figures: one pilot's loop, and what a study found. Every function returns a matplotlib `Figure`; nothing is shown.

SPDX-License-Identifier: BSD-3-Clause
"""

from pilotgen.figures.loop import bode, draw_pilot, nyquist
from pilotgen.figures.population import draw_population
from pilotgen.figures.rotorcraft import rotorcraft_bode
from pilotgen.figures.sensitivity import draw_sensitivity
from pilotgen.figures.study import all_individuals, convergence, margin_curves, objective_plane, populations
from pilotgen.figures.uncertain import draw_uncertain

__all__ = [
    "all_individuals",
    "bode",
    "convergence",
    "draw_pilot",
    "draw_population",
    "draw_sensitivity",
    "draw_uncertain",
    "margin_curves",
    "nyquist",
    "objective_plane",
    "populations",
    "rotorcraft_bode",
]
