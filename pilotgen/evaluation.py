"""The whole chain for one pilot on one page: values of a study in, margins out.

    biometrics -> body -> cockpit -> posture deck -> posture -> trim deck -> activations -> pilot deck -> matrices
               -> descriptor -> modes -> feedthrough -> loop -> margins

A pilot that cannot be evaluated is a result too: `FailedEvaluation`, with the stage and the reason.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pilotgen.activation.activation import Activations, solve_activations
from pilotgen.activation.reflex import reflex_gains
from pilotgen.anthropometry.biometrics import Biometrics, biometrics_from
from pilotgen.anthropometry.body import Body, make_body
from pilotgen.anthropometry.torso import make_torso
from pilotgen.context import EvaluationContext
from pilotgen.decks.deck import GRAVITY_M_PER_S2, render_direct, render_posture, render_trim
from pilotgen.errors import EvaluationError, FileError, MatrixError, SolverError, StudyError
from pilotgen.files import to_json, write_text
from pilotgen.linear.feedthrough import certificate, make_pilot_model, mayo_pilot
from pilotgen.linear.imposed_motion import Channels
from pilotgen.linear.pilot_model import PilotModel
from pilotgen.linear.reflex_delay import delay_reflex, delayed_certificate
from pilotgen.loop.loop import LoopModel, pilot_loop
from pilotgen.loop.margins import Margins, margins
from pilotgen.loop.measured import measured_margins
from pilotgen.loop.rotorcraft_model import measured_part, rotorcraft_model
from pilotgen.loop.units import COLLECTIVE, CONTROLS
from pilotgen.posture.cockpit import Cockpit, make_cockpit
from pilotgen.posture.posture import Posture, first_guess, from_poses
from pilotgen.posture.seated_torso import FEM_NAME, SeatedTorso, seat_torso
from pilotgen.solver.matrices import Matrices, read_matrices
from pilotgen.solver.mbdyn import run_mbdyn
from pilotgen.study.loop_section import LoopSignals
from pilotgen.study.sections import Reflex
from pilotgen.study.study import Study
from pilotgen.study.torso_numbers import MODES, RIGID
from pilotgen.summary import bdft_summary, loop_result, result_file

POSTURE_DECK, TRIM_DECK, PILOT_DECK = "posture.mbd", "trim.mbd", "pilot.mbd"
RESULT_NAME = "result.json"
DECK_NAMES = (POSTURE_DECK, TRIM_DECK, PILOT_DECK)

EQUILIBRIUM_LIMIT = 1e-6  # N, N m: a larger residual is no equilibrium and its linearisation means nothing
# Residual that the posture is solved to: round-off. Constraints that stay open by 1e-13 m would have MBDyn's
# derivatives phase fail on the pilot's deck (docs/io_formats/deck.md); one more Newton step closes them to 1e-16 m.
POSTURE_TOLERANCE = 1e-13


@dataclass(frozen=True)
class Evaluation:
    """One pilot, evaluated."""

    values: dict[str, Any]  # his own, and what else he has other than the study by its path
    result: dict[str, Any]  # JSON-able, the content of result.json
    pilot_model: PilotModel
    loop: LoopModel
    margins: Margins
    solved: SolvedPilot | None = field(default=None, repr=False)  # where he sits; None for transfer functions


@dataclass(frozen=True)
class FailedEvaluation:
    """One pilot that could not be evaluated, and why."""

    values: dict[str, Any]
    stage: str
    reason: str

    @property
    def result(self) -> dict[str, Any]:
        """JSON-able, the content of result.json."""
        return {"status": "failed", "stage": self.stage, "reason": self.reason, "values": self.values}


def evaluate(
    context: EvaluationContext, values: Mapping[str, Any], keep: Path | None = None
) -> Evaluation | FailedEvaluation:
    """Evaluate one pilot.

    Parameters
    ----------
    context : EvaluationContext
        Of the study.
    values : mapping
        The pilot's own values, and anything else that he has other than the study by its path (`Study.values`).
    keep : Path, optional
        Decks and matrices.h5 stay in that directory.

    Raises
    ------
    FileError
        What any pilot would meet: a full disk, a scratch directory that is gone.
    """
    plain = _plain(values)
    try:
        if context.study.pilot.model == "mayo":
            return _evaluate_mayo(context, plain)
        return _evaluate_multibody(context, plain, keep)
    except EvaluationError as error:
        if error.stage in ("solver", "matrices"):
            context.check_scratch()
        return FailedEvaluation(plain, error.stage, error.reason)
    except MatrixError as error:
        context.check_scratch()
        return FailedEvaluation(plain, "matrices", str(error))
    except FileError:
        context.check_scratch()  # says more, if that is why
        raise


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """The values as plain data, NumPy's numbers made Python's."""
    return {name: float(v) if isinstance(v, float | np.floating) else v for name, v in values.items()}


def study_of(context: EvaluationContext, values: Mapping[str, Any]) -> tuple[Study, Mapping[str, float]]:
    """The study that one pilot sees and his own values: the context's study, changed where `values` has paths.

    Raises
    ------
    EvaluationError
        At stage "study": values that do not go together, as a corner of a search box may hold.
    """
    study = context.study
    if values.keys() <= study.nominal.keys():  # his own values alone, as in most searches
        return study, values
    try:
        return study.with_values(values)
    except StudyError as error:
        raise EvaluationError("study", str(error)) from None


def write_result(
    context: EvaluationContext,
    outcome: Evaluation | FailedEvaluation,
    directory: Path,
    more: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Write result.json to a directory that may hold the pilot's deck; returns its content. FileError if that fails.

    `more` stands in it as well.
    """
    deck = directory / PILOT_DECK
    try:
        solver = context.client.version() if context.mbdae is not None else "none"
    except SolverError:  # it died with the pilot, whose result says so
        solver = "unknown: it did not answer"
    result = {**outcome.result, **(more or {})}
    content = result_file(context.study, result, solver, deck.read_text(encoding="utf-8") if deck.is_file() else None)
    write_text(directory / RESULT_NAME, to_json(content))
    return content


