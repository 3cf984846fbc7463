"""`--set`: what a command's study has other than its file says.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import Any

from pilotgen.commands import common
from pilotgen.errors import StudyError
from pilotgen.runs.changes import ROBUST_KINDS
from pilotgen.study.schema import SCHEMA, locate, study_unit
from pilotgen.study.settings import apply_settings, changed_study, refuse_idle
from pilotgen.study.study import Study, read_study

ONE_PILOT = (
    "anything this pilot has other than the study says: biometrics by name, all other numbers and words by their path, "
    "e.g. --set stature_m=1.62 bmi=28 inceptor.gearing_rad_per_m=0.9 pilot.task=relax"
)
MANY_PILOTS = (
    "what this run has other than the study file says, by path, e.g. --set inceptor.gearing_rad_per_m=0.9 "
    "search.seed=3; the changed study is the one that is recorded"
)


def add_settings(parser: argparse.ArgumentParser, what: str = ONE_PILOT) -> None:
    """Add --set name=value."""
    parser.add_argument(
        "--set",
        dest="settings",
        metavar="NAME=VALUE",
        nargs="+",
        action="extend",
        default=[],
        help=what,
    )


def parse_settings(texts: Sequence[str]) -> dict[str, str]:
    """`["a=1", "b=2"]` -> `{"a": "1", "b": "2"}`."""
    settings: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name.strip() or not value.strip():
            raise StudyError(f"--set {text}: NAME=VALUE is wanted, e.g. --set stature_m=1.80")
        if name.strip() in settings:
            raise StudyError(f"--set {name.strip()} is given twice; keep one")
        settings[name.strip()] = value.strip()
    return settings


def read_pilot(args: argparse.Namespace) -> tuple[Study, dict[str, Any]]:
    """Study and values of the one pilot that STUDY.yaml and --set name; says what lies outside the study's box."""
    study = read_study(args.study)
    settings = parse_settings(args.settings)
    changed, values = apply_settings(study, settings)
    refuse_idle(settings, _unused(args, args.command, changed), args.command)
    given = {locate(name): values[name.removeprefix("nominal.")] for name in settings}
    for name, (low, high) in study.search.variables.items():
        value = given.get(locate(name))
        if isinstance(value, int | float) and not low <= value <= high:
            unit = f" {study_unit(name)}".rstrip()
            common.say(f"{name} = {value:g}{unit} is outside the study's search box, {low:g} to {high:g}{unit}")
    return changed, values


def read_changed(args: argparse.Namespace, kind: str) -> Study:
    """The study that STUDY.yaml and --set name, for a run of this kind over many pilots.

    A setting that the run would make nothing of is refused; one of the nominal pilot that the run varies is told.
    """
    settings = parse_settings(args.settings)
    changed = changed_study(read_study(args.study), settings)
    refuse_idle(settings, _unused(args, kind, changed), args.command)
    if kind in ("search", "sample"):
        _say_varied(settings, changed, kind)
    if getattr(args, "seed", None) is not None and "search.seed" in settings:
        raise StudyError("--seed and --set search.seed are the same; leave one out")
    return changed


def _unused(args: argparse.Namespace, kind: str, study: Study) -> list[str]:
    """Paths of a study that a kind of run makes no use of."""
    uncertain = getattr(args, "uncertain", False) if kind == "pilot" else bool(study.robust) and kind in ROBUST_KINDS
    unused = [] if uncertain else ["uncertain"]
    if kind not in ("search", "cures"):
        course = [path for path in SCHEMA if path.startswith("search.")]
        used = {"sample": ("seed", "objectives"), "population": ("seed",), "sensitivity": ("seed",)}.get(kind, ())
        unused += [path for path in course if path.removeprefix("search.").partition(".")[0] not in used]
    if kind != "sensitivity":
        unused.append("sensitivity")
    if kind == "population":
        file_or_own = study.population["people"] in ("file", "own")
        unused += ["nominal", *([] if file_or_own else ["pilot.sex"])]  # people have their own
    elif not (kind in ("search", "pilot") and study.search.within) and not getattr(args, "people", 0):
        unused.append("population")
    if kind not in ("search", "sample", "population", "cures", "pilot"):
        unused.append("limits")
    if kind in ("torso", "decks"):
        unused.append("rotorcraft")
    if kind == "calibrate":  # it has people of its own
        unused += ["nominal", *(f"pilot.{key}" for key in ("sex", "limbs", "projection", "reflex", "strength_factor"))]
    if kind == "rotorcraft":
        unused += [path for path in SCHEMA if path.partition(".")[0] not in ("rotorcraft", "loop", "study")]
    return unused


def _say_varied(settings: Mapping[str, str], study: Study, kind: str) -> None:
    """Say which numbers of the nominal pilot --set changed though the run varies them: he alone has them."""
    given = {locate(name) for name in settings}
    for name, (low, high) in study.search.variables.items():
        if locate(name) in given:
            unit = f" {study_unit(name)}".rstrip()
            common.say(
                f"{name} = {study.value(name):g}{unit} is of the nominal pilot alone: the {kind} varies it, {low:g} to "
                f"{high:g}{unit}"
            )


def again(args: argparse.Namespace, values: Mapping[str, Any], solver: str, robust: bool = False) -> str:
    """The command line that evaluates one pilot of a run again, with what --set changed."""
    from pilotgen.runs.batch import replay_command

    own = {locate(name) for name in values}
    other = ("nominal", "search", "limits", "population", "sensitivity", "study", *(() if robust else ("uncertain",)))
    settings = {
        name: text
        for name, text in parse_settings(args.settings).items()
        if locate(name) not in own and locate(name)[0].partition(".")[0] not in other
    }
    return replay_command(str(args.study), {**settings, **values}, solver)
