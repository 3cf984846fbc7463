"""Margins of strange loops against an implementation that shares nothing with them.

The reference knows a loop by its zeros, poles and gain, or by its residues; it multiplies or adds the factors on a
dense grid, finds sign changes, and bisects them. Stability is counted from the locus (Nyquist), not from eigenvalues.
Where python-control's frequency-data route is reliable it is asked too.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pilotgen.linear.statespace import StateSpaceModel, zeros_poles_gain
from pilotgen.loop.margins import Margins, margins

TWO_PI = 2.0 * math.pi
Response = Callable[[np.ndarray], np.ndarray]


def pair(omega: float, zeta: float) -> list[complex]:
    p = complex(-zeta * omega, omega * math.sqrt(1.0 - zeta * zeta))
    return [p, p.conjugate()]


def product(zeros: list[complex], poles: list[complex], gain: float) -> Response:
    def response(omega: np.ndarray) -> np.ndarray:
        s = 1j * omega
        value = np.full(omega.shape, gain, dtype=complex)
        for i, p in enumerate(poles):
            value = value * ((s - zeros[i]) if i < len(zeros) else 1.0) / (s - p)
        return value

    return response


@dataclass(frozen=True)
class Reference:
    real_axis: list[tuple[float, complex]]
    unit_circle: list[tuple[float, complex]]
    modulus_margin: float
    disk_margin: float
    low: float
    high: float

    @property
    def gain_margin_db(self) -> float:
        return min((abs(20.0 * math.log10(abs(L))) for _, L in self.real_axis), default=math.inf)

    @property
    def phase_margin_deg(self) -> float:
        return min((abs(math.degrees(np.angle(-L))) for _, L in self.unit_circle), default=math.inf)


def reference(response: Response, roots: list[complex], points: int = 40_000) -> Reference:
    """Dense grid over eight decades, denser around every resonance; sign changes bisected to the last digit."""
    sizes = [abs(r) for r in roots if abs(r) > 0.0] or [1.0]
    low, high = 1e-4 * min(sizes), 1e4 * max(sizes)
    parts = [np.geomspace(low, high, points)]
    for r in roots:
        width = max(abs(r.real), 1e-7 * abs(r))
        if r.imag > 0.0:
            parts.append(r.imag + width * np.sinh(np.linspace(-14.0, 14.0, 3001)))
    omega = np.unique(np.concatenate(parts))
    omega = omega[(omega >= low) & (omega <= high)]
    L = response(omega)
    finite = np.isfinite(L)
    omega, L = omega[finite], L[finite]

    def bisect(function: Callable[[np.ndarray], np.ndarray], i: np.ndarray) -> list[tuple[float, complex]]:
        a, b = omega[i], omega[i + 1]
        at_a = function(response(a)) >= 0.0
        for _ in range(60):
            middle = 0.5 * (a + b)
            same = (function(response(middle)) >= 0.0) == at_a
            a, b = np.where(same, middle, a), np.where(same, b, middle)
        return list(zip(a.tolist(), response(a).tolist(), strict=True))

    def changes(values: np.ndarray) -> np.ndarray:
        return np.nonzero((values[:-1] >= 0.0) != (values[1:] >= 0.0))[0]

    axis = [x for x in bisect(np.imag, changes(L.imag)) if -1e10 < x[1].real < -1e-10 and abs(x[1].imag) < abs(x[1])]
    circle = bisect(lambda v: np.abs(v) - 1.0, changes(np.abs(L) - 1.0))

    def lowest(function: Callable[[np.ndarray], np.ndarray]) -> float:
        """The smallest of the twenty lowest local minima of the grid, each zoomed into three times."""
        size = function(L)
        dips = np.nonzero((size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:]))[0] + 1
        best = float(size.min())
        for i in dips[np.argsort(size[dips])[:20]]:
            a, b = omega[i - 1], omega[i + 1]
            for _ in range(3):
                fine = np.linspace(a, b, 201)
                values = function(response(fine))
                j = int(values.argmin())
                best = min(best, float(values[j]))
                a, b = fine[max(j - 1, 0)], fine[min(j + 1, 200)]
        return best

    return Reference(
        axis,
        circle,
        lowest(lambda v: np.abs(1.0 + v)),
        lowest(lambda v: 2.0 * np.abs(1.0 + v) / np.abs(1.0 - v)),
        low,
        high,
    )


def inside(m: Margins, kind: str, low: float, high: float) -> list[tuple[float, complex]]:
    found = [(TWO_PI * c.frequency_hz, c.value) for c in m.crossings if c.kind == kind]
    return [x for x in found if low < x[0] < high]


def compare(m: Margins, ref: Reference, db: float = 1e-6, deg: float = 1e-5) -> None:
    for kind, expected in (("real axis", ref.real_axis), ("unit circle", ref.unit_circle)):
        mine = inside(m, kind, ref.low, ref.high)
        assert len(mine) == len(expected), (kind, mine, expected)
        for (w, L), (w_ref, L_ref) in zip(mine, expected, strict=True):
            assert w == pytest.approx(w_ref, rel=1e-7)
            if kind == "real axis":
                assert abs(20.0 * math.log10(abs(L) / abs(L_ref))) < db
            else:
                assert abs(math.degrees(np.angle(L / L_ref))) < deg
    assert m.modulus_margin == pytest.approx(ref.modulus_margin, rel=1e-6, abs=1e-9)
    if m.stable:
        assert m.disk_margin == pytest.approx(ref.disk_margin, rel=1e-6, abs=1e-9)


def nyquist_stable(response: Response, poles: list[complex], low: float, high: float) -> bool:
    """Unstable closed-loop poles = unstable open-loop poles - counter-clockwise turns around -1; none on the axis."""
    parts = [np.geomspace(low, high, 200_000)]
    for p in poles:
        if p.imag > 0.0:
            parts.append(p.imag + abs(p.real) * np.sinh(np.linspace(-16.0, 16.0, 4001)))
    omega = np.unique(np.concatenate(parts))
    omega = omega[(omega >= low) & (omega <= high)]
    F = 1.0 + response(omega)
    turn = np.angle(F[1:] / F[:-1]).sum()
    turn += np.angle(F[0]) - (math.pi if F[0].real < 0.0 else 0.0) * np.sign(np.angle(F[0]))  # from the real axis
    turn -= np.angle(F[-1]) - (math.pi if F[-1].real < 0.0 else 0.0) * np.sign(np.angle(F[-1]))  # to the real axis
    encirclements = round(turn / math.pi)  # twice the half locus
    return sum(p.real > 0.0 for p in poles) - encirclements == 0


W = 2.0 * math.pi * 3.4
# name, zeros, poles, gain
NASTY: list[tuple[str, list[complex], list[complex], float]] = [
    ("first-order lag", [], [-1.0], 5.0),
    ("lag with negative gain", [], [-1.0], -0.9),
    ("double pole washout", [0.0], [-3.1, -3.1], 8.0),
    ("triple lag near its limit", [], [-1.0, -1.0, -1.0], 7.99),
    ("tenfold lag", [], [-1.0] * 10, 1.2),
    ("integrator and lag", [], [0.0, -1.0, -5.0], 20.0),
    ("double integrator with lead", [-0.2], [0.0, 0.0, -10.0], 3.0),
    ("triple integrator, conditionally stable", [-0.1, -0.3], [0.0, 0.0, 0.0], 4.0),
    ("mode of damping 1e-4, collocated", [*pair(9.0, 1e-4)], [*pair(10.0, 1e-4), -30.0], 40.0),
    ("mode of damping 1e-4, wrong phase", [], [*pair(W, 1e-4), -1.0], -0.05),
    ("twin modes a part in 1e-5 apart", [*pair(10.00005, 1e-6)], [*pair(10.0, 1e-4), *pair(10.0001, 1e-4)], 3.0),
    ("three modes, many crossings", [*pair(2.0, 1e-3), *pair(8.0, 1e-3)],
     [*pair(1.0, 1e-3), *pair(5.0, 1e-3), *pair(20.0, 1e-3)], 40.0),
    ("open-loop unstable, stabilised", [-1.0], [2.0, -10.0], 30.0),
    ("open-loop unstable, not stabilised", [-1.0], [2.0, -10.0], 5.0),
    ("unstable mode, stabilised", [-0.5], [*pair(3.0, -0.05), -40.0], 150.0),
    ("non-minimum phase", [2.0], [-1.0, -4.0], -1.5),
    ("non-minimum phase notch", [*pair(5.0, -1e-3)], [*pair(5.2, 0.01)], 0.95),
    ("direct term negative", [-30.0, -2.0], [-1.0, -5.0], -0.6),
    ("direct term above one", [*pair(3.0, 0.1)], [*pair(4.0, 0.2)], 1.7),
    ("far zero", [-1e6], [-1.0, -2.0, -3.0], 1e-4),
    ("poles over ten decades", [-1e-3], [-1e-5, -1e-1, -1e3, -1e5], 1e7),
    ("slow and fast resonance", [0.0, 0.0], [*pair(1e-3, 1e-3), *pair(1e3, 1e-3)], 3e3),
    ("zero on the axis", [3j, -3j], [-1.0, -1.0, -20.0], 25.0),
    ("washed-out pilot on a coning rotor", [0.0, 0.0, -1 / 0.06],
     [-3.1, -3.1, *pair(TWO_PI * 2.5, 0.2), -0.82, *pair(29.2, 0.514)], 1.1e5),
]  # fmt: skip


@pytest.mark.parametrize(("zeros", "poles", "gain"), [case[1:] for case in NASTY], ids=[case[0] for case in NASTY])
def test_nasty_loops(zeros: list[complex], poles: list[complex], gain: float) -> None:
    response = product(zeros, poles, gain)
    m = margins(zeros_poles_gain(zeros, poles, gain))
    ref = reference(response, zeros + poles)
    # A response with poles at part-in-1e5 distances loses digits in any state space; it is no smooth loop.
    loose = 100.0 if any(0 < -p.real < 1e-3 * abs(p) for p in poles) else 1.0
    compare(m, ref, db=1e-6 * loose, deg=1e-5 * loose)
    if all(p.real != 0.0 for p in poles):
        assert m.stable == nyquist_stable(response, poles, ref.low * 1e-2, ref.high * 1e2)
    # The margin itself: the smallest over all crossings, those at 0 and infinity included.
    ends = [c for c in m.crossings if c.kind == "real axis" and not 0.0 < c.frequency_hz < math.inf]
    smallest = min([ref.gain_margin_db] + [abs(c.gain_db) for c in ends])
    assert abs(m.gain_margin_db) == pytest.approx(smallest, abs=1e-6 * loose)
    assert abs(m.phase_margin_deg) == pytest.approx(ref.phase_margin_deg, abs=1e-5 * loose)


def random_loop(rng: np.random.Generator) -> tuple[list[complex], list[complex], float]:
    """Up to 8 poles between 0.03 and 30 rad/s, damping from 1e-4, some unstable, some at the origin."""

    def roots(count: int) -> list[complex]:
        out: list[complex] = []
        while len(out) < count:
            omega = 10.0 ** rng.uniform(-1.5, 1.5)
            side = -1.0 if rng.random() < 0.1 else 1.0
            if count - len(out) >= 2 and rng.random() < 0.7:
                out += pair(omega, side * min(10.0 ** rng.uniform(-4.0, 0.0), 0.99))
            else:
                out.append(complex(-side * omega))
        return out

    poles = roots(int(rng.integers(1, 9)))
    zeros = roots(int(rng.integers(0, len(poles) + 1)))
    if rng.random() < 0.25:
        real = [i for i, p in enumerate(poles) if p.imag == 0.0]
        if real:
            poles[real[0]] = 0j
    sample = np.abs(product(zeros, poles, 1.0)(10.0 ** rng.uniform(-1.0, 1.0, 5)))
    gain = 10.0 ** rng.uniform(-1.5, 1.0) / float(np.median(sample)) * float(rng.choice([1.0, -1.0]))
    return zeros, poles, gain


@settings(max_examples=60, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1))
def test_random_loops_against_the_dense_grid(seed: int) -> None:
    rng = np.random.default_rng(seed)
    zeros, poles, gain = random_loop(rng)
    if not zeros_fit(zeros, poles):
        return
    response = product(zeros, poles, gain)
    m = margins(zeros_poles_gain(zeros, poles, gain))
    compare(m, reference(response, zeros + poles), db=1e-4, deg=1e-3)
    if all(p != 0 for p in poles) and m.modulus_margin > 1e-6:
        sizes = [abs(r) for r in zeros + poles if r != 0]
        assert m.stable == nyquist_stable(response, poles, 1e-7 * min(sizes), 1e7 * max(sizes))


def zeros_fit(zeros: list[complex], poles: list[complex]) -> bool:
    """Whether zeros and poles pair into sections: not two complex zeros over two single real poles apart."""
    complex_zeros = sum(z.imag > 0.0 for z in zeros)
    return complex_zeros <= sum(p.imag > 0.0 for p in poles) and len(zeros) <= len(poles) - len(poles) % 2


def random_modal_loop(rng: np.random.Generator, modes: int) -> tuple[StateSpaceModel, Response, list[complex]]:
    """A sum of lightly damped modes, as a modal pilot or airframe model has them, with its response from residues."""
    omega = 10.0 ** rng.uniform(-1.0, 1.5, modes)
    zeta = 10.0 ** rng.uniform(-4.0, -0.3, modes)
    lam = omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
    residue = (rng.normal(size=modes) + 1j * rng.normal(size=modes)) * omega * zeta * 10.0 ** rng.uniform(-1.0, 1.5)
    A, B, C = np.zeros((2 * modes, 2 * modes)), np.zeros(2 * modes), np.zeros(2 * modes)
    for k in range(modes):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[lam[k].real, lam[k].imag], [-lam[k].imag, lam[k].real]]
        B[2 * k] = 1.0
        C[2 * k : 2 * k + 2] = 2.0 * residue[k].real, -2.0 * residue[k].imag

    def response(w: np.ndarray) -> np.ndarray:
        total = np.zeros(w.shape, dtype=complex)
        for p, r in zip(lam, residue, strict=True):
            total += (2.0 * r.real * (1j * w - p.real) + 2.0 * r.imag * p.imag) / ((1j * w - p.real) ** 2 + p.imag**2)
        return total

    return StateSpaceModel(A, B, C, 0.0), response, [complex(p) for p in lam]


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("modes", [4, 30])
def test_lightly_damped_modal_loops(seed: int, modes: int) -> None:
    model, response, lam = random_modal_loop(np.random.default_rng([seed, modes]), modes)
    np.testing.assert_allclose(model.response([0.7, 3.0]), response(np.array([0.7, 3.0])), rtol=1e-9)
    m = margins(model)
    compare(m, reference(response, lam), db=1e-6, deg=1e-5)
    if m.modulus_margin > 1e-3:
        poles = lam + [p.conjugate() for p in lam]
        assert m.stable == nyquist_stable(response, poles, 1e-5, 1e5)


@pytest.mark.parametrize("index", [3, 5, 6, 7, 12, 14, 23])
def test_python_control_on_frequency_data(index: int) -> None:
    """control.stability_margins on (magnitude, phase, omega) interpolates; it agrees to the fineness of its grid."""
    control = pytest.importorskip("control")
    _, zeros, poles, gain = NASTY[index]
    m = margins(zeros_poles_gain(zeros, poles, gain))
    omega = np.geomspace(1e-2, 1e3, 4001)
    L = product(zeros, poles, gain)(omega)
    gm, pm, *_ = control.stability_margins((np.abs(L), np.degrees(np.unwrap(np.angle(L))), omega), returnall=True)
    assert len(gm) == sum(c.kind == "real axis" and 0.0 < c.frequency_hz < math.inf for c in m.crossings)
    assert len(pm) == sum(c.kind == "unit circle" for c in m.crossings)
    if len(gm):
        assert abs(m.gain_margin_db) == pytest.approx(np.abs(20.0 * np.log10(gm)).min(), abs=1e-3)
    if len(pm):
        wrapped = (np.array(pm) + 180.0) % 360.0 - 180.0
        assert abs(m.phase_margin_deg) == pytest.approx(np.abs(wrapped).min(), abs=1e-2)


@pytest.mark.parametrize("index", [0, 3, 5, 8, 15, 23])
def test_disk_margin_against_python_control(index: int) -> None:
    control = pytest.importorskip("control")
    _, zeros, poles, gain = NASTY[index]
    model = zeros_poles_gain(zeros, poles, gain)
    m = margins(model)
    if not m.stable:
        assert m.disk_margin == 0.0
        return
    centre = TWO_PI * m.disk_margin_hz if 0.0 < m.disk_margin_hz < math.inf else 1.0
    omega = np.concatenate((np.geomspace(1e-4, 1e5, 4001), centre * np.linspace(0.999, 1.001, 2001)))
    system = control.ss(model.A, model.B[:, None], model.C[None, :], model.D)
    alpha, _, _ = control.disk_margins(system, np.sort(omega))
    assert m.disk_margin == pytest.approx(alpha, rel=1e-6)


@pytest.mark.parametrize("case", [case for case in NASTY if case[0] in {
    "triple lag near its limit", "integrator and lag", "double integrator with lead", "unstable mode, stabilised",
    "open-loop unstable, stabilised",
}], ids=lambda case: case[0])  # fmt: skip
def test_delay_margin_by_turning_the_locus(case: tuple[str, list[complex], list[complex], float]) -> None:
    """L exp(-j w tau) passes -1 at the delay margin and not before: exact phase, no rational approximation."""
    _, zeros, poles, gain = case
    m = margins(zeros_poles_gain(zeros, poles, gain))
    assert m.stable and 0.0 < m.delay_margin_s < math.inf
    omega = np.unique(np.concatenate(
        [np.geomspace(1e-4, 1e4, 400_000)]
        + [TWO_PI * c.frequency_hz * np.linspace(0.99, 1.01, 40_001) for c in m.crossings if c.frequency_hz > 0.0]
    ))  # fmt: skip
    L = product(zeros, poles, gain)(omega)
    distance = [
        np.abs(1.0 + L * np.exp(-1j * omega * tau)).min() for tau in m.delay_margin_s * np.array([0.5, 0.9, 1.0])
    ]
    assert distance[2] < 1e-3 * m.modulus_margin
    assert min(distance[0], distance[1]) > 1e-2 * m.modulus_margin


@pytest.mark.parametrize("case", NASTY, ids=lambda case: case[0])
def test_margins_are_where_stability_ends(case: tuple[str, list[complex], list[complex], float]) -> None:
    """A gain change below the gain margin keeps stability as it is; just beyond, one direction changes it."""
    _, zeros, poles, gain = case
    model = zeros_poles_gain(zeros, poles, gain)
    m = margins(model)
    size = abs(m.gain_margin_db)
    if size > 200.0 or size < 1e-3:
        return
    for share in (-0.98, -0.5, 0.5, 0.98):
        assert margins(model.scaled(10.0 ** (share * size / 20.0))).stable == m.stable
    beyond = [10.0 ** (sign * (size + 0.01) / 20.0) for sign in (-1.0, 1.0)]
    limiting = [margins(model.scaled(k)) for k in beyond]
    at_limit = [margins(model.scaled(10.0 ** (sign * size / 20.0))).modulus_margin for sign in (-1.0, 1.0)]
    assert min(at_limit) < 1e-6
    if m.stable:
        assert not all(x.stable for x in limiting)
