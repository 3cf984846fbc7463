"""Read and check a study file: which rotorcraft, which inceptor, which pilot, and what the search may vary.

The field tables below are the schema; `docs/io_formats/study.md` says the same in words (a test compares the two).
Every message starts with `file:line: key = value` and says what was wanted and what to do.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pilotgen.errors import StudyError
from pilotgen.objectives import DEFAULT_OBJECTIVES, OBJECTIVES
from pilotgen.study.rotorcraft import Rotorcraft, load_rotorcraft
from pilotgen.study.schema import (
    Choice,
    Field,
    Name,
    Number,
    Value,
    Whole,
    check_keys,
    did_you_mean,
    read_fields,
    shown,
)
from pilotgen.study.yaml_file import KeyPath, YamlDocument, plain_scalar, read_yaml, yaml_from_text

# ----------------------------------------------------------------------------------------------------------------------
# What a study may vary. The limits are sanity limits: beyond them a value is a slip (of units, mostly), not a pilot.

VARIABLES: Mapping[str, Number] = {
    "age_years": Number(18.0, 80.0, "years", hint="adults only: the regressions are of adults"),
    "stature_m": Number(1.30, 2.20, "m", hint="heights are in metres: 1775 mm is 1.775"),
    "mass_kg": Number(35.0, 180.0, "kg", hint="body mass is in kilograms"),
    "bmi": Number(14.0, 50.0, "kg/m^2", hint="body mass index is mass in kg over the square of stature in m"),
    "pilot_frequency_hz": Number(0.5, 10.0, "Hz", hint="the frequency is in Hz, not rad/s"),
    "pilot_damping": Number(0.01, 1.5, "", hint="the damping ratio is a fraction: 32 % is 0.32"),
    "pilot_time_constant_s": Number(0.005, 1.0, "s", hint="the time constant is in seconds: 117 ms is 0.117"),
}
MAYO_VARIABLES = ("pilot_frequency_hz", "pilot_damping", "pilot_time_constant_s")
BODY_VARIABLES = ("age_years", "mass_kg", "bmi", "stature_m")  # of mass_kg and bmi exactly one

MAYO_PRESETS: Mapping[str, Mapping[str, float]] = {  # Mayo (1989), as in Table 2 of the reference paper
    "ectomorphic": {"pilot_frequency_hz": 3.380, "pilot_damping": 0.320, "pilot_time_constant_s": 0.117},
    "mesomorphic": {"pilot_frequency_hz": 3.750, "pilot_damping": 0.280, "pilot_time_constant_s": 0.107},
}

# ----------------------------------------------------------------------------------------------------------------------
# The sections and their fields. `required` fields have no default.

STUDY_KEYS = ("study", "rotorcraft", "inceptor", "pilot", "cockpit", "nominal", "search")
REQUIRED_STUDY_KEYS = ("study", "rotorcraft", "inceptor", "pilot", "nominal", "search")

INCEPTOR_FIELDS: Mapping[str, Field] = {
    "lever_length_m": Number(0.10, 1.00, "m", hint="lengths are in metres: 320 mm is 0.32"),
    "gearing_rad_per_m": Number(
        0.01, 20.0, "rad/m", hint="rad of blade pitch per metre of grip travel; the Puma of the paper has 1.1"
    ),
    "position": Number(0.0, 1.0, "", default=0.5, hint="collective from 0 (full down) to 1 (full up)"),
}

COMMON_PILOT_FIELDS: Mapping[str, Field] = {
    "model": Choice(("multibody", "mayo")),
    "washout_rad_s": Number(
        0.01, 100.0, "rad/s", default=3.10, null=True, hint="write null for no washout"
    ),  # Eq. (40) of the reference paper
}
MULTIBODY_PILOT_FIELDS: Mapping[str, Field] = {
    "sex": Choice(("male", "female")),
    "task": Choice(("position", "force", "relax"), default="position"),
    "projection": Choice(("exact", "literal"), default="exact"),
    "seat": Choice(("design_eye", "fixed"), default="design_eye"),
    "activation_floor": Number(0.0, 0.2, "", default=0.0, hint="a tonic activation of every muscle, 0 for none"),
    "matrix_coefficient_s": Number(
        1e-6, 1.0, "s", default=0.01, hint="the coefficient c of the matrix pair J(c), J(-c)"
    ),
}
REFLEX_FIELDS: Mapping[str, Field] = {
    "proportional_gain": Number(0.0, 50.0, "", hint="positive gains oppose stretch"),
    "derivative_gain": Number(0.0, 50.0, "", hint="positive gains oppose stretch"),
}
LIMBS = ("left", "right")

SEARCH_FIELDS: Mapping[str, Field] = {
    "population": Whole(4, 100_000),
    "generations": Whole(1, 100_000),
    "mutation_probability": Number(0.0, 1.0, "", default=0.10, hint="a probability is a fraction: 10 % is 0.10"),
    "seed": Whole(0, 2**63 - 1, default=1),
    "algorithm": Choice(("goldberg", "nsga2"), default="goldberg"),
    "stop_rank_one_fraction": Number(
        0.0, 1.0, "", default=0.90, null=True, hint="a fraction: 90 % is 0.90; write null to run all generations"
    ),
}


# ----------------------------------------------------------------------------------------------------------------------
@dataclass(frozen=True)
class Inceptor:
    """The collective lever."""

    lever_length_m: float  # hinge to grip
    gearing_rad_per_m: float  # blade pitch per grip travel, G0 of the reference paper
    position: float  # 0 full down, 1 full up


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
    matrix_coefficient_s: float = 0.01
    reflex: Reflex | None = None  # None: the calibrated gains of the task


@dataclass(frozen=True)
class SearchSettings:
    """What the search may vary and how it goes about it."""

    variables: dict[str, tuple[float, float]]  # name -> (lower, upper), in the order of the file
    objectives: tuple[str, ...]
    population: int
    generations: int  # the initial population is the first generation
    mutation_probability: float
    seed: int
    algorithm: str  # "goldberg" | "nsga2"
    stop_rank_one_fraction: float | None  # stop when so many of the population are rank one; None: never


@dataclass(frozen=True)
class Study:
    """One study file, checked."""

    name: str
    rotorcraft: Rotorcraft
    inceptor: Inceptor
    pilot: PilotSettings
    cockpit: str | dict[str, Any] | None  # bundled name, mapping of overrides, or None for the default cockpit
    nominal: dict[str, float]  # a value for every variable of the pilot model
    search: SearchSettings
    text: str = field(repr=False)  # the file's text
    path: str = ""  # what messages call the file
    lines: dict[KeyPath, int] = field(default_factory=dict, repr=False, compare=False)

    def where(self, *keys: str | int) -> str:
        """Return `file:line` of a key, for messages of the rooms that check its meaning later."""
        return YamlDocument(None, self.path, self.text, self.lines).where(keys)

    def values(self, changes: Mapping[str, float]) -> dict[str, float]:
        """Return the nominal values with `changes`; setting mass_kg replaces bmi and the other way round."""
        dropped = {"mass_kg": "bmi", "bmi": "mass_kg"}
        gone = {dropped[name] for name in changes if name in dropped}
        merged = {name: value for name, value in self.nominal.items() if name not in gone}
        return {**merged, **changes}

    def canonical(self) -> str:
        """Return all that determines an evaluation besides the pilot's values, as JSON with sorted keys.

        Two studies with the same text here give the same result for the same values; search settings, nominal values,
        comments and the study's name are not part of it.
        """
        pilot, rotorcraft = dataclasses.asdict(self.pilot), dataclasses.asdict(self.rotorcraft)
        content: dict[str, Any] = {
            "inceptor": dataclasses.asdict(self.inceptor),
            "rotorcraft": {key: value for key, value in rotorcraft.items() if key not in ("name", "source")},
        }
        if self.pilot.model == "mayo":
            content["pilot"] = {key: pilot[key] for key in COMMON_PILOT_FIELDS}
        else:
            content["pilot"] = pilot
            content["cockpit"] = self.cockpit
        return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)


# ----------------------------------------------------------------------------------------------------------------------
def read_study(path: str | Path) -> Study:
    """Read and check a study file.

    Raises
    ------
    FileError
        The file cannot be read.
    StudyError
        Something in it is wrong; the message starts with `file:line:`.
    """
    return _study(read_yaml(path))


def study_from_text(text: str, name: str = "study.yaml") -> Study:
    """Read and check a study from its text; `name` is what messages call it. Raises StudyError."""
    return _study(yaml_from_text(text, name))


def apply_settings(study: Study, settings: Mapping[str, str]) -> dict[str, float]:
    """Return the values of one pilot: the study's nominal ones with `--set name=value` changes.

    Values outside the study's search bounds are welcome, values outside the sanity limits are not.
    """
    known = MAYO_VARIABLES if study.pilot.model == "mayo" else BODY_VARIABLES
    changes: dict[str, float] = {}
    for name, text in settings.items():
        option = f"--set {name}={text}"
        if name not in known:
            raise StudyError(f"{option}: {_unknown(name, known)}")
        changes[name] = VARIABLES[name].check(option, plain_scalar(text.strip()))
    if "mass_kg" in changes and "bmi" in changes:
        raise StudyError(
            "--set mass_kg and --set bmi exclude each other: the stature gives one from the other; keep one"
        )
    return study.values(changes)


# ----------------------------------------------------------------------------------------------------------------------
def _study(document: YamlDocument) -> Study:
    top = Value(document, ())
    keys = check_keys(top, STUDY_KEYS, REQUIRED_STUDY_KEYS)
    name = Name().read(keys["study"])
    rotorcraft = _rotorcraft(keys["rotorcraft"])
    inceptor = Inceptor(**read_fields(keys["inceptor"], INCEPTOR_FIELDS))
    pilot = _pilot(keys["pilot"])
    if "cockpit" in keys and pilot.model == "mayo":
        raise keys["cockpit"].error("means nothing for pilot.model = 'mayo'; remove it")
    cockpit = _cockpit(keys.get("cockpit"))
    nominal = _nominal(keys["nominal"], pilot.model)
    search = _search(keys["search"], pilot.model, nominal)
    return Study(
        name, rotorcraft, inceptor, pilot, cockpit, nominal, search, document.text, document.name, dict(document.lines)
    )


def _rotorcraft(value: Value) -> Rotorcraft:
    if not isinstance(value.data, str | dict):
        raise value.error("must be the name of a bundled rotorcraft, or a mapping with the symbols of its heave model")
    try:
        return load_rotorcraft(value.data)
    except StudyError as error:
        key = next((k for k in value.data if f"{k} " in str(error)), None) if isinstance(value.data, dict) else None
        raise StudyError(f"{(value.child(key) if key else value).where}: {error}") from error


def _pilot(value: Value) -> PilotSettings:
    body_keys = (*MULTIBODY_PILOT_FIELDS, "limbs", "reflex")
    keys = check_keys(value, (*COMMON_PILOT_FIELDS, *body_keys), ("model",))
    common = read_fields(value, COMMON_PILOT_FIELDS, partly=True)
    if common["model"] == "mayo":
        for key in body_keys:
            if key in keys:
                raise keys[key].error("means nothing for pilot.model = 'mayo'; remove it")
        return PilotSettings(**common)
    body = read_fields(value, MULTIBODY_PILOT_FIELDS, partly=True)
    limbs = _words(keys["limbs"], LIMBS) if "limbs" in keys else ("left",)
    if "left" not in limbs:
        raise keys["limbs"].error("must contain left: the left hand holds the collective lever")
    reflex = None
    if "reflex" in keys and keys["reflex"].data is not None:
        reflex = Reflex(**read_fields(keys["reflex"], REFLEX_FIELDS))
    return PilotSettings(**common, **body, limbs=limbs, reflex=reflex)


def _cockpit(value: Value | None) -> str | dict[str, Any] | None:
    if value is None or value.data is None:
        return None
    if not isinstance(value.data, str | dict):
        raise value.error("must be the name of a bundled cockpit or a mapping of cockpit values")
    _all_finite(value)
    return value.data


def _all_finite(value: Value) -> None:
    # What the entries mean is checked by the cockpit; here they only have to be values that a hash can be made of.
    if isinstance(value.data, float) and not math.isfinite(value.data):
        raise value.error("is not finite; a number is wanted")
    if isinstance(value.data, dict | list):
        for key in value.data if isinstance(value.data, dict) else range(len(value.data)):
            _all_finite(value.child(key))


def _nominal(value: Value, model: str) -> dict[str, float]:
    if model == "mayo" and isinstance(value.data, str):
        if value.data not in MAYO_PRESETS:
            raise value.error(f"is no pilot that Mayo measured; choose one of: {', '.join(MAYO_PRESETS)}")
        return dict(MAYO_PRESETS[value.data])
    if isinstance(value.data, str):
        raise value.error(
            "is no multibody pilot; give {age_years, stature_m, and mass_kg or bmi}"
            + (", or pilot.model: mayo, which knows pilots by that name" if value.data in MAYO_PRESETS else "")
        )
    names = _pilot_variables(value, model)
    return {name: VARIABLES[name].read(value.child(name)) for name in names}


def _pilot_variables(value: Value, model: str) -> tuple[str, ...]:
    # All values that define a pilot must be there; of mass and body mass index exactly one.
    if model == "mayo":
        check_keys(value, MAYO_VARIABLES, MAYO_VARIABLES)
        return MAYO_VARIABLES
    keys = check_keys(value, BODY_VARIABLES, ("age_years", "stature_m"))
    _not_both(value, keys)
    if "mass_kg" not in keys and "bmi" not in keys:
        raise value.missing("mass_kg", "bmi")
    return ("age_years", "mass_kg" if "mass_kg" in keys else "bmi", "stature_m")


def _not_both(value: Value, keys: Mapping[str, Value]) -> None:
    if "mass_kg" in keys and "bmi" in keys:
        raise keys["mass_kg"].error(
            "and bmi exclude each other: the stature gives one from the other; keep one of them"
        )


def _search(value: Value, model: str, nominal: Mapping[str, float]) -> SearchSettings:
    keys = check_keys(value, ("variables", "objectives", *SEARCH_FIELDS), ("variables", "population", "generations"))
    plain = read_fields(value, SEARCH_FIELDS, partly=True)
    variables = _bounds(keys["variables"], model, nominal)
    objectives = _words(keys["objectives"], tuple(OBJECTIVES)) if "objectives" in keys else DEFAULT_OBJECTIVES
    if plain["stop_rank_one_fraction"] == 0.0:
        raise keys["stop_rank_one_fraction"].error("would stop at once; write null to run all generations")
    if plain["algorithm"] == "nsga2" and plain["population"] % 2:
        raise keys["population"].error("must be even for search.algorithm = 'nsga2', which mates in pairs")
    return SearchSettings(variables=variables, objectives=objectives, **plain)


def _bounds(value: Value, model: str, nominal: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    known = MAYO_VARIABLES if model == "mayo" else BODY_VARIABLES
    keys = check_keys(value, known, ())
    if not keys:
        raise value.error(f"is empty; name at least one of: {', '.join(known)}")
    _not_both(value, keys)
    bounds: dict[str, tuple[float, float]] = {}
    for name, entry in keys.items():
        if name not in nominal:
            other = "bmi" if name == "mass_kg" else "mass_kg"
            raise entry.error(f"does not go with nominal.{other}; use mass_kg in both or bmi in both")
        if not isinstance(entry.data, list) or len(entry.data) != 2:
            raise entry.error("must be a list of two bounds, [lower, upper]")
        low, high = (VARIABLES[name].read(entry.child(k)) for k in (0, 1))
        if low > high:
            raise entry.error("has its lower bound above its upper bound; did you swap the bounds?")
        if low == high:
            raise entry.error(f"has equal bounds; to hold a value fixed leave {name} out here and set it in nominal")
        bounds[name] = (low, high)
    return bounds


def _words(value: Value, choices: Sequence[str]) -> tuple[str, ...]:
    if not isinstance(value.data, list) or not value.data:
        raise value.error(f"must be a list of one or more of: {', '.join(choices)}")
    words = tuple(Choice(tuple(choices)).read(value.child(k)) for k in range(len(value.data)))
    if len(set(words)) < len(words):
        raise value.error("names something twice; keep one")
    return words


def _unknown(name: str, known: Sequence[str]) -> str:
    guess = did_you_mean(name, known)
    return f"{shown(name)} is not a variable of this pilot model; {guess}choose one of: {', '.join(known)}"
