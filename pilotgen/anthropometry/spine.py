"""Distributed spine of one pilot: a chain of rigid slices and springs as mass, damping and stiffness matrices.

The chain stands on the seat: (pan,) pelvis, 17 levels from L5 to T1, head, viscera. Numbers are in `data/spine.yaml`;
docs/theory/spine.md is the account. All vectors and matrices have world axes (x forward, y up, z right) and SI units; a
body has six degrees of freedom: displacement of its centre of mass [m], small rotation [rad]. The seat is at rest in
them: bodies move relative to a seat that itself may move.

`reduce_spine` (spine_modes.py) reduces the matrices to the bodies that the rest of a deck is fixed to.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from pilotgen.errors import EvaluationError
from pilotgen.study.yaml_file import bundled

SEAT = "seat"  # what the chain stands on
FREEDOMS = 6  # per body

Floats = np.ndarray
Pair = tuple[Sequence[float], Sequence[float]]
"""Stiffness [N/m, N m/rad] and damping [N s/m, N m s/rad] along and about a spring's axes 1, 2, 3."""


@dataclass(frozen=True)
class SpineBody:
    """One rigid body."""

    name: str
    mass_kg: float
    inertia_kg_m2: tuple[float, float, float]  # about its centre of mass, world axes, no products
    place_m: tuple[float, float, float]  # centre of mass, world


@dataclass(frozen=True)
class SpineSpring:
    """A spring with a damper in six directions at a point, between a body and one farther from the seat."""

    name: str
    first: str  # body, or seat
    second: str
    point_m: tuple[float, float, float]  # world
    axes: Floats  # (3, 3), columns: the spring's axes in the world
    stiffness: tuple[float, ...]  # (6,)
    damping: tuple[float, ...]  # (6,)
    carries: bool = True  # the weight of what is above it


@dataclass(frozen=True)
class SpineSeat:
    """Where the spine sits."""

    origin_m: tuple[float, float, float]  # of the seat's node: (0, 0, 0) unless the deck has it elsewhere
    reference_m: tuple[float, float]  # seat reference point after adjustment, x and y
    back_angle_deg: float  # from vertical
    shoulder_up_m: float  # height of the shoulder joints along the back


@dataclass(frozen=True)
class SpineModel:
    """The chain assembled.

    Attributes
    ----------
    bodies : tuple of SpineBody
        In the order of the degrees of freedom.
    springs : tuple of SpineSpring
        Every spring that carries has another `second` body.
    origin_m : (3,) floats
        Of the seat's node.
    M, C, K : (6n, 6n) floats
        Mass, damping, stiffness. K is the tangent under load: springs and the geometric part of their prestress, not
        symmetric, as the moment on a body is not conjugate to the rotations that the rows are written in.
    prestress : dict
        By spring: force and moment on its first body about its point, in its axes [N, N m].
    loads : dict
        By name of bodies that carry something else than the chain: force and moment about the body's centre of mass
        [N, N m].
    gravity_m_per_s2 : (3,) floats
        Acceleration, world.
    """

    bodies: tuple[SpineBody, ...]
    springs: tuple[SpineSpring, ...]
    origin_m: Floats
    M: Floats
    C: Floats
    K: Floats
    prestress: dict[str, Floats]
    loads: dict[str, Floats]
    gravity_m_per_s2: Floats

    def index(self, name: str) -> int:
        """Place of a body in the chain."""
        return [body.name for body in self.bodies].index(name)

    def freedoms(self, name: str) -> slice:
        """Its degrees of freedom."""
        first = FREEDOMS * self.index(name)
        return slice(first, first + FREEDOMS)

    @property
    def heave(self) -> Floats:
        """Displacements (6n,) of a chain that moves up by 1 m as a rigid body."""
        out = np.zeros(len(self.M))
        out[1::FREEDOMS] = 1.0
        return out


