"""The free part of a linearised pilot, driven by imposed motions of the seat (paper eq. (23)-(25)).

Unknowns are split by name into free and imposed ones. Signs: positive collective rotation is lever up, more collective;
heave up, surge forward, sway right; roll right, pitch nose up, yaw nose right. Rotations turn the seat about a point.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from pilotgen.errors import EvaluationError, MatrixError, StudyError
from pilotgen.linear.null_space import independent_constraints
from pilotgen.linear.second_order import SecondOrderForm, second_order_form
from pilotgen.solver.descriptor import DescriptorModel, Floats, Indices, block
from pilotgen.study.wording import did_you_mean

COLLECTIVE = "collective_rotation"
_DEFAULT_OUTPUTS: dict[str, dict[str, float]] = {
    COLLECTIVE: {"lever.gz": 1.0},  # hinge axis z (right): x (forward, along the lever) turns to y (up)
    "cyclic_aft": {"stick.gz": 1.0},  # the stick (up, y) turns to -x: aft
    "cyclic_right": {"stick.gx": 1.0},  # the stick (up, y) turns to z: right
}


# Outputs for who asks: motions of head and hands relative to the seat, and the moments of the hands about the hinges.
HEAD: Mapping[str, Mapping[str, float]] = {
    "head_forward": {"head.x": 1.0},
    "head_up": {"head.y": 1.0},
    "head_to_the_right": {"head.z": 1.0},
    "head_roll": {"head.gx": 1.0},
    "head_pitch": {"head.gz": 1.0},
    "head_yaw": {"head.gy": -1.0},
}
HANDS: Mapping[str, Mapping[str, float]] = {  # the left one moves in the plane of the lever
    "left_hand_forward": {"hand_l.x": 1.0},
    "left_hand_up": {"hand_l.y": 1.0},
    "right_hand_forward": {"hand_r.x": 1.0},
    "right_hand_up": {"hand_r.y": 1.0},
    "right_hand_to_the_right": {"hand_r.z": 1.0},
}
MOMENTS: Mapping[str, str] = {  # the coordinate that each turns
    "hand_moment_collective": "lever.gz",
    "hand_moment_cyclic_aft": "stick.gz",
    "hand_moment_cyclic_right": "stick.gx",
}
_ROTATING = ("roll", "pitch", "yaw")


def rotations() -> dict[str, dict[str, float]]:
    """The outputs that every pilot has: rotations of the controls."""
    return {name: dict(weights) for name, weights in _DEFAULT_OUTPUTS.items()}


def output_unit(name: str) -> str:
    """Unit of an output of the pilot."""
    if name in MOMENTS:
        return "N m"
    more = name in HEAD or name in HANDS
    return "m" if more and not name.endswith(_ROTATING) else "rad"


PEDALS = "pedals are not modelled: no leg, no foot; the controls are collective and cyclic"


@dataclass(frozen=True)
class SeatMotion:
    """One motion of the seat: `axis` (3,) in world axes (x forward, y up, z right), a rotation or a translation."""

    axis: tuple[float, float, float]
    rotation: bool

    @property
    def unit(self) -> str:
        """Unit of its acceleration."""
        return "rad/s^2" if self.rotation else "m/s^2"


SEAT_MOTIONS: Mapping[str, SeatMotion] = {
    "heave": SeatMotion((0.0, 1.0, 0.0), False),
    "surge": SeatMotion((1.0, 0.0, 0.0), False),
    "sway": SeatMotion((0.0, 0.0, 1.0), False),
    "roll": SeatMotion((1.0, 0.0, 0.0), True),
    "pitch": SeatMotion((0.0, 0.0, 1.0), True),
    "yaw": SeatMotion((0.0, -1.0, 0.0), True),
}
ROTATIONS = tuple(name for name, motion in SEAT_MOTIONS.items() if motion.rotation)


@dataclass(frozen=True)
class Channels:
    """Which motions are imposed and which unknowns are watched.

    Attributes
    ----------
    seat : str
        Node that follows the imposed motions.
    inputs : tuple of str
        Names of `SEAT_MOTIONS`, in the order of the model's inputs.
    point_m : tuple of float
        Point about which the seat rotates, from the seat's node in world axes [m]; translations are those of the seat.
    outputs : mapping of str to mapping of str to float
        Each output as a sum of weighted unknowns, relative to the seat's rigid motion; the collective rotation must
        come first. Outputs whose unknowns are not in the model are left out, except the collective.
    moments : tuple of str
        Names of `MOMENTS`, further outputs: the moment of the hand on a control about its hinge or pivot [N m],
        positive as the control's rotation. Those of a control that is not in the model are left out.
    """

    seat: str = "seat"
    inputs: tuple[str, ...] = ("heave",)
    point_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    outputs: Mapping[str, Mapping[str, float]] = field(default_factory=lambda: _DEFAULT_OUTPUTS)
    moments: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in self.inputs:
            if name not in SEAT_MOTIONS:
                why = f"; {PEDALS}" if "pedal" in name else ""
                near = did_you_mean(name, list(SEAT_MOTIONS))
                raise StudyError(f"seat motion '{name}' is not known; {near}known: {', '.join(SEAT_MOTIONS)}{why}")
        if not self.inputs or len(set(self.inputs)) != len(self.inputs):
            raise StudyError(f"seat motions must be named once each; got {', '.join(self.inputs) or 'none'}")
        for name in self.moments:
            if name not in MOMENTS:
                near = did_you_mean(name, list(MOMENTS))
                raise StudyError(f"moment '{name}' is not known; {near}known: {', '.join(MOMENTS)}")
        for name in self.outputs:
            if "pedal" in name:
                raise StudyError(f"output '{name}': {PEDALS}")


@dataclass(frozen=True, eq=False)
class ImposedMotion:
    """The free part of a descriptor model, driven by k imposed seat motions z (paper eq. (23)-(25)).

    Attributes
    ----------
    free : DescriptorModel
        g_y^FF and g_ydot^FF.
    g_y_imposed, g_ydot_imposed : ndarray, shape (n_F, k)
        Columns g_y^FI and g_ydot^FI of the imposed motions.
    output_matrix : ndarray, shape (p, n_F)
        C~: the outputs by the free unknowns.
    output_imposed : ndarray, shape (p, k)
        What the seat's own rigid motion takes off the outputs.
    inputs, outputs : tuple of str
        Their names; of the outputs first those of `output_matrix`, then those of `moment_rows`.
    moment_rows : ndarray, shape (f, n_q)
        Equations of equilibrium that are further outputs: what their inertia, damping and stiffness make of the motion.
    form : SecondOrderForm
        The free part without momenta.
    M_imposed, C_imposed, K_imposed : ndarray, shape (n_q, k)
        How z'', z' and z enter the equilibrium equations once momenta are eliminated.
    rigid : ndarray, shape (n_q, k)
        The free coordinates when everything moves with the seat.
    """

    free: DescriptorModel
    g_y_imposed: Floats
    g_ydot_imposed: Floats
    output_matrix: Floats
    output_imposed: Floats
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    form: SecondOrderForm
    M_imposed: Floats
    C_imposed: Floats
    K_imposed: Floats
    rigid: Floats
    moment_rows: Floats


def split(
    model: DescriptorModel, channels: Channels | None = None, positions: Mapping[str, Floats] | None = None
) -> ImposedMotion:
    """Split the unknowns into free and imposed ones.

    The seat's node goes out whole with its equations, and so do the reactions and equations of the joint that holds it:
    those that touch the seat alone. What stays of the seat are the columns of the imposed motions.

    Parameters
    ----------
    model : DescriptorModel
        The linearised model of seat, pilot and controls.
    channels : Channels, optional
        Names of imposed motions and outputs.
    positions : mapping of str to ndarray, shape (3,)
        Where the nodes are [m, world axes], which rotations of the seat need.

    Raises
    ------
    MatrixError
        An unknown is not in the model, no joint holds the seat alone, or a rotation is wanted without positions.
    """
    names = channels or Channels()
    imposed = np.array([model.index(f"{names.seat}.{suffix}") for suffix in _SUFFIXES])
    seat = model.owned_by(names.seat)
    occupied = (model.g_y != 0.0) | (model.g_ydot != 0.0)
    occupied[seat] = False
    occupied[:, seat] = False
    acts_elsewhere = occupied[model.reactions].any(axis=1) | occupied[:, model.reactions].any(axis=0)
    holds_seat = model.reactions[~acts_elsewhere]
    if len(holds_seat) == 0:
        raise MatrixError(
            f"no joint holds '{names.seat}' and nothing else; only a joint between the seat and the ground can be "
            "replaced by an imposed motion"
        )
    is_free = np.ones(len(model.names), dtype=bool)
    is_free[seat] = False
    is_free[holds_seat] = False
    keep = np.flatnonzero(is_free)
    free = model.restrict(keep)
    by_seat = _motion_of(np.zeros((1, 3)), names)[0]
    g_y_I = block(model.g_y, keep, imposed) @ by_seat
    g_ydot_I = block(model.g_ydot, keep, imposed) @ by_seat

    outputs: dict[str, Floats] = {}
    for name, weights in names.outputs.items():
        if outputs and not all((free.names == unknown.encode()).any() for unknown in weights):
            continue
        row = np.zeros(len(keep))
        for unknown, weight in weights.items():
            row[free.index(unknown)] += weight
        outputs[name] = row
    output_matrix = np.array(list(outputs.values()))

    form = second_order_form(free)
    m_I, d_I = g_ydot_I[free.definition_rows], g_y_I[free.definition_rows]
    M_I, C_I = np.zeros((len(form.M), len(names.inputs))), g_ydot_I[free.equilibrium_rows] + form.momentum_force @ m_I
    M_I[form.dynamic] = m_I
    C_I[form.dynamic] += d_I
    rigid = _rigid_motion(free, names, positions)
    watched = output_matrix[:, free.coordinates]
    moments = {
        name: free.index(MOMENTS[name]) for name in names.moments if (free.names == MOMENTS[name].encode()).any()
    }
    moment_rows = np.array([free.coordinates == column for column in moments.values()], dtype=float)
    return ImposedMotion(
        free=free,
        g_y_imposed=g_y_I,
        g_ydot_imposed=g_ydot_I,
        output_matrix=output_matrix,
        output_imposed=-watched @ rigid,
        inputs=names.inputs,
        outputs=(*outputs, *moments),
        form=form,
        M_imposed=M_I,
        C_imposed=C_I,
        K_imposed=g_y_I[free.equilibrium_rows] + form.momentum_force @ d_I,
        rigid=rigid,
        moment_rows=moment_rows.reshape(-1, len(free.coordinates)),
    )


_SUFFIXES = ("x", "y", "z", "gx", "gy", "gz")


def _motion_of(offsets: Floats, channels: Channels) -> Floats:
    """Motion of points that move with the seat, at `offsets` (m, 3) from its node: shape (m, 6, k).

    A point at r turns with the seat and moves by axis x (r - point).
    """
    motion = np.zeros((len(offsets), 6, len(channels.inputs)))
    for j, name in enumerate(channels.inputs):
        wanted = SEAT_MOTIONS[name]
        axis = np.array(wanted.axis)
        if wanted.rotation:
            motion[:, :3, j] = np.cross(axis, offsets - np.array(channels.point_m))
            motion[:, 3:, j] = axis
        else:
            motion[:, :3, j] = axis
    return motion


def _rigid_motion(free: DescriptorModel, channels: Channels, positions: Mapping[str, Floats] | None) -> Floats:
    """Every free coordinate when all nodes move with the seat, shape (n_q, k)."""
    if not any(SEAT_MOTIONS[name].rotation for name in channels.inputs):
        motion = _motion_of(np.zeros((1, 3)), channels)[0]
        endings = _endings(free.names[free.coordinates].tobytes(), free.names.dtype.str)
        rigid: Floats = np.vstack([motion, np.zeros(motion.shape[1])])[endings]
        return rigid
    if positions is None:
        raise MatrixError("rotations of the seat need the positions of the nodes, which come with a matrices file")
    rigid = np.empty((len(free.coordinates), len(channels.inputs)))
    for row, column in enumerate(free.coordinates):
        node, _, suffix = free.name(int(column)).rpartition(".")
        if suffix not in _SUFFIXES:  # a modal displacement, relative to the node that carries the body
            rigid[row] = 0.0
            continue
        if node not in positions or channels.seat not in positions:
            raise MatrixError(f"the position of node '{node}' or '{channels.seat}' is not known")
        offset = positions[node] - positions[channels.seat]
        rigid[row] = _motion_of(offset[None], channels)[0, _SUFFIXES.index(suffix)]
    return rigid


@lru_cache(maxsize=8)  # the pilots of a study differ in their numbers only
def _endings(name_bytes: bytes, name_type: str) -> Indices:
    """Which of the six coordinates of its node each coordinate is; 6: none, a modal displacement."""
    endings = [bytes(name).decode().rpartition(".")[2] for name in np.frombuffer(name_bytes, name_type)]
    return np.array([_SUFFIXES.index(ending) if ending in _SUFFIXES else len(_SUFFIXES) for ending in endings])


def translation_error(imposed: ImposedMotion, input: int = 0) -> float:
    """Return the largest relative violation of the invariance to an imposed translation.

    A pilot who touches nothing but the cockpit feels no force when cockpit and pilot translate together, at rest or at
    a constant rate: then phi/z has a double zero at s = 0, which the exact formula rests on.
    """
    free, form, shift = imposed.free, imposed.form, imposed.rigid[:, input]
    worst = 0.0
    for matrix, columns in (
        (form.K, imposed.K_imposed),
        (form.C, imposed.C_imposed),
        (form.Phi_0, imposed.g_y_imposed[free.constraint_rows]),
        (form.Phi_1, imposed.g_ydot_imposed[free.constraint_rows]),
    ):
        by_seat = columns[:, input]
        scale = np.abs(matrix).max(initial=0.0)
        if scale > 0.0 or np.any(by_seat):
            worst = max(worst, float(np.abs(matrix @ shift + by_seat).max()) / max(scale, float(np.abs(by_seat).max())))
    return worst


def rotation_error(imposed: ImposedMotion, input: int, fall: ImposedMotion) -> tuple[float, float]:
    """Return how far a rotation of cockpit and pilot is from a tilt of gravity, and the gravity that fits [m/s^2].

    A rotated cockpit differs from the one at rest by the direction of gravity alone, and gravity is an acceleration:
    the forces that a rigid rotation sets free are those of the horizontal acceleration axis x (0, -1, 0), times g,
    plus reactions; rotation at a constant rate sets none free; constraints stay closed. Yaw leaves gravity as it is.

    Parameters
    ----------
    imposed : ImposedMotion
        The model with a rotation as its input number `input`.
    input : int
        Which.
    fall : ImposedMotion
        The same model with the inputs surge and sway, in that order.

    Returns
    -------
    tuple of float
        Largest violation relative to the largest stiffness, damping or constraint entry; g (NaN for yaw).
    """
    free, form, w = imposed.free, imposed.form, imposed.rigid[:, input]
    worst = 0.0
    for matrix, columns in (
        (form.C, imposed.C_imposed),
        (form.Phi_0, imposed.g_y_imposed[free.constraint_rows]),
        (form.Phi_1, imposed.g_ydot_imposed[free.constraint_rows]),
    ):
        scale = np.abs(matrix).max(initial=0.0)
        if scale > 0.0 or np.any(columns):
            violation = np.abs(matrix @ w + columns[:, input]).max()
            worst = max(worst, float(violation) / max(scale, float(np.abs(columns).max())))
    forces = form.K @ w + imposed.K_imposed[:, input]
    surge, _, sway = np.cross(SEAT_MOTIONS[imposed.inputs[input]].axis, (0.0, -1.0, 0.0))
    inertia = (form.M @ fall.rigid + fall.M_imposed) @ np.array([surge, sway])
    columns = form.B if surge == sway == 0.0 else np.column_stack((inertia, form.B))
    fit = np.linalg.lstsq(columns, forces, rcond=None)[0]
    scale = max(float(np.abs(form.K).max(initial=0.0)), float(np.abs(forces).max()))
    worst = max(worst, float(np.abs(columns @ fit - forces).max()) / scale)
    return worst, float(fit[0]) if surge or sway else math.nan


def static_motion(imposed: ImposedMotion) -> tuple[Floats, Floats]:
    """Return the free coordinates, relative to the seat, per angle of tilt and its rate term, shapes (n_q, k).

    EvaluationError if the model is singular at rest.
    """
    form, free = imposed.form, imposed.free
    phi_0, phi_1 = imposed.g_y_imposed[free.constraint_rows], imposed.g_ydot_imposed[free.constraint_rows]
    Phi_0, Phi_1, B, phi_0, phi_1 = _independent(form, phi_0, phi_1)
    n_q = len(form.M)
    stiff = np.block([[form.K, B], [Phi_0, np.zeros((len(Phi_0), B.shape[1]))]])
    damp = np.block([[form.C, np.zeros_like(B)], [Phi_1, np.zeros((len(Phi_0), B.shape[1]))]])
    # relative to the rigid motion: forces are small there, and what is left is not a difference of large ones
    rest = np.vstack((form.K @ imposed.rigid + imposed.K_imposed, Phi_0 @ imposed.rigid + phi_0))
    rate = np.vstack((form.C @ imposed.rigid + imposed.C_imposed, Phi_1 @ imposed.rigid + phi_1))
    try:
        at_rest = np.linalg.solve(stiff, -rest)
        per_rate = np.linalg.solve(stiff, -(rate + damp @ at_rest))
    except np.linalg.LinAlgError as error:
        raise EvaluationError("feedthrough", "the pilot has no standing deflection: a motion is free") from error
    return at_rest[:n_q], per_rate[:n_q]


def static_terms(imposed: ImposedMotion) -> Floats:
    """Return F(0) and F'(0) of F(s) = output per imposed motion, shape (p, k, 2).

    EvaluationError if the model is singular at rest.

    Both vanish for translations. For rotations F(0) is the standing deflection per angle of tilt, and F'(0) its rate
    term: y/z'' = F(s)/s^2 has the double pole F(0)/s^2 + F'(0)/s at s = 0.
    """
    form, free = imposed.form, imposed.free
    at_rest, per_rate = static_motion(imposed)
    watched = imposed.output_matrix[:, free.coordinates]
    a = imposed.moment_rows
    moments = a @ (form.K @ (at_rest + imposed.rigid) + imposed.K_imposed)
    moment_rates = a @ (form.K @ per_rate + form.C @ (at_rest + imposed.rigid) + imposed.C_imposed)
    return np.stack((np.vstack((watched @ at_rest, moments)), np.vstack((watched @ per_rate, moment_rates))), axis=2)


def _independent(form: SecondOrderForm, phi_0: Floats, phi_1: Floats) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Phi_0, Phi_1, B and the imposed columns of an independent set of constraints, which says the same."""
    Phi_0, Phi_1, B = form.Phi_0, form.Phi_1, form.B
    rows = independent_constraints(Phi_0 + Phi_1)
    if len(rows) < len(Phi_0):
        Phi_0, Phi_1, phi_0, phi_1 = Phi_0[rows], Phi_1[rows], phi_0[rows], phi_1[rows]
        B = B[:, independent_constraints(B.T)]
    return Phi_0, Phi_1, B, phi_0, phi_1
