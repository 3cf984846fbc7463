"""Decks: the text of the three MBDyn decks of one pilot, from the templates.

Everything a template prints is prepared here as text, so that templates hold no arithmetic and render fast
(templates/README.md lists the names). Numbers are printed with the fewest digits (17 at most) that give the same number
back when read.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from pilotgen.anthropometry.arm import Limb, Segment
from pilotgen.anthropometry.body import SEGMENTS, Body
from pilotgen.decks.template_cache import Part
from pilotgen.decks.text import hinge_frame, matrix, number, numbers, pose_text, template, vector, vectors
from pilotgen.posture.cockpit import Cockpit, PlacedInceptor
from pilotgen.posture.kinematics import MIRROR, SUFFIX, Pose, arm_geometry, forward
from pilotgen.posture.posture import Posture, PostureGuess, ergonomics

GRAVITY_M_PER_S2 = 9.81
TIME_STEP_S = 1e-3
_MIRROR_OUTER = np.outer(MIRROR, MIRROR)
_Result = TypeVar("_Result")


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


# ---- what a template knows about a control and an arm ----------------------------------------------------------------


def _inceptor_text(inceptor: PlacedInceptor) -> Part:
    collective = inceptor.name == "collective"
    return Part(
        node="LEVER" if collective else "STICK",
        joint="LEVER_HINGE" if collective else "STICK_PIVOT",
        axis="LEVER_AXIS" if collective else "STICK_AXIS",
        node_label=2 if collective else 3,
        joint_label=102 if collective else 103,
        frame_label=1 if collective else 2,
        full_name="collective lever" if collective else "cyclic stick",
        joint_name="hinge" if collective else "pivot",
        axes_comment="x along the lever, z = hinge axis" if collective else "y along the stick, z to the right",
        angle_comment="above horizontal" if collective else "top rearward from vertical",
        source="pilotgen/data/cockpit.yaml",
        length=number(inceptor.length_m),
        angle=number(inceptor.angle_deg),
        mass=number(inceptor.mass_kg),
        JX=number(inceptor.inertia_kg_m2[0]),
        JY=number(inceptor.inertia_kg_m2[1]),
        JZ=number(inceptor.inertia_kg_m2[2]),
        position=vector(inceptor.pose[0]),
    )


_ARM_JOINTS = ("SHOULDER", "HUMEROULNAR", "HUMERORADIAL", "RADIOULNAR", "WRIST", "GRIP")
_SPRINGS = ("SHOULDER_ERGONOMIC", "ELBOW_ERGONOMIC", "FOREARM_ERGONOMIC", "WRIST_ERGONOMIC", "GRIP_ERGONOMIC")
_IN_NODE = "reference, node, "


class _Latest(Generic[_Result]):
    """A function that remembers its last result: the decks of one pilot are rendered one after the other."""

    def __init__(self, function: Callable[..., _Result]) -> None:
        self._function = function
        self._arguments: tuple[object, ...] = ()
        self._result: _Result

    def __call__(self, *arguments: object) -> _Result:
        if len(self._arguments) != len(arguments) or any(map(operator.is_not, arguments, self._arguments)):
            self._result = self._function(*arguments)
            self._arguments = arguments
        return self._result


def _limb_text(limb: Limb, inceptor: PlacedInceptor, torso: Pose) -> dict[str, Any]:
    """What is said of an arm and its control in whatever posture."""
    S = SUFFIX[limb.side].upper()
    base = 10 if limb.side == "left" else 20
    labels = [(f"{name.upper()}_{S}", base + i) for i, name in enumerate(SEGMENTS, start=1)]
    labels += [(f"{name}_{S}", 100 + base + i) for i, name in enumerate(_ARM_JOINTS, start=1)]
    labels.append((f"GLENOHUMERAL_{S}", base))
    hand_in_radius = limb.anatomical_axes["radius"].T @ limb.anatomical_axes["hand"]
    deviation_in_radius = hand_in_radius @ limb.wrist_deviation_axis_in_hand
    x_axis = np.array([1.0, 0.0, 0.0])
    control = "LEVER" if inceptor.name == "collective" else "STICK"
    along = f"{control}_LENGTH, 0., 0." if control == "LEVER" else f"0., {control}_LENGTH, 0."
    return dict(
        S=S,
        side=limb.side,
        inceptor=_inceptor_text(inceptor),
        labels=labels,
        control=control,
        **{name: f"{name.upper()}_{S}" for name in SEGMENTS},
        GH=vector(torso[0]),
        HU=_IN_NODE + vector(limb.HU_in_humerus),
        HR=_IN_NODE + vector(limb.HR_in_humerus),
        UH=_IN_NODE + vector(limb.UH_in_radius),
        W=_IN_NODE + vector(limb.W_in_radius),
        elbow_on_humerus=_IN_NODE + hinge_frame(limb.elbow_axis_in_humerus, 3, x_axis, 1),
        elbow_on_ulna=_IN_NODE + hinge_frame(limb.elbow_axis_in_ulna, 3, x_axis, 1),
        wrist_on_radius=_IN_NODE + hinge_frame(limb.wrist_flexion_axis_in_radius, 3, deviation_in_radius, 2),
        wrist_on_hand=_IN_NODE + hinge_frame(np.array([0.0, 0.0, 1.0]), 3, limb.wrist_deviation_axis_in_hand, 2),
        grip_on_control=_IN_NODE + along,
        grip_in_hand=_IN_NODE + vector(limb.grip_in_hand),
    )


@_Latest
def _limb_texts(body: Body, cockpit: Cockpit) -> dict[str, dict[str, Any]]:
    """The same for each arm of a body, by side."""
    return {side: _limb_text(limb, cockpit.inceptors[side], cockpit.torso[side]) for side, limb in body.limbs.items()}


def _arm_text(body: Body, cockpit: Cockpit, side: str, poses: Mapping[str, Pose], **more: Any) -> dict[str, Any]:
    """An arm in one posture, with its control; `labels` of `more` come after those that every deck has."""
    text = _limb_texts(body, cockpit)[side]
    labels = [*text["labels"], *more.pop("labels", ())]
    placed = [(text[name], pose_text(poses[f"{name}_{SUFFIX[side]}"])) for name in SEGMENTS]
    return {**text, **more, "labels": labels, "poses": placed}


def _inertia_text(segment: Segment, name: str) -> tuple[list[tuple[str, str, str]], SimpleNamespace]:
    """Constants of one bone, and the arguments of its body card."""
    J = segment.inertia_kg_m2
    constants = [(f"{name}_MASS", number(segment.mass_kg), "kg")]
    if segment.com_m[0] == 0.0 and segment.com_m[2] == 0.0:
        constants.append((f"{name}_COM", number(float(segment.com_m[1])), "m, y of the centre of mass"))
        com = f"0., {name}_COM, 0."
    else:
        com = vector(segment.com_m)
    entries = [("JX", J[0, 0]), ("JY", J[1, 1]), ("JZ", J[2, 2])]
    if J[0, 1] == 0.0 and J[0, 2] == 0.0 and J[1, 2] == 0.0:
        inertia = f"diag, {name}_JX, {name}_JY, {name}_JZ"
    else:
        entries += [("JXY", J[0, 1]), ("JXZ", J[0, 2]), ("JYZ", J[1, 2])]
        inertia = f"sym, {name}_JX, {name}_JXY, {name}_JXZ, {name}_JY, {name}_JYZ, {name}_JZ"
    constants += [(f"{name}_{key}", number(float(value)), "kg m^2") for key, value in entries]
    return constants, SimpleNamespace(name=name, mass=f"{name}_MASS", com=com, inertia=inertia)


def _muscle_texts(limb: Limb) -> list[SimpleNamespace]:
    """What the muscles of an arm are, whatever they do."""
    S = SUFFIX[limb.side].upper()
    place = {name: f"{name.upper()}_{S}, position, {_IN_NODE}" for name in SEGMENTS}
    place["torso"] = f"SEAT, position, reference, GLENOHUMERAL_{S}, "
    origins = vectors(np.array([muscle.origin_m for muscle in limb.muscles]))
    insertions = vectors(np.array([muscle.insertion_m for muscle in limb.muscles]))
    return [
        SimpleNamespace(
            name=f"{muscle.name.upper()}_{S}",
            full_name=muscle.full_name,
            L0=number(muscle.l0_m),
            F0=number(muscle.F0_N),
            origin=place[muscle.origin_body] + origin,
            insertion=place[muscle.insertion_body] + insertion,
        )
        for muscle, origin, insertion in zip(limb.muscles, origins, insertions, strict=True)
    ]


@_Latest
def _pilot_lines(body: Body, cockpit: Cockpit) -> list[str]:
    b = body.biometrics
    lines = [
        f"Pilot: {b.sex}, {b.age_years:.4g} years, {b.stature_m:.3f} m, {b.mass_kg:.2f} kg (BMI {b.bmi:.4g}); "
        f"muscle strength {body.strength_factor:.3f} of the reference subject's.",
    ]
    lines += [f"Extrapolated: {words}." for words in body.extrapolated]
    for side in body.limbs:
        inceptor = cockpit.inceptors[side]
        what = "above horizontal" if inceptor.name == "collective" else "from vertical"
        lines.append(f"{side.capitalize()} hand on the {inceptor.name}, {inceptor.angle_deg:.4g} deg {what}.")
    seat, eye = cockpit.seat_shift_m.tolist(), cockpit.eye_mismatch_m.tolist()
    lines.append(
        f"Seat ({cockpit.seat_mode}) moved {_millimetres(seat[0], 'forward', 'aft')} and "
        f"{_millimetres(seat[1], 'up', 'down')}; eye {_millimetres(eye[0], 'forward of', 'aft of')} and "
        f"{_millimetres(eye[1], 'above', 'below')} the design eye point."
    )
    return lines


def _millimetres(value_m: float, positive: str, negative: str) -> str:
    return f"{abs(1e3 * value_m):.0f} mm {negative if value_m < -0.5e-3 else positive}"


@_Latest
def _posture_lines(posture: Posture) -> list[str]:
    lines = []
    for side, angles in posture.angles_by_side.items():
        words = [
            f"{name[: -len('_deg')].replace('_', ' ')} {round(value, 1) + 0.0:.1f}" for name, value in angles.items()
        ]
        lines.append(f"Posture of the {side} arm [deg]: {', '.join(words[:4])},")
        lines.append(f"{', '.join(words[4:])}.")
    return lines


# ---- the decks -------------------------------------------------------------------------------------------------------


def _counts(limbs: int, muscles: int, springs: bool) -> dict[str, str]:
    if limbs == 1:
        joints = "1 + 1 + 6 + 5" if springs else f"1 + 1 + 6 + {muscles}"
        return {"nodes": "1 + 1 + 4", "bodies": "1 + 4", "joints": joints}
    joints = f"1 + {limbs}*(1 + 6 + 5)" if springs else f"1 + {limbs}*(1 + 6) + {muscles}"
    return {"nodes": f"1 + {limbs}*(1 + 4)", "bodies": f"{limbs}*(1 + 4)", "joints": joints}


def render_posture(body: Body, cockpit: Cockpit, guess: PostureGuess) -> str:
    """The static deck that finds the posture: grips in place, ergonomic springs instead of muscles and gravity."""
    arms = []
    for side, limb in body.limbs.items():
        base = 140 if side == "left" else 150
        labels = [(f"{name}_{SUFFIX[side].upper()}", base + i) for i, name in enumerate(_SPRINGS, start=1)]
        springs = _spring_frames(limb, cockpit.inceptors[side], cockpit.torso[side])
        arms.append(_arm_text(body, cockpit, side, guess.nodes, labels=labels, **springs))
    return template("posture.mbd.j2").render(
        purpose="posture.mbd - how the pilot holds the controls: equilibrium of ergonomic springs, without gravity.",
        pilot=_pilot_lines(body, cockpit),
        counts=_counts(len(arms), 0, springs=True),
        arms=arms,
        springs=_spring_constants(),
        back_angle=number(cockpit.back_angle_deg),
    )


def _spring_constants() -> list[tuple[str, str, str]]:
    e = ergonomics()
    names = (
        ("SHOULDER", "_X", "adduction"),
        ("SHOULDER", "_Y", "axial rotation"),
        ("SHOULDER", "_Z", "flexion"),
        ("ELBOW", "", "flexion"),
        ("FOREARM", "", "pronation"),
        ("WRIST", "_FLEXION", "flexion"),
        ("WRIST", "_DEVIATION", "ulnar deviation"),
    )
    rows = []
    for i, (joint, axis, motion) in enumerate(names):
        neutral = math.degrees(e.neutral_rad[i])
        rows.append((f"{joint}_K1{axis}", number(e.K1_Nm_per_rad[i]), f"{motion}, neutral at {neutral:.4g} deg"))
        rows.append((f"{joint}_K3{axis}", number(e.K3_Nm_per_rad3[i]), motion))
    rows.append(("GRIP_K_SPIN", number(e.grip_Nm_per_rad[0]), "hand turned about the handle"))
    rows.append(("GRIP_K_TILT", number(e.grip_Nm_per_rad[1]), "handle across the palm"))
    return rows


def _spring_frames(limb: Limb, inceptor: PlacedInceptor, torso: Pose) -> dict[str, tuple[str, str]]:
    """Frames of the ergonomic joint springs on the two bodies of each, equal in the neutral posture."""
    e = ergonomics()
    g = arm_geometry(limb)
    R_torso = torso[1]  # about z: the same seen in the mirror
    neutral = forward(g, e.neutral_rad, (np.zeros(3), R_torso))
    R = {name: pose[1] for name, pose in neutral.poses.items()}
    on_second = {
        "shoulder": g.humerus_anatomical.T,
        "elbow": g.elbow_on_ulna,
        "forearm": g.forearm_on_radius,
        "wrist": g.wrist_on_hand,
    }
    pairs = {
        "shoulder": ("", "humerus"),
        "elbow": ("humerus", "ulna"),
        "forearm": ("ulna", "radius"),
        "wrist": ("radius", "hand"),
    }
    frames: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for joint, (first, second) in pairs.items():
        world = R[second] @ on_second[joint]
        frames[joint] = (R[first].T @ world if first else world, on_second[joint])
    left = limb.side == "left"
    texts = {
        f"{joint}_spring": tuple(_IN_NODE + matrix(M * _MIRROR_OUTER if left else M) for M in pair)
        for joint, pair in frames.items()
    }
    hand = e.hand_handle * _MIRROR_OUTER if left else e.hand_handle
    texts["grip_spring"] = (_IN_NODE + matrix(inceptor.handle), _IN_NODE + matrix(hand))
    return texts  # type: ignore[return-value]


def render_trim(body: Body, cockpit: Cockpit, posture: Posture, *, gains: Gains, c: float) -> str:
    """The pilot's deck with every muscle at rest: its residual is what the activations have to balance."""
    muscles = sum(len(limb.muscles) for limb in body.limbs.values())
    return _render_pilot(
        body,
        cockpit,
        posture,
        purpose="trim.mbd - the pilot's arm in its posture with all muscles at rest: not an equilibrium.",
        values=np.zeros(muscles),
        lengths=posture.muscle_lengths_m,
        gains=gains,
        analysis=_analysis(c, TIME_STEP_S, equilibrium=False),
        activation_comment="All activations are zero here.",
        activation_check=False,
        seat_drive="const, 0.",
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
    activation_check: bool = False,
    seat_drive: str = "const, 0.",
    final_time_s: float = TIME_STEP_S,
    time_step_s: float = TIME_STEP_S,
) -> str:
    """The deck of the pilot at the controls: in equilibrium, ready to be linearised or shaken.

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
    activation_check : bool
        Clip activations to [0, 1]; no for linearisation, since clipping at rest has no derivative.
    seat_drive : str
        Drive of the seat's vertical motion [m] as MBDyn reads it; value and rate zero at the start.
    final_time_s, time_step_s : float
        Of a time integration.
    """
    values = np.asarray(activations.values)
    at_rest = int(np.count_nonzero(values <= 1e-9))
    return _render_pilot(
        body,
        cockpit,
        posture,
        purpose="pilot.mbd - the pilot at the controls: limbs, muscles with reflexes, seat moved by a total pin joint.",
        values=values,
        lengths=muscle_lengths,
        gains=gains,
        analysis=_analysis(c, time_step_s, equilibrium=True, final_time_s=final_time_s),
        activation_comment=(
            "activation check, yes: activations are clipped to [0, 1]."
            if activation_check
            else f"activation check, no: {at_rest} of {values.size} rest at zero, where clipping has no derivative."
        ),
        activation_check=activation_check,
        seat_drive=seat_drive,
    )


