"""Templates that are rendered once for each structure of their variables; after that, texts are put in their places.

A template prints its texts and decides by nothing else than truth values, whole numbers, names and lengths: those are
the structure. The text around the variables is therefore the same for all variables of one structure. It is found by
rendering the template with a marker in place of each text and cutting the result at the markers; filling it is some
thirty times faster than rendering. A template that looks into a text (compares, measures, transforms it) is refused.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from operator import itemgetter
from types import SimpleNamespace
from typing import Any, NoReturn

from jinja2 import Template

_ONLY_TEXTS = {str}
_MOST_STRUCTURES = 64  # structures differ by arms, controls, torso and the number of comment lines: a handful
_OPEN, _CLOSE = "\x02", "\x03"  # around the number of a text; neither belongs in a deck


class Part(SimpleNamespace):
    """A namespace of variables that several decks have in common: looked through once, not to be changed after that."""

    __slots__ = ("_found",)

    _found: tuple[list[str], int]  # its texts, and the number of its shape


class TemplateCache:
    """One template and what it prints around its variables, for every structure that it has met.

    Variables may be texts, whole numbers and truth values, in namespaces, mappings, lists and tuples.
    """

    def __init__(self, template: Template) -> None:
        self._template = template
        self._known: dict[tuple[object, ...], _Surroundings] = {}

    def render(self, **variables: Any) -> str:
        """The template's text for these variables.

        Raises
        ------
        TypeError
            A variable of another kind, or a template that looks into a text instead of printing it.
        """
        texts: list[str] = []
        shape: list[object] = []
        _flatten(variables, texts, shape)
        key = tuple(shape)
        surroundings = self._known.get(key)
        if surroundings is None:
            if len(self._known) >= _MOST_STRUCTURES:
                self._known.clear()
            marked = self._template.render(_replaced(variables, map(_Marker, range(len(texts)))))
            surroundings = self._known[key] = _Surroundings(marked)
        return surroundings.filled(texts)


class _Surroundings:
    """Text between the variables, and which variable comes where."""

    def __init__(self, marked: str) -> None:
        pieces = re.split(f"{_OPEN}aZ([0-9]+){_CLOSE}", marked)
        self.parts = pieces[0::2]
        if any(_OPEN in part or _CLOSE in part for part in self.parts):
            raise TypeError("a template transforms a text; transform it before it is given to the template")
        self._order = [int(index) for index in pieces[1::2]]
        self._pick = itemgetter(*self._order, 0) if self._order else None  # with two at least it gives a tuple

    def filled(self, texts: list[str]) -> str:
        """The text with these variables."""
        if self._pick is None:
            return self.parts[0]
        pieces = [""] * (2 * len(self._order) + 1)
        pieces[0::2] = self.parts
        pieces[1::2] = self._pick(texts)[:-1]
        return "".join(pieces)


class _Marker:
    """Stands for a text while the surroundings are found: it can be printed, and nothing else."""

    __slots__ = ("_number",)

    def __init__(self, number: int) -> None:
        self._number = number

    def __str__(self) -> str:
        return f"{_OPEN}aZ{self._number}{_CLOSE}"  # letters of both cases: a change of case is seen

    def _refuse(self, *_: object) -> NoReturn:
        raise TypeError("a template looks into a text; give it a truth value or a whole number to decide by")

    __eq__ = __hash__ = __bool__ = __len__ = __iter__ = __contains__ = __getitem__ = _refuse


_shape_numbers: dict[tuple[object, ...], int] = {}  # of parts: equal shapes have equal numbers


def _look_through(part: Part) -> tuple[list[str], int]:
    texts: list[str] = []
    shape: list[object] = []
    _flatten(part.__dict__, texts, shape)
    part._found = texts, _shape_numbers.setdefault(tuple(shape), len(_shape_numbers))
    return part._found


def _flatten(value: Any, texts: list[str], shape: list[object]) -> None:
    """Append the texts in `value` to `texts`, and what else there is to know of it to `shape`."""
    kind = type(value)
    if kind is str:
        texts.append(value)
        return
    if kind is Part:
        found, number = getattr(value, "_found", None) or _look_through(value)
        texts.extend(found)
        shape += (Part, number)
        return
    if kind is SimpleNamespace:
        value = value.__dict__
        kind = dict
    shape.append(kind)
    if kind is dict:
        shape.append(tuple(value))
        value = value.values()
    elif kind is list or kind is tuple:
        shape.append(len(value))
    elif kind is int or kind is bool:
        shape.append(value)
        return
    else:
        raise TypeError(f"a template's variables are texts, whole numbers and truth values, not {kind.__name__}")
    if set(map(type, value)) == _ONLY_TEXTS:  # most are: all at once
        texts.extend(value)
        shape.append(str)
        return
    for item in value:
        if type(item) is str:
            texts.append(item)
            shape.append(str)
        else:
            _flatten(item, texts, shape)


def _replaced(value: Any, markers: Iterator[_Marker]) -> Any:
    """The same structure with markers for its texts."""
    kind = type(value)
    if kind is str:
        return next(markers)
    if kind is SimpleNamespace or kind is Part:
        return SimpleNamespace(**{name: _replaced(item, markers) for name, item in value.__dict__.items()})
    if kind is dict:
        return {name: _replaced(item, markers) for name, item in value.items()}
    if kind is list or kind is tuple:
        return kind(_replaced(item, markers) for item in value)
    return value
