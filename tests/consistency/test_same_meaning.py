"""The same mechanism in other words: old forms, other orders, frames, cases, comments give the same matrices.

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

NODE_1 = "structural: 1, dynamic, null, eye, null, null;\n"
NODE_2 = "structural: 2, dynamic, 0.3, 0.1, 0.2, euler, 0.1, 0.2, -0.3, null, null;\n"
BODIES = "body: 1, 1, 1., null, eye;\nbody: 2, 2, 2., 0.01, 0.02, 0.03, diag, 1., 2., 2.5;\n"
FRAME = "reference: 9, 0.3, 0.1, 0.2, euler, 0.1, 0.2, -0.3, null, null;\n"
SPHERE = "joint: 1, spherical hinge, 1, position, 0.3, 0.1, 0.2, 2, position, null;"
HINGE = (
    "joint: 1, revolute hinge, 1, position, 0.3, 0.1, 0.2, orientation, euler, 0.1, 0.2, -0.3, "
    "2, position, null, orientation, eye;"
)
PIN = (
    "joint: 1, revolute pin, 2, position, 0.1, 0., 0., hinge, eye, "
    "position, reference, 9, 0.1, 0., 0., hinge, reference, 9, eye;"
)
TOTAL = (
    "joint: 1, total joint, 1, position, 0.3, 0.1, 0.2, position orientation, eye, "
    "rotation orientation, euler, 0.1, 0.2, -0.3, 2, position, null, position orientation, eye, "
    "rotation orientation, eye, "
    "position constraint, 1, 1, 1, null, orientation constraint, 1, 1, 0, null;"
)
ROD = "joint: 1, rod, 1, 2, 0.4, linear elastic, 100.;"
SPRING = (
    "joint: 1, deformable hinge, 1, orientation, euler, 0.1, 0.2, -0.3, 2, orientation, eye, "
    "linear elastic generic, diag, 10., 20., 30.;"
)
FORCE = "force: 1, absolute, 1, position, 0.1, 0., 0., 0., 0., 1., const, 3.;"
PIECES = {"sphere": SPHERE, "hinge": HINGE, "pin": PIN, "total": TOTAL, "rod": ROD, "spring": SPRING, "force": FORCE}

# Which piece, what of it, in which other words.
WORDS = [
    ("sphere", "position, ", ""),
    ("sphere", "0.2, 2, position", "0.2, hinge, eye, 2, position"),
    ("sphere", "position, null", "position, reference, other position, null"),
    ("sphere", "2, position, null", "2"),
    ("sphere", "position, 0.3", "position, reference, global, 0.3"),
    ("sphere", "1, spherical hinge", '1, name, "J; , # \\"", spherical hinge'),
    ("sphere", "joint: 1, spherical hinge", "JOINT :/* a; */1,# b;\n SphericalHinge"),
    ("sphere", "0.3, 0.1, 0.2", "3., 1., 2., scale, .1"),
    ("sphere", "null;", "null, output, no;"),
    ("hinge", "revolute hinge", "plane hinge"),
    ("hinge", "orientation", "hinge"),
    ("hinge", "position, ", ""),
    ("hinge", "position, null, orientation, eye", "position, null"),
    (
        "hinge",
        "null, orientation, eye",
        "reference, other position, null, orientation, reference, other orientation, eye",
    ),
    ("hinge", "orientation, eye;", "orientation, eye, initial theta, 0.2;"),
    ("hinge", "orientation, eye;", "orientation, eye, orientation description, euler123;"),
    ("hinge", "orientation, eye", "orientation, 1, 1., 0., 0., 2, 0., 1., 0."),
    ("hinge", "orientation, eye", "orientation, 3, 0., 0., 2., 2, 0., 1., 7."),
    ("hinge", "orientation, eye", "orientation, matr, 1., 0., 0., 0., 1., 0., 0., 0., 1."),
    ("hinge", "euler, 0.1, 0.2, -0.3", "euler123, degrees, 0.1*rad2deg, 0.2*180/pi, -0.3*rad2deg"),
    (
        "hinge",
        "0.3, 0.1, 0.2, orientation, euler, 0.1, 0.2, -0.3",
        "reference, 9, null, orientation, reference, 9, eye",
    ),
    ("pin", "revolute pin", "plane pin"),
    ("pin", "position, ", ""),
    ("total", "1, 1, 1, null", "active, active, active, null"),
    ("total", "1, 1, 1, null", "position, position, position, component, null, 0., const, 0."),
    ("total", "1, 1, 0, null", "rotation, TRUE, inactive, single, 1., 0., 0., null"),
    ("total", "position orientation, eye, ", ""),
    ("rod", "linear elastic", "linear elastic isotropic"),
    ("rod", "100.", "100., prestrain, const, 0."),
    ("rod", "100.", 'model::current("L0")*250.'),
    ("rod", "rod, 1, 2", "rod, 1, position, null, 2, position, null"),
    ("rod", "rod, 1, 2", "rod with offset, 1, null, 2, null"),
    ("rod", "linear elastic, 100.", "reference, 5"),
    ("spring", "1, orientation", "1, position, null, orientation"),
    ("spring", "orientation", "hinge"),
    ("spring", "diag, 10., 20., 30.", "matr, 10., 0., 0., 0., 20., 0., 0., 0., 30."),
    ("spring", "diag, 10., 20., 30.", "sym, 1., 0., 0., 2., 0., 3., scale, 10."),
    ("force", "0., 0., 1., const, 3.", "single, 0., 0., 1., 3."),
    ("force", "0., 0., 1., const, 3.", "component, inactive, null, const, 3."),
    ("force", "0., 0., 1., const, 3.", "array, 2, 0., 0., 1., 1., 0., 0., 2., const, 1."),
    ("force", "0., 0., 1., const, 3.", "single, reference, node, 0., 0., 1., reference, 6"),
    ("force", "position, ", ""),
    ("force", "absolute", "conservative"),
]
NODES = [
    ("0.3, 0.1, 0.2, euler, 0.1, 0.2, -0.3, null, null", "at reference, 9"),
    (
        "0.3, 0.1, 0.2, euler, 0.1, 0.2, -0.3, null, null",
        "position, reference, 9, null, orientation, reference, 9, eye, velocity, null, angular velocity, null",
    ),
    ("-0.3, null", "-0.3, orientation description, euler321, null"),
    ("null, null;", "null, null, assembly, 1., 1., no, scale, default, output, yes, accelerations, yes;"),
    ("2, dynamic", '2, name, "two", dynamic'),
]


def read(prefix: Path, elements: str, node: str = NODE_2) -> dict[str, np.ndarray]:
    joints, forces = (len(re.findall(rf"\b{card}\s*:", elements, re.IGNORECASE)) for card in ("joint", "force"))
    deck = prefix.with_suffix(".mbd")
    deck.write_text(
        "begin: data; problem: initial value; end: data;\nbegin: initial value;\ninitial time: 0.; final time: 1.; "
        "time step: 1e-2; method: ms, .6; eigenanalysis: 0., parameter, 0.02;\nend: initial value;\n"
        f"begin: control data; structural nodes: 2; rigid bodies: 2; joints: {joints}; forces: {forces}; "
        f"end: control data;\n{FRAME}constitutive law: 5, 1, linear elastic, 100.;\ndrive caller: 6, const, 3.;\n"
        f"begin: nodes;\n{NODE_1}{node}end: nodes;\nbegin: elements;\n{BODIES}{elements}\nend: elements;\n"
    )
    subprocess.run([find_mbdae(), deck, "-q", "-o", prefix], check=True, stdout=subprocess.PIPE)
    with h5py.File(prefix.with_suffix(".h5")) as file:
        return {key: file[key][()] for key in ("J_plus", "J_minus", "nodes", "vectors")}


def same(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> None:
    for key, value in a.items():
        np.testing.assert_allclose(value, b[key], rtol=1e-12, atol=1e-13, err_msg=key)


@pytest.mark.parametrize("piece", PIECES)
def test_elements_in_other_words(tmp_path: Path, piece: str) -> None:
    plain = read(tmp_path / "plain", PIECES[piece])
    for name, old, new in WORDS:
        if name == piece:
            assert old in PIECES[piece], old
            same(plain, read(tmp_path / "other", PIECES[piece].replace(old, new)))


def test_nodes_in_other_words(tmp_path: Path) -> None:
    plain = read(tmp_path / "plain", SPHERE)
    for old, new in NODES:
        assert old in NODE_2
        same(plain, read(tmp_path / "other", SPHERE, NODE_2.replace(old, new)))
