"""The pilot-vehicle loop: seat acceleration -> lever -> blade pitch -> seat acceleration.

    L(s) = -G0 l_phi H_BDFT(s) H_zddot/theta(s),   critical point -1   (docs/theory/loop.md)

Heave by the collective, or any other motion of the seat by any other control.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from pilotgen.errors import PilotgenError
from pilotgen.linear.partial_fractions import PartialFractions
from pilotgen.linear.pilot_model import PilotModel
from pilotgen.linear.statespace import ComplexArray, StateSpaceModel, series
from pilotgen.loop.rotorcraft_model import RotorcraftModel
from pilotgen.loop.units import COLLECTIVE, CONTROLS, HEAVE


@dataclass(frozen=True, eq=False)
class LoopModel:
    """One pilot closed with one rotorcraft.

    Parameters
    ----------
    pilot : StateSpaceModel
        BDFT with its washout: seat acceleration zddot [m/s^2, or rad/s^2] -> rotation phi of the control [rad].
    helicopter : RotorcraftModel
        Blade pitch theta [rad] -> zddot.
    gearing_rad_per_m : float
        G0, blade pitch per grip travel [rad/m].
    lever_length_m : float
        l_phi, hinge of the control to its grip [m]; theta = G0 l_phi phi.
    pilot_fractions : PartialFractions, optional
        The pilot once more, in a form that is quicker to evaluate.
    motion, control : str
        Which motion of the seat, and which control.
    output : int
        Which of the pilot model's outputs the control is.
    """

    pilot: StateSpaceModel
    helicopter: RotorcraftModel
    gearing_rad_per_m: float
    lever_length_m: float
    pilot_fractions: PartialFractions | None = None
    motion: str = HEAVE
    control: str = COLLECTIVE
    output: int = 0

    @property
    def gearing(self) -> float:
        """Blade pitch per lever rotation, G0 l_phi [rad/rad]."""
        return self.gearing_rad_per_m * self.lever_length_m

    @cached_property
    def open_loop(self) -> StateSpaceModel:
        """L(s), cut at the seat acceleration; states [pilot, helicopter]."""
        return series(self.pilot, self.helicopter.state_space).scaled(-self.gearing)

    @cached_property
    def partial_fractions(self) -> PartialFractions | None:
        """L(s) as a sum of partial fractions; None where poles are too close to each other for it."""
        pilot, helicopter = self.pilot_fractions, self.helicopter.partial_fractions
        if pilot is None or helicopter is None:
            return None
        both = pilot.times(helicopter)
        return both.scaled(-self.gearing) if both is not None and both.apart else None

    @cached_property
    def closed_loop_poles(self) -> ComplexArray:
        """Poles of the interconnected system [rad/s], by rising modulus.

        Raises
        ------
        PilotgenError
            The direct terms make the loop ill-posed, 1 + L(infinity) = 0.
        """
        return self.open_loop.feedback().poles

    def response(self, omega: npt.ArrayLike) -> ComplexArray:
        """L(j omega), dimensionless, omega in rad/s, any shape: the product of the two parts."""
        w = np.asarray(omega, dtype=float)
        return -self.gearing * self.pilot.response(w) * self.helicopter.response(w)


def pilot_loop(
    pilot: PilotModel,
    helicopter: RotorcraftModel,
    gearing_rad_per_m: float,
    control_length_m: float,
    motion: str = HEAVE,
    control: str = COLLECTIVE,
) -> LoopModel:
    """The loop of a pilot and a rotorcraft over one motion of the seat and one control.

    Parameters
    ----------
    pilot : PilotModel
        With that motion as his only input.
    helicopter : RotorcraftModel
        Of that motion by that control.
    gearing_rad_per_m, control_length_m : float
        Blade pitch per grip travel [rad/m]; hinge of the control to its grip [m].
    motion, control : str
        Names of `SEAT_MOTIONS` and `CONTROLS`.

    Raises
    ------
    PilotgenError
        The pilot has other inputs, or more: several loops are closed by `mimo.close`; or he does not hold the control.
    """
    name = CONTROLS[control][0]
    wanted = f"seat_{motion}_acceleration"
    if pilot.inputs != (wanted,) or name not in pilot.outputs:
        raise PilotgenError(
            f"a LoopModel closes one loop, {wanted} to {name}; this pilot has the inputs {', '.join(pilot.inputs)} and "
            f"the outputs {', '.join(pilot.outputs)}: close several loops with pilotgen.loop.mimo.close"
        )
    output = pilot.outputs.index(name)
    A, B, C, D = pilot.state_space([output])
    system = StateSpaceModel(A, B[:, 0], C[0], float(D[0, 0]))
    fractions = pilot.partial_fractions(output)
    return LoopModel(system, helicopter, gearing_rad_per_m, control_length_m, fractions, motion, control, output)


def heave_loop(
    pilot: PilotModel, helicopter: RotorcraftModel, gearing_rad_per_m: float, lever_length_m: float
) -> LoopModel:
    """The loop of heave by the collective; PilotgenError as `pilot_loop`."""
    return pilot_loop(pilot, helicopter, gearing_rad_per_m, lever_length_m)
