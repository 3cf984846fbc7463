"""Loops of several controls: plants, poles, margins; one control is the heave loop.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import control
import h5py
import numpy as np
import pytest
import scipy.io
from numpy.testing import assert_allclose

from pilotgen.errors import FileError, StudyError
from pilotgen.linear.feedthrough import mayo_pilot
from pilotgen.linear.imposed_motion import SEAT_MOTIONS
from pilotgen.linear.pilot_model import PilotModel
from pilotgen.linear.statespace import StateSpaceModel
from pilotgen.loop.heave_model import HeaveModel
from pilotgen.loop.loop import LoopModel, heave_loop
from pilotgen.loop.margins import margins
from pilotgen.loop.mimo import MatrixLoop, close
from pilotgen.loop.plants import (
    MatrixPlant,
    bundled_plants,
    load_plant,
    one_channel,
    plant_from,
    roll_plant,
    roll_rotorcraft,
)
from pilotgen.loop.rotorcraft_model import rotorcraft_model
from pilotgen.study.rotorcraft import Rotorcraft, load_rotorcraft

OMEGA = 2.0 * np.pi * np.geomspace(0.1, 15.0, 60)


def pilot_of(inputs: tuple[str, ...], outputs: tuple[str, ...], seed: int, gain: float = 0.02) -> PilotModel:
    """A stable pilot matrix of random modes, two pairs at 2 to 4 Hz, with a washout."""
    rng = np.random.default_rng(seed)
    blocks = []
    for hz in rng.uniform(2.0, 4.0, 2):
        w, z = 2.0 * np.pi * hz, 0.25
        blocks.append([[-z * w, w * np.sqrt(1 - z**2)], [-w * np.sqrt(1 - z**2), -z * w]])
    A = np.zeros((4, 4))
    A[:2, :2], A[2:, 2:] = blocks
    return PilotModel(
        projection="exact",
        A=A,
        B=rng.normal(size=(4, len(inputs))),
        C=gain * rng.normal(size=(len(outputs), 4)),
        D=np.zeros((len(outputs), len(inputs))),
        inputs=tuple(f"seat_{name}_acceleration" for name in inputs),
        outputs=outputs,
        lever_length_m=0.32,
        washout_rad_s=3.1,
    )


ALL = tuple(SEAT_MOTIONS)
OUTPUTS = ("collective_rotation", "cyclic_aft", "cyclic_right")


def lynx_loop(
    seed: int = 1, gain: float = 0.003, controls: tuple[str, ...] = ("collective", "longitudinal", "lateral")
) -> MatrixLoop:
    plant = load_plant("lynx-hover").at_seat((1.5, 0.2, -0.4))
    return close(pilot_of(ALL, OUTPUTS, seed, gain), plant, dict.fromkeys(controls, 0.4))


# ---- plants


@pytest.mark.parametrize(
    ("name", "printed"),
    [
        ("lynx-hover", [-11.5, -2.304, -0.7104, -0.2923, -0.1593 + 0.599j, 0.2342 + 0.5513j]),
        (
            "oh58d-hover",
            [-2.916 + 6.55j, -2.554 + 3.877j, -0.578 + 0.349j, -0.398, -0.269, 0.242, 0.433],
        ),
    ],
)
def test_bundled_plants_have_the_printed_eigenvalues(name: str, printed: list[complex]) -> None:
    assert name in bundled_plants()
    plant = load_plant(name)
    lam = np.linalg.eigvals(plant.A)
    for value in printed:
        assert np.abs(lam - value).min() < 2e-3 * max(abs(value), 1.0)
    assert plant.source and len(plant.motions) == 6


def test_signs_and_sizes_of_the_lynx() -> None:
    """Collective lifts at 84 m/s^2 per rad, aft stick pitches up, right stick rolls right, all at once after a step."""
    plant = load_plant("lynx-hover")
    at_once = dict(zip(plant.motions, plant.D @ np.eye(3), strict=True))
    assert at_once["heave"][plant.controls.index("collective")] == pytest.approx(84.19, rel=1e-3)
    assert at_once["pitch"][plant.controls.index("longitudinal")] == pytest.approx(27.22, rel=1e-3)
    assert at_once["roll"][plant.controls.index("lateral")] == pytest.approx(157.7, rel=1e-3)


def test_another_seat() -> None:
    """A seat ahead goes up when the nose does; above the roll axis it goes right in a right roll; right of it, down."""
    plant = load_plant("lynx-hover")
    moved = plant.at_seat((2.0, 0.5, 0.7))
    row = {name: i for i, name in enumerate(plant.motions)}
    for motion, shares in {
        "heave": {"pitch": 2.0, "roll": -0.7},
        "sway": {"roll": 0.5, "yaw": 2.0},
        "surge": {"pitch": -0.5, "yaw": -0.7},
    }.items():
        expected = plant.D[row[motion]] + sum(share * plant.D[row[other]] for other, share in shares.items())
        assert_allclose(moved.D[row[motion]], expected, rtol=1e-12)


@pytest.mark.parametrize("name", list(roll_rotorcraft()))
def test_roll_with_flapping(name: str) -> None:
    found = roll_rotorcraft()[name]
    assert found.roll is not None
    tau, flap, delay = found.roll["time_constant_s"], found.roll["flap_1_s2"], found.delay_s
    plant = roll_plant(tau, flap, delay, 0.6)
    s = 1j * OMEGA
    H = (
        plant.C
        @ np.linalg.solve(
            s[:, None, None] * np.eye(len(plant.A)) - plant.A,
            np.broadcast_to(plant.B.astype(complex), (len(s), *plant.B.shape)),
        )
        + plant.D
    )
    rate = flap / tau * np.exp(-delay * s) / (s**2 + s / tau + flap)
    inside = OMEGA < 2.0 * np.pi * 10.0
    assert_allclose(H[inside, 0, 0], (s * rate)[inside], rtol=2e-6)
    assert_allclose(H[:, 1, 0], 0.6 * H[:, 0, 0], rtol=1e-12)
    assert -np.linalg.eigvals(plant.A[:2, :2]).real.max() > 0.0


# ---- loops


def test_one_control_is_the_heave_loop() -> None:
    puma = HeaveModel(load_rotorcraft("iar330-puma"))
    H = puma.state_space
    plant = MatrixPlant(
        H.A, H.B[:, None], H.C[None, :], np.array([[H.D]]), ("collective",), ("heave",), False, "Puma", ""
    )
    for numbers in ((3.750, 0.28, 0.107), (2.5, 0.20, 0.06), (2.5, 0.35, 0.06)):
        mayo = mayo_pilot(*numbers, 0.32)
        A, B, C, D = mayo.state_space()
        loop = LoopModel(StateSpaceModel(A, B[:, 0], C[0], float(D[0, 0])), puma, 1.1, 0.32, mayo.partial_fractions())
        matrix = close(mayo, plant, {"collective": 1.1 * 0.32})
        assert_allclose(
            np.sort_complex(matrix.closed_loop_poles), np.sort_complex(loop.closed_loop_poles), rtol=1e-6, atol=1e-9
        )
        assert_allclose(matrix.response(OMEGA)[:, 0, 0], loop.response(OMEGA), rtol=1e-9)
        one, expected = matrix.loop_at_a_time()["collective"], margins(loop)
        for key in ("stable", "gain_margin_db", "phase_margin_deg", "modulus_margin", "disk_margin"):
            assert getattr(one, key) == pytest.approx(getattr(expected, key), rel=1e-6), key
        assert matrix.disk_margin()[0] == pytest.approx(expected.disk_margin, rel=1e-5)


def test_closed_loop_poles_are_those_of_python_control() -> None:
    for seed in range(3):
        loop = lynx_loop(seed)
        closed = control.feedback(control.ss(loop.A, loop.B, loop.C, loop.D), control.ss([], [], [], np.eye(3)))
        assert_allclose(np.sort_complex(loop.closed_loop_poles), np.sort_complex(closed.poles()), rtol=1e-7, atol=1e-8)


def test_a_loop_with_the_others_closed() -> None:
    """L_i = L_ii - L_ir (I + L_rr)^-1 L_ri, point by point."""
    loop = lynx_loop(2)
    L = loop.response(OMEGA)
    for i, name in enumerate(loop.controls):
        rest = [k for k in range(3) if k != i]
        inner = np.linalg.solve(np.eye(2) + L[:, rest][:, :, rest], L[:, rest, i][:, :, None])[:, :, 0]
        expected = L[:, i, i] - (L[:, i, rest] * inner).sum(axis=1)
        assert_allclose(loop.one_open(name).response(OMEGA), expected, rtol=1e-9)
        assert loop.one_open(name).feedback().poles.real.max() == pytest.approx(
            loop.closed_loop_poles.real.max(), rel=1e-6
        )


def stable_loop() -> MatrixLoop:
    """Two roll-and-heave controls of stable plants, strongly coupled by the pilot."""
    heave = HeaveModel(load_rotorcraft("iar330-puma")).state_space
    roll = roll_plant(0.0723, 46.3, 0.0, 0.6)
    n = heave.n_states
    A, B = np.zeros((n + 2, n + 2)), np.zeros((n + 2, 2))
    A[:n, :n], A[n:, n:], B[:n, 0], B[n:, 1] = heave.A, roll.A, heave.B, roll.B[:, 0]
    C, D = np.zeros((3, n + 2)), np.zeros((3, 2))
    C[0, :n], C[1:, n:], D[0, 0], D[1:, 1] = heave.C, roll.C, heave.D, roll.D[:, 0]
    plant = MatrixPlant(A, B, C, D, ("collective", "lateral"), ("heave", "roll", "sway"), False, "two", "")
    pilot = pilot_of(("heave", "roll", "sway"), ("collective_rotation", "cyclic_right"), 5, 0.01)
    return close(pilot, plant, {"collective": 0.35, "lateral": 0.5})


def test_the_disk_margin_is_a_guarantee_and_nearly_exact() -> None:
    """Against the structured singular value by brute force: spectral radius over phases, exact for two loops."""
    loop = stable_loop()
    alpha, hz = loop.disk_margin()
    assert 0.0 < alpha < 2.0
    L = loop.response([2.0 * np.pi * hz])[0]
    M = (np.eye(2) - L) @ np.linalg.inv(np.eye(2) + L)
    angles = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 4001))
    mu = max(np.abs(np.linalg.eigvals(np.diag([1.0, a]) @ M)).max() for a in angles)
    assert alpha == pytest.approx(2.0 / mu, rel=1e-3)
    assert alpha <= 2.0 / mu * (1.0 + 1e-6)
    rng = np.random.default_rng(3)
    for _ in range(200):  # real and complex changes within the disk, both loops at once: det(I + F L) never vanishes
        d = rng.uniform(0.0, 0.99, 2) * np.exp(2j * np.pi * rng.random(2))
        F = np.diag((1.0 + 0.5 * alpha * d) / (1.0 - 0.5 * alpha * d))
        gains = np.diag(np.abs(np.diag(F)))
        for real in (np.eye(2), gains):
            closed = loop.A - loop.B @ real @ np.linalg.solve(np.eye(2) + loop.D @ real, loop.C)
            assert np.linalg.eigvals(closed).real.max() < 0.0


def eigenvalue_loci(loop: MatrixLoop, omega: np.ndarray) -> np.ndarray:
    """Eigenvalues of L(j omega), shape (f, m), each column one continuous branch: the generalised Nyquist plot."""
    values = np.linalg.eigvals(loop.response(omega)).astype(np.complex128)
    for k in range(1, len(values)):
        left = list(range(values.shape[1]))
        order = []
        for previous in values[k - 1]:
            nearest = min(left, key=lambda j: abs(values[k, j] - previous))
            order.append(nearest)
            left.remove(nearest)
        values[k] = values[k, order]
    return values


def test_generalised_nyquist_counts_the_unstable_poles() -> None:
    """Turns of det(I + L) around the origin, from the branches of the eigenvalues, against the closed-loop poles."""
    omega = np.concatenate((np.linspace(1e-4, 0.1, 2000), np.geomspace(0.1, 1e4, 20000)[1:]))
    for seed, gain in ((1, 0.001), (1, 0.02), (2, 0.05)):
        loop = lynx_loop(seed, gain)
        loci = eigenvalue_loci(loop, omega)
        assert_allclose(np.prod(1.0 + loci, axis=1), np.linalg.det(np.eye(3) + loop.response(omega)), rtol=1e-8)
        turn = np.unwrap(np.angle(np.prod(1.0 + loci, axis=1)))
        counter_clockwise = 2.0 * (turn[-1] - turn[0]) / (2.0 * np.pi)
        opened = int((np.linalg.eigvals(loop.A).real > 0.0).sum())
        closed = int((loop.closed_loop_poles.real > 0.0).sum())
        assert counter_clockwise == pytest.approx(opened - closed, abs=0.05)


# ---- refusals


def description(**changes: Any) -> dict[str, Any]:
    plain: dict[str, Any] = {
        "A": [[-1.0]],
        "B": [[2.0]],
        "C": [[1.0]],
        "D": [[0.0]],
        "inputs": [{"control": "lateral", "unit": "deg", "positive": "left"}],
        "outputs": [{"motion": "roll", "unit": "deg/s^2", "positive": "right"}],
    }
    return {key: value for key, value in (plain | changes).items() if value is not None}


def test_units_and_signs_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "plant.json"
    path.write_text(json.dumps(description()))
    plant = load_plant(str(path))
    assert plant.controls == ("lateral",) and plant.motions == ("roll",)
    assert plant.C[0, 0] * plant.B[0, 0] == pytest.approx(-2.0)  # deg per deg is rad per rad; left is minus right


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"A": None}, "A is missing"),
        ({"A": [[1.0, 2.0]]}, "a square matrix is wanted"),
        ({"B": [[1.0, 2.0]]}, r"B has shape \(1, 2\); \(1, 1\) is wanted"),
        ({"B": [["x"]]}, "no matrix of numbers"),
        ({"A": [[float("nan")]]}, "not finite"),
        ({"inputs": None}, "inputs is missing"),
        ({"inputs": [{"control": "pedals", "unit": "rad", "positive": "right"}]}, "pedals are not modelled"),
        ({"inputs": [{"control": "lateral", "positive": "left"}]}, "unit of a signal is missing"),
        (
            {"inputs": [{"control": "lateral", "unit": "rad", "positive": "up"}]},
            "positive of a signal = 'up' is not known",
        ),
        ({"outputs": [{"motion": "roll", "unit": "g", "positive": "right"}]}, "'roll' cannot be in g"),
        (
            {"outputs": [{"motion": "roll", "unit": "rad/s^2", "positive": "right", "derivative_of": "p"}]},
            "derivative_of = 'p' is no state",
        ),
    ],
)
def test_wrong_plants_are_refused_by_name(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(FileError, match=message):
        plant_from(description(**changes), "plant.json")


def test_what_pilot_and_plant_do_not_share_is_refused() -> None:
    plant = load_plant("lynx-hover")
    with pytest.raises(StudyError, match="the plant moves the seat in surge, sway, roll, pitch, yaw, which the pilot"):
        close(mayo_pilot(3.4, 0.3, 0.1, 0.32), plant, {"collective": 0.35})
    with pytest.raises(StudyError, match="control 'lateral' is held by no arm of this pilot"):
        close(pilot_of(ALL, OUTPUTS[:2], 1), plant, {"lateral": 0.35})
    with pytest.raises(FileError, match="plant 'lynks-hover' is not known; did you mean 'lynx-hover'"):
        load_plant("lynks-hover")
    assert dataclasses.is_dataclass(plant)


# ---- files with named signals


def named_plant(path: Path, model: StateSpaceModel, **fields: Any) -> Path:
    """Heave by the collective, and a second channel that is nobody's business, as JSON, MATLAB or HDF5."""
    n = model.n_states
    A = np.zeros((n + 1, n + 1))
    A[:n, :n], A[n, n] = model.A, -1.0
    B, C = np.zeros((n + 1, 2)), np.zeros((2, n + 1))
    B[:n, 1], B[n, 0], C[1, :n], C[0, n] = model.B, 1.0, model.C, 1.0
    D = np.array([[0.0, 0.0], [0.0, model.D]])
    gain = math.radians(1.0) / 9.80665
    C[1], D[1] = -gain * C[1], -gain * D[1]
    inputs = [
        {"control": "lateral", "unit": "deg", "positive": "left"},
        {"control": "collective", "unit": "deg", "positive": "up"},
    ]
    outputs = [
        {"motion": "roll", "unit": "deg/s^2", "positive": "right"},
        {"motion": "heave", "unit": "g", "positive": "down", **fields},
    ]
    matrices = {"A": A, "B": B, "C": C, "D": D}
    if path.suffix == ".json":
        data = {**{key: value.tolist() for key, value in matrices.items()}, "inputs": inputs, "outputs": outputs}
        path.write_text(json.dumps(data))
    elif path.suffix == ".mat":
        structs = {
            key: np.array([tuple(one.values()) for one in signals], dtype=[(name, object) for name in signals[0]])
            for key, signals in (("inputs", inputs), ("outputs", outputs))
        }
        scipy.io.savemat(path, {**matrices, **structs})
    else:
        with h5py.File(path, "w") as file:
            for key, value in matrices.items():
                file[key] = value
            for key, signals in (("inputs", inputs), ("outputs", outputs)):
                for name in signals[0]:
                    file[f"{key}/{name}"] = [one[name] for one in signals]
    return path


