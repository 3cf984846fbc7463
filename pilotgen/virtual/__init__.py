"""The pilot's deck simulated in time, identification, calibration of the reflex gains.

SPDX-License-Identifier: BSD-3-Clause
"""
