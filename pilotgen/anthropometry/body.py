"""Biometrics -> Body: lengths, inertia, strength and muscles of one pilot.

Every number comes from `pilotgen/data/*.yaml`, where its source stands beside it; docs/theory/pilot.md is the account.
Bones and muscles are built for the right arm; the left arm is its mirror image.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from pilotgen.anthropometry.arm import SEGMENTS, Limb, Muscle, Segment
from pilotgen.anthropometry.biometrics import Biometrics
from pilotgen.errors import StudyError
from pilotgen.study.yaml_file import bundled

__all__ = ["SEGMENTS", "SIDES", "Body", "Limb", "Muscle", "Segment", "make_body"]

SIDES = ("left", "right")

_MIRROR = np.array([1.0, 1.0, -1.0])  # z -> -z
_BODIES = ("torso", *SEGMENTS)


@dataclass(frozen=True)
class Body:
    """One pilot's body."""

    biometrics: Biometrics
    limbs: dict[str, Limb]  # by side
    sitting_height_m: float
    eye_height_sitting_m: float
    acromial_height_sitting_m: float
    biacromial_breadth_m: float
    hip_breadth_sitting_m: float
    strength_factor: float  # F0 over the reference subject's F0
    carrying_angle_deg: float
    extrapolated: tuple[str, ...]  # biometrics outside the range of the source data, in words


@dataclass(frozen=True)
class _Lengths:
    """Bone lengths [m]: upper arm from shoulder to elbow centre, forearm elbow to wrist, hand wrist to fingertip."""

    upper_arm: float
    forearm: float
    hand: float


@dataclass(frozen=True)
class _Anatomy:
    """The data files as arrays, for the right arm of the reference subject."""

    anthropometry: dict[str, Any]
    inertia: dict[str, Any]
    strength: dict[str, Any]
    skeleton: dict[str, Any]
    humerus_in_torso: np.ndarray  # (3, 3) orthonormal
    hand_in_radius: np.ndarray  # (3, 3) orthonormal
    reference_humerus: np.ndarray  # (3, 3) axes of the humerus at the reference posture, torso axes
    reference_elbow: np.ndarray  # (3, 3) the elbow's rotation there, humerus axes
    muscle_names: tuple[tuple[str, str, str, str], ...]  # name, full name, body of origin, body of insertion
    ends_body: np.ndarray  # (25, 2) index into _BODIES
    ends_m: np.ndarray  # (25, 2, 3)
    F0_N: np.ndarray  # (25,)
    relative_length: np.ndarray  # (25,) length / l0 at the reference posture


