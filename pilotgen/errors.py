"""The exceptions a user may see: one sentence that says what came, what was wanted, where, and what to do next.

SPDX-License-Identifier: BSD-3-Clause
"""


class PilotgenError(Exception):
    """Base of every error that pilotgen reports without a traceback."""


class StudyError(PilotgenError):
    """The study file, a data file or a command line value is wrong. The message names file, line and key."""


class FileError(PilotgenError):
    """A file or directory cannot be read, written or recognised."""


class EvaluationError(PilotgenError):
    """One pilot cannot be evaluated; the study goes on.

    Parameters
    ----------
    stage : str
        The stage at which it happened: "biometrics", "body", "posture", "activation", "solver", ...
    reason : str
        One sentence for an ergonomist or engineer, with numbers and units.
    """

    def __init__(self, stage: str, reason: str) -> None:
        super().__init__(f"{stage}: {reason}")
        self.stage = stage
        self.reason = reason

    def __reduce__(self) -> tuple[type["EvaluationError"], tuple[str | bool, ...]]:
        return (type(self), (self.stage, self.reason))


class SolverError(EvaluationError):
    """The solver refused a deck, did not converge, died or took too long.

    `died` is true when the process ended without an answer: it may have been killed from outside, and asking again a
    new one is reasonable.
    """

    def __init__(self, stage: str, reason: str, died: bool = False) -> None:
        super().__init__(stage, reason)
        self.died = died

    def __reduce__(self) -> tuple[type["SolverError"], tuple[str | bool, ...]]:
        return (type(self), (self.stage, self.reason, self.died))


class TooManyFailures(PilotgenError):
    """The study was stopped because more pilots failed than the user allows."""


class IncompleteOutput(PilotgenError):
    """A run came to its end, but could not leave all that it promises; what is there is sound."""


class MatrixError(PilotgenError):
    """A matrices file is not what it should be."""


NO_MEMORY = (  # a sample with one worker ran in 300 MB of address space, in 200 MB it did not
    "out of memory; a limit (ulimit -v, a job's memory) is too low, or the machine has no more: about 500 MB of "
    "address space and 150 MB of memory are wanted for each process"
)
_NO_MEMORY = ("cannot allocate memory", "failed to map segment", "unable to allocate", "memory allocation failed",
              "out of memory", "std::bad_alloc", "can't start new thread")  # fmt: skip


def without_memory(error: BaseException) -> bool:
    """Whether an exception, or what it came from, says that memory ran out: no fault of ours or of any input's."""
    while True:
        told = str(error).lower()
        if isinstance(error, MemoryError) or any(words in told for words in _NO_MEMORY):
            return True
        before = error.__cause__ or error.__context__
        if before is None:
            return False
        error = before
