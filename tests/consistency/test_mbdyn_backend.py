"""`--solver mbdyn`: the same deck, its matrices in MBDyn's own convention and text format, the same result.

The stand-in for MBDyn below takes the deck through mbdae and writes what MBDyn would: Aplus and Aminus with constraint
rows divided by +-c and reaction columns not multiplied by c, as `PREFIX_00.m` with 17 digits. What it proves is the way
round: finding the program, its command line, its file, the reader, and everything downstream.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from pilotgen.cli import main
from pilotgen.solver.client import find_mbdae

QUICK = Path(__file__).parents[2] / "docs" / "studies" / "quick.yaml"

STAND_IN = """#!{python}
import subprocess, sys
import numpy as np
from pilotgen.solver.matrices import read_matrices

deck, prefix = sys.argv[sys.argv.index("-f") + 1], sys.argv[sys.argv.index("-o") + 1]
subprocess.run(["{mbdae}", deck, "-o", prefix], check=True, stdout=subprocess.DEVNULL)
m = read_matrices(prefix + ".h5")
reaction = np.array([kind == "reaction" for kind in m.dof_kinds])
def write(name, J, c):
    A = J.copy()
    A[reaction] /= c
    A[:, reaction] /= c
    return name + " = [" + " ;\\n".join(" ".join(repr(float(v)) for v in row) for row in A) + " ];\\n"
nodes = m.nodes
with open(prefix + "_00.m", "w") as out:
    out.write(f"dTime = 0.;\\ndCoef = {{m.c!r}};\\nlStep = int32(0);\\n")
    out.write(write("Aplus", m.J_plus, m.c) + write("Aminus", m.J_minus, -m.c))
    out.write("labels = int32([ " + " ; ".join(str(int(v)) for v in nodes.label) + " ]);\\n")
    out.write("idx = int32([ " + " ; ".join(str(int(v)) for v in nodes.first) + " ]);\\n")
"""


@pytest.fixture
def stand_in(tmp_path: Path) -> Path:
    """An executable that answers as MBDyn does."""
    path = tmp_path / "programs" / "mbdyn"
    path.parent.mkdir()
    path.write_text(STAND_IN.format(python=sys.executable, mbdae=find_mbdae()))
    path.chmod(0o755)
    return path


def test_both_backends_give_the_same_result(tmp_path: Path, stand_in: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results = {}
    for solver in ("mbdae", "mbdyn"):
        arguments = ["pilot", str(QUICK), "-o", str(tmp_path / solver), "--solver", solver, "--no-figures"]
        arguments += ["--mbdyn", str(stand_in)] if solver == "mbdyn" else []
        assert main(arguments) == 0, capsys.readouterr().err
        results[solver] = json.loads((tmp_path / solver / "result.json").read_text())
    ours, theirs = results["mbdae"], results["mbdyn"]
    for name in ("gain_margin_db", "gain_margin_hz", "modulus_margin"):
        assert theirs["loop"][name] == pytest.approx(ours["loop"][name], rel=1e-9)
    for a, b in zip(ours["pilot_poles"], theirs["pilot_poles"], strict=True):
        assert b == pytest.approx(a, rel=1e-9)
    assert theirs["bdft"]["certificate"] < 1e-8
    # and the two files compare equal by name, whatever their convention
    capsys.readouterr()
    assert main(["compare", str(tmp_path / "mbdae" / "matrices.h5"), str(tmp_path / "mbdyn" / "pilot_00.m")]) == 0


def test_a_search_through_mbdyn(tmp_path: Path, stand_in: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = tmp_path / "study.yaml"
    study.write_text(
        QUICK.read_text().replace("population: 12", "population: 4").replace("generations: 3", "generations: 1")
    )
    arguments = ["search", str(study), "--no-report", "--quiet", "--workers", "1"]
    assert main([*arguments, "-o", str(tmp_path / "a")]) == 0
    assert main([*arguments, "-o", str(tmp_path / "b"), "--solver", "mbdyn", "--mbdyn", str(stand_in)]) == 0
    from pilotgen.runs.results import read_results

    a, b = (read_results(tmp_path / name / "study.h5").columns["gain_margin_db"] for name in ("a", "b"))
    assert b == pytest.approx(a, rel=1e-9)
