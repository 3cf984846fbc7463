"""Posture: how the arm holds its control, as a first guess for the solver and as joint angles of what the solver found.

The posture deck minimises the energy of ergonomic springs with the hand on the control (docs/theory/posture.md). The
first guess solves the same small problem in the seven joint coordinates, so that the solver only polishes it.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

from pilotgen.anthropometry.arm import COORDINATES, SEGMENTS, SUFFIX
from pilotgen.anthropometry.body import Body
from pilotgen.errors import EvaluationError
from pilotgen.posture.cockpit import Cockpit, PlacedInceptor
from pilotgen.posture.kinematics import (
    JOINT_COORDINATES,
    ArmGeometry,
    ArmPose,
    Pose,
    arm_geometry,
    cross,
    forward,
    frame,
    joint_coordinates,
    mirror_pose,
    muscle_lengths,
    rotation,
    rotation_vector,
    rotation_vector_rate,
)
from pilotgen.study.yaml_file import bundled

_GUESS_ITERATIONS = 12
_GUESS_STEP_RAD = 0.6  # longest Newton step
_GUESS_CLOSED_M = 0.1  # grip error and step before the last one: what is left after it, the solver removes faster
_GUESS_SETTLED_RAD = 0.5
_UPPER = np.triu(np.ones((COORDINATES, COORDINATES)))
_STRICTLY_LOWER = np.tril(np.ones((COORDINATES, COORDINATES)), -1)

ANGLE_NAMES: Mapping[str, str] = {
    "shoulder_flexion_deg": "shoulder flexion",
    "shoulder_abduction_deg": "shoulder abduction",
    "shoulder_rotation_deg": "internal rotation of the upper arm",
    "elbow_flexion_deg": "elbow flexion",
    "forearm_pronation_deg": "forearm pronation",
    "wrist_flexion_deg": "palmar flexion of the wrist",
    "wrist_ulnar_deviation_deg": "ulnar deviation of the wrist",
}


@dataclass(frozen=True)
class Ergonomics:
    """Springs about the neutral posture (order of JOINT_COORDINATES), of the grip, and ranges of motion."""

    neutral_rad: np.ndarray  # (7,)
    K1_Nm_per_rad: np.ndarray  # (7,)
    K3_Nm_per_rad3: np.ndarray  # (7,)
    grip_Nm_per_rad: np.ndarray  # (3,) about the handle, and across it twice
    hand_handle: np.ndarray  # (3, 3) right hand: axis 1 where the fist holds a handle's thumb end, axis 2 palmar
    range_deg: Mapping[str, tuple[float, float]]


@lru_cache(maxsize=1)
def ergonomics() -> Ergonomics:
    """The bundled numbers of `data/ergonomics.yaml`."""
    data: dict[str, Any] = bundled("ergonomics").value
    ranges = {name: (float(low), float(high)) for name, (low, high) in data["range_of_motion"].items()}
    range_of = dict(zip(JOINT_COORDINATES, (_RANGE_OF_COORDINATE[name] for name in JOINT_COORDINATES), strict=True))
    neutral, K1, K3 = (np.empty(COORDINATES) for _ in range(3))
    for i, name in enumerate(JOINT_COORDINATES):
        spring = data["springs"][name]
        low, high = ranges[range_of[name]]
        if name == "shoulder_x":  # adduction is positive
            low, high = -high, -low
        to_the_end = math.radians(min(spring["neutral_deg"] - low, high - spring["neutral_deg"]))
        neutral[i] = math.radians(spring["neutral_deg"])
        K1[i] = 1.0 / math.radians(spring["scale_deg"]) ** 2
        K3[i] = spring["stiffening"] * K1[i] / to_the_end**2
    grip = data["grip"]
    tilt = 1.0 / math.radians(grip["tilt_scale_deg"]) ** 2
    oblique = math.radians(grip["obliquity_deg"])
    thumb_end = np.array([0.0, -math.sin(oblique), math.cos(oblique)])
    return Ergonomics(
        neutral_rad=neutral,
        K1_Nm_per_rad=K1,
        K3_Nm_per_rad3=K3,
        grip_Nm_per_rad=np.array([1.0 / math.radians(grip["spin_scale_deg"]) ** 2, tilt, tilt]),
        hand_handle=frame(thumb_end, 1, np.array([1.0, 0.0, 0.0]), 2),
        range_deg=ranges,
    )


_RANGE_OF_COORDINATE = dict(
    zip(
        JOINT_COORDINATES,
        (
            "shoulder_abduction_deg",
            "shoulder_rotation_deg",
            "shoulder_flexion_deg",
            "elbow_flexion_deg",
            "forearm_pronation_deg",
            "wrist_flexion_deg",
            "wrist_ulnar_deviation_deg",
        ),
        strict=True,
    )
)


# ---- first guess -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PostureGuess:
    """Where the solver may start.

    Attributes
    ----------
    nodes : dict
        Pose of each limb node in world axes by its deck name, `humerus_l`, `radius_l`, `ulna_l`, `hand_l` (or `_r`).
    coordinates : dict
        The seven joint coordinates [rad] by side.
    """

    nodes: dict[str, Pose]
    coordinates: dict[str, np.ndarray]


def first_guess(body: Body, cockpit: Cockpit) -> PostureGuess:
    """Guess the posture of every limb of the body.

    Raises
    ------
    EvaluationError
        The control is out of reach; the message says by how much.
    """
    nodes: dict[str, Pose] = {}
    coordinates: dict[str, np.ndarray] = {}
    for side, limb in body.limbs.items():
        geometry = arm_geometry(limb)
        torso = cockpit.torso[side]
        inceptor = cockpit.inceptors[side]
        _check_reach(geometry, torso, inceptor)
        handle: Pose = (inceptor.grip_world_m, inceptor.pose[1] @ inceptor.handle)
        if side == "left":
            torso, handle = mirror_pose(torso), mirror_pose(handle)
        q, pose = _least_effort(geometry, torso, handle)
        coordinates[side] = q
        for name in SEGMENTS:
            segment = pose.poses[name]
            nodes[f"{name}_{SUFFIX[side]}"] = mirror_pose(segment) if side == "left" else segment
    return PostureGuess(nodes=nodes, coordinates=coordinates)


def _lengths(geometry: ArmGeometry) -> tuple[float, float]:
    """Upper arm, and elbow to grip with a straight wrist [m]."""
    upper = float(np.linalg.norm(geometry.HU))
    return upper, float(np.linalg.norm(geometry.W)) + float(np.linalg.norm(geometry.grip))


def _check_reach(geometry: ArmGeometry, torso: Pose, inceptor: PlacedInceptor) -> None:
    upper, lower = _lengths(geometry)
    distance = float(np.linalg.norm(inceptor.grip_world_m - torso[0]))
    if distance > upper + lower:
        raise EvaluationError(
            "posture",
            f"the {inceptor.name} grip is {distance:.3f} m from the {inceptor.side} shoulder, "
            f"{distance - upper - lower:.3f} m beyond the reach of the straight arm ({upper + lower:.3f} m)",
        )
    most_flexed_deg = ergonomics().range_deg["elbow_flexion_deg"][1]
    folded = math.sqrt(upper**2 + lower**2 + 2.0 * upper * lower * math.cos(math.radians(most_flexed_deg)))
    if distance < folded:
        raise EvaluationError(
            "posture",
            f"the {inceptor.name} grip is {distance:.3f} m from the {inceptor.side} shoulder, nearer than the "
            f"{folded:.3f} m of an arm with {most_flexed_deg:.0f} deg of elbow flexion",
        )


def _two_link_start(geometry: ArmGeometry, torso: Pose, handle: Pose) -> np.ndarray:
    """Neutral angles, with elbow and shoulder flexion of a planar arm that reaches the grip."""
    q = ergonomics().neutral_rad.copy()
    upper, lower = _lengths(geometry)
    reach = torso[1].T @ (handle[0] - torso[0])
    distance = float(np.linalg.norm(reach))
    cosine = (distance**2 - upper**2 - lower**2) / (2.0 * upper * lower)
    q[3] = math.acos(max(-1.0, min(1.0, cosine)))
    inside = math.atan2(lower * math.sin(q[3]), upper + lower * math.cos(q[3]))
    q[2] = math.atan2(reach[0], -reach[1]) - inside
    return q


def _least_effort(geometry: ArmGeometry, torso: Pose, handle: Pose) -> tuple[np.ndarray, ArmPose]:
    """Coordinates of a right arm with the least spring energy and the grip on the handle.

    Newton's method on the Lagrangian, energy + multipliers . (grip - handle). The Hessian has the curvature of the
    hand's path; the wobble of the radius and the curvature of the shoulder's rotation vector are left out, so that the
    last digits are the solver's business.
    """
    e = ergonomics()
    K1, K3, k_grip = e.K1_Nm_per_rad, e.K3_Nm_per_rad3, e.grip_Nm_per_rad
    R_neutral = rotation(e.neutral_rad[:3])
    R_handle = handle[1]
    q = _two_link_start(geometry, torso, handle)
    multipliers: np.ndarray = np.zeros(3)
    system, right = np.zeros((10, 10)), np.empty(10)
    J = np.eye(COORDINATES)
    for _ in range(_GUESS_ITERATIONS):
        pose = forward(geometry, q, torso)
        R_shoulder = rotation(q[:3])
        shoulder = rotation_vector(R_neutral.T @ R_shoulder)
        stretch = np.concatenate((shoulder, q[3:] - e.neutral_rad[3:]))
        moment = K1 * stretch + K3 * stretch**3
        J[:3, :3] = rotation_vector_rate(shoulder) @ R_neutral.T
        tilt = rotation_vector(R_handle.T @ pose.poses["hand"][1] @ e.hand_handle)
        rate = rotation_vector_rate(tilt) @ R_handle.T
        J_tilt = rate @ pose.axes
        couple = rate.T @ (k_grip * tilt)
        # half of the couple's term: the couple itself turns half as fast as the hand
        curvature = _path_curvature(pose.axes, pose.arms, multipliers)
        curvature += _path_curvature(pose.axes, pose.axes, 0.5 * couple)
        hessian = J.T @ ((K1 + 3.0 * K3 * stretch**2)[:, None] * J) + J_tilt.T @ (k_grip[:, None] * J_tilt)
        system[:7, :7] = hessian + curvature
        system[:7, 7:] = pose.arms.T
        system[7:, :7] = pose.arms
        gap = pose.grip - handle[0]
        right[:7] = -(J.T @ moment + pose.axes.T @ couple)
        right[7:] = -gap
        solution = np.linalg.solve(system, right)
        step = solution[:7]
        largest = float(np.max(np.abs(step)))
        factor = min(1.0, _GUESS_STEP_RAD / largest)
        multipliers = factor * solution[7:]
        settled = largest < _GUESS_SETTLED_RAD and float(np.max(np.abs(gap))) < _GUESS_CLOSED_M
        q[3:] += factor * step[3:]
        q[:3] = rotation_vector(rotation(factor * step[:3]) @ R_shoulder)
        if settled:
            break
    return q, forward(geometry, q, torso)


def _path_curvature(axes: np.ndarray, arms: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Second derivative (7, 7) of weights . (motion of the hand) along a serial chain, symmetric.

    With i proximal to j it is a_i . (b_j x weights), b_j being what coordinate j moves: velocity of the grip (`arms`)
    or angular velocity (`axes`).
    """
    wx, wy, wz = weights.tolist()
    turned = np.stack((arms[1] * wz - arms[2] * wy, arms[2] * wx - arms[0] * wz, arms[0] * wy - arms[1] * wx))
    path = axes.T @ turned
    curvature = path * _UPPER + path.T * _STRICTLY_LOWER
    curvature[:3, :3] = 0.5 * (path[:3, :3] + path[:3, :3].T)
    return np.asarray(curvature)


