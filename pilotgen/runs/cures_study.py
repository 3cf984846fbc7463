"""What cures bounce: every cure alone, the cheapest combination, worst pilots bred anew for it.

Leaves cures.json (docs/io_formats/cures.md) and cured.yaml, the study with the proposed cockpit.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pilotgen.cures.catalogue import Cure, changes, cures_for, price
from pilotgen.cures.optimum import Optimum, cheapest
from pilotgen.errors import PilotgenError
from pilotgen.files import to_json, write_text
from pilotgen.objectives import GAIN_MARGIN, OBJECTIVES, ranked_objectives
from pilotgen.population.shares import Share
from pilotgen.runs.batch import Batch, OnProgress, Progress
from pilotgen.runs.options import RunOptions
from pilotgen.runs.session import Say, open_batch, provenance
from pilotgen.study.schema import SCHEMA
from pilotgen.study.study import Study
from pilotgen.summary import caveats

KIND = "cures"
RESULT_NAME, STUDY_NAME = "cures.json", "cured.yaml"
FILETYPE, VERSION = "pilotgen cures", 1
CURVE_POINTS = 9  # amounts of a cure alone
MAP_POINTS = 20  # along each side of a map
ROUNDS = 6  # of proposal and worst pilots bred for it
BREED_POPULATION, BREED_GENERATIONS = 60, 12  # at most: the study's own search may be smaller
KICK_N, KICK_DURATION_S = 10.0, 4.0  # on the grip, in the verification
TOLD = ("gain_margin_db", "phase_margin_deg", "modulus_margin")
TASKS = ("position", "force", "relax")
TELLING_DB = 0.05  # a cure that buys less is told as buying nothing

Result = Mapping[str, Any]


@dataclass(frozen=True)
class CuresRun:
    """Cures at their end: what cures.json holds, and what was done."""

    content: dict[str, Any]
    progress: Progress


@dataclass
class _Patient:
    """A pilot whose loop is to be cured, and how it is without cures."""

    name: str
    values: dict[str, Any]
    before: Result


def cures_study(
    study: Study,
    directory: Path,
    only: tuple[str, ...] = (),
    without: tuple[str, ...] = (),
    people: int = 0,
    simulate: bool = True,
    options: RunOptions | None = None,
    on_progress: OnProgress | None = None,
    say: Say | None = None,
) -> CuresRun:
    """Look for what brings the worst pilots of a study to its limits; leaves cures.json and cured.yaml.

    Parameters
    ----------
    study, directory, options, on_progress, say
        As of `search_study`.
    only, without : tuple of str
        Keys of cures: these alone, or all but these.
    people : int
        Of the study's population, before and after; 0 for none.
    simulate : bool
        Kick the last worst pilot in time, with and without the cure.

    Raises
    ------
    StudyError
        A cure that is none or means nothing here, or a study without limits or population.
    PilotgenError
        The nominal pilot cannot be evaluated, or nobody of the search box can.
    FileError, TooManyFailures
        As `search_study`.
    """
    options = options or RunOptions()
    cures = cures_for(study, only, without)
    crowd = _people(study, people)
    progress = Progress()
    with open_batch(study, directory, KIND, options, BREED_POPULATION, on_progress, progress, say) as batch:
        clinic = _Clinic(study, batch)
        nominal = clinic.patient("nominal", {})
        worst = clinic.worst_of({}, "worst")
        critical_hz = _critical_hz(worst.before)
        batch.report(milestone=True)
        alone = [_alone(clinic, cure, (worst, nominal), critical_hz) for cure in cures]
        alone.sort(key=lambda found: -found["best"]["worst"]["bought"])
        batch.report(milestone=True)
        remedies = [cure for cure in cures if cure.remedy]
        maps = _maps(clinic, remedies, alone, worst, critical_hz)
        batch.report(milestone=True)
        proposal, optimum = _proposal(clinic, remedies, worst, nominal, critical_hz)
        content: dict[str, Any] = {
            "filetype": FILETYPE,
            "version": VERSION,
            "sentence": "",
            "limits": {key: limit for key, limit in study.limits.items() if limit is not None},
            "critical_hz": critical_hz,
            "pilots": {p.name: _told(p.values, p.before, clinic) for p in (worst, nominal)},
            "cures": alone,
            "tasks": _tasks(clinic, (worst, nominal)),
            "maps": maps,
            "proposal": proposal,
            "population": _before_and_after(clinic, crowd, proposal["changes"]),
            "caveats": caveats(study, worst.before),
            **provenance(study, KIND, batch, study.search.seed, "all points", options.mbdae),
        }
    content["simulation"] = _simulated(study, proposal, options) if simulate else None
    content["sentence"] = sentence(content, optimum)
    write_text(directory / RESULT_NAME, to_json(content))
    write_text(directory / STUDY_NAME, _cured(study, proposal["changes"]).text)
    return CuresRun(content, progress)


class _Clinic:
    """The study's pilots evaluated with changes, and what their loops lack."""

    def __init__(self, study: Study, batch: Batch) -> None:
        self.study = study
        self.batch = batch
        self.limits = {key: limit for key, limit in study.limits.items() if limit is not None}

    def patient(self, name: str, values: Mapping[str, Any]) -> _Patient:
        """A pilot without cures. PilotgenError if he cannot be evaluated."""
        (result,) = self.batch.evaluate([dict(values)])
        if result["status"] != "ok":
            raise PilotgenError(
                f"the {name} pilot cannot be evaluated ({result['stage']}: {result['reason']}); change nominal"
            )
        return _Patient(name, dict(values), result)

    def violation(self, result: Result) -> float:
        """Largest share by which a limit is missed; 0 or less: all are kept. Of a failed pilot 10."""
        if result["status"] != "ok":
            return 10.0
        missed = [-math.inf if result["loop"]["stable"] else 1.0]
        missed += [(limit - OBJECTIVES[key].of(result)) / abs(limit or 1.0) for key, limit in self.limits.items()]
        return max(missed)

    def evaluate(self, pilots: Sequence[Mapping[str, Any]], change: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Pilots in a changed cockpit."""
        return self.batch.evaluate([{**pilot, **change} for pilot in pilots])

    def worst_of(self, change: Mapping[str, Any], name: str) -> _Patient:
        """The worst pilot of the study's box in a changed cockpit, by a search; `before` is of that cockpit."""
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
            for k, (pilot, result) in enumerate(zip(pilots, self.evaluate(pilots, change), strict=True)):
                if result["status"] == "ok":
                    F[k] = ranked_objectives(result, settings.objectives)
                    seen.append((self.violation(result), pilot, result))
            self.batch.report(milestone=False)
            return F

        run_search(problem, settings, evaluate)
        if not seen:
            raise PilotgenError("no pilot of the search box could be evaluated; widen search.variables")
        _, pilot, result = max(seen, key=lambda row: row[0])
        return _Patient(name, dict(pilot), result)


# ---- each cure alone


def _alone(clinic: _Clinic, cure: Cure, patients: Sequence[_Patient], critical_hz: float) -> dict[str, Any]:
    """Margins of the patients over the amounts of one cure, and what going all the way buys."""
    amounts = np.linspace(cure.low, cure.high, CURVE_POINTS)
    if cure.low < 0.0 < cure.high:
        amounts = np.unique(np.append(amounts, 0.0))
    steps = [changes(clinic.study, {cure.key: float(x)}, critical_hz) for x in amounts]
    found: dict[str, Any] = {
        "key": cure.key,
        "label": cure.label,
        "unit": cure.unit,
        "practicable": [cure.low, cure.high],
        "cost": cure.cost,
        "remedy": cure.remedy,
        "source": cure.source,
        "amounts": amounts.tolist(),
        "margins": {},
        "best": {},
    }
    for patient in patients:
        results = clinic.batch.evaluate([{**patient.values, **step} for step in steps])
        found["margins"][patient.name] = _margins(results)
        score = [-clinic.violation(result) for result in results]
        k = int(np.argmax(score))
        bought = _gain_db(results[k]) - _gain_db(patient.before)
        found["best"][patient.name] = {
            "amount": float(amounts[k]),
            "bought": bought if math.isfinite(bought) else 0.0,
            "sentence": _what_it_buys(clinic.study, cure, float(amounts[k]), bought, patient.name),
        }
    return found


def _gain_db(result: Result) -> float:
    cap = GAIN_MARGIN.cap
    return float(np.clip(GAIN_MARGIN.of(result), -cap, cap)) if result["status"] == "ok" else -math.inf


def _what_it_buys(study: Study, cure: Cure, amount: float, bought: float, who: str) -> str:
    """`viscous damper on the lever, 20 N s/m at the grip: buys 4.3 dB for the worst pilot and costs ...`."""
    if amount == 0.0 or bought < TELLING_DB:
        return f"{cure.label}: buys nothing for the {who} pilot within {cure.low:g} to {cure.high:g} {cure.unit}"
    costs = price(study, cure, amount) if cure.remedy else ""
    return f"{cure.told(amount)}: buys {bought:.1f} dB for the {who} pilot" + (f" and costs {costs}" if costs else "")


def _margins(results: Sequence[Result]) -> dict[str, list[float | None]]:
    """Margins by objective, null where there is no crossing or no result."""
    found: dict[str, list[float | None]] = {}
    for key in TOLD:
        values = [OBJECTIVES[key].of(result) if result["status"] == "ok" else math.nan for result in results]
        found[key] = [value if math.isfinite(value) else None for value in values]
    found["stable"] = [result["loop"]["stable"] if result["status"] == "ok" else None for result in results]
    return found


def _tasks(clinic: _Clinic, patients: Sequence[_Patient]) -> dict[str, Any]:
    """What the pilot's task makes of the margins: no cure, but advice to pilots."""
    if clinic.study.pilot.model != "multibody":
        return {}
    return {
        patient.name: {task: _margins(clinic.evaluate([patient.values], {"pilot.task": task})) for task in TASKS}
        for patient in patients
    }


# ---- maps


def _maps(
    clinic: _Clinic, remedies: Sequence[Cure], alone: Sequence[Mapping[str, Any]], worst: _Patient, critical_hz: float
) -> list[dict[str, Any]]:
    """Margins of the worst pilot over the two cures that buy most, point by point."""
    known = {cure.key: cure for cure in remedies}
    ranked = [known[row["key"]] for row in alone if row["key"] in known]
    if len(ranked) < 2:
        return []
    one, two = ranked[:2]
    x, y = (np.linspace(cure.low, cure.high, MAP_POINTS) for cure in (one, two))
    points = [{one.key: float(a), two.key: float(b)} for b, a in itertools.product(y, x)]
    steps = [{**worst.values, **changes(clinic.study, point, critical_hz)} for point in points]
    margins = _margins(clinic.batch.evaluate(steps))
    return [
        {
            "pilot": worst.name,
            "x": {"key": one.key, "label": one.label, "unit": one.unit, "amounts": x.tolist()},
            "y": {"key": two.key, "label": two.label, "unit": two.unit, "amounts": y.tolist()},
            "margins": {
                key: [values[k : k + len(x)] for k in range(0, len(values), len(x))] for key, values in margins.items()
            },
        }
    ]


# ---- the cheapest combination


def _proposal(
    clinic: _Clinic, remedies: Sequence[Cure], worst: _Patient, nominal: _Patient, critical_hz: float
) -> tuple[dict[str, Any], Optimum]:
    """The cheapest combination for the worst pilots; those bred for the cured cockpit join them until none misses."""
    patients = [worst, nominal]
    rounds: list[dict[str, Any]] = []
    while True:

        def violation(amounts: np.ndarray) -> np.ndarray:
            steps = [changes(clinic.study, _named(remedies, row), critical_hz) for row in amounts]
            flat = clinic.batch.evaluate([{**patient.values, **step} for step in steps for patient in patients])
            clinic.batch.report(milestone=False)
            missed = np.array([clinic.violation(result) for result in flat]).reshape(len(steps), len(patients))
            return np.asarray(missed.max(axis=1), dtype=float)

        if clinic.limits and max(clinic.violation(p.before) for p in patients) > 0.0:
            optimum = cheapest(remedies, violation, clinic.study.search.seed)
        else:
            optimum = Optimum(np.zeros(len(remedies)), 0.0, max(clinic.violation(p.before) for p in patients))
        amounts = _named(remedies, optimum.amounts)
        change = changes(clinic.study, amounts, critical_hz)
        bred = clinic.worst_of(change, f"worst of round {len(rounds) + 1}")
        missed = clinic.violation(bred.before)
        rounds.append(
            {
                "amounts": amounts,
                "cost": optimum.cost,
                "worst": _told(bred.values, bred.before, clinic),
                "missed_by": missed if math.isfinite(missed) else None,
            }
        )
        clinic.batch.report(milestone=True)
        if missed <= 0.0 or not optimum.reached or len(rounds) == ROUNDS:
            break
        (uncured,) = clinic.batch.evaluate([bred.values])
        patients.append(_Patient(bred.name, bred.values, uncured))
    after = clinic.evaluate([patient.values for patient in patients], change)
    proposal = {
        "reached": optimum.reached and missed <= 0.0,
        "amounts": amounts,
        "cost": optimum.cost,
        "changes": change,
        "cures": [
            {
                "key": cure.key,
                "text": cure.told(amounts[cure.key]),
                "price": price(clinic.study, cure, amounts[cure.key]),
            }
            for cure in remedies
            if amounts.get(cure.key)
        ],
        "pilots": [
            {"name": p.name, "before": _told(p.values, p.before, clinic), "after": _told(p.values, now, clinic)}
            for p, now in zip(patients, after, strict=True)
        ],
        "rounds": rounds,
    }
    return proposal, optimum


def _named(cures: Sequence[Cure], amounts: np.ndarray) -> dict[str, float]:
    return {cure.key: float(x) for cure, x in zip(cures, amounts, strict=True) if x != 0.0}


def _critical_hz(result: Result) -> float:
    """Where the worst pilot's loop has its gain margin, or comes nearest to -1."""
    loop = result["loop"]
    return float(loop["gain_margin_hz"] or loop["modulus_margin_hz"])


def _told(values: Mapping[str, Any], result: Result, clinic: _Clinic) -> dict[str, Any]:
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
        "keeps_limits": clinic.violation(result) <= 0.0,
        **{key: column[0] for key, column in _margins([result]).items()},
    }


