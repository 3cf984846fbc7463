"""What of a pilot's feedthrough goes into his result: dominant mode, grip motion, certificate.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from typing import Any

from pilotgen.linear.pilot_model import PilotModel

GRIP_FREQUENCY_HZ = 3.0  # where grip motion is reported, as Mayo's people are (docs/validation.md)


def bdft_summary(model: PilotModel, certificate: float | None) -> dict[str, Any]:
    frequency_hz, damping = model.dominant_pair()
    motion = abs(complex(model.grip_motion(2.0 * math.pi * GRIP_FREQUENCY_HZ)))
    return {
        "dominant_frequency_hz": frequency_hz,
        "dominant_damping": damping,
        "grip_motion_3hz_mm_per_m_s2": 1e3 * motion,
        "certificate": certificate,
        "cyclic": _cyclic_summary(model),
    }


def _cyclic_summary(model: PilotModel) -> dict[str, float] | None:
    """Rotation of the cyclic stick at 3 Hz without washout [mrad per m/s^2] by axis; None without a right arm."""
    axes = [(k, name) for k, name in enumerate(model.outputs) if name.startswith("cyclic_")]
    if not axes:
        return None
    omega = 2.0 * math.pi * GRIP_FREQUENCY_HZ
    rotations = ((name, abs(complex(model.response(omega, k, washout=False)))) for k, name in axes)
    return {f"{name}_3hz_mrad_per_m_s2": 1e3 * rotation for name, rotation in rotations}
