"""The golden arm: one arm on a collective lever, 25 reflexive muscles, linearised by MBDyn.

Matrices: MBDyn develop (2025-06) on the deck stored in the case, 17 digits, c = 0.01 s. Numbers: measured on those
matrices and on an independent model in two minimal coordinates (10 joint coordinates, 8 constraints solved exactly,
stiffness and damping by differences of its own residual), which agree to 1e-12.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from linear_models import ARM_CHANNELS, ARM_LEVER_LENGTH_M, CASES, case, dense_eigenvalues, raw_case, sort
from numpy.testing import assert_allclose

from pilotgen.linear.compare import compare, report
from pilotgen.linear.feedthrough import certificate, make_pilot_model
from pilotgen.linear.full_order import full_order_response
from pilotgen.linear.imposed_motion import split
from pilotgen.linear.modal import modes
from pilotgen.linear.pilot_model import PilotModel
from pilotgen.solver.matrices import Matrices, descriptor, read_matrices
from pilotgen.solver.mbdyn_files import to_textbook

HZ = np.array([0.5, 1.0, 2.0, 3.0, 3.5, 5.0, 8.0])
# grip arc = lever length x |H| [mm per m/s^2] and phase [deg]
FULL_ORDER_MM = [0.719566, 0.767238, 1.024649, 1.672670, 1.575695, 0.502453, 0.143265]
FULL_ORDER_DEG = [176.30, 172.09, 158.49, 116.89, 76.83, 25.75, 11.59]
LITERAL_MM = [31.7667, 8.5227, 2.9181, 2.2015, 1.5586, 0.2604, 0.0345]
LITERAL_DEG = [179.9, 179.3, 172.6, 137.3, 100.1, 56.9, 56.5]


def model(name: str = "arm_right", projection: str = "exact") -> PilotModel:
    """The arm's feedthrough without washout."""
    return make_pilot_model(case(name), ARM_LEVER_LENGTH_M, None, projection, ARM_CHANNELS)


def test_poles() -> None:
    frequency, damping = np.array([list(pole.values()) for pole in model().pole_list()]).T
    assert_allclose(frequency, [3.342573, 4.694728], atol=1e-6)
    assert_allclose(100.0 * damping, [20.886, 38.246], atol=5.5e-4)


def test_poles_of_the_in_line_variant() -> None:
    frequency, damping = np.array([list(pole.values()) for pole in model("arm_inline").pole_list()]).T
    assert_allclose(frequency, [3.36985, 4.76090], atol=5.5e-6)
    assert_allclose(100.0 * damping, [20.575, 37.815], atol=5.5e-4)


def test_feedthrough_has_the_printed_digits() -> None:
    motion = model().grip_motion(2.0 * np.pi * HZ)
    assert_allclose(1e3 * np.abs(motion), FULL_ORDER_MM, atol=6e-7)
    assert_allclose(np.degrees(np.angle(motion)), FULL_ORDER_DEG, atol=6e-3)


def test_literal_formula_has_the_printed_digits() -> None:
    motion = model(projection="literal").grip_motion(2.0 * np.pi * HZ)
    assert_allclose(1e3 * np.abs(motion), LITERAL_MM, atol=6e-5)
    assert_allclose(np.degrees(np.angle(motion)), LITERAL_DEG, atol=6e-2)


def test_modal_form_is_the_full_order_response() -> None:
    """Against all 88 unknowns solved as they stand, momenta and reactions included."""
    arm = model()
    imposed = split(descriptor(case("arm_right")), ARM_CHANNELS)
    assert len(imposed.free.names) == 88
    for hz in np.geomspace(0.1, 20.0, 50):
        s = 2j * np.pi * hz
        solution = np.linalg.solve(
            s * imposed.free.g_ydot + imposed.free.g_y, -(s * imposed.g_ydot_imposed + imposed.g_y_imposed)[:, 0]
        )
        assert_allclose(imposed.output_matrix @ solution / s**2, arm.response(2.0 * np.pi * hz), rtol=2e-9)
    assert_allclose(full_order_response(imposed, 2.0 * np.pi * HZ), arm.response(2.0 * np.pi * HZ), rtol=1e-11)
    assert certificate(arm) < 1e-9
    assert arm.translation_error is not None and arm.translation_error < 1e-12


def test_residues() -> None:
    """Modal residues in lever rotation: 0.02387 of the low pair against 0.00044."""
    arm = model()
    assert arm.residues is not None
    assert_allclose(np.abs(arm.residues[0, :, 0])[::2], [0.02387, 0.00044], atol=5e-6)
    assert arm.dominant_pair()[0] == pytest.approx(3.342573, abs=1e-6)


def test_full_pencil_by_qz() -> None:
    free = split(descriptor(case("arm_right")), ARM_CHANNELS).free
    modal = modes(free)
    assert len(modal.lam) == 4 and modal.n_zero == 0 and modal.n_infinite == 0
    assert_allclose(dense_eigenvalues(free, largest=200.0), sort(modal.lam), rtol=1e-7)


