"""Random streams, and the first population: a scrambled Sobol set.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import numpy as np

# Every purpose has its own stream, so that a change in how one operator draws does not disturb the others.
PURPOSES = ("sampling", "selection", "crossover", "mutation", "replacement")


def stream(seed: int, generation: int, purpose: str) -> np.random.Generator:
    """Return the random numbers of one purpose in one generation.

    They depend on these three alone: not on what was drawn before, nor on the number of workers or an interruption.
    """
    key = (generation, PURPOSES.index(purpose))
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(entropy=seed, spawn_key=key)))


def sobol(n: int, xl: np.ndarray, xu: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return n points of a scrambled Sobol sequence in the box [xl, xu], shape (n, n_var).

    The sequence is balanced at powers of two only; other n get the first n points of the next power of two.
    """
    from scipy.stats import qmc  # half a second of import that only a search pays

    points = qmc.Sobol(len(xl), scramble=True, rng=rng).random_base2(max(n - 1, 1).bit_length())[:n]
    return np.asarray(xl + points * (xu - xl))


def sobol_points(first: int, count: int, xl: np.ndarray, xu: np.ndarray, seed: int) -> np.ndarray:
    """Return points `first` to `first + count - 1` of the seed's endless scrambled Sobol sequence in the box.

    Shape (count, n_var).

    Point i is the same whatever part of the sequence is asked for, so a sample can be made longer later.
    """
    from scipy.stats import qmc

    sequence = qmc.Sobol(len(xl), scramble=True, rng=stream(seed, 0, "sampling"))
    if first:
        sequence.fast_forward(first)
    # Drawn in pieces of any size, the sequence is the same; its warning about balance concerns means over all of it.
    import warnings

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="The balance properties of Sobol", category=UserWarning)
        points = sequence.random(count)
    return np.asarray(xl + points * (xu - xl))


def random_points(first: int, count: int, xl: np.ndarray, xu: np.ndarray, seed: int) -> np.ndarray:
    """Return points `first` to `first + count - 1` of the seed's endless sequence of random points in the box.

    Shape (count, n_var).
    """
    generator = np.random.PCG64(np.random.SeedSequence(entropy=seed, spawn_key=(0, PURPOSES.index("sampling"))))
    generator.advance(first * len(xl))  # one draw of the generator per uniform double
    return np.asarray(xl + np.random.Generator(generator).random((count, len(xl))) * (xu - xl))
