"""A rotorcraft as rows of a linear network for a deck: travel of the grip in, height of the seat out.

    GRIP_TRAVEL -> washout -> gearing -> delay -> actuator, lead, notch -> heave and coning, or plant -> HEIGHT

Each block is a state space; each of its states, and each signal between blocks, is an abstract node with one row
(docs/theory/closed_loop.md).

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pilotgen.decks.vehicle import PEDESTAL, SEAT_FORCE, TRAVEL, NetworkRow, Term
from pilotgen.errors import PilotgenError
from pilotgen.linear.statespace import FloatArray, StateSpaceModel
from pilotgen.loop.heave_model import HeaveModel
from pilotgen.loop.rotorcraft_model import Chained, PlantFile, RotorcraftModel

PITCH, CLIMB = "BLADE_PITCH", "CLIMB_RATE"
HEAVE_STATES = (CLIMB, "CONING", "CONING_RATE", "SLING_STRETCH", "SLING_RATE")


@dataclass(frozen=True)
class Network:
    """A rotorcraft's rows by kind of part (`pilotgen.decks.vehicle.PARTS`).

    Attributes
    ----------
    parts : dict
        Rows.
    gust : tuple of (node, float)
        What 1 m/s of rising air adds to rows; empty where the model does not say.
    states : int
        How many eigenvalues the rows have without the pilot, the height's among them.
    """

    parts: dict[str, tuple[NetworkRow, ...]]
    gust: tuple[tuple[str, float], ...]
    states: int


@dataclass(frozen=True)
class Reaction:
    """What the pilot does to the rotorcraft: his weight on the seat [N] and the mass that it belongs to [kg]."""

    weight_n: float
    mass_kg: float


def network(
    helicopter: RotorcraftModel,
    gearing_rad_per_m: float,
    washout_rad_s: float | None,
    reaction: Reaction | None = None,
) -> Network:
    """Rows of a rotorcraft.

    Parameters
    ----------
    helicopter : RotorcraftModel
        Heave model or plant from a file, with or without a chain before it.
    gearing_rad_per_m : float
        Blade pitch per grip travel [rad/m].
    washout_rad_s : float or None
        Corner of the pilot's washout [rad/s].
    reaction : Reaction, optional
        Two-way: the force on the seat beyond the weight acts on the rotorcraft, whose mass has the pilot in it.

    Raises
    ------
    PilotgenError
        Dynamics that no deck can hold (a frequency response), or that say nothing of forces on the seat (two-way).
    """
    base, parts, delay = helicopter, None, None
    if isinstance(helicopter, Chained):
        base, parts, delay = helicopter.base, helicopter.parts, helicopter.delay_model
    if not isinstance(base, HeaveModel | PlantFile):
        raise PilotgenError(
            "a rotorcraft given by its frequency response has no equations for a deck; give rotorcraft.state_space, "
            "rotorcraft.transfer_function or the numbers of the heave model"
        )
    rows: dict[str, tuple[NetworkRow, ...]] = {}
    signal = [Term(TRAVEL, gearing_rad_per_m)]
    states = 1  # the height
    if washout_rad_s is not None:
        w = washout_rad_s
        rows["trim"] = (
            NetworkRow("TRIM_1", (Term("TRIM_1", -1.0, True), Term(TRAVEL, w), Term("TRIM_1", -w))),
            NetworkRow("TRIM_2", (Term("TRIM_2", -1.0, True), Term(TRAVEL, w), Term("TRIM_1", -w), Term("TRIM_2", -w))),
        )
        signal += [Term("TRIM_1", -gearing_rad_per_m), Term("TRIM_2", -gearing_rad_per_m)]
        states += 2
    rows["pitch"] = (NetworkRow(PITCH, (Term(PITCH, -1.0), *signal)),)
    at = PITCH
    for kind, block in (("delay", delay), ("chain", parts)):
        if block is not None:
            rows[kind] = _block(block, kind.upper(), at)
            at, states = f"{kind.upper()}_OUT", states + block.n_states
    gust: tuple[tuple[str, float], ...] = ()
    if isinstance(base, HeaveModel):
        rows["rotorcraft"] = _heave(base, at, reaction)
        gust = tuple(zip(HEAVE_STATES, base.gust_input.tolist(), strict=False))
        states += base.state_space.n_states
    else:
        if reaction is not None:
            raise PilotgenError(
                "rotorcraft: a file of blade pitch to acceleration does not say what a force on the seat does; "
                "leave --two-way out, or give the numbers of the heave model"
            )
        rows["plant"] = _plant(base.state_space, at)
        states += base.state_space.n_states + 1
    return Network(rows, tuple((node, value) for node, value in gust if value), states)


def _states(A: FloatArray, B: FloatArray, names: list[str], at: str) -> list[NetworkRow]:
    """x' = A x + B u; A (n, n), B (n,)."""
    found = []
    for i, name in enumerate(names):
        terms = [Term(name, -1.0, True)]
        terms += [Term(names[j], float(A[i, j])) for j in np.flatnonzero(A[i])]
        terms += [Term(at, float(B[i]))] if B[i] else []
        found.append(NetworkRow(name, tuple(terms)))
    return found


def _outputs(model: StateSpaceModel, names: list[str], at: str) -> list[Term]:
    """y = C x + D u."""
    terms = [Term(names[j], float(model.C[j])) for j in np.flatnonzero(model.C)]
    return terms + ([Term(at, model.D)] if model.D else [])


def _block(model: StateSpaceModel, name: str, at: str) -> tuple[NetworkRow, ...]:
    names = [f"{name}_{i + 1}" for i in range(model.n_states)]
    out = f"{name}_OUT"
    rows = _states(model.A, model.B, names, at)
    return (*rows, NetworkRow(out, (Term(out, -1.0), *_outputs(model, names, at))))


def _height() -> NetworkRow:
    return NetworkRow(PEDESTAL, (Term(PEDESTAL, -1.0, True), Term(CLIMB, 1.0)))


def _heave(model: HeaveModel, at: str, reaction: Reaction | None) -> tuple[NetworkRow, ...]:
    system = model.state_space
    names = list(HEAVE_STATES[: system.n_states])
    rows = _states(system.A, system.B, names, at)
    if reaction is not None:
        # the vehicle's mass has the pilot in it: it feels his weight less what he needs beside his own acceleration
        for i, per_newton in enumerate(model.force_input.tolist()):
            if per_newton:
                more = (Term(SEAT_FORCE, -per_newton), Term(CLIMB, per_newton * reaction.mass_kg, True))
                rows[i] = NetworkRow(rows[i].node, (*rows[i].terms, *more), per_newton * reaction.weight_n)
    return (_height(), *rows)


def _plant(model: StateSpaceModel, at: str) -> tuple[NetworkRow, ...]:
    names = [f"PLANT_{i + 1}" for i in range(model.n_states)]
    climb = NetworkRow(CLIMB, (Term(CLIMB, -1.0, True), *_outputs(model, names, at)))
    return (_height(), climb, *_states(model.A, model.B, names, at))
