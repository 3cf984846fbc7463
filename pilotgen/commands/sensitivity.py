"""`pilotgen sensitivity`: which numbers decide the margins, and which way.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from pilotgen.commands import common, settings
from pilotgen.files import to_json

if TYPE_CHECKING:
    from pilotgen.objectives import Objective
    from pilotgen.runs.batch import Progress


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "sensitivity",
        "tell which numbers decide the margins, and which way",
        "First-order and total Sobol indices of the study's objectives over its numbers, with bootstrap intervals, or "
        "Morris screening, or a classical analysis of variance; slopes at the nominal pilot beside them. N base points "
        "of k numbers are N (k + 2) pilots. "
        "Leaves sensitivity.json in DIR. Same journal, workers and --resume as a search.",
        "pilotgen sensitivity docs/studies/puma-sensitivity.yaml -n 256 -o results/sensitivity",
        json_help="print sensitivity.json instead of tables",
    )
    common.add_study(parser)
    settings.add_settings(parser, settings.MANY_PILOTS)
    common.add_output(parser)
    parser.add_argument(
        "-n",
        "--number",
        metavar="N",
        type=common.positive_int,
        required=True,
        help="base points, a power of two; Morris: trajectories; surrogate: pilots; anova: levels of each number",
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--method",
        choices=("sobol", "morris", "surrogate", "anova"),
        default="sobol",
        help="how numbers are varied (default: sobol)",
    )
    which.add_argument(
        "--surrogate",
        dest="method",
        action="store_const",
        const="surrogate",
        help="Sobol indices of a polynomial through N pilots, with its cross-validated error: --method surrogate",
    )
    which.add_argument(
        "--anova",
        dest="method",
        action="store_const",
        const="anova",
        help="classical analysis of variance over all combinations of N levels: --method anova",
    )
    parser.add_argument(
        "--seed", metavar="S", type=common.seed, default=None, help="seed (default: the study's search.seed)"
    )
    parser.add_argument("--no-figures", action="store_true", help="do not draw figures")
    common.add_workers(parser)
    common.add_solver(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Evaluate, write, print."""
    from pilotgen.runs.executor import pin_threads

    pin_threads()
    from pilotgen.runs.sensitivity_study import FILES, sensitivity_study

    study = settings.read_changed(args, "sensitivity")
    options = common.run_options(args, study)

    def told(progress: Progress) -> str:
        return f"{progress.done}/{progress.total} pilots, {progress.failed} failed"

    with common.long_run(args, "sensitivity", FILES, study, told) as (directory, show, say):
        done = sensitivity_study(study, directory, args.number, args.method, args.seed, options, show, say)
        if not args.no_figures:
            from pilotgen.figures import draw_sensitivity

            draw_sensitivity(done.content, directory)
    if args.json:
        sys.stdout.write(to_json(done.content))
    else:
        print_sensitivity(done.content)
        print(f"\nresults: {args.output / 'sensitivity.json'}" + ("" if args.no_figures else ", figures"))
    return 0 if done.progress.failed < done.progress.done else 2


