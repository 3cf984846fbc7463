"""Friction of the lever as a cure: what it is like in a swing of a given size, and as the study's own numbers.

Friction leaves nothing in a linear margin, for no force is small beside it in a small motion. In a swing of amplitude A
at omega its first harmonic acts as a damper does, of 4 F/(pi omega A) if it is Coulomb's: the larger the swing, the
less (docs/theory/cures.md). The force itself is that of the harmonic balance (`closed_loop/elements.py`).

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from pilotgen.closed_loop.deck import friction_of
from pilotgen.closed_loop.elements import friction_force
from pilotgen.closed_loop.limit_cycles import scaled
from pilotgen.decks.vehicle import Friction
from pilotgen.study.inceptor_section import INCEPTOR_ROWS
from pilotgen.study.study import Study

SWING_MM = 10.0  # amplitude of the grip for which friction is told, if nobody says another (docs/theory/cures.md)
LEVELS_N = (0.0, 2.0, 5.0, 10.0, 20.0, 36.0, 66.0)  # at which swings that grow are looked for; the last two from bounce
# accidents and a UH-1B's manual (pilotgen/data/cures.yaml)
SAMPLES = 256  # of a period
_PATH = "inceptor.friction"


@dataclass(frozen=True)
class GripSwing:
    """A swing of the grip.

    Attributes
    ----------
    amplitude_m, frequency_hz : float
        From the middle to one end [m]; [Hz].
    """

    amplitude_m: float
    frequency_hz: float


def more_friction(study: Study, breakout_n: float) -> Friction:
    """Friction of so much breakout force [N] more: of the kind that the study's lever has, else Coulomb's."""
    own = friction_of(study)
    if own is not None:
        return scaled(own, breakout_n)
    usual = {name: INCEPTOR_ROWS[f"{_PATH}.{name}"].default for name in ("stribeck_velocity_m_s", "presliding_m")}
    return Friction(breakout_n, breakout_n, usual["stribeck_velocity_m_s"], 0.0, usual["presliding_m"])


def like(friction: Friction, swing: GripSwing) -> tuple[float, float]:
    """Damper [N s/m] and spring [N/m] at the grip that have friction's first harmonic in a swing.

    Coulomb friction F at omega: 4 F/(pi omega A) and nothing.
    """
    omega = 2.0 * math.pi * swing.frequency_hz
    phase = np.arange(SAMPLES) / SAMPLES * 2.0 * math.pi
    force = friction_force(friction, swing.amplitude_m * omega * np.cos(phase), 1.0 / swing.frequency_hz)
    by_rate, by_travel = (2.0 / SAMPLES * float(force @ shape) for shape in (np.cos(phase), np.sin(phase)))
    return by_rate / (swing.amplitude_m * omega), by_travel / swing.amplitude_m


def as_built(study: Study, breakout_n: float) -> dict[str, Any]:
    """The study's numbers with so much breakout force [N] more: path -> value; other forces grow in proportion."""
    own, more = friction_of(study), more_friction(study, breakout_n)
    total = more if own is None else scaled(own, own.breakout_n + breakout_n)
    numbers = {
        "breakout_n": total.breakout_n,
        "stribeck_n": total.breakout_n - total.sliding_n,
        "viscous_n_s_per_m": total.viscous_n_s_per_m,
    }
    return {f"{_PATH}.{name}": value for name, value in numbers.items() if value or name == "breakout_n"}
