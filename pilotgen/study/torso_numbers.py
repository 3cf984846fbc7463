"""The numbers of a torso: the bundled ones (`pilotgen/data/torso.yaml`), or those with changes.

SPDX-License-Identifier: BSD-3-Clause
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from pilotgen.study.fields import Problems, Value
from pilotgen.study.reader import read_section
from pilotgen.study.yaml_file import YamlDocument, bundled

TorsoNumbers = dict[str, Any]
"""`model`, `age_trend`, `bmi_trend`, a mapping of numbers per spring, `girdle` (None: there is none)."""

RIGID, LUMPED, MODES = "rigid", "lumped", "modes"  # torso models


def torso_from(checked: Mapping[str, Any] | None) -> TorsoNumbers:
    """The torso of checked data of a study's `pilot.torso`: the bundled numbers with its changes."""
    merged = dict(_defaults())
    for key, data in (checked or {}).items():
        if key == "girdle":
            merged[key] = None if data in (None, "none") else {**bundled("torso").value["girdle"], **data}
        elif isinstance(data, Mapping):
            merged[key] = {**merged[key], **data}
        else:
            merged[key] = data
    return merged


@cache
def _defaults() -> TorsoNumbers:
    problems = Problems()
    document = YamlDocument(bundled("torso").value["defaults"], "torso.yaml", "", {})
    numbers: TorsoNumbers = read_section(Value(document, ()), "pilot.torso", "", problems)
    problems.tell()
    return {**numbers, "girdle": None if numbers["girdle"] in (None, "none") else numbers["girdle"]}
