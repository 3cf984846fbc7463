"""Two valid studies, and what is said of one that is not."""

from __future__ import annotations

import pytest

from pilotgen.errors import StudyError
from pilotgen.study.study import study_from_text

MULTIBODY = """\
study: test
rotorcraft: iar330-puma
inceptor: {lever_length_m: 0.32, gearing_rad_per_m: 1.1, position: 0.5}
pilot:
  model: multibody
  sex: male
  task: position
  limbs: [left]
  washout_rad_s: 3.10
nominal: {age_years: 40, bmi: 24, stature_m: 1.775}
search:
  variables: {age_years: [25, 65], bmi: [18, 30], stature_m: [1.55, 2.00]}
  objectives: [gain_margin_db, phase_margin_deg]
  population: 100
  generations: 30
  mutation_probability: 0.10
  seed: 1
"""
MAYO = """\
study: test
rotorcraft: iar330-puma
inceptor: {lever_length_m: 0.32, gearing_rad_per_m: 1.1}
pilot: {model: mayo}
nominal: mesomorphic
search:
  variables: {pilot_frequency_hz: [2.5, 4.0]}
  population: 10
  generations: 3
"""


def message_of(text: str) -> str:
    with pytest.raises(StudyError) as caught:
        study_from_text(text, "s.yaml")
    return str(caught.value)


def changed(old: str, new: str, text: str = MULTIBODY) -> str:
    assert text.count(old) >= 1, old
    return text.replace(old, new, 1)