def write_decks(context: EvaluationContext, values: Mapping[str, Any], directory: Path) -> FailedEvaluation | None:
    """Write the three decks of one pilot; None when all went well."""
    plain = _plain(values)
    try:
        solve_pilot(context, plain, directory, linearise=False)
    except EvaluationError as error:
        return FailedEvaluation(plain, error.stage, error.reason)
    return None


@dataclass(frozen=True)
class SolvedPilot:
    """A multibody pilot in equilibrium at the controls."""

    study: Study  # as he sees it
    biometrics: Biometrics
    body: Body
    cockpit: Cockpit
    posture: Posture
    activations: Activations
    torso: SeatedTorso | None  # None: rigid, one body with the seat
    deck: str
    matrices: Matrices | None  # None when the pilot's deck was not linearised
    without_reflex: Matrices | None = None  # of the same deck with gains of zero; only where the reflex is delayed


def solve_pilot(
    context: EvaluationContext, values: Mapping[str, Any], keep: Path | None = None, linearise: bool = True
) -> SolvedPilot:
    """Posture and activations of one pilot, the deck at the controls and, with `linearise`, its matrices.

    Raises EvaluationError, with the stage, where a step has no answer for this pilot.
    """
    study, own = study_of(context, values)
    settings, inceptor = study.pilot, study.inceptor
    where = keep if keep is not None else context.scratch

    def write(name: str, text: str) -> None:
        if keep is not None:
            write_text(keep / name, text)

    try:
        biometrics = biometrics_from(own, settings.sex)
    except StudyError as error:  # a corner of the box, such as a tall pilot of little mass, may hold no person
        raise EvaluationError("biometrics", str(error)) from None
    body = make_body(biometrics, settings.limbs, settings.strength_factor)
    cockpit = make_cockpit(
        body,
        lever_length_m=inceptor.lever_length_m,
        position=inceptor.position,
        seat=settings.seat,
        numbers=study.cockpit,
    )
    guess = first_guess(body, cockpit)

    text = render_posture(body, cockpit, guess)
    write(POSTURE_DECK, text)
    reply = context.ask("static", text, POSTURE_DECK, tolerance=POSTURE_TOLERANCE)
    posture = from_poses(body, cockpit, reply.nodes)

    gains = reflex_gains(settings.task, settings.torso["model"], settings.reflex)
    c = settings.matrix_coefficient_s
    text = render_trim(body, cockpit, posture, gains=gains, c=c)
    write(TRIM_DECK, text)
    trim_file = f"{context.scratch}/trim.h5"  # of no use after this page; the deck makes it again
    trim = read_matrices(trim_file, context.ask("linearise", text, TRIM_DECK, trim_file, nodes=False).datasets)
    activations = solve_activations(trim, body, cockpit, floor=settings.activation_floor)

    torso = None
    if settings.torso["model"] != RIGID:
        springs = make_torso(biometrics, settings.limbs, settings.torso, study.cockpit["seat"])
        torso = seat_torso(springs, body, cockpit, posture.nodes, activations.hand_loads, GRAVITY_M_PER_S2)
    if torso is not None and settings.torso["model"] == MODES:
        from pilotgen.posture.seated_spine import torso_modes

        cutoff_hz = settings.torso["modes_up_to_hz"]
        modes = torso_modes(torso, cockpit, biometrics, GRAVITY_M_PER_S2, cutoff_hz)
        torso = dataclasses.replace(torso, modes=modes)
        write(FEM_NAME, modes.fem)

    def direct(gains: Reflex) -> str:
        return render_direct(
            body,
            cockpit,
            posture,
            activations=activations,
            muscle_lengths=trim.muscle_lengths,
            gains=gains,
            c=c,
            torso=torso,
        )

    text = direct(gains)
    write(PILOT_DECK, text)
    matrices = linearise_direct(context, text, where, torso) if linearise else None
    late = linearise and settings.reflex_delay_s > 0.0
    bare = linearise_direct(context, direct(Reflex(0.0, 0.0)), Path(context.scratch), torso) if late else None
    return SolvedPilot(study, biometrics, body, cockpit, posture, activations, torso, text, matrices, bare)


