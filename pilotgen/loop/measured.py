"""The loop of a pilot and a rotorcraft known by its measured frequency response, judged by the Nyquist criterion.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import numpy as np

from pilotgen.linear.pilot_model import PilotModel
from pilotgen.loop.frequency_data import FrequencyAnswer, FrequencyData
from pilotgen.loop.margins import Margins, data_margins
from pilotgen.loop.rotorcraft_model import RotorcraftModel, measured_part

_FINE = 4000  # frequencies at which the loop is looked at


def measured_margins(
    pilot: PilotModel, rotorcraft: RotorcraftModel, grip_gearing: float, output: int = 0
) -> tuple[Margins, FrequencyAnswer]:
    """Margins of a pilot's loop with a measured rotorcraft, by the Nyquist criterion.

    Between the points the pilot is exact and the rotorcraft a spline. The errors told are those of the spline, and of
    the interpolation of the loop between the 4,000 frequencies at which it is looked at.

    Parameters
    ----------
    pilot : PilotModel
        One motion of the seat in.
    rotorcraft : RotorcraftModel
        Of that motion, with a `MeasuredRotorcraft` in it; known in its band only.
    grip_gearing : float
        Blade pitch per rotation of the control, G0 l [rad/rad].
    output : int
        Which of the pilot's outputs is the control.
    """
    data = measured_part(rotorcraft)
    assert data is not None
    omega = np.geomspace(data.omega[0], data.omega[-1], _FINE)
    own = np.abs(pilot.poles[pilot.poles.imag > 0.0])
    omega = np.unique(np.concatenate((omega, own[(own > omega[0]) & (own < omega[-1])])))
    control = -grip_gearing * pilot.response(omega, output)
    H = rotorcraft.response(omega)
    L = control * H
    with np.errstate(divide="ignore", invalid="ignore"):
        chain = np.where(data.at(omega) == 0.0, 0.0, np.abs(H) / np.abs(data.at(omega)))
    error = np.abs(control) * chain * data.error_at(omega)
    tilts = pilot.tilt is not None and bool(pilot.tilt[output].any())
    integrators = 0 if pilot.washout_rad_s is not None else max(pilot.integrators, 2 if tilts else 0)
    unstable = int((pilot.poles.real > 0.0).sum()) + data.unstable_poles
    return data_margins(FrequencyData(omega, L, unstable, integrators + data.poles_at_origin, error))
