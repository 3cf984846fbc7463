"""The deck of a pilot closed with his rotorcraft, and what may disturb it.

`ClosedLoop` holds a solved pilot and the network of his rotorcraft; `ClosedLoop.deck` writes `loop.mbd`, which mbdae
and MBDyn read as it is: the linearised deck has the closed loop's poles, the integrated one its motion.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pilotgen.activation.reflex import reflex_gains
from pilotgen.context import EvaluationContext
from pilotgen.decks.deck import GRAVITY_M_PER_S2, TIME_STEP_S, render_direct
from pilotgen.decks.text import number
from pilotgen.decks.vehicle import Friction, Stops, Vehicle
from pilotgen.errors import EvaluationError, PilotgenError, StudyError
from pilotgen.evaluation import SolvedPilot, solve_pilot
from pilotgen.files import write_text
from pilotgen.loop.network import Network, Reaction, network
from pilotgen.loop.rotorcraft_model import RotorcraftModel, rotorcraft_model
from pilotgen.solver.descriptor import Floats
from pilotgen.solver.matrices import Matrices, read_matrices
from pilotgen.study.sections import Reflex
from pilotgen.study.study import Study

LOOP_DECK = "loop.mbd"
SEAT_REACTION = "seat_pin.reaction[2]"
STOP_STIFFNESS_N_PER_M = 1e5  # estimated: of the ends of the lever's travel, at the grip
START_S = 0.1  # of pulses


@dataclass(frozen=True)
class Disturbance:
    """What acts on a closed loop, as drives that MBDyn reads.

    Attributes
    ----------
    lever : str or None
        Force at the grip along the lever's travel, up positive [N].
    gust : str or None
        Rising air [m/s].
    pull : str or None
        Grip travel that the pilot wants, up positive [m].
    """

    lever: str | None = None
    gust: str | None = None
    pull: str | None = None


def pulse(size: float, duration_s: float, start_s: float = START_S) -> str:
    """Drive of one pulse, size (1 - cos)/2."""
    return f"cosine, {number(start_s)}, {number(2.0 * math.pi / duration_s)}, {number(0.5 * size)}, one, 0."


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """One pilot closed with his rotorcraft.

    Attributes
    ----------
    pilot : SolvedPilot
        In equilibrium at the controls, with his matrices.
    helicopter : RotorcraftModel
        What he flies.
    gains : Reflex
        Of his reflexes.
    net : Network
        The rotorcraft's rows.
    weight_n : float
        What the seat carries at rest [N].
    two_way : bool
        Whether his reaction acts on the rotorcraft.
    """

    pilot: SolvedPilot
    helicopter: RotorcraftModel
    gains: Reflex
    net: Network
    weight_n: float
    two_way: bool

    @property
    def study(self) -> Study:
        """The study as this pilot sees it."""
        return self.pilot.study

    @property
    def lever_length_m(self) -> float:
        """Hinge to grip [m]."""
        return self.study.inceptor.lever_length_m

    @property
    def reaction(self) -> Reaction:
        """The pilot's weight and mass above the seat, controls included."""
        return Reaction(self.weight_n, self.weight_n / GRAVITY_M_PER_S2)

    def stops(self) -> Stops:
        """Ends of the lever's travel, by the cockpit's numbers."""
        numbers = self.study.cockpit["collective"]
        low, high = (math.radians(float(numbers[f"{end}_angle_deg"])) for end in ("lowest", "highest"))
        return Stops(low, high, STOP_STIFFNESS_N_PER_M * self.lever_length_m**2)

    def travel_to_stops_m(self) -> tuple[float, float]:
        """Grip travel from rest to the lower and to the upper stop [m], down negative."""
        ends, angle = self.stops(), math.radians(self.pilot.cockpit.inceptors["left"].angle_deg)
        return (ends.low_rad - angle) * self.lever_length_m, (ends.high_rad - angle) * self.lever_length_m

    def deck(
        self,
        disturbance: Disturbance | None = None,
        *,
        friction: Friction | None = None,
        stops: bool = False,
        activation_check: bool = False,
        final_time_s: float = TIME_STEP_S,
        time_step_s: float = TIME_STEP_S,
    ) -> str:
        """The deck's text.

        Parameters
        ----------
        disturbance : Disturbance, optional
            What acts on it.
        friction : Friction, optional
            Of the lever.
        stops : bool
            Whether the lever has stops.
        activation_check : bool
            Clip activations to [0, 1].
        final_time_s, time_step_s : float
            Of a time integration [s].

        Raises
        ------
        PilotgenError
            A gust on a rotorcraft whose model says nothing of the air, or a pull by a pilot without reflex.
        """
        acts = disturbance if disturbance is not None else Disturbance()
        if acts.gust is not None and not self.net.gust:
            raise PilotgenError(
                "a rotorcraft given by a file of blade pitch to acceleration does not say what a gust does; "
                "kick the lever or let the pilot pull instead"
            )
        lever = None
        if acts.lever is not None:
            lever = f"mult, const, {number(self.lever_length_m)}, {acts.lever}"
        pilot = self.pilot
        assert pilot.matrices is not None
        return render_direct(
            pilot.body,
            pilot.cockpit,
            pilot.posture,
            activations=pilot.activations,
            muscle_lengths=pilot.matrices.muscle_lengths,
            gains=self.gains,
            c=pilot.study.pilot.matrix_coefficient_s,
            torso=pilot.torso,
            activation_check=activation_check,
            final_time_s=final_time_s,
            time_step_s=time_step_s,
            vehicle=Vehicle(
                parts=self.net.parts,
                seat_force_n=self.weight_n,
                gust=(acts.gust, self.net.gust) if acts.gust is not None else None,
                lever_drive=lever,
                pull=(acts.pull, self.pull_per_metre().tolist()) if acts.pull is not None else None,
                friction=friction,
                stops=self.stops() if stops else None,
                two_way=self.two_way,
            ),
        )

    def pull_per_metre(self) -> Floats:
        """What wanting the grip 1 m higher adds to the activations, shape (muscles,) [1/m].

        The pilot shifts the lengths that his reflexes hold to those of the lever he wants: activation i changes by
        -Kp dx_i, dx_i being how its relative length changes along the motion that a moment on the lever causes.

        Raises
        ------
        PilotgenError
            Kp is zero: this pilot holds no lengths.
        """
        from pilotgen.closed_loop.muscles import muscle_rows

        if self.gains.proportional_gain == 0.0:
            raise PilotgenError("a pilot whose reflex has no proportional gain holds no position and cannot pull so")
        pilot = self.pilot
        assert pilot.matrices is not None
        matrices = pilot.matrices
        g_y = (matrices.J_plus - matrices.J_minus) / (2.0 * matrices.c)
        lever = matrices.dof_names.index("lever.gz")
        moment = np.zeros(matrices.n)
        moment[matrices.dof_names.index("lever.hz")] = 1.0
        moved = np.linalg.lstsq(g_y, moment, rcond=None)[0]
        travel = moved[lever] * self.lever_length_m
        stretch = muscle_rows(pilot) @ moved / travel
        return np.asarray(-self.gains.proportional_gain * stretch)

    def linearise(self, context: EvaluationContext, text: str, where: Path) -> Matrices:
        """Matrices of a deck of this loop; the deck and `loop.h5` stay in `where`.

        EvaluationError if the deck is not in equilibrium.
        """
        context.put_modes(self.pilot.torso)
        write_text(where / LOOP_DECK, text)
        output = where / "loop.h5"
        reply = context.ask("linearise", text, LOOP_DECK, output, nodes=False)
        matrices = read_matrices(output, reply.datasets)
        worst = float(np.max(np.abs(matrices.equilibrium_residual)))
        if not worst < 1e-6:
            index = int(np.argmax(np.abs(matrices.equilibrium_residual)))
            raise EvaluationError(
                "loop", f"the closed deck is not in equilibrium: {worst:.3g} left at {matrices.dof_names[index]}"
            )
        return matrices