def feedthrough_of(pilot: SolvedPilot) -> tuple[PilotModel, dict[str, float]]:
    """The feedthrough of a solved pilot, his reflex delayed if the study says so.

    Returns
    -------
    tuple
        The model, and its checks: `certificate`, and with a delay `pade_error`, the largest relative difference between
        the approximant and the delay itself (0.1 to 20 Hz).
    """
    settings = pilot.study.pilot
    assert pilot.matrices is not None
    ends = pilot.study.loop
    x, y, z = ends.point_m
    model = make_pilot_model(
        pilot.matrices,
        lever_length_m=pilot.study.inceptor.lever_length_m,
        washout_rad_s=settings.washout_rad_s,
        projection=settings.projection,
        channels=None if ends.usual else Channels(inputs=(ends.input,), point_m=(x, y, z)),
    )
    if pilot.without_reflex is None:
        return model, {"certificate": certificate(model, output=output_of(model, ends))}
    late = (settings.reflex_delay_s, settings.reflex_undelayed_share, settings.reflex_pade_order)
    model = delay_reflex(model, pilot.matrices, pilot.without_reflex, *late)
    certified, pade_error = delayed_certificate(model, pilot.matrices, pilot.without_reflex, *late)
    return model, {"certificate": certified, "pade_error": pade_error}


def output_of(model: PilotModel, ends: LoopSignals) -> int:
    """Which output of a pilot is the control of a loop."""
    return model.outputs.index(CONTROLS[ends.output][0])


def _linearised(context: EvaluationContext, text: str, name: str, path: str, more: str = "") -> Matrices:
    """Have a deck linearised and read what the solver wrote: matrices of this deck, not of another.

    `more` is the text of the file that the deck reads.
    """
    reply = context.ask("linearise", text, name, path, nodes=False)
    try:
        matrices = read_matrices(path, reply.datasets)
    except FileError as error:
        raise EvaluationError("matrices", f"mbdae said that it linearised {name}, but {error}") from None
    if matrices.deck_sha256 != hashlib.sha256((text + more).encode()).hexdigest():
        raise EvaluationError(
            "matrices", f"mbdae said that it linearised {name}, but {os.path.basename(path)} is of another deck"
        )
    return matrices


