"""HDF5 files of ours: whole or not at all, whatever the disk does; foreign and damaged ones are told.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from pilotgen.errors import FileError, MatrixError
from pilotgen.hdf5 import NewFile, opened

LIMITED = """
import resource, sys
import numpy as np
from pilotgen.errors import FileError
from pilotgen.hdf5 import NewFile
before = resource.getrlimit(resource.RLIMIT_FSIZE)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), before[1]))
try:
    with NewFile(sys.argv[1], "pilotgen test", (1, 0)) as new:
        for k in range(40):
            new.file.create_group(f"group {k}")["data"] = np.full(500, float(k))
            if k % 7 == 0:
                new.check()
except FileError as error:
    resource.setrlimit(resource.RLIMIT_FSIZE, before)  # what measures coverage writes at the end
    print(error)
"""


@pytest.mark.parametrize("limit", [0, 100, 3000, 50_000, 170_000])
def test_a_disk_that_is_full_gives_one_sentence(tmp_path: Path, limit: int) -> None:
    """A limit on the size of files stands in for the disk; the library crashed when it met it."""
    path = tmp_path / "file.h5"
    path.write_text("what was there before")
    command = [sys.executable, "-c", LIMITED, str(path), str(limit)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"{path}: cannot be written (File too large); check space and permissions\n"
    assert path.read_text() == "what was there before" and list(tmp_path.iterdir()) == [path]


def test_a_file_takes_its_name_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "file.h5"
    with pytest.raises(RuntimeError), NewFile(path, "pilotgen test", (1, 2)):
        raise RuntimeError
    assert not list(tmp_path.iterdir())
    with NewFile(path, "pilotgen test", (1, 2)) as new:
        new.file["data"] = np.arange(3.0)
    with opened(path, "pilotgen test", (1, 0)) as file:
        assert file["data"][:].tolist() == [0.0, 1.0, 2.0]


def read(path: Path, major: int, name: str = "data") -> None:
    with opened(path, "pilotgen test", (major, 0), MatrixError) as file:
        file[name][()]


def test_foreign_and_damaged_files(tmp_path: Path) -> None:
    path = tmp_path / "file.h5"
    with h5py.File(path, "w") as file:
        file.attrs["filetype"], file.attrs["version"] = "other", (1, 0)
    with pytest.raises(MatrixError, match="is not a pilotgen test file: its filetype is 'other'"):
        read(path, 1)
    with NewFile(path, "pilotgen test", (2, 1)) as new:
        new.file["data"] = np.arange(3.0)
    with pytest.raises(MatrixError, match=r"version 2.1 of the format; this program reads 1.x"):
        read(path, 1)
    for name in ("nothing", "data/below"):
        with pytest.raises(MatrixError, match="a part is missing, of the wrong kind or damaged"):
            read(path, 2, name)
    path.write_bytes(b"text")
    with pytest.raises(FileError, match="cannot be read as HDF5"):
        read(path, 2)