@pytest.mark.parametrize("suffix", [".json", ".mat", ".h5"])
def test_a_study_takes_its_loop_from_a_plant_with_named_signals(tmp_path: Path, suffix: str) -> None:
    model = HeaveModel(load_rotorcraft("iar330-puma"))
    path = named_plant(tmp_path / f"plant{suffix}", model.state_space)
    found = rotorcraft_model(Rotorcraft(state_space=str(path)))
    assert_allclose(found.response(OMEGA), model.response(OMEGA), rtol=1e-9)
    numbers = mayo_pilot(3.75, 0.28, 0.107, 0.32)
    ours, theirs = (margins(heave_loop(numbers, one, 1.1, 0.32)) for one in (model, found))
    assert theirs.gain_margin_db == pytest.approx(ours.gain_margin_db, rel=1e-9)
    assert theirs.modulus_margin == pytest.approx(ours.modulus_margin, rel=1e-9)
    plant = load_plant(str(path))
    assert plant.controls == ("lateral", "collective") and plant.motions == ("roll", "heave")
    with pytest.raises(
        FileError, match="has roll, heave by lateral, collective; the loop of the study is pitch by lateral"
    ):
        rotorcraft_model(Rotorcraft(state_space=str(path)), "pitch", "lateral")


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"unit": "m/s"}, "unit of a signal = 'm/s' is not known"),
        ({"positive": "right"}, "positive of a signal = 'right' is not known"),
        ({"motion": "bounce"}, "motion of a signal = 'bounce' is not known"),
    ],
)
@pytest.mark.parametrize("suffix", [".mat", ".h5"])
def test_plants_that_do_not_say_what_they_are(
    tmp_path: Path, suffix: str, fields: dict[str, str], message: str
) -> None:
    model = HeaveModel(load_rotorcraft("iar330-puma")).state_space
    with pytest.raises(FileError, match=message):
        load_plant(str(named_plant(tmp_path / f"plant{suffix}", model, **fields)))


