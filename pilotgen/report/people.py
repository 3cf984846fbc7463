"""The pilots of a page as numbers: columns, terms of their feedthrough, plants, skeletons, decks.

What comes out is the JSON of the page (`docs/report.md`); everything that a view shows of a pilot is in here or follows
from it by arithmetic.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pilotgen.errors import PilotgenError
from pilotgen.evaluation import PILOT_DECK, Evaluation
from pilotgen.figures.study import plane_of
from pilotgen.figures.style import quantity
from pilotgen.linear.feedthrough import mayo_pilot
from pilotgen.linear.statespace import series
from pilotgen.loop.rotorcraft_model import Chained, measured_part, rotorcraft_model
from pilotgen.objectives import OBJECTIVES, Quantile
from pilotgen.posture.posture import ANGLE_NAMES
from pilotgen.report.packing import embedded, pack_short, pack_text, pack_wide
from pilotgen.report.skeleton import skeleton_of
from pilotgen.runs.results import Row, StudyResults, columns_of
from pilotgen.study.loop_section import COLLECTIVE
from pilotgen.study.schema import MAYO_PRESETS
from pilotgen.study.study import Study

SKELETON_BYTES = 1_100_000  # of skeletons in a page, beyond which no more are taken
SPLINE_POINTS = 2_000  # of a measured rotorcraft; a file may have a million
PLANT_NUMBERS = 60_000  # of rotorcraft that differ from pilot to pilot
DECKS = 6  # whose text is in the page
NOT_A_NUMBER = None
_WIDE = ("variable", "objective", "frequency")  # roles of columns that keep every digit

# Columns beside variables and objectives, where they were computed: label, unit, decimals
_DERIVED: Mapping[str, tuple[str, str, int]] = {
    "age_years": ("age", "years", 0),
    "stature_m": ("stature", "m", 3),
    "mass_kg": ("body mass", "kg", 1),
    "bmi": ("body mass index", "kg/m²", 1),
    "delay_margin_s": ("delay margin", "s", 3),
    "pilot_frequency_hz": ("frequency of the dominant mode", "Hz", 2),
    "pilot_damping": ("damping of the dominant mode", "", 3),
    "grip_motion_3hz_mm_per_m_s2": ("grip motion at 3 Hz", "mm per m/s²", 2),
    "grip_motion_3hz_mm_per_rad_s2": ("grip motion at 3 Hz", "mm per rad/s²", 2),
    "largest_activation": ("largest activation", "", 3),
    "certificate": ("certificate of the feedthrough", "", 12),
    **{name: (label, "deg", 1) for name, label in ANGLE_NAMES.items()},
}


@dataclass(frozen=True)
class Known:
    """A pilot who was evaluated again for the page."""

    index: int  # in study.h5; the number of its evaluations for the nominal pilot
    evaluation: Evaluation
    deck: str = ""  # where his deck lies, as seen from the page; empty if nowhere


@dataclass
class _Again:
    """What is kept of the pilots who were evaluated again: their matrices are too large to hold."""

    terms: dict[int, Any] = field(default_factory=dict)
    structure: dict[str, Any] | None = None
    skeletons: dict[str, Any] = field(default_factory=dict)
    decks: list[dict[str, Any]] = field(default_factory=list)


def _gather(known: Iterable[Known]) -> _Again:
    """Take pilots, in order of importance, while there is room for their skeletons."""
    kept = _Again()
    size = texts = 0
    for one in known:
        if one.index in kept.terms:
            continue
        kept.terms[one.index] = one.evaluation.result["bdft"].get("terms")
        solved, skeleton = one.evaluation.solved, skeleton_of(one.evaluation)
        if solved is None or skeleton is None:
            continue
        if one.deck or texts < DECKS:
            text = pack_text(solved.deck) if texts < DECKS else ""
            texts += bool(text)
            kept.decks.append({"index": one.index, "path": one.deck, "name": PILOT_DECK, "text": text})
        structure = skeleton.structure()
        kept.structure = kept.structure or structure
        if structure != kept.structure:
            continue
        packed = skeleton.packed()
        size += sum(len(value) for value in packed.values() if isinstance(value, str))
        if size > SKELETON_BYTES and kept.skeletons:
            break
        kept.skeletons[str(one.index)] = {**packed, "joints": one.evaluation.result["posture"]}
    return kept


def page_data(
    study: Study,
    results: StudyResults,
    order: np.ndarray,
    front: np.ndarray,
    rows: Sequence[Mapping[str, Any]] | None,
    nominal: Evaluation | None,
    known: Iterable[Known],
    study_file: str,
    solver: str = "mbdae",
) -> dict[str, Any]:
    """The numbers of a page.

    Parameters
    ----------
    study : Study
        The study.
    results : StudyResults
        Its evaluations.
    order, front : ndarray of int
        Indices of the evaluated pilots, worst first, shape (evaluated,); of the front, shape (members,).
    rows : sequence of mapping, optional
        Result objects of all evaluations, for the terms of their feedthrough.
    nominal : Evaluation, optional
        The nominal pilot: one more, after the evaluations.
    known : iterable of Known
        Pilots evaluated again, the most important first: they get skeletons while there is room.
    study_file, solver : str
        For the command line of each pilot.
    """
    count = len(results.columns["status"])
    columns = _with_nominal(study, results, nominal)
    own = [Known(count, nominal)] if nominal is not None else []
    again = _gather(itertools.chain(own, known))
    terms: list[Mapping[str, Any] | None] = [None] * len(columns["status"])
    for k, row in enumerate(rows or ()):
        terms[k] = row.get("bdft", {}).get("terms")
    for k, found in again.terms.items():
        terms[k] = found
    return {
        "study": {"name": study.name, "rotorcraft": study.rotorcraft.name, "model": study.pilot.model},
        "kind": str(results.attributes.get("kind", "search")),
        "count": count,
        "columns": _columns(study, results, columns),
        "stable": [int(value) for value in columns["stable"]],
        "sex": sorted({str(value) for value in columns["sex"] if value}) if "sex" in columns else [],
        "variables": list(results.names),
        "objectives": [row.key for row in OBJECTIVES.values()],
        "plane": _plane(results),
        "order": order.tolist(),
        "front": front.tolist(),
        "fair": (results.members[0] if len(results.members) else np.arange(count)).tolist(),
        "nominal": count if nominal is not None else NOT_A_NUMBER,
        "terms": _packed_terms(terms),
        "plants": _plants(study, results, len(terms)),
        "loop": {"motion": study.loop.input, "per": "rad/s²" if study.loop.rotates else "m/s²"},
        "references": _references(study),
        "skeletons": {"structure": again.structure, "each": again.skeletons} if again.structure else NOT_A_NUMBER,
        "decks": again.decks,
        "command": {"study": study_file, "solver": solver, "more": []},
    }


def script_text(data: Mapping[str, Any]) -> str:
    """The text of the page's element that holds its numbers."""
    return embedded(data)