# ---- what the solver found -------------------------------------------------------------------------------------------


class HasPose(Protocol):
    """A node of a solver's reply: position (3,) [m], orientation (3, 3), columns = node axes."""

    @property
    def position(self) -> np.ndarray:
        """Global [m]."""

    @property
    def orientation(self) -> np.ndarray:
        """Columns are the node's axes."""


@dataclass(frozen=True)
class Posture:
    """A posture with every joint inside its range of motion.

    Attributes
    ----------
    nodes : dict
        Pose of each limb node in world axes by its deck name (`hand_l`, ...).
    angles_by_side : dict
        Joint angles [deg] by side: names of `ANGLE_NAMES`, grip tilt and spin last.
    muscle_lengths_m : ndarray
        Of all muscles in deck order.
    """

    nodes: dict[str, Pose]
    angles_by_side: dict[str, dict[str, float]]
    muscle_lengths_m: np.ndarray

    @property
    def angles_deg(self) -> dict[str, float]:
        """Joint angles of the arm on the collective; those of the other arm with `right_` before their names."""
        angles = dict(self.angles_by_side.get("left", {}))
        angles.update({f"right_{name}": value for name, value in self.angles_by_side.get("right", {}).items()})
        return angles


def from_poses(body: Body, cockpit: Cockpit, nodes: Mapping[str, HasPose | Pose]) -> Posture:
    """Joint angles of solved poses, checked against the ranges of motion.

    Parameters
    ----------
    nodes : mapping
        Node name -> pose in world axes, as a pair or as the solver's reply has it. Nodes that are not the limbs' are
        not looked at.

    Raises
    ------
    EvaluationError
        A joint outside its range of motion: joint, angle and limit.
    """
    poses = {name: _pose(node) for name, node in nodes.items()}
    limits = ergonomics().range_deg
    angles_by_side: dict[str, dict[str, float]] = {}
    lengths = []
    for side, limb in body.limbs.items():
        segments = {name: poses[f"{name}_{SUFFIX[side]}"] for name in SEGMENTS}
        torso, inceptor = cockpit.torso[side], cockpit.inceptors[side]
        lengths.append(muscle_lengths(limb, segments, torso))
        R_handle = inceptor.pose[1] @ inceptor.handle
        if side == "left":
            segments = {name: mirror_pose(pose) for name, pose in segments.items()}
            torso = mirror_pose(torso)
            R_handle = mirror_pose((torso[0], R_handle))[1]
        angles = joint_angles(arm_geometry(limb), segments, torso)
        _check_ranges(angles, limits, side)
        tilt = np.degrees(rotation_vector(R_handle.T @ segments["hand"][1] @ ergonomics().hand_handle))
        angles["grip_spin_deg"] = float(tilt[0])
        angles["grip_tilt_deg"] = float(math.hypot(tilt[1], tilt[2]))
        angles_by_side[side] = angles
    names = [f"{name}_{SUFFIX[side]}" for side in body.limbs for name in SEGMENTS]
    return Posture(
        nodes={name: poses[name] for name in names},
        angles_by_side=angles_by_side,
        muscle_lengths_m=np.concatenate(lengths),
    )


