"""A rotorcraft as the loop sees it: blade pitch of one control in, acceleration of the seat in one motion out.

Anything with the members of `RotorcraftModel` closes a loop: the heave and coning model, a state space or transfer
function of the user's (`PlantFile`), and either of them behind an actuator, a delay, a notch filter (`Chained`). Blade
pitch in rad, more collective positive; acceleration in m/s^2, up positive (docs/theory/loop.md).

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, reduce
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from pilotgen.errors import FileError, PilotgenError
from pilotgen.linear.partial_fractions import PartialFractions, poles_and_residues
from pilotgen.linear.statespace import ComplexArray, StateSpaceModel, series, transfer_function, zeros_poles_gain
from pilotgen.loop.delay import pade_delay
from pilotgen.loop.frequency_file import FrequencyResponse, read_frequency_response
from pilotgen.loop.heave_model import HeaveModel
from pilotgen.loop.plants import one_channel, plant_from
from pilotgen.loop.units import COLLECTIVE, HEAVE, stated_gain
from pilotgen.study.fields import Mistake
from pilotgen.study.rotorcraft import Rotorcraft


class RotorcraftModel(Protocol):
    """What a loop asks of a rotorcraft."""

    @property
    def state_space(self) -> StateSpaceModel:
        """Blade pitch [rad] -> vertical acceleration of the seat [m/s^2]."""

    @property
    def partial_fractions(self) -> PartialFractions | None:
        """The same as a sum over its poles, if it has such a form."""

    def response(self, omega: npt.ArrayLike) -> ComplexArray:
        """H(j omega) [m/s^2 per rad], omega in rad/s, any shape; delays exactly."""


def rotorcraft_model(rotorcraft: Rotorcraft, motion: str = HEAVE, control: str = COLLECTIVE) -> RotorcraftModel:
    """The dynamics of a study's rotorcraft in its loop: acceleration of the seat in `motion` by the pitch of `control`.

    Raises
    ------
    FileError
        Its plant file cannot be read, is none, or is of another loop.
    StudyError
        An inflow lead without an actuator: no proper model.
    """
    base: RotorcraftModel
    if rotorcraft.roll is not None:
        base = PlantFile(roll_model(rotorcraft.roll))
    elif rotorcraft.frequency_response is not None:
        base = MeasuredRotorcraft(read_frequency_response(Path(rotorcraft.frequency_response), motion, control))
    elif rotorcraft.plant_file is not None:
        base = read_plant(rotorcraft, motion, control)
    else:
        base = HeaveModel(rotorcraft)
    parts = chain_of(rotorcraft)
    return Chained(base, parts, rotorcraft.delay_s) if parts is not None or rotorcraft.delay_s else base


def roll_model(numbers: Mapping[str, Any]) -> StateSpaceModel:
    """Roll with flapping: lateral blade pitch theta [rad] -> roll acceleration [rad/s^2], both right.

    tau db = -b - tau p + theta, dp = L_b b: p/theta = (L_b/tau)/(s^2 + s/tau + L_b). A regressing lag mode, if there is
    one, is a pair of zeros and one of poles beside it, one at low frequency.

    Source: Heffley's hybrid form, as identified for the OH-58D.
    """
    tau, flap, lag = numbers["time_constant_s"], numbers["flap_1_s2"], numbers.get("lag")
    A = np.array([[0.0, flap], [-1.0, -1.0 / tau]])
    model = StateSpaceModel(A, np.array([0.0, 1.0 / tau]), np.array([0.0, flap]), 0.0)
    if lag is None:
        return model
    top, bottom = (
        [1.0 / w**2, 2.0 * lag[f"{part}_damping"] / w, 1.0]
        for part, w in ((part, 2.0 * math.pi * lag[f"{part}_hz"]) for part in ("zero", "pole"))
    )
    return series(transfer_function(top, bottom), model)


def chain_of(rotorcraft: Rotorcraft) -> StateSpaceModel | None:
    """What stands between lever and blades, delays apart: inflow lead, actuator, notch, low pass; None for nothing.

    An actuator is w/(s + w), or w^2/(s^2 + 2 zeta w s + w^2) where it has a damping ratio; so is the low pass. The
    inflow lead is (s + z)/z: the thrust overshoots before the inflow has followed. The notch is
    (s^2 + 2 zeta_z w s + w^2) over the same with zeta_p. Mistake for an inflow lead without an actuator: alone it
    would differentiate.
    """
    lead, actuator, notch = rotorcraft.inflow_lead_rad_s, rotorcraft.actuator, rotorcraft.notch
    numerator = np.ones(1) if lead is None else np.array([1.0 / lead, 1.0])
    if lead is not None and actuator is None:
        raise Mistake(
            "rotorcraft.inflow_lead_rad_s",
            lead,
            "differentiates; give rotorcraft.actuator as well, which no blade pitch is without",
        )
    models = []
    if actuator is not None:
        models.append(transfer_function(numerator.tolist(), _lag(actuator["corner_rad_s"], actuator.get("damping"))))
    if notch is not None:
        w = 2.0 * math.pi * notch["frequency_hz"]
        top, bottom = ([1.0 / w**2, 2.0 * notch[f"{part}_damping"] / w, 1.0] for part in ("zero", "pole"))
        models.append(transfer_function(top, bottom))
    low_pass = rotorcraft.low_pass
    if low_pass is not None:
        w = 2.0 * math.pi * low_pass["frequency_hz"]
        models.append(transfer_function([1.0], _lag(w, low_pass.get("damping"))))
    return reduce(series, models) if models else None


def _lag(corner_rad_s: float, damping: float | None) -> list[float]:
    """Denominator of a lag of gain 1, highest power first: of first order, or of second with a damping ratio."""
    w = corner_rad_s
    return [1.0 / w, 1.0] if damping is None else [1.0 / w**2, 2.0 * damping / w, 1.0]


@dataclass(frozen=True, eq=False)
class Chained:
    """A rotorcraft behind actuator, lead, notch and delay.

    Parameters
    ----------
    base : RotorcraftModel
        The rotorcraft itself.
    parts : StateSpaceModel or None
        In front of it.
    delay_s : float
        Pure delay [s]: exact in `response`, a rational all-pass in `state_space`.
    """

    base: RotorcraftModel
    parts: StateSpaceModel | None
    delay_s: float = 0.0

    @cached_property
    def state_space(self) -> StateSpaceModel:
        """Chain, then rotorcraft; the delay is rational, right to 1e-6 below 10 Hz."""
        whole = self.base.state_space if self.parts is None else series(self.parts, self.base.state_space)
        return series(self.delay_model, whole) if self.delay_model is not None else whole

    @cached_property
    def delay_model(self) -> StateSpaceModel | None:
        """The delay as a rational all-pass; None for none."""
        return pade_delay(self.delay_s) if self.delay_s else None

    @cached_property
    def partial_fractions(self) -> PartialFractions | None:
        """As a sum over the poles; None where they are (nearly) equal, or not known."""
        return None if measured_part(self) is not None else fractions_of(self.state_space)

    def response(self, omega: npt.ArrayLike) -> ComplexArray:
        """H(j omega) [m/s^2 per rad]."""
        w = np.asarray(omega, dtype=float)
        H = self.base.response(w) * np.exp(-1j * w * self.delay_s)
        return H if self.parts is None else H * self.parts.response(w)


def fractions_of(model: StateSpaceModel) -> PartialFractions | None:
    """A state space as a sum over its poles; None where two of them are (nearly) equal."""
    poles, residues = poles_and_residues(model.A, model.B, model.C)
    return None if residues is None else PartialFractions(poles, residues, model.D)


# ---- known by its frequency response


@dataclass(frozen=True, eq=False)
class MeasuredRotorcraft:
    """A rotorcraft that is known at frequencies only."""

    data: FrequencyResponse

    @property
    def state_space(self) -> StateSpaceModel:
        """There is none: PilotgenError."""
        raise PilotgenError(
            f"{self.data.path}: the rotorcraft is known by its frequency response only; it has no state space, and "
            "poles of the closed loop cannot be told"
        )

    @property
    def partial_fractions(self) -> PartialFractions | None:
        """None: its poles are not known."""
        return None

    def response(self, omega: npt.ArrayLike) -> ComplexArray:
        """H(j omega), omega in rad/s, any shape; PilotgenError outside the band of the data."""
        return self.data.at(omega)


def measured_part(model: RotorcraftModel) -> FrequencyResponse | None:
    """The data of a rotorcraft that is known by its frequency response; None of any other."""
    while isinstance(model, Chained):
        model = model.base
    return model.data if isinstance(model, MeasuredRotorcraft) else None


# ---- plants from files


@dataclass(frozen=True, eq=False)
class PlantFile:
    """A state space or transfer function: of a file, or of roll with flapping."""

    state_space: StateSpaceModel

    @cached_property
    def partial_fractions(self) -> PartialFractions | None:
        """As a sum over the poles."""
        return fractions_of(self.state_space)

    def response(self, omega: npt.ArrayLike) -> ComplexArray:
        """H(j omega) [m/s^2 per rad]."""
        return self.state_space.response(omega)


_STATED = ("input_unit", "input_positive", "input_control", "output_unit", "output_positive", "output_motion")


def read_plant(rotorcraft: Rotorcraft, motion: str = HEAVE, control: str = COLLECTIVE) -> PlantFile:
    """Read the file that a study names as `rotorcraft.state_space` or `rotorcraft.transfer_function`.

    The file is one that `pilotgen margins` reads (docs/io_formats/loop.md), as state space or transfer function, with
    the keys `input_unit` (rad, deg; of blade pitch), `output_unit` (m/s^2, g, ft/s^2) and `output_positive` (up, down),
    none of which has a default; of another loop than heave by the collective with more of them (`units.py`). Or it has
    named `inputs` and `outputs` (docs/io_formats/plant.md), of which the study's loop takes one each.

    Raises
    ------
    FileError
        The file cannot be read, is of another form, or says nothing of its units and sign.
    """
    from pilotgen.loop.loop_file import read_loop, read_values

    path = Path(rotorcraft.plant_file or "")
    values = read_values(path)
    if "inputs" in values or "outputs" in values:  # named signals, several of them perhaps
        return PlantFile(one_channel(plant_from(values, str(path)).called(str(path)), motion, control))
    said = {key: _text(values.get(key)) for key in _STATED}
    gain = stated_gain(said, motion, control, str(path), "a plant says it:")
    found = read_loop(path).loop  # checked whole, whatever its form
    if isinstance(found, StateSpaceModel):
        model = found
    elif "num" in values:
        model = transfer_function(*(np.ravel(values[key]).astype(float).tolist() for key in ("num", "den")))
    elif "zeros" in values:
        zeros, poles = ([complex(*np.ravel(r)) for r in values[key]] for key in ("zeros", "poles"))
        model = zeros_poles_gain(zeros, poles, float(np.ravel(values["gain"])[0]))
    else:
        raise FileError(
            f"{path}: frequency response data; rotorcraft.frequency_response takes them, as a CSV file "
            "(docs/io_formats/frequency_response.md)"
        )
    return PlantFile(model.scaled(gain) if gain != 1.0 else model)


def _text(given: Any) -> str | None:
    if isinstance(given, np.ndarray) and given.size == 1:  # text in a .mat file
        given = given.ravel()[0]
    return None if given is None else str(given)
