"""The operators of the genetic algorithm: pure functions of arrays and an explicit random generator.

X is (n, n_var) in study units, within xl and xu. What the reference paper leaves open, and why it is filled in as it
is, stands in docs/theory/search.md.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import numpy as np

CROSSOVER_ETA = 3.0  # distribution index; measured among 2, 3, 5, 10, 15, 20 (docs/theory/search.md)
MUTATION_ETA = 20.0  # distribution index of the mutation; Deb and Goyal 1996
MAX_REPLACEMENTS = 20  # tries to mutate a copy away before a random point takes its place


def fitness(rank: np.ndarray) -> np.ndarray:
    """Return the fitness, inversely proportional to the rank (1, 1/2, 1/3, ...). Both of shape (n,)."""
    return np.asarray(1.0 / np.asarray(rank, dtype=float))


def roulette_pairs(weights: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Return n pairs of different parents drawn on a roulette wheel, shape (n, 2) of indices.

    Each individual owns a stretch of the wheel as wide as its weight. The second parent is drawn on the wheel with the
    first one's stretch taken out.
    """
    edges = np.concatenate(([0.0], np.cumsum(weights)))
    spins = rng.random((n, 2))
    first = _stretch(edges, spins[:, 0] * edges[-1])
    width = edges[first + 1] - edges[first]
    position = spins[:, 1] * (edges[-1] - width)
    second = _stretch(edges, np.where(position < edges[first], position, position + width))
    # Rounding at an edge could give the same index again; its neighbour owns the other side of that edge.
    second = np.where(second == first, np.where(first + 1 < len(weights), first + 1, first - 1), second)
    return np.stack((first, second), axis=1)


def _stretch(edges: np.ndarray, position: np.ndarray) -> np.ndarray:
    return np.minimum(np.searchsorted(edges, position, side="right") - 1, len(edges) - 2)


def simulated_binary_crossover(
    parents: np.ndarray, xl: np.ndarray, xu: np.ndarray, rng: np.random.Generator, eta: float = CROSSOVER_ETA
) -> np.ndarray:
    """Return two children of each pair of parents, shape (2 n, n_var).

    Children lie symmetrically about their parents' mean, mostly near the parents (nearer with larger eta); each
    variable is blended with probability one half and inherited as it is otherwise; blended variables go to either child
    with equal chance. Children beyond a bound are put on it.

    Parameters
    ----------
    parents : ndarray, shape (n, 2, n_var)
    xl, xu : ndarray, shape (n_var,)
    rng : Generator
    eta : float

    References
    ----------
    Deb and Agrawal, Simulated binary crossover for continuous search space, Complex Systems 9, 1995.
    """
    n, _, n_var = parents.shape
    u, blend, swap = rng.random((3, n, n_var))
    exponent = 1.0 / (eta + 1.0)
    spread = np.where(u <= 0.5, (2.0 * u) ** exponent, (0.5 / (1.0 - u)) ** exponent)
    mean, half = parents.mean(axis=1), 0.5 * (parents[:, 1] - parents[:, 0])
    offset = np.where(blend < 0.5, spread, 1.0) * half
    offset = np.where((blend < 0.5) & (swap < 0.5), -offset, offset)
    children = np.concatenate((mean - offset, mean + offset))
    return np.asarray(np.clip(children, xl, xu))


def polynomial_mutation(
    X: np.ndarray, xl: np.ndarray, xu: np.ndarray, rng: np.random.Generator, eta: float = MUTATION_ETA
) -> np.ndarray:
    """Return X with every variable moved by a random step that is mostly small and never leaves the bounds.

    `X` has shape (n, n_var), the bounds shape (n_var,).

    References
    ----------
    Deb and Goyal, A combined genetic adaptive search (GeneAS) for engineering design, Comput. Sci. Inform. 26, 1996.
    """
    width = xu - xl
    u = rng.random(X.shape)
    room = np.where(u < 0.5, X - xl, xu - X) / width  # to the bound on the side of the step
    power = (1.0 - room) ** (eta + 1.0)
    down = (2.0 * u + (1.0 - 2.0 * u) * power) ** (1.0 / (eta + 1.0)) - 1.0
    up = 1.0 - (2.0 * (1.0 - u) + 2.0 * (u - 0.5) * power) ** (1.0 / (eta + 1.0))
    return np.asarray(np.clip(X + np.where(u < 0.5, down, up) * width, xl, xu))


def mutate_some(
    X: np.ndarray, xl: np.ndarray, xu: np.ndarray, probability: float, rng: np.random.Generator
) -> np.ndarray:
    """Return X with each individual, with this probability, mutated in one variable chosen at random."""
    n, n_var = X.shape
    chosen = np.asarray(rng.random(n) < probability)
    variable = np.asarray(rng.integers(n_var, size=n))
    moved = polynomial_mutation(X, xl, xu, rng)
    result = X.copy()
    rows = np.flatnonzero(chosen)
    result[rows, variable[rows]] = moved[rows, variable[rows]]
    return result


def replace_copies(
    X: np.ndarray, known: set[bytes], xl: np.ndarray, xu: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Return X in which no individual equals another or one in `known` (`row.tobytes()` of all individuals so far).

    `X` has shape (n, n_var), the bounds shape (n_var,).

    A copy is mutated in all variables until it is new; if that does not help, a random point takes its place.
    """
    seen = set(known)
    result = X.copy()
    for k in range(len(result)):
        x = result[k]
        for _ in range(MAX_REPLACEMENTS):
            if x.tobytes() not in seen:
                break
            x = polynomial_mutation(x[None, :], xl, xu, rng)[0]
        while x.tobytes() in seen:
            x = xl + rng.random(len(xl)) * (xu - xl)
        result[k] = x
        seen.add(x.tobytes())
    return result
