"""What may be changed against bounce: each cure has one number, its amount, and says what that does to a study.

Labels, ranges, costs and sources stand in `pilotgen/data/cures.yaml`; an entry there has a function of the same name
here.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass
from typing import Any

from pilotgen.cures.friction import GripSwing, as_built, like, more_friction
from pilotgen.errors import StudyError
from pilotgen.study.fields import MAYO
from pilotgen.study.study import Study
from pilotgen.study.torso_numbers import RIGID
from pilotgen.study.wording import did_you_mean
from pilotgen.study.yaml_file import bundled

WEIGHT_ARM_M = 0.15  # of a balance weight behind the hinge
NOTCH_DAMPING, LOW_PASS_DAMPING = 0.6, 0.7  # of the filters' poles
COMPUTING_S = 0.015  # delay that a digital filter brings along; estimated
HAND_SPEED_M_PER_S = 0.2  # brisk collective input, half the travel in half a second; for telling control forces


@dataclass(frozen=True)
class Cure:
    """One thing that may be changed.

    Attributes
    ----------
    key, label, unit, source : str
        Name on the command line, in words, unit of the amount, where the range is from.
    low, high : float
        How far one can go; 0 is the study as it is.
    cost : float
        Of going all the way, beside the others; estimated.
    remedy : bool
        False: an influence that is looked at and never proposed.
    by_name : bool
        True: proposed only if it is asked for by name. What it does depends on the size of the swing.
    below : tuple of str, optional
        Label and unit of an amount below zero, told without its sign.
    """

    key: str
    label: str
    unit: str
    low: float
    high: float
    cost: float
    remedy: bool
    source: str
    by_name: bool = False
    below: tuple[str, str] | None = None

    def told(self, amount: float) -> str:
        """`viscous damper on the lever, 20 N s/m at the grip`."""
        size = float(f"{abs(amount):.3g}")
        if amount < 0.0 and self.below is not None:
            return f"{self.below[0]}, {size:g} {self.below[1]}"
        return f"{self.label}, {math.copysign(size, amount):g} {self.unit}"


class Changed:
    """A study with values of one pilot, on top of which cures put theirs, one after the other.

    Attributes
    ----------
    study : Study
        The study as it is.
    values : dict
        Path -> value that differs from the study.
    critical_hz : float
        Frequency at which the worst pilot's loop crosses the negative real axis: where a notch belongs.
    swing : GripSwing or None
        In which friction is what it is like to a loop; None: friction as the study's own numbers.
    """

    def __init__(self, study: Study, critical_hz: float, swing: GripSwing | None = None) -> None:
        self.study = study
        self.critical_hz = critical_hz
        self.swing = swing
        self.values: dict[str, Any] = {}
        self.computed = False  # whether the delay of a filter's computer is in

    def number(self, path: str) -> float:
        """What a path holds now."""
        found = self.values[path] if path in self.values else self.study.value(path)
        return 0.0 if found is None else float(found)

    def add(self, path: str, more: float) -> None:
        """Add to a number."""
        self.values[path] = self.number(path) + more

    def at_grip(self, amount: float) -> float:
        """Of a spring or damper at the grip, what it is about the hinge: times the lever's length squared."""
        return amount * self.number("inceptor.lever_length_m") ** 2


def _damper(to: Changed, x: float) -> None:
    to.add("cockpit.collective.damping_n_m_s_per_rad", to.at_grip(x))


def _inertia(to: Changed, x: float) -> None:
    to.add("cockpit.collective.inertia_kg_m2", x)


def _balance_weight(to: Changed, x: float) -> None:
    to.add("cockpit.collective.mass_kg", x)
    to.add("cockpit.collective.inertia_kg_m2", x * WEIGHT_ARM_M**2)
    to.add("cockpit.collective.unbalance_kg_m", -x * WEIGHT_ARM_M)


def _trim_spring(to: Changed, x: float) -> None:
    to.add("cockpit.collective.stiffness_n_m_per_rad", to.at_grip(x))


def _friction(to: Changed, x: float) -> None:
    if to.swing is None:
        to.values.update(as_built(to.study, x))
        return
    damper, spring = like(more_friction(to.study, x), to.swing)
    _damper(to, damper)
    if spring > 1e-9 * damper * to.swing.frequency_hz:  # bristles; the rounding of a sum over samples is none
        _trim_spring(to, spring)


