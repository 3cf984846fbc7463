"""Loops from files: a state space, a transfer function or frequency response data, as JSON or MATLAB's .mat.

The format is described in docs/io_formats/loop.md. A file is read whole and checked before anything is computed; what
cannot be a loop is refused with one sentence that says what came and what was wanted.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import difflib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from pilotgen.errors import FileError, PilotgenError
from pilotgen.files import refuse_special
from pilotgen.hdf5 import open_to_read
from pilotgen.linear.exact import Rational, rational_from_factors, rational_from_polynomials
from pilotgen.linear.statespace import StateSpaceModel
from pilotgen.loop.frequency_data import FrequencyData

MOST_STATES = 300
MOST_COEFFICIENTS = 61  # of a transfer function: degree 60
MOST_BYTES = 50_000_000

_STATE_SPACE = ("A", "B", "C", "D")
_POLYNOMIALS = ("num", "den")
_FACTORS = ("zeros", "poles", "gain")
_FREQUENCIES = ("omega_rad_s", "frequency_hz")
_VALUES = ("response", "real", "imag", "magnitude", "magnitude_db", "phase_deg")
_COUNTS = ("open_loop_unstable_poles", "open_loop_poles_at_origin")
_SIGNALS = ("inputs", "outputs")  # of plants
_SAYING_NOTHING = ("note", "name", "source", "comment")
_KNOWN = (*_STATE_SPACE, *_POLYNOMIALS, *_FACTORS, *_FREQUENCIES, *_VALUES, *_COUNTS)
_WANTED = "wanted are A, B, C, D; or num, den; or zeros, poles, gain; or omega_rad_s (or frequency_hz) with response"


@dataclass(frozen=True)
class LoopFile:
    """A loop L(s) as a file gives it, and the keys of the file that say nothing about it."""

    loop: StateSpaceModel | Rational | FrequencyData
    ignored: tuple[str, ...]


def read_loop(path: Path) -> LoopFile:
    """Read a loop from a .json or .mat file.

    Raises
    ------
    FileError
        The file cannot be read, or does not hold a loop.
    """
    values = read_values(path)
    loop = _Reader(path, values).loop()
    return LoopFile(loop, tuple(key for key in values if key not in (*_KNOWN, *_SAYING_NOTHING)))


def read_values(path: Path) -> dict[str, Any]:
    """Return what a .json, .mat or .h5 file holds, by key. FileError if it cannot be read."""
    refuse_special(path)
    try:
        if path.stat().st_size > MOST_BYTES:
            raise FileError(f"{path}: more than {MOST_BYTES // 1_000_000} MB; a loop of that size is not read")
        readers = {".mat": _read_mat, ".h5": _read_h5, ".hdf5": _read_h5}
        return readers.get(path.suffix.lower(), _read_json)(path)
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror or error})") from None


# ---- the two kinds of file


def _read_json(path: Path) -> dict[str, Any]:
    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key, value in pairs:
            if key in found:
                raise FileError(f"{path}: the key {key!r} stands twice in one object")
            found[key] = value
        return found

    try:
        values = json.loads(path.read_bytes().decode("utf-8-sig"), object_pairs_hook=once)
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: not UTF-8 text (byte {error.start}); a loop is a JSON or .mat file") from None
    except json.JSONDecodeError as error:
        raise FileError(f"{path}:{error.lineno}:{error.colno}: not JSON") from None
    except RecursionError:
        raise FileError(f"{path}: lists within lists without end; a loop needs two levels") from None
    except ValueError:  # an integer of thousands of digits
        raise FileError(f"{path}: a number has more digits than can be read") from None
    if not isinstance(values, dict):
        raise FileError(f"{path}: a JSON {_kind(values)}, wanted an object with keys; {_WANTED}")
    return values


def _read_mat(path: Path) -> dict[str, Any]:
    import scipy.io

    with path.open("rb") as file:
        if file.read(8) == b"\x89HDF\r\n\x1a\n" or file.seek(0) or b"MATLAB 7.3" in file.read(128):
            raise FileError(f"{path}: a MATLAB 7.3 file; save it with -v7 or -v6")
    try:
        values = scipy.io.loadmat(os.fspath(path), appendmat=False)
    except Exception as error:  # scipy raises whatever the bytes lead it to
        raise FileError(f"{path}: not a .mat file that can be read ({type(error).__name__})") from None
    found: dict[str, Any] = {}
    for key, value in values.items():
        if key.startswith("__"):
            continue
        if hasattr(value, "toarray"):
            if max(value.shape) > MOST_STATES:
                raise FileError(
                    f"{path}: {key} is a sparse matrix of shape {value.shape}; {MOST_STATES} states are read"
                )
            value = value.toarray()
        if key in _SIGNALS and isinstance(value, np.ndarray) and value.dtype.names:  # an array of structs
            found[key] = _structs(value)
            continue
        if key in _KNOWN and (not isinstance(value, np.ndarray) or value.dtype.kind not in "iufc"):
            kind = value.dtype.names or value.dtype if isinstance(value, np.ndarray) else type(value).__name__
            raise FileError(
                f"{path}: {key} is no array of numbers but {kind}; systems as objects are not read: save A, B, C, D"
            )
        found[key] = value
    return found


def _structs(array: Any) -> list[dict[str, Any]]:
    """An array of MATLAB structs as a list of mappings; empty fields stay away."""
    found = []
    for one in np.ravel(array):
        fields = {name: np.ravel(one[name]) for name in array.dtype.names}
        found.append({name: _plain(value[0]) for name, value in fields.items() if value.size})
    return found


def _plain(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return value.item() if isinstance(value, np.generic) else value


def _read_h5(path: Path) -> dict[str, Any]:
    """Datasets and attributes of the root; groups `inputs` and `outputs` as lists of signals, a dataset per field."""
    import h5py

    try:
        with open_to_read(os.fspath(path)) as file:
            found: dict[str, Any] = {key: _plain(value) for key, value in file.attrs.items()}
            for key, item in file.items():
                if isinstance(item, h5py.Group):
                    if key in _SIGNALS:
                        found[key] = _columns(path, key, item)
                    continue
                found[key] = _h5_value(item)
    except (OSError, KeyError, ValueError, TypeError, RuntimeError) as error:
        raise FileError(f"{path}: not an HDF5 file that can be read ({type(error).__name__})") from None
    return found


def _h5_value(item: Any) -> Any:
    import h5py

    if h5py.check_string_dtype(item.dtype) or item.dtype.kind == "S":
        texts = np.asarray(item.asstr()[()] if h5py.check_string_dtype(item.dtype) else item[()].astype(str))
        return str(texts) if texts.ndim == 0 else [str(one) for one in np.ravel(texts)]
    return np.asarray(item[()])


def _columns(path: Path, key: str, group: Any) -> list[dict[str, Any]]:
    columns = {}
    for name, item in group.items():
        value = _h5_value(item)
        columns[name] = value if isinstance(value, list) else [_plain(one) for one in np.ravel(value)]
    lengths = {len(column) for column in columns.values()}
    if len(lengths) != 1:
        raise FileError(f"{path}: the datasets of {key} differ in length; one value for each signal is wanted")
    rows = zip(*columns.values(), strict=True)
    return [{name: value for name, value in zip(columns, row, strict=True) if value != ""} for row in rows]


def _kind(value: Any) -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true or false"
    return "object" if isinstance(value, dict) else "list" if isinstance(value, list) else "text or number"


# ---- from values to a loop


class _Reader:
    def __init__(self, path: Path, values: Mapping[str, Any]) -> None:
        self.path = path
        self.values = values

    def fail(self, message: str) -> NoReturn:
        raise FileError(f"{self.path}: {message}")

    def loop(self) -> StateSpaceModel | Rational | FrequencyData:
        forms = {
            "a state space": _STATE_SPACE,
            "a transfer function num / den": _POLYNOMIALS,
            "zeros, poles and gain": _FACTORS,
            "frequency response data": (*_FREQUENCIES, *_VALUES),
        }
        given = [name for name, keys in forms.items() if any(key in self.values for key in keys)]
        if not given:
            guesses = [
                f"{key!r} (did you mean {near[0]!r}?)" if near else repr(key)
                for key in list(self.values)[:8]
                for near in [difflib.get_close_matches(key, _KNOWN, n=1)]
            ]
            self.fail(f"no loop in it: found {', '.join(guesses) or 'no key at all'}; {_WANTED}")
        if len(given) > 1:
            self.fail(f"{' and '.join(given)} in one file; give the loop in one form")
        form = given[0]
        if form != "frequency response data":
            for key in _COUNTS:
                if key in self.values:
                    self.fail(f"{key} goes with frequency response data only; {form} tells its poles itself")
            for key in forms[form]:
                if key not in self.values:
                    self.fail(f"{key} is missing; {form} needs {', '.join(forms[form])}")
        try:
            if form == "a state space":
                return self._state_space()
            if form == "a transfer function num / den":
                return rational_from_polynomials(self._coefficients("num"), self._coefficients("den"))
            if form == "zeros, poles and gain":
                return self._factors()
            return self._frequency_data()
        except FileError:
            raise
        except PilotgenError as error:
            self.fail(str(error))

    # Numbers

    def _numbers(self, key: str) -> npt.NDArray[Any]:
        """An array of finite numbers as given, complex ones only where they come as such (.mat)."""
        value = self.values[key]
        if isinstance(value, np.ndarray):
            array = value
        else:
            self._check_json(key, value)
            try:
                array = np.array(value, dtype=float)
            except OverflowError:
                self.fail(f"{key} holds a number beyond the range of doubles")
            except ValueError:
                self.fail(f"{key} has rows of different lengths")
        if not np.isfinite(array).all():
            at = np.argwhere(~np.isfinite(array))[0]
            place = ", ".join(str(int(i) + 1) for i in at)
            self.fail(f"{key}({place}) is {array[tuple(at)]}; finite numbers are wanted")
        return array

    def _check_json(self, key: str, value: Any) -> None:
        stack = [value]
        while stack:
            item = stack.pop()
            if isinstance(item, list):
                stack.extend(item)
            elif isinstance(item, bool) or not isinstance(item, int | float):
                shown = json.dumps(item)[:40] if not isinstance(item, dict) else "an object"
                self.fail(f"{key} holds {shown} where a number is wanted")

    def _real(self, key: str) -> npt.NDArray[np.float64]:
        array = self._numbers(key)
        if np.iscomplexobj(array):
            if np.any(array.imag):
                self.fail(f"{key} is complex; real numbers are wanted")
            array = array.real
        return np.asarray(array, dtype=float)

    def _vector(self, key: str) -> npt.NDArray[np.float64]:
        array = self._real(key)
        if array.ndim == 0 or (array.ndim == 2 and 1 in array.shape):
            array = array.reshape(-1)
        if array.ndim != 1:
            self.fail(f"{key} has the shape {array.shape}; a list of numbers is wanted")
        return array

    def _scalar(self, key: str) -> float:
        array = self._real(key)
        if array.size != 1:
            self.fail(f"{key} has the shape {array.shape}; one number is wanted (one input, one output)")
        return float(array.reshape(-1)[0])

    def _complex(self, key: str) -> npt.NDArray[np.complex128]:
        """A list of numbers or [real, imaginary] pairs; from .mat, an array of any kind with one row or column."""
        value = self.values[key]
        if isinstance(value, np.ndarray):
            array = self._numbers(key)
            if array.size not in (0, max(array.shape, default=1)):
                self.fail(f"{key} has the shape {array.shape}; one row or column is wanted")
            return array.reshape(-1).astype(complex)
        if not isinstance(value, list):
            self.fail(f"{key} is a {_kind(value)}; a list is wanted")
        self._check_json(key, value)
        pairs = [item if isinstance(item, list) else [item, 0.0] for item in value]
        bad = next(
            (i for i, item in enumerate(pairs) if len(item) != 2 or any(isinstance(x, list) for x in item)), None
        )
        if bad is not None:
            self.fail(f"{key}, entry {bad + 1}: a number or a pair [real, imaginary] is wanted")
        try:
            array = np.array(pairs, dtype=float).reshape(-1, 2)
        except OverflowError:
            self.fail(f"{key} holds a number beyond the range of doubles")
        if not np.isfinite(array).all():
            self.fail(f"{key}({int(np.argwhere(~np.isfinite(array))[0][0]) + 1}) is not finite")
        return array[:, 0] + 1j * array[:, 1]

    # Forms

    def _state_space(self) -> StateSpaceModel:
        A, D = self._real("A"), self._scalar("D")
        if A.size == 0:
            A = A.reshape(0, 0)
        if A.size == 1:
            A = A.reshape(1, 1)
        if A.ndim != 2 or A.shape[0] != A.shape[1]:
            self.fail(f"A has the shape {A.shape}; a square matrix is wanted")
        n = len(A)
        if n > MOST_STATES:
            self.fail(f"{n} states; up to {MOST_STATES} are taken")
        B, C = self._real("B"), self._real("C")
        for key, array, shape in (("B", B, (n, 1)), ("C", C, (1, n))):
            if array.size != n or (array.ndim == 2 and array.shape != shape and n > 0) or array.ndim > 2:
                self.fail(f"{key} has the shape {array.shape}; {n} states, one input and one output want {shape}")
        return StateSpaceModel(A, B, C, D)

    def _coefficients(self, key: str) -> list[float]:
        array = self._vector(key)
        if array.size > MOST_COEFFICIENTS:
            self.fail(f"{key} is of degree {array.size - 1}; up to {MOST_COEFFICIENTS - 1} is taken")
        return [float(x) for x in array]

    def _factors(self) -> Rational:
        zeros, poles, gain = self._complex("zeros"), self._complex("poles"), self._scalar("gain")
        for key, roots in (("zeros", zeros), ("poles", poles)):
            if roots.size >= MOST_COEFFICIENTS:
                self.fail(f"{roots.size} {key}; up to {MOST_COEFFICIENTS - 1} are taken")
        return rational_from_factors(zeros.tolist(), poles.tolist(), gain)

    def _frequency_data(self) -> FrequencyData:
        given = [key for key in _FREQUENCIES if key in self.values]
        if len(given) != 1:
            self.fail(
                "frequencies come as omega_rad_s [rad/s] or as frequency_hz [Hz], "
                + ("one of the two" if given else "and neither is there")
            )
        omega = self._vector(given[0]) * (1.0 if given[0] == "omega_rad_s" else 2.0 * math.pi)
        return FrequencyData(
            omega,
            self._response(),
            self._count("open_loop_unstable_poles"),
            self._count("open_loop_poles_at_origin") or 0,
        )

    def _response(self) -> npt.NDArray[np.complex128]:
        ways = [
            (size, phase)
            for size, phase in (
                ("response", "response"), ("real", "imag"), ("magnitude", "phase_deg"), ("magnitude_db", "phase_deg"),
            )
            if size in self.values and phase in self.values
        ]  # fmt: skip
        used = {key for keys in ways for key in keys}
        left = [key for key in _VALUES if key in self.values and key not in used]
        if len(ways) != 1 or left:
            found = ", ".join(key for key in _VALUES if key in self.values) or "none of them"
            self.fail(
                "values come as response, as real and imag, or as magnitude (or magnitude_db) and phase_deg; "
                f"found {found}"
            )
        if ways[0][0] == "response":
            return self._complex("response")
        first, second = (self._vector(key) for key in ways[0])
        if first.size != second.size:
            self.fail(f"{first.size} values of {ways[0][0]} beside {second.size} of {ways[0][1]}")
        if ways[0] == ("real", "imag"):
            return first + 1j * second
        size = first if ways[0][0] == "magnitude" else 10.0 ** (np.clip(first, -6000.0, 6000.0) / 20.0)
        if (size < 0.0).any():
            self.fail("magnitude holds a negative number")
        phase = np.radians(second)
        return np.asarray(size * np.cos(phase) + 1j * size * np.sin(phase))

    def _count(self, key: str) -> int | None:
        if self.values.get(key) is None:
            return None
        number = self._scalar(key)
        if number != int(number) or not 0 <= number <= MOST_STATES:
            self.fail(f"{key} = {number:g}; a whole number from 0 to {MOST_STATES} is wanted")
        return int(number)
