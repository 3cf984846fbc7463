"""Muscle activations that hold the arm in its posture with the least effort.

From the solver's matrices of the trim deck (muscles at rest): the residual, its derivative g_u with respect to the
activations, and the rows of the limb's own constraints. The virtual motions of the seven named joint coordinates
satisfy those constraints, so that projecting on them leaves seven moment balances without reactions,

    T^T (residual + g_u a + hand load) = 0,    minimise sum a^2,    floor <= a <= 1,

solved for each limb by a quadratic programme. The hand carries only what its control needs, by the smallest grip force
that holds it; a balanced lever needs none. Theory: docs/theory/posture.md.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import daqp
import numpy as np

from pilotgen.anthropometry.arm import CONSTRAINTS, COORDINATES, FREEDOMS, JOINTS, SEGMENTS, SUFFIX, Limb
from pilotgen.anthropometry.body import Body
from pilotgen.errors import EvaluationError, MatrixError
from pilotgen.posture.cockpit import Cockpit, PlacedInceptor
from pilotgen.posture.kinematics import MIRROR, Pose, arm_geometry, cross
from pilotgen.posture.seated_torso import Load
from pilotgen.solver.descriptor import block
from pilotgen.solver.matrices import Matrices

TORQUES = (
    "shoulder_abduction",
    "shoulder_internal_rotation",
    "shoulder_flexion",
    "elbow_flexion",
    "forearm_pronation",
    "wrist_flexion",
    "wrist_ulnar_deviation",
)
"""Names of the seven balances: shoulder moments are about the torso's axes, positive in the sense of the name."""

_SIGN = np.array([-1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])  # the first coordinate of a right arm turns toward adduction
_CONTROL_NODES = {"collective": ("lever", "lever_hinge"), "cyclic": ("stick", "stick_pivot")}
_EQUALITY, _INEQUALITY = 5, 0  # constraint types of daqp
_BALANCED_NM = 1e-8  # residual of the balances that the solution must reach; the programme's own tolerance is coarser
_BOUND_TOLERANCE = 1e-7
_POLISHES = 4  # a muscle that rests within the tolerance of a bound may have to join the active set
_MOST_NEWTON = 200  # steps of the way by multipliers
_SLACK_WEIGHT = 1e-6  # of the activations beside the missing moments, when no activation balances the arm


@dataclass(frozen=True)
class Activations:
    """Minimum-effort activations of all muscles in deck order.

    Attributes
    ----------
    values : ndarray
        Activations in [floor, 1].
    muscle_names : tuple of str
        Their names in the deck (`delt1_l`).
    sum_of_squares, largest : float
        The effort, and the largest activation, of `largest_muscle`.
    joint_torques_N_m : dict
        What all muscles together exert about each joint coordinate [N m], names of `TORQUES` (`right_` before those of
        the right arm). They carry the arm's weight and what the control needs.
    at_floor : tuple of str
        Muscles at the lower bound.
    hand_loads : dict
        What the control puts on the hand, by side: force [N], couple [N m] and the hand's origin, where the force acts
        [m], world axes.
    """

    values: np.ndarray
    muscle_names: tuple[str, ...]
    sum_of_squares: float
    largest: float
    largest_muscle: str
    joint_torques_N_m: dict[str, float]
    at_floor: tuple[str, ...]
    hand_loads: dict[str, Load]


@dataclass(frozen=True)
class _Layout:
    """Where the unknowns and rows of one limb are in the matrices of one deck."""

    position_columns: np.ndarray  # (24,) x and g of humerus, radius, ulna, hand
    force_rows: np.ndarray  # (24,) force and moment equilibrium of the same nodes
    constraint_rows: np.ndarray  # (17,)
    control_columns: np.ndarray  # (6,)
    control_force_rows: np.ndarray  # (6,)
    control_constraint_rows: np.ndarray
    muscle_columns: np.ndarray  # of g_u


