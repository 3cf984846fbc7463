"""The arm on its control once more, in seven joint coordinates and by finite differences.

An account of the pilot that shares with the program only the body, the cockpit, the forward kinematics (tested against
the anatomical position and by finite differences) and Hill's curves as published. No multibody solver: gravity and
muscles act through numerical derivatives of heights and lengths, the grip is solved exactly, and two independent
velocities remain. Right arms only; left arms are looked at in the mirror.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math

import numpy as np

from pilotgen.anthropometry.body import SEGMENTS, Body
from pilotgen.posture.cockpit import Cockpit
from pilotgen.posture.kinematics import (
    MIRROR,
    arm_geometry,
    forward,
    joint_coordinates,
    mirror_pose,
    muscle_lengths,
    rotation_vector,
)
from pilotgen.posture.posture import Posture

GRAVITY = 9.81
F2_AT_REST = 1.6 * (1.0 - math.exp(-1.0))  # f2(0)
F2_SLOPE_AT_REST = 1.6 * math.exp(-1.0) * 4.2  # d/dv of 1.6 - 1.6 exp(0.1/(v-1)^2 - 1.1/(v-1)^4) at 0: 4.4 - 0.2


def active(x: np.ndarray) -> np.ndarray:
    """f1 of Pennestri's muscle."""
    u = x - 0.95
    return np.asarray(np.exp(u**2 - 40.0 * u**4))


def passive(x: np.ndarray) -> np.ndarray:
    """f3 of Pennestri's muscle."""
    return np.asarray(1.3 * np.arctan(0.1 * (x - 0.22) ** 10))


