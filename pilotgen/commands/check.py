"""`pilotgen check`: what a search or a sample would do, before it is begun.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from pilotgen.commands import common, settings
from pilotgen.errors import StudyError

if TYPE_CHECKING:
    from pilotgen.runs.plan import Plan
    from pilotgen.study.study import Study


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "check",
        "tell what a study would do: how long, how much memory and disk",
        "Read a study and find out what `pilotgen search` (with -n N: `pilotgen sample`) would do with it: how many "
        "pilots, how many of them are recorded already, how long, how much memory and disk. Solver and optional "
        "packages are looked for, the nominal pilot is evaluated, an output directory is looked at; nothing is "
        "written. What would stop the run before its first pilot is told as the run would tell it.",
        "pilotgen check docs/studies/puma-bmi.yaml -o results/puma-bmi",
    )
    common.add_study(parser)
    settings.add_settings(parser, settings.MANY_PILOTS)
    parser.add_argument(
        "-o", "--output", metavar="DIR", type=common.user_path, default=None, help="where the run would write"
    )
    parser.add_argument(
        "-n", "--number", metavar="N", type=common.positive_int, default=None, help="pilots of a sample"
    )
    parser.add_argument("--workers", metavar="N", type=common.positive_int, default=None, help="as of the run")
    parser.add_argument("--resume", action="store_true", help="as of the run: go on in DIR")
    common.add_solver(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Look, evaluate, print."""
    from pilotgen.runs.executor import pin_threads

    pin_threads()
    from pilotgen.runs.options import RunOptions
    from pilotgen.runs.plan import plan

    if args.resume and args.output is None:
        raise StudyError("--resume is for -o DIR, which has evaluations to go on with; add that, or leave --resume out")
    study = settings.read_changed(args, "search" if args.number is None else "sample")
    common.check_solver(args, study)
    options = RunOptions(
        workers=args.workers, resume=args.resume, solver=args.solver, mbdae=args.mbdae, mbdyn=args.mbdyn
    )
    found = plan(study, options, args.output, args.number)
    if args.json:
        common.print_json(found)
    else:
        print(told(found, study))
    if found.nominal != "evaluated":
        common.say(f"the nominal pilot {found.nominal}")
    for what, wanted, free in (
        ("memory", found.memory_bytes, found.memory_free_bytes),
        ("disk", found.disk_bytes, found.disk_free_bytes),
    ):
        if 0 < free < wanted:
            common.say(f"that is more {what} than is free")
    return 0


def told(found: Plan, study: Study) -> str:
    """A few lines for a person."""
    from pilotgen.population.region import region_of
    from pilotgen.progress_line import counted, format_duration

    search = study.search
    region = region_of(study) if found.kind == "search" else None
    how = f"{search.generations} generations of {search.population}, at most, " if found.kind == "search" else ""
    lines = [
        f"study     {study.name}: {found.kind} of {counted(len(search.variables), 'number')}",
        f"pilots    {how}{counted(found.evaluations, 'evaluation')}"
        + (f", {found.recorded} of them recorded already" if found.recorded else ""),
    ]
    if region is None:
        lines += [f"          {name} from {low:g} to {high:g}" for name, (low, high) in search.variables.items()]
    else:
        lines += [f"          in the region that holds {region.text}: Mahalanobis distance up to {region.radius:.2f}"]
        ends = zip(region.names, *region.extent, strict=True)
        lines += [f"          {name} from {low:.4g} to {high:.4g}" for name, low, high in ends]
    lines += [
        f"solver    {found.solver}",
        f"time      about {format_duration(found.seconds)} with {counted(found.workers, 'worker')}, "
        f"{1e3 * found.seconds_per_pilot:.0f} ms for a pilot",
        f"memory    about {found.memory_bytes / 1e6:.0f} MB, {found.memory_free_bytes / 1e6:.0f} MB free",
        f"disk      about {found.disk_bytes / 1e6:.1f} MB, {found.disk_free_bytes / 1e6:.0f} MB free",
    ]
    return "\n".join(lines)
