"""The distributed spine of a pilot in his seat, reduced to modes, at the controls: his deck with a modal joint.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pilotgen.anthropometry.spine import SpineModel, carrier_name
from pilotgen.anthropometry.spine_modes import fem_text, reduce_spine
from pilotgen.context import EvaluationContext
from pilotgen.decks.deck import GRAVITY_M_PER_S2
from pilotgen.evaluation import SolvedPilot, solve_pilot
from pilotgen.linear.feedthrough import certificate, make_pilot_model
from pilotgen.linear.pilot_model import PilotModel
from pilotgen.posture.seated_spine import seated_spine
from pilotgen.solver.client import SolverClient
from pilotgen.solver.matrices import read_matrices
from pilotgen.study.study import read_study

STUDY = Path(__file__).parents[2] / "docs" / "studies" / "puma-bmi.yaml"
NOMINAL = {"age_years": 40.0, "bmi": 24.0, "stature_m": 1.775}
FREQUENCIES_HZ = np.array([1.0, 2.0, 3.0, 3.5, 4.0, 5.0, 6.0])


@pytest.fixture(scope="module")
def pilot(mbdae: Path) -> Iterator[SolvedPilot]:
    with EvaluationContext(read_study(STUDY), mbdae=str(mbdae)) as context:
        yield solve_pilot(context, NOMINAL)


@pytest.fixture(scope="module")
def spine(pilot: SolvedPilot) -> SpineModel:
    assert pilot.torso is not None
    return seated_spine(pilot.torso, pilot.cockpit, pilot.biometrics, GRAVITY_M_PER_S2)


def vector(numbers: object) -> str:
    """Numbers as a deck has them."""
    return ", ".join(f"{x:.17g}" for x in np.asarray(numbers).ravel())


def in_modes(
    pilot: SolvedPilot,
    spine: SpineModel,
    solver: SolverClient,
    directory: Path,
    cutoff_hz: float,
    residual_vectors: bool = False,
) -> PilotModel:
    """The pilot's deck with a modal joint in place of the torso's nodes, bodies and springs; in equilibrium."""
    assert pilot.torso is not None
    reduced = reduce_spine(spine, cutoff_hz, interfaces=[carrier_name()], residual_vectors=residual_vectors)
    carrier = spine.bodies[spine.index(carrier_name())]
    text = pilot.deck
    others = [row.name.upper() for row in pilot.torso.torso.bodies if row.name != "thorax"]
    springs = [f"{row.name.upper()}_SPRING" for row in pilot.torso.torso.springs]
    for name in others:
        text = re.sub(rf"\tstructural: {name}, [^;]*;[^\n]*\n", "", text)
        text = re.sub(rf"\tbody: {name}, [^;]*;[^\n]*\n", "", text)
    for name in springs:
        text = re.sub(rf"\tjoint: {name}, deformable joint,[^;]*;\n", "", text)
    text = re.sub(r"structural: SEAT, static,", "structural: SEAT, modal,", text)
    text = re.sub(
        r"structural: THORAX, dynamic, [^;]*;",
        f"structural: THORAX, dynamic, {vector(carrier.place_m)}, eye, null, null;",
        text,
    )
    text = re.sub(
        r"body: THORAX, THORAX,[^;]*;",
        f"body: THORAX, THORAX, {vector(carrier.mass_kg)}, null, diag, {vector(carrier.inertia_kg_m2)};",
        text,
    )
    for side, (mass_kg, place) in pilot.torso.carried_arms.items():
        arm = f"CARRIED_{side.upper()}_ARM"
        offset = vector(np.array(place) - np.array(carrier.place_m))
        text = re.sub(rf"body: {arm}, THORAX,[^;]*;", f"body: {arm}, THORAX, {vector(mass_kg)}, {offset}, null;", text)
    forces = "const, " + ", const, ".join(f"{force:.17g}" for force in reduced.preload)
    text = text.replace(
        "\n\tgravity: uniform",
        f'\n\tjoint: 190, modal, SEAT, {reduced.modes}, from file, damping from file, "spine.fem", '
        f'1, "{carrier_name()}", THORAX, null;\n\tforce: 191, modal, 190, {forces};\n\tgravity: uniform',
    )
    bodies = len(others)
    for card, change in (("structural nodes", -bodies), ("rigid bodies", -bodies), ("joints", 1 - len(springs))):
        text = re.sub(rf"{card}: ([^;]*);", rf"{card}: \1 - {-change};", text)
    text = text.replace("\tgravity;", "\tforces: 1;\n\tgravity;", 1)
    (directory / "spine.fem").write_text(fem_text(reduced))
    (directory / "pilot.mbd").write_text(text)
    solver.request("linearise", name=directory / "pilot.mbd", output=directory / "out.h5")
    matrices = read_matrices(directory / "out.h5")
    assert np.abs(matrices.equilibrium_residual).max() < 1e-6
    return make_pilot_model(matrices, lever_length_m=0.32)


def test_spine_carries_what_the_torso_does(pilot: SolvedPilot, spine: SpineModel) -> None:
    # Everything below the lumbar spine has the lumped torso's load, which was summed another way.
    assert pilot.torso is not None
    for name in ("cushion", "buttocks", "neck", "viscera"):
        assert spine.prestress[name][:3] == pytest.approx(np.array(pilot.torso.prestress[name])[:3], abs=1e-9)
    assert sum(body.mass_kg for body in spine.bodies) == pytest.approx(
        sum(row.mass_kg for row in pilot.torso.torso.bodies), rel=1e-13
    )


def test_pilot_in_modes(pilot: SolvedPilot, spine: SpineModel, solver: SolverClient, tmp_path: Path) -> None:
    omega = 2.0 * np.pi * FREQUENCIES_HZ
    everything = in_modes(pilot, spine, solver, tmp_path, math.inf)
    assert certificate(everything) < 1e-8
    assert everything.poles.real.max() < 0.0
    exact = everything.grip_motion(omega)

    # Truncation, judged by the grip: below 25 Hz, and with residual vectors below 30 Hz.
    for cutoff, vectors, limit in ((25.0, False, 8e-3), (30.0, True, 4e-3)):
        reduced = in_modes(pilot, spine, solver, tmp_path, cutoff, vectors)
        error = np.abs(reduced.grip_motion(omega) - exact).max() / np.abs(exact).max()
        assert error < limit

    # Beside the lumped torso: the same person, within what the division of his trunk does.
    assert pilot.matrices is not None
    lumped = make_pilot_model(pilot.matrices, lever_length_m=0.32).grip_motion(omega)
    assert np.abs(np.abs(exact) / np.abs(lumped) - 1.0).max() < 0.12
    assert np.abs(np.angle(exact / lumped, deg=True)).max() < 10.0
