"""What a template knows about the parts of a pilot: controls, arms, muscles, ergonomic springs, all as text.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any, Generic, TypeVar

import numpy as np

from pilotgen.anthropometry.arm import JOINTS, SEGMENTS, SUFFIX, Limb, Segment
from pilotgen.anthropometry.body import Body
from pilotgen.decks.template_cache import Part
from pilotgen.decks.text import hinge_frame, matrix, number, numbers, pose_text, vector, vectors
from pilotgen.posture.cockpit import Cockpit, PlacedInceptor
from pilotgen.posture.kinematics import MIRROR, Pose, arm_geometry, forward
from pilotgen.posture.posture import Posture, ergonomics

_MIRROR_OUTER = np.outer(MIRROR, MIRROR)
_IN_NODE = "reference, node, "
_SPRINGS = ("SHOULDER", "ELBOW", "FOREARM", "WRIST", "GRIP")  # ergonomic springs of an arm
ARM_JOINTS = len(JOINTS) + 1  # with the grip
ERGONOMIC_SPRINGS = len(_SPRINGS)
_Result = TypeVar("_Result")


class Latest(Generic[_Result]):
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


# ---- controls and arms -----------------------------------------------------------------------------------------------


def _inceptor_text(inceptor: PlacedInceptor) -> Part:
    collective = inceptor.name == "collective"
    return Part(
        collective=collective,
        name=inceptor.name,
        node="LEVER" if collective else "STICK",
        joint="LEVER_HINGE" if collective else "STICK_PIVOT",
        axis="LEVER_AXIS" if collective else "STICK_AXIS",
        node_label="2" if collective else "3",
        joint_label="102" if collective else "103",
        frame_label="1" if collective else "2",
        length=number(inceptor.length_m),
        angle=number(inceptor.angle_deg),
        short_angle=f"{inceptor.angle_deg:.4g}",
        mass=number(inceptor.mass_kg),
        JX=number(inceptor.inertia_kg_m2[0]),
        JY=number(inceptor.inertia_kg_m2[1]),
        JZ=number(inceptor.inertia_kg_m2[2]),
        position=vector(inceptor.pose[0]),
        unbalanced=inceptor.unbalance_kg_m != 0.0,
        unbalance=number(inceptor.unbalance_kg_m),
        fitted=inceptor.fitted,
        fittings="LEVER_FITTINGS",
        fittings_label="107",
        damping=number(inceptor.damping_n_m_s_per_rad),
        stiffness=number(inceptor.stiffness_n_m_per_rad),
    )


def _limb_text(limb: Limb, inceptor: PlacedInceptor, torso: Pose) -> dict[str, Any]:
    """What is said of an arm and its control in whatever posture."""
    S = SUFFIX[limb.side].upper()
    base = 10 if limb.side == "left" else 20
    labels = [(f"{name.upper()}_{S}", base + i) for i, name in enumerate(SEGMENTS, start=1)]
    joints = [*(joint.name.upper() for joint in JOINTS), "GRIP"]
    labels += [(f"{name}_{S}", 100 + base + i) for i, name in enumerate(joints, start=1)]
    labels.append((f"GLENOHUMERAL_{S}", base))
    hand_in_radius = limb.anatomical_axes["radius"].T @ limb.anatomical_axes["hand"]
    deviation_in_radius = hand_in_radius @ limb.wrist_deviation_axis_in_hand
    x_axis = np.array([1.0, 0.0, 0.0])
    control = "LEVER" if inceptor.name == "collective" else "STICK"
    along = f"{control}_LENGTH, 0., 0." if control == "LEVER" else f"0., {control}_LENGTH, 0."
    return dict(
        S=S,
        side=limb.side,
        Side=limb.side.capitalize(),
        inceptor=_inceptor_text(inceptor),
        labels=labels,
        control=control,
        **{name: f"{name.upper()}_{S}" for name in SEGMENTS},
        GH=vector(torso[0]),
        humerus_length=number(-float(limb.HU_in_humerus[1])),
        radius_length=number(-float(limb.W_in_radius[1])),
        HU=_IN_NODE + _along_bone(limb.HU_in_humerus, f"HUMERUS_{S}_LENGTH"),
        HR=_IN_NODE + vector(limb.HR_in_humerus),
        UH=_IN_NODE + vector(limb.UH_in_radius),
        W=_IN_NODE + _along_bone(limb.W_in_radius, f"RADIUS_{S}_LENGTH"),
        elbow_on_humerus=_IN_NODE + hinge_frame(limb.elbow_axis_in_humerus, 3, x_axis, 1),
        elbow_on_ulna=_IN_NODE + hinge_frame(limb.elbow_axis_in_ulna, 3, x_axis, 1),
        wrist_on_radius=_IN_NODE + hinge_frame(limb.wrist_flexion_axis_in_radius, 3, deviation_in_radius, 2),
        wrist_on_hand=_IN_NODE + hinge_frame(np.array([0.0, 0.0, 1.0]), 3, limb.wrist_deviation_axis_in_hand, 2),
        grip_on_control=_IN_NODE + along,
        grip_in_hand=_IN_NODE + vector(limb.grip_in_hand),
    )


def _along_bone(point: np.ndarray, length: str) -> str:
    """A point at the far end of a bone's own axis, by the name of the bone's length."""
    if point[0] != 0.0 or point[2] != 0.0:
        raise ValueError(f"{point} is not on the bone's axis")
    return f"0., -{length}, 0."


@Latest
def _limb_texts(body: Body, cockpit: Cockpit) -> dict[str, dict[str, Any]]:
    """The same for each arm of a body, by side."""
    return {side: _limb_text(limb, cockpit.inceptors[side], cockpit.torso[side]) for side, limb in body.limbs.items()}


def arm_text(body: Body, cockpit: Cockpit, side: str, poses: Mapping[str, Pose], **more: Any) -> dict[str, Any]:
    """An arm in one posture, with its control; `labels` of `more` come after those that every deck has."""
    text = _limb_texts(body, cockpit)[side]
    labels = [*text["labels"], *more.pop("labels", ())]
    placed = [(text[name], pose_text(poses[f"{name}_{SUFFIX[side]}"])) for name in SEGMENTS]
    names, values = [name for name, _ in labels], [str(value) for _, value in labels]
    return {**text, **more, "label_names": names, "labels": values, "poses": placed}


def _bone_text(segment: Segment, name: str) -> SimpleNamespace:
    """Mass, centre of mass and inertia of one bone."""
    J = segment.inertia_kg_m2
    diagonal = bool(J[0, 1] == 0.0 and J[0, 2] == 0.0 and J[1, 2] == 0.0)
    on_axis = bool(segment.com_m[0] == 0.0 and segment.com_m[2] == 0.0)
    entries = [("JX", J[0, 0]), ("JY", J[1, 1]), ("JZ", J[2, 2])]
    inertia = f"diag, {name}_JX, {name}_JY, {name}_JZ"
    if not diagonal:
        entries += [("JXY", J[0, 1]), ("JXZ", J[0, 2]), ("JYZ", J[1, 2])]
        inertia = f"sym, {name}_JX, {name}_JXY, {name}_JXZ, {name}_JY, {name}_JYZ, {name}_JZ"
    return SimpleNamespace(
        name=name,
        mass=number(segment.mass_kg),
        on_axis=on_axis,
        com_y=number(float(segment.com_m[1])),
        com=f"0., {name}_COM, 0." if on_axis else vector(segment.com_m),
        inertia_names=[key for key, _ in entries],
        inertia_values=[number(float(value)) for _, value in entries],
        inertia=inertia,
    )


# ---- muscles ---------------------------------------------------------------------------------------------------------


def _muscle_texts(limb: Limb) -> list[SimpleNamespace]:
    """What the muscles of an arm are, whatever they do and whatever node their origins are on: texts alone."""
    S = SUFFIX[limb.side].upper()
    frame = dict.fromkeys(SEGMENTS, f"position, {_IN_NODE}")
    frame["torso"] = f"position, reference, GLENOHUMERAL_{S}, "
    bone = {name: f"{name.upper()}_{S}, position, {_IN_NODE}" for name in SEGMENTS}
    origins = vectors(np.array([muscle.origin_m for muscle in limb.muscles]))
    insertions = vectors(np.array([muscle.insertion_m for muscle in limb.muscles]))
    return [
        SimpleNamespace(
            name=f"{muscle.name.upper()}_{S}",
            full_name=muscle.full_name,
            L0=number(muscle.l0_m),
            F0=number(muscle.F0_N),
            origin=frame[muscle.origin_body] + origin,
            insertion=bone[muscle.insertion_body] + insertion,
        )
        for muscle, origin, insertion in zip(limb.muscles, origins, insertions, strict=True)
    ]


@Latest
def arms_with_muscles(body: Body, cockpit: Cockpit, posture: Posture) -> list[Part]:
    """Text of the arms, without what the muscles do: the trim deck and the pilot's deck have the same."""
    arms = []
    for side, limb in body.limbs.items():
        S = SUFFIX[side].upper()
        muscles = _muscle_texts(limb)
        base = 200 if side == "left" else 300
        labels = [(muscle.name, base + i) for i, muscle in enumerate(muscles, start=1)]
        bodies = [_bone_text(limb.segments[name], f"{name.upper()}_{S}") for name in SEGMENTS]
        more = {"labels": labels, "bodies": bodies, "muscles": muscles}
        arms.append(Part(**arm_text(body, cockpit, side, posture.nodes, **more)))
    return arms


