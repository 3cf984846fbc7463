"""What a page holds of its pilots: packed numbers, skeletons that are the deck's, shapes of motion, other commands."""

from __future__ import annotations

import base64
import gzip
import json
import math
from pathlib import Path

import numpy as np
import pytest
from study_maker import mayo_study, write_study

from pilotgen.context import EvaluationContext
from pilotgen.errors import FileError
from pilotgen.evaluation import Evaluation, evaluate
from pilotgen.report import read_report_section
from pilotgen.report.choose import shown_whole
from pilotgen.report.findings import first_front, worst_order
from pilotgen.report.packing import SHORT_ERROR, embedded, pack_levels, pack_short, pack_text
from pilotgen.report.skeleton import SHAPES_HZ, Skeleton, skeleton_of
from pilotgen.study.study import Study, read_study

QUICK = Path(__file__).parents[2] / "docs" / "studies" / "quick.yaml"


def unpack_short(text: str) -> np.ndarray:
    """As the page does it."""
    raw = base64.b64decode(text)
    return np.array([np.frombuffer(raw[k : k + 5] + b"\0\0\0", ">f8")[0] for k in range(0, len(raw), 5)])


def test_five_bytes_keep_nine_digits() -> None:
    values = np.array([0.0, 1.0, -math.pi, 1e-300, -2.5e200, 0.1 + 0.2, math.inf, -math.inf])
    found = unpack_short(pack_short(values))
    np.testing.assert_allclose(found, values, rtol=SHORT_ERROR)
    assert math.isnan(unpack_short(pack_short([math.nan]))[0])


def test_levels_and_texts_come_back() -> None:
    shape = np.array([[0.5, -2.0], [1e-4, 0.0]])
    text, step = pack_levels(shape)
    found = np.frombuffer(base64.b64decode(text), "<i2").reshape(2, 2) * step
    np.testing.assert_allclose(found, shape, atol=2.0 / 32767.0)
    assert gzip.decompress(base64.b64decode(pack_text("# deck\n"))).decode() == "# deck\n"
    assert pack_text("a" * 99) == pack_text("a" * 99)


def test_nothing_in_the_data_ends_its_element() -> None:
    given = {"name": "</script><script>alert('&')</script><!--", "n": 1}
    text = embedded(given)
    assert not set("<>&") & set(text) and json.loads(text) == given
    with pytest.raises(ValueError):
        embedded({"n": math.nan})


@pytest.fixture(scope="module", params=["lumped", "rigid", "modes", "both arms"])
def drawn(request: pytest.FixtureRequest) -> tuple[Evaluation, Skeleton]:
    """A tall pilot with each torso, and one with both arms."""
    changes = (
        {"pilot.limbs": ["left", "right"]} if request.param == "both arms" else {"pilot.torso.model": request.param}
    )
    study: Study = read_study(QUICK).with_values(changes)[0]
    with EvaluationContext(study) as context:
        outcome = evaluate(context, study.values({"stature_m": 1.9}))
    assert isinstance(outcome, Evaluation)
    skeleton = skeleton_of(outcome)
    assert skeleton is not None
    return outcome, skeleton


def moved(skeleton: Skeleton, point: str, shape: int) -> np.ndarray:
    """Motion of a point of the drawing, from its node's."""
    k = skeleton.points.index(point)
    node = skeleton.carriers[k]
    six = skeleton.shapes[shape, node]
    motion: np.ndarray = six[:3] + np.cross(six[3:], skeleton.point_m[k] - skeleton.node_m[node])
    return motion


def test_skeleton_stands_where_the_deck_has_it(drawn) -> None:
    outcome, skeleton = drawn
    matrices = outcome.solved.matrices
    np.testing.assert_array_equal(skeleton.node_m, matrices.nodes.position)
    assert skeleton.nodes == tuple(name.decode() for name in matrices.nodes.name)
    lengths = np.linalg.norm(skeleton.muscle_m[:, 1] - skeleton.muscle_m[:, 0], axis=1)
    np.testing.assert_allclose(lengths, matrices.muscles.length, atol=1e-12)
    np.testing.assert_array_equal(skeleton.activation, matrices.muscles.activation)
    at = dict(zip(skeleton.points, skeleton.point_m, strict=True))
    np.testing.assert_allclose(at["grip_l"], at["lever_grip"], atol=1e-12)  # the hand is on the lever
    for side in "lr" if "grip_r" in at else "l":
        np.testing.assert_allclose(at[f"shoulder_{side}"], at[f"glenohumeral_{side}"], atol=1e-9)
        humerus = skeleton.nodes.index(f"ulna_{side}")
        np.testing.assert_allclose(at[f"elbow_{side}"], skeleton.node_m[humerus], atol=1e-9)


