"""`pilotgen view`: write the page of one pilot again.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from pilotgen.commands import common
from pilotgen.errors import FileError
from pilotgen.files import read_strict_json, refuse_special
from pilotgen.objectives import MARGINS

WRITES = ("pilot.html", "front/*/pilot.html")


def add_parser(commands: Any) -> None:
    """Declare the command."""
    parser = common.add_command(
        commands,
        "view",
        "write the page that shows one pilot",
        "Evaluate the pilot of DIR's result.json again and write pilot.html beside it: his response and margins, his "
        "skeleton in 3-D with muscles and motion, the nominal pilot beside him. DIR is the output directory of "
        "`pilotgen pilot` (which writes the page itself, unless told --no-figures), or front/NN of a search.",
        "pilotgen view results/tall",
    )
    parser.add_argument("directory", metavar="DIR", type=common.user_path, help="where result.json is")
    parser.add_argument("--open", action="store_true", help="show the page in the web browser")
    common.add_mbdae(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Read result.json and the study, evaluate, write."""
    from pilotgen.runs.executor import pin_threads

    pin_threads()
    from pilotgen.context import EvaluationContext
    from pilotgen.output import claimed
    from pilotgen.report.view import repeat_pilot
    from pilotgen.study.study import study_from_text

    directory = args.directory.absolute()
    content = _result(directory / "result.json")
    of_front = directory.parent.name == "front" and not (directory / "study.yaml").is_file()
    home = directory.parent.parent if of_front else directory
    path = home / "study.yaml"
    refuse_special(path)
    try:
        study = study_from_text(path.read_text(encoding="utf-8"), str(path))
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(
            f"{path}: the study of this pilot cannot be read ({error}); evaluate him again with pilotgen pilot"
        ) from None
    study = study.with_values(content["values"])[0]
    with (
        EvaluationContext(study, mbdae=args.mbdae) as context,
        claimed(home, "view", WRITES, resume=True),
    ):
        page = repeat_pilot(directory, context, content["values"], content)
    if args.json:
        common.print_json({"page": page})
    else:
        print(f"page: {page}")
    if args.open:
        import webbrowser

        webbrowser.open(page.as_uri())
    return 0


def _result(path: Path) -> dict[str, Any]:
    """A result.json of a pilot who could be evaluated."""
    try:
        content = read_strict_json(path)
    except FileNotFoundError:
        raise FileError(
            f"{path} does not exist; DIR is the output directory of `pilotgen pilot`, or front/NN of a search"
        ) from None
    except (OSError, ValueError) as error:
        raise FileError(f"{path}: cannot be read ({error}); evaluate the pilot again with pilotgen pilot") from None
    if not isinstance(content, dict) or content.get("status") != "ok" or not isinstance(content.get("values"), dict):
        raise FileError(f"{path}: holds no pilot who could be evaluated; there is nothing to show")
    try:
        margins = [row.of(content) for row in MARGINS]
        sound = all(isinstance(margin, float | int) for margin in margins)
    except (LookupError, TypeError, ValueError, AttributeError):
        sound = False
    kinds = {"caveats": list, "provenance": dict}
    if not sound or not all(isinstance(content.get(key, kind()), kind) for key, kind in kinds.items()):
        raise FileError(f"{path}: is damaged; evaluate the pilot again with pilotgen pilot")
    return content
