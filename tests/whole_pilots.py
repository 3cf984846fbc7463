"""Whole pilots for tests: the chain from a body, which may be no real one, to its feedthrough.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from pilotgen.activation.activation import Activations, solve_activations
from pilotgen.activation.reflex import calibrated_gains
from pilotgen.anthropometry.biometrics import biometrics_from
from pilotgen.anthropometry.body import Body, make_body
from pilotgen.decks.deck import render_direct, render_posture, render_trim
from pilotgen.linear.feedthrough import make_pilot_model
from pilotgen.linear.pilot_model import PilotModel
from pilotgen.posture.cockpit import Cockpit, make_cockpit
from pilotgen.posture.posture import Posture, first_guess, from_poses
from pilotgen.solver.client import SolverClient
from pilotgen.solver.matrices import read_matrices
from pilotgen.study.cockpit_numbers import cockpit_numbers
from pilotgen.study.sections import Reflex

LEVER_LENGTH_M = 0.32
NOMINAL = {"age_years": 40.0, "bmi": 24.0, "stature_m": 1.775}


@dataclass(frozen=True)
class WholePilot:
    """One pilot and what was found on the way."""

    body: Body
    cockpit: Cockpit
    posture: Posture
    activations: Activations
    model: PilotModel


def body_of(values: dict[str, float] | None = None, sex: str = "male", limbs: tuple[str, ...] = ("left",)) -> Body:
    """The body that pilotgen makes."""
    return make_body(biometrics_from(values or NOMINAL, sex), limbs)


def cockpit_of(body: Body, overrides: dict | None = None) -> Cockpit:
    """The bundled cockpit, or one that differs from it."""
    return make_cockpit(body, lever_length_m=LEVER_LENGTH_M, position=0.5, numbers=cockpit_numbers(overrides))


def solve(
    solver: SolverClient,
    directory: Path,
    body: Body,
    cockpit: Cockpit | None = None,
    gains: Reflex | None = None,
) -> WholePilot:
    """Posture, activations and feedthrough of a body in a cockpit; the calibrated gains of the position task."""
    cockpit = cockpit or cockpit_of(body)
    gains = gains or calibrated_gains("rigid")["position"]
    guess = first_guess(body, cockpit)
    reply = solver.request("static", deck_text=render_posture(body, cockpit, guess), name="posture.mbd")
    posture = from_poses(body, cockpit, reply.nodes)
    trim_file, pilot_file = directory / "trim.h5", directory / "pilot.h5"
    text = render_trim(body, cockpit, posture, gains=gains, c=0.01)
    solver.request("linearise", deck_text=text, name="trim.mbd", output=trim_file)
    trim = read_matrices(trim_file)
    activations = solve_activations(trim, body, cockpit)
    text = render_direct(
        body, cockpit, posture, activations=activations, muscle_lengths=trim.muscles.length, gains=gains, c=0.01
    )
    solver.request("linearise", deck_text=text, name="pilot.mbd", output=pilot_file)
    model = make_pilot_model(read_matrices(pilot_file), LEVER_LENGTH_M)
    return WholePilot(body, cockpit, posture, activations, model)


def stronger(body: Body, factor: float) -> Body:
    """The same body with every muscle's force times `factor`."""
    limbs = {
        side: replace(limb, muscles=tuple(m._replace(F0_N=factor * m.F0_N) for m in limb.muscles))
        for side, limb in body.limbs.items()
    }
    return replace(body, limbs=limbs)


def heavier(body: Body, factor: float) -> Body:
    """The same body with the mass and inertia of every arm segment times `factor`."""
    limbs = {
        side: replace(
            limb,
            segments={
                name: replace(s, mass_kg=factor * s.mass_kg, inertia_kg_m2=factor * s.inertia_kg_m2)
                for name, s in limb.segments.items()
            },
        )
        for side, limb in body.limbs.items()
    }
    return replace(body, limbs=limbs)
