"""Reflex gains from measured people: Kp and Kd for which a reference pilot has Mayo's frequency and damping.

Posture and activations do not depend on the gains (reflexes act on deviations from the posture), so they are solved
once; only the deck at the controls is linearised again and again inside a root finder. Method, choice of the reference
pilots and what the result is worth: docs/theory/calibration.md.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pilotgen.decks.deck import render_direct
from pilotgen.errors import EvaluationError
from pilotgen.evaluation import EvaluationContext, SolvedPilot, linearise_direct, solve_pilot
from pilotgen.linear.feedthrough import make_pilot_model, mayo_pilot
from pilotgen.linear.imposed_motion import ImposedMotion
from pilotgen.linear.pilot_model import PilotModel
from pilotgen.solver.descriptor import Complexes
from pilotgen.study.study import Reflex, Study
from pilotgen.study.yaml_file import bundled
from pilotgen.summary import GRIP_FREQUENCY_HZ

FITTED, PREDICTED = "mesomorphic", "ectomorphic"
POSITION = "position"
START = Reflex(2.0, 0.15)  # where the root finder starts; any stable pilot will do
GAIN_TOLERANCE = 1e-10  # of the root finder, relative
LARGEST_GAIN = 50.0  # the limit of study files; far beyond any reflex
TARGET_TOLERANCE = 1e-8  # that frequency (relative) and damping must reach
HIGH_FREQUENCY_HZ = 1e3  # where springs and dampers of an arm no longer count, only its mass
# steps of the biometrics for the sensitivities: about what "estimated" may be wrong by
SENSITIVITY_STEPS: Mapping[str, float] = {"age_years": 10.0, "stature_m": 0.05, "mass_kg": 8.0}


@dataclass(frozen=True)
class MeasuredPilot:
    """Mayo's function of one group of people (paper eq. (40) and Table 2)."""

    frequency_hz: float
    damping: float
    time_constant_s: float


@dataclass(frozen=True)
class ReferencePilot:
    """A body for one group of Mayo's people; biometrics are estimated (data/reference_pilots.yaml)."""

    name: str
    values: dict[str, float]  # age_years, stature_m, mass_kg
    measured: MeasuredPilot


@dataclass(frozen=True)
class References:
    """Content of data/reference_pilots.yaml."""

    sex: str
    pilots: dict[str, ReferencePilot]
    stiffness_over_position_task: dict[str, float]


@dataclass(frozen=True)
class TaskGains:
    """Gains of one task and what they make of the fitted pilot."""

    task: str
    gains: Reflex
    frequency_hz: float
    damping: float
    grip_stiffness_N_per_m: float  # static, along the lever's arc
    grip_motion_mm_per_m_s2: float  # at 3 Hz, without washout


@dataclass(frozen=True)
class PilotComparison:
    """One reference pilot with the gains of the position task, beside the people."""

    name: str
    values: dict[str, float]
    measured: MeasuredPilot
    frequency_hz: float
    damping: float
    grip_motion_mm_per_m_s2: float
    measured_grip_motion_mm_per_m_s2: float
    grip_stiffness_N_per_m: float
    grip_mass_kg: float  # driving-point mass of arm and lever at high frequency
    measured_grip_stiffness_N_per_m: float  # (2 pi f)^2 of the measured frequency times grip_mass_kg


@dataclass(frozen=True)
class Sensitivity:
    """The gains when one biometric of the fitted pilot is another."""

    variable: str
    step: float
    gains: Reflex
    predicted_frequency_hz: float  # of the predicted pilot, whose body stays


@dataclass(frozen=True)
class Calibration:
    """Everything `pilotgen calibrate` found."""

    study: str
    tasks: dict[str, TaskGains]
    pilots: tuple[PilotComparison, ...]
    sensitivities: tuple[Sensitivity, ...]

    def as_dict(self) -> dict[str, Any]:
        """JSON-able."""
        return dataclasses.asdict(self)


