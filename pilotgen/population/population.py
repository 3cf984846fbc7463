"""The population of a study: people one after the other, the same ones whoever asks and however many.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pilotgen.errors import StudyError
from pilotgen.population.joint import Joint, bundled_joint, joint_of_moments
from pilotgen.population.people_file import read_people
from pilotgen.study.population_section import FILE, MIX, OWN, QUANTITIES
from pilotgen.study.schema import SCHEMA
from pilotgen.study.study import Study
from pilotgen.study.yaml_file import bundled

CANDIDATES = 1000  # drawn at a time
HOPELESS = 100_000  # candidates in a row of whom nobody is within the limits

Person = dict[str, Any]  # age_years, stature_m, mass_kg, pilot.sex


@dataclass
class LeftOut:
    """Who was drawn or read and is not among the people, counted while they are drawn."""

    candidates: int = 0
    by_limit: dict[str, int] = field(default_factory=dict)  # sentence -> how many, each person by his first limit

    def add(self, why: str) -> None:
        """Count one person."""
        self.by_limit[why] = self.by_limit.get(why, 0) + 1

    @property
    def number(self) -> int:
        """How many are left out."""
        return sum(self.by_limit.values())


@dataclass(frozen=True)
class Population:
    """People of one kind or a mix of two.

    Attributes
    ----------
    name : str
        As a sentence says it: `men`, `women`, `people (10 % women)`.
    joints : tuple of (share, Joint)
        Whom people are drawn from; empty for a file.
    listed : tuple of Person
        People of a file.
    within : mapping
        Entry limits: quantity -> (lowest, highest).
    """

    name: str
    joints: tuple[tuple[float, Joint], ...] = ()
    listed: tuple[Person, ...] = ()
    within: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def limits_text(self) -> str:
        """Where people come from, as one sentence: the range of each distribution, and the entry limits."""
        parts = [
            f"{joint.sex} " + ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in joint.range.items())
            for _, joint in self.joints
        ]
        text = f"drawn from {'; '.join(parts)}" if parts else f"{len(self.listed)} people of a file"
        limits = ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in self.within.items())
        return text + (f"; entry limits {limits}" if limits else "")

    def people(self, seed: int, left_out: LeftOut | None = None) -> Iterator[Person]:
        """People in their order, without end unless they are listed; person i depends on the seed alone.

        Raises
        ------
        StudyError
            Nobody is within the limits.
        """
        left_out = left_out if left_out is not None else LeftOut()
        if self.listed:
            order = np.random.default_rng([seed, 1]).permutation(len(self.listed))
            yield from self._kept(((self.listed[k], "") for k in order), left_out)
            return
        ends = np.cumsum([share for share, _ in self.joints])
        kept = [self._kept(self._drawn(joint, seed, k), left_out) for k, (_, joint) in enumerate(self.joints)]
        chunk = 0
        while True:  # whose turn it is comes first, so that the share is that of the people within the limits
            turns = np.random.default_rng([seed, 0, chunk]).random(CANDIDATES)
            chunk += 1
            for k in np.minimum(np.searchsorted(ends, turns, side="right"), len(ends) - 1).tolist():
                yield next(kept[k])

    def _kept(self, candidates: Iterator[tuple[Person, str]], left_out: LeftOut) -> Iterator[Person]:
        """Those within the limits; the others are counted."""
        since = found = 0
        for person, outside in candidates:
            left_out.candidates += 1
            why = outside or self._outside(person, self.within, "entry limit")
            if not why:
                since, found = 0, found + 1
                yield person
                continue
            left_out.add(why)
            since += 1
            if since >= HOPELESS:
                break
        if not found or since >= HOPELESS:
            raise StudyError(f"population: nobody of the last {since} candidates is within its limits; widen them")

    def _drawn(self, joint: Joint, seed: int, number: int) -> Iterator[tuple[Person, str]]:
        """Candidates of one distribution, and what of its range each is outside of."""
        chunk = 0
        while True:
            scores = np.random.default_rng([seed, 2 + number, chunk]).standard_normal((CANDIDATES, 3))
            chunk += 1
            for row in joint.people(scores).tolist():
                person: Person = {**dict(zip(QUANTITIES, row, strict=True)), "pilot.sex": joint.sex}
                yield person, self._outside(person, joint.range, f"range of {joint.sex} people")

    @staticmethod
    def _outside(person: Person, limits: Mapping[str, tuple[float, float]], what: str) -> str:
        for name, (low, high) in limits.items():
            value = person["mass_kg"] / person["stature_m"] ** 2 if name == "bmi" else person[name]
            if not low <= value <= high:
                return f"{name} outside {low:g} to {high:g} ({what})"
        return ""


def population_of(study: Study) -> Population:
    """The population of a study.

    Raises
    ------
    StudyError
        The study has none, its covariance is not positive definite, or its file of people is not as wanted.
    FileError
        Its file of people cannot be read.
    """
    section = study.population
    who, within, sex = section["people"], dict(section["within"] or {}), study.pilot.sex
    if who is None:
        raise StudyError(
            f"{study.path or 'the study'}: has no section population; add one, e.g. population: ansur2-men "
            "(docs/io_formats/study.md)"
        )
    if who == FILE:
        listed = tuple(read_people(Path(study.path).parent / section["file"], sex))
        return Population("people of the file", (), listed, within)
    if who == OWN:
        own = section["own"]
        limits = {name: (SCHEMA[f"nominal.{name}"].low, SCHEMA[f"nominal.{name}"].high) for name in QUANTITIES}  # type: ignore[attr-defined]
        joint = joint_of_moments(
            sex,
            [own["mean"][name] for name in QUANTITIES],
            own["covariance"],
            [own["marginals"][name] == "lognormal" for name in QUANTITIES],
            limits,
            f"{study.where('population', 'own', 'covariance')}: population.own.covariance",
        )
        return Population("men" if sex == "male" else "women", ((1.0, joint),), (), within)
    data = bundled("population").value
    if who == MIX:
        women = section["share_of_women"]
        parts = ((1.0 - women, "ansur2-men"), (women, "ansur2-women"))
        joints = tuple((share, bundled_joint(data[name])) for share, name in parts if share > 0.0)
        return Population(f"people ({100 * women:g} % women)", joints, (), within)
    return Population(who.removeprefix("ansur2-"), ((1.0, bundled_joint(data[who])),), (), within)
