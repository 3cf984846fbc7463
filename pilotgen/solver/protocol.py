"""What `mbdae --serve` answers: one line of JSON per request, checked and converted (docs/io_formats/serve.md).

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import orjson
from numpy.typing import NDArray

_STATUSES = frozenset({"ok", "deck_error", "not_converged", "io_error", "bad_request", "internal_error"})


class ProtocolError(Exception):
    """An answer is no reply; the message says why."""


@dataclass(frozen=True)
class Diagnostic:
    """One message about a deck: file, line and column from 1 (0 = the file as a whole)."""

    file: str
    line: int
    column: int
    severity: str
    message: str

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}:{self.column}" if self.line > 0 else self.file
        return f"{place}: {self.severity}: {self.message}"


@dataclass(frozen=True)
class NodePose:
    """Where a node is: `position` (3,) [m] and `orientation` (3, 3) whose columns are the node's axes, both global."""

    position: NDArray[np.float64]
    orientation: NDArray[np.float64]


@dataclass(frozen=True)
class SolverReply:
    """The solver's answer; fields as in docs/io_formats/serve.md.

    `residual_norm` is in N and N m, `seconds` wall clock inside the solver, `nodes` in deck order by name, `datasets`
    where they lie in the matrices file that was written.
    """

    status: str
    exit_code: int
    message: str
    diagnostics: tuple[Diagnostic, ...]
    analysis: str
    iterations: int
    residual_norm: float
    seconds: float
    counts: dict[str, int]
    nodes: dict[str, NodePose]
    datasets: dict[str, list[int]]
    output_path: str

    @property
    def output(self) -> Path | None:
        """The file that was written, if any."""
        return Path(self.output_path) if self.output_path else None


def excerpt(data: bytes) -> str:
    """The beginning of what came, for messages."""
    return repr(data[:80].decode(errors="replace"))


def read_reply(line: bytes, request_id: int) -> SolverReply:
    """Check and convert one reply line; ProtocolError when it is not what the protocol promises."""
    try:
        data = orjson.loads(line)
    except ValueError:
        raise ProtocolError(f"not JSON: {excerpt(line)}") from None
    if not isinstance(data, dict):
        raise ProtocolError(f"not an object: {excerpt(line)}")
    if data.get("id") != request_id:
        raise ProtocolError(f"reply to request {data.get('id')!r} where {request_id} was asked")
    if data.get("status") not in _STATUSES:
        raise ProtocolError(f"unknown status {data.get('status')!r}")
    try:
        norm = data["residual_norm"]
        return SolverReply(
            status=str(data["status"]),
            exit_code=int(data["exit_code"]),
            message=str(data["message"]),
            diagnostics=tuple(
                Diagnostic(
                    str(item["file"]),
                    int(item["line"]),
                    int(item["column"]),
                    str(item["severity"]),
                    str(item["message"]),
                )
                for item in data["diagnostics"]
            ),
            analysis=str(data["analysis"]),
            iterations=int(data["iterations"]),
            residual_norm=float("nan") if norm is None else float(norm),
            seconds=float(data["seconds"]),
            counts={str(key): int(value) for key, value in data["counts"].items()},
            nodes=_read_poses(data["nodes"]),
            datasets={str(name): [int(value) for value in place] for name, place in data["datasets"].items()},
            output_path=str(data["output"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ProtocolError(f"a reply with a missing or wrong value ({type(error).__name__}: {error})") from None


def _read_poses(items: list[dict[str, Any]]) -> dict[str, NodePose]:
    """Poses by name; all numbers are converted at once, which is what a search waits for."""
    if not items:
        return {}
    for item in items:
        position, orientation = item["position"], item["orientation"]
        if len(position) != 3 or [len(row) for row in orientation] != [3, 3, 3]:
            raise ValueError(f"pose of node {item['name']!r} has the wrong shape")
    positions = np.array([item["position"] for item in items], dtype=np.float64).reshape(-1, 3)
    orientations = np.array([item["orientation"] for item in items], dtype=np.float64).reshape(-1, 3, 3)
    finite = np.isfinite(positions).all(axis=1) & np.isfinite(orientations).all(axis=(1, 2))
    if not finite.all():
        raise ValueError(f"pose of node {items[int(np.argmin(finite))]['name']!r} is not finite")
    return {str(item["name"]): NodePose(positions[k], orientations[k]) for k, item in enumerate(items)}
