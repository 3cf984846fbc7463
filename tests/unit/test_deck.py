"""Decks: what a reader and the solver rely on, read back from the text itself.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import difflib
import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from jinja2 import UndefinedError

from pilotgen.anthropometry.biometrics import Biometrics
from pilotgen.anthropometry.body import SEGMENTS, make_body
from pilotgen.anthropometry.torso import make_torso
from pilotgen.decks import deck as decks
from pilotgen.decks import parts
from pilotgen.decks import text as deck_text
from pilotgen.posture.cockpit import make_cockpit
from pilotgen.posture.posture import first_guess, from_poses
from pilotgen.posture.seated_torso import SeatedTorso, seat_torso
from pilotgen.study.cockpit_numbers import cockpit_numbers
from pilotgen.study.torso_numbers import torso_from


@dataclass(frozen=True)
class Gains:
    proportional_gain: float = 1.5
    derivative_gain: float = 0.1


@dataclass(frozen=True)
class Values:
    values: np.ndarray


def render(limbs: tuple[str, ...], **options: object) -> dict[str, str]:
    body = make_body(Biometrics(40.0, 1.775, 24.0 * 1.775**2, "male"), limbs)
    cockpit = make_cockpit(body, lever_length_m=0.32, position=0.5)
    guess = first_guess(body, cockpit)
    posture = from_poses(body, cockpit, guess.nodes)
    activations = Values(np.linspace(0.0, 0.3, len(posture.muscle_lengths_m)))
    return {
        "posture": decks.render_posture(body, cockpit, guess),
        "trim": decks.render_trim(body, cockpit, posture, gains=Gains(), c=0.01),
        "pilot": decks.render_direct(
            body,
            cockpit,
            posture,
            activations=activations,
            muscle_lengths=posture.muscle_lengths_m,
            gains=Gains(),
            c=0.01,
            **options,
        ),
    }


def seated(limbs: tuple[str, ...], girdle: bool) -> SeatedTorso:
    body = make_body(Biometrics(40.0, 1.775, 24.0 * 1.775**2, "male"), limbs)
    cockpit = make_cockpit(body, lever_length_m=0.32, position=0.5)
    posture = from_poses(body, cockpit, first_guess(body, cockpit).nodes)
    numbers = torso_from({"girdle": {} if girdle else "none"})
    torso = make_torso(body.biometrics, limbs, numbers, cockpit_numbers()["seat"])
    return seat_torso(torso, body, cockpit, posture.nodes, {}, decks.GRAVITY_M_PER_S2)


LIMBS = [("left",), ("right",), ("left", "right")]
ALL = {(limbs, name): text for limbs in LIMBS for name, text in render(limbs).items()}
ALL |= {
    (limbs, f"pilot with {what}"): render(limbs, torso=seated(limbs, what == "girdle"))["pilot"]
    for limbs in LIMBS
    for what in ("torso", "girdle")
}
every_deck = pytest.mark.parametrize("key", ALL, ids=lambda key: "+".join(key[0]) + "-" + key[1])


def without_comments(text: str) -> str:
    return re.sub(r"#.*", "", text)


def cards(text: str) -> list[str]:
    return [" ".join(card.split()) for card in without_comments(text).split(";")]


def constants(text: str) -> dict[str, str]:
    return dict(re.findall(r"set: const \w+ (\w+) = ([^;]+);", without_comments(text)))


@every_deck
def test_decks_are_tidy(key: tuple) -> None:
    text = ALL[key]
    assert text.endswith("end: elements;\n")
    assert not re.search(r"[ \t]\n", text), "blanks at the end of a line"
    assert "\n\n\n" not in text
    assert "\r" not in text
    assert text.isascii()
    assert max(len(line.expandtabs(4)) for line in text.splitlines() if line.lstrip().startswith("#")) <= 130
    assert max(len(line.expandtabs(4)) for line in text.splitlines()) <= 140
    assert not re.search(r"-0(\.0*)?(?![0-9.])|-0 mm", text), "a negative zero"
    assert not re.search(r"e-(1[6-9]|[2-9][0-9])", text), "the rounding error of a zero"
    first = text.splitlines()[0]
    assert first.startswith(f"# {key[1].split()[0]}.mbd - ")
    assert "# Pilot: male, 40 years, 1.775 m, 75.61 kg (BMI 24)" in text


@every_deck
def test_orientations_are_orthonormal_as_printed(key: tuple) -> None:
    matrices = re.findall(r"matr,\s*((?:[-+0-9.e]+,\s*){9})", without_comments(ALL[key]))
    assert len(matrices) >= 4 * len(key[0])
    for numbers in matrices:
        R = np.array([float(number) for number in numbers.split(",")[:9]]).reshape(3, 3)
        np.testing.assert_allclose(R.T @ R, np.eye(3), atol=2e-15)


def test_seat_and_eye_are_told_in_words() -> None:
    body = make_body(Biometrics(40.0, 1.55, 57.0, "female"), ("left",))
    cockpit = make_cockpit(body, lever_length_m=0.32, position=0.5)
    text = decks.render_posture(body, cockpit, first_guess(body, cockpit))
    assert re.search(
        r"# Seat \(design_eye\) moved [0-9]+ mm aft and 65 mm up; eye 0 mm forward of and [0-9]+ mm below", text
    )


@every_deck
def test_counts_are_those_of_the_cards(key: tuple) -> None:
    text = ALL[key]
    found = {
        "structural nodes": sum(card.startswith(("structural:", "begin: nodes")) for card in cards(text)) - 1,
        "joints": sum(card.startswith("joint:") for card in cards(text)),
        "rigid bodies": sum(card.startswith("body:") for card in cards(text)),
    }
    for name, count in found.items():
        declared = re.search(rf"\t{name}: ([^;]+);", text)
        if name == "rigid bodies" and key[1] == "posture":
            assert declared is None and count == 0
        else:
            assert declared is not None and eval(declared[1]) == count, name


@every_deck
def test_every_name_is_declared_once_before_it_is_used(key: tuple) -> None:
    text = without_comments(ALL[key])
    names = re.findall(r"set: const \w+ (\w+) =", text)
    assert len(names) == len(set(names))
    declared = set()
    for line in text.splitlines():
        for word in re.findall(r"\b[A-Z][A-Z0-9_]*[A-Z0-9]\b", re.sub(r'"[^"]*"', "", line)):
            assert word in names, f"{word} is not declared: {line.strip()}"
            assert word in declared or f"{word} =" in line, f"{word} is used before it is declared"
        declared.update(re.findall(r"set: const \w+ (\w+) =", line))


@every_deck
def test_labels_are_unique_within_nodes_and_joints(key: tuple) -> None:
    text = ALL[key]
    values = constants(text)
    for kind in ("structural", "joint", "body", "reference"):
        labels = re.findall(rf"\n\t?{kind}: (\w+),", without_comments(text))
        numbers = [values[label] for label in labels]
        assert (labels and len(set(numbers)) == len(numbers)) or (kind == "body" and key[1] == "posture")
    joints = set(re.findall(r"\n\tjoint: (\w+),", text))
    bodies = set(re.findall(r"\n\tstructural: (\w+),", text))
    assert not joints & bodies, "the solver names unknowns after these"


@every_deck
def test_reals_have_a_point_or_an_exponent(key: tuple) -> None:
    for card in cards(ALL[key]):
        if card.startswith("set: const real"):
            assert re.search(r"= -?[0-9.e+-]+(\*deg2rad|\*\w+)?$", card), card
            assert "." in card or "e" in card.split("=")[1], card
        if card.startswith("joint:") and "rod" in card:
            for number in re.findall(r", (-?[0-9][0-9.e+-]*)", card):
                assert "." in number or "e" in number, card


@pytest.mark.parametrize("limbs", LIMBS)
def test_numbers_read_back_exactly(limbs: tuple[str, ...]) -> None:
    body = make_body(Biometrics(40.0, 1.775, 24.0 * 1.775**2, "male"), limbs)
    cockpit = make_cockpit(body, lever_length_m=0.32, position=0.5)
    guess = first_guess(body, cockpit)
    text = ALL[(limbs, "pilot")]
    values = constants(text)
    for side, limb in body.limbs.items():
        S = side[0].upper()
        for name in SEGMENTS:
            assert float(values[f"{name.upper()}_{S}_MASS"]) == limb.segments[name].mass_kg
            assert float(values[f"{name.upper()}_{S}_JX"]) == limb.segments[name].inertia_kg_m2[0, 0]
            card = next(c for c in cards(text) if c.startswith(f"structural: {name.upper()}_{S},"))
            x, R = guess.nodes[f"{name}_{side[0]}"]
            numbers = [float(n) for n in re.findall(r"-?\d+\.[\de-]+", card)]
            assert numbers == [*x.tolist(), *R.ravel().tolist()]
        for muscle in limb.muscles:
            name = f"{muscle.name.upper()}_{S}"
            assert float(values[f"{name}_L0"]) == muscle.l0_m
            assert float(values[f"{name}_F0"]) == muscle.F0_N
            card = next(c for c in cards(text) if c.startswith(f"joint: {name}, rod"))
            points = [float(n) for n in re.findall(r"(?<![\w])-?\d+\.\d*(?:e-?\d+)?", card)]
            assert points == [*muscle.origin_m.tolist(), *muscle.insertion_m.tolist()]


def test_what_keeps_both_solvers_equal_is_there() -> None:
    pilot = without_comments(ALL[(("left",), "pilot")])
    for words in (
        "derivatives coefficient: 1.;",
        "derivatives tolerance: 1.e-7;",
        "parameter, 0.02,",
        "use lapack, balance, no;",
        "matrix output precision, 17,",
        "method: ms, 0.6;",
        'module load: "libmodule-muscles";',
        "gravity: uniform, 0., -1., 0., const, 9.81;",
    ):
        assert words in pilot, words
    assert pilot.count("activation check, no") == 25
    assert "in line" not in pilot
    assert "position constraint, active, active, inactive, null;" in pilot
    posture = without_comments(ALL[(("left",), "posture")])
    assert "gravity" not in posture and "muscle" not in posture and "model: static;" in posture


def test_trim_and_pilot_decks_differ_only_where_they_must() -> None:
    trim, pilot = (ALL[(("left",), name)].splitlines() for name in ("trim", "pilot"))
    different = [line[2:] for line in difflib.ndiff(trim, pilot) if line[0] == "-"]
    expected = (
        r"# trim.mbd|\tderivatives (tolerance|coefficient)|\t# (unbalanced forces|less, open)|"
        r"\tset: const real \w+_A = 0\.0;|\t# All activations"
    )
    assert all(re.match(expected, line) for line in different)


def test_settings_of_a_virtual_test() -> None:
    drive = "sine, 0., 18.85, 1.4e-4, forever, 0."
    text = render(("left",), activation_check=True, seat_drive=drive, final_time_s=6.0, time_step_s=5e-4)["pilot"]
    assert f"single, 0., 1., 0., {drive}," in text
    assert "final time: 6.0;" in text and "time step: 0.0005;" in text
    assert text.count("activation check, yes") >= 25 and "activation check, no" not in text


def test_rendering_is_repeatable() -> None:
    assert render(("left", "right"))["pilot"] == ALL[(("left", "right"), "pilot")]


def test_the_left_arm_of_two_is_the_left_arm_of_one() -> None:
    one = set(cards(ALL[(("left",), "pilot")]))
    two = set(cards(ALL[(("left", "right"), "pilot")]))
    other = re.compile(r"begin: control data|rigid bodies:|joints:|structural nodes:|set: const real \w+_A =")
    assert not [card for card in one - two if not other.search(card)]


def test_a_template_that_asks_for_an_unknown_name_fails() -> None:
    template = deck_text.template("posture.mbd.j2")
    with pytest.raises(UndefinedError, match="person"):
        template.render(has={"left": True})


def test_numbers_that_are_none_are_refused() -> None:
    for value in (float("nan"), float("inf")):
        with pytest.raises(ValueError, match="no place in a deck"):
            deck_text.number(value)
        with pytest.raises(ValueError, match="no place in a deck"):
            deck_text.vector(np.array([1.0, value, 0.0]))
    assert deck_text.number(1.0) == "1.0"
    assert deck_text.number(1e-7) == "1e-7"
    values = np.array([-0.0, 0.1 + 0.2, -1e-7])
    assert deck_text.vector(values) == ", ".join(map(deck_text.number, values.tolist()))


def test_numbers_are_read_back_to_the_last_bit() -> None:
    rng = np.random.default_rng(1)
    values = rng.standard_normal((4000, 3)) * 10.0 ** rng.integers(-25, 25, (4000, 3))
    values[:40] = rng.integers(-9, 9, (40, 3))
    rows = deck_text.vectors(values)
    assert np.array_equal([[float(text) for text in row.split(", ")] for row in rows], values)
    for row, text in zip(values[:200], rows, strict=False):
        assert deck_text.vector(row) == text == ", ".join(deck_text.numbers(row))
        for x in row.tolist():
            assert float(deck_text.number(x)) == x
            assert set(deck_text.number(x)) & set(".e")  # a real number, not an integer
            assert len(deck_text.number(x)) <= len(repr(x)) + 1


def test_full_inertia_is_written_row_by_row() -> None:
    body = make_body(Biometrics(40.0, 1.775, 24.0 * 1.775**2, "male"), ("left",))
    hand = body.limbs["left"].segments["hand"]
    J = hand.inertia_kg_m2 + np.array([[0.0, 1e-5, 2e-5], [1e-5, 0.0, 3e-5], [2e-5, 3e-5, 0.0]])
    card = parts._bone_text(replace(hand, inertia_kg_m2=J, com_m=np.array([0.01, -0.05, 0.0])), "HAND_L")
    values = {
        f"HAND_L_{name}": float(value) for name, value in zip(card.inertia_names, card.inertia_values, strict=True)
    }
    assert not card.on_axis
    assert card.inertia == "sym, HAND_L_JX, HAND_L_JXY, HAND_L_JXZ, HAND_L_JY, HAND_L_JYZ, HAND_L_JZ"
    assert (values["HAND_L_JXY"], values["HAND_L_JXZ"], values["HAND_L_JYZ"]) == (1e-5, 2e-5, 3e-5)
    assert card.com == "0.01, -0.05, 0.0"
