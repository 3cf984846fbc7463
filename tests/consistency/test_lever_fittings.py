"""Damper, trim spring and balance weight of the lever: their decks against the lever's receptance.

Whatever is fitted to the hinge puts a moment T on the lever, and the lever turns by theta = F a + H T: F is the
feedthrough without fittings, H the receptance of the lever in the pilot's hand. One measured H must explain them all:

    damper d           T = -d s theta
    trim spring k      T = -k theta
    unbalance S        T = -S a cos(theta_0) + S g sin(theta_0) theta    (the balance spring carries the weight at rest)

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import pilotgen as pg
from pilotgen.errors import StudyError

STUDY = pg.read_study("docs/studies/puma-bmi.yaml")
TALL = {"stature_m": 1.9, "bmi": 28.0}
S = 2j * math.pi * np.array([0.8, 1.5, 3.0, 4.2, 7.0])  # rad/s
ANGLE = math.radians(20.0)  # lever at half of its travel, 0 to 40 deg
GRAVITY = 9.81  # m/s^2, as in the decks
LEVER = "cockpit.collective."


def pilot(torso: str, **fittings: float) -> pg.Pilot:
    """The tall pilot with something fitted to his lever."""
    named = {LEVER + key: value for key, value in fittings.items()}
    return pg.evaluate(STUDY, {**TALL, "pilot.torso.model": torso, "pilot.washout_rad_s": None, **named})


def rotation(found: pg.Pilot) -> Any:
    """Lever rotation per seat acceleration at `S`, shape (5,)."""
    model = found.feedthrough()
    return model(S)[list(model.output_labels).index("collective_rotation"), 0]


@pytest.mark.parametrize("torso", ["rigid", "lumped"])
def test_one_receptance_explains_damper_spring_and_balance_weight(torso: str) -> None:
    F = rotation(pilot(torso))
    k, d, u = 20.0, 1.3, -0.12
    H = (F / rotation(pilot(torso, stiffness_n_m_per_rad=k)) - 1.0) / k
    damped = F / (1.0 + d * S * H)
    assert rotation(pilot(torso, damping_n_m_s_per_rad=d)) == pytest.approx(damped, rel=1e-8)
    balanced = (F - H * u * math.cos(ANGLE)) / (1.0 - H * u * GRAVITY * math.sin(ANGLE))
    assert rotation(pilot(torso, unbalance_kg_m=u)) == pytest.approx(balanced, rel=1e-8)
    T = k + d * S - u * GRAVITY * math.sin(ANGLE)
    together = pilot(torso, stiffness_n_m_per_rad=k, damping_n_m_s_per_rad=d, unbalance_kg_m=u)
    assert rotation(together) == pytest.approx((F - H * u * math.cos(ANGLE)) / (1.0 + T * H), rel=1e-8)


def test_the_balance_spring_leaves_nothing_to_the_hand() -> None:
    effort = [pilot("lumped", unbalance_kg_m=u).to_dict()["activation"]["sum_of_squares"] for u in (0.0, 0.2, -0.2)]
    assert effort[1:] == pytest.approx([effort[0]] * 2, rel=1e-9)


def test_a_balance_weight_beyond_the_levers_mass_is_refused() -> None:
    with pytest.raises(StudyError, match=r"cockpit.collective.unbalance_kg_m = 0.5 .*give mass_kg and inertia_kg_m2"):
        STUDY.with_values({LEVER + "unbalance_kg_m": 0.5})
