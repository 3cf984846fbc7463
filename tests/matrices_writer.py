"""A matrices file made of a `Matrices` in memory.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import orjson

from pilotgen.hdf5 import NewFile
from pilotgen.solver.datasets import CHECKSUM, DECK_HASH, FILETYPE, NUMBERS, STRUCTURE, TABLES, VERSION, checksum
from pilotgen.solver.matrices import Matrices

GROUPS = ("nodes", "joints", "inputs", "muscles")
VECTORS = ("y", "ydot", "residual", "equilibrium_residual")
MUSCLE_NUMBERS = ("length", "x", "v", "activation", "force")


def write_matrices(
    path: str | os.PathLike[str], matrices: Matrices, owners: np.ndarray | None = None, units: np.ndarray | None = None
) -> None:
    """Write a complete matrices file (the solver's own writer is in C++).

    Parameters
    ----------
    path : path
        File to write, replaced if it exists.
    matrices : Matrices
        What to write, with all its tables.
    owners, units : ndarray, shape (n,), optional
        Label of the owner and unit of each unknown; without them 0 and the unit that the kind implies
        (`N` for reactions).
    """
    by_kind = {b"position": b"m", b"rotation": b"rad", b"momentum": b"kg m/s", b"momenta_moment": b"kg m^2/s"}
    implied = [by_kind.get(bytes(kind), b"N") for kind in matrices.kinds]
    tables: dict[str, dict[str, Any]] = {
        "dofs": {
            "name": matrices.names,
            "kind": matrices.kinds,
            "owner": np.zeros(matrices.n, dtype=np.int64) if owners is None else owners,
            "unit": np.array(implied) if units is None else units,
        }
    }
    tables |= {group: vars(getattr(matrices, group)) for group in GROUPS}
    structure: dict[str, Any] = {"solver": matrices.solver, "analysis": matrices.analysis}
    for name, columns in TABLES.items():
        structure[name] = {
            column: [value.decode() if kind is str else int(value) for value in tables[name][column].tolist()]
            for column, kind in columns.items()
        }
    text = orjson.dumps(structure)
    text += b" " * (-len(text) % 8)
    nodes, muscles = matrices.nodes, matrices.muscles
    k = len(nodes.name)
    numbers = {
        "scalars": [[matrices.c, matrices.time]],
        "J_plus": matrices.J_plus,
        "J_minus": matrices.J_minus,
        "g_u": matrices.inputs.g_u,
        "vectors": np.column_stack([getattr(matrices, name) for name in VECTORS]),
        "nodes": np.hstack([nodes.position, nodes.orientation.reshape(k, 9), nodes.velocity, nodes.angular_velocity]),
        "muscles": np.column_stack([getattr(muscles, name) for name in MUSCLE_NUMBERS]),
    }
    values = {name: np.ascontiguousarray(numbers[name], dtype=np.float64) for name in NUMBERS}
    with NewFile(path, FILETYPE, VERSION, seal=False) as new:  # as the solver writes it
        new.file[DECK_HASH] = np.array([matrices.deck_sha256.encode()])
        new.file[STRUCTURE] = np.array([text])
        new.file[CHECKSUM] = np.array([checksum(text), *map(checksum, values.values())], dtype=np.uint64)
        for name, value in values.items():
            new.file[name] = value
