"""The Python interface: what `import pilotgen as pg` offers (docs/python.md). Everything else is internal.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import copy
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pilotgen.context import EvaluationContext
from pilotgen.errors import EvaluationError, FileError, PilotgenError
from pilotgen.evaluation import Evaluation
from pilotgen.evaluation import evaluate as evaluate_in
from pilotgen.linear.statespace import StateSpaceModel
from pilotgen.loop.margins import Margins
from pilotgen.loop.units import CONTROLS
from pilotgen.objectives import OBJECTIVES
from pilotgen.output import STUDY_FILES, claimed
from pilotgen.people_api import Found, begun, rare_share, sample_population, sensitivity_of, uncertain_pilot
from pilotgen.runs.batch import RESULTS_NAME, OnProgress, Progress
from pilotgen.runs.options import RunOptions
from pilotgen.runs.results import Row, StudyResults, columns_of, flat_columns, read_results, structured_array
from pilotgen.study.loop_section import LoopSignals
from pilotgen.study.schema import field_of
from pilotgen.study.study import Study, read_study
from pilotgen.summary import caveats

if TYPE_CHECKING:
    import control
    import pandas
    import xarray

__all__ = [
    "OBJECTIVES",
    "EvaluationError",
    "Found",
    "Pilot",
    "PilotgenError",
    "Pilots",
    "Progress",
    "RunOptions",
    "Study",
    "StudyResult",
    "evaluate",
    "evaluate_many",
    "open_results",
    "rare_share",
    "read_study",
    "sample_pilots",
    "sample_population",
    "search_pilots",
    "sensitivity_of",
    "uncertain_pilot",
]

ACCELERATION, ROTATION, PITCH = "seat_zddot_m_s2", "collective_rad", "blade_pitch_rad"  # of heave by the collective


@dataclass(frozen=True)
class Pilot:
    """One pilot, evaluated.

    Attributes
    ----------
    values : mapping
        Name -> value, in the unit of its name.
    margins : Margins
        Stability margins of the loop, every crossing included.
    caveats : tuple of str
        What limits the result, first of all where it extrapolates.
    """

    values: Mapping[str, float]
    margins: Margins
    caveats: tuple[str, ...]
    _evaluation: Evaluation = field(repr=False)

    def to_dict(self) -> dict[str, Any]:
        """The result object (docs/io_formats/result.md) with its caveats: plain numbers, texts, lists, dictionaries."""
        return copy.deepcopy({**self._evaluation.result, "caveats": list(self.caveats)})

    def feedthrough(self, washout: bool = True) -> control.StateSpace:
        """Acceleration of the seat in, rotations of the controls [rad] and motion of the collective grip [m] out.

        Parameters
        ----------
        washout : bool
            False leaves out the pilot's trimming of slow errors.
        """
        return self._evaluation.pilot_model.to_control(washout)

    def open_loop(self) -> control.StateSpace:
        """L(s), cut at the seat's acceleration; closed with negative feedback, the critical point is -1."""
        name = self._signals()[0]
        return _to_control(self._evaluation.loop.open_loop, name, f"{name}_returned", "open_loop")

    def _signals(self) -> tuple[str, str, str]:
        """Names of the seat's acceleration, of the control's rotation and of the blade pitch."""
        loop = self._evaluation.loop
        ends = LoopSignals(loop.motion, loop.control)
        if ends.usual:
            return ACCELERATION, ROTATION, PITCH
        return (
            f"seat_{ends.input}_{ends.per_acceleration}",
            f"{CONTROLS[ends.output][0]}_rad",
            f"{ends.output}_pitch_rad",
        )

    def closed_loop(self) -> control.StateSpace:
        """Pilot and rotorcraft: blade pitch [rad] added to the pilot's in; acceleration of the seat [m/s^2, rad/s^2],
        rotation of the control [rad] and the pilot's blade pitch [rad] out.
        """
        import control

        loop = self._evaluation.loop
        G, K, gearing = loop.helicopter.state_space, loop.pilot, loop.gearing
        share = 1.0 / (1.0 - gearing * G.D * K.D)  # of what the direct terms make of each other
        n, m = G.n_states, K.n_states
        # zddot = share (G.C x + G.D (u + gearing K.C k)); phi = K.C k + K.D zddot; theta = gearing phi
        zddot = share * np.concatenate([G.C, gearing * G.D * K.C])
        phi = np.concatenate([np.zeros(n), K.C]) + K.D * zddot
        into = share * G.D
        A = np.zeros((n + m, n + m))
        A[:n, :n], A[n:, n:] = G.A, K.A
        A[:n] += np.outer(G.B, gearing * phi)
        A[n:] += np.outer(K.B, zddot)
        B = np.concatenate([G.B * (1.0 + gearing * K.D * into), K.B * into])
        C = np.stack([zddot, phi, gearing * phi])
        D = into * np.array([1.0, K.D, gearing * K.D])
        acceleration, rotation, pitch = self._signals()
        names = [acceleration, rotation, f"pilot_{pitch}"]
        return control.ss(A, B[:, None], C, D[:, None], inputs=[pitch], outputs=names, name="closed_loop")


