"""What a deck holds of the rotorcraft that the pilot sits in: rows of a linear network, and what acts on it, as data.

A row is one equation, 0 = sum of terms; each row belongs to an abstract node, each term reads a node's value or rate.
`pilotgen/loop/network.py` makes rows of a rotorcraft, `vehicle_text` makes text of them for templates/vehicle.mbd.j2.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

from pilotgen.decks.template_cache import Part
from pilotgen.decks.text import number

PARTS = ("trim", "pitch", "delay", "chain", "rotorcraft", "plant")
"""Kinds of parts, in the order in which they stand in a deck."""

TRAVEL, SEAT_FORCE = "GRIP_TRAVEL", "SEAT_FORCE"
PEDESTAL = "HEIGHT"  # the node that the seat follows
FIRST_LABEL = 401
GUST_DRIVE = "2"  # label of its drive caller; that of a pull is 1
FIXED_GENELS = 8  # of the seat's follower and of the grip's travel, written out in the template
CLAMPING_N = 1e4  # preload of the friction joint: far above any reaction of the hinge, so that they play no part


@dataclass(frozen=True)
class Term:
    """`value` times the value (or rate) of an abstract node."""

    node: str
    value: float
    rate: bool = False


@dataclass(frozen=True)
class NetworkRow:
    """The equation of one abstract node: 0 = sum of terms + constant."""

    node: str
    terms: tuple[Term, ...]
    constant: float = 0.0


@dataclass(frozen=True)
class Friction:
    """Friction of the lever at its grip (study key `inceptor.friction`), as the deck's hinge has it.

    Attributes
    ----------
    breakout_n, sliding_n : float
        Force at the grip that starts the lever, and that of fast sliding [N].
    velocity_m_s : float
        Velocity of the grip by which the difference has fallen to 1/e [m/s].
    viscous_n_s_per_m : float
        Grows with velocity [N s/m].
    presliding_m : float
        Elastic travel of the grip before it slides [m].
    model : str
        `lugre` or `coulomb`.
    """

    breakout_n: float
    sliding_n: float
    velocity_m_s: float
    viscous_n_s_per_m: float
    presliding_m: float
    model: str = "coulomb"

    @property
    def bristle_n_per_m(self) -> float:
        """Stiffness of the stuck lever at its grip [N/m]."""
        return self.breakout_n / self.presliding_m

    @property
    def bristle_n_s_per_m(self) -> float:
        """Damping of the bristles [N s/m]: a tenth of the breakout force at 0.2 m/s, so that turns add no force."""
        return 0.5 * self.breakout_n


KAPPA = 0.7  # share of the elastic range in which bristles do not slip at all (Dupont's elasto-plastic model)


@dataclass(frozen=True)
class Stops:
    """Ends of the lever's travel: angles above horizontal [rad], stiffness [N m/rad]."""

    low_rad: float
    high_rad: float
    stiffness_n_m_per_rad: float


@dataclass(frozen=True)
class Vehicle:
    """All that a pilot's deck has more when the loop is closed in it.

    Attributes
    ----------
    parts : mapping
        Rows by kind of part (`PARTS`).
    seat_force_n : float
        Weight that the seat carries at rest, the starting value of its force [N].
    gust : tuple or None
        Drive of rising air [m/s], and what 1 m/s adds to rows, by node.
    lever_drive : str or None
        Drive of a moment on the lever, up positive [N m].
    pull : tuple or None
        Drive of a pull by the muscles, and what it adds to each activation at drive 1, in deck order.
    friction, stops
        Of the lever; None: none.
    two_way : bool
        Whether the pilot's reaction acts on the rotorcraft.
    """

    parts: Mapping[str, tuple[NetworkRow, ...]]
    seat_force_n: float
    gust: tuple[str, Sequence[tuple[str, float]]] | None = None
    lever_drive: str | None = None
    pull: tuple[str, Sequence[float]] | None = None
    friction: Friction | None = None
    stops: Stops | None = None
    two_way: bool = False
    names: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        rows = [row.node for kind in PARTS for row in self.parts.get(kind, ())]
        object.__setattr__(self, "names", (TRAVEL, SEAT_FORCE, *rows))


