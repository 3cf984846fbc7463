"""Compare time histories of MBDyn (`.mov`, `.jnt`, `.ine`, NetCDF) with ours, row by row.

MBDyn names nodes and joints by label, and a joint's file holds more than its unknowns; the deck, read by mbdae, tells
which is which. Rows are compared one by one, so ours has to be integrated with MBDyn's own method and step.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import itertools
import os
import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pilotgen.errors import FileError, MatrixError
from pilotgen.files import refuse_special
from pilotgen.hdf5 import open_to_read, opened, text
from pilotgen.posture.kinematics import rotation, rotation_vector
from pilotgen.solver.client import SolverClient
from pilotgen.solver.descriptor import Floats, Indices
from pilotgen.solver.matrices import read_matrices

SUFFIXES = (".mov", ".jnt", ".ine", ".nc")
MOST_SHOWN = 5
_SAME_TIME_S = 1e-9
_MOTION = ("pilotgen motion", (1, 0))
_CHANNELS = ("x", "y", "z", "gx", "gy", "gz", "vx", "vy", "vz", "wx", "wy", "wz")
_MOMENTA = ("bx", "by", "bz", "hx", "hy", "hz")
# Columns of a joint's row in `.jnt`, after its label from 0: force and moment in the joint's axes, then global.
_JOINT_COLUMNS: Mapping[str, tuple[int, ...]] = {
    "clamp": (6, 7, 8, 9, 10, 11),
    "spherical hinge": (6, 7, 8),
    "spherical pin": (6, 7, 8),
    "revolute hinge": (6, 7, 8, 3, 4),
    "revolute pin": (6, 7, 8, 3, 4),
    "cardano hinge": (6, 7, 8, 3),
    "cardano pin": (6, 7, 8, 3),
    "in line": (0, 1),
}
_NOTHING = 1e-15  # a difference that is round-off of zero, whatever its unit
_WIDTHS = {"mov": (12, 18, 24), "ine": (12,)}  # pose, velocities; accelerations; the orientation as a matrix
_TOTAL = ("total joint", "total pin joint")  # the active components of columns 0 to 5


@dataclass(frozen=True)
class ChannelDifference:
    """One channel of the two histories.

    Attributes
    ----------
    name : str
        Our name of it; an orientation is called after its node alone.
    kind : str
        What it is: position, orientation, velocity, ...
    largest : float
        Largest difference (absolute).
    time_s : float
        When [s].
    relative : float
        Largest difference over the largest value of this kind in either history.
    """

    name: str
    kind: str
    largest: float
    time_s: float
    relative: float


@dataclass(frozen=True)
class MotionComparison:
    """All channels that both histories have.

    Attributes
    ----------
    ours, theirs : str
        The files.
    tolerance : float
        Largest relative difference that counts as none.
    channels : tuple of ChannelDifference
        Largest relative difference first.
    left_out : tuple of str
        What MBDyn's file has and was not compared, with the reason.
    rows : int
        Instants compared.
    """

    ours: str
    theirs: str
    tolerance: float
    channels: tuple[ChannelDifference, ...]
    left_out: tuple[str, ...]
    rows: int

    @property
    def agree(self) -> bool:
        """Whether every difference is within the tolerance."""
        return all(channel.relative <= self.tolerance for channel in self.channels)


@dataclass(frozen=True)
class _Joint:
    name: str
    type: str
    size: int


@dataclass(frozen=True)
class _Deck:
    nodes: dict[int, str]  # label -> name
    joints: dict[int, _Joint]
    orientation: str  # how `.mov` says it


def compare_motion(
    deck: str | os.PathLike[str],
    ours: str | os.PathLike[str],
    theirs: str | os.PathLike[str],
    client: SolverClient,
    tolerance: float = 1e-6,
) -> MotionComparison:
    """Compare one of MBDyn's files with a motion file of ours.

    Parameters
    ----------
    deck : path
        The deck that both integrated.
    ours : path
        Motion file (docs/io_formats/motion.md) with all its channels, integrated by `ms`.
    theirs : path
        `.mov`, `.jnt`, `.ine` or `.nc` of MBDyn.
    client : SolverClient
        Reads the deck, for names and labels.
    tolerance : float
        Largest difference relative to the largest value of its kind.

    Raises
    ------
    FileError, MatrixError, SolverError
        A file cannot be read, or the two are not histories of this deck at the same instants.
    """
    names = _read_deck(deck, client)
    time, channels = _read_ours(ours)
    path = os.fspath(theirs)
    suffix = Path(path).suffix
    if suffix not in SUFFIXES:
        raise FileError(f"{path}: expected a history of MBDyn, one of {', '.join(SUFFIXES)}")
    if not os.path.isfile(path):
        raise FileError(f"{path}: no such file")
    tables, rows, their_time = _read_netcdf(path) if suffix == ".nc" else _read_text(path)
    chosen = _instants(path, time, rows, their_time)
    found: list[tuple[str, str, Floats, Floats]] = []  # name, kind, ours, theirs
    left_out: list[str] = []
    for (kind, label), table in tables.items():
        if not np.isfinite(table).all():
            row = int(np.argwhere(~np.isfinite(table))[0][0]) + 1
            raise MatrixError(f"{path}: label {label} has a value that is not a finite number at instant {row}")
        of = {name: data[chosen] for name, data in channels.items()}
        if kind == "mov":
            _nodes(names, label, table, of, found, left_out)
        elif kind == "ine":
            _momenta(names, label, table, of, found, left_out)
        else:
            _reactions(names, label, table, of, found, left_out)
    if not found:
        raise MatrixError(
            f"{path}: nothing in it is in {os.fspath(ours)}; left out: {'; '.join(left_out) or 'nothing'}"
        )
    scale: dict[str, float] = {}
    for _, kind, a, b in found:
        scale[kind] = max(scale.get(kind, 0.0), float(np.abs(a).max()), float(np.abs(b).max()))
    differences = []
    for name, kind, a, b in found:
        size = np.abs(a - b) if a.ndim == 1 else np.sqrt(((a - b) ** 2).sum(axis=1))
        worst = int(size.argmax())
        largest = float(size[worst])
        differences.append(
            ChannelDifference(
                name, kind, largest, float(time[chosen][worst]), largest / scale[kind] if largest > _NOTHING else 0.0
            )
        )
    differences.sort(key=lambda d: -d.relative)
    return MotionComparison(os.fspath(ours), path, tolerance, tuple(differences), tuple(left_out), len(chosen))


def report(comparison: MotionComparison) -> str:
    """Return the comparison as text for a person."""
    lines = [f"ours   {comparison.ours}", f"MBDyn  {comparison.theirs}", f"{comparison.rows} instants", ""]
    kinds: dict[str, list[ChannelDifference]] = {}
    for channel in comparison.channels:
        kinds.setdefault(channel.kind, []).append(channel)
    for kind, channels in kinds.items():
        worst = channels[0]
        lines.append(
            f"{kind}: {len(channels)} channels, largest difference {worst.largest:.3e}, {worst.relative:.2e} of the "
            "largest value"
        )
        lines += [
            f"     {channel.name} at {channel.time_s:.6g} s: {channel.relative:.2e}"
            for channel in channels[:MOST_SHOWN]
            if channel.relative > comparison.tolerance
        ]
    lines += [f"not compared: {words}" for words in comparison.left_out]
    verdict = "agree" if comparison.agree else "DIFFER"
    lines += ["", f"the histories {verdict} at a relative tolerance of {comparison.tolerance:g}"]
    return "\n".join(lines)


# ---- what belongs to what --------------------------------------------------------------------------------------------


def _read_deck(deck: str | os.PathLike[str], client: SolverClient) -> _Deck:
    path = os.path.abspath(os.fspath(deck))
    refuse_special(path)
    try:
        words = re.sub(r"#[^\n]*", "", Path(path).read_text(encoding="utf-8", errors="replace"))
    except OSError as error:
        raise FileError(f"{os.fspath(deck)}: cannot be read: {error.strerror}") from None
    card = re.search(r"default\s+orientation\s*:\s*([^;]*);", words)
    with tempfile.TemporaryDirectory(prefix="pilotgen-compare-") as directory:
        output = os.path.join(directory, "deck.h5")
        client.request("linearise", name=path, output=output, nodes=False, c=1e-3)
        matrices = read_matrices(output)
    nodes, joints = matrices.nodes, matrices.joints
    return _Deck(
        nodes={int(label): name.decode() for label, name in zip(nodes.label, nodes.name, strict=True)},
        joints={
            int(label): _Joint(name.decode(), kind.decode(), int(size))
            for label, name, kind, size in zip(joints.label, joints.name, joints.type, joints.dofs, strict=True)
        },
        orientation=" ".join(card[1].split()) if card else "euler123",
    )


def _nodes(
    deck: _Deck,
    label: int,
    table: Floats,
    ours: Mapping[str, Floats],
    found: list[tuple[str, str, Floats, Floats]],
    left_out: list[str],
) -> None:
    name = deck.nodes.get(label)
    if name is None or f"{name}.x" not in ours:
        left_out.append(f"node {label}: not in our history")
        return
    own = np.stack([ours[f"{name}.{channel}"] for channel in _CHANNELS], axis=1)
    turns = {"orientation vector": _by_vector, "euler123": _by_euler123}.get(deck.orientation)
    if turns is None or table.shape[1] < 12:
        left_out.append(f"orientations: told as {deck.orientation}; 'orientation vector' and 'euler123' are read")
    else:
        pairs = [(rotation(a), turns(b)) for a, b in zip(own[:, 3:6], table[:, 3:6], strict=True)]
        apart = np.array([rotation_vector(a.T @ b) for a, b in pairs])
        found.append((name, "orientation", own[:, 3:6], own[:, 3:6] + apart))
    for kind, columns in (("position", (0, 1, 2)), ("velocity", (6, 7, 8)), ("angular velocity", (9, 10, 11))):
        for k in columns:
            if k < table.shape[1]:
                found.append((f"{name}.{_CHANNELS[k]}", kind, own[:, k], table[:, k]))


def _by_vector(turn: Floats) -> Floats:
    return np.asarray(rotation(turn))


def _by_euler123(turn: Floats) -> Floats:
    """R = Rx(a1) Ry(a2) Rz(a3), angles in degrees, as MBDyn prints them unless a deck asks for another form."""
    a, b, c = np.radians(turn)
    axes = np.eye(3)
    return np.asarray(rotation(a * axes[0]) @ rotation(b * axes[1]) @ rotation(c * axes[2]))


def _momenta(
    deck: _Deck,
    label: int,
    table: Floats,
    ours: Mapping[str, Floats],
    found: list[tuple[str, str, Floats, Floats]],
    left_out: list[str],
) -> None:
    name = deck.nodes.get(label)
    if name is None or f"{name}.bx" not in ours:
        left_out.append(f"momenta of node {label}: not in our history")
        return
    for k, channel in enumerate(_MOMENTA):
        kind = "momentum" if k < 3 else "momenta moment"
        found.append((f"{name}.{channel}", kind, ours[f"{name}.{channel}"], table[:, k]))


def _reactions(
    deck: _Deck,
    label: int,
    table: Floats,
    ours: Mapping[str, Floats],
    found: list[tuple[str, str, Floats, Floats]],
    left_out: list[str],
) -> None:
    joint = deck.joints.get(label)
    if joint is None or joint.size == 0:
        return  # a spring, a muscle: it has no reactions of its own
    keys = [f"{joint.name}.reaction[{k + 1}]" for k in range(joint.size)]
    if any(key not in ours for key in keys):
        left_out.append(f"joint {joint.name}: not in our history")
        return
    own = np.stack([ours[key] for key in keys], axis=1)
    columns = _JOINT_COLUMNS.get(joint.type)
    if joint.type in _TOTAL:
        columns = min(  # which components are active does not stand in the file; those that are not are zero
            itertools.combinations(range(6), joint.size), key=lambda c: float(np.abs(own - table[:, list(c)]).sum())
        )
    if columns is None or len(columns) != joint.size or max(columns) >= table.shape[1]:
        left_out.append(f"joint {joint.name}: the columns of a {joint.type} are not known")
        return
    for k, (key, column) in enumerate(zip(keys, columns, strict=True)):
        kind = "reaction moment" if column in (3, 4, 5, 9, 10, 11) else "reaction force"
        found.append((key, kind, own[:, k], table[:, column]))


# ---- the files -------------------------------------------------------------------------------------------------------

_VECTORS = re.compile(r"node\.struct\.\d+\.(X|Phi|XP|Omega|B|G)|elem\.joint\.\d+\.[fmFM]")
_Tables = dict[tuple[str, int], Floats]  # (mov, jnt or ine; label) -> (rows, columns)


def _read_ours(path: str | os.PathLike[str]) -> tuple[Floats, dict[str, Floats]]:
    with opened(path, *_MOTION, MatrixError) as file:
        time, data = np.asarray(file["time"][()]), np.asarray(file["data"][()])
        names = [text(channel).rstrip("\0") for channel in file["channels/name"][()]]
    return time, {name: data[:, k] for k, name in enumerate(names)}


def _read_text(path: str) -> tuple[_Tables, int, Floats | None]:
    rows: dict[int, list[list[float]]] = {}
    refuse_special(path)
    try:
        with open(path, encoding="ascii", errors="strict") as file:
            for number, line in enumerate(file, start=1):
                cells = line.split()
                if not cells:
                    continue
                try:
                    rows.setdefault(int(cells[0]), []).append([float(cell) for cell in cells[1:]])
                except ValueError:
                    raise MatrixError(
                        f"{path}:{number}: is not a label with numbers; MBDyn's output is wanted"
                    ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(f"{path}: cannot be read as text ({error})") from error
    kind = Path(path).suffix[1:]
    if not rows:
        raise MatrixError(f"{path}: no row in it; MBDyn's output is wanted")
    lengths = {len(table) for table in rows.values()}
    if len(lengths) != 1:
        raise MatrixError(f"{path}: its labels do not all have the same number of rows: {sorted(lengths)}")
    tables: _Tables = {}
    for label, table in rows.items():
        if len({len(row) for row in table}) > 1:
            raise MatrixError(f"{path}: the rows of label {label} do not all have the same number of columns")
        if len(table[0]) not in _WIDTHS.get(kind, (len(table[0]),)):
            raise MatrixError(
                f"{path}: label {label} has {len(table[0])} columns beside it, "
                f"{' or '.join(map(str, _WIDTHS[kind]))} are wanted"
            )
        tables[kind, label] = np.array(table)
    return tables, lengths.pop(), None


def _read_netcdf(path: str) -> tuple[_Tables, int, Floats | None]:
    variables = _netcdf(path)
    time = variables.get("time")
    if time is None:
        raise MatrixError(f"{path}: has no variable 'time'; a history of MBDyn is wanted")
    tables: _Tables = {}
    for name in variables:
        node = re.fullmatch(r"node\.struct\.(\d+)\.X", name)
        if node:
            start = name[:-1]
            parts = [variables.get(start + part) for part in ("X", "Phi", "XP", "Omega")]
            if all(part is not None and part.shape == (len(time), 3) for part in parts):
                tables["mov", int(node[1])] = np.hstack([part for part in parts if part is not None])
            momenta = [variables.get(start + part) for part in ("B", "G")]
            if all(part is not None and part.shape == (len(time), 3) for part in momenta):
                tables["ine", int(node[1])] = np.hstack([part for part in momenta if part is not None])
        joint = re.fullmatch(r"elem\.joint\.(\d+)\.f", name)
        if joint:
            parts = [variables.get(name[:-1] + part) for part in ("f", "m", "F", "M")]
            if all(part is not None and part.shape == (len(time), 3) for part in parts):
                tables["jnt", int(joint[1])] = np.hstack([part for part in parts if part is not None])
    return tables, len(time), time


def _netcdf(path: str) -> dict[str, Floats]:
    refuse_special(path)
    with open(path, "rb") as file:
        magic = file.read(8)
    try:
        if magic[:4] in (b"CDF\x01", b"CDF\x02"):
            from scipy.io import netcdf_file

            with netcdf_file(path, "r", mmap=False) as classic:
                return {
                    name: np.array(variable.data, dtype=np.float64)
                    for name, variable in classic.variables.items()
                    if name == "time" or _VECTORS.fullmatch(name)
                }
        if magic == b"\x89HDF\r\n\x1a\n":
            import h5py

            with open_to_read(path) as file4:
                return {
                    name: np.array(dataset[()], dtype=np.float64)
                    for name, dataset in file4.items()
                    if isinstance(dataset, h5py.Dataset) and (name == "time" or _VECTORS.fullmatch(name))
                }
    except (OSError, ValueError, TypeError, IndexError, KeyError, EOFError) as error:
        raise MatrixError(f"{path}: is not a whole NetCDF file ({error})") from error
    raise MatrixError(f"{path}: is not a NetCDF file (neither classic nor HDF5-based)")


def _instants(path: str, time: Floats, rows: int, their_time: Floats | None) -> Indices:
    """Which of our rows are compared: those of their instants."""
    if their_time is None:
        # text files tell no time: every n-th of our instants, n being the deck's output frequency
        every, rest = divmod(len(time) - 1, rows - 1) if rows > 1 else (1, len(time) - 1)
        if rest or every < 1:
            raise MatrixError(
                f"{path} has {rows} instants and our history {len(time)}: integrate with --integrator ms, the deck's "
                "step and final time"
            )
        return np.arange(0, len(time), every, dtype=np.intp)
    nearest: Indices = np.abs(time[:, None] - their_time).argmin(axis=0)
    apart = np.abs(time[nearest] - their_time)
    if apart.max(initial=0.0) > _SAME_TIME_S:
        worst = int(apart.argmax())
        raise MatrixError(
            f"{path}: our history has nothing at {their_time[worst]:.9g} s; integrate with --integrator ms and the "
            "deck's step"
        )
    return nearest
