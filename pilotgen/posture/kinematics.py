"""Pure geometry of one arm: forward kinematics in seven joint coordinates, joint angles of given poses, muscle lengths.

Everything is computed for a right arm. A left arm is its mirror image in the sagittal plane (z -> -z): points p become
S p, orientations R become S R S with S = diag(1, 1, -1), and the joint angles have the same names and signs.

The seven coordinates of `JOINT_COORDINATES` are, in order [rad]:

- shoulder_x, shoulder_y, shoulder_z: rotation vector of the humerus from its anatomical orientation, torso axes
  (x adduction, y internal rotation, z flexion, each when the two others are small);
- elbow: flexion from the anatomical position, about the humero-ulnar hinge axis;
- forearm: pronation from mid position (anatomical position = 90 deg of supination, -pi/2);
- wrist_flexion, wrist_deviation: palmar flexion and ulnar deviation from the anatomical position.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pilotgen.anthropometry.arm import COORDINATES, SEGMENTS, Limb

JOINT_COORDINATES = (
    "shoulder_x",
    "shoulder_y",
    "shoulder_z",
    "elbow",
    "forearm",
    "wrist_flexion",
    "wrist_deviation",
)
MIRROR = np.array([1.0, 1.0, -1.0])
_MIRROR_OUTER = np.outer(MIRROR, MIRROR)
_EYE = np.eye(3)

Pose = tuple[np.ndarray, np.ndarray]
"""Position (3,) [m] and orientation (3, 3) (columns = body axes), in one common frame."""


def mirror_pose(pose: Pose) -> Pose:
    """The mirror image of a pose in the plane z = 0."""
    return pose[0] * MIRROR, pose[1] * _MIRROR_OUTER


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a x b of two 3-vectors (numpy's general version costs ten times more). Shapes (3,)."""
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def rotation(theta: np.ndarray) -> np.ndarray:
    """exp(theta x): the rotation matrix of a rotation vector [rad] (Rodrigues).

    `theta` has shape (3,), the matrix shape (3, 3).
    """
    x, y, z = theta.tolist()
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    if angle < 1e-6:  # the next terms are beyond round-off
        s, t = 1.0 - square / 6.0, 0.5
    else:
        s, t = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
    c = 1.0 - t * square
    return np.array(
        [
            [c + t * x * x, t * x * y - s * z, t * x * z + s * y],
            [t * x * y + s * z, c + t * y * y, t * y * z - s * x],
            [t * x * z - s * y, t * y * z + s * x, c + t * z * z],
        ]
    )


