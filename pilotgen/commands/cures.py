"""`pilotgen cures`: what may be changed against bounce, what each change buys, and the cheapest that is enough.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pilotgen.commands import common, settings
from pilotgen.files import to_json
from pilotgen.output import STUDY_NAME

if TYPE_CHECKING:
    from pilotgen.runs.batch import Progress

STILL_MM = 0.1  # swing of the grip at the end of a motion, above which it goes on
WRITES = ("cures.json", "cured.yaml", "cures.png", "cure_map*.png", "journal.sqlite*", STUDY_NAME)


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "cures",
        "tell what cures bounce: damper, balance weight, friction, gearing, seat, filters",
        "Breeds the worst pilot of the study's search box, tries every cure alone on him and on the nominal pilot, and "
        "looks for the cheapest combination that keeps the study's limits; worst pilots are bred anew for the cured "
        "cockpit until none misses them. Leaves cures.json, figures, and cured.yaml, the study with the proposed "
        "cockpit, in DIR. "
        "Same journal, workers and --resume as a search.",
        "pilotgen cures docs/studies/puma-cures.yaml -o results/cures",
        json_help="print cures.json instead of tables",
    )
    common.add_study(parser)
    settings.add_settings(parser, settings.MANY_PILOTS)
    common.add_output(parser)
    parser.add_argument(
        "--only", metavar="CURE", nargs="+", default=[], help="these cures alone (docs/io_formats/cures.md)"
    )
    parser.add_argument("--without", metavar="CURE", nargs="+", default=[], help="all cures but these")
    parser.add_argument(
        "--map",
        dest="maps",
        metavar=("CURE", "CURE"),
        nargs=2,
        action="append",
        default=[],
        help="margins of the worst and the nominal pilot over these two cures, 20 by 20, with the lines of the limits; "
        "may be repeated (default: over the two that buy most)",
    )
    parser.add_argument(
        "--swing",
        metavar="MM",
        type=common.positive_float,
        default=None,
        help="amplitude of the grip for which friction is told: what it buys depends on it (default: 10 mm)",
    )
    parser.add_argument(
        "--people",
        metavar="N",
        type=common.positive_int,
        default=0,
        help="of the study's population: who misses a limit before and after",
    )
    parser.add_argument("--no-simulation", action="store_true", help="do not kick the worst pilot in time")
    parser.add_argument("--no-figures", action="store_true", help="leave no figures")
    common.add_workers(parser)
    common.add_solver(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Look for cures, write, print."""
    from pilotgen.runs.executor import pin_threads

    pin_threads()
    from pilotgen.runs.cures_study import cures_study

    study = settings.read_changed(args, "cures")
    options = common.run_options(args, study)

    def told(progress: Progress) -> str:
        return f"{progress.done} {'pilot' if progress.done == 1 else 'pilots'}, {progress.failed} failed"

    with common.long_run(args, "cures", WRITES, study, told) as (directory, show, say):
        done = cures_study(
            study,
            directory,
            tuple(args.only),
            tuple(args.without),
            args.people,
            not args.no_simulation,
            options,
            show,
            say,
            args.maps,
            args.swing,
        )
        if not args.no_figures:
            draw(done.content, directory)
    if args.json:
        sys.stdout.write(to_json(done.content))
    else:
        print("\n".join(lines(done.content)))
        print(f"\nresults: {args.output}: cures.json, cured.yaml" + ("" if args.no_figures else ", figures"))
    return 0


def draw(content: Mapping[str, Any], directory: Path) -> None:
    """The figures of cures.json."""
    from pilotgen.figures import cures as figures
    from pilotgen.figures.style import save

    save(figures.each_alone(content), directory / "cures.png")
    pairs = list(dict.fromkeys((found["x"]["key"], found["y"]["key"]) for found in content["maps"]))
    drawn = {directory / f"cure_map-{x}-{y}.png": (x, y) for x, y in pairs}
    for path in directory.glob("cure_map*.png"):  # of a run with other maps that this one goes on with
        if path not in drawn:
            path.unlink()
    for path, pair in drawn.items():
        save(figures.cure_map(content, pair), path)


