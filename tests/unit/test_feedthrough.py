"""Feedthrough: closed forms, the literal formula, realisations, files, refusals.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_models import assemble
from numpy.testing import assert_allclose

from pilotgen.errors import EvaluationError, FileError, MatrixError, StudyError
from pilotgen.linear.feedthrough import CERTIFICATE_BAND_HZ, certificate, make_pilot_model, mayo_pilot
from pilotgen.linear.full_order import full_order_response
from pilotgen.linear.imposed_motion import Channels, split, translation_error
from pilotgen.linear.pilot_model import PilotModel, read_pilot_model
from pilotgen.solver.matrices import Matrices, descriptor

OMEGA = 2.0 * np.pi * np.geomspace(0.1, 20.0, 40)
# a lever on the seat: mass m at distance r from the hinge, moment of inertia J about it, spring and damper in the hinge
MASS, ARM, INERTIA, DAMPING, STIFFNESS = 2.0, 0.25, 0.15, 0.6, 90.0


def lever_on_seat(
    stiffness: float = STIFFNESS, damping: float = DAMPING, ground: float = 0.0, seat_dynamic: bool = False
) -> Matrices:
    """Seat (imposed), lever with its hinge at the node and its mass at x = ARM; optionally a spring to the ground."""
    M, D, K = np.zeros((12, 12)), np.zeros((12, 12)), np.zeros((12, 12))
    seat, lever = np.arange(6), np.arange(6, 12)
    M[lever, lever] = [MASS, MASS, MASS, 0.01, 0.2, INERTIA]
    M[7, 11] = M[11, 7] = MASS * ARM  # rotation about z moves the mass up
    if seat_dynamic:
        M[seat, seat] = 3.0
    for matrix, value in ((K, stiffness), (D, damping)):
        matrix[11, 11] = matrix[5, 5] = value
        matrix[11, 5] = matrix[5, 11] = -value
    K[7, 7] += ground
    pin, hinge = np.zeros((6, 12)), np.zeros((5, 12))
    pin[:, seat] = np.eye(6)
    hinge[:, lever[:5]], hinge[:, seat[:5]] = np.eye(5), -np.eye(5)
    return assemble(
        [("seat", seat_dynamic), ("lever", True)],
        [("seat_pin", 6), ("lever_hinge", 5)],
        M, D, K, np.vstack([pin, hinge]),
    )  # fmt: skip


def lever_closed_form(omega: np.ndarray, stiffness: float = STIFFNESS, damping: float = DAMPING) -> np.ndarray:
    """J phi'' + d phi' + k phi = -m r zddot."""
    s = 1j * omega
    return -MASS * ARM / (INERTIA * s**2 + damping * s + stiffness)


@pytest.mark.parametrize("seat_dynamic", [False, True])
def test_lever_has_its_closed_form(seat_dynamic: bool) -> None:
    model = make_pilot_model(lever_on_seat(seat_dynamic=seat_dynamic), lever_length_m=0.4)
    assert_allclose(model.response(OMEGA), lever_closed_form(OMEGA), rtol=1e-10)
    assert_allclose(model.grip_motion(OMEGA), 0.4 * lever_closed_form(OMEGA), rtol=1e-10)
    assert certificate(model) < 1e-10
    assert model.translation_error is not None and model.translation_error < 1e-12
    w = np.sqrt(STIFFNESS / INERTIA)
    frequency, damping = w / (2 * np.pi), DAMPING / (2 * INERTIA * w)
    assert_allclose(model.dominant_pair(), (frequency, damping), rtol=1e-10)
    assert model.pole_list() == [pytest.approx({"frequency_hz": frequency, "damping": damping})]


def test_overdamped_lever_has_two_real_poles() -> None:
    damping = 2.5 * np.sqrt(STIFFNESS * INERTIA)
    model = make_pilot_model(lever_on_seat(damping=damping), 0.4)
    assert_allclose(model.response(OMEGA), lever_closed_form(OMEGA, damping=damping), rtol=1e-9)
    assert [pole["damping"] for pole in model.pole_list()] == [1.0, 1.0]
    assert model.dominant_pair()[1] == 1.0


