"""The torso in its seat: where its bodies and springs are, and what each spring carries in the posture.

The posture is the equilibrium: every spring that carries gets, as prestress, the wrench of the weights above it and of
what the hands hold, so that nothing sags and no spring has a strain. The seat back carries nothing. World axes.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from pilotgen.anthropometry.arm import SUFFIX
from pilotgen.anthropometry.body import Body
from pilotgen.anthropometry.torso import CARRIER, Six, Torso, TorsoSpring, torso_points
from pilotgen.posture.cockpit import Cockpit
from pilotgen.posture.kinematics import Pose

Point = tuple[float, float, float]
Load = tuple[Point, Point, Point]
"""A force [N], a couple [N m] and the point [m] at which the force acts."""


@dataclass(frozen=True)
class TorsoModes:
    """A spine reduced to modes, as a deck has it (docs/theory/spine.md).

    Attributes
    ----------
    interface : str
        Node of the `.fem` file that the thorax's node of the deck stands for.
    place_m : Point
        Where it is, world.
    mass_kg : float
        Of the slice of the trunk there, which is a body of the deck.
    inertia_kg_m2 : tuple of 3 floats
        About its centre of mass, world axes.
    count : int
        Number of modes.
    preload : tuple of float
        Constant forces on the modal equations.
    fem : str
        Text of the `.fem` file.
    """

    interface: str
    place_m: Point
    mass_kg: float
    inertia_kg_m2: tuple[float, float, float]
    count: int
    preload: tuple[float, ...]
    fem: str


FEM_NAME = "torso.fem"


@dataclass(frozen=True)
class SeatedTorso:
    """A torso placed in the cockpit; every body has the world's axes.

    Attributes
    ----------
    torso : Torso
        What is placed.
    places : dict
        Centre of mass of each body, world [m].
    points : dict
        Point of each spring, world [m].
    back_angle_deg : float
        Of the axes of inclined springs, from vertical.
    carried_arms : dict
        Mass [kg] and place [m] of an arm that is not in the deck, by side.
    prestress : dict
        By spring: force and moment on its first body about the spring's point, in the spring's axes [N, N m].
    modes : TorsoModes, optional
        The distributed spine, reduced, that stands in a deck instead of bodies and springs up to the shoulders.
    """

    torso: Torso
    places: dict[str, Point]
    points: dict[str, Point]
    back_angle_deg: float
    carried_arms: dict[str, tuple[float, Point]]
    prestress: dict[str, Six]
    modes: TorsoModes | None = None


def seat_torso(
    torso: Torso,
    body: Body,
    cockpit: Cockpit,
    poses: Mapping[str, Pose],
    hand_loads: Mapping[str, Load],
    gravity_m_per_s2: float,
) -> SeatedTorso:
    """Put a torso into its seat and prestress its springs.

    Parameters
    ----------
    torso : Torso
        The torso.
    body : Body
        The arms in the deck.
    cockpit : Cockpit
        Seat, shoulders.
    poses : mapping
        Bones of the arms in the posture, by deck name.
    hand_loads : mapping
        What the control puts on the hand, by side.
    gravity_m_per_s2 : float
        Along -y.
    """
    angle = math.radians(cockpit.back_angle_deg)
    known = placed_points(cockpit)
    places = {row.name: known[row.point] for row in torso.bodies}
    points = {spring.name: known[spring.point] for spring in torso.springs}
    arms = {other: (mass_kg, known[f"glenohumeral_{SUFFIX[other]}"]) for other, mass_kg in torso.carried_arms.items()}
    loads = _loads(torso, body, places, arms, poses, hand_loads, gravity_m_per_s2)
    carried = {spring.name: _prestress(spring, torso, loads, points[spring.name], angle) for spring in torso.springs}
    return SeatedTorso(
        torso=torso,
        places=places,
        points=points,
        back_angle_deg=cockpit.back_angle_deg,
        carried_arms=arms,
        prestress=carried,
    )


def placed_points(cockpit: Cockpit) -> dict[str, Point]:
    """The points of the torso's table and both shoulders in a pilot's seat, world [m]; stretched with his shoulders."""
    table, reference_up = torso_points()
    side, (shoulder, _) = next(iter(cockpit.torso.items()))
    angle = math.radians(cockpit.back_angle_deg)
    c, s = math.cos(angle), math.sin(angle)
    dx, dy = cockpit.seat_shift_m.tolist()
    x, y, z = shoulder.tolist()
    stretch = shoulder_up_m(cockpit) / reference_up

    def place(name: str) -> Point:
        forward, up = table[name]
        up *= stretch
        return forward * c - up * s + dx, up * c + forward * s + dy, 0.0

    known = {name: place(name) for name in table}
    for other in ("left", "right"):
        known[f"glenohumeral_{SUFFIX[other]}"] = (x, y, z if other == side else -z)
    return known


def shoulder_up_m(cockpit: Cockpit) -> float:
    """Height of the shoulder joints along the seat back, from the seat reference point [m]."""
    shoulder, _ = next(iter(cockpit.torso.values()))
    angle = math.radians(cockpit.back_angle_deg)
    dx, dy = cockpit.seat_shift_m.tolist()
    x, y, _ = shoulder.tolist()
    return float((y - dy) * math.cos(angle) - (x - dx) * math.sin(angle))


def _loads(
    torso: Torso,
    body: Body,
    places: Mapping[str, Point],
    arms: Mapping[str, tuple[float, Point]],
    poses: Mapping[str, Pose],
    hand_loads: Mapping[str, Load],
    gravity: float,
) -> dict[str, list[Load]]:
    """What each body of the torso has to hold: its own weight, and that of the arms with what their hands hold."""
    nothing = (0.0, 0.0, 0.0)

    def weight(mass_kg: float, at: Point) -> Load:
        return (0.0, -mass_kg * gravity, 0.0), nothing, at

    loads = {row.name: [weight(row.mass_kg, places[row.name])] for row in torso.bodies}
    loads[CARRIER] += [weight(mass_kg, at) for mass_kg, at in arms.values()]
    for side, limb in body.limbs.items():
        held = loads[torso.carriers[side]]
        for name, segment in limb.segments.items():
            origin, R = poses[f"{name}_{SUFFIX[side]}"]
            px, py, pz = (origin + R @ segment.com_m).tolist()
            held.append(weight(segment.mass_kg, (px, py, pz)))
        if side in hand_loads:
            held.append(hand_loads[side])
    return loads


def _prestress(
    spring: TorsoSpring, torso: Torso, loads: Mapping[str, Iterable[Load]], point: Point, back_angle: float
) -> Six:
    if not spring.carries:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    fx = fy = fz = mx = my = mz = 0.0
    for name in _above(spring, torso):
        for (ax, ay, az), (cx, cy, cz), (x, y, z) in loads[name]:
            rx, ry, rz = x - point[0], y - point[1], z - point[2]
            fx, fy, fz = fx + ax, fy + ay, fz + az
            mx += cx + ry * az - rz * ay
            my += cy + rz * ax - rx * az
            mz += cz + rx * ay - ry * ax
    if not spring.inclined:
        return fx, fy, fz, mx, my, mz
    c, s = math.cos(back_angle), math.sin(back_angle)
    return c * fx + s * fy, c * fy - s * fx, fz, c * mx + s * my, c * my - s * mx, mz


def _above(spring: TorsoSpring, torso: Torso) -> list[str]:
    """Bodies that a spring carries: its second one and what stands on it."""
    found = [spring.second]
    for name in found:
        found += [other.second for other in torso.springs if other.carries and other.first == name]
    return found
