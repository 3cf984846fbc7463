"""One arm: its bones, muscles and joints, and where they are at given joint angles.

Frames (docs/theory/pilot.md): torso axes x forward, y up, z right with the origin in the limb's own shoulder centre GH.
Each bone's frame has its origin at the proximal joint centre and y toward proximal; at the anatomical position x points
forward and z to the pilot's right, roughly. The left arm is the mirror image z -> -z of the right arm: points (x, y, -z),
frames S R S with S = diag(1, 1, -1). Rotation axes are axial vectors: turning by a positive angle about the stored axis
(right-hand rule) is the same anatomical motion on both sides.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

SEGMENTS = ("humerus", "radius", "ulna", "hand")
PRONATION_AT_ANATOMICAL_DEG = -90.0  # palm forward is 90 deg of supination from neutral (thumb up at a bent elbow)


@dataclass(frozen=True)
class Segment:
    """One rigid body of a limb, in its own ISB-like frame (origin at its proximal joint centre, y toward proximal)."""

    name: str  # humerus, radius, ulna, hand
    length_m: float  # GH-HU, HR-W, HU-ulnar head, W-third metacarpal head
    mass_kg: float
    com_m: np.ndarray  # (3,) centre of mass in the segment frame
    inertia_kg_m2: np.ndarray  # (3, 3) about the centre of mass, segment axes


@dataclass(frozen=True)
class Muscle:
    """One straight Hill bundle. Bodies are "torso" (GH-centred torso axes) or a segment name; points in their frames."""

    name: str
    full_name: str
    origin_body: str
    origin_m: np.ndarray  # (3,)
    insertion_body: str
    insertion_m: np.ndarray  # (3,)
    F0_N: float  # peak isometric force
    l0_m: float  # optimal bundle length
    V0_m_per_s: float  # maximum shortening velocity


@dataclass(frozen=True)
class Limb:
    """One arm. Everything is already mirrored for the left side (z -> -z)."""

    side: str  # "left" | "right"
    segments: dict[str, Segment]
    muscles: tuple[Muscle, ...]
    # joint geometry, each point/axis in the frame of the segment named last [m]
    HU_in_humerus: np.ndarray  # humero-ulnar hinge centre (the ulna's origin)
    HR_in_humerus: np.ndarray  # humero-radial sphere centre (the radius' origin)
    elbow_axis_in_humerus: np.ndarray  # unit vectors; the tilts make the carrying angle
    elbow_axis_in_ulna: np.ndarray
    UH_in_radius: np.ndarray  # point of the radius that slides along the ulna's y axis
    W_in_radius: np.ndarray  # wrist centre (the hand's origin)
    wrist_flexion_axis_in_radius: np.ndarray  # cardano axis 3 (fixed in the radius)
    wrist_deviation_axis_in_hand: np.ndarray  # cardano axis 2 (fixed in the hand)
    grip_in_hand: np.ndarray  # grip centre
    # anatomical pose (arm hanging, palm forward) in torso axes: segment -> origin (3,), axes (3, 3) columns
    anatomical_origin_m: dict[str, np.ndarray]
    anatomical_axes: dict[str, np.ndarray]


@dataclass(frozen=True)
class JointAngles:
    """The seven angles of an arm [deg], the same on both sides.

    The humerus turns from the anatomical position by internal rotation about the torso's vertical, then abduction about
    the torso's forward axis, then flexion about the torso's lateral axis; axial rotation is thus about the hanging
    humerus. Elbow flexion is zero where the bones' x axes are parallel (full extension); pronation is zero at neutral
    and -90 at the anatomical position, about the line from ulnar head to radial head; the wrist flexes about an axis
    fixed in the radius, then deviates about the hand's x axis. All are zero at the anatomical position but pronation.
    """

    shoulder_flexion: float = 0.0  # + forward
    shoulder_abduction: float = 0.0  # + away from the trunk
    shoulder_internal_rotation: float = 0.0  # + toward the trunk
    elbow_flexion: float = 0.0
    pronation: float = PRONATION_AT_ANATOMICAL_DEG
    wrist_flexion: float = 0.0  # + palmar
    wrist_ulnar_deviation: float = 0.0


def limb_pose(limb: Limb, angles: JointAngles) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Place the bones of an arm at given joint angles; the closed forearm chain is satisfied exactly.

    Parameters
    ----------
    limb : Limb
        Only its joint geometry and anatomical position are used.
    angles : JointAngles
        Joint angles [deg].

    Returns
    -------
    origins : dict[str, (3,) ndarray]
        Origin of each segment from the shoulder centre, torso axes [m].
    axes : dict[str, (3, 3) ndarray]
        Axes of each segment as columns, torso axes.
    """
    mirror = 1.0 if limb.side == "right" else -1.0
    neutral = limb.anatomical_axes
    shoulder = (
        _rotation((0.0, 0.0, 1.0), angles.shoulder_flexion)
        @ _rotation((1.0, 0.0, 0.0), -mirror * angles.shoulder_abduction)
        @ _rotation((0.0, 1.0, 0.0), mirror * angles.shoulder_internal_rotation)
    )
    humerus = shoulder @ neutral["humerus"]
    # The forearm of the anatomical position, turned with the humerus and about the elbow axis.
    elbow = shoulder @ _rotation(neutral["humerus"] @ limb.elbow_axis_in_humerus, angles.elbow_flexion)
    ulna = elbow @ neutral["ulna"]
    hinge = humerus @ limb.HU_in_humerus
    radial_head = humerus @ limb.HR_in_humerus
    forearm_axis = _forearm_axis(limb)  # in the radius: ulnar head to radial head, both fixed in radius and ulna
    turn = _rotation(forearm_axis, angles.pronation - PRONATION_AT_ANATOMICAL_DEG)
    radius = elbow @ neutral["radius"] @ turn
    wrist = _rotation(limb.wrist_flexion_axis_in_radius, angles.wrist_flexion)
    hand = radius @ wrist @ (neutral["radius"].T @ neutral["hand"])
    hand = hand @ _rotation(limb.wrist_deviation_axis_in_hand, angles.wrist_ulnar_deviation)
    origins = {
        "humerus": np.zeros(3),
        "radius": radial_head,
        "ulna": hinge,
        "hand": radial_head + radius @ limb.W_in_radius,
    }
    return origins, {"humerus": humerus, "radius": radius, "ulna": ulna, "hand": hand}


