"""Public docstrings keep their promises: they exist, name shapes of arrays and the errors that are raised.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "pilotgen"
ARRAYS = re.compile(
    r"\b(?:ndarray|NDArray|ArrayLike|Floats|Complexes|Numbers|Indices|FloatArray|ComplexArray|BoolArray)\b"
)
SHAPE = re.compile(
    r"shape|\(\s*(?:[a-zA-Z_0-9]+)\s*,(?:\s*[a-zA-Z_0-9]+\s*,?)*\)|scalar|array of|per |each|same as|list of"
)
Function = ast.FunctionDef | ast.AsyncFunctionDef


def public_functions(path: Path) -> Iterator[tuple[str, Function, str]]:
    """Public functions and methods of a module: dotted name, node, docstring of the class they belong to."""

    def walk(body: list[ast.stmt], prefix: str, outer: str) -> Iterator[tuple[str, Function, str]]:
        for node in body:
            if isinstance(node, Function) and not node.name.startswith("_"):
                yield f"{prefix}{node.name}", node, outer
            elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                yield from walk(node.body, f"{prefix}{node.name}.", ast.get_docstring(node) or "")

    yield from walk(ast.parse(path.read_text(encoding="utf-8")).body, "", "")


def raised(node: Function) -> set[str]:
    """Names of exceptions that a function raises itself and lets out."""
    caught = {
        name.id
        for handler in ast.walk(node)
        if isinstance(handler, ast.ExceptHandler) and handler.type is not None
        for name in ast.walk(handler.type)
        if isinstance(name, ast.Name)
    }
    names = set()
    for child in ast.walk(node):
        if isinstance(child, ast.Raise) and isinstance(child.exc, ast.Call) and isinstance(child.exc.func, ast.Name):
            names.add(child.exc.func.id)
    return {name for name in names - caught if name[:1].isupper()}


MODULES = sorted(path for path in PACKAGE.rglob("*.py") if "bench" not in path.parts and "commands" not in path.parts)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_public_docstrings(path: Path) -> None:
    wrong = []
    for name, node, outer in public_functions(path):
        text = ast.get_docstring(node) or ""
        overrides = any(isinstance(d, ast.Name) and d.id in ("abstractmethod", "override") for d in node.decorator_list)
        if not text and not overrides:
            wrong.append(f"{name}: no docstring")
            continue
        arguments = [a.annotation for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
        annotations = " ".join(ast.unparse(a) for a in (*arguments, node.returns) if a is not None)
        if ARRAYS.search(annotations) and not SHAPE.search(text + outer):
            wrong.append(f"{name}: arrays without shapes")
        missing = sorted(error for error in raised(node) if error not in text + outer)
        if missing:
            wrong.append(f"{name}: raises {', '.join(missing)} without a word")
    assert not wrong
