"""MBDyn's cases of springs, the closed loop and friction: matrices entry by entry, poles, histories.

Each case has what MBDyn wrote (`Aplus`, `Aminus`) and, beside it, the derivative of an independent residual at the
same state by finite differences (`exact_Aplus`, `exact_Aminus`, good to some 1e-9). Where the two agree this program
must equal MBDyn's entry; where they differ, MBDyn's tangent lacks a term and this program must equal the derivative.
Cases: MBDyn develop (2025-07), 17 digits, c = 0.01 s; MBDyn divides constraint rows and the columns of algebraic
unknowns by c.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import re
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
    "g01_statespace_open": "",
    "g02_force_drives": "forces driven by the state",
    "g03_loop_net": "",
    "g04_loop_net_unstable": "",
    "g05_loop_follower": "",
    "g06_mimo_nodedof": "inputs of the state space",
    "g07_drives": "everything driven by the state",
    "g08_mimo_signtrick": "",
    "g11_joints": "plane with offset, prismatic joint",
    "g12_lugre": "",
    "g14_loop_gravity": "",
    "g15a_loop_friction_small": "",
    "g15b_loop_friction_large": "",
    "g17_genels": "",
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
            solver.request("linearise", name=self.deck, output=output)
            with h5py.File(output) as file:
                own = np.array(file["vectors"][:, 0])
                scalar = np.isin(json.loads(file["structure"][0])["dofs"]["kind"], ["state", "algebraic"])
            y = self.state()
            y[scalar & (y == 0.0)] = own[scalar & (y == 0.0)]  # what MBDyn's reactions do not hold
            options["state"] = str(directory / "state.h5")
            with h5py.File(options["state"], "w") as file:
                file["vectors"] = y[:, None]
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
        if not len(self.data["beta"]):
            return y
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


# Case -> largest difference from MBDyn's own history, relative to the largest value of each quantity. Friction: the
# iteration stops at the deck's tolerance, where bristles and sliding are stiff; g07: MBDyn leaves the couplings out of
# its matrix and stops after more and coarser iterations.
HISTORIES = {
    "g01_statespace_open": 1e-10,
    "g02_force_drives": 1e-8,
    "g03_loop_net": 1e-8,
    "g04_loop_net_unstable": 1e-8,
    "g05_loop_follower": 1e-8,
    "g06_mimo_nodedof": 1e-6,
    "g07_drives": 1e-4,
    "g08_mimo_signtrick": 1e-8,
    "g12_lugre": 1e-5,
    "g13_coulomb": 1e-8,
    "g14_loop_gravity": 1e-7,
    "g15a_loop_friction_small": 2e-5,
    "g15b_loop_friction_large": 2e-5,
    "g18_arm_loop": 5e-6,
    "g19_arm_loop_unstable": 5e-6,
}
# Levers with friction against their own equation of motion, integrated independently: as near as MBDyn [rad].
FRICTION = {"g12_lugre": (1.1e-8, 7e-6, 2.3e-5), "g13_coulomb": (1e-15, 1.3e-5, 2e-4)}
NODE = ("x", "y", "z", "gx", "gy", "gz", "vx", "vy", "vz", "wx", "wy", "wz")


def integrate(name: str, solver: SolverClient, directory: Path, **options: object) -> dict[str, Floats]:
    """Return this program's history at MBDyn's stored instants, by channel and label: `2.gz`, `5.value`."""
    text = (CASES / f"{name}.mbd").read_text()
    frequency = re.search(r"output frequency: (\d+)", text)
    output = directory / "motion.h5"
    every = int(frequency[1]) if frequency else 1
    solver.request("integrate", name=CASES / f"{name}.mbd", output=output, every=every, **options)
    with h5py.File(output) as file:
        names = [name.decode() for name in file["channels/name"][:]]
        data = np.array(file["data"])
    labels = {m[1].lower(): m[2] for m in re.finditer(r"set: const integer (\w+) = (\d+);", text)}
    history = {}
    for channel, column in zip(names, data.T, strict=True):
        owner, quantity = channel.rsplit(".", 1)
        if owner.startswith("abstract node "):
            history[f"{owner[14:]}.value"] = column
        elif owner.startswith("node ") or owner in labels:
            history[f"{labels.get(owner, owner[5:])}.{quantity}"] = column
    return history


@pytest.mark.parametrize("name", list(HISTORIES))
def test_histories(name: str, solver: SolverClient, tmp_path: Path) -> None:
    history = integrate(name, solver, tmp_path, integrator="ms")
    with np.load(CASES / f"{name}.npz") as data:
        rows = data["rows"]
        compared = 0
        for key in data.files:
            match = re.fullmatch(r"h_(mov|abs)_(\d+)", key)
            if not match:
                continue
            quantities = NODE if match[1] == "mov" else ("value",)
            for quantity, theirs in zip(quantities, data[key].T, strict=False):
                ours = history[f"{match[2]}.{quantity}"][rows]
                # outputs of state spaces start at zero, in MBDyn as here, but are not written alike
                first = 1 if match[1] == "abs" else 0
                error = np.abs(ours - theirs)[first:].max()
                size = np.abs(data[key]).max() if quantity[0] in "vw" else np.abs(theirs).max()
                assert error <= HISTORIES[name] * size + 1e-10, f"{name}: {key} {quantity}: {error:.2e} of {size:.2e}"
                compared += 1
        assert compared > 1
        for k, limit in enumerate(FRICTION.get(name, ()), start=1):
            assert np.abs(history[f"{k}.gz"][rows] - data[f"ode_{k}"][0]).max() < limit


# Integration by IDA -> largest difference from the independent solution stored with the case (`ref`: height, coning,
# lever and their rates; g13: an integration with events), relative to the largest value of each; `ms` and MBDyn at
# h = 1 ms are off by up to 1.4e-4 (g04, g05), 9e-4 (g15b).
BY_IDA = {
    "g03_loop_net": 1e-5,
    "g04_loop_net_unstable": 2e-5,
    "g05_loop_follower": 1e-5,
    "g14_loop_gravity": 1e-5,
    "g15a_loop_friction_small": 1e-4,
    "g15b_loop_friction_large": 1e-4,
    "g12_lugre": 1e-5,
    "g13_coulomb": 5e-4,
}


@pytest.mark.parametrize("name", list(BY_IDA))
def test_variable_steps(name: str, solver: SolverClient, tmp_path: Path) -> None:
    history = integrate(name, solver, tmp_path, integrator="ida")
    with np.load(CASES / f"{name}.npz") as data:
        rows = data["rows"]
        if "ref" in data.files:
            seat = "1.z"
            pairs = [(history[seat], data["ref"][0]), (-history["2.gy"], data["ref"][2])]
        else:
            pairs = [(history[f"{k}.gz"], data[f"ode_{k}"][0]) for k in (1, 2, 3)]
        for ours, theirs in pairs:
            error = np.abs(ours[rows] - theirs).max()
            assert error <= BY_IDA[name] * np.abs(theirs).max() + 1e-12, f"{name}: {error:.2e}"


POLES = {
    "g03_loop_net": "closed_form",
    "g04_loop_net_unstable": "closed_form",
    "g05_loop_follower": "closed_form",
    "g06_mimo_nodedof": "closed_form",
    "g07_drives": "closed_form",
    "g08_mimo_signtrick": "closed_form",
    "g02_force_drives": "closed_form",
    "g18_arm_loop": "independent",
    "g19_arm_loop_unstable": "independent",
    "g20_arm_loop_twoway": "independent",
}


@pytest.mark.parametrize("name", list(POLES))
def test_closed_loop_poles(name: str, solver: SolverClient, tmp_path: Path) -> None:
    # Also where MBDyn's own eigenanalysis is wrong because its matrices lack the couplings (g02, g06, g07).
    case = LoopCase(name, solver, tmp_path)
    poles = case.poles()
    expected_poles = case.data[f"poles_{POLES[name]}"]
    for expected in expected_poles[abs(expected_poles) > 1e-2]:  # the height itself is a pole at zero
        assert np.abs(poles - expected).min() < 1e-7 * abs(expected)


def test_torso_poles(solver: SolverClient, tmp_path: Path) -> None:
    # The torso's deck was made from a spring-mass model with matrices of its own: its poles, and those MBDyn found.
    case = LoopCase("torso_lumped", solver, tmp_path)
    poles = case.poles()
    for expected in case.data["poles"]:
        assert np.abs(poles - expected).min() < 1e-8 * abs(expected)