def muscle_states(
    body: Body, values: np.ndarray, lengths: np.ndarray, carriers: Sequence[str], pull: Sequence[float] | None = None
) -> list[SimpleNamespace]:
    """What the muscles of each arm do: nodes of their origins, lengths over optimal lengths, activations, lengths.

    Parameters
    ----------
    body : Body
        The arms.
    values, lengths : ndarray, shape (muscles,)
        Activations, and lengths [m].
    carriers : sequence of str
        By arm, the node that carries shoulder and muscle origins of the torso.
    pull : sequence of float, optional
        What a pull by the pilot adds to each activation.
    """
    states = []
    done = 0
    for limb, carrier in zip(body.limbs.values(), carriers, strict=True):
        S = SUFFIX[limb.side].upper()
        node = {name: f"{name.upper()}_{S}" for name in SEGMENTS} | {"torso": carrier}
        those = slice(done, done := done + len(limb.muscles))
        optimal_m = [muscle.l0_m for muscle in limb.muscles]
        states.append(
            SimpleNamespace(
                origin=[node[muscle.origin_body] for muscle in limb.muscles],
                x=[f"{length / l0:.3f}" for length, l0 in zip(lengths[those].tolist(), optimal_m, strict=True)],
                activation=numbers(values[those]),
                length=numbers(lengths[those]),
                pull=[SimpleNamespace(by=number(value)) for value in pull[those]] if pull is not None else False,
            )
        )
    return states