def joint_angles(limb: Limb, axes: dict[str, np.ndarray]) -> JointAngles:
    """Read the joint angles from the bones' orientations; the inverse of `limb_pose`.

    Parameters
    ----------
    limb : Limb
        The arm that the orientations belong to.
    axes : dict[str, (3, 3) ndarray]
        Axes of humerus, radius, ulna and hand as columns, torso axes.

    Returns
    -------
    JointAngles
        Shoulder abduction within +-90 deg, pronation within -270 to 90 deg, the others within +-180 deg.
    """
    mirror = 1.0 if limb.side == "right" else -1.0
    neutral = limb.anatomical_axes
    m = axes["humerus"] @ neutral["humerus"].T  # Rz(flexion) Rx(-abduction) Ry(rotation), right side
    elbow = (axes["humerus"].T @ axes["ulna"]) @ (neutral["humerus"].T @ neutral["ulna"]).T
    forearm = (neutral["ulna"].T @ neutral["radius"]).T @ (axes["ulna"].T @ axes["radius"])
    wrist = (neutral["radius"].T @ neutral["hand"]).T @ (axes["radius"].T @ axes["hand"])  # Rz(flexion) Rx(deviation)
    return JointAngles(
        shoulder_flexion=math.degrees(math.atan2(-m[0, 1], m[1, 1])),
        shoulder_abduction=-mirror * math.degrees(math.asin(min(1.0, max(-1.0, m[2, 1])))),
        shoulder_internal_rotation=mirror * math.degrees(math.atan2(-m[2, 0], m[2, 2])),
        elbow_flexion=_angle_about(elbow, limb.elbow_axis_in_humerus),
        pronation=_angle_about(forearm, _forearm_axis(limb)) + PRONATION_AT_ANATOMICAL_DEG,
        wrist_flexion=math.degrees(math.atan2(wrist[1, 0], wrist[0, 0])),
        wrist_ulnar_deviation=mirror * math.degrees(math.atan2(wrist[2, 1], wrist[2, 2])),
    )


def muscle_lengths(limb: Limb, origins: dict[str, np.ndarray], axes: dict[str, np.ndarray]) -> np.ndarray:
    """Return the length [m] of each muscle, in the order of `limb.muscles`, for the bones where `limb_pose` put them."""

    def placed(body: str, point: np.ndarray) -> np.ndarray:
        return point if body == "torso" else origins[body] + axes[body] @ point

    ends = [placed(m.insertion_body, m.insertion_m) - placed(m.origin_body, m.origin_m) for m in limb.muscles]
    return np.asarray(np.sqrt(np.sum(np.array(ends) ** 2, axis=1)))


def _forearm_axis(limb: Limb) -> np.ndarray:
    # Axial: on the left the mirrored vector points from radial to ulnar head, so that pronation stays positive.
    axis: np.ndarray = limb.UH_in_radius / (-math.sqrt(limb.UH_in_radius @ limb.UH_in_radius))
    return axis if limb.side == "right" else -axis


def _rotation(axis: tuple[float, float, float] | np.ndarray, angle_deg: float) -> np.ndarray:
    x, y, z = (float(component) for component in axis)
    angle = math.radians(angle_deg)
    s, c = math.sin(angle), math.cos(angle)
    t = 1.0 - c
    return np.array(
        [
            [c + t * x * x, t * x * y - s * z, t * x * z + s * y],
            [t * x * y + s * z, c + t * y * y, t * y * z - s * x],
            [t * x * z - s * y, t * y * z + s * x, c + t * z * z],
        ]
    )


def _angle_about(rotation: np.ndarray, axis: np.ndarray) -> float:
    r = rotation
    sine = 0.5 * float(axis @ np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]))
    return math.degrees(math.atan2(sine, 0.5 * (float(np.trace(r)) - 1.0)))
