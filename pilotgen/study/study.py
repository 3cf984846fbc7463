"""A study: which rotorcraft, which inceptor, which pilot, and what a search may vary.

`read_study` makes it from a file, `Study.with_values` makes another one with any of its numbers and words changed.
What the keys are and what they may be is the schema's business (`pilotgen/study/schema.py`).
Every message starts with `file:line: key = value` and says what was wanted and what to do.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import copy
import dataclasses
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pilotgen.errors import StudyError
from pilotgen.objectives import quantiles
from pilotgen.study.cockpit_numbers import CockpitNumbers
from pilotgen.study.fields import MAYO, REQUIRED, Mistake, Problems, Section
from pilotgen.study.loop_section import COLLECTIVE, LoopSignals
from pilotgen.study.population_section import check_within
from pilotgen.study.reader import read_tree
from pilotgen.study.rotorcraft import Rotorcraft, beside, check_rotorcraft
from pilotgen.study.schema import (
    OTHER_MASS,
    PILOT_VALUES,
    SCHEMA,
    applies,
    locate,
    members,
)
from pilotgen.study.sections import MAKERS, Inceptor, PilotSettings, SearchSettings, calibrated_gains
from pilotgen.study.torso_numbers import LUMPED, RIGID
from pilotgen.study.uncertain_check import check_uncertain
from pilotgen.study.uncertain_section import check_robust, merged
from pilotgen.study.wording import shown
from pilotgen.study.yaml_file import (
    KeyPath,
    YamlDocument,
    bundled,
    read_yaml,
    yaml_from_text,
    yaml_text,
)


@dataclass(frozen=True)
class Study:
    """One study file, checked."""

    name: str
    rotorcraft: Rotorcraft
    loop: LoopSignals  # which motion of the seat, which control
    inceptor: Inceptor
    pilot: PilotSettings
    cockpit: CockpitNumbers
    nominal: dict[str, float]  # a value for every variable of the pilot model
    search: SearchSettings
    limits: dict[str, float | None]  # objective -> what a robust loop keeps; None: no limit
    population: dict[str, Any]  # who flies (pilotgen/study/population_section.py); its `people` is None: nobody said
    sensitivity: dict[str, Any]  # `variables` (None: those of the search), `objectives`
    uncertain: dict[str, Any]  # what is not known of one pilot (pilotgen/study/uncertain_section.py)
    text: str = field(repr=False)  # the file's text
    path: str = ""  # what messages call the file
    lines: dict[KeyPath, int] = field(default_factory=dict, repr=False, compare=False)

    def where(self, *keys: str | int) -> str:
        """Return `file:line` of a key, for messages of the rooms that check its meaning later."""
        return YamlDocument(None, self.path, self.text, self.lines).where(keys)

    def values(self, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return the nominal values with `changes`; setting mass_kg replaces bmi and the other way round.

        Together with the study the mapping says everything about one pilot: it is what `evaluate` takes, what a result
        carries, and what `pilotgen pilot --set` repeats.
        """
        changes = {name.removeprefix("nominal."): value for name, value in changes.items()}
        gone = {OTHER_MASS[name] for name in changes if name in OTHER_MASS}
        merged = {name: value for name, value in self.nominal.items() if name not in gone}
        return {**merged, **changes}

    def value(self, name: str) -> Any:
        """Return the number or word that stands at a path or short name, e.g. `cockpit.collective.grip_m[0]`.

        Defaults and the numbers of bundled sets (rotorcraft, cockpit, calibrated reflex gains) are filled in; of mass
        and body mass index the one that is not given follows from the stature. None for a number of a part that this
        study does without (`rotorcraft.actuator`, ...).

        Raises
        ------
        StudyError
            There is no such number or word.
        """
        path, index = _located(name, self.pilot.model, name)
        section, *keys = path.split(".")
        found = self._plain(section)
        if section == "nominal" and keys and keys[0] in OTHER_MASS and keys[0] not in found:
            squared = found["stature_m"] ** 2
            found[keys[0]] = found["bmi"] * squared if keys[0] == "mass_kg" else found["mass_kg"] / squared
        for key in keys:
            if found is None and path.startswith("pilot.reflex."):
                found = dataclasses.asdict(calibrated_gains(self.pilot.torso["model"])[self.pilot.task])
            if found is None and path.startswith("pilot.torso.girdle."):
                found = dict(bundled("torso").value["girdle"])
            if found is None:  # a part that this study does not have: an actuator, what only some populations have
                return None
            found = found.get(key)
        if isinstance(found, float) and math.isnan(found):  # a symbol of a rotorcraft that is given otherwise
            return None
        return found if index is None else found[index]

    def with_values(
        self, changes: Mapping[str, Any], say: Callable[[str, Any], str] = lambda name, data: f"{name} = {shown(data)}"
    ) -> tuple[Study, dict[str, float]]:
        """Change any numbers and words of the study.

        Parameters
        ----------
        changes : mapping
            Short names of the pilot's own values (`stature_m`) or paths of anything else (`rotorcraft.mass_kg`,
            `pilot.task`, `cockpit.lever.grip_m[0]`), to what they become.
        say : callable
            Name and value -> the beginning of a message about them.

        Returns
        -------
        tuple
            The changed study (this one itself if only the pilot's own values change), and the complete values of the
            pilot: the nominal ones with those of `changes`.

        Raises
        ------
        StudyError
            A name that does not exist or that the pilot model does not have, a value of the wrong kind or out of its
            range, or values that do not go together.
        """
        own: dict[str, float] = {}
        other: dict[str, Any] = {}
        named: dict[str, str] = {}  # what was changed, by path -> as it was called
        for name, data in changes.items():
            what = say(name, data)
            path, index = _located(name, self.pilot.model, what)
            checked = _checked(path, index, what, data)
            place = path if index is None else f"{path}[{index}]"
            if place in named:
                raise StudyError(f"{what} is the same as {named[place]}; keep one of them")
            named[place] = name
            short = path.removeprefix("nominal.")
            if short != path:
                own[short] = checked
            else:
                other[place] = checked
        if "mass_kg" in own and "bmi" in own:
            raise StudyError(
                f"{say(named['nominal.mass_kg'], own['mass_kg'])} and bmi exclude each other: the stature gives one "
                "from the other; keep one"
            )
        if not other:
            return self, self.values(own)
        if other.get("pilot.model", self.pilot.model) != self.pilot.model:
            raise StudyError(
                f"{say(named['pilot.model'], other['pilot.model'])}: another pilot model needs another nominal pilot "
                "and another search box; write another study file"
            )
        try:
            study = self._with_others(other)
        except Mistake as mistake:
            name = named.get(mistake.path, "")
            place = say(name, changes[name]) if name else f"{mistake.path} = {shown(mistake.value)}"
            section = mistake.path.partition(".")[0]
            beside = [own for path, own in named.items() if path.startswith(f"{section}.")]
            if not name and beside:  # what was changed does not go with the rest of its section
                place = f"{say(beside[0], changes[beside[0]])}: {place}"
            raise StudyError(f"{place} {mistake.problem}") from None
        return study, study.values(own)

    def _with_others(self, changes: Mapping[str, Any]) -> Study:
        trees: dict[str, Any] = {}
        bases: dict[str, Any] = {}  # what numbers are set on top of
        for place, data in sorted(
            changes.items(), key=lambda change: change[0].count(".")
        ):  # a named set, then its parts
            path, _, index = place.partition("[")
            section, *keys = path.split(".")
            if section not in trees:
                bases[section], trees[section] = self._plain(section), self._plain(section)
            elif keys and isinstance(trees[section], str):
                base = MAKERS[section](trees[section])
                bases[section], trees[section] = _plain(base), _plain(base)
            if not keys:
                trees[section] = data
                continue
            tree = trees[section]
            for key in keys[:-1]:
                tree[key] = {} if tree.get(key) is None else tree[key]
                tree = tree[key]
            if index:
                tree[keys[-1]][int(index[:-1])] = data
            else:
                tree[keys[-1]] = data
        for place, data in changes.items():
            _check_whole(place.partition("[")[0], data, trees)
        rotorcraft = trees.get("rotorcraft")
        if isinstance(rotorcraft, dict) and rotorcraft["source"] == bases["rotorcraft"]["source"]:
            before = bases["rotorcraft"]
            others = [key for key, number in before.items() if number != rotorcraft[key] and number == number]
            rotorcraft["source"] += f"; changed: {', '.join(others)}" if others else ""
        changed = {_ATTRIBUTE.get(section, section): MAKERS[section](tree) for section, tree in trees.items()}
        study = dataclasses.replace(self, **changed)
        check_together(study)
        if "uncertain" in trees or "search" in trees:
            check_uncertainty(study)
        for path, data in changes.items():
            _check_torso_number(study, path, data)
        return study

    def _plain(self, section: str) -> Any:
        """A section as plain data that may be changed, as the makers take it."""
        return _plain(getattr(self, _ATTRIBUTE.get(section, section)))

    def with_own_text(self) -> Study:
        """Return this study with a text that says what it is, for a study that was changed after it was read.

        The text of an unchanged study stays as it was written, comments and all.
        """
        try:
            if study_from_text(self.text, self.path) == self:
                return self
        except StudyError:  # a text that is not of a study
            pass
        sections: dict[str, Any] = {}
        for section, make in MAKERS.items():
            data = self._plain(section)
            if section == "rotorcraft":
                data = self.rotorcraft.given()
            elif isinstance(data, Mapping):  # what has to be there, and what is not as usual
                known = {key: own for key, own in members(section).items() if applies(own, self.pilot.model)}
                required = {key: data[key] for key, own in known.items() if SCHEMA[own].default is REQUIRED}
                data = {**required, **_differences(data, _plain(make(required)), section, self.pilot.model)}
            if data:
                sections[section] = data
        text = f"# {self.path or 'a study'}, changed\n" + yaml_text(sections)
        return dataclasses.replace(self, text=text, lines=dict(yaml_from_text(text, self.path).lines))

    @property
    def robust(self) -> tuple[str, ...]:
        """Objectives of whose draws the search minimises a quantile; empty if it is no robust search."""
        return tuple(sorted({one.base for one in quantiles(self.search.objectives)}))

    def canonical(self) -> str:
        """Return all that determines an evaluation besides the pilot's values, as JSON with sorted keys.

        Two studies with the same text here give the same result for the same values; search settings, nominal values,
        comments and the study's name are not part of it.
        """
        pilot = dataclasses.asdict(self.pilot)
        content: dict[str, Any] = {
            "inceptor": dataclasses.asdict(self.inceptor),
            "rotorcraft": self.rotorcraft.determining(),
        }
        if not self.loop.usual:
            content["loop"] = dataclasses.asdict(self.loop)
        if self.pilot.model == MAYO:
            content["pilot"] = {key: pilot[key] for key in pilot if applies(f"pilot.{key}", MAYO)}
        else:
            content["pilot"] = pilot
            content["cockpit"] = self.cockpit
        if self.robust:
            variables, groups, _ = merged(self.uncertain)
            content["uncertain"] = {"variables": variables, "correlated": groups, "of": self.robust}
            content["uncertain"] |= {key: self.uncertain[key] for key in ("draws", "seed")}
        return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)


