"""`pilotgen calibrate`: fit the reflex gains to Mayo's pilots.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from pilotgen.commands import common, settings
from pilotgen.files import to_json, write_text

if TYPE_CHECKING:
    from pilotgen.virtual.calibration import Calibration, Seen

WRITES = ("calibration.json", "reflex.yaml")


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "calibrate",
        "fit the reflex gains to measured pilots",
        "Fit the reflex gains Kp and Kd so that the mesomorphic reference pilot in the study's cockpit has the "
        "frequency and damping that Mayo measured; predict the ectomorphic one; derive the gains of the other tasks. "
        "Prints a report and the gains as YAML; with -o writes calibration.json and reflex.yaml there. A study takes "
        "other gains than those that come with pilotgen by pilot.reflex.",
        "pilotgen calibrate docs/studies/puma-bmi.yaml -o results/calibration",
    )
    common.add_study(parser)
    settings.add_settings(parser, settings.MANY_PILOTS)
    common.add_output(parser, required=False)
    parser.add_argument(
        "--no-sensitivities",
        action="store_true",
        help="do not repeat the fit with other bodies",
    )
    common.add_mbdae(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Fit, print, write."""
    from pilotgen.errors import StudyError
    from pilotgen.runs.executor import pin_threads

    pin_threads()
    from pilotgen.context import EvaluationContext
    from pilotgen.output import claimed
    from pilotgen.virtual.calibration import calibrate, reference_study, reflex_yaml

    study = settings.read_changed(args, "calibrate")
    if study.pilot.model != "multibody":
        raise StudyError(
            f"{args.study}: pilot.model = {study.pilot.model!r} has no reflexes; only multibody pilots have"
        )
    with ExitStack() as stack:
        context = stack.enter_context(EvaluationContext(reference_study(study), mbdae=args.mbdae))
        directory = None
        if args.output is not None:
            directory = stack.enter_context(claimed(args.output, "calibrate", WRITES, overwrite=args.overwrite))
        found = calibrate(context, sensitivities=not args.no_sensitivities)
        text = reflex_yaml(found)
        if args.json:
            common.print_json(found.as_dict())
        else:
            print(report(found))
            print(text, end="")
        if directory is not None:
            write_text(directory / "calibration.json", to_json(found.as_dict()))
            write_text(directory / "reflex.yaml", text)
            if not args.json:
                print(f"calibration.json and reflex.yaml are in {directory}")
    return 0


HEADS = "    Hz  damping  tau s   grip at 3 Hz mm/(m/s^2)  gain margin dB"


def report(found: Calibration) -> str:
    """Tables for a person."""
    lines = [f"reference pilots, position task, {found.torso} torso", " " * 40 + HEADS]
    for pilot in found.pilots:
        body = f"{pilot.values['stature_m']:.2f} m, {pilot.values['mass_kg']:.0f} kg"
        lines.append(f"  {pilot.name:16s} {body:14s} model  {_seen(pilot.seen)}  {pilot.gain_margin_db:8.2f}")
        lines.append(f"  {'':31s} Mayo   {_seen(pilot.measured)}  {pilot.measured_gain_margin_db:8.2f}")
    lines += ["", "static stiffness of the grip, N/m (of Mayo's frequency and the model's mass at the grip)"]
    for pilot in found.pilots:
        lines.append(
            f"  {pilot.name:16s} {pilot.grip_stiffness_N_per_m:5.0f} "
            f"({pilot.measured_grip_stiffness_N_per_m:.0f} with {pilot.grip_mass_kg:.2f} kg)"
        )
    lines += ["", f"tasks, {found.pilots[0].name} pilot", " " * 14 + "Kp        Kd    " + HEADS + "  N/m"]
    for name, task in found.tasks.items():
        lines.append(
            f"  {name:8s} {task.gains.proportional_gain:8.5f}  {task.gains.derivative_gain:8.5f}  {_seen(task.seen)}  "
            f"{task.gain_margin_db:8.2f}  {task.grip_stiffness_N_per_m:10.0f}"
        )
    if found.sensitivities:
        lines.append("")
        lines.append("other body for the mesomorphic pilot      Kp        Kd     ectomorphic prediction Hz")
        for row in found.sensitivities:
            lines.append(
                f"  {row.variable:10s} {row.step:+7.2f} {'':20s} {row.gains.proportional_gain:8.5f}  "
                f"{row.gains.derivative_gain:8.5f}  {row.predicted_frequency_hz:8.3f}"
            )
    return "\n".join(lines) + "\n"


def _seen(seen: Seen) -> str:
    return (
        f"{seen.frequency_hz:6.3f}  {seen.damping:7.3f}  {seen.time_constant_s:5.3f}  "
        f"{seen.grip_motion_mm_per_m_s2:6.2f} at {seen.grip_phase_deg:6.1f} deg"
    )
