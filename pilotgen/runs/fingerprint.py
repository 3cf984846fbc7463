"""What determines a result besides the pilot's values: one hash, by which the journal knows its evaluations.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path

from pilotgen import __version__
from pilotgen.decks.text import template_directory
from pilotgen.files import check_templates
from pilotgen.solver.client import SolverClient, find_mbdae
from pilotgen.study.study import Study

# Rooms whose code determines a result; commands, figures, reports and the search's bookkeeping do not.
PHYSICS = (
    "errors.py", "context.py", "evaluation.py", "summary.py", "study", "anthropometry", "posture", "decks", "solver",
    "activation", "linear", "loop",
)  # fmt: skip


@functools.lru_cache(maxsize=8)
def solver_version(mbdae: str | None = None) -> str:
    """Name and version of the solver program."""
    with SolverClient(find_mbdae(mbdae)) as client:
        return str(client.version())


DECK_TEMPLATES = ("posture.mbd.j2", "pilot.mbd.j2")


def fingerprint(study: Study, mbdae: str | None = None, solver: str = "mbdae") -> str:
    """Hash of everything that determines an evaluation except the pilot's values.

    The study's settings, the code of the rooms that compute (`PHYSICS`), every template and every number of data in
    this package, and the solver program.
    """
    digest = hashlib.sha256()
    digest.update(f"pilotgen {__version__}\n{solver}\n{study.canonical()}\n".encode())
    package = Path(__file__).parents[1]
    files = [package / name for name in PHYSICS if name.endswith(".py")]
    files += sorted(path for name in PHYSICS for path in (package / name).rglob("*.py"))
    if study.robust:  # draws are part of a result
        files += [package / "objectives.py", *sorted((package / "uncertain").glob("*.py"))]
    files += sorted((package / "data").glob("*.yaml"))
    for path in files:
        digest.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    for path in sorted(template_directory().glob("*.j2")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    if study.pilot.model == "multibody":
        check_templates(template_directory(), *DECK_TEMPLATES)
        solver_version(mbdae)  # a solver that cannot run is found out now, not by every pilot
        digest.update(find_mbdae(mbdae).read_bytes())
    return digest.hexdigest()
