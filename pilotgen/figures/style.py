"""How every figure looks, and how values without a finite place (no crossing) are drawn.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import functools
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np

from pilotgen.files import write_bytes
from pilotgen.objectives import OBJECTIVES, objective
from pilotgen.study.schema import study_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

PAGE_WIDTH_IN = 9.0  # inch; a figure is as wide as a page of the report
DPI = 150

# Okabe and Ito's palette: distinguishable with every common colour blindness, and in grey
BLACK, ORANGE, SKY, GREEN = "#000000", "#e69f00", "#56b4e9", "#009e73"
BLUE, VERMILLION, PURPLE, GREY = "#0072b2", "#d55e00", "#cc79a7", "#8a8a8a"
LINE_COLORS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY)
LIGHT_GREY = "#c8c8c8"

_STYLE: Any = {  # matplotlib's type of these names is a literal of all of them
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "legend.framealpha": 0.9,
    "legend.edgecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#404040",
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.5,
    "xtick.color": "#404040",
    "ytick.color": "#404040",
    "xtick.labelcolor": "#000000",
    "ytick.labelcolor": "#000000",
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


@dataclass(frozen=True)
class Quantity:
    """What a variable or margin is called, and its unit (empty for none)."""

    name: str
    unit: str

    @property
    def axis(self) -> str:
        """Label of an axis: `gain margin [dB]`."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def text(self, value: float) -> str:
        """`stature 1.775 m`."""
        return f"{self.name} {value:.4g}" + (f" {self.unit}" if self.unit else "")


QUANTITIES: dict[str, Quantity] = {
    "age_years": Quantity("age", "years"),
    "stature_m": Quantity("stature", "m"),
    "mass_kg": Quantity("body mass", "kg"),
    "bmi": Quantity("body mass index", "kg/m²"),
    "pilot_frequency_hz": Quantity("natural frequency", "Hz"),
    "pilot_damping": Quantity("damping ratio", ""),
    "pilot_time_constant_s": Quantity("time constant", "s"),
    **{row.key: Quantity(row.label, row.unit) for row in OBJECTIVES.values()},
}


def quantity(name: str) -> Quantity:
    """The quantity of a study's name; a name without an entry stands for itself, with the unit that studies give it."""
    if name.startswith("quantile "):
        row = objective(name)
        return Quantity(row.label, row.unit)
    return QUANTITIES[name] if name in QUANTITIES else Quantity(name, study_unit(name).replace("^2", "²"))


def typeset(text: str) -> str:
    """A number with its unit as print has it: a true minus sign, and the sign for degrees."""
    return text.replace("-", "−").replace(" deg", "°")


P = ParamSpec("P")
T = TypeVar("T")


def styled(function: Callable[P, T]) -> Callable[P, T]:
    """Draw inside the project's style; matplotlib's own settings are as before afterwards."""

    @functools.wraps(function)
    def draw(*args: P.args, **kwargs: P.kwargs) -> T:
        import matplotlib

        with matplotlib.rc_context(_STYLE):
            return function(*args, **kwargs)

    return draw


def new_figure(height_in: float, width_in: float = PAGE_WIDTH_IN) -> Figure:
    """An empty figure of the project's width [inch]; no window, no global state."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), dpi=DPI, layout="constrained")


@styled
def png(figure: Figure) -> bytes:
    """The figure as PNG; the same figure gives the same bytes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    buffer = io.BytesIO()
    canvas: Any = FigureCanvasAgg(figure)  # untyped; it draws once where Figure.savefig draws twice
    canvas.print_png(buffer, metadata={"Software": None})
    return buffer.getvalue()


def save(figure: Figure, path: Path) -> None:
    """Write the figure as PNG, whole or not at all; FileError if that fails."""
    write_bytes(path, png(figure))


def danger_colors() -> Colormap:
    """Colours for margins: the smaller the darker; without viridis's palest end, which is lost on white."""
    import matplotlib
    from matplotlib.colors import ListedColormap

    return ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0.0, 0.93, 256)), name="danger")


# ---- margins that may be infinite