@lru_cache(maxsize=1)
def references() -> References:
    """The bundled reference pilots."""
    data: dict[str, Any] = bundled("reference_pilots").value
    pilots = {}
    for name, entry in data["pilots"].items():
        values = {key: float(entry[key]) for key in SENSITIVITY_STEPS}
        measured = MeasuredPilot(**{key: float(value) for key, value in entry["measured"].items()})
        pilots[name] = ReferencePilot(name, values, measured)
    ratios = {task: float(ratio) for task, ratio in data["stiffness_over_position_task"].items()}
    return References(str(data["sex"]), pilots, ratios)


def reference_study(study: Study) -> Study:
    """The study with the reference pilots in its seat: their sex and strength, left arm alone, exact projection."""
    pilot = dataclasses.replace(
        study.pilot,
        model="multibody",
        sex=references().sex,
        limbs=("left",),
        projection="exact",
        reflex=None,
        strength_factor=1.0,
    )
    return dataclasses.replace(study, pilot=pilot)


# ---- the grip from outside -------------------------------------------------------------------------------------------


def grip_receptance(
    plant: ImposedMotion, lever_length_m: float, omega: ArrayLike, unknown: str = "lever.gz"
) -> Complexes:
    """Driving-point receptance at the collective's grip: motion along its arc per force along it [m/N].

    Parameters
    ----------
    plant : ImposedMotion
        The pilot at the controls; the seat does not move.
    lever_length_m : float
        Hinge to grip [m].
    omega : array_like, shape (m,)
        Angular frequencies [rad/s]; 0 gives the static compliance.
    unknown : str
        Rotation of the lever.
    """
    form, free = plant.form, plant.free
    lever = int(np.flatnonzero(free.coordinates == free.index(unknown))[0])
    n_q, n_r = len(form.M), len(form.Phi_0)
    s = 1j * np.asarray(omega, dtype=float).reshape(-1)[:, None, None]
    pencil = np.zeros((len(s), n_q + n_r, n_q + n_r), dtype=np.complex128)
    pencil[:, :n_q, :n_q] = s * s * form.M + s * form.C + form.K
    pencil[:, :n_q, n_q:] = form.B
    pencil[:, n_q:, :n_q] = s * form.Phi_1 + form.Phi_0
    moment = np.zeros((len(s), n_q + n_r, 1), dtype=np.complex128)
    moment[:, lever] = 1.0
    rotation: Complexes = np.linalg.solve(pencil, moment).astype(np.complex128, copy=False)[:, lever, 0]
    return rotation * float(lever_length_m) ** 2


def grip_stiffness(model: PilotModel) -> float:
    """Static stiffness of the hand at the collective grip, along the lever's arc [N/m]."""
    return 1.0 / float(grip_receptance(_plant(model), model.lever_length_m, [0.0])[0].real)


def grip_mass(model: PilotModel) -> float:
    """Mass of arm and lever that a fast motion of the grip along its arc has to move [kg]."""
    omega = 2.0 * math.pi * HIGH_FREQUENCY_HZ
    return -1.0 / (omega**2 * float(grip_receptance(_plant(model), model.lever_length_m, [omega])[0].real))


def _plant(model: PilotModel) -> ImposedMotion:
    if model.plant is None:
        raise EvaluationError("calibration", f"a pilot model of projection '{model.projection}' has no arm")
    return model.plant


# ---- fitting ---------------------------------------------------------------------------------------------------------


class Subject:
    """One pilot in posture, for any reflex gains."""

    def __init__(self, context: EvaluationContext, values: Mapping[str, float]) -> None:
        self._bench = context
        self.values = dict(values)
        self.pilot: SolvedPilot = solve_pilot(context, values)
        assert self.pilot.matrices is not None
        self._lengths = self.pilot.matrices.muscle_lengths

    def model(self, gains: Reflex) -> PilotModel:
        """The pilot's feedthrough with these gains, without washout."""
        pilot, study = self.pilot, self.pilot.study
        text = render_direct(
            pilot.body,
            pilot.cockpit,
            pilot.posture,
            activations=pilot.activations,
            muscle_lengths=self._lengths,
            gains=gains,
            c=study.pilot.matrix_coefficient_s,
        )
        matrices = linearise_direct(self._bench, text, self._bench.scratch)
        return make_pilot_model(matrices, lever_length_m=study.inceptor.lever_length_m)