def test_cayley_pair() -> None:
    """(Lam J(c) - J(-c)) Y = 0, lam = (1/c)(Lam-1)/(Lam+1); the printed plus sign gives 1/(c^2 lam) instead."""
    matrices = case("arm_right")
    lam = sort(modes(descriptor(matrices)).lam)
    c = matrices.c
    for sign in (-1.0, 1.0):
        with np.errstate(all="ignore"):
            Lam = scipy.linalg.eigvals(-sign * matrices.J_minus, matrices.J_plus)
            recovered = (Lam - 1.0) / (Lam + 1.0) / c
            found = recovered if sign < 0.0 else 1.0 / (c**2 * recovered)
        found = found[np.isfinite(found)]
        nearest = np.array([found[np.argmin(np.abs(found - value))] for value in lam])
        assert_allclose(nearest, lam, rtol=1e-7)


def test_count_of_mbdyn_s_own_eigenvalues() -> None:
    """68 at +1 (two per constraint of the five bodies, twelve of the clamped seat), 28 at -1, 4 physical."""
    alpha_re, alpha_im, beta = np.load(CASES / "arm_right.npz")["alpha"].T
    Lam = (alpha_re + 1j * alpha_im) / beta
    at_plus, at_minus = np.abs(Lam - 1.0) < 1e-3, np.abs(Lam + 1.0) < 1e-3
    assert (at_plus.sum(), at_minus.sum(), (~at_plus & ~at_minus).sum()) == (68, 28, 4)
    physical = Lam[~at_plus & ~at_minus]
    lam = (physical - 1.0) / (physical + 1.0) / 0.01
    assert_allclose(sort(lam), sort(modes(descriptor(case("arm_right"))).lam), rtol=1e-8)


# ---- the same deck through this program's own solver


def linearise(mbdae: Path, directory: Path, c: float | None = None, **constants: float) -> Matrices:
    """Linearise the golden arm's deck with other values of its constants (KP, KD)."""
    text = str(np.load(CASES / "arm_right.npz")["deck"])
    for name, value in constants.items():
        text, count = re.subn(rf"^(set: const real {name} = )[^;]+;", rf"\g<1>{value!r};", text, flags=re.MULTILINE)
        assert count == 1
    (directory / "arm.mbd").write_text(text)
    coefficient = [] if c is None else ["-c", repr(c)]
    subprocess.run([mbdae, "-q", *coefficient, "arm.mbd", "-o", "arm"], cwd=directory, check=True)
    return read_matrices(directory / "arm.h5")


def test_own_solver_repeats_mbdyn(mbdae: Path, tmp_path: Path) -> None:
    ours = linearise(mbdae, tmp_path)
    comparison = compare(ours, to_textbook(raw_case("arm_right"), ours), tolerance=1e-12)
    assert comparison.agree, report(comparison)
    own = make_pilot_model(ours, ARM_LEVER_LENGTH_M)
    omega = 2.0 * np.pi * np.geomspace(0.1, 20.0, 60)
    assert_allclose(own.response(omega), model().response(omega), rtol=1e-10)
    assert certificate(own) < 1e-9


@pytest.mark.parametrize("c", [1e-5, 0.5])
def test_feedthrough_does_not_depend_on_c(mbdae: Path, tmp_path: Path, c: float) -> None:
    own = make_pilot_model(linearise(mbdae, tmp_path, c), ARM_LEVER_LENGTH_M)
    omega = 2.0 * np.pi * np.geomspace(0.1, 20.0, 60)
    assert_allclose(own.response(omega), model().response(omega), rtol=1e-9)


def test_calibration_to_mayo_s_mesomorphic_pair(mbdae: Path, tmp_path: Path) -> None:
    """Gains found with MBDyn: 3.750000 Hz / 28.0000 %, second pair 5.3088 Hz / 47.95 %, residues 62 : 1."""
    own = make_pilot_model(linearise(mbdae, tmp_path, KP=1.514319, KD=0.098821), ARM_LEVER_LENGTH_M)
    frequency, damping = np.array([list(pole.values()) for pole in own.pole_list()]).T
    assert frequency[0] == pytest.approx(3.750000, abs=1e-6) and frequency[1] == pytest.approx(5.3088, abs=5.5e-5)
    assert damping[0] == pytest.approx(0.280000, abs=1e-6) and damping[1] == pytest.approx(0.4795, abs=5.5e-5)
    motion = own.grip_motion(2.0 * np.pi * np.array([1.0, 3.0, 3.75, 5.0, 8.0]))
    assert_allclose(1e3 * np.abs(motion), [0.595, 0.974, 0.999, 0.516, 0.147], atol=6e-4)
    assert_allclose(np.degrees(np.angle(motion)), [170.8, 128.4, 89.5, 43.1, 18.1], atol=0.06)
    assert own.residues is not None
    low, high = np.abs(own.residues[0, :, 0])[::2]
    assert low / high == pytest.approx(62.0, abs=0.5)


def test_light_damping_and_no_reflex(mbdae: Path, tmp_path: Path) -> None:
    """Kp 1, Kd 0: 3.05 Hz / 11 %, 3.86 mm at 3 Hz. No reflex at all: unstable, +3.2 1/s."""
    light = make_pilot_model(linearise(mbdae, tmp_path, KP=1.0, KD=0.0), ARM_LEVER_LENGTH_M)
    assert_allclose(light.dominant_pair(), [3.05, 0.11], atol=5e-3)
    assert 1e3 * abs(light.grip_motion(2.0 * np.pi * 3.0)) == pytest.approx(3.86, abs=5e-3)
    bare = make_pilot_model(linearise(mbdae, tmp_path, KP=0.0, KD=0.0), ARM_LEVER_LENGTH_M)
    assert bare.poles.real.max() == pytest.approx(3.2, abs=0.05)
    assert certificate(bare) < 1e-8
