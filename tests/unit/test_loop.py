"""The loop: sign, gearing, and closed-loop poles from the interconnection.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from pilotgen.errors import PilotgenError
from pilotgen.linear.feedthrough import mayo_pilot
from pilotgen.linear.statespace import StateSpaceModel, transfer_function
from pilotgen.loop.heave_model import HeaveModel
from pilotgen.loop.loop import LoopModel, heave_loop
from pilotgen.study.rotorcraft import load_rotorcraft

OMEGA = 2.0 * math.pi * np.geomspace(0.05, 30.0, 40)
PUMA = HeaveModel(load_rotorcraft("iar330-puma"))


def mayo(frequency_hz: float, damping: float, tau_s: float, lever_length_m: float = 0.32) -> StateSpaceModel:
    """Eq. (40) of the paper, omega_h = 3.10 rad/s."""
    w = 2.0 * math.pi * frequency_hz
    washout = np.polymul([1.0, 3.10], [1.0, 3.10])
    return transfer_function(
        [-1.0 / lever_length_m, -1.0 / (lever_length_m * tau_s), 0.0],
        np.polymul(washout, [1.0, 2.0 * damping * w, w * w]).tolist(),
    )


ECTOMORPHIC, MESOMORPHIC = (3.380, 0.32, 0.117), (3.750, 0.28, 0.107)


@pytest.mark.parametrize(("pilot", "largest"), [(ECTOMORPHIC, 0.60), (MESOMORPHIC, 0.56)])
def test_largest_loop_gain_of_mayos_pilots(pilot: tuple[float, float, float], largest: float) -> None:
    loop = LoopModel(mayo(*pilot), PUMA, 1.1, 0.32)
    omega = 2.0 * math.pi * np.linspace(0.01, 20.0, 20001)
    assert np.abs(loop.response(omega)).max() == pytest.approx(largest, abs=0.005)


def test_loop_is_minus_gearing_times_pilot_times_helicopter() -> None:
    pilot = mayo(*ECTOMORPHIC)
    loop = LoopModel(pilot, PUMA, 1.1, 0.30)
    numerator, denominator = PUMA.transfer_function
    s = 1j * OMEGA
    expected = -1.1 * 0.30 * pilot.response(OMEGA) * np.polyval(numerator, s) / np.polyval(denominator, s)
    np.testing.assert_allclose(loop.response(OMEGA), expected, rtol=1e-10)
    np.testing.assert_allclose(loop.open_loop.response(OMEGA), expected, rtol=1e-10)
    assert loop.open_loop.n_states == 7


def test_lever_length_cancels_for_mayos_pilots() -> None:
    """Mayo's pilots are given by grip travel: theta = G0 l_phi phi and phi = travel / l_phi."""
    short, long = (LoopModel(mayo(*ECTOMORPHIC, lever_length_m=x), PUMA, 1.1, x) for x in (0.27, 0.35))
    np.testing.assert_allclose(short.response(OMEGA), long.response(OMEGA), rtol=1e-10)


def test_closed_loop_poles_are_the_roots_of_one_plus_L() -> None:
    pilot = mayo(2.5, 0.20, 0.06)
    loop = LoopModel(pilot, PUMA, 1.1, 0.32)
    poles = loop.closed_loop_poles
    assert poles.size == 7
    np.testing.assert_allclose(1.0 + loop.open_loop.at(poles), 0.0, atol=1e-7)
    assert poles.real.max() > 0.0  # this pilot makes the Puma unstable


def test_closed_loop_poles_by_feeding_the_equations_back() -> None:
    """Close phi = pilot(zddot), theta = G0 l phi by hand, without the loop transfer function."""
    pilot = mayo(*MESOMORPHIC)
    loop = LoopModel(pilot, PUMA, 1.1, 0.32)
    h, gear = PUMA.state_space, 1.1 * 0.32
    # zddot = C_h x_h + D_h gear C_p x_p (the pilot has no direct term)
    A = np.block(
        [
            [pilot.A + gear * h.D * np.outer(pilot.B, pilot.C), np.outer(pilot.B, h.C)],
            [gear * np.outer(h.B, pilot.C), h.A],
        ]
    )
    expected = np.linalg.eigvals(A)
    expected = expected[np.argsort(np.abs(expected), kind="stable")]
    np.testing.assert_allclose(
        np.sort_complex(np.round(loop.closed_loop_poles, 7)), np.sort_complex(np.round(expected, 7)), atol=2e-6
    )


def test_a_pilot_of_several_inputs_is_refused_by_name() -> None:
    pilot = mayo_pilot(3.4, 0.3, 0.1, 0.32)
    loop = heave_loop(pilot, PUMA, 1.1, 0.32)
    assert loop.pilot.n_states == 4 and loop.pilot_fractions is not None
    two = dataclasses.replace(
        pilot,
        inputs=("seat_heave_acceleration", "seat_roll_acceleration"),
        B=np.hstack((pilot.B, pilot.B)),
        D=np.zeros((1, 2)),
    )
    with pytest.raises(PilotgenError, match="a LoopModel closes one loop, .*this pilot has the inputs .*seat_roll_acc"):
        heave_loop(two, PUMA, 1.1, 0.32)
