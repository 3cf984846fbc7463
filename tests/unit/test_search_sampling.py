"""Random streams and the Sobol set.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from pilotgen.search.sampling import PURPOSES, sobol, stream

XL, XU = np.array([25.0, 18.0, 1.55]), np.array([65.0, 30.0, 2.0])


def test_streams_depend_on_seed_generation_and_purpose_alone() -> None:
    draws = {
        (seed, generation, purpose): tuple(stream(seed, generation, purpose).random(4))
        for seed in (0, 1, 2**63 - 1)
        for generation in (0, 1, 29)
        for purpose in PURPOSES
    }
    assert len(set(draws.values())) == len(draws)
    assert tuple(stream(1, 29, "mutation").random(4)) == draws[1, 29, "mutation"]


@pytest.mark.parametrize("n", [4, 5, 12, 64, 100])
def test_sobol_fills_the_box_without_a_warning(n: int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        X = sobol(n, XL, XU, stream(1, 0, "sampling"))
    assert X.shape == (n, 3)
    assert (X >= XL).all() and (X <= XU).all()
    assert len(np.unique(X, axis=0)) == n


def test_sobol_is_scrambled_by_the_seed_and_reproducible() -> None:
    a, b, c = (sobol(100, XL, XU, stream(seed, 0, "sampling")) for seed in (1, 1, 2))
    np.testing.assert_array_equal(a, b)
    assert (a != c).all()


def test_sobol_is_balanced() -> None:
    X = (sobol(128, XL, XU, stream(3, 0, "sampling")) - XL) / (XU - XL)
    for column in X.T:  # a digital net of 128 points has exactly one point in each of 128 slices
        np.testing.assert_array_equal(np.sort(np.floor(column * 128)), np.arange(128))


def test_scipy_is_imported_only_when_a_population_is_drawn() -> None:
    code = (
        "import sys, pilotgen.search as s; from pilotgen.search import sampling;"
        "bad = {'scipy.stats', 'pymoo', 'matplotlib'} & set(sys.modules); sys.exit(str(bad) if bad else 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parents[2])
