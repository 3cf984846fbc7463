"""Pilots whose loops are to be cured: evaluated with any amounts of cures, judged by the study's limits.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pilotgen.cures.catalogue import changes
from pilotgen.cures.friction import GripSwing
from pilotgen.errors import PilotgenError
from pilotgen.objectives import GAIN_MARGIN, OBJECTIVES, ranked_objectives
from pilotgen.runs.batch import Batch
from pilotgen.study.study import Study

BREED_POPULATION, BREED_GENERATIONS = 60, 12  # at most: the study's own search may be smaller
TOLD = ("gain_margin_db", "phase_margin_deg", "modulus_margin")
FRICTION = "friction"
SAME_FREQUENCY = 1e-3  # relative; a swing's frequency is known when its loop answers with it
MOST_FREQUENCIES = 8

Result = Mapping[str, Any]
Amounts = Mapping[str, float]


@dataclass
class NamedPilot:
    """A pilot with a name, and his result: without cures, of `worst_of` with those that it was given."""

    name: str
    values: dict[str, Any]
    before: Result


class CureEvaluator:
    """The study's pilots evaluated with cures, and what their loops lack.

    Parameters
    ----------
    study : Study
        As it is.
    batch : Batch
        Evaluates.
    swing_m : float
        Amplitude of the grip for which friction is told [m].
    """

    def __init__(self, study: Study, batch: Batch, swing_m: float) -> None:
        self.study = study
        self.batch = batch
        self.swing_m = swing_m
        self.critical_hz = math.nan  # of the worst pilot: where a notch belongs; known when he is
        self.limits = {key: limit for key, limit in study.limits.items() if limit is not None}

    def pilot(self, name: str, values: Mapping[str, Any]) -> NamedPilot:
        """A pilot without cures. PilotgenError if he cannot be evaluated."""
        (result,) = self.batch.evaluate([dict(values)])
        if result["status"] != "ok":
            raise PilotgenError(
                f"the {name} pilot cannot be evaluated ({result['stage']}: {result['reason']}); change nominal"
            )
        return NamedPilot(name, dict(values), result)

    def violation(self, result: Result) -> float:
        """Largest share by which a limit is missed; 0 or less: all are kept. Of a failed pilot 10."""
        if result["status"] != "ok":
            return 10.0
        missed = [-math.inf if result["loop"]["stable"] else 1.0]
        missed += [(limit - OBJECTIVES[key].of(result)) / abs(limit or 1.0) for key, limit in self.limits.items()]
        return max(missed)

    def with_cures(self, pilots: Sequence[Mapping[str, Any]], amounts_each: Sequence[Amounts]) -> list[dict[str, Any]]:
        """Results of pilots, each with his own amounts of cures.

        With friction among them the margins are those of swings of the grip of `swing_m`. What friction is like depends
        on the frequency too: it is asked for at the one of the gain margin that comes of it, found by repetition.
        """
        hz = [self.critical_hz] * len(pilots)
        results: list[dict[str, Any]] = [{} for _ in pilots]
        rows = list(range(len(pilots)))
        for _ in range(MOST_FREQUENCIES):
            steps = [
                {**pilots[k], **changes(self.study, amounts_each[k], self.critical_hz, GripSwing(self.swing_m, hz[k]))}
                for k in rows
            ]
            for k, result in zip(rows, self.batch.evaluate(steps), strict=True):
                results[k] = result
            rows = [
                k
                for k in rows
                if amounts_each[k].get(FRICTION)
                and results[k]["status"] == "ok"
                and abs(critical_hz(results[k]) - hz[k]) > SAME_FREQUENCY * hz[k]
            ]
            if not rows:
                break
            for k in rows:
                hz[k] = critical_hz(results[k])
        return results

    def worst_of(self, amounts: Amounts, name: str) -> NamedPilot:
        """The worst pilot of the study's box with some cures, by a search; `before` is with them.

        Raises
        ------
        PilotgenError
            No pilot of the box could be evaluated.
        """
        from pilotgen.search import Problem, run_search

        settings = dataclasses.replace(
            self.study.search,
            population=min(self.study.search.population, BREED_POPULATION),
            generations=min(self.study.search.generations, BREED_GENERATIONS),
        )
        problem = Problem.from_settings(settings)
        seen: list[tuple[float, dict[str, float], dict[str, Any]]] = []

        def evaluate(X: np.ndarray, generation: int) -> np.ndarray:
            pilots = problem.pilots(X)
            F = np.full((len(X), problem.n_obj), np.nan)
            for k, (pilot, result) in enumerate(
                zip(pilots, self.with_cures(pilots, [amounts] * len(pilots)), strict=True)
            ):
                if result["status"] == "ok":
                    F[k] = ranked_objectives(result, settings.objectives)
                    seen.append((self.violation(result), pilot, result))
            self.batch.report(milestone=False)
            return F

        run_search(problem, settings, evaluate)
        if not seen:
            raise PilotgenError("no pilot of the search box could be evaluated; widen search.variables")
        _, pilot, result = max(seen, key=lambda row: row[0])
        return NamedPilot(name, dict(pilot), result)

    def told(self, values: Mapping[str, Any], result: Result) -> dict[str, Any]:
        """A pilot in a cockpit: values, margins, whether he keeps the limits."""
        if result["status"] != "ok":
            return {
                "values": dict(values),
                "status": result["status"],
                "stage": result["stage"],
                "reason": result["reason"],
            }
        return {
            "values": dict(values),
            "status": "ok",
            "keeps_limits": self.violation(result) <= 0.0,
            **{key: column[0] for key, column in margins_of([result]).items()},
        }


def margins_of(results: Sequence[Result]) -> dict[str, list[float | None]]:
    """Margins by objective, null where there is no crossing or no result."""
    found: dict[str, list[float | None]] = {}
    for key in TOLD:
        values = [OBJECTIVES[key].of(result) if result["status"] == "ok" else math.nan for result in results]
        found[key] = [value if math.isfinite(value) else None for value in values]
    found["stable"] = [result["loop"]["stable"] if result["status"] == "ok" else None for result in results]
    return found


def gain_db(result: Result) -> float:
    """Gain margin [dB] within what can be compared; minus infinity for a failed pilot."""
    cap = GAIN_MARGIN.cap
    return float(np.clip(GAIN_MARGIN.of(result), -cap, cap)) if result["status"] == "ok" else -math.inf


def critical_hz(result: Result) -> float:
    """Where a pilot's loop has its gain margin, or comes nearest to -1 [Hz]."""
    loop = result["loop"]
    return float(loop["gain_margin_hz"] or loop["modulus_margin_hz"])
