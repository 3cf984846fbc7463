"""Torso, arm and lever once more, in relative coordinates and by finite differences.

An account of the seated pilot that shares with the program only the rows of the torso (bodies, springs, prestress), the
seven coordinates of the arm (`seven_coordinates`) and nothing of solver, decks, templates or projection. Every body of
the torso has six freedoms; the arm hangs on the thorax by its own seven coordinates, so that muscles and shoulder act
inside it. Springs act as MBDyn's manual says of a deformable joint: force and moment in the first body's axes, from the
gap and the relative rotation of the two frames. Forces are written down for finite motions and differentiated.
"""

from __future__ import annotations

import math

import numpy as np
from seven_coordinates import F2_AT_REST, F2_SLOPE_AT_REST, GRAVITY, SevenCoordinates, active

from pilotgen.anthropometry.body import SEGMENTS, Body
from pilotgen.posture.cockpit import Cockpit
from pilotgen.posture.kinematics import forward, rotation, rotation_vector
from pilotgen.posture.posture import Posture
from pilotgen.posture.seated_torso import SeatedTorso

STEP = 1e-4  # m, rad; fourth-order differences


class TorsoModel:
    """A seated pilot with the left arm on the collective.

    Unknowns: position and rotation vector of every torso body (6 each, in order), the arm's seven coordinates, the
    lever's rotation; all from the posture. Everything is looked at in the mirror z -> -z, as the left arm is.
    """

    def __init__(self, body: Body, cockpit: Cockpit, posture: Posture, seated: SeatedTorso) -> None:
        self.arm = SevenCoordinates(body, cockpit, posture, "left")
        self.seated = seated
        self.bodies = seated.torso.bodies
        self.first = {row.name: 6 * i for i, row in enumerate(self.bodies)}
        self.n_torso = 6 * len(self.bodies)
        self.size = self.n_torso + 8
        self.flip = np.array([1.0, 1.0, -1.0])

    # ---- finite motions

    def pose(self, u: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Where a torso body is; the seat does not move."""
        if name == "seat":
            return np.zeros(3), np.eye(3)
        k = self.first[name]
        return np.array(self.seated.places[name]) * self.flip + u[k : k + 3], rotation(u[k + 3 : k + 6])

    def segments(self, u: np.ndarray) -> tuple[dict, np.ndarray]:
        """Poses of the bones and the grip, on the moving thorax."""
        x0, _ = self.pose(np.zeros(self.size), "thorax")
        x, R = self.pose(u, "thorax")
        shoulder, axes = self.arm.torso
        there = (x + R @ (shoulder - x0), R @ axes)
        pose = forward(self.arm.geometry, self.arm.q + u[self.n_torso : self.n_torso + 7], there)
        return pose.poses, pose.grip

    def centres(self, u: np.ndarray) -> np.ndarray:
        """Centres of mass of the bones (4, 3)."""
        poses, _ = self.segments(u)
        limb, mirror = self.arm.limb, self.arm.mirror
        return np.array([poses[n][0] + poses[n][1] @ (limb.segments[n].com_m * mirror) for n in SEGMENTS])

    # ---- forces

    def spring_forces(self, u: np.ndarray) -> np.ndarray:
        """Forces and moments of the springs at rest on the torso's bodies, and weights there."""
        total = np.zeros(self.size)
        for row in self.bodies:
            total[self.first[row.name] + 1] -= row.mass_kg * GRAVITY
        arm_at = {side: np.array(at) * self.flip for side, (_, at) in self.seated.carried_arms.items()}
        x0, _ = self.pose(np.zeros(self.size), "thorax")
        _, R = self.pose(u, "thorax")
        k = self.first["thorax"]
        for side, (mass_kg, _) in self.seated.carried_arms.items():
            weight = np.array([0.0, -mass_kg * GRAVITY, 0.0])
            total[k : k + 3] += weight
            total[k + 3 : k + 6] += np.cross(R @ (arm_at[side] - x0), weight)
        for spring in self.seated.torso.springs:
            wrench = self.wrench(u, spring)
            for name, sign, arm in ((spring.first, 1.0, wrench[2]), (spring.second, -1.0, wrench[3])):
                if name == "seat":
                    continue
                k = self.first[name]
                total[k : k + 3] += sign * wrench[0]
                total[k + 3 : k + 6] += sign * (wrench[1] + np.cross(arm, wrench[0]))
        return total

    def frame(self, spring) -> tuple[np.ndarray, np.ndarray]:
        """Point and axes of a spring in the posture, in the mirror."""
        t = math.radians(self.seated.back_angle_deg) if spring.inclined else 0.0
        axes = np.array([[math.cos(t), -math.sin(t), 0.0], [math.sin(t), math.cos(t), 0.0], [0.0, 0.0, 1.0]])
        return np.array(self.seated.points[spring.name]) * self.flip, axes

    def wrench(self, u: np.ndarray, spring) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Force and moment on the first body, and the force's place seen from both bodies."""
        point, axes = self.frame(spring)
        zero = np.zeros(self.size)
        x1, R1 = self.pose(u, spring.first)
        x2, R2 = self.pose(u, spring.second)
        f1 = point - self.pose(zero, spring.first)[0]
        f2 = point - self.pose(zero, spring.second)[0]
        place = x2 + R2 @ f2
        Ra = R1 @ axes
        strain = np.concatenate((Ra.T @ (place - x1 - R1 @ f1), rotation_vector(Ra.T @ R2 @ axes)))
        mirrored = np.array([1.0, 1.0, -1.0, -1.0, -1.0, 1.0])  # of a force, and of a moment, in the mirror
        loads = np.array(self.seated.prestress[spring.name]) * mirrored + np.array(spring.stiffness) * strain
        return Ra @ loads[:3], Ra @ loads[3:], place - x1, place - x2

    def forces(self, u: np.ndarray, activation: np.ndarray, kp: float) -> np.ndarray:
        """All generalised forces at rest."""
        total = self.spring_forces(u)
        x, _ = self.pose(u, "thorax")
        k = self.first["thorax"]
        weights = np.zeros((4, 3))
        weights[:, 1] = -GRAVITY * self.arm.masses()
        centres = self.centres(u)
        total[k : k + 3] += weights.sum(axis=0)
        total[k + 3 : k + 6] += np.cross(centres - x, weights).sum(axis=0)
        by_q = self.derivative(self.centres, u, range(self.n_torso, self.n_torso + 7))
        total[self.n_torso : self.n_torso + 7] += np.einsum("bi,bik->k", weights, by_q)
        q = self.arm.q + u[self.n_torso : self.n_torso + 7]
        a = activation + kp * (self.arm.lengths(q) - self.arm.lengths(self.arm.q)) / self.arm.l0
        total[self.n_torso : self.n_torso + 7] += self.arm.muscle_torque(q, a)
        return total

    def derivative(self, function, u: np.ndarray, columns, h: float = STEP) -> np.ndarray:
        """Fourth-order central differences (last axis)."""
        found = []
        for i in columns:
            e = np.zeros(self.size)
            e[i] = h
            found.append(
                (8.0 * (function(u + e) - function(u - e)) - (function(u + 2 * e) - function(u - 2 * e))) / (12.0 * h)
            )
        return np.stack(found, axis=-1)

    # ---- the linear model

    def reduced(self, activation: np.ndarray, kp: float, kd: float) -> tuple[np.ndarray, ...]:
        """M, C, K, b and the lever's row in independent coordinates: M d'' + C d' + K d = -b zddot."""
        zero, n, k = np.zeros(self.size), self.n_torso, self.first["thorax"]
        everything = range(self.size)
        K = -self.derivative(lambda u: self.forces(u, activation, kp), zero, everything)
        M, C = np.zeros((self.size, self.size)), np.zeros((self.size, self.size))
        for row in self.bodies:
            i = self.first[row.name]
            M[i : i + 3, i : i + 3] = row.mass_kg * np.eye(3)
            M[i + 3 : i + 6, i + 3 : i + 6] = row.mass_kg * row.gyration_m**2 * np.eye(3)
        x0, _ = self.pose(zero, "thorax")
        for mass_kg, at in self.seated.carried_arms.values():
            r = np.array(at) * self.flip - x0
            by_u = np.zeros((3, self.size))
            by_u[:, k : k + 3] = np.eye(3)
            by_u[:, k + 3 : k + 6] = -np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
            M += mass_kg * by_u.T @ by_u
        for spring in self.seated.torso.springs:
            point, axes = self.frame(spring)
            by_u = np.zeros((6, self.size))
            for name, sign in ((spring.first, -1.0), (spring.second, 1.0)):
                if name == "seat":
                    continue
                i = self.first[name]
                r = point - self.pose(zero, name)[0]
                by_u[:3, i : i + 3] += sign * axes.T
                by_u[:3, i + 3 : i + 6] += (
                    sign * axes.T @ -np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
                )
                by_u[3:, i + 3 : i + 6] += sign * axes.T
            C += by_u.T @ np.diag(spring.damping) @ by_u
        c_u = self.derivative(self.centres, zero, everything)
        M += np.einsum("b,bik,bil->kl", self.arm.masses(), c_u, c_u)
        here, _ = self.segments(zero)
        for name in SEGMENTS:
            R = here[name][1]
            w = self.derivative(
                lambda u, m=name, R0=R: rotation_vector(self.segments(u)[0][m][1] @ R0.T), zero, everything
            )
            J = R @ (self.arm.limb.segments[name].inertia_kg_m2 * np.outer(self.arm.mirror, self.arm.mirror)) @ R.T
            M += w.T @ J @ w
            if name == "hand":
                hand = w
        M[-1, -1] += self.arm.inceptor.inertia_kg_m2[2]
        l_q = self.arm.derivative(self.arm.lengths, self.arm.q)
        x = self.arm.lengths(self.arm.q) / self.arm.l0
        damping = self.arm.F0 * active(x) * (F2_SLOPE_AT_REST * activation + F2_AT_REST * kd) / self.arm.V0
        C[n : n + 7, n : n + 7] += (l_q * damping[:, None]).T @ l_q
        grip = self.derivative(lambda u: self.segments(u)[1], zero, everything)
        lever = (self.arm.inceptor.grip_world_m - self.arm.inceptor.pose[0]) * self.arm.mirror
        axis = np.array([0.0, 0.0, 1.0])
        closure = np.vstack((grip, hand))
        closure[:3, -1] -= np.cross(axis, lever)
        closure[3:, -1] -= axis
        N = np.linalg.svd(closure)[2][6:].T
        heave = np.zeros(self.size)
        heave[1:n:6] = 1.0
        b = M @ heave
        return N.T @ M @ N, N.T @ C @ N, N.T @ K @ N, N.T @ b, N[-1]

    def poles(self, M: np.ndarray, C: np.ndarray, K: np.ndarray) -> np.ndarray:
        """Eigenvalues [1/s]."""
        n = len(M)
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
        return np.linalg.eigvals(A)
