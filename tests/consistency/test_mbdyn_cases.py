"""Every stored MBDyn case through this program's solver, entry by entry, at MBDyn's own momenta and reactions.

Where MBDyn's tangent is the derivative of its residual the matrices agree to round-off. Where it is not, the difference
must be exactly the known term, computed here from the deck's numbers and MBDyn's own matrices, without the solver.
Cases: MBDyn develop (2025-06), 17 digits, c = 0.01 s; MBDyn divides constraint rows and reaction columns by c.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import re
from pathlib import Path

import h5py
import numpy as np
import pytest
from linear_models import CASES, raw_case
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pilotgen.solver.client import SolverClient

Floats = NDArray[np.float64]

TOLERANCE = 1e-9  # of an entry, relative to the largest entry of the matrix

EXACT = [
    "arm_right",
    "c01a_revpin_rest",
    "c01b_revpin_spin",
    "c02a_sphpin_rest",
    "c02b_sphpin_spin",
    "c03a_revhinge_rod_rest",
    "c08a_muscle_pennestri",
    "c09b_ivp_t0_00",
    "c09c_ivp_equilibrium",
]
IN_LINE = {"arm_inline": ["106"], "c05_inline": ["2", "3"]}
DEFORMABLE = ["c06a_defhinge_rest", "c06b_defhinge_moving", "c06c_defhinge_elastic"]
MUSCLES = [
    "c08c_muscle_reflexive",
    "c08d_muscle_reflexive_moving",
    "c08e_muscle_erf",
    "c08f_muscle_ergonomy",
    "c08g_muscle_srs",
]
STATIC = ["c09a_static_00", "c09d_static_ie_01"]


def skew(a: Floats) -> Floats:
    """Return the matrix of the cross product a x."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def euler123(*angles: float) -> Floats:
    """Return MBDyn's `euler` orientation, R = Rx Ry Rz."""
    return np.asarray(Rotation.from_euler("XYZ", angles).as_matrix())


class Case:
    """A stored case: MBDyn's matrices, and where nodes and joints stand in them."""

    def __init__(self, name: str) -> None:
        self.data = np.load(CASES / f"{name}.npz")
        self.name = name
        raw = raw_case(name)
        self.c = raw.c
        self.Aplus, self.Aminus = raw.Aplus, raw.Aminus
        self.size = len(raw.Aplus)
        self.first = {int(label): int(first) for label, first in zip(raw.labels, raw.first, strict=True)}
        self.joint = {str(label): int(first) for label, first in zip(raw.joint_labels, raw.joint_first, strict=True)}
        pose = self.data["X0"].reshape(-1, 6)
        self.x = dict(zip(self.first, pose[:, :3], strict=True))
        self.R = {k: Rotation.from_rotvec(phi).as_matrix() for k, phi in zip(self.first, pose[:, 3:], strict=True)}
        self.deck = CASES / (re.sub(r"_0[01]$", "", name) + ".mbd")
        self.static = "model: static" in self.deck.read_text()
        self.reactions = np.array(self.data["reactions"]) if "reactions" in self.data else np.zeros(self.size)

    def force_row(self, label: int) -> int:
        """Return the first equilibrium row of a node: after the momenta definitions of a dynamic one."""
        starts = sorted([*self.first.values(), self.reaction_start])
        return self.first[label] + (6 if starts[starts.index(self.first[label]) + 1] - self.first[label] == 12 else 0)

    @property
    def reaction_start(self) -> int:
        """Return the first reaction: MBDyn numbers nodes first."""
        if self.joint:
            return min(self.joint.values())
        return self.size - 11  # the c09 files without a table: clamp 6, revolute hinge 5

    def state(self) -> Floats:
        """Return MBDyn's momenta and reactions in the order of the unknowns."""
        y = self.reactions.copy()
        if "beta" in self.data:
            for row in self.data["beta"]:
                first = self.first[int(row[0])]
                y[first + 6 : first + 12] = row[1:7]
        return y

    def solve(self, solver: SolverClient, directory: Path) -> tuple[Floats, Floats]:
        """Return this program's matrices at MBDyn's state, scaled as MBDyn scales."""
        state, output = directory / "state.h5", directory / "out.h5"
        with h5py.File(state, "w") as file:
            file["vectors"] = self.state()[:, None]
        if self.static and not self.name.endswith("_00"):
            solver.request("static", name=self.deck, output=output)
        else:
            solver.request("linearise", name=self.deck, output=output, state=str(state))
        with h5py.File(output) as file:
            assert float(file["scalars"][0, 0]) == self.c
            pair = np.array(file["J_plus"]), np.array(file["J_minus"])
        for J, c in zip(pair, (self.c, -self.c), strict=True):
            J[self.reaction_start :] /= c
            J[:, self.reaction_start :] /= c
        return pair