def test_shapes_of_motion_are_the_feedthrough(drawn) -> None:
    outcome, skeleton = drawn
    model = outcome.pilot_model
    lever = skeleton.nodes.index("lever")
    expected = model.response(2.0 * np.pi * np.array(SHAPES_HZ), washout=False)
    np.testing.assert_allclose(skeleton.shapes[1:, lever, 5], expected, rtol=1e-9)
    assert abs(skeleton.shapes[0, lever, 5]) * model.lever_length_m == pytest.approx(1.0)
    for shape in range(len(skeleton.shapes)):  # hand and lever move as one at the grip
        np.testing.assert_allclose(moved(skeleton, "grip_l", shape), moved(skeleton, "lever_grip", shape), atol=1e-9)


def test_terms_are_the_response(drawn) -> None:
    outcome, _ = drawn
    terms, model = outcome.result["bdft"]["terms"], outcome.pilot_model
    s = 2j * np.pi * np.geomspace(0.1, 20.0, 50)
    H = np.full(len(s), terms["direct"], dtype=complex)
    for (a, b), (c, d) in zip(terms["poles_rad_s"], terms["residues"], strict=True):
        H += complex(c, d) / (s - complex(a, b))
        if b:
            H += complex(c, -d) / (s - complex(a, -b))
    expected = model.response(s.imag, washout=False)
    assert np.abs(H - expected).max() < 1e-9 * np.abs(expected).max()


def test_shown_are_the_worst_the_front_and_some_of_everywhere(tmp_path: Path) -> None:
    results = write_study(tmp_path, mayo_study())
    order, front = worst_order(results), first_front(results)
    shown = shown_whole(results, order, front)
    assert shown[0] == order[0] and set(front.tolist()) <= set(shown) and len(set(shown)) == len(shown)
    assert shown == shown_whole(results, order, front)


def test_what_other_commands_found(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="holds none of population.json"):
        read_report_section(tmp_path)
    (tmp_path / "cures.json").write_text(json.dumps({"sentence": "A notch of 3 Hz <b>cures</b> him."}))
    section = read_report_section(tmp_path)
    assert section.kind == "cures" and section.sentences == ("A notch of 3 Hz <b>cures</b> him.",)
    row = {"label": "damper", "unit": "N s/m", "remedy": True, "best": {"worst": {"amount": 40.0, "bought": 7.34}}}
    content = {
        "sentence": "A damper does it.",
        "proposal": {"reached": True, "cures": [{"key": "damper", "text": "damper, 10 N s/m", "price": "2 N"}]},
        "simulation": {
            "kicks_with_friction": {
                "tried_n": [1.0, 256.0],
                "all_die": False,
                "largest_that_dies_n": 27.0,
                "smallest_that_goes_on_n": 27.4,
            }
        },
        "maps": [{"sentence": "damper and notch: 300 of 400 points keep 6 dB"}],
        "cures": [row, {**row, "label": "friction", "by_name": True}],
    }
    (tmp_path / "cures.json").write_text(json.dumps(content))
    section = read_report_section(tmp_path)
    assert section.answer == "damper, 10 N s/m"
    kicks = "With the friction kicks at the lever die up to 27 N and go on from 27.4 N."
    assert section.sentences == ("A damper does it.", kicks, "damper and notch: 300 of 400 points keep 6 dB.")
    assert section.table is not None and section.table["rows"] == [["damper", "40 N s/m", "7.3"]]
    no_amount = {**content, "cures": [{**row, "best": {"worst": {"amount": [], "bought": 7.34}}}]}
    for damaged in ("", "[1]", "[" * 100_000, '{"sentence": NaN}', '{"sentence": "', json.dumps(no_amount)):
        (tmp_path / "cures.json").write_text(damaged)
        with pytest.raises(FileError, match=r"cures\.json: cannot be read"):
            read_report_section(tmp_path)


@pytest.mark.parametrize("name", ["uncertain", "population", "rare", "sensitivity"])
def test_what_other_commands_found_was_damaged(tmp_path: Path, name: str) -> None:
    margins = {"gain_margin_db": {"quantiles": {}}, "": []}
    for content in (
        {},
        {"shares": {}},
        {"shares": 3},
        {"margins": margins},
        {"objectives": []},
        {"event": [], "name": 1},
    ):
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
        with pytest.raises(FileError, match=rf"{name}\.json: cannot be read as what its command writes"):
            read_report_section(tmp_path)
