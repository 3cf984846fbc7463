"""MBDyn's cases of the modal joint, entry by entry: small beams, and a torso reduced to modes that carries an arm.

Each case has its deck, its `.fem` file and what MBDyn wrote twice: with its plain matrices, and with `use automatic
differentiation`, stored as the difference. The second pair is the derivative of MBDyn's residual and this program must
equal it; the first lacks terms, which are computed here where they are few. Cases: MBDyn develop (2025-06), 17 digits,
c = 0.01 s; MBDyn divides constraint rows and reaction columns by c.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from pilotgen.linear.feedthrough import certificate, make_pilot_model
from pilotgen.solver.client import SolverClient
from pilotgen.solver.matrices import read_matrices
from pilotgen.solver.mbdyn_check import check_mbdyn

Floats = NDArray[np.float64]

CASES = Path(__file__).parent.parent / "data" / "mbdyn_modal"
TOLERANCE = 1e-9  # of an entry, relative to the largest entry of the matrix

# Case -> whether MBDyn's plain matrices are the derivative of its residual.
PLAIN_IS_EXACT = {
    "m1_clamped": True,
    "m2_free_rest": True,
    "m3_loaded": False,  # gravity; a couple at an interface; turned interfaces
    "m5_craig_bampton": True,
    "torso_clamped": True,
    "torso_deflected": False,
    "torso_modal": False,
    "torso_modal_25hz": False,
}


class ModalCase:
    """A stored case, and this program's matrices of its deck scaled as MBDyn scales."""

    def __init__(self, name: str, solver: SolverClient, directory: Path) -> None:
        with np.load(CASES / f"{name}.npz") as data:
            self.data: dict[str, Any] = {key: data[key] for key in data.files}
        deck = directory / f"{name}.mbd"
        deck.write_text(str(self.data["deck"]))
        (directory / str(self.data["fem_name"])).write_text(str(self.data["fem"]))
        output = directory / "out.h5"
        solver.request("linearise", name=deck, output=output)
        with h5py.File(output) as file:
            self.c = float(file["scalars"][0, 0])
            dofs = json.loads(file["structure"][0])["dofs"]
            pair = np.array(file["J_plus"]), np.array(file["J_minus"])
            self.y, _, _, equilibrium = np.array(file["vectors"]).T
        assert self.c == float(self.data["dCoef"])
        self.names = dofs["name"]
        reaction = np.array([kind == "reaction" for kind in dofs["kind"]])
        self.residual = float(np.abs(equilibrium).max())
        for J, c in zip(pair, (self.c, -self.c), strict=True):
            J[reaction] /= c
            J[:, reaction] /= c
        self.ours = pair

    def theirs(self, plain: bool) -> tuple[Floats, Floats]:
        """Return MBDyn's matrices."""
        plus, minus = self.data["Aplus"], self.data["Aminus"]
        return (plus, minus) if plain else (plus + self.data["Aplus_ad"], minus + self.data["Aminus_ad"])


def difference(ours: tuple[Floats, Floats], theirs: tuple[Floats, Floats]) -> float:
    """Return the largest difference of an entry relative to the largest entry."""
    return max(float(np.abs(J - A).max() / np.abs(A).max()) for J, A in zip(ours, theirs, strict=True))


@pytest.mark.parametrize("name", list(PLAIN_IS_EXACT))
def test_entry_by_entry(name: str, solver: SolverClient, tmp_path: Path) -> None:
    case = ModalCase(name, solver, tmp_path)
    assert difference(case.ours, case.theirs(plain=False)) < TOLERANCE
    to_plain = difference(case.ours, case.theirs(plain=True))
    assert to_plain < TOLERANCE if PLAIN_IS_EXACT[name] else to_plain > 1e-5
    assert case.residual < 1e-9  # the decks are in equilibrium