def make_body(biometrics: Biometrics, limbs: Iterable[str] = ("left",), strength_factor: float = 1.0) -> Body:
    """Make the body of one pilot.

    Parameters
    ----------
    biometrics : Biometrics
        Age, stature, mass and sex.
    limbs : iterable of str
        Which arms: `left`, `right` or both.
    strength_factor : float
        Times which every muscle is as strong as the biometrics say (study key `pilot.strength_factor`).

    Returns
    -------
    Body
        SI units. `extrapolated` names every biometric that lies outside the range of the source data.

    Raises
    ------
    StudyError
        A limb that does not exist, or none.
    """
    sides = tuple(limbs)
    if not sides or any(side not in SIDES for side in sides):
        raise StudyError(f"limbs is {list(sides)!r}; a list of 'left', 'right' or both is wanted")
    anatomy = _anatomy()
    dimensions_mm = _dimensions_mm(anatomy.anthropometry["regressions"], biometrics)
    ratios = anatomy.anthropometry["joint_centre_lengths"]
    lengths = _Lengths(
        upper_arm=1e-3 * dimensions_mm["acromion_radiale_length"] * ratios["upper_arm_per_acromion_radiale_length"],
        forearm=1e-3 * dimensions_mm["radiale_stylion_length"] * ratios["forearm_per_radiale_stylion_length"],
        hand=1e-3 * dimensions_mm["hand_length"],
    )
    carrying_angle_deg = float(anatomy.skeleton["carrying_angle"][f"{biometrics.sex}_deg"])
    strength_factor *= _strength_factor(anatomy.strength, biometrics, dimensions_mm["acromion_radiale_length"])

    right = _skeleton(anatomy, lengths, carrying_angle_deg, _segments(anatomy, biometrics, lengths))
    ends_m, l0_m = _bundles(anatomy, right, lengths)
    return Body(
        biometrics=biometrics,
        limbs={
            side: replace(
                right if side == "right" else _mirrored(right),
                muscles=_muscles(anatomy, ends_m if side == "right" else ends_m * _MIRROR + 0.0, l0_m, strength_factor),
            )
            for side in sides
        },
        sitting_height_m=1e-3 * dimensions_mm["sitting_height"],
        eye_height_sitting_m=1e-3 * dimensions_mm["eye_height_sitting"],
        acromial_height_sitting_m=1e-3 * dimensions_mm["acromial_height_sitting"],
        biacromial_breadth_m=1e-3 * dimensions_mm["biacromial_breadth"],
        hip_breadth_sitting_m=1e-3 * dimensions_mm["hip_breadth_sitting"],
        strength_factor=strength_factor,
        carrying_angle_deg=carrying_angle_deg,
        extrapolated=_extrapolated(anatomy, biometrics),
    )


# ---- data


@cache
def _anatomy() -> _Anatomy:
    files = {name: bundled(name).value for name in ("anthropometry", "inertia", "strength", "skeleton", "muscles")}
    muscles = files["muscles"]["muscles"]
    ends = ("origin", "insertion")
    position = files["skeleton"]["anatomical_position"]
    humerus_in_torso = _nearest_rotation(position["humerus_in_torso"])
    posture = files["skeleton"]["reference_posture"]
    flexion, abduction, rotation, elbow = (
        math.radians(posture[f"{name}_deg"])
        for name in ("shoulder_flexion", "shoulder_abduction", "shoulder_internal_rotation", "elbow_flexion")
    )
    tilt = math.radians(files["skeleton"]["joints"]["flexion_axis_tilt_in_humerus_deg"])
    return _Anatomy(
        anthropometry=files["anthropometry"],
        inertia=files["inertia"],
        strength=files["strength"],
        skeleton=files["skeleton"],
        humerus_in_torso=humerus_in_torso,
        hand_in_radius=_nearest_rotation(position["hand_in_radius"]),
        reference_humerus=_turn((0.0, 0.0, 1.0), flexion)
        @ _turn((1.0, 0.0, 0.0), -abduction)
        @ _turn((0.0, 1.0, 0.0), rotation)
        @ humerus_in_torso,
        reference_elbow=_turn((0.0, math.sin(tilt), math.cos(tilt)), elbow),
        muscle_names=tuple((m["name"], m["full_name"], m["origin"]["body"], m["insertion"]["body"]) for m in muscles),
        ends_body=np.array([[_BODIES.index(m[end]["body"]) for end in ends] for m in muscles]),
        ends_m=np.array([[m[end]["point_m"] for end in ends] for m in muscles], dtype=float),
        F0_N=np.array([m["F0_N"] for m in muscles], dtype=float),
        relative_length=np.array([m["length_at_reference_posture_m"] / m["l0_m"] for m in muscles]),
    )


def _turn(axis: Sequence[float], angle_rad: float) -> np.ndarray:
    """Return the rotation matrix of an angle about a unit axis."""
    x, y, z = axis
    s, c = math.sin(angle_rad), math.cos(angle_rad)
    t = 1.0 - c
    return np.array(
        [
            [c + t * x * x, t * x * y - s * z, t * x * z + s * y],
            [t * x * y + s * z, c + t * y * y, t * y * z - s * x],
            [t * x * z - s * y, t * y * z + s * x, c + t * z * z],
        ]
    )


