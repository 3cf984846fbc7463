"""The table of objectives: what each row says is what search, results and documentation do with it.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pilotgen import objectives
from pilotgen.objectives import GAIN_MARGIN, MODULUS_MARGIN, OBJECTIVES, PHASE_MARGIN, Objective, margins_text
from pilotgen.runs.results import Row, columns_of

PAGE = Path(__file__).parents[2] / "docs" / "io_formats" / "study.md"
LOOP = {
    "stable": True, "gain_margin_db": 6.42, "gain_margin_hz": 3.78, "phase_margin_deg": None, "phase_margin_hz": None,
    "modulus_margin": 0.5, "modulus_margin_hz": 3.6, "delay_margin_s": None,
}  # fmt: skip
RESULT = {"status": "ok", "loop": LOOP, "bdft": {"grip_motion_3hz_mm_per_m_s2": 0.97}}
FAILED = {"status": "failed", "stage": "posture", "reason": "wrist"}


def test_the_page_has_the_same_table() -> None:
    lines = PAGE.read_text().splitlines()
    for row in OBJECTIVES.values():
        cap = f"{row.cap:g}" if math.isfinite(row.cap) else ""
        cells = [f"`{row.key}`", row.unit, row.worse, cap, row.meaning.replace("|", "\\|")]
        assert "| " + " | ".join(cells).replace("|  |", "| |").replace("|  |", "| |") + " |" in lines, row.key


def test_a_margin_in_words() -> None:
    assert GAIN_MARGIN.text(6.4249, 3.781) == "6.42 dB at 3.78 Hz"
    assert PHASE_MARGIN.text(None) == PHASE_MARGIN.text(-math.inf) == "none (no crossing of the unit circle)"
    assert MODULUS_MARGIN.text(0.5) == "0.500"
    assert PHASE_MARGIN.brief(180.0) == "PM none" and GAIN_MARGIN.brief(1.816) == "GM 1.82 dB"
    assert margins_text(RESULT) == "gain margin 6.42 dB at 3.78 Hz, phase margin none (no crossing of the unit circle)"


@pytest.mark.parametrize(("stable", "wanted"), [(True, math.inf), (False, -math.inf)])
def test_no_crossing_is_infinite_with_the_sign_of_stability(stable: bool, wanted: float) -> None:
    result = {**RESULT, "loop": {**LOOP, "stable": stable}}
    assert PHASE_MARGIN.of(result) == wanted
    assert PHASE_MARGIN.ranked(result) == math.copysign(180.0, wanted)
    assert MODULUS_MARGIN.ranked(result) == math.copysign(0.5, wanted)


def test_the_gain_at_the_crossing_is_there_for_every_pilot() -> None:
    row = objectives.objective("gain_at_180")

    def of(margin: float | None, stable: bool) -> float:
        return row.of({**RESULT, "loop": {**LOOP, "gain_margin_db": margin, "stable": stable}})

    assert of(6.42, True) == pytest.approx(10 ** (-6.42 / 20), rel=1e-12)
    assert of(-3.0, False) == pytest.approx(10 ** (3.0 / 20), rel=1e-12)
    assert of(None, True) == 0.0 < of(80.0, True) and of(None, False) == of(-70.0, False) == 1000.0
    assert row.ranked({**RESULT, "loop": {**LOOP, "gain_margin_db": -6.0, "stable": False}}) < row.ranked(RESULT)


def test_a_new_objective_is_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    row = Objective(
        "grip_motion_3hz_mm_per_m_s2", "grip motion at 3 Hz", "grip", "mm per m/s^2", "", section="bdft", worse="larger"
    )
    monkeypatch.setattr(objectives, "OBJECTIVES", {**OBJECTIVES, row.key: row})
    assert objectives.ranked_objectives(RESULT, (row.key, "gain_margin_db")) == [-0.97, 6.42]
    columns = columns_of([Row(0, 0, {}, RESULT), Row(0, 1, {}, FAILED)], [], np.zeros((2, 1)), None)
    np.testing.assert_array_equal(columns[row.key], [0.97, math.nan])
