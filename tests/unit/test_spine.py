"""The distributed spine and its modes, against MBDyn's matrices, closed forms and the chain itself."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg

from pilotgen.anthropometry.spine import (
    SEAT,
    SpineBody,
    SpineModel,
    SpineSeat,
    SpineSpring,
    assemble_spine,
    carrier_name,
    carrier_place,
    spine_model,
)
from pilotgen.anthropometry.spine_modes import ReducedSpine, fem_text, reduce_spine
from pilotgen.errors import EvaluationError

DATA = Path(__file__).parents[1] / "data"
GRAVITY = np.array([0.0, -9.81, 0.0])
FREQUENCIES_HZ = np.arange(1.0, 8.01, 0.25)


def heave_response(M: Any, C: Any, K: Any, heave: Any, frequencies_hz: Any) -> np.ndarray:
    """Displacement of every coordinate per heave of the seat, (f, n) complex; M, C, K of motion relative to the seat.

    With x = heave + relative motion, (-w^2 M + i w C + K) x_relative = w^2 M heave.
    """
    out = []
    for frequency in frequencies_hz:
        w = 2.0 * math.pi * frequency
        out.append(heave + np.linalg.solve(K - w**2 * M + 1j * w * C, w**2 * (M @ heave)))
    return np.array(out)


def interface_mass(reduced: ReducedSpine) -> np.ndarray:
    """Mass matrix (m, m) of the interface bodies in the modes, which a deck has as bodies on its nodes."""
    kept = np.concatenate(
        [np.arange(*reduced.spine.freedoms(name).indices(len(reduced.W))) for name in reduced.interfaces]
    )
    shapes = reduced.W[kept]
    return np.asarray(shapes.T @ reduced.spine.M[np.ix_(kept, kept)] @ shapes)


# ---- the lumped torso that MBDyn's chain matrices belong to


def lumped_deck() -> SpineModel:
    """The five bodies and six springs of a deck of MBDyn's, read by their numbers."""
    text = (DATA / "mbdyn_loop" / "torso_lumped.mbd").read_text()
    names = ("PAN", "PELVIS", "TORSO", "HEAD", "VISCERA")
    place: dict[str, tuple[float, ...]] = {"SEAT": (0.0, 0.0, 0.0)}
    bodies = []
    for name in names:
        (node,) = re.findall(rf"structural: {name}, dynamic, ([^,]+), ([^,]+), ([^,]+), eye", text)
        (body,) = re.findall(rf"body: {name}, {name}, ([^,]+), null, diag, ([^,]+), ([^,]+), ([^;]+);", text)
        place[name] = tuple(map(float, node))
        mass, *inertia = map(float, body)
        bodies.append(SpineBody(name, mass, tuple(inertia), place[name]))  # type: ignore[arg-type]
    springs = []
    for card in re.findall(r"joint: 90\d, deformable joint,.*?;", text, flags=re.S):
        ends = re.findall(r"^\s+([A-Z]+), position, ([^,]+), ([^,]+), ([^,]+), orientation.*?, ([^,]+),$", card, re.M)
        (first, *arm, angle), (second, *_) = ends
        numbers = re.split(r"[,\s]+", card.split("viscoelastic generic,")[1].split("prestress")[0].strip(", \n\t"))
        K, C = np.array(numbers, dtype=float).reshape(2, 6, 6)
        c, s = math.cos(float(angle)), math.sin(float(angle))
        springs.append(
            SpineSpring(
                f"{first}_{second}",
                SEAT if first == "SEAT" else first,
                second,
                tuple(np.array(place[first]) + np.array(arm, dtype=float)),
                np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]),
                tuple(np.diag(K)),
                tuple(np.diag(C)),
                carries=(first, second) != ("SEAT", "TORSO"),
            )
        )
    stored = np.load(DATA / "mbdyn_modal" / "torso_modal.npz")
    held = stored["interface"].ravel()  # by the springs on the thorax, arms included
    load = np.concatenate([-held[:3] - bodies[2].mass_kg * GRAVITY, -held[3:]])
    return assemble_spine(bodies, springs, {"TORSO": load}, GRAVITY, np.zeros(3))