def _nearest_rotation(rows: list[list[float]]) -> np.ndarray:
    """Return the rotation matrix nearest to one printed with five digits (polar decomposition)."""
    u, _, v = np.linalg.svd(np.array(rows, dtype=float))
    return np.asarray(u @ v)


# ---- size


def _dimensions_mm(regressions: Mapping[str, Any], biometrics: Biometrics) -> dict[str, float]:
    table = regressions[biometrics.sex]
    centre = table["centre"]
    stature = biometrics.stature_m - centre["stature_m"]
    mass = biometrics.mass_kg - centre["mass_kg"]
    age = biometrics.age_years - centre["age_years"]
    return {
        name: row[0] + row[1] * stature + row[2] * mass + row[3] * age
        for name, row in table.items()
        if name != "centre"
    }


def _extrapolated(anatomy: _Anatomy, biometrics: Biometrics) -> tuple[str, ...]:
    people = {"male": "men", "female": "women"}[biometrics.sex]
    survey = anatomy.anthropometry["survey_range"][biometrics.sex]
    said = []
    for name, key, value, unit in (
        ("age", "age_years", biometrics.age_years, "years"),
        ("stature", "stature_m", biometrics.stature_m, "m"),
        ("mass", "mass_kg", biometrics.mass_kg, "kg"),
        ("BMI", "bmi_kg_per_m2", biometrics.bmi, "kg/m^2"),
    ):
        low, high = survey[key]
        if not low <= value <= high:
            said.append(f"{name} {value:.4g} {unit} is outside the ANSUR II {people} ({low:g} to {high:g} {unit})")
    limit = anatomy.strength["skeletal_muscle_mass"]["valid_below_bmi_kg_per_m2"]
    if biometrics.bmi >= limit:
        said.append(
            f"BMI {biometrics.bmi:.4g} kg/m^2 is not below {limit:g}: the muscle mass equation was made on non-obese "
            "adults"
        )
    return tuple(said)


# ---- strength


def _strength_factor(strength: Mapping[str, Any], biometrics: Biometrics, acromion_radiale_length_mm: float) -> float:
    equation = strength["skeletal_muscle_mass"]
    muscle_mass_kg = (
        equation["per_kg_of_mass"] * biometrics.mass_kg
        + equation["per_m_of_stature_kg"] * biometrics.stature_m
        + (equation["male_kg"] if biometrics.sex == "male" else 0.0)
        + equation["per_year_of_age_kg"] * biometrics.age_years
        + equation["constant_kg"]
    )
    reference = strength["reference"]
    volume = strength["upper_body_share"][biometrics.sex] * muscle_mass_kg / reference["skeletal_muscle_mass_kg"]
    length = acromion_radiale_length_mm / reference["acromion_radiale_length_mm"]
    quality = strength["quality"]
    years_beyond = max(0.0, biometrics.age_years - quality["onset_years"])
    return float(volume / length * (1.0 + quality["per_year"] * years_beyond))


# ---- segments


def _segments(anatomy: _Anatomy, biometrics: Biometrics, lengths: _Lengths) -> dict[str, Segment]:
    """Return the four segments; the ulna's length is filled in by `_skeleton`, which knows the elbow."""
    masses = anatomy.inertia["masses"][biometrics.sex]
    if biometrics.sex == "male":
        stature_cm = 100.0 * biometrics.stature_m
        mass_kg = {
            name: masses[name][0] + masses[name][1] * biometrics.mass_kg + masses[name][2] * stature_cm
            for name in ("upper_arm", "forearm", "hand")
        }
    else:
        mass_kg = {
            name: masses[f"{name}_per_body_mass"] * biometrics.mass_kg for name in ("upper_arm", "forearm", "hand")
        }
    geometry = anatomy.inertia["geometry"][biometrics.sex]
    metacarpal_m = anatomy.skeleton["joints"]["wrist_to_third_metacarpal_head_m"]
    hand_scale = lengths.hand / anatomy.skeleton["reference_lengths"]["hand_m"]
    segments = {
        "humerus": _segment(
            "humerus", lengths.upper_arm, lengths.upper_arm, mass_kg["upper_arm"], geometry["upper_arm"]
        ),
        "hand": _segment("hand", metacarpal_m * hand_scale, lengths.hand, mass_kg["hand"], geometry["hand"]),
    }
    for name, (share, row) in _forearm_halves(tuple(geometry["forearm"])).items():
        segments[name] = _segment(name, lengths.forearm, lengths.forearm, share * mass_kg["forearm"], row)
    return {name: segments[name] for name in SEGMENTS}


