"""Rows of the schema for what the pilot sits in and on: torso, seat, controls.

A part of the table in `pilotgen/study/schema.py`, where the rules of rows stand.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Mapping

from pilotgen.study.fields import (
    MULTIBODY,
    Choice,
    Field,
    Number,
    Section,
    Truth,
    Vector,
)

_POINT = "position from the neutral seat reference point: x forward, y up, z right"
_MASS, _INERTIA, _AXIAL = (0.01, 20.0, "kg"), (1e-4, 10.0, "kg m^2"), (1e-6, 10.0, "kg m^2")

# Springs of a torso: positive stiffness, no negative damping, so that every K is definite and every C semidefinite.
_STIFFNESS, _DAMPING = (100.0, 1e8, "N/m"), (0.0, 1e6, "N s/m")
_SLIDE = (0.0, 1e8, "N/m")
_TURN, _TURN_DAMPER = (0.1, 1e6, "N m/rad"), (0.0, 1e5, "N m s/rad")


def _spring(path: str, first: str, second: str, meaning: str) -> dict[str, Field]:
    """Rows of a spring with dampers in two directions and in pitch."""
    return {
        path: Section(default=None, meaning=meaning),
        f"{path}.{first}_n_per_m": Number(*_STIFFNESS, default=None, meaning="stiffness"),
        f"{path}.{second}_n_per_m": Number(*_STIFFNESS, default=None, meaning="stiffness"),
        f"{path}.pitch_n_m_per_rad": Number(*_TURN, default=None, meaning="pitch stiffness"),
        f"{path}.{first}_n_s_per_m": Number(*_DAMPING, default=None, meaning="damping"),
        f"{path}.{second}_n_s_per_m": Number(*_DAMPING, default=None, meaning="damping"),
        f"{path}.pitch_n_m_s_per_rad": Number(*_TURN_DAMPER, default=None, meaning="pitch damping"),
    }


SEATED_ROWS: Mapping[str, Field] = {
    # ---- torso: what a missing key stands for is in pilotgen/data/torso.yaml; numbers are of its reference person
    "pilot.torso": Section(
        default=None, model=MULTIBODY, meaning="what is between seat and shoulders ([theory](../theory/torso.md))"
    ),
    "pilot.torso.model": Choice(
        ("lumped", "modes", "rigid"),
        default=None,
        meaning="rigid bodies on springs, modes of a spine of 17 levels, or one body with the seat",
    ),
    "pilot.torso.modes_up_to_hz": Number(
        5.0, 1000.0, "Hz", default=None, meaning="with `modes`: all modes of the held spine up to here are kept"
    ),
    "pilot.torso.age_trend": Truth(default=None, meaning="whether the seated body's resonance rises with age"),
    "pilot.torso.bmi_trend": Truth(default=None, meaning="whether it falls with body mass index"),
    **_spring("pilot.torso.buttocks", "fore_aft", "vertical", "buttocks, between pan or seat and pelvis"),
    **_spring("pilot.torso.lumbar", "shear", "axial", "lumbar spine, between pelvis and thorax, along the seat back"),
    **_spring("pilot.torso.neck", "fore_aft", "vertical", "neck, between thorax and head"),
    "pilot.torso.viscera": Section(default=None, meaning="viscera, hung in the pelvis"),
    "pilot.torso.viscera.vertical_hz": Number(1.0, 20.0, "Hz", default=None, meaning="natural frequency, vertical"),
    "pilot.torso.viscera.damping_ratio": Number(0.0, 2.0, "", default=None, meaning="its damping ratio"),
    "pilot.torso.viscera.fore_aft_stiffness_ratio": Number(
        0.1, 10.0, "", default=None, meaning="fore-aft stiffness over vertical stiffness"
    ),
    "pilot.torso.viscera.pitch_n_m_per_rad": Number(*_TURN, default=None, meaning="pitch stiffness, not scaled"),
    "pilot.torso.viscera.pitch_n_m_s_per_rad": Number(*_TURN_DAMPER, default=None, meaning="pitch damping, not scaled"),
    "pilot.torso.girdle": Section(
        default=None,
        null=True,
        words=lambda: ("none",),
        meaning="clavicle and scapula of each arm as a body of their own, or none",
    ),
    "pilot.torso.girdle.stiffness_n_per_m": Number(*_STIFFNESS, default=None, meaning="in every direction"),
    "pilot.torso.girdle.damping_n_s_per_m": Number(*_DAMPING, default=None, meaning="in every direction"),
    "pilot.torso.girdle.rotation_n_m_per_rad": Number(*_TURN, default=None, meaning="about every axis"),
    "pilot.torso.girdle.rotation_n_m_s_per_rad": Number(*_TURN_DAMPER, default=None, meaning="about every axis"),
    "pilot.torso.girdle.mass_kg": Number(0.1, 10.0, "kg", default=None, meaning="of one side, taken from the thorax"),
    # ---- cockpit: what a missing key stands for is in pilotgen/data/cockpit.yaml
    "cockpit": Section(
        default=None,
        null=True,
        words=lambda: ("helicopter",),
        model=MULTIBODY,
        meaning="another cockpit than the bundled one, or values that differ from it",
    ),
    "cockpit.seat": Section(default=None, meaning="seat, and where the eyes are on it"),
    "cockpit.seat.back_angle_deg": Number(0.0, 40.0, "deg", default=None, meaning="back from vertical"),
    "cockpit.seat.vertical_travel_m": Number(
        0.0, 0.5, "m", default=None, meaning="of the seat, either way from the middle"
    ),
    "cockpit.seat.fore_aft_travel_m": Number(0.0, 0.5, "m", default=None, meaning="the same fore and aft"),
    "cockpit.seat.slump_m": Number(
        0.0, 0.1, "m", default=None, meaning="a relaxed pilot is so much lower than the erect subject of a survey"
    ),
    "cockpit.seat.eye_forward_of_back_m": Number(0.0, 0.5, "m", default=None, meaning="eye in front of the back plane"),
    "cockpit.seat.design_eye_height_m": Number(
        0.4,
        1.2,
        "m",
        default=None,
        meaning="eye height above the pan, along the back, for which the cockpit was laid out",
    ),
    "cockpit.seat.cushion": Section(
        default=None,
        null=True,
        words=lambda: ("none",),
        meaning="cushion under the pan, or none for a rigid pan; for a torso that is not rigid",
    ),
    "cockpit.seat.cushion.stiffness_n_per_m": Number(
        *_STIFFNESS, default=None, meaning="vertical; fore and aft half of it"
    ),
    "cockpit.seat.cushion.damping_n_s_per_m": Number(*_DAMPING, default=None, meaning="vertical; fore and aft half"),
    "cockpit.seat.back": Section(default=None, meaning="back cushion and harness, for a torso that is not rigid"),
    "cockpit.seat.back.normal_n_per_m": Number(*_STIFFNESS, default=None, meaning="across the back"),
    "cockpit.seat.back.tangential_n_per_m": Number(
        *_SLIDE, default=None, meaning="along the back: friction, clothing, belts; 0 for a back that slides"
    ),
    "cockpit.seat.back.normal_n_s_per_m": Number(*_DAMPING, default=None, meaning="damping across the back"),
    "cockpit.seat.back.tangential_n_s_per_m": Number(*_DAMPING, default=None, meaning="damping along the back"),
    "cockpit.shoulder": Section(default=None, meaning="where the shoulder joints are"),
    "cockpit.shoulder.acromion_above_GH_m": Number(
        0.0, 0.1, "m", default=None, meaning="shoulder point above the shoulder joint's centre"
    ),
    "cockpit.shoulder.GH_forward_of_back_m": Number(
        0.0, 0.3, "m", default=None, meaning="shoulder joint's centre in front of the back plane"
    ),
    "cockpit.shoulder.GH_lateral_over_biacromial": Number(
        0.2, 0.6, "", default=None, meaning="its distance from the mid-plane over the biacromial breadth"
    ),
    "cockpit.collective": Section(default=None, meaning="the collective lever, `lever` for short"),
    "cockpit.collective.grip_m": Vector(
        3, -1.0, 1.5, "m", default=None, hint=_POINT, meaning="grip at half travel, three numbers"
    ),
    "cockpit.collective.lowest_angle_deg": Number(
        -30.0, 90.0, "deg", default=None, meaning="lever above horizontal, full down"
    ),
    "cockpit.collective.highest_angle_deg": Number(-30.0, 90.0, "deg", default=None, meaning="full up"),
    "cockpit.collective.mass_kg": Number(*_MASS, default=None, meaning="of the lever, balanced about its hinge"),
    "cockpit.collective.inertia_kg_m2": Number(*_INERTIA, default=None, meaning="about the hinge"),
    "cockpit.collective.axial_inertia_kg_m2": Number(*_AXIAL, default=None, meaning="about the lever's own axis"),
    "cockpit.collective.damping_n_m_s_per_rad": Number(
        0.0, 1000.0, "N m s/rad", default=None, meaning="viscous damper about the hinge"
    ),
    "cockpit.collective.stiffness_n_m_per_rad": Number(
        0.0, 1e4, "N m/rad", default=None, meaning="trim spring about the hinge, relaxed where the lever is held"
    ),
    "cockpit.collective.unbalance_kg_m": Number(
        -2.0,
        2.0,
        "kg m",
        default=None,
        meaning="mass times distance from hinge toward grip, its weight carried by a spring",
    ),
    "cockpit.cyclic": Section(default=None, meaning="the cyclic stick"),
    "cockpit.cyclic.grip_m": Vector(
        3, -1.0, 1.5, "m", default=None, hint=_POINT, meaning="grip in the middle of the travel, three numbers"
    ),
    "cockpit.cyclic.length_m": Number(0.1, 1.5, "m", default=None, meaning="pivot to grip"),
    "cockpit.cyclic.tilt_deg": Number(
        -45.0, 45.0, "deg", default=None, meaning="stick from vertical, top rearward positive"
    ),
    "cockpit.cyclic.mass_kg": Number(*_MASS, default=None, meaning="of the stick, balanced about its pivot"),
    "cockpit.cyclic.inertia_kg_m2": Number(*_INERTIA, default=None, meaning="about both axes of the pivot"),
    "cockpit.cyclic.axial_inertia_kg_m2": Number(*_AXIAL, default=None, meaning="about the stick's own axis"),
}
