"""`pilotgen export`: a pilot's feedthrough for other programs.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import json
import os
from typing import Any

from pilotgen.commands import common

FORMATS = ("json", "mat", "h5", "csv")


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "export",
        "a pilot's feedthrough for python-control, MATLAB, Octave, Julia",
        "Write the feedthrough of a pilot that `pilotgen pilot` evaluated: as state space with named signals and units "
        "(json, mat, h5) or as a table of frequency responses (csv). With --axes the whole matrix: accelerations of "
        "the seat in six directions, rotations of the controls (docs/export.md).",
        "pilotgen export results/pilot --format mat -o pilot.mat --axes heave,pitch",
    )
    parser.add_argument("directory", metavar="PILOTDIR", type=common.user_path, help="output of `pilotgen pilot`")
    parser.add_argument("--format", choices=FORMATS, default=None, help="default: as FILE ends, else json")
    parser.add_argument("-o", "--output", metavar="FILE", type=common.user_path, required=True, help="file to write")
    parser.add_argument(
        "--axes",
        metavar="NAMES",
        help="seat motions, separated by commas: heave, surge, sway, roll, pitch, yaw, or all (default: heave)",
    )
    parser.add_argument(
        "--point",
        metavar="X,Y,Z",
        help="point about which rotations turn, from the seat reference point [m]: forward, up, right (default 0,0,0)",
    )
    parser.add_argument(
        "--also",
        metavar="WHAT",
        help="further outputs, separated by commas: head (its motion on a lumped torso), hands (their motion), moments "
        "(of the hands about the hinges of the controls)",
    )
    parser.add_argument("--no-washout", action="store_true", help="the body alone, without the pilot's washout")
    parser.add_argument("--order", type=int, metavar="N", help="balanced reduction to N states")
    parser.add_argument("--tolerance", type=float, metavar="T", help="balanced reduction to a relative error of T")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Read, choose axes, reduce, write."""
    from pilotgen.errors import FileError, StudyError
    from pilotgen.files import write_bytes, write_text
    from pilotgen.linear import export

    if os.path.lexists(args.output):  # a link that leads nowhere is somebody's too
        raise FileError(f"{args.output}: exists; choose another file")
    args.format = args.format or common.format_of(args.output, FORMATS) or "json"
    wants_reduction = args.order is not None or args.tolerance is not None
    if args.format == "h5" and (wants_reduction or args.no_washout):
        raise StudyError("--format h5 is the whole model with its washout apart; --order, --tolerance and --no-washout "
                         "go with json, mat and csv")  # fmt: skip
    model = _model(args)
    if args.format == "h5":
        model.write(args.output)
        if args.json:
            common.print_json({"file": args.output, "format": args.format})
        return 0
    system = export.named(model, washout=not args.no_washout)
    states = len(system.A)
    if wants_reduction:
        system = export.reduced(system, args.order, args.tolerance)
        if not args.json:
            print(f"{states} states reduced to {len(system.A)}, largest error {system.error:.2g} of the largest gain")
    if args.format == "mat":
        write_bytes(args.output, export.as_mat(system))
    elif args.format == "csv":
        write_text(args.output, export.as_table(system))
    else:
        write_text(args.output, json.dumps(export.state_space_object(system), indent=1, allow_nan=False) + "\n")
    if args.json:
        error = system.error if wants_reduction else None
        common.print_json(
            {"file": args.output, "format": args.format, "states": len(system.A), "reduction_error": error}
        )
    return 0


def _model(args: argparse.Namespace) -> Any:
    """The pilot's model; made anew from his matrices for other axes than heave."""
    from pilotgen.commands.loops import common_point
    from pilotgen.errors import StudyError
    from pilotgen.linear.feedthrough import make_pilot_model
    from pilotgen.linear.imposed_motion import SEAT_MOTIONS, Channels
    from pilotgen.linear.pilot_model import read_pilot_model
    from pilotgen.solver.matrices import read_matrices

    model = read_pilot_model(common.file_of_pilot(args.directory))
    if args.axes is None and args.point is None and args.also is None:
        return model
    names = [name.strip() for name in (args.axes or "heave").split(",")]
    inputs = tuple(SEAT_MOTIONS) if names == ["all"] else tuple(names)
    if model.projection != "exact":
        raise StudyError(
            f"{args.directory}: a pilot of projection {model.projection!r} has heave alone; other axes need a "
            "multibody pilot of the exact projection"
        )
    outputs, moments = _further(args.also)
    channels = Channels(inputs=inputs, point_m=common_point(args.point, "--point"), outputs=outputs, moments=moments)
    matrices = read_matrices(args.directory / "matrices.h5")
    made = make_pilot_model(matrices, model.lever_length_m, model.washout_rad_s, channels=channels)
    if args.also and "head" in args.also and "head_up" not in made.outputs:
        raise StudyError(f"{args.directory}: this pilot has no head of its own; pilot.torso.model = 'lumped' has one")
    return made


def _further(also: str | None) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Outputs by their unknowns, and names of moments."""
    from pilotgen.errors import StudyError
    from pilotgen.linear.imposed_motion import HANDS, HEAD, MOMENTS, rotations
    from pilotgen.study.wording import did_you_mean

    wanted = [name.strip() for name in also.split(",")] if also else []
    known = {"head": HEAD, "hands": HANDS, "moments": {}}
    for name in wanted:
        if name not in known:
            near = did_you_mean(name, list(known))
            raise StudyError(f"--also {also}: {name!r} is not known; {near}known: {', '.join(known)}")
    outputs = {key: weights for name in ("head", "hands") if name in wanted for key, weights in known[name].items()}
    return {**rotations(), **outputs}, tuple(MOMENTS) if "moments" in wanted else ()
