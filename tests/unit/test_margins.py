"""Margins with known answers: closed forms, Mayo's pilots on the Puma, and every rule of docs/theory/margins.md.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from pilotgen import evaluation
from pilotgen.context import EvaluationContext
from pilotgen.evaluation import Evaluation, FailedEvaluation, evaluate
from pilotgen.linear.statespace import StateSpaceModel, series, transfer_function, zeros_poles_gain
from pilotgen.loop.heave_model import HeaveModel
from pilotgen.loop.loop import LoopModel
from pilotgen.loop.margins import Margins, margins
from pilotgen.objectives import DEFAULT_OBJECTIVES, ranked_objectives
from pilotgen.study.rotorcraft import load_rotorcraft
from pilotgen.study.study import read_study

ROOT = Path(__file__).parents[2]
PUMA = HeaveModel(load_rotorcraft("iar330-puma"))
TWO_PI = 2.0 * math.pi


def mayo_margins(frequency_hz: float, damping: float, tau_s: float) -> Margins:
    w = TWO_PI * frequency_hz
    pair = complex(-damping * w, w * math.sqrt(1.0 - damping**2))
    pilot = zeros_poles_gain([0.0, -1.0 / tau_s], [-3.10, -3.10, pair, pair.conjugate()], -1.0 / 0.32)
    return margins(LoopModel(pilot, PUMA, 1.1, 0.32))


def unit_crossings(m: Margins) -> int:
    return sum(crossing.kind == "unit circle" for crossing in m.crossings)


# Independent computation of these six points, printed with three and four digits.
@pytest.mark.parametrize(
    ("pilot", "gain_db", "gain_hz", "phase_deg", "circle"),
    [
        ((3.380, 0.32, 0.117), 6.42, 3.78, math.inf, 0),
        ((3.750, 0.28, 0.107), 6.36, 3.98, math.inf, 0),
        ((2.5, 0.20, 0.06), -4.503, None, -33.19, 2),
        ((2.5, 0.35, 0.06), 0.696, None, 7.546, 2),
        ((3.25, 0.20, 0.12), 1.815, None, 41.03, 2),
        ((4.0, 0.50, 0.12), 12.762, None, math.inf, 0),
    ],
)
def test_mayos_pilots_on_the_puma(
    pilot: tuple[float, float, float], gain_db: float, gain_hz: float | None, phase_deg: float, circle: int
) -> None:
    m = mayo_margins(*pilot)
    assert m.stable == (gain_db > 0.0)
    assert m.gain_margin_db == pytest.approx(gain_db, abs=0.006 if gain_hz else 6e-4)
    if gain_hz is not None:
        assert m.gain_margin_hz == pytest.approx(gain_hz, abs=0.006)
    assert m.phase_margin_deg == pytest.approx(phase_deg, abs=0.006)
    assert unit_crossings(m) == circle


def test_triple_lag_in_closed_form() -> None:
    """K/(s+1)^3 meets the negative axis at sqrt(3) with -K/8, and the unit circle where (1+w^2)^(3/2) = K."""
    K = 4.0
    m = margins(transfer_function([K], [1.0, 3.0, 3.0, 1.0]))
    w = math.sqrt(K ** (2.0 / 3.0) - 1.0)
    phase = math.pi - 3.0 * math.atan(w)
    assert m.stable
    assert m.gain_margin_db == pytest.approx(20.0 * math.log10(8.0 / K), abs=1e-9)
    assert m.gain_margin_hz == pytest.approx(math.sqrt(3.0) / TWO_PI, rel=1e-9)
    assert m.phase_margin_deg == pytest.approx(math.degrees(phase), abs=1e-8)
    assert m.phase_margin_hz == pytest.approx(w / TWO_PI, rel=1e-9)
    assert m.delay_margin_s == pytest.approx(phase / w, rel=1e-9)
    assert len(m.crossings) == 2
    unstable = margins(transfer_function([16.0], [1.0, 3.0, 3.0, 1.0]))
    assert not unstable.stable
    assert unstable.gain_margin_db == pytest.approx(-20.0 * math.log10(2.0), abs=1e-9)
    assert unstable.phase_margin_deg < 0.0
    assert unstable.delay_margin_s == 0.0 and unstable.disk_margin == 0.0


def test_modulus_and_disk_margin_in_closed_form() -> None:
    """L = K/(s(s+1)): |1+L|^2 and the disk function are ratios of quadratics in w^2; minima by a fine scan."""
    m = margins(transfer_function([2.0], [1.0, 1.0, 0.0]))
    w = np.linspace(0.1, 5.0, 2_000_001)
    L = 2.0 / (1j * w * (1j * w + 1.0))
    assert m.modulus_margin == pytest.approx(np.abs(1.0 + L).min(), abs=1e-11)
    assert m.disk_margin == pytest.approx((2.0 * np.abs(1.0 + L) / np.abs(1.0 - L)).min(), abs=1e-11)
    assert m.modulus_margin_hz * TWO_PI == pytest.approx(w[np.abs(1.0 + L).argmin()], abs=5e-6)


# A touch needs the gain to the last digits: with this gain |L| of the resonance just reaches 1, or does not.
@pytest.mark.parametrize(("excess", "count"), [(-1e-6, 0), (0.0, 1), (1e-6, 2)])
def test_resonance_that_touches_the_unit_circle(excess: float, count: int) -> None:
    zeta = 0.1
    gain = 2.0 * zeta * math.sqrt(1.0 - zeta**2) * (1.0 + excess)  # peak of gain/(s^2+2 zeta s+1) is gain/(that)
    m = margins(transfer_function([gain], [1.0, 2.0 * zeta, 1.0]))
    assert unit_crossings(m) == count
    assert math.isfinite(m.phase_margin_deg) == (count > 0)
    if count:
        assert m.phase_margin_hz == pytest.approx(math.sqrt(1.0 - 2.0 * zeta**2) / TWO_PI, abs=2e-3)


@pytest.mark.parametrize(("excess", "count"), [(-1e-6, 0), (0.0, 1), (1e-6, 2)])
def test_locus_that_touches_the_negative_real_axis(excess: float, count: int) -> None:
    """L = N(s)/(s + 1)^3 with N such that Im L = +-w ((w^2 - 2)^2 - excess) / |jw + 1|^6: a double root at sqrt 2.

    N = n0 + n1 s + n2 s^2; Im(N(jw) (1 - jw)^3) / w is a quadratic in w^2, matched at three frequencies.
    """
    a = 2.0
    target = np.array([a * a - excess, -2.0 * a, 1.0])
    omega = np.array([0.5, 1.0, 1.7])
    rows = [[((1j * w) ** k * (1.0 - 1j * w) ** 3).imag / w for k in range(3)] for w in omega]
    n = np.linalg.solve(np.array(rows), np.array([target[0] + target[1] * w**2 + target[2] * w**4 for w in omega]))
    check = np.array([(np.polyval(n[::-1], 1j * w) * (1.0 - 1j * w) ** 3).imag / w for w in (0.3, 2.2)])
    np.testing.assert_allclose(check, [(w * w - a) ** 2 - excess for w in (0.3, 2.2)], atol=1e-12)
    sign = -math.copysign(1.0, (np.polyval(n[::-1], 1j * math.sqrt(a)) / (1.0 + 1j * math.sqrt(a)) ** 3).real)
    m = margins(transfer_function((sign * n[::-1]).tolist(), [1.0, 3.0, 3.0, 1.0]))
    near = [c for c in m.crossings if c.kind == "real axis" and abs(c.frequency_hz * TWO_PI - math.sqrt(a)) < 0.01]
    assert len(near) == count


@pytest.mark.parametrize(
    ("D", "stable", "gain_db", "phase_deg"),
    [
        (0.5, True, math.inf, math.inf),
        (-0.5, True, 20.0 * math.log10(2.0), math.inf),
        (-2.0, True, 20.0 * math.log10(2.0), math.inf),
        (1.0, True, math.inf, 180.0),
        (-1.0, False, 0.0, 0.0),
        (0.0, True, math.inf, math.inf),
    ],
)
def test_constant_loops(D: float, stable: bool, gain_db: float, phase_deg: float) -> None:
    m = margins(StateSpaceModel(np.zeros((0, 0)), np.zeros(0), np.zeros(0), D))
    assert m.stable == stable
    assert m.gain_margin_db == pytest.approx(gain_db)
    assert m.phase_margin_deg == pytest.approx(phase_deg)
    assert m.modulus_margin == abs(1.0 + D)


def test_negative_value_at_zero_frequency_counts() -> None:
    m = margins(transfer_function([-0.5], [1.0, 1.0]))
    assert m.stable and m.gain_margin_hz == 0.0
    assert m.gain_margin_db == pytest.approx(20.0 * math.log10(2.0), abs=1e-9)
    assert not margins(transfer_function([-2.0], [1.0, 1.0])).stable


def test_negative_value_at_infinite_frequency_counts() -> None:
    m = margins(transfer_function([-0.25, 1.0], [1.0, 1.0]))  # from 1 at w = 0 to -0.25
    assert m.stable and m.gain_margin_hz == math.inf
    assert m.gain_margin_db == pytest.approx(20.0 * math.log10(4.0), abs=1e-9)
    assert m.as_dict()["gain_margin_hz"] is None and m.as_dict()["gain_margin_db"] == pytest.approx(m.gain_margin_db)


def test_direct_term_of_one_or_more_leaves_no_delay() -> None:
    assert margins(transfer_function([1.5, 1.0], [1.0, 2.0])).delay_margin_s == 0.0
    assert margins(transfer_function([0.9, 0.1], [1.0, 2.0])).delay_margin_s == math.inf


@pytest.mark.parametrize("gain", [1e-8, 1.0, 1e8])
def test_integrator_of_any_gain(gain: float) -> None:
    m = margins(transfer_function([gain], [1.0, 0.0]))
    assert m.stable and m.gain_margin_db == math.inf
    assert m.phase_margin_deg == pytest.approx(90.0, abs=1e-9)
    assert m.phase_margin_hz == pytest.approx(gain / TWO_PI, rel=1e-9)
    assert m.delay_margin_s == pytest.approx(0.5 * math.pi / gain, rel=1e-9)


def test_double_and_triple_integrator() -> None:
    m = margins(transfer_function([1.0, 0.25], [1.0, 4.0, 0.0, 0.0]))  # 0.25 (4 s + 1) / (s^2 (s + 4))
    w = np.geomspace(0.01, 10.0, 2_000_001)
    L = (1j * w + 0.25) / ((1j * w) ** 2 * (1j * w + 4.0))
    i = int(np.argmin(np.abs(np.abs(L) - 1.0)))
    assert m.stable and m.gain_margin_db == math.inf
    assert m.phase_margin_deg == pytest.approx(abs(np.degrees(np.angle(-L[i]))), abs=1e-3)
    # (5 s^2 + 5 s + 1)/s^3, conditionally stable: Im L = 0 at w^2 = 1/5, where L = -25; the gain may fall to 1/25.
    triple = margins(transfer_function([5.0, 5.0, 1.0], [1.0, 0.0, 0.0, 0.0]))
    assert triple.stable
    assert triple.gain_margin_db == pytest.approx(20.0 * math.log10(25.0), abs=1e-9)


def test_undamped_mode_on_the_axis() -> None:
    m = margins(transfer_function([0.2, 0.1], [1.0, 0.0, 1.0]))  # infinite at w = 1
    w = np.concatenate((np.linspace(0.0, 0.9999, 400_001), np.linspace(1.0001, 50.0, 400_001)))
    L = (0.2j * w + 0.1) / (1.0 - w * w)
    down = np.nonzero((np.abs(L[:-1]) >= 1.0) != (np.abs(L[1:]) >= 1.0))[0]
    assert m.stable
    assert unit_crossings(m) == down.size == 2
    smallest = min(abs(np.degrees(np.angle(-L[down]))))
    assert m.phase_margin_deg == pytest.approx(smallest, abs=2e-2)


def test_all_pass_lies_on_the_circle_everywhere() -> None:
    m = margins(transfer_function([1.0, -1.0], [1.0, 1.0]))  # -1 at w = 0
    assert not m.stable
    assert m.phase_margin_deg == pytest.approx(0.0, abs=1e-6)
    m = margins(transfer_function([0.5, -0.5], [1.0, 1.0]))
    assert m.stable and m.phase_margin_deg == math.inf
    assert m.gain_margin_db == pytest.approx(20.0 * math.log10(2.0), abs=1e-9)


def test_locus_on_the_negative_axis_everywhere() -> None:
    m = margins(transfer_function([0.5], [1.0, 0.0, -1.0]))  # -0.5 / (1 + w^2), open and closed loop unstable
    assert not m.stable
    assert m.gain_margin_db == pytest.approx(-20.0 * math.log10(2.0), abs=1e-9)


def test_loop_without_effect() -> None:
    m = margins(StateSpaceModel(-np.eye(2), np.ones(2), np.zeros(2), 0.0))
    assert m.stable and m.gain_margin_db == math.inf and m.modulus_margin == 1.0


def test_hidden_unstable_mode_is_not_missed() -> None:
    """An unstable mode that the output does not see: no crossing tells, the eigenvalues do."""
    m = margins(StateSpaceModel(np.diag([-1.0, 0.5]), np.ones(2), np.array([0.1, 0.0]), 0.0))
    assert not m.stable and m.gain_margin_db == -math.inf
    assert ranked_objectives({"loop": m.as_dict()}, DEFAULT_OBJECTIVES) == [-60.0, -180.0]
    assert m.as_dict()["gain_margin_db"] is None


def test_lightly_damped_mode_between_grid_points() -> None:
    """A mode of damping 1e-4 whose circle in the Nyquist plane is all there is near -1."""
    zeta, w = 1e-4, 17.3
    mode = transfer_function([-2.0 * zeta * w * 1.5, 0.0], [1.0, 2.0 * zeta * w, w * w])  # -1.5 at resonance
    m = margins(mode)
    assert not m.stable
    assert m.gain_margin_db == pytest.approx(-20.0 * math.log10(1.5), abs=1e-6)
    assert m.gain_margin_hz == pytest.approx(w / TWO_PI, rel=1e-9)
    assert m.phase_margin_deg == pytest.approx(-math.degrees(math.acos(1.0 / 1.5)), abs=1e-5)


def test_ranking_caps_infinite_margins() -> None:
    m = margins(transfer_function([0.5], [1.0, 1.0]))
    assert ranked_objectives({"loop": m.as_dict()}, DEFAULT_OBJECTIVES) == [60.0, 180.0]


def test_dictionary_is_json_and_has_no_infinity() -> None:
    for m in (mayo_margins(3.380, 0.32, 0.117), mayo_margins(2.5, 0.20, 0.06)):
        back = json.loads(json.dumps(m.as_dict(), allow_nan=False))
        assert back["gain_margin_db"] == m.gain_margin_db
        assert len(back["crossings"]) == len(m.crossings)
        assert set(back) >= {
            "stable", "gain_margin_db", "gain_margin_hz", "phase_margin_deg", "phase_margin_hz", "modulus_margin",
            "modulus_margin_hz", "delay_margin_s", "disk_margin", "crossings",
        }  # fmt: skip


def test_accuracy_does_not_depend_on_the_time_scale() -> None:
    one = margins(transfer_function([4.0], [1.0, 3.0, 3.0, 1.0]))
    for scale in (1e-6, 1e6):
        other = margins(zeros_poles_gain([], [-scale] * 3, 4.0 * scale**3))
        assert other.gain_margin_db == pytest.approx(one.gain_margin_db, abs=1e-9)
        assert other.phase_margin_deg == pytest.approx(one.phase_margin_deg, abs=1e-8)
        assert other.gain_margin_hz == pytest.approx(scale * (one.gain_margin_hz or 0.0), rel=1e-9)


def test_state_coordinates_do_not_matter() -> None:
    model = series(transfer_function([2.0, 1.0], [1.0, 0.2, 4.0]), transfer_function([3.0], [1.0, 5.0]))
    T = np.array([[1.0, 2.0, 0.0], [0.0, 1.0, -3.0], [4.0, 0.0, 1.0]])
    turned = StateSpaceModel(np.linalg.solve(T, model.A @ T), np.linalg.solve(T, model.B), model.C @ T, model.D)
    a, b = margins(model), margins(turned)
    assert a.phase_margin_deg == pytest.approx(b.phase_margin_deg, abs=1e-9)
    assert len(a.crossings) == len(b.crossings)


def many_light_modes(damping: float) -> StateSpaceModel:
    """Fifty equal modes in a row, lightly damped: too many states for exact arithmetic, too defective for doubles."""
    A = np.zeros((100, 100))
    for k in range(0, 100, 2):
        A[k : k + 2, k : k + 2] = [[-2.0 * damping, -1.0], [1.0, 0.0]]
        if k:
            A[k, k - 1] = 1.0
    return StateSpaceModel(A, np.eye(100)[0], 1e-30 * np.eye(100)[99], 0.0)


def test_what_cannot_be_told_is_not_guessed() -> None:
    m = margins(many_light_modes(1e-6))
    assert m.stable is None and m.largest_real_part is not None
    low, high = m.largest_real_part
    assert low < 0.0 < high
    told = json.loads(json.dumps(m.as_dict(), allow_nan=False))
    assert told["stable"] is None and told["gain_margin_db"] is None and told["disk_margin"] is None
    assert told["delay_margin_s"] is None and told["phase_margin_deg"] is None
    assert told["largest_real_part"] == [low, high]


def test_a_pilot_whose_stability_cannot_be_told_is_a_failed_one(monkeypatch: pytest.MonkeyPatch) -> None:
    study = read_study(ROOT / "docs" / "studies" / "puma-mayo.yaml")
    with EvaluationContext(study) as context:
        assert study.search is not None
        values = study.values({name: 0.5 * (low + high) for name, (low, high) in study.search.variables.items()})
        assert isinstance(evaluate(context, values), Evaluation)
        monkeypatch.setattr(evaluation, "margins", lambda loop: margins(many_light_modes(1e-6)))
        failed = evaluate(context, values)
    assert isinstance(failed, FailedEvaluation)
    assert failed.stage == "margins" and "cannot be told: the largest real part" in failed.reason


def test_delay_margin_of_points_that_lead() -> None:
    """-L leads at no crossing: both lag behind the axis by more than 180 deg, which a delay has to go round for."""
    zeta, z = 0.01, math.tan(math.radians(80.0))
    gain = 2.0 * 2.0 * zeta / math.hypot(1.0, z)  # peak 2 at -80 deg of -L; circle at -20, -140
    m = margins(transfer_function([-gain, -gain * z], [1.0, 2.0 * zeta, 1.0]))
    circle = [c for c in m.crossings if c.kind == "unit circle"]
    assert m.stable and [round(c.phase_deg, -1) for c in circle] == [-20.0, -140.0]
    wanted = [(math.radians(360.0 + c.phase_deg)) / (TWO_PI * c.frequency_hz) for c in circle]
    assert m.delay_margin_s == pytest.approx(min(wanted), rel=1e-9)
    assert m.delay_margin_s > math.pi and m.delay_margin_hz == circle[1].frequency_hz
    assert m.phase_margin_deg == pytest.approx(-circle[0].phase_deg)
