"""One arm: its bones, muscles and joints.

Frames (docs/theory/pilot.md): torso axes x forward, y up, z right with the origin in the limb's own shoulder centre GH.
Each bone's frame has its origin at the proximal joint centre and y toward proximal; at the anatomical position x points
forward and z to the pilot's right, roughly. The left arm is the mirror image z -> -z of the right arm: points
(x, y, -z), frames S R S with S = diag(1, 1, -1). Rotation axes are axial vectors: turning by a positive angle about the
stored axis (right-hand rule) is the same anatomical motion on both sides.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np


class JointRow(NamedTuple):
    """One joint of an arm."""

    name: str  # in decks, with the side after it
    first: str  # "torso" or a segment
    second: str
    removed: int  # degrees of freedom that it takes away


# The table of an arm's bodies and joints, from the shoulder to the wrist. Decks, activations and postures loop over it.
SEGMENTS = ("humerus", "radius", "ulna", "hand")
JOINTS = (
    JointRow("shoulder", "torso", "humerus", 3),
    JointRow("humeroulnar", "humerus", "ulna", 5),
    JointRow("humeroradial", "humerus", "radius", 3),
    JointRow("radioulnar", "ulna", "radius", 2),
    JointRow("wrist", "radius", "hand", 4),
)
FREEDOMS = 6 * len(SEGMENTS)  # 24: positions and rotations of the bones
CONSTRAINTS = sum(joint.removed for joint in JOINTS)  # 17
COORDINATES = FREEDOMS - CONSTRAINTS  # 7: what an arm can do
SUFFIX = {"left": "l", "right": "r"}  # of the names of an arm's parts


@dataclass(frozen=True)
class Segment:
    """One rigid body of a limb, in its own ISB-like frame (origin at its proximal joint centre, y toward proximal)."""

    name: str  # humerus, radius, ulna, hand
    length_m: float  # GH-HU, HR-W, HU-ulnar head, W-third metacarpal head
    mass_kg: float
    com_m: np.ndarray  # (3,) centre of mass in the segment frame
    inertia_kg_m2: np.ndarray  # (3, 3) about the centre of mass, segment axes


class Muscle(NamedTuple):
    """One straight Hill bundle. Bodies are "torso" (torso axes, origin GH) or a segment; points in their axes."""

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