def lines(content: Mapping[str, Any]) -> list[str]:
    """What cures, as a sentence and tables."""
    costs = "costs beside each other are estimated: --only and --without leave cures out"
    told = [
        content["sentence"],
        *([costs] if content["proposal"]["amounts"] else []),
        "",
        "each alone, as far as is practicable:",
    ]
    for row in content["cures"]:
        why = "" if row["remedy"] else " (an influence, no remedy)"
        told.append(f"  {row['best']['worst']['sentence']}{why}")
        told += _growing(row)
    told += ["", f"{'pilot':18} {'before':>28}   {'after':>28}"]
    for row in content["proposal"]["pilots"]:
        told.append(f"{row['name']:18} {_margins(row['before']):>28}   {_margins(row['after']):>28}")
    if any("no crossing" in line for line in told):
        told.append("(no crossing: |L| stays below 1, and a phase margin is not needed)")
    told += _kicked(content["simulation"])
    people = content["population"]
    if people is not None:
        shares = [people[when]["missing_a_limit"] for when in ("before", "after")]
        told += [
            "",
            f"of {people['people']} people miss a limit: before {_share(shares[0])}, after {_share(shares[1])}",
        ]
    if content["maps"]:
        told += ["", "maps:", *(f"  {found['sentence']}" for found in content["maps"])]
    changes = content["proposal"]["changes"]
    if changes:
        told += ["", "as settings (--set): " + " ".join(f"{path}={value:.6g}" for path, value in changes.items())]
    return told


def _growing(row: Mapping[str, Any]) -> list[str]:
    """How large a swing friction allows a loop that is unstable without, by the friction."""
    told = []
    for name, swings in row.get("smallest_swing_that_grows_mm", {}).items():
        if "reason" in swings:
            told.append(f"    {name} pilot, unstable without: smallest swing that grows not told: {swings['reason']}")
            continue
        cells = [
            f"{amount:.0f} N {'-' if mm is None else f'{mm:.3g}'}"
            for amount, mm in zip(swings["more_n"], swings["swing_mm"], strict=True)
        ]
        told.append(f"    {name} pilot, unstable without: smallest swing that grows [mm; -: none within the stops]:")
        told.append(f"    by friction more: {', '.join(cells)}")
    return told


def _kicked(found: Mapping[str, Any] | None) -> list[str]:
    """What the kicked lever did, before and after."""
    from pilotgen.runs.cures_in_time import kicks_told

    if found is None:
        return []
    if "reason" in found:
        return ["", f"not kicked in time: {found['reason']}"]
    rows = []
    for when in ("before", "after"):
        row, fit = found[when], found[when]["fit"]
        most, last = row["largest_grip_travel_mm"], row["swing_at_the_end_mm"]
        decay = ""
        if row["hits_stop"] and last > STILL_MM:
            decay = "; it goes on, and meets the stops"
        elif fit is not None:
            way = "decays" if fit["growth_rad_s"] < 0.0 else "GROWS"
            decay = f"; {way} by {abs(fit['growth_rad_s']):.2f} 1/s at {fit['frequency_hz']:.2f} Hz"
        rows.append(f"{when}: {most:.1f} mm at most, {last:.3f} mm at the end{decay}")
    told = ["", f"the {found['pilot']} pilot's grip after a kick of {found['kick_n']:g} N:", *(f"  {r}" for r in rows)]
    kicks = kicks_told(found)
    if kicks is not None:
        told.append(f"  {kicks}")
    return told


def _margins(told: Mapping[str, Any]) -> str:
    if told["status"] != "ok":
        return f"failed: {told['stage']}"
    phase = told["phase_margin_deg"]
    gain = told["gain_margin_db"]
    return f"{'-' if gain is None else f'{gain:.2f}'} dB, {'no crossing' if phase is None else f'{phase:.0f} deg'}"


def _share(share: Mapping[str, Any]) -> str:
    if share["share"] is None:
        return "cannot tell"
    return f"{100 * share['share']:.1f} % ({100 * share['low']:.1f}-{100 * share['high']:.1f} %)"