@pytest.mark.parametrize("name", ["torso_modal", "torso_modal_25hz"])
def test_what_plain_matrices_lack(name: str, solver: SolverClient, tmp_path: Path) -> None:
    # [w,g] -a x S x, [w,a] a x I3, [b,g] its transpose: the weight on a seat that turns; S and I3 by the file's masses.
    case = ModalCase(name, solver, tmp_path)
    records = fem_records(str(case.data["fem"]))
    shapes, lumped = records["shapes"], records["lumped"]
    masses, points = lumped[:, 0], records["points"]
    gravity = np.array([0.0, -9.81, 0.0])
    S = masses @ points
    I3 = np.einsum("i,kij->jk", masses, shapes[:, :, :3])
    n = len(case.names)
    seat, joint = case.names.index("seat.x"), case.names.index("torso_modal.a[1]")
    g, w = slice(seat + 3, seat + 6), slice(seat + 9, seat + 12)
    m = I3.shape[1]
    a, b = slice(joint, joint + m), slice(joint + m, joint + 2 * m)
    missing = np.zeros((n, n))
    missing[w, g] = -skew(gravity) @ skew(S)
    missing[w, a] = skew(gravity) @ I3
    missing[b, g] = missing[w, a].T
    plus, minus = case.theirs(plain=True)
    corrected = plus + case.c * missing, minus - case.c * missing
    assert difference(case.ours, corrected) < TOLERANCE


def fem_records(text: str) -> dict[str, Floats]:
    """Read coordinates, shapes (modes, nodes, 6) and lumped masses of a `.fem` text, not by the solver."""
    groups: dict[int, list[str]] = {}
    current: list[str] = []
    for line in text.splitlines():
        if line.startswith("** RECORD GROUP"):
            current = groups.setdefault(int(line.split()[3].rstrip(",")), [])
        elif not line.startswith("**"):
            current += line.split()
    nodes = len(groups[2])
    return {
        "points": np.array([groups[k] for k in (5, 6, 7)], dtype=float).T,
        "shapes": np.array(groups[8], dtype=float).reshape(-1, nodes, 6),
        "lumped": np.array(groups[11], dtype=float).reshape(nodes, 6),
    }


