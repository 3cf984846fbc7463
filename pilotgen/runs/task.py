"""One pilot for a worker process, and what a worker does with it.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import ctypes
import pickle
import platform
import time
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from pilotgen.context import EvaluationContext
from pilotgen.errors import NO_MEMORY, FileError, PilotgenError, without_memory
from pilotgen.evaluation import Evaluation, FailedEvaluation, evaluate
from pilotgen.runs.fingerprint import fingerprint
from pilotgen.study.study import Study
from pilotgen.uncertain.draws import Draws
from pilotgen.uncertain.robust import with_draws


@dataclass(frozen=True)
class Task:
    """One pilot for a worker: everything it needs, quick to send.

    `study` is a pickled `Study`, always the same bytes for one study: a worker unpickles it once. With `fingerprint` a
    worker first makes sure that its code, data and solver are those of who sent the task.
    """

    study: bytes
    values: dict[str, Any]  # `Study.values`
    mbdae: str | None = None
    solver: str = "mbdae"
    mbdyn: str | None = None
    time_limit_s: float = 30.0
    fingerprint: str | None = None
    robust: bool = False  # draws of what is uncertain as well, for a robust search


GO_ON = "nothing that was at work is recorded; put it right and go on with --resume"

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # mallopt(3)


def keep_freed_memory() -> None:
    """Have the C library keep freed memory for the next pilot, who needs as much, instead of giving it back each time.

    Saves some 350 page faults, a millisecond, per pilot. Does nothing with a C library other than glibc.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, 32 << 20)
        mallopt(_M_TRIM_THRESHOLD, 256 << 20)


_CONTEXTS: dict[tuple[Any, ...], EvaluationContext] = {}


def context_of(task: Task) -> EvaluationContext:
    """The evaluation context of a task, which this process keeps until another study comes.

    Raises FileError where another pilotgen or solver is installed than with who sent the task.
    """
    key = (task.study, task.mbdae, task.solver, task.mbdyn, task.time_limit_s, task.fingerprint)
    context = _CONTEXTS.get(key)
    if context is None:
        for old in _CONTEXTS.values():
            old.close()
        _CONTEXTS.clear()
        keep_freed_memory()
        study: Study = pickle.loads(task.study)
        if task.fingerprint is not None and fingerprint(study, task.mbdae, task.solver) != task.fingerprint:
            raise FileError(
                f"the worker on {platform.node()} has another pilotgen (code, data, templates) or another solver than "
                "this run; install the same on every machine"
            )
        context = _CONTEXTS[key] = EvaluationContext(study, task.mbdae, task.solver, task.mbdyn, task.time_limit_s)
        _close_at_exit(context)
    return context


def run_task(task: Task) -> tuple[dict[str, Any], float]:
    """Evaluate one pilot in a worker process, which keeps its evaluation context from pilot to pilot.

    Raises FileError where another pilotgen or solver is installed than with who sent the task.

    Returns
    -------
    tuple
        The result object, and the CPU time spent on it in s: this process and the solver's own account.
    """
    outcome, cpu_s = evaluated(task)
    return outcome.result, cpu_s


def evaluated(task: Task) -> tuple[Evaluation | FailedEvaluation, float]:
    """As `run_task`, with all of the outcome. Raises FileError and other errors as it does."""
    context = context_of(task)
    start_cpu, start_solver = time.process_time(), context.solver_seconds
    outcome: Evaluation | FailedEvaluation
    try:
        outcome = evaluate(context, task.values)
        if task.robust and isinstance(outcome, Evaluation):
            outcome = with_draws(context, _draws(task.study), outcome)
    except PilotgenError:
        raise  # a missing solver, a full disk, a wrong study: no pilot would fare better
    except OSError as error:  # the machine's: no pilot would fare better
        raise FileError(f"{error.filename or 'a worker'}: {error.strerror or error}; {GO_ON}") from None
    except Exception as error:  # the edge of a worker: a fault of ours on one pilot must not end the study
        if without_memory(error):
            raise FileError(f"{NO_MEMORY}; {GO_ON}") from None
        outcome = FailedEvaluation(task.values, "internal", f"{type(error).__name__}: {error}")
    return outcome, time.process_time() - start_cpu + context.solver_seconds - start_solver


@lru_cache(maxsize=1)
def _draws(pickled: bytes) -> Draws:
    study: Study = pickle.loads(pickled)
    return Draws(study, study.uncertain["draws"])


def _close_at_exit(context: EvaluationContext) -> None:
    # Forked workers leave through os._exit, which runs multiprocessing's finalizers but not atexit's.
    import atexit
    import multiprocessing.util

    atexit.register(context.close)
    multiprocessing.util.Finalize(context, context.close, exitpriority=10)
