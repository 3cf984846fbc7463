"""The schema of a study: every key by its path, with type, unit, range, default, hint and meaning.

Who adds a number to studies adds a row here and a field of the same name to the dataclass that holds its section
(`pilotgen/study/sections.py`). Reading, `--set` and `search.variables` follow; a test holds the format page
(`docs/io_formats/study.md`) against this table.

Limits are sanity limits: beyond them a value is a slip (of units, mostly), not a design or a pilot.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import cache
from typing import Any

from pilotgen.errors import StudyError
from pilotgen.objectives import DEFAULT_OBJECTIVES, FOR_SENSITIVITY, OBJECTIVES
from pilotgen.study.fields import (
    MAYO,
    MULTIBODY,
    REQUIRED,
    ByName,
    Choice,
    Field,
    Name,
    Number,
    Section,
    Vector,
    Whole,
    Words,
    bounds,
)
from pilotgen.study.inceptor_section import INCEPTOR_ROWS
from pilotgen.study.loop_section import LOOP_ROWS
from pilotgen.study.population_section import population_rows, within_rows
from pilotgen.study.rotorcraft_rows import ROTORCRAFT_ROWS
from pilotgen.study.seated_rows import SEATED_ROWS
from pilotgen.study.uncertain_section import Groups, Objectives, uncertain_rows
from pilotgen.study.wording import did_you_mean

MAYO_PRESETS: Mapping[str, Mapping[str, float]] = {  # Mayo (1989), as in Table 2 of the reference paper
    "ectomorphic": {"pilot_frequency_hz": 3.380, "pilot_damping": 0.320, "pilot_time_constant_s": 0.117},
    "mesomorphic": {"pilot_frequency_hz": 3.750, "pilot_damping": 0.280, "pilot_time_constant_s": 0.107},
}


def _height_hint(value: Any) -> str:
    if isinstance(value, int | float):
        for unit, per_m in (("mm", 1000.0), ("cm", 100.0)):
            if 1.3 <= value / per_m <= 2.2:
                return f"heights are in metres: {value:g} {unit} is {value / per_m:g}"
    return "heights are in metres: 1775 mm is 1.775"


SCHEMA: Mapping[str, Field] = {
    "study": Name(meaning="names the results"),
    # ---- rotorcraft, loop, inceptor
    **ROTORCRAFT_ROWS,
    **LOOP_ROWS,
    **INCEPTOR_ROWS,
    # ---- pilot
    "pilot": Section(meaning="how the pilot is modelled"),
    "pilot.model": Choice(
        (MULTIBODY, MAYO), meaning="a generated deck linearised by the solver, or Mayo's transfer function"
    ),
    "pilot.washout_rad_s": Number(
        0.01,
        100.0,
        "rad/s",
        default=3.10,  # Eq. (40) of the reference paper
        null=True,
        hint="write null for no washout",
        meaning="corner of the second-order high-pass by which the pilot trims slow errors away; null for none",
    ),
    "pilot.sex": Choice(("male", "female"), model=MULTIBODY, meaning="which regressions and strengths"),
    "pilot.task": Choice(
        ("position", "force", "relax"),
        default="position",
        model=MULTIBODY,
        meaning="what the pilot tries to do; selects the reflex gains",
    ),
    "pilot.projection": Choice(
        ("exact", "literal"),
        default="exact",
        model=MULTIBODY,
        meaning="the feedthrough: exact, or the reference paper's Eq. (31) to the letter",
    ),
    "pilot.seat": Choice(
        ("design_eye", "fixed"),
        default="design_eye",
        model=MULTIBODY,
        meaning="seat adjusted to the design eye point, or at its middle",
    ),
    "pilot.activation_floor": Number(
        0.0,
        0.2,
        "",
        default=0.0,
        model=MULTIBODY,
        hint="a tonic activation of every muscle, 0 for none",
        meaning="tonic activation below which no muscle goes",
    ),
    "pilot.strength_factor": Number(
        0.1,
        10.0,
        "",
        default=1.0,
        model=MULTIBODY,
        hint="a factor: a pilot who is 20 % weaker than his biometrics say has 0.8",
        meaning="times which every muscle is as strong as the biometrics say",
    ),
    "pilot.reflex_delay_s": Number(
        0.0,
        0.1,
        "s",
        default=0.0,
        model=MULTIBODY,
        hint="the delay is in seconds: 25 ms is 0.025",
        meaning="how late the reflex comes, but for its undelayed share; 0 for none",
    ),
    "pilot.reflex_undelayed_share": Number(
        0.0,
        1.0,
        "",
        default=0.5,  # estimated: short-range stiffness and reflex of like size
        model=MULTIBODY,
        hint="a fraction: 40 % is 0.40",
        meaning="share of the reflex gains that is short-range stiffness of the muscles and acts at once",
    ),
    "pilot.reflex_pade_order": Whole(
        1, 6, default=3, model=MULTIBODY, meaning="order of the approximant that stands for the delay"
    ),
    "pilot.matrix_coefficient_s": Number(
        1e-6,
        1.0,
        "s",
        default=0.01,
        model=MULTIBODY,
        hint="the coefficient c of the matrix pair J(c), J(-c)",
        meaning="coefficient c of the matrix pair J(c), J(-c)",
    ),
    "pilot.limbs": Words(
        ("left", "right"),
        must="left",
        default=("left",),
        model=MULTIBODY,
        hint="the left hand holds the collective lever",
        meaning="arms in the deck; `left` holds the collective and must be there",
    ),
    "pilot.reflex": Section(
        default=None, null=True, model=MULTIBODY, meaning="gains of your own instead of the calibrated ones"
    ),
    "pilot.reflex.proportional_gain": Number(
        0.0,
        50.0,
        "",
        default=None,
        hint="positive gains oppose stretch",
        meaning="activation per relative stretch; positive opposes stretch",
        model=MULTIBODY,
    ),
    "pilot.reflex.derivative_gain": Number(
        0.0,
        50.0,
        "",
        default=None,
        hint="positive gains oppose stretch",
        meaning="activation per relative stretch velocity; positive opposes stretch",
        model=MULTIBODY,
    ),
    # ---- torso, seat, controls
    **SEATED_ROWS,
    # ---- the pilot's own values: what they are without a search
    "nominal": Section(
        words=lambda: tuple(MAYO_PRESETS),
        either=("mass_kg", "bmi"),
        why="the stature gives one from the other",
        meaning="the pilot that `pilotgen pilot` evaluates, and the values that a search does not vary",
    ),
    "nominal.age_years": Number(
        18.0, 80.0, "years", model=MULTIBODY, hint="adults only: the regressions are of adults", meaning="age"
    ),
    "nominal.mass_kg": Number(
        35.0, 200.0, "kg", default=None, model=MULTIBODY, hint="body mass is in kilograms", meaning="body mass"
    ),
    "nominal.bmi": Number(
        14.0,
        50.0,
        "kg/m^2",
        default=None,
        model=MULTIBODY,
        hint="body mass index is mass in kg over the square of stature in m",
        meaning="body mass index, mass over stature squared",
    ),
    "nominal.stature_m": Number(1.30, 2.20, "m", model=MULTIBODY, hint=_height_hint, meaning="standing height"),
    "nominal.pilot_frequency_hz": Number(
        0.5,
        10.0,
        "Hz",
        model=MAYO,
        hint="the frequency is in Hz, not rad/s",
        meaning="natural frequency of Mayo's pilot",
    ),
    "nominal.pilot_damping": Number(
        0.01, 1.5, "", model=MAYO, hint="the damping ratio is a fraction: 32 % is 0.32", meaning="its damping ratio"
    ),
    "nominal.pilot_time_constant_s": Number(
        0.005,
        1.0,
        "s",
        model=MAYO,
        hint="the time constant is in seconds: 117 ms is 0.117",
        meaning="its time constant",
    ),
    # ---- search
    "search": Section(meaning="what the search varies and how"),
    "search.variables": ByName(entry=bounds, meaning="bounds, as above"),
    "search.objectives": Objectives(tuple(OBJECTIVES), default=DEFAULT_OBJECTIVES, meaning="what is minimised"),
    "search.population": Whole(4, 100_000, meaning="individuals per generation; even for `nsga2`"),
    "search.generations": Whole(
        1,
        100_000,
        meaning="at most so many, the initial population included: `population` times `generations` evaluations",
    ),
    "search.mutation_probability": Number(
        0.0,
        1.0,
        "",
        default=0.10,
        hint="a probability is a fraction: 10 % is 0.10",
        meaning="of an offspring being mutated; `goldberg` only",
    ),
    "search.seed": Whole(0, 2**63 - 1, default=1, meaning="the same seed and study give the same evaluations"),
    "search.algorithm": Choice(
        ("goldberg", "nsga2"),
        default="goldberg",
        meaning="the reference paper's algorithm ([theory](../theory/search.md)), or NSGA-II of pymoo",
    ),
    "search.stop_rank_one_fraction": Number(
        0.0,
        1.0,
        "",
        default=0.90,
        null=True,
        hint="a fraction: 90 % is 0.90; write null for no such stop",
        meaning="stop when so many of the population are rank one; null: never for this reason",
    ),
    "search.stop_unchanged_generations": Whole(
        1,
        100_000,
        default=10,
        null=True,
        hint="write null for no such stop",
        meaning="stop when so many generations found nothing worse than 0.1 % of what the first one spans; null: never "
        "for this reason",
    ),
    **within_rows(MULTIBODY),
    # ---- people
    **population_rows(MULTIBODY, _height_hint),
    # ---- sensitivity
    "sensitivity": Section(default=None, null=True, meaning="which numbers `pilotgen sensitivity` varies"),
    "sensitivity.variables": ByName(entry=bounds, default=None, meaning="bounds; those of the search if left out"),
    "sensitivity.objectives": Words(
        (*OBJECTIVES, *FOR_SENSITIVITY),
        default=("modulus_margin", "gain_margin_db"),
        meaning="whose variance is shared out",
    ),
    # ---- what is not known of one pilot
    **uncertain_rows(),
    # ---- limits: what reports and --fail-below hold margins against
    "limits": Section(default=None, null=True, meaning="margins that a robust loop keeps"),
    **{
        f"limits.{row.key}": Number(
            0.0,
            row.cap if math.isfinite(row.cap) else 1.0,
            row.unit,
            default=row.limit,
            null=True,
            hint="write null for no limit",
            meaning=f"smallest {row.label} wanted; null for no limit",
        )
        for row in OBJECTIVES.values()
        if row.worse == "smaller"
    },
}

ALIASES: Mapping[str, str] = {"cockpit.lever": "cockpit.collective"}  # a path may start with either

PILOT_VALUES: Mapping[str, tuple[str, ...]] = {  # the pilot's own values, known by the last part of their path
    model: tuple(path[8:] for path, row in SCHEMA.items() if path.startswith("nominal.") and row.model == model)
    for model in (MULTIBODY, MAYO)
}  # fmt: skip
OTHER_MASS: Mapping[str, str] = {"mass_kg": "bmi", "bmi": "mass_kg"}  # of these two exactly one

SECTIONS_OF_A_RUN = (
    "study",
    "search",
    "limits",
    "population",
    "sensitivity",
    "uncertain",
)  # keys that say what to do, not what is evaluated


@cache
def members(path: str) -> Mapping[str, str]:
    """Return the keys of a section (the whole study: an empty path) and the path of each."""
    start = f"{path}." if path else ""
    return {
        rest: own for own in SCHEMA if own.startswith(start) and "." not in (rest := own.removeprefix(start)) and rest
    }


@cache
def defaults(path: str) -> Mapping[str, Any]:
    """Return the defaults of a section's keys that have one."""
    return {key: SCHEMA[own].default for key, own in members(path).items() if SCHEMA[own].default is not REQUIRED}


