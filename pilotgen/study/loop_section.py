"""Which loop a study is about: one motion of the seat, and the control that the pilot moves with it.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pilotgen.study.fields import Choice, Field, Mistake, Section, Vector

HEAVE, COLLECTIVE = "heave", "collective"
ROTATIONS = ("roll", "pitch", "yaw")
MOTIONS = (HEAVE, "surge", "sway", *ROTATIONS)
CONTROLS = {COLLECTIVE: "collective", "longitudinal": "longitudinal cyclic", "lateral": "lateral cyclic"}

LOOP_ROWS: Mapping[str, Field] = {
    "loop": Section(
        default=None, null=True, meaning="which motion of the seat and which control; heave and collective if left out"
    ),
    "loop.input": Choice(MOTIONS, default=HEAVE, meaning="motion of the seat, the input of the pilot"),
    "loop.output": Choice(tuple(CONTROLS), default=COLLECTIVE, meaning="the control that he moves with it"),
    "loop.point_m": Vector(
        3,
        -5.0,
        5.0,
        "m",
        default=(0.0, 0.0, 0.0),
        hint="position from the neutral seat reference point: x forward, y up, z right",
        meaning="where the axis of a rotation of the seat passes, from its reference point, three numbers",
    ),
}


@dataclass(frozen=True)
class LoopSignals:
    """The two ends of a loop: names of a seat motion and of a control, and where a rotation's axis passes."""

    input: str = HEAVE
    output: str = COLLECTIVE
    point_m: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])

    @property
    def usual(self) -> bool:
        """Whether it is heave by the collective: collective bounce."""
        return (self.input, self.output) == (HEAVE, COLLECTIVE)

    @property
    def rotates(self) -> bool:
        """Whether the seat turns."""
        return self.input in ROTATIONS

    @property
    def control(self) -> str:
        """`lateral cyclic`."""
        return CONTROLS[self.output]

    @property
    def words(self) -> str:
        """`roll by the lateral cyclic`."""
        return f"{self.input} by the {self.control}"

    @property
    def per_acceleration(self) -> str:
        """End of names of numbers per acceleration of the seat: `m_s2` or `rad_s2`."""
        return "rad_s2" if self.rotates else "m_s2"


def loop_from(data: Mapping[str, Any] | None) -> LoopSignals:
    """The loop of checked data. Mistake (a StudyError) if one of its ends is missing, or a translation has a point."""
    if not data:
        return LoopSignals()
    ends = [key for key in ("input", "output") if key in data]
    if len(ends) != 2:
        raise Mistake("loop", dict(data), "has two ends; give input and output, such as {input: roll, output: lateral}")
    found = LoopSignals(**{**data, "point_m": [float(x) for x in data.get("point_m") or (0.0, 0.0, 0.0)]})
    if not found.rotates and any(found.point_m):
        raise Mistake("loop.point_m", found.point_m, f"means nothing for loop.input = {found.input!r}; remove it")
    return found