def _segment(name: str, length_m: float, span_m: float, mass_kg: float, row: Iterable[float]) -> Segment:
    # row: com and three gyration radii as fractions of span
    com, *gyration = row
    inertia = np.diag([mass_kg * (radius * span_m) ** 2 for radius in gyration])
    return Segment(name, length_m, mass_kg, np.array([0.0, -com * span_m, 0.0]), inertia)


@cache
def _forearm_halves(row: tuple[float, float, float, float]) -> dict[str, tuple[float, tuple[float, ...]]]:
    """Split the forearm between radius and ulna: share of the mass, com and gyration radii over the forearm's length.

    estimated: soft tissue turns with the radius in proportion to its distance s from the elbow, so that the share s of
    each slice belongs to the radius. The mass per length is linear in s with the forearm's own centre of mass. The
    slices' transverse gyration is then scaled, per axis, so that both halves together have the forearm's.
    """
    com, gyration_x, gyration_y, gyration_z = row
    slope = 12.0 * (com - 0.5)  # density 1 + slope (s - 1/2): mass 1, centre of mass com
    start = 1.0 - 0.5 * slope
    moment = [start / (n + 1) + slope / (n + 2) for n in range(4)]  # integrals of s^n times the density
    share = {"radius": moment[1], "ulna": moment[0] - moment[1]}
    centre = {"radius": moment[2] / share["radius"], "ulna": (moment[1] - moment[2]) / share["ulna"]}
    spread = {
        "radius": moment[3] / share["radius"] - centre["radius"] ** 2,
        "ulna": (moment[2] - moment[3]) / share["ulna"] - centre["ulna"] ** 2,
    }
    between = share["radius"] * share["ulna"] * (centre["radius"] - centre["ulna"]) ** 2
    within = share["radius"] * spread["radius"] + share["ulna"] * spread["ulna"]
    scale_x = math.sqrt((gyration_x**2 - between) / within)
    scale_z = math.sqrt((gyration_z**2 - between) / within)
    return {
        name: (
            share[name],
            (centre[name], scale_x * math.sqrt(spread[name]), gyration_y, scale_z * math.sqrt(spread[name])),
        )
        for name in ("radius", "ulna")
    }


# ---- joints


