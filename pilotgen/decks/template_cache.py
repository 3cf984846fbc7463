"""Templates that are rendered once for each structure of their variables; after that, texts are put in their places.

A template that only prints its variables gives the same text around them every time. This room finds that text by
rendering the template with a marker in place of each variable's text and cutting the result at the markers: some
thirty times faster than rendering. What a template does more than print is found out, not assumed: a text that it
compares or measures becomes part of the structure, and a template that transforms texts is rendered as usual.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import re
from operator import itemgetter
from types import SimpleNamespace
from typing import Any

from jinja2 import Template

_ONLY_TEXTS = {str}
_MOST_SKELETONS = 64  # structures differ by arms, controls and the number of comment lines: a handful


class Part(SimpleNamespace):
    """A namespace of variables that several decks have in common: looked through once, not to be changed after that."""

    __slots__ = ("_found",)

    _found: tuple[list[str], int]  # its texts, and the number of its shape


class TemplateCache:
    """One template and the skeletons of the structures that it has met.

    Variables may be texts, whole numbers and truth values, in namespaces, mappings, lists and tuples. Whole numbers and
    truth values belong to the structure.
    """

    def __init__(self, template: Template) -> None:
        self._template = template
        self._inspected: frozenset[int] = frozenset()
        self._met: set[tuple[object, ...]] = set()
        self._known: dict[tuple[object, ...], _Skeleton | None] = {}

    def render(self, **variables: Any) -> str:
        """The template's text for these variables."""
        leaves: list[str] = []
        shape: list[object] = []
        _flatten(variables, leaves, shape)
        key = self._key(leaves, shape)
        skeleton = self._known.get(key)
        if skeleton is not None:
            return skeleton.filled(leaves)
        text = self._template.render(variables)
        if key not in self._met:  # a structure that comes once is not worth the learning
            self._met.add(key)
        elif key not in self._known:
            self._learn(variables, leaves, shape, text)
        return text

    def _key(self, leaves: list[str], shape: list[object]) -> tuple[object, ...]:
        return (*shape, *(leaves[i] if i < len(leaves) else None for i in sorted(self._inspected)))

    def _learn(self, variables: dict[str, Any], leaves: list[str], shape: list[object], text: str) -> None:
        if len(self._known) >= _MOST_SKELETONS:
            self._known.clear()
        while True:
            seen: set[int] = set()
            markers = [
                leaf if i in self._inspected else _Marker(f"\x02aZ{i}\x03", i, seen) for i, leaf in enumerate(leaves)
            ]
            marked = self._template.render(_replaced(variables, iter(markers)))
            if not seen:
                break
            self._inspected |= seen
            self._known.clear()
        skeleton = _Skeleton(marked)
        ambiguous = any("\x02" in leaves[i] for i in self._inspected if i < len(leaves))
        transformed = "\x02" in "".join(skeleton.parts) or skeleton.filled(leaves) != text
        self._known[self._key(leaves, shape)] = None if ambiguous or transformed else skeleton


class _Skeleton:
    """Text between the variables, and which variable comes where."""

    def __init__(self, marked: str) -> None:
        pieces = re.split("\x02aZ([0-9]+)\x03", marked)
        self.parts = pieces[0::2]
        self._order = [int(index) for index in pieces[1::2]]
        self._pick = itemgetter(*self._order, 0) if self._order else None  # with two at least it gives a tuple

    def filled(self, leaves: list[str]) -> str:
        """The text with these variables."""
        if self._pick is None:
            return self.parts[0]
        pieces = [""] * (2 * len(self._order) + 1)
        pieces[0::2] = self.parts
        pieces[1::2] = self._pick(leaves)[:-1]
        return "".join(pieces)


class _Marker(str):
    """Stands for a variable's text, and tells when somebody looks into it instead of printing it."""

    _index: int
    _seen: set[int]

    def __new__(cls, text: str, index: int, seen: set[int]) -> _Marker:
        marker = super().__new__(cls, text)
        marker._index, marker._seen = index, seen
        return marker

    def _tell(self, name: str, *arguments: Any) -> Any:
        self._seen.add(self._index)
        return getattr(super(), name)(*arguments)

    def __eq__(self, other: object) -> bool:
        return bool(self._tell("__eq__", other))

    def __ne__(self, other: object) -> bool:
        return bool(self._tell("__ne__", other))

    def __lt__(self, other: str) -> bool:
        return bool(self._tell("__lt__", other))

    def __le__(self, other: str) -> bool:
        return bool(self._tell("__le__", other))

    def __gt__(self, other: str) -> bool:
        return bool(self._tell("__gt__", other))

    def __ge__(self, other: str) -> bool:
        return bool(self._tell("__ge__", other))

    def __hash__(self) -> int:
        return int(self._tell("__hash__"))

    def __len__(self) -> int:  # truth as well
        return int(self._tell("__len__"))

    def __contains__(self, part: object) -> bool:
        return bool(self._tell("__contains__", part))

    def __getitem__(self, place: Any) -> str:
        return str(self._tell("__getitem__", place))

    def __iter__(self) -> Any:
        return self._tell("__iter__")


_shape_numbers: dict[tuple[object, ...], int] = {}  # of parts: equal shapes have equal numbers


def _look_through(part: Part) -> tuple[list[str], int]:
    leaves: list[str] = []
    shape: list[object] = []
    _flatten(part.__dict__, leaves, shape)
    part._found = leaves, _shape_numbers.setdefault(tuple(shape), len(_shape_numbers))
    return part._found


def _flatten(value: Any, leaves: list[str], shape: list[object]) -> None:
    """Append the texts in `value` to `leaves`, and what else there is to know of it to `shape`."""
    kind = type(value)
    if kind is str:
        leaves.append(value)
        return
    if kind is Part:
        texts, number = getattr(value, "_found", None) or _look_through(value)
        leaves.extend(texts)
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
        leaves.extend(value)
        shape.append(str)
        return
    for item in value:
        if type(item) is str:
            leaves.append(item)
            shape.append(str)
        else:
            _flatten(item, leaves, shape)


def _replaced(value: Any, leaves: Any) -> Any:
    """The same structure with other texts."""
    kind = type(value)
    if kind is str:
        return next(leaves)
    if kind is SimpleNamespace or kind is Part:
        return SimpleNamespace(**{name: _replaced(item, leaves) for name, item in value.__dict__.items()})
    if kind is dict:
        return {name: _replaced(item, leaves) for name, item in value.items()}
    if kind is list or kind is tuple:
        return kind(_replaced(item, leaves) for item in value)
    return value
