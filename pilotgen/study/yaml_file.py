"""YAML files as plain data plus the line of every key, so that messages can say `file:line`.

Scalars follow the YAML 1.2 core schema, which is what people expect: `no` and `on` are words, `1e-3` is a number, `012`
is twelve and `12:30` is text. Anchors, aliases, tags and several documents in one file are refused: the files of this
program do not need them, and a few lines of nested aliases can grow into billions of values.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import errno
import json
import re
import stat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from pilotgen.errors import FileError, StudyError

KeyPath = tuple[str | int, ...]

MAX_BYTES = 1_000_000  # the largest bundled file has some 20 kB; anything near this is not a file of this program
MAX_DEPTH = 20  # nesting of mappings and lists; a study has four levels

_INTEGER = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_INFINITY = re.compile(r"[-+]?\.(inf|Inf|INF)")
_WORDS: Mapping[str, bool | None] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_MAX_DIGITS = 400  # beyond this an integer is nobody's parameter, and Python refuses to convert it

# The C parser is five times faster and has the same messages; a PyYAML built without it still works.
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


@dataclass(frozen=True)
class YamlDocument:
    """The values of a YAML file and where they stand.

    Attributes
    ----------
    value : Any
        Plain data: dict with str keys, list, str, int, float, bool, None.
    name : str
        What messages call the file.
    text : str
        The file's text.
    lines : Mapping[KeyPath, int]
        Line (from 1) of each key and list entry by its path, e.g. `("search", "variables", "bmi", 0)`.
    """

    value: Any
    name: str
    text: str
    lines: Mapping[KeyPath, int] = field(repr=False)

    def where(self, path: KeyPath = ()) -> str:
        """Return `file:line` of a key path; of the nearest enclosing key if the path itself is not in the file."""
        while path and path not in self.lines:
            path = path[:-1]
        return f"{self.name}:{self.lines.get(path, 1)}"


def read_yaml(path: str | Path) -> YamlDocument:
    """Read a YAML file.

    Raises
    ------
    FileError
        The file is missing, is not a file, cannot be read, is too large or is not UTF-8 text.
    StudyError
        The text is not the YAML described above; the message starts with `file:line:`.
    """
    file = Path(path)
    try:
        status = file.stat()
        if not stat.S_ISREG(status.st_mode):
            kind = "a directory" if stat.S_ISDIR(status.st_mode) else "not a regular file"
            raise FileError(f"{path} is {kind}; a YAML file is wanted")
        if status.st_size > MAX_BYTES:
            raise FileError(
                f"{path} has {status.st_size} bytes; a file of at most {MAX_BYTES} bytes is wanted, "
                "is this the right file?"
            )
        raw = file.read_bytes()
    except ValueError:
        raise FileError(f"{path!r}: no file has a NUL character in its name") from None
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise FileError(f"{path}: a symbolic link that leads back to itself; give the file itself") from None
        if error.errno in (errno.ENOENT, errno.ENOTDIR):
            lost = f", a link to {file.readlink()}, which is not there" if file.is_symlink() else ""
            raise FileError(
                f"{path}: no such file{lost}; check the path (the working directory is {Path.cwd()})"
            ) from None
        raise FileError(f"{path}: cannot be read: {error.strerror}") from error
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise FileError(
            f"{path}:{line}: byte 0x{raw[error.start]:02x} is not UTF-8 text; save the file with UTF-8 encoding"
        ) from error
    return yaml_from_text(text, str(path))


def yaml_from_text(text: str, name: str) -> YamlDocument:
    """Parse YAML text; `name` is what messages call it. Raises StudyError as `read_yaml` does."""
    if len(text) > MAX_BYTES:
        raise StudyError(f"{name}:1: the text has {len(text)} characters; at most {MAX_BYTES} are wanted")
    lines: dict[KeyPath, int] = {}
    try:
        events = iter(_events(text))
        value = _document(events, name, lines)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, problem = _diagnosis(text, mark.line + 1 if mark else 1)
        raise StudyError(f"{name}:{line}: {problem}") from error
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position if isinstance(error.position, int) else 0) + 1
        character = f"character {error.character:#06x}" if isinstance(error.character, int) else "a character"
        raise StudyError(f"{name}:{line}: {character} is not allowed in YAML text; remove it") from error
    except (yaml.YAMLError, UnicodeError) as error:
        raise StudyError(f"{name}:1: not valid YAML: characters that no text has; save it as UTF-8") from error
    return YamlDocument(value, name, text, lines)


@cache
def bundled(name: str) -> YamlDocument:
    """Return a file of `pilotgen/data/` by its name without `.yaml`, read once. Not to be changed by the caller."""
    return read_yaml(Path(__file__).parents[1] / "data" / f"{name}.yaml")


_TOKEN = re.compile(
    r"""(?<![^\s\[{,:])(?P<quote>"(?:[^"\\]|\\.)*"|'(?:[^']|'')*'|["'])"""  # a quote opens where a value may begin
    r"""|(?:^|(?<=\s))(?P<comment>\#[^\n]*)"""
    r"""|(?P<bracket>[\[\]{}])""",
    re.MULTILINE | re.DOTALL,
)
_TOO_DEEP = f"nested more than {MAX_DEPTH} levels deep; a plain list or mapping is wanted"


