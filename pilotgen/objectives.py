"""What a search can minimise: one table, over which search, results, figures and report loop.

To add an objective, add a row to `OBJECTIVES`: it can be named in a study's `search.objectives`, is written to study.h5
and stands in progress line, tables, figures and report. A test compares the table with docs/io_formats/study.md.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any


@dataclass(frozen=True)
class Objective:
    """One number of a pilot's result, and which way is worse.

    Attributes
    ----------
    key : str
        Name in study files, study.h5 and result.json.
    label, short : str
        In words, and on the progress line.
    unit : str
        Empty for none.
    meaning : str
        One line for the documentation of the study file.
    section : str
        Where in a result object `key` stands.
    at : str
        Key in the same section of the frequency [Hz] at which it is found; empty for none.
    worse : str
        "smaller" or "larger": what the search looks for.
    cap : float
        Limit of its magnitude where pilots are ranked, so that an infinite value can be compared.
    signed : bool
        Its own sign tells whether the closed loop is stable; one that has no sign is negated for unstable loops.
    digits : int
        Decimals of a table.
    no_crossing : str
        Which crossing is missing when it is infinite; empty if it never is.
    limit : float or None
        What a robust loop keeps, by the rule of thumb of the reference paper's section 3.
    """

    key: str
    label: str
    short: str
    unit: str
    meaning: str
    section: str = "loop"
    at: str = ""
    worse: str = "smaller"
    cap: float = math.inf
    signed: bool = True
    digits: int = 2
    no_crossing: str = ""
    limit: float | None = None

    @property
    def heading(self) -> str:
        """`gain margin [dB]`."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    def of(self, result: Mapping[str, Any]) -> float:
        """Its value in a result object that is ok; infinite, with the sign of stability, where there is no crossing."""
        value = result[self.section].get(self.key)
        if value is not None:
            return float(value)
        if not self.no_crossing:
            return math.nan
        return math.inf if result["loop"]["stable"] else -math.inf

    def ranked(self, result: Mapping[str, Any]) -> float:
        """The value that a search minimises: the smaller, the worse the pilot; limited to the cap, finite."""
        value = self.finite(result)
        return value if self.worse == "smaller" else -value

    def finite(self, result: Mapping[str, Any]) -> float:
        """Its value, negative if the closed loop is unstable, limited to the cap."""
        value = self.of(result)
        if not self.signed and not result["loop"]["stable"]:
            value = -value  # a distance has no sign of its own; the farther inside the unstable region, the worse
        return self.capped(value)

    def capped(self, value: float) -> float:
        """`value` limited to the cap."""
        return min(max(value, -self.cap), self.cap)

    def text(self, value: float | None, at_hz: float | None = None) -> str:
        """`6.42 dB at 3.78 Hz`, or `none (no crossing of the unit circle)`; None and infinities are no crossing."""
        if value is None or not math.isfinite(value):
            return f"none (no {self.no_crossing})" if self.no_crossing else "none"
        at = f" at {at_hz:.2f} Hz" if at_hz is not None and math.isfinite(at_hz) else ""
        return f"{value:.{self.digits}f} {self.unit}".rstrip() + at

    def brief(self, value: float) -> str:
        """For a progress line: `GM 1.82 dB`, or `PM none` for a value at its cap."""
        return f"{self.short} none" if value >= self.cap else f"{self.short} {value:.3g} {self.unit}".rstrip()


OBJECTIVES: Mapping[str, Objective] = {
    row.key: row
    for row in (
        Objective(
            "gain_margin_db",
            "gain margin",
            "GM",
            "dB",
            "gain margin [dB], negative if the closed loop is unstable, capped at 60 dB",
            at="gain_margin_hz",
            cap=60.0,
            no_crossing="crossing of the negative real axis",
            limit=6.0,
        ),
        Objective(
            "phase_margin_deg",
            "phase margin",
            "PM",
            "deg",
            "phase margin [deg], negative if the closed loop is unstable, capped at 180 deg",
            at="phase_margin_hz",
            cap=180.0,
            digits=1,
            no_crossing="crossing of the unit circle",
            limit=60.0,
        ),
        Objective(
            "modulus_margin",
            "modulus margin",
            "MM",
            "",
            "smallest distance of the loop from the critical point, min |1 + L| [-], ranked as negative if unstable",
            at="modulus_margin_hz",
            signed=False,
            digits=3,
        ),
    )
}
DEFAULT_OBJECTIVES = ("gain_margin_db", "phase_margin_deg")  # the reference paper's

GAIN_MARGIN, PHASE_MARGIN, MODULUS_MARGIN = (
    OBJECTIVES[key] for key in ("gain_margin_db", "phase_margin_deg", "modulus_margin")
)
MARGINS = (GAIN_MARGIN, PHASE_MARGIN)  # the two that every report tells, whatever was minimised


