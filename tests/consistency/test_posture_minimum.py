"""The solver's posture balances the ergonomic joint springs, by virtual work in joint coordinates.

The springs are written here from the definition of the posture deck, with scipy's rotations and finite differences:
nothing of the deck's cards or of the solver's tangents enters.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.spatial.transform import Rotation

from pilotgen.anthropometry.biometrics import Biometrics
from pilotgen.anthropometry.body import SEGMENTS, make_body
from pilotgen.decks.deck import render_posture
from pilotgen.posture.cockpit import make_cockpit
from pilotgen.posture.kinematics import arm_geometry, forward, joint_coordinates, mirror_pose
from pilotgen.posture.posture import ergonomics, first_guess, from_poses
from pilotgen.solver.client import SolverClient

STEP = 1e-5  # rad


@pytest.mark.parametrize("stature_m", [1.60, 1.90])
def test_virtual_work_vanishes_in_every_direction_that_keeps_the_grip(solver: SolverClient, stature_m: float) -> None:
    body = make_body(Biometrics(40.0, stature_m, 24.0 * stature_m**2, "male"), ("left",))
    cockpit = make_cockpit(body, lever_length_m=0.32, position=0.5)
    deck = render_posture(body, cockpit, first_guess(body, cockpit))
    posture = from_poses(body, cockpit, solver.request("static", deck_text=deck, name="posture.mbd").nodes)
    limb, inceptor, e = arm_geometry(body.limbs["left"]), cockpit.inceptors["left"], ergonomics()
    torso = mirror_pose(cockpit.torso["left"])
    grip, handle = mirror_pose((inceptor.grip_world_m, inceptor.pose[1] @ inceptor.handle))
    neutral = Rotation.from_rotvec(e.neutral_rad[:3])

    def shoulder(q: np.ndarray) -> Rotation:
        return neutral.inv() * Rotation.from_rotvec(q[:3])

    def fist(q: np.ndarray) -> Rotation:
        return Rotation.from_matrix(handle.T @ forward(limb, q, torso).poses["hand"][1] @ e.hand_handle)

    def on_radius(q: np.ndarray) -> np.ndarray:
        poses = forward(limb, q, torso).poses
        return poses["radius"][1].T @ poses["hand"][1] @ limb.wrist_on_hand

    def wrist(q: np.ndarray) -> Rotation:  # one spring card of two axes: its angles are a rotation vector's components
        return Rotation.from_matrix(on_radius(e.neutral_rad).T @ on_radius(q))

    def turn(relative, q: np.ndarray) -> np.ndarray:  # type: ignore[no-untyped-def]
        """Columns: virtual rotation of the second body in the first one's axes, per coordinate."""
        steps = STEP * np.eye(len(q))
        return np.stack([(relative(q + d) * relative(q - d).inv()).as_rotvec() / (2.0 * STEP) for d in steps], axis=1)

    poses = {name: mirror_pose(posture.nodes[f"{name}_l"]) for name in SEGMENTS}
    q = joint_coordinates(limb, poses, torso)
    assert np.linalg.norm(forward(limb, q, torso).grip - grip) < 1e-9
    stretch = np.concatenate((shoulder(q).as_rotvec(), q[3:] - e.neutral_rad[3:]))
    moment = e.K1_Nm_per_rad * stretch + e.K3_Nm_per_rad3 * stretch**3
    _, deviation, flexion = wrist(q).as_rotvec()
    angles = np.array([0.0, deviation, flexion])
    K1, K3 = ([0.0, K[6], K[5]] for K in (e.K1_Nm_per_rad, e.K3_Nm_per_rad3))
    work = turn(shoulder, q).T @ moment[:3] + turn(fist, q).T @ (e.grip_Nm_per_rad * fist(q).as_rotvec())
    work += turn(wrist, q).T @ (K1 * angles + K3 * angles**3)
    work[3:5] += moment[3:5]
    steps = STEP * np.eye(7)
    reach = np.stack(
        [(forward(limb, q + d, torso).grip - forward(limb, q - d, torso).grip) / (2.0 * STEP) for d in steps], axis=1
    )
    free = null_space(reach)
    assert free.shape == (7, 4)
    assert np.abs(moment).max() > 1.0  # N m: the balance is not one of zeros
    assert np.abs(free.T @ work).max() < 1e-6  # N m
