"""Torso of one pilot: bodies, and the springs between them, by mass, stature, age, body mass index and sex.

The chain from the seat upward is a table in `data/torso.yaml`, which has the sources; docs/theory/torso.md is the
account. Places are told as the table does, forward of the seat back and up along it; `posture.seated_torso` puts them
into the cockpit.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from pilotgen.anthropometry.arm import SUFFIX
from pilotgen.anthropometry.biometrics import Biometrics
from pilotgen.errors import EvaluationError
from pilotgen.study.yaml_file import bundled

SEAT = "seat"  # what the chain stands on
CARRIER = "thorax"  # what carries shoulders and muscle origins
SIDES = ("left", "right")
Six = tuple[float, float, float, float, float, float]  # fore-aft, vertical, lateral; roll, yaw, pitch


@dataclass(frozen=True)
class TorsoBody:
    """One rigid body; its node is at its centre of mass."""

    name: str
    what: str  # in words
    mass_kg: float
    gyration_m: float  # about every axis
    point: str  # of the table, or glenohumeral_l, glenohumeral_r


@dataclass(frozen=True)
class TorsoSpring:
    """One spring with a damper in all six directions, between a body nearer to the seat and one farther from it.

    Axes 1, 2, 3 are forward, up and right, turned with the seat back if it is inclined; rotations about them are roll,
    yaw and pitch. `stiffness` is in N/m and N m/rad, `damping` in N s/m and N m s/rad.
    """

    name: str
    first: str  # body, or seat
    second: str
    point: str
    inclined: bool
    stiffness: Six
    damping: Six
    carries: bool = True  # the weight of what is above it


@dataclass(frozen=True)
class Torso:
    """The torso of one pilot.

    Attributes
    ----------
    bodies : tuple of TorsoBody
        From the seat upward.
    springs : tuple of TorsoSpring
        Every spring that carries has another `second` body.
    carried_arms : dict
        Mass [kg] of an arm that is not in the deck, by side: a point on the thorax at its shoulder.
    carriers : dict
        By side of the arms in the deck: the body that carries the shoulder.
    resonance_hz : float
        Of the seated body, as the trends with age and body mass index have it.
    """

    bodies: tuple[TorsoBody, ...]
    springs: tuple[TorsoSpring, ...]
    carried_arms: dict[str, float]
    carriers: dict[str, str]
    resonance_hz: float


def make_torso(
    biometrics: Biometrics, limbs: tuple[str, ...], numbers: Mapping[str, Any], seat: Mapping[str, Any]
) -> Torso:
    """Make the torso of one pilot.

    Parameters
    ----------
    biometrics : Biometrics
        Age, stature, mass and sex.
    limbs : tuple of str
        Sides of the arms that are in the deck; the others are point masses on the thorax.
    numbers : mapping
        Of the study's `pilot.torso`: trends, springs, girdle (`study.torso_numbers`).
    seat : mapping
        Of the cockpit's `seat`: `cushion` (None: a rigid pan) and `back`.

    Raises
    ------
    EvaluationError
        Stage "torso": the resonance that age and body mass index ask for is outside what the trends allow.
    """
    table = _table()
    reference, scaling = table["reference"], table["scaling"]
    resonance_hz = _resonance_hz(biometrics, numbers, table)
    rho = resonance_hz / scaling["resonance_hz"]
    size = biometrics.mass_kg / reference["mass_kg"]
    long = biometrics.stature_m / reference["stature_m"]
    fractions = {**table["mass_fractions"][biometrics.sex], "body": 1.0}

    def mass_kg(parts: Mapping[str, float]) -> float:
        return float(biometrics.mass_kg * sum(share * fractions[part] for part, share in parts.items()))

    cushion = seat["cushion"]
    bodies = {
        name: TorsoBody(name, row["what"], mass_kg(row["mass"]), row["gyration_m"] * long, row["point"])
        for name, row in table["bodies"].items()
        if name != "pan" or cushion is not None
    }
    own = {  # springs of the person, scaled with him
        name: _scaled(_six(numbers[name], table), size * rho**2, size * rho, long**2)
        for name in table["springs"]
        if name in numbers and name != "viscera"
    }
    own["viscera"] = _viscera(numbers["viscera"], bodies["viscera"].mass_kg, rho, table)
    own["back"] = _back(seat["back"], table)
    if cushion is not None:
        own["cushion"] = _cushion(cushion, table)
    springs = []
    for name, row in table["springs"].items():
        if name == "cushion" and cushion is None:
            continue
        first = SEAT if row["first"] == "pan" and cushion is None else row["first"]
        stiffness, damping = own[name]
        inclined = row["axes"] == "back"
        springs.append(
            TorsoSpring(name, first, row["second"], row["at"], inclined, stiffness, damping, carries=name != "back")
        )
    carriers = dict.fromkeys(limbs, CARRIER)
    if numbers["girdle"] is not None:
        _add_girdles(bodies, springs, carriers, numbers["girdle"], size)
    return Torso(
        bodies=tuple(bodies.values()),
        springs=tuple(springs),
        carried_arms={side: mass_kg(table["carried_arm"]["mass"]) for side in SIDES if side not in limbs},
        carriers=carriers,
        resonance_hz=resonance_hz,
    )


@cache
def _table() -> dict[str, Any]:
    table: dict[str, Any] = bundled("torso").value
    return table


def torso_points() -> tuple[dict[str, tuple[float, float]], float]:
    """Points of the table, (forward of the back, up along it) [m], and the shoulder's height they are meant for [m]."""
    table = _table()
    return {name: (float(x), float(y)) for name, (x, y) in table["points"].items()}, float(table["shoulder_up_m"])