@pytest.mark.parametrize("projection", ["exact", "literal"])
def test_critically_damped_lever_has_no_two_eigenvectors(projection: str) -> None:
    damping = 2.0 * np.sqrt(STIFFNESS * INERTIA)
    model = make_pilot_model(lever_on_seat(damping=damping), 0.4, washout_rad_s=3.1, projection=projection)
    assert model.residues is None
    if projection == "exact":
        assert_allclose(model.response(OMEGA, washout=False), lever_closed_form(OMEGA, damping=damping), rtol=1e-9)
        assert certificate(model) < 1e-9
    assert_realised(model)


def test_literal_formula_is_equation_31() -> None:
    """Eq. (31) as printed, written out with matrices of the test's own: C (sE - A)^-1 (s B1 + B2) / s^2."""
    matrices = lever_on_seat()
    model = make_pilot_model(matrices, 0.4, projection="literal")
    imposed = split(descriptor(matrices))
    # the only retained modes are the lever's: project the imposed on the rotation phi by hand
    w2, d = STIFFNESS / INERTIA, DAMPING / INERTIA
    lam = np.roots([1.0, d, w2])
    s = 1j * OMEGA
    # phi/z = -(m r/J) s^2/(s^2 + d s + w2) = constant + sum of residues; the projection keeps the sum only
    numerator = -MASS * ARM / INERTIA
    kept = numerator * (-(d * s + w2)) / (s**2 + d * s + w2)
    assert_allclose(model.response(OMEGA), kept / s**2, rtol=1e-9)
    assert_allclose(np.sort_complex(model.poles), np.sort_complex(lam), rtol=1e-10)
    assert certificate(model) > 1.0  # it is not the response of the imposed
    assert_allclose(full_order_response(imposed, OMEGA), lever_closed_form(OMEGA), rtol=1e-9)