def _gearing(to: Changed, x: float) -> None:
    to.add("inceptor.gearing_rad_per_m", -0.01 * x * to.number("inceptor.gearing_rad_per_m"))


def _lever_length(to: Changed, x: float) -> None:
    to.add("inceptor.lever_length_m", x)


def _lever_angle(to: Changed, x: float) -> None:
    to.add("cockpit.collective.lowest_angle_deg", x)
    to.add("cockpit.collective.highest_angle_deg", x)


def _grip_forward(to: Changed, x: float) -> None:
    to.add("cockpit.collective.grip_m[0]", x)


def _grip_up(to: Changed, x: float) -> None:
    to.add("cockpit.collective.grip_m[1]", x)


def _cushion(to: Changed, x: float) -> None:
    to.add("cockpit.seat.cushion.stiffness_n_per_m", 1e3 * x)


def _cushion_damping(to: Changed, x: float) -> None:
    to.add("cockpit.seat.cushion.damping_n_s_per_m", x)


def _seat_back(to: Changed, x: float) -> None:
    to.add("cockpit.seat.back.tangential_n_per_m", 1e3 * x)


def _notch(to: Changed, x: float) -> None:
    if x > 0.0:
        to.values["rotorcraft.notch.frequency_hz"] = to.critical_hz
        to.values["rotorcraft.notch.pole_damping"] = NOTCH_DAMPING
        to.values["rotorcraft.notch.zero_damping"] = NOTCH_DAMPING * 10.0 ** (-x / 20.0)
        _compute(to)


def _low_pass(to: Changed, x: float) -> None:
    if x > 0.0:
        to.values["rotorcraft.low_pass.frequency_hz"] = min(50.0, 1e3 / (2.0 * math.pi * x))
        to.values["rotorcraft.low_pass.damping"] = LOW_PASS_DAMPING
        _compute(to)


def _compute(to: Changed) -> None:
    """One computer for all filters."""
    if not to.computed:
        to.add("rotorcraft.delay_s", COMPUTING_S)
        to.computed = True


def _delay(to: Changed, x: float) -> None:
    to.add("rotorcraft.delay_s", 1e-3 * x)


def _actuator(to: Changed, x: float) -> None:
    if x > 0.0:
        to.values["rotorcraft.actuator.corner_rad_s"] = 1e3 / x


_EFFECTS: Mapping[str, Callable[[Changed, float], None]] = {
    "damper": _damper,
    "inertia": _inertia,
    "balance_weight": _balance_weight,
    "trim_spring": _trim_spring,
    "friction": _friction,
    "gearing": _gearing,
    "lever_length": _lever_length,
    "lever_angle": _lever_angle,
    "grip_forward": _grip_forward,
    "grip_up": _grip_up,
    "cushion": _cushion,
    "cushion_damping": _cushion_damping,
    "seat_back": _seat_back,
    "notch": _notch,
    "low_pass": _low_pass,
    "delay": _delay,
    "actuator": _actuator,
}
_FOR_BODIES = tuple(key for key in _EFFECTS if key not in ("gearing", "notch", "low_pass", "delay", "actuator"))
_FOR_LEVERS = tuple(key for key in _FOR_BODIES if key not in ("cushion", "cushion_damping", "seat_back"))
_FOR_CUSHIONS, _FOR_TORSOS = ("cushion", "cushion_damping"), ("cushion", "cushion_damping", "seat_back")


def catalogue() -> dict[str, Cure]:
    """All cures by their keys."""
    rows: Mapping[str, Mapping[str, Any]] = bundled("cures").value
    return {
        key: Cure(
            key,
            str(row["label"]),
            str(row["unit"]),
            float(row["practicable"][0]),
            float(row["practicable"][1]),
            float(row.get("cost", 0.0)),
            bool(row.get("remedy", True)),
            str(row["source"]),
            bool(row.get("by_name", False)),
            (str(row["below"][0]), str(row["below"][1])) if "below" in row else None,
        )
        for key, row in rows.items()
    }