def upper_trunk_share(sex: str) -> float:
    """Part of the thorax that is upper trunk; the rest is middle trunk."""
    table = _table()
    fractions, thorax = table["mass_fractions"][sex], table["bodies"][CARRIER]["mass"]
    whole = sum(share * fractions[part] for part, share in thorax.items())
    return float(thorax["upper_trunk"] * fractions["upper_trunk"] / whole)


def _resonance_hz(biometrics: Biometrics, numbers: Mapping[str, Any], table: Mapping[str, Any]) -> float:
    reference, scaling = table["reference"], table["scaling"]
    hz = float(scaling["resonance_hz"])
    if numbers["age_trend"]:
        age = scaling["age"]
        hz += age["change_hz"] / age["span_years"] * (biometrics.age_years - reference["age_years"])
    if numbers["bmi_trend"]:
        bmi = scaling["bmi"]
        hz += bmi["change_hz"] / bmi["span_kg_per_m2"] * (biometrics.bmi - reference["bmi"])
    low, high = scaling["lowest_hz"], scaling["highest_hz"]
    if not low <= hz <= high:
        raise EvaluationError(
            "torso",
            f"at {biometrics.age_years:.4g} years and BMI {biometrics.bmi:.4g} the seated body's resonance would be "
            f"{hz:.2f} Hz by the trends, outside {low:g} to {high:g} Hz; switch pilot.torso.age_trend or bmi_trend off",
        )
    return hz


# ---- six directions from the numbers of a study ----------------------------------------------------------------------

_Pair = tuple[Six, Six]  # stiffness, damping


def _six(row: Mapping[str, float], table: Mapping[str, Any]) -> _Pair:
    """Stiffness and damping in six directions from three in the sagittal plane, in the order of the row."""
    values = list(row.values())
    return _whole(values[0], values[1], values[2], "n_m_per_rad", table), _whole(
        values[3], values[4], values[5], "n_m_s_per_rad", table
    )


def _whole(fore_aft: float, vertical: float, pitch: float, unit: str, table: Mapping[str, Any]) -> Six:
    other = table["out_of_plane"]
    turn = pitch if pitch > 0.0 else other[f"instead_{unit}"]
    return fore_aft, vertical, fore_aft, other["roll_over_pitch"] * turn, other["yaw_over_pitch"] * turn, pitch


def _scaled(pair: _Pair, of_stiffness: float, of_damping: float, of_rotation: float) -> _Pair:
    def scaled(six: Six, by: float) -> Six:
        x, y, z, roll, yaw, pitch = six
        turn = by * of_rotation
        return by * x, by * y, by * z, turn * roll, turn * yaw, turn * pitch

    return scaled(pair[0], of_stiffness), scaled(pair[1], of_damping)


def _viscera(row: Mapping[str, float], mass_kg: float, rho: float, table: Mapping[str, Any]) -> _Pair:
    vertical = mass_kg * (2.0 * math.pi * row["vertical_hz"] * rho) ** 2
    damper = 2.0 * row["damping_ratio"] * math.sqrt(vertical * mass_kg)
    fore_aft = row["fore_aft_stiffness_ratio"] * vertical
    stiffness = _whole(fore_aft, vertical, row["pitch_n_m_per_rad"], "n_m_per_rad", table)
    return stiffness, _whole(damper, damper, row["pitch_n_m_s_per_rad"], "n_m_s_per_rad", table)


def _cushion(row: Mapping[str, float], table: Mapping[str, Any]) -> _Pair:
    shares = table["cushion_shares"]

    def six(vertical: float, unit: str) -> Six:
        return _whole(shares["fore_aft"] * vertical, vertical, shares["pitch_m2"] * vertical, unit, table)

    return six(row["stiffness_n_per_m"], "n_m_per_rad"), six(row["damping_n_s_per_m"], "n_m_s_per_rad")


def _back(row: Mapping[str, float], table: Mapping[str, Any]) -> _Pair:
    stiffness = _whole(row["normal_n_per_m"], row["tangential_n_per_m"], 0.0, "n_m_per_rad", table)
    return stiffness, _whole(row["normal_n_s_per_m"], row["tangential_n_s_per_m"], 0.0, "n_m_s_per_rad", table)


def _add_girdles(
    bodies: dict[str, TorsoBody],
    springs: list[TorsoSpring],
    carriers: dict[str, str],
    row: Mapping[str, float],
    size: float,
) -> None:
    """Clavicle and scapula of each arm in the deck as a body of its own, its mass taken from the thorax."""
    thorax = bodies[CARRIER]
    mass = row["mass_kg"] * size
    k, c = row["stiffness_n_per_m"] * size, row["damping_n_s_per_m"] * size
    k_turn, c_turn = row["rotation_n_m_per_rad"] * size, row["rotation_n_m_s_per_rad"] * size
    for side in carriers:
        name, point = f"girdle_{SUFFIX[side]}", f"glenohumeral_{SUFFIX[side]}"
        bodies[name] = TorsoBody(
            name, f"{side} clavicle and scapula; carries shoulder and muscle origins", mass, row["gyration_m"], point
        )
        springs.append(
            TorsoSpring(
                name, CARRIER, name, point, False, (k, k, k, k_turn, k_turn, k_turn), (c, c, c, c_turn, c_turn, c_turn)
            )
        )
        carriers[side] = name
    left_kg = thorax.mass_kg - mass * len(carriers)
    bodies[CARRIER] = TorsoBody(thorax.name, thorax.what, left_kg, thorax.gyration_m, thorax.point)