def _to_control(model: StateSpaceModel, put_in: str, out: str, name: str) -> control.StateSpace:
    import control

    return control.ss(
        model.A, model.B[:, None], model.C[None, :], [[model.D]], inputs=[put_in], outputs=[out], name=name
    )


def evaluate(
    study: Study,
    values: Mapping[str, Any] | None = None,
    keep: str | os.PathLike[str] | None = None,
    mbdae: str | None = None,
    solver: str = "mbdae",
    mbdyn: str | None = None,
) -> Pilot:
    """Evaluate one pilot of a study.

    Parameters
    ----------
    study : Study
        From `read_study`.
    values : mapping, optional
        What this pilot has other than the study's nominal one: short names (`stature_m`) or paths of any number or word
        of the study (`rotorcraft.mass_kg`, `pilot.task`) -> value in the unit of the name.
    keep : path, optional
        New or empty directory (or one that this function filled) for decks and matrices.h5.
    mbdae, solver, mbdyn
        As the options of `pilotgen pilot`.

    Raises
    ------
    EvaluationError
        The pilot cannot be evaluated: `stage` and `reason` say where and why.
    StudyError
        A name or a value that the study cannot have.
    FileError
        There is no solver, or `keep` cannot be written to.
    """
    study.with_values(values or {})  # a slip of the caller is his to know, not a pilot's failure
    pilot = study.values(values or {})
    with EvaluationContext(study, mbdae=mbdae, solver=solver, mbdyn=mbdyn) as context:
        if keep is None:
            outcome = evaluate_in(context, pilot)
        else:
            with claimed(Path(keep), "evaluate", ("*.mbd", "*.h5", "*.nc")) as directory:
                outcome = evaluate_in(context, pilot, keep=directory)
    if isinstance(outcome, Evaluation):
        return Pilot(outcome.values, outcome.margins, tuple(caveats(study, outcome.result)), outcome)
    raise EvaluationError(outcome.stage, outcome.reason)


class _Table:
    """Evaluations as rows: what `Pilots` and `StudyResult` share."""

    _columns: Mapping[str, np.ndarray]
    _names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self._columns["status"])

    def table(self) -> np.ndarray:
        """One row per evaluation as a NumPy structured array: the values by name, `status`, margins and all else.

        Units are in the names; infinite margins are `inf`, what a failed pilot lacks is NaN.
        """
        return structured_array(self._columns, self._names)

    def to_pandas(self) -> pandas.DataFrame:
        """The table as a pandas DataFrame; needs pandas."""
        import pandas

        return pandas.DataFrame(flat_columns(self.table()))

    def to_xarray(self) -> xarray.Dataset:
        """The table as an xarray Dataset over the dimension `pilot`, units as attributes; needs xarray."""
        import xarray

        from pilotgen.runs.results import unit_of

        columns = flat_columns(self.table())
        return xarray.Dataset({name: ("pilot", column, {"units": unit_of(name)}) for name, column in columns.items()})


class Pilots(_Table):
    """Many pilots, evaluated; failures are among them, with `status`, `stage` and `reason`.

    Indexing gives result objects, `table()` all of them as an array.
    """

    def __init__(self, values: Sequence[Mapping[str, float]], results: Sequence[dict[str, Any]]) -> None:
        self._names = tuple(values[0]) if values else ()
        self._results = list(results)
        rows = [Row(0, k, v, result) for k, (v, result) in enumerate(zip(values, results, strict=True))]
        self._columns = columns_of(rows, self._names, np.full((len(rows), 0), np.nan), None)

    def __getitem__(self, index: int) -> dict[str, Any]:
        return copy.deepcopy(self._results[index])

    def to_dict(self) -> dict[str, Any]:
        """`{"pilots": [...]}`: the result objects in the order asked for."""
        return {"pilots": copy.deepcopy(self._results)}


def evaluate_many(
    study: Study,
    pilots: Sequence[Mapping[str, float]],
    options: RunOptions | None = None,
    on_progress: OnProgress | None = None,
) -> Pilots:
    """Evaluate many pilots of a study in worker processes, without a directory.

    Parameters
    ----------
    study : Study
        From `read_study`.
    pilots : sequence of mapping
        What each pilot has other than the nominal one, as of `evaluate`; numbers only, all with the same names.
    options : RunOptions, optional
        Workers, solver, time limit.
    on_progress : callable, optional
        (Progress, milestone) after every pilot.

    Raises
    ------
    StudyError
        A name or a value that the study cannot have.
    PilotgenError
        The pilots change different names, or words.
    """
    from pilotgen.runs.session import evaluate_pilots

    for changes in pilots:
        study.with_values(changes)
        words = [name for name in changes if not field_of(name).numeric]
        if words:
            raise PilotgenError(f"{words[0]} is not a number; change it in the study: study.with_values({{...}})")
    values = [study.values(changes) for changes in pilots]
    if any(tuple(one) != tuple(values[0]) for one in values):
        raise PilotgenError("pilots must all change the same names; give each of them the same keys")
    return Pilots(values, evaluate_pilots(study, values, options or RunOptions(), on_progress))


