"""Shares of people, and how sure a sample is of them.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from dataclasses import dataclass

Z_95 = 1.959963984540054  # of a normal deviate: 95 % are within +- this


@dataclass(frozen=True)
class Share:
    """`count` of `of` people, with the 95 % interval of Wilson (1927), J. Am. Stat. Assoc. 22."""

    count: int
    of: int

    @property
    def share(self) -> float:
        """The share of the sample, 0 to 1; NaN of nobody."""
        return self.count / self.of if self.of else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper end; 0 to 1 of nobody."""
        if not self.of:
            return 0.0, 1.0
        n, p, z2 = self.of, self.count / self.of, Z_95**2
        centre = (p + z2 / (2 * n)) / (1 + z2 / n)
        half = Z_95 / (1 + z2 / n) * math.sqrt(p * (1 - p) / n + z2 / (4 * n * n))
        low = 0.0 if self.count == 0 else max(0.0, centre - half)  # exact ends: no -1e-19 of round-off
        return low, 1.0 if self.count == self.of else min(1.0, centre + half)

    @property
    def width(self) -> float:
        """Upper minus lower end of the interval."""
        low, high = self.interval
        return high - low

    def text(self) -> str:
        """`3.1 % (2.6-3.7 %)`."""
        low, high = self.interval
        digits = 1 if self.of < 20_000 else 2
        return f"{100 * self.share:.{digits}f} % ({100 * low:.{digits}f}-{100 * high:.{digits}f} %)"

    def as_dict(self) -> dict[str, float | int | None]:
        """For JSON: count, of, share and the interval's ends."""
        low, high = self.interval
        return {"count": self.count, "of": self.of, "share": self.share if self.of else None, "low": low, "high": high}