def _diagnosis(text: str, line: int) -> tuple[int, str]:
    """Return the line and what is wrong with text that the parser refused at `line`, in words of our own.

    Parsers word their errors differently from version to version, and for people who know YAML.
    """
    lines = text.split("\n")
    here = lines[min(line, len(lines)) - 1]
    if re.match(r" *\t", here):
        return line, "a tab stands in the indentation; YAML is indented with spaces"
    opened, unclosed_quote, depth_line = _brackets(text)
    if depth_line:
        return depth_line, _TOO_DEEP
    if unclosed_quote:
        return unclosed_quote, "not valid YAML: a quote opens here and is not closed; close it"
    if opened:
        bracket, at = opened[-1]
        if bracket in "[{":
            closing = {"[": "]", "{": "}"}[bracket]
            return (
                line,
                f"not valid YAML: the {bracket!r} of line {at} is not closed; add {closing!r}",
            )
        return line, f"not valid YAML: the {bracket!r} of line {at} closes nothing; remove it, or add what it closes"
    if len(re.findall(r":(?=\s|$)", here)) > 1 and not re.search(r"[\[{]", here):
        return line, "not valid YAML: two keys on one line; give each its own line, and put text with ': ' in quotes"
    return line, "not valid YAML; check indentation, colons, quotes and brackets"


def _brackets(text: str) -> tuple[list[tuple[str, int]], int, int]:
    """Count brackets outside quotes and comments, about as YAML does.

    Returns
    -------
    tuple
        Brackets left open or closing nothing, each with its line; the line of a quote left open (0: none); the line
        where nesting grows deeper than `MAX_DEPTH` (0: nowhere).
    """
    stack: list[tuple[str, int]] = []
    for found in _TOKEN.finditer(text):
        at = text.count("\n", 0, found.start()) + 1
        if found["quote"]:
            if len(found["quote"]) == 1:
                return stack, at, 0
        elif bracket := found["bracket"]:
            if bracket in "[{":
                stack.append((bracket, at))
                if len(stack) > MAX_DEPTH:
                    return stack, 0, at
            elif stack and stack[-1][0] + bracket in ("[]", "{}"):
                stack.pop()
            else:
                return stack or [(bracket, at)], 0, 0
    return stack, 0, 0


def _events(text: str) -> Iterator[yaml.Event]:
    # Events come one by one without recursion, so nesting is limited here before it can exhaust the stack.
    loader = _Loader(text)
    try:
        while loader.check_event():
            yield loader.get_event()
    finally:
        loader.dispose()


