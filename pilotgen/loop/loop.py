"""The pilot-vehicle loop: seat acceleration -> lever -> blade pitch -> seat acceleration.

    L(s) = -G0 l_phi H_BDFT(s) H_zddot/theta(s),   critical point -1   (docs/theory/loop.md)

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from pilotgen.errors import PilotgenError
from pilotgen.linear.partial_fractions import PartialFractions
from pilotgen.linear.pilot_model import INPUT_NAME, PilotModel
from pilotgen.linear.statespace import ComplexArray, StateSpaceModel, series
from pilotgen.loop.rotorcraft_model import RotorcraftModel


@dataclass(frozen=True, eq=False)
class LoopModel:
    """One pilot closed with one rotorcraft.

    Parameters
    ----------
    pilot : StateSpaceModel
        BDFT with its washout: seat acceleration zddot [m/s^2] -> lever rotation phi [rad].
    helicopter : RotorcraftModel
        Blade pitch theta [rad] -> zddot [m/s^2].
    gearing_rad_per_m : float
        G0, blade pitch per grip travel [rad/m].
    lever_length_m : float
        l_phi, hinge to grip [m]; theta = G0 l_phi phi.
    pilot_fractions : PartialFractions, optional
        The pilot once more, in a form that is quicker to evaluate.
    """

    pilot: StateSpaceModel
    helicopter: RotorcraftModel
    gearing_rad_per_m: float
    lever_length_m: float
    pilot_fractions: PartialFractions | None = None

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


def heave_loop(
    pilot: PilotModel, helicopter: RotorcraftModel, gearing_rad_per_m: float, lever_length_m: float
) -> LoopModel:
    """The loop of a pilot's heave model and a rotorcraft.

    Raises
    ------
    PilotgenError
        The pilot has other inputs than heave, or more: several loops are closed by `mimo.close`.
    """
    if pilot.inputs != (INPUT_NAME,):
        raise PilotgenError(
            f"a LoopModel closes one loop, {INPUT_NAME} to {pilot.outputs[0]}; this pilot has the inputs "
            f"{', '.join(pilot.inputs)}: close several loops with pilotgen.loop.mimo.close"
        )
    A, B, C, D = pilot.state_space()
    system = StateSpaceModel(A, B[:, 0], C[0], float(D[0, 0]))
    return LoopModel(system, helicopter, gearing_rad_per_m, lever_length_m, pilot.partial_fractions())
