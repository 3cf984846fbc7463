"""Kinds of fields a YAML mapping may declare, and one way of saying what is wrong with a value.

A field is checked the same way whether it stands in a study file, in a file of data, behind `--set` or in a call: only
the words before the message differ (`file:line: key = value`, `--set key=value`, `key = value`).

A schema library would do the same for 90 ms of import, a tenth of what a command may take in all.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from pilotgen.errors import StudyError
from pilotgen.study.wording import (
    DECIMAL_POINT,
    decimal_comma,
    did_you_mean,
    shown,
    spelled,
)
from pilotgen.study.yaml_file import KeyPath, YamlDocument

MULTIBODY, MAYO = "multibody", "mayo"  # pilot models

REQUIRED: Any = object()  # the default of a field that has none
MOST_TOLD = 10  # mistakes of one file that are told together


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
        return spelled(self.path)

    @property
    def place(self) -> str:
        """`file:line: `, or nothing for data that is not from a file."""
        return f"{self.where}: " if self.document.name else ""

    @property
    def what(self) -> str:
        """`file:line: key = value`, with which a message about this value starts."""
        return f"{self.place}{self.key} = {shown(self.data)}" if self.path else f"{self.place}the file"

    def child(self, key: str | int) -> Value:
        """Return an entry of this mapping or list."""
        return Value(self.document, (*self.path, key))

    def error(self, problem: str) -> StudyError:
        """Return an error that says where, what came and `problem`."""
        return StudyError(f"{self.what} {problem}")

    def missing(self, *names: str) -> StudyError:
        """Return an error about a key that is not there (or, with several names, one of which should be)."""
        name = " or ".join(repr(name) for name in names)
        place = f"in {self.key!r}" if self.path else "at the top level"
        return StudyError(f"{self.place}key {name} is missing {place}; add it")


class Mistake(StudyError):
    """Values that are right one by one but not together; whoever knows where they came from says so.

    Parameters
    ----------
    path : str
        Key path of the value to change.
    value : Any
        What it is.
    problem : str
        What is wrong with it and what to do.
    """

    def __init__(self, path: str, value: Any, problem: str) -> None:
        super().__init__(f"{path} = {shown(value)} {problem}")
        self.path, self.value, self.problem = path, value, problem

    def __reduce__(self) -> tuple[type[Mistake], tuple[str, Any, str]]:
        return (type(self), (self.path, self.value, self.problem))


class Problems:
    """The mistakes of one file, told together."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def add(self, error: StudyError) -> None:
        """Keep a mistake for later."""
        self.texts.append(str(error))

    @contextmanager
    def collect(self) -> Iterator[None]:
        """Keep the mistake that the block raises."""
        try:
            yield
        except StudyError as error:
            self.add(error)

    def tell(self) -> None:
        """Raise one StudyError with a line per mistake, at most `MOST_TOLD`; do nothing if there were none."""
        if not self.texts:
            return
        texts = self.texts[:MOST_TOLD]
        more = len(self.texts) - MOST_TOLD
        if more > 0:
            where = self.texts[MOST_TOLD].split(" ", 1)[0]
            texts.append(f"{where} and {more} more mistake{'s' if more > 1 else ''}")
        raise StudyError("\n".join(texts))


@dataclass(frozen=True, kw_only=True)
class Field(ABC):
    """Base of the declared fields.

    Attributes
    ----------
    default : Any
        What a missing key stands for; `REQUIRED` if it must be there.
    null : bool
        `null` is allowed and gives None.
    hint : str or callable
        What to do when a value is wrong; a callable makes it from the value.
    meaning : str
        One line for the reader of the format page.
    model : str
        The one pilot model that has this field; empty if every model has it.
    """

    default: Any = REQUIRED
    null: bool = False
    hint: str | Callable[[Any], str] = ""
    meaning: str = ""
    model: str = ""

    @property
    def numeric(self) -> bool:
        """Whether a search may vary it."""
        return False

    @abstractmethod
    def check(self, what: str, data: Any) -> Any:
        """Return `data` converted, or raise StudyError whose message starts with `what`."""

    def read(self, value: Value) -> Any:
        """Check a value of a document."""
        return self.check(value.what, value.data)

    def advice(self, data: Any) -> str:
        """`; hint`, or nothing."""
        hint = self.hint(data) if callable(self.hint) else self.hint
        return f"; {hint}" if hint else ""


