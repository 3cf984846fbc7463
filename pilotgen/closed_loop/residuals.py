"""The nonlinear deck along a motion that somebody proposes: what is left of its equations.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import numpy as np

from pilotgen.closed_loop.swing import complexes, reals
from pilotgen.context import EvaluationContext
from pilotgen.errors import EvaluationError
from pilotgen.solver.descriptor import Complexes, Floats

SAMPLES, RESIDUALS = "samples.bin", "residuals.bin"
DECK = "swing.mbd"


class DeckResiduals:
    """Residuals of one deck, asked of the solver (task `residuals`, docs/io_formats/serve.md).

    Parameters
    ----------
    context : EvaluationContext
        Whose solver works; it must live as long as this is used.
    text : str
        The deck.
    unknowns : int
        Of the deck, n.
    """

    def __init__(self, context: EvaluationContext, text: str, unknowns: int) -> None:
        self.context, self.text, self.unknowns = context, text, unknowns

    def along(self, y: Floats, ydot: Floats) -> Floats:
        """Residuals at every sample, shape (samples, n); `y`, `ydot` of the same shape, less those of the posture.

        Raises
        ------
        EvaluationError
            The equations have no finite value there, or the solver fails.
        FileError
            Nothing can be written where the solver works.
        """
        return self._asked(np.concatenate((y, ydot), axis=1), y.size).reshape(y.shape)

    def with_tangents(self, y: Floats, ydot: Floats) -> tuple[Floats, Floats, Floats]:
        """The same, and the averages of their derivatives by y and by ydot, shape (n, n) each.

        Raises
        ------
        EvaluationError
            As `along`.
        """
        n = self.unknowns
        numbers = self._asked(np.concatenate((y, ydot), axis=1), y.size + 2 * n * n, tangents=True)
        g_y, g_ydot = numbers[y.size :].reshape(2, n, n)
        return numbers[: y.size].reshape(y.shape), g_y, g_ydot

    def harmonics(self, Y: Complexes, rates: Complexes, instants: int) -> Complexes:
        """Harmonics of the residuals along a periodic motion, at instants of a period; all shape (n, K + 1).

        Raises
        ------
        EvaluationError
            As `along`.
        """
        motion = np.stack((reals(Y), reals(rates)))
        size = motion.size // 2
        numbers = self._asked(motion, size, harmonics=Y.shape[1] - 1, instants=instants)
        return complexes(numbers.reshape(motion.shape[1:]))

    def harmonics_with_tangents(
        self, Y: Complexes, rates: Complexes, instants: int, every: int
    ) -> tuple[Complexes, Floats, Floats]:
        """The same, and averages of derivatives by y and by ydot over every so many instants, shape (n, n) each.

        Raises
        ------
        EvaluationError
            As `along`.
        """
        n = self.unknowns
        motion = np.stack((reals(Y), reals(rates)))
        size, count = motion.size // 2, Y.shape[1] - 1
        numbers = self._asked(
            motion, size + 2 * n * n, harmonics=count, instants=instants, tangents=True, tangents_every=every
        )
        g_y, g_ydot = numbers[size:].reshape(2, n, n)
        return complexes(numbers[:size].reshape(motion.shape[1:])), g_y, g_ydot

    def _asked(self, motion: Floats, expected: int, **options: int) -> Floats:
        output = f"{self.context.scratch}/{RESIDUALS}"
        self.context.put(SAMPLES, motion.tobytes())
        self.context.ask("residuals", self.text, DECK, output, samples=SAMPLES, **options)
        numbers = np.fromfile(output)
        if len(numbers) != expected:
            raise EvaluationError(
                "harmonic balance",
                f"the solver left {len(numbers)} numbers in {output}; {expected} were asked for",
            )
        return numbers
