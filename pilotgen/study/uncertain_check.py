"""What the section `uncertain` and the rest of a study have to agree on.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any

from pilotgen.errors import StudyError
from pilotgen.study.fields import Mistake
from pilotgen.study.schema import OTHER_MASS, PILOT_VALUES, applies, field_of, locate
from pilotgen.study.uncertain_section import VALUE, Distribution, matrix_of, merged, out_of_range, positive_definite


def check_uncertain(
    section: Mapping[str, Any],
    model: str,
    value: Callable[[str], Any],
    nominal: Collection[str],
    searched: Collection[str],
) -> None:
    """Raise Mistake if what is uncertain does not go with the study.

    Parameters
    ----------
    section : mapping
        The section, complete.
    model : str
        The pilot model.
    value : callable
        What the study says of a number, by its name.
    nominal, searched : collection of str
        Names of the pilot's own values, and of what the search varies.
    """
    variables, groups, origin = merged(section)
    in_search = {locate(name) for name in searched}
    for name, one in variables.items():
        of_set = origin.get(name)
        path, shown = (
            ("uncertain.sets", f"{of_set} ({name})") if of_set else (f"uncertain.variables.{name}", _brief(one))
        )
        place = locate(name)
        if model in PILOT_VALUES and not applies(place[0], model):
            raise Mistake(path, shown, f"means nothing for pilot.model = {model!r}; remove it")
        if name in OTHER_MASS and name not in nominal:
            other = OTHER_MASS[name]
            raise Mistake(path, shown, f"does not go with nominal.{other}; use mass_kg in both or bmi in both")
        if place in in_search and one.get("as", VALUE) == VALUE:
            raise Mistake(
                path, shown, "takes the place of what the search varies; write as: factor or as: offset, or leave it "
                "out of search.variables",
            )  # fmt: skip
        if one["distribution"] == "words" or one["as"] == VALUE:
            continue
        base = value(name)
        if base is None:
            raise Mistake(path, shown, f"has nothing to be a{'n' if one['as'] == 'offset' else ''} {one['as']} of: "
                          f"this study has no {name}")  # fmt: skip
        problem = out_of_range(one, field_of(name), float(base))
        if problem:
            raise Mistake(path, shown, problem)
    _check_groups(variables, groups)


def _check_groups(variables: Mapping[str, Distribution], groups: Collection[Mapping[str, Any]]) -> None:
    places = {locate(name): name for name, one in variables.items() if one["distribution"] != "words"}
    seen: set[Any] = set()
    for group in groups:
        for name in group["numbers"]:
            try:
                place = locate(name)
            except StudyError as error:
                raise Mistake("uncertain.correlated", name, str(error)) from None
            if place not in places:
                raise Mistake("uncertain.correlated", name, "is no number that is uncertain; give it a distribution")
            if place in seen:
                raise Mistake("uncertain.correlated", name, "stands twice; a number is in one group at most")
            seen.add(place)
        if not positive_definite(matrix_of(group)):
            raise Mistake(
                "uncertain.correlated",
                group["correlation"],
                f"is not positive definite: {', '.join(group['numbers'])} cannot belong together like that; "
                "bring the correlations nearer to zero",
            )


def _brief(one: Distribution) -> str:
    return ", ".join(f"{key} {data}" for key, data in one.items())