def print_sensitivity(content: Mapping[str, Any]) -> None:
    """What decides, as a sentence and a table for each objective."""
    from pilotgen.objectives import objective
    from pilotgen.sensitivity.surrogate import ENOUGH
    from pilotgen.sensitivity.words import sentences

    print("\n".join(sentences(content)))
    points, failed = content["points"], content["failed"]
    print(f"{failed} of {points} pilots failed ({100 * failed / points:.1f} %)")
    for key, one in content["objectives"].items():
        row = objective(key)
        print(f"\n{row.label} of {content['loop']}" if content.get("loop") else "")
        if "anova" in one:
            _print_anova(row, one, points)
            continue
        found = one["indices"]
        if found is None:
            print(_infinite(row, one, points))
            found = {"numbers": {name: {} for name in content["numbers"]}, "blocks_left_out": 0}
        elif any(value is None for numbers in found["numbers"].values() for value in numbers.values()):
            print(f"{row.label}: does not vary, or too few pilots could be evaluated; it has no indices")
        if found.get("explained") is not None:
            print(
                f"{row.label}: a polynomial of degree {found['degree']} ({found['terms']} terms) explains "
                f"{100.0 * found['explained']:.1f} % of the variance of pilots left out"
                + ("" if found["explained"] >= ENOUGH else ": too little for its indices; give a larger -n, or sobol")
            )
        if found["blocks_left_out"] and content["method"] == "surrogate":
            print(f"{found['blocks_left_out']} pilots who failed are left out")
        elif found["blocks_left_out"]:
            blocks = found["blocks_left_out"] + found["blocks"]
            print(f"{found['blocks_left_out']} of {blocks} blocks of points are left out, for a pilot of theirs failed")
        morris = content["method"] == "morris"
        size = "mean_magnitude" if morris else "total"
        order = sorted(found["numbers"], key=lambda name: -(found["numbers"][name].get(size) or 0.0))
        width = max(map(len, order))
        second = "deviation" if morris else "first"
        print(f"{row.heading:{width}}  {size.replace('_', ' '):>18}  {second:>18}  slope at the nominal pilot")
        for name in order:
            numbers, slope = found["numbers"][name], one["slopes"][name]
            unit = content["numbers"][name]["unit"] or "1"
            told = "-" if slope is None else f"{slope:+.3g} {row.unit} per {unit}".replace("  ", " ")
            print(f"{name:{width}}  {_cell(numbers, size):>18}  {_cell(numbers, second):>18}  {told}")
        moved = _moved(one.get("convergence", []))
        if moved is not None:
            what = "pilots" if content["method"] == "surrogate" else "base points"
            print(f"total indices moved by at most {moved:.3f} from half the {what} to all of them")


def _infinite(row: Objective, one: Mapping[str, Any], points: int) -> str:
    return (
        f"{row.label}: infinite for {one['infinite']} of {points} pilots ({100.0 * one['infinite'] / points:.1f} %), "
        "so that it has no indices; modulus_margin and gain_at_180 always have"
    )


def _print_anova(row: Objective, one: Mapping[str, Any], points: int) -> None:
    """The classical table, largest sums first."""
    if one["infinite"]:
        print(_infinite(row, one, points))
        return
    if one["anova"] is None:
        print(f"{row.label}: a pilot failed, so that the factorial is not whole and has no table; narrow the ranges")
        return
    effects = sorted((line for line in one["anova"] if "f" in line), key=lambda line: -line["sum_of_squares"])
    lines = effects + [line for line in one["anova"] if "f" not in line]
    width = max(len(row.heading), *(len(line["source"]) for line in lines))
    heads = ("sum of squares", "share", "df", "mean square", "F", "p")
    print(f"{row.heading:{width}}" + "".join(f"{head:>15}" for head in heads))
    for line in lines:
        share = line.get("share")
        cells = [
            f"{line['sum_of_squares']:.5g}",
            "" if share is None else f"{100.0 * share:.1f} %",
            f"{line['degrees_of_freedom']}",
            *(_plain(line.get(key)) for key in ("mean_square", "f", "p")),
        ]
        print(f"{line['source']:{width}}" + "".join(f"{cell:>15}" for cell in cells))


def _plain(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"


def _moved(convergence: Sequence[Mapping[str, Any]]) -> float | None:
    """Largest change of a total index in the last step of convergence; None where there is none."""
    if len(convergence) < 2:
        return None
    before, now = (step["total"] for step in convergence[-2:])
    if None in before.values() or None in now.values():
        return None
    return float(max(abs(now[name] - before[name]) for name in now))


def _cell(numbers: Mapping[str, float | None], key: str) -> str:
    value, half = numbers.get(key), numbers.get(f"{key}_half_width")
    if value is None:
        return "-"
    return f"{value:.3f}" + (f" +- {half:.3f}" if half is not None else "")
