"""Tell beforehand whether the real MBDyn gets through the two phases before its first step.

Initial assembly: unless the deck skips it, constraints that are open by more than its tolerance have to be closed by
it, and it has failed to close every open chain it was given. Derivatives: with positions and velocities as they are,
MBDyn iterates for accelerations and reactions with c_d = `derivatives coefficient` times `time step`; its constraint
rows are phi / c_d, which no iteration changes, so that a constraint open by a little leaves a residual above the
tolerance.
Both are emulated here with mbdae's matrices of the deck: `docs/io_formats/deck.md` has the equations.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pilotgen.errors import FileError, SolverError
from pilotgen.files import refuse_special
from pilotgen.solver.client import SolverClient
from pilotgen.solver.matrices import Matrices, read_matrices

ASSEMBLY_TOLERANCE = 1e-6  # MBDyn's default [m, rad]
DERIVATIVES_COEFFICIENT = 1e-6  # MBDyn's default
STALLED = 0.999  # an iteration that leaves more of the residual than this leaves it for good
_VIOLATED = re.compile(r"constraint \d+ of \d+ of joint (\S+) .*is violated by (\S+) (m|rad)")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")


@dataclass(frozen=True)
class PhaseCards:
    """The cards of a deck that govern the two phases.

    Attributes
    ----------
    time_step_s : float
        Of the deck [s].
    coefficient : float
        `derivatives coefficient`; c_d is its product with the time step.
    tolerance : float
        `derivatives tolerance` of the residual's 2-norm.
    iterations : int or None
        `derivatives max iterations`; None if the deck does not say.
    assembled : bool
        Whether there is an initial assembly (no `skip initial joint assembly`).
    assembly_tolerance : float
        Of the initial assembly [m, rad].
    """

    time_step_s: float
    coefficient: float
    tolerance: float
    iterations: int | None
    assembled: bool
    assembly_tolerance: float


@dataclass(frozen=True)
class Prediction:
    """What MBDyn will do with a deck.

    Attributes
    ----------
    deck : str
        The deck's path.
    assembly, derivatives : str
        One sentence on each phase.
    assembly_fails, derivatives_fail : bool
        Whether MBDyn ends there.
    residuals : tuple of float
        2-norm of MBDyn's residual before each iteration of the derivatives phase (empty when it is not reached).
    """

    deck: str
    assembly: str
    assembly_fails: bool
    derivatives: str = "not reached"
    derivatives_fail: bool = False
    residuals: tuple[float, ...] = ()

    @property
    def runs(self) -> bool:
        """Whether MBDyn gets through both phases."""
        return not (self.assembly_fails or self.derivatives_fail)


def check_mbdyn(deck: str | os.PathLike[str], client: SolverClient, timeout_s: float = 30.0) -> Prediction:
    """Predict how MBDyn's initial assembly and derivatives phase end on a deck.

    Parameters
    ----------
    deck : path
        The deck.
    client : SolverClient
        The solver that reads and linearises the deck.
    timeout_s : float
        Time limit of the solver [s].

    Raises
    ------
    FileError
        The deck cannot be read, or a card that governs the phases is missing or is not a plain number.
    SolverError
        The deck is wrong, or holds what mbdae does not read.
    """
    path = os.path.abspath(os.fspath(deck))
    cards = read_cards(path)
    with tempfile.TemporaryDirectory(prefix="pilotgen-check-") as directory:
        output = os.path.join(directory, "deck.h5")
        try:
            client.request("linearise", name=path, output=output, timeout_s=timeout_s, nodes=False)
        except SolverError as error:
            found = _VIOLATED.search(str(error))
            if found is None:
                raise
            return _open_chain(os.fspath(deck), cards, found[1], float(found[2]), found[3])
        matrices = read_matrices(output)
    return predict(os.fspath(deck), cards, matrices)


def predict(deck: str, cards: PhaseCards, matrices: Matrices) -> Prediction:
    """The prediction from mbdae's matrices of the deck at its initial state.

    Raises
    ------
    FileError
        The derivatives phase has to iterate, and the deck does not say how often it may.
    """
    reaction = matrices.kinds == b"reaction"
    phi = matrices.residual[reaction]
    worst = float(np.max(np.abs(phi), initial=0.0))
    assembly, fails = "skipped", False
    if cards.assembled:
        fails = worst > cards.assembly_tolerance
        if fails:
            name = matrices.dof_names[int(np.flatnonzero(reaction)[int(np.argmax(np.abs(phi)))])]
            assembly = _not_assembled(name.partition(".")[0], worst, "m or rad", cards)
        else:
            assembly = f"passes: constraints are open by {worst:.1e} at most, {cards.assembly_tolerance:g} is allowed"
    if fails:
        return Prediction(deck, assembly, True)
    residuals = derivatives_residuals(matrices, cards)
    c_d = cards.coefficient * cards.time_step_s
    if residuals[-1] <= cards.tolerance:
        told = (
            f"pass after {len(residuals) - 1} iterations, residual {residuals[-1]:.1e}, {cards.tolerance:g} is allowed"
        )
        return Prediction(deck, assembly, False, told, False, residuals)
    if cards.iterations is None:
        raise FileError(
            f"{deck}: no card 'derivatives max iterations' in it; what MBDyn does cannot be told without it"
        )
    told = (
        f"fail: the residual stays at {residuals[-1]:.1e}, {cards.tolerance:g} is allowed, with c_d = {c_d:g} s and "
        f"constraints open by {worst:.1e}; close them to round-off, or allow more"
    )
    return Prediction(deck, assembly, False, told, True, residuals)


_KEPT = (b"momentum", b"momenta_moment", b"velocity", b"angular_velocity", b"modal_displacement", b"modal_velocity")


def derivatives_residuals(matrices: Matrices, cards: PhaseCards) -> tuple[float, ...]:
    """2-norm of MBDyn's residual before each iteration of its derivatives phase.

    Newton's iteration on accelerations and reactions: after each one positions, orientations and velocities of nodes
    are put back; momenta, velocities of modal nodes and all that modal joints own keep c_d times their new rates.
    Holonomic constraint rows are phi / c_d.
    """
    c_d = cards.coefficient * cards.time_step_s
    g_ydot = 0.5 * (matrices.J_plus + matrices.J_minus)
    g_y = (matrices.J_plus - matrices.J_minus) / (2.0 * matrices.c)
    kinds = matrices.kinds
    reaction = kinds == b"reaction"
    keeps = np.isin(kinds, _KEPT)
    holonomic = reaction & ~(g_ydot[:, ~reaction] != 0.0).any(axis=1)
    J = g_ydot + c_d * g_y
    J[:, reaction] = g_y[:, reaction]
    J[holonomic] = g_y[holonomic]
    J[np.ix_(holonomic, reaction)] = 0.0
    start: NDArray[np.float64] = np.array(matrices.residual, dtype=float)
    start[holonomic] /= c_d
    moving = np.where((keeps | reaction)[None, :], g_y, 0.0)
    moving[holonomic] = np.where(kinds == b"modal_displacement", g_y[holonomic] / c_d, 0.0)
    rates, values = np.zeros(len(start)), np.zeros(len(start))
    norms: list[float] = []
    for _ in range((cards.iterations or 0) + 1):
        r = start + g_ydot @ rates + moving @ values
        r[holonomic] = start[holonomic] + moving[holonomic] @ values
        norms.append(float(np.sqrt(r @ r)))
        if norms[-1] <= cards.tolerance or (len(norms) > 2 and norms[-1] > STALLED * norms[-2]):
            break
        step = np.linalg.solve(J, -r)
        kept = np.where(keeps, step, 0.0)
        values += c_d * kept + np.where(reaction, step, 0.0)
        rates += kept
    return tuple(norms)


def _not_assembled(joint: str, gap: float, unit: str, cards: PhaseCards) -> str:
    return (
        f"fails: joint {joint} is open by {gap:.3g} {unit}, {cards.assembly_tolerance:g} is allowed; MBDyn's assembly "
        "does not close such chains: say `skip initial joint assembly;` in the control data, or close the joint"
    )


def _open_chain(deck: str, cards: PhaseCards, joint: str, gap: float, unit: str) -> Prediction:
    """Of a deck whose chain is too open to be linearised."""
    if cards.assembled:
        return Prediction(deck, _not_assembled(joint, gap, unit, cards), True)
    residual = gap / (cards.coefficient * cards.time_step_s)
    fails = residual > cards.tolerance
    told = f"joint {joint} is open by {gap:.3g} {unit}, a residual of {residual:.1e} at least"
    told = f"{'fail' if fails else 'pass'}: {told}, {cards.tolerance:g} is allowed"
    return Prediction(deck, "skipped", False, told, fails, (residual,))


# ---- the deck's cards ------------------------------------------------------------------------------------------------


def read_cards(path: str | os.PathLike[str]) -> PhaseCards:
    """The cards of a deck that govern the two phases; FileError when one is missing or is not a plain number."""
    refuse_special(path)
    try:
        text = Path(path).read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise FileError(f"{os.fspath(path)}: cannot be read: {error.strerror}") from None
    text = re.sub(r"/\*.*?\*/", " ", text, flags=re.DOTALL)
    text = re.sub(r"#[^\n]*", "", text)
    old = re.search(r"begin\s*:\s*multistep\s*;", text, re.IGNORECASE) is not None
    problem = _cards(_block(path, text, "multistep" if old else "initial value"))
    control = _cards(_block(path, text, "control data"))

    def number(name: str, cards: dict[str, str], default: float | None = None) -> float:
        if name not in cards:
            if default is not None:
                return default
            raise FileError(f"{os.fspath(path)}: no card '{name}' in it; what MBDyn does cannot be told without it")
        value = cards[name].partition(",")[0].strip()
        if not _NUMBER.fullmatch(value) or "auto" in cards[name]:
            raise FileError(f"{os.fspath(path)}: '{name}: {cards[name]}' is not a plain number; one is wanted here")
        return float(value)

    return PhaseCards(
        time_step_s=number("time step", problem),
        coefficient=number("derivatives coefficient", problem, DERIVATIVES_COEFFICIENT),
        tolerance=number("derivatives tolerance", problem),
        iterations=int(number("derivatives max iterations", problem))
        if "derivatives max iterations" in problem
        else None,
        assembled="skip initial joint assembly" not in control,
        assembly_tolerance=number("tolerance", control, ASSEMBLY_TOLERANCE),
    )


def _block(path: str | os.PathLike[str], text: str, name: str) -> str:
    words = r"\s+".join(name.split())
    found = re.search(rf"begin\s*:\s*{words}\s*;(.*?)end\s*:\s*{words}\s*;", text, re.DOTALL | re.IGNORECASE)
    if found is None:
        raise FileError(
            f"{os.fspath(path)}: no block '{name}' in it; an MBDyn deck of an initial value problem is wanted"
        )
    return found[1]


def _cards(block: str) -> dict[str, str]:
    cards = {}
    for card in block.split(";"):
        name, _, value = card.partition(":")
        cards[" ".join(name.lower().split())] = " ".join(value.split())
    return cards
