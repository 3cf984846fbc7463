"""People of whom some will fly the machine: joint distributions of age, stature and body mass, files of people.

SPDX-License-Identifier: BSD-3-Clause
"""
