"""What a report evaluates again: the nominal and the worst pilot, and the curves through the worst one.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from dataclasses import dataclass

from pilotgen.evaluation import Evaluation, FailedEvaluation
from pilotgen.figures.study import Curve


@dataclass(frozen=True)
class Repeated:
    """What is evaluated again for the report.

    Attributes
    ----------
    nominal, worst : Evaluation or FailedEvaluation
        The study's nominal pilot and the worst one.
    curves : tuple of Curve
        Margins through the worst pilot along each variable.
    same : bool
        The worst pilot has the margins that study.h5 holds.
    """

    nominal: Evaluation | FailedEvaluation
    worst: Evaluation | FailedEvaluation
    curves: tuple[Curve, ...]
    same: bool