def agree(case: Case, ours: tuple[Floats, Floats], known: Floats | None = None, damping: Floats | None = None) -> None:
    """Check both matrices, given what MBDyn's lack: `known` times +-c, `damping` as it is."""
    n = case.size
    known = np.zeros((n, n)) if known is None else known
    damping = np.zeros((n, n)) if damping is None else damping
    for J, A, c in ((ours[0], case.Aplus, case.c), (ours[1], case.Aminus, -case.c)):
        scale = np.abs(A).max()
        error = np.abs(J - (A + c * known + damping)) / scale
        worst = np.unravel_index(error.argmax(), error.shape)
        assert error.max() < TOLERANCE, f"{case.name}: entry {worst} is off by {error.max():.2e}"


def differs(case: Case, ours: tuple[Floats, Floats]) -> float:
    """Return how far MBDyn's Aplus is from ours, relative to its largest entry."""
    return float(np.abs(ours[0] - case.Aplus).max() / np.abs(case.Aplus).max())


@pytest.mark.parametrize("name", EXACT)
def test_exact(name: str, solver: SolverClient, tmp_path: Path) -> None:
    case = Case(name)
    agree(case, case.solve(solver, tmp_path))


@pytest.mark.parametrize("name", list(IN_LINE))
def test_in_line(name: str, solver: SolverClient, tmp_path: Path) -> None:
    # MBDyn puts -F x of node 2's force row on node 2's rotation instead of node 1's; its -F x q x has the wrong sign.
    case = Case(name)
    ends = {"106": (5, 4), "2": (1, 2), "3": (1, 3)}
    known = np.zeros((case.size, case.size))
    for label in IN_LINE[name]:
        node1, node2 = ends[label]
        row2, reaction = case.force_row(node2), case.joint[label]
        axes = case.Aplus[row2 : row2 + 3, reaction : reaction + 2]  # the line's two normals
        F = axes @ case.reactions[reaction : reaction + 2]
        moments = case.Aplus[row2 + 3 : row2 + 6, reaction : reaction + 2]  # q x normals
        e1, e2 = axes.T
        m1, m2 = moments.T
        q = _arm(e1, e2, m1, m2)
        g1, g2 = case.first[node1] + 3, case.first[node2] + 3
        known[row2 : row2 + 3, g1 : g1 + 3] -= skew(F)
        known[row2 : row2 + 3, g2 : g2 + 3] += skew(F)
        known[row2 + 3 : row2 + 6, g2 : g2 + 3] += 2.0 * skew(F) @ skew(q)
    ours = case.solve(solver, tmp_path)
    assert differs(case, ours) > 1e-5
    agree(case, ours, known)


def _arm(e1: Floats, e2: Floats, m1: Floats, m2: Floats) -> Floats:
    """Return q from q x e1 = m1 and q x e2 = m2."""
    A = np.vstack([-skew(e1), -skew(e2)])
    return np.asarray(np.linalg.lstsq(A, np.concatenate([m1, m2]), rcond=None)[0])


@pytest.mark.parametrize("name", DEFORMABLE)
def test_deformable_joint(name: str, solver: SolverClient, tmp_path: Path) -> None:
    # At t0 MBDyn takes the derivative of the relative rotation vector as that of the relative rotation: Gamma^-1 = I.
    case = Case(name)
    upper = [900.0, 10, 5, 2, 3, 1, 800, 4, 1, 2, 3, 700, 2, 1, 4, 50, 3, 1, 40, 2, 30]
    K = np.zeros((6, 6))
    K[np.triu_indices(6)] = upper
    K += np.triu(K, 1).T
    Ra = case.R[1] @ euler123(0.02, 0.01, 0.03)
    theta = Rotation.from_matrix(Ra.T @ case.R[2] @ euler123(0.04, 0.02, 0.05)).as_rotvec()
    angle = float(np.linalg.norm(theta))
    t = skew(theta)
    gamma_inverse = np.eye(3) - 0.5 * t + (1.0 - 0.5 * angle / np.tan(0.5 * angle)) / angle**2 * t @ t
    frame = np.kron(np.eye(2), Ra)
    missing = frame @ K[:, 3:] @ (gamma_inverse - np.eye(3)) @ Ra.T  # force and moment by the relative rotation
    d2 = case.R[2] @ [-0.2, 0.01, 0.03]
    d1 = case.x[2] + d2 - case.x[1]
    known = np.zeros((case.size, case.size))
    for node, arm, sign in ((1, d1, -1.0), (2, d2, 1.0)):
        rows = case.force_row(node)
        wrench = np.vstack([missing[:3], missing[3:] + skew(arm) @ missing[:3]])
        for other, direction in ((1, -1.0), (2, 1.0)):
            columns = case.first[other] + 3
            known[rows : rows + 6, columns : columns + 3] += sign * direction * wrench
    ours = case.solve(solver, tmp_path)
    assert differs(case, ours) > 1e-5
    agree(case, ours, known)