def spine_model(
    masses_kg: Mapping[str, float],
    springs: Mapping[str, Pair],
    *,
    stature_m: float,
    seat: SpineSeat,
    gyration_m: Mapping[str, float],
    points: Mapping[str, tuple[float, float]],
    upper_trunk_kg: float,
    carrier_load: Sequence[float],
    gravity_m_per_s2: float = 9.81,
) -> SpineModel:
    """Make the spine of one pilot from his lumped torso.

    Parameters
    ----------
    masses_kg : mapping
        Of the lumped torso's bodies `pelvis`, `thorax`, `viscera`, `head` and, on a cushion, `pan`.
    springs : mapping
        Stiffness and damping, scaled to the person, of the lumped torso's `buttocks`, `lumbar`, `viscera`, `neck`,
        `back` and, with a pan, `cushion`. Those of `lumbar` are spread over the joints of the spine.
    stature_m : float
        Of the pilot.
    seat : SpineSeat
        Where he sits.
    gyration_m : mapping
        Radii of gyration of pelvis, viscera, head (and pan).
    points : mapping
        `contact`, `hip`, `back_t8`, `neck_t1`, `head`, `viscera` of the lumped torso: forward of the back, up along it
        [m], for the table's shoulder height.
    upper_trunk_kg : float
        What of the thorax is upper trunk; the rest is middle trunk.
    carrier_load : sequence of 6 floats
        Force and moment about the carrier's centre of mass (`carrier_place`) from arms, muscles and everything else
        that hangs on the shoulders, weights included, but not the carrier's own weight [N, N m], world.
    gravity_m_per_s2 : float
        Along -y.

    Returns
    -------
    SpineModel
        Of 20 bodies, or 21 with a pan.

    Raises
    ------
    EvaluationError
        Stage "torso": a mass, stiffness or damping that no person has.
    """
    table = _table()
    for name, mass in masses_kg.items():
        if not (math.isfinite(mass) and mass > 0.0):
            raise EvaluationError("torso", f"the {name} would weigh {mass:.4g} kg; a positive mass is wanted")
    if not 0.0 < upper_trunk_kg < masses_kg["thorax"]:
        raise EvaluationError(
            "torso",
            f"the upper trunk would weigh {upper_trunk_kg:.4g} kg of the thorax's {masses_kg['thorax']:.4g} kg; a part "
            "of it is wanted",
        )
    where = _Places(seat, table)
    long = stature_m / table["reference_stature_m"]
    bodies, chain = [], []

    def ball(name: str, point: str) -> SpineBody:
        inertia = masses_kg[name] * gyration_m[name] ** 2
        return SpineBody(name, masses_kg[name], (inertia, inertia, inertia), where.point(points[point]))

    def spring(name: str, first: str, second: str, point: str, inclined: bool, carries: bool = True) -> SpineSpring:
        k, c = springs[name]
        axes = where.axes if inclined else np.eye(3)
        return SpineSpring(name, first, second, where.point(points[point]), axes, tuple(k), tuple(c), carries)

    below = SEAT
    if "pan" in masses_kg:
        bodies.append(ball("pan", "contact"))
        chain.append(spring("cushion", SEAT, "pan", "contact", False))
        below = "pan"
    bodies.append(ball("pelvis", "hip"))
    chain.append(spring("buttocks", below, "pelvis", "contact", False))
    levels = _levels(table)
    slices = _slices(table, masses_kg["thorax"], upper_trunk_kg)
    below = "pelvis"
    for level, pair in zip(levels, _joints(table, levels, springs["lumbar"]), strict=True):
        bodies.append(_slice(level, slices[level.name], long, where, table))
        at = where.point((_forward(table, level.joint_up_m), level.joint_up_m))
        chain.append(SpineSpring(f"{below}_{level.name}", below, level.name, at, where.axes, *pair))
        below = level.name
    bodies.append(ball("head", "head"))
    chain.append(spring("neck", below, "head", "neck_t1", False))
    bodies.append(ball("viscera", "viscera"))
    chain.append(spring("viscera", "pelvis", "viscera", "viscera", False))
    chain.append(spring("back", SEAT, table["back"], "back_t8", True, carries=False))
    gravity = np.array([0.0, -gravity_m_per_s2, 0.0])
    load = np.asarray(carrier_load, dtype=float)
    return assemble_spine(bodies, chain, {table["carrier"]: load}, gravity, np.asarray(seat.origin_m, dtype=float))


def carrier_name() -> str:
    """Name of the body that carries shoulders and muscle origins."""
    return str(_table()["carrier"])


