"""MBDyn's cases of springs and of the closed loop, entry by entry, and the poles of the torso they were made for.

Each case has what MBDyn wrote (`Aplus`, `Aminus`) and, beside it, the derivative of an independent residual at the
same state by finite differences (`exact_Aplus`, `exact_Aminus`, good to some 1e-9). Where the two agree this program
must equal MBDyn's entry; where they differ, MBDyn's tangent lacks a term and this program must equal the derivative.
Cases: MBDyn develop (2025-07), 17 digits, c = 0.01 s; MBDyn divides constraint rows and the columns of algebraic
unknowns by c.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.linalg
from numpy.typing import NDArray

from pilotgen.solver.client import SolverClient

Floats = NDArray[np.float64]

CASES = Path(__file__).parent.parent / "data" / "mbdyn_loop"
TOLERANCE = 1e-9  # of an entry, relative to the largest entry of the matrix
NOISE = 5e-9  # of the finite differences

# Case -> entries in which MBDyn's tangent differs from the derivative of its residual.
MATRICES = {
    "g09a_dispjoint_axial_rest": "force of the viscoelastic displacement joint; third row of Gamma^-1 (axial joint)",
    "g09b_dispjoint_axial_moving": "the same in motion",
    "g10_defjoint_invhinge": "",
    "g16a_torso_defjoint": "",
    "g16b_torso_dispjoint": "force of the viscoelastic displacement joint",
    "g16c_torso_elastic_viscous": "",
    "torso_lumped": "",
}


class LoopCase:
    """A stored case and this program's matrices at its state, scaled as MBDyn scales."""

    def __init__(self, name: str, solver: SolverClient, directory: Path) -> None:
        self.name = name
        self.deck = CASES / f"{name}.mbd"
        with np.load(CASES / f"{name}.npz") as data:
            self.data = {key: data[key] for key in data.files}
        self.c = float(self.data["dCoef"])
        output = directory / "out.h5"
        options = {}
        if "reactions" in self.data:
            options["state"] = str(directory / "state.h5")
            with h5py.File(options["state"], "w") as file:
                file["vectors"] = self.state()[:, None]
        solver.request("linearise", name=self.deck, output=output, **options)
        with h5py.File(output) as file:
            assert float(file["scalars"][0, 0]) == self.c
            dofs = json.loads(file["structure"][0])["dofs"]
            self.names = dofs["name"]
            self.kinds = np.array(dofs["kind"])
            self.textbook = np.array(file["J_plus"]), np.array(file["J_minus"])
        reaction = self.kinds == "reaction"
        algebraic = reaction | (self.kinds == "algebraic")
        with_rates = ((self.textbook[0] + self.textbook[1])[:, ~algebraic] != 0.0).any(axis=1)
        self.ours = []
        for J, c in zip(self.textbook, (self.c, -self.c), strict=True):
            scaled = J.copy()
            scaled[reaction & ~with_rates] /= c
            scaled[:, algebraic] /= c
            self.ours.append(scaled)

    def state(self) -> Floats:
        """Return MBDyn's momenta and reactions in the order of the unknowns."""
        y = np.array(self.data["reactions"])
        first = dict(zip(self.data["labels"].ravel().astype(int), self.data["idx"].ravel().astype(int), strict=True))
        for row in self.data["beta"]:
            start = first[int(row[0])] + 6
            y[start : start + 6] = row[1:7]
        return y

    def poles(self) -> NDArray[np.complex128]:
        """Return the finite eigenvalues of this program's own pencil, away from the origin."""
        g_ydot = 0.5 * (self.textbook[0] + self.textbook[1])
        g_y = (self.textbook[0] - self.textbook[1]) / (2.0 * self.c)
        values = scipy.linalg.eigvals(-g_y, g_ydot)
        return values[np.isfinite(values) & (abs(values) > 1e-2) & (abs(values) < 1e5)]


@pytest.mark.parametrize("name", list(MATRICES))
def test_matrices(name: str, solver: SolverClient, tmp_path: Path) -> None:
    case = LoopCase(name, solver, tmp_path)
    differing = 0
    for J, key in zip(case.ours, ("Aplus", "Aminus"), strict=True):
        A = case.data[key]
        scale = np.abs(A).max()
        exact = case.data.get(f"exact_{key}", A)
        lacking = np.abs(A - exact) > NOISE * scale
        differing += int(lacking.sum())
        error = np.where(lacking, np.abs(J - exact) * (TOLERANCE / NOISE), np.abs(J - A)) / scale
        row, column = np.unravel_index(error.argmax(), error.shape)
        assert error.max() < TOLERANCE, (
            f"{name}: {key}, equation of {case.names[row]} by {case.names[column]} is {J[row, column]:.12g}, "
            f"MBDyn's {A[row, column]:.12g}, derivative {exact[row, column]:.12g}"
        )
    assert (differing > 0) == bool(MATRICES[name])


def test_torso_poles(solver: SolverClient, tmp_path: Path) -> None:
    # The torso's deck was made from a spring-mass model with matrices of its own: its poles, and those MBDyn found.
    case = LoopCase("torso_lumped", solver, tmp_path)
    poles = case.poles()
    for expected in case.data["poles"]:
        assert np.abs(poles - expected).min() < 1e-8 * abs(expected)
