"""Rotorcraft of several inputs and outputs: blade pitch of the controls in, motions of the pilot's seat out.

Bundled ones (pilotgen/data/plants.yaml) and the user's JSON files have one form; every input and output says its unit
and its positive direction, and is turned here to this program's: collective up, stick aft and right; heave up, surge
forward, sway and roll right, pitch nose up, yaw nose right (docs/theory/mimo.md).

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pilotgen.errors import FileError
from pilotgen.linear.imposed_motion import PEDALS, SEAT_MOTIONS
from pilotgen.linear.statespace import FloatArray, StateSpaceModel
from pilotgen.loop.delay import pade_delay
from pilotgen.loop.loop_file import MOST_STATES, read_values
from pilotgen.loop.units import CONTROLS, OUTPUT_FACTORS, POSITIVE
from pilotgen.study.rotorcraft import Rotorcraft, bundled_rotorcraft, load_rotorcraft
from pilotgen.study.wording import did_you_mean
from pilotgen.study.yaml_file import bundled

_INPUT_UNITS = {"rad": 1.0, "deg": math.degrees(1.0), "percent": 1.0}  # per rad; percent stays percent of travel
_OUTPUT_UNITS = OUTPUT_FACTORS


@dataclass(frozen=True, eq=False)
class MatrixPlant:
    """x' = A x + B u, y = C x + D u.

    Attributes
    ----------
    A, B, C, D : ndarray, shapes (n, n), (n, m), (k, n), (k, m)
        SI units.
    controls : tuple of str
        Names of `CONTROLS`, the inputs: blade pitch [rad], or percent of travel where `in_percent`.
    motions : tuple of str
        Names of `SEAT_MOTIONS`, the outputs: accelerations of the seat.
    in_percent : bool
        Inputs are percent of control travel.
    name, source : str
        For people.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    controls: tuple[str, ...]
    motions: tuple[str, ...]
    in_percent: bool
    name: str
    source: str

    def called(self, name: str) -> MatrixPlant:
        """The same plant under another name."""
        return dataclasses.replace(self, name=name)

    def at_seat(self, seat_m: Sequence[float]) -> MatrixPlant:
        """The plant with its translations at a seat: `seat_m` forward, up, right of where they are given [m].

        Accelerations there are those of the point plus angular acceleration x offset. Rotations that the plant does not
        have count as zero.
        """
        C, D = self.C.copy(), self.D.copy()
        for motion in self.motions:
            wanted = SEAT_MOTIONS[motion]
            if not wanted.rotation:
                continue
            moved = np.cross(wanted.axis, np.asarray(seat_m, dtype=float))
            j = self.motions.index(motion)
            for i, other in enumerate(self.motions):
                if not SEAT_MOTIONS[other].rotation:
                    share = float(np.dot(SEAT_MOTIONS[other].axis, moved))
                    C[i] += share * self.C[j]
                    D[i] += share * self.D[j]
        return dataclasses.replace(self, C=C, D=D)


def bundled_plants() -> list[str]:
    """Names of the bundled plants of several inputs and outputs."""
    return list(_bundled())


def roll_rotorcraft() -> Mapping[str, Rotorcraft]:
    """The bundled rotorcraft of the roll-flap form, by name without `roll-`."""
    named = {name.removeprefix("roll-"): name for name in bundled_rotorcraft() if name.startswith("roll-")}
    return {short: load_rotorcraft(name) for short, name in named.items()}


def _bundled() -> dict[str, Any]:
    data: dict[str, Any] = bundled("plants").value
    return data


def load_plant(name: str) -> MatrixPlant:
    """A bundled plant by its name, or one from a JSON, MATLAB or HDF5 file.

    Raises
    ------
    FileError
        The name is not known, or the file cannot be read or is no plant.
    """
    if name in bundled_plants():
        return plant_from(_bundled()[name], name)
    if not name.lower().endswith((".json", ".mat", ".h5", ".hdf5")):
        known = list(bundled_plants())
        near = did_you_mean(name, [*known, *(f"roll:{one}" for one in roll_rotorcraft())])
        raise FileError(
            f"plant {name!r} is not known; {near}bundled: {', '.join(known)}; or name a .json, .mat or .h5 file"
        )
    return plant_from(read_values(Path(name)), name)


