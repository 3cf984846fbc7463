"""What cures bounce: the catalogue of changes, and the cheapest combination that brings pilots to the limits.

SPDX-License-Identifier: BSD-3-Clause
"""
