"""Sums of partial fractions are the transfer functions they stand for, and the locus drawn from them is the same."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pilotgen.linear.feedthrough import mayo_pilot
from pilotgen.linear.partial_fractions import PartialFractions, poles_and_residues, washout
from pilotgen.linear.pilot_model import PilotModel
from pilotgen.linear.statespace import StateSpaceModel
from pilotgen.loop.heave_model import HeaveModel
from pilotgen.loop.locus import Locus
from pilotgen.loop.loop import LoopModel
from pilotgen.loop.margins import margins
from pilotgen.study.rotorcraft import load_rotorcraft

PUMA = HeaveModel(load_rotorcraft("iar330-puma"))
ROUNDINGS = 1000.0  # of the terms' moduli: the residues themselves come of sums; 150 at most were seen
OMEGA = np.concatenate(([0.0], np.geomspace(1e-2, 1e3, 60)))


def pilot(frequency_hz: float, damping: float, integrators: int, washout_rad_s: float | None, D: float) -> PilotModel:
    model = mayo_pilot(frequency_hz, damping, 0.1, 0.32, washout_rad_s)
    return dataclasses.replace(model, integrators=integrators, D=np.array([[D]]))


def loop_of(model: PilotModel, fractions: bool = True) -> LoopModel:
    A, B, C, D = model.state_space()
    system = StateSpaceModel(A, B[:, 0], C[0], float(D[0, 0]))
    return LoopModel(system, PUMA, 1.1, 0.32, model.partial_fractions() if fractions else None)


PILOTS = st.builds(
    pilot,
    st.floats(1.0, 8.0),
    st.floats(0.02, 0.9),
    st.sampled_from([0, 1, 2]),
    st.floats(0.5, 6.0),
    st.sampled_from([0.0, 0.02]),
)


@given(PILOTS)
def test_a_pilot_with_its_filters(model: PilotModel) -> None:
    fractions = model.partial_fractions()
    assert fractions is not None
    A, B, C, D = model.state_space()
    wanted = StateSpaceModel(A, B[:, 0], C[0], float(D[0, 0])).response(OMEGA)
    found = fractions.at(1j * OMEGA)
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-12 * np.abs(wanted).max())
    np.testing.assert_allclose(
        np.sort_complex(fractions.all_poles), np.sort_complex(np.linalg.eigvals(A)), rtol=1e-5
    )  # a double eigenvalue is known to the square root of the rounding error


def sums_of_moduli(f: PartialFractions, x: np.ndarray, tail: np.ndarray) -> dict[str, np.ndarray]:
    """Of L and its derivatives by x, each (m,): what rounding errors of the terms are measured by.

    Terms near each other cancel: a washout near a pole of the rotor has residues of 1e6 for a loop of 0.1.
    """
    p, q = np.where(tail, 1.0, x), np.where(tail, x, 1.0)
    R = np.abs(1.0 / ((1j * p)[:, None] - q[:, None] * f.poles))
    residues, first = np.abs(f.residues), R[:, 0]
    twice = np.abs(f.second)
    far = 2.0 * R**3 @ (residues * np.abs(f.poles)) + 2.0 * twice * first**3 * (1.0 + 3.0 * x * abs(f.poles[0]) * first)
    return {
        "L": abs(f.D) + q * (R @ residues) + q * q * twice * first**2,
        "slope": R**2 @ residues + 2.0 * q * twice * first**3,
        "curvature": np.where(tail, far, 2.0 * R**3 @ residues + 6.0 * twice * first**4),
    }


@given(PILOTS)
@example(pilot(1.0, 0.75, 2, 0.82421875, 0.0))
def test_the_locus_is_that_of_the_schur_form(model: PilotModel) -> None:
    loop = loop_of(model)
    fractions = loop.partial_fractions
    if fractions is None:
        assert not loop.pilot_fractions.times(PUMA.partial_fractions).apart  # type: ignore[union-attr]
        return
    quick, slow = Locus(loop.open_loop, fractions), Locus(loop.open_loop)
    x = np.concatenate((OMEGA[1:], [0.0, 1e-5, 1e-3, 2e-2]))
    for tail in (np.arange(x.size) >= OMEGA.size - 1, np.zeros(x.size, dtype=bool), np.ones(x.size, dtype=bool)):
        use = ~tail | (x < 0.1)
        found, wanted = quick.second(x[use], tail[use]), slow.second(x[use], tail[use])
        moduli = sums_of_moduli(fractions, x[use], tail[use])
        for name, a, b in zip(("L", "slope", "size", "curvature"), found, wanted, strict=True):
            if name != "size":  # a sum of moduli belongs to its terms
                bound = ROUNDINGS * np.finfo(float).eps * (moduli[name] + np.abs(b).max())
                assert (np.abs(a - b) <= bound).all(), name
        np.testing.assert_allclose(found[2], moduli["L"], rtol=1e-12)
        assert (np.abs(found[0]) <= found[2] * (1.0 + 1e-12)).all()
        for a, b in zip(quick.first(x[use], tail[use]), found, strict=False):
            np.testing.assert_allclose(a, b, rtol=1e-13)


@given(PILOTS)
def test_margins_do_not_depend_on_the_form(model: PilotModel) -> None:
    quick, slow = margins(loop_of(model)), margins(loop_of(model, fractions=False))
    assert quick.stable == slow.stable and len(quick.crossings) == len(slow.crossings)
    for a, b in zip(quick.crossings, slow.crossings, strict=True):
        assert a.kind == b.kind
        assert a.frequency_hz == pytest.approx(b.frequency_hz, rel=1e-9)
        assert abs(a.value - b.value) <= 1e-9 * abs(b.value)
    assert quick.gain_margin_db == pytest.approx(slow.gain_margin_db, abs=1e-8)
    assert quick.phase_margin_deg == pytest.approx(slow.phase_margin_deg, abs=1e-7)
    assert quick.modulus_margin == pytest.approx(slow.modulus_margin, rel=1e-9)
    assert quick.disk_margin == pytest.approx(slow.disk_margin, rel=1e-9)


def test_slope_is_the_derivative() -> None:
    fractions = pilot(3.4, 0.3, 1, 3.1, 0.0).partial_fractions()
    assert fractions is not None
    s, h = 1j * np.geomspace(0.1, 100.0, 9) - 0.7, 1e-4
    difference = (fractions.at(s + h) - fractions.at(s - h)) / (2.0 * h)
    np.testing.assert_allclose(fractions.slope(s), difference, rtol=1e-6)


def test_the_rotorcraft_over_its_poles() -> None:
    s = 1j * OMEGA
    numerator, denominator = PUMA.transfer_function
    assert PUMA.partial_fractions is not None
    wanted = np.polyval(numerator, s) / np.polyval(denominator, s)
    np.testing.assert_allclose(PUMA.partial_fractions.at(s), wanted, rtol=0.0, atol=1e-12 * np.abs(wanted).max())


def test_dependent_eigenvectors_have_no_residues() -> None:
    poles, residues = poles_and_residues(np.array([[-2.0, 1.0], [0.0, -2.0]]), np.ones(2), np.ones(2))
    assert residues is None
    np.testing.assert_allclose(poles, -2.0)


@pytest.mark.parametrize("integrators", [0, 1, 2])
def test_washout_in_closed_form(integrators: int) -> None:
    s = 1j * OMEGA
    wanted = s ** (2 - integrators) / (s + 3.1) ** 2
    np.testing.assert_allclose(washout(3.1, integrators).at(s), wanted, rtol=0.0, atol=1e-15)


def test_where_there_is_no_such_form() -> None:
    double = washout(3.1, 0)
    assert double.times(double) is None
    assert double.times(PartialFractions(np.array([-3.1 + 0j]), np.ones(1, dtype=complex))) is None
    assert pilot(3.4, 0.3, 1, None, 0.0).partial_fractions() is None  # an integrator that no washout cancels
    defective = dataclasses.replace(
        pilot(3.4, 0.3, 0, 3.1, 0.0), A=np.array([[-2.0, 1.0], [0.0, -2.0]]), B=np.ones(2), C=np.ones((1, 2))
    )
    assert defective.partial_fractions() is None
    # a pilot whose pole is the coning mode's, but for one part in ten thousand: the loop goes by the Schur form
    coning = PUMA.poles[np.argmax(PUMA.poles.imag)] * (1.0 + 1e-4)
    like_coning = pilot(abs(coning) / (2.0 * math.pi), -coning.real / abs(coning), 0, 3.1, 0.0)
    loop = loop_of(like_coning)
    assert loop.pilot_fractions is not None and loop.partial_fractions is None
    assert margins(loop).stable == margins(loop_of(like_coning, fractions=False)).stable
