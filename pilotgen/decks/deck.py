"""Decks: the text of the three MBDyn decks of one pilot, from the templates.

Everything a template prints is prepared here as text, so that templates hold the words and no arithmetic, and render
fast (templates/README.md lists the names). Numbers are printed with the fewest digits (17 at most) that give the same
number back when read.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np

from pilotgen.anthropometry.arm import SEGMENTS
from pilotgen.anthropometry.body import Body
from pilotgen.decks.parts import (
    ARM_JOINTS,
    ERGONOMIC_SPRINGS,
    Latest,
    arm_text,
    arms_with_muscles,
    muscle_states,
    spring_constants,
    spring_frames,
    spring_labels,
    velocity_factor,
)
from pilotgen.decks.template_cache import Part
from pilotgen.decks.text import number, template
from pilotgen.decks.torso_text import torso_text
from pilotgen.decks.vehicle import Vehicle, vehicle_text
from pilotgen.posture.cockpit import Cockpit
from pilotgen.posture.posture import Posture, PostureGuess
from pilotgen.posture.seated_torso import SeatedTorso

GRAVITY_M_PER_S2 = 9.81
TIME_STEP_S = 1e-3


class Gains(Protocol):
    """Reflex gains, a = a0 + Kp (x - x_ref) + Kd v."""

    @property
    def proportional_gain(self) -> float:
        """Kp [-]."""

    @property
    def derivative_gain(self) -> float:
        """Kd [-]."""


class ActivationValues(Protocol):
    """Activations of all muscles in deck order."""

    @property
    def values(self) -> np.ndarray:
        """(muscles,)."""


# ---- the person ------------------------------------------------------------------------------------------------------


@Latest
def _person_text(body: Body, cockpit: Cockpit) -> SimpleNamespace:
    """What the header of a deck says of the pilot and his seat."""
    b = body.biometrics
    return SimpleNamespace(
        sex=b.sex,
        age=f"{b.age_years:.4g}",
        stature=f"{b.stature_m:.3f}",
        mass=f"{b.mass_kg:.2f}",
        bmi=f"{b.bmi:.4g}",
        strength=f"{body.strength_factor:.3f}",
        extrapolated=list(body.extrapolated),
        seat_mode=cockpit.seat_mode,
        seat_forward=_millimetres(float(cockpit.seat_shift_m[0])),
        seat_up=_millimetres(float(cockpit.seat_shift_m[1])),
        eye_forward=_millimetres(float(cockpit.eye_mismatch_m[0])),
        eye_up=_millimetres(float(cockpit.eye_mismatch_m[1])),
    )


def _millimetres(value_m: float) -> SimpleNamespace:
    return SimpleNamespace(mm=f"{abs(1e3 * value_m):.0f}", negative=value_m < -0.5e-3)


@Latest
def _posture_text(posture: Posture) -> list[SimpleNamespace]:
    """Joint angles of each arm in degrees, as the header says them."""
    return [
        SimpleNamespace(
            side=side,
            angles=[
                f"{name[: -len('_deg')].replace('_', ' ')} {round(value, 1) + 0.0:.1f}"  # no -0.0
                for name, value in angles.items()
            ],
        )
        for side, angles in posture.angles_by_side.items()
    ]


# ---- the decks -------------------------------------------------------------------------------------------------------


def _counts(
    arms: int, last: str, torso: Part | None = None, grip_point: bool = False, fitted: int = 0
) -> dict[str, str]:
    """Expressions of the control data: seat, torso, then per arm the control and the arm; `last` joints of each arm.

    `fitted` controls have a spring or damper as one more joint.
    """
    more = " + 1" if grip_point else ""
    bones, joints = len(SEGMENTS), ARM_JOINTS
    bodies = springs = carried = 0
    if torso:
        bodies, carried = len(torso.bodies), len(torso.carried_arms)
        springs = len(torso.springs) + (torso.modes is not False)
    nodes_of_torso = f" + {bodies}" if torso else ""
    springs_of_torso = (f" + {springs}" if torso else "") + (f" + {fitted}" if fitted else "")
    bodies_of_torso = f"{bodies + carried} + " if torso else ""
    if arms == 1:
        return {
            "nodes": f"1{nodes_of_torso} + 1 + {bones}{more}",
            "bodies": f"{bodies_of_torso}1 + {bones}",
            "joints": f"1{springs_of_torso} + 1 + {joints} + {last}{more}",
        }
    return {
        "nodes": f"1{nodes_of_torso} + {arms}*(1 + {bones}){more}",
        "bodies": f"{bodies_of_torso}{arms}*(1 + {bones})",
        "joints": f"1{springs_of_torso} + {arms}*(1 + {joints} + {last}){more}",
    }


def _parts_in(body: Body) -> dict[str, Any]:
    """Which parts a deck has, so that no comment speaks of others."""
    return {"left": "left" in body.limbs, "right": "right" in body.limbs}


def render_posture(body: Body, cockpit: Cockpit, guess: PostureGuess) -> str:
    """The static deck that finds the posture: grips in place, ergonomic springs instead of muscles and gravity."""
    arms = []
    for side, limb in body.limbs.items():
        springs = spring_frames(limb, cockpit.inceptors[side], cockpit.torso[side])
        arms.append(arm_text(body, cockpit, side, guess.nodes, labels=spring_labels(side), **springs))
    return template("posture.mbd.j2").render(
        person=_person_text(body, cockpit),
        has=_parts_in(body),
        counts=_counts(len(arms), str(ERGONOMIC_SPRINGS)),
        arms=arms,
        springs=spring_constants(),
        back_angle=number(cockpit.back_angle_deg),
    )


def render_trim(body: Body, cockpit: Cockpit, posture: Posture, *, gains: Gains, c: float) -> str:
    """The pilot's deck with every muscle at rest: its residual is what the activations have to balance.

    The torso is held still here, one body with the seat: in the posture nothing of it moves.
    """
    muscles = sum(len(limb.muscles) for limb in body.limbs.values())
    return _render_pilot(
        body,
        cockpit,
        posture,
        trim=True,
        values=np.zeros(muscles),
        lengths=posture.muscle_lengths_m,
        gains=gains,
        analysis=_analysis(c, TIME_STEP_S),
        activation_check=False,
        seat_drive="const, 0.",
        seated=None,
    )


def render_direct(
    body: Body,
    cockpit: Cockpit,
    posture: Posture,
    *,
    activations: ActivationValues,
    muscle_lengths: np.ndarray,
    gains: Gains,
    c: float,
    torso: SeatedTorso | None = None,
    activation_check: bool = False,
    seat_drive: str | Mapping[str, str] = "const, 0.",
    final_time_s: float = TIME_STEP_S,
    time_step_s: float = TIME_STEP_S,
    vehicle: Vehicle | None = None,
) -> str:
    """The deck of the pilot at the controls: in equilibrium, ready to be linearised or simulated.

    `muscle_lengths`, shape (muscles,) [m], is of all muscles in deck order.

    Parameters
    ----------
    activations : ActivationValues
        Of all muscles, left arm first.
    muscle_lengths : ndarray
        Their lengths in this posture [m], the references of the reflexes.
    gains : Gains
        Reflex gains.
    c : float
        Coefficient of the matrix pair [s].
    torso : SeatedTorso, optional
        The torso between seat and shoulders; None: rigid, one body with the seat.
    activation_check : bool
        Clip activations to [0, 1]; no for linearisation, since clipping at rest has no derivative.
    seat_drive : str or mapping of str to str
        Drive of the seat's vertical motion [m] as MBDyn reads it, value and rate zero at the start; or drives of
        several motions [m, rad] by their names: heave up, surge forward, sway right, roll right, pitch nose up, yaw
        nose right. Rotations are about the seat's node.
    final_time_s, time_step_s : float
        Of a time integration.
    vehicle : Vehicle, optional
        The rotorcraft that the loop is closed with; the seat follows it and has no drive then.
    """
    return _render_pilot(
        body,
        cockpit,
        posture,
        trim=False,
        values=np.asarray(activations.values),
        lengths=muscle_lengths,
        gains=gains,
        analysis=_analysis(c, time_step_s, final_time_s),
        activation_check=activation_check,
        seat_drive=seat_drive,
        seated=torso,
        vehicle=vehicle,
    )


def _seat_drives(drives: str | Mapping[str, str]) -> dict[str, str]:
    """Vector drives of the seat's position and orientation."""
    if isinstance(drives, str):
        drives = {"heave": drives}
    rows = {"position": ("surge", "heave", "sway"), "orientation": ("roll", "yaw", "pitch")}  # along x, y, z
    vectors = {}
    for part, names in rows.items():
        driven = [name for name in names if name in drives]
        if not driven:
            vectors[part] = "null"
        elif len(driven) == 1:
            sign = "-1." if driven[0] == "yaw" else "1."  # nose right is about the axis down
            axis = ", ".join(sign if name == driven[0] else "0." for name in names)
            vectors[part] = f"single, {axis}, {drives[driven[0]]}"
        else:
            vectors[part] = "component,\n\t\t" + ",\n\t\t".join(
                f"mult, const, -1., {drives[name]}"
                if name == "yaw" and name in drives
                else drives.get(name, "const, 0.")
                for name in names
            )
    return vectors


