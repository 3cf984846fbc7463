"""Friction of the lever as a cure: its damper against the closed form, the harmonic balance, and the deck in time.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import pilotgen as pg
from pilotgen.closed_loop.deck import ClosedLoop, close_in_deck, friction_of
from pilotgen.closed_loop.harmonic import HarmonicBalance
from pilotgen.closed_loop.refine import limit_cycles
from pilotgen.closed_loop.simulate import disturbance, simulate
from pilotgen.closed_loop.swing_model import SwingModel
from pilotgen.closed_loop.threshold import swings
from pilotgen.context import EvaluationContext
from pilotgen.cures.catalogue import changes
from pilotgen.cures.friction import GripSwing, as_built, like, more_friction
from pilotgen.study.study import read_study

STUDY = read_study(Path(__file__).parents[2] / "docs" / "studies" / "puma-bmi.yaml")
WHO = {"age_years": 25.0, "bmi": 30.0, "stature_m": 2.0}
FRICTION_N, SWING_M = 3.0, 0.010


@pytest.fixture(scope="module")
def margin() -> tuple[float, float]:
    """Gain margin [dB] of swings of 10 mm with 3 N, and its frequency [Hz], by repetition as a study does it."""
    hz = 3.6
    for _ in range(6):
        cured = pg.evaluate(STUDY, {**WHO, **changes(STUDY, {"friction": FRICTION_N}, 3.6, GripSwing(SWING_M, hz))})
        assert cured.margins.gain_margin_hz is not None
        hz = cured.margins.gain_margin_hz
    return cured.margins.gain_margin_db, hz


@pytest.fixture(scope="module")
def context() -> Iterator[EvaluationContext]:
    with EvaluationContext(STUDY) as context:
        yield context


@pytest.fixture(scope="module")
def loop(context: EvaluationContext, margin: tuple[float, float]) -> ClosedLoop:
    """The pilot with so much more gearing that a swing of 10 mm keeps itself up."""
    gearing = STUDY.inceptor.gearing_rad_per_m * 10.0 ** (margin[0] / 20.0)
    return close_in_deck(context, {**STUDY.nominal, **WHO, "inceptor.gearing_rad_per_m": gearing})


@pytest.mark.parametrize(("force", "amplitude", "hz"), [(5.0, 0.01, 3.6), (71.0, 0.002, 7.0), (36.0, 0.08, 2.0)])
def test_the_damper_that_coulomb_friction_is_like(force: float, amplitude: float, hz: float) -> None:
    damper, spring = like(more_friction(STUDY, force), GripSwing(amplitude, hz))
    assert damper == pytest.approx(4.0 * force / (math.pi * 2.0 * math.pi * hz * amplitude), rel=2e-4)
    assert abs(spring) < 1e-9 * damper


def test_bristles_are_a_spring_in_small_swings() -> None:
    study, _ = STUDY.with_values({"inceptor.friction.breakout_n": 5.0, "inceptor.friction.model": "lugre"})
    damper, spring = like(more_friction(study, 10.0), GripSwing(2e-5, 3.0))
    assert spring == pytest.approx(10.0 / 2e-4, rel=0.02)  # breakout over presliding
    assert damper == pytest.approx(0.5 * 10.0, rel=0.05)


def test_friction_is_added_to_what_the_lever_has() -> None:
    own = {"breakout_n": 5.0, "stribeck_n": 1.0, "viscous_n_s_per_m": 2.0}
    study, _ = STUDY.with_values({f"inceptor.friction.{name}": value for name, value in own.items()})
    built = as_built(study, 10.0)
    assert built == {f"inceptor.friction.{name}": pytest.approx(3.0 * value) for name, value in own.items()}
    cured, _ = study.with_values(built)
    total, more = friction_of(cured), more_friction(study, 10.0)
    assert total is not None and total.sliding_n == pytest.approx(12.0) and more.sliding_n == pytest.approx(8.0)
    assert as_built(STUDY, 10.0) == {"inceptor.friction.breakout_n": 10.0}


def test_the_margin_is_the_gearing_at_which_a_swing_keeps_itself_up(
    context: EvaluationContext, loop: ClosedLoop, margin: tuple[float, float]
) -> None:
    """By the harmonic balance of the closed deck, which knows of no margin; muscles not clipped, as margins have it."""
    model = SwingModel(context, loop, clipped=False, stops=False)
    balance = HarmonicBalance(model, more_friction(STUDY, FRICTION_N))
    low, high = balance.sweep(np.array([7e-3, 1.4e-2]))[0]
    assert low.growth_rad_s < 0.0 < high.growth_rad_s
    (cycle,) = limit_cycles(balance, [low, high], high.amplitude_m)
    assert not cycle.stable and not cycle.trouble  # larger swings feel less friction, and grow
    assert cycle.swing.amplitude_m == pytest.approx(SWING_M, rel=1e-2)  # geometry has 0.5 %
    assert cycle.swing.frequency_hz == pytest.approx(margin[1], rel=1e-3)


def test_the_deck_in_time_parts_there(
    context: EvaluationContext, loop: ClosedLoop, margin: tuple[float, float]
) -> None:
    found = []
    for kick in (17.2, 17.3):  # N; bisected once
        motion = simulate(
            context, loop, disturbance("lever", kick), 3.0, linear=True, friction=more_friction(STUDY, FRICTION_N)
        )
        _, size, half = swings(motion, 0.6)
        found.append((size[:12], half[:12]))
    (dies, _), (grows, half) = found
    assert dies[11] < dies[3] and grows[11] > grows[3]
    assert float(np.mean([dies[2:8], grows[2:8]])) == pytest.approx(SWING_M, rel=0.03)
    assert 0.5 / float(np.mean(half[2:8])) == pytest.approx(margin[1], rel=0.01)
