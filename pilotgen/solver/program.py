"""The command `mbdae`: becomes the solver program that the package contains.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
import sys
from importlib import resources
from pathlib import Path
from typing import NoReturn


def packaged_mbdae() -> Path | None:
    """Path of the solver inside the package; None when the package was installed without it."""
    with resources.as_file(resources.files("pilotgen").joinpath("bin", "mbdae")) as path:
        return path if path.is_file() and os.access(path, os.X_OK) else None


def main() -> NoReturn:
    """Replace this process by the solver, with the same arguments; ends with 1 if there is none."""
    program = packaged_mbdae()
    if program is None:
        sys.exit("mbdae: error: this installation of pilotgen has no solver; install it anew")
    os.execv(program, [str(program), *sys.argv[1:]])
