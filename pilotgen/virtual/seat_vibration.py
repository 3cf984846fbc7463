"""A seated pilot on a seat that vibrates vertically: apparent mass, and what of the motion reaches pelvis to head.

Read off the linearised deck of the pilot at the controls, full order. Frequencies in Hz, accelerations over the seat's
acceleration, apparent masses in kg: force on the body over the seat's acceleration.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from pilotgen.decks.deck import GRAVITY_M_PER_S2
from pilotgen.errors import EvaluationError
from pilotgen.evaluation import SolvedPilot
from pilotgen.linear.imposed_motion import split
from pilotgen.posture.seated_torso import SeatedTorso
from pilotgen.solver.descriptor import Complexes, Floats
from pilotgen.solver.matrices import descriptor
from pilotgen.study.yaml_file import bundled

LOW_HZ, HIGH_HZ, POINTS = 0.5, 20.0, 400
TABLE_HZ = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
REFERENCE_HZ = 1.0  # where apparent masses are taken for 1
PEAK_FROM_HZ = 2.0  # below it people rock against the back; the peak of interest is the vertical resonance

# quantity -> what it is; all per vertical acceleration of the seat
QUANTITIES: Mapping[str, str] = {
    "apparent_mass_pan": "apparent mass at the seat pan, vertical [kg]",
    "apparent_mass_back": "apparent mass at the seat back, fore-aft [kg]",
    "pelvis": "seat to pelvis, vertical",
    "shoulder_t1": "seat to T1, vertical",
    "shoulder": "seat to left shoulder joint, vertical",
    "shoulder_fore_aft": "seat to left shoulder joint, fore-aft",
    "trunk_pitch": "seat to thorax, pitch [rad/m]",
    "head": "seat to head, vertical",
    "head_fore_aft": "seat to head, fore-aft",
    "head_pitch": "seat to head, pitch [rad/m]",
}


@dataclass(frozen=True)
class Peak:
    """Where a magnitude is largest above `PEAK_FROM_HZ`, and its value there; for apparent masses over that at 1 Hz."""

    frequency_hz: float
    ratio: float


@dataclass(frozen=True, eq=False)
class SeatVibration:
    """Responses of one pilot to vertical vibration of the seat.

    Attributes
    ----------
    frequency_hz : ndarray, shape (n,)
        Ascending.
    responses : dict of str to ndarray, shape (n,), complex
        By the names of `QUANTITIES`; what the torso's model has no body for is left out.
    body_mass_kg, supported_mass_kg : float
        Of the pilot, and of what rests on the seat's springs.
    """

    frequency_hz: Floats
    responses: dict[str, Complexes]
    body_mass_kg: float
    supported_mass_kg: float

    def at(self, name: str, frequency_hz: float) -> complex:
        """A response at one frequency, between the points of the grid."""
        values = self.responses[name]
        real, imag = (np.interp(frequency_hz, self.frequency_hz, part) for part in (values.real, values.imag))
        return complex(real, imag)

    def peak(self, name: str) -> Peak:
        """Peak of a magnitude above `PEAK_FROM_HZ`."""
        return _peak(self.frequency_hz, self.responses[name], over_first=name.startswith("apparent_mass"))

    def as_dict(self) -> dict[str, Any]:
        """JSON-able: the table's frequencies, and the peaks."""
        return {
            "body_mass_kg": self.body_mass_kg,
            "supported_mass_kg": self.supported_mass_kg,
            "supported_mass_share": self.supported_mass_kg / self.body_mass_kg,
            "frequency_hz": self.frequency_hz.tolist(),
            "responses": {
                name: {
                    "what": QUANTITIES[name],
                    "magnitude": np.abs(values).tolist(),
                    "phase_deg": np.degrees(np.angle(values)).tolist(),
                    "peak_hz": self.peak(name).frequency_hz,
                    "peak_ratio": self.peak(name).ratio,
                }
                for name, values in self.responses.items()
            },
            "bands": [
                {
                    "label": band["label"],
                    "source": band["source"],
                    "peak_hz": band["peak_hz"],
                    "peak_ratio": band["peak_ratio"],
                    "inside": self.inside(band),
                }
                for band in published()["bands"]
                if band["quantity"] in self.responses
            ],
        }

    def inside(self, band: Mapping[str, Any]) -> bool:
        """Whether a peak lies in a published band."""
        found = self.peak(band["quantity"])
        (f0, f1), (r0, r1) = band["peak_hz"], band["peak_ratio"]
        return bool(f0 <= found.frequency_hz <= f1 and r0 <= found.ratio <= r1)


