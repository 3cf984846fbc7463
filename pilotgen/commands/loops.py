"""`pilotgen loops`: a pilot closed with a rotorcraft of several inputs and outputs.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import json
import math
from typing import Any

from pilotgen.commands import common


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "loops",
        "several control loops at once: roll, pitch and heave with one pilot",
        "Close the pilot that `pilotgen pilot` evaluated with a plant of several inputs and outputs: a bundled one, a "
        "JSON file (docs/theory/mimo.md), or `roll:NAME`, roll with flapping. Prints the closed-loop poles that are "
        "unstable or oscillate at 0.5 to 10 Hz with less than half of critical damping, the margins of "
        "each loop with the others closed, and the disk margin of all loops together.",
        "pilotgen loops results/pilot --plant roll:bo105 --gearing lateral=1.1 --seat 0,0.6,0",
    )
    parser.add_argument("directory", metavar="PILOTDIR", type=common.user_path, help="output of `pilotgen pilot`")
    parser.add_argument(
        "--plant",
        required=True,
        metavar="NAME|FILE|roll:NAME",
        help="the rotorcraft: bundled, .json, or a measured heave response as .csv",
    )
    parser.add_argument(
        "--gearing",
        required=True,
        metavar="CONTROL=G,...",
        help="blade pitch per travel of the grip [rad/m], or percent per metre for plants in percent; collective, "
        "longitudinal, lateral: the loops that are closed",
    )
    parser.add_argument(
        "--seat",
        metavar="X,Y,Z",
        help="seat reference point, forward, up and right of the plant's point (of the roll axis) [m] (default 0,0,0)",
    )
    parser.add_argument(
        "--stick-length",
        type=float,
        default=0.6,
        metavar="M",
        help="pivot to grip of the cyclic stick [m] (default 0.6)",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Read the pilot and the plant, close, print."""
    from pilotgen.commands.margins import as_object
    from pilotgen.linear.feedthrough import make_pilot_model
    from pilotgen.linear.imposed_motion import Channels
    from pilotgen.linear.pilot_model import INPUT_NAME, read_pilot_model
    from pilotgen.loop.mimo import close
    from pilotgen.solver.matrices import read_matrices

    gearing = _gearing(args.gearing)
    if args.plant.lower().endswith(".csv"):
        return _measured(args, gearing)
    plant = _plant(args.plant, common_point(args.seat, "--seat"))
    model = read_pilot_model(common.file_of_pilot(args.directory))
    if model.inputs != (INPUT_NAME,) or plant.motions != ("heave",) or set(gearing) != {"collective"}:
        matrices = read_matrices(args.directory / "matrices.h5")
        channels = Channels(inputs=plant.motions)
        model = make_pilot_model(matrices, model.lever_length_m, model.washout_rad_s, channels=channels)
    lengths = {"collective": model.lever_length_m}
    loop = close(model, plant, {name: value * lengths.get(name, args.stick_length) for name, value in gearing.items()})
    poles = [p for p in loop.closed_loop_poles if p.imag >= 0.0]
    alpha, hz = loop.disk_margin()
    told = {name: as_object(found) for name, found in loop.loop_at_a_time().items()}
    stable = loop.stable
    if args.json:
        data = {
            "plant": plant.name,
            "stable": stable,
            "closed_loop_poles": [[p.real, p.imag] for p in loop.closed_loop_poles],
            "loops": told,
            "disk_margin": None if math.isnan(alpha) else alpha,
            "disk_margin_hz": None if math.isnan(hz) else hz,
        }
        print(json.dumps(data, indent=1, allow_nan=False))
        return 0
    state = "cannot be told" if stable is None else "stable" if stable else "UNSTABLE"
    print(f"plant            {plant.name}\nclosed loop      {state}")
    for pole in sorted(poles, key=abs):
        damping = -pole.real / abs(pole) if pole else 0.0
        oscillates = 0.5 < abs(pole) / (2.0 * math.pi) < 10.0 and damping < 0.5
        if oscillates or pole.real >= 0.0:
            print(f"pole             {abs(pole) / (2.0 * math.pi):8.4f} Hz, damping {damping:+.4f}")
    for name, found in told.items():
        gain, phase = (_text(found[key], unit) for key, unit in (("gain_margin_db", "dB"), ("phase_margin_deg", "deg")))
        print(f"{name:<16} others closed: gain margin {gain}, phase margin {phase}")
    all_loops = "cannot be told" if math.isnan(alpha) else f"{alpha:.4g}"
    print(f"all loops        disk margin {all_loops}" + (f" at {hz:.3g} Hz" if not math.isnan(hz) else ""))
    return 0