def fit_gains(subject: Subject, measured: MeasuredPilot, start: Reflex = START) -> Reflex:
    """Kp and Kd for which the pilot's dominant pair has the measured frequency and damping.

    One pair of poles is followed by continuity from the dominant one at `start`, so that the pairs cannot change places
    on the way; at the end it must be the dominant one still.

    Raises
    ------
    EvaluationError
        No such gains were found; says how far the root finder came.
    """
    from scipy.optimize import root

    followed = subject.model(start).dominant_pole()

    def miss(x: np.ndarray) -> np.ndarray:
        nonlocal followed
        poles = subject.model(Reflex(float(x[0]), float(x[1]))).poles
        followed = complex(poles[int(np.argmin(np.abs(poles - followed)))])
        return np.array([_frequency_hz(followed) / measured.frequency_hz - 1.0, _damping(followed) - measured.damping])

    solution = root(miss, [start.proportional_gain, start.derivative_gain], tol=GAIN_TOLERANCE)
    gains = Reflex(float(solution.x[0]), float(solution.x[1]))
    dominant = subject.model(gains).dominant_pole()
    frequency, damping = _frequency_hz(dominant), _damping(dominant)
    found = f"{frequency:.4f} Hz and damping {damping:.4f} at Kp {solution.x[0]:.4f}, Kd {solution.x[1]:.4f}"
    wanted = f"{measured.frequency_hz:g} Hz and {measured.damping:g}"
    if (
        abs(frequency / measured.frequency_hz - 1.0) > TARGET_TOLERANCE
        or abs(damping - measured.damping) > TARGET_TOLERANCE
        or not 0.0 <= gains.proportional_gain <= LARGEST_GAIN
        or not 0.0 <= gains.derivative_gain <= LARGEST_GAIN
    ):
        raise EvaluationError(
            "calibration",
            f"no reflex gains between 0 and {LARGEST_GAIN:g} give the reference pilot {wanted}; the nearest found: "
            f"{found}. An activation floor adds damping of its own: with one, try a smaller pilot.activation_floor",
        )
    return gains


def scale_gains(subject: Subject, gains: Reflex, ratio: float) -> Reflex:
    """The reflex scaled as a whole until the grip has `ratio` times its static stiffness.

    EvaluationError if no scale reaches it.
    """
    from scipy.optimize import brentq

    wanted = ratio * grip_stiffness(subject.model(gains))

    def excess(scale: float) -> float:
        return grip_stiffness(subject.model(_scaled(gains, scale))) - wanted

    try:
        scale = float(brentq(excess, 0.02, 1.0, xtol=1e-10))
    except ValueError:
        raise EvaluationError(
            "calibration", f"no scale of the reflex between 0.02 and 1 makes the grip {ratio:g} times as stiff"
        ) from None
    return _scaled(gains, scale)


def _scaled(gains: Reflex, scale: float) -> Reflex:
    return Reflex(scale * gains.proportional_gain, scale * gains.derivative_gain)


