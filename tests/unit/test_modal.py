"""Modes of constrained systems against dense QZ, closed forms, and the defining equations.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_models import assemble, case, dense_eigenvalues, random_mechanism, sort
from numpy.testing import assert_allclose

from pilotgen.errors import MatrixError
from pilotgen.linear.modal import ModalModel, modes
from pilotgen.linear.null_space import independent_constraints
from pilotgen.solver.descriptor import DescriptorModel
from pilotgen.solver.matrices import descriptor


def assert_modal(model: DescriptorModel, modal: ModalModel, tolerance: float = 1e-9) -> None:
    """The definition: right and left vectors of the full pencil, all unknowns and equations included."""
    scale = max(np.abs(model.g_y).max(), np.abs(model.g_ydot).max())
    right = np.abs(model.g_ydot @ modal.V_R @ modal.A + model.g_y @ modal.V_R)
    left = np.abs(modal.A @ modal.V_L @ model.g_ydot + modal.V_L @ model.g_y)
    assert right.max(initial=0.0) < tolerance * scale * max(1.0, np.abs(modal.V_R).max())
    assert left.max(initial=0.0) < tolerance * scale * max(1.0, np.abs(modal.V_L).max())
    assert_allclose(modal.V_L @ model.g_ydot @ modal.V_R, np.eye(len(modal.lam)), atol=tolerance)


@given(seed=st.integers(0, 2**32 - 1), n_nodes=st.integers(1, 3), freedom=st.integers(1, 5), moving=st.booleans())
@settings(max_examples=40, deadline=None)
def test_random_mechanisms_have_the_eigenvalues_of_the_full_pencil(
    seed: int, n_nodes: int, freedom: int, moving: bool
) -> None:
    rng = np.random.default_rng(seed)
    model = descriptor(random_mechanism(rng, n_nodes, 6 * n_nodes - freedom, moving))
    modal = modes(model)
    assert len(modal.lam) == 2 * freedom
    assert_modal(model, modal, 1e-7)
    # QZ spreads the infinite eigenvalues of index 3; what it returns below 1e3 rad/s must be ours
    assert_allclose(sort(modal.lam), dense_eigenvalues(model), rtol=1e-5, atol=1e-5)


@given(seed=st.integers(0, 2**32 - 1), n_velocity=st.integers(1, 3))
@settings(max_examples=25, deadline=None)
def test_velocity_constraints(seed: int, n_velocity: int) -> None:
    rng = np.random.default_rng(seed)
    n_q, n_r = 12, 8
    X, Y = rng.normal(size=(2, n_q, n_q))
    Phi, Phi_rate = rng.normal(size=(n_r, n_q)), np.zeros((n_r, n_q))
    Phi_rate[:n_velocity] = rng.normal(size=(n_velocity, n_q))
    M, K = X @ X.T / n_q + np.eye(n_q), Y @ Y.T / n_q + np.eye(n_q)
    reaction = np.where(np.arange(n_r)[:, None] < n_velocity, Phi_rate, Phi)  # ideal: work along the constrained rate
    model = descriptor(
        assemble(
            [("a", True), ("b", True)], [("j", n_r)], M, 0.2 * M + 0.1 * K, K, Phi, B=reaction.T, Phi_rate=Phi_rate
        )
    )
    modal = modes(model)
    # each velocity constraint takes one first-order unknown, each holonomic one takes two
    assert len(modal.lam) + modal.n_zero == 2 * (n_q - n_r) + n_velocity
    assert_modal(model, modal, 1e-7)
    assert_allclose(sort(modal.lam), dense_eigenvalues(model), rtol=1e-4, atol=1e-4)


def test_rolling_without_stiffness_has_a_zero_eigenvalue_set_aside() -> None:
    """x' - 0.5 gz' = 0, spring on neither: one free rigid motion; the constraint's own constant is the second zero."""
    M, K, D = np.eye(6), np.zeros((6, 6)), np.zeros((6, 6))
    K[1:5, 1:5] = np.diag([4.0, 9.0, 16.0, 25.0])
    Phi_rate = np.zeros((1, 6))
    Phi_rate[0, [0, 5]] = 1.0, -0.5
    modal = modes(
        descriptor(assemble([("wheel", True)], [("roll", 1)], M, D, K, np.zeros((1, 6)), Phi_rate.T, Phi_rate))
    )
    assert_allclose(np.abs(modal.lam), [2, 2, 3, 3, 4, 4, 5, 5], rtol=1e-9)
    assert modal.n_zero == 3  # x and gz: position of each, and the shared speed


def one_body(K: np.ndarray, D: np.ndarray, M: np.ndarray | None = None) -> DescriptorModel:
    """A free body with diagonal properties."""
    return descriptor(
        assemble([("body", True)], [], np.eye(6) if M is None else M, np.diag(D), np.diag(K), np.zeros((0, 6)))
    )


