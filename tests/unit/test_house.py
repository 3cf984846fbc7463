"""The house stands: data flows one way, and heavy rooms stay off the search path."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "pilotgen"


def listed_order() -> dict[str, int]:
    """Modules of the developer's overview in its order; packages as their name."""
    rows = re.findall(r"^\| ([^|]*`[^|]*) \|", (ROOT / "docs" / "developer.md").read_text(), flags=re.MULTILINE)
    names = [name.rstrip("/") for row in rows for name in re.findall(r"`([a-z_]+/?)`", row)]
    return {name: place for place, name in enumerate(names)}


def room_of(path: Path) -> str:
    """The module, or the package below pilotgen it belongs to."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported_rooms(path: Path) -> set[str]:
    """Rooms that a module imports anywhere, functions included."""
    rooms = set()
    for node in ast.walk(ast.parse(path.read_text())):
        names = []
        if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names = [node.module] if node.module != "pilotgen" else [f"pilotgen.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        rooms |= {name.split(".")[1] for name in names if name.startswith("pilotgen.")}
    return rooms - {"__version__"}


def modules() -> list[Path]:
    """All modules that belong to a room."""
    return [path for path in PACKAGE.rglob("*.py") if room_of(path) not in ("__init__", "__main__")]


def test_every_room_is_in_the_overview() -> None:
    rooms = {room_of(path) for path in modules()}
    assert rooms == set(listed_order())


def test_a_module_imports_only_from_above() -> None:
    order = listed_order()
    wrong = [
        f"{path.relative_to(ROOT)} imports {room}"
        for path in modules()
        for room in sorted(imported_rooms(path))
        if room != room_of(path) and order[room] >= order[room_of(path)]
    ]
    assert not wrong


def test_heavy_libraries_stay_off_the_search_path() -> None:
    rooms = "pilotgen.pipeline, pilotgen.campaign, pilotgen.executor, pilotgen.results"
    code = f"import sys, {rooms}; print(' '.join(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.split())
    assert "numpy" in loaded
    for heavy in ("control", "matplotlib", "pymoo", "distributed", "scipy.stats", "scipy.signal", "scipy.optimize"):
        assert heavy not in loaded
