"""Limit cycles of one pilot in his loop: growth by amplitude, stable and unstable cycles, Nyquist curves, onset maps.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pilotgen.closed_loop.deck import ClosedLoop, with_gearing
from pilotgen.closed_loop.harmonic import HarmonicBalance
from pilotgen.closed_loop.refine import limit_cycles
from pilotgen.closed_loop.swing import LimitCycle, Swing
from pilotgen.closed_loop.swing_model import SwingModel, channels
from pilotgen.closed_loop.threshold import Threshold, threshold
from pilotgen.context import EvaluationContext
from pilotgen.decks.vehicle import Friction
from pilotgen.solver.descriptor import Complexes, Floats

AMPLITUDES = 10  # of a sweep, below the stops
SMALLEST_M = 1e-3  # amplitude at the grip that a sweep begins with
AT_STOPS = (0.8, 0.88, 0.96, 1.0, 1.02, 1.04, 1.06, 1.08, 1.12)  # amplitudes over half the travel between the stops
SWEEP_HARMONICS = 2  # clipped muscles have a second one, which moves growth
HARMONICS = 9  # of limit cycles
MAP_HARMONICS = 3  # of the cycles in a map
MAP_BISECTIONS = 4  # of a kick in a map: its size is known to 4 %
NYQUIST_HZ = (1.5, 8.0, 70)  # from, to, points


@dataclass(frozen=True, eq=False)
class Balanced:
    """A loop, its balance, and what the balance found.

    Attributes
    ----------
    loop : ClosedLoop
        The loop.
    friction : Friction or None
        Of its lever.
    balance : HarmonicBalance
        With that friction.
    swings : list of Swing
        By rising amplitude.
    cycles : list of LimitCycle
        Where growth changes its sign.
    lost : str
        Which swings could not be followed; empty for none.
    """

    loop: ClosedLoop
    friction: Friction | None
    balance: HarmonicBalance
    swings: list[Swing]
    cycles: list[LimitCycle]
    lost: str = ""

    @property
    def onset(self) -> LimitCycle | None:
        """The smallest unstable cycle: swings below die, swings above grow."""
        return next((cycle for cycle in self.cycles if not cycle.stable), None)


def balanced(
    model: SwingModel, friction: Friction | None, harmonics: int = HARMONICS, amplitudes: int = AMPLITUDES
) -> Balanced:
    """Growth by amplitude and limit cycles of a loop with some friction.

    Raises
    ------
    EvaluationError
        No swing could be balanced.
    """
    balance = HarmonicBalance(model, friction, SWEEP_HARMONICS)
    low, high = model.loop.travel_to_stops_m()
    at_stops = 0.5 * (high - low) * np.array(AT_STOPS)
    swings, lost = balance.sweep(np.concatenate((np.geomspace(SMALLEST_M, 0.85 * at_stops[0], amplitudes), at_stops)))
    cycles = limit_cycles(balance.with_harmonics(harmonics), swings, float(at_stops[-1]))
    return Balanced(model.loop, friction, balance, swings, cycles, lost)


# ---- Nyquist curves that depend on the amplitude ---------------------------------------------------------------------


def nyquist(found: Balanced, swing: Swing | None, frequency_hz: Floats) -> Complexes:
    """L(j omega) of the loop with every element as stiff and damping as it is in a swing; None: the linear loop.

    `frequency_hz` has shape (n,), the result too. At a limit cycle's swing the curve passes -1 at its frequency.
    """
    loop = found.loop
    matrices = loop.pilot.matrices
    assert matrices is not None
    g_ydot = 0.5 * (matrices.J_plus + matrices.J_minus)
    g_y = ((matrices.J_plus - matrices.J_minus) / (2.0 * matrices.c)).astype(complex)
    lever = matrices.dof_names.index("lever.gz")
    per_turn: complex = loop.lever_length_m
    if swing is not None:
        more, per_turn = _in_a_swing(found, swing)
        g_y += more
    drive = [bytes(name).decode() for name in matrices.inputs.name].index("drive[seat_pin.position[2]]")
    corner = loop.study.pilot.washout_rad_s
    L = np.zeros(len(frequency_hz), dtype=complex)
    for i, omega in enumerate((2.0 * math.pi * frequency_hz).tolist()):
        s = 1j * omega
        y = np.linalg.solve(s * g_ydot + g_y, -matrices.inputs.g_u[:, drive].astype(complex))
        travel = y[lever] * per_turn / s**2 * ((s / (s + corner)) ** 2 if corner is not None else 1.0)
        L[i] = -loop.study.inceptor.gearing_rad_per_m * travel * complex(loop.helicopter.response(omega))
    return L


def _in_a_swing(found: Balanced, swing: Swing) -> tuple[Complexes, complex]:
    """What g_y of the open deck has more in a swing, (n, n), and first harmonics of travel over lever rotation [m].

    What the linear deck lacks is what is left of its equations along the swing's first harmonic. Muscles and friction
    have their part of it by their own motions, the rest (geometry, stops) goes with the grip's.
    """
    balance = found.balance.with_harmonics(swing.harmonics)
    model, Y, s = balance.model, swing.unknowns, swing.pole
    names = {name: i for i, name in enumerate(model.matrices.dof_names)}
    own = found.loop.pilot.matrices
    assert own is not None
    lacking = -(s * model.g_ydot + model.g_y) @ Y[:, 1]
    B, C = channels(found.loop, own)  # B has the sign of a motion, not of a residual
    forces = balance.element_forces(Y, s)[:, 1]
    motions = model.C @ Y[:, 1]
    more = -B @ ((forces / motions)[:, None] * C)
    lacking = lacking + model.B @ forces
    rows = np.array([names.get(name, -1) for name in own.dof_names])
    rest = np.where(rows >= 0, lacking[rows], 0.0)
    more += np.outer(rest / motions[0], C[0])
    return more, complex(Y[names["grip_travel.x"], 1] / Y[model.lever, 1])


# ---- onset over friction and gearing ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class OnsetMap:
    """The smallest swing of the grip that grows.

    Attributes
    ----------
    frictions_n, gearings_rad_per_m : tuple of float
        Breakout forces [N] and gearings [rad/m].
    swing_mm : ndarray, shape (gearings, frictions)
        [mm]; 0: every swing grows, infinite: every swing within the stops dies.
    kick_n : ndarray, shape (gearings, frictions), or None
        The smallest kick at the lever that goes on, by integration of the deck [N]; 0 and infinite as above, and
        infinite where no kick that was tried goes on.
    """

    frictions_n: tuple[float, ...]
    gearings_rad_per_m: tuple[float, ...]
    swing_mm: Floats
    kick_n: Floats | None = None


def onset_map(
    context: EvaluationContext,
    loop: ClosedLoop,
    friction: Friction,
    frictions_n: Sequence[float],
    gearings_rad_per_m: Sequence[float],
    kicks: bool = False,
    tell: Callable[[int, int], None] | None = None,
) -> OnsetMap:
    """The smallest swing that grows, over breakout force and gearing; everything else of `friction` in proportion.

    With `kicks` the smallest kick as well, by some ten motions of the deck for every cell that has an unstable cycle.

    Raises
    ------
    EvaluationError
        As `balanced`, or a deck cannot be linearised.
    """
    found = np.full((len(gearings_rad_per_m), len(frictions_n)), math.inf)
    kick = np.full(found.shape, math.inf)
    for i, gearing in enumerate(gearings_rad_per_m):
        geared = with_gearing(loop, gearing)
        model = SwingModel(context, geared)
        bare = balanced(model, None, MAP_HARMONICS)
        for j, force in enumerate(frictions_n):
            with_friction = None if force == 0.0 else scaled(friction, force)
            cell = bare if with_friction is None else balanced(model, with_friction, MAP_HARMONICS)
            if cell.swings[0].growth_rad_s > 0.0:
                found[i, j] = kick[i, j] = 0.0
            elif cell.onset is not None:
                found[i, j] = 1e3 * cell.onset.swing.amplitude_m
            if kicks and 0.0 < found[i, j] < math.inf:
                between = threshold(context, geared, with_friction, steps=MAP_BISECTIONS)
                kick[i, j] = math.inf if between is None else between.size_n
            if tell is not None:
                tell(i * len(frictions_n) + j + 1, found.size)
    return OnsetMap(tuple(frictions_n), tuple(gearings_rad_per_m), found, kick if kicks else None)


def scaled(friction: Friction, breakout_n: float) -> Friction:
    """The same friction with another breakout force [N]; sliding and viscous parts in proportion."""
    share = breakout_n / friction.breakout_n
    return dataclasses.replace(
        friction,
        breakout_n=breakout_n,
        sliding_n=share * friction.sliding_n,
        viscous_n_s_per_m=share * friction.viscous_n_s_per_m,
    )


# ---- told ------------------------------------------------------------------------------------------------------------


def as_dict(found: Balanced, threshold: Threshold | None, grid: OnsetMap | None) -> dict[str, Any]:
    """The content of limit_cycles.json (docs/io_formats/closed_loop.md)."""
    lam = found.balance.model.poles
    swinging = lam[(lam.imag > 2.0 * math.pi) & (lam.imag < 20.0 * math.pi)]
    worst = swinging[int(np.argmax(swinging.real))] if len(swinging) else complex(math.nan, math.nan)
    content: dict[str, Any] = {
        "friction": None if found.friction is None else dataclasses.asdict(found.friction),
        "linear_pole": [float(worst.real), float(worst.imag)],
        "not_followed": found.lost or None,
        "growth": [
            {
                "amplitude_mm": 1e3 * swing.amplitude_m,
                "growth_rad_s": swing.growth_rad_s,
                "frequency_hz": swing.frequency_hz,
                "mean_mm": 1e3 * swing.mean_m,
            }
            for swing in found.swings
        ],
        "limit_cycles": [
            {
                "stable": cycle.stable,
                "harmonics": cycle.swing.harmonics,
                "trouble": cycle.trouble or None,
                "amplitude_mm": 1e3 * cycle.swing.amplitude_m,
                "swing_mm": 1e3 * cycle.swing.swing_m,
                "frequency_hz": cycle.swing.frequency_hz,
                "mean_mm": 1e3 * cycle.swing.mean_m,
            }
            for cycle in found.cycles
        ],
        "by_integration": None,
        "map": None,
    }
    if threshold is not None:
        content["by_integration"] = {
            "largest_kick_that_dies_n": threshold.dies_n,
            "smallest_kick_that_goes_on_n": threshold.goes_on_n,
            "swing_mm": 1e3 * threshold.swing_m if math.isfinite(threshold.swing_m) else None,
            "frequency_hz": threshold.frequency_hz if math.isfinite(threshold.frequency_hz) else None,
        }
    if grid is not None:
        content["map"] = {
            "friction_n": list(grid.frictions_n),
            "gearing_rad_per_m": list(grid.gearings_rad_per_m),
            "smallest_swing_that_grows_mm": _cells(grid.swing_mm),
            "smallest_kick_that_goes_on_n": None if grid.kick_n is None else _cells(grid.kick_n),
        }
    return content


def _cells(values: Floats) -> list[list[float | None]]:
    """Rows of a map for JSON: null where nothing grows."""
    return [[None if math.isinf(value) else value for value in row] for row in values.tolist()]


def report_text(content: dict[str, Any]) -> str:
    """Cycles, threshold and map, for a person."""
    friction = content["friction"]
    words = f"{friction['breakout_n']:g} N at the grip ({friction['model']})" if friction else "none"
    pole = content["linear_pole"]
    lines = [
        f"friction   {words}",
        f"linear     {pole[0]:+.3f} 1/s at {pole[1] / (2.0 * math.pi):.3f} Hz, without friction and clipping",
    ]
    for cycle in content["limit_cycles"]:
        kind = "stable    " if cycle["stable"] else "unstable  "
        lines.append(
            f"{kind} limit cycle: {cycle['swing_mm']:.3g} mm of grip motion at {cycle['frequency_hz']:.3f} Hz, mean "
            f"{cycle['mean_mm']:+.2g} mm" + ("" if cycle["stable"] else "; smaller swings die, larger ones grow")
        )
        if cycle["trouble"]:
            lines.append(f"           {cycle['trouble']}")
    if content["not_followed"]:
        lines.append(f"note       {content['not_followed']}")
    if not content["limit_cycles"]:
        rates = [row["growth_rad_s"] for row in content["growth"]]
        grows = min(rates) > 0.0
        lines.append(
            "no limit cycle: every swing " + ("grows" if grows else f"dies, by {-max(rates):.2g} 1/s at least")
        )
    if content["by_integration"]:
        found = content["by_integration"]
        lines.append(
            f"deck       kicks at the lever (0.2 s) die up to {found['largest_kick_that_dies_n']:.4g} N and go on from "
            f"{found['smallest_kick_that_goes_on_n']:.4g} N"
        )
        if found["swing_mm"] is not None:
            lines.append(
                f"           in between it swings by {found['swing_mm']:.3g} mm at {found['frequency_hz']:.3f} Hz"
            )
    if content["map"]:
        grid = content["map"]
        maps = [("smallest swing of the grip that grows [mm]", "smallest_swing_that_grows_mm")]
        if grid["smallest_kick_that_goes_on_n"]:
            maps.append(("smallest kick at the lever that goes on [N], of the deck", "smallest_kick_that_goes_on_n"))
        for what, key in maps:
            lines.append(f"{what}; -: every one within the stops dies")
            lines.append("gearing  friction [N]" + "".join(f"{force:>8g}" for force in grid["friction_n"]))
            for gearing, row in zip(grid["gearing_rad_per_m"], grid[key], strict=True):
                cells = "".join(f"{'-' if value is None else f'{value:.3g}':>8}" for value in row)
                lines.append(f"{gearing:7.3g} rad/m        " + cells)
    return "\n".join(lines)
