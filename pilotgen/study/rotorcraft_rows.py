"""The rotorcraft of a study: its rows of the schema.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from pilotgen.study.fields import Field, Number, Section, Text, Whole
from pilotgen.study.yaml_file import bundled

# Names under which a rotor speed may come in another unit, and how many of that unit make one Hz.
_ROTOR_SPEED_UNITS = {"rpm": 60.0, "rad_s": 2.0 * math.pi, "rad_per_s": 2.0 * math.pi}


def _rotor_speed_hint(value: Any) -> str:
    number = isinstance(value, int | float) and math.isfinite(value) and value > 15.0
    readings = {} if not number else {"rpm": value / 60.0, "rad/s": value / (2.0 * math.pi)}
    told = [f"{value:g} {unit} = {hz:.3g} Hz" for unit, hz in readings.items() if 1.0 <= hz <= 15.0]
    return f"it looks like rpm or rad/s; give Hz: {' or '.join(told)}" if told else "give revolutions per second"


def _rotor_speed_in_another_unit(key: str, value: Any) -> str:
    per_hz = _ROTOR_SPEED_UNITS.get(key.removeprefix("rotor_speed_"))
    if per_hz is None:
        return ""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return "the rotor speed is given in Hz" + (f"; write rotor_speed_hz: {value / per_hz:.4g}" if number else "")


ROTORCRAFT_ROWS: Mapping[str, Field] = {
    # Wide ranges: from a 200 kg ultralight to a heavy-lift helicopter with eight blades
    "rotorcraft": Section(
        words=lambda: tuple(bundled("rotorcraft").value),
        unknown=_rotor_speed_in_another_unit,
        instead=("state_space", "transfer_function", "frequency_response", "roll"),
        meaning="a bundled rotorcraft, or a mapping with the symbols of its heave model or a file of its dynamics",
    ),
    "rotorcraft.mass_kg": Number(100.0, 100_000.0, "kg", hint="the total mass of the vehicle", meaning="total mass"),
    "rotorcraft.blades": Whole(1, 10, meaning="number of blades"),
    "rotorcraft.rotor_radius_m": Number(
        1.0, 25.0, "m", hint="the radius, not the diameter, in metres (1 ft = 0.3048 m)", meaning="rotor radius"
    ),
    "rotorcraft.rotor_speed_hz": Number(
        1.0, 15.0, "Hz", hint=_rotor_speed_hint, meaning="revolutions per second: 265 rpm is 4.42"
    ),
    "rotorcraft.lock_number": Number(
        1.0, 20.0, "", hint="gamma = rho a c R^4 / I_beta, dimensionless", meaning="rho a c R^4 / I_beta"
    ),
    "rotorcraft.flap_static_moment_kg_m": Number(
        1.0, 10_000.0, "kg m", hint="first moment of one blade (1 slug ft = 4.448 kg m)", meaning="of one blade"
    ),
    "rotorcraft.flap_inertia_kg_m2": Number(
        1.0,
        100_000.0,
        "kg m^2",
        hint="second moment of one blade (1 slug ft^2 = 1.3558 kg m^2)",
        meaning="of one blade",
    ),
    "rotorcraft.flap_frequency_ratio": Number(
        1.0,
        1.5,
        "",
        hint="rotating flap frequency over rotor speed",
        meaning="rotating flap frequency over Omega",
    ),
    "rotorcraft.state_space": Text(
        default=None, null=True, meaning="file with the dynamics instead of the symbols above, beside the study file"
    ),
    "rotorcraft.transfer_function": Text(default=None, null=True, meaning="the same as a transfer function"),
    "rotorcraft.frequency_response": Text(
        default=None, null=True, meaning="CSV file with a frequency response, instead of the symbols"
    ),
    "rotorcraft.roll": Section(
        default=None,
        null=True,
        meaning="roll with flapping instead of the symbols",
    ),
    "rotorcraft.roll.time_constant_s": Number(0.005, 2.0, "s", meaning="time constant of flapping, tau"),
    "rotorcraft.roll.flap_1_s2": Number(1.0, 1000.0, "1/s^2", meaning="roll acceleration per lateral flapping, L_b"),
    "rotorcraft.roll.lag": Section(default=None, null=True, meaning="regressing lag mode: zeros and poles"),
    "rotorcraft.roll.lag.pole_hz": Number(0.2, 20.0, "Hz", meaning="its natural frequency in the fixed frame"),
    "rotorcraft.roll.lag.pole_damping": Number(0.001, 1.0, meaning="its damping ratio in the fixed frame"),
    "rotorcraft.roll.lag.zero_hz": Number(0.2, 20.0, "Hz", meaning="of the zeros beside it"),
    "rotorcraft.roll.lag.zero_damping": Number(0.0, 1.0, meaning="their damping ratio"),
    "rotorcraft.inflow_lead_rad_s": Number(
        1.0, 200.0, "rad/s", default=None, null=True, meaning="zero of the thrust's overshoot before the inflow follows"
    ),
    "rotorcraft.delay_s": Number(0.0, 0.2, "s", default=0.0, meaning="pure delay between lever and blades"),
    "rotorcraft.actuator": Section(default=None, null=True, meaning="of the blade pitch"),
    "rotorcraft.actuator.corner_rad_s": Number(1.0, 1000.0, "rad/s", meaning="corner, or undamped natural frequency"),
    "rotorcraft.actuator.damping": Number(
        0.05, 2.0, default=None, null=True, meaning="damping ratio of a second order; null: first order"
    ),
    "rotorcraft.notch": Section(default=None, null=True, meaning="filter of the flight control system"),
    "rotorcraft.notch.frequency_hz": Number(0.1, 50.0, "Hz", meaning="where it is deepest"),
    "rotorcraft.notch.zero_damping": Number(0.0, 2.0, meaning="damping ratio of its zeros"),
    "rotorcraft.notch.pole_damping": Number(0.01, 2.0, meaning="damping ratio of its poles"),
    "rotorcraft.low_pass": Section(default=None, null=True, meaning="filter in the collective path"),
    "rotorcraft.low_pass.frequency_hz": Number(0.1, 50.0, "Hz", meaning="corner, or undamped natural frequency"),
    "rotorcraft.low_pass.damping": Number(
        0.05, 2.0, default=None, null=True, meaning="damping ratio of a second order; null: first order"
    ),
    "rotorcraft.sling": Section(default=None, null=True, meaning="a load below; mass_kg is the helicopter alone then"),
    "rotorcraft.sling.load_kg": Number(1.0, 50_000.0, "kg", meaning="mass of the load"),
    "rotorcraft.sling.stiffness_n_per_m": Number(1e3, 1e8, "N/m", meaning="of sling and pendant, load hanging"),
    "rotorcraft.sling.damping_n_s_per_m": Number(0.0, 1e6, "N s/m", default=0.0, meaning="the same"),
    "rotorcraft.name": Text(default="rotorcraft of the study", meaning="what reports call it"),
    "rotorcraft.source": Text(default="study file", meaning="where the numbers are from"),
}
