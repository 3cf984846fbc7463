"""Cockpit: where seat, shoulders, collective lever and cyclic stick of one pilot are.

World axes: x forward, y up, z right; origin at the neutral seat reference point. The numbers are in
`data/cockpit.yaml`; the rules are told in `docs/theory/posture.md`.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import Any

import numpy as np

from pilotgen.anthropometry.body import Body
from pilotgen.errors import StudyError
from pilotgen.posture.kinematics import Pose
from pilotgen.study.schema import did_you_mean
from pilotgen.study.validate import check_choice, check_positive, check_within
from pilotgen.study.yaml_file import yaml_from_text

SEAT_MODES = ("design_eye", "fixed")
DEFAULT_COCKPIT = "helicopter"  # data/cockpit.yaml


@dataclass(frozen=True)
class PlacedInceptor:
    """A control in one hand: the collective lever (left) or the cyclic stick (right).

    The node of its body is at the hinge or pivot. The lever's node has x along the lever and z along the hinge axis;
    the stick's node has y along the stick, x forward and z to the right.
    """

    name: str  # "collective" | "cyclic"
    side: str  # hand that holds it
    pose: Pose  # of its node, world
    angle_deg: float  # lever above horizontal; stick axis from vertical
    length_m: float  # hinge to grip
    grip_m: np.ndarray  # (3,) grip centre in its node frame
    handle: np.ndarray  # (3, 3) handle frame in its node frame: axis 1 toward the thumb, axis 2 where the palm faces
    mass_kg: float
    inertia_kg_m2: tuple[float, float, float]  # about the node's axes, centre of mass on the hinge

    @property
    def grip_world_m(self) -> np.ndarray:
        """The grip centre in world axes (3,)."""
        return np.asarray(self.pose[0] + self.pose[1] @ self.grip_m)


@dataclass(frozen=True)
class Cockpit:
    """The cockpit around one pilot, all in world axes."""

    torso: dict[str, Pose]  # by side: gleno-humeral centre, torso axes (the torso leans on the seat back)
    inceptors: dict[str, PlacedInceptor]  # by side: left collective, right cyclic
    back_angle_deg: float
    seat_mode: str
    seat_shift_m: np.ndarray  # (2,) forward, up, from the middle of the travel
    eye_m: np.ndarray  # (2,) where the eye ends up: x, y
    eye_mismatch_m: np.ndarray  # (2,) eye minus design eye point: what the seat's travel did not reach

    def seat_report(self) -> dict[str, Any]:
        """Seat adjustment for a result file [m]: travel used, and what is left between eye and design eye point."""
        forward, up = self.seat_shift_m.tolist()
        eye_forward, eye_up = self.eye_mismatch_m.tolist()
        return {
            "mode": self.seat_mode,
            "forward_m": forward,
            "up_m": up,
            "eye_forward_of_design_eye_point_m": eye_forward,
            "eye_above_design_eye_point_m": eye_up,
        }


# What a cockpit mapping may hold: (lowest, highest, unit) of each number, so that a slip of units is noticed.
_LIMITS: Mapping[str, Mapping[str, tuple[float, float, str]]] = {
    "seat": {
        "back_angle_deg": (0.0, 40.0, "deg"),
        "vertical_travel_m": (0.0, 0.5, "m"),
        "fore_aft_travel_m": (0.0, 0.5, "m"),
        "slump_m": (0.0, 0.1, "m"),
        "eye_forward_of_back_m": (0.0, 0.5, "m"),
        "design_eye_height_m": (0.4, 1.2, "m"),
    },
    "shoulder": {
        "acromion_above_GH_m": (0.0, 0.1, "m"),
        "GH_forward_of_back_m": (0.0, 0.3, "m"),
        "GH_lateral_over_biacromial": (0.2, 0.6, ""),
    },
    "collective": {
        "grip_m": (-1.0, 1.5, "m"),
        "lowest_angle_deg": (-30.0, 90.0, "deg"),
        "highest_angle_deg": (-30.0, 90.0, "deg"),
        "mass_kg": (0.01, 20.0, "kg"),
        "inertia_kg_m2": (1e-4, 10.0, "kg m^2"),
        "axial_inertia_kg_m2": (1e-6, 10.0, "kg m^2"),
    },
    "cyclic": {
        "grip_m": (-1.0, 1.5, "m"),
        "length_m": (0.1, 1.5, "m"),
        "tilt_deg": (-45.0, 45.0, "deg"),
        "mass_kg": (0.01, 20.0, "kg"),
        "inertia_kg_m2": (1e-4, 10.0, "kg m^2"),
        "axial_inertia_kg_m2": (1e-6, 10.0, "kg m^2"),
    },
}

CockpitData = Mapping[str, Mapping[str, Any]]


@lru_cache(maxsize=1)
def _bundled() -> CockpitData:
    text = (resources.files("pilotgen") / "data" / "cockpit.yaml").read_text(encoding="utf-8")
    values: dict[str, Any] = yaml_from_text(text, "cockpit.yaml").value
    return _checked(values, "cockpit.yaml")


def cockpit_data(cockpit: str | Mapping[str, Any] | None = None) -> CockpitData:
    """The numbers of a cockpit: the bundled one, or the bundled one with the changes of a mapping of the same shape.

    Raises
    ------
    StudyError
        An unknown name or key, or a number of the wrong kind or out of its range.
    """
    if cockpit is None or isinstance(cockpit, str):
        check_choice("cockpit", cockpit or DEFAULT_COCKPIT, (DEFAULT_COCKPIT,))
        return _bundled()
    base = _bundled()
    merged = {section: dict(values) for section, values in base.items()}
    for section, changes in cockpit.items():
        _check_key("cockpit", section, base)
        if not isinstance(changes, Mapping):
            raise StudyError(f"cockpit.{section} = {changes!r} is not a mapping; keys: {', '.join(base[section])}")
        for key, value in changes.items():
            _check_key(f"cockpit.{section}", key, base[section])
            merged[section][key] = value
    return _checked(merged, "cockpit")


def check_cockpit(cockpit: str | Mapping[str, Any] | None, where: Callable[..., str]) -> None:
    """Check a study's cockpit; `where(*keys)` gives `file:line` of a key of the study, for the message.

    Raises
    ------
    StudyError
        As `cockpit_data` does, with file and line before it.
    """
    try:
        cockpit_data(cockpit)
    except StudyError as error:
        sections = cockpit.items() if isinstance(cockpit, Mapping) else ()
        keys = [(section, key) for section, values in sections if isinstance(values, Mapping) for key in values]
        message = str(error)
        told = next((pair for pair in keys if ".".join(pair) in message or repr(pair[1]) in message), ())
        raise StudyError(f"{where('cockpit', *told)}: {error}") from error


def _check_key(where: str, key: str, known: Mapping[str, Any]) -> None:
    if key not in known:
        raise StudyError(
            f"{where}: key {key!r} is not known; {did_you_mean(str(key), list(known))}known keys: {', '.join(known)}"
        )


def _checked(values: Mapping[str, Any], name: str) -> CockpitData:
    for section, limits in _LIMITS.items():
        for key, (low, high, unit) in limits.items():
            value = values[section][key]
            what = f"{name}.{section}.{key}"
            numbers = value if key == "grip_m" else [value]
            if key == "grip_m" and not (isinstance(value, list) and len(value) == 3):
                raise StudyError(f"{what} = {value!r} must be three numbers [x, y, z] in m")
            for number in numbers:
                if isinstance(number, bool) or not isinstance(number, int | float):
                    raise StudyError(f"{what} = {number!r} is not a number; {low:g} to {high:g} {unit} is wanted")
                check_within(what, float(number), low, high, unit)
    lowest, highest = (float(values["collective"][f"{k}_angle_deg"]) for k in ("lowest", "highest"))
    if lowest >= highest:
        raise StudyError(
            f"{name}.collective.lowest_angle_deg = {lowest:g} deg must be below highest_angle_deg = {highest:g} deg; "
            "swap them"
        )
    return values


def make_cockpit(
    body: Body,
    *,
    lever_length_m: float,
    position: float,
    seat: str = "design_eye",
    overrides: str | Mapping[str, Any] | None = None,
) -> Cockpit:
    """Put one pilot into the cockpit.

    Parameters
    ----------
    body : Body
        The pilot; its sitting dimensions give the eye and the shoulders, its limbs say which controls are held.
    lever_length_m : float
        Collective hinge to grip [m]. The grip at half travel stays where the cockpit has it, the hinge moves.
    position : float
        Collective from 0 (full down) to 1 (full up).
    seat : str
        "design_eye": the seat is moved, within its travel, until the eye is at the design eye point; "fixed": middle.
    overrides : str or mapping, optional
        Name of a bundled cockpit or changes to it, see `cockpit_data`.

    Raises
    ------
    StudyError
        A setting out of range.
    """
    check_positive("lever_length_m", lever_length_m, "m", "lengths are in metres: 320 mm is 0.32")
    check_within("position", position, 0.0, 1.0, hint="0 is full down, 1 is full up")
    check_choice("seat", seat, SEAT_MODES)
    data = cockpit_data(overrides)
    shift, eye, mismatch = _adjust_seat(body, data["seat"], seat)
    return Cockpit(
        torso={side: _shoulder(body, data, side, shift) for side in body.limbs},
        inceptors={
            side: (
                _collective(data["collective"], lever_length_m, position) if side == "left" else _cyclic(data["cyclic"])
            )
            for side in body.limbs
        },
        back_angle_deg=float(data["seat"]["back_angle_deg"]),
        seat_mode=seat,
        seat_shift_m=shift,
        eye_m=eye,
        eye_mismatch_m=mismatch,
    )


def _on_the_back(forward_m: float, height_m: float, back_angle_deg: float) -> np.ndarray:
    """x, y of a point `height_m` up the seat back and `forward_m` in front of it."""
    t = math.radians(back_angle_deg)
    c, s = math.cos(t), math.sin(t)
    return np.array([forward_m * c - height_m * s, height_m * c + forward_m * s])


def _adjust_seat(body: Body, seat: Mapping[str, Any], mode: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Seat shift, eye and its distance from the design eye point, each (2,) = x, y [m]."""
    angle, forward, slump = seat["back_angle_deg"], seat["eye_forward_of_back_m"], seat["slump_m"]
    design = _on_the_back(forward, seat["design_eye_height_m"] - slump, angle)
    eye = _on_the_back(forward, body.eye_height_sitting_m - slump, angle)
    shift = np.zeros(2)
    if mode == "design_eye":
        travel = np.array([seat["fore_aft_travel_m"], seat["vertical_travel_m"]])
        shift = np.clip(design - eye, -travel, travel)
    return shift, eye + shift, eye + shift - design


