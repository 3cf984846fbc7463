"""`pilotgen population`: how many of the people who will fly are at risk.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from pilotgen.commands import common, settings
from pilotgen.errors import StudyError
from pilotgen.files import to_json
from pilotgen.objectives import OBJECTIVES

if TYPE_CHECKING:
    from pilotgen.runs.batch import Progress

EVENTS = ("unstable", *(row.key for row in OBJECTIVES.values() if row.worse == "smaller"))


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "population",
        "tell how many of the people who will fly are at risk",
        "Evaluate N people of the study's population and tell which share makes the machine unstable or has margins "
        "below the study's limits, each with a 95 % interval, and who is nearest to the limits. Leaves population.json "
        "and people.csv in DIR. Same journal, workers and --resume as a search.",
        "pilotgen population docs/studies/puma-population.yaml -n 2000 -o results/population",
        json_help="print population.json instead of sentences",
    )
    common.add_study(parser)
    settings.add_settings(parser, settings.MANY_PILOTS)
    common.add_output(parser)
    parser.add_argument(
        "-n", "--number", metavar="N", type=common.positive_int, required=True, help="how many people; at most, with "
        "--until-width",
    )  # fmt: skip
    parser.add_argument(
        "--until-width",
        metavar="W",
        type=_width,
        default=None,
        help="stop when every 95 %% interval is no wider than W, such as 0.5%% or 0.005",
    )
    parser.add_argument(
        "--rare",
        metavar="EVENT",
        choices=EVENTS,
        default=None,
        help="tell one share that is too rare to be counted: of those who make the loop unstable or have a margin "
        f"below its limit; by importance sampling with N people; leaves rare.json. EVENT: {', '.join(EVENTS)}",
    )
    parser.add_argument(
        "--seed", metavar="S", type=common.seed, default=None, help="seed (default: the study's search.seed)"
    )
    parser.add_argument(
        "--no-figures", action="store_true", help="do not draw figures, nor evaluate the pilots of their background"
    )
    common.add_workers(parser)
    common.add_solver(parser)
    parser.set_defaults(run=run)


def _width(text: str) -> float:
    percent = text.strip().endswith("%")
    value = common.positive_float(text.strip().removesuffix("%")) / (100.0 if percent else 1.0)
    if value >= 1.0:
        raise argparse.ArgumentTypeError(f"{text} is no width of an interval; less than 100 % (1) is wanted")
    return value


def run(args: argparse.Namespace) -> int:
    """Evaluate, write, print."""
    from pilotgen.runs.executor import pin_threads

    pin_threads()
    from pilotgen.runs.population_study import FILES, population_study
    from pilotgen.runs.rare_study import RESULT_NAME, rare_study

    study = settings.read_changed(args, "population")
    options = common.run_options(args, study)
    if args.rare is not None and args.until_width is not None:
        raise StudyError("--until-width is for people counted one by one; leave it or --rare out")

    def told(progress: Progress) -> str:
        return f"{progress.done}/{progress.total} people, {progress.failed} failed, {progress.unstable} unstable"

    with common.long_run(args, "population", FILES, study, told) as (directory, show, say):
        if args.rare is not None:
            done = rare_study(study, directory, args.number, args.rare, args.seed, options, show, say)
        else:
            done = population_study(
                study, directory, args.number, args.until_width, args.seed, options, show, say, not args.no_figures
            )
            if not args.no_figures:
                from pilotgen.figures import draw_population

                draw_population(done.content, directory)
    if args.json:
        sys.stdout.write(to_json(done.content))
    else:
        (print_population if args.rare is None else print_rare)(done.content)
        print(f"{done.progress.done} people ({done.progress.served} from the journal)")
        drawn = "" if args.no_figures else ", figures"
        files = f"population.json, people.csv{drawn}" if args.rare is None else RESULT_NAME
        print(f"results: {args.output}: {files}")
        if args.until_width is not None and done.content["stopped_by"] == "number of people":
            common.say(f"intervals are still wider than {100 * args.until_width:g} %; a larger -n narrows them")
    return 0 if done.progress.failed < done.progress.done else 2


def print_rare(content: Mapping[str, Any]) -> None:
    """Sentences, and who has it and is least unusual."""
    from pilotgen.runs.rare_study import sentences

    print("\n".join(sentences(content)))
    if content["nearest"]:
        print("\nthe least unusual of them:")
    for one in content["nearest"]:
        key = next(key for key in OBJECTIVES if key in one)
        print(f"{_person(one['values'])}  {OBJECTIVES[key].text(one[key])}, distance {one['mahalanobis_distance']:.2f}")


def _person(values: Mapping[str, Any]) -> str:
    bmi = values["mass_kg"] / values["stature_m"] ** 2
    return (
        f"  {values['pilot.sex']:6}  {values['age_years']:4.1f} years  {values['stature_m']:.3f} m  "
        f"{values['mass_kg']:5.1f} kg (BMI {bmi:.1f})"
    )


def print_population(content: Mapping[str, Any]) -> None:
    """Sentences, quantiles, who is nearest to the limits."""
    from pilotgen.population.tally import sentences

    print("\n".join(sentences(content)))
    if not content["evaluated"]:
        return
    print(
        f"\n{'share of people below':24}"
        + "".join(f"{100 * float(q):>8g} %" for q in content["quantiles"]["gain_margin_db"])
    )
    for key, row in OBJECTIVES.items():
        cells = ["none" if value is None else f"{value:.{row.digits}f}" for value in content["quantiles"][key].values()]
        print(f"{row.heading:24}" + "".join(f"{cell:>10}" for cell in cells))
    for key, near in content["nearest"].items():
        row, limit = OBJECTIVES[key], content["shares"][key]["limit"]
        if not near:
            print(f"\nNobody has a {row.label}: there is no {row.no_crossing}.")
            continue
        print(f"\nnearest to a {row.label} of {row.text(limit)}:")
        for one in near:
            print(f"{_person(one['values'])}  {row.text(one[key])}")