def _with_nominal(study: Study, results: StudyResults, nominal: Evaluation | None) -> dict[str, np.ndarray]:
    """Columns of study.h5, and the nominal pilot after them."""
    if nominal is None:
        return dict(results.columns)
    own = {name: float(nominal.values.get(name, _standing(study, name))) for name in results.names}
    objectives = np.full((1, results.columns["objectives"].shape[1]), np.nan)
    more = columns_of([Row(0, 0, own, nominal.result)], results.names, objectives, None)
    more |= {row.key: np.array([np.nan]) for row in results.searched_quantiles}  # nobody draws the nominal pilot
    return {
        name: np.concatenate([column, more[name]])
        for name, column in results.columns.items()
        if name in more and column.ndim == more[name].ndim and column.shape[1:] == more[name].shape[1:]
    }


def _standing(study: Study, name: str) -> float:
    value = study.value(name)
    return math.nan if value is None else float(value)


def _columns(study: Study, results: StudyResults, columns: Mapping[str, np.ndarray]) -> list[dict[str, Any]]:
    """What can be plotted, sorted and filtered: label, unit, decimals, role and the packed numbers."""
    found: list[dict[str, Any]] = []

    def add(key: str, label: str, unit: str, digits: int, role: str, values: np.ndarray, **more: Any) -> None:
        found.append(
            {"key": key, "label": label, "unit": unit, "digits": digits, "role": role, **more,
             "wide": role in _WIDE, "data": pack_wide(values) if role in _WIDE else pack_short(values)}
        )  # fmt: skip

    for j, name in enumerate(results.names):
        told = quantity(name)
        box = [float(results.lower[j]), float(results.upper[j])]
        digits = _DERIVED[name][2] if name in _DERIVED else 4
        add(name, told.name, told.unit, digits, "variable", columns["inputs"][:, j], box=box)
    robust = results.searched_quantiles
    for one in robust:
        limit = study.limits.get(one.base)
        values = columns[one.key]
        add(_robust_key(one), one.label, one.unit, one.digits, "objective", values, limit=limit, worse=one.worse)
    for row in OBJECTIVES.values():
        if row.key not in columns:
            continue
        limit = study.limits.get(row.key)
        label = f"{row.label}, nominal" if robust else row.label
        add(row.key, label, row.unit, row.digits, "objective", columns[row.key], limit=limit, worse=row.worse)
        if row.at and row.at in columns:
            add(row.at, f"frequency of the {row.label}", "Hz", 2, "frequency", columns[row.at])
    for name, (label, unit, digits) in _DERIVED.items():
        if name not in results.names and name in columns and np.isfinite(columns[name]).any():
            add(name, label, unit, digits, "derived", columns[name])
    return found


