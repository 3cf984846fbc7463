"""Reflex gains from measured people: Kp and Kd for which a reference pilot has Mayo's frequency and damping.

With a torso on springs several pairs of poles lie between 3 and 6 Hz, and no one pair is what Mayo saw. He fitted a
function of one pair to the motion of hands; so does this room: the same function is fitted to the pilot's absolute hand
motion from 1 to 8 Hz, and the gains are such that its frequency and damping are his. Its time constant, the level, the
phase and the margins stay predictions. With a rigid torso the dominant pair of poles takes the function's place.

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

from pilotgen.context import EvaluationContext
from pilotgen.decks.deck import render_direct
from pilotgen.errors import EvaluationError
from pilotgen.evaluation import SolvedPilot, close_loop, linearise_direct, solve_pilot
from pilotgen.linear.feedthrough import make_pilot_model, mayo_pilot
from pilotgen.linear.imposed_motion import ImposedMotion
from pilotgen.linear.pilot_model import PilotModel
from pilotgen.linear.reflex_delay import delay_reflex
from pilotgen.solver.descriptor import Complexes
from pilotgen.solver.matrices import Matrices
from pilotgen.study.sections import Reflex, calibrated_gains
from pilotgen.study.study import Study
from pilotgen.study.torso_numbers import RIGID
from pilotgen.study.yaml_file import bundled
from pilotgen.summary import GRIP_FREQUENCY_HZ

FITTED, PREDICTED = "mesomorphic", "ectomorphic"  # the first is fitted, every other reference pilot predicted
POSITION = "position"
START = Reflex(2.0, 0.15)  # where the root finder starts; any stable pilot will do
GAIN_TOLERANCE = 1e-10  # of the root finder, relative
LARGEST_GAIN = 50.0  # the limit of study files; far beyond any reflex
TARGET_TOLERANCE = 1e-8  # that frequency (relative) and damping must reach
HIGH_FREQUENCY_HZ = 1e3  # where springs and dampers of an arm no longer count, only its mass
HAND_HZ = np.arange(1.0, 8.0 + 1e-9, 0.1)  # where Mayo's function is fitted to the hand's motion
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
class Seen:
    """What Mayo's function sees of a pilot's hand, without washout."""

    frequency_hz: float
    damping: float
    time_constant_s: float
    grip_motion_mm_per_m_s2: float  # at 3 Hz
    grip_phase_deg: float  # at 3 Hz, of the grip's motion against the seat's acceleration


@dataclass(frozen=True)
class TaskGains:
    """Gains of one task and what they make of the fitted pilot."""

    task: str
    gains: Reflex
    seen: Seen
    grip_stiffness_N_per_m: float  # static, along the lever's arc
    gain_margin_db: float  # with the study's rotorcraft


@dataclass(frozen=True)
class PilotComparison:
    """One reference pilot with the gains of the position task, beside the people."""

    name: str
    values: dict[str, float]
    seen: Seen
    measured: Seen
    gain_margin_db: float  # with the study's rotorcraft
    measured_gain_margin_db: float
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
    torso: str  # model
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
    imposed: ImposedMotion, lever_length_m: float, omega: ArrayLike, unknown: str = "lever.gz"
) -> Complexes:
    """Driving-point receptance at the collective's grip: motion along its arc per force along it [m/N].

    Parameters
    ----------
    imposed : ImposedMotion
        The pilot at the controls; the seat does not move.
    lever_length_m : float
        Hinge to grip [m].
    omega : array_like, shape (m,)
        Angular frequencies [rad/s]; 0 gives the static compliance.
    unknown : str
        Rotation of the lever.
    """
    form, free = imposed.form, imposed.free
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
    return 1.0 / float(grip_receptance(_imposed(model), model.lever_length_m, [0.0])[0].real)


def grip_mass(model: PilotModel) -> float:
    """Mass of arm and lever that a fast motion of the grip along its arc has to move [kg]."""
    omega = 2.0 * math.pi * HIGH_FREQUENCY_HZ
    return -1.0 / (omega**2 * float(grip_receptance(_imposed(model), model.lever_length_m, [omega])[0].real))


def _imposed(model: PilotModel) -> ImposedMotion:
    if model.imposed is None:
        raise EvaluationError("calibration", f"a pilot model of projection '{model.projection}' has no arm")
    return model.imposed


# ---- fitting ---------------------------------------------------------------------------------------------------------


class CalibrationPilot:
    """One pilot in posture, for any reflex gains."""

    def __init__(self, context: EvaluationContext, values: Mapping[str, float]) -> None:
        self._bench = context
        self.values = dict(values)
        self.pilot: SolvedPilot = solve_pilot(context, values)
        assert self.pilot.matrices is not None
        self._lengths = self.pilot.matrices.muscle_lengths
        self.torso: str = self.pilot.study.pilot.torso["model"]

    def model(self, gains: Reflex) -> PilotModel:
        """The pilot's feedthrough with these gains, without washout."""
        pilot, settings = self.pilot, self.pilot.study.pilot
        matrices = self._matrices(gains)
        model = make_pilot_model(matrices, lever_length_m=pilot.study.inceptor.lever_length_m)
        if pilot.without_reflex is None:
            return model
        late = (settings.reflex_delay_s, settings.reflex_undelayed_share, settings.reflex_pade_order)
        return delay_reflex(model, matrices, pilot.without_reflex, *late)

    def _matrices(self, gains: Reflex) -> Matrices:
        pilot = self.pilot
        text = render_direct(
            pilot.body,
            pilot.cockpit,
            pilot.posture,
            activations=pilot.activations,
            muscle_lengths=self._lengths,
            gains=gains,
            c=pilot.study.pilot.matrix_coefficient_s,
            torso=pilot.torso,
        )
        return linearise_direct(self._bench, text, self._bench.scratch, pilot.torso)

    def gain_margin_db(self, model: PilotModel) -> float:
        """Gain margin [dB] of one of the pilot's models, or of people, with the study's rotorcraft and washout."""
        study = self.pilot.study
        washed = dataclasses.replace(model, washout_rad_s=study.pilot.washout_rad_s)
        return float(close_loop(self._bench, study, washed)[1].gain_margin_db)

    def seen(self, model: PilotModel) -> Seen:
        """What is compared with Mayo's people."""
        frequency, damping = frequency_and_damping(model, self.torso)
        grip = complex(model.grip_motion(2.0 * np.pi * GRIP_FREQUENCY_HZ))
        return Seen(frequency, damping, seen_by_mayo(model)[2], 1e3 * abs(grip), float(np.degrees(np.angle(grip))))