def _check_whole(path: str, data: Any, trees: Mapping[str, Any]) -> None:
    """Refuse a number of a part (`rotorcraft.actuator.damping`) that other numbers are needed for and are not there."""
    section, *keys = path.split(".")
    tree, part = trees[section], section
    for key in keys[:-1]:
        tree, part = tree[key], f"{part}.{key}"
    if not keys or not isinstance(tree, Mapping):
        return
    missing = [own for key, own in members(part).items() if SCHEMA[own].default is REQUIRED and tree.get(key) is None]
    if missing:
        raise Mistake(path, data, f"needs {' and '.join(missing)} as well: this study has no {part}")


# ---- reading ---------------------------------------------------------------------------------------------------------


def read_study(path: str | Path) -> Study:
    """Read and check a study file.

    Raises
    ------
    FileError
        The file cannot be read.
    StudyError
        Something in it is wrong: a line for each mistake, up to ten, which starts with `file:line:`.
    """
    return _study(read_yaml(path))


def study_from_text(text: str, name: str = "study.yaml") -> Study:
    """Read and check a study from its text; `name` is what messages call it. Raises StudyError."""
    return _study(yaml_from_text(text, name))


def _study(document: YamlDocument) -> Study:
    problems = Problems()
    tree = read_tree(document, problems)
    problems.tell()
    tree["rotorcraft"], text = beside(document, tree.get("rotorcraft"))
    parts: dict[str, Any] = {}
    for section, make in MAKERS.items():
        with problems.collect():
            try:
                parts[_ATTRIBUTE.get(section, section)] = make(tree.get(section))
            except Mistake as mistake:
                raise _placed(mistake, document) from None
    problems.tell()
    study = Study(**parts, text=text, path=document.name, lines=dict(document.lines))
    try:
        check_together(study)
        check_uncertainty(study)
        _check_torso(study, tree)
    except Mistake as mistake:
        raise _placed(mistake, document) from None
    return study