def _peak(frequency_hz: Floats, values: Complexes, over_first: bool) -> Peak:
    magnitude = np.abs(values)
    where = np.flatnonzero(frequency_hz >= PEAK_FROM_HZ)
    k = int(where[np.argmax(magnitude[where])])
    scale = float(np.interp(REFERENCE_HZ, frequency_hz, magnitude)) if over_first else 1.0
    return Peak(float(frequency_hz[k]), float(magnitude[k]) / scale)


@cache
def published() -> dict[str, Any]:
    """Bands and lumped models of `data/seat_vibration.yaml`."""
    found: dict[str, Any] = bundled("seat_vibration").value
    return found


def vibration_frequencies() -> Floats:
    """Frequencies [Hz], shape (n,), evenly spaced on a logarithmic axis, those of the table among them."""
    return np.unique(np.concatenate((np.geomspace(LOW_HZ, HIGH_HZ, POINTS), TABLE_HZ)))


def seat_vibration(pilot: SolvedPilot, frequency_hz: Floats | None = None) -> SeatVibration:
    """Respond to a vertical acceleration of the seat.

    ValueError if the pilot's deck was not linearised.

    Parameters
    ----------
    pilot : SolvedPilot
        Linearised, with a torso on springs.
    frequency_hz : ndarray, shape (n,), optional
        `vibration_frequencies` by default.

    Raises
    ------
    EvaluationError
        Stage "torso": a rigid torso does not move against its seat.
    """
    if pilot.torso is None:
        raise EvaluationError(
            "torso", "a rigid torso moves as the seat does; give pilot.torso.model = lumped to have springs below it"
        )
    if pilot.matrices is None:
        raise ValueError("the pilot's deck was not linearised")
    frequency_hz = vibration_frequencies() if frequency_hz is None else np.asarray(frequency_hz, dtype=float)
    s = np.asarray(2j * math.pi * frequency_hz, dtype=complex)
    motion = split(descriptor(pilot.matrices))
    free = motion.free
    # one column: heave, whatever other directions the model has
    g_y, g_ydot = (
        np.reshape(part, (len(free.names), -1))[:, 0] for part in (motion.g_y_imposed, motion.g_ydot_imposed)
    )
    pencil = s[:, None, None] * free.g_ydot + free.g_y
    right = -(s[:, None] * g_ydot + g_y)
    z = np.asarray(np.linalg.solve(pencil, right[:, :, None])[:, :, 0], dtype=complex)

    def moved(node: str, place: Any) -> Complexes:
        """Displacement (n, 3) of a point of a body per metre of the seat's."""
        shift = np.stack([z[:, free.index(f"{node}.{axis}")] for axis in "xyz"], axis=1)
        return np.asarray(shift + np.cross(turned(node), np.asarray(place) - np.asarray(seated.places[node])))

    def turned(node: str) -> Complexes:
        """Rotation (n, 3) of a body per metre of the seat's."""
        return np.stack([z[:, free.index(f"{node}.g{axis}")] for axis in "xyz"], axis=1)

    seated = pilot.torso
    pan = next(spring for spring in seated.torso.springs if spring.first == "seat" and spring.carries)
    back = next(spring for spring in seated.torso.springs if spring.name == "back")
    t1, shoulder = seated.points["neck"], pilot.cockpit.torso[next(iter(pilot.cockpit.torso))][0]
    head = seated.places["head"]
    responses = {
        "apparent_mass_pan": _force(seated, pan.name, moved(pan.second, seated.points[pan.name]), s)[:, 1] / s**2,
        "apparent_mass_back": _force(seated, back.name, moved("thorax", seated.points[back.name]), s)[:, 0] / s**2,
        "pelvis": moved("pelvis", seated.places["pelvis"])[:, 1],
        "shoulder_t1": moved("thorax", t1)[:, 1],
        "shoulder": moved("thorax", shoulder)[:, 1],
        "shoulder_fore_aft": moved("thorax", shoulder)[:, 0],
        "trunk_pitch": turned("thorax")[:, 2],
        "head": moved("head", head)[:, 1],
        "head_fore_aft": moved("head", head)[:, 0],
        "head_pitch": turned("head")[:, 2],
    }
    supported = -seated.prestress[pan.name][1] / GRAVITY_M_PER_S2  # what the hands hold counts, with its sign
    return SeatVibration(frequency_hz, responses, pilot.biometrics.mass_kg, supported)


