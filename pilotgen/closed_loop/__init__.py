"""The loop closed in the deck: poles, motion in time, friction and limit cycles.

SPDX-License-Identifier: BSD-3-Clause
"""