def _pose(node: HasPose | Pose) -> Pose:
    return node if isinstance(node, tuple) else (node.position, node.orientation)


def joint_angles(geometry: ArmGeometry, poses: Mapping[str, Pose], torso: Pose) -> dict[str, float]:
    """Joint angles [deg] of a right arm in clinical terms.

    Shoulder: flexion is the forward angle of the humerus from the torso's long axis in the sagittal plane, abduction
    its angle out of that plane, rotation the turn about its own axis that is left when the humerus is first swung from
    the anatomical position to its direction by the shortest way (internal positive). The others are the coordinates
    of `pilotgen.posture.kinematics`.
    """
    q = joint_coordinates(geometry, poses, torso)
    R = torso[1].T @ poses["humerus"][1]
    start, end = geometry.humerus_anatomical[:, 1], R[:, 1]
    down = -end
    axis = cross(start, end)
    sine = math.sqrt(float(axis @ axis))
    swing = np.eye(3)
    if sine > 1e-12:
        swing = rotation(axis * (math.atan2(sine, float(start @ end)) / sine))
    twist = rotation_vector((swing @ geometry.humerus_anatomical).T @ R)
    degrees = np.degrees(q[3:]).tolist()
    return {
        "shoulder_flexion_deg": math.degrees(math.atan2(down[0], -down[1])),
        "shoulder_abduction_deg": math.degrees(math.asin(max(-1.0, min(1.0, float(down[2]))))),
        "shoulder_rotation_deg": math.degrees(float(twist[1])),
        "elbow_flexion_deg": degrees[0],
        "forearm_pronation_deg": degrees[1],
        "wrist_flexion_deg": degrees[2],
        "wrist_ulnar_deviation_deg": degrees[3],
    }


def _check_ranges(angles: Mapping[str, float], limits: Mapping[str, tuple[float, float]], side: str) -> None:
    for name, value in angles.items():
        low, high = limits[name]
        if not low <= value <= high:
            limit = low if value < low else high
            raise EvaluationError(
                "posture",
                f"{side} arm: {ANGLE_NAMES[name]} would be {value:.1f} deg; "
                f"its range of motion ends at {limit:.0f} deg",
            )