@dataclass(frozen=True)
class MarginScale:
    """Where margins go on an axis: finite ones as they are, infinite ones on a strip outside the finite range.

    Attributes
    ----------
    low, high : float
        Range of the finite margins, with a little air.
    above, below : float or None
        Place of the strip of +infinity (no crossing) and of -infinity (unstable, no crossing); None if there is none.
    """

    low: float
    high: float
    above: float | None
    below: float | None
    empty: bool = False  # no finite margin at all: the range between the strips has no numbers

    @classmethod
    def of(cls, *arrays: Any) -> MarginScale:
        """The scale that shows all these margins; NaNs (failed pilots) do not count."""
        values = np.concatenate([np.ravel(np.asarray(array, dtype=float)) for array in arrays])
        finite = values[np.isfinite(values)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
        air = 0.06 * (high - low) or 0.1 * max(abs(high), 1.0)
        low, high = low - air, high + air
        strip = 0.07 * (high - low)
        return cls(
            low,
            high,
            high + strip if bool(np.any(values == np.inf)) else None,
            low - strip if bool(np.any(values == -np.inf)) else None,
            not finite.size,
        )

    def place(self, values: Any) -> np.ndarray:
        """Values as drawn: infinities on their strips, NaN stays NaN."""
        placed = np.array(values, dtype=float)
        if self.above is not None:
            placed[placed == np.inf] = self.above
        if self.below is not None:
            placed[placed == -np.inf] = self.below
        return np.where(np.isfinite(placed), placed, np.nan)

    def broken(self, x: Any, values: Any) -> tuple[np.ndarray, np.ndarray]:
        """x and placed values of a line that does not climb from a finite margin to the strip: it breaks there."""
        raw = np.asarray(values, dtype=float)
        jumps = np.flatnonzero(np.isfinite(raw[1:]) != np.isfinite(raw[:-1])) + 1
        return np.insert(np.asarray(x, dtype=float), jumps, np.nan), np.insert(self.place(raw), jumps, np.nan)

    @property
    def limits(self) -> tuple[float, float]:
        """Limits of the axis, strips included."""
        strip = 0.07 * (self.high - self.low)
        low = self.low if self.below is None else self.below - strip
        return low, self.high if self.above is None else self.above + strip

    def apply(self, axes: Axes, which: str = "y") -> None:
        """Set limits, shade and name the strips of the x or y axis."""
        axis = axes.yaxis if which == "y" else axes.xaxis
        span = axes.axhspan if which == "y" else axes.axvspan
        low, high = self.limits
        (axes.set_ylim if which == "y" else axes.set_xlim)(low, high)
        ticks = [
            tick for tick in axis.get_major_locator().tick_values(self.low, self.high) if self.low <= tick <= self.high
        ]
        ticks = [] if self.empty else ticks
        labels = [f"{tick:g}".replace("-", "−") for tick in ticks]
        for place, edge, text in ((self.above, self.high, "none"), (self.below, self.low, "−∞")):
            if place is not None:
                span(*sorted((edge, high if place > edge else low)), color="#f3f3f3", zorder=0)
                ticks.append(place)
                labels.append(text)
        axis.set_ticks(ticks, labels)

    def mark(self, axes: Axes, wanted: float | None, which: str = "y") -> bool:
        """A dashed line at the margin one wants to have, and a solid one at zero, the limit of stability.

        Returns whether the dashed line was drawn: there is such a margin, and it lies in the finite range.
        """
        line = axes.axhline if which == "y" else axes.axvline
        if self.empty:
            return False
        if self.low < 0.0 < self.high:
            line(0.0, color=BLACK, linewidth=0.9, zorder=1)
        if wanted is None or not self.low < wanted < self.high:
            return False
        line(wanted, color=GREEN, linestyle=(0, (5, 3)), linewidth=1.0, zorder=1)
        return True


def frequency_axis(axes: Axes, low_hz: float, high_hz: float, label: bool = True) -> None:
    """A logarithmic frequency axis with plain numbers."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullFormatter, NullLocator

    axes.set_xscale("log")
    axes.set_xlim(low_hz, high_hz)
    steps = [base * 10.0**power for power in range(-3, 4) for base in (1.0, 2.0, 5.0)]
    axes.xaxis.set_major_locator(FixedLocator([step for step in steps if low_hz <= step <= high_hz]))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_minor_formatter(NullFormatter())
    if label:
        axes.set_xlabel("frequency [Hz]")


def variable_limits(axes: Axes, which: str, low: float, high: float) -> None:
    """Limits of a searched variable: its box with a little air, so that markers at a bound are seen."""
    air = 0.05 * (high - low)
    (axes.set_xlim if which == "x" else axes.set_ylim)(low - air, high + air)


def pairs(count: int) -> Sequence[tuple[int, int]]:
    """Every pair of `count` columns, as (horizontal, vertical)."""
    return [(i, j) for i in range(count) for j in range(i + 1, count)]
