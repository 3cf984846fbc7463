"""Units and positive directions in which rotorcraft of others come, by control and by motion of the seat.

This program's own are rad of blade pitch, m/s^2 and rad/s^2; collective up, stick aft and right; heave up, surge
forward, sway and roll right, pitch nose up, yaw nose right.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from pilotgen.errors import FileError
from pilotgen.linear.imposed_motion import SEAT_MOTIONS

CONTROLS: Mapping[str, tuple[str, str, str]] = {  # output of the pilot, positive word, its opposite
    "collective": ("collective_rotation", "up", "down"),
    "longitudinal": ("cyclic_aft", "aft", "forward"),
    "lateral": ("cyclic_right", "right", "left"),
}
POSITIVE: Mapping[str, tuple[str, str]] = {
    "heave": ("up", "down"),
    "surge": ("forward", "aft"),
    "sway": ("right", "left"),
    "roll": ("right", "left"),
    "pitch": ("up", "down"),
    "yaw": ("right", "left"),
}
INPUT_FACTORS: Mapping[str, float] = {"rad": 1.0, "deg": math.degrees(1.0)}
_TRANSLATIONS: Mapping[str, float] = {"m/s^2": 1.0, "g": 9.80665, "ft/s^2": 0.3048}
_ROTATIONS: Mapping[str, float] = {"rad/s^2": 1.0, "deg/s^2": math.radians(1.0)}
OUTPUT_FACTORS: Mapping[str, float] = {**_TRANSLATIONS, **_ROTATIONS}


def output_factors(motion: str) -> Mapping[str, float]:
    """Units in which a motion of the seat may come -> SI."""
    return _ROTATIONS if SEAT_MOTIONS[motion].rotation else _TRANSLATIONS


def output_signs(motion: str) -> Mapping[str, float]:
    """Positive directions in which a motion of the seat may come -> 1 if it is this program's, or -1."""
    positive, negative = POSITIVE[motion]
    return {positive: 1.0, negative: -1.0}


def input_signs(control: str) -> Mapping[str, float]:
    """The same of a control."""
    _, positive, negative = CONTROLS[control]
    return {positive: 1.0, negative: -1.0}


HEAVE, COLLECTIVE = "heave", "collective"  # the loop whose signals go without saying


def stated_gain(said: Mapping[str, str | None], motion: str, control: str, where: str, hint: str) -> float:
    """What a response in the units and directions that a file states is multiplied with to be in this program's.

    A file says `input_unit`, `output_unit`, `output_positive`; for another loop than heave by the collective also
    `input_control`, `input_positive` and `output_motion`, which otherwise may be left out. None of them has a default.

    Parameters
    ----------
    said : mapping
        What the file says.
    motion, control : str
        Which loop it is to be for, by names of `POSITIVE` and `CONTROLS`.
    where : str
        The file, for messages.
    hint : str
        What to do, with `{key}`; the known words follow.

    Raises
    ------
    FileError
        One of them is missing or not known, or the file is of another loop.
    """
    gain = 1.0
    known: dict[str, Mapping[str, float]] = {
        "input_unit": INPUT_FACTORS,
        "output_unit": output_factors(motion),
        "output_positive": output_signs(motion),
    }
    more: dict[str, Mapping[str, float]] = {
        "input_positive": input_signs(control),
        "input_control": {control: 1.0},
        "output_motion": {motion: 1.0},
    }
    usual = (motion, control) == (HEAVE, COLLECTIVE)
    for key, words in {**known, **more}.items():
        value = said.get(key)
        if value is None and usual and key in more:
            continue
        if value is None or value not in words:
            came = "is missing" if value is None else f"= {value[:40]!r} is not known"
            if value is not None and key in ("input_control", "output_motion"):
                raise FileError(f"{where}: {key} = {value[:40]!r}; the loop of the study is {motion} by {control}")
            raise FileError(f"{where}: {key} {came}; {hint.format(key=key)} one of {', '.join(words)}")
        gain *= words[value]
    return gain
