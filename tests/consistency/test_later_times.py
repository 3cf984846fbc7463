"""Matrices of a mechanism on its way against those of the same mechanism started where it is then.

The second deck holds the pose and velocities that the first one's file tells, so momenta, reactions and matrices must
come out alike; they differ by the error of the time steps in the velocities alone.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import h5py
import numpy as np
import pytest

from pilotgen.solver.client import find_mbdae

NODES = "structural: 1, dynamic, 0.4, 0., 0., eye, null, null;\nstructural: 2, dynamic, 0.9, 0., 0., eye, null, null;\n"
BODIES = "body: 1, 1, 2., 0.05, 0.02, 0.01, diag, .1, .2, .3;\nbody: 2, 2, 1., null, diag, .05, .06, .07;\n"
GRAVITY = "gravity: uniform, 0., 0., -1., 9.81;\n"
PIN = "joint: 1, spherical pin, 1, position, -0.4, 0., 0., position, null;\n"
MECHANISMS = {
    "two pendulums, a rod": PIN
    + "joint: 2, cardano hinge, 1, position, .25, 0., 0., 2, position, -.25, 0., 0.;\n"
    + "joint: 3, rod, 1, 2, position, 0., .1, 0., .5, linear viscoelastic, 300., 5.;\n",
    "an imposed motion between them": PIN
    + "joint: 2, total joint, 1, position, .25, 0., 0., 2, position, -.25, 0., 0., position constraint, 1, 1, 1, "
    + "component, cosine, 0., 5., .05, forever, 0., null, null, orientation constraint, 1, 1, 0, null;\n",
    "a mass on springs on a driven seat": "joint: 1, total pin joint, 1, position, null, position, .4, 0., 0., "
    + "position constraint, 1, 1, 1, component, null, null, cosine, 0., 20., .02, forever, 0., "
    + "orientation constraint, 1, 1, 1, null;\n"
    + "joint: 2, deformable joint, 1, position, .5, 0., 0., 2, position, null, linear viscoelastic generic, "
    + "diag, 500., 500., 800., 3., 4., 5., proportional, .01;\n",
}


def linearise(prefix: Path, nodes: str, elements: str, start: float, times: str) -> None:
    joints = len(re.findall("joint:", elements))
    deck = prefix.with_suffix(".mbd")
    deck.write_text(
        "begin: data; problem: initial value; end: data;\nbegin: initial value;\n"
        f"initial time: {start!r}; final time: 2.; time step: 5e-4; method: ms, .6; tolerance: 1e-10; "
        f"max iterations: 30; eigenanalysis: {times}, parameter, 0.02;\nend: initial value;\n"
        f"begin: control data; structural nodes: 2; rigid bodies: 2; joints: {joints}; gravity; end: control data;\n"
        f"begin: nodes;\n{nodes}end: nodes;\nbegin: elements;\n{BODIES}{elements}{GRAVITY}end: elements;\n"
    )
    subprocess.run([find_mbdae(), deck, "-q", "-o", prefix], check=True, stdout=subprocess.PIPE)


def matrices(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    with h5py.File(path) as file:
        return file["J_plus"][()], file["J_minus"][()], file["nodes"][()]


@pytest.mark.parametrize("name", MECHANISMS)
def test_matrices_on_the_way(tmp_path: Path, name: str) -> None:
    linearise(tmp_path / "way", NODES, MECHANISMS[name], 0.0, "list, 3, 0., 0.3, 0.77")
    for k, time in ((1, 0.3), (2, 0.77)):
        plus, minus, nodes = matrices(tmp_path / f"way_{k:02d}.h5")
        rows = [", ".join(map(repr, [*map(float, node)])) for node in nodes]
        there = "".join(
            "structural: {}, dynamic, {}, matr, {}, {}, {};\n".format(
                i + 1, *(", ".join(row.split(", ")[a:b]) for a, b in ((0, 3), (3, 12), (12, 15), (15, 18)))
            )
            for i, row in enumerate(rows)
        )
        linearise(tmp_path / "there", there, MECHANISMS[name], time, repr(time))
        plus_there, minus_there, _ = matrices(tmp_path / "there.h5")
        largest = np.abs(plus_there).max()
        assert np.abs(plus - plus_there).max() < 3e-6 * largest
        assert np.abs(minus - minus_there).max() < 3e-6 * largest
        assert np.abs(plus - plus_there).max() > 0.0  # not the initial state again, nor the same file
