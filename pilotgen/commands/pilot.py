"""`pilotgen pilot`: evaluate one pilot and keep everything.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pilotgen.commands import common, settings
from pilotgen.errors import StudyError
from pilotgen.files import to_json, write_text
from pilotgen.objectives import OBJECTIVES, below_limits, margins_text
from pilotgen.progress_line import counted
from pilotgen.study.loop_section import COLLECTIVE, HEAVE, LoopSignals
from pilotgen.study.schema import SCHEMA
from pilotgen.study.wording import setting_text

if TYPE_CHECKING:
    from pilotgen.context import EvaluationContext
    from pilotgen.evaluation import Evaluation
    from pilotgen.runs.batch import Progress
    from pilotgen.runs.options import RunOptions
    from pilotgen.study.study import Study

WRITES = ("*.mbd", "*.h5", "*.nc", "*.log", "*.out", "result.json", "bode.png", "nyquist.png", "uncertain.json",
          "uncertain.csv", "band-*.png", "study.yaml", "pilot.html", "journal.sqlite*")  # fmt: skip
DRAWS = 200  # of --uncertain

OF_DRAWS = ("-n", "--workers", "--resume", "--retry-failed", "--max-failures", "--executor", "--scheduler", "--log")

MOST_POLES, POLES_BELOW_HZ = 6, 10.0  # that a summary shows; result.json has all


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "pilot",
        "evaluate one pilot",
        "Evaluate one pilot of a study (its nominal values unless --set says otherwise). Leaves the decks, "
        "matrices.h5, "
        "result.json, pilot_model.h5, figures and pilot.html, which shows him, in DIR and prints a short summary. "
        "With --uncertain: "
        "how his margins spread over what the study's section uncertain does not know of him.",
        "pilotgen pilot docs/studies/puma-bmi.yaml -o results/tall --set stature_m=1.95 bmi=28",
        json_help="print the result object instead of the summary",
    )
    common.add_study(parser)
    common.add_output(parser)
    settings.add_settings(parser)
    common.add_workers(parser, "draws of --uncertain")
    common.add_solver(parser)
    common.add_fail_below(parser)
    parser.add_argument(
        "--uncertain", action="store_true", help="evaluate draws of what is uncertain as well; leaves uncertain.json, "
        "uncertain.csv and three figures",
    )  # fmt: skip
    parser.add_argument(
        "-n", "--number", metavar="N", type=common.positive_int, default=None, help="draws of --uncertain (default: "
        f"{DRAWS})",
    )  # fmt: skip
    parser.add_argument("--no-figures", action="store_true", help="do not draw figures, nor write pilot.html")
    parser.set_defaults(run=run, long_run=False)


def run(args: argparse.Namespace) -> int:
    """Evaluate, write, print."""
    from pilotgen.runs.executor import pin_threads

    pin_threads()
    from pilotgen.context import EvaluationContext
    from pilotgen.evaluation import Evaluation, evaluate, write_result
    from pilotgen.output import claimed

    for option in OF_DRAWS:
        name = "number" if option == "-n" else option.removeprefix("--").replace("-", "_")
        given = getattr(args, name)
        if not (args.uncertain or given is None or given is False or given == "processes"):
            raise StudyError(f"{option} is for --uncertain; add that, or leave {option} out")
    study, values = settings.read_pilot(args)
    options = common.run_options(args, study)
    if args.uncertain:
        from pilotgen.uncertain.draws import Draws

        Draws(study, 1).changes(0, values)  # what is wrong is told before anything is written
        if args.resume:
            from pilotgen.runs.uncertain_study import check_going_on

            check_going_on(args.output, study)
    with (
        EvaluationContext(study, args.mbdae, args.solver, args.mbdyn, args.time_limit) as context,
        claimed(args.output, "pilot", WRITES, args.resume, args.overwrite) as directory,
    ):
        outcome = evaluate(context, values, keep=directory)
        drawn: dict[str, Any] = {}
        if args.uncertain and isinstance(outcome, Evaluation):
            drawn = _draw(args, context, outcome, directory, options)
        content = write_result(context, outcome, directory, {**_in_result(drawn), **_how_rare(study, outcome.result)})
        if args.json:
            sys.stdout.write(to_json(content))
        if not isinstance(outcome, Evaluation):
            print(common.failure_text(outcome, directory), file=sys.stderr)
            return 2
        outcome.pilot_model.write(directory / "pilot_model.h5")
        write_text(directory / "study.yaml", study.text)  # for `pilotgen view`
        if not args.json:
            print(summary(content), flush=True)
        if not args.no_figures:
            from pilotgen.figures import draw_pilot, draw_uncertain

            draw_pilot(outcome, directory)
            if drawn:
                draw_uncertain(drawn, directory)
            from pilotgen.report.view import write_pilot_page

            write_pilot_page(directory, context, outcome, content, args.solver)
        if not args.json:
            kinds = ["decks", "matrices"] if study.pilot.model == "multibody" else []
            kinds += [] if args.no_figures else ["figures", "pilot.html"]
            kinds += ["uncertain.json", "uncertain.csv"] if drawn else []
            print(f"{', '.join([*kinds, 'pilot_model.h5'])} and result.json are in {directory}")
        if args.fail_below:
            return common.told_below(below_limits(content, study.limits))
    return 0


def _draw(
    args: argparse.Namespace, context: EvaluationContext, nominal: Evaluation, directory: Path, options: RunOptions
) -> dict[str, Any]:
    """Evaluate the draws, with a progress line."""
    from pilotgen.runs.uncertain_study import uncertain_study

    def told(progress: Progress) -> str:
        return f"{progress.done}/{progress.total} draws, {progress.failed} failed"

    with common.followed(args, directory, "pilot --uncertain", context.study, told) as (show, say):
        return uncertain_study(context, nominal, directory, args.number or DRAWS, options, show, say).content


def _how_rare(study: Study, result: Mapping[str, Any]) -> dict[str, Any]:
    """How rare the pilot is in the population that the study's search stays in; nothing without one."""
    if study.search.within is None or "biometrics" not in result:
        return {}
    from pilotgen.population.region import rarity, region_of

    region = region_of(study)
    return {} if region is None else {"how_rare": rarity(region, result["biometrics"])}