@dataclass(frozen=True)
class Number(Field):
    """A number in a range."""

    low: float
    high: float
    unit: str = ""

    @property
    def numeric(self) -> bool:
        """Whether a search may vary it."""
        return True

    def check(self, what: str, data: Any) -> Any:
        """Return the number as float (None for an allowed null). StudyError for anything else."""
        unit = f" {self.unit}" if self.unit else ""
        if data is None and self.null:
            return None
        if isinstance(data, bool) or not isinstance(data, int | float):
            raise StudyError(
                f"{what} is not a number; a number from {self.low:g} to {self.high:g}{unit} is wanted"
                f"{decimal_comma(data)}{self.advice(data)}"
            )
        if not (math.isfinite(data) and self.low <= data <= self.high):
            raise StudyError(f"{what} is outside {self.low:g} to {self.high:g}{unit}{self.advice(data)}")
        return float(data)


@dataclass(frozen=True)
class Whole(Field):
    """A whole number in a range."""

    low: int
    high: int
    unit: str = ""

    @property
    def numeric(self) -> bool:
        """Whether a search may vary it."""
        return True

    def check(self, what: str, data: Any) -> int | None:
        """Return the number as int (None for an allowed null). StudyError for anything else."""
        if data is None and self.null:
            return None
        if isinstance(data, bool) or not isinstance(data, int | float) or not math.isfinite(data) or data != int(data):
            raise StudyError(
                f"{what} is not a whole number; one from {self.low} to {self.high} is wanted{self.advice(data)}"
            )
        if not self.low <= data <= self.high:
            advice = self.advice(data) or "; choose a number in that range"
            raise StudyError(f"{what} is outside {self.low} to {self.high}{advice}")
        return int(data)


@dataclass(frozen=True)
class Vector(Field):
    """A list of so many numbers in one range."""

    size: int
    low: float
    high: float
    unit: str = ""

    @property
    def entry(self) -> Number:
        """The field of one entry, which has the path `key[0]`, `key[1]`, ..."""
        return Number(self.low, self.high, self.unit, hint=self.hint, model=self.model, meaning=self.meaning)

    def check(self, what: str, data: Any) -> list[float]:
        """Return the numbers as a list of float. StudyError for anything else."""
        if not isinstance(data, list) or len(data) != self.size:
            wanted = ("one number", "two numbers", "three numbers")[self.size - 1] if self.size <= 3 else f"{self.size}"
            raise StudyError(
                f"{what} must be a list of {wanted} from {self.low:g} to {self.high:g} {self.unit}".rstrip()
                + (DECIMAL_POINT if isinstance(data, list) and len(data) == 2 * self.size else "")
                + self.advice(data)
            )
        key, equals, _ = what.rpartition(" = ")
        return [
            self.entry.check(f"{key}[{k}] = {shown(entry)}" if equals else what, entry) for k, entry in enumerate(data)
        ]


@dataclass(frozen=True)
class Matrix(Field):
    """A square, symmetric list of rows of numbers."""

    size: int

    def check(self, what: str, data: Any) -> list[list[float]]:
        """Return the rows as lists of float. StudyError for anything else."""
        shape = isinstance(data, list) and [isinstance(row, list) and len(row) for row in data]
        if shape != [self.size] * self.size:
            raise StudyError(f"{what} must be {self.size} rows of {self.size} numbers, [[a, b, c], [...], [...]]")
        for row in data:
            for entry in row:
                if isinstance(entry, bool) or not isinstance(entry, int | float) or not math.isfinite(entry):
                    raise StudyError(f"{what} holds {shown(entry)}, which is not a number{decimal_comma(entry)}")
        if any(data[j][k] != data[k][j] for j in range(self.size) for k in range(j)):
            raise StudyError(f"{what} is not symmetric; entries [j][k] and [k][j] are the same number")
        return [[float(entry) for entry in row] for row in data]


@dataclass(frozen=True)
class Choice(Field):
    """One of a few words."""

    choices: tuple[str, ...]

    def check(self, what: str, data: Any) -> str:
        """Return the word. StudyError for anything else."""
        if not isinstance(data, str) or data not in self.choices:
            guess = did_you_mean(str(data), self.choices)
            raise StudyError(f"{what} is not known; {guess}choose one of: {', '.join(self.choices)}")
        return data


@dataclass(frozen=True)
class Truth(Field):
    """True or false."""

    def check(self, what: str, data: Any) -> bool:
        """Return the truth value. StudyError for anything else."""
        if not isinstance(data, bool):
            raise StudyError(f"{what} is neither true nor false; one of them is wanted{self.advice(data)}")
        return data


