"""`pilotgen margins`: stability and every margin of any loop.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pilotgen.commands import common

if TYPE_CHECKING:
    from pilotgen.loop.frequency_data import FrequencyAnswer
    from pilotgen.loop.margins import Crossing, Margins

_TWO_PI = 2.0 * math.pi


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "margins",
        "stability margins of any loop",
        "Stability, gain, phase, modulus, disk and delay margin of a loop L(s) closed with unity negative feedback, "
        "and where its locus crosses the negative real axis and the unit circle. The file holds a state space A, B, C, "
        "D, a transfer function, or frequency response data (docs/io_formats/loop.md). State spaces and transfer "
        "functions are judged by exact arithmetic: the answer is that of the numbers as they stand in the file.",
        "pilotgen margins docs/studies/loops/notch.json --json",
    )
    parser.add_argument("loop", metavar="LOOP.json|.mat", type=Path, help="the loop")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Read, judge, print."""
    from pilotgen.linear.exact import Rational
    from pilotgen.loop.frequency_data import FrequencyData
    from pilotgen.loop.loop_file import read_loop
    from pilotgen.loop.margins import data_margins, exact_margins, margins

    file = read_loop(args.loop)
    if file.ignored:
        common.say(f"{args.loop}: not used: {', '.join(file.ignored)}")
    answer = None
    if isinstance(file.loop, FrequencyData):
        found, answer = data_margins(file.loop)
    elif isinstance(file.loop, Rational):
        found = exact_margins(file.loop)
    else:
        found = margins(file.loop)
    if args.json:
        print(json.dumps(as_object(found, answer), indent=1, allow_nan=False))
    else:
        print(as_text(found, answer))
    return 0


def as_object(m: Margins, answer: FrequencyAnswer | None = None) -> dict[str, Any]:
    """What --json prints: infinite numbers as "inf" and "-inf", null for what is not there or cannot be told."""
    from pilotgen.loop.margins import interpolation_errors

    told: dict[str, Any] = {"stable": m.stable}
    for key, hz in (
        ("gain_margin_db", m.gain_margin_hz),
        ("phase_margin_deg", m.phase_margin_hz),
        ("modulus_margin", m.modulus_margin_hz),
        ("disk_margin", m.disk_margin_hz if m.stable else None),
        ("delay_margin_s", m.delay_margin_hz),
    ):
        name = key.removesuffix("_db").removesuffix("_deg").removesuffix("_s")
        told[key] = _number(getattr(m, key))
        told[f"{name}_rad_s"] = _number(None if hz is None else _TWO_PI * hz)
        told[f"{name}_hz"] = _number(hz)
    told["real_axis_crossings"] = [
        {**_point(c), "gain_db": _number(c.gain_db)} for c in m.crossings if c.kind == "real axis"
    ]
    told["unit_circle_crossings"] = [
        {**_point(c), "phase_deg": _number(c.phase_deg)} for c in m.crossings if c.kind == "unit circle"
    ]
    if m.not_told:
        told["why_not_told"] = m.not_told
    if m.largest_real_part is not None:
        told["largest_real_part"] = [_number(x) for x in m.largest_real_part]
    if answer is not None:
        told["interpolation_error"] = {key: _number(value) for key, value in interpolation_errors(m, answer).items()}
    return told


def _point(c: Crossing) -> dict[str, Any]:
    return {
        "omega_rad_s": _number(_TWO_PI * c.frequency_hz),
        "frequency_hz": _number(c.frequency_hz),
        "real": c.value.real + 0.0,
        "imag": c.value.imag + 0.0,
    }


def _number(value: float | None) -> float | str | None:
    if value is None or math.isnan(value):
        return None
    return value + 0.0 if math.isfinite(value) else "inf" if value > 0.0 else "-inf"  # + 0.0: no minus zero


def as_text(m: Margins, answer: FrequencyAnswer | None = None) -> str:
    """The same for a person."""
    from pilotgen.loop.margins import interpolation_errors

    lines = [f"closed loop      {'cannot be told' if m.stable is None else 'stable' if m.stable else 'UNSTABLE'}"]
    if m.not_told:
        lines.append(f"not told         {m.not_told}")
    errors = interpolation_errors(m, answer) if answer is not None else {}
    for label, key, unit, hz in (
        ("gain margin", "gain_margin_db", " dB", m.gain_margin_hz),
        ("phase margin", "phase_margin_deg", " deg", m.phase_margin_hz),
        ("modulus margin", "modulus_margin", "", m.modulus_margin_hz),
        ("disk margin", "disk_margin", "", m.disk_margin_hz if m.stable else None),
        ("delay margin", "delay_margin_s", " s", m.delay_margin_hz),
    ):
        value = getattr(m, key)
        text = "cannot be told" if math.isnan(value) else f"{value:.6g}{unit}" if math.isfinite(value) else "infinite"
        if value == -math.inf:
            text = "minus infinite"
        if hz is not None and not math.isnan(value):
            text += f" at {_frequency(hz)}"
        error = errors.get(key)
        if error is not None and math.isfinite(value):
            text += f", by interpolation +- {error:.2g}{unit}"
        lines.append(f"{label:<16} {text}")
    for c in m.crossings:
        what = f"L = {c.value.real:.6g}, {c.gain_db:+.4g} dB to -1"
        if c.kind == "unit circle":
            what = f"L = {c.value.real:.6g} {c.value.imag:+.6g}j, {c.phase_deg:+.4g} deg to -1"
        lines.append(f"{c.kind:<16} {what}, at {_frequency(c.frequency_hz)}")
    return "\n".join(lines)


def _frequency(hz: float) -> str:
    return "infinite frequency" if math.isinf(hz) else f"{_TWO_PI * hz:.6g} rad/s ({hz:.6g} Hz)"
