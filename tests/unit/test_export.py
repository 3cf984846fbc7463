"""Export: what other programs load has the pilot's response; reductions keep what they promise.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from numpy.testing import assert_allclose

from pilotgen.cli import main
from pilotgen.context import EvaluationContext
from pilotgen.errors import PilotgenError, StudyError
from pilotgen.evaluation import evaluate
from pilotgen.linear.export import NamedStateSpace, as_mat, as_table, named, reduced, state_space_object
from pilotgen.linear.feedthrough import make_pilot_model, mayo_pilot
from pilotgen.linear.imposed_motion import SEAT_MOTIONS, Channels
from pilotgen.linear.pilot_model import PilotModel, read_pilot_model
from pilotgen.solver.matrices import read_matrices
from pilotgen.study.study import read_study

STUDY = Path(__file__).parents[2] / "docs" / "studies" / "puma-bmi.yaml"
OMEGA = 2.0 * np.pi * np.geomspace(0.1, 20.0, 30)


@pytest.fixture(scope="module")
def pilot(tmp_path_factory: pytest.TempPathFactory, mbdae: Path) -> Path:
    directory = tmp_path_factory.mktemp("pilot")
    study = read_study(STUDY)
    study = dataclasses.replace(study, pilot=dataclasses.replace(study.pilot, limbs=("left", "right")))
    with EvaluationContext(study, mbdae=str(mbdae)) as context:
        found = evaluate(context, study.nominal, keep=directory)
    found.pilot_model.write(directory / "pilot_model.h5")  # type: ignore[union-attr]
    return directory


@pytest.fixture(scope="module")
def six(pilot: Path) -> PilotModel:
    channels = Channels(inputs=tuple(SEAT_MOTIONS), point_m=(0.3, -0.4, 0.0))
    return make_pilot_model(read_matrices(pilot / "matrices.h5"), 0.32, 3.1, channels=channels)


def entries(model: PilotModel) -> np.ndarray:
    return np.array(
        [[model.response(OMEGA, i, input=j) for j in range(len(model.inputs))] for i in range(len(model.outputs))]
    ).transpose(2, 0, 1)


def test_formats_hold_the_response(pilot: Path, six: PilotModel, tmp_path: Path) -> None:
    wanted = entries(six)
    for kind in ("json", "mat", "csv", "h5"):
        file = tmp_path / f"pilot.{kind}"
        code = main(["export", str(pilot), "--format", kind, "-o", str(file), "--axes", "all", "--point=0.3,-0.4,0"])
        assert code == 0
        assert main(["export", str(pilot), "--format", kind, "-o", str(file)]) == 1  # nothing is replaced
    data = json.loads((tmp_path / "pilot.json").read_text())
    assert [signal["unit"] for signal in data["inputs"]] == ["m/s^2"] * 3 + ["rad/s^2"] * 3
    assert data["outputs"][-1] == {"name": "grip_motion", "unit": "m"}
    units = (("",) * 6, ("",) * 4)
    for matrices in (data, scipy.io.loadmat(tmp_path / "pilot.mat")):
        system = NamedStateSpace(*(np.array(matrices[k]) for k in "ABCD"), *(("",) * 6, units[0], ("",) * 4, units[1]))
        found = system.response(OMEGA)
        for i in range(3):
            for j in range(6):
                assert_allclose(found[:, i, j], wanted[:, i, j], rtol=1e-6, atol=1e-12)
    mat = scipy.io.loadmat(tmp_path / "pilot.mat")
    assert mat["input_names"][3, 0][0] == "seat_roll_acceleration" and mat["output_units"][0, 0][0] == "rad"
    again = read_pilot_model(tmp_path / "pilot.h5")
    assert again.inputs == six.inputs
    assert_allclose(entries(again), wanted, rtol=1e-6, atol=1e-12)
    table = np.genfromtxt(tmp_path / "pilot.csv", delimiter=",", names=True, deletechars="")
    k = table.dtype.names.index("collective_rotation/seat_pitch_acceleration_real_[rad/(rad/s^2)]")
    value = table[table.dtype.names[k]] + 1j * table[table.dtype.names[k + 1]]
    expected = six.response(2.0 * np.pi * table["frequency_hz"], 0, input=4)
    assert_allclose(value, expected, rtol=1e-6, atol=1e-12)


def test_reductions_keep_their_promise(six: PilotModel) -> None:
    whole = named(six)
    for tolerance in (0.1, 0.01, 1e-4):
        small = reduced(whole, tolerance=tolerance)
        difference = small.response(OMEGA) - whole.response(OMEGA)
        top = np.linalg.svd(whole.response(OMEGA), compute_uv=False).max()
        assert len(small.A) < len(whole.A)
        assert np.linalg.svd(difference, compute_uv=False).max() <= tolerance * top * 1.05
        assert np.linalg.eigvals(small.A).real.max() < 0.0
    orders = [reduced(whole, order=r).error for r in (4, 8, 12)]
    assert orders == sorted(orders, reverse=True)


def test_what_cannot_be_reduced_or_exported_is_refused(six: PilotModel, pilot: Path, tmp_path: Path, capsys) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(PilotgenError, match="needs a stable model"):
        reduced(named(six, washout=False), order=4)
    for options, message in (
        ({}, "either an order or a tolerance"),
        ({"order": 0}, "order = 0 is outside 1"),
        ({"tolerance": 2.0}, "tolerance = 2 is outside"),
    ):
        with pytest.raises(StudyError, match=message):
            reduced(named(six), **options)
    file = str(tmp_path / "x.json")
    for more, message in (
        (["--axes", "heave,pedals"], "pedals are not modelled"),
        (["--axes", "bounce"], "seat motion 'bounce' is not known"),
        (["--point", "1,2"], "three numbers separated by commas"),
        (["--format", "h5", "--order", "3"], "go with json, mat and csv"),
    ):
        assert main(["export", str(pilot), "-o", file, *more]) == 1
        assert message in capsys.readouterr().err
    mayo_pilot(3.4, 0.3, 0.1, 0.32).write(tmp_path / "pilot_model.h5")
    assert main(["export", str(tmp_path), "-o", file, "--axes", "roll"]) == 1
    assert "a pilot of projection 'mayo' has heave alone" in capsys.readouterr().err
    assert not Path(file).exists()


@pytest.mark.skipif(shutil.which("octave") is None, reason="Octave is not installed")
def test_octave_loads_it(six: PilotModel, tmp_path: Path) -> None:
    (tmp_path / "pilot.mat").write_bytes(as_mat(named(six)))
    script = (
        "load pilot.mat; H = C*((2i*pi*3*eye(size(A))-A)\\B)+D; printf('%.15g %.15g\\n', real(H(1,1)), imag(H(1,1)));"
    )
    done = subprocess.run(["octave", "--eval", script], cwd=tmp_path, capture_output=True, text=True, check=True)
    real, imag = map(float, done.stdout.split())
    assert complex(real, imag) == pytest.approx(complex(six.response(6.0 * np.pi)), rel=1e-9)


def test_texts(six: PilotModel) -> None:
    assert json.loads(json.dumps(state_space_object(named(six)), allow_nan=False))["version"] == "1.0"
    assert as_table(named(six)).count("\n") == 401