def vehicle_text(vehicle: Vehicle, lever_axis_m: Sequence[float]) -> Part:
    """What templates/vehicle.mbd.j2 prints; `lever_axis_m` is where the lever's hinge is in the seat, (3,) [m]."""
    label = FIXED_GENELS + 1
    parts: dict[str, Any] = {}
    forces: list[dict[str, Any]] = []
    for kind in PARTS:
        genels: list[SimpleNamespace] = []
        for row in vehicle.parts.get(kind, ()):
            for column, law in _laws(row):
                own = column == row.node
                genels.append(SimpleNamespace(label=str(label), row=row.node, column=column, own=own, law=law))
                label += 1
            if row.constant:
                forces.append({"node": row.node, "drive": f"const, {number(row.constant)}"})
        parts[kind] = genels if genels else False
    for node, factor in vehicle.gust[1] if vehicle.gust else ():
        forces.append({"node": node, "drive": f"mult, const, {number(factor)}, reference, {GUST_DRIVE}"})
    couples = (vehicle.lever_drive is not None) + (vehicle.stops is not None)
    first = 1 + 2  # the two forces of the grip's travel
    return Part(
        axis=SimpleNamespace(x=number(lever_axis_m[0]), y=number(lever_axis_m[1])),
        nodes=[
            SimpleNamespace(
                name=name,
                label=str(FIRST_LABEL + i),
                start=SimpleNamespace(value=number(vehicle.seat_force_n)) if name == SEAT_FORCE else False,
            )
            for i, name in enumerate(vehicle.names)
        ],
        **parts,
        forces=[SimpleNamespace(label=str(first + couples + i), **force) for i, force in enumerate(forces)],
        lever_drive=SimpleNamespace(label=str(first), drive=vehicle.lever_drive) if vehicle.lever_drive else False,
        stops=_stops_text(vehicle.stops, str(first + couples - 1)) if vehicle.stops else False,
        friction=_friction_text(vehicle.friction) if vehicle.friction else False,
        gust=SimpleNamespace(drive=vehicle.gust[0], label=GUST_DRIVE) if vehicle.gust else False,
        pull=SimpleNamespace(drive=vehicle.pull[0]) if vehicle.pull else False,
        two_way=vehicle.two_way,
        counts=SimpleNamespace(
            abstract=str(len(vehicle.names)), genels=str(label - 1), forces=str(2 + couples + len(forces))
        ),
    )


def _laws(row: NetworkRow) -> list[tuple[str, str]]:
    """Constitutive laws of one row, by column: a spring pulls with minus the term."""
    columns = list(dict.fromkeys([row.node, *(term.node for term in row.terms)]))
    laws = []
    for column in columns:
        stiffness, damping = (
            -math.fsum(term.value for term in row.terms if term.node == column and term.rate is rate)
            for rate in (False, True)
        )
        if stiffness and damping:
            laws.append((column, f"linear viscoelastic, {number(stiffness)}, {number(damping)}"))
        elif damping:
            laws.append((column, f"linear viscous, {number(damping)}"))
        elif stiffness:
            laws.append((column, f"linear elastic, {number(stiffness)}"))
    return laws


def _stops_text(stops: Stops, label: str) -> SimpleNamespace:
    return SimpleNamespace(
        label=label,
        low=number(stops.low_rad),
        high=number(stops.high_rad),
        stiffness=number(stops.stiffness_n_m_per_rad),
    )


def _friction_text(friction: Friction) -> SimpleNamespace:
    """Coefficients of friction are forces at the grip over the clamping force; the radius is the lever's length."""
    drop = friction.breakout_n - friction.sliding_n
    return SimpleNamespace(
        lugre=friction.model == "lugre",
        drops=drop > 0.0,
        clamping=number(CLAMPING_N),
        sliding=number(friction.sliding_n / CLAMPING_N),
        drop=number(drop / CLAMPING_N),
        rate=number(-1.0 / friction.velocity_m_s),
        sigma0=number(friction.bristle_n_per_m / CLAMPING_N),
        sigma1=number(friction.bristle_n_s_per_m / CLAMPING_N),
        sigma2=number(friction.viscous_n_s_per_m / CLAMPING_N),
        viscous=friction.viscous_n_s_per_m > 0.0,
        kappa=number(KAPPA),
    )
