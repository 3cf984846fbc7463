"""Frequency responses of rotorcraft: CSV files written by others, and what lies between their points.

Such files are treated as hostile: every unit is said by a column's name or a line of the header, and what is missing,
twice there, out of range or no number is refused with its line (docs/io_formats/frequency_response.md).

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from pilotgen.errors import FileError, PilotgenError
from pilotgen.files import refuse_special
from pilotgen.linear.statespace import ComplexArray, FloatArray
from pilotgen.loop.units import COLLECTIVE, HEAVE, stated_gain
from pilotgen.study.wording import did_you_mean

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

MOST_BYTES = 400_000_000
MOST_ROWS = 3_000_000
LEAST_ROWS = 8
_FREQUENCIES = {"frequency_hz": 2.0 * math.pi, "omega_rad_s": 1.0}
_VALUES = (("real", "imag"), ("magnitude", "phase_deg"), ("magnitude", "phase_rad"), ("magnitude_db", "phase_deg"),
           ("magnitude_db", "phase_rad"))  # fmt: skip
_COLUMNS = (*_FREQUENCIES, "real", "imag", "magnitude", "magnitude_db", "phase_deg", "phase_rad", "coherence")


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Blade pitch [rad] -> acceleration of the seat [m/s^2 or rad/s^2] at rising frequencies, between them by splines.

    Signs are this program's (`units.py`): more collective and up positive, or right and right.

    Attributes
    ----------
    omega : ndarray, shape (m,)
        [rad/s].
    H : ndarray of complex, shape (m,)
        The response there.
    unstable_poles, poles_at_origin : int
        Of the plant, as its file states.
    path : str
        For messages.
    """

    omega: FloatArray
    H: ComplexArray
    unstable_poles: int
    poles_at_origin: int
    path: str

    @cached_property
    def interpolation_error(self) -> float:
        """How far off a value between the points may be, relative to the largest one.

        The difference between the interpolant through all points and that through every other one, at the points left
        out, over 16: a spline's error falls with the fourth power of the distance.
        """
        if len(self.omega) < 2 * LEAST_ROWS:
            return math.inf
        return float(self._left_out_errors.max()) / 16.0 / float(np.abs(self.H).max())

    @cached_property
    def _spline(self) -> CubicSpline:
        from scipy.interpolate import CubicSpline

        return CubicSpline(np.log(self.omega), np.column_stack((self.H.real, self.H.imag)))

    def thinned(self, most: int) -> FrequencyResponse:
        """The same at no more than `most` frequencies, evenly spaced on a logarithmic axis, by the spline."""
        if len(self.omega) <= most:
            return self
        omega = np.geomspace(self.omega[0], self.omega[-1], most)
        omega[-1] = self.omega[-1]
        return FrequencyResponse(omega, self.at(omega), self.unstable_poles, self.poles_at_origin, self.path)

    @property
    def pieces(self) -> tuple[FloatArray, FloatArray]:
        """The splines themselves: ends in ln omega, shape (m,), and coefficients, highest power first.

        Coefficients have shape (4, m - 1, 2), real and imaginary part last; powers of the distance from the left end.
        """
        return np.asarray(self._spline.x), np.asarray(self._spline.c)

    @cached_property
    def _left_out_errors(self) -> FloatArray:
        """At every second point, how far the spline through the others is off."""
        coarse = FrequencyResponse(self.omega[::2], self.H[::2], 0, 0, self.path)
        left_out = self.omega[1:-1:2]
        inside = left_out < coarse.omega[-1]
        difference: FloatArray = np.abs(coarse.at(left_out[inside]) - self.H[1:-1:2][inside])
        return difference

    def error_at(self, omega: npt.ArrayLike) -> FloatArray:
        """How far off `at` may be at frequencies in the band: like `interpolation_error`, but of the points around.

        The largest of the three points left out nearest to each frequency, over 8 rather than 16: for a smooth response
        twice what the spline is off. An estimate, no bound for a mode that stands between two points.
        """
        w = np.asarray(omega, dtype=float)
        if len(self.omega) < 2 * LEAST_ROWS:
            return np.full(w.shape, math.inf)
        errors = self._left_out_errors
        padded = np.concatenate((errors[:1], errors, errors[-1:]))
        around = np.maximum(np.maximum(padded[:-2], padded[1:-1]), padded[2:])
        place = np.searchsorted(self.omega[2:-1:2], w)  # the intervals between the points that are not left out
        return np.asarray(around[np.minimum(place, len(around) - 1)] / 8.0)

    def at(self, omega: npt.ArrayLike) -> ComplexArray:
        """The response by cubic splines of real and imaginary part in ln omega.

        Raises
        ------
        PilotgenError
            A frequency is outside the band of the data.
        """
        w = np.asarray(omega, dtype=float)
        low, high = self.omega[0], self.omega[-1]
        outside = (w < low * (1.0 - 1e-12)) | (w > high * (1.0 + 1e-12))
        if outside.any():
            hz = float(w[outside].ravel()[0]) / (2.0 * math.pi)
            raise PilotgenError(
                f"{self.path}: {hz:.4g} Hz is outside the data, {low / (2.0 * math.pi):.4g} to "
                f"{high / (2.0 * math.pi):.4g} Hz; nothing is assumed there"
            )
        parts = self._spline(np.log(w))
        value: ComplexArray = parts[..., 0] + 1j * parts[..., 1]
        return value

    @property
    def band_hz(self) -> tuple[float, float]:
        """First and last frequency [Hz]."""
        return float(self.omega[0]) / (2.0 * math.pi), float(self.omega[-1]) / (2.0 * math.pi)