def cures_for(study: Study, only: tuple[str, ...] = (), without: tuple[str, ...] = ()) -> list[Cure]:
    """The cures that mean something for a study, as far as they are asked for.

    Raises
    ------
    StudyError
        A name that is none, or that means nothing for this study; or nothing is left.
    """
    known = catalogue()
    for key in (*only, *without):
        if key not in known:
            raise StudyError(f"{key!r} is no cure; {did_you_mean(key, list(known))}choose from: {', '.join(known)}")
    reasons = {key: _meaningless(study, key) for key in known}
    for key in only:
        if reasons[key]:
            raise StudyError(f"cure {key!r} means nothing here: {reasons[key]}")
    kept = [cure for key, cure in known.items() if not reasons[key] and key not in without]
    kept = [cure for cure in kept if cure.key in only] if only else kept
    if not kept:
        raise StudyError("--only and --without leave no cure to try; name another one, or leave one of them out")
    return kept


def proposable(cures: Sequence[Cure], only: Sequence[str]) -> list[Cure]:
    """Those that may be part of a combination: remedies, and friction if it is asked for by name."""
    return [cure for cure in cures if cure.remedy and (not cure.by_name or cure.key in only)]


def _meaningless(study: Study, key: str) -> str:
    """Why a cure means nothing for a study; empty if it does."""
    if study.pilot.model == MAYO and key in _FOR_BODIES:
        return "Mayo's pilots have no lever, arm or seat; take a multibody pilot"
    if key in _FOR_LEVERS and not study.loop.usual:
        return "it is of the collective lever, and the study's loop is closed by another control or motion"
    if key in _FOR_TORSOS and study.pilot.torso["model"] == RIGID:
        return "a rigid torso has no cushion and no seat back; set pilot.torso.model: lumped"
    if key in _FOR_CUSHIONS and study.value("cockpit.seat.cushion") is None:
        return "the seat has a rigid pan"
    if key == "notch" and study.rotorcraft.notch is not None:
        return "the rotorcraft has a notch already; change its numbers by their paths"
    if key == "low_pass" and study.rotorcraft.low_pass is not None:
        return "the rotorcraft has a low-pass filter already; change its numbers by their paths"
    if key == "actuator" and study.rotorcraft.actuator is not None:
        return "the rotorcraft has an actuator already; change its numbers by their paths"
    return ""


def changes(
    study: Study, amounts: Mapping[str, float], critical_hz: float, swing: GripSwing | None = None
) -> dict[str, Any]:
    """What the amounts of cures do to a study: path -> value, for `--set` or as values of a pilot.

    Parameters
    ----------
    study : Study
        As it is.
    amounts : mapping
        Key of a cure -> amount in its unit; 0 changes nothing.
    critical_hz : float
        Where a notch belongs.
    swing : GripSwing, optional
        Friction as the damper that it is like in this swing, for a margin of such swings; without it friction is the
        study's own numbers, as a deck takes them, of which margins know nothing.
    """
    to = Changed(study, critical_hz, swing)
    order: MutableMapping[str, Callable[[Changed, float], None]] = dict(_EFFECTS)
    length = order.pop("lever_length")  # first: springs at the grip act about the hinge through it
    for key, effect in (("lever_length", length), *order.items()):
        if amounts.get(key, 0.0) != 0.0:
            effect(to, amounts[key])
    return to.values


def price(study: Study, cure: Cure, amount: float) -> str:
    """What a cure costs the pilot or the designer, in words; empty where nothing can be said."""
    if cure.key == "damper":
        return f"{amount * HAND_SPEED_M_PER_S:.1f} N of control force at {HAND_SPEED_M_PER_S:g} m/s"
    if cure.key == "trim_spring":
        return f"{0.1 * amount:.1f} N of control force after 0.1 m"
    if cure.key == "friction":
        return f"{amount:.3g} N of control force in every input, to start the lever and to keep it moving"
    if cure.key == "gearing":
        more = 1.0 / (1.0 - 0.01 * amount) - 1.0
        return f"{100.0 * more:.0f} % more travel of the lever"
    if cure.key == "inertia":
        length = float(study.value("inceptor.lever_length_m"))
        return f"{amount / length**2:.1f} kg more to move at the grip"
    if cure.key == "balance_weight":
        return f"{amount:.1f} kg of weight"
    if cure.key in ("notch", "low_pass"):
        return f"{1e3 * COMPUTING_S:.0f} ms of delay, counted, and a lag of collective inputs"
    return ""
