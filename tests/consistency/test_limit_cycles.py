"""Limit cycles by harmonic balance against the deck integrated in time, and the elements against their laws."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pilotgen.closed_loop.deck import ClosedLoop, close_in_deck, friction_of
from pilotgen.closed_loop.elements import MuscleLaw, friction_force
from pilotgen.closed_loop.harmonic import HarmonicBalance
from pilotgen.closed_loop.limit_cycles import as_dict, balanced, nyquist, report_text, scaled
from pilotgen.closed_loop.muscles import muscle_data
from pilotgen.closed_loop.simulate import disturbance, simulate
from pilotgen.closed_loop.swing import Swing
from pilotgen.closed_loop.swing_model import LinearDeck, SwingModel
from pilotgen.closed_loop.threshold import swings, threshold
from pilotgen.context import EvaluationContext
from pilotgen.decks.vehicle import Friction
from pilotgen.errors import EvaluationError
from pilotgen.study.study import read_study

STUDIES = Path(__file__).parents[2] / "docs" / "studies"
COULOMB = Friction(5.0, 5.0, 0.02, 0.0, 2e-4)


@pytest.fixture(scope="module")
def context() -> Iterator[EvaluationContext]:
    with EvaluationContext(read_study(STUDIES / "puma-bmi.yaml")) as context:
        yield context


@pytest.fixture(scope="module")
def loop(context: EvaluationContext) -> ClosedLoop:
    changes = {"stature_m": 1.95, "age_years": 25.0, "inceptor.gearing_rad_per_m": 4.0}
    return close_in_deck(context, {**context.study.nominal, **changes})


@pytest.fixture(scope="module")
def model(context: EvaluationContext, loop: ClosedLoop) -> SwingModel:
    return SwingModel(context, loop)


def first_harmonic(force: np.ndarray) -> complex:
    n = len(force)
    return complex(2.0 / n * np.sum(force * np.exp(-2j * math.pi * np.arange(n) / n)))


@pytest.mark.parametrize("model", ["coulomb", "lugre"])
def test_describing_function_of_friction(model: str) -> None:
    """Far beyond presliding: 4 F/pi, in phase with the velocity; far within: a spring."""
    friction = Friction(10.0, 10.0, 0.02, 0.0, 2e-4, model)
    omega, n = 22.0, 64
    phase = np.exp(2j * math.pi * np.arange(n) / n)
    for amplitude in (0.02, 0.1):
        found = first_harmonic(friction_force(friction, (1j * omega * amplitude * phase).real, 2.0 * math.pi / omega))
        lag = 0.0 if model == "coulomb" else 1.5 * math.sqrt(2e-4 / amplitude)  # bristles turn around the ends
        assert abs(found - 4.0 * 10.0 / math.pi * 1j) < (2e-3 + lag) * 4.0 * 10.0 / math.pi
    if model == "lugre":
        small = first_harmonic(friction_force(friction, (1j * omega * 2e-5 * phase).real, 2.0 * math.pi / omega))
        expected = 2e-5 * (friction.bristle_n_per_m + 1j * omega * friction.bristle_n_s_per_m)
        assert abs(small - expected) < 0.02 * abs(expected)


def test_muscles_as_the_deck_has_them(context: EvaluationContext, loop: ClosedLoop) -> None:
    """Forces along a motion of the deck, from its lengths and activations."""
    motion = simulate(context, loop, disturbance("lever", 20.0), 0.8)
    law = MuscleLaw(muscle_data(loop.pilot), loop.gains.proportional_gain, loop.gains.derivative_gain)
    start = law.force(np.zeros((25, 1)), np.zeros((25, 1)))[:, 0]
    assert np.abs(start - motion.force[0]).max() < 1e-9 * np.abs(motion.force[0]).max()
    step = 1e-7
    stiff, damp = law.slopes()
    zero = np.zeros((25, 1))
    free = MuscleLaw(law.data, law.proportional_gain, law.derivative_gain, clipped=False)
    for slope, ends in ((stiff, (zero + step, zero)), (damp, (zero, zero + step))):
        found = (free.force(*ends) - free.force(*(-end for end in ends)))[:, 0] / (2.0 * step)
        assert np.abs(found - slope).max() < 1e-6 * np.abs(slope).max()


def test_small_swings_have_the_pole_of_the_linear_deck(context: EvaluationContext, loop: ClosedLoop) -> None:
    plain = SwingModel(context, loop, clipped=False, stops=False)
    small = HarmonicBalance(plain).first(1e-5)
    worst = max(plain.poles[(plain.poles.imag > 6.0) & (plain.poles.imag < 60.0)], key=lambda pole: pole.real)
    assert abs(small.pole - worst) < 1e-3
    assert small.amplitude_m == pytest.approx(1e-5, rel=1e-6)


def test_residuals_of_the_deck_along_small_motions_are_those_of_its_matrices(model: SwingModel) -> None:
    n = model.matrices.n
    rng = np.random.default_rng(5)
    y, ydot = 1e-7 * rng.standard_normal((3, n)), 1e-7 * rng.standard_normal((3, n))
    plain = SwingModel(model.deck.context, model.loop, clipped=False, stops=False).deck
    left, g_y, g_ydot = plain.with_tangents(y, ydot)
    expected = y @ model.g_y.T + ydot @ model.g_ydot.T
    assert np.abs(left - expected).max() < 1e-5 * np.abs(expected).max()
    assert np.abs(g_y - model.g_y).max() < 1e-5 * np.abs(model.g_y).max()
    assert np.abs(g_ydot - model.g_ydot).max() < 1e-5 * np.abs(model.g_ydot).max()
    assert np.array_equal(plain.along(y, ydot), left)
    with pytest.raises(EvaluationError, match="no finite value in sample 2 of 3"):
        y[1, 4] = math.nan
        plain.along(y, ydot)


def test_locked_deck_is_the_linear_deck_with_a_spring(model: SwingModel) -> None:
    locked = LinearDeck(model.g_y, model.g_ydot, model).at(3.0 + 40.0j)
    free = model.C @ np.linalg.solve((3.0 + 40.0j) * model.g_ydot + model.g_y, model.B.astype(complex))
    by_spring = np.linalg.inv(np.linalg.inv(free[:1, :1]) - 1e3)  # a spring of 1e3 N/m, forces against the motion
    assert abs(locked.receptances[0, 0] - by_spring[0, 0]) < 1e-8 * abs(by_spring[0, 0])


def test_a_swing_goes_through_the_equations_of_the_deck(model: SwingModel) -> None:
    """At instants between the samples of the balance: what is left of the equations, but for friction, is small."""
    balance = HarmonicBalance(model, None, 9)
    swing = balance.solve(HarmonicBalance(model).first(0.03), 0.03)
    t = 2.0 * math.pi * (np.arange(40) + 0.37) / 40
    turns = np.exp(1j * np.outer(np.arange(10), t))
    y = (swing.unknowns @ turns).real.T
    ydot = ((swing.unknowns * balance.exponents(swing.pole)) @ turns).real.T
    row = model.matrices.dof_names.index("lever.hz")
    left = model.deck.along(y, ydot)[:, row] / model.lever_length_m
    assert np.abs(left).max() < 0.3  # N at the grip, where the inertia of the lever alone takes 7 N


def test_limit_cycles_against_the_deck(context: EvaluationContext, model: SwingModel, loop: ClosedLoop) -> None:
    found = balanced(model, COULOMB)
    onset = found.onset
    assert onset is not None and onset.swing.harmonics == 9 and not found.lost
    by_deck = threshold(context, loop, COULOMB, duration_s=5.0, steps=7, between_n=(16.6, 16.9))
    assert by_deck is not None
    assert onset.swing.swing_m == pytest.approx(by_deck.swing_m, rel=0.01)
    assert onset.swing.frequency_hz == pytest.approx(by_deck.frequency_hz, rel=0.005)
    stable = found.cycles[-1]
    assert stable.stable and not stable.trouble
    motion = simulate(context, loop, disturbance("lever", 60.0), 6.0, friction=COULOMB)
    _, size, half = swings(motion, 4.5)
    assert stable.swing.swing_m == pytest.approx(size.mean(), rel=0.01)
    assert stable.swing.frequency_hz == pytest.approx(0.5 / half.mean(), rel=0.005)


def test_cycles_near_the_end_of_a_loops_cycles(context: EvaluationContext) -> None:
    # All harmonics of the first stable swing of the sweep converge to the unstable one here; the stable one lies beyond
    # other swings that die: the deck swings by 121.8 mm after a kick of 400 N, and dies after one of 250 N.
    changes = {"stature_m": 1.95, "bmi": 27.5, "age_years": 53.0, "inceptor.gearing_rad_per_m": 2.49}
    model = SwingModel(context, close_in_deck(context, {**context.study.nominal, **changes}))
    friction = Friction(8.3, 8.3, 0.02, 0.0, 2e-4)
    # One harmonic has two more in between; following swings with all harmonics from the first to the last meets none.
    first, last = balanced(model, friction).cycles
    assert (first.stable, last.stable) == (False, True) and first.trouble == last.trouble == ""
    assert first.swing.swing_m == pytest.approx(0.0986, rel=5e-3)
    assert last.swing.swing_m == pytest.approx(0.1218, rel=1e-2)
    grip = abs(model.lever_length_m * first.swing.unknowns[model.lever, 1])
    for share in (0.99, 1.01):  # growth changes its sign as the kind says
        around = HarmonicBalance(model, friction, 9).solve(first.swing, share * grip)
        assert (around.growth_rad_s > 0.0) is (share > 1.0)


def test_a_pair_of_cycles_that_the_deck_has_not_is_told_as_not_refined() -> None:
    # growth of one harmonic is above zero by 0.1 1/s near 103 mm; in the deck kicks of -200 to 400 N die
    study, _ = read_study(STUDIES / "puma-bmi.yaml").with_values(
        {"pilot.sex": "female", "inceptor.lever_length_m": 0.28, "inceptor.gearing_rad_per_m": 4.01}
    )
    with EvaluationContext(study) as context:
        values = {**study.nominal, "stature_m": 1.763, "bmi": 26.9, "age_years": 49.0}
        model = SwingModel(context, close_in_deck(context, values))
        found = balanced(model, Friction(3.1, 2.83, 0.02, 3.0, 2e-4))
    assert max(swing.growth_rad_s for swing in found.swings) < 0.3
    assert all(cycle.trouble for cycle in found.cycles)


def test_nyquist_curve_of_a_limit_cycle_passes_minus_one(model: SwingModel) -> None:
    found = balanced(model, COULOMB)
    for cycle in found.cycles:
        L = nyquist(found, cycle.swing, np.array([cycle.swing.frequency_hz]))
        assert abs(1.0 + L[0]) < 1e-7
    assert found.balance.friction is COULOMB
    half, whole = (balanced(model, scaled(COULOMB, force), 1).onset for force in (2.5, 5.0))
    assert half is not None and whole is not None
    assert half.swing.amplitude_m < whole.swing.amplitude_m


def test_what_cannot_be_refined_or_followed_is_told(model: SwingModel, monkeypatch: pytest.MonkeyPatch) -> None:
    solve = HarmonicBalance.solve

    def with_one_only(self: HarmonicBalance, start: Swing, amplitude_m: float | None, *rest: float) -> Swing:
        if self.K > 2 or (amplitude_m is not None and amplitude_m > 0.05):
            raise EvaluationError("harmonic balance", "it goes astray")
        return solve(self, start, amplitude_m, *rest)

    monkeypatch.setattr(HarmonicBalance, "solve", with_one_only)
    found = balanced(model, COULOMB)
    assert found.onset is not None and found.onset.swing.harmonics == 1
    assert found.onset.trouble == "refined with one harmonic only: it goes astray"
    assert found.lost.startswith("swings above ") and found.lost.endswith("were not followed: it goes astray")
    text = report_text({"study": "", **as_dict(found, None, None)})
    assert "refined with one harmonic only" in text and "were not followed" in text


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from pilotgen.cli import main

    study = read_study(STUDIES / "puma-friction.yaml")
    assert friction_of(study) == COULOMB
    output = tmp_path / "cycles"
    arguments = ["limit-cycles", str(STUDIES / "puma-friction.yaml"), "-o", str(output), "--quiet"]
    assert main([*arguments, "--harmonics", "1", "--map", "--frictions", "0", "20", "--gearings", "2"]) == 0
    content = json.loads((output / "limit_cycles.json").read_text())
    assert content["limit_cycles"][0]["stable"] is False
    row = content["map"]["smallest_swing_that_grows_mm"][0]
    assert row[0] == 0.0 and (row[1] is None or row[1] > content["limit_cycles"][0]["swing_mm"])
    assert content["map"]["smallest_kick_that_goes_on_n"] is None
    for name in ("growth.png", "nyquist.png", "onset.png"):
        assert (output / name).stat().st_size > 10_000
    capsys.readouterr()
    assert main([*arguments[:3], str(tmp_path / "other"), "--frictions", "3"]) == 1
    assert "add --map" in capsys.readouterr().err
    for harmonics, wanted in (("0", "0 is too few"), ("22", "22 is too many; 1 to 21"), ("2.5", "not a whole number")):
        with pytest.raises(SystemExit):
            main([*arguments[:3], str(tmp_path / "other"), "--harmonics", harmonics])
        assert wanted in capsys.readouterr().err
    assert not (tmp_path / "other").exists()