def locate(name: str) -> tuple[str, int | None]:
    """Return the path of a number or word by its path or short name, and which entry of a list is meant.

    >>> locate("stature_m"), locate("cockpit.lever.grip_m[1]")
    (('nominal.stature_m', None), ('cockpit.collective.grip_m', 1))

    Raises
    ------
    StudyError
        There is no such path. The message is what follows the name.
    """
    path, index = name, None
    if indexed := re.fullmatch(r"(.+)\[([0-9]{1,9})\]", name):
        path, index = indexed[1], int(indexed[2])
    for short, full in ALIASES.items():
        if path.startswith(f"{short}."):
            path = full + path.removeprefix(short)
    if f"nominal.{path}" in SCHEMA:
        path = f"nominal.{path}"
    row = SCHEMA.get(path)
    if isinstance(row, ByName | Groups) or (
        row is None and any(isinstance(one, ByName) and path.startswith(f"{name}.") for name, one in SCHEMA.items())
    ):
        raise StudyError("is not one number or word; change it in the study file")
    if row is None or (isinstance(row, Section) and not (row.null or row.words)):
        if isinstance(row, Section):
            raise StudyError(f"is a section; give one of: {', '.join(f'{path}.{key}' for key in members(path))}")
        raise StudyError(
            f"is not a number or word of a study; {did_you_mean(name, names())}every key of a study file can be given "
            "by its path, such as inceptor.gearing_rad_per_m (docs/io_formats/study.md)"
        )
    if index is not None and not (isinstance(row, Vector) and index < row.size):
        entries = f"has the entries [0] to [{row.size - 1}]" if isinstance(row, Vector) else "is not a list"
        raise StudyError(entries)
    return path, index


