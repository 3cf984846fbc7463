"""A tumbling, vibrating body in modes, out of equilibrium: residual and tangent against sums over its nodes in numpy.

The equations are those of MBDyn's modal joint (docs/theory/elements.md), written here from the file's masses and shapes
without the solver's moments of mass.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from test_mbdyn_modal import CASES, fem_records, skew

from pilotgen.solver.client import SolverClient

Floats = NDArray[np.float64]

TURN = Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix()
V, W = np.array([0.4, -0.3, 0.2]), np.array([1.1, -0.7, 1.6])
A, B = np.array([0.02, -0.015, 0.01, 0.03]), np.array([0.5, -0.3, 0.7, -0.2])
GRAVITY = np.array([0.2, -9.81, 0.5])
ALPHA, BETA = 0.3, 0.002  # of the Rayleigh damping


class Body:
    """The beam of the stored cases: equations of a free modal body, minus the forces on it."""

    def __init__(self, second_order: bool) -> None:
        with np.load(CASES / "m2_free_rest.npz") as data:
            self.fem = str(data["fem"])
        records = fem_records(self.fem)
        self.p, self.shapes = records["points"], records["shapes"]
        self.m, self.J = records["lumped"][:, 0], records["lumped"][:, 3:]
        self.M, self.K = (self.matrix(group) for group in ("9,", "10,"))
        self.second_order = second_order

    def matrix(self, group: str) -> Floats:
        rows = self.fem.split(f"** RECORD GROUP {group}")[1].split("\n", 1)[1].split("**")[0]
        n = len(self.shapes)
        return np.array(rows.split(), dtype=float).reshape(n, n)

    def residual(self, R: Floats, v: Floats, w: Floats, a: Floats, b: Floats, rates: Floats) -> Floats:
        """Rows of v, w and b (6 + n)."""
        vdot, wdot, bdot = rates[:3] - GRAVITY, rates[3:6], rates[6:]
        force, moment = np.zeros(3), np.zeros(3)
        modal = self.M @ bdot + (ALPHA * self.M + BETA * self.K) @ b + self.K @ a
        slip = np.zeros(3)  # MBDyn turns it once more
        x = R.T @ w
        for i, mass in enumerate(self.m):
            T, Q, J = self.shapes[:, i, :3].T, self.shapes[:, i, 3:].T, np.diag(self.J[i])
            u, ud, udd = T @ a, T @ b, T @ bdot
            at = R @ (self.p[i] + u)
            # The point's acceleration; of second order in the modes only what MBDyn keeps.
            force += mass * (
                vdot + np.cross(wdot, at) + np.cross(w, np.cross(w, at)) + R @ udd + 2 * np.cross(w, R @ ud)
            )
            inertia = J - mass * skew(self.p[i]) @ skew(self.p[i])
            inertia = inertia - mass * (skew(self.p[i]) @ skew(u) + skew(u) @ skew(self.p[i]))
            coriolis = -mass * skew(self.p[i]) @ skew(ud)
            if self.second_order:
                inertia = inertia - mass * skew(u) @ skew(u)
                coriolis = coriolis - mass * skew(u) @ skew(ud)
            turned = R @ inertia @ R.T
            moment += mass * np.cross(at, vdot) + turned @ wdot + np.cross(w, turned @ w)
            moment += R @ (mass * np.cross(self.p[i] + u, udd) + J @ Q @ bdot + 2 * coriolis @ x)
            small = skew(Q @ b) @ J
            moment += R @ (small + small.T) @ x
            slip += J @ Q @ b
            modal += mass * T.T @ (R.T @ vdot) + (mass * skew(self.p[i] + u) @ T + J @ Q).T @ (R.T @ wdot)
            modal += 2 * mass * np.cross(ud, T.T) @ x
            for j in range(len(a)):
                centrifugal = -mass * skew(T[:, j]) @ skew(self.p[i]) + skew(Q[:, j]) @ J
                if self.second_order:
                    centrifugal = centrifugal - mass * skew(T[:, j]) @ skew(u)
                modal[j] -= x @ centrifugal @ x
        return np.concatenate([force, moment + R @ np.cross(w, R @ slip), modal])


@pytest.mark.parametrize("second_order", [False, True])
def test_residual_and_tangent_in_motion(second_order: bool, solver: SolverClient, tmp_path: Path) -> None:
    body = Body(second_order)
    n = len(A)

    def numbers(values: Floats) -> str:
        return ", ".join(repr(float(x)) for x in values.ravel())

    initial = ", ".join(
        f"mode, {k + 1}, {a!r}, {b!r}" for k, (a, b) in enumerate(zip(A.tolist(), B.tolist(), strict=True))
    )
    deck = tmp_path / "body.mbd"
    deck.write_text(
        "begin: data; problem: initial value; end: data;\n"
        "begin: initial value; initial time: 0.; final time: 1.; time step: 1.e-3; method: ms, 0.6;\n"
        "eigenanalysis: 0., parameter, 0.02; end: initial value;\n"
        "begin: control data; structural nodes: 1; joints: 1; gravity; end: control data;\n"
        f"begin: nodes; structural: 1, modal, 0.1, 0.2, 0.3, matr, {numbers(TURN)}, {numbers(V)}, {numbers(W)};\n"
        "end: nodes;\nbegin: elements;\n"
        f"joint: 1, modal, 1, {n}, initial value, {initial}, from file, rayleigh damping, {ALPHA}, {BETA},\n"
        f'"beam.fem", 0{", use invariant 9" if second_order else ""};\n'
        f"gravity: uniform, {numbers(GRAVITY)}, const, 1.; end: elements;\n"
    )
    (tmp_path / "beam.fem").write_text(body.fem)
    solver.request("linearise", name=deck, output=tmp_path / "out.h5")
    with h5py.File(tmp_path / "out.h5") as file:
        c = float(file["scalars"][0, 0])
        g_y = (np.array(file["J_plus"]) - np.array(file["J_minus"])) / (2.0 * c)
        _, ydot, _, at_rest = np.array(file["vectors"]).T
    rows = np.r_[6:12, 12 + n : 12 + 2 * n]
    size = np.abs(body.K @ A).max()
    assert np.abs(at_rest[rows] - body.residual(TURN, V, W, A, B, np.zeros(6 + n))).max() < 1e-13 * size
    assert np.abs(body.residual(TURN, V, W, A, B, ydot[rows])).max() < 1e-12 * size  # its accelerations

    def moved(q: Floats) -> Floats:
        R = Rotation.from_rotvec(q[:3]).as_matrix() @ TURN
        return body.residual(R, V + q[3:6], W + q[6:9], A + q[9 : 9 + n], B + q[9 + n :], ydot[rows])

    columns = np.r_[3:12, 12 : 12 + 2 * n]
    h = 1e-3
    exact = np.array(
        [
            (8.0 * (moved(e) - moved(-e)) - moved(2.0 * e) + moved(-2.0 * e)) / (12.0 * h)
            for e in h * np.eye(len(columns))
        ]
    ).T
    assert np.abs(g_y[np.ix_(rows, columns)] - exact).max() < 1e-11 * np.abs(exact).max()
