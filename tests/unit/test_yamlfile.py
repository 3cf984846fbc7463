"""YAML with line numbers: values, positions, and every way a file can be wrong.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import pilotgen
from pilotgen.errors import FileError, StudyError
from pilotgen.study.yaml_file import MAX_BYTES, plain_scalar, read_yaml, yaml_from_text, yaml_text


def test_values_and_lines() -> None:
    document = yaml_from_text("# first\na: 1\nb:\n  c: [x, 2.5]\n  d: {e: null}\n", "f.yaml")
    assert document.value == {"a": 1, "b": {"c": ["x", 2.5], "d": {"e": None}}}
    assert document.where(("a",)) == "f.yaml:2"
    assert document.where(("b", "c", 1)) == "f.yaml:4"
    assert document.where(("b", "d", "e")) == "f.yaml:5"
    assert document.where(("b", "d", "not there", "nor this")) == "f.yaml:5", "the nearest enclosing key"


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("no", "no"),
        ("on", "on"),
        ("Yes", "Yes"),
        ("true", True),
        ("False", False),
        ("~", None),
        ("", None),
        ("1e-3", 1e-3),
        ("1E3", 1000.0),
        ("-.5", -0.5),
        ("5.", 5.0),
        ("012", 12),
        ("+7", 7),
        ("1_000", "1_000"),
        ("0x10", "0x10"),
        ("12:30", "12:30"),
        ("2024-01-01", "2024-01-01"),
        (".inf", math.inf),
        ("-.INF", -math.inf),
        (".", "."),
        ("e5", "e5"),
    ],
)
def test_plain_scalars_follow_the_core_schema(text: str, value: object) -> None:
    assert plain_scalar(text) == value
    assert type(plain_scalar(text)) is type(value)
    assert type(yaml_from_text(f"a: {text}", "f").value["a"]) is type(value)


def test_quoted_scalars_are_text() -> None:
    assert yaml_from_text("a: '1'\nb: \"no\"\nc: |\n  3\n", "f").value == {"a": "1", "b": "no", "c": "3\n"}


def test_not_a_number_and_huge_integers() -> None:
    assert math.isnan(plain_scalar(".nan"))  # type: ignore[arg-type]
    assert plain_scalar("9" * 5000) == math.inf, "Python would refuse to convert it"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\nb: 2\na: 3\n", "f.yaml:3: 'a' is given twice, first on line 1; keep one of them"),
        ("x:\n  a: &n 1\n", "f.yaml:2: YAML anchors and aliases (& and *) are not used here; write the value out"),
        ("x: *n\n", "f.yaml:1: YAML anchors and aliases (& and *) are not used here; write the value out"),
        ("&k x: 1\n", "f.yaml:1: YAML anchors and tags are not used here; write the plain key 'x'"),
        ("x: !!int 3\n", "f.yaml:1: YAML tags (tag:yaml.org,2002:int) are not used here; write the plain value"),
        ("a: 1\n---\nb: 2\n", "f.yaml:2: a second document starts here ('---'); one per file is wanted"),
        ("? [a]\n: 1\n", "f.yaml:1: a key must be a word, such as 'stature_m: 1.75'"),
        ("a: 1\n'': 1\n", "f.yaml:2: a key must be a word, such as 'stature_m: 1.75'"),
        ("a: 1\nb: [1, 2\nc: 3\n", "f.yaml:3: not valid YAML: "),
        ("a: 1\n\tb: 2\n", "f.yaml:2: a tab stands in the indentation"),
        ("a: b: c\n", "f.yaml:1: not valid YAML: two keys on one line; "),
        ("a: 1\nb: \x07\n", "f.yaml:2: character 0x0007 is not allowed in YAML text; remove it"),
        ("a: " + "[" * 5000, "f.yaml:1: nested more than 20 levels deep; a plain list or mapping is wanted"),
        ("{a: " * 5000, "f.yaml:1: nested more than 20 levels deep; a plain list or mapping is wanted"),
        ("a" * (MAX_BYTES + 1), "f.yaml:1: the text has 1000001 characters; at most 1000000 are wanted"),
    ],
)
def test_wrong_text(text: str, message: str) -> None:
    with pytest.raises(StudyError) as caught:
        yaml_from_text(text, "f.yaml")
    assert str(caught.value).startswith(message)


def test_alias_bomb_costs_nothing() -> None:
    bomb = "a: &a [x, x]\n" + "".join(f"{b}: &{b} [*{a}, *{a}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True))
    with pytest.raises(StudyError, match="write the value out"):
        yaml_from_text(bomb, "f.yaml")


def test_wrong_files(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"nothing\.yaml: no such file; check the path"):
        read_yaml(tmp_path / "nothing.yaml")
    with pytest.raises(FileError, match="is a directory; a YAML file is wanted"):
        read_yaml(tmp_path)
    with pytest.raises(FileError, match="is not a regular file"):
        read_yaml("/dev/null")
    with pytest.raises(FileError):
        read_yaml("a\0b")
    with pytest.raises(FileError, match="no such file|cannot be read"):
        read_yaml(tmp_path / ("x" * 5000))
    latin = tmp_path / "latin.yaml"
    latin.write_bytes(b"a: 1\nname: Zo\xeb\n")
    with pytest.raises(
        FileError, match=r"latin\.yaml:2: byte 0xeb is not UTF-8 text; save the file with UTF-8 encoding"
    ):
        read_yaml(latin)
    big = tmp_path / "big.yaml"
    big.write_bytes(b"#" * (MAX_BYTES + 1))
    with pytest.raises(FileError, match="has 1000001 bytes; a file of at most 1000000 bytes is wanted"):
        read_yaml(big)


def test_byte_order_mark_is_ignored(tmp_path: Path) -> None:
    file = tmp_path / "bom.yaml"
    file.write_bytes(b"\xef\xbb\xbfa: 1\n")
    assert read_yaml(file).value == {"a": 1}


@given(st.text(max_size=200))
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        yaml_from_text(text, "f.yaml")
    except StudyError as error:
        assert str(error).startswith("f.yaml:")


@given(st.text(alphabet="ab:-[]{}&*!|>'\"#%@,? \n\t01.", max_size=60))
def test_any_yaml_soup_is_read_or_refused(text: str) -> None:
    try:
        yaml_from_text(text, "f.yaml")
    except StudyError as error:
        assert str(error).startswith("f.yaml:")


def test_links_that_lead_nowhere(tmp_path: Path) -> None:
    loop, other = tmp_path / "loop.yaml", tmp_path / "other.yaml"
    loop.symlink_to(other)
    other.symlink_to(loop)
    with pytest.raises(FileError, match="a symbolic link that leads back to itself"):
        read_yaml(loop)
    lost = tmp_path / "lost.yaml"
    lost.symlink_to("gone.yaml")
    with pytest.raises(FileError, match=r"no such file, a link to gone\.yaml, which is not there"):
        read_yaml(lost)
    file = tmp_path / "file"
    file.write_text("a: 1")
    with pytest.raises(FileError, match="no such file"):
        read_yaml(file / "below.yaml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a:\n  b: 1\n\t c: 2\n", "f.yaml:3: a tab stands in the indentation; YAML is indented with spaces"),
        ("a: 1\nb: [1, 2\nc: 3\n", "f.yaml:3: not valid YAML: the '[' of line 2 is not closed; add ']'"),
        ("a: it's\nb: {c: 1 # don't }\n", "f.yaml:3: not valid YAML: the '{' of line 2 is not closed; add '}'"),
        ("a: ]\n", "f.yaml:1: not valid YAML: the ']' of line 1 closes nothing; remove it, or add what it closes"),
        ("a: 1\nb: 'x\nc: 2\n", "f.yaml:2: not valid YAML: a quote opens here and is not closed; close it"),
        ("a:\n  b: 1\n c: 2\n", "f.yaml:3: not valid YAML; check indentation, colons, quotes and brackets"),
    ],
)
def test_errors_are_told_in_our_own_words(text: str, message: str) -> None:
    with pytest.raises(StudyError) as caught:
        yaml_from_text(text, "f.yaml")
    assert str(caught.value) == message


def test_one_loader_reads_all_yaml() -> None:
    package = Path(pilotgen.__file__).parent
    readers = {p.relative_to(package).as_posix() for p in package.rglob("*.py") if "import yaml" in p.read_text()}
    assert readers <= {"study/yaml_file.py", "bench/runs.py"}, "bench writes YAML"


PLAIN = st.one_of(
    st.none(), st.booleans(), st.integers(-(10**6), 10**6), st.floats(allow_nan=False, allow_infinity=False),
    st.text(st.characters(exclude_categories=["Cs", "Cc", "Cn", "Co"]), max_size=8),
)  # fmt: skip
KEYS = st.text(st.characters(exclude_categories=["Cs", "Cc", "Cn", "Co"]), min_size=1, max_size=8)


@given(st.dictionaries(KEYS, st.recursive(PLAIN | st.lists(PLAIN), lambda s: st.dictionaries(KEYS, s), max_leaves=8)))
def test_what_is_written_is_read_back(data: dict[str, object]) -> None:
    assert (yaml_from_text(yaml_text(data), "f.yaml").value or {}) == data
