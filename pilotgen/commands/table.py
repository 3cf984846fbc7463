"""`pilotgen table`: the evaluations of a study for other programs.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
import os
import sys
from typing import TYPE_CHECKING, Any

from pilotgen.commands import common
from pilotgen.errors import FileError

if TYPE_CHECKING:
    import numpy as np

    from pilotgen.api import StudyResult

FORMATS = ("csv", "json", "parquet")


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "table",
        "write a study's evaluations as CSV, JSON or Parquet",
        "Write every evaluation of the study.h5 in DIR, one row per pilot: values, margins, posture, poles. Units are "
        "in the names of the columns. CSV: an infinite margin is inf, what a failed pilot lacks is empty; JSON: both "
        "are null. To standard output, or with -o to a file, which must not exist.",
        "pilotgen table results/quick --format csv -o quick.csv",
        json_help="the same as --format json",
    )
    parser.add_argument(
        "directory",
        metavar="DIR",
        type=common.user_path,
        help="output directory of `pilotgen search` or `pilotgen sample`, or a study.h5",
    )
    parser.add_argument(
        "--format", choices=FORMATS, default=None, help="default: as FILE ends, else csv; parquet needs pandas, pyarrow"
    )
    parser.add_argument("-o", "--output", metavar="FILE", type=common.user_path, default=None, help="file to write")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Read study.h5, write the table."""
    from pilotgen.api import open_results
    from pilotgen.files import write_bytes

    if args.json and args.format not in (None, "json"):
        raise FileError(f"--json and --format {args.format} exclude each other; leave one out")
    by_name = common.format_of(args.output, FORMATS)
    args.format = "json" if args.json else args.format or by_name or "csv"
    if args.output is not None and os.path.lexists(args.output):  # a link that leads nowhere is somebody's too
        raise FileError(f"{args.output} exists; choose another file, or move it aside")
    if args.format == "parquet" and args.output is None:
        raise FileError("--format parquet is not text; name a file with -o")
    found = open_results(args.directory)
    data = {"csv": _csv, "json": _json, "parquet": _parquet}[args.format](found)
    if args.output is None:
        sys.stdout.write(data.decode("utf-8"))
    else:
        write_bytes(args.output, data)
    return 0


def _csv(found: StudyResult) -> bytes:
    import csv
    import io

    from pilotgen.runs.results import flat_columns

    columns = flat_columns(found.table())
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*(_cells(column) for column in columns.values()), strict=True))
    return text.getvalue().encode("utf-8")


def _cells(column: np.ndarray) -> list[str]:
    values = column.tolist()
    if column.dtype.kind != "f":
        return [str(value) for value in values]
    return ["" if value != value else repr(value) for value in values]  # NaN is what differs from itself


def _json(found: StudyResult) -> bytes:
    import json

    return (json.dumps(found.to_dict(), allow_nan=False) + "\n").encode("utf-8")


def _parquet(found: StudyResult) -> bytes:
    import io

    buffer = io.BytesIO()
    try:
        found.to_pandas().to_parquet(buffer, index=False)
    except ImportError as error:
        raise FileError(
            f"--format parquet needs pandas and pyarrow ({error}); install them with: pip install 'pilotgen[table]'"
        ) from None
    return buffer.getvalue()