def carrier_place(seat: SpineSeat) -> tuple[float, float, float]:
    """Centre of mass of the body that carries the shoulders, world [m]: where the deck's node for it stands."""
    table = _table()
    level = next(level for level in _levels(table) if level.name == table["carrier"])
    return _Places(seat, table).point((table["slice_forward_m"], level.centre_up_m))


def assemble_spine(
    bodies: Sequence[SpineBody],
    springs: Sequence[SpineSpring],
    loads: Mapping[str, Floats],
    gravity_m_per_s2: Floats,
    origin_m: Floats,
) -> SpineModel:
    """Assemble a chain of bodies and springs in equilibrium.

    Parameters
    ----------
    bodies, springs : sequence
        The springs that carry have to lead from the seat to every body on exactly one way.
    loads : mapping
        Force and moment about the centre of mass of bodies that carry something else [N, N m].
    gravity_m_per_s2, origin_m : (3,) floats
        World.

    Raises
    ------
    EvaluationError
        Stage "torso": a stiffness that is not positive, a damping that is negative, a chain that does not stand on the
        seat.
    """
    place = {body.name: i for i, body in enumerate(bodies)}
    _check(springs, place)
    size = FREEDOMS * len(bodies)
    M = np.zeros(size)
    for body, i in zip(bodies, range(0, size, FREEDOMS), strict=True):
        M[i : i + 3] = body.mass_kg
        M[i + 3 : i + 6] = body.inertia_kg_m2
    centres = np.array([*(body.place_m for body in bodies), origin_m])  # the seat last
    first = np.array([place.get(spring.first, len(bodies)) for spring in springs])
    second = np.array([place[spring.second] for spring in springs])
    points = np.array([spring.point_m for spring in springs])
    axes = np.array([spring.axes for spring in springs])
    carried = _carried(bodies, springs, loads, gravity_m_per_s2, centres, place)
    wrenches = _about_points(carried, points)
    stiffness, damping = _spring_matrices(springs, axes, wrenches, points - centres[first], points - centres[second])
    freedoms = np.arange(FREEDOMS)
    ends = np.concatenate([FREEDOMS * first[:, None] + freedoms, FREEDOMS * second[:, None] + freedoms], axis=1)
    at = (ends[:, :, None], ends[:, None, :])
    C, K = np.zeros((size + FREEDOMS,) * 2), np.zeros((size + FREEDOMS,) * 2)
    np.add.at(K, at, stiffness)
    np.add.at(C, at, damping)
    C, K = C[:size, :size].copy(), K[:size, :size].copy()  # the seat does not move
    in_axes = np.concatenate(
        [np.einsum("nij,ni->nj", axes, wrenches[:, :3]), np.einsum("nij,ni->nj", axes, wrenches[:, 3:])], axis=1
    )
    prestress = {spring.name: row for spring, row in zip(springs, in_axes, strict=True)}
    return SpineModel(
        bodies=tuple(bodies),
        springs=tuple(springs),
        origin_m=np.asarray(origin_m, dtype=float),
        M=np.diag(M),
        C=C,
        K=K,
        prestress=prestress,
        loads={name: np.asarray(load, dtype=float) for name, load in loads.items()},
        gravity_m_per_s2=np.asarray(gravity_m_per_s2, dtype=float),
    )


# ---- the table -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Level:
    name: str
    axial_n_per_m: float
    height_m: float
    joint_up_m: float  # of the joint below it
    centre_up_m: float

    @property
    def lumbar(self) -> bool:
        return self.name.startswith("L") or self.name == "T12"  # the joint below T12 is the uppermost lumbar one


class _Places:
    """From the back's coordinates to the world."""

    def __init__(self, seat: SpineSeat, table: Mapping[str, Any]) -> None:
        angle = math.radians(seat.back_angle_deg)
        self.c, self.s = math.cos(angle), math.sin(angle)
        self.x, self.y = seat.reference_m
        self.stretch = seat.shoulder_up_m / table["shoulder_up_m"]
        self.axes = np.array([[self.c, -self.s, 0.0], [self.s, self.c, 0.0], [0.0, 0.0, 1.0]])

    def point(self, on_the_back: tuple[float, float]) -> tuple[float, float, float]:
        forward, up = on_the_back[0], on_the_back[1] * self.stretch
        return self.x + forward * self.c - up * self.s, self.y + up * self.c + forward * self.s, 0.0


