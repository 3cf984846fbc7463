"""Heave and coning of a rotorcraft in hover: blade pitch to vertical acceleration.

The two equations of Zanoni and Muscarello, "Moving towards a-priori identification of undesirable pilot biometrics for
collective bounce instability", eq. (32), in q = [z, beta] (z up, beta the coning angle) and the blade pitch theta:

    M q'' + D q' + K q = F theta
    M = [ m       n_b S_b ]   D = n_b gamma Omega I_b [ 1/(4 R^2)  1/(6 R) ]   K = [ 0  0                          ]
        [ n_b S_b n_b I_b ]                           [ 1/(6 R)    1/8     ]       [ 0  n_b I_b nu_b^2 Omega^2 ]
    F = n_b gamma Omega^2 I_b [ 1/(6 R), 1/8 ]

A load on a sling (k, c) adds d = z - z_load: m, the helicopter alone, becomes m + m_l (c s + k)/(m_l s^2 + c s + k).

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from pilotgen.linear.partial_fractions import PartialFractions, poles_and_residues
from pilotgen.linear.statespace import ComplexArray, FloatArray, StateSpaceModel
from pilotgen.study.rotorcraft import HEAVE_NUMBERS, Rotorcraft, load_rotorcraft
from pilotgen.study.schema import study_unit


@dataclass(frozen=True, eq=False)
class HeaveModel:
    """Vertical motion and coning of one rotorcraft: theta [rad] -> zddot [m/s^2]."""

    rotorcraft: Rotorcraft

    @cached_property
    def _equations(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """M, D, K (2, 2) and F (2) of the module docstring, SI units."""
        r = self.rotorcraft
        omega = 2.0 * math.pi * r.rotor_speed_hz
        R, I_b, n_b = r.rotor_radius_m, r.flap_inertia_kg_m2, float(r.blades)
        coupling = n_b * r.flap_static_moment_kg_m
        M = np.array([[r.mass_kg, coupling], [coupling, n_b * I_b]])
        aero = n_b * r.lock_number * omega * I_b
        D = aero * np.array([[1.0 / (4.0 * R**2), 1.0 / (6.0 * R)], [1.0 / (6.0 * R), 1.0 / 8.0]])
        K = np.array([[0.0, 0.0], [0.0, n_b * I_b * (r.flap_frequency_ratio * omega) ** 2]])
        F = aero * omega * np.array([1.0 / (6.0 * R), 1.0 / 8.0])
        return M, D, K, F

    @cached_property
    def state_space(self) -> StateSpaceModel:
        """States [zdot, beta, betadot] (with a sling also d, ddot); input theta [rad]; output zddot [m/s^2]."""
        M, D, K, F = self._equations
        Mi = np.linalg.inv(M)
        MD, MK, MF = Mi @ D, Mi @ K, Mi @ F
        sling = self.rotorcraft.sling
        if sling is not None:
            load, k, c = sling["load_kg"], sling["stiffness_n_per_m"], sling.get("damping_n_s_per_m", 0.0)
            A = np.zeros((5, 5))
            A[0, :3] = -MD[0, 0], -MK[0, 1], -MD[0, 1]
            A[1, 2] = 1.0
            A[2, :3] = -MD[1, 0], -MK[1, 1], -MD[1, 1]
            A[3, 4] = 1.0
            pull = np.array([k, c])  # on the helicopter, down
            A[0, 3:] -= Mi[0, 0] * pull
            A[2, 3:] -= Mi[1, 0] * pull
            A[4] = A[0]
            A[4, 3:] -= pull / load
            return StateSpaceModel(A, np.array([MF[0], 0.0, MF[1], 0.0, MF[0]]), A[0].copy(), float(MF[0]))
        A = np.array(
            [
                [-MD[0, 0], -MK[0, 1], -MD[0, 1]],
                [0.0, 0.0, 1.0],
                [-MD[1, 0], -MK[1, 1], -MD[1, 1]],
            ]
        )
        return StateSpaceModel(A, np.array([MF[0], 0.0, MF[1]]), A[0].copy(), float(MF[0]))

    @cached_property
    def force_input(self) -> FloatArray:
        """What 1 N on the airframe, up, adds to the rates of `state_space`'s states, shape (n,)."""
        M = self._equations[0]
        return self._second_order_input(np.linalg.inv(M)[:, 0])

    @cached_property
    def gust_input(self) -> FloatArray:
        """The same of 1 m/s of rising air, shape (n,): the rotor's inflow is that of a descent of 1 m/s."""
        M, D, _, _ = self._equations
        return self._second_order_input(np.asarray(np.linalg.inv(M) @ D[:, 0], dtype=float))

    def _second_order_input(self, rates: npt.NDArray[Any]) -> FloatArray:
        """Accelerations of z and beta as an input of the state space; `rates` has shape (2,)."""
        B = np.zeros(self.state_space.n_states)
        B[[0, 2]] = rates
        if B.size > 3:
            B[4] = rates[0]
        return B

    @cached_property
    def poles(self) -> ComplexArray:
        """Poles of zddot/theta [rad/s]; the paper lists one more at 0 for the height z itself."""
        return self.state_space.poles

    @cached_property
    def partial_fractions(self) -> PartialFractions | None:
        """The same, theta [rad] -> zddot [m/s^2], as a sum over its poles; None if two of them are (nearly) equal."""
        model = self.state_space
        poles, residues = poles_and_residues(model.A, model.B, model.C)
        return None if residues is None else PartialFractions(poles, residues, model.D)

    @cached_property
    def transfer_function(self) -> tuple[FloatArray, FloatArray]:
        """Numerator and denominator of H = zddot/theta, falling powers of s, denominator monic.

        Coefficients of shape (n,) each.

        Cramer's rule on (M s^2 + D s + K) q = F theta, with one power of s cancelled: the height itself does not
        enter the equations.
        """
        M, D, K, F = self._equations
        # Row z is divided by s: [M s + D] q_z-column; polynomials in falling powers of s.
        heave = np.array([M[0, 0], D[0, 0]])
        cross = np.array([M[0, 1], D[0, 1]])
        coning = np.array([M[1, 1], D[1, 1], K[1, 1]])
        denominator = np.polysub(np.polymul(heave, coning), np.polymul(np.polymul(cross, cross), [1.0, 0.0]))
        zdot = np.polysub(F[0] * coning, np.polymul(F[1] * cross, [1.0, 0.0]))
        numerator = np.polymul(zdot, [1.0, 0.0])
        return numerator / denominator[0], denominator / denominator[0]

    def response(self, omega: npt.ArrayLike) -> ComplexArray:
        """H(j omega) in m/s^2 per rad, omega in rad/s, any shape."""
        return self.state_space.response(omega)


