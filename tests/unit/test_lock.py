"""The lock of versions: each can be installed with the oldest Python that pilotgen promises.

SPDX-License-Identifier: BSD-3-Clause
"""

import importlib.metadata
import re
from pathlib import Path

import pytest
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[2]
PYTHON = re.search(r'OLDEST_PYTHON = "([\d.]+)"', (ROOT / ".ci" / "lock").read_text(encoding="utf-8"))
PINS = [
    line.split("==")
    for line in (ROOT / ".ci" / "constraints.txt").read_text(encoding="utf-8").splitlines()
    if not line.startswith("#")
]


def test_every_locked_version_runs_on_the_oldest_python() -> None:
    """A later `Requires-Python` than that of Debian 12 stops `make study` there, and only there."""
    assert PYTHON is not None
    seen = 0
    for name, version in PINS:
        try:
            found = importlib.metadata.distribution(name)
        except importlib.metadata.PackageNotFoundError:
            continue  # not needed on this machine
        if found.version != version:
            continue  # `make test LOCK=` has newer ones
        seen += 1
        wanted = SpecifierSet((found.metadata.get_all("Requires-Python") or [""])[0])
        assert wanted.contains(PYTHON.group(1)), f"{name} {version} wants Python {wanted}"
    if not seen:
        pytest.skip("none of the locked versions is installed")


def test_the_lock_names_every_package_once() -> None:
    names = [canonicalize_name(name) for name, _ in PINS]
    assert len(names) == len(set(names)) > 100