def _force(seated: SeatedTorso, name: str, moved: Complexes, s: Complexes) -> Complexes:
    """Force (n, 3) [N] of a spring that stands on the seat, on its second body, per metre of the seat's heave."""
    spring = next(row for row in seated.torso.springs if row.name == name)
    t = math.radians(seated.back_angle_deg) if spring.inclined else 0.0
    axes = np.array([[math.cos(t), -math.sin(t), 0.0], [math.sin(t), math.cos(t), 0.0], [0.0, 0.0, 1.0]])
    stretch = (moved - np.array([0.0, 1.0, 0.0])) @ axes
    # the seat does not turn: what the spring carries in the posture keeps its direction, and only the stretch acts
    law = np.array(spring.stiffness[:3]) + s[:, None] * np.array(spring.damping[:3])
    return np.asarray(-(law * stretch) @ axes.T)


# ---- published lumped models -----------------------------------------------------------------------------------------


def lumped_model(name: str, frequency_hz: Floats) -> dict[str, Complexes]:
    """Responses of a published model, shape (n,) each: `apparent_mass_pan` [kg], `shoulder` and, with a head, `head`.

    Parameters
    ----------
    name : str
        Of `published()["models"]`.
    frequency_hz : ndarray, shape (n,)
        Frequencies.
    """
    row = published()["models"][name]
    riding = row.get("rides_on_seat")
    names = [mass for mass in row["masses"] if mass != riding]
    n = len(names)
    M = np.diag([row["masses"][mass] for mass in names])
    K, C = np.zeros((n, n)), np.zeros((n, n))
    k0, c0 = np.zeros(n), np.zeros(n)
    for first, second, k, c in row["links"]:
        j = names.index(second)
        K[j, j] += k
        C[j, j] += c
        if first == "seat":
            k0[j] += k
            c0[j] += c
        else:
            i = names.index(first)
            K[i, i] += k
            C[i, i] += c
            K[i, j], K[j, i] = K[i, j] - k, K[j, i] - k
            C[i, j], C[j, i] = C[i, j] - c, C[j, i] - c
    s = 2j * math.pi * np.asarray(frequency_hz, dtype=float)
    pencil = s[:, None, None] ** 2 * M + s[:, None, None] * C + K
    x = np.asarray(np.linalg.solve(pencil, (k0 + s[:, None] * c0)[:, :, None])[:, :, 0], dtype=complex)
    mass = x @ np.diag(M) + (row["masses"][riding] if riding else 0.0)
    found = {"apparent_mass_pan": mass, "shoulder": x[:, names.index(row["trunk"])]}
    if "top" in row:
        found["head"] = x[:, names.index(row["top"])]
    return found


# ---- a table for people ----------------------------------------------------------------------------------------------


def report(found: SeatVibration) -> str:
    """The responses at a few frequencies, and the peaks beside the published bands."""
    names = [name for name in QUANTITIES if name in found.responses]
    width = max(len(QUANTITIES[name]) for name in names)
    lines = [
        f"{found.supported_mass_kg:.1f} kg of {found.body_mass_kg:.1f} kg "
        f"({100.0 * found.supported_mass_kg / found.body_mass_kg:.0f} %) rest on the seat's springs",
        "",
        " " * width + "".join(f"{f'{hz:g} Hz':>12}" for hz in TABLE_HZ),
    ]
    for name in names:
        cells = []
        for hz in TABLE_HZ:
            value = found.at(name, hz)
            digits = 1 if name.startswith("apparent_mass") else 2
            cells.append(f"{abs(value):.{digits}f}/{math.degrees(math.atan2(value.imag, value.real)):.0f}°".rjust(12))
        lines.append(QUANTITIES[name].ljust(width) + "".join(cells))
    lines.append("")
    for band in published()["bands"]:
        if band["quantity"] not in found.responses:
            continue
        peak = found.peak(band["quantity"])
        (f0, f1), (r0, r1) = band["peak_hz"], band["peak_ratio"]
        verdict = "inside" if found.inside(band) else "OUTSIDE"
        lines.append(
            f"{band['label']}: {peak.ratio:.2f} at {peak.frequency_hz:.2f} Hz, {verdict} the published "
            f"{r0:g} to {r1:g} at {f0:g} to {f1:g} Hz"
        )
    lines.append(
        "(the bands are of rigid seats, mostly without a back: cockpit.seat.cushion = none, weak cockpit.seat.back)"
    )
    return "\n".join(lines)