@Latest
def velocity_factor(body: Body) -> float:
    """V0/L0 [1/s], one for all muscles of a pilot. ValueError if muscles of one pilot differ in it."""
    factors = {round(m.V0_m_per_s / m.l0_m, 9) for limb in body.limbs.values() for m in limb.muscles}
    if len(factors) != 1:
        raise ValueError(f"the deck has one maximum velocity over optimal length, the muscles have {sorted(factors)}")
    return factors.pop()


# ---- ergonomic springs -----------------------------------------------------------------------------------------------


def spring_constants() -> dict[str, Any]:
    """Stiffnesses of the ergonomic springs [N m/rad, N m/rad^3] and their neutral angles [deg], by joint coordinate."""
    e = ergonomics()
    joints = ("adduction", "rotation", "flexion", "elbow", "forearm", "wrist_flexion", "wrist_deviation")
    texts: dict[str, Any] = {
        joint: SimpleNamespace(
            K1=number(e.K1_Nm_per_rad[i]),
            K3=number(e.K3_Nm_per_rad3[i]),
            neutral=f"{math.degrees(e.neutral_rad[i]):.4g}",
        )
        for i, joint in enumerate(joints)
    }
    return {**texts, "spin": number(e.grip_Nm_per_rad[0]), "tilt": number(e.grip_Nm_per_rad[1])}


def spring_frames(limb: Limb, inceptor: PlacedInceptor, torso: Pose) -> dict[str, tuple[str, str]]:
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


def spring_labels(side: str) -> list[tuple[str, int]]:
    """Labels of an arm's ergonomic springs."""
    base = 140 if side == "left" else 150
    return [(f"{name}_ERGONOMIC_{SUFFIX[side].upper()}", base + i) for i, name in enumerate(_SPRINGS, start=1)]
