"""What the linear model lacks of the muscles: how their lengths follow the unknowns, and Hill's curves.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pilotgen.decks.parts import velocity_factor
from pilotgen.evaluation import SolvedPilot
from pilotgen.solver.descriptor import Floats
from pilotgen.solver.matrices import descriptor

F2_AT_REST = 1.6 - 1.6 * math.exp(0.1 - 1.1)


def f1(x: npt.ArrayLike) -> Floats:
    """Active force by relative length, any shape (the deck's muscle law, docs/theory/elements.md)."""
    u = np.asarray(x) - 0.95
    square = u * u
    return np.asarray(np.exp(square - 40.0 * square * square))


def f2(v: npt.ArrayLike) -> Floats:
    """Active force by relative velocity, any shape, lengthening positive."""
    w = np.minimum(np.asarray(v, dtype=float), 1.0 - 1e-9) - 1.0
    inverse = 1.0 / (w * w)
    return np.asarray(1.6 - 1.6 * np.exp(inverse * (0.1 - 1.1 * inverse)))


def f3(x: npt.ArrayLike) -> Floats:
    """Passive force by relative length, any shape."""
    return np.asarray(1.3 * np.arctan(0.1 * (np.asarray(x) - 0.22) ** 10))


@dataclass(frozen=True)
class MuscleData:
    """All muscles of a pilot in deck order, arrays of shape (muscles,).

    Attributes
    ----------
    F0_n, l0_m : ndarray
        Greatest force [N], optimal length [m].
    x : ndarray
        Relative lengths in the posture.
    activation : ndarray
        Activations in the posture.
    velocity_factor : float
        V0/L0 [1/s].
    """

    F0_n: Floats
    l0_m: Floats
    x: Floats
    activation: Floats
    velocity_factor: float


def muscle_data(pilot: SolvedPilot) -> MuscleData:
    """The muscles of a solved pilot."""
    assert pilot.matrices is not None
    muscles = [muscle for limb in pilot.body.limbs.values() for muscle in limb.muscles]
    l0 = np.array([muscle.l0_m for muscle in muscles])
    return MuscleData(
        np.array([muscle.F0_N for muscle in muscles]),
        l0,
        np.asarray(pilot.matrices.muscle_lengths) / l0,
        np.asarray(pilot.activations.values),
        velocity_factor(pilot.body),
    )


def muscle_rows(pilot: SolvedPilot) -> Floats:
    """How relative lengths follow the unknowns of the pilot's deck, shape (muscles, n) [1/m, 1/rad].

    By virtual work: what a muscle's activation does to the equilibrium of each coordinate is its force per activation
    times the length that it gains by the coordinate.
    """
    assert pilot.matrices is not None
    data = muscle_data(pilot)
    model = descriptor(pilot.matrices)
    names = [bytes(name).decode() for name in pilot.matrices.inputs.name]
    columns = [i for i, name in enumerate(names) if name.startswith("activation[")]
    per_activation = data.F0_n * f1(data.x) * F2_AT_REST
    rows = np.zeros((len(columns), pilot.matrices.n))
    forces = pilot.matrices.inputs.g_u[model.equilibrium_rows][:, columns]
    rows[:, model.coordinates] = (forces / (per_activation * data.l0_m)).T
    return rows