def test_total_pin(solver: SolverClient, tmp_path: Path) -> None:
    # MBDyn has (F x fn) x where the moment arm's derivative is F x fn x.
    case = Case("c07_total")
    F = euler123(0.1, 0.2, 0.3) @ case.reactions[case.joint["2"] : case.joint["2"] + 3]
    arm = case.R[2] @ [0.1, 0.05, -0.02]
    known = np.zeros((case.size, case.size))
    row, column = case.force_row(2) + 3, case.first[2] + 3
    known[row : row + 3, column : column + 3] = skew(F) @ skew(arm) - skew(np.cross(F, arm))
    ours = case.solve(solver, tmp_path)
    assert differs(case, ours) > 1e-5
    agree(case, ours, known)


def _muscle_errors(name: str, x: float, v: float) -> tuple[float, float]:
    """Return what MBDyn's derivatives of the force by x and v lack, over F0 (activation reference 0.4)."""
    a_ref, kp, kd, l_ref = 0.4, 2.0, 0.15, 0.305 / 0.32
    u = x - 0.95
    f1 = np.exp(u**2 - 40.0 * u**4)
    df1 = f1 * (2.0 * u - 160.0 * u**3)
    power = np.exp(0.1 / (v - 1.0) ** 2 - 1.1 / (v - 1.0) ** 4)
    f2 = 1.6 - 1.6 * power
    df2 = 1.6 * power * (0.2 / (v - 1.0) ** 3 - 4.4 / (v - 1.0) ** 5)
    a = a_ref + kp * (x - l_ref) + kd * v
    if "reflexive" in name:  # MBDyn multiplies the slopes by the reference activation
        return df1 * f2 * (a - a_ref), f1 * df2 * (a - a_ref)
    if "erf" in name:  # MBDyn's slope has 2/pi for 2/sqrt(pi) and squares a factor 100 with its argument
        p, q, r = 10.0 * (x - 0.55), 5.0 * (x - 0.85), 2.4 * (x - 1.35)
        true = 2.0 / np.sqrt(np.pi) * (4.0 * np.exp(-(p**2)) + np.exp(-(q**2)) - 1.44 * np.exp(-(r**2)))
        coded = 2.0 / np.pi * (4.0 * np.exp(-10.0 * (10.0 * p) ** 2) + np.exp(-(q**2)) - 1.44 * np.exp(-(r**2)))
        return (true - coded) * f2 * a_ref, 0.0
    if "ergonomy" in name:  # the force does not depend on velocity, MBDyn's derivative does
        return 0.0, -f1 * df2 * a_ref
    assert "srs" in name  # short range stiffness: reference activation in the slope, no damping
    return df1 * f2 * (a - a_ref), f1 * (df2 * a + f2 * kd)


