"""Six motions of the seat: every entry of the feedthrough matrix against the full-order response and against time.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from pilotgen.activation.reflex import reflex_gains
from pilotgen.bench.stages import random_pilots
from pilotgen.context import EvaluationContext
from pilotgen.errors import MatrixError, StudyError
from pilotgen.evaluation import SolvedPilot, solve_pilot
from pilotgen.linear.feedthrough import certificates, make_pilot_model
from pilotgen.linear.imposed_motion import SEAT_MOTIONS, Channels, rotation_error, split, translation_error
from pilotgen.linear.pilot_model import PilotModel
from pilotgen.solver.matrices import Matrices, descriptor
from pilotgen.study.study import read_study
from pilotgen.virtual.random_axes import random_matrix_test
from pilotgen.virtual.virtual_test import VirtualTest, harmonic_test

STUDY = Path(__file__).parents[2] / "docs" / "studies" / "puma-bmi.yaml"
ALL = tuple(SEAT_MOTIONS)
OMEGA = 2.0 * np.pi * np.geomspace(0.1, 20.0, 40)
GRAVITY = 9.81


@pytest.fixture(scope="module")
def context(mbdae: Path) -> Iterator[EvaluationContext]:
    study = read_study(STUDY)
    study = dataclasses.replace(study, pilot=dataclasses.replace(study.pilot, limbs=("left", "right")))
    with EvaluationContext(study, mbdae=str(mbdae)) as context:
        yield context


@pytest.fixture(scope="module")
def solved(context: EvaluationContext) -> SolvedPilot:
    return solve_pilot(context, context.study.nominal)


@pytest.fixture(scope="module")
def six(solved: SolvedPilot) -> PilotModel:
    assert solved.matrices is not None
    return make_pilot_model(solved.matrices, 0.32, 3.1, channels=Channels(inputs=ALL))


def positions(matrices: Matrices) -> dict[str, np.ndarray]:
    return {bytes(name).decode(): x for name, x in zip(matrices.nodes.name, matrices.nodes.position, strict=True)}


def test_every_entry_of_random_pilots_is_certified(context: EvaluationContext) -> None:
    for values in random_pilots(context.study, 4):
        matrices = solve_pilot(context, values).matrices
        assert matrices is not None
        model = make_pilot_model(matrices, 0.32, channels=Channels(inputs=ALL, point_m=(0.3, -0.4, 0.1)))
        found = certificates(model, np.geomspace(0.5, 20.0, 40))
        assert found.shape == (3, 6)
        assert found.max() < 1e-7  # the least of the entries, heave on the stick to the right, has lost a digit by then
        assert certificates(model).max() < 1e-6  # from 0.1 Hz: the full model's round-off, divided by w^2


def test_a_rotation_is_a_tilt_of_gravity(solved: SolvedPilot) -> None:
    assert solved.matrices is not None
    model, where = descriptor(solved.matrices), positions(solved.matrices)
    channels = Channels(inputs=ALL, point_m=(0.2, 0.1, -0.3))
    imposed = split(model, channels, where)
    fall = split(model, dataclasses.replace(channels, inputs=("surge", "sway")), where)
    for j, name in enumerate(ALL):
        if not SEAT_MOTIONS[name].rotation:
            assert translation_error(imposed, j) < 1e-12
            continue
        violation, gravity = rotation_error(imposed, j, fall)
        assert violation < 1e-12
        assert np.isnan(gravity) if name == "yaw" else gravity == pytest.approx(GRAVITY, rel=1e-9)


def test_what_stands_in_place_of_the_double_zero(six: PilotModel) -> None:
    """phi/theta(0) of pitch is g times BDFT of surge at rest, of roll -g times that of sway; so is the next term."""
    assert six.tilt is not None and six.residues is not None
    at_rest = -(six.residues / six.poles[:, None]).sum(axis=1).real
    slope = -(six.residues / six.poles[:, None] ** 2).sum(axis=1).real
    surge, sway, roll, pitch, yaw = (ALL.index(name) for name in ("surge", "sway", "roll", "pitch", "yaw"))
    for k, values in enumerate((at_rest, slope)):
        assert_allclose(six.tilt[:, pitch, k], GRAVITY * values[:, surge], rtol=1e-8)
        assert_allclose(six.tilt[:, roll, k], -GRAVITY * values[:, sway], rtol=1e-8)
        assert np.abs(six.tilt[:, yaw, k]).max() < 1e-8 * np.abs(six.tilt[..., k]).max()
        assert not six.tilt[:, :3, k].any()


def test_another_point_is_a_sum_of_columns(solved: SolvedPilot, six: PilotModel) -> None:
    """Turning about P is turning about the seat and moving it by axis x (seat - P)."""
    assert solved.matrices is not None
    point = np.array([0.4, -0.2, 0.15])
    moved = make_pilot_model(solved.matrices, 0.32, 3.1, channels=Channels(inputs=("pitch",), point_m=tuple(point)))
    dx, dy, dz = np.cross([0.0, 0.0, 1.0], -point)
    for output in range(3):
        H = {name: six.response(OMEGA, output, input=ALL.index(name)) for name in ALL}
        wanted = H["pitch"] + dx * H["surge"] + dy * H["heave"] + dz * H["sway"]
        assert_allclose(moved.response(OMEGA, output), wanted, rtol=1e-7)


@pytest.mark.parametrize("washout", [True, False])
def test_the_state_space_of_the_matrix(six: PilotModel, washout: bool) -> None:
    A, B, C, D = six.state_space([0, 1, 2], washout)
    s = 1j * OMEGA[:, None, None]
    H = C @ np.linalg.solve(s * np.eye(len(A)) - A, np.broadcast_to(B.astype(complex), (len(OMEGA), *B.shape))) + D
    for output in range(3):
        for j in range(6):
            assert_allclose(H[:, output, j], six.response(OMEGA, output, washout, j), rtol=1e-7)
            fractions = six.partial_fractions(output, j) if washout else None
            if fractions is not None:
                assert_allclose(fractions.at(1j * OMEGA), six.response(OMEGA, output, True, j), rtol=1e-7)


def test_heave_alone_is_the_same_to_the_last_bit(solved: SolvedPilot) -> None:
    assert solved.matrices is not None
    one = make_pilot_model(solved.matrices, 0.32, 3.1)
    again = make_pilot_model(solved.matrices, 0.32, 3.1, channels=Channels(inputs=("heave",)))
    assert all((a == b).all() for a, b in zip(one.state_space(), again.state_space(), strict=True))


@pytest.mark.parametrize("motion", [name for name in ALL if name != "heave"])
def test_sines_in_every_direction(
    context: EvaluationContext, solved: SolvedPilot, six: PilotModel, motion: str
) -> None:
    output, channel = (2, "stick.gx") if motion == "sway" else (0, "lever.gz")
    test = VirtualTest(context, solved, reflex_gains("position", "lumped"), motion=motion, output=channel)
    point = harmonic_test(test, 3.0, 0.02)
    expected = complex(six.response(2.0 * np.pi * 3.0, output, washout=False, input=ALL.index(motion)))
    assert point.settled
    assert abs(point.response / expected - 1.0) < 1e-3


def test_several_directions_at_once(context: EvaluationContext, solved: SolvedPilot, six: PilotModel) -> None:
    """Errors count against what all motions together make the control do."""
    motions, arm = ("heave", "sway", "pitch"), 0.5
    test = VirtualTest(context, solved, reflex_gains("position", "lumped"))
    found = random_matrix_test(
        test, motions, ["lever.gz", "stick.gz", "stick.gx"], 0.02, arm, realisations=4, period_s=2.0, band_hz=(1.0, 5.0)
    )
    amplitude = np.array([1.0, 1.0, 1.0 / arm])
    omega = 2.0 * np.pi * found.frequency_hz
    for output in range(3):
        expected = [six.response(omega, output, washout=False, input=ALL.index(motion)) for motion in motions]
        moved = np.abs(np.array(expected).T) * amplitude
        wrong = np.abs(found.response[:, output] - np.array(expected).T) * amplitude
        assert wrong.max() < 0.01 * moved.max()
    assert found.coherence.min() > 0.9999
    with pytest.raises(StudyError, match="3 motions need at least 4 realisations; got 3"):
        random_matrix_test(test, motions, ["lever.gz"], 0.02, realisations=3)


def test_what_cannot_be_is_refused_by_name(solved: SolvedPilot) -> None:
    assert solved.matrices is not None
    for channels, message in (
        ({"inputs": ("heave", "bounce")}, "seat motion 'bounce' is not known; known: heave, surge"),
        ({"inputs": ("pedals",)}, "seat motion 'pedals' is not known; .* pedals are not modelled"),
        ({"outputs": {"pedal_left": {"pedal.x": 1.0}}}, "output 'pedal_left': pedals are not modelled"),
        ({"inputs": ("heave", "heave")}, "named once each"),
        ({"inputs": ()}, "named once each; got none"),
    ):
        with pytest.raises(StudyError, match=message):
            Channels(**channels)
    with pytest.raises(StudyError, match="one translation"):
        make_pilot_model(solved.matrices, 0.32, projection="literal", channels=Channels(inputs=ALL))
    with pytest.raises(MatrixError, match="need the positions of the nodes"):
        make_pilot_model(descriptor(solved.matrices), 0.32, channels=Channels(inputs=("roll",)))