def seen_by_mayo(model: PilotModel) -> tuple[float, float, float]:
    """Frequency [Hz], damping and time constant [s] of Mayo's function that is nearest to a pilot's hand motion.

    The hand moves by 1 + s^2 G(s) times the seat, G being the grip's motion relative to the seat per acceleration of
    the seat. Mayo's function (paper eq. (39), without washout) makes it

        (c s + w^2) / (s^2 + 2 z w s + w^2),    tau = 1 / (2 z w - c);

    w, z and c by least squares of the complex difference from 1 to 8 Hz, all frequencies alike.
    """
    from scipy.optimize import least_squares

    s = 2j * np.pi * HAND_HZ
    hand = 1.0 + s * s * np.asarray(model.grip_motion(2.0 * np.pi * HAND_HZ))

    def miss(x: np.ndarray) -> np.ndarray:
        w = 2.0 * np.pi * x[0]
        difference = (x[2] * s + w * w) / (s * s + 2.0 * x[1] * w * s + w * w) - hand
        return np.concatenate((difference.real, difference.imag))

    scale = [3.0, 0.3, 10.0]
    found = least_squares(miss, scale, x_scale=scale, xtol=1e-14, ftol=1e-14, gtol=1e-14).x.tolist()
    frequency, damping, c = found
    return frequency, damping, 1.0 / (4.0 * math.pi * damping * frequency - c)


def frequency_and_damping(model: PilotModel, torso: str) -> tuple[float, float]:
    """What is compared with Mayo's: of the fitted function, or with a rigid torso of the dominant pair of poles."""
    return model.dominant_pair() if torso == RIGID else seen_by_mayo(model)[:2]


def fit_gains(person: CalibrationPilot, measured: MeasuredPilot, start: Reflex = START) -> Reflex:
    """Kp and Kd for which the pilot has the measured frequency and damping.

    With a rigid torso one pair of poles is followed by continuity from the dominant one at `start`, so that the pairs
    cannot change places on the way; at the end it must be the dominant one still.

    Raises
    ------
    EvaluationError
        No such gains were found; says how far the root finder came.
    """
    from scipy.optimize import root

    torso = person.torso
    followed = person.model(start).dominant_pole() if torso == RIGID else 0j

    def miss(x: np.ndarray) -> np.ndarray:
        nonlocal followed
        model = person.model(Reflex(float(x[0]), float(x[1])))
        if torso == RIGID:
            followed = complex(model.poles[int(np.argmin(np.abs(model.poles - followed)))])
            frequency, damping = _frequency_hz(followed), _damping(followed)
        else:
            frequency, damping = frequency_and_damping(model, torso)
        return np.array([frequency / measured.frequency_hz - 1.0, damping - measured.damping])

    solution = root(miss, [start.proportional_gain, start.derivative_gain], tol=GAIN_TOLERANCE)
    gains = Reflex(float(solution.x[0]), float(solution.x[1]))
    frequency, damping = frequency_and_damping(person.model(gains), torso)
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


