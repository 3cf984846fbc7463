"""Poles of the closed deck beside those of the margins: a second witness that shares no code with the first.

The margins' poles come from the pilot's feedthrough (modes of his free part, driven by an imposed motion) in series
with the rotorcraft's state space. Here one deck holds both, the seat free to move, and the eigenvalues are those of its
matrix pair. Two-way loops have no margins; each eigenvalue is tried in the characteristic matrix of the open deck.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from pilotgen.closed_loop.deck import SEAT_REACTION, ClosedLoop
from pilotgen.context import EvaluationContext
from pilotgen.errors import EvaluationError, StudyError
from pilotgen.evaluation import feedthrough_of
from pilotgen.loop.heave_model import HeaveModel
from pilotgen.loop.loop import heave_loop
from pilotgen.loop.margins import margins
from pilotgen.loop.rotorcraft_model import Chained, RotorcraftModel, measured_part, rotorcraft_model
from pilotgen.solver.descriptor import Complexes
from pilotgen.solver.matrices import Matrices
from pilotgen.study.study import Study

CERTIFIED = 1e-8  # relative difference of poles that the two ways may have
_FAR = 1e6  # rad/s; beyond are the infinite eigenvalues of constraints
_SMALL = 1e-4  # rad/s; below are the height's


@dataclass(frozen=True)
class PoleTable:
    """Poles of a closed loop by two ways.

    Attributes
    ----------
    reference : ndarray of complex, shape (n,)
        From the margins' loop; two-way: where Newton's method on the characteristic equation goes from `deck` [rad/s].
    deck : ndarray of complex, shape (n,)
        Eigenvalues of the deck, in the same order.
    difference : ndarray, shape (n,)
        Between them, relative.
    left : ndarray of complex
        Eigenvalues of the deck that belong to none: the height's zero, once or twice.
    stable : bool
        By the deck's eigenvalues.
    margins_stable : bool or None
        By the margins; None for two-way loops and where they cannot tell.
    unstable_open : int
        Poles of the open loop with a positive real part.
    """

    reference: Complexes
    deck: Complexes
    difference: np.ndarray
    left: Complexes
    stable: bool
    margins_stable: bool | None
    unstable_open: int

    @property
    def certified(self) -> bool:
        """Whether all poles agree, none is missing, and the verdicts are the same."""
        agree = bool(self.difference.max(initial=0.0) <= CERTIFIED)
        return agree and not len(self.left) and self.margins_stable in (None, self.stable)

    def as_list(self) -> list[dict[str, float]]:
        """One entry per pair or real pole, for JSON."""
        return [
            {
                "real_rad_s": float(pole.real),
                "imag_rad_s": float(pole.imag),
                "frequency_hz": float(abs(pole) / (2.0 * math.pi)),
                "damping": float(-pole.real / abs(pole)),
                "reference_real_rad_s": float(other.real),
                "reference_imag_rad_s": float(abs(other.imag)),
                "relative_difference": float(difference),
            }
            for pole, other, difference in sorted(
                zip(self.deck, self.reference, self.difference, strict=True), key=lambda row: -row[0].real
            )
            if pole.imag >= 0.0
        ]


def eigenvalues(matrices: Matrices) -> Complexes:
    """Finite eigenvalues of a deck's matrix pair [rad/s], unsorted, shape (k,).

    J(-c) v = Lambda J(c) v has the infinite ones at -1, where they cannot be mistaken for anything else.
    """
    Lambda = np.linalg.eigvals(np.linalg.solve(matrices.J_plus, matrices.J_minus)).astype(complex)
    with np.errstate(divide="ignore", invalid="ignore"):
        lam = (Lambda - 1.0) / (Lambda + 1.0) / matrices.c
    return np.asarray(lam[np.isfinite(lam) & (np.abs(lam) < _FAR)])


def why_unstable(helicopter: RotorcraftModel) -> str | None:
    """`a pole at +0.3 1/s, 0.05 Hz`, or how many such its file says it has; None of a rotorcraft that is stable."""
    data = measured_part(helicopter)
    if data is not None:
        return f"{data.path} says unstable_poles: {data.unstable_poles}" if data.unstable_poles else None
    return _growing(helicopter.state_space.poles)


def refuse_unstable_rotorcraft(study: Study, so: str) -> None:
    """Refuse an unstable rotorcraft before any pilot is solved, saying `so`, what that makes impossible; StudyError.

    Pilots who are unstable by themselves: `check_open_loop`.
    """
    why = why_unstable(rotorcraft_model(study.rotorcraft, study.loop.input, study.loop.output))
    if why is not None:
        raise StudyError(f"{study.path or study.name}: the rotorcraft is unstable by itself: {why}; {so}")


def open_loop_note(loop: ClosedLoop) -> str | None:
    """One sentence if the loop is unstable even when it is cut; None if it is not."""
    assert loop.pilot.matrices is not None
    parts = {"pilot": _growing(eigenvalues(loop.pilot.matrices)), "rotorcraft": why_unstable(loop.helicopter)}
    for part, why in parts.items():
        if why is not None:
            return (
                f"the open loop is unstable: the {part} has {why}; motions grow without any pilot-rotorcraft coupling, "
                "and Nyquist curves must go round -1 once for each such pole"
            )
    return None


def check_open_loop(loop: ClosedLoop, so: str) -> None:
    """Refuse a loop that is unstable even when it is cut, saying `so`, what that makes impossible; StudyError."""
    note = open_loop_note(loop)
    if note is not None:
        name = loop.study.path or loop.study.name
        raise StudyError(f"{name}: {note.partition(';')[0]}; {so}")


def _growing(poles: Complexes) -> str | None:
    worst = complex(poles[int(np.argmax(poles.real))]) if len(poles) else 0j
    if worst.real <= _SMALL:
        return None
    return f"a pole at {worst.real:+.3g} 1/s, {abs(worst.imag) / (2.0 * math.pi):.3g} Hz"


def compare_poles(context: EvaluationContext, loop: ClosedLoop, where: Path, text: str | None = None) -> PoleTable:
    """Linearise the deck of a loop and hold its poles against the margins'.

    Parameters
    ----------
    context : EvaluationContext
        Whose solver works.
    loop : ClosedLoop
        The loop.
    where : Path
        Gets `loop.mbd` and `loop.h5`.
    text : str, optional
        The deck; without friction, which has no poles that mean anything.

    Raises
    ------
    EvaluationError
        The deck lacks poles that the margins' loop has.
    """
    lam = eigenvalues(loop.linearise(context, text if text is not None else loop.deck(), where))
    model, _ = feedthrough_of(loop.pilot)
    inceptor = loop.study.inceptor
    margins_loop = heave_loop(model, loop.helicopter, inceptor.gearing_rad_per_m, inceptor.lever_length_m)
    verdict = margins(margins_loop)
    expected = margins_loop.closed_loop_poles
    if len(lam) < len(expected):
        raise EvaluationError("loop", f"the closed deck has {len(lam)} eigenvalues where {len(expected)} were expected")
    cost = np.abs(lam[None, :] - expected[:, None]) / np.maximum(np.abs(expected), 1e-6)[:, None]
    rows, columns = linear_sum_assignment(np.minimum(cost, 1e3))
    deck, rest = lam[columns], np.delete(lam, columns)
    reference = expected[rows]
    if loop.two_way:
        reference = np.array([_corrected(loop, pole) for pole in deck])
    difference = np.abs(deck - reference) / np.abs(reference)
    own = np.concatenate((deck, rest[np.abs(rest) > _SMALL]))
    return PoleTable(
        reference,
        deck,
        difference,
        rest[np.abs(rest) > _SMALL],
        bool(own.real.max() < 0.0),
        None if loop.two_way or verdict.not_told else verdict.stable,
        int(np.count_nonzero(margins_loop.open_loop.poles.real > 0.0)),
    )


def _corrected(loop: ClosedLoop, pole: complex) -> complex:
    """One step of Newton's method from a pole, on the characteristic matrix of the two-way loop.

    The matrix is singular at the loop's poles, hidden ones too: s - u* K v / u* K' v with its last singular vectors.
    """
    step = 1e-4 * max(abs(pole), 1.0)
    K = characteristic_matrix(loop, pole)
    slope = (characteristic_matrix(loop, pole + step) - characteristic_matrix(loop, pole - step)) / (2.0 * step)
    scale = np.abs(K).max(axis=1)
    U, _, Vh = np.linalg.svd(K / scale[:, None])
    left, right = (U[:, -1].conj() / scale), Vh[-1].conj()
    return complex(pole - (left @ K @ right) / (left @ slope @ right))


def characteristic_matrix(loop: ClosedLoop, s: complex) -> Complexes:
    """The pilot's open deck at a complex s [rad/s], bordered by the height of the seat and s z = zdot.

    The pilot's rows are those of his own deck, whose seat is driven; the rotorcraft enters by its transfer functions
    from blade pitch and from force. The shape is (n + 1, n + 1).
    """
    matrices = loop.pilot.matrices
    assert matrices is not None
    g_ydot = 0.5 * (matrices.J_plus + matrices.J_minus)
    g_y = (matrices.J_plus - matrices.J_minus) / (2.0 * matrices.c)
    drive = [bytes(name).decode() for name in matrices.inputs.name].index("drive[seat_pin.position[2]]")
    pitch: complex = loop.study.inceptor.gearing_rad_per_m * loop.lever_length_m
    corner = loop.study.pilot.washout_rad_s
    if corner is not None:
        pitch *= (s / (s + corner)) ** 2
    base = loop.helicopter
    if isinstance(base, Chained):
        for block in (base.delay_model, base.parts):
            pitch *= 1.0 if block is None else complex(block.at(s))
        base = base.base
    assert isinstance(base, HeaveModel)
    system = base.state_space
    by_pitch, by_force = np.linalg.solve(
        s * np.eye(system.n_states) - system.A, np.column_stack((system.B, base.force_input)).astype(complex)
    )[0]
    n = matrices.n
    K = np.zeros((n + 1, n + 1), dtype=complex)
    K[:n, :n] = s * g_ydot + g_y
    K[:n, n] = matrices.inputs.g_u[:, drive]
    K[n, matrices.dof_names.index("lever.gz")] = -by_pitch * pitch
    K[n, n] = s
    if loop.two_way:
        K[n, matrices.dof_names.index(SEAT_REACTION)] = -by_force
        K[n, n] -= by_force * loop.reaction.mass_kg * s**2
    return K


def table_text(table: PoleTable, two_way: bool, most: int = 12, below_hz: float = 10.0) -> str:
    """The poles nearest to instability, as text."""
    poles = table.as_list()
    shown = [row for row in poles if row["frequency_hz"] < below_hz][:most]
    against = "characteristic matrix" if two_way else "margins' loop"
    lines = [f"{'pole of loop.mbd [rad/s]':<30} {'Hz':>8} {'damping':>8}   relative difference to the {against}"]
    for row in shown:
        text = f"{row['real_rad_s']:.6f}" + (f" +- {row['imag_rad_s']:.6f}i" if row["imag_rad_s"] else "")
        lines.append(f"{text:<30} {row['frequency_hz']:8.4f} {row['damping']:8.4f}   {row['relative_difference']:.1e}")
    if len(poles) > len(shown):
        lines.append(f"{len(poles) - len(shown)} others are in loop.json")
    return "\n".join(lines)


def summary(table: PoleTable) -> dict[str, Any]:
    """For JSON."""
    return {
        "stable": table.stable,
        "margins_stable": table.margins_stable,
        "certified": table.certified,
        "largest_relative_difference": float(table.difference.max(initial=0.0)),
        "limit": CERTIFIED,
        "unstable_open_loop_poles": table.unstable_open,
        "poles_without_counterpart": [[float(p.real), float(p.imag)] for p in table.left],
        "poles": table.as_list(),
    }