def close_in_deck(
    context: EvaluationContext,
    values: dict[str, float],
    keep: Path | None = None,
    two_way: bool = False,
    pilot: SolvedPilot | None = None,
) -> ClosedLoop:
    """Solve a pilot and close him with his rotorcraft.

    Parameters
    ----------
    context : EvaluationContext
        Whose solver works.
    values : mapping
        The pilot's own values and changes by path.
    keep : Path, optional
        The pilot's decks stay there.
    two_way : bool
        His reaction acts on the rotorcraft.
    pilot : SolvedPilot, optional
        Already solved; `values` are not looked at then.

    Raises
    ------
    StudyError
        A pilot that no deck holds: Mayo's, the literal projection, a delayed reflex.
    PilotgenError
        A rotorcraft that no deck holds.
    EvaluationError
        This pilot has no answer.
    """
    solved = pilot if pilot is not None else solve_pilot(context, values, keep)
    study = solved.study
    check_study(study)
    same = study.rotorcraft is context.study.rotorcraft
    helicopter = context.helicopter if same else rotorcraft_model(study.rotorcraft)
    settings = study.pilot
    gains = reflex_gains(settings.task, settings.torso["model"], settings.reflex)
    assert solved.matrices is not None
    weight_n = -float(solved.matrices.y[solved.matrices.dof_names.index(SEAT_REACTION)])
    reaction = Reaction(weight_n, weight_n / GRAVITY_M_PER_S2) if two_way else None
    if reaction is not None and reaction.mass_kg >= 0.5 * study.rotorcraft.mass_kg:
        raise PilotgenError(
            f"rotorcraft.mass_kg = {study.rotorcraft.mass_kg:g} is less than twice the {reaction.mass_kg:.0f} kg that "
            "the seat carries; the mass is that of the whole rotorcraft, pilot included"
        )
    net = network(helicopter, study.inceptor.gearing_rad_per_m, settings.washout_rad_s, reaction)
    return ClosedLoop(solved, helicopter, gains, net, weight_n, two_way)


