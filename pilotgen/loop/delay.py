"""A pure delay as a rational all-pass.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math

import numpy as np

from pilotgen.errors import PilotgenError
from pilotgen.linear.statespace import StateSpaceModel, zeros_poles_gain

DELAY_ERROR = 1e-6  # of the rational delay below DELAY_BAND_HZ, against exp(-j omega T)
DELAY_BAND_HZ = 10.0


def pade_delay(delay_s: float, error: float = DELAY_ERROR, band_hz: float = DELAY_BAND_HZ) -> StateSpaceModel:
    """A rational all-pass for exp(-s T): Pade's, of the lowest order whose error below `band_hz` is at most `error`.

    Built section by section from its poles (zeros mirrored), which stays well scaled at any order.

    Raises
    ------
    PilotgenError
        The delay is so long that order 15 does not do.
    """
    s = 1j * np.linspace(0.0, 2.0 * math.pi * band_hz * delay_s, 400)
    for order in range(1, 16):
        # sum over k of (2n-k)! n! / ((2n)! k! (n-k)!) x^k, highest power first
        coefficients = [
            math.factorial(2 * order - k)
            * math.factorial(order)
            / (math.factorial(2 * order) * math.factorial(k) * math.factorial(order - k))
            for k in range(order, -1, -1)
        ]
        ratio = np.polyval(coefficients, -s) / np.polyval(coefficients, s)
        if np.abs(ratio - np.exp(-s)).max() <= error:
            poles = np.roots(coefficients) / delay_s
            pairs = [p for p in poles if p.imag >= 0.0]
            paired = [q for p in pairs for q in ((p, p.conjugate()) if p.imag > 0.0 else (complex(p.real),))]
            return zeros_poles_gain([-p.conjugate() for p in paired], paired, (-1.0) ** order)
    raise PilotgenError(
        f"a delay of {delay_s:g} s is too long: no rational delay of order 15 follows it to {band_hz:g} Hz"
    )