def _placed(mistake: Mistake, document: YamlDocument) -> StudyError:
    parts = tuple(mistake.path.split("."))
    ends = (parts[:k] + (".".join(parts[k:]),) for k in range(1, len(parts)))  # a path of a study may be one key
    place = next((path for path in ends if path in document.lines), parts)
    return StudyError(f"{document.where(place)}: {mistake}")


def _located(name: str, model: str, what: str) -> tuple[str, int | None]:
    try:
        path, index = locate(name)
    except StudyError as error:
        raise StudyError(f"{what}: {name!r} {error}") from None
    if model in PILOT_VALUES and not applies(path, model):
        raise StudyError(f"{what} means nothing for pilot.model = {model!r}")
    return path, index


def _checked(path: str, index: int | None, what: str, data: Any) -> Any:
    row = SCHEMA[path]
    if index is not None:
        return row.entry.check(what, data)  # type: ignore[attr-defined]  # locate knows that it is a list
    return row.check(what, list(data) if isinstance(data, tuple) else data)


def _plain(part: Any) -> Any:
    return copy.deepcopy(part) if isinstance(part, str | Mapping) else dataclasses.asdict(part)


def _differences(data: Mapping[str, Any], usual: Mapping[str, Any], path: str, model: str) -> dict[str, Any]:
    """Return the declared keys of a section whose values differ from the usual ones."""
    found: dict[str, Any] = {}
    for key, own in members(path).items():
        if key not in data or not applies(own, model) or (key in usual and data[key] == usual[key]):
            continue
        if isinstance(SCHEMA[own], Section) and isinstance(data[key], Mapping):
            found[key] = _differences(data[key], usual.get(key) or {}, own, model)
        else:
            found[key] = data[key]
    return found


