"""The section `population` of a study: who flies this machine. Its rows of the schema, and what they may be together.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from pilotgen.study.fields import ByName, Choice, Field, Matrix, Mistake, Number, Section, Text, bounds

BUNDLED = ("ansur2-men", "ansur2-women")
MIX, OWN, FILE = "ansur2-mix", "own", "file"
QUANTITIES = ("age_years", "stature_m", "mass_kg")  # the order of a covariance
FILTERED = (*QUANTITIES, "bmi")
_NEEDS = {MIX: "share_of_women", OWN: "own", FILE: "file"}  # people -> the key that says who they are


def population_rows(model: str, height_hint: Callable[[Any], str]) -> dict[str, Field]:
    """Rows of the section for the schema; `model` is the pilot model that has bodies."""
    marginal = Choice(("normal", "lognormal"), default=None, meaning="its distribution")
    return {
        "population": Section(
            default=None,
            null=True,
            words=lambda: BUNDLED,
            model=model,
            meaning="people of whom `pilotgen population` tells how many are at risk",
        ),
        "population.people": Choice((*BUNDLED, MIX, OWN, FILE), default=None, meaning="who they are"),
        "population.share_of_women": Number(
            0.0, 1.0, "", default=None, hint="a fraction: 10 % is 0.10", meaning="for `ansur2-mix`"
        ),
        "population.own": Section(default=None, meaning="a distribution of your own, for `people: own`"),
        "population.own.mean": Section(default=None, meaning="means"),
        "population.own.mean.age_years": Number(18.0, 80.0, "years", default=None, meaning="mean age"),
        "population.own.mean.stature_m": Number(
            1.3, 2.2, "m", default=None, hint=height_hint, meaning="mean standing height"
        ),
        "population.own.mean.mass_kg": Number(35.0, 200.0, "kg", default=None, meaning="mean body mass"),
        "population.own.covariance": Matrix(
            3, default=None, meaning="of age [years], stature [m] and mass [kg], three rows of three numbers"
        ),
        "population.own.marginals": Section(default=None, meaning="distributions"),
        "population.own.marginals.age_years": marginal,
        "population.own.marginals.stature_m": marginal,
        "population.own.marginals.mass_kg": marginal,
        "population.file": Text(default=None, meaning="CSV of people, for `people: file`; beside the study"),
        "population.within": ByName(
            entry=bounds, default=None, meaning="entry limits: bounds of age, stature, mass or body mass index"
        ),
    }


def population_from(data: str | Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the section complete; `people` is None for a study without it. Raises Mistake for what contradicts."""
    given: Mapping[str, Any] = {"people": data} if isinstance(data, str) else data or {}
    found = {"people": None, "share_of_women": None, "own": None, "file": None, "within": None, **given}
    who = found["people"]
    if who is None:
        if any(value is not None for value in found.values()):
            choices = ", ".join((*BUNDLED, MIX, OWN, FILE))
            raise Mistake("population", dict(given), f"lacks the key people; choose one of: {choices}")
        return found
    for people, key in _NEEDS.items():
        if people == who and found[key] is None:
            raise Mistake("population.people", who, f"needs the key population.{key}; add it")
        if people != who and found[key] is not None:
            raise Mistake("population.people", who, f"has no use for population.{key}, which is for {people}")
    if found["own"] is not None:
        found["own"] = _own(found["own"])
    for name, limits in (found["within"] or {}).items():
        if name not in FILTERED:
            known = ", ".join(FILTERED)
            raise Mistake("population.within", name, f"is nothing that people of a survey have; known: {known}")
        if limits[0] >= limits[1]:
            raise Mistake(f"population.within.{name}", list(limits), "has its lower bound above its upper bound")
    return found


def _own(given: Mapping[str, Any]) -> dict[str, Any]:
    mean, covariance = dict(given.get("mean") or {}), given.get("covariance")
    missing = [f"mean.{name}" for name in QUANTITIES if mean.get(name) is None]
    missing += ["covariance"] if covariance is None else []
    if missing:
        raise Mistake("population.own", dict(given), f"lacks {', '.join(missing)}; add it")
    usual = {"age_years": "normal", "stature_m": "normal", "mass_kg": "lognormal"}
    return {"mean": mean, "covariance": covariance, "marginals": {**usual, **(given.get("marginals") or {})}}


def within_rows(model: str) -> dict[str, Field]:
    """Rows of `search.within` for the schema; `model` is the pilot model that has bodies."""
    return {
        "search.within": Section(
            default=None, null=True, model=model, meaning="search in the region of a population, not in all of the box"
        ),
        "search.within.population": Choice(
            BUNDLED, default=None, null=True, meaning="whose; null: that of the section `population`"
        ),
        "search.within.probability": Number(
            0.01,
            0.9999,
            "",
            default=0.99,
            hint="a fraction: 99 % is 0.99",
            meaning="how much of the population the region holds",
        ),
    }


def within_from(data: Mapping[str, Any] | None, variables: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return `search.within` complete, None without it. Raises Mistake if the search varies other than people."""
    if data is None:
        return None
    for name in variables:
        if name not in FILTERED:
            raise Mistake(
                f"search.variables.{name}",
                list(variables[name]),
                "is nothing that a population has; search it in a box, without search.within, or set it in its place",
            )
    missing = [name for name in ("age_years", "stature_m") if name not in variables]
    missing += [] if "mass_kg" in variables or "bmi" in variables else ["mass_kg or bmi"]
    if missing:
        raise Mistake(
            "search.variables",
            list(variables),
            f"lacks {' and '.join(missing)}: in the region of a population age, stature and mass vary together",
        )
    return {"population": None, "probability": 0.99, **data}


def check_within(within: Mapping[str, Any] | None, population: Mapping[str, Any], sex: str) -> None:
    """Raise Mistake if a search is to stay within a population that is not there or of the other sex."""
    if within is None:
        return
    who = within["population"] or population["people"]
    if who is None:
        raise Mistake("search.within", dict(within), f"names no population; choose one of: {', '.join(BUNDLED)}")
    wanted = {"ansur2-men": "male", "ansur2-women": "female"}.get(who, sex)
    if wanted != sex:
        raise Mistake("search.within.population", who, f"does not go with pilot.sex = {sex!r}; write sex: {wanted}")
