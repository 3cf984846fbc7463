"""The slow way against the fast one: the nonlinear deck integrated in time gives the feedthrough of the matrices.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pilotgen.activation.reflex import reflex_gains
from pilotgen.context import EvaluationContext
from pilotgen.evaluation import solve_pilot
from pilotgen.linear.feedthrough import make_pilot_model
from pilotgen.study.study import read_study
from pilotgen.virtual.identify import identify
from pilotgen.virtual.virtual_test import VirtualTest, harmonic_test, random_test

STUDY = Path(__file__).parents[2] / "docs" / "studies" / "puma-bmi.yaml"


@pytest.fixture(scope="module")
def context(mbdae: Path) -> Iterator[EvaluationContext]:
    study, _ = read_study(STUDY).with_values({"pilot.torso.model": "rigid"})  # with springs: test_six_axes.py
    with EvaluationContext(study, mbdae=str(mbdae)) as context:
        yield context


@pytest.fixture(scope="module")
def test(context: EvaluationContext) -> VirtualTest:
    return VirtualTest(context, solve_pilot(context, context.study.nominal), reflex_gains("position", "rigid"))


@pytest.fixture(scope="module")
def direct(context: EvaluationContext):  # type: ignore[no-untyped-def]
    matrices = solve_pilot(context, context.study.nominal).matrices
    assert matrices is not None
    model = make_pilot_model(matrices, context.study.inceptor.lever_length_m)
    return lambda hz: model.response(2.0 * np.pi * np.asarray(hz), washout=False)


@pytest.mark.parametrize("frequency", [1.0, 2.3, 3.8, 8.0])
def test_small_sines_agree_with_the_matrices(test: VirtualTest, direct, frequency: float) -> None:  # type: ignore[no-untyped-def]
    """1 % and 1 deg are wanted; integration leaves 1e-5."""
    point = harmonic_test(test, frequency, 0.05)
    assert point.settled
    assert point.response / complex(direct(frequency)) == pytest.approx(1.0, abs=1e-4)
    assert max(point.harmonics) < 1e-3


def test_small_random_motion_agrees_with_the_matrices(test: VirtualTest, direct) -> None:  # type: ignore[no-untyped-def]
    estimate = random_test(test, 0.05, duration_s=16.0)
    ratio = estimate.response / direct(estimate.frequency_hz)
    assert np.abs(np.abs(ratio) - 1.0).max() < 0.001  # 0.01 is wanted, 1 to 8 Hz
    assert np.abs(np.degrees(np.angle(ratio))).max() < 0.1  # 1 deg is wanted
    assert estimate.coherence.min() > 0.9999


def test_the_fixed_step_method_agrees_too(context: EvaluationContext, direct) -> None:  # type: ignore[no-untyped-def]
    """MBDyn's own integrator, 128 steps a period: its error is of second order in the step."""
    pilot = solve_pilot(context, context.study.nominal)
    point = harmonic_test(VirtualTest(context, pilot, reflex_gains("position", "rigid"), integrator="ms"), 4.0, 0.05)
    assert point.response / complex(direct(4.0)) == pytest.approx(1.0, abs=2e-3)


def test_large_motion_is_weakly_nonlinear(test: VirtualTest, direct) -> None:  # type: ignore[no-untyped-def]
    small, large = (harmonic_test(test, 3.0, amplitude) for amplitude in (0.5, 3.0))
    assert abs(large.response / complex(direct(3.0)) - 1.0) < 0.01
    # the second harmonic grows with the amplitude, as a square law does
    assert large.harmonics[0] / small.harmonics[0] == pytest.approx(6.0, rel=0.1)


def test_clipped_muscles_are_another_system_at_every_amplitude(test: VirtualTest, direct) -> None:  # type: ignore[no-untyped-def]
    """A reflex that works one way only has no derivative: smaller motion does not bring the linear result."""
    one, other = (harmonic_test(test, 3.0, amplitude, activation_check=True) for amplitude in (0.05, 0.005))
    ratio = one.response / complex(direct(3.0))
    assert abs(ratio) > 1.2 and math.degrees(np.angle(ratio)) < -10.0
    assert other.response == pytest.approx(one.response, rel=0.01)


def test_a_tonic_floor_keeps_muscles_off_the_stop(mbdae: Path) -> None:
    study = read_study(STUDY)
    tonic = dataclasses.replace(study, pilot=dataclasses.replace(study.pilot, activation_floor=0.01))
    with EvaluationContext(tonic, mbdae=str(mbdae)) as context:
        found = identify(context, study.nominal, ("harmonic",), (0.05,), (3.0,), activation_check=True)
    plain, clipped = found.runs
    assert clipped.activation_check and not plain.activation_check
    assert complex(clipped.response[0]) == pytest.approx(complex(plain.response[0]), rel=1e-3)
    assert abs(complex(found.ratios(clipped)[0]) - 1.0) < 1e-3
