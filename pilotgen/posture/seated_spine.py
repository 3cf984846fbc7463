"""The distributed spine of a pilot in his seat, in place of his lumped torso.

The lumped torso in its seat (`seated_torso`) has everything that the chain needs: masses, springs scaled to the person,
places, and in the prestress of its lumbar spring what the arms put on the shoulders. World axes.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import numpy as np

from pilotgen.anthropometry.biometrics import Biometrics
from pilotgen.anthropometry.spine import SpineModel, SpineSeat, carrier_name, carrier_place, spine_model
from pilotgen.anthropometry.spine_modes import fem_text, reduce_spine
from pilotgen.anthropometry.torso import CARRIER, torso_points, upper_trunk_share
from pilotgen.posture.cockpit import Cockpit
from pilotgen.posture.seated_torso import SeatedTorso, TorsoModes, shoulder_up_m


def seated_spine(seated: SeatedTorso, cockpit: Cockpit, biometrics: Biometrics, gravity_m_per_s2: float) -> SpineModel:
    """Make the chain of bodies and springs that stands for a torso in its seat.

    Parameters
    ----------
    seated : SeatedTorso
        The lumped torso, prestressed in the posture.
    cockpit : Cockpit
        Seat and shoulders.
    biometrics : Biometrics
        Stature and sex.
    gravity_m_per_s2 : float
        Along -y.

    Returns
    -------
    SpineModel
        Its carrier stands for the thorax: shoulders, muscle origins, girdles and an arm that is not in the deck hang on
        it. The seat's node is the origin, as in the decks.

    Raises
    ------
    EvaluationError
        Stage "torso": a mass or a spring that no person has.
    """
    points, _ = torso_points()
    seat = SpineSeat(
        origin_m=(0.0, 0.0, 0.0),
        reference_m=(float(cockpit.seat_shift_m[0]), float(cockpit.seat_shift_m[1])),
        back_angle_deg=cockpit.back_angle_deg,
        shoulder_up_m=shoulder_up_m(cockpit),
    )
    lumped = {row.name: row for row in seated.torso.bodies}
    chain = [name for name in ("pan", "pelvis", "viscera", "head") if name in lumped]
    thorax = lumped[CARRIER]
    return spine_model(
        {name: lumped[name].mass_kg for name in [*chain, CARRIER]},
        {row.name: (row.stiffness, row.damping) for row in seated.torso.springs},
        stature_m=biometrics.stature_m,
        seat=seat,
        gyration_m={name: lumped[name].gyration_m for name in chain},
        points=points,
        upper_trunk_kg=thorax.mass_kg * upper_trunk_share(biometrics.sex),
        carrier_load=_on_the_shoulders(seated, carrier_place(seat), gravity_m_per_s2),
        gravity_m_per_s2=gravity_m_per_s2,
    )


def torso_modes(
    seated: SeatedTorso, cockpit: Cockpit, biometrics: Biometrics, gravity_m_per_s2: float, cutoff_hz: float
) -> TorsoModes:
    """The spine of a pilot in his seat, reduced to seat and shoulders.

    Parameters
    ----------
    seated, cockpit, biometrics, gravity_m_per_s2
        As of `seated_spine`.
    cutoff_hz : float
        All fixed-interface modes up to this frequency are kept.

    Raises
    ------
    EvaluationError
        Stage "torso": as `seated_spine`, or a spine that its load buckles.
    """
    spine = seated_spine(seated, cockpit, biometrics, gravity_m_per_s2)
    interface = carrier_name()
    reduced = reduce_spine(spine, cutoff_hz, interfaces=[interface])
    carrier = spine.bodies[spine.index(interface)]
    return TorsoModes(
        interface=interface,
        place_m=carrier.place_m,
        mass_kg=carrier.mass_kg,
        inertia_kg_m2=carrier.inertia_kg_m2,
        count=reduced.modes,
        preload=tuple(reduced.preload.tolist()),
        fem=fem_text(reduced, f"spine of a pilot in his seat, fixed-interface modes up to {cutoff_hz:g} Hz"),
    )


def _on_the_shoulders(seated: SeatedTorso, carrier: tuple[float, float, float], gravity: float) -> list[float]:
    """Force and moment about the carrier from all that the lumbar spring carries but the weight of thorax and head."""
    spring = next(row for row in seated.torso.springs if row.name == "lumbar")
    force, moment = (np.array(part) for part in (seated.prestress["lumbar"][:3], seated.prestress["lumbar"][3:]))
    if spring.inclined:
        angle = np.radians(seated.back_angle_deg)
        c, s = np.cos(angle), np.sin(angle)
        axes = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        force, moment = axes @ force, axes @ moment
    point = np.array(seated.points["lumbar"])
    for row in seated.torso.bodies:
        if row.name in (CARRIER, "head"):
            weight = np.array([0.0, -row.mass_kg * gravity, 0.0])
            force = force - weight
            moment = moment - np.cross(np.array(seated.places[row.name]) - point, weight)
    moment = moment + np.cross(point - np.array(carrier), force)
    return [*force.tolist(), *moment.tolist()]
