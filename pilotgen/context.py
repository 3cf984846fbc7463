"""What one process needs to evaluate the pilots of a study: solver, scratch directory, rotorcraft.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
from typing import Any

from pilotgen.errors import FileError, SolverError
from pilotgen.loop.rotorcraft_model import rotorcraft_model
from pilotgen.posture.seated_torso import FEM_NAME, SeatedTorso
from pilotgen.solver.client import SolverClient, find_mbdae
from pilotgen.solver.mbdyn import find_mbdyn
from pilotgen.solver.protocol import SolverReply
from pilotgen.solver.scratch import PLACE as SCRATCH_PLACE
from pilotgen.solver.scratch import ScratchDirectory
from pilotgen.study.study import Study

CANNOT_WRITE = "cannot write "  # how the solver begins when its disk is full or read-only
SOLVER_ATTEMPTS = 3  # a solver can be killed from outside; a deck that kills it every time is at fault


class EvaluationContext:
    """What one process needs to evaluate the pilots of one study: solver, scratch directory, rotorcraft.

    Parameters
    ----------
    study : Study
        The study.
    mbdae, mbdyn : str, optional
        Paths of the programs.
    solver : str
        "mbdae", or "mbdyn" to let MBDyn linearise the pilot's deck (posture and trim stay with mbdae).
    time_limit_s : float
        Wall time limit of one solver call.
    """

    def __init__(
        self,
        study: Study,
        mbdae: str | None = None,
        solver: str = "mbdae",
        mbdyn: str | None = None,
        time_limit_s: float = 30.0,
    ) -> None:
        self.study = study
        self.solver = solver
        self.time_limit_s = time_limit_s
        # A missing program is found out before anything is written.
        self.mbdae = find_mbdae(mbdae) if study.pilot.model == "multibody" else None
        self.mbdyn = find_mbdyn(mbdyn) if solver == "mbdyn" else None
        self.helicopter = rotorcraft_model(study.rotorcraft, study.loop.input, study.loop.output)
        self.solver_seconds = 0.0
        self._client: SolverClient | None = None
        self._scratch = ScratchDirectory()
        self.scratch = self._scratch.path
        self._put_last: tuple[str, int] | None = None

    @property
    def client(self) -> SolverClient:
        """The running solver; started when first asked for."""
        if self._client is None:
            self._client = SolverClient(self.mbdae, directory=self.scratch)
        return self._client

    def ask(
        self, task: str, text: str, name: str, output: str | os.PathLike[str] | None = None, **options: Any
    ) -> SolverReply:
        """One solver call; a solver that dies is started again, three times at most.

        The deck goes by the scratch directory, where the solver works: coding it as a JSON string and decoding it again
        would cost more than the file.

        Raises
        ------
        SolverError
            The solver refused this deck, or could not do what was asked.
        FileError
            Nothing can be written where the solver works: the machine's fault, not the pilot's.
        """
        self.put(name, text)
        for attempt in range(1, SOLVER_ATTEMPTS + 1):
            try:
                reply = self.client.request(
                    task,
                    name=name,
                    output=output,
                    timeout_s=self.time_limit_s,
                    **options,
                )
                break
            except SolverError as error:
                if error.reason.startswith(CANNOT_WRITE):  # no pilot would fare better
                    raise FileError(f"{error.reason}; check space and permissions") from None
                if not error.died or attempt == SOLVER_ATTEMPTS:
                    raise
        self.solver_seconds += reply.seconds
        return reply

    def put(self, name: str, content: str | bytes) -> None:
        """Put a file where the solver works; FileError if it cannot be written there."""
        data = memoryview(content.encode() if isinstance(content, str) else content)
        self._put_last = name, len(data)
        try:  # by system calls: a file object costs more than the writing
            file = os.open(f"{self.scratch}/{name}", os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
            try:
                while data:
                    data = data[os.write(file, data) :]
            finally:
                os.close(file)
        except OSError as error:
            raise FileError(
                f"{self.scratch}: {name} cannot be handed to the solver ({error.strerror}); check space there, or name "
                f"another place by the environment variable {SCRATCH_PLACE}"
            ) from None

    def put_modes(self, torso: SeatedTorso | None) -> None:
        """Put the file with a torso's modes, if it has any, where the decks go that read it."""
        if torso is not None and torso.modes is not None:
            self.put(FEM_NAME, torso.modes.fem)

    def check_scratch(self) -> None:
        """Raise FileError if the scratch directory, and no pilot, is why something failed."""
        if self._put_last is not None:
            self._scratch.check(*self._put_last)

    def close(self) -> None:
        """Stop the solver and remove the scratch directory."""
        if self._client is not None:
            self._client.close()
            self._client = None
        self._scratch.close()

    def __enter__(self) -> EvaluationContext:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