def solve_activations(matrices: Matrices, body: Body, cockpit: Cockpit, *, floor: float = 0.0) -> Activations:
    """Minimum-effort activations from the matrices of the trim deck.

    Parameters
    ----------
    matrices : Matrices
        Of the pilot's deck with all activations zero.
    floor : float
        Lower bound of every activation, a tonic activity (0: none).

    Raises
    ------
    EvaluationError
        No activations within their bounds balance the arm: names the overloaded joint and the missing moment.
    MatrixError
        The matrices are not those of such a deck.
    """
    poses = _node_poses(matrices)
    names = tuple(bytes(name).decode()[len("activation[") : -1] for name in matrices.inputs.name)
    values = np.zeros(sum(len(limb.muscles) for limb in body.limbs.values()))
    torques: dict[str, float] = {}
    loads: dict[str, Load] = {}
    done = 0
    for side, limb in body.limbs.items():
        layout = _layout_of(matrices, side, cockpit.inceptors[side].name, done, len(limb.muscles))
        T = _virtual_motions(matrices, layout, limb, cockpit.torso[side], poses)
        hand = poses[f"hand_{SUFFIX[side]}"]
        load = _hand_load(matrices, layout, cockpit.inceptors[side], hand)
        loads[side] = _on_the_hand(load, hand)
        residual = matrices.residual[layout.force_rows]
        G = block(matrices.inputs.g_u, layout.force_rows, layout.muscle_columns)
        A, b = T.T @ G, -(T.T @ (residual + load))
        a = _least_effort(A, b, floor, side)
        values[layout.muscle_columns] = a
        prefix = "" if side == "left" else "right_"
        muscle_torque = T.T @ (G @ a + _passive(G, matrices, layout))
        torques.update(zip((prefix + name for name in TORQUES), (-muscle_torque).tolist(), strict=True))
        done += len(limb.muscles)
    largest = int(np.argmax(values))
    by_name = dict(zip(names, values.tolist(), strict=False))
    return Activations(
        values=values,
        muscle_names=names[:done],
        sum_of_squares=float(values @ values),
        largest=float(values[largest]),
        largest_muscle=names[largest],
        joint_torques_N_m=torques,
        at_floor=tuple(name for name, a in by_name.items() if a <= floor + _BOUND_TOLERANCE),
        hand_loads=loads,
    )


# ---- the seven balances ----------------------------------------------------------------------------------------------


def _node_poses(matrices: Matrices) -> dict[str, Pose]:
    nodes = matrices.nodes
    return {
        bytes(name).decode(): (x, R) for name, x, R in zip(nodes.name, nodes.position, nodes.orientation, strict=True)
    }


def _layout_of(matrices: Matrices, side: str, control: str, first_muscle: int, muscles: int) -> _Layout:
    nodes, joints = matrices.nodes, matrices.joints
    try:
        return _layout(
            side,
            control,
            first_muscle,
            muscles,
            tuple(nodes.name.tolist()),
            tuple(nodes.first.tolist()),
            tuple(nodes.dofs.tolist()),
            tuple(joints.name.tolist()),
            tuple(joints.first.tolist()),
            tuple(joints.dofs.tolist()),
        )
    except KeyError as error:
        raise MatrixError(
            f"{matrices.path}: no node or joint {error.args[0]!r} in it; the matrices of a trim deck were wanted"
        ) from None


@lru_cache(maxsize=8)
def _layout(
    side: str,
    control: str,
    first_muscle: int,
    muscles: int,
    node_names: tuple[bytes, ...],
    node_first: tuple[int, ...],
    node_dofs: tuple[int, ...],
    joint_names: tuple[bytes, ...],
    joint_first: tuple[int, ...],
    joint_dofs: tuple[int, ...],
) -> _Layout:
    nodes = {name.decode(): (i, n) for name, i, n in zip(node_names, node_first, node_dofs, strict=True)}
    joints = {name.decode(): (i, n) for name, i, n in zip(joint_names, joint_first, joint_dofs, strict=True)}
    limb = [f"{name}_{SUFFIX[side]}" for name in SEGMENTS]
    constraints = [f"{name}_{SUFFIX[side]}" for name in (joint.name for joint in JOINTS)]
    control_node, control_joint = _CONTROL_NODES[control]

    def columns(name: str) -> np.ndarray:
        return np.arange(6) + nodes[name][0]

    def forces(name: str) -> np.ndarray:
        first, dofs = nodes[name]
        return np.arange(6) + first + dofs - 6

    def rows(name: str) -> np.ndarray:
        first, dofs = joints[name]
        return np.arange(first, first + dofs)

    return _Layout(
        position_columns=np.concatenate([columns(name) for name in limb]),
        force_rows=np.concatenate([forces(name) for name in limb]),
        constraint_rows=np.concatenate([rows(name) for name in constraints]),
        control_columns=columns(control_node),
        control_force_rows=forces(control_node),
        control_constraint_rows=rows(control_joint),
        muscle_columns=np.arange(first_muscle, first_muscle + muscles),
    )


