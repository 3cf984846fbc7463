"""Study files: reading, checking, the schema of every number, the rotorcraft's numbers.

SPDX-License-Identifier: BSD-3-Clause
"""
