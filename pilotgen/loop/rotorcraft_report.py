"""Any rotorcraft as text: where its numbers are from, its poles, what stands around it.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from pilotgen.linear.statespace import ComplexArray
from pilotgen.loop.heave_model import HeaveModel, rotorcraft_report
from pilotgen.loop.rotorcraft_model import measured_part, rotorcraft_model
from pilotgen.study.loop_section import LoopSignals
from pilotgen.study.rotorcraft import Rotorcraft
from pilotgen.study.schema import study_unit

ROLL = LoopSignals("roll", "lateral")


def usual_loop(rotorcraft: Rotorcraft) -> LoopSignals:
    """The loop that a rotorcraft is for, where no study says it."""
    return LoopSignals() if rotorcraft.roll is None else ROLL


def describe(rotorcraft: Rotorcraft, ends: LoopSignals | None = None) -> str:
    """Poles and numbers of a rotorcraft in a loop; FileError if its file cannot be read."""
    symbols = rotorcraft.plant_file is None and rotorcraft.roll is None
    around = rotorcraft.delay_s or any((rotorcraft.actuator, rotorcraft.notch, rotorcraft.low_pass, rotorcraft.sling))
    if symbols and not around:
        return rotorcraft_report(rotorcraft)
    ends = ends or usual_loop(rotorcraft)
    model = rotorcraft_model(rotorcraft, ends.input, ends.output)
    lines = [rotorcraft.name, f"  source: {rotorcraft.source}", f"  loop:   {ends.words}", ""]
    for path, number in _numbers({k: v for k, v in rotorcraft.given().items() if k not in ("name", "source")}):
        shown = f"{number:g}" if isinstance(number, int | float) else str(number)
        lines.append(f"  {path:<26} {shown:>10} {study_unit(f'rotorcraft.{path}')}".rstrip())
    data = measured_part(model)
    if data is not None:
        low, high = data.band_hz
        lines += [
            "",
            f"Known at {len(data.omega)} frequencies from {low:.4g} to {high:.4g} Hz; poles cannot be told",
            f"  unstable poles, as stated  {data.unstable_poles}",
            f"  interpolation error        {data.interpolation_error:.2g} of the largest value",
        ]
    else:
        lines += ["", "Poles" + (", those of the rational delay included" if rotorcraft.delay_s else "")]
        lines += _poles(model.state_space.poles)
    return "\n".join(lines) + "\n"


def as_data(rotorcraft: Rotorcraft, ends: LoopSignals | None = None) -> dict[str, Any]:
    """The same as plain data: numbers, poles [rad/s], of heave and coning alone numerator and denominator."""
    ends = ends or usual_loop(rotorcraft)
    model = rotorcraft_model(rotorcraft, ends.input, ends.output)
    told: dict[str, Any] = {**rotorcraft.given(), "loop": {"input": ends.input, "output": ends.output}}
    data = measured_part(model)
    if data is not None:
        low, high = data.band_hz
        band = {"points": len(data.omega), "lowest_hz": low, "highest_hz": high}
        return {**told, "poles_rad_s": None, **band, "interpolation_error": data.interpolation_error}
    told["poles_rad_s"] = model.state_space.poles
    if isinstance(model, HeaveModel) and rotorcraft.sling is None:
        told["poles_rad_s"] = model.poles
        told["numerator"], told["denominator"] = model.transfer_function
    return told


def _numbers(tree: Mapping[str, Any], start: str = "") -> list[tuple[str, Any]]:
    found: list[tuple[str, Any]] = []
    for key, value in tree.items():
        if isinstance(value, Mapping):
            found += _numbers(value, f"{start}{key}.")
        elif value is not None:
            found.append((start + key, value))
    return found


def _poles(poles: ComplexArray) -> list[str]:
    lines = []
    for pole in sorted(poles, key=lambda p: (abs(p), -p.imag)):
        if pole.imag < 0.0:
            continue
        text = f"{pole.real:.4f}" if pole.imag == 0.0 else f"{pole.real:.4f} +- {pole.imag:.4f}i"
        damping = f", damping {-pole.real / abs(pole):.3f}" if pole else ""
        lines.append(f"  {text:<24} rad/s   {abs(pole) / (2.0 * math.pi):7.4f} Hz{damping}")
    return lines