def _shoulder(body: Body, data: CockpitData, side: str, shift: np.ndarray) -> Pose:
    seat, shoulder = data["seat"], data["shoulder"]
    height = body.acromial_height_sitting_m - seat["slump_m"] - shoulder["acromion_above_GH_m"]
    x, y = (_on_the_back(shoulder["GH_forward_of_back_m"], height, seat["back_angle_deg"]) + shift).tolist()
    z = shoulder["GH_lateral_over_biacromial"] * body.biacromial_breadth_m
    return np.array([x, y, z if side == "right" else -z]), _about_z(seat["back_angle_deg"])


def _collective(data: Mapping[str, Any], length_m: float, position: float) -> PlacedInceptor:
    low, high = float(data["lowest_angle_deg"]), float(data["highest_angle_deg"])
    middle = math.radians(0.5 * (low + high))
    hinge = np.array(data["grip_m"]) - length_m * np.array([math.cos(middle), math.sin(middle), 0.0])
    angle = low + position * (high - low)
    J = float(data["inertia_kg_m2"])
    return PlacedInceptor(
        name="collective",
        side="left",
        pose=(hinge, _about_z(angle)),
        angle_deg=angle,
        length_m=length_m,
        grip_m=np.array([length_m, 0.0, 0.0]),
        handle=np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),  # thumb forward, palm toward the seat
        mass_kg=float(data["mass_kg"]),
        inertia_kg_m2=(float(data["axial_inertia_kg_m2"]), J, J),
    )


def _cyclic(data: Mapping[str, Any]) -> PlacedInceptor:
    length, J = float(data["length_m"]), float(data["inertia_kg_m2"])
    R = _about_z(float(data["tilt_deg"]))
    return PlacedInceptor(
        name="cyclic",
        side="right",
        pose=(np.array(data["grip_m"]) - length * R[:, 1], R),
        angle_deg=float(data["tilt_deg"]),
        length_m=length,
        grip_m=np.array([0.0, length, 0.0]),
        handle=np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]),  # thumb up, palm to the left
        mass_kg=float(data["mass_kg"]),
        inertia_kg_m2=(J, float(data["axial_inertia_kg_m2"]), J),
    )


def _about_z(angle_deg: float) -> np.ndarray:
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