def rotation_vector(R: np.ndarray) -> np.ndarray:
    """log R: rotation vector [rad], |theta| < pi. At exactly half a turn the axis is taken from the symmetric part.

    `R` has shape (3, 3), the vector shape (3,).
    """
    w = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) * 0.5
    sine = math.sqrt(float(w @ w))
    cosine = 0.5 * (float(R[0, 0] + R[1, 1] + R[2, 2]) - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > 1e-7:
        return np.asarray(w * (angle / sine))
    if cosine > 0.0:
        return w
    column = int(np.argmax(np.diag(R)))
    axis = 0.5 * (R + _EYE)[:, column]
    return np.asarray(axis * (angle / math.sqrt(float(axis @ axis))))


def rotation_vector_rate(theta: np.ndarray) -> np.ndarray:
    """Gamma(theta)^-1: d theta = Gamma^-1 d phi, d phi = rotation in the axes of the first body.

    `theta` has shape (3,), the matrix shape (3, 3).
    """
    x, y, z = theta.tolist()
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    t = 1.0 / 12.0 if angle < 1e-4 else (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / square
    c = 1.0 - t * square
    return np.array(
        [
            [c + t * x * x, t * x * y + 0.5 * z, t * x * z - 0.5 * y],
            [t * x * y - 0.5 * z, c + t * y * y, t * y * z + 0.5 * x],
            [t * x * z + 0.5 * y, t * y * z - 0.5 * x, c + t * z * z],
        ]
    )


def frame(axis: np.ndarray, index: int, guess: np.ndarray, guess_index: int) -> np.ndarray:
    """Orientation from two vectors, as MBDyn reads `index, axis, guess_index, guess` (indices from 1; columns = axes).

    `axis` and `guess` have shape (3,), the orientation shape (3, 3).

    Axis `index` is `axis`; the axis that is named by neither index completes the triad; axis `guess_index` is then
    made orthogonal to both.
    """
    i, j = index - 1, guess_index - 1
    k = 3 - i - j
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    ax, ay, az = axis.tolist()
    norm = math.sqrt(ax * ax + ay * ay + az * az)
    ax, ay, az = ax / norm, ay / norm, az / norm
    gx, gy, gz = guess.tolist()
    tx, ty, tz = ay * gz - az * gy, az * gx - ax * gz, ax * gy - ay * gx
    norm = sign * math.sqrt(tx * tx + ty * ty + tz * tz)
    tx, ty, tz = tx / norm, ty / norm, tz / norm
    result = np.empty((3, 3))
    result[:, i] = ax, ay, az
    result[:, k] = tx, ty, tz
    result[:, j] = sign * (ty * az - tz * ay), sign * (tz * ax - tx * az), sign * (tx * ay - ty * ax)
    return result


def _about_y(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _about_z(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class ArmGeometry:
    """Joint geometry of one arm, seen as a right arm. Points [m] and hinge frames in the frames of their segments."""

    side: str
    HU: np.ndarray  # in the humerus
    HR: np.ndarray  # in the humerus
    UH: np.ndarray  # in the radius
    W: np.ndarray  # in the radius
    grip: np.ndarray  # in the hand
    humerus_anatomical: np.ndarray  # orientation in torso axes
    elbow_on_humerus: np.ndarray  # hinge frame, axis 3 = flexion axis
    elbow_on_ulna: np.ndarray
    elbow_anatomical: float  # angle of the hinge frames in the anatomical pose [rad]
    forearm_on_radius: np.ndarray  # axis 3 = UH to HR
    forearm_anatomical: float
    wrist_on_radius: np.ndarray  # axis 3 = flexion axis, axis 2 = deviation axis in the anatomical pose
    wrist_on_hand: np.ndarray  # axis 2 = deviation axis


def _mirrored_orientation(R: np.ndarray, left: bool) -> np.ndarray:
    return R * _MIRROR_OUTER if left else R


def _toward(axis: np.ndarray, direction: int) -> np.ndarray:
    """The axis with the sign that makes its component `direction` positive."""
    return axis if axis[direction] > 0.0 else -axis


_recent: list[tuple[Limb, ArmGeometry]] = []
_RECENT = 4  # limbs whose geometry is remembered: every stage of one pilot asks for it


def arm_geometry(limb: Limb) -> ArmGeometry:
    """The geometry of one limb as a right arm."""
    for known, geometry in _recent:
        if known is limb:
            return geometry
    geometry = _arm_geometry(limb)
    _recent.insert(0, (limb, geometry))
    del _recent[_RECENT:]
    return geometry


def _arm_geometry(limb: Limb) -> ArmGeometry:
    left = limb.side == "left"
    mirror = MIRROR if left else np.ones(3)
    HR, UH = limb.HR_in_humerus * mirror, limb.UH_in_radius * mirror
    axes = {name: _mirrored_orientation(limb.anatomical_axes[name], left) for name in SEGMENTS}
    elbow_on_humerus = frame(_toward(limb.elbow_axis_in_humerus * mirror, 2), 3, _EYE[0], 1)
    elbow_on_ulna = frame(_toward(limb.elbow_axis_in_ulna * mirror, 2), 3, _EYE[0], 1)
    wrist_on_hand = frame(_toward(limb.wrist_deviation_axis_in_hand * mirror, 0), 2, _EYE[2], 3)
    hand_in_radius = axes["radius"].T @ axes["hand"]
    wrist_on_radius = frame(
        _toward(limb.wrist_flexion_axis_in_radius * mirror, 2), 3, hand_in_radius @ wrist_on_hand[:, 1], 2
    )
    forearm_on_radius = frame(-UH, 3, _EYE[2], 1)
    elbow = elbow_on_humerus.T @ axes["humerus"].T @ axes["ulna"] @ elbow_on_ulna
    forearm = frame(axes["radius"] @ forearm_on_radius[:, 2], 3, axes["ulna"] @ elbow_on_ulna[:, 2], 1)
    forearm = forearm.T @ axes["radius"] @ forearm_on_radius
    return ArmGeometry(
        side=limb.side,
        HU=limb.HU_in_humerus * mirror,
        HR=HR,
        UH=UH,
        W=limb.W_in_radius * mirror,
        grip=limb.grip_in_hand * mirror,
        humerus_anatomical=axes["humerus"],
        elbow_on_humerus=elbow_on_humerus,
        elbow_on_ulna=elbow_on_ulna,
        elbow_anatomical=math.atan2(elbow[1, 0], elbow[0, 0]),
        forearm_on_radius=forearm_on_radius,
        forearm_anatomical=math.atan2(forearm[1, 0], forearm[0, 0]),
        wrist_on_radius=wrist_on_radius,
        wrist_on_hand=wrist_on_hand,
    )


@dataclass(frozen=True)
class ArmPose:
    """A right arm in space: poses of the segments, the grip point, and the axes of the seven coordinates.

    `axes` (3, 7) holds the angular velocity of the hand per unit rate of each coordinate (for the shoulder: about the
    three torso axes), `arms` (3, 7) the velocity of the grip point.
    """

    poses: dict[str, Pose]
    grip: np.ndarray
    axes: np.ndarray
    arms: np.ndarray


def forward(geometry: ArmGeometry, q: np.ndarray, torso: Pose) -> ArmPose:
    """Poses of a right arm from its seven coordinates and the torso pose (origin at the gleno-humeral centre).

    `q` has shape (7,) [rad].

    The radius closes its loop exactly: its ulnar-head point lies on the ulna's y axis where a sphere about the
    humero-radial centre cuts that line. `axes` and `arms` neglect the small wobble of the radius that follows from it
    (below 1 % of the rates).
    """
    GH, R_torso = torso
    R_h = R_torso @ rotation(q[:3]) @ geometry.humerus_anatomical
    elbow_frame = R_h @ geometry.elbow_on_humerus
    R_u = elbow_frame @ _about_z(float(q[3]) + geometry.elbow_anatomical) @ geometry.elbow_on_ulna.T
    x_u = GH + R_h @ geometry.HU
    x_r = GH + R_h @ geometry.HR
    along = R_u[:, 1]
    gap = x_u - x_r
    half = float(along @ gap)
    UH = geometry.UH
    reach = -half - math.sqrt(half * half - float(gap @ gap) + float(UH @ UH))
    ulnar_head = x_u + reach * along
    axis = x_r - ulnar_head
    forearm_frame = frame(axis, 3, elbow_frame[:, 2], 1)
    turn = geometry.forearm_anatomical + float(q[4]) + 0.5 * math.pi
    R_r = forearm_frame @ _about_z(turn) @ geometry.forearm_on_radius.T
    W = x_r + R_r @ geometry.W
    wrist_frame = R_r @ geometry.wrist_on_radius
    middle = wrist_frame @ _about_z(float(q[5]))
    R_hand = middle @ _about_y(float(q[6])) @ geometry.wrist_on_hand.T
    grip = W + R_hand @ geometry.grip
    axes = np.empty((3, COORDINATES))
    axes[:, :3] = R_torso
    axes[:, 3] = elbow_frame[:, 2]
    axes[:, 4] = forearm_frame[:, 2]
    axes[:, 5] = wrist_frame[:, 2]
    axes[:, 6] = middle[:, 1]
    levers = np.empty((3, COORDINATES))
    levers[:, :3] = (grip - GH)[:, None]
    levers[:, 3] = grip - x_u
    levers[:, 4] = grip - x_r
    levers[:, 5] = levers[:, 6] = grip - W
    a, r = axes, levers
    arms = np.stack((a[1] * r[2] - a[2] * r[1], a[2] * r[0] - a[0] * r[2], a[0] * r[1] - a[1] * r[0]))
    poses = {"humerus": (GH, R_h), "radius": (x_r, R_r), "ulna": (x_u, R_u), "hand": (W, R_hand)}
    return ArmPose(poses=poses, grip=grip, axes=axes, arms=arms)


def joint_coordinates(geometry: ArmGeometry, poses: Mapping[str, Pose], torso: Pose) -> np.ndarray:
    """The seven coordinates [rad] of a right arm from the poses of its segments: the inverse of `forward`.

    Shape (7,).
    """
    R_torso = torso[1]
    R_h, R_r = poses["humerus"][1], poses["radius"][1]
    R_u, R_hand = poses["ulna"][1], poses["hand"][1]
    q = np.empty(COORDINATES)
    q[:3] = rotation_vector(R_torso.T @ R_h @ geometry.humerus_anatomical.T)
    elbow_frame = R_h @ geometry.elbow_on_humerus
    elbow = elbow_frame.T @ R_u @ geometry.elbow_on_ulna
    q[3] = math.atan2(elbow[1, 0], elbow[0, 0]) - geometry.elbow_anatomical
    on_radius = R_r @ geometry.forearm_on_radius
    forearm = frame(on_radius[:, 2], 3, elbow_frame[:, 2], 1).T @ on_radius
    q[4] = math.atan2(forearm[1, 0], forearm[0, 0]) - geometry.forearm_anatomical - 0.5 * math.pi
    wrist = (R_r @ geometry.wrist_on_radius).T @ R_hand @ geometry.wrist_on_hand
    q[5] = math.atan2(-wrist[0, 1], wrist[1, 1])
    q[6] = math.atan2(-wrist[2, 0], wrist[2, 2])
    q[3:] = (q[3:] + math.pi) % (2.0 * math.pi) - math.pi
    return q


def muscle_lengths(limb: Limb, poses: Mapping[str, Pose], torso: Pose) -> np.ndarray:
    """Current lengths [m] of the limb's muscles in its order; all poses in one common frame.

    One per muscle: shape (muscles,).
    """
    frames = {**poses, "torso": torso}
    origins, insertions = _end_points(limb, frames)
    difference = insertions - origins
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", difference, difference)))


def _end_points(limb: Limb, frames: Mapping[str, Pose]) -> tuple[np.ndarray, np.ndarray]:
    order = ("torso", *SEGMENTS)
    index = {name: i for i, name in enumerate(order)}
    x = np.array([frames[name][0] for name in order])
    R = np.array([frames[name][1] for name in order])
    ends = []
    for bodies, points in (
        ([m.origin_body for m in limb.muscles], [m.origin_m for m in limb.muscles]),
        ([m.insertion_body for m in limb.muscles], [m.insertion_m for m in limb.muscles]),
    ):
        which = [index[b] for b in bodies]
        ends.append(x[which] + np.einsum("nij,nj->ni", R[which], np.array(points)))
    return ends[0], ends[1]