@dataclass(frozen=True)
class Words(Field):
    """A list of different words, one at least; `must` has to be among them."""

    choices: tuple[str, ...]
    must: str = ""

    def check(self, what: str, data: Any) -> tuple[str, ...]:
        """Return the words. StudyError for anything else."""
        if not isinstance(data, list | tuple) or not data:
            raise StudyError(f"{what} must be a list of one or more of: {', '.join(self.choices)}")
        key, equals, _ = what.rpartition(" = ")
        choice = Choice(self.choices)
        words = tuple(choice.check(f"{key}[{k}] = {shown(w)}" if equals else what, w) for k, w in enumerate(data))
        if len(set(words)) < len(words):
            raise StudyError(f"{what} names something twice; keep one")
        if self.must and self.must not in words:
            raise StudyError(f"{what} must contain {self.must}{self.advice(data).replace(';', ':', 1)}")
        return words


@dataclass(frozen=True)
class Text(Field):
    """Any text."""

    def check(self, what: str, data: Any) -> str:
        """Return the text on one line, without blanks around it. StudyError for anything else."""
        if not isinstance(data, str):
            raise StudyError(f"{what} must be text{_quote_it(data)}")
        text = " ".join(data.split())
        if not text.isprintable():
            raise StudyError(f"{what} holds characters that cannot be printed; remove them")
        return text


@dataclass(frozen=True)
class Name(Field):
    """A name that may become part of a file name."""

    def check(self, what: str, data: Any) -> str:
        """Return the name. StudyError for anything else."""
        if not isinstance(data, str) or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}", data):
            raise StudyError(
                f"{what} is not a name; at most 64 letters, digits, '-', '_' and '.' are wanted, such as puma-bmi"
                f"{_quote_it(data)}"
            )
        return data


@dataclass(frozen=True, kw_only=True)
class ByName(Field):
    """A mapping from names of numbers (short names or paths) to something about each of them.

    Attributes
    ----------
    entry : callable
        (value of an entry, field of its number) -> what is kept of it; raises StudyError.
    words : bool
        One of a few words (`pilot.task`) may be named as well.
    """

    entry: Callable[[Value, Field], Any]
    words: bool = False

    def check(self, what: str, data: Any) -> Any:
        """Refuse: entries need their places in a file to be read."""
        raise StudyError(f"{what}: a mapping by names stands in a study file; it cannot be set as one value")


def bounds(value: Value, number: Field) -> tuple[float, float]:
    """Return an entry `[lower, upper]` of a mapping by names."""
    if not isinstance(value.data, list) or len(value.data) != 2:
        comma = DECIMAL_POINT if isinstance(value.data, list) and len(value.data) == 4 else decimal_comma(value.data)
        raise value.error(f"must be a list of two bounds, [lower, upper]{comma}")
    low, high = (number.read(value.child(k)) for k in (0, 1))
    for k, bound in enumerate((low, high)):
        if bound is None:
            raise value.child(k).error("is no bound; a number is wanted")
    if low > high:
        raise value.error("has its lower bound above its upper bound; did you swap the bounds?")
    if low == high:
        name = str(value.path[-1])
        where = "at its own place" if "." in name else "in nominal"
        raise value.error(f"has equal bounds; to hold a value fixed leave {name} out here and set it {where}")
    return low, high


@dataclass(frozen=True)
class Section(Field):
    """A mapping with declared fields of its own.

    Attributes
    ----------
    words : callable, optional
        Words that may stand instead of the mapping, each the name of a set of its numbers.
    unknown : callable, optional
        What to say about a key that is not declared, from the key and its value; an empty text for nothing special.
    either : tuple of str
        Keys of which exactly one is wanted.
    why : str
        Why not more of them.
    instead : tuple of str
        Keys of which any one stands for all that are required.
    """

    words: Callable[[], Sequence[str]] | None = None
    unknown: Callable[[str, Any], str] | None = None
    either: tuple[str, ...] = ()
    why: str = ""
    instead: tuple[str, ...] = ()

    def check(self, what: str, data: Any) -> Any:
        """Return a word that stands for the mapping, or None; a mapping is read key by key.

        StudyError for anything else.
        """
        if data is None and self.null:
            return None
        if self.words is None:
            raise StudyError(f"{what} is not null; numbers and words of a section are given one by one, by their paths")
        return Choice(tuple(self.words())).check(what, data)


def _quote_it(data: Any) -> str:
    if isinstance(data, bool | int | float) or data is None:
        return f"; put it in quotes if that is what you mean: '{shown(data)}'"
    return ""
