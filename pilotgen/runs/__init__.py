"""Many pilots: workers, journal, results of a run.

SPDX-License-Identifier: BSD-3-Clause
"""
