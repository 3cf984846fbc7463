"""Declared fields of a YAML mapping: type, range, unit, default; one voice for what is wrong with a value.

A schema library would do the same for 90 ms of import, a tenth of what a command may take in all.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pilotgen.errors import StudyError
from pilotgen.study.yaml_file import KeyPath, YamlDocument

REQUIRED: Any = object()  # the default of a field that has none


@dataclass(frozen=True)
class Value:
    """One value of a document, which knows where it stands."""

    document: YamlDocument
    path: KeyPath

    @property
    def data(self) -> Any:
        """The plain data."""
        data = self.document.value
        for key in self.path:
            data = data[key]
        return data

    @property
    def where(self) -> str:
        """`file:line`."""
        return self.document.where(self.path)

    @property
    def key(self) -> str:
        """The path as it is read aloud: `search.variables.bmi[0]`."""
        text = ""
        for part in self.path:
            text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
        return text

    def child(self, key: str | int) -> Value:
        """Return an entry of this mapping or list."""
        return Value(self.document, (*self.path, key))

    def error(self, problem: str) -> StudyError:
        """Return an error that says where, what came and `problem`."""
        if not self.path:
            return StudyError(f"{self.where}: the file {problem}")
        return StudyError(f"{self.where}: {self.key} = {shown(self.data)} {problem}")

    def missing(self, *names: str) -> StudyError:
        """Return an error about a key that is not there (or, with several names, one of which should be)."""
        name = " or ".join(repr(name) for name in names)
        place = f"in {self.key!r}" if self.path else "at the top level"
        return StudyError(f"{self.where}: key {name} is missing {place}; add it")


@dataclass(frozen=True)
class Field:
    """Base of the declared fields."""

    def check(self, what: str, data: Any) -> Any:
        """Return `data` converted, or raise StudyError whose message starts with `what`."""
        raise NotImplementedError

    def read(self, value: Value) -> Any:
        """Check a value of a document."""
        return self.check(f"{value.where}: {value.key} = {shown(value.data)}", value.data)


@dataclass(frozen=True)
class Number(Field):
    """A number in a range; `hint` says what to do when it is not."""

    low: float
    high: float
    unit: str
    default: Any = REQUIRED
    null: bool = False  # null is allowed and gives None
    hint: str = ""

    def check(self, what: str, data: Any) -> Any:
        """Return the number as float (None for an allowed null)."""
        unit = f" {self.unit}" if self.unit else ""
        hint = f"; {self.hint}" if self.hint else ""
        if data is None and self.null:
            return None
        if isinstance(data, bool) or not isinstance(data, int | float):
            raise StudyError(
                f"{what} is not a number; a number from {self.low:g} to {self.high:g}{unit} is wanted{hint}"
            )
        if not (math.isfinite(data) and self.low <= data <= self.high):
            raise StudyError(f"{what} is outside {self.low:g} to {self.high:g}{unit}{hint}")
        return float(data)


@dataclass(frozen=True)
class Whole(Field):
    """A whole number in a range."""

    low: int
    high: int
    default: Any = REQUIRED

    def check(self, what: str, data: Any) -> int:
        """Return the number as int."""
        if isinstance(data, bool) or not isinstance(data, int | float) or not math.isfinite(data) or data != int(data):
            raise StudyError(f"{what} is not a whole number; one from {self.low} to {self.high} is wanted")
        if not self.low <= data <= self.high:
            raise StudyError(f"{what} is outside {self.low} to {self.high}; choose a number in that range")
        return int(data)


@dataclass(frozen=True)
class Choice(Field):
    """One of a few words."""

    choices: tuple[str, ...]
    default: Any = REQUIRED

    def check(self, what: str, data: Any) -> str:
        """Return the word."""
        if not isinstance(data, str) or data not in self.choices:
            guess = did_you_mean(str(data), self.choices)
            raise StudyError(f"{what} is not known; {guess}choose one of: {', '.join(self.choices)}")
        return data


@dataclass(frozen=True)
class Name(Field):
    """A name that may become part of a file name."""

    def check(self, what: str, data: Any) -> str:
        """Return the name."""
        if not isinstance(data, str) or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}", data):
            raise StudyError(
                f"{what} is not a name; at most 64 letters, digits, '-', '_' and '.' are wanted, such as puma-bmi"
            )
        return data


def check_keys(value: Value, known: Sequence[str], required: Sequence[str]) -> dict[str, Value]:
    """Return the entries of a mapping; raise StudyError on an unknown or a missing key, or if it is no mapping."""
    if not isinstance(value.data, dict):
        example = f"a mapping with the keys {', '.join(required or known)} is wanted"
        raise value.error("is empty; " + example if value.data is None else "is not a mapping; " + example)
    for key in value.data:
        if key not in known:
            entry = value.child(key)
            raise StudyError(
                f"{entry.where}: {entry.key}: key {key!r} is not known here; "
                f"{did_you_mean(key, known)}known keys: {', '.join(known)}"
            )
    for key in required:
        if key not in value.data:
            raise value.missing(key)
    return {key: value.child(key) for key in value.data}


def read_fields(value: Value, fields: Mapping[str, Any], partly: bool = False) -> dict[str, Any]:
    """Return the checked values of a mapping's declared fields, defaults filled in.

    With `partly` the mapping may hold other keys, which the caller has checked.
    """
    required = [name for name, declared in fields.items() if declared.default is REQUIRED]
    check_keys(value, list(value.data) if partly and isinstance(value.data, dict) else list(fields), required)
    return {
        name: declared.read(value.child(name)) if name in value.data else declared.default
        for name, declared in fields.items()
    }


def shown(data: Any) -> str:
    """Return a value as a message shows it: as it would be typed, and not too long."""
    if data is None:
        text = "null"
    elif isinstance(data, bool):
        text = str(data).lower()
    elif isinstance(data, float):
        text = f"{data:.12g}"
    elif isinstance(data, list):
        text = f"[{', '.join(shown(entry) for entry in data[:8])}]"
    else:
        text = repr(data)
    return text if len(text) <= 60 else text[:57] + "..."


def did_you_mean(word: str, known: Sequence[str]) -> str:
    """Return `did you mean 'x'? ` if a known word is near, else an empty text."""
    import difflib  # 10 ms that only a mistake pays

    near = difflib.get_close_matches(word[:60], known, n=1, cutoff=0.6)
    return f"did you mean {near[0]!r}? " if near else ""
