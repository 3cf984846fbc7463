"""Which numbers decide a result: points to evaluate, and what their results say; by SALib.

SPDX-License-Identifier: BSD-3-Clause
"""
