"""Templates and numbers of decks as text: where the templates are, and how a number, a vector or a frame is printed.

Numbers are printed with the fewest digits (17 at most) that give the same number back when read.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import orjson
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from pilotgen.decks.template_cache import TemplateCache
from pilotgen.errors import FileError
from pilotgen.posture.kinematics import Pose

ROUNDING = 1e-15  # below this a component of a unit vector is the rounding error of a zero

# ---- templates -------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=1)
def template_directory() -> Path:
    """Where the templates are: in the installed package, or beside it in a source tree.

    FileError if they are in neither place.
    """
    package = Path(__file__).resolve().parents[1]
    for directory in (package / "templates", package.parent / "templates"):
        if (directory / "pilot.mbd.j2").is_file():
            return directory
    raise FileError(
        f"the deck templates are neither in {package / 'templates'} nor in {package.parent / 'templates'}; "
        "install pilotgen again"
    )


@lru_cache(maxsize=1)
def _environment() -> Environment:
    """One for all templates: what they include is compiled once."""
    return Environment(
        loader=FileSystemLoader(template_directory()),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        auto_reload=False,
        autoescape=False,
    )


@lru_cache(maxsize=4)
def template(name: str) -> TemplateCache:
    """A template by its file name, read once."""
    return TemplateCache(_environment().get_template(name))


# ---- numbers as text -------------------------------------------------------------------------------------------------


def number(value: float) -> str:
    """A number as a deck has it: shortest text that reads back the same, always with a point or an exponent."""
    return _printed(float(value) + 0.0)  # no -0.0


def numbers(values: np.ndarray) -> list[str]:
    """Many numbers, each as `number` prints it."""
    return vector(values).split(", ")


def vector(values: np.ndarray) -> str:
    """Three numbers in one text. `values` has shape (3,)."""
    return _printed((values + 0.0).tolist())[1:-1].replace(",", ", ")


def vectors(values: np.ndarray) -> list[str]:
    """The rows of a matrix, each as `vector` prints it."""
    return _rows((values + 0.0).tolist())


def direction(v: np.ndarray) -> str:
    """A unit vector; what is left of a zero by rounding is printed as zero. `v` has shape (3,)."""
    return _directions([v.tolist()])[0]


def _directions(rows: list[list[float]]) -> list[str]:
    return _rows([[0.0 if -ROUNDING < x < ROUNDING else x for x in row] for row in rows])


def _rows(rows: list[list[float]]) -> list[str]:
    return _printed(rows)[2:-2].replace(",", ", ").split("], [")


def _printed(values: object) -> str:
    """Numbers by a library that prints them ten times as fast as Python does; its lists have brackets, no spaces."""
    text = orjson.dumps(values).decode()
    if "null" in text:
        raise ValueError(f"{values} has no place in a deck")
    return text


def matrix(R: np.ndarray) -> str:
    """An orientation, a row a line. `R` has shape (3, 3)."""
    return "matr,\n\t\t\t" + ",\n\t\t\t".join(_directions(R.tolist()))


def hinge_frame(axis: np.ndarray, index: int, guess: np.ndarray, guess_index: int) -> str:
    """An orientation by two of its axes, as a hinge card has it. `axis` and `guess` have shape (3,)."""
    first, second = f"{index}, {direction(axis)}", f"{guess_index}, {direction(guess)}"
    return f"{first}, {second}" if len(first) + len(second) < 100 else f"{first},\n\t\t\t\t{second}"


def pose_text(pose: Pose) -> SimpleNamespace:
    """Position `x` and the rows `R1`, `R2`, `R3` of the orientation."""
    R1, R2, R3 = _directions(pose[1].tolist())
    return SimpleNamespace(x=vector(pose[0]), R1=R1, R2=R2, R3=R3)
