"""Disks around eigenvalues: matrices whose eigenvalues are known exactly, and loops of more than forty states.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import numpy as np
import pytest

from pilotgen.linear.imposed_motion import SEAT_MOTIONS
from pilotgen.linear.pilot_model import PilotModel
from pilotgen.linear.statespace import StateSpaceModel
from pilotgen.loop.enclosure import eigenvalue_disks, enclosed_real_part
from pilotgen.loop.margins import margins
from pilotgen.loop.mimo import close
from pilotgen.loop.plants import load_plant


def known(seed: int, top: int, n: int = 60, power: int = -20) -> tuple[np.ndarray, np.ndarray]:
    """An n x n matrix without round-off, and its eigenvalues: blocks of integers turned by integer row operations.

    `top` is the largest real part; everything is scaled by a power of two. Real parts from -1 to -10^6.
    """
    rng = np.random.default_rng(seed)
    a = -np.round(10.0 ** rng.uniform(0.0, 6.0, n // 2)).astype(object)
    b = np.round(10.0 ** rng.uniform(0.0, 6.0, n // 2)).astype(object)
    a[0] = top
    A = np.zeros((n, n), dtype=object)
    for k in range(n // 2):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[int(a[k]), int(b[k])], [-int(b[k]), int(a[k])]]
    for _ in range(n):  # A -> E A E^-1 with E = I + c e_i e_j^T
        i, j = rng.choice(n, 2, replace=False)
        c = int(rng.choice([-1, 1]))
        A[i] = A[i] + c * A[j]
        A[:, j] = A[:, j] - c * A[:, i]
    assert max(abs(int(x)) for x in A.ravel()) < 2**53
    values = np.array([complex(int(x), s * int(y)) for x, y in zip(a, b, strict=True) for s in (1, -1)])
    return A.astype(float) * 2.0**power, values * 2.0**power


@pytest.mark.parametrize("seed", range(4))
def test_disks_hold_the_eigenvalues(seed: int) -> None:
    A, values = known(seed, top=-1)
    disks = eigenvalue_disks(A)
    assert disks is not None
    centres, radii = disks
    assert (np.abs(values[:, None] - centres[None, :]) <= radii[None, :]).any(axis=1).all()
    assert radii.max() < 1e-9 * np.abs(values).max()


@pytest.mark.parametrize("top", [-1, 1])
@pytest.mark.parametrize("seed", range(3))
def test_the_verdict_beside_modes_that_are_a_million_times_faster(seed: int, top: int) -> None:
    A, values = known(seed, top)
    found = enclosed_real_part(A)
    assert found is not None
    assert found[0] <= values.real.max() <= found[1]
    assert found[1] < 0.0 if top < 0 else found[0] > 0.0


def test_a_defective_matrix_is_not_decided_wrongly() -> None:
    A = np.eye(45, k=1) - 1e-3 * np.eye(45)
    found = enclosed_real_part(A)
    assert found is None or found[0] <= -1e-3 <= found[1]


@pytest.mark.parametrize("gain", [0.2, 1.0, 5.0])
def test_margins_of_a_loop_of_fifty_states(gain: float) -> None:
    """A slow divergent mode and 24 modes of 1 to 4,000 Hz side by side: the winding of 1 + L and a dense scan."""
    rng = np.random.default_rng(1)
    n = 50
    A, B, C = np.zeros((n, n)), np.zeros(n), np.zeros(n)
    A[:2, :2], B[0], C[:2] = [[0.02, 0.0], [1.0, -2.0]], 1.0, [1.0, 0.5]
    for k, hz in enumerate(np.geomspace(1.0, 4000.0, 24)):
        w, own = 2.0 * np.pi * hz, slice(2 + 2 * k, 4 + 2 * k)
        A[own, own] = w * np.array([[-0.3, 0.95], [-0.95, -0.3]])
        B[own], C[own] = rng.normal(size=2), 0.1 * w * rng.normal(size=2) / (1.0 + hz**2 / 100.0)
    T = np.eye(n) + 0.05 * rng.normal(size=(n, n))  # every state in every other one
    model = StateSpaceModel(T @ A @ np.linalg.inv(T), T @ B, gain * np.linalg.solve(T.T, C), 0.0)
    assert model.n_states > 40
    found = margins(model)
    omega = np.geomspace(1e-4, 1e6, 100_000)
    L = model.response(omega)
    L = np.concatenate(([complex(model.response(0.0)).real], L))
    turns = np.angle((1.0 + L[1:]) / (1.0 + L[:-1])).sum() / np.pi
    assert not found.not_told, found.not_told
    assert found.stable is (1 - round(turns) == 0)
    changes = np.flatnonzero((L[:-1].imag > 0.0) != (L[1:].imag > 0.0))
    crossings = [L[k].real for k in changes if L[k].real < 0.0] + ([L[0].real] if L[0].real < 0.0 else [])
    brute = min(abs(20.0 * np.log10(-x)) for x in crossings)
    assert abs(found.gain_margin_db) == pytest.approx(brute, abs=2e-2)
    assert found.modulus_margin == pytest.approx(np.abs(1.0 + L).min(), rel=1e-3)


@pytest.mark.parametrize("gain", [0.004, 0.02])
def test_three_loops_of_sixty_states(gain: float) -> None:
    """The Lynx with forty modes of a pilot: poles right of the axis by the winding of det(I + L)."""
    rng = np.random.default_rng(3)
    n = 40
    A = np.zeros((n, n))
    for k, hz in enumerate(np.geomspace(1.5, 2000.0, n // 2)):
        w = 2.0 * np.pi * hz
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = w * np.array([[-0.3, 0.95], [-0.95, -0.3]])
    inputs = tuple(f"seat_{name}_acceleration" for name in SEAT_MOTIONS)
    pilot = PilotModel(
        projection="exact", A=A, B=rng.normal(size=(n, 6)), C=gain * rng.normal(size=(3, n)), D=np.zeros((3, 6)),
        inputs=inputs, outputs=("collective_rotation", "cyclic_aft", "cyclic_right"), lever_length_m=0.32,
        washout_rad_s=3.1,
    )  # fmt: skip
    loop = close(pilot, load_plant("lynx-hover"), dict.fromkeys(("collective", "longitudinal", "lateral"), 0.4))
    assert len(loop.A) > 40
    omega = np.concatenate(([0.0], np.geomspace(1e-3, 1e5, 1_500)))
    det = np.linalg.det(np.eye(3) + loop.response(omega))
    turns = np.angle(det[1:] / det[:-1]).sum() / np.pi
    open_loop = int((np.linalg.eigvals(loop.A).real > 0.0).sum())
    assert open_loop - round(turns) == int((loop.closed_loop_poles.real > 0.0).sum())
    assert loop.stable is (open_loop - round(turns) == 0)
    for control, found in loop.loop_at_a_time().items():
        assert not found.not_told, control
        assert found.stable is loop.stable