def _in_result(drawn: Mapping[str, Any]) -> dict[str, Any]:
    """What of the draws stands in result.json."""
    if not drawn:
        return {}
    from pilotgen.runs.uncertain_study import summary as of_draws

    return {"uncertain": of_draws(drawn)}


def spread_lines(told: Mapping[str, Any]) -> list[str]:
    """What the draws say, for a person."""
    from pilotgen.uncertain.spread import sentences

    what = ", ".join(told["what"])
    lines = [f"uncertain  {counted(told['draws'], 'draw')} of {what}"]
    lines += [f"           {sentence}" for sentence in sentences(told)]
    quantiles = next(iter(told["margins"].values()))["quantiles"]
    lines.append(f"{'share of draws below':27}" + "".join(f"{100 * float(q):>8g} %" for q in quantiles))
    for key, row in OBJECTIVES.items():
        cells = [one["value"] for one in told["margins"][key]["quantiles"].values()]
        texts = ["none" if value is None else f"{value:.{row.digits}f}" for value in cells]
        lines.append(f"           {row.heading:16}" + "".join(f"{text:>10}" for text in texts))
    return lines


def summary(result: Mapping[str, Any]) -> str:
    """A few lines for a person."""
    loop = result["loop"]
    lines = []
    own = {name: value for name, value in result["values"].items() if f"nominal.{name}" in SCHEMA}
    biometrics = result.get("biometrics")
    if biometrics:
        lines.append(
            f"pilot      {biometrics['sex']}, {biometrics['age_years']:.0f} years, {biometrics['stature_m']:.3f} m, "
            f"{biometrics['mass_kg']:.1f} kg (BMI {biometrics['bmi']:.1f})"
        )
    else:
        lines.append("pilot      " + ", ".join(f"{name} {value:g}" for name, value in own.items()))
    others = {name: value for name, value in result["values"].items() if name not in own}
    if others:
        lines.append("with       " + ", ".join(f"{name} {setting_text(value)}" for name, value in others.items()))
    if "posture" in result:
        angles = ((name.removesuffix("_deg").replace("_", " "), angle) for name, angle in result["posture"].items())
        lines.append("posture    " + ", ".join(f"{joint} {angle:.0f}" for joint, angle in angles) + " deg")
    if "activation" in result:
        activation = result["activation"]
        lines.append(
            f"muscles    largest activation {activation['largest']:.3f} ({activation['largest_muscle']}), sum of "
            f"squares {activation['sum_of_squares']:.4f}"
        )
    shown = [
        pole for pole in result["pilot_poles"] if pole["frequency_hz"] < POLES_BELOW_HZ and abs(pole["damping"]) < 1.0
    ]
    shown = sorted(shown, key=lambda pole: float(pole["damping"]))[:MOST_POLES]
    poles = ", ".join(
        f"{pole['frequency_hz']:.2f} Hz / {100 * pole['damping']:.0f} %"
        for pole in sorted(shown, key=lambda pole: float(pole["frequency_hz"]))
    )
    left_out = len(result["pilot_poles"]) - len(shown)
    lines.append(
        f"poles      {poles}" + (f" (least damped below {POLES_BELOW_HZ:g} Hz; {left_out} others)" if left_out else "")
    )
    bdft = result["bdft"]
    ends = LoopSignals(loop.get("input", HEAVE), loop.get("output", COLLECTIVE))
    grip = bdft[f"grip_motion_3hz_mm_per_{ends.per_acceleration}"]
    of = "" if ends.usual else f" of the {ends.control}"
    lines.append(
        f"BDFT       {grip:.2f} mm of grip motion{of} per {'rad' if ends.rotates else 'm'}/s^2 at 3 Hz"
        + (f", certificate {bdft['certificate']:.1e}" if bdft.get("certificate") is not None else "")
    )
    state = "stable" if loop["stable"] else "UNSTABLE"
    lines.append(f"loop       {ends.words}: {state}; {margins_text(result, OBJECTIVES.values())}")
    if "how_rare" in result:
        from pilotgen.population.region import rarity_text

        rare = result["how_rare"]
        away = rare["mahalanobis_distance"]
        lines.append(f"how rare   {rarity_text(rare['population'], math.inf if away is None else away)}")
    if "uncertain" in result:
        lines.extend(spread_lines(result["uncertain"]))
    lines.extend(f"caveat     {sentence}" for sentence in result.get("caveats", []))
    return "\n".join(lines)