def resolvent(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """(j omega I - A)^-1 B at every frequency of OMEGA."""
    return np.linalg.solve(1j * OMEGA[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B, (len(OMEGA), *B.shape)))


def assert_realised(model: PilotModel) -> None:
    """The state space has the response of the formula, with and without washout."""
    for washout in (True, False):
        A, B, C, D = model.state_space(washout=washout)
        assert all(np.isrealobj(matrix) for matrix in (A, B, C, D))
        states = resolvent(A, B)
        assert_allclose((C @ states + D)[:, 0, 0], model.response(OMEGA, washout=washout), rtol=1e-9)
    corner = model.washout_rad_s
    if corner is not None:
        assert np.abs(np.linalg.eigvals(model.state_space()[0])).min() > 0.5 * corner  # no integrator left


@pytest.mark.parametrize("washout_rad_s", [3.1, None])
@pytest.mark.parametrize("projection", ["exact", "literal", "mayo"])
def test_realisations(projection: str, washout_rad_s: float | None) -> None:
    if projection == "mayo":
        model = mayo_pilot(3.38, 0.32, 0.117, 0.3, washout_rad_s)
    else:
        model = make_pilot_model(lever_on_seat(), 0.4, washout_rad_s, projection)
    assert_realised(model)


def test_washout_is_the_second_order_high_pass() -> None:
    plain, washed = (make_pilot_model(lever_on_seat(), 0.4, corner) for corner in (None, 3.1))
    s = 1j * OMEGA
    assert_allclose(washed.response(OMEGA), plain.response(OMEGA) * (s / (s + 3.1)) ** 2, rtol=1e-12)


@given(
    frequency=st.floats(0.5, 10.0), damping=st.floats(0.01, 2.0), tau=st.floats(0.02, 1.0), length=st.floats(0.1, 1.0)
)
@settings(max_examples=30, deadline=None)
def test_mayo_s_form(frequency: float, damping: float, tau: float, length: float) -> None:
    """Paper eq. (40)."""
    s, w = 1j * OMEGA, 2.0 * np.pi * frequency
    expected = -s / length / (s + 3.10) ** 2 * (s + 1.0 / tau) / (s**2 + 2.0 * damping * w * s + w**2)
    assert_allclose(mayo_pilot(frequency, damping, tau, length).response(OMEGA), expected, rtol=1e-7)


def test_mayo_s_mesomorphic_grip_motion() -> None:
    """3.50 mm per m/s^2 at 3 Hz, 102.4 deg; 3.43 mm at 1 Hz, 114.8 deg; 0.49 mm at 8 Hz (docs/validation.md)."""
    motion = mayo_pilot(3.750, 0.28, 0.107, 0.32).grip_motion(2.0 * np.pi * np.array([1.0, 3.0, 8.0]))
    assert_allclose(1e3 * np.abs(motion), [3.43, 3.50, 0.49], atol=0.005)
    assert_allclose(np.degrees(np.angle(motion)), [114.8, 102.4, 8.1], atol=0.05)


def test_certificate_sees_a_wrong_model() -> None:
    model = make_pilot_model(lever_on_seat(), 0.4)
    wrong = dataclasses.replace(model, C=model.C * (1.0 + 1e-6), _modal=None)
    assert 0.5e-6 < certificate(wrong) < 2e-6
    moved = dataclasses.replace(model, A=model.A * (1.0 + 1e-6), _modal=None)
    assert certificate(moved) > 1e-7
    assert certificate(wrong, CERTIFICATE_BAND_HZ) == pytest.approx(1e-6, rel=1e-3)
    with pytest.raises(MatrixError, match="carries no matrices"):
        certificate(mayo_pilot(3.0, 0.3, 0.1, 0.3))


def test_redundant_constraints_have_a_certificate() -> None:
    matrices = lever_on_seat()
    names = np.append(matrices.names, [b"lever_hinge.reaction[6]"])
    n = matrices.n
    grown = {}
    for name in ("J_plus", "J_minus"):
        J = np.zeros((n + 1, n + 1))
        J[:n, :n] = getattr(matrices, name)
        J[n], J[:, n] = 2.0 * J[n - 1], J[:, n - 2]  # says again what other constraints say
        grown[name] = J
    model = make_pilot_model(
        dataclasses.replace(matrices, names=names, kinds=np.append(matrices.kinds, [b"reaction"]), **grown), 0.4
    )
    assert_allclose(model.response(OMEGA), lever_closed_form(OMEGA), rtol=1e-9)
    assert certificate(model) < 1e-9


# ---- refusals


def test_models_that_do_not_move_with_the_cockpit_are_refused() -> None:
    with pytest.raises(EvaluationError, match="feedthrough: the model changes when .* translate together"):
        make_pilot_model(lever_on_seat(ground=1e-3), 0.4)


def test_free_motion_is_refused() -> None:
    with pytest.raises(EvaluationError, match="feedthrough: .* some part moves freely"):
        make_pilot_model(lever_on_seat(stiffness=0.0, damping=0.0), 0.4)


def test_missing_names_are_named() -> None:
    for channels, message in (
        (Channels(seat="chair"), "unknown 'chair.x' is not among"),
        (Channels(outputs={"collective_rotation": {"stick.gz": 1.0}}), "unknown 'stick.gz' is not"),
    ):
        with pytest.raises(MatrixError, match=message):
            make_pilot_model(lever_on_seat(), 0.4, channels=channels)


def test_a_seat_that_nothing_holds_is_refused() -> None:
    matrices = lever_on_seat()
    model = descriptor(matrices)
    without_pin = np.setdiff1d(np.arange(matrices.n), model.owned_by("seat_pin"))
    with pytest.raises(MatrixError, match="no joint holds 'seat' and nothing else"):
        split(model.restrict(without_pin))


def test_bad_numbers_are_refused() -> None:
    with pytest.raises(StudyError, match="lever_length_m = 0 m must be greater than zero"):
        make_pilot_model(lever_on_seat(), 0.0)
    with pytest.raises(StudyError, match="projection = 'better' is not known"):
        make_pilot_model(lever_on_seat(), 0.4, projection="better")
    with pytest.raises(StudyError, match="pilot damping"):
        mayo_pilot(3.0, -0.1, 0.1, 0.3)


# ---- outputs and files


def test_two_outputs_and_control() -> None:
    outputs = {
        "collective_rotation": {"lever.gz": 1.0},
        "grip_height": {"lever.gz": 0.4, "lever.y": 1.0},
        "gone": {"x.y": 1.0},
    }
    model = make_pilot_model(lever_on_seat(), 0.4, 3.1, channels=Channels(outputs=outputs))
    assert model.outputs == ("collective_rotation", "grip_height")
    system = model.to_control()
    assert system.input_labels == ["seat_heave_acceleration"]
    assert system.output_labels == ["collective_rotation", "grip_height", "grip_motion"]
    response = np.squeeze(system(1j * OMEGA))
    assert_allclose(response[0], model.response(OMEGA), rtol=1e-9)
    assert_allclose(response[1], model.response(OMEGA, output=1), rtol=1e-9)
    assert_allclose(response[2], 0.4 * model.response(OMEGA), rtol=1e-9)


@pytest.mark.parametrize("kind", ["exact", "literal", "defective", "mayo", "no washout"])
def test_file_round_trip(tmp_path: Path, kind: str) -> None:
    model = {
        "exact": lambda: make_pilot_model(lever_on_seat(), 0.4, 3.1),
        "literal": lambda: make_pilot_model(lever_on_seat(), 0.4, 3.1, "literal"),
        "defective": lambda: make_pilot_model(lever_on_seat(damping=2.0 * np.sqrt(STIFFNESS * INERTIA)), 0.4, 3.1),
        "mayo": lambda: mayo_pilot(3.38, 0.32, 0.117, 0.3),
        "no washout": lambda: make_pilot_model(lever_on_seat(), 0.4),
    }[kind]()
    path = tmp_path / "pilot_model.h5"
    model.write(path)
    read = read_pilot_model(path)
    for name in ("projection", "outputs", "lever_length_m", "integrators", "washout_rad_s", "translation_error"):
        assert getattr(read, name) == getattr(model, name)
    assert_allclose(read.response(OMEGA), model.response(OMEGA), rtol=1e-11)
    assert_allclose(np.sort_complex(read.poles), np.sort_complex(model.poles), rtol=1e-7)
    with h5py.File(path) as file:  # the file alone is a state space with named signals
        A, B, C, D = (file[name][()] for name in "ABCD")
        assert [name.decode() for name in file["outputs/name"]] == [*model.outputs, "grip_motion"]
        assert file["inputs/unit"][0] == b"m/s^2" and file["outputs/unit"][-1] == b"m"
    states = resolvent(A, B)
    assert_allclose((C @ states + D)[:, 0, 0], model.response(OMEGA), rtol=1e-9)


def test_damaged_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "pilot_model.h5"
    with pytest.raises(FileError, match="cannot be read"):
        read_pilot_model(path)
    make_pilot_model(lever_on_seat(), 0.4).write(path)
    with h5py.File(path, "a") as file:
        file["modes/A"][0, 0] = np.nan
    with pytest.raises(MatrixError, match="does not have the checksum"):
        read_pilot_model(path)
    with h5py.File(path, "a") as file:
        del file.attrs["content_sha256"]  # as files of before
    with pytest.raises(MatrixError, match="modes/A"):
        read_pilot_model(path)
    with h5py.File(path, "a") as file:
        del file["modes/A"]
    with pytest.raises(MatrixError, match="missing"):
        read_pilot_model(path)
    with h5py.File(path, "a") as file:
        file.attrs["filetype"] = np.bytes_("else")
    with pytest.raises(MatrixError, match="its filetype is 'else'"):
        read_pilot_model(path)
    with pytest.raises(FileError, match="cannot be written"):
        make_pilot_model(lever_on_seat(), 0.4).write(tmp_path / "no" / "such" / "place.h5")


@pytest.mark.parametrize("part", ["K", "C", "Phi_0", "Phi_1"])
def test_translation_check_sees_every_block(part: str) -> None:
    """Seat and two coordinates translate together by 1; a block that does not follow is off by half of its size."""
    columns = {"K": "K_imposed", "C": "C_imposed", "Phi_0": "g_y_imposed", "Phi_1": "g_ydot_imposed"}
    blocks = {name: np.array([[2.0, 0.0], [0.0, 2.0]]) for name in columns}
    seat = {column: np.array([[-2.0], [-2.0 if name != part else -1.0]]) for name, column in columns.items()}

    def error(imposed: dict[str, np.ndarray]) -> float:
        return translation_error(
            SimpleNamespace(
                free=SimpleNamespace(constraint_rows=np.arange(2)),
                form=SimpleNamespace(**blocks),
                rigid=np.ones((2, 1)),
                **imposed,
            )  # type: ignore[arg-type]
        )

    assert error(seat) == pytest.approx(0.5)
    assert error({column: np.full((2, 1), -2.0) for column in seat}) == 0.0
