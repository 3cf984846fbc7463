"""`pilotgen simulate`: kick a pilot in the closed loop and see what follows.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

from pilotgen.commands import closed_loop, common
from pilotgen.files import to_json, write_text

SHORTEST_S = 0.2  # kicks begin at 0.1 s
LONGEST_S = 1000.0  # of a motion: a million rows of 1 ms
WRITES = ("simulation.json", "history.png", "onset.png")
NO_CHANCE = (
    "every kick of such a loop goes on, so that --kicks has no chance to tell; leave it out and look at one motion, or "
    "give the rotorcraft with what stabilises it"
)


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "simulate",
        "move the closed loop in time after a kick or in turbulence",
        "Integrate loop.mbd, the deck of one pilot with his rotorcraft around him, with clipped activations, the "
        "lever's stops and its friction, if the study has any. Leaves loop.mbd, loop.motion.h5, animation.h5, "
        "simulation.json and history.png in DIR.",
        "pilotgen simulate docs/studies/puma-bmi.yaml -o results/kicked --kick lever --size 20",
        json_help="print the content of simulation.json instead of the summary",
    )
    closed_loop.add_arguments(parser)
    parser.add_argument(
        "--kick",
        choices=("lever", "gust", "pull", "turbulence"),
        default="lever",
        help="a pulse of force at the grip [N], of rising air [m/s], of the grip travel that the pilot wants [m], or "
        "turbulence of 0.1 to 10 Hz [m/s rms] (default: lever)",
    )
    parser.add_argument(
        "--size",
        type=common.any_float,
        default=None,
        help="of the kick, upward; below zero downward; default: 20, 3, 0.03, 1",
    )
    parser.add_argument(
        "--through-stops",
        action="store_true",
        help="a kick may throw the lever on a stop while it still acts; without this it is refused",
    )
    parser.add_argument(
        "--pulse", metavar="S", type=common.positive_float, default=None, help="length of the pulse [s]; 0.2, 0.5, 0.3"
    )
    parser.add_argument(
        "--duration", metavar="T", type=common.positive_float, default=8.0, help="length of the motion [s] (default: 8)"
    )
    parser.add_argument(
        "--linear", action="store_true", help="without stops, friction and clipping of activations, as the poles are"
    )
    parser.add_argument("--two-way", action="store_true", help="the pilot's reaction acts on the rotorcraft")
    parser.add_argument(
        "--kicks",
        metavar="N",
        type=common.positive_int,
        default=None,
        help="besides, N kicks of random size, half-normal with the root mean square SIZE: the chance that the motion "
        "goes on",
    )
    parser.add_argument(
        "--seed", metavar="N", type=common.seed, default=None, help="of turbulence and of sizes (default: 1)"
    )
    parser.add_argument(
        "--integrator",
        choices=("ms", "ida"),
        default="ms",
        help="ms: MBDyn's method at 1 ms; ida: variable step (default: ms)",
    )
    parser.add_argument("--no-figures", action="store_true", help="do not draw figures")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Integrate, fit, write, print."""
    from pilotgen.closed_loop.animation import write_animation
    from pilotgen.closed_loop.poles import open_loop_note
    from pilotgen.closed_loop.reach import check_kick, check_reach
    from pilotgen.closed_loop.simulate import KICKS, kicked, onset, report_text
    from pilotgen.errors import StudyError
    from pilotgen.progress_line import ProgressLine

    size = args.size if args.size is not None else KICKS[args.kick][1]
    if args.kick == "turbulence" and args.pulse is not None:
        raise StudyError("--pulse is of kicks; turbulence has none, leave it out")
    if args.duration < SHORTEST_S:
        raise StudyError(
            f"--duration {args.duration:g}: at least {SHORTEST_S:g} s are wanted, for a kick to be in them"
        )
    if args.duration > LONGEST_S:
        raise StudyError(f"--duration {args.duration:g}: at most {LONGEST_S:g} s, which is a million steps of 1 ms")
    if args.seed is not None and args.kick != "turbulence" and args.kicks is None:
        raise StudyError("--seed would do nothing: a single kick has nothing random; leave it out, or add --kicks N")
    seed = 1 if args.seed is None else args.seed
    if args.linear and args.kicks is not None:
        raise StudyError(
            "--kicks asks how a chance depends on the size, which nothing does with --linear; leave one out"
        )
    if args.through_stops and (args.linear or args.kick in ("pull", "turbulence")):
        why = "--linear has no stops" if args.linear else f"a kick of the kind {args.kick} is never refused for that"
        raise StudyError(f"--through-stops would do nothing: {why}; leave it out")
    if size == 0.0 or (size < 0.0 and (args.kick == "turbulence" or args.kicks is not None)):
        least = "above zero" if size else "above or below zero"
        of = "a root mean square" if args.kick == "turbulence" or args.kicks is not None else "a kick"
        raise StudyError(f"--size {size:g}: {of} {least} is wanted")
    with closed_loop.opened(
        args, "simulate", WRITES, args.two_way, None if args.kicks is None else NO_CHANCE
    ) as opened:
        study, context, directory, loop = opened.study, opened.context, opened.directory, opened.loop
        check_kick(loop, args.kick, size)
        note = open_loop_note(loop)
        if note:
            common.say(note)
        if not args.linear and not args.through_stops:
            check_reach(context, loop, args.kick, size, args.pulse)
        motion, content = kicked(
            context,
            loop,
            args.kick,
            size,
            args.duration,
            pulse_s=args.pulse,
            linear=args.linear,
            integrator=args.integrator,
            seed=seed,
            keep=directory,
        )
        if note:
            content |= {"open_loop": note, "goes_on": None}  # the rotorcraft goes, with or without the pilot
        write_animation(directory / "loop.motion.h5", directory / "animation.h5")
        content = {"study": study.name, "values": opened.values, "two_way": args.two_way, **content}
        chance = None
        if args.kicks is not None:
            line = ProgressLine(total=args.kicks, quiet=args.quiet or args.json)
            try:
                chance = onset(
                    context,
                    loop,
                    args.kick,
                    size,
                    args.kicks,
                    args.duration,
                    pulse_s=args.pulse,
                    seed=seed,
                    progress=lambda done, total: line.update(f"{done}/{total} kicks"),
                )
            finally:
                line.finish()
            content["onset"] = chance.as_dict(KICKS[args.kick][0])
        write_text(directory / "simulation.json", to_json(content))
        if not args.no_figures:
            from pilotgen.figures import simulation, style

            unit = KICKS[args.kick][0]
            style.save(simulation.history(motion, f"{args.kick}, {size:g} {unit}"), directory / "history.png")
            if chance is not None:
                style.save(simulation.onset(chance, unit), directory / "onset.png")
        if args.json:
            sys.stdout.write(to_json(content))
            return 0
        print(report_text(content))
        print(f"loop.mbd, loop.motion.h5, animation.h5 and simulation.json are in {directory}")
    return 0