def rotorcraft_report(rotorcraft: str | Mapping[str, Any] | Rotorcraft) -> str:
    """Poles and transfer function of a rotorcraft as text.

    Parameters
    ----------
    rotorcraft : str, mapping or Rotorcraft
        A Rotorcraft, or what `load_rotorcraft` takes.

    Raises
    ------
    StudyError
        As `load_rotorcraft`.
    """
    r = rotorcraft if isinstance(rotorcraft, Rotorcraft) else load_rotorcraft(rotorcraft)
    model = HeaveModel(r)
    numerator, denominator = model.transfer_function
    lines = [r.name, f"  source: {r.source}", ""]
    lines += [f"  {key:<26} {getattr(r, key):>10g} {study_unit(f'rotorcraft.{key}')}".rstrip() for key in HEAVE_NUMBERS]
    lines += ["", "Poles of heave and coning (one more at 0 for the height itself)"]
    for pole in sorted(model.poles, key=lambda p: (abs(p), -p.imag)):
        if pole.imag < 0.0:
            continue
        text = f"{pole.real:.4f}" if pole.imag == 0.0 else f"{pole.real:.4f} +- {pole.imag:.4f}i"
        lines.append(
            f"  {text:<24} rad/s   {abs(pole) / (2.0 * math.pi):7.4f} Hz, damping {-pole.real / abs(pole):.3f}"
        )
    lines += [
        "",
        "H(s) = zddot / theta [m/s^2 per rad], falling powers of s [rad/s]",
        "  numerator    " + "  ".join(f"{c: .8g}" for c in numerator),
        "  denominator  " + "  ".join(f"{c: .8g}" for c in denominator),
    ]
    return "\n".join(lines) + "\n"