def field_of(name: str) -> Field:
    """Return the declared field of a path or short name; of an entry of a list its number. Raises as `locate`."""
    path, index = locate(name)
    row = SCHEMA[path]
    return row.entry if isinstance(row, Vector) and index is not None else row


def names(model: str = "", numeric: bool = False) -> tuple[str, ...]:
    """Return the names that `--set` accepts: short names of the pilot's own values, paths of all others.

    Parameters
    ----------
    model : str
        Only those of this pilot model; empty for all.
    numeric : bool
        Only those that a search can vary; entries of lists one by one.
    """
    found: list[str] = []
    for path, row in SCHEMA.items():
        if (model and not applies(path, model)) or isinstance(row, Section | ByName | Groups):
            continue
        if numeric and path.partition(".")[0] in SECTIONS_OF_A_RUN:
            continue
        if numeric and isinstance(row, Vector):
            found += [f"{path}[{k}]" for k in range(row.size)]
        elif row.numeric or not numeric:
            found.append(path.removeprefix("nominal."))
    return tuple(found)


def applies(path: str, model: str) -> bool:
    """Whether a pilot model has this key: neither it nor a section around it belongs to another model."""
    parts = path.split(".")
    around = (SCHEMA[".".join(parts[: k + 1])].model for k in range(len(parts)))
    return all(own in ("", model) for own in around)


def is_whole(name: str) -> bool:
    """Whether a name is that of a number of a study that is counted, not measured."""
    try:
        return isinstance(field_of(name), Whole)
    except StudyError:
        return False


def study_unit(name: str) -> str:
    """Return the unit of a number of a study, empty for none and for other names."""
    try:
        return str(getattr(field_of(name), "unit", ""))
    except StudyError:
        return ""
