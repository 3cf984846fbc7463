"""Linear models for tests: MBDyn's stored cases, and mechanisms assembled from M, D, K and constraints.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pilotgen.linear.imposed_motion import COLLECTIVE, Channels
from pilotgen.solver.descriptor import DescriptorModel
from pilotgen.solver.matrices import Matrices, given_tables
from pilotgen.solver.mbdyn_files import RawEigenanalysis, to_textbook

CASES = Path(__file__).parent / "data" / "mbdyn_cases"
# Names of the golden arm's unknowns: MBDyn's files know labels only (1 = seat, 2 = lever).
ARM_CHANNELS = Channels(seat="node 1", outputs={COLLECTIVE: {"node 2.gz": 1.0}})
ARM_LEVER_LENGTH_M = 0.32

Floats = NDArray[np.float64]
_UNKNOWNS = ("x", "y", "z", "gx", "gy", "gz", "bx", "by", "bz", "hx", "hy", "hz")
_KINDS = ("position",) * 3 + ("rotation",) * 3 + ("momentum",) * 3 + ("momenta_moment",) * 3


def raw_case(name: str) -> RawEigenanalysis:
    """Return what MBDyn wrote for a stored case, joints named by its own table of unknowns."""
    data = np.load(CASES / f"{name}.npz")
    joints = re.findall(r"Joint\((\d+)\): \d+ (\d+)", str(data["dof_table"])) if "dof_table" in data else []
    return RawEigenanalysis(
        path=f"{name}.npz",
        c=float(data["dCoef"]),
        time=0.0,
        Aplus=data["Aplus"],
        Aminus=data["Aminus"],
        labels=data["labels"].reshape(-1).astype(np.int64),
        first=data["idx"].reshape(-1).astype(np.int64),
        joint_labels=np.array([label for label, _ in joints], dtype=np.int64),
        joint_first=np.array([first for _, first in joints], dtype=np.int64) - 1,
    )


def case(name: str) -> Matrices:
    """Return a stored MBDyn case in the textbook convention."""
    return to_textbook(raw_case(name))


def assemble(
    nodes: Sequence[tuple[str, bool]],
    joints: Sequence[tuple[str, int]],
    M: Floats,
    D: Floats,
    K: Floats,
    Phi: Floats,
    B: Floats | None = None,
    Phi_rate: Floats | None = None,
    gyro: Floats | None = None,
    momentum_force: Floats | None = None,
    c: float = 0.01,
) -> Matrices:
    """Assemble M q'' + D q' + K q + B r = 0, Phi_rate q' + Phi q = 0 with momenta p = M q' + gyro q as a matrix pair.

    `nodes` are (name, dynamic), six coordinates each; `joints` are (name, number of equations). All matrices are over
    the coordinates of all nodes in order; rows of M and gyro of static nodes are not used. `momentum_force` (n_q, n_q)
    adds momentum_force p to the equilibrium equations.
    """
    n_q, n_r = 6 * len(nodes), sum(count for _, count in joints)
    names: list[str] = []
    kinds: list[str] = []
    q, p, definition, equilibrium = [], [], [], []
    for name, dynamic in nodes:
        first = len(names)
        q += range(first, first + 6)
        names += [f"{name}.{unknown}" for unknown in _UNKNOWNS[: 12 if dynamic else 6]]
        kinds += _KINDS[: 12 if dynamic else 6]
        equilibrium += range(first + 6, first + 12) if dynamic else range(first, first + 6)
        if dynamic:
            p += range(first + 6, first + 12)
            definition += range(first, first + 6)
    r = list(range(len(names), len(names) + n_r))
    for name, count in joints:
        names += [f"{name}.reaction[{k + 1}]" for k in range(count)]
        kinds += ["reaction"] * count
    n = len(names)
    moving = [q.index(row) for row in definition]
    g_y, g_ydot = np.zeros((n, n)), np.zeros((n, n))
    g_ydot[np.ix_(definition, q)] = M[moving]
    g_y[definition, p] = -1.0
    if gyro is not None:
        g_y[np.ix_(definition, q)] = gyro[moving]
    g_ydot[np.array(equilibrium)[moving], p] = 1.0
    if momentum_force is not None:
        g_y[np.ix_(equilibrium, p)] = momentum_force[:, moving]
    g_ydot[np.ix_(equilibrium, q)] = D
    g_y[np.ix_(equilibrium, q)] = K
    g_y[np.ix_(equilibrium, r)] = Phi.T if B is None else B
    g_y[np.ix_(r, q)] = Phi
    if Phi_rate is not None:
        g_ydot[np.ix_(r, q)] = Phi_rate
    assert len(q) == n_q
    return Matrices(
        path="assembled",
        solver="test",
        deck_sha256="0" * 64,
        analysis="linearise",
        c=c,
        time=0.0,
        J_plus=g_ydot + c * g_y,
        J_minus=g_ydot - c * g_y,
        names=np.array(names, dtype=np.bytes_),
        kinds=np.array(kinds, dtype=np.bytes_),
        _table=given_tables("assembled", {}),
    )


def random_mechanism(rng: np.random.Generator, n_nodes: int, n_constraints: int, moving: bool = False) -> Matrices:
    """Return bodies with dense mass, damping and stiffness, natural frequencies near 1 rad/s, and constraints."""
    n_q = 6 * n_nodes

    def positive(spread: float) -> Floats:
        X = rng.normal(size=(n_q, n_q))
        return spread * (X @ X.T / n_q + np.eye(n_q))

    D = 0.3 * positive(1.0) + 0.2 * rng.normal(size=(n_q, n_q)) / np.sqrt(n_q)
    K = positive(2.0) + 0.3 * rng.normal(size=(n_q, n_q)) / np.sqrt(n_q)  # follower forces: not symmetric
    Phi = rng.normal(size=(n_constraints, n_q))
    signs = rng.choice([-1.0, 1.0], size=n_constraints)  # reactions may have the other sign than their constraint
    extra = {
        "gyro": 0.2 * rng.normal(size=(n_q, n_q)) / np.sqrt(n_q),
        "momentum_force": 0.2 * rng.normal(size=(n_q, n_q)) / np.sqrt(n_q),
    }
    return assemble(
        [(f"body_{k}", True) for k in range(n_nodes)],
        [("joint", n_constraints)],
        positive(1.0),
        D,
        K,
        Phi,
        B=(Phi * signs[:, None]).T,
        **(extra if moving else {}),
    )


def dense_eigenvalues(model: DescriptorModel, largest: float = 1e3) -> NDArray[np.complex128]:
    """Return the finite, nonzero eigenvalues of the full pencil by QZ, sorted.

    Index-3 constraints make infinite eigenvalues that round-off pulls down to about eps^(-1/3) = 1.6e5: `largest`
    [rad/s] must separate them from the model's own.
    """
    with np.errstate(all="ignore"):
        lam = scipy.linalg.eigvals(-model.g_y, model.g_ydot)
    lam = lam[np.isfinite(lam)]
    return sort(lam[(np.abs(lam) < largest) & (np.abs(lam) > 1e-6)])


def sort(lam: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Sort by imaginary, then real part, with round-off in the first disregarded."""
    return lam[np.lexsort((lam.real, np.round(lam.imag, 6)))]
