"""Component mode synthesis of a spine: a few modes in place of matrices, and the `.fem` text of MBDyn's modal joint.

Craig and Bampton (1968): the interior moves with the interface bodies as it would at rest (constraint modes) and, apart
from that, in its own slow modes with the interface held. Damping is projected in full. docs/theory/spine.md has it all.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import orjson

from pilotgen.anthropometry.spine import FREEDOMS, SEAT, SpineModel
from pilotgen.errors import EvaluationError

Floats = np.ndarray

CUTOFF_HZ = 25.0
_INDEPENDENT = 1e-6  # part of a residual vector that the modes do not have, below which it is left out


@dataclass(frozen=True)
class ReducedSpine:
    """A spine in modes.

    Attributes
    ----------
    spine : SpineModel
        What is reduced.
    interfaces : tuple of str
        Bodies that are nodes of the deck. Their mass is not in `M`: it belongs to a `body` on the node.
    W : (6n, m) floats
        Shapes, one column per mode: six constraint modes per interface, fixed-interface modes, residual vectors. The
        first are unit displacements and rotations of the interfaces.
    M, C, K : (m, m) floats
        W' M W of the interior, W' C W, W' K W, all full.
    frequencies_hz : (k,) floats
        Of the fixed-interface modes kept, without damping.
    residual_count : int
        Number of residual vectors among the modes.
    preload : (m,) floats
        Constant forces on the modal equations that make the loaded shape the one of zero displacements.
    """

    spine: SpineModel
    interfaces: tuple[str, ...]
    W: Floats
    M: Floats
    C: Floats
    K: Floats
    frequencies_hz: Floats
    residual_count: int
    preload: Floats

    @property
    def modes(self) -> int:
        """Number of modes."""
        return int(self.W.shape[1])

    @property
    def heave(self) -> Floats:
        """Modal displacements (m,) of a rigid motion by 1 m up, as the constraint modes alone have them."""
        out = np.zeros(self.modes)
        out[1 : FREEDOMS * len(self.interfaces) : FREEDOMS] = 1.0
        return out


def reduce_spine(
    spine: SpineModel,
    cutoff_hz: float = CUTOFF_HZ,
    *,
    interfaces: Sequence[str],
    residual_vectors: bool = False,
) -> ReducedSpine:
    """Reduce a spine to its interfaces and its slow modes.

    Parameters
    ----------
    spine : SpineModel
        The chain, loaded.
    cutoff_hz : float
        All fixed-interface modes up to this frequency are kept; infinity keeps all.
    interfaces : sequence of str
        Bodies that stay nodes: what carries the shoulders (`carrier_name`), and `head` where its motion is asked for as
        a node.
    residual_vectors : bool
        Add the static response of the interior to heave of the seat and to velocities of the interfaces, which the
        modes left out would have given.

    Returns
    -------
    ReducedSpine

    Raises
    ------
    EvaluationError
        Stage "torso": an interface that is no body, a cut-off that is not positive, a spine that its load buckles.
    """
    names = [body.name for body in spine.bodies]
    unknown = [name for name in interfaces if name not in names]
    if unknown or not interfaces or len(set(interfaces)) != len(interfaces):
        raise EvaluationError("torso", f"interfaces {list(interfaces)} are wanted among the bodies {', '.join(names)}")
    if not cutoff_hz > 0.0:
        raise EvaluationError("torso", f"a cut-off of {cutoff_hz:g} Hz keeps nothing; a positive frequency is wanted")
    size = len(spine.M)
    b = np.concatenate([np.arange(*spine.freedoms(name).indices(size)) for name in interfaces])
    interior = np.ones(size, dtype=bool)
    interior[b] = False
    i = np.flatnonzero(interior)
    masses = spine.M.diagonal()[i]
    K_ii = spine.K[np.ix_(i, i)]
    Psi = -np.linalg.solve(K_ii, spine.K[np.ix_(i, b)])
    Phi, frequencies = _fixed_modes(K_ii, masses, cutoff_hz)
    residual = np.empty((len(i), 0))
    if residual_vectors:
        heave = masses * spine.heave[i]
        rates = spine.C[np.ix_(i, b)] + spine.C[np.ix_(i, i)] @ Psi
        residual = _independent(np.linalg.solve(K_ii, np.column_stack([heave, -rates])), Phi, masses)
    W = np.zeros((size, len(b) + Phi.shape[1] + residual.shape[1]))
    W[b, np.arange(len(b))] = 1.0
    W[i, : len(b)] = Psi
    W[i, len(b) :] = np.column_stack([Phi, residual])
    inner = W[i]
    return ReducedSpine(
        spine=spine,
        interfaces=tuple(interfaces),
        W=W,
        M=inner.T @ (masses[:, None] * inner),
        C=W.T @ spine.C @ W,
        K=W.T @ spine.K @ W,
        frequencies_hz=frequencies,
        residual_count=residual.shape[1],
        preload=_preload(spine, interfaces, W, i),
    )


def fem_text(reduced: ReducedSpine, title: str = "spine") -> str:
    """Write a reduced spine as the `.fem` file of MBDyn's modal joint.

    Node labels are the bodies' names in capitals and SEAT, where the modal node stands. Coordinates are from the seat's
    node, in the world's axes: the modal node has those. Lumped masses (record group 11) are the interior's; interfaces
    have none here. Numbers have the fewest digits (17 at most) that read back the same.

    Parameters
    ----------
    reduced : ReducedSpine
        What is written.
    title : str
        One line of comment.

    Returns
    -------
    str
        The file's text.
    """
    spine, W = reduced.spine, reduced.W
    modes = reduced.modes
    fixed = FREEDOMS * len(reduced.interfaces)
    places = np.array([body.place_m for body in spine.bodies]) - spine.origin_m
    labels = " ".join(name.upper() for name in (SEAT, *(body.name for body in spine.bodies)))
    nodes = 1 + len(spine.bodies)
    lumped = np.zeros((nodes, FREEDOMS))
    for i, body in enumerate(spine.bodies, 1):
        if body.name not in reduced.interfaces:
            lumped[i] = (body.mass_kg, body.mass_kg, body.mass_kg, *body.inertia_kg_m2)
    interfaces = ", ".join(name.upper() for name in reduced.interfaces)
    out = [
        f"** {title.splitlines()[0] if title else 'spine'}: {fixed} constraint modes of {interfaces}, "
        f"{len(reduced.frequencies_hz)} fixed-interface modes, {reduced.residual_count} residual vectors\n",
        "** RECORD GROUP 1, HEADER\n** revision, nodes, normal, attachment, constraint, rejected modes\n",
        f"REV0 {nodes} {modes - fixed} 0 {fixed} 0\n",
        f"** RECORD GROUP 2, FINITE ELEMENT NODE LIST\n{labels}\n",
    ]
    for group, axis in ((5, "X"), (6, "Y"), (7, "Z")):
        values = np.concatenate(([0.0], places[:, group - 5]))
        out.append(f"** RECORD GROUP {group}, NODAL {axis} COORDINATES\n" + _rows(values[None]))
    out.append("** RECORD GROUP 8, MODE SHAPES\n")
    shapes = _rows(W.T.reshape(-1, FREEDOMS)).splitlines(keepends=True)  # W has the bodies in the same order
    for k in range(modes):
        out += [f"** mode {k + 1}\n0 0 0 0 0 0\n", *shapes[k * (nodes - 1) : (k + 1) * (nodes - 1)]]
    for group, name, matrix in (
        (9, "MODAL MASS MATRIX", reduced.M),
        (10, "MODAL STIFFNESS MATRIX", reduced.K),
        (13, "MODAL DAMPING MATRIX", reduced.C),
    ):
        out.append(f"** RECORD GROUP {group}, {name}\n" + _rows(matrix))
    out.append("** RECORD GROUP 11, LUMPED MASSES\n" + _rows(lumped) + "** END OF FILE\n")
    return "".join(out)


def _rows(matrix: Floats) -> str:
    """A matrix row by row, each number with the fewest digits that read back the same."""
    text = orjson.dumps((matrix + 0.0).tolist()).decode()[2:-2]
    return text.replace("],[", "\n").replace(",", " ") + "\n"


def _fixed_modes(K_ii: Floats, masses: Floats, cutoff_hz: float) -> tuple[Floats, Floats]:
    """Modes of the interior with the interfaces held, of unit modal mass, by the symmetric part of its stiffness."""
    root = 1.0 / np.sqrt(masses)
    scaled = 0.5 * root[:, None] * (K_ii + K_ii.T) * root
    squares, vectors = np.linalg.eigh(scaled)
    if squares[0] <= 0.0:
        raise EvaluationError(
            "torso", "the spine buckles under what it carries; stiffer springs, or a lighter load, are wanted"
        )
    frequencies = np.sqrt(squares) / (2.0 * math.pi)
    kept = int(np.searchsorted(frequencies, cutoff_hz, side="right"))
    return root[:, None] * vectors[:, :kept], frequencies[:kept]


def _independent(vectors: Floats, Phi: Floats, masses: Floats) -> Floats:
    """What of the vectors the modes do not have, of unit modal mass each and independent of one another."""
    root = np.sqrt(masses)[:, None]
    scaled = root * vectors
    scaled = scaled / np.linalg.norm(scaled, axis=0)
    basis = root * Phi
    for _ in range(2):  # twice is enough for round-off
        scaled = scaled - basis @ (basis.T @ scaled)
    left, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
    return np.asarray(left[:, sizes > _INDEPENDENT] / root)


def _preload(spine: SpineModel, interfaces: Sequence[str], W: Floats, interior: Floats) -> Floats:
    """f = T' F + Q' N - sum m T' g: F, N what the springs put on the interface bodies, m and g of the interior."""
    forces = np.zeros(len(W))
    weights = spine.M.diagonal() * np.tile([*spine.gravity_m_per_s2, 0.0, 0.0, 0.0], len(spine.bodies))
    forces[interior] = -weights[interior]
    for name in interfaces:
        at = spine.freedoms(name)
        place = np.asarray(spine.bodies[spine.index(name)].place_m)
        on_body = np.zeros(6)
        for spring in spine.springs:
            if name not in (spring.first, spring.second):
                continue
            load = spine.prestress[spring.name]
            F, N = spring.axes @ load[:3], spring.axes @ load[3:]
            sign = 1.0 if spring.first == name else -1.0
            on_body[:3] += sign * F
            on_body[3:] += sign * (N + np.cross(np.asarray(spring.point_m) - place, F))
        forces[at] = on_body
    return np.asarray(W.T @ forces)
