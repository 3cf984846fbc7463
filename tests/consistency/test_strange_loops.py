"""Strange loops: values certified elsewhere in exact arithmetic, and random ones worked out with mpmath.

tests/data/strange_loops holds small loops with values certified in rational arithmetic. The reference for the random
ones interpolates det(sI - A) at points of a circle in 90 digits and asks mpmath for all complex roots. It shares
with the program nothing but the definitions of docs/theory/margins.md.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mpmath as mp
import numpy as np
import pytest

from pilotgen.linear.exact import rational
from pilotgen.linear.partial_fractions import PartialFractions, poles_and_residues
from pilotgen.linear.statespace import StateSpaceModel
from pilotgen.loop.crossings import locus_features
from pilotgen.loop.locus import Locus
from pilotgen.loop.margins import Margins, exact_margins, largest_real_part, margins
from pilotgen.loop.verified import verified

CASES = Path(__file__).parents[1] / "data" / "strange_loops"
TWO_PI = 2.0 * math.pi


def case(path: Path) -> tuple[StateSpaceModel, dict[str, Any]]:
    data = json.loads(path.read_text())
    return StateSpaceModel(np.array(data["A"]), np.array(data["B"]), np.array(data["C"]), data["D"]), data["right"]


def crossings(m: Margins, kind: str) -> list[tuple[float, complex]]:
    return [(TWO_PI * c.frequency_hz, c.value) for c in m.crossings if c.kind == kind]


def check(m: Margins, right: dict[str, Any], rel: float = 1e-9) -> None:
    assert m.stable == right["stable"]
    sign = 1.0 if m.stable else -1.0
    assert m.gain_margin_db == pytest.approx(sign * float(right["abs_gain_margin_db"]), rel=rel, abs=1e-9)
    assert m.phase_margin_deg == pytest.approx(sign * float(right["abs_phase_margin_deg"]), rel=rel, abs=1e-9)
    assert m.modulus_margin == pytest.approx(right["modulus_margin"], rel=rel)
    assert m.disk_margin == pytest.approx(right["disk_margin"], rel=rel)
    assert m.delay_margin_s == pytest.approx(float(right["delay_margin_s"]), rel=rel)
    for kind, key in (("real axis", "real_axis"), ("unit circle", "unit_circle")):
        mine, wanted = crossings(m, kind), right[key]
        assert len(mine) == len(wanted), (kind, mine, wanted)
        for (omega, L), (omega_right, *value) in zip(mine, wanted, strict=True):
            assert omega == pytest.approx(float(omega_right), rel=rel)
            assert abs(L - complex(*value)) <= rel * abs(L)


@pytest.mark.parametrize("path", sorted(CASES.glob("*.json")), ids=lambda path: path.stem)
def test_certified_loops(path: Path) -> None:
    model, right = case(path)
    m = margins(model)
    check(m, right)
    if right["modulus_margin_rad_s"] != "inf":
        assert TWO_PI * m.modulus_margin_hz == pytest.approx(right["modulus_margin_rad_s"], rel=1e-6)
    assert all(abs(1.0 + c.value) >= m.modulus_margin * (1.0 - 1e-9) for c in m.crossings)


# ---- random loops, worked out in 90 digits


@dataclass
class Fractions:
    """num / den, coefficients of rising powers."""

    num: list[Any]
    den: list[Any]


def times(p: list[Any], q: list[Any]) -> list[Any]:
    out = [mp.mpf(0)] * (len(p) + len(q) - 1)
    for i, a in enumerate(p):
        for j, b in enumerate(q):
            out[i + j] += a * b
    return out


def plus(p: list[Any], q: list[Any], sign: int = 1) -> list[Any]:
    n = max(len(p), len(q))
    return [(p[i] if i < len(p) else mp.mpf(0)) + sign * (q[i] if i < len(q) else mp.mpf(0)) for i in range(n)]


def horner(p: list[Any], s: Any) -> Any:
    total = mp.mpf(0)
    for c in reversed(p):
        total = total * s + c
    return total


def slope(p: list[Any]) -> list[Any]:
    return [k * p[k] for k in range(1, len(p))] or [mp.mpf(0)]


def of_square(p: list[Any]) -> tuple[list[Any], list[Any]]:
    """p(j w) = even + j w odd, as polynomials in w^2."""
    even = [c * (-1) ** i for i, c in enumerate(p[0::2])]
    odd = [c * (-1) ** i for i, c in enumerate(p[1::2])]
    return even, odd or [mp.mpf(0)]


def all_roots(p: list[Any]) -> list[Any]:
    while len(p) > 1 and p[-1] == 0:
        p = p[:-1]
    while len(p) > 1 and p[0] == 0:
        p = p[1:]
    if len(p) < 2:
        return []
    scale = abs(p[0] / p[-1]) ** (mp.mpf(1) / (len(p) - 1))
    scaled = [c * scale**i for i, c in enumerate(p)]
    size = max(abs(c) for c in scaled)
    roots = mp.polyroots([c / size for c in scaled], maxsteps=500, extraprec=400, error=False, asc=True)
    return [scale * r for r in roots]


def positive(p: list[Any]) -> list[Any]:
    return sorted(mp.re(r) for r in all_roots(p) if mp.re(r) > 0 and abs(mp.im(r)) < mp.mpf(10) ** -25 * abs(r))


def right_answer(f: Fractions) -> dict[str, Any]:
    """All margins of num/den (no poles on the axis, strictly proper) by the roots of polynomials in w^2."""
    Ne, No = of_square(f.num)
    De, Do = of_square(f.den)
    x = [mp.mpf(0), mp.mpf(1)]
    imag = plus(times(No, De), times(Ne, Do), -1)
    N2, D2 = plus(times(Ne, Ne), times(x, times(No, No))), plus(times(De, De), times(x, times(Do, Do)))

    def at(w: Any) -> Any:
        s = mp.mpc(0, w)
        return horner(f.num, s) / horner(f.den, s)

    axis = [mp.sqrt(r) for r in positive(imag)]
    axis = [(w, mp.re(at(w))) for w in [mp.mpf(0), *axis] if mp.re(at(w)) < 0]
    axis = [(w, L) for w, L in axis if 1e-10 < -L < 1e10]
    circle = [(w, at(w)) for w in (mp.sqrt(r) for r in positive(plus(N2, D2, -1)))]

    def lowest(U: list[Any], V: list[Any]) -> Any:
        stationary = positive(plus(times(slope(U), V), times(U, slope(V)), -1))
        values = [horner(U, r) / horner(V, r) for r in [mp.mpf(0), *stationary]]
        return mp.sqrt(min([*values, mp.mpf(1)]))

    def squares(p: list[Any]) -> list[Any]:
        even, odd = of_square(p)
        return plus(times(even, even), times(x, times(odd, odd)))

    closed = plus(f.num, f.den)
    stable = all(mp.re(r) < 0 for r in all_roots(closed))
    delay = min(((mp.arg(-L) % (2 * mp.pi)) / w for w, L in circle), default=mp.inf)
    inside, outside = squares(closed), squares(plus(f.den, f.num, -1))
    return {
        "stable": stable,
        "abs_gain_margin_db": min((abs(20 * mp.log10(-L)) for _, L in axis), default=mp.inf),
        "abs_phase_margin_deg": min((abs(mp.degrees(mp.arg(-L))) for _, L in circle), default=mp.inf),
        "modulus_margin": float(lowest(inside, D2)),
        "disk_margin": float(2 * lowest(inside, outside)) if stable else 0.0,
        "delay_margin_s": delay if stable else 0.0,
        "real_axis": [(w, float(L)) for w, L in axis],
        "unit_circle": [(w, float(mp.re(L)), float(mp.im(L))) for w, L in circle],
    }


def exactly(model: StateSpaceModel) -> Fractions:
    """num and den of the given matrices: det(sI - A) and det(sI - A + BC) - det(sI - A), from 2n + 1 determinants."""
    n = model.n_states
    scale = mp.mpf(2) ** round(math.log2(max(np.abs(model.poles).max(), 1e-300)))
    points = [scale * mp.expjpi(mp.mpf(2 * k) / (n + 1)) for k in range(n + 1)]
    A = mp.matrix(model.A.tolist())
    closed = A - mp.matrix(model.B.tolist()) * mp.matrix(model.C.tolist()).T

    def coefficients(M: Any) -> list[Any]:
        values = [mp.det(mp.eye(n) * p - M) for p in points]
        return [
            mp.re(sum(v * mp.expjpi(-mp.mpf(2 * k * i) / (n + 1)) for i, v in enumerate(values))) / (n + 1) / scale**k
            for k in range(n + 1)
        ]

    den, all_of_it = coefficients(A), coefficients(closed)
    return Fractions([a - b for a, b in zip(all_of_it[:-1], den[:-1], strict=True)], den)


def strange(rng: np.random.Generator) -> StateSpaceModel:
    """A cascade of light modes, clusters, lags and notches over several decades, with a telling gain."""
    kind = rng.integers(4)
    count = int(rng.integers(1, 4))
    omega = 10.0 ** rng.uniform(-4.0, 4.0) if kind == 0 else 10.0 ** rng.uniform(-1.0, 1.0)
    A, B, C = np.zeros((0, 0)), np.zeros(0), np.zeros(0)
    for i in range(count):
        if kind != 1:  # a cluster keeps its frequency
            omega *= 10.0 ** rng.uniform(-0.5, 2.0 if kind == 0 else 0.5)
        zeta = 10.0 ** rng.uniform(-6.0, 0.0)
        a1, a0 = 2.0 * zeta * omega, omega * omega
        grown = np.zeros((2 * i + 2, 2 * i + 2))
        grown[: 2 * i, : 2 * i], grown[2 * i :, 2 * i :] = A, [[-a1, -a0], [1.0, 0.0]]
        grown[2 * i, : 2 * i] = C
        A, B = grown, np.concatenate((B, [0.0, 0.0])) if i else np.array([1.0, 0.0])
        C = np.concatenate((np.zeros(2 * i), [rng.normal() * a1, rng.normal() * a0]))
    peak = np.abs(StateSpaceModel(A, B, C, 0.0).response(omega))
    gain = 10.0 ** rng.uniform(-0.5, 0.5 if kind < 3 else 3.0) / float(peak)
    return StateSpaceModel(A, B, C * gain, 0.0)


@pytest.mark.parametrize("seed", range(24))
def test_random_strange_loops_against_mpmath(seed: int) -> None:
    model = strange(np.random.default_rng([12, seed]))
    with mp.workdps(90):
        right = right_answer(exactly(model))
    check(margins(model), {**right, "real_axis": [(float(w), L) for w, L in right["real_axis"]]})


# ---- the quick mode: right, or in doubt


@pytest.mark.parametrize("part", range(4))
@pytest.mark.parametrize(("form", "least"), [("partial fractions", 15), ("Schur form", 12)])
def test_quick_mode_is_right_or_in_doubt(part: int, form: str, least: int) -> None:
    sure = 0
    for seed in range(25):
        model = strange(np.random.default_rng([77, part, seed]))
        fractions = None
        if form == "partial fractions":
            poles, residues = poles_and_residues(model.A, model.B, model.C)
            if residues is None or not PartialFractions(poles, residues, model.D).apart:
                continue
            fractions = PartialFractions(poles, residues, model.D)
        quick = locus_features(model, fractions)
        largest = largest_real_part(model)
        assert largest is not None
        if quick.doubtful or largest[0] <= 0.0 <= largest[1]:
            continue
        sure += 1
        right = verified(rational(model))
        assert right.stable == (largest[1] < 0.0)
        assert quick.distance == pytest.approx(right.features.distance, rel=1e-6)
        assert quick.alpha == pytest.approx(right.features.alpha, rel=1e-6)
        for mine, wanted in (
            (quick.real_axis, right.features.real_axis),
            (quick.unit_circle, right.features.unit_circle),
        ):
            np.testing.assert_allclose(mine.omega, wanted.omega, rtol=1e-6)
            np.testing.assert_allclose(mine.L, wanted.L, rtol=1e-5)
    assert sure >= least


def cascade(factors: list[tuple[float, float | None]]) -> StateSpaceModel:
    """The product of (s + z)/(s + p), or 1/(s + p) where z is None."""
    A, B, C, D = np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0
    for i, (p, z) in enumerate(factors):
        A = np.block([[A, np.zeros((i, 1))], [C, np.full((1, 1), -p)]])
        B, C, D = np.append(B, D), np.append(C * (z is not None), 1.0 if z is None else z - p), D * (z is not None)
    return StateSpaceModel(A, B, C, D)


def test_an_integrator_is_one_in_large_loops_too() -> None:
    """42 states, told by the quick mode: an integrator by the zeros of A, not a pole near the axis."""
    loop = cascade([(0.0, None), (1.0, None), (8.0, None), *((float(k), k + 0.5) for k in range(2, 41))])
    loop = StateSpaceModel(loop.A, loop.B, 4.0 * loop.C, 0.0)
    m, right = margins(loop), exact_margins(rational(loop))
    assert not m.not_told
    assert m.stable is right.stable is True
    for name in ("gain_margin_db", "phase_margin_deg", "modulus_margin", "disk_margin", "delay_margin_s"):
        assert getattr(m, name) == pytest.approx(getattr(right, name), rel=1e-9)


def test_a_gain_of_one_at_rest_is_in_doubt() -> None:
    """A low-pass of gain 1: whether it crosses the circle at omega = 0 is in its last digits."""
    lag = StateSpaceModel(np.array([[-0.3]]), np.array([0.3]), np.array([1.0]), 0.0)
    assert locus_features(lag).doubtful


def test_quick_mode_notices_what_it_cannot_do() -> None:
    """The certified loops on which double precision fails are in doubt; the answer then is the exact one."""
    for name in ("quadruple_mode_1e-6", "triple_mode_1e-6_unstable", "slow_light_mode_fast_lags", "butterworth12_dc1"):
        model, right = case(CASES / f"{name}.json")
        largest = largest_real_part(model)
        assert largest is not None
        assert largest[0] <= float(right["largest_real_part"]) <= largest[1]
        assert largest[0] <= 0.0 <= largest[1] or locus_features(model).doubtful


def test_interpolation_error_keeps_its_bound() -> None:
    rng = np.random.default_rng(3)
    for _ in range(40):
        n = int(rng.integers(1, 6))
        omega, zeta = 10.0 ** rng.uniform(-1.0, 1.5, n), 10.0 ** rng.uniform(-4.0, -0.1, n)
        poles = omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
        residues = rng.normal(size=n) + 1j * rng.normal(size=n)
        slow = -(10.0 ** rng.uniform(-1.0, 1.0))
        fractions = PartialFractions(
            np.concatenate(([slow], poles, poles.conj())),
            np.concatenate(([rng.normal()], residues, residues.conj())),
            rng.normal(),
            rng.normal(),
        )
        model = StateSpaceModel(np.diag([slow] * (2 * n + 2)), np.ones(2 * n + 2), np.ones(2 * n + 2), 0.0)
        locus = Locus(model, fractions)  # only its partial fractions are asked here
        v = locus.intervals()
        for u in (0.2, 0.5, 0.8):
            L, _, _ = locus.first(v.x0 + u * (v.x1 - v.x0), v.tail)
            basis = np.array([(1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u * u * (1 - u), u**3])
            inside = ~v.from_end  # the model of the ends is not the fractions' here
            assert (np.abs(v.P @ basis - L) <= v.bound + 1e-13)[inside].all()
