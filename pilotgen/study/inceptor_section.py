"""The collective lever of a study: rows of the schema, and its friction, checked.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pilotgen.study.fields import Choice, Field, Mistake, Number, Section

INCEPTOR_ROWS: Mapping[str, Field] = {
    # ---- inceptor
    "inceptor": Section(meaning="the collective lever"),
    "inceptor.lever_length_m": Number(
        0.10, 1.00, "m", hint="lengths are in metres: 320 mm is 0.32", meaning="collective hinge to grip"
    ),
    "inceptor.gearing_rad_per_m": Number(
        0.01,
        20.0,
        "rad/m",
        hint="rad of blade pitch per metre of grip travel; the Puma of the paper has 1.1",
        meaning="blade pitch per metre of grip travel of the loop's control, G0; blade pitch per rotation is this "
        "times the lever length, of the cyclic `cockpit.cyclic.length_m`",
    ),
    "inceptor.position": Number(
        0.0,
        1.0,
        "",
        default=0.5,
        hint="collective from 0 (full down) to 1 (full up)",
        meaning="collective from full down to full up",
    ),
    "inceptor.friction": Section(
        default=None,
        null=True,
        meaning="of the lever ([theory](../theory/limit_cycles.md)); margins are without it",
    ),
    "inceptor.friction.breakout_n": Number(
        0.0,
        500.0,
        "N",
        hint="force at the grip that starts the lever: 1 lbf is 4.448 N",
        meaning="force at the grip that starts the lever; 0 for none",
    ),
    "inceptor.friction.stribeck_n": Number(
        0.0,
        500.0,
        "N",
        default=0.0,
        meaning="how much less the force of fast sliding is",
    ),
    "inceptor.friction.stribeck_velocity_m_s": Number(
        1e-4,
        1.0,
        "m/s",
        default=0.02,
        meaning="velocity of the grip by which that difference has fallen to 1/e of it",
    ),
    "inceptor.friction.viscous_n_s_per_m": Number(
        0.0, 1000.0, "N s/m", default=0.0, meaning="grows with the velocity of the grip"
    ),
    "inceptor.friction.presliding_m": Number(
        1e-6, 0.01, "m", default=2e-4, meaning="elastic travel of the grip before it slides"
    ),
    "inceptor.friction.model": Choice(
        ("coulomb", "lugre"),
        default="coulomb",
        meaning="stuck and sliding without between, or elastic before it slides",
    ),
}


def check_friction(friction: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Friction of a lever, complete; None for none. Mistake where its numbers do not go together."""
    if friction is None:
        return None
    usual = {
        path.removeprefix("inceptor.friction."): row.default
        for path, row in INCEPTOR_ROWS.items()
        if path.startswith("inceptor.friction.")
    }
    if "breakout_n" not in friction:
        raise Mistake("inceptor.friction", dict(friction), "lacks breakout_n; give it as well")
    whole = {**usual, **friction}
    if whole["stribeck_n"] and whole["stribeck_n"] >= whole["breakout_n"]:
        raise Mistake(
            "inceptor.friction.stribeck_n",
            whole["stribeck_n"],
            f"leaves nothing of breakout_n = {whole['breakout_n']:g} N; the force of fast sliding is their difference",
        )
    return whole