class SevenCoordinates:
    """One arm in the posture that was solved."""

    def __init__(self, body: Body, cockpit: Cockpit, posture: Posture, side: str = "left") -> None:
        self.limb = body.limbs[side]
        self.left = side == "left"
        self.mirror = MIRROR if self.left else np.ones(3)
        self.geometry = arm_geometry(self.limb)
        self.torso_world = cockpit.torso[side]
        self.torso = mirror_pose(self.torso_world) if self.left else self.torso_world
        self.inceptor = cockpit.inceptors[side]
        poses = {name: posture.nodes[f"{name}_{side[0]}"] for name in SEGMENTS}
        if self.left:
            poses = {name: mirror_pose(pose) for name, pose in poses.items()}
        self.q = joint_coordinates(self.geometry, poses, self.torso)
        self.F0 = np.array([m.F0_N for m in self.limb.muscles])
        self.l0 = np.array([m.l0_m for m in self.limb.muscles])
        self.V0 = np.array([m.V0_m_per_s for m in self.limb.muscles])

    def poses(self, q: np.ndarray) -> dict:
        """Poses of the right arm."""
        return forward(self.geometry, q, self.torso).poses

    def lengths(self, q: np.ndarray) -> np.ndarray:
        """Muscle lengths [m]."""
        poses = self.poses(q)
        if self.left:
            poses = {name: mirror_pose(pose) for name, pose in poses.items()}
        return muscle_lengths(self.limb, poses, self.torso_world)

    def centres(self, q: np.ndarray) -> np.ndarray:
        """Centres of mass (4, 3) [m]."""
        poses = self.poses(q)
        return np.array([poses[n][0] + poses[n][1] @ (self.limb.segments[n].com_m * self.mirror) for n in SEGMENTS])

    def masses(self) -> np.ndarray:
        """Segment masses [kg]."""
        return np.array([self.limb.segments[n].mass_kg for n in SEGMENTS])

    def derivative(self, function, q: np.ndarray, h: float = 2e-4) -> np.ndarray:
        """Fourth-order central differences along the seven coordinates (last axis)."""
        columns = []
        for i in range(7):
            e = np.zeros(7)
            e[i] = h
            columns.append(
                (8.0 * (function(q + e) - function(q - e)) - (function(q + 2 * e) - function(q - 2 * e))) / (12.0 * h)
            )
        return np.stack(columns, axis=-1)

    def weight_torque(self, q: np.ndarray) -> np.ndarray:
        """Generalised gravity force (7,)."""
        heights = self.derivative(lambda p: self.centres(p)[:, 1], q)
        return np.asarray(-GRAVITY * (self.masses() @ heights))

    def muscle_torque(self, q: np.ndarray, activation: np.ndarray) -> np.ndarray:
        """Generalised muscle force (7,) at rest."""
        x = self.lengths(q) / self.l0
        tension = self.F0 * (active(x) * F2_AT_REST * activation + passive(x))
        return np.asarray(-tension @ self.derivative(self.lengths, q))

    def unbalanced(self, activation: np.ndarray) -> np.ndarray:
        """Generalised forces (7,) [N m] that are left in the posture."""
        return self.weight_torque(self.q) + self.muscle_torque(self.q, activation)

    def reduced(self, activation: np.ndarray, kp: float, kd: float) -> tuple[np.ndarray, ...]:
        """M, C, K, b of the arm on its lever in two independent velocities, and the lever's row N8 (2,).

        M d2 + C d1 + K d = -b zddot, phi = N8 d, zddot the vertical acceleration of the seat. Valid without hand load:
        then the curvature of the grip's constraints does no work.
        """
        l_ref = self.lengths(self.q)

        def force(q: np.ndarray) -> np.ndarray:
            a = activation + kp * (self.lengths(q) - l_ref) / self.l0
            return self.weight_torque(q) + self.muscle_torque(q, a)

        K = -self.derivative(force, self.q, 5e-4)
        l_q = self.derivative(self.lengths, self.q)
        x = l_ref / self.l0
        damping = self.F0 * active(x) * (F2_SLOPE_AT_REST * activation + F2_AT_REST * kd) / self.V0
        C = (l_q * damping[:, None]).T @ l_q
        c_q = self.derivative(self.centres, self.q)
        M = np.einsum("b,bik,bil->kl", self.masses(), c_q, c_q)
        b = self.masses() @ c_q[:, 1]
        here = self.poses(self.q)
        for name in SEGMENTS:
            R = here[name][1]
            w = self.derivative(lambda p, n=name, R0=R: rotation_vector(self.poses(p)[n][1] @ R0.T), self.q)
            J = R @ (self.limb.segments[name].inertia_kg_m2 * np.outer(self.mirror, self.mirror)) @ R.T
            M += w.T @ J @ w
            if name == "hand":
                hand = w
        grip = self.derivative(lambda p: forward(self.geometry, p, self.torso).grip, self.q)
        arm = (self.inceptor.grip_world_m - self.inceptor.pose[0]) * self.mirror
        axis = np.array([0.0, 0.0, 1.0])  # turning about z is the same in the mirror
        closure = np.zeros((6, 8))
        closure[:3, :7], closure[:3, 7] = grip, -np.cross(axis, arm)
        closure[3:, :7], closure[3:, 7] = hand, -axis
        N = np.linalg.svd(closure)[2][6:].T
        M8, C8, K8 = np.zeros((3, 8, 8))
        M8[:7, :7], C8[:7, :7], K8[:7, :7] = M, C, K
        M8[7, 7] = self.inceptor.inertia_kg_m2[2]
        return N.T @ M8 @ N, N.T @ C8 @ N, N.T @ K8 @ N, N[:7].T @ b, N[7]

    def poles(self, activation: np.ndarray, kp: float, kd: float) -> np.ndarray:
        """Eigenvalues [1/s] with positive imaginary part, by modulus."""
        M, C, K, _, _ = self.reduced(activation, kp, kd)
        A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
        values = np.linalg.eigvals(A)
        return np.array(sorted((v for v in values if v.imag > 0.0), key=abs))

    def feedthrough(self, activation: np.ndarray, kp: float, kd: float, frequency_hz: float) -> complex:
        """Lever rotation per vertical seat acceleration [rad/(m/s^2)]."""
        M, C, K, b, lever = self.reduced(activation, kp, kd)
        s = 2j * math.pi * frequency_hz
        return complex(lever @ np.linalg.solve(M * s**2 + C * s + K, -b))
