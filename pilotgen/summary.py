"""What of a pilot goes into his result: dominant mode, grip motion, certificate; where he came from; what to mind.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from typing import Any

from pilotgen import __version__
from pilotgen.linear.pilot_model import PilotModel
from pilotgen.loop.loop import LoopModel
from pilotgen.loop.margins import Margins
from pilotgen.objectives import OBJECTIVES
from pilotgen.study.fields import MULTIBODY
from pilotgen.study.loop_section import LoopSignals
from pilotgen.study.schema import MAYO_PRESETS
from pilotgen.study.study import Study
from pilotgen.study.torso_numbers import RIGID

GRIP_FREQUENCY_HZ = 3.0  # where grip motion is reported, as Mayo's people are (docs/validation.md)


def bdft_summary(
    model: PilotModel, loop: LoopModel, certificate: float | None, pade_error: float | None = None
) -> dict[str, Any]:
    """What a result tells of the feedthrough (docs/io_formats/result.md, `bdft`): of the control of the loop.

    Parameters
    ----------
    model : PilotModel
        The pilot.
    loop : LoopModel
        The loop that he is in.
    certificate : float, optional
        Largest relative difference from the full-order response; None without one.
    pade_error : float, optional
        What the approximant of a reflex delay changes; None without a delay.
    """
    frequency_hz, damping = model.dominant_pair(loop.output)
    rotation = complex(model.response(2.0 * math.pi * GRIP_FREQUENCY_HZ, loop.output, washout=False))
    per = per_acceleration(loop.motion)
    return {
        "dominant_frequency_hz": frequency_hz,
        "dominant_damping": damping,
        f"grip_motion_3hz_mm_per_{per}": 1e3 * abs(loop.lever_length_m * rotation),
        "certificate": certificate,
        **({} if pade_error is None else {"pade_error": pade_error}),
        "cyclic": _cyclic_summary(model, per),
        "terms": model.terms(loop.output),
    }


def per_acceleration(motion: str) -> str:
    """End of names of numbers per acceleration of the seat in a motion: `m_s2` or `rad_s2`."""
    return LoopSignals(input=motion).per_acceleration


def loop_result(loop: LoopModel, verdict: Margins) -> dict[str, Any]:
    """What a result tells of the loop (docs/io_formats/result.md, `loop`): which one it is, and its margins."""
    return {"input": loop.motion, "output": loop.control, **verdict.as_dict()}


def _cyclic_summary(model: PilotModel, per: str) -> dict[str, float] | None:
    """Rotation of the cyclic stick at 3 Hz without washout [mrad per m/s^2] by axis; None without a right arm."""
    axes = [(k, name) for k, name in enumerate(model.outputs) if name.startswith("cyclic_")]
    if not axes:
        return None
    omega = 2.0 * math.pi * GRIP_FREQUENCY_HZ
    rotations = ((name, abs(complex(model.response(omega, k, washout=False)))) for k, name in axes)
    return {f"{name}_3hz_mrad_per_{per}": 1e3 * rotation for name, rotation in rotations}


RIGID_TORSO = (
    "the torso is rigid: the grip moves about half as much as on the people that Mayo measured, and gain margins are "
    "some 7 dB larger than those of Mayo's pilots; compare pilots with each other rather than with a limit"
)  # docs/theory/calibration.md, beside Mayo's people
TORSO_ON_SPRINGS = (
    "with a torso on springs gain margins are 1.4 dB larger than those of Mayo's mesomorphic pilots on the Puma, and 3 "
    "to 5 dB larger than those of his ectomorphic ones; compare pilots with each other rather than with a limit"
)  # the same table
NO_DATA_OF_OTHER_LOOPS = (
    "nobody has published a measured feedthrough of {loop} to hold this one against; compare pilots with each other "
    "rather than with a limit"
)
REFLEX_DELAY = (
    "the reflex is delayed after linearisation: decks and matrices on disk have no delay, and calibrated gains were "
    "found without one (docs/theory/reflex_delay.md)"
)
FRICTION = (
    "margins and poles are without the lever's friction of {:g} N, as if motions were too large for it to matter; "
    "smaller ones stick (pilotgen limit-cycles tells how small)"
)
MEASURED_GROUPS = (
    "Mayo measured two groups of people; between and beyond them a pilot of his form is an interpolation or a guess"
)


def caveats(study: Study, result: Mapping[str, Any]) -> list[str]:
    """What limits a result, first of all where it extrapolates; sentences. Empty for a failed pilot."""
    if result.get("status") == "failed":
        return []
    found = [f"extrapolated: {sentence}" for sentence in result.get("extrapolated", ())]
    errors = result.get("loop", {}).get("interpolation_error")
    if errors is not None:
        found.append(_interpolated(errors))
    if not study.loop.usual:
        found.append(NO_DATA_OF_OTHER_LOOPS.format(loop=study.loop.words))
    elif study.pilot.model == MULTIBODY:
        found.append(RIGID_TORSO if study.pilot.torso["model"] == RIGID else TORSO_ON_SPRINGS)
        if study.inceptor.friction is not None and study.inceptor.friction["breakout_n"] > 0.0:
            found.append(FRICTION.format(study.inceptor.friction["breakout_n"]))
        if study.pilot.reflex_delay_s > 0.0:
            found.append(REFLEX_DELAY)
        if study.pilot.projection == "literal":
            found.append("projection: literal is the paper's eq. (31), for comparison only (docs/theory/projection.md)")
    elif {name: result["values"].get(name) for name in MAYO_PRESETS["mesomorphic"]} not in MAYO_PRESETS.values():
        found.append(MEASURED_GROUPS)
    return found


def _interpolated(errors: Mapping[str, float | None]) -> str:
    told = [
        f"{row.label} +- {errors[row.key]:.2g} {row.unit}".rstrip()
        for row in OBJECTIVES.values()
        if errors.get(row.key) is not None
    ]
    return (
        "the rotorcraft is known by its frequency response only: stability is that of Nyquist's count with the "
        "unstable poles that its file states, poles of the closed loop cannot be told, and by interpolation "
        f"{', '.join(told)}"
    )


def result_file(
    study: Study, result: Mapping[str, Any], solver_version: str, deck: str | None = None
) -> dict[str, Any]:
    """The content of result.json: a result object, where it came from and its caveats (docs/io_formats/result.md)."""
    return {
        **result,
        "caveats": caveats(study, result),
        "provenance": {
            "pilotgen_version": __version__,
            "solver_version": solver_version,
            "study_sha256": hashlib.sha256(study.text.encode()).hexdigest(),
            "deck_sha256": None if deck is None else hashlib.sha256(deck.encode()).hexdigest(),
        },
    }