@cache
def _table() -> dict[str, Any]:
    table: dict[str, Any] = bundled("spine").value
    return table


def _levels(table: Mapping[str, Any]) -> list[_Level]:
    out = []
    up = table["lowest_joint_up_m"]
    for name, axial, height in table["levels"]["rows"]:
        out.append(_Level(name, 1e6 * axial, height, up, up + 0.5 * height))
        up += height
    return out


def _forward(table: Mapping[str, Any], up: float) -> float:
    heights, forward = zip(*table["line"], strict=True)
    return float(np.interp(up, heights, forward))


def _slices(table: Mapping[str, Any], thorax_kg: float, upper_trunk_kg: float) -> dict[str, float]:
    """Mass of every level: its part's by height."""
    heights = {row[0]: row[2] for row in table["levels"]["rows"]}
    out: dict[str, float] = {}
    for part, mass in (("upper_trunk", upper_trunk_kg), ("middle_trunk", thorax_kg - upper_trunk_kg)):
        total = sum(heights[name] for name in table[part])
        out.update({name: mass * heights[name] / total for name in table[part]})
    return out


def _slice(level: _Level, mass_kg: float, long: float, where: _Places, table: Mapping[str, Any]) -> SpineBody:
    deep, broad = (long * table["slice_gyration_m"][side] for side in ("fore_aft", "lateral"))
    thick = where.stretch * level.height_m / math.sqrt(12.0)
    inertia = (broad**2 + thick**2, deep**2 + broad**2, deep**2 + thick**2)
    return SpineBody(
        level.name,
        mass_kg,
        (mass_kg * inertia[0], mass_kg * inertia[1], mass_kg * inertia[2]),
        where.point((table["slice_forward_m"], level.centre_up_m)),
    )


def _joints(
    table: Mapping[str, Any], levels: Sequence[_Level], lumbar: Pair
) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Stiffness and damping of the joint below every level, from the lumped lumbar spring."""
    (shear, axial, lateral, roll, yaw, pitch), damping = (tuple(map(float, row)) for row in lumbar)
    ribs = table["thoracic_over_lumbar_bending"]
    carrier = [level.name for level in levels].index(table["carrier"])
    below = levels[: carrier + 1]  # the joints between pelvis and shoulders
    bending = sum(1.0 if level.lumbar else 1.0 / ribs for level in below)
    time = [c / k for c, k in zip(damping, (shear, axial, lateral, roll, yaw, pitch), strict=True)]
    out: list[tuple[tuple[float, ...], tuple[float, ...]]] = []
    for level in levels:
        stiff = bending * (1.0 if level.lumbar else ribs)
        k = (
            len(below) * shear,
            level.axial_n_per_m * axial / table["lumped_axial_n_per_m"],
            len(below) * lateral,
            stiff * roll,
            stiff * yaw,
            stiff * pitch,
        )
        out.append((k, tuple(t * x for t, x in zip(time, k, strict=True))))
    return out


# ---- statics and tangents --------------------------------------------------------------------------------------------


def _check(springs: Sequence[SpineSpring], place: Mapping[str, int]) -> None:
    held = [spring.second for spring in springs if spring.carries]
    if sorted(held) != sorted(place) or any(s.first != SEAT and s.first not in place for s in springs):
        raise EvaluationError(
            "torso", "the springs that carry do not lead from the seat to every body of the spine on one way"
        )
    stiffness, damping = (np.array([getattr(s, what) for s in springs]) for what in ("stiffness", "damping"))
    numbers = np.concatenate((stiffness, damping))
    carrying = stiffness[[spring.carries for spring in springs]]
    if np.isfinite(numbers).all() and (numbers >= 0.0).all() and (carrying > 0.0).all():
        return
    for spring in springs:
        if spring.carries and not all(math.isfinite(k) and k > 0.0 for k in spring.stiffness):
            raise EvaluationError(
                "torso", f"spring {spring.name} has stiffness {spring.stiffness}; positive numbers are wanted"
            )
        if not all(math.isfinite(x) and x >= 0.0 for x in (*spring.stiffness, *spring.damping)):
            raise EvaluationError(
                "torso", f"spring {spring.name} has a negative stiffness or damping; 0 or more is wanted"
            )


def _carried(
    bodies: Sequence[SpineBody],
    springs: Sequence[SpineSpring],
    loads: Mapping[str, Floats],
    gravity: Floats,
    centres: Floats,
    place: Mapping[str, int],
) -> Floats:
    """Force and moment about the world's origin (n, 6) of all that every spring carries."""
    own = np.zeros((len(bodies), 6))  # of every body with all above it; springs are in the order of the load
    own[:, :3] = np.array([body.mass_kg for body in bodies])[:, None] * gravity
    for name, load in loads.items():
        own[place[name]] += load
    own[:, 3:] += _cross(centres[: len(bodies)], own[:, :3])
    for spring in reversed(springs):
        if spring.carries and spring.first != SEAT:
            own[place[spring.first]] += own[place[spring.second]]
    out = own[[place[spring.second] for spring in springs]]
    out[[not spring.carries for spring in springs]] = 0.0
    return out