def _constraint_jacobian(matrices: Matrices, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """g_y of constraint rows: they do not contain rates, so that J(c) = c g_y there."""
    return np.asarray(block(matrices.J_plus, rows, columns) / matrices.c)


def _virtual_motions(
    matrices: Matrices, layout: _Layout, limb: Limb, torso: Pose, poses: Mapping[str, Pose]
) -> np.ndarray:
    """T (24, 7): velocities of the limb's nodes when one joint coordinate of `TORQUES` has unit rate."""
    system = np.zeros((FREEDOMS, FREEDOMS))
    system[:CONSTRAINTS] = _constraint_jacobian(matrices, layout.constraint_rows, layout.position_columns)
    system[CONSTRAINTS:] = _coordinate_rates(limb, torso, poses)
    right = np.zeros((FREEDOMS, COORDINATES))
    right[CONSTRAINTS:] = np.diag(_SIGN)
    return np.asarray(np.linalg.solve(system, right))


def _coordinate_rates(limb: Limb, torso: Pose, poses: Mapping[str, Pose]) -> np.ndarray:
    """B (7, 24): rates of the joint coordinates from the nodes' velocities and angular velocities."""
    geometry = arm_geometry(limb)
    # fixed in the bones of a right arm; in a left arm, its mirror image, axial vectors turn into -S v
    mirror = -MIRROR if limb.side == "left" else np.ones(3)
    R = {name: poses[f"{name}_{SUFFIX[limb.side]}"][1] * mirror for name in SEGMENTS}
    axes = np.empty((3, COORDINATES))
    axes[:, :3] = torso[1] * mirror
    axes[:, 3] = R["humerus"] @ geometry.elbow_on_humerus[:, 2]
    axes[:, 4] = R["radius"] @ geometry.forearm_on_radius[:, 2]
    axes[:, 5] = R["radius"] @ geometry.wrist_on_radius[:, 2]
    axes[:, 6] = R["hand"] @ geometry.wrist_on_hand[:, 1]
    humerus, radius, ulna, hand = (slice(6 * i + 3, 6 * i + 6) for i in range(len(SEGMENTS)))
    B = np.zeros((COORDINATES, FREEDOMS))
    B[:3, humerus] = axes[:, :3].T
    for row, second, first in ((3, ulna, humerus), (4, radius, ulna), (5, hand, radius), (6, hand, radius)):
        B[row, second] = axes[:, row]
        B[row, first] = -axes[:, row]
    return B


def _hand_load(matrices: Matrices, layout: _Layout, inceptor: PlacedInceptor, hand: Pose) -> np.ndarray:
    """Residual (24,) that the control puts on the limb: minus the smallest grip force that holds the control."""
    constraints = _constraint_jacobian(matrices, layout.control_constraint_rows, layout.control_columns)
    _, _, vt = np.linalg.svd(constraints)
    motions = vt[constraints.shape[0] :].T  # (6, free coordinates of the control)
    needed = motions.T @ matrices.residual[layout.control_force_rows]
    load = np.zeros(FREEDOMS)
    if not np.any(np.abs(needed) > 0.0):
        return load
    arm = inceptor.grip_world_m - inceptor.pose[0]
    grip_motions = motions[:3] + np.stack([cross(w, arm) for w in motions[3:].T], axis=1)
    # residual = -(sum of forces): the grip force F on the control satisfies grip_motions^T F = needed
    force = np.linalg.lstsq(grip_motions.T, needed, rcond=None)[0]
    at_hand = 6 * SEGMENTS.index("hand")
    load[at_hand : at_hand + 3] = force
    load[at_hand + 3 : at_hand + 6] = cross(inceptor.grip_world_m - hand[0], force)
    return load


def _on_the_hand(load: np.ndarray, hand: Pose) -> Load:
    """The same as force, couple and place: a residual is minus the sum of forces."""
    fx, fy, fz, mx, my, mz = (0.0 - load[6 * SEGMENTS.index("hand") :][:6]).tolist()
    x, y, z = hand[0].tolist()
    return (fx, fy, fz), (mx, my, mz), (x, y, z)


def _passive(G: np.ndarray, matrices: Matrices, layout: _Layout) -> np.ndarray:
    """Residual (24,) of the passive forces: columns of g_u times passive force over force per activation."""
    blocks = G.reshape(len(SEGMENTS), 6, -1)[:, :3]
    per_activation = np.sqrt(np.max(np.einsum("nij,nij->nj", blocks, blocks), axis=0))  # N, at either end of a muscle
    return np.asarray(G @ (matrices.muscles.force[layout.muscle_columns] / per_activation))


# ---- the programme ---------------------------------------------------------------------------------------------------


def _least_effort(A: np.ndarray, b: np.ndarray, floor: float, side: str) -> np.ndarray:
    """Minimise a.a subject to A a = b and floor <= a <= 1; b in N m."""
    count = A.shape[1]
    lower = np.concatenate((np.full(count, floor), b))
    upper = np.concatenate((np.ones(count), b))
    kinds = np.array([_INEQUALITY] * count + [_EQUALITY] * len(b), dtype=np.int32)
    x, _, flag, _ = daqp.solve(np.eye(count), np.zeros(count), np.ascontiguousarray(A), upper, lower, kinds)
    a = _polished(A, b, np.asarray(x), floor) if flag == 1 else None
    if a is None:
        a = _by_multipliers(A, b, floor)
    if a is None:
        raise _overloaded(A, b, floor, side)
    return a


def _polished(A: np.ndarray, b: np.ndarray, x: np.ndarray, floor: float) -> np.ndarray | None:
    """Solve again on the active set that the programme found: exact to round-off; None if that set does not do."""
    low, high = x <= floor + _BOUND_TOLERANCE, x >= 1.0 - _BOUND_TOLERANCE
    for _ in range(_POLISHES):
        a = np.where(low, floor, 1.0)
        free = ~(low | high)
        A_free = A[:, free]
        if A_free.shape[1] < len(b):
            return None
        # least-norm solution; the second pass removes the round-off of the normal equations
        normal = A_free @ A_free.T
        try:
            a[free] = A_free.T @ np.linalg.solve(normal, b - A[:, ~free] @ a[~free])
            a[free] += A_free.T @ np.linalg.solve(normal, b - A @ a)
        except np.linalg.LinAlgError:  # the free muscles do not reach every moment
            return None
        if float(np.min(a)) >= floor and float(np.max(a)) <= 1.0:
            break
        low, high = low | (a < floor), high | (a > 1.0)
    balanced = float(np.max(np.abs(A @ a - b))) <= _BALANCED_NM
    return a if balanced and float(np.min(a)) >= floor and float(np.max(a)) <= 1.0 else None


def _by_multipliers(A: np.ndarray, b: np.ndarray, floor: float) -> np.ndarray | None:
    """The same programme by its multipliers m: a = clip(A^T m, floor, 1) with A a = b, a concave function's maximum.

    Degenerate programmes, with fewer free muscles than moments, are no exception here. Newton's method with a little
    regularisation and halved steps; None if no multipliers balance the moments.
    """
    weight = 1e-10 * float(np.sum(A * A)) * np.eye(len(b))
    m = np.zeros(len(b))

    def value(m: np.ndarray) -> float:
        z = A.T @ m
        a = np.clip(z, floor, 1.0)
        return float(b @ m - np.sum(z * a - 0.5 * a * a))

    for _ in range(_MOST_NEWTON):
        z = A.T @ m
        a = np.clip(z, floor, 1.0)
        missing = b - A @ a
        if float(np.max(np.abs(missing), initial=0.0)) <= _BALANCED_NM:
            return a
        free = (z > floor) & (z < 1.0)
        step = np.linalg.solve(A[:, free] @ A[:, free].T + weight, missing)
        now, gain = value(m), float(missing @ step)
        t, round_off = 1.0, 1e-14 * (float(np.abs(b) @ np.abs(m)) + len(a))
        while value(m + t * step) < now + 1e-4 * t * gain - round_off and t > 1e-12:
            t *= 0.5
        m = m + t * step
    return None


def _overloaded(A: np.ndarray, b: np.ndarray, floor: float, side: str) -> EvaluationError:
    """The error that names the joint whose moment is missed by most when the muscles do their best."""
    count = A.shape[1]
    H = A.T @ A + _SLACK_WEIGHT * np.eye(count)
    a, _, flag, _ = daqp.solve(
        H, -(A.T @ b), np.zeros((0, count)), np.ones(count), np.full(count, floor), np.zeros(count, dtype=np.int32)
    )
    if flag != 1:
        return EvaluationError("activation", f"{side} arm: the quadratic programme failed (exit flag {flag})")
    missing = b - A @ np.asarray(a)
    worst = int(np.argmax(np.abs(missing)))
    joint = TORQUES[worst].replace("_", " ")
    return EvaluationError(
        "activation",
        f"{side} arm: the muscles cannot balance {joint}: {abs(missing[worst]):.2f} N m are missing "
        f"(of {abs(b[worst]):.2f} N m needed) with every activation between {floor:g} and 1",
    )
