"""`--set name=value`: a study with other numbers and words, for one pilot or for a run over many.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pilotgen.errors import StudyError
from pilotgen.study.fields import Mistake
from pilotgen.study.schema import locate
from pilotgen.study.study import Study, check_together
from pilotgen.study.wording import shown
from pilotgen.study.yaml_file import plain_scalar, yaml_from_text


def apply_settings(study: Study, settings: Mapping[str, str]) -> tuple[Study, dict[str, Any]]:
    """Return the study and the values of one pilot with `--set name=value` changes.

    Values outside the study's search bounds are welcome, values outside the limits of the schema are not.

    Returns
    -------
    tuple
        The changed study, and `study.values(changes)`: the pilot's own values and every other change by its path.
    """
    changes = {name: _from_text(name, text) for name, text in settings.items()}
    changed, own = study.with_values(changes, say=lambda name, _: f"--set {name}={settings[name]}")
    others = {name: data for name, data in changes.items() if locate(name)[0].partition(".")[0] != "nominal"}
    return changed, {**own, **others}


def changed_study(study: Study, settings: Mapping[str, str]) -> Study:
    """Return the study with `--set name=value` changes, its nominal pilot among them, with a text that says so.

    What a run over many pilots takes: its text is what a directory keeps, what `--resume` compares, and what a report
    repeats pilots with. Without settings the study itself. Raises StudyError as `Study.with_values`, and for a nominal
    pilot who does not go with the rest.
    """
    if not settings:
        return study
    changed, values = apply_settings(study, settings)
    own = {name: data for name, data in values.items() if locate(name)[0] == f"nominal.{name}"}
    if own != study.nominal:
        changed = dataclasses.replace(changed, nominal=own)
        try:
            check_together(changed)
        except Mistake as mistake:
            given = [name for name in settings if locate(name)[0].startswith("nominal.")]
            told = ", ".join(f"--set {name}={settings[name]}" for name in given)
            raise StudyError(f"{told}: {mistake.path} = {shown(mistake.value)} {mistake.problem}") from None
    people = changed.population["file"]
    if people is not None:  # the text is kept elsewhere
        whole = str((Path(study.path).parent / people).absolute())
        changed = dataclasses.replace(changed, population={**changed.population, "file": whole})
    return changed.with_own_text()


def refuse_idle(settings: Mapping[str, str], unused: Sequence[str], command: str) -> None:
    """Raise StudyError for a setting below one of these paths, which a command makes nothing of."""
    for name, text in settings.items():
        path = locate(name)[0]
        if any(path == part or path.startswith(f"{part}.") for part in unused):
            raise StudyError(
                f"--set {name}={text} would do nothing: `pilotgen {command}` makes no use of it; leave it out"
            )


def _from_text(name: str, text: str) -> Any:
    if text.lstrip().startswith("["):
        try:
            return yaml_from_text(text, "").value
        except StudyError:
            raise StudyError(f"--set {name}={text}: a list is written [a, b, c]; check brackets and commas") from None
    return plain_scalar(text.strip())
