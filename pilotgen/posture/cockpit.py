"""Cockpit: where seat, shoulders, collective lever and cyclic stick of one pilot are.

World axes: x forward, y up, z right; origin at the neutral seat reference point. The numbers are in
`data/cockpit.yaml`; the rules are told in `docs/theory/posture.md`.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pilotgen.anthropometry.body import Body
from pilotgen.posture.kinematics import Pose
from pilotgen.study.cockpit_numbers import CockpitNumbers, cockpit_numbers
from pilotgen.study.schema import SCHEMA


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
    inertia_kg_m2: tuple[float, float, float]  # about the node's axes, through the hinge
    damping_n_m_s_per_rad: float = 0.0  # viscous damper about the hinge
    stiffness_n_m_per_rad: float = 0.0  # trim spring about the hinge, relaxed in this position
    unbalance_kg_m: float = 0.0  # mass times distance of its centre from the hinge, toward the grip

    @property
    def fitted(self) -> bool:
        """Whether a damper, a spring or a balance spring acts about the hinge."""
        return bool(self.damping_n_m_s_per_rad or self.stiffness_n_m_per_rad or self.unbalance_kg_m)

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


def make_cockpit(
    body: Body,
    *,
    lever_length_m: float,
    position: float,
    seat: str = "design_eye",
    numbers: CockpitNumbers | None = None,
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
    numbers : mapping, optional
        Of the cockpit, all of them (`cockpit_numbers`); the bundled ones if not given.

    Raises
    ------
    StudyError
        A setting out of range.
    """
    SCHEMA["inceptor.lever_length_m"].check(f"lever_length_m = {lever_length_m:g}", lever_length_m)
    SCHEMA["inceptor.position"].check(f"position = {position:g}", position)
    SCHEMA["pilot.seat"].check(f"seat = {seat!r}", seat)
    data = cockpit_numbers() if numbers is None else numbers
    shift, mismatch = _adjust_seat(body, data["seat"], seat)
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
        eye_mismatch_m=mismatch,
    )


def _on_the_back(forward_m: float, height_m: float, back_angle_deg: float) -> np.ndarray:
    """x, y of a point `height_m` up the seat back and `forward_m` in front of it."""
    t = math.radians(back_angle_deg)
    c, s = math.cos(t), math.sin(t)
    return np.array([forward_m * c - height_m * s, height_m * c + forward_m * s])


def _adjust_seat(body: Body, seat: Mapping[str, Any], mode: str) -> tuple[np.ndarray, np.ndarray]:
    """Seat shift, and the eye's distance from the design eye point, each (2,) = x, y [m]."""
    angle, forward, slump = seat["back_angle_deg"], seat["eye_forward_of_back_m"], seat["slump_m"]
    design = _on_the_back(forward, seat["design_eye_height_m"] - slump, angle)
    eye = _on_the_back(forward, body.eye_height_sitting_m - slump, angle)
    shift = np.zeros(2)
    if mode == "design_eye":
        travel = np.array([seat["fore_aft_travel_m"], seat["vertical_travel_m"]])
        shift = np.clip(design - eye, -travel, travel)
    return shift, eye + shift - design


def _shoulder(body: Body, data: CockpitNumbers, side: str, shift: np.ndarray) -> Pose:
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
        damping_n_m_s_per_rad=float(data["damping_n_m_s_per_rad"]),
        stiffness_n_m_per_rad=float(data["stiffness_n_m_per_rad"]),
        unbalance_kg_m=float(data["unbalance_kg_m"]),
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