@pytest.mark.parametrize("name", MUSCLES)
def test_muscles(name: str, solver: SolverClient, tmp_path: Path) -> None:
    case = Case(name)
    L0, l_ref0, V0, F0 = 0.3, 0.32, 1.2, 150.0
    x1, x2, arm1 = case.x[10], case.x[1], case.R[10] @ [0.02, 0.01, 0.0]
    arm2 = case.R[1] @ [-0.03, 0.02, 0.05]
    w = np.array([0.4, -0.8, 0.3]) if "moving" in name else np.zeros(3)
    pin = np.array([float(re.search(rf"P{k} = ([^;]+);", case.deck.read_text())[1]) for k in "XYZ"])  # type: ignore[index]
    u = x2 + arm2 - x1 - arm1
    udot = np.cross(w, x2 + arm2 - pin)
    length = float(np.linalg.norm(u))
    by_x, by_v = _muscle_errors(name, length / l_ref0, float(u @ udot) / length / V0)
    k, d = F0 * by_x * L0 / l_ref0, F0 * by_v * L0 / V0  # by strain and strain rate
    # dF = [u u^T k/(L0 l^2) + u d/(L0 l^2) (udot - u (u.udot)/l^2)^T] du + u u^T d/(L0 l^2) dudot
    stiffness = np.outer(u, u) * k / (L0 * length**2)
    stiffness += np.outer(u, udot - u * (u @ udot) / length**2) * d / (L0 * length**2)
    viscous = np.outer(u, u) * d / (L0 * length**2)
    n = case.size
    known, damping = np.zeros((n, n)), np.zeros((n, n))
    for node, arm, sign in ((10, arm1, -1.0), (1, arm2, 1.0)):
        rows = case.force_row(node)
        wrench = sign * np.vstack([np.eye(3), skew(arm)])
        for other, lever, direction, spin in ((10, arm1, -1.0, np.zeros(3)), (1, arm2, 1.0, w)):
            c = case.first[other]
            known[rows : rows + 6, c : c + 3] += direction * wrench @ stiffness
            # with dw = dgdot - w x dg: d(w x arm) = -arm x dgdot - (w x arm) x dg
            by_g = -stiffness @ skew(lever) - viscous @ skew(np.cross(spin, lever))
            known[rows : rows + 6, c + 3 : c + 6] += direction * wrench @ by_g
            damping[rows : rows + 6, c : c + 3] += direction * wrench @ viscous
            damping[rows : rows + 6, c + 3 : c + 6] -= direction * wrench @ viscous @ skew(lever)
    ours = case.solve(solver, tmp_path)
    assert differs(case, ours) > 1e-5
    agree(case, ours, known, damping)


@pytest.mark.parametrize("name", STATIC)
def test_static_gravity(name: str, solver: SolverClient, tmp_path: Path) -> None:
    # MBDyn has +c a x S x in the moment row of a static body, the derivative is -c a x S x.
    case = Case(name)
    gravity = np.array([0.0, 0.0, -9.81])
    S = 2.0 * case.R[1] @ [0.02, 0.03, -0.04]
    if name.startswith("c09d"):  # X0 is the predicted pose; the solution is the equilibrium of case c09c
        S = 2.0 * euler123(0.0, 0.352218199101, 0.0) @ [0.02, 0.03, -0.04]
    known = np.zeros((case.size, case.size))
    row, column = case.force_row(1) + 3, case.first[1] + 3
    known[row : row + 3, column : column + 3] = -2.0 * skew(gravity) @ skew(S)
    ours = case.solve(solver, tmp_path)
    assert differs(case, ours) > 1e-5
    agree(case, ours, known)


def test_static_equilibrium(solver: SolverClient, tmp_path: Path) -> None:
    # Independent root finding on the moment about the hinge: 0.352218199101 rad; MBDyn's reactions there.
    for name in ("c09a_static_01", "c09d_static_ie_01"):
        case = Case(name)
        solver.request("static", name=case.deck, output=tmp_path / "out.h5")
        with h5py.File(tmp_path / "out.h5") as file:
            y, R = np.array(file["vectors"])[:, 0], np.array(file["nodes"])[0, 3:12].reshape(3, 3)
        assert np.arctan2(R[0, 2], R[0, 0]) == pytest.approx(0.352218199101, abs=2e-12)
        assert y[case.reaction_start :] == pytest.approx(case.reactions[case.reaction_start :], abs=1e-9)


def test_reactions_at_rest(solver: SolverClient, tmp_path: Path) -> None:
    # Where MBDyn's start-up solves the accelerations exactly: constraints met to the last digit, or equilibrium.
    for name, tolerance in (
        ("c01a_revpin_rest", 1e-12),
        ("c02a_sphpin_rest", 1e-12),
        ("c09c_ivp_equilibrium", 1e-12),
        ("arm_right", 1e-9),
    ):
        case = Case(name)
        solver.request("linearise", name=case.deck, output=tmp_path / "out.h5")
        with h5py.File(tmp_path / "out.h5") as file:
            y = np.array(file["vectors"])[:, 0]
        start = case.reaction_start
        assert y[start:] == pytest.approx(case.reactions[start:], abs=tolerance), name
