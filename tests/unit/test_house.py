"""The house stands: data flows one way, and heavy rooms stay off the search path."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "pilotgen"


def listed_rooms() -> dict[str, list[str]]:
    """Rooms of the developer's overview in its order, each with the modules listed for it."""
    rooms: dict[str, list[str]] = {}
    for room, module in re.findall(
        r"^\| (?:`([a-z_0-9]+)/?`)? *\| (?:`([a-z_0-9]+)`)? *\|",
        (ROOT / "docs" / "developer.md").read_text(),
        flags=re.MULTILINE,
    ):
        if room:
            rooms[room] = []
        elif module:
            rooms[list(rooms)[-1]].append(module)
    return rooms


def room_of(path: Path) -> str:
    """The module, or the package below pilotgen it belongs to."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported_modules(path: Path) -> set[str]:
    """Dotted names below pilotgen that a module imports anywhere, functions included."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            folder = ROOT.joinpath(*node.module.split("."))
            inner = {alias.name for alias in node.names if (folder / f"{alias.name}.py").exists()}  # modules of a room
            names |= {f"{node.module}.{name}" for name in inner}
            if len(inner) < len(node.names):
                names.add(node.module)
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return {name for name in names if name.startswith("pilotgen.") and name != "pilotgen.__version__"}


def imported_rooms(path: Path) -> set[str]:
    """Rooms that a module imports anywhere, functions included."""
    return {name.split(".")[1] for name in imported_modules(path)}


def modules() -> list[Path]:
    """All modules that belong to a room."""
    return [path for path in PACKAGE.rglob("*.py") if room_of(path) not in ("__init__", "__main__")]


def test_every_room_and_module_is_in_the_overview() -> None:
    listed = listed_rooms()
    assert {room_of(path) for path in modules()} == set(listed)
    for room, names in listed.items():
        if names:  # rooms whose modules are listed one by one
            assert {path.stem for path in (PACKAGE / room).glob("*.py")} - {"__init__"} == set(names), room


def test_a_room_imports_only_from_rooms_above() -> None:
    order = {room: place for place, room in enumerate(listed_rooms())}
    wrong = [
        f"{path.relative_to(ROOT)} imports {room}"
        for path in modules()
        for room in sorted(imported_rooms(path) & set(order))
        if room != room_of(path) and order[room] >= order[room_of(path)]
    ]
    assert not wrong


def test_no_modules_import_each_other_in_a_circle() -> None:
    dotted = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in modules()}
    dotted = {name.removesuffix(".__init__"): path for name, path in dotted.items()}
    arrows = {name: (imported_modules(path) & set(dotted)) - {name} for name, path in dotted.items()}
    while True:  # take away what imports nothing that is left; what remains stands in circles
        free = {name for name, needs in arrows.items() if not needs & set(arrows)}
        if not free:
            break
        arrows = {name: needs for name, needs in arrows.items() if name not in free}
    assert not arrows


def test_heavy_libraries_stay_off_the_search_path() -> None:
    rooms = "pilotgen.evaluation, pilotgen.runs.batch, pilotgen.runs.executor, pilotgen.runs.results"
    code = f"import sys, {rooms}; print(' '.join(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.split())
    assert "numpy" in loaded
    for heavy in ("control", "matplotlib", "pymoo", "distributed", "scipy.stats", "scipy.signal", "scipy.optimize"):
        assert heavy not in loaded
