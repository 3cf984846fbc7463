"""What a template knows about the torso: bodies, frames, springs with their prestress, all as text.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import hashlib
from types import SimpleNamespace

import numpy as np

from pilotgen.anthropometry.torso import CARRIER
from pilotgen.decks.template_cache import Part
from pilotgen.decks.text import number, numbers, vector
from pilotgen.posture.seated_torso import FEM_NAME, Point, SeatedTorso, TorsoModes

FIRST_NODE, FIRST_SPRING, FIRST_FRAME = 31, 131, 31  # labels


def torso_text(seated: SeatedTorso) -> Part:
    """The torso of one pilot in his seat: bodies and springs, or with modes what of them is above the spine."""
    torso, modes = seated.torso, seated.modes
    rows, chain = torso.bodies, torso.springs
    carrier = seated.places[CARRIER]
    if modes is not None:
        above = [row.name for row in rows if row.name in torso.carriers.values()]  # the thorax, or girdles on it
        rows = tuple(row for row in rows if row.name == CARRIER or row.name in above)
        chain = tuple(spring for spring in chain if spring.second in above and spring.first == CARRIER)
        carrier = modes.place_m
    numbered = {row.name: FIRST_NODE + i for i, row in enumerate(rows)}
    bodies = [
        SimpleNamespace(
            name=row.name.upper(),
            what=row.what,
            label=str(numbered[row.name]),
            place=_point(carrier if row.name == CARRIER else seated.places[row.name]),
            mass=number(row.mass_kg),
            inertia=[number(row.mass_kg * row.gyration_m**2)],
        )
        for row in rows
    ]
    if modes is not None:
        thorax = bodies[[row.name for row in rows].index(CARRIER)]
        thorax.mass, thorax.inertia = number(modes.mass_kg), _numbers(modes.inertia_kg_m2)
    springs = [
        SimpleNamespace(
            name=f"{spring.name.upper()}_SPRING",
            of=spring.name.upper(),
            frame=f"{spring.name.upper()}_AT",
            label=str(FIRST_SPRING + i),
            frame_label=str(FIRST_FRAME + i),
            first=spring.first.upper(),
            second=spring.second.upper(),
            inclined=spring.inclined,
            carries=spring.carries,
            place=_point(seated.points[spring.name]),
            K=_numbers(spring.stiffness),
            C=_numbers(spring.damping),
            prestress=", ".join(_numbers(seated.prestress[spring.name])),
        )
        for i, spring in enumerate(chain)
    ]
    arms = [
        SimpleNamespace(
            name=f"CARRIED_{side.upper()}_ARM",
            side=side,
            label=str(FIRST_NODE + len(bodies) + i),
            mass=number(mass_kg),
            place=_point((at[0] - carrier[0], at[1] - carrier[1], at[2] - carrier[2])),
        )
        for i, (side, (mass_kg, at)) in enumerate(seated.carried_arms.items())
    ]
    return Part(
        bodies=bodies,
        springs=springs,
        carried_arms=arms,
        resonance=f"{torso.resonance_hz:.2f}",
        modes=_modes_text(modes) if modes is not None else False,
    )


def _modes_text(modes: TorsoModes) -> SimpleNamespace:
    return SimpleNamespace(
        interface=modes.interface,
        count=str(modes.count),
        preload=_numbers(modes.preload),
        file=FEM_NAME,
        sha256=hashlib.sha256(modes.fem.encode()).hexdigest()[:16],
    )


def _numbers(values: tuple[float, ...]) -> list[str]:
    return numbers(np.array(values))


def _point(point: Point) -> str:
    return vector(np.array(point))
