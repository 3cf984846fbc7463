"""`animation.h5`: where the bodies of a closed deck are over time, for pictures (docs/io_formats/closed_loop.md).

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from pilotgen.errors import MatrixError
from pilotgen.hdf5 import NewFile, opened, text
from pilotgen.virtual.virtual_test import MOTION_FILETYPE, MOTION_VERSION

FILETYPE, VERSION = "pilotgen animation", (1, 0)
FRAMES_HZ = 50.0
_POSE = ("x", "y", "z", "gx", "gy", "gz")


def write_animation(motion_file: str | os.PathLike[str], path: Path, frames_hz: float = FRAMES_HZ) -> None:
    """Write the poses of all nodes of a motion file with all channels, `frames_hz` times a second.

    Raises
    ------
    MatrixError
        It is no motion file, or has no poses.
    FileError
        It cannot be read or the other not be written.
    """
    with opened(motion_file, MOTION_FILETYPE, (MOTION_VERSION, 0), MatrixError) as file:
        time, data = np.asarray(file["time"][()]), file["data"][()]
        names = [text(channel).rstrip("\0") for channel in file["channels/name"][()]]
    place = {name: i for i, name in enumerate(names)}
    nodes = [name[:-3] for name in names if name.endswith(".gx") and all(f"{name[:-3]}.{c}" in place for c in _POSE)]
    if not nodes:
        raise MatrixError(f"{os.fspath(motion_file)}: has no poses of nodes; write all channels")
    step = float(time[1] - time[0]) if len(time) > 1 else 1.0
    rows = np.arange(0, len(time), max(1, round(1.0 / (frames_hz * step))))
    poses = np.stack([[data[rows, place[f"{node}.{c}"]] for c in _POSE] for node in nodes])  # (k, 6, n)
    with NewFile(path, FILETYPE, VERSION) as new:
        new.file["time"] = time[rows]
        new.file["time"].attrs["unit"] = "s"
        new.file["nodes"] = np.array([node.encode() for node in nodes])
        for name, part, unit in (("position", slice(0, 3), "m"), ("rotation_vector", slice(3, 6), "rad")):
            new.file[name] = np.ascontiguousarray(np.moveaxis(poses[:, part], 2, 0))
            new.file[name].attrs["unit"] = unit