def test_chain_is_mbdyns() -> None:
    # MBDyn wrote the chain's matrices at the loaded configuration, prestress and its geometric part included.
    stored = np.load(DATA / "mbdyn_modal" / "torso_modal.npz")
    spine = lumped_deck()
    assert [body.name for body in spine.bodies] == [str(name) for name in stored["chain_nodes"]]
    for ours, key in ((spine.M, "chain_M"), (spine.C, "chain_C"), (spine.K, "chain_K")):
        assert np.abs(ours - stored[key]).max() < 1e-11 * np.abs(stored[key]).max()
    assert np.abs(spine.K - spine.K.T).max() > 1.0  # the moments' share of it: not symmetric


def test_modes_and_preload_are_mbdyns() -> None:
    stored = np.load(DATA / "mbdyn_modal" / "torso_modal.npz")
    reduced = reduce_spine(lumped_deck(), math.inf, interfaces=["TORSO"])
    assert reduced.modes == 30
    assert reduced.frequencies_hz == pytest.approx(stored["fixed_interface_hz"], rel=1e-9)
    assert np.abs(reduced.preload) == pytest.approx(np.abs(stored["preload"]), abs=1e-8)  # signs of modes are free
    assert reduced.preload[:6] == pytest.approx(stored["preload"][:6], abs=1e-8)


# ---- a pilot

POINTS = {
    "contact": (0.11, 0.0),
    "hip": (0.11, 0.09),
    "back_t8": (0.05, 0.42),
    "neck_t1": (0.07, 0.585),
    "head": (0.13, 0.72),
    "viscera": (0.15, 0.24),
}
SEATED = SpineSeat((0.0, 0.0, 0.0), (0.0, 0.0), 13.0, 0.555)


def lumped_numbers(cushion: bool = True, mass_kg: float = 75.6) -> dict[str, Any]:
    """A man of 75.6 kg (others: scaled by mass alone) as the lumped torso has him: arguments of `spine_model`."""
    size = mass_kg / 75.6

    def six(fore_aft: float, vertical: float, pitch: float) -> tuple[float, ...]:
        return tuple(size * x for x in (fore_aft, vertical, fore_aft, 1.5 * pitch, 0.5 * pitch, pitch))

    masses = {"pelvis": 0.2533, "viscera": 0.08165, "thorax": 0.24125, "head": 0.0694}
    masses = {name: mass_kg * share for name, share in masses.items()}
    visceral = masses["viscera"] * (2.0 * math.pi * 5.0) ** 2
    damper = 0.9 * math.sqrt(visceral * masses["viscera"])
    springs = {
        "buttocks": (six(46e3, 111e3, 1100.0), six(870.0, 1830.0, 38.0)),
        "lumbar": (six(65e3, 204e3, 830.0), six(580.0, 1640.0, 29.0)),
        "neck": (six(55e3, 84e3, 55.0), six(190.0, 290.0, 4.0)),
        "viscera": (
            (2.0 * visceral, visceral, 2.0 * visceral, 75.0, 25.0, 50.0),
            (damper, damper, damper, 3.0, 1.0, 2.0),
        ),
        "back": ((20e3, 10e3, 20e3, 300.0, 100.0, 0.0), (400.0, 200.0, 400.0, 7.5, 2.5, 0.0)),
    }
    gyration = {"pelvis": 0.15, "viscera": 0.08, "head": 0.10}
    if cushion:
        masses["pan"], gyration["pan"] = 0.01 * mass_kg, 0.10
        springs["cushion"] = (
            (100e3, 200e3, 100e3, 6000.0, 2000.0, 4000.0),
            (1000.0, 2000.0, 1000.0, 60.0, 20.0, 40.0),
        )
    return {
        "masses_kg": masses,
        "springs": springs,
        "stature_m": 1.775,
        "seat": SEATED,
        "gyration_m": gyration,
        "points": POINTS,
        "upper_trunk_kg": 0.1596 * mass_kg,
        "carrier_load": (3.0, -70.0, -1.0, 2.0, 0.5, 1.0),
    }


def pilot(**changes: Any) -> SpineModel:
    """The spine of that man."""
    return spine_model(**{**lumped_numbers(), **changes})


def reduced_response(reduced: ReducedSpine) -> np.ndarray:
    """Motion of the carrier per seat heave by the modes, the carrier's own mass as a body on it."""
    spine = reduced.spine
    M = reduced.M + interface_mass(reduced)
    rigid = spine.heave
    out = []
    for frequency in FREQUENCIES_HZ:
        w = 2.0 * math.pi * frequency
        q = np.linalg.solve(reduced.K - w**2 * M + 1j * w * reduced.C, w**2 * (reduced.W.T @ (spine.M @ rigid)))
        out.append((rigid + reduced.W @ q)[spine.freedoms(carrier_name())])
    return np.array(out)