class CrossingGain(Objective):
    """What the loop's gain is at the crossing of the negative real axis that sets the gain margin, of the critical one.

    10^(-gain margin / 20 dB): 1 is critical, more is unstable, and 0 is no crossing, which is where it goes when a
    crossing leaves to where the loop has no gain. Every pilot has one, and it is smooth where the margin is infinite.
    """

    def of(self, result: Mapping[str, Any]) -> float:
        """Its value in a result object that is ok; an unstable loop without a crossing has the cap."""
        margin = GAIN_MARGIN.of(result)
        if math.isinf(margin):
            return 0.0 if margin > 0.0 else self.cap
        return self.capped(10.0 ** (-GAIN_MARGIN.capped(margin) / 20.0))


FOR_SENSITIVITY: Mapping[str, Objective] = {  # objectives of `sensitivity.objectives` beside those of a search
    row.key: row
    for row in (
        CrossingGain(
            "gain_at_180",
            "gain at -180 deg",
            "G180",
            "",
            "gain of the loop at the crossing that sets the gain margin: 1 is critical, 0 no crossing, capped at 1000",
            worse="larger",
            cap=1000.0,
            digits=3,
        ),
    )
}

ROBUST = "robust"  # key of a result object: margins of the pilot's draws, by objective


@dataclass(frozen=True, kw_only=True)
class Quantile(Objective):
    """A quantile of an objective over the draws of what is not known of a pilot (docs/theory/uncertainty.md).

    Attributes
    ----------
    base : str
        Key of the objective.
    share : float
        0 to 1: so many of the draws are below.
    """

    base: str
    share: float

    def of(self, result: Mapping[str, Any]) -> float:
        """Its value in a result object with draws, infinite without a crossing; NaN without draws."""
        drawn = result.get(ROBUST, {}).get("margins", {}).get(self.base, ())
        values = sorted(value for value in drawn if value is not None)
        if not values:
            return math.nan
        value = float(values[place_of_quantile(self.share, len(values))])
        return math.copysign(math.inf, value) if abs(value) >= self.cap else value


def place_of_quantile(share: float, count: int) -> int:
    """Which of `count` values in rising order is their quantile: one of them, never between two."""
    return max(0, math.ceil(share * count - 1e-9) - 1)


_QUANTILE = re.compile(r"quantile\s+([0-9.]+)\s*(%?)\s+of\s+(\S+)")


@cache
def quantile(text: str) -> Quantile:
    """The objective that `quantile 5 % of gain_margin_db` names.

    Raises
    ------
    ValueError
        It names none; the message says what is wanted.
    """
    found = _QUANTILE.fullmatch(text.strip())
    wanted = f"write e.g. quantile 5 % of {next(iter(OBJECTIVES))}"
    if found is None or not found[2]:
        raise ValueError(f"is no quantile of an objective; {wanted}")
    try:
        percent = float(found[1])
    except ValueError:
        raise ValueError(f"is no quantile of an objective; {wanted}") from None
    if not 0.0 < percent < 100.0:
        raise ValueError("is no quantile: more than 0 % and less than 100 % is wanted")
    row = OBJECTIVES.get(found[3])
    if row is None:
        raise ValueError(f"names no objective; {wanted}; objectives: {', '.join(OBJECTIVES)}")
    return Quantile(
        f"quantile {percent:g} % of {row.key}", f"{percent:g} % quantile of the {row.label}",
        f"{row.short} {percent:g} %", row.unit, row.meaning, section=row.section, worse=row.worse, cap=row.cap,
        digits=row.digits, no_crossing=row.no_crossing, base=row.key, share=percent / 100.0,
    )  # fmt: skip


def objective(key: str) -> Objective:
    """The objective of this key, which may be a quantile. ValueError if there is none."""
    return OBJECTIVES.get(key) or FOR_SENSITIVITY.get(key) or quantile(key)


def quantiles(objectives: Iterable[str]) -> tuple[Quantile, ...]:
    """Those of these objectives that are quantiles over draws."""
    return tuple(quantile(key) for key in objectives if key not in OBJECTIVES)


def ranked_objectives(result: Mapping[str, Any], objectives: Sequence[str]) -> list[float]:
    """The objectives of one pilot as they are ranked, all minimised.

    Parameters
    ----------
    result : mapping
        Result object of a pilot who could be evaluated.
    objectives : sequence of str
        Their keys.

    Returns
    -------
    list of float
        Each limited to its cap, negative if the closed loop is unstable; a missing crossing counts as the cap.
    """
    return [objective(key).ranked(result) for key in objectives]


def below_limits(result: Mapping[str, Any], limits: Mapping[str, float | None]) -> list[str]:
    """What a pilot's loop lacks: instability, and every margin below its limit, as sentences; empty if nothing."""
    lacks = [] if result["loop"]["stable"] else ["the closed loop is unstable"]
    for key, limit in limits.items():
        row = OBJECTIVES[key]
        if limit is not None and row.of(result) < limit:
            lacks.append(f"{row.label} {row.text(row.of(result))} is below {row.text(limit)}")
    return lacks


def margins_text(result: Mapping[str, Any], objectives: Iterable[Objective] = MARGINS) -> str:
    """`gain margin 6.42 dB at 3.78 Hz, phase margin none (no crossing of the unit circle)` of a result that is ok."""
    return ", ".join(f"{row.label} {row.text(row.of(result), result[row.section].get(row.at))}" for row in objectives)
