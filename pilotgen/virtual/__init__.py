"""The pilot's deck shaken in time, identification, calibration of the reflex gains.

SPDX-License-Identifier: BSD-3-Clause
"""