def linearise_direct(context: EvaluationContext, text: str, where: Path, torso: SeatedTorso | None = None) -> Matrices:
    """Matrices of a pilot's deck, which must be in equilibrium; `where` gets matrices.h5.

    `torso` is the deck's: modes of it stand in a file beside the deck.

    Raises EvaluationError if the deck is not in equilibrium or the file is not this deck's.
    """
    context.put_modes(torso)
    more = torso.modes.fem if torso is not None and torso.modes is not None else ""
    matrices = _linearised(context, text, PILOT_DECK, f"{where}/matrices.h5", more)
    worst = float(np.max(np.abs(matrices.equilibrium_residual)))
    if not worst < EQUILIBRIUM_LIMIT:
        index = int(np.argmax(np.abs(matrices.equilibrium_residual)))
        raise EvaluationError(
            "equilibrium",
            f"the pilot's deck is not in equilibrium: {worst:.3g} N or N m left at {matrices.dof_names[index]}",
        )
    if context.solver == "mbdyn":
        deck = where / PILOT_DECK
        write_text(deck, text)
        if torso is not None and torso.modes is not None:
            write_text(where / FEM_NAME, torso.modes.fem)
        from pilotgen.solver.mbdyn_files import read_mbdyn

        return read_mbdyn(run_mbdyn(deck, where, context.mbdyn, context.time_limit_s), layout=matrices)
    return matrices


def _evaluate_multibody(context: EvaluationContext, values: dict[str, Any], keep: Path | None) -> Evaluation:
    pilot = solve_pilot(context, values, keep)
    study = pilot.study
    model, checks = feedthrough_of(pilot)
    loop, verdict = close_loop(context, study, model)
    activation = pilot.activations
    result = {
        "status": "ok",
        "study": study.name,
        "values": values,
        "biometrics": {
            "age_years": pilot.biometrics.age_years,
            "stature_m": pilot.biometrics.stature_m,
            "mass_kg": pilot.biometrics.mass_kg,
            "bmi": pilot.biometrics.bmi,
            "sex": pilot.biometrics.sex,
        },
        "extrapolated": list(pilot.body.extrapolated),
        "seat": pilot.cockpit.seat_report(),
        "posture": dict(pilot.posture.angles_deg),
        "activation": {
            "largest": activation.largest,
            "largest_muscle": activation.largest_muscle,
            "sum_of_squares": activation.sum_of_squares,
            "joint_torques_n_m": dict(activation.joint_torques_N_m),
        },
        "pilot_poles": model.pole_list(),
        "bdft": bdft_summary(model, loop, **checks),
        "loop": loop_result(loop, verdict),
    }
    return Evaluation(values, result, model, loop, verdict, pilot)


def _evaluate_mayo(context: EvaluationContext, values: dict[str, Any]) -> Evaluation:
    study, own = study_of(context, values)
    model = mayo_pilot(
        frequency_hz=own["pilot_frequency_hz"],
        damping=own["pilot_damping"],
        time_constant_s=own["pilot_time_constant_s"],
        lever_length_m=study.inceptor.lever_length_m,
        washout_rad_s=study.pilot.washout_rad_s,
    )
    loop, verdict = close_loop(context, study, model)
    result = {
        "status": "ok",
        "study": study.name,
        "values": values,
        "pilot_poles": model.pole_list(),
        "bdft": bdft_summary(model, loop, certificate=None),
        "loop": loop_result(loop, verdict),
    }
    return Evaluation(values, result, model, loop, verdict)


def close_loop(context: EvaluationContext, study: Study, model: PilotModel) -> tuple[LoopModel, Margins]:
    """The loop of a pilot with the rotorcraft that his study names, and its margins.

    Raises EvaluationError where the loop cannot be judged.
    """
    inceptor, ends = study.inceptor, study.loop
    same = study.rotorcraft is context.study.rotorcraft
    helicopter = context.helicopter if same else rotorcraft_model(study.rotorcraft, ends.input, ends.output)
    length = inceptor.lever_length_m if ends.output == COLLECTIVE else float(study.cockpit["cyclic"]["length_m"])
    loop = pilot_loop(model, helicopter, inceptor.gearing_rad_per_m, length, ends.input, ends.output)
    measured = measured_part(helicopter) is not None
    verdict = measured_margins(model, helicopter, loop.gearing, loop.output)[0] if measured else margins(loop)
    if verdict.not_told:  # neither safe nor unsafe: a pilot without an answer, not one with a guessed answer
        raise EvaluationError("margins", f"the loop's margins cannot be told: {verdict.not_told}")
    return loop, verdict
