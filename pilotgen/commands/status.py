"""`pilotgen status`: how far a search or sample is, also while it runs.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING, Any

from pilotgen.commands import common
from pilotgen.files import to_json
from pilotgen.progress_line import counted, format_duration

if TYPE_CHECKING:
    from pilotgen.runs.monitor import Status


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "status",
        "tell how far a search or sample is",
        "Tell whether the study in DIR is running, finished or interrupted, how many evaluations are recorded, "
        "failures by stage, rate and time left. A run that is going on is not disturbed.",
        "pilotgen status results/quick",
    )
    parser.add_argument(
        "directory", metavar="DIR", type=common.user_path, help="output directory of a search or sample"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Read, print."""
    from pilotgen.runs.monitor import read_status

    status = read_status(args.directory)
    print(to_json(status.to_dict()) if args.json else told(status), end="" if args.json else "\n")
    return 0


def told(status: Status) -> str:
    """A few lines for a person."""
    more = "; go on with --resume" if status.state == "interrupted" else ""
    lines = [f"{status.kind} {status.state}{more}"]
    lines.append(f"{counted(status.evaluations, 'evaluation')} recorded, {status.failed} failed")
    lines += [f"  {count} at {stage}" for stage, count in sorted(status.failed_by_stage.items())]
    beat = status.beat
    if beat is not None:
        generation = f", generation {beat['generation'] + 1} of {beat['generations']}" if beat["generations"] else ""
        lines.append(f"{beat['done']} of {beat['total']} pilots done{generation}")
        if status.rate_per_s is not None:
            left = f", at most {format_duration(status.left_s)} left" if status.left_s is not None else ""
            lines.append(f"{status.rate_per_s:.1f} evaluations per second{left}")
        if beat.get("worker_memory_bytes"):
            lines.append(f"largest worker, solver included: {beat['worker_memory_bytes'] / 1e6:.0f} MB")
        lines.append(f"told {format_duration(max(0.0, time.time() - beat['time']))} ago by process {beat['pid']}")
    return "\n".join(lines)