def plant_from(data: Mapping[str, Any], where: str) -> MatrixPlant:
    """A plant from plain data; FileError says what is missing or wrong."""
    A = _matrix(data, "A", where, None, None)
    n = len(A)
    if A.shape[1] != n:
        raise FileError(f"{where}: A has shape {A.shape}; a square matrix is wanted")
    if n > MOST_STATES:
        raise FileError(f"{where}: {n} states; {MOST_STATES} are read, reduce it first")
    inputs, outputs = _signals(data, "inputs", where), _signals(data, "outputs", where)
    B = _matrix(data, "B", where, n, len(inputs))
    states = [str(state) for state in data.get("states", [])]
    rows = [_state(signal, states, where) for signal in outputs]
    if any(row is not None for row in rows):
        if not all(row is not None for row in rows):
            raise FileError(f"{where}: outputs are all `derivative_of` a state, or all rows of C and D")
        index = [row for row in rows if row is not None]
        C, D = A[index], B[index]
    else:
        C, D = _matrix(data, "C", where, len(outputs), n), _matrix(data, "D", where, len(outputs), len(inputs))
    controls, into, delays, percent = [], [], [], []
    for signal in inputs:
        control, unit = _said(signal, "control", CONTROLS, where), _said(signal, "unit", _INPUT_UNITS, where)
        _, positive, negative = CONTROLS[control]
        sign = _said(signal, "positive", {positive: 1.0, negative: -1.0}, where)
        controls.append(control)
        into.append(_INPUT_UNITS[unit] * (1.0 if sign == positive else -1.0))
        percent.append(unit == "percent")
        delays.append(float(signal.get("delay_s", 0.0)))
    motions, out = [], []
    for signal in outputs:
        motion, unit = _said(signal, "motion", POSITIVE, where), _said(signal, "unit", _OUTPUT_UNITS, where)
        if ("rad" in unit or "deg" in unit) != SEAT_MOTIONS[motion].rotation:
            raise FileError(f"{where}: output {motion!r} cannot be in {unit}")
        positive, negative = POSITIVE[motion]
        sign = _said(signal, "positive", {positive: 1.0, negative: -1.0}, where)
        motions.append(motion)
        out.append(_OUTPUT_UNITS[unit] * (1.0 if sign == positive else -1.0))
    for names in (controls, motions):
        if len(set(names)) != len(names):
            raise FileError(f"{where}: a control or motion stands twice among {', '.join(names)}")
    if any(percent) and not all(percent):
        raise FileError(f"{where}: inputs are all in percent of travel, or all angles of the blades")
    gain_in, gain_out = np.array(into), np.array(out)[:, None]
    plant = MatrixPlant(
        A, B * gain_in, gain_out * C, gain_out * D * gain_in, tuple(controls), tuple(motions), all(percent),
        str(data.get("name", where)), str(data.get("source", "")),
    )  # fmt: skip
    return _delayed(plant, delays) if any(delays) else plant


def _delayed(plant: MatrixPlant, delays: Sequence[float]) -> MatrixPlant:
    """The plant behind rational delays of its inputs."""
    n, m = plant.B.shape
    parts = [pade_delay(delay) if delay else None for delay in delays]
    total = n + sum(part.n_states for part in parts if part is not None)
    A, B = np.zeros((total, total)), np.zeros((total, m))
    C, D = np.zeros((len(plant.C), total)), plant.D.copy()
    A[:n, :n], C[:, :n], B[:n] = plant.A, plant.C, plant.B
    first = n
    for j, part in enumerate(parts):
        if part is None:
            continue
        own = slice(first, first + part.n_states)
        A[own, own], B[own, j] = part.A, part.B
        A[:n, own], C[:, own] = np.outer(plant.B[:, j], part.C), np.outer(plant.D[:, j], part.C)
        B[:n, j], D[:, j] = plant.B[:, j] * part.D, plant.D[:, j] * part.D
        first += part.n_states
    return MatrixPlant(A, B, C, D, plant.controls, plant.motions, plant.in_percent, plant.name, plant.source)