def skew(a: Floats) -> Floats:
    """Return the matrix of the cross product a x."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def test_initial_values(solver: SolverClient, tmp_path: Path) -> None:
    case = ModalCase("m3_loaded", solver, tmp_path)
    for mode, q, qdot, _ in case.data["modes"]:
        assert case.y[case.names.index(f"joint 1.a[{int(mode)}]")] == pytest.approx(q, abs=1e-16)
        assert case.y[case.names.index(f"joint 1.b[{int(mode)}]")] == pytest.approx(qdot, abs=1e-12)
    listed = ModalCase("m5_craig_bampton", solver, tmp_path)
    assert [name for name in listed.names if ".a[" in name] == [f"joint 1.a[{k}]" for k in (7, 8, 9, 13)]


@pytest.mark.parametrize(
    ("name", "tolerance"),
    [("torso_modal", 1e-8), ("torso_deflected", 1e-3), ("torso_modal_25hz", 2e-2)],
)
def test_feedthrough_is_the_lumped_torsos(name: str, tolerance: float, solver: SolverClient, tmp_path: Path) -> None:
    # MBDyn's own grip motion per seat acceleration of the torso with springs in place of modes. Where the modes start
    # deflected the linear element's rotations differ (MBDyn: 5.5e-4), in 16 of 24 modes truncation does.
    case = ModalCase(name, solver, tmp_path)
    pilot = make_pilot_model(read_matrices(tmp_path / "out.h5"), 0.32)
    assert certificate(pilot) < 1e-8
    ours = pilot.grip_motion(2.0 * np.pi * case.data["lever_hz"])
    theirs = case.data["lever_per_seat_acceleration_lumped"]
    assert np.abs(ours / theirs - 1.0).max() < tolerance


def test_interface_load(solver: SolverClient, tmp_path: Path) -> None:
    # The preload makes zero displacements the equilibrium: the interface carries what the springs did.
    case = ModalCase("torso_modal", solver, tmp_path)
    first = case.names.index("torso_modal.reaction[1]")
    assert case.y[first : first + 6] == pytest.approx(case.data["interface"].ravel(), abs=1e-6)


def test_history_beside_the_lumped_torsos(solver: SolverClient, tmp_path: Path) -> None:
    # The seat goes up and down by 5 mm, 1 - cos at 3 Hz, for 1 s; lever and thorax differ from the torso on springs, of
    # their range, as MBDyn's do: 2.2e-4 and 9e-5 with all modes, 1.7e-3 and 1.6e-3 below 25 Hz.
    decks = {"torso_lumped": (CASES.parent / "mbdyn_loop" / "torso_lumped.mbd").read_text()}
    for name in ("torso_modal", "torso_modal_25hz"):
        with np.load(CASES / f"{name}.npz") as data:
            decks[name] = str(data["deck"])
            (tmp_path / str(data["fem_name"])).write_text(str(data["fem"]))
    moved = {}
    for name, text in decks.items():
        still = "single, 0., 1., 0., const, 0."
        assert still in text
        deck = tmp_path / f"{name}.mbd"
        deck.write_text(text.replace(still, "single, 0., 1., 0., cosine, 0., 6.*pi, 0.0025, forever, 0."))
        output = tmp_path / "motion.h5"
        channels = ["lever.gz", "torso.y"]
        solver.request("integrate", name=deck, output=output, integrator="ms", final_time=1.0, channels=channels)
        with h5py.File(output) as file:
            moved[name] = np.array(file["data"])
    reference = moved.pop("torso_lumped")
    for name, expected in (("torso_modal", (2.2e-4, 8.5e-5)), ("torso_modal_25hz", (1.7e-3, 1.63e-3))):
        difference = np.abs((moved[name] - moved[name][0]) - (reference - reference[0])).max(axis=0)
        assert difference / np.ptp(reference, axis=0) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("integrator", ["ida", "ms"])
@pytest.mark.parametrize("name", ["m3_loaded", "m5_craig_bampton", "torso_deflected"])
def test_a_deflected_body_in_equilibrium_stays(
    name: str, integrator: str, solver: SolverClient, tmp_path: Path
) -> None:
    # Bent by some mm: an integrator that starts from the unbent body moves its nodes by as much.
    case = ModalCase(name, solver, tmp_path)
    deck, output = tmp_path / f"{name}.mbd", tmp_path / "motion.h5"
    solver.request("integrate", name=deck, output=output, integrator=integrator, final_time=0.1)
    with h5py.File(output) as file:
        names = [channel.decode() for channel in file["channels/name"][()]]
        places = [
            i for i, channel in enumerate(names) if channel.rpartition(".")[2] in ("x", "y", "z", "gx", "gy", "gz")
        ]
        moved = np.ptp(np.array(file["data"])[:, places], axis=0)
    assert len(places) >= 24 and case.residual < 1e-4
    assert moved.max() < 1e-8  # m or rad


@pytest.mark.parametrize(("digits", "starts"), [(0, False), (6, False), (12, True), (17, True)])
def test_preload_that_mbdyn_starts_with(digits: int, starts: bool, solver: SolverClient, tmp_path: Path) -> None:
    # MBDyn's derivatives phase did not converge without preload and with six digits of it, with twelve it did.
    with np.load(CASES / "torso_modal.npz") as data:
        text = str(data["deck"])
        (tmp_path / str(data["fem_name"])).write_text(str(data["fem"]))
    card = re.search(r"force: TORSO_PRELOAD[^;]*;", text)
    assert card is not None
    if digits == 0:
        text = text.replace(card[0], "").replace("forces: 1;", "forces: 0;")
    else:
        told = re.sub(r"const, ([^,;]+)", lambda found: f"const, {float(found[1]):.{digits}g}", card[0])
        text = text.replace(card[0], told)
    deck = tmp_path / "torso.mbd"
    deck.write_text(text)
    assert check_mbdyn(deck, solver).runs is starts