def _measured(args: argparse.Namespace, gearing: dict[str, float]) -> int:
    """The heave loop with a measured rotorcraft."""
    from pathlib import Path

    from pilotgen.commands.margins import as_object, as_text
    from pilotgen.errors import StudyError
    from pilotgen.linear.pilot_model import read_pilot_model
    from pilotgen.loop.frequency_file import read_frequency_response
    from pilotgen.loop.measured import measured_margins
    from pilotgen.loop.rotorcraft_model import MeasuredRotorcraft

    if set(gearing) != {"collective"} or args.seat is not None:
        raise StudyError(
            f"--plant {args.plant}: a measured rotorcraft has heave by collective, at the seat; "
            "--gearing collective=G alone goes with it"
        )
    plant = read_frequency_response(Path(args.plant))
    model = read_pilot_model(common.file_of_pilot(args.directory))
    found, answer = measured_margins(model, MeasuredRotorcraft(plant), gearing["collective"] * model.lever_length_m)
    if args.json:
        told = {**as_object(found, answer), "plant_interpolation_error": _finite(plant.interpolation_error)}
        print(json.dumps(told, indent=1, allow_nan=False))
        return 0
    print(as_text(found, answer))
    print("poles            of the closed loop cannot be told: the rotorcraft is known by its frequency response only")
    print(f"interpolation of the rotorcraft's response: {plant.interpolation_error:.2g} of its largest value")
    return 0


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _text(value: Any, unit: str) -> str:
    return "cannot be told" if value is None else f"{value:.4g} {unit}" if isinstance(value, float) else str(value)


def _gearing(text: str) -> dict[str, float]:
    from pilotgen.errors import StudyError
    from pilotgen.linear.imposed_motion import PEDALS
    from pilotgen.loop.units import CONTROLS
    from pilotgen.study.wording import did_you_mean

    found: dict[str, float] = {}
    for part in text.split(","):
        name, _, value = (piece.strip() for piece in part.partition("="))
        if name not in CONTROLS:
            why = f"; {PEDALS}" if "pedal" in name else ""
            near = did_you_mean(name, list(CONTROLS))
            raise StudyError(
                f"--gearing {text}: control {name!r} is not known; {near}known: {', '.join(CONTROLS)}{why}"
            )
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not math.isfinite(number) or name in found:
            raise StudyError(f"--gearing {text}: one number for each control is wanted, such as lateral=1.1")
        found[name] = number
    return found


def common_point(text: str | None, flag: str) -> tuple[float, float, float]:
    """Three numbers [m] of an option."""
    from pilotgen.errors import StudyError

    if text is None:
        return 0.0, 0.0, 0.0
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise StudyError(f"{flag} {text}: three numbers separated by commas are wanted, such as 0.3,-0.4,0") from None
    if not all(math.isfinite(value) and abs(value) <= 20.0 for value in (x, y, z)):
        raise StudyError(f"{flag} {text}: metres, at most 20 each, are wanted")
    return x, y, z


def _plant(name: str, seat: tuple[float, float, float]) -> Any:
    from pilotgen.errors import StudyError
    from pilotgen.loop.plants import load_plant, roll_plant, roll_rotorcraft
    from pilotgen.study.wording import did_you_mean

    kind, _, which = name.partition(":")
    if kind != "roll":
        return load_plant(name).at_seat(seat)
    known = roll_rotorcraft()
    if which not in known:
        near = did_you_mean(which, list(known))
        raise StudyError(f"--plant {name}: rotorcraft {which!r} is not known; {near}known: {', '.join(known)}")
    found = known[which]
    assert found.roll is not None
    plant = roll_plant(found.roll["time_constant_s"], found.roll["flap_1_s2"], found.delay_s, seat[1])
    return plant.called(f"roll with flapping, {which} ({found.source})")
