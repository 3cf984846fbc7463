"""How many pilots are evaluated: by whom, how many at a time, and when to stop.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import os
from dataclasses import dataclass

from pilotgen.errors import StudyError


@dataclass(frozen=True)
class RunOptions:
    """Options of a search or a sample; none of them changes a result.

    Attributes
    ----------
    workers : int or None
        Processes; None: one per core.
    resume : bool
        Go on in a directory that already holds this study; finished evaluations are kept.
    retry_failed : bool
        With `resume`: evaluate again the pilots that failed.
    max_failures : int or None
        Stop with TooManyFailures when more pilots than this have failed.
    time_limit_s : float
        Wall time limit of one solver call.
    executor : str
        "processes" of this machine, or "dask".
    scheduler : str or None
        Address of a running dask scheduler; None: a cluster of processes of this machine.
    solver : str
        "mbdae", or "mbdyn" to let MBDyn linearise the pilot's deck.
    mbdae, mbdyn : str or None
        Paths of the programs.

    Raises
    ------
    StudyError
        Options that would do nothing together.
    """

    workers: int | None = None
    resume: bool = False
    retry_failed: bool = False
    max_failures: int | None = None
    time_limit_s: float = 30.0
    executor: str = "processes"
    scheduler: str | None = None
    solver: str = "mbdae"
    mbdae: str | None = None
    mbdyn: str | None = None

    def __post_init__(self) -> None:
        if self.scheduler is not None and self.executor != "dask":
            raise StudyError("--scheduler is for --executor dask; add that, or leave --scheduler out")
        if self.scheduler is not None and self.workers is not None:
            raise StudyError("--workers does nothing with --scheduler, which has workers of its own; leave one out")
        if self.retry_failed and not self.resume:
            raise StudyError("--retry-failed is for --resume, which has pilots that failed; add that, or leave it out")
        if self.mbdyn is not None and self.solver != "mbdyn":
            raise StudyError("--mbdyn is for --solver mbdyn; add that, or leave --mbdyn out")

    def worker_count(self, most: int) -> int:
        """Processes to start, no more than `most`, the pilots that are asked for at a time."""
        return min(self.workers if self.workers is not None else len(os.sched_getaffinity(0)), most)