def _about_points(wrenches: Floats, points: Floats) -> Floats:
    """The same with moments about other points (n, 3)."""
    out = wrenches.copy()
    out[:, 3:] -= _cross(points, wrenches[:, :3])
    return out


def _spring_matrices(
    springs: Sequence[SpineSpring], axes: Floats, wrenches: Floats, arms1: Floats, arms2: Floats
) -> tuple[Floats, Floats]:
    """Tangent stiffness and damping (n, 12, 12) of springs without strain: minus force and moment on their bodies.

    Force and moment turn with the first body: (F, M + d1 x F) on it, -(F, M + d2 x F) on the second, d1 and d2 (n, 3)
    from the centres of mass to the point. Motion: (x1, phi1, x2, phi2).
    """
    n = len(springs)
    d1, d2, Fx = _skew(arms1), _skew(arms2), _skew(wrenches[:, :3])
    frame = np.zeros((n, 6, 6))
    frame[:, :3, :3] = frame[:, 3:, 3:] = axes
    turned = frame.transpose(0, 2, 1)
    one = np.eye(3)
    strain = np.zeros((n, 6, 12))
    strain[:, :3, :3], strain[:, :3, 3:6], strain[:, :3, 6:9], strain[:, :3, 9:] = -one, d1, one, -d2
    strain[:, 3:, 3:6], strain[:, 3:, 9:] = -one, one
    wrench = (frame * np.array([spring.stiffness for spring in springs])[:, None, :]) @ (turned @ strain)
    rate = (frame * np.array([spring.damping for spring in springs])[:, None, :]) @ (turned @ strain)
    wrench[:, :3, 3:6] -= Fx
    wrench[:, 3:, 3:6] -= _skew(wrenches[:, 3:])
    stiffness, damping = np.empty((n, 12, 12)), np.empty((n, 12, 12))
    for row, sign, arm in ((0, -1.0, d1), (6, 1.0, d2)):
        stiffness[:, row : row + 3] = sign * wrench[:, :3]
        damping[:, row : row + 3] = sign * rate[:, :3]
        moments = wrench[:, 3:] + arm @ wrench[:, :3]
        moments[:, :, 9:] += Fx @ d2
        if row == 0:  # the arm of the first body reaches to the second's point
            moments[:, :, :3] += Fx
            moments[:, :, 6:9] -= Fx
        stiffness[:, row + 3 : row + 6] = sign * moments
        damping[:, row + 3 : row + 6] = sign * (rate[:, 3:] + arm @ rate[:, :3])
    return stiffness, damping


def _skew(a: Floats) -> Floats:
    """Matrices (n, 3, 3) of the cross product by vectors (n, 3)."""
    out = np.zeros((len(a), 3, 3))
    out[:, 2, 1], out[:, 0, 2], out[:, 1, 0] = a.T
    return out - out.transpose(0, 2, 1)


def _cross(a: Floats, b: Floats) -> Floats:
    """Cross products of vectors (n, 3); quicker than numpy's."""
    return np.asarray(np.einsum("nij,nj->ni", _skew(a), b))