def one_channel(plant: MatrixPlant, motion: str, control: str) -> StateSpaceModel:
    """One motion of the seat by one control [m/s^2 or rad/s^2 per rad].

    Raises
    ------
    FileError
        The plant does not have the two, or its inputs are in percent of travel, which have no gearing in rad/m.
    """
    if motion not in plant.motions or control not in plant.controls:
        raise FileError(
            f"{plant.name}: has {', '.join(plant.motions)} by {', '.join(plant.controls)}; the loop of the study is "
            f"{motion} by {control}"
        )
    if plant.in_percent:
        raise FileError(f"{plant.name}: inputs in percent of travel; a study's gearing is blade pitch, rad or deg")
    i, j = plant.motions.index(motion), plant.controls.index(control)
    return StateSpaceModel(plant.A, plant.B[:, j], plant.C[i], float(plant.D[i, j]))


def roll_plant(tau_s: float, flap_1_s2: float, delay_s: float, height_m: float) -> MatrixPlant:
    """Roll with flapping: lateral blade pitch [rad] to roll and sway of a seat `height_m` above the roll axis.

    tau db = -b - tau p + theta(t - d), dp = Lb b; p/theta = (Lb/tau) exp(-d s)/(s^2 + s/tau + Lb).

    Source: Heffley's hybrid form, as identified for the OH-58D.
    """
    A = np.array([[0.0, flap_1_s2], [-1.0, -1.0 / tau_s]])
    B = np.array([[0.0], [1.0 / tau_s]])
    C = np.array([[0.0, flap_1_s2], [0.0, height_m * flap_1_s2]])
    plant = MatrixPlant(A, B, C, np.zeros((2, 1)), ("lateral",), ("roll", "sway"), False, "roll", "")
    return _delayed(plant, [delay_s]) if delay_s else plant


# ---- plain data, checked


def _matrix(data: Mapping[str, Any], key: str, where: str, rows: int | None, columns: int | None) -> FloatArray:
    if key not in data:
        raise FileError(
            f"{where}: {key} is missing; a plant has A, B, inputs, outputs, and C, D or derivatives of states"
        )
    try:
        value = np.array(data[key], dtype=float)
    except (TypeError, ValueError):
        raise FileError(f"{where}: {key} is no matrix of numbers with rows of equal length") from None
    if value.ndim != 2 or rows not in (None, value.shape[0]) or columns not in (None, value.shape[1]):
        raise FileError(f"{where}: {key} has shape {value.shape}; ({rows or 'n'}, {columns or 'n'}) is wanted")
    if not np.isfinite(value).all():
        raise FileError(f"{where}: {key} holds a number that is not finite")
    return value


def _signals(data: Mapping[str, Any], key: str, where: str) -> list[Mapping[str, Any]]:
    value = data.get(key)
    if not isinstance(value, list) or not value or not all(isinstance(signal, Mapping) for signal in value):
        raise FileError(f"{where}: {key} is missing or no list of signals with their units and positive directions")
    return value


def _said(signal: Mapping[str, Any], key: str, known: Mapping[str, Any], where: str) -> str:
    value = signal.get(key)
    if not isinstance(value, str) or value not in known:
        pedals = f"; {PEDALS}" if isinstance(value, str) and ("pedal" in value or "tail" in value) else ""
        came = "is missing" if value is None else f"= {str(value)[:40]!r} is not known"
        raise FileError(f"{where}: {key} of a signal {came}; known: {', '.join(known)}{pedals}")
    return value


def _state(signal: Mapping[str, Any], states: Sequence[str], where: str) -> int | None:
    name = signal.get("derivative_of")
    if name is None:
        return None
    if name not in states:
        raise FileError(
            f"{where}: derivative_of = {str(name)[:40]!r} is no state; states: {', '.join(states) or 'none'}"
        )
    return states.index(str(name))
