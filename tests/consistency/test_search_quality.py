"""The genetic search against pymoo's NSGA-II and against brute force.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from pathlib import Path
from statistics import median

import numpy as np
import pytest

from pilotgen.search import Problem, run_search
from pilotgen.search.quality import compare_with_nsga2
from pilotgen.study.sections import SearchSettings
from pilotgen.study.study import read_study

STUDIES = Path(__file__).parents[2] / "docs" / "studies"


# ---- standard problems: Deb, Multi-Objective Optimization using Evolutionary Algorithms, 2001, ch. 8 ----
def schaffer(X: np.ndarray) -> np.ndarray:
    return np.stack((X[:, 0] ** 2, (X[:, 0] - 2.0) ** 2), axis=1)


def fonseca(X: np.ndarray) -> np.ndarray:
    shift = 1.0 / np.sqrt(X.shape[1])
    return np.stack([1.0 - np.exp(-((X + sign * shift) ** 2).sum(axis=1)) for sign in (-1.0, 1.0)], axis=1)


def kursawe(X: np.ndarray) -> np.ndarray:
    first = -10.0 * np.exp(-0.2 * np.hypot(X[:, :-1], X[:, 1:])).sum(axis=1)
    return np.stack((first, (np.abs(X) ** 0.8 + 5.0 * np.sin(X**3)).sum(axis=1)), axis=1)


def zdt1(X: np.ndarray) -> np.ndarray:
    g = 1.0 + 9.0 * X[:, 1:].mean(axis=1)
    return np.stack((X[:, 0], g * (1.0 - np.sqrt(X[:, 0] / g))), axis=1)


def zdt2(X: np.ndarray) -> np.ndarray:
    g = 1.0 + 9.0 * X[:, 1:].mean(axis=1)
    return np.stack((X[:, 0], g * (1.0 - (X[:, 0] / g) ** 2)), axis=1)


def settings_of(bounds: list[tuple[float, float]], stop: float | None, generations: int = 30) -> SearchSettings:
    variables = {f"x{k}": pair for k, pair in enumerate(bounds)}
    return SearchSettings(variables, ("f", "g"), 100, generations, 0.10, 1, "goldberg", stop)


PROBLEMS = {
    "schaffer": (schaffer, [(-1000.0, 1000.0)], (5.0, 5.0)),
    "fonseca": (fonseca, [(-4.0, 4.0)] * 3, (1.1, 1.1)),
    "kursawe": (kursawe, [(-5.0, 5.0)] * 3, (-13.0, 2.0)),
    "zdt1": (zdt1, [(0.0, 1.0)] * 3, (1.1, 1.1)),
    "zdt2": (zdt2, [(0.0, 1.0)] * 3, (1.1, 1.1)),
}


@pytest.mark.parametrize("stop", [0.9, None], ids=["stop at 90 %", "all generations"])
@pytest.mark.parametrize("name", PROBLEMS)
def test_standard_problems(name: str, stop: float | None) -> None:
    function, bounds, reference = PROBLEMS[name]
    comparisons = compare_with_nsga2(settings_of(bounds, stop), function, range(3), np.array(reference))
    assert median(c.ratio for c in comparisons) >= 0.99, comparisons


def test_schaffer_front_is_known() -> None:
    settings = settings_of([(-1000.0, 1000.0)], None)
    result = run_search(Problem.from_settings(settings), settings, lambda X, _: schaffer(X))
    x = result.X[result.front, 0]
    assert len(x) >= 90 and x.min() > -0.05 and x.max() < 2.05, "the front is 0 <= x <= 2"
    assert np.diff(np.sort(x)).max() < 0.15, "and is covered without a hole"


# ---- Mayo's study; margins by an independent dense grid, all pilots at once ----
class MayoOnPuma:
    """Gain and phase margin of Mayo's pilots on the IAR 330 Puma, from the equations' polynomials on a frequency grid.

    Crossings are interpolated linearly in a grid of 900 frequencies (error below 0.005 dB and 0.2 deg); stability from
    the roots of the closed loop's characteristic polynomial. Heave and coning as in Table 1 and Eq. (32).
    """

    HZ = np.geomspace(0.05, 30.0, 900)

    def __init__(self) -> None:
        m, n_b, R, omega, gamma, S_b, I_b, nu = 7345.0, 4, 7.49, 2 * np.pi * 4.5, 8.7, 276.48, 1339.19, 1.03
        aero = n_b * gamma * omega * I_b
        heave, cross = np.poly1d([m, aero / (4 * R**2)]), np.poly1d([n_b * S_b, aero / (6 * R)])
        cone = np.poly1d([n_b * I_b, aero / 8, n_b * I_b * (nu * omega) ** 2])
        s = np.poly1d([1.0, 0.0])
        self.den = heave * cone - cross * cross * s
        self.num = (cone * (1 / (6 * R)) - cross * s * (1 / 8)) * s * (aero * omega)
        self.s = 2j * np.pi * self.HZ
        self.response = self.num(self.s) / self.den(self.s)

    def __call__(self, X: np.ndarray, gearing: float = 1.1, washout: float = 3.10) -> np.ndarray:
        s = self.s
        w, xi, tau = 2 * np.pi * X[:, :1], X[:, 1:2], X[:, 2:3]
        L = gearing * s * (s + 1 / tau) / ((s + washout) ** 2 * (s * s + 2 * xi * w * s + w * w)) * self.response
        level = 20 * np.log10(np.abs(L))
        rows = []
        for k, stable in enumerate(self.stable(w, xi, tau, gearing, washout)):
            i = np.flatnonzero(L[k, :-1].imag * L[k, 1:].imag < 0)
            t = L[k, i].imag / (L[k, i].imag - L[k, i + 1].imag)
            negative = L[k, i].real + t * (L[k, i + 1].real - L[k, i].real) < 0
            gain = np.abs(level[k, i] + t * (level[k, i + 1] - level[k, i]))[negative].min(initial=60.0)
            i = np.flatnonzero(level[k, :-1] * level[k, 1:] < 0)
            t = level[k, i] / (level[k, i] - level[k, i + 1])
            phase = np.abs(np.degrees(np.angle(-(L[k, i] + t * (L[k, i + 1] - L[k, i]))))).min(initial=180.0)
            rows.append((gain, phase) if stable else (-gain, -phase))
        return np.array(rows)

    def stable(self, w: np.ndarray, xi: np.ndarray, tau: np.ndarray, gearing: float, washout: float) -> np.ndarray:
        """Whether all roots of den_pilot den + num_pilot num are on the left: companion matrices' eigenvalues."""
        high_pass = np.poly1d([1.0, washout]) ** 2 * self.den
        s, n = np.poly1d([1.0, 0.0]), high_pass.order + 2
        fixed = [(high_pass * s**2).coeffs, (high_pass * s).coeffs, high_pass.coeffs]
        loop = [(gearing * self.num * s**k).coeffs for k in (2, 1)]
        poly = np.zeros((len(w), n + 1))
        for factor, coeffs in zip((1.0, 2 * xi * w, w * w, 1.0, 1 / tau), (*fixed, *loop), strict=True):
            poly[:, n + 1 - len(coeffs) :] += factor * coeffs
        companion = np.zeros((len(w), n, n))
        companion[:, 0] = -poly[:, 1:] / poly[:, :1]
        companion[:, np.arange(1, n), np.arange(n - 1)] = 1.0
        return np.asarray(np.linalg.eigvals(companion).real.max(axis=1) < 1e-9)


