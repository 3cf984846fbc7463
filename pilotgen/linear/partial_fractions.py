"""Transfer functions as sums of partial fractions: the quickest form of a loop whose poles keep their distance.

    L(s) = D + sum_k residues[k] / (s - poles[k]) + second / (s - poles[0])^2

The first pole may be a double one, as the washout's is. Poles that come close to each other have large residues that
cancel; `apart` tells when there are none.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Complexes = NDArray[np.complex128]

# Poles nearer to each other than this fraction of their modulus: cancelling residues would cost three digits or more.
_NEAR = 1e-3
# Poles whose term on the imaginary axis is at most this part of the largest one cancel nothing that could be noticed.
_UNNOTICED = 1e-6
# Below this condition number of its eigenvectors A is taken apart into poles and residues; see modal.py.
_MAX_CONDITION = 1e5


@dataclass(frozen=True, eq=False)
class PartialFractions:
    """A proper transfer function with simple poles, but for the first, which may be double.

    Attributes
    ----------
    poles : ndarray of complex, shape (n,)
        Each pole once [rad/s].
    residues : ndarray of complex, shape (n,)
        Coefficients of 1/(s - poles[k]).
    D : float
        Value at infinity.
    second : complex
        Coefficient of 1/(s - poles[0])^2.
    """

    poles: Complexes
    residues: Complexes
    D: float = 0.0
    second: complex = 0j

    @cached_property
    def all_poles(self) -> Complexes:
        """Poles as often as they occur [rad/s]."""
        return self.poles if self.second == 0.0 else np.concatenate((self.poles[:1], self.poles))

    @cached_property
    def apart(self) -> bool:
        """Whether no two poles that count are so close that the sum cancels."""
        with np.errstate(divide="ignore", invalid="ignore"):
            term = np.abs(self.residues) / np.abs(self.poles.real)  # largest value on the axis
        finite = term[np.isfinite(term)]
        counts = ~(term <= _UNNOTICED * finite.max(initial=0.0))
        counts[:1] |= self.second != 0.0
        poles = self.poles[counts]
        modulus = np.abs(poles)
        distance = np.abs(poles[:, None] - poles)
        np.fill_diagonal(distance, np.inf)
        return bool((distance > _NEAR * np.maximum(modulus[:, None], modulus)).all())

    def at(self, s: Complexes) -> Complexes:
        """L at complex frequencies s, shape (m,) [rad/s]."""
        R = 1.0 / (s[:, None] - self.poles)
        value: Complexes = self.D + R @ self.residues
        return value + self.second * R[:, 0] ** 2 if self.second != 0.0 else value

    def slope(self, s: Complexes) -> Complexes:
        """dL/ds, shape (m,) [s]."""
        R = 1.0 / (s[:, None] - self.poles)
        value: Complexes = -(R * R) @ self.residues
        return value - 2.0 * self.second * R[:, 0] ** 3 if self.second != 0.0 else value

    def scaled(self, gain: float) -> PartialFractions:
        """The function multiplied by `gain`."""
        return PartialFractions(self.poles, gain * self.residues, gain * self.D, gain * self.second)

    def times(self, other: PartialFractions) -> PartialFractions | None:
        """The product; None if both have a double pole, or a pole in common."""
        if self.second != 0.0 and other.second != 0.0:
            return None
        a, b = (other, self) if other.second != 0.0 else (self, other)
        if len(a.poles) and len(b.poles) and (a.poles[:, None] == b.poles).any():
            return None
        b_at_a = b.at(a.poles)
        of_a = a.residues * b_at_a
        second = 0j
        if a.second != 0.0:
            second = a.second * complex(b_at_a[0])
            of_a[0] += a.second * complex(b.slope(a.poles[:1])[0])
        return PartialFractions(
            np.concatenate((a.poles, b.poles)), np.concatenate((of_a, b.residues * a.at(b.poles))), a.D * b.D, second
        )


def poles_and_residues(
    A: NDArray[np.float64], B: NDArray[np.float64], C: NDArray[np.float64]
) -> tuple[Complexes, Complexes | None]:
    """Take C (sI - A)^-1 B apart.

    Parameters
    ----------
    A, B, C : ndarray, shapes (n, n), (n,), (n,) or (p, n)
        Real state space, A in 1/s.

    Returns
    -------
    tuple
        Poles, shape (n,) [rad/s], and residues, the shape of C; None when the eigenvectors are (nearly) dependent.
    """
    lam, T = np.linalg.eig(A)
    poles: Complexes = lam.astype(np.complex128)
    if len(lam) and np.linalg.cond(T) > _MAX_CONDITION:
        return poles, None
    return poles, (C @ T) * np.linalg.solve(T, B.astype(np.complex128))


def washout(corner_rad_s: float, integrators: int) -> PartialFractions:
    """s^(2 - integrators) / (s + corner)^2: the high-pass of second order behind 0, 1 or 2 integrators."""
    w = corner_rad_s
    D, residue, second = ((1.0, -2.0 * w, w * w), (0.0, 1.0, -w), (0.0, 0.0, 1.0))[integrators]
    return PartialFractions(np.array([-w + 0j]), np.array([residue + 0j]), D, complex(second))