def _skeleton(anatomy: _Anatomy, lengths: _Lengths, carrying_angle_deg: float, segments: dict[str, Segment]) -> Limb:
    """Return the right arm without muscles, its closed chain satisfied at the anatomical position by construction.

    At full extension the x axes of humerus and ulna are parallel and both long axes lie in the plane across x, where
    the flexion axis is tilted against the perpendicular of each; the two tilts add up to the carrying angle. With the
    radius parallel to the ulna the radial head is beside the ulna's axis by the elbow width seen along that axis, and
    the distal offset of the radius is the same: the in-line rule.
    """
    joints = anatomy.skeleton["joints"]
    reference = anatomy.skeleton["reference_lengths"]
    humerus_scale = lengths.upper_arm / reference["humerus_m"]
    forearm_scale = lengths.forearm / reference["forearm_m"]
    hand_scale = lengths.hand / reference["hand_m"]

    carrying = math.radians(carrying_angle_deg)
    tilt_in_humerus = math.radians(joints["flexion_axis_tilt_in_humerus_deg"])
    tilt_in_ulna = carrying - tilt_in_humerus
    axis_in_humerus = np.array([0.0, math.sin(tilt_in_humerus), math.cos(tilt_in_humerus)])
    axis_in_ulna = np.array([0.0, -math.sin(tilt_in_ulna), math.cos(tilt_in_ulna)])
    width_m = joints["humero_ulnar_to_humero_radial_m"] * humerus_scale
    hinge = np.array([0.0, -lengths.upper_arm, 0.0])
    radial_head = hinge + width_m * axis_in_humerus
    ulnar_head = np.array([0.0, -joints["radius_to_ulnar_head_level_m"] * forearm_scale, -width_m * axis_in_ulna[2]])
    ulna_length_m = width_m * math.sin(tilt_in_ulna) - ulnar_head[1]

    c, s = math.cos(carrying), math.sin(carrying)
    humerus = anatomy.humerus_in_torso
    ulna = humerus @ np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    # Palm forward: the radius turned in pronation from parallel bones, about the line through both its ulnar joints.
    parallel_deg = anatomy.skeleton["anatomical_position"]["forearm_turned_from_parallel_bones_deg"]
    radius = ulna @ _turn(_forearm_axis(ulnar_head), math.radians(parallel_deg))
    hand = radius @ anatomy.hand_in_radius
    wrist = np.array([0.0, -lengths.forearm, 0.0])
    head_m = humerus @ radial_head
    return Limb(
        side="right",
        segments={**segments, "ulna": replace(segments["ulna"], length_m=ulna_length_m)},
        muscles=(),
        HU_in_humerus=hinge,
        HR_in_humerus=radial_head,
        elbow_axis_in_humerus=axis_in_humerus,
        elbow_axis_in_ulna=axis_in_ulna,
        UH_in_radius=ulnar_head,
        W_in_radius=wrist,
        wrist_flexion_axis_in_radius=anatomy.hand_in_radius[:, 2].copy(),
        wrist_deviation_axis_in_hand=np.array([1.0, 0.0, 0.0]),
        grip_in_hand=np.array(anatomy.skeleton["grip"]["centre_in_hand_m"]) * hand_scale,
        anatomical_origin_m={
            "humerus": np.zeros(3),
            "radius": head_m,
            "ulna": humerus @ hinge,
            "hand": head_m + radius @ wrist,
        },
        anatomical_axes={"humerus": humerus.copy(), "radius": radius, "ulna": ulna, "hand": hand},
    )


def _forearm_axis(UH_in_radius: np.ndarray) -> list[float]:
    """Return the unit vector from ulnar head to radial head in the radius: the right forearm's axis of pronation."""
    x, y, z = UH_in_radius.tolist()
    norm = -math.sqrt(x * x + y * y + z * z)
    return [x / norm, y / norm, z / norm]


# ---- muscles