def scale_gains(person: CalibrationPilot, gains: Reflex, ratio: float) -> Reflex:
    """The reflex scaled as a whole until the grip has `ratio` times its static stiffness.

    EvaluationError if no scale reaches it.
    """
    from scipy.optimize import brentq

    wanted = ratio * grip_stiffness(person.model(gains))

    def excess(scale: float) -> float:
        return grip_stiffness(person.model(_scaled(gains, scale))) - wanted

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
    """Fit the gains of all tasks; predict the other reference pilots; vary the biometrics nobody published.

    Parameters
    ----------
    context : EvaluationContext
        Of a `reference_study`.
    sensitivities : bool
        Whether to repeat the fit with other biometrics.
    """
    known = references()
    fitted = known.pilots[FITTED]
    people = {name: CalibrationPilot(context, pilot.values) for name, pilot in known.pilots.items()}
    person, other = people[FITTED], people[PREDICTED]
    gains = fit_gains(person, fitted.measured)
    tasks = {POSITION: _task(person, POSITION, gains)}
    for task, ratio in known.stiffness_over_position_task.items():
        tasks[task] = _task(person, task, scale_gains(person, gains, ratio))
    pilots = tuple(compare_with_measured(people[name], gains, known.pilots[name]) for name in known.pilots)
    varied = []
    if sensitivities:
        for variable, size in SENSITIVITY_STEPS.items():
            for step in (-size, size):
                values = {**fitted.values, variable: fitted.values[variable] + step}
                own = fit_gains(CalibrationPilot(context, values), fitted.measured, gains)
                predicted = frequency_and_damping(other.model(own), other.torso)[0]
                varied.append(Sensitivity(variable, step, own, predicted))
    return Calibration(context.study.name, person.torso, tasks, pilots, tuple(varied))


def compare_with_measured(person: CalibrationPilot, gains: Reflex, reference: ReferencePilot) -> PilotComparison:
    """One reference pilot with given gains beside the people he stands for."""
    model = person.model(gains)
    measured = reference.measured
    people = mayo_pilot(
        measured.frequency_hz, measured.damping, measured.time_constant_s, model.lever_length_m, washout_rad_s=None
    )
    grip = complex(people.grip_motion(2.0 * np.pi * GRIP_FREQUENCY_HZ))
    mass = grip_mass(model)
    return PilotComparison(
        name=reference.name,
        values=dict(person.values),
        seen=person.seen(model),
        measured=Seen(
            measured.frequency_hz,
            measured.damping,
            measured.time_constant_s,
            1e3 * abs(grip),
            float(np.degrees(np.angle(grip))),
        ),
        gain_margin_db=person.gain_margin_db(model),
        measured_gain_margin_db=person.gain_margin_db(people),
        grip_stiffness_N_per_m=grip_stiffness(model),
        grip_mass_kg=mass,
        measured_grip_stiffness_N_per_m=(2.0 * math.pi * measured.frequency_hz) ** 2 * mass,
    )


def _task(person: CalibrationPilot, task: str, gains: Reflex) -> TaskGains:
    model = person.model(gains)
    return TaskGains(task, gains, person.seen(model), grip_stiffness(model), person.gain_margin_db(model))


def _frequency_hz(pole: complex) -> float:
    return abs(pole) / (2.0 * math.pi)


def _damping(pole: complex) -> float:
    return -pole.real / abs(pole)


# ---- the result as data ----------------------------------------------------------------------------------------------


def reflex_yaml(calibration: Calibration) -> str:
    """The file data/reflex.yaml with these gains; those of other torso models stay as they are."""
    known = references()
    reference = known.pilots[FITTED]
    body = ", ".join(f"{name} {value:g}" for name, value in reference.values.items())
    lines = [
        "# Reflex gains per torso model and task: a = a0 + Kp (x - x_ref) + Kd v, x = l/l0, v = ldot/V0, V0 = 4 l0 per",
        "# second. Positive gains oppose stretch. Quasi-steady stretch reflex after Stroeve (1999) as used by Masarati",
        "# et al. (2013).",
        "#",
        "# Made by `pilotgen calibrate`, each on a study with that torso: with the gains of the position task the",
        f"# {FITTED} reference pilot ({known.sex}, {body}; data/reference_pilots.yaml)",
        f"# has Mayo's {reference.measured.frequency_hz:g} Hz and damping {reference.measured.damping:g}: "
        "the dominant pair of poles with a rigid torso, Mayo's function fitted",
        "# to the hand's motion otherwise. The other tasks scale the whole reflex until his grip has the part of its",
        "# static stiffness that data/reference_pilots.yaml names. Theory: docs/theory/calibration.md.",
        "torso:",
    ]
    for torso in bundled("reflex").value["torso"]:
        gains = dict(calibrated_gains(torso))
        if torso == calibration.torso:
            gains = {task: found.gains for task, found in calibration.tasks.items()}
        lines.append(f"  {torso}:")
        for task, own in gains.items():
            Kp, Kd = own.proportional_gain, own.derivative_gain
            lines.append(f"    {task}: {{proportional_gain: {Kp:.6f}, derivative_gain: {Kd:.6f}}}")
    return "\n".join(lines) + "\n"