def _plane(results: StudyResults) -> list[str] | None:
    """The two columns that the page is about where a search was robust; None: gain and phase margin."""
    keys = {row.key: _robust_key(row) for row in results.searched_quantiles}
    return [keys.get(key, key) for key in plane_of(results)] if keys else None


def _robust_key(row: Quantile) -> str:
    """Of a column of the page, which its filter can name: `gain_margin_db_5`."""
    return f"{row.base}_{100.0 * row.share:g}"


def _packed_terms(terms: Sequence[Mapping[str, Any] | None]) -> dict[str, Any]:
    """Terms of all pilots one after the other: counts per pilot (0: none), then pole and residue, real and imaginary.

    A real pole has two numbers, a pair four: of each pilot the pairs come first.
    """
    counts: list[list[int]] = []
    numbers: list[float] = []
    common: dict[str, Any] = {"direct": {}, "tilt": {}, "integrators": 0}
    for k, one in enumerate(terms):
        if one is None:
            counts.append([0, 0])
            continue
        both = list(zip(one["poles_rad_s"], one["residues"], strict=True))
        pairs = [(pole, residue) for pole, residue in both if pole[1] != 0.0]
        real = [(pole, residue) for pole, residue in both if pole[1] == 0.0]
        counts.append([len(pairs), len(real)])
        numbers += [value for pole, residue in pairs for value in (*pole, *residue)]
        numbers += [value for pole, residue in real for value in (pole[0], residue[0])]
        if one["direct"]:
            common["direct"][str(k)] = one["direct"]
        if "tilt" in one:
            common["tilt"][str(k)] = one["tilt"]
        common["integrators"] = one["integrators"]
    return {"counts": [value for pair in counts for value in pair], "data": pack_short(numbers), **common}


def _plants(study: Study, results: StudyResults, count: int) -> dict[str, Any]:
    """Rotorcraft of the pilots: one for all, or one each where the study varies it; `of` numbers them by pilot."""
    varied = [name for name in results.names if name.startswith(("rotorcraft.", "inceptor.", "pilot.washout"))]
    own = _plant(study)
    if not varied:
        return {"each": [own], "of": None}
    each, of, numbers = [own], [0] * count, 0
    for k in range(len(results.columns["status"])):
        values = dict(zip(results.names, results.columns["inputs"][k].tolist(), strict=True))
        try:
            plant = _plant(study.with_values({name: values[name] for name in varied})[0])
        except PilotgenError:  # a corner of the box without a rotorcraft: its pilots failed
            of[k] = -1
            continue
        numbers += len(plant["A"]) * (len(plant["A"]) + 2)
        of[k] = len(each) if numbers <= PLANT_NUMBERS else -1
        if of[k] >= 0:
            each.append(plant)
    return {"each": each, "of": of}


def _plant(study: Study) -> dict[str, Any]:
    """Blade pitch to the seat's acceleration: a state space, a measured response behind it, and an exact delay."""
    ends = study.loop
    model = rotorcraft_model(study.rotorcraft, ends.input, ends.output)
    delay_s, system, measured = 0.0, None, measured_part(model)
    if isinstance(model, Chained):  # the page has its delay exactly, not as a rational function
        delay_s, system = model.delay_s, model.parts
        model = model.base
    if measured is None:
        system = model.state_space if system is None else series(system, model.state_space)
    inceptor = study.inceptor
    length = inceptor.lever_length_m if ends.output == COLLECTIVE else float(study.cockpit["cyclic"]["length_m"])
    plant: dict[str, Any] = {
        "A": [], "B": [], "C": [], "D": 1.0, "spline": None,
        "delay_s": delay_s, "gain": -inceptor.gearing_rad_per_m * length,
        "lever_length_m": length, "washout_rad_s": study.pilot.washout_rad_s,
    }  # fmt: skip
    if system is not None:
        plant |= {name: getattr(system, name).tolist() for name in "ABC"} | {"D": float(system.D)}
    if measured is not None:
        edges, pieces = measured.thinned(SPLINE_POINTS).pieces
        plant["spline"] = {"ends": edges.tolist(), "pieces": pieces.ravel().tolist()}
    return plant


def _references(study: Study) -> list[dict[str, Any]]:
    """Mayo's two pilots at the same lever; nobody where the loop is not heave by the collective."""
    found: list[dict[str, Any]] = []
    if not study.loop.usual:
        return found
    for name, values in MAYO_PRESETS.items():
        model = mayo_pilot(
            values["pilot_frequency_hz"], values["pilot_damping"], values["pilot_time_constant_s"],
            lever_length_m=study.inceptor.lever_length_m, washout_rad_s=study.pilot.washout_rad_s,
        )  # fmt: skip
        found.append({"name": f"Mayo, {name}", "terms": model.terms()})
    return found
