"""How messages show a value, spell a path, and guess what a misspelt word was meant to be.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from pilotgen.errors import StudyError
from pilotgen.study.yaml_file import KeyPath

DECIMAL_POINT = "; is the comma meant as a decimal point? write 1.775, not 1,775"


def decimal_comma(data: Any) -> str:
    """Return a hint if a text is a number with a decimal comma, else an empty text."""
    if isinstance(data, str) and re.fullmatch(r"[-+]?[0-9]*,[0-9]+([eE][-+]?[0-9]+)?", data.strip()):
        return f"; the decimal point is a point: write {data.strip().replace(',', '.')}"
    return ""


def spelled(path: KeyPath) -> str:
    """Return a path as it is read aloud: `search.variables.bmi[0]`."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += ("." if text else "") + (part if part.isprintable() else ascii(part)[1:-1])
    return text


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
    elif isinstance(data, Mapping):
        text = f"{{{', '.join(f'{key}: {shown(entry)}' for key, entry in data.items() if entry is not None)}}}"
    else:
        text = repr(data)
    return text if len(text) <= 60 else text[:57] + "..."


def setting_text(data: Any) -> str:
    """Return a value as `--set` takes it, to the last digit."""
    if isinstance(data, list | tuple):
        return f"[{', '.join(setting_text(entry) for entry in data)}]"
    return data if isinstance(data, str) else repr(float(data)) if isinstance(data, float) else shown(data)


def nearest(word: str, known: Sequence[str]) -> str | None:
    """Return the known word or path that is nearest to a misspelt one, by all of it or by its last part."""
    import difflib  # 10 ms that only a mistake pays

    word = word[:60]
    if near := difflib.get_close_matches(word, known, n=1, cutoff=0.6):
        return near[0]
    last = {path.rpartition(".")[2]: path for path in reversed(known)}
    if near := difflib.get_close_matches(word.rpartition(".")[2], list(last), n=1, cutoff=0.6):
        return last[near[0]]
    return next((path for path in known if len(word) > 3 and word.lower() in path), None)


def did_you_mean(word: str, known: Sequence[str]) -> str:
    """Return `did you mean 'x'? ` if a known word is near, else an empty text."""
    near = nearest(word, known)
    return f"did you mean {near!r}? " if near else ""


def check_positive(what: str, value: float, unit: str = "", hint: str = "") -> float:
    """Return `value` if it is finite and greater than zero, else raise StudyError."""
    if not (math.isfinite(value) and value > 0.0):
        unit_text = f" {unit}" if unit else ""
        hint_text = f"; {hint}" if hint else ""
        raise StudyError(f"{what} = {value:g}{unit_text} must be greater than zero{hint_text}")
    return value
