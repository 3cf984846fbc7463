"""Bands of the feedthrough and of the loop over the draws: quantiles frequency by frequency.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from pilotgen.evaluation import Evaluation
from pilotgen.linear.statespace import ComplexArray, FloatArray
from pilotgen.study.loop_section import LoopSignals

# Closer where pilots and rotorcraft have their lightly damped modes: ends [Hz] and points of each piece.
PIECES = ((0.1, 1.0, 30), (1.0, 8.0, 240), (8.0, 20.0, 31))
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
INSIDE = (0.5, 0.9)  # share of draws in an ellipse of the loop


def band_frequencies() -> FloatArray:
    """Frequencies [Hz] at which draws are compared. Shape (n,)."""
    return np.unique(np.concatenate([np.geomspace(*piece) for piece in PIECES]))


def responses(evaluation: Evaluation) -> tuple[ComplexArray, ComplexArray]:
    """Motion of the loop's grip, washout included, and loop of one draw at `band_frequencies`. Shape (n,) each.

    Motion is in mm per m/s^2 of the seat, or per rad/s^2 if it turns.
    """
    omega = 2.0 * math.pi * band_frequencies()
    loop = evaluation.loop
    motion = 1e3 * loop.lever_length_m * np.asarray(evaluation.pilot_model.response(omega, loop.output))
    return motion, np.asarray(evaluation.loop.response(omega))


def bands(motion: Sequence[ComplexArray], loop: Sequence[ComplexArray], nominal: Evaluation) -> dict[str, Any]:
    """For uncertain.json (docs/io_formats/uncertain.md, `bands`).

    Parameters
    ----------
    motion, loop : sequence of ndarray, shape (n,)
        Of every draw that could be evaluated, three at least.
    nominal : Evaluation
        The pilot as the study has him.
    """
    own_motion, own_loop = responses(nominal)
    magnitude = np.quantile(np.abs(np.array(motion)), QUANTILES, axis=0)
    L = np.array(loop)
    return {
        "frequency_hz": band_frequencies().tolist(),
        "feedthrough_unit": "mm per rad/s^2" if LoopSignals(nominal.loop.motion).rotates else "mm per m/s^2",
        "feedthrough": {f"{q:g}": row.tolist() for q, row in zip(QUANTILES, magnitude, strict=True)},
        "feedthrough_nominal": np.abs(own_motion).tolist(),
        "loop_nominal": {"real": own_loop.real.tolist(), "imag": own_loop.imag.tolist()},
        "loop_ellipses": [_ellipses(column) for column in L.T],
    }


def _ellipses(points: ComplexArray) -> dict[str, Any]:
    """Mean, axes of inertia, and ellipses along them that hold given shares of the points, counted."""
    pairs = np.column_stack([points.real, points.imag])
    centre = pairs.mean(axis=0)
    variances, axes = np.linalg.eigh(np.cov(pairs.T))
    deviations = np.sqrt(np.maximum(variances, 1e-30))
    distance = np.sqrt((((pairs - centre) @ axes / deviations) ** 2).sum(axis=1))
    return {
        "centre": centre.tolist(),
        "angle_deg": math.degrees(math.atan2(axes[1, 1], axes[0, 1])),
        "half_axes": {
            f"{share:g}": (float(np.quantile(distance, share)) * deviations[::-1]).tolist() for share in INSIDE
        },
    }
