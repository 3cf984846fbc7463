"""The nonlinear deck along a motion that somebody proposes: what is left of its equations.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import numpy as np

from pilotgen.context import EvaluationContext
from pilotgen.errors import EvaluationError
from pilotgen.solver.descriptor import Floats

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
        return self._asked(y, ydot, 0).reshape(y.shape)

    def with_tangents(self, y: Floats, ydot: Floats) -> tuple[Floats, Floats, Floats]:
        """The same, and the averages of their derivatives by y and by ydot, shape (n, n) each.

        Raises
        ------
        EvaluationError
            As `along`.
        """
        n = self.unknowns
        numbers = self._asked(y, ydot, 2 * n * n)
        g_y, g_ydot = numbers[y.size :].reshape(2, n, n)
        return numbers[: y.size].reshape(y.shape), g_y, g_ydot

    def _asked(self, y: Floats, ydot: Floats, more: int) -> Floats:
        output = f"{self.context.scratch}/{RESIDUALS}"
        self.context.put(SAMPLES, np.concatenate((y, ydot), axis=1).tobytes())
        self.context.ask("residuals", self.text, DECK, output, samples=SAMPLES, tangents=more > 0)
        numbers = np.fromfile(output)
        if len(numbers) != y.size + more:
            raise EvaluationError(
                "harmonic balance",
                f"the solver left {len(numbers)} numbers in {output}; {y.size + more} were asked for",
            )
        return numbers