def check_study(study: Study) -> None:
    """Refuse what no deck of a closed loop can hold; StudyError."""
    name = study.path or study.name
    if study.pilot.model != "multibody":
        raise StudyError(f"{name}: pilot.model = {study.pilot.model!r} has no deck; use a multibody pilot")
    if not study.loop.usual:
        raise StudyError(
            f"{name}: loop = {study.loop.words} is not closed in a deck; only heave by the collective is, remove loop"
        )
    if study.rotorcraft.frequency_response is not None:
        raise StudyError(
            f"{name}: rotorcraft.frequency_response = {study.rotorcraft.frequency_response}: a response has no "
            "equations for a deck; give rotorcraft.state_space, rotorcraft.transfer_function or the numbers of the "
            "heave model (margins and cures need none of these: pilotgen pilot, search, cures)"
        )
    if study.pilot.projection != "exact":
        raise StudyError(f"{name}: pilot.projection = 'literal' is a formula that no deck obeys; use exact")
    if study.pilot.reflex_delay_s > 0.0:
        raise StudyError(
            f"{name}: pilot.reflex_delay_s = {study.pilot.reflex_delay_s:g} is added after linearisation and cannot be "
            "in a deck, where muscles react at once; set it to 0"
        )


def friction_of(study: Study) -> Friction | None:
    """Friction of a study's lever; None for none."""
    given = study.inceptor.friction
    if given is None or given["breakout_n"] == 0.0:
        return None
    return Friction(
        breakout_n=given["breakout_n"],
        sliding_n=given["breakout_n"] - given["stribeck_n"],
        velocity_m_s=given["stribeck_velocity_m_s"],
        viscous_n_s_per_m=given["viscous_n_s_per_m"],
        presliding_m=given["presliding_m"],
        model=given["model"],
    )


def with_gearing(loop: ClosedLoop, gearing_rad_per_m: float) -> ClosedLoop:
    """The same loop with another gearing [rad/m]; the pilot stays as he is."""
    net = network(
        loop.helicopter,
        gearing_rad_per_m,
        loop.study.pilot.washout_rad_s,
        loop.reaction if loop.two_way else None,
    )
    inceptor = dataclasses.replace(loop.study.inceptor, gearing_rad_per_m=gearing_rad_per_m)
    study = dataclasses.replace(loop.study, inceptor=inceptor)
    return dataclasses.replace(loop, net=net, pilot=dataclasses.replace(loop.pilot, study=study))


def named(loop: ClosedLoop, nodes: Sequence[str]) -> list[str]:
    """Channels of abstract nodes, as motion files name them."""
    return [f"{node.lower()}.x" for node in nodes]