def calibrate(context: EvaluationContext, sensitivities: bool = True) -> Calibration:
    """Fit the gains of all tasks; predict the other reference pilot; vary the biometrics nobody published.

    Parameters
    ----------
    context : EvaluationContext
        Of a `reference_study`.
    sensitivities : bool
        Whether to repeat the fit with other biometrics.
    """
    known = references()
    fitted, predicted = known.pilots[FITTED], known.pilots[PREDICTED]
    subject, other = Subject(context, fitted.values), Subject(context, predicted.values)
    gains = fit_gains(subject, fitted.measured)
    tasks = {POSITION: _task(subject, POSITION, gains)}
    for task, ratio in known.stiffness_over_position_task.items():
        tasks[task] = _task(subject, task, scale_gains(subject, gains, ratio))
    pilots = tuple(compare_with_measured(person, gains, known.pilots[name]) for person, name in
                   ((subject, FITTED), (other, PREDICTED)))  # fmt: skip
    varied = []
    if sensitivities:
        for variable, size in SENSITIVITY_STEPS.items():
            for step in (-size, size):
                values = {**fitted.values, variable: fitted.values[variable] + step}
                own = fit_gains(Subject(context, values), fitted.measured, gains)
                varied.append(Sensitivity(variable, step, own, other.model(own).dominant_pair()[0]))
    return Calibration(context.study.name, tasks, pilots, tuple(varied))


def compare_with_measured(subject: Subject, gains: Reflex, reference: ReferencePilot) -> PilotComparison:
    """One reference pilot with given gains beside the people he stands for."""
    model = subject.model(gains)
    frequency, damping = model.dominant_pair()
    measured = reference.measured
    people = mayo_pilot(
        measured.frequency_hz, measured.damping, measured.time_constant_s, model.lever_length_m, washout_rad_s=None
    )
    mass = grip_mass(model)
    return PilotComparison(
        name=reference.name,
        values=dict(subject.values),
        measured=measured,
        frequency_hz=frequency,
        damping=damping,
        grip_motion_mm_per_m_s2=_grip_motion_mm(model),
        measured_grip_motion_mm_per_m_s2=_grip_motion_mm(people),
        grip_stiffness_N_per_m=grip_stiffness(model),
        grip_mass_kg=mass,
        measured_grip_stiffness_N_per_m=(2.0 * math.pi * measured.frequency_hz) ** 2 * mass,
    )


def _task(subject: Subject, task: str, gains: Reflex) -> TaskGains:
    model = subject.model(gains)
    frequency, damping = model.dominant_pair()
    return TaskGains(task, gains, frequency, damping, grip_stiffness(model), _grip_motion_mm(model))


def _grip_motion_mm(model: PilotModel) -> float:
    return 1e3 * abs(complex(model.grip_motion(2.0 * math.pi * GRIP_FREQUENCY_HZ)))


def _frequency_hz(pole: complex) -> float:
    return abs(pole) / (2.0 * math.pi)


def _damping(pole: complex) -> float:
    return -pole.real / abs(pole)


# ---- the result as data ----------------------------------------------------------------------------------------------


def reflex_yaml(calibration: Calibration) -> str:
    """The file data/reflex.yaml for these gains."""
    known = references()
    reference = known.pilots[FITTED]
    body = ", ".join(f"{name} {value:g}" for name, value in reference.values.items())
    lines = [
        "# Reflex gains per task: a = a0 + Kp (x - x_ref) + Kd v, x = l/l0, v = ldot/V0 with V0 = 4 l0 per second.",
        "# Positive gains oppose stretch. Quasi-steady stretch reflex after Stroeve (1999) as used by Masarati et al.",
        "# (2013).",
        "#",
        f"# Made by `pilotgen calibrate` on the study {calibration.study}: with the gains of the position task the",
        f"# {FITTED} reference pilot ({known.sex}, {body}; data/reference_pilots.yaml)",
        f"# has Mayo's {reference.measured.frequency_hz:g} Hz and damping {reference.measured.damping:g}. "
        "The other tasks scale the whole reflex until his grip has",
        "# the part of its static stiffness that data/reference_pilots.yaml names. Theory: docs/theory/calibration.md.",
        "tasks:",
    ]
    for task, found in calibration.tasks.items():
        Kp, Kd = found.gains.proportional_gain, found.gains.derivative_gain
        lines.append(f"  {task}: {{proportional_gain: {Kp:.6f}, derivative_gain: {Kd:.6f}}}")
    return "\n".join(lines) + "\n"