def test_repeated_frequencies_keep_independent_vectors() -> None:
    model = one_body(np.full(6, 9.0), np.full(6, 0.6))
    modal = modes(model)
    assert modal.diagonal and len(modal.lam) == 12
    assert_allclose(modal.frequency_hz, 3.0 / (2 * np.pi))
    assert_allclose(modal.damping, 0.1)
    assert_modal(model, modal)


def test_critical_damping_is_defective_and_gets_a_real_basis() -> None:
    model = one_body(np.full(6, 4.0), np.array([4.0, 0.1, 0.2, 0.3, 0.4, 0.5]))  # x: (s + 2)^2
    modal = modes(model)
    assert not modal.diagonal and np.isrealobj(modal.A) and np.isrealobj(modal.V_R)
    assert_allclose(sorted(modal.lam[np.abs(modal.lam.imag) < 1e-6].real), [-2.0, -2.0], atol=1e-7)
    assert_modal(model, modal)


def test_rigid_motion_is_set_aside() -> None:
    model = one_body(np.array([0.0, 0.0, 4.0, 9.0, 16.0, 25.0]), np.array([0.0, 0.5, 0.1, 0.1, 0.1, 0.1]))
    modal = modes(model)
    assert modal.n_zero == 3 and modal.n_infinite == 0  # x: double zero; y: zero and -0.5
    assert len(modal.lam) == 9
    assert_allclose(modal.lam[0], -0.5, atol=1e-12)
    assert_modal(model, modal)


def test_directions_without_mass() -> None:
    """A dashpot and a spring without mass: first order (lam = -k/d); a spring alone: no motion of its own."""
    M = np.diag([0.0, 0.0, 1.0, 1.0, 1.0, 1.0])
    model = one_body(np.array([6.0, 5.0, 4.0, 9.0, 16.0, 25.0]), np.array([2.0, 0.0, 0.1, 0.1, 0.1, 0.1]), M)
    modal = modes(model)
    assert modal.n_infinite == 3 and modal.n_zero == 0 and len(modal.lam) == 9
    assert np.isclose(modal.lam, -3.0, atol=1e-9).any()
    assert_modal(model, modal, 1e-7)


def test_redundant_constraints_change_nothing() -> None:
    rng = np.random.default_rng(3)
    single = random_mechanism(rng, 2, 7)
    plain = descriptor(single)
    q, r = plain.coordinates, plain.reactions
    Phi, B = plain.g_y[np.ix_(r, q)], plain.g_y[np.ix_(plain.equilibrium_rows, r)]
    twice = np.vstack([Phi, Phi[2] - 3.0 * Phi[4]])
    form = {
        "M": plain.g_ydot[np.ix_(plain.definition_rows, q)],
        "D": plain.g_ydot[np.ix_(plain.equilibrium_rows, q)],
        "K": plain.g_y[np.ix_(plain.equilibrium_rows, q)],
    }
    model = descriptor(
        assemble([("body_0", True), ("body_1", True)], [("joint", 8)], Phi=twice, B=np.hstack([B, B[:, :1]]), **form)
    )
    modal = modes(model)
    assert_allclose(sort(modal.lam), sort(modes(plain).lam), rtol=1e-9)
    assert_modal(model, modal)
    assert len(independent_constraints(twice)) == 7


def test_sign_of_the_cayley_eigenproblem() -> None:
    """(Lam J(c) - J(-c)) Y = 0 gives lam = (1/c)(Lam-1)/(Lam+1); the printed plus sign recovers 1/(c^2 lam)."""
    matrices = random_mechanism(np.random.default_rng(8), 1, 0)
    lam = sort(modes(descriptor(matrices)).lam)
    c = matrices.c

    def recovered(sign: float) -> np.ndarray:
        Lam = scipy.linalg.eigvals(-sign * matrices.J_minus, matrices.J_plus)
        return (Lam - 1.0) / (Lam + 1.0) / c

    assert_allclose(sort(recovered(-1.0)), lam, rtol=1e-8)
    assert_allclose(sort(1.0 / (c**2 * recovered(+1.0))), lam, rtol=1e-8)


@pytest.mark.parametrize(
    "name", ["c01a_revpin_rest", "c02b_sphpin_spin", "c03a_revhinge_rod_rest", "c06b_defhinge_moving"]
)
def test_stored_mbdyn_cases_have_mbdyn_s_own_eigenvalues(name: str) -> None:
    """Eigenvalues that MBDyn computed from its own pair, without those at Lam = +-1 (spurious there)."""
    from linear_models import CASES

    data = np.load(CASES / f"{name}.npz")
    alpha_re, alpha_im, beta = data["alpha"].T
    Lam = (alpha_re + 1j * alpha_im) / beta
    physical = Lam[(np.abs(Lam - 1.0) > 1e-6) & (np.abs(Lam + 1.0) > 1e-3)]
    expected = (physical - 1.0) / (physical + 1.0) / float(data["dCoef"])
    modal = modes(descriptor(case(name)))
    assert_modal(descriptor(case(name)), modal)
    assert_allclose(sort(modal.lam), sort(expected), rtol=1e-6, atol=1e-6)