class StudyResult(_Table):
    """What a search or a sample found: study.h5, read.

    Attributes
    ----------
    path : Path
        study.h5.
    attributes : mapping
        Provenance: versions, fingerprint, seed, the study's text.
    front : ndarray of int
        Rows of the first front, the worst pilots; of a sample, the non-dominated ones.
    """

    def __init__(self, path: Path, results: StudyResults) -> None:
        from pilotgen.report.findings import first_front

        self.path, self.attributes = path, results.attributes
        self.front = first_front(results)
        self._results, self._columns, self._names = results, results.columns, results.names

    def worst(self, count: int = 10) -> np.ndarray:
        """Rows of `table()` of the worst pilots, worst first; pilots that hardly differ count as one."""
        from pilotgen.report.findings import distinct, worst_order

        rows: np.ndarray = self.table()[distinct(self._results, worst_order(self._results), count)]
        return rows

    def to_dict(self) -> dict[str, Any]:
        """Attributes, bounds, the front and every column as plain lists, as JSON takes them.

        Numbers that are infinite (no crossing) or absent are None, as in result.json.
        """
        results = self._results
        return {
            "attributes": {
                key: getattr(value, "tolist", lambda v=value: v)() for key, value in self.attributes.items()
            },
            "variables": {
                name: [float(low), float(high)]
                for name, low, high in zip(results.names, results.lower, results.upper, strict=True)
            },
            "objectives": list(results.objective_names),
            "evaluations": {name: _plain(column) for name, column in results.columns.items()},
            "front": self.front.tolist(),
        }


def _plain(column: np.ndarray) -> list[Any]:
    if column.dtype.kind != "f":
        return list(column.tolist())
    plain = column.astype(object)
    plain[~np.isfinite(column)] = None
    return list(plain.tolist())


def search_pilots(
    study: Study,
    directory: str | os.PathLike[str],
    options: RunOptions | None = None,
    on_progress: OnProgress | None = None,
    report: bool = True,
    overwrite: bool = False,
) -> StudyResult:
    """Breed the worst pilots of a study; leaves what `pilotgen search` leaves in `directory`.

    Parameters
    ----------
    study : Study
        From `read_study`.
    directory : path
        New, empty, or with `RunOptions(resume=True)` one that holds this study.
    options : RunOptions, optional
        Workers, solver, limits.
    on_progress : callable, optional
        (Progress, milestone) after every pilot, and as a milestone after every generation.
    report : bool
        Write report.html and the decks of the front.
    overwrite : bool
        Move an existing directory aside.

    Raises
    ------
    FileError, TooManyFailures
        As `pilotgen.runs.search_study.search_study`.
    """
    from pilotgen.runs.search_study import search_study

    with begun(study, directory, "search", STUDY_FILES, options, on_progress, overwrite) as run:
        done = search_study(run.study, run.directory, run.options, run.told)
        if report:
            from pilotgen.report import write_report

            chosen = run.options
            write_report(run.directory, run.study, done.results, chosen.mbdae, chosen.solver, chosen.mbdyn)
    return open_results(done.path)


def sample_pilots(
    study: Study,
    directory: str | os.PathLike[str],
    number: int,
    method: str = "sobol",
    seed: int | None = None,
    options: RunOptions | None = None,
    on_progress: OnProgress | None = None,
    overwrite: bool = False,
) -> StudyResult:
    """Evaluate `number` pilots spread over the study's box; leaves what `pilotgen sample` leaves in `directory`.

    Parameters
    ----------
    study, directory, options, on_progress, overwrite
        As of `search_pilots`.
    number : int
        How many pilots; pilot i does not depend on it.
    method : str
        "sobol" or "random".
    seed : int, optional
        The study's own by default.
    """
    from pilotgen.runs.sample_study import sample_study

    with begun(study, directory, "sample", STUDY_FILES, options, on_progress, overwrite) as run:
        done = sample_study(run.study, run.directory, number, method, seed, run.options, run.told)
    return open_results(done.path)


def open_results(path: str | os.PathLike[str]) -> StudyResult:
    """Read the study.h5 of a search or sample; `path` is the file or its directory. FileError if it cannot be read."""
    where = Path(path)
    where = where / RESULTS_NAME if where.is_dir() else where
    if not where.exists():
        raise FileError(f"{where} does not exist; a search or a sample leaves it when it is finished")
    return StudyResult(where, read_results(where))