def _bundles(anatomy: _Anatomy, limb: Limb, lengths: _Lengths) -> tuple[np.ndarray, np.ndarray]:
    """Return the right arm's muscle ends (25, 2, 3) and l0 (25,) [m].

    Ends scale with their own bone, torso points with the humerus. l0 is such that length / l0 at the reference posture
    is that of the reference subject: muscles grow with the distance they span, so that everybody works on the same part
    of the force-length curve.
    """
    reference = anatomy.skeleton["reference_lengths"]
    humerus_scale = lengths.upper_arm / reference["humerus_m"]
    forearm_scale = lengths.forearm / reference["forearm_m"]
    hand_scale = lengths.hand / reference["hand_m"]
    scale = np.array([humerus_scale, humerus_scale, forearm_scale, forearm_scale, hand_scale])  # as _BODIES
    ends_m = anatomy.ends_m * scale[anatomy.ends_body][:, :, None]

    # The bones at the reference posture. The forearm turns about a line through HR and UH, fixed in both bones.
    pronation_deg = anatomy.skeleton["reference_posture"]["pronation_from_anatomical_deg"]
    ulna_at_elbow = limb.anatomical_axes["humerus"].T @ limb.anatomical_axes["ulna"]
    radius_in_ulna = limb.anatomical_axes["ulna"].T @ limb.anatomical_axes["radius"]
    humerus = anatomy.reference_humerus
    ulna = humerus @ anatomy.reference_elbow @ ulna_at_elbow
    radius = ulna @ radius_in_ulna @ _turn(_forearm_axis(limb.UH_in_radius), math.radians(pronation_deg))
    hand = radius @ anatomy.hand_in_radius
    head = humerus @ limb.HR_in_humerus
    origins = {
        "torso": np.zeros(3),
        "humerus": np.zeros(3),
        "radius": head,
        "ulna": humerus @ limb.HU_in_humerus,
        "hand": head + radius @ limb.W_in_radius,
    }
    axes = {"torso": np.eye(3), "humerus": humerus, "radius": radius, "ulna": ulna, "hand": hand}
    all_origins = np.array([origins[name] for name in _BODIES])
    all_axes = np.array([axes[name] for name in _BODIES])
    placed = all_origins[anatomy.ends_body] + np.einsum("meij,mej->mei", all_axes[anatomy.ends_body], ends_m)
    length_m = np.sqrt(np.sum((placed[:, 1] - placed[:, 0]) ** 2, axis=1))
    return ends_m, length_m / anatomy.relative_length


def _muscles(anatomy: _Anatomy, ends_m: np.ndarray, l0_m: np.ndarray, strength_factor: float) -> tuple[Muscle, ...]:
    per_second = float(anatomy.strength["maximum_velocity_l0_per_s"])
    return tuple(
        Muscle(name, full_name, origin, ends[0], insertion, ends[1], force, l0, per_second * l0)
        for (name, full_name, origin, insertion), ends, force, l0 in zip(
            anatomy.muscle_names, ends_m, (anatomy.F0_N * strength_factor).tolist(), l0_m.tolist(), strict=True
        )
    )


# ---- the other side


def _mirrored(limb: Limb) -> Limb:
    """Return the mirror image z -> -z of a limb without muscles.

    With S = diag(1, 1, -1): points p -> S p, frames and inertia R -> S R S, axial vectors a -> -S a.
    """
    outer = _MIRROR[:, None] * _MIRROR

    def point(p: np.ndarray) -> np.ndarray:
        return np.asarray(p * _MIRROR + 0.0)  # + 0.0: no -0 in the decks

    def axial(a: np.ndarray) -> np.ndarray:
        return np.asarray(0.0 - a * _MIRROR)

    return Limb(
        side="left" if limb.side == "right" else "right",
        segments={
            name: replace(segment, com_m=point(segment.com_m), inertia_kg_m2=segment.inertia_kg_m2 * outer + 0.0)
            for name, segment in limb.segments.items()
        },
        muscles=(),
        HU_in_humerus=point(limb.HU_in_humerus),
        HR_in_humerus=point(limb.HR_in_humerus),
        elbow_axis_in_humerus=axial(limb.elbow_axis_in_humerus),
        elbow_axis_in_ulna=axial(limb.elbow_axis_in_ulna),
        UH_in_radius=point(limb.UH_in_radius),
        W_in_radius=point(limb.W_in_radius),
        wrist_flexion_axis_in_radius=axial(limb.wrist_flexion_axis_in_radius),
        wrist_deviation_axis_in_hand=axial(limb.wrist_deviation_axis_in_hand),
        grip_in_hand=point(limb.grip_in_hand),
        anatomical_origin_m={name: point(origin) for name, origin in limb.anatomical_origin_m.items()},
        anatomical_axes={name: axes * outer + 0.0 for name, axes in limb.anatomical_axes.items()},
    )