# ---- from checked data to the parts of a study -----------------------------------------------------------------------


_ATTRIBUTE = {"study": "name"}  # where the attribute of `Study` is not called as the key


def check_together(study: Study) -> None:
    """Raise Mistake if sections that are right one by one contradict each other."""
    if not set(study.nominal) <= set(PILOT_VALUES[study.pilot.model]):
        raise Mistake("nominal", study.nominal, f"is no pilot of pilot.model = {study.pilot.model!r}")
    check_within(study.search.within, study.population, study.pilot.sex)
    check_rotorcraft(study.rotorcraft, study.loop)
    _check_pilot(study.pilot, study.loop)
    delay_s = study.pilot.reflex_delay_s
    if delay_s > 0.0 and study.pilot.projection == "literal":
        raise Mistake("pilot.reflex_delay_s", delay_s, "needs pilot.projection = 'exact'; eq. (31) knows no delay")
    for section, variables in (
        ("search", study.search.variables),
        ("sensitivity", study.sensitivity["variables"] or {}),
    ):
        for name, bounds in variables.items():
            if name in OTHER_MASS and name not in study.nominal:
                other = OTHER_MASS[name]
                raise Mistake(
                    f"{section}.variables.{name}",
                    list(bounds),
                    f"does not go with nominal.{other}; use mass_kg in both or bmi in both",
                )
            _check_torso_number(study, name, list(bounds), f"{section}.variables.{name}")


