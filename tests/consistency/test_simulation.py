"""The closed deck in time: small kicks follow the poles, large ones meet what is not linear."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest

from pilotgen.closed_loop.deck import ClosedLoop, close_in_deck
from pilotgen.closed_loop.poles import eigenvalues
from pilotgen.closed_loop.reach import check_kick
from pilotgen.closed_loop.simulate import (
    Fit,
    disturbance,
    exponentials,
    fit,
    free_from,
    grows,
    simulate,
)
from pilotgen.context import EvaluationContext
from pilotgen.decks.vehicle import Friction
from pilotgen.errors import PilotgenError
from pilotgen.study.study import read_study

STUDIES = Path(__file__).parents[2] / "docs" / "studies"


@pytest.fixture(scope="module")
def context() -> Iterator[EvaluationContext]:
    with EvaluationContext(read_study(STUDIES / "puma-bmi.yaml")) as context:
        yield context


def closed(context: EvaluationContext, **changes: float) -> ClosedLoop:
    paths = {"gearing": "inceptor.gearing_rad_per_m"}
    named = {paths.get(name, name): value for name, value in changes.items()}
    return close_in_deck(context, {**context.study.nominal, "stature_m": 1.95, **named})


def test_exponentials() -> None:
    t = np.arange(300) * 0.01
    poles = np.array([-0.5 + 20.0j, -3.0 + 23.0j, -1.0])
    signal = sum((np.exp(p * t) * a).real for p, a in zip(poles, (1.0, 0.3j, 0.2), strict=True))
    found, _ = exponentials(signal, 0.01)
    for pole in poles:
        assert np.abs(found - pole).min() < 1e-7


@pytest.mark.parametrize(("gearing", "duration_s"), [(1.1, 4.0), (2.5, 4.0)])
@pytest.mark.parametrize(("kind", "size"), [("lever", 0.01), ("gust", 0.01), ("pull", 1e-4)])
def test_small_kicks_follow_the_poles(
    context: EvaluationContext, kind: str, size: float, gearing: float, duration_s: float
) -> None:
    loop = closed(context, gearing=gearing)
    poles = eigenvalues(loop.linearise(context, loop.deck(), Path(context.scratch)))
    motion = simulate(context, loop, disturbance(kind, size), duration_s, linear=True)
    found = fit(motion, free_from(kind, None) + 0.3, duration_s)
    assert isinstance(found, Fit)
    own = complex(found.growth_rad_s, found.omega_rad_s)
    assert np.abs(poles - own).min() < 3e-4 * abs(own)
    dominant = poles[(poles.imag > 6.0) & (poles.imag < 60.0)]
    assert abs(own - dominant[np.argmax(dominant.real)]) < 3e-4 * abs(own)


def test_both_integrators(context: EvaluationContext) -> None:
    loop = closed(context)
    by = [
        simulate(context, loop, disturbance("lever", 20.0), 1.0, integrator=integrator) for integrator in ("ms", "ida")
    ]
    assert np.abs(by[0].travel - by[1].travel).max() < 2e-3 * np.abs(by[1].travel).max()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_both_integrators_with_coulomb_friction(sign: float, context: EvaluationContext) -> None:
    """A pull that lets the lever stick, come free and turn back."""
    loop = closed(context, gearing=2.5)
    coulomb = Friction(3.0, 3.0, 0.02, 0.0, 2e-4)
    pull = disturbance("pull", sign * 0.05)
    by = [
        simulate(context, loop, pull, 0.9, friction=coulomb, integrator=integrator, step_s=h)
        for integrator, h in (("ida", 1e-3), ("ms", 1e-3), ("ms", 5e-4))
    ]
    exact, swing = by[0].travel, np.abs(by[0].travel).max()
    assert swing > 0.02
    off = [np.abs(by[1].travel - exact).max() / swing, np.abs(by[2].travel[::2] - exact).max() / swing]
    assert off[0] < 4e-3 and off[1] < 0.7 * off[0], off


def test_friction_holds_small_kicks_only(context: EvaluationContext) -> None:
    loop = closed(context, gearing=3.0)
    coulomb = Friction(5.0, 5.0, 0.02, 0.0, 2e-4)
    small, large, none = (
        simulate(context, loop, disturbance("lever", size), 6.0, friction=friction)
        for size, friction in ((20.0, coulomb), (60.0, coulomb), (5.0, None))
    )
    assert not grows(small)
    assert grows(large) and large.hits_stop
    assert grows(none) and none.clipped > 0.2
    lugre = simulate(
        context, loop, disturbance("lever", 20.0), 2.0, friction=Friction(5.0, 5.0, 0.02, 0.0, 2e-4, "lugre")
    )
    assert np.abs(lugre.travel - small.travel[: len(lugre.travel)]).max() < 0.15 * np.abs(small.travel).max()


def test_steps_of_any_length(context: EvaluationContext) -> None:
    """Below 0.6 ms the force on the seat made the solver's matrices look singular."""
    loop = closed(context)
    kicked = [simulate(context, loop, disturbance("lever", 5.0), 0.6, step_s=h) for h in (1e-3, 2.5e-4)]
    assert np.abs(kicked[0].travel - kicked[1].travel[::4]).max() < 1e-3 * np.abs(kicked[0].travel).max()


def test_a_pull_beyond_the_stops(context: EvaluationContext) -> None:
    with pytest.raises(PilotgenError, match=r"which are -112 and 112 mm from its place; 0.112 m"):
        check_kick(closed(context), "pull", 0.2)


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from pilotgen.cli import main

    output = tmp_path / "simulated"
    arguments = ["simulate", str(STUDIES / "quick.yaml"), "-o", str(output), "--duration", "2", "--kicks", "3"]
    assert main([*arguments, "--set", "inceptor.friction.breakout_n=10", "--quiet"]) == 0
    content = json.loads((output / "simulation.json").read_text())
    assert content["friction_n"] == 10.0 and content["goes_on"] is False
    assert content["onset"]["chance"]["of"] == 3
    with h5py.File(output / "animation.h5") as file:
        assert file["position"].shape == (101, len(file["nodes"]), 3)
        grip = file["rotation_vector"][:, list(file["nodes"].asstr()).index("lever"), 2]
    assert np.ptp(grip) * 0.32e3 == pytest.approx(content["largest_grip_travel_mm"], rel=0.02)
    assert (output / "history.png").stat().st_size > 10_000
    capsys.readouterr()
    other = ["simulate", str(STUDIES / "quick.yaml"), "-o", str(tmp_path / "other")]
    for more, wanted in (
        (["--kick", "pull", "--size", "0.3"], "beyond its stops"),
        (["--kick", "turbulence", "--pulse", "0.2"], "turbulence has none"),
        (["--linear", "--kicks", "3"], "leave one out"),
    ):
        assert main([*other, *more, "--overwrite"]) == 1
        assert wanted in capsys.readouterr().err