def truncation(spine: SpineModel, cutoff_hz: float, residual_vectors: bool = False) -> float:
    """Largest error of the carrier's response, relative to its largest value."""
    exact = heave_response(spine.M, spine.C, spine.K, spine.heave, FREQUENCIES_HZ)[:, spine.freedoms(carrier_name())]
    reduced = reduce_spine(spine, cutoff_hz, interfaces=[carrier_name()], residual_vectors=residual_vectors)
    return float(np.abs(reduced_response(reduced) - exact).max() / np.abs(exact).max())


def test_mass_is_the_lumped_torsos() -> None:
    numbers = lumped_numbers()
    spine = spine_model(**numbers)
    assert len(spine.bodies) == 21
    assert spine.heave @ spine.M @ spine.heave == pytest.approx(sum(numbers["masses_kg"].values()), rel=1e-14)
    trunk = [body for body in spine.bodies if re.fullmatch(r"[LT]\d+", body.name)]
    assert len(trunk) == 17
    assert sum(body.mass_kg for body in trunk) == pytest.approx(numbers["masses_kg"]["thorax"], rel=1e-14)


def test_slices_together_are_the_thorax() -> None:
    # Centre 0.41 m up the back, as the lumped torso has it; gyration 0.13 m about the lateral axis, as de Leva's parts.
    spine = pilot(seat=SpineSeat((0.0, 0.0, 0.0), (0.0, 0.0), 0.0, 0.555))
    trunk = [body for body in spine.bodies if re.fullmatch(r"[LT]\d+", body.name)]
    masses = np.array([body.mass_kg for body in trunk])
    places = np.array([body.place_m for body in trunk])
    centre = masses @ places / masses.sum()
    assert centre == pytest.approx([0.11, 0.41, 0.0], abs=0.005)
    about = np.array([body.inertia_kg_m2[2] for body in trunk]).sum() + masses @ ((places - centre) ** 2).sum(axis=1)
    assert math.sqrt(about / masses.sum()) == pytest.approx(0.13, abs=0.005)


def test_series_of_joints_is_the_lumbar_spring() -> None:
    numbers = lumped_numbers()
    k, _ = numbers["springs"]["lumbar"]
    names = [f"L{i}" for i in (5, 4, 3, 2, 1)] + [f"T{i}" for i in range(12, 1, -1)]  # to the carrier, T2
    joints = [spring for spring in spine_model(**numbers).springs if spring.second in names and spring.carries]
    assert len(joints) == 16
    for direction in (0, 2, 3, 4, 5):  # shear, lateral; roll, yaw, pitch
        series = 1.0 / sum(1.0 / joint.stiffness[direction] for joint in joints)
        assert series == pytest.approx(k[direction], rel=1e-12)
    lumbar = 1.0 / sum(1.0 / joint.stiffness[1] for joint in joints[:6])
    assert lumbar == pytest.approx(309e3, rel=0.01)  # Kitazaki and Griffin's T12 to S1


def test_rigid_motion_strains_nothing_but_the_back() -> None:
    # Moved up with its seat no spring feels anything: relative displacement zero, and K, C know only relative motion.
    numbers = lumped_numbers()
    numbers["springs"]["back"] = ((0.0,) * 6, (0.0,) * 6)
    spine = spine_model(**numbers)
    seat_reaction = spine.K @ spine.heave
    pan = spine.freedoms("pan")
    assert seat_reaction[pan][1] == pytest.approx(numbers["springs"]["cushion"][0][1], rel=1e-12)
    elsewhere = np.delete(seat_reaction, np.arange(pan.start, pan.stop))
    assert np.abs(elsewhere).max() < 1e-9


def test_static_sag_without_prestress_is_the_weight_over_stiffness() -> None:
    # Prestress is what the springs carry: by an independent sum over the bodies above each joint.
    spine = pilot(carrier_load=(0.0,) * 6)
    total = sum(body.mass_kg for body in spine.bodies)
    assert spine.prestress["cushion"][:3] == pytest.approx(total * GRAVITY, rel=1e-12)
    above = spine.bodies[spine.index("T1")].mass_kg + spine.bodies[spine.index("head")].mass_kg
    joint = next(spring for spring in spine.springs if spring.second == "T1")
    assert joint.axes @ spine.prestress[joint.name][:3] == pytest.approx(above * GRAVITY, abs=1e-12)
    assert not spine.prestress["back"].any()