# ---- people


def _people(study: Study, number: int) -> list[dict[str, Any]]:
    if number == 0:
        return []
    from pilotgen.population.population import population_of

    return list(itertools.islice(population_of(study).people(study.search.seed), number))


def _before_and_after(clinic: _Clinic, people: Sequence[Mapping[str, Any]], change: Mapping[str, Any]) -> Any:
    """Shares of people who miss a limit, in the cockpit as it is and in the proposed one."""
    if not people:
        return None
    found: dict[str, Any] = {"people": len(people)}
    for when, step in (("before", {}), ("after", change)):
        results = [result for result in clinic.evaluate(people, step) if result["status"] == "ok"]
        missed = Share(sum(clinic.violation(result) > 0.0 for result in results), len(results))
        found[when] = {"evaluated": len(results), "missing_a_limit": missed.as_dict()}
    return found


# ---- verification in time


def _simulated(study: Study, proposal: Mapping[str, Any], options: RunOptions) -> dict[str, Any]:
    """The worst pilot of the proposal kicked in time, in the cockpit as it is and in the cured one; or why he is not.

    The nonlinear deck moves here (stops, clipped activations, friction), which shares with the margins the deck's
    elements and nothing of linearisation, modes or Nyquist curve. Growth and frequency are fitted to the motion and
    held against the poles of the closed deck.
    """
    from pilotgen.closed_loop.deck import check_study, close_in_deck
    from pilotgen.closed_loop.simulate import check_kick, kicked
    from pilotgen.evaluation import EvaluationContext

    worst = min(proposal["pilots"], key=lambda row: _gain_told(row["before"]))
    found: dict[str, Any] = {"pilot": worst["name"], "kick_n": KICK_N, "duration_s": KICK_DURATION_S}
    try:
        check_study(study)
        for when, change in (("before", {}), ("after", proposal["changes"])):
            values = {**worst["before"]["values"], **change}
            with EvaluationContext(study, mbdae=options.mbdae) as context:
                loop = close_in_deck(context, values)
                check_kick(loop, "lever", KICK_N)
                _, content = kicked(context, loop, "lever", KICK_N, KICK_DURATION_S)
            found[when] = {key: content[key] for key in ("largest_grip_travel_mm", "swing_at_the_end_mm", "fit")}
    except PilotgenError as error:
        return {**found, "reason": str(error)}
    return found