# ---- reading


def read_frequency_response(path: Path, motion: str = HEAVE, control: str = COLLECTIVE) -> FrequencyResponse:
    """Read a CSV file of a measured rotorcraft: acceleration of the seat in `motion` by the blade pitch of `control`.

    A file that did not change is not read again.

    Raises
    ------
    FileError
        The file cannot be read, or a unit, sign, column or number is missing or wrong; lines are told.
    """
    try:
        if path.stat().st_size > MOST_BYTES:
            raise FileError(
                f"{path}: more than {MOST_BYTES // 1_000_000} MB; a frequency response of that size is not read"
            )
        stat = path.stat()
        return _read(path, motion, control, (stat.st_mtime_ns, stat.st_size, stat.st_ino))
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror or error})") from None


@lru_cache(maxsize=4)
def _read(path: Path, motion: str, control: str, _unchanged: tuple[int, ...]) -> FrequencyResponse:
    refuse_special(path)
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(f"{path}: not UTF-8 text (byte {error.start}); save it as CSV in UTF-8") from None
    said: dict[str, str] = {}
    header: list[str] | None = None
    separator, first, rows = ",", 0, []
    for number, line in enumerate(text.splitlines(), start=1):
        stripped = line.strip()
        if not stripped:
            continue
        if stripped.startswith("#"):
            key, colon, value = stripped.lstrip("# ").partition(":")
            if colon:
                said.setdefault(key.strip().lower(), value.strip())
            continue
        if header is None:
            separator = ";" if ";" in stripped else "\t" if "\t" in stripped else ","
            header = [name.strip().strip('"').lower() for name in stripped.split(separator)]
            _check_header(path, number, header)
            first = number
            continue
        rows.append((number, stripped))
        if len(rows) > MOST_ROWS:
            raise FileError(f"{path}: more than {MOST_ROWS} rows; thin the data")
    if header is None:
        raise FileError(f"{path}: no line with column names; wanted are {', '.join(_FREQUENCIES)} and values, by name")
    if len(rows) < LEAST_ROWS:
        raise FileError(f"{path}:{first}: {len(rows)} rows follow; {LEAST_ROWS} or more are wanted")
    table = _table(path, header, separator, rows)
    gain = stated_gain(said, motion, control, str(path), "write a line '# {key}: ...' with")
    counts = [_count(path, said, key) for key in ("unstable_poles", "poles_at_origin")]
    key = next(name for name in _FREQUENCIES if name in table)
    omega = table[key] * _FREQUENCIES[key]
    order = np.argsort(omega, kind="stable")
    lines = np.array([number for number, _ in rows])[order]
    omega, H = omega[order], (gain * _response(path, table))[order]
    if omega[0] <= 0.0:
        raise FileError(f"{path}:{lines[0]}: frequency {table[key][order][0]:g}; frequencies start above zero")
    twice = np.flatnonzero(np.diff(omega) <= 0.0)
    if len(twice):
        i = int(twice[0])
        raise FileError(
            f"{path}:{lines[i + 1]}: the frequency of line {lines[i]} once more; average or remove one of the two"
        )
    return FrequencyResponse(omega, H, counts[0], counts[1], str(path))


