"""Sections of a study, made of data that the schema has checked: lever, pilot, search, and who makes which section.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from pilotgen.study.cockpit_numbers import cockpit_from
from pilotgen.study.fields import Mistake, Value
from pilotgen.study.inceptor_section import check_friction
from pilotgen.study.loop_section import loop_from
from pilotgen.study.population_section import population_from, within_from
from pilotgen.study.rotorcraft import rotorcraft_from
from pilotgen.study.schema import MAYO_PRESETS, PILOT_VALUES, SCHEMA, applies, defaults
from pilotgen.study.torso_numbers import TorsoNumbers, torso_from
from pilotgen.study.uncertain_section import uncertain_from
from pilotgen.study.yaml_file import bundled


@dataclass(frozen=True)
class Inceptor:
    """The collective lever."""

    lever_length_m: float  # hinge to grip
    gearing_rad_per_m: float  # blade pitch per grip travel, G0 of the reference paper
    position: float  # 0 full down, 1 full up
    friction: Mapping[str, Any] | None = None  # numbers of its friction, complete


@dataclass(frozen=True)
class Reflex:
    """Gains of the stretch reflex, a = a0 + Kp (x - x0) + Kd v (positive gains oppose stretch)."""

    proportional_gain: float
    derivative_gain: float


@dataclass(frozen=True)
class PilotSettings:
    """How the pilot is modelled; keys of the multibody model keep their defaults when the model is Mayo's."""

    model: str  # "multibody" | "mayo"
    washout_rad_s: float | None = 3.10
    sex: str = "male"  # "male" | "female"
    task: str = "position"  # "position" | "force" | "relax"
    limbs: tuple[str, ...] = ("left",)
    projection: str = "exact"  # "exact" | "literal"
    seat: str = "design_eye"  # "design_eye" | "fixed"
    activation_floor: float = 0.0
    strength_factor: float = 1.0  # times the muscle force that the biometrics give
    reflex_delay_s: float = 0.0  # of the reflex but for its undelayed share
    reflex_undelayed_share: float = 0.5
    reflex_pade_order: int = 3
    matrix_coefficient_s: float = 0.01
    reflex: Reflex | None = None  # None: the calibrated gains of the task
    torso: TorsoNumbers = field(default_factory=lambda: torso_from(None))


@dataclass(frozen=True)
class SearchSettings:
    """What the search may vary and how it goes about it."""

    variables: dict[str, tuple[float, float]]  # short name or path -> (lower, upper), in the order of the file
    objectives: tuple[str, ...]
    population: int
    generations: int  # the initial population is the first generation
    mutation_probability: float
    seed: int
    algorithm: str  # "goldberg" | "nsga2"
    stop_rank_one_fraction: float | None  # stop when so many of the population are rank one; None: never
    within: dict[str, Any] | None = None  # `population`, `probability` of the region to stay in; None: all of the box
    stop_unchanged_generations: int | None = None  # stop when so many found nothing worse; None: never


@cache
def calibrated_gains(torso: str) -> Mapping[str, Reflex]:
    """Gains of every task as `pilotgen calibrate` found them (pilotgen/data/reflex.yaml, docs/theory/calibration.md).

    Parameters
    ----------
    torso : str
        Model of the torso; each has gains of its own.
    """
    tasks = Value(bundled("reflex"), ("torso", torso))
    keys = [f.name for f in dataclasses.fields(Reflex)]
    return {
        task: Reflex(**{key: SCHEMA[f"pilot.reflex.{key}"].read(tasks.child(task).child(key)) for key in keys})
        for task in tasks.data
    }


def _pilot(data: Mapping[str, Any]) -> PilotSettings:
    usual = {key: value for key, value in defaults("pilot").items() if applies(f"pilot.{key}", data["model"])}
    settings = PilotSettings(**{**usual, **data, "reflex": None, "torso": torso_from(data.get("torso"))})
    if data.get("reflex") is None:
        return settings
    calibrated = dataclasses.asdict(calibrated_gains(settings.torso["model"])[settings.task])
    return dataclasses.replace(settings, reflex=Reflex(**{**calibrated, **data["reflex"]}))


def _nominal(data: str | Mapping[str, float]) -> dict[str, float]:
    if isinstance(data, str):
        return dict(MAYO_PRESETS[data])
    return {key: data[key] for own in PILOT_VALUES.values() for key in own if key in data}


def _search(data: Mapping[str, Any]) -> SearchSettings:
    within = within_from(data.get("within"), data["variables"])
    settings = SearchSettings(**{**defaults("search"), **data, "within": within})
    if settings.stop_rank_one_fraction == 0.0:
        raise Mistake("search.stop_rank_one_fraction", 0.0, "would stop at once; write null for no such stop")
    if settings.algorithm == "nsga2" and settings.population % 2:
        raise Mistake(
            "search.population",
            settings.population,
            "must be even for search.algorithm = 'nsga2', which mates in pairs",
        )
    return settings


MAKERS: Mapping[str, Callable[[Any], Any]] = {
    "study": lambda name: name,
    "rotorcraft": rotorcraft_from,
    "loop": loop_from,
    "inceptor": lambda data: Inceptor(
        **{**defaults("inceptor"), **data, "friction": check_friction(data.get("friction"))}
    ),
    "pilot": _pilot,
    "cockpit": cockpit_from,
    "nominal": _nominal,
    "search": _search,
    "population": population_from,
    "sensitivity": lambda data: {**defaults("sensitivity"), **(data or {})},
    "uncertain": uncertain_from,
    "limits": lambda data: {**defaults("limits"), **(data or {})},
}