def _gain_told(told: Mapping[str, Any]) -> float:
    gain = told.get("gain_margin_db")
    return GAIN_MARGIN.cap if gain is None else float(gain)


# ---- what is said


def sentence(content: Mapping[str, Any], optimum: Optimum) -> str:
    """The plain first sentence."""
    proposal = content["proposal"]
    limits = " and ".join(f"{OBJECTIVES[key].text(limit)}" for key, limit in content["limits"].items())
    if not content["limits"]:
        return "The study has no limits, so there is nothing to bring pilots to."
    if not proposal["amounts"] and proposal["reached"]:
        return f"Nothing needs to be cured: the worst pilot keeps {limits}."
    told = "; ".join(f"{row['text']} ({row['price']})" if row["price"] else row["text"] for row in proposal["cures"])
    if proposal["reached"]:
        return f"The cheapest cure that brings every pilot of the search box to {limits}: {told}."
    if optimum.reached:
        return f"Within {ROUNDS} rounds worse pilots were found for every cure; the last, short of {limits}: {told}."
    return f"No combination within what is practicable brings the worst pilot to {limits}; what comes nearest: {told}."


def _cured(study: Study, change: Mapping[str, Any]) -> Study:
    """The study with the proposed cockpit, as a file of its own."""
    named = {path: value for path, value in change.items() if path in SCHEMA or "[" in path}
    return study.with_values(named)[0].with_own_text() if named else study.with_own_text()