def _check_header(path: Path, number: int, header: Sequence[str]) -> None:
    where = f"{path}:{number}"
    if any(re.fullmatch(r"[-+]?[0-9.]+([eE][-+]?[0-9]+)?", name) for name in header):
        raise FileError(f"{where}: numbers where column names are wanted, such as frequency_hz,magnitude_db,phase_deg")
    unknown = [name for name in header if name not in _COLUMNS]
    if unknown:
        near = did_you_mean(unknown[0][:40], list(_COLUMNS))
        raise FileError(f"{where}: column {unknown[0][:40]!r} is not known; {near}known: {', '.join(_COLUMNS)}")
    if len(set(header)) != len(header):
        raise FileError(f"{where}: a column stands twice")
    if sum(name in header for name in _FREQUENCIES) != 1:
        raise FileError(f"{where}: exactly one of {', '.join(_FREQUENCIES)} is wanted; the unit is in the name")
    values = [name for name in header if name not in _FREQUENCIES and name != "coherence"]
    if not any(set(pair) == set(values) for pair in _VALUES):
        pairs = " or ".join(f"{a} and {b}" for a, b in _VALUES)
        raise FileError(f"{where}: values are {', '.join(values) or 'missing'}; wanted are {pairs}")


def _table(path: Path, header: Sequence[str], separator: str, rows: Sequence[tuple[int, str]]) -> dict[str, FloatArray]:
    try:
        values = np.loadtxt([line for _, line in rows], delimiter=separator, ndmin=2, comments=None)
        if values.shape[1] != len(header):
            raise ValueError
    except ValueError:
        for number, line in rows:
            cells = line.split(separator)
            if len(cells) != len(header):
                hint = "; decimal commas? write 1.5, not 1,5" if separator == "," and len(cells) > len(header) else ""
                raise FileError(
                    f"{path}:{number}: {len(cells)} values where {len(header)} columns are named{hint}"
                ) from None
            for name, cell in zip(header, cells, strict=True):
                try:
                    float(cell)
                except ValueError:
                    comma = re.fullmatch(r"\s*[-+]?[0-9]*,[0-9]+([eE][-+]?[0-9]+)?\s*", cell)
                    hint = "; the decimal point is a point" if comma else ""
                    raise FileError(f"{path}:{number}: {name} = {cell.strip()[:40]!r} is no number{hint}") from None
        raise
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        row, column = bad[0]
        raise FileError(
            f"{path}:{rows[row][0]}: {header[column]} = {values[row, column]} is not finite; remove the row"
        )
    return {name: values[:, k] for k, name in enumerate(header)}


def _response(path: Path, table: Mapping[str, FloatArray]) -> ComplexArray:
    if "real" in table:
        return np.asarray(table["real"] + 1j * table["imag"], dtype=np.complex128)
    if "magnitude" in table:
        size = table["magnitude"]
        if (size < 0.0).any():
            raise FileError(f"{path}: magnitude holds a negative number; decibels are called magnitude_db")
    else:
        size = 10.0 ** (np.clip(table["magnitude_db"], -6000.0, 6000.0) / 20.0)
    phase = np.radians(table["phase_deg"]) if "phase_deg" in table else table["phase_rad"]
    if "phase_rad" in table and np.abs(phase).max() > 200.0:
        raise FileError(f"{path}: phase_rad reaches {np.abs(phase).max():.4g} rad; degrees are called phase_deg")
    value: ComplexArray = np.asarray(size * np.exp(1j * phase), dtype=np.complex128)
    return value


def _count(path: Path, said: Mapping[str, str], key: str) -> int:
    value = said.get(key)
    if value is None or not value.isdecimal() or len(value) > 3:
        came = "is missing" if value is None else f"= {value[:40]!r} is no whole number"
        raise FileError(f"{path}: {key} {came}; write a line '# {key}: 0', without which stability cannot be told")
    return int(value)