@pytest.fixture(scope="module")
def mayo() -> MayoOnPuma:
    return MayoOnPuma()


def test_mayo_margins_of_this_test_are_right(mayo: MayoOnPuma) -> None:
    points = [[2.5, 0.2, 0.06], [2.5, 0.35, 0.06], [3.25, 0.2, 0.12], [4.0, 0.5, 0.12], [3.38, 0.32, 0.117]]
    known = [[-4.503, -33.19], [0.696, 7.546], [1.815, 41.03], [12.762, 180.0], [6.42, 180.0]]
    np.testing.assert_allclose(mayo(np.array(points))[:, 0], np.array(known)[:, 0], atol=5e-3)
    np.testing.assert_allclose(mayo(np.array(points))[:, 1], np.array(known)[:, 1], atol=0.2)


def test_mayo_study_against_nsga2(mayo: MayoOnPuma) -> None:
    settings = read_study(STUDIES / "puma-mayo.yaml").search
    comparisons = compare_with_nsga2(settings, mayo, range(1, 4))
    assert median(c.ratio for c in comparisons) >= 0.99, comparisons
    assert all(c.evaluations <= 3000 for c in comparisons)


def test_mayo_study_finds_the_worst_point_of_a_grid(mayo: MayoOnPuma) -> None:
    settings = read_study(STUDIES / "puma-mayo.yaml").search
    axes = [np.linspace(low, high, 7) for low, high in settings.variables.values()]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    worst = grid[mayo(grid).sum(axis=1).argmin()]
    np.testing.assert_allclose(worst, [2.5, 0.20, 0.06], err_msg="smallest frequency, damping and time constant")
    result = run_search(Problem.from_settings(settings), settings, lambda X, _: mayo(X))
    best = result.X[result.F.sum(axis=1).argmin()]
    np.testing.assert_allclose(best, worst, rtol=1e-3)
    final = result.X[result.members[-1]]  # Fig. 3 of the reference paper: the final population gathers in that corner
    assert np.median(final[:, 0]) < 2.55 and np.median(final[:, 1]) < 0.21