def _analysis(c: float, time_step_s: float, final_time_s: float = TIME_STEP_S) -> dict[str, str]:
    return {
        "final_time": number(final_time_s),
        "time_step": number(time_step_s),
        "parameter": number(2.0 * c),
        "c": number(c),
    }


def _render_pilot(
    body: Body,
    cockpit: Cockpit,
    posture: Posture,
    *,
    trim: bool,
    values: np.ndarray,
    lengths: np.ndarray,
    gains: Gains,
    analysis: dict[str, str],
    activation_check: bool,
    seat_drive: str | Mapping[str, str],
    seated: SeatedTorso | None,
    vehicle: Vehicle | None = None,
) -> str:
    arms = arms_with_muscles(body, cockpit, posture)
    torso = torso_text(seated) if seated is not None else None
    carriers = [seated.torso.carriers[side].upper() if seated is not None else "SEAT" for side in body.limbs]
    muscles = len(body.limbs[next(iter(body.limbs))].muscles)
    fitted = sum(cockpit.inceptors[side].fitted for side in body.limbs)
    return template("pilot.mbd.j2").render(
        trim=trim,
        person=_person_text(body, cockpit),
        posture=_posture_text(posture),
        has=_parts_in(body),
        analysis=analysis,
        counts=_counts(len(arms), str(muscles), torso, vehicle is not None, fitted),
        torso=torso if torso is not None else False,
        carriers=carriers,
        arms=arms,
        muscle_states=muscle_states(
            body, values, lengths, carriers, vehicle.pull[1] if vehicle is not None and vehicle.pull else None
        ),
        activation_check=activation_check,
        at_rest=str(int(np.count_nonzero(values <= 1e-9))),
        muscle_count=str(values.size),
        kp=number(gains.proportional_gain),
        kd=number(gains.derivative_gain),
        velocity_factor=number(velocity_factor(body)),
        back_angle=number(cockpit.back_angle_deg),
        gravity=number(GRAVITY_M_PER_S2),
        drives=_seat_drives(seat_drive),
        is_heave=isinstance(seat_drive, str),
        vehicle=vehicle_text(vehicle, cockpit.inceptors["left"].pose[0].tolist()) if vehicle is not None else False,
    )