def test_seated_body_is_a_persons() -> None:
    # Rigid seat without back: apparent mass 4.6 to 5.6 Hz and 1.4 to 1.9, shoulders 1.3 to 1.9, head 1.3 to 2.1.
    numbers = lumped_numbers(cushion=False)
    numbers["springs"]["back"] = ((0.0,) * 6, (0.0,) * 6)
    spine = spine_model(**{**numbers, "carrier_load": (0.0, -22.0, 0.0, 0.0, 0.0, 0.0)})
    frequencies = np.arange(2.0, 10.0, 0.05)
    motion = heave_response(spine.M, spine.C, spine.K, spine.heave, frequencies)
    apparent = np.abs(motion @ (spine.M @ spine.heave)) / (spine.heave @ spine.M @ spine.heave)
    assert 4.6 < frequencies[apparent.argmax()] < 5.6
    assert 1.4 < apparent.max() < 1.9
    for name, low, high in ((carrier_name(), 1.3, 1.9), ("head", 1.3, 2.1)):
        assert low < np.abs(motion[:, spine.freedoms(name).start + 1]).max() < high


def test_no_negative_damping_and_no_unstable_mode() -> None:
    spine = pilot()
    assert np.abs(spine.C - spine.C.T).max() < 1e-9 * np.abs(spine.C).max()
    assert np.linalg.eigvalsh(spine.C)[0] > 0.0
    reduced = reduce_spine(spine, interfaces=[carrier_name()])
    M = reduced.M + interface_mass(reduced)
    for mass, damping, stiffness in ((spine.M, spine.C, spine.K), (M, reduced.C, reduced.K)):
        n = len(mass)
        A = np.block(
            [
                [np.zeros((n, n)), np.eye(n)],
                [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)],
            ]
        )
        assert np.linalg.eigvals(A).real.max() < 0.0


def test_fixed_interface_modes_by_another_route() -> None:
    # The pencil K phi = lam M phi of the interior by scipy, without the scaling by masses.
    spine = pilot()
    reduced = reduce_spine(spine, 25.0, interfaces=[carrier_name()])
    interior = np.setdiff1d(np.arange(len(spine.M)), np.arange(*spine.freedoms(carrier_name()).indices(len(spine.M))))
    K = spine.K[np.ix_(interior, interior)]
    squares = scipy.linalg.eigh(0.5 * (K + K.T), spine.M[np.ix_(interior, interior)], eigvals_only=True)
    frequencies = np.sqrt(squares) / (2.0 * math.pi)
    assert reduced.frequencies_hz == pytest.approx(frequencies[frequencies <= 25.0], rel=1e-9)
    modes = reduced.W[interior, 6:]
    assert modes.T @ spine.M[np.ix_(interior, interior)] @ modes == pytest.approx(np.eye(modes.shape[1]), abs=1e-12)


def test_all_modes_are_the_chain() -> None:
    assert truncation(pilot(), math.inf) < 1e-11


def test_more_modes_are_nearer() -> None:
    spine = pilot()
    errors = [truncation(spine, cutoff) for cutoff in (10.0, 25.0, 100.0)]
    assert errors[0] > errors[1] > errors[2]
    assert errors[1] < 0.06  # of a thorax without arms; the lever of a whole pilot is off by 0.2 %
    with_vectors = truncation(spine, 25.0, residual_vectors=True)
    assert with_vectors < 0.5 * errors[1]


def test_residual_vectors_are_independent() -> None:
    reduced = reduce_spine(pilot(), 25.0, interfaces=[carrier_name()], residual_vectors=True)
    assert reduced.residual_count == 7
    gram = reduced.M[6:, 6:]
    assert gram == pytest.approx(np.eye(len(gram)), abs=1e-10)


def test_head_as_an_interface() -> None:
    spine = pilot()
    reduced = reduce_spine(spine, interfaces=[carrier_name(), "head"])
    head = spine.freedoms("head")
    assert reduced.W[head, 6:12] == pytest.approx(np.eye(6))
    assert not reduced.W[head, 12:].any()
    total = reduced.heave @ (reduced.M + interface_mass(reduced)) @ reduced.heave
    both = sum(spine.bodies[spine.index(name)].mass_kg for name in reduced.interfaces)
    assert total > both  # and what the constraint modes carry along


