"""A pilot as a page draws him: points, bones, muscles where the deck has them, and how they move.

Everything that is drawn hangs on a node of the deck, and moves with it: by the node's displacement and its small
rotation. World axes: x forward, y up, z right [m].

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pilotgen.anthropometry.arm import SUFFIX, Limb
from pilotgen.evaluation import Evaluation
from pilotgen.linear.imposed_motion import SEAT_MOTIONS
from pilotgen.linear.modal import modes
from pilotgen.posture.seated_torso import placed_points
from pilotgen.report.packing import pack_floats, pack_levels

SEAT, THORAX = "seat", "thorax"
SHAPES_HZ = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0)  # where the response is stored as motion
_PARTS = ("x", "y", "z", "gx", "gy", "gz")  # of a node's motion
# What is drawn of the torso hangs on the first of these nodes that the deck has.
_CARRIERS = {
    "hip": ("pelvis", THORAX, SEAT),
    "lumbar_l3": (THORAX, SEAT),
    "thorax": (THORAX, SEAT),
    "neck_t1": (THORAX, SEAT),
    "head": ("head", THORAX, SEAT),
    "glenohumeral_l": (THORAX, SEAT),
    "glenohumeral_r": (THORAX, SEAT),
}


@dataclass(frozen=True)
class Skeleton:
    """What is drawn of one pilot.

    Attributes
    ----------
    nodes, points, muscles : tuple of str
        Nodes of the deck; places of interest, `elbow_l`; muscles.
    carriers : tuple of int
        The node that each point hangs on.
    ends : ndarray of int, shape (q, 2)
        Nodes of origin and insertion of each muscle.
    node_m : ndarray, shape (k, 3)
        Positions of the nodes.
    point_m : ndarray, shape (p, 3)
        Positions of the points.
    muscle_m : ndarray, shape (q, 2, 3)
        Origins and insertions.
    activation : ndarray, shape (q,)
        0 to 1.
    shapes : ndarray of complex, shape (1 + f, k, 6)
        Motion of each node relative to the seat, displacements [m] and rotations [rad]: first the dominant mode, scaled
        so that the grip of the loop's control moves 1 m; then the response at `SHAPES_HZ` to 1 m/s^2 of the seat.
    axis : int
        Along which the seat moves: 0, 1, 2 for x, y, z.
    sizes : dict
        Numbers for what has no node: stature, hip breadth [m], the seat back's angle [deg], the seat's place x, y [m].
    """

    nodes: tuple[str, ...]
    points: tuple[str, ...]
    muscles: tuple[str, ...]
    carriers: tuple[int, ...]
    ends: np.ndarray
    node_m: np.ndarray
    point_m: np.ndarray
    muscle_m: np.ndarray
    activation: np.ndarray
    shapes: np.ndarray
    axis: int
    sizes: dict[str, Any]

    def structure(self) -> dict[str, Any]:
        """What all pilots of a study have in common, as JSON has it."""
        return {
            "nodes": list(self.nodes),
            "points": list(self.points),
            "carriers": list(self.carriers),
            "muscles": list(self.muscles),
            "ends": self.ends.tolist(),
            "shapes_hz": list(SHAPES_HZ[: len(self.shapes) - 1]),
            "axis": self.axis,
        }

    def packed(self) -> dict[str, Any]:
        """His own numbers, packed."""
        levels = [pack_levels(np.stack([shape.real, shape.imag])) for shape in self.shapes]
        return {
            "places": pack_floats(np.concatenate([self.node_m.ravel(), self.point_m.ravel(), self.muscle_m.ravel()])),
            "activation": pack_floats(self.activation),
            "shapes": "|".join(text for text, _ in levels),
            "steps": [step for _, step in levels],
            "sizes": self.sizes,
        }


def skeleton_of(evaluation: Evaluation) -> Skeleton | None:
    """The skeleton of an evaluated pilot; None of a transfer function."""
    pilot = evaluation.solved
    if pilot is None or pilot.matrices is None:
        return None
    table = pilot.matrices.nodes
    nodes = tuple(bytes(name).decode() for name in table.name)
    index = {name: k for k, name in enumerate(nodes)}
    places = {name: (table.position[k], table.orientation[k]) for name, k in index.items()}
    points: list[tuple[str, int, np.ndarray]] = []
    for name, place in placed_points(pilot.cockpit).items():
        if name in _CARRIERS:
            carrier = next(one for one in _CARRIERS[name] if one in index)
            points.append((name, index[carrier], np.array(place)))
    ends, muscle_m = [], []
    for side, limb in pilot.body.limbs.items():
        points += _arm_points(limb, places, index)
        inceptor = pilot.cockpit.inceptors[side]
        control = "lever" if inceptor.name == "collective" else "stick"
        points.append((f"{control}_grip", index[control], inceptor.grip_world_m))
        points.append((f"{control}_hinge", index[control], np.asarray(inceptor.pose[0])))
        carrier = pilot.torso.torso.carriers[side] if pilot.torso is not None else SEAT
        torso = pilot.cockpit.torso[side]
        frames = {name: places[f"{name}_{SUFFIX[side]}"] for name in limb.segments} | {"torso": torso}
        owner = {name: index[f"{name}_{SUFFIX[side]}"] for name in limb.segments} | {"torso": index[carrier]}
        for muscle in limb.muscles:
            ends.append((owner[muscle.origin_body], owner[muscle.insertion_body]))
            at = ((muscle.origin_body, muscle.origin_m), (muscle.insertion_body, muscle.insertion_m))
            muscle_m.append([frames[body][0] + frames[body][1] @ place for body, place in at])
    return Skeleton(
        nodes=nodes,
        points=tuple(name for name, _, _ in points),
        carriers=tuple(carrier for _, carrier, _ in points),
        muscles=tuple(bytes(name).decode() for name in pilot.matrices.muscles.name),
        ends=np.array(ends, dtype=np.int64).reshape(-1, 2),
        node_m=np.asarray(table.position),
        point_m=np.array([place for _, _, place in points]),
        muscle_m=np.array(muscle_m).reshape(-1, 2, 3),
        activation=np.asarray(pilot.matrices.muscles.activation),
        shapes=_shapes(evaluation, nodes),
        axis=int(np.argmax(np.abs(SEAT_MOTIONS[evaluation.loop.motion].axis))),
        sizes={
            "stature_m": pilot.biometrics.stature_m,
            "hip_breadth_m": pilot.body.hip_breadth_sitting_m,
            "back_angle_deg": pilot.cockpit.back_angle_deg,
            "seat_m": pilot.cockpit.seat_shift_m.tolist(),
        },
    )


def _arm_points(limb: Limb, places: dict[str, Any], index: dict[str, int]) -> list[tuple[str, int, np.ndarray]]:
    """Joint centres of one arm, each on the bone that has it."""
    s = SUFFIX[limb.side]
    local = (
        ("shoulder", "humerus", np.zeros(3)),
        ("elbow", "humerus", limb.HU_in_humerus),
        ("elbow_radius", "humerus", limb.HR_in_humerus),
        ("ulnar_head", "radius", limb.UH_in_radius),
        ("wrist", "radius", limb.W_in_radius),
        ("grip", "hand", limb.grip_in_hand),
    )
    return [
        (f"{name}_{s}", index[f"{bone}_{s}"], places[f"{bone}_{s}"][0] + places[f"{bone}_{s}"][1] @ place)
        for name, bone, place in local
    ]


def _shapes(evaluation: Evaluation, nodes: tuple[str, ...]) -> np.ndarray:
    """Motion of the nodes relative to the seat, shape (1 + f, k, 6); zero where the model has no basis of modes.

    Where the seat turns there is the dominant mode alone: f is 0.
    """
    model, loop = evaluation.pilot_model, evaluation.loop
    frequencies_hz = () if SEAT_MOTIONS[loop.motion].rotation else SHAPES_HZ
    found = np.zeros((1 + len(frequencies_hz), len(nodes), len(_PARTS)), dtype=np.complex128)
    imposed = model.imposed
    if imposed is None or model.integrators:
        return found
    modal = modes(imposed.free, imposed.form)
    if not modal.diagonal:
        return found
    where = {bytes(name).decode(): k for k, name in enumerate(imposed.free.names)}
    rows = [
        (k, p, where[f"{node}.{part}"])
        for k, node in enumerate(nodes)
        for p, part in enumerate(_PARTS)
        if f"{node}.{part}" in where
    ]
    at_node, at_part, unknown = (np.array(column) for column in zip(*rows, strict=True))
    lam, V = modal.lam, modal.V_R[unknown]
    dominant = int(np.argmin(np.abs(lam - model.dominant_pole(loop.output))))
    grip = loop.lever_length_m * complex(imposed.output_matrix[loop.output] @ modal.V_R[:, dominant])
    found[0, at_node, at_part] = V[:, dominant] / grip
    B1, B2 = (-modal.V_L @ part[:, 0] for part in (imposed.g_ydot_imposed, imposed.g_y_imposed))
    weights = (lam * B1 + B2) / lam**2
    for k, hz in enumerate(frequencies_hz, start=1):
        found[k, at_node, at_part] = V @ (weights / (2j * np.pi * hz - lam))
    return found