def test_conjugate_pairs_are_side_by_side() -> None:
    modal = modes(descriptor(random_mechanism(np.random.default_rng(5), 2, 8)))
    k = 0
    while k < len(modal.lam):
        if modal.lam[k].imag == 0.0:
            k += 1
            continue
        assert modal.lam[k].imag > 0.0 and modal.lam[k + 1] == modal.lam[k].conj()
        assert_allclose(modal.V_R[:, k + 1], modal.V_R[:, k].conj(), atol=1e-12)
        k += 2


def test_matrices_of_something_else_are_refused() -> None:
    matrices = random_mechanism(np.random.default_rng(1), 1, 2)
    J = matrices.J_plus.copy()
    J[0, 6] += 0.3  # a momentum definition that is none
    with pytest.raises(MatrixError, match="momenta in their definitions"):
        modes(descriptor(dataclasses.replace(matrices, J_plus=J)))


def test_a_motion_that_nothing_determines_is_an_error() -> None:
    M = np.diag([0.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    model = one_body(np.array([0.0, 5.0, 4.0, 9.0, 16.0, 25.0]), np.zeros(6), M)
    with pytest.raises(MatrixError, match="singular"):
        modes(model)


@pytest.mark.parametrize("fast", [1e3, 2e6, 1e9])
def test_slow_modes_beside_fast_ones_are_kept(fast: float) -> None:
    """x grows at 1 rad/s against a spring that pushes away; the other directions ring at up to `fast`."""
    model = one_body(np.array([-1.0, 0.25, fast**2, fast**2, fast**2, fast**2]), np.zeros(6))
    modal = modes(model)
    assert modal.n_zero == 0 and modal.n_infinite == 0 and len(modal.lam) == 12
    assert_allclose(np.sort(modal.lam[np.abs(modal.lam) < 0.9 * fast].real), [-1.0, 0.0, 0.0, 1.0], atol=1e-7)
    assert_allclose(np.sort(np.abs(modal.lam)), [0.5, 0.5, 1.0, 1.0, *[fast] * 8], rtol=1e-9)


@pytest.mark.parametrize("fast", [1e3, 2e6])
def test_rigid_motion_beside_slow_and_fast_modes(fast: float) -> None:
    """Two bodies on one stiff spring that float freely in x, and are held softly elsewhere."""
    K = np.diag([0.0, 1.0, 1.0, 4.0, 4.0, 4.0] * 2)
    K[0, 0] = K[6, 6] = 0.5 * fast**2
    K[0, 6] = K[6, 0] = -0.5 * fast**2
    model = descriptor(assemble([("a", True), ("b", True)], [], np.eye(12), 0.0 * K, K, np.zeros((0, 12))))
    modal = modes(model)
    assert modal.n_zero == 2 and len(modal.lam) == 22
    assert_allclose(np.sort(np.abs(modal.lam)), [1.0] * 8 + [2.0] * 12 + [fast] * 2, rtol=1e-9)


def test_light_bodies_are_no_bodies_without_mass() -> None:
    """Two free spectra: 1 kg on soft springs beside 1e-9 kg on stiff ones, masses nine decades apart."""
    M = np.diag([1.0] * 6 + [1e-9] * 6)
    K = np.diag([0.25] * 3 + [1.0] * 3 + [1e9] * 6)
    modal = modes(descriptor(assemble([("a", True), ("b", True)], [], M, 0.0 * M, K, np.zeros((0, 12)))))
    assert modal.n_zero == 0 and modal.n_infinite == 0
    assert_allclose(np.sort(np.abs(modal.lam)), [0.5] * 6 + [1.0] * 6 + [1e9] * 12, rtol=1e-9)


@pytest.mark.parametrize(("distance", "diagonal"), [(1e-3, True), (1e-9, False)])
def test_vectors_that_are_nearly_dependent_are_no_basis(distance: float, diagonal: bool) -> None:
    """x: (s + 2)(s + 2 + distance); the basis stays real where the two vectors are closer than 1e-5 or so."""
    a, b = 2.0, 2.0 + distance
    model = one_body(np.array([a * b, 4.0, 9.0, 16.0, 25.0, 36.0]), np.array([a + b, 0.1, 0.2, 0.3, 0.4, 0.5]))
    modal = modes(model)
    assert modal.diagonal == diagonal
    assert np.iscomplexobj(modal.V_R) == diagonal
    assert_modal(model, modal)
