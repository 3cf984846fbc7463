"""Files of the solver: one for each time of an eigenanalysis, and nothing but regular ones.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

from pilotgen.solver.matrices import read_matrices

# A body hinged at 1 m from its centre of mass, released from the horizontal.
DECK = """begin: data; problem: initial value; end: data;
begin: initial value;
    initial time: 0.; final time: 1.; time step: 1.e-2; method: ms, 0.6; tolerance: 1.e-9; max iterations: 20;
    eigenanalysis: {when}, parameter, 0.02;
end: initial value;
begin: control data; structural nodes: 1; rigid bodies: 1; joints: 1; gravity; end: control data;
{globals}
begin: nodes; structural: 1, dynamic, 1., 0., 0., eye, null, null; end: nodes;
begin: elements;
    body: 1, 1, 1., null, eye;
    joint: 1, spherical pin, 1, position, -1., 0., 0., position, null;
    gravity: uniform, 0., 0., -1., const, 9.81;
end: elements;
"""


def run(mbdae: Path, *arguments: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [str(mbdae), *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=30, check=False)


def write(directory: Path, when: str = "0.", globals_: str = "") -> Path:
    path = directory / "deck.mbd"
    path.write_text(DECK.format(when=when, globals=globals_))
    return path


def test_every_time_of_an_eigenanalysis_has_its_file(mbdae: Path, tmp_path: Path) -> None:
    done = run(mbdae, write(tmp_path, "list, 3, 0., 0.3, 0.5"), "-o", "out", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    reply = json.loads(done.stdout)
    assert reply["output"] == "out.h5"
    assert reply["more_outputs"] == ["out_01.h5", "out_02.h5"]
    times = [read_matrices(tmp_path / name).time for name in ["out.h5", "out_01.h5", "out_02.h5"]]
    assert times == pytest.approx([0.0, 0.3, 0.5], abs=1e-12)


def test_a_later_eigenanalysis_is_not_that_of_the_start(mbdae: Path, tmp_path: Path) -> None:
    assert run(mbdae, write(tmp_path, "0.5"), "-o", "late", cwd=tmp_path).returncode == 0
    assert run(mbdae, write(tmp_path, "0."), "-o", "start", cwd=tmp_path).returncode == 0
    late, start = (read_matrices(tmp_path / f"{name}.h5") for name in ("late", "start"))
    assert late.time == pytest.approx(0.5, abs=1e-12)
    assert abs(late.J_plus - start.J_plus).max() > 0.1


@pytest.mark.parametrize("kind", ["fifo", "device", "directory"])
def test_decks_and_includes_are_regular_files(mbdae: Path, tmp_path: Path, kind: str) -> None:
    special = tmp_path / "special"
    if kind == "fifo":
        os.mkfifo(special)
    elif kind == "device":
        special = Path("/dev/zero")
    else:
        special.mkdir()
    done = run(mbdae, "--check", special, cwd=tmp_path)
    assert done.returncode == 1
    assert str(special) in done.stderr
    done = run(mbdae, "--check", write(tmp_path, globals_=f'include: "{special}";'), cwd=tmp_path)
    assert done.returncode == 1
    assert f"cannot include `{special}`"[:40] in done.stderr
    assert {"fifo": "FIFO", "device": "device", "directory": "directory"}[kind] in done.stderr


@pytest.mark.parametrize("kind", ["fifo", "link", "part"])
def test_results_are_written_to_regular_files_only(mbdae: Path, tmp_path: Path, kind: str) -> None:
    deck, target = write(tmp_path), tmp_path / "kept"
    target.write_text("mine")
    if kind == "fifo":
        os.mkfifo(tmp_path / "out.h5")
    elif kind == "link":
        (tmp_path / "out.h5").symlink_to(target)
    else:
        (tmp_path / "out.h5.part").symlink_to(target)
    done = run(mbdae, deck, "-o", "out", cwd=tmp_path)
    assert done.returncode == 1
    assert "cannot write 'out.h5" in done.stderr
    assert target.read_text() == "mine"


def test_includes_that_double_end(mbdae: Path, tmp_path: Path) -> None:
    for i in range(20):
        (tmp_path / f"{i}.inc").write_text(f'include: "{i + 1}.inc"; include: "{i + 1}.inc";\n')
    (tmp_path / "20.inc").write_text("")
    done = run(mbdae, "--check", write(tmp_path, globals_='include: "0.inc";'), cwd=tmp_path)
    assert done.returncode == 1
    assert "more than 10000 files are included" in done.stderr
