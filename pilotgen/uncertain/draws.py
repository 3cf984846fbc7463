"""Draws of what is not known of a pilot: the same ones for every pilot, whoever asks and however many.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from pilotgen.context import EvaluationContext
from pilotgen.errors import StudyError
from pilotgen.evaluation import Evaluation, FailedEvaluation, evaluate
from pilotgen.study.fields import Mistake
from pilotgen.study.schema import OTHER_MASS, field_of, is_whole, locate
from pilotgen.study.study import Study, check_uncertainty
from pilotgen.study.uncertain_section import VALUE, matrix_of, merged
from pilotgen.uncertain.distributions import value_of, word_of


class Draws:
    """The first `count` draws of a study's section `uncertain`.

    The scores of a number follow from `uncertain.seed` and its name alone: draw i does not depend on the number of
    draws, on what else is uncertain (but for its group) or on the pilot. Pilots differ by what they are, not by luck.

    Parameters
    ----------
    study : Study
        The study.
    count : int
        How many draws.

    Raises
    ------
    StudyError
        Nothing is uncertain, or it does not go with the study as it is now.
    """

    def __init__(self, study: Study, count: int) -> None:
        try:
            check_uncertainty(study)
        except Mistake as mistake:
            raise StudyError(f"{study.where(*mistake.path.split('.'))}: {mistake}") from None
        self.variables, groups, _ = merged(study.uncertain)
        if not self.variables:
            raise StudyError(
                f"{study.path or 'the study'}: has no section uncertain; add one, e.g. uncertain: {{sets: [reflex, "
                "strength]} (docs/io_formats/uncertain.md)"
            )
        self.study, self.count = study, count
        places = {locate(name): name for name in self.variables}
        seed = study.uncertain["seed"]
        self.scores = {name: _stream(seed, place, count) for place, name in places.items()}
        for group in groups:
            names = [places[locate(name)] for name in group["numbers"]]
            root = np.linalg.cholesky(np.array(matrix_of(group)))
            together = root @ np.array([self.scores[name] for name in names])
            self.scores |= dict(zip(names, together, strict=True))
        self._words = {
            name: word_of(one, self.scores[name])
            for name, one in self.variables.items()
            if one["distribution"] == "words"
        }

    def changes(self, number: int, values: Mapping[str, Any]) -> dict[str, Any]:
        """What draw `number` of the pilot with these values has other than he: name -> number or word.

        Raises
        ------
        StudyError
            Numbers and words that do not go together.
        """
        found: dict[str, Any] = {name: words[number] for name, words in self._words.items()}
        study, own = self.study.with_values({**values, **found})
        for name, one in self.variables.items():
            if name in found:
                continue
            if name in OTHER_MASS and name not in own:
                raise StudyError(f"uncertain: {name} does not go with this pilot's {OTHER_MASS[name]}; give him {name}")
            base = 0.0
            if one["as"] != VALUE:
                base = own[name] if name in own else study.value(name)
            value = value_of(one, field_of(name), float(base), float(self.scores[name][number]))
            found[name] = float(round(value)) if is_whole(name) else value
        return found

    def values(self, number: int, values: Mapping[str, Any]) -> dict[str, Any]:
        """The complete values of draw `number` of the pilot with these complete values. Raises as `changes`."""
        drawn = self.changes(number, values)
        places = {locate(name) for name in drawn}
        return {**{name: value for name, value in values.items() if locate(name) not in places}, **drawn}

    def evaluate(
        self, context: EvaluationContext, number: int, values: Mapping[str, Any]
    ) -> Evaluation | FailedEvaluation:
        """Draw `number` of the pilot with these complete values, evaluated; `context` is of the same study."""
        try:
            drawn = self.values(number, values)
        except StudyError as error:
            return FailedEvaluation(dict(values), "study", str(error))
        return evaluate(context, drawn)


def _stream(seed: int, place: tuple[str, int | None], count: int) -> np.ndarray:
    """Normal scores of one number, shape (count,)."""
    digest = hashlib.sha256(repr(place).encode()).digest()
    return np.random.default_rng([seed, int.from_bytes(digest[:8], "big")]).standard_normal(count)
