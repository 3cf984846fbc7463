"""Linear algebra on the matrices: modes, imposed motion, biodynamic feedthrough, comparison.

SPDX-License-Identifier: BSD-3-Clause
"""