def _analysis(c: float, time_step_s: float, *, equilibrium: bool, final_time_s: float = TIME_STEP_S) -> dict[str, Any]:
    return {
        "final_time": number(final_time_s),
        "time_step": number(time_step_s),
        "parameter": number(2.0 * c),
        "c": number(c),
        "equilibrium": equilibrium,
    }


@_Latest
def _arms_with_muscles(body: Body, cockpit: Cockpit, posture: Posture) -> list[Part]:
    """Text of the arms, without what the muscles do: the trim deck and the pilot's deck have the same."""
    arms = []
    for side, limb in body.limbs.items():
        S = SUFFIX[side].upper()
        constants: list[tuple[str, str, str]] = []
        bodies = []
        for name in SEGMENTS:
            of_this, card = _inertia_text(limb.segments[name], f"{name.upper()}_{S}")
            constants += of_this
            bodies.append(card)
        muscles = _muscle_texts(limb)
        base = 200 if side == "left" else 300
        labels = [(muscle.name, base + i) for i, muscle in enumerate(muscles, start=1)]
        more = {"labels": labels, "constants": constants, "bodies": bodies, "muscles": muscles}
        arms.append(Part(**_arm_text(body, cockpit, side, posture.nodes, **more)))
    return arms


def _render_pilot(
    body: Body,
    cockpit: Cockpit,
    posture: Posture,
    *,
    purpose: str,
    values: np.ndarray,
    lengths: np.ndarray,
    gains: Gains,
    analysis: Mapping[str, Any],
    activation_comment: str,
    activation_check: bool,
    seat_drive: str,
) -> str:
    limbs = body.limbs.values()
    arms = _arms_with_muscles(body, cockpit, posture)
    states = []
    done = 0
    for limb in limbs:
        those = slice(done, done := done + len(limb.muscles))
        optimal_m = [muscle.l0_m for muscle in limb.muscles]
        states.append(
            SimpleNamespace(
                x=[f"{length / l0:.3f}" for length, l0 in zip(lengths[those].tolist(), optimal_m, strict=True)],
                activation=numbers(values[those]),
                length=numbers(lengths[those]),
                check="yes" if activation_check else "no",
                comment=activation_comment,
            )
        )
    return template("pilot.mbd.j2").render(
        purpose=purpose,
        pilot=[*_pilot_lines(body, cockpit), *_posture_lines(posture)],
        analysis=analysis,
        counts=_counts(len(arms), done, springs=False),
        arms=arms,
        muscle_states=states,
        kp=number(gains.proportional_gain),
        kd=number(gains.derivative_gain),
        velocity_factor=number(_velocity_factor(body)),
        back_angle=number(cockpit.back_angle_deg),
        gravity=number(GRAVITY_M_PER_S2),
        seat_drive=seat_drive,
    )


@_Latest
def _velocity_factor(body: Body) -> float:
    """V0/L0 [1/s], one for all muscles of a pilot."""
    factors = {round(m.V0_m_per_s / m.l0_m, 9) for limb in body.limbs.values() for m in limb.muscles}
    if len(factors) != 1:
        raise ValueError(f"the deck has one maximum velocity over optimal length, the muscles have {sorted(factors)}")
    return factors.pop()