@pytest.mark.parametrize("interfaces", [[carrier_name()], [carrier_name(), "head"]])
def test_preload_holds_what_hangs_on_it(interfaces: list[str]) -> None:
    # In every mode the springs do what the interfaces' loads and weights ask for, less the interior's weight.
    spine = pilot()
    reduced = reduce_spine(spine, interfaces=interfaces)
    forces = -spine.M.diagonal() * np.tile([*GRAVITY, 0.0, 0.0, 0.0], len(spine.bodies))
    forces[spine.freedoms(carrier_name())] -= spine.loads[carrier_name()]
    assert reduced.preload == pytest.approx(reduced.W.T @ forces, abs=1e-9)


def test_fem_text_reads_back() -> None:
    spine = pilot(seat=SpineSeat((0.01, -0.02, 0.0), (0.01, -0.02), 13.0, 0.57))
    reduced = reduce_spine(spine, interfaces=[carrier_name()])
    text = fem_text(reduced, "a pilot")
    groups: dict[int, list[str]] = {}
    for line in text.splitlines():
        if line.startswith("** RECORD GROUP"):
            current = groups.setdefault(int(line.split()[3].rstrip(",")), [])
        elif not line.startswith("**"):
            current += line.split()
    n, m = len(spine.bodies) + 1, reduced.modes
    assert groups[1] == ["REV0", str(n), str(m - 6), "0", "6", "0"]
    assert groups[2][0] == "SEAT"
    assert carrier_name() in groups[2]
    for group, matrix in ((9, reduced.M), (10, reduced.K), (13, reduced.C)):
        assert np.array_equal(np.array(groups[group], dtype=float).reshape(m, m), matrix)  # to the last bit
    shapes = np.array(groups[8], dtype=float).reshape(m, n, 6)
    assert not shapes[:, 0].any()
    assert np.array_equal(shapes[:, 1:].reshape(m, -1), reduced.W.T)
    lumped = np.array(groups[11], dtype=float).reshape(n, 6)
    assert lumped[:, 0].sum() == pytest.approx(
        sum(body.mass_kg for body in spine.bodies if body.name != carrier_name()), rel=1e-14
    )
    x = np.array(groups[5], dtype=float)
    assert x[1 + spine.index("head")] == pytest.approx(spine.bodies[spine.index("head")].place_m[0] - 0.01)
    assert max(map(len, text.splitlines())) < 4000


def test_carrier_is_at_the_shoulders() -> None:
    spine = pilot()
    place = carrier_place(SEATED)
    assert spine.bodies[spine.index(carrier_name())].place_m == pytest.approx(place)
    angle = math.radians(13.0)
    up = place[1] * math.cos(angle) - place[0] * math.sin(angle)
    assert up == pytest.approx(0.555, abs=0.005)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"upper_trunk_kg": 30.0}, "upper trunk would weigh 30 kg"),
        ({"masses_kg": {**lumped_numbers()["masses_kg"], "head": -1.0}}, "the head would weigh -1 kg"),
        (
            {"springs": {**lumped_numbers()["springs"], "neck": ((0.0,) * 6, (0.0,) * 6)}},
            "spring neck has stiffness",
        ),
        (
            {"springs": {**lumped_numbers()["springs"], "back": ((1e3,) * 6, (-1.0,) * 6)}},
            "spring back has a negative stiffness or damping",
        ),
    ],
)
def test_no_such_person(changes: Mapping[str, Any], told: str) -> None:
    with pytest.raises(EvaluationError, match=told):
        pilot(**changes)


def test_no_such_reduction() -> None:
    spine = pilot()
    with pytest.raises(EvaluationError, match="interfaces \\['shoulder'\\] are wanted among"):
        reduce_spine(spine, interfaces=["shoulder"])
    with pytest.raises(EvaluationError, match="a cut-off of 0 Hz keeps nothing"):
        reduce_spine(spine, 0.0, interfaces=[carrier_name()])
    with pytest.raises(EvaluationError, match="buckles"):
        reduce_spine(pilot(carrier_load=(0.0, -1e5, 0.0, 0.0, 0.0, 0.0)), interfaces=[carrier_name()])