def test_hdf5_files_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "a.h5").write_bytes(b"\x89HDF\r\n\x1a\nrest")
    with pytest.raises(FileError, match=r"a\.h5: not an HDF5 file that can be read"):
        load_plant(str(tmp_path / "a.h5"))
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["A"] = [[-1.0]]
        file["inputs/control"], file["inputs/unit"] = ["collective"], ["rad", "rad"]
    with pytest.raises(FileError, match="the datasets of inputs differ in length"):
        load_plant(str(tmp_path / "b.h5"))
    with pytest.raises(FileError, match="cannot be read"):
        load_plant(str(tmp_path / "no.h5"))
    with pytest.raises(FileError, match="percent of travel; a study's gearing is blade pitch"):
        one_channel(load_plant("xv15-hover"), "roll", "lateral")


def test_the_xv15_has_the_printed_control_power() -> None:
    """Half the travel (4.8 in) makes 1.68 and 2.27 rad/s^2 at once, as the report prints; damping 0.85 and 0.77 1/s."""
    plant = load_plant("xv15-hover")
    power = dict(zip(plant.motions, 50.0 * plant.D.max(axis=1), strict=True))
    assert power["pitch"] == pytest.approx(1.68, abs=0.01) and power["roll"] == pytest.approx(2.27, abs=0.015)
    assert sorted(np.linalg.eigvals(plant.A)) == pytest.approx([-0.85, -0.77])
    assert (plant.D >= 0.0).all()