def _document(events: Iterator[yaml.Event], name: str, lines: dict[KeyPath, int]) -> Any:
    value: Any = None
    documents = 0
    for event in events:
        if isinstance(event, yaml.DocumentStartEvent):
            documents += 1
            if documents > 1:
                raise StudyError(
                    f"{name}:{_line(event)}: a second document starts here ('---'); one per file is wanted"
                )
            first = next(events)
            lines[()] = _line(first)
            value = _value(first, events, (), name, lines)
    return value


def _value(event: yaml.Event, events: Iterator[yaml.Event], path: KeyPath, name: str, lines: dict[KeyPath, int]) -> Any:
    where = f"{name}:{_line(event)}"
    if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
        raise StudyError(f"{where}: YAML anchors and aliases (& and *) are not used here; write the value out")
    tag = getattr(event, "tag", None)
    if tag not in (None, "!"):
        raise StudyError(f"{where}: YAML tags ({tag}) are not used here; write the plain value")
    if len(path) > MAX_DEPTH:
        raise StudyError(f"{where}: {_TOO_DEEP}")
    if isinstance(event, yaml.MappingStartEvent):
        return _mapping(events, path, name, lines)
    if isinstance(event, yaml.SequenceStartEvent):
        values: list[Any] = []
        while not isinstance(event := next(events), yaml.SequenceEndEvent):
            entry = (*path, len(values))
            lines[entry] = _line(event)
            values.append(_value(event, events, entry, name, lines))
        return values
    if not isinstance(event, yaml.ScalarEvent):
        raise StudyError(f"{where}: a value is wanted here")
    return plain_scalar(event.value) if event.implicit[0] else event.value  # implicit[0]: neither quoted nor tagged


def _mapping(events: Iterator[yaml.Event], path: KeyPath, name: str, lines: dict[KeyPath, int]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    while not isinstance(event := next(events), yaml.MappingEndEvent):
        where = f"{name}:{_line(event)}"
        if not isinstance(event, yaml.ScalarEvent) or event.value == "":
            raise StudyError(f"{where}: a key must be a word, such as 'stature_m: 1.75'")
        key: str = event.value
        if event.anchor or event.tag not in (None, "!"):
            raise StudyError(f"{where}: YAML anchors and tags are not used here; write the plain key {key!r}")
        if key in values:
            first = lines[(*path, key)]
            raise StudyError(f"{where}: {key!r} is given twice, first on line {first}; keep one of them")
        lines[(*path, key)] = _line(event)
        values[key] = _value(next(events), events, (*path, key), name, lines)
    return values


def plain_scalar(text: str) -> str | int | float | bool | None:
    """Return what an unquoted YAML 1.2 scalar means: null, true, false, an integer, a number or text."""
    if text in _WORDS:
        return _WORDS[text]
    if _INTEGER.fullmatch(text):
        return int(text) if len(text) <= _MAX_DIGITS else float(text)
    if _FLOAT.fullmatch(text):
        return float(text)
    if _INFINITY.fullmatch(text):
        return float("-inf") if text.startswith("-") else float("inf")
    if text in (".nan", ".NaN", ".NAN"):
        return float("nan")
    return text


def yaml_text(data: Mapping[str, Any], indent: str = "") -> str:
    """Return nested mappings of plain data as YAML that `yaml_from_text` reads back to the last digit."""
    text = ""
    for key, value in data.items():
        if isinstance(value, Mapping) and value:
            text += f"{indent}{_inline(key)}:\n{yaml_text(value, indent + '  ')}"
        else:
            text += f"{indent}{_inline(key)}: {_inline(value)}\n"
    return text


def _inline(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(_inline(entry) for entry in value)}]"
    if isinstance(value, str):
        plain = re.fullmatch(r"[A-Za-z][A-Za-z0-9_./-]*(\[[0-9]+\])?", value) and plain_scalar(value) == value
        return value if plain and "[" not in value else json.dumps(value, ensure_ascii=False)
    return json.dumps(value) if isinstance(value, bool | int | None) else repr(float(value))


def _line(event: yaml.Event) -> int:
    mark: Any = event.start_mark
    return int(mark.line) + 1