def check_uncertainty(study: Study) -> None:
    """Raise Mistake if what is uncertain does not go with the rest of a study, which may have changed since."""
    check_robust(study.uncertain, study.search.objectives)
    check_uncertain(study.uncertain, study.pilot.model, study.value, study.nominal, tuple(study.search.variables))
    variables, _, origin = merged(study.uncertain)
    for name in variables:
        place = "uncertain.sets" if name in origin else f"uncertain.variables.{name}"
        _check_torso_number(study, name, origin.get(name, "a distribution"), place)


def _check_pilot(pilot: PilotSettings, loop: LoopSignals) -> None:
    """Raise Mistake if a pilot is not one of a study's loop."""
    if loop.usual:
        return
    if pilot.model == MAYO:
        raise Mistake("loop.input", loop.input, "needs pilot.model = 'multibody': Mayo's people moved in heave alone")
    if loop.output != COLLECTIVE and "right" not in pilot.limbs:
        wanted = "give [left, right]"
        raise Mistake("pilot.limbs", list(pilot.limbs), f"lacks the right arm, which holds the cyclic; {wanted}")
    if pilot.projection != "exact":
        raise Mistake("pilot.projection", pilot.projection, f"knows heave alone; {loop.words} needs 'exact'")
    late = pilot.reflex_delay_s
    if late > 0.0:
        raise Mistake("pilot.reflex_delay_s", late, f"is for heave by the collective, not for {loop.words}")


_ONLY_WITH_SPRINGS = ("cockpit.seat.cushion", "cockpit.seat.back", "pilot.torso")


def _check_torso(study: Study, tree: Mapping[str, Any]) -> None:
    """Raise Mistake if a study gives numbers to what its torso does not have."""
    for path in _ONLY_WITH_SPRINGS:
        data: Any = tree
        for key in path.split("."):
            data = data.get(key) if isinstance(data, Mapping) else None
        for key in data if path == "pilot.torso" and isinstance(data, Mapping) else ():
            _check_torso_number(study, f"{path}.{key}", data[key])
        if path != "pilot.torso" and data is not None:
            _check_torso_number(study, path, data)


def _check_torso_number(study: Study, path: str, data: Any, place: str | None = None) -> None:
    springs = path.startswith(_ONLY_WITH_SPRINGS) and path != "pilot.torso.model"
    if springs and study.pilot.model != MAYO and study.pilot.torso["model"] == RIGID and data != "none":
        raise Mistake(
            place or path,
            data,
            "means nothing for pilot.torso.model = 'rigid', which has no springs; remove one of them",
        )
    if path == "pilot.torso.modes_up_to_hz" and study.pilot.torso["model"] == LUMPED:
        raise Mistake(
            place or path,
            data,
            "means nothing for pilot.torso.model = 'lumped', which has no modes; remove one of them",
        )
