"""Loops known at frequencies only against the same loops known exactly.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from pilotgen.linear.statespace import StateSpaceModel, zeros_poles_gain
from pilotgen.loop.frequency_data import FrequencyData
from pilotgen.loop.margins import data_margins, margins


def random_loop(rng: np.random.Generator) -> tuple[StateSpaceModel, int, int]:
    """Three to seven poles of damping 0.05 or more, some unstable, some at the origin; strictly proper."""
    poles: list[complex] = []
    while len(poles) < 3:
        omega, zeta = 10.0 ** rng.uniform(-1.0, 1.0), rng.uniform(0.05, 0.9)
        side = -1.0 if rng.random() < 0.2 else 1.0
        if rng.random() < 0.6:
            p = complex(-side * zeta * omega, omega * math.sqrt(1.0 - zeta * zeta))
            poles += [p, p.conjugate()]
        else:
            poles.append(complex(-side * omega))
    origin = int(rng.integers(0, 3)) if rng.random() < 0.4 else 0
    zeros = [complex(-(10.0 ** rng.uniform(-1.0, 1.0))) for _ in range(int(rng.integers(0, 2)))]
    model = zeros_poles_gain(zeros, [*poles, *[0j] * origin], 1.0)
    gain = 10.0 ** rng.uniform(-1.0, 1.0) / float(np.abs(model.response(1.0))) * float(rng.choice([1.0, 1.0, -1.0]))
    return model.scaled(gain), sum(p.real > 0.0 for p in poles), origin


@pytest.mark.parametrize("seed", range(40))
def test_random_loops(seed: int) -> None:
    model, unstable, origin = random_loop(np.random.default_rng([9, seed]))
    right = margins(model)
    omega = np.geomspace(1e-4, 1e4, 1600)
    m, answer = data_margins(FrequencyData(omega, model.response(omega), unstable, origin))
    assert m.stable is None or m.stable == right.stable, answer.reason
    assert m.stable is not None or right.modulus_margin < 0.01
    assert m.modulus_margin == pytest.approx(right.modulus_margin, abs=2e-4)
    assert m.modulus_margin - right.modulus_margin <= answer.nearest_error + 2e-6
    mine = [c for c in m.crossings if c.kind == "unit circle"]
    wanted = [c for c in right.crossings if c.kind == "unit circle"]
    assert len(mine) == len(wanted)
    for a, b in zip(mine, wanted, strict=True):
        assert abs(a.value - b.value) < 1e-3
    # Few points: a verdict is right, or there is none.
    for count in (12, 25, 50, 100):
        omega = np.geomspace(1e-3, 1e3, count)
        m, _ = data_margins(FrequencyData(omega, model.response(omega), unstable, origin))
        assert m.stable is None or m.stable == right.stable


def test_reasons_why_nothing_is_told() -> None:
    omega = np.geomspace(0.01, 100.0, 100)
    lag = StateSpaceModel(np.array([[-1.0]]), np.ones(1), np.array([5.0]), 0.0)
    L = lag.response(omega)
    told = [
        data_margins(FrequencyData(*arguments))[1]
        for arguments in (
            (omega, L, None),
            (omega[:50], L[:50], 0),
            (omega[50:], L[50:], 0),
            (omega, L, 0, 2),
            (omega, -L, 0),
            (omega, L / L[50] * -1.0, 0),
        )
    ]
    reasons = ("is not given", "measure higher", "measure lower", "measure lower", "", "from -1 and may be")
    for answer, words in zip(told, reasons, strict=True):
        assert answer.stable is (None if words else False) and words in answer.reason
    assert data_margins(FrequencyData(omega, -L, 1))[1].stable is False  # two unstable poles
    assert data_margins(FrequencyData(omega, L, 0))[1].stable is True
    encircling = StateSpaceModel(np.array([[1.0]]), np.ones(1), np.array([5.0]), 0.0).response(omega)  # 5 / (s - 1)
    assert data_margins(FrequencyData(omega, encircling, 1))[1].stable is True
    assert "do not allow" in data_margins(FrequencyData(omega, encircling, 0))[1].reason


def test_the_ends_of_the_data_count() -> None:
    """L = -0.6/(s + 1) is nearest to -1 at rest, 0.6/(s + 1) at infinity, where no data are."""
    omega = np.geomspace(0.05, 50.0, 120)
    m, _ = data_margins(FrequencyData(omega, -0.6 / (1j * omega + 1.0), 0))
    assert m.stable
    assert m.gain_margin_hz == m.modulus_margin_hz == 0.0
    error = m.interpolation_error
    assert error is not None
    assert abs(m.gain_margin_db + 20.0 * math.log10(0.6)) <= error["gain_margin_db"] < 1e-3
    assert abs(m.modulus_margin - 0.4) <= error["modulus_margin"] < 1e-4
    # L = 0.6/(s + 1) comes nearest at infinity, beyond the data: the error says by how much.
    m, _ = data_margins(FrequencyData(omega, 0.6 / (1j * omega + 1.0), 0))
    assert m.interpolation_error is not None
    assert 0.0 < m.modulus_margin - 1.0 <= m.interpolation_error["modulus_margin"] < 0.05
